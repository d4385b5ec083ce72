//! Services of the host machine that an agent uses, besides memory: threads, the wall clock, and
//! incarnation numbers.
//!
//! A daemon uses the services of the real machine. A simulation gives its agents a simulated
//! machine, on which one thread does all work in an order that a seed decides.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::{AgentId, Incarnation};
use tokio::sync::Semaphore;

use crate::compute_pool::{ComputePool, turns_at_once};
use crate::exchange::ExchangeSummary;

/// Name of the file in the state folder that holds the number of the last incarnation that began on
/// this machine.
const LIVES: &str = "lives";

/// Number of computations that run at one time on a simulated machine.
const SIMULATED_AT_ONCE: usize = 2;

/// Services of a machine. Clones refer to the same machine.
#[derive(Clone)]
pub struct HostServices {
    threads: Threads,
    lives: Arc<IncarnationCounter>,
}

/// Executor of slow work: threads of the real machine, or a simulation.
#[derive(Clone)]
enum Threads {
    Real(Arc<ComputePool>),
    Simulated(Arc<dyn MachineSimulation>, Arc<Semaphore>),
}

/// A simulated machine: its wall clock, and the duration of the work that its agents run besides
/// their callbacks.
pub trait MachineSimulation: Send + Sync + 'static {
    /// Returns the time of day of the simulated machine; it may jump.
    fn wall_clock(&self) -> SystemTime;

    /// Returns how long the next work takes in simulated time. Work is a computation or an access
    /// to a disk, which an agent runs besides its callbacks.
    fn work_duration(&self) -> Duration;

    /// Called when an agent of this machine has handled an event, or when its incarnation has
    /// ended. `_exchanges` summarises the exchanges that are open then.
    fn waits_changed(&self, _agent: &AgentId, _life: Incarnation, _exchanges: ExchangeSummary) {}
}

/// Error of work that did not finish: the work panicked, or the daemon is ending. The message
/// completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("finish a piece of work: {0}")]
pub struct WorkError(String);

/// Counter of incarnations: the number of the last one, in memory and on disk.
#[derive(Default)]
struct IncarnationCounter {
    last: Mutex<u64>,
    path: Option<PathBuf>,
}

impl HostServices {
    /// Creates the services of the machine on which this process runs. The number of the last
    /// incarnation is read from a file in the folder `state`, and kept there for the next process;
    /// with `None` the number is neither read nor kept.
    pub fn new(state: Option<PathBuf>) -> HostServices {
        // One computation per core, and two if there is one core, so that a long search does not
        // delay a short one.
        let threads = Threads::Real(Arc::new(ComputePool::new(turns_at_once())));
        HostServices { threads, lives: Arc::new(IncarnationCounter::open(state)) }
    }

    /// Creates the services of a simulated machine. The folder `state` is used as in
    /// [`HostServices::new`].
    pub fn simulated(
        simulated: Arc<dyn MachineSimulation>,
        state: Option<PathBuf>,
    ) -> HostServices {
        let threads = Threads::Simulated(simulated, Arc::new(Semaphore::new(SIMULATED_AT_ONCE)));
        HostServices { threads, lives: Arc::new(IncarnationCounter::open(state)) }
    }

    /// Returns the time of day. Deadlines never use it, because it may jump.
    pub fn wall_clock(&self) -> SystemTime {
        match &self.threads {
            Threads::Real(_) => SystemTime::now(),
            Threads::Simulated(machine, _) => machine.wall_clock(),
        }
    }

    /// Returns the number for an incarnation that begins now. The number is greater than every
    /// number returned before on this machine, even if the clock was put back before this process
    /// began. Other daemons accept the incarnation with the greater number.
    pub fn next_incarnation(&self) -> Incarnation {
        let now = self.wall_clock().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
        self.lives.next(u64::try_from(now).unwrap_or(0))
    }

    /// Reports the open exchanges of an agent to a simulated machine. On a real machine, computes
    /// and reports nothing.
    pub(crate) fn tell_waits(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        exchanges: impl FnOnce() -> ExchangeSummary,
    ) {
        if let Threads::Simulated(machine, _) = &self.threads {
            machine.waits_changed(agent, incarnation, exchanges());
        }
    }

    /// Runs work on a thread that may block, for example to access a disk.
    ///
    /// # Errors
    ///
    /// Returns an error if the work panicked, or the daemon is ending.
    pub async fn run_blocking<T: Send + 'static>(
        self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, WorkError> {
        match self.threads {
            Threads::Real(_) => {
                let worked = tokio::task::spawn_blocking(work).await;
                worked.map_err(|error| WorkError(error.to_string()))
            }
            Threads::Simulated(machine, _) => {
                tokio::time::sleep(machine.work_duration()).await;
                Ok(work())
            }
        }
    }

    /// Runs a computation on a thread that may be busy for long. The computation waits for a
    /// permit, because the agents of one daemon share the machine's cores.
    ///
    /// # Errors
    ///
    /// Returns an error if the computation panicked, or the daemon is ending.
    pub(crate) async fn compute<T: Send + 'static>(
        self,
        compute: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, WorkError> {
        match &self.threads {
            Threads::Real(turns) => {
                let computed = Arc::clone(turns).compute(compute).await;
                computed.ok_or_else(|| WorkError("it panicked, or the daemon is ending".to_owned()))
            }
            Threads::Simulated(_, turns) => {
                // The semaphore is never closed, so a permit is always granted in the end.
                let _turn = Arc::clone(turns).acquire_owned().await.ok();
                self.run_blocking(compute).await
            }
        }
    }
}

impl Default for HostServices {
    /// Creates the services of the machine on which this process runs, without a state folder. No
    /// incarnation number is read from an earlier process or kept for a later one.
    fn default() -> HostServices {
        HostServices::new(None)
    }
}

impl fmt::Debug for HostServices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.threads {
            Threads::Real(_) => "Machine",
            Threads::Simulated(..) => "Machine(simulated)",
        })
    }
}

// === impl IncarnationCounter ===

impl IncarnationCounter {
    fn open(state: Option<PathBuf>) -> IncarnationCounter {
        let path = state.map(|folder| folder.join(LIVES));
        let text = path.as_ref().and_then(|path| std::fs::read_to_string(path).ok());
        // A file that cannot be read counts as missing. The clock alone then determines the next
        // number, as on a new machine.
        let last = text.and_then(|text| text.trim().parse().ok()).unwrap_or(0);
        IncarnationCounter { last: Mutex::new(last), path }
    }

    fn next(&self, now: u64) -> Incarnation {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        *last = now.max(last.saturating_add(1));
        if let Err(error) = self.write(*last) {
            tracing::warn!(%error, "the number of this incarnation cannot be kept; if the clock \
                is put back before the next start, others take this daemon's agents for older ones");
        }
        Incarnation(*last)
    }

    /// Writes the number to a second file, and renames that file. So a crash of the process leaves
    /// either the old or the new number. This does not wait for the disk, as `replace_file` does: a
    /// daemon with a thousand agents would start a thousand times as slowly, and after a power cut
    /// the clock gives a greater number.
    fn write(&self, last: u64) -> io::Result<()> {
        let Some(path) = &self.path else { return Ok(()) };
        let beside = path.with_extension("new");
        std::fs::write(&beside, last.to_string())?;
        std::fs::rename(beside, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incarnations_increase_even_if_the_clock_is_put_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let state = || Some(folder.path().to_owned());
        let before = IncarnationCounter::open(state());
        assert_eq!(before.next(1_000), Incarnation(1_000));
        assert_eq!(before.next(1_000), Incarnation(1_001), "two in one instant");
        let after = IncarnationCounter::open(state());
        assert_eq!(after.next(500), Incarnation(1_002));
        assert_eq!(after.next(2_000), Incarnation(2_000));
        std::fs::write(folder.path().join(LIVES), "torn").expect("written");
        assert_eq!(IncarnationCounter::open(state()).next(3_000), Incarnation(3_000));
    }
}
