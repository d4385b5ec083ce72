//! Reports daemons that have read a domain or a map that differs from this daemon's.
//!
//! All machines of an ecosystem must have the same domain file and the same map. A robot on a
//! machine with an older map declines plans of other agents without a message about the map.
//! Therefore each daemon publishes digests of the files that it has read, and queries the digests
//! of each daemon that joins.

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

/// How long to wait after a daemon has joined. Other daemons that join at the same time are then
/// queried together with it.
const SETTLING: Duration = Duration::from_secs(1);

/// How long to wait for the answers to a query.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// Maximum number of queries to a daemon that does not answer; after that it is not queried again.
/// A new daemon is seen before it can answer.
const ASKED_MAX: u32 = 5;

/// Number of characters of a digest that are published and shown, few enough for a person to
/// compare.
const DIGEST_CHARS: usize = 12;

/// The digests of the files that a daemon has read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
struct FileDigests {
    daemon: DaemonId,
    /// Digest of the parsed domain: comments and line breaks do not change it. The field `map` is
    /// the digest of the parsed map.
    domain: String,
    map: String,
}

/// Publishes the digests of this daemon, and logs each other daemon that has read other files.
/// Returns at once; a task watches for daemons that join later.
pub(crate) fn watch_files(node: &DaemonNode, ecosystem: &Ecosystem) {
    let router = Arc::clone(node.router());
    let own = FileDigests {
        daemon: router.daemon().clone(),
        domain: short_digest(&ecosystem.domain),
        map: short_digest(&ecosystem.problem),
    };
    router.tell_files(serde_json::json!(own).to_string());
    tokio::spawn(watch(router, own));
}

async fn watch(router: Arc<MessageRouter>, own: FileDigests) {
    let (mut directory, mut changes) = router.presence_changes();
    // Number of queries sent to each daemon that is present.
    let mut asked: BTreeMap<DaemonId, u32> = BTreeMap::new();
    let mut told: BTreeSet<FileDigests> = BTreeSet::new();
    loop {
        // Guests are skipped, because the files of a command affect no plan.
        let here =
            directory.daemons().filter(|daemon| !daemon.is_guest() && **daemon != own.daemon);
        let here: BTreeSet<DaemonId> = here.cloned().collect();
        // A daemon that joins again may have read another file.
        asked.retain(|daemon, _| here.contains(daemon));
        told.retain(|known| here.contains(&known.daemon));
        let is_known = |daemon: &&DaemonId| asked.get(*daemon).is_some_and(|it| *it >= ASKED_MAX);
        let newcomers: BTreeSet<_> = here.iter().filter(|it| !is_known(it)).cloned().collect();
        if !newcomers.is_empty() {
            tokio::time::sleep(SETTLING).await;
            for daemon in &newcomers {
                *asked.entry(daemon.clone()).or_default() += 1;
            }
            for other in ask(&router, &newcomers).await {
                asked.insert(other.daemon.clone(), ASKED_MAX);
                log_differences(&own, &other, &mut told);
            }
            directory = router.directory();
            continue;
        }
        match changes.recv().await {
            Ok(_) | Err(RecvError::Lagged(_)) => directory = router.directory(),
            Err(RecvError::Closed) => return,
        }
    }
}

/// Queries the digests of the daemons in `newcomers`: a single daemon by its name, several by one
/// query to all daemons. Returns the answers that arrived in time.
async fn ask(router: &MessageRouter, newcomers: &BTreeSet<DaemonId>) -> Vec<FileDigests> {
    let daemon = newcomers.first().filter(|_| newcomers.len() == 1).cloned();
    let ask = ResourceQuery { daemon, resource: Resource::Files, agent: None };
    let answers = router.ask(ask, ANSWERED_WITHIN).await;
    let read = |answer: &bytes::Bytes| serde_json::from_slice::<FileDigests>(answer).ok();
    // Answers of daemons that were not queried are dropped.
    answers.iter().filter_map(read).filter(|files| newcomers.contains(&files.daemon)).collect()
}

/// Logs the differences between the files of two daemons, unless they have been logged already.
fn log_differences(own: &FileDigests, other: &FileDigests, told: &mut BTreeSet<FileDigests>) {
    told.retain(|known| known.daemon != other.daemon || known == other);
    let differences = differences(own, other);
    if !differences.is_empty() && told.insert(other.clone()) {
        for difference in differences {
            tracing::error!("{difference}");
        }
    }
}

/// Returns the differences between the files of two daemons, as messages for the operator.
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
    fn a_difference_is_logged_once_with_both_digests() {
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
