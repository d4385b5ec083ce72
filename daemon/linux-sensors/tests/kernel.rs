//! The same against a real kernel: Debian's `user-mode-linux`, which runs as a process of anybody,
//! with real drivers of Industrial I/O over a simulated bus.
//!
//! The test begins that kernel with a script that loads the drivers and then runs this same test
//! program inside, where [`inside`] reads, changes, unplugs and plugs in. What it says is held
//! against what was put into the chips' registers. Needs the packages `user-mode-linux` and
//! `i2c-tools`; where they are missing it says so and tests nothing, and fails where `CI` is set.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use linux_sensors::{Quantity, Sysfs};

/// Where the packages put what is needed.
const NEEDED: [&str; 4] =
    ["/usr/bin/linux.uml", "/usr/sbin/i2cset", "/usr/lib/uml/modules", "/bin/busybox"];

const THERMOMETER: &str = "tmp006@i2c-0/0-0040";

/// How long the kernel may take from its start to its end: it takes four seconds.
const PATIENCE: Duration = Duration::from_secs(60);

/// What is said inside begins with this, among what the kernel says.
const SAID: &str = "@said ";

#[test]
fn a_real_kernels_sensors_are_read_unplugged_and_plugged_in() {
    if let Some(missing) = NEEDED.iter().find(|path| !Path::new(path).exists()) {
        assert!(std::env::var_os("CI").is_none(), "{missing} is missing");
        eprintln!(
            "NOT TESTED: {missing} is missing: apt-get install user-mode-linux i2c-tools busybox"
        );
        return;
    }
    let said = said_inside();
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

fn said_inside() -> Vec<String> {
    let folder = tempfile::tempdir().expect("a folder");
    let program = std::env::current_exe().expect("it runs");
    let script = folder.path().join("init");
    let modules = "/usr/lib/uml/modules/*/kernel/drivers";
    let text = format!(
        "#!/bin/sh
        export PATH=/usr/sbin:/usr/bin:/sbin:/bin
        mount -t proc proc /proc; mount -t sysfs sysfs /sys; mount -t tmpfs tmpfs /run
        for module in i2c/i2c-core i2c/i2c-dev base/regmap/regmap-i2c iio/industrialio \\
            iio/buffer/kfifo_buf iio/buffer/industrialio-triggered-buffer \\
            iio/temperature/tmp006 iio/light/vcnl4000 iio/light/apds9300; do
            busybox insmod {modules}/$module.ko
        done
        busybox insmod {modules}/i2c/i2c-stub.ko chip_addr=0x13,0x29,0x40
        # Who they are; and of the thermometer that it has measured 25 degrees.
        i2cset -y 0 0x13 0x81 0x21 b
        i2cset -y 0 0x40 0xFE 0x4954 w; i2cset -y 0 0x40 0xFF 0x6700 w
        i2cset -y 0 0x40 0x02 0x8074 w; i2cset -y 0 0x40 0x01 0x800C w
        cd /sys/bus/i2c/devices/i2c-0
        echo tmp006 0x40 > new_device
        echo apds9300 0x29 > new_device
        echo vcnl4010 0x13 > new_device
        {} inside --exact --ignored --nocapture
        busybox poweroff -f",
        program.display()
    );
    std::fs::write(&script, text).expect("a file");
    let permissions = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&script, permissions).expect("our own file");
    let out = std::fs::File::create(folder.path().join("out")).expect("a file");
    let mut kernel = Command::new(NEEDED[0])
        .args(["mem=128M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", "quiet"])
        .args(["con=null", "con0=null,fd:1", &format!("init={}", script.display())])
        .env("HOME", folder.path())
        .stdin(Stdio::null())
        .stdout(out)
        .stderr(Stdio::null())
        .spawn()
        .expect("it is installed");
    let began = Instant::now();
    while kernel.try_wait().expect("our own child").is_none() {
        if began.elapsed() > PATIENCE {
            kernel.kill().expect("our own child");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let text = std::fs::read(folder.path().join("out")).expect("a file");
    let text = String::from_utf8_lossy(&text);
    let lines = text.lines().filter_map(|line| line.trim_end().split_once(SAID));
    lines.map(|(_, said)| said.to_owned()).collect()
}

/// Runs inside that kernel.
#[test]
#[ignore = "a part of the test above, which runs it where it belongs"]
fn inside() {
    let sysfs = Sysfs::default();
    for channel in sysfs.channels() {
        let value =
            channel.read().map_or_else(|_| "Err".to_owned(), |value| format!("Ok({value:?})"));
        println!("{SAID}{} {} {value}", channel.device, channel.quantity);
    }
    let find = || sysfs.find(THERMOMETER, Quantity::Temperature, None);
    let channel = find().expect("it was plugged in");
    // 26.5 degrees: thirty-seconds of one, four to the left, bytes the other way round.
    set("0x01", "0x400D");
    println!("{SAID}warmer {:?}", channel.read().map_err(|error| error.to_string()));

    // The light sensor goes too, so that the thermometer comes back under another number.
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
