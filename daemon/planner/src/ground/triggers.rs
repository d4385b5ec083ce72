//! Which rules wait for which tuples.

use rustc_hash::FxHashMap;

use super::join::JoinPlan;
use super::rules::{Rule, variables};
use crate::normalize::lifted::LiftedTerm;
use crate::task::ObjectId;

/// What to do when a tuple of some relation turns up.
#[derive(Debug)]
pub(super) struct Trigger {
    pub(super) rule: usize,
    /// Which atom of the rule's body the tuple stands for.
    pub(super) position: usize,
    pub(super) action: Action,
}

/// How a rule goes on from one of its atoms.
#[derive(Debug)]
pub(super) enum Action {
    /// By a join over the others, planned the first time it is needed.
    Join(Option<Box<JoinPlan>>),
    /// The rule has no variables: it fires when all its atoms have been seen.
    Count,
}

/// All triggers.
#[derive(Debug)]
pub(super) struct Triggers {
    all: Vec<Trigger>,
    /// By relation.
    waiting: Vec<Waiting>,
    /// By rule without variables: how many atoms it still waits for.
    missing: FxHashMap<usize, usize>,
}

/// The triggers of one relation.
#[derive(Debug, Default)]
struct Waiting {
    /// Those that any tuple may pull.
    open: Vec<usize>,
    /// Columns in which some trigger asks for one object.
    columns: Vec<usize>,
    /// Those that ask for an object in a column.
    fixed: FxHashMap<(usize, ObjectId), Vec<usize>>,
}

// === impl Triggers ===

impl Triggers {
    pub(super) fn new(relations: usize) -> Triggers {
        Triggers {
            all: Vec::new(),
            waiting: (0..relations).map(|_| Waiting::default()).collect(),
            missing: FxHashMap::default(),
        }
    }

    pub(super) fn get_mut(&mut self, id: usize) -> &mut Trigger {
        &mut self.all[id]
    }

    /// Adds the triggers of a rule: one for each of these atoms.
    pub(super) fn add(&mut self, index: usize, rule: &Rule, positions: &[usize]) {
        let has_variables = !rule.wanted.is_empty()
            || rule.body.atoms.iter().any(|atom| !variables(atom).is_empty());
        if !has_variables {
            self.missing.insert(index, positions.len());
        }
        for &position in positions {
            let atom = &rule.body.atoms[position];
            let id = self.all.len();
            let action = if has_variables { Action::Join(None) } else { Action::Count };
            self.all.push(Trigger { rule: index, position, action });
            let waiting = &mut self.waiting[atom.predicate];
            let fixed = atom.arguments.iter().enumerate().find_map(|(column, term)| match term {
                LiftedTerm::Object(object) => Some((column, *object)),
                LiftedTerm::Variable(_) => None,
            });
            let Some((column, object)) = fixed else {
                waiting.open.push(id);
                continue;
            };
            if !waiting.columns.contains(&column) {
                waiting.columns.push(column);
            }
            waiting.fixed.entry((column, object)).or_default().push(id);
        }
    }

    /// Collects the triggers that a tuple may pull.
    pub(super) fn due(&self, relation: usize, tuple: &[ObjectId], due: &mut Vec<usize>) {
        let waiting = &self.waiting[relation];
        due.extend_from_slice(&waiting.open);
        for &column in &waiting.columns {
            if let Some(fixed) = waiting.fixed.get(&(column, tuple[column])) {
                due.extend_from_slice(fixed);
            }
        }
    }

    /// Counts one atom of a rule without variables; whether it was the last.
    pub(super) fn count_down(&mut self, rule: usize) -> bool {
        let Some(missing) = self.missing.get_mut(&rule) else { return false };
        *missing -= 1;
        *missing == 0
    }
}
