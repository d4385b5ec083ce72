//! An agent with secrets, as it takes part in joint planning.

use std::collections::BTreeSet;

use acl::content::PartStep;
use pddl::factored::AgentFiles;
use pddl::{Atom, Condition, InitElement, Name, TOTAL_COST, Term};
use planner::{Cancel, Options};

use crate::fill::{FillRefusal, FillTask, FilledPart, ProvedRefusal};
use crate::opaque_names::{ActionNaming, OWN, OpaqueNames, check_member_name, opaque_words};
use crate::private_symbols::{PrivateSymbol, PrivateSymbols, Scope, atom_of, atoms};
use crate::projection::{ProjectedTask, Projection, Projector};
use crate::terms::used_by;

/// An agent's own task, and how much of it the agent has announced.
#[derive(Clone)]
pub struct Partner {
    pub(crate) task: AgentFiles,
    pub(crate) symbols: PrivateSymbols,
    pub(crate) names: OpaqueNames,
    /// All private symbols of the task.
    all: BTreeSet<PrivateSymbol>,
    /// The private symbols that the projection keeps.
    kept: BTreeSet<PrivateSymbol>,
    pub(crate) projected: ProjectedTask,
}

// === impl Partner ===

impl Partner {
    /// Creates a partner that keeps the private symbols which connect its public actions.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the task uses something that is not supported.
    pub fn new(task: AgentFiles) -> Result<Partner, String> {
        Partner::with_naming(known_part(task)?, ActionNaming::OfMember, None)
    }

    /// Creates a partner. What has a name or is announced in `former`, a former partner of the same
    /// agent, keeps that.
    pub(crate) fn with_naming(
        task: AgentFiles,
        naming: ActionNaming,
        former: Option<&Partner>,
    ) -> Result<Partner, String> {
        let symbols = PrivateSymbols::of(&task);
        refuse_unsupported(&task, &symbols)?;
        let mut all = symbols.wanted(&task.problem);
        for action in &task.domain.actions {
            all.extend(symbols.required_by(action));
            all.extend(symbols.changed_by(action).0);
            all.extend(symbols.conditions_of_effects(action));
        }
        let known = former.map(|it| &it.names);
        let names = OpaqueNames::new(&task, &symbols, &all, (naming, known));
        let mut kept = dependencies(&task, &symbols);
        kept.extend(former.into_iter().flat_map(|it| it.kept.iter().cloned()));
        let projector = Projector { task: &task, symbols: &symbols, names: &names, kept: &kept };
        let projected = projector.project();
        Ok(Partner { task, symbols, names, all, kept, projected })
    }

    /// Returns what others may learn of the task.
    #[must_use]
    pub fn projection(&self) -> Projection {
        let ProjectedTask { domain, problem, .. } = &self.projected;
        Projection { domain: domain.to_string(), problem: problem.to_string() }
    }

    pub(crate) fn projector(&self) -> Projector<'_> {
        let Partner { task, symbols, names, kept, .. } = self;
        Projector { task, symbols, names, kept }
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
        FillTask::new(task, symbols, names, &projected.actions, part)?.fill(options, cancel)
    }

    /// Keeps more private symbols after a proved refusal: those that the refused step or the agent's
    /// goals require, or those that these depend on. Returns `false` if all are kept already, or if
    /// the refusal is no proof.
    pub fn sharpen(&mut self, refusal: &FillRefusal) -> bool {
        let more = match refusal.proved {
            None => return false,
            Some(ProvedRefusal::Step { schema }) => {
                let action = self.task.domain.actions.get(schema);
                self.missing_for(action.map(|it| self.symbols.required_by(it)))
            }
            Some(ProvedRefusal::Goals) => {
                self.missing_for(Some(self.symbols.wanted(&self.task.problem)))
            }
        };
        if more.is_empty() {
            return false;
        }
        self.kept.extend(more);
        self.projected = self.projector().project();
        true
    }

    /// Returns the private symbols that the projection drops and on which some symbols depend most
    /// directly; all that it drops if they depend on none.
    fn missing_for(&self, symbols: Option<BTreeSet<PrivateSymbol>>) -> BTreeSet<PrivateSymbol> {
        let actions = &self.task.domain.actions;
        let mut relevant = symbols;
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

/// Refuses what projections or parts cannot express.
///
/// # Errors
///
/// Returns the feature, as text for a person.
fn refuse_unsupported(task: &AgentFiles, symbols: &PrivateSymbols) -> Result<(), String> {
    let AgentFiles { agent, domain, problem } = task;
    check_member_name(agent)?;
    if let Some(name) = opaque_words(&format!("{domain} {problem}")).next() {
        return Err(format!("`{name}` contains `{OWN}`, which only opaque names may"));
    }
    if !domain.durative_actions.is_empty() {
        return Err(format!("the domain of `{agent}` has durative actions"));
    }
    if !domain.derived.is_empty() {
        return Err(format!("the domain of `{agent}` has axioms"));
    }
    let compares_cost =
        |condition| used_by(condition).functions.iter().any(|it| *it == *TOTAL_COST);
    if compares_cost(&problem.goal) {
        return Err(format!("the goal of `{agent}` is about `{TOTAL_COST}`"));
    }
    for action in &domain.actions {
        let name = &action.name;
        if !action.partners.is_empty() {
            return Err(format!("several agents act in `{name}` of `{agent}` at once"));
        }
        if compares_cost(&action.precondition) {
            return Err(format!("`{name}` of `{agent}` has a condition about `{TOTAL_COST}`"));
        }
        if symbols.hides_a_public_effect(action) {
            return Err(format!(
                "`{name}` of `{agent}` changes something public in a way that depends on \
                 something private: not supported"
            ));
        }
    }
    Ok(())
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
/// declare, and without goals that are only about such: these are the business of other agents.
///
/// # Errors
///
/// Returns the reason, as text for a person, if a part of one conjunct of the goal is the business
/// of other agents, and another part is not.
fn known_part(mut task: AgentFiles) -> Result<AgentFiles, String> {
    let symbols = PrivateSymbols::of(&task);
    let predicates: BTreeSet<Name> =
        task.domain.predicates.iter().map(|it| it.name.clone()).collect();
    let functions: BTreeSet<Name> =
        task.domain.functions.iter().map(|it| it.name.clone()).collect();
    let is_object = |term: &Term| symbols.knows_object(term.name());
    let knows_atom =
        |atom: &Atom| predicates.contains(&atom.predicate) && atom.arguments.iter().all(is_object);
    task.problem.init.retain(|element| match (atom_of(element), element) {
        (Some(atom), _) => knows_atom(atom),
        (None, InitElement::Assign(fluent, _)) => {
            functions.contains(&fluent.function) && fluent.arguments.iter().all(is_object)
        }
        (None, _) => true,
    });
    let conjuncts = match std::mem::take(&mut task.problem.goal) {
        Condition::And(conjuncts) => conjuncts,
        other => vec![other],
    };
    let mut known = Vec::new();
    for conjunct in conjuncts {
        let (mut is_known, mut is_unknown) = (false, false);
        let mut note = |is: bool| if is { is_known = true } else { is_unknown = true };
        atoms(&conjunct, &mut Scope::new(), &mut |atom, scope| {
            let knows = |term: &Term| match term {
                Term::Variable(name) => scope.contains_key(name),
                Term::Object(_) => is_object(term),
            };
            note(predicates.contains(&atom.predicate) && atom.arguments.iter().all(knows));
        });
        let used = used_by(&conjunct);
        used.functions.iter().for_each(|name| note(functions.contains(name)));
        used.objects.iter().filter(|name| !symbols.knows_object(name)).for_each(|_| note(false));
        match (is_known, is_unknown) {
            (true, true) if !is_literal(&conjunct) => {
                return Err(format!(
                    "the goal `{conjunct}` is about things that `{}` does not know, and about \
                     others that it knows: not supported",
                    task.agent
                ));
            }
            (_, true) => (),
            (_, false) => known.push(conjunct),
        }
    }
    task.problem.goal = Condition::And(known);
    Ok(task)
}

/// Whether a condition is one atom or comparison, or the negation of one.
fn is_literal(condition: &Condition) -> bool {
    match condition {
        Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => true,
        Condition::Not(inner) => is_literal(inner),
        Condition::And(_)
        | Condition::Or(_)
        | Condition::Imply(..)
        | Condition::Exists(..)
        | Condition::Forall(..) => false,
    }
}
