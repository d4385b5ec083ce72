//! Settings of a Zenoh session. The fields of [`Config`] override the `[zenoh]` table of the
//! ecosystem file, that table overrides the defaults of this module, and these override Zenoh's
//! defaults.
//!
//! The three layers of settings are merged as JSON, and Zenoh parses the result once as a whole:
//! some of its sections are accepted as whole objects only.

use std::net::SocketAddr;
use std::time::Duration;

use acl::{DaemonId, EcosystemId};
use serde_json::{Value, json};
use zenoh::qos::Priority;

use crate::endpoint::{self, EndpointError};
use crate::json_merge::merge;
use crate::key_expr::KeySpace;
use crate::open_error::OpenError;
use crate::own_address;
use crate::scouting;
use crate::sealing::Security;

/// How long a silent daemon counts as alive. A killed process is detected in milliseconds in any
/// case; the lease matters if a machine freezes or a cable is pulled. The lease is four keep-alive
/// periods, of which a loaded board may miss three. With less than 2 s, such boards are declared
/// dead while they run.
pub const LEASE: Duration = Duration::from_secs(4);

/// Priority of all messages. A single priority keeps the messages of one conversation in order.
pub(crate) const MESSAGE_PRIORITY: Priority = Priority::DataHigh;

/// Maximum length of a received message, in bytes; a longer one is dropped. A building's composite
/// domain is far below 1 MiB. The limit keeps one sender from filling the memory of a small board
/// (Zenoh's own limit is 1 GiB).
pub const MESSAGE_BYTES_MAX: usize = 16 << 20;

/// Number of keep-alive messages that a session sends per lease.
const KEEP_ALIVES: u32 = 4;

/// Maximum number of outgoing batches that wait per priority and link (64 KiB each, allocated when
/// used). This is the largest number that Zenoh allows. Messages that do not fit are dropped,
/// because a sender never waits.
const BATCHES_MAX: u32 = 16;

/// How long a sender waits for a free batch before its message is dropped, in microseconds. With
/// this wait, a burst is not lost if a receiver is busy for a moment (Zenoh's own wait of 1 ms was
/// too short for fifty messages here). Once a link is congested, all messages that follow are
/// dropped at once: a link that stands still costs a Tokio worker this wait once, not once per
/// message.
const WAIT_BEFORE_DROP_US: u32 = 50_000;

/// How long a link may take to open, in milliseconds. This is Zenoh's own limit; `CLIENT_OPEN_MS`
/// is the limit for guests (short-lived sessions). If the daemon at the first address hangs, the
/// guest's command waits this long before it tries the next address.
const OPEN_MS: u32 = 10_000;
const CLIENT_OPEN_MS: u32 = 5_000;

/// First pause between attempts to connect, in milliseconds; `RECONNECT_LAST_MS` is the longest
/// pause. Daemons of one building start together, so the first attempt often comes before the other
/// daemon listens.
const RECONNECT_FIRST_MS: u32 = 250;
const RECONNECT_LAST_MS: u32 = 4_000;
const _: () = assert!(RECONNECT_FIRST_MS < RECONNECT_LAST_MS);

/// How long a Zenoh router takes to compute its routes anew, in milliseconds (its
/// `TREES_COMPUTATION_DELAY_MS`). If a router leaves and another comes within this time, the new
/// one can get the index of the old one in the graph, and then does not receive the existing
/// declarations. So reconnections are tried later than that.
const ROUTES_MS: u32 = 100;
const _: () = assert!(RECONNECT_FIRST_MS > 2 * ROUTES_MS);

/// How long a daemon that has left should wait before it opens a session again, so that the other
/// routers have computed their routes anew.
pub const REOPEN_DELAY: Duration = Duration::from_millis(250);
const _: () = assert!(REOPEN_DELAY.as_millis() > 2 * ROUTES_MS as u128);

/// Settings of a Zenoh session. They are plain data: cloning them opens nothing.
#[derive(Clone, Debug)]
pub struct Config {
    /// Name of the ecosystem, which is the root of all key expressions.
    pub ecosystem: EcosystemId,
    /// The name of this daemon.
    pub daemon: DaemonId,
    /// Zenoh id of the session: up to 16 bytes in lower-case hexadecimal, without leading zeros.
    /// With `None`, Zenoh chooses one; store [`ZenohSubstrate::zid`](crate::ZenohSubstrate::zid) so
    /// that others recognise this daemon later.
    pub zid: Option<String>,
    /// How the session takes part in the mesh: as a router or as a client.
    pub mode: SessionMode,
    /// Endpoints on which this daemon listens, so that others reach it, like `tls/[::]:7447` or
    /// `unixsock-stream/PATH`.
    pub listen: Vec<String>,
    /// Endpoints to which this daemon connects, again whenever the connection is lost.
    pub connect: Vec<String>,
    /// How long a silent daemon counts as alive; should be [`LEASE`], or longer if the network is
    /// bad.
    pub lease: Duration,
    /// Keys for a secured ecosystem, in which links are TLS with certificates on both sides, and
    /// every message is signed. `None` if the ecosystem is not secured.
    pub security: Option<Security>,
    /// Zenoh's own settings, in the form that Zenoh documents. They override all defaults, but not
    /// the fields above. The endpoints in `listen.endpoints` and `connect.endpoints` are added to
    /// those of the fields, and `scouting` may also be just `true` or `false`.
    pub zenoh: Value,
}

/// How a session takes part in the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SessionMode {
    /// The session relays messages for others. Every daemon is a router, because Zenoh's peers do
    /// not relay since 1.9.
    #[default]
    Router,
    /// The session connects to one router and relays nothing: for a command line, or a plugin in
    /// its own process.
    Client,
}

/// The settings of a session after they were checked and merged.
#[derive(Debug)]
pub(crate) struct SessionSettings {
    pub(crate) zenoh: zenoh::Config,
    /// All endpoints to connect to, in the JSON shape in which the settings give them.
    connect_as_written: Value,
    pub(crate) listen: Vec<String>,
    pub(crate) connect: Vec<String>,
    /// Multicast address at which the session scouts, which means that it searches for other
    /// daemons; `None` if it does not scout.
    pub(crate) scouts_at: Option<String>,
    /// How long a silent daemon counts as alive: from the `[zenoh]` table if it is set there,
    /// otherwise from the field of [`Config`].
    pub(crate) lease: Duration,
    pub(crate) security: Option<Security>,
    pub(crate) mode: SessionMode,
}

// === impl SessionSettings ===

impl SessionSettings {
    /// Removes the endpoints to connect to at which this daemon listens itself: one ecosystem file
    /// for all machines names every daemon.
    pub(crate) async fn without_self(mut self) -> SessionSettings {
        let own = own_address::own(&self.listen, &self.connect).await;
        if own.is_empty() {
            return self;
        }
        tracing::debug!(?own, "leaves out its own endpoints");
        own_address::without(&mut self.connect_as_written, &own);
        self.connect.retain(|endpoint| !own.contains(endpoint));
        let others = self.connect_as_written.to_string();
        if let Err(error) = self.zenoh.insert_json5("connect/endpoints", &others) {
            // Zenoh then closes the link to itself.
            tracing::debug!(%error, "the daemon's own endpoints are not left out");
        }
        self
    }
}

// === impl Config ===

impl Config {
    /// Returns the settings of a router that does not listen and does not connect.
    pub fn new(ecosystem: EcosystemId, daemon: DaemonId) -> Config {
        Config {
            ecosystem,
            daemon,
            zid: None,
            mode: SessionMode::Router,
            listen: Vec::new(),
            connect: Vec::new(),
            lease: LEASE,
            security: None,
            zenoh: Value::Null,
        }
    }

    /// Whether the session will scout, which means that it searches for other daemons by multicast;
    /// `false` if the settings are invalid.
    pub fn scouts(&self) -> bool {
        self.settings().is_ok_and(|settings| settings.scouts_at.is_some())
    }

    pub(crate) fn settings(&self) -> Result<SessionSettings, OpenError> {
        let mut merged = self.defaults();
        if self.security.is_some() {
            // Host names are not verified: addresses change, and daemons that find each other by
            // scouting have only addresses. The peer must have a certificate of the ecosystem's
            // authority, and the origin of a message follows from its signature. The file may
            // require more.
            let tls = json!({ "tls": { "verify_name_on_connect": false } });
            merge(&mut merged, &json!({ "transport": { "link": tls } }));
            let keys = KeySpace::new(&self.ecosystem, self.daemon.clone());
            merged["access_control"] = access_control(keys.everything().as_str());
        }
        let mut said = match &self.zenoh {
            Value::Null => json!({}),
            Value::Object(raw) if raw.contains_key("mode") => {
                return Err(OpenError::ModeInSettings);
            }
            Value::Object(_) => self.zenoh.clone(),
            _ => return Err(OpenError::NotATable),
        };
        if said.get("access_control").is_some() {
            // A file that sets `access_control` sets all of it: a mixture of both would fit neither
            // purpose.
            merged["access_control"] = Value::Null;
        }
        let mut listen = self.listen.clone();
        if self.mode == SessionMode::Router {
            let told = [&listen[..], &endpoints(&said["listen"]["endpoints"])].concat();
            let secured = self.security.is_some();
            listen.extend(scouting::complete_settings(&self.ecosystem, secured, &told, &mut said)?);
        }
        merge(&mut merged, &said);
        if let Some(zid) = &self.zid {
            merged["id"] = json!(zid);
        }
        add_endpoints(&mut merged["listen"]["endpoints"], &listen);
        add_endpoints(&mut merged["connect"]["endpoints"], &self.connect);
        let listen = endpoints(&merged["listen"]["endpoints"]);
        let connect = endpoints(&merged["connect"]["endpoints"]);
        if let Some(security) = &self.security {
            listen.iter().chain(&connect).try_for_each(|each| endpoint::check_secured(each))?;
            // Merged after the file's settings, so that the file cannot weaken these settings by
            // accident.
            merge(&mut merged, &secured(security));
        }
        listen.iter().try_for_each(|each| endpoint::check_listen(each))?;
        connect.iter().try_for_each(|each| endpoint::check_connect(each))?;
        if self.mode == SessionMode::Client && connect.is_empty() && !scouts(&merged) {
            return Err(OpenError::NowhereToConnect);
        }
        let zenoh = read(&merged)
            .map_err(|source| OpenError::Settings { at: culprit(&merged).join("."), source })?;
        let scouts_at =
            scouts(&merged).then(|| merged["scouting"]["multicast"]["address"].to_string());
        Ok(SessionSettings {
            zenoh,
            connect_as_written: merged["connect"]["endpoints"].clone(),
            listen,
            connect,
            scouts_at,
            lease: lease(&merged).unwrap_or(self.lease),
            security: self.security.clone(),
            mode: self.mode,
        })
    }

    /// Returns the settings with which Althing differs from Zenoh's defaults, with the reasons.
    fn defaults(&self) -> Value {
        let mode = match self.mode {
            SessionMode::Router => "router",
            SessionMode::Client => "client",
        };
        let open_timeout_ms = match self.mode {
            SessionMode::Router => OPEN_MS,
            SessionMode::Client => CLIENT_OPEN_MS,
        };
        json!({
            "mode": mode,
            // Without this a router would listen in plain text on every interface.
            "listen": { "endpoints": [] },
            "connect": {
                "endpoints": [],
                "retry": {
                    "period_init_ms": RECONNECT_FIRST_MS,
                    "period_max_ms": RECONNECT_LAST_MS,
                    "period_increase_factor": 2,
                },
            },
            // Scouting is off, so that two ecosystems on one network never merge by accident. A
            // router sleeps `delay` before it opens, whether or not it scouts.
            "scouting": {
                "delay": 0,
                "multicast": { "enabled": false },
                "gossip": { "enabled": false },
            },
            // Zenoh refuses timestamps of clocks that run ahead; boards without a battery have such
            // clocks.
            "timestamping": { "enabled": false },
            "adminspace": { "permissions": { "read": true, "write": false } },
            "transport": { "unicast": { "open_timeout": open_timeout_ms }, "link": {
                "tx": {
                    "lease": u64::try_from(self.lease.as_millis()).unwrap_or(u64::MAX),
                    "keep_alive": KEEP_ALIVES,
                    // Bids, plans and messages go at `data_high`, models at `data_low`.
                    "queue": {
                        "size": { "data_high": BATCHES_MAX, "data_low": BATCHES_MAX },
                        "congestion_control": {
                            "drop": { "wait_before_drop": WAIT_BEFORE_DROP_US },
                        },
                    },
                },
                "rx": { "max_message_size": MESSAGE_BYTES_MAX },
            } },
        })
    }
}

/// A setting in the `[zenoh]` table with which no session could be opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SettingProblem {
    /// Path of the setting, such as `connect.endpoints.0`; empty for the whole table.
    pub at: String,
    /// Description of the problem. The text completes “failed to …”.
    pub message: String,
}

/// Returns all problems of a `[zenoh]` table, without opening anything.
pub fn problems(ecosystem: &EcosystemId, zenoh: &Value, is_secured: bool) -> Vec<SettingProblem> {
    let problem = |at: &str, message: String| SettingProblem { at: at.to_owned(), message };
    let table = match zenoh {
        Value::Null => return Vec::new(),
        Value::Object(table) => table,
        _ => return vec![problem("", OpenError::NotATable.to_string())],
    };
    if table.contains_key("mode") {
        return vec![problem("mode", OpenError::ModeInSettings.to_string())];
    }
    let mut found = Vec::new();
    for (side, check) in [
        ("listen", endpoint::check_listen as fn(&str) -> Result<(), EndpointError>),
        ("connect", endpoint::check_connect),
    ] {
        let at = format!("{side}.endpoints");
        for (path, each) in located_endpoints(&zenoh[side]["endpoints"], &at) {
            let secured = if is_secured { endpoint::check_secured(&each) } else { Ok(()) };
            if let Err(error) = secured.and_then(|()| check(&each)) {
                found.push(problem(&path, error.to_string()));
            }
        }
    }
    let mut said = zenoh.clone();
    let told = endpoints(&said["listen"]["endpoints"]);
    if let Err(error) = scouting::complete_settings(ecosystem, is_secured, &told, &mut said) {
        found.push(problem("scouting", error.to_string()));
    }
    for side in ["listen", "connect"] {
        // Problems of endpoints have been found above.
        if let Some(table) = said.get_mut(side).and_then(Value::as_object_mut) {
            table.remove("endpoints");
        }
    }
    if let Err(source) = read(&said) {
        let path = culprit(&said);
        let at = path.join(".");
        let mut message = OpenError::Settings { at: at.clone(), source }.to_string();
        let meant = path.last().and_then(|key| split_setting(key));
        if let Some(meant) = meant.or_else(|| in_other_number(&path)) {
            message += &format!("; did you mean `{meant}`?");
        }
        found.push(problem(&at, message));
    }
    found
}

/// Returns the setting whose name is the plural or the singular of that of an unknown one.
fn in_other_number(path: &[String]) -> Option<String> {
    let (key, tables) = path.split_last()?;
    let other = key.strip_suffix('s').map_or_else(|| format!("{key}s"), str::to_owned);
    let nested = |value: Value| {
        tables.iter().rev().fold(
            json!({ other.as_str(): value }),
            |within, table| json!({ table.as_str(): within }),
        )
    };
    let values = [json!([]), json!(true), json!(1), json!("")];
    let is_known = values.into_iter().any(|value| read(&nested(value)).is_ok());
    is_known
        .then(|| tables.iter().chain([&other]).map(String::as_str).collect::<Vec<_>>().join("."))
}

/// Returns the nested setting that is probably meant by a flat one: `listen.endpoints` for
/// `listen_endpoints`; `None` if Zenoh has no such setting.
fn split_setting(key: &str) -> Option<String> {
    let (table, setting) = key.split_once(['_', '-'])?;
    let probe = json!({ table: { setting: [] } });
    read(&probe).is_ok().then(|| format!("{table}.{setting}"))
}

/// Returns the endpoints in a setting that may have any of the shapes that Zenoh allows: the path
/// of each, and the endpoint.
fn located_endpoints(value: &Value, path: &str) -> Vec<(String, String)> {
    match value {
        Value::String(endpoint) => vec![(path.to_owned(), endpoint.clone())],
        Value::Array(list) => {
            let each = list.iter().enumerate();
            each.flat_map(|(at, value)| located_endpoints(value, &format!("{path}.{at}"))).collect()
        }
        Value::Object(table) => {
            let lists = table.iter().filter(|(key, _)| *key != "strategy");
            lists
                .flat_map(|(key, list)| located_endpoints(list, &format!("{path}.{key}")))
                .collect()
        }
        _ => Vec::new(),
    }
}

/// Returns the addresses of the endpoints at which Zenoh listens, each with its path in the `[zenoh]`
/// table. Endpoints with a host name, and sockets of the file system, are left out.
pub fn listen_addresses(zenoh: &Value) -> Vec<(String, SocketAddr)> {
    let endpoints = located_endpoints(&zenoh["listen"]["endpoints"], "listen.endpoints");
    let address = |(path, endpoint): (String, String)| {
        let (host, port) = endpoint::host_and_port(&endpoint)?;
        Some((path, SocketAddr::new(host.parse().ok()?, port)))
    };
    endpoints.into_iter().filter_map(address).collect()
}

/// Returns the endpoints to which messages leave this machine as plain text, each with its path in
/// the `[zenoh]` table.
pub fn plain_connections(zenoh: &Value) -> Vec<(String, String)> {
    let mut endpoints = located_endpoints(&zenoh["connect"]["endpoints"], "connect.endpoints");
    endpoints.retain(|(_, each)| endpoint::is_plain_text(each) && endpoint::leaves_machine(each));
    endpoints
}

/// Returns how long a silent daemon counts as alive according to the `[zenoh]` settings; `None` if
/// they do not contain it.
pub fn lease(zenoh: &Value) -> Option<Duration> {
    let millis = zenoh.pointer("/transport/link/tx/lease").and_then(Value::as_u64);
    millis.map(Duration::from_millis)
}

/// Returns the settings for TLS with certificates of this ecosystem on both sides.
fn secured(security: &Security) -> Value {
    let (key, certificate, authority) = security.identity.files();
    json!({
        "transport": { "link": {
            "protocols": endpoint::SECURED_PROTOCOLS,
            "tls": {
                "root_ca_certificate": authority,
                "enable_mtls": true,
                "listen_private_key": key,
                "listen_certificate": certificate,
                "connect_private_key": key,
                "connect_certificate": certificate,
                "close_link_on_expiration": true,
            },
        } },
    })
}

/// Returns settings with which links carry only the keys of this ecosystem: no other keys, and no
/// queries to routers about themselves. Rights of single daemons cannot be set here: a rule for the
/// name in a link's certificate would apply to the daemon that relayed the message last. Such
/// rights are checked where messages are received.
fn access_control(everything: &str) -> Value {
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": [{
            "id": "ecosystem",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": [
                "put", "delete", "declare_subscriber",
                "query", "reply", "declare_queryable",
                "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
            ],
            "key_exprs": [everything],
        }],
        // One subject, for every link: if a link matches two, the rule that allows wins.
        "subjects": [{ "id": "links" }],
        "policies": [{ "rules": ["ecosystem"], "subjects": ["links"] }],
    })
}

/// Appends endpoints to a plain list. Zenoh also allows other shapes (per mode, with a strategy).
/// If the file uses one of these shapes, it is taken as complete, and nothing is appended.
fn add_endpoints(list: &mut Value, ours: &[String]) {
    if let Value::Array(list) = list {
        list.extend(ours.iter().map(|endpoint| json!(endpoint)));
    }
}

/// Returns the endpoints in a setting that may have any of the shapes that Zenoh allows.
fn endpoints(value: &Value) -> Vec<String> {
    match value {
        Value::String(endpoint) => vec![endpoint.clone()],
        Value::Array(list) => list.iter().flat_map(endpoints).collect(),
        Value::Object(table) => {
            let lists = table.iter().filter(|(key, _)| *key != "strategy");
            lists.flat_map(|(_, list)| endpoints(list)).collect()
        }
        _ => Vec::new(),
    }
}

fn read(settings: &Value) -> zenoh::Result<zenoh::Config> {
    zenoh::Config::from_json5(&settings.to_string())
}

/// Returns the path of the first setting that Zenoh rejects even if it is the only one. Zenoh's
/// errors do not name the setting.
fn culprit(settings: &Value) -> Vec<String> {
    let mut path: Vec<String> = Vec::new();
    let mut table = settings;
    let alone = |path: &[String], key: &str, value: &Value| {
        let inner = json!({ key: value });
        path.iter().rev().fold(inner, |inner, key| json!({ key: inner }))
    };
    while let Value::Object(children) = table {
        let bad = children.iter().find(|(key, value)| read(&alone(&path, key, value)).is_err());
        let Some((key, value)) = bad else { break };
        path.push(key.clone());
        table = value;
    }
    path
}

fn scouts(settings: &Value) -> bool {
    settings["scouting"]["multicast"]["enabled"] == json!(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(zenoh: Value) -> Config {
        let ecosystem = EcosystemId::new("office").expect("a name");
        Config { zenoh, ..Config::new(ecosystem, DaemonId::new("pi").expect("a name")) }
    }

    #[track_caller]
    fn check(zenoh: Value, key: &str, expected: &str) {
        let settings = config(zenoh).settings().expect("good settings");
        assert_eq!(settings.zenoh.get_json(key).expect("a setting"), expected);
    }

    #[test]
    fn settings_override_defaults() {
        check(Value::Null, "transport/link/tx/lease", "4000");
        check(Value::Null, "transport/link/rx/max_message_size", "16777216");
        check(Value::Null, "scouting/delay", "0");
        check(Value::Null, "listen/endpoints", "[]");
        check(Value::Null, "adminspace/permissions/write", "false");
        let lease = json!({ "transport": { "link": { "tx": { "lease": 10_000 } } } });
        check(lease.clone(), "transport/link/tx/lease", "10000");
        check(lease, "transport/link/tx/queue/size/data_high", "16");
        let south = json!({ "gateway": { "south": [] } });
        assert!(config(south).settings().is_ok(), "a section that is read only as a whole");
    }

    #[test]
    fn endpoints_of_the_file_and_of_the_caller_are_all_used() {
        let mut config = config(json!({ "connect": { "endpoints": ["tls/a:1"] } }));
        config.connect = vec!["tls/b:1".to_owned()];
        assert_eq!(config.settings().expect("good").connect, ["tls/a:1", "tls/b:1"]);
    }

    #[test]
    fn errors_state_the_remedy() {
        let plain = json!({ "listen": { "endpoints": { "router": ["tcp/[::]:7447"] } } });
        for (zenoh, expected) in [
            (plain, "listen on `tcp/[::]:7447`: plain TCP is for this machine alone"),
            (json!({ "mode": "peer" }), "read `[zenoh]`: leave out `mode`; a daemon is a router"),
            (json!("tls/a:1"), "read `[zenoh]`: write a table of Zenoh's settings"),
            (json!({ "transprt": {} }), "read `transprt` of `[zenoh]`; Zenoh's"),
            (json!({ "scouting": { "delay": "soon" } }), "read `scouting.delay` of `[zenoh]`; "),
            (json!({ "id": "not hex" }), "read `id` of `[zenoh]`; "),
        ] {
            let error = config(zenoh).settings().expect_err(expected).to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        let bad = json!({
            "listen": { "endpoints": ["tcp/127.0.0.1:7447", "tls/[::]:99999"] },
            "connect": { "endpoints": ["office-pi:7447"] },
            "transprt": {},
        });
        let ecosystem = EcosystemId::new("office").expect("a name");
        let at: Vec<_> =
            problems(&ecosystem, &bad, false).into_iter().map(|problem| problem.at).collect();
        assert_eq!(at, ["listen.endpoints.1", "connect.endpoints.0", "transprt"]);
        let good = json!({ "listen": { "endpoints": ["tls/[::]:7447"] }, "scouting": true });
        assert_eq!(problems(&ecosystem, &good, true), []);
        assert_eq!(problems(&ecosystem, &good, false).len(), 1, "plain text is not scouted with");
        let client = Config { mode: SessionMode::Client, ..config(Value::Null) };
        assert!(matches!(client.settings(), Err(OpenError::NowhereToConnect)));
    }
}
