//! Finds the event that broke a plan, from the text that reports it.

use acl::content::HistoryRoot;

use super::EventRecorder;
use super::draft::{EventCause, EventLink};
use super::pddl_text::quoted;

/// Time in which a change that somebody asked for may be what broke a plan.
const REQUEST_MS: u64 = 10_000;

impl EventRecorder {
    /// Returns the cause of a report about the goal of `conversation`. The text names, between
    /// backquotes, agents that are gone and facts that hold no longer. If it names none, the cause
    /// is a change that was asked for a moment ago, or the newest event of the goal.
    pub(super) fn breaking_event(&self, text: &str, conversation: &str, at_ms: u64) -> EventCause {
        let goal = self.goals.get(conversation);
        let plan = goal.and_then(|goal| goal.plan).map(|plan| plan.number);
        let is_news = |event: &EventLink| plan.is_none_or(|plan| event.number > plan);
        let agents: Vec<_> = quoted(text).filter_map(|name| self.agents.get(name)).collect();
        let gone = agents.iter().filter_map(|trace| trace.last_left);
        let gone = gone.map(|(_, event)| event).max_by_key(|event| event.number);
        let changed_agents = agents.iter().flat_map(|trace| trace.changes());
        let changed_agent = changed_agents.filter(is_news).max_by_key(|event| event.number);
        let facts = quoted(text).filter(|name| name.starts_with('('));
        let changed_facts = facts.filter_map(|fact| self.facts.event_of(fact));
        let changed_fact = changed_facts.filter(is_news).max_by_key(|event| event.number);
        let failed = goal.and_then(|goal| goal.failed_step);
        let asked = self
            .last_request
            .filter(|(asked, event)| at_ms.saturating_sub(*asked) <= REQUEST_MS && is_news(event));
        let found = gone
            .or(changed_agent)
            .or(failed)
            .or(changed_fact)
            .or(asked.map(|(_, event)| event))
            .or(goal.map(|goal| goal.last));
        found.map_or(EventCause::Root(HistoryRoot::Sensor), EventCause::Event)
    }
}
