//! A recording of a real office, of which every page is checked: a person asks for all
//! temperatures, and then lets the robot move. The recording begins after the agents have announced
//! their actions.

use acl::content::Outcome;
use acl::{EcosystemId, Message};
use live_view::{GoalStage, HealthLevel, LiveView, Moment, StepState, ViewEvent, ViewLimits};
use serde_json::Value;

const RECORDING: &str = include_str!("office.jsonl");

/// Returns the messages of the recording with their times, in milliseconds since its begin.
fn messages() -> impl Iterator<Item = (u64, Message)> {
    RECORDING.lines().skip(1).map(|line| {
        let mut line: Value = serde_json::from_str(line).expect("a line of a recording");
        let at_ms = line["at_ms"].as_u64().expect("a time");
        let message = serde_json::from_value(line["message"].take()).expect("a message");
        (at_ms, message)
    })
}

/// Returns the view after the first `at_ms` milliseconds of the recording.
fn watched(at_ms: u64) -> (LiveView, Moment) {
    let ecosystem = EcosystemId::new("smart-office").expect("a name");
    let mut view = LiveView::new(ecosystem, ViewLimits::default());
    for (at, message) in messages().take_while(|(at, _)| *at <= at_ms) {
        view.observe(Moment(at), ViewEvent::Message(Box::new(message)));
    }
    (view, Moment(at_ms))
}

#[test]
fn the_recorded_goal_is_reached() {
    // Before the robot arrives.
    let (view, now) = watched(14_000);
    let goals = view.goals(now);
    let [goal] = goals.as_slice() else { panic!("{goals:#?}") };
    assert_eq!(goal.goal, "(forall (?r - room) (known-temperature ?r))");
    assert_eq!(
        (goal.stage, goal.text.as_str()),
        (GoalStage::Running, "executing: 2 of 4 steps done")
    );
    assert_eq!(goal.now, ["turtlebot-1 moves to office1"]);
    let detail = view.goal(&goal.conversation, now).expect("it is listed");
    assert_eq!(detail.calls[0].bids.len(), 6);
    let states: Vec<_> = detail.plans[0].steps.iter().map(|step| step.state).collect();
    assert_eq!(states, [StepState::Done, StepState::Done, StepState::Running, StepState::Next]);

    let (view, now) = watched(60_000);
    let goals = view.goals(now);
    let [action, goal] = goals.as_slice() else { panic!("{goals:#?}") };
    assert_eq!(action.goal, "(move turtlebot-1 office1 corridor)");
    assert_eq!(
        (action.stage, goal.stage, goal.cost),
        (GoalStage::Done, GoalStage::Done, Some(8.0))
    );
    let detail = view.goal(&goal.conversation, now).expect("it is listed");
    let [plan] = detail.plans.as_slice() else { panic!("{detail:#?}") };
    assert_eq!((plan.outcome, plan.steps.len()), (Some(Outcome::Done), 4));
    assert!(plan.steps.iter().all(|step| step.state == StepState::Done));
    assert_eq!(plan.steps[2].started_at, Some(Moment(1_135)));
    assert_eq!(plan.steps[2].ended_at, Some(Moment(14_496)));
}

#[test]
fn the_recorded_robot_drives_through_the_office() {
    let (view, now) = watched(14_000);
    let floor = view.floor(now);
    let rooms: Vec<_> = floor.rooms.iter().map(|room| room.name.as_str()).collect();
    assert_eq!(rooms, ["conf-room", "corridor", "office1", "office2"]);
    assert_eq!(floor.ways.len(), 3);
    let [robot] = floor.robots.as_slice() else { panic!("{floor:#?}") };
    assert_eq!(
        (robot.room.as_deref(), robot.moves_to.as_deref()),
        (Some("corridor"), Some("office1"))
    );
    assert_eq!(floor.rooms[3].facts, ["temperature 21.5", "known-temperature"]);
    let facts = view.facts(now);
    let is_auxiliary = |predicate: &str| {
        ["offers-", "defined-", "found-"].iter().any(|prefix| predicate.starts_with(prefix))
    };
    assert!(facts.len() > 20 && !facts.iter().any(|fact| is_auxiliary(&fact.predicate)));
}

#[test]
fn the_recorded_messages_follow_their_protocols() {
    let (view, now) = watched(60_000);
    let overview = view.overview(now);
    assert_eq!((overview.counts.out_of_turn, overview.counts.messages), (0, 70));
    // The recording ends, so that the agents are silent; nothing else is wrong.
    assert_eq!(overview.verdict, HealthLevel::Attention);
    let sentences: Vec<_> = view.activity().map(|entry| entry.text.as_str()).collect();
    for expected in [
        "turtlebot-1 moves to office1",
        "turtlebot-1: arrived at office1",
        "thermometer-office2 is chosen for (known-temperature office2)",
        "(forall (?r - room) (known-temperature ?r)) is reached",
    ] {
        assert!(sentences.contains(&expected), "{expected}: {sentences:#?}");
    }
}
