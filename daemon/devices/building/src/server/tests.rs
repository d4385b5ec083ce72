//! Tests of the socket's client and server together, and of clients that send other lines.

use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::time::Duration;

use tempfile::TempDir;
use tokio::io::AsyncWriteExt as _;
use tokio::net::{UnixListener, UnixStream};
use tokio::time::timeout;

use super::{CLIENTS_MAX, Server, serve};
use crate::fixture::{log_lines, office};
use crate::wire::{IN_FLIGHT_MAX, LINE_MAX, LineReader};
use crate::{
    Building, BuildingEvent, BuildingHandle, DeviceError, DeviceFault, Layout, ServeError, Truth,
};

/// Time limit of each test. A socket works in real time, but no test should come near this limit.
const PATIENCE: Duration = Duration::from_secs(20);

struct Served {
    building: Building,
    server: Server,
    folder: TempDir,
}

impl Served {
    fn path(&self) -> PathBuf {
        self.folder.path().join("building.sock")
    }

    async fn connect(&self) -> BuildingHandle {
        BuildingHandle::connect(self.path()).await.unwrap()
    }

    async fn wait_for(&self, what: impl Fn(&BuildingEvent) -> bool) -> Truth {
        timeout(PATIENCE, self.building.wait_for(|truth| truth.any(&what))).await.unwrap()
    }
}

async fn serve_building(building: Building) -> Served {
    let folder = tempfile::tempdir().unwrap();
    let server = serve(building.handle(), folder.path().join("building.sock")).await.unwrap();
    Served { building, server, folder }
}

/// Returns a served building. A trip in it takes thirteen seconds, which is long enough to test
/// changes during a trip.
async fn served() -> Served {
    serve_building(office()).await
}

fn departed(event: &BuildingEvent) -> bool {
    matches!(event, BuildingEvent::Departed { .. })
}

fn stayed(event: &BuildingEvent) -> bool {
    matches!(event, BuildingEvent::Stayed { .. })
}

#[tokio::test]
async fn drivers_in_both_processes_have_the_same_effects() {
    let fast = || Building::new(Layout::seeded(0).layout, 0.001).unwrap();
    let (near, far) = (fast(), serve_building(fast()).await);
    for handle in [near.handle(), far.connect().await] {
        handle.navigate("turtlebot-1", "office1").await.unwrap();
        assert_eq!(handle.place_of("ir-1").await.unwrap(), "office1");
        assert_eq!(handle.read_temperature("ir-1").await.unwrap().celsius, 20.5);
        let refused = handle.navigate("turtlebot-1", "office2").await.unwrap_err();
        assert!(matches!(&refused, DeviceError::NoWay { ways, .. } if ways == &["corridor"]));
    }
    assert_eq!(log_lines(&near.truth()), log_lines(&far.building.truth()));
}

#[tokio::test]
async fn only_this_user_can_use_the_socket_and_the_end_of_serving_removes_it() {
    let served = served().await;
    let mode = std::fs::metadata(served.path()).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let others = std::fs::read_dir(served.folder.path()).unwrap().count();
    assert_eq!(others, 1, "nothing but the socket is left in the folder");
    drop(served.server);
    assert_eq!(std::fs::read_dir(served.folder.path()).unwrap().count(), 0);
}

#[tokio::test]
async fn a_live_server_and_a_file_are_left_alone_and_a_dead_socket_is_replaced() {
    let first = served().await;
    let second = serve(first.building.handle(), first.path()).await;
    assert!(matches!(second, Err(ServeError::InUse { .. })), "{second:?}");
    let dead = first.folder.path().join("dead.sock");
    drop(UnixListener::bind(&dead).unwrap());
    let revived = serve(first.building.handle(), &dead).await;
    assert!(revived.is_ok(), "{revived:?}");
    let file = first.folder.path().join("notes.txt");
    std::fs::write(&file, "mine").unwrap();
    let refused = serve(first.building.handle(), &file).await;
    assert!(matches!(refused, Err(ServeError::NotASocket { .. })), "{refused:?}");
    assert_eq!(std::fs::read(&file).unwrap(), b"mine");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_of_many_rivals_replaces_a_dead_server() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("building.sock");
    for _ in 0..20 {
        let _ = std::fs::remove_file(&path);
        drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
        let rivals = (0..8).map(|_| tokio::spawn(serve(office().handle(), path.clone())));
        let rivals: Vec<_> = rivals.collect();
        let mut servers = Vec::new();
        for rival in rivals {
            match rival.await.unwrap() {
                Ok(server) => servers.push(server),
                Err(error) => assert!(matches!(error, ServeError::InUse { .. }), "{error}"),
            }
        }
        assert_eq!(servers.len(), 1);
    }
}

#[tokio::test]
async fn a_trip_is_cancelled_when_its_future_is_dropped() {
    let served = served().await;
    let driver = served.connect().await;
    tokio::select! {
        arrived = driver.navigate("turtlebot-1", "office1") => panic!("{arrived:?}"),
        _ = served.wait_for(departed) => (),
    }
    served.wait_for(stayed).await;
    assert_eq!(driver.place_of("turtlebot-1").await.unwrap(), "corridor");
}

#[tokio::test]
async fn the_trips_of_a_dead_client_are_cancelled() {
    let served = served().await;
    let mut dying = UnixStream::connect(served.path()).await.unwrap();
    let ask = br#"{"id":1,"ask":{"navigate":{"robot":"turtlebot-1","to":"office1"}}}"#;
    dying.write_all(&[ask.as_slice(), b"\n"].concat()).await.unwrap();
    served.wait_for(departed).await;
    drop(dying);
    served.wait_for(stayed).await;
}

#[tokio::test]
async fn the_end_of_a_server_fails_open_requests_and_its_successor_is_found() {
    let served = served().await;
    let driver = served.connect().await;
    let path = served.path();
    let Served { building, server, folder: _folder } = served;
    let killed = async {
        building.wait_for(|truth| truth.any(departed)).await;
        drop(server);
    };
    let trip = driver.navigate("turtlebot-1", "office1");
    let (arrived, ()) = timeout(PATIENCE, async { tokio::join!(trip, killed) }).await.unwrap();
    assert!(matches!(arrived, Err(DeviceError::Unreachable { .. })), "{arrived:?}");
    let alone = driver.place_of("turtlebot-1").await.unwrap_err();
    assert!(alone.to_string().starts_with("reach the building: no building is served at"));
    let _successor = serve(building.handle(), path).await.unwrap();
    assert_eq!(driver.place_of("turtlebot-1").await.unwrap(), "corridor");
}

/// Tokio's clock is paused, so that waiting for the silence limit takes no real time.
#[tokio::test(start_paused = true)]
async fn a_frozen_server_is_detected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frozen.sock");
    let _frozen = UnixListener::bind(&path).unwrap();
    let driver = BuildingHandle::connect(&path).await.unwrap();
    let reading = driver.read_temperature("ir-1").await;
    assert!(matches!(reading, Err(DeviceError::Unreachable { .. })), "{reading:?}");
}

/// Writes raw lines to the socket and returns the raw answers.
async fn answers(served: &Served, lines: &[&[u8]]) -> Vec<String> {
    let (reader, mut writer) = UnixStream::connect(served.path()).await.unwrap().into_split();
    let mut reader = LineReader::new(reader);
    let mut answers = Vec::new();
    for line in lines {
        writer.write_all(&[line, b"\n".as_slice()].concat()).await.unwrap();
        loop {
            let next = timeout(PATIENCE, reader.next()).await.unwrap();
            match next.ok().flatten().map(|line| String::from_utf8(line).unwrap()) {
                Some(line) if line == r#""alive""# => (),
                Some(line) => break answers.push(line),
                None => return answers,
            }
        }
    }
    answers
}

#[tokio::test]
async fn invalid_lines_are_answered_and_do_no_harm() {
    let served = served().await;
    let deep = "[".repeat(LINE_MAX - 1);
    let nonsense: &[&[u8]] = &[
        b"",
        b"\xff\xfe\x00",
        b"null",
        b"{\"id\":-1}",
        b"{\"id\":7,\"ask\":{\"set-temperature\":{\"location\":\"office1\"}}}",
        b"{\"id\":8,\"ask\":{\"navigate\":{\"robot\":3}}}",
        deep.as_bytes(),
    ];
    let refusals = answers(&served, nonsense).await;
    assert_eq!(refusals.len(), nonsense.len());
    for refusal in &refusals {
        assert!(refusal.contains("not understood"), "{refusal}");
    }
    assert!(refusals[4].starts_with(r#"{"failed":{"id":7,"#), "{}", refusals[4]);
    let newer = br#"{"id":9,"ask":{"place-of":{"device":"ir-1","floor":2}},"token":"x"}"#;
    assert_eq!(
        answers(&served, &[newer]).await,
        [r#"{"done":{"id":9,"answer":{"place":"corridor"}}}"#]
    );
    let endless = vec![b'x'; LINE_MAX + 1];
    assert_eq!(answers(&served, &[&endless]).await, Vec::<String>::new(), "it is cut off");
    served.connect().await.place_of("ir-1").await.unwrap();
}

#[tokio::test]
async fn the_numbers_of_requests_and_clients_are_bounded() {
    let served = served().await;
    served.building.break_device("ir-1", DeviceFault::Hangs).unwrap();
    let mut stream = UnixStream::connect(served.path()).await.unwrap();
    for id in 0..=IN_FLIGHT_MAX {
        let ask =
            format!("{{\"id\":{id},\"ask\":{{\"read-temperature\":{{\"sensor\":\"ir-1\"}}}}}}\n");
        stream.write_all(ask.as_bytes()).await.unwrap();
    }
    let mut lines = LineReader::new(stream);
    let refused = async {
        loop {
            let line = lines.next().await.unwrap().unwrap();
            if line != br#""alive""# {
                break String::from_utf8(line).unwrap();
            }
        }
    };
    let refusal = timeout(PATIENCE, refused).await.unwrap();
    assert!(refusal.contains("64 requests are under way"), "{refusal}");

    let mut clients = Vec::new();
    for _ in 1..CLIENTS_MAX {
        let client = served.connect().await;
        client.place_of("ir-1").await.unwrap();
        clients.push(client);
    }
    let turned_away = served.connect().await.place_of("ir-1").await;
    assert!(matches!(turned_away, Err(DeviceError::Unreachable { .. })), "{turned_away:?}");
    drop(lines);
    drop(clients);
}

#[tokio::test]
async fn a_driver_may_start_before_the_building() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("building.sock");
    let driver = BuildingHandle::at(&path);
    assert!(matches!(driver.place_of("ir-1").await, Err(DeviceError::Unreachable { .. })));
    let _server = serve(office().handle(), &path).await.unwrap();
    assert_eq!(driver.place_of("ir-1").await.unwrap(), "corridor");
}
