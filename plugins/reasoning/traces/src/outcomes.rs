//! How work ended, as the status and the attributes of its span.

use acl::Message;
use acl::content::{Outcome, PlanProposal, PlanStatus, Refusal, Report};

use crate::span::{AttributeValue, SpanStatus, TraceSpan};

/// Attributes that several kinds of spans have.
pub(crate) const AGENT: &str = "althing.agent";
const OUTCOME: &str = "althing.outcome";
pub(crate) const PLAN_COST: &str = "althing.plan.cost";
pub(crate) const CONVERSATION: &str = "messaging.message.conversation_id";
/// OpenTelemetry's own name for the class of an error.
const ERROR_TYPE: &str = "error.type";

/// Notes the answer of the Planning Agent.
pub(crate) fn planned(span: &mut TraceSpan, message: &Message) {
    let Ok(proposal) = message.content_as::<PlanProposal>() else { return };
    let status = proposal.status.to_string();
    span.set("althing.plan.status", status.as_str());
    if let Some(cost) = proposal.cost.filter(|cost| cost.is_finite()) {
        span.attributes.push((PLAN_COST, AttributeValue::Number(cost)));
    }
    span.status = match proposal.status {
        PlanStatus::Solved => SpanStatus::Done,
        PlanStatus::Cancelled => SpanStatus::Unset,
        _ => {
            span.set(ERROR_TYPE, status.as_str());
            SpanStatus::Failed(status)
        }
    };
}

pub(crate) fn is_final(outcome: Outcome) -> bool {
    matches!(outcome, Outcome::Done | Outcome::Failed | Outcome::Cancelled)
}

/// Notes how work ended. The text of the report is not traced: it may repeat what a person said.
pub(crate) fn conclude(span: &mut TraceSpan, report: &Report) {
    let outcome = report.outcome.to_string();
    span.set(OUTCOME, outcome.as_str());
    span.status = match report.outcome {
        Outcome::Failed => {
            let class = report.declined.map_or(outcome, reason);
            span.set(ERROR_TYPE, class.as_str());
            SpanStatus::Failed(class)
        }
        Outcome::Cancelled | Outcome::Progress => SpanStatus::Unset,
        Outcome::Done | Outcome::Holds => SpanStatus::Done,
    };
}

/// Notes that work was refused.
pub(crate) fn refused(span: &mut TraceSpan, message: &Message) {
    let class = message.content_as::<Refusal>().map_or_else(
        |_| message.performative.as_str().to_owned(),
        |refusal| reason(refusal.reason),
    );
    span.set(OUTCOME, "refused");
    span.set(ERROR_TYPE, class.as_str());
    span.status = SpanStatus::Failed(class);
}

/// Returns the code of a reason, as messages have it.
fn reason(reason: acl::content::Reason) -> String {
    acl::content::value(&reason).as_str().unwrap_or("other").to_owned()
}
