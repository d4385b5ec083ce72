//! One connection per MQTT broker and process, whoever needs it.
//!
//! - After each loss it subscribes anew, which brokers forget and `rumqttc` does not do by itself.
//! - What was said under a topic is kept, the last words of it, for whoever asks later; whoever listens
//!   to many topics at once hears each word as it comes.
//! - [`Broker`] (`broker`) says whom it speaks to: what a broker may be called, by TLS or not, with which
//!   user and password. Websockets are not built.

mod broker;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::time::Duration;

use rumqttc::{AsyncClient, Event, EventLoop, MqttOptions, Packet, Publish, QoS, SubscribeFilter};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_util::task::AbortOnDropHandle;

pub use broker::Broker;

/// How long a silent broker counts as alive.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// Pause until a broker is called again: a restart takes a second.
const CALL_AGAIN: Duration = Duration::from_millis(250);

/// The longest message that is read: a device's is below a kilobyte, and a longer one would end
/// the connection.
const PACKET_BYTES_MAX: usize = 1 << 20;

/// Requests to a broker that wait: each subscription is one, and all of a new connection are one.
const REQUESTS_MAX: usize = 4_096;

/// The words of a device that are remembered: of the last of them that speaks of a quantity its
/// value is.
const WORDS_MAX: usize = 16;

/// Words under many topics that wait to be heard; what does not fit comes again with the next
/// connection, if it is retained.
const HEARD_MAX: usize = 8_192;

/// All connections of this process, by broker.
static CONNECTIONS: Mutex<BTreeMap<Broker, Weak<Connection>>> = Mutex::new(BTreeMap::new());

/// Makes clients' names unique: a broker ends the first of two of one name.
static CLIENTS: AtomicU64 = AtomicU64::new(0);

/// A connection to a broker, for as long as somebody holds it.
pub struct Connection {
    client: AsyncClient,
    /// What was said under each topic that somebody listens to.
    topics: Mutex<HashMap<String, watch::Sender<Said>>>,
    /// Who listens to many topics at once.
    filters: Mutex<Vec<(String, mpsc::Sender<Told>)>>,
    /// Why it is not connected; `None` if it is.
    trouble: watch::Sender<Option<String>>,
    /// Ends with the connection.
    serving: OnceLock<AbortOnDropHandle<()>>,
}

/// What was said under a topic.
#[derive(Clone, Debug, Default)]
pub struct Said {
    /// The last words, the newest first.
    pub words: VecDeque<Word>,
    /// Counts all there were.
    pub count: u64,
}

/// A topic, and what was said under it.
pub type Told = (String, String);

/// One thing that was said.
#[derive(Clone, Debug)]
pub struct Word {
    /// The text.
    pub text: String,
    /// When it was heard.
    pub at: Instant,
}

impl Connection {
    /// The connection of this process to a broker.
    pub fn to(broker: &Broker) -> Arc<Connection> {
        let mut connections = lock(&CONNECTIONS);
        if let Some(connection) = connections.get(broker).and_then(Weak::upgrade) {
            return connection;
        }
        if let Some(risk) = broker.risk() {
            tracing::warn!(%broker, "{risk}");
        }
        let count = CLIENTS.fetch_add(1, Ordering::Relaxed);
        let name = format!("althing-{}-{count}", std::process::id());
        let mut options = MqttOptions::new(name, broker.host(), broker.port());
        options.set_keep_alive(KEEP_ALIVE);
        options.set_max_packet_size(PACKET_BYTES_MAX, PACKET_BYTES_MAX);
        let (client, events) = AsyncClient::new(options, REQUESTS_MAX);
        let trouble = watch::Sender::new(Some("it has not answered yet".to_owned()));
        let connection = Arc::new(Connection {
            client,
            topics: Mutex::default(),
            filters: Mutex::default(),
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

    /// What was said under a topic, and every further word.
    pub fn listen(&self, topic: &str) -> watch::Receiver<Said> {
        let mut topics = lock(&self.topics);
        if let Some(said) = topics.get(topic) {
            return said.subscribe();
        }
        // Now and then, so that it costs each who comes the same.
        if topics.len().is_power_of_two() {
            topics.retain(|_, said| said.receiver_count() > 0);
        }
        let (said, hears) = watch::channel(Said::default());
        topics.insert(topic.to_owned(), said);
        drop(topics);
        if self.trouble.borrow().is_none() {
            // Where there is no connection yet, it subscribes when there is.
            self.subscribe([topic.to_owned()]);
        }
        hears
    }

    /// Every word under the topics that fit a filter, with its topic: what is retained first.
    pub fn listen_to_all(&self, filter: &str) -> mpsc::Receiver<Told> {
        let (tell, heard) = mpsc::channel(HEARD_MAX);
        lock(&self.filters).push((filter.to_owned(), tell));
        if self.trouble.borrow().is_none() {
            self.subscribe([filter.to_owned()]);
        }
        heard
    }

    /// Says something; whether it could be handed over.
    pub fn say(&self, topic: &str, text: &str) -> bool {
        let said = self.client.try_publish(topic, QoS::AtLeastOnce, false, text.as_bytes());
        self.trouble.borrow().is_none() && said.is_ok()
    }

    fn subscribe(&self, topics: impl IntoIterator<Item = String>) {
        let filters = topics.into_iter().map(|topic| SubscribeFilter::new(topic, QoS::AtLeastOnce));
        let filters: Vec<_> = filters.collect();
        if filters.is_empty() {
            return;
        }
        if let Err(error) = self.client.try_subscribe_many(filters) {
            tracing::warn!(%error, "failed to subscribe; it is tried again with the next connection");
        }
    }

    fn connected(&self) {
        let topics: Vec<_> = lock(&self.topics).keys().cloned().collect();
        let filters =
            lock(&self.filters).iter().map(|(filter, _)| filter.clone()).collect::<Vec<_>>();
        self.trouble.send_replace(None);
        self.subscribe(topics.into_iter().chain(filters));
    }

    fn heard(&self, publish: &Publish) {
        let Ok(text) = std::str::from_utf8(&publish.payload) else {
            return tracing::info!(topic = publish.topic, "ignored what is no text");
        };
        if let Some(said) = lock(&self.topics).get(&publish.topic) {
            said.send_modify(|said| {
                said.count += 1;
                said.words.truncate(WORDS_MAX - 1);
                said.words.push_front(Word { text: text.to_owned(), at: Instant::now() });
            });
        }
        lock(&self.filters).retain(|(filter, tell)| {
            if fits(filter, &publish.topic)
                && let Err(mpsc::error::TrySendError::Full(_)) =
                    tell.try_send((publish.topic.clone(), text.to_owned()))
            {
                tracing::warn!(filter, "more is said at once than is heard: a word is lost");
            }
            !tell.is_closed()
        });
    }
}

/// Serves a connection.
async fn run(connection: Weak<Connection>, mut events: EventLoop, broker: Broker) {
    loop {
        // Files may be put right while it goes on trying.
        let event = match broker.prepare(&mut events.mqtt_options) {
            Ok(()) => events.poll().await.map_err(|error| error.to_string()),
            Err(problem) => Err(problem),
        };
        let Some(served) = connection.upgrade() else { return };
        match event {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                tracing::info!(%broker, "connected");
                served.connected();
            }
            Ok(Event::Incoming(Packet::Publish(publish))) => served.heard(&publish),
            Ok(_) => (),
            Err(problem) => {
                let was_connected = served.trouble.send_replace(Some(problem.clone()));
                if was_connected.is_none() {
                    tracing::warn!(%broker, problem, "lost the broker; it is called again");
                }
                drop(served);
                tokio::time::sleep(CALL_AGAIN).await;
            }
        }
    }
}

/// Whether a topic fits a filter: `+` is any one level, `#` at the end all that follow (MQTT 3.1.1, 4.7).
fn fits(filter: &str, topic: &str) -> bool {
    let (mut filter, mut topic) = (filter.split('/'), topic.split('/'));
    loop {
        match (filter.next(), topic.next()) {
            (Some("#"), _) | (None, None) => return true,
            (Some("+"), Some(_)) => (),
            (Some(one), Some(other)) if one == other => (),
            _ => return false,
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_those_of_mqtt() {
        for (filter, topic, expected) in [
            ("a/+/config", "a/b/config", true),
            ("a/+/config", "a/b/c/config", false),
            ("a/#", "a/b/c", true),
            ("a/#", "a", true),
            ("a/b", "a/b", true),
            ("a/b", "a/b/c", false),
            ("a/b/c", "a/b", false),
            ("#", "a/b", true),
        ] {
            assert_eq!(fits(filter, topic), expected, "{filter} {topic}");
        }
    }
}
