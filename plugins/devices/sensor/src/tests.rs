//! Checks the table of quantities against the ontology and the building, and tests one sensor of
//! each quantity.

use std::sync::Arc;

use agent::{Host, Resources};
use building::{Building, DeviceFault, Layout};

use super::*;
use crate::quantity::QUANTITIES;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

/// Returns a building with a lab that has one sensor of this quantity. The true value in the lab is
/// `value`.
fn lab(quantity: &str, value: f64) -> Building {
    let mut layout = Layout::new();
    layout.add_room("lab", 20.0).expect("a room");
    match building::Quantity::named(quantity) {
        None => layout.add_fixed_sensor("s", "lab").expect("a sensor"),
        Some(simulated) => layout.add_sensor("s", "lab", simulated).expect("a sensor"),
    };
    let lab = Building::new(layout, 1.0).expect("a building");
    set(&lab, quantity, value);
    lab
}

fn set(lab: &Building, quantity: &str, value: f64) {
    match building::Quantity::named(quantity) {
        None => lab.set_temperature("lab", value),
        Some(simulated) => lab.set("lab", simulated, value),
    }
    .expect("a possible value");
}

fn blueprint(lab: &Building, config: serde_json::Value) -> Blueprint {
    let mut resources = Resources::default();
    resources.insert(lab.handle());
    blueprint_of("simulated", config, resources)
}

/// Returns the blueprint of a sensor without a simulated building.
pub(crate) fn blueprint_with(driver: &str, config: serde_json::Value) -> Blueprint {
    blueprint_of(driver, config, Resources::default())
}

fn blueprint_of(driver: &str, config: serde_json::Value, resources: Resources) -> Blueprint {
    let map = "(define (problem map) (:domain smart-office) (:init) (:goal (and)))";
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let host = Host::new(ontology, pddl::parse_problem(map).value.expect("a map"));
    let host = Host { resources, ..host };
    let id = acl::AgentId::new("s").expect("a name");
    Blueprint { id, driver: driver.to_owned(), config: config.into(), host: Arc::new(host) }
}

/// Returns the sensor of this quantity in the building `lab`.
fn sensor_in(lab: &Building, quantity: &str) -> Sensor {
    let config = serde_json::json!({ "quantity": quantity, "location": "lab", "valid-for": "10m" });
    sensor(&blueprint(lab, config)).expect("a sensor")
}

fn call(quantity: &str) -> MethodCall {
    let (action, method) = (format!("(report-{quantity} s lab)"), format!("read_{quantity}"));
    MethodCall { action, method, arguments: BTreeMap::new() }
}

pub(crate) async fn measure(
    sensor: &mut Sensor,
    quantity: &str,
) -> Result<MethodResult, MethodFailure> {
    let call = call(quantity);
    match sensor.perform(&call).await {
        Ok(measured) => Ok(sensor.on_success(&call, measured)),
        Err(failure) => {
            sensor.on_failure(&call, &failure);
            Err(failure)
        }
    }
}

/// Facts of a motion detector without motion, and of one with an unknown value.
pub(crate) const STILL: &str = "(located s lab) (known-motion lab) (not (motion lab))";
pub(crate) const BLIND: &str = "(located s lab) (not (known-motion lab)) (unknown (motion lab))";

pub(crate) fn facts(sensor: &Sensor) -> String {
    let facts: Vec<_> = sensor.facts().iter().map(|fact| fact.fact.to_string()).collect();
    facts.join(" ")
}

/// Waits for the next event of the sensor, and handles it.
async fn stir(sensor: &mut Sensor) {
    let stir = sensor.next_event().expect("it notices").await;
    assert!(stir(sensor).is_empty());
}

#[test]
fn every_name_of_the_table_is_in_the_ontology_and_every_quantity_in_the_building() {
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let predicate = |name: &str| ontology.predicates.iter().any(|known| known.name == name);
    let function = |name: &str| ontology.functions.iter().any(|known| known.name == name);
    for quantity in QUANTITIES {
        let value_is_there = match quantity.value {
            quantity::ValueForm::Number { function: name, .. } => function(name),
            quantity::ValueForm::YesOrNo { predicate: name, .. } => predicate(name),
        };
        assert!(value_is_there && predicate(&quantity.known()), "{quantity:?}");
        let sensor_type = quantity.sensor_type();
        assert!(ontology.types.iter().any(|known| known.name == sensor_type.as_str()));
        let simulated = building::Quantity::named(quantity.name).is_some();
        assert_eq!(simulated, quantity.name != "temperature", "{quantity:?}");
    }
    assert_eq!(QUANTITIES.len(), 1 + building::Quantity::all().count());
}

#[tokio::test(start_paused = true)]
async fn each_quantity_is_reported_with_its_true_value() {
    for (quantity, value, detail, known) in [
        ("temperature", 21.55, "21.6 °C at lab", "(= (temperature lab) 21.55)"),
        ("humidity", 38.0, "38 % humidity at lab", "(= (humidity lab) 38)"),
        ("co2", 812.4, "812 ppm of CO2 at lab", "(= (co2 lab) 812.4)"),
        ("light", 90.0, "90 lx at lab", "(= (light lab) 90)"),
        ("distance", 0.255, "0.26 m of free distance at lab", "(= (free-distance lab) 0.255)"),
        ("motion", 1.0, "motion at lab", "(motion lab)"),
        ("motion", 0.0, "no motion at lab", "(not (motion lab))"),
        ("reflection", 1.0, "something close by at lab", "(reflection lab)"),
        ("reflection", 0.0, "nothing close by at lab", "(not (reflection lab))"),
        ("contact", 1.0, "closed at lab", "(shut s)"),
        ("contact", 0.0, "open at lab", "(not (shut s))"),
    ] {
        let lab = lab(quantity, value);
        let mut sensor = sensor_in(&lab, quantity);
        let unknown = match known.trim_start_matches("(not ").trim_end_matches("))") {
            number if number.starts_with("(=") => String::new(),
            fact => format!(" (unknown {})", format!("{fact})").replace("))", ")")),
        };
        let place = match quantity {
            "contact" => "(located s lab) (contact-at s lab)",
            _ => "(located s lab)",
        };
        let unknown = format!("{place} (not (known-{quantity} lab)){unknown}");
        assert_eq!(facts(&sensor), unknown);
        let performed = measure(&mut sensor, quantity).await.expect("measured");
        assert_eq!(performed.detail, detail);
        let known = format!("(known-{quantity} lab) {known}");
        let observed: Vec<_> = performed.observations.iter().map(ToString::to_string).collect();
        assert_eq!(observed.join(" "), known.trim_end());
        assert_eq!(facts(&sensor), format!("{place} {}", known.trim_end()));
        tokio::time::advance(Duration::from_secs(600)).await;
        assert_eq!(facts(&sensor), unknown, "ten minutes later it is not known");
    }
}

#[test]
fn the_model_of_a_sensor_has_its_type_and_its_action() {
    let lab = lab("co2", 400.0);
    let Description { model, methods } = sensor_in(&lab, "co2").describe();
    let expected = model_of(
        "(define (agent s) (:domain smart-office)
            (:objects s - co2-sensor)
            (:init (located s lab))
            (:action report-co2 :agent ?s - co2-sensor :parameters (?r - room)
                :precondition (located ?s ?r)
                :effect (and (known-co2 ?r) (increase (total-cost) 1))
                :observe (co2 ?r)))",
    );
    assert_eq!(model.to_string(), expected.to_string());
    assert_eq!(methods["report-co2"].method, "read_co2");
}

#[tokio::test(start_paused = true)]
async fn a_thermometer_measures_humidity_only_if_configured() {
    let lab = lab("temperature", 19.5);
    lab.set("lab", building::Quantity::Humidity, 61.0).expect("a possible value");
    for (humidity, actions) in [(false, 1), (true, 2)] {
        let config = serde_json::json!({ "location": "lab", "humidity": humidity });
        let mut sensor = temperature_sensor(&blueprint(&lab, config)).expect("a sensor");
        let Description { model, methods } = sensor.describe();
        assert_eq!((model.actions.len(), methods.len()), (actions, actions));
        assert!(measure(&mut sensor, "temperature").await.is_ok());
        let detail = measure(&mut sensor, "humidity").await.map(|performed| performed.detail);
        let unknown = MethodFailure::UnknownMethod("read_humidity".to_owned());
        let expected = if humidity { Ok("61 % humidity at lab".to_owned()) } else { Err(unknown) };
        assert_eq!(detail, expected);
    }
}

#[tokio::test(start_paused = true)]
async fn a_failed_sensor_offers_no_actions_for_a_while() {
    for quantity in QUANTITIES {
        let lab = lab(quantity.name, 1.0);
        let mut sensor = sensor_in(&lab, quantity.name);
        assert!(measure(&mut sensor, quantity.name).await.is_ok());
        lab.break_device("s", DeviceFault::Fails).expect("a device");
        assert!(measure(&mut sensor, quantity.name).await.is_err());
        assert!(sensor.describe().model.actions.is_empty(), "{quantity:?}");
        let knows = facts(&sensor).contains("lab) (known-");
        assert_eq!(knows, !quantity.is_noticed(), "what is blind knows nothing: {quantity:?}");
        lab.repair("s").expect("a device");
        tokio::time::advance(REST_AFTER_FAILURE).await;
        assert_eq!(sensor.describe().model.actions.len(), 1, "{quantity:?}");
        assert!(measure(&mut sensor, quantity.name).await.is_ok());
    }
}

#[tokio::test(start_paused = true)]
async fn motion_is_reported_and_a_broken_detector_is_unknown() {
    let lab = lab("motion", 0.0);
    let mut sensor = sensor_in(&lab, "motion");
    set(&lab, "motion", 1.0);
    stir(&mut sensor).await;
    assert_eq!(facts(&sensor), "(located s lab) (known-motion lab) (motion lab)");
    set(&lab, "motion", 0.0);
    stir(&mut sensor).await;
    assert_eq!(facts(&sensor), STILL);

    lab.break_device("s", DeviceFault::Fails).expect("a device");
    let broken = Instant::now();
    stir(&mut sensor).await;
    assert_eq!(facts(&sensor), BLIND);
    assert!(sensor.describe().model.actions.is_empty());
    lab.repair("s").expect("a device");
    set(&lab, "motion", 1.0);
    stir(&mut sensor).await;
    assert_eq!(broken.elapsed(), REST_AFTER_FAILURE);
    assert_eq!(facts(&sensor), "(located s lab) (known-motion lab) (motion lab)");
    assert!(sensor_in(&lab, "motion").next_event().is_some());
    assert!(sensor_in(&lab, "co2").next_event().is_none(), "numbers are reported when asked for");
}

#[test]
fn an_unknown_quantity_is_reported() {
    let lab = lab("co2", 400.0);
    for (config, expected) in [
        (
            serde_json::json!({ "quantity": "c02", "location": "lab" }),
            "build `s`: unknown quantity `c02`; did you mean `co2`?",
        ),
        (
            serde_json::json!({ "quantity": "co2", "location": "lab", "valid-for": "soon" }),
            "build `s`: valid-for `soon`: expected number at 0",
        ),
    ] {
        let problem = sensor(&blueprint(&lab, config)).err().map(|problem| problem.to_string());
        assert_eq!(problem.as_deref(), Some(expected));
    }
}

#[test]
fn impossible_numbers_of_any_driver_are_refused() {
    for (quantity, value, is_believed) in [
        ("temperature", 0.0, true),
        ("temperature", f64::NAN, false),
        ("temperature", f64::INFINITY, false),
        ("temperature", 999.0, false),
        ("temperature", -127.0, false),
        ("temperature", -40.0, true),
        ("humidity", 655.35, false),
        ("humidity", 100.0, true),
        ("co2", -1.0, false),
        ("light", 2e6, false),
        ("distance", -0.1, false),
        ("motion", 1.0, true),
        ("motion", -1.0, false),
        ("contact", f64::NAN, false),
    ] {
        let measured = Measurement { value, at: Instant::now() };
        let quantity = SensorQuantity::named(quantity).expect("a quantity");
        assert_eq!(believable(quantity, Ok(measured)).is_ok(), is_believed, "{quantity:?} {value}");
    }
}
