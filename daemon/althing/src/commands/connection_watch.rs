//! Watches leader and link while a command waits for a goal. Reports that there is no leader, and
//! that the daemon through which the command receives messages is stopped. When the command is
//! linked to another daemon, the reports of the goal that it missed are requested.

use std::time::Duration;

use acl::AgentId;
use rustix::process::Pid;
use tokio::time::{Interval, MissedTickBehavior, interval};

use crate::commands::client::EcosystemView;
use crate::commands::daemon_sockets;

/// Interval of the checks. An absent leader is reported at the second check: a standby takes over
/// sooner.
const PERIOD: Duration = Duration::from_millis(500);

/// Number of checks without a daemon before that is reported: some links are back within a second.
const UNREACHED_LOOKS: u32 = 6;

/// Checks leader and link periodically.
pub(super) struct ConnectionWatch {
    view: EcosystemView,
    leader: AgentId,
    /// The daemon of this machine through which the command receives messages: its endpoint and
    /// process.
    door: Option<(String, Pid)>,
    ticks: Interval,
    /// Number of checks in a row without a leader.
    leaderless: u32,
    is_door_told: bool,
    /// Number of checks in a row without a daemon.
    unreached: u32,
    /// Whether the link has been lost and the leader has not been seen since.
    is_cut_off: bool,
}

/// An event to report.
pub(super) enum ConnectionEvent {
    /// A line for the user.
    Line(String),
    /// The command was disconnected and receives messages again: it may have missed some.
    Reconnected,
}

impl ConnectionWatch {
    /// Starts the watch; `leader` is the agent that decides on the goal.
    pub(super) fn begin(view: &EcosystemView, leader: AgentId) -> ConnectionWatch {
        let door = view.endpoints.iter().find_map(|endpoint| {
            let process = daemon_sockets::process_at(endpoint)?;
            (!daemon_sockets::is_stopped(process)).then(|| (endpoint.clone(), process))
        });
        let mut ticks = interval(PERIOD);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let view = view.clone();
        ConnectionWatch {
            view,
            leader,
            door,
            ticks,
            leaderless: 0,
            is_door_told: false,
            unreached: 0,
            is_cut_off: false,
        }
    }

    /// Waits for an event.
    pub(super) async fn news(&mut self) -> ConnectionEvent {
        loop {
            self.ticks.tick().await;
            if self.hears_again() {
                return ConnectionEvent::Reconnected;
            }
            if let Some(line) =
                self.of_door().or_else(|| self.of_link()).or_else(|| self.of_leader())
            {
                return ConnectionEvent::Line(line);
            }
        }
    }

    /// Whether the leader is seen again after the link was lost.
    fn hears_again(&mut self) -> bool {
        let directory = self.view.switchboard.directory();
        self.is_cut_off |= directory.iter().next().is_none();
        let hears_again = self.is_cut_off && directory.find(&self.leader).is_some();
        self.is_cut_off &= !hears_again;
        hears_again
    }

    fn of_door(&mut self) -> Option<String> {
        let (door, process) = self.door.as_ref()?;
        let is_stopped = daemon_sockets::is_stopped(*process);
        let is_news = is_stopped && !self.is_door_told;
        self.is_door_told = is_stopped;
        is_news.then(|| {
            format!(
                "the daemon at {door} does not respond (process {process} is stopped), and this \
                 command is connected to it: within twenty seconds it connects to another \
                 daemon, if there is one, and prints the reports on the goal that it missed"
            )
        })
    }

    /// Reports that no daemon is reached, or that one is reached again. A stopped daemon has been
    /// reported already.
    fn of_link(&mut self) -> Option<String> {
        if self.view.switchboard.directory().iter().next().is_some() {
            let was_told = self.unreached >= UNREACHED_LOOKS && !self.is_door_told;
            self.unreached = 0;
            return was_told.then(|| "a daemon of the ecosystem is reached again".to_owned());
        }
        self.unreached = self.unreached.saturating_add(1);
        (self.unreached == UNREACHED_LOOKS && !self.is_door_told).then(|| {
            "no daemon of the ecosystem is reached any more; this command waits until one is, and \
             then prints the state of the goal; Ctrl-C ends it"
                .to_owned()
        })
    }

    fn of_leader(&mut self) -> Option<String> {
        let directory = self.view.switchboard.directory();
        // Without a link no agent is seen, and the leader is unknown.
        directory.iter().next()?;
        let leader = &self.leader;
        match directory.find(leader) {
            Some(resident) => {
                let was_told = self.leaderless > 1;
                self.leaderless = 0;
                was_told.then(|| format!("`{leader}` leads again, at daemon `{}`", resident.daemon))
            }
            None => {
                self.leaderless = self.leaderless.saturating_add(1);
                (self.leaderless == 2).then(|| {
                    format!(
                        "`{leader}` has no leader: no daemon in reach hosts it; the goal waits \
                         until a standby takes over, or its daemon comes back"
                    )
                })
            }
        }
    }
}
