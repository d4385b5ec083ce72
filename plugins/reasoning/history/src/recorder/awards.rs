//! Accepted proposals, and which of them a step of a plan comes from.

use std::sync::Arc;

use acl::content::Bid;

use super::draft::EventLink;
use super::pddl_text::{lists, without_introducers};
use crate::words::{is_same_text, words_of};

/// Maximum number of proposals of one bid, and of steps of one proposal, that are remembered.
const PROPOSALS_MAX: usize = 16;
const STEPS_MAX: usize = 64;

/// A bid, as far as its acceptance needs it.
#[derive(Debug)]
pub(crate) struct BidTrace {
    pub(super) bidder: Arc<str>,
    pub(super) event: EventLink,
    /// What each proposal covers, and its steps.
    proposals: Vec<(String, Vec<String>)>,
}

/// An accepted proposal.
#[derive(Clone, Debug)]
pub(crate) struct AwardTrace {
    bidder: Arc<str>,
    pub(super) event: EventLink,
    /// The call for proposals.
    pub(super) call: EventLink,
    steps: Vec<String>,
}

// === impl BidTrace ===

impl BidTrace {
    pub(super) fn new(bidder: &str, bid: &Bid, event: EventLink) -> BidTrace {
        let proposals = bid.proposals.iter().take(PROPOSALS_MAX).map(|proposal| {
            let steps = lists(&proposal.plan).take(STEPS_MAX);
            let steps = steps.map(|step| without_introducers(step).into_owned()).collect();
            (proposal.covers.join(" "), steps)
        });
        BidTrace { bidder: bidder.into(), event, proposals: proposals.collect() }
    }

    /// Returns the steps of the proposal that covers these conjuncts.
    fn steps(&self, conjuncts: &str) -> Vec<String> {
        let covering = self.proposals.iter().find(|(covers, _)| is_same_text(covers, conjuncts));
        covering.or(self.proposals.first()).map(|(_, steps)| steps.clone()).unwrap_or_default()
    }
}

// === impl AwardTrace ===

impl AwardTrace {
    pub(super) fn new(
        bidder: &str,
        conjuncts: &str,
        bid: Option<&BidTrace>,
        call: EventLink,
        event: EventLink,
    ) -> AwardTrace {
        let steps = bid.map(|bid| bid.steps(conjuncts)).unwrap_or_default();
        AwardTrace { bidder: bidder.into(), event, call, steps }
    }
}

/// Returns the award that a step comes from: its proposal has the step, or else its bidder takes
/// part in the step.
pub(super) fn award_of<'a>(awards: &'a [AwardTrace], action: &str) -> Option<&'a AwardTrace> {
    let action = without_introducers(action);
    let proposed =
        awards.iter().find(|award| award.steps.iter().any(|step| is_same_text(step, &action)));
    let takes_part = |award: &&AwardTrace| {
        words_of(&action).skip(1).any(|object| object.eq_ignore_ascii_case(&award.bidder))
    };
    proposed.or_else(|| awards.iter().find(takes_part))
}
