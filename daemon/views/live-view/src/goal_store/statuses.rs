//! Takes the answers to queries for all goals: how each stands, those by the clock included.

use std::collections::BTreeSet;

use acl::content::{DueStatus, GoalPhase, GoalStatus};
use acl::{AgentId, ConversationId};

use super::{GoalStore, ObservedGoal};
use crate::moment::Moment;
use crate::rows::{DueRow, GoalHistoryRow, GoalStage};
use crate::text::short;

/// Time for which a goal that a query does not list is still taken as under way: its request may
/// have crossed the query.
const UNLISTED_MS: u64 = 5_000;

impl GoalStore {
    /// Takes the answer to a query for all goals.
    pub(crate) fn statuses(&mut self, at: Moment, statuses: &[GoalStatus]) {
        for status in statuses.iter().take(self.limits.goals) {
            self.status(at, status);
        }
        let listed: BTreeSet<_> = statuses.iter().map(|status| &status.conversation).collect();
        let is_over = |(id, goal): &(&ConversationId, &ObservedGoal)| {
            let is_old = at.since(goal.changed_at) > UNLISTED_MS;
            goal.ended_at.is_none() && !goal.is_action && is_old && !listed.contains(id)
        };
        let over: Vec<_> = self.goals.iter().filter(is_over).map(|(id, _)| id.clone()).collect();
        for id in over {
            let text = "ended; how was not observed".to_owned();
            self.end(at, &id, GoalStage::Cancelled, text);
            if let Some(goal) = self.goals.get_mut(&id) {
                goal.is_presumed_over = true;
            }
        }
    }

    fn status(&mut self, at: Moment, status: &GoalStatus) {
        let (text_bytes, history_max) = (self.limits.text_bytes, self.limits.history_per_goal);
        let goal = self.entry(at, &status.conversation);
        goal.goal = short(&status.goal, text_bytes);
        // Plan Requesters of earlier versions do not number goals.
        goal.number = Some(status.number).filter(|number| *number > 0);
        goal.keep = Some(status.keep);
        goal.priority = status.priority;
        goal.rounds = status.rounds;
        goal.due = status.due.as_deref().map(|due| due_row(due, text_bytes));
        // The history begins with the request.
        if let Some(first) = status.history.first().filter(|first| first.at_ms > 0) {
            let asked_at = Moment(first.at_ms).min(at);
            goal.asked_at = Some(goal.asked_at.map_or(asked_at, |known| known.min(asked_at)));
        }
        let is_over = goal.stage.has_ended() || status.phase == GoalPhase::Ended;
        if status.waits_for_its_time() {
            // It is pursued in another conversation; the messages there say how that stands.
            if goal.requester.is_none() {
                let opener = status.conversation.opener();
                goal.requester = opener.and_then(|opener| AgentId::new(opener).ok());
            }
            if !is_over && goal.stage != GoalStage::Scheduled {
                goal.enter(at, GoalStage::Scheduled);
            }
        } else if !is_over && goal.phase != Some(status.phase) {
            goal.enter(at, stage_of_phase(status.phase));
            goal.phase = Some(status.phase);
        }
        if goal.stage == GoalStage::Waiting {
            goal.text = short(&status.waits_because, text_bytes);
        }
        let first = status.history.len().saturating_sub(history_max);
        let rows = status.history[first..].iter().map(|entry| GoalHistoryRow {
            at: Moment(entry.at_ms),
            outcome: entry.outcome,
            text: short(&entry.text, text_bytes),
        });
        goal.history = rows.collect();
        self.settle(&status.conversation);
    }
}

fn due_row(due: &DueStatus, text_bytes: usize) -> DueRow {
    DueRow {
        words: short(&due.words, text_bytes),
        next_at: due.next_ms.map(Moment),
        next: due.next.as_ref().map(|next| short(next, text_bytes)),
        pursued: due.pursued.clone(),
        reach_by: due.by_ms.map(Moment),
        given_up_at: due.ends_ms.map(Moment),
    }
}

fn stage_of_phase(phase: GoalPhase) -> GoalStage {
    match phase {
        GoalPhase::Queued | GoalPhase::WaitingForAgents | GoalPhase::WaitingForChange => {
            GoalStage::Waiting
        }
        GoalPhase::FetchingDomain
        | GoalPhase::Planning
        | GoalPhase::CollectingProposals
        | GoalPhase::Explaining => GoalStage::Planning,
        GoalPhase::Executing
        | GoalPhase::Preempted
        | GoalPhase::Cancelling
        | GoalPhase::Verifying => GoalStage::Running,
        GoalPhase::Holding => GoalStage::Holding,
        GoalPhase::Ended => GoalStage::Unknown,
    }
}
