//! The rows of goals, plans and steps at one moment.

use std::collections::BTreeMap;

use acl::{AgentId, ConversationId};

use super::plan_record::{PlanRecord, StepRecord};
use super::{GoalStore, ObservedGoal};
use crate::moment::Moment;
use crate::moves::MoveSchemas;
use crate::rows::{
    CurrentStep, DueRow, GoalDetail, GoalRow, GoalStage, PlanDetail, StepRow, StepState,
};
use crate::usual_times::UsualTimes;

/// Moment of a goal by the clock that is not asked for again.
const NEVER: Moment = Moment(u64::MAX);

/// What the rows of goals need beside the goals: the moment, and the actions that move agents.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GoalTexts<'v> {
    pub(crate) now: Moment,
    pub(crate) moves: &'v MoveSchemas,
}

impl GoalStore {
    /// Returns all goals: those that are pursued first, the newest first; then those that wait for
    /// their times, the next one first; then those that have ended, the newest first.
    pub(crate) fn rows(&self, texts: GoalTexts<'_>) -> Vec<GoalRow> {
        let mut rows: Vec<_> =
            self.goals.iter().map(|(id, goal)| self.row(id, goal, texts)).collect();
        let next = |row: &GoalRow| row.due.as_ref().and_then(|due| due.next_at).unwrap_or(NEVER);
        let newest = |row: &GoalRow| row.ended_at.or(row.asked_at).unwrap_or(row.changed_at);
        rows.sort_by_key(|row| match row.stage {
            GoalStage::Scheduled => (1, next(row).0),
            stage => (if stage.has_ended() { 2 } else { 0 }, u64::MAX - newest(row).0),
        });
        rows
    }

    pub(crate) fn detail(&self, id: &ConversationId, texts: GoalTexts<'_>) -> Option<GoalDetail> {
        let goal = self.goals.get(id)?;
        let plans = goal.plans.iter().rev();
        Some(GoalDetail {
            row: self.row(id, goal, texts),
            history: goal.history.iter().cloned().collect(),
            plans: plans.map(|plan| plan_detail(plan, &self.times, texts)).collect(),
            calls: goal.calls.iter().rev().map(|(_, call)| call.detail()).collect(),
        })
    }

    fn row(&self, id: &ConversationId, goal: &ObservedGoal, texts: GoalTexts<'_>) -> GoalRow {
        let newest = goal.plans.back();
        let steps = newest.map(|plan| step_rows(plan, &self.times, texts)).unwrap_or_default();
        let running = || steps.iter().filter(|step| step.state == StepState::Running);
        let is_running = newest.is_some_and(|plan| plan.ended_at.is_none());
        let open = steps.iter().filter(|step| step.ended_at.is_none());
        let ends: Option<Vec<_>> = open.map(|step| step.expected_end).collect();
        GoalRow {
            conversation: id.clone(),
            number: goal.number,
            goal: goal.goal.clone(),
            requester: goal.requester.clone(),
            keep: goal.keep,
            priority: goal.priority,
            stage: goal.stage,
            phase: goal.phase,
            text: goal.describe(),
            asked_at: goal.asked_at,
            changed_at: goal.changed_at,
            ended_at: goal.ended_at,
            rounds: goal.rounds,
            steps: newest.map_or(0, |plan| plan.count),
            steps_done: newest.map_or(0, PlanRecord::done),
            cost: newest.and_then(|plan| plan.cost),
            now: running().map(|step| step.text.clone()).collect(),
            late_ms: running().filter_map(|step| step.late_ms).max(),
            expected_end: ends.filter(|_| is_running).and_then(|ends| ends.into_iter().max()),
            due: goal.due.clone(),
            is_of_file: id.opener().is_none(),
        }
    }

    /// Returns the steps that an agent carries out now.
    pub(crate) fn running_of(&self, agent: &AgentId, texts: GoalTexts<'_>) -> Vec<CurrentStep> {
        let keys = self.acting.get(agent).into_iter().flatten();
        let rows = keys.filter_map(|key| {
            let goal = self.goals.get(&key.conversation)?;
            let plan = goal.plans.iter().find(|plan| plan.number == key.plan)?;
            let record = plan.steps.get(&key.step)?;
            let row = step_row(key.step, record, &self.times, texts);
            Some(CurrentStep {
                step: row.step,
                text: row.text,
                conversation: Some(key.conversation.clone()),
                state: row.state,
                started_at: row.started_at?,
                usual_ms: row.usual_ms,
                late_ms: row.late_ms,
                detail: row.detail,
            })
        });
        rows.collect()
    }

    /// Whether an agent carries a step out now.
    pub(crate) fn is_acting(&self, agent: &AgentId) -> bool {
        self.acting.contains_key(agent)
    }

    /// Returns the number of steps that agents carry out now.
    pub(crate) fn running_count(&self) -> usize {
        self.acting.values().map(std::collections::BTreeSet::len).sum()
    }

    /// Returns the goals that an agent moves for, and the places that the remaining steps of their
    /// running plans lead through, in order; the first one is where it moves now, if it does.
    pub(crate) fn paths(
        &self,
        moves: &MoveSchemas,
    ) -> BTreeMap<String, (ConversationId, bool, Vec<String>)> {
        let mut paths: BTreeMap<String, (ConversationId, bool, Vec<String>)> = BTreeMap::new();
        for (id, goal) in self.goals.iter().filter(|(_, goal)| !goal.stage.has_ended()) {
            let Some(plan) = goal.plans.back().filter(|plan| plan.ended_at.is_none()) else {
                continue;
            };
            for record in plan.steps.values().filter(|record| !record.is_over()) {
                let Some((mover, place)) = moves.movement(&record.step) else { continue };
                let is_running = record.state == StepState::Running;
                let path = paths
                    .entry(mover.to_owned())
                    .or_insert_with(|| (id.clone(), is_running, Vec::new()));
                // The path of one goal; an agent moves for one goal at a time.
                if path.0 == *id {
                    path.2.push(place.to_owned());
                }
            }
        }
        paths
    }
}

impl ObservedGoal {
    fn describe(&self) -> String {
        let newest = self.plans.back();
        match self.stage {
            GoalStage::Unknown => self.text.clone(),
            GoalStage::Done if self.text.is_empty() => "reached".to_owned(),
            GoalStage::Done | GoalStage::Cancelled => self.text.clone(),
            GoalStage::Failed => format!("failed: {}", self.text),
            GoalStage::Holding => "holds".to_owned(),
            GoalStage::Scheduled => self.due.as_ref().map(next_time).unwrap_or_default(),
            GoalStage::Waiting if self.text.is_empty() => "waiting".to_owned(),
            GoalStage::Waiting => match self.text.strip_prefix("waiting: ") {
                Some(why) => format!("waiting: {why}"),
                None => format!("waiting: {}", self.text),
            },
            GoalStage::Planning => match self.phase {
                Some(phase) => phase.to_string(),
                None => "planning".to_owned(),
            },
            GoalStage::Running => match newest.filter(|plan| plan.count > 0) {
                Some(plan) => format!("executing: {} of {} steps done", plan.done(), plan.count),
                None => "executing".to_owned(),
            },
        }
    }
}

/// Returns when a goal by the clock is asked for next: `next: Thursday 08:00 (every day 08:00)`.
fn next_time(due: &DueRow) -> String {
    let next = match &due.next {
        Some(next) => format!("next: {next} ({})", due.words),
        None => format!("not asked for again ({})", due.words),
    };
    match &due.pursued {
        Some(pursued) => format!("{next}; now pursued as {pursued}"),
        None => next,
    }
}

fn plan_detail(plan: &PlanRecord, times: &UsualTimes, texts: GoalTexts<'_>) -> PlanDetail {
    let steps = step_rows(plan, times, texts);
    let begins_at = steps.iter().filter_map(|step| step.started_at).min().unwrap_or(plan.made_at);
    let ends = steps.iter().filter_map(|step| step.ended_at.or(step.expected_end));
    let ends_at = plan.ended_at.unwrap_or(texts.now).max(begins_at);
    let ends_at = match plan.ended_at {
        Some(_) => ends_at,
        None => ends.fold(ends_at, Moment::max),
    };
    let running = steps.iter().filter(|step| step.state == StepState::Running);
    let listed = u64::try_from(steps.len()).unwrap_or(u64::MAX);
    PlanDetail {
        term: plan.number.0,
        round: plan.number.1,
        cost: plan.cost,
        made_at: plan.made_at,
        ended_at: plan.ended_at,
        outcome: plan.outcome,
        ended_because: plan.because.clone(),
        more_steps: u64::from(plan.count).saturating_sub(listed),
        begins_at,
        ends_at,
        late_ms: running.filter_map(|step| step.late_ms).max(),
        steps,
    }
}

/// Returns the steps of a plan, with the expected times of those that have not ended: a step
/// begins when the one before it of the same agent ends, or else when all running steps end.
fn step_rows(plan: &PlanRecord, times: &UsualTimes, texts: GoalTexts<'_>) -> Vec<StepRow> {
    let mut rows: Vec<_> =
        plan.steps.iter().map(|(number, record)| step_row(*number, record, times, texts)).collect();
    if plan.ended_at.is_some() {
        return rows;
    }
    let running = rows.iter().filter(|row| row.state == StepState::Running);
    let running_end = running
        .map(|row| row.expected_end)
        .try_fold(texts.now, |latest, end| end.map(|end| latest.max(end)));
    let mut free: BTreeMap<Option<AgentId>, Option<Moment>> = BTreeMap::new();
    for row in &mut rows {
        let end = match row.state {
            StepState::Next => {
                let start = free.get(&row.agent).copied().unwrap_or(running_end);
                row.expected_start = start.map(|start| start.max(texts.now));
                row.expected_end =
                    row.expected_start.zip(row.usual_ms).map(|(start, usual)| start.plus(usual));
                row.expected_end
            }
            StepState::Running => row.expected_end,
            _ => row.ended_at,
        };
        free.insert(row.agent.clone(), end);
    }
    rows
}

fn step_row(number: u32, record: &StepRecord, times: &UsualTimes, texts: GoalTexts<'_>) -> StepRow {
    let step = &record.step;
    let agent = step.arguments.first().and_then(|name| AgentId::new(name).ok());
    let usual = times.usual(step);
    let usual_ms = usual.map(|usual| usual.ms);
    let taken = record.started_at.map(|start| record.ended_at.unwrap_or(texts.now).since(start));
    let is_running = record.state == StepState::Running;
    let expected_end = record.started_at.zip(usual_ms).filter(|_| is_running);
    StepRow {
        number,
        step: step.to_pddl(),
        text: texts.moves.sentence(step),
        action: step.action.clone(),
        arguments: step.arguments.iter().skip(usize::from(agent.is_some())).cloned().collect(),
        agent,
        state: record.state,
        started_at: record.started_at,
        ended_at: record.ended_at,
        expected_start: None,
        expected_end: expected_end.map(|(start, usual)| start.plus(usual).max(texts.now)),
        usual_ms,
        late_ms: taken.zip(usual).and_then(|(taken, usual)| usual.lateness(taken)),
        detail: record.detail.clone(),
    }
}
