//! The script of a trial, drawn from a seed: agents and their daemons, goals, faults and their
//! times.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{Keep, Mode, Partition};
use building::{Layout, LayoutError};
use fastrand::Rng;
use serde_json::{Value, json};

/// End of the first phase, in which the only faults are blinks, which must have no effect.
pub const BLINKS_UNTIL: Duration = Duration::from_secs(20);

/// End of the faults.
pub const FAULTS_UNTIL: Duration = Duration::from_secs(75);

/// One of this many seeds has a second ecosystem.
const JOINED_EVERY: u64 = 4;

/// Names of the interfacing nodes.
const GATES: [&str; 2] = ["gate-there", "gate-back"];

/// Minimum number of daemons in a trial.
pub const DAEMONS_MIN: usize = 5;
/// Minimum number of agents with different names, without the people.
pub const AGENTS_MIN: usize = 20;
/// Minimum number of goals.
pub const GOALS_MIN: usize = 3;
/// Minimum number of faults.
pub const FAULTS_MIN: usize = 30;

/// Length of a blink in milliseconds: shorter than the grace, with a margin.
const BLINK_MS: std::ops::Range<u64> = 20..350;

/// Direction in which an interfacing node exports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportDirection {
    /// From the laboratory to the annex.
    ToAnnex,
    /// From the annex to the laboratory.
    FromAnnex,
}

/// A mechanism that keeps a promise. A trial can run without it, to test that the laboratory
/// detects its absence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Safeguard {
    /// Actuators remember which commands they have begun.
    Fencing,
    /// Agents remember which messages they have received.
    Duplicates,
    /// The records of a Journal outlive its process.
    Journal,
    /// A plan tolerates the absence of an agent for a while.
    Grace,
    /// A proxy agent names the ecosystems through which it has come.
    Loops,
    /// A stop outlives the process of a daemon.
    Latch,
}

/// A trial, drawn from a seed.
#[derive(Clone, Debug)]
pub struct TrialScript {
    /// The seed.
    pub seed: u64,
    /// The flow by which plans are made.
    pub mode: Mode,
    /// Names of the daemons. Only the links of the first daemon ever fail, because people have
    /// their terminals there.
    pub daemons: Vec<String>,
    /// The agents.
    pub agents: Vec<AgentPlacement>,
    /// Rooms and corridors, and the devices in them.
    pub layout: Layout,
    /// Goals to request.
    pub scripted_goals: Vec<ScriptedGoal>,
    /// Faults, in order of time.
    pub faults: Vec<(Duration, InjectedFault)>,
    /// Times at which goals are requested from a second ecosystem. Without a second ecosystem the
    /// list is empty; otherwise the last two daemons are interfacing nodes.
    pub annex_requests_at: Vec<Duration>,
}

/// One agent of a trial.
#[derive(Clone, Debug)]
pub struct AgentPlacement {
    /// Name of the agent.
    pub name: String,
    /// Name of the agent's plugin.
    pub plugin: &'static str,
    /// Daemons that may host the agent, by number.
    pub daemons: Vec<usize>,
    /// The agent's `config`.
    pub config: Value,
}

/// A goal of a trial.
#[derive(Clone, Debug)]
pub struct ScriptedGoal {
    /// Time of the request.
    pub at: Duration,
    /// Number of the person that requests it.
    pub by: usize,
    /// The goal, a PDDL condition.
    pub goal: String,
    /// The rooms that the goal is about: their temperature is to be known.
    pub rooms: Vec<String>,
    /// Whether the goal is to be achieved once or kept.
    pub keep: Keep,
    /// Behaviour during a partition.
    pub partition: Partition,
}

/// A fault that the trial injects.
#[derive(Clone, Debug, PartialEq)]
pub enum InjectedFault {
    /// A process dies, and is started again after this duration.
    Crash(usize, Duration),
    /// All processes except that of the people die at once, and are started again after this
    /// duration.
    CrashAll(Duration),
    /// The links between these daemons and all others break. The break is detected after the lease,
    /// which is the first duration, and mended after the second.
    Cut(BTreeSet<usize>, Duration, Duration),
    /// All links lose, duplicate and reorder messages for a while. The shares are in hundredths.
    Storm {
        /// Share of messages lost.
        lost: u32,
        /// Share of messages delivered twice.
        doubled: u32,
        /// Share of messages delivered after later ones.
        overtaken: u32,
        /// Duration of the fault.
        lasts: Duration,
    },
    /// All messages are delayed by up to the first duration, for the second duration.
    Delay(Duration, Duration),
    /// All messages to a daemon are delayed by the first duration, for the second duration.
    Slow(usize, Duration, Duration),
    /// A machine's clock jumps by this many seconds.
    Clock(usize, i64),
}

// === impl TrialScript ===

impl TrialScript {
    /// Draws the trial of a seed.
    ///
    /// # Errors
    ///
    /// Returns an error if the drawn plan is no valid building, which is a mistake of this file.
    pub fn draw(seed: u64) -> Result<TrialScript, LayoutError> {
        let rng = &mut Rng::with_seed(seed);
        let mode = if rng.bool() { Mode::Centralized } else { Mode::Decentralized };
        let daemons: Vec<_> = (0..rng.usize(DAEMONS_MIN..8)).map(|n| format!("d{n}")).collect();
        let rooms: Vec<_> = (1..=rng.usize(6..9)).map(|n| format!("room-{n}")).collect();
        let mut layout = draw_layout(&rooms, rng)?;
        let mut agents = reasoning(daemons.len(), rng);
        agents.extend(devices(&rooms, daemons.len(), &mut layout, rng)?);
        let wishes = draw_goals(&rooms, rng);
        let robots = agents.iter().filter(|entry| entry.plugin == "turtlebot");
        let robots: Vec<_> = robots.flat_map(|entry| entry.daemons.clone()).collect();
        let faults = faults(daemons.len(), &robots, rng);
        let errands = Vec::new();
        let mut script = TrialScript {
            seed,
            mode,
            daemons,
            agents,
            layout,
            scripted_goals: wishes,
            faults,
            annex_requests_at: errands,
        };
        script.add_sensors(&rooms)?;
        if seed % JOINED_EVERY == JOINED_EVERY - 1 {
            script.join_annex(rng);
        }
        Ok(script)
    }

    /// Adds wall thermometers until there are enough agents. Uses its own random generator, so that
    /// everything else is drawn as before this step existed.
    fn add_sensors(&mut self, rooms: &[String]) -> Result<(), LayoutError> {
        let rng = &mut Rng::with_seed(!self.seed);
        for n in 1.. {
            if self.agents.len() >= AGENTS_MIN {
                break;
            }
            let name = format!("wall-more-{n}");
            self.agents.push(wall(name, rooms, self.daemons.len(), &mut self.layout, rng)?);
        }
        Ok(())
    }

    /// Joins a second ecosystem by two interfacing nodes, which die and are cut off like other
    /// daemons.
    fn join_annex(&mut self, rng: &mut Rng) {
        let (from, until) = (BLINKS_UNTIL.as_millis() as u64, FAULTS_UNTIL.as_millis() as u64);
        let millis = |rng: &mut Rng, range| Duration::from_millis(rng.u64(range));
        for gate in GATES {
            self.daemons.push(gate.to_owned());
            let number = self.daemons.len() - 1;
            for _ in 0..rng.usize(1..4) {
                let (lease, lasts) = (millis(rng, 0..2_000), millis(rng, 100..9_000));
                let fault = match rng.bool() {
                    true => InjectedFault::Crash(number, lasts),
                    false => InjectedFault::Cut([number].into(), lease, lasts),
                };
                self.faults.push((millis(rng, from..until), fault));
            }
        }
        self.faults.sort_by_key(|(at, _)| *at);
        self.annex_requests_at = (0..3).map(|_| millis(rng, 3_000..60_000)).collect();
        self.annex_requests_at.sort();
    }

    /// Returns the direction in which this daemon exports; `None` if it is no interfacing node.
    pub fn export_direction(&self, number: usize) -> Option<ExportDirection> {
        let first = self.daemons.len() - GATES.len();
        match number.checked_sub(first).filter(|_| !self.annex_requests_at.is_empty())? {
            0 => Some(ExportDirection::ToAnnex),
            _ => Some(ExportDirection::FromAnnex),
        }
    }
}

/// Draws rooms along a circular corridor.
fn draw_layout(rooms: &[String], rng: &mut Rng) -> Result<Layout, LayoutError> {
    let mut layout = Layout::new();
    let corridors: Vec<_> = (1..=3).map(|n| format!("corridor-{n}")).collect();
    for corridor in &corridors {
        layout.add_corridor(corridor, 18.0)?;
    }
    for (n, corridor) in corridors.iter().enumerate() {
        let next = &corridors[(n + 1) % corridors.len()];
        layout.connect(corridor, next, f64::from(rng.u32(2..6)))?;
    }
    for room in rooms {
        layout.add_room(room, f64::from(rng.u32(15..30)))?;
        let corridor = &corridors[rng.usize(..corridors.len())];
        layout.connect(corridor, room, f64::from(rng.u32(1..6)))?;
    }
    Ok(layout)
}

/// Draws the reasoning agents, on two or three daemons each, and three Journals.
fn reasoning(daemons: usize, rng: &mut Rng) -> Vec<AgentPlacement> {
    let mut entries = Vec::new();
    for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
        let hosts = some_of(1..daemons, rng.usize(2..4), rng);
        let (name, config) = (plugin.to_owned(), Value::Null);
        entries.push(AgentPlacement { name, plugin, daemons: hosts, config });
    }
    for host in some_of(0..daemons, 3, rng) {
        let name = format!("journal-d{host}");
        let (daemons, config) = (vec![host], Value::Null);
        entries.push(AgentPlacement { name, plugin: "journal", daemons, config });
    }
    entries
}

/// Draws robots that carry a thermometer, and thermometers on walls.
fn devices(
    rooms: &[String],
    daemons: usize,
    layout: &mut Layout,
    rng: &mut Rng,
) -> Result<Vec<AgentPlacement>, LayoutError> {
    let mut entries = Vec::new();
    for n in 1..=rng.usize(2..4) {
        let (robot, thermometer) = (format!("robot-{n}"), format!("ir-{n}"));
        let start = format!("corridor-{n}");
        let speed = f64::from(rng.u32(3..12)) / 10.0;
        layout.add_robot(&robot, &start, speed)?;
        layout.mount(&thermometer, &robot)?;
        let host = vec![rng.usize(1..daemons)];
        let config = json!({ "start": start, "speed": speed });
        let daemons = host.clone();
        entries.push(AgentPlacement { name: robot.clone(), plugin: "turtlebot", daemons, config });
        let config = json!({ "mounted-on": robot });
        entries.push(AgentPlacement {
            name: thermometer,
            plugin: "ir-temperature-sensor",
            daemons: host,
            config,
        });
    }
    for n in 1..=rng.usize(6..9) {
        entries.push(wall(format!("wall-{n}"), rooms, daemons, layout, rng)?);
    }
    Ok(entries)
}

/// Draws a thermometer on a wall. The first room never gets one: a robot has to go there.
fn wall(
    name: String,
    rooms: &[String],
    daemons: usize,
    layout: &mut Layout,
    rng: &mut Rng,
) -> Result<AgentPlacement, LayoutError> {
    let room = &rooms[rng.usize(1..rooms.len())];
    layout.add_fixed_sensor(&name, room)?;
    let config = json!({ "location": room });
    let daemons = vec![rng.usize(1..daemons)];
    Ok(AgentPlacement { name, plugin: "temperature-sensor", daemons, config })
}

fn draw_goals(rooms: &[String], rng: &mut Rng) -> Vec<ScriptedGoal> {
    let count = rng.usize(GOALS_MIN..6);
    let mut wishes: Vec<_> = (0..count).map(|n| draw_goal(n, rooms, rng)).collect();
    wishes.sort_by_key(|wish| wish.at);
    wishes
}

fn draw_goal(n: usize, rooms: &[String], rng: &mut Rng) -> ScriptedGoal {
    let about = some_of(0..rooms.len(), rng.usize(1..4), rng);
    let mut about: Vec<_> = about.into_iter().map(|index| rooms[index].clone()).collect();
    if n == 0 {
        about = vec![rooms[0].clone()];
    }
    let known: Vec<_> = about.iter().map(|room| format!("(known-temperature {room})")).collect();
    let goal =
        if known.len() == 1 { known[0].clone() } else { format!("(and {})", known.join(" ")) };
    // Two goals are in the first phase, because the effect of a blink on their plans must be seen.
    let until = if n < 2 { 8_000 } else { 50_000 };
    ScriptedGoal {
        at: Duration::from_millis(rng.u64(4_000..until)),
        by: rng.usize(..2),
        goal,
        rooms: about,
        keep: if rng.u8(..4) == 0 { Keep::Maintain } else { Keep::Achieve },
        partition: if rng.u8(..3) == 0 { Partition::Wait } else { Partition::Pursue },
    }
}

fn faults(daemons: usize, robots: &[usize], rng: &mut Rng) -> Vec<(Duration, InjectedFault)> {
    let mut faults = Vec::new();
    let millis = |rng: &mut Rng, range| Duration::from_millis(rng.u64(range));
    for _ in 0..rng.usize(8..12) {
        // Blinks hit mostly daemons with robots, because they could end the robots' plans.
        let anyone = rng.usize(..daemons);
        let robot = robots[rng.usize(..robots.len())];
        let island = [if rng.u8(..3) == 0 { anyone } else { robot }].into();
        let blink = InjectedFault::Cut(island, Duration::ZERO, millis(rng, BLINK_MS));
        faults.push((millis(rng, 5_000..19_000), blink));
    }
    let (from, until) = (BLINKS_UNTIL.as_millis() as u64, FAULTS_UNTIL.as_millis() as u64);
    while faults.len() < FAULTS_MIN + 8 {
        faults.push((millis(rng, from..until), fault(daemons, rng)));
    }
    faults.sort_by_key(|(at, _)| *at);
    // Two blinks within one grace would count as a longer absence, so they are moved apart.
    let mut clear = Duration::ZERO;
    for (at, fault) in &mut faults {
        if *at < BLINKS_UNTIL
            && let InjectedFault::Cut(_, _, lasts) = fault
        {
            *at = (*at).max(clear);
            clear = *at + *lasts + Duration::from_millis(700);
        }
    }
    faults.sort_by_key(|(at, _)| *at);
    faults
}

fn fault(daemons: usize, rng: &mut Rng) -> InjectedFault {
    let seconds = |rng: &mut Rng, range| Duration::from_millis(rng.u64(range));
    let anyone = rng.usize(1..daemons);
    match rng.u8(..20) {
        0..5 => InjectedFault::Crash(anyone, seconds(rng, 100..9_000)),
        5..9 => {
            let size = rng.usize(1..daemons);
            let island = some_of(0..daemons, size, rng).into_iter().collect();
            InjectedFault::Cut(island, seconds(rng, 0..2_000), seconds(rng, 100..12_000))
        }
        9..12 => InjectedFault::Storm {
            lost: rng.u32(..30),
            doubled: rng.u32(..30),
            overtaken: rng.u32(..30),
            lasts: seconds(rng, 500..6_000),
        },
        12..14 => InjectedFault::Delay(seconds(rng, 10..800), seconds(rng, 500..5_000)),
        14..16 => InjectedFault::Slow(anyone, seconds(rng, 100..2_500), seconds(rng, 500..6_000)),
        16..18 => InjectedFault::Clock(anyone, rng.i64(-90_000..90_000)),
        18 => InjectedFault::CrashAll(seconds(rng, 100..4_000)),
        _ => {
            let island = [rng.usize(..daemons)].into();
            InjectedFault::Cut(island, Duration::ZERO, seconds(rng, BLINK_MS))
        }
    }
}

/// Returns `count` numbers of a range, in random order.
fn some_of(range: std::ops::Range<usize>, count: usize, rng: &mut Rng) -> Vec<usize> {
    let mut all: Vec<_> = range.collect();
    rng.shuffle(&mut all);
    all.truncate(count);
    all
}
