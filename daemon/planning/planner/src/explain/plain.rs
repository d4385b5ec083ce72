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

use pddl::{
    Atom, Condition, Domain, Effect, FluentTerm, InitElement, Name, Problem, Term, TypeExpr, Typed,
    Types,
};

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
        found.parts.push((parts[*part].clone(), why.chain(&parts[*part])?));
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
struct UnsolvabilityExplainer<'w> {
    domain: &'w Domain,
    problem: &'w Problem,
    types: Types,
    options: Options,
    cancel: &'w Cancel,
}

/// An action or an axiom that could make a fact true.
struct Achiever {
    name: Name,
    is_axiom: bool,
    /// Conjuncts of the achiever's conditions, with the objects of the fact. Other variables are
    /// existentially quantified.
    needs: Vec<Condition>,
    /// Conjunction of all conditions of the achiever, for the same objects.
    whole: Condition,
    /// A parameter of the achiever without an object of its type; `None` if every parameter has
    /// one.
    vacant: Option<Typed>,
}

/// Replacements of variables: each entry is a variable and the term that replaces it.
type TermBindings = Vec<(Name, Term)>;

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
                found.parts.push((part.clone(), self.explain_obstruction(part)));
            } else {
                found.more += 1;
            }
        }
        if found.parts.is_empty() {
            found.together = Some(match parts {
                [part] if is_one => self.explain_obstruction(part),
                _ if all_reached => {
                    "each part of the goal can be reached, but not all of them together".to_owned()
                }
                _ => UNEXPLAINED.to_owned(),
            });
        }
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
        let Condition::Compare(_) = condition else { return None };
        let missing = condition.fluents().find(is_missing)?;
        Some(format!("`{missing}` has no value, and no action assigns it one"))
    }

    /// Returns the chain of reasons from a condition to a fact that no action makes true, as a
    /// clause of a sentence.
    fn chain(&self, condition: &Condition) -> Result<String, PlanError> {
        let mut links: Vec<String> = Vec::new();
        let mut seen: Vec<Condition> = Vec::new();
        let mut at = condition.clone();
        while links.len() < LINKS_MAX && !seen.contains(&at) && !self.cancel.is_set() {
            seen.push(at.clone());
            let subject = if links.is_empty() { "it".to_owned() } else { quoted(&at) };
            let Some(atom) = wanted(&at) else {
                let undefined = self.undefined(&at);
                links.push(undefined.unwrap_or_else(|| format!("nothing makes {subject} true")));
                break;
            };
            let achievers = self.achievers(atom);
            if achievers.is_empty() {
                links.push(self.nothing_makes(atom, &subject));
                break;
            }
            let (link, next) = self.link(&subject, &achievers)?;
            links.push(link);
            let Some(next) = next else { break };
            at = next;
        }
        Ok(links.join("; "))
    }

    /// Explains why no action makes an atom true: either no action adds its predicate, or actions
    /// add the predicate only for other objects.
    fn nothing_makes(&self, atom: &Atom, subject: &str) -> String {
        let name = &atom.predicate;
        let mut is_changed = self.domain.derived.iter().any(|axiom| axiom.predicate == *name);
        for action in &self.domain.actions {
            added(&action.effect, &mut Vec::new(), &mut |other, _| {
                is_changed |= other.predicate == *name;
            });
        }
        match is_changed {
            true => format!("no action makes {subject} true of these objects"),
            false => format!("no action makes {subject} true, and `:init` does not contain it"),
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
            let name = &achiever.name;
            let verb = if achiever.is_axiom { "derives" } else { "makes" };
            let what = match achiever.is_axiom {
                true => format!("an axiom {verb} {subject}"),
                false => format!("`{name}` {verb} {subject} true"),
            };
            let listed: Vec<String> =
                blocked.iter().map(|need| quoted(&achiever.needs[*need])).collect();
            let is_fact = |need: &usize| wanted(&achiever.needs[*need]).is_some();
            let never = match listed.len() {
                _ if blocked.iter().all(is_fact) => "",
                1 => ", which never holds",
                _ => ", which never hold",
            };
            words.push(match listed.is_empty() {
                true => format!("{what}, but {}", self.why_not(achiever)?),
                false => format!("{what}, but needs {}{never}", listed.join(" and ")),
            });
            if next.is_none() {
                let fact = blocked.iter().find(|need| is_fact(need));
                next = fact.map(|need| achiever.needs[*need].clone());
            }
        }
        let rest = achievers.len().saturating_sub(ACHIEVERS_MAX);
        if rest > 0 {
            words.push(format!("{rest} more ways lack something, too"));
        }
        Ok((words.join(", and "), next))
    }

    /// Explains why an achiever is never applicable although each of its conditions alone is
    /// reachable.
    fn why_not(&self, achiever: &Achiever) -> Result<String, PlanError> {
        if let Some(Typed { name, ty }) = &achiever.vacant {
            return Ok(format!("there is no object of type `{ty}` for its `?{name}`"));
        }
        let whole = std::slice::from_ref(&achiever.whole);
        Ok(match self.unreachable(whole)?.is_empty() {
            true => "it can never be applied".to_owned(),
            false => "its conditions never hold together".to_owned(),
        })
    }

    /// Returns the first unbound parameter without an object of its type; `None` if there is none.
    fn vacant(&self, bindings: &TermBindings, parameters: &[&Typed]) -> Option<Typed> {
        let free =
            parameters.iter().filter(|one| !bindings.iter().any(|(name, _)| *name == one.name));
        let declared = || self.problem.objects.iter().map(|declaration| &declaration.object);
        let is_empty = |one: &&&Typed| {
            let mut all = self.domain.constants.iter().chain(declared());
            !all.any(|object| self.types.holds(&one.ty, &object.ty))
        };
        { free }.find(is_empty).map(|one| (**one).clone())
    }

    /// Returns every action and axiom with an effect that unifies with the atom.
    fn achievers(&self, atom: &Atom) -> Vec<Achiever> {
        let mut achievers: Vec<Achiever> = Vec::new();
        for action in &self.domain.actions {
            added(&action.effect, &mut Vec::new(), &mut |effect, conditions| {
                let parameters: Vec<&Typed> = action.all_parameters().collect();
                if effect.predicate != atom.predicate {
                    return;
                }
                let bindings = self.unify(&effect.arguments, &atom.arguments, &parameters);
                let Some(bindings) = bindings else { return };
                let all = std::iter::once(&action.precondition).chain(conditions.iter().copied());
                let whole = whole(all.clone(), &bindings, &parameters);
                let needs = self.needs(all, &bindings, &parameters);
                let vacant = self.vacant(&bindings, &parameters);
                let name = action.name.clone();
                achievers.push(Achiever { name, is_axiom: false, needs, whole, vacant });
            });
        }
        for axiom in self.domain.derived.iter().filter(|one| one.predicate == atom.predicate) {
            let parameters: Vec<&Typed> = axiom.parameters.iter().collect();
            let terms: Vec<Term> =
                parameters.iter().map(|one| Term::Variable(one.name.clone())).collect();
            if let Some(bindings) = self.unify(&terms, &atom.arguments, &parameters) {
                let body = std::iter::once(&axiom.condition);
                let whole = whole(body.clone(), &bindings, &parameters);
                let needs = self.needs(body, &bindings, &parameters);
                let vacant = self.vacant(&bindings, &parameters);
                let name = axiom.predicate.clone();
                achievers.push(Achiever { name, is_axiom: true, needs, whole, vacant });
            }
        }
        achievers
    }

    /// Returns the bindings of `parameters` that make an effect with the arguments `own` equal to
    /// an atom with the arguments `wanted`; `None` if there are none.
    fn unify(&self, own: &[Term], wanted: &[Term], parameters: &[&Typed]) -> Option<TermBindings> {
        if own.len() != wanted.len() {
            return None;
        }
        let mut bindings: TermBindings = Vec::new();
        for (own, wanted) in own.iter().zip(wanted) {
            let Term::Object(object) = wanted else { continue };
            match own {
                Term::Object(other) if other != object => return None,
                Term::Object(_) => (),
                Term::Variable(name) => {
                    let known = bindings.iter().find(|(bound, _)| bound == name);
                    if known.is_some_and(|(_, term)| term != wanted) {
                        return None;
                    }
                    let parameter = parameters.iter().find(|one| one.name == *name);
                    if parameter.is_some_and(|one| !self.is_of(object, &one.ty)) {
                        return None;
                    }
                    bindings.push((name.clone(), wanted.clone()));
                }
            }
        }
        Some(bindings)
    }

    fn is_of(&self, object: &Name, ty: &TypeExpr) -> bool {
        let declared = self.problem.objects.iter().map(|declaration| &declaration.object);
        let mut all = self.domain.constants.iter().chain(declared);
        all.any(|one| one.name == *object && self.types.holds(ty, &one.ty))
    }

    /// Returns the conjuncts of conditions. Bound variables are replaced by their terms, and free
    /// variables are quantified.
    fn needs<'c>(
        &self,
        conditions: impl Iterator<Item = &'c Condition>,
        bindings: &TermBindings,
        parameters: &[&Typed],
    ) -> Vec<Condition> {
        let mut parts = Vec::new();
        conditions.for_each(|condition| flatten(condition, &mut parts));
        let close = |part: &Condition| {
            let part = substituted(part, bindings);
            let free: Vec<Typed> = { parameters.iter() }
                .filter(|one| !bindings.iter().any(|(name, _)| *name == one.name))
                .filter(|one| mentions(&part, &one.name))
                .map(|one| (*one).clone())
                .collect();
            match free.is_empty() {
                true => part,
                false => Condition::Exists(free, Box::new(part)),
            }
        };
        let mut needs: Vec<Condition> = Vec::new();
        for need in parts.into_iter().map(close) {
            if !needs.contains(&need) {
                needs.push(need);
            }
        }
        needs
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

/// Returns the atom of a condition that is an atom, or an `exists` over an atom; `None` for other
/// conditions.
fn wanted(condition: &Condition) -> Option<&Atom> {
    match condition {
        Condition::Atom(atom) => Some(atom),
        Condition::Exists(_, inner) => wanted(inner),
        _ => None,
    }
}

fn flatten<'c>(condition: &'c Condition, parts: &mut Vec<&'c Condition>) {
    match condition {
        Condition::And(all) => all.iter().for_each(|part| flatten(part, parts)),
        other => parts.push(other),
    }
}

/// Calls `visit` for every atom that an effect adds, with the conditions of the `when`s around it.
fn added<'e>(
    effect: &'e Effect,
    conditions: &mut Vec<&'e Condition>,
    visit: &mut dyn FnMut(&'e Atom, &[&'e Condition]),
) {
    match effect {
        Effect::And(parts) => parts.iter().for_each(|part| added(part, conditions, visit)),
        Effect::Add(atom) => visit(atom, conditions),
        Effect::Delete(_) | Effect::Assign(_) => (),
        // The variables of the `forall` could be confused with others, so conditions that use them
        // are omitted.
        Effect::Forall(_, inner) => {
            let mut none = Vec::new();
            added(inner, &mut none, &mut |atom, _| visit(atom, &[]));
        }
        Effect::When(condition, inner) => {
            conditions.push(condition);
            added(inner, conditions, visit);
            conditions.pop();
        }
    }
}

fn substituted(condition: &Condition, bindings: &TermBindings) -> Condition {
    let mut names = crate::validate::bindings::Bindings::default();
    for (name, term) in bindings {
        names.bind(name, term.name().clone());
    }
    names.substitute(condition)
}

/// Whether a condition contains a variable. If so, substituting the variable changes the condition.
fn mentions(condition: &Condition, variable: &Name) -> bool {
    let mut names = crate::validate::bindings::Bindings::default();
    names.bind(variable, Name::new(""));
    names.substitute(condition) != *condition
}

/// Returns the conjunction of all conditions, so that they are checked for the same objects.
fn whole<'c>(
    conditions: impl Iterator<Item = &'c Condition>,
    bindings: &TermBindings,
    parameters: &[&Typed],
) -> Condition {
    let all = conditions.map(|condition| substituted(condition, bindings)).collect();
    let is_free = |one: &&&Typed| !bindings.iter().any(|(name, _)| *name == one.name);
    let free: Vec<Typed> = parameters.iter().filter(is_free).map(|one| (*one).clone()).collect();
    match free.is_empty() {
        true => Condition::And(all),
        false => Condition::Exists(free, Box::new(Condition::And(all))),
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
