//! Tells of daemons that have read another domain or another map than this one.
//!
//! One ecosystem has one domain file and one map on all machines. A robot whose machine has an older
//! map declines what the others plan, and nothing they say tells why. Each daemon therefore says what
//! it has read, as digests, and asks each daemon that comes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use acl::DaemonId;
use agent::{Ask, Resource, Switchboard};
use ring::digest::{SHA256, digest};
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast::error::RecvError;

use super::Node;
use crate::config::Ecosystem;

/// How long daemons that come at once are waited for, so that all of them are asked together.
const SETTLING: Duration = Duration::from_secs(1);

/// How long an answer is waited for.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// How often a daemon is asked that does not answer: it is seen before it can.
const ASKED_MAX: u32 = 5;

/// Of a digest, the characters that a person compares.
const DIGEST_CHARS: usize = 12;

/// What a daemon has read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
struct Files {
    daemon: DaemonId,
    /// Digests of what is meant: comments and line breaks do not count.
    domain: String,
    map: String,
}

/// Says what this daemon has read, and tells of daemons that have read something else, from now on.
pub(crate) fn watch_files(node: &Node, ecosystem: &Ecosystem) {
    let switchboard = Arc::clone(node.switchboard());
    let own = Files {
        daemon: switchboard.daemon().clone(),
        domain: short_digest(&ecosystem.domain),
        map: short_digest(&ecosystem.problem),
    };
    switchboard.tell_files(serde_json::json!(own).to_string());
    tokio::spawn(watch(switchboard, own));
}

async fn watch(switchboard: Arc<Switchboard>, own: Files) {
    let (mut directory, mut changes) = switchboard.presence_changes();
    // How often each was asked that is here.
    let mut asked: BTreeMap<DaemonId, u32> = BTreeMap::new();
    let mut told: BTreeSet<Files> = BTreeSet::new();
    loop {
        // Commands have read nothing that others plan by.
        let here =
            directory.daemons().filter(|daemon| !daemon.is_guest() && **daemon != own.daemon);
        let here: BTreeSet<DaemonId> = here.cloned().collect();
        // One that comes back may have read another file.
        asked.retain(|daemon, _| here.contains(daemon));
        told.retain(|known| here.contains(&known.daemon));
        let is_known = |daemon: &&DaemonId| asked.get(*daemon).is_some_and(|it| *it >= ASKED_MAX);
        let newcomers: BTreeSet<_> = here.iter().filter(|it| !is_known(it)).cloned().collect();
        if !newcomers.is_empty() {
            tokio::time::sleep(SETTLING).await;
            for daemon in &newcomers {
                *asked.entry(daemon.clone()).or_default() += 1;
            }
            for other in ask(&switchboard, &newcomers).await {
                asked.insert(other.daemon.clone(), ASKED_MAX);
                tell(&own, &other, &mut told);
            }
            directory = switchboard.directory();
            continue;
        }
        match changes.recv().await {
            Ok(_) | Err(RecvError::Lagged(_)) => directory = switchboard.directory(),
            Err(RecvError::Closed) => return,
        }
    }
}

/// What these daemons have read, as far as they answer: one by its name, several all at once.
async fn ask(switchboard: &Switchboard, newcomers: &BTreeSet<DaemonId>) -> Vec<Files> {
    let daemon = newcomers.first().filter(|_| newcomers.len() == 1).cloned();
    let ask = Ask { daemon, resource: Resource::Files, agent: None };
    let answers = switchboard.ask(ask, ANSWERED_WITHIN).await;
    let read = |answer: &bytes::Bytes| serde_json::from_slice::<Files>(answer).ok();
    // Of others nobody asked.
    answers.iter().filter_map(read).filter(|files| newcomers.contains(&files.daemon)).collect()
}

/// Tells what two daemons have read differently, once.
fn tell(own: &Files, other: &Files, told: &mut BTreeSet<Files>) {
    told.retain(|known| known.daemon != other.daemon || known == other);
    let differences = differences(own, other);
    if !differences.is_empty() && told.insert(other.clone()) {
        for difference in differences {
            tracing::error!("{difference}");
        }
    }
}

/// What two daemons have read differently, for the operator.
fn differences(own: &Files, other: &Files) -> Vec<String> {
    let parts = [("domain", &own.domain, &other.domain), ("map", &own.map, &other.map)];
    let differing = parts.into_iter().filter(|(_, own, other)| own != other);
    let said = differing.map(|(what, ours, theirs)| {
        format!(
            "daemon `{}` has read another {what} ({theirs}) than daemon `{}` here ({ours}): its \
             agents decline what is planned by this one; put the same file on both machines and \
             reload both (SIGHUP)",
            other.daemon, own.daemon
        )
    });
    said.collect()
}

fn short_digest(text: &impl Display) -> String {
    let digest = digest(&SHA256, text.to_string().as_bytes());
    let hex: String = digest.as_ref().iter().map(|byte| format!("{byte:02x}")).collect();
    hex.chars().take(DIGEST_CHARS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(daemon: &str, map: &str) -> Files {
        let daemon = DaemonId::new(daemon).expect("a name");
        Files { daemon, domain: short_digest(&"domain"), map: short_digest(&map) }
    }

    #[test]
    fn what_differs_is_told_once_with_both_digests() {
        let (own, same) = (files("a", "rooms"), files("b", "rooms"));
        let older = files("c", "fewer rooms");
        assert!(differences(&own, &same).is_empty());
        let said = differences(&own, &older);
        assert_eq!(said.len(), 1, "the domain is the same: {said:?}");
        for part in ["daemon `c` has read another map", "daemon `a` here", &own.map, &older.map] {
            assert!(said[0].contains(part), "{part}: {said:?}");
        }
        assert_ne!(own.map, older.map);
        let mut told = BTreeSet::new();
        tell(&own, &older, &mut told);
        assert!(!told.insert(older.clone()), "it is told");
        // Mended, and again otherwise: that is news.
        tell(&own, &files("c", "rooms"), &mut told);
        assert!(told.is_empty());
    }
}
