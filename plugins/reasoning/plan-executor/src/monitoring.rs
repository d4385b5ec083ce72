//! Monitoring of running plans: passes changes from the Domain Maintainer and heartbeats of agents
//! on to the plans, and schedules the checks of the plans.

use std::time::Duration;

use acl::content::{Inform, Snapshot};
use acl::{Message, ReplyToken};
use agent::{Context, Resource};
use plan_execution::{CheckDelay, ExecutionEvent};

use crate::{PlanExecutor, RunningPlan};

/// Delay between a change of the world and the check of the running plans. One event causes several
/// messages, and one check after this delay covers them all.
const SETTLE_DELAY: Duration = Duration::from_millis(30);

impl PlanExecutor {
    pub(crate) fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        let beat = match message.content_as::<Inform>() {
            Ok(Inform::Epoch(change)) if message.sender == self.domain_maintainer => {
                let event =
                    ExecutionEvent::WorldChanged { left: change.left, joined: change.joined };
                let plans: Vec<_> = self.running_plans.keys().cloned().collect();
                return plans.iter().for_each(|token| self.handle(token, event.clone(), ctx));
            }
            Ok(Inform::Heartbeat(beat)) => beat,
            Ok(Inform::Model(announcement)) => announcement.heartbeat,
            _ => return,
        };
        self.last_heartbeats.store_heartbeat(&message.sender, message.incarnation, &beat);
        let awaits = |running: &RunningPlan| running.state.awaits_heartbeat(&message.sender);
        let plans = self.running_plans.iter().filter(|(_, running)| awaits(running));
        let plans: Vec<_> = plans.map(|(token, _)| token.clone()).collect();
        for token in plans {
            self.handle(&token, ExecutionEvent::HeartbeatReceived(message.sender.clone()), ctx);
        }
    }

    /// Waits for the next heartbeats of agents that confirmed a step although their last heartbeat
    /// contradicts it. The wait ends at the latest after the heartbeat lease, the longest time
    /// between two heartbeats of an agent that is present.
    pub(crate) fn await_effects(&mut self, token: &ReplyToken, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let waiting = token.clone();
        let patience = ctx.settings().heartbeat_lease;
        running.verification_timer = Some(ctx.after(patience, move |executor: &mut Self, ctx| {
            executor.handle(&waiting, ExecutionEvent::EffectsOverdue, ctx);
        }));
    }

    /// Schedules a check of the rest of a plan. Replaces an earlier scheduled check of the plan.
    pub(crate) fn schedule_check(
        &mut self,
        token: &ReplyToken,
        delay: CheckDelay,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let wait = match delay {
            CheckDelay::Settle => SETTLE_DELAY,
            CheckDelay::GraceAfterDeparture | CheckDelay::Grace => ctx.settings().grace,
        };
        let checked = token.clone();
        let timer = ctx.after(wait, move |executor: &mut Self, ctx| {
            if let Some(running) = executor.running_plans.get_mut(&checked) {
                running.check_timer = None;
            }
            executor.handle(&checked, ExecutionEvent::CheckDue(delay), ctx);
        });
        let former = running.check_timer.replace(timer);
        former.into_iter().for_each(|former| ctx.cancel_timer(former));
    }

    /// Queries the Domain Maintainer for the known state, in order to check the rest of a plan
    /// against it.
    pub(crate) fn query_state(&mut self, token: &ReplyToken, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let asked = ctx.ask(Resource::Domain, &self.domain_maintainer);
        let checked = token.clone();
        running.state_query = Some(ctx.run(asked, move |executor: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            if let Some(snapshot) = snapshot {
                executor.state_received(&checked, snapshot, ctx);
            }
        }));
    }

    fn state_received(
        &mut self,
        token: &ReplyToken,
        snapshot: Box<Snapshot>,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get(token) else { return };
        let is_needed_away = running.state.needed().any(|agent| ctx.find(&agent).is_none());
        let are_agents_absent = self.departure_timer.is_some() || is_needed_away;
        let knowledge = Box::new(agent::knowledge(&snapshot.knowledge));
        let event = ExecutionEvent::StateReceived { snapshot, knowledge, are_agents_absent };
        self.handle(token, event, ctx);
    }
}
