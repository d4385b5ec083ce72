//! Daemons on several machines find each other: on one network by scouting, across networks by
//! configured connections, through each other and through a plain router, and after crashes,
//! restarts and changes of address. Two ecosystems on one network stay separate.
//!
//! The machines are network namespaces, so messages cross real wires.

use std::path::PathBuf;
use std::process::{Child, Stdio};

use crate::support::network::{LAN, Site, example, has, secured, smart_office};
use crate::support::{PATIENCE, lines};

const BOARDS: [&str; 3] = ["reasoning", "turtlebot-laptop", "office2-pi"];
const AGENTS: [&str; 3] = ["plan-requester", "turtlebot-1", "thermometer-office2"];

const SCOUTING: &str = "scouting = true";
/// No scouting: daemons meet only by configured connections.
const CALLING: &str = "scouting = false\nlisten.endpoints = [\"tls/0.0.0.0:7447\"]";

/// Requests a goal on a machine and waits until it is reached.
#[track_caller]
fn reaches(site: &Site, machine: &str, goal: &str) {
    let (code, said) = site.ask(machine, &["goal", goal]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("holds"), "{said}");
}

#[test]
fn daemons_of_one_network_find_each_other() {
    let office = secured(&smart_office(SCOUTING), &BOARDS);
    let Some(mut site) = Site::on_lan(office, &BOARDS) else { return };
    BOARDS.iter().for_each(|board| site.up(board, &[]));
    site.await_all(&BOARDS, &AGENTS);
    reaches(&site, "turtlebot-laptop", "(known-temperature office2)");
    reaches(&site, "office2-pi", "(known-temperature office1)");
}

/// `office2-pi` and `reasoning` are on different networks and can reach only `corridor-pi`, which
/// is on both.
#[test]
fn daemons_on_two_networks_are_linked_through_a_third() {
    let names = ["reasoning", "corridor-pi", "office2-pi"];
    let Some(mut site) = Site::new(secured(&smart_office(CALLING), &names)) else { return };
    two_networks(&mut site, "corridor-pi");
    site.up("reasoning", &["--connect", "tls/10.0.1.1:7447"]);
    site.up("office2-pi", &["--connect", "tls/10.0.2.1:7447"]);
    // A daemon goes on trying to connect to one that has not started yet.
    site.up("corridor-pi", &[]);
    site.await_all(&names, &["plan-requester", "camera-1", "thermometer-office2"]);
    reaches(&site, "reasoning", "(known-temperature office2)");
}

/// The two ends are linked through a plain Zenoh router in the middle.
#[test]
fn daemons_on_two_networks_are_linked_through_a_router() {
    let names = ["reasoning", "standing-router", "office2-pi"];
    let Some(mut site) = Site::new(secured(&smart_office(CALLING), &names)) else { return };
    two_networks(&mut site, "standing-router");
    let _router = router(&site, "standing-router");
    site.up("reasoning", &["--connect", "tls/10.0.1.1:7447"]);
    site.up("office2-pi", &["--connect", "tls/10.0.2.1:7447"]);
    site.await_all(&["reasoning", "office2-pi"], &["plan-requester", "thermometer-office2"]);
    reaches(&site, "office2-pi", "(known-temperature office2)");
}

/// Three daemons are configured with the hub only, but can reach each other.
#[test]
fn daemons_stay_linked_when_their_hub_dies_and_returns() {
    let names = [&BOARDS[..], &["corridor-pi"]].concat();
    let told = CALLING.replace("scouting = false", "scouting.multicast.enabled = false");
    let Some(mut site) = Site::on_lan(secured(&smart_office(&told), &names), &names) else {
        return;
    };
    // The robot's laptop starts first: it serves the simulated building to the others.
    let call = ["--connect", "tls/10.0.0.4:7447"];
    site.up("turtlebot-laptop", &call);
    site.up("corridor-pi", &[]);
    site.up("reasoning", &call);
    site.up("office2-pi", &call);
    site.await_all(&names, &[&AGENTS[..], &["camera-1"]].concat());
    site.office.kill("corridor-pi");
    for board in BOARDS {
        site.await_seen(board, |seen| !has(seen, "camera-1"));
    }
    site.await_all(&BOARDS, &AGENTS);
    reaches(&site, "turtlebot-laptop", "(known-temperature office2)");
    site.up("corridor-pi", &[]);
    site.await_all(&names, &[&AGENTS[..], &["camera-1"]].concat());
    reaches(&site, "corridor-pi", "(known-temperature office1)");
}

#[test]
fn a_daemon_returns_under_its_name_at_a_new_address() {
    let office = secured(&smart_office(SCOUTING), &BOARDS);
    let Some(mut site) = Site::on_lan(office, &BOARDS) else { return };
    BOARDS.iter().for_each(|board| site.up(board, &[]));
    site.await_all(&BOARDS, &AGENTS);
    site.office.kill("office2-pi");
    site.await_seen("reasoning", |seen| !has(seen, "thermometer-office2"));
    site.readdress("office2-pi", "10.0.0.3", "10.0.0.99");
    site.up("office2-pi", &[]);
    site.await_all(&BOARDS, &AGENTS);
    reaches(&site, "reasoning", "(known-temperature office2)");
}

/// A board is given another address while its daemon runs.
#[test]
fn a_machine_moves_while_its_daemon_runs() {
    let office = secured(&smart_office(SCOUTING), &BOARDS);
    let Some(mut site) = Site::on_lan(office, &BOARDS) else { return };
    BOARDS.iter().for_each(|board| site.up(board, &[]));
    site.await_all(&BOARDS, &AGENTS);
    let before = site.incarnation_seen("reasoning", "thermometer-office2").expect("it is seen");
    site.readdress("office2-pi", "10.0.0.3", "10.0.0.99");
    site.await_later_incarnation("reasoning", "thermometer-office2", before);
    site.await_all(&BOARDS, &AGENTS);
    reaches(&site, "reasoning", "(known-temperature office2)");
}

/// A cable is pulled out for longer than the lease, and put in again.
#[test]
fn a_daemon_that_was_cut_off_is_found_again() {
    let office = secured(&smart_office(SCOUTING), &BOARDS);
    let Some(mut site) = Site::on_lan(office, &BOARDS) else { return };
    site.network("nowhere");
    BOARDS.iter().for_each(|board| site.up(board, &[]));
    site.await_all(&BOARDS, &AGENTS);
    site.replug("office2-pi", LAN, "nowhere");
    site.await_seen("reasoning", |seen| !has(seen, "thermometer-office2"));
    site.await_seen("office2-pi", |seen| !has(seen, "plan-requester"));
    site.replug("office2-pi", LAN, LAN);
    site.await_all(&BOARDS, &AGENTS);
    reaches(&site, "reasoning", "(known-temperature office2)");
}

/// A process is stopped for longer than the lease, as by closing a laptop's lid, and continued.
#[test]
fn a_daemon_that_was_suspended_is_seen_by_all_again() {
    let office = secured(&smart_office(SCOUTING), &BOARDS);
    let Some(mut site) = Site::on_lan(office, &BOARDS) else { return };
    BOARDS.iter().for_each(|board| site.up(board, &[]));
    site.await_all(&BOARDS, &AGENTS);
    site.office.signal("office2-pi", "STOP");
    for board in ["reasoning", "turtlebot-laptop"] {
        site.await_seen(board, |seen| !has(seen, "thermometer-office2"));
    }
    site.office.signal("office2-pi", "CONT");
    site.await_all(&BOARDS, &AGENTS);
    reaches(&site, "reasoning", "(known-temperature office2)");
}

/// Two ecosystems with the same daemons and agents, and even the same authority, use one router:
/// each finds its own daemons, and never the other's.
#[test]
fn two_ecosystems_on_one_wire_do_not_merge() {
    let names = ["reasoning", "turtlebot-laptop", "office2-pi", "standing-router"];
    let office = secured(&smart_office(CALLING), &names);
    let Some(mut site) = Site::on_lan(office, &names) else { return };
    let other = other_office(&site, "smart-office", "other-office");
    let _router = router(&site, "standing-router");
    let call = ["--connect", "tls/10.0.0.4:7447"];
    // The reasoning and the robot are in one ecosystem, the thermometer in the other. Both are
    // connected to the router before the robot starts, which is found through it.
    site.up("reasoning", &call);
    site.up_from(&other, "office2-pi", &call);
    site.up("turtlebot-laptop", &call);
    site.await_all(&["reasoning", "turtlebot-laptop"], &["plan-requester", "turtlebot-1"]);
    for board in ["reasoning", "turtlebot-laptop"] {
        assert!(!has(&site.seen(board), "thermometer-office2"), "{:?}", site.seen(board));
    }
    let seen = site.seen_in(&other, "office2-pi");
    assert_eq!(seen, ["thermometer-office2"]);
}

/// Two ecosystems scout on one network, with the same daemons, agents and authority: they do not
/// even connect. A third ecosystem with the same name but its own authority connects, and its
/// messages are rejected.
#[test]
fn two_ecosystems_that_scout_on_one_network_do_not_merge() {
    let names = ["reasoning", "turtlebot-laptop", "office2-pi"];
    let office = secured(&smart_office(SCOUTING), &names);
    let Some(mut site) = Site::on_lan(office, &[&names[..], &["stranger"]].concat()) else {
        return;
    };
    let other = other_office(&site, "smart-office", "other-office");
    let namesake = secured(&smart_office(SCOUTING), &["conf-room-pi"]);
    site.up_from(&other, "office2-pi", &[]);
    let mut stranger = site.program("stranger", env!("CARGO_BIN_EXE_althing"));
    stranger.arg("up").arg(&namesake.file).args(["--daemon", "conf-room-pi"]);
    site.office.begin_as("conf-room-pi", stranger);
    // The daemons of this ecosystem find each other while the others also scout and answer.
    site.up("reasoning", &[]);
    site.up("turtlebot-laptop", &[]);
    site.await_all(&["reasoning", "turtlebot-laptop"], &["plan-requester", "turtlebot-1"]);
    for board in ["reasoning", "turtlebot-laptop"] {
        let seen = site.seen(board);
        assert!(!has(&seen, "thermometer-office2"), "{seen:?}");
        assert!(!has(&seen, "thermometer-conf-room"), "{seen:?}");
    }
    assert_eq!(site.seen_in(&other, "office2-pi"), ["thermometer-office2"]);
}

// === shared by the tests ===

/// Puts `reasoning` on one network, `office2-pi` on another, and `middle` on both with number 1.
fn two_networks(site: &mut Site, middle: &str) {
    for machine in ["reasoning", "office2-pi", middle] {
        site.machine(machine);
    }
    for (network, number, end) in [("west", 1, "reasoning"), ("east", 2, "office2-pi")] {
        site.network(network);
        site.plug(middle, network, &format!("10.0.{number}.1"));
        site.plug(end, network, &format!("10.0.{number}.2"));
    }
}

/// Returns a file of the same ecosystem under another name.
fn other_office(site: &Site, name: &str, other: &str) -> PathBuf {
    let text = std::fs::read_to_string(&site.office.file).expect("ours");
    let named = format!("name = \"{name}\"");
    assert!(text.contains(&named), "{text}");
    site.office.write("other.toml", &text.replace(&named, &format!("name = \"{other}\"")))
}

/// A router that is no daemon, with a certificate of the ecosystem; stopped on drop.
struct Router(Child);

impl Drop for Router {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[track_caller]
fn router(site: &Site, machine: &str) -> Router {
    let keys = site.office.folder().join("keys");
    let file = |name: &str| keys.join(name).display().to_string();
    let (key, certificate) = (format!("{machine}.key"), format!("{machine}.pem"));
    let settings = serde_json::json!({
        "listen": { "endpoints": ["tls/0.0.0.0:7447"] },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "transport": { "link": { "protocols": ["tls"], "tls": {
            "enable_mtls": true,
            "verify_name_on_connect": false,
            "root_ca_certificate": file("authority.pem"),
            "listen_private_key": file(&key),
            "listen_certificate": file(&certificate),
            "connect_private_key": file(&key),
            "connect_certificate": file(&certificate),
        } } },
    });
    let settings = site.office.write("router.json5", &settings.to_string());
    let program = example("router");
    assert!(program.exists(), "build it: cargo build -p substrate-zenoh --example router");
    let mut command = site.program(machine, &program.display().to_string());
    command.arg(settings).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("it is there");
    let said = lines(&mut child).recv_timeout(PATIENCE).expect("it listens");
    assert!(said.contains("listens on"), "{said}");
    Router(child)
}
