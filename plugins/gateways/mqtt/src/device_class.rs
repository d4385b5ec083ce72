//! Device classes: the names that devices use for measured quantities and switched things, and the
//! PDDL names for each.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use actuator::OnOffPredicates;
use agent::config_duration;
use serde::Deserialize;
use serde_json::Value;

/// The built-in table of classes.
const BUILT_IN: &str = include_str!("classes.toml");

/// Keys of a class in the config of a gateway.
const KEYS: &[&str] = &[
    "also",
    "agent",
    "action",
    "known",
    "value",
    "unit",
    "yes",
    "inverted",
    "state",
    "own",
    "at",
    "all",
    "on",
    "off",
    "device",
    "level",
    "step",
    "options",
    "with",
    "remembers",
    "within",
    "tolerance",
    "reaches",
    "up",
    "down",
    "choice",
    "press",
    "trigger",
];

/// How long a command may take until the device reports that it is done, unless the class states
/// another time. Lamps and relays report within a second.
const DONE_WITHIN: Duration = Duration::from_secs(4);

/// Minimum and maximum of the time that a class may state. Longer work would block the agent for a day.
const DONE_WITHIN_MIN: Duration = Duration::from_millis(1);
const DONE_WITHIN_MAX: Duration = Duration::from_secs(24 * 3_600);

/// Distance between two levels of a class that states none.
const STEP: f64 = 1.0;

/// All device classes, by the class's own name.
#[derive(Clone, Debug)]
pub(crate) struct DeviceClasses(BTreeMap<String, DeviceClass>);

/// The PDDL names of a device class. The kind of a class is a measured number, a yes or no, a
/// switch, a level, a choice, a press or a trigger; see [`DeviceClass::kind`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct DeviceClass {
    /// Other names of the class that devices use.
    #[serde(default)]
    also: Vec<String>,
    /// PDDL type of an agent with a feature of the class.
    pub(crate) agent: String,
    /// Name of the action that measures the value.
    action: Option<String>,
    /// Name of the predicate which states that the value is known in a room.
    known: Option<String>,
    /// Name of the PDDL function with the value in a room.
    value: Option<String>,
    /// Unit of the value in PDDL.
    unit: Option<String>,
    /// Name of the predicate that is true for a room if the device reports yes.
    yes: Option<String>,
    /// Whether the device reports the inverse of the predicate. For example, devices report yes for
    /// an *open* contact, and the predicate is *closed*.
    #[serde(default)]
    pub(crate) inverted: bool,
    /// Name of the predicate that is true for a room if the device is switched on.
    state: Option<String>,
    /// Name of the predicate that is true for the device itself if it is on, or if it reports yes.
    own: Option<String>,
    /// Name of the predicate which states that the device is in a room. It is used if the ontology
    /// derives `yes` from `own` and this predicate.
    at: Option<String>,
    /// Whether `state` requires all such devices in the room to be on. If `false`, one device is
    /// enough.
    #[serde(default)]
    all: bool,
    /// Names of the actions that switch the device on and off.
    on: Option<String>,
    off: Option<String>,
    /// Whether the number is about the device itself instead of its room: the power of a plug.
    #[serde(default)]
    device: bool,
    /// Name of the PDDL function with the number to which the device is set.
    level: Option<String>,
    /// Distance between two levels, in the class's unit.
    step: Option<f64>,
    /// PDDL type of the levels, the options of a choice, or the presses.
    options: Option<String>,
    /// Class of the switch of the same thing: the level is 0 if the thing is switched off.
    with: Option<String>,
    /// Whether the thing remembers its level while it is switched off, as a lamp does. Otherwise it
    /// is at its highest level when it is on: an open blind.
    #[serde(default)]
    pub(crate) remembers: bool,
    /// How long a command may take, such as `"2m"`.
    within: Option<String>,
    /// Difference between the commanded and the reported number that does not count.
    tolerance: Option<f64>,
    /// Class of the measured number of a room that the level brings about: a thermostat reaches a
    /// temperature.
    reaches: Option<String>,
    /// Names of the actions that bring the measured number up and down to a level.
    up: Option<String>,
    down: Option<String>,
    /// Name of the predicate which states that an option is chosen.
    choice: Option<String>,
    /// Name of the predicate which states that a person has pressed something a moment ago.
    press: Option<String>,
    /// Name of the predicate which states that something was triggered a moment ago.
    trigger: Option<String>,
}

/// A level class that brings about a measured number: the class of that number, and the names of
/// the actions that bring it up and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReachedNumber<'c> {
    pub(crate) class: &'c str,
    pub(crate) up: Option<&'c str>,
    pub(crate) down: Option<&'c str>,
}

/// Kind of a device class, with the PDDL names that this kind needs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ClassKind<'c> {
    /// The class is a measured number.
    Number { action: &'c str, known: &'c str, value: &'c str, unit: &'c str, of_device: bool },
    /// The class is a yes or no that the device detects. `own` is the pair of the class's
    /// predicates `own` and `at`; `None` unless the class has both.
    YesOrNo { action: &'c str, known: &'c str, yes: &'c str, own: Option<(&'c str, &'c str)> },
    /// The class is a switch, with its predicates and the actions that switch it on and off.
    Switch { words: OnOffPredicates<'c>, on: &'c str, off: &'c str },
    /// The class is a number that is set to one of several levels; `level` is a function of the
    /// device, and `options` the type of the levels.
    Level { level: &'c str, unit: &'c str, options: &'c str },
    /// The class is a choice of one of several options.
    Choice { choice: &'c str, options: &'c str },
    /// The class is something that a person presses.
    Press { press: &'c str, options: &'c str },
    /// The class is something that is triggered, and has no state of its own.
    Trigger { trigger: &'c str, action: &'c str },
}

impl ClassKind<'_> {
    /// Whether a command determines the state, so that a person may change it while the broker is
    /// away.
    pub(crate) fn is_set(&self) -> bool {
        match self {
            ClassKind::Switch { .. } | ClassKind::Level { .. } | ClassKind::Choice { .. } => true,
            ClassKind::Number { .. }
            | ClassKind::YesOrNo { .. }
            | ClassKind::Press { .. }
            | ClassKind::Trigger { .. } => false,
        }
    }

    /// Whether a feature of the class is an agent of its own, or a part of one, beside the agent
    /// of all that the device measures.
    pub(crate) fn is_thing(&self) -> bool {
        !matches!(self, ClassKind::Number { .. } | ClassKind::YesOrNo { .. })
    }
}

impl DeviceClasses {
    /// Returns the built-in classes, extended by the entries of `said`. An entry overrides the
    /// built-in class of the same name.
    ///
    /// # Errors
    ///
    /// Returns an error if an entry is invalid, lacks names, or has a name that PDDL does not
    /// allow.
    pub(crate) fn with(said: &Value) -> Result<DeviceClasses, String> {
        let mut classes: BTreeMap<String, DeviceClass> =
            toml::from_str(BUILT_IN).expect("invariant: a test reads what is built in");
        if !said.is_null() {
            let more = read(said)?;
            // A name in an entry of `said` no longer refers to a built-in class.
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
                    "classes.{name}: write action, known, value and unit for a number, \
                     action, known and yes for a yes or no, state, on and off for a switch, \
                     level, unit and options for a level, choice and options for a choice, \
                     press and options for a press, or trigger and action for a trigger"
                ));
            }
            class.numbers().map_err(|problem| format!("classes.{name}: {problem}"))?;
        }
        let unsayable =
            classes.iter().find_map(|(name, class)| Some((name, class.invalid_name()?)));
        match unsayable {
            Some((name, word)) => Err(format!(
                "classes.{name}: `{word}` cannot be a name in PDDL; use a-z, 0-9, - and _"
            )),
            None => Ok(DeviceClasses(classes)),
        }
    }

    /// Returns the class's own name for the name `called` that a device uses; `None` if there is no
    /// such class. Case is ignored.
    pub(crate) fn find(&self, called: &str) -> Option<&str> {
        let called = called.to_ascii_lowercase();
        if let Some((name, _)) = self.0.get_key_value(&called) {
            return Some(name);
        }
        let is_it = |(_, class): &(&String, &DeviceClass)| class.also.contains(&called);
        self.0.iter().find(is_it).map(|(name, _)| name.as_str())
    }

    /// Returns a class by its own name; `None` if there is no such class.
    pub(crate) fn get(&self, name: &str) -> Option<&DeviceClass> {
        self.0.get(name)
    }
}

/// Reads the classes in the config of a gateway.
///
/// # Errors
///
/// Returns an error that names the class, and the unknown key if there is one.
fn read(said: &Value) -> Result<BTreeMap<String, DeviceClass>, String> {
    let entries = said.as_object().ok_or("classes: write a table for each class")?;
    let class = |(name, entry): (&String, &Value)| {
        let keys = entry.as_object().into_iter().flatten().map(|(key, _)| key.as_str());
        if let Some(unknown) = { keys }.find(|key| !KEYS.contains(key)) {
            let help = match pddl::nearest(unknown, KEYS.iter().copied()) {
                Some(nearest) => format!("did you mean `{nearest}`?"),
                None => format!("there are {}", KEYS.join(", ")),
            };
            return Err(format!("classes.{name}: there is no key `{unknown}`; {help}"));
        }
        if !entry.is_object() {
            return Err(format!("classes.{name}: write a table, such as {name} = {{ agent = … }}"));
        }
        let class = serde_json::from_value(entry.clone());
        Ok((name.clone(), class.map_err(|error| format!("classes.{name}: {error}"))?))
    };
    entries.iter().map(class).collect()
}

impl DeviceClass {
    /// Returns a name in the class's entry that PDDL does not allow; `None` if PDDL allows all
    /// names.
    fn invalid_name(&self) -> Option<&str> {
        let DeviceClass { agent, action, known, value, yes, state, own, at, on, off, .. } = self;
        let DeviceClass { level, options, up, down, choice, press, trigger, .. } = self;
        let words = [action, known, value, yes, state, own, at, on, off].into_iter().flatten();
        let more = [level, options, up, down, choice, press, trigger].into_iter().flatten();
        let words = words.chain(more);
        let mut words = std::iter::once(agent).chain(words).map(String::as_str);
        words.find(|word| acl::AgentId::new(word).is_err())
    }

    /// Returns the kind of the class; `None` if the class does not have all names of any kind.
    pub(crate) fn kind(&self) -> Option<ClassKind<'_>> {
        if let (Some(state), Some(on), Some(off)) = (&self.state, &self.on, &self.off) {
            let (agent, own, all) = (&self.agent, self.own.as_ref()?, self.all);
            return Some(ClassKind::Switch {
                words: OnOffPredicates { agent, state, own, all },
                on,
                off,
            });
        }
        if let Some(options) = self.options.as_deref() {
            return self.kind_of_options(options);
        }
        if let (Some(trigger), Some(action)) = (&self.trigger, &self.action) {
            return Some(ClassKind::Trigger { trigger, action });
        }
        let (action, known) = (self.action.as_deref()?, self.known.as_deref()?);
        match (&self.value, &self.unit, &self.yes) {
            (Some(value), Some(unit), None) => {
                Some(ClassKind::Number { action, known, value, unit, of_device: self.device })
            }
            (None, None, Some(yes)) => {
                let own = self.own.as_deref().zip(self.at.as_deref());
                Some(ClassKind::YesOrNo { action, known, yes, own })
            }
            _ => None,
        }
    }

    /// Returns the kind of a class with objects of the type `options`; `None` if the class lacks a
    /// name.
    fn kind_of_options<'c>(&'c self, options: &'c str) -> Option<ClassKind<'c>> {
        match (&self.level, &self.choice, &self.press) {
            (Some(level), None, None) => {
                Some(ClassKind::Level { level, unit: self.unit.as_deref()?, options })
            }
            (None, Some(choice), None) => Some(ClassKind::Choice { choice, options }),
            (None, None, Some(press)) => Some(ClassKind::Press { press, options }),
            _ => None,
        }
    }

    /// Returns how long a command may take, and the difference between the commanded and the
    /// reported number that does not count.
    ///
    /// # Errors
    ///
    /// Returns an error that names the key with an unusable value.
    fn numbers(&self) -> Result<(Duration, f64), String> {
        let within = match &self.within {
            Some(text) => config_duration("within", text, DONE_WITHIN_MIN..=DONE_WITHIN_MAX)?,
            None => DONE_WITHIN,
        };
        let tolerance = self.tolerance.unwrap_or(0.0);
        if !(0.0..1e6).contains(&tolerance) {
            return Err("tolerance: write a number of 0 or more".to_owned());
        }
        if self.step.is_some_and(|step| !(step > 0.0 && step.is_finite())) {
            return Err("step: write a number greater than 0".to_owned());
        }
        Ok((within, tolerance))
    }

    /// Returns how long a command may take until the device reports that it is done.
    pub(crate) fn done_within(&self) -> Duration {
        self.numbers().map_or(DONE_WITHIN, |(within, _)| within)
    }

    /// Returns the difference between the commanded and the reported number that does not count.
    pub(crate) fn tolerated(&self) -> f64 {
        self.numbers().map_or(0.0, |(_, tolerance)| tolerance)
    }

    /// Returns the distance between two levels of the class.
    pub(crate) fn level_step(&self) -> f64 {
        self.step.unwrap_or(STEP)
    }

    /// Returns the class of the switch that belongs to the same thing; `None` if the class has none.
    pub(crate) fn switch_class(&self) -> Option<&str> {
        self.with.as_deref()
    }

    /// Returns the measured number that the class brings about; `None` if it brings about none.
    pub(crate) fn reached(&self) -> Option<ReachedNumber<'_>> {
        let class = self.reaches.as_deref()?;
        Some(ReachedNumber { class, up: self.up.as_deref(), down: self.down.as_deref() })
    }
}

#[cfg(test)]
mod tests {
    use actuator::OnOffNames;
    use serde_json::json;

    use super::*;

    /// A lamp of the gateway and one of a driver need the same names, so that one goal can be about
    /// both.
    #[test]
    fn switched_classes_have_the_names_of_all_drivers() {
        let classes = DeviceClasses::with(&serde_json::Value::Null).expect("it is whole");
        for (class, names) in [
            ("light", OnOffNames::LAMP),
            ("switch", OnOffNames::RELAY),
            ("lock", OnOffNames::DOOR_LOCK),
        ] {
            let OnOffNames { predicates: words, on, off } = names;
            let kind = classes.get(class).and_then(DeviceClass::kind);
            assert_eq!(kind, Some(ClassKind::Switch { words, on, off }), "{class}");
        }
    }

    #[test]
    fn the_built_in_table_is_complete_and_can_be_extended() {
        let more = serde_json::json!({ "door": {
            "also": ["opening"], "agent": "door-sensor", "action": "report-door",
            "known": "known-door", "yes": "door-open" } });
        let classes = DeviceClasses::with(&more).expect("it is whole");
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
        let problem = DeviceClasses::with(&unsayable).expect_err("no word");
        assert!(problem.contains("`(lit` cannot be a name"), "{problem}");
        let problem = DeviceClasses::with(&half).expect_err("its words are not enough");
        assert!(problem.starts_with("classes.door: write"), "{problem}");
    }

    #[test]
    fn a_misspelt_key_is_reported_with_the_nearest_one() {
        for (entry, expected) in [
            (
                json!({ "agnet": "barometer" }),
                "classes.pressure: there is no key `agnet`; did you mean `agent`?",
            ),
            (
                json!({ "agent": "barometer", "unitt": "hPa" }),
                "classes.pressure: there is no key `unitt`; did you mean `unit`?",
            ),
            (
                json!({ "colour": "red" }),
                "classes.pressure: there is no key `colour`; there are also, agent, action, known, \
                 value, unit, yes, inverted, state, own, at, all, on, off, device, level, step, \
                 options, with, remembers, within, tolerance, reaches, up, down, choice, press, \
                 trigger",
            ),
            (
                json!({ "agent": 5 }),
                "classes.pressure: invalid type: integer `5`, expected a string",
            ),
            (json!({}), "classes.pressure: missing field `agent`"),
        ] {
            let problem = DeviceClasses::with(&json!({ "pressure": entry })).expect_err(expected);
            assert_eq!(problem, expected);
        }
        assert!(DeviceClasses::with(&json!("pressure")).is_err());
        // The list of keys has all keys of the type.
        let unknown = serde_json::from_value::<DeviceClass>(json!({ "?": 0 })).expect_err("no key");
        let quoted = unknown.to_string();
        let known: Vec<_> = quoted.split('`').skip(1).step_by(2).skip(1).collect();
        assert_eq!(known, KEYS);
    }
}
