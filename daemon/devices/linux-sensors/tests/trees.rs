//! Tests of channels in trees of files such as a kernel has: a captured tree, and small ones that
//! follow the kernel's documentation.

use std::path::Path;

use linux_sensors::{FindError, ReadError, Sysfs, SysfsQuantity};
use tempfile::TempDir;

/// Creates a tree of files from lines: `PATH: TEXT` is a file, `PATH -> TARGET` a link, and `PATH
/// fails` a file that cannot be read.
fn lay(tree: &str) -> (TempDir, Sysfs) {
    let folder = tempfile::tempdir().expect("a folder");
    for line in tree.lines().map(str::trim).filter(|line| !line.starts_with('#')) {
        let at = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().expect("below the root")).expect("a folder");
            path
        };
        if let Some((path, target)) = line.split_once(" -> ") {
            std::os::unix::fs::symlink(target, at(path)).expect("a link");
        } else if let Some(path) = line.strip_suffix(" fails") {
            // Reading a folder fails, as reading from a bus can.
            std::fs::create_dir_all(at(path)).expect("a folder");
        } else if let Some((path, text)) = line.split_once(": ") {
            std::fs::write(at(path), format!("{text}\n")).expect("a file");
        }
    }
    let sysfs = Sysfs::new(folder.path());
    (folder, sysfs)
}

/// Returns a line for each channel: device, name, quantity, and value or error.
fn said(sysfs: &Sysfs) -> Vec<String> {
    let line = |channel: &linux_sensors::SensorChannel| {
        let value = channel.read().map_or_else(|error| error.to_string(), |it| format!("{it:.3}"));
        let inside = if channel.is_ambient { "" } else { " inside" };
        format!("{} {} {} {value}{inside}", channel.device, channel.name, channel.quantity)
    };
    sysfs.channels().iter().map(line).collect()
}

#[test]
fn a_captured_tree_is_read_with_the_units_of_that_kernel() {
    let (_folder, sysfs) = lay(include_str!("trees/i2c.txt"));
    let said = said(&sysfs);
    assert_eq!(said[0], "apds9300@i2c-0/0-0029 illuminance0 light 0.000");
    assert_eq!(said[1], "tmp006@i2c-0/0-0040 temp temperature 25.000");
    assert!(said[2].starts_with("vcnl4010@i2c-0/0-0013 illuminance light read `"), "{}", said[2]);
    assert_eq!(said.len(), 3, "voltages, intensities and what is merely close have no unit here");
}

#[test]
fn each_form_of_a_value_is_read() {
    for (tree, expected) in [
        // One device with processed and raw values; scales for one channel and for all.
        (
            "bus/iio/devices/iio:device3 -> ../../../devices/soc/i2c-1/1-0076/iio:device3
             devices/soc/i2c-1/1-0076/name: bme280
             devices/soc/i2c-1/1-0076/iio:device3/in_temp_input: 21870
             devices/soc/i2c-1/1-0076/iio:device3/in_temp_raw: 7
             devices/soc/i2c-1/1-0076/iio:device3/in_humidityrelative_input: 41500",
            &[
                "bme280@i2c-1/1-0076 humidityrelative humidity 41.500",
                "bme280@i2c-1/1-0076 temp temperature 21.870",
            ][..],
        ),
        (
            "bus/iio/devices/iio:device0 -> ../../../devices/i2c-1/1-005a/iio:device0
             devices/i2c-1/1-005a/name: mlx90614
             devices/i2c-1/1-005a/iio:device0/in_temp_ambient_raw: 14907
             devices/i2c-1/1-005a/iio:device0/in_temp_object_raw: 15400
             devices/i2c-1/1-005a/iio:device0/in_temp_scale: 20
             devices/i2c-1/1-005a/iio:device0/in_temp_offset: -13657.500",
            &[
                "mlx90614@i2c-1/1-005a temp_ambient temperature 24.990",
                "mlx90614@i2c-1/1-005a temp_object temperature 34.850",
            ],
        ),
        (
            "bus/iio/devices/iio:device0 -> ../../../devices/i2c-1/1-0062/iio:device0
             devices/i2c-1/1-0062/name: scd41
             devices/i2c-1/1-0062/iio:device0/in_concentration_co2_raw: 812
             devices/i2c-1/1-0062/iio:device0/in_concentration_co2_scale: 0.0001
             devices/i2c-1/1-0062/iio:device0/in_concentration_voc_raw: 5",
            &["scd41@i2c-1/1-0062 concentration_co2 co2 812.000"],
        ),
        // The device is on a board, and has a name only in Industrial I/O.
        (
            "bus/iio/devices/iio:device0 -> ../../../devices/platform/dht11@4/iio:device0
             devices/platform/dht11@4/iio:device0/name: dht11@4
             devices/platform/dht11@4/iio:device0/in_temp_input fails",
            &["dht11@4@platform/dht11@4 temp temperature read"],
        ),
        (
            "class/hwmon/hwmon0 -> ../../devices/platform/coretemp.0/hwmon/hwmon0
             devices/platform/coretemp.0/hwmon/hwmon0/name: coretemp
             devices/platform/coretemp.0/hwmon/hwmon0/device -> ../../../coretemp.0
             devices/platform/coretemp.0/hwmon/hwmon0/temp1_input: 48000
             devices/platform/coretemp.0/hwmon/hwmon0/temp1_max: 100000
             class/hwmon/hwmon1 -> ../../devices/i2c-1/1-0048/hwmon/hwmon1
             devices/i2c-1/1-0048/name: lm75
             devices/i2c-1/1-0048/hwmon/hwmon1/name: lm75
             devices/i2c-1/1-0048/hwmon/hwmon1/device -> ../../../1-0048
             devices/i2c-1/1-0048/hwmon/hwmon1/temp1_input: 25000
             devices/i2c-1/1-0048/hwmon/hwmon1/humidity1_input: 40000",
            &[
                "coretemp@platform/coretemp.0 temp1 temperature 48.000 inside",
                "lm75@i2c-1/1-0048 humidity1 humidity 40.000",
                "lm75@i2c-1/1-0048 temp1 temperature 25.000",
            ],
        ),
        // The 1-wire thermometer is reported once; another one was just powered up.
        (
            "bus/w1/devices/28-0316a2791234 -> ../../../devices/w1_bus_master1/28-0316a2791234
             devices/w1_bus_master1/28-0316a2791234/temperature: 21437
             devices/w1_bus_master1/28-0316a2791234/hwmon/hwmon2/name: w1_slave_temp
             devices/w1_bus_master1/28-0316a2791234/hwmon/hwmon2/temp1_input: 21437
             class/hwmon/hwmon2 -> ../../devices/w1_bus_master1/28-0316a2791234/hwmon/hwmon2
             bus/w1/devices/28-0316a2795678 -> ../../../devices/w1_bus_master1/28-0316a2795678
             devices/w1_bus_master1/28-0316a2795678/temperature: 85000
             bus/w1/devices/w1_bus_master1 -> ../../../devices/w1_bus_master1",
            &[
                "ds18b20@28-0316a2791234 temperature temperature 21.437",
                "ds18b20@28-0316a2795678 temperature temperature use \
                 the value of `ds18b20@28-0316a2795678`: it has just been powered up",
            ],
        ),
    ] {
        let (_folder, sysfs) = lay(tree);
        let said = said(&sysfs);
        assert_eq!(said.len(), expected.len(), "{said:#?}");
        for (said, expected) in said.iter().zip(expected) {
            assert!(said.starts_with(expected), "{said} is not {expected}");
        }
    }
}

#[test]
fn a_device_is_found_whatever_its_number() {
    let tree = |number: u8| {
        format!(
            "bus/iio/devices/iio:device{number} -> ../../../devices/i2c-1/1-005a/iio:device{number}
             devices/i2c-1/1-005a/name: mlx90614
             devices/i2c-1/1-005a/iio:device{number}/in_temp_ambient_raw: 20000
             devices/i2c-1/1-005a/iio:device{number}/in_temp_object_raw: 21000"
        )
    };
    for number in [0, 7] {
        let (_folder, sysfs) = lay(&tree(number));
        let find = |device, channel| sysfs.find(device, SysfsQuantity::Temperature, channel);
        let found = find("mlx90614@i2c-1/1-005a", Some("temp_object")).expect("it is there");
        assert_eq!(found.read().expect("it has a value"), 21.0);
        let error = find("mlx90614@i2c-1/1-005a", None).expect_err("there are two");
        assert!(matches!(&error, FindError::Ambiguous { channels, .. } if channels.len() == 2));
        let error = find("mlx90614@i2c-1/1-005b", None).expect_err("it hangs elsewhere");
        assert!(error.to_string().contains("there is `mlx90614@i2c-1/1-005a`"), "{error}");
        let light = sysfs.find("mlx90614@i2c-1/1-005a", SysfsQuantity::Light, None);
        let error = light.expect_err("it does not").to_string();
        assert!(error.ends_with("nothing that measures it is plugged in"), "{error}");
    }
}

#[test]
fn a_missing_or_invalid_value_is_an_error() {
    let (folder, sysfs) = lay(include_str!("trees/i2c.txt"));
    let find = || sysfs.find("tmp006@i2c-0/0-0040", SysfsQuantity::Temperature, None);
    let channel = find().expect("it is there");
    let file = folder.path().join("devices/i2c-0/0-0040/iio:device0/in_temp_raw");
    for rubbish in ["", "nan", "inf", "12 apples", "0x20", &"9".repeat(400)] {
        std::fs::write(&file, rubbish).expect("a file");
        let error = channel.read().expect_err(rubbish);
        assert!(matches!(error, ReadError::NoNumber { .. }), "{rubbish}: {error}");
    }
    assert!(channel.is_present());
    std::fs::remove_dir_all(file.parent().expect("a folder")).expect("it was there");
    assert!(!channel.is_present());
    assert!(matches!(channel.read(), Err(ReadError::File { .. })));
    assert!(find().is_err());
    assert!(Sysfs::new(Path::new("/nowhere")).channels().is_empty());
}

#[test]
fn an_invalid_value_of_the_kernel_is_an_error() {
    for (tree, expected) in [
        (
            "class/hwmon/hwmon0 -> ../../devices/i2c-1/1-0048/hwmon/hwmon0
             devices/i2c-1/1-0048/hwmon/hwmon0/device -> ../..
             devices/i2c-1/1-0048/name: lm75
             devices/i2c-1/1-0048/hwmon/hwmon0/temp1_input: 21500
             devices/i2c-1/1-0048/hwmon/hwmon0/temp1_fault: 1",
            "read `lm75@i2c-1/1-0048`: it reports a fault of its sensor",
        ),
        (
            "class/hwmon/hwmon0 -> ../../devices/i2c-1/1-0048/hwmon/hwmon0
             devices/i2c-1/1-0048/hwmon/hwmon0/device -> ../..
             devices/i2c-1/1-0048/name: lm75
             devices/i2c-1/1-0048/hwmon/hwmon0/temp1_fault: 0
             devices/i2c-1/1-0048/hwmon/hwmon0/temp1_input: -128000",
            "use -128, the value of `lm75@i2c-1/1-0048`: no sensor measures that",
        ),
        (
            "class/hwmon/hwmon0 -> ../../devices/i2c-1/1-0048/hwmon/hwmon0
             devices/i2c-1/1-0048/hwmon/hwmon0/device -> ../..
             devices/i2c-1/1-0048/name: lm75
             devices/i2c-1/1-0048/hwmon/hwmon0/temp1_input: 127937",
            "use 127.937, the value of `lm75@i2c-1/1-0048`: no sensor measures that",
        ),
        (
            "bus/w1/devices/28-0316a2791234 -> ../../../devices/w1_bus_master1/28-0316a2791234
             devices/w1_bus_master1/28-0316a2791234/temperature: 85000",
            "use the value of `ds18b20@28-0316a2791234`: it has just been powered up",
        ),
        (
            "bus/w1/devices/28-0316a2791234 -> ../../../devices/w1_bus_master1/28-0316a2791234
             devices/w1_bus_master1/28-0316a2791234/temperature: -127000",
            "use -127, the value of `ds18b20@28-0316a2791234`: no sensor measures that",
        ),
        (
            "bus/iio/devices/iio:device0 -> ../../../devices/i2c-1/1-0076/iio:device0
             devices/i2c-1/1-0076/name: bme280
             devices/i2c-1/1-0076/iio:device0/in_humidityrelative_input: 655350",
            "use 655.35, the value of `bme280@i2c-1/1-0076`: no sensor measures that",
        ),
    ] {
        let (_folder, sysfs) = lay(tree);
        let channels = sysfs.channels();
        let [channel] = &channels[..] else { panic!("{channels:?}") };
        let problem = channel.read().expect_err(tree).to_string();
        assert_eq!(problem, expected);
    }
}

#[test]
fn maximum_and_minimum_since_the_start_are_no_channels() {
    let (_folder, sysfs) =
        lay("bus/iio/devices/iio:device0 -> ../../../devices/i2c-1/1-0044/iio:device0
         devices/i2c-1/1-0044/name: hdc3020
         devices/i2c-1/1-0044/iio:device0/in_temp_raw: 24000
         devices/i2c-1/1-0044/iio:device0/in_temp_scale: 2.5
         devices/i2c-1/1-0044/iio:device0/in_temp_offset: -15000
         devices/i2c-1/1-0044/iio:device0/in_temp_peak_raw: 30000
         devices/i2c-1/1-0044/iio:device0/in_temp_trough_raw: 18000
         devices/i2c-1/1-0044/iio:device0/in_humidityrelative_raw: 20000
         devices/i2c-1/1-0044/iio:device0/in_humidityrelative_scale: 2
         devices/i2c-1/1-0044/iio:device0/in_humidityrelative_peak_raw: 30000");
    assert_eq!(
        said(&sysfs),
        [
            "hdc3020@i2c-1/1-0044 humidityrelative humidity 40.000",
            "hdc3020@i2c-1/1-0044 temp temperature 22.500",
        ]
    );
    let found = sysfs.find("hdc3020@i2c-1/1-0044", SysfsQuantity::Temperature, None);
    assert!(found.is_ok(), "it has one temperature: {found:?}");
}
