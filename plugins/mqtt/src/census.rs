//! Of the devices that are told of: who is to be here and where, and why not of the others.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use acl::content::Discovered;
use agent::Admission;

use crate::Gateway;
use crate::described::{Described, core, name_of};
use crate::part::{Known, Part, Parts};

/// Agents that one gateway brings.
const AGENTS_MAX: usize = 2_048;

/// What was found.
#[derive(Default)]
pub(crate) struct Census {
    /// Who is to be here.
    pub(crate) wanted: BTreeMap<AgentId, Part>,
    /// All of them, for people.
    pub(crate) discovered: Vec<Discovered>,
    /// Who could be here if somebody lets them, with a word about each.
    pub(crate) applicants: BTreeMap<String, String>,
    names: BTreeSet<AgentId>,
}

impl Gateway {
    pub(crate) fn census(&self) -> Census {
        let mut devices = self.home_assistant.devices();
        // Zigbee2MQTT says all that it says to Home Assistant too, under an identifier of both.
        let zigbee: BTreeSet<_> = self.zigbee.iter().map(|known| known.id.as_str()).collect();
        devices.retain(|device| !zigbee.contains(device.id.trim_start_matches("zigbee2mqtt_")));
        devices.extend(self.zigbee.iter().cloned());
        devices.extend(self.tasmota.devices());
        devices.retain(|device| !is_listed(&self.config.ignore, device));

        let mut census = Census::default();
        for device in &devices {
            self.count(device, &mut census);
        }
        census
    }

    /// What is to become of a device.
    fn count(&self, device: &Described, census: &mut Census) {
        let Parts { parts, problem } = Parts::of(device, &self.classes);
        let room = self.room(device);
        if parts.is_empty()
            && let Ok(agent) = AgentId::new(&name_of(&device.name))
        {
            return census.discovered.push(self.discovered(device, &agent, false, problem));
        }
        for (agent, features) in parts {
            let obstacle = self.obstacle(&agent, room.as_deref(), census);
            let is_possible = obstacle.is_none();
            let admission = self.admission(device, &agent);
            let problem = obstacle.or_else(|| admission.reason()).or_else(|| problem.clone());
            let joined = is_possible && admission == Admission::Granted;
            let failed = self.problems.get(&agent).filter(|_| joined);
            let problem = failed.cloned().or(problem);
            let is_here = joined && failed.is_none();
            census.discovered.push(self.discovered(device, &agent, is_here, problem));
            let Some(room) = room.clone().filter(|_| is_possible) else { continue };
            if admission == Admission::Asked {
                let about = format!("{}, {room}", self.blueprint.id);
                census.applicants.insert(agent.to_string(), about);
            }
            if joined {
                census.wanted.insert(agent.clone(), self.part(device, agent, room, features));
            }
        }
    }

    /// Why one of them cannot be here, whoever would let it.
    fn obstacle(&self, agent: &AgentId, room: Option<&str>, census: &mut Census) -> Option<String> {
        let problem = if !census.names.insert(agent.clone()) {
            "another device has this name; call one of them otherwise"
        } else if census.wanted.len() >= AGENTS_MAX {
            "there are too many"
        } else if room.is_none() {
            "nobody says in which room it stands"
        } else {
            return None;
        };
        Some(problem.to_owned())
    }

    fn admission(&self, device: &Described, agent: &AgentId) -> Admission {
        match is_listed(&self.config.devices, device) {
            true => Admission::Granted,
            false => self.admissions.of(self.blueprint.id.as_str(), agent.as_str()),
        }
    }

    fn part(&self, device: &Described, agent: AgentId, room: String, features: Vec<Known>) -> Part {
        Part {
            agent,
            room,
            features,
            availability: device.availability.clone(),
            any_is_enough: device.any_is_enough,
            valid_for: self.valid_for,
        }
    }

    fn discovered(
        &self,
        device: &Described,
        agent: &AgentId,
        joined: bool,
        problem: Option<String>,
    ) -> Discovered {
        let toml = self.lines(device);
        Discovered {
            agent: agent.clone(),
            by: self.blueprint.id.to_string(),
            joined,
            problem,
            toml,
        }
    }

    /// The room it stands in: what the config says, what it says itself, what its name begins with.
    fn room(&self, device: &Described) -> Option<String> {
        let said = self.config.rooms.iter().find(|(pattern, _)| is_it(pattern, device));
        if let Some((_, room)) = said {
            return Some(room.clone());
        }
        let area = device.area.as_deref().and_then(|area| self.rooms.get(&core(area)));
        let called = core(&device.name);
        let named = || {
            let begins = self.rooms.iter().filter(|(core, _)| called.starts_with(core.as_str()));
            begins.max_by_key(|(core, _)| core.len()).map(|(_, room)| room)
        };
        area.or_else(named).cloned()
    }

    /// The lines that would let it take part.
    fn lines(&self, device: &Described) -> String {
        let (gateway, name) = (&self.blueprint.id, &device.name);
        let room = self.room(device).unwrap_or_default();
        format!(
            "# in the config of `{gateway}`; it is `{}`\ndevices = [\"{name}\"]\n\
             rooms = {{ \"{name}\" = \"{room}\" }}\n",
            device.id
        )
    }
}

fn is_listed(list: &[String], device: &Described) -> bool {
    list.iter().any(|pattern| is_it(pattern, device))
}

/// Whether a pattern is about a device: its name as it is or as agents have it, or its identifier.
fn is_it(pattern: &str, device: &Described) -> bool {
    let names = [device.name.as_str(), device.id.as_str(), &name_of(&device.name)];
    match pattern.strip_suffix('*') {
        Some(beginning) => names.iter().any(|name| name.starts_with(beginning)),
        None => names.contains(&pattern),
    }
}
