//! Tests that a maintainer that composes on request gives the same result as one that composes at
//! each input.

use proptest::prelude::*;

use crate::office::{Office, announcement, model, office, office_of, thermometer, turtlebot};

/// Sections of models that contradict each other. No part is private, so that both kinds of
/// maintainer show the same result.
const WORDS: [&str; 9] = [
    "",
    "(:types drone - mobile-base) (:predicates (aloft ?d - drone))",
    "(:types drone - sensor) (:predicates (aloft ?d - drone) (ready))",
    "(:predicates (aloft)) (:functions (height))",
    "(:functions (height ?s - sensor)) (:objects pole - location)",
    "(:objects pole - sensor) (:predicates (ready ?s - sensor)) (:init (ready pole))",
    "(:objects pole - sensor) (:predicates (ready)) (:init (ready))",
    "(:types drone - bird) (:objects pole - drone)",
    "(:objects pole - location)",
];

/// An event: one of four agents announces one of these models or leaves, or a snapshot is
/// requested.
#[derive(Clone, Debug)]
enum Event {
    Says(usize, usize),
    Goes(usize),
    Looks,
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        6 => (0_usize..4, 0..WORDS.len()).prop_map(|(agent, words)| Event::Says(agent, words)),
        2 => (0_usize..4).prop_map(Event::Goes),
        1 => Just(Event::Looks),
    ]
}

fn tell(office: &mut Office, event: &Event) {
    let name = |agent: &usize| format!("agent-{agent}");
    match event {
        Event::Says(agent, words) => {
            office.admit(&model(&name(agent), WORDS[*words]));
        }
        Event::Goes(agent) => {
            office.remove(&name(agent));
        }
        Event::Looks => {
            office.snapshot();
        }
    }
}

/// Configuration without seed files: a failure prints its case, which should become a test of its
/// own.
fn config() -> ProptestConfig {
    ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn late_composition_gives_the_same_result(events in prop::collection::vec(event(), 1..24)) {
        let (mut at_once, mut late) = (office(), office_of("nobody"));
        for event in &events {
            tell(&mut at_once, event);
            tell(&mut late, event);
        }
        let (one, two) = (at_once.snapshot(), late.snapshot());
        prop_assert_eq!(one.domain.to_string(), two.domain.to_string());
        prop_assert_eq!(one.problem, two.problem);
        prop_assert_eq!(at_once.conflicts(), late.conflicts());
    }

    #[test]
    fn composing_models_together_gives_the_same_result(
        events in prop::collection::vec(event(), 1..24)
    ) {
        let (mut at_once, mut together) = (office(), office());
        let mut told = Vec::new();
        for event in &events {
            tell(&mut at_once, event);
            match event {
                Event::Says(agent, words) => {
                    let model = model(&format!("agent-{agent}"), WORDS[*words]);
                    let taken = together.maintainer.add_model(announcement(&model, 1), together.now);
                    prop_assert!(taken.is_ok());
                }
                Event::Goes(_) => tell(&mut together, event),
                Event::Looks => {
                    let composed = together.maintainer.compose_added(together.now);
                    told.extend(composed.conflicts);
                }
            }
        }
        told.extend(together.maintainer.compose_added(together.now).conflicts);
        let (one, two) = (at_once.snapshot(), together.snapshot());
        prop_assert_eq!(one.domain.to_string(), two.domain.to_string());
        prop_assert_eq!(one.problem, two.problem);
        let conflicts = together.maintainer.conflicts();
        prop_assert_eq!(&at_once.maintainer.conflicts(), &conflicts);
        let untold: Vec<_> = conflicts.iter().filter(|one| !told.contains(one)).collect();
        let goes = events.iter().any(|event| matches!(event, Event::Goes(_)));
        prop_assert!(goes || untold.is_empty(), "{untold:?}");
    }
}

/// Returns several models of an agent `name`: some of the same agent type and some of other types.
fn kinds(name: &str) -> Vec<String> {
    let flies = |parameter: &str| {
        format!(
            "(:objects {name} - mobile-base) (:init (located {name} office1))
             (:action fly :agent {parameter} - mobile-base :parameters (?to - location)
                 :effect (located {parameter} ?to))"
        )
    };
    let lands = format!("{} (:action land :agent ?a - mobile-base :effect (and))", flies("?a"));
    vec![
        model(name, &flies("?a")),
        model(name, &flies("?me")),
        model(name, &lands),
        model(name, &flies("?a").replace("?to)))", "office1)))")),
        thermometer(name),
        turtlebot(name),
        model(name, &format!("(:objects {name} - mobile-base pole - location)")),
        model(name, "(:objects agent-1 - location)"),
        model(name, "(:predicates (aloft ?d - mobile-base))"),
        model(name, "(:init (located agent-2 office1))"),
        model(name, &format!("(:objects {name} - bird)")),
        model(name, ""),
    ]
}

fn kind() -> impl Strategy<Value = (usize, Option<usize>)> {
    (0_usize..6, prop_oneof![4 => (0_usize..12).prop_map(Some), 1 => Just(None)])
}

proptest! {
    #![proptest_config(config())]

    /// Compares a maintainer with one that never adds agents incrementally, because each agent
    /// joins with an empty model and then changes it.
    #[test]
    fn adding_an_agent_incrementally_gives_the_same_result(
        events in prop::collection::vec(kind(), 1..16),
    ) {
        let (mut added, mut anew) = (office(), office());
        let mut here = std::collections::BTreeSet::new();
        for (agent, kind) in events {
            let name = format!("agent-{agent}");
            let Some(kind) = kind else {
                here.remove(&name);
                added.remove(&name);
                anew.remove(&name);
                continue;
            };
            if here.insert(name.clone()) {
                anew.admit(&model(&name, ""));
            }
            let said = kinds(&name).swap_remove(kind);
            let one = added.admit(&said);
            let two = anew.admit(&said);
            let (believed, retracted) = (one.change.believed, one.change.retracted);
            prop_assert_eq!((believed, retracted), (two.change.believed, two.change.retracted));
            let (one, two) = (added.snapshot(), anew.snapshot());
            prop_assert_eq!(one.domain.to_string(), two.domain.to_string());
            prop_assert_eq!(one.problem.to_string(), two.problem.to_string());
            prop_assert_eq!(one.problem, two.problem);
            prop_assert_eq!(one.qualified, two.qualified);
            prop_assert_eq!(added.maintainer.conflicts(), anew.maintainer.conflicts());
        }
    }
}

proptest! {
    #![proptest_config(config())]

    /// Several agents join at once, and some of them cannot be added incrementally. The agents that
    /// were added before are then composed together with the rest.
    #[test]
    fn adding_agents_together_gives_the_same_result(
        first in prop::collection::vec(0_usize..12, 1..4),
        then in prop::collection::vec(0_usize..12, 1..5),
    ) {
        let (mut added, mut anew) = (office(), office());
        let name = |agent: usize| format!("agent-{agent}");
        for (agent, kind) in first.iter().enumerate() {
            let said = kinds(&name(agent)).swap_remove(*kind);
            added.admit(&said);
            anew.admit(&said);
        }
        for (agent, kind) in (first.len()..).zip(&then) {
            let said = kinds(&name(agent)).swap_remove(*kind);
            let taken = added.maintainer.add_model(announcement(&said, 1), added.now);
            prop_assert!(taken.is_ok());
            anew.admit(&model(&name(agent), ""));
            anew.admit(&said);
        }
        added.maintainer.compose_added(added.now);
        let (one, two) = (added.snapshot(), anew.snapshot());
        prop_assert_eq!(one.domain.to_string(), two.domain.to_string());
        prop_assert_eq!(one.problem, two.problem);
        prop_assert_eq!(one.qualified, two.qualified);
        prop_assert_eq!(added.maintainer.conflicts(), anew.maintainer.conflicts());
    }
}

#[test]
fn an_added_model_changes_nothing_until_it_is_composed() {
    let mut office = office();
    let (one, two) = (thermometer("t-1"), thermometer("t-2"));
    office.maintainer.add_model(announcement(&one, 1), office.now).expect("a good model");
    office.maintainer.add_model(announcement(&two, 1), office.now).expect("a good model");
    assert!(office.maintainer.is_stale());
    let change = office.beat("t-1", (1, 1), "(located t-1 office2)", "").expect("a heartbeat");
    assert!(change.is_empty() && change.joined.is_empty(), "{change:?}");
    let change = office.maintainer.compose_added(office.now).change;
    assert_eq!((change.epoch, change.revision, change.joined.len()), (1, 1, 2), "{change:?}");
    assert_eq!(change.believed.len(), 2, "{change:?}");
    assert!(!office.maintainer.is_stale());
}

#[test]
fn precedence_is_tracked_without_composition() {
    let mut office = office_of("nobody");
    for event in [
        Event::Says(0, 8),
        Event::Says(1, 5),
        Event::Says(2, 8),
        // Of the two remaining agents, the other one has been present longer.
        Event::Goes(0),
    ] {
        tell(&mut office, &event);
    }
    let shown = office.snapshot().problem.to_string();
    assert!(shown.contains("pole - location"), "{shown}");
}
