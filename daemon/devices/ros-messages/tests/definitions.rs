//! Definitions: the whole syntax, and the place and text of each mistake.

use ros_messages::Interfaces;
use serde_json::json;

/// Returns the mistakes of a definition, one a line.
fn mistakes(package: &str, file_name: &str, text: &str) -> Vec<String> {
    let added = Interfaces::standard().add(package, file_name, text);
    added.err().map_or(Vec::new(), |error| error.mistakes.iter().map(ToString::to_string).collect())
}

#[test]
fn every_kind_of_line_is_read() {
    let text = "\u{feff}# A comment.\r\n\r\n  \t# Another.\r\n\
        uint8 A=1\nint8 B = -0x10 # why\nstring C=a = b\nstring D = 'it\\'s'\nbool E=True\n\
        float32 F=1.\nfloat64 G=-.5e3\nint64 H=-9223372036854775808\nuint64 I=+0b11\nchar J=0o17\n\
        wstring K=\"ü\"\nfloat32 L=nan\nstring EMPTY=''\n\
        bool a\n\tint8\tb\t3\nHeader c\ngeometry_msgs/Pose d\ngeometry_msgs/msg/Pose e\n\
        string<=3[<=2] f [\"a,]\", 'b']\nwstring<=2[] g\nOther h\nuint8[3] i [ 1,2 , 3 ]\n\
        float64[] j []\nstring k no quotes\nstring l \"\"\n";
    let mut interfaces = Interfaces::standard();
    interfaces.add("test_msgs", "Test.msg", text).expect("it has no mistakes");
    let constants: serde_json::Map<_, _> = interfaces
        .constants("test_msgs/msg/Test")
        .map(|(name, value)| (name.to_owned(), value.clone()))
        .collect();
    let expected = json!({ "A": 1, "B": -16, "C": "a = b", "D": "it's", "E": true, "F": 1.0,
        "G": -500.0, "H": i64::MIN, "I": 3, "J": 15, "K": "ü", "L": "nan", "EMPTY": "" });
    assert_eq!(serde_json::Value::Object(constants), expected);
    let unresolved = interfaces.unresolved();
    let unresolved: Vec<_> = unresolved.iter().map(ToString::to_string).collect();
    assert_eq!(
        unresolved,
        ["find the ROS type `test_msgs/msg/Other`: add its definition, which `h` \
                             of `test_msgs/msg/Test` needs"]
    );
    interfaces.add("test_msgs", "Other.msg", "").expect("it has no mistakes");
    let bytes = interfaces.encode("test_msgs/msg/Test", &json!({})).expect("it has defaults");
    let decoded = interfaces.decode("test_msgs/msg/Test", &bytes).expect("it is valid");
    assert!(decoded.is_complete());
    for (name, value) in [
        ("b", json!(3)),
        ("f", json!(["a,]", "b"])),
        ("i", json!([1, 2, 3])),
        ("j", json!([])),
        ("k", json!("no quotes")),
        ("l", json!("")),
    ] {
        assert_eq!(decoded.value[name], value, "{name}");
    }
}

#[test]
fn mistakes_have_their_places() {
    for (line, expected) in [
        (
            "float64",
            "1, column 1: `float64`: a blank and a name follow the type, as in `float64 x`",
        ),
        ("float64[3x", "1, column 9: `3x`: a size is a whole number from 1 to 4294967295"),
        ("float64[0] x", "1, column 9: `0`: a size is a whole number from 1 to 4294967295"),
        ("float64[3 x", "1, column 8: `[3`: an array is `[3]`, `[<=3]` or `[]`"),
        ("float64[<=] x", "1, column 8: `[<=]`: a number follows `<=`, as in `[<=3]`"),
        (
            "int8<=3 x",
            "1, column 1: `int8<=3`: only strings have a bound; `int8[<=N]` is a sequence \
                       of at most N elements",
        ),
        ("time x", "1, column 1: `time`: ROS 2 spells this type `builtin_interfaces/Time`"),
        ("  a/b/c/D x", "1, column 3: `a/b/c/D`: the name of a message is `package/Name`"),
        (
            "@optional",
            "1, column 1: `@optional`: a line is a field such as `float64 x`, or a \
                       constant such as `uint8 OK=0`",
        ),
        (
            "uint8 A",
            "1, column 7: `A`: the name of a field has small letters, digits and single \
                     underscores, begins with a letter and does not end with an underscore",
        ),
        (
            "uint8 a=1",
            "1, column 7: `a=1`: the name of a constant has capital letters, digits and \
                       single underscores, begins with a letter and does not end with an underscore",
        ),
        ("uint8 A=", "1, column 7: `A=`: a value follows `=`, as in `uint8 OK=0`"),
        (
            "uint8[2] A=1",
            "1, column 1: `uint8[2]`: a constant has a number, `bool`, `string` or \
                          `wstring` as its type",
        ),
        (
            "uint8 ÜBER=300",
            "1, column 7: `ÜBER=300`: the name of a constant has capital letters, \
                            digits and single underscores, begins with a letter and does not end \
                            with an underscore",
        ),
        ("uint8 A = 300 # ü", "1, column 11: `300`: the value is a whole number from 0 to 255"),
        ("string a \"ü\" \"", "1, column 10: `\"ü\" \"`: a \" within the text is written as \\\""),
        (
            "float64 a 1,5",
            "1, column 11: `1,5`: the value is a number, \"nan\", \"inf\" or \"-inf\"",
        ),
        ("bool a yes", "1, column 8: `yes`: the value is true or false"),
        ("uint8 a -", "1, column 9: `-`: the value is a whole number from 0 to 255"),
        ("uint8[2] a [1]", "1, column 12: `[1]`: the array has 2 elements, not 1"),
        (
            "uint8[<=1] a [1, 2]",
            "1, column 14: `[1, 2]`: the sequence has at most 1 elements, not 2",
        ),
        (
            "uint8[] a 1",
            "1, column 11: `1`: a default value of an array is written as in \
                         `[1, 2, 3]`",
        ),
        ("uint8[] a [1, x]", "1, column 15: `x`: the value is a whole number from 0 to 255"),
        (
            "uint8[] a [1",
            "1, column 11: `[1`: a default value of an array is written as in \
                          `[1, 2, 3]`",
        ),
        ("string[] a ['x]", "1, column 13: `'x]`: a text ends with ', with which it begins"),
        ("string<=2 a abc", "1, column 13: `abc`: the text has at most 2 bytes, not 3"),
        (
            "geometry_msgs/Pose a 0",
            "1, column 22: `0`: `geometry_msgs/msg/Pose` has no default \
                                    value; only numbers, `bool` and strings do",
        ),
        (
            "uint8 a\nuint8 a",
            "2, column 1: `uint8 a`: the name is taken by an earlier line; names \
                              are unique",
        ),
        ("---", "1, column 1: `---`: a message has no line `---`; services and actions have"),
        (
            "uint8 a\nTest[] b",
            "2, column 1: `b`: `test_msgs/msg/Test` would contain itself; ROS has \
                               no such types",
        ),
    ] {
        assert_eq!(mistakes("test_msgs", "Test.msg", line), [format!("line {expected}")], "{line}");
    }
    let types = mistakes("test_msgs", "Test.msg", "int37 x");
    assert!(
        types[0].starts_with("line 1, column 1: `int37`: a type is `bool`, `byte`"),
        "{types:?}"
    );
}

#[test]
fn all_mistakes_are_told_at_once() {
    let error = Interfaces::standard()
        .add("test_msgs", "Test.srv", "int37 a\n\nfloat64 B\n---\nuint8 c\n---\n")
        .expect_err("it has mistakes");
    let lines: Vec<_> = error.mistakes.iter().map(|mistake| mistake.line).collect();
    assert_eq!(lines, [1, 3, 6]);
    assert!(error.to_string().starts_with("read `test_msgs/Test.srv`: line 1, column 1: `int37`"));
}

#[test]
fn services_and_actions_have_their_parts() {
    assert!(mistakes("test_msgs", "Test.srv", "---").is_empty());
    assert!(mistakes("test_msgs", "Test.action", "---\n---").is_empty());
    let service = mistakes("test_msgs", "Test.srv", "uint8 a\n");
    let expected = "line 1, column 1: `uint8 a`: a service has one line `---`, between request and \
                    response";
    assert_eq!(service, [expected]);
    let action = mistakes("test_msgs", "Test.action", "");
    let expected = "line 1, column 1: an action has two lines `---`, between goal, result and \
                    feedback";
    assert_eq!(action, [expected]);
}

#[test]
fn names_of_files_are_checked() {
    for (package, file_name, found) in [
        ("Test", "Test.msg", "Test"),
        ("a__b", "Test.msg", "a__b"),
        ("test_msgs", "test.msg", "test.msg"),
        ("test_msgs", "Test_Request.msg", "Test_Request.msg"),
        ("test_msgs", "Test.idl", "Test.idl"),
        ("test_msgs", "Test", "Test"),
        ("test_msgs", "../Test.msg", "../Test.msg"),
    ] {
        let mistakes = mistakes(package, file_name, "");
        assert!(mistakes[0].starts_with(&format!("`{found}`: ")), "{mistakes:?}");
    }
}

#[test]
fn a_circle_over_several_definitions_is_a_mistake() {
    let mut interfaces = Interfaces::standard();
    interfaces.add("test_msgs", "A.msg", "B[] b").expect("it has no mistakes");
    interfaces.add("test_msgs", "B.msg", "uint8 x\nC[2] c").expect("it has no mistakes");
    let error = interfaces.add("test_msgs", "C.msg", "uint8 x\n\n  A a").expect_err("a circle");
    assert_eq!((error.mistakes[0].line, error.mistakes[0].column), (3, 3));
    // The definition is not added.
    let unresolved = interfaces.unresolved();
    assert_eq!(unresolved[0].name, "test_msgs/msg/C");
    interfaces.add("test_msgs", "C.msg", "uint8 x").expect("it has no mistakes");
    assert_eq!(interfaces.unresolved(), []);
}

#[test]
fn a_definition_replaces_a_known_one() {
    let mut interfaces = Interfaces::standard();
    let before = interfaces.type_hash("std_msgs/msg/Header");
    interfaces.add("std_msgs", "Header.msg", "uint32 seq\n").expect("it has no mistakes");
    assert_ne!(interfaces.type_hash("std_msgs/msg/Header"), before);
    assert!(interfaces.encode("std_msgs/msg/Header", &json!({ "seq": 7 })).is_ok());
}
