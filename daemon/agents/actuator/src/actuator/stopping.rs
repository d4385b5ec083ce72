//! How an actuator obeys stops: it ends its action, and begins none until the stop is released.
//!
//! - A stop takes effect before it is written to disk, and is confirmed afterwards. It comes as a
//!   request, or in the heartbeat of another actuator that has received it.
//! - A device that goes on by itself, such as a robot with a goal, is brought to a standstill. The
//!   confirmation tells whether the device has confirmed that.
//! - A stop of a place concerns the actions that name the place, and the agents that are there:
//!   those with a fact about themselves and the place, such as `(at robot hall)`. A pose that an
//!   agent knows by itself counts as the place beside it.
//! - A stopped agent offers no actions, so that no plan is made with it. It has the fact `stopped`.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use acl::AgentId;
use acl::content::{Outcome, Reason, Refusal, ReleaseStops, Report, Stop, StopEffect, StopState};
use agent::{Context, Participation, StopChanges, WorkHandle};
use pddl::{ActionModel, InitElement, Name, Term};
use substrate::BoxFuture;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::actuator::Actuator;
use crate::device::{Description, OwnFact};
use crate::pddl_text::{facts_of, model_of};

/// Maximum number of confirmations that wait for the disk at a time.
const CONFIRMATIONS_MAX: usize = 64;

/// How long a device may take to confirm its standstill. `althing stop` waits for three seconds.
const STILL_WITHIN: Duration = Duration::from_secs(2);

/// Time from a stop to the announcement of what the agent no longer offers. The confirmations of all
/// actuators of a building go first; a planner that still counts on this one is refused.
const ANNOUNCED_AFTER: Duration = Duration::from_millis(150);

/// Type of the ontology for a spot that a mobile base knows by itself.
const POSE: &str = "pose";

/// Predicate of the ontology for two places between which one can go.
const CONNECTED: &str = "connected";

/// A standstill to which the device is brought, or was brought by the last stop.
pub(super) struct StandingStill {
    /// Identifiers of the stops that were in force when it began.
    stops: BTreeSet<String>,
    /// Whether the device has confirmed it; `None` as long as that is not known.
    outcome: watch::Receiver<Option<Result<(), String>>>,
    _work: WorkHandle,
}

/// The poses that an agent knows by itself, each with the place beside it.
struct Poses(Vec<(Name, Name)>);

impl Poses {
    /// Returns the poses that an action model declares and connects with a place.
    fn of(model: &ActionModel) -> Poses {
        let is_pose = |name: &str| {
            model.objects.iter().map(|declaration| &declaration.object).any(|object| {
                let mut types = object.ty.alternatives.iter();
                object.name.as_str().eq_ignore_ascii_case(name)
                    && types.any(|ty| ty.as_str().eq_ignore_ascii_case(POSE))
            })
        };
        let ways = model.init.iter().filter_map(|fact| match fact {
            InitElement::Atom(atom) if atom.predicate.as_str().eq_ignore_ascii_case(CONNECTED) => {
                match atom.arguments.as_slice() {
                    [Term::Object(from), Term::Object(to)] => Some((from.clone(), to.clone())),
                    _ => None,
                }
            }
            _ => None,
        });
        Poses(ways.filter(|(from, to)| is_pose(from.as_str()) && !is_pose(to.as_str())).collect())
    }

    /// Returns the place beside a pose; `None` if `name` is no pose of the agent.
    fn beside(&self, name: &str) -> Option<&str> {
        let is_it = |(pose, _): &&(Name, Name)| pose.as_str().eq_ignore_ascii_case(name);
        self.0.iter().find(is_it).map(|(_, place)| place.as_str())
    }
}

/// Waits until it is known whether the device stands still.
async fn still_of(mut outcome: watch::Receiver<Option<Result<(), String>>>) -> Result<(), String> {
    // A later stop, which has begun anew, drops the sender.
    let known = outcome.wait_for(Option::is_some).await.ok().and_then(|known| known.clone());
    known.unwrap_or_else(|| Err("see it stand still before the next stop".to_owned()))
}

/// Returns what an agent reports of a stop that does not concern it. `running` is its action.
fn unconcerned(running: Option<&str>) -> String {
    match running {
        Some(action) => format!("goes on with {action}, which the stop does not name"),
        None => "was still; the stop does not name it".to_owned(),
    }
}

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
        if let Some(confidentiality) = &self.confidentiality {
            offer = confidentiality.announced(offer);
        }
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
        self.stops.find(|stop| self.is_concerned(stop, own))
    }

    /// Whether the stop `id` is in force and forbids all actions of this agent.
    pub(super) fn is_stopped_by(&self, id: &str, own: &AgentId) -> bool {
        self.stops.find(|stop| stop.id == id && self.is_concerned(stop, own)).is_some()
    }

    fn is_concerned(&self, stop: &Stop, own: &AgentId) -> bool {
        stop.concerns(own.as_str()) || self.places(own).iter().any(|place| stop.concerns(place))
    }

    /// Returns a stop that forbids `action`, a ground step such as `(move robot hall lab)`; `None`
    /// if there is none.
    pub(super) fn stop_against(&self, action: &str, own: &AgentId) -> Option<Stop> {
        if self.stops.in_force().is_empty() {
            return None;
        }
        let step = pddl::parse_step(action).into_result().ok();
        let arguments = step.iter().flat_map(|step| &step.arguments).map(|name| name.as_str());
        let poses = Poses::of(&self.device.describe().model);
        let names: Vec<_> = arguments.flat_map(|name| [Some(name), poses.beside(name)]).collect();
        let is_named = |stop: &Stop| names.iter().flatten().any(|name| stop.concerns(name));
        self.stop_of_all(own).or_else(|| self.stops.find(is_named))
    }

    /// Returns the names that follow the name of the agent in facts of the device, such as `hall`
    /// in `(at robot hall)`. The places where the agent is are among them: if it is at a pose of its
    /// own, also the place beside the pose.
    fn places(&self, own: &AgentId) -> Vec<String> {
        let mut places = Vec::new();
        for OwnFact { fact, .. } in self.device.facts() {
            let InitElement::Atom(atom) = fact else { continue };
            let mut names = atom.arguments.iter().map(ToString::to_string);
            if names.next().is_some_and(|first| first.eq_ignore_ascii_case(own.as_str())) {
                places.extend(names);
            }
        }
        let poses = Poses::of(&self.device.describe().model);
        let beside = places.iter().filter_map(|name| poses.beside(name)).map(str::to_owned);
        let beside: Vec<_> = beside.collect();
        places.extend(beside);
        places
    }

    /// Returns the stops that this agent knows, and the positions of hardware stops, as the answer to
    /// a query.
    pub(super) fn stop_state(&self, own: &AgentId) -> StopState {
        let buttons = self.buttons.as_ref();
        let buttons = buttons.map(|buttons| buttons.reports(Instant::now())).unwrap_or_default();
        StopState { agent: own.clone(), stops: self.stops.in_force(), buttons }
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
            let saved = actuator.save_stops(ctx);
            let next = async move {
                if let Err(error) = saved.await {
                    tracing::error!(error, "a stop is not written to disk");
                }
                changes.next().await;
                changes
            };
            actuator.wait_for_stops(Box::pin(next), ctx);
        });
        self.following_stops = Some(following);
    }

    /// Returns a future that writes the stops to disk, unless another actuator of this daemon has
    /// written them. Its error says why they are not on disk.
    fn save_stops(&self, ctx: &Context<Self>) -> BoxFuture<Result<(), String>> {
        if self.stops.is_saved() {
            return Box::pin(std::future::ready(Ok(())));
        }
        let stops = Arc::clone(&self.stops);
        let saved = ctx.run_blocking(move || stops.save());
        Box::pin(async move {
            let saved = saved.await.map_err(|error| error.to_string())?;
            saved.map_err(|error| error.to_string())
        })
    }

    /// Ends the running action if a stop forbids it, and announces what the agent still offers.
    /// Brings the device to a standstill if a stop concerns it.
    fn obey(&mut self, ctx: &mut Context<Self>) {
        let action = self.running_action();
        let ends = self.running_steps().find_map(|step| self.stop_against(step, ctx.id()));
        if self.stop_of_all(ctx.id()).is_some() {
            // Its plan has to be made anew.
            self.commitment = None;
        }
        if ends.is_some() || self.stop_of_all(ctx.id()).is_some() {
            self.begin_standing_still(ctx);
        } else if self.stops.in_force().is_empty() {
            self.standing_still = None;
        }
        match ends {
            Some(stop) => {
                // The heartbeat before the report of the action announces the new offer.
                let refusal = refusal(action.as_deref().unwrap_or_default(), &stop);
                if !self.withdraw_preparation(&refusal, ctx) {
                    self.cancel_command(&described(&stop), ctx);
                }
                self.ended_by_stop = action.map(|action| (action, stop.id));
            }
            None if self.stops.in_force().is_empty() => self.send_heartbeat(ctx),
            None => self.announce_soon(ctx),
        }
    }

    /// Announces what the agent offers under its stops, once for all that come meanwhile.
    fn announce_soon(&mut self, ctx: &mut Context<Self>) {
        if self.announcement.is_some() {
            return;
        }
        let announce = |actuator: &mut Self, ctx: &mut Context<Self>| {
            actuator.announcement = None;
            actuator.send_heartbeat(ctx);
        };
        self.announcement = Some(ctx.after(ANNOUNCED_AFTER, announce));
    }

    /// Brings the device to a standstill, beside everything else, unless that was begun under the same
    /// stops. The outcome stays known until another stop or the release of all.
    fn begin_standing_still(&mut self, ctx: &mut Context<Self>) {
        let stops: BTreeSet<String> = self.stops.in_force().into_iter().map(|it| it.id).collect();
        if self.standing_still.as_ref().is_some_and(|standing| stops.is_subset(&standing.stops)) {
            return;
        }
        let Some(still) = self.device.stand_still() else { return };
        let (sender, outcome) = watch::channel(None);
        let still = async move {
            let still = tokio::time::timeout(STILL_WITHIN, still).await;
            still.unwrap_or_else(|_| Err(format!("see it stand still within {STILL_WITHIN:?}")))
        };
        let own = ctx.id().clone();
        let work = ctx.run(still, move |_: &mut Self, still, _| {
            if let Err(problem) = &still {
                tracing::warn!(agent = %own, problem, "stopped, but its device may go on");
            }
            sender.send_replace(Some(still));
        });
        self.standing_still = Some(StandingStill { stops, outcome, _work: work });
    }

    /// Returns a refusal while the device is brought to a standstill, which would end the action, too.
    pub(super) fn standstill_objection(&self, action: &str) -> Option<Refusal> {
        let standing = self.standing_still.as_ref()?;
        let is_under_way = standing.outcome.borrow().is_none();
        let detail = || format!("{action}: the device is being brought to a standstill");
        is_under_way.then(|| Refusal::new(Reason::Busy, detail()))
    }

    fn running_action(&self) -> Option<String> {
        self.running_command.as_ref().map(|running| running.action.clone())
    }

    /// Returns the running action, the step that the device carries out for it, and those that follow.
    fn running_steps(&self) -> impl Iterator<Item = &str> {
        self.running_command
            .iter()
            .flat_map(|running| std::iter::once(running.action.as_str()).chain(running.steps()))
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
        let is_stopped = self.is_stopped_by(&stop.id, ctx.id());
        let (effect, detail) = match (ended, self.running_action()) {
            (Some((action, _)), _) => (StopEffect::Ended, format!("stopped: {action}")),
            (None, None) if is_stopped => (StopEffect::Still, "was already still".to_owned()),
            (None, running) => (StopEffect::Unconcerned, unconcerned(running.as_deref())),
        };
        let still = self.standing_still.as_ref().map(|standing| standing.outcome.clone());
        let report = async move {
            let still = match (effect, still) {
                (StopEffect::Unconcerned, _) | (_, None) => Ok(()),
                (_, Some(still)) => still_of(still).await,
            };
            let (outcome, effect, detail) = match still {
                Ok(()) => (Outcome::Done, effect, detail),
                Err(problem) => {
                    let detail = format!("{detail}; but its device may go on: failed to {problem}");
                    (Outcome::Failed, StopEffect::Doubtful, detail)
                }
            };
            Report { stop_effect: Some(effect), ..Report::new(outcome, detail) }
        };
        self.confirm_when_saved(participation, report, ctx);
    }

    pub(super) fn release_requested(
        &mut self,
        participation: &Participation,
        release: &ReleaseStops,
        ctx: &mut Context<Self>,
    ) {
        let (ids, refusal) = self.releasable(&release.ids, ctx);
        self.stops.release(&ids);
        self.obey(ctx);
        if let Some(refusal) = refusal {
            return ctx.answer(participation, acl::Performative::Refuse, &refusal);
        }
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
        let saved = self.save_stops(ctx);
        let participation = participation.clone();
        let both = async move { (saved.await, report.await) };
        let confirming = ctx.run(both, move |_: &mut Self, (saved, mut report), ctx| {
            if saved.is_err() {
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
