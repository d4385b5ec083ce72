//! Lifecycle of a proxy agent: it exists while the real agent is present, and leaves when the real
//! agent leaves.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use acl::{EcosystemId, Incarnation};
use actuator::Actuator;
use agent::{AgentSnapshot, AgentWatch, Blueprint, Spawner};
use serde_json::Value;

use super::proxy_device::{ProxyContext, ProxyDevice};

/// Maximum number of ecosystems on an agent's route. The route is the list of the ecosystems
/// through which the agent is represented, one after the other. An agent with a longer route gets
/// no proxy agent, because such routes are hard to oversee for the people of an ecosystem.
const VIA_MAX: usize = 3;

/// Pause before a proxy agent that ended by itself is started again. A proxy agent ends by itself
/// if its name is taken.
const RESTART_DELAY: Duration = Duration::from_secs(5);

/// Keeps the proxy agent of one real agent running for as long as the real agent is present, until
/// the daemon shuts down.
pub(super) async fn run_proxy(context: Arc<ProxyContext>, mut watch: AgentWatch, near: Spawner) {
    let stopping = near.stopping.clone();
    loop {
        let snapshot = tokio::select! {
            biased;
            () = stopping.cancelled() => return,
            snapshot = wait_until_present(&mut watch) => match snapshot {
                Some(snapshot) => snapshot,
                None => return,
            },
        };
        let seen = (snapshot.incarnation, snapshot.digest.clone());
        let Some(via) = route(&context, &snapshot, near.router.ecosystem()) else {
            context.counters.looped_agents.fetch_add(1, Ordering::Relaxed);
            wait_until_changed(&mut watch, seen).await;
            continue;
        };
        let exported = match context.export(&snapshot) {
            Ok(exported) => exported,
            Err(why) => {
                tracing::warn!(agent = %context.mapping.agent, why, "it gets no proxy agent");
                wait_until_changed(&mut watch, seen).await;
                continue;
            }
        };
        let incarnation = snapshot.incarnation;
        let device = ProxyDevice::new(Arc::clone(&context), watch.clone(), snapshot, exported);
        if !run_incarnation(&context, device, via, incarnation, &mut watch, &near).await {
            tokio::select! {
                biased;
                () = stopping.cancelled() => return,
                () = tokio::time::sleep(RESTART_DELAY) => (),
            }
        }
    }
}

/// Runs one incarnation of a proxy agent. Returns `true` if it ended because the real agent left.
async fn run_incarnation(
    context: &ProxyContext,
    device: ProxyDevice,
    via: Vec<EcosystemId>,
    incarnation: Incarnation,
    watch: &mut AgentWatch,
    near: &Spawner,
) -> bool {
    let id = &context.mapping.proxy;
    let blueprint = Blueprint {
        id: id.clone(),
        driver: String::new(),
        config: Arc::new(Value::Null),
        host: Arc::clone(&near.host),
    };
    let agent = match Actuator::build(&blueprint, device) {
        Ok(agent) => agent,
        Err(error) => {
            tracing::error!(%id, "failed to {error}");
            return false;
        }
    };
    let stopping = near.stopping.child_token();
    let mut task = agent.launch(near.launch_context(id, via, &stopping));
    tracing::info!(%id, of = %context.mapping.agent, far = %context.far, "has a proxy agent");
    let ended = tokio::select! {
        biased;
        ended = &mut task => ended,
        () = wait_until_gone(watch, incarnation) => {
            tracing::info!(%id, of = %context.mapping.agent, far = %context.far, "has left");
            // The proxy agent cancels its request, withdraws its presence, and ends.
            stopping.cancel();
            let _ = task.await;
            return true;
        }
    };
    match ended {
        Ok(Ok(())) => (),
        Ok(Err(error)) => tracing::error!(%id, "failed to {error}"),
        // The panic itself has been printed on stderr, with its place.
        Err(error) => tracing::error!(%id, %error, "the proxy agent broke off"),
    }
    false
}

/// Returns the route by which a real agent reaches this ecosystem. Returns `None` if the agent must
/// not be represented here, because the route contains this ecosystem or is too long.
fn route(
    context: &ProxyContext,
    snapshot: &AgentSnapshot,
    near: &EcosystemId,
) -> Option<Vec<EcosystemId>> {
    let mut via = snapshot.via.clone();
    via.push(context.far.clone());
    let agent = &context.mapping.agent;
    if via.contains(near) {
        tracing::warn!(%agent, ?via, "comes from here itself: it gets no proxy agent");
        return None;
    }
    if via.len() > VIA_MAX {
        tracing::warn!(%agent, ?via, "came through too many ecosystems: it gets no proxy agent");
        return None;
    }
    Some(via)
}

/// Waits until the real agent is present, and returns its observed state. Returns `None` if the
/// observer has ended.
async fn wait_until_present(watch: &mut AgentWatch) -> Option<AgentSnapshot> {
    watch.wait_for(Option::is_some).await.ok()?.clone()
}

/// Waits until the real agent is gone or has another incarnation.
async fn wait_until_gone(watch: &mut AgentWatch, incarnation: Incarnation) {
    let is_gone = |snapshot: &Option<AgentSnapshot>| {
        snapshot.as_ref().is_none_or(|it| it.incarnation != incarnation)
    };
    // An observer that has ended counts as a missing agent.
    let _ = watch.wait_for(is_gone).await;
}

/// Waits until the real agent has another incarnation or another model, or is gone. Used if the
/// agent cannot be represented with its present model.
async fn wait_until_changed(watch: &mut AgentWatch, (incarnation, digest): (Incarnation, String)) {
    let is_other = |snapshot: &Option<AgentSnapshot>| {
        snapshot.as_ref().is_none_or(|it| it.incarnation != incarnation || it.digest != digest)
    };
    let _ = watch.wait_for(is_other).await;
}
