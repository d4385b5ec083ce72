//! The ways of a real base, and the file that keeps what the base has learned of them.
//!
//! - The file has the time that driving takes on each way, and not the cost, so that another `speed`
//!   in the config does not make it wrong. It is replaced as a whole after each passed way.
//! - The next incarnation reads the file. A way that is not on the map any more is left out, so the
//!   file is never longer than the map.
//! - A file that cannot be read is set aside, and the base learns anew.

use std::fs::File;
use std::future::pending;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use agent::{Blueprint, BuildCheck, StateFolder, replace_file};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::ways::KnownWays;

/// Longest file that is read, in bytes: enough for ten thousand ways. A longer one is not ours.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// Longest time that is believed of a way, in seconds. A move that takes longer is cancelled long
/// before.
const SECONDS_MAX: f64 = 1e6;

/// The ways of a real base, with the file that keeps what is learned of them.
pub(crate) struct LearnedWays {
    known: watch::Sender<KnownWays>,
    /// Speed of the base, in meters per second.
    speed: f64,
    /// `None` if nothing outlives the process.
    file: Option<WayFile>,
}

struct WayFile {
    path: PathBuf,
    /// Held while the file is written.
    writing: Mutex<()>,
}

/// Content of the file.
#[derive(Debug, Default, Serialize, Deserialize)]
struct StoredWays {
    ways: Vec<StoredWay>,
}

/// How long the base has taken from one place to another.
#[derive(Debug, Serialize, Deserialize)]
struct StoredWay {
    from: String,
    to: String,
    seconds: f64,
}

impl LearnedWays {
    /// Returns the ways of the map, and those between `poses` and the places beside them, with what
    /// earlier incarnations have learned. `speed` is that of the base, in meters per second.
    pub(crate) fn of(
        blueprint: &Blueprint,
        poses: impl Iterator<Item = (String, String, f64)>,
        speed: f64,
        blocked_for: Duration,
    ) -> LearnedWays {
        let mut known = KnownWays::of(&blueprint.host.map, poses, blocked_for);
        let resources = &blueprint.host.resources;
        let is_check = resources.get::<BuildCheck>().is_some();
        let folder = resources.get::<StateFolder>().filter(|_| !is_check);
        let file = folder.map(|folder| {
            let path = folder.0.join(format!("{}.ways", blueprint.id));
            WayFile { path, writing: Mutex::default() }
        });
        if let Some(file) = &file {
            file.recall(&mut known, speed);
        }
        LearnedWays { known: watch::Sender::new(known), speed, file }
    }

    /// Returns the costs of all ways for the base `id`, as PDDL facts of its action model.
    pub(crate) fn costs(&self, id: &str) -> String {
        self.known.borrow().costs(id)
    }

    /// Returns the facts about blocked ways for the base `id`, as PDDL.
    pub(crate) fn facts(&self, id: &str) -> String {
        self.known.borrow().facts(id, Instant::now())
    }

    /// Records that the base has driven from one place to another within `elapsed`, and waits until
    /// that is on disk.
    pub(crate) async fn passed(self: &Arc<Self>, from: &str, to: &str, elapsed: Duration) {
        let meters = elapsed.as_secs_f64() * self.speed;
        self.known.send_modify(|ways| ways.passed(from, to, meters));
        let Some(file) = &self.file else { return };
        let ways = Arc::clone(self);
        let written = tokio::task::spawn_blocking(move || ways.write()).await;
        if let Err(error) = written.unwrap_or_else(|error| Err(io::Error::other(error))) {
            let file = file.path.display();
            tracing::warn!(%file, %error, "what a way took is not stored: a restart forgets it");
        }
    }

    /// Records that the base did not get from one place to another.
    pub(crate) fn failed(&self, from: &str, to: &str) {
        self.known.send_modify(|ways| ways.failed(from, to, Instant::now()));
    }

    /// Waits until a blocked way is no longer blocked.
    pub(crate) async fn next_unblocked(&self) {
        let mut ways = self.known.subscribe();
        loop {
            let expiry = ways.borrow_and_update().next_expiry(Instant::now());
            let expired = async {
                match expiry {
                    Some(expiry) => tokio::time::sleep_until(expiry).await,
                    None => pending().await,
                }
            };
            tokio::select! {
                () = expired => return,
                changed = ways.changed() => if changed.is_err() { pending().await },
            }
        }
    }

    /// Writes what is learned, as it is when the file can be written.
    fn write(&self) -> io::Result<()> {
        let Some(WayFile { path, writing }) = &self.file else { return Ok(()) };
        let _writing = writing.lock().unwrap_or_else(PoisonError::into_inner);
        let known = self.known.borrow().clone();
        let stored = |(from, to, meters): (&str, &str, f64)| StoredWay {
            from: from.to_owned(),
            to: to.to_owned(),
            seconds: meters / self.speed,
        };
        let stored = StoredWays { ways: known.learned().map(stored).collect() };
        replace_file(path, &serde_json::to_vec(&stored)?)
    }
}

impl WayFile {
    /// Takes what the file tells into the ways of a base with this speed. A file that cannot be read
    /// is set aside.
    fn recall(&self, ways: &mut KnownWays, speed: f64) {
        let stored = match read(&self.path) {
            Ok(stored) => stored,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return,
            Err(error) => {
                let aside = self.path.with_extension("ways.unread");
                let is_aside = std::fs::rename(&self.path, &aside).is_ok();
                let (file, aside) = (self.path.display(), aside.display());
                tracing::warn!(%file, %error, %aside, is_aside,
                    "what ways took cannot be read; the base learns it anew");
                return;
            }
        };
        for StoredWay { from, to, seconds } in stored.ways {
            if seconds > 0.0 && seconds <= SECONDS_MAX {
                ways.recall(&from, &to, seconds * speed);
            }
        }
    }
}

fn read(path: &Path) -> io::Result<StoredWays> {
    let mut bytes = Vec::new();
    File::open(path)?.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes)?;
    if u64::try_from(bytes.len()).is_ok_and(|length| length > FILE_BYTES_MAX) {
        return Err(io::Error::other(format!("it is longer than {FILE_BYTES_MAX} bytes")));
    }
    serde_json::from_slice(&bytes).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use agent::Host;

    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    /// Returns the ways of a base with this speed, on a map with these rooms beside the hall, each
    /// ten meters away.
    fn ways(folder: &Path, rooms: &[&str], speed: f64) -> Arc<LearnedWays> {
        let ways =
            |room: &&str| format!(" (= (distance hall {room}) 10) (= (distance {room} hall) 10)");
        let map = format!(
            "(define (problem p) (:domain d) (:objects hall {}) (:init {}) (:goal (and)))",
            rooms.join(" "),
            rooms.iter().map(ways).collect::<String>()
        );
        let map = pddl::parse_problem(&map).into_result().expect("PDDL");
        let ontology = pddl::parse_domain("(define (domain d))").into_result().expect("PDDL");
        let mut host = Host::new(ontology, map);
        host.resources.insert(StateFolder(folder.to_owned()));
        let blueprint = Blueprint {
            id: acl::AgentId::new("robot").expect("a name"),
            driver: "ros2".to_owned(),
            config: Arc::new(serde_json::json!({})),
            host: Arc::new(host),
        };
        Arc::new(LearnedWays::of(&blueprint, std::iter::empty(), speed, MINUTE))
    }

    const ROOMS: &[&str] = &["attic", "lab"];
    const LEARNED: &str = "(= (travel r hall lab) 16)";

    #[tokio::test]
    async fn a_restart_knows_what_driving_took() {
        let folder = tempfile::tempdir().expect("a folder");
        let before = ways(folder.path(), ROOMS, 0.5);
        before.passed("hall", "lab", MINUTE).await;
        assert!(before.costs("r").contains(LEARNED), "{}", before.costs("r"));
        let after = ways(folder.path(), ROOMS, 0.5);
        assert_eq!(after.costs("r"), before.costs("r"));
        // The same time is another length for a base that is planned to be twice as fast.
        let faster = ways(folder.path(), ROOMS, 1.0);
        assert!(faster.costs("r").contains("(= (travel r hall lab) 32)"), "{}", faster.costs("r"));
    }

    #[tokio::test]
    async fn a_way_that_does_not_exist_any_more_is_dropped() {
        let folder = tempfile::tempdir().expect("a folder");
        let before = ways(folder.path(), ROOMS, 0.5);
        before.passed("hall", "lab", MINUTE).await;
        let without = ways(folder.path(), &["attic"], 0.5);
        assert!(!without.costs("r").contains("lab"), "{}", without.costs("r"));
        without.passed("hall", "attic", MINUTE).await;
        let text = std::fs::read_to_string(folder.path().join("robot.ways")).expect("written");
        assert!(text.contains("attic") && !text.contains("lab"), "{text}");
    }

    #[tokio::test]
    async fn a_file_that_cannot_be_read_is_set_aside() {
        for garbage in ["{\"ways\": [{\"from\"", "[1]", "", "\u{0}\u{0}"] {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("robot.ways");
            std::fs::write(&path, garbage).expect("written");
            let anew = ways(folder.path(), ROOMS, 0.5);
            assert!(anew.costs("r").contains("(= (travel r hall lab) 10)"), "{garbage}");
            let aside = std::fs::read_to_string(path.with_extension("ways.unread"));
            assert_eq!(aside.expect("it is kept"), garbage);
            anew.passed("hall", "lab", MINUTE).await;
            let after = ways(folder.path(), ROOMS, 0.5);
            assert!(after.costs("r").contains(LEARNED), "{}", after.costs("r"));
        }
    }

    #[test]
    fn impossible_times_are_not_believed() {
        let folder = tempfile::tempdir().expect("a folder");
        let way = |seconds| format!(r#"{{"from":"hall","to":"lab","seconds":{seconds}}}"#);
        for seconds in ["-5", "0", "1e300"] {
            let text = format!(r#"{{"ways":[{}]}}"#, way(seconds));
            std::fs::write(folder.path().join("robot.ways"), text).expect("written");
            let costs = ways(folder.path(), ROOMS, 0.5).costs("r");
            assert!(costs.contains("(= (travel r hall lab) 10)"), "{seconds}: {costs}");
        }
    }

    /// A folder at the path of the file makes each write fail, as a full disk would.
    #[tokio::test]
    async fn a_file_that_cannot_be_written_does_not_keep_the_base_from_learning() {
        let folder = tempfile::tempdir().expect("a folder");
        let ways = ways(folder.path(), ROOMS, 0.5);
        std::fs::create_dir(folder.path().join("robot.ways.new")).expect("made");
        ways.passed("hall", "lab", MINUTE).await;
        assert!(ways.costs("r").contains(LEARNED), "{}", ways.costs("r"));
    }
}
