//! What a [`super::Replanner`] knows of its texts: everything that was in them since it was ground
//! afresh, in the order in which it came.

use std::sync::Arc;

use pddl::{ActionSchema, Domain, ObjectDeclaration, PredicateDeclaration, Problem, Typed};
use rustc_hash::FxHashSet;

use crate::ground::{Present, Standing};

/// The texts of the past as one domain, and the objects of all their problems.
#[derive(Debug)]
pub(super) struct Known {
    /// Without constants: they are objects.
    domain: Domain,
    objects: Arc<Vec<ObjectDeclaration>>,
    metric: Option<pddl::Metric>,
    /// What was looked at last: as long as nobody comes or goes, it is the same.
    seen: Option<Seen>,
}

/// The objects of a text, and which of all that are known those are.
#[derive(Debug)]
struct Seen {
    constants: Vec<Typed>,
    objects: Arc<Vec<ObjectDeclaration>>,
    present: Vec<bool>,
}

/// What texts have that is not known.
#[derive(Debug, Default)]
pub(super) struct Additions {
    actions: Vec<ActionSchema>,
    predicates: Vec<PredicateDeclaration>,
    objects: Vec<ObjectDeclaration>,
}

/// A difference that additions cannot follow: a type, an axiom, the metric, or the meaning of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Other;

/// So much may be gone before it is dropped, beside as much as there is.
const GONE_MAX: usize = 16;

// === impl Known ===

impl Known {
    pub(super) fn of(domain: &Domain, problem: &Problem) -> Known {
        let mut known = Known {
            domain: Domain { constants: Vec::new(), ..domain.clone() },
            objects: Arc::default(),
            metric: problem.metric.clone(),
            seen: None,
        };
        known.add(objects(domain, problem).map(declaration));
        known
    }

    /// Adds objects that are new, each once.
    fn add(&mut self, objects: impl Iterator<Item = ObjectDeclaration>) {
        let mut seen = FxHashSet::default();
        let new = objects.filter(|one| seen.insert(one.object.name.clone()));
        Arc::make_mut(&mut self.objects).extend(new);
    }

    /// What the texts have beyond what is known, and what of that they have.
    pub(super) fn compare(
        &mut self,
        domain: &Domain,
        problem: &Problem,
        standing: &Standing,
    ) -> Result<(Additions, Present), Other> {
        let Domain { types, functions, derived, .. } = &self.domain;
        let is_same = *types == domain.types
            && *functions == domain.functions
            && *derived == domain.derived
            && self.metric == problem.metric;
        if !is_same {
            return Err(Other);
        }
        let mut additions = Additions::default();
        let mut present = Present {
            objects: self.compare_objects(domain, problem, standing, &mut additions)?,
            schemas: vec![false; self.domain.actions.len()],
            predicates: vec![false; self.domain.predicates.len()],
        };
        self.compare_actions(domain, &mut additions, &mut present);
        self.compare_predicates(domain, &mut additions, &mut present)?;
        let gone = |here: &[bool]| here.iter().filter(|is_here| !**is_here).count();
        let is_stale = |here: &[bool]| gone(here) > here.len() / 2 + GONE_MAX;
        if is_stale(&present.objects) || is_stale(&present.schemas) {
            return Err(Other);
        }
        Ok((additions, present))
    }

    /// Which of the known objects the texts have.
    fn compare_objects(
        &mut self,
        domain: &Domain,
        problem: &Problem,
        standing: &Standing,
        additions: &mut Additions,
    ) -> Result<Vec<bool>, Other> {
        let is_same = |seen: &&Seen| {
            Arc::ptr_eq(&seen.objects, &problem.objects) && seen.constants == domain.constants
        };
        if let Some(seen) = self.seen.as_ref().filter(is_same) {
            return Ok(seen.present.clone());
        }
        let mut present = vec![false; self.objects.len()];
        for object in objects(domain, problem) {
            match standing.object(&object.name).map(|id| id.index()) {
                Some(id) if self.objects[id].object.ty == object.ty => present[id] = true,
                Some(_) => return Err(Other),
                None => additions.objects.push(declaration(object)),
            }
        }
        // Who brings new ones is seen when they are learned.
        self.seen = additions.objects.is_empty().then(|| Seen {
            constants: domain.constants.clone(),
            objects: Arc::clone(&problem.objects),
            present: present.clone(),
        });
        Ok(present)
    }

    /// Texts mostly keep their order, so each action is looked for where the last one's successor is.
    fn compare_actions(&self, domain: &Domain, additions: &mut Additions, present: &mut Present) {
        let all = &self.domain.actions;
        let mut next = 0;
        for action in &domain.actions {
            let rest = (next..all.len()).chain(0..next);
            let found = { rest }.find(|at| all[*at].name == action.name && all[*at] == *action);
            match found {
                Some(at) => {
                    present.schemas[at] = true;
                    next = at + 1;
                }
                None => additions.actions.push(action.clone()),
            }
        }
    }

    fn compare_predicates(
        &self,
        domain: &Domain,
        additions: &mut Additions,
        present: &mut Present,
    ) -> Result<(), Other> {
        let all = &self.domain.predicates;
        let mut next = 0;
        for predicate in &domain.predicates {
            let rest = (next..all.len()).chain(0..next);
            match { rest }.find(|at| all[*at].name == predicate.name) {
                Some(at) if all[at].parameters == predicate.parameters => {
                    present.predicates[at] = true;
                    next = at + 1;
                }
                Some(_) => return Err(Other),
                None => additions.predicates.push(predicate.clone()),
            }
        }
        Ok(())
    }

    /// Learns what is new; it is present.
    pub(super) fn learn(&mut self, additions: Additions, present: &mut Present) {
        self.domain.actions.extend(additions.actions);
        self.domain.predicates.extend(additions.predicates);
        present.schemas.resize(self.domain.actions.len(), true);
        present.predicates.resize(self.domain.predicates.len(), true);
        self.add(additions.objects.into_iter());
        present.objects.resize(self.objects.len(), true);
    }

    /// All that is known, in the state of a problem.
    pub(super) fn texts(&self, problem: &Problem) -> (&Domain, Problem) {
        (&self.domain, Problem { objects: Arc::clone(&self.objects), ..problem.clone() })
    }

    /// All of it, as it was when it was learned.
    pub(super) fn everything(&self) -> Present {
        Present {
            objects: vec![true; self.objects.len()],
            schemas: vec![true; self.domain.actions.len()],
            predicates: vec![true; self.domain.predicates.len()],
        }
    }
}

// === impl Additions ===

impl Additions {
    /// Whether the domain says nothing new.
    pub(super) fn are_objects_only(&self) -> bool {
        self.actions.is_empty() && self.predicates.is_empty()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.actions.is_empty() && self.predicates.is_empty() && self.objects.is_empty()
    }
}

/// The objects of a problem, those of its domain first.
fn objects<'t>(domain: &'t Domain, problem: &'t Problem) -> impl Iterator<Item = &'t Typed> {
    domain.constants.iter().chain(problem.objects.iter().map(|declared| &declared.object))
}

fn declaration(object: &Typed) -> ObjectDeclaration {
    ObjectDeclaration { object: object.clone(), privacy: pddl::Privacy::Public }
}
