//! Tests of the maps that are made from places and doors.

use expect_test::expect;
use ontology::{BuildingPlan, PlanDoor, PlanPlace, PlanStatement, STANDARD_NAME, standard_domain};
use pddl::{Name, TypeExpr, Typed};

fn place(name: &str, kind: &str, statements: Vec<PlanStatement>) -> PlanPlace {
    PlanPlace { name: name.into(), kind: kind.into(), statements }
}

fn on_floor(floor: &str) -> PlanStatement {
    let object = Typed { name: floor.into(), ty: TypeExpr::of("floor") };
    PlanStatement::Relates { predicate: "on-floor".into(), object }
}

fn plan() -> BuildingPlan {
    let area = PlanStatement::Measures { function: "area".into(), value: 12.5 };
    let staff_only = PlanStatement::Holds { predicate: "staff-only".into() };
    let door = |from: &str, to: &str, meters, is_one_way| PlanDoor {
        from: from.into(),
        to: to.into(),
        meters,
        is_one_way,
    };
    BuildingPlan {
        places: vec![
            place("lab", "room", vec![on_floor("floor-1"), area]),
            place("hall", "corridor", vec![on_floor("floor-1")]),
            place("vault", "store-room", vec![staff_only]),
        ],
        doors: vec![door("hall", "lab", 4.0, false), door("hall", "vault", 2.5, true)],
    }
}

#[test]
fn a_map_has_each_door_in_both_directions_unless_it_leads_one_way() {
    let map = plan().map("house", &Name::new(STANDARD_NAME));
    expect![[r#"
        (define (problem house-map)
          (:domain smart-office)
          (:objects lab - room hall - corridor vault - store-room floor-1 - floor)
          (:init
            (= (total-cost) 0)
            (on-floor lab floor-1)
            (= (area lab) 12.5)
            (on-floor hall floor-1)
            (staff-only vault)
            (connected hall lab)
            (= (distance hall lab) 4)
            (connected lab hall)
            (= (distance lab hall) 4)
            (connected hall vault)
            (= (distance hall vault) 2.5))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]]
    .assert_eq(&map.to_string());
    assert_eq!(pddl::check_map(standard_domain(), &map), []);
    let again = pddl::parse_problem(&map.to_string());
    assert_eq!(again.diagnostics, []);
    assert_eq!(again.value, Some(map));
}

#[test]
fn a_building_without_doors_has_a_map_too() {
    let plan = BuildingPlan { places: vec![place("tent", "room", Vec::new())], doors: Vec::new() };
    let map = plan.map("camp", &Name::new(STANDARD_NAME));
    assert_eq!(pddl::check_map(standard_domain(), &map), []);
    assert_eq!(map.objects.len(), 1);
    assert!(BuildingPlan::default().map("empty", &Name::new(STANDARD_NAME)).objects.is_empty());
}
