//! A second ecosystem, the annex, joined by two interfacing nodes such that exports could loop: one
//! exports a robot to the annex and forwards goals to it, the other would export the same robot
//! back and forward the same goals back.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use acl::content::{Achieve, Keep, Request, value};
use acl::{AgentId, DaemonId, EcosystemId, Performative, Protocol};
use agent::{Host, HostServices, MessageRouter, Resources, Spawner, StateFolder, StopRegistry};
use interfacing::{
    EcosystemEndpoint, Interface, InterfaceCounters, InterfaceEntry, PASSABLE_PERFORMATIVES,
    RuleEntry, connect,
};
use keyboard::{MessageDraft, UserRequest};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::script::{ExportDirection, Safeguard};
use crate::trial_context::TrialContext;

/// Names of both ecosystems.
pub const LABORATORY: &str = "laboratory";
const ANNEX: &str = "annex";

/// The exported robot, its proxy agent in the annex, and the proxy of that proxy, which must never
/// exist.
const LENT_ROBOT: &str = "robot-1";
const PROXY: &str = "lent";
const LOOPED_PROXY: &str = "ghost";

/// Agents that take goals for the other ecosystem. The one in the annex has the name of the Plan
/// Requester, because goals are sent to that name.
const DESK: &str = "annex-desk";
const DESK_OF_ANNEX: &str = "plan-requester";

/// Rate limit in each direction, in messages per second: a robot's heartbeats and a few more.
const RATE: f64 = 20.0;

/// How long to wait for an answer to a goal of the annex.
const PATIENCE: Duration = Duration::from_secs(20);

/// The part of a daemon that makes it an interfacing node.
pub struct InterfaceNode {
    way: ExportDirection,
    state: PathBuf,
    open: Option<OpenInterface>,
    /// The interface of each incarnation, with its counters.
    interfaces: Vec<Interface>,
}

struct OpenInterface {
    annex: Arc<MessageRouter>,
    stopping: CancellationToken,
}

// === impl InterfaceNode ===

impl InterfaceNode {
    /// Creates a node that is switched off. It has its own state folder for the annex.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be created.
    pub fn new(way: ExportDirection, state: &Path) -> std::io::Result<InterfaceNode> {
        let state = state.join(ANNEX);
        std::fs::create_dir_all(&state)?;
        Ok(InterfaceNode { way, state, open: None, interfaces: Vec::new() })
    }

    /// Connects both ecosystems.
    pub fn open(
        &mut self,
        world: &TrialContext,
        machine: impl FnOnce(PathBuf) -> HostServices,
        home: (&Arc<MessageRouter>, &Arc<Host>),
    ) {
        let Some(wire) = &world.annex else { return };
        let daemon = home.0.daemon().clone();
        let (machine, settings) = (machine(self.state.clone()), world.settings.clone());
        let annex = MessageRouter::on(machine, ecosystem(ANNEX), daemon.clone(), settings.clone());
        annex.connect(wire.open(daemon, Arc::<MessageRouter>::clone(&annex) as _));
        let mut resources = Resources::default();
        resources.insert(StopRegistry::open(&self.state));
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
        let shore = |name, router: &Arc<MessageRouter>, host: &Arc<Host>| EcosystemEndpoint {
            name: ecosystem(name),
            domain: Arc::clone(&world.ontology),
            problem: Arc::clone(&world.map),
            spawner: Spawner {
                router: Arc::clone(router),
                host: Arc::clone(host),
                stopping: stopping.clone(),
                tasks: tasks.clone(),
                records_via: world.without != Some(Safeguard::Loops),
            },
        };
        let (near, far) = (shore(LABORATORY, home.0, home.1), shore(ANNEX, &annex, &host));
        let entry = entry(self.way, world);
        let interface = match self.way {
            ExportDirection::ToAnnex => connect(&entry, &near, &far),
            ExportDirection::FromAnnex => connect(&entry, &far, &near),
        };
        self.interfaces.push(interface.expect("invariant: the names are names"));
        self.open = Some(OpenInterface { annex, stopping });
    }

    /// Stops the node as a SIGKILL of its daemon would.
    pub fn kill(&mut self, world: &TrialContext, daemon: &DaemonId) {
        let (Some(open), Some(wire)) = (self.open.take(), &world.annex) else { return };
        wire.kill(daemon);
        // Messages of the node no longer reach any agent.
        open.stopping.cancel();
    }

    /// Returns a message for each promise that this node has broken, at the end of the trial.
    pub fn node_violations(&self) -> Vec<String> {
        let count = |what: fn(&InterfaceCounters) -> u64| -> u64 {
            self.interfaces.iter().map(|it| what(&it.imported) + what(&it.exported)).sum()
        };
        let mut broken = Vec::new();
        if self.way == ExportDirection::FromAnnex {
            let passed = count(|counters| counters.passed.load(Ordering::Relaxed));
            if passed > 0 {
                broken.push(format!("{passed} requests came back to the ecosystem that sent them"));
            }
            let is_lent =
                self.open.as_ref().is_some_and(|open| open.annex.find(&id(PROXY)).is_some());
            if !is_lent {
                broken.push(format!(
                    "`{LENT_ROBOT}` is present, and has no proxy agent in the annex"
                ));
            }
        }
        broken
    }
}

/// Returns a message if the proxy that must not exist is present.
pub fn looped_proxy(here: &MessageRouter) -> Option<String> {
    here.find(&id(LOOPED_PROXY))
        .map(|_| format!("`{LENT_ROBOT}` was lent, and came back as `{LOOPED_PROXY}`"))
}

/// Builds a request of a goal to the annex, which needs the laboratory's robot for it.
pub fn annex_request(goal: &str) -> UserRequest {
    UserRequest::Send(MessageDraft {
        to: Some(id(DESK)),
        performative: Performative::Request,
        protocol: Protocol::Goal,
        conversation: None,
        content: value(&Request::Achieve(Achieve::new(goal, Keep::Achieve, 0))),
        patience: PATIENCE,
    })
}

/// Builds an interface with the same vocabulary on both sides.
fn entry(way: ExportDirection, world: &TrialContext) -> InterfaceEntry {
    let same = |words: &mut dyn Iterator<Item = &str>| -> BTreeMap<String, String> {
        words.map(|word| (word.to_owned(), word.to_owned())).collect()
    };
    let (domain, map) = (&world.ontology, &world.map);
    let rule = |agent: Option<&str>, called: &str| RuleEntry {
        agent: agent.map(id),
        proxy_name: id(called),
        performatives: PASSABLE_PERFORMATIVES.into(),
        actions: same(&mut agent.iter().map(|_| "move")),
        costs: BTreeMap::new(),
        goals: BTreeSet::from(["known-temperature".to_owned()]),
    };
    let (called, imports, exports) = match way {
        ExportDirection::ToAnnex => ("tenant", rule(None, DESK), rule(Some(LENT_ROBOT), PROXY)),
        ExportDirection::FromAnnex => {
            ("annex-tenant", rule(None, DESK_OF_ANNEX), rule(Some(PROXY), LOOPED_PROXY))
        }
    };
    InterfaceEntry {
        file: PathBuf::new(),
        daemon: None,
        remote_name: id(called),
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
