//! The type hierarchy of a domain.
//!
//! - The hierarchy is built from `:types`. Three parts of Althing use it: `check`, `capability` for
//!   composing domains, and the planner's validator for binding arguments.
//! - `object` is a supertype of every type. A type that occurs only as a supertype is also
//!   declared.
//! - A type with the supertype `(either a b)` is a subtype of both `a` and `b`. Cycles are
//!   tolerated: all types of a cycle are subtypes of each other, and [`Types::cycle`] returns one
//!   of them for a diagnostic.
//! - At most [`SUPERTYPES_MAX`] supertypes of a type are considered, the nearest ones first.

use foldhash::{HashMap, HashSet};

use crate::graph::components;
use crate::tree::{Domain, Name, TypeExpr, Typed};

/// The types of a domain and their subtype relation.
#[derive(Clone, Debug, Default)]
pub struct Types {
    names: Vec<Name>,
    index: HashMap<Name, usize>,
    /// Direct supertypes of each type, in the order of `names`.
    supertypes: Vec<Vec<usize>>,
}

const OBJECT: &str = "object";

/// Maximum number of supertypes of one type that are considered, the nearest ones first; a type
/// with more is reported as an error. Buildings need less than a tenth of this number. With the
/// limit, every query about a type takes bounded time.
pub const SUPERTYPES_MAX: usize = 256;

// === impl Types ===

impl Types {
    /// Builds the hierarchy that a domain declares.
    pub fn of(domain: &Domain) -> Types {
        Types::new(&domain.types)
    }

    /// Builds the hierarchy from `declarations`. Declarations of several texts may be chained.
    pub fn new<'a>(declarations: impl IntoIterator<Item = &'a Typed>) -> Types {
        let mut types = Types::default();
        for declaration in declarations {
            let name = types.insert(&declaration.name);
            for supertype in &declaration.ty.alternatives {
                let supertype = types.insert(supertype);
                if !types.supertypes[name].contains(&supertype) {
                    types.supertypes[name].push(supertype);
                }
            }
        }
        types
    }

    fn insert(&mut self, name: &Name) -> usize {
        if let Some(index) = self.index.get(name) {
            return *index;
        }
        let index = self.names.len();
        self.names.push(name.clone());
        self.supertypes.push(Vec::new());
        self.index.insert(name.clone(), index);
        index
    }

    /// Whether a type with this name exists; `object` always does.
    pub fn contains(&self, name: &str) -> bool {
        name == OBJECT || self.index.contains_key(name)
    }

    /// Iterates over all types in the order of their first occurrence. `object` is included only if
    /// it occurs.
    pub fn iter(&self) -> impl Iterator<Item = &Name> {
        self.names.iter()
    }

    /// Whether every object of type `sub` is also of type `sup`. A type is a subtype of itself.
    pub fn is_subtype(&self, sub: &str, sup: &str) -> bool {
        if sub == sup || sup == OBJECT {
            return true;
        }
        match (self.index.get(sub), self.index.get(sup)) {
            (Some(sub), Some(sup)) => self.reaches(*sub, *sup),
            _ => false,
        }
    }

    fn reaches(&self, from: usize, to: usize) -> bool {
        let mut at = from;
        // Fast path: most types have at most one supertype, and such a chain needs no list.
        for _ in 0..SUPERTYPES_MAX {
            match self.supertypes[at].as_slice() {
                [] => return false,
                [one] if *one == to => return true,
                [one] => at = *one,
                _ => return self.above(from).contains(&to),
            }
        }
        false
    }

    /// Returns all supertypes of `from`, the nearest first. `from` itself is included only if it is
    /// in a cycle.
    fn above(&self, from: usize) -> Vec<usize> {
        let mut above = Vec::new();
        let mut seen = HashSet::default();
        let mut next = 0;
        let mut at = from;
        loop {
            above.extend(self.supertypes[at].iter().copied().filter(|index| seen.insert(*index)));
            above.truncate(SUPERTYPES_MAX);
            let Some(index) = above.get(next) else { return above };
            at = *index;
            next += 1;
        }
    }

    /// Returns the supertypes of `name`, the nearest first, without `name` itself and without an
    /// implied `object`.
    pub fn supertypes(&self, name: &str) -> impl Iterator<Item = &Name> {
        let start = self.index.get(name).copied();
        let above = start.map(|start| self.above(start)).unwrap_or_default();
        above.into_iter().filter(move |index| Some(*index) != start).map(|index| &self.names[index])
    }

    /// Returns the subtypes of `name`, beginning with `name` itself if it is declared.
    pub fn subtypes<'s>(&'s self, name: &'s str) -> impl Iterator<Item = &'s Name> {
        let own = self.names.iter().filter(move |sub| **sub == *name);
        let below = self.names.iter().filter(move |sub| **sub != *name);
        own.chain(below.filter(move |sub| self.is_subtype(sub.as_str(), name)))
    }

    /// Whether every object of type `actual` is accepted where `expected` is required.
    pub fn accepts(&self, expected: &TypeExpr, actual: &TypeExpr) -> bool {
        if expected.is_object() {
            return true;
        }
        let fits = |actual: &Name| self.is_one_of(actual, expected);
        !actual.alternatives.is_empty() && actual.alternatives.iter().all(fits)
    }

    /// Whether an object of the declared type belongs to `expected`. An object that is declared as
    /// `(either a b)` belongs to both types, and a variable that is declared so to one of them:
    /// [`Types::accepts`] is for variables.
    pub fn holds(&self, expected: &TypeExpr, declared: &TypeExpr) -> bool {
        expected.is_object()
            || declared.alternatives.iter().any(|own| self.is_one_of(own, expected))
    }

    fn is_one_of(&self, sub: &Name, expected: &TypeExpr) -> bool {
        expected.alternatives.iter().any(|sup| self.is_subtype(sub.as_str(), sup.as_str()))
    }

    /// Whether an object can be of both types, according to the hierarchy.
    pub fn overlap(&self, left: &TypeExpr, right: &TypeExpr) -> bool {
        if left.is_object() || right.is_object() {
            return true;
        }
        let either_way = |name: &Name| {
            self.is_one_of(name, right)
                || right.alternatives.iter().any(|sub| self.is_subtype(sub.as_str(), name.as_str()))
        };
        left.alternatives.iter().any(either_way)
            || self.names.iter().any(|sub| self.is_one_of(sub, left) && self.is_one_of(sub, right))
    }

    /// Returns the first declared type with too many supertypes ([`SUPERTYPES_MAX`]); `None` if
    /// there is none.
    pub fn too_high(&self) -> Option<&Name> {
        let is_too_high = |index: &usize| self.above(*index).len() >= SUPERTYPES_MAX;
        (0..self.names.len()).find(is_too_high).map(|index| &self.names[index])
    }

    /// Returns the first declared type that is its own supertype; `None` if there is none.
    pub fn cycle(&self) -> Option<&Name> {
        let components = components(&self.supertypes);
        let mut sizes = vec![0; components.len()];
        for component in &components {
            sizes[*component] += 1;
        }
        let is_cyclic = |index: &usize| {
            // Some authors write `object - object` for the root.
            let is_own_supertype = self.supertypes[*index].contains(index);
            sizes[components[*index]] > 1 || (is_own_supertype && self.names[*index] != OBJECT)
        };
        (0..self.names.len()).find(is_cyclic).map(|index| &self.names[index])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn types(declarations: &str) -> Types {
        let text = format!("(define (domain d) (:types {declarations}))");
        Types::of(&crate::parse_domain(&text).into_result().unwrap())
    }

    #[track_caller]
    fn check(declarations: &str, sub: &str, sup: &str, expected: bool) {
        assert_eq!(types(declarations).is_subtype(sub, sup), expected);
    }

    const OFFICE: &str = "room corridor - location turtlebot - mobile-base mobile-base - robot";

    #[test]
    fn subtypes_are_transitive_and_reflexive() {
        check(OFFICE, "turtlebot", "robot", true);
        check(OFFICE, "turtlebot", "turtlebot", true);
        check(OFFICE, "robot", "turtlebot", false);
        check(OFFICE, "turtlebot", "location", false);
        check(OFFICE, "turtlebot", "object", true);
    }

    #[test]
    fn a_supertype_may_be_declared_by_use_alone() {
        assert!(types(OFFICE).contains("location"));
        check(OFFICE, "room", "location", true);
    }

    #[test]
    fn cyclic_types_are_handled() {
        let types = types("a - b b - c c - a d - a");
        assert_eq!(types.cycle(), Some(&Name::new("a")));
        assert!(types.is_subtype("d", "c") && types.is_subtype("c", "a"));
        assert!(!types.is_subtype("a", "d"));
    }

    #[test]
    fn an_either_is_accepted_if_each_alternative_is() {
        let types = types(OFFICE);
        let either = |names: &[&str]| TypeExpr {
            alternatives: names.iter().map(|name| Name::new(name)).collect(),
        };
        assert!(types.accepts(&either(&["location"]), &either(&["room", "corridor"])));
        assert!(types.accepts(&either(&["robot", "room"]), &either(&["turtlebot"])));
        assert!(!types.accepts(&either(&["room"]), &either(&["room", "corridor"])));
        assert!(types.overlap(&either(&["room"]), &either(&["room", "corridor"])));
        assert!(!types.overlap(&either(&["room"]), &either(&["robot"])));
    }

    #[test]
    fn an_object_declared_by_either_belongs_to_each_alternative() {
        let types = types(OFFICE);
        let ty = |names: &[&str]| TypeExpr {
            alternatives: names.iter().map(|name| Name::new(name)).collect(),
        };
        let declared = ty(&["turtlebot", "corridor"]);
        for expected in [ty(&["robot"]), ty(&["location"]), ty(&["room", "corridor"]), ty(&[])] {
            assert!(types.holds(&expected, &declared), "{expected}");
        }
        assert!(!types.holds(&ty(&["room"]), &declared));
        assert!(!types.holds(&ty(&["room"]), &ty(&[])));
    }

    #[test]
    fn supertypes_and_subtypes_are_listed_in_order() {
        let types = types(OFFICE);
        let above: Vec<_> = types.supertypes("turtlebot").map(Name::as_str).collect();
        assert_eq!(above, ["mobile-base", "robot"]);
        let below: Vec<_> = types.subtypes("location").map(Name::as_str).collect();
        assert_eq!(below, ["location", "room", "corridor"]);
    }
}
