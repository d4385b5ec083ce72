//! Creates the list of agents, each with its name and room, from the descriptions of all devices.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::PoisonError;

use acl::AgentId;
use agent::discovery::{FoundDevice, ROOM_UNKNOWN};
use agent::{Blueprint, ConfiguredNames};

use crate::Gateway;
use crate::description::DescribedDevice;
use crate::naming::{begins_with, core, name_of, slug};
use crate::part::{ClassifiedFeature, DevicePart, DividedDevice};

/// Number of characters of an identifier that are added to a name that several devices share. Six
/// characters from the end of the identifier are usually enough.
const IDENTIFIER_CHARS: usize = 6;

impl Gateway {
    /// Returns all possible agents of the described devices, without the devices that the config
    /// ignores.
    pub(crate) fn census(&self) -> Vec<FoundDevice<DevicePart>> {
        let mut devices = self.home_assistant.devices();
        // Zigbee2MQTT also describes its devices to Home Assistant, with an identifier that
        // contains their address. The description from Zigbee2MQTT is preferred for such a device.
        let zigbee = self.zigbee.devices();
        let known: BTreeSet<_> = zigbee.iter().map(|known| known.id.as_str()).collect();
        let is_zigbee = |id: &String| known.contains(id.trim_start_matches("zigbee2mqtt_"));
        devices.retain(|device| !is_zigbee(&device.id) && !device.other_ids.iter().any(is_zigbee));
        devices.extend(zigbee);
        devices.extend(self.tasmota.devices());
        devices.extend(self.shelly.devices());
        devices.retain(|device| !is_listed(&self.config.ignore, device));
        let mut given = self.given.lock().unwrap_or_else(PoisonError::into_inner);
        let names = given.names(&devices, |name| self.is_taken(name));
        let counts = counted(devices.iter().map(|device| name_of(&device.name)));
        let is_alone = |device: &DescribedDevice| counts.get(&name_of(&device.name)) == Some(&1);
        let found = devices.iter().zip(names);
        found.flat_map(|(device, name)| self.agents_of(device, &name, is_alone(device))).collect()
    }

    /// Whether a name is already in use by a room, by another object of the map, or by an agent of
    /// the ecosystem file.
    fn is_taken(&self, name: &str) -> bool {
        let Blueprint { id, host, .. } = &self.blueprint;
        let named = host.resources.get::<ConfiguredNames>();
        id.as_str() == name
            || host.places().any(|place| place == name)
            || host.ontology.constants.iter().any(|constant| constant.name == name)
            || named.is_some_and(|named| named.0.contains(name))
    }

    /// Returns the agents of a device. If no feature of the device can be used, returns one entry
    /// with the reason instead of a part.
    fn agents_of(
        &self,
        device: &DescribedDevice,
        name: &str,
        is_alone: bool,
    ) -> Vec<FoundDevice<DevicePart>> {
        let DividedDevice { parts, problem } = DividedDevice::of(device, &self.classes);
        let room = self.room(device);
        let finding = |agent: AgentId, part: Result<DevicePart, String>| FoundDevice {
            agent,
            is_named: is_listed(&self.config.devices, device),
            room: room.clone().ok(),
            part,
            problem: problem.clone(),
            toml: self.config_lines(device, is_alone),
        };
        if parts.is_empty() {
            let useless = || Err(problem.clone().unwrap_or_default());
            let agent = AgentId::new(name);
            return agent.map(|agent| finding(agent, useless())).into_iter().collect();
        }
        let found = parts.into_iter().filter_map(|(suffix, features)| {
            let agent = agent_name(name, &suffix, |name| !suffix.is_empty() && self.is_taken(name));
            let agent = AgentId::new(&agent).ok()?;
            let part = room.clone().map(|room| self.part(agent.clone(), room, features));
            Some(finding(agent, part))
        });
        found.collect()
    }

    fn part(&self, agent: AgentId, room: String, features: Vec<ClassifiedFeature>) -> DevicePart {
        DevicePart { agent, room, features, valid_for: self.valid_for }
    }

    /// Returns the room of a device: from the config, from the area of the device, or from the
    /// beginning of its name, in this order of precedence.
    ///
    /// # Errors
    ///
    /// Returns the reason if the room is unknown.
    fn room(&self, device: &DescribedDevice) -> Result<String, String> {
        let said = self.config.rooms.iter().find(|(pattern, _)| matches_device(pattern, device));
        if let Some((_, room)) = said {
            return Ok(room.clone());
        }
        if let Some(area) = device.area.as_deref() {
            // A device with an unknown area is not assigned to another room by its name.
            let unknown = || format!("its area is `{area}`, which is no room here");
            return self.rooms.get(&core(area)).cloned().ok_or_else(unknown);
        }
        let begins = self.rooms.values().filter(|room| begins_with(&device.name, room));
        let room = begins.max_by_key(|room| core(room).len());
        room.cloned().ok_or_else(|| ROOM_UNKNOWN.to_owned())
    }

    /// Returns the lines of configuration with which the device would take part in the ecosystem.
    fn config_lines(&self, device: &DescribedDevice, is_alone: bool) -> String {
        let (gateway, id) = (&self.blueprint.id, &device.id);
        // If several devices have this name, the line contains the identifier, because the name
        // would match all of these devices.
        let called = toml::Value::from(if is_alone { device.name.as_str() } else { id });
        let room = toml::Value::from(self.room(device).unwrap_or_default());
        let id = toml::Value::from(id.as_str());
        format!(
            "# in the config of `{gateway}`; it is {id}\ndevices = [{called}]\n\
             rooms = {{ {called} = {room} }}\n"
        )
    }
}

fn is_listed(list: &[String], device: &DescribedDevice) -> bool {
    list.iter().any(|pattern| matches_device(pattern, device))
}

/// Names that were assigned to devices, by identifier of the device. A device keeps its name as
/// long as it is described, even if it is renamed or another device gets the same name.
#[derive(Debug, Default)]
pub(crate) struct AssignedNames(BTreeMap<String, String>);

impl AssignedNames {
    /// Returns the name of each device, which is its friendly name. If that name is in use, the end
    /// of the device's identifier is added.
    pub(crate) fn names(
        &mut self,
        devices: &[DescribedDevice],
        is_taken: impl Fn(&str) -> bool,
    ) -> Vec<String> {
        let mut names: Vec<Option<String>> =
            devices.iter().map(|device| self.0.get(&device.id).cloned()).collect();
        let mut used: BTreeSet<String> = names.iter().flatten().cloned().collect();
        // A device may have been named under another of its identifiers.
        for (device, name) in devices.iter().zip(&mut names).filter(|(_, name)| name.is_none()) {
            let known = device.other_ids.iter().find_map(|key| self.0.get(key)).cloned();
            *name = known.filter(|known| used.insert(known.clone()));
        }
        let new = devices.iter().zip(&names).filter(|(_, name)| name.is_none());
        let new: Vec<&DescribedDevice> = new.map(|(device, _)| device).collect();
        let is_free = |name: &str| !used.contains(name) && !is_taken(name);
        let mut fresh = fresh(&new, is_free).into_iter();
        let names = names.into_iter().map(|name| name.or_else(|| fresh.next()).unwrap_or_default());
        let names: Vec<String> = names.collect();
        self.0.clear();
        for (device, name) in devices.iter().zip(&names) {
            // A device without a name except its identifier gets no permanent name, so that a
            // person can still name it once.
            let plain = name_of(&device.name);
            let mut keys = [&device.id].into_iter().chain(&device.other_ids);
            if !keys.clone().any(|key| name_of(key) == plain) {
                keys.next().map(|id| self.0.insert(id.clone(), name.clone()));
                for key in keys {
                    self.0.entry(key.clone()).or_insert_with(|| name.clone());
                }
            }
        }
        names
    }
}

/// Returns names for devices that have no assigned name yet.
fn fresh(devices: &[&DescribedDevice], is_free: impl Fn(&str) -> bool) -> Vec<String> {
    let with = |device: &DescribedDevice, name: &String, chars: usize| {
        let id = slug(&device.id, "");
        let id = &id[id.len().saturating_sub(chars)..];
        name_of(&format!("{} {id}", &name[..name.len().min(40 - chars.min(24))]))
    };
    let plain: Vec<_> = devices.iter().map(|device| name_of(&device.name)).collect();
    let mut names = plain.clone();
    for chars in [IDENTIFIER_CHARS, 24] {
        let counts = counted(names.iter().cloned());
        for (name, (device, plain)) in names.iter_mut().zip(devices.iter().zip(&plain)) {
            if counts[name] > 1 || !is_free(name) {
                *name = with(device, plain, chars);
            }
        }
    }
    // Devices with identifiers that end alike get different numbers.
    let mut used = BTreeSet::new();
    for name in &mut names {
        let numbered = (2..).map(|number| format!("{name}-{number}"));
        let mut all = std::iter::once(name.clone()).chain(numbered);
        let free = all.find(|name| is_free(name) && !used.contains(name));
        *name = free.unwrap_or_default();
        used.insert(name.clone());
    }
    names
}

/// Returns the number of occurrences of each name.
fn counted(names: impl Iterator<Item = String>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for name in names {
        *counts.entry(name).or_default() += 1;
    }
    counts
}

/// Returns the name of one agent of a device. A name that is too long or in use is shortened, and a
/// hash makes it unique.
fn agent_name(name: &str, suffix: &str, is_taken: impl Fn(&str) -> bool) -> String {
    const PART_CHARS: usize = 26;
    let whole = format!("{name}{suffix}");
    if AgentId::new(&whole).is_ok() && !is_taken(&whole) {
        return whole;
    }
    // The hash of a name is the same in every run and every release.
    let hash = acl::fnv::hash_32(whole.as_bytes());
    let short = |text: &str| text[..text.len().min(PART_CHARS)].trim_matches('-').to_owned();
    let suffix = short(suffix);
    let between = if suffix.is_empty() { "" } else { "-" };
    format!("{}{between}{suffix}-{hash:08x}", short(name))
}

/// Whether a pattern matches a device. The pattern is compared with the device's name as written,
/// its name as a slug, and its identifiers. A `*` at the end of the pattern matches any ending.
fn matches_device(pattern: &str, device: &DescribedDevice) -> bool {
    let own = name_of(&device.name);
    let names = [device.name.as_str(), device.id.as_str(), &own];
    let names = || names.into_iter().chain(device.other_ids.iter().map(String::as_str));
    match pattern.strip_suffix('*') {
        Some(beginning) => names().any(|name| name.starts_with(beginning)),
        None => names().any(|name| name == pattern),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, id: &str) -> DescribedDevice {
        let (name, id) = (name.to_owned(), id.to_owned());
        let (also, features, unused) = Default::default();
        DescribedDevice { name, id, other_ids: also, area: None, features, unused }
    }

    #[test]
    fn devices_with_one_name_are_distinguished_by_their_identifiers() {
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
            AssignedNames::default().names(&devices, |_| false),
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
        let names = AssignedNames::default().names(&devices, |_| false);
        assert_ne!(names[0], names[1]);
        assert!(names.iter().all(|name| AgentId::new(name).is_ok()));
    }

    #[test]
    fn a_device_keeps_its_name_and_gets_no_name_of_others() {
        let mut given = AssignedNames::default();
        let is_taken = |name: &str| matches!(name, "office1" | "keyboard");
        let lamp = || device("Lamp", "0xa1");
        assert_eq!(given.names(&[lamp()], is_taken), ["lamp"]);
        // A second device with the same name arrives, before the first in the list.
        let two = [device("Lamp", "0x000b2"), lamp()];
        assert_eq!(given.names(&two, is_taken), ["lamp-x000b2", "lamp"]);
        // A third device is renamed to the same name.
        let three = [device("Desk", "0xc3"), device("Lamp", "0x000b2"), lamp()];
        assert_eq!(given.names(&three, is_taken), ["desk", "lamp-x000b2", "lamp"]);
        let three = [device("Lamp", "0xc3"), device("Lamp", "0x000b2"), lamp()];
        assert_eq!(given.names(&three, is_taken), ["desk", "lamp-x000b2", "lamp"]);
        // A device without a name of its own may be named once.
        assert_eq!(given.names(&[device("0xd4", "0xd4")], is_taken), ["device-0xd4"]);
        assert_eq!(given.names(&[device("Fan", "0xd4")], is_taken), ["fan"]);
        // Names of rooms and agents are not given to devices.
        let taken = [device("Office1", "0xe5"), device("keyboard", "0xf6")];
        assert_eq!(given.names(&taken, is_taken), ["office1-0xe5", "keyboard-0xf6"]);
        // A device with a new main identifier keeps its name.
        let mut moved = device("Office1", "first");
        moved.other_ids = vec!["0xe5".to_owned()];
        assert_eq!(given.names(&[moved], is_taken), ["office1-0xe5"]);
    }

    #[test]
    fn names_that_are_too_long_are_shortened_and_stay_distinct() {
        let name = "x".repeat(48);
        let left = agent_name(&name, &format!("-{}-left", "y".repeat(40)), |_| false);
        let right = agent_name(&name, &format!("-{}-right", "y".repeat(40)), |_| false);
        assert_ne!(left, right);
        assert_eq!(left, agent_name(&name, &format!("-{}-left", "y".repeat(40)), |_| false));
        assert!([left, right].iter().all(|name| AgentId::new(name).is_ok()));
        assert_eq!(agent_name("lamp", "-left", |_| false), "lamp-left");
        assert_ne!(agent_name("lamp", "-left", |name| name == "lamp-left"), "lamp-left");
    }
}
