//! Random events: none panics, all limits hold, and the same events give the same view.

use std::collections::BTreeMap;

use acl::EcosystemId;
use live_view::{
    AgentPresence, AgentRow, FactRow, Freshness, LiveView, Moment, ViewEvent, ViewLimits,
};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use serde_json::{Value, json};

use crate::messages::{agent, conversation, from_json, message, place};

const NAMES: [&str; 5] = ["robot-1", "thermo-2", "plan-requester", "alice", "door"];

const PERFORMATIVES: [&str; 12] = [
    "agree",
    "cancel",
    "refuse",
    "request",
    "cfp",
    "propose",
    "accept-proposal",
    "reject-proposal",
    "inform",
    "query-ref",
    "confirm",
    "not-understood",
];

const PROTOCOLS: [&str; 8] =
    ["-", "goal", "planning", "contract-net", "execution", "action", "state-change", "query"];

/// Texts as they come from outside: PDDL, halves of it, and what is no PDDL at all.
fn text() -> impl Strategy<Value = String> {
    let known = select(vec![
        "(at robot-1 hall)",
        "(= (temperature hall) 21.5)",
        "(unknown (motion hall))",
        "(not (lit hall))",
        "(move robot-1 hall office)\n(move robot-1 office hall)",
        "(define (agent robot-1) (:domain d) (:action move :agent ?b - base
            :parameters (?from ?to - place) :precondition (and (at ?b ?from) (way ?from ?to))
            :effect (and (not (at ?b ?from)) (at ?b ?to))))",
        "(define (problem p) (:domain d) (:init (way hall office) (way office hall)
            (at robot-1 hall)) (:goal (at robot-1 office)))",
        "(way hall office) (way office lab) (at robot-1 lab)",
        "((((",
        "",
        "\u{1b}[31m\u{202e}ä\0",
    ]);
    prop_oneof![8 => known.prop_map(str::to_owned), 2 => ".{0,40}"]
}

/// Contents of all kinds. Fields may be missing, or be of another type.
fn content() -> impl Strategy<Value = Value> {
    let small = 0..4u64;
    let fields = (text(), text(), small.clone(), small.clone(), select(NAMES.to_vec()));
    let well = (fields, 0..22u8).prop_map(|((text, other, number, step, name), kind)| {
        well_formed(kind, &text, &other, (number, step, name))
    });
    let spoil = (well, 0..6u8, text(), 0..8usize);
    spoil.prop_map(|(mut content, how, text, which)| {
        let Some(fields) = content.as_object_mut() else { return content };
        let Some(key) = fields.keys().nth(which % fields.len().max(1)).cloned() else {
            return content;
        };
        // Without its tag an answer cannot be recognized as one.
        let is_answer =
            fields.values().any(|value| value == "answer" || value == "answer-question");
        match how {
            _ if is_answer && ["of", "act"].contains(&key.as_str()) => (),
            0 => drop(fields.remove(&key)),
            1 => drop(fields.insert(key, json!(text))),
            2 => drop(fields.insert(key, json!([1, {}, null]))),
            _ => (),
        }
        content
    })
}

fn well_formed(kind: u8, text: &str, other: &str, (number, step, name): (u64, u64, &str)) -> Value {
    let outcomes = ["progress", "holds", "done", "failed", "cancelled"];
    let outcome = outcomes[usize::try_from(number + step).unwrap_or(0) % outcomes.len()];
    let token = json!({ "term": number % 2, "conversation": "g1", "round": number, "step": step });
    let stop = json!({ "id": format!("s{number}"), "scope": [text], "by": name, "why": other });
    let beat = json!({
        "of": "heartbeat", "digest": "d", "sequence": number + step, "facts": text,
        "known_for": { other: number }, "period": number * 100, "stops": [stop],
    });
    match kind {
        0 => json!({ "act": "achieve", "goal": text, "keep": "maintain", "priority": 1 }),
        1 => json!({
            "act": "execute", "domain": "", "problem": other, "plan": text, "epoch": 1,
            "term": number % 2, "round": number, "done": [step],
        }),
        2 => json!({
            "act": "act", "action": text, "method": "m", "arguments": {}, "token": token,
        }),
        3 => json!({ "outcome": outcome, "detail": text }),
        4 => json!({ "outcome": outcome, "detail": text, "step": step, "action": other }),
        5 => json!({ "outcome": "progress", "detail": text, "plan": other, "cost": 1.5 }),
        6 => json!({ "conjuncts": [text, other], "together": number == 0 }),
        7 => json!({
            "proposals": [{ "covers": [text], "plan": other, "cost": 2.0 }], "domain_digest": "",
        }),
        8 => json!({ "covers": [text], "detail": other }),
        9 => json!({ "reason": "incapable", "detail": text }),
        10 => json!({ "reason": "forbidden", "detail": text }),
        11 | 12 => beat,
        13 => json!({
            "of": "model", "model": text, "digest": "d", "sequence": number, "facts": other,
            "period": 1000,
        }),
        14 => json!({
            "of": "epoch", "epoch": 1, "revision": number, "believed": text, "retracted": other,
            "joined": [name], "left": [NAMES[usize::try_from(step).unwrap_or(0)]],
        }),
        15 => json!({ "text": text, "seal_to": other }),
        16 => json!({ "act": "stop", "id": format!("s{number}"), "by": name, "why": text }),
        17 => json!({ "act": "release-stops", "ids": [format!("s{number}")] }),
        18 => json!({ "act": "change-state", "believe": text, "retract": other }),
        19 => json!({ "of": "answer", "text": "secret-2718" }),
        20 => json!({ "act": "answer-question", "question": number, "text": "secret-2718" }),
        _ => json!({ "act": "plan", "domain": "", "problem": text, "epoch": 1 }),
    }
}

/// Returns the message event that these parts make.
fn spoken() -> impl Strategy<Value = ViewEvent> {
    let name = || select(NAMES.to_vec());
    let parts = (name(), name(), select(PERFORMATIVES.to_vec()), select(PROTOCOLS.to_vec()));
    let places = (0..4u8, 0..6u8, any::<u16>());
    (parts, places, content()).prop_map(
        |((from, to, act, protocol), (about, exchange, id), content)| {
            let line = format!("{from}>{to} {act} {protocol} g{about} x{exchange}");
            ViewEvent::Message(Box::new(message(&line, content, u64::from(id))))
        },
    )
}

fn event() -> impl Strategy<Value = ViewEvent> {
    let name = || select(NAMES.to_vec());
    let daemon = || select(vec!["pi", "laptop", "hall"]);
    let place = || (name(), daemon(), 0..3u64).prop_map(|(name, at, life)| place(name, at, life));
    let state = (text(), name(), 0..9u64).prop_map(|(fact, owner, age)| {
        let claim = json!({ "owner": owner, "fact": fact, "source": "x", "age_ms": age });
        let facts = json!([{
            "fact": fact, "owners": [owner], "age_ms": age, "known_for": age, "claims": [claim],
        }]);
        from_json::<acl::content::BelievedState>(
            json!({ "epoch": 1, "revision": age, "facts": facts }),
        )
    });
    let phases = select(acl::content::GoalPhase::ALL.to_vec());
    let status = (text(), 0..4u8, phases).prop_map(|(goal, about, phase)| {
        ViewEvent::Goals(from_json(json!([{
            "conversation": format!("g{about}"), "goal": goal, "keep": "achieve", "priority": 0,
            "phase": phase, "waits_because": goal, "rounds": 1,
            "history": [{ "at_ms": about, "text": goal }],
        }])))
    });
    let question = (text(), name(), 0..3u64).prop_map(|(text, from, number)| {
        ViewEvent::Questions(from_json(json!([{
            "keyboard": "hall", "question": number, "from": from, "text": text, "remaining": number,
        }])))
    });
    prop_oneof![
        20 => spoken(),
        2 => place().prop_map(ViewEvent::Joined),
        2 => place().prop_map(ViewEvent::Left),
        1 => vec(place(), 0..4).prop_map(ViewEvent::Directory),
        1 => state.prop_map(|state| ViewEvent::State(Box::new(state))),
        1 => status,
        1 => question,
        1 => (0..9u64).prop_map(ViewEvent::Lost),
        1 => any::<bool>().prop_map(ViewEvent::Reached),
        1 => any::<u64>().prop_map(|since| ViewEvent::Unread { since: Moment(since) }),
        1 => (daemon(), any::<u64>()).prop_map(|(daemon, micros)| {
            ViewEvent::RoundTrip { daemon: from_json(json!(daemon)), micros }
        }),
    ]
}

const LIMITS: ViewLimits = ViewLimits {
    agents: 4,
    daemons: 2,
    goals: 3,
    plans_per_goal: 2,
    steps_per_plan: 2,
    calls_per_goal: 2,
    bids_per_call: 2,
    goals_bytes: 20_000,
    history_per_goal: 3,
    facts: 5,
    facts_bytes: 4_000,
    questions: 2,
    activity: 6,
    conversations: 3,
    messages_per_conversation: 3,
    messages: 7,
    rooms: 2,
    measured_actions: 2,
    text_bytes: 60,
    model_bytes: 100,
    models_bytes: 300,
};

fn observed(events: &[(u64, ViewEvent)]) -> LiveView {
    let ecosystem = EcosystemId::new("test").expect("a name");
    let mut view = LiveView::new(ecosystem, LIMITS);
    for (at, event) in events {
        view.observe(Moment(*at), event.clone());
    }
    view
}

/// Returns all pages of a view as JSON.
fn pages(view: &LiveView, now: Moment) -> Value {
    let goals = view.goals(now);
    let goals: Vec<_> =
        goals.iter().map(|goal| json!(view.goal(&goal.conversation, now))).collect();
    let agents: Vec<_> =
        view.agents(now).iter().map(|row| json!(view.agent(&row.agent, now))).collect();
    let said: Vec<_> = view
        .conversations()
        .iter()
        .map(|row| json!(view.conversation(&row.conversation)))
        .collect();
    json!({
        "overview": view.overview(now), "goals": goals, "agents": agents,
        "facts": view.facts(now), "floor": view.floor(now), "questions": view.questions(now),
        "activity": view.activity().collect::<Vec<_>>(), "conversations": said,
        "daemons": view.topology(now),
    })
}

fn check_limits(view: &LiveView, now: Moment) {
    assert!(view.agents(now).len() <= LIMITS.agents);
    assert!(view.topology(now).len() <= LIMITS.daemons);
    assert!(view.facts(now).len() <= LIMITS.facts);
    assert!(view.floor(now).rooms.len() <= LIMITS.rooms);
    assert!(view.questions(now).len() <= 2 * LIMITS.questions, "listed and overheard ones");
    assert!(view.activity().len() <= LIMITS.activity);
    assert!(view.activity().all(|entry| entry.text.len() <= LIMITS.text_bytes));
    let goals = view.goals(now);
    assert!(goals.len() <= LIMITS.goals);
    for goal in goals {
        let detail = view.goal(&goal.conversation, now).expect("it is listed");
        assert!(detail.row.goal.len() <= LIMITS.text_bytes);
        assert!(detail.history.len() <= LIMITS.history_per_goal);
        assert!(detail.plans.len() <= LIMITS.plans_per_goal);
        assert!(detail.plans.iter().all(|plan| plan.steps.len() <= LIMITS.steps_per_plan));
        assert!(detail.calls.len() <= LIMITS.calls_per_goal);
        assert!(detail.calls.iter().all(|call| call.bids.len() <= LIMITS.bids_per_call));
    }
    let conversations = view.conversations();
    assert!(conversations.len() <= LIMITS.conversations);
    let details = conversations.iter().filter_map(|row| view.conversation(&row.conversation));
    let counts: Vec<_> = details.map(|detail| detail.messages.len()).collect();
    assert!(counts.iter().all(|count| *count <= LIMITS.messages_per_conversation), "{counts:?}");
    assert!(counts.iter().sum::<usize>() <= LIMITS.messages);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn random_events_keep_the_limits_and_give_the_same_view(
        events in vec((0..100_000u64, event()), 0..120),
        now in 0..200_000u64,
    ) {
        let view = observed(&events);
        let now = Moment(now);
        check_limits(&view, now);
        let shown = pages(&view, now);
        prop_assert_eq!(&shown, &pages(&observed(&events), now));
        prop_assert!(!format!("{view:?}").contains("secret-2718"), "an answer is kept");
    }

    #[test]
    fn whoever_takes_what_has_changed_has_everything(
        events in vec((0..100_000u64, event()), 0..120),
    ) {
        let mut view = observed(&[]);
        let (mut known, mut seen) = (BTreeMap::new(), None);
        for (at, event) in events {
            let now = Moment(at);
            let (revision, before) = (view.revision(), lasting(&view, now));
            view.observe(now, event);
            if view.revision().events == revision.events {
                prop_assert_eq!(before, lasting(&view, now), "only time has passed");
            }
            match seen.and_then(|seen| view.facts_since(seen, now, false)) {
                Some(changed) => known.extend(said(&changed)),
                None => known = said(&view.facts(now)),
            }
            seen = Some(view.revision());
            prop_assert_eq!(&known, &said(&view.facts(now)));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    /// What a page has that takes, each time, the facts and agents that may have changed.
    #[test]
    fn whoever_takes_what_has_aged_has_everything(
        events in vec((0..100_000u64, event()), 0..120),
        later in vec(0..20_000u64, 0..120),
    ) {
        let mut view = observed(&[]);
        let (mut facts, mut agents, mut seen) = (BTreeMap::new(), BTreeMap::new(), None);
        let (mut now, mut later) = (Moment(0), later.into_iter());
        let mut events: Vec<_> = events;
        events.sort_by_key(|(at, _)| *at);
        for (at, event) in events {
            view.observe(Moment(at), event);
            now = now.max(Moment(at)).plus(later.next().unwrap_or(0));
            match seen.and_then(|seen| view.facts_since(seen, now, true)) {
                Some(changed) => facts.extend(aged_facts(&changed)),
                None => facts = aged_facts(&view.facts(now)),
            }
            match seen.and_then(|seen| view.agents_since(seen, now)) {
                Some(changed) => agents.extend(aged_agents(&changed)),
                None => agents = aged_agents(&view.agents(now)),
            }
            seen = Some(view.revision());
            prop_assert_eq!(&facts, &aged_facts(&view.facts(now)));
            prop_assert_eq!(&agents, &aged_agents(&view.agents(now)));
        }
    }
}

/// Returns what pages show of facts: ages only of those that end soon, are stale or disputed.
fn aged_facts(rows: &[FactRow]) -> BTreeMap<String, Value> {
    let row = |row: &FactRow| {
        let is_aged = matches!(row.freshness, Freshness::Ending | Freshness::Stale);
        let ages = is_aged.then_some((row.age_ms, row.known_for_ms));
        let claims: Vec<_> = row.contradictions.iter().map(|claim| &claim.fact).collect();
        let said = json!([row.fact, row.truth, row.owners, row.freshness, ages, claims]);
        (json!([row.predicate, row.arguments]).to_string(), said)
    };
    rows.iter().map(row).collect()
}

/// Returns what pages show of agents: the age of the last heartbeat only of those that are not here.
fn aged_agents(rows: &[AgentRow]) -> BTreeMap<String, Value> {
    let row = |row: &AgentRow| {
        let age = row.heartbeat_age_ms.filter(|_| row.presence != AgentPresence::Present);
        let said = json!([row.presence, age, row.problems, row.late_ms, row.doing, row.is_stopped]);
        (row.agent.to_string(), said)
    };
    rows.iter().map(row).collect()
}

/// Returns what facts say, without what passes with time.
fn said(rows: &[FactRow]) -> BTreeMap<String, Value> {
    let row = |row: &FactRow| {
        let said = json!([row.fact, row.truth, row.value, row.owners]);
        (json!([row.predicate, row.arguments]).to_string(), said)
    };
    rows.iter().map(row).collect()
}

/// Returns what changes only by events that count: everything but facts and what passes with time.
fn lasting(view: &LiveView, now: Moment) -> Value {
    let agents = view
        .agents(now)
        .into_iter()
        .map(|row| json!([row.agent, row.daemon, row.since, row.actions, row.doing, row.replicas]));
    json!({
        "goals": view.goals(now), "questions": view.questions(now), "stops": view.stops(now),
        "activity": view.activity().collect::<Vec<_>>(), "conversations": view.conversations(),
        "daemons": view.topology(now), "inbox": view.discovered(),
        "agents": agents.collect::<Vec<_>>(),
    })
}

#[test]
fn an_unknown_name_has_no_page() {
    let view = observed(&[]);
    assert!(view.agent(&agent("nobody"), Moment(0)).is_none());
    assert!(view.goal(&conversation("none"), Moment(0)).is_none());
    assert!(view.conversation(&conversation("none")).is_none());
}
