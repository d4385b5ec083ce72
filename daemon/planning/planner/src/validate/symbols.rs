//! Numbers for the names of objects, predicates and functions, so that evaluation compares numbers
//! instead of strings.

use std::sync::Arc;

use pddl::{Name, TypeExpr, Typed, Types};
use rustc_hash::FxHashMap;

/// Number of an object, in the order of first occurrence in the texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Object(u32);

/// Number of the first undeclared object of a condition. It is greater than the number of any
/// object that a text of 4 GiB can name.
const STRANGERS: u32 = 1 << 31;

/// Objects named in the texts. The declared ones have the smallest numbers.
#[derive(Debug, Default)]
pub(super) struct Objects {
    names: Vec<Name>,
    by_name: FxHashMap<Name, Object>,
    /// For each declared object: the position of its type in `types`.
    typed: Vec<usize>,
    /// Further types of the objects that are declared several times with different types.
    typed_again: FxHashMap<Object, Vec<usize>>,
    types: Vec<TypeExpr>,
    types_by_expr: FxHashMap<TypeExpr, usize>,
}

/// The set of all objects of a type, in the order of the texts.
#[derive(Debug)]
pub(super) enum Extension {
    /// All declared objects; the type is `object`. The value is the number of objects.
    Everything(u32),
    /// The listed objects, in ascending order.
    Listed(Vec<Object>),
}

/// Number of a predicate or function with a fixed number of arguments. Unchecked texts may use one
/// name with several numbers of arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct RelationId(u32);

/// Table of all predicates, or of all functions, that the texts name.
#[derive(Debug, Default)]
pub(super) struct RelationTable {
    entries: Vec<(Name, usize)>,
    by_name: FxHashMap<Name, Vec<RelationId>>,
}

// === impl Object ===

impl Object {
    /// Marks an unbound variable.
    pub(super) const UNBOUND: Object = Object(u32::MAX);

    /// Returns the number of an object that a condition names but the texts do not contain. No fact
    /// holds for such an object, and it is equal only to itself.
    pub(super) fn stranger(index: usize) -> Object {
        Object(STRANGERS + index as u32)
    }

    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl Objects ===

impl Objects {
    /// Adds an object with its type. An object that is declared several times belongs to all its
    /// types.
    ///
    /// # Panics
    ///
    /// Panics if [`Objects::insert`] has already added an undeclared object.
    pub(super) fn declare(&mut self, object: &Typed) {
        assert_eq!(self.names.len(), self.typed.len(), "declared objects come first");
        let known = self.by_name.get(&object.name).copied();
        let ty = match self.types_by_expr.get(&object.ty) {
            Some(ty) => *ty,
            None => {
                self.types.push(object.ty.clone());
                self.types_by_expr.insert(object.ty.clone(), self.types.len() - 1);
                self.types.len() - 1
            }
        };
        if let Some(known) = known {
            self.typed_again.entry(known).or_default().push(ty);
            return;
        }
        self.insert(&object.name);
        self.typed.push(ty);
    }

    /// Returns the number of the object with this name; assigns the next number to a new name.
    pub(super) fn insert(&mut self, name: &Name) -> Object {
        if let Some(object) = self.find(name) {
            return object;
        }
        let object = Object(self.names.len() as u32);
        self.names.push(name.clone());
        self.by_name.insert(name.clone(), object);
        object
    }

    pub(super) fn find(&self, name: &Name) -> Option<Object> {
        self.by_name.get(name).copied()
    }

    /// Returns the number of a declared object; `None` if no object of this name is declared.
    pub(super) fn declared(&self, name: &Name) -> Option<Object> {
        self.find(name).filter(|object| object.index() < self.typed.len())
    }

    /// Returns the name of an object; `None` for an object that the texts do not contain, and for
    /// [`Object::UNBOUND`].
    pub(super) fn name(&self, object: Object) -> Option<&Name> {
        self.names.get(object.index())
    }

    /// Returns all declared objects of a type.
    pub(super) fn extension(&self, ty: &TypeExpr, types: &Types) -> Arc<Extension> {
        if ty.is_object() {
            return Arc::new(Extension::Everything(self.typed.len() as u32));
        }
        let accepted: Vec<bool> = self.types.iter().map(|own| types.holds(ty, own)).collect();
        let numbers = (0..).map(Object).zip(&self.typed);
        let again = |object: &Object| {
            let more = self.typed_again.get(object);
            more.is_some_and(|more| more.iter().any(|own| accepted[*own]))
        };
        let fitting = numbers.filter(|(object, own)| accepted[**own] || again(object));
        let fitting = fitting.map(|(object, _)| object);
        Arc::new(Extension::Listed(fitting.collect()))
    }
}

// === impl Extension ===

impl Extension {
    pub(super) fn contains(&self, object: Object) -> bool {
        match self {
            Extension::Everything(count) => object.0 < *count,
            Extension::Listed(list) => list.binary_search(&object).is_ok(),
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Extension::Everything(count) => *count as usize,
            Extension::Listed(list) => list.len(),
        }
    }

    /// Returns the object at a position in the set; `None` if the set is smaller. Positions follow
    /// the order of the texts.
    pub(super) fn get(&self, index: usize) -> Option<Object> {
        match self {
            Extension::Everything(count) => {
                (index < *count as usize).then_some(Object(index as u32))
            }
            Extension::Listed(list) => list.get(index).copied(),
        }
    }

    /// Iterates over the objects of the set, in the order of the texts.
    pub(super) fn iter(&self) -> impl Iterator<Item = Object> + '_ {
        (0..self.len()).filter_map(|index| self.get(index))
    }
}

// === impl RelationId ===

impl RelationId {
    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl RelationTable ===

impl RelationTable {
    /// Returns the number of the predicate or function with this name and number of arguments;
    /// assigns the next number to a new one.
    pub(super) fn insert(&mut self, name: &Name, arity: usize) -> RelationId {
        if let Some(relation) = self.find(name, arity) {
            return relation;
        }
        let relation = RelationId(self.entries.len() as u32);
        self.entries.push((name.clone(), arity));
        self.by_name.entry(name.clone()).or_default().push(relation);
        relation
    }

    pub(super) fn find(&self, name: &Name, arity: usize) -> Option<RelationId> {
        let same_name = self.by_name.get(name)?;
        same_name.iter().copied().find(|relation| self.arity(*relation) == arity)
    }

    pub(super) fn name(&self, relation: RelationId) -> &Name {
        &self.entries[relation.index()].0
    }

    pub(super) fn arity(&self, relation: RelationId) -> usize {
        self.entries[relation.index()].1
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(super) fn arities(&self) -> impl Iterator<Item = usize> {
        self.entries.iter().map(|(_, arity)| *arity)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = RelationId> + use<> {
        (0..self.entries.len() as u32).map(RelationId)
    }
}
