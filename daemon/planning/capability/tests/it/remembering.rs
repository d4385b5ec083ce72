//! Tests that actions of agents that have left are kept for explanations.

use expect_test::expect;

use crate::office::{Office, model, office, office_of, thermometer, turtlebot};

fn former(office: &Office) -> Vec<String> {
    let line = |model: &std::sync::Arc<pddl::ActionModel>| {
        let action = &model.actions[0];
        let types: Vec<&str> = model.types.iter().map(|typed| typed.name.as_str()).collect();
        format!("{} of a {} {types:?}", action.name, action.agent.as_ref().expect("acts").ty)
    };
    office.snapshot().former.iter().map(line).collect()
}

#[test]
fn actions_of_the_last_agent_are_remembered_until_offered_again() {
    let mut office = office().with([turtlebot("t"), thermometer("one"), thermometer("two")]);
    assert!(former(&office).is_empty());
    office.remove("one");
    assert!(former(&office).is_empty(), "the other thermometer offers it");
    office.remove("two");
    office.remove("t");
    expect![[r#"
        [
            "move of a turtlebot [\"turtlebot\"]",
            "report-temperature of a temperature-sensor []",
        ]
    "#]]
    .assert_debug_eq(&former(&office));
    let content = office.snapshot().to_content();
    assert!(content.offers.is_empty() && content.guards.is_empty());
    for text in &content.former {
        let model = pddl::parse_action_model(text).into_result().expect("it is read again");
        assert!(model.init.is_empty() && model.objects.is_empty());
    }
    office.admit_life(&turtlebot("t"), 2).expect("it is back");
    expect![[r#"
        [
            "report-temperature of a temperature-sensor []",
        ]
    "#]]
    .assert_debug_eq(&former(&office));
}

#[test]
fn an_action_removed_from_a_model_is_remembered() {
    let mut office = office().with([thermometer("one")]);
    office.admit(&model("one", "(:objects one - temperature-sensor)"));
    expect![[r#"
        [
            "report-temperature of a temperature-sensor []",
        ]
    "#]]
    .assert_debug_eq(&former(&office));
}

#[test]
fn guards_of_masked_agents_are_published() {
    let mut office = office().with([turtlebot("t")]);
    office.mask("t");
    let content = office.snapshot().to_content();
    assert!(content.offers.is_empty());
    let guard = content.guards.get("move").expect("the schema is there");
    assert_eq!((guard.action.as_str(), guard.predicate.as_str()), ("move", "offers-move"));
}

#[test]
fn an_actuators_maintainer_remembers_no_other_agents() {
    let mut office = office_of("one").with([turtlebot("t"), thermometer("one")]);
    office.remove("t");
    assert!(former(&office).is_empty());
}

#[test]
fn memory_is_bounded_and_drops_the_oldest() {
    let mut office = office();
    for number in 0..capability::limits::REMEMBERED_MAX + 3 {
        let action = format!(
            "(:objects x - sensor) (:action act-{number} :agent ?s - sensor :parameters ()
                :effect (and))"
        );
        office.admit(&model("x", &action));
    }
    office.remove("x");
    let former = former(&office);
    assert_eq!(former.len(), capability::limits::REMEMBERED_MAX);
    assert!(!former.contains(&"act-0 of a sensor []".to_owned()));
}
