//! Measures the time and memory of grounding a list of tasks. Prints one line per task, with the
//! sizes of the ground problem.
//!
//! `cargo bench -p planner --bench grounding -- FOLDER LIST [--seconds S] [--translator COMMAND]`
//!
//! - `LIST` has one task per line, `DOMAIN PROBLEM`, relative to `FOLDER`.
//! - Every task runs in its own process, so that its memory is measured separately. Times are
//!   processor times, or wall-clock times if the system does not provide processor times.
//! - `COMMAND` is a shell command that runs Fast Downward's translator, for example
//!   `fast-downward.py --translate`; the time and memory that the translator reports are printed
//!   beside ours.

use std::path::Path;
use std::process::{Command, ExitCode};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use planner::{Budget, Cancel, GroundProblem, StopReason, prepare};

/// Limit on the work of finding mutex groups, in units of about ten nanoseconds.
const GROUPS_WORK_MAX: u64 = 100_000_000;

/// Command-line argument that makes this process ground a single task.
const ONE: &str = "--one";

fn main() -> ExitCode {
    // Cargo adds `--bench` to the arguments of the user.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|one| one != "--bench").collect();
    let option = |name: &str| {
        let at = arguments.iter().position(|one| one == name)?;
        arguments.get(at + 1).cloned()
    };
    let seconds = option("--seconds").and_then(|text| text.parse().ok()).unwrap_or(30);
    match arguments.as_slice() {
        [one, domain, problem, ..] if one == ONE => {
            println!("{}", ground(Path::new(domain), Path::new(problem), seconds));
            ExitCode::SUCCESS
        }
        [folder, list, ..] => all(Path::new(folder), list, seconds, option("--translator")),
        // `cargo bench` without arguments runs all benchmarks, this one without tasks.
        _ => {
            eprintln!("usage: grounding FOLDER LIST [--seconds S] [--translator COMMAND]");
            ExitCode::SUCCESS
        }
    }
}

fn all(folder: &Path, list: &str, seconds: u64, translator: Option<String>) -> ExitCode {
    let Ok(list) = std::fs::read_to_string(list) else {
        eprintln!("failed to read {list}");
        return ExitCode::from(66);
    };
    for line in list.lines() {
        let Some((domain, problem)) = line.trim().split_once(' ') else { continue };
        let (domain, problem) = (folder.join(domain), folder.join(problem));
        let ours = measure_ours(&domain, &problem, seconds);
        println!("{line}: {ours}");
        if let Some(translator) = &translator {
            println!("    {}", compare(translator, &domain, &problem, seconds, &ours));
        }
    }
    ExitCode::SUCCESS
}

/// Grounds one task in a separate process.
fn measure_ours(domain: &Path, problem: &Path, seconds: u64) -> String {
    let output = std::env::current_exe().and_then(|this| {
        Command::new(this)
            .args([ONE.as_ref(), domain, problem])
            .args(["--seconds", &seconds.to_string()])
            .output()
    });
    match output {
        Ok(output) if output.status.success() => {
            String::from_utf8_lossy(&output.stdout).trim().to_owned()
        }
        Ok(output) => format!("{}: {}", output.status, String::from_utf8_lossy(&output.stderr)),
        Err(err) => err.to_string(),
    }
}

/// Runs Fast Downward's translator on the same task, and returns its report and the ratios.
fn compare(translator: &str, domain: &Path, problem: &Path, seconds: u64, ours: &str) -> String {
    let folder = std::env::temp_dir().join(format!("grounding-{}", std::process::id()));
    if let Err(err) = std::fs::create_dir_all(&folder) {
        return err.to_string();
    }
    let command = format!("timeout {seconds} {translator} \"$0\" \"$1\"");
    let shell = Command::new("sh")
        .args(["-c", &command])
        .args([domain, problem])
        .current_dir(&folder)
        .output();
    let _ = std::fs::remove_dir_all(&folder);
    let text = match shell {
        Ok(output) => String::from_utf8_lossy(&output.stdout).into_owned(),
        Err(err) => return err.to_string(),
    };
    let theirs = (
        number_after(&text, "Done! ["),
        number_after(&text, "Translator peak memory: ").map(|kilobytes| kilobytes / 1024.0),
        number_after(&text, "Translator operators: "),
    );
    let (Some(time), Some(memory), Some(operators)) = theirs else {
        return format!("translator: nothing within {seconds} s");
    };
    let ratio = |theirs: f64, ours: Option<f64>| ours.map_or(f64::NAN, |ours| theirs / ours);
    format!(
        "translator: {time:.2} s, {memory:.0} MB, {operators} operators; {:.0} times our time, \
         {:.1} times our memory",
        ratio(time, number_after(ours, "total ")),
        ratio(memory, number_after(ours, "peak ")),
    )
}

fn number_after(text: &str, before: &str) -> Option<f64> {
    let rest = text.split(before).nth(1)?;
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
    rest[..end].parse().ok()
}

fn ground(domain: &Path, problem: &Path, seconds: u64) -> String {
    let (Ok(domain), Ok(problem)) = (std::fs::read(domain), std::fs::read(problem)) else {
        return "cannot be read".to_owned();
    };
    let start = Clock::now();
    let domain = pddl::parse_domain(&pddl::text_from_bytes(&domain)).into_result();
    let problem = pddl::parse_problem(&pddl::text_from_bytes(&problem)).into_result();
    let (Ok(domain), Ok(problem)) = (domain, problem) else {
        return "cannot be parsed".to_owned();
    };
    let parsed = Clock::now();
    let prepared = match prepare(&domain, &problem) {
        Ok(prepared) => prepared,
        Err(err) => return err.to_string(),
    };
    let normalized = Clock::now();
    let ground =
        within(Duration::from_secs(seconds), |cancel| prepared.ground(Budget::default(), cancel));
    let grounded = Clock::now();
    let peak = peak_megabytes();
    format!(
        "parse {:.3} normalize {:.3} ground {:.3} total {:.3} s, peak {peak:.1} MB; {}",
        parsed.since(start),
        normalized.since(parsed),
        grounded.since(normalized),
        grounded.since(start),
        describe(&ground),
    )
}

fn describe(ground: &GroundProblem) -> String {
    let start = Clock::now();
    let groups = ground.groups(GROUPS_WORK_MAX, &Cancel::new());
    let grouped = Clock::now();
    let extent = ground.extent();
    let stopped =
        extent.stop_reason.map_or(String::new(), |reason: StopReason| format!("; {reason}"));
    format!(
        "{} facts, {} derived, {} comparisons, {} operators, {} conditional effects, {} axioms, \
         {} join steps; {:.3} s for {} groups, {} variables{stopped}",
        extent.facts,
        extent.derived,
        extent.comparisons,
        extent.operators,
        extent.conditional_effects,
        extent.axioms,
        extent.join_steps,
        grouped.since(start),
        groups.groups,
        groups.variables,
    )
}

/// Calls `work` with a flag that another thread sets after `limit`.
fn within<T>(limit: Duration, work: impl FnOnce(&Cancel) -> T) -> T {
    let cancel = Cancel::new();
    let (finished, waiting) = mpsc::channel::<()>();
    let flag = cancel.clone();
    let clock = std::thread::spawn(move || {
        if waiting.recv_timeout(limit).is_err() {
            flag.set();
        }
    });
    let result = work(&cancel);
    // The clock thread ends in any case; if sending fails, it has already ended.
    let _ = finished.send(());
    let _ = clock.join();
    result
}

/// Processor time of this thread in seconds, or wall-clock time if the system does not provide it.
#[derive(Clone, Copy)]
struct Clock {
    wall: Instant,
    nanoseconds: Option<u64>,
}

// === impl Clock ===

impl Clock {
    fn now() -> Clock {
        let told = std::fs::read_to_string("/proc/thread-self/schedstat");
        let nanoseconds =
            told.ok().and_then(|text| text.split_whitespace().next()?.parse::<u64>().ok());
        Clock { wall: Instant::now(), nanoseconds }
    }

    fn since(self, earlier: Clock) -> f64 {
        match (self.nanoseconds, earlier.nanoseconds) {
            (Some(now), Some(then)) => now.saturating_sub(then) as f64 / 1e9,
            _ => self.wall.duration_since(earlier.wall).as_secs_f64(),
        }
    }
}

/// Returns the peak memory of this process in megabytes; NaN if the system does not provide it.
fn peak_megabytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    number_after(&status.replace([' ', '\t'], ""), "VmHWM:").unwrap_or(f64::NAN) / 1024.0
}
