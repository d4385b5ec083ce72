//! One definition reads the messages of several distributions of ROS, and a message that ends
//! anywhere is a prefix.

use ros_messages::{Decoded, Interfaces};
use serde_json::{Value, json};

const RESULT: &str = "nav2_msgs/action/NavigateToPose_GetResult_Response";
const FEEDBACK: &str = "nav2_msgs/action/NavigateToPose_FeedbackMessage";

/// Returns the values that Jazzy's definitions read from a message of another distribution.
/// `result` and `feedback` are parts of the `NavigateToPose.action` of that distribution.
fn read_from(result: &str, feedback: &str, type_name: &str, value: &Value) -> Decoded {
    let mut other = Interfaces::standard();
    let goal = "geometry_msgs/PoseStamped pose\nstring behavior_tree";
    let text = format!("{goal}\n---\n{result}\n---\n{feedback}\n");
    other.add("nav2_msgs", "NavigateToPose.action", &text).expect("it has no mistakes");
    let bytes = other.encode(type_name, value).expect("the value fits");
    Interfaces::standard().decode(type_name, &bytes).expect("it is a prefix or longer")
}

#[test]
fn a_result_of_humble_has_its_status() {
    let decoded = read_from("std_msgs/Empty result", "", RESULT, &json!({ "status": 4 }));
    assert_eq!(decoded.value, json!({ "status": 4 }));
    assert_eq!(decoded.first_missing.as_deref(), Some("result.error_code"));
}

#[test]
fn a_result_of_iron_has_its_code() {
    let value = json!({ "status": 6, "result": { "error_code": 9003 } });
    let decoded = read_from("uint16 error_code", "", RESULT, &value);
    assert_eq!(decoded.value, value);
    assert_eq!(decoded.first_missing.as_deref(), Some("result.error_msg"));
}

#[test]
fn feedback_of_lyrical_is_read_up_to_the_fields_of_jazzy() {
    let jazzy = "geometry_msgs/PoseStamped current_pose\n\
                 builtin_interfaces/Duration navigation_time\n\
                 builtin_interfaces/Duration estimated_time_remaining\n\
                 int16 number_of_recoveries\nfloat32 distance_remaining\n";
    let lyrical = format!("{jazzy}float32 position_tracking_error\nfloat32 heading_tracking_error");
    let value = json!({ "feedback": { "number_of_recoveries": -2, "distance_remaining": 1.5 } });
    let decoded = read_from("", &lyrical, FEEDBACK, &value);
    assert!(decoded.is_complete());
    assert_eq!(decoded.value["feedback"]["number_of_recoveries"], -2);
    assert_eq!(decoded.value["feedback"]["distance_remaining"], 1.5);
}

/// Whether `part` is `whole` without some of its fields.
fn is_part(part: &Value, whole: &Value) -> bool {
    match (part, whole) {
        (Value::Object(part), Value::Object(whole)) => part
            .iter()
            .all(|(name, value)| whole.get(name).is_some_and(|whole| is_part(value, whole))),
        _ => part == whole,
    }
}

/// Returns the number of values in objects within objects.
fn leaves(value: &Value) -> usize {
    match value {
        Value::Object(object) => object.values().map(leaves).sum(),
        _ => 1,
    }
}

#[test]
fn a_message_that_ends_anywhere_is_a_prefix() {
    let mut interfaces = Interfaces::standard();
    let everything = include_str!("definitions/test_msgs/msg/Everything.msg");
    interfaces.add("test_msgs", "Everything.msg", everything).expect("it has no mistakes");
    let text = include_str!("rosbags_golden.jsonl");
    let mut count = 0;
    for line in text.lines() {
        let line: Value = serde_json::from_str(line).expect("each line is JSON");
        let name = line["type"].as_str().expect("a name");
        for message in line["messages"].as_array().expect("messages") {
            let whole = &message["value"];
            let bytes = interfaces.encode(name, whole).expect("the value fits");
            let mut before = 0;
            for length in 4..bytes.len() {
                let decoded = interfaces.decode(name, &bytes[..length]).expect("it is a prefix");
                assert!(!decoded.is_complete(), "{name} of {length} of {} bytes", bytes.len());
                assert!(is_part(&decoded.value, whole), "{name}: {}", decoded.value);
                assert!(leaves(&decoded.value) >= before, "{name}: fields only ever come");
                before = leaves(&decoded.value);
                count += 1;
            }
            let longer = [&bytes[..], &[7; 9]].concat();
            let decoded = interfaces.decode(name, &longer).expect("the rest is ignored");
            assert!(decoded.is_complete() && decoded.value == *whole, "{name}");
        }
    }
    assert!(count > 5_000, "{count} prefixes are too few");
}

#[test]
fn part_of_an_array_is_no_field() {
    let interfaces = Interfaces::standard();
    let name = "action_msgs/msg/GoalStatusArray";
    let bytes = interfaces.encode(name, &json!({ "status_list": [{}, {}] })).expect("it fits");
    let decoded = interfaces.decode(name, &bytes[..bytes.len() - 1]).expect("it is a prefix");
    assert_eq!(decoded.value, json!({}));
    assert_eq!(decoded.first_missing.as_deref(), Some("status_list[1].status"));
}
