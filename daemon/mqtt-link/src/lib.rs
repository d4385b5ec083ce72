//! One connection per MQTT broker and process, for every agent that needs it.
//!
//! - After each loss it subscribes anew, which brokers forget and `rumqttc` does not do by itself; in
//!   small batches, and without the filters that no broker takes ([`filter_problem`]).
//! - What was said under a topic is kept, the last words of it, for agents that ask later; an
//!   [`Inbox`] (`inbox`) has what was said under many topics.
//! - [`Broker`] (`broker`) says which broker it is: what it may be called, by TLS or not, with which
//!   user and password. Websockets are not built.

mod broker;
mod filter;
mod inbox;

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
pub use filter::{filter_problem, fits, topic_problem};
pub use inbox::Inbox;

use filter::is_pattern;
use inbox::Waiting;

/// How long a silent broker counts as alive, at first. A text that takes longer than that to come is
/// no reason to hang up for ever: each time a broker was too slow, it gets twice as long.
const KEEP_ALIVE: Duration = Duration::from_secs(5);
const KEEP_ALIVE_MAX: Duration = Duration::from_secs(80);

/// Pause until a broker is called again: a restart takes a second. A broker that lets in and hangs up
/// is called less and less often.
const CALL_AGAIN: Duration = Duration::from_millis(250);
const CALL_AGAIN_MAX: Duration = Duration::from_secs(8);

/// A connection that lasts as long as this has not failed at once.
const LASTS: Duration = Duration::from_secs(10);

/// The longest packet: the longest that MQTT has, because a longer one than is allowed here would end
/// the connection, and a retained one would end each that follows.
const PACKET_BYTES_MAX: usize = 1 << 28;

/// The longest text under a filter that is taken in: what a bridge says of thousands of devices.
const TEXT_BYTES_MAX: usize = 1 << 26;

/// The longest text of a device that is taken in; most are below a kilobyte.
const WORD_BYTES_MAX: usize = 1 << 20;

/// Requests to a broker that wait: each batch of subscriptions is one, each command another.
const REQUESTS_MAX: usize = 4_096;

/// Filters in one subscription; some brokers take no more.
const BATCH: usize = 8;

/// The words of a device that are remembered: as many as may come before they are read.
const WORDS_MAX: usize = 64;

/// All connections of this process, by broker.
static CONNECTIONS: Mutex<BTreeMap<Broker, Weak<Connection>>> = Mutex::new(BTreeMap::new());

/// A connection to a broker; it lasts while it is held.
pub struct Connection {
    client: AsyncClient,
    /// What was said under each topic, or pattern of topics, that is listened to.
    topics: Mutex<Topics>,
    /// The inboxes, by filter.
    inboxes: Mutex<Vec<(String, Weak<Waiting>)>>,
    asked: Mutex<Asked>,
    /// Why it is not connected; `None` if it is.
    trouble: watch::Sender<Option<String>>,
    /// Ends with the connection.
    serving: OnceLock<AbortOnDropHandle<()>>,
}

#[derive(Default)]
struct Topics {
    single: HashMap<String, watch::Sender<Said>>,
    patterns: HashMap<String, watch::Sender<Said>>,
    /// Counts the connections that there were.
    session: u64,
}

/// The subscriptions that are under way.
#[derive(Default)]
struct Asked {
    /// What could not be handed over yet.
    left: VecDeque<String>,
    /// What was handed over, in that order.
    handed: VecDeque<Vec<String>>,
    /// What was sent, by its number, until it is answered.
    sent: HashMap<u16, Vec<String>>,
}

/// What was said under a topic.
#[derive(Clone, Debug, Default)]
pub struct Said {
    /// The last words, the newest first.
    pub words: VecDeque<Word>,
    /// Counts all there were.
    pub count: u64,
    /// Why the topic cannot be listened to; `None` if it can.
    pub refused: Option<String>,
    /// The number of the connection that it was last listened to by.
    pub session: u64,
}

/// A topic, and what was said under it.
pub type Told = (String, String);

/// One thing that was said.
#[derive(Clone, Debug)]
pub struct Word {
    /// The text.
    pub text: Arc<str>,
    /// When it was heard.
    pub at: Instant,
    /// The number of the connection that it was heard by.
    pub session: u64,
    /// Whether the broker had kept it: it may have been said at any time before.
    pub is_retained: bool,
}

impl Connection {
    /// The connection of this process to a broker; `called` is put into the client's name where it is
    /// made, for people who read the broker's log.
    pub fn to(broker: &Broker, called: &str) -> Arc<Connection> {
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
        let connection = Arc::new(Connection {
            client,
            topics: Mutex::default(),
            inboxes: Mutex::default(),
            asked: Mutex::default(),
            trouble,
            serving: OnceLock::new(),
        });
        // Not before it is there: what serves it ends when it is gone.
        let serving = run(Arc::downgrade(&connection), events, broker.clone());
        let serving = AbortOnDropHandle::new(tokio::spawn(serving));
        connection.serving.get_or_init(|| serving);
        connections.retain(|_, known| known.strong_count() > 0);
        connections.insert(broker.clone(), Arc::downgrade(&connection));
        connection
    }

    /// Why it is not connected; nothing if it is.
    pub fn trouble(&self) -> watch::Receiver<Option<String>> {
        self.trouble.subscribe()
    }

    /// What was said under a topic, and every further word. A filter with `+` or `#` is all topics
    /// that fit it, as one.
    pub fn listen(&self, topic: &str) -> watch::Receiver<Said> {
        let mut topics = lock(&self.topics);
        let session = topics.session;
        let known = if is_pattern(topic) { &mut topics.patterns } else { &mut topics.single };
        if let Some(said) = known.get(topic) {
            return said.subscribe();
        }
        // Now and then, so that each new topic costs the same.
        if known.len().is_power_of_two() {
            known.retain(|_, said| said.receiver_count() > 0);
        }
        let refused = filter_problem(topic);
        let is_refused = refused.is_some();
        let (said, hears) = watch::channel(Said { refused, session, ..Said::default() });
        known.insert(topic.to_owned(), said);
        drop(topics);
        // Where there is no connection yet, it subscribes when there is.
        if !is_refused && self.trouble.borrow().is_none() {
            self.subscribe([topic.to_owned()]);
        }
        hears
    }

    /// The last text under each topic that fits a filter, with its topic: what is retained first.
    pub fn listen_to_all(&self, filter: &str) -> Inbox {
        self.listen_with(filter, Waiting::default())
    }

    /// What is said under each topic that fits a filter, with its topic: of each the last texts, as many
    /// as may come at once where each says another thing.
    pub fn listen_to_events(&self, filter: &str) -> Inbox {
        self.listen_with(filter, Waiting::of_events())
    }

    fn listen_with(&self, filter: &str, waiting: Waiting) -> Inbox {
        let waiting = Arc::new(waiting);
        lock(&self.inboxes).push((filter.to_owned(), Arc::downgrade(&waiting)));
        match filter_problem(filter) {
            Some(problem) => tracing::warn!("failed to listen: {problem}"),
            None if self.trouble.borrow().is_none() => self.subscribe([filter.to_owned()]),
            None => (),
        }
        Inbox(waiting)
    }

    /// Says something.
    ///
    /// # Errors
    ///
    /// If it was not handed over, and will not be.
    pub fn say(&self, topic: &str, text: &str) -> Result<(), String> {
        self.publish(topic, text, false)
    }

    /// Says something that the broker keeps for those that come later.
    ///
    /// # Errors
    ///
    /// If it was not handed over, and will not be.
    pub fn say_and_keep(&self, topic: &str, text: &str) -> Result<(), String> {
        self.publish(topic, text, true)
    }

    fn publish(&self, topic: &str, text: &str, is_kept: bool) -> Result<(), String> {
        // What is handed over now would be sent whenever the broker is back.
        if let Some(trouble) = &*self.trouble.borrow() {
            return Err(format!("reach the broker: {trouble}"));
        }
        if let Some(problem) = topic_problem(topic) {
            return Err(format!("say it: {problem}"));
        }
        let said = self.client.try_publish(topic, QoS::AtLeastOnce, is_kept, text.as_bytes());
        said.map_err(|_| "say it: too much waits to be said to the broker".to_owned())
    }

    /// Says why there is no connection, once for each reason.
    fn note_trouble(&self, broker: &Broker, problem: String) {
        self.trouble.send_if_modified(|trouble| {
            let (is_news, was_connected) = (trouble.as_ref() != Some(&problem), trouble.is_none());
            if is_news && was_connected {
                tracing::warn!(%broker, problem, "lost the broker; it is called again");
            } else if is_news {
                tracing::warn!(%broker, problem, "the broker is not reached; it is called again");
            }
            *trouble = Some(problem);
            is_news
        });
    }

    fn subscribe(&self, filters: impl IntoIterator<Item = String>) {
        lock(&self.asked).left.extend(filters);
        self.hand_over();
    }

    /// Hands over what is to be subscribed to, as far as there is room.
    fn hand_over(&self) {
        let mut asked = lock(&self.asked);
        while !asked.left.is_empty() {
            let count = asked.left.len().min(BATCH);
            let batch: Vec<_> = asked.left.iter().take(count).cloned().collect();
            let filters =
                batch.iter().map(|filter| SubscribeFilter::new(filter.clone(), QoS::AtLeastOnce));
            // Where there is no room, it goes on as soon as the broker has answered something.
            if self.client.try_subscribe_many(filters).is_err() {
                return;
            }
            asked.left.drain(..count);
            asked.handed.push_back(batch);
        }
    }

    fn connected(&self) {
        let mut filters = Vec::new();
        {
            let mut topics = lock(&self.topics);
            topics.session += 1;
            let Topics { single, patterns, session } = &mut *topics;
            for (topic, said) in single.iter().chain(patterns.iter()) {
                let refused = filter_problem(topic);
                if refused.is_none() {
                    filters.push(topic.clone());
                }
                said.send_modify(|said| (said.refused, said.session) = (refused, *session));
            }
        }
        let mut inboxes = lock(&self.inboxes);
        inboxes.retain(|(_, waiting)| waiting.strong_count() > 0);
        let wanted = inboxes.iter().map(|(filter, _)| filter.clone());
        filters.extend(wanted.filter(|filter| filter_problem(filter).is_none()));
        drop(inboxes);
        self.trouble.send_replace(None);
        self.subscribe(filters);
    }

    /// The connection is lost: of what was under way, nothing is known, and nothing is sent later.
    fn lost(&self, pending: &mut VecDeque<Request>) {
        let mut asked = lock(&self.asked);
        let is_batch = |request: &&Request| matches!(request, Request::Subscribe(_));
        let dropped = pending.iter().filter(is_batch).count().min(asked.handed.len());
        pending.clear();
        asked.handed.drain(..dropped);
        asked.left.clear();
        asked.sent.clear();
    }

    fn sent(&self, number: u16) {
        let mut asked = lock(&self.asked);
        if let Some(batch) = asked.handed.pop_front() {
            asked.sent.insert(number, batch);
        }
    }

    /// Takes in which subscriptions a broker grants.
    fn answered(&self, answer: &SubAck) {
        let Some(batch) = lock(&self.asked).sent.remove(&answer.pkid) else { return };
        for (filter, code) in batch.iter().zip(&answer.return_codes) {
            if *code != SubscribeReasonCode::Failure {
                continue;
            }
            tracing::warn!(filter, "the broker does not let this daemon listen");
            let topics = lock(&self.topics);
            if let Some(said) = topics.single.get(filter).or_else(|| topics.patterns.get(filter)) {
                let refused = format!("the broker does not let this daemon listen to `{filter}`");
                said.send_modify(|said| said.refused = Some(refused));
            }
        }
    }

    fn heard(&self, publish: &Publish) {
        let Publish { topic, payload, retain, .. } = publish;
        let bytes = payload.len();
        if bytes > TEXT_BYTES_MAX {
            return tracing::warn!(
                topic,
                bytes,
                "ignored a text of more than {TEXT_BYTES_MAX} bytes"
            );
        }
        let Ok(text) = std::str::from_utf8(payload) else {
            return tracing::info!(topic, "ignored what is no text");
        };
        self.keep(topic, text, *retain);
        lock(&self.inboxes).retain(|(filter, waiting)| {
            let Some(waiting) = waiting.upgrade() else { return false };
            if fits(filter, topic) && waiting.put(topic, text) {
                tracing::warn!(filter, topic, "ignored: too many texts wait to be read");
            }
            true
        });
    }

    /// Keeps a word for those that listen to its topic.
    fn keep(&self, topic: &str, text: &str, is_retained: bool) {
        let topics = lock(&self.topics);
        let session = topics.session;
        let fitting = topics.patterns.iter().filter(|(filter, _)| fits(filter, topic));
        let listening = fitting.map(|(_, said)| said).chain(topics.single.get(topic));
        for said in listening {
            if text.len() > WORD_BYTES_MAX {
                tracing::warn!(topic, "ignored a text of more than {WORD_BYTES_MAX} bytes");
                return;
            }
            let word = Word { text: text.into(), at: Instant::now(), session, is_retained };
            said.send_modify(|said| {
                said.count += 1;
                said.words.truncate(WORDS_MAX - 1);
                said.words.push_front(word);
            });
        }
    }
}

/// A name that no other client of a broker has: of two of one name, each would throw the other out.
/// It stays the same as long as the process.
fn client_name(called: &str) -> String {
    let called: String = called.chars().filter(char::is_ascii_alphanumeric).take(24).collect();
    let random: String = std::iter::repeat_with(fastrand::alphanumeric).take(16).collect();
    format!("althing-{called}-{random}")
}

/// Serves a connection.
async fn run(connection: Weak<Connection>, mut events: EventLoop, broker: Broker) {
    let (mut pause, mut since) = (CALL_AGAIN, None::<Instant>);
    loop {
        // Files may be put right while it goes on trying.
        let event = match broker.prepare(&mut events.mqtt_options) {
            Ok(()) => events.poll().await.map_err(|error| {
                be_patient(&mut events.mqtt_options, &error);
                error.to_string()
            }),
            Err(problem) => Err(problem),
        };
        let Some(served) = connection.upgrade() else { return };
        match event {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                tracing::info!(%broker, "connected");
                since = Some(Instant::now());
                served.connected();
            }
            Ok(Event::Incoming(Packet::Publish(publish))) => served.heard(&publish),
            Ok(Event::Incoming(Packet::SubAck(answer))) => {
                served.answered(&answer);
                served.hand_over();
            }
            Ok(Event::Incoming(Packet::PubAck(_))) => served.hand_over(),
            Ok(Event::Outgoing(Outgoing::Subscribe(number))) => served.sent(number),
            Ok(_) => (),
            Err(problem) => {
                served.note_trouble(&broker, problem);
                served.lost(&mut events.pending);
                drop(served);
                let failed_at_once = since.take().is_some_and(|since| since.elapsed() < LASTS);
                pause = if failed_at_once { (pause * 2).min(CALL_AGAIN_MAX) } else { CALL_AGAIN };
                tokio::time::sleep(pause).await;
            }
        }
    }
}

/// Waits longer for a broker that was too slow to answer a ping: over a slow line a long text keeps
/// it from answering, and comes again with each new connection.
fn be_patient(options: &mut MqttOptions, error: &ConnectionError) {
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
    fn no_two_clients_have_one_name() {
        let names: std::collections::BTreeSet<_> =
            (0..1_000).map(|_| client_name("zigbee/1")).collect();
        assert_eq!(names.len(), 1_000);
        assert!(names.iter().all(|name| name.starts_with("althing-zigbee1-")));
    }

    #[tokio::test]
    async fn what_a_broker_does_not_grant_is_told_of_that_topic_alone() {
        let broker = Broker::new(Some("127.0.0.1:9"), None, None, None).expect("it is right");
        let connection = Connection::to(&broker, "test");
        let (one, other) = (connection.listen("a"), connection.listen("b/+"));
        // As if it were connected, and the broker had answered.
        connection.subscribe(["a".to_owned(), "b/+".to_owned()]);
        connection.sent(7);
        let codes =
            vec![SubscribeReasonCode::Success(QoS::AtLeastOnce), SubscribeReasonCode::Failure];
        connection.answered(&SubAck::new(7, codes));
        assert_eq!(one.borrow().refused, None);
        let refused = other.borrow().refused.clone().expect("it was not granted");
        assert_eq!(refused, "the broker does not let this daemon listen to `b/+`");
        // The next connection may grant it.
        connection.connected();
        assert_eq!(other.borrow().refused, None);
        assert_eq!(other.borrow().session, 1);
    }
}
