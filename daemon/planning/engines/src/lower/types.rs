//! Removes `either` and multiple supertypes, because engines allow only one supertype for each
//! type. Other type expressions become static predicates that hold for the objects of these types.
//!
//! `?x - (either a b)` becomes `?x` with the additional condition `(is'1 ?x)` in the precondition,
//! under the quantifier, or before the effect. If a type has several supertypes, or an object
//! several types, all types become predicates.

use std::sync::Arc;

use pddl::{
    Atom, Condition, Domain, Effect, InitElement, Name, PredicateDeclaration, Privacy, Problem,
    Span, Term, TypeExpr, Typed, Types,
};

/// Changes the task so that each type has at most one supertype, each object has one type, and no
/// `either` remains.
pub(super) fn lower(domain: &mut Domain, problem: &mut Problem) {
    let types = Types::of(domain);
    let hierarchy = hierarchy(domain, problem, &types);
    let mut guards = TypeGuards { has_types: hierarchy.is_some(), seen: Vec::new() };
    for action in &mut domain.actions {
        let guarding = guards.of(&mut action.parameters);
        let precondition = std::mem::take(&mut action.precondition);
        action.precondition = both(guarding, guards.condition(precondition));
        action.effect = guards.effect(std::mem::take(&mut action.effect));
    }
    for axiom in &mut domain.derived {
        let guarding = guards.of(&mut axiom.parameters);
        let condition = std::mem::take(&mut axiom.condition);
        axiom.condition = both(guarding, guards.condition(condition));
    }
    problem.goal = guards.condition(std::mem::take(&mut problem.goal));
    // The parameters of predicates and functions become untyped: no engine needs their types, and
    // some engines reject types without objects.
    let signatures = domain.predicates.iter_mut().map(|it| &mut it.parameters);
    for parameters in signatures.chain(domain.functions.iter_mut().map(|it| &mut it.parameters)) {
        parameters.iter_mut().for_each(|parameter| parameter.ty = TypeExpr::default());
    }
    guards.declare(domain, problem, &types);
    if hierarchy.is_none() {
        let objects = Arc::make_mut(&mut problem.objects).iter_mut().map(|it| &mut it.object);
        domain.constants.iter_mut().chain(objects).for_each(|it| it.ty = TypeExpr::default());
    }
    domain.types = hierarchy.unwrap_or_default();
}

/// Returns the types of a task, each with one supertype; `None` if the types do not form a tree.
fn hierarchy(domain: &Domain, problem: &Problem, types: &Types) -> Option<Vec<Typed>> {
    let is_single = |typed: &Typed| typed.ty.is_object() || typed.ty.alternatives.len() == 1;
    let objects = problem.objects.iter().map(|it| &it.object);
    if !domain.constants.iter().chain(objects).all(is_single) || types.cycle().is_some() {
        return None;
    }
    let names = types.iter().filter(|name| **name != "object");
    names
        .map(|name| {
            let declared = domain.types.iter().filter(|typed| typed.name == *name);
            let mut direct: Vec<&Name> = declared.flat_map(|it| &it.ty.alternatives).collect();
            direct.retain(|supertype| **supertype != "object");
            direct.sort();
            direct.dedup();
            match direct[..] {
                [] => Some(Typed { name: name.clone(), ty: TypeExpr::of("object") }),
                [only] => Some(Typed { name: name.clone(), ty: TypeExpr::of(only.clone()) }),
                _ => None,
            }
        })
        .collect()
}

/// Type expressions that have been replaced by predicates.
struct TypeGuards {
    has_types: bool,
    seen: Vec<TypeExpr>,
}

// === impl TypeGuards ===

impl TypeGuards {
    /// Removes the types that cannot be kept from `variables`. Returns the conditions that replace
    /// them.
    fn of(&mut self, variables: &mut [Typed]) -> Vec<Condition> {
        let mut guarding = Vec::new();
        for variable in variables {
            if variable.ty.is_object() {
                variable.ty = TypeExpr::default();
            } else if !self.has_types || variable.ty.alternatives.len() > 1 {
                let predicate = self.predicate(std::mem::take(&mut variable.ty));
                let arguments = vec![Term::Variable(variable.name.clone())];
                let span = Span::default();
                guarding.push(Condition::Atom(Atom { predicate, arguments, span }));
            }
        }
        guarding
    }

    fn predicate(&mut self, ty: TypeExpr) -> Name {
        let known = self.seen.iter().position(|seen| *seen == ty);
        let index = known.unwrap_or_else(|| {
            self.seen.push(ty);
            self.seen.len() - 1
        });
        name(index)
    }

    fn condition(&mut self, condition: Condition) -> Condition {
        let each = |guards: &mut TypeGuards, parts: Vec<Condition>| {
            parts.into_iter().map(|part| guards.condition(part)).collect()
        };
        match condition {
            Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => condition,
            Condition::Not(inner) => Condition::Not(Box::new(self.condition(*inner))),
            Condition::And(parts) => Condition::And(each(self, parts)),
            Condition::Or(parts) => Condition::Or(each(self, parts)),
            Condition::Imply(left, right) => {
                let left = self.condition(*left);
                Condition::Imply(Box::new(left), Box::new(self.condition(*right)))
            }
            Condition::Exists(mut variables, inner) => {
                let guarding = self.of(&mut variables);
                let inner = both(guarding, self.condition(*inner));
                Condition::Exists(variables, Box::new(inner))
            }
            Condition::Forall(mut variables, inner) => {
                let guarding = self.of(&mut variables);
                let mut inner = self.condition(*inner);
                if !guarding.is_empty() {
                    let guarding = Box::new(both(guarding, Condition::always()));
                    inner = Condition::Imply(guarding, Box::new(inner));
                }
                Condition::Forall(variables, Box::new(inner))
            }
        }
    }

    fn effect(&mut self, effect: Effect) -> Effect {
        match effect {
            Effect::Add(_) | Effect::Delete(_) | Effect::Assign(_) => effect,
            Effect::And(parts) => {
                Effect::And(parts.into_iter().map(|part| self.effect(part)).collect())
            }
            Effect::When(condition, inner) => {
                let condition = self.condition(*condition);
                Effect::When(Box::new(condition), Box::new(self.effect(*inner)))
            }
            Effect::Forall(mut variables, inner) => {
                let guarding = self.of(&mut variables);
                let mut inner = self.effect(*inner);
                if !guarding.is_empty() {
                    let guarding = Box::new(both(guarding, Condition::always()));
                    inner = Effect::When(guarding, Box::new(inner));
                }
                Effect::Forall(variables, Box::new(inner))
            }
        }
    }

    /// Declares the predicates that replace types, and adds their facts to `:init`.
    fn declare(&self, domain: &mut Domain, problem: &mut Problem, types: &Types) {
        let declared = problem.objects.iter().map(|it| &it.object);
        let objects: Vec<Typed> = domain.constants.iter().chain(declared).cloned().collect();
        for (index, ty) in self.seen.iter().enumerate() {
            let parameter = Typed { name: Name::new("x"), ty: TypeExpr::default() };
            domain.predicates.push(PredicateDeclaration {
                name: name(index),
                parameters: vec![parameter],
                privacy: Privacy::Public,
            });
            let members = objects.iter().filter(|object| types.holds(ty, &object.ty));
            problem.init.extend(members.map(|object| {
                let arguments = vec![Term::Object(object.name.clone())];
                InitElement::Atom(Atom { predicate: name(index), arguments, span: Span::default() })
            }));
        }
    }
}

fn name(index: usize) -> Name {
    Name::new(&format!("is'{}", index + 1))
}

/// Returns the conjunction of the conditions in `guarding`, which replace types, and `condition`.
fn both(mut guarding: Vec<Condition>, condition: Condition) -> Condition {
    if guarding.is_empty() {
        return condition;
    }
    if !condition.is_always() {
        guarding.push(condition);
    }
    Condition::And(guarding)
}
