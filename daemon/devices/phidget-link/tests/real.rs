//! Tests of the real `libphidget22` from PyPI's wheel, without a Phidget: loading the library, and
//! its errors about devices that are not attached.

#[path = "../../../../tests/support/left_out.rs"]
mod left_out;

use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use phidget_link::{Library, PartAddress, PhidgetChannel, PhidgetPart, PhidgetQuantity};

/// Name of the environment variable with the folder or file of the library.
const NAMED: &str = "ALTHING_TEST_LIBPHIDGET22";

/// Returns the installed library. If it is not installed, prints a message and returns `None`.
fn library() -> Option<Library> {
    let found = match std::env::var_os(NAMED).map(PathBuf::from).or_else(packages) {
        Some(folder) => Library::load(Some(&folder)),
        None => Library::load(None),
    };
    match found {
        Ok(library) => Some(library),
        Err(problem) => {
            left_out::left_out(&format!(
                "failed to {problem}: pip install phidget22, apt-get install libusb-1.0-0"
            ));
            None
        }
    }
}

/// Returns the folder of Python's packages that contains `phidget22`; `None` if it is not
/// installed.
fn packages() -> Option<PathBuf> {
    let script = "import Phidget22; print(list(Phidget22.__path__)[0])";
    let said = Command::new("python3").args(["-c", script]).output().ok()?;
    let folder = PathBuf::from(String::from_utf8(said.stdout).ok()?.trim());
    said.status.success().then(|| folder.parent().map(PathBuf::from))?
}

#[test]
fn the_library_loads_and_reports_its_version() {
    let Some(library) = library() else { return };
    let version = library.version().expect("it says so");
    println!("{version}");
    assert!(version.starts_with("Phidget22 - Version "), "{version}");
}

/// The test also works if Phidgets are attached, because none of them has the requested serial
/// number.
#[test]
fn a_missing_device_is_reported_with_the_reason() {
    let Some(library) = library() else { return };
    for (name, quantity, hub_port, port) in [
        (None, PhidgetQuantity::Temperature, None, None),
        (None, PhidgetQuantity::Humidity, Some(2), None),
        (None, PhidgetQuantity::Light, Some(2), None),
        (Some("1125"), PhidgetQuantity::Humidity, None, Some(3)),
        (Some("1111"), PhidgetQuantity::Motion, Some(0), None),
        (Some("1142"), PhidgetQuantity::Light, None, Some(0)),
        (Some("digital"), PhidgetQuantity::Motion, None, Some(7)),
    ] {
        let address = PartAddress { serial: Some(987_654), hub_port, port };
        let part = PhidgetPart::find(name, quantity).expect("a part");
        let (began, wait) = (Instant::now(), Duration::from_millis(100));
        let mut channel = PhidgetChannel::open(library, part, address, wait).expect("a channel");
        assert!(began.elapsed() >= wait && began.elapsed() < Duration::from_secs(5));
        assert!(!channel.is_attached());
        let problem = channel.read().expect_err("it is not here").to_string();
        let expected = format!("find {part} at {address}: Timed Out");
        assert!(problem.starts_with(&expected), "{problem} is not {expected}");
        println!("failed to {problem}");
    }
}
