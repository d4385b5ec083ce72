//! A stand-in for a Chromecast: it fetches the media that it is asked to show, and says what it
//! shows, as the media receiver of a real one does. It is a server of its own, which shares no code
//! with the client; `cast_pychromecast.py` holds it against another client.
//!
//! Tests of several crates include this file.

#![allow(dead_code, reason = "each test file uses its part")]

#[path = "cast_wire.rs"]
mod wire;

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rcgen::{CertificateParams, KeyPair};
use rustls::ServerConfig;
use rustls::pki_types::PrivateKeyDer;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;
use tokio_rustls::TlsAcceptor;
use wire::Frame;

const CONNECTION: &str = "urn:x-cast:com.google.cast.tp.connection";
const HEARTBEAT: &str = "urn:x-cast:com.google.cast.tp.heartbeat";
const RECEIVER: &str = "urn:x-cast:com.google.cast.receiver";
const MEDIA: &str = "urn:x-cast:com.google.cast.media";

/// Interval at which the device asks its clients whether they are there.
const PING: Duration = Duration::from_secs(5);

/// What the device does, and what it has seen.
#[derive(Debug, Default)]
pub(crate) struct DeviceState {
    /// Name and identifier of the app that runs.
    app: Option<(&'static str, &'static str)>,
    launches: u32,
    medium: Option<Medium>,
    last_medium: i64,
    pub(crate) volume: f64,
    /// Whether the television shows the device, and whether it is in standby; if it says so.
    television: Option<(bool, bool)>,
    /// Whether it refuses to start an app.
    pub(crate) refuses_launch: bool,
    /// Whether it says nothing at all.
    pub(crate) is_silent: bool,
    /// Types of the messages that it has received, without the heartbeat.
    pub(crate) received: Vec<String>,
}

#[derive(Clone, Debug)]
struct Medium {
    session: i64,
    address: String,
    content_type: String,
    state: &'static str,
    reason: Option<&'static str>,
}

#[derive(Clone)]
enum Push {
    /// A message to one connection, or to all.
    Message(Option<u64>, Frame),
    Raw(Vec<u8>),
    HangUp,
}

/// A running stand-in. It ends with the runtime of the test.
#[derive(Clone)]
pub(crate) struct CastDevice {
    pub(crate) address: SocketAddr,
    state: Arc<Mutex<DeviceState>>,
    pushes: broadcast::Sender<Push>,
}

impl CastDevice {
    /// Starts a device that shows nothing, on a port that the kernel chooses.
    pub(crate) async fn start() -> CastDevice {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let state = DeviceState { volume: 1.0, ..DeviceState::default() };
        let (pushes, _) = broadcast::channel(256);
        let device = CastDevice { address, state: Arc::new(Mutex::new(state)), pushes };
        let (serving, acceptor) = (device.clone(), acceptor());
        tokio::spawn(async move {
            let mut number = 0;
            while let Ok((stream, _)) = listener.accept().await {
                number += 1;
                let (serving, acceptor) = (serving.clone(), acceptor.clone());
                tokio::spawn(async move { serving.serve(stream, acceptor, number).await });
            }
        });
        device
    }

    /// Returns what the device does, to look at it and to change it.
    pub(crate) fn state(&self) -> MutexGuard<'_, DeviceState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the address of the medium that is shown; `None` if none is.
    pub(crate) fn shows(&self) -> Option<String> {
        let state = self.state();
        let medium = state.medium.as_ref().filter(|medium| medium.state == "PLAYING")?;
        Some(medium.address.clone())
    }

    /// Returns the name of the app that runs.
    pub(crate) fn app(&self) -> Option<&'static str> {
        self.state().app.map(|(name, _)| name)
    }

    /// Returns how often a message of this type was received.
    pub(crate) fn count(&self, kind: &str) -> usize {
        self.state().received.iter().filter(|received| *received == kind).count()
    }

    /// Another sender has the device show an app; `None` closes the app that runs.
    pub(crate) fn change_app(&self, app: Option<&'static str>) {
        self.run_app(app.map(|name| (name, "233637DE")));
    }

    fn run_app(&self, app: Option<(&'static str, &'static str)>) {
        let mut state = self.state();
        let left = state.transport();
        let was_running = state.app.is_some();
        state.app = app;
        state.launches += 1;
        state.medium = None;
        let status = state.receiver_status(0);
        drop(state);
        self.push(None, "receiver-0", "*", RECEIVER, status);
        if was_running {
            self.push(None, &left, "*", CONNECTION, json!({ "type": "CLOSE" }));
        }
    }

    /// The medium ends, for a reason of the protocol.
    pub(crate) fn end_medium(&self, reason: &'static str) {
        let mut state = self.state();
        let medium = state.medium.as_mut().expect("a medium");
        (medium.state, medium.reason) = ("IDLE", Some(reason));
        let status = state.media_status(0);
        // The device forgets the medium after it has said so.
        state.medium = None;
        let from = state.transport();
        drop(state);
        self.push(None, &from, "*", MEDIA, status);
    }

    /// The television changes its input or its standby, and the device says so.
    pub(crate) fn set_television(&self, shows_device: bool, is_standby: bool) {
        let mut state = self.state();
        state.television = Some((shows_device, is_standby));
        let status = state.receiver_status(0);
        drop(state);
        self.push(None, "receiver-0", "*", RECEIVER, status);
    }

    /// All connections are closed.
    pub(crate) fn hang_up(&self) {
        let _ = self.pushes.send(Push::HangUp);
    }

    /// Bytes are sent to all connections as they are.
    pub(crate) fn send_raw(&self, bytes: &[u8]) {
        let _ = self.pushes.send(Push::Raw(bytes.to_vec()));
    }

    fn push(&self, only: Option<u64>, from: &str, to: &str, namespace: &str, payload: Value) {
        // A device without a client pushes to nobody.
        let _ = self.pushes.send(Push::Message(only, Frame::new(from, to, namespace, &payload)));
    }

    async fn serve(&self, stream: TcpStream, acceptor: TlsAcceptor, number: u64) -> Option<()> {
        let mut stream = acceptor.accept(stream).await.ok()?;
        let mut pushes = self.pushes.subscribe();
        let (mut received, mut connected) = (Vec::new(), BTreeSet::new());
        let mut ping = tokio::time::interval(PING);
        loop {
            while let Some(frame) = Frame::take(&mut received) {
                if self.state().is_silent {
                    continue;
                }
                if let Some(answer) = self.answer(&frame, &mut connected, number) {
                    stream.write_all(&answer.bytes()).await.ok()?;
                }
            }
            stream.flush().await.ok()?;
            tokio::select! {
                count = stream.read_buf(&mut received) => {
                    if count.ok()? == 0 {
                        return None;
                    }
                }
                push = pushes.recv() => match push.ok()? {
                    Push::HangUp => return None,
                    Push::Raw(bytes) => stream.write_all(&bytes).await.ok()?,
                    Push::Message(only, _) if only.is_some_and(|only| only != number) => (),
                    Push::Message(_, frame) => stream.write_all(&frame.bytes()).await.ok()?,
                },
                _ = ping.tick() => {
                    if !self.state().is_silent {
                        let ping = json!({ "type": "PING" });
                        let ping = Frame::new("receiver-0", "*", HEARTBEAT, &ping);
                        stream.write_all(&ping.bytes()).await.ok()?;
                    }
                }
            }
        }
    }

    fn answer(
        &self,
        frame: &Frame,
        connected: &mut BTreeSet<String>,
        number: u64,
    ) -> Option<Frame> {
        let payload: Value = serde_json::from_str(&frame.text).expect("a client sends JSON");
        let kind = payload["type"].as_str().unwrap_or_default();
        let reply = |payload| Some(Frame::new(&frame.to, &frame.from, &frame.namespace, &payload));
        if frame.namespace == HEARTBEAT {
            return (kind == "PING").then(|| reply(json!({ "type": "PONG" })))?;
        }
        self.state().received.push(kind.to_owned());
        if frame.namespace == CONNECTION {
            match kind {
                "CONNECT" => connected.insert(frame.to.clone()),
                _ => connected.remove(&frame.to),
            };
            return None;
        }
        let is_known = frame.to == "receiver-0" || frame.to == self.state().transport();
        if !is_known || !connected.contains(&frame.to) {
            let close = json!({ "type": "CLOSE" });
            return Some(Frame::new(&frame.to, &frame.from, CONNECTION, &close));
        }
        let id = payload["requestId"].as_i64().expect("a request has a number");
        match (frame.namespace.as_str(), kind) {
            (RECEIVER, "GET_STATUS") => reply(self.state().receiver_status(id)),
            (RECEIVER, "LAUNCH") => reply(self.launch(&payload, id)),
            (RECEIVER, "STOP") => reply(self.stop(&payload, id)),
            (RECEIVER, "SET_VOLUME") => {
                let mut state = self.state();
                state.volume = payload["volume"]["level"].as_f64().unwrap_or(state.volume);
                reply(state.receiver_status(id))
            }
            (MEDIA, "GET_STATUS") => reply(self.state().media_status(id)),
            (MEDIA, "LOAD") => {
                self.load(&payload, frame, number, id);
                None
            }
            _ => reply(json!({ "type": "INVALID_REQUEST", "requestId": id, "reason": "INVALID" })),
        }
    }

    fn launch(&self, payload: &Value, id: i64) -> Value {
        if self.state().refuses_launch || payload["appId"] != "CC1AD845" {
            return json!({ "type": "LAUNCH_ERROR", "requestId": id, "reason": "NOT_FOUND" });
        }
        self.run_app(Some(("Default Media Receiver", "CC1AD845")));
        self.state().receiver_status(id)
    }

    fn stop(&self, payload: &Value, id: i64) -> Value {
        let session = self.state().session();
        if payload["sessionId"] != session {
            let reason = "INVALID_SESSION_ID";
            return json!({ "type": "INVALID_REQUEST", "requestId": id, "reason": reason });
        }
        self.run_app(None);
        self.state().receiver_status(id)
    }

    /// Begins to load a medium; the answer follows when it was fetched.
    fn load(&self, payload: &Value, frame: &Frame, number: u64, id: i64) {
        let media = &payload["media"];
        let text = |key: &str| media[key].as_str().unwrap_or_default().to_owned();
        let (address, content_type) = (text("contentId"), text("contentType"));
        let mut state = self.state();
        let next = state.last_medium + 1;
        if let Some(before) = &mut state.medium {
            (before.state, before.reason) = ("IDLE", Some("INTERRUPTED"));
            let mut status = state.media_status(0);
            status["status"][0]["extendedStatus"] = json!({
                "playerState": "LOADING", "mediaSessionId": next,
                "media": { "contentId": address, "contentType": content_type },
            });
            self.push(None, &frame.to, "*", MEDIA, status);
        }
        state.last_medium = next;
        state.medium = Some(Medium {
            session: next,
            address: address.clone(),
            content_type,
            state: "IDLE",
            reason: None,
        });
        drop(state);
        let (device, from, to) = (self.clone(), frame.to.clone(), frame.from.clone());
        tokio::spawn(async move {
            let is_fetched = fetch(&address).await.is_some();
            let mut state = device.state();
            let Some(medium) = state.medium.as_mut().filter(|medium| medium.session == next) else {
                return;
            };
            if is_fetched {
                medium.state = "PLAYING";
                let status = state.media_status(id);
                drop(state);
                return device.push(Some(number), &from, &to, MEDIA, status);
            }
            drop(state);
            let code = json!({ "type": "LOAD_FAILED", "requestId": id, "detailedErrorCode": 905 });
            device.push(Some(number), &from, &to, MEDIA, code);
            device.end_medium("ERROR");
        });
    }
}

impl DeviceState {
    fn session(&self) -> String {
        format!("session-{}", self.launches)
    }

    fn transport(&self) -> String {
        format!("web-{}", self.launches)
    }

    fn receiver_status(&self, id: i64) -> Value {
        let mut status = json!({
            "volume": { "level": self.volume, "muted": false, "controlType": "attenuation",
                "stepInterval": 0.05 },
            "userEq": {},
        });
        if let Some((name, app)) = self.app {
            status["applications"] = json!([{
                "appId": app, "displayName": name, "statusText": name, "iconUrl": "",
                "isIdleScreen": false, "launchedFromCloud": false, "appType": "WEB",
                "namespaces": [{ "name": MEDIA }, { "name": CONNECTION }],
                "sessionId": self.session(), "transportId": self.transport(),
            }]);
        }
        if let Some((shows_device, is_standby)) = self.television {
            status["isActiveInput"] = json!(shows_device);
            status["isStandBy"] = json!(is_standby);
        }
        json!({ "type": "RECEIVER_STATUS", "requestId": id, "status": status })
    }

    fn media_status(&self, id: i64) -> Value {
        let status = self.medium.iter().map(|medium| {
            let Medium { session, address, content_type, state, reason } = medium;
            let mut status = json!({
                "mediaSessionId": session, "playbackRate": 1, "playerState": state,
                "currentTime": 0, "supportedMediaCommands": 12_303,
                "volume": { "level": 1, "muted": false },
                "media": { "contentId": address, "contentType": content_type,
                    "streamType": "BUFFERED", "metadata": {}, "duration": 60.0 },
            });
            if let Some(reason) = reason {
                status["idleReason"] = json!(reason);
            }
            status
        });
        let status: Vec<_> = status.collect();
        json!({ "type": "MEDIA_STATUS", "requestId": id, "status": status })
    }
}

/// Fetches an address over HTTP, as the device does before it shows a medium.
async fn fetch(address: &str) -> Option<()> {
    let (host, path) = address.strip_prefix("http://")?.split_once('/')?;
    let mut stream = TcpStream::connect(host).await.ok()?;
    let request = format!("GET /{path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.ok()?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.ok()?;
    answer.starts_with(b"HTTP/1.1 200").then_some(())
}

/// Returns the TLS of the device, with a certificate of its own that names nobody.
fn acceptor() -> TlsAcceptor {
    let key = KeyPair::generate().expect("a key");
    let params = CertificateParams::new(vec!["6c1f".to_owned()]).expect("a name");
    let certificate = params.self_signed(&key).expect("signed");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let settings = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("versions")
        .with_no_client_auth()
        .with_single_cert(
            vec![certificate.der().clone()],
            PrivateKeyDer::try_from(key.serialize_der()).expect("a key"),
        );
    TlsAcceptor::from(Arc::new(settings.expect("settings")))
}

/// Serves media at a port of this machine, and returns its address: `/film.mp4` and `/picture.png`
/// are there, and nothing else.
pub(crate) async fn media_server() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = format!("http://{}", listener.local_addr().expect("an address"));
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            let mut request = vec![0; 4096];
            let Ok(count) = stream.read(&mut request).await else { continue };
            let request = String::from_utf8_lossy(&request[..count]).into_owned();
            let is_there =
                ["/film.mp4 ", "/picture.png "].iter().any(|path| request.contains(path));
            let status = if is_there { "200 OK" } else { "404 Not Found" };
            let head =
                format!("HTTP/1.1 {status}\r\nContent-Length: 1\r\nConnection: close\r\n\r\n");
            let _ = stream.write_all(format!("{head}x").as_bytes()).await;
        }
    });
    address
}
