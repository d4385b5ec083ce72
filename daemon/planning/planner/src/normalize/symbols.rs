//! Symbol table: numbers the objects, types, predicates and functions of one domain and problem.

use pddl::{Diagnostic, Domain, Name, Problem, TypeExpr, Typed, Types};
use rustc_hash::FxHashMap;

use super::lifted::{FunctionUse, PredicateUse, TypeIndex, TypeSet};
use super::quantifiers::QuantifierRearrangement;
use crate::task::ObjectId;

/// Symbol table: the numbers of names, and the errors found during their resolution.
#[derive(Clone, Debug, Default)]
pub(crate) struct SymbolTable {
    pub(super) objects: Vec<Name>,
    pub(super) predicates: Vec<PredicateUse>,
    pub(super) functions: Vec<FunctionUse>,
    pub(crate) types: Vec<TypeSet>,
    pub(super) problems: Vec<Diagnostic>,
    object_ids: FxHashMap<Name, ObjectId>,
    object_types: Vec<TypeExpr>,
    /// Additional types of objects with several declared types. An object belongs to all its
    /// declared types.
    more_types: FxHashMap<ObjectId, Vec<TypeExpr>>,
    predicate_ids: FxHashMap<Name, usize>,
    function_ids: FxHashMap<Name, usize>,
    type_ids: FxHashMap<TypeExpr, TypeIndex>,
    hierarchy: Types,
    pub(super) rearranging: QuantifierRearrangement,
}

// === impl SymbolTable ===

impl SymbolTable {
    pub(super) fn new(domain: &Domain, problem: &Problem) -> SymbolTable {
        let mut symbols = SymbolTable {
            objects: Vec::new(),
            predicates: Vec::new(),
            functions: Vec::new(),
            types: Vec::new(),
            problems: Vec::new(),
            object_ids: FxHashMap::default(),
            object_types: Vec::new(),
            more_types: FxHashMap::default(),
            predicate_ids: FxHashMap::default(),
            function_ids: FxHashMap::default(),
            type_ids: FxHashMap::default(),
            hierarchy: Types::of(domain),
            rearranging: QuantifierRearrangement::default(),
        };
        let declared = problem.objects.iter().map(|declaration| &declaration.object);
        for object in domain.constants.iter().chain(declared) {
            symbols.declare_object(object);
        }
        for predicate in &domain.predicates {
            symbols.declare_predicate(&predicate.name, predicate.parameters.len());
        }
        for function in &domain.functions {
            symbols.declare_function(&function.name, function.parameters.len());
        }
        // Some domains do not declare this function; `check` warns about them.
        symbols.declare_function(&Name::new(pddl::TOTAL_COST), 0);
        symbols
    }

    pub(super) fn object(&mut self, name: &Name) -> Option<ObjectId> {
        let found = self.object_ids.get(name).copied();
        if found.is_none() {
            self.report(name, "object");
        }
        found
    }

    /// Returns the object with this name; `None` if there is none, without reporting an error.
    pub(crate) fn known_object(&self, name: &Name) -> Option<ObjectId> {
        self.object_ids.get(name).copied()
    }

    /// Returns the errors that were reported since the last call.
    pub(crate) fn take_problems(&mut self) -> Vec<Diagnostic> {
        std::mem::take(&mut self.problems)
    }

    /// Returns the number of the predicate with this name and number of arguments. If there is
    /// none, reports an error and returns `None`.
    pub(crate) fn predicate(&mut self, name: &Name, arity: usize) -> Option<usize> {
        let found = self.predicate_ids.get(name).copied();
        match found {
            None => self.report(name, "predicate"),
            Some(index) => self.expect_arity(name, self.predicates[index].arity, arity),
        }
        found.filter(|index| self.predicates[*index].arity == arity)
    }

    /// Does the same as [`SymbolTable::predicate`], without reporting an error.
    pub(crate) fn known_predicate(&self, name: &Name, arity: usize) -> Option<usize> {
        let found = self.predicate_ids.get(name).copied();
        found.filter(|index| self.predicates[*index].arity == arity)
    }

    /// Returns the number of the function with this name and number of arguments. If there is none,
    /// reports an error and returns `None`.
    pub(super) fn function(&mut self, name: &Name, arity: usize) -> Option<usize> {
        let found = self.function_ids.get(name).copied();
        match found {
            None => self.report(name, "function"),
            Some(index) => self.expect_arity(name, self.functions[index].arity, arity),
        }
        found.filter(|index| self.functions[*index].arity == arity)
    }

    pub(super) fn has_predicate(&self, name: &Name) -> bool {
        self.predicate_ids.contains_key(name)
    }

    pub(super) fn has_function(&self, name: &Name) -> bool {
        self.function_ids.contains_key(name)
    }

    /// Returns the number of the set of objects of a type expression.
    pub(super) fn type_set(&mut self, ty: &TypeExpr) -> TypeIndex {
        if let Some(&index) = self.type_ids.get(ty) {
            return index;
        }
        // The result is cached per type, because many objects have the same few types.
        let mut accepted = FxHashMap::<&TypeExpr, bool>::default();
        let mut members = Vec::new();
        for (index, own) in self.object_types.iter().enumerate() {
            let object = ObjectId::from_index(index);
            let also = || {
                let more = self.more_types.get(&object);
                more.is_some_and(|more| more.iter().any(|own| self.hierarchy.holds(ty, own)))
            };
            if *accepted.entry(own).or_insert_with(|| self.hierarchy.holds(ty, own)) || also() {
                members.push(object);
            }
        }
        let index = self.types.len();
        self.types.push(TypeSet::new(members, self.objects.len()));
        self.type_ids.insert(ty.clone(), index);
        index
    }

    fn declare_object(&mut self, object: &Typed) {
        if let Some(known) = self.object_ids.get(&object.name) {
            if self.object_types[known.index()] != object.ty {
                self.more_types.entry(*known).or_default().push(object.ty.clone());
            }
            return;
        }
        self.object_ids.insert(object.name.clone(), ObjectId::from_index(self.objects.len()));
        self.objects.push(object.name.clone());
        self.object_types.push(object.ty.clone());
    }

    fn declare_predicate(&mut self, name: &Name, arity: usize) {
        if self.predicate_ids.contains_key(name) {
            return;
        }
        self.predicate_ids.insert(name.clone(), self.predicates.len());
        let name = name.clone();
        self.predicates.push(PredicateUse {
            name,
            arity,
            added: false,
            deleted: false,
            derived: false,
        });
    }

    fn declare_function(&mut self, name: &Name, arity: usize) {
        if self.function_ids.contains_key(name) {
            return;
        }
        self.function_ids.insert(name.clone(), self.functions.len());
        let name = name.clone();
        self.functions.push(FunctionUse { name, arity, changed: false, read: false });
    }

    fn report(&mut self, name: &Name, kind: &str) {
        let message = format!("unknown {kind} `{name}`");
        self.problems.push(Diagnostic::error(name.span(), message));
    }

    fn expect_arity(&mut self, name: &Name, expected: usize, found: usize) {
        if expected != found {
            let expected = pddl::check::count(expected, "argument");
            let message = format!("`{name}` takes {expected}, not {found}");
            self.problems.push(Diagnostic::error(name.span(), message));
        }
    }
}
