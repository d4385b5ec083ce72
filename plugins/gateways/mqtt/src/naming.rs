//! Builds names of agents from device names in any script, and compares the names of rooms.

use any_ascii::any_ascii;

/// Maximum length of a name that is built here, in bytes; the end of a longer one is cut off.
const CHARS_MAX: usize = 48;

/// Returns a valid name of an agent for a device name: `Living Room / Lamp 1` gives
/// `living-room-lamp-1`, `Küche` gives `kueche`, `Спальня` gives `spalnya`.
pub(crate) fn name_of(text: &str) -> String {
    let mut name = slug(text, "-");
    name.truncate(CHARS_MAX);
    let name = name.trim_end_matches('-');
    match name.chars().next() {
        Some(first) if first.is_ascii_lowercase() => name.to_owned(),
        Some(_) => format!("device-{name}"),
        None => "device".to_owned(),
    }
}

/// Returns a text in lower-case ASCII letters and digits, with `separator` between words.
pub(crate) fn slug(text: &str, separator: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    let mut is_open = false;
    // In a script without spaces, `any_ascii` converts each letter to a word of its own.
    for c in text.chars() {
        let written = written(c);
        for c in written.chars() {
            match c.is_ascii_alphanumeric() {
                true if is_open => {
                    if let Some(word) = words.last_mut() {
                        word.push(c);
                    }
                }
                true => words.push(c.to_string()),
                // An apostrophe is part of a word, either as a soft sign or from the text itself.
                false if matches!(c, '\'' | '’' | '`') => continue,
                false => (),
            }
            is_open = c.is_ascii_alphanumeric();
        }
    }
    words.join(separator)
}

fn written(c: char) -> String {
    match c {
        'ä' | 'Ä' => "ae".to_owned(),
        'ö' | 'Ö' => "oe".to_owned(),
        'ü' | 'Ü' => "ue".to_owned(),
        c => any_ascii(c.encode_utf8(&mut [0; 4])).to_lowercase(),
    }
}

/// Returns the normalised name of a room for comparisons: `Office 1` and `office1` have the same
/// one.
pub(crate) fn core(text: &str) -> String {
    slug(text, "")
}

/// Whether the device name `name` begins with the name of a room. The room's name must end at the
/// end of a word, so that `Office 10 sensor` is not in `office1`, and `Hallway lamp` is not in
/// `hall`.
pub(crate) fn begins_with(name: &str, room: &str) -> bool {
    let room = core(room);
    if room.is_empty() {
        return false;
    }
    let mut so_far = String::new();
    for word in slug(&apart(name), " ").split(' ') {
        so_far.push_str(word);
        if so_far == room {
            return true;
        }
        if so_far.len() >= room.len() {
            return false;
        }
    }
    false
}

/// Separates words in camel case: `KitchenLamp` and `Office1Lamp` become two words, while `office1`
/// stays one word.
fn apart(name: &str) -> String {
    let mut apart = String::new();
    let mut before = None::<char>;
    for c in name.chars() {
        let is_next = before.is_some_and(|before| {
            c.is_uppercase() && (before.is_lowercase() || before.is_ascii_digit())
        });
        if is_next {
            apart.push(' ');
        }
        apart.push(c);
        before = Some(c);
    }
    apart
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_text_gives_a_valid_name() {
        for (text, expected) in [
            ("Living Room / Lamp 1", "living-room-lamp-1"),
            ("0x00158d0001a2b3c4", "device-0x00158d0001a2b3c4"),
            ("Küche", "kueche"),
            ("KÜCHE Groß", "kueche-gross"),
            ("Ångström", "angstroem"),
            ("Спальня", "spalnya"),
            ("Объект 2", "obekt-2"),
            ("温度計", "wenduji"),
            ("거실 온도", "geosil-ondo"),
            ("étage 1", "etage-1"),
            ("e\u{301}tage", "etage"),
            ("Σαλόνι", "saloni"),
            ("///", "device"),
            ("", "device"),
            ("\u{202e}\u{0}\n", "device"),
        ] {
            let name = name_of(text);
            assert_eq!(name, expected, "{text}");
            assert!(acl::AgentId::new(&name).is_ok());
        }
        assert!(acl::AgentId::new(&name_of(&"x ".repeat(200))).is_ok());
        assert_eq!(core("Office 1"), core("office1"));
    }

    #[test]
    fn the_name_of_a_room_is_matched_by_whole_words() {
        for (name, room, expected) in [
            ("Office 1 sensor", "office1", true),
            ("office1/thermo", "office1", true),
            ("Office 10 sensor", "office1", false),
            ("Office 12 lamp", "office1", false),
            ("office10-lamp", "office1", false),
            ("Bathroom fan", "bath", false),
            ("Bath fan", "bath", true),
            ("Hallway lamp", "hall", false),
            ("hall", "hall", true),
            ("HallLamp", "hall", true),
            ("Office1Lamp", "office1", true),
            ("office_1_lamp", "office1", true),
            ("conf-room door", "conf-room", true),
            ("confroom door", "conf-room", true),
            ("conference door", "conf", false),
            ("Küche Lampe", "kueche", true),
            ("Кухня лампа", "кухня", true),
            ("x", "office1", false),
            ("", "office1", false),
            ("office1", "", false),
        ] {
            assert_eq!(begins_with(name, room), expected, "{name} {room}");
        }
    }
}
