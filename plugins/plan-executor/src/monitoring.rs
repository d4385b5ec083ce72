//! Watching of running plans. When the known state or the action models change, the rest of each plan
//! is checked again. A confirmed step is checked against the next heartbeat of its agent.

use std::time::Duration;

use acl::content::{EpochChange, Inform, Report, Snapshot};
use acl::{AgentId, Message, ReplyToken};
use agent::{Context, Resource};

use crate::{PlanExecutor, RunningPlan, failure};

/// Delay between a change of the world and the check of the running plans. News of one event arrive in
/// several messages, which one check then covers.
const SETTLE_DELAY: Duration = Duration::from_millis(30);

impl PlanExecutor {
    pub(crate) fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        let beat = match message.content_as::<Inform>() {
            Ok(Inform::Epoch(change)) if message.sender == self.domain_maintainer => {
                let plans: Vec<_> = self.running_plans.keys().cloned().collect();
                for token in plans {
                    self.schedule_check(&token, &change, ctx);
                }
                return;
            }
            Ok(Inform::Heartbeat(beat)) => beat,
            Ok(Inform::Model(announcement)) => announcement.heartbeat,
            _ => return,
        };
        self.last_heartbeats.store_heartbeat(&message.sender, message.incarnation, &beat);
        let doubts =
            |running: &RunningPlan| running.unverified_effects.contains_key(&message.sender);
        let plans = self.running_plans.iter().filter(|(_, running)| doubts(running));
        let plans: Vec<_> = plans.map(|(token, _)| token.clone()).collect();
        for token in plans {
            self.verify_effect(&token, &message.sender, ctx);
        }
    }

    /// Compares a change that an agent confirmed with the next heartbeat of this agent.
    fn verify_effect(&mut self, token: &ReplyToken, agent: &AgentId, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let Some(doubt) = running.unverified_effects.get(agent) else { return };
        let Some(word) = self.last_heartbeats.check_again(agent, doubt) else { return };
        let action =
            running.unverified_effects.remove(agent).map(|doubt| doubt.action).unwrap_or_default();
        match word {
            None => self.dispatch(token, ctx),
            Some(fact) => {
                let problem = format!("`{action}`: `{agent}` confirmed it, yet says `{fact}`");
                let report = Report { action: Some(action), ..failure(problem) };
                self.give_up(token, report, ctx);
            }
        }
    }

    /// Waits, after all steps of a plan are confirmed, for the next heartbeats of agents that confirmed
    /// a step although their last heartbeat contradicts it. The wait is at most as long as an agent may
    /// be silent.
    pub(crate) fn await_verification(&mut self, token: &ReplyToken, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        if running.verification_timer.is_some() {
            return;
        }
        let waiting = token.clone();
        let patience = ctx.settings().heartbeat_lease;
        running.verification_timer = Some(ctx.after(patience, move |executor: &mut Self, ctx| {
            if let Some(running) = executor.running_plans.get_mut(&waiting) {
                running.unverified_effects.clear();
            }
            executor.dispatch(&waiting, ctx);
        }));
    }

    /// Schedules a check of a plan. If an agent that the plan needs has left, the check waits for the
    /// grace, so that a short interruption of the network does not end the plan. News about agents that
    /// the plan does not need do not change this wait.
    fn schedule_check(
        &mut self,
        token: &ReplyToken,
        change: &EpochChange,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let needs = |agent: &AgentId| running.execution.needs(agent);
        let (is_gone, is_back) = (change.left.iter().any(needs), change.joined.iter().any(needs));
        if !is_gone && !is_back && running.grace_timer.is_some() {
            return;
        }
        let timers = [running.check_timer.take(), running.grace_timer.take()];
        timers.into_iter().flatten().for_each(|timer| ctx.cancel_timer(timer));
        if is_gone {
            running.state_query = None;
        }
        let checked = token.clone();
        let wait = if is_gone { ctx.settings().grace } else { SETTLE_DELAY };
        let check = ctx.after(wait, move |executor: &mut Self, ctx| {
            if is_gone && let Some(running) = executor.running_plans.get_mut(&checked) {
                // After the grace no news are on their way any more.
                (running.retries, running.grace_used) = (1, true);
            }
            executor.check(&checked, ctx);
        });
        let timer = if is_gone { &mut running.grace_timer } else { &mut running.check_timer };
        *timer = Some(check);
    }

    /// Asks the Domain Maintainer for the known state, to check the rest of a plan against this state.
    fn check(&mut self, token: &ReplyToken, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        (running.check_timer, running.grace_timer) = (None, None);
        if running.unconfirmed_changes > 0 {
            let again = token.clone();
            running.check_timer =
                Some(ctx.after(SETTLE_DELAY, move |executor: &mut Self, ctx| {
                    executor.check(&again, ctx)
                }));
            return;
        }
        let asked = ctx.ask(Resource::Domain, &self.domain_maintainer);
        let checked = token.clone();
        running.state_query = Some(ctx.run(asked, move |executor: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            if let Some(snapshot) = snapshot {
                executor.checked(&checked, &snapshot, ctx);
            }
        }));
    }

    fn checked(&mut self, token: &ReplyToken, snapshot: &Snapshot, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let is_needed_away = running.execution.needed().any(|agent| ctx.find(&agent).is_none());
        let is_somebody_away = self.departure_timer.is_some() || is_needed_away;
        // If a step was confirmed after the question was sent, the answer is older than the state known
        // here.
        let is_stale = running.unconfirmed_changes > 0;
        let renewed = if is_stale { Ok(()) } else { running.execution.revalidate(snapshot) };
        match renewed {
            Ok(()) if !is_stale => (running.retries, running.grace_used) = (0, false),
            // News have arrived since the question was sent: the next check decides.
            _ if running.check_timer.is_some() || running.grace_timer.is_some() => (),
            // An executor that took the plan over has not seen the needed agent leave, so no grace has
            // begun yet. If another agent has left, facts that it reported are missing.
            Err(_) if running.retries > 0 && !running.grace_used && is_somebody_away => {
                running.grace_used = true;
                let again = token.clone();
                let bear =
                    move |executor: &mut Self, ctx: &mut Context<Self>| executor.check(&again, ctx);
                running.grace_timer = Some(ctx.after(ctx.settings().grace, bear));
            }
            Err(problem) if running.retries > 0 => {
                let problem = format!("the rest of the plan does not reach the goal: {problem}");
                self.give_up(token, failure(problem), ctx);
            }
            _ => {
                running.retries = u32::from(!is_stale);
                let again = token.clone();
                running.check_timer =
                    Some(ctx.after(SETTLE_DELAY, move |executor: &mut Self, ctx| {
                        executor.check(&again, ctx)
                    }));
            }
        }
    }
}
