//! The projection of an agent's task: what others learn of it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::factored::AgentFiles;
use pddl::{
    ActionSchema, Assign, Atom, Compare, Condition, Domain, Effect, Expression, FluentTerm,
    InitElement, Name, ObjectDeclaration, PredicateDeclaration, Privacy, Problem, TOTAL_COST, Term,
    TypeExpr, Typed,
};

use crate::opaque_names::OpaqueNames;
use crate::private_symbols::{PrivateSymbol, PrivateSymbols, Scope, atom_of, scope_of};
use crate::terms::UsedTerms;

/// The projection of one agent's task, as PDDL: private symbols have opaque names or are dropped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Projection {
    /// The projected domain.
    pub domain: String,
    /// The projected problem.
    pub problem: String,
}

/// The projection of one agent's task, as trees.
#[derive(Clone)]
pub(crate) struct ProjectedTask {
    pub(crate) domain: Domain,
    pub(crate) problem: Problem,
    /// What each action of the domain stands for.
    pub(crate) actions: BTreeMap<Name, ProjectedAction>,
}

/// What an action of a projection stands for.
#[derive(Clone, Debug)]
pub(crate) struct ProjectedAction {
    /// Index of the action schema in the agent's own domain.
    pub(crate) schema: usize,
    /// Indices of the parameters that the projection has.
    pub(crate) parameters: Vec<usize>,
}

/// Makes a projection.
pub(crate) struct Projector<'t> {
    pub(crate) task: &'t AgentFiles,
    pub(crate) symbols: &'t PrivateSymbols,
    pub(crate) names: &'t OpaqueNames,
    /// The private symbols that the projection keeps.
    pub(crate) kept: &'t BTreeSet<PrivateSymbol>,
}

// === impl Projector ===

impl Projector<'_> {
    pub(crate) fn project(&self) -> ProjectedTask {
        let Domain { name, requirements, types, constants, functions, .. } = &self.task.domain;
        let mut projected = BTreeMap::new();
        let mut actions = Vec::new();
        for (index, action) in self.task.domain.actions.iter().enumerate() {
            if let Some((action, stands_for)) = self.action(index, action) {
                projected.insert(action.name.clone(), stands_for);
                actions.push(action);
            }
        }
        let (problem, used) = self.problem(&actions);
        let is_wanted = |it: &&Name| !it.as_str().ends_with("-privacy");
        let functions = functions.iter().filter_map(|declared| {
            let (name, privacy) = (self.names.function(&declared.name), Privacy::Public);
            let is_shown = declared.privacy == Privacy::Public || used.contains(&name);
            let parameters = numbered_parameters(&declared.parameters);
            is_shown.then_some(pddl::FunctionDeclaration { name, parameters, privacy })
        });
        let domain = Domain {
            requirements: requirements.iter().filter(is_wanted).cloned().collect(),
            types: types.clone(),
            constants: constants.clone(),
            predicates: self.predicates(),
            functions: functions.collect(),
            actions,
            ..Domain::named(name.clone())
        };
        ProjectedTask { domain, problem, actions: projected }
    }

    /// Returns the declarations of the public predicates, and of the private ones that are kept.
    fn predicates(&self) -> Vec<PredicateDeclaration> {
        let declared = &self.task.domain.predicates;
        let public = declared.iter().filter(|it| it.privacy == Privacy::Public);
        let public = public.map(|it| PredicateDeclaration {
            parameters: numbered_parameters(&it.parameters),
            ..it.clone()
        });
        let kept = self.names.predicates().filter(|(symbol, _)| self.kept.contains(symbol));
        let kept = kept.filter_map(|(symbol, name)| {
            let known = declared.iter().find(|it| it.name == symbol.predicate)?;
            let (name, parameters) = (name.clone(), numbered_parameters(&known.parameters));
            Some(PredicateDeclaration { name, parameters, privacy: Privacy::Public })
        });
        public.chain(kept).collect()
    }

    /// Returns the problem with the actions of the projected domain, and the functions that the
    /// projection needs.
    fn problem(&self, actions: &[ActionSchema]) -> (Problem, BTreeSet<Name>) {
        let Problem { name, domain, init, goal, metric, objects, .. } = &self.task.problem;
        let goal = self.relax(goal, true, &Scope::new());
        let metric = metric.clone().map(|metric| pddl::Metric {
            expression: self.expression(&metric.expression),
            ..metric
        });
        let mut used = UsedTerms::default();
        let mut types: Vec<TypeExpr> = Vec::new();
        for action in actions {
            used.condition(&action.precondition);
            used.effect(&action.effect);
            types.extend(action.parameters.iter().map(|typed| typed.ty.clone()));
        }
        used.condition(&goal);
        metric.iter().for_each(|metric| used.expression(&metric.expression));
        // The values of public functions are known to all.
        let is_public = |function: &Name| {
            let functions = &self.task.domain.functions;
            functions.iter().any(|it| it.name == *function && it.privacy == Privacy::Public)
        };
        let is_used = |element: &InitElement| match element {
            InitElement::Assign(fluent, _) => {
                used.functions.contains(&fluent.function) || is_public(&fluent.function)
            }
            _ => true,
        };
        let init: Vec<InitElement> =
            init.iter().filter_map(|element| self.element(element)).filter(is_used).collect();
        types.extend(used.declared.iter().map(|typed| typed.ty.clone()));
        let UsedTerms { objects: mut named, functions, .. } = used;
        for element in &init {
            let arguments = match element {
                InitElement::Assign(fluent, _) => Some(&fluent.arguments),
                other => atom_of(other).map(|atom| &atom.arguments),
            };
            named.extend(arguments.into_iter().flatten().map(|term| term.name().clone()));
        }
        // A private object is declared if a variable can stand for it, or if it is named.
        let is_shown = |declared: &&ObjectDeclaration| {
            let object = &declared.object;
            !self.symbols.is_private_object(&object.name)
                || named.contains(&self.names.object(&object.name))
                || types.iter().any(|ty| self.symbols.accepts(ty, object))
        };
        let object = |declared: &ObjectDeclaration| {
            let ObjectDeclaration { object, .. } = declared;
            let object = Typed { name: self.names.object(&object.name), ty: object.ty.clone() };
            ObjectDeclaration { object, privacy: Privacy::Public }
        };
        let problem = Problem {
            objects: Arc::new(objects.iter().filter(is_shown).map(object).collect()),
            init,
            goal,
            metric,
            ..Problem::named(name.clone(), domain.clone())
        };
        (problem, functions)
    }

    /// Returns an action as others see it; `None` if they see no effect of it.
    fn action(
        &self,
        index: usize,
        action: &ActionSchema,
    ) -> Option<(ActionSchema, ProjectedAction)> {
        let scope = scope_of(action);
        let observed =
            action.observe.iter().filter(|it| self.symbols.is_public_observation(it, &scope));
        let observe: Vec<Atom> = observed.filter_map(|it| self.atom(it, &scope)).collect();
        let effect = self.effect(&action.effect, &scope).unwrap_or(Effect::And(Vec::new()));
        if !changes_a_fact(&effect) && observe.is_empty() {
            return None;
        }
        let precondition = self.relax(&action.precondition, true, &scope);
        let mut used = UsedTerms::default();
        used.condition(&precondition);
        used.effect(&effect);
        observe.iter().for_each(|atom| used.terms(&atom.arguments));
        let all: Vec<Typed> = self.typed(&action.all_parameters().cloned().collect::<Vec<_>>());
        let agents = usize::from(self.names.keep_agents() && action.agent.is_some());
        let is_kept = |place: &usize| *place < agents || used.variables.contains(&all[*place].name);
        let parameters: Vec<usize> = (0..all.len()).filter(is_kept).collect();
        let (_, is_public) = self.symbols.changed_by(action);
        let mut kept = parameters.iter().map(|place| all[*place].clone());
        let projected = ActionSchema {
            name: self.names.action(&action.name, is_public),
            agent: kept.by_ref().take(agents).next(),
            partners: Vec::new(),
            parameters: kept.collect(),
            precondition,
            effect,
            observe,
            span: action.span,
        };
        Some((projected, ProjectedAction { schema: index, parameters }))
    }

    /// Returns a condition without the private symbols that are dropped: in a positive context they
    /// count as true, in a negative one as false, so that the condition becomes easier to meet.
    fn relax(&self, condition: &Condition, is_positive: bool, scope: &Scope) -> Condition {
        let all = |parts: &[Condition]| -> Vec<Condition> {
            parts.iter().map(|part| self.relax(part, is_positive, scope)).collect()
        };
        match condition {
            Condition::Atom(atom) => match self.atom(atom, scope) {
                Some(atom) => Condition::Atom(atom),
                None if is_positive => Condition::always(),
                None => never(),
            },
            Condition::Equal(left, right, span) => {
                Condition::Equal(self.term(left), self.term(right), *span)
            }
            Condition::Compare(compare) => Condition::Compare(Box::new(Compare {
                left: self.expression(&compare.left),
                right: self.expression(&compare.right),
                ..Compare::clone(compare)
            })),
            Condition::Not(inner) => negation(self.relax(inner, !is_positive, scope)),
            Condition::And(parts) => conjunction(all(parts)),
            Condition::Or(parts) => disjunction(all(parts)),
            Condition::Imply(left, right) => disjunction(vec![
                negation(self.relax(left, !is_positive, scope)),
                self.relax(right, is_positive, scope),
            ]),
            Condition::Exists(variables, inner) => {
                let inner = self.relax(inner, is_positive, &with(scope, variables));
                match is_constant(&inner) {
                    true => inner,
                    false => Condition::Exists(self.typed(variables), Box::new(inner)),
                }
            }
            Condition::Forall(variables, inner) => {
                let inner = self.relax(inner, is_positive, &with(scope, variables));
                match is_constant(&inner) {
                    true => inner,
                    false => Condition::Forall(self.typed(variables), Box::new(inner)),
                }
            }
        }
    }

    /// Returns an effect without changes of dropped symbols; `None` if nothing is left.
    fn effect(&self, effect: &Effect, scope: &Scope) -> Option<Effect> {
        Some(match effect {
            Effect::And(parts) => {
                let parts: Vec<_> =
                    parts.iter().filter_map(|part| self.effect(part, scope)).collect();
                match parts.is_empty() {
                    true => return None,
                    false => Effect::And(parts),
                }
            }
            Effect::Add(atom) => Effect::Add(self.atom(atom, scope)?),
            Effect::Delete(atom) => Effect::Delete(self.atom(atom, scope)?),
            Effect::Assign(assign) => Effect::Assign(Box::new(Assign {
                fluent: self.fluent(&assign.fluent),
                value: self.expression(&assign.value),
                ..Assign::clone(assign)
            })),
            Effect::Forall(variables, inner) => {
                let inner = self.effect(inner, &with(scope, variables))?;
                Effect::Forall(self.typed(variables), Box::new(inner))
            }
            Effect::When(condition, inner) => {
                // What conditions of effects require is always kept: easier conditions would not
                // make the effect one that always happens.
                let condition = self.relax(condition, true, scope);
                Effect::When(Box::new(condition), Box::new(self.effect(inner, scope)?))
            }
        })
    }

    /// Returns an element of a state with opaque names; `None` if its symbol is dropped.
    pub(crate) fn element(&self, element: &InitElement) -> Option<InitElement> {
        let none = Scope::new();
        Some(match element {
            InitElement::Atom(atom) => InitElement::Atom(self.atom(atom, &none)?),
            InitElement::Not(atom) => InitElement::Not(self.atom(atom, &none)?),
            InitElement::Unknown(atom) => InitElement::Unknown(self.atom(atom, &none)?),
            InitElement::Assign(fluent, value) => InitElement::Assign(self.fluent(fluent), *value),
            InitElement::At(time, inner) => InitElement::At(*time, Box::new(self.element(inner)?)),
        })
    }

    /// Returns an atom with opaque names; `None` if its symbol is dropped.
    fn atom(&self, atom: &Atom, scope: &Scope) -> Option<Atom> {
        let predicate = match self.symbols.symbol(atom, scope) {
            Some(symbol) if !self.kept.contains(&symbol) => return None,
            Some(symbol) => self.names.predicate(&symbol),
            None => atom.predicate.clone(),
        };
        let arguments = atom.arguments.iter().map(|term| self.term(term)).collect();
        Some(Atom { predicate, arguments, span: atom.span })
    }

    fn term(&self, term: &Term) -> Term {
        match term {
            Term::Object(name) => Term::Object(self.names.object(name)),
            Term::Variable(name) => Term::Variable(self.names.variable(name)),
        }
    }

    /// Returns variables with opaque names.
    fn typed(&self, variables: &[Typed]) -> Vec<Typed> {
        let renamed = |variable: &Typed| Typed {
            name: self.names.variable(&variable.name),
            ty: variable.ty.clone(),
        };
        variables.iter().map(renamed).collect()
    }

    fn fluent(&self, fluent: &FluentTerm) -> FluentTerm {
        let arguments = fluent.arguments.iter().map(|term| self.term(term)).collect();
        FluentTerm { function: self.names.function(&fluent.function), arguments, span: fluent.span }
    }

    fn expression(&self, expression: &Expression) -> Expression {
        expression.map_fluents(&mut |fluent| self.fluent(fluent))
    }
}

/// Returns parameters with numbers instead of names.
fn numbered_parameters(parameters: &[Typed]) -> Vec<Typed> {
    let numbered = |(number, typed): (usize, &Typed)| Typed {
        name: Name::new(&format!("x{number}")),
        ty: typed.ty.clone(),
    };
    parameters.iter().enumerate().map(numbered).collect()
}

fn with(scope: &Scope, variables: &[Typed]) -> Scope {
    let inner = variables.iter().map(|typed| (typed.name.clone(), typed.ty.clone()));
    scope.clone().into_iter().chain(inner).collect()
}

// === constants in conditions ===

/// Returns the condition that never holds.
fn never() -> Condition {
    Condition::Or(Vec::new())
}

fn is_never(condition: &Condition) -> bool {
    matches!(condition, Condition::Or(parts) if parts.is_empty())
}

fn is_constant(condition: &Condition) -> bool {
    condition.is_always() || is_never(condition)
}

fn negation(inner: Condition) -> Condition {
    match inner {
        inner if inner.is_always() => never(),
        inner if is_never(&inner) => Condition::always(),
        inner => Condition::Not(Box::new(inner)),
    }
}

fn conjunction(mut parts: Vec<Condition>) -> Condition {
    parts.retain(|part| !part.is_always());
    match parts.iter().any(is_never) {
        true => never(),
        false => Condition::And(parts),
    }
}

fn disjunction(mut parts: Vec<Condition>) -> Condition {
    parts.retain(|part| !is_never(part));
    match parts.iter().any(Condition::is_always) {
        true => Condition::always(),
        false => Condition::Or(parts),
    }
}

/// Whether an effect changes more than the cost of a plan.
fn changes_a_fact(effect: &Effect) -> bool {
    effect.parts().any(|part| match part {
        Effect::Add(_) | Effect::Delete(_) => true,
        Effect::Assign(assign) => assign.fluent.function != TOTAL_COST,
        Effect::And(_) | Effect::Forall(..) | Effect::When(..) => false,
    })
}
