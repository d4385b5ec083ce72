//! Tests that sensors measure the true values, in this process and over the socket.

use std::time::Duration;

use tokio::time::{Instant, timeout};

use crate::fixture::log_lines;
use crate::{Building, BuildingHandle, DeviceFault, Layout, Quantity, serve};

/// Returns a building with a thermometer, and one sensor per quantity with the same name as the
/// quantity.
fn house() -> Building {
    let mut layout = Layout::new();
    layout.add_room("lab", 20.0).unwrap().add_room("den", 20.0).unwrap();
    layout.add_fixed_sensor("thermometer", "lab").unwrap();
    for quantity in Quantity::all() {
        layout.add_sensor(quantity.name(), "lab", quantity).unwrap();
    }
    Building::new(layout, 1.0).unwrap()
}

#[tokio::test(start_paused = true)]
async fn each_quantity_is_measured_with_its_true_value() {
    for quantity in Quantity::all() {
        let (house, name) = (house(), quantity.name());
        let (min, max) = quantity.bounds();
        for value in [quantity.usual(), min, max] {
            house.set("lab", quantity, value).unwrap();
            house.set("den", quantity, quantity.usual()).unwrap();
            let measured = house.measure(name, quantity).await.unwrap();
            assert_eq!((measured.location.as_str(), measured.value), ("lab", value), "{name}");
            assert_eq!(house.truth().value("lab", quantity), Some(value), "{name}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn impossible_values_and_devices_are_refused() {
    let house = house();
    let check = |outcome: Result<(), crate::LayoutError>, expected: &str| {
        assert_eq!(outcome.unwrap_err().to_string(), expected);
    };
    check(
        house.set("lab", Quantity::Humidity, 101.0),
        "set the humidity of `lab` to 101: between 0 and 100 is possible",
    );
    check(house.set("lap", Quantity::Co2, 0.0), "find the location `lap`; did you mean `lab`?");
    check(
        house.set("lab", Quantity::Light, f64::NAN),
        "set the light of `lab` to NaN: between 0 and 200000 is possible",
    );
    assert_eq!(house.truth().value("nowhere", Quantity::Light), None);
}

#[tokio::test(start_paused = true)]
async fn a_sensor_measures_its_own_quantity_and_a_thermometer_the_humidity() {
    let house = house();
    assert!(house.measure("thermometer", Quantity::Humidity).await.is_ok());
    for (sensor, quantity, wrong) in [
        ("co2", Quantity::Light, "use `co2` as a light sensor: it is a sensor"),
        ("thermometer", Quantity::Co2, "use `thermometer` as a co2 sensor: it is a fixed sensor"),
    ] {
        let refused = house.measure(sensor, quantity).await.unwrap_err();
        assert_eq!(refused.to_string(), wrong);
        let refused = house.await_change(sensor, quantity, 0.0).await.unwrap_err();
        assert_eq!(refused.to_string(), wrong);
    }
    assert!(house.read_temperature("co2").await.is_err());
}

/// Waits until the motion in the lab is no longer 0, while `fate` runs. The wait ends after ten
/// seconds.
async fn awaited(
    house: &Building,
    handle: BuildingHandle,
    fate: impl Future<Output = ()>,
) -> Result<f64, String> {
    let awaited = async {
        let measured = handle.await_change("motion", Quantity::Motion, 0.0).await;
        measured.map(|measured| measured.value).map_err(|error| error.to_string())
    };
    let story_before = log_lines(&house.truth()).len();
    let (outcome, ()) = tokio::join!(timeout(Duration::from_secs(10), awaited), fate);
    assert!(log_lines(&house.truth()).len() > story_before);
    outcome.unwrap_or_else(|_| Err("nothing was noticed".to_owned()))
}

#[tokio::test(start_paused = true)]
async fn motion_is_reported_at_once() {
    let house = house();
    let begun = Instant::now();
    let seen = awaited(&house, house.handle(), async {
        tokio::time::sleep(Duration::from_secs(5)).await;
        house.set("den", Quantity::Motion, 1.0).unwrap();
        house.set("lab", Quantity::Motion, 1.0).unwrap();
    });
    assert_eq!(seen.await, Ok(1.0));
    assert_eq!(begun.elapsed(), Duration::from_secs(5));
    let last = log_lines(&house.truth()).pop();
    assert_eq!(last.as_deref(), Some("motion measures lab motion 1"));
}

#[tokio::test(start_paused = true)]
async fn a_broken_or_hanging_sensor_reports_no_change() {
    let house = house();
    let broken = awaited(&house, house.handle(), async {
        house.break_device("motion", DeviceFault::Fails).unwrap();
    });
    assert_eq!(broken.await, Err("use `motion`: it is broken".to_owned()));
    house.repair("motion").unwrap();
    let hangs = awaited(&house, house.handle(), async {
        house.break_device("motion", DeviceFault::Hangs).unwrap();
        house.set("lab", Quantity::Motion, 1.0).unwrap();
    });
    assert_eq!(hangs.await, Err("nothing was noticed".to_owned()));
    let repaired = awaited(&house, house.handle(), async { house.repair("motion").unwrap() });
    assert_eq!(repaired.await, Ok(1.0), "what hung goes on");
}

#[tokio::test]
async fn a_driver_in_another_process_measures_the_same() {
    let house = house();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("building.sock");
    let _server = serve(house.handle(), &path).await.unwrap();
    let far = BuildingHandle::connect(&path).await.unwrap();
    house.set("lab", Quantity::Co2, 812.5).unwrap();
    assert_eq!(far.measure("co2", Quantity::Co2).await.unwrap().value, 812.5);
    let refused = far.measure("co2", Quantity::Light).await.unwrap_err();
    assert_eq!(refused.to_string(), "use `co2` as a light sensor: it is a sensor");
    let seen = awaited(&house, far, async {
        house.set("lab", Quantity::Motion, 1.0).unwrap();
    });
    assert_eq!(seen.await, Ok(1.0));
}
