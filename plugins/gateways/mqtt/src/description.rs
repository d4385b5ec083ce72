//! The description of a device, in one form for all discovery protocols.

use std::time::Duration;

pub(crate) use crate::message::OutgoingMessage;
use crate::setting::DeviceSetting;
use crate::template::Template;

/// A device, as described by its own messages.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DescribedDevice {
    /// Name of the device that people have chosen.
    pub(crate) name: String,
    /// Permanent identifier of the device, such as its address.
    pub(crate) id: String,
    /// Other identifiers of the device.
    pub(crate) other_ids: Vec<String>,
    /// Area of the device according to its messages; `None` if they contain none.
    pub(crate) area: Option<String>,
    /// Usable features of the device: the quantities that it measures and the things that it
    /// switches.
    pub(crate) features: Vec<DeviceFeature>,
    /// Features of the device that cannot be used.
    pub(crate) unused: Vec<UnusedFeature>,
}

/// A feature of a device that cannot be used, and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct UnusedFeature {
    pub(crate) reason: String,
    /// Whether the reason is an ordinary one. Ordinary reasons are reported only for devices
    /// without any usable feature.
    pub(crate) is_usual: bool,
}

/// Rank of a feature that is not about the air of the room, but for example about a chip or a
/// boiler.
pub(crate) const NOT_OF_THE_ROOM: u8 = 3;

/// One thing that a device measures or switches.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DeviceFeature {
    /// Device class of the feature, by the name that the device uses.
    pub(crate) class: String,
    /// Label that distinguishes the feature from other features of its class.
    pub(crate) label: String,
    /// Sources of the feature's value. Without a source, the value is assumed to be the last
    /// commanded one.
    pub(crate) states: Vec<ValueSource>,
    /// Unit of the feature's value; empty if the device reports no unit.
    pub(crate) unit: String,
    /// Texts that mean yes, no, and neither.
    pub(crate) yes: Vec<String>,
    pub(crate) no: Vec<String>,
    pub(crate) neither: Vec<String>,
    /// Messages that switch the feature; `None` if it cannot be switched.
    pub(crate) command: Option<SwitchCommand>,
    /// Topics that report whether the feature is online.
    pub(crate) availability: Availability,
    /// Time for which a value is valid after it was received; `None` for an unlimited time.
    pub(crate) expires: Option<Duration>,
    /// Time for which a yes is valid after it was received; afterwards the value is no. `None` for
    /// an unlimited time.
    pub(crate) off_delay: Option<Duration>,
    /// Message that requests the current value; `None` if the device does not support such a
    /// request.
    pub(crate) value_request: Option<OutgoingMessage>,
    /// Name of the thing that the feature is a property of: one lamp, with its brightness and its
    /// color. All features of a thing belong to one agent. `None` if the feature is a thing of its
    /// own.
    pub(crate) thing: Option<String>,
    /// The setting of a feature that is set, triggered or pressed; `None` for any other.
    pub(crate) setting: Option<DeviceSetting>,
    /// Rank of the feature among the measured numbers of one class in the device. The feature with
    /// the lowest rank is used.
    pub(crate) rank: u8,
}

/// A topic, and the method of reading a value from the texts of the topic.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ValueSource {
    pub(crate) topic: String,
    pub(crate) reading: ReadingMethod,
}

/// Method of reading a value from a text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ReadingMethod {
    /// The whole text is the value.
    Whole,
    /// The value is at this path of keys in a JSON object, each key one level further down.
    At(Vec<String>),
    /// The value is the name of the color at this path of keys in a JSON object.
    Color(Vec<String>),
    /// The value is the output of a Jinja template, as in Home Assistant.
    Template(Template),
}

/// The messages that switch a feature on and off.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SwitchCommand {
    pub(crate) on: OutgoingMessage,
    pub(crate) off: OutgoingMessage,
}

/// The topics that report whether a feature is online, and the combination of these topics.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Availability {
    pub(crate) topics: Vec<AvailabilityTopic>,
    pub(crate) mode: AvailabilityMode,
}

/// A topic that reports whether a feature is online, with its texts for online and offline.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AvailabilityTopic {
    pub(crate) source: ValueSource,
    pub(crate) online: String,
    pub(crate) offline: String,
    /// Whether the feature counts as online before the first text is received.
    pub(crate) is_online_at_first: bool,
}

/// Method of combining several topics of availability into one result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum AvailabilityMode {
    All,
    Any,
    /// The result is that of the last text received on any of the topics.
    #[default]
    Latest,
}

impl DeviceFeature {
    /// Returns a feature with this class and label, and with all other fields empty.
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
            thing: None,
            setting: None,
            rank: 0,
        }
    }
}

impl DeviceFeature {
    /// Returns a topic that commands for the feature are sent to; `None` if it takes none.
    pub(crate) fn command_topic(&self) -> Option<&str> {
        let of_switch = self.command.as_ref().map(|command| command.on.topic.as_str());
        of_switch.or_else(|| self.setting.as_ref()?.topic())
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

impl ValueSource {
    /// Returns a source that reads the whole text of a topic.
    pub(crate) fn whole(topic: impl Into<String>) -> ValueSource {
        ValueSource { topic: topic.into(), reading: ReadingMethod::Whole }
    }

    /// Returns a source that reads the value at this path of keys in a topic's JSON.
    pub(crate) fn at(topic: impl Into<String>, keys: &[&str]) -> ValueSource {
        let keys = keys.iter().map(|key| (*key).to_owned()).collect();
        ValueSource { topic: topic.into(), reading: ReadingMethod::At(keys) }
    }
}
