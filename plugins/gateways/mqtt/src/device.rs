//! The agent of one part of a device. The agent announces the device's values as facts as soon as
//! they are received. While a feature is unavailable, the agent does not offer the actions of this
//! feature. The agent's actions send commands, and are done when the device reports it.
//!
//! `feature_tracker` keeps the last values of each feature, `feature_reading` reads and writes
//! them, `command` carries actions out.

use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult, OwnFact,
    facts_of, model_of,
};
use mqtt_link::BrokerConnection;
use pddl::Domain;
use tokio::time::Instant;

use crate::command::{Command, DoneCommand, stand_still};
use crate::feature_tracker::{FeatureStatus, FeatureTracker, ObservedValue};
use crate::part::{DevicePart, leads};

/// Time that a method has in addition to the time for the device's report, so that the reason of a
/// failure is reported in time.
const MARGIN: Duration = Duration::from_secs(1);

/// Time limit at the start for receiving the values that the broker has retained.
const FIRST_VALUES_TIME_MAX: Duration = Duration::from_millis(200);

/// The device of one agent, or the part of a device that the agent represents.
pub(crate) struct MqttDevice {
    part: Arc<DevicePart>,
    ontology: Arc<Domain>,
    tracker: FeatureTracker,
}

impl MqttDevice {
    pub(crate) fn new(
        part: DevicePart,
        ontology: Arc<Domain>,
        connection: &Arc<BrokerConnection>,
    ) -> MqttDevice {
        let hearing = FeatureTracker::of(&part.features, connection);
        MqttDevice { part: Arc::new(part), ontology, tracker: hearing }
    }

    /// Returns the index of the first feature of each class; it represents its class.
    fn leading(&self) -> impl Iterator<Item = usize> {
        (0..self.part.features.len()).filter(|feature| leads(&self.part.features, *feature))
    }

    fn known(&self, feature: usize) -> Vec<OwnFact> {
        let Some(known) = self.part.features.get(feature) else { return Vec::new() };
        let place = (self.part.agent.as_str(), self.part.room.as_str());
        let term = known.term(place.0, place.1, &self.ontology);
        let unknown = || facts_of(&known.unknown(&term, place));
        let (standing, speaker) = self.part.status(&self.tracker, feature, Instant::now());
        let (value, at) = match standing {
            FeatureStatus::Is(value, at) => (value, at),
            FeatureStatus::NotKnown(_) | FeatureStatus::Away(_) => return unknown(),
        };
        let is_set = known.class.kind().is_some_and(|kind| kind.is_set());
        let expires = self.part.features.get(speaker).and_then(|known| known.feature.expires);
        let validity = [self.part.valid_for.filter(|_| !is_set), expires];
        let validity = validity.into_iter().flatten().min();
        let left = validity.map(|valid_for| valid_for.saturating_sub(at.elapsed()));
        if left.is_some_and(|left| left.is_zero()) {
            return unknown();
        }
        let facts = facts_of(&known.facts(&term, place, value));
        facts.into_iter().map(|fact| OwnFact { known_for: left, ..fact }).collect()
    }

    /// Returns the levels that things remember while they are off, as PDDL facts. A level that was
    /// never reported counts as 0, so that no plan relies on it.
    fn remembered(&self) -> Vec<OwnFact> {
        let remembered = self.leading().filter_map(|feature| {
            let known = &self.part.features[feature];
            self.part.switch_of(feature).filter(|_| known.class.remembers)?;
            let last = self.tracker.last_number(feature).unwrap_or(0.0);
            Some(format!("(= {} {last})", known.remembered_term(self.part.agent.as_str())))
        });
        remembered.flat_map(|fact| facts_of(&fact)).collect()
    }

    fn called(&self, method: &str) -> Option<usize> {
        let is_it = |feature: &usize| {
            self.part.methods(*feature).iter().any(|action| action.method == method)
        };
        self.leading().find(is_it)
    }
}

impl Device for MqttDevice {
    type Yield = DoneCommand;

    fn describe(&self) -> Description {
        let now = Instant::now();
        let offers = |feature: usize| self.tracker.unavailable_reason(feature, now).is_none();
        let model = model_of(&self.part.model(&self.ontology, offers));
        let methods = self.leading().flat_map(|feature| {
            let within = self.part.features[feature].class.done_within();
            self.part.methods(feature).into_iter().map(move |action| (action, within))
        });
        let methods = methods.map(|(action, within)| {
            let argument = |(name, value): (&str, &str)| (name.to_owned(), value.to_owned());
            let arguments = action.arguments.into_iter().map(argument).collect();
            let timeout = Millis(within + MARGIN);
            (action.action, Method { method: action.method, arguments, timeout })
        });
        Description { model, methods: methods.collect() }
    }

    fn action_names(&self) -> Vec<String> {
        let model = model_of(&self.part.model(&self.ontology, |_| true));
        model.actions.iter().map(|action| action.name.as_str().to_owned()).collect()
    }

    fn facts(&self) -> Vec<OwnFact> {
        let stands = facts_of(&self.part.place(&self.ontology));
        let known = self.leading().flat_map(|feature| self.known(feature));
        stands.into_iter().chain(known).chain(self.remembered()).collect()
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

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<DoneCommand, MethodFailure>> {
        let command = match self.called(&call.method) {
            Some(feature) => Command::of(&self.part, feature, call),
            None => Err(MethodFailure::UnknownMethod(call.method.clone())),
        };
        let command = command.and_then(|command| {
            let reason = self.tracker.unavailable_reason(command.feature, Instant::now());
            reason.map_or(Ok(command), |problem| Err(MethodFailure::Driver(problem)))
        });
        let (part, hearing) = (Arc::clone(&self.part), self.tracker.clone());
        Box::pin(
            async move { command?.carry_out(&part, hearing).await.map_err(MethodFailure::Driver) },
        )
    }

    fn on_success(&mut self, _call: &MethodCall, done: DoneCommand) -> MethodResult {
        let Some(known) = self.part.features.get(done.feature) else {
            return MethodResult::default();
        };
        // A device that does not report its state is assumed to be in the last commanded state.
        for (feature, value) in &done.commanded {
            if self.part.features.get(*feature).is_some_and(|known| known.feature.states.is_empty())
            {
                self.tracker.assume_value(*feature, *value);
            }
        }
        let detail = format!("{} at {}", known.words(done.value), self.part.room);
        let observations = match known.class.kind() {
            Some(kind) if kind.is_thing() => self.known(done.feature),
            _ => {
                let place = (self.part.agent.as_str(), self.part.room.as_str());
                let term = known.term(place.0, place.1, &self.ontology);
                facts_of(&known.facts(&term, place, done.value))
            }
        };
        MethodResult {
            detail,
            observations: observations.into_iter().map(|fact| fact.fact).collect(),
        }
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        stand_still(&self.part, &self.tracker)
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

impl DevicePart {
    /// Returns the state of a feature, and the index of the feature that determines it. The level
    /// of a thing that is off is 0. A blind without a state of its own is open unless its position
    /// is 0.
    pub(crate) fn status(
        &self,
        tracker: &FeatureTracker,
        feature: usize,
        now: Instant,
    ) -> (FeatureStatus, usize) {
        let own = tracker.status_with_source(feature, now);
        let Some(known) = self.features.get(feature) else { return own };
        if let Some(switch) = self.switch_of(feature)
            && known.class.remembers
        {
            return match tracker.status(switch, now) {
                FeatureStatus::Is(ObservedValue::Yes(false), at) => {
                    (FeatureStatus::Is(ObservedValue::Number(0.0), at), switch)
                }
                FeatureStatus::Is(..) => own,
                other => (other, switch),
            };
        }
        let level = self.level_of(feature).filter(|level| {
            let known = &self.features[*level];
            !known.class.remembers && !known.feature.states.is_empty()
        });
        match level {
            Some(level) if known.feature.states.is_empty() => match tracker.status(level, now) {
                FeatureStatus::Is(ObservedValue::Number(number), at) => {
                    (FeatureStatus::Is(ObservedValue::Yes(number > 0.0), at), level)
                }
                other => (other, level),
            },
            _ => own,
        }
    }
}
