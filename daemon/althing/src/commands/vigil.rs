//! What a person who waits for a goal is told besides the goal's own news: that nobody leads, and that
//! the daemon through which the command hears stands still. When the command is linked to another
//! daemon, what was said of the goal meanwhile is asked for.

use std::time::Duration;

use acl::AgentId;
use rustix::process::Pid;
use tokio::time::{Interval, MissedTickBehavior, interval};

use crate::commands::client::View;
use crate::commands::doors;

/// How often it is looked. What is gone for two looks is told: a standby takes over within less.
const PERIOD: Duration = Duration::from_millis(500);

/// For how many looks no daemon is reached before that is told: some links are back within a second.
const UNREACHED_LOOKS: u32 = 6;

/// Looks while a goal is waited for.
pub(super) struct Vigil {
    view: View,
    leader: AgentId,
    /// The daemon of this machine by which the command hears: its endpoint and process.
    door: Option<(String, Pid)>,
    ticks: Interval,
    /// For how many looks nobody has led.
    leaderless: u32,
    is_door_told: bool,
    /// For how many looks no daemon has been reached.
    unreached: u32,
    /// Whether the link has been lost, and no other is known yet.
    is_cut_off: bool,
}

/// What there is to tell.
pub(super) enum News {
    /// A line for a person.
    Line(String),
    /// The command was cut off, and hears again: it may have missed something.
    HearsAgain,
}

impl Vigil {
    /// Begins; `leader` is the agent that decides on the goal.
    pub(super) fn begin(view: &View, leader: AgentId) -> Vigil {
        let door = view.endpoints.iter().find_map(|endpoint| {
            let process = doors::process_at(endpoint)?;
            (!doors::is_stopped(process)).then(|| (endpoint.clone(), process))
        });
        let mut ticks = interval(PERIOD);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let view = view.clone();
        Vigil {
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

    /// Waits for something to tell.
    pub(super) async fn news(&mut self) -> News {
        loop {
            self.ticks.tick().await;
            if self.hears_again() {
                return News::HearsAgain;
            }
            if let Some(line) =
                self.of_door().or_else(|| self.of_link()).or_else(|| self.of_leader())
            {
                return News::Line(line);
            }
        }
    }

    /// Whether the leader is seen again after a time without a link.
    fn hears_again(&mut self) -> bool {
        let directory = self.view.switchboard.directory();
        self.is_cut_off |= directory.iter().next().is_none();
        let hears_again = self.is_cut_off && directory.find(&self.leader).is_some();
        self.is_cut_off &= !hears_again;
        hears_again
    }

    fn of_door(&mut self) -> Option<String> {
        let (door, process) = self.door.as_ref()?;
        let is_stopped = doors::is_stopped(*process);
        let is_news = is_stopped && !self.is_door_told;
        self.is_door_told = is_stopped;
        is_news.then(|| {
            format!(
                "the daemon at {door} stands still (process {process} is stopped), and this \
                 command is connected to it: within twenty seconds it connects to another \
                 daemon, if there is one, and tells what was said of the goal meanwhile"
            )
        })
    }

    /// Whether any daemon is reached. A door that stands still has been told already.
    fn of_link(&mut self) -> Option<String> {
        if self.view.switchboard.directory().iter().next().is_some() {
            let was_told = self.unreached >= UNREACHED_LOOKS && !self.is_door_told;
            self.unreached = 0;
            return was_told.then(|| "a daemon of the ecosystem is reached again".to_owned());
        }
        self.unreached = self.unreached.saturating_add(1);
        (self.unreached == UNREACHED_LOOKS && !self.is_door_told).then(|| {
            "no daemon of the ecosystem is reached any more; this command waits until one is, and \
             then tells how the goal stands; Ctrl-C ends it"
                .to_owned()
        })
    }

    fn of_leader(&mut self) -> Option<String> {
        let directory = self.view.switchboard.directory();
        // Without a link nobody is seen, and nothing is known of who leads.
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
                        "nobody leads: no daemon that is seen hosts `{leader}`; the goal waits \
                         until a standby takes over, or its daemon comes back"
                    )
                })
            }
        }
    }
}
