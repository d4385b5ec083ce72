//! A secured office, set up by the commands of a caretaker: certificates, TLS links between daemons
//! that share nothing but the network, people at command lines, and senders that are rejected.

use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::time::Instant;

use serde_json::Value;

use crate::support::network::example;
use crate::support::terminal::{Terminal, has_tmux};
use crate::support::{Office, PATIENCE, lines, stderr, stdout};

const BOARDS: [&str; 2] = ["turtlebot-laptop", "office2-pi"];

/// The smart office, secured, with further lines in its file; one folder of keys, as on the machine
/// on which they are made.
struct Secured {
    office: Office,
    file: PathBuf,
}

impl Secured {
    fn new(rights: &str) -> Secured {
        let plain = Office::new();
        let file = write(&plain, rights);
        let made = plain.run(&["cert", "authority", &file.display().to_string()]);
        assert!(made.status.success(), "{}", stderr(&made));
        // The first office owns the folder and is kept by this one.
        let secured = Secured { office: plain.with_file(file.clone()), file };
        secured.cert(&["daemon", "reasoning", "turtlebot-laptop", "office2-pi"]);
        secured
    }

    /// Runs a command about certificates.
    fn cert(&self, arguments: &[&str]) -> String {
        let file = self.file.display().to_string();
        let output = self.office.run(&[&["cert"], arguments, &["--ecosystem", &file]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        stdout(&output)
    }
}

/// Returns how many messages a daemon has rejected for this reason.
fn rejected(office: &Office, by: &str, kind: &str) -> u64 {
    let counted = office.ask_json(&["mailbox"]);
    let daemons = counted["daemons"].as_array().cloned().unwrap_or_default();
    let of = daemons.iter().find(|daemon| daemon["daemon"] == by);
    of.and_then(|daemon| daemon["rejected"][kind].as_u64()).unwrap_or(0)
}

fn await_rejected(office: &Office, by: &str, kind: &str) {
    let deadline = Instant::now() + PATIENCE;
    while rejected(office, by, kind) == 0 {
        assert!(Instant::now() < deadline, "`{by}` rejects nothing that is {kind}");
    }
}

/// Writes the office's file with a [security] table and these further lines.
fn write(office: &Office, rights: &str) -> PathBuf {
    let text = fs::read_to_string(Office::file()).expect("the repository's own");
    let folder = Office::file().canonicalize().expect("it is there");
    let domains = folder.ancestors().nth(2).expect("a folder").join("domains");
    let text = text.replace("../domains", &domains.display().to_string());
    let text = format!("{text}\n[security]\nfolder = \"keys\"\n{rights}\n");
    office.write("secured.toml", &text)
}

#[test]
fn a_goal_is_reached_in_a_secured_office() {
    let mut secured = Secured::new("");
    secured.office.up(&["reasoning"], &[]);
    secured.office.up(&BOARDS, &[]);
    // Two further sensors have no certificate and do not appear.
    secured.office.await_devices(3);
    let (code, said) = secured.office.ask(&["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("holds"), "{said}");
    let (code, agents) = secured.office.ask(&["agents"]);
    assert_eq!(code, Some(0), "{agents}");
    assert!(agents.contains("turtlebot-1") && agents.contains("thermometer-office2"), "{agents}");
    // On a machine with a running daemon the ecosystem's name is enough: the daemon gives its
    // guests the path of the keys.
    let named = secured.office.run(&["state", "--ecosystem", "smart-office"]);
    assert!(named.status.success(), "{}", stderr(&named));
}

#[test]
fn a_goal_of_a_secured_office_is_watched_and_another_one_asked_for_in_a_terminal() {
    if !has_tmux() {
        return;
    }
    let mut secured = Secured::new("");
    secured.office.up(&["reasoning"], &[]);
    secured.office.up(&BOARDS, &[]);
    secured.office.await_devices(3);
    let file = secured.file.display().to_string();
    let view = Terminal::open(&secured.office, &format!("view agents --ecosystem '{file}'"));
    view.await_text("thermometer-office2");
    view.press("7");
    let (code, said) = secured.office.ask(&["goal", "(known-temperature office2)"]);
    assert_eq!(code, Some(0), "{said}");
    // Only verified messages are shown; these are of two daemons and of a command.
    let is_told = |screen: &str| screen.contains("(known-temperature office2)");
    view.await_screen("the goal in a sentence", is_told);
    view.press("2");
    let is_done =
        |line: &str| line.contains("(known-temperature office2)") && line.contains("done");
    view.await_screen("the goal, done", |screen| screen.lines().any(is_done));
    view.press("g");
    view.await_text("What is wanted?");
    view.type_text("(at turtlebot-1 corridor)");
    view.press("Enter");
    // Its plan is shown first, or that it holds already.
    view.await_text("a dry run: nothing is asked for");
    view.press("Enter");
    let is_done = |line: &str| line.contains("(at turtlebot-1") && line.contains("done");
    view.await_screen("the other goal, done", |screen| screen.lines().any(is_done));
}

#[test]
fn daemons_apart_are_linked_by_tls_and_people_from_elsewhere_too() {
    let mut secured = Secured::new("");
    secured.cert(&["daemon", "anna-laptop"]);
    // The kernel does not give the same free port to another process soon, so it can be used later.
    let port = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    let endpoint = format!("tls/127.0.0.1:{}", port.expect("a port").port());
    let text = fs::read_to_string(&secured.file).expect("ours");
    let listening =
        text.replace("[zenoh]\n", &format!("[zenoh]\nlisten.endpoints = [\"{endpoint}\"]\n"));
    let listening = secured.office.write("listening.toml", &listening);
    secured.office.up_from(&listening, "reasoning");
    let elsewhere = secured.office.folder().join("elsewhere");
    secured.office.up_apart("turtlebot-laptop", &elsewhere, &["--connect", &endpoint]);
    let file = secured.file.display().to_string();
    let deadline = Instant::now() + PATIENCE;
    loop {
        let reach = ["agents", "--ecosystem", &file, "--connect", &endpoint, "--as", "anna-laptop"];
        let output = secured.office.run(&reach);
        if stdout(&output).contains("turtlebot-1") {
            break;
        }
        assert!(Instant::now() < deadline, "{}{}", stdout(&output), stderr(&output));
    }
    let plain =
        secured.office.run(&["agents", "--connect", &endpoint, "--ecosystem", "other-name"]);
    assert!(!plain.status.success(), "without a certificate: {}", stdout(&plain));
}

#[test]
fn a_sender_without_the_right_to_request_goals_is_refused_and_counted() {
    let mut secured = Secured::new("[rights]\ngoals = [\"camera-1\"]\n");
    secured.office.up(&["reasoning", "turtlebot-laptop"], &[]);
    secured.office.await_devices(2);
    let (code, said) = secured.office.ask(&["goal", "(known-temperature office1)"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("does not let `keyboard-"), "{said}");
    assert!(rejected(&secured.office, "reasoning", "unauthorized") > 0);
    let (_, table) = secured.office.ask(&["mailbox"]);
    assert!(table.contains("unauthorized"), "{table}");
}

#[test]
fn messages_of_a_revoked_daemon_are_rejected() {
    let mut secured = Secured::new("");
    secured.office.up(&["reasoning", "turtlebot-laptop", "office2-pi"], &[]);
    secured.office.await_devices(3);
    let said = secured.cert(&["revoke", "office2-pi"]);
    assert!(said.starts_with("revoked `office2-pi`: 1 certificate"), "{said}");
    await_rejected(&secured.office, "reasoning", "revoked");
    // Its heartbeats are rejected, and so its actions are no longer offered.
    secured.office.await_devices(2);
    let shown = secured.cert(&["show", "--json"]);
    let shown: Value = serde_json::from_str(&shown).expect("JSON");
    let of = |name: &str| {
        let all = shown["certificates"].as_array().expect("a list");
        all.iter().find(|each| each["name"] == name).expect("it was made")["state"].clone()
    };
    assert_eq!([of("office2-pi"), of("reasoning")], ["revoked", "good"]);
    // The daemon does not even start again.
    secured.office.kill("office2-pi");
    let file = secured.file.display().to_string();
    let again = secured.office.run(&["up", &file, "--daemon", "office2-pi"]);
    assert_eq!(again.status.code(), Some(69));
    assert!(stderr(&again).contains("revoked"), "{}", stderr(&again));
}

#[test]
fn mistakes_in_keys_are_reported_before_the_start() {
    let secured = Secured::new("");
    let file = secured.file.display().to_string();
    let up = |name| stderr(&secured.office.run(&["up", &file, "--daemon", name]));
    let missing = up("conf-room-pi");
    assert!(missing.contains("`althing cert daemon conf-room-pi`"), "{missing}");
    let key = secured.office.folder().join("keys/reasoning.key");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).expect("ours");
    let loose = up("reasoning");
    assert!(loose.contains("others can read it (mode 644)"), "{loose}");
    assert!(loose.contains(&format!("chmod 600 {}", key.display())), "{loose}");
    let plain =
        secured.office.run(&["up", &file, "--daemon", "office2-pi", "--connect", "tcp/10.0.0.1:1"]);
    assert!(stderr(&plain).contains("this ecosystem is secured"), "{}", stderr(&plain));
    let nobody = secured.office.run(&["up", &file]);
    assert_eq!(nobody.status.code(), Some(78));
    let said = stderr(&nobody);
    assert!(said.contains("would reject its messages; name this daemon with --daemon"), "{said}");
    let twice = secured.office.run(&["cert", "authority", &file]);
    assert_eq!(twice.status.code(), Some(33));
    assert!(stderr(&twice).contains("it exists already"), "{}", stderr(&twice));
}

#[test]
fn mistakes_in_rights_point_into_the_file() {
    let office = Office::new();
    let file = write(&office, "[rights]\ngoals = [\"camra-1\"]\nguests = [\"Desk\"]\n");
    let output = office.run(&["check", &file.display().to_string()]);
    assert_eq!(output.status.code(), Some(33));
    let said = format!("{}{}", stdout(&output), stderr(&output));
    assert!(said.contains("there is no agent `camra-1`") && said.contains("`camera-1`"), "{said}");
    assert!(said.contains("`Desk` cannot be the name of a daemon"), "{said}");
}

#[test]
fn rights_without_security_are_warned_of() {
    let office = Office::new();
    let file = write(&office, "[rights]\ngoals = \"guests\"\n");
    let text = fs::read_to_string(&file).expect("ours");
    let file = office.write("open.toml", &text.replace("[security]\nfolder = \"keys\"\n", ""));
    let output = office.run(&["check", &file.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = format!("{}{}", stdout(&output), stderr(&output));
    assert!(said.contains("rights are not enforced in an ecosystem that is not secured"), "{said}");
}

/// A plain Zenoh session that has sent a request longer than the limit; closed on drop.
struct Rogue(Child);

impl Rogue {
    #[track_caller]
    fn shout(office: &Office, settings: &Value) -> Rogue {
        let settings = office.write("rogue.json5", &settings.to_string());
        let program = example("put");
        assert!(program.exists(), "build it: cargo build -p substrate-zenoh --example put");
        let mut command = office.program(program.as_os_str());
        let key = "althing/smart-office/in/reasoning/plan-requester/request";
        let bytes = (100 << 20).to_string();
        command.arg(settings).args([key, &bytes]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("it is there");
        let said = lines(&mut child).recv_timeout(PATIENCE).expect("it puts");
        assert!(said.contains("put 104857600 bytes"), "{said}");
        Rogue(child)
    }
}

impl Drop for Rogue {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn an_oversized_message_is_counted_and_harmless() {
    let mut secured = Secured::new("");
    secured.cert(&["daemon", "anna-laptop"]);
    let port = TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    let endpoint = format!("tls/127.0.0.1:{}", port.expect("a port").port());
    let text = fs::read_to_string(&secured.file).expect("ours");
    let text =
        text.replace("[zenoh]\n", &format!("[zenoh]\nlisten.endpoints = [\"{endpoint}\"]\n"));
    let listening = secured.office.write("listening.toml", &text);
    secured.office.up_from(&listening, "reasoning");
    let file = |name: &str| secured.office.folder().join("keys").join(name).display().to_string();
    let settings = serde_json::json!({
        "mode": "client",
        "connect": { "endpoints": [endpoint] },
        "scouting": { "multicast": { "enabled": false } },
        "transport": { "link": { "tls": {
            "enable_mtls": true,
            "verify_name_on_connect": false,
            "root_ca_certificate": file("authority.pem"),
            "connect_private_key": file("anna-laptop.key"),
            "connect_certificate": file("anna-laptop.pem"),
        } } },
    });
    let _rogue = Rogue::shout(&secured.office, &settings);
    await_rejected(&secured.office, "reasoning", "oversized");
}

#[test]
fn an_oversized_message_of_an_unknown_sender_is_counted() {
    let mut office = Office::new();
    office.up(&["reasoning"], &[]);
    let socket = office.runtime_folder().join("smart-office/reasoning.sock");
    let settings = serde_json::json!({
        "mode": "client",
        "connect": { "endpoints": [format!("unixsock-stream/{}", socket.display())] },
        "scouting": { "multicast": { "enabled": false } },
    });
    let _rogue = Rogue::shout(&office, &settings);
    await_rejected(&office, "reasoning", "oversized");
}
