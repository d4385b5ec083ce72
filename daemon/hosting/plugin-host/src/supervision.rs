//! Supervision of one plugin: starts, follows, restarts, gives up and stops the plugin's process.
//!
//! The supervision receives the [`DesiredState`] of the plugin, which takes precedence over
//! everything else: a request to stop that arrives during a restart prevents the restart.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::{AgentId, HelloAgent};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::HostContext;
use crate::advice::advice;
use crate::cgroup::PluginCgroup;
use crate::desired_state::{DesiredPlugin, DesiredState, WantedAgent};
use crate::endpoint::{Endpoint, EndpointParameters};
use crate::launching::{ProcessStart, StartedProcess, described, hello};
use crate::log::PluginLog;
use crate::package::Stamp;
use crate::process::{PluginProcess, ending};
use crate::process_health::{ProcessHealth, SILENT, out_of_memory_message};
use crate::program::ResolvedProgram;
use crate::resource_sampling::ResourceSampler;
use crate::restart_policy::RestartPolicy;
use crate::status::{PluginState, PluginStatus};

/// Interval at which the resources that a plugin takes are measured.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(250);

/// Status of every plugin, by the plugin's name.
pub(crate) type Statuses = Arc<Mutex<BTreeMap<String, PluginStatus>>>;

/// Reason why an incarnation of a plugin has ended.
enum IncarnationEnd {
    /// The desired state of the plugin has changed, or the daemon shuts down.
    Unwanted,
    /// The process ended, or had to be ended. `ready` is the time at which the process became
    /// ready; `None` if it never was.
    Ended { why: String, ready: Option<Instant> },
}

/// What is needed to start the processes of a plugin, for all of its incarnations.
struct OpenedPlugin {
    program: ResolvedProgram,
    /// Descriptions of the agents that the plugin must bring.
    agents: Vec<HelloAgent>,
    endpoint: Endpoint,
}

pub(crate) struct PluginSupervisor {
    pub(crate) name: String,
    pub(crate) context: Arc<HostContext>,
    pub(crate) desired_states: watch::Receiver<DesiredState>,
    pub(crate) statuses: Statuses,
    pub(crate) log: PluginLog,
    /// Stamp of the version that was restored by the last rollback, and the reason; `None` if there
    /// was no rollback.
    pub(crate) rolled_back: Option<(Stamp, String)>,
}

impl PluginSupervisor {
    /// Brings the plugin into each new desired state, until the package is removed or the daemon
    /// shuts down.
    pub(crate) async fn run(mut self) {
        loop {
            let wish = self.desired_states.borrow_and_update().clone();
            match wish {
                DesiredState::Removed => return drop(self.statuses().remove(&self.name)),
                DesiredState::Stopped(state, reason, package) => {
                    self.status(|status| {
                        (status.state, status.reason) = (state, reason);
                        status.describes(package.as_deref());
                    });
                    if self.wait_until_unwanted().await {
                        return;
                    }
                }
                DesiredState::Run(wanted) => {
                    self.keep_running(&wanted).await;
                    if self.context.spawner.stopping.is_cancelled() {
                        return;
                    }
                }
            }
        }
    }

    fn statuses(&self) -> MutexGuard<'_, BTreeMap<String, PluginStatus>> {
        self.statuses.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn status(&self, change: impl FnOnce(&mut PluginStatus)) {
        let mut statuses = self.statuses();
        let status = statuses.entry(self.name.clone()).or_default();
        status.name = self.name.clone();
        status.log = self.log.path().display().to_string();
        change(status);
    }

    /// Waits until the desired state of the plugin changes. Returns `true` if the supervision has
    /// to end instead.
    async fn wait_until_unwanted(&mut self) -> bool {
        let stopping = self.context.spawner.stopping.clone();
        tokio::select! {
            biased;
            () = stopping.cancelled() => true,
            changed = self.desired_states.changed() => changed.is_err(),
        }
    }

    /// Keeps the plugin running until its desired state changes.
    async fn keep_running(&mut self, wanted: &DesiredPlugin) {
        let permissions = &wanted.package.manifest.permissions;
        let (asks, lacks) =
            (permissions.asks(), self.context.machine_confinement().plan(permissions).lacks());
        if !lacks.is_empty() {
            self.log.remark(&format!("not enforced here: {}", lacks.join("; ")));
        }
        self.status(|status| {
            let former = std::mem::take(status);
            *status =
                PluginStatus { name: former.name, log: former.log, ..PluginStatus::default() };
            status.describes(Some(&wanted.package));
            status.state = PluginState::Starting;
            status.allowed = asks.iter().map(ToString::to_string).collect();
            status.not_enforced = lacks;
        });
        let mut opened = None;
        self.run_until_given_up(wanted, &mut opened).await;
        if let Some(OpenedPlugin { endpoint, .. }) = opened {
            endpoint.close().await;
        }
        self.status(|status| {
            (status.pid, status.memory) = (None, None);
            status.agents.clear();
        });
    }

    async fn open(&self, wanted: &DesiredPlugin) -> Result<OpenedPlugin, String> {
        let program = wanted.package.program().await?;
        let (mut agents, mut models) = (Vec::new(), BTreeMap::new());
        for agent in &wanted.agents {
            let (hello, model) = described(&wanted.package, agent)?;
            agents.push(hello);
            models.insert(agent.name.clone(), model.map(Arc::new));
        }
        let socket = self.context.sockets.join(format!("{}.sock", self.name));
        let purpose = EndpointParameters {
            ecosystem: self.context.spawner.router.ecosystem(),
            daemon: self.context.spawner.router.daemon(),
            settings: &self.context.spawner.host.settings,
            socket: &socket,
            package: &wanted.package,
            agents: models,
            spawner: &self.context.spawner,
        };
        let endpoint = Endpoint::open(purpose).await;
        let endpoint = endpoint.map_err(|error| format!("failed to {error}"))?;
        Ok(OpenedPlugin { program, agents, endpoint })
    }

    /// Runs one incarnation after the other. What they need is opened by the first one that can, and
    /// left in `opened`.
    async fn run_until_given_up(
        &mut self,
        wanted: &DesiredPlugin,
        opened: &mut Option<OpenedPlugin>,
    ) {
        let mut lives = RestartPolicy::default();
        while !self.desired_states.has_changed().unwrap_or(true) {
            let (why, ready) = match self.run_incarnation(wanted, opened).await {
                IncarnationEnd::Unwanted => return,
                IncarnationEnd::Ended { why, ready } => (why, ready),
            };
            self.log.remark(&why);
            if ready.is_none() && lives.ends() >= 1 && self.roll_back(wanted, &why) {
                self.wait_until_unwanted().await;
                return;
            }
            let wait = lives.after(ready, Instant::now());
            tracing::warn!(plugin = self.name, ?wait, "{why}");
            let program = opened.as_ref().map(|opened| &opened.program.file);
            let advice = program.and_then(|file| advice(&why, file, &wanted.package.folder));
            self.status(|status| {
                let state =
                    if wait.is_some() { PluginState::Waiting } else { PluginState::GivenUp };
                (status.state, status.reason, status.pid) = (state, Some(why), None);
                status.advice = advice;
                status.restarts += u32::from(wait.is_some());
            });
            let Some(wait) = wait else {
                // Only a person or another version of the package can help.
                self.wait_until_unwanted().await;
                return;
            };
            self.context.spawner.router.activity().count_plugin_restart();
            let stopping = self.context.spawner.stopping.clone();
            tokio::select! {
                biased;
                () = stopping.cancelled() => return,
                _ = self.desired_states.changed() => return self.desired_states.mark_changed(),
                () = tokio::time::sleep(wait) => (),
            }
        }
    }

    /// Runs one incarnation, and opens before it what is not opened yet. A program that is not found
    /// or cannot be described counts as one that ended before it was ready.
    async fn run_incarnation(
        &mut self,
        wanted: &DesiredPlugin,
        opened: &mut Option<OpenedPlugin>,
    ) -> IncarnationEnd {
        let opened = match opened {
            Some(opened) => opened,
            None => match self.open(wanted).await {
                Ok(new) => opened.insert(new),
                Err(why) => return IncarnationEnd::Ended { why, ready: None },
            },
        };
        self.run_process(wanted, opened).await
    }

    /// Restores the version of the package from before an upgrade, because the new version does not
    /// become ready. Returns `true` if there was such a version.
    fn roll_back(&mut self, wanted: &DesiredPlugin, why: &str) -> bool {
        match self.context.packages.roll_back(&self.name, &wanted.stamp) {
            Ok(Some(restored)) => {
                let said = format!("rolled back to the version before: {why}");
                tracing::warn!(plugin = self.name, "{said}");
                self.log.remark(&said);
                self.rolled_back = Some((restored, said));
                self.context.check_again.notify_one();
                true
            }
            Ok(None) => false,
            Err(error) => {
                tracing::error!(plugin = self.name, "failed to {error}");
                false
            }
        }
    }

    /// Runs one incarnation of the plugin's process, until the process ends or must be ended.
    async fn run_process(
        &mut self,
        wanted: &DesiredPlugin,
        opened: &OpenedPlugin,
    ) -> IncarnationEnd {
        let OpenedPlugin { program, agents, endpoint } = opened;
        self.log.begin();
        self.status(|status| {
            (status.state, status.reason, status.advice) = (PluginState::Starting, None, None);
        });
        let ended = |why: String| IncarnationEnd::Ended { why, ready: None };
        let ground = Arc::clone(&self.context);
        let HostContext { launcher, spawner, building, .. } = &*ground;
        let (package, log) = (&wanted.package, &self.log);
        let data = ground.data.join(&self.name);
        let sockets = building.iter().cloned().chain([endpoint.socket.clone()]).collect();
        let machine_confinement = ground.machine_confinement();
        let data = &data;
        let start =
            ProcessStart { launcher, machine_confinement, package, program, sockets, data, log };
        let begun = tokio::select! {
            biased;
            () = spawner.stopping.cancelled() => return IncarnationEnd::Unwanted,
            begun = start.begin() => begun,
        };
        let StartedProcess { mut process, counted } = match begun {
            Ok(started) => started,
            Err(problem) => return ended(problem),
        };
        self.status(|status| status.pid = Some(process.id()));
        let hello = hello(package, spawner, endpoint, agents, building.as_deref());
        let within = wanted.package.manifest.ready_within;
        let said = tokio::time::timeout(within, process.say(&hello)).await;
        if !matches!(said, Ok(Ok(()))) {
            // If the process has ended, its exit status explains the failure better than the error
            // of writing.
            let why = match tokio::time::timeout(SAMPLE_INTERVAL, process.ended()).await {
                Ok(status) => self.with_last_words(ending(status)),
                Err(_) => "it does not read its standard input".to_owned(),
            };
            process.end().await;
            return ended(why);
        }
        let mut living = ProcessHealth::new();
        let disk = wanted.package.manifest.permissions.disk;
        let looking = ResourceSampler::new(process.id(), data.clone(), disk);
        let counted = counted.as_ref();
        match self
            .follow_process(wanted, endpoint, &mut process, &mut living, looking, counted)
            .await
        {
            None => {
                process.stop().await;
                IncarnationEnd::Unwanted
            }
            Some(why) => {
                process.end().await;
                // The kernel kills a process that exceeds its memory limit, and the exit status
                // only reports a killed process.
                let is_full = counted.is_some_and(|group| group.measure().ended > 0);
                let permissions = &wanted.package.manifest.permissions;
                let why = if is_full { out_of_memory_message(permissions) } else { why };
                IncarnationEnd::Ended { why, ready: living.ready }
            }
        }
    }

    /// Follows a process until it ends. Returns the reason why the process ended or must be ended;
    /// `None` if the desired state has changed or the daemon shuts down.
    async fn follow_process(
        &mut self,
        wanted: &DesiredPlugin,
        endpoint: &Endpoint,
        process: &mut PluginProcess,
        living: &mut ProcessHealth,
        mut looking: ResourceSampler,
        counted: Option<&PluginCgroup>,
    ) -> Option<String> {
        let mut accepted = endpoint.accepted.subscribe();
        let mut looks = tokio::time::interval(SAMPLE_INTERVAL);
        looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let stopping = self.context.spawner.stopping.clone();
        loop {
            self.update_agents(wanted, &accepted.borrow_and_update(), living);
            tokio::select! {
                biased;
                () = stopping.cancelled() => return None,
                _ = self.desired_states.changed() => {
                    self.desired_states.mark_changed();
                    return None;
                }
                status = process.ended() => return Some(self.with_last_words(ending(status))),
                _ = accepted.changed() => (),
                () = endpoint.meter.flooded.notified() => {
                    return Some("it sent more messages than are accepted, for too long".to_owned());
                }
                _ = looks.tick() => {
                    let (dropped, look) = (endpoint.meter.dropped(), looking.sample(counted).await);
                    self.status(|status| {
                        (status.memory, status.dropped) = (Some(look.memory()), dropped);
                    });
                    if let Some(why) = living.limit_exceeded(wanted, look, counted, &accepted.borrow()) {
                        return Some(why);
                    }
                }
            }
        }
    }

    fn with_last_words(&self, why: String) -> String {
        match self.log.last_line() {
            Some(words) => format!("{why}: {words}"),
            None => why,
        }
    }

    /// Updates the set of the plugin's present agents, and the status of the plugin.
    fn update_agents(
        &self,
        wanted: &DesiredPlugin,
        accepted: &BTreeMap<AgentId, Result<(), String>>,
        living: &mut ProcessHealth,
    ) {
        let here: Vec<_> =
            accepted.iter().filter(|(_, is)| is.is_ok()).map(|(agent, _)| agent.clone()).collect();
        if !here.is_empty() {
            living.last_present = Instant::now();
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
            self.context.packages.discard_previous(&self.name, &wanted.stamp);
        }
        let restored = self.rolled_back.as_ref().filter(|(stamp, _)| *stamp == wanted.stamp);
        let taken_back = restored.map(|(_, said)| said.clone());
        let is_silent = living.ready.is_some() && here.is_empty() && !wanted.agents.is_empty();
        let silent = || format!("its agents are silent; after {SILENT:?} it is started again");
        let reason = objection.or_else(|| is_silent.then(silent)).or(taken_back);
        self.status(|status| {
            status.agents = here;
            status.reason = reason;
            status.state =
                if living.ready.is_some() { PluginState::Running } else { PluginState::Starting };
        });
    }
}
