//! Tests of channels. Each test sets, unplugs and plugs in the devices of the channels. The calls
//! use the real C interface, with a fake library.

mod fake;

use std::time::Duration;

use fake::Fake;
use phidget_link::{Library, PartAddress, PhidgetChannel, PhidgetPart, PhidgetQuantity};

const SERIAL: Option<i32> = Some(12345);
/// Time to wait for a device: enough for an attached device, and short for a missing one.
const WAIT: Duration = Duration::from_millis(20);

fn open(
    fake: &Fake,
    name: Option<&str>,
    quantity: PhidgetQuantity,
    address: PartAddress,
) -> PhidgetChannel {
    let library = Library::load(Some(&fake.library())).expect("it is there");
    let part = PhidgetPart::find(name, quantity).expect("a part");
    PhidgetChannel::open(library, part, address, WAIT).expect("a channel")
}

/// Returns the address of the input `port` of the interface kit.
fn at(port: u8) -> PartAddress {
    PartAddress { serial: SERIAL, hub_port: None, port: Some(port) }
}

fn plugged() -> Fake {
    let mut fake = Fake::new();
    fake.set("plugged", 1.0);
    fake
}

#[test]
fn every_part_is_read_with_its_type() {
    use PhidgetQuantity::{Distance, Humidity, Light, Motion, Reflection, Temperature};
    let mut fake = plugged();
    let hub = PartAddress { serial: None, hub_port: Some(2), port: None };
    for (name, quantity, address, line, says, expected) in [
        (None, Temperature, PartAddress::default(), "temperature.0.0", 21.5, 21.5),
        (None, Humidity, hub, "humidity.0.0", 40.0, 40.0),
        (None, Light, hub, "light.0.0", 320.0, 320.0),
        (Some("1125"), Temperature, at(0), "ratio.0.11252", 22.25, 22.25),
        (Some("1125"), Humidity, at(1), "ratio.1.11251", 38.0, 38.0),
        (Some("1101-2Y0A02"), Distance, at(2), "ratio.2.11013", 85.5, 0.855),
        (Some("1111"), Motion, at(3), "ratio.3.11110", -0.7, 1.0),
        (Some("1111"), Motion, hub, "ratio.hub2.11110", 0.01, 0.0),
        (Some("1103"), Reflection, at(4), "ratio.4.11030", 1.0, 1.0),
        (Some("1146"), Reflection, at(5), "ratio.5.0", 0.9, 0.0),
        (Some("1127"), Light, at(6), "voltage.6.11270", 500.0, 500.0),
        (Some("digital"), Motion, at(7), "digital.7.0", 1.0, 1.0),
    ] {
        fake.set(line, says);
        let read = open(&fake, name, quantity, address).read();
        assert!(read.as_ref().is_ok_and(|read| (read - expected).abs() < 1e-9), "{line}: {read:?}");
    }
}

#[test]
fn a_missing_device_is_reported_and_may_attach_later() {
    let mut fake = Fake::new();
    fake.set("ratio.3.11110", 0.9);
    let mut channel = open(&fake, Some("1111"), PhidgetQuantity::Motion, at(3));
    assert!(!channel.is_attached());
    let problem = channel.read().expect_err("it is not here").to_string();
    assert_eq!(
        problem,
        "find a 1111 at port 3 of Phidget 12345: Timed Out: No Phidgets were detected at all. It \
         is a fake."
    );
    fake.set("plugged", 1.0);
    assert!(channel.is_attached());
    assert_eq!(channel.read(), Ok(1.0));
}

#[test]
fn a_device_that_is_plugged_in_again_gets_its_sensor_type_again() {
    let mut fake = plugged();
    fake.set("ratio.3.11110", 0.9);
    // This value has no sensor type.
    fake.set("ratio.3.0", 0.01);
    let mut channel = open(&fake, Some("1111"), PhidgetQuantity::Motion, at(3));
    assert_eq!(channel.read(), Ok(1.0));
    fake.set("plugged", 0.0);
    assert!(!channel.is_attached());
    let problem = channel.read().expect_err("it was unplugged").to_string();
    assert_eq!(problem, "find a 1111 at port 3 of Phidget 12345: it was unplugged");
    // There was no call in between.
    fake.set("plugged", 2.0);
    assert_eq!(channel.read(), Ok(1.0));
}

#[test]
fn another_serial_number_is_another_device() {
    let mut fake = plugged();
    fake.set("serial", 777.0);
    fake.set("temperature.0.0", 20.0);
    let address = PartAddress { serial: SERIAL, ..PartAddress::default() };
    assert!(!open(&fake, None, PhidgetQuantity::Temperature, address).is_attached());
    let address = PartAddress { serial: Some(777), ..PartAddress::default() };
    assert!(open(&fake, None, PhidgetQuantity::Temperature, address).is_attached());
}

#[test]
fn errors_of_the_library_are_reported() {
    let mut fake = plugged();
    let mut channel = open(&fake, Some("1125"), PhidgetQuantity::Humidity, at(1));
    let problem = channel.read().expect_err("no such line").to_string();
    assert_eq!(problem, "read a 1125 at port 1 of Phidget 12345: Unknown or Invalid Value");
    fake.set("ratio.1.11251", 40.0);
    fake.set("fail_every", 2.0);
    let read: Vec<_> = (0..4).map(|_| channel.read().is_ok()).collect();
    assert_eq!(read, [true, false, true, false]);

    let library = Library::load(Some(&fake.library())).expect("it is there");
    let part = PhidgetPart::find(Some("1111"), PhidgetQuantity::Motion).expect("a part");
    let problem = PhidgetChannel::open(library, part, at(8), WAIT).err().expect("there are 8");
    let expected = "choose a port (for a 1111 at port 8 of Phidget 12345): Unexpected Error";
    assert_eq!(problem.to_string(), expected);
}

#[test]
fn dropping_a_channel_closes_and_deletes_it() {
    let fake = plugged();
    for port in 0..3 {
        drop(open(&fake, Some("1111"), PhidgetQuantity::Motion, at(port)));
    }
    let counts = ["create", "open", "close", "delete"].map(|what| fake.count(what));
    assert_eq!(counts, [3, 3, 3, 3]);
}

#[test]
fn a_channel_can_move_between_threads() {
    let mut fake = plugged();
    fake.set("temperature.0.0", 20.0);
    let mut channel = open(&fake, None, PhidgetQuantity::Temperature, PartAddress::default());
    for _ in 0..8 {
        let reader = std::thread::spawn(move || {
            assert_eq!(channel.read(), Ok(20.0));
            channel
        });
        channel = reader.join().expect("it reads");
    }
}

#[test]
fn a_library_is_loaded_once_and_reports_its_version() {
    let fake = Fake::new();
    let version = || Library::load(Some(&fake.library())).expect("it is there").version();
    assert_eq!(version().as_deref(), Ok("Phidget22 - Version 0.0 - a fake"));
    std::fs::remove_file(fake.library()).expect("it was there");
    assert!(version().is_ok(), "it is loaded for good");
}
