//! Reports daemons that have read a domain or a map that differs from this daemon's.
//!
//! All machines of an ecosystem must have the same domain file and the same map. A robot on a
//! machine with an older map declines plans of other agents without a message about the map.
//! Therefore each daemon publishes digests of the files that it has read, and queries the digests
//! of each daemon that joins.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, UNIX_EPOCH};

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
pub(crate) struct FileDigests {
    pub(crate) daemon: DaemonId,
    /// Digest of the parsed domain: comments and line breaks do not change it. The field `map` is
    /// the digest of the parsed map.
    pub(crate) domain: String,
    pub(crate) map: String,
}

/// What a daemon answers to a query for its files: the digests, and its clock, which `althing doctor`
/// compares. Daemons of earlier versions answer with the digests alone.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct DaemonSelfReport {
    #[serde(flatten)]
    pub(crate) digests: FileDigests,
    /// The daemon's clock when it answered, in milliseconds since 1970.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) clock_ms: Option<u64>,
    /// Digest of the text of the ecosystem file that the daemon has read last, comments included.
    /// `None` if the daemon does not read the file again at SIGHUP, or is of an earlier version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) file_text: Option<String>,
}

/// The digest of the text of the ecosystem file that this daemon has read last; `None` inside if the
/// daemon does not read the file again while it runs.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReadText(Arc<Mutex<Option<String>>>);

impl ReadText {
    /// Sets the text to that of `ecosystem`.
    pub(crate) fn set(&self, ecosystem: &Ecosystem) {
        let digest = text_digest(&ecosystem.sources.file.text);
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(digest);
    }

    fn digest(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Returns the digest of the text of an ecosystem file, as daemons report it.
pub(crate) fn text_digest(text: &str) -> String {
    short_digest(&text)
}

/// Publishes the digests of this daemon, and logs each other daemon that has read other files.
/// Returns at once; a task watches for daemons that join later.
pub(crate) fn watch_files(node: &DaemonNode, ecosystem: &Ecosystem, read_text: ReadText) {
    let router = Arc::clone(node.router());
    let own = FileDigests::of(router.daemon().clone(), ecosystem);
    let (digests, services) = (own.clone(), router.host_services());
    router.tell_files(move || {
        let since_1970 = services.wall_clock().duration_since(UNIX_EPOCH).ok();
        let clock_ms = since_1970.and_then(|clock| u64::try_from(clock.as_millis()).ok());
        let file_text = read_text.digest();
        let report = DaemonSelfReport { digests: digests.clone(), clock_ms, file_text };
        serde_json::json!(report).to_string()
    });
    tokio::spawn(watch(router, own));
}

impl FileDigests {
    /// Returns the digests of the files of `ecosystem`, as those of `daemon`.
    pub(crate) fn of(daemon: DaemonId, ecosystem: &Ecosystem) -> FileDigests {
        let (domain, map) = (short_digest(&ecosystem.domain), short_digest(&ecosystem.problem));
        FileDigests { daemon, domain, map }
    }
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
