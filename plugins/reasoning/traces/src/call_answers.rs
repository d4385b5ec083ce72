//! The answers to a call for proposals: the bids, each with a span of its own, and the awards.

use acl::content::Bid;
use acl::{AgentId, Message, Performative, ReplyToken};

use crate::outcomes::{AGENT, CONVERSATION, PLAN_COST};
use crate::span::{AttributeValue, SpanId, SpanStatus, TraceSpan, UnixNanos};

/// Maximum number of bids of one call that have spans of their own. All are counted.
const BIDS_MAX: u64 = 256;

/// Answers to a call for proposals so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct CallAnswers {
    bids: u64,
    refusals: u64,
    awarded: Vec<String>,
    /// Time of the last answer or award.
    last: UnixNanos,
}

impl CallAnswers {
    /// Returns the answers to a call that was sent at `now`: none yet.
    pub(crate) fn new(now: UnixNanos) -> CallAnswers {
        CallAnswers { last: now, ..CallAnswers::default() }
    }

    /// Notes an answer to a call for proposals, or an award. Returns the span of a bid.
    pub(crate) fn heard(
        &mut self,
        call: &TraceSpan,
        message: &Message,
        token: &ReplyToken,
        performative: Performative,
        now: UnixNanos,
    ) -> Vec<TraceSpan> {
        match performative {
            Performative::Agree => {
                (self.bids, self.last) = (self.bids + 1, now);
                let Ok(bid) = message.content_as::<Bid>() else { return Vec::new() };
                if self.bids > BIDS_MAX {
                    return Vec::new();
                }
                vec![bid_span(&bid, call, &message.sender, token, now)]
            }
            Performative::Refuse => {
                (self.refusals, self.last) = (self.refusals + 1, now);
                Vec::new()
            }
            Performative::AcceptProposal => {
                self.last = now;
                let winners = message.receiver.iter().map(|agent| agent.as_str().to_owned());
                self.awarded.extend(winners);
                self.awarded.sort();
                self.awarded.dedup();
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    /// Completes the span of the call, at the time of the last answer.
    pub(crate) fn conclude(self, span: &mut TraceSpan) {
        let CallAnswers { bids, refusals, awarded, last } = self;
        span.end = span.end.max(last);
        span.set("althing.bids", bids);
        span.set("althing.refusals", refusals);
        if !awarded.is_empty() {
            span.status = SpanStatus::Done;
            span.attributes.push(("althing.awarded", AttributeValue::Texts(awarded)));
        }
    }
}

fn bid_span(
    bid: &Bid,
    call: &TraceSpan,
    bidder: &AgentId,
    token: &ReplyToken,
    now: UnixNanos,
) -> TraceSpan {
    let id = SpanId::of(call.trace, "bid", &format!("{token}/{bidder}"));
    let conversation = call.attributes.iter().filter(|(name, _)| *name == CONVERSATION).cloned();
    let mut span = TraceSpan {
        trace: call.trace,
        id,
        parent: Some(call.id),
        name: "bid".to_owned(),
        start: call.start,
        end: now,
        attributes: conversation.collect(),
        links: Vec::new(),
        status: SpanStatus::Done,
    };
    span.set(AGENT, bidder.as_str());
    span.set("althing.proposals", bid.proposals.len() as u64);
    let costs = bid.proposals.iter().map(|proposal| proposal.cost).filter(|cost| cost.is_finite());
    if let Some(least) = costs.min_by(f64::total_cmp) {
        span.attributes.push((PLAN_COST, AttributeValue::Number(least)));
    }
    span
}
