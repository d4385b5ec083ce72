//! The part of an ecosystem that one process hosts.

use acl::{AgentId, DaemonId};

use crate::config::{AgentEntry, Ecosystem};

/// The plugin of watchdogs.
const WATCHDOG: &str = "robot-watchdog";

/// The part of the ecosystem that this process hosts: a daemon, and its agents.
#[derive(Clone)]
pub(crate) struct HostedPart {
    /// Name of the daemon.
    pub(crate) daemon: DaemonId,
    /// The entries of the agents that the daemon hosts.
    pub(crate) agents: Vec<AgentEntry>,
    /// Whether the ecosystem file does not name this machine, so that the daemon hosts all agents.
    pub(crate) is_alone: bool,
}

impl HostedPart {
    /// Returns the part that this process hosts: that of the daemon named by `--daemon`, otherwise
    /// that of the daemon with the name of this host. A machine that the file does not name runs
    /// alone and hosts all agents.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the ecosystem has no daemon of that name, or if
    /// it is secured and does not name this machine.
    pub(crate) fn find(ecosystem: &Ecosystem, asked: Option<&str>) -> Result<HostedPart, String> {
        let host = host_name();
        let named = match asked {
            Some(name) => Some(DaemonId::new(name).map_err(|error| error.to_string())?),
            None => host.clone().filter(|host| ecosystem.daemons.contains(host)),
        };
        let Some(daemon) = named else {
            let alone = DaemonId::new("alone").map_err(|error| error.to_string())?;
            let daemon = host.unwrap_or(alone);
            if ecosystem.security.is_some() && !ecosystem.daemons.is_empty() {
                let known: Vec<_> = ecosystem.daemons.iter().map(DaemonId::as_str).collect();
                return Err(format!(
                    "the ecosystem is secured, and its file has no daemon `{daemon}`: the others \
                     would reject its messages; name this daemon with --daemon: {}",
                    known.join(", ")
                ));
            }
            // A daemon that runs alone hosts every agent, so no agent has a standby.
            let alone = |entry: &AgentEntry| AgentEntry { daemons: Vec::new(), ..entry.clone() };
            let agents = ecosystem.agents.iter().map(alone).collect();
            return Ok(HostedPart { daemon, agents, is_alone: true });
        };
        if !ecosystem.daemons.is_empty() && !ecosystem.daemons.contains(&daemon) {
            let known: Vec<_> = ecosystem.daemons.iter().map(DaemonId::as_str).collect();
            let hint = pddl::nearest(daemon.as_str(), known.iter().copied())
                .map(|near| format!("did you mean `{near}`? "))
                .unwrap_or_default();
            return Err(format!(
                "the ecosystem has no daemon called `{daemon}`; {hint}It has: {}",
                known.join(", ")
            ));
        }
        let own = ecosystem.agents_of(&daemon);
        let unassigned = ecosystem.unassigned_agents().filter(|_| ecosystem.daemons.len() <= 1);
        let agents = own.chain(unassigned).cloned().collect();
        Ok(HostedPart { daemon, agents, is_alone: false })
    }

    /// Returns the watchdogs that this process hosts beside their robots although the file gives them
    /// daemons of their own, each with the name of its robot. They cannot help when this machine dies.
    pub(crate) fn idle_watchdogs(&self, ecosystem: &Ecosystem) -> Vec<(AgentId, String)> {
        let is_here = |name: &str| self.agents.iter().any(|entry| entry.name.as_str() == name);
        // `check` reports a watchdog that the file itself puts beside its robot.
        let is_apart = |entry: &&AgentEntry| self.is_alone && !entry.daemons.is_empty();
        let watchdogs = ecosystem.agents.iter().filter(|entry| entry.plugin == WATCHDOG);
        let idle = watchdogs.filter(is_apart).filter_map(|entry| {
            let robot = entry.config["robot"].as_str().filter(|robot| is_here(robot))?;
            Some((entry.name.clone(), robot.to_owned()))
        });
        idle.collect()
    }
}

/// Returns the host name of this machine as a daemon's name; `None` if the host name is not a valid
/// name of a daemon.
pub(crate) fn host_name() -> Option<DaemonId> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok()?;
    let first = name.trim().split('.').next()?.to_lowercase();
    DaemonId::new(&first).ok()
}
