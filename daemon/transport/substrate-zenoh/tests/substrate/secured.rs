//! Tests of a secured ecosystem: which sessions and messages are accepted, and that all others do
//! not disturb the daemons.
//!
//! All messages go over TLS on this machine's loopback interface, with certificates made for the
//! test.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use acl::{DaemonId, EcosystemId, Performative};
use bytes::Bytes;
use credentials::{
    AUTHORITY_DAYS, Authority, CredentialFolder, DAEMON_DAYS, DaemonIdentity, Nonce, SealChannel,
    Trust, Verifier,
};
use substrate::{AgentAddress, Resource, SendError, Subject, Substrate};
use substrate_zenoh::{MESSAGE_BYTES_MAX, Security, SessionMode};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use zenoh::qos::CongestionControl;
use zenoh::query::Query;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

use crate::daemon::{DEADLINE, Daemon, agent, config, ear};
use crate::overhearing::Listening;

const TLS_HERE: &str = "tls/127.0.0.1:0";

/// Rate limit per second that no test reaches.
const PLENTY: u32 = 100_000;

/// A certificate authority and the certificates of its daemons.
struct House {
    folder: CredentialFolder,
    authority: Authority,
    /// Incarnation in which each daemon was opened last: a message to the daemon is sealed for that
    /// incarnation.
    lives: Mutex<BTreeMap<String, u64>>,
    _temporary: TempDir,
}

impl House {
    fn new() -> House {
        let temporary = tempfile::tempdir().expect("a folder");
        let folder = CredentialFolder::new(temporary.path().join("keys"));
        let office = EcosystemId::new("office").expect("a name");
        let authority = Authority::create(&folder, &office, AUTHORITY_DAYS).expect("a new one");
        House { folder, authority, lives: Mutex::default(), _temporary: temporary }
    }

    fn identity(&self, name: &str) -> DaemonIdentity {
        let name = DaemonId::new(name).expect("a name");
        if !self.folder.key(&name).exists() {
            self.authority.issue(&name, &[], DAEMON_DAYS).expect("a good name");
        }
        let trust = Trust::read(&self.folder).expect("just made");
        DaemonIdentity::read(&self.folder, &name, &trust).expect("just made")
    }

    /// Makes the folder of another machine, with the certificate of one daemon and that of the
    /// authority.
    fn apart(&self, name: &str) -> House {
        drop(self.identity(name));
        let temporary = tempfile::tempdir().expect("a folder");
        let folder = CredentialFolder::new(temporary.path());
        let name = DaemonId::new(name).expect("a name");
        let files =
            [self.folder.authority(), self.folder.certificate(&name), self.folder.key(&name)];
        for file in files {
            let there = folder.path().join(file.file_name().expect("a file"));
            std::fs::copy(file, there).expect("just made");
        }
        let authority = Authority::open(&self.folder).expect("just made");
        House { folder, authority, lives: Mutex::default(), _temporary: temporary }
    }

    fn security(&self, name: &str, per_second: u32) -> Security {
        let trust = Trust::read(&self.folder).expect("just made");
        let verifier = Arc::new(Verifier::new(trust, per_second));
        let identity = Arc::new(self.identity(name));
        let incarnation = identity.sequence_state().incarnation;
        self.lives.lock().expect("no panic").insert(name.to_owned(), incarnation);
        Security { identity, verifier }
    }

    fn incarnation(&self, name: &str) -> Option<u64> {
        self.lives.lock().expect("no panic").get(name).copied()
    }

    /// Opens a daemon that listens, and connects to `others`.
    async fn open(&self, name: &'static str, others: &[&Daemon]) -> Daemon {
        self.open_with(name, others, PLENTY).await
    }

    async fn open_with(&self, name: &'static str, others: &[&Daemon], per_second: u32) -> Daemon {
        let connect = others.iter().flat_map(|other| other.substrate.locators()).collect();
        Daemon::open(name, |config| {
            config.listen = vec![TLS_HERE.to_owned()];
            config.connect = connect;
            config.security = Some(self.security(name, per_second));
        })
        .await
    }

    /// Opens a plain Zenoh session with the certificate of a daemon; it can send anything.
    async fn rogue(&self, name: &str, at: &Daemon) -> Session {
        let name = DaemonId::new(name).expect("a name");
        drop(self.identity(name.as_str()));
        let quoted = |path: std::path::PathBuf| format!("{:?}", path.display().to_string());
        let (key, own) = (quoted(self.folder.key(&name)), quoted(self.folder.certificate(&name)));
        let authority = quoted(self.folder.authority());
        raw(at, &[("connect_private_key", &key), ("connect_certificate", &own)], &authority)
            .await
            .expect("its certificate is good")
    }
}

/// Opens a plain Zenoh session, as any tool would do.
async fn raw(
    at: &Daemon,
    with: &[(&str, &String)],
    authority: &str,
) -> Result<Session, zenoh::Error> {
    let mut config = zenoh::Config::default();
    let endpoints = serde_json::to_string(&at.substrate.locators()).expect("strings");
    let tls = |key: &str| format!("transport/link/tls/{key}");
    let mut settings = vec![
        ("mode".to_owned(), "\"client\"".to_owned()),
        ("scouting/multicast/enabled".to_owned(), "false".to_owned()),
        ("connect/endpoints".to_owned(), endpoints),
        (tls("root_ca_certificate"), authority.to_owned()),
        (tls("verify_name_on_connect"), "false".to_owned()),
        (tls("enable_mtls"), (!with.is_empty()).to_string()),
    ];
    settings.extend(with.iter().map(|(key, value)| (tls(key), (*value).clone())));
    for (key, value) in settings {
        config.insert_json5(&key, &value).expect("a setting of Zenoh's");
    }
    zenoh::open(config).await
}

/// Waits until the session sees the subscription of a daemon to `key`; messages sent before that
/// are lost.
async fn reach(rogue: &Session, key: &'static str) {
    let publisher = rogue.declare_publisher(key).await.expect("open");
    let seen = async {
        while !publisher.matching_status().await.expect("open").matching() {
            tokio::time::sleep(std::time::Duration::from_millis(2)).await;
        }
    };
    tokio::time::timeout(DEADLINE, seen).await.expect("the daemon hears");
}

const TO_A: &str = "althing/office/in/a/x/inform";

#[tokio::test(flavor = "multi_thread")]
async fn daemons_with_certificates_communicate_as_without() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let mut b = house.open("b", &[&a]).await;
    let _tokens = [a.announce("x"), b.announce("y")];
    a.hear("joined y@b").await;
    b.hear("joined x@a").await;

    b.request("a", "x", "go");
    a.hear("to x request: go <b>").await;
    b.substrate.broadcast(&agent("y"), Performative::Cfp, "all".into()).expect("open");
    a.hear("all y cfp: all <b>").await;
    b.hear("all y cfp: all <b>").await;
    b.substrate.broadcast_state(&agent("y"), "works".into()).expect("open");
    a.hear("beat y: works <b>").await;
    let together = ["y", "z"].map(|who| (agent(who), format!(r#"{{"sender":"{who}"}}"#).into()));
    b.substrate.broadcast_heartbeats(together.into()).expect("open");
    a.hear(r#"beat z: {"sender":"z"} <b>"#).await;
    b.hear(r#"beat z: {"sender":"z"} <b>"#).await;
    b.request("b", "y", "itself");
    b.hear("to y request: itself <b>").await;
    assert_eq!(b.ask(None, Resource::State, None).await, ["a state -", "b state -"]);
    assert_eq!(b.ask(Some("a"), Resource::Model, Some("x")).await, ["a model x"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_relaying_daemon_is_not_the_origin() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let b = house.open("b", &[&a]).await;
    let mut c = house.open("c", &[&b]).await;
    let _tokens = [a.announce("x"), c.announce("z")];
    c.hear("joined x@a").await;
    a.hear("joined z@c").await;
    c.request("a", "x", "from afar");
    a.hear("to x request: from afar <c>").await;
    assert_eq!(c.ask(Some("a"), Resource::State, None).await, ["a state -"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_guest_signs_with_its_hosts_key() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let guest = DaemonId::new("a").expect("a name").guest("cli-7").expect("short");
    let mut security = house.security("a", PLENTY);
    security.identity = Arc::new(house.identity("a").for_guest(guest.clone()));
    let connect = a.substrate.locators();
    let mut client = Daemon::open("a--cli-7", |config| {
        config.mode = SessionMode::Client;
        config.connect = connect;
        config.security = Some(security);
    })
    .await;
    let _token = client.announce("person");
    a.hear("joined person@a--cli-7").await;
    client.request("a", "x", "please");
    a.hear("to x request: please <a--cli-7>").await;
    a.request("a--cli-7", "person", "done");
    client.hear("to person request: done <a>").await;
    assert_eq!(client.ask(Some("a"), Resource::State, None).await, ["a state -"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broadcast_of_a_new_guest_is_accepted() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let mut b = house.open("b", &[&a]).await;
    let _tokens = [a.announce("x"), b.announce("y")];
    a.hear("joined y@b").await;
    let guest = DaemonId::new("a").expect("a name").guest("cli-7").expect("short");
    let mut security = house.security("a", PLENTY);
    security.identity = Arc::new(house.identity("a").for_guest(guest.clone()));
    let connect = a.substrate.locators();
    let mut client = Daemon::open("a--cli-7", |config| {
        config.mode = SessionMode::Client;
        config.connect = connect;
        config.security = Some(security);
    })
    .await;
    client.hear_all(&["joined x@a", "joined y@b"]).await;
    let _token = client.announce("person");
    client.substrate.broadcast_ready().await;
    client.substrate.broadcast(&agent("person"), Performative::Cfp, "who?".into()).expect("open");
    a.hear("all person cfp: who? <a--cli-7>").await;
    b.hear("all person cfp: who? <a--cli-7>").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_certificate_does_not_get_in() {
    let (house, other) = (House::new(), House::new());
    let mut a = house.open("a", &[]).await;
    let authority = format!("{:?}", house.folder.authority().display().to_string());
    assert!(raw(&a, &[], &authority).await.is_err(), "without a certificate");
    a.hear("rejected refused-link -").await;

    let mut config = config("stranger");
    config.mode = SessionMode::Client;
    config.connect = a.substrate.locators();
    config.security = Some(other.security("stranger", PLENTY));
    let refused = config.open(ear("stranger").0).await;
    assert!(refused.is_err(), "with another authority's");

    // A router that trusts this authority, and that does not give up connecting, as a client would.
    let copied = std::fs::copy(house.folder.authority(), other.folder.authority());
    copied.expect("its certificate is no secret");
    let connect = a.substrate.locators();
    let mut config = self::config("router");
    config.connect = connect;
    config.zenoh = serde_json::json!({ "transport": { "link": { "tls": {
        "root_ca_certificate": house.folder.authority(),
        "verify_name_on_connect": false,
    } } } });
    let router = config.open(ear("router").0).await.expect("it listens on no endpoint");
    let _token = router.announce(&agent("intruder"), acl::Incarnation(1)).expect("open");

    let b = house.open("b", &[&a]).await;
    let _token = b.announce("y");
    let mut heard = a.hear("joined y@b").await;
    heard.retain(|line| line != "rejected refused-link -");
    assert_eq!(heard, ["joined y@b"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_connections_do_not_block_valid_ones() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let locators = a.substrate.locators();
    let address = locators[0].strip_prefix("tls/").expect("it listens there").to_owned();
    // About three hundred connections a second, none of which sends valid TLS.
    let knocking = tokio::spawn(async move {
        loop {
            if let Ok(mut stream) = TcpStream::connect(&address).await {
                let _ = stream.write_all(&[b'x'; 64]).await;
            }
            tokio::time::sleep(Duration::from_millis(3)).await;
        }
    });
    a.hear("rejected refused-link -").await;
    let began = Instant::now();
    let b = house.open("b", &[&a]).await;
    let _token = b.announce("y");
    a.hear("joined y@b").await;
    assert!(began.elapsed() < Duration::from_secs(5), "it took {:?}", began.elapsed());
    knocking.abort();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_without_a_valid_signature_is_dropped_and_reported() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let rogue = house.rogue("rogue", &a).await;
    reach(&rogue, TO_A).await;

    rogue.put(TO_A, "unsigned").await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected unsigned -"]);
    rogue.put(TO_A, "garbage").attachment([1, 2, 3]).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged -"]);
    // The message is signed with its own key, but for another payload.
    let identity = house.identity("rogue");
    let seal = identity.seal(SealChannel::Message, TO_A, b"harmless", house.incarnation("a"));
    rogue.put(TO_A, "harmful").attachment(seal).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged rogue"]);
    // The message is sent in the name of another daemon's guest.
    let guest = DaemonId::new("b").expect("a name").guest("cli-1").expect("short");
    let seal = house.identity("rogue").for_guest(guest).seal(
        SealChannel::Message,
        TO_A,
        b"x",
        house.incarnation("a"),
    );
    rogue.put(TO_A, "x").attachment(seal).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged b--cli-1"]);
    // The message is a heartbeat of an agent of another daemon.
    let beat = "althing/office/model/b/robot";
    let seal = identity.seal(SealChannel::AgentState, beat, b"x", None);
    rogue.put(beat, "x").attachment(seal).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged rogue"]);
    let beats = "althing/office/model/b";
    let seal = identity.seal(SealChannel::AgentState, beats, br#"{"sender":"robot"}"#, None);
    rogue.put(beats, r#"{"sender":"robot"}"#).attachment(seal).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged rogue"]);
    // The message is a list of revocations that the authority has not signed.
    rogue.put("althing/office/revoked", "nobody").await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged rogue"]);
    // The message comes with a certificate of another authority.
    let foreign =
        House::new().identity("b").seal(SealChannel::Message, TO_A, b"x", house.incarnation("a"));
    rogue.put(TO_A, "x").attachment(foreign).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected unknown b"]);

    let seal = identity.seal(SealChannel::Message, TO_A, b"true", house.incarnation("a"));
    rogue.put(TO_A, "true").attachment(seal).await.expect("open");
    assert_eq!(a.hear_any().await, ["to x inform: true <rogue>"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_overheard_message_has_a_verified_origin() {
    let house = House::new();
    let a = house.open("a", &[]).await;
    let b = house.open("b", &[&a]).await;
    let mut c = house.open("c", &[&a]).await;
    let _token = b.announce("y");
    // A daemon accepts no broadcasts of a daemon that it does not know yet.
    c.hear("joined y@b").await;
    let rogue = house.rogue("rogue", &a).await;
    reach(&rogue, TO_A).await;
    let mut listening = Listening::at(&c, &b).await;

    b.request("a", "x", "to another");
    assert_eq!(listening.hear().await, "to x request: to another <b>");
    b.request("b", "y", "to itself");
    assert_eq!(listening.hear().await, "to y request: to itself <b>");
    c.request("c", "z", "on the listener's daemon");
    assert_eq!(listening.hear().await, "to z request: on the listener's daemon <c>");
    let together = ["y", "z"].map(|who| (agent(who), format!(r#"{{"sender":"{who}"}}"#).into()));
    b.substrate.broadcast_heartbeats(together.into()).expect("open");
    assert_eq!(listening.hear().await, r#"beat y: {"sender":"y"} <b>"#);
    assert_eq!(listening.hear().await, r#"beat z: {"sender":"z"} <b>"#);

    // None of these is overheard: without a seal, with the seal of another payload, in the name of
    // another daemon's agent, and in the name of a daemon that says it to itself.
    rogue.put(TO_A, "unsigned").await.expect("open");
    let identity = house.identity("rogue");
    let seal = identity.seal(SealChannel::Message, TO_A, b"harmless", None);
    rogue.put(TO_A, "harmful").attachment(seal).await.expect("open");
    let beat = "althing/office/model/b/robot";
    let seal = identity.seal(SealChannel::AgentState, beat, b"x", None);
    rogue.put(beat, "x").attachment(seal).await.expect("open");
    let seal = identity.seal(SealChannel::Internal, TO_A, b"x", None);
    rogue.put(TO_A, "x").attachment(seal).await.expect("open");
    let seal = identity.seal(SealChannel::Message, TO_A, b"true", None);
    rogue.put(TO_A, "true").attachment(seal).await.expect("open");
    assert_eq!(listening.hear().await, "to x inform: true <rogue>");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recorded_message_cannot_be_replayed() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let mut b = house.open("b", &[&a]).await;
    let rogue = house.rogue("rogue", &a).await;
    let tape = rogue.declare_subscriber("althing/office/in/a/**").await.expect("open");
    let _tokens = [a.announce("x"), b.announce("y")];
    b.hear("joined x@a").await;
    a.hear("joined y@b").await;
    let record = async || -> Sample {
        let sample = tokio::time::timeout(DEADLINE, tape.recv_async()).await.expect("in time");
        sample.expect("open")
    };
    reach(&rogue, TO_A).await;
    b.request("a", "x", "open the door");
    a.hear("to x request: open the door <b>").await;
    let recorded = record().await;

    let play = |key: String, payload: Vec<u8>| {
        rogue.put(key, payload).attachment(recorded.attachment().cloned())
    };
    let (key, payload) = (recorded.key_expr().to_string(), recorded.payload().to_bytes().to_vec());
    play(key.clone(), payload.clone()).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected replayed b"]);
    play(key.replace("/x/", "/z/"), payload).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged b"]);
    play(key, b"open the vault".to_vec()).await.expect("open");
    assert_eq!(a.hear_any().await, ["rejected forged b"]);
    b.request("a", "x", "close the door");
    a.hear("to x request: close the door <b>").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_from_before_a_restart_cannot_be_replayed() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    // The rogue stays linked to `b` while `a` restarts.
    let mut b = house.open("b", &[&a]).await;
    let rogue = house.rogue("rogue", &b).await;
    let tape = rogue.declare_subscriber("althing/office/**").await.expect("open");
    let _tokens = [a.announce("x"), b.announce("y")];
    b.hear("joined x@a").await;
    a.hear("joined y@b").await;
    b.request("a", "x", "open the door");
    b.substrate.broadcast(&agent("y"), Performative::Inform, "it is open".into()).expect("open");
    b.substrate.broadcast_state(&agent("y"), "works".into()).expect("open");
    a.hear("beat y: works <b>").await;
    let mut recorded = Vec::new();
    while recorded.len() < 3 {
        let sample = tokio::time::timeout(DEADLINE, tape.recv_async()).await.expect("in time");
        recorded.extend(Some(sample.expect("open")).filter(|each| each.attachment().is_some()));
    }
    a.substrate.close().await;
    drop(a);
    b.hear("left x@a").await;

    let mut a = house.open("a", &[&b]).await;
    let _token = a.announce("x");
    b.hear("joined x@a").await;
    a.hear_all(&["joined x@a", "joined y@b"]).await;
    reach(&rogue, TO_A).await;
    for each in recorded {
        // For a moment the message might still have been under way, and is dropped silently.
        loop {
            let put = rogue.put(each.key_expr().clone(), each.payload().clone());
            put.attachment(each.attachment().cloned()).await.expect("open");
            tokio::select! {
                heard = a.hear_any() => {
                    assert_eq!(heard, ["rejected replayed b"], "{}", each.key_expr());
                    break;
                }
                () = tokio::time::sleep(std::time::Duration::from_millis(100)) => {}
            }
        }
        while a.heard_already().is_some_and(|line| line == "rejected replayed b") {}
    }
    b.request("a", "x", "close the door");
    a.hear("to x request: close the door <b>").await;
    b.substrate.broadcast(&agent("y"), Performative::Inform, "it is closed".into()).expect("open");
    a.hear("all y inform: it is closed <b>").await;
    a.request("b", "y", "good");
    b.hear("to y request: good <a>").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answer_is_signed_by_the_daemon_that_was_asked() {
    let house = House::new();
    let a = house.open("a", &[]).await;
    let mut b = house.open("b", &[&a]).await;
    let _token = a.announce("x");
    b.hear("joined x@a").await;
    let rogue = house.rogue("rogue", &b).await;
    let lie = rogue.declare_queryable("althing/office/at/a/state").await.expect("open");
    let identity = house.identity("rogue");
    let lying = tokio::spawn(async move {
        while let Ok(query) = lie.recv_async().await {
            let key = query.key_expr().clone();
            let nonce = query.attachment().map(|nonce| nonce.to_bytes().into_owned());
            let nonce = nonce.expect("a nonce").try_into().expect("of its length");
            let seal = identity.seal_answer("althing/office/at/a/state", b"a lie", &nonce);
            query.reply("althing/office/at/a/state", "unsigned").await.expect("open");
            query.reply(key, "a lie").attachment(seal).await.expect("open");
        }
    });
    loop {
        let answers = b.ask(Some("a"), Resource::State, None).await;
        assert_eq!(answers, ["a state -"]);
        let (mut unsigned, mut forged) = (false, false);
        while let Some(line) = b.heard_already() {
            unsigned |= line == "rejected unsigned -";
            forged |= line == "rejected forged rogue";
        }
        if unsigned && forged {
            break;
        }
    }
    lying.abort();
}

#[tokio::test(flavor = "multi_thread")]
async fn no_daemon_makes_the_agents_of_another_present() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let rogue = house.rogue("rogue", &a).await;
    let identity = Arc::new(house.identity("rogue"));
    let (mut answering, mut tokens) = (Vec::new(), Vec::new());
    for daemon in ["b", "rogue"] {
        let identity = Arc::clone(&identity);
        let key = format!("althing/office/at/{daemon}/reach");
        let answer = move |query: Query| {
            let nonce =
                query.attachment().expect("it is called by who wants to be sure").to_bytes();
            let nonce = Nonce::try_from(&*nonce).expect("a nonce");
            let key = query.key_expr().as_str().replace('*', daemon);
            let seal = identity.seal_answer(&key, b"", &nonce);
            query.reply(key, "").attachment(seal).wait().expect("open");
        };
        answering.push(rogue.declare_queryable(key).callback(answer).await.expect("open"));
        let token = format!("althing/office/alive/{daemon}/robot/1");
        tokens.push(rogue.liveliness().declare_token(token).await.expect("open"));
        if daemon == "b" {
            assert_eq!(a.hear_any().await, ["rejected forged rogue"]);
        }
    }
    let heard = a.hear("joined robot@rogue").await;
    let others = heard.iter().filter(|line| *line != "rejected forged rogue");
    assert_eq!(others.collect::<Vec<_>>(), ["joined robot@rogue"], "in its own name");
}

#[tokio::test(flavor = "multi_thread")]
async fn no_session_makes_agents_of_this_daemon_present_or_absent() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let rogue = house.rogue("rogue", &a).await;
    let declare = async |agent: &str| {
        let key = format!("althing/office/alive/a/{agent}/1");
        rogue.liveliness().declare_token(key).await.expect("open")
    };
    let _invented = declare("robot").await;
    assert_eq!(a.hear_any().await, ["rejected forged a"]);
    let own = a.announce("lamp");
    assert_eq!(a.hear_any().await, ["joined lamp@a"]);
    declare("lamp").await.undeclare().await.expect("open");
    // Declarations of one session arrive in their order, so the end of the last one was received.
    let _last = declare("ghost").await;
    assert_eq!(a.hear_any().await, ["rejected forged a"]);
    drop(own);
    assert_eq!(a.hear_any().await, ["left lamp@a"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn links_carry_nothing_but_the_ecosystem() {
    let house = House::new();
    let a = house.open("a", &[]).await;
    let (listener, signer) = (house.rogue("one", &a).await, house.rogue("two", &a).await);
    let elsewhere = listener.declare_subscriber("elsewhere/**").await.expect("open");
    let here = listener.declare_subscriber("althing/office/in/one/**").await.expect("open");
    // Declared last, so that the other subscription would be known by then.
    reach(&signer, "althing/office/in/one/x/inform").await;
    signer.put("elsewhere/x", "smuggled").await.expect("open");
    signer.put("althing/office/in/one/x/inform", "said").await.expect("open");
    let said = tokio::time::timeout(DEADLINE, here.recv_async()).await.expect("in time");
    assert_eq!(&*said.expect("open").payload().to_bytes(), b"said");
    assert!(elsewhere.try_recv().expect("open").is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_affects_its_sender_only() {
    let house = House::new();
    let mut a = house.open_with("a", &[], 20).await;
    let flood = house.open("flood", &[&a]).await;
    let b = house.open("b", &[&a]).await;
    let _tokens = [a.announce("x"), flood.announce("f"), b.announce("y")];
    a.hear("joined f@flood").await;
    flood.request("a", "x", "hello");
    a.hear("to x request: hello <flood>").await;
    for number in 0..500 {
        flood.request("a", "x", &number.to_string());
    }
    a.hear("rejected flooded flood").await;
    b.request("a", "x", "heard all the same");
    a.hear("to x request: heard all the same <b>").await;
}

/// Sends the same request again and again.
async fn repeat(from: &Daemon, to: &str) {
    loop {
        from.request(to, "x", "hello");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_of_100_mib_does_no_harm_and_is_counted() {
    // The layer is installed as in a program with a log. A detection is attributed only to the
    // links of this test's certificates.
    let _ = tracing_subscriber::registry().with(substrate_zenoh::oversize_layer()).try_init();
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let mut b = house.open("b", &[&a]).await;
    let _tokens = [a.announce("x"), b.announce("y")];
    b.hear("joined x@a").await;
    a.hear("joined y@b").await;
    let huge = vec![b'x'; 100 << 20];
    let to = AgentAddress { daemon: DaemonId::new("a").expect("a name"), agent: agent("x") };
    let subject = Subject::Message(Performative::Inform);
    let refused = b.substrate.send(&to, subject, Bytes::from(huge.clone())).expect_err("too long");
    assert!(matches!(refused, SendError::TooLong { .. }), "{refused}");
    assert!(b.substrate.broadcast_state(&agent("y"), Bytes::from(huge.clone())).is_err());

    let rogue = house.rogue("rogue", &a).await;
    reach(&rogue, TO_A).await;
    let seal =
        house.identity("rogue").seal(SealChannel::Message, TO_A, &huge, house.incarnation("a"));
    // This waits until the message is sent: one dropped by congestion control would prove nothing.
    let put = rogue.put(TO_A, huge).attachment(seal).congestion_control(CongestionControl::Block);
    put.await.expect("open");
    let identity = house.identity("rogue");
    let seal = identity.seal(SealChannel::Message, TO_A, b"after it", house.incarnation("a"));
    rogue.put(TO_A, "after it").attachment(seal).await.expect("open");
    let heard = a.hear("to x inform: after it <rogue>").await;
    let said: Vec<_> = heard.iter().filter(|line| line.starts_with("to ")).collect();
    assert_eq!(said.len(), 1, "and nothing before it: {heard:?}");
    if !heard.iter().any(|line| line == "rejected oversized rogue") {
        a.hear("rejected oversized rogue").await;
    }
    b.request("a", "x", "unharmed");
    a.hear("to x request: unharmed <b>").await;

    let longest = vec![b'l'; MESSAGE_BYTES_MAX - (64 << 10)];
    b.substrate.send(&to, subject, Bytes::from(longest)).expect("it is short enough");
    a.hear(&format!("to x inform: {} <b>", "l".repeat(80))).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revocation_reaches_running_daemons() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    // `c` has a folder of its own, so the list reaches it over the network.
    let apart = house.apart("c");
    let mut c = apart.open("c", &[&a]).await;
    let b = house.open("b", &[&a]).await;
    let _tokens = [a.announce("x"), b.announce("y"), c.announce("x2")];
    a.hear("joined y@b").await;
    c.hear("joined y@b").await;
    tokio::select! {
        () = repeat(&b, "a") => {}
        heard = a.hear("to x request: hello <b>") => drop(heard),
    }
    tokio::select! {
        () = repeat(&b, "c") => {}
        heard = c.hear("to x request: hello <b>") => drop(heard),
    }
    assert!(!apart.folder.revocations().exists());

    house.authority.revoke(&DaemonId::new("b").expect("a name")).expect("it has one");

    // The messages of `b` are rejected, its connections refused, and its links closed.
    let lines = ["rejected revoked b", "left y@b"];
    tokio::select! {
        () = repeat(&b, "a") => {}
        () = repeat(&b, "c") => {}
        _ = async { tokio::join!(a.hear_all(&lines), c.hear_all(&lines)) } => {}
    }
    assert!(apart.folder.revocations().exists(), "kept for the next incarnation");
    assert_eq!(a.ask(Some("b"), Resource::State, None).await, [""; 0]);
    a.request("c", "x", "we remain");
    c.hear("to x request: we remain <a>").await;
}

/// Waits until a session has no link.
async fn alone(session: &Session) {
    let unlinked = async {
        while session.info().routers_zid().await.next().is_some() {
            tokio::time::sleep(std::time::Duration::from_millis(10)).await;
        }
    };
    tokio::time::timeout(DEADLINE, unlinked).await.expect("its links are closed");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revoked_daemon_cannot_listen_any_more() {
    let house = House::new();
    let mut a = house.open("a", &[]).await;
    let c = house.open("c", &[&a]).await;
    let _tokens = [a.announce("x"), c.announce("z")];
    a.hear("joined z@c").await;
    let listening = house.open("spy", &[]).await;
    let spy = house.rogue("spy", &a).await;
    let tape = spy.declare_subscriber("althing/office/all/**").await.expect("open");
    let told = async {
        loop {
            c.substrate
                .broadcast(&agent("z"), Performative::Inform, "secret".into())
                .expect("open");
            let heard = tokio::time::timeout(Duration::from_millis(50), tape.recv_async());
            if heard.await.is_ok() {
                break;
            }
        }
    };
    tokio::time::timeout(DEADLINE, told).await.expect("it can listen");

    house.authority.revoke(&DaemonId::new("spy").expect("a name")).expect("it has one");
    alone(&spy).await;
    a.hear("rejected revoked spy").await;
    assert!(spy.info().routers_zid().await.next().is_none(), "it has called again, in vain");
    c.request("a", "x", "we remain");
    a.hear("to x request: we remain <c>").await;

    // A daemon that connects to the revoked one gets no link either.
    let mut b = house.open("b", &[&a, &listening]).await;
    let _token = b.announce("y");
    b.hear("rejected revoked spy").await;
    a.hear("joined y@b").await;
}
