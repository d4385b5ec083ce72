//! Supervision of one plugin: its process is started, followed, restarted, given up and stopped.
//!
//! What is wanted of the plugin comes as a [`Wish`], which takes precedence over everything else: a stop
//! that arrives during a restart wins.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::{AgentId, HelloAgent};
use serde_json::Value;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::Ground;
use crate::advice::advice;
use crate::cgroup::Group;
use crate::endpoint::{Endpoint, Purpose};
use crate::launching::{Start, Started, described, hello};
use crate::lives::Lives;
use crate::living::{Living, SILENT, held_too_much};
use crate::log::Log;
use crate::looking::Looking;
use crate::package::Package;
use crate::process::{Process, ending};
use crate::program::Program;
use crate::status::{State, Status};

/// Interval of measuring what a plugin takes.
const LOOK: Duration = Duration::from_millis(250);

/// Desired state of a plugin.
#[derive(Clone, Debug)]
pub(crate) enum Wish {
    /// The plugin runs.
    Run(Arc<Wanted>),
    /// The plugin does not run: its state, the reason, and its package if that can be read.
    Rest(State, Option<String>, Option<Arc<Package>>),
    /// The package was removed: the supervision ends and its status is deleted.
    Gone,
}

/// A package, and the agents that it has to bring.
#[derive(Debug)]
pub(crate) struct Wanted {
    pub(crate) package: Arc<Package>,
    pub(crate) agents: Vec<WantedAgent>,
}

/// An agent that a plugin has to bring.
#[derive(Clone, Debug, PartialEq)]
pub struct WantedAgent {
    /// Name of the agent.
    pub name: AgentId,
    /// Name of the plugin, within its package.
    pub plugin: String,
    /// Driver that the agent uses; `None` if the file or manifest names none.
    pub driver: Option<String>,
    /// Its `config`, from the ecosystem file or the manifest.
    pub config: Value,
}

/// Status of all plugins, by name.
pub(crate) type Statuses = Arc<Mutex<BTreeMap<String, Status>>>;

/// Reason why an incarnation of a plugin is over.
enum Over {
    /// The desired state has changed, or the daemon drains.
    Unwanted,
    /// The process ended, or had to be ended. `ready` is the time since which it was ready; `None` if it
    /// never was.
    Ended { why: String, ready: Option<Instant> },
}

pub(crate) struct Supervision {
    pub(crate) name: String,
    pub(crate) ground: Arc<Ground>,
    pub(crate) wishes: watch::Receiver<Wish>,
    pub(crate) statuses: Statuses,
    pub(crate) log: Log,
}

impl Supervision {
    /// Follows the wishes until the package is removed or the daemon drains.
    pub(crate) async fn run(mut self) {
        loop {
            let wish = self.wishes.borrow_and_update().clone();
            match wish {
                Wish::Gone => return drop(self.statuses().remove(&self.name)),
                Wish::Rest(state, reason, package) => {
                    self.status(|status| {
                        (status.state, status.reason) = (state, reason);
                        status.describes(package.as_deref());
                    });
                    if self.unwanted().await {
                        return;
                    }
                }
                Wish::Run(wanted) => {
                    self.keep_running(&wanted).await;
                    if self.ground.landing.stopping.is_cancelled() {
                        return;
                    }
                }
            }
        }
    }

    fn statuses(&self) -> MutexGuard<'_, BTreeMap<String, Status>> {
        self.statuses.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn status(&self, change: impl FnOnce(&mut Status)) {
        let mut statuses = self.statuses();
        let status = statuses.entry(self.name.clone()).or_default();
        status.name = self.name.clone();
        status.log = self.log.path().display().to_string();
        change(status);
    }

    /// Waits until the desired state changes. Returns `true` if the supervision has to end instead.
    async fn unwanted(&mut self) -> bool {
        let stopping = self.ground.landing.stopping.clone();
        tokio::select! {
            biased;
            () = stopping.cancelled() => true,
            changed = self.wishes.changed() => changed.is_err(),
        }
    }

    /// Keeps the plugin running until the desired state changes.
    async fn keep_running(&mut self, wanted: &Wanted) {
        let permissions = &wanted.package.manifest.permissions;
        let (asks, lacks) = (permissions.asks(), self.ground.ward().plan(permissions).lacks());
        if !lacks.is_empty() {
            self.log.remark(&format!("not enforced here: {}", lacks.join("; ")));
        }
        self.status(|status| {
            let former = std::mem::take(status);
            *status = Status { name: former.name, log: former.log, ..Status::default() };
            status.describes(Some(&wanted.package));
            status.state = State::Starting;
            status.allowed = asks.iter().map(ToString::to_string).collect();
            status.not_enforced = lacks;
        });
        let (program, agents, endpoint) = match self.open(wanted).await {
            Ok(opened) => opened,
            Err(problem) => {
                self.status(|status| {
                    (status.state, status.reason) = (State::GivenUp, Some(problem))
                });
                self.unwanted().await;
                return;
            }
        };
        self.lives(wanted, &program, &agents, &endpoint).await;
        endpoint.close().await;
        self.status(|status| {
            (status.pid, status.memory) = (None, None);
            status.agents.clear();
        });
    }

    async fn open(&self, wanted: &Wanted) -> Result<(Program, Vec<HelloAgent>, Endpoint), String> {
        let program = wanted.package.program().await?;
        let (mut told, mut models) = (Vec::new(), BTreeMap::new());
        for agent in &wanted.agents {
            let (hello, model) = described(&wanted.package, agent)?;
            told.push(hello);
            models.insert(agent.name.clone(), model.map(Arc::new));
        }
        let socket = self.ground.sockets.join(format!("{}.sock", self.name));
        let purpose = Purpose {
            ecosystem: self.ground.landing.switchboard.ecosystem(),
            daemon: self.ground.landing.switchboard.daemon(),
            settings: &self.ground.landing.host.settings,
            socket: &socket,
            package: &wanted.package,
            agents: models,
            landing: &self.ground.landing,
        };
        let opened = Endpoint::open(purpose).await;
        opened
            .map(|endpoint| (program, told, endpoint))
            .map_err(|error| format!("failed to {error}"))
    }

    async fn lives(
        &mut self,
        wanted: &Wanted,
        program: &Program,
        agents: &[HelloAgent],
        endpoint: &Endpoint,
    ) {
        let mut lives = Lives::default();
        while !self.wishes.has_changed().unwrap_or(true) {
            let (why, ready) = match self.life(wanted, program, agents, endpoint).await {
                Over::Unwanted => return,
                Over::Ended { why, ready } => (why, ready),
            };
            self.log.remark(&why);
            if ready.is_none() && lives.ends() >= 1 && self.roll_back(&why) {
                self.unwanted().await;
                return;
            }
            let wait = lives.after(ready, Instant::now());
            tracing::warn!(plugin = self.name, ?wait, "{why}");
            let advice = advice(&why, &program.file, &wanted.package.folder);
            self.status(|status| {
                let state = if wait.is_some() { State::Waiting } else { State::GivenUp };
                (status.state, status.reason, status.pid) = (state, Some(why), None);
                status.advice = advice;
                status.restarts += u32::from(wait.is_some());
            });
            let Some(wait) = wait else {
                // Only a person or another version can help.
                self.unwanted().await;
                return;
            };
            let stopping = self.ground.landing.stopping.clone();
            tokio::select! {
                biased;
                () = stopping.cancelled() => return,
                _ = self.wishes.changed() => return self.wishes.mark_changed(),
                () = tokio::time::sleep(wait) => (),
            }
        }
    }

    /// Restores the version before an upgrade that does not become ready. Returns whether there was one.
    fn roll_back(&self, why: &str) -> bool {
        match self.ground.shelf.roll_back(&self.name) {
            Ok(true) => {
                let said = format!("rolled back to the version before: {why}");
                tracing::warn!(plugin = self.name, "{said}");
                self.log.remark(&said);
                let mut taken_back = self.ground.taken_back();
                taken_back.insert(self.name.clone(), said);
                drop(taken_back);
                self.ground.look_again.notify_one();
                true
            }
            Ok(false) => false,
            Err(error) => {
                tracing::error!(plugin = self.name, "failed to {error}");
                false
            }
        }
    }

    /// Runs one incarnation of the process, until it is over.
    async fn life(
        &mut self,
        wanted: &Wanted,
        program: &Program,
        agents: &[HelloAgent],
        endpoint: &Endpoint,
    ) -> Over {
        self.log.begin();
        self.status(|status| {
            (status.state, status.reason, status.advice) = (State::Starting, None, None);
        });
        let ended = |why: String| Over::Ended { why, ready: None };
        let ground = Arc::clone(&self.ground);
        let Ground { launcher, landing, building, .. } = &*ground;
        let (package, log) = (&wanted.package, &self.log);
        let data = ground.data.join(&self.name);
        let sockets = building.iter().cloned().chain([endpoint.socket.clone()]).collect();
        let ward = ground.ward();
        let start = Start { launcher, ward, package, program, sockets, data: &data, log };
        let begun = tokio::select! {
            biased;
            () = landing.stopping.cancelled() => return Over::Unwanted,
            begun = start.begin() => begun,
        };
        let Started { mut process, counted } = match begun {
            Ok(started) => started,
            Err(problem) => return ended(problem),
        };
        self.status(|status| status.pid = Some(process.id()));
        let hello = hello(package, landing, endpoint, agents, building.as_deref());
        let within = wanted.package.manifest.ready_within;
        let said = tokio::time::timeout(within, process.say(&hello)).await;
        if !matches!(said, Ok(Ok(()))) {
            // If the process has ended, the way in which it ended says more than the error of writing.
            let why = match tokio::time::timeout(LOOK, process.ended()).await {
                Ok(status) => self.with_last_words(ending(status)),
                Err(_) => "it does not read its standard input".to_owned(),
            };
            process.end().await;
            return ended(why);
        }
        let mut living = Living::new();
        let disk = wanted.package.manifest.permissions.disk;
        let looking = Looking::new(process.id(), data, disk);
        let counted = counted.as_ref();
        match self.live(wanted, endpoint, &mut process, &mut living, looking, counted).await {
            None => {
                process.stop().await;
                Over::Unwanted
            }
            Some(why) => {
                process.end().await;
                // The kernel kills a process that exceeds its memory limit, and the exit status only says
                // “killed”.
                let is_full = counted.is_some_and(|group| group.taken().ended > 0);
                let permissions = &wanted.package.manifest.permissions;
                let why = if is_full { held_too_much(permissions) } else { why };
                Over::Ended { why, ready: living.ready }
            }
        }
    }

    /// Follows a process until it is over. Returns the reason why it ended or has to be ended, or `None` if
    /// it is not wanted any more.
    async fn live(
        &mut self,
        wanted: &Wanted,
        endpoint: &Endpoint,
        process: &mut Process,
        living: &mut Living,
        mut looking: Looking,
        counted: Option<&Group>,
    ) -> Option<String> {
        let mut accepted = endpoint.accepted.subscribe();
        let mut looks = tokio::time::interval(LOOK);
        looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = self.ground.landing.stopping.clone();
        loop {
            self.see(wanted, &accepted.borrow_and_update(), living);
            tokio::select! {
                biased;
                () = stopping.cancelled() => return None,
                _ = self.wishes.changed() => {
                    self.wishes.mark_changed();
                    return None;
                }
                status = process.ended() => return Some(self.with_last_words(ending(status))),
                _ = accepted.changed() => (),
                () = endpoint.meter.flooded.notified() => {
                    return Some("it sent more messages than are accepted, for too long".to_owned());
                }
                _ = looks.tick() => {
                    let (dropped, look) = (endpoint.meter.dropped(), looking.look(counted).await);
                    self.status(|status| {
                        (status.memory, status.dropped) = (Some(look.memory()), dropped);
                    });
                    if let Some(why) = living.objection(wanted, look, counted, &accepted.borrow()) {
                        return Some(why);
                    }
                }
            }
        }
    }

    fn with_last_words(&self, why: String) -> String {
        match self.log.last_words() {
            Some(words) => format!("{why}: {words}"),
            None => why,
        }
    }

    /// Updates which of the plugin's agents are present, and its status.
    fn see(
        &self,
        wanted: &Wanted,
        accepted: &BTreeMap<AgentId, Result<(), String>>,
        living: &mut Living,
    ) {
        let here: Vec<_> =
            accepted.iter().filter(|(_, is)| is.is_ok()).map(|(agent, _)| agent.clone()).collect();
        if !here.is_empty() {
            living.heard = Instant::now();
        }
        let is_here = |agent: &WantedAgent| here.contains(&agent.name);
        let is_ready =
            wanted.agents.iter().all(is_here) && (!here.is_empty() || wanted.agents.is_empty());
        let objected = accepted.iter().find_map(|(agent, is)| Some((agent, is.as_ref().err()?)));
        let objection = objected.map(|(agent, why)| format!("`{agent}` is rejected: {why}"));
        if is_ready && living.ready.is_none() {
            living.ready = Some(Instant::now());
            let took = living.began.elapsed();
            tracing::info!(
                plugin = self.name,
                version = wanted.package.manifest.version,
                ?took,
                "is ready"
            );
            self.ground.shelf.keep(&self.name);
        }
        let taken_back = self.ground.taken_back().get(&self.name).cloned();
        let is_silent = living.ready.is_some() && here.is_empty() && !wanted.agents.is_empty();
        let silent = || format!("its agents are silent; after {SILENT:?} it is started again");
        let reason = objection.or_else(|| is_silent.then(silent)).or(taken_back);
        self.status(|status| {
            status.agents = here;
            status.reason = reason;
            status.state = if living.ready.is_some() { State::Running } else { State::Starting };
        });
    }
}
