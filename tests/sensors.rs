//! Thermometers of a kernel, from their listing to a goal: in a folder that imitates sysfs, and in
//! a real kernel, Debian's `user-mode-linux`, in which the whole ecosystem runs.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use crate::kernel::{SAID, THERMOMETER, said_in};
use crate::support::{Office, lab, stderr, stdout};

/// A thermometer as sysfs shows it, below a folder.
struct Thermometer(PathBuf);

impl Thermometer {
    fn device(&self, number: u8) -> PathBuf {
        self.0.join(format!("devices/i2c-1/1-0048/iio:device{number}"))
    }

    fn plug(&self, number: u8, millidegrees: &str) {
        let device = self.device(number);
        fs::create_dir_all(&device).expect("a folder");
        fs::write(device.with_file_name("name"), "tmp117\n").expect("a file");
        fs::write(device.join("in_temp_input"), millidegrees).expect("a file");
        let all = self.0.join("bus/iio/devices");
        fs::create_dir_all(&all).expect("a folder");
        symlink(&device, all.join(format!("iio:device{number}"))).expect("a link");
    }

    fn unplug(&self, number: u8) {
        let link = self.0.join(format!("bus/iio/devices/iio:device{number}"));
        fs::remove_file(link).expect("it was there");
        fs::remove_dir_all(self.device(number)).expect("it was there");
    }
}

#[test]
fn a_thermometer_from_its_listing_to_a_goal() {
    let office = Office::new();
    let thermometer = Thermometer(office.folder().join("sys"));
    thermometer.plug(0, "21500\n");
    let sysfs = thermometer.0.display().to_string();
    let listed = office.run(&["sensors", "--sysfs", &sysfs]);
    let expected = "tmp117@i2c-1/1-0048  temperature  21.5 Cel\n";
    assert!(stdout(&listed).starts_with(expected), "{}", stdout(&listed));

    let nowhere = office.run(&["sensors", "--sysfs", "/no/such/folder"]);
    assert_eq!(nowhere.status.code(), Some(33));
    assert!(stderr(&nowhere).contains("look into /no/such/folder"), "{}", stderr(&nowhere));

    let lines = stdout(&office.run(&["sensors", "--sysfs", &sysfs, "--toml"]));
    let sensors = lines.replace("location = \"\"", "location = \"office1\"");
    assert_ne!(lines, sensors, "it leaves the room to people");
    let sensors = sensors.replace("device = ", &format!("sysfs = \"{sysfs}\"\ndevice = "));
    let file = office.write("lab.toml", &(lab("decentralized") + &sensors));
    let mut office = office.with_file(file);
    let checked = office.run(&["check", &office.file.display().to_string()]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    office.up_alone(&[]);
    office.await_devices(1);

    let goal = ["goal", "(known-temperature office1)"];
    let (code, said) = office.ask(&goal);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("21.5 °C at office1"), "{said}");

    thermometer.unplug(0);
    office.await_devices(0);
    office.await_fact("(known-temperature office1)", false);
    thermometer.plug(4, "19000\n");
    office.await_devices(1);
    let (_, asked) = office.ask(&["act", "(report-temperature temperature-1 office1)"]);
    assert!(asked.contains("19.0 °C at office1"), "{asked}");
}

#[test]
fn a_sensor_that_is_plugged_into_a_board_is_discovered() {
    let office = Office::new();
    let thermometer = Thermometer(office.folder().join("sys"));
    fs::create_dir_all(&thermometer.0).expect("a folder");
    let sysfs = thermometer.0.display();
    let board = |name: &str, location: &str| {
        let config = format!("config = {{ sysfs = \"{sysfs}\"{location} }}\n\n");
        format!("[[agent]]\nname = \"{name}\"\nplugin = \"board\"\n{config}")
    };
    let boards = board("pi", ", location = \"office1\"") + &board("lost", "");
    let file = office.write("lab.toml", &(lab("decentralized") + &boards));
    let mut office = office.with_file(file);
    office.up(&["daemon"], &[]);
    let (_, none) = office.ask(&["agents", "--discovered"]);
    assert!(!none.contains("tmp117"), "{none}");
    thermometer.plug(0, "21500\n");
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("21.5 °C at office1"), "{said}");
    let discovered = office.ask_json(&["agents", "--discovered"]).to_string();
    assert!(discovered.contains("\"joined\":true"), "{discovered}");
    assert!(discovered.contains("its room is not known"), "{discovered}");
    thermometer.unplug(0);
    office.await_devices(0);
    office.await_fact("(known-temperature office1)", false);
    let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
    assert_eq!(code, Some(1), "{said}");
    // The same device appears under another number.
    thermometer.plug(3, "19000\n");
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("19.0 °C at office1"), "{said}");
}

#[test]
fn a_real_kernels_thermometer_is_measured_unplugged_and_plugged_in() {
    let office = Office::new();
    let sensor = format!(
        "[[agent]]\nname = \"thermometer\"\nplugin = \"temperature-sensor\"\n\
         driver = \"linux\"\n\n[agent.config]\nlocation = \"office1\"\ndevice = \"{THERMOMETER}\"\n"
    );
    let file = office.write("lab.toml", &(lab("decentralized") + &sensor));
    let Some(said) = said_in(office.folder(), 512, &inside(&file)) else { return };
    let expected = [
        "measured 25.0 °C at office1",
        "warmer 26.5 °C at office1",
        "unplugged",
        "plugged in",
        "measured again 26.5 °C at office1",
    ];
    assert_eq!(said, expected);
}

/// Returns the script that the kernel runs as its first process.
fn inside(file: &Path) -> String {
    let (althing, file) = (env!("CARGO_BIN_EXE_althing"), file.display());
    format!(
        r#"export ALTHING_RUNTIME_DIR=/run/althing ALTHING_STATE_DIR=/run/state
said() {{ echo "{SAID}$*"; }}
until_said() {{ until grep -q "$1" "$2"; do sleep 0.05; done; }}
measure() {{
    {althing} act '(report-temperature thermometer office1)' --ecosystem {file} > /run/act 2>&1
    grep -o '[0-9.]* °C at office1' /run/act | tail -1
}}
offers() {{ {althing} agents --ecosystem {file} | grep -q report-temperature; }}

{althing} up {file} > /run/up 2>&1 &
until_said 'is ready' /run/up
until offers; do sleep 0.05; done
said measured $(measure)
set_word 0x01 0x400D
said warmer $(measure)
echo 0x40 > delete_device
while offers; do sleep 0.05; done
said unplugged
echo tmp006 0x40 > new_device
until offers; do sleep 0.05; done
said plugged in
said measured again $(measure)
"#
    )
}
