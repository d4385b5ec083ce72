//! Machines on one network with agents, for tests of a single plugin.

pub(crate) mod clocks;
pub(crate) mod lamp;
pub(crate) mod opening_journal;
pub(crate) mod sayer;

use std::sync::Arc;

use acl::{AgentId, DaemonId, EcosystemId};
use actuator::{Actuator, Device};
use agent::{
    AgentSettings, Blueprint, Host, LaunchContext, LaunchError, LaunchableAgent, MessageRouter,
    Mode, ModelPrivacy, PluginEntry,
};
use pddl::{Domain, Problem};
use substrate::faulty::LinkConditions;
use substrate::memory::Network;
use substrate::{Inbound, Substrate, faulty};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Machines on one network.
pub(crate) struct House {
    network: Network,
    host: Arc<Host>,
}

impl House {
    pub(crate) fn new(mode: Mode, domain: &str, problem: &str, journals: Vec<AgentId>) -> House {
        let ontology = pddl::parse_domain(domain).into_result().expect("a domain");
        let problem = pddl::parse_problem(problem).into_result().expect("a problem");
        let settings = AgentSettings::default();
        let host = Host { mode, settings, journals, ..Host::new(ontology, problem) };
        House { network: Network::new(), host: Arc::new(host) }
    }

    /// Returns this house, with agents of this privacy.
    pub(crate) fn with_privacy(mut self, privacy: ModelPrivacy) -> House {
        let settings = AgentSettings { privacy, ..self.host.settings.clone() };
        let Host { ontology, map, mode, .. } = &*self.host;
        let host = Host {
            settings,
            mode: *mode,
            ..Host::new(Domain::clone(ontology), Problem::clone(map))
        };
        self.host = Arc::new(host);
        self
    }

    pub(crate) fn machine(&self, name: &str) -> Arc<MessageRouter> {
        self.connected(name, |daemon, inbound| self.network.open(daemon, inbound))
    }

    /// Returns a machine on a network with faults.
    pub(crate) fn machine_on(&self, name: &str, network: &faulty::Network) -> Arc<MessageRouter> {
        self.connected(name, |daemon, inbound| network.open(daemon, inbound))
    }

    fn connected(
        &self,
        name: &str,
        open: impl FnOnce(DaemonId, Arc<dyn Inbound>) -> Arc<dyn Substrate>,
    ) -> Arc<MessageRouter> {
        let daemon = DaemonId::new(name).expect("a name");
        let ecosystem = EcosystemId::new("home").expect("a name");
        let machine = MessageRouter::new(ecosystem, daemon.clone(), self.host.settings.clone());
        machine.connect(open(daemon, Arc::<MessageRouter>::clone(&machine) as _));
        machine
    }

    /// Builds an agent of a plugin, under the plugin's name.
    pub(crate) fn built(&self, plugin: &PluginEntry) -> Box<dyn LaunchableAgent> {
        let (id, config) = (name(plugin.name), serde_json::json!({}).into());
        let host = Arc::clone(&self.host);
        (plugin.build)(Blueprint { id, driver: String::new(), config, host }).expect("built")
    }

    /// Builds the actuator of a device.
    pub(crate) fn actuator(&self, id: &str, device: impl Device) -> Box<dyn LaunchableAgent> {
        let (id, config) = (name(id), serde_json::json!({}).into());
        let host = Arc::clone(&self.host);
        let blueprint = Blueprint { id, driver: String::new(), config, host };
        Actuator::build(&blueprint, device).expect("built")
    }
}

/// Returns links that lose this share of all messages; a quarter as many come twice, and as many late.
pub(crate) fn lossy(loss: f64) -> LinkConditions {
    let (doubled, overtaken) = (loss / 4.0, loss / 4.0);
    LinkConditions { loss, doubled, overtaken, ..LinkConditions::good() }
}

pub(crate) fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// Launches an agent on a machine.
pub(crate) fn launch(
    agent: Box<dyn LaunchableAgent>,
    id: &str,
    machine: &Arc<MessageRouter>,
    stands_by: bool,
) -> JoinHandle<Result<(), LaunchError>> {
    agent.launch(LaunchContext {
        id: name(id),
        incarnation: machine.host_services().next_incarnation(),
        router: Arc::clone(machine),
        ontology: Arc::from("d"),
        stopping: CancellationToken::new(),
        has_replicas: stands_by,
        via: [].into(),
    })
}
