//! A firm borrows the robot of a house, over two Zenoh meshes and real processes: the room is
//! really swept, the house receives none of the firm's names or reasons, and when the robot's
//! process is killed, its proxy agent leaves the firm too.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use acl::{DaemonId, EcosystemId};
use building::{Building, Layout};
use substrate_zenoh::{Config, SessionMode, Tap};
use tokio::sync::mpsc;

use crate::support::{Office, PATIENCE, stderr, stdout};

/// Names of the firm that must never reach the house: its things, its vocabulary, its agents.
const SECRETS: &[&str] = &[
    "red-room",
    "blue-room",
    "archive",
    "hallway",
    "elevator",
    "entrance",
    "merger",
    "interviews",
    "old-files",
    "used-for",
    "confidential",
    "next-to",
    "stands-in",
    "paces",
    "tidy",
    "walk",
    "cleaner",
    "front-desk",
    "caretaker-desk",
    "purpose",
];

fn ecosystem(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../../ecosystems/{name}.toml"))
}

/// The building that matches the house's map, with a truth that only this test sees.
fn house() -> Building {
    let mut layout = Layout::new();
    for room in ["room-217", "room-218", "room-219", "boiler-room"] {
        layout.add_room(room, 20.0).expect("a room");
    }
    for corridor in ["corridor-2", "lift", "lobby"] {
        layout.add_corridor(corridor, 20.0).expect("a corridor");
    }
    for (a, b, meters) in [
        ("corridor-2", "room-217", 4.0),
        ("corridor-2", "room-218", 6.0),
        ("corridor-2", "room-219", 9.0),
        ("corridor-2", "lift", 5.0),
        ("lift", "lobby", 8.0),
        ("lobby", "boiler-room", 3.0),
    ] {
        layout.connect(a, b, meters).expect("a door");
    }
    layout.add_robot("sweeper-1", "lobby", 0.5).expect("a robot");
    Building::new(layout, 0.02).expect("fifty times as fast")
}

/// Receives all messages of an ecosystem on the house's mesh.
async fn tap(office: &Office, name: &str, of: &str) -> (Tap, mpsc::UnboundedReceiver<String>) {
    let (tell, heard) = mpsc::unbounded_channel();
    let ecosystem = EcosystemId::new(of).expect("a name");
    let mut config = Config::new(ecosystem, DaemonId::new(name).expect("a name"));
    config.mode = SessionMode::Client;
    let socket = office.runtime_folder().join("house/caretaker.sock");
    config.connect = vec![format!("unixsock-stream/{}", socket.display())];
    let tap = substrate_zenoh::tap(config, move |key, message| {
        let _ = tell.send(format!("{key} {}", String::from_utf8_lossy(&message.payload)));
    });
    (tap.await.expect("the house runs"), heard)
}

fn firm(office: &Office, arguments: &[&str]) -> (Option<i32>, String) {
    let file = ecosystem("firm").display().to_string();
    let output = office.run(&[arguments, &["--ecosystem", &file]].concat());
    (output.status.code(), format!("{}{}", stdout(&output), stderr(&output)))
}

/// Waits until the firm sees the robot, or no longer sees it.
fn await_cleaner(office: &Office, is_there: bool) {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let (_, agents) = firm(office, &["agents"]);
        if agents.contains("cleaner") == is_there {
            return;
        }
        assert!(Instant::now() < deadline, "cleaner {is_there}: {agents}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_firm_borrows_the_robot_without_revealing_the_reason() {
    let mut office = Office::of(ecosystem("house"));
    let house = house();
    let socket = office.runtime_folder().parent().expect("a folder").join("building.sock");
    let _server = building::serve(house.handle(), &socket).await.expect("served");
    // The tenant has a network of its own; the two ecosystems never share one.
    let mut office = tokio::task::spawn_blocking(move || {
        office.up(&["sweeper-laptop", "caretaker"], &[]);
        office.await_devices(1);
        office.up_from(&ecosystem("firm"), "front-desk");
        await_cleaner(&office, true);
        office
    })
    .await
    .expect("no panic");
    let (_tap, mut heard) = tap(&office, "stranger", "house").await;
    let (_other, mut leaked) = tap(&office, "spy", "firm").await;

    office = tokio::task::spawn_blocking(move || {
        let (code, said) = firm(&office, &["goal", "merger"]);
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("done     the goal holds"), "{said}");
        office
    })
    .await
    .expect("no panic");

    let truth = house.truth();
    assert_eq!((truth.swept_count("room-217"), truth.swept_count("room-218")), (1, 0));
    let mut lines = Vec::new();
    // Reads up to a heartbeat after everything else: all earlier messages have arrived by then.
    loop {
        let line = tokio::time::timeout(PATIENCE, heard.recv()).await.expect("heartbeats come");
        let line = line.expect("the tap lives");
        let is_beat = line.contains("\"of\":\"heartbeat\"") && line.contains("(swept room-217)");
        lines.push(line);
        if is_beat {
            break;
        }
    }
    assert!(lines.iter().any(|line| line.contains("sweep sweeper-1 room-217")), "{lines:#?}");
    for word in SECRETS {
        let said = lines.iter().find(|line| line.contains(word));
        assert!(said.is_none(), "the house heard `{word}`: {said:?}");
    }
    assert!(leaked.try_recv().is_err(), "the firm's own words are not on the house's wire");

    tokio::task::spawn_blocking(move || {
        office.kill("sweeper-laptop");
        let began = Instant::now();
        await_cleaner(&office, false);
        assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
        let (code, said) = firm(&office, &["goal", "meeting-rooms"]);
        assert_ne!(code, Some(0), "{said}");
        assert!(said.contains("tidy"), "it says what is missing: {said}");
    })
    .await
    .expect("no panic");
    assert_eq!(house.truth().swept_count("room-218"), 0);
}
