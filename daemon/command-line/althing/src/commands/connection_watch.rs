//! Watches the leader and the command's link while a command waits for the end of a goal. Reports
//! that no leader is present, or that the daemon through which the command receives messages is
//! stopped. After a change to another daemon, the command requests the reports that it missed.

use std::time::Duration;

use acl::AgentId;
use rustix::process::Pid;
use tokio::time::{Interval, MissedTickBehavior, interval};

use crate::commands::client::EcosystemView;
use crate::commands::daemon_sockets;

/// Interval between two checks of leader and link. An absent leader is reported only at the second
/// check, because a standby usually takes over sooner.
const PERIOD: Duration = Duration::from_millis(500);

/// Number of checks in a row without any daemon after which the loss of the link is reported. Some
/// lost links are restored within a second.
const UNREACHED_LOOKS: u32 = 6;

/// Checks the leader and the command's link periodically.
pub(super) struct ConnectionWatch {
    view: EcosystemView,
    leader: AgentId,
    /// The daemon of this machine through which the command receives messages: its endpoint and
    /// process. `None` if no such daemon was found.
    door: Option<(String, Pid)>,
    ticks: Interval,
    /// Number of checks in a row at which no leader was seen.
    leaderless: u32,
    is_door_told: bool,
    /// Number of checks in a row at which no daemon was reached.
    unreached: u32,
    /// Whether the link was lost, and the leader has not been seen since then.
    is_cut_off: bool,
}

/// Change of the leader or of the command's link.
pub(super) enum ConnectionEvent {
    /// A line to show to the user.
    Line(String),
    /// The daemon through which the command receives messages is stopped. The text is a line to
    /// show to the user. The link has been closed, so that Zenoh soon connects the command to
    /// another daemon.
    Stopped(String),
    /// Messages arrive again after a lost link; the command may have missed some in between.
    Reconnected,
}

impl ConnectionWatch {
    /// Starts to watch the connection; `leader` is the agent that decides on the goal.
    pub(super) fn begin(view: &EcosystemView, leader: AgentId) -> ConnectionWatch {
        let door = door_of(view);
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

    /// Waits for the next change of the leader or of the link.
    pub(super) async fn news(&mut self) -> ConnectionEvent {
        loop {
            self.ticks.tick().await;
            if self.hears_again() {
                (self.door, self.is_door_told) = (door_of(&self.view), false);
                return ConnectionEvent::Reconnected;
            }
            if let Some(line) = self.of_door() {
                return ConnectionEvent::Stopped(line);
            }
            if let Some(line) = self.of_link().or_else(|| self.of_leader()) {
                return ConnectionEvent::Line(line);
            }
        }
    }

    /// Whether the leader is seen again for the first time after the link was lost.
    fn hears_again(&mut self) -> bool {
        let directory = self.view.router.directory();
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
        if !is_news {
            return None;
        }
        daemon_sockets::disconnect_from(*process);
        let running = daemon_sockets::running(&self.view.endpoints);
        let next = match running.first() {
            Some(other) => format!("it reads the reports on the goal at {other} from now on"),
            None => "this machine has no other, so the command waits for it".to_owned(),
        };
        Some(format!(
            "the daemon at {door} does not respond (process {process} is stopped), and this \
             command was connected to it; {next}"
        ))
    }

    /// Returns a line if no daemon is reached any more, or if one is reached again. For a stopped
    /// daemon, `of_door` has reported it already, so that there is no second line.
    fn of_link(&mut self) -> Option<String> {
        if self.view.router.directory().iter().next().is_some() {
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
        let directory = self.view.router.directory();
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

/// Returns the endpoint and the process of the daemon on this machine to which the command is
/// connected. Returns `None` if there is none, or if it is in another PID namespace.
fn door_of(view: &EcosystemView) -> Option<(String, Pid)> {
    view.endpoints.iter().find_map(|endpoint| {
        let process = daemon_sockets::process_at(endpoint)?;
        let is_it =
            !daemon_sockets::is_stopped(process) && daemon_sockets::is_connected_to(process);
        is_it.then(|| (endpoint.clone(), process))
    })
}
