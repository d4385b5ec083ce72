//! The known texts of a [`super::Replanner`]: all parts of its texts since the last full grounding,
//! in the order of their addition.

use std::sync::Arc;

use pddl::{ActionSchema, Domain, ObjectDeclaration, PredicateDeclaration, Problem, Typed};
use rustc_hash::FxHashSet;

use crate::ground::{IncrementalGrounding, PresenceMask};

/// Union of the known texts: one domain, and the objects of all problems.
#[derive(Debug)]
pub(super) struct KnownTexts {
    /// Union of the domains, without constants; these are in `objects`.
    domain: Domain,
    objects: Arc<Vec<ObjectDeclaration>>,
    metric: Option<pddl::Metric>,
    /// Result of the last comparison of objects. It is reused while the objects stay the same;
    /// `None` if there is no valid result.
    seen: Option<ComparedObjects>,
}

/// Objects of a text, and a mark for each known object that is among them.
#[derive(Debug)]
struct ComparedObjects {
    constants: Vec<Typed>,
    objects: Arc<Vec<ObjectDeclaration>>,
    present: Vec<bool>,
}

/// Parts of the texts that are not among the known texts.
#[derive(Debug, Default)]
pub(super) struct TextAdditions {
    actions: Vec<ActionSchema>,
    predicates: Vec<PredicateDeclaration>,
    objects: Vec<ObjectDeclaration>,
}

/// A difference from the known texts that cannot be expressed by additions: in types, functions,
/// axioms, the metric, or the meaning of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StructuralDifference;

/// Number of known objects or actions that may be absent beyond half of all. If more are absent,
/// all texts are grounded again.
const GONE_MAX: usize = 16;

// === impl KnownTexts ===

impl KnownTexts {
    pub(super) fn of(domain: &Domain, problem: &Problem) -> KnownTexts {
        let mut known = KnownTexts {
            domain: Domain { constants: Vec::new(), ..domain.clone() },
            objects: Arc::default(),
            metric: problem.metric.clone(),
            seen: None,
        };
        known.add(objects(domain, problem).map(declaration));
        known
    }

    /// Adds those of the given objects that are not known yet.
    fn add(&mut self, objects: impl Iterator<Item = ObjectDeclaration>) {
        let mut seen = FxHashSet::default();
        let new = objects.filter(|one| seen.insert(one.object.name.clone()));
        Arc::make_mut(&mut self.objects).extend(new);
    }

    /// Compares the texts with the known texts. Returns the parts of the texts that are not known
    /// yet, and the mask of the known parts that are present.
    pub(super) fn compare(
        &mut self,
        domain: &Domain,
        problem: &Problem,
        standing: &IncrementalGrounding,
    ) -> Result<(TextAdditions, PresenceMask), StructuralDifference> {
        let Domain { types, functions, derived, .. } = &self.domain;
        let is_same = *types == domain.types
            && *functions == domain.functions
            && *derived == domain.derived
            && self.metric == problem.metric;
        if !is_same {
            return Err(StructuralDifference);
        }
        let mut additions = TextAdditions::default();
        let mut present = PresenceMask {
            objects: self.compare_objects(domain, problem, standing, &mut additions)?,
            schemas: vec![false; self.domain.actions.len()],
            predicates: vec![false; self.domain.predicates.len()],
        };
        self.compare_actions(domain, &mut additions, &mut present);
        self.compare_predicates(domain, &mut additions, &mut present)?;
        let gone = |here: &[bool]| here.iter().filter(|is_here| !**is_here).count();
        let is_stale = |here: &[bool]| gone(here) > here.len() / 2 + GONE_MAX;
        if is_stale(&present.objects) || is_stale(&present.schemas) {
            return Err(StructuralDifference);
        }
        Ok((additions, present))
    }

    /// Returns, for each known object, whether the texts declare it. Adds new objects to
    /// `additions`.
    fn compare_objects(
        &mut self,
        domain: &Domain,
        problem: &Problem,
        standing: &IncrementalGrounding,
        additions: &mut TextAdditions,
    ) -> Result<Vec<bool>, StructuralDifference> {
        let is_same = |seen: &&ComparedObjects| {
            Arc::ptr_eq(&seen.objects, &problem.objects) && seen.constants == domain.constants
        };
        if let Some(seen) = self.seen.as_ref().filter(is_same) {
            return Ok(seen.present.clone());
        }
        let mut present = vec![false; self.objects.len()];
        for object in objects(domain, problem) {
            match standing.object(&object.name).map(|id| id.index()) {
                Some(id) if self.objects[id].object.ty == object.ty => present[id] = true,
                Some(_) => return Err(StructuralDifference),
                None => additions.objects.push(declaration(object)),
            }
        }
        // The result is not cached if there are new objects, because they are not among the known
        // texts yet.
        self.seen = additions.objects.is_empty().then(|| ComparedObjects {
            constants: domain.constants.clone(),
            objects: Arc::clone(&problem.objects),
            present: present.clone(),
        });
        Ok(present)
    }

    /// Compares the actions of the texts with the known actions. Texts usually keep their order, so
    /// the search for each action starts after the last match.
    fn compare_actions(
        &self,
        domain: &Domain,
        additions: &mut TextAdditions,
        present: &mut PresenceMask,
    ) {
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
        additions: &mut TextAdditions,
        present: &mut PresenceMask,
    ) -> Result<(), StructuralDifference> {
        let all = &self.domain.predicates;
        let mut next = 0;
        for predicate in &domain.predicates {
            let rest = (next..all.len()).chain(0..next);
            match { rest }.find(|at| all[*at].name == predicate.name) {
                Some(at) if all[at].parameters == predicate.parameters => {
                    present.predicates[at] = true;
                    next = at + 1;
                }
                Some(_) => return Err(StructuralDifference),
                None => additions.predicates.push(predicate.clone()),
            }
        }
        Ok(())
    }

    /// Adds new parts to the known texts, and marks these parts as present.
    pub(super) fn add_texts(&mut self, additions: TextAdditions, present: &mut PresenceMask) {
        self.domain.actions.extend(additions.actions);
        self.domain.predicates.extend(additions.predicates);
        present.schemas.resize(self.domain.actions.len(), true);
        present.predicates.resize(self.domain.predicates.len(), true);
        self.add(additions.objects.into_iter());
        present.objects.resize(self.objects.len(), true);
    }

    /// Returns the union of all known domains. Also returns a problem with all known objects and
    /// the state of `problem`.
    pub(super) fn texts(&self, problem: &Problem) -> (&Domain, Problem) {
        (&self.domain, Problem { objects: Arc::clone(&self.objects), ..problem.clone() })
    }

    /// Returns the mask in which all known parts are present.
    pub(super) fn everything(&self) -> PresenceMask {
        PresenceMask {
            objects: vec![true; self.objects.len()],
            schemas: vec![true; self.domain.actions.len()],
            predicates: vec![true; self.domain.predicates.len()],
        }
    }
}

// === impl TextAdditions ===

impl TextAdditions {
    /// Whether the additions contain objects only.
    pub(super) fn are_objects_only(&self) -> bool {
        self.actions.is_empty() && self.predicates.is_empty()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.actions.is_empty() && self.predicates.is_empty() && self.objects.is_empty()
    }
}

/// Returns the objects of a problem. The constants of the domain come first.
fn objects<'t>(domain: &'t Domain, problem: &'t Problem) -> impl Iterator<Item = &'t Typed> {
    domain.constants.iter().chain(problem.objects.iter().map(|declared| &declared.object))
}

fn declaration(object: &Typed) -> ObjectDeclaration {
    ObjectDeclaration { object: object.clone(), privacy: pddl::Privacy::Public }
}
