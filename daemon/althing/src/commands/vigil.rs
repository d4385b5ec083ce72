//! What a person who waits for a goal is told besides the goal's own news: that nobody leads, and that
//! the daemon through which the command hears stands still.

use std::time::Duration;

use acl::AgentId;
use rustix::process::Pid;
use tokio::time::{Interval, MissedTickBehavior, interval};

use crate::commands::client::View;
use crate::commands::doors;

/// How often it is looked. What is gone for two looks is told: a standby takes over within less.
const PERIOD: Duration = Duration::from_millis(500);

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
        Vigil { view, leader, door, ticks, leaderless: 0, is_door_told: false }
    }

    /// Waits for something to tell.
    pub(super) async fn news(&mut self) -> String {
        loop {
            self.ticks.tick().await;
            if let Some(news) = self.of_door().or_else(|| self.of_leader()) {
                return news;
            }
        }
    }

    fn of_door(&mut self) -> Option<String> {
        let (door, process) = self.door.as_ref()?;
        let is_stopped = doors::is_stopped(*process);
        let is_news = is_stopped && !self.is_door_told;
        self.is_door_told = is_stopped;
        is_news.then(|| {
            format!(
                "the daemon at {door} stands still (process {process} is stopped), and this \
                 command hears by it: it hears nothing until it is linked to another daemon, \
                 which takes up to twenty seconds, and may miss what is said meanwhile; \
                 `althing goals` tells how the goal stands"
            )
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
