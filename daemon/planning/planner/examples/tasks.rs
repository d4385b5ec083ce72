//! Plans for a list of tasks, and prints one line per task. The output shows the coverage.
//!
//! `cargo run --release -p planner --example tasks -- FOLDER LIST [SECONDS] [EVERY] [OFFSET]`
//!
//! `LIST` has one task per line, `DOMAIN PROBLEM`, relative to `FOLDER`. With `EVERY`, only every
//! `EVERY`th task is used. The example has the clock, not the planner: a thread sets the planner's
//! `Cancel` at the deadline.

use std::path::Path;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use planner::{Cancel, Options, PlanError, plan};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, list, rest @ ..] = arguments.as_slice() else {
        eprintln!("usage: tasks FOLDER LIST [SECONDS] [EVERY] [OFFSET]");
        std::process::exit(64);
    };
    let number = |index: usize, default: u64| {
        rest.get(index).and_then(|text| text.parse().ok()).unwrap_or(default)
    };
    let (limit, every) = (Duration::from_secs(number(0, 10)), number(1, 1).max(1) as usize);
    let Ok(list) = std::fs::read_to_string(list) else {
        eprintln!("failed to read {list}");
        std::process::exit(66);
    };
    let tasks = list.lines().filter(|line| !line.trim().is_empty());
    let (mut solved, mut tried) = (0, 0);
    for line in tasks.skip(number(2, 0) as usize).step_by(every) {
        tried += 1;
        let started = Instant::now();
        let (is_solved, report) = attempt(Path::new(folder), line, limit);
        solved += usize::from(is_solved);
        println!("{:8.3} s  {line}: {report}", started.elapsed().as_secs_f64());
    }
    println!("solved {solved} of {tried}");
}

fn attempt(folder: &Path, line: &str, limit: Duration) -> (bool, String) {
    let mut files = line.split_whitespace();
    let (Some(domain), Some(problem)) = (files.next(), files.next()) else {
        return (false, "not a task".to_owned());
    };
    let read = |file| std::fs::read(folder.join(file)).map_err(|err| err.to_string());
    let texts = read(domain).and_then(|domain| Ok((domain, read(problem)?)));
    let (domain, problem) = match texts {
        Ok((domain, problem)) => (domain, problem),
        Err(err) => return (false, err),
    };
    let domain = pddl::parse_domain(&pddl::text_from_bytes(&domain)).into_result();
    let problem = pddl::parse_problem(&pddl::text_from_bytes(&problem)).into_result();
    let (domain, problem) = match (domain, problem) {
        (Ok(domain), Ok(problem)) => (domain, problem),
        (Err(errors), _) | (_, Err(errors)) => return (false, format!("{:?}", errors.first())),
    };
    let parsed = Instant::now();
    let (solved, report) =
        with_deadline(limit, |cancel| match plan(&domain, &problem, &Options::default(), cancel) {
            Ok(outcome) => {
                let found = outcome.plan.as_ref().map_or(String::new(), |plan| {
                    let cost = plan.cost.map_or(String::new(), |cost| cost.to_string());
                    format!("{} steps, cost {cost}; ", plan.steps.len())
                });
                let report = format!("{}; {found}{:?}", outcome.stop_reason, outcome.statistics);
                (outcome.plan.is_some(), report)
            }
            Err(PlanError::Internal(fault)) => (false, format!("DEFECT: {fault}")),
            Err(err) => (false, err.to_string()),
        });
    (solved, format!("{:.3} s planning; {report}", parsed.elapsed().as_secs_f64()))
}

/// Calls `work` with a flag that another thread sets after `limit`.
fn with_deadline<T>(limit: Duration, work: impl FnOnce(&Cancel) -> T) -> T {
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
