//! Parts of a device. One part becomes one agent: all quantities that the device measures, or one
//! thing that is switched, set, triggered or pressed, with all of its properties. `part_model`
//! builds the action models of parts.

use std::time::Duration;

use acl::AgentId;
use actuator::unit_conversion;

use crate::description::{
    DescribedDevice, DeviceFeature, NOT_OF_THE_ROOM, OutgoingMessage, UnusedFeature,
};
use crate::device_class::{ClassKind, DeviceClass, DeviceClasses};
use crate::level::SettableLevels;
use crate::naming::name_of;
use crate::option::{SettableOption, settable_options};
use crate::room_air;
use crate::setting::{DeviceSetting, PressText};

/// Maximum number of reasons that are reported for one device; further reasons are only counted.
const REASONS_MAX: usize = 6;

/// How long a press counts: long enough to plan because of it, and too short for a second reaction.
const PRESSED_FOR: Duration = Duration::from_secs(10);

/// Suffix of the name of a part that consists of the meters of a device only.
const METER: &str = "-meter";

/// The part of a device that one agent represents.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DevicePart {
    /// Identifier of the agent of this part.
    pub(crate) agent: AgentId,
    /// Name of the room of the device.
    pub(crate) room: String,
    pub(crate) features: Vec<ClassifiedFeature>,
    /// Time for which a measured value counts as known; `None` for an unlimited time.
    pub(crate) valid_for: Option<Duration>,
}

/// A feature with a known class.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClassifiedFeature {
    /// The class's own name.
    pub(crate) name: String,
    pub(crate) class: DeviceClass,
    pub(crate) feature: DeviceFeature,
    /// Factor and offset that convert the feature's number to the unit of the class.
    pub(crate) factor: f64,
    pub(crate) offset: f64,
    /// The values that the feature can be set to.
    pub(crate) settable: Settable,
    /// Whether the agent only observes the feature, and another agent announces it.
    pub(crate) is_observed_only: bool,
}

/// The values that a feature can be set to.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Settable {
    /// The feature is not set to one of several values.
    #[default]
    Nothing,
    Levels(SettableLevels),
    /// The options of a choice, or the presses of a device.
    Options(Vec<SettableOption>),
}

/// Result of dividing a device into parts: the features of each part with the suffix of the part's
/// name, and the reasons why other features cannot be used.
pub(crate) struct DividedDevice {
    pub(crate) parts: Vec<(String, Vec<ClassifiedFeature>)>,
    pub(crate) problem: Option<String>,
}

/// Features of a device, sorted by the parts that they become.
#[derive(Default)]
struct SortedFeatures {
    /// Quantities of the room.
    measured: Vec<ClassifiedFeature>,
    /// Quantities of the device itself.
    metered: Vec<ClassifiedFeature>,
    /// Things, each with its name and its features.
    things: Vec<(String, Vec<ClassifiedFeature>)>,
    unused: Vec<UnusedFeature>,
}

impl DividedDevice {
    pub(crate) fn of(device: &DescribedDevice, classes: &DeviceClasses) -> DividedDevice {
        let mut sorted =
            SortedFeatures { unused: device.unused.clone(), ..SortedFeatures::default() };
        let mut features: Vec<_> = device.features.iter().collect();
        features.sort_by_key(|feature| feature.rank);
        let is_in_a_thing = room_air::is_in_a_thing(&device.name);
        for feature in features {
            match known(feature, classes) {
                Ok(known) => sorted.add(known, is_in_a_thing),
                Err(reason) => sorted.unused.push(reason),
            }
        }
        sorted.observe_reached();
        let SortedFeatures { measured, metered, things, unused } = sorted;
        let parts = assembled(measured, metered, things);
        let problem = problem(unused, parts.is_empty());
        DividedDevice { parts, problem }
    }
}

impl SortedFeatures {
    fn add(&mut self, known: ClassifiedFeature, is_in_a_thing: bool) {
        let (name, label) = (&known.name, &known.feature.label);
        match known.class.kind() {
            None => (),
            Some(ClassKind::Switch { .. }) if known.feature.command.is_none() => {
                self.unused.push(UnusedFeature::because(format!(
                    "its {name} `{label}` only reports its state: it cannot be switched"
                )));
            }
            Some(kind) if kind.is_thing() => match echoes_commands(&known.feature) {
                Some(reason) => self.unused.push(UnusedFeature::because(reason)),
                None => self.add_to_thing(known),
            },
            // All contacts of a device are combined, and so are all its motion detectors.
            Some(ClassKind::YesOrNo { .. }) => {
                let is_same = |other: &ClassifiedFeature| {
                    other.name == known.name && other.feature.states == known.feature.states
                };
                if !self.measured.iter().any(is_same) {
                    self.measured.push(known);
                }
            }
            Some(ClassKind::Number { of_device: true, .. }) => {
                add_number(known, &mut self.metered, &mut self.unused);
            }
            Some(_) if known.feature.rank >= NOT_OF_THE_ROOM || is_in_a_thing => {
                self.unused.push(UnusedFeature::as_usual(format!(
                    "its {name} `{label}` is not about the room, as its name shows"
                )));
            }
            Some(_) => add_number(known, &mut self.measured, &mut self.unused),
        }
    }

    fn add_to_thing(&mut self, known: ClassifiedFeature) {
        let thing = known.feature.thing.clone();
        let found = thing.and_then(|thing| {
            let is_it = |features: &[ClassifiedFeature]| {
                features.iter().any(|other| other.feature.thing.as_ref() == Some(&thing))
            };
            self.things.iter_mut().find(|(_, features)| is_it(features))
        });
        match found {
            // The first feature of a class in a thing represents the class; presses are merged.
            Some((_, features)) if features.iter().any(|other| other.name == known.name) => {
                let same = features.iter_mut().find(|other| other.name == known.name);
                same.into_iter().for_each(|first| merge_presses(first, &known));
            }
            // The switch of a thing comes first, because its class names the type of the agent.
            Some((_, features)) => {
                let is_switch = matches!(known.class.kind(), Some(ClassKind::Switch { .. }));
                features.insert(if is_switch { 0 } else { features.len() }, known);
            }
            None => self.things.push((name_of(&known.feature.label), vec![known])),
        }
    }

    /// Adds the measured number that a setting brings about to the features that the setting's
    /// agent observes, such as the temperature to those of a thermostat.
    fn observe_reached(&mut self) {
        for (_, features) in &mut self.things {
            let reached = features.iter().find_map(|known| Some(known.class.reached()?.class));
            let found = self.measured.iter().find(|known| Some(known.name.as_str()) == reached);
            let observed =
                found.map(|known| ClassifiedFeature { is_observed_only: true, ..known.clone() });
            features.extend(observed);
        }
    }
}

/// Adds the presses of `other` to a feature with presses. Does nothing with other features.
fn merge_presses(first: &mut ClassifiedFeature, other: &ClassifiedFeature) {
    let (Some(ClassKind::Press { options: kind, .. }), Settable::Options(options)) =
        (first.class.kind(), &first.settable)
    else {
        return;
    };
    let known = first.feature.states.len();
    let moved = other.options().iter().map(|option| SettableOption {
        source: Some(option.source.unwrap_or(0) + known),
        name: option.name.trim_start_matches(&format!("{kind}-")).to_owned(),
        ..option.clone()
    });
    let own = options.iter().map(|option| SettableOption {
        source: Some(option.source.unwrap_or(0)),
        name: option.name.trim_start_matches(&format!("{kind}-")).to_owned(),
        ..option.clone()
    });
    if let Ok(options) = settable_options(kind, own.chain(moved)) {
        first.settable = Settable::Options(options);
        first.feature.states.extend(other.feature.states.iter().cloned());
    }
}

/// Adds a measured number. The first of several in one device is used.
fn add_number(
    known: ClassifiedFeature,
    measured: &mut Vec<ClassifiedFeature>,
    unused: &mut Vec<UnusedFeature>,
) {
    match measured.iter().find(|other| other.name == known.name) {
        Some(other) if other.feature.rank == known.feature.rank => {
            let (name, used) = (&known.name, &other.feature.label);
            unused.push(UnusedFeature::as_usual(format!(
                "it measures its {name} in several places; `{used}` is used"
            )));
        }
        Some(_) => (),
        None => measured.push(known),
    }
}

/// Returns the parts of a device: one for all that the device measures in its room, and one for
/// each thing. Each part has the suffix that it adds to the device's name, and its features. The
/// meters of a device belong to its only thing, or are a part of their own.
fn assembled(
    measured: Vec<ClassifiedFeature>,
    metered: Vec<ClassifiedFeature>,
    mut things: Vec<(String, Vec<ClassifiedFeature>)>,
) -> Vec<(String, Vec<ClassifiedFeature>)> {
    let mut parts = Vec::new();
    if !measured.is_empty() {
        parts.push((String::new(), measured));
    }
    let is_alone = parts.is_empty() && things.len() == 1;
    let metered = match (&mut things[..], metered.is_empty()) {
        ([(_, features)], false) => {
            features.extend(metered);
            Vec::new()
        }
        _ => metered,
    };
    for (label, features) in things {
        let suffix = if is_alone { String::new() } else { format!("-{label}") };
        // Features with equal labels get different numbers.
        let is_taken = |suffix: &String| parts.iter().any(|(taken, _)| taken == suffix);
        let numbered = (2..).map(|number| format!("{suffix}-{number}"));
        let suffix = std::iter::once(suffix.clone()).chain(numbered).find(|one| !is_taken(one));
        parts.push((suffix.unwrap_or_default(), features));
    }
    if !metered.is_empty() {
        parts.push((METER.to_owned(), metered));
    }
    parts
}

/// Returns a problem if a feature receives commands on the same topic on which it reports its
/// state, because a command would look like a report. Returns `None` if the topics are separate.
fn echoes_commands(feature: &DeviceFeature) -> Option<String> {
    let of_switch = feature.command.iter().flat_map(|command| [&command.on, &command.off]);
    let told = of_switch.map(|message| message.topic.as_str());
    let of_setting = feature.setting.as_ref().and_then(DeviceSetting::topic);
    let is_heard = |told: &&str| {
        feature.states.iter().any(|said| mqtt_link::matches_filter(&said.topic, told))
    };
    let topic = told.chain(of_setting).find(is_heard)?;
    let label = &feature.label;
    Some(format!(
        "its `{label}` reports its state on `{topic}` and receives its commands there: a command \
         would be read as a report; give it a state topic of its own"
    ))
}

/// Whether a feature is the first of its class in a part. The first feature represents all features
/// of its class. A feature that is only observed represents nothing.
pub(crate) fn leads(features: &[ClassifiedFeature], number: usize) -> bool {
    let is_observed_only = features.get(number).is_some_and(|known| known.is_observed_only);
    !is_observed_only && together(features, number).next() == Some(number)
}

/// Returns the indices of all features of a part with the same class as feature `number`. Their
/// states are combined.
pub(crate) fn together(
    features: &[ClassifiedFeature],
    number: usize,
) -> impl Iterator<Item = usize> {
    let name = features.get(number).map(|known| &known.name);
    let all = features.iter().enumerate();
    all.filter(move |(_, other)| Some(&other.name) == name).map(|(number, _)| number)
}

/// Returns a feature together with its class, or the reason why the feature is not used.
fn known(
    feature: &DeviceFeature,
    classes: &DeviceClasses,
) -> Result<ClassifiedFeature, UnusedFeature> {
    let found = classes.find(&feature.class);
    let found = found.and_then(|name| Some((name, classes.get(name)?.clone())));
    let Some((name, class)) = found else {
        let called = &feature.class;
        let reason = format!(
            "there is no class for its {called}; `classes.{called}` in the gateway's config adds \
             one"
        );
        // Most devices have features that no plan needs, such as their battery or their signal.
        return Err(match feature.command {
            Some(_) => UnusedFeature::because(reason),
            None => UnusedFeature::as_usual(reason),
        });
    };
    let (factor, offset) = match class.kind() {
        Some(ClassKind::Number { unit, .. }) => match unit_conversion(&feature.unit, unit) {
            Some(conversion) => conversion,
            None => {
                let said = &feature.unit;
                let reason = format!("its {name} is in `{said}`, which is no {unit}");
                return Err(UnusedFeature::because(reason));
            }
        },
        _ => (1.0, 0.0),
    };
    let settable = settable(feature, &class).map_err(|problem| {
        let label = &feature.label;
        UnusedFeature::because(format!("its {name} `{label}` cannot be set: {problem}"))
    })?;
    let mut feature = feature.clone();
    if matches!(class.kind(), Some(ClassKind::Press { .. } | ClassKind::Trigger { .. })) {
        feature.expires.get_or_insert(PRESSED_FOR);
    }
    if class.inverted {
        std::mem::swap(&mut feature.yes, &mut feature.no);
    }
    let name = name.to_owned();
    Ok(ClassifiedFeature {
        name,
        class,
        feature,
        factor,
        offset,
        settable,
        is_observed_only: false,
    })
}

/// Returns the values that a feature of this class can be set to.
///
/// # Errors
///
/// Returns the reason if the feature has no setting of the class's kind, or an unusable one.
fn settable(feature: &DeviceFeature, class: &DeviceClass) -> Result<Settable, String> {
    match (class.kind(), &feature.setting) {
        (Some(ClassKind::Level { unit, options, .. }), Some(DeviceSetting::Level(level))) => {
            let unit = (unit, class.level_step());
            let levels = SettableLevels::of(level, &feature.unit, unit, options)?;
            Ok(Settable::Levels(levels))
        }
        (Some(ClassKind::Choice { options, .. }), Some(DeviceSetting::Choice(said))) => {
            let option = |(text, message): &(String, OutgoingMessage)| SettableOption {
                name: text.clone(),
                text: text.clone(),
                source: None,
                message: Some(message.clone()),
            };
            settable_options(options, said.iter().map(option)).map(Settable::Options)
        }
        (Some(ClassKind::Press { options, .. }), Some(DeviceSetting::Press(said))) => {
            let option = |PressText { name, text, source }: &PressText| SettableOption {
                name: name.clone(),
                text: text.clone(),
                source: *source,
                message: None,
            };
            settable_options(options, said.iter().map(option)).map(Settable::Options)
        }
        (Some(ClassKind::Trigger { .. }), Some(DeviceSetting::Trigger(_))) => Ok(Settable::Nothing),
        (
            Some(
                ClassKind::Level { .. }
                | ClassKind::Choice { .. }
                | ClassKind::Press { .. }
                | ClassKind::Trigger { .. },
            ),
            _,
        ) => Err("its description says nothing about that".to_owned()),
        _ => Ok(Settable::Nothing),
    }
}

/// Returns the reasons to report about unused features, as one text; `None` if there is nothing to
/// report.
fn problem(unused: Vec<UnusedFeature>, is_useless: bool) -> Option<String> {
    // Ordinary reasons are reported only if no feature of the device can be used and there are no
    // other reasons.
    let tells_usual = is_useless && unused.iter().all(|one| one.is_usual);
    let mut reasons: Vec<String> = Vec::new();
    for one in unused {
        if (tells_usual || !one.is_usual) && !reasons.contains(&one.reason) {
            reasons.push(one.reason);
        }
    }
    if reasons.is_empty() {
        let nothing = "there is no class for anything that it measures or switches";
        return is_useless.then(|| nothing.to_owned());
    }
    let more = reasons.len().saturating_sub(REASONS_MAX);
    reasons.truncate(REASONS_MAX);
    let told = reasons.join("; ");
    Some(if more > 0 { format!("{told}; and {more} more") } else { told })
}

impl ClassifiedFeature {
    /// Whether the feature is something that a person presses.
    pub(crate) fn is_press(&self) -> bool {
        matches!(self.class.kind(), Some(ClassKind::Press { .. }))
    }

    /// Returns the levels that the feature can be set to; `None` if it is not set to a level.
    pub(crate) fn levels(&self) -> Option<&SettableLevels> {
        match &self.settable {
            Settable::Levels(levels) => Some(levels),
            _ => None,
        }
    }

    /// Returns the options that the feature can be set to, or its presses.
    pub(crate) fn options(&self) -> &[SettableOption] {
        match &self.settable {
            Settable::Options(options) => options,
            _ => &[],
        }
    }
}

impl DevicePart {
    /// Returns the index of the switch to which a level belongs, and `None` if it belongs to none.
    pub(crate) fn switch_of(&self, level: usize) -> Option<usize> {
        let class = self.features.get(level)?.class.switch_class()?;
        self.features.iter().position(|known| known.name == class)
    }

    /// Returns the index of the level that belongs to a switch, and `None` if there is none.
    pub(crate) fn level_of(&self, switch: usize) -> Option<usize> {
        let is_level = |level: &usize| self.features[*level].levels().is_some();
        (0..self.features.len())
            .filter(is_level)
            .find(|level| self.switch_of(*level) == Some(switch))
    }

    /// Returns the index of the feature with the measured number that a level brings about; `None`
    /// if there is none.
    pub(crate) fn reached_by(&self, level: usize) -> Option<usize> {
        let class = self.features.get(level)?.class.reached()?.class;
        self.features.iter().position(|known| known.is_observed_only && known.name == class)
    }
}
