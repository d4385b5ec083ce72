//! Tests against a real kernel, in which real drivers of Industrial I/O read simulated chips.
//!
//! The kernel runs this same test program, and [`inside`] reads values, changes them, and unplugs
//! and plugs in devices. The output of the program is compared with the values in the chips'
//! registers.

#[path = "../../../../tests/support/kernel.rs"]
mod kernel;

use std::path::Path;
use std::process::Command;

use kernel::{SAID, THERMOMETER, said_in};
use linux_sensors::{Sysfs, SysfsQuantity};

#[test]
fn a_real_kernels_sensors_are_read_unplugged_and_plugged_in() {
    let folder = tempfile::tempdir().expect("a folder");
    let program = std::env::current_exe().expect("it runs");
    // Besides the thermometer, there are two light sensors, one of which does not answer.
    let script = format!(
        "i2cset -y 0 0x13 0x81 0x21 b
        echo apds9300 0x29 > new_device
        echo vcnl4010 0x13 > new_device
        {} inside --exact --ignored --nocapture",
        program.display()
    );
    let Some(said) = said_in(folder.path(), 128, &script) else { return };
    let expected = [
        "apds9300@i2c-0/0-0029 light Ok(0.0)",
        "tmp006@i2c-0/0-0040 temperature Ok(25.0)",
        "vcnl4010@i2c-0/0-0013 light Err",
        "warmer Ok(26.5)",
        "unplugged true false",
        "plugged in elsewhere Ok(26.5)",
    ];
    assert_eq!(said, expected);
}

/// Part of the test that runs inside the tested kernel, in another process of this test program.
#[test]
#[ignore = "a part of the test above, which runs it where it belongs"]
fn inside() {
    let sysfs = Sysfs::default();
    for channel in sysfs.channels() {
        let value =
            channel.read().map_or_else(|_| "Err".to_owned(), |value| format!("Ok({value:?})"));
        println!("{SAID}{} {} {value}", channel.device, channel.quantity);
    }
    let find = || sysfs.find(THERMOMETER, SysfsQuantity::Temperature, None);
    let channel = find().expect("it was plugged in");
    // 26.5 degrees: in units of 1/32 degree, shifted left by two bits, in big-endian order.
    set("0x01", "0x400D");
    println!("{SAID}warmer {:?}", channel.read().map_err(|error| error.to_string()));

    // The light sensor is unplugged as well, so that the thermometer returns with another number.
    tell("delete_device", "0x40");
    tell("delete_device", "0x13");
    println!("{SAID}unplugged {} {}", channel.read().is_err(), find().is_ok());
    tell("new_device", "vcnl4010 0x13");
    tell("new_device", "tmp006 0x40");
    let again = find().expect("it was plugged in");
    assert_ne!(again, channel, "its files are elsewhere");
    println!("{SAID}plugged in elsewhere {:?}", again.read().map_err(|error| error.to_string()));
}

fn set(register: &str, word: &str) {
    let done = Command::new("i2cset").args(["-f", "-y", "0", "0x40", register, word, "w"]).status();
    assert!(done.expect("it is installed").success());
}

fn tell(file: &str, words: &str) {
    std::fs::write(Path::new("/sys/bus/i2c/devices/i2c-0").join(file), words).expect("root's own");
}
