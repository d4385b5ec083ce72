//! How an actuator obeys stops: it ends its action, and begins none until the stop is released.
//!
//! - A stop takes effect before it is written to disk, and is confirmed afterwards. It comes as a
//!   request, or in the heartbeat of another actuator that has received it.
//! - A device that goes on by itself, such as a robot with a goal, is brought to a standstill. The
//!   confirmation tells whether the device has confirmed that.
//! - A stop of a place concerns the actions that name the place, and the agents that are there:
//!   those with a fact about themselves and the place, such as `(at robot hall)`.
//! - A stopped agent offers no actions, so that no plan is made with it. It has the fact `stopped`.

use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use acl::content::{Outcome, Reason, Refusal, ReleaseStops, Report, Stop, StopState};
use agent::{Context, Participation, StopChanges};
use pddl::InitElement;
use substrate::BoxFuture;

use crate::actuator::Actuator;
use crate::device::Description;
use crate::pddl_text::{facts_of, model_of};

/// Maximum number of confirmations that wait for the disk at a time.
const CONFIRMATIONS_MAX: usize = 64;

/// How long a device may take to confirm its standstill. `althing stop` waits for three seconds.
const STILL_WITHIN: Duration = Duration::from_secs(2);

/// Returns the refusal of an action that a stop forbids.
pub(super) fn refusal(action: &str, stop: &Stop) -> Refusal {
    Refusal::new(Reason::Stopped, format!("{action}: {}", described(stop)))
}

/// Returns a stop in words for a person, with the command that ends it.
pub(super) fn described(stop: &Stop) -> String {
    let Stop { id, scope, by, why } = stop;
    let what = if scope.is_empty() { String::new() } else { format!(" ({})", scope.join(", ")) };
    let why = if why.is_empty() { String::new() } else { format!(": {why}") };
    format!("stopped{what} by `{by}`{why}; `althing stop --release {id}` ends the stop")
}

impl Actuator {
    /// Returns the description of the device at present; without actions and methods if the agent
    /// is stopped.
    pub(super) fn offer(&self) -> Description {
        let mut offer = self.device.describe();
        self.add_patience(&mut offer);
        let agent = AgentId::new(offer.model.agent.as_str());
        if agent.is_ok_and(|agent| self.stop_of_all(&agent).is_some()) {
            offer.model.actions.clear();
            offer.model.durative_actions.clear();
            offer.methods.clear();
            // The ontology need not declare the predicate `stopped`.
            let words = "(define (agent a) (:domain d) (:predicates (stopped ?a - object)))";
            offer.model.predicates.extend(model_of(words).predicates);
        }
        offer
    }

    /// Returns the fact `stopped` of this agent; nothing if the agent is not stopped.
    pub(super) fn stop_fact(&self, own: &AgentId) -> Vec<InitElement> {
        let stop = self.stop_of_all(own);
        let text = stop.map(|_| format!("(stopped {own})")).unwrap_or_default();
        facts_of(&text).into_iter().map(|fact| fact.fact).collect()
    }

    /// Returns a stop that forbids all actions of this agent; `None` if there is none.
    pub(super) fn stop_of_all(&self, own: &AgentId) -> Option<Stop> {
        let concerned = |stop: &Stop| {
            stop.concerns(own.as_str()) || self.places(own).any(|place| stop.concerns(&place))
        };
        self.stops.find(concerned)
    }

    /// Returns a stop that forbids `action`, a ground step such as `(move robot hall lab)`; `None`
    /// if there is none.
    pub(super) fn stop_against(&self, action: &str, own: &AgentId) -> Option<Stop> {
        let step = pddl::parse_step(action).into_result().ok();
        let arguments = || step.iter().flat_map(|step| &step.arguments);
        let names = |stop: &Stop| arguments().any(|name| stop.concerns(name.as_str()));
        self.stop_of_all(own).or_else(|| self.stops.find(names))
    }

    /// Returns the names that follow the name of the agent in facts of the device, such as `hall`
    /// in `(at robot hall)`. The places where the agent is are among them.
    fn places(&self, own: &AgentId) -> impl Iterator<Item = String> {
        let facts = self.device.facts().into_iter();
        let own = own.to_string();
        facts.flat_map(move |fact| match &fact.fact {
            InitElement::Atom(atom) => {
                let mut names = atom.arguments.iter().map(ToString::to_string);
                let is_own = names.next().is_some_and(|first| first.eq_ignore_ascii_case(&own));
                if is_own { names.collect() } else { Vec::new() }
            }
            _ => Vec::new(),
        })
    }

    /// Returns the stops that this agent knows, as the answer to a query.
    pub(super) fn stop_state(&self, own: &AgentId) -> StopState {
        StopState { agent: own.clone(), stops: self.stops.in_force() }
    }

    /// Begins to follow the daemon's stops: the actuator obeys each change, then writes it to disk.
    pub(super) fn follow_stops(&mut self, ctx: &mut Context<Self>) {
        let mut changes = self.stops.changes();
        let next = async move {
            changes.next().await;
            changes
        };
        self.wait_for_stops(Box::pin(next), ctx);
        // The device may have gone on while this daemon was restarted.
        if self.stop_of_all(ctx.id()).is_some() {
            self.begin_standing_still(ctx);
        }
    }

    fn wait_for_stops(&mut self, next: BoxFuture<StopChanges>, ctx: &mut Context<Self>) {
        let following = ctx.run(next, |actuator: &mut Self, mut changes, ctx| {
            actuator.obey(ctx);
            let stops = Arc::clone(&actuator.stops);
            let saved = ctx.run_blocking(move || stops.save());
            let next = async move {
                match saved.await {
                    Ok(Ok(())) => (),
                    Ok(Err(error)) => tracing::error!(%error, "a stop is not written to disk"),
                    Err(error) => tracing::error!(%error, "a stop is not written to disk"),
                }
                changes.next().await;
                changes
            };
            actuator.wait_for_stops(Box::pin(next), ctx);
        });
        self.following_stops = Some(following);
    }

    /// Ends the running action if a stop forbids it, and announces what the agent still offers.
    /// Brings the device to a standstill if a stop concerns it.
    fn obey(&mut self, ctx: &mut Context<Self>) {
        let action = self.running_action();
        let ends = action.as_ref().and_then(|action| self.stop_against(action, ctx.id()));
        if ends.is_some() || self.stop_of_all(ctx.id()).is_some() {
            self.begin_standing_still(ctx);
        }
        match ends {
            Some(stop) => {
                // The heartbeat before the report of the action announces the new offer.
                self.cancel_command(&described(&stop), ctx);
                self.ended_by_stop = action.map(|action| (action, stop.id));
            }
            None => self.send_heartbeat(ctx),
        }
    }

    /// Brings the device to a standstill, beside everything else.
    fn begin_standing_still(&mut self, ctx: &mut Context<Self>) {
        let own = ctx.id().clone();
        let standing = ctx.run(self.stand_still(), move |actuator: &mut Self, still, _| {
            actuator.standing_still = None;
            if let Err(problem) = still {
                tracing::warn!(agent = %own, problem, "stopped, but its device may go on");
            }
        });
        self.standing_still = Some(standing);
    }

    /// Returns a future that brings the device to a standstill, and tells within a time limit
    /// whether the device has confirmed it.
    fn stand_still(&mut self) -> BoxFuture<Result<(), String>> {
        let Some(still) = self.device.stand_still() else {
            return Box::pin(std::future::ready(Ok(())));
        };
        Box::pin(async move {
            let still = tokio::time::timeout(STILL_WITHIN, still).await;
            still.unwrap_or_else(|_| Err(format!("see it stand still within {STILL_WITHIN:?}")))
        })
    }

    fn running_action(&self) -> Option<String> {
        self.running_command.as_ref().map(|running| running.call.action.clone())
    }

    pub(super) fn stop_requested(
        &mut self,
        participation: &Participation,
        stop: &Stop,
        ctx: &mut Context<Self>,
    ) {
        self.stops.add(stop);
        self.obey(ctx);
        if self.stops.find(|known| known.id == stop.id).is_none() {
            let detail = format!("stop {} was released before it came here", stop.id);
            return ctx.refuse(participation, Reason::Conflict, detail);
        }
        // The stop may have come earlier, through another actuator of this daemon.
        let ended = self.ended_by_stop.as_ref().filter(|(_, id)| *id == stop.id);
        let is_stopped = self.stop_of_all(ctx.id()).is_some();
        let detail = match (ended, self.running_action()) {
            (Some((action, _)), _) => format!("stopped: {action}"),
            (None, Some(action)) => format!("goes on with {action}, which the stop does not name"),
            (None, None) if is_stopped => "was already still".to_owned(),
            (None, None) => "was still; the stop does not name it".to_owned(),
        };
        let still = match is_stopped || ended.is_some() {
            true => self.stand_still(),
            false => Box::pin(std::future::ready(Ok(()))),
        };
        let report = async move {
            match still.await {
                Ok(()) => Report::new(Outcome::Done, detail),
                Err(problem) => Report::new(
                    Outcome::Failed,
                    format!("{detail}; but its device may go on: failed to {problem}"),
                ),
            }
        };
        self.confirm_when_saved(participation, report, ctx);
    }

    pub(super) fn release_requested(
        &mut self,
        participation: &Participation,
        release: &ReleaseStops,
        ctx: &mut Context<Self>,
    ) {
        self.stops.release(&release.ids);
        self.obey(ctx);
        let detail = match self.stop_of_all(ctx.id()) {
            Some(other) => format!("still stopped: {}", described(&other)),
            None => "may act again".to_owned(),
        };
        let report = std::future::ready(Report::new(Outcome::Done, detail));
        self.confirm_when_saved(participation, report, ctx);
    }

    /// Writes the stops to disk, then confirms the request with the report.
    fn confirm_when_saved(
        &mut self,
        participation: &Participation,
        report: impl Future<Output = Report> + Send + 'static,
        ctx: &mut Context<Self>,
    ) {
        let stops = Arc::clone(&self.stops);
        let saved = ctx.run_blocking(move || stops.save());
        let participation = participation.clone();
        let both = async move { (saved.await, report.await) };
        let confirming = ctx.run(both, move |_: &mut Self, (saved, mut report), ctx| {
            if !matches!(saved, Ok(Ok(()))) {
                ctx.failure_counters().count_not_persisted();
                report.detail += " (not written to disk: a restart forgets it)";
            }
            ctx.answer(&participation, acl::Performative::Confirm, &report);
        });
        self.confirming_stops.push_back(confirming);
        let surplus = self.confirming_stops.len().saturating_sub(CONFIRMATIONS_MAX);
        self.confirming_stops.drain(..surplus);
    }
}
