//! Tests that the order in which agents join does not matter if none of them contradict each other.

use proptest::prelude::*;

use crate::office::{Office, ir_sensor, model, office, office_of, thermometer, turtlebot};

fn models() -> Vec<String> {
    let extras = "(:types drone - mobile-base) (:objects drone-1 - drone) (:predicates (aloft))
        (:action fly :agent ?d - drone :effect (aloft))";
    let twin = "(:types drone - mobile-base) (:objects drone-2 - drone) (:predicates (aloft))
        (:action fly :agent ?x - drone :effect (and (aloft)))";
    vec![
        turtlebot("turtlebot-1"),
        turtlebot("turtlebot-2").replace("?from", "?a"),
        turtlebot("turtlebot-3").replace("(at ?r ?to)", "(AT ?r ?to)"),
        thermometer("thermometer-1"),
        ir_sensor("ir-1", "turtlebot-1"),
        model("drone-1", extras),
        model("drone-2", twin),
        model("silent", ""),
    ]
}

fn check(order: &[String], reference: &Office, office: Office) -> Result<(), TestCaseError> {
    let office = office.with(order);
    let (one, two) = (reference.snapshot(), office.snapshot());
    prop_assert_eq!(one.domain.to_string(), two.domain.to_string());
    prop_assert_eq!(one.problem, two.problem);
    prop_assert_eq!(one.qualified, two.qualified);
    prop_assert_eq!(office.conflicts(), "");
    Ok(())
}

/// Configuration without seed files: a failure prints its case, which should become a test of its
/// own.
fn config() -> ProptestConfig {
    ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn any_order_composes_the_same(order in Just(models()).prop_shuffle()) {
        check(&order, &office().with(models()), office())?;
    }

    #[test]
    fn any_order_composes_the_same_for_one_actuator(order in Just(models()).prop_shuffle()) {
        let own = || office_of("turtlebot-2");
        check(&order, &own().with(models()), own())?;
    }

    /// After some agents have left, the composition of the rest is the same as if they had always
    /// been alone, except for qualified names.
    #[test]
    fn an_agent_that_left_leaves_no_trace(
        order in Just(models()).prop_shuffle(),
        stay in 0_usize..8,
    ) {
        let mut office = office().with(&order);
        for gone in order.iter().skip(stay) {
            let name = gone.split(')').next().and_then(|head| head.split(' ').nth(2));
            office.remove(name.expect("a model has a name"));
        }
        let alone = crate::office::office().with(&order[..stay]);
        let plain = |office: &Office| {
            let text = office.snapshot().domain.to_string();
            text.replace("--thermometer-1", "").replace("--ir-1", "")
        };
        prop_assert_eq!(plain(&office), plain(&alone));
        prop_assert_eq!(office.snapshot().problem.objects, alone.snapshot().problem.objects);
    }
}
