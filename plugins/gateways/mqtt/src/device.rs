//! The agent of one part of a device. The agent announces the device's values as facts as soon as
//! they are received. While a feature is unavailable, the agent does not offer the actions of this
//! feature. The agent's actions send commands that switch the device.
//!
//! `feature_tracker` keeps the last values of each feature.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult, OwnFact,
    facts_of, is_possible_value, model_of,
};
use mqtt_link::BrokerConnection;
use pddl::Domain;
use tokio::time::Instant;

use crate::device_class::ClassKind;
use crate::feature_tracker::{FeatureStatus, FeatureTracker, ObservedValue, TextContent};
use crate::part::{ClassifiedFeature, DevicePart, leads};
use crate::text_reading::ReadOutcome;

/// Time limit of a method of the agent.
const METHOD: Duration = Duration::from_secs(5);

/// Time limit for the device's answer to a request or a command.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(4);
const _: () = assert!(ANSWER_TIME_MAX.as_millis() < METHOD.as_millis());

/// Time limit at the start for receiving the values that the broker has retained.
const FIRST_VALUES_TIME_MAX: Duration = Duration::from_millis(200);

/// The device of one agent, or the part of a device that the agent represents.
pub(crate) struct MqttDevice {
    part: DevicePart,
    ontology: Arc<Domain>,
    tracker: FeatureTracker,
}

/// The result of an action: the value of a feature.
pub(crate) struct FeatureValue {
    feature: usize,
    value: ObservedValue,
}

impl MqttDevice {
    pub(crate) fn new(
        part: DevicePart,
        ontology: Arc<Domain>,
        connection: &Arc<BrokerConnection>,
    ) -> MqttDevice {
        let hearing = FeatureTracker::of(&part.features, connection);
        MqttDevice { part, ontology, tracker: hearing }
    }

    /// Returns the index of the first feature of each class; it represents its class.
    fn leading(&self) -> impl Iterator<Item = usize> {
        (0..self.part.features.len()).filter(|feature| leads(&self.part.features, *feature))
    }

    fn known(&self, feature: usize) -> Vec<OwnFact> {
        let Some(known) = self.part.features.get(feature) else { return Vec::new() };
        let (agent, room) = (self.part.agent.as_str(), self.part.room.as_str());
        let term = known.term(agent, room, &self.ontology);
        let unknown = || facts_of(&known.unknown(&term, room));
        let (standing, speaker) = self.tracker.status_with_source(feature, Instant::now());
        let (value, at) = match standing {
            FeatureStatus::Is(value, at) => (value, at),
            FeatureStatus::NotKnown(_) | FeatureStatus::Away(_) => return unknown(),
        };
        let is_switch = matches!(known.class.kind(), Some(ClassKind::Switch { .. }));
        let expires = self.part.features.get(speaker).and_then(|known| known.feature.expires);
        let validity = [self.part.valid_for.filter(|_| !is_switch), expires];
        let validity = validity.into_iter().flatten().min();
        let left = validity.map(|valid_for| valid_for.saturating_sub(at.elapsed()));
        if left.is_some_and(|left| left.is_zero()) {
            return unknown();
        }
        let facts = facts_of(&known.facts(&term, room, value));
        facts.into_iter().map(|fact| OwnFact { known_for: left, ..fact }).collect()
    }

    fn called(&self, method: &str) -> Option<usize> {
        let is_it =
            |known: &ClassifiedFeature| known.methods().iter().any(|(_, called)| called == method);
        self.part.features.iter().position(is_it)
    }
}

impl ClassifiedFeature {
    /// Returns the content of `text` according to the feature's source with the number `source`;
    /// `None` if the text has no value of the feature.
    pub(crate) fn read(&self, source: usize, text: &str) -> Option<TextContent> {
        let source = self.feature.states.get(source)?;
        let is_number = matches!(self.class.kind()?, ClassKind::Number { .. });
        let said = match source.read(text) {
            ReadOutcome::Text(said) => said,
            ReadOutcome::Unknown if self.is_word(text) => text.trim().to_owned(),
            ReadOutcome::Unknown => {
                return Some(TextContent::NotKnown(
                    "it reports that the value is unknown".to_owned(),
                ));
            }
            ReadOutcome::Nothing => return None,
            // Like Home Assistant, uses the text itself if it is one of the expected texts.
            ReadOutcome::Unread(_) if !is_number && self.is_word(text) => text.trim().to_owned(),
            ReadOutcome::Unread(problem) => {
                tracing::debug!(topic = source.topic, "{problem}");
                return None;
            }
        };
        if is_number { self.number(&said) } else { self.yes_or_no(&said) }
    }

    /// Whether `text` as a whole is one of the feature's texts for yes and no.
    fn is_word(&self, text: &str) -> bool {
        let (text, feature) = (text.trim(), &self.feature);
        [&feature.yes, &feature.no].into_iter().flatten().any(|word| word == text)
    }

    fn number(&self, said: &str) -> Option<TextContent> {
        let told: String = said.chars().take(40).collect();
        let Ok(number) = said.parse::<f64>() else {
            return Some(TextContent::NotKnown(format!("it reports `{told}`, which is no number")));
        };
        let Some(ClassKind::Number { unit, .. }) = self.class.kind() else { return None };
        let value = number * self.factor + self.offset;
        if !is_possible_value(value, unit) {
            let problem = format!("it reports {told}, which is impossible in {unit}");
            return Some(TextContent::NotKnown(problem));
        }
        // The value is rounded, so that 68 °F are exactly 20 °C.
        Some(TextContent::Is(ObservedValue::Number((value * 1e6).round() / 1e6)))
    }

    fn yes_or_no(&self, said: &str) -> Option<TextContent> {
        let is = |words: &[String]| words.iter().any(|word| word == said);
        if is(&self.feature.yes) {
            return Some(TextContent::Is(ObservedValue::Yes(true)));
        }
        if is(&self.feature.no) {
            return Some(TextContent::Is(ObservedValue::Yes(false)));
        }
        is(&self.feature.neither).then(|| TextContent::NotKnown(format!("it reports `{said}`")))
    }

    /// Returns a value as PDDL facts. `term` is the feature's term in PDDL.
    fn facts(&self, term: &str, room: &str, value: ObservedValue) -> String {
        match (self.class.kind(), value) {
            (Some(ClassKind::Number { known, .. }), ObservedValue::Number(number)) => {
                format!("({known} {room}) (= {term} {number})")
            }
            (Some(ClassKind::YesOrNo { known, .. }), ObservedValue::Yes(true)) => {
                format!("({known} {room}) {term}")
            }
            (Some(ClassKind::YesOrNo { known, .. }), _) => format!("({known} {room}) (not {term})"),
            (Some(ClassKind::Switch { .. }), ObservedValue::Yes(true)) => term.to_owned(),
            (Some(ClassKind::Switch { .. }), _) => format!("(not {term})"),
            _ => String::new(),
        }
    }

    /// Returns the PDDL facts which state that the value is unknown.
    fn unknown(&self, term: &str, room: &str) -> String {
        match self.class.kind() {
            Some(ClassKind::Number { known, .. }) => format!("(not ({known} {room}))"),
            Some(ClassKind::YesOrNo { known, .. }) => {
                format!("(not ({known} {room})) (unknown {term})")
            }
            Some(ClassKind::Switch { .. }) => format!("(unknown {term})"),
            None => String::new(),
        }
    }

    fn words(&self, value: ObservedValue) -> String {
        match (self.class.kind(), value) {
            (Some(ClassKind::Number { unit, .. }), ObservedValue::Number(number)) => {
                format!("{number} {unit}")
            }
            (Some(ClassKind::YesOrNo { yes, .. }), ObservedValue::Yes(true)) => yes.to_owned(),
            (Some(ClassKind::YesOrNo { yes, .. }), ObservedValue::Yes(false)) => {
                format!("not {yes}")
            }
            // This is the state of the device, not of the room, because other devices in the room
            // may be in another state.
            (Some(ClassKind::Switch { .. }), ObservedValue::Yes(true)) => "on".to_owned(),
            (Some(ClassKind::Switch { .. }), ObservedValue::Yes(false)) => "off".to_owned(),
            _ => String::new(),
        }
    }
}

impl Device for MqttDevice {
    type Yield = FeatureValue;

    fn describe(&self) -> Description {
        let now = Instant::now();
        let offers = |feature: usize| self.tracker.unavailable_reason(feature, now).is_none();
        let model = model_of(&self.part.model(&self.ontology, offers));
        let methods = self.leading().flat_map(|feature| self.part.features[feature].methods());
        let methods = methods.map(|(action, method)| {
            (action, Method { method, arguments: BTreeMap::new(), timeout: Millis(METHOD) })
        });
        Description { model, methods: methods.collect() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let stands = facts_of(&self.part.place(&self.ontology));
        stands.into_iter().chain(self.leading().flat_map(|feature| self.known(feature))).collect()
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let mut hearing = self.tracker.clone();
        Some(Box::pin(async move {
            // After this time, the values received so far are used.
            let _ = tokio::time::timeout(FIRST_VALUES_TIME_MAX, async {
                while !hearing.is_complete() {
                    hearing.wait_for_text().await;
                }
            })
            .await;
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<FeatureValue, MethodFailure>> {
        let Some(feature) = self.called(&call.method) else {
            let unknown = MethodFailure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        if let Some(problem) = self.tracker.unavailable_reason(feature, Instant::now()) {
            return Box::pin(std::future::ready(Err(MethodFailure::Driver(problem))));
        }
        let known = self.part.features[feature].clone();
        let hearing = self.tracker.clone();
        let wanted = match call.method.as_str() {
            "on" => Some(true),
            "off" => Some(false),
            _ => None,
        };
        Box::pin(async move {
            match (wanted, &known.feature.command) {
                (Some(is_on), Some(command)) => {
                    let telegram = if is_on { &command.on } else { &command.off };
                    hearing.publish(telegram).map_err(MethodFailure::Driver)?;
                }
                // Any other method measures; the value is requested only if it is unknown.
                _ => hearing.ask(feature),
            }
            let value = wait_for_value(&known, hearing, feature, wanted)
                .await
                .map_err(MethodFailure::Driver)?;
            Ok(FeatureValue { feature, value })
        })
    }

    fn on_success(&mut self, _call: &MethodCall, measured: FeatureValue) -> MethodResult {
        let Some(known) = self.part.features.get(measured.feature) else {
            return MethodResult::default();
        };
        // A device that does not report its state is assumed to be in the last commanded state.
        if known.feature.states.is_empty() {
            self.tracker.assume_value(measured.feature, measured.value);
        }
        let room = &self.part.room;
        let detail = format!("{} at {room}", known.words(measured.value));
        let term = known.term(self.part.agent.as_str(), room, &self.ontology);
        let observations = facts_of(&known.facts(&term, room, measured.value));
        MethodResult {
            detail,
            observations: observations.into_iter().map(|fact| fact.fact).collect(),
        }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<MqttDevice>>> {
        let mut hearing = self.tracker.clone();
        Some(Box::pin(async move {
            hearing.wait_for_news().await;
            // A text that arrives from here on is a new event, even while the current one is being
            // reported.
            let stir: DeviceEvent<MqttDevice> = Box::new(move |device| {
                device.tracker = hearing;
                Vec::new()
            });
            stir
        }))
    }
}

/// Waits for a value of a feature. If `wanted` is not `None`, waits for this value.
async fn wait_for_value(
    known: &ClassifiedFeature,
    mut hearing: FeatureTracker,
    feature: usize,
    wanted: Option<bool>,
) -> Result<ObservedValue, String> {
    let Some(source) = known.feature.states.first() else {
        // A device that does not report its state is assumed to be in the last commanded state.
        let problem = || "learn its state: it reports none".to_owned();
        return wanted.map(ObservedValue::Yes).ok_or_else(problem);
    };
    let topic = &source.topic;
    let until = Instant::now() + ANSWER_TIME_MAX;
    loop {
        let standing = hearing.status(feature, Instant::now());
        match &standing {
            FeatureStatus::Is(value, _)
                if wanted.is_none_or(|is_on| *value == ObservedValue::Yes(is_on)) =>
            {
                return Ok(*value);
            }
            FeatureStatus::Away(problem) => return Err(problem.clone()),
            _ => (),
        }
        if tokio::time::timeout_at(until, hearing.wait_for_text()).await.is_ok() {
            continue;
        }
        return Err(match (wanted, standing) {
            (Some(_), _) => format!("receive a report on `{topic}` that it is done"),
            (None, FeatureStatus::NotKnown(Some(reason))) => {
                format!("find the {} in the message on `{topic}`: {reason}", known.name)
            }
            (None, _) => format!("receive a value on `{topic}`: nothing was received yet"),
        });
    }
}
