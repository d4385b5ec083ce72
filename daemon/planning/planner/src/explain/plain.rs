//! Explains why a problem of plain PDDL has no plan: the unreachable part of the goal, and the
//! missing conditions of the actions that could achieve it, down to a fact that no action makes
//! true.
//!
//! - The delete relaxation is evaluated separately for each part of the goal, so a part that is
//!   reported as unreachable is proved to be so.
//! - If every part is reachable in the relaxation, a plan is searched for each part alone, with
//!   little effort.
//! - The number of explained parts and the length of a chain of reasons are limited; omitted parts
//!   are counted.

use pddl::{Condition, Domain, Effect, FluentTerm, InitElement, Problem, Typed, Types};

use super::achievers::{Achiever, Literal, conjuncts_of, simplified};
use super::suppose::has_comparison;
use crate::goal::{first_conjuncts, unreachable, unreachable_or_undecided};
use crate::limits::{Budget, Cancel};
use crate::options::Options;
use crate::outcome::{PlanError, StopReason};
use crate::validate::World;

/// Maximum number of parts of the goal that are checked; further parts are left out. Each part is
/// grounded separately.
const PARTS_MAX: usize = 64;

/// Maximum number of unreachable parts that are explained; further ones are only counted.
const EXPLAINED_PARTS_MAX: usize = 3;

/// Maximum number of links in a chain from a part of the goal to a fact that no action makes true.
/// A longer chain is shown without its end.
const LINKS_MAX: usize = 6;

/// Maximum number of achievers of one fact (actions and axioms that could make it true) that are
/// named; further ones are only counted.
const ACHIEVERS_MAX: usize = 3;

/// Maximum number of branches of a disjunction that are explained; further ones are only counted.
const BRANCHES_MAX: usize = 3;

/// Maximum depth of nested disjunctions with explained branches. Each branch has a chain
/// of its own.
const BRANCH_DEPTH_MAX: usize = 1;

/// Maximum number of conditions of one achiever for each of which a plan is searched.
const SEARCHED_NEEDS_MAX: usize = 8;

/// Maximum number of characters of a condition that are shown; the rest is replaced by “…”.
const TEXT_CHARS_MAX: usize = 120;

/// Text for a problem without a known reason.
const UNEXPLAINED: &str = "no sequence of steps reaches all parts of the goal";

/// Limits on the work for one check, which takes a fraction of a second.
const JOIN_STEPS_MAX: u64 = 5_000_000;
const EXPANSIONS_MAX: u64 = 5_000;

/// Reasons why a problem has no plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unsolvability {
    /// The first few parts of the goal that are unreachable even alone. Each entry is the part and
    /// the reason as text.
    pub parts: Vec<(Condition, String)>,
    /// Number of unreachable parts of the goal beyond those in `parts`.
    pub more: usize,
    /// Reason why the parts of the goal are unreachable together although each alone is reachable;
    /// `None` if any part alone is unreachable.
    pub together: Option<String>,
}

/// Explains why a problem has no plan. The work is bounded, so the explanation may be incomplete.
///
/// # Errors
///
/// Returns an error if the texts contain mistakes or use a feature that this planner does not
/// support.
pub fn why_unsolvable(
    domain: &Domain,
    problem: &Problem,
    memory_max_bytes: usize,
    cancel: &Cancel,
) -> Result<Unsolvability, PlanError> {
    let world = World::initial(domain, problem).map_err(PlanError::BadInput)?;
    let world = world.limit_work(JOIN_STEPS_MAX, Some(cancel));
    let (parts, is_whole) = first_conjuncts(&world, &problem.goal, PARTS_MAX);
    let budget =
        Budget { expansions_max: EXPANSIONS_MAX, join_steps_max: JOIN_STEPS_MAX, memory_max_bytes };
    let options = Options { budget, ..Options::default() };
    let why = UnsolvabilityExplainer { domain, problem, types: Types::of(domain), options, cancel };
    let (missing, is_decided) =
        unreachable_or_undecided(domain, problem, &parts, &why.options, cancel)?;
    let mut found = Unsolvability::default();
    for part in missing.iter().take(EXPLAINED_PARTS_MAX) {
        found.parts.push((parts[*part].clone(), why.chain(&parts[*part], BRANCH_DEPTH_MAX)?));
    }
    found.more = missing.len().saturating_sub(EXPLAINED_PARTS_MAX);
    match missing.is_empty() {
        true if is_decided => why.explain_parts_alone(&parts, is_whole, &mut found)?,
        true => found.together = Some(UNEXPLAINED.to_owned()),
        false => (),
    }
    Ok(found)
}

/// Inputs of an explanation, with its limits.
pub(super) struct UnsolvabilityExplainer<'w> {
    pub(super) domain: &'w Domain,
    pub(super) problem: &'w Problem,
    pub(super) types: Types,
    options: Options,
    cancel: &'w Cancel,
}

// === impl UnsolvabilityExplainer ===

impl UnsolvabilityExplainer<'_> {
    fn unreachable(&self, conditions: &[Condition]) -> Result<Vec<usize>, PlanError> {
        unreachable(self.domain, self.problem, conditions, &self.options, self.cancel)
    }

    /// Searches for a plan for each part of the goal alone, and explains the parts without a plan.
    /// `is_whole` is true if `parts` are all parts of the goal.
    fn explain_parts_alone(
        &self,
        parts: &[Condition],
        is_whole: bool,
        found: &mut Unsolvability,
    ) -> Result<(), PlanError> {
        let is_one = is_whole && parts.len() == 1;
        let mut all_reached = is_whole;
        for part in parts.iter().filter(|_| !is_one) {
            let alone = Problem { goal: part.clone(), metric: None, ..self.problem.clone() };
            let outcome = crate::plan(self.domain, &alone, &self.options, self.cancel)?;
            all_reached &= outcome.plan.is_some();
            if !matches!(outcome.stop_reason, StopReason::Unsolvable { .. }) {
                continue;
            }
            if found.parts.len() < EXPLAINED_PARTS_MAX {
                let unmet = self.unmet_needs(part)?;
                let why = unmet.unwrap_or_else(|| self.explain_obstruction(part));
                found.parts.push((part.clone(), why));
            } else {
                found.more += 1;
            }
        }
        if !found.parts.is_empty() {
            return Ok(());
        }
        found.together = Some(match parts {
            [part] if is_one => match self.unmet_needs(part)? {
                Some(unmet) => {
                    found.parts.push((part.clone(), unmet));
                    return Ok(());
                }
                None => self.explain_obstruction(part),
            },
            _ if all_reached => {
                "each part of the goal can be reached, but not all of them together".to_owned()
            }
            _ => UNEXPLAINED.to_owned(),
        });
        Ok(())
    }

    /// Explains why no sequence of steps reaches a part of the goal that is reachable in the
    /// relaxation. Without numbers, the only possible reason is that steps undo conditions of other
    /// steps.
    fn explain_obstruction(&self, part: &Condition) -> String {
        if let Some(undefined) = self.undefined(part) {
            return undefined;
        }
        let conditions = self.domain.actions.iter().map(|action| &action.precondition);
        let axioms = self.domain.derived.iter().map(|derived| &derived.condition);
        let mut effects = self.domain.actions.iter().map(|action| &action.effect);
        let has_numbers = conditions.chain(axioms).chain([part]).any(has_comparison)
            || effects.any(changes_numbers);
        match has_numbers {
            true => "it is proven that no sequence of steps reaches it".to_owned(),
            false => "the steps towards it undo what it needs".to_owned(),
        }
    }

    /// Names, for each action that could make a fact true, a condition for which it is proven that no
    /// sequence of steps reaches it. Returns `None` if an action has no such condition.
    fn unmet_needs(&self, part: &Condition) -> Result<Option<String>, PlanError> {
        let Some(literal) = Literal::of(part) else { return Ok(None) };
        let achievers = self.achievers(&literal);
        let mut words = Vec::new();
        for achiever in achievers.iter().filter(|_| achievers.len() <= ACHIEVERS_MAX) {
            let mut unmet = None;
            for need in achiever.needs.iter().take(SEARCHED_NEEDS_MAX) {
                let alone = Problem { goal: need.clone(), metric: None, ..self.problem.clone() };
                let outcome = crate::plan(self.domain, &alone, &self.options, self.cancel)?;
                if matches!(outcome.stop_reason, StopReason::Unsolvable { .. }) {
                    unmet = Some(need);
                    break;
                }
            }
            let Some(need) = unmet else { return Ok(None) };
            let what = achiever.what("it");
            let why = self.undefined(need).map(|why| format!(" ({why})")).unwrap_or_default();
            let need = quoted(need);
            words
                .push(format!("{what}, but needs {need}, which no sequence of steps reaches{why}"));
        }
        Ok((!words.is_empty()).then(|| words.join(", and ")))
    }

    /// Explains that a condition compares an undefined fluent that no action assigns; `None` if
    /// there is no such fluent.
    fn undefined(&self, condition: &Condition) -> Option<String> {
        let is_missing = |fluent: &&FluentTerm| {
            let is_told = |element: &InitElement| match element {
                InitElement::Assign(other, _) => other == *fluent,
                _ => false,
            };
            let is_total_cost = fluent.function == pddl::TOTAL_COST;
            let mut actions = self.domain.actions.iter();
            let gets_one = actions.any(|action| action.effect.assigns(&fluent.function));
            !is_total_cost && !gets_one && !self.problem.init.iter().any(is_told)
        };
        let is_comparison = match condition {
            Condition::Not(inner) => matches!(**inner, Condition::Compare(_)),
            other => matches!(other, Condition::Compare(_)),
        };
        if !is_comparison {
            return None;
        }
        let missing = condition.fluents().find(is_missing)?;
        Some(format!("`{missing}` has no value, and no action assigns it one"))
    }

    /// Returns the chain of reasons from a condition to a fact that no action makes true, as a
    /// clause of a sentence. Disjunctions are explained by their branches, up to the depth `depth`.
    fn chain(&self, condition: &Condition, depth: usize) -> Result<String, PlanError> {
        let mut links: Vec<String> = Vec::new();
        let mut seen: Vec<Condition> = Vec::new();
        let mut at = condition.clone();
        while links.len() < LINKS_MAX && !seen.contains(&at) && !self.cancel.is_set() {
            seen.push(at.clone());
            let subject = if links.is_empty() { "it".to_owned() } else { quoted(&at) };
            let (link, next) = self.reason(&at, &subject, depth)?;
            links.push(link);
            let Some(next) = next else { break };
            at = next;
        }
        Ok(links.join("; "))
    }

    /// Explains why an unreachable condition never holds. Also returns a missing condition of it that
    /// may be explained in turn.
    fn reason(
        &self,
        at: &Condition,
        subject: &str,
        depth: usize,
    ) -> Result<(String, Option<Condition>), PlanError> {
        if let Some(undefined) = self.undefined(at) {
            return Ok((undefined, None));
        }
        let simple = simplified(at);
        match &simple {
            Condition::Or(branches) if !branches.is_empty() && depth > 0 => {
                return Ok((self.branches(branches, depth - 1)?, None));
            }
            Condition::And(_) | Condition::Exists(..) => {
                if let Some(parts) = conjuncts_of(&simple) {
                    return self.lacking(&parts, subject);
                }
            }
            _ => (),
        }
        let Some(literal) = Literal::of(&simple) else {
            let is_number = matches!(simple, Condition::Compare(_));
            let never = if is_number { "nothing makes it true" } else { "it never holds" };
            return Ok((never.replacen("it", subject, 1), None));
        };
        if let Some(parts) = self.negated_axioms(&literal) {
            return self.lacking(&parts, subject);
        }
        if !literal.is_positive && self.is_derived(&literal) {
            return Ok((format!("{subject} never holds"), None));
        }
        let achievers = self.achievers(&literal);
        match achievers.is_empty() {
            true => Ok((self.nothing_makes(&literal, subject), None)),
            false => self.link(subject, &achievers),
        }
    }

    /// Explains why none of several conditions, of which one would suffice, is reachable.
    fn branches(&self, branches: &[Condition], depth: usize) -> Result<String, PlanError> {
        let mut words = Vec::new();
        for branch in branches.iter().take(BRANCHES_MAX) {
            words.push(format!("for {}, {}", quoted(branch), self.chain(branch, depth)?));
        }
        match branches.len().saturating_sub(BRANCHES_MAX) {
            0 => (),
            1 => words.push("one more branch never holds, either".to_owned()),
            rest => words.push(format!("{rest} more branches never hold, either")),
        }
        Ok(words.join("; "))
    }

    /// Explains which of the conditions that `subject` needs are unreachable.
    fn lacking(
        &self,
        parts: &[Condition],
        subject: &str,
    ) -> Result<(String, Option<Condition>), PlanError> {
        let blocked = self.unreachable(parts)?;
        let missing: Vec<&Condition> = blocked.iter().map(|part| &parts[*part]).collect();
        if missing.is_empty() {
            return Ok((format!("what {subject} needs never holds together"), None));
        }
        let next = missing.iter().find(|need| self.has_reason(need)).map(|need| (*need).clone());
        let listed: Vec<String> = missing.iter().map(|need| quoted(need)).collect();
        let never = never(&listed, next.is_some());
        Ok((format!("{subject} needs {}{never}", listed.join(" and ")), next))
    }

    /// Whether more can be said about an unreachable condition than that it never holds.
    fn has_reason(&self, condition: &Condition) -> bool {
        let simple = simplified(condition);
        let is_split = match &simple {
            Condition::Or(branches) => !branches.is_empty(),
            other => conjuncts_of(other).is_some(),
        };
        is_split || Literal::of(&simple).is_some() || self.undefined(condition).is_some()
    }

    /// Explains why no action makes a literal true: either no action changes its predicate in this
    /// way, or actions change the predicate only for other objects.
    fn nothing_makes(&self, literal: &Literal<'_>, subject: &str) -> String {
        let any = Literal { variables: Vec::new(), ..literal.clone() };
        let others = self.achievers(&any);
        let types = literal.types();
        if let (Some(first), false) = (others.first(), types.is_empty()) {
            let is = if literal.is_positive { "true" } else { "false" };
            let (name, atom) = (&first.name, quoted(&Condition::Atom(literal.atom.clone())));
            let types = types.join(" and ");
            return match first.is_axiom {
                true => format!("an axiom derives {atom}, but not of objects of type {types}"),
                false => format!("`{name}` makes {atom} {is}, but not of objects of type {types}"),
            };
        }
        let of_these = if self.is_changed(literal) { " of these objects" } else { "" };
        match literal.is_positive {
            false => format!("no action makes `{}` false{of_these}", literal.atom),
            true if of_these.is_empty() => {
                format!("no action makes {subject} true, and `:init` does not contain it")
            }
            true => format!("no action makes {subject} true{of_these}"),
        }
    }

    /// Describes, as text, the missing conditions of the achievers of one fact. Also returns the
    /// first missing condition, which may be explained in turn.
    fn link(
        &self,
        subject: &str,
        achievers: &[Achiever],
    ) -> Result<(String, Option<Condition>), PlanError> {
        let (mut words, mut next) = (Vec::new(), None);
        for achiever in achievers.iter().take(ACHIEVERS_MAX) {
            let mut blocked = self.unreachable(&achiever.needs)?;
            if achiever.vacant.is_some() {
                blocked.clear();
            }
            let what = achiever.what(subject);
            let listed: Vec<String> =
                blocked.iter().map(|need| quoted(&achiever.needs[*need])).collect();
            let has_reason = |need: &&usize| self.has_reason(&achiever.needs[**need]);
            let is_of_effect = blocked.iter().all(|need| *need >= achiever.effect_needs_start);
            let is_explained = blocked.iter().all(|need| has_reason(&need));
            words.push(match listed.is_empty() {
                true => format!("{what}, but {}", self.why_not(achiever)?),
                false if is_of_effect && !is_explained => format!(
                    "{what}, but the condition of its effect never holds: {}",
                    listed.join(" and ")
                ),
                false => {
                    let never = never(&listed, is_explained);
                    format!("{what}, but needs {}{never}", listed.join(" and "))
                }
            });
            if next.is_none() {
                let fact = blocked.iter().find(has_reason);
                next = fact.map(|need| achiever.needs[*need].clone());
            }
        }
        let rest = achievers.len().saturating_sub(ACHIEVERS_MAX);
        if rest > 0 {
            words.push(format!("{rest} more ways lack something, too"));
        }
        Ok((words.join(", and "), next))
    }

    /// Explains why an achiever never achieves its fact although each of its conditions alone is
    /// reachable.
    fn why_not(&self, achiever: &Achiever) -> Result<String, PlanError> {
        if let Some(Typed { name, ty }) = &achiever.vacant {
            return Ok(format!("there is no object of type `{ty}` for its `?{name}`"));
        }
        let whole = std::slice::from_ref(&achiever.whole);
        Ok(match self.unreachable(whole)?.is_empty() {
            true => "in no state that can be reached".to_owned(),
            false => "its conditions never hold together".to_owned(),
        })
    }
}

impl std::fmt::Display for Unsolvability {
    /// Writes one clause for each unreachable part of the goal, without a period.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (number, (part, why)) in self.parts.iter().enumerate() {
            let separator = if number == 0 { "" } else { "\n" };
            write!(f, "{separator}{} cannot be reached: {why}", quoted(part))?;
        }
        if self.more > 0 {
            write!(f, "\n{} more parts of the goal cannot be reached", self.more)?;
        }
        self.together.as_ref().map_or(Ok(()), |together| f.write_str(together))
    }
}

/// Returns the text of a condition in quotation marks, shortened if it is long.
fn quoted(condition: &Condition) -> String {
    let text = condition.to_string();
    let mut short: String = text.chars().take(TEXT_CHARS_MAX).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    format!("`{}`", short.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Returns the clause that says that the listed conditions never hold, unless a reason for it follows.
fn never(listed: &[String], is_explained: bool) -> &'static str {
    match listed.len() {
        _ if is_explained => "",
        1 => ", which never holds",
        _ => ", which never hold",
    }
}

/// Whether an effect changes numbers other than the total cost, or has a numeric condition.
fn changes_numbers(effect: &Effect) -> bool {
    match effect {
        Effect::And(parts) => parts.iter().any(changes_numbers),
        Effect::Add(_) | Effect::Delete(_) => false,
        Effect::Assign(assign) => assign.fluent.function != pddl::TOTAL_COST,
        Effect::When(condition, inner) => has_comparison(condition) || changes_numbers(inner),
        Effect::Forall(_, inner) => changes_numbers(inner),
    }
}
