//! The names that a text may contain: the objects of an ecosystem, their types, and the types of the
//! parameters of predicates and functions.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{Domain, Name, Problem, TypeExpr, Typed};

/// Maximum number of supertypes that are followed; a circle of types ends there.
const DEPTH_MAX: usize = 64;

/// The names of an ecosystem. Without any objects, every name is read as an object.
#[derive(Clone, Debug, Default)]
pub struct KnownNames {
    /// The types of each object, the most special one first.
    objects: BTreeMap<Name, Vec<Name>>,
    supertypes: BTreeMap<Name, TypeExpr>,
    /// The types of the parameters of each predicate and function.
    parameters: BTreeMap<Name, Vec<TypeExpr>>,
}

// === impl KnownNames ===

impl KnownNames {
    /// Collects the names of a domain and a problem.
    pub fn of(domain: &Domain, problem: &Problem) -> KnownNames {
        let mut names = KnownNames::default();
        names.supertypes.extend(domain.types.iter().map(|ty| (ty.name.clone(), ty.ty.clone())));
        let types = |parameters: &[Typed]| parameters.iter().map(|one| one.ty.clone()).collect();
        for predicate in &domain.predicates {
            names.parameters.insert(predicate.name.clone(), types(&predicate.parameters));
        }
        for function in &domain.functions {
            names.parameters.insert(function.name.clone(), types(&function.parameters));
        }
        let objects = problem.objects.iter().map(|object| &object.object);
        domain.constants.iter().chain(objects).for_each(|object| names.add(object));
        names
    }

    /// Adds an object.
    pub fn add(&mut self, object: &Typed) {
        let types = self.with_supertypes(&object.ty);
        self.objects.insert(object.name.clone(), types);
    }

    fn with_supertypes(&self, ty: &TypeExpr) -> Vec<Name> {
        let mut types: Vec<Name> = ty.alternatives.clone();
        let mut at = 0;
        while at < types.len().min(DEPTH_MAX) {
            if let Some(above) = self.supertypes.get(&types[at]) {
                let new = above.alternatives.iter().filter(|name| !types.contains(name));
                let new: Vec<_> = new.cloned().collect();
                types.extend(new);
            }
            at += 1;
        }
        types
    }

    /// Whether the objects are unknown, so that every name may be one.
    pub(crate) fn is_open(&self) -> bool {
        self.objects.is_empty()
    }

    pub(crate) fn object(&self, text: &str) -> Option<&Name> {
        self.objects.get_key_value(text.to_lowercase().as_str()).map(|(name, _)| name)
    }

    /// Returns the objects that fit the parameter `index` of a predicate or function, and all
    /// objects if its type is unknown.
    pub(crate) fn fitting(&self, symbol: &str, index: usize) -> impl Iterator<Item = &Name> {
        let wanted = self.parameters.get(symbol).and_then(|types| types.get(index));
        let wanted = wanted.filter(|ty| !ty.is_object());
        let fits = move |types: &[Name]| {
            wanted.is_none_or(|ty| ty.alternatives.iter().any(|one| types.contains(one)))
        };
        self.objects.iter().filter(move |(_, types)| fits(types)).map(|(name, _)| name)
    }

    /// Returns the types that the domain declares, except those of agents' models.
    pub(crate) fn types(&self) -> BTreeSet<&Name> {
        self.supertypes.keys().collect()
    }

    /// Whether the ecosystem has a type. Every type is possible if none is known.
    pub(crate) fn has_type(&self, ty: &Name) -> bool {
        self.supertypes.is_empty() || *ty == "object" || self.supertypes.contains_key(ty)
    }

    /// Whether the ecosystem declares a predicate or function.
    pub fn declares(&self, symbol: &str) -> bool {
        self.parameters.contains_key(symbol.to_lowercase().as_str())
    }

    /// Whether the ecosystem has a predicate or function. Everything is possible if none is known.
    pub(crate) fn has_symbol(&self, symbol: &str) -> bool {
        self.parameters.is_empty() || self.parameters.contains_key(symbol)
    }
}
