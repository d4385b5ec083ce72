//! The vocabulary of a composite domain: the declared symbols, and checks whether an action schema,
//! a declaration or a fact fits them.
//!
//! Every part of a model is checked here before the composition, so that no agent can make the
//! common domain or problem unreadable for a planner.

use std::collections::BTreeMap;

use pddl::{Name, TypeExpr, Types};

use crate::canonical::UsedSymbols;
use crate::fact::{FactKey, FactSymbolKind, FactValue};

/// The types of the parameters of a predicate or function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Signature {
    pub(crate) parameters: Vec<TypeExpr>,
    /// Whether axioms derive the predicate. No agent may claim or change facts of a derived
    /// predicate.
    pub(crate) derived: bool,
}

/// All symbols that a composite domain declares.
#[derive(Clone, Debug, Default)]
pub(crate) struct DomainVocabulary {
    pub(crate) types: Types,
    pub(crate) predicates: BTreeMap<Name, Signature>,
    pub(crate) functions: BTreeMap<Name, Signature>,
    pub(crate) objects: BTreeMap<Name, TypeExpr>,
}

// === impl DomainVocabulary ===

impl DomainVocabulary {
    /// Whether a predicate or a function has this name.
    pub(crate) fn declares(&self, name: &Name) -> bool {
        self.predicates.contains_key(name) || self.functions.contains_key(name)
    }

    /// Returns the reason why an action schema that uses these symbols cannot be in the domain;
    /// `None` if it can be.
    pub(crate) fn misfit(&self, uses: &UsedSymbols) -> Option<String> {
        let UsedSymbols {
            predicates,
            functions,
            observed,
            types,
            objects,
            changed,
            assigned: _,
            unbound,
        } = uses;
        let symbol = |declared: &BTreeMap<Name, Signature>, what, (name, count): &(Name, usize)| {
            match declared.get(name) {
                None => Some(format!("it uses the {what} `{name}`, which is not declared")),
                Some(signature) if signature.parameters.len() != *count => Some(format!(
                    "it uses the {what} `{name}` with {count} of its {} arguments",
                    signature.parameters.len()
                )),
                Some(_) => None,
            }
        };
        predicates
            .iter()
            .find_map(|use_| symbol(&self.predicates, "predicate", use_))
            .or_else(|| functions.iter().find_map(|use_| symbol(&self.functions, "function", use_)))
            .or_else(|| {
                // To observe an undeclared symbol has no effect, because no goal can mention it.
                observed.iter().find_map(|use_| match () {
                    () if self.functions.contains_key(&use_.0) => {
                        symbol(&self.functions, "function", use_)
                    }
                    () if self.predicates.contains_key(&use_.0) => {
                        symbol(&self.predicates, "predicate", use_)
                    }
                    () => None,
                })
            })
            .or_else(|| {
                let name = types.iter().find(|name| !self.types.contains(name.as_str()))?;
                Some(format!("it uses the type `{name}`, which is not declared"))
            })
            .or_else(|| {
                let name = objects.iter().find(|name| !self.objects.contains_key(*name))?;
                Some(format!("it names the object `{name}`, which is not here"))
            })
            .or_else(|| {
                let name = changed
                    .iter()
                    .find(|name| self.predicates.get(*name).is_some_and(|p| p.derived))?;
                Some(format!("it changes `{name}`, which axioms derive"))
            })
            .or_else(|| {
                let name = unbound.first()?;
                Some(format!("it uses the variable `?{name}`, which nothing binds"))
            })
    }

    /// Returns the reason why a fact with this value cannot be in the problem; `None` if it can be.
    /// A derived fact cannot be claimed, but it can be reported as unknown.
    pub(crate) fn fact_misfit(&self, fact: &FactKey, value: FactValue) -> Option<String> {
        let symbol = fact.symbol();
        let declared = match fact.space() {
            FactSymbolKind::Predicate => self.predicates.get(symbol),
            FactSymbolKind::Function => self.functions.get(symbol),
        };
        let Some(Signature { parameters, derived }) = declared else {
            return Some(format!("`{symbol}` is not declared"));
        };
        if *derived && value != FactValue::Unknown {
            return Some(format!("`{symbol}` is derived by axioms"));
        }
        if parameters.len() != fact.arguments().len() {
            return Some(format!(
                "it has {} of the {} arguments of `{symbol}`",
                fact.arguments().len(),
                parameters.len()
            ));
        }
        parameters.iter().zip(fact.arguments()).find_map(|(wanted, object)| {
            match self.objects.get(object) {
                None => Some(format!("`{object}` is not here")),
                Some(ty) if !self.types.holds(wanted, ty) => {
                    Some(format!("`{object}` is not of the type that `{symbol}` takes"))
                }
                Some(_) => None,
            }
        })
    }
}
