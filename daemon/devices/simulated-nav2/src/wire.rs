//! Topics and services of a simulated robot, on a Zenoh router of its own. They are those of any
//! robot, so that tests of other devices use them too.
//!
//! The keys are made here and not in `ros2-link`: a simulated robot that shared the code of its
//! client would also share its mistakes.

use std::time::{SystemTime, UNIX_EPOCH};

use ros_messages::{Interfaces, dds_name};
use serde_json::{Value, json};
use tokio::sync::mpsc;
use zenoh::Session;
use zenoh::bytes::ZBytes;
use zenoh::query::{Query, Queryable};

/// Number of requests to one service that wait; further ones are not answered.
const REQUESTS_MAX: usize = 64;

/// Identifier of the simulated robot as a ROS entity; its value does not matter.
const GID: [u8; 16] = *b"simulated-nav2-0";

/// The way in which ROS names become keys of Zenoh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RobotWire {
    /// As `zenoh-bridge-ros2dds` does.
    Ros2Dds,
    /// As `rmw_zenoh` does, in this ROS domain.
    RmwZenoh(u32),
}

/// The router of a simulated robot, with its topics and services.
pub struct RobotNode {
    pub(crate) session: Session,
    wire: RobotWire,
    namespace: String,
    interfaces: Interfaces,
}

/// Requests to one service.
pub struct Service {
    requests: mpsc::Receiver<Query>,
    _queryable: Queryable<()>,
}

impl RobotNode {
    /// Opens a Zenoh router at `listen`, by default at a port of loopback that the kernel chooses.
    /// Returns the node of the robot on it, and its endpoint.
    ///
    /// # Errors
    ///
    /// Returns an error if Zenoh cannot open the router.
    pub async fn open(
        wire: RobotWire,
        listen: Option<&str>,
        namespace: &str,
        interfaces: Interfaces,
    ) -> zenoh::Result<(RobotNode, String)> {
        let listen = listen.unwrap_or("tcp/127.0.0.1:0");
        let settings = json!({
            "mode": "router",
            "listen": { "endpoints": [listen] },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        });
        let session = zenoh::open(zenoh::Config::from_json5(&settings.to_string())?).await?;
        let endpoint = session.info().locators().await.into_iter().next();
        let endpoint = endpoint.ok_or("the router of the simulated robot has no address")?;
        let namespace = namespace.to_owned();
        Ok((RobotNode { session, wire, namespace, interfaces }, endpoint.to_string()))
    }

    /// Closes the router, and waits until its endpoint is free.
    pub async fn close(&self) {
        // An error means that the session is closed already.
        drop(self.session.close().await);
    }

    fn key(&self, name: &str, type_name: &str) -> String {
        let full_name = match self.namespace.as_str() {
            "" => name.to_owned(),
            namespace => format!("{namespace}/{name}"),
        };
        match self.wire {
            RobotWire::Ros2Dds => full_name,
            RobotWire::RmwZenoh(domain) => {
                let dds = dds_name(type_name).expect("invariant: names of types are full");
                let hash = self.interfaces.type_hash(type_name);
                let hash = hash.expect("invariant: the types of a simulated robot are known");
                format!("{domain}/{full_name}/{dds}/{hash}")
            }
        }
    }

    /// Serves a service.
    ///
    /// # Errors
    ///
    /// Returns an error if Zenoh does not declare it.
    pub async fn service(&self, name: &str, type_name: &str) -> zenoh::Result<Service> {
        let (sender, requests) = mpsc::channel(REQUESTS_MAX);
        let queryable = self
            .session
            .declare_queryable(self.key(name, type_name))
            .callback(move |query| drop(sender.try_send(query)))
            .await?;
        Ok(Service { requests, _queryable: queryable })
    }

    /// Calls `received` with each message of a topic that can be read.
    pub(crate) async fn subscribe(
        &self,
        name: &str,
        type_name: &'static str,
        received: impl Fn(Value) + Send + Sync + 'static,
    ) -> zenoh::Result<zenoh::pubsub::Subscriber<()>> {
        let interfaces = self.interfaces.clone();
        let key = self.key(name, type_name);
        let subscriber = self.session.declare_subscriber(key).callback(move |sample| {
            if let Ok(message) = interfaces.decode(type_name, &sample.payload().to_bytes()) {
                received(message.value);
            }
        });
        subscriber.await
    }

    /// Publishes a message on a topic.
    ///
    /// # Panics
    ///
    /// Panics if the message does not have its type.
    pub async fn publish(&self, name: &str, type_name: &str, message: &Value) {
        let payload = self.interfaces.encode(type_name, message);
        let payload = payload.expect("invariant: the simulated robot fills its messages correctly");
        self.publish_bytes(name, type_name, payload).await;
    }

    /// Publishes any bytes on a topic.
    pub async fn publish_bytes(&self, name: &str, type_name: &str, payload: Vec<u8>) {
        let put = self.session.put(self.key(name, type_name), payload);
        // A closed session has no subscribers, so its error does not matter.
        drop(match self.wire {
            RobotWire::Ros2Dds => put.await,
            RobotWire::RmwZenoh(_) => put.attachment(attachment()).await,
        });
    }

    /// Returns the request in a call. Returns `None` if it cannot be read; a real node ignores such
    /// a call.
    pub fn request(&self, query: &Query, type_name: &str) -> Option<Value> {
        let payload = query.payload()?.to_bytes();
        if matches!(self.wire, RobotWire::RmwZenoh(_)) {
            // `rmw_zenoh` drops requests without an attachment of this form.
            query.attachment().filter(|attachment| attachment.len() == 33)?;
        }
        let decoded = self.interfaces.decode(&format!("{type_name}_Request"), &payload).ok()?;
        decoded.is_complete().then_some(decoded.value)
    }

    /// Answers a call.
    ///
    /// # Panics
    ///
    /// Panics if the response does not have its type.
    pub async fn reply(&self, query: &Query, name: &str, type_name: &str, response: &Value) {
        let payload = self.interfaces.encode(&format!("{type_name}_Response"), response);
        let payload = payload.expect("invariant: the simulated robot fills its messages correctly");
        self.reply_bytes(query, name, type_name, payload).await;
    }

    /// Answers a call with any bytes.
    pub async fn reply_bytes(&self, query: &Query, name: &str, type_name: &str, payload: Vec<u8>) {
        let reply = query.reply(self.key(name, type_name), payload);
        // The caller may be gone.
        drop(match query.attachment() {
            Some(attachment) => reply.attachment(attachment.clone()).await,
            None => reply.await,
        });
    }
}

fn attachment() -> ZBytes {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let mut bytes = Vec::new();
    bytes.extend(1_i64.to_le_bytes());
    bytes.extend(i64::try_from(now.as_nanos()).unwrap_or(i64::MAX).to_le_bytes());
    bytes.push(16);
    bytes.extend(GID);
    bytes.into()
}

// === impl Service ===

impl Service {
    /// Waits for the next call of the service, and returns it; `None` if there will be none.
    pub async fn next(&mut self) -> Option<Query> {
        self.requests.recv().await
    }
}
