//! A device as it describes itself, whatever it speaks.

use std::time::Duration;

use crate::template::Template;

/// A device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Described {
    /// What it is called by people.
    pub(crate) name: String,
    /// What it never changes: an address, an identifier.
    pub(crate) id: String,
    /// Its other identifiers.
    pub(crate) also: Vec<String>,
    /// Where it stands, as far as it says.
    pub(crate) area: Option<String>,
    /// What it measures and switches.
    pub(crate) features: Vec<Feature>,
    /// What of it cannot be used.
    pub(crate) unused: Vec<Unused>,
}

/// Something of a device that cannot be used, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Unused {
    pub(crate) reason: String,
    /// Whether that is as it should be, so that it is told only of devices of which nothing is used.
    pub(crate) is_usual: bool,
}

/// The rank of what is about something else than the room, such as a chip or a boiler.
pub(crate) const NOT_OF_THE_ROOM: u8 = 3;

/// Something that a device measures or switches.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Feature {
    /// What it calls it: a device class.
    pub(crate) class: String,
    /// What tells it from others of its class.
    pub(crate) label: String,
    /// Where it says how it is; what has none is believed to be as it was told.
    pub(crate) states: Vec<Source>,
    /// In which unit.
    pub(crate) unit: String,
    /// The words that it says for yes, for no, and for what it does not know.
    pub(crate) yes: Vec<String>,
    pub(crate) no: Vec<String>,
    pub(crate) neither: Vec<String>,
    /// How it is switched.
    pub(crate) command: Option<Command>,
    /// Where it is said whether it is online.
    pub(crate) availability: Availability,
    /// How long a value holds after it was said.
    pub(crate) expires: Option<Duration>,
    /// How long a yes holds after it was said; then it is no.
    pub(crate) off_delay: Option<Duration>,
    /// How it is asked how it is.
    pub(crate) ask: Option<Telegram>,
    /// Of several features of one class, that with the lowest speaks for the device.
    pub(crate) rank: u8,
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
    Template(Template),
}

/// A text for a topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Telegram {
    pub(crate) topic: String,
    pub(crate) text: String,
    /// Whether the broker is to keep it.
    pub(crate) is_kept: bool,
}

/// How something is switched.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Command {
    pub(crate) on: Telegram,
    pub(crate) off: Telegram,
}

/// Where it is said whether something is online.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Availability {
    pub(crate) voices: Vec<Voice>,
    pub(crate) mode: AvailabilityMode,
}

/// One topic of availability.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Voice {
    pub(crate) source: Source,
    pub(crate) online: String,
    pub(crate) offline: String,
    /// Whether it is online before anything is said.
    pub(crate) at_first: bool,
}

/// What several topics of availability mean together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum AvailabilityMode {
    All,
    Any,
    /// The last word on any of them counts.
    #[default]
    Latest,
}

impl Feature {
    /// One of which only the class and the label are known.
    pub(crate) fn named(class: &str, label: &str) -> Feature {
        Feature {
            class: class.to_owned(),
            label: label.to_owned(),
            states: Vec::new(),
            unit: String::new(),
            yes: Vec::new(),
            no: Vec::new(),
            neither: Vec::new(),
            command: None,
            availability: Availability::default(),
            expires: None,
            off_delay: None,
            ask: None,
            rank: 0,
        }
    }
}

impl Unused {
    pub(crate) fn because(reason: impl Into<String>) -> Unused {
        Unused { reason: reason.into(), is_usual: false }
    }

    pub(crate) fn as_usual(reason: impl Into<String>) -> Unused {
        Unused { reason: reason.into(), is_usual: true }
    }
}

impl Telegram {
    pub(crate) fn new(topic: impl Into<String>, text: impl Into<String>) -> Telegram {
        Telegram { topic: topic.into(), text: text.into(), is_kept: false }
    }
}

impl Source {
    /// All of what is said under a topic.
    pub(crate) fn whole(topic: impl Into<String>) -> Source {
        Source { topic: topic.into(), reading: Reading::Whole }
    }

    /// What stands by these keys in what is said under a topic.
    pub(crate) fn at(topic: impl Into<String>, keys: &[&str]) -> Source {
        let keys = keys.iter().map(|key| (*key).to_owned()).collect();
        Source { topic: topic.into(), reading: Reading::At(keys) }
    }
}
