//! A second ecosystem, the annex, joined by two interfacing nodes so that what is lent could go round in
//! a circle: one lends a robot to the annex and passes goals on to it, the other would lend the same
//! robot back, and pass the same goals back.

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

/// Both ecosystems.
pub const LABORATORY: &str = "laboratory";
const ANNEX: &str = "annex";

/// The robot that is lent, its mirror in the annex, and the mirror of that which must never be.
const LENT: &str = "robot-1";
const MIRROR: &str = "lent";
const GHOST: &str = "ghost";

/// Who takes goals for the annex; in the annex, who takes them has the name that goals are asked of.
const DESK: &str = "annex-desk";
const DESK_OF_ANNEX: &str = "plan-requester";

/// Messages a second that pass, each way: a robot's heartbeats and a few more.
const RATE: f64 = 20.0;

/// How long an answer of the desk is waited for.
const PATIENCE: Duration = Duration::from_secs(20);

/// Which way an interfacing node lets things through.
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
    /// What each of its lives let through.
    interfaces: Vec<Interface>,
}

struct Open {
    annex: Arc<Switchboard>,
    stopping: CancellationToken,
}

// === impl Gate ===

impl Gate {
    /// A node that is switched off; what it keeps of the annex it keeps in a folder of its own.
    ///
    /// # Errors
    ///
    /// If that cannot be made.
    pub fn new(way: Way, state: &Path) -> std::io::Result<Gate> {
        let state = state.join(ANNEX);
        std::fs::create_dir_all(&state)?;
        Ok(Gate { way, state, open: None, interfaces: Vec::new() })
    }

    /// Joins both ecosystems.
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

    /// As a SIGKILL of its daemon.
    pub fn kill(&mut self, world: &World, daemon: &DaemonId) {
        let (Some(open), Some(wire)) = (self.open.take(), &world.annex) else { return };
        wire.kill(daemon);
        // Nothing that it still says is heard by anybody.
        open.stopping.cancel();
    }

    /// What is not as it must be in the end.
    pub fn broken(&self) -> Vec<String> {
        let count = |what: fn(&Counters) -> u64| -> u64 {
            self.interfaces.iter().map(|it| what(&it.imported) + what(&it.exported)).sum()
        };
        let mut broken = Vec::new();
        if self.way == Way::Back {
            let passed = count(|counters| counters.passed.load(Ordering::Relaxed));
            if passed > 0 {
                broken.push(format!("{passed} requests came back to where they came from"));
            }
            let is_lent =
                self.open.as_ref().is_some_and(|open| open.annex.find(&id(MIRROR)).is_some());
            if !is_lent {
                broken.push(format!("`{LENT}` is here, and has no mirror in the annex"));
            }
        }
        broken
    }
}

/// What must not be here, if it is.
pub fn came_back(here: &Switchboard) -> Option<String> {
    here.find(&id(GHOST)).map(|_| format!("`{LENT}` was lent, and came back as `{GHOST}`"))
}

/// A goal that is asked of the annex, which has nobody for it but us.
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

/// The same words on both sides.
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
