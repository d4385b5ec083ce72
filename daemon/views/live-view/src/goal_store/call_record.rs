//! One call for proposals, with its answers.

use std::collections::BTreeMap;

use acl::AgentId;
use acl::content::{Bid, CallForProposals, Choice};

use super::plan_record::{head, parse_plan};
use crate::moment::{Moment, ViewLimits};
use crate::rows::{BidRow, BidState, CallDetail, ProposalRow};
use crate::text::{GroundStep, short};

/// Maximum number of conjuncts of one call that are kept.
const CONJUNCTS_MAX: usize = 200;

/// Maximum number of proposals of one bid that are kept.
const PROPOSALS_MAX: usize = 20;

/// Maximum length of a proposed plan that is read, in bytes; of a longer one the first steps are.
const PROPOSED_BYTES_MAX: usize = 8 << 10;

#[derive(Clone, Debug)]
pub(crate) struct CallRecord {
    call: CallDetail,
    /// Index of each bidder among the bids.
    bidders: BTreeMap<AgentId, usize>,
    /// Bytes of the call and its bids, roughly.
    pub(crate) bytes: usize,
}

impl CallRecord {
    pub(crate) fn new(
        at: Moment,
        content: &CallForProposals,
        called: Option<AgentId>,
        limits: &ViewLimits,
    ) -> CallRecord {
        let conjuncts = content.conjuncts.iter().take(CONJUNCTS_MAX);
        let call = CallDetail {
            at,
            conjuncts: conjuncts.map(|text| short(text, limits.text_bytes)).collect(),
            together: content.together,
            called,
            bids: Vec::new(),
            more_bids: 0,
            decided_at: None,
        };
        let bytes = call.conjuncts.iter().map(String::len).sum();
        CallRecord { call, bidders: BTreeMap::new(), bytes }
    }

    pub(crate) fn detail(&self) -> CallDetail {
        self.call.clone()
    }

    /// Takes the answer of an agent: a bid, or the reason of a refusal.
    pub(crate) fn answer(
        &mut self,
        at: Moment,
        agent: &AgentId,
        answer: Result<&Bid, &str>,
        limits: &ViewLimits,
    ) {
        let mut row = BidRow {
            agent: agent.clone(),
            at,
            after_ms: at.since(self.call.at),
            state: BidState::Declined,
            proposals: Vec::new(),
            detail: String::new(),
        };
        match answer {
            Ok(bid) => {
                row.state = BidState::Offered;
                let proposals = bid.proposals.iter().take(PROPOSALS_MAX);
                row.proposals = proposals
                    .map(|proposal| {
                        let covers = proposal.covers.iter().take(CONJUNCTS_MAX);
                        let plan = head(&proposal.plan, PROPOSED_BYTES_MAX);
                        let steps = parse_plan(plan, limits.text_bytes);
                        let steps = steps.iter().take(limits.steps_per_plan);
                        ProposalRow {
                            covers: covers.map(|text| short(text, limits.text_bytes)).collect(),
                            cost: proposal.cost,
                            steps: steps.map(GroundStep::to_pddl).collect(),
                            is_chosen: false,
                        }
                    })
                    .collect();
            }
            Err(why) => row.detail = short(why, limits.text_bytes),
        }
        self.bytes += bytes(&row);
        if let Some(index) = self.bidders.get(agent) {
            self.bytes -= bytes(&self.call.bids[*index]);
            self.call.bids[*index] = row;
        } else if self.call.bids.len() < limits.bids_per_call {
            self.bidders.insert(agent.clone(), self.call.bids.len());
            self.call.bids.push(row);
        } else {
            self.call.more_bids += 1;
            // Most agents decline, so that a bid takes the place of a refusal.
            let is_refusal = |bid: &BidRow| bid.state == BidState::Declined;
            let place = self.call.bids.iter().rposition(is_refusal);
            if let Some(place) = place.filter(|_| row.state == BidState::Offered) {
                self.bidders.remove(&self.call.bids[place].agent);
                self.bidders.insert(agent.clone(), place);
                self.bytes -= bytes(&self.call.bids[place]);
                self.call.bids[place] = row;
            } else {
                self.bytes -= bytes(&row);
            }
        }
    }

    /// Takes the choice that a bidder is told.
    pub(crate) fn choose(
        &mut self,
        at: Moment,
        agent: &AgentId,
        choice: Option<&Choice>,
        is_accepted: bool,
        text_bytes: usize,
    ) {
        let Some(index) = self.bidders.get(agent) else { return };
        self.call.decided_at.get_or_insert(at);
        let bid = &mut self.call.bids[*index];
        bid.state = if is_accepted { BidState::Won } else { BidState::Lost };
        let Some(choice) = choice else { return };
        bid.detail = short(&choice.detail, text_bytes);
        for proposal in &mut bid.proposals {
            let covered = choice.covers.iter().map(|text| short(text, text_bytes));
            proposal.is_chosen = is_accepted && covered.eq(proposal.covers.iter().cloned());
        }
    }
}

/// Returns the bytes of a bid, roughly. The reason is counted when the bid arrives, although it may
/// change: it is short.
fn bytes(bid: &BidRow) -> usize {
    const WITHOUT_TEXT: usize = 300;
    let text = |texts: &Vec<String>| -> usize {
        texts.iter().map(|text| text.len() + size_of::<String>()).sum()
    };
    let proposals = bid
        .proposals
        .iter()
        .map(|proposal| size_of::<ProposalRow>() + text(&proposal.covers) + text(&proposal.steps));
    WITHOUT_TEXT + proposals.sum::<usize>()
}
