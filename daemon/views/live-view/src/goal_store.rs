//! The goals, with the plans and the calls for proposals of each.
//!
//! Messages of the protocols of goals, planning, contract net, execution and action say what
//! happens; the answer to a query for the goals says how each stands. An observer may come late or
//! miss messages, so a message about an unknown goal, plan or step makes it known.

mod call_record;
mod goal_rows;
mod plan_record;
mod statuses;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use acl::content::{
    Achieve, Act, Bid, CallForProposals, Choice, Execute, GoalPhase, Keep, Outcome, Report,
};
use acl::{AgentId, ConversationId, ReplyToken};

use self::call_record::CallRecord;
pub(crate) use self::goal_rows::GoalTexts;
use self::plan_record::{PlanNumber, PlanRecord, StepRecord, parse_plan, steps_of};
use crate::bounded::BoundedMap;
use crate::moment::{Moment, ViewLimits};
use crate::rows::{DueRow, GoalHistoryRow, GoalStage, StepState};
use crate::text::{GroundStep, short};
use crate::usual_times::UsualTimes;

/// Maximum number of open exchanges that are followed.
const EXCHANGES_MAX: usize = 20_000;

/// A step of a plan of a goal.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct StepKey {
    pub(crate) conversation: ConversationId,
    pub(crate) plan: PlanNumber,
    pub(crate) step: u32,
}

/// What an exchange is about.
#[derive(Clone, Debug)]
enum ExchangeSubject {
    Execution(ConversationId, PlanNumber),
    Step(StepKey),
    /// A call for proposals of the goal, by its number.
    Call(ConversationId, u64),
}

#[derive(Clone, Debug)]
struct ObservedGoal {
    number: Option<u32>,
    goal: String,
    /// Whether a person requested one action, and no goal.
    is_action: bool,
    requester: Option<AgentId>,
    keep: Option<Keep>,
    priority: i32,
    stage: GoalStage,
    phase: Option<GoalPhase>,
    text: String,
    asked_at: Option<Moment>,
    changed_at: Moment,
    ended_at: Option<Moment>,
    /// Whether the goal counts as ended only because a query does not list it.
    is_presumed_over: bool,
    /// The times of a goal by the clock, as the Plan Requester tells them.
    due: Option<DueRow>,
    /// Whether the request was refused: the goal was never accepted.
    is_refused: bool,
    rounds: u32,
    history: VecDeque<GoalHistoryRow>,
    /// The plans, oldest first.
    plans: VecDeque<PlanRecord>,
    /// The calls for proposals with their numbers, oldest first.
    calls: VecDeque<(u64, CallRecord)>,
    /// Bytes of the goal as the store counts them.
    counted_bytes: usize,
}

impl ObservedGoal {
    fn new(at: Moment) -> ObservedGoal {
        ObservedGoal {
            number: None,
            goal: String::new(),
            is_action: false,
            requester: None,
            keep: None,
            priority: 0,
            stage: GoalStage::Unknown,
            phase: None,
            text: String::new(),
            asked_at: None,
            changed_at: at,
            ended_at: None,
            is_presumed_over: false,
            due: None,
            is_refused: false,
            rounds: 0,
            history: VecDeque::new(),
            plans: VecDeque::new(),
            calls: VecDeque::new(),
            counted_bytes: 0,
        }
    }

    /// Returns the bytes of the goal with its plans and calls, roughly.
    fn bytes(&self) -> usize {
        const WITHOUT_TEXT: usize = 1_000;
        let plans = self.plans.iter().map(|plan| plan.bytes);
        let calls = self.calls.iter().map(|(_, call)| call.bytes);
        let history = self.history.iter().map(|row| row.text.len());
        WITHOUT_TEXT + plans.chain(calls).chain(history).sum::<usize>()
    }

    fn enter(&mut self, at: Moment, stage: GoalStage) {
        self.changed_at = at;
        if !self.stage.has_ended() {
            self.stage = stage;
            self.phase = None;
        }
    }

    fn end(&mut self, at: Moment, stage: GoalStage, text: String) {
        self.changed_at = at;
        self.stage = stage;
        self.phase = None;
        self.text = text;
        self.ended_at.get_or_insert(at);
        let outcome = match stage {
            GoalStage::Done => Outcome::Done,
            GoalStage::Failed => Outcome::Failed,
            _ => Outcome::Cancelled,
        };
        self.plans.iter_mut().for_each(|plan| plan.end(at, outcome, ""));
    }

    fn remember(&mut self, row: GoalHistoryRow, rows_max: usize) {
        self.history.push_back(row);
        while self.history.len() > rows_max {
            self.history.pop_front();
        }
    }

    fn plan(&mut self, number: PlanNumber) -> Option<&mut PlanRecord> {
        self.plans.iter_mut().rev().find(|plan| plan.number == number && !plan.is_sketch)
    }

    /// Returns a plan, a new one if it was not known. A new plan ends the ones before it.
    fn plan_or_new(&mut self, at: Moment, number: PlanNumber, plans_max: usize) -> &mut PlanRecord {
        let known = self.plans.iter().position(|plan| plan.number == number && !plan.is_sketch);
        let index = known.unwrap_or_else(|| {
            let newest = self.plans.iter().map(|plan| plan.number).max();
            let mut plan = PlanRecord::new(at, number);
            if newest.is_some_and(|newest| newest > number) {
                plan.end(at, Outcome::Cancelled, "a newer plan takes its place");
            } else {
                let because = "a newer plan takes its place";
                self.plans.iter_mut().for_each(|plan| plan.end(at, Outcome::Cancelled, because));
            }
            self.plans.push_back(plan);
            while self.plans.len() > plans_max.max(1) {
                self.plans.pop_front();
            }
            self.plans.len() - 1
        });
        &mut self.plans[index]
    }
}

#[derive(Clone, Debug)]
pub(crate) struct GoalStore {
    goals: BoundedMap<ConversationId, ObservedGoal>,
    /// The goals that have ended, the first one first.
    ended: BTreeSet<(Moment, ConversationId)>,
    exchanges: BoundedMap<ReplyToken, ExchangeSubject>,
    /// The steps that each agent carries out.
    acting: BTreeMap<AgentId, BTreeSet<StepKey>>,
    pub(crate) times: UsualTimes,
    limits: ViewLimits,
    next_call: u64,
    /// Bytes of all goals, roughly.
    bytes: usize,
}

impl GoalStore {
    pub(crate) fn new(limits: &ViewLimits) -> GoalStore {
        GoalStore {
            goals: BoundedMap::new(limits.goals),
            ended: BTreeSet::new(),
            exchanges: BoundedMap::new(EXCHANGES_MAX),
            acting: BTreeMap::new(),
            times: UsualTimes::new(limits.measured_actions),
            limits: limits.clone(),
            next_call: 0,
            bytes: 0,
        }
    }

    /// Returns the record of a goal, a new one if it was not known. If the limit is reached, the
    /// goal that ended first is dropped, or else the oldest one.
    fn entry(&mut self, at: Moment, id: &ConversationId) -> &mut ObservedGoal {
        self.revive(id);
        if !self.goals.contains(id) {
            if self.goals.is_full() {
                self.drop_oldest(id);
            }
            self.goals.insert(id.clone(), ObservedGoal::new(at));
        }
        self.goals.get_mut(id).expect("invariant: it was inserted above if it was not there")
    }

    /// Takes a goal as under way again that was not listed once: another replica may have answered.
    fn revive(&mut self, id: &ConversationId) {
        let Some(goal) = self.goals.get_mut(id).filter(|goal| goal.is_presumed_over) else {
            return;
        };
        goal.is_presumed_over = false;
        goal.stage = GoalStage::Unknown;
        if let Some(ended_at) = goal.ended_at.take() {
            self.ended.remove(&(ended_at, id.clone()));
        }
    }

    /// Drops the goal that ended first, or else the oldest one, but not `kept`. Returns whether there
    /// was one.
    fn drop_oldest(&mut self, kept: &ConversationId) -> bool {
        let ended = self.ended.iter().map(|(_, id)| id).find(|id| *id != kept);
        let oldest = || self.goals.oldest_first().find(|id| *id != kept);
        let Some(dropped) = ended.or_else(oldest).cloned() else { return false };
        if let Some(goal) = self.goals.remove(&dropped) {
            self.bytes -= goal.counted_bytes;
            if let Some(ended_at) = goal.ended_at {
                self.ended.remove(&(ended_at, dropped.clone()));
            }
        }
        self.acting.retain(|_, steps| {
            steps.retain(|key| key.conversation != dropped);
            !steps.is_empty()
        });
        true
    }

    /// Counts the bytes of a goal anew, and drops others until the limit is kept.
    fn settle(&mut self, id: &ConversationId) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let bytes = goal.bytes();
        self.bytes = self.bytes - goal.counted_bytes + bytes;
        goal.counted_bytes = bytes;
        while self.bytes > self.limits.goals_bytes && self.drop_oldest(id) {}
    }

    fn end(&mut self, at: Moment, id: &ConversationId, stage: GoalStage, text: String) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        if goal.ended_at.is_none() {
            self.ended.insert((at, id.clone()));
        }
        goal.end(at, stage, text);
        self.forget_acting(id);
        self.settle(id);
    }

    /// Drops the goal's steps that are over from the lists of what agents do.
    fn forget_acting(&mut self, id: &ConversationId) {
        let Some(goal) = self.goals.get(id) else { return };
        let runs = |key: &StepKey| {
            let plan = goal.plans.iter().find(|plan| plan.number == key.plan);
            let step = plan.and_then(|plan| plan.steps.get(&key.step));
            step.is_some_and(|step| step.state == StepState::Running)
        };
        self.acting.retain(|_, steps| {
            steps.retain(|key| key.conversation != *id || runs(key));
            !steps.is_empty()
        });
    }

    /// Returns the goal of a conversation as text; empty if it is not known.
    pub(crate) fn goal_text(&self, id: &ConversationId) -> &str {
        self.goals.get(id).map_or("", |goal| goal.goal.as_str())
    }

    /// Whether a goal is known to hold.
    pub(crate) fn holds(&self, id: &ConversationId) -> bool {
        self.goals.get(id).is_some_and(|goal| goal.stage == GoalStage::Holding)
    }

    /// Whether the request of a goal was observed.
    pub(crate) fn was_asked(&self, id: &ConversationId) -> bool {
        self.goals.get(id).is_some_and(|goal| goal.asked_at.is_some())
    }

    // === the protocol of goals ===

    /// Takes the request of a goal. Returns whether it is new.
    pub(crate) fn achieve(
        &mut self,
        at: Moment,
        id: &ConversationId,
        requester: &AgentId,
        achieve: &Achieve,
    ) -> bool {
        let text = short(&achieve.goal, self.limits.text_bytes);
        let goal = self.entry(at, id);
        let is_new = goal.asked_at.is_none();
        goal.goal = text;
        goal.requester = Some(requester.clone());
        goal.keep = Some(achieve.keep);
        goal.priority = achieve.priority;
        goal.asked_at.get_or_insert(at);
        if goal.stage == GoalStage::Unknown {
            goal.enter(at, GoalStage::Planning);
        }
        is_new
    }

    /// Takes a report of the Plan Requester about a goal.
    pub(crate) fn goal_report(&mut self, at: Moment, id: &ConversationId, report: &Report) {
        let (history_max, plans_max) = (self.limits.history_per_goal, self.limits.plans_per_goal);
        let (steps_max, text_bytes) = (self.limits.steps_per_plan, self.limits.text_bytes);
        let detail = short(&report.detail, text_bytes);
        let goal = self.entry(at, id);
        if goal.ended_at.is_none() {
            let outcome = Some(report.outcome);
            goal.remember(GoalHistoryRow { at, outcome, text: detail.clone() }, history_max);
        }
        match report.outcome {
            Outcome::Done => return self.end(at, id, GoalStage::Done, detail),
            Outcome::Failed => return self.end(at, id, GoalStage::Failed, detail),
            Outcome::Cancelled => return self.end(at, id, GoalStage::Cancelled, detail),
            Outcome::Holds => {
                goal.enter(at, GoalStage::Holding);
                goal.plans.iter_mut().for_each(|plan| plan.end(at, Outcome::Done, ""));
            }
            Outcome::Progress if goal.stage.has_ended() => return,
            Outcome::Progress => match stage_of_progress(&detail) {
                Some(stage) => goal.enter(at, stage),
                None => goal.changed_at = at,
            },
        }
        goal.text = detail;
        if let Some(plan) = &report.plan {
            goal.sketch(at, parse_plan(plan, text_bytes), report.cost, (plans_max, steps_max));
        }
        self.forget_acting(id);
        self.settle(id);
    }

    /// Takes the refusal of a goal.
    pub(crate) fn goal_refused(&mut self, at: Moment, id: &ConversationId, why: &str) {
        let why = short(why, self.limits.text_bytes);
        if let Some(goal) = self.goals.get_mut(id) {
            goal.is_refused = true;
            self.end(at, id, GoalStage::Failed, why);
        }
    }

    /// Whether the request of a goal was refused, so that nobody has ever pursued it.
    pub(crate) fn was_refused(&self, id: &ConversationId) -> bool {
        self.goals.get(id).is_some_and(|goal| goal.is_refused)
    }

    /// Notes that a goal is being planned for, in the phase `phase`.
    pub(crate) fn planning(&mut self, at: Moment, id: &ConversationId, phase: GoalPhase) {
        let goal = self.entry(at, id);
        goal.enter(at, GoalStage::Planning);
        goal.phase = Some(phase).filter(|_| !goal.stage.has_ended());
    }

    // === the contract net ===

    pub(crate) fn call(
        &mut self,
        at: Moment,
        id: &ConversationId,
        token: &ReplyToken,
        content: &CallForProposals,
        called: Option<&AgentId>,
    ) {
        self.planning(at, id, GoalPhase::CollectingProposals);
        self.next_call += 1;
        let number = self.next_call;
        let call = CallRecord::new(at, content, called.cloned(), &self.limits);
        self.exchanges.insert(token.clone(), ExchangeSubject::Call(id.clone(), number));
        let calls_max = self.limits.calls_per_goal;
        let goal = self.entry(at, id);
        goal.calls.push_back((number, call));
        while goal.calls.len() > calls_max {
            goal.calls.pop_front();
        }
        self.settle(id);
    }

    fn called(&mut self, token: &ReplyToken) -> Option<&mut CallRecord> {
        let Some(ExchangeSubject::Call(id, number)) = self.exchanges.get(token) else {
            return None;
        };
        let goal = self.goals.get_mut(id)?;
        goal.calls.iter_mut().find(|(of, _)| of == number).map(|(_, call)| call)
    }

    /// Takes the answer to a call for proposals: a bid, or the reason of a refusal.
    pub(crate) fn bid(
        &mut self,
        at: Moment,
        token: &ReplyToken,
        agent: &AgentId,
        answer: Result<&Bid, &str>,
    ) {
        let limits = self.limits.clone();
        if let Some(call) = self.called(token) {
            call.answer(at, agent, answer, &limits);
        }
        if let Some(ExchangeSubject::Call(id, _)) = self.exchanges.get(token).cloned() {
            self.settle(&id);
        }
    }

    /// Takes the choice that some bidders are told.
    pub(crate) fn choice(
        &mut self,
        at: Moment,
        token: &ReplyToken,
        agents: &[AgentId],
        (choice, is_accepted): (Option<&Choice>, bool),
    ) {
        let text_bytes = self.limits.text_bytes;
        let Some(call) = self.called(token) else { return };
        for agent in agents {
            call.choose(at, agent, choice, is_accepted, text_bytes);
        }
    }

    // === the execution of plans ===

    /// Takes the request to execute a plan. `goal` is the goal of its problem, which is asked for
    /// only if the goal is not known.
    pub(crate) fn execute(
        &mut self,
        at: Moment,
        id: &ConversationId,
        (token, requester): (Option<&ReplyToken>, &AgentId),
        execute: &Execute,
    ) {
        let number = (execute.term, execute.round);
        let (plans_max, steps_max) = (self.limits.plans_per_goal, self.limits.steps_per_plan);
        let text_bytes = self.limits.text_bytes;
        if let Some(token) = token {
            let subject = ExchangeSubject::Execution(id.clone(), number);
            self.exchanges.insert(token.clone(), subject);
        }
        let steps = steps_of(execute, text_bytes);
        let goal = self.entry(at, id);
        if goal.goal.is_empty() {
            let wanted = goal_of(&execute.problem);
            goal.is_action = wanted.is_none() && execute.term == 0;
            let first = steps.first().map(GroundStep::to_pddl);
            let text = wanted.or(first.filter(|_| goal.is_action)).unwrap_or_default();
            goal.goal = short(&text, text_bytes);
        }
        if goal.is_action {
            goal.requester = Some(requester.clone());
            goal.asked_at.get_or_insert(at);
        }
        goal.enter(at, GoalStage::Running);
        goal.rounds = goal.rounds.max(execute.round);
        goal.adopt_sketch(number, &steps);
        let plan = goal.plan_or_new(at, number, plans_max);
        plan.set_steps(steps, steps_max);
        for done in &execute.done {
            if let Some(step) = plan.steps.get_mut(done).filter(|step| !step.is_over()) {
                step.end(at, StepState::Done);
            }
        }
        self.forget_acting(id);
        self.settle(id);
    }

    /// Takes a report of the Plan Executor about a plan.
    pub(crate) fn execution_report(&mut self, at: Moment, token: &ReplyToken, report: &Report) {
        let Some(ExchangeSubject::Execution(id, number)) = self.exchanges.get(token).cloned()
        else {
            return;
        };
        let text_bytes = self.limits.text_bytes;
        let Some(goal) = self.goals.get_mut(&id) else { return };
        let Some(plan) = goal.plan(number) else { return };
        let detail = short(&report.detail, text_bytes);
        if let Some(step) = report.step.and_then(|step| plan.steps.get_mut(&step)) {
            if !step.is_over() {
                step.end(at, StepState::Done);
            }
            if step.detail.is_empty() {
                step.detail = detail;
            }
        } else if report.outcome.is_final() {
            plan.end(at, report.outcome, &detail);
            self.after_plan(at, &id, report.outcome, detail);
        }
        self.forget_acting(&id);
    }

    /// Takes the refusal of a plan.
    pub(crate) fn execution_refused(&mut self, at: Moment, token: &ReplyToken, why: &str) {
        let Some(ExchangeSubject::Execution(id, number)) = self.exchanges.remove(token) else {
            return;
        };
        let why = short(why, self.limits.text_bytes);
        if let Some(plan) = self.goals.get_mut(&id).and_then(|goal| goal.plan(number)) {
            plan.end(at, Outcome::Failed, &why);
        }
        self.after_plan(at, &id, Outcome::Failed, why);
        self.forget_acting(&id);
    }

    /// Updates a goal whose plan has ended. An action that a person requested has no goal, so it
    /// ends with its plan.
    fn after_plan(&mut self, at: Moment, id: &ConversationId, outcome: Outcome, detail: String) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        if goal.is_action {
            let stage = match outcome {
                Outcome::Done => GoalStage::Done,
                Outcome::Cancelled => GoalStage::Cancelled,
                _ => GoalStage::Failed,
            };
            return self.end(at, id, stage, detail);
        }
        if goal.stage == GoalStage::Running {
            goal.enter(at, GoalStage::Planning);
            goal.phase = Some(GoalPhase::Verifying).filter(|_| outcome == Outcome::Done);
        }
    }

    /// Takes the request to an agent to carry out a step.
    pub(crate) fn act(
        &mut self,
        at: Moment,
        act: &Act,
        (agent, token): (&AgentId, Option<&ReplyToken>),
    ) -> GroundStep {
        let ground = GroundStep::parse(&short(&act.action, self.limits.text_bytes));
        let id = &act.token.conversation;
        let key = StepKey {
            conversation: id.clone(),
            plan: (act.token.term, act.token.round),
            step: act.token.step,
        };
        let (plans_max, steps_max) = (self.limits.plans_per_goal, self.limits.steps_per_plan);
        let goal = self.entry(at, id);
        if goal.stage != GoalStage::Running {
            goal.enter(at, GoalStage::Running);
        }
        let plan = goal.plan_or_new(at, key.plan, plans_max);
        let Some(step) = plan.step(key.step, &ground, steps_max) else { return ground };
        step.step = ground.clone();
        if !step.is_over() {
            step.state = StepState::Running;
            step.started_at.get_or_insert(at);
            let acting = self.acting.entry(agent.clone()).or_default();
            acting.insert(key.clone());
        }
        if let Some(token) = token {
            self.exchanges.insert(token.clone(), ExchangeSubject::Step(key));
        }
        self.settle(id);
        ground
    }

    /// Takes what an agent reports about a step: its state, and a text.
    pub(crate) fn step_report(
        &mut self,
        at: Moment,
        (token, agent): (&ReplyToken, &AgentId),
        state: StepState,
        detail: &str,
    ) -> Option<GroundStep> {
        let Some(ExchangeSubject::Step(key)) = self.exchanges.get(token).cloned() else {
            return None;
        };
        let detail = short(detail, self.limits.text_bytes);
        let goal = self.goals.get_mut(&key.conversation)?;
        let plan = goal.plan(key.plan)?;
        let step: &mut StepRecord = plan.steps.get_mut(&key.step)?;
        if !detail.is_empty() {
            step.detail = detail;
        }
        let ground = step.step.clone();
        if state == StepState::Running {
            return Some(ground);
        }
        // The Plan Executor may have reported the end first; the agent's own report is more exact.
        let is_confirmed = step.state == state && step.ended_at.is_some();
        // What others report of a joint action that one agent has failed or refused changes nothing.
        let has_failed = matches!(step.state, StepState::Failed | StepState::Refused)
            && matches!(state, StepState::Cancelled | StepState::Done);
        if !is_confirmed && !has_failed {
            step.end(at, state);
        }
        if state != StepState::Cancelled && !std::mem::replace(&mut step.is_timed, true) {
            let ended_at = step.ended_at.unwrap_or(at);
            let took_ms = step.started_at.map(|started| ended_at.since(started));
            self.times.add(&ground, took_ms, state == StepState::Done);
        }
        self.exchanges.remove(token);
        if let Some(acting) = self.acting.get_mut(agent) {
            acting.remove(&key);
            if acting.is_empty() {
                self.acting.remove(agent);
            }
        }
        Some(ground)
    }
}

impl ObservedGoal {
    /// Takes a plan of which only the report to the user is known.
    fn sketch(
        &mut self,
        at: Moment,
        steps: Vec<GroundStep>,
        cost: Option<f64>,
        (plans_max, steps_max): (usize, usize),
    ) {
        if let Some(newest) = self.plans.back_mut()
            && (newest.has_steps(&steps) || newest.cost.is_none() && newest.steps.is_empty())
        {
            newest.cost = cost;
            return;
        }
        let (term, round) = self.plans.back().map_or((0, 0), |plan| plan.number);
        let plan = self.plan_or_new(at, (term, round.saturating_add(1)), plans_max);
        plan.is_sketch = true;
        plan.cost = cost;
        plan.set_steps(steps, steps_max);
        self.enter(at, GoalStage::Running);
        self.rounds = self.rounds.saturating_add(1);
    }

    /// Gives the newest plan its number, if only a report about it was known.
    fn adopt_sketch(&mut self, number: PlanNumber, steps: &[GroundStep]) {
        if let Some(newest) = self.plans.back_mut()
            && newest.is_sketch
            && newest.has_steps(steps)
        {
            newest.is_sketch = false;
            newest.number = number;
        }
    }
}

/// Returns the stage of a goal about which the Plan Requester reports this; `None` if the report
/// does not tell.
fn stage_of_progress(detail: &str) -> Option<GoalStage> {
    let begins = |word: &str| detail.starts_with(word);
    if begins("waiting") || begins("no plan now") {
        Some(GoalStage::Waiting)
    } else if begins("planning anew") {
        Some(GoalStage::Planning)
    } else {
        None
    }
}

/// Returns the goal of a problem; `None` if it has none.
fn goal_of(problem: &str) -> Option<String> {
    let problem = pddl::parse_problem(problem).value?;
    Some(problem.goal).filter(|goal| !goal.is_always()).map(|goal| goal.to_string())
}
