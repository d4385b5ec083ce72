//! Tests of traces: conversations, as agents hold them, and the spans that come of them.

use acl::Message;
use serde_json::{Value, json};

use crate::span::{AttributeValue, SpanStatus, TraceSpan, UnixNanos};
use crate::tracer::Tracer;

/// A conversation that is held message by message, a microsecond apart.
struct Talk {
    tracer: Tracer,
    said: u64,
    spans: Vec<TraceSpan>,
}

impl Talk {
    fn new() -> Talk {
        Talk { tracer: Tracer::new("lab"), said: 0, spans: Vec::new() }
    }

    fn message(&mut self, from: &str, to: &str, what: Value) -> Message {
        self.said += 1;
        let mut message = json!({
            "version": acl::SCHEMA_VERSION,
            "id": format!("m{}", self.said),
            "sender": from,
            "incarnation": 1,
            "conversation_id": "c1",
        });
        if !to.is_empty() {
            message["receiver"] = json!([to]);
        }
        let fields = what.as_object().expect("an object").clone();
        message.as_object_mut().expect("an object").extend(fields);
        acl::decode(message.to_string().as_bytes()).expect("a message")
    }

    fn hear(&mut self, message: &Message) {
        self.spans.extend(self.tracer.hear(message, UnixNanos(self.said * 1_000)));
    }

    /// The first message of an exchange.
    fn opens(&mut self, from: &str, to: &str, protocol: &str, token: &str, act: Value) {
        let performative = match protocol {
            "contract-net" => "cfp",
            "query" => "query-ref",
            _ => "request",
        };
        let what = json!({
            "performative": performative, "protocol": protocol, "reply_with": token, "content": act,
        });
        let message = self.message(from, to, what);
        self.hear(&message);
    }

    /// A later message of an exchange.
    fn answers(&mut self, from: &str, to: &str, token: &str, performative: &str, content: Value) {
        let what =
            json!({ "performative": performative, "in_reply_to": token, "content": content });
        let message = self.message(from, to, what);
        self.hear(&message);
    }

    fn goal(&mut self, keep: &str) {
        let achieve = json!({ "act": "achieve", "goal": "(known-temperature lab)", "keep": keep });
        self.opens("ann", "plan-requester", "goal", "g", achieve);
    }

    fn execute(&mut self, round: u32, token: &str) {
        let plan = "(move robot-1 a b)\n(measure robot-1 b)\n; cost = 2";
        let execute = json!({
            "act": "execute", "domain": "", "problem": "", "plan": plan, "epoch": 1, "term": 7,
            "round": round,
        });
        self.opens("plan-requester", "plan-executor", "execution", token, execute);
    }

    fn act(&mut self, round: u32, token: &str) {
        let act = json!({
            "act": "act", "action": "(move robot-1 a b)", "method": "go", "arguments": {},
            "token": { "term": 7, "conversation": "c1", "round": round, "step": 0 },
        });
        self.opens("plan-executor", "robot-1", "action", token, act);
    }

    fn reports(&mut self, from: &str, token: &str, outcome: &str) {
        let report = json!({ "outcome": outcome, "detail": "the PIN is 1234" });
        self.answers(from, "ann", token, "confirm", report);
    }

    fn named(&self, name: &str) -> Vec<&TraceSpan> {
        self.spans.iter().filter(|span| span.name == name).collect()
    }

    fn only(&self, name: &str) -> &TraceSpan {
        match self.named(name)[..] {
            [span] => span,
            ref several => panic!("{name}: {several:?}"),
        }
    }
}

fn attribute<'s>(span: &'s TraceSpan, name: &str) -> Option<&'s AttributeValue> {
    span.attributes.iter().find(|(known, _)| *known == name).map(|(_, value)| value)
}

fn integer(span: &TraceSpan, name: &str) -> i64 {
    match attribute(span, name) {
        Some(AttributeValue::Integer(number)) => *number,
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn a_goal_is_a_trace_with_its_bids_its_plan_and_its_actions() {
    let mut talk = Talk::new();
    talk.goal("achieve");
    talk.opens(
        "plan-requester",
        "",
        "contract-net",
        "call",
        json!({ "conjuncts": ["(a)", "(b)"] }),
    );
    let proposals = json!([
        { "covers": ["(a)"], "plan": "(go)", "cost": 5.0 },
        { "covers": ["(b)"], "plan": "(go)", "cost": 3.0 },
    ]);
    let bid = json!({ "proposals": proposals, "domain_digest": "d" });
    talk.answers("robot-1", "plan-requester", "call", "agree", bid);
    let refusal = json!({ "reason": "incapable", "detail": "" });
    talk.answers("lamp-1", "plan-requester", "call", "refuse", refusal);
    let choice = json!({ "covers": ["(a)"], "detail": "cheapest" });
    talk.answers("plan-requester", "robot-1", "call", "accept-proposal", choice);
    talk.execute(1, "x");
    talk.act(1, "a");
    talk.answers("robot-1", "plan-executor", "a", "agree", json!({}));
    talk.reports("robot-1", "a", "done");
    talk.reports("plan-executor", "x", "progress");
    talk.reports("plan-executor", "x", "done");
    talk.reports("plan-requester", "g", "done");
    let names: Vec<_> = talk.spans.iter().map(|span| span.name.as_str()).collect();
    assert_eq!(names, ["bid", "call for proposals", "action move", "execute plan", "goal"]);
    let (goal, call) = (talk.only("goal"), talk.only("call for proposals"));
    assert_eq!((goal.parent, goal.start, goal.end), (None, UnixNanos(1_000), UnixNanos(12_000)));
    assert_eq!(goal.status, SpanStatus::Done);
    assert!(talk.spans.iter().all(|span| span.trace == goal.trace && span.end >= span.start));
    assert_eq!(call.parent, Some(goal.id));
    assert_eq!((integer(call, "althing.bids"), integer(call, "althing.refusals")), (1, 1));
    let winners = AttributeValue::Texts(vec!["robot-1".to_owned()]);
    assert_eq!(attribute(call, "althing.awarded"), Some(&winners));
    assert_eq!(call.end, UnixNanos(5_000), "the award ends it");
    let bid = talk.only("bid");
    assert_eq!(bid.parent, Some(call.id));
    assert_eq!(attribute(bid, "althing.plan.cost"), Some(&AttributeValue::Number(3.0)));
    let (execution, action) = (talk.only("execute plan"), talk.only("action move"));
    assert_eq!((execution.parent, action.parent), (Some(goal.id), Some(execution.id)));
    assert_eq!(integer(execution, "althing.plan.steps"), 2);
    assert_eq!(attribute(action, "althing.agent"), Some(&"robot-1".into()));
}

#[test]
fn a_kept_goal_is_restored_in_the_same_trace_and_the_new_plan_links_to_the_old() {
    let mut talk = Talk::new();
    talk.goal("maintain");
    talk.execute(1, "x1");
    talk.reports("plan-executor", "x1", "done");
    talk.reports("plan-requester", "g", "holds");
    assert_eq!(talk.only("goal").status, SpanStatus::Done);
    talk.opens(
        "plan-requester",
        "planning-agent",
        "planning",
        "p",
        json!({
            "act": "plan", "domain": "", "problem": "", "epoch": 2,
        }),
    );
    talk.answers(
        "planning-agent",
        "plan-requester",
        "p",
        "propose",
        json!({
            "status": "solved", "plan": "(go)", "cost": 4.0,
        }),
    );
    talk.execute(2, "x2");
    talk.act(2, "a");
    talk.reports("robot-1", "a", "failed");
    talk.reports("plan-executor", "x2", "failed");
    talk.reports("plan-requester", "g", "holds");
    talk.reports("plan-requester", "g", "cancelled");
    let (goal, restored) = (talk.only("goal"), talk.only("restore goal"));
    assert_eq!(restored.parent, Some(goal.id));
    assert_eq!(talk.only("plan").parent, Some(restored.id));
    assert_eq!(attribute(talk.only("plan"), "althing.plan.status"), Some(&"solved".into()));
    let [first, second] = talk.named("execute plan")[..] else { panic!("two executions") };
    assert!(first.links.is_empty());
    assert_eq!(second.links[0].span, first.id);
    assert_eq!(second.status, SpanStatus::Failed("failed".to_owned()));
    assert_eq!(talk.only("action move").parent, Some(second.id));
}

#[test]
fn neither_questions_nor_answers_nor_details_are_traced() {
    let mut talk = Talk::new();
    talk.goal("achieve");
    let question = json!({ "text": "the PIN of office 1?", "seal_to": null });
    talk.opens("door-1", "", "query", "q", question);
    let answer = json!({ "of": "answer", "text": "1234" });
    talk.answers("keyboard", "door-1", "q", "inform", answer);
    let refusal = json!({ "reason": "unanswered", "detail": "the PIN 1234 is wrong" });
    talk.answers("plan-requester", "ann", "g", "refuse", refusal);
    assert_eq!(talk.only("question").status, SpanStatus::Done);
    assert_eq!(talk.only("goal").status, SpanStatus::Failed("unanswered".to_owned()));
    let told = format!("{:?}", talk.spans);
    assert!(!told.contains("1234") && !told.contains("PIN"), "{told}");
}

#[test]
fn repeated_and_late_messages_make_no_span() {
    let mut talk = Talk::new();
    talk.goal("achieve");
    talk.execute(1, "x");
    let report = json!({ "outcome": "done", "detail": "" });
    let what = json!({ "performative": "confirm", "in_reply_to": "x", "content": report });
    let message = talk.message("plan-executor", "plan-requester", what);
    talk.hear(&message);
    talk.hear(&message);
    assert_eq!(talk.named("execute plan").len(), 1);
    talk.reports("plan-requester", "g", "done");
    let ended = talk.spans.len();
    talk.act(1, "late");
    talk.reports("robot-1", "late", "done");
    assert_eq!(talk.spans.len(), ended, "the conversation is over");
}

#[test]
fn what_is_under_way_when_a_goal_ends_is_marked() {
    let mut talk = Talk::new();
    talk.goal("achieve");
    talk.execute(1, "x");
    talk.reports("plan-requester", "g", "cancelled");
    let unfinished = attribute(talk.only("execute plan"), "althing.unfinished");
    assert_eq!(unfinished, Some(&AttributeValue::Flag(true)));
    assert_eq!(talk.only("execute plan").status, SpanStatus::Unset);
    assert_eq!(attribute(talk.only("goal"), "althing.unfinished"), None);
    // An action that no goal asked for is a trace of its own.
    let mut alone = Talk::new();
    alone.act(1, "a");
    alone.reports("robot-1", "a", "done");
    assert_eq!(alone.only("action move").parent, None);
}

#[test]
fn memory_is_bounded_and_every_goal_ends() {
    let mut tracer = Tracer::new("lab");
    let goals = 3_000;
    let mut spans = Vec::new();
    for number in 0..goals {
        let text = json!({
            "version": acl::SCHEMA_VERSION, "id": format!("m{number}"), "performative": "request",
            "sender": "ann", "incarnation": 1, "conversation_id": format!("c{number}"),
            "protocol": "goal", "reply_with": "g",
            "content": { "act": "achieve", "goal": "(a)" },
        });
        let message = acl::decode(text.to_string().as_bytes()).expect("a message");
        spans.extend(tracer.hear(&message, UnixNanos(number)));
    }
    assert_eq!(spans.len(), 3_000 - 1_024, "the oldest gave way");
    spans.extend(tracer.abandon(UnixNanos(goals)));
    assert_eq!(spans.len(), 3_000);
}

#[test]
fn a_goal_that_is_heard_after_its_call_is_still_the_root() {
    let mut talk = Talk::new();
    talk.opens("plan-requester", "", "contract-net", "call", json!({ "conjuncts": ["(p)"] }));
    talk.goal("achieve");
    talk.execute(1, "run");
    talk.reports("plan-executor", "run", "done");
    talk.reports("plan-requester", "g", "done");
    let (goal, call) = (talk.only("goal"), talk.only("call for proposals"));
    assert_eq!((goal.parent, call.parent), (None, Some(goal.id)));
    assert!(goal.start <= call.start, "{goal:?} {call:?}");
}
