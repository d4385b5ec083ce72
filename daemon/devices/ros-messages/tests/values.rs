//! Values that are encoded: defaults, exact numbers, and the errors for values that do not fit.

use ros_messages::{DECODED_VALUES_MAX, Interfaces, dds_name};
use serde_json::{Value, json};

/// Returns the built-in definitions, and the message `test_msgs/msg/Test` with the text.
fn with(text: &str) -> Interfaces {
    let mut interfaces = Interfaces::standard();
    interfaces.add("test_msgs", "Test.msg", text).expect("it has no mistakes");
    interfaces
}

/// Returns the value that is decoded after `value` is encoded as a message of the definition
/// `text`.
fn there_and_back(text: &str, value: &Value) -> Value {
    let interfaces = with(text);
    let bytes = interfaces.encode("test_msgs/msg/Test", value).expect("the value fits");
    let decoded = interfaces.decode("test_msgs/msg/Test", &bytes).expect("the bytes are valid");
    assert!(decoded.is_complete(), "{:?} is missing", decoded.first_missing);
    decoded.value
}

fn encode_error(text: &str, value: &Value) -> String {
    let encoded = with(text).encode("test_msgs/msg/Test", value);
    encoded.expect_err("the value does not fit").to_string()
}

#[test]
fn missing_fields_have_the_defaults_of_their_definition() {
    let interfaces = Interfaces::standard();
    let bytes = interfaces.encode("geometry_msgs/msg/PoseStamped", &json!({})).expect("it fits");
    let decoded = interfaces.decode("geometry_msgs/msg/PoseStamped", &bytes).expect("it is valid");
    let orientation = &decoded.value["pose"]["orientation"];
    assert_eq!(*orientation, json!({ "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 }));
    let text = "int8[2] a [3, -4]\nstring b \"it is\"\nstring[] c ['x', y]\nbool d true\nfloat32 e\n\
                geometry_msgs/Quaternion[2] f\nwstring g 'ü'\nuint64 h 0xffff\nint8[<=2] i\n";
    let rotation = json!({ "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 });
    let expected = json!({ "a": [3, -4], "b": "it is", "c": ["x", "y"], "d": true, "e": 0.0,
        "f": [rotation, rotation], "g": "ü", "h": 65535, "i": [] });
    assert_eq!(there_and_back(text, &json!({})), expected);
}

#[test]
fn numbers_are_exact() {
    let value = json!({ "a": i64::MIN, "b": u64::MAX, "c": 0.1, "d": 1.5, "e": 255, "f": 7 });
    let text = "int64 a\nuint64 b\nfloat64 c\nfloat32 d\nchar e\nbyte f";
    assert_eq!(there_and_back(text, &value), value);
    let special = json!({ "a": "nan", "b": "inf", "c": ["-inf", 3.0] });
    assert_eq!(there_and_back("float32 a\nfloat64 b\nfloat32[] c", &special), special);
    // A whole number is also a float.
    assert_eq!(there_and_back("float64 a", &json!({ "a": 3 })), json!({ "a": 3.0 }));
}

#[test]
fn a_wide_string_has_four_bytes_for_each_unit() {
    let interfaces = with("uint8 a\nwstring<=4 b");
    let value = json!({ "a": 1, "b": "aü😀" });
    let bytes = interfaces.encode("test_msgs/msg/Test", &value).expect("it fits");
    let units = [4, u32::from(b'a'), 0xfc, 0xd83d, 0xde00].map(u32::to_le_bytes);
    assert_eq!(bytes, [&[0, 1, 0, 0, 1, 0, 0, 0][..], units.as_flattened()].concat());
    assert_eq!(there_and_back("uint8 a\nwstring<=4 b", &value), value);
}

#[test]
fn an_empty_message_has_one_byte() {
    let interfaces = Interfaces::standard();
    let encoded = interfaces.encode("std_msgs/msg/Empty", &json!({}));
    assert_eq!(encoded, Ok(vec![0, 1, 0, 0, 0]));
    let error = interfaces
        .encode("std_msgs/msg/Empty", &json!({ "structure_needs_at_least_one_member": 0 }))
        .expect_err("the byte is no field");
    assert!(error.to_string().ends_with("its fields are none"), "{error}");
}

#[test]
fn values_that_do_not_fit_are_named_by_their_path() {
    let cases = [
        (
            "geometry_msgs/Pose pose",
            json!({ "pose": { "position": { "x": "1" } } }),
            "encode `pose.position.x`: the field takes a number, \"nan\", \"inf\" or \"-inf\", not \"1\"",
        ),
        (
            "geometry_msgs/Point[] p",
            json!({ "p": [{}, { "w": 1 }] }),
            "encode `p[1].w`: `geometry_msgs/msg/Point` has no such field; its fields are x, y, z",
        ),
        (
            "uint8 a",
            json!({ "a": 256 }),
            "encode `a`: the field takes a whole number from 0 to 255, not 256",
        ),
        (
            "int8 a",
            json!({ "a": -129 }),
            "encode `a`: the field takes a whole number from -128 to 127, not -129",
        ),
        (
            "int32 a",
            json!({ "a": 1.5 }),
            "encode `a`: the field takes a whole number from -2147483648 to 2147483647, not 1.5",
        ),
        ("bool a", json!({ "a": 1 }), "encode `a`: the field takes true or false, not 1"),
        (
            "float32 a",
            json!({ "a": 1e39 }),
            "encode `a`: the field takes a number of at most 3.4e38, \"nan\", \"inf\" or \"-inf\", not 1e+39",
        ),
        (
            "string<=3 a",
            json!({ "a": "über" }),
            "encode `a`: the field takes at most 3 bytes, not 5 bytes",
        ),
        (
            "wstring<=3 a",
            json!({ "a": "über" }),
            "encode `a`: the field takes at most 3 units of UTF-16, not 4 units of UTF-16",
        ),
        (
            "string a",
            json!({ "a": "x\0" }),
            "encode `a`: the field takes a text without the character NUL, not \"x\\u0000\"",
        ),
        (
            "int8[2] a",
            json!({ "a": [1] }),
            "encode `a`: the field takes an array of 2 elements, not 1 elements",
        ),
        (
            "int8[<=2] a",
            json!({ "a": [1, 2, 3] }),
            "encode `a`: the field takes an array of at most 2 elements, not 3 elements",
        ),
        ("int8[] a", json!({ "a": {} }), "encode `a`: the field takes an array, not {}"),
        (
            "int8 a",
            json!([]),
            "encode `the message`: the field takes an object with fields of `test_msgs/msg/Test`, not []",
        ),
        (
            "other_msgs/Thing a",
            json!({}),
            "find the ROS type `other_msgs/msg/Thing`: add its definition; a full name is such as \
          `geometry_msgs/msg/Pose`",
        ),
    ];
    for (text, value, expected) in cases {
        assert_eq!(encode_error(text, &value), expected);
    }
}

#[test]
fn bytes_that_do_not_fit_are_named_by_their_path() {
    let cases: [(&str, &[u8], &str); 6] = [
        (
            "bool[2] a",
            &[0, 1, 0, 0, 1, 2],
            "decode `a[1]`: 2 is not true or false; the definition may be that of another version",
        ),
        (
            "int8[<=2] a",
            &[0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0],
            "decode `a`: 3 elements are more than the 2 of the definition; the definition may be that \
          of another version",
        ),
        (
            "string<=2 a",
            &[0, 1, 0, 0, 4, 0, 0, 0, 65, 65, 65, 0],
            "decode `a`: 3 bytes are more than the 2 of the definition; the definition may be that of \
          another version",
        ),
        (
            "int8 a",
            &[0, 3, 0, 0, 1],
            "decode the message: it begins with the bytes [00, 03, 00, 00]; CDR begins with 00 00 or \
          00 01 and two more bytes",
        ),
        (
            "int8 a",
            &[0],
            "decode the message: it begins with the bytes [00]; CDR begins with 00 00 or 00 01 and two \
          more bytes",
        ),
        (
            "test_msgs/Gone a",
            &[0, 1, 0, 0],
            "find the ROS type `test_msgs/msg/Gone`: add its definition; a full name is such as \
          `geometry_msgs/msg/Pose`",
        ),
    ];
    for (text, bytes, expected) in cases {
        let error = with(text).decode("test_msgs/msg/Test", bytes).expect_err("it does not fit");
        assert_eq!(error.to_string(), expected);
    }
}

#[test]
fn lengths_that_the_bytes_do_not_have_are_an_early_end() {
    for text in
        ["uint8[] a", "string a", "wstring a", "std_msgs/Empty[] a", "float64[4000000000] a"]
    {
        let interfaces = with(text);
        let decoded = interfaces.decode("test_msgs/msg/Test", &[0, 1, 0, 0, 255, 255, 255, 255, 1]);
        let decoded = decoded.expect("it ends early");
        assert_eq!((decoded.value, decoded.first_missing.as_deref()), (json!({}), Some("a")));
    }
}

#[test]
fn a_string_without_an_end_is_read() {
    let interfaces = with("string a\nstring b");
    let bytes = [0, 1, 0, 0, 2, 0, 0, 0, 65, 0xff, 0, 0, 0, 0, 0, 0];
    let decoded = interfaces.decode("test_msgs/msg/Test", &bytes).expect("it is valid");
    assert_eq!(decoded.value, json!({ "a": "A\u{fffd}", "b": "" }));
    assert!(decoded.is_complete());
}

#[test]
fn messages_have_bounds() {
    let interfaces = with("uint8[] a");
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend(200_000_u32.to_le_bytes());
    bytes.resize(200_008, 0);
    let error = interfaces.decode("test_msgs/msg/Test", &bytes).expect_err("it is too long");
    let expected = format!(
        "decode `a[{DECODED_VALUES_MAX}]`: the message has more than {DECODED_VALUES_MAX} values"
    );
    assert_eq!(error.to_string(), expected);
    let error = encode_error("float64[4000000000] a", &json!({}));
    assert_eq!(error, "encode `a[8388607]`: the message has more than 67108864 bytes");
    let mut interfaces = Interfaces::standard();
    for level in 0..70 {
        let text = if level == 0 { "uint8 x".to_owned() } else { format!("A{} x", level - 1) };
        interfaces.add("test_msgs", &format!("A{level}.msg"), &text).expect("it has no mistakes");
    }
    assert!(interfaces.encode("test_msgs/msg/A60", &json!({})).is_ok());
    let error = interfaces.encode("test_msgs/msg/A69", &json!({})).expect_err("it is too deep");
    assert!(error.to_string().ends_with("nest on more than 64 levels"), "{error}");
    let error = interfaces.decode("test_msgs/msg/A69", &[0, 1, 0, 0, 0]).expect_err("too deep");
    assert!(error.to_string().ends_with("nest on more than 64 levels"), "{error}");
}

#[test]
fn names_are_those_of_dds() {
    assert_eq!(
        dds_name("nav2_msgs/action/NavigateToPose_SendGoal").as_deref(),
        Some("nav2_msgs::action::dds_::NavigateToPose_SendGoal_")
    );
    for wrong in ["Pose", "geometry_msgs/Pose", "geometry_msgs/msg/Pose/x", "a/msg/pose", "a/b/C"] {
        assert_eq!(dds_name(wrong), None, "{wrong}");
    }
    let error = Interfaces::standard().type_hash("geometry_msgs/Pose").expect_err("it is short");
    assert_eq!(
        error.to_string(),
        "find the ROS type `geometry_msgs/Pose`: its name is `geometry_msgs/msg/Pose`"
    );
}
