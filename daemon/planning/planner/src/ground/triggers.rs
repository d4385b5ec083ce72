//! Triggers: they determine the Horn rules that must be evaluated for a new tuple.

use rustc_hash::FxHashMap;

use super::horn_rules::{HornRule, variables};
use super::join::JoinPlan;
use crate::normalize::lifted::LiftedTerm;
use crate::task::ObjectId;

/// A trigger: a rule that must be evaluated for a new tuple of some relation.
#[derive(Debug)]
pub(super) struct Trigger {
    pub(super) rule: usize,
    /// Position of the atom in the rule's body that the new tuple matches.
    pub(super) position: usize,
    pub(super) action: TriggerAction,
}

/// Method of evaluating a rule for a new tuple of one of its atoms.
#[derive(Debug)]
pub(super) enum TriggerAction {
    /// Evaluates the rule by a join over its other atoms. The join is planned at its first use.
    Join(Option<Box<JoinPlan>>),
    /// Counts the atoms of the rule that are found. The rule has no variables, and fires when all
    /// its atoms are found.
    Count,
}

/// The triggers of all rules, by relation.
#[derive(Debug)]
pub(super) struct Triggers {
    all: Vec<Trigger>,
    /// Per relation: the triggers that its new tuples may match.
    waiting: Vec<RelationTriggers>,
    /// Per rule without variables: the number of its atoms that have not been found yet.
    missing: FxHashMap<usize, usize>,
}

/// The triggers of one relation.
#[derive(Debug, Default)]
struct RelationTriggers {
    /// Triggers without a fixed object in any column.
    open: Vec<usize>,
    /// Columns with a fixed object in some trigger.
    columns: Vec<usize>,
    /// Triggers with a fixed object in a column. The key is the index of the column, and the
    /// object.
    fixed: FxHashMap<(usize, ObjectId), Vec<usize>>,
}

// === impl Triggers ===

impl Triggers {
    pub(super) fn new(relations: usize) -> Triggers {
        Triggers {
            all: Vec::new(),
            waiting: (0..relations).map(|_| RelationTriggers::default()).collect(),
            missing: FxHashMap::default(),
        }
    }

    pub(super) fn get_mut(&mut self, id: usize) -> &mut Trigger {
        &mut self.all[id]
    }

    /// Adds one trigger of a rule for each atom of its body at these positions.
    pub(super) fn add(&mut self, index: usize, rule: &HornRule, positions: &[usize]) {
        let has_variables = !rule.wanted.is_empty()
            || rule.body.atoms.iter().any(|atom| !variables(atom).is_empty());
        if !has_variables {
            self.missing.insert(index, positions.len());
        }
        for &position in positions {
            let atom = &rule.body.atoms[position];
            let id = self.all.len();
            let action =
                if has_variables { TriggerAction::Join(None) } else { TriggerAction::Count };
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

    /// Appends the triggers that a new tuple may match to `due`.
    pub(super) fn due(&self, relation: usize, tuple: &[ObjectId], due: &mut Vec<usize>) {
        let waiting = &self.waiting[relation];
        due.extend_from_slice(&waiting.open);
        for &column in &waiting.columns {
            if let Some(fixed) = waiting.fixed.get(&(column, tuple[column])) {
                due.extend_from_slice(fixed);
            }
        }
    }

    /// Counts one atom of a rule without variables as found. Returns whether all its atoms are
    /// found now.
    pub(super) fn count_down(&mut self, rule: usize) -> bool {
        let Some(missing) = self.missing.get_mut(&rule) else { return false };
        *missing -= 1;
        *missing == 0
    }
}
