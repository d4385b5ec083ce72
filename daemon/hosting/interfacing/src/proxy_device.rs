//! Proxy agents: each represents an agent of another ecosystem, limited to the exported part of the
//! agent.
//!
//! A proxy agent is an actuator like any other in this ecosystem, with heartbeats, tokens and bids
//! of its own. A request to the proxy agent is passed to the real agent through the Plan Executor
//! of the real agent's ecosystem ([`RemoteClient`]). Each side has a conversation of its own. Only
//! a step in translated names passes to the far side, and only the outcome of the step passes back.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use acl::content::{Method, Methods, Outcome, Reason, Refusal, Report};
use acl::{EcosystemId, Millis, Performative};
use actuator::{
    BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult, OwnFact,
};
use agent::{AgentSnapshot, AgentWatch};
use pddl::{ActionModel, Domain, InitElement, Name, Problem};
use tokio::time::Instant;

use super::export::{self, EcosystemFiles, ExcludedAction, ExportedModel};
use super::rate_limiter::RateLimiter;
use super::remote_client::{RemoteClient, RemoteUpdate};
use super::translate::{self, Translator};
use super::vocabulary::{AgentMapping, InterfaceVocabulary};

/// Time that the proxy agent allows for an action in addition to the time limit of the real agent's
/// method. The margin covers discovery, agreement and confirmation, both by the far side's Plan
/// Executor and on this side.
const METHOD_MARGIN: Duration = Duration::from_secs(10);

/// Time that a request on the far side may take in addition to the time limit of the real agent's
/// method. The margin is shorter than `METHOD_MARGIN`, so that the proxy agent receives the reason
/// of a failure within its own time limit.
const REQUEST_MARGIN: Duration = Duration::from_secs(8);
const _: () = assert!(REQUEST_MARGIN.as_millis() < METHOD_MARGIN.as_millis());

/// Everything that a proxy agent needs of the rule for it and of the two ecosystems.
pub(super) struct ProxyContext {
    pub(super) mapping: AgentMapping,
    pub(super) performatives: BTreeSet<Performative>,
    /// Vocabulary of the interface: far name = near name.
    pub(super) vocabulary: InterfaceVocabulary,
    /// Name of the far ecosystem, where the real agent runs.
    pub(super) far: EcosystemId,
    pub(super) far_files: (Arc<Domain>, Arc<Problem>),
    pub(super) near_files: (Arc<Domain>, Arc<Problem>),
    /// Client that makes requests in the far ecosystem.
    pub(super) client: RemoteClient,
    /// Limit on the rate of messages to the far side; `near_limit` limits the rate of messages from
    /// it.
    pub(super) far_limit: Arc<RateLimiter>,
    pub(super) near_limit: Arc<RateLimiter>,
    pub(super) counters: Arc<InterfaceCounters>,
}

/// Numbers of requests and agents that an interface passed on or stopped in one direction, for the
/// operator.
#[derive(Debug, Default)]
pub struct InterfaceCounters {
    /// Number of requests that were passed on.
    pub passed: AtomicU64,
    /// Number of requests that were refused because of the rate limit.
    pub over_rate: AtomicU64,
    /// Number of requests that named a symbol that is not exported.
    pub unexported: AtomicU64,
    /// Number of times that an agent got no proxy agent, because the agent would have returned to
    /// an ecosystem on its route, or because its route was too long. Each new incarnation or model
    /// of the agent is counted again.
    pub looped_agents: AtomicU64,
    /// Number of goals that were refused because they come from a third ecosystem through a proxy
    /// agent.
    pub looped_goals: AtomicU64,
}

// === impl ProxyContext ===

impl ProxyContext {
    pub(super) fn passes(&self, performative: Performative) -> bool {
        self.performatives.contains(&performative)
    }

    /// Returns the proxy agent's model, made from the observed model of the real agent.
    ///
    /// # Errors
    ///
    /// Returns an error if no part of the agent can be represented.
    pub(super) fn export(&self, snapshot: &AgentSnapshot) -> Result<ExportedModel, String> {
        let endpoints = EcosystemFiles {
            far: (&self.far_files.0, &self.far_files.1),
            near: (&self.near_files.0, &self.near_files.1),
        };
        let AgentSnapshot { model, methods, .. } = snapshot;
        let mut exported =
            export::export(&self.vocabulary, &self.mapping, endpoints, model, methods)?;
        if !self.passes(Performative::Request) {
            exported.model.actions.clear();
        }
        Ok(exported)
    }

    fn translator<'t>(&'t self, model: &ActionModel) -> Translator<'t> {
        let far = (&*self.far_files.0, &*self.far_files.1);
        Translator::of_model(&self.vocabulary, &self.mapping, far, model)
    }

    /// Translates a step of the near side to the names of the far side. If that is not possible,
    /// returns a text that names what is not exported.
    fn to_far_step(&self, action: &str) -> Result<String, String> {
        let step = pddl::parse_step(action).into_result();
        let step = step.map_err(|_| "the action cannot be read".to_owned())?;
        let AgentMapping { agent, proxy: proxy_model, actions, .. } = &self.mapping;
        let actions: BTreeMap<String, Name> =
            actions.iter().map(|(far, near)| (near.as_str().to_owned(), Name::new(far))).collect();
        let vocabulary = self.vocabulary.reversed();
        translate::step(&step, &actions, (proxy_model, agent), &vocabulary)
            .map(|step| step.to_string())
    }
}

// === impl ProxyDevice ===

/// Device that lets an actuator act as a proxy agent: it passes actions to the real agent.
pub(super) struct ProxyDevice {
    context: Arc<ProxyContext>,
    watch: AgentWatch,
    snapshot: AgentSnapshot,
    exported: ExportedModel,
}

impl ProxyDevice {
    /// Returns a device for the real agent as it is observed now.
    pub(super) fn new(
        context: Arc<ProxyContext>,
        watch: AgentWatch,
        snapshot: AgentSnapshot,
        exported: ExportedModel,
    ) -> ProxyDevice {
        report_left_out(&context, &exported.excluded);
        ProxyDevice { context, watch, snapshot, exported }
    }

    /// Updates the model and state of the proxy agent from the latest observation of the real
    /// agent. If the real agent is gone, changes nothing, because `proxy_lifecycle` ends the proxy
    /// agent.
    fn update(&mut self) {
        let Some(snapshot) = self.watch.borrow_and_update().clone() else { return };
        if snapshot.digest != self.snapshot.digest {
            match self.context.export(&snapshot) {
                Ok(exported) => {
                    if exported.excluded != self.exported.excluded {
                        report_left_out(&self.context, &exported.excluded);
                    }
                    self.exported = exported;
                }
                Err(why) => {
                    let proxy_model = &self.context.mapping.proxy;
                    tracing::warn!(%proxy_model, why, "it offers nothing that can be expressed here");
                    self.exported.model.actions.clear();
                }
            }
        }
        self.snapshot = snapshot;
    }

    fn observed(&self, observations: &str) -> Vec<InitElement> {
        if !self.context.passes(Performative::Inform) {
            return Vec::new();
        }
        let translator = self.context.translator(&self.snapshot.model);
        let said = pddl::parse_init_elements(observations).value.unwrap_or_default();
        said.iter().filter_map(|fact| translator.fact(fact)).collect()
    }
}

fn report_left_out(context: &ProxyContext, left_out: &[ExcludedAction]) {
    for left_out in left_out {
        tracing::warn!(proxy_model = %context.mapping.proxy, "{left_out}");
    }
}

impl Device for ProxyDevice {
    type Yield = Report;

    fn describe(&self) -> Description {
        let method = |(name, timeout): (&String, &Duration)| {
            let method = Method {
                method: name.clone(),
                arguments: BTreeMap::new(),
                timeout: Millis(timeout.saturating_add(METHOD_MARGIN)),
            };
            (name.clone(), method)
        };
        let offered = |(name, _): &(&String, &Duration)| {
            self.exported.model.actions.iter().any(|action| action.name == name.as_str())
        };
        let methods: Methods = self.exported.timeouts.iter().filter(offered).map(method).collect();
        Description { model: self.exported.model.clone(), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        if !self.context.passes(Performative::Inform) {
            return self.exported.model.init.iter().cloned().map(OwnFact::from).collect();
        }
        let now = Instant::now();
        let translator = self.context.translator(&self.snapshot.model);
        // A heartbeat with the same facts is no news, but each of them may hold for longer now.
        let seen = self.watch.borrow();
        let is_same = |seen: &&AgentSnapshot| {
            seen.incarnation == self.snapshot.incarnation && seen.digest == self.snapshot.digest
        };
        let facts = seen.as_ref().filter(is_same).map_or(&self.snapshot.facts, |seen| &seen.facts);
        let current = facts.iter().filter_map(|(fact, until)| {
            let known_for = until.map(|until| until.saturating_duration_since(now));
            let is_over = known_for.is_some_and(|left| left.is_zero());
            let fact = translator.fact(fact).filter(|_| !is_over)?;
            Some(OwnFact { fact, known_for })
        });
        // A heartbeat is complete: each fact that a heartbeat omits is false.
        current.chain(self.exported.constant_facts.iter().cloned().map(OwnFact::from)).collect()
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        let ProxyContext { counters, far_limit: outward, .. } = &*self.context;
        if let Err(why) = self.context.to_far_step(&call.action) {
            counters.unexported.fetch_add(1, Ordering::Relaxed);
            return Some(Refusal::new(Reason::Incapable, why));
        }
        if outward.try_acquire() {
            return None;
        }
        let count = counters.over_rate.fetch_add(1, Ordering::Relaxed) + 1;
        tracing::warn!(proxy_model = %self.context.mapping.proxy, count, "too many messages");
        let detail = format!(
            "{} messages a second may pass to `{}`, and that limit is reached; ask again later",
            outward.per_second(),
            self.context.far
        );
        Some(Refusal::new(Reason::Busy, detail))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<Report, MethodFailure>> {
        let context = Arc::clone(&self.context);
        let step = match context.to_far_step(&call.action) {
            Ok(step) => step,
            Err(why) => return Box::pin(std::future::ready(Err(MethodFailure::Driver(why)))),
        };
        let timeout = self.exported.timeouts.get(&call.method).copied().unwrap_or_default();
        let within = timeout.saturating_add(REQUEST_MARGIN);
        Box::pin(async move {
            context.counters.passed.fetch_add(1, Ordering::Relaxed);
            let revocable = context.passes(Performative::Cancel);
            let mut asked = context.client.request_action(step, revocable, within).await;
            loop {
                let news = asked.next().await;
                if news.is_final() {
                    return method_result(&context, news);
                }
            }
        })
    }

    fn on_success(&mut self, _call: &MethodCall, report: Report) -> MethodResult {
        self.update();
        let detail = format!("done by `{}`", self.context.far);
        MethodResult { detail, observations: self.observed(&report.observations) }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<ProxyDevice>>> {
        let mut watch = self.watch.clone();
        let inward = Arc::clone(&self.context.near_limit);
        Some(Box::pin(async move {
            if watch.changed().await.is_err() {
                // The observer has ended, and the proxy agent ends too.
                return std::future::pending().await;
            }
            // An observation that is replaced during this wait is never announced.
            inward.acquire().await;
            let stir: DeviceEvent<ProxyDevice> = Box::new(|proxy_model| {
                proxy_model.update();
                Vec::new()
            });
            stir
        }))
    }

    fn makes_bids(&self) -> bool {
        self.context.passes(Performative::Cfp)
    }
}

/// Converts the last report on a far request to the result of the action. The texts of the other
/// ecosystem are left out.
fn method_result(context: &ProxyContext, news: RemoteUpdate) -> Result<Report, MethodFailure> {
    let far = &context.far;
    let reason = news.reason();
    match news {
        RemoteUpdate::Report(report) if report.outcome == Outcome::Done => Ok(report),
        RemoteUpdate::Report(report) if report.outcome == Outcome::Cancelled => {
            Err(MethodFailure::Driver(format!("go on: `{far}` has given it up")))
        }
        RemoteUpdate::Report(_) => Err(MethodFailure::Driver(format!("have it done by `{far}`"))),
        RemoteUpdate::Refused(_) => {
            let why = reason.map(|reason| format!(" ({reason:?})")).unwrap_or_default();
            Err(MethodFailure::Driver(format!("have it done by `{far}`, which declined{why}")))
        }
        RemoteUpdate::Unanswered => {
            Err(MethodFailure::Driver(format!("hear from `{far}` in time")))
        }
        RemoteUpdate::DeadlinePassed(within) => Err(MethodFailure::TimedOut(within)),
    }
}
