//! Requests to a new leader that has not read the Journals yet: the goals there are unknown to it then.
//!
//! - A cancellation of an unknown goal waits until the Journals are read, because they may have the
//!   goal.
//! - New goals are pursued at once. Their numbers are given afterwards, because the goals in the
//!   Journals have numbers already. So the initiators are told then that their goals are accepted.
//!
//! If no Journal can be read, the wait ends after [`JOURNALS_AWAITED`].

use std::time::Duration;

use acl::content::Reason;
use acl::{ConversationId, Performative};
use agent::{Context, Participation, TimerId};

use crate::PlanRequester;
use crate::goal::Goal;

/// How long a new leader waits for a Journal before it asks for the goals of the file, gives numbers,
/// and answers cancellations: a Journal that has just started opens its file within it, unless the
/// file must be repaired.
const JOURNALS_AWAITED: Duration = Duration::from_secs(10);

/// Maximum number of cancellations that wait: as many as there may be goals. Further ones are refused.
const CANCELLATIONS_MAX: usize = crate::GOALS_MAX;

/// Requests that wait until the Journals have been read.
#[derive(Default)]
pub(crate) struct EarlyRequests {
    /// Whether the Journals have been read since this replica leads, or there are none.
    has_read: bool,
    /// Whether the leader no longer waits for the Journals.
    has_waited: bool,
    /// Cancellations of goals that are unknown so far, each with the exchange that waits for the
    /// answer; `None` if the goal's final report is the answer, or if the answer was sent.
    cancellations: Vec<(ConversationId, Option<Participation>)>,
    /// New goals by the clock, each with the exchange that waits for its acceptance.
    schedules: Vec<Participation>,
    timer: Option<TimerId>,
}

// === impl EarlyRequests ===

impl EarlyRequests {
    /// Whether the Journals may have goals that are unknown here.
    pub(crate) fn has_unread_journals(&self) -> bool {
        !self.has_read
    }

    /// Stores the exchange that waits for the acceptance of a goal by the clock.
    pub(crate) fn add_schedule(&mut self, participation: Participation) {
        self.schedules.push(participation);
    }
}

impl PlanRequester {
    /// Prepares a new leader for requests that arrive before the Journals are read.
    pub(crate) fn await_journals(&mut self, ctx: &mut Context<Self>) {
        self.early = EarlyRequests::default();
        if self.journal_client.journals().is_empty() {
            self.early.has_read = true;
            return self.read_file_goals(ctx);
        }
        self.numbers.close();
        self.early.timer = Some(ctx.after(JOURNALS_AWAITED, |requester: &mut Self, ctx| {
            requester.early.timer = None;
            requester.read_file_goals(ctx);
        }));
    }

    /// Refuses the requests that still wait, because another replica leads now.
    pub(crate) fn drop_early_requests(&mut self, ctx: &mut Context<Self>) {
        let early = std::mem::take(&mut self.early);
        early.timer.into_iter().for_each(|timer| ctx.cancel_timer(timer));
        let askers = early.cancellations.into_iter().filter_map(|(_, asker)| asker);
        for asker in askers.chain(early.schedules) {
            ctx.refuse(&asker, Reason::StandingBy, "another replica leads now; ask again");
        }
    }

    /// Lets the cancellation of a goal that is unknown so far wait for the Journals. `asker` is the
    /// exchange that waits for the answer; `None` if the goal's final report is the answer.
    pub(crate) fn hold_cancellation(
        &mut self,
        id: &ConversationId,
        asker: Option<Participation>,
        ctx: &mut Context<Self>,
    ) {
        if self.early.cancellations.len() >= CANCELLATIONS_MAX {
            let detail = "the Journals are not read yet, and too many cancellations wait for them";
            return asker.iter().for_each(|asker| ctx.refuse(asker, Reason::Busy, detail));
        }
        let asker = match self.early.has_waited {
            true => refuse_unread(id, asker, ctx),
            false => asker,
        };
        self.early.cancellations.push((id.clone(), asker));
    }

    /// Notes that the Journals have been read. Cancels those goals in them whose cancellation waits.
    pub(crate) fn journals_read(&mut self, ctx: &mut Context<Self>) {
        self.early.has_read = true;
        let waiting = std::mem::take(&mut self.early.cancellations);
        for (id, asker) in waiting {
            match self.is_goal(&id) {
                true => self.cancel_for(&id, asker, ctx),
                // The goals of the file have not been read yet.
                false if !self.early.has_waited => self.early.cancellations.push((id, asker)),
                false => (),
            }
        }
    }

    /// Ends the wait for the Journals: they and the goals of the file have been read, or no Journal
    /// can be read for a long time. Gives the numbers that are due, and answers all requests that
    /// wait.
    pub(crate) fn stop_awaiting_journals(&mut self, ctx: &mut Context<Self>) {
        self.early.has_waited = true;
        let timer = self.early.timer.take();
        timer.into_iter().for_each(|timer| ctx.cancel_timer(timer));
        self.numbers.open();
        self.number_early_goals(ctx);
        let waiting = std::mem::take(&mut self.early.cancellations);
        for (id, asker) in waiting {
            if self.early.has_read || self.is_goal(&id) {
                self.cancel_for(&id, asker, ctx);
            } else {
                let asker = refuse_unread(&id, asker, ctx);
                self.early.cancellations.push((id, asker));
            }
        }
    }

    fn number_early_goals(&mut self, ctx: &mut Context<Self>) {
        let asked_at = |goal: &Goal| goal.history().first().map(|entry| entry.at_ms);
        let unnumbered = self.goals.iter().filter(|(_, goal)| goal.number == 0);
        let mut unnumbered: Vec<_> =
            unnumbered.map(|(id, goal)| (asked_at(goal), id.clone())).collect();
        unnumbered.sort();
        for (_, id) in unnumbered {
            let Some(goal) = self.goals.get_mut(&id) else { continue };
            goal.number = self.numbers.next();
            self.replicate_new_goal(&id, ctx);
        }
        for participation in std::mem::take(&mut self.early.schedules) {
            let id = participation.conversation.clone();
            if let Some(due) = self.clock.goals.get_mut(&id) {
                if due.number == 0 {
                    due.number = self.numbers.next();
                }
                self.replicate_new_due(&id, participation, ctx);
            } else if let Some(report) = self.clock.ended.report_of(&id) {
                ctx.answer(&participation, Performative::Confirm, &report);
            }
        }
    }
}

/// Answers a cancellation for which no Journal could be read in time. Returns `None`, because no
/// further answer follows.
fn refuse_unread(
    id: &ConversationId,
    asker: Option<Participation>,
    ctx: &mut Context<PlanRequester>,
) -> Option<Participation> {
    let detail = format!(
        "there is no goal `{id}` so far, and no Journal can be read; if one has it, it is cancelled \
         then"
    );
    asker.iter().for_each(|asker| ctx.refuse(asker, Reason::Unknown, detail.as_str()));
    None
}
