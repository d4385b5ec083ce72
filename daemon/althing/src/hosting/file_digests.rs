//! Reports daemons that have read another domain or another map than this one.
//!
//! All machines of an ecosystem must have the same domain file and the same map. A robot with an
//! older map on its machine declines what other agents plan, and no message would say why. Each
//! daemon therefore publishes digests of what it has read, and queries those of each daemon that
//! joins.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use acl::DaemonId;
use agent::{MessageRouter, Resource, ResourceQuery};
use ring::digest::{SHA256, digest};
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast::error::RecvError;

use super::DaemonNode;
use crate::config::Ecosystem;

/// How long to wait for more daemons that join at once, so that all of them are queried together.
const SETTLING: Duration = Duration::from_secs(1);

/// How long to wait for an answer.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// How often a daemon that does not answer is queried: it is seen before it can answer.
const ASKED_MAX: u32 = 5;

/// Number of digits of a digest that are shown, so that a person can compare them.
const DIGEST_CHARS: usize = 12;

/// The files that a daemon has read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
struct FileDigests {
    daemon: DaemonId,
    /// Digests of the parsed text: comments and line breaks do not count.
    domain: String,
    map: String,
}

/// Publishes the digests of this daemon, and logs daemons that have read other files, from now on.
pub(crate) fn watch_files(node: &DaemonNode, ecosystem: &Ecosystem) {
    let switchboard = Arc::clone(node.switchboard());
    let own = FileDigests {
        daemon: switchboard.daemon().clone(),
        domain: short_digest(&ecosystem.domain),
        map: short_digest(&ecosystem.problem),
    };
    switchboard.tell_files(serde_json::json!(own).to_string());
    tokio::spawn(watch(switchboard, own));
}

async fn watch(switchboard: Arc<MessageRouter>, own: FileDigests) {
    let (mut directory, mut changes) = switchboard.presence_changes();
    // Number of queries sent to each daemon that is present.
    let mut asked: BTreeMap<DaemonId, u32> = BTreeMap::new();
    let mut told: BTreeSet<FileDigests> = BTreeSet::new();
    loop {
        // Guests are skipped: a command has read no file by which agents plan.
        let here =
            directory.daemons().filter(|daemon| !daemon.is_guest() && **daemon != own.daemon);
        let here: BTreeSet<DaemonId> = here.cloned().collect();
        // A daemon that comes back may have read another file.
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
                log_differences(&own, &other, &mut told);
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

/// Queries the files of these daemons: a single one by its name, several all at once. Returns the
/// answers that came.
async fn ask(switchboard: &MessageRouter, newcomers: &BTreeSet<DaemonId>) -> Vec<FileDigests> {
    let daemon = newcomers.first().filter(|_| newcomers.len() == 1).cloned();
    let ask = ResourceQuery { daemon, resource: Resource::Files, agent: None };
    let answers = switchboard.ask(ask, ANSWERED_WITHIN).await;
    let read = |answer: &bytes::Bytes| serde_json::from_slice::<FileDigests>(answer).ok();
    // Answers of daemons that were not queried are dropped.
    answers.iter().filter_map(read).filter(|files| newcomers.contains(&files.daemon)).collect()
}

/// Logs the differences between two daemons, once.
fn log_differences(own: &FileDigests, other: &FileDigests, told: &mut BTreeSet<FileDigests>) {
    told.retain(|known| known.daemon != other.daemon || known == other);
    let differences = differences(own, other);
    if !differences.is_empty() && told.insert(other.clone()) {
        for difference in differences {
            tracing::error!("{difference}");
        }
    }
}

/// Returns the differences between two daemons, as messages for the operator.
fn differences(own: &FileDigests, other: &FileDigests) -> Vec<String> {
    let parts = [("domain", &own.domain, &other.domain), ("map", &own.map, &other.map)];
    let differing = parts.into_iter().filter(|(_, own, other)| own != other);
    let said = differing.map(|(what, ours, theirs)| {
        format!(
            "daemon `{}` has read another {what} ({theirs}) than daemon `{}` here ({ours}): its \
             agents decline plans of this one; put the same file on both machines and \
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

    fn files(daemon: &str, map: &str) -> FileDigests {
        let daemon = DaemonId::new(daemon).expect("a name");
        FileDigests { daemon, domain: short_digest(&"domain"), map: short_digest(&map) }
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
        log_differences(&own, &older, &mut told);
        assert!(!told.insert(older.clone()), "it is told");
        // The file was corrected and then differs again: that is reported anew.
        log_differences(&own, &files("c", "rooms"), &mut told);
        assert!(told.is_empty());
    }
}
