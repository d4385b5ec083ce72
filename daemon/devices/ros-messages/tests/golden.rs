//! Compares bytes and hashes with those of other implementations: PyPI's rosbags (bytes of both
//! orders, hashes; `rosbags_golden.py` writes the file) and rosidl, the generator of ROS 2
//! (hashes).

#[path = "../../../../tests/support/left_out.rs"]
mod left_out;

use std::path::{Path, PathBuf};
use std::process::Command;

use ros_messages::{CdrEncodeError, Interfaces};
use serde_json::Value;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests")
}

fn read(name: &str) -> String {
    std::fs::read_to_string(folder().join(name)).expect("the file is committed")
}

/// Returns the built-in definitions, and the one that has every kind of field.
fn interfaces() -> Interfaces {
    let mut interfaces = Interfaces::standard();
    let everything = read("definitions/test_msgs/msg/Everything.msg");
    interfaces.add("test_msgs", "Everything.msg", &everything).expect("it has no mistakes");
    interfaces
}

fn golden() -> Vec<Value> {
    let text = read("rosbags_golden.jsonl");
    text.lines().map(|line| serde_json::from_str(line).expect("each line is JSON")).collect()
}

fn bytes(hex: &Value) -> Vec<u8> {
    let hex = hex.as_str().expect("bytes are a string").as_bytes();
    let digits = |pair| std::str::from_utf8(pair).expect("digits are ASCII");
    hex.chunks(2).map(|pair| u8::from_str_radix(digits(pair), 16).expect("hexadecimal")).collect()
}

#[test]
fn every_message_is_encoded_and_decoded_as_rosbags_does() {
    let interfaces = interfaces();
    let mut count = 0;
    for line in golden() {
        let name = line["type"].as_str().expect("a name");
        for message in line["messages"].as_array().expect("messages") {
            let (value, little) = (&message["value"], bytes(&message["little"]));
            assert_eq!(interfaces.encode(name, value).as_ref(), Ok(&little), "{name}");
            for encoded in [little, bytes(&message["big"])] {
                let decoded = interfaces.decode(name, &encoded).expect("the bytes are valid");
                assert!(decoded.is_complete(), "{name} lacks {:?}", decoded.first_missing);
                assert_eq!(decoded.value, *value, "{name}");
            }
            count += 1;
        }
    }
    assert!(count > 150, "{count} messages are too few");
}

#[test]
fn every_hash_is_that_of_rosbags() {
    let interfaces = interfaces();
    for line in golden() {
        let name = line["type"].as_str().expect("a name");
        assert_eq!(interfaces.type_hash(name).ok().as_deref(), line["hash"].as_str(), "{name}");
    }
}

#[test]
fn every_type_is_in_the_golden_file() {
    let lines = golden();
    let golden: Vec<_> = lines.iter().filter_map(|line| line["type"].as_str()).collect();
    let interfaces = interfaces();
    let missing: Vec<_> = interfaces.type_names().filter(|name| !golden.contains(name)).collect();
    assert_eq!(missing, Vec::<&str>::new(), "run tests/rosbags_golden.py");
    assert_eq!(interfaces.type_names().count(), golden.len());
}

#[test]
fn hashes_are_those_of_rosidl() {
    let interfaces = Interfaces::standard();
    let text = read("rosidl_hashes.tsv");
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut count = 0;
    for (name, hash) in lines.filter_map(|line| line.split_once('\t')) {
        assert_eq!(interfaces.type_hash(name).as_deref(), Ok(hash), "{name}");
        count += 1;
    }
    assert!(count > 25, "{count} hashes are too few");
}

/// The library rosbags has no wide strings. The fields and the hash are those of `test_msgs`, with
/// which ROS 2 tests itself.
#[test]
fn wide_strings_have_the_hash_of_rosidl() {
    let mut interfaces = Interfaces::default();
    let text = "wstring wstring_value\n\
                wstring wstring_value_default1 \"one\"\n\
                wstring wstring_value_default2 \"two\"\n\
                wstring wstring_value_default3 \"three\"\n\
                wstring[3] array_of_wstrings\n\
                wstring[<=3] bounded_sequence_of_wstrings\n\
                wstring[] unbounded_sequence_of_wstrings\n";
    interfaces.add("test_msgs", "WStrings.msg", text).expect("it has no mistakes");
    assert_eq!(
        interfaces.type_hash("test_msgs/msg/WStrings").as_deref(),
        Ok("RIHS01_5a2c8ddb2054600023b9a180652f2ba895373217cad4b1f0fc1258c9e4424a79")
    );
}

#[test]
fn services_and_actions_have_no_encoding() {
    let interfaces = interfaces();
    for line in golden() {
        let name = line["type"].as_str().expect("a name");
        if line["messages"].as_array().is_some_and(Vec::is_empty) {
            let error = interfaces.encode(name, &Value::Null).expect_err("it is no message");
            assert!(matches!(error, CdrEncodeError::UnknownType(_)), "{error}");
            assert!(error.to_string().contains("has no encoding"), "{error}");
        }
    }
}

#[test]
fn built_in_definitions_need_no_others() {
    assert_eq!(Interfaces::standard().unresolved(), []);
}

/// Whether Python has the version of rosbags that wrote the golden file.
fn has_rosbags() -> bool {
    let script = "from importlib.metadata import version; assert version('rosbags') == '0.11.9'";
    let run = Command::new("python3").args(["-c", script]).output();
    run.is_ok_and(|run| run.status.success())
}

#[test]
fn the_golden_file_is_what_rosbags_writes() {
    if !has_rosbags() {
        left_out::left_out("Python has no rosbags 0.11.9: pip install rosbags==0.11.9");
        return;
    }
    let script = folder().join("rosbags_golden.py");
    let run = Command::new("python3").arg(script).arg("--check").output().expect("Python runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}
