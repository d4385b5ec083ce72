//! The cost of a daemon with ten simulated devices: the time from its start until it is ready, and
//! its memory then.
//!
//! ```text
//! cargo bench -p althing --bench start [-- RUNS]
//! ```
//!
//! Each run is a process of its own, in folders of its own, ended after its measurement. The clock
//! runs from before the process exists to the line that reports that its agents are present.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Number of starts of the daemon that are measured, unless the command line gives another.
const RUNS: usize = 20;

/// The rooms with a thermometer; with a robot and its sensor they make ten devices.
const ROOMS: usize = 8;

/// Wait before the memory is measured: three heartbeats, after which all agents know each other,
/// and the domain is composed.
const SETTLING: Duration = Duration::from_secs(3);

const READY_AIM_MS: f64 = 150.0;
const MEMORY_AIM_MIB: f64 = 40.0;

/// Ontology of the measured building: that of the office in `domains/smart-office`.
const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let runs = runs()?;
    let mut ready_ms = Vec::new();
    for _ in 0..runs {
        ready_ms.push(Daemon::start()?.ready.as_secs_f64() * 1_000.0);
    }
    ready_ms.sort_by(f64::total_cmp);
    let (min, median, max) = (ready_ms[0], ready_ms[runs / 2], ready_ms[runs - 1]);
    println!(
        "start to ready, {runs} runs: min {min:.1} ms, median {median:.1} ms, max {max:.1} ms"
    );
    println!("    median, aim ≤ {READY_AIM_MS} ms: {}", verdict(median <= READY_AIM_MS));

    let daemon = Daemon::start()?;
    std::thread::sleep(SETTLING);
    let (resident, peak) = (daemon.memory_mib("VmRSS:")?, daemon.memory_mib("VmHWM:")?);
    println!("resident after {SETTLING:?}: {resident:.1} MiB, at most {peak:.1} MiB so far");
    println!("    resident, aim ≤ {MEMORY_AIM_MIB} MiB: {}", verdict(resident <= MEMORY_AIM_MIB));
    Ok(())
}

/// Returns the number of runs; one if Cargo only checks that the benchmark runs.
fn runs() -> Outcome<usize> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let default = if arguments.iter().any(|argument| argument == "--bench") { RUNS } else { 1 };
    let number = arguments.iter().find(|argument| !argument.starts_with('-'));
    Ok(number.map_or(Ok(default), |number| number.parse())?.max(1))
}

fn verdict(is_reached: bool) -> &'static str {
    if is_reached { "reached" } else { "missed" }
}

/// A daemon that is ready; it is killed when this is dropped.
struct Daemon {
    process: Child,
    ready: Duration,
    _folder: tempfile::TempDir,
}

impl Daemon {
    fn start() -> Outcome<Daemon> {
        let folder = tempfile::tempdir()?;
        let file = write_ecosystem(folder.path())?;
        let begun = Instant::now();
        let mut process = Command::new(env!("CARGO_BIN_EXE_althing"))
            .args(["up".as_ref(), file.as_os_str()])
            .args(["--daemon", "bench"])
            .env("ALTHING_RUNTIME_DIR", folder.path().join("run"))
            .env("ALTHING_STATE_DIR", folder.path().join("state"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()?;
        let stdout = process.stdout.take().ok_or("the daemon has no standard output")?;
        // Owned from here on, so that the process ends also if its output is wrong.
        let mut daemon = Daemon { process, ready: Duration::ZERO, _folder: folder };
        for line in BufReader::new(stdout).lines() {
            if line?.contains("is ready") {
                daemon.ready = begun.elapsed();
                return Ok(daemon);
            }
        }
        Err("the daemon ended before it was ready".into())
    }

    /// Returns a value of the process's status, which Linux gives in KiB, in MiB.
    fn memory_mib(&self, field: &str) -> Outcome<f64> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.process.id()))?;
        let line = status.lines().find_map(|line| line.strip_prefix(field));
        let kib = line.and_then(|line| line.split_whitespace().next());
        Ok(kib.ok_or("the system does not tell how much memory a process holds")?.parse::<f64>()?
            / 1_024.0)
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

// === the ecosystem ===

fn write_ecosystem(folder: &Path) -> Outcome<PathBuf> {
    for name in ["run", "state"] {
        fs::create_dir(folder.join(name))?;
    }
    fs::write(folder.join("domain.pddl"), ONTOLOGY)?;
    fs::write(folder.join("map.pddl"), map())?;
    let file = folder.join("althing.toml");
    fs::write(&file, ecosystem())?;
    Ok(file)
}

/// Returns a map with one corridor, and rooms that are connected to it.
fn map() -> String {
    let (mut rooms, mut doors) = (String::new(), String::new());
    for room in 1..=ROOMS {
        let _ = write!(rooms, "office{room} ");
        for (from, to) in [
            ("corridor".to_owned(), format!("office{room}")),
            (format!("office{room}"), "corridor".to_owned()),
        ] {
            let _ = writeln!(doors, "(connected {from} {to}) (= (distance {from} {to}) 4)");
        }
    }
    format!(
        "(define (problem bench-map) (:domain smart-office)\n\
         (:objects {rooms}- room corridor - corridor)\n\
         (:init (= (total-cost) 0)\n{doors})\n\
         (:goal (and)) (:metric minimize (total-cost)))\n"
    )
}

fn ecosystem() -> String {
    let mut text =
        "[ecosystem]\nname = \"bench\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\n"
            .to_owned();
    for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
        agent(&mut text, plugin, plugin, "{}");
    }
    for room in 1..=ROOMS {
        let config = format!("{{ location = \"office{room}\" }}");
        agent(&mut text, &format!("thermometer-{room}"), "temperature-sensor", &config);
    }
    agent(&mut text, "turtlebot-1", "turtlebot", "{ start = \"corridor\", speed = 0.3 }");
    agent(&mut text, "ir-1", "ir-temperature-sensor", "{ mounted-on = \"turtlebot-1\" }");
    text
}

fn agent(text: &mut String, name: &str, plugin: &str, config: &str) {
    let _ = write!(
        text,
        "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndaemon = \"bench\"\n\
         config = {config}\n\n"
    );
}
