//! The cost of a goal in messages and bytes, from its request to its outcome, in both flows, with
//! ten, fifty and a hundred devices.
//!
//! ```text
//! cargo bench -p althing --bench wire [-- --kinds]
//! ```
//!
//! Buildings of the campus generator, in memory, in paused time, so the results are the same on
//! every machine. Everything that agents pass to the substrate counts, also messages to agents of
//! the same daemon, for which Zenoh would send nothing; a message to all counts once. Bytes are
//! payloads. Heartbeats do not belong to the goal, and are counted separately.
//!
//! Fails if a device's share grows from the smallest building to the largest.

mod support;

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId, Performative};
use agent::{AgentSettings, MessageRouter, Mode, PluginEntry};
use building::{Building, BuildingDevice, Campus, DEVICES_PER_HOUSE};
use bytes::Bytes;
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use substrate::memory::Network;
use substrate::{
    AgentAddress, BoxFuture, ForwardingSubstrate, ResourceQuery, SendError, Subject, Substrate,
};
use support::{Entry, Outcome};

/// Seed of the campus, as in `ecosystems/campus.toml`.
const SEED: u64 = 1;

/// The buildings, by their number of devices: multiples of half a house.
const SIZES: [usize; 3] = [10, 50, 100];

/// Largest allowed ratio of a device's share in the largest building to that in the smallest.
const GROWTH_MAX: f64 = 1.5;

/// Wait before the goal is requested: five heartbeats, after which all agents know each other.
const SETTLING: Duration = Duration::from_secs(5);

/// Time after the outcome for receipts that wait to be batched, and for the consequences of the
/// last step.
const ENDING: Duration = Duration::from_secs(1);

/// How long the Plan Requester waits for bids, as in `ecosystems/campus.toml`. The time is long
/// because all agents run in this process, which is slow; the network is not.
const PROPOSALS_DEADLINE: Duration = Duration::from_secs(20);

const DOMAIN: &str = ontology::STANDARD_DOMAIN;

const PLUGINS: &[PluginEntry] = &[
    domain_maintainer::PLUGIN,
    plan_requester::PLUGIN,
    planning_agent::PLUGIN,
    plan_executor::PLUGIN,
    sensor::TEMPERATURE_SENSOR,
    ir_temperature_sensor::PLUGIN,
    turtlebot::PLUGIN,
];

fn main() -> Outcome<ExitCode> {
    let sizes = if support::is_whole() { &SIZES[..] } else { &SIZES[..1] };
    let shows_kinds = std::env::args().any(|argument| argument == "--kinds");
    println!("{:<14}{:<10}{:>8}{:>10}{:>9}", "", "", "devices", "messages", "KiB");
    let mut is_linear = true;
    for mode in [Mode::Centralized, Mode::Decentralized] {
        for aim in [Aim::OneRoom, Aim::EveryRoom] {
            let mut shares = Vec::new();
            for &devices in sizes {
                let runtime = tokio::runtime::Builder::new_current_thread()
                    .enable_all()
                    .start_paused(true)
                    .build()?;
                let counts = runtime.block_on(cost(devices, mode, aim))?;
                let (messages, bytes) = counts.of_goal();
                let (what, kib) = (aim.name(), bytes as f64 / 1_024.0);
                println!("{mode:<14}{what:<10}{devices:>8}{messages:>10}{kib:>9.1}");
                if shows_kinds {
                    counts.tell();
                }
                shares.push([messages as f64, bytes as f64].map(|all| all / devices as f64));
            }
            let growth = |index: usize| shares[shares.len() - 1][index] / shares[0][index];
            let worst = growth(0).max(growth(1));
            is_linear &= worst <= GROWTH_MAX;
            let verdict = if worst <= GROWTH_MAX { "reached" } else { "missed" };
            println!(
                "    a device's share grows: messages × {:.2}, bytes × {:.2}, aim ≤ × {GROWTH_MAX}: \
                 {verdict}",
                growth(0),
                growth(1)
            );
        }
    }
    Ok(if is_linear { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The goal that is requested.
#[derive(Clone, Copy)]
enum Aim {
    /// One thermometer is requested to measure.
    OneRoom,
    /// Every thermometer is requested to measure, so the goal grows with the building.
    EveryRoom,
}

impl Aim {
    fn name(self) -> &'static str {
        match self {
            Aim::OneRoom => "one room",
            Aim::EveryRoom => "all rooms",
        }
    }

    fn goal(self, devices: &[&BuildingDevice]) -> String {
        let rooms = devices.iter().filter_map(|device| match device {
            BuildingDevice::FixedSensor { location, .. } => {
                Some(format!("(known-temperature {location})"))
            }
            _ => None,
        });
        let count = match self {
            Aim::OneRoom => 1,
            Aim::EveryRoom => usize::MAX,
        };
        format!("(and {})", rooms.take(count).collect::<Vec<_>>().join(" "))
    }
}

/// Plays one goal in a building with this number of devices.
async fn cost(count: usize, mode: Mode, aim: Aim) -> Outcome<Arc<Counts>> {
    let campus = Campus::seeded(SEED, count.div_ceil(DEVICES_PER_HOUSE));
    let devices = first_of(&campus, count);
    let mut host = support::host(DOMAIN, &campus.map(ontology::STANDARD_NAME), mode)?;
    host.settings = AgentSettings { proposals_deadline: PROPOSALS_DEADLINE, ..host.settings };
    let building = Building::new(campus.layout().clone(), 1.0)?;
    host.resources.insert(building.handle());
    let host = Arc::new(host);
    let counts = Arc::new(Counts::default());
    let network = Network::new();

    let is_here = |entry: &Entry| {
        entry.daemon == "reasoning"
            || devices.iter().any(|device| device.name() == entry.name.as_str())
    };
    let mut daemons: BTreeMap<String, Arc<MessageRouter>> = BTreeMap::new();
    let file = campus.ecosystem() + &reasoning_entries();
    for entry in support::entries(&file)?.iter().filter(|entry| is_here(entry)) {
        let Some(plugin) = PLUGINS.iter().find(|plugin| plugin.name == entry.plugin) else {
            continue;
        };
        let daemon = match daemons.get(&entry.daemon) {
            Some(daemon) => Arc::clone(daemon),
            None => open(&network, &entry.daemon, &host.settings, &counts)?,
        };
        support::launch(
            &entry.name,
            support::build(plugin, entry, &host)?,
            &daemon,
            ontology::STANDARD_NAME,
        );
        daemons.insert(entry.daemon.clone(), daemon);
    }
    let (keyboard, mut terminal) = Keyboard::with_terminal();
    let reasoning = daemons.get("reasoning").ok_or("no process hosts the reasoning agents")?;
    support::launch(&AgentId::new("user")?, Box::new(keyboard), reasoning, ontology::STANDARD_NAME);
    let names = devices.iter().map(|device| device.name().to_owned()).collect();
    support::await_offers(reasoning, &names).await?;
    tokio::time::sleep(SETTLING).await;

    counts.reset();
    reach(&mut terminal, aim.goal(&devices)).await?;
    tokio::time::sleep(ENDING).await;
    Ok(counts)
}

/// Returns the entries of the agents that a daemon adds to a file without them.
fn reasoning_entries() -> String {
    let plugins = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];
    let entry = |plugin: &str| {
        format!("\n[[agent]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"\ndaemon = \"reasoning\"\n")
    };
    plugins.map(entry).concat()
}

/// Returns the devices of the smallest buildings, half a house at a time: eight thermometers, and a
/// robot with its sensor.
fn first_of(campus: &Campus, count: usize) -> Vec<&BuildingDevice> {
    let mut devices = Vec::new();
    for house in campus.layout().devices().chunks(DEVICES_PER_HOUSE) {
        let is_fixed =
            |device: &&BuildingDevice| matches!(device, BuildingDevice::FixedSensor { .. });
        let (fixed, robots): (Vec<_>, Vec<_>) = house.iter().partition(is_fixed);
        for half in [0, 1] {
            devices.extend(&fixed[half * fixed.len() / 2..][..fixed.len() / 2]);
            devices.extend(&robots[half * robots.len() / 2..][..robots.len() / 2]);
        }
    }
    devices.truncate(count);
    devices
}

/// Opens a daemon in this process; everything that it sends is counted.
fn open(
    network: &Network,
    name: &str,
    settings: &AgentSettings,
    counts: &Arc<Counts>,
) -> Outcome<Arc<MessageRouter>> {
    let daemon = DaemonId::new(name)?;
    let router = MessageRouter::new(EcosystemId::new("campus")?, daemon.clone(), settings.clone());
    let port = network.open(daemon, Arc::<MessageRouter>::clone(&router));
    router.connect(Arc::new(Counted { port, counts: Arc::clone(counts) }));
    Ok(router)
}

/// Requests a goal, and waits until it is reached.
async fn reach(terminal: &mut Terminal, goal: String) -> Outcome<()> {
    let wish = GoalRequest {
        goal,
        keep: acl::content::Keep::Achieve,
        priority: 0,
        partition: Default::default(),
    };
    terminal.requests.send(UserRequest::RequestGoal(wish)).await?;
    loop {
        let heard: UserEvent = terminal.events.recv().await.ok_or("the keyboard has ended")?;
        match heard.is_final() {
            true if heard.is_success() => return Ok(()),
            true => return Err(format!("{heard:?}").into()),
            false => (),
        }
    }
}

// === counting ===

/// The number and the bytes of messages that were sent, by kind.
#[derive(Default)]
struct Counts(Mutex<BTreeMap<&'static str, (u64, u64)>>);

const HEARTBEATS: &str = "heartbeats";

impl Counts {
    fn add(&self, kind: &'static str, payload: &Bytes) {
        self.with(|kinds| {
            let (messages, bytes) = kinds.entry(kind).or_default();
            *messages += 1;
            *bytes += payload.len() as u64;
        });
    }

    fn reset(&self) {
        self.with(BTreeMap::clear);
    }

    /// Returns the number and the bytes of the messages of all kinds except heartbeats.
    fn of_goal(&self) -> (u64, u64) {
        self.with(|kinds| {
            let of_goal = kinds.iter().filter(|(kind, _)| **kind != HEARTBEATS);
            of_goal.fold((0, 0), |all, (_, each)| (all.0 + each.0, all.1 + each.1))
        })
    }

    fn tell(&self) {
        self.with(|kinds| {
            for (kind, (messages, bytes)) in kinds {
                println!("{kind:>32}{messages:>10}{:>9.1}", *bytes as f64 / 1_024.0);
            }
        });
    }

    fn with<T>(&self, act: impl FnOnce(&mut BTreeMap<&'static str, (u64, u64)>) -> T) -> T {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A daemon's substrate with a counter.
struct Counted {
    port: Arc<dyn Substrate>,
    counts: Arc<Counts>,
}

impl ForwardingSubstrate for Counted {
    fn inner(&self) -> &dyn Substrate {
        &*self.port
    }

    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        let kind = match subject {
            Subject::Message(performative) => performative.as_str(),
            Subject::Receipt => "receipts",
        };
        self.counts.add(kind, &payload);
        self.port.send(to, subject, payload)
    }

    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.counts.add(performative.as_str(), &payload);
        self.port.broadcast(sender, performative, payload)
    }

    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.counts.add(HEARTBEATS, &payload);
        self.port.broadcast_state(sender, payload)
    }

    fn ask(&self, ask: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        self.counts.add("questions", &Bytes::new());
        let (answers, counts) = (self.port.ask(ask, timeout), Arc::clone(&self.counts));
        Box::pin(async move {
            let answers = answers.await;
            answers.iter().for_each(|answer| counts.add("answers", answer));
            answers
        })
    }
}
