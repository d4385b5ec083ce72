//! Thermometers that a kernel knows, from their listing to a goal: in a tree such as kernels show,
//! and in a real kernel, Debian's `user-mode-linux`, in which the whole ecosystem runs.

mod support;

use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use support::{Office, PATIENCE, finish, lab, stderr, stdout};

/// What the real kernel needs, and where packages put it.
const NEEDED: [&str; 4] =
    ["/usr/bin/linux.uml", "/usr/sbin/i2cset", "/usr/lib/uml/modules", "/bin/busybox"];

/// What is said inside begins with this, among what the kernel says.
const SAID: &str = "@said ";

/// A thermometer as a kernel shows it below a folder.
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
    thermometer.plug(4, "19000\n");
    office.await_devices(1);
    let (_, asked) = office.ask(&["act", "(report-temperature temperature-1 office1)"]);
    assert!(asked.contains("19.0 °C at office1"), "{asked}");
}

#[test]
fn a_real_kernels_thermometer_is_measured_unplugged_and_plugged_in() {
    if let Some(missing) = NEEDED.iter().find(|path| !Path::new(path).exists()) {
        assert!(std::env::var_os("CI").is_none(), "{missing} is missing");
        eprintln!("NOT TESTED: apt-get install user-mode-linux i2c-tools busybox: {missing}");
        return;
    }
    let office = Office::new();
    let sensor = "[[agent]]\nname = \"thermometer\"\nplugin = \"temperature-sensor\"\n\
                  driver = \"linux\"\n\n[agent.config]\nlocation = \"office1\"\n\
                  device = \"tmp006@i2c-0/0-0040\"\n";
    let file = office.write("lab.toml", &(lab("decentralized") + sensor));
    let script = office.write("init", &inside(&file));
    fs::set_permissions(&script, fs::Permissions::from_mode(0o755)).expect("our own file");
    let mut kernel = Command::new(NEEDED[0]);
    kernel
        .args(["mem=512M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", "quiet"])
        .args(["con=null", "con0=null,fd:1", &format!("init={}", script.display())])
        .env("HOME", office.folder())
        .stdin(Stdio::null());
    let output = finish(&mut kernel);
    let text = String::from_utf8_lossy(&output.stdout);
    let said: Vec<_> = text.lines().filter_map(|line| Some(line.split_once(SAID)?.1)).collect();
    let expected = [
        "measured 25.0 °C at office1",
        "warmer 26.5 °C at office1",
        "unplugged",
        "plugged in",
        "measured again 26.5 °C at office1",
    ];
    assert_eq!(said, expected, "within {PATIENCE:?}: {text}");
}

/// What the kernel runs as its first process.
fn inside(file: &Path) -> String {
    let (althing, file) = (env!("CARGO_BIN_EXE_althing"), file.display());
    let modules = "/usr/lib/uml/modules/*/kernel/drivers";
    format!(
        r#"#!/bin/sh
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/run
mount -t proc proc /proc; mount -t sysfs sysfs /sys; mount -t tmpfs tmpfs /run
export ALTHING_RUNTIME_DIR=/run/althing ALTHING_STATE_DIR=/run/state
busybox ip link set lo up
for module in i2c/i2c-core i2c/i2c-dev base/regmap/regmap-i2c iio/industrialio \
    iio/buffer/kfifo_buf iio/buffer/industrialio-triggered-buffer iio/temperature/tmp006; do
    busybox insmod {modules}/$module.ko
done
busybox insmod {modules}/i2c/i2c-stub.ko chip_addr=0x40
set_word() {{ i2cset -f -y 0 0x40 "$1" "$2" w; }}
# Who it is; that it has measured, and what: 25 degrees.
set_word 0xFE 0x4954; set_word 0xFF 0x6700; set_word 0x02 0x8074; set_word 0x01 0x800C
cd /sys/bus/i2c/devices/i2c-0
echo tmp006 0x40 > new_device

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
busybox poweroff -f
"#
    )
}
