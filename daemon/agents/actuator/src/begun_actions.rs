//! When the actions with a limited rate began lately, in memory and on disk, so that a restart of the
//! daemon does not allow twice as many.
//!
//! - The file has times of day, because the clock of the deadlines begins anew with the machine. A
//!   time in the future, as after the clock was put back, counts as the present.
//! - A beginning is on disk before the action begins.
//! - A file that cannot be read is set aside. Every limited action then counts as begun as often as it
//!   may be, as an unreadable file of stops counts as a stop.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::AgentId;
use agent::{StateFolder, replace_file};
use tokio::time::Instant;

/// Longest file that is read, in bytes: enough for sixty actions that begin as often as a limit can
/// allow. A longer one is not ours.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// Times of day at which actions began, by the name of the action: the oldest first, in milliseconds
/// since 1970.
type BeginTimes = BTreeMap<String, Vec<u64>>;

/// When the limited actions of one agent began lately.
#[derive(Debug, Default)]
pub(crate) struct BegunActions {
    begun: BTreeMap<String, VecDeque<Beginning>>,
    /// What the file told when it was opened; `None` as soon as it is taken over.
    earlier: Option<io::Result<BeginTimes>>,
    /// `None` if nothing outlives the process.
    file: Option<Arc<BeginFile>>,
    /// Number of the content that was last made for the file.
    version: u64,
}

/// One beginning of an action.
#[derive(Clone, Copy, Debug)]
struct Beginning {
    /// Time of day, in milliseconds since 1970.
    time: u64,
    /// How long ago it was at the moment `noted`.
    age: Duration,
    noted: Instant,
}

#[derive(Debug)]
struct BeginFile {
    path: PathBuf,
    /// Number of the content that was last written.
    written: Mutex<u64>,
}

fn millis(time: SystemTime) -> u64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

impl Beginning {
    fn elapsed(&self, now: Instant) -> Duration {
        self.age + now.saturating_duration_since(self.noted)
    }
}

impl BegunActions {
    /// Reads the file of the agent `own` in `folder`. With `None`, nothing is read or written.
    pub(crate) fn open(own: &AgentId, folder: Option<&StateFolder>) -> BegunActions {
        let Some(folder) = folder else { return BegunActions::default() };
        let path = folder.0.join(format!("{own}.begun"));
        let earlier = match read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            read => Some(read),
        };
        let file = Some(Arc::new(BeginFile { path, written: Mutex::new(0) }));
        BegunActions { earlier, file, ..BegunActions::default() }
    }

    /// Takes over what the file tells of the limited actions, each with the number of beginnings that
    /// count. `time` is the time of day at the moment `now`.
    pub(crate) fn resume(
        &mut self,
        limited: &BTreeMap<&str, usize>,
        time: SystemTime,
        now: Instant,
    ) {
        let Some(earlier) = self.earlier.take() else { return };
        let today = millis(time);
        let unreadable = earlier.is_err();
        let mut earlier = earlier.unwrap_or_else(|error| {
            self.set_aside(&error);
            BeginTimes::new()
        });
        for (action, at_most) in limited {
            let times = match earlier.remove(*action) {
                _ if unreadable => vec![today; *at_most],
                Some(times) => times,
                None => continue,
            };
            let beginning = |time: u64| {
                let age = Duration::from_millis(today.saturating_sub(time));
                Beginning { time, age, noted: now }
            };
            let surplus = times.len().saturating_sub(*at_most);
            let begun = times.into_iter().skip(surplus).map(beginning).collect();
            self.begun.insert((*action).to_owned(), begun);
        }
    }

    fn set_aside(&self, error: &io::Error) {
        let Some(file) = &self.file else { return };
        let aside = file.path.with_extension("begun.unread");
        let is_aside = std::fs::rename(&file.path, &aside).is_ok();
        let (file, aside) = (file.path.display(), aside.display());
        tracing::warn!(%file, %error, %aside, is_aside,
            "it cannot be read how often actions have begun; they count as begun as often as they may");
    }

    /// Returns how long ago the action began for the `count`-th last time; `None` if it did not begin
    /// so often lately.
    pub(crate) fn nth_last(&self, action: &str, count: usize, now: Instant) -> Option<Duration> {
        let begun = self.begun.get(action)?;
        let beginning = begun.iter().rev().nth(count.checked_sub(1)?)?;
        Some(beginning.elapsed(now))
    }

    /// Records that an action begins, of which the last `at_most` beginnings count. Returns a function
    /// that writes this to disk and waits for the disk; the action may begin only after that function
    /// has succeeded.
    pub(crate) fn begins(
        &mut self,
        action: &str,
        at_most: usize,
        time: SystemTime,
        now: Instant,
    ) -> impl FnOnce() -> io::Result<()> + Send + use<> {
        let begun = self.begun.entry(action.to_owned()).or_default();
        begun.push_back(Beginning { time: millis(time), age: Duration::ZERO, noted: now });
        let surplus = begun.len().saturating_sub(at_most);
        begun.drain(..surplus);
        self.version += 1;
        let times = |begun: &VecDeque<Beginning>| begun.iter().map(|one| one.time).collect();
        let content: BeginTimes =
            self.begun.iter().map(|(action, begun)| (action.clone(), times(begun))).collect();
        let (file, version) = (self.file.clone(), self.version);
        move || match file {
            Some(file) => file.write(&content, version),
            None => Ok(()),
        }
    }
}

impl BeginFile {
    /// Replaces the content, unless a newer one was written already.
    fn write(&self, content: &BeginTimes, version: u64) -> io::Result<()> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if *written < version {
            replace_file(&self.path, &serde_json::to_vec(content)?)?;
            *written = version;
        }
        Ok(())
    }
}

fn read(path: &Path) -> io::Result<BeginTimes> {
    let mut bytes = Vec::new();
    File::open(path)?.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes)?;
    if u64::try_from(bytes.len()).is_ok_and(|length| length > FILE_BYTES_MAX) {
        return Err(io::Error::other(format!("it is longer than {FILE_BYTES_MAX} bytes")));
    }
    serde_json::from_slice(&bytes).map_err(io::Error::other)
}
