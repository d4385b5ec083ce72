//! A device as it describes itself, whatever it speaks.

/// A device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Described {
    /// What it is called by people.
    pub(crate) name: String,
    /// What it never changes: an address, an identifier.
    pub(crate) id: String,
    /// Where it stands, as far as it says.
    pub(crate) area: Option<String>,
    /// What it measures and switches.
    pub(crate) features: Vec<Feature>,
    /// Where it is said whether it is online; nothing said is online.
    pub(crate) availability: Vec<Availability>,
    /// Whether one of those is enough.
    pub(crate) any_is_enough: bool,
}

/// Something that it measures or switches.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Feature {
    /// What it calls it: a device class.
    pub(crate) class: String,
    /// What tells it from others of its class.
    pub(crate) label: String,
    /// Where it says how it is; what has none is believed to be as it was told.
    pub(crate) state: Option<Source>,
    /// In which unit.
    pub(crate) unit: String,
    /// What it says for yes and no.
    pub(crate) yes: String,
    pub(crate) no: String,
    /// How it is switched.
    pub(crate) command: Option<Command>,
}

/// Where something is said, and how it is read there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Source {
    pub(crate) topic: String,
    pub(crate) reading: Reading,
}

/// How a value is read from a text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Reading {
    /// It is all of it.
    Whole,
    /// It stands in a JSON object, by these keys.
    At(Vec<String>),
    /// By a template of Jinja's, as Home Assistant has them.
    Template(String),
}

/// How something is switched.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Command {
    pub(crate) topic: String,
    pub(crate) on: String,
    pub(crate) off: String,
}

/// Where it is said whether a device is online.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Availability {
    pub(crate) source: Source,
    pub(crate) offline: String,
}

/// A name that agents can have: `Living Room / Lamp 1` is `living-room-lamp-1`.
pub(crate) fn name_of(text: &str) -> String {
    let mut name = String::new();
    for c in text.chars().flat_map(char::to_lowercase) {
        match c {
            'ä' => name.push_str("ae"),
            'ö' => name.push_str("oe"),
            'ü' => name.push_str("ue"),
            'ß' => name.push_str("ss"),
            c if c.is_ascii_alphanumeric() => name.push(c),
            _ if name.is_empty() || name.ends_with('-') => (),
            _ => name.push('-'),
        }
    }
    name.truncate(48);
    let name = name.trim_end_matches('-');
    match name.chars().next() {
        Some(first) if first.is_ascii_lowercase() => name.to_owned(),
        Some(_) => format!("device-{name}"),
        None => "device".to_owned(),
    }
}

/// What of a text is left for comparing names of rooms: `Office 1` and `office1` are one.
pub(crate) fn core(text: &str) -> String {
    name_of(text).chars().filter(|c| *c != '-').collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_text_gives_a_name() {
        for (text, expected) in [
            ("Living Room / Lamp 1", "living-room-lamp-1"),
            ("0x00158d0001a2b3c4", "device-0x00158d0001a2b3c4"),
            ("Küche", "kueche"),
            ("///", "device"),
            ("", "device"),
            ("温度計", "device"),
        ] {
            let name = name_of(text);
            assert_eq!(name, expected);
            assert!(acl::AgentId::new(&name).is_ok());
        }
        assert!(acl::AgentId::new(&name_of(&"x ".repeat(200))).is_ok());
        assert_eq!(core("Office 1"), core("office1"));
    }
}
