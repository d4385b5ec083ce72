//! Explanations for people: the reason why there is no plan, the reason why these agents were
//! chosen, and the changes since the last plan. All functions in this module are pure: they convert
//! results of the other modules to text.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use acl::content::{Offer, Proposal};
use goal_lifecycle::AvoidedActions;
use pddl::{ActionSchema, Atom, Condition, Effect, InitElement, Name};
use planner::explain::Explanation;

use crate::planning_snapshot::PlanningSnapshot;
use crate::selection::{Bids, Selection};

/// Maximum number of items of one kind that are listed by name; the others are only counted.
const NAMED_MAX: usize = 3;

/// Returns the reason why a goal cannot be reached; `None` if the delete relaxation (planning as if
/// no action undid another) shows no obstacle.
pub(crate) fn obstacles(explanation: &Explanation, known: &PlanningSnapshot) -> Option<String> {
    if explanation.obstacles.is_empty() {
        return None;
    }
    let not_composed = listed(known.not_composed.iter().cloned().collect(), "; ");
    let not_composed = match not_composed.as_str() {
        "" => String::new(),
        told => format!(" (not composed: {told})"),
    };
    let stopped = describe_stopped(known);
    Some(format!("{explanation}{}{not_composed}{stopped}", describe_avoided(&known.avoided)))
}

/// Returns the agents that are stopped, in parentheses; an empty string if there are none.
fn describe_stopped(known: &PlanningSnapshot) -> String {
    let stopped = known.problem.init.iter().filter_map(|element| match element {
        InitElement::Atom(atom) if atom.predicate == "stopped" => {
            atom.arguments.first().map(|agent| format!("`{agent}`"))
        }
        _ => None,
    });
    let stopped = listed(stopped.collect(), ", ");
    if stopped.is_empty() {
        return stopped;
    }
    format!(" (stopped: {stopped}; `althing stop --list` tells by whom, `--release` ends it)")
}

/// Returns the avoided actions and their reasons, in parentheses; an empty string if there are
/// none.
pub(crate) fn describe_avoided(avoided: &AvoidedActions) -> String {
    let told = avoided.iter().map(|((agent, action), held)| {
        let again = if held.is_withdrawn {
            "failed, and is not offered any more"
        } else if held.is_for_good {
            "is not asked for again"
        } else {
            "failed a moment ago and will be tried again"
        };
        format!("`{action}` of `{agent}` {again}: {}", held.why)
    });
    let told = listed(told.collect(), "; ");
    if told.is_empty() { told } else { format!(" ({told})") }
}

/// Returns, as text for a person, the reason why the agents of the chosen proposals were chosen,
/// and the bids, refusals and missing answers of the other agents. Returns `None` if no other agent
/// bid, refused or failed to answer.
pub(crate) fn describe_choice(
    chosen: &Selection,
    bids: &Bids,
    refusals: &BTreeMap<AgentId, String>,
    silent: &BTreeSet<AgentId>,
) -> Option<String> {
    let winners: BTreeSet<&AgentId> = chosen.chosen.iter().map(|(agent, _)| agent).collect();
    let mut has_others = false;
    let mut sentences = Vec::new();
    for (agent, proposal) in &chosen.chosen {
        let others: Vec<String> = { bids.iter() }
            .filter(|(other, _)| *other != agent)
            .filter_map(|(other, proposals)| {
                let (shared, best) = closest(proposal, proposals)?;
                let part = if shared == proposal.covers.len() {
                    String::new()
                } else {
                    format!(" for {shared} of them")
                };
                Some(format!("`{other}` bid {}{part}", best.cost))
            })
            .collect();
        has_others |= !others.is_empty();
        let others = listed(others, ", ");
        let others = if others.is_empty() { others } else { format!(" ({others})") };
        let covers = proposal.covers.iter().map(|conjunct| format!("`{conjunct}`")).collect();
        let covers = listed(covers, " and ");
        sentences.push(format!("`{agent}` for {covers} at cost {}{others}", proposal.cost));
    }
    let declined = refusals.iter().filter(|(agent, _)| !winners.contains(agent));
    let declined: Vec<String> = declined.map(|(agent, why)| format!("`{agent}`: {why}")).collect();
    let silent: Vec<String> = silent.iter().map(|agent| format!("`{agent}`")).collect();
    if !has_others && declined.is_empty() && silent.is_empty() {
        return None;
    }
    let mut text = format!("chosen: {}", listed(sentences, "; "));
    for (what, who) in [("declined", declined), ("did not answer", silent)] {
        if !who.is_empty() {
            text += &format!("; {what}: {}", listed(who, ", "));
        }
    }
    Some(text)
}

/// Returns the proposal among `others` that shares the most conjuncts with the chosen proposal, and
/// the number of shared conjuncts. Of several such proposals, returns the cheapest. Returns `None`
/// if no proposal shares a conjunct.
fn closest<'a>(chosen: &Proposal, others: &'a [Proposal]) -> Option<(usize, &'a Proposal)> {
    let shared = |other: &Proposal| {
        other.covers.iter().filter(|conjunct| chosen.covers.contains(conjunct)).count()
    };
    { others.iter() }
        .map(|other| (shared(other), other))
        .filter(|(shared, _)| *shared > 0)
        .max_by(|(one, first), (two, second)| one.cmp(two).then(second.cost.total_cmp(&first.cost)))
}

/// The facts and offered actions that concerned a goal in one round of planning. The next round
/// reports the changes since then.
#[derive(Clone, Debug, Default)]
pub(crate) struct GoalContext {
    /// Agents that offer at least one action.
    agents: BTreeSet<AgentId>,
    /// Preconditions and effects of each action, by the agent that offers the action and by the
    /// action's name.
    offers: BTreeMap<(AgentId, String), String>,
    facts: BTreeSet<String>,
}

// === impl GoalContext ===

impl GoalContext {
    /// Collects the offered actions that could contribute to a goal, and the facts that the goal or
    /// these actions use.
    pub(crate) fn of(known: &PlanningSnapshot, goal: &Condition) -> GoalContext {
        let relevant = RelevantSymbols::to(known, goal);
        let guards: BTreeSet<&Name> = known.guards.values().map(|guard| &guard.predicate).collect();
        let schemas: BTreeMap<&str, String> = { known.domain.actions.iter() }
            .map(|schema| (schema.name.as_str(), meaning(schema, &guards)))
            .collect();
        let of_agent = |(agent, actions): (&AgentId, &BTreeMap<String, Offer>)| {
            let meaning = |offer: &Offer| schemas.get(&*offer.schema).cloned().unwrap_or_default();
            let named = |(action, offer): (&String, &Offer)| {
                ((agent.clone(), action.clone()), meaning(offer))
            };
            let concerns = |(_, offer): &(&String, &Offer)| relevant.has_action(&offer.schema);
            actions.iter().filter(concerns).map(named).collect::<Vec<_>>()
        };
        let is_fact =
            |atom: &&Atom| !guards.contains(&atom.predicate) && relevant.has(&atom.predicate);
        GoalContext {
            agents: known.all_offers.keys().cloned().collect(),
            offers: known.all_offers.iter().flat_map(of_agent).collect(),
            facts: atoms(known).filter(is_fact).map(ToString::to_string).collect(),
        }
    }

    /// Returns the differences between the earlier context `self` and the present context `now`, as
    /// text for a person; `None` if there are none. Facts that actions can change are left out,
    /// unless they are among the `open` conjuncts of the goal.
    pub(crate) fn describe_changes(
        &self,
        now: &GoalContext,
        known: &PlanningSnapshot,
        open: &[Condition],
    ) -> Option<String> {
        let offering = |seen: &GoalContext| -> BTreeSet<AgentId> {
            seen.offers.keys().map(|(agent, _)| agent.clone()).collect()
        };
        let (before, after) = (&self.agents, &now.agents);
        let name = |agent: &AgentId| format!("`{agent}`");
        let left: Vec<String> = offering(self).difference(after).map(name).collect();
        let joined: Vec<String> = offering(now).difference(before).map(name).collect();
        let of = |(agent, action): &(AgentId, String)| format!("`{action}` of `{agent}`");
        let here = self.offers.iter().filter(|((agent, _), _)| after.contains(agent));
        let withdrawn = here.clone().filter(|(offer, _)| !now.offers.contains_key(*offer));
        let is_other = |(offer, meaning): &(&(AgentId, String), &String)| {
            now.offers.get(*offer).is_some_and(|now| now != *meaning)
        };
        let other = here.filter(is_other).map(|(offer, _)| of(offer)).collect();
        let open: BTreeSet<String> = open.iter().map(ToString::to_string).collect();
        let changing = changing(known);
        let lasts =
            |fact: &&String| open.contains(*fact) || !changing.iter().any(|name| is_of(fact, name));
        // Whether a fact still holds does not depend on the actions that are offered now, as whether
        // it is relevant does.
        let holding: BTreeSet<String> = atoms(known).map(ToString::to_string).collect();
        let retracted = self.facts.difference(&holding).filter(lasts);
        let parts = [
            ("offers nothing now", left),
            ("offers something now", joined),
            ("is not offered now", withdrawn.map(|(offer, _)| of(offer)).collect()),
            ("takes or does something else now", other),
            ("does not hold any more", retracted.map(|fact| format!("`{fact}`")).collect()),
        ];
        let told: Vec<String> = parts
            .into_iter()
            .filter(|(_, things)| !things.is_empty())
            .map(|(what, things)| format!("{what}: {}", listed(things, ", ")))
            .collect();
        (!told.is_empty()).then(|| format!("since the last plan, {}", told.join("; ")))
    }
}

/// Returns the facts of the present state that are true.
fn atoms(known: &PlanningSnapshot) -> impl Iterator<Item = &Atom> {
    known.problem.init.iter().filter_map(|element| match element {
        InitElement::Atom(atom) => Some(atom),
        _ => None,
    })
}

/// Symbols and actions that may matter to a goal: the symbols of the goal, every action that
/// changes one of these symbols, the symbols in the preconditions of these actions, and so on,
/// transitively.
struct RelevantSymbols<'k> {
    symbols: BTreeSet<&'k Name>,
    actions: BTreeSet<&'k Name>,
}

// === impl RelevantSymbols ===

impl<'k> RelevantSymbols<'k> {
    fn to(known: &'k PlanningSnapshot, goal: &'k Condition) -> RelevantSymbols<'k> {
        let mut symbols = BTreeSet::new();
        symbols.extend(goal.symbols());
        let mut actions = BTreeSet::new();
        loop {
            let before = (symbols.len(), actions.len());
            for axiom in &known.domain.derived {
                if symbols.contains(&axiom.predicate) {
                    symbols.extend(axiom.condition.symbols());
                }
            }
            for action in &known.domain.actions {
                if !actions.contains(&action.name) && touches(&action.effect, &symbols) {
                    actions.insert(&action.name);
                    symbols.extend(action.precondition.symbols());
                }
            }
            if (symbols.len(), actions.len()) == before {
                return RelevantSymbols { symbols, actions };
            }
        }
    }

    fn has_action(&self, inside: &str) -> bool {
        self.actions.contains(&Name::new(inside))
    }

    fn has(&self, symbol: &Name) -> bool {
        self.symbols.contains(symbol)
    }
}

/// Returns `true` if `effect` changes any of `symbols`.
fn touches(effect: &Effect, symbols: &BTreeSet<&Name>) -> bool {
    effect.parts().any(|part| match part {
        Effect::Add(atom) | Effect::Delete(atom) => symbols.contains(&atom.predicate),
        Effect::Assign(assign) => symbols.contains(&assign.fluent.function),
        Effect::And(_) | Effect::Forall(..) | Effect::When(..) => false,
    })
}

/// Returns the parameters, the precondition and the effect of an action schema as text, without the
/// name of the action and without guards (the facts that let one agent use an action).
fn meaning(schema: &ActionSchema, guards: &BTreeSet<&Name>) -> String {
    let is_guard = |part: &Condition| matches!(part, Condition::Atom(atom) if guards.contains(&atom.predicate));
    let parts = match &schema.precondition {
        Condition::And(parts) => parts.clone(),
        other => vec![other.clone()],
    };
    let takes: Vec<_> =
        parts.iter().filter(|part| !is_guard(part)).map(ToString::to_string).collect();
    let parameters: Vec<_> =
        schema.all_parameters().map(|parameter| parameter.name.to_string()).collect();
    format!("{}: {} → {}", parameters.join(" "), takes.join(" "), schema.effect)
}

/// Returns the names of the predicates that actions change.
fn changing(known: &PlanningSnapshot) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for action in &known.domain.actions {
        changed_by(&action.effect, &mut names);
    }
    names
}

fn changed_by(effect: &Effect, names: &mut BTreeSet<String>) {
    match effect {
        Effect::Add(atom) | Effect::Delete(atom) => {
            names.insert(atom.predicate.to_string());
        }
        Effect::And(parts) => parts.iter().for_each(|part| changed_by(part, names)),
        Effect::Forall(_, inner) | Effect::When(_, inner) => changed_by(inner, names),
        Effect::Assign(_) => (),
    }
}

/// Returns `true` if a fact, given as text, is an atom of `predicate`.
fn is_of(fact: &str, predicate: &str) -> bool {
    let inner = fact.trim_start_matches('(').trim_end_matches(')');
    inner.split(' ').next().is_some_and(|first| first.eq_ignore_ascii_case(predicate))
}

/// Joins sentences about parts of one goal. At most [`NAMED_MAX`] sentences are included.
pub(crate) fn listed_all(sentences: impl Iterator<Item = String>) -> String {
    listed(sentences.collect(), ". Also, ")
}

/// Joins the first [`NAMED_MAX`] of `things`, and appends the number of the others.
pub(crate) fn listed(mut things: Vec<String>, separator: &str) -> String {
    let rest = things.len().saturating_sub(NAMED_MAX);
    things.truncate(NAMED_MAX);
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("{}{more}", things.join(separator))
}

#[cfg(test)]
mod tests {
    use acl::content::{Guard, Snapshot};

    use planner::Cancel;

    use super::*;
    use goal_lifecycle::AvoidedAction;

    const DOMAIN: &str = "(define (domain d) (:requirements :typing) (:types room sensor)
        (:predicates (known ?r - room) (open ?r - room) (in ?s - sensor ?r - room)
            (offers-measure ?s - sensor))
        (:action measure :agent ?s - sensor :parameters (?r - room)
            :precondition (and (offers-measure ?s) (in ?s ?r) (open ?r)) :effect (known ?r)))";

    fn id(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn known(agents: &[&str], facts: &str, avoided: &AvoidedActions) -> PlanningSnapshot {
        known_in(DOMAIN, agents, facts, avoided)
    }

    fn known_in(
        domain: &str,
        agents: &[&str],
        facts: &str,
        avoided: &AvoidedActions,
    ) -> PlanningSnapshot {
        let snapshot = snapshot(domain, agents, facts, BTreeMap::new());
        PlanningSnapshot::read(snapshot).expect("PDDL").without_avoided(avoided.clone())
    }

    fn snapshot(
        domain: &str,
        agents: &[&str],
        facts: &str,
        conflicts: BTreeMap<AgentId, Vec<String>>,
    ) -> Snapshot {
        let guard = |agent: &str| format!("(offers-measure {agent})");
        let guards: Vec<String> = agents.iter().map(|agent| guard(agent)).collect();
        let offer = |agent: &&str| {
            let (schema, method) = ("measure".to_owned(), None);
            let offer = Offer { schema, guard: guard(agent), method, agents: 1 };
            (id(agent), [("measure".to_owned(), offer)].into())
        };
        let (outside, predicate) = ("measure".to_owned(), "offers-measure".to_owned());
        Snapshot {
            epoch: 1,
            revision: 1,
            domain: domain.to_owned(),
            digest: String::new(),
            problem: format!(
                "(define (problem p) (:domain d) (:objects a b - sensor hall lab - room)
                    (:init {facts} {}) (:goal (and)))",
                guards.join(" ")
            ),
            offers: agents.iter().map(offer).collect(),
            guards: [("measure".to_owned(), Guard { action: outside, predicate })].into(),
            former: Vec::new(),
            knowledge: BTreeMap::new(),
            conflicts,
        }
    }

    fn goal(text: &str) -> Vec<Condition> {
        vec![pddl::parse_condition(text).into_result().expect("a condition")]
    }

    fn proposal(covers: &[&str], cost: f64) -> Proposal {
        let covers = covers.iter().map(|conjunct| (*conjunct).to_owned()).collect();
        Proposal { covers, plan: String::new(), cost }
    }

    #[test]
    fn an_avoided_action_is_reported_with_the_obstacle() {
        let held = |is_for_good| AvoidedAction {
            why: "`a` is stuck".to_owned(),
            is_for_good,
            is_withdrawn: false,
        };
        let avoided: AvoidedActions = [((id("a"), "measure".to_owned()), held(false))].into();
        let known = known(&["a"], "(in a hall) (open hall)", &avoided);
        let explanation = known.explain(&goal("(known hall)"), &Cancel::new()).expect("explained");
        assert_eq!(
            obstacles(&explanation, &known).expect("an obstacle"),
            "no agent can `measure` at `hall`; `a` does not offer `measure` now; a sensor there \
             would do (`measure` of `a` failed a moment ago and will be tried again: `a` is stuck)"
        );
        let for_good: AvoidedActions = [((id("a"), "measure".to_owned()), held(true))].into();
        assert_eq!(
            describe_avoided(&for_good),
            " (`measure` of `a` is not asked for again: `a` is stuck)"
        );
        let known = self::known(&["a"], "(in a hall) (open hall)", &AvoidedActions::new());
        let explanation = known.explain(&goal("(known hall)"), &Cancel::new()).expect("explained");
        assert_eq!(obstacles(&explanation, &known), None);
    }

    #[test]
    fn stopped_agents_are_reported_with_the_obstacle() {
        let declared = "(stopped ?a - object) (offers-measure ?s - sensor))";
        let domain = DOMAIN.replacen("(offers-measure ?s - sensor))", declared, 1);
        let known = known_in(&domain, &[], "(stopped a) (open hall)", &AvoidedActions::new());
        let explanation = known.explain(&goal("(known hall)"), &Cancel::new()).expect("explained");
        let obstacle = obstacles(&explanation, &known).expect("an obstacle");
        assert!(obstacle.contains(" (stopped: `a`; `althing stop --list`"), "{obstacle}");
    }

    #[test]
    fn an_action_that_is_not_composed_is_reported_with_the_obstacle() {
        let told = "action `clean` of `a`: it uses the predicate `dust`, which is not declared";
        let (action, fact) = (told.to_owned(), "fact about `dust` of `a`: it is odd".to_owned());
        let snapshot = snapshot(DOMAIN, &[], "", [(id("a"), vec![action, fact])].into());
        let known = PlanningSnapshot::read(snapshot).expect("PDDL");
        let explanation = known.explain(&goal("(known hall)"), &Cancel::new()).expect("explained");
        let obstacle = obstacles(&explanation, &known).expect("an obstacle");
        assert!(obstacle.ends_with(&format!(" (not composed: {told})")), "{obstacle}");
    }

    #[test]
    fn a_choice_is_explained_with_the_other_bids_and_refusals() {
        let bids: Bids = [
            (id("a"), vec![proposal(&["(x)"], 2.0), proposal(&["(x)", "(y)"], 3.0)]),
            (id("b"), vec![proposal(&["(x)"], 2.5), proposal(&["(y)"], 1.5)]),
            (id("c"), vec![proposal(&["(x)", "(y)"], 7.0)]),
        ]
        .into();
        let selection = Selection { chosen: vec![(id("a"), proposal(&["(x)", "(y)"], 3.0))] };
        let refusals = [(id("d"), "no plan reaches it".to_owned())].into();
        assert_eq!(
            describe_choice(&selection, &bids, &refusals, &[id("e")].into()).expect("others"),
            "chosen: `a` for `(x)` and `(y)` at cost 3 (`b` bid 1.5 for 1 of them, `c` bid 7); \
             declined: `d`: no plan reaches it; did not answer: `e`"
        );
        let alone: Bids = [(id("a"), vec![proposal(&["(x)", "(y)"], 3.0)])].into();
        assert_eq!(describe_choice(&selection, &alone, &BTreeMap::new(), &BTreeSet::new()), None);
    }

    /// Returns the changes that are reported for a goal between two rounds of planning.
    fn news(
        before: &PlanningSnapshot,
        after: &PlanningSnapshot,
        goal: &Condition,
        open: &[Condition],
    ) -> Option<String> {
        GoalContext::of(before, goal).describe_changes(&GoalContext::of(after, goal), after, open)
    }

    #[test]
    fn changes_of_lasting_facts_and_open_conjuncts_are_reported() {
        let none = AvoidedActions::new();
        let before = known(&["a"], "(open hall) (known hall) (known lab)", &none);
        let open = goal("(known hall)");
        let [wanted] = open.as_slice() else { panic!("one part") };
        let after = known(&["b"], "(in b hall)", &none);
        assert_eq!(
            news(&before, &after, wanted, &open).expect("news"),
            "since the last plan, offers nothing now: `a`; offers something now: `b`; does not \
             hold any more: `(known hall)`, `(open hall)`"
        );
        let same = known(&["a"], "(open hall) (known hall)", &none);
        assert_eq!(news(&before, &same, wanted, &[]), None);
        let locked = DOMAIN.replace("(open ?r))", "(open ?r) (in ?s hall))");
        let other = known_in(&locked, &["a"], "(open hall) (known hall) (known lab)", &none);
        assert_eq!(
            news(&before, &other, wanted, &[]).expect("news"),
            "since the last plan, takes or does something else now: `measure` of `a`"
        );
    }

    #[test]
    fn changes_irrelevant_to_a_goal_are_not_reported() {
        let none = AvoidedActions::new();
        let before = known(&["a"], "(open hall) (in a hall)", &none);
        let after = known(&["b"], "(in a hall)", &none);
        // No action contributes to the goal of an open door.
        let open = goal("(open hall)");
        assert_eq!(
            news(&before, &after, &open[0], &open).as_deref(),
            Some("since the last plan, does not hold any more: `(open hall)`")
        );
        assert_eq!(news(&before, &after, &goal("(in a hall)")[0], &[]), None);
    }

    #[test]
    fn a_fact_that_no_offered_action_uses_any_more_still_holds() {
        let none = AvoidedActions::new();
        let before = known(&["a"], "(open hall)", &none);
        // No agent offers an action: the composite domain has none.
        let actions = DOMAIN.find("(:action").expect("the domain has an action");
        let after = known_in(&format!("{})", &DOMAIN[..actions]), &[], "(open hall)", &none);
        assert_eq!(
            news(&before, &after, &goal("(known hall)")[0], &[]).as_deref(),
            Some("since the last plan, offers nothing now: `a`")
        );
    }
}
