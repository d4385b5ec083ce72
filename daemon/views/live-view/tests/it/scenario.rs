//! The first scenario of the paper, told by hand-made messages: two rooms, a thermometer that dies,
//! and a robot that takes its place.

use acl::content::{GoalPhase, Keep, Outcome};
use live_view::{
    ActivityLevel, AgentPresence, BidState, ConcernKind, FactTruth, Freshness, GoalStage,
    HealthLevel, Moment, StepState, ViewEvent, ViewSubject,
};
use serde_json::{Value, json};

use crate::messages::{Observer, agent, conversation, from_json, place};

const ROBOT: &str = "(:action move :agent ?b - mobile-base :parameters (?from ?to - location)
        :precondition (and (at ?b ?from) (connected ?from ?to))
        :effect (and (not (at ?b ?from)) (at ?b ?to) (increase (total-cost) 1)))
    (:action measure :agent ?b - mobile-base :parameters (?r - room)
        :precondition (at ?b ?r) :effect (known-temperature ?r))";

const THERMOMETER: &str = "(:action report-temperature :agent ?s - sensor :parameters (?r - room)
        :precondition (located ?s ?r) :effect (known-temperature ?r))";

const MAP: &str = "(connected corridor office1) (connected office1 corridor)
    (connected corridor office2) (connected office2 corridor)";

/// An office with a robot in the corridor and a thermometer in office 2.
fn office() -> Observer {
    let mut office = Observer::new();
    for (name, daemon) in
        [("robot-1", "laptop"), ("thermo-2", "pi"), ("plan-requester", "pi"), ("alice", "pi")]
    {
        office.observe(ViewEvent::Joined(place(name, daemon, 1)));
    }
    office.announce("robot-1", ROBOT, "(at robot-1 corridor)");
    office.announce("thermo-2", THERMOMETER, "(located thermo-2 office2)");
    office.after(5_000).beat("robot-1", 2, "(at robot-1 corridor)");
    office.beat("thermo-2", 2, "(located thermo-2 office2)");
    office
}

fn act(step: u32, round: u32, action: &str) -> Value {
    json!({
        "act": "act", "action": action, "method": "m", "arguments": {},
        "token": { "term": 7, "conversation": "g1", "round": round, "step": step },
    })
}

fn report(outcome: &str, detail: &str) -> Value {
    json!({ "outcome": outcome, "detail": detail })
}

fn execute(round: u32, plan: &str) -> Value {
    let problem = format!(
        "(define (problem p) (:domain d) (:init {MAP} (offers-move robot-1)
         (unknown-motion office1)) (:goal (known-temperature office2)))"
    );
    json!({
        "act": "execute", "domain": "", "problem": problem, "plan": plan, "epoch": 1, "term": 7,
        "round": round,
        "offers": { "robot-1": { "move": { "schema": "move--r", "guard": "(offers-move robot-1)" } } },
        "knowledge": { "motion": { "of": "predicate", "unknown": "unknown-motion" } },
    })
}

const ROUND_1: &str = "(report-temperature thermo-2 office2)\n(move--r robot-1 corridor office1)\n(measure robot-1 office1)\n";

/// Alice asks, the agents bid, and the first plan is being executed.
fn asked(office: &mut Observer) {
    let goal = json!({ "act": "achieve", "goal": "(forall (?r - room)\n (known-temperature ?r))", "keep": "maintain" });
    office.hear("alice>plan-requester request goal g1 x1", goal);
    let conjuncts =
        json!({ "conjuncts": ["(known-temperature office1)", "(known-temperature office2)"] });
    office.after(10).hear("plan-requester>* cfp contract-net g1 x2", conjuncts);
    let bid = |covers: &str, cost: f64| json!({ "proposals": [{ "covers": [covers], "plan": "(do it)", "cost": cost }], "domain_digest": "" });
    office.after(20).hear(
        "thermo-2>plan-requester agree contract-net g1 x2",
        bid("(known-temperature office2)", 1.0),
    );
    office.after(5).hear(
        "robot-1>plan-requester agree contract-net g1 x2",
        bid("(known-temperature office1)", 6.0),
    );
    let nothing = json!({ "reason": "incapable", "detail": "it offers nothing for that" });
    office.hear("screen-1>plan-requester refuse contract-net g1 x2", nothing);
    let choice = json!({ "covers": ["(known-temperature office2)"], "detail": "cheapest" });
    office.after(5).hear("plan-requester>thermo-2 accept-proposal contract-net g1 x2", choice);
    office.hear("plan-requester>plan-executor request execution g1 x3", execute(1, ROUND_1));
    let mut found = report("progress", "a plan of 3 steps, cost 7");
    found["plan"] = json!(ROUND_1.replace("move--r", "move"));
    found["cost"] = json!(7.0);
    office.hear("plan-requester>alice confirm goal g1 x1", found);
    office.hear(
        "plan-executor>thermo-2 request action g1 a0",
        act(0, 1, "(report-temperature thermo-2 office2)"),
    );
    office.hear(
        "plan-executor>robot-1 request action g1 a1",
        act(1, 1, "(move robot-1 corridor office1)"),
    );
    office.after(2).hear("robot-1>plan-executor agree action g1 a1", json!({ "token": {} }));
    office.hear("thermo-2>plan-executor agree action g1 a0", json!({ "token": {} }));
    office
        .after(98)
        .hear("thermo-2>plan-executor confirm action g1 a0", report("done", "21.5 °C at office2"));
}

#[test]
fn a_goal_shows_its_plan_with_the_times_of_its_steps() {
    let mut office = office();
    asked(&mut office);
    let started = office.now.minus(100);
    office.after(1_000);
    let goals = office.view.goals(office.now);
    assert_eq!(goals.len(), 1);
    let row = &goals[0];
    assert_eq!(row.goal, "(forall (?r - room) (known-temperature ?r))");
    assert_eq!((row.requester.clone(), row.keep), (Some(agent("alice")), Some(Keep::Maintain)));
    assert_eq!((row.stage, row.steps, row.steps_done), (GoalStage::Running, 3, 1));
    assert_eq!(row.text, "executing: 1 of 3 steps done");
    assert_eq!(
        (row.cost, row.now.as_slice()),
        (Some(7.0), ["robot-1 moves to office1".to_owned()].as_slice())
    );

    let detail = office.view.goal(&conversation("g1"), office.now).expect("known");
    assert_eq!(detail.plans.len(), 1);
    let plan = &detail.plans[0];
    assert_eq!((plan.term, plan.round, plan.cost), (7, 1, Some(7.0)));
    let states: Vec<_> = plan.steps.iter().map(|step| step.state).collect();
    assert_eq!(states, [StepState::Done, StepState::Running, StepState::Next]);
    assert_eq!(plan.steps[0].started_at, Some(started));
    assert_eq!(plan.steps[0].ended_at, Some(started.plus(100)));
    assert_eq!((plan.steps[0].usual_ms, plan.steps[1].usual_ms), (Some(100), None));
    assert_eq!(plan.steps[0].detail, "21.5 °C at office2");
    assert_eq!(plan.steps[1].step, "(move robot-1 corridor office1)", "its own name");
    assert_eq!(plan.steps[1].agent, Some(agent("robot-1")));
    assert_eq!(plan.steps[1].arguments, ["corridor", "office1"]);
    assert_eq!((plan.begins_at, plan.ends_at), (started, office.now));
}

#[test]
fn the_bids_of_a_call_tell_the_winner() {
    let mut office = office();
    asked(&mut office);
    let detail = office.view.goal(&conversation("g1"), office.now).expect("known");
    let call = &detail.calls[0];
    let bids: Vec<_> =
        call.bids.iter().map(|bid| (bid.agent.as_str(), bid.after_ms, bid.state)).collect();
    assert_eq!(
        bids,
        [
            ("thermo-2", 20, BidState::Won),
            ("robot-1", 25, BidState::Offered),
            ("screen-1", 25, BidState::Declined),
        ]
    );
    assert!(call.bids[0].proposals[0].is_chosen && !call.bids[1].proposals[0].is_chosen);
    assert_eq!(call.bids[2].detail, "it offers nothing for that");
}

/// The robot has moved and measured, so that the goal holds.
fn reached(office: &mut Observer) {
    asked(office);
    office
        .after(900)
        .hear("robot-1>plan-executor confirm action g1 a1", report("done", "arrived at office1"));
    office.beat("robot-1", 3, "(at robot-1 office1)");
    office
        .hear("plan-executor>robot-1 request action g1 a2", act(2, 1, "(measure robot-1 office1)"));
    office.after(100).hear("robot-1>plan-executor confirm action g1 a2", report("done", "20.5 °C"));
}

#[test]
fn a_message_out_of_turn_is_marked() {
    let mut office = office();
    reached(&mut office);
    // The confirmation above came without an `agree`.
    let detail = office.view.conversation(&conversation("g1")).expect("known");
    let marked: Vec<_> = detail.messages.iter().filter(|row| row.out_of_turn.is_some()).collect();
    assert_eq!(marked.len(), 1);
    assert_eq!(marked[0].summary, "done: 20.5 °C");
    assert_eq!(detail.row.out_of_turn, 1);
    assert_eq!(detail.lanes[..2], [agent("alice"), agent("plan-requester")]);
    assert_eq!(detail.row.subject, "(forall (?r - room) (known-temperature ?r))");
    let overview = office.view.overview(office.now);
    assert_eq!(overview.counts.out_of_turn, 1);
    assert!(overview.concerns.iter().any(|concern| concern.kind == ConcernKind::OutOfTurn));
}

#[test]
fn a_goal_that_holds_is_planned_for_anew_after_a_death() {
    let mut office = office();
    asked(&mut office);
    office
        .after(900)
        .hear("robot-1>plan-executor confirm action g1 a1", report("done", "arrived at office1"));
    office.beat("robot-1", 3, "(at robot-1 office1)");
    office
        .hear("plan-executor>robot-1 request action g1 a2", act(2, 1, "(measure robot-1 office1)"));
    office.hear("robot-1>plan-executor agree action g1 a2", json!({ "token": {} }));
    office.after(100).hear("robot-1>plan-executor confirm action g1 a2", report("done", "20.5 °C"));
    office.hear(
        "plan-executor>plan-requester confirm execution g1 x3",
        report("done", "the goal holds"),
    );
    office.hear(
        "plan-requester>alice confirm goal g1 x1",
        report("holds", "the goal holds; it is watched"),
    );
    let row = &office.view.goals(office.now)[0];
    assert_eq!((row.stage, row.text.as_str(), row.steps_done), (GoalStage::Holding, "holds", 3));
    let overview = office.view.overview(office.now);
    assert_eq!(overview.verdict, HealthLevel::Well, "{overview:#?}");
    assert_eq!(overview.summary, "all is well: 1 goal holds, 6 agents here");

    office.after(100).observe(ViewEvent::Left(place("thermo-2", "pi", 1)));
    office.hear(
        "plan-requester>plan-executor request execution g1 x4",
        execute(2, "(move--r robot-1 office1 corridor)\n(move--r robot-1 corridor office2)\n"),
    );
    office.hear(
        "plan-executor>robot-1 request action g1 b0",
        act(0, 2, "(move robot-1 office1 corridor)"),
    );
    office.after(100);
    let detail = office.view.goal(&conversation("g1"), office.now).expect("known");
    let rounds: Vec<_> = detail.plans.iter().map(|plan| (plan.round, plan.outcome)).collect();
    assert_eq!(rounds, [(2, None), (1, Some(Outcome::Done))], "the newest one first");
    assert_eq!((detail.row.stage, detail.row.rounds), (GoalStage::Running, 2));
    // Earlier moves took 900 ms + 100 ms, so the second one begins when the first one ends.
    let [first, second] = detail.plans[0].steps.as_slice() else { panic!("two steps") };
    assert_eq!(first.usual_ms, Some(1_000));
    assert_eq!(first.expected_end, Some(office.now.plus(900)));
    assert_eq!(second.expected_start, first.expected_end);
    assert_eq!(detail.row.expected_end, Some(office.now.plus(1_900)));
    assert_eq!(detail.plans[0].ends_at, office.now.plus(1_900));

    let sentences = office.sentences();
    for sentence in [
        "alice asks for (forall (?r - room) (known-temperature ?r)), and to keep it",
        "thermo-2 is chosen for (known-temperature office2)",
        "robot-1 moves to office1",
        "robot-1: arrived at office1",
        "thermo-2 is gone",
    ] {
        assert!(sentences.iter().any(|said| said == sentence), "{sentence}: {sentences:#?}");
    }
    let gone = office.view.activity().find(|entry| entry.text == "thermo-2 is gone").expect("told");
    assert_eq!((gone.level, gone.agent.clone()), (ActivityLevel::Problem, Some(agent("thermo-2"))));
    let overview = office.view.overview(office.now);
    assert_eq!(overview.verdict, HealthLevel::Attention);
    let [concern] = overview.concerns.as_slice() else { panic!("{overview:#?}") };
    assert_eq!(concern.subject, Some(ViewSubject::Agent(agent("thermo-2"))));
    assert_eq!(concern.text, "thermo-2 has been gone for 100 ms");
}

#[test]
fn a_step_that_takes_too_long_is_late() {
    let mut office = office();
    asked(&mut office);
    office.after(900).hear("robot-1>plan-executor confirm action g1 a1", report("done", "arrived"));
    office.hear(
        "plan-requester>plan-executor request execution g1 x4",
        execute(2, "(move--r robot-1 office1 corridor)\n"),
    );
    office.hear(
        "plan-executor>robot-1 request action g1 b0",
        act(0, 2, "(move robot-1 office1 corridor)"),
    );
    office.after(1_200);
    assert_eq!(office.view.goals(office.now)[0].late_ms, None, "within the tolerance");
    office.after(2_000).beat("robot-1", 9, "(at robot-1 office1)").beat("thermo-2", 9, "");
    let row = &office.view.goals(office.now)[0];
    assert_eq!(row.late_ms, Some(2_200));
    let overview = office.view.overview(office.now);
    let [concern] = overview.concerns.as_slice() else { panic!("{overview:#?}") };
    assert_eq!((concern.kind, concern.level), (ConcernKind::StepLate, HealthLevel::Attention));
    assert_eq!(concern.text, "robot-1 moves to corridor: 2 s longer than usual");
    let robot = office.view.agent(&agent("robot-1"), office.now).expect("known");
    assert_eq!(
        (robot.row.doing.as_deref(), robot.row.late_ms),
        (Some("robot-1 moves to corridor"), Some(2_200))
    );
    assert_eq!((robot.running.len(), robot.actions[1].action.as_str()), (1, "move"));
    assert_eq!((robot.actions[1].runs, robot.actions[1].usual_ms), (1, Some(1_000)));
}

#[test]
fn failures_and_refusals_are_told() {
    let mut office = office();
    asked(&mut office);
    office
        .after(5)
        .hear("robot-1>plan-executor confirm action g1 a1", report("failed", "a door is shut"));
    office.hear(
        "plan-executor>plan-requester confirm execution g1 x3",
        report("failed", "(move …): `robot-1` failed: a door is shut"),
    );
    office.hear(
        "plan-requester>alice confirm goal g1 x1",
        report("progress", "planning anew: a door is shut"),
    );
    let detail = office.view.goal(&conversation("g1"), office.now).expect("known");
    let states: Vec<_> = detail.plans[0].steps.iter().map(|step| step.state).collect();
    assert_eq!(states, [StepState::Done, StepState::Failed, StepState::Cancelled]);
    assert_eq!(
        (detail.row.stage, detail.plans[0].outcome),
        (GoalStage::Planning, Some(Outcome::Failed))
    );
    assert_eq!(detail.row.now, Vec::<String>::new());
    office.hear(
        "plan-requester>alice confirm goal g1 x1",
        report("progress", "no plan now: no way; waiting for the ecosystem to change"),
    );
    let overview = office.view.overview(office.now);
    assert_eq!(overview.concerns[0].kind, ConcernKind::GoalWaits, "{overview:#?}");
    office.hear("plan-requester>alice confirm goal g1 x1", report("failed", "given up"));
    let overview = office.view.overview(office.now);
    assert_eq!(
        (overview.verdict, overview.summary.as_str()),
        (HealthLevel::Bad, "1 thing is wrong")
    );
    let expected = "(forall (?r - room) (known-temperature ?r)) has failed: given up";
    assert_eq!(overview.concerns[0].text, expected);
    office.after(11 * 60_000).beat("robot-1", 9, "").beat("thermo-2", 9, "");
    assert_eq!(office.view.overview(office.now).verdict, HealthLevel::Well, "it is long ago");
}

#[test]
fn the_floor_plan_shows_robots_on_their_way() {
    let mut office = office();
    let empty = Observer::new().view.floor(Moment(0));
    assert!(!empty.empty_because.is_empty());
    asked(&mut office);
    let floor = office.view.floor(office.now);
    let rooms: Vec<_> = floor.rooms.iter().map(|room| room.name.as_str()).collect();
    assert_eq!(rooms, ["corridor", "office1", "office2"]);
    assert!(floor.ways.iter().all(|way| way.both_ways) && floor.ways.len() == 2);
    let [robot] = floor.robots.as_slice() else { panic!("{floor:#?}") };
    assert_eq!(robot.room.as_deref(), Some("corridor"));
    assert_eq!(
        (robot.moves_to.as_deref(), robot.path.as_slice()),
        (Some("office1"), ["office1".to_owned()].as_slice())
    );
    assert_eq!(robot.conversation, Some(conversation("g1")));
    assert_eq!(floor.rooms[0].robots, [agent("robot-1")]);
    assert!(!robot.is_stale);

    let beat = json!({
        "of": "heartbeat", "digest": "d", "sequence": 5, "period": 1000,
        "facts": "(= (temperature office2) 21.50) (known-temperature office2) (unknown (motion office2))",
        "known_for": { "(known-temperature office2)": 500 },
    });
    office.hear("thermo-2>* inform - t -", beat);
    let room = office.view.floor(office.now).rooms.remove(2);
    assert_eq!(room.facts, ["temperature 21.5", "known-temperature", "motion unknown"]);
    assert!(room.is_stale, "something is unknown");
    office.after(600);
    let facts = office.view.facts(office.now);
    let known = facts.iter().find(|fact| fact.predicate == "known-temperature").expect("a fact");
    assert_eq!(
        (known.freshness, known.owners.as_slice()),
        (Freshness::Stale, ["thermo-2".to_owned()].as_slice())
    );
    let unknown = facts.iter().find(|fact| fact.predicate == "motion").expect("a fact");
    assert_eq!(unknown.truth, FactTruth::Unknown);
    assert!(
        facts.iter().all(|fact| !fact.predicate.starts_with("offers-")
            && !fact.predicate.starts_with("unknown-")),
        "{facts:#?}"
    );
}

#[test]
fn an_observer_that_comes_late_is_not_confused() {
    let mut office = Observer::new();
    office.hear("robot-1>plan-executor confirm action g1 a0", report("done", "arrived"));
    office.hear("plan-executor>robot-1 request action g1 a4", act(4, 2, "(move robot-1 a b)"));
    office.hear("plan-executor>plan-requester confirm execution g1 x3", report("progress", "x"));
    office
        .hear("plan-requester>robot-1 accept-proposal contract-net g1 x2", json!({ "detail": "" }));
    let detail = office.view.goal(&conversation("g1"), office.now).expect("a step makes it known");
    assert_eq!((detail.row.goal.as_str(), detail.row.stage), ("", GoalStage::Running));
    assert_eq!((detail.row.steps, detail.plans[0].steps.len()), (5, 1));
    office.observe(ViewEvent::Goals(from_json(json!([{
        "conversation": "g1", "goal": "(at robot-1 b)", "keep": "achieve", "priority": 2,
        "phase": "executing", "rounds": 2, "history": [{ "at_ms": 5, "text": "begun" }],
    }]))));
    let row = &office.view.goals(office.now)[0];
    assert_eq!(
        (row.goal.as_str(), row.phase, row.priority),
        ("(at robot-1 b)", Some(GoalPhase::Executing), 2)
    );
    office.after(60_000).observe(ViewEvent::Goals(Vec::new()));
    let row = &office.view.goals(office.now)[0];
    assert!(row.stage.has_ended(), "it is not listed any more");
    assert_eq!(row.now, Vec::<String>::new());
    let waiting = json!([{
        "conversation": "g1", "goal": "(at robot-1 b)", "keep": "achieve", "priority": 2,
        "phase": "waiting-for-change", "waits_because": "no way leads there", "rounds": 2,
        "history": [],
    }]);
    office.observe(ViewEvent::Goals(from_json(waiting.clone())));
    let row = &office.view.goals(office.now)[0];
    assert_eq!((row.stage, row.ended_at), (GoalStage::Waiting, None), "another replica lists it");
    assert_eq!(row.text, "waiting: no way leads there");
    office.hear("plan-requester>alice confirm goal g1 x1", report("done", "it holds"));
    office.observe(ViewEvent::Goals(from_json(waiting)));
    let row = &office.view.goals(office.now)[0];
    assert_eq!((row.stage, row.phase), (GoalStage::Done, None), "the list is older");
}

#[test]
fn goals_by_the_clock_are_listed_with_their_times() {
    let mut office = office();
    let listed = |pursued: Option<&str>| {
        from_json::<Vec<acl::content::GoalStatus>>(json!([{
            "conversation": "goals.warm", "number": 3, "goal": "(warm hall)", "keep": "achieve",
            "priority": 0, "phase": "waiting-for-change", "waits_because": "for Thursday 08:00",
            "rounds": 0, "history": [{ "at_ms": 5, "text": "stands in the file" }],
            "due": { "words": "every day 08:00", "next-ms": 90_000_000, "next": "Thursday 08:00",
                "pursued": pursued },
        }]))
    };
    office.observe(ViewEvent::Goals(listed(None)));
    let find = |office: &Observer| {
        let goals = office.view.goals(office.now);
        goals.into_iter().find(|goal| goal.goal == "(warm hall)").expect("it is listed")
    };
    let row = find(&office);
    assert_eq!((row.stage, row.number, row.is_of_file), (GoalStage::Scheduled, Some(3), true));
    assert_eq!(row.text, "next: Thursday 08:00 (every day 08:00)");
    let due = row.due.expect("times");
    assert_eq!((due.next_at, due.pursued), (Some(Moment(90_000_000)), None));
    let overview = office.view.overview(office.now);
    assert_eq!((overview.counts.goals_scheduled, overview.counts.goals_waiting), (1, 0));
    assert!(overview.summary.contains("1 goal by the clock"), "{}", overview.summary);
    office.observe(ViewEvent::Goals(listed(Some("goals.warm@1"))));
    assert!(find(&office).text.ends_with("; now pursued as goals.warm@1"));
    let cancelled = report("cancelled", "it is not asked for any more");
    office.hear("plan-requester>alice confirm goal goals.warm x9", cancelled);
    let row = find(&office);
    assert_eq!((row.stage, row.due.is_some()), (GoalStage::Cancelled, true));
    // The answer to an older query.
    office.observe(ViewEvent::Goals(listed(None)));
    assert_eq!(find(&office).stage, GoalStage::Cancelled);
}

#[test]
fn a_deadline_of_a_pursued_goal_is_shown() {
    let mut office = office();
    office.observe(ViewEvent::Goals(from_json(json!([{
        "conversation": "c9", "number": 4, "goal": "(warm hall)", "keep": "achieve",
        "priority": 0, "phase": "executing", "rounds": 1, "history": [],
        "due": { "words": "", "by-ms": 90_000_000, "ends-ms": 95_000_000 },
    }]))));
    let goals = office.view.goals(office.now);
    let row = goals.iter().find(|goal| goal.number == Some(4)).expect("it is listed");
    let due = row.due.as_ref().expect("limits");
    assert_eq!((row.stage, due.reach_by), (GoalStage::Running, Some(Moment(90_000_000))));
    assert_eq!((due.given_up_at, row.is_of_file), (Some(Moment(95_000_000)), false));
}

#[test]
fn an_action_that_a_person_requests_is_shown_like_a_goal() {
    let mut office = office();
    let mut plan = execute(1, "(move--r robot-1 corridor office1)\n");
    plan["term"] = json!(0);
    plan["problem"] = json!("(define (problem p) (:domain d) (:init) (:goal (and)))");
    office.hear("alice>plan-executor request execution c1 x1", plan);
    let row = &office.view.goals(office.now)[0];
    assert_eq!(
        (row.goal.as_str(), row.stage),
        ("(move robot-1 corridor office1)", GoalStage::Running)
    );
    assert_eq!(row.requester, Some(agent("alice")));
    office.hear("plan-executor>alice confirm execution c1 x1", report("done", "arrived"));
    let row = &office.view.goals(office.now)[0];
    assert_eq!((row.stage, row.steps_done), (GoalStage::Done, 1));
}

#[test]
fn the_answers_of_people_are_not_kept() {
    let mut office = office();
    let question = json!({ "text": "PIN of office 1?", "seal_to": "85" });
    office.hear("door>* query-ref query q1 e1", question);
    let rows = office.view.questions(office.now);
    assert_eq!((rows.len(), rows[0].is_secret, rows[0].remaining_ms), (1, true, Some(60_000)));
    let given = json!({ "act": "answer-question", "question": 1, "text": "2718-secret" });
    office.hear("alice>keyboard request state-change q2 e2", given);
    office
        .hear("keyboard>door inform query q1 e1", json!({ "of": "answer", "text": "2718-secret" }));
    office.hear("keyboard>door inform query q3 e3", json!({ "pin": "2718-secret" }));
    assert!(office.view.questions(office.now).is_empty());
    let everything = format!("{:?}", office.view);
    assert!(everything.contains("PIN of office 1?") && !everything.contains("2718-secret"));
}

#[test]
fn stops_questions_and_lost_messages_are_concerns() {
    let mut office = office();
    let stop = json!({ "act": "stop", "id": "9f", "scope": [], "by": "ann", "why": "smoke" });
    office.hear("ann>robot-1 request state-change s1 e1", stop.clone());
    office.hear("ann>thermo-2 request state-change s1 e2", stop);
    office.hear("door>* query-ref query q1 e3", json!({ "text": "Who is there?" }));
    office.observe(ViewEvent::Lost(12));
    let overview = office.view.overview(office.now);
    assert_eq!(overview.summary, "1 thing is wrong, and 2 things need attention");
    let texts: Vec<_> = overview.concerns.iter().map(|concern| concern.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "everything is stopped by ann: smoke",
            "door asks: Who is there?",
            "12 messages not observed"
        ]
    );
    let stops = office.sentences().iter().filter(|said| said.contains("stops")).count();
    assert_eq!(stops, 1, "each actuator is asked, and one sentence is enough");
    let declines = json!({ "reason": "incapable", "detail": "a journal does not act" });
    office.hear("journal>ann refuse state-change s1 e1", declines);
    assert!(!office.sentences().iter().any(|said| said.contains("a journal does not act")));
    let doubtful = report("failed", "the motor does not confirm that it stands still");
    office.hear("robot-1>ann confirm state-change s1 e1", doubtful);
    let last = office.view.activity().next_back().expect("told");
    assert_eq!(last.level, ActivityLevel::Problem);
    assert_eq!(last.text, "robot-1: the motor does not confirm that it stands still");
    assert_eq!(office.view.conversations().len(), 1, "each agent is stopped on its own");
    assert!(office.view.agents(office.now).iter().any(|row| row.is_stopped));
    office.hear(
        "ann>robot-1 request state-change s2 e4",
        json!({ "act": "release-stops", "ids": ["9f"] }),
    );
    assert_eq!(office.view.overview(office.now).counts.stops, 0);
}

#[test]
fn daemons_tell_leaders_and_certificates() {
    let mut office = office();
    office.observe(ViewEvent::Joined(place("plan-requester", "laptop", 2)));
    office.observe(ViewEvent::Joined(place("cli", "pi--cli-1", 2)));
    office.observe(ViewEvent::Joined(place("cli-2", "cli-vm-77", 2)));
    office.observe(ViewEvent::RoundTrip { daemon: from_json(json!("pi")), micros: 9 });
    office.observe(ViewEvent::Daemon(from_json(json!({
        "daemon": "laptop", "version": "0.1.0", "uptime": 60_000, "agents": 2,
        "leads": ["plan-requester"], "stands_by": [], "certificate_days_left": 3,
    }))));
    for micros in [300, 100, 200] {
        let daemon = from_json(json!("laptop"));
        office.observe(ViewEvent::RoundTrip { daemon, micros });
    }
    for silent in ["pi", "cli-vm-77"] {
        office.observe(ViewEvent::NoAnswer(from_json(json!(silent))));
    }
    let mailbox = |overflowed: u64| {
        from_json(json!({
            "daemon": "laptop", "unknown_receiver": 0, "unreadable": 0, "not_sent": 0,
            "mailboxes": [{ "agent": "robot-1", "waiting": 2, "waiting_max": 3, "received": 9, "overflowed": overflowed }],
        }))
    };
    let of_guest = json!({
        "daemon": "pi--cli-1", "unknown_receiver": 0, "unreadable": 0, "not_sent": 0,
        "mailboxes": [],
    });
    office.observe(ViewEvent::Mailboxes(from_json(of_guest)));
    office.observe(ViewEvent::Mailboxes(mailbox(1)));
    office.observe(ViewEvent::Mailboxes(mailbox(4)));
    office.after(1_000);
    let rows = office.view.topology(office.now);
    let names: Vec<_> = rows.iter().map(|row| row.daemon.as_str()).collect();
    assert_eq!(names, ["laptop", "pi"], "a guest is no daemon");
    let laptop = &rows[0];
    assert_eq!((laptop.agents, laptop.uptime_ms), (2, Some(61_000)));
    assert_eq!((laptop.round_trip_micros, laptop.usual_round_trip_micros), (Some(200), Some(200)));
    assert_eq!(laptop.leads, [agent("plan-requester")]);
    assert_eq!(
        laptop.problems,
        ["its certificate ends in 3 days", "3 messages did not fit into mailboxes"]
    );
    assert_eq!(rows[1].problems, ["it does not answer"]);
    let requester = office.view.agent(&agent("plan-requester"), office.now).expect("known");
    assert_eq!(requester.row.daemon.map(|daemon| daemon.to_string()), Some("laptop".to_owned()));
    assert_eq!(requester.replicas[0].leads, Some(true));
    let robot = office.view.agent(&agent("robot-1"), office.now).expect("known");
    assert_eq!(robot.row.waiting, Some(2));
    let overview = office.view.overview(office.now);
    assert_eq!((overview.verdict, overview.counts.daemons), (HealthLevel::Bad, 2));
    for (name, life) in [("robot-1", 1), ("plan-requester", 2)] {
        office.observe(ViewEvent::Left(place(name, "laptop", life)));
    }
    let laptop = office.view.topology(office.now).remove(0);
    assert_eq!((laptop.is_reached, laptop.agents), (Some(false), 0));
    assert_eq!(laptop.problems[0], "it is gone");
}

#[test]
fn an_agent_of_the_file_that_is_not_here_is_a_concern() {
    let mut office = office();
    office.observe(ViewEvent::Expected(from_json(json!([
        { "agent": "robot-1", "daemons": ["laptop"] }, { "agent": "lamp", "daemons": ["pi"] },
    ]))));
    let lamp = office.view.agent(&agent("lamp"), office.now).expect("expected");
    assert_eq!(lamp.row.presence, AgentPresence::Absent);
    assert_eq!(office.view.overview(office.now).verdict, HealthLevel::Well, "no list yet");
    office.observe(ViewEvent::Expected(from_json(json!([
        { "agent": "robot-1", "daemons": ["laptop"] }, { "agent": "lamp", "daemons": ["attic"] },
    ]))));
    let here = ["robot-1", "thermo-2", "plan-requester", "alice"];
    let places = here.map(|name| place(name, if name == "robot-1" { "laptop" } else { "pi" }, 1));
    office.observe(ViewEvent::Directory(places.to_vec()));
    let attic = office.view.topology(office.now).remove(0);
    assert_eq!(attic.problems, ["the ecosystem file names it, and it is not here"]);
    assert_eq!(office.view.overview(office.now).verdict, HealthLevel::Well, "it may just start");
    office.observe(ViewEvent::Daemon(from_json(json!({
        "daemon": "laptop", "version": "0.1.0", "uptime": 60_000, "agents": 2,
    }))));
    let overview = office.view.overview(office.now);
    let [concern] = overview.concerns.as_slice() else { panic!("{overview:#?}") };
    assert_eq!(concern.text, "lamp is named in the ecosystem file, and is not here");
}

#[test]
fn an_action_model_that_was_not_observed_is_missing() {
    let mut office = office();
    assert_eq!(office.view.missing_models(9), []);
    office.beat("lamp", 1, "");
    let beat = json!({ "of": "heartbeat", "digest": "other", "sequence": 9, "period": 1000 });
    office.hear("thermo-2>* inform - t -", beat);
    assert_eq!(office.view.missing_models(9), [agent("lamp"), agent("thermo-2")]);
    assert_eq!(office.view.missing_models(1).len(), 1);
    // What a plan uses is offered.
    asked(&mut office);
    office.hear("plan-requester>plan-executor request execution g1 x9", {
        let mut plan = execute(2, "(switch-on lamp office1)\n");
        plan["offers"]["lamp"] =
            json!({ "switch-on": { "schema": "switch-on", "guard": "(g lamp)" } });
        plan
    });
    let lamp = office.view.agent(&agent("lamp"), office.now).expect("known");
    assert_eq!(lamp.row.actions, ["switch-on"]);
}

#[test]
fn the_storage_of_records_is_no_conversation() {
    let mut office = office();
    let stored = json!({ "act": "store-records", "records": [{ "key": "goal/g1", "version": { "term": 1, "count": 1 } }] });
    office.hear("plan-requester>journal request state-change r1 e1", stored);
    office.hear("journal>plan-requester confirm state-change r1 e1", report("done", "kept"));
    assert!(office.view.conversations().is_empty());
}

#[test]
fn rows_are_json_for_programs() {
    let mut office = office();
    asked(&mut office);
    let now = office.now;
    let json = serde_json::to_value(office.view.overview(now)).expect("plain data");
    assert_eq!(json["verdict"], "well");
    let json = serde_json::to_value(office.view.goals(now)).expect("plain data");
    assert_eq!(json[0]["stage"], "running");
    for value in [
        serde_json::to_value(office.view.goal(&conversation("g1"), now)),
        serde_json::to_value(office.view.agents(now)),
        serde_json::to_value(office.view.agent(&agent("robot-1"), now)),
        serde_json::to_value(office.view.facts(now)),
        serde_json::to_value(office.view.floor(now)),
        serde_json::to_value(office.view.conversations()),
        serde_json::to_value(office.view.conversation(&conversation("g1"))),
        serde_json::to_value(office.view.topology(now)),
        serde_json::to_value(office.view.activity().collect::<Vec<_>>()),
    ] {
        assert!(!value.expect("plain data").is_null());
    }
}

#[test]
fn a_refused_request_is_no_verdict_and_a_stop_comes_before_failed_goals() {
    let mut office = office();
    let mistyped =
        json!({ "act": "achieve", "goal": "(known-temperature nowhere)", "keep": "achieve" });
    office.hear("alice>plan-requester request goal g1 x1", mistyped.clone());
    let unknown = json!({ "reason": "bad-content", "detail": "there is no object `nowhere`" });
    office.hear("plan-requester>alice refuse goal g1 x1", unknown);
    let overview = office.view.overview(office.now);
    assert_eq!(overview.verdict, HealthLevel::Well, "{}", overview.summary);
    assert!(office.sentences().iter().any(|said| said.contains("is refused")));
    office.hear("alice>plan-requester request goal g2 x2", mistyped);
    office.hear("plan-requester>alice confirm goal g2 x2", report("failed", "no way"));
    office.hear(
        "ann>robot-1 request state-change s1 e1",
        json!({ "act": "stop", "id": "9f", "scope": ["robot-1"], "by": "ann", "why": "" }),
    );
    let kinds = |office: &Observer| -> Vec<_> {
        office.view.overview(office.now).concerns.iter().map(|concern| concern.kind).collect()
    };
    assert_eq!(kinds(&office), [ConcernKind::Stopped, ConcernKind::GoalFailed]);
    assert_eq!(office.view.overview(office.now).verdict, HealthLevel::Bad);
    office.after(11 * 60_000);
    assert!(!kinds(&office).contains(&ConcernKind::GoalFailed), "it is long over");
}

#[test]
fn the_agents_of_commands_are_no_part_of_the_ecosystem() {
    let mut office = office();
    let counted = office.view.overview(office.now).counts.agents;
    for (name, process) in [("keyboard-vm-1", "vm--cli-1"), ("reader-vm-2", "vm--cli-2")] {
        office.observe(ViewEvent::Joined(place(name, process, 1)));
        office.beat(name, 1, "");
    }
    let history = json!({ "act": "read-history", "of": "why", "subject": "(x)" });
    office.hear("reader-vm-2>thermo-2 request state-change h1 e1", history);
    office.hear("thermo-2>reader-vm-2 confirm state-change h1 e1", report("done", ""));
    let goal =
        json!({ "act": "achieve", "goal": "(known-temperature office2)", "keep": "achieve" });
    office.hear("keyboard-vm-1>plan-requester request goal g1 x1", goal);
    office.observe(ViewEvent::Left(place("reader-vm-2", "vm--cli-2", 1)));
    let overview = office.view.overview(office.now);
    assert_eq!((overview.counts.agents, overview.counts.agents_gone), (counted, 0));
    assert_eq!(overview.verdict, HealthLevel::Well, "{:?}", overview.concerns);
    let names: Vec<_> =
        office.view.agents(office.now).iter().map(|row| row.agent.to_string()).collect();
    assert_eq!(names, ["alice", "plan-requester", "robot-1", "thermo-2"]);
    let told = office.sentences();
    assert!(!told.iter().any(|said| said.contains("is here") || said.contains("is gone")));
    let conversations = office.view.conversations();
    assert!(conversations.iter().all(|row| row.conversation != conversation("h1")));
    let requester = office.view.goals(office.now)[0].requester.clone();
    assert_eq!(requester, Some(agent("keyboard-vm-1")), "the asker stays named");
}

#[test]
fn what_is_learnt_at_a_connection_is_no_news() {
    let mut office = office();
    let holds = report("holds", "it holds");
    let goal =
        json!({ "act": "achieve", "goal": "(known-temperature office2)", "keep": "maintain" });
    office.hear("alice>plan-requester request goal g1 x1", goal);
    office.hear("plan-requester>alice confirm goal g1 x1", holds.clone());
    office.observe(ViewEvent::Left(place("robot-1", "laptop", 1)));
    office.observe(ViewEvent::Reached(false));
    office.after(60_000).observe(ViewEvent::Reached(true));
    let before = office.sentences().len();
    office.after(1_000).observe(ViewEvent::Joined(place("robot-1", "laptop", 2)));
    office.hear("plan-requester>alice confirm goal g1 x1", holds.clone());
    office.hear("plan-requester>bob confirm goal g0 x0", holds);
    let stop = json!({ "id": "9f", "scope": [], "by": "ann", "why": "smoke" });
    let beat = json!({
        "of": "heartbeat", "digest": "d", "sequence": 9, "facts": "", "period": 1000,
        "stops": [stop],
    });
    office.hear("robot-1>* inform - robot-1 -", beat);
    assert_eq!(office.sentences()[before..], [] as [String; 0]);
    assert_eq!(office.view.overview(office.now).counts.stops, 1);
    office.after(60_000).observe(ViewEvent::Joined(place("robot-2", "laptop", 3)));
    assert_eq!(office.sentences()[before..], ["robot-2 is here"]);
}

#[test]
fn what_happened_while_nobody_read_is_no_news() {
    let mut office = office();
    let since = office.now;
    let before = office.sentences().len();
    office.after(12_000).observe(ViewEvent::Unread { since });
    office.after(1_000).observe(ViewEvent::Joined(place("robot-1", "laptop", 2)));
    let told = "nothing was observed for 12 s, because nobody read the view";
    assert_eq!(office.sentences()[before..], [told]);
    office.after(60_000).observe(ViewEvent::Joined(place("robot-2", "laptop", 3)));
    assert_eq!(office.sentences()[before..], [told, "robot-2 is here"]);
}

#[test]
fn a_stopped_robot_stays_in_the_floor_plan() {
    let mut office = Observer::new();
    let robot = "(:action move :agent ?b - mobile-base :parameters (?from ?to - location)
        :precondition (and (at ?b ?from) (connected ?from ?to))
        :effect (and (not (at ?b ?from)) (at ?b ?to)))";
    let former = format!("(define (agent robot-1) (:domain smart-office) {robot})");
    office.observe(ViewEvent::Domain(Box::new(from_json(json!({
        "epoch": 2, "revision": 2, "domain": "", "digest": "d", "problem": "", "offers": {},
        "former": ["(broken", former],
    })))));
    let fact = |fact: &str, owner: &str| {
        json!({
            "fact": fact, "owners": [owner], "age_ms": 10, "known_for": null,
        })
    };
    office.observe(ViewEvent::State(Box::new(from_json(json!({
        "epoch": 2, "revision": 2, "facts": [
            fact("(connected corridor office1)", "the map"),
            fact("(connected office1 corridor)", "the map"),
            fact("(at robot-1 corridor)", "robot-1"),
        ],
    })))));
    office.announce("robot-1", "", "(at robot-1 corridor)");
    office.hear(
        "ann>robot-1 request state-change s1 e1",
        json!({ "act": "stop", "id": "9f", "scope": [], "by": "ann", "why": "" }),
    );
    let floor = office.view.floor(office.now);
    assert_eq!(floor.rooms.len(), 2, "{}", floor.empty_because);
    let robots: Vec<_> = floor
        .robots
        .iter()
        .map(|robot| (robot.agent.as_str(), robot.room.as_deref(), robot.is_stopped))
        .collect();
    assert_eq!(robots, [("robot-1", Some("corridor"), true)]);
}

#[test]
fn ages_are_those_of_things_and_not_of_the_view() {
    let mut office = Observer::new();
    office.now = Moment(1_700_000_000_000);
    let began = office.now.minus(3_600_000);
    office.observe(ViewEvent::Joined(place("robot-1", "laptop", began.0 * 1_000 + 7)));
    office.observe(ViewEvent::Joined(place("robot-2", "laptop", 12)));
    let since = |name: &str| {
        let detail = office.view.agent(&agent(name), office.now).expect("known");
        detail.row.since
    };
    assert_eq!((since("robot-1"), since("robot-2")), (Some(began), Some(office.now)));
    let asked_at = office.now.minus(60_000);
    let status = json!({
        "conversation": "g1", "goal": "(a)", "keep": "maintain", "priority": 0,
        "phase": "holding", "rounds": 1,
        "history": [{ "at_ms": asked_at.0, "text": "asked for" }],
    });
    office.observe(ViewEvent::Goals(vec![from_json(status)]));
    assert_eq!(office.view.goals(office.now)[0].asked_at, Some(asked_at));
}

#[test]
fn a_fact_is_the_same_since_it_changed_and_not_since_a_heartbeat() {
    let mut office = office();
    let same_for = |office: &Observer, predicate: &str| {
        let facts = office.view.facts(office.now);
        facts.iter().find(|fact| fact.predicate == predicate).expect("a fact").same_for_ms
    };
    assert_eq!(same_for(&office, "at"), None, "it was so before");
    office.after(1_000).beat("robot-1", 3, "(at robot-1 office1)");
    office.after(1_000).beat("robot-1", 4, "(at robot-1 office1)");
    office.after(500);
    assert_eq!(same_for(&office, "at"), Some(1_500));
    assert_eq!(same_for(&office, "located"), None);
}

#[test]
fn a_view_that_begins_during_a_stop_sees_who_is_stopped() {
    let mut office = Observer::new();
    office.observe(ViewEvent::Joined(place("robot-1", "laptop", 1)));
    let elsewhere = json!({ "agent": "robot-2", "daemons": ["roof"] });
    office.observe(ViewEvent::Expected(vec![from_json(elsewhere)]));
    office.observe(ViewEvent::RoundTrip { daemon: from_json(json!("laptop")), micros: 9 });
    let beat = json!({
        "of": "heartbeat", "digest": "d", "sequence": 1, "facts": "", "period": 1000,
        "stops": [{ "id": "9f", "scope": [], "by": "ann", "why": "" }],
    });
    office.hear("robot-1>* inform - robot-1 -", beat);
    assert!(office.view.agents(office.now)[0].is_stopped);
    assert_eq!(office.view.overview(office.now).counts.daemons, 1, "the other is not here");
}
