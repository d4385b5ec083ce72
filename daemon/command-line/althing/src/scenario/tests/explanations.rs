//! Tests of the explanations that users get if there is no plan, in a whole ecosystem.

use std::time::Duration;

use acl::content::{Achieve, Keep, Request};
use acl::{AgentId, Protocol};
use agent::Mode;

use super::MODES;
use super::asking::{ask, office};
use crate::scenario::launched::LaunchedScenario;

const REASONING: &[&str] =
    &["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];

/// Requests a goal from a new keyboard. Returns the text of the final report.
async fn wish(set: &LaunchedScenario, who: &str, goal: &str) -> String {
    let achieve = Achieve::new(goal, Keep::Achieve, 0);
    let request = Request::Achieve(achieve);
    let told = ask(set, who, "plan-requester", Protocol::Goal, request).await;
    told.last().cloned().expect("a last word")
}

fn unplug(set: &LaunchedScenario, which: impl Fn(&str) -> bool) {
    let agents: Vec<AgentId> = set.node.agents().cloned().collect();
    for agent in agents.iter().filter(|agent| which(agent.as_str())) {
        set.node.abort_agent(agent);
    }
}

#[tokio::test(start_paused = true)]
async fn an_explanation_names_silent_agents_and_missing_types() {
    for mode in MODES {
        let (set, sensor) = office(mode).await;
        let goal = "(forall (?r - room) (known-temperature ?r))";
        unplug(&set, |agent| !REASONING.contains(&agent));
        // The agents' actions are masked at once, and removed after a while.
        tokio::time::sleep(Duration::from_millis(200)).await;
        let told = wish(&set, "ann", goal).await;
        let silent = format!("`{sensor}` does not offer `report-temperature` now");
        assert!(told.starts_with("failed: no agent can `report-temperature` at "), "{told}");
        assert!(told.contains(&silent), "{mode:?}: {told}");
        // Objects and schemas are removed with the agents; the actions that they offered are still
        // known.
        tokio::time::sleep(Duration::from_secs(600)).await;
        let told = wish(&set, "bob", goal).await;
        assert!(told.starts_with("failed: no agent can `report-temperature` at "), "{told}");
        assert!(told.contains("a temperature sensor there"), "{mode:?}: {told}");
        assert!(told.contains("an ir temperature sensor"), "{mode:?}: {told}");
        assert!(!told.contains(&sensor), "{mode:?}: {told}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_contradictory_goal_is_distinguished_from_a_missing_capability() {
    let (set, _) = office(Mode::Centralized).await;
    let robot = set.node.agents().find(|agent| agent.as_str().contains("turtlebot"));
    let robot = robot.expect("the paper has one").clone();
    let goal = format!("(and (at {robot} office1) (at {robot} office2))");
    let told = wish(&set, "ann", &goal).await;
    let interfere = "each part can be reached alone; together they interfere";
    assert!(told.contains(interfere), "{told}");
}

#[tokio::test(start_paused = true)]
async fn the_choice_among_several_agents_is_explained() {
    let (set, _) = office(Mode::Decentralized).await;
    let goal = "(known-temperature office2)".to_owned();
    let achieve = Achieve::new(goal, Keep::Achieve, 0);
    let request = Request::Achieve(achieve);
    let told = ask(&set, "ann", "plan-requester", Protocol::Goal, request).await;
    let chosen = told.iter().find(|text| text.starts_with("progress: chosen: ")).expect("a choice");
    assert!(chosen.contains("for `(known-temperature office2)` at cost "), "{chosen}");
    assert!(chosen.contains("`turtlebot-1` bid "), "{chosen}");
    assert!(!chosen.contains("declined"), "agents that cannot take part are not listed: {chosen}");
}
