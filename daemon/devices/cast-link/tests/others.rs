//! Programs that others wrote: PyPI's pychromecast, a client, with the stand-in, so that the
//! stand-in speaks as a Chromecast does; and PyPI's zeroconf, which announces a Chromecast.

#[path = "../../../../tests/support/cast_device.rs"]
mod cast_device;
#[path = "../../../../tests/support/left_out.rs"]
mod left_out;

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use cast_device::{CastDevice, media_server};
use cast_link::{FoundCast, discover};

/// Time for which answers are awaited.
const SEARCH: Duration = Duration::from_millis(1500);

fn script() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pychromecast_client.py")
}

/// Whether Python has pychromecast, and with it zeroconf; reports it if not.
fn has_pychromecast() -> bool {
    let run = Command::new("python3").args(["-c", "import pychromecast, zeroconf"]).output();
    let is_there = run.is_ok_and(|run| run.status.success());
    if !is_there {
        left_out::left_out("it needs pychromecast for python3: pip install pychromecast==14.0.10");
    }
    is_there
}

#[tokio::test(flavor = "multi_thread")]
async fn another_client_understands_the_stand_in() {
    if !has_pychromecast() {
        return;
    }
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut client = Command::new("python3");
    client.arg(script()).arg("127.0.0.1").arg(device.address.port().to_string());
    client.arg(format!("{server}/film.mp4"));
    let run = tokio::task::spawn_blocking(move || client.output().expect("Python runs"));
    let run = run.await.expect("no panic");
    let (said, complaint) =
        (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{said}{complaint}");
    let expected = [
        "no app",
        "app CC1AD845",
        "playing",
        "the film",
        "volume 0.25",
        "idle ERROR",
        "no app again",
    ];
    assert_eq!(said.lines().collect::<Vec<_>>(), expected, "{complaint}");
    assert_eq!((device.app(), device.count("LAUNCH")), (None, 1));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_chromecast_that_is_announced_is_found() {
    if !has_pychromecast() {
        return;
    }
    let mut announcing = Command::new("python3")
        .arg(script())
        .args(["announce", "Living Room \u{1f4fa}", "32187"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python runs");
    let mut line = String::new();
    let mut output = BufReader::new(announcing.stdout.take().expect("a pipe"));
    output.read_line(&mut line).expect("it says so");
    // The question goes to this machine alone, and not to the network in which the test runs.
    let found = discover("127.0.0.1:5353".parse().expect("an address"), SEARCH).await;
    drop(announcing.stdin.take());
    let ended = announcing.wait().expect("our own child");
    assert!(ended.success() && line == "announced\n", "{line}");
    let expected = FoundCast {
        id: "6c1f00aa".to_owned(),
        name: "Living Room \u{1f4fa}".to_owned(),
        model: "Chromecast Ultra".to_owned(),
        address: "127.0.0.1:32187".to_owned(),
    };
    let found = found.expect("the network is asked");
    assert!(found.contains(&expected), "{found:?}");
}
