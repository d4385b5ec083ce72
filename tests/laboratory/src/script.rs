//! What a seed decides: who lives where, who asks for what, what goes wrong when.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{Keep, Mode, Partition};
use building::{Layout, LayoutError};
use fastrand::Rng;
use serde_json::{Value, json};

use crate::gates::Way;

/// How long only blinks disturb: nothing may come of them.
pub const BLINKS_UNTIL: Duration = Duration::from_secs(20);

/// How long things go wrong.
pub const FAULTS_UNTIL: Duration = Duration::from_secs(75);

/// Of so many seeds, one has a second ecosystem.
const JOINED_EVERY: u64 = 4;

/// The interfacing nodes.
const GATES: [&str; 2] = ["gate-there", "gate-back"];

/// What a trial has at least.
pub const DAEMONS_MIN: usize = 5;
/// As above: agents of different names, people aside.
pub const AGENTS_MIN: usize = 20;
/// As above.
pub const GOALS_MIN: usize = 3;
/// As above.
pub const FAULTS_MIN: usize = 30;

/// A blink is shorter than the grace, by this margin.
const BLINK_MS: std::ops::Range<u64> = 20..350;

/// What keeps a promise, and can be taken out to see that the laboratory notices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Guard {
    /// Actuators remember which commands they have begun.
    Fencing,
    /// Agents remember which messages they have heard.
    Duplicates,
    /// What a Journal has kept outlives its process.
    Journal,
    /// A plan bears the absence of an agent for a while.
    Grace,
    /// Agents tell through which ecosystems they have come.
    Loops,
}

/// A trial, drawn from a seed.
#[derive(Clone, Debug)]
pub struct Script {
    /// Who names it.
    pub seed: u64,
    /// By which flow plans are made.
    pub mode: Mode,
    /// The daemons; of the first, only the links ever fail: people sit there.
    pub daemons: Vec<String>,
    /// The agents.
    pub agents: Vec<Entry>,
    /// Rooms and corridors, and the devices in them.
    pub layout: Layout,
    /// Who asks for what, when.
    pub wishes: Vec<Wish>,
    /// What goes wrong, in its order.
    pub faults: Vec<(Duration, Fault)>,
    /// When goals are asked of a second ecosystem; none if there is none. The last two daemons are
    /// interfacing nodes then.
    pub errands: Vec<Duration>,
}

/// One agent.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// What it is.
    pub plugin: &'static str,
    /// Who may host it.
    pub daemons: Vec<usize>,
    /// Its `config`.
    pub config: Value,
}

/// A goal.
#[derive(Clone, Debug)]
pub struct Wish {
    /// When it is asked for.
    pub at: Duration,
    /// By whom.
    pub by: usize,
    /// A PDDL condition.
    pub goal: String,
    /// The rooms whose temperature it is about.
    pub rooms: Vec<String>,
    /// Reach it, or keep it.
    pub keep: Keep,
    /// What becomes of it on an island.
    pub partition: Partition,
}

/// What goes wrong.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// A process dies, and is started again after a while.
    Crash(usize, Duration),
    /// All processes but that of the people die at once, and are started again.
    CrashAll(Duration),
    /// The links between these and all others break, are seen to be broken after the lease, and are
    /// mended.
    Cut(BTreeSet<usize>, Duration, Duration),
    /// All links lose, double and mix for a while, in these hundredths.
    Storm {
        /// That never come.
        lost: u32,
        /// That come twice.
        doubled: u32,
        /// That come after what was said later.
        overtaken: u32,
        /// How long.
        lasts: Duration,
    },
    /// All messages take up to so long, for a while.
    Delay(Duration, Duration),
    /// A daemon hears everything so much later, for a while.
    Slow(usize, Duration, Duration),
    /// A machine's clock jumps by so many seconds.
    Clock(usize, i64),
}

// === impl Script ===

impl Script {
    /// The trial of a seed.
    ///
    /// # Errors
    ///
    /// If what was drawn is no building: a mistake of this file.
    pub fn draw(seed: u64) -> Result<Script, LayoutError> {
        let rng = &mut Rng::with_seed(seed);
        let mode = if rng.bool() { Mode::Centralized } else { Mode::Decentralized };
        let daemons: Vec<_> = (0..rng.usize(DAEMONS_MIN..8)).map(|n| format!("d{n}")).collect();
        let rooms: Vec<_> = (1..=rng.usize(6..9)).map(|n| format!("room-{n}")).collect();
        let mut layout = places(&rooms, rng)?;
        let mut agents = reasoning(daemons.len(), rng);
        agents.extend(devices(&rooms, daemons.len(), &mut layout, rng)?);
        let wishes = wishes(&rooms, rng);
        let robots = agents.iter().filter(|entry| entry.plugin == "turtlebot");
        let robots: Vec<_> = robots.flat_map(|entry| entry.daemons.clone()).collect();
        let faults = faults(daemons.len(), &robots, rng);
        let errands = Vec::new();
        let mut script = Script { seed, mode, daemons, agents, layout, wishes, faults, errands };
        script.crowd(&rooms)?;
        if seed % JOINED_EVERY == JOINED_EVERY - 1 {
            script.join(rng);
        }
        Ok(script)
    }

    /// Has more thermometers on walls, until there are enough agents. Drawn apart, so that all else is
    /// drawn as it was before there had to be so many.
    fn crowd(&mut self, rooms: &[String]) -> Result<(), LayoutError> {
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

    /// Joins a second ecosystem by two interfacing nodes, which die and are cut off as others do.
    fn join(&mut self, rng: &mut Rng) {
        let (from, until) = (BLINKS_UNTIL.as_millis() as u64, FAULTS_UNTIL.as_millis() as u64);
        let millis = |rng: &mut Rng, range| Duration::from_millis(rng.u64(range));
        for gate in GATES {
            self.daemons.push(gate.to_owned());
            let number = self.daemons.len() - 1;
            for _ in 0..rng.usize(1..4) {
                let (lease, lasts) = (millis(rng, 0..2_000), millis(rng, 100..9_000));
                let fault = match rng.bool() {
                    true => Fault::Crash(number, lasts),
                    false => Fault::Cut([number].into(), lease, lasts),
                };
                self.faults.push((millis(rng, from..until), fault));
            }
        }
        self.faults.sort_by_key(|(at, _)| *at);
        self.errands = (0..3).map(|_| millis(rng, 3_000..60_000)).collect();
        self.errands.sort();
    }

    /// Which way this daemon lets things through between both ecosystems, if it does.
    pub fn way(&self, number: usize) -> Option<Way> {
        let first = self.daemons.len() - GATES.len();
        match number.checked_sub(first).filter(|_| !self.errands.is_empty())? {
            0 => Some(Way::There),
            _ => Some(Way::Back),
        }
    }
}

/// Rooms along a corridor that is a ring.
fn places(rooms: &[String], rng: &mut Rng) -> Result<Layout, LayoutError> {
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

/// Those who reason on two or three daemons each, and three Journals.
fn reasoning(daemons: usize, rng: &mut Rng) -> Vec<Entry> {
    let mut entries = Vec::new();
    for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
        let hosts = some_of(1..daemons, rng.usize(2..4), rng);
        let (name, config) = (plugin.to_owned(), Value::Null);
        entries.push(Entry { name, plugin, daemons: hosts, config });
    }
    for host in some_of(0..daemons, 3, rng) {
        let name = format!("journal-d{host}");
        let (daemons, config) = (vec![host], Value::Null);
        entries.push(Entry { name, plugin: "journal", daemons, config });
    }
    entries
}

/// Robots that carry a thermometer, and thermometers on walls.
fn devices(
    rooms: &[String],
    daemons: usize,
    layout: &mut Layout,
    rng: &mut Rng,
) -> Result<Vec<Entry>, LayoutError> {
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
        entries.push(Entry { name: robot.clone(), plugin: "turtlebot", daemons, config });
        let config = json!({ "mounted-on": robot });
        entries.push(Entry {
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

/// A thermometer on a wall. Of the first room no wall knows anything: a robot has to go there.
fn wall(
    name: String,
    rooms: &[String],
    daemons: usize,
    layout: &mut Layout,
    rng: &mut Rng,
) -> Result<Entry, LayoutError> {
    let room = &rooms[rng.usize(1..rooms.len())];
    layout.add_fixed_sensor(&name, room)?;
    let config = json!({ "location": room });
    let daemons = vec![rng.usize(1..daemons)];
    Ok(Entry { name, plugin: "temperature-sensor", daemons, config })
}

fn wishes(rooms: &[String], rng: &mut Rng) -> Vec<Wish> {
    let count = rng.usize(GOALS_MIN..6);
    let mut wishes: Vec<_> = (0..count).map(|n| wish(n, rooms, rng)).collect();
    wishes.sort_by_key(|wish| wish.at);
    wishes
}

fn wish(n: usize, rooms: &[String], rng: &mut Rng) -> Wish {
    let about = some_of(0..rooms.len(), rng.usize(1..4), rng);
    let mut about: Vec<_> = about.into_iter().map(|index| rooms[index].clone()).collect();
    if n == 0 {
        about = vec![rooms[0].clone()];
    }
    let known: Vec<_> = about.iter().map(|room| format!("(known-temperature {room})")).collect();
    let goal =
        if known.len() == 1 { known[0].clone() } else { format!("(and {})", known.join(" ")) };
    // Two in fair weather: what a blink does to their plans must be seen.
    let until = if n < 2 { 8_000 } else { 50_000 };
    Wish {
        at: Duration::from_millis(rng.u64(4_000..until)),
        by: rng.usize(..2),
        goal,
        rooms: about,
        keep: if rng.u8(..4) == 0 { Keep::Maintain } else { Keep::Achieve },
        partition: if rng.u8(..3) == 0 { Partition::Wait } else { Partition::Pursue },
    }
}

fn faults(daemons: usize, robots: &[usize], rng: &mut Rng) -> Vec<(Duration, Fault)> {
    let mut faults = Vec::new();
    let millis = |rng: &mut Rng, range| Duration::from_millis(rng.u64(range));
    for _ in 0..rng.usize(8..12) {
        // Mostly of those whose plans a blink could tear.
        let anyone = rng.usize(..daemons);
        let robot = robots[rng.usize(..robots.len())];
        let island = [if rng.u8(..3) == 0 { anyone } else { robot }].into();
        let blink = Fault::Cut(island, Duration::ZERO, millis(rng, BLINK_MS));
        faults.push((millis(rng, 5_000..19_000), blink));
    }
    let (from, until) = (BLINKS_UNTIL.as_millis() as u64, FAULTS_UNTIL.as_millis() as u64);
    while faults.len() < FAULTS_MIN + 8 {
        faults.push((millis(rng, from..until), fault(daemons, rng)));
    }
    faults.sort_by_key(|(at, _)| *at);
    // Two blinks within a grace are no blink.
    let mut clear = Duration::ZERO;
    for (at, fault) in &mut faults {
        if *at < BLINKS_UNTIL
            && let Fault::Cut(_, _, lasts) = fault
        {
            *at = (*at).max(clear);
            clear = *at + *lasts + Duration::from_millis(700);
        }
    }
    faults.sort_by_key(|(at, _)| *at);
    faults
}

fn fault(daemons: usize, rng: &mut Rng) -> Fault {
    let seconds = |rng: &mut Rng, range| Duration::from_millis(rng.u64(range));
    let anyone = rng.usize(1..daemons);
    match rng.u8(..20) {
        0..5 => Fault::Crash(anyone, seconds(rng, 100..9_000)),
        5..9 => {
            let size = rng.usize(1..daemons);
            let island = some_of(0..daemons, size, rng).into_iter().collect();
            Fault::Cut(island, seconds(rng, 0..2_000), seconds(rng, 100..12_000))
        }
        9..12 => Fault::Storm {
            lost: rng.u32(..30),
            doubled: rng.u32(..30),
            overtaken: rng.u32(..30),
            lasts: seconds(rng, 500..6_000),
        },
        12..14 => Fault::Delay(seconds(rng, 10..800), seconds(rng, 500..5_000)),
        14..16 => Fault::Slow(anyone, seconds(rng, 100..2_500), seconds(rng, 500..6_000)),
        16..18 => Fault::Clock(anyone, rng.i64(-90_000..90_000)),
        18 => Fault::CrashAll(seconds(rng, 100..4_000)),
        _ => {
            let island = [rng.usize(..daemons)].into();
            Fault::Cut(island, Duration::ZERO, seconds(rng, BLINK_MS))
        }
    }
}

/// So many of a range, in random order.
fn some_of(range: std::ops::Range<usize>, count: usize, rng: &mut Rng) -> Vec<usize> {
    let mut all: Vec<_> = range.collect();
    rng.shuffle(&mut all);
    all.truncate(count);
    all
}
