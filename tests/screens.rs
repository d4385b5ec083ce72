//! A Chromecast, by the lines of docs/screens.md: from the config to a goal. The device is a
//! stand-in in the process of the test; what it shows decides.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use tokio::runtime::Runtime;

use crate::cast_device::{CastDevice, media_server};
use crate::support::{Office, PATIENCE, lab, stderr};

const DOCUMENT: &str = include_str!("../docs/screens.md");

/// Pause between two looks at the device.
const LOOK_AGAIN: Duration = Duration::from_millis(20);

/// Returns the entry of the document, with the device and its media at other addresses.
fn entry(device: &CastDevice, server: &str) -> String {
    let mut blocks = DOCUMENT.split("```").skip(1).step_by(2);
    let block = blocks.find(|block| block.contains("driver = \"cast\"")).expect("an example");
    let block = block.strip_prefix("toml").expect("TOML");
    let changed = block
        .replace("\"10.0.0.7\"", &format!("\"{}\"", device.address))
        .replace("http://10.0.0.2:8000", server);
    assert_ne!(block, changed);
    changed
}

/// A process that ends with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn until(what: &str, is_so: impl Fn() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !is_so() {
        assert!(Instant::now() < deadline, "{what} is not so");
        std::thread::sleep(LOOK_AGAIN);
    }
}

#[test]
fn a_chromecast_reaches_a_goal_and_shows_it_again_when_somebody_closes_it() {
    let runtime = Runtime::new().expect("a runtime");
    let (device, server) =
        runtime.block_on(async { (CastDevice::start().await, media_server().await) });
    let office = Office::new();
    let entry = entry(&device, &server);
    let mistaken = lab("decentralized") + &entry.replace("address = ", "adress = ");
    let wrong = office.write("wrong.toml", &mistaken);
    let checked = office.run(&["check", &wrong.display().to_string()]);
    let said = stderr(&checked);
    assert!(!checked.status.success() && said.contains("adress"), "{said}");

    let file = office.write("lab.toml", &(lab("decentralized") + &entry));
    let checked = office.run(&["check", &file.display().to_string()]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_fact("(can-present conf-room)", true);
    assert_eq!(device.app(), None, "the device is left as it is");

    let ecosystem = office.file.display().to_string();
    let goal = ["goal", "(presented film conf-room)", "--maintain", "--ecosystem", &ecosystem];
    let mut asking = office.command(&goal);
    asking.stdout(Stdio::null()).stderr(Stdio::null());
    let _asking = Ends(asking.spawn().expect("the binary is built"));
    let film = Some(format!("{server}/film.mp4"));
    until("the film is shown", || device.shows() == film);
    office.await_fact("(presented film conf-room)", true);
    // Somebody closes the app by a telephone, and the goal is kept.
    device.change_app(None);
    until("the film is shown again", || device.shows() == film);
    assert_eq!(device.count("LAUNCH"), 2);
    device.hang_up();
    until("it is loaded after a reconnection", || device.count("LOAD") == 3);
    office.await_fact("(presented film conf-room)", true);
}
