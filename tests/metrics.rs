//! Metrics and health of a real daemon, scraped over HTTP: their names, their truth, and what bad
//! clients get.

use std::collections::BTreeSet;
use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::left_out::left_out;
use crate::support::{Office, PATIENCE, stderr};

/// How long one answer may take on a busy machine.
const ANSWERED_WITHIN: Duration = Duration::from_secs(20);

/// The office in one daemon, which serves metrics.
struct Watched {
    office: Office,
    port: u16,
}

/// An answer to a request: its status, its head and its body.
struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl Watched {
    fn new() -> Watched {
        let (mut office, port) = (Office::new(), free_port());
        let file = Office::file().display().to_string();
        let mut up = office.command(&["up", &file]);
        up.env("ALTHING_METRICS__LISTEN", format!("127.0.0.1:{port}"));
        office.begin_as("alone", up);
        let watched = Watched { office, port };
        let deadline = Instant::now() + PATIENCE;
        // The daemon is ready before the socket is open.
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < deadline, "nobody listens");
        }
        watched
    }

    fn get(&self, path: &str) -> Answer {
        self.asked(format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"))
            .unwrap_or_else(|| panic!("no answer to {path}"))
    }

    /// Sends these bytes and returns the answer; `None` if the daemon closes the connection without
    /// one.
    fn asked(&self, request: impl AsRef<[u8]>) -> Option<Answer> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("it listens");
        stream.set_read_timeout(Some(ANSWERED_WITHIN)).expect("a socket");
        // A daemon that has refused the beginning may have closed the connection.
        let _ = stream.write_all(request.as_ref());
        let mut bytes = Vec::new();
        match stream.read_to_end(&mut bytes) {
            Err(error) if error.kind() == ErrorKind::WouldBlock => panic!("no answer in time"),
            _ => (),
        }
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let (head, body) = text.split_once("\r\n\r\n")?;
        let status = head.split(' ').nth(1)?.parse().ok()?;
        Some(Answer { status, head: head.to_owned(), body: body.to_owned() })
    }

    fn metrics(&self) -> String {
        let answer = self.get("/metrics");
        assert_eq!(answer.status, 200, "{}", answer.head);
        answer.body
    }

    /// Returns the value of one sample.
    fn value(&self, sample: &str) -> f64 {
        value_in(&self.metrics(), sample).unwrap_or_else(|| panic!("there is no {sample}"))
    }
}

fn free_port() -> u16 {
    // The kernel does not give the same free port to another process soon, so it can be used later.
    let socket = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    socket.expect("a port").port()
}

fn value_in(text: &str, sample: &str) -> Option<f64> {
    text.lines().find_map(|line| line.strip_prefix(sample)?.strip_prefix(' ')?.parse().ok())
}

/// Returns the names of all metrics in a text.
fn names(text: &str) -> BTreeSet<String> {
    let types = text.lines().filter_map(|line| line.strip_prefix("# TYPE "));
    types.filter_map(|line| Some(line.split(' ').next()?.to_owned())).collect()
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

fn repository_text(path: &str) -> String {
    let path = repository().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns all names of metrics in a text, without the endings of samples.
fn named(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
    let names = words.filter(|word| word.starts_with("althing_") || word.starts_with("process_"));
    names.map(|word| word.trim_end_matches("_bucket").to_owned()).collect()
}

#[test]
fn a_daemon_counts_what_it_does() {
    let watched = Watched::new();
    let first = watched.metrics();
    let version = format!("althing_build_info{{version=\"{}\"}}", env!("CARGO_PKG_VERSION"));
    assert_eq!(value_in(&first, &version), Some(1.0), "{first}");
    assert_eq!(value_in(&first, "althing_healthy"), Some(1.0), "{first}");
    assert_eq!(value_in(&first, "althing_stops_in_force"), Some(0.0), "{first}");
    assert_eq!(value_in(&first, "process_start_time_seconds").map(f64::is_normal), Some(true));
    let hosted = value_in(&first, "althing_agents_hosted").expect("it hosts agents");
    assert_eq!(mailboxes(&watched.office), hosted, "as many agents have mailboxes");

    let (code, said) = watched.office.ask(&["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(watched.value("althing_goals_ended_total{outcome=\"done\"}"), 1.0);
    assert!(watched.value("althing_steps_total{outcome=\"done\"}") >= 1.0);
    let labels = "mode=\"decentralized\",result=\"found\"";
    assert!(watched.value(&format!("althing_planning_rounds_total{{{labels}}}")) >= 1.0);
    let text = watched.metrics();
    let rounds = ["found", "missing", "abandoned"].map(|result| {
        let labels = format!("mode=\"decentralized\",result=\"{result}\"");
        value_in(&text, &format!("althing_planning_rounds_total{{{labels}}}")).expect("a sample")
    });
    let timed = value_in(&text, "althing_planning_seconds_count{mode=\"decentralized\"}");
    assert_eq!(timed, Some(rounds.iter().sum()), "each round has a duration");
    // Devices have goals of their own: whatever is pursued is counted once.
    let pursued = watched.office.ask_json(&["goals"])["goals"].as_array().map(Vec::len);
    let phases = watched.metrics();
    let phases = phases.lines().filter(|line| line.starts_with("althing_goals{"));
    let counts = phases.filter_map(|line| line.rsplit(' ').next()?.parse::<usize>().ok());
    assert_eq!(Some(counts.sum()), pursued);
    assert!(watched.value("althing_messages_sent_total{performative=\"confirm\"}") >= 1.0);
    assert!(watched.value("althing_messages_received_total{performative=\"request\"}") >= 1.0);

    let (_, said) = watched.office.ask(&["stop"]);
    assert_eq!(watched.value("althing_stops_in_force"), 1.0, "{said}");
    assert_eq!(watched.get("/healthz").status, 200, "a stop is no problem of the daemon");
}

/// Returns the number of agents whose mailboxes the daemon lists.
fn mailboxes(office: &Office) -> f64 {
    let counted = office.ask_json(&["mailbox"]);
    let daemons = counted["daemons"].as_array().cloned().unwrap_or_default();
    let lengths = daemons.iter().filter_map(|daemon| Some(daemon["mailboxes"].as_array()?.len()));
    lengths.max().unwrap_or_default() as f64
}

#[test]
fn documents_and_the_dashboard_name_the_metrics_that_are_served() {
    let watched = Watched::new();
    let served = names(&watched.metrics());
    let document = repository_text("docs/metrics.md");
    let rows = document.lines().filter_map(|line| line.strip_prefix("| `"));
    let described: BTreeSet<_> =
        rows.filter_map(|row| Some(row.split('`').next()?.to_owned())).collect();
    let described: BTreeSet<_> =
        described.into_iter().filter(|name| !name.starts_with('/')).collect();
    assert_eq!(described, served, "docs/metrics.md describes each metric, and no other");
    for (file, text) in [
        ("docs/metrics.md", document),
        ("deploy/grafana/althing.json", repository_text("deploy/grafana/althing.json")),
    ] {
        let unknown: Vec<_> = named(&text).difference(&served).cloned().collect();
        assert!(unknown.is_empty(), "{file} names {unknown:?}");
    }
}

#[test]
fn the_dashboard_has_a_source_and_an_expression_for_each_panel() {
    let dashboard: Value =
        serde_json::from_str(&repository_text("deploy/grafana/althing.json")).expect("JSON");
    let panels = dashboard["panels"].as_array().expect("panels");
    let charts: Vec<_> = panels.iter().filter(|panel| panel["type"] != "row").collect();
    assert!(charts.len() > 10);
    let mut ids = BTreeSet::new();
    for panel in charts {
        assert!(ids.insert(panel["id"].as_u64()), "{} has an id of its own", panel["title"]);
        assert_eq!(panel["datasource"]["uid"], "${datasource}", "{}", panel["title"]);
        for target in panel["targets"].as_array().expect("targets") {
            let expression = target["expr"].as_str().expect("an expression");
            assert!(!named(expression).is_empty(), "{expression} is about a metric");
            assert!(expression.contains("instance=~\"$instance\""), "{expression}");
        }
    }
    let variables = dashboard["templating"]["list"].as_array().expect("variables");
    assert!(variables.iter().any(|it| it["type"] == "datasource" && it["query"] == "prometheus"));
}

#[test]
fn promtool_finds_nothing_to_say() {
    let available = Command::new("promtool").arg("--version").output();
    if !available.is_ok_and(|output| output.status.success()) {
        return left_out("promtool is not here: it comes with Debian's package `prometheus`");
    }
    let watched = Watched::new();
    let mut check = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("promtool starts");
    let text = watched.metrics();
    check.stdin.take().expect("piped").write_all(text.as_bytes()).expect("it reads");
    let output = check.wait_with_output().expect("our child");
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert!(output.status.success() && said.trim().is_empty(), "{said}");

    // The alerts of the document are those of a file of rules.
    let document = repository_text("docs/metrics.md");
    let rules = document.split("```yaml\n").find(|block| block.starts_with("groups:"));
    let rules = rules.and_then(|block| block.split("```").next()).expect("alerts");
    let rules = watched.office.write("rules.yml", rules);
    let output = Command::new("promtool").arg("check").arg("rules").arg(&rules).output();
    let output = output.expect("promtool starts");
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert!(output.status.success() && said.contains("8 rules found"), "{said}");
}

#[test]
fn openmetrics_is_served_to_who_asks_for_it() {
    let watched = Watched::new();
    let request = "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\
                   Accept: application/openmetrics-text; version=1.0.0\r\n\r\n";
    let answer = watched.asked(request).expect("an answer");
    assert!(answer.head.contains("application/openmetrics-text; version=1.0.0"), "{}", answer.head);
    assert!(answer.body.ends_with("# EOF\n"), "{}", answer.body);
    assert!(answer.body.contains("# TYPE althing_messages_sent counter\n"), "{}", answer.body);
}

#[test]
fn garbage_and_slow_clients_get_nothing_and_change_nothing() {
    let watched = Watched::new();
    let before = watched.value("process_open_fds");
    let long = format!("GET /{} HTTP/1.1\r\n\r\n", "x".repeat(100_000));
    let many = format!("GET / HTTP/1.1\r\n{}\r\n", "a: b\r\n".repeat(1_000));
    let requests: [&[u8]; 7] = [
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"\0\0\0\0\r\n\r\n",
        b"GET /metrics HTTP/9.9\r\n\r\n",
        b"\xff\xfe\xfd /metrics\r\n\r\n",
        b"GET /metrics HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        long.as_bytes(),
        many.as_bytes(),
    ];
    for request in requests {
        let answer = watched.asked(request);
        let status = answer.map_or(400, |answer| answer.status);
        assert!((400..500).contains(&status), "{status} to {}", String::from_utf8_lossy(request));
    }
    let foreign = "GET /metrics HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n";
    assert_eq!(watched.asked(foreign).map(|answer| answer.status), Some(421));
    let post = "POST /metrics HTTP/1.1\r\nHost: [::1]\r\nConnection: close\r\n\
                Content-Length: 4\r\n\r\nbody";
    assert_eq!(watched.asked(post).map(|answer| answer.status), Some(405));

    // Clients that send a part of their head, and clients that never read.
    let hold = |bytes: &[u8]| {
        let mut stream = TcpStream::connect(("127.0.0.1", watched.port)).expect("it listens");
        let _ = stream.write_all(bytes);
        stream
    };
    let slow: Vec<_> = (0..100).map(|_| hold(b"GET /metr")).collect();
    let deaf: Vec<_> =
        (0..100).map(|_| hold(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n")).collect();
    let began = Instant::now();
    assert_eq!(watched.get("/healthz").status, 200);
    assert!(began.elapsed() < ANSWERED_WITHIN, "{:?}", began.elapsed());
    let open = watched.value("process_open_fds");
    assert!(open < before + 60.0, "{open} files are open, {before} before 200 clients came");
    drop((slow, deaf));
    assert!(watched.office.ask(&["agents"]).0 == Some(0), "the daemon works");
}

#[test]
fn an_address_that_others_reach_needs_security() {
    let office = Office::new();
    let plain = fs::read_to_string(Office::file()).expect("the repository's own");
    let folder = Office::file().canonicalize().expect("it is there");
    let domains = folder.ancestors().nth(2).expect("a folder").join("domains");
    let plain = plain.replace("../domains", &domains.display().to_string());
    for (listen, words) in [
        ("0.0.0.0:9464", "write \"127.0.0.1:9464\"; an ecosystem with [security]"),
        ("[::]:80", "not an address of this machine alone"),
        ("9464", "write \"127.0.0.1:9464\""),
        ("office-pi:9464", "is not an address with a port"),
    ] {
        let text = format!("{plain}\n[metrics]\nlisten = \"{listen}\"\n");
        let file = office.write("open.toml", &text).display().to_string();
        for command in [&["check", &file][..], &["up", &file, "--daemon", "reasoning"]] {
            let output = office.run(command);
            let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
            assert!(!output.status.success(), "{command:?}: {said}");
            assert!(said.contains(words), "{listen}: {said}");
        }
    }
    let empty = office.write("empty.toml", &format!("{plain}\n[metrics]\n"));
    let output = office.run(&["check", &empty.display().to_string()]);
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert!(said.contains("`listen` is missing in `metrics`"), "{said}");
    let fine = office.write("fine.toml", &format!("{plain}\n[metrics]\nlisten = \"[::1]:9464\"\n"));
    let output = office.run(&["check", &fine.display().to_string()]);
    assert!(output.status.success(), "{}", stderr(&output));
}

/// Asks for the metrics at `port` over TLS, with the certificate `own` in the folder of keys or with
/// none; `None` if the daemon does not answer.
fn ask_encrypted(keys: &Path, port: u16, own: Option<&str>) -> Option<String> {
    use rustls::pki_types::pem::PemObject as _;
    use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
    let certificate = |name: &str| {
        CertificateDer::from_pem_file(keys.join(format!("{name}.pem"))).expect("a certificate")
    };
    let mut roots = rustls::RootCertStore::empty();
    roots.add(certificate("authority")).expect("an authority");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = rustls::ClientConfig::builder_with_provider(provider);
    let builder = builder.with_safe_default_protocol_versions().expect("versions");
    let builder = builder.with_root_certificates(roots);
    let config = match own {
        None => builder.with_no_client_auth(),
        Some(name) => {
            let key = PrivateKeyDer::from_pem_file(keys.join(format!("{name}.key")));
            let key = key.expect("a key");
            builder.with_client_auth_cert(vec![certificate(name)], key).expect("they fit")
        }
    };
    let name = ServerName::try_from("reasoning").expect("a name");
    let session = rustls::ClientConnection::new(Arc::new(config), name).expect("a session");
    let stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
    stream.set_read_timeout(Some(ANSWERED_WITHIN)).expect("a socket");
    let mut stream = rustls::StreamOwned::new(session, stream);
    stream.write_all(b"GET /metrics HTTP/1.1\r\nConnection: close\r\n\r\n").ok()?;
    let mut bytes = Vec::new();
    // The daemon may close the connection without taking leave.
    let _ = stream.read_to_end(&mut bytes);
    (!bytes.is_empty()).then(|| String::from_utf8_lossy(&bytes).into_owned())
}

#[test]
fn a_secured_daemon_answers_who_has_a_certificate() {
    let office = Office::new();
    let text = fs::read_to_string(Office::file()).expect("the repository's own");
    let domains = repository().canonicalize().expect("it is there").join("domains");
    let text = text.replace("../domains", &domains.display().to_string());
    let port = free_port();
    let text =
        format!("{text}\n[security]\nfolder = \"keys\"\n[metrics]\nlisten = \"0.0.0.0:{port}\"\n");
    let file = office.write("secured.toml", &text);
    let path = file.display().to_string();
    let cert = |arguments: &[&str]| {
        let output = office.run(&[&["cert"], arguments].concat());
        assert!(output.status.success(), "{}", stderr(&output));
    };
    cert(&["authority", &path]);
    cert(&["daemon", "reasoning", "prometheus", "--ecosystem", &path]);
    let mut office = office.with_file(file);
    office.up(&["reasoning"], &[]);
    let keys = office.folder().join("keys");
    let deadline = Instant::now() + PATIENCE;
    let answer = loop {
        if let Some(answer) = ask_encrypted(&keys, port, Some("prometheus")) {
            break answer;
        }
        assert!(Instant::now() < deadline, "no answer");
    };
    assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
    let left = value_in(&answer, "althing_certificate_remaining_seconds");
    assert!(left.is_some_and(|left| left > 24.0 * 3_600.0), "{left:?}");
    assert_eq!(ask_encrypted(&keys, port, None), None, "without a certificate");
}
