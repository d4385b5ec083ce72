//! Rows for pages: ages become moments, so that a row that stays the same is not sent again each
//! second; the page computes ages itself. Moments that move with every heartbeat are left out, or
//! rounded.

use live_view::{
    AgentPresence, AgentRow, DaemonRow, FactRow, Freshness, GoalRow, Moment, QuestionRow,
};
use serde::Serialize;
use serde_json::{Map, Value};

/// Steps of moments that move a little with every report about them.
const SECOND_MS: u64 = 1_000;

/// Steps of moments that move with every heartbeat.
const COARSE_MS: u64 = 10_000;

/// A row with the moments that stand for its ages.
#[derive(Serialize)]
pub(crate) struct PageRow<R, M> {
    #[serde(flatten)]
    row: R,
    #[serde(flatten)]
    moments: M,
}

/// The moments of an agent.
#[derive(Serialize)]
pub(crate) struct AgentMoments {
    /// Moment of the last heartbeat; `None` while the agent is present, because then it is recent.
    heartbeat_at: Option<Moment>,
    late_since: Option<Moment>,
}

/// The moments of a fact.
#[derive(Serialize)]
pub(crate) struct FactMoments {
    same_since: Option<Moment>,
    /// Moment of the last report; `None` while the fact is fresh or lasting.
    reported_at: Option<Moment>,
    /// Moment at which the fact expires; `None` unless that is soon.
    known_until: Option<Moment>,
}

/// The moment at which the time for an answer is over.
#[derive(Serialize)]
pub(crate) struct QuestionMoments {
    ends_at: Option<Moment>,
}

/// The moment at which a daemon started.
#[derive(Serialize)]
pub(crate) struct DaemonMoments {
    up_since: Option<Moment>,
}

/// The moment since which a goal is late.
#[derive(Serialize)]
pub(crate) struct GoalMoments {
    late_since: Option<Moment>,
}

fn nearest(moment: Moment, step_ms: u64) -> Moment {
    Moment(moment.0.saturating_add(step_ms / 2) / step_ms * step_ms)
}

fn floor(moment: Moment, step_ms: u64) -> Moment {
    Moment(moment.0 / step_ms * step_ms)
}

pub(crate) fn agent(mut row: AgentRow, now: Moment) -> PageRow<AgentRow, AgentMoments> {
    let age = row.heartbeat_age_ms.take();
    let is_noted = row.presence != AgentPresence::Present;
    let moments = AgentMoments {
        heartbeat_at: age.filter(|_| is_noted).map(|age| now.minus(age)),
        late_since: row.late_ms.take().map(|late| now.minus(late)),
    };
    PageRow { row, moments }
}

pub(crate) fn fact(mut row: FactRow, now: Moment) -> PageRow<FactRow, FactMoments> {
    let is_noted = matches!(row.freshness, Freshness::Ending | Freshness::Stale);
    let (age, left) = (row.age_ms.take(), row.known_for_ms.take());
    let moments = FactMoments {
        same_since: row.same_for_ms.take().map(|same| now.minus(same)),
        reported_at: age.filter(|_| is_noted).map(|age| nearest(now.minus(age), SECOND_MS)),
        known_until: left
            .filter(|_| row.freshness == Freshness::Ending)
            .map(|left| nearest(now.plus(left), SECOND_MS)),
    };
    for claim in &mut row.contradictions {
        claim.age_ms = claim.age_ms / COARSE_MS * COARSE_MS;
    }
    PageRow { row, moments }
}

pub(crate) fn question(mut row: QuestionRow, now: Moment) -> PageRow<QuestionRow, QuestionMoments> {
    let ends_at = row.remaining_ms.take().map(|left| nearest(now.plus(left), SECOND_MS));
    PageRow { row, moments: QuestionMoments { ends_at } }
}

pub(crate) fn daemon(mut row: DaemonRow, now: Moment) -> PageRow<DaemonRow, DaemonMoments> {
    let up_since = row.uptime_ms.take().map(|up| nearest(now.minus(up), SECOND_MS));
    if row.is_reached != Some(false) {
        row.seen_at = row.seen_at.map(|seen| floor(seen, COARSE_MS));
    }
    PageRow { row, moments: DaemonMoments { up_since } }
}

pub(crate) fn goal(mut row: GoalRow, now: Moment) -> PageRow<GoalRow, GoalMoments> {
    let is_over = row.ended_at.is_some();
    let late = if is_over { None } else { row.late_ms.take() };
    // The expected end of a late plan is now.
    row.expected_end = row.expected_end.filter(|end| *end > now).map(|end| nearest(end, SECOND_MS));
    PageRow { row, moments: GoalMoments { late_since: late.map(|late| now.minus(late)) } }
}

/// Returns a detail as JSON, with moments for its ages at any depth.
pub(crate) fn detail(detail: &impl Serialize, now: Moment) -> Value {
    let mut value = serde_json::to_value(detail).unwrap_or_default();
    replace_ages(&mut value, now);
    value
}

/// Turns milliseconds from or until now into a moment.
type ToMoment<'t> = &'t dyn Fn(u64) -> Moment;

fn replace_ages(value: &mut Value, now: Moment) {
    match value {
        Value::Array(parts) => parts.iter_mut().for_each(|part| replace_ages(part, now)),
        Value::Object(fields) => {
            replace_fields(fields, now);
            fields.values_mut().for_each(|field| replace_ages(field, now));
        }
        _ => (),
    }
}

fn replace_fields(fields: &mut Map<String, Value>, now: Moment) {
    let is_over = fields.get("ended_at").is_some_and(|ended| !ended.is_null());
    let before = |age: u64| now.minus(age);
    let coarse = |age: u64| floor(now.minus(age), COARSE_MS);
    let after = |left: u64| nearest(now.plus(left), SECOND_MS);
    let changes: [(&str, &str, ToMoment<'_>); 6] = [
        ("heartbeat_age_ms", "heartbeat_at", &coarse),
        ("age_ms", "reported_at", &coarse),
        ("same_for_ms", "same_since", &before),
        ("known_for_ms", "known_until", &after),
        ("remaining_ms", "ends_at", &after),
        ("uptime_ms", "up_since", &before),
    ];
    for (age, moment, at) in changes {
        replace_field(fields, age, moment, at);
    }
    if is_over {
        return;
    }
    replace_field(fields, "late_ms", "late_since", &before);
    for expected in ["expected_start", "expected_end", "ends_at"] {
        if let Some(at) = fields.get(expected).and_then(Value::as_u64) {
            fields.insert(expected.to_owned(), nearest(Moment(at), SECOND_MS).0.into());
        }
    }
}

fn replace_field(fields: &mut Map<String, Value>, age: &str, moment: &str, at: ToMoment<'_>) {
    if let Some(value) = fields.get_mut(age) {
        let found = value.take().as_u64().map(|age| at(age).0);
        fields.insert(moment.to_owned(), found.into());
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_detail_that_stays_the_same_is_the_same_later() {
        let at = |now: u64| {
            let row = json!({
                "facts": [{ "fact": "(at r hall)", "same_for_ms": now - 500, "age_ms": now % 1_000 }],
                "running": [{ "late_ms": now - 20_000, "expected_end": now }],
                "done": { "ended_at": 5, "late_ms": 7 },
                "heartbeat_age_ms": null,
            });
            detail(&row, Moment(now))
        };
        let (one, later) = (at(30_100), at(30_300));
        assert_eq!(one, later);
        assert_eq!(one["facts"][0]["same_since"], 500);
        assert_eq!(one["facts"][0]["same_for_ms"], Value::Null);
        assert_eq!(one["running"][0]["late_since"], 20_000);
        assert_eq!(one["done"], json!({ "ended_at": 5, "late_ms": 7 }));
        assert_eq!(one["heartbeat_at"], Value::Null);
    }
}
