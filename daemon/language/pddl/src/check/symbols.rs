//! The symbols of a task, collected from the texts that declare them.

use std::cell::{Cell, OnceCell};

use foldhash::{HashMap, HashSet};

use crate::tree::{
    ActionModel, ActionSchema, Domain, FunctionDeclaration, Name, PredicateDeclaration, Problem,
    TypeExpr, Typed,
};
use crate::types::Types;

/// Symbols that a text may use. If a symbol is declared twice, the first declaration is used.
pub(super) struct Symbols<'t> {
    pub(super) types: Types,
    predicates: DeclarationTable<'t, PredicateDeclaration>,
    functions: DeclarationTable<'t, FunctionDeclaration>,
    objects: DeclarationTable<'t, Typed>,
    derived: HashSet<&'t str>,
    actions: &'t [ActionSchema],
    /// Whether other agents may declare objects, so that an object without a declaration may be
    /// valid.
    pub(super) is_open: bool,
    /// Whether only the constants of the domain are known, and not the objects of problems.
    pub(super) is_of_domain: bool,
}

/// Declarations in the order of the text, which can be looked up by name.
struct DeclarationTable<'t, T> {
    order: Vec<&'t T>,
    /// Index of the declarations by name. It is created only after several look-ups, because a goal
    /// mentions only one or two of the many objects of a large building.
    index: OnceCell<HashMap<&'t str, usize>>,
    /// Number of look-ups that were made without the index.
    scans: Cell<u8>,
}

/// Number of look-ups after which the index is created.
const SCANS_MAX: u8 = 4;

/// A declaration in a PDDL text, which has a name.
pub(super) trait NamedDeclaration {
    fn name(&self) -> &Name;
}

// === impl Symbols ===

impl<'t> Symbols<'t> {
    pub(super) fn of_domain(domain: &'t Domain) -> Symbols<'t> {
        Symbols {
            types: Types::of(domain),
            predicates: DeclarationTable::new(&domain.predicates),
            functions: DeclarationTable::new(&domain.functions),
            objects: DeclarationTable::new(&domain.constants),
            derived: domain.derived.iter().map(|axiom| axiom.predicate.as_str()).collect(),
            actions: &domain.actions,
            is_open: false,
            is_of_domain: true,
        }
    }

    pub(super) fn of_problem(domain: &'t Domain, problem: &'t Problem) -> Symbols<'t> {
        let own = problem.objects.iter().map(|declaration| &declaration.object);
        let objects = DeclarationTable::new(domain.constants.iter().chain(own));
        Symbols { objects, is_of_domain: false, ..Symbols::of_domain(domain) }
    }

    pub(super) fn of_model(ontology: &'t Domain, model: &'t ActionModel) -> Symbols<'t> {
        let objects = model.objects.iter().map(|declaration| &declaration.object);
        let derived = ontology.derived.iter().chain(&model.derived);
        Symbols {
            types: Types::new(ontology.types.iter().chain(&model.types)),
            predicates: DeclarationTable::new(ontology.predicates.iter().chain(&model.predicates)),
            functions: DeclarationTable::new(ontology.functions.iter().chain(&model.functions)),
            objects: DeclarationTable::new(ontology.constants.iter().chain(objects)),
            derived: derived.map(|axiom| axiom.predicate.as_str()).collect(),
            actions: &model.actions,
            is_open: true,
            is_of_domain: false,
        }
    }

    pub(super) fn predicate(&self, name: &Name) -> Option<&'t PredicateDeclaration> {
        self.predicates.get(name.as_str())
    }

    pub(super) fn function(&self, name: &Name) -> Option<&'t FunctionDeclaration> {
        self.functions.get(name.as_str())
    }

    pub(super) fn object(&self, name: &Name) -> Option<&'t Typed> {
        self.objects.get(name.as_str())
    }

    /// Whether any declaration of an object gives it this type. An object may have several
    /// declarations.
    pub(super) fn is_also(&self, object: &Name, wanted: &TypeExpr) -> bool {
        let mut named = self.objects.order.iter().filter(|one| one.name == *object);
        named.any(|one| self.types.holds(wanted, &one.ty))
    }

    pub(super) fn is_derived(&self, predicate: &Name) -> bool {
        self.derived.contains(predicate.as_str())
    }

    pub(super) fn is_action(&self, name: &Name) -> bool {
        self.actions.iter().any(|action| action.name == *name)
    }

    pub(super) fn predicate_names(&self) -> impl Iterator<Item = &'t str> {
        self.predicates.order.iter().map(|declaration| declaration.name.as_str())
    }

    pub(super) fn function_names(&self) -> impl Iterator<Item = &'t str> {
        self.functions.order.iter().map(|declaration| declaration.name.as_str())
    }

    pub(super) fn object_names(&self) -> impl Iterator<Item = &'t str> {
        self.objects.order.iter().map(|typed| typed.name.as_str())
    }
}

// === impl DeclarationTable ===

impl<'t, T: NamedDeclaration> DeclarationTable<'t, T> {
    fn new(declarations: impl IntoIterator<Item = &'t T>) -> DeclarationTable<'t, T> {
        let order = declarations.into_iter().collect();
        DeclarationTable { order, index: OnceCell::new(), scans: Cell::new(0) }
    }

    fn get(&self, name: &str) -> Option<&'t T> {
        let scans = self.scans.get();
        if scans < SCANS_MAX {
            self.scans.set(scans + 1);
            return self.order.iter().find(|one| one.name().as_str() == name).copied();
        }
        self.index.get_or_init(|| self.indexed()).get(name).map(|index| self.order[*index])
    }

    fn indexed(&self) -> HashMap<&'t str, usize> {
        let mut index = HashMap::default();
        index.reserve(self.order.len());
        for (position, declaration) in self.order.iter().enumerate() {
            index.entry(declaration.name().as_str()).or_insert(position);
        }
        index
    }
}

impl NamedDeclaration for PredicateDeclaration {
    fn name(&self) -> &Name {
        &self.name
    }
}

impl NamedDeclaration for FunctionDeclaration {
    fn name(&self) -> &Name {
        &self.name
    }
}

impl NamedDeclaration for Typed {
    fn name(&self) -> &Name {
        &self.name
    }
}
