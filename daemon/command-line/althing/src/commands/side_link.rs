//! A second link to the ecosystem. A command reads the reports on its goal through it while the
//! daemon of the first link is suspended, for example by SIGSTOP. The second link only reads: the
//! goal's keyboard agent stays at the first link, and receives the final report there.

use std::time::Duration;

use acl::content::GoalStatus;
use tokio::time::{Interval, MissedTickBehavior, interval, timeout};

use crate::commands::client::{ClientLink, ClientTarget, EcosystemView};
use crate::commands::{daemon_sockets, goals};

/// Interval between two readings of the goals.
const PERIOD: Duration = Duration::from_millis(500);

/// How long opening the second link may take. After that, the command has no second link, and waits
/// for the first one.
const OPEN_WITHIN: Duration = Duration::from_secs(3);

/// The second link of a command, and the times at which the command reads through it.
pub(super) struct SideLink {
    link: ClientLink,
    ticks: Interval,
}

impl SideLink {
    /// Opens the second link, through a daemon of this machine. Suspended daemons, and those that
    /// accept no connection, are left out. Returns `None` if no other daemon is there, or if the
    /// link is not open within [`OPEN_WITHIN`].
    pub(super) async fn open(view: &EcosystemView) -> Option<SideLink> {
        let endpoints = daemon_sockets::running(&view.endpoints);
        if endpoints.is_empty() {
            return None;
        }
        let target = ClientTarget {
            name: view.name.clone(),
            ecosystem: view.ecosystem.as_deref().cloned(),
            endpoints,
            keys: view.keys.clone(),
        };
        let opened = timeout(OPEN_WITHIN, target.side_link()).await.ok()?;
        let link = opened.inspect_err(|error| tracing::debug!(%error, "no second link")).ok()?;
        let mut ticks = interval(PERIOD);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Some(SideLink { link, ticks })
    }

    /// Returns the goals of the ecosystem once per period. Never completes if there is no second
    /// link.
    pub(super) async fn goals(side: &mut Option<SideLink>) -> Vec<GoalStatus> {
        match side {
            Some(SideLink { link, ticks }) => {
                ticks.tick().await;
                goals::ask(&link.view).await.unwrap_or_default()
            }
            None => std::future::pending().await,
        }
    }

    /// Closes the second link, if there is one.
    pub(super) async fn close(side: &mut Option<SideLink>) {
        if let Some(SideLink { link, .. }) = side.take() {
            link.node.drain().await;
        }
    }
}
