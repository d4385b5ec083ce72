//! Plays factored tasks in one process: the requester sees the projections of the agents
//! only. Prints a line for each task: seconds, cost of the joint plan, cost of a plan of
//! the embedded planner that sees everything, rounds, and the bytes of projections and parts.
//!
//!     cargo bench -p skeleton --bench codmap -- FOLDER [SECONDS]
//!
//! FOLDER has a folder for each domain, with a folder for each task.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use pddl::PlanStep;
use pddl::factored::{AgentFiles, merge_factored};
use planner::{Cancel, Options};
use skeleton::{LocalPlan, plan_in_one_process};

/// The default limit on one task, in seconds, as in the CoDMAP measurements of others.
const SECONDS: u64 = 30;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|it| it != "--bench").collect();
    let Some(folder) = arguments.first() else {
        println!("name a folder with factored tasks: see the head of benches/codmap.rs");
        return;
    };
    let seconds = arguments.get(1).and_then(|it| it.parse().ok()).unwrap_or(SECONDS);
    let only = arguments.get(2);
    let (mut solved, mut solved_centrally, mut all) = (0, 0, 0);
    let (mut ratios, mut seconds_taken, mut sizes) = (Vec::new(), Vec::new(), Vec::new());
    for task in tasks(Path::new(folder)) {
        let name = task.strip_prefix(folder).unwrap_or(&task).display().to_string();
        if only.is_some_and(|only| !name.contains(only.as_str())) {
            continue;
        }
        all += 1;
        let files = read(&task);
        let began = Instant::now();
        let cancel = cancel_after(Duration::from_secs(seconds));
        let mut bytes = 0;
        let played = plan_in_one_process(&files, &Options::default(), &cancel, &mut |text| {
            bytes += text.len();
        });
        let took = began.elapsed().as_secs_f64();
        let central = central(&files, &cancel_after(Duration::from_secs(seconds)));
        solved_centrally += usize::from(central.is_some());
        match played {
            Ok(LocalPlan { steps: Some(steps), rounds }) => {
                let cost = validated(&files, &steps);
                if cost.is_ok() {
                    solved += 1;
                    seconds_taken.push(took);
                    sizes.push(bytes as f64);
                }
                if let (Ok(own), Some(central)) = (&cost, central) {
                    ratios.push((own / central).ln());
                }
                println!(
                    "{name}: {took:.3} s, cost {cost:?} of {central:?}, {rounds} rounds, {bytes} bytes"
                );
            }
            Ok(LocalPlan { steps: None, rounds }) => println!("{name}: no plan, {rounds} rounds"),
            Err(why) => println!("{name}: none: {why}"),
        }
    }
    let limit = seconds as f64;
    let score = |took: &f64| if *took <= 1.0 { 1.0 } else { 1.0 - took.ln() / limit.ln() };
    let agile: f64 = seconds_taken.iter().map(score).sum();
    println!(
        "{solved} of {all} solved ({solved_centrally} by a planner that sees everything), agile score \
         {agile:.1}, median {:.3} s, {:.0} bytes; cost of joint ÷ central plans {:.3}, {} tasks",
        middle(&mut seconds_taken),
        middle(&mut sizes),
        (ratios.iter().sum::<f64>() / ratios.len() as f64).exp(),
        ratios.len()
    );
}

fn middle(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Returns the folders with files of agents, sorted.
fn tasks(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let Ok(entries) = std::fs::read_dir(folder) else { return found };
    let paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    let is_domain = |path: &PathBuf| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("domain-"))
    };
    if paths.iter().any(is_domain) {
        found.push(folder.to_owned());
    }
    paths.iter().filter(|path| path.is_dir()).for_each(|path| found.extend(tasks(path)));
    found.sort();
    found
}

fn read(folder: &Path) -> Vec<AgentFiles> {
    let mut agents: Vec<String> = std::fs::read_dir(folder)
        .expect("a folder")
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().to_string_lossy().into_owned();
            Some(name.strip_prefix("domain-")?.strip_suffix(".pddl")?.to_owned())
        })
        .collect();
    agents.sort();
    let text = |kind: &str, agent: &str| {
        std::fs::read_to_string(folder.join(format!("{kind}-{agent}.pddl"))).expect("a file")
    };
    let files = |agent: String| AgentFiles {
        domain: pddl::parse_domain(&text("domain", &agent)).into_result().expect("a domain"),
        problem: pddl::parse_problem(&text("problem", &agent)).into_result().expect("a problem"),
        agent,
    };
    agents.into_iter().map(files).collect()
}

/// Returns a flag that is set after a time.
fn cancel_after(time: Duration) -> Cancel {
    let cancel = Cancel::default();
    let set = cancel.clone();
    std::thread::spawn(move || {
        std::thread::sleep(time);
        set.set();
    });
    cancel
}

/// Returns the cost of a plan in the merged task, which sees everything.
fn validated(files: &[AgentFiles], steps: &[(String, PlanStep)]) -> Result<f64, String> {
    let merged = merge_factored(files)?;
    let world = planner::World::initial(&merged.domain, &merged.problem)
        .map_err(|found| format!("{:?}", found.first()))?;
    let steps: Vec<PlanStep> =
        steps.iter().map(|(agent, step)| merged.merged(agent, step)).collect();
    planner::validate::cost_from(&world, &steps, &merged.problem.goal)
        .map_err(|fault| fault.to_string())
}

/// Returns the cost of the plan of a planner that sees everything.
fn central(files: &[AgentFiles], cancel: &Cancel) -> Option<f64> {
    let merged = merge_factored(files).ok()?;
    let outcome =
        planner::plan(&merged.domain, &merged.problem, &Options::default(), cancel).ok()?;
    outcome.plan?.cost.map(|cost| cost.0)
}
