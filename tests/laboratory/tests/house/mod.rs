//! Machines on one network with agents, for tests of a single plugin.

use std::sync::Arc;

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{
    Berth, Blueprint, Host, Launch, LaunchError, Mode, PluginEntry, Settings, Switchboard,
};
use substrate::memory::Network;
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
        let settings = Settings::default();
        let host = Host { mode, settings, journals, ..Host::new(ontology, problem) };
        House { network: Network::new(), host: Arc::new(host) }
    }

    pub(crate) fn machine(&self, name: &str) -> Arc<Switchboard> {
        let daemon = DaemonId::new(name).expect("a name");
        let ecosystem = EcosystemId::new("home").expect("a name");
        let machine = Switchboard::new(ecosystem, daemon.clone(), self.host.settings.clone());
        machine.connect(self.network.open(daemon, Arc::<Switchboard>::clone(&machine) as _));
        machine
    }

    /// Builds an agent of a plugin, under the plugin's name.
    pub(crate) fn built(&self, plugin: &PluginEntry) -> Box<dyn Launch> {
        let (id, config) = (name(plugin.name), serde_json::json!({}).into());
        let host = Arc::clone(&self.host);
        (plugin.build)(Blueprint { id, driver: String::new(), config, host }).expect("built")
    }
}

pub(crate) fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// Launches an agent on a machine.
pub(crate) fn launch(
    agent: Box<dyn Launch>,
    id: &str,
    machine: &Arc<Switchboard>,
    stands_by: bool,
) -> JoinHandle<Result<(), LaunchError>> {
    agent.launch(Berth {
        id: name(id),
        incarnation: machine.machine().next_life(),
        switchboard: Arc::clone(machine),
        ontology: Arc::from("d"),
        stopping: CancellationToken::new(),
        stands_by,
        via: [].into(),
    })
}
