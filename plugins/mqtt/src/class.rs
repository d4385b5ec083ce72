//! Device classes: what devices call what they measure or switch, and the words it has here.

use std::collections::{BTreeMap, BTreeSet};

use actuator::OnOff;
use serde::Deserialize;

/// The table that is built in.
const BUILT_IN: &str = include_str!("classes.toml");

/// All classes, by name.
#[derive(Clone, Debug)]
pub(crate) struct Classes(BTreeMap<String, Class>);

/// What a device class means here.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Class {
    /// What else devices call it.
    #[serde(default)]
    also: Vec<String>,
    /// The type of an agent that has it.
    pub(crate) agent: String,
    /// The action that measures it.
    action: Option<String>,
    /// The predicate that it is known in a room.
    known: Option<String>,
    /// The function of a room that is its value.
    value: Option<String>,
    /// The unit of that value.
    unit: Option<String>,
    /// The predicate of a room that is true where the answer is yes.
    yes: Option<String>,
    /// Whether devices say no where that is true.
    #[serde(default)]
    pub(crate) inverted: bool,
    /// The predicate of a room that is true where it is switched on.
    state: Option<String>,
    /// The predicate of the device itself that is true then, or where the answer is yes.
    own: Option<String>,
    /// The predicate that the device is in a room, where the ontology derives `yes` from it and `own`.
    at: Option<String>,
    /// Whether all in a room have to be on for `state` to be true of it; else one is enough.
    #[serde(default)]
    all: bool,
    /// The actions that switch it.
    on: Option<String>,
    off: Option<String>,
}

/// What kind of thing it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Kind<'c> {
    /// A number that is measured.
    Number { action: &'c str, known: &'c str, value: &'c str, unit: &'c str },
    /// A yes or no that is noticed.
    YesOrNo { action: &'c str, known: &'c str, yes: &'c str, own: Option<(&'c str, &'c str)> },
    /// Something that is switched.
    Switch { words: OnOff<'c>, on: &'c str, off: &'c str },
}

impl Classes {
    /// Those that are built in, and over them what somebody says.
    ///
    /// # Errors
    ///
    /// What is wrong with what is said.
    pub(crate) fn with(said: &serde_json::Value) -> Result<Classes, String> {
        let mut classes: BTreeMap<String, Class> =
            toml::from_str(BUILT_IN).expect("invariant: a test reads what is built in");
        if !said.is_null() {
            let more: BTreeMap<String, Class> = serde_json::from_value(said.clone())
                .map_err(|error| format!("classes: {error}"))?;
            // What somebody says of a name holds, whatever it is called in the table.
            let said: BTreeSet<&String> =
                more.iter().flat_map(|(name, class)| class.also.iter().chain([name])).collect();
            for class in classes.values_mut() {
                class.also.retain(|name| !said.contains(name));
            }
            classes.extend(more);
        }
        for class in classes.values_mut() {
            if class.state.is_some() && class.own.is_none() {
                class.own = Some(format!("{}-on", class.agent));
            }
        }
        for (name, class) in &classes {
            if class.kind().is_none() {
                return Err(format!(
                    "classes.{name}: write action, known, value and unit of what is measured, \
                     action, known and yes of a yes or no, or state, on and off of what is switched"
                ));
            }
        }
        let unsayable = classes.iter().find_map(|(name, class)| Some((name, class.unsayable()?)));
        match unsayable {
            Some((name, word)) => Err(format!(
                "classes.{name}: `{word}` cannot be a word of PDDL here; use a-z, 0-9, - and _"
            )),
            None => Ok(Classes(classes)),
        }
    }

    /// The name under which a class is known that a device calls so.
    pub(crate) fn find(&self, called: &str) -> Option<&str> {
        let called = called.to_ascii_lowercase();
        if let Some((name, _)) = self.0.get_key_value(&called) {
            return Some(name);
        }
        let is_it = |(_, class): &(&String, &Class)| class.also.contains(&called);
        self.0.iter().find(is_it).map(|(name, _)| name.as_str())
    }

    /// A class by its own name.
    pub(crate) fn get(&self, name: &str) -> Option<&Class> {
        self.0.get(name)
    }
}

impl Class {
    /// A word of it that an action model cannot have.
    fn unsayable(&self) -> Option<&str> {
        let Class { agent, action, known, value, yes, state, own, at, on, off, .. } = self;
        let words = [action, known, value, yes, state, own, at, on, off].into_iter().flatten();
        let mut words = std::iter::once(agent).chain(words).map(String::as_str);
        words.find(|word| acl::AgentId::new(word).is_err())
    }

    /// What kind of thing it is; `None` if its words are not enough for any.
    pub(crate) fn kind(&self) -> Option<Kind<'_>> {
        if let (Some(state), Some(on), Some(off)) = (&self.state, &self.on, &self.off) {
            let (agent, own, all) = (&self.agent, self.own.as_ref()?, self.all);
            return Some(Kind::Switch { words: OnOff { agent, state, own, all }, on, off });
        }
        let (action, known) = (self.action.as_deref()?, self.known.as_deref()?);
        match (&self.value, &self.unit, &self.yes) {
            (Some(value), Some(unit), None) => Some(Kind::Number { action, known, value, unit }),
            (None, None, Some(yes)) => {
                let own = self.own.as_deref().zip(self.at.as_deref());
                Some(Kind::YesOrNo { action, known, yes, own })
            }
            _ => None,
        }
    }
}

/// What makes a value in one unit one in another: a factor, and what is added then; `None` where the
/// one has nothing to do with the other.
pub(crate) fn conversion(from: &str, to: &str) -> Option<(f64, f64)> {
    match (plain(from).as_str(), plain(to).as_str()) {
        (one, other) if one == other => Some((1.0, 0.0)),
        // Nothing said is the usual.
        ("", _) => Some((1.0, 0.0)),
        ("f", "c") => Some((5.0 / 9.0, -160.0 / 9.0)),
        ("k", "c") => Some((1.0, -273.15)),
        ("c", "f") => Some((1.8, 32.0)),
        ("klx", "lx") => Some((1_000.0, 0.0)),
        ("ppb", "ppm") => Some((0.001, 0.0)),
        _ => None,
    }
}

/// A unit in one way of writing it.
fn plain(unit: &str) -> String {
    let unit = unit.trim().trim_start_matches(['°', 'º']).trim().to_lowercase();
    match unit.as_str() {
        "℃" | "degc" | "cel" | "celsius" => "c",
        "℉" | "degf" | "fahrenheit" => "f",
        "kelvin" => "k",
        "lux" => "lx",
        "%rh" | "% rh" | "rh%" => "%",
        other => other,
    }
    .to_owned()
}

/// Whether a value can be, in its unit: chips say numbers of their own for “no value”.
pub(crate) fn is_possible(value: f64, unit: &str) -> bool {
    // What is larger is exact to no thousandth any more, and no quantity of a room.
    const LARGEST: f64 = 1e12;
    if !value.is_finite() || value.abs() > LARGEST {
        return false;
    }
    match plain(unit).as_str() {
        // -127 and -128 are what thermometers say that were not reached, 999 and 327.67 those without a
        // probe; no room is as hot as 200 °C.
        "c" => value > -127.0 && value <= 200.0,
        "f" => value > -196.0 && value <= 392.0,
        "k" => (0.0..=474.0).contains(&value),
        // A million parts of a million are all of it.
        "ppm" => (0.0..=1e6).contains(&value),
        "ppb" => (0.0..=1e9).contains(&value),
        // The sun makes a little more than a hundred thousand.
        "lx" => (0.0..=1e6).contains(&value),
        "lm" => value >= 0.0,
        // Chips measure a little above a hundred; 255 and 655.35 are no values.
        "%" => (0.0..=110.0).contains(&value),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_table_is_whole_and_can_be_added_to() {
        let more = serde_json::json!({ "door": {
            "also": ["opening"], "agent": "door-sensor", "action": "report-door",
            "known": "known-door", "yes": "door-open" } });
        let classes = Classes::with(&more).expect("it is whole");
        for (called, expected) in [
            ("temperature", Some("temperature")),
            ("Occupancy", Some("motion")),
            ("co2", Some("carbon_dioxide")),
            ("opening", Some("door")),
            ("linkquality", None),
        ] {
            assert_eq!(classes.find(called), expected, "{called}");
        }
        let half = serde_json::json!({ "door": { "agent": "door", "action": "x" } });
        let unsayable = serde_json::json!({ "lamp": {
            "agent": "lamp", "state": "(lit", "on": "on", "off": "off" } });
        let problem = Classes::with(&unsayable).expect_err("no word");
        assert!(problem.contains("`(lit` cannot be a word"), "{problem}");
        let problem = Classes::with(&half).expect_err("its words are not enough");
        assert!(problem.starts_with("classes.door: write"), "{problem}");
    }

    #[test]
    fn values_that_cannot_be_are_none() {
        for (value, unit, expected) in [
            (21.5, "°C", true),
            (-40.0, "°C", true),
            (-127.0, "°C", false),
            (-327.68, "°C", false),
            (f64::NAN, "°C", false),
            (1e305, "°C", false),
            (f64::INFINITY, "hPa", false),
            (-1e305, "hPa", false),
            (1e13, "W", false),
            (1e9, "lx", false),
            (120_000.0, "lx", true),
            (2e6, "ppm", false),
            (999.0, "°C", false),
            (327.67, "°C", false),
            (95.0, "°C", true),
            (700.0, "°F", false),
            (100.4, "%", true),
            (655.35, "%", false),
            (-1.0, "ppm", false),
            (-1.0, "hPa", true),
        ] {
            assert_eq!(is_possible(value, unit), expected, "{value} {unit}");
        }
    }

    #[test]
    fn units_are_made_ours() {
        for (from, to, value, expected) in [
            ("°F", "°C", 68.0, Some(20.0)),
            ("K", "°C", 293.15, Some(20.0)),
            ("lux", "lx", 12.0, Some(12.0)),
            ("", "ppm", 400.0, Some(400.0)),
            ("hPa", "°C", 1.0, None),
            ("℃", "°C", 20.0, Some(20.0)),
            ("klx", "lx", 1.5, Some(1500.0)),
            ("% RH", "%", 40.0, Some(40.0)),
        ] {
            let converted = conversion(from, to).map(|(factor, more)| value * factor + more);
            let is_it = match (converted, expected) {
                (Some(one), Some(other)) => f64::abs(one - other) < 1e-9,
                (one, other) => one.is_none() && other.is_none(),
            };
            assert!(is_it, "{from} {to}: {converted:?}");
        }
    }
}
