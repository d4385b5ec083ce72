//! Checks the commands to actuators: which were sent, as seen on the network, and in which order
//! they were begun, as recorded on the actuators' disks.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use acl::content::{ActionToken, Request};
use acl::{ConversationId, Performative};
use building::{BuildingEvent, Truth};
use substrate::{Destination, Subject};

/// The action of each token, by agent and token.
#[derive(Default)]
pub struct CommandLog(Mutex<BTreeMap<(String, ActionToken), String>>);

/// The commands that each agent has begun, in order, with repetitions.
pub type Begun = BTreeMap<String, Vec<ActionToken>>;

// === impl CommandLog ===

impl CommandLog {
    /// Records a message that passes over the network.
    pub fn record_command(&self, addressed: &Destination, payload: &[u8]) {
        let Destination::To(to, Subject::Message(Performative::Request)) = addressed else {
            return;
        };
        let Ok(message) = acl::decode(payload) else { return };
        if let Ok(Request::Act(act)) = message.content_as() {
            let mut given = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            given.insert((to.as_str().to_owned(), act.token), act.action);
        }
    }

    /// Returns start and destination of a command that moves; `None` for other commands.
    fn movement(&self, agent: &str, token: &ActionToken) -> Option<[String; 2]> {
        let given = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let action = given.get(&(agent.to_owned(), token.clone()))?;
        let words: Vec<_> = action.trim_matches(['(', ')']).split_whitespace().collect();
        match words[..] {
            ["move", _, from, to] => Some([from.to_owned(), to.to_owned()]),
            _ => None,
        }
    }

    fn knows(&self, agent: &str, token: &ActionToken) -> bool {
        let given = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        given.contains_key(&(agent.to_owned(), token.clone()))
    }
}

// === checks ===

/// Returns a message for each broken promise about the commands begun and the actions done.
pub fn violations(given: &CommandLog, begun: &Begun, truth: &Truth) -> Vec<String> {
    let mut broken = Vec::new();
    for (agent, tokens) in begun {
        broken.extend(twice(agent, tokens));
        broken.extend(overtaken(agent, tokens));
        let unknown = tokens.iter().find(|token| !given.knows(agent, token));
        broken.extend(unknown.map(|token| format!("`{agent}` began {token}, not requested")));
    }
    broken.extend(strayed(given, begun, truth));
    broken.extend(unrecorded(begun, truth));
    broken
}

/// Returns a message for each command that was begun twice, according to the actuator's disk.
fn twice(agent: &str, tokens: &[ActionToken]) -> Vec<String> {
    let once: BTreeSet<_> = tokens.iter().collect();
    let times = |token: &ActionToken| tokens.iter().filter(|other| *other == token).count();
    let often = once.into_iter().map(|token| (token, times(token))).filter(|(_, times)| *times > 1);
    often.map(|(token, times)| format!("`{agent}` began {token} {times} times")).collect()
}

/// Returns a message if a command of an older plan for a goal was begun after one of a newer plan.
fn overtaken(agent: &str, tokens: &[ActionToken]) -> Option<String> {
    let mut newest: BTreeMap<&ConversationId, (u64, u32)> = BTreeMap::new();
    tokens.iter().find_map(|token| {
        let (plan, newest) = ((token.term, token.round), newest.entry(&token.conversation));
        let newest = newest.or_insert(plan);
        if plan < *newest {
            let (term, round) = *newest;
            return Some(format!(
                "`{agent}` began {token} of an older plan after one of term {term}, round {round}"
            ));
        }
        *newest = plan;
        None
    })
}

/// Returns a message for each departure of a robot without a matching command. Departures match
/// begun commands in order, one departure per command. A begun command may have no departure,
/// because its process may die before the robot moves.
fn strayed(given: &CommandLog, begun: &Begun, truth: &Truth) -> Vec<String> {
    let mut ways: BTreeMap<&str, Vec<[String; 2]>> = BTreeMap::new();
    for occurrence in truth.occurrences() {
        if let BuildingEvent::Departed { robot, from, to } = &occurrence.event {
            ways.entry(robot).or_default().push([from.clone(), to.clone()]);
        }
    }
    let mut strayed = Vec::new();
    for (robot, ways) in ways {
        let tokens = begun.get(robot).into_iter().flatten();
        let mut commanded = tokens.filter_map(|token| given.movement(robot, token));
        if let Some([from, to]) = ways.iter().find(|way| !commanded.any(|other| other == **way)) {
            strayed.push(format!(
                "`{robot}` set off from {from} to {to}, without a command for it, or twice for one \
                 command"
            ));
        }
    }
    strayed
}

/// Returns a message for each agent that acted more often than its disk records.
fn unrecorded(begun: &Begun, truth: &Truth) -> Vec<String> {
    let mut done: BTreeMap<&str, usize> = BTreeMap::new();
    for occurrence in truth.occurrences() {
        if let BuildingEvent::Departed { robot: who, .. } | BuildingEvent::Asked { sensor: who } =
            &occurrence.event
        {
            *done.entry(who).or_default() += 1;
        }
    }
    let begun = |who: &str| begun.get(who).map_or(0, Vec::len);
    let more = done.into_iter().filter(|(who, times)| *times > begun(who));
    more.map(|(who, times)| format!("`{who}` acted {times} times, and began {}", begun(who)))
        .collect()
}
