//! Watches an input line, including while the line's chip is unplugged and plugged in again.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinHandle;

use crate::{GpioBoard, InputLine, InputSettings, LineError};

/// Interval for checking whether a missing chip is back, and whether a present chip is still there.
/// The second check is needed because kernels before 6.6 do not wake a process that waits for edges
/// of a chip that is unplugged.
const PRESENCE_CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Interval for reading a line if its chip reports no edges. It is short enough for the opening and
/// closing of a door, for example.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// State of a watched line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineState {
    /// The line has not been read since the watch began.
    Unknown,
    /// The line is present. The field is `true` if the line is active.
    Present(bool),
    /// The line cannot be read at present. The field is the reason; the text completes “failed to
    /// …”.
    Unavailable(String),
}

/// Watch on an input line. Dropping this value ends the watch.
pub struct LineWatch {
    state: watch::Receiver<LineState>,
    task: JoinHandle<()>,
}

impl LineWatch {
    /// Returns a receiver for the state of the watched line and its changes.
    pub fn state(&self) -> watch::Receiver<LineState> {
        self.state.clone()
    }
}

impl Drop for LineWatch {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Starts to watch an input line. Must be called on a Tokio runtime.
pub fn watch_line(board: Arc<dyn GpioBoard>, input: InputSettings) -> LineWatch {
    let (said, state) = watch::channel(LineState::Unknown);
    let input = Arc::new(input);
    let task = tokio::spawn(async move {
        loop {
            let problem = match open(&board, &input).await {
                Ok(line) => publish_states(line.into(), &said).await,
                Err(problem) => problem,
            };
            publish_state(&said, LineState::Unavailable(problem));
            tokio::time::sleep(PRESENCE_CHECK_INTERVAL).await;
        }
    });
    LineWatch { state, task }
}

async fn open(
    board: &Arc<dyn GpioBoard>,
    input: &Arc<InputSettings>,
) -> Result<Box<dyn InputLine>, String> {
    let (board, input) = (Arc::clone(board), Arc::clone(input));
    run_blocking(move || board.input(&input)).await
}

/// Publishes the state of a line while the line is present. Returns the reason when the line is no
/// longer present.
async fn publish_states(line: Arc<dyn InputLine>, said: &watch::Sender<LineState>) -> String {
    let pause = if line.reports_edges() { PRESENCE_CHECK_INTERVAL } else { POLL_INTERVAL };
    loop {
        let read = Arc::clone(&line);
        match run_blocking(move || read.value()).await {
            Ok(value) => publish_state(said, LineState::Present(value)),
            Err(problem) => return problem,
        }
        while let Ok(edges) = tokio::time::timeout(pause, line.edges()).await {
            match edges {
                Ok(edges) => edges
                    .into_iter()
                    .for_each(|value| publish_state(said, LineState::Present(value))),
                Err(problem) => return problem.to_string(),
            }
        }
    }
}

fn publish_state(said: &watch::Sender<LineState>, state: LineState) {
    said.send_if_modified(|known| {
        let is_news = *known != state;
        *known = state;
        is_news
    });
}

/// Runs work that may block on a bus, on a thread for blocking work. Returns the text of an error.
pub(crate) async fn run_blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, LineError> + Send + 'static,
) -> Result<T, String> {
    let done = tokio::task::spawn_blocking(work).await.map_err(|error| error.to_string())?;
    done.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MemoryBoard;

    const PATIENCE: Duration = Duration::from_secs(20);

    fn input(is_active_low: bool) -> InputSettings {
        let line = "door".to_owned().try_into().expect("a name");
        InputSettings { line, is_active_low, bias: None, debounce: None }
    }

    async fn is(state: &mut watch::Receiver<LineState>, expected: LineState) {
        let is_so = tokio::time::timeout(PATIENCE, state.wait_for(|now| *now == expected))
            .await
            .is_ok_and(|state| state.is_ok());
        assert!(is_so, "{:?} is not {expected:?}", state.borrow());
    }

    #[tokio::test]
    async fn a_line_is_watched_through_edges_unplugging_and_plugging_in() {
        for is_active_low in [false, true] {
            let bench = MemoryBoard::default();
            let followed = watch_line(Arc::new(bench.clone()), input(is_active_low));
            let mut state = followed.state();
            let away = "find a line named `door`; looked on all chips: \
                        this machine has none that this user may open";
            is(&mut state, LineState::Unavailable(away.to_owned())).await;
            bench.plug("door", is_active_low);
            is(&mut state, LineState::Present(false)).await;
            for is_active in [true, false, true] {
                bench.set("door", is_active != is_active_low);
                is(&mut state, LineState::Present(is_active)).await;
            }
            bench.unplug("door");
            let gone = "wait for the line `door`: No such device (os error 19)";
            is(&mut state, LineState::Unavailable(gone.to_owned())).await;
            bench.plug("door", !is_active_low);
            is(&mut state, LineState::Present(true)).await;
        }
    }

    #[tokio::test]
    async fn a_chip_without_edge_reports_is_polled() {
        let bench = MemoryBoard::default();
        bench.plug("door", false);
        bench.disable_edge_reports();
        let followed = watch_line(Arc::new(bench.clone()), input(false));
        let mut state = followed.state();
        is(&mut state, LineState::Present(false)).await;
        bench.set("door", true);
        is(&mut state, LineState::Present(true)).await;
        bench.unplug("door");
        let gone = "read the line `door`: No such device (os error 19)";
        is(&mut state, LineState::Unavailable(gone.to_owned())).await;
    }

    #[tokio::test]
    async fn dropping_a_watch_closes_its_line() {
        let bench = MemoryBoard::default();
        bench.plug("door", false);
        let followed = watch_line(Arc::new(bench.clone()), input(false));
        is(&mut followed.state(), LineState::Present(false)).await;
        let second = watch_line(Arc::new(bench.clone()), input(false));
        let used = "use the line `door`: another agent of Althing uses it already";
        is(&mut second.state(), LineState::Unavailable(used.to_owned())).await;
        drop(followed);
        is(&mut second.state(), LineState::Present(false)).await;
    }
}
