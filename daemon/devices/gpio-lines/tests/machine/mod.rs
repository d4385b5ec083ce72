//! A virtual machine with a GPIO chip (PL061): QEMU's `virt`, with Debian's kernel for arm64. The
//! machine's power button is connected to line 3 of the chip; QEMU presses the button on a command.
//!
//! No kernel of Debian has a simulated GPIO chip, so that this is the smallest setup with a real
//! driver. Inside the machine, this same test program, built for arm64, runs as the only process.

#[path = "../../../../../tests/support/left_out.rs"]
mod left_out;

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Prefix of the test program's output, which distinguishes it from the output of the kernel.
pub(crate) const SAID: &str = "@said ";

/// Output with which the test program requests a press of the power button.
pub(crate) const PRESS: &str = "press the button";

const QEMU: &str = "qemu-system-aarch64";
const TARGET: &str = "aarch64-unknown-linux-musl";

/// Environment variable with the path of the arm64 kernel, for a machine without an installed
/// kernel: `dpkg -x` can unpack the kernel to any folder.
const KERNEL: &str = "ALTHING_ARM64_KERNEL";

/// Time limit for the virtual machine from its start to its end; it usually takes about ten
/// seconds.
const PATIENCE: Duration = Duration::from_secs(120);

/// Programs that the tests need.
struct Needed {
    qemu: PathBuf,
    kernel: PathBuf,
}

impl Needed {
    /// Finds the programs that the tests need. If a program is missing, returns its name and the
    /// way to install it as an error.
    fn find() -> Result<Needed, String> {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let qemu = std::env::split_paths(&path).map(|folder| folder.join(QEMU));
        let qemu = { qemu }
            .find(|file| file.exists())
            .ok_or_else(|| format!("apt-get install qemu-system-arm: {QEMU} is missing"))?;
        let installed = fs::read_dir("/boot").into_iter().flatten().flatten();
        let is_arm = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            name.starts_with("vmlinuz-") && name.ends_with("-arm64")
        };
        let mut installed = installed.map(|entry| entry.path()).filter(is_arm);
        let kernel = std::env::var_os(KERNEL).map(PathBuf::from).or_else(|| installed.next());
        let kernel = kernel.filter(|file| file.exists()).ok_or_else(|| {
            format!("linux-image-arm64 is missing: {KERNEL} says where its vmlinuz is")
        })?;
        let mut library = Command::new("rustc");
        library.args(["--print=target-libdir", "--target", TARGET]);
        let library = library.output().map(|output| output.stdout).unwrap_or_default();
        if !Path::new(String::from_utf8_lossy(&library).trim()).exists() {
            return Err(format!("rustup target add {TARGET}"));
        }
        Ok(Needed { qemu, kernel })
    }
}

/// Runs a test of this program inside a virtual machine, and returns the output of the test. If
/// something is missing, prints a message and returns `None`, so that nothing is tested; with
/// `CI=true` the test then fails.
pub(crate) fn said_by(test: &str) -> Option<Vec<String>> {
    let needed = match Needed::find() {
        Ok(needed) => needed,
        Err(missing) => {
            left_out::left_out(&missing);
            return None;
        }
    };
    let folder = tempfile::tempdir().expect("a folder");
    let init = fs::read(built()).expect("it was built");
    fs::write(folder.path().join("initramfs"), archive("init", &init)).expect("a file");
    let mut machine = begin(&needed, folder.path(), test);
    let console = machine.stdout.take().expect("it is piped");
    let mut said = Vec::new();
    let watchdog = Watchdog(machine);
    let mut heard = String::new();
    for line in BufReader::new(console).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line).into_owned();
        if let Some((_, word)) = line.trim_end().split_once(SAID) {
            if word == PRESS {
                press(&folder.path().join("qmp"));
            }
            said.push(word.to_owned());
        }
        heard += &line;
        heard.push('\n');
    }
    drop(watchdog);
    if said.is_empty() {
        // The output of the kernel is shown, because a test without output fails.
        println!("{heard}");
    }
    Some(said)
}

fn begin(Needed { qemu, kernel }: &Needed, folder: &Path, test: &str) -> Child {
    let arguments = format!("{test} --exact --ignored --nocapture --test-threads=1");
    let line = format!("console=ttyAMA0 quiet panic=-1 rdinit=/init -- {arguments}");
    let qmp = format!("unix:{},server=on,wait=off", folder.join("qmp").display());
    let mut command = Command::new("timeout");
    command.args(["--signal=KILL", &PATIENCE.as_secs().to_string()]).arg(qemu);
    command.args(["-M", "virt", "-cpu", "cortex-a57", "-m", "256", "-no-reboot", "-nographic"]);
    command.args(["-nic", "none", "-monitor", "none", "-serial", "stdio", "-qmp", &qmp]);
    command.arg("-kernel").arg(kernel).arg("-initrd").arg(folder.join("initramfs"));
    command.args(["-append", &line]).stdin(Stdio::null()).stdout(Stdio::piped());
    let errors = File::create(folder.join("errors")).expect("a file");
    command.stderr(errors).spawn().expect("it is installed")
}

/// Process of a virtual machine, which is killed when this value is dropped.
struct Watchdog(Child);

impl Drop for Watchdog {
    fn drop(&mut self) {
        let began = Instant::now();
        // The machine powers off by itself after the last output.
        while self.0.try_wait().expect("our own child").is_none() {
            if began.elapsed() > Duration::from_secs(10) {
                let _ = self.0.kill();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Presses the virtual machine's power button; QEMU releases the button after a tenth of a second.
fn press(socket: &Path) {
    let qemu = UnixStream::connect(socket).expect("it listens");
    let mut answers = BufReader::new(qemu.try_clone().expect("a second handle"));
    let mut answer = String::new();
    for command in ["", "qmp_capabilities", "system_powerdown"] {
        if !command.is_empty() {
            writeln!(&qemu, "{{\"execute\": \"{command}\"}}").expect("it listens");
        }
        answers.read_line(&mut answer).expect("it answers");
    }
}

/// Returns the path of this test program, built for the virtual machine.
fn built() -> PathBuf {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let flags = "-Clinker=rust-lld -Clink-self-contained=yes -Cstrip=symbols";
    let output = Command::new(cargo)
        .args(["test", "--no-run", "--offline", "--message-format=json", "-p", "gpio-lines"])
        .args(["--test", "kernel", "--target", TARGET, "--target-dir"])
        .arg(Path::new(env!("CARGO_TARGET_TMPDIR")).join("machine"))
        .env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_RUSTFLAGS", flags)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{complaint}");
    let messages = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut executable = messages.lines().filter_map(|line| {
        let message: serde_json::Value = serde_json::from_str(line).ok()?;
        message["executable"].as_str().map(PathBuf::from)
    });
    executable.next_back().expect("it has built the test")
}

/// Returns an archive (cpio, `newc`) with one program, for the kernel to start from.
fn archive(name: &str, program: &[u8]) -> Vec<u8> {
    let mut archive = Vec::new();
    for (name, mode, content) in [(name, 0o100_755, program), ("TRAILER!!!", 0, &[][..])] {
        archive.extend_from_slice(b"070701");
        let (size, name_size) = (content.len(), name.len() + 1);
        for field in [1, mode, 0, 0, 1, 0, size, 0, 0, 0, 0, name_size, 0] {
            write!(archive, "{field:08X}").expect("memory");
        }
        archive.extend_from_slice(name.as_bytes());
        archive.push(0);
        pad(&mut archive);
        archive.extend_from_slice(content);
        pad(&mut archive);
    }
    archive
}

fn pad(archive: &mut Vec<u8>) {
    archive.resize(archive.len().next_multiple_of(4), 0);
}
