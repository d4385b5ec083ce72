//! The last values of a device, for each feature: whether the feature is available, its value, and
//! the time at which the value was received.
//!
//! - A feature has a known value, has an unknown value, or is unavailable. These are three
//!   different states.
//! - Texts are processed in the order of their arrival. A text without a value of a feature does
//!   not change the feature.
//! - While there was no connection, a switch may have been switched by hand. Therefore its earlier
//!   value is unknown after each connect. If the device supports requests for the value, a few
//!   requests are sent.

use std::future::poll_fn;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::time::Duration;

use mqtt_link::{BrokerConnection, TopicState};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::description::{Availability, AvailabilityMode, OutgoingMessage};
use crate::part::{self, ClassifiedFeature};

/// Pause after a connect before the first request for missing values. A random time up to
/// [`ASK_SPREAD_MS`] is added, so that hundreds of devices are not queried at once.
const ASK_AFTER: Duration = Duration::from_millis(300);
const ASK_SPREAD_MS: u64 = 2_000;

/// Pauses between repeated requests for a missing value. After the last one, no request is sent
/// until the next connect.
const ASK_AGAIN: [Duration; 4] = [
    Duration::from_secs(5),
    Duration::from_secs(30),
    Duration::from_secs(180),
    Duration::from_secs(900),
];

/// The value of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ObservedValue {
    Number(f64),
    Yes(bool),
    /// The option with this index, or the press.
    Option(usize),
}

/// The content of one text about a feature.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TextContent {
    Is(ObservedValue),
    /// The device reports that the value is unknown, or reports an impossible value; with the
    /// reason.
    NotKnown(String),
}

/// The state of a feature: known, unknown or unavailable.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum FeatureStatus {
    /// The value is known: this value, received at this time.
    Is(ObservedValue, Instant),
    /// The value is unknown: no value was received (`None`), or no valid value, for this reason.
    NotKnown(Option<String>),
    /// The feature is unavailable, for this reason.
    Away(String),
}

/// Receives and keeps the values of a device's features. Clones share the values, but each clone
/// waits for new texts independently.
#[derive(Clone)]
pub(crate) struct FeatureTracker {
    connection: Arc<BrokerConnection>,
    trouble: watch::Receiver<Option<String>>,
    /// Subscriptions to the topics of the features' values and of their availability.
    topics: Vec<TopicSubscription>,
    features: Arc<Vec<ClassifiedFeature>>,
    processed: Arc<Mutex<ProcessedTexts>>,
}

#[derive(Clone)]
struct TopicSubscription {
    texts: watch::Receiver<TopicState>,
    feature: usize,
    what: TopicRole,
}

#[derive(Clone, Copy, PartialEq)]
enum TopicRole {
    State(usize),
    Voice(usize),
    /// Texts of the topic are ignored. The subscription only gives the number of the connection to
    /// the broker, for a feature without state topics.
    Connection,
}

/// Content of all texts that were processed so far.
struct ProcessedTexts {
    /// Number of processed texts of each topic.
    counts: Vec<u64>,
    features: Vec<FeatureState>,
}

/// Content of the last text about one feature, and the state of the requests for its value.
#[derive(Clone)]
struct FeatureState {
    /// The number that was commanded last; `None` before the first command.
    commanded: Option<f64>,
    content: Option<(TextContent, Instant, u64)>,
    /// The last text of each topic of availability: `true` for online; `None` before the first
    /// text.
    topics_online: Vec<Option<bool>>,
    latest: Option<bool>,
    /// State of the requests for the value: the number of the connection to the broker, how many
    /// requests were sent during that connection, and the time of the next one.
    asked: (u64, usize, Instant),
}

impl FeatureState {
    fn of(availability: &Availability) -> FeatureState {
        let at_first =
            availability.topics.iter().map(|voice| voice.is_online_at_first.then_some(true));
        let voices: Vec<_> = at_first.collect();
        let latest = voices.iter().copied().flatten().next();
        FeatureState {
            commanded: None,
            content: None,
            topics_online: voices,
            latest,
            asked: (0, 0, Instant::now() + first_pause()),
        }
    }

    fn set_online(&mut self, voice: usize, is_online: bool) {
        self.topics_online[voice] = Some(is_online);
        self.latest = Some(is_online);
    }

    fn is_online(&self, mode: AvailabilityMode) -> bool {
        match mode {
            AvailabilityMode::All => self.topics_online.iter().all(|voice| *voice == Some(true)),
            AvailabilityMode::Any => self.topics_online.contains(&Some(true)),
            AvailabilityMode::Latest => self.latest == Some(true),
        }
    }
}

impl FeatureTracker {
    pub(crate) fn of(
        features: &[ClassifiedFeature],
        connection: &Arc<BrokerConnection>,
    ) -> FeatureTracker {
        let mut topics = Vec::new();
        let mut heard = Vec::new();
        for (number, ClassifiedFeature { feature, .. }) in features.iter().enumerate() {
            let mut listen = |topic: &str, what: TopicRole| {
                topics.push(TopicSubscription {
                    texts: connection.listen(topic),
                    feature: number,
                    what,
                });
            };
            for (source, state) in feature.states.iter().enumerate() {
                listen(&state.topic, TopicRole::State(source));
            }
            for (voice, said) in feature.availability.topics.iter().enumerate() {
                listen(&said.source.topic, TopicRole::Voice(voice));
            }
            if let (true, Some(topic)) = (feature.states.is_empty(), feature.command_topic()) {
                listen(topic, TopicRole::Connection);
            }
            heard.push(FeatureState::of(&feature.availability));
        }
        let taken = ProcessedTexts { counts: vec![0; topics.len()], features: heard };
        FeatureTracker {
            trouble: connection.problem(),
            connection: Arc::clone(connection),
            topics,
            features: Arc::new(features.to_vec()),
            processed: Arc::new(Mutex::new(taken)),
        }
    }

    /// Returns the state of a feature, combined with those of the other features of its class.
    pub(crate) fn status(&self, feature: usize, now: Instant) -> FeatureStatus {
        self.status_with_source(feature, now).0
    }

    /// Returns the state of a feature, combined with those of the other features of its class, and
    /// the index of the feature that determines this state.
    pub(crate) fn status_with_source(
        &self,
        feature: usize,
        now: Instant,
    ) -> (FeatureStatus, usize) {
        let all = part::together(&self.features, feature);
        let all: Vec<_> = all.map(|feature| (self.own_status(feature, now), feature)).collect();
        let is_inverted = self.features.get(feature).is_some_and(|known| known.class.inverted);
        combined_status(all, ObservedValue::Yes(!is_inverted))
            .unwrap_or((FeatureStatus::NotKnown(None), feature))
    }

    fn own_status(&self, feature: usize, now: Instant) -> FeatureStatus {
        if let Some(problem) = self.own_unavailable_reason(feature) {
            return FeatureStatus::Away(problem);
        }
        let taken = self.process_texts();
        let (Some(heard), Some(known)) = (taken.features.get(feature), self.features.get(feature))
        else {
            return FeatureStatus::NotKnown(None);
        };
        let is_set = known.class.kind().is_some_and(|kind| kind.is_set());
        match &heard.content {
            None => FeatureStatus::NotKnown(None),
            Some((TextContent::NotKnown(reason), ..)) => {
                FeatureStatus::NotKnown(Some(reason.clone()))
            }
            Some((TextContent::Is(value), at, session)) => {
                let age = now.saturating_duration_since(*at);
                if known.feature.expires.is_some_and(|expires| age >= expires) {
                    let reason = "it has reported nothing for too long".to_owned();
                    return FeatureStatus::NotKnown(Some(reason));
                }
                // A yes or no may have changed meanwhile, and the device need not repeat it.
                let may_differ = is_set || matches!(value, ObservedValue::Yes(_));
                if may_differ && *session != self.session(feature) {
                    let reason = match known.feature.states.is_empty() {
                        true => "it reports no state, and the broker was away since its command",
                        false => "it has reported nothing since the broker was away",
                    };
                    let reason = reason.to_owned();
                    return FeatureStatus::NotKnown(Some(reason));
                }
                let is_over = known.feature.off_delay.is_some_and(|delay| age >= delay);
                // The yes has expired. For an inverted class such as a contact, yes means open and
                // is stored as `Yes(false)`.
                let yes = ObservedValue::Yes(!known.class.inverted);
                match value {
                    value if is_over && *value == yes => {
                        FeatureStatus::Is(ObservedValue::Yes(known.class.inverted), *at)
                    }
                    // A motor that stops at 49 % after a command for 50 % has done it.
                    ObservedValue::Number(number) => {
                        let is_it =
                            |commanded: &f64| (commanded - number).abs() <= known.class.tolerated();
                        let number = heard.commanded.filter(is_it).unwrap_or(*number);
                        FeatureStatus::Is(ObservedValue::Number(number), *at)
                    }
                    value => FeatureStatus::Is(*value, *at),
                }
            }
        }
    }

    /// Returns the reason why all features of the class of `feature` are unavailable; `None` if at
    /// least one of them is available.
    pub(crate) fn unavailable_reason(&self, feature: usize, _now: Instant) -> Option<String> {
        let all = part::together(&self.features, feature);
        let all: Option<Vec<_>> = all.map(|feature| self.own_unavailable_reason(feature)).collect();
        all?.into_iter().next()
    }

    fn own_unavailable_reason(&self, feature: usize) -> Option<String> {
        if let Some(trouble) = &*self.trouble.borrow() {
            return Some(format!("reach the broker: {trouble}"));
        }
        let of_state = self.topics.iter().filter(|listened| {
            listened.feature == feature && matches!(listened.what, TopicRole::State(_))
        });
        let refusals: Vec<_> =
            of_state.map(|listened| listened.texts.borrow().rejection.clone()).collect();
        if !refusals.is_empty()
            && let Some(refusal) = refusals.into_iter().collect::<Option<Vec<_>>>()
        {
            let first = refusal.into_iter().next();
            return first.map(|refusal| format!("receive its messages: {refusal}"));
        }
        let taken = self.process_texts();
        let (heard, known) = (taken.features.get(feature)?, self.features.get(feature)?);
        let availability = &known.feature.availability;
        if availability.topics.is_empty() {
            return None;
        }
        if heard.is_online(availability.mode) {
            return None;
        }
        let is_said = heard.topics_online.contains(&Some(false));
        let topic = availability.topics.first().map_or("", |voice| voice.source.topic.as_str());
        Some(match is_said {
            true => "use it: it is offline".to_owned(),
            false => format!("use it: it has not reported on `{topic}` that it is online"),
        })
    }

    /// Returns the number of the latest connection with subscriptions to the topics of the
    /// feature's values.
    fn session(&self, feature: usize) -> u64 {
        let of_state = self.topics.iter().find(|listened| {
            listened.feature == feature
                && matches!(listened.what, TopicRole::State(_) | TopicRole::Connection)
        });
        of_state.map_or(0, |listened| listened.texts.borrow().session)
    }

    /// Whether every feature with a state topic has a value, and every topic of availability has a
    /// text.
    pub(crate) fn is_complete(&self) -> bool {
        let taken = self.process_texts();
        taken.features.iter().zip(self.features.iter()).all(|(heard, known)| {
            (heard.content.is_some() || known.feature.states.is_empty() || known.is_press())
                && heard.topics_online.iter().all(Option::is_some)
        })
    }

    /// Sets the value of a feature that does not report its state, after a command.
    pub(crate) fn assume_value(&self, feature: usize, value: ObservedValue) {
        let session = self.session(feature);
        if let Some(heard) = self.process_texts().features.get_mut(feature) {
            heard.content = Some((TextContent::Is(value), Instant::now(), session));
        }
    }

    /// Records the number that was commanded last.
    pub(crate) fn set_commanded(&self, feature: usize, number: f64) {
        if let Some(heard) = self.process_texts().features.get_mut(feature) {
            heard.commanded = Some(number);
        }
    }

    /// Returns the number that was received last, even if it does not count any more; `None`
    /// before the first one.
    pub(crate) fn last_number(&self, feature: usize) -> Option<f64> {
        match self.process_texts().features.get(feature)?.content {
            Some((TextContent::Is(ObservedValue::Number(number)), ..)) => Some(number),
            _ => None,
        }
    }

    /// Returns how many texts about the values of a feature have been received so far.
    pub(crate) fn text_count(&self, feature: usize) -> u64 {
        let of_feature = self.topics.iter().filter(|listened| {
            listened.feature == feature && matches!(listened.what, TopicRole::State(_))
        });
        of_feature.map(|listened| listened.texts.borrow().count).sum()
    }

    pub(crate) fn publish(&self, telegram: &OutgoingMessage) -> Result<(), String> {
        let OutgoingMessage { topic, text, is_retained: is_kept } = telegram;
        match is_kept {
            true => self.connection.publish_retained(topic, text),
            false => self.connection.publish_text(topic, text),
        }
    }

    /// Requests the values of a feature and of the other features of its class in the device, if
    /// they are unknown and can be requested.
    pub(crate) fn ask(&self, feature: usize) {
        for feature in part::together(&self.features, feature) {
            let ask =
                self.features.get(feature).and_then(|known| known.feature.value_request.as_ref());
            if let Some(ask) = ask
                && matches!(self.own_status(feature, Instant::now()), FeatureStatus::NotKnown(_))
            {
                let _ = self.publish(ask);
            }
        }
    }

    /// Processes the texts that have arrived since the last call.
    fn process_texts(&self) -> MutexGuard<'_, ProcessedTexts> {
        let mut taken = self.processed.lock().unwrap_or_else(PoisonError::into_inner);
        let mut words = Vec::new();
        for (number, listened) in self.topics.iter().enumerate() {
            let said = listened.texts.borrow();
            let new = said.count - taken.counts[number];
            taken.counts[number] = said.count;
            let new = usize::try_from(new).unwrap_or(usize::MAX);
            words.extend(said.texts.iter().take(new).map(|word| (number, word.clone())));
        }
        words.sort_by_key(|(_, word)| word.at);
        for (number, word) in words {
            let TopicSubscription { feature, what, .. } = &self.topics[number];
            let known = &self.features[*feature];
            let heard = &mut taken.features[*feature];
            match what {
                // A retained press happened at an unknown time.
                TopicRole::State(_) if word.is_retained && known.is_press() => (),
                TopicRole::State(source) => {
                    if let Some(said) = known.read(*source, &word.text) {
                        heard.content = Some((said, word.at, word.session));
                    }
                }
                TopicRole::Connection => (),
                TopicRole::Voice(number) => {
                    let voice = &known.feature.availability.topics[*number];
                    // Like Home Assistant, uses the text itself if its template fails.
                    let said = voice.source.word(&word.text);
                    let said = said.unwrap_or_else(|| word.text.trim().to_owned());
                    let is_online = match said {
                        said if said == voice.online => true,
                        said if said == voice.offline => false,
                        _ => continue,
                    };
                    heard.set_online(*number, is_online);
                }
            }
        }
        taken
    }

    /// Waits until a text arrives or the connection changes.
    pub(crate) async fn wait_for_text(&mut self) {
        let topics = self.topics.iter_mut().map(|listened| &mut listened.texts);
        let mut changes: Vec<Pin<Box<dyn Future<Output = ()> + Send>>> = Vec::new();
        for heard in topics {
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

    /// Waits until a text arrives, the connection changes or a value expires. Requests missing
    /// values while waiting.
    pub(crate) async fn wait_for_news(&mut self) {
        loop {
            let now = Instant::now();
            let (over, ask) = (self.next_over(now), self.next_ask());
            let Some(next) = over.into_iter().chain(ask).min() else {
                return self.wait_for_text().await;
            };
            if tokio::time::timeout_at(next, self.wait_for_text()).await.is_ok() {
                return;
            }
            if over.is_some_and(|over| over <= Instant::now()) {
                return;
            }
            self.ask_all();
        }
    }

    /// Returns the next time at which a value expires; `None` if none expires.
    fn next_over(&self, now: Instant) -> Option<Instant> {
        let taken = self.process_texts();
        let over = taken.features.iter().zip(self.features.iter()).flat_map(|(heard, known)| {
            let at = heard.content.as_ref().map(|(_, at, _)| *at);
            let ends = [known.feature.expires, known.feature.off_delay];
            ends.into_iter().flatten().filter_map(move |after| at?.checked_add(after))
        });
        over.filter(|over| *over > now).min()
    }

    /// Returns the time of the next request for a missing value; `None` if no request is planned.
    fn next_ask(&self) -> Option<Instant> {
        let wanting = (0..self.features.len()).filter(|feature| self.wants_asking(*feature));
        wanting.map(|feature| self.asks(feature).2).min()
    }

    fn wants_asking(&self, feature: usize) -> bool {
        let known = &self.features[feature];
        known.feature.value_request.is_some()
            && self.asks(feature).1 <= ASK_AGAIN.len()
            && matches!(self.own_status(feature, Instant::now()), FeatureStatus::NotKnown(_))
    }

    /// Returns the state of the requests for the value of the feature with the index `feature`: the
    /// number of the latest connection to the broker, how many requests were sent during that
    /// connection, and the time of the next one.
    fn asks(&self, feature: usize) -> (u64, usize, Instant) {
        let session = self.session(feature);
        let mut taken = self.process_texts();
        let asked = &mut taken.features[feature].asked;
        if asked.0 != session {
            *asked = (session, 0, Instant::now() + first_pause());
        }
        *asked
    }

    /// Sends all requests that are due. A request that several features share is sent once.
    fn ask_all(&self) {
        let now = Instant::now();
        let mut questions = Vec::new();
        for feature in 0..self.features.len() {
            let (_, count, next) = self.asks(feature);
            if next > now || !self.wants_asking(feature) {
                continue;
            }
            let pause = ASK_AGAIN.get(count).copied().unwrap_or_default();
            let mut taken = self.process_texts();
            let asked = &mut taken.features[feature].asked;
            (asked.1, asked.2) = (count + 1, now + pause);
            questions.extend(self.features[feature].feature.value_request.clone());
        }
        questions.sort();
        questions.dedup();
        for question in questions {
            if let Err(problem) = self.publish(&question) {
                tracing::debug!(topic = question.topic, "failed to ask: {problem}");
            }
        }
    }
}

/// Combines the states of all features of one class in one device. Returns the combined state, and
/// the index of the feature that determines it; `None` if `all` is empty. The value `loud` (motion,
/// or open) applies if one feature has it; the opposite value applies only if all features have it.
fn combined_status(
    all: Vec<(FeatureStatus, usize)>,
    loud: ObservedValue,
) -> Option<(FeatureStatus, usize)> {
    let since = |standing: &FeatureStatus| match standing {
        FeatureStatus::Is(value, at) => Some((*value, *at)),
        _ => None,
    };
    let is_loud = |(standing, _): &&(FeatureStatus, usize)| matches!(standing, FeatureStatus::Is(value, _) if *value == loud);
    if let Some(loudest) =
        all.iter().filter(is_loud).max_by_key(|(one, _)| since(one).map(|(_, at)| at))
    {
        return Some(loudest.clone());
    }
    let unknown = all.iter().find(|(one, _)| matches!(one, FeatureStatus::NotKnown(_)));
    if let Some(unknown) = unknown {
        return Some(unknown.clone());
    }
    let away = |(one, _): &&(FeatureStatus, usize)| matches!(one, FeatureStatus::Away(_));
    match all.iter().find(away) {
        Some(gone) if all.iter().all(|one| away(&one)) => Some(gone.clone()),
        Some((_, feature)) => {
            let reason = "another of its kind in the same device is unavailable".to_owned();
            Some((FeatureStatus::NotKnown(Some(reason)), *feature))
        }
        // The oldest value is used, because the result is valid only for as long as this value is.
        None => all.into_iter().min_by_key(|(one, _)| since(one).map(|(_, at)| at)),
    }
}

fn first_pause() -> Duration {
    ASK_AFTER + Duration::from_millis(fastrand::u64(..ASK_SPREAD_MS))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::{AvailabilityTopic, ValueSource};

    #[test]
    fn the_states_of_several_contacts_of_one_device_are_combined() {
        let now = Instant::now();
        let (open, shut) = (
            FeatureStatus::Is(ObservedValue::Yes(false), now),
            FeatureStatus::Is(ObservedValue::Yes(true), now),
        );
        let (unknown, away) =
            (FeatureStatus::NotKnown(None), FeatureStatus::Away("gone".to_owned()));
        let loud = ObservedValue::Yes(false);
        for (all, expected) in [
            (vec![&shut], Some((shut.clone(), 0))),
            (vec![&shut, &shut], Some((shut.clone(), 0))),
            (vec![&shut, &open], Some((open.clone(), 1))),
            (vec![&open, &unknown], Some((open.clone(), 0))),
            (vec![&away, &open], Some((open.clone(), 1))),
            (vec![&shut, &unknown], Some((unknown.clone(), 1))),
            (vec![&away, &away], Some((away.clone(), 0))),
            (vec![], None),
        ] {
            let numbered = all.iter().enumerate().map(|(number, one)| ((*one).clone(), number));
            assert_eq!(combined_status(numbered.collect(), loud), expected, "{all:?}");
        }
        let one_is_away = combined_status(vec![(shut, 0), (away, 1)], loud);
        assert!(
            matches!(one_is_away, Some((FeatureStatus::NotKnown(Some(_)), 1))),
            "{one_is_away:?}"
        );
    }

    #[test]
    fn topics_of_availability_are_combined_by_their_mode() {
        let voice = |at_first| AvailabilityTopic {
            source: ValueSource::whole("x"),
            online: "online".to_owned(),
            offline: "offline".to_owned(),
            is_online_at_first: at_first,
        };
        // For texts of two topics: whether the feature is online by the modes `All`, `Any` and
        // `Latest`.
        for (at_first, said, expected) in [
            (false, &[][..], [false, false, false]),
            (true, &[], [true, true, true]),
            (false, &[(0, true)], [false, true, true]),
            (false, &[(0, true), (1, true)], [true, true, true]),
            (false, &[(0, true), (1, false)], [false, true, false]),
            (false, &[(1, false), (0, true)], [false, true, true]),
            (false, &[(0, false), (1, false)], [false, false, false]),
            (true, &[(1, false)], [false, true, false]),
        ] {
            let voices = vec![voice(at_first), voice(at_first)];
            let mut heard =
                FeatureState::of(&Availability { topics: voices, mode: AvailabilityMode::All });
            for (number, is_online) in said {
                heard.set_online(*number, *is_online);
            }
            let modes = [AvailabilityMode::All, AvailabilityMode::Any, AvailabilityMode::Latest];
            assert_eq!(modes.map(|mode| heard.is_online(mode)), expected, "{said:?}");
        }
    }
}
