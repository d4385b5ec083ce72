//! The agent of one part of a device. Its values are facts as soon as they are received. While a feature is
//! away, the agent does not offer the actions of this feature. Commands switch the device.
//!
//! `heard` keeps the last values, feature by feature.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::Deadline;
use acl::content::Method;
use actuator::{
    BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Stir, facts_of, model_of,
};
use mqtt_link::Connection;
use pddl::Domain;
use tokio::time::Instant;

use crate::class::{Kind, is_possible};
use crate::heard::{Hearing, Standing};
use crate::part::{Known, Part, leads};
use crate::reading::Found;

/// Time limit of a method.
const METHOD: Duration = Duration::from_secs(5);

/// Time limit for the device's answer to a request or a command.
const WORD: Duration = Duration::from_secs(4);
const _: () = assert!(WORD.as_millis() < METHOD.as_millis());

/// Time limit at the start for the values that the broker has retained.
const FIRST: Duration = Duration::from_millis(200);

/// The device behind one agent.
pub(crate) struct MqttDevice {
    part: Part,
    ontology: Arc<Domain>,
    hearing: Hearing,
}

/// The result of an action: the value of a feature.
pub(crate) struct Measured {
    feature: usize,
    value: Value,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Value {
    Number(f64),
    Yes(bool),
}

/// The content of one text about a feature.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Word {
    Is(Value),
    /// The device does not know, or reports an impossible value. With the reason.
    NotKnown(String),
}

impl MqttDevice {
    pub(crate) fn new(
        part: Part,
        ontology: Arc<Domain>,
        connection: &Arc<Connection>,
    ) -> MqttDevice {
        let hearing = Hearing::of(&part.features, connection);
        MqttDevice { part, ontology, hearing }
    }

    /// The features that represent their class: of each class the first.
    fn leading(&self) -> impl Iterator<Item = usize> {
        (0..self.part.features.len()).filter(|feature| leads(&self.part.features, *feature))
    }

    fn known(&self, feature: usize) -> Vec<OwnFact> {
        let Some(known) = self.part.features.get(feature) else { return Vec::new() };
        let (agent, room) = (self.part.agent.as_str(), self.part.room.as_str());
        let term = known.term(agent, room, &self.ontology);
        let unknown = || facts_of(&known.unknown(&term, room));
        let (standing, speaker) = self.hearing.standing_by(feature, Instant::now());
        let (value, at) = match standing {
            Standing::Is(value, at) => (value, at),
            Standing::NotKnown(_) | Standing::Away(_) => return unknown(),
        };
        let is_switch = matches!(known.class.kind(), Some(Kind::Switch { .. }));
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
        let is_it = |known: &Known| known.methods().iter().any(|(_, called)| called == method);
        self.part.features.iter().position(is_it)
    }
}

impl Known {
    /// Returns the content of `text`, read by the source with this number; `None` if it has no value of the
    /// feature.
    pub(crate) fn read(&self, source: usize, text: &str) -> Option<Word> {
        let source = self.feature.states.get(source)?;
        let is_number = matches!(self.class.kind()?, Kind::Number { .. });
        let said = match source.read(text) {
            Found::Text(said) => said,
            Found::Unknown if self.is_word(text) => text.trim().to_owned(),
            Found::Unknown => {
                return Some(Word::NotKnown("it reports that the value is unknown".to_owned()));
            }
            Found::Nothing => return None,
            // Home Assistant then takes the text as it is, if it is one of the expected ones.
            Found::Unread(_) if !is_number && self.is_word(text) => text.trim().to_owned(),
            Found::Unread(problem) => {
                tracing::debug!(topic = source.topic, "{problem}");
                return None;
            }
        };
        if is_number { self.number(&said) } else { self.yes_or_no(&said) }
    }

    /// Whether a whole text is one of the feature's texts for yes and no.
    fn is_word(&self, text: &str) -> bool {
        let (text, feature) = (text.trim(), &self.feature);
        [&feature.yes, &feature.no].into_iter().flatten().any(|word| word == text)
    }

    fn number(&self, said: &str) -> Option<Word> {
        let told: String = said.chars().take(40).collect();
        let Ok(number) = said.parse::<f64>() else {
            return Some(Word::NotKnown(format!("it reports `{told}`, which is no number")));
        };
        let Some(Kind::Number { unit, .. }) = self.class.kind() else { return None };
        let value = number * self.factor + self.offset;
        if !is_possible(value, unit) {
            let problem = format!("it reports {told}, which is impossible in {unit}");
            return Some(Word::NotKnown(problem));
        }
        // Rounded, so that 68 °F are exactly 20 °C.
        Some(Word::Is(Value::Number((value * 1e6).round() / 1e6)))
    }

    fn yes_or_no(&self, said: &str) -> Option<Word> {
        let is = |words: &[String]| words.iter().any(|word| word == said);
        if is(&self.feature.yes) {
            return Some(Word::Is(Value::Yes(true)));
        }
        if is(&self.feature.no) {
            return Some(Word::Is(Value::Yes(false)));
        }
        is(&self.feature.neither).then(|| Word::NotKnown(format!("it reports `{said}`")))
    }

    /// Returns a value as PDDL facts; `term` is the feature's term in PDDL.
    fn facts(&self, term: &str, room: &str, value: Value) -> String {
        match (self.class.kind(), value) {
            (Some(Kind::Number { known, .. }), Value::Number(number)) => {
                format!("({known} {room}) (= {term} {number})")
            }
            (Some(Kind::YesOrNo { known, .. }), Value::Yes(true)) => {
                format!("({known} {room}) {term}")
            }
            (Some(Kind::YesOrNo { known, .. }), _) => format!("({known} {room}) (not {term})"),
            (Some(Kind::Switch { .. }), Value::Yes(true)) => term.to_owned(),
            (Some(Kind::Switch { .. }), _) => format!("(not {term})"),
            _ => String::new(),
        }
    }

    /// Returns the PDDL facts for an unknown value.
    fn unknown(&self, term: &str, room: &str) -> String {
        match self.class.kind() {
            Some(Kind::Number { known, .. }) => format!("(not ({known} {room}))"),
            Some(Kind::YesOrNo { known, .. }) => {
                format!("(not ({known} {room})) (unknown {term})")
            }
            Some(Kind::Switch { .. }) => format!("(unknown {term})"),
            None => String::new(),
        }
    }

    fn words(&self, value: Value) -> String {
        match (self.class.kind(), value) {
            (Some(Kind::Number { unit, .. }), Value::Number(number)) => format!("{number} {unit}"),
            (Some(Kind::YesOrNo { yes, .. }), Value::Yes(true)) => yes.to_owned(),
            (Some(Kind::YesOrNo { yes, .. }), Value::Yes(false)) => format!("not {yes}"),
            // The state of the device, not of the room: other devices there may be in another state.
            (Some(Kind::Switch { .. }), Value::Yes(true)) => "on".to_owned(),
            (Some(Kind::Switch { .. }), Value::Yes(false)) => "off".to_owned(),
            _ => String::new(),
        }
    }
}

impl Device for MqttDevice {
    type Yield = Measured;

    fn describe(&self) -> Description {
        let now = Instant::now();
        let offers = |feature: usize| self.hearing.away(feature, now).is_none();
        let model = model_of(&self.part.model(&self.ontology, offers));
        let methods = self.leading().flat_map(|feature| self.part.features[feature].methods());
        let methods = methods.map(|(action, method)| {
            (action, Method { method, arguments: BTreeMap::new(), timeout: Deadline(METHOD) })
        });
        Description { model, methods: methods.collect() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let stands = facts_of(&self.part.place(&self.ontology));
        stands.into_iter().chain(self.leading().flat_map(|feature| self.known(feature))).collect()
    }

    fn look(&self) -> Option<BoxFuture<()>> {
        let mut hearing = self.hearing.clone();
        Some(Box::pin(async move {
            // After this time, the values received so far have to do.
            let _ = tokio::time::timeout(FIRST, async {
                while !hearing.is_told() {
                    hearing.changed().await;
                }
            })
            .await;
        }))
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<Measured, Failure>> {
        let Some(feature) = self.called(&call.method) else {
            let unknown = Failure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        if let Some(problem) = self.hearing.away(feature, Instant::now()) {
            return Box::pin(std::future::ready(Err(Failure::Driver(problem))));
        }
        let known = self.part.features[feature].clone();
        let hearing = self.hearing.clone();
        let wanted = match call.method.as_str() {
            "on" => Some(true),
            "off" => Some(false),
            _ => None,
        };
        Box::pin(async move {
            match (wanted, &known.feature.command) {
                (Some(is_on), Some(command)) => {
                    let telegram = if is_on { &command.on } else { &command.off };
                    hearing.say(telegram).map_err(Failure::Driver)?;
                }
                // If the value is not known, ask for it.
                _ => hearing.ask(feature),
            }
            let value = said(&known, hearing, feature, wanted).await.map_err(Failure::Driver)?;
            Ok(Measured { feature, value })
        })
    }

    fn performed(&mut self, _call: &Call, measured: Measured) -> Performed {
        let Some(known) = self.part.features.get(measured.feature) else {
            return Performed::default();
        };
        // A device that does not report its state is assumed to be as it was last commanded.
        if known.feature.states.is_empty() {
            self.hearing.believe(measured.feature, measured.value);
        }
        let room = &self.part.room;
        let detail = format!("{} at {room}", known.words(measured.value));
        let term = known.term(self.part.agent.as_str(), room, &self.ontology);
        let observations = facts_of(&known.facts(&term, room, measured.value));
        Performed { detail, observations: observations.into_iter().map(|fact| fact.fact).collect() }
    }

    fn watch(&mut self) -> Option<BoxFuture<Stir<MqttDevice>>> {
        let mut hearing = self.hearing.clone();
        Some(Box::pin(async move {
            hearing.news().await;
            // A text that arrives from here on is news, also while the current one is being reported.
            let stir: Stir<MqttDevice> = Box::new(move |device| {
                device.hearing = hearing;
                Vec::new()
            });
            stir
        }))
    }
}

/// Waits for a value of a feature; if `wanted` is given, for this value.
async fn said(
    known: &Known,
    mut hearing: Hearing,
    feature: usize,
    wanted: Option<bool>,
) -> Result<Value, String> {
    let Some(source) = known.feature.states.first() else {
        // A device that does not report its state is assumed to be as it was last commanded.
        let problem = || "learn its state: it reports none".to_owned();
        return wanted.map(Value::Yes).ok_or_else(problem);
    };
    let topic = &source.topic;
    let until = Instant::now() + WORD;
    loop {
        let standing = hearing.standing(feature, Instant::now());
        match &standing {
            Standing::Is(value, _) if wanted.is_none_or(|is_on| *value == Value::Yes(is_on)) => {
                return Ok(*value);
            }
            Standing::Away(problem) => return Err(problem.clone()),
            _ => (),
        }
        if tokio::time::timeout_at(until, hearing.changed()).await.is_ok() {
            continue;
        }
        return Err(match (wanted, standing) {
            (Some(_), _) => format!("receive a report on `{topic}` that it is done"),
            (None, Standing::NotKnown(Some(reason))) => {
                format!("find the {} in the message on `{topic}`: {reason}", known.name)
            }
            (None, _) => format!("receive a value on `{topic}`: nothing was received yet"),
        });
    }
}
