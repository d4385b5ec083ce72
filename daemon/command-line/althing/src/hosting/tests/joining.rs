//! Tests in which an agent that offers a cheaper plan joins while a plan runs. If its plan is much
//! cheaper, it is adopted, and the old commitments are cancelled; if it is only slightly cheaper,
//! the running plan continues.

use std::time::Duration;

use ::building::BuildingEvent;

use super::strangers::{Conduct, Script, Stranger};
use super::{MODES, Office, Person, entry};
use acl::content::Keep;

/// Returns the entries of a robot in the conference room that carries a thermometer.
fn robot() -> [String; 2] {
    [
        entry("turtlebot-1", "turtlebot", "{ start = \"conf-room\" }"),
        entry("ir-1", "ir-temperature-sensor", "{ mounted-on = \"turtlebot-1\" }"),
    ]
}

/// Returns the script of a thermometer in office2 that reports the temperature at the cost `cost`.
fn thermometer(cost: f64) -> Script {
    let plan = "(report-temperature guest office2)\n".to_owned();
    Script {
        model: format!(
            "(:objects guest - temperature-sensor) (:init (located guest office2))
             (:action report-temperature :agent ?s - temperature-sensor :parameters (?r - room)
                 :precondition (located ?s ?r)
                 :effect (and (known-temperature ?r) (increase (total-cost) {cost})))"
        ),
        facts: "(located guest office2)".to_owned(),
        conduct: Conduct::Confirms(Duration::ZERO),
        offers: vec![("(known-temperature office2)".to_owned(), plan, cost)],
        asked: Vec::new(),
    }
}

/// Requests the temperature of office2, and waits until the robot is on its way there. Returns the
/// cost of the plan.
async fn set_out(office: &Office, person: &mut Person) -> f64 {
    person.wish("(known-temperature office2)", Keep::Achieve).await;
    let plan = person.hears_of("a plan of").await;
    let (_, cost) = plan.rsplit_once(' ').expect("its cost");
    // It has departed, and not arrived anywhere yet.
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(!office.building.truth().any(|event| matches!(event, BuildingEvent::Moved { .. })));
    cost.parse().expect("a number")
}

#[tokio::test(start_paused = true)]
async fn a_much_cheaper_plan_is_adopted_and_the_robot_is_free() {
    for mode in MODES {
        let office = Office::open(&robot(), mode).await;
        let mut person = office.person("user");
        set_out(&office, &mut person).await;
        let guest = Stranger::enter(&office, "guest", thermometer(1.0)).await;
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        let told = person.lines.join("\n");
        let why = "planning anew: with `guest` there is a much cheaper plan";
        assert!(told.contains(why), "{mode:?}: {told}");
        assert_eq!(guest.asked(), ["report-temperature"], "{mode:?}");
        // The robot was called back: it has measured nothing, and takes the next goal.
        assert!(person.reaches("(at turtlebot-1 office1)").await, "{mode:?}: {:#?}", person.lines);
        let truth = office.building.truth();
        let in_vain = |event: &BuildingEvent| matches!(event, BuildingEvent::Moved { to, .. } if to == "office2");
        assert!(!truth.any(in_vain), "{mode:?}: {truth:#?}");
        assert_eq!(office.building.place_of("turtlebot-1").as_deref(), Ok("office1"), "{mode:?}");
        office.close().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_slightly_cheaper_plan_is_not_adopted() {
    for mode in MODES {
        let office = Office::open(&robot(), mode).await;
        let mut person = office.person("user");
        let cost = set_out(&office, &mut person).await;
        let guest = Stranger::enter(&office, "guest", thermometer(cost * 0.9)).await;
        assert!(person.hears().await, "{mode:?}: {:#?}", person.lines);
        let told = person.lines.join("\n");
        assert!(!told.contains("planning anew"), "{mode:?}: {told}");
        assert_eq!(guest.asked(), [""; 0], "{mode:?}");
        assert_eq!(office.building.place_of("turtlebot-1").as_deref(), Ok("office2"), "{mode:?}");
        office.close().await;
    }
}
