//! Which daemon hosts the replica of an agent that leads, and which daemons host standbys.

use std::collections::BTreeMap;

use acl::AgentId;
use acl::content::DaemonReport;
use agent::Resource;

use crate::commands::client::EcosystemView;

/// The daemons of an agent's replicas, by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct ReplicaHosts {
    pub(super) leader: Option<String>,
    pub(super) standbys: Vec<String>,
}

/// Queries the replicas of all agents from the daemons.
pub(super) async fn replicas(view: &EcosystemView) -> BTreeMap<AgentId, ReplicaHosts> {
    let answers = view.ask(Resource::Daemon, None).await;
    let reports = answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok());
    of_reports(reports)
}

fn of_reports(reports: impl Iterator<Item = DaemonReport>) -> BTreeMap<AgentId, ReplicaHosts> {
    let mut hosts: BTreeMap<AgentId, ReplicaHosts> = BTreeMap::new();
    for DaemonReport { daemon, leads, stands_by, .. } in reports {
        for agent in leads {
            hosts.entry(agent).or_default().leader = Some(daemon.to_string());
        }
        for agent in stands_by {
            hosts.entry(agent).or_default().standbys.push(daemon.to_string());
        }
    }
    hosts
}

// === impl ReplicaHosts ===

impl ReplicaHosts {
    /// Returns the replicas in words, such as “at hall-pi; office-pi stands by”; empty if none is
    /// known.
    pub(super) fn in_words(&self) -> String {
        let leader = self.leader.as_ref().map(|daemon| format!("at {daemon}"));
        let standbys = match self.standbys.as_slice() {
            [] => None,
            [only] => Some(format!("{only} stands by")),
            some => Some(format!("{} stand by", some.join(" and "))),
        };
        leader.into_iter().chain(standbys).collect::<Vec<_>>().join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replicas_are_told_in_words() {
        let hosts = |leader: Option<&str>, standbys: &[&str]| ReplicaHosts {
            leader: leader.map(str::to_owned),
            standbys: standbys.iter().map(|daemon| (*daemon).to_owned()).collect(),
        };
        assert_eq!(hosts(Some("hall"), &[]).in_words(), "at hall");
        assert_eq!(hosts(Some("hall"), &["attic"]).in_words(), "at hall; attic stands by");
        assert_eq!(hosts(None, &["attic", "shed"]).in_words(), "attic and shed stand by");
        assert_eq!(hosts(None, &[]).in_words(), "");
    }
}
