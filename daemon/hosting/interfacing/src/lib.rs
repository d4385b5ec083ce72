//! Interfacing nodes (the paper, “Interfacing Node”; docs/design.md, “Between ecosystems”): daemons
//! that take part in two ecosystems, and pass on exactly what the rules of an interface export.
//!
//! - No message passes from one ecosystem to the other; agents are represented instead. On the
//!   *far* side, where an agent runs, an `agent::Observer` watches it. On the *near* side a proxy
//!   agent (`proxy_device`) represents it: an actuator of its own, with the agent's model
//!   translated into the near vocabulary (`vocabulary`, `translate`, `export`). A request to the
//!   proxy agent is sent to the real agent by a Keyboard Agent on the far side (`remote_client`),
//!   as a person would send it. Therefore tokens, receipts, incarnations and conversations belong
//!   to one ecosystem each, and no identifier of one ecosystem ever appears in the other.
//! - `goal_gateway` accepts goals for the other side. `proxy_lifecycle` starts and stops a proxy
//!   agent together with the real agent, and rejects agents that would return to the ecosystem in
//!   which they originate. `rate_limiter` limits the number of messages per second.
//!
//! Other crates implement the rest: `actuator` runs a proxy agent as an actuator; `althing` reads
//! the rules, checks them against the vocabularies of both ecosystems, and provides both
//! substrates.

pub mod export;
mod goal_gateway;
mod interface_config;
mod proxy_device;
mod proxy_lifecycle;
mod rate_limiter;
pub mod remote_client;
pub mod translate;
pub mod vocabulary;

use std::collections::BTreeMap;
use std::sync::Arc;

use acl::{AgentId, EcosystemId, Performative};
use agent::{AgentWatch, LaunchableAgent, Observer, Spawner};
use keyboard::Keyboard;
use pddl::{Domain, Problem};

use goal_gateway::GoalGateway;
pub use interface_config::{InterfaceEntry, PASSABLE_PERFORMATIVES, RuleEntry};
pub use proxy_device::InterfaceCounters;
use proxy_device::ProxyContext;
use rate_limiter::RateLimiter;
use remote_client::RemoteClient;
use vocabulary::{AgentMapping, InterfaceVocabulary, RuleDirection};

/// One of the two ecosystems of an interface, and the place where this daemon starts agents in it.
#[derive(Clone)]
pub struct EcosystemEndpoint {
    /// Name of the ecosystem.
    pub name: EcosystemId,
    /// Ontology of the ecosystem.
    pub domain: Arc<Domain>,
    /// Map of the ecosystem.
    pub problem: Arc<Problem>,
    /// Starts the agents of this daemon in the ecosystem.
    pub spawner: Spawner,
}

/// Counters of a running interface, by direction.
pub struct Interface {
    /// Counters of the direction from the other ecosystem to this one.
    pub imported: Arc<InterfaceCounters>,
    /// Counters of the direction from this ecosystem to the other.
    pub exported: Arc<InterfaceCounters>,
}

/// Reason why an interface cannot work. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
pub enum InterfaceError {
    /// The name for an agent of the interface is not valid.
    #[error("join `{far}`: {source}")]
    Name {
        /// Name of the other ecosystem.
        far: EcosystemId,
        /// Reason why the name is not valid.
        #[source]
        source: acl::InvalidName,
    },
}

/// Starts an interface between the ecosystems `home` (this one) and `away` (the other one). The
/// interface runs until the daemon shuts down.
///
/// # Errors
///
/// Returns an error if the name for an agent of the interface is not valid.
pub fn connect(
    entry: &InterfaceEntry,
    home: &EcosystemEndpoint,
    away: &EcosystemEndpoint,
) -> Result<Interface, InterfaceError> {
    let (outward, inward) = (RateLimiter::new(entry.rate), RateLimiter::new(entry.rate));
    let (outward, inward) = (Arc::new(outward), Arc::new(inward));
    let interface = Interface { imported: Arc::default(), exported: Arc::default() };
    let name = |text: &str| {
        let far = away.name.clone();
        AgentId::new(text).map_err(|source| InterfaceError::Name { far, source })
    };
    let imports = InterfaceDirection {
        entry,
        direction: RuleDirection::Import,
        near: home.clone(),
        far: away.clone(),
        client_name: entry.remote_name.clone(),
        outbound_limit: Arc::clone(&outward),
        inbound_limit: Arc::clone(&inward),
        counters: Arc::clone(&interface.imported),
    };
    imports.build(&entry.imports, &name(&format!("{}-watch", entry.remote_name))?);
    let theirs = away.name.as_str();
    let exports = InterfaceDirection {
        entry,
        direction: RuleDirection::Export,
        near: away.clone(),
        far: home.clone(),
        client_name: name(theirs)?,
        outbound_limit: inward,
        inbound_limit: outward,
        counters: Arc::clone(&interface.exported),
    };
    exports.build(&entry.exports, &name(&format!("{theirs}-watch"))?);
    Ok(interface)
}

/// One direction of an interface: agents of `far` are represented in `near`.
struct InterfaceDirection<'b> {
    entry: &'b InterfaceEntry,
    direction: RuleDirection,
    near: EcosystemEndpoint,
    far: EcosystemEndpoint,
    /// Name in `far` of the agent that makes requests for `near`.
    client_name: AgentId,
    /// Limit on the rate of messages to `far`; `inbound_limit` limits the rate of messages from
    /// `far`.
    outbound_limit: Arc<RateLimiter>,
    inbound_limit: Arc<RateLimiter>,
    counters: Arc<InterfaceCounters>,
}

impl InterfaceDirection<'_> {
    fn build(&self, rules: &[RuleEntry], watcher: &AgentId) {
        if rules.is_empty() {
            return;
        }
        let client = self.launch_client();
        let watched = rules.iter().filter_map(|rule| rule.agent.clone());
        let (observer, watches) = Observer::of(watched);
        if !watches.is_empty() {
            self.launch_agent(&self.far.spawner, watcher, observer, self.client_route());
        }
        for rule in rules {
            match AgentMapping::of(rule, &self.far.name, self.direction) {
                Some(mapping) => self.launch_proxy(rule, mapping, &watches, &client),
                None => self.launch_gateway(rule, &client),
            }
        }
    }

    /// Returns the route of the agents that act for `near` in `far`: the ecosystems in which these
    /// agents originate. The route is `near` alone.
    fn client_route(&self) -> Vec<EcosystemId> {
        vec![self.near.name.clone()]
    }

    fn launch_client(&self) -> RemoteClient {
        let (keyboard, terminal) = Keyboard::with_terminal();
        let (client, speaking) = RemoteClient::new(terminal);
        self.launch_agent(&self.far.spawner, &self.client_name, keyboard, self.client_route());
        self.far.spawner.tasks.spawn(speaking);
        client
    }

    fn launch_proxy(
        &self,
        rule: &RuleEntry,
        mapping: AgentMapping,
        watches: &BTreeMap<AgentId, AgentWatch>,
        client: &RemoteClient,
    ) {
        let Some(watch) = watches.get(&mapping.agent).cloned() else { return };
        let files = |endpoint: &EcosystemEndpoint| {
            (Arc::clone(&endpoint.domain), Arc::clone(&endpoint.problem))
        };
        let context = ProxyContext {
            mapping,
            performatives: rule.performatives.clone(),
            vocabulary: InterfaceVocabulary::of(self.entry, self.direction),
            far: self.far.name.clone(),
            far_files: files(&self.far),
            near_files: files(&self.near),
            client: client.clone(),
            far_limit: Arc::clone(&self.outbound_limit),
            near_limit: Arc::clone(&self.inbound_limit),
            counters: Arc::clone(&self.counters),
        };
        let near = self.near.spawner.clone();
        self.near.spawner.tasks.spawn(proxy_lifecycle::run_proxy(Arc::new(context), watch, near));
    }

    fn launch_gateway(&self, rule: &RuleEntry, client: &RemoteClient) {
        // Rules name goals in this ecosystem's vocabulary; a rule of exports lets the other
        // ecosystem request them in its own.
        let vocabulary = InterfaceVocabulary::of(self.entry, self.direction).reversed();
        let goals = match self.direction {
            RuleDirection::Import => rule.goals.clone(),
            RuleDirection::Export => { rule.goals.iter() }
                .filter_map(|goal| self.entry.predicates.get(goal).cloned())
                .collect(),
        };
        let gateway = GoalGateway {
            far: self.far.name.clone(),
            goals,
            vocabulary,
            near: (Arc::clone(&self.near.domain), Arc::clone(&self.near.problem)),
            revocable: rule.performatives.contains(&Performative::Cancel),
            client: client.clone(),
            outward: Arc::clone(&self.outbound_limit),
            counters: Arc::clone(&self.counters),
            open: BTreeMap::new(),
        };
        let via = vec![self.far.name.clone()];
        self.launch_agent(&self.near.spawner, &rule.proxy_name, gateway, via);
    }

    fn launch_agent(
        &self,
        spawner: &Spawner,
        id: &AgentId,
        agent: impl agent::Agent,
        via: Vec<EcosystemId>,
    ) {
        let task = Box::new(agent).launch(spawner.launch_context(id, via, &spawner.stopping));
        let id = id.clone();
        spawner.tasks.spawn(async move {
            match task.await {
                Ok(Ok(())) => (),
                Ok(Err(error)) => tracing::error!(%id, "failed to {error}"),
                Err(error) => tracing::error!(%id, %error, "the agent broke"),
            }
        });
    }
}
