//! Tests of the watcher: messages as agents send them, and the notices that come of them.

use self::names::*;
use acl::{DaemonId, Incarnation};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;

/// Names for the tests.
mod names {
    use super::*;
    use agent::Resident;

    pub(super) fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    pub(super) fn resident(name: &str, daemon: &str, incarnation: u64) -> Resident {
        let daemon = DaemonId::new(daemon).expect("a name");
        Resident { agent: agent(name), daemon, incarnation: Incarnation(incarnation) }
    }
}

/// A second at so many seconds after the start.
fn at(seconds: u64) -> NoticeTime {
    NoticeTime { steady_ms: seconds * 1_000, wall_ms: 1_000_000 + seconds * 1_000 }
}

/// A watcher that hears messages one after the other.
struct Talk {
    watcher: NoticeWatcher,
    said: u64,
}

impl Talk {
    fn new() -> Talk {
        Talk { watcher: NoticeWatcher::new(60_000), said: 0 }
    }

    fn message(&mut self, sender: &str, what: Value) -> Message {
        self.said += 1;
        let mut message = json!({
            "version": acl::SCHEMA_VERSION, "id": format!("m{}", self.said), "sender": sender,
            "incarnation": 1, "conversation_id": "c1",
        });
        let fields = message.as_object_mut().expect("an object");
        fields.extend(what.as_object().cloned().expect("an object"));
        serde_json::from_value(message).expect("a message")
    }

    fn hear(&mut self, sender: &str, what: Value) -> Vec<WatchedNews> {
        self.hear_at(at(10), sender, what)
    }

    fn hear_at(&mut self, now: NoticeTime, sender: &str, what: Value) -> Vec<WatchedNews> {
        let message = self.message(sender, what);
        self.watcher.hear(&message, false, now);
        self.watcher.take_news()
    }

    fn ask(&mut self, token: &str, text: &str) -> Vec<WatchedNews> {
        self.hear(
            "robot",
            json!({
                "performative": "query-ref", "protocol": "query", "reply_with": token,
                "reply_within": 30_000, "content": { "text": text, "seal_to": "00" },
            }),
        )
    }

    fn presence(&mut self, presence: Presence, seconds: u64) -> Vec<WatchedNews> {
        self.watcher.presence(&presence, false, at(seconds));
        self.tick(seconds)
    }

    fn tick(&mut self, seconds: u64) -> Vec<WatchedNews> {
        self.watcher.tick(at(seconds));
        self.watcher.take_news()
    }
}

#[track_caller]
fn only(news: &[WatchedNews]) -> Notice {
    match news {
        [WatchedNews::Noticed(notice)] => notice.clone(),
        news => panic!("one notice: {news:?}"),
    }
}

fn achieve() -> Value {
    json!({ "performative": "request", "protocol": "goal", "reply_with": "t",
        "content": { "act": "achieve", "goal": "(at robot\n hall)" } })
}

fn report(outcome: &str) -> Value {
    json!({ "performative": "confirm", "protocol": "goal", "in_reply_to": "t",
        "content": { "outcome": outcome, "detail": "ann said 2718" } })
}

#[test]
fn a_late_goal_is_told_once_and_goes_on() {
    let mut talk = Talk::new();
    talk.hear("ann", achieve());
    let late = |lateness: &str| {
        let mut report = report("progress");
        report["content"]["lateness"] = json!(lateness);
        report
    };
    let soon = only(&talk.hear("plan-requester", late("expected")));
    assert_eq!((soon.kind, soon.text.as_str()), (NoticeKind::GoalLateSoon, "(at robot hall)"));
    let told = only(&talk.hear("plan-requester", late("late")));
    assert_eq!((told.kind, told.text.as_str()), (NoticeKind::GoalLate, "(at robot hall)"));
    // A new leader tells it again.
    assert_eq!(talk.hear("plan-requester", late("late")), []);
    assert_eq!(talk.hear("plan-requester", late("of-a-newer-version")), []);
    assert_eq!(talk.hear("plan-requester", report("progress")), []);
    let lost = only(&talk.hear("plan-requester", report("failed")));
    assert_eq!((lost.kind, lost.text.as_str()), (NoticeKind::GoalLost, "(at robot hall)"));
}

#[test]
fn a_goal_that_is_refused_is_told_unless_it_is_a_mistake_or_asked_again() {
    let refusal = |reason: &str| {
        json!({ "performative": "refuse", "protocol": "goal", "in_reply_to": "t",
            "content": { "reason": reason, "detail": "ann said 2718" } })
    };
    for reason in ["bad-content", "unreadable", "standing-by", "busy", "stopping", "forbidden"] {
        let mut talk = Talk::new();
        talk.hear("ann", achieve());
        assert_eq!(talk.hear("plan-requester", refusal(reason)), [], "{reason}");
    }
    let mut talk = Talk::new();
    assert_eq!(talk.hear("plan-requester", refusal("unreachable")), [], "a goal nobody heard of");
    talk.hear("ann", achieve());
    let lost = only(&talk.hear("plan-requester", refusal("unreachable")));
    assert_eq!((lost.kind, lost.text.as_str()), (NoticeKind::GoalLost, "(at robot hall)"));
    assert!(!format!("{lost:?}").contains("2718"));
}

#[test]
fn a_goal_that_fails_is_told_once_without_the_text_of_the_report() {
    let mut talk = Talk::new();
    assert_eq!(talk.hear("ann", achieve()), []);
    assert_eq!(talk.hear("plan-requester", report("progress")), []);
    let lost = only(&talk.hear("plan-requester", report("failed")));
    assert_eq!((lost.kind, lost.text.as_str()), (NoticeKind::GoalLost, "(at robot hall)"));
    assert_eq!(lost.conversation, Some(ConversationId::new("c1")));
    assert!(!format!("{lost:?}").contains("2718"));
    assert_eq!(talk.hear("plan-requester", report("failed")), [], "a repetition");
}

#[test]
fn a_goal_that_is_reached_or_cancelled_is_not_told() {
    for outcome in ["done", "cancelled", "holds"] {
        let mut talk = Talk::new();
        talk.hear("ann", achieve());
        assert_eq!(talk.hear("plan-requester", report(outcome)), [], "{outcome}");
    }
}

#[test]
fn a_goal_from_before_the_start_is_told_with_its_text() {
    let status = json!({ "conversation": "c1", "goal": "(kept)", "keep": "maintain",
        "priority": 0, "phase": "holding", "rounds": 1, "history": [] });
    let mut talk = Talk::new();
    talk.watcher.goal_known(&serde_json::from_value(status).expect("a status"));
    assert_eq!(only(&talk.hear("plan-requester", report("failed"))).text, "(kept)");
}

#[test]
fn a_question_is_told_with_its_deadline_and_settled_by_an_answer() {
    let mut talk = Talk::new();
    let asked = only(&talk.ask("q1", "PIN, please?"));
    assert_eq!((asked.kind, asked.text.as_str()), (NoticeKind::Question, "PIN, please?"));
    assert_eq!(asked.ends_ms, Some(at(10).wall_ms + 30_000));
    assert_eq!(talk.ask("q2", "PIN, please?"), [], "the same, of a later keyboard");
    let answer = |token: &str| {
        json!({ "performative": "inform", "protocol": "query", "in_reply_to": token,
            "content": { "of": "answer", "text": "2718" } })
    };
    assert_eq!(talk.hear("hall", answer("q1")), [], "the other exchange goes on");
    let settled = talk.hear("hall", answer("q2"));
    assert_eq!(settled, [WatchedNews::Settled(asked.id.clone())]);
    assert_ne!(only(&talk.ask("q3", "PIN, please?")).id, asked.id, "a new attempt");
    let withdrawn = talk.hear(
        "robot",
        json!({ "performative": "cancel", "protocol": "query",
        "in_reply_to": "q3", "content": { "detail": "no" } }),
    );
    assert!(matches!(withdrawn.as_slice(), [WatchedNews::Settled(_)]));
}

fn beat(stops: Value) -> Value {
    json!({ "performative": "inform", "content": { "of": "heartbeat", "digest": "", "sequence": 1,
        "period": 1000, "stops": stops } })
}

fn stop(id: &str) -> Value {
    json!({ "id": id, "scope": ["office1"], "by": "ann", "why": "fire" })
}

#[test]
fn a_stop_and_its_release_are_told_once() {
    let mut talk = Talk::new();
    let mut request = stop("9f");
    request["act"] = json!("stop");
    let request = json!({ "performative": "request", "protocol": "state-change", "reply_with": "s",
        "content": request });
    let told = only(&talk.hear("ann", request.clone()));
    assert_eq!((told.kind, told.text.as_str()), (NoticeKind::Stop, "fire"));
    assert_eq!(told.scope, ["office1"]);
    assert_eq!(talk.hear("ann", request), [], "the same, of another actuator");
    assert_eq!(talk.hear("robot", beat(json!([stop("9f")]))), []);
    let release = json!({ "performative": "request", "protocol": "state-change",
        "reply_with": "r", "content": { "act": "release-stops", "ids": ["9f", "unknown"] } });
    let told = only(&talk.hear("bob", release.clone()));
    assert_eq!((told.kind, told.agents), (NoticeKind::Release, vec![agent("bob")]));
    assert_eq!(talk.hear("bob", release), []);
    assert_eq!(talk.hear("robot", beat(json!([stop("9f")]))), [], "it has not heard of it");
}

#[test]
fn a_hardware_stop_is_told_by_heartbeats() {
    let mut talk = Talk::new();
    let told = only(&talk.hear("robot", beat(json!([stop("hw")]))));
    assert_eq!(told.kind, NoticeKind::Stop);
    assert_eq!(talk.hear("lamp", beat(json!([stop("hw")]))), []);
    assert_eq!(talk.hear("robot", beat(json!([]))), []);
    assert_eq!(only(&talk.hear("lamp", beat(json!([])))).kind, NoticeKind::Release);
    // A heartbeat that was overtaken says nothing.
    let mut overtaken = Talk::new();
    let mut newer = beat(json!([stop("hw")]));
    newer["content"]["sequence"] = json!(2);
    only(&overtaken.hear("robot", newer));
    assert_eq!(overtaken.hear("robot", beat(json!([]))), []);
    // What was in force before the start is not told.
    let mut late = Talk::new();
    let message = late.message("robot", beat(json!([stop("hw")])));
    late.watcher.hear(&message, true, at(0));
    assert_eq!(late.watcher.take_news(), []);
}

#[test]
fn agents_that_are_gone_for_long_are_told_together_and_so_is_their_return() {
    let mut talk = Talk::new();
    for name in ["a", "b", "c"] {
        talk.presence(Presence::Joined(resident(name, "pi", 1)), 0);
    }
    talk.presence(Presence::Left(resident("a", "pi", 1)), 100);
    talk.presence(Presence::Left(resident("b", "pi", 1)), 101);
    talk.presence(Presence::Left(resident("c", "pi", 1)), 140);
    assert_eq!(talk.watcher.next_due_ms(), Some(160_000));
    assert_eq!(talk.tick(159), []);
    let gone = only(&talk.tick(160));
    assert_eq!((gone.kind, gone.agents), (NoticeKind::AgentGone, vec![agent("a"), agent("b")]));
    assert_eq!(talk.presence(Presence::Joined(resident("c", "pi", 2)), 170), []);
    assert_eq!(talk.tick(400), [], "it was back in time");
    talk.presence(Presence::Joined(resident("a", "pi", 2)), 500);
    assert_eq!(talk.presence(Presence::Joined(resident("b", "pi", 2)), 501), []);
    let back = only(&talk.tick(502));
    assert_eq!((back.kind, back.agents), (NoticeKind::AgentBack, vec![agent("a"), agent("b")]));
    assert_eq!(talk.watcher.next_due_ms(), None);
}

#[test]
fn a_replica_that_goes_leaves_the_agent_and_guests_are_not_missed() {
    let mut talk = Talk::new();
    talk.presence(Presence::Joined(resident("a", "pi", 1)), 0);
    talk.presence(Presence::Joined(resident("a", "hall", 2)), 0);
    talk.presence(Presence::Left(resident("a", "pi", 1)), 1);
    assert_eq!(talk.tick(1_000), []);
    talk.presence(Presence::Joined(resident("k", "pi--cli-7", 1)), 0);
    talk.presence(Presence::Left(resident("k", "pi--cli-7", 1)), 1);
    assert_eq!(talk.tick(2_000), []);
}

#[test]
fn a_silent_agent_is_gone_until_it_is_heard() {
    let mut talk = Talk::new();
    talk.presence(Presence::Joined(resident("lamp", "pi", 1)), 0);
    let change = json!({ "performative": "inform", "content": {
        "of": "epoch", "epoch": 1, "revision": 1, "left": ["lamp"] } });
    talk.hear_at(at(10), "domain-maintainer", change);
    assert_eq!(only(&talk.tick(70)).agents, [agent("lamp")]);
    talk.hear_at(at(80), "lamp", beat(json!([])));
    assert_eq!(only(&talk.tick(82)).kind, NoticeKind::AgentBack);
    // An agent that was never seen is not missed.
    assert_eq!(talk.presence(Presence::Left(resident("x", "pi", 1)), 100), []);
    assert_eq!(talk.tick(1_000), []);
}

#[test]
fn messages_that_are_repeated_or_have_long_names_change_nothing() {
    let mut talk = Talk::new();
    let mut message = talk.message(
        "robot",
        json!({
            "performative": "query-ref", "protocol": "query", "reply_with": "q",
            "content": { "text": "Well?" },
        }),
    );
    talk.watcher.hear(&message, false, at(0));
    talk.watcher.hear(&message, false, at(7_200));
    assert_eq!(talk.watcher.take_news().len(), 1);
    message.id = MessageId::new(&"m".repeat(IDENTIFIER_BYTES_MAX + 1));
    talk.watcher.hear(&message, false, at(7_200));
    assert_eq!(talk.watcher.take_news(), []);
}

fn content() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<u64>().prop_map(Value::from),
        "\\PC{0,40}".prop_map(Value::from),
    ];
    let key = prop::sample::select(vec![
        "of", "act", "text", "goal", "ids", "stops", "id", "scope", "by", "outcome", "detail",
        "left", "joined", "why",
    ]);
    let word = prop::sample::select(vec!["heartbeat", "epoch", "stop", "release-stops", "achieve"]);
    let value = prop_oneof![
        leaf.clone(),
        word.prop_map(Value::from),
        prop::collection::vec(leaf, 0..4).prop_map(Value::from),
    ];
    let pairs = prop::collection::vec((key, value), 0..8);
    pairs.prop_map(|pairs| pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}

proptest! {
    /// No message panics, and what is remembered stays bounded.
    #[test]
    fn any_message_is_survived(
        contents in prop::collection::vec(
            (content(), 0..6_usize, 0..3_usize, "\\PC{0,12}"), 1..40,
        ),
    ) {
        let mut talk = Talk::new();
        for (content, performative, protocol, token) in contents {
            let performative =
                ["request", "confirm", "inform", "query-ref", "cancel", "refuse"][performative];
            let mut what = json!({ "performative": performative, "content": content });
            if protocol > 0 {
                what["protocol"] = json!(["goal", "query", "state-change"][protocol]);
                what["reply_with"] = json!(token);
            }
            talk.hear("ann", what);
            talk.tick(100);
        }
        prop_assert!(talk.watcher.news.len() <= NOTICES_MAX);
    }
}
