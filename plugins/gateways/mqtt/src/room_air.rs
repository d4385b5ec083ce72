//! Decides whether a value is about the air of a room, or about a thing in it: a chip, a boiler, a
//! fridge, a set point. The decision is based on the names that people and makers choose.

use crate::description::NOT_OF_THE_ROOM;
use crate::naming::slug;

/// Words in a feature's name which show that the feature is not about the air of the room. The
/// plural of a word counts as well.
const NOT_THE_ROOM: &[&str] = &[
    "apparent",
    "aquarium",
    "battery",
    "board",
    "boiler",
    "chip",
    "coil",
    "compost",
    "compressor",
    "condenser",
    "cpu",
    "device",
    "dew",
    "dhw",
    "engine",
    "esp",
    "esp32",
    "evaporator",
    "exhaust",
    "external",
    "floor",
    "flow",
    "forecast",
    "freezer",
    "fridge",
    "grill",
    "heatsink",
    "hot",
    "inlet",
    "internal",
    "inverter",
    "kettle",
    "kiln",
    "liquid",
    "mcu",
    "motor",
    "object",
    "oil",
    "outdoor",
    "outlet",
    "outside",
    "oven",
    "pcb",
    "pipe",
    "pond",
    "pool",
    "probe",
    "processor",
    "refrigerator",
    "return",
    "setpoint",
    "setting",
    "smoker",
    "soc",
    "soil",
    "stove",
    "supply",
    "tank",
    "target",
    "terrarium",
    "threshold",
    "water",
    "weather",
    "wifi",
];

/// Pairs of successive words which show that a name is not about the air of the room.
const NOT_THE_ROOM_PAIRS: &[(&str, &str)] = &[
    ("feels", "like"),
    ("heat", "index"),
    ("set", "humidity"),
    ("set", "point"),
    ("set", "temp"),
    ("set", "temperature"),
    ("wind", "chill"),
];

/// Words of [`NOT_THE_ROOM`] that are ignored in an identifier, because an identifier may contain
/// the name of a board or a chip.
const OF_IDENTIFIERS: &[&str] = &["board", "device", "esp", "esp32", "external", "internal"];

/// Things with air of their own, or without air. Every number from a device with such a name is
/// about the thing, because people name a thermometer after the thing that it is in.
const THINGS: &[&str] = &[
    "aquarium",
    "boiler",
    "compost",
    "freezer",
    "fridge",
    "grill",
    "kettle",
    "kiln",
    "oven",
    "pond",
    "pool",
    "refrigerator",
    "smoker",
    "soil",
    "stove",
    "tank",
    "terrarium",
];

/// Words after a thing that make it the name of a room, as in `boiler room`.
const ROOMS: &[&str] = &["room", "house", "hall"];

/// Words that make a `floor` a storey, as in `ground floor`.
const STOREYS: &[&str] = &[
    "basement", "bottom", "fifth", "first", "fourth", "ground", "lower", "main", "second", "third",
    "top", "upper",
];

/// Returns the rank of a sensor by its name, or by its identifier if it has no name. The higher the
/// rank, the less likely the sensor is about the air of the room.
pub(crate) fn rank(label: &str, name: Option<&str>) -> u8 {
    let of_label = telling_words(label, NOT_THE_ROOM, NOT_THE_ROOM_PAIRS);
    let says_so = match name {
        Some(name) => !telling_words(name, NOT_THE_ROOM, NOT_THE_ROOM_PAIRS).is_empty(),
        None => of_label.iter().any(|word| !OF_IDENTIFIERS.contains(&word.as_str())),
    };
    match (says_so, of_label.is_empty()) {
        (true, _) => NOT_OF_THE_ROOM,
        (false, false) => 2,
        (false, true) => 0,
    }
}

/// Whether a device is in a thing with air of its own, such as a fridge, according to the device's
/// name.
pub(crate) fn is_in_a_thing(device: &str) -> bool {
    !telling_words(device, THINGS, &[]).is_empty()
}

/// Returns the words of a text that are in the list, or are the first word of one of the pairs.
fn telling_words(text: &str, list: &[&str], pairs: &[(&str, &str)]) -> Vec<String> {
    let text = slug(text, " ");
    let words: Vec<&str> = text.split(' ').filter(|word| !word.is_empty()).collect();
    let is_in = |word: &str| list.contains(&word);
    let is_telling = |at: &usize| {
        let word = words[*at];
        let next = words.get(at + 1).copied().unwrap_or_default();
        let before = at.checked_sub(1).and_then(|before| words.get(before)).copied();
        if pairs.contains(&(word, next)) {
            return true;
        }
        if !is_in(word) && !word.strip_suffix('s').is_some_and(is_in) {
            return false;
        }
        let is_number = |word: &str| word.starts_with(|symbol: char| symbol.is_ascii_digit());
        let is_storey = word == "floor"
            && (is_number(next)
                || before.is_some_and(|before| is_number(before) || STOREYS.contains(&before)));
        !is_storey && !ROOMS.contains(&next)
    };
    (0..words.len()).filter(is_telling).map(|at| words[at].to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_show_whether_a_value_is_about_the_room() {
        for (name, is_of_the_room) in [
            ("Temperature", true),
            ("Room temperature", true),
            ("Set point temperature", false),
            ("Setpoint", false),
            ("set_temperature", false),
            ("Fridge", false),
            ("Freezer 2", false),
            ("Oven", false),
            ("Soil temperature", false),
            ("Pool", false),
            ("Floor", false),
            ("Ground floor", true),
            ("2nd floor temperature", true),
            ("Floor 2", true),
            ("Boiler room", true),
            ("Pipes", false),
            ("Hot water tank", false),
            ("Coil", false),
            ("Exhaust", false),
            ("Feels like", false),
            ("Outdoors", false),
            ("Reset", true),
        ] {
            assert_eq!(rank("x", Some(name)) < NOT_OF_THE_ROOM, is_of_the_room, "{name}");
        }
        for (device, is_in) in [
            ("Fridge", true),
            ("office1/freezer", true),
            ("Pool room", false),
            ("ESP32 office", false),
            ("Outlet 3", false),
            ("Upper floor", false),
        ] {
            assert_eq!(is_in_a_thing(device), is_in, "{device}");
        }
    }
}
