//! Connects the state machine of a goal (the crate `goal-lifecycle`) with the Plan Requester: gives
//! events to the state machine and carries out its commands. No other module changes the phase of a
//! goal.

use std::time::Duration;

use acl::content::{Outcome, Report};
use acl::{ConversationId, Performative};
use agent::{Context, PlanningResult};
use goal_lifecycle::{GoalCommand, GoalEvent, Policy, Turn};

use crate::PlanRequester;
use crate::goal::{Goal, Work};

impl PlanRequester {
    /// Gives an event to the state machine of a goal, and carries out the commands that follow.
    pub(crate) fn handle(
        &mut self,
        id: &ConversationId,
        event: GoalEvent,
        ctx: &mut Context<Self>,
    ) {
        let (now, policy) = (self.elapsed(ctx), self.policy(ctx));
        let Some(goal) = self.goals.get_mut(id) else { return };
        let result = match event {
            GoalEvent::PlanFound(..) => PlanningResult::Found,
            GoalEvent::PlanMissing(..) => PlanningResult::Missing,
            _ => PlanningResult::Abandoned,
        };
        let before = goal.state.phase();
        let commands = goal.state.handle(event, now, policy);
        let track = || ctx.activity().track_goal(before);
        goal.tracked.get_or_insert_with(track).move_to(goal.state.phase(), result);
        self.carry_out(id, commands, ctx);
    }

    /// Carries out the commands of a goal in order.
    pub(crate) fn carry_out(
        &mut self,
        id: &ConversationId,
        commands: Vec<GoalCommand>,
        ctx: &mut Context<Self>,
    ) {
        for command in commands {
            self.obey(id, command, ctx);
        }
        if let Some(goal) = self.goals.get_mut(id) {
            goal.drop_ended_work();
        }
    }

    fn obey(&mut self, id: &ConversationId, command: GoalCommand, ctx: &mut Context<Self>) {
        match command {
            GoalCommand::Consider => self.consider(id, ctx),
            GoalCommand::ConsiderAfter(wait) => self.consider_after(id, wait, ctx),
            GoalCommand::StopTimer => self.stop_timer(id, ctx),
            GoalCommand::FetchDomain(attempt) => self.fetch_domain(id, attempt, ctx),
            GoalCommand::Plan(attempt) => self.plan(id, attempt, ctx),
            GoalCommand::Explain(attempt) => self.explain_missing_plan(id, attempt, ctx),
            GoalCommand::RejectProposals(why) => self.reject_proposals(id, why, ctx),
            GoalCommand::Execute(attempt) => self.execute(id, attempt, ctx),
            GoalCommand::RequestExecution(attempt) => self.ask_executor(id, attempt, ctx),
            GoalCommand::AdoptRunningPlan => self.adopt_running_plan(id, ctx),
            GoalCommand::CancelExecution => self.cancel_execution(id, ctx),
            GoalCommand::CancelPlanning => self.cancel_planning(id, ctx),
            GoalCommand::Verify(attempt, wait) => self.verify(id, attempt, wait, ctx),
            GoalCommand::ForgetPlan => {
                let plan = self.goals.get_mut(id).and_then(|goal| goal.plan.take());
                if plan.is_some() {
                    // A replica that takes over does not need this plan any more.
                    self.forget_plan(id, ctx);
                }
            }
            GoalCommand::ReleaseAgents => self.release_agents(id, ctx),
            GoalCommand::Preempt(others) => self.preempt(id, &others, ctx),
            GoalCommand::ScheduleNext => self.schedule_next(ctx),
            GoalCommand::Report(report) => self.send_report(id, report, ctx),
            GoalCommand::End(outcome, detail) => self.end(id, outcome, detail, ctx),
            GoalCommand::Abandon => self.abandon(id, ctx),
        }
    }

    /// Returns the time since the first call of this function. The times in the goals' states are
    /// counted from that call.
    pub(crate) fn elapsed(&mut self, ctx: &Context<Self>) -> Duration {
        let now = ctx.now();
        now - *self.began_at.get_or_insert(now)
    }

    fn policy(&self, ctx: &Context<Self>) -> Policy {
        Policy { is_replanning: self.config.replanning, grace: ctx.settings().grace }
    }

    /// Considers a goal: if it may be planned for, compares it with the known state.
    pub(crate) fn consider(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let turn = Turn {
            missing_quorum: self.missing_quorum(id, ctx),
            is_planning_busy: self.is_planning_busy(),
            agents_in_use: self.agents_in_use(id),
        };
        self.handle(id, GoalEvent::Considered(turn), ctx);
    }

    fn consider_after(&mut self, id: &ConversationId, wait: Duration, ctx: &mut Context<Self>) {
        let considered = id.clone();
        let timer = ctx.after(wait, move |requester: &mut Self, ctx| {
            if let Some(goal) = requester.goals.get_mut(&considered) {
                goal.timer = None;
            }
            requester.consider(&considered, ctx);
        });
        let former = self.goals.get_mut(id).and_then(|goal| goal.timer.replace(timer));
        former.into_iter().for_each(|former| ctx.cancel_timer(former));
    }

    fn stop_timer(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let timer = self.goals.get_mut(id).and_then(|goal| goal.timer.take());
        timer.into_iter().for_each(|timer| ctx.cancel_timer(timer));
    }

    fn cancel_execution(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(Goal { work: Work::Execution(token), .. }) = self.goals.get(id) else { return };
        let executor = &self.config.plan_executor;
        ctx.send_turn(token, executor, Performative::Cancel, serde_json::Value::Null);
        ctx.extend(token, ctx.settings().answer_deadline * 2);
    }

    fn cancel_planning(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(Goal { work: Work::Planning(token), .. }) = self.goals.get(id) else { return };
        let planner = &self.config.planning_agent;
        ctx.send_turn(token, planner, Performative::Cancel, serde_json::Value::Null);
        ctx.close(token);
    }

    /// Sends the outcome of a goal to its initiator, and records the outcome in the Journals.
    fn end(
        &mut self,
        id: &ConversationId,
        outcome: Outcome,
        detail: String,
        ctx: &mut Context<Self>,
    ) {
        let report = Report::new(outcome, detail);
        self.send_report(id, report.clone(), ctx);
        self.reject_proposals(id, "the goal has ended", ctx);
        self.stop_timer(id, ctx);
        let Some(goal) = self.goals.remove(id) else { return };
        ctx.activity().count_goal(outcome);
        let history = goal.history().to_vec();
        self.ended.store_sent(goal.participation.clone(), Report { history, ..report.clone() });
        self.replicate_outcome(&goal, report, ctx);
    }

    /// Drops the work for a goal that another replica pursues.
    fn abandon(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        self.reject_proposals(id, "another replica takes the goal over", ctx);
        if let Some(Goal { work: Work::Planning(token) | Work::Execution(token), .. }) =
            self.goals.get(id)
        {
            ctx.close(token);
        }
    }

    /// Removes a goal from this replica without ending it.
    pub(crate) fn remove_goal(
        &mut self,
        id: &ConversationId,
        event: GoalEvent,
        ctx: &mut Context<Self>,
    ) {
        self.handle(id, event, ctx);
        self.stop_timer(id, ctx);
        self.goals.remove(id);
    }
}
