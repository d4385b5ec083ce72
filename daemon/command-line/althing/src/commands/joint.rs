//! `althing joint`: plays a factored planning task with a daemon for each agent. Each daemon has the
//! files of its own agent only, and what is `:private` leaves it under opaque names only.
//!
//! The steps of each agent come from files that the agents write, not from the network. So this
//! command can write the whole plan, and validate it on the task of all agents.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{HostServices, Mode};
use factored_agent::{JointRequest, JointRequester, JointResult};
use pddl::factored::FactoredTask;
use pddl::{Plan, PlanStep};
use planner::World;
use serde_json::json;
use skeleton::SkeletonPlan;
use tempfile::TempDir;
use terminal::factored_folder::{agents_in, read_factored};
use terminal::report::reason_of_writing;
use terminal::{exit, output};
use tokio::process::Child;
use tokio::sync::oneshot;

use crate::cli::joint::JointArgs;
use crate::commands::client;
use crate::config::{Ecosystem, Overrides, Variables};
use crate::hosting::{self, DaemonLauncher, DaemonNode, MessageTransport};
use crate::{interruption, plugins};

/// Exit codes if it is proved that there is no plan, and if none was found: those of `althing plan`.
const NO_PLAN: u8 = 11;
const NOT_FOUND: u8 = 12;

/// Name of the ecosystem in which a task is played.
const ECOSYSTEM: &str = "joint";

/// Name of the agents that request the plan, before their number.
const REQUESTER: &str = "joint-requester";

/// Time between two reports of progress, if a task is played many times.
const PROGRESS_PERIOD: Duration = Duration::from_secs(5);

/// A played task.
struct JointPlay {
    /// The result of the last planning.
    result: JointResult,
    ready_after: Duration,
    /// How long each planning took, in their order.
    times: Vec<Duration>,
    /// The steps of all agents in their order, as their files name them.
    plan: Option<Plan>,
    /// The cost by a validator that sees the files of all agents, or the reason why the plan is wrong.
    validated: Option<Result<f64, String>>,
}

/// The daemons of a task. Dropping this value ends them.
struct JointDaemons {
    folder: TempDir,
    node: DaemonNode,
    processes: Vec<(String, Child)>,
    ontology: String,
}

/// Runs `althing joint`.
pub(super) fn run(args: &JointArgs) -> ExitCode {
    let json = args.print.json;
    let task = match read_factored(&args.folder) {
        Ok(task) => task,
        Err(report) => {
            let (status, code) = report.refusal();
            return output::show(&report, json, status, code);
        }
    };
    let Some(factored) = task.factored else {
        return super::wrong("a factored task has a folder of files of its agents", json);
    };
    super::in_runtime(async {
        tokio::select! {
            played = play(args, &factored) => match played {
                Ok(played) => show(args, &played),
                Err(problem) => client::unavailable(&format!("play the task: {problem}"), json),
            },
            // Dropping the task ends all processes that it has started.
            signal = interruption::interrupted() => exit::by_signal(signal),
            () = interruption::reader_gone() => exit::with(exit::DONE),
        }
    })
}

/// Plays a task.
///
/// # Errors
///
/// Returns the reason, as text for a person, if the daemons cannot be started.
async fn play(args: &JointArgs, task: &FactoredTask) -> Result<JointPlay, String> {
    let began = Instant::now();
    let named = agents_in(&args.folder)?.into_iter();
    let agents: Vec<AgentId> = named
        .map(|agent| AgentId::new(&agent).map_err(|error| format!("`{agent}`: {error}")))
        .collect::<Result<_, _>>()?;
    let mut daemons = JointDaemons::start(&args.folder, &agents).await?;
    let ready_after = began.elapsed();
    let (result, times) = plan_repeatedly(args, &daemons, &agents).await?;
    let mut plan = None;
    let mut validated = None;
    if let Ok(skeleton) = &result.plan {
        let steps = joined(skeleton, daemons.folder.path())?;
        validated = Some(validate(task, &steps));
        let steps = steps.into_iter().map(|(_, step)| step).collect();
        plan = Some(Plan { steps, cost: None });
    }
    hosting::end_daemons(&mut daemons.processes).await;
    Ok(JointPlay { result, ready_after, times, plan, validated })
}

/// Plans as often as is asked for, each time by a new requester, or until there is no plan. Returns the
/// last result, and how long each planning took.
///
/// # Errors
///
/// Returns the reason, as text for a person, if a requester ends without a result.
async fn plan_repeatedly(
    args: &JointArgs,
    daemons: &JointDaemons,
    agents: &[AgentId],
) -> Result<(JointResult, Vec<Duration>), String> {
    let mut times = Vec::new();
    let mut told = Instant::now();
    loop {
        let began = Instant::now();
        let members = agents.iter().cloned().collect();
        let planning = JointRequest { members, within: args.time_limit };
        let (sender, result) = oneshot::channel();
        let requester = JointRequester::new(planning, sender);
        let id = AgentId::new(&format!("{REQUESTER}-{}", times.len() + 1))
            .map_err(|error| error.to_string())?;
        let _guest = hosting::launch_guest(daemons.node.router(), id, requester, &daemons.ontology);
        let result = result.await.map_err(|_| "the requester has ended".to_owned())?;
        times.push(began.elapsed());
        if result.plan.is_err() || times.len() >= args.runs as usize {
            return Ok((result, times));
        }
        if told.elapsed() >= PROGRESS_PERIOD {
            told = Instant::now();
            output::print_note(&format!("planned {} of {} times", times.len(), args.runs));
        }
    }
}

// === impl JointDaemons ===

impl JointDaemons {
    /// Copies the files of each agent into a folder of its own, and starts a daemon there.
    async fn start(files: &Path, agents: &[AgentId]) -> Result<JointDaemons, String> {
        let failed = |error: std::io::Error| format!("failed to make the agents' folders: {error}");
        let folder = tempfile::Builder::new().prefix("althing-").tempdir().map_err(failed)?;
        let mut own: Vec<(DaemonId, PathBuf)> = Vec::new();
        for agent in agents {
            let home = folder.path().join("agents").join(agent.as_str());
            std::fs::create_dir_all(&home).map_err(failed)?;
            for kind in ["domain", "problem"] {
                let from = files.join(format!("{kind}-{agent}.pddl"));
                std::fs::copy(&from, home.join(format!("{kind}.pddl"))).map_err(failed)?;
            }
            let file = home.join("althing.toml");
            std::fs::write(&file, ecosystem_file(agent, agents)).map_err(failed)?;
            let daemon = DaemonId::new(agent.as_str()).map_err(|error| error.to_string())?;
            own.push((daemon, file));
        }
        let Some((first, file)) = own.first() else { return Err("there is no agent".to_owned()) };
        let ecosystem =
            Ecosystem::load_with(file, &Variables::new(), &Overrides::default(), &plugins::known())
                .map_err(|error| format!("the task's own ecosystem file is wrong: {error:?}"))?;
        let launcher = DaemonLauncher::new(folder.path(), Mode::Decentralized)?.logging_to_files();
        let spawned = launcher.spawn_all(own.iter().map(|(daemon, file)| (daemon, file.as_path())));
        let processes = spawned.await?;
        let guest = DaemonId::new("requester").map_err(|error| error.to_string())?;
        let name = EcosystemId::new(ECOSYSTEM).map_err(|error| error.to_string())?;
        let mut config = substrate_zenoh::Config::new(name.clone(), guest.clone());
        config.mode = substrate_zenoh::SessionMode::Client;
        let meeting = folder.path().join(ECOSYSTEM);
        config.connect = vec![hosting::socket_endpoint(&meeting, first.as_str())?];
        let transport = MessageTransport::Zenoh(Box::new(config));
        let (services, settings) = (HostServices::new(None), ecosystem.settings.clone());
        let node = DaemonNode::join(services, name, guest, settings, None, transport).await;
        let node = node.map_err(|error| format!("failed to {error}"))?;
        let ontology = ecosystem.domain.name.to_string();
        Ok(JointDaemons { folder, node, processes, ontology })
    }
}

/// Returns the ecosystem file of one agent's daemon. It names all daemons, but no other agent. A file
/// must have a room.
fn ecosystem_file(agent: &AgentId, agents: &[AgentId]) -> String {
    let daemons: Vec<String> = agents.iter().map(|agent| format!("\"{agent}\"")).collect();
    format!(
        "[ecosystem]\nname = \"{ECOSYSTEM}\"\ndaemons = [{}]\n\n\
         [rooms]\nhall = {{}}\n\n\
         [[agent]]\nname = \"{agent}\"\nplugin = \"factored-agent\"\ndaemon = \"{agent}\"\n\
         config = {{ domain = \"domain.pddl\", problem = \"problem.pddl\", part = \"part\" }}\n",
        daemons.join(", ")
    )
}

// === the whole plan ===

/// Joins the steps that the agents have written to their disks, in the order of the skeleton.
///
/// # Errors
///
/// Returns the reason, as text for a person, if an agent has written no part, or that of another
/// skeleton.
fn joined(skeleton: &SkeletonPlan, folder: &Path) -> Result<Vec<(String, PlanStep)>, String> {
    let mut parts = BTreeMap::new();
    for agent in skeleton.parts.keys() {
        let path = folder.join("agents").join(agent).join("part");
        let text = std::fs::read_to_string(&path)
            .map_err(|error| format!("`{agent}` has not written its part: {error}"))?;
        let own = own_steps(&text, &skeleton.digest)
            .ok_or_else(|| format!("the part that `{agent}` has written is another one"))?;
        parts.insert(agent.clone(), own);
    }
    Ok(skeleton.join(parts))
}

/// Parses the file of an agent's part: the digest of the skeleton, then a line for each step, behind
/// the number of its group.
fn own_steps(text: &str, digest: &str) -> Option<Vec<Vec<PlanStep>>> {
    let mut lines = text.lines();
    if lines.next()? != digest {
        return None;
    }
    let mut groups: Vec<Vec<PlanStep>> = Vec::new();
    for line in lines {
        let (number, step) = line.split_once(' ')?;
        let number: usize = number.parse().ok()?;
        // Only the first group can be empty, and groups come in their order.
        if number > groups.len() + 1 {
            return None;
        }
        groups.resize(groups.len().max(number + 1), Vec::new());
        groups[number].push(pddl::parse_step(step).into_result().ok()?);
    }
    Some(groups)
}

/// Validates a plan on the task of all agents. Returns its cost.
///
/// # Errors
///
/// Returns the reason, as text for a person, if a step cannot be carried out or the goal is missed.
fn validate(task: &FactoredTask, steps: &[(String, PlanStep)]) -> Result<f64, String> {
    let world = World::initial(&task.domain, &task.problem)
        .map_err(|found| found.first().map(ToString::to_string).unwrap_or_default())?;
    let steps: Vec<PlanStep> = steps.iter().map(|(agent, step)| task.merged(agent, step)).collect();
    planner::validate::cost_from(&world, &steps, &task.problem.goal)
        .map_err(|fault| fault.to_string())
}

// === output ===

fn show(args: &JointArgs, played: &JointPlay) -> ExitCode {
    let JointPlay { result, ready_after, times, plan, validated } = played;
    let is_valid = matches!(validated, Some(Ok(_)));
    // The plan of those that did not leave is none of the task. A wrong plan is shown, as a defect.
    let plan = plan.as_ref().filter(|_| is_valid || result.left.is_empty());
    let text = plan.map(|plan| plan_text(plan, validated.as_ref()));
    if let (Some(path), Some(text)) = (&args.plan, &text)
        && let Err(error) = std::fs::write(path, text)
    {
        let why = reason_of_writing(&error);
        output::print_note(&format!("error: `{}` cannot be written: {why}", path.display()));
        return exit::with(exit::OUTPUT);
    }
    let code = match (&result.plan, is_valid) {
        (Ok(_), true) => exit::DONE,
        // What is proved of the others says nothing of the task.
        (_, _) if !result.left.is_empty() => NOT_FOUND,
        (Ok(_), false) => exit::INVALID_PLAN,
        (Err(_), _) if result.is_proved_impossible => NO_PLAN,
        (Err(_), _) => NOT_FOUND,
    };
    if args.print.json {
        let value = json!({
            "solved": plan.is_some(),
            "valid": is_valid,
            "proved_impossible": result.is_proved_impossible,
            "left": result.left,
            "reason": result.plan.as_ref().err(),
            "fault": validated.as_ref().and_then(|it| it.as_ref().err()),
            "cost": validated.as_ref().and_then(|it| it.as_ref().ok()),
            "steps": plan.map(|plan| plan.steps.len()),
            "plan": plan.map(ToString::to_string),
            "rounds": result.rounds,
            "messages": result.messages,
            "bytes": result.bytes,
            "ready_ms": milliseconds(*ready_after),
            "planned_ms": milliseconds(times[times.len() - 1]),
            "runs": times.len(),
            "first_ms": milliseconds(times[0]),
            "p50_ms": milliseconds(quantile(times, 0.5)),
            "p99_ms": milliseconds(quantile(times, 0.99)),
        });
        return output::print_json(&value, code);
    }
    output::print_note(summary(played).trim_end());
    match (text, &args.plan) {
        (Some(text), None) => output::print(text, code),
        _ => exit::with(code),
    }
}

/// Returns the result and the figures, as lines for a person.
fn summary(played: &JointPlay) -> String {
    let JointPlay { result, ready_after, times, validated, .. } = played;
    let mut told = String::new();
    let _ = writeln!(told, "the daemons were ready after {:.2} s", ready_after.as_secs_f64());
    let traffic = format!(
        "{} rounds, {} messages, {} KiB of planning on the network, {:.3} s",
        result.rounds,
        result.messages,
        result.bytes.div_ceil(1_024),
        times[times.len() - 1].as_secs_f64(),
    );
    let _ = match (&result.plan, validated) {
        (Ok(_), Some(Ok(cost))) => writeln!(told, "valid plan of cost {cost}: {traffic}"),
        (Ok(_), _) if !result.left.is_empty() => writeln!(told, "no plan: {}", left(result)),
        (Ok(_), fault) => {
            let fault = fault.as_ref().and_then(|it| it.as_ref().err());
            let fault = fault.map_or("it was not validated", String::as_str);
            writeln!(told, "error: the plan is wrong, which is a defect: {fault}")
        }
        (Err(why), _) => writeln!(told, "no plan: {why}\n{traffic}"),
    };
    if times.len() > 1 {
        let [first, p50, p99] =
            [times[0], quantile(times, 0.5), quantile(times, 0.99)].map(milliseconds);
        let count = times.len();
        let _ = writeln!(
            told,
            "planned {count} times: first {first:.1} ms, p50 {p50:.1} ms, p99 {p99:.1} ms"
        );
    }
    told
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Returns the time that this part of the plannings did not exceed.
fn quantile(times: &[Duration], part: f64) -> Duration {
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    let last = sorted.len().saturating_sub(1);
    // The nearest rank, as in the benchmarks.
    sorted[((last as f64) * part).round() as usize]
}

/// Returns which agents have left, and that the others do not reach the goal.
fn left(result: &JointResult) -> String {
    let names: Vec<String> = result.left.iter().map(|agent| format!("`{agent}`")).collect();
    format!("{} left, and the plan of the others does not reach the goal", names.join(", "))
}

/// Returns a plan in the form of the planning competitions.
fn plan_text(plan: &Plan, validated: Option<&Result<f64, String>>) -> String {
    let cost = validated.and_then(|it| it.as_ref().ok());
    let end = cost.map(|cost| format!("; cost = {cost}\n")).unwrap_or_default();
    let steps: String = plan.steps.iter().map(|step| format!("{step}\n")).collect();
    format!("{steps}{end}")
}
