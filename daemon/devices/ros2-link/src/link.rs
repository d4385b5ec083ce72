//! The Zenoh session to one robot, with topics and services.
//!
//! - The session is opened in the background: attempts are repeated until the robot's bridge or
//!   router answers. Afterwards Zenoh itself restores a lost connection, and repeats subscriptions.
//! - The session is a client: it listens nowhere, finds no other sessions, and is linked to the
//!   configured endpoint only.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ros_messages::Interfaces;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value, json};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_util::task::AbortOnDropHandle;
use zenoh::Session;
use zenoh::query::{ConsolidationMode, QueryTarget, ReplyKeyExpr};

use crate::dialect::{RosDialect, RosKeys};
use crate::error::RosError;
use crate::topic::{Topic, TopicReader};

/// How long one attempt to open the session may take. A robot in the same network answers within
/// milliseconds; with a lossy radio link the handshake takes seconds.
const OPEN_TIMEOUT: Duration = Duration::from_secs(8);

/// First and longest pause between attempts to open the session. A robot takes a minute to boot.
const REOPEN_FIRST: Duration = Duration::from_millis(250);
const REOPEN_LONGEST: Duration = Duration::from_secs(4);

/// Pause between two checks whether there is a link. Zenoh reports no event when it is restored.
const LINK_POLL: Duration = Duration::from_millis(100);

/// Longest message from a robot, in bytes. A map of a floor has a few megabytes.
const MESSAGE_BYTES_MAX: usize = 16 << 20;

/// Greatest ROS domain. A greater one has no ports for DDS.
const DOMAIN_ID_MAX: u32 = 232;

/// Protocols of endpoints to which a session can connect.
const PROTOCOLS: [&str; 4] = ["tcp", "tls", "quic", "ws"];

/// Maximum number of answers to one call that are kept; the first valid one counts.
const REPLIES_MAX: usize = 16;

/// Address of a robot, and the names under which its nodes are found there.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
pub struct RosAddress {
    /// Zenoh endpoint of the robot's bridge or router, such as `tcp/192.168.1.20:7447`.
    pub endpoint: String,
    /// The way in which ROS names become keys of Zenoh there.
    #[serde(default)]
    pub dialect: RosDialect,
    /// Namespace of the robot's names; may be empty.
    #[serde(default)]
    pub namespace: String,
    /// ROS domain, which is part of the keys of `rmw_zenoh`.
    #[serde(default)]
    pub domain_id: u32,
}

impl<'de> Deserialize<'de> for RosAddress {
    /// Reads an address from a table. By itself serde also takes a list of the values, which no author
    /// means.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<RosAddress, D::Error> {
        let table = Map::deserialize(deserializer)?;
        RosAddress::deserialize(Value::Object(table)).map_err(D::Error::custom)
    }
}

impl RosAddress {
    /// Checks that the endpoint and the namespace have the right form.
    ///
    /// # Errors
    ///
    /// Returns the mistake, and an example.
    pub fn check(&self) -> Result<(), RosError> {
        let RosAddress { endpoint, namespace, domain_id, .. } = self;
        if let Err(problem) = check_endpoint(endpoint) {
            return Err(RosError::Address(format!(
                "endpoint = \"{endpoint}\": {problem}; an endpoint is such as \
                 `tcp/192.168.1.20:7447`"
            )));
        }
        let plain = namespace.trim_matches('/');
        if namespace.contains("//") || !plain.is_empty() && !is_ros_name(plain) {
            return Err(RosError::Address(format!(
                "namespace = \"{namespace}\": a namespace has letters, digits and `_`, and no digit \
                 at the beginning or behind a slash, such as `robot1`"
            )));
        }
        if *domain_id > DOMAIN_ID_MAX {
            return Err(RosError::Address(format!(
                "domain-id = {domain_id}: ROS has the domains 0 to {DOMAIN_ID_MAX}"
            )));
        }
        Ok(())
    }

    /// Returns the address in the form in which two addresses of one robot are equal: without the
    /// slashes at the ends of the namespace, and without the domain where it has no effect.
    pub fn canonical(&self) -> RosAddress {
        let RosAddress { endpoint, dialect, namespace, domain_id } = self;
        RosAddress {
            endpoint: endpoint.clone(),
            dialect: *dialect,
            namespace: namespace.trim_matches('/').to_owned(),
            domain_id: if dialect.has_domain() { *domain_id } else { 0 },
        }
    }
}

/// Whether ROS allows the name of a namespace, a topic, a service or an action: parts between slashes,
/// each of letters, digits and underscores, none with a digit at its beginning. A slash before the
/// first part is allowed.
pub fn is_ros_name(name: &str) -> bool {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
    let is_part = |part: &str| {
        !part.is_empty()
            && part.chars().all(is_plain)
            && !part.starts_with(|first: char| first.is_ascii_digit())
    };
    name.strip_prefix('/').unwrap_or(name).split('/').all(is_part)
}

/// Checks an endpoint to which a session is to connect: its protocol, and its host and port.
fn check_endpoint(endpoint: &str) -> Result<(), String> {
    let (protocol, rest) = endpoint.split_once('/').unwrap_or(("", endpoint));
    if !PROTOCOLS.contains(&protocol) {
        return Err(match PROTOCOLS.contains(&protocol.trim_end_matches(':')) {
            true => "write `/` in place of `://`".to_owned(),
            false => format!("it begins with a protocol and `/`: {}", PROTOCOLS.join(", ")),
        });
    }
    endpoint.parse::<zenoh::config::EndPoint>().map_err(|_| "it is malformed".to_owned())?;
    let address = rest.split(['?', '#']).next().unwrap_or(rest);
    let (host, port) = address.rsplit_once(':').unwrap_or((address, ""));
    if host.contains(':') && !host.starts_with('[') {
        return Err("an IPv6 address stands in brackets, with the port behind them: \
                    `tcp/[fe80::1]:7447`"
            .to_owned());
    }
    if host.is_empty() || port.parse::<u16>().is_err() {
        return Err("it ends with the host and the port".to_owned());
    }
    if port.parse() == Ok(0_u16) {
        return Err("a robot listens at a port from 1 to 65535".to_owned());
    }
    if ["0.0.0.0", "[::]"].contains(&host) {
        return Err("it is where the robot listens; write the robot's own address".to_owned());
    }
    Ok(())
}

/// A link to one robot. The session is closed when all clones and all readers of topics are dropped.
#[derive(Clone)]
pub struct RosLink {
    shared: Arc<SharedLink>,
}

struct SharedLink {
    endpoint: String,
    keys: RosKeys,
    interfaces: Arc<Interfaces>,
    session: watch::Receiver<Option<Session>>,
    /// Reason why the last attempt to open the session failed.
    reason: Arc<Mutex<String>>,
    _opener: AbortOnDropHandle<()>,
}

// === impl RosLink ===

impl RosLink {
    /// Begins to open a session to a robot. Must be called within a Tokio runtime.
    ///
    /// # Errors
    ///
    /// Returns an error if the address is malformed.
    pub fn open(address: RosAddress, interfaces: Arc<Interfaces>) -> Result<RosLink, RosError> {
        address.check()?;
        let RosAddress { endpoint, dialect, namespace, domain_id } = address;
        let (opened, session) = watch::channel(None);
        let reason = Arc::new(Mutex::new("there was no answer yet".to_owned()));
        let opener = open_session(endpoint.clone(), opened, Arc::clone(&reason));
        let shared = SharedLink {
            endpoint,
            keys: RosKeys::new(dialect, &namespace, domain_id),
            interfaces,
            session,
            reason,
            _opener: AbortOnDropHandle::new(tokio::spawn(opener)),
        };
        Ok(RosLink { shared: Arc::new(shared) })
    }

    /// Returns the name of a topic, service or action with the robot's namespace.
    pub fn full_name(&self, name: &str) -> String {
        self.shared.keys.full_name(name)
    }

    /// Returns the definitions of messages.
    pub fn interfaces(&self) -> &Interfaces {
        &self.shared.interfaces
    }

    /// Whether this machine is linked to the robot's bridge or router at present.
    pub async fn is_linked(&self) -> bool {
        let session = self.shared.session.borrow().clone();
        match session {
            Some(session) => {
                let info = session.info();
                // A bridge may also be a peer.
                let is_router = info.routers_zid().await.next().is_some();
                is_router || info.peers_zid().await.next().is_some()
            }
            None => false,
        }
    }

    /// Waits until the robot's bridge or router is linked.
    ///
    /// # Errors
    ///
    /// Returns an error with the reason if there is no link within the time `within`.
    pub async fn until_linked(&self, within: Duration) -> Result<(), RosError> {
        let began = Instant::now();
        while !self.is_linked().await {
            if began.elapsed() >= within {
                return Err(self.not_linked());
            }
            tokio::time::sleep(LINK_POLL).await;
        }
        Ok(())
    }

    /// Returns the error of a link that does not exist now, with the reason.
    fn not_linked(&self) -> RosError {
        let endpoint = self.shared.endpoint.clone();
        let reason = match *self.shared.session.borrow() {
            Some(_) => "the connection was lost, and is opened again".to_owned(),
            None => self.shared.reason.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        };
        RosError::NotLinked { endpoint, reason }
    }

    async fn session(&self, within: Duration) -> Result<Session, RosError> {
        let mut session = self.shared.session.clone();
        let opened = tokio::time::timeout(within, session.wait_for(Option::is_some)).await;
        let session = opened.ok().and_then(Result::ok).and_then(|session| session.clone());
        session.ok_or_else(|| self.not_linked())
    }

    /// Subscribes to a topic, and requests the last message from before the subscription. Topics
    /// with the durability “transient local” answer this request. The link lasts as long as the
    /// reader.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link within the time `within`, or the type is not known.
    pub async fn subscribe(
        &self,
        name: &str,
        type_name: &str,
        within: Duration,
    ) -> Result<TopicReader, RosError> {
        let session = self.session(within).await?;
        let key = self.shared.keys.any_hash(name, type_name)?;
        let topic = Topic {
            name: self.full_name(name),
            type_name: type_name.to_owned(),
            interfaces: Arc::clone(&self.shared.interfaces),
        };
        TopicReader::subscribe(session, key, topic).await
    }

    /// Publishes one message on a topic.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link within the time `within`, or if the message does not
    /// have its type.
    pub async fn publish(
        &self,
        name: &str,
        type_name: &str,
        message: &Value,
        within: Duration,
    ) -> Result<(), RosError> {
        let session = self.session(within).await?;
        let key = self.shared.keys.exact(name, type_name, &self.shared.interfaces)?;
        let payload = self.encode(name, type_name, message)?;
        let put = session.put(key, payload);
        match self.shared.keys.attachment() {
            Some(attachment) => put.attachment(attachment).await,
            None => put.await,
        }
        .map_err(RosError::zenoh)
    }

    /// Calls a service of the type `type_name`, such as `std_srvs/srv/Trigger`, and returns its
    /// response.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no link or no node answers within the time `within`, if the
    /// answer is an error or cannot be read, or if the request does not have its type.
    pub async fn call(
        &self,
        name: &str,
        type_name: &str,
        request: &Value,
        within: Duration,
    ) -> Result<Value, RosError> {
        let session = self.session(within).await?;
        let key = self.shared.keys.any_hash(name, type_name)?;
        let payload = self.encode(name, &format!("{type_name}_Request"), request)?;
        // Replies after the first valid one are dropped here. If the channel were closed instead,
        // Zenoh would log an error for each of them.
        let (received, mut replies) = mpsc::channel(REPLIES_MAX);
        let get = session
            .get(key)
            .payload(payload)
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            .accept_replies(ReplyKeyExpr::Any)
            .timeout(within)
            .callback(move |reply| drop(received.try_send(reply)));
        match self.shared.keys.attachment() {
            Some(attachment) => get.attachment(attachment).await,
            None => get.await,
        }
        .map_err(RosError::zenoh)?;
        let mut refusal = None;
        while let Some(reply) = replies.recv().await {
            match reply.into_result() {
                Ok(sample) => {
                    let bytes = sample.payload().to_bytes();
                    return self.decode(name, &format!("{type_name}_Response"), &bytes);
                }
                Err(error) => {
                    refusal = Some(String::from_utf8_lossy(&error.payload().to_bytes()).into());
                }
            }
        }
        let service = self.full_name(name);
        Err(match refusal {
            Some(reason) if reason != "Timeout" => RosError::Refused { service, reason },
            _ => RosError::NoAnswer { service, within },
        })
    }

    fn encode(&self, name: &str, type_name: &str, value: &Value) -> Result<Vec<u8>, RosError> {
        let encoded = self.shared.interfaces.encode(type_name, value);
        encoded.map_err(|source| RosError::Encode { name: self.full_name(name), source })
    }

    fn decode(&self, name: &str, type_name: &str, bytes: &[u8]) -> Result<Value, RosError> {
        let decoded = self.shared.interfaces.decode(type_name, bytes);
        let decoded =
            decoded.map_err(|source| RosError::Decode { name: self.full_name(name), source })?;
        Ok(decoded.value)
    }
}

/// Opens the session, and keeps it until the receivers are gone.
async fn open_session(
    endpoint: String,
    opened: watch::Sender<Option<Session>>,
    reason: Arc<Mutex<String>>,
) {
    let mut pause = REOPEN_FIRST;
    loop {
        let problem = match tokio::time::timeout(OPEN_TIMEOUT, try_open(&endpoint)).await {
            Ok(Ok(session)) => {
                opened.send_replace(Some(session));
                tracing::info!(endpoint, "linked to the robot");
                return opened.closed().await;
            }
            Ok(Err(error)) => opening_problem(&error.to_string()),
            Err(_) => format!("there was no answer within {OPEN_TIMEOUT:?}"),
        };
        tracing::debug!(endpoint, problem, "failed to reach the robot; it is tried again");
        *reason.lock().unwrap_or_else(PoisonError::into_inner) = problem;
        tokio::time::sleep(pause).await;
        pause = (pause * 2).min(REOPEN_LONGEST);
    }
}

/// Returns Zenoh's reason for a session that was not opened, in words for a person.
fn opening_problem(error: &str) -> String {
    if error.contains("Unable to connect") {
        return "nothing answers there; is the robot on, and its bridge or router?".to_owned();
    }
    // Zenoh appends the place in its own source.
    let reason = error.split(" at /").next().unwrap_or(error);
    reason.trim().trim_end_matches(['!', '.']).to_owned()
}

async fn try_open(endpoint: &str) -> zenoh::Result<Session> {
    let settings = json!({
        "mode": "client",
        "connect": { "endpoints": [endpoint] },
        "listen": { "endpoints": [] },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "transport": { "link": { "rx": { "max_message_size": MESSAGE_BYTES_MAX } } },
    });
    zenoh::open(zenoh::Config::from_json5(&settings.to_string())?).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_has_a_protocol_a_host_and_a_port() {
        for (endpoint, complaint) in [
            ("tcp/192.168.1.20:7447", ""),
            ("tls/robot-1.lan:7447", ""),
            ("tcp/[fd00::1]:7447#iface=wlan0", ""),
            ("192.168.1.20:7447", "begins with a protocol"),
            ("tpc/192.168.1.20:7447", "begins with a protocol"),
            ("tcp://192.168.1.20:7447", "in place of `://`"),
            ("tcp/192.168.1.20", "the host and the port"),
            ("tcp/192.168.1.20:", "the host and the port"),
            ("tcp/0.0.0.0:7447", "where the robot listens"),
            ("tcp/fe80::1", "in brackets"),
            ("tcp/fe80::1:7447", "in brackets"),
            ("tcp/[fe80::1]", "the host and the port"),
            ("tcp/192.168.1.20:0", "a port from 1 to 65535"),
        ] {
            let checked = check_endpoint(endpoint).err().unwrap_or_default();
            let is_right = checked.is_empty() == complaint.is_empty();
            assert!(is_right && checked.contains(complaint), "{endpoint}: {checked}");
        }
    }

    fn address(namespace: &str, domain_id: u32, dialect: RosDialect) -> RosAddress {
        let (endpoint, namespace) = ("tcp/10.0.0.7:7447".to_owned(), namespace.to_owned());
        RosAddress { endpoint, dialect, namespace, domain_id }
    }

    #[test]
    fn a_namespace_and_a_domain_are_those_that_ros_allows() {
        for (namespace, domain_id, complaint) in [
            ("", 0, ""),
            ("/", 232, ""),
            ("/cell/robot_1/", 7, ""),
            ("1robot", 0, "no digit at the beginning"),
            ("cell/1robot", 0, "behind a slash"),
            ("robot-1", 0, "letters, digits and `_`"),
            ("cell//robot", 0, "letters, digits and `_`"),
            ("", 300, "domains 0 to 232"),
        ] {
            let checked = address(namespace, domain_id, RosDialect::RmwZenoh).check();
            let problem = checked.err().map(|error| error.to_string()).unwrap_or_default();
            let is_right = problem.is_empty() == complaint.is_empty();
            assert!(is_right && problem.contains(complaint), "{namespace}: {problem}");
        }
    }

    #[test]
    fn an_address_is_a_table() {
        let list = serde_json::from_value::<RosAddress>(json!(["tcp/10.0.0.7:7447"]));
        let problem = list.err().map(|error| error.to_string());
        assert_eq!(problem.as_deref(), Some("invalid type: sequence, expected a map"));
        let table =
            serde_json::from_value::<RosAddress>(json!({ "endpoint": "tcp/10.0.0.7:7447" }));
        assert_eq!(table.ok(), Some(address("", 0, RosDialect::Ros2Dds)));
    }

    #[test]
    fn addresses_of_one_robot_are_equal() {
        let (bridge, own) = (RosDialect::Ros2Dds, RosDialect::RmwZenoh);
        let canonical =
            |namespace, domain_id, dialect| address(namespace, domain_id, dialect).canonical();
        assert_eq!(canonical("/robot1/", 3, bridge), canonical("robot1", 0, bridge));
        assert_eq!(canonical("/", 3, own), canonical("", 3, own));
        assert_ne!(canonical("", 3, own), canonical("", 4, own));
        assert_ne!(canonical("a", 0, own), canonical("b", 0, own));
    }

    #[test]
    fn reasons_of_zenoh_have_no_places_in_its_source() {
        let refused =
            "Unable to connect to any of [Single(tcp/127.0.0.1:9)]!  at /x/zenoh/a.rs:447.";
        assert!(opening_problem(refused).starts_with("nothing answers there"));
        assert_eq!(opening_problem("Invalid locator! at /x/y.rs:1."), "Invalid locator");
    }
}
