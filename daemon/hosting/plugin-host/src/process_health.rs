//! State of the running process of a plugin: the time since it is ready, the resources that it
//! takes, and the reasons to end it.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::AgentId;
use tokio::time::Instant;

use crate::cgroup::PluginCgroup;
use crate::desired_state::{DesiredPlugin, WantedAgent};
use crate::launching::threads_max;
use crate::package::Package;
use crate::resource_sampling::ResourceSample;
use crate::rights::Permissions;
use crate::usage::FILES_MAX;

/// Time for which a plugin may exceed its share of the processor before it is slowed down. After
/// [`CPU_STOPPED`] the plugin is ended.
const CPU_SLOWED: Duration = Duration::from_secs(5);
const CPU_STOPPED: Duration = Duration::from_secs(20);
/// Time without any present agent of a plugin after which the plugin is ended, although its process
/// runs.
pub(crate) const SILENT: Duration = Duration::from_secs(10);

/// State of a plugin's running process.
pub(crate) struct ProcessHealth {
    pub(crate) began: Instant,
    pub(crate) ready: Option<Instant>,
    /// Time at which at least one of the plugin's agents was last present.
    pub(crate) last_present: Instant,
    last_sample: (Instant, ResourceSample),
    /// Time for which the plugin has exceeded its share of the processor; reduced again by time
    /// below the share.
    over_cpu: Duration,
    is_slowed: bool,
}

impl ProcessHealth {
    pub(crate) fn new() -> ProcessHealth {
        let now = Instant::now();
        ProcessHealth {
            began: now,
            ready: None,
            last_present: now,
            last_sample: (now, ResourceSample::default()),
            over_cpu: Duration::ZERO,
            is_slowed: false,
        }
    }

    /// Returns the reason why the plugin's process has to be ended; `None` if the process may
    /// continue.
    pub(crate) fn limit_exceeded(
        &mut self,
        wanted: &DesiredPlugin,
        look: ResourceSample,
        counted: Option<&PluginCgroup>,
        accepted: &BTreeMap<AgentId, Result<(), String>>,
    ) -> Option<String> {
        let permissions = &wanted.package.manifest.permissions;
        self.memory_exceeded(permissions, &look)
            .or_else(|| self.cpu_exceeded(wanted, look, counted))
            .or_else(|| self.absence_exceeded(wanted, accepted))
    }

    fn memory_exceeded(
        &mut self,
        permissions: &Permissions,
        look: &ResourceSample,
    ) -> Option<String> {
        let usage = &look.usage;
        let mebibytes = |bytes: u64| bytes.div_ceil(1 << 20);
        let (holds, may) = (mebibytes(look.memory()), mebibytes(permissions.memory));
        if look.cgroup_usage.is_some_and(|taken| taken.ended > 0) {
            return Some(out_of_memory_message(permissions));
        }
        if look.memory() > permissions.memory {
            return Some(format!("it holds {holds} MiB of memory, and may hold {may}"));
        }
        if usage.processes > permissions.processes {
            let (are, may) = (usage.processes, permissions.processes);
            return Some(format!("it has {are} processes, and may have {may}"));
        }
        let threads_max = threads_max(permissions.processes);
        if u64::from(usage.threads) > threads_max {
            let threads = usage.threads;
            return Some(format!("it has {threads} threads, and may have {threads_max}"));
        }
        let kept = look.disk_usage.as_ref()?;
        let (keeps, may) = (mebibytes(kept.bytes), mebibytes(permissions.disk));
        if kept.bytes > permissions.disk {
            let home = look.home.display();
            return Some(format!("it keeps {keeps} MiB on disk, in {home}, and may keep {may}"));
        }
        if kept.files >= FILES_MAX {
            let home = look.home.display();
            return Some(format!("it keeps {FILES_MAX} files and more in {home}"));
        }
        if kept.in_flight > 0 {
            let count = kept.in_flight;
            return Some(format!(
                "it keeps {count} open files in messages that none of its processes receives, where \
                 they cannot be counted"
            ));
        }
        let hides = kept.hides.as_ref()?;
        Some(format!("what it keeps on disk cannot be counted: {hides}"))
    }

    fn cpu_exceeded(
        &mut self,
        wanted: &DesiredPlugin,
        look: ResourceSample,
        counted: Option<&PluginCgroup>,
    ) -> Option<String> {
        let Package { manifest, .. } = &*wanted.package;
        let may = manifest.permissions.cpu;
        let now = Instant::now();
        let (before, last) = std::mem::replace(&mut self.last_sample, (now, look));
        let look = &self.last_sample.1;
        let elapsed = now.saturating_duration_since(before);
        let spent = match (look.cgroup_usage, last.cgroup_usage) {
            (Some(now), before) => now.cpu.saturating_sub(before.unwrap_or_default().cpu),
            (None, _) => look.usage.spent_since(&last.usage),
        };
        let share = spent.as_secs_f64() / elapsed.as_secs_f64().max(1e-3);
        self.over_cpu = match share > may {
            true => self.over_cpu + elapsed,
            false => self.over_cpu.saturating_sub(elapsed),
        };
        if self.over_cpu >= CPU_SLOWED && !self.is_slowed {
            self.is_slowed = true;
            slow_down(look.group);
            counted.inspect(|group| group.slow_down(may));
            tracing::warn!(plugin = manifest.name, "uses too much of the processor: it is slowed");
        }
        (self.over_cpu >= CPU_STOPPED).then(|| {
            let (took, may) = (share * 100.0, may * 100.0);
            format!("it takes {took:.0} % of a core, and may take {may:.0} %")
        })
    }

    fn absence_exceeded(
        &mut self,
        wanted: &DesiredPlugin,
        accepted: &BTreeMap<AgentId, Result<(), String>>,
    ) -> Option<String> {
        let within = wanted.package.manifest.ready_within;
        if self.ready.is_none() && self.began.elapsed() >= within {
            let is_missing =
                |agent: &&WantedAgent| !matches!(accepted.get(&agent.name), Some(Ok(())));
            let missing = wanted.agents.iter().find(is_missing);
            return Some(match missing.map(|agent| (&agent.name, accepted.get(&agent.name))) {
                Some((agent, Some(Err(why)))) => format!("`{agent}` is rejected: {why}"),
                Some((agent, _)) => format!("`{agent}` did not join within {within:?}"),
                None => format!("none of its agents joined within {within:?}"),
            });
        }
        if self.ready.is_some()
            && self.last_present.elapsed() >= SILENT
            && !wanted.agents.is_empty()
        {
            return Some(format!("its agents have been silent for {SILENT:?}"));
        }
        if accepted.values().any(Result::is_ok) {
            self.last_present = Instant::now();
        }
        None
    }
}

/// Returns the message for a person about a plugin that was killed because it exceeded its memory
/// limit.
pub(crate) fn out_of_memory_message(permissions: &Permissions) -> String {
    format!("it held more memory than it may: {} MiB", permissions.memory.div_ceil(1 << 20))
}

/// Gives the lowest priority to all processes of a process group.
fn slow_down(group: i32) {
    if let Some(group) = rustix::process::Pid::from_raw(group) {
        // If this fails, the plugin is ended soon because of its processor time.
        let _ = rustix::process::setpriority_pgrp(Some(group), 19);
    }
}
