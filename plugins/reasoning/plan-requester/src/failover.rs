//! Fail-over of goals from one replica of the Plan Requester to another (docs/design.md,
//! “Fail-over”).
//!
//! - The Journals keep a record of each goal, `goal/CONVERSATION`, and a record of its plan while
//!   the plan runs, `plan/CONVERSATION`. A goal is accepted when its record is on the disks of this
//!   machine and of one other reachable machine. The initiator receives the names of the Journals
//!   that have the record.
//! - A new leader resumes every goal from these records. It requests the plan that was running from
//!   the executor, with the steps that are known to be done. A running step is not started again.
//! - When a partition ends, both sides may have pursued the same goal. The merge rule is: (1) an
//!   end on either side is final; (2) the surviving leader keeps its own state of the goal, unless
//!   only the other side has a running plan; (3) the losing plan is given up: no executor continues
//!   its steps, and therefore their actuators end them.

use std::collections::BTreeMap;

use acl::content::{
    Achieve, Execute, GoalPhase, HistoryEntry, Outcome, Partition, Record, Report, Version, value,
};
use acl::{AgentId, ConversationId, Incarnation, Performative};
use agent::replication::{self, JournalClient, ReplicatesRecords, ReplicationOutcome};
use agent::{Context, Participation, Resident};
use goal_lifecycle::{FailedAction, GoalEvent, GoalState, SETTLE_DELAY, holding};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::PlanRequester;
use crate::due_goal::{DUE, GoalLimits};
use crate::goal::Goal;

const GOAL: &str = "goal/";
const PLAN: &str = "plan/";

/// Record of a goal, in the form in which it is replicated to the Journals.
#[derive(Debug, Serialize, Deserialize)]
struct GoalRecord {
    #[serde(alias = "engagement")]
    participation: Participation,
    /// Incarnation of the initiator that asked for the goal.
    #[serde(alias = "life")]
    incarnation: Incarnation,
    asked: Achieve,
    /// Number of the goal, by which people name it; 0 in records of older versions of Althing.
    #[serde(default)]
    number: u32,
    rounds: u32,
    failures: u32,
    /// Actions that failed in earlier plans of the goal, or that a person has forbidden.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    failed: Vec<FailedActionRecord>,
    /// Identifier of the running plan of the goal; `None` if no plan runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    running: Option<RunningPlanId>,
    /// Times at which the goal is late or given up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    limits: Option<GoalLimits>,
    /// History of the goal, oldest entry first. Empty in records of older versions of Althing.
    #[serde(default)]
    happened: Vec<HistoryEntry>,
    /// Whether the goal is being cancelled. The agent that requested the cancellation has received
    /// the confirmation.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    cancelled: bool,
    /// The final report about the goal; `None` if the goal has not ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ended: Option<Report>,
}

/// Record of a failed action, so that the next leader neither tries it again too soon nor asks a person
/// again that has forbidden it.
#[derive(Debug, Serialize, Deserialize)]
struct FailedActionRecord {
    agent: AgentId,
    action: String,
    times: u32,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    refused: bool,
    #[serde(default)]
    why: String,
}

#[derive(Debug, Serialize, Deserialize)]
struct RunningPlanId {
    term: u64,
    round: u32,
    /// Indices of the plan's steps that are known to be done.
    done: Vec<u32>,
}

impl ReplicatesRecords for PlanRequester {
    fn journal_client(&mut self) -> &mut JournalClient<Self> {
        &mut self.journal_client
    }

    fn records_restored(&mut self, records: Vec<Record>, ctx: &mut Context<Self>) {
        self.merge_records(records, true, ctx);
    }
}

impl PlanRequester {
    /// Merges records with what this replica knows. They are those of the Journals if
    /// `are_of_journals`, otherwise those of another leader, which stands down.
    pub(crate) fn merge_records(
        &mut self,
        records: Vec<Record>,
        are_of_journals: bool,
        ctx: &mut Context<Self>,
    ) {
        let (due, records): (Vec<_>, Vec<_>) =
            records.into_iter().partition(|record| record.key.starts_with(DUE));
        let (goals, others): (Vec<_>, Vec<_>) =
            records.into_iter().partition(|record| record.key.starts_with(GOAL));
        let mut plans: BTreeMap<String, Execute> = BTreeMap::new();
        for Record { key, body, .. } in others {
            let conversation = key.strip_prefix(PLAN).map(ToOwned::to_owned);
            plans.extend(conversation.and_then(|id| Some((id, Execute::deserialize(body).ok()?))));
        }
        // Ended goals keep their numbers too, so that no number names two goals.
        let numbered = goals.iter().chain(&due);
        let numbers = numbered.filter_map(|record| record.body.get("number")?.as_u64());
        for number in numbers.filter_map(|number| u32::try_from(number).ok()) {
            self.numbers.note(number);
        }
        if are_of_journals {
            self.numbers.open();
        }
        for Record { key, version, body } in goals {
            if body.is_null() {
                continue;
            }
            match GoalRecord::deserialize(body) {
                Ok(record) => {
                    let plan = plans.remove(key.trim_start_matches(GOAL));
                    self.resume(record, version, plan, ctx);
                }
                Err(error) => tracing::warn!(key, %error, "a goal record cannot be read"),
            }
        }
        // The remaining plans belong to goals without a record.
        for (id, plan) in plans {
            let id = ConversationId::new(&id);
            self.cancel_orphan(&id, &plan, 0, ctx);
            self.forget_plan(&id, ctx);
        }
        due.into_iter().for_each(|record| self.restore_due(record, ctx));
        if are_of_journals {
            self.journals_read(ctx);
            self.read_file_goals(ctx);
        }
        self.resume_occurrences(ctx);
        self.look_at_clock(ctx);
        self.schedule_next(ctx);
    }

    // === replication ===

    /// Sends the record of a new goal to the Journals, and reports to the initiator which Journals
    /// have the record.
    pub(crate) fn replicate_new_goal(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if self.journal_client.journals().is_empty() {
            if self.goals.get(id).is_some_and(|goal| goal.partition == Partition::Wait) {
                let detail = "no Journal is here to decide which partition has the quorum: the \
                              goal is pursued in each";
                self.send_report(id, progress(detail), ctx);
            }
            return;
        }
        if self.goals.get(id).is_some_and(|goal| goal.number == 0) {
            // The goal gets its number, and is accepted, when the Journals have been read.
            return;
        }
        let Some(record) = self.record(id) else { return };
        let accepted = id.clone();
        replication::replicate(self, &[record], ctx, move |requester: &mut Self, kept, ctx| {
            let listed = requester.journal_client.journals().len();
            let number = requester.goals.get(&accepted).map_or(0, |goal| goal.number);
            let detail = acceptance(number, &kept, listed);
            if kept.stored_by.is_empty() {
                tracing::warn!(conversation = %accepted, refusals = ?kept.failed_by, detail, "goal");
            }
            requester.send_report(&accepted, Report::new(Outcome::Progress, detail), ctx);
        });
    }

    /// Sends the present record of a goal to the Journals.
    pub(crate) fn replicate_goal(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if let Some(record) = self.record(id) {
            self.send(&[record], ctx);
        }
    }

    /// Sends the present record of a goal and its plan to the Journals.
    pub(crate) fn replicate_plan(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if self.journal_client.journals().is_empty() {
            return;
        }
        let plan = self.goals.get(id).and_then(|goal| goal.plan.as_deref()).map(value);
        let plan = plan.map(|plan| self.journal_client.write(format!("{PLAN}{id}"), plan));
        let goal = self.record(id);
        let records: Vec<_> = plan.into_iter().chain(goal).collect();
        self.send(&records, ctx);
    }

    /// Records in the Journals that a goal is cancelled. Calls `then` when enough Journals have
    /// answered or the time limit for an answer has passed.
    pub(crate) fn replicate_cancellation(
        &mut self,
        id: &ConversationId,
        ctx: &mut Context<Self>,
        then: impl FnOnce(&mut Context<Self>) + Send + 'static,
    ) {
        let record =
            if self.goals.contains_key(id) { self.record(id) } else { self.ended.record(id) };
        let Some(record) = record else { return then(ctx) };
        replication::replicate(self, &[record], ctx, move |_, _, ctx| then(ctx));
    }

    /// Sends all records to the Journals again. Must be called when a Journal joins, because that
    /// Journal may have missed any of the records.
    pub(crate) fn replicate_all(&mut self, ctx: &mut Context<Self>) {
        let goals: Vec<_> = self.goals.keys().cloned().collect();
        goals.iter().for_each(|id| self.replicate_plan(id, ctx));
        let ended = self.ended.records();
        if !ended.is_empty() {
            self.send(&ended, ctx);
        }
        self.replicate_all_due(ctx);
    }

    /// Sends what the initiator `asker` may have missed before it joined: the outcomes of its ended
    /// goals, and a report for each of its kept goals that holds.
    pub(crate) fn send_missed_outcomes(&mut self, asker: &Resident, ctx: &mut Context<Self>) {
        for (participation, report) in self.ended.of_asker(asker) {
            self.send_or_queue(&participation, report, ctx);
        }
        let holds = self.goals.values().filter(|goal| {
            goal.participation.initiator == asker.agent && goal.state.phase() == GoalPhase::Holding
        });
        for goal in holds {
            ctx.answer(&goal.participation, Performative::Confirm, &holding());
        }
    }

    /// Records the outcome of a goal in the Journals, and removes the records of the oldest ended
    /// goals there.
    pub(crate) fn replicate_outcome(
        &mut self,
        goal: &Goal,
        report: Report,
        ctx: &mut Context<Self>,
    ) {
        if self.journal_client.journals().is_empty() {
            return;
        }
        let id = goal.conversation().clone();
        self.replicate_finished(&id, report, record_of(goal), ctx);
    }

    fn replicate_finished(
        &mut self,
        id: &ConversationId,
        report: Report,
        record: GoalRecord,
        ctx: &mut Context<Self>,
    ) {
        let record = GoalRecord { running: None, ended: Some(report.clone()), ..record };
        let record = self.journal_client.write(format!("{GOAL}{id}"), value(&record));
        self.ended.store_record(record.clone());
        let forgotten = self.ended.add_outcome(id.clone(), record.version, report);
        let mut records =
            vec![record, self.journal_client.write(format!("{PLAN}{id}"), Value::Null)];
        for oldest in forgotten {
            records.push(self.journal_client.write(format!("{GOAL}{oldest}"), Value::Null));
        }
        self.send(&records, ctx);
    }

    /// Removes the plan of a goal from the Journals when the goal has ended or holds. A plan made
    /// on the other side of a partition may be unknown to the replica that ended the goal.
    pub(crate) fn forget_plan(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let forgotten = self.journal_client.write(format!("{PLAN}{id}"), Value::Null);
        self.send(&[forgotten], ctx);
    }

    fn record(&mut self, id: &ConversationId) -> Option<Record> {
        if self.journal_client.journals().is_empty() {
            return None;
        }
        let goal = self.goals.get_mut(id)?;
        let record = self.journal_client.write(format!("{GOAL}{id}"), value(&record_of(goal)));
        goal.version = record.version;
        Some(record)
    }

    /// Returns the record of a goal and, if its plan is running, the record of that plan.
    fn records_of(&mut self, id: &ConversationId) -> Vec<Record> {
        let Some(goal) = self.goals.get(id) else { return Vec::new() };
        let body = value(&record_of(goal));
        let plan = goal.plan.as_deref().filter(|_| goal.state.phase().is_under_way()).map(value);
        let plan = plan.map(|plan| self.journal_client.write(format!("{PLAN}{id}"), plan));
        std::iter::once(self.journal_client.write(format!("{GOAL}{id}"), body))
            .chain(plan)
            .collect()
    }

    fn send(&mut self, records: &[Record], ctx: &mut Context<Self>) {
        replication::replicate_detached(self, records, ctx);
    }

    // === resuming ===

    /// Merges the record of a goal with this replica's own state of the goal, and resumes the goal
    /// if it has not ended.
    fn resume(
        &mut self,
        mut record: GoalRecord,
        version: Version,
        plan: Option<Execute>,
        ctx: &mut Context<Self>,
    ) {
        let id = record.participation.conversation.clone();
        let ended_here = self.ended.outcome_of(&id).cloned();
        if record.cancelled || record.ended.is_some() || ended_here.is_some() {
            self.drop_plan(&id, plan.as_ref(), ctx);
        }
        // An end or a cancellation is final, even if a later record has the goal as pursued.
        let is_later_here = self.goals.get(&id).is_some_and(|goal| goal.version >= version);
        let is_known = is_later_here && record.ended.is_none() && !record.cancelled;
        if is_known {
            return self.keep_own_state(&id, plan, ctx);
        }
        if self.ended.has(&id, version) {
            return;
        }
        if record.ended.is_none()
            && let Some(report) = ended_here
        {
            // The end was unknown to the replica that wrote this record, and that replica may have
            // reported another state of the goal.
            self.send_outcome(&record, &report, ctx);
            return self.replicate_finished(&id, report, record, ctx);
        }
        if record.cancelled && record.ended.is_none() {
            return self.cancel_restored(&id, record, ctx);
        }
        if record.ended.is_none() && self.keeps_own_state(&id, record.running.is_some()) {
            // Both sides of a partition pursued the goal, and this side wins. The next record of
            // this side has a later version.
            if record.running.is_some() {
                self.follow_again(&id, ctx);
            }
            return self.replicate_plan(&id, ctx);
        }
        let was_running = self.goals.get(&id).is_some_and(|goal| goal.state.phase().is_running());
        // If the initiator has asked this replica in the same incarnation, it may no longer wait in
        // the exchange that the record names.
        if let Some(participation) = self.local_exchange(&record.participation) {
            record.participation = participation;
        }
        let event =
            if record.ended.is_some() { GoalEvent::EndedElsewhere } else { GoalEvent::TakenOver };
        self.remove_goal(&id, event, ctx);
        if was_running {
            self.release_agents(&id, ctx);
        }
        if let Some(report) = record.ended.clone() {
            self.send_outcome(&record, &report, ctx);
            if is_later_here {
                return self.replicate_finished(&id, report, record, ctx);
            }
            self.ended.add_outcome(id, version, report);
            return;
        }
        let is_own = record.participation.initiator == *ctx.id();
        if !is_own && self.is_asked_anew(&record) {
            let report = Report::new(Outcome::Cancelled, "its asker has asked for it again");
            return self.replicate_finished(&id, report, record, ctx);
        }
        self.resume_from_record(record, version, plan, ctx);
    }

    /// Returns `true` if a later incarnation of the initiator has requested the same goal from this
    /// replica, before the record of the earlier request arrived.
    fn is_asked_anew(
        &self,
        GoalRecord { participation, incarnation, asked, .. }: &GoalRecord,
    ) -> bool {
        self.goals.values().any(|goal| {
            let is_same = goal.text == asked.goal && goal.keep == asked.keep;
            is_same
                && goal.participation.initiator == participation.initiator
                && *incarnation < goal.initiator_incarnation
        })
    }

    /// Returns the exchange in which this replica received the request for the goal from the same
    /// incarnation of the initiator as in `elsewhere`; `None` if it received no such request.
    fn local_exchange(&self, elsewhere: &Participation) -> Option<Participation> {
        let participation = &self.goals.get(&elsewhere.conversation)?.participation;
        (participation.incarnation == elsewhere.incarnation).then(|| participation.clone())
    }

    /// Handles a record that is older than this replica's own state of the goal. If no plan runs
    /// here, cancels the plan of the other replica, because a kept goal may already hold without
    /// that plan.
    fn keep_own_state(
        &mut self,
        id: &ConversationId,
        plan: Option<Execute>,
        ctx: &mut Context<Self>,
    ) {
        let runs = self.goals.get(id).is_some_and(|goal| goal.state.phase().is_running());
        if let Some(plan) = plan.filter(|_| !runs) {
            self.cancel_orphan(id, &plan, 0, ctx);
        }
    }

    /// Cancels the running plan of a goal that has ended, and removes the plan from the Journals.
    fn drop_plan(&mut self, id: &ConversationId, plan: Option<&Execute>, ctx: &mut Context<Self>) {
        if plan.is_some() || self.goals.get(id).is_some_and(|goal| goal.plan.is_some()) {
            self.forget_plan(id, ctx);
        }
        if let Some(plan) = plan {
            self.cancel_orphan(id, plan, 0, ctx);
        }
    }

    /// Cancels a goal that had not ended when the leader changed, although the former leader had
    /// already confirmed its cancellation.
    fn cancel_restored(
        &mut self,
        id: &ConversationId,
        record: GoalRecord,
        ctx: &mut Context<Self>,
    ) {
        if self.goals.contains_key(id) {
            return self.cancel(id, ctx);
        }
        let report = Report::new(Outcome::Cancelled, "cancelled as asked");
        self.send_outcome(&record, &report, ctx);
        self.replicate_finished(id, report, record, ctx);
    }

    /// Sends the outcome of a goal to its initiator, if the incarnation that requested the goal is
    /// still present. The initiator may have missed the outcome. A repeated outcome has no effect.
    fn send_outcome(&mut self, record: &GoalRecord, report: &Report, ctx: &mut Context<Self>) {
        let GoalRecord { participation, incarnation, .. } = record;
        self.ended.store_sent(participation.clone(), report.clone());
        if ctx.find(&participation.initiator).is_some_and(|asker| asker.incarnation == *incarnation)
        {
            self.send_or_queue(participation, report.clone(), ctx);
        }
    }

    /// Resumes a goal from the record in the Journals.
    fn resume_from_record(
        &mut self,
        record: GoalRecord,
        version: Version,
        plan: Option<Execute>,
        ctx: &mut Context<Self>,
    ) {
        let GoalRecord {
            participation,
            incarnation,
            asked,
            number,
            rounds,
            failures,
            failed,
            running,
            limits,
            happened,
            ..
        } = record;
        let id = participation.conversation.clone();
        let condition = match pddl::parse_condition(&asked.goal).into_result() {
            Ok(condition) => condition,
            Err(_) => return tracing::warn!(conversation = %id, "a recorded goal cannot be read"),
        };
        tracing::info!(conversation = %id, goal = asked.goal, rounds, "resumes a goal");
        let running = running.filter(|running| {
            let is_it = |plan: &Execute| plan.term == running.term && plan.round == running.round;
            plan.as_ref().is_some_and(is_it)
        });
        let now = self.elapsed(ctx);
        let (mut state, commands) =
            GoalState::resumed(asked.keep, (rounds, failures), running.is_some(), now);
        state.backoffs_mut().restore(failed.into_iter().map(FailedAction::from), now);
        let mut goal = Goal::new(participation, incarnation, asked, condition);
        (goal.state, goal.version) = (state, version);
        goal.number = self.number_for(number);
        goal.limits = limits;
        goal.recall_history(happened);
        if let (Some(running), Some(plan)) = (running, plan) {
            goal.adopt_plan(plan, running.done);
        }
        self.goals.insert(id.clone(), goal);
        self.carry_out(&id, commands, ctx);
    }

    /// Returns `true` if this replica keeps its own state of a goal that both sides of a partition
    /// pursued: always, unless only the other side has a running plan (`theirs_runs`).
    fn keeps_own_state(&self, id: &ConversationId, theirs_runs: bool) -> bool {
        self.goals.get(id).is_some_and(|goal| goal.state.phase().is_running() || !theirs_runs)
    }

    /// Requests the running plan of a goal from the Plan Executor again. If the other side has
    /// requested the same plan, the Plan Executor would otherwise report to that side only.
    fn follow_again(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if let Some(attempt) = self.goals.get(id).map(|goal| goal.state.attempt()) {
            self.handle(id, GoalEvent::ExecutorRestarted(attempt), ctx);
        }
    }

    /// Stands down as leader: hands all goals over to the new leader.
    pub(crate) fn resign(&mut self, ctx: &mut Context<Self>) {
        let mut records = self.ended.records();
        records.extend(self.resign_clock(ctx));
        let goals: Vec<_> = self.goals.keys().cloned().collect();
        for id in goals {
            records.extend(self.records_of(&id));
            self.remove_goal(&id, GoalEvent::TakenOver, ctx);
        }
        self.ended.clear_except_unsent();
        self.cheaper_plan_check = None;
        self.drop_early_requests(ctx);
        self.hand_over(records, 0, ctx);
    }

    /// Requests all running plans from a new leader or incarnation of the Plan Executor.
    ///
    /// The requests are sent after [`SETTLE_DELAY`]. If the leader of the Plan Requesters changes
    /// at the same time, this replica stands down first, and only the new leader sends the
    /// requests.
    pub(crate) fn executor_came(&mut self, ctx: &mut Context<Self>) {
        let is_executing = |goal: &Goal| goal.state.phase() == GoalPhase::Executing;
        let running = self.goals.iter().filter(|(_, goal)| is_executing(goal));
        let running: Vec<_> =
            running.map(|(id, goal)| (id.clone(), goal.state.attempt())).collect();
        ctx.after(SETTLE_DELAY, move |requester: &mut Self, ctx| {
            for (id, attempt) in running {
                requester.handle(&id, GoalEvent::ExecutorRestarted(attempt), ctx);
            }
        });
    }

    // === partitions ===

    /// Returns the reason why this partition must not plan for the goal: it does not have the
    /// quorum. A partition has the quorum if it reaches a majority of the configured Journals, or
    /// exactly half of them including the Journal that is configured first. Returns `None` if the
    /// goal may be planned for.
    pub(crate) fn missing_quorum(
        &self,
        id: &ConversationId,
        ctx: &Context<Self>,
    ) -> Option<String> {
        let goal = self.goals.get(id)?;
        if goal.partition == Partition::Pursue {
            return None;
        }
        let journals = self.journal_client.journals();
        let is_here = |journal: &&AgentId| ctx.find(journal).is_some();
        let here = journals.iter().filter(is_here).count();
        let has_first = journals.first().is_some_and(|first| is_here(&first));
        let is_most = here * 2 > journals.len() || (here * 2 == journals.len() && has_first);
        (!is_most && !journals.is_empty()).then(|| {
            let all = journals.len();
            format!("only {here} of {all} Journals can be seen; it waits for most of them")
        })
    }

    /// Considers all goals that wait for the quorum again.
    pub(crate) fn reconsider_waiting(&mut self, ctx: &mut Context<Self>) {
        let waits = |goal: &Goal| {
            goal.partition == Partition::Wait && goal.state.phase() == GoalPhase::WaitingForChange
        };
        let waiting = self.goals.iter().filter(|(_, goal)| waits(goal));
        let waiting: Vec<_> = waiting.map(|(id, _)| id.clone()).collect();
        waiting.iter().for_each(|id| self.consider(id, ctx));
    }
}

/// Returns the conversation of the goal in the key of a record; `None` if `key` is not the key of a
/// goal's record.
pub(crate) fn conversation_of(key: &str) -> Option<ConversationId> {
    key.strip_prefix(GOAL).map(ConversationId::new)
}

impl From<FailedAction> for FailedActionRecord {
    fn from(failed: FailedAction) -> FailedActionRecord {
        let FailedAction { agent, action, times, is_refused: refused, why } = failed;
        FailedActionRecord { agent, action, times, refused, why }
    }
}

impl From<FailedActionRecord> for FailedAction {
    fn from(record: FailedActionRecord) -> FailedAction {
        let FailedActionRecord { agent, action, times, refused: is_refused, why } = record;
        FailedAction { agent, action, times, is_refused, why }
    }
}

fn progress(detail: &str) -> Report {
    Report::new(Outcome::Progress, detail)
}

fn record_of(goal: &Goal) -> GoalRecord {
    let asked = Achieve {
        goal: goal.text.clone(),
        keep: goal.keep,
        priority: goal.priority,
        partition: goal.partition,
    };
    let running = goal.plan.as_ref().filter(|_| goal.state.phase().is_under_way());
    let running = running.map(|plan| RunningPlanId {
        term: plan.term,
        round: plan.round,
        done: plan.done.clone(),
    });
    GoalRecord {
        participation: goal.participation.clone(),
        incarnation: goal.initiator_incarnation,
        asked,
        number: goal.number,
        rounds: goal.state.rounds(),
        failures: goal.state.failures(),
        failed: goal.state.backoffs().failed_actions().into_iter().map(From::from).collect(),
        running,
        limits: goal.limits.clone().filter(|limits| !limits.is_empty()),
        happened: goal.history().to_vec(),
        cancelled: goal.state.is_cancelled(),
        ended: None,
    }
}

/// Returns the report, as text for a person, about the Journals that have a new goal.
pub(crate) fn acceptance(number: u32, kept: &ReplicationOutcome, listed: usize) -> String {
    let mut names: Vec<_> = kept.stored_by.iter().map(|journal| format!("`{journal}`")).collect();
    names.sort();
    match names.as_slice() {
        [] => format!("goal {number} accepted, but kept nowhere: none of {listed} Journals has it"),
        [one] => format!("goal {number} accepted; kept by {one}, 1 of {listed}"),
        some => {
            let names = some.join(" and ");
            format!("goal {number} accepted; kept by {names}, {} of {listed}", some.len())
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use acl::content::{Keep, Reason};
    use serde_json::json;

    use super::*;

    #[test]
    fn records_of_version_1_are_read() {
        let participation = json!({
            "initiator": "user", "life": 7, "exchange": "t", "conversation": "c", "protocol": "goal"
        });
        let goal = json!({
            "participation": participation, "life": 7, "asked": {"goal": "(lit hall)"}, "rounds": 1,
            "failures": 0
        });
        let record = GoalRecord::deserialize(goal).expect("a record of version 1");
        assert_eq!(record.incarnation, Incarnation(7));
        assert_eq!(record.participation.incarnation, Some(Incarnation(7)));
        assert!(record.failed.is_empty());
        let plan = json!({
            "domain": "", "problem": "", "plan": "", "epoch": 1, "round": 1,
            "offers": {"lamp": {"light": {"inside": "light--2", "guard": "(offers-light lamp)"}}}
        });
        let plan = Execute::deserialize(plan).expect("a plan of version 1");
        let offer = plan.offers.into_values().flatten().next().expect("one agent, one action");
        assert_eq!(offer.1.schema, "light--2");
    }

    #[test]
    fn the_record_of_a_goal_has_what_was_forbidden() {
        let participation = json!({
            "initiator": "user", "incarnation": 7, "exchange": "t", "conversation": "c",
            "protocol": "goal"
        });
        let participation = Participation::deserialize(participation).expect("a participation");
        let asked = Achieve::new("(lit hall)", Keep::Achieve, 0);
        let condition = pddl::parse_condition(&asked.goal).into_result().expect("a condition");
        let mut goal = Goal::new(participation, Incarnation(7), asked, condition);
        let lamp = (AgentId::new("lamp").expect("a name"), "light".to_owned());
        let no = Report {
            declined: Some(Reason::Incapable),
            ..Report::new(Outcome::Failed, "ann says no")
        };
        goal.state.backoffs_mut().penalize(lamp, &no, Duration::ZERO);
        let record = GoalRecord::deserialize(value(&record_of(&goal))).expect("a record");
        let failed: Vec<FailedAction> = record.failed.into_iter().map(From::from).collect();
        assert_eq!(failed, goal.state.backoffs().failed_actions());
        assert!(failed[0].is_refused);
    }
}
