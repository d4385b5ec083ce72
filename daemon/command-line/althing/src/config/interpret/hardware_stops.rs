//! The hardware stops of the file: sensors that stop actuators while they are pressed.

use std::collections::BTreeMap;

use acl::AgentId;
use acl::content::STOP_NAMES_MAX;
use agent::{PressedWhen, StopButton};
use pddl::{Diagnostic, InitElement};

use super::Interpreter;
use super::files::PddlFiles;
use crate::config::ecosystem::AgentEntry;
use crate::config::raw::RawHardwareStop;

/// The plugin of sensors, and the quantity that is a contact.
const SENSOR: &str = "sensor";
const CONTACT: &str = "contact";

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the hardware stops of the file without those that have mistakes, which are reported.
    pub(super) fn hardware_stops(
        &mut self,
        raw: BTreeMap<String, RawHardwareStop>,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) -> BTreeMap<AgentId, StopButton> {
        let mut stops = BTreeMap::new();
        for (name, raw) in raw {
            let path = format!("hardware-stops.{name}");
            let agent = match AgentId::new(&name) {
                Ok(agent) => agent,
                Err(error) => {
                    let message = format!("`{name}` cannot be the name of {}", error.what);
                    let rule = error.rule;
                    self.about_key(&path, |span| Diagnostic::error(span, message).with_help(rule));
                    continue;
                }
            };
            if !self.may_be_agent(&path, &name, agents, files, "it stops others if it appears") {
                continue;
            }
            self.warn_of_unstoppable(&path, &raw.stops, agents, files);
            let entry = agents.iter().find(|entry| entry.name == agent);
            if let Some(stop) = self.hardware_stop(&path, raw, entry) {
                stops.insert(agent, stop);
            }
        }
        stops
    }

    fn hardware_stop(
        &mut self,
        path: &str,
        raw: RawHardwareStop,
        entry: Option<&AgentEntry>,
    ) -> Option<StopButton> {
        let RawHardwareStop { stops, pressed, release, fail_safe } = raw;
        if stops.len() > STOP_NAMES_MAX {
            let message = format!("`stops` has more than {STOP_NAMES_MAX} names");
            let help = "name places, or leave it out: then everything is stopped";
            let path = format!("{path}.stops");
            self.about_key(&path, |span| Diagnostic::error(span, message).with_help(help));
            return None;
        }
        if stops.is_empty() && self.place(&format!("{path}.stops")).is_some() {
            let message = "`stops` is empty".to_owned();
            let help = "name agents or places, or leave it out: then everything is stopped";
            let path = format!("{path}.stops");
            self.about_key(&path, |span| Diagnostic::error(span, message).with_help(help));
            return None;
        }
        let pressed = self.pressed_when(path, pressed.as_deref(), entry)?;
        let Some(is_fail_safe) = fail_safe else {
            if self.place(&format!("{path}.fail-safe")).is_none() {
                let message = "`fail-safe` is missing".to_owned();
                let help = "write fail-safe = true if a button that is silent or unplugged is to \
                    stop, too; fail-safe = false if it is to stop nothing then";
                self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
            }
            return None;
        };
        let is_self_releasing = release.as_deref() == Some("button");
        Some(StopButton { scope: stops, pressed, is_self_releasing, is_fail_safe })
    }

    /// Returns what tells that a button is pressed; `None` after reporting a mistake.
    fn pressed_when(
        &mut self,
        path: &str,
        pressed: Option<&str>,
        entry: Option<&AgentEntry>,
    ) -> Option<PressedWhen> {
        let is_fact = pressed.is_some_and(|text| text.trim_start().starts_with('('));
        let key = format!("{path}.pressed");
        if let Some(text) = pressed.filter(|text| !is_fact && text.contains(char::is_whitespace)) {
            let message = format!("`{text}` is no fact: a fact stands in parentheses");
            let help = format!("write pressed = \"({})\"", text.trim());
            self.about_value(&key, |span| Diagnostic::error(span, message).with_help(help));
            return None;
        }
        let problem = match entry {
            Some(entry) if !is_fact => no_contact(entry),
            _ => None,
        };
        let is_contact = problem.is_none();
        let rule = match (pressed.unwrap_or("open"), problem) {
            (_, Some(problem)) => Err(problem),
            ("open", None) => Ok(PressedWhen::ContactOpen),
            ("closed", None) => Ok(PressedWhen::ContactClosed),
            (text, None) if is_fact => pressed_by_fact(text),
            (text, None) => Err(format!("`{text}` is none of \"open\", \"closed\" and a fact")),
        };
        let help = if is_contact {
            "write pressed = \"open\" or \"closed\" for a contact, or a fact of the agent, such as \
             pressed = \"(pressed button-1)\""
        } else {
            "name a sensor with quantity = \"contact\" in place of this agent, or write a fact that \
             this agent reports, such as pressed = \"(pressed button-1)\""
        };
        match rule {
            Ok(rule) => Some(rule),
            Err(problem) if self.place(&key).is_some() => {
                self.about_value(&key, |span| Diagnostic::error(span, problem).with_help(help));
                None
            }
            Err(problem) => {
                self.about_key(path, |span| Diagnostic::error(span, problem).with_help(help));
                None
            }
        }
    }

    /// Warns of names in `stops` that are neither agents of the file nor objects of the map.
    fn warn_of_unstoppable(
        &mut self,
        path: &str,
        names: &[String],
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) {
        let Some(files) = files else { return };
        for (index, name) in names.iter().enumerate() {
            let is_agent = self.written_agents.contains(name)
                || agents.iter().any(|entry| entry.name.as_str() == name);
            if is_agent || files.has_object(name) {
                continue;
            }
            let message = format!("`{name}` is no agent of this file, and no place of the map");
            let agents = agents.iter().map(|entry| entry.name.as_str());
            let known = agents.chain(files.objects());
            let help = match pddl::nearest(name, known) {
                Some(near) => format!("did you mean `{near}`?"),
                None => "it is stopped if it appears, such as a device of a gateway".to_owned(),
            };
            let path = match self.place(&format!("{path}.stops.{index}")) {
                Some(_) => format!("{path}.stops.{index}"),
                None => format!("{path}.stops"),
            };
            self.about_value(&path, |span| Diagnostic::warning(span, message).with_help(help));
        }
    }
}

/// Returns why an agent of the file cannot report an open or closed contact; `None` if it can, or if
/// the file does not tell.
fn no_contact(entry: &AgentEntry) -> Option<String> {
    let AgentEntry { name, plugin, package, config, .. } = entry;
    if plugin == SENSOR {
        let quantity = config["quantity"].as_str()?;
        return (quantity != CONTACT)
            .then(|| format!("`{name}` measures {quantity}, and is no contact"));
    }
    // Only the machine with a package knows what its agents report.
    package.is_none().then(|| format!("`{name}` is no contact: its plugin is `{plugin}`"))
}

/// Parses the fact that tells that a button is pressed.
fn pressed_by_fact(text: &str) -> Result<PressedWhen, String> {
    let facts = pddl::parse_init_elements(text).into_result().map_err(|diagnostics| {
        let why = diagnostics.first().map(|first| first.message.clone()).unwrap_or_default();
        format!("`{text}` is no fact: {why}")
    })?;
    match facts.as_slice() {
        [InitElement::Atom(atom)] => Ok(PressedWhen::FactHolds(atom.to_string())),
        [InitElement::Not(atom)] => Ok(PressedWhen::FactFails(atom.to_string())),
        _ => Err(format!("`{text}` is not one fact, or the negation of one")),
    }
}
