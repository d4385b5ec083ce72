//! One life of a plugin's process: when it was ready, what it takes, and why it has to be ended.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::AgentId;
use tokio::time::Instant;

use crate::supervision::{Wanted, WantedAgent};
use crate::usage::Usage;

/// How long it may compute too much before it gets a lower priority, and before it is stopped.
const CPU_SLOWED: Duration = Duration::from_secs(5);
const CPU_STOPPED: Duration = Duration::from_secs(20);
/// How long all its agents may be silent while its process lives.
pub(crate) const SILENT: Duration = Duration::from_secs(10);

/// What is known of a process while it lives.
pub(crate) struct Living {
    pub(crate) began: Instant,
    pub(crate) ready: Option<Instant>,
    /// When one of its agents was here last.
    pub(crate) heard: Instant,
    looked: (Instant, Usage),
    /// For how long it has computed too much.
    over_cpu: Duration,
    is_slowed: bool,
}

impl Living {
    pub(crate) fn new() -> Living {
        let now = Instant::now();
        Living {
            began: now,
            ready: None,
            heard: now,
            looked: (now, Usage::default()),
            over_cpu: Duration::ZERO,
            is_slowed: false,
        }
    }

    /// Why it has to be ended, if it has to.
    pub(crate) fn objection(
        &mut self,
        wanted: &Wanted,
        usage: Usage,
        group: i32,
        accepted: &BTreeMap<AgentId, Result<(), String>>,
    ) -> Option<String> {
        let permissions = &wanted.package.manifest.permissions;
        let mebibytes = |bytes: u64| bytes.div_ceil(1 << 20);
        if usage.memory > permissions.memory {
            let (holds, may) = (mebibytes(usage.memory), mebibytes(permissions.memory));
            return Some(format!("it holds {holds} MiB of memory, and may hold {may}"));
        }
        if usage.processes > permissions.processes {
            let (are, may) = (usage.processes, permissions.processes);
            return Some(format!("it is {are} processes, and may be {may}"));
        }
        let now = Instant::now();
        let (before, last) = std::mem::replace(&mut self.looked, (now, usage));
        let elapsed = now.saturating_duration_since(before);
        let share =
            usage.cpu.saturating_sub(last.cpu).as_secs_f64() / elapsed.as_secs_f64().max(1e-3);
        self.over_cpu = match share > permissions.cpu {
            true => self.over_cpu + elapsed,
            false => self.over_cpu.saturating_sub(elapsed),
        };
        if self.over_cpu >= CPU_SLOWED && !self.is_slowed {
            self.is_slowed = true;
            slow_down(group);
            tracing::warn!(
                plugin = wanted.package.manifest.name,
                "computes too much: it is slowed"
            );
        }
        if self.over_cpu >= CPU_STOPPED {
            let (took, may) = (share * 100.0, permissions.cpu * 100.0);
            return Some(format!("it takes {took:.0} % of a core, and may take {may:.0} %"));
        }
        let within = wanted.package.manifest.ready_within;
        if self.ready.is_none() && self.began.elapsed() >= within {
            let is_missing =
                |agent: &&WantedAgent| !matches!(accepted.get(&agent.name), Some(Ok(())));
            let missing = wanted.agents.iter().find(is_missing);
            return Some(match missing.map(|agent| (&agent.name, accepted.get(&agent.name))) {
                Some((agent, Some(Err(why)))) => format!("`{agent}` is not let in: {why}"),
                Some((agent, _)) => format!("`{agent}` was not here within {within:?}"),
                None => format!("none of its agents was here within {within:?}"),
            });
        }
        if self.ready.is_some() && self.heard.elapsed() >= SILENT && !wanted.agents.is_empty() {
            return Some(format!("its agents have been silent for {SILENT:?}"));
        }
        if accepted.values().any(Result::is_ok) {
            self.heard = now;
        }
        None
    }
}

/// Gives way to everybody else.
fn slow_down(group: i32) {
    if let Some(group) = rustix::process::Pid::from_raw(group) {
        // Whoever may not be slowed is stopped soon.
        let _ = rustix::process::setpriority_pgrp(Some(group), 19);
    }
}
