//! The cost of a hundred devices: the campus of `ecosystems/`, on one machine.
//!
//! ```text
//! cargo bench -p althing --bench campus
//! ```
//!
//! - In this process: the time of a change of the composite domain, and of a plan for what is left
//!   after it.
//! - In processes of their own: the time from start to ready, resident memory with one house and
//!   with all, five times each, and how long a goal waits for its plan, in both flows.
//!
//! Each process has folders of its own and is ended after its measurement.

mod support;

use std::error::Error;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use acl::content::Methods;
use acl::{AgentId, Incarnation};
use building::{BuildingDevice, Campus, Layout};
use capability::{
    Announcement, DomainSnapshot, Maintainer, MaintainerScope, Timestamp, model_digest,
};
use pddl::{Atom, Condition, InitElement, Name, Problem, Span, Term};
use planner::explain::{self, ActionGuard, ExplanationInput};
use planner::{Cancel, GroundingReuse, Options, Replanner};
use support::Figures;

/// Allocator of the benchmark: the same as in the daemon.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Seed and number of houses of the campus, as in `ecosystems/campus.toml`.
const SEED: u64 = 1;
const HOUSES: usize = 5;

/// Number of measurements of short times; the median is printed, and the 99th percentile.
const ROUNDS: usize = 200;

/// Number of starts of a daemon to measure its memory: the set of resident pages of the binary
/// varies by chance, up to five KiB per device. The median is printed.
const STARTS: usize = 5;

/// Numbers of houses in the two measured ecosystems.
const SIZES: [usize; 2] = [1, HOUSES];

/// Wait before the measurements: ten heartbeats, after which all agents know each other, and the
/// domain is composed.
const SETTLING: Duration = Duration::from_secs(10);

const CHANGE_AIM_MS: f64 = 5.0;
const PLAN_AIM_MS: f64 = 50.0;
const REPLAN_AIM_MS: f64 = 5.0;
const DEVICE_AIM_KIB: f64 = 64.0;

const ONTOLOGY: &str = ontology::STANDARD_DOMAIN;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    // When Cargo runs tests, it only checks that the benchmark runs.
    let houses = if std::env::args().any(|argument| argument == "--bench") { HOUSES } else { 1 };
    let campus = Campus::seeded(SEED, houses);
    println!("{} devices", campus.layout().devices().len());
    change_and_replan(&campus)?;
    if houses == HOUSES {
        memory()?;
        for mode in ["centralized", "decentralized"] {
            goal(&campus, mode)?;
        }
    }
    Ok(())
}

fn tell(what: &str, value: f64, unit: &str, aim: Option<f64>) {
    let verdict = match aim {
        Some(aim) if value <= aim => format!(", aim ≤ {aim} {unit}: reached"),
        Some(aim) => format!(", aim ≤ {aim} {unit}: missed"),
        None => String::new(),
    };
    println!("{what}: {value:.2} {unit}{verdict}");
}

/// Prints the median, and the 99th percentile, which has an aim.
fn tell_figures(what: &str, figures: &Figures, aim: f64) {
    tell(&format!("{what}, p50"), figures.within(0.5), "ms", None);
    tell(&format!("{what}, p99"), figures.within(0.99), "ms", Some(aim));
}

fn figures(mut measure: impl FnMut() -> Outcome<()>) -> Outcome<Figures> {
    let mut figures = Figures::default();
    for _ in 0..ROUNDS {
        let begun = Instant::now();
        measure()?;
        figures.push(begun.elapsed());
    }
    Ok(figures)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

// === in this process ===

fn change_and_replan(campus: &Campus) -> Outcome<()> {
    let ontology = pddl::parse_domain(ONTOLOGY).into_result().map_err(|_| "the domain")?;
    let map = pddl::parse_problem(&campus.map(ontology::STANDARD_NAME))
        .into_result()
        .map_err(|_| "the map")?;
    let mut maintainer = Maintainer::new(ontology, map, MaintainerScope::Everything);
    let layout = campus.layout();
    for device in layout.devices() {
        maintainer.admit(announcement(device)?, Timestamp(0)).map_err(|error| error.to_string())?;
    }
    let dying = layout.rooms().find_map(|room| layout.fixed_sensors_in(room).next());
    let dying = AgentId::new(dying.ok_or("no thermometer")?)?;
    let incarnation = Incarnation::default();
    let change = figures(|| {
        maintainer.mask(&dying, incarnation, Timestamp(1));
        maintainer.snapshot(Timestamp(1));
        maintainer.unmask(&dying, incarnation, Timestamp(1));
        maintainer.snapshot(Timestamp(1));
        Ok(())
    })?;
    tell(
        "a change, composed into a domain and a problem",
        change.within(0.5) / 2.0,
        "ms",
        Some(CHANGE_AIM_MS),
    );

    let all = plan_for(&maintainer.snapshot(Timestamp(1)), layout, None)?;
    tell_figures("a plan for all rooms", &all, PLAN_AIM_MS);
    maintainer.mask(&dying, incarnation, Timestamp(1));
    let room = dying.as_str().trim_start_matches("thermometer-");
    let again = plan_for(&maintainer.snapshot(Timestamp(1)), layout, Some(room))?;
    tell_figures("the same, when the thermometer of one room is gone", &again, PLAN_AIM_MS);
    let (without, with) = {
        let without = maintainer.snapshot(Timestamp(1));
        maintainer.unmask(&dying, incarnation, Timestamp(1));
        (without, maintainer.snapshot(Timestamp(1)))
    };
    let kept = replan_for(&[with, without], layout, room)?;
    tell_figures("a replan: it is gone, or back", &kept, REPLAN_AIM_MS);
    maintainer.mask(&dying, incarnation, Timestamp(1));
    for device in layout.devices() {
        if !matches!(device, BuildingDevice::Robot { .. }) {
            maintainer.mask(&AgentId::new(device.name())?, incarnation, Timestamp(1));
        }
    }
    let nobody = maintainer.snapshot(Timestamp(1));
    for (what, rooms) in [("one room", 1), ("all rooms", usize::MAX)] {
        let rooms: Vec<_> = layout.rooms().take(rooms).map(known).map(Condition::Atom).collect();
        let took = explain(&nobody, &rooms)?;
        tell(
            &format!("an explanation: no thermometer is left for {what}"),
            took.within(0.5),
            "ms",
            None,
        );
    }
    Ok(())
}

/// Measures the time to explain why these conditions cannot be reached.
fn explain(snapshot: &DomainSnapshot, parts: &[Condition]) -> Outcome<Figures> {
    let guards = snapshot.guards().into_iter().map(|(inside, guard)| {
        let (outside, predicate) = (Name::new(&guard.action), Name::new(&guard.predicate));
        (Name::new(&inside), ActionGuard { outside, predicate })
    });
    let (domain, problem, guards) = (&*snapshot.domain, &snapshot.problem, guards.collect());
    let known = ExplanationInput { domain, problem, guards: &guards, former: &[] };
    figures(|| {
        let explained = explain::explain(known, parts, &Options::default(), &Cancel::new());
        let obstacles = explained.map_err(|error| error.to_string())?.obstacles.len();
        if obstacles == parts.len() { Ok(()) } else { Err("something can be reached".into()) }
    })
}

fn known(room: &str) -> Atom {
    Atom {
        predicate: Name::new("known-temperature"),
        arguments: vec![Term::Object(Name::new(room))],
        span: Span::default(),
    }
}

/// Measures the time to plan for all rooms, when all are known except `unknown`, or none is.
fn plan_for(snapshot: &DomainSnapshot, layout: &Layout, unknown: Option<&str>) -> Outcome<Figures> {
    let problem = problem_for(snapshot, layout, unknown);
    figures(|| {
        let outcome =
            planner::plan(&snapshot.domain, &problem, &Options::default(), &Cancel::new());
        let plan = outcome.map_err(|error| error.to_string())?.plan.ok_or("no plan")?;
        if plan.steps.is_empty() { Err("nothing to do".into()) } else { Ok(()) }
    })
}

/// Measures the time to plan again, in turn, for snapshots that the planner has planned in before.
fn replan_for(snapshots: &[DomainSnapshot], layout: &Layout, unknown: &str) -> Outcome<Figures> {
    let problem = |snapshot| problem_for(snapshot, layout, Some(unknown));
    let problems: Vec<Problem> = snapshots.iter().map(problem).collect();
    let (mut replanner, mut round) = (Replanner::default(), 0);
    let mut again = || {
        let turn = round % snapshots.len();
        round += 1;
        let (domain, problem) = (&snapshots[turn].domain, &problems[turn]);
        let (options, cancel) = (Options::default(), Cancel::new());
        let replanned = replanner.plan(domain, problem, &[], &options, &cancel);
        let replanned = replanned.map_err(|error| error.to_string())?;
        let is_kept = replanned.grounding_reuse == GroundingReuse::Kept || round <= snapshots.len();
        if replanned.outcome.plan.is_some() && is_kept {
            Ok(())
        } else {
            Err(format!("{:?}", replanned.grounding_reuse).into())
        }
    };
    for _ in snapshots {
        again()?;
    }
    figures(again)
}

/// Returns the goal to know all rooms, when all are known except `unknown`, or none is.
fn problem_for(snapshot: &DomainSnapshot, layout: &Layout, unknown: Option<&str>) -> Problem {
    let goal = layout.rooms().map(|room| Condition::Atom(known(room))).collect();
    let mut problem = snapshot.with_goal(&Condition::And(goal), None);
    if let Some(unknown) = unknown {
        let others = layout.rooms().filter(|room| *room != unknown);
        problem.init.extend(others.map(|room| InitElement::Atom(known(room))));
    }
    problem
}

/// Returns the announcement of a device's plugin.
fn announcement(device: &BuildingDevice) -> Outcome<Announcement> {
    let name = device.name();
    let said = match device {
        BuildingDevice::FixedSensor { location, .. } => format!(
            "(:objects {name} - temperature-sensor) (:init (located {name} {location}))
             (:action report-temperature :agent ?s - temperature-sensor
               :parameters (?r - room) :precondition (located ?s ?r)
               :effect (and (known-temperature ?r) (increase (total-cost) 1)))"
        ),
        BuildingDevice::Robot { start, meters_per_second, .. } => format!(
            "(:types turtlebot - mobile-base) (:objects {name} - turtlebot)
             (:init (at {name} {start}) (= (speed {name}) {meters_per_second}))
             (:action move :agent ?b - turtlebot :parameters (?from ?to - location)
               :precondition (and (at ?b ?from) (connected ?from ?to))
               :effect (and (not (at ?b ?from)) (at ?b ?to)
                 (increase (total-cost) (distance ?from ?to))))"
        ),
        BuildingDevice::MountedSensor { carrier, .. } => format!(
            "(:objects {name} - ir-temperature-sensor) (:init (mounted-on {name} {carrier}))
             (:action report-temperature :agent ?s - ir-temperature-sensor
               :parameters (?b - mobile-base ?r - room)
               :precondition (and (mounted-on ?s ?b) (at ?b ?r))
               :effect (and (known-temperature ?r) (increase (total-cost) 2)))"
        ),
        _ => return Err("a device that the campus does not have".into()),
    };
    let text = format!("(define (agent {name}) (:domain smart-office) {said})");
    let model = pddl::parse_action_model(&text).into_result().map_err(|_| "a model")?;
    let (agent, methods) = (AgentId::new(name)?, Methods::new());
    let digest = model_digest(&text, &methods);
    Ok(Announcement::new(agent, Incarnation::default(), model, methods, &digest))
}

// === in processes of their own ===

/// A daemon that has settled: the time until it was ready, and its memory in KiB, in total and
/// without the pages of its binary.
struct Settled {
    ready_ms: f64,
    resident: f64,
    own: f64,
}

fn memory() -> Outcome<()> {
    let rounds: Vec<_> = (0..STARTS).map(|_| settled()).collect::<Outcome<_>>()?;
    let of = |of: &dyn Fn(&[Settled; 2]) -> f64| median(rounds.iter().map(of).collect());
    for (size, houses) in SIZES.iter().enumerate() {
        let ready = of(&|round| round[size].ready_ms);
        tell(&format!("start to ready, {houses} houses"), ready, "ms", None);
        let resident = of(&|round| round[size].resident) / 1_024.0;
        tell(&format!("resident after {SETTLING:?}, {houses} houses"), resident, "MiB", None);
    }
    let further = ((SIZES[1] - SIZES[0]) * building::DEVICES_PER_HOUSE) as f64;
    let each = |[few, many]: &[Settled; 2]| (many.resident - few.resident) / further;
    let own = |[few, many]: &[Settled; 2]| (many.own - few.own) / further;
    for round in &rounds {
        println!("  per further device: {:.1} KiB, own {:.1} KiB", each(round), own(round));
    }
    tell("resident memory per further device", of(&each), "KiB", Some(DEVICE_AIM_KIB));
    tell("without pages of the binary", of(&own), "KiB", None);
    Ok(())
}

/// Starts a daemon of each size, one after the other, and lets both settle at the same time.
fn settled() -> Outcome<[Settled; 2]> {
    let start = |houses| Daemon::start(&Campus::seeded(SEED, houses), "decentralized");
    let daemons = [start(SIZES[0])?, start(SIZES[1])?];
    std::thread::sleep(SETTLING);
    let [few, many] = daemons.each_ref().map(Daemon::settled);
    Ok([few?, many?])
}

/// Measures how long the goal of one house, and that of all rooms, wait for their plan.
fn goal(campus: &Campus, mode: &str) -> Outcome<()> {
    for goal in ["house-a", "temperatures"] {
        // A daemon for each, because a goal would wait for the robots of another one.
        let daemon = Daemon::start(campus, mode)?;
        std::thread::sleep(SETTLING);
        let begun = Instant::now();
        let mut asking = daemon.command(&["goal", goal, "--ecosystem"]).spawn()?;
        let stdout = asking.stdout.take().ok_or("no standard output")?;
        let planned = BufReader::new(stdout).lines().map_while(Result::ok).find_map(|line| {
            (line.contains("a plan of") || line.starts_with("failed")).then_some(line)
        });
        let took = begun.elapsed().as_secs_f64() * 1_000.0;
        // The rest of the run is not measured.
        let _ = asking.kill();
        let _ = asking.wait();
        let planned = planned.unwrap_or_else(|| "nothing was said".to_owned());
        let what = planned.trim_start_matches("progress").trim();
        let what = what.chars().take(60).collect::<String>();
        tell(&format!("{mode}, asked to told, `{goal}`: {what}"), took, "ms", None);
    }
    Ok(())
}

/// A daemon that is ready; it is killed when this is dropped.
struct Daemon {
    process: Child,
    ready_ms: f64,
    file: PathBuf,
    folder: tempfile::TempDir,
}

impl Daemon {
    fn start(campus: &Campus, mode: &str) -> Outcome<Daemon> {
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("campus.toml");
        fs::write(&file, campus.ecosystem())?;
        let begun = Instant::now();
        let process = command(&folder).arg("up").arg(&file).args(["--mode", mode]).spawn()?;
        // Owned from here on, so that the process ends also if its output is wrong.
        let mut daemon = Daemon { process, ready_ms: 0.0, file, folder };
        let stdout = daemon.process.stdout.take().ok_or("no standard output")?;
        for line in BufReader::new(stdout).lines() {
            if line?.contains("is ready") {
                daemon.ready_ms = begun.elapsed().as_secs_f64() * 1_000.0;
                return Ok(daemon);
            }
        }
        Err("the daemon ended before it was ready".into())
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = command(&self.folder);
        command.args(arguments).arg(&self.file);
        command
    }

    fn settled(&self) -> Outcome<Settled> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.process.id()))?;
        let kib = |what: &str| -> Outcome<f64> {
            let line = status.lines().find_map(|line| line.strip_prefix(what));
            let kib = line.and_then(|line| line.split_whitespace().next());
            Ok(kib.ok_or("the system does not tell how much memory a process holds")?.parse()?)
        };
        let (resident, own) = (kib("VmRSS:")?, kib("RssAnon:")?);
        Ok(Settled { ready_ms: self.ready_ms, resident, own })
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn command(folder: &tempfile::TempDir) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_althing"));
    command
        .env("ALTHING_RUNTIME_DIR", folder.path().join("run"))
        .env("ALTHING_STATE_DIR", folder.path().join("state"))
        .stdin(Stdio::null())
        .stdout(Stdio::piped());
    command
}
