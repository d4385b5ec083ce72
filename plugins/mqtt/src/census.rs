//! Of the devices that are told of: what agents they are, and where.

use std::collections::BTreeSet;

use acl::AgentId;
use agent::bringing::{Finding, NOWHERE};

use crate::Gateway;
use crate::described::{Described, core, name_of};
use crate::part::{Known, Part, Parts};

impl Gateway {
    /// All that is wanted of what was told of.
    pub(crate) fn census(&self) -> Vec<Finding<Part>> {
        let mut devices = self.home_assistant.devices();
        // Zigbee2MQTT says all that it says to Home Assistant too, under an identifier of both.
        let zigbee: BTreeSet<_> = self.zigbee.iter().map(|known| known.id.as_str()).collect();
        devices.retain(|device| !zigbee.contains(device.id.trim_start_matches("zigbee2mqtt_")));
        devices.extend(self.zigbee.iter().cloned());
        devices.extend(self.tasmota.devices());
        devices.retain(|device| !is_listed(&self.config.ignore, device));
        devices.iter().flat_map(|device| self.agents_of(device)).collect()
    }

    /// The agents that a device is; one without anything, if nothing of it can be used.
    fn agents_of(&self, device: &Described) -> Vec<Finding<Part>> {
        let Parts { parts, problem } = Parts::of(device, &self.classes);
        let room = self.room(device);
        let finding = |agent: AgentId, part: Result<Part, String>| Finding {
            agent,
            is_named: is_listed(&self.config.devices, device),
            room: room.clone(),
            part,
            problem: problem.clone(),
            toml: self.lines(device),
        };
        if parts.is_empty() {
            let agent = AgentId::new(&name_of(&device.name));
            let useless = || Err(problem.clone().unwrap_or_default());
            return agent.map(|agent| finding(agent, useless())).into_iter().collect();
        }
        let found = parts.into_iter().map(|(agent, features)| {
            let part = room.clone().map(|room| self.part(device, agent.clone(), room, features));
            finding(agent, part.ok_or_else(|| NOWHERE.to_owned()))
        });
        found.collect()
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
