//! The facts that agents have reported, each with the event of its last change.

use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};
use std::sync::Arc;

use super::draft::EventLink;
use super::pddl_text::{FactText, facts};
use super::recent_map::RecentMap;
use crate::event::{FALSE, UNKNOWN};

/// Maximum number of claims. Further ones are not recorded, and counted.
const CLAIMS_MAX: usize = 250_000;

/// Maximum number of facts that nobody claims any more and whose last event is known.
const FORMER_MAX: usize = 20_000;

/// Change of a fact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FactChange {
    /// The fact, without its value.
    pub(crate) fact: Arc<str>,
    /// Value before the change; `None` if it was not known.
    pub(crate) from: Option<Arc<str>>,
    /// Value after the change.
    pub(crate) to: Arc<str>,
}

/// What one agent says of a fact.
#[derive(Clone, Debug)]
struct AgentClaim {
    agent: Arc<str>,
    value: Arc<str>,
    /// Number of the report of the agent that had the fact last.
    report: u64,
    /// Whether the agent says how long the fact is known.
    expires: bool,
    event: Option<EventLink>,
}

/// The facts of all agents.
#[derive(Debug)]
pub(crate) struct FactTable {
    claims: HashMap<Arc<str>, Vec<AgentClaim>>,
    claim_count: usize,
    /// The facts that each agent has reported, with the hash of its last heartbeat.
    reports: HashMap<Arc<str>, AgentReport>,
    /// Last events of facts that nobody claims any more.
    former: RecentMap<EventLink>,
    hasher: RandomState,
    /// Number of facts that were not recorded because there are too many.
    pub(crate) dropped: u64,
}

#[derive(Debug, Default)]
struct AgentReport {
    hash: u64,
    count: u64,
    facts: Vec<Arc<str>>,
}

// === impl FactTable ===

impl FactTable {
    pub(crate) fn new() -> FactTable {
        FactTable {
            claims: HashMap::new(),
            claim_count: 0,
            reports: HashMap::new(),
            former: RecentMap::new(FORMER_MAX),
            hasher: RandomState::new(),
            dropped: 0,
        }
    }

    /// Takes all facts that an agent reports as its own, and returns the changes. A fact that was
    /// reported before and is missing does not hold any more.
    pub(crate) fn report(&mut self, agent: &Arc<str>, text: &str) -> Vec<FactChange> {
        let hash = self.hasher.hash_one(text);
        let report = self.reports.entry(Arc::clone(agent)).or_default();
        if report.count > 0 && report.hash == hash {
            return Vec::new();
        }
        report.hash = hash;
        report.count += 1;
        let count = report.count;
        let mut changes = Vec::new();
        facts(text).for_each(|fact| changes.extend(self.claim(agent, fact, count)));
        let known = self.reports.get_mut(agent).map(|report| std::mem::take(&mut report.facts));
        let mut kept = Vec::new();
        for fact in known.into_iter().flatten() {
            match self.claim_of(agent, &fact).map(|claim| (claim.report, claim.value.clone())) {
                None => (),
                Some((last, _)) if last == count => kept.push(fact),
                Some((_, value)) => {
                    self.remove(agent, &fact);
                    let to = if value.parse::<f64>().is_ok() { UNKNOWN } else { FALSE };
                    if *value != *to && !self.is_believed(&fact) {
                        let (from, to) = (Some(value), to.into());
                        changes.push(FactChange { fact: Arc::clone(&fact), from, to });
                    }
                }
            }
        }
        if let Some(report) = self.reports.get_mut(agent) {
            report.facts = kept;
            for fact in changes.iter().map(|change| &change.fact) {
                if self.claims.contains_key(fact) && !report.facts.contains(fact) {
                    report.facts.push(Arc::clone(fact));
                }
            }
        }
        changes
    }

    /// Marks facts of an agent that are known for a limited time only.
    pub(crate) fn mark_expiring<'a>(
        &mut self,
        agent: &str,
        texts: impl Iterator<Item = &'a String>,
    ) {
        for text in texts {
            for FactText { fact, .. } in facts(text) {
                let claims = self.claims.get_mut(fact).into_iter().flatten();
                claims
                    .filter(|claim| *claim.agent == *agent)
                    .for_each(|claim| claim.expires = true);
            }
        }
    }

    /// Returns the agent whose claim of a fact has expired, if the fact is believed no longer.
    pub(crate) fn expired(&self, fact: &str) -> Option<&Arc<str>> {
        let mut claims = self.claims.get(fact)?.iter();
        claims.find(|claim| claim.expires).map(|claim| &claim.agent)
    }

    /// Takes single facts of an agent, apart from its report: effects, observations.
    pub(crate) fn add(&mut self, agent: &Arc<str>, text: &str) -> Vec<FactChange> {
        let count = self.reports.get(agent).map_or(0, |report| report.count);
        let mut changes = Vec::new();
        for fact in facts(text) {
            if let Some(change) = self.claim(agent, fact, count) {
                let report = self.reports.entry(Arc::clone(agent)).or_default();
                if !report.facts.contains(&change.fact) {
                    report.facts.push(Arc::clone(&change.fact));
                }
                // The next heartbeat is compared with this.
                report.hash = 0;
                changes.push(change);
            }
        }
        changes
    }

    /// Takes back facts of an agent.
    pub(crate) fn retract(&mut self, agent: &Arc<str>, text: &str) -> Vec<FactChange> {
        let mut changes = Vec::new();
        for FactText { fact, value } in facts(text) {
            let to = if value.parse::<f64>().is_ok() { UNKNOWN } else { FALSE };
            let claimed = self.claim_of(agent, fact).map(|claim| claim.value.clone());
            let is_owner = claimed.is_some();
            let from = claimed.or_else(|| self.values(fact).next().cloned());
            self.remove(agent, fact);
            // What one owner takes back, another one may still claim.
            let is_still_claimed = is_owner && self.is_believed(fact);
            if from.as_deref() != Some(to) && !is_still_claimed {
                changes.push(FactChange { fact: fact.into(), from, to: to.into() });
            }
        }
        changes
    }

    /// Forgets what an agent has reported, because it has left, and returns the changes: what it
    /// claimed is unknown.
    pub(crate) fn forget(&mut self, agent: &str) -> Vec<FactChange> {
        let Some(report) = self.reports.remove(agent) else { return Vec::new() };
        let mut changes = Vec::new();
        for fact in report.facts {
            let Some(value) = self.claim_of(agent, &fact).map(|claim| claim.value.clone()) else {
                continue;
            };
            self.remove(agent, &fact);
            if !self.is_believed(&fact) && *value != *FALSE && *value != *UNKNOWN {
                changes.push(FactChange { fact, from: Some(value), to: UNKNOWN.into() });
            }
        }
        changes
    }

    /// Sets the event of the last change of a fact.
    pub(crate) fn set_event(&mut self, agent: &str, fact: &str, event: EventLink) {
        let claims = self.claims.get_mut(fact);
        match claims.and_then(|all| all.iter_mut().find(|claim| *claim.agent == *agent)) {
            Some(claim) => claim.event = Some(event),
            None => self.former.insert(fact, event),
        }
    }

    /// Returns the newest event of a fact; `None` if there is none.
    pub(crate) fn event_of(&self, fact: &str) -> Option<EventLink> {
        let claims = self.claims.get(fact).into_iter().flatten();
        let current = claims.filter_map(|claim| claim.event);
        current.chain(self.former.get(fact).copied()).max_by_key(|event| event.number)
    }

    /// Whether somebody claims this value of a fact.
    pub(crate) fn is_claimed(&self, fact: &FactText<'_>) -> bool {
        self.values(fact.fact).any(|value| is_same_value(value, fact.value))
    }

    /// Whether a present agent claims that a fact holds, or has a value.
    pub(crate) fn is_believed(&self, fact: &str) -> bool {
        self.values(fact).any(|value| **value != *FALSE && **value != *UNKNOWN)
    }

    /// Returns the agents that claim a fact.
    pub(crate) fn claimants(&self, fact: &str) -> impl Iterator<Item = &Arc<str>> {
        self.claims.get(fact).into_iter().flatten().map(|claim| &claim.agent)
    }

    fn values(&self, fact: &str) -> impl Iterator<Item = &Arc<str>> {
        self.claims.get(fact).into_iter().flatten().map(|claim| &claim.value)
    }

    fn claim_of(&self, agent: &str, fact: &str) -> Option<&AgentClaim> {
        self.claims.get(fact)?.iter().find(|claim| *claim.agent == *agent)
    }

    fn claim(&mut self, agent: &Arc<str>, fact: FactText<'_>, report: u64) -> Option<FactChange> {
        let FactText { fact, value } = fact;
        let claims = self.claims.get_mut(fact);
        if let Some(claim) =
            claims.and_then(|all| all.iter_mut().find(|claim| claim.agent == *agent))
        {
            claim.report = report;
            if is_same_value(&claim.value, value) {
                return None;
            }
            let from = std::mem::replace(&mut claim.value, value.into());
            let to = Arc::clone(&claim.value);
            return self.is_news(fact, &to).then(|| FactChange {
                fact: fact.into(),
                from: Some(from),
                to,
            });
        }
        if self.claim_count >= CLAIMS_MAX {
            self.dropped += 1;
            return None;
        }
        self.claim_count += 1;
        let is_news = self.is_news(fact, value);
        let (fact, to): (Arc<str>, Arc<str>) = (fact.into(), value.into());
        let claim = AgentClaim {
            agent: Arc::clone(agent),
            value: Arc::clone(&to),
            report,
            expires: false,
            event: None,
        };
        self.claims.entry(Arc::clone(&fact)).or_default().push(claim);
        if !is_news {
            self.list(agent, &fact);
        }
        is_news.then_some(FactChange { fact, from: None, to })
    }

    /// Whether a value that an agent claims changes the fact. A fact holds if any agent claims it,
    /// whoever else denies it.
    fn is_news(&self, fact: &str, value: &str) -> bool {
        (value != FALSE && value != UNKNOWN) || !self.is_believed(fact)
    }

    /// Remembers that the report of an agent has a fact.
    fn list(&mut self, agent: &Arc<str>, fact: &Arc<str>) {
        let report = self.reports.entry(Arc::clone(agent)).or_default();
        if !report.facts.contains(fact) {
            report.facts.push(Arc::clone(fact));
        }
    }

    fn remove(&mut self, agent: &str, fact: &str) {
        let Some(claims) = self.claims.get_mut(fact) else { return };
        let before = claims.len();
        claims.retain(|claim| *claim.agent != *agent);
        self.claim_count -= before - claims.len();
        if claims.is_empty() {
            self.claims.remove(fact);
        }
    }
}

/// Whether two texts have the same value: `21` and `21.0` are one number.
fn is_same_value(a: &str, b: &str) -> bool {
    a == b || matches!((a.parse::<f64>(), b.parse::<f64>()), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(changes: Vec<FactChange>) -> Vec<String> {
        let text = |change: FactChange| {
            let from = change.from.as_deref().unwrap_or("-").to_owned();
            format!("{} {from} {}", change.fact, change.to)
        };
        changes.into_iter().map(text).collect()
    }

    #[test]
    fn only_changes_are_returned() {
        let (mut table, agent) = (FactTable::new(), Arc::from("r1"));
        let first = "(at r1 hall) (= (battery r1) 80)";
        assert_eq!(told(table.report(&agent, first)), ["(at r1 hall) - true", "(battery r1) - 80"]);
        assert!(table.report(&agent, first).is_empty());
        assert!(table.report(&agent, "(at r1 hall) (= (battery r1) 80.0)").is_empty());
        let moved = table.report(&agent, "(at r1 office1)");
        let expected =
            ["(at r1 office1) - true", "(at r1 hall) true false", "(battery r1) 80 unknown"];
        assert_eq!(told(moved), expected);
        assert_eq!(told(table.report(&agent, "")), ["(at r1 office1) true false"]);
        assert!(table.report(&agent, "").is_empty());
        assert_eq!(table.claim_count, 0);
    }

    #[test]
    fn effects_are_compared_with_the_next_report() {
        let (mut table, agent) = (FactTable::new(), Arc::from("r1"));
        table.report(&agent, "(at r1 hall)");
        assert_eq!(told(table.add(&agent, "(at r1 office1)")), ["(at r1 office1) - true"]);
        assert_eq!(told(table.retract(&agent, "(at r1 hall)")), ["(at r1 hall) true false"]);
        assert!(table.report(&agent, "(at r1 office1)").is_empty());
        assert_eq!(told(table.report(&agent, "(at r1 hall)")).len(), 2);
    }

    #[test]
    fn a_fact_holds_as_long_as_any_agent_claims_it() {
        let mut table = FactTable::new();
        let (thermometer, ir) = (Arc::from("thermometer"), Arc::from("ir"));
        table.report(&thermometer, "(known office2)");
        assert_eq!(told(table.forget("thermometer")), ["(known office2) true unknown"]);
        assert_eq!(told(table.add(&ir, "(known office2)")), ["(known office2) - true"]);
        for report in
            ["(not (known office2))", "(unknown (known office2))", "", "(not (known office2))"]
        {
            assert!(table.report(&thermometer, report).is_empty(), "{report}");
        }
        assert!(table.retract(&thermometer, "(known office2)").is_empty());
        table.report(&thermometer, "(known office2)");
        assert!(table.report(&thermometer, "(not (known office2))").is_empty());
        table.report(&thermometer, "(known office2)");
        assert!(table.report(&thermometer, "").is_empty());
        assert_eq!(told(table.retract(&ir, "(known office2)")), ["(known office2) true false"]);
        table.report(&thermometer, "(not (known office2))");
        table.add(&ir, "(known office2)");
        assert_eq!(told(table.forget("ir")), ["(known office2) true unknown"]);
        table.forget("thermometer");
        assert_eq!(table.claim_count, 0);
    }

    #[test]
    fn what_an_agent_claimed_alone_is_unknown_when_it_has_left() {
        let mut table = FactTable::new();
        let (a, b) = (Arc::from("a"), Arc::from("b"));
        table.report(&a, "(lit hall) (= (temperature hall) 20) (not (open d))");
        table.report(&b, "(lit hall)");
        assert_eq!(told(table.forget("a")), ["(temperature hall) 20 unknown"]);
        assert_eq!(told(table.forget("b")), ["(lit hall) true unknown"]);
        assert_eq!(table.claim_count, 0);
        assert!(table.claims.is_empty());
    }
}
