//! The description of a device, in one form for all protocols.

use std::time::Duration;

use crate::template::Template;

/// A device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Described {
    /// The name that people gave it.
    pub(crate) name: String,
    /// An identifier that never changes, such as its address.
    pub(crate) id: String,
    /// Its other identifiers.
    pub(crate) also: Vec<String>,
    /// The area that the device states, if any.
    pub(crate) area: Option<String>,
    /// The things that it measures and switches.
    pub(crate) features: Vec<Feature>,
    /// The things of it that cannot be used.
    pub(crate) unused: Vec<Unused>,
}

/// A thing of a device that cannot be used, and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Unused {
    pub(crate) reason: String,
    /// Whether this is normal. Normal reasons are reported only for devices of which nothing can be used.
    pub(crate) is_usual: bool,
}

/// The rank of a feature that is not about the room but about, for example, a chip or a boiler.
pub(crate) const NOT_OF_THE_ROOM: u8 = 3;

/// One thing that a device measures or switches.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Feature {
    /// Its device class, as the device calls it.
    pub(crate) class: String,
    /// A label that distinguishes it from others of its class.
    pub(crate) label: String,
    /// The sources of its value. If there are none, the feature is assumed to be as it was last commanded.
    pub(crate) states: Vec<Source>,
    /// The unit of its value; empty if none is stated.
    pub(crate) unit: String,
    /// The texts that mean yes, no, and neither.
    pub(crate) yes: Vec<String>,
    pub(crate) no: Vec<String>,
    pub(crate) neither: Vec<String>,
    /// How it is switched; `None` if it cannot be.
    pub(crate) command: Option<Command>,
    /// The topics that tell whether it is online.
    pub(crate) availability: Availability,
    /// How long a value is valid after it was received; `None` if without limit.
    pub(crate) expires: Option<Duration>,
    /// How long a yes is valid after it was received; then the value is no.
    pub(crate) off_delay: Option<Duration>,
    /// The request for its current value; `None` if it cannot be asked.
    pub(crate) ask: Option<Telegram>,
    /// Preference among several measured numbers of one class: the lowest is used.
    pub(crate) rank: u8,
}

/// A topic, and how a value is read from its texts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Source {
    pub(crate) topic: String,
    pub(crate) reading: Reading,
}

/// How a value is read from a text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Reading {
    /// The whole text.
    Whole,
    /// The value under these keys of a JSON object.
    At(Vec<String>),
    /// The output of a Jinja template, as Home Assistant uses them.
    Template(Template),
}

/// An MQTT message to send: a text for a topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Telegram {
    pub(crate) topic: String,
    pub(crate) text: String,
    /// Whether the broker is to retain it.
    pub(crate) is_kept: bool,
}

/// The messages that switch a feature on and off.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Command {
    pub(crate) on: Telegram,
    pub(crate) off: Telegram,
}

/// The topics that tell whether a feature is online, and how they are combined.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Availability {
    pub(crate) voices: Vec<Voice>,
    pub(crate) mode: AvailabilityMode,
}

/// One topic of availability, with the texts for online and offline.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Voice {
    pub(crate) source: Source,
    pub(crate) online: String,
    pub(crate) offline: String,
    /// Whether the feature counts as online before the first text.
    pub(crate) at_first: bool,
}

/// How several topics of availability are combined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum AvailabilityMode {
    All,
    Any,
    /// The last text on any of them counts.
    #[default]
    Latest,
}

impl Feature {
    /// Returns a feature with this class and label; everything else is empty.
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
    /// Returns a source that reads the whole text of a topic.
    pub(crate) fn whole(topic: impl Into<String>) -> Source {
        Source { topic: topic.into(), reading: Reading::Whole }
    }

    /// Returns a source that reads the value under these keys of a topic's JSON.
    pub(crate) fn at(topic: impl Into<String>, keys: &[&str]) -> Source {
        let keys = keys.iter().map(|key| (*key).to_owned()).collect();
        Source { topic: topic.into(), reading: Reading::At(keys) }
    }
}
