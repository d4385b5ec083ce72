//! Tests of the recorder: conversations made by hand, whose chains of causes are known.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    Achieve, Act, ActionToken, Bid, CallForProposals, ChangeState, Choice, EpochChange, Execute,
    Heartbeat, HistoryKind, HistoryRoot, Inform, Keep, ModelAnnouncement, Outcome, PersonsAnswer,
    Proposal, Question, Reason, Refusal, Report, Request, Stop, StopEffect, value,
};
use acl::{
    AgentId, ConversationId, DaemonId, Incarnation, Message, MessageId, Millis, Performative,
    Protocol, ReplyToken, SCHEMA_VERSION,
};
use agent::{Presence, Resident};
use serde::Serialize;

use super::*;
use crate::past::PastGoal;

/// A recorder that hears messages, one each second.
struct Scene {
    recorder: EventRecorder,
    events: BTreeMap<u64, RecordedEvent>,
    at_ms: u64,
    messages: u64,
}

fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

impl Scene {
    fn new() -> Scene {
        let (recorder, events) = (EventRecorder::new(0), BTreeMap::new());
        Scene { recorder, events, at_ms: 1_700_000_000_000, messages: 0 }
    }

    fn message(
        &mut self,
        performative: Performative,
        from: &str,
        to: &str,
        content: &impl Serialize,
    ) -> Message {
        self.messages += 1;
        Message {
            version: SCHEMA_VERSION,
            id: MessageId::new(&format!("m{}", self.messages)),
            performative,
            sender: agent(from),
            incarnation: Incarnation(1),
            receiver: if to.is_empty() { Vec::new() } else { vec![agent(to)] },
            content: value(content),
            language: None,
            ontology: None,
            protocol: None,
            conversation_id: ConversationId::new(from),
            reply_with: None,
            in_reply_to: None,
            reply_within: None,
            via: Vec::new(),
            unknown: serde_json::Map::new(),
        }
    }

    fn hear(&mut self, message: Message) {
        self.at_ms += 1_000;
        self.recorder.hear(message, self.at_ms);
        self.take();
    }

    fn take(&mut self) {
        for event in self.recorder.take_events() {
            self.events.insert(event.number, event);
        }
    }

    /// Hears a message of a protocol. `token` is opened by it, unless `answers`.
    #[allow(clippy::too_many_arguments)]
    fn say(
        &mut self,
        (protocol, performative): (Protocol, Performative),
        (from, to): (&str, &str),
        (conversation, token, answers): (&str, &str, bool),
        content: &impl Serialize,
    ) {
        let mut message = self.message(performative, from, to, content);
        message.protocol = Some(protocol);
        message.conversation_id = ConversationId::new(conversation);
        let token = Some(ReplyToken::new(token));
        if answers {
            message.in_reply_to = token;
        } else {
            message.reply_with = token;
        }
        self.hear(message);
    }

    fn heartbeat(&mut self, of: &str, sequence: u64, facts: &str) {
        let heartbeat = Heartbeat {
            digest: "d".to_owned(),
            sequence,
            facts: facts.to_owned(),
            known_for: BTreeMap::new(),
            period: Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        };
        let message = self.message(Performative::Inform, of, "", &Inform::Heartbeat(heartbeat));
        self.hear(message);
    }

    fn model(&mut self, of: &str, model: &str, facts: &str) {
        let heartbeat = Heartbeat {
            digest: "d".to_owned(),
            sequence: 1,
            facts: facts.to_owned(),
            known_for: BTreeMap::new(),
            period: Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        };
        let (model, methods) = (model.to_owned(), BTreeMap::new());
        let announced = Inform::Model(Box::new(ModelAnnouncement { model, methods, heartbeat }));
        let message = self.message(Performative::Inform, of, "", &announced);
        self.hear(message);
    }

    fn presence(&mut self, of: &str, is_joining: bool) {
        let daemon = DaemonId::new("office-pi").expect("a name");
        let resident = Resident { agent: agent(of), daemon, incarnation: Incarnation(1) };
        let presence = match is_joining {
            true => Presence::Joined(resident),
            false => Presence::Left(resident),
        };
        self.at_ms += 1_000;
        self.recorder.presence(&presence, false, self.at_ms);
        self.take();
    }

    /// Returns the sentences of the chain of the newest event with this subject, and its root.
    #[track_caller]
    fn chain(&self, subject: &str) -> (Vec<String>, HistoryRoot) {
        let newest = self.events.values().rev().find(|event| *event.subject == *subject);
        let mut event = newest.expect("an event of the subject");
        let mut sentences = vec![event.sentence()];
        while let Some(cause) = event.cause {
            assert!(cause < event.number);
            assert_eq!(self.events[&cause].root, event.root);
            event = &self.events[&cause];
            sentences.push(event.sentence());
        }
        (sentences, event.root)
    }

    /// A person asks for a goal, and a robot is chosen to reach it by one step.
    fn ask_for_office1(&mut self) {
        let goal = "(known-temperature office1)".to_owned();
        let (keep, conversation) = (Keep::Maintain, "ann.5.1");
        let achieve = Request::Achieve(Achieve { keep, ..Achieve::new(&goal, keep, 0) });
        self.say(
            (Protocol::Goal, Performative::Request),
            ("ann", "requester"),
            (conversation, "g1", false),
            &achieve,
        );
        self.plan("c1", "e1", "turtlebot-1", 1);
    }

    fn plan(&mut self, call: &str, execution: &str, robot: &str, round: u32) {
        let (goal, conversation) = ("(known-temperature office1)".to_owned(), "ann.5.1");
        let conjuncts = vec![goal.clone()];
        let cfp = CallForProposals { conjuncts: conjuncts.clone(), ..CallForProposals::default() };
        let open = |token| (conversation, token, false);
        let answer = |token| (conversation, token, true);
        self.say((Protocol::ContractNet, Performative::Cfp), ("requester", ""), open(call), &cfp);
        let plan = format!("(measure {robot} office1)");
        let proposal = Proposal { covers: conjuncts.clone(), plan: plan.clone(), cost: 6.0 };
        let bid = Bid { proposals: vec![proposal], ..Bid::default() };
        self.say(
            (Protocol::ContractNet, Performative::Agree),
            (robot, "requester"),
            answer(call),
            &bid,
        );
        let choice = Choice::new(conjuncts, "the cheapest".to_owned());
        self.say(
            (Protocol::ContractNet, Performative::AcceptProposal),
            ("requester", robot),
            answer(call),
            &choice,
        );
        let execute = self.execute(&plan, round);
        self.say(
            (Protocol::Execution, Performative::Request),
            ("requester", "executor"),
            open(execution),
            &execute,
        );
    }

    fn execute(&self, plan: &str, round: u32) -> Request {
        Request::Execute(Box::new(Execute {
            domain: String::new(),
            problem: String::new(),
            plan: plan.to_owned(),
            epoch: 1,
            term: 1,
            round,
            done: Vec::new(),
            offers: BTreeMap::new(),
            knowledge: BTreeMap::new(),
        }))
    }

    fn act(&mut self, robot: &str, token: &str) {
        self.act_as(robot, &format!("(measure {robot} office1)"), token);
    }

    fn act_as(&mut self, robot: &str, action: &str, token: &str) {
        let act = Act {
            action: action.to_owned(),
            method: "measure".to_owned(),
            arguments: [("pin".to_owned(), "4711".to_owned())].into(),
            token: ActionToken {
                term: 1,
                conversation: ConversationId::new("ann.5.1"),
                round: 1,
                step: 0,
            },
            ready_for: None,
        };
        let act = Request::Act(Box::new(act));
        self.say(
            (Protocol::Action, Performative::Request),
            ("executor", robot),
            ("ann.5.1", token, false),
            &act,
        );
    }
}

#[test]
fn a_step_leads_to_the_person_that_asked_for_the_goal() {
    let mut scene = Scene::new();
    scene.model("turtlebot-1", "(define (agent turtlebot-1))", "(at turtlebot-1 hall)");
    scene.ask_for_office1();
    scene.act("turtlebot-1", "s1");
    let (chain, root) = scene.chain("(measure turtlebot-1 office1)");
    assert_eq!(root, HistoryRoot::Person);
    let expected = [
        "`turtlebot-1` is asked for `(measure turtlebot-1 office1)`",
        "plan 1, of 1 step: (measure turtlebot-1 office1)",
        "`turtlebot-1` is chosen for `(known-temperature office1)`: the cheapest",
        "`turtlebot-1` proposes `(known-temperature office1)` at cost 6",
        "`requester` calls for proposals for `(known-temperature office1)`",
        "`ann` asks for `(known-temperature office1)`, to be kept",
    ];
    assert_eq!(chain, expected);
}

/// Two proposals are accepted, and each step leads to the one that it comes from.
#[test]
fn a_step_leads_to_the_proposal_that_it_comes_from() {
    let mut scene = Scene::new();
    let conjuncts = ["(known-temperature office1)", "(known-temperature office2)"];
    let goal = format!("(and {})", conjuncts.join(" "));
    let (open, answer) = (("ann.5.1", "c1", false), ("ann.5.1", "c1", true));
    let achieve = Request::Achieve(Achieve::new(&goal, Keep::Achieve, 0));
    let asked = (Protocol::Goal, Performative::Request);
    scene.say(asked, ("ann", "requester"), ("ann.5.1", "g1", false), &achieve);
    let covers = conjuncts.map(str::to_owned).to_vec();
    let call = CallForProposals { conjuncts: covers, ..CallForProposals::default() };
    scene.say((Protocol::ContractNet, Performative::Cfp), ("requester", ""), open, &call);
    let offers = [
        ("turtlebot-1", conjuncts[0], "(report--ir-1 ir-1 office1)"),
        ("thermometer-2", conjuncts[1], "(report--thermometer-2 thermometer-2 office2)"),
    ];
    for (bidder, covered, plan) in offers {
        let covers = vec![covered.to_owned()];
        let proposal = Proposal { covers, plan: plan.to_owned(), cost: 6.0 };
        let bid = Bid { proposals: vec![proposal], ..Bid::default() };
        let performative = (Protocol::ContractNet, Performative::Agree);
        scene.say(performative, (bidder, "requester"), answer, &bid);
    }
    // The last award is that of the robot.
    for (bidder, covered, _) in offers.iter().rev() {
        let choice = Choice::new(vec![(*covered).to_owned()], "cheap".to_owned());
        let performative = (Protocol::ContractNet, Performative::AcceptProposal);
        scene.say(performative, ("requester", bidder), answer, &choice);
    }
    let plan = offers.map(|(_, _, plan)| plan).join(" ");
    let execute = scene.execute(&plan, 1);
    let asked = (Protocol::Execution, Performative::Request);
    scene.say(asked, ("requester", "executor"), ("ann.5.1", "e1", false), &execute);
    for (step, actor, bidder, covered) in [
        (offers[0].2, "ir-1", offers[0].0, offers[0].1),
        (offers[1].2, "thermometer-2", offers[1].0, offers[1].1),
    ] {
        scene.act_as(actor, step, actor);
        let shown = pddl_text::without_introducers(step);
        let (chain, root) = scene.chain(&shown);
        assert_eq!(chain[0], format!("`{actor}` is asked for `{shown}`"));
        assert_eq!(chain[1], format!("`{bidder}` is chosen for `{covered}`: cheap"));
        assert_eq!(chain[2], format!("`{bidder}` proposes `{covered}` at cost 6"));
        assert!(chain[3].starts_with("`requester` calls for proposals"), "{chain:?}");
        assert_eq!((chain.len(), root), (5, HistoryRoot::Person));
    }
    // The plan as a whole comes from the call.
    let plan = scene.events.values().find(|event| event.kind == HistoryKind::Plan);
    let cause = plan.and_then(|plan| plan.cause).expect("a plan with a cause");
    assert!(scene.events[&cause].sentence().starts_with("`requester` calls"));
}

#[test]
fn an_effect_leads_to_its_step_and_a_measured_value_to_its_sensor() {
    let mut scene = Scene::new();
    scene.model("turtlebot-1", "(define (agent turtlebot-1))", "(at turtlebot-1 hall)");
    scene.model("thermometer-1", "(define (agent thermometer-1))", "");
    scene.ask_for_office1();
    scene.act("turtlebot-1", "s1");
    scene.heartbeat("thermometer-1", 2, "(= (temperature hall) 20)");
    let mut report = Report::new(Outcome::Done, "21.5 °C");
    report.observations = "(= (temperature office1) 21.5)".to_owned();
    scene.say(
        (Protocol::Action, Performative::Confirm),
        ("turtlebot-1", "executor"),
        ("ann.5.1", "s1", true),
        &report,
    );
    let change = ChangeState {
        believe: "(known-temperature office1)".to_owned(),
        owner: Some(agent("turtlebot-1")),
        ..ChangeState::default()
    };
    scene.say(
        (Protocol::StateChange, Performative::Request),
        ("executor", "maintainer"),
        ("ann.5.1", "x1", false),
        &Request::ChangeState(change),
    );
    for fact in ["(known-temperature office1)", "(temperature office1)"] {
        let (chain, root) = scene.chain(fact);
        assert_eq!(root, HistoryRoot::Person, "{chain:?}");
        assert_eq!(chain[1], "`(measure turtlebot-1 office1)` is done: 21.5 °C");
    }
    let (chain, root) = scene.chain("(temperature hall)");
    assert_eq!((chain.len(), root), (1, HistoryRoot::Sensor));
    // The heartbeat that says the same is no news.
    let before = scene.events.len();
    let facts = "(at turtlebot-1 hall) (known-temperature office1) (= (temperature office1) 21.50)";
    scene.heartbeat("turtlebot-1", 2, facts);
    assert_eq!(scene.events.len(), before);
}

#[test]
fn a_new_plan_leads_to_the_agent_that_died() {
    let mut scene = Scene::new();
    scene.presence("turtlebot-1", true);
    scene.model("turtlebot-1", "(define (agent turtlebot-1))", "(at turtlebot-1 hall)");
    scene.ask_for_office1();
    scene.presence("turtlebot-1", false);
    let (chain, root) = scene.chain("(at turtlebot-1 hall)");
    let left = "`turtlebot-1` leaves `office-pi`";
    assert_eq!((&*chain[0], &*chain[1]), ("`(at turtlebot-1 hall)` is unknown", left));
    assert_eq!(root, HistoryRoot::Death);
    let why = "since the last plan, offers nothing now: `turtlebot-1`";
    scene.say(
        (Protocol::Goal, Performative::Confirm),
        ("requester", "ann"),
        ("ann.5.1", "g1", true),
        &Report::new(Outcome::Progress, why),
    );
    scene.plan("c2", "e2", "turtlebot-2", 2);
    scene.act("turtlebot-2", "s2");
    let (chain, root) = scene.chain("(measure turtlebot-2 office1)");
    assert_eq!(root, HistoryRoot::Death);
    assert_eq!(chain.last().map(String::as_str), Some(left));
    assert!(chain.iter().any(|text| text.contains("since the last plan")), "{chain:?}");
}

#[test]
fn a_change_takes_effect_when_it_is_confirmed() {
    let mut scene = Scene::new();
    let change = |fact: &str| {
        let believe = fact.to_owned();
        Request::ChangeState(ChangeState { believe, ..ChangeState::default() })
    };
    let request = (Protocol::StateChange, Performative::Request);
    let (to, from) = (("ann", "maintainer"), ("maintainer", "ann"));
    scene.say(request, to, ("ann.5.1", "t1", false), &change("(open d1)"));
    assert!(scene.events.values().all(|event| event.kind == HistoryKind::Request));
    let done = Report::new(Outcome::Done, "believed");
    scene.say((Protocol::StateChange, Performative::Confirm), from, ("ann.5.1", "t1", true), &done);
    let (chain, root) = scene.chain("(open d1)");
    assert_eq!(chain, ["`(open d1)` holds", "`ann` states `(open d1)`"]);
    assert_eq!(root, HistoryRoot::Person);
    scene.say(request, to, ("ann.5.2", "t2", false), &change("(open d2)"));
    let refusal = Refusal::new(Reason::Conflict, "another agent answers for it");
    scene.say(
        (Protocol::StateChange, Performative::Refuse),
        from,
        ("ann.5.2", "t2", true),
        &refusal,
    );
    assert!(scene.events.values().all(|event| *event.subject != *"(open d2)"));
    let (chain, _) = scene.chain("the state");
    assert!(chain[0].contains("another agent answers for it"), "{chain:?}");
}

#[test]
fn answers_and_arguments_are_not_kept() {
    let mut scene = Scene::new();
    scene.ask_for_office1();
    scene.act("turtlebot-1", "s1");
    scene.say(
        (Protocol::Query, Performative::QueryRef),
        ("turtlebot-1", "keyboard"),
        ("turtlebot-1.1.1", "q1", false),
        &Question::new("What is your PIN?"),
    );
    scene.say(
        (Protocol::Query, Performative::Inform),
        ("keyboard", "turtlebot-1"),
        ("turtlebot-1.1.1", "q1", true),
        &Inform::Answer(PersonsAnswer::plain("0815")),
    );
    let (chain, _) = scene.chain("What is your PIN?");
    assert_eq!(chain[0], "`keyboard` answers `What is your PIN?`");
    let told = format!("{:?}", scene.events);
    assert!(!told.contains("0815") && !told.contains("4711"));
}

#[test]
fn private_facts_are_marked_also_if_the_model_comes_later() {
    let mut scene = Scene::new();
    scene.heartbeat("turtlebot-1", 1, "(docked turtlebot-1) (at turtlebot-1 hall)");
    assert!(scene.events.is_empty(), "its model is not known yet");
    assert_eq!(scene.recorder.take_unknown_models(), [agent("turtlebot-1")].into());
    let model = "(define (agent turtlebot-1) (:predicates (:private (docked ?r - turtlebot))))";
    scene.recorder.learn_model(&agent("turtlebot-1"), model);
    scene.recorder.tick(scene.at_ms);
    scene.take();
    let is_private = |subject: &str| {
        scene.events.values().find(|event| *event.subject == *subject).expect("recorded").private
    };
    assert!(is_private("(docked turtlebot-1)"));
    assert!(!is_private("(at turtlebot-1 hall)"));
}

#[test]
fn what_the_maintainer_says_is_told_after_what_caused_it() {
    let mut scene = Scene::new();
    scene.model("lamp-1", "(define (agent lamp-1))", "");
    let epoch = EpochChange {
        epoch: 1,
        revision: 2,
        believed: "(lit lamp-1) (bright hall lamp-1)".to_owned(),
        ..EpochChange::default()
    };
    let message = scene.message(Performative::Inform, "maintainer", "", &Inform::Epoch(epoch));
    scene.recorder.hear(message, scene.at_ms);
    let (chain, _) = {
        scene.at_ms -= 1_000;
        scene.heartbeat("lamp-1", 2, "(lit lamp-1)");
        scene.chain("(lit lamp-1)")
    };
    assert_eq!(chain.len(), 1);
    scene.recorder.tick(scene.at_ms + 1_000);
    scene.take();
    let (chain, root) = scene.chain("(bright hall lamp-1)");
    assert_eq!(chain, ["`(bright hall lamp-1)` holds", "`(lit lamp-1)` holds"]);
    assert_eq!(root, HistoryRoot::Sensor);
    let count = scene.events.values().filter(|event| *event.subject == *"(lit lamp-1)").count();
    assert_eq!(count, 1);
}

/// A sensor that returns and says nothing of a fact, or denies it, does not end what another agent
/// claims; what the maintainer believes counts.
#[test]
fn a_returning_owner_does_not_end_the_claim_of_another() {
    let mut scene = Scene::new();
    let (sensor, robot) = ("thermometer-2", "turtlebot-1");
    scene.model(sensor, "(define (agent thermometer-2))", "(known office2)");
    scene.model(robot, "(define (agent turtlebot-1))", "");
    scene.presence(sensor, false);
    scene.heartbeat(robot, 2, "(known office2)");
    scene.presence(sensor, true);
    scene.model(sensor, "(define (agent thermometer-2))", "(not (known office2)) (not (dry))");
    scene.heartbeat(sensor, 2, "(at office2) (not (dry))");
    let told: Vec<_> =
        scene.events.values().filter(|event| *event.subject == *"(known office2)").collect();
    let sentences: Vec<_> = told.iter().map(|event| event.sentence()).collect();
    let (holds, unknown) = ("`(known office2)` holds", "`(known office2)` is unknown");
    assert_eq!(sentences, [holds, unknown, holds]);
    assert_eq!(&*told[2].agent, robot);
    let believed = "(dry)".to_owned();
    let epoch = EpochChange { epoch: 1, revision: 2, believed, ..EpochChange::default() };
    let message = scene.message(Performative::Inform, "maintainer", "", &Inform::Epoch(epoch));
    scene.hear(message);
    scene.recorder.tick(scene.at_ms + 1_000);
    scene.take();
    assert_eq!(scene.chain("(dry)").0[0], "`(dry)` holds");
}

#[test]
fn a_fact_that_expires_leads_to_the_clock() {
    let mut scene = Scene::new();
    scene.model("thermometer-1", "(define (agent thermometer-1))", "");
    let heartbeat = Heartbeat {
        digest: "d".to_owned(),
        sequence: 2,
        facts: "(= (temperature hall) 20) (lit hall)".to_owned(),
        known_for: [("(= (temperature hall) 20)".to_owned(), Millis(Duration::from_secs(5)))]
            .into(),
        period: Millis(Duration::from_secs(1)),
        stops: Vec::new(),
    };
    let beat = Inform::Heartbeat(heartbeat);
    let message = scene.message(Performative::Inform, "thermometer-1", "", &beat);
    scene.hear(message);
    let epoch = EpochChange {
        retracted: "(= (temperature hall) 20) (lit hall)".to_owned(),
        ..EpochChange::default()
    };
    let message = scene.message(Performative::Inform, "maintainer", "", &Inform::Epoch(epoch));
    scene.hear(message);
    scene.recorder.tick(scene.at_ms + 1_000);
    scene.take();
    let (chain, root) = scene.chain("(temperature hall)");
    assert_eq!(chain, ["`(temperature hall)` is unknown"]);
    assert_eq!(root, HistoryRoot::Clock);
    assert_eq!(scene.chain("(lit hall)").0, ["`(lit hall)` holds"]);
}

#[test]
fn a_stop_is_recorded_once_and_explains_refusals() {
    let mut scene = Scene::new();
    scene.ask_for_office1();
    let stop = || Stop {
        id: "stop-1".to_owned(),
        scope: Vec::new(),
        by: agent("ann"),
        why: "smoke".to_owned(),
    };
    let request = (Protocol::StateChange, Performative::Request);
    for robot in ["turtlebot-1", "turtlebot-2"] {
        let token = format!("stop-{robot}");
        scene.say(request, ("ann", robot), ("ann.5.9", &token, false), &Request::Stop(stop()));
        let mut report = Report::new(Outcome::Done, "stopped");
        report.stop_effect = Some(StopEffect::Ended);
        let confirm = (Protocol::StateChange, Performative::Confirm);
        scene.say(confirm, (robot, "ann"), ("ann.5.9", &token, true), &report);
    }
    let is_stop = |event: &&RecordedEvent| event.sentence() == "`ann` stops everything: smoke";
    assert_eq!(scene.events.values().filter(is_stop).count(), 1);
    scene.act("turtlebot-1", "s1");
    let refusal = Refusal::new(Reason::Stopped, "a stop is in force");
    let refuse = (Protocol::Action, Performative::Refuse);
    scene.say(refuse, ("turtlebot-1", "executor"), ("ann.5.1", "s1", true), &refusal);
    let (chain, _) = scene.chain("(measure turtlebot-1 office1)");
    assert!(chain[0].contains("declines") && chain[1].contains("smoke"), "{chain:?}");
}

#[test]
fn a_goal_that_was_not_heard_is_named_by_its_call() {
    let mut scene = Scene::new();
    scene.plan("c1", "e1", "turtlebot-1", 1);
    let report = (Protocol::Goal, Performative::Confirm);
    let done = Report::new(Outcome::Done, "21.5 °C");
    scene.say(report, ("requester", "ann"), ("ann.5.1", "g1", true), &done);
    let (chain, _) = scene.chain("(known-temperature office1)");
    assert_eq!(chain[0], "`(known-temperature office1)` is reached: 21.5 °C");
}

#[test]
fn an_agent_that_has_nothing_to_stop_is_no_event() {
    let mut scene = Scene::new();
    let stop = Request::Stop(Stop {
        id: "stop-1".to_owned(),
        scope: Vec::new(),
        why: String::new(),
        by: agent("ann"),
    });
    let (to, from) = (("ann", "requester"), ("requester", "ann"));
    let protocol = Protocol::StateChange;
    scene.say((protocol, Performative::Request), to, ("ann.5.9", "t1", false), &stop);
    let before = scene.events.len();
    let refusal = Refusal::new(Reason::Incapable, "takes goals only");
    scene.say((protocol, Performative::Refuse), from, ("ann.5.9", "t1", true), &refusal);
    assert_eq!(scene.events.len(), before);
    let refusal = Refusal::new(Reason::Other, "jammed");
    scene.say((protocol, Performative::Refuse), from, ("ann.5.9", "t1", true), &refusal);
    assert_eq!(scene.events.len(), before + 1);
}

#[test]
fn a_history_that_begins_again_knows_its_goals() {
    let mut scene = Scene::new();
    scene.ask_for_office1();
    let newest = *scene.events.keys().next_back().expect("an event");
    let goal = |conversation: &str| PastGoal {
        conversation: conversation.into(),
        goal: "(known-temperature office1)".into(),
        number: 1,
        root: HistoryRoot::Person,
    };
    let past = PastHistory { newest_ms: Some(scene.at_ms), goals: vec![goal("ann.5.1")] };
    scene.recorder = EventRecorder::new(newest);
    scene.at_ms += 60_000;
    scene.recorder.resume(past, "history", scene.at_ms);
    let of_goal = |scene: &Scene| {
        scene.events.values().filter(|event| event.kind == HistoryKind::Goal).count()
    };
    let before = of_goal(&scene);
    scene.act("turtlebot-1", "s1");
    let (chain, root) = scene.chain("(measure turtlebot-1 office1)");
    assert_eq!(chain[1], "`ann` asks for `(known-temperature office1)`, to be kept");
    assert_eq!((chain.len(), root, of_goal(&scene)), (2, HistoryRoot::Person, before));
    scene.recorder.joined("turtlebot-1", "vm", true, scene.at_ms);
    scene.take();
    let (chain, root) = scene.chain("turtlebot-1");
    let outage = "`history` records again; it did not run, for at most 1m";
    assert_eq!(chain, ["`turtlebot-1` is at `vm`, as the history begins again", outage]);
    assert_eq!(root, HistoryRoot::Death);
    scene.recorder.resume(PastHistory::default(), "history", scene.at_ms);
    assert!(scene.recorder.take_events().is_empty(), "a new history has no outage");
}

#[test]
fn each_day_begins_a_segment() {
    let mut scene = Scene::new();
    scene.presence("a", true);
    scene.at_ms += DAY_MS;
    scene.presence("b", true);
    let numbers: Vec<_> = scene.events.keys().copied().collect();
    assert_eq!(numbers, [1, SEGMENT_EVENTS]);
}

#[test]
fn malformed_messages_are_ignored() {
    let mut random = fastrand::Rng::with_seed(1);
    let mut scene = Scene::new();
    scene.ask_for_office1();
    let contents = [
        serde_json::json!(null),
        serde_json::json!({"of": "epoch", "believed": ")))((("}),
        serde_json::json!({"of": "heartbeat", "facts": 7}),
        serde_json::json!({"act": "act", "token": []}),
        serde_json::json!({"act": "execute", "plan": "(((("}),
        serde_json::json!({"outcome": "done", "detail": "`"}),
        serde_json::json!({"act": "change-state", "believe": "(= (x) 1) (("}),
    ];
    let protocols =
        [Protocol::Goal, Protocol::ContractNet, Protocol::Action, Protocol::StateChange];
    for _ in 0..5_000 {
        let performative = Performative::ALL[random.usize(..12)];
        let to = ["", "x", "turtlebot-1"][random.usize(..3)];
        let content = &contents[random.usize(..contents.len())];
        let mut message = scene.message(performative, "ann", to, content);
        message.protocol = Some(protocols[random.usize(..4)]);
        message.in_reply_to =
            random.bool().then(|| ReplyToken::new(["g1", "c1", "e1"][random.usize(..3)]));
        message.reply_with = random.bool().then(|| ReplyToken::new("n"));
        message.conversation_id =
            ConversationId::new(["ann.5.1", "", ".", "ann.5.2"][random.usize(..4)]);
        scene.hear(message);
    }
    for event in scene.events.values() {
        assert!(
            event
                .cause
                .is_none_or(|cause| cause < event.number && scene.events.contains_key(&cause))
        );
    }
}

/// The Domain Maintainer may tell a fact of an agent before the model of that agent is known.
#[test]
fn a_fact_that_nobody_has_declared_yet_counts_as_private() {
    let mut recorder = EventRecorder::new(0);
    recorder.learn_ontology(["at".to_owned()]);
    let is_private = |recorder: &mut EventRecorder, fact: &str| {
        let cause = EventCause::Root(HistoryRoot::Sensor);
        let text = format!("`{fact}` holds");
        recorder.record(EventDraft::new(HistoryKind::Fact, fact, "maintainer", text, cause), 1);
        recorder.take_events().iter().any(|event| event.private)
    };
    assert!(!is_private(&mut recorder, "(at robot-1 hall)"));
    assert!(is_private(&mut recorder, "(docked robot-1)"));
    assert!(is_private(&mut recorder, "(charge robot-1)"));
    let model = "(define (agent robot-1) (:predicates (:private (docked ?r))) \
                 (:functions (charge ?r)))";
    recorder.learn_model(&agent("robot-1"), model);
    assert!(is_private(&mut recorder, "(docked robot-1)"));
    assert!(!is_private(&mut recorder, "(CHARGE robot-1)"));
}

/// Knowledge predicates and guards of the domain of all agents are as private as what they are of.
#[test]
fn auxiliary_facts_are_as_private_as_what_they_are_of() {
    let mut recorder = EventRecorder::new(0);
    recorder.learn_ontology(["temperature".to_owned()]);
    let model = "(define (agent robot-1) (:predicates (:private (docked ?r))))";
    recorder.learn_model(&agent("robot-1"), model);
    let mut is_private = |fact: &str| {
        let cause = EventCause::Root(HistoryRoot::Sensor);
        recorder.record(EventDraft::new(HistoryKind::Fact, fact, "maintainer", "", cause), 1);
        recorder.take_events().iter().any(|event| event.private)
    };
    for public in ["(found-temperature hall)", "(unknown-temperature hall)", "(offers-move r)"] {
        assert!(!is_private(public), "{public}");
    }
    for private in ["(docked r)", "(unknown-docked r)", "(found-docked-2 r)", "(unknown-x r)"] {
        assert!(is_private(private), "{private}");
    }
}

/// An announcement about facts of an agent waits for the model of that agent.
#[test]
fn announced_facts_wait_for_their_declaration() {
    let announce = |scene: &mut Scene, revision: u64, believed: &str, retracted: &str| {
        let (believed, retracted) = (believed.to_owned(), retracted.to_owned());
        let epoch = EpochChange { epoch: 1, revision, believed, retracted, ..Default::default() };
        let message = scene.message(Performative::Inform, "maintainer", "", &Inform::Epoch(epoch));
        scene.recorder.hear(message, scene.at_ms);
    };
    let mut scene = Scene::new();
    scene.recorder.learn_ontology(["at".to_owned()]);
    announce(&mut scene, 2, "(charged r) (at r hall)", "");
    announce(&mut scene, 3, "", "(at r hall)");
    scene.recorder.tick(scene.at_ms + 1_000);
    scene.take();
    assert!(scene.events.is_empty());
    let model = "(define (agent r) (:predicates (charged ?r)))";
    scene.recorder.learn_model(&agent("r"), model);
    scene.recorder.tick(scene.at_ms + 1_000);
    scene.take();
    assert!(scene.events.values().all(|event| !event.private), "{:?}", scene.events);
    assert_eq!(scene.chain("(charged r)").0[0], "`(charged r)` holds");
    assert_eq!(scene.chain("(at r hall)").0[0], "`(at r hall)` holds no longer");
    // Without a model the fact counts as private after a while.
    announce(&mut scene, 4, "(locked r)", "");
    scene.recorder.tick(scene.at_ms + 2 * MODEL_DELAY_MS);
    scene.take();
    assert!(scene.events.values().any(|event| event.private));
}
