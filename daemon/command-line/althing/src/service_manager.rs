//! Notifies the service manager (systemd or a compatible one) that the daemon is ready, alive, or
//! stopping.
//!
//! If the variable `NOTIFY_SOCKET` is not set, the daemon sends nothing. If the service manager
//! cannot be reached, the daemon logs that and continues.

use std::future;
use std::time::Duration;

use sd_notify::NotifyState;
use tokio::time::{self, Interval, MissedTickBehavior};

/// Number of keep-alives that are sent in a watchdog period. One of them may then be late.
const SIGNS_PER_DEADLINE: u32 = 3;

/// Notifies the service manager that the agents are present. `systemctl status` shows the text
/// `status`.
pub(crate) fn ready(status: &str) {
    notify_manager(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Notifies the service manager that the agents are cancelling their commitments.
pub(crate) fn stopping() {
    notify_manager(&[NotifyState::Stopping]);
}

fn notify_manager(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!(%error, "failed to notify the service manager");
    }
}

/// Sends keep-alives to the service manager as often as it requires by `WATCHDOG_USEC`.
pub(crate) struct Watchdog {
    due: Option<Interval>,
}

impl Watchdog {
    /// Reads the watchdog period from the environment. If there is none, no keep-alive is ever due.
    pub(crate) fn from_environment() -> Watchdog {
        let period = sd_notify::watchdog_enabled().map(|deadline| deadline / SIGNS_PER_DEADLINE);
        let due = period.filter(|period| *period > Duration::ZERO).map(|period| {
            let mut due = time::interval(period);
            due.set_missed_tick_behavior(MissedTickBehavior::Delay);
            due
        });
        Watchdog { due }
    }

    /// Waits until a keep-alive is due. The wait may be cancelled and started again without losing
    /// a keep-alive.
    pub(crate) async fn due(&mut self) {
        match &mut self.due {
            Some(due) => {
                due.tick().await;
            }
            None => future::pending().await,
        }
    }

    /// Sends a keep-alive to the service manager. The call itself proves that the caller is not
    /// stuck.
    pub(crate) fn keep_alive(&self) {
        notify_manager(&[NotifyState::Watchdog]);
    }
}
