//! The description of a device, in one form for all protocols.

use std::time::Duration;

use crate::template::Template;

/// A device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DescribedDevice {
    /// The name that people gave it.
    pub(crate) name: String,
    /// An identifier that never changes, such as its address.
    pub(crate) id: String,
    /// Its other identifiers.
    pub(crate) other_ids: Vec<String>,
    /// The area that the device states, if any.
    pub(crate) area: Option<String>,
    /// The things that it measures and switches.
    pub(crate) features: Vec<DeviceFeature>,
    /// The things of it that cannot be used.
    pub(crate) unused: Vec<UnusedFeature>,
}

/// A thing of a device that cannot be used, and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct UnusedFeature {
    pub(crate) reason: String,
    /// Whether this is normal. Normal reasons are reported only for devices of which nothing can be used.
    pub(crate) is_usual: bool,
}

/// The rank of a feature that is not about the room but about, for example, a chip or a boiler.
pub(crate) const NOT_OF_THE_ROOM: u8 = 3;

/// One thing that a device measures or switches.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DeviceFeature {
    /// Its device class, as the device calls it.
    pub(crate) class: String,
    /// A label that distinguishes it from others of its class.
    pub(crate) label: String,
    /// The sources of its value. If there are none, the feature is assumed to be as it was last commanded.
    pub(crate) states: Vec<ValueSource>,
    /// The unit of its value; empty if none is stated.
    pub(crate) unit: String,
    /// The texts that mean yes, no, and neither.
    pub(crate) yes: Vec<String>,
    pub(crate) no: Vec<String>,
    pub(crate) neither: Vec<String>,
    /// How it is switched; `None` if it cannot be.
    pub(crate) command: Option<SwitchCommand>,
    /// The topics that tell whether it is online.
    pub(crate) availability: Availability,
    /// How long a value is valid after it was received; `None` if without limit.
    pub(crate) expires: Option<Duration>,
    /// How long a yes is valid after it was received; then the value is no.
    pub(crate) off_delay: Option<Duration>,
    /// The request for its current value; `None` if it cannot be asked.
    pub(crate) value_request: Option<OutgoingMessage>,
    /// Preference among several measured numbers of one class: the lowest is used.
    pub(crate) rank: u8,
}

/// A topic, and how a value is read from its texts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ValueSource {
    pub(crate) topic: String,
    pub(crate) reading: ReadingMethod,
}

/// How a value is read from a text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ReadingMethod {
    /// The whole text.
    Whole,
    /// The value under these keys of a JSON object.
    At(Vec<String>),
    /// The output of a Jinja template, as Home Assistant uses them.
    Template(Template),
}

/// An MQTT message to send: a text for a topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct OutgoingMessage {
    pub(crate) topic: String,
    pub(crate) text: String,
    /// Whether the broker is to retain it.
    pub(crate) is_retained: bool,
}

/// The messages that switch a feature on and off.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SwitchCommand {
    pub(crate) on: OutgoingMessage,
    pub(crate) off: OutgoingMessage,
}

/// The topics that tell whether a feature is online, and how they are combined.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Availability {
    pub(crate) topics: Vec<AvailabilityTopic>,
    pub(crate) mode: AvailabilityMode,
}

/// One topic of availability, with the texts for online and offline.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AvailabilityTopic {
    pub(crate) source: ValueSource,
    pub(crate) online: String,
    pub(crate) offline: String,
    /// Whether the feature counts as online before the first text.
    pub(crate) is_online_at_first: bool,
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

impl DeviceFeature {
    /// Returns a feature with this class and label; everything else is empty.
    pub(crate) fn named(class: &str, label: &str) -> DeviceFeature {
        DeviceFeature {
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
            value_request: None,
            rank: 0,
        }
    }
}

impl UnusedFeature {
    pub(crate) fn because(reason: impl Into<String>) -> UnusedFeature {
        UnusedFeature { reason: reason.into(), is_usual: false }
    }

    pub(crate) fn as_usual(reason: impl Into<String>) -> UnusedFeature {
        UnusedFeature { reason: reason.into(), is_usual: true }
    }
}

impl OutgoingMessage {
    pub(crate) fn new(topic: impl Into<String>, text: impl Into<String>) -> OutgoingMessage {
        OutgoingMessage { topic: topic.into(), text: text.into(), is_retained: false }
    }
}

impl ValueSource {
    /// Returns a source that reads the whole text of a topic.
    pub(crate) fn whole(topic: impl Into<String>) -> ValueSource {
        ValueSource { topic: topic.into(), reading: ReadingMethod::Whole }
    }

    /// Returns a source that reads the value under these keys of a topic's JSON.
    pub(crate) fn at(topic: impl Into<String>, keys: &[&str]) -> ValueSource {
        let keys = keys.iter().map(|key| (*key).to_owned()).collect();
        ValueSource { topic: topic.into(), reading: ReadingMethod::At(keys) }
    }
}
