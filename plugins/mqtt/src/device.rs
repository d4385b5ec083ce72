//! One agent of a device: what it says is known at once, its availability is its presence, what it is
//! told it does.

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use acl::Deadline;
use acl::content::Method;
use actuator::{
    BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Stir, facts_of, model_of,
};
use mqtt_link::{Connection, Said};
use pddl::Domain;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::class::Kind;
use crate::described::Availability;
use crate::part::{Known, Part};

/// How long a method may take.
const METHOD: Duration = Duration::from_secs(5);

/// How long is waited for what a device says, when it is asked or told.
const WORD: Duration = Duration::from_secs(4);
const _: () = assert!(WORD.as_millis() < METHOD.as_millis());

/// How long is waited at first for what the broker has kept of it.
const FIRST: Duration = Duration::from_millis(200);

/// The device.
pub(crate) struct MqttDevice {
    part: Part,
    ontology: Arc<Domain>,
    link: Link,
}

/// What it hears.
#[derive(Clone)]
struct Link {
    connection: Arc<Connection>,
    trouble: watch::Receiver<Option<String>>,
    /// One for each feature that says how it is.
    states: Vec<Option<watch::Receiver<Said>>>,
    availability: Vec<(Availability, watch::Receiver<Said>)>,
    any_is_enough: bool,
}

/// What a feature was found to be.
pub(crate) struct Measured {
    feature: usize,
    value: Value,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Value {
    Number(f64),
    Yes(bool),
}

impl MqttDevice {
    pub(crate) fn new(
        part: Part,
        ontology: Arc<Domain>,
        connection: &Arc<Connection>,
    ) -> MqttDevice {
        let state = |known: &Known| {
            known.feature.state.as_ref().map(|source| connection.listen(&source.topic))
        };
        let heard = |one: &Availability| (one.clone(), connection.listen(&one.source.topic));
        let link = Link {
            trouble: connection.trouble(),
            states: part.features.iter().map(state).collect(),
            availability: part.availability.iter().map(heard).collect(),
            any_is_enough: part.any_is_enough,
            connection: Arc::clone(connection),
        };
        MqttDevice { part, ontology, link }
    }

    /// What a feature says now, and since when.
    fn value(&self, feature: usize) -> Option<(Value, Instant)> {
        let known = self.part.features.get(feature)?;
        let said = self.link.states.get(feature)?.as_ref()?.borrow();
        said.words.iter().find_map(|word| Some((known.read(&word.text)?, word.at)))
    }

    fn known(&self, feature: usize) -> Vec<OwnFact> {
        let (Some(known), Some((value, at))) =
            (self.part.features.get(feature), self.value(feature))
        else {
            return Vec::new();
        };
        let left = self.part.valid_for.map(|valid_for| valid_for.saturating_sub(at.elapsed()));
        if left.is_some_and(|left| left.is_zero()) {
            return Vec::new();
        }
        let facts = facts_of(&known.facts(&self.part.room, value));
        let measures = !matches!(known.class.kind(), Some(Kind::Switch { .. }));
        let known_for = left.filter(|_| measures);
        facts.into_iter().map(|fact| OwnFact { known_for, ..fact }).collect()
    }

    fn called(&self, method: &str) -> Option<usize> {
        let is_it = |known: &Known| known.methods().iter().any(|(_, called)| called == method);
        self.part.features.iter().position(is_it)
    }
}

impl Known {
    /// What a text says of it; `None` if it says nothing.
    fn read(&self, text: &str) -> Option<Value> {
        let source = self.feature.state.as_ref()?;
        let said = match source.read(text) {
            Ok(said) => said?,
            Err(problem) => {
                tracing::warn!(topic = source.topic, "{problem}");
                return None;
            }
        };
        match self.class.kind()? {
            Kind::Number { .. } => {
                let number: f64 = said.parse().ok()?;
                let value = number * self.factor + self.offset;
                // So that 68 °F are 20 °C, and not almost.
                let value = (value * 1e6).round() / 1e6;
                value.is_finite().then_some(Value::Number(value))
            }
            Kind::YesOrNo { .. } | Kind::Switch { .. } if said == self.feature.yes => {
                Some(Value::Yes(true))
            }
            Kind::YesOrNo { .. } | Kind::Switch { .. } => {
                (said == self.feature.no).then_some(Value::Yes(false))
            }
        }
    }

    fn facts(&self, room: &str, value: Value) -> String {
        match (self.class.kind(), value) {
            (Some(Kind::Number { known, value: function, .. }), Value::Number(number)) => {
                format!("({known} {room}) (= ({function} {room}) {number})")
            }
            (Some(Kind::YesOrNo { known, yes, .. }), Value::Yes(true)) => {
                format!("({known} {room}) ({yes} {room})")
            }
            (Some(Kind::YesOrNo { known, .. }), _) => format!("({known} {room})"),
            (Some(Kind::Switch { state, .. }), Value::Yes(true)) => format!("({state} {room})"),
            _ => String::new(),
        }
    }

    fn words(&self, value: Value) -> String {
        match (self.class.kind(), value) {
            (Some(Kind::Number { unit, .. }), Value::Number(number)) => format!("{number} {unit}"),
            (
                Some(Kind::YesOrNo { yes, .. } | Kind::Switch { state: yes, .. }),
                Value::Yes(is_so),
            ) => {
                if is_so {
                    yes.to_owned()
                } else {
                    format!("not {yes}")
                }
            }
            _ => String::new(),
        }
    }
}

impl Link {
    /// Why it cannot be used now, if it cannot.
    fn problem(&self) -> Option<String> {
        if let Some(trouble) = &*self.trouble.borrow() {
            return Some(format!("reach the broker: {trouble}"));
        }
        let is_offline = |(one, heard): &(Availability, watch::Receiver<Said>)| {
            let said = heard.borrow();
            let said =
                said.words.front().and_then(|word| one.source.read(&word.text).ok().flatten());
            said.is_some_and(|said| said.eq_ignore_ascii_case(&one.offline))
        };
        let offline = self.availability.iter().filter(|one| is_offline(one)).count();
        let is_away = match self.any_is_enough {
            true => offline > 0 && offline == self.availability.len(),
            false => offline > 0,
        };
        is_away.then(|| "go on: it is offline".to_owned())
    }

    /// Waits until anything is said.
    async fn changed(&mut self) {
        let states = self.states.iter_mut().flatten();
        let all = states.chain(self.availability.iter_mut().map(|(_, heard)| heard));
        let mut changes: Vec<Pin<Box<dyn Future<Output = ()> + Send>>> = Vec::new();
        for heard in all {
            changes.push(Box::pin(async move {
                while heard.changed().await.is_err() {
                    std::future::pending::<()>().await
                }
            }));
        }
        let trouble = &mut self.trouble;
        changes.push(Box::pin(async move {
            while trouble.changed().await.is_err() {
                std::future::pending::<()>().await
            }
        }));
        poll_fn(move |cx| {
            let is_ready = changes.iter_mut().any(|change| change.as_mut().poll(cx).is_ready());
            if is_ready { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
    }
}

impl Device for MqttDevice {
    type Yield = Measured;

    fn describe(&self) -> Description {
        let offers = self.link.problem().is_none();
        let model = model_of(&self.part.model(&self.ontology, offers));
        let methods = self.part.features.iter().flat_map(Known::methods);
        let methods = methods.map(|(action, method)| {
            (action, Method { method, arguments: BTreeMap::new(), timeout: Deadline(METHOD) })
        });
        Description { model, methods: methods.collect() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let is_switch = self
            .part
            .features
            .iter()
            .any(|known| matches!(known.class.kind(), Some(Kind::Switch { .. })));
        let stands = if is_switch { "installed" } else { "located" };
        let stands = facts_of(&format!("({stands} {} {})", self.part.agent, self.part.room));
        // Of what is away nobody knows how it is.
        let is_here = self.link.problem().is_none();
        let known = (0..self.part.features.len()).filter(|_| is_here);
        stands.into_iter().chain(known.flat_map(|feature| self.known(feature))).collect()
    }

    fn look(&self) -> Option<BoxFuture<()>> {
        let mut link = self.link.clone();
        Some(Box::pin(async move {
            let is_told =
                |link: &Link| link.states.iter().flatten().all(|heard| heard.borrow().count > 0);
            // What has come by then is what there is.
            let _ = tokio::time::timeout(FIRST, async {
                while !is_told(&link) {
                    link.changed().await;
                }
            })
            .await;
        }))
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<Measured, Failure>> {
        if let Some(problem) = self.link.problem() {
            return Box::pin(std::future::ready(Err(Failure::Driver(problem))));
        }
        let Some(feature) = self.called(&call.method) else {
            let unknown = Failure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        let known = self.part.features[feature].clone();
        let (link, heard) = (self.link.clone(), self.link.states[feature].clone());
        let wanted = match call.method.as_str() {
            "on" => Some(true),
            "off" => Some(false),
            _ => None,
        };
        Box::pin(async move {
            if let (Some(is_on), Some(command)) = (wanted, &known.feature.command) {
                let text = if is_on { &command.on } else { &command.off };
                if !link.connection.say(&command.topic, text) {
                    return Err(Failure::Driver(format!("say `{text}` to `{}`", command.topic)));
                }
            }
            let value = said(&known, heard, wanted).await.map_err(Failure::Driver)?;
            Ok(Measured { feature, value })
        })
    }

    fn performed(&mut self, _call: &Call, measured: Measured) -> Performed {
        let Some(known) = self.part.features.get(measured.feature) else {
            return Performed::default();
        };
        let room = &self.part.room;
        let detail = format!("{} at {room}", known.words(measured.value));
        let observations = facts_of(&known.facts(room, measured.value));
        Performed { detail, observations: observations.into_iter().map(|fact| fact.fact).collect() }
    }

    fn watch(&mut self) -> Option<BoxFuture<Stir<MqttDevice>>> {
        let mut link = self.link.clone();
        Some(Box::pin(async move {
            link.changed().await;
            // What is said from here on is news, also while this is being told.
            let stir: Stir<MqttDevice> = Box::new(move |device| {
                device.link = link;
                Vec::new()
            });
            stir
        }))
    }
}

/// What a feature says, once it says something, or what is wanted of it.
async fn said(
    known: &Known,
    heard: Option<watch::Receiver<Said>>,
    wanted: Option<bool>,
) -> Result<Value, String> {
    let Some(mut heard) = heard else {
        // What says nothing is believed to be as it was told.
        return wanted.map(Value::Yes).ok_or_else(|| "hear from it: it says nothing".to_owned());
    };
    let topic = known.feature.state.as_ref().map(|source| source.topic.clone()).unwrap_or_default();
    let found = |said: &Said| {
        let value = said.words.iter().find_map(|word| known.read(&word.text))?;
        (wanted.is_none() || Some(value) == wanted.map(Value::Yes)).then_some(value)
    };
    let waiting = heard.wait_for(|said| found(said).is_some());
    let waited = tokio::time::timeout(WORD, waiting).await;
    match waited.map(|said| said.map(|said| found(&said))) {
        Ok(Ok(value)) => value.ok_or_else(|| format!("hear from `{topic}`")),
        Ok(Err(_)) => Err("hear from it: the connection has ended".to_owned()),
        Err(_) => {
            let last = heard.borrow().words.front().map(|word| word.text.clone());
            Err(match (wanted, last) {
                (Some(_), _) => format!("hear from `{topic}` that it has done so"),
                (None, Some(last)) => {
                    let last: String = last.chars().take(60).collect();
                    format!("find the {} in what `{topic}` says: {last}", known.name)
                }
                (None, None) => format!("hear from `{topic}`: it has said nothing yet"),
            })
        }
    }
}
