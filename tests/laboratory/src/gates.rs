//! A second ecosystem, the annex, joined by two interfacing nodes such that exports could loop: one
//! exports a robot to the annex and forwards goals to it, the other would export the same robot back
//! and forward the same goals back.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use acl::content::{Achieve, Keep, Request, value};
use acl::{AgentId, DaemonId, EcosystemId, Performative, Protocol};
use agent::{Host, Landing, Machine, Resources, StateFolder, Switchboard};
use interfacing::{Counters, Interface, InterfaceEntry, PASSING, RuleEntry, Shore, connect};
use keyboard::{Draft, Said};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::machine::World;
use crate::script::Guard;

/// Names of both ecosystems.
pub const LABORATORY: &str = "laboratory";
const ANNEX: &str = "annex";

/// The exported robot, its proxy agent in the annex, and the proxy of that proxy, which must never
/// exist.
const LENT: &str = "robot-1";
const MIRROR: &str = "lent";
const GHOST: &str = "ghost";

/// Agents that take goals for the other ecosystem. In the annex it has the name of the Plan Requester,
/// because goals are sent to that name.
const DESK: &str = "annex-desk";
const DESK_OF_ANNEX: &str = "plan-requester";

/// Rate limit in each direction, in messages per second: a robot's heartbeats and a few more.
const RATE: f64 = 20.0;

/// How long to wait for an answer to a goal of the annex.
const PATIENCE: Duration = Duration::from_secs(20);

/// Direction in which an interfacing node exports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the laboratory to the annex.
    There,
    /// From the annex to the laboratory.
    Back,
}

/// The part of a daemon that makes it an interfacing node.
pub struct Gate {
    way: Way,
    state: PathBuf,
    open: Option<Open>,
    /// The interface of each incarnation, with its counters.
    interfaces: Vec<Interface>,
}

struct Open {
    annex: Arc<Switchboard>,
    stopping: CancellationToken,
}

// === impl Gate ===

impl Gate {
    /// Creates a node that is switched off. It has its own state folder for the annex.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be created.
    pub fn new(way: Way, state: &Path) -> std::io::Result<Gate> {
        let state = state.join(ANNEX);
        std::fs::create_dir_all(&state)?;
        Ok(Gate { way, state, open: None, interfaces: Vec::new() })
    }

    /// Connects both ecosystems.
    pub fn open(
        &mut self,
        world: &World,
        machine: impl FnOnce(PathBuf) -> Machine,
        home: (&Arc<Switchboard>, &Arc<Host>),
    ) {
        let Some(wire) = &world.annex else { return };
        let daemon = home.0.daemon().clone();
        let (machine, settings) = (machine(self.state.clone()), world.settings.clone());
        let annex = Switchboard::on(machine, ecosystem(ANNEX), daemon.clone(), settings.clone());
        annex.connect(wire.open(daemon, Arc::<Switchboard>::clone(&annex) as _));
        let mut resources = Resources::default();
        resources.insert(StateFolder(self.state.clone()));
        let host = Arc::new(Host {
            ontology: Arc::clone(&world.ontology),
            map: Arc::clone(&world.map),
            mode: world.script.mode,
            settings,
            journals: Vec::new(),
            resources,
        });
        let (stopping, tasks) = (CancellationToken::new(), TaskTracker::new());
        let shore = |name, switchboard: &Arc<Switchboard>, host: &Arc<Host>| Shore {
            name: ecosystem(name),
            domain: Arc::clone(&world.ontology),
            problem: Arc::clone(&world.map),
            landing: Landing {
                switchboard: Arc::clone(switchboard),
                host: Arc::clone(host),
                stopping: stopping.clone(),
                tasks: tasks.clone(),
                tells_way: world.without != Some(Guard::Loops),
            },
        };
        let (near, far) = (shore(LABORATORY, home.0, home.1), shore(ANNEX, &annex, &host));
        let entry = entry(self.way, world);
        let interface = match self.way {
            Way::There => connect(&entry, &near, &far),
            Way::Back => connect(&entry, &far, &near),
        };
        self.interfaces.push(interface.expect("invariant: the names are names"));
        self.open = Some(Open { annex, stopping });
    }

    /// Stops the node as a SIGKILL of its daemon would.
    pub fn kill(&mut self, world: &World, daemon: &DaemonId) {
        let (Some(open), Some(wire)) = (self.open.take(), &world.annex) else { return };
        wire.kill(daemon);
        // Its messages no longer reach any agent.
        open.stopping.cancel();
    }

    /// Returns what is wrong at the end of the trial.
    pub fn broken(&self) -> Vec<String> {
        let count = |what: fn(&Counters) -> u64| -> u64 {
            self.interfaces.iter().map(|it| what(&it.imported) + what(&it.exported)).sum()
        };
        let mut broken = Vec::new();
        if self.way == Way::Back {
            let passed = count(|counters| counters.passed.load(Ordering::Relaxed));
            if passed > 0 {
                broken.push(format!("{passed} requests came back to the ecosystem that sent them"));
            }
            let is_lent =
                self.open.as_ref().is_some_and(|open| open.annex.find(&id(MIRROR)).is_some());
            if !is_lent {
                broken.push(format!("`{LENT}` is present, and has no proxy agent in the annex"));
            }
        }
        broken
    }
}

/// Returns a message if the proxy that must not exist is present.
pub fn came_back(here: &Switchboard) -> Option<String> {
    here.find(&id(GHOST)).map(|_| format!("`{LENT}` was lent, and came back as `{GHOST}`"))
}

/// Builds a request of a goal to the annex, which needs the laboratory's robot for it.
pub fn errand(goal: &str) -> Said {
    Said::Send(Draft {
        to: Some(id(DESK)),
        performative: Performative::Request,
        protocol: Protocol::Goal,
        conversation: None,
        content: value(&Request::Achieve(Achieve::new(goal, Keep::Achieve, 0))),
        patience: PATIENCE,
    })
}

/// Builds an interface with the same vocabulary on both sides.
fn entry(way: Way, world: &World) -> InterfaceEntry {
    let same = |words: &mut dyn Iterator<Item = &str>| -> BTreeMap<String, String> {
        words.map(|word| (word.to_owned(), word.to_owned())).collect()
    };
    let (domain, map) = (&world.ontology, &world.map);
    let rule = |agent: Option<&str>, called: &str| RuleEntry {
        agent: agent.map(id),
        called: id(called),
        performatives: PASSING.into(),
        actions: same(&mut agent.iter().map(|_| "move")),
        costs: BTreeMap::new(),
        goals: BTreeSet::from(["known-temperature".to_owned()]),
    };
    let (called, imports, exports) = match way {
        Way::There => ("tenant", rule(None, DESK), rule(Some(LENT), MIRROR)),
        Way::Back => ("annex-tenant", rule(None, DESK_OF_ANNEX), rule(Some(MIRROR), GHOST)),
    };
    InterfaceEntry {
        file: PathBuf::new(),
        daemon: None,
        called: id(called),
        rate: RATE,
        types: same(&mut domain.types.iter().map(|it| it.name.as_str())),
        predicates: same(&mut domain.predicates.iter().map(|it| it.name.as_str())),
        functions: same(&mut domain.functions.iter().map(|it| it.name.as_str())),
        objects: same(&mut map.objects.iter().map(|it| it.object.name.as_str())),
        imports: vec![imports],
        exports: vec![exports],
    }
}

fn id(name: &str) -> AgentId {
    AgentId::new(name).expect("invariant: a literal that is a name")
}

fn ecosystem(name: &str) -> EcosystemId {
    EcosystemId::new(name).expect("invariant: a literal that is a name")
}
