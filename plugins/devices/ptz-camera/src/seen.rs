//! The state of a camera as the task of its driver sees it, and its comparison with the state that
//! the agent knows.

use std::collections::BTreeSet;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use crate::driver::{News, SharedKnown};

/// Time limit for the first connection, after which the agent is announced without it.
const FIRST_CONNECTION_TIME_MAX: Duration = Duration::from_secs(5);

/// Interval at which the state of the camera is compared again with the state that the agent knows,
/// which a failure may have changed.
const COMPARE_INTERVAL: Duration = Duration::from_secs(1);

/// State of a camera, as its driver sees it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Seen {
    /// Whether a connection was tried.
    pub(crate) is_tried: bool,
    /// Reason why the camera cannot be used; `None` if it can.
    pub(crate) problem: Option<String>,
    /// Preset that the camera looks at; `None` if its direction is not a preset, or is unknown.
    pub(crate) preset: Option<String>,
    /// Presets of the config that the camera does not have.
    pub(crate) missing: BTreeSet<String>,
    pub(crate) has_motion: bool,
}

/// Waits for the first connection, for a bounded time.
pub(crate) async fn first_connection(mut seen: watch::Receiver<Seen>) {
    let tried = seen.wait_for(|seen| seen.is_tried);
    // After this time, the camera is announced with an unknown state.
    let _ = tokio::time::timeout(FIRST_CONNECTION_TIME_MAX, tried).await;
}

/// Waits until the seen state differs from the known one, or there is motion. The direction of a
/// camera that turns is no news.
pub(crate) async fn next_news(
    mut changes: watch::Receiver<Seen>,
    known: SharedKnown,
    is_turning: impl Fn() -> bool,
) -> News {
    loop {
        let Seen { problem, preset, missing, has_motion, .. } = changes.borrow_and_update().clone();
        let known = known.get();
        let has_motion = has_motion
            && preset.is_some()
            && preset == known.preset
            && Instant::now() >= known.quiet_until;
        let is_news = problem != known.problem
            || missing != known.missing
            || (preset != known.preset && !is_turning())
            || has_motion;
        if is_news {
            return News { preset, has_motion, problem, missing };
        }
        // The sender lives as long as the driver.
        let _ = tokio::time::timeout(COMPARE_INTERVAL, changes.changed()).await;
    }
}
