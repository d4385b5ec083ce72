//! An agent with secrets, as it takes part in joint planning.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::PartStep;
use pddl::Name;
use pddl::factored::AgentFiles;
use planner::{Cancel, Options};

use crate::fill::{FillRefusal, FillTask, FilledPart};
use crate::opaque_names::OpaqueNames;
use crate::private_symbols::{PrivateSymbol, PrivateSymbols, TOTAL_COST, atom_of};
use crate::projection::{ProjectedAction, Projection, Projector};

/// An agent's own task, and how much of it the agent has announced.
#[derive(Clone)]
pub struct Partner {
    task: AgentFiles,
    symbols: PrivateSymbols,
    names: OpaqueNames,
    /// All private symbols of the task.
    all: BTreeSet<PrivateSymbol>,
    /// The private symbols that the projection keeps.
    kept: BTreeSet<PrivateSymbol>,
    projection: Projection,
    projected: BTreeMap<Name, ProjectedAction>,
}

// === impl Partner ===

impl Partner {
    /// Creates a partner that keeps the private symbols which connect its public actions.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the task uses something that is not supported.
    pub fn new(task: AgentFiles) -> Result<Partner, String> {
        if !task.domain.durative_actions.is_empty() {
            return Err(format!("the domain of `{}` has durative actions", task.agent));
        }
        if !task.domain.derived.is_empty() {
            return Err(format!("the domain of `{}` has axioms", task.agent));
        }
        let task = known_part(task);
        let symbols = PrivateSymbols::of(&task);
        let mut all = symbols.wanted(&task.problem);
        for action in &task.domain.actions {
            all.extend(symbols.required_by(action));
            all.extend(symbols.changed_by(action).0);
            all.extend(symbols.conditions_of_effects(action));
        }
        let functions = task.domain.functions.iter().map(|it| it.name.clone());
        let functions = functions.filter(|name| symbols.is_private_function(name));
        let functions: Vec<Name> = functions.filter(|name| *name != *TOTAL_COST).collect();
        let names = OpaqueNames::new(&task.agent, &symbols, &all, functions.into_iter());
        let kept = dependencies(&task, &symbols);
        let projector = Projector { task: &task, symbols: &symbols, names: &names, kept: &kept };
        let (projection, projected) = projector.project();
        Ok(Partner { task, symbols, names, all, kept, projection, projected })
    }

    /// Returns the name of the agent.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.task.agent
    }

    /// Returns what others may learn of the task.
    #[must_use]
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// Returns how many private symbols the projection keeps, and how many there are.
    #[must_use]
    pub fn kept(&self) -> (usize, usize) {
        (self.kept.len(), self.all.len())
    }

    /// Fills the agent's part of a skeleton with private steps.
    ///
    /// # Errors
    ///
    /// Returns a refusal if the agent cannot do its part.
    pub fn fill(
        &self,
        part: &[PartStep],
        options: &Options,
        cancel: &Cancel,
    ) -> Result<FilledPart, FillRefusal> {
        let Partner { task, symbols, names, projected, .. } = self;
        FillTask::new(task, symbols, names, projected, part)?.fill(options, cancel)
    }

    /// Keeps more private symbols after a refusal: those that the refused step requires, or those
    /// that its requirements depend on. Returns `false` if all are kept already.
    pub fn sharpen(&mut self, refusal: &FillRefusal) -> bool {
        let more = match refusal.schema {
            Some(schema) => self.missing_for(schema),
            None => self.all.difference(&self.kept).cloned().collect(),
        };
        if more.is_empty() {
            return false;
        }
        self.kept.extend(more);
        let Partner { task, symbols, names, kept, .. } = &*self;
        (self.projection, self.projected) = Projector { task, symbols, names, kept }.project();
        true
    }

    /// Returns the private symbols that the projection drops and on which an action depends most
    /// directly; all that it drops if the action depends on none.
    fn missing_for(&self, schema: usize) -> BTreeSet<PrivateSymbol> {
        let actions = &self.task.domain.actions;
        let mut relevant = actions.get(schema).map(|it| self.symbols.required_by(it));
        while let Some(known) = relevant {
            let missing: BTreeSet<_> = known.difference(&self.kept).cloned().collect();
            if !missing.is_empty() {
                return missing;
            }
            let changing =
                actions.iter().filter(|it| !self.symbols.changed_by(it).0.is_disjoint(&known));
            let mut more = known.clone();
            more.extend(changing.flat_map(|it| self.symbols.required_by(it)));
            relevant = (more.len() > known.len()).then_some(more);
        }
        self.all.difference(&self.kept).cloned().collect()
    }
}

/// Returns the private symbols that connect public actions: those that a public action adds or
/// deletes, those that no action changes and a public action requires, and those that the goal and
/// conditional effects need.
fn dependencies(task: &AgentFiles, symbols: &PrivateSymbols) -> BTreeSet<PrivateSymbol> {
    let mut kept = symbols.wanted(&task.problem);
    let (mut changed, mut required) = (BTreeSet::new(), BTreeSet::new());
    for action in &task.domain.actions {
        kept.extend(symbols.conditions_of_effects(action));
        let (changes, is_public) = symbols.changed_by(action);
        changed.extend(changes.iter().cloned());
        if is_public {
            required.extend(symbols.required_by(action));
            kept.extend(changes);
        }
    }
    kept.extend(required.difference(&changed).cloned());
    kept
}

/// Returns the task without facts about predicates, functions and objects that the files do not
/// declare, and without goals about objects that they do not declare: these are the business of
/// other agents.
fn known_part(mut task: AgentFiles) -> AgentFiles {
    let symbols = PrivateSymbols::of(&task);
    let predicates: BTreeSet<Name> =
        task.domain.predicates.iter().map(|it| it.name.clone()).collect();
    let functions: BTreeSet<Name> =
        task.domain.functions.iter().map(|it| it.name.clone()).collect();
    let is_object = |term: &pddl::Term| symbols.knows_object(term.name());
    let knows_atom = |atom: &pddl::Atom| {
        predicates.contains(&atom.predicate) && atom.arguments.iter().all(is_object)
    };
    task.problem.init.retain(|element| match (atom_of(element), element) {
        (Some(atom), _) => knows_atom(atom),
        (None, pddl::InitElement::Assign(fluent, _)) => {
            functions.contains(&fluent.function) && fluent.arguments.iter().all(is_object)
        }
        (None, _) => true,
    });
    let conjuncts = match std::mem::take(&mut task.problem.goal) {
        pddl::Condition::And(conjuncts) => conjuncts,
        other => vec![other],
    };
    let knows = |conjunct: &pddl::Condition| {
        let mut is_known = true;
        crate::private_symbols::atoms(conjunct, &mut Default::default(), &mut |atom, scope| {
            let knows_term = |term: &pddl::Term| match term {
                pddl::Term::Variable(name) => scope.contains_key(name),
                pddl::Term::Object(_) => is_object(term),
            };
            is_known &=
                predicates.contains(&atom.predicate) && atom.arguments.iter().all(knows_term);
        });
        is_known
    };
    let known = conjuncts.into_iter().filter(knows).collect();
    task.problem.goal = pddl::Condition::And(known);
    task
}
