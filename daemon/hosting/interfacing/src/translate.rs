//! Translates the symbols of an agent to those of another ecosystem, one by one, by the vocabulary
//! of an interface.
//!
//! - Symbols that are not in the vocabulary are left out. Private symbols are left out even if the
//!   vocabulary contains them. No text is passed on: the output consists of names of the vocabulary
//!   and of renumbered variables.
//! - The *preconditions* of an action must be translated completely, or the action is not offered
//!   ([`Untranslatable`]): otherwise plans would contain steps that cannot be done. The only
//!   exception is a condition over private symbols alone. The agent checks it when it is requested
//!   to act (MA-PDDL's public projection).
//! - *Effects* may be left out, because the other ecosystem cannot observe what is not exported.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use acl::AgentId;
use pddl::{
    ActionModel, Assign, Assignment, Atom, Compare, Condition, Domain, Effect, Expression,
    FluentTerm, InitElement, Name, PlanStep, Privacy, Problem, TOTAL_COST, Term, TypeExpr, Typed,
    Types,
};

use super::vocabulary::{AgentMapping, InterfaceVocabulary};

/// Part of an action that cannot be translated into the names of the other ecosystem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Untranslatable {
    /// A symbol that is not in the vocabulary: the kind of the symbol, and its name.
    Unexported(&'static str, Name),
    /// A private symbol in a condition that also contains public symbols, so that the agent cannot
    /// check the condition alone.
    Private(Name),
    /// A predicate that axioms derive; axioms are not exported.
    Derived(Name),
    /// A construct that depends on all objects of an ecosystem, or on time.
    Construct(&'static str),
}

/// Translates symbols of the far side (where an agent runs) to those of the near side (where it is
/// represented).
pub struct Translator<'t> {
    vocabulary: &'t InterfaceVocabulary,
    /// Names of the agent and of its proxy agent; `None` if the translator is for facts and goals
    /// instead of a model.
    agent_and_proxy: Option<(&'t AgentId, &'t AgentId)>,
    types: Types,
    private: BTreeSet<Name>,
    derived: BTreeSet<Name>,
    /// Variables of the action or declaration that is being translated, in the order of their first
    /// use.
    variables: RefCell<Vec<Name>>,
}

type Translation<T> = Result<T, Untranslatable>;

// === impl Translator ===

impl<'t> Translator<'t> {
    /// Returns a translator for the model of an agent that is based on the far ontology.
    pub fn of_model(
        vocabulary: &'t InterfaceVocabulary,
        mapping: &'t AgentMapping,
        (ontology, map): (&Domain, &Problem),
        model: &ActionModel,
    ) -> Translator<'t> {
        let mut translator = Translator::of_ontology(vocabulary, (ontology, map));
        translator.agent_and_proxy = Some((&mapping.agent, &mapping.proxy));
        translator.types = Types::new(ontology.types.iter().chain(&model.types));
        let of_model = model.predicates.iter().map(|declared| (&declared.name, &declared.privacy));
        let functions = model.functions.iter().map(|declared| (&declared.name, &declared.privacy));
        let objects =
            model.objects.iter().map(|declared| (&declared.object.name, &declared.privacy));
        translator.add_private(of_model.chain(functions).chain(objects));
        translator.derived.extend(model.derived.iter().map(|axiom| axiom.predicate.clone()));
        translator
    }

    /// Returns a translator for facts and goals over an ontology and a map, without an agent's
    /// model.
    pub fn of_ontology(
        vocabulary: &'t InterfaceVocabulary,
        (ontology, map): (&Domain, &Problem),
    ) -> Translator<'t> {
        let derived = ontology.derived.iter().map(|axiom| axiom.predicate.clone()).collect();
        let (types, private) = (Types::of(ontology), BTreeSet::new());
        let variables = RefCell::default();
        let mut translator =
            Translator { vocabulary, agent_and_proxy: None, types, private, derived, variables };
        let predicates = ontology.predicates.iter().map(|it| (&it.name, &it.privacy));
        let functions = ontology.functions.iter().map(|it| (&it.name, &it.privacy));
        let objects = map.objects.iter().map(|it| (&it.object.name, &it.privacy));
        translator.add_private(predicates.chain(functions).chain(objects));
        translator
    }

    fn add_private<'n>(&mut self, declared: impl Iterator<Item = (&'n Name, &'n Privacy)>) {
        let private = declared.filter(|(_, privacy)| matches!(privacy, Privacy::Private(_)));
        self.private.extend(private.map(|(name, _)| name.clone()));
    }

    /// Whether a symbol is private to the agent or to its ecosystem.
    pub fn is_private(&self, name: &str) -> bool {
        self.private.contains(name)
    }

    // === symbols ===

    pub(crate) fn predicate(&self, name: &Name) -> Translation<Name> {
        if self.derived.contains(name) {
            return Err(Untranslatable::Derived(name.clone()));
        }
        self.symbol("predicate", &self.vocabulary.predicates, name)
    }

    fn function(&self, name: &Name) -> Translation<Name> {
        self.symbol("function", &self.vocabulary.functions, name)
    }

    fn symbol(
        &self,
        sort: &'static str,
        table: &BTreeMap<String, Name>,
        name: &Name,
    ) -> Translation<Name> {
        if self.private.contains(name) {
            return Err(Untranslatable::Private(name.clone()));
        }
        let found = table.get(name.as_str()).cloned();
        found.ok_or_else(|| Untranslatable::Unexported(sort, name.clone()))
    }

    pub(crate) fn object(&self, name: &Name) -> Translation<Name> {
        match self.agent_and_proxy {
            Some((agent, proxy_model)) if *name == agent.as_str() => {
                Ok(Name::new(proxy_model.as_str()))
            }
            _ => self.symbol("object", &self.vocabulary.objects, name),
        }
    }

    /// Prepares for the translation of another action or declaration: variables are numbered from 1
    /// again.
    pub(crate) fn reset_variables(&self) {
        self.variables.borrow_mut().clear();
    }

    /// Returns the numbered name that replaces the name of a variable. The agent's own names of
    /// variables are not passed on. Equal names get equal numbers and different names get different
    /// numbers, so each variable still refers to the same parameter.
    pub(crate) fn variable(&self, name: &Name) -> Name {
        let mut variables = self.variables.borrow_mut();
        let known = variables.iter().position(|known| known == name);
        let index = known.unwrap_or_else(|| {
            variables.push(name.clone());
            variables.len() - 1
        });
        Name::new(&format!("x{}", index + 1))
    }

    pub(crate) fn term(&self, term: &Term) -> Translation<Term> {
        match term {
            Term::Variable(name) => Ok(Term::Variable(self.variable(name))),
            Term::Object(name) => self.object(name).map(Term::Object),
        }
    }

    fn terms(&self, terms: &[Term]) -> Translation<Vec<Term>> {
        terms.iter().map(|term| self.term(term)).collect()
    }

    /// Translates a type to exactly its counterpart; a wider type would admit objects that the
    /// agent does not accept.
    pub(crate) fn exact_type(&self, ty: &TypeExpr) -> Translation<TypeExpr> {
        if ty.is_object() {
            return Ok(TypeExpr::default());
        }
        let known = |name: &Name| {
            let near = self.vocabulary.types.get(name.as_str()).cloned();
            near.ok_or_else(|| Untranslatable::Unexported("type", name.clone()))
        };
        let alternatives = ty.alternatives.iter().map(known).collect::<Translation<_>>()?;
        Ok(TypeExpr { alternatives })
    }

    /// Returns the narrowest exported type that contains all objects of the type `ty`; `None` if
    /// there is none.
    pub(crate) fn nearest_type(&self, ty: &TypeExpr) -> Option<TypeExpr> {
        let [name] = &ty.alternatives[..] else { return None };
        match self.vocabulary.types.get(name.as_str()) {
            Some(near) => Some(TypeExpr::of(near.clone())),
            None => self.nearest_supertype(name.as_str()),
        }
    }

    /// Returns the narrowest exported supertype of the type `name`, in the names of the near side;
    /// `None` if there is none.
    pub(crate) fn nearest_supertype(&self, name: &str) -> Option<TypeExpr> {
        // The nearest supertype comes first.
        let mut above = self.types.supertypes(name);
        above.find_map(|ty| self.vocabulary.types.get(ty.as_str())).cloned().map(TypeExpr::of)
    }

    pub(crate) fn typed(&self, typed: &[Typed]) -> Translation<Vec<Typed>> {
        let one = |typed: &Typed| {
            Ok(Typed { name: self.variable(&typed.name), ty: self.exact_type(&typed.ty)? })
        };
        typed.iter().map(one).collect()
    }

    fn atom(&self, atom: &Atom) -> Translation<Atom> {
        let predicate = self.predicate(&atom.predicate)?;
        Ok(Atom { predicate, arguments: self.terms(&atom.arguments)?, span: atom.span })
    }

    /// Translates an observed term of an action, which is a predicate or a function with arguments.
    pub(crate) fn observed(&self, observed: &Atom) -> Translation<Atom> {
        let named = self.predicate(&observed.predicate);
        let predicate = named.or_else(|_| self.function(&observed.predicate))?;
        Ok(Atom { predicate, arguments: self.terms(&observed.arguments)?, span: observed.span })
    }

    fn fluent(&self, fluent: &FluentTerm) -> Translation<FluentTerm> {
        let function = self.function(&fluent.function)?;
        Ok(FluentTerm { function, arguments: self.terms(&fluent.arguments)?, span: fluent.span })
    }

    pub(crate) fn expression(&self, expression: &Expression) -> Translation<Expression> {
        Ok(match expression {
            Expression::Number(number) => Expression::Number(*number),
            Expression::Fluent(fluent) => Expression::Fluent(self.fluent(fluent)?),
            Expression::Negate(inner) => Expression::Negate(Box::new(self.expression(inner)?)),
            Expression::Apply(operator, operands) => {
                let operands = operands.iter().map(|operand| self.expression(operand));
                Expression::Apply(*operator, operands.collect::<Translation<_>>()?)
            }
            Expression::Duration(_) | Expression::ContinuousTime(_) | Expression::TotalTime(_) => {
                return Err(Untranslatable::Construct("time"));
            }
        })
    }

    /// Translates a fact; `None` if a part of it is not exported.
    pub(crate) fn fact(&self, fact: &InitElement) -> Option<InitElement> {
        match fact {
            InitElement::Atom(atom) => self.atom(atom).ok().map(InitElement::Atom),
            InitElement::Not(atom) => self.atom(atom).ok().map(InitElement::Not),
            InitElement::Unknown(atom) => self.atom(atom).ok().map(InitElement::Unknown),
            InitElement::Assign(fluent, number) => {
                Some(InitElement::Assign(self.fluent(fluent).ok()?, *number))
            }
            InitElement::At(..) => None,
        }
    }

    // === conditions ===

    /// Translates a precondition conjunct by conjunct. Conjuncts over private symbols alone are
    /// left out.
    pub(crate) fn precondition(&self, condition: &Condition) -> Translation<Condition> {
        let mut kept = Vec::new();
        for conjunct in conjuncts(condition) {
            match self.condition(conjunct, true) {
                Ok(said) => kept.push(said),
                Err(_) if self.is_all_private(conjunct) => (),
                Err(lost) => return Err(lost),
            }
        }
        Ok(Condition::And(kept))
    }

    /// Translates a condition completely. `holds` is `true` outside a negation and `false` under
    /// one. `exists` can be translated only outside a negation, and `forall` only under one.
    pub(crate) fn condition(&self, condition: &Condition, holds: bool) -> Translation<Condition> {
        let all = |parts: &[Condition]| -> Translation<Vec<Condition>> {
            parts.iter().map(|part| self.condition(part, holds)).collect()
        };
        Ok(match condition {
            Condition::Atom(atom) => Condition::Atom(self.atom(atom)?),
            Condition::Equal(left, right, span) => {
                Condition::Equal(self.term(left)?, self.term(right)?, *span)
            }
            Condition::Compare(compare) => {
                let Compare { comparison, left, right, span } = &**compare;
                let (left, right) = (self.expression(left)?, self.expression(right)?);
                Condition::Compare(Box::new(Compare {
                    comparison: *comparison,
                    left,
                    right,
                    span: *span,
                }))
            }
            Condition::Not(inner) => Condition::Not(Box::new(self.condition(inner, !holds)?)),
            Condition::And(parts) => Condition::And(all(parts)?),
            Condition::Or(parts) => Condition::Or(all(parts)?),
            Condition::Imply(left, right) => {
                let left = self.condition(left, !holds)?;
                Condition::Imply(Box::new(left), Box::new(self.condition(right, holds)?))
            }
            // If the condition holds for some exported object, it holds for some object.
            Condition::Exists(variables, inner) if holds => {
                Condition::Exists(self.typed(variables)?, Box::new(self.condition(inner, holds)?))
            }
            Condition::Forall(variables, inner) if !holds => {
                Condition::Forall(self.typed(variables)?, Box::new(self.condition(inner, holds)?))
            }
            // If the condition holds for all exported objects, it need not hold for all objects.
            Condition::Exists(..) | Condition::Forall(..) => {
                return Err(Untranslatable::Construct("forall"));
            }
        })
    }

    /// Whether a condition contains private symbols and no other symbols.
    fn is_all_private(&self, condition: &Condition) -> bool {
        let mut symbols = condition.symbols().peekable();
        symbols.peek().is_some() && symbols.all(|name| self.private.contains(name))
    }

    // === effects ===

    /// Translates the exported part of an effect; `None` if no part is exported.
    pub(crate) fn effect(&self, effect: &Effect) -> Translation<Option<Effect>> {
        Ok(match effect {
            Effect::And(parts) => {
                let parts =
                    parts.iter().map(|part| self.effect(part)).collect::<Translation<Vec<_>>>()?;
                let seen: Vec<_> = parts.into_iter().flatten().collect();
                (!seen.is_empty()).then_some(Effect::And(seen))
            }
            Effect::Add(atom) => self.atom(atom).ok().map(Effect::Add),
            Effect::Delete(atom) => self.atom(atom).ok().map(Effect::Delete),
            Effect::Assign(assign) => self.assign(assign)?,
            Effect::Forall(variables, inner) => match self.effect(inner)? {
                Some(inner) => Some(Effect::Forall(self.typed(variables)?, Box::new(inner))),
                None => None,
            },
            Effect::When(condition, inner) => match self.effect(inner)? {
                Some(inner) => {
                    // The condition must be equivalent on both sides. It is translated both as
                    // under a negation and as outside one, so that any quantifier is an error.
                    self.condition(condition, false)?;
                    let condition = self.condition(condition, true)?;
                    Some(Effect::When(Box::new(condition), Box::new(inner)))
                }
                None => None,
            },
        })
    }

    /// Translates a numeric effect. Returns `None` if the function is not exported, or if the
    /// effect is on the cost of plans, which [`Translator::cost`] handles.
    fn assign(&self, assign: &Assign) -> Translation<Option<Effect>> {
        let Assign { assignment, fluent, value, span } = assign;
        if fluent.function == TOTAL_COST {
            return Ok(None);
        }
        let Ok(fluent) = self.fluent(fluent) else { return Ok(None) };
        let value = self.expression(value)?;
        let assign = Assign { assignment: *assignment, fluent, value, span: *span };
        Ok(Some(Effect::Assign(Box::new(assign))))
    }

    /// Returns the translated cost that an action adds to a plan; `None` if the action declares no
    /// cost.
    pub(crate) fn cost(&self, effect: &Effect) -> Translation<Option<Expression>> {
        match effect {
            Effect::And(parts) => {
                for part in parts {
                    if let Some(cost) = self.cost(part)? {
                        return Ok(Some(cost));
                    }
                }
                Ok(None)
            }
            Effect::Assign(assign)
                if assign.fluent.function == TOTAL_COST
                    && assign.assignment == Assignment::Increase =>
            {
                self.expression(&assign.value).map(Some)
            }
            _ => Ok(None),
        }
    }
}

/// Translates a ground action: the names of the agent, of the action and of the objects. Returns an
/// error, as text for a person, if one of these names is not exported.
pub(crate) fn step(
    step: &PlanStep,
    actions: &BTreeMap<String, Name>,
    who: (&AgentId, &AgentId),
    vocabulary: &InterfaceVocabulary,
) -> Result<PlanStep, String> {
    let action = actions.get(step.action.as_str());
    let action = action.ok_or_else(|| format!("`{}` is not exported", step.action))?;
    let (from, to) = who;
    let object = |name: &Name| {
        if *name == from.as_str() {
            return Ok(Name::new(to.as_str()));
        }
        let known = vocabulary.objects.get(name.as_str()).cloned();
        known.ok_or_else(|| format!("`{name}` is not exported"))
    };
    let arguments = step.arguments.iter().map(object).collect::<Result<Vec<_>, _>>()?;
    Ok(PlanStep::new(action.clone(), arguments))
}

fn conjuncts(condition: &Condition) -> Vec<&Condition> {
    match condition {
        Condition::And(parts) => parts.iter().flat_map(conjuncts).collect(),
        other => vec![other],
    }
}

impl fmt::Display for Untranslatable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Untranslatable::Unexported(sort, name) => {
                write!(f, "the {sort} `{name}`, which is not exported")
            }
            Untranslatable::Private(name) => write!(f, "`{name}`, which is private"),
            Untranslatable::Derived(name) => {
                write!(f, "`{name}`, which follows by axioms that are not exported")
            }
            Untranslatable::Construct("forall") => {
                write!(f, "a condition on all objects, and not all are exported")
            }
            Untranslatable::Construct(what) => {
                write!(f, "`{what}`, which has no meaning over there")
            }
        }
    }
}
