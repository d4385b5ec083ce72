//! Of the devices that are told of: what agents they are, and where.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use agent::bringing::{Finding, NOWHERE};

use crate::Gateway;
use crate::described::Described;
use crate::naming::{begins_with, core, name_of, slug};
use crate::part::{Known, Part, Parts};

/// So many letters of an identifier tell most devices of one name apart.
const IDENTIFIER_CHARS: usize = 6;

impl Gateway {
    /// All that is wanted of what was told of.
    pub(crate) fn census(&self) -> Vec<Finding<Part>> {
        let mut devices = self.home_assistant.devices();
        // Zigbee2MQTT says all that it says to Home Assistant too, under an identifier of both.
        let zigbee = self.zigbee.devices();
        let known: BTreeSet<_> = zigbee.iter().map(|known| known.id.as_str()).collect();
        let is_zigbee = |id: &String| known.contains(id.trim_start_matches("zigbee2mqtt_"));
        devices.retain(|device| !is_zigbee(&device.id) && !device.also.iter().any(is_zigbee));
        devices.extend(zigbee);
        devices.extend(self.tasmota.devices());
        devices.extend(self.shelly.devices());
        devices.retain(|device| !is_listed(&self.config.ignore, device));
        let names = names(&devices);
        let found = devices.iter().zip(names);
        found.flat_map(|(device, name)| self.agents_of(device, &name)).collect()
    }

    /// The agents that a device is; one without anything, if nothing of it can be used.
    fn agents_of(&self, device: &Described, name: &str) -> Vec<Finding<Part>> {
        let Parts { parts, problem } = Parts::of(device, &self.classes);
        let room = self.room(device);
        let finding = |agent: AgentId, part: Result<Part, String>| Finding {
            agent,
            is_named: is_listed(&self.config.devices, device),
            room: room.clone().ok(),
            part,
            problem: problem.clone(),
            toml: self.lines(device, name),
        };
        if parts.is_empty() {
            let useless = || Err(problem.clone().unwrap_or_default());
            let agent = AgentId::new(name);
            return agent.map(|agent| finding(agent, useless())).into_iter().collect();
        }
        let found = parts.into_iter().filter_map(|(suffix, features)| {
            let agent = AgentId::new(&format!("{name}{suffix}")).ok()?;
            let part = room.clone().map(|room| self.part(agent.clone(), room, features));
            Some(finding(agent, part))
        });
        found.collect()
    }

    fn part(&self, agent: AgentId, room: String, features: Vec<Known>) -> Part {
        Part { agent, room, features, valid_for: self.valid_for }
    }

    /// The room it stands in: what the config says, what it says itself, what its name begins with.
    ///
    /// # Errors
    ///
    /// Why it stands in none.
    fn room(&self, device: &Described) -> Result<String, String> {
        let said = self.config.rooms.iter().find(|(pattern, _)| is_it(pattern, device));
        if let Some((_, room)) = said {
            return Ok(room.clone());
        }
        if let Some(area) = device.area.as_deref() {
            // What says where it stands is not guessed to stand elsewhere.
            let unknown = || format!("it says that it stands in `{area}`, which is no room here");
            return self.rooms.get(&core(area)).cloned().ok_or_else(unknown);
        }
        let begins = self.rooms.values().filter(|room| begins_with(&device.name, room));
        let room = begins.max_by_key(|room| core(room).len());
        room.cloned().ok_or_else(|| NOWHERE.to_owned())
    }

    /// The lines that would let it take part.
    fn lines(&self, device: &Described, name: &str) -> String {
        let (gateway, id) = (&self.blueprint.id, &device.id);
        // A name that several have would be about all of them.
        let is_alone = name == name_of(&device.name);
        let called = toml::Value::from(if is_alone { device.name.as_str() } else { id });
        let room = toml::Value::from(self.room(device).unwrap_or_default());
        let id = toml::Value::from(id.as_str());
        format!(
            "# in the config of `{gateway}`; it is {id}\ndevices = [{called}]\n\
             rooms = {{ {called} = {room} }}\n"
        )
    }
}

fn is_listed(list: &[String], device: &Described) -> bool {
    list.iter().any(|pattern| is_it(pattern, device))
}

/// What each device is called: what people call it, and its identifier where others are called so.
pub(crate) fn names(devices: &[Described]) -> Vec<String> {
    let count = |names: &[String]| {
        let mut counts = BTreeMap::<String, usize>::new();
        for name in names {
            *counts.entry(name.clone()).or_default() += 1;
        }
        counts
    };
    let plain: Vec<_> = devices.iter().map(|device| name_of(&device.name)).collect();
    let counts = count(&plain);
    let with = |device: &Described, name: &String, chars: usize| {
        let id = slug(&device.id, "");
        let id = &id[id.len().saturating_sub(chars)..];
        name_of(&format!("{} {id}", &name[..name.len().min(40 - chars.min(24))]))
    };
    let short = devices.iter().zip(&plain).map(|(device, name)| match counts[name] {
        1 => name.clone(),
        _ => with(device, name, IDENTIFIER_CHARS),
    });
    let short: Vec<_> = short.collect();
    let counts = count(&short);
    let long = devices.iter().zip(plain.iter().zip(&short));
    let long = long.map(|(device, (name, short))| match counts[short] {
        1 => short.clone(),
        _ => with(device, name, 24),
    });
    long.collect()
}

/// Whether a pattern is about a device: its name as it is or as agents have it, or an identifier.
fn is_it(pattern: &str, device: &Described) -> bool {
    let own = name_of(&device.name);
    let names = [device.name.as_str(), device.id.as_str(), &own];
    let names = || names.into_iter().chain(device.also.iter().map(String::as_str));
    match pattern.strip_suffix('*') {
        Some(beginning) => names().any(|name| name.starts_with(beginning)),
        None => names().any(|name| name == pattern),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, id: &str) -> Described {
        let (name, id) = (name.to_owned(), id.to_owned());
        let (also, features, unused) = Default::default();
        Described { name, id, also, area: None, features, unused }
    }

    #[test]
    fn devices_of_one_name_are_told_apart_by_their_identifiers() {
        let devices = [
            device("Thermometer", "0x00158d0001a2b3c4"),
            device("Thermometer", "0x00158d0001a2ffff"),
            device("Lamp", "x"),
            device("温度計", "a1"),
            device("温度計", "a2"),
            device("Same", "1-000000"),
            device("Same", "2-000000"),
        ];
        assert_eq!(
            names(&devices),
            [
                "thermometer-a2b3c4",
                "thermometer-a2ffff",
                "lamp",
                "wenduji-a1",
                "wenduji-a2",
                "same-1000000",
                "same-2000000",
            ]
        );
        let long = "a very long name of a device that goes on and on and on and on";
        let devices = [device(long, "0x0000000000000001"), device(long, "0x0000000000000002")];
        let names = names(&devices);
        assert_ne!(names[0], names[1]);
        assert!(names.iter().all(|name| AgentId::new(name).is_ok()));
    }
}
