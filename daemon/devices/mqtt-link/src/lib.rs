//! Connections to MQTT brokers: one for each broker in a process, shared by all agents that need
//! it.
//!
//! - After each reconnection the topics are subscribed again, because brokers drop subscriptions
//!   and `rumqttc` does not renew them by itself. Subscriptions are sent in small batches, without
//!   filters that brokers reject ([`filter_problem`]).
//! - The latest texts of each topic are kept for agents that start to listen later. An [`Inbox`]
//!   (`inbox`) queues the texts of many topics.
//! - [`Broker`] (`broker`) holds the address of a broker, its TLS settings, the user and the file
//!   with the password. Websockets are not supported.

mod broker;
mod inbox;
mod topic_filter;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::time::Duration;

use rumqttc::{
    AsyncClient, ConnectionError, Event, EventLoop, MqttOptions, Outgoing, Packet, Publish, QoS,
    Request, StateError, SubAck, SubscribeFilter, SubscribeReasonCode,
};
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::task::AbortOnDropHandle;

pub use broker::Broker;
pub use inbox::Inbox;
pub use topic_filter::{filter_problem, matches_filter, topic_problem};

use inbox::InboxQueue;
use topic_filter::is_pattern;

/// Keep-alive interval of a new connection: the broker must answer a ping within this time.
/// Receiving a long text can take longer. Therefore each time the broker is too slow, the interval
/// is doubled, up to [`KEEP_ALIVE_MAX`].
const KEEP_ALIVE: Duration = Duration::from_secs(5);
const KEEP_ALIVE_MAX: Duration = Duration::from_secs(80);

/// Pause before connecting to the broker again; the restart of a broker takes a second. The pause
/// is doubled, up to [`RECONNECT_WAIT_MAX`], if the broker accepts the connection and closes it
/// within [`STABLE_AFTER`].
const RECONNECT_WAIT: Duration = Duration::from_millis(250);
const RECONNECT_WAIT_MAX: Duration = Duration::from_secs(8);

/// Age from which a connection counts as stable. If a stable connection is closed, the pause before
/// connecting again is not doubled.
const STABLE_AFTER: Duration = Duration::from_secs(10);

/// Maximum size of a packet, in bytes: the maximum of MQTT. A smaller limit would not protect: a
/// longer packet would end the connection and, if the broker retains the packet, each later
/// connection as well.
const PACKET_BYTES_MAX: usize = 1 << 28;

/// Maximum size of a received text, in bytes; a longer text is ignored. An example of a long text
/// is the list of thousands of devices from a bridge.
const TEXT_BYTES_MAX: usize = 1 << 26;

/// Maximum size of a text that is kept for a topic, in bytes; a longer text is ignored. Most texts
/// are shorter than a kilobyte.
const KEPT_TEXT_BYTES_MAX: usize = 1 << 20;

/// Capacity of the queue of requests to a broker. Each batch of subscriptions is one request; each
/// message is one request, too.
const REQUESTS_MAX: usize = 4_096;

/// Number of filters in one subscribe request; some brokers accept no more.
const BATCH: usize = 8;

/// Number of texts that are kept for each topic: enough for the texts that arrive before a listener
/// reads them.
const KEPT_TEXTS_MAX: usize = 64;

/// Connections of this process to brokers, by broker.
static CONNECTIONS: Mutex<BTreeMap<Broker, Weak<BrokerConnection>>> = Mutex::new(BTreeMap::new());

/// Connection to a broker, which is closed when all references to it are dropped.
pub struct BrokerConnection {
    client: AsyncClient,
    /// Texts that were received for each topic or filter with listeners.
    topics: Mutex<TopicStates>,
    /// The topic filter and the queue of each inbox.
    inboxes: Mutex<Vec<(String, Weak<InboxQueue>)>>,
    pending: Mutex<PendingSubscriptions>,
    /// Reason why there is no connection to the broker; `None` while connected.
    problem: watch::Sender<Option<String>>,
    /// Task that serves the connection; aborted when the connection is dropped.
    serving: OnceLock<AbortOnDropHandle<()>>,
}

#[derive(Default)]
struct TopicStates {
    single: HashMap<String, watch::Sender<TopicState>>,
    patterns: HashMap<String, watch::Sender<TopicState>>,
    /// Number of connections to the broker that were made so far.
    session: u64,
}

/// Subscriptions that the broker has not answered yet.
#[derive(Default)]
struct PendingSubscriptions {
    /// Filters that wait for room in the queue of requests to the broker.
    left: VecDeque<String>,
    /// Batches of filters in the queue of requests to the broker, in the order of the queue.
    queued: VecDeque<Vec<String>>,
    /// Batches of filters that were sent to the broker and not answered yet, by packet id.
    sent: HashMap<u16, Vec<String>>,
}

/// Texts that were received for one topic, and the state of its subscription.
#[derive(Clone, Debug, Default)]
pub struct TopicState {
    /// The latest texts that were received for the topic, newest first.
    pub texts: VecDeque<ReceivedText>,
    /// Number of texts that were received for the topic so far.
    pub count: u64,
    /// Reason why the topic cannot be subscribed to; `None` if it can.
    pub rejection: Option<String>,
    /// Number of the latest connection to the broker with a subscription to the topic.
    pub session: u64,
}

/// A topic, and a text that was received for it.
pub type TopicText = (String, String);

/// Text that was received from the broker.
#[derive(Clone, Debug)]
pub struct ReceivedText {
    /// The text itself.
    pub text: Arc<str>,
    /// Time when the text was received. If the broker repeats a retained text, this is the time when
    /// it was received first.
    pub at: Instant,
    /// Number of the connection over which the text was received.
    pub session: u64,
    /// Whether the broker had retained the text. The time of publication of a retained text is
    /// unknown.
    pub is_retained: bool,
}

impl BrokerConnection {
    /// Returns the connection of this process to a broker; makes one if there is none. `called`
    /// becomes part of the client's name in the broker's log if a connection is made.
    pub fn shared(broker: &Broker, called: &str) -> Arc<BrokerConnection> {
        let mut connections = lock(&CONNECTIONS);
        if let Some(connection) = connections.get(broker).and_then(Weak::upgrade) {
            return connection;
        }
        if let Some(risk) = broker.risk() {
            tracing::warn!(%broker, "{risk}");
        }
        let mut options = MqttOptions::new(client_name(called), broker.host(), broker.port());
        options.set_keep_alive(KEEP_ALIVE);
        options.set_max_packet_size(PACKET_BYTES_MAX, PACKET_BYTES_MAX);
        let (client, events) = AsyncClient::new(options, REQUESTS_MAX);
        let trouble = watch::Sender::new(Some("it has not answered yet".to_owned()));
        let connection = Arc::new(BrokerConnection {
            client,
            topics: Mutex::default(),
            inboxes: Mutex::default(),
            pending: Mutex::default(),
            problem: trouble,
            serving: OnceLock::new(),
        });
        // The task is started last, because it ends when there is no reference to the connection.
        let serving = serve(Arc::downgrade(&connection), events, broker.clone());
        let serving = AbortOnDropHandle::new(tokio::spawn(serving));
        connection.serving.get_or_init(|| serving);
        connections.retain(|_, known| known.strong_count() > 0);
        connections.insert(broker.clone(), Arc::downgrade(&connection));
        connection
    }

    /// Returns a receiver for the reason why there is no connection to the broker; `None` while
    /// connected.
    pub fn problem(&self) -> watch::Receiver<Option<String>> {
        self.problem.subscribe()
    }

    /// Returns a receiver for the texts of a topic, both those received so far and those received
    /// later. For a filter with `+` or `#`, the receiver gets the texts of all matching topics.
    pub fn listen(&self, topic: &str) -> watch::Receiver<TopicState> {
        let mut topics = lock(&self.topics);
        let session = topics.session;
        let known = if is_pattern(topic) { &mut topics.patterns } else { &mut topics.single };
        if let Some(said) = known.get(topic) {
            return said.subscribe();
        }
        // Topics without listeners are removed only when the number of topics is a power of two, so
        // that the average cost per topic is constant.
        if known.len().is_power_of_two() {
            known.retain(|_, said| said.receiver_count() > 0);
        }
        let refused = filter_problem(topic);
        let is_refused = refused.is_some();
        let (said, hears) =
            watch::channel(TopicState { rejection: refused, session, ..TopicState::default() });
        known.insert(topic.to_owned(), said);
        drop(topics);
        // Without a connection, the topic is subscribed to after the next connect.
        if !is_refused && self.problem.borrow().is_none() {
            self.subscribe([topic.to_owned()]);
        }
        hears
    }

    /// Returns an inbox that receives the latest text of each topic that matches a filter, together
    /// with the topic. Retained texts come first.
    pub fn listen_to_all(&self, filter: &str) -> Inbox {
        self.listen_with(filter, InboxQueue::default())
    }

    /// Returns an inbox that receives the latest texts of each topic that matches a filter,
    /// together with the topic. This inbox is for texts that report events: several may arrive at
    /// once, and each counts.
    pub fn listen_to_events(&self, filter: &str) -> Inbox {
        self.listen_with(filter, InboxQueue::of_events())
    }

    fn listen_with(&self, filter: &str, waiting: InboxQueue) -> Inbox {
        let waiting = Arc::new(waiting);
        lock(&self.inboxes).push((filter.to_owned(), Arc::downgrade(&waiting)));
        match filter_problem(filter) {
            Some(problem) => tracing::warn!("failed to subscribe: {problem}"),
            None if self.problem.borrow().is_none() => self.subscribe([filter.to_owned()]),
            None => (),
        }
        Inbox(waiting)
    }

    /// Publishes a text to a topic.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no connection, the topic is invalid, or the queue of requests
    /// is full. A text that causes an error is not sent later either.
    pub fn publish_text(&self, topic: &str, text: &str) -> Result<(), String> {
        self.publish(topic, text, false)
    }

    /// Publishes a text to a topic; the broker retains the text for later subscribers.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no connection, the topic is invalid, or the queue of requests
    /// is full. A text that causes an error is not sent later either.
    pub fn publish_retained(&self, topic: &str, text: &str) -> Result<(), String> {
        self.publish(topic, text, true)
    }

    fn publish(&self, topic: &str, text: &str, is_kept: bool) -> Result<(), String> {
        // Without this check, the text would be sent when the broker is back.
        if let Some(trouble) = &*self.problem.borrow() {
            return Err(format!("reach the broker: {trouble}"));
        }
        if let Some(problem) = topic_problem(topic) {
            return Err(format!("publish to it: {problem}"));
        }
        let said = self.client.try_publish(topic, QoS::AtLeastOnce, is_kept, text.as_bytes());
        said.map_err(|_| "publish: too many messages wait to be sent to the broker".to_owned())
    }

    /// Records the reason why there is no connection to the broker, and logs the reason if it is
    /// new.
    fn record_problem(&self, broker: &Broker, problem: String) {
        self.problem.send_if_modified(|trouble| {
            let (is_news, was_connected) = (trouble.as_ref() != Some(&problem), trouble.is_none());
            if is_news && was_connected {
                tracing::warn!(%broker, problem, "lost the broker; connecting again");
            } else if is_news {
                tracing::warn!(%broker, problem, "the broker is not reached; trying again");
            }
            *trouble = Some(problem);
            is_news
        });
    }

    fn subscribe(&self, filters: impl IntoIterator<Item = String>) {
        lock(&self.pending).left.extend(filters);
        self.queue_subscriptions();
    }

    /// Moves as many waiting subscriptions as fit into the queue of requests.
    fn queue_subscriptions(&self) {
        let mut asked = lock(&self.pending);
        while !asked.left.is_empty() {
            let count = asked.left.len().min(BATCH);
            let batch: Vec<_> = asked.left.iter().take(count).cloned().collect();
            let filters =
                batch.iter().map(|filter| SubscribeFilter::new(filter.clone(), QoS::AtLeastOnce));
            // If there is no room, the rest follows when the broker has answered a request.
            if self.client.try_subscribe_many(filters).is_err() {
                return;
            }
            asked.left.drain(..count);
            asked.queued.push_back(batch);
        }
    }

    fn handle_connect(&self) {
        let mut filters = Vec::new();
        {
            let mut topics = lock(&self.topics);
            // Before the topics are collected: one that is added later is subscribed to by its
            // listener, which reads this.
            self.problem.send_replace(None);
            topics.session += 1;
            let TopicStates { single, patterns, session } = &mut *topics;
            for (topic, said) in single.iter().chain(patterns.iter()) {
                let refused = filter_problem(topic);
                if refused.is_none() {
                    filters.push(topic.clone());
                }
                said.send_modify(|said| (said.rejection, said.session) = (refused, *session));
            }
        }
        let mut inboxes = lock(&self.inboxes);
        inboxes.retain(|(_, waiting)| waiting.strong_count() > 0);
        let wanted = inboxes.iter().map(|(filter, _)| filter.clone());
        filters.extend(wanted.filter(|filter| filter_problem(filter).is_none()));
        drop(inboxes);
        self.subscribe(filters);
    }

    /// Handles the loss of the connection. Requests without an answer are dropped instead of being
    /// sent later.
    fn handle_disconnect(&self, pending: &mut VecDeque<Request>) {
        let mut asked = lock(&self.pending);
        let is_batch = |request: &&Request| matches!(request, Request::Subscribe(_));
        let dropped = pending.iter().filter(is_batch).count().min(asked.queued.len());
        pending.clear();
        asked.queued.drain(..dropped);
        asked.left.clear();
        asked.sent.clear();
    }

    fn handle_sent(&self, number: u16) {
        let mut asked = lock(&self.pending);
        if let Some(batch) = asked.queued.pop_front() {
            asked.sent.insert(number, batch);
        }
    }

    /// Records the filters that the broker has rejected in its answer to a batch of subscriptions.
    fn handle_suback(&self, answer: &SubAck) {
        let Some(batch) = lock(&self.pending).sent.remove(&answer.pkid) else { return };
        for (filter, code) in batch.iter().zip(&answer.return_codes) {
            if *code != SubscribeReasonCode::Failure {
                continue;
            }
            tracing::warn!(filter, "the broker does not let this daemon subscribe");
            let topics = lock(&self.topics);
            if let Some(said) = topics.single.get(filter).or_else(|| topics.patterns.get(filter)) {
                let refused =
                    format!("the broker does not let this daemon subscribe to `{filter}`");
                said.send_modify(|said| said.rejection = Some(refused));
            }
        }
    }

    fn handle_publish(&self, publish: &Publish) {
        let Publish { topic, payload, retain, .. } = publish;
        let bytes = payload.len();
        if bytes > TEXT_BYTES_MAX {
            return tracing::warn!(
                topic,
                bytes,
                "ignored a message of more than {TEXT_BYTES_MAX} bytes"
            );
        }
        let Ok(text) = std::str::from_utf8(payload) else {
            return tracing::info!(topic, "ignored a message that is no text");
        };
        self.store_text(topic, text, *retain);
        lock(&self.inboxes).retain(|(filter, waiting)| {
            let Some(waiting) = waiting.upgrade() else { return false };
            if matches_filter(filter, topic) && waiting.push(topic, text) {
                tracing::warn!(filter, topic, "ignored: too many messages wait to be read");
            }
            true
        });
    }

    /// Stores a received text for the listeners of its topic.
    fn store_text(&self, topic: &str, text: &str, is_retained: bool) {
        let topics = lock(&self.topics);
        let session = topics.session;
        let fitting = topics.patterns.iter().filter(|(filter, _)| matches_filter(filter, topic));
        let listening = fitting.map(|(_, said)| said).chain(topics.single.get(topic));
        for said in listening {
            if text.len() > KEPT_TEXT_BYTES_MAX {
                tracing::warn!(topic, "ignored a message of more than {KEPT_TEXT_BYTES_MAX} bytes");
                return;
            }
            said.send_modify(|said| {
                // A retained text that is known comes again with each connection, and is no younger.
                let known = said.texts.front().filter(|known| is_retained && *known.text == *text);
                let at = known.map_or_else(Instant::now, |known| known.at);
                let word = ReceivedText { text: text.into(), at, session, is_retained };
                said.count += 1;
                said.texts.truncate(KEPT_TEXTS_MAX - 1);
                said.texts.push_front(word);
            });
        }
    }
}

/// Returns a client name that is unique at the broker, because two clients with one name would
/// disconnect each other. The name of a connection is constant.
fn client_name(called: &str) -> String {
    let called: String = called.chars().filter(char::is_ascii_alphanumeric).take(24).collect();
    let random: String = std::iter::repeat_with(fastrand::alphanumeric).take(16).collect();
    format!("althing-{called}-{random}")
}

/// Serves a connection to a broker until the connection is dropped.
async fn serve(connection: Weak<BrokerConnection>, mut events: EventLoop, broker: Broker) {
    let (mut pause, mut since) = (RECONNECT_WAIT, None::<Instant>);
    loop {
        // The files with the password and the certificates are read at each attempt to connect, so
        // that corrections take effect. A connection that is there needs none of them.
        let prepared = match since {
            None => broker.prepare(&mut events.mqtt_options),
            Some(_) => Ok(()),
        };
        let event = match prepared {
            Ok(()) => events.poll().await.map_err(|error| {
                lengthen_keep_alive(&mut events.mqtt_options, &error);
                error.to_string()
            }),
            Err(problem) => Err(problem),
        };
        let Some(served) = connection.upgrade() else { return };
        match event {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                tracing::info!(%broker, "connected");
                since = Some(Instant::now());
                served.handle_connect();
            }
            Ok(Event::Incoming(Packet::Publish(publish))) => served.handle_publish(&publish),
            Ok(Event::Incoming(Packet::SubAck(answer))) => {
                served.handle_suback(&answer);
                served.queue_subscriptions();
            }
            Ok(Event::Incoming(Packet::PubAck(_))) => served.queue_subscriptions(),
            Ok(Event::Outgoing(Outgoing::Subscribe(number))) => served.handle_sent(number),
            Ok(_) => (),
            Err(problem) => {
                served.record_problem(&broker, problem);
                served.handle_disconnect(&mut events.pending);
                drop(served);
                let failed_at_once =
                    since.take().is_some_and(|since| since.elapsed() < STABLE_AFTER);
                pause = if failed_at_once {
                    (pause * 2).min(RECONNECT_WAIT_MAX)
                } else {
                    RECONNECT_WAIT
                };
                tokio::time::sleep(pause).await;
            }
        }
    }
}

/// Doubles the keep-alive interval if the broker was too slow to answer a ping. Over a slow line, a
/// long text delays the answer, and the text is sent again at each new connection.
fn lengthen_keep_alive(options: &mut MqttOptions, error: &ConnectionError) {
    if let ConnectionError::MqttState(StateError::AwaitPingResp) = error {
        let longer = (options.keep_alive() * 2).min(KEEP_ALIVE_MAX);
        options.set_keep_alive(longer);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn client_names_are_unique() {
        let names: std::collections::BTreeSet<_> =
            (0..1_000).map(|_| client_name("zigbee/1")).collect();
        assert_eq!(names.len(), 1_000);
        assert!(names.iter().all(|name| name.starts_with("althing-zigbee1-")));
    }

    #[tokio::test]
    async fn a_rejected_subscription_is_reported_for_its_topic_only() {
        let broker = Broker::new(Some("127.0.0.1:9"), None, None, None).expect("it is right");
        let connection = BrokerConnection::shared(&broker, "test");
        let (one, other) = (connection.listen("a"), connection.listen("b/+"));
        // This simulates a connection and the answer of the broker.
        connection.subscribe(["a".to_owned(), "b/+".to_owned()]);
        connection.handle_sent(7);
        let codes =
            vec![SubscribeReasonCode::Success(QoS::AtLeastOnce), SubscribeReasonCode::Failure];
        connection.handle_suback(&SubAck::new(7, codes));
        assert_eq!(one.borrow().rejection, None);
        let refused = other.borrow().rejection.clone().expect("it was not granted");
        assert_eq!(refused, "the broker does not let this daemon subscribe to `b/+`");
        // The next connection may grant the subscription.
        connection.handle_connect();
        assert_eq!(other.borrow().rejection, None);
        assert_eq!(other.borrow().session, 1);
    }
}
