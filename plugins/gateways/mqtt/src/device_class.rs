//! Device classes: the names that devices use for measured quantities and switched things, and the
//! PDDL names for each.

use std::collections::{BTreeMap, BTreeSet};

use actuator::OnOffPredicates;
use serde::Deserialize;
use serde_json::Value;

/// The built-in table of classes.
const BUILT_IN: &str = include_str!("classes.toml");

/// Keys of a class in the config of a gateway.
const KEYS: &[&str] = &[
    "also", "agent", "action", "known", "value", "unit", "yes", "inverted", "state", "own", "at",
    "all", "on", "off",
];

/// All device classes, by the class's own name.
#[derive(Clone, Debug)]
pub(crate) struct DeviceClasses(BTreeMap<String, DeviceClass>);

/// The PDDL names of a device class. The kind of a class is a measured number, a yes or no, or a
/// switch; see [`DeviceClass::kind`].
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
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
}

/// Kind of a device class, with the PDDL names that this kind needs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ClassKind<'c> {
    /// The class is a measured number.
    Number { action: &'c str, known: &'c str, value: &'c str, unit: &'c str },
    /// The class is a yes or no that the device detects. `own` is the pair of the class's
    /// predicates `own` and `at`; `None` unless the class has both.
    YesOrNo { action: &'c str, known: &'c str, yes: &'c str, own: Option<(&'c str, &'c str)> },
    /// The class is a switch, with its predicates and the actions that switch it on and off.
    Switch { words: OnOffPredicates<'c>, on: &'c str, off: &'c str },
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
                     action, known and yes for a yes or no, or state, on and off for a switch"
                ));
            }
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
        let words = [action, known, value, yes, state, own, at, on, off].into_iter().flatten();
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
        let (action, known) = (self.action.as_deref()?, self.known.as_deref()?);
        match (&self.value, &self.unit, &self.yes) {
            (Some(value), Some(unit), None) => {
                Some(ClassKind::Number { action, known, value, unit })
            }
            (None, None, Some(yes)) => {
                let own = self.own.as_deref().zip(self.at.as_deref());
                Some(ClassKind::YesOrNo { action, known, yes, own })
            }
            _ => None,
        }
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
                 value, unit, yes, inverted, state, own, at, all, on, off",
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
