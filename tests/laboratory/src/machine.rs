//! One simulated machine with one daemon. Its processes die; its disk and its clock outlive them.

use std::path::PathBuf;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::content::{ActionToken, Record};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
use agent::{
    Blueprint, ExchangeSummary, Host, HostServices, LaunchContext, LaunchError, LaunchableAgent,
    MachineSimulation, MessageRouter, PluginEntry, Resources, StateFolder, StopRegistry,
};
use fastrand::Rng;
use journal::MemoryStore;
use keyboard::{Keyboard, Terminal};
use serde::Deserialize as _;
use serde_json::Value;
use tokio::task::JoinHandle;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

use crate::annex_nodes::{InterfaceNode, LABORATORY};
use crate::open_exchanges::OpenExchanges;
use crate::script::{AgentPlacement, Safeguard};
use crate::trial_context::TrialContext;

/// The plugins that run on simulated machines.
const PLUGINS: [&PluginEntry; 10] = [
    &domain_maintainer::PLUGIN,
    &plan_requester::PLUGIN,
    &planning_agent::PLUGIN,
    &plan_executor::PLUGIN,
    &journal::PLUGIN,
    &history::PLUGIN,
    &turtlebot::PLUGIN,
    &ir_temperature_sensor::PLUGIN,
    &sensor::TEMPERATURE_SENSOR,
    &keyboard::PLUGIN,
];

/// Delay before an agent that ended with an error is launched again, the same as in a daemon.
const RESTART: Duration = Duration::from_millis(500);

/// Start of all machines' clocks: an arbitrary time that is the same for every run of a seed.
const CLOCK_START: Duration = Duration::from_secs(1_700_000_000);

/// A machine, with its daemon if it is switched on.
pub struct SimulatedMachine {
    /// The daemon's name.
    pub daemon: DaemonId,
    number: usize,
    state: PathBuf,
    journal_store: Arc<MemoryStore>,
    clock: Arc<MachineClock>,
    open_exchanges: Arc<OpenExchanges>,
    world: Arc<TrialContext>,
    process: Option<DaemonProcess>,
    interface_node: Option<InterfaceNode>,
}

/// A running daemon.
struct DaemonProcess {
    router: Arc<MessageRouter>,
    host: Arc<Host>,
    agents: Vec<JoinHandle<()>>,
}

/// Clock of the machine and open exchanges of one process. A killed process may be woken once more;
/// its late entries then go to a value that is no longer used.
struct MachineServices {
    clock: Arc<MachineClock>,
    waits: Arc<OpenExchanges>,
}

/// A machine's wall clock, and the random delays of its disk.
struct MachineClock {
    began: Instant,
    /// Offset that keeps any two machines from starting in the same microsecond.
    apart: Duration,
    /// Sum of the clock jumps, in seconds.
    jumped: AtomicI64,
    disk: Mutex<Rng>,
}

impl MachineSimulation for MachineServices {
    fn wall_clock(&self) -> SystemTime {
        let MachineClock { began, apart, jumped, .. } = &*self.clock;
        let now = UNIX_EPOCH + CLOCK_START + *apart + began.elapsed();
        let jumped = jumped.load(Ordering::Relaxed);
        let by = Duration::from_secs(jumped.unsigned_abs());
        if jumped < 0 { now - by } else { now + by }
    }

    fn work_duration(&self) -> Duration {
        let mut disk = self.clock.disk.lock().unwrap_or_else(PoisonError::into_inner);
        Duration::from_micros(disk.u64(200..15_000))
    }

    fn waits_changed(&self, agent: &AgentId, incarnation: Incarnation, exchanges: ExchangeSummary) {
        self.waits.record_exchanges(agent, incarnation, exchanges);
    }
}

// === impl SimulatedMachine ===

impl SimulatedMachine {
    /// Creates a machine that is switched off, with its disk in the folder `state`.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be created.
    pub fn new(
        world: &Arc<TrialContext>,
        number: usize,
        state: PathBuf,
    ) -> std::io::Result<SimulatedMachine> {
        let name = &world.script.daemons[number];
        let seed = world.script.seed ^ (number as u64 + 1).rotate_left(32);
        let clock = MachineClock {
            began: Instant::now(),
            apart: Duration::from_micros(number as u64 * 997),
            jumped: AtomicI64::new(0),
            disk: Mutex::new(Rng::with_seed(seed)),
        };
        std::fs::create_dir_all(&state)?;
        let gate = world
            .script
            .export_direction(number)
            .map(|way| InterfaceNode::new(way, &state))
            .transpose()?;
        Ok(SimulatedMachine {
            daemon: DaemonId::new(name).expect("invariant: the script gives names"),
            number,
            state,
            journal_store: Arc::default(),
            clock: Arc::new(clock),
            open_exchanges: Arc::default(),
            world: Arc::clone(world),
            process: None,
            interface_node: gate,
        })
    }

    /// Whether the machine's daemon runs.
    pub fn is_up(&self) -> bool {
        self.process.is_some()
    }

    /// Starts the machine's daemon, with all agents that are configured for it.
    pub fn start(&mut self) {
        if self.is_up() {
            return;
        }
        let world = Arc::clone(&self.world);
        let ecosystem = EcosystemId::new(LABORATORY).expect("invariant: a name");
        self.open_exchanges = Arc::default();
        let given = Arc::new(MachineServices {
            clock: self.clock.clone(),
            waits: self.open_exchanges.clone(),
        });
        let machine = move |state| HostServices::simulated(given.clone(), Some(state));
        let router = MessageRouter::on(
            machine(self.state.clone()),
            ecosystem,
            self.daemon.clone(),
            world.settings.clone(),
        );
        let inbound = Arc::<MessageRouter>::clone(&router);
        router.connect(world.network.open(self.daemon.clone(), inbound));
        let host = self.host();
        let mut process = DaemonProcess { router, host, agents: Vec::new() };
        for entry in world.script.agents.iter().filter(|entry| entry.daemons.contains(&self.number))
        {
            process.begin(entry, &world);
        }
        if let Some(gate) = &mut self.interface_node {
            gate.open(&world, machine, (&process.router, &process.host));
        }
        self.process = Some(process);
    }

    /// Stops the machine's daemon as a SIGKILL would.
    pub fn kill(&mut self) {
        let Some(process) = self.process.take() else { return };
        self.world.network.kill(&self.daemon);
        if let Some(gate) = &mut self.interface_node {
            gate.kill(&self.world, &self.daemon);
        }
        process.agents.iter().for_each(JoinHandle::abort);
        self.open_exchanges = Arc::default();
        if self.world.without == Some(Safeguard::Journal) {
            self.journal_store = Arc::default();
        }
    }

    /// Makes the machine's clock jump by `seconds`, which may be negative.
    pub fn jump(&self, seconds: i64) {
        self.clock.jumped.fetch_add(seconds, Ordering::Relaxed);
    }

    /// Starts a keyboard for a person. Returns `None` if the daemon does not run.
    pub fn start_keyboard(&mut self, name: &str) -> Option<Terminal> {
        let process = self.process.as_mut()?;
        let (keyboard, terminal) = Keyboard::with_terminal();
        let id = AgentId::new(name).expect("invariant: a name");
        let launch_context = process.launch_context(&id, false);
        let task = AbortOnDrop(LaunchableAgent::launch(Box::new(keyboard), launch_context));
        process.agents.push(tokio::spawn(async move { drop(task.ended().await) }));
        Some(terminal)
    }

    /// Returns the message router, through which a person at this machine queries the daemons.
    /// Returns `None` if the daemon does not run.
    pub fn router(&self) -> Option<&Arc<MessageRouter>> {
        self.process.as_ref().map(|process| &process.router)
    }

    /// Returns the interfacing part of the machine; `None` if it is no interfacing node.
    pub fn annex_node(&self) -> Option<&InterfaceNode> {
        self.interface_node.as_ref()
    }

    /// Returns the open exchanges of the machine's agents.
    pub fn agent_exchanges(&self) -> &OpenExchanges {
        &self.open_exchanges
    }

    /// Returns the records on the disk of the machine's Journal.
    pub fn journal_records(&self) -> Vec<Record> {
        self.journal_store.records()
    }

    /// Returns the commands that an agent has begun here, according to its disk, in order and with
    /// repetitions; and those that have ended.
    pub fn commands(&self, agent: &str) -> (Vec<ActionToken>, Vec<ActionToken>) {
        let path = self.state.join(format!("{agent}.tokens"));
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let (mut begun, mut ended) = (Vec::new(), Vec::new());
        let token = |value: &Value| ActionToken::deserialize(value).ok();
        for line in text.lines() {
            let Ok(line) = serde_json::from_str::<Value>(line) else { continue };
            begun.extend(line.get("begun").and_then(token));
            ended.extend(line.get("ended").and_then(|end| token(&end["token"])));
        }
        (begun, ended)
    }

    fn host(&self) -> Arc<Host> {
        let TrialContext { ontology, map, script, settings, building, .. } = &*self.world;
        let mut resources = Resources::default();
        resources.insert(building.clone());
        resources.insert(match self.world.without {
            Some(Safeguard::Latch) => StopRegistry::default(),
            _ => StopRegistry::open(&self.state),
        });
        resources.insert(StateFolder(self.state.clone()));
        resources.share(Arc::clone(&self.journal_store));
        let journals = script.agents.iter().filter(|entry| entry.plugin == "journal");
        let name = |entry: &AgentPlacement| AgentId::new(&entry.name).expect("invariant: a name");
        Arc::new(Host {
            ontology: Arc::clone(ontology),
            map: Arc::clone(map),
            mode: script.mode,
            settings: settings.clone(),
            journals: journals.map(name).collect(),
            resources,
        })
    }
}

// === impl DaemonProcess ===

impl DaemonProcess {
    /// Runs an agent and launches it again when it fails, as a daemon's supervisor does.
    fn begin(&mut self, entry: &AgentPlacement, world: &Arc<TrialContext>) {
        let plugin = PLUGINS.into_iter().find(|plugin| plugin.name == entry.plugin);
        let plugin = plugin.expect("invariant: the script names plugins that live here");
        let id = AgentId::new(&entry.name).expect("invariant: a name");
        let blueprint = Blueprint {
            id: id.clone(),
            driver: plugin.drivers.first().copied().unwrap_or_default().to_owned(),
            config: Arc::new(entry.config.clone()),
            host: Arc::clone(&self.host),
        };
        let stands_by = entry.daemons.len() > 1;
        let (launch_context, world) = (self.launch_context(&id, stands_by), Arc::clone(world));
        let span = tracing::info_span!("on", daemon = %self.router.daemon());
        let lives = async move {
            loop {
                let incarnation = launch_context.router.host_services().next_incarnation();
                let launch_context = LaunchContext { incarnation, ..launch_context.clone() };
                let ended = match (plugin.build)(blueprint.clone()) {
                    Ok(agent) => AbortOnDrop(agent.launch(launch_context)).ended().await,
                    Err(error) => Err(error.to_string()),
                };
                match ended {
                    Ok(()) => return,
                    Err(error) if error.starts_with("launch") => (),
                    Err(error) => world.note_broken(format!("`{id}`: failed to {error}")),
                }
                tokio::time::sleep(RESTART).await;
            }
        };
        self.agents.push(tokio::spawn(lives.instrument(span)));
    }

    fn launch_context(&self, id: &AgentId, stands_by: bool) -> LaunchContext {
        LaunchContext {
            id: id.clone(),
            incarnation: self.router.host_services().next_incarnation(),
            router: Arc::clone(&self.router),
            ontology: Arc::from(self.host.ontology.name.as_str()),
            stopping: CancellationToken::new(),
            has_replicas: stands_by,
            via: [].into(),
        }
    }
}

/// A running agent that is aborted when this is dropped.
struct AbortOnDrop(JoinHandle<Result<(), LaunchError>>);

impl AbortOnDrop {
    /// Waits for the end of the agent and returns how it ended.
    async fn ended(mut self) -> Result<(), String> {
        match (&mut self.0).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(error.to_string()),
            Err(error) => Err(format!("go on: it panicked: {error}")),
        }
    }
}

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        self.0.abort();
    }
}
