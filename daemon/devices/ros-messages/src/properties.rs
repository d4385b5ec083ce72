//! Properties of encoding and decoding, on random values and random bytes. The seeds are fixed.

use fastrand::Rng;
use serde_json::{Map, Value};

use crate::Interfaces;
use crate::structure::{FieldArity, FieldElement, MessageStructure, PrimitiveType, StructureRole};
use crate::values::{float_value, from_bits, whole_value};

/// Number of random values for each message.
const VALUES: usize = 200;

/// Number of messages of random bytes, over all types.
const GARBAGE: usize = 60_000;

/// Maximum number of elements of a random sequence.
const ELEMENTS_MAX: usize = 4;

/// Returns the built-in definitions, one with every kind of field, and one with wide strings.
fn interfaces() -> Interfaces {
    let mut interfaces = Interfaces::standard();
    let everything = include_str!("../tests/definitions/test_msgs/msg/Everything.msg");
    let wide = "uint8 a\nwstring b\nwstring<=3[2] c\nwstring[] d\nbool e\nEverything[<=2] f\n";
    for (file_name, text) in [("Everything.msg", everything), ("Wide.msg", wide)] {
        interfaces.add("test_msgs", file_name, text).expect("it has no mistakes");
    }
    interfaces
}

/// Returns the names of all messages, in the same order each time.
fn messages(interfaces: &Interfaces) -> Vec<&str> {
    let is_message = |name: &&str| {
        interfaces.structure(name).is_ok_and(|found| found.role == StructureRole::Message)
    };
    let mut names: Vec<_> = interfaces.type_names().filter(is_message).collect();
    names.sort_unstable();
    names
}

fn random_object(interfaces: &Interfaces, structure: &MessageStructure, rng: &mut Rng) -> Value {
    let mut object = Map::new();
    for field in &structure.fields {
        let length = match field.arity {
            FieldArity::One => {
                let value = random_element(interfaces, &field.element, rng);
                object.insert(field.name.clone(), value);
                continue;
            }
            FieldArity::Array(size) => size as usize,
            FieldArity::BoundedSequence(bound) => rng.usize(..=(bound as usize).min(ELEMENTS_MAX)),
            FieldArity::Sequence => rng.usize(..=ELEMENTS_MAX),
        };
        let elements = (0..length).map(|_| random_element(interfaces, &field.element, rng));
        object.insert(field.name.clone(), elements.collect());
    }
    Value::Object(object)
}

fn random_element(interfaces: &Interfaces, element: &FieldElement, rng: &mut Rng) -> Value {
    match element {
        FieldElement::Primitive(primitive) => random_number(*primitive, rng),
        FieldElement::String(bound) => {
            let mut text = random_text(rng);
            while bound.is_some_and(|bound| text.len() > bound as usize) {
                text.pop();
            }
            Value::from(text)
        }
        FieldElement::WideString(bound) => {
            let mut text = random_text(rng);
            while bound.is_some_and(|bound| text.encode_utf16().count() > bound as usize) {
                text.pop();
            }
            Value::from(text)
        }
        FieldElement::Nested(name) => {
            let structure = interfaces.message(name).expect("the type is known");
            random_object(interfaces, structure, rng)
        }
    }
}

fn random_text(rng: &mut Rng) -> String {
    let length = rng.usize(..12);
    std::iter::repeat_with(|| rng.char(..)).filter(|letter| *letter != '\0').take(length).collect()
}

fn random_number(primitive: PrimitiveType, rng: &mut Rng) -> Value {
    if let Some((least, greatest)) = primitive.whole_range() {
        let whole = match rng.u8(..4) {
            0 => least,
            1 => greatest,
            _ => rng.i128(least..=greatest),
        };
        return whole_value(whole).expect("it has at most 64 bits");
    }
    match primitive {
        PrimitiveType::Bool => Value::from(rng.bool()),
        // All bits are floats: small ones, endless ones, and those that are no numbers.
        PrimitiveType::Float32 => float_value(f64::from(f32::from_bits(rng.u32(..)))),
        _ => float_value(f64::from_bits(rng.u64(..))),
    }
}

/// Returns a copy of a message in the other byte order. The copy is made by a decoder of its own,
/// which walks along the definition and swaps the bytes of each number.
fn swapped(interfaces: &Interfaces, structure: &MessageStructure, bytes: &[u8]) -> Vec<u8> {
    let mut swapped = bytes.to_vec();
    swapped[1] = 0;
    let end = swap_structure(interfaces, structure, &mut swapped[4..], 0);
    assert_eq!(end + 4, swapped.len(), "the walk ends where the message does");
    swapped
}

/// Swaps the number of `size` bytes at the next aligned place, and returns its end and its value.
fn swap(bytes: &mut [u8], at: usize, size: usize) -> (usize, usize) {
    let start = at.div_ceil(size) * size;
    let number = &mut bytes[start..start + size];
    let value = number.iter().rev().fold(0, |value: usize, byte| (value << 8) | *byte as usize);
    number.reverse();
    (start + size, value)
}

fn swap_structure(
    interfaces: &Interfaces,
    structure: &MessageStructure,
    bytes: &mut [u8],
    mut at: usize,
) -> usize {
    for field in &structure.fields {
        let mut length = 1;
        match field.arity {
            FieldArity::One => {}
            FieldArity::Array(size) => length = size as usize,
            _ => (at, length) = swap(bytes, at, 4),
        }
        for _ in 0..length {
            at = match &field.element {
                FieldElement::Primitive(primitive) => swap(bytes, at, primitive.size()).0,
                FieldElement::String(_) => {
                    let (text, length) = swap(bytes, at, 4);
                    text + length
                }
                FieldElement::WideString(_) => {
                    let (units, length) = swap(bytes, at, 4);
                    (0..length).fold(units, |at, _| swap(bytes, at, 4).0)
                }
                FieldElement::Nested(name) => {
                    let structure = interfaces.message(name).expect("the type is known");
                    swap_structure(interfaces, structure, bytes, at)
                }
            };
        }
    }
    if structure.fields.is_empty() { at + 1 } else { at }
}

#[test]
fn random_values_come_back_in_both_byte_orders() {
    let interfaces = interfaces();
    let mut rng = Rng::with_seed(1);
    for name in messages(&interfaces) {
        let structure = interfaces.message(name).expect("the type is known");
        for _ in 0..VALUES {
            let value = random_object(&interfaces, structure, &mut rng);
            let bytes = interfaces.encode(name, &value).expect("the value fits");
            for bytes in [swapped(&interfaces, structure, &bytes), bytes] {
                let decoded = interfaces.decode(name, &bytes).expect("the bytes are valid");
                assert!(decoded.is_complete(), "{name}: {value}");
                assert_eq!(decoded.value, value, "{name}");
            }
        }
    }
}

#[test]
fn random_bytes_are_decoded_or_refused() {
    let interfaces = interfaces();
    let mut rng = Rng::with_seed(2);
    let names = messages(&interfaces);
    let (mut complete, mut prefixes, mut refused) = (0, 0, 0);
    for round in 0..GARBAGE {
        let name = names[round % names.len()];
        let mut bytes: Vec<u8> = (0..rng.usize(..300)).map(|_| rng.u8(..)).collect();
        // Zeros are short lengths, with which decoding goes on.
        let zeros = rng.u8(..100);
        for byte in &mut bytes {
            *byte = if rng.u8(..100) < zeros { 0 } else { *byte };
        }
        bytes.splice(..0, [0, rng.u8(..2), 0, 0]);
        match interfaces.decode(name, &bytes) {
            Ok(decoded) if decoded.is_complete() => {
                complete += 1;
                let again = interfaces.encode(name, &decoded.value);
                // A text from outside may contain NUL, which is not sent.
                if let Ok(again) = again {
                    let again = interfaces.decode(name, &again).expect("the bytes are valid");
                    assert_eq!(again.value, decoded.value, "{name}");
                }
            }
            Ok(_) => prefixes += 1,
            Err(_) => refused += 1,
        }
    }
    let counts = [complete, prefixes, refused];
    assert!(counts.iter().all(|count| *count > GARBAGE / 50), "{counts:?} is lopsided");
}

#[test]
fn valid_messages_with_wrong_bytes_are_decoded_or_refused() {
    let interfaces = interfaces();
    let mut rng = Rng::with_seed(3);
    let names = messages(&interfaces);
    for round in 0..GARBAGE {
        let name = names[round % names.len()];
        let structure = interfaces.message(name).expect("the type is known");
        let value = random_object(&interfaces, structure, &mut rng);
        let mut bytes = interfaces.encode(name, &value).expect("the value fits");
        for _ in 0..=rng.usize(..4) {
            let place = rng.usize(4..bytes.len());
            bytes[place] = rng.choice([0, 1, 127, 128, 255, rng.clone().u8(..)]).unwrap_or(0);
        }
        let _ = interfaces.decode(name, &bytes[..rng.usize(..=bytes.len())]);
    }
}

#[test]
fn random_definitions_are_read_or_refused() {
    let mut rng = Rng::with_seed(4);
    let parts = [
        "uint8",
        "string",
        "wstring",
        "float64",
        "bool",
        "geometry_msgs/Pose",
        " ",
        " ",
        "\t",
        "a",
        "B",
        "=",
        "1",
        "-",
        "0x",
        "<=",
        "[",
        "]",
        "'",
        "\"",
        "\\",
        ",",
        "#",
        "\n",
        "\r\n",
        "---",
        "ü",
        "😀",
        "/",
        "_",
        "3",
        "nan",
        "1e999",
        "99999999999999999999",
    ];
    let mut read = 0;
    for _ in 0..GARBAGE {
        let text: String = (0..rng.usize(..14)).filter_map(|_| rng.choice(parts)).collect();
        for file_name in ["Test.msg", "Test.srv"] {
            let mut interfaces = Interfaces::default();
            match interfaces.add("test_msgs", file_name, &text) {
                Ok(()) => read += 1,
                Err(error) => {
                    let lines = text.lines().count().max(1);
                    let is_placed = |line| (1..=lines).contains(&line);
                    assert!(
                        error.mistakes.iter().all(|at| is_placed(at.line)),
                        "{text:?}: {error}"
                    );
                }
            }
        }
    }
    assert!(read > 1000, "{read} definitions are too few");
}

#[test]
fn every_bit_pattern_of_a_small_number_is_a_value() {
    for bits in 0..=u64::from(u16::MAX) {
        assert!(from_bits(PrimitiveType::Int16, bits).is_some());
        assert_eq!(from_bits(PrimitiveType::Bool, bits).is_some(), bits < 2);
    }
}
