//! A real kernel as an unprivileged process: Debian's `user-mode-linux`, with an infrared
//! thermometer (TMP006) on a simulated bus, which has measured 25 degrees.
//!
//! Tests of several crates include this file. It needs Debian's packages and nothing else.

#[allow(clippy::duplicate_mod, reason = "crates include this file without the others")]
#[path = "left_out.rs"]
mod left_out;

use std::fs::{self, File, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Files that are needed, at the paths where packages put them.
const NEEDED: [&str; 4] =
    ["/usr/bin/linux.uml", "/usr/sbin/i2cset", "/usr/lib/uml/modules", "/bin/busybox"];

/// Identifier of the thermometer.
pub(crate) const THERMOMETER: &str = "tmp006@i2c-0/0-0040";

/// Time limit of a kernel from start to end: it takes four to thirty seconds.
const PATIENCE: Duration = Duration::from_secs(180);

/// Prefix of the script's output lines, which separates them from the kernel's.
pub(crate) const SAID: &str = "@said ";

/// Loads the drivers and sets the thermometer's registers: its identity, that it has measured, and
/// the value.
const PRELUDE: &str = r#"#!/bin/sh
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/run
mount -t proc proc /proc; mount -t sysfs sysfs /sys; mount -t tmpfs tmpfs /run
busybox ip link set lo up
drivers=$(echo /usr/lib/uml/modules/*/kernel/drivers)
for module in i2c/i2c-core i2c/i2c-dev base/regmap/regmap-i2c iio/industrialio \
    iio/buffer/kfifo_buf iio/buffer/industrialio-triggered-buffer \
    iio/temperature/tmp006 iio/light/vcnl4000 iio/light/apds9300; do
    busybox insmod $drivers/$module.ko
done
busybox insmod $drivers/i2c/i2c-stub.ko chip_addr=0x13,0x29,0x40
set_word() { i2cset -f -y 0 0x40 "$1" "$2" w; }
set_word 0xFE 0x4954; set_word 0xFF 0x6700; set_word 0x02 0x8074; set_word 0x01 0x800C
cd /sys/bus/i2c/devices/i2c-0
echo tmp006 0x40 > new_device
"#;

/// Source of the library that lets the kernel run on processors with wide registers.
const WIDE_REGISTERS: &str = include_str!("wide_registers.c");

/// Compiles the library for wide registers into a folder. The compiler is the one that links tests.
fn wide_registers(folder: &Path) -> PathBuf {
    let (source, library) = (folder.join("wide_registers.c"), folder.join("wide_registers.so"));
    fs::write(&source, WIDE_REGISTERS).expect("a file");
    let mut compiler = Command::new("cc");
    let compiled = compiler.args(["-shared", "-fPIC", "-o"]).args([&library, &source]).status();
    assert!(compiled.expect("Rust links with it").success(), "{} is compiled", source.display());
    library
}

/// Runs a script as a kernel's first process, in the folder of its bus; returns the script's output
/// lines. Returns `None` with a report if packages are missing: then nothing is tested, and
/// `CI=true` fails.
pub(crate) fn said_in(folder: &Path, megabytes: u32, script: &str) -> Option<Vec<String>> {
    if let Some(missing) = NEEDED.iter().find(|path| !Path::new(path).exists()) {
        let needed = "apt-get install user-mode-linux i2c-tools busybox";
        left_out::left_out(&format!("{missing} is missing: {needed}"));
        return None;
    }
    let (init, out) = (folder.join("init"), folder.join("out"));
    fs::write(&init, format!("{PRELUDE}{script}\nbusybox poweroff -f\n")).expect("a file");
    fs::set_permissions(&init, Permissions::from_mode(0o755)).expect("our own file");
    let mut kernel = Command::new(NEEDED[0])
        .args([&format!("mem={megabytes}M"), "root=/dev/root", "rootfstype=hostfs", "rootflags=/"])
        .args(["ro", "quiet", "con=null", "con0=null,fd:1", &format!("init={}", init.display())])
        .env("HOME", folder)
        .env("LD_PRELOAD", wide_registers(folder))
        .stdin(Stdio::null())
        .stdout(File::create(&out).expect("a file"))
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
    let text = fs::read(out).expect("a file");
    let text = String::from_utf8_lossy(&text);
    let lines = text.lines().filter_map(|line| line.trim_end().split_once(SAID));
    let said: Vec<_> = lines.map(|(_, said)| said.to_owned()).collect();
    if said.is_empty() {
        // The text is shown only if the test fails, which is certain at this point.
        println!("{text}");
    }
    Some(said)
}
