//! Turns the answers of daemons to queries into events of a view.

use acl::AgentId;
use acl::content::{
    BelievedState, DiscoveryReport, GoalStatus, Mailboxes, OpenQuestion, Snapshot, StopState,
};
use agent::{Resident, Resource, RoleNames};
use bytes::Bytes;
use live_view::{AgentPlace, ViewEvent};
use serde::de::DeserializeOwned;

/// Returns the agent that is asked for a resource; `None` if all are.
pub(crate) fn agent_asked(resource: Resource, roles: &RoleNames) -> Option<AgentId> {
    match resource {
        Resource::State | Resource::Domain => Some(roles.domain_maintainer.clone()),
        Resource::Goals => Some(roles.plan_requester.clone()),
        _ => None,
    }
}

/// Returns the events of the answers to a query. Answers that cannot be read are left out: they may
/// come from a daemon of another version.
pub(crate) fn events(resource: Resource, answers: &[Bytes]) -> Vec<ViewEvent> {
    match resource {
        Resource::Directory => {
            let residents = all::<Vec<Resident>>(answers).flatten().map(place);
            vec![ViewEvent::Directory(residents.collect())]
        }
        Resource::Model => answers.iter().filter_map(message).collect(),
        Resource::Domain => first(all::<Snapshot>(answers), |it| ViewEvent::Domain(Box::new(it))),
        Resource::State => {
            first(all::<BelievedState>(answers), |it| ViewEvent::State(Box::new(it)))
        }
        Resource::Goals => first(all::<Vec<GoalStatus>>(answers), ViewEvent::Goals),
        Resource::Questions => {
            vec![ViewEvent::Questions(all::<Vec<OpenQuestion>>(answers).flatten().collect())]
        }
        Resource::Stops => vec![ViewEvent::Stops(all::<StopState>(answers).collect())],
        Resource::Mailbox => all::<Mailboxes>(answers).map(ViewEvent::Mailboxes).collect(),
        Resource::Discovered => {
            all::<DiscoveryReport>(answers).map(ViewEvent::Discovered).collect()
        }
        _ => Vec::new(),
    }
}

/// Returns an agent with its daemon, as a view has it.
pub(crate) fn place(resident: Resident) -> AgentPlace {
    let Resident { agent, daemon, incarnation } = resident;
    AgentPlace { agent, daemon, incarnation }
}

fn message(answer: &Bytes) -> Option<ViewEvent> {
    acl::decode(answer).ok().map(|message| ViewEvent::Message(Box::new(message)))
}

fn all<T: DeserializeOwned>(answers: &[Bytes]) -> impl Iterator<Item = T> {
    answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok())
}

fn first<T>(mut answers: impl Iterator<Item = T>, event: fn(T) -> ViewEvent) -> Vec<ViewEvent> {
    answers.next().map(event).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_that_cannot_be_read_are_left_out() {
        let garbage = ["", "{", "null", "[1]", "\"x\"", "{\"daemon\":7}"].map(Bytes::from);
        for poll in super::super::POLLS {
            let events = events(poll.resource, &garbage);
            assert!(events.len() <= 1, "{:?}: {events:?}", poll.resource);
        }
    }
}
