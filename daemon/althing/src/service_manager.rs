//! What the service manager is told, systemd or whoever speaks its language: that the daemon is
//! ready, that it lives, that it is stopping.
//!
//! Where nobody listens, because `NOTIFY_SOCKET` is not set, nothing is told. That a service manager
//! cannot be reached is logged, and no reason to end.

use std::future;
use std::time::Duration;

use sd_notify::NotifyState;
use tokio::time::{self, Interval, MissedTickBehavior};

/// How many signs of life fit between two that the service manager must hear: one may be late.
const SIGNS_PER_DEADLINE: u32 = 3;

/// The agents are here. `status` is shown by `systemctl status`.
pub(crate) fn ready(status: &str) {
    tell(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// The agents are giving up their commitments.
pub(crate) fn stopping() {
    tell(&[NotifyState::Stopping]);
}

fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!(%error, "the service manager could not be told");
    }
}

/// Says that the daemon lives, as often as the service manager asked for (`WATCHDOG_USEC`).
pub(crate) struct Watchdog {
    due: Option<Interval>,
}

impl Watchdog {
    /// As the environment says; never due where it says nothing.
    pub(crate) fn from_environment() -> Watchdog {
        let period = sd_notify::watchdog_enabled().map(|deadline| deadline / SIGNS_PER_DEADLINE);
        let due = period.filter(|period| *period > Duration::ZERO).map(|period| {
            let mut due = time::interval(period);
            due.set_missed_tick_behavior(MissedTickBehavior::Delay);
            due
        });
        Watchdog { due }
    }

    /// Waits until a sign of life is due. Dropping the future loses nothing.
    pub(crate) async fn due(&mut self) {
        match &mut self.due {
            Some(due) => {
                due.tick().await;
            }
            None => future::pending().await,
        }
    }

    /// Gives the sign. Whoever calls it proves that it is not stuck.
    pub(crate) fn lives(&self) {
        tell(&[NotifyState::Watchdog]);
    }
}
