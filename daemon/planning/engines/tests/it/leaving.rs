//! Tests that an engine leaves no process and no file, however it ends.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use engines::{Ending, EngineOptions, ExternalEngine, Installation, PlanningAim, plan};
use planner::Cancel;

use crate::support::{PATIENCE, fake, fast_downward, parse, run};

const DOMAIN: &str = "(define (domain x) (:predicates (q)) (:action go :effect (q)))";
const PROBLEM: &str = "(define (problem y) (:domain x) (:init) (:goal (q)))";

/// Returns a task that no engine solves in the time of a test: a counter of thirty bits that must
/// pass through all 2^30 states.
fn endless() -> (String, String) {
    let mut domain = "(define (domain x) (:predicates".to_owned();
    let mut actions = String::new();
    for bit in 0..30 {
        domain += &format!(" (b{bit})");
        let below: String = (0..bit).map(|lower| format!(" (b{lower})")).collect();
        let falls: String = (0..bit).map(|lower| format!(" (not (b{lower}))")).collect();
        actions += &format!(
            "(:action set{bit} :precondition (and (not (b{bit})){below}) :effect (and (b{bit}){falls}))"
        );
    }
    let goal: String = (0..30).map(|bit| format!(" (b{bit})")).collect();
    let problem = format!("(define (problem y) (:domain x) (:init) (:goal (and{goal})))");
    (format!("{domain}){actions})"), problem)
}

/// A named pipe, which shows a test when the engine hangs and when its processes have ended.
struct Confession {
    _folder: tempfile::TempDir,
    pipe: PathBuf,
    told: mpsc::Receiver<Told>,
}

/// Message of the thread that reads the pipe: the first line, then the closing of the pipe by the
/// last writer.
enum Told {
    Line(String),
    AllDead,
}

impl Confession {
    fn new() -> Confession {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("pipe");
        let made = Command::new("mkfifo").arg(&pipe).status().expect("mkfifo is there");
        assert!(made.success());
        let (tell, told) = mpsc::channel();
        let from = pipe.clone();
        std::thread::spawn(move || {
            let mut pipe = BufReader::new(File::open(from).expect("the pipe"));
            let mut line = String::new();
            pipe.read_line(&mut line).expect("readable");
            let _ = tell.send(Told::Line(line.trim().to_owned()));
            let _ = pipe.read_to_end(&mut Vec::new());
            let _ = tell.send(Told::AllDead);
        });
        Confession { _folder: folder, pipe, told }
    }

    fn engine(&self) -> Installation {
        let pipe = self.pipe.display().to_string();
        fake(ExternalEngine::FastDownward, "hang.sh", &[&pipe])
    }

    /// Waits until the engine hangs, and returns the folder in which it runs.
    fn await_folder(&self) -> PathBuf {
        match self.told.recv_timeout(PATIENCE).expect("the engine starts") {
            Told::Line(line) => {
                line.split_once(' ').map(|(_, folder)| folder.into()).expect("a folder")
            }
            Told::AllDead => panic!("it died before it spoke"),
        }
    }

    /// Waits until no process of the engine is left.
    fn await_death(&self) {
        let told = self.told.recv_timeout(PATIENCE).expect("nobody of the engine's lives");
        assert!(matches!(told, Told::AllDead));
    }
}

/// Waits until a condition holds. Used for conditions without an event.
#[track_caller]
fn eventually(what: &str, holds: impl Fn() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !holds() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Returns the processes of a process group that still run, without zombies.
fn alive(group: &str) -> Vec<String> {
    let all = std::fs::read_dir("/proc").expect("/proc").filter_map(Result::ok);
    let stats = all.filter_map(|entry| std::fs::read_to_string(entry.path().join("stat")).ok());
    stats
        .filter(|stat| {
            // The format is `PID (NAME) STATE PARENT GROUP …`, and NAME may contain any character.
            let after = stat.rsplit_once(')').map_or("", |(_, after)| after);
            let fields: Vec<&str> = after.split_whitespace().collect();
            matches!(fields[..], [state, _, of, ..] if of == group && state != "Z" && state != "X")
        })
        .collect()
}

#[test]
fn a_timeout_ends_all_processes_of_an_engine() {
    let confession = Confession::new();
    let options =
        EngineOptions { time_limit: Some(Duration::from_millis(500)), ..EngineOptions::default() };
    let outcome = run(&confession.engine(), DOMAIN, PROBLEM, &options).expect("an outcome");
    assert_eq!((outcome.plan, outcome.ending), (None, Ending::OutOfTime), "half a plan is none");
    let folder = confession.await_folder();
    confession.await_death();
    assert!(!folder.exists(), "{}", folder.display());
}

#[test]
fn a_cancelled_engine_ends_and_leaves_no_files() {
    let confession = Confession::new();
    let (domain, problem) = parse(DOMAIN, PROBLEM);
    let cancel = Cancel::new();
    let (engine, seen) = (confession.engine(), cancel.clone());
    let running = std::thread::spawn(move || {
        plan(&engine, &domain, &problem, &EngineOptions::default(), &seen).expect("an outcome")
    });
    let folder = confession.await_folder();
    assert!(folder.join("domain.pddl").is_file());
    cancel.set();
    let outcome = running.join().expect("no panic");
    assert_eq!(outcome.ending, Ending::Cancelled);
    confession.await_death();
    assert!(!folder.exists(), "{}", folder.display());
}

/// Name of the environment variable with the path of the pipe for [`a_process_that_plans`].
const PIPE: &str = "ALTHING_TEST_PIPE";

#[test]
#[ignore = "it is a process of the next test"]
fn a_process_that_plans() {
    let Some(pipe) = std::env::var_os(PIPE) else { return };
    let engine =
        fake(ExternalEngine::FastDownward, "hang.sh", &[&Path::new(&pipe).display().to_string()]);
    let outcome = run(&engine, DOMAIN, PROBLEM, &EngineOptions::default());
    panic!("it came to an end: {outcome:?}");
}

#[test]
fn a_killed_process_ends_its_engine() {
    for signal in ["KILL", "TERM", "INT"] {
        let confession = Confession::new();
        // A shell may make tests in the background ignore interrupts.
        let mut process = Command::new("env")
            .arg("--default-signal=INT")
            .arg(std::env::current_exe().expect("this program"))
            .args(["--exact", "leaving::a_process_that_plans", "--ignored"])
            .env(PIPE, &confession.pipe)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        let folder = confession.await_folder();
        let id = process.id().to_string();
        let sent = Command::new("kill").args([&format!("-{signal}"), &id]).status();
        assert!(sent.expect("kill is there").success());
        confession.await_death();
        process.wait().expect("our child");
        eventually("its folder is removed", || !folder.exists());
    }
}

/// Returns the real engine, started by a script that writes the number of its process group to a
/// file.
fn traced(installation: &[&str], file: &Path) -> Installation {
    let file = file.display().to_string();
    fake(ExternalEngine::FastDownward, "traced.sh", &[&[file.as_str()], installation].concat())
}

#[test]
fn fast_downward_stays_within_its_limits() {
    let Some(installation) = fast_downward() else { return };
    let command: Vec<String> =
        installation.command().iter().map(|part| part.to_string_lossy().into_owned()).collect();
    let command: Vec<&str> = command.iter().map(String::as_str).collect();
    let (domain, problem) = endless();
    let optimally = EngineOptions { aim: PlanningAim::CheapestPlan, ..EngineOptions::default() };
    let limits = [
        (
            EngineOptions { time_limit: Some(Duration::from_secs(3)), ..optimally },
            Ending::OutOfTime,
        ),
        (EngineOptions { memory_limit: Some(90 << 20), ..optimally }, Ending::OutOfMemory),
    ];
    for (options, expected) in limits {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("group");
        let began = Instant::now();
        let outcome = run(&traced(&command, &file), &domain, &problem, &options);
        assert_eq!(outcome.expect("an outcome").ending, expected);
        if let Some(limit) = options.time_limit {
            let late = began.elapsed().saturating_sub(limit);
            assert!(late < Duration::from_secs(2), "{late:?} late");
        }
        let group = std::fs::read_to_string(&file).expect("it started");
        eventually("nobody of the engine's lives", || alive(group.trim()).is_empty());
    }
}

#[test]
fn too_little_memory_to_start_is_reported_as_out_of_memory() {
    let Some(installation) = fast_downward() else { return };
    for mebibytes in [1, 8, 24] {
        let options =
            EngineOptions { memory_limit: Some(mebibytes << 20), ..EngineOptions::default() };
        let outcome = run(&installation, DOMAIN, PROBLEM, &options);
        let ending = outcome.unwrap_or_else(|err| panic!("{mebibytes}: {err}")).ending;
        assert_eq!(ending, Ending::OutOfMemory, "{mebibytes} MiB");
    }
}
