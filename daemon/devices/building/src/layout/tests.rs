//! Tests of layouts that are possible, and of the errors for mistakes in layouts.

use expect_test::{Expect, expect};

use super::{Layout, LayoutError};

fn two_rooms() -> Result<Layout, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("office1", 20.5)?
        .add_room("office2", 21.5)?
        .connect("office1", "office2", 4.0)?
        .add_fixed_sensor("thermometer", "office1")?
        .add_robot("turtlebot-1", "office2", 0.3)?;
    Ok(layout)
}

#[track_caller]
fn check(build: impl FnOnce(&mut Layout) -> Result<&mut Layout, LayoutError>, expected: Expect) {
    let mut layout = two_rooms().unwrap();
    let before = layout.clone();
    let error = build(&mut layout).map(|_| ()).unwrap_err();
    expected.assert_eq(&format!("failed to {error}"));
    assert_eq!(layout, before, "a refused addition leaves the layout as it was");
}

#[test]
fn errors_of_a_layout_name_the_correction() {
    check(
        |layout| layout.connect("ofice1", "office2", 3.0),
        expect!["failed to find the location `ofice1`; did you mean `office1`?"],
    );
    check(
        |layout| layout.add_fixed_sensor("thermometer-2", "greenhouse"),
        expect!["failed to find the location `greenhouse`"],
    );
    check(
        |layout| layout.mount("ir-1", "turtlebot1"),
        expect!["failed to find the robot `turtlebot1`; did you mean `turtlebot-1`?"],
    );
    check(
        |layout| layout.mount("ir-1", "thermometer"),
        expect![
            "failed to mount a sensor on `thermometer`: it is a fixed sensor, and only a robot carries sensors"
        ],
    );
    check(
        |layout| layout.add_robot("office1", "office2", 0.3),
        expect!["failed to name something `office1`: a location has that name; choose another"],
    );
    check(
        |layout| layout.add_room("Büro", 20.0),
        expect![
            "failed to name something `Büro`: a name is a lower-case letter, then at most 63 of `a-z 0-9 - _`"
        ],
    );
    check(
        |layout| layout.connect("office2", "office1", 9.0),
        expect![
            "failed to connect `office2` and `office1` again: they are connected by 4 m already"
        ],
    );
    check(
        |layout| layout.connect("office1", "office1", 9.0),
        expect!["failed to connect `office1` with itself: name two different locations"],
    );
}

#[test]
fn impossible_numbers_are_refused() {
    check(
        |layout| layout.add_room("oven", f64::NAN),
        expect!["failed to set NaN °C in `oven`: between -273.15 and 1000 is possible"],
    );
    check(
        |layout| layout.add_room("void", -300.0),
        expect!["failed to set -300 °C in `void`: between -273.15 and 1000 is possible"],
    );
    check(
        |layout| layout.connect_one_way("office1", "office2", 0.0),
        expect![
            "failed to connect `office1` and `office2` by 0 m: more than 0 and at most 1000 m is possible"
        ],
    );
    check(
        |layout| layout.add_robot("turtlebot-2", "office1", 0.0),
        expect![
            "failed to let `turtlebot-2` drive at 0 m/s: between 0.001 and 100 m/s is possible"
        ],
    );
}

#[test]
fn a_layout_survives_json_and_toml() {
    let layout = Layout::seeded(7).layout;
    let json = serde_json::to_string(&layout).unwrap();
    assert_eq!(serde_json::from_str::<Layout>(&json).unwrap(), layout);
    let toml = toml::to_string(&layout).unwrap();
    assert_eq!(toml::from_str::<Layout>(&toml).unwrap(), layout);
}

#[test]
fn a_file_is_checked_as_it_is_read_and_may_name_devices_in_any_order() {
    let file = |carrier: &str| {
        format!(
            r#"
            locations = [{{ name = "hall", kind = "corridor", celsius = 19.0 }}]
            devices = [
                {{ name = "ir-1", kind = "mounted-sensor", carrier = "{carrier}" }},
                {{ name = "rover", kind = "robot", start = "hall", meters-per-second = 1.0 }},
            ]"#
        )
    };
    let layout: Layout = toml::from_str(&file("rover")).unwrap();
    assert_eq!(layout.devices().len(), 2);
    let error = toml::from_str::<Layout>(&file("rovr")).unwrap_err();
    assert!(error.message().contains("did you mean `rover`?"), "{error}");
}

#[test]
fn one_way_connections_lead_one_way() {
    let mut layout = Layout::new();
    layout.add_room("a", 20.0).unwrap().add_room("b", 20.0).unwrap();
    layout.connect_one_way("a", "b", 2.0).unwrap();
    assert_eq!((layout.meters("a", "b"), layout.meters("b", "a")), (Some(2.0), None));
    assert_eq!(layout.reachable_from("b").into_iter().collect::<Vec<_>>(), ["b"]);
    layout.connect_one_way("b", "a", 3.0).unwrap();
    assert_eq!(layout.meters("b", "a"), Some(3.0));
    assert!(layout.connect("a", "b", 2.0).is_err());
}
