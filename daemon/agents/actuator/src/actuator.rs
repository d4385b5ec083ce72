//! The actuator: the agent that drives a device.

mod committing;
mod event_pacing;
mod hardware_stops;
mod joint_acting;
mod open_initiatives;
mod private_steps;
mod safeguarding;
mod stopping;

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use acl::content::{
    Act, ActionToken, Agreement, CallForProposals, CancelAction, Heartbeat, Inform, Method,
    ModelAnnouncement, Outcome, Reason, Refusal, Report, Request,
};
use acl::{AgentId, Message, Millis, Performative, ReplyToken};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, Host, LaunchableAgent, Participation,
    Presence, Resource, StateFolder, StopButtons, StopRegistry, TimerId, WorkHandle,
};
use capability::{CompositionCache, DomainSnapshot, model_digest, text_of};
use planner::{Cancel, Replanner};
use substrate::BoxFuture;
use tokio::sync::oneshot;

use crate::actuator::joint_acting::JointProgress;
use crate::actuator::open_initiatives::OpenInitiatives;
use crate::actuator::private_steps::PrivateProgress;
use crate::actuator::stopping::StandingStill;
use crate::commitment::Commitment;
use crate::confidentiality::Confidentiality;
use crate::device::{Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact};
use crate::erased_device::{ErasedDevice, ErasedYield};
use crate::ledger::{Ledger, TokenState};
use crate::private_planning::{DeclinedCall, answer};
use crate::safeguards::{SafeguardedActions, Safeguards};

/// Maximum number of calls for proposals that are answered side by side; further calls are refused.
/// Each answer uses a thread for some milliseconds.
const BIDS_MAX: usize = 16;

/// How long an actuator keeps the ground task of its planner after the last call for proposals. If
/// a goal fails, the next call comes within seconds. The ground tasks of a hundred devices take
/// tens of megabytes, so they are not kept for ever.
const CACHE_TTL: Duration = Duration::from_secs(60);

/// An agent that drives a device: a sensor, or a device that acts.
pub struct Actuator {
    pub(crate) device: Box<dyn ErasedDevice>,
    pub(crate) initiatives: OpenInitiatives,
    host: Arc<Host>,
    /// The stops of this daemon, which its actuators share.
    stops: Arc<StopRegistry>,
    /// The hardware stops of the ecosystem; `None` if it has none.
    buttons: Option<Arc<StopButtons>>,
    ledger: Ledger,
    announced: AnnouncedModel,
    running_command: Option<RunningCommand>,
    /// Pending writes of final reports to disk, by token. Each report is sent when its write has
    /// ended.
    pending_reports: BTreeMap<ActionToken, WorkHandle>,
    running_bids: BTreeMap<ReplyToken, (Cancel, WorkHandle)>,
    /// What the actuator keeps to itself; `None` if agents keep nothing from each other.
    confidentiality: Option<Confidentiality>,
    /// The agent's commitment to a joint plan. While there is one, the agent acts for the goal of that
    /// plan only.
    commitment: Option<Commitment>,
    /// Data that the actuator's own planner keeps, used by one bid at a time. A second bid at the
    /// same time starts with an empty planner instead of waiting.
    bid_cache: Arc<Mutex<BidCache>>,
    /// The last action that a stop has ended, with the identifier of the stop.
    ended_by_stop: Option<(String, String)>,
    /// The actions that people have to allow, or that are limited in their rate.
    safeguarded: SafeguardedActions,
    /// Takes the answer of people to whether the running action may begin; `None` if no action waits
    /// for it.
    consent: Option<oneshot::Sender<Result<(), MethodFailure>>>,
    /// The standstill to which the last stop has brought the device; `None` if there was none.
    standing_still: Option<StandingStill>,
    /// Work that waits for the next change of the daemon's stops.
    following_stops: Option<WorkHandle>,
    /// Timer of the announcement of what the agent offers under its stops.
    announcement: Option<TimerId>,
    /// Confirmations of stops and releases that wait until these are on disk.
    confirming_stops: VecDeque<WorkHandle>,
    /// Timer that drops the composite domain and the ground task that are kept for the next bid.
    cache_expiry: Option<TimerId>,
}

/// Data that the planner keeps from one bid for the next.
#[derive(Default)]
struct BidCache {
    composition: CompositionCache,
    replanner: Replanner,
}

/// Content of the actuator's last announcement.
#[derive(Default)]
struct AnnouncedModel {
    /// What was announced; `None` before the first announcement.
    description: Option<Description>,
    digest: String,
    /// The facts of the last heartbeat; empty unless the actuator keeps something from others.
    told_facts: Vec<OwnFact>,
    /// The announced actions that have a method.
    offered: Box<[AnnouncedAction]>,
    sequence: u64,
}

/// An announced action.
struct AnnouncedAction {
    name: String,
    method: Method,
    /// Number of agents that act in it. They are the first arguments.
    agents: usize,
}

/// What an actuator announced of an action that is asked for.
struct Admission {
    /// Time limit of the method that carries the action out.
    timeout: Duration,
    /// The other agents of a joint action.
    partners: Vec<AgentId>,
}

/// How long a running action waits for a new requester after the former one has stood down. A new
/// leader sends its request within milliseconds, or as soon as a lost message is repeated.
const ORPHAN_TIMEOUT: Duration = Duration::from_secs(2);

/// Maximum number of requesters of one command: the Plan Executor that asked first, and the
/// replicas that took over from it. If there are more, the oldest gets no report.
const SUBSCRIBERS_MAX: usize = 8;

/// An action that the actuator is carrying out.
struct RunningCommand {
    token: ActionToken,
    /// The action, as it was requested.
    action: String,
    /// Exchanges in which the action was requested, the latest last.
    subscribers: Vec<Participation>,
    /// The call of the method that runs, or that waits for people; `None` between two of them.
    call: Option<MethodCall>,
    /// How far an action with private steps is; `None` for any other action.
    private: Option<PrivateProgress>,
    /// How far the actuator is with its part of a joint action; `None` for any other action.
    joint: Option<JointProgress>,
    _work: WorkHandle,
}

/// Runs `write` on a thread that may block. Returns a future that ends when the write has ended;
/// its failure says that `what` is not on disk.
fn on_disk(
    what: &'static str,
    write: impl FnOnce() -> io::Result<()> + Send + 'static,
    ctx: &Context<Actuator>,
) -> BoxFuture<Result<(), MethodFailure>> {
    let (written, counters) = (ctx.run_blocking(write), ctx.failure_counters());
    Box::pin(async move {
        let written = written.await.map_err(|error| MethodFailure::Driver(error.to_string()))?;
        written.map_err(|error| {
            counters.count_not_persisted();
            MethodFailure::Driver(format!("keep {what} on disk: {error}"))
        })
    })
}

impl Actuator {
    /// Builds an actuator for `device`. The actuator uses the domain that all actuators of its host
    /// share.
    ///
    /// # Errors
    ///
    /// Returns an error if the ledger of earlier incarnations cannot be read.
    pub fn build(
        blueprint: &Blueprint,
        device: impl Device,
    ) -> Result<Box<dyn LaunchableAgent>, BuildError> {
        Ok(Actuator::new(blueprint, Box::new(device))?.into_launchable())
    }

    /// Converts the actuator to an agent of any type. The function is not inlined: the code of an
    /// agent would otherwise be compiled again in each crate that builds an actuator.
    #[inline(never)]
    fn into_launchable(self) -> Box<dyn LaunchableAgent> {
        Box::new(self)
    }

    fn new(blueprint: &Blueprint, device: Box<dyn ErasedDevice>) -> Result<Actuator, BuildError> {
        let host = Arc::clone(&blueprint.host);
        let folder = host.resources.get::<StateFolder>();
        let ledger = Ledger::open(&blueprint.id, folder.as_deref(), host.settings.tokens_max)
            .map_err(|error| blueprint.problem(format!("its tokens cannot be read: {error}")))?;
        let safeguards = host.resources.get::<Safeguards>();
        let safeguarded =
            SafeguardedActions::of(safeguards.as_deref(), &blueprint.id, folder.as_deref());
        let actions = device.action_names();
        let mut names = safeguarded.check_names(&actions);
        let confidentiality = Confidentiality::of(&host);
        if let Some(confidentiality) = &confidentiality {
            let described = device.describe();
            let checked = confidentiality.check(&described.model);
            checked.map_err(|problem| blueprint.problem(problem))?;
            let private = confidentiality.private_actions(&described);
            names = names.and_then(|()| safeguarded.check_none_of(&private));
        }
        let agent = blueprint.id.clone();
        names.map_err(|problem| BuildError::Safeguards { agent, problem })?;
        Ok(Actuator {
            stops: host.stops(),
            buttons: host.resources.get::<StopButtons>(),
            device,
            initiatives: OpenInitiatives::default(),
            host,
            ledger,
            announced: AnnouncedModel::default(),
            running_command: None,
            pending_reports: BTreeMap::new(),
            running_bids: BTreeMap::new(),
            confidentiality,
            commitment: None,
            bid_cache: Arc::default(),
            ended_by_stop: None,
            safeguarded,
            consent: None,
            standing_still: None,
            following_stops: None,
            announcement: None,
            confirming_stops: VecDeque::new(),
            cache_expiry: None,
        })
    }
}

impl Agent for Actuator {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
            .on(Performative::Cfp, Self::called)
            .on(Performative::AcceptProposal, Self::judged)
            .on(Performative::RejectProposal, Self::judged)
            .on(Performative::Refuse, Self::declined)
            .on(Performative::NotUnderstood, Self::declined)
            .on_broadcast(Performative::Cfp, Self::called)
            .on_broadcast(Performative::RejectProposal, Self::judged)
    }

    fn model(&self) -> Option<String> {
        Some(self.offer().model.to_string())
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        // Subscribes to the shared domain before the first announcement, so that the announcement
        // is part of it.
        ctx.shared_domain(&self.host);
        self.safeguarded.resume(ctx.wall_clock(), ctx.now());
        self.follow_stops(ctx);
        match self.device.read_state() {
            Some(looking) => {
                let looked =
                    ctx.run(looking, |actuator: &mut Self, (), ctx| actuator.start_announcing(ctx));
                self.looks(looked);
            }
            None => self.start_announcing(ctx),
        }
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        self.plan_requester_joined(presence, ctx);
        self.partner_left(presence, ctx);
    }

    fn wants_presence(&self) -> bool {
        self.has_wanted_goals() || self.has_partners()
    }

    fn answer_query(&mut self, resource: Resource, ctx: &mut Context<Self>) -> Option<String> {
        match resource {
            Resource::Domain => {
                let local = self.local_domain(ctx)(&mut CompositionCache::default());
                serde_json::to_string(&local.to_content()).ok()
            }
            Resource::Stops => serde_json::to_string(&self.stop_state(ctx.id())).ok(),
            _ => None,
        }
    }

    fn drain(&mut self, ctx: &mut Context<Self>) -> bool {
        self.cancel_command("the daemon is stopping", ctx);
        self.withdraw_all(ctx);
        self.pending_reports.is_empty()
    }
}

impl Actuator {
    /// Returns a function that computes the local domain, which contains everything public, and in
    /// full the actions of this agent and of the agents that it carries. The domain is computed
    /// only when it is needed, because the computation takes a millisecond.
    fn local_domain(
        &self,
        ctx: &Context<Self>,
    ) -> impl FnOnce(&mut CompositionCache) -> DomainSnapshot + Send + 'static {
        let shared_domain = ctx.shared_domain(&self.host);
        let (known, _) = shared_domain.current();
        let whole = known.with_carried(ctx.id());
        // The domain is read again when the computation starts. A reference that is held until then
        // would force a copy at the next message.
        move |composition| {
            let (known, now) = shared_domain.current();
            known.snapshot_again(composition, &whole, now)
        }
    }

    // === announcing ===

    fn start_announcing(&mut self, ctx: &mut Context<Self>) {
        self.announce(ctx);
        self.schedule_heartbeat(ctx);
        self.watch_events(ctx);
    }

    /// Broadcasts the full action model: on activation, and whenever the model has changed.
    fn announce(&mut self, ctx: &mut Context<Self>) {
        let description = self.offer();
        self.announced.description = Some(description.clone());
        let Description { model, methods } = description;
        let text = model.to_string();
        self.announced.digest = model_digest(&text, &methods);
        let announced = model.actions.iter().filter_map(|action| {
            let (name, method) = methods.get_key_value(action.name.as_str())?;
            let agents = action.agents().count();
            Some(AnnouncedAction { name: name.clone(), method: method.clone(), agents })
        });
        self.announced.offered = announced.collect();
        let heartbeat = self.heartbeat(ctx);
        let announcement = ModelAnnouncement { model: text, methods, heartbeat };
        ctx.broadcast_state(&Inform::Model(Box::new(announcement)));
    }

    /// Broadcasts a heartbeat; if the action model has changed, announces the full model instead.
    pub(crate) fn send_heartbeat(&mut self, ctx: &mut Context<Self>) {
        if let Some(heartbeat) = self.heartbeat_or_announce(ctx) {
            ctx.broadcast_state(&Inform::Heartbeat(heartbeat));
        }
    }

    /// Builds the next heartbeat. If the action model has changed since the last announcement,
    /// announces the full model instead and returns `None`.
    fn heartbeat_or_announce(&mut self, ctx: &mut Context<Self>) -> Option<Heartbeat> {
        if self.announce_changed_model(ctx) {
            return None;
        }
        Some(self.heartbeat(ctx))
    }

    /// Announces the model if it has changed since the last announcement. Returns whether it has.
    fn announce_changed_model(&mut self, ctx: &mut Context<Self>) -> bool {
        // Comparing the descriptions is much faster than writing the model as text and hashing it.
        let has_changed = self.announced.description.as_ref() != Some(&self.offer());
        if has_changed {
            self.announce(ctx);
        }
        has_changed
    }

    fn schedule_heartbeat(&mut self, ctx: &mut Context<Self>) {
        // All actuators of a daemon send at the same time: their heartbeats travel in one batch,
        // and each receiver wakes once.
        let period = ctx.settings().heartbeat_period;
        let wait = ctx.shared_domain(&self.host).until_next_heartbeat(period);
        ctx.after(wait, |actuator: &mut Self, ctx| {
            if let Some(heartbeat) = actuator.heartbeat_or_announce(ctx) {
                ctx.batch_heartbeat(heartbeat);
            }
            actuator.schedule_heartbeat(ctx);
        });
    }

    fn heartbeat(&mut self, ctx: &Context<Self>) -> Heartbeat {
        self.apply_buttons(ctx);
        self.announced.sequence += 1;
        let facts = self.announced_facts(ctx);
        if self.confidentiality.is_some() {
            self.announced.told_facts.clone_from(&facts);
        }
        let (lasting, passing): (Vec<_>, Vec<_>) =
            facts.into_iter().partition(|fact| fact.known_for.is_none());
        let lasting = lasting.into_iter().map(|fact| fact.fact);
        let lasting: Vec<_> = lasting.chain(self.stop_fact(ctx.id())).collect();
        let known_for = passing
            .into_iter()
            .filter_map(|fact| Some((fact.fact.to_string(), Millis(fact.known_for?))))
            .collect();
        Heartbeat {
            digest: self.announced.digest.clone(),
            sequence: self.announced.sequence,
            facts: text_of(&lasting),
            known_for,
            period: Millis(ctx.settings().heartbeat_period),
            stops: self.stops.in_force(),
        }
    }

    // === acting ===

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        match message.content_as::<Request>() {
            Ok(Request::Act(act)) => {
                if let Err(refusal) = self.begin(&participation, *act, ctx) {
                    ctx.answer(&participation, Performative::Refuse, &refusal);
                }
            }
            Ok(Request::Stop(stop)) => self.stop_requested(&participation, &stop, ctx),
            Ok(Request::ReleaseStops(release)) => {
                self.release_requested(&participation, &release, ctx);
            }
            Ok(_) => {
                let detail = "an actuator takes `act`; ask the Plan Requester for goals";
                ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => ctx.not_understood(&message, error.to_string()),
        }
    }

    fn begin(
        &mut self,
        participation: &Participation,
        act: Act,
        ctx: &mut Context<Self>,
    ) -> Result<(), Refusal> {
        if self.answer_if_known(participation, &act, ctx)? {
            return Ok(());
        }
        let Act { action, method, arguments, token, ready_for } = act;
        if self.confidentiality.is_some() {
            // What may be told of the device is decided by its present model.
            self.announce_changed_model(ctx);
        }
        if let Some(stop) = self.stop_against(&action, ctx.id()) {
            return Err(stopping::refusal(&action, &stop));
        }
        let objection = self.standstill_objection(&action);
        if let Some(refusal) = objection.or_else(|| self.rate_objection(&action)) {
            return Err(refusal);
        }
        let Admission { timeout, partners } = self.admissible(&action, &method, ctx.id())?;
        if let Some(refusal) = self.commitment_objection(&token.conversation) {
            return Err(refusal);
        }
        if let Some(running) = &self.running_command {
            let detail = format!("{} is under way", running.action);
            return Err(Refusal::new(Reason::Busy, detail));
        }
        if self.private_model().is_some() {
            self.begin_with_private_steps(participation, action, token, ctx);
            return Ok(());
        }
        let call = MethodCall { action: action.clone(), method, arguments };
        if let Some(refusal) = self.device.check_call(&call) {
            // The plan may have been made with older knowledge.
            self.send_heartbeat(ctx);
            return Err(refusal);
        }
        let timeout = self.without_patience(&call, timeout);
        let are_all_ready = ready_for == Some(Millis(Duration::ZERO));
        if !partners.is_empty() && !are_all_ready {
            let joint = JointProgress::new(&action, partners, timeout, ready_for)?;
            self.prepare(participation, token, call, joint, ctx);
            return Ok(());
        }
        let recorded = self.agree_to_act(participation, &token, ctx);
        let consent = self.ask_leave(&call.action, ctx);
        let ready = Box::pin(async move {
            recorded.await?;
            consent.await
        });
        let work = self.start_call(&call, timeout, ready, ctx);
        self.running_command = Some(RunningCommand {
            token,
            action,
            subscribers: vec![participation.clone()],
            call: Some(call),
            private: None,
            joint: None,
            _work: work,
        });
        Ok(())
    }

    /// Agrees to carry an action out. Returns a future that ends when its token is on disk, before
    /// which the device does not act: the next incarnation must not act again after a crash.
    fn agree_to_act(
        &mut self,
        participation: &Participation,
        token: &ActionToken,
        ctx: &mut Context<Self>,
    ) -> BoxFuture<Result<(), MethodFailure>> {
        ctx.answer(
            participation,
            Performative::Agree,
            &Agreement { token: token.clone(), has_begun: false },
        );
        self.renew_commitment(&token.conversation);
        on_disk("the token", self.ledger.begin_token(token.clone()), ctx)
    }

    /// Starts a call of the device when `ready` has ended.
    fn start_call(
        &mut self,
        call: &MethodCall,
        timeout: Duration,
        ready: BoxFuture<Result<(), MethodFailure>>,
        ctx: &mut Context<Self>,
    ) -> WorkHandle {
        let performance = self.device.perform(call);
        ctx.run(ready, move |actuator: &mut Self, ready, ctx| match ready {
            Ok(()) => actuator.run_method(performance, timeout, ctx),
            Err(failure) => actuator.command_ended(Err(failure), ctx),
        })
    }

    /// Runs the method of the running action for the time `timeout` at most. Nothing is in its way
    /// any more, so it counts as begun from now on.
    fn run_method(
        &mut self,
        performance: BoxFuture<Result<ErasedYield, MethodFailure>>,
        timeout: Duration,
        ctx: &mut Context<Self>,
    ) {
        let running = self.running_command.as_ref();
        let Some(call) = running.and_then(|running| running.call.clone()) else { return };
        self.joint_action_begins();
        let counted = self.count_beginning(&call, ctx);
        let work = async move {
            counted.await?;
            let performed = tokio::time::timeout(timeout, performance).await;
            performed.unwrap_or(Err(MethodFailure::TimedOut(timeout)))
        };
        let work =
            ctx.run(work, |actuator: &mut Self, outcome, ctx| actuator.command_ended(outcome, ctx));
        if let Some(running) = &mut self.running_command {
            running._work = work;
        }
    }

    /// Whether the token of `act` was requested before, by any executor of the plan. Such an action
    /// is not executed again: the new requester gets its outcome, at once or when the action ends.
    /// Returns a refusal if the token belongs to another action or to an earlier plan.
    fn answer_if_known(
        &mut self,
        participation: &Participation,
        act: &Act,
        ctx: &mut Context<Self>,
    ) -> Result<bool, Refusal> {
        let Act { action, token, .. } = act;
        let differs = |known: &str| {
            let detail = format!("token {token} was given for {known}, not for {action}");
            Err(Refusal::new(Reason::BadContent, detail))
        };
        let agreement = |has_begun| Agreement { token: token.clone(), has_begun };
        if let Some(running) =
            self.running_command.as_mut().filter(|running| running.token == *token)
        {
            if running.action != *action {
                return differs(&running.action);
            }
            running.subscribers.push(participation.clone());
            let is_over = running.subscribers.len() > SUBSCRIBERS_MAX;
            running.subscribers.drain(..usize::from(is_over));
            // To a joint action, the actuator agrees when it is ready.
            if !running.joint.as_ref().is_some_and(JointProgress::is_preparing) {
                let has_begun = running.joint.as_ref().is_some_and(JointProgress::was_told);
                ctx.answer(participation, Performative::Agree, &agreement(has_begun));
            }
            let is_done = running.joint.as_ref().is_some_and(JointProgress::is_part_done);
            if is_done {
                ctx.answer(participation, Performative::Confirm, &running.part_report());
            }
            return Ok(true);
        }
        let report = match self.ledger.state_of(token) {
            TokenState::New => return Ok(false),
            TokenState::Stale => {
                let detail = format!("token {token} of {action} belongs to an earlier plan");
                return Err(Refusal::new(Reason::StaleToken, detail));
            }
            TokenState::Ended(report) => *report,
            TokenState::Begun => {
                let detail = "the agent was restarted while acting: whether it is done is unknown";
                let report = Report::new(Outcome::Failed, detail);
                Report { declined: Some(Reason::Uncertain), ..report }
            }
        };
        if let Some(known) = report.action.as_deref().filter(|known| *known != action.as_str()) {
            return differs(known);
        }
        ctx.answer(participation, Performative::Agree, &agreement(true));
        let report = Report { action: Some(action.clone()), ..report };
        ctx.answer(participation, Performative::Confirm, &report);
        Ok(true)
    }

    /// Checks that this agent has announced an action, and that the first argument of the action
    /// names this agent, or in a joint action one of the first ones.
    fn admissible(&self, action: &str, method: &str, own: &AgentId) -> Result<Admission, Refusal> {
        let incapable = |detail: String| Refusal::new(Reason::Incapable, detail);
        let step = pddl::parse_step(action).into_result().map_err(|diagnostics| {
            let first = diagnostics.first().map(ToString::to_string).unwrap_or_default();
            Refusal::new(Reason::BadContent, format!("`{action}`: {first}"))
        })?;
        let name = step.action.as_str();
        let offered = self.announced.offered.iter().find(|offered| offered.name == name);
        let agents = offered.map_or(1, |offered| offered.agents);
        let acting = step.arguments.iter().take(agents);
        let acting: Vec<AgentId> =
            acting.filter_map(|agent| AgentId::new(agent.as_str()).ok()).collect();
        if !acting.contains(own) {
            return Err(incapable(format!("{action} names another agent, not `{own}`")));
        }
        let known = offered.ok_or_else(|| incapable(format!("`{name}` is not offered now")))?;
        if known.method.method != method {
            let detail =
                format!("the method of `{name}` is `{}`, not `{method}`", known.method.method);
            return Err(incapable(detail));
        }
        let partners: Vec<AgentId> = acting.into_iter().filter(|agent| agent != own).collect();
        if partners.len() + 1 != agents {
            let detail = format!("{action} does not name {agents} different agents");
            return Err(Refusal::new(Reason::BadContent, detail));
        }
        Ok(Admission { timeout: known.method.timeout.0, partners })
    }

    fn command_ended(
        &mut self,
        outcome: Result<ErasedYield, MethodFailure>,
        ctx: &mut Context<Self>,
    ) {
        let outcome = match outcome {
            Ok(yielded) if self.acts_jointly() => return self.wait_for_the_end(yielded, ctx),
            outcome => outcome,
        };
        let is_done = self.is_action_done();
        let Some(mut running) = self.running_command.take() else { return };
        let hidden = self.confidentiality.as_ref().is_some_and(|it| it.hides_something());
        let outcome = match (outcome, running.call.take()) {
            (Ok(yielded), Some(call)) => Ok(self.device.on_success(&call, yielded)),
            (Ok(_), None) => Err(MethodFailure::GivenUp),
            (Err(failure), call) => {
                // Without the leave of a person the method has not begun, nor without its partners.
                let is_begun = !running.waits_for_partners()
                    && !matches!(
                        failure,
                        MethodFailure::Forbidden(_) | MethodFailure::Unanswered(_)
                    );
                if let Some(call) = call.filter(|_| is_begun) {
                    self.device.on_failure(&call, &failure);
                }
                Err(failure)
            }
        };
        if outcome.is_ok() && running.has_further_steps() {
            self.running_command = Some(running);
            // A heartbeat for each private step would tell others how many there are.
            self.send_news(ctx);
            return self.continue_action(ctx);
        }
        let outcome = match outcome {
            // Only a private step after the action has failed.
            Err(failure) if is_done => {
                tracing::warn!(agent = %ctx.id(), %failure, "a private step after an action has failed");
                Ok(MethodResult::default())
            }
            outcome => outcome,
        };
        if self.confidentiality.is_some() {
            // The call may have changed what may be told.
            self.announce_changed_model(ctx);
        }
        let report = self.report(outcome, &running, hidden, ctx);
        if running.waits_for_partners() {
            return self.conclude_unbegun(&running, &report, ctx);
        }
        let RunningCommand { token, subscribers: askers, .. } = running;
        self.conclude(token, askers, report, ctx);
    }

    /// Returns the report of an action that has ended. The log has the details that the report may not
    /// have. `hidden` says whether the device had something to hide when the last call ended.
    fn report(
        &self,
        outcome: Result<MethodResult, MethodFailure>,
        running: &RunningCommand,
        hidden: bool,
        ctx: &Context<Self>,
    ) -> Report {
        let RunningCommand { action, token, private, .. } = running;
        let confidentiality = self.confidentiality.as_ref();
        let hides =
            hidden || private.is_some() || confidentiality.is_some_and(|it| it.hides_something());
        let public_detail = hides.then(|| private_steps::public_detail(action, &outcome));
        let mut report = match outcome {
            Ok(MethodResult { detail, observations }) => {
                let report = Report::new(Outcome::Done, detail);
                let observations = self.announced_observations(observations, hides, ctx);
                Report { observations: text_of(&observations), ..report }
            }
            Err(failure) => {
                let report = Report::new(Outcome::Failed, format!("failed to {failure}"));
                let declined = match failure {
                    // The action was stopped at an unknown point.
                    MethodFailure::TimedOut(_) | MethodFailure::Interrupted(_) => {
                        Some(Reason::TimedOut)
                    }
                    MethodFailure::Hindered(_) => Some(Reason::Conflict),
                    MethodFailure::Forbidden(_) => Some(Reason::Incapable),
                    MethodFailure::Unanswered(_) => Some(Reason::Unanswered),
                    _ => None,
                };
                Report { declined, ..report }
            }
        };
        tracing::info!(conversation = %token.conversation, action, outcome = %report.outcome,
            detail = report.detail, "acted");
        if let Some(detail) = public_detail {
            report.detail = detail;
        }
        report.action = Some(action.clone());
        report
    }

    /// Writes the outcome of an action to disk under the action's token, then reports the outcome.
    fn conclude(
        &mut self,
        token: ActionToken,
        askers: Vec<Participation>,
        report: Report,
        ctx: &mut Context<Self>,
    ) {
        self.commitment_step_ended(&token, &report);
        let record = self.ledger.end_token(token.clone(), report.clone());
        let told = token.clone();
        let written = ctx.run_blocking(record);
        let work = ctx.run(written, move |actuator: &mut Self, written, ctx| {
            actuator.pending_reports.remove(&told);
            if let Ok(Err(error)) = written {
                tracing::warn!(agent = %ctx.id(), %error, "an outcome could not be written down");
                ctx.failure_counters().count_not_persisted();
            }
            // The heartbeat comes first: an agent that receives the confirmation may query the
            // state at once.
            actuator.send_heartbeat(ctx);
            for asker in askers {
                ctx.answer(&asker, Performative::Confirm, &report);
            }
        });
        self.pending_reports.insert(token, work);
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        if let Some(exchange) = message.exchange() {
            if let Some((cancel, _)) = self.running_bids.get(exchange) {
                cancel.set();
            }
            let cancelling = message.content_as::<CancelAction>().unwrap_or_default();
            if cancelling.unless_followed {
                return self.requester_stood_down(exchange, ctx);
            }
            // A requester that another one has replaced cannot cancel the action.
            let is_this = |running: &RunningCommand| {
                running.subscribers.last().is_some_and(|asker| asker.exchange == *exchange)
            };
            if self.running_command.as_ref().is_some_and(is_this) {
                self.cancel_command("given up as asked", ctx);
            }
        }
    }

    /// Removes a requester of the running action that has stood down. The action goes on if another
    /// requester follows it now or soon; otherwise it is cancelled.
    fn requester_stood_down(&mut self, exchange: &ReplyToken, ctx: &mut Context<Self>) {
        let Some(running) = &mut self.running_command else { return };
        if !running.subscribers.iter().any(|asker| asker.exchange == *exchange) {
            return;
        }
        running.subscribers.retain(|asker| asker.exchange != *exchange);
        let token = running.token.clone();
        self.check_orphaned(token, false, ctx);
    }

    /// Cancels the running action if no requester follows it: either no other requester has asked
    /// for the action, or all others are absent at two checks in a row.
    fn check_orphaned(&mut self, token: ActionToken, is_second: bool, ctx: &mut Context<Self>) {
        // The second check comes after the grace, so that a short absence does not cancel the
        // action.
        let wait = if is_second { ctx.settings().grace } else { ORPHAN_TIMEOUT };
        ctx.after(wait, move |actuator: &mut Self, ctx| {
            let Some(running) =
                actuator.running_command.as_ref().filter(|running| running.token == token)
            else {
                return;
            };
            let directory = ctx.directory();
            let is_here = |asker: &Participation| {
                asker.incarnation.is_none_or(|incarnation| {
                    directory.find_incarnation(&asker.initiator, incarnation).is_some()
                })
            };
            if running.subscribers.is_empty()
                || (is_second && !running.subscribers.iter().any(is_here))
            {
                actuator.cancel_command("no agent waits for it any more", ctx);
            } else if !running.subscribers.iter().any(is_here) {
                actuator.check_orphaned(token, true, ctx);
            }
        });
    }

    fn cancel_command(&mut self, why: &str, ctx: &mut Context<Self>) {
        if self.withdraw_preparation(&Refusal::new(Reason::Conflict, why), ctx) {
            return;
        }
        let Some(running) = self.running_command.take() else { return };
        let report = Report::new(Outcome::Cancelled, why);
        let report = Report { action: Some(running.action.clone()), ..report };
        if running.waits_for_partners() {
            return self.conclude_unbegun(&running, &report, ctx);
        }
        let has_waited = self.withdraw_consent(ctx);
        let RunningCommand { token, subscribers: askers, call, .. } = running;
        if let Some(call) = call.filter(|_| !has_waited) {
            self.device.on_failure(&call, &MethodFailure::GivenUp);
        }
        self.conclude(token, askers, report, ctx);
    }

    // === bidding ===

    fn called(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let call = match message.content_as::<CallForProposals>() {
            Ok(call) => call,
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        if let Some(stop) = self.stop_of_all(ctx.id()) {
            return ctx.refuse(&participation, Reason::Stopped, stopping::described(&stop));
        }
        if call.part.is_none() && !self.device.makes_bids() {
            return ctx.refuse(&participation, Reason::Incapable, "this agent proposes no plans");
        }
        let conversation = message.conversation_id.clone();
        let objection = self.commitment_objection(&conversation);
        if let Some(refusal) = objection.filter(|_| call.part.is_some()) {
            return ctx.answer(&participation, Performative::Refuse, &refusal);
        }
        if self.running_bids.len() >= BIDS_MAX {
            return ctx.refuse(&participation, Reason::Busy, "it is planning for other calls");
        }
        let patience = message.reply_within.map_or(ctx.settings().proposals_deadline, |by| by.0);
        let cancel = Cancel::new();
        let (flag, deadline) = (cancel.clone(), cancel.clone());
        ctx.after(patience.mul_f32(0.8), move |_: &mut Self, _| deadline.set());
        let (local, id) = (self.local_domain(ctx), ctx.id().clone());
        let exchange = participation.exchange.clone();
        let finished = exchange.clone();
        let planner = Arc::clone(&self.bid_cache);
        let private = self.private_planner();
        self.keep_bid_cache(ctx);
        let work = ctx.compute(
            move || {
                let mut afresh = BidCache::default();
                let mut kept = planner.try_lock().ok();
                let BidCache { composition, replanner } =
                    kept.as_deref_mut().unwrap_or(&mut afresh);
                let bid = answer((&call, &id), local(composition), private, replanner, &flag);
                (call, bid)
            },
            move |actuator: &mut Self, (call, bid), ctx| {
                actuator.running_bids.remove(&finished);
                match bid {
                    Ok(bid) => {
                        let asked = (conversation, &call);
                        actuator.answer_call(&participation, asked, &bid, ctx);
                    }
                    Err(DeclinedCall { why, reason, refusal }) => {
                        let is_new = refusal.is_some_and(|it| actuator.announce_more(&it, ctx));
                        let reason = if is_new { Reason::ModelChanged } else { reason };
                        ctx.refuse(&participation, reason, why);
                    }
                }
            },
        );
        self.running_bids.insert(exchange, (cancel, work));
    }

    /// Keeps what planning has left for the next time, for a while.
    fn keep_bid_cache(&mut self, ctx: &mut Context<Self>) {
        if let Some(timer) = self.cache_expiry.take() {
            ctx.cancel_timer(timer);
        }
        let let_go = |actuator: &mut Self, _: &mut Context<Self>| {
            (actuator.bid_cache, actuator.cache_expiry) = (Arc::default(), None);
        };
        self.cache_expiry = Some(ctx.after(CACHE_TTL, let_go));
    }

    // === answers to announcements ===

    fn declined(&mut self, message: Message, _ctx: &mut Context<Self>) {
        let why = message.content_as::<Refusal>().map(|refusal| refusal.detail);
        tracing::warn!(from = %message.sender, why = why.unwrap_or_default(),
            "part of the announcement was declined");
    }
}
