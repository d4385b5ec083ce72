//! Plays factored tasks in one process: every agent is a [`Partner`], and the requester sees their
//! projections only. Prints a line for each task: seconds, cost of the joint plan, cost of a plan of
//! the embedded planner that sees everything, rounds, and the bytes of projections and parts.
//!
//!     cargo bench -p skeleton --bench codmap -- FOLDER [SECONDS]
//!
//! FOLDER has a folder for each domain, with a folder for each task.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use acl::content::PartStep;
use pddl::factored::{AgentFiles, merge_factored};
use pddl::{Plan, PlanStep};
use planner::{Cancel, Options};
use skeleton::{FilledPart, Partner, Projection, SkeletonOutcome, SkeletonPlan, SkeletonTask};

/// The default limit on one task, in seconds, as in the CoDMAP measurements of others.
const SECONDS: u64 = 30;

/// How one task ended.
struct Played {
    steps: Vec<PlanStep>,
    rounds: u32,
    bytes: usize,
}

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
        let played = play(&files, &cancel);
        let took = began.elapsed().as_secs_f64();
        let central = central(&files, &cancel_after(Duration::from_secs(seconds)));
        solved_centrally += usize::from(central.is_some());
        match played {
            Ok(Played { steps, rounds, bytes }) => {
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

fn play(files: &[AgentFiles], cancel: &Cancel) -> Result<Played, String> {
    let options = Options::default();
    let mut partners: BTreeMap<String, Partner> = BTreeMap::new();
    for own in files {
        partners.insert(own.agent.clone(), Partner::new(own.clone())?);
    }
    let (mut rounds, mut bytes) = (0, 0);
    let mut changed: Vec<String> = partners.keys().cloned().collect();
    loop {
        rounds += 1;
        for agent in &changed {
            let Projection { domain, problem } = partners[agent].projection();
            bytes += domain.len() + problem.len();
        }
        let projections: BTreeMap<String, Projection> =
            partners.iter().map(|(name, it)| (name.clone(), it.projection().clone())).collect();
        let task = SkeletonTask::merge(&projections).map_err(|error| format!("{error:?}"))?;
        let found = task.plan(&options, cancel).map_err(|error| format!("{error:?}"))?;
        let SkeletonOutcome::Found(skeleton) = found else {
            return Err(format!("round {rounds}: {found:?}"));
        };
        let mut filled = BTreeMap::new();
        changed.clear();
        for (agent, part) in &skeleton.parts {
            bytes += part.iter().map(length).sum::<usize>();
            let partner = partners.get_mut(agent).expect("a member");
            match partner.fill(part, &options, cancel) {
                Ok(own) => {
                    filled.insert(agent.clone(), own);
                }
                Err(refusal) => {
                    if !partner.sharpen(&refusal) {
                        return Err(format!("round {rounds}: {agent}: {}", refusal.why)
                            + &refusal
                                .private_detail
                                .unwrap_or_default()
                                .chars()
                                .take(200)
                                .collect::<String>());
                    }
                    changed.push(agent.clone());
                }
            }
        }
        if changed.is_empty() {
            return Ok(Played { steps: joined(&skeleton, filled), rounds, bytes });
        }
    }
}

fn length(step: &PartStep) -> usize {
    let (PartStep::Own(text) | PartStep::Others(text)) = step;
    text.len()
}

/// Returns the steps of all agents in the order of the skeleton.
fn joined(skeleton: &SkeletonPlan, filled: BTreeMap<String, FilledPart>) -> Vec<PlanStep> {
    let mut rest: BTreeMap<String, std::vec::IntoIter<Vec<PlanStep>>> =
        filled.into_iter().map(|(agent, part)| (agent, part.steps.into_iter())).collect();
    let mut steps = Vec::new();
    for own in rest.values_mut() {
        steps.extend(own.next().unwrap_or_default());
    }
    for owner in &skeleton.owners {
        steps.extend(rest.get_mut(owner).and_then(Iterator::next).unwrap_or_default());
    }
    steps.extend(rest.into_values().flatten().flatten());
    steps
}

/// Returns the cost of a plan in the merged task, which sees everything.
fn validated(files: &[AgentFiles], steps: &[PlanStep]) -> Result<f64, String> {
    let merged = merge_factored(files)?;
    let mut world = planner::World::initial(&merged.domain, &merged.problem)
        .map_err(|found| format!("{:?}", found.first()))?;
    // Several actions of the merged task may have the original name of a step.
    for step in steps {
        let candidates = merged.domain.actions.iter().filter(|action| {
            let plan = Plan {
                steps: vec![PlanStep::new(action.name.clone(), step.arguments.iter().cloned())],
                cost: None,
            };
            merged.original(&plan).steps[0].action == step.action
        });
        let mut why = format!("{step} is no step");
        let applied = candidates.into_iter().any(|action| {
            let mut arguments: Vec<Vec<pddl::Name>> = vec![step.arguments.clone()];
            let own: Vec<pddl::Name> =
                step.arguments.iter().map(|name| renamed(&merged, action, name)).collect();
            arguments.push(own);
            arguments.into_iter().any(|arguments| {
                let mut next = world.clone();
                match next.apply(&PlanStep::new(action.name.clone(), arguments)) {
                    Ok(()) => {
                        world = next;
                        true
                    }
                    Err(fault) => {
                        why = format!("{step}: {fault}");
                        false
                    }
                }
            })
        });
        if !applied {
            return Err(why);
        }
    }
    match world.failing(&merged.problem.goal) {
        None => Ok(world.cost().map_err(|fault| fault.to_string())?),
        Some(missing) => Err(format!("misses {missing}")),
    }
}

/// Returns the name of an object in the merged task, where a private object has its agent's name.
fn renamed(
    merged: &pddl::factored::FactoredTask,
    action: &pddl::ActionSchema,
    name: &pddl::Name,
) -> pddl::Name {
    let agent = action.name.as_str().rsplit_once("--").map(|(_, agent)| agent.to_owned());
    let own = agent.map(|agent| pddl::Name::new(&format!("{name}--{agent}")));
    match own {
        Some(own) if merged.problem.objects.iter().any(|it| it.object.name == own) => own,
        _ => name.clone(),
    }
}

/// Returns the cost of the plan of a planner that sees everything.
fn central(files: &[AgentFiles], cancel: &Cancel) -> Option<f64> {
    let merged = merge_factored(files).ok()?;
    let outcome =
        planner::plan(&merged.domain, &merged.problem, &Options::default(), cancel).ok()?;
    outcome.plan?.cost.map(|cost| cost.0)
}
