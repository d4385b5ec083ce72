//! Parts of a device. One part becomes one agent: all quantities that the device measures, or one
//! thing that it switches.

use std::fmt::Write as _;
use std::time::Duration;

use acl::AgentId;
use actuator::{is_derived, unit_conversion};
use pddl::Domain;

use crate::description::{DescribedDevice, DeviceFeature, NOT_OF_THE_ROOM, UnusedFeature};
use crate::device_class::{ClassKind, DeviceClass, DeviceClasses};
use crate::naming::name_of;
use crate::room_air;

/// Maximum number of reasons that are reported for one device; further reasons are only counted.
const REASONS_MAX: usize = 6;

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
}

/// Result of dividing a device into parts: the features of each part with the suffix of the part's
/// name, and the reasons why other features cannot be used.
pub(crate) struct DividedDevice {
    pub(crate) parts: Vec<(String, Vec<ClassifiedFeature>)>,
    pub(crate) problem: Option<String>,
}

impl DividedDevice {
    pub(crate) fn of(device: &DescribedDevice, classes: &DeviceClasses) -> DividedDevice {
        let (mut measured, mut switched) = (Vec::<ClassifiedFeature>::new(), Vec::new());
        let mut unused = device.unused.clone();
        let mut features: Vec<_> = device.features.iter().collect();
        features.sort_by_key(|feature| feature.rank);
        let is_in_a_thing = room_air::is_in_a_thing(&device.name);
        for feature in features {
            let known = match known(feature, classes) {
                Ok(known) => known,
                Err(reason) => {
                    unused.push(reason);
                    continue;
                }
            };
            match known.class.kind() {
                Some(ClassKind::Switch { .. }) if known.feature.command.is_some() => {
                    match echoes_commands(&known.feature) {
                        Some(reason) => unused.push(UnusedFeature::because(reason)),
                        None => switched.push(known),
                    }
                }
                Some(ClassKind::Switch { .. }) => {
                    let (name, label) = (&known.name, &known.feature.label);
                    unused.push(UnusedFeature::because(format!(
                        "its {name} `{label}` only reports its state: it cannot be switched"
                    )));
                }
                None => (),
                // All contacts of a device are combined, and so are all its motion detectors.
                Some(ClassKind::YesOrNo { .. }) => {
                    let is_same = |other: &ClassifiedFeature| {
                        other.name == known.name && other.feature.states == known.feature.states
                    };
                    if !measured.iter().any(is_same) {
                        measured.push(known);
                    }
                }
                Some(_) if known.feature.rank >= NOT_OF_THE_ROOM || is_in_a_thing => {
                    let (name, label) = (&known.name, &known.feature.label);
                    unused.push(UnusedFeature::as_usual(format!(
                        "its {name} `{label}` is not about the room, as its name shows"
                    )));
                }
                // The first of several thermometers in one device is used.
                Some(_) => match measured.iter().find(|other| other.name == known.name) {
                    Some(other) if other.feature.rank == known.feature.rank => {
                        let (name, speaks) = (&known.name, &other.feature.label);
                        unused.push(UnusedFeature::as_usual(format!(
                            "it measures its {name} in several places; `{speaks}` is used"
                        )));
                    }
                    Some(_) => (),
                    None => measured.push(known),
                },
            }
        }
        let parts = assembled(measured, switched);
        let problem = problem(unused, parts.is_empty());
        DividedDevice { parts, problem }
    }
}

/// Returns the parts of a device: one for all that the device measures, and one for each thing that
/// it switches. Each part has the suffix that it adds to the device's name, and its features.
fn assembled(
    measured: Vec<ClassifiedFeature>,
    switched: Vec<ClassifiedFeature>,
) -> Vec<(String, Vec<ClassifiedFeature>)> {
    let mut parts = Vec::new();
    if !measured.is_empty() {
        parts.push((String::new(), measured));
    }
    let is_alone = parts.is_empty() && switched.len() == 1;
    for known in switched {
        let suffix = match is_alone {
            true => String::new(),
            false => format!("-{}", name_of(&known.feature.label)),
        };
        // Features with equal labels get different numbers.
        let is_taken = |suffix: &String| parts.iter().any(|(taken, _)| taken == suffix);
        let numbered = (2..).map(|number| format!("{suffix}-{number}"));
        let suffix = std::iter::once(suffix.clone()).chain(numbered).find(|one| !is_taken(one));
        parts.push((suffix.unwrap_or_default(), vec![known]));
    }
    parts
}

/// Returns a problem if a feature receives commands on the same topic on which it reports its
/// state, because a command would look like a report. Returns `None` if the topics are separate.
fn echoes_commands(feature: &DeviceFeature) -> Option<String> {
    let command = feature.command.as_ref()?;
    let told = [command.on.topic.as_str(), command.off.topic.as_str()];
    let is_heard = |told: &&str| {
        feature.states.iter().any(|said| mqtt_link::matches_filter(&said.topic, told))
    };
    let topic = told.into_iter().find(is_heard)?;
    let label = &feature.label;
    Some(format!(
        "its `{label}` reports its state on `{topic}` and receives its commands there: a command \
         would be read as a report; give it a state topic of its own"
    ))
}

/// Whether a feature is the first of its class in a part. The first feature represents all features
/// of its class.
pub(crate) fn leads(features: &[ClassifiedFeature], number: usize) -> bool {
    together(features, number).next() == Some(number)
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
    let mut feature = feature.clone();
    if class.inverted {
        std::mem::swap(&mut feature.yes, &mut feature.no);
    }
    Ok(ClassifiedFeature { name: name.to_owned(), class, feature, factor, offset })
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

impl DevicePart {
    /// Returns the action model of the agent, with the types, predicates and functions that the
    /// shared ontology lacks. `offers` returns for each feature whether its actions can be used at
    /// present.
    pub(crate) fn model(&self, ontology: &Domain, offers: impl Fn(usize) -> bool) -> String {
        let DevicePart { agent, .. } = self;
        let kind = self.features.first().map_or("sensor", |known| known.class.agent.as_str());
        let mut words = MissingDeclarations::of(ontology);
        let is_switch = self
            .features
            .iter()
            .any(|known| matches!(known.class.kind(), Some(ClassKind::Switch { .. })));
        let stands = if is_switch { "installed" } else { "located" };
        words.has_type(kind, if is_switch { "" } else { "sensor" });
        let mut actions = String::new();
        let all = self.features.iter().enumerate();
        for (number, known) in all.filter(|(number, _)| leads(&self.features, *number)) {
            let before = actions.len();
            known.describe(kind, stands, &mut words, &mut actions);
            if !offers(number) {
                actions.truncate(before);
            }
        }
        let installed = match stands {
            // A lamp and a lock get the same declaration, so that one ecosystem can have both.
            "installed" => "(installed ?d - object ?r - room)",
            _ => "",
        };
        let place = self.place(ontology);
        let MissingDeclarations { types, predicates, functions, axioms, .. } = words;
        let section = |name: &str, body: String| match body.trim() {
            "" => String::new(),
            body => format!("(:{name} {body})"),
        };
        format!(
            "(define (agent {agent}) (:domain {}) {} {} {} {axioms}
               (:objects {agent} - {kind}) (:init {place}) {actions})",
            ontology.name,
            section("types", types),
            section("predicates", predicates + installed),
            section("functions", functions),
        )
    }

    /// Returns the location of the device, as PDDL facts.
    pub(crate) fn place(&self, ontology: &Domain) -> String {
        let DevicePart { agent, room, features, .. } = self;
        let is_switch = |known: &ClassifiedFeature| {
            matches!(known.class.kind(), Some(ClassKind::Switch { .. }))
        };
        let stands = if features.iter().any(is_switch) { "installed" } else { "located" };
        let mut place = format!("({stands} {agent} {room})");
        let leading = features.iter().enumerate().filter(|(number, _)| leads(features, *number));
        for (_, known) in leading {
            if let Some(ClassKind::YesOrNo { yes, own: Some((_, at)), .. }) = known.class.kind()
                && is_derived(ontology, yes)
            {
                let _ = write!(place, " ({at} {agent} {room})");
            }
        }
        place
    }
}

impl ClassifiedFeature {
    fn describe(
        &self,
        kind: &str,
        stands: &str,
        words: &mut MissingDeclarations<'_>,
        actions: &mut String,
    ) {
        let mut action = |name: &str, effect: &str, observed: &str| {
            let _ = write!(
                actions,
                "(:action {name} :agent ?d - {kind} :parameters (?r - room)
                   :precondition ({stands} ?d ?r)
                   :effect (and {effect} (increase (total-cost) 1)) {observed})"
            );
        };
        let term = self.term("?d", "?r", words.ontology);
        match self.class.kind() {
            Some(ClassKind::Number { action: name, known, value, .. }) => {
                words.has_predicate(known);
                words.has_function(value);
                action(name, &format!("({known} ?r)"), &format!(":observe {term}"));
            }
            Some(ClassKind::YesOrNo { action: name, known, yes, .. }) => {
                words.has_predicate(known);
                words.has_predicate(yes);
                action(name, &format!("({known} ?r)"), &format!(":observe {term}"));
            }
            Some(ClassKind::Switch { words: of, on, off }) => {
                words.predicates += &of.predicates(words.ontology);
                words.axioms += &of.axiom(words.ontology);
                action(on, &term, "");
                action(off, &format!("(not {term})"), "");
            }
            None => (),
        }
    }

    /// Returns the PDDL term for the feature's value: a function or a predicate, of the device or
    /// of its room.
    pub(crate) fn term(&self, device: &str, room: &str, ontology: &Domain) -> String {
        match self.class.kind() {
            Some(ClassKind::Number { value, .. }) => format!("({value} {room})"),
            Some(ClassKind::YesOrNo { yes, own: Some((own, _)), .. })
                if is_derived(ontology, yes) =>
            {
                format!("({own} {device})")
            }
            Some(ClassKind::YesOrNo { yes, .. }) => format!("({yes} {room})"),
            Some(ClassKind::Switch { words, .. }) => words.term(device, room, ontology),
            None => String::new(),
        }
    }

    /// Returns the names of the actions of the feature, each with the name of the method that
    /// performs it.
    pub(crate) fn methods(&self) -> Vec<(String, String)> {
        match self.class.kind() {
            Some(ClassKind::Number { action, .. } | ClassKind::YesOrNo { action, .. }) => {
                vec![(action.to_owned(), format!("read-{}", self.name))]
            }
            Some(ClassKind::Switch { on, off, .. }) => {
                vec![(on.to_owned(), "on".to_owned()), (off.to_owned(), "off".to_owned())]
            }
            None => Vec::new(),
        }
    }
}

/// The declarations that an action model needs and that the ontology lacks.
struct MissingDeclarations<'o> {
    ontology: &'o Domain,
    types: String,
    predicates: String,
    functions: String,
    axioms: String,
}

impl<'o> MissingDeclarations<'o> {
    fn of(ontology: &'o Domain) -> MissingDeclarations<'o> {
        let (types, predicates, functions, axioms) = Default::default();
        MissingDeclarations { ontology, types, predicates, functions, axioms }
    }

    fn has_type(&mut self, name: &str, parent: &str) {
        let is_there = |wanted: &str| self.ontology.types.iter().any(|one| one.name == wanted);
        if !is_there(name) {
            let parent = if is_there(parent) { parent } else { "object" };
            let _ = write!(self.types, "{name} - {parent} ");
        }
    }

    fn has_predicate(&mut self, name: &str) {
        if !self.ontology.predicates.iter().any(|one| one.name == name) {
            let _ = write!(self.predicates, "({name} ?r - room) ");
        }
    }

    fn has_function(&mut self, name: &str) {
        if !self.ontology.functions.iter().any(|one| one.name == name) {
            let _ = write!(self.functions, "({name} ?r - room) ");
        }
    }
}
