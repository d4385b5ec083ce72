//! Proxy agent for an agent of a plugin. In the ecosystem the proxy agent is an actuator like any
//! other, with its own planner and domain, its own ledger and heartbeats. It forwards its actions
//! to the plugin.
//!
//! While the plugin's process is absent, the proxy agent offers no actions, and a running action
//! fails at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use acl::content::Report;
use acl::{AgentId, Incarnation, Millis};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact,
};
use agent::{AgentSnapshot, AgentWatch, Blueprint, Spawner};
use pddl::ActionModel;
use serde_json::Value;
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::package::Package;
use crate::plugin_client::PluginClientHandle;

/// How long a proxy agent stays in the ecosystem, without actions, while the plugin's process is
/// absent. The agent stays because most absences are short: a plugin that has ended is restarted.
const ABSENCE_MAX: Duration = Duration::from_secs(5);

/// Pause before another attempt to run a proxy agent that could not run in the ecosystem. A reason
/// for such a failure is that another agent has the same name.
const RETRY_WAIT: Duration = Duration::from_secs(5);

/// Timeout of a call if the plugin's agent describes no method for the action.
const UNSAID: Duration = Duration::from_secs(60);

/// Agents that have joined the endpoint of a plugin, by name. The value is `Ok` for an agent that
/// is accepted as it describes itself, and otherwise the reason why it is not accepted.
pub(crate) type AcceptedAgents =
    watch::Sender<std::collections::BTreeMap<AgentId, Result<(), String>>>;

/// Task that runs the proxy agent for one agent of a plugin while the plugin brings that agent.
pub(crate) struct ProxyRunner {
    pub(crate) agent: AgentId,
    pub(crate) watch: AgentWatch,
    pub(crate) client: PluginClientHandle,
    pub(crate) package: Arc<Package>,
    /// Action model of the agent, as the package contains it; `None` if the package contains none.
    pub(crate) own: Option<Arc<ActionModel>>,
    pub(crate) spawner: Spawner,
    pub(crate) accepted: Arc<AcceptedAgents>,
    pub(crate) stopping: CancellationToken,
}

impl ProxyRunner {
    /// Runs the proxy agent whenever the plugin's agent is present and accepted. Returns when the
    /// endpoint is closed.
    pub(crate) async fn run(mut self) {
        let stopping = self.stopping.clone();
        loop {
            let snapshot = tokio::select! {
                biased;
                () = stopping.cancelled() => return self.note(None),
                snapshot = appeared(&mut self.watch) => match snapshot {
                    Some(snapshot) => snapshot,
                    None => return self.note(None),
                },
            };
            let seen = (snapshot.incarnation, snapshot.digest.clone());
            if let Some(objection) = self.objection(&snapshot) {
                tracing::warn!(agent = %self.agent, plugin = self.package.manifest.name,
                    "is rejected: {objection}");
                self.note(Some(Err(objection)));
                tokio::select! {
                    biased;
                    () = stopping.cancelled() => (),
                    () = wait_until_changed(&mut self.watch, seen) => (),
                }
                self.note(None);
                continue;
            }
            if let Err(problem) = self.run_incarnation(snapshot).await {
                self.note(Some(Err(problem)));
                tokio::select! {
                    biased;
                    () = stopping.cancelled() => (),
                    () = tokio::time::sleep(RETRY_WAIT) => (),
                }
            }
        }
    }

    fn note(&self, said: Option<Result<(), String>>) {
        let agent = self.agent.clone();
        self.accepted.send_if_modified(|accepted| match said {
            Some(said) => accepted.insert(agent, said.clone()) != Some(said),
            None => accepted.remove(&agent).is_some(),
        });
    }

    fn objection(&self, snapshot: &AgentSnapshot) -> Option<String> {
        objection(&self.agent, &self.package, self.own.as_deref(), snapshot)
    }

    /// Runs one incarnation of the proxy agent. Returns an error, as text for a person, if the
    /// proxy agent could not run.
    async fn run_incarnation(&mut self, snapshot: AgentSnapshot) -> Result<(), String> {
        let device = PluginProxy {
            agent: self.agent.clone(),
            package: Arc::clone(&self.package),
            own: self.own.clone(),
            watch: self.watch.clone(),
            snapshot: Some(snapshot.clone()),
            last: snapshot,
            client: self.client.clone(),
        };
        let blueprint = Blueprint {
            id: self.agent.clone(),
            driver: String::new(),
            config: Arc::new(Value::Null),
            host: Arc::clone(&self.spawner.host),
        };
        let actuator = Actuator::build(&blueprint, device).map_err(|error| error.to_string())?;
        let stopping = self.stopping.child_token();
        let mut task =
            actuator.launch(self.spawner.launch_context(&self.agent, Vec::new(), &stopping));
        self.note(Some(Ok(())));
        let ended = loop {
            tokio::select! {
                biased;
                ended = &mut task => break ended,
                () = wait_until_absent(&mut self.watch) => {
                    self.note(None);
                    if tokio::time::timeout(ABSENCE_MAX, appeared(&mut self.watch)).await.is_ok() {
                        // An agent that returned with another action model is reported, and offers
                        // no actions.
                        self.note(Some(self.refused().map_or(Ok(()), Err)));
                        continue;
                    }
                    stopping.cancel();
                    let _ = task.await;
                    return Ok(());
                }
            }
        };
        match ended {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(format!("failed to {error}")),
            Err(_) => Err("the agent has panicked".to_owned()),
        }
    }

    fn refused(&self) -> Option<String> {
        let snapshot = self.watch.borrow().clone()?;
        self.objection(&snapshot)
    }
}

/// Returns the reason why the plugin's agent is not accepted as `snapshot` describes it; `None` if
/// it is accepted.
fn objection(
    agent: &AgentId,
    package: &Package,
    own: Option<&ActionModel>,
    snapshot: &AgentSnapshot,
) -> Option<String> {
    if snapshot.model.agent != agent.as_str() {
        return Some(format!("it describes itself as `{}`", snapshot.model.agent));
    }
    package.objection(&snapshot.model, &snapshot.methods, own)
}

/// Waits until the plugin's agent is present, and returns its snapshot; `None` if the observer of
/// the plugin's agents has ended.
async fn appeared(watch: &mut AgentWatch) -> Option<AgentSnapshot> {
    watch.wait_for(Option::is_some).await.ok()?.clone()
}

async fn wait_until_absent(watch: &mut AgentWatch) {
    // If the observer has ended, the agent counts as absent.
    let _ = watch.wait_for(Option::is_none).await;
}

/// Waits until the plugin's agent is absent, or is present with another incarnation or another
/// digest than the given ones.
async fn wait_until_changed(watch: &mut AgentWatch, (incarnation, digest): (Incarnation, String)) {
    let is_other = |snapshot: &Option<AgentSnapshot>| {
        snapshot.as_ref().is_none_or(|it| it.incarnation != incarnation || it.digest != digest)
    };
    let _ = watch.wait_for(is_other).await;
}

/// Device of the proxy agent's actuator, which forwards each action to the plugin.
struct PluginProxy {
    agent: AgentId,
    package: Arc<Package>,
    own: Option<Arc<ActionModel>>,
    watch: AgentWatch,
    /// Snapshot of the plugin's agent; `None` while the agent is absent or not accepted.
    snapshot: Option<AgentSnapshot>,
    /// Latest snapshot with which the plugin's agent was accepted: its action model, methods and
    /// facts. While `snapshot` is `None`, the proxy agent has no actions, and the facts of the
    /// model in `last`.
    last: AgentSnapshot,
    client: PluginClientHandle,
}

impl PluginProxy {
    /// Takes over the present snapshot of the plugin's agent, if the agent is accepted with it.
    fn update_snapshot(&mut self) {
        let now = self.watch.borrow_and_update().clone();
        let may = |snapshot: &AgentSnapshot| {
            snapshot.digest == self.last.digest
                || objection(&self.agent, &self.package, self.own.as_deref(), snapshot).is_none()
        };
        self.snapshot = now.filter(may);
        if let Some(snapshot) = &self.snapshot {
            self.last = snapshot.clone();
        }
    }

    fn timeout(&self, call: &MethodCall) -> Duration {
        let action = call.action.trim_start_matches('(').split_whitespace().next();
        let method = action.and_then(|action| self.last.methods.get(&action.to_lowercase()));
        method.map_or(UNSAID, |method| method.timeout.0)
    }
}

/// Counter for the actions that are forwarded to plugins; each number is unique in this process.
static ASKED: AtomicU64 = AtomicU64::new(0);

impl Device for PluginProxy {
    type Yield = Report;

    fn describe(&self) -> Description {
        let mut model = ActionModel::clone(&self.last.model);
        let mut methods = self.last.methods.clone();
        // The timeout of a method is at most the timeout in the manifest.
        for (action, method) in &mut methods {
            if let Some(known) = self.package.manifest.methods.get(action) {
                method.timeout = Millis(method.timeout.0.min(known.timeout.0));
            }
        }
        if self.snapshot.is_none() {
            model.actions.clear();
            methods.clear();
        }
        Description { model, methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let Some(snapshot) = &self.snapshot else {
            return self.last.model.init.iter().cloned().map(OwnFact::from).collect();
        };
        let now = Instant::now();
        let current = snapshot.facts.iter().filter_map(|(fact, until)| {
            let known_for = until.map(|until| until.saturating_duration_since(now));
            let is_over = known_for.is_some_and(|left| left.is_zero());
            (!is_over).then(|| OwnFact { fact: fact.clone(), known_for })
        });
        current.collect()
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<Report, MethodFailure>> {
        let (bell, to, call) = (self.client.clone(), self.agent.clone(), call.clone());
        let timeout = self.timeout(&call);
        let mut watch = self.watch.clone();
        let incarnation = self.last.incarnation;
        let number = ASKED.fetch_add(1, Ordering::Relaxed);
        Box::pin(async move {
            let is_gone = |snapshot: &Option<AgentSnapshot>| {
                snapshot.as_ref().is_none_or(|snapshot| snapshot.incarnation != incarnation)
            };
            tokio::select! {
                biased;
                outcome = bell.act(to, call, timeout, number) => outcome,
                _ = watch.wait_for(is_gone) => {
                    Err(MethodFailure::Driver("act: its plugin has ended meanwhile".to_owned()))
                }
            }
        })
    }

    fn on_success(&mut self, _call: &MethodCall, report: Report) -> MethodResult {
        self.update_snapshot();
        let observed = pddl::parse_init_elements(&report.observations);
        MethodResult { detail: report.detail, observations: observed.value.unwrap_or_default() }
    }

    fn on_failure(&mut self, _call: &MethodCall, _failure: &MethodFailure) {
        self.update_snapshot();
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<PluginProxy>>> {
        let mut watch = self.watch.clone();
        Some(Box::pin(async move {
            if watch.changed().await.is_err() {
                // The observer has ended; the proxy agent will end together with its plugin.
                return std::future::pending().await;
            }
            let stir: DeviceEvent<PluginProxy> = Box::new(|proxy| {
                proxy.update_snapshot();
                Vec::new()
            });
            stir
        }))
    }
}
