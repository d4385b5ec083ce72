//! The settings of a device: levels (numbers within bounds), choices (one of several options),
//! triggers (a message with an effect, but without a state), and presses (events that a person
//! causes at the device). `level` divides a level setting into the levels that plans may use.

use serde_json::Value;

use crate::message::OutgoingMessage;
use crate::template::Template;

/// Maximum number of options of one choice, and of presses of one device; further ones are left
/// out, because each is an object of the planning problem.
pub(crate) const OPTIONS_MAX: usize = 64;

/// A property of a device that is set, or that a person presses.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum DeviceSetting {
    /// A number within bounds.
    Level(LevelSetting),
    /// One of several options, each with the message that chooses it.
    Choice(Vec<(String, OutgoingMessage)>),
    /// The message that triggers something without a state, such as a scene.
    Trigger(OutgoingMessage),
    /// The texts that the device sends when a person presses something.
    Press(Vec<PressText>),
}

/// A text that a device sends when a person presses something.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PressText {
    /// Name of the press, in the words of the device.
    pub(crate) name: String,
    pub(crate) text: String,
    /// Index of the only source of the feature with this text; `None` if all have it.
    pub(crate) source: Option<usize>,
}

/// A number within bounds that a message sets.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LevelSetting {
    /// Bounds of the number, in the device's own scale.
    pub(crate) min: f64,
    pub(crate) max: f64,
    /// Distance of two numbers that the device distinguishes. Without a usable step, all numbers
    /// are distinguished.
    pub(crate) step: Option<f64>,
    pub(crate) scale: NumberScale,
    pub(crate) message: NumberMessage,
    /// Message that ends a movement to the number; `None` if nothing moves, or if the device
    /// cannot be stopped.
    pub(crate) stop: Option<OutgoingMessage>,
    /// Whether the message also switches the thing on. Otherwise a thing that is off is switched
    /// on by a message of its own.
    pub(crate) switches_on: bool,
}

/// Conversion of a device's own numbers to the unit of the device class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NumberScale {
    /// Numbers in the unit of the feature.
    Unit,
    /// Numbers between those for 0 % and for 100 %.
    Percent { zero: f64, full: f64 },
    /// Color temperatures in mireds; the class is in kelvins.
    Mired,
}

/// A message that sets a number.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NumberMessage {
    pub(crate) topic: String,
    pub(crate) text: NumberText,
    /// Whether the broker should retain the message.
    pub(crate) is_retained: bool,
}

/// The text of a message that sets a number.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum NumberText {
    /// The number alone.
    Plain,
    /// JSON with the number at the place of this JSON pointer.
    Json { body: Value, pointer: String },
    /// The output of a Jinja template with these variables.
    Template { template: Template, variables: Vec<(String, TemplateVariable)> },
}

/// The value of a variable in the template of a command.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TemplateVariable {
    /// The number, in the device's own scale.
    Own,
    /// The number in percents, between those for 0 % and for 100 %.
    Percent {
        zero: f64,
        full: f64,
    },
    Constant(String),
}

impl LevelSetting {
    /// Returns a setting of percents from 0 to 100.
    pub(crate) fn percent(message: NumberMessage) -> LevelSetting {
        LevelSetting {
            min: 0.0,
            max: 100.0,
            step: Some(1.0),
            scale: NumberScale::Percent { zero: 0.0, full: 100.0 },
            message,
            stop: None,
            switches_on: false,
        }
    }
}

impl PressText {
    /// Returns a press that is named by its text.
    pub(crate) fn named(text: &str) -> PressText {
        PressText { name: text.to_owned(), text: text.to_owned(), source: None }
    }
}

impl NumberMessage {
    pub(crate) fn plain(topic: impl Into<String>) -> NumberMessage {
        NumberMessage { topic: topic.into(), text: NumberText::Plain, is_retained: false }
    }

    /// Returns a message with the number at the place of a JSON pointer in `body`.
    pub(crate) fn json(topic: impl Into<String>, body: Value, pointer: &str) -> NumberMessage {
        let text = NumberText::Json { body, pointer: pointer.to_owned() };
        NumberMessage { topic: topic.into(), text, is_retained: false }
    }

    /// Returns the message that sets `number`, in the device's own scale.
    ///
    /// # Errors
    ///
    /// Returns an error if the template cannot be rendered or gives no text.
    pub(crate) fn with(&self, number: f64) -> Result<OutgoingMessage, String> {
        let text = match &self.text {
            NumberText::Plain => plain(number),
            NumberText::Json { body, pointer } => {
                let mut body = body.clone();
                if let Some(place) = body.pointer_mut(pointer) {
                    *place = json_number(number);
                }
                body.to_string()
            }
            NumberText::Template { template, variables } => {
                let variables: Vec<_> = { variables.iter() }
                    .map(|(name, variable)| (name.as_str(), variable.value(number)))
                    .collect();
                template.render(&variables).map_err(|unrendered| unrendered.0)?
            }
        };
        if text.is_empty() {
            return Err("its command template gives no text".to_owned());
        }
        Ok(OutgoingMessage { topic: self.topic.clone(), text, is_retained: self.is_retained })
    }
}

impl TemplateVariable {
    fn value(&self, number: f64) -> minijinja::Value {
        let number = match self {
            TemplateVariable::Own => number,
            TemplateVariable::Percent { zero, full } => {
                let percent = (number - zero) / (full - zero) * 100.0;
                percent.round()
            }
            TemplateVariable::Constant(text) => return minijinja::Value::from(text.as_str()),
        };
        whole(number).map_or_else(|| minijinja::Value::from(number), minijinja::Value::from)
    }
}

impl DeviceSetting {
    /// Returns a topic that the setting's messages are sent to; `None` if none is sent.
    pub(crate) fn topic(&self) -> Option<&str> {
        match self {
            DeviceSetting::Level(level) => Some(&level.message.topic),
            DeviceSetting::Choice(options) => {
                options.first().map(|(_, message)| message.topic.as_str())
            }
            DeviceSetting::Trigger(message) => Some(&message.topic),
            DeviceSetting::Press(_) => None,
        }
    }

    /// Makes the broker retain the messages that set a value. The message of a trigger is never
    /// retained, because a retained one would trigger again after each connect of the device.
    pub(crate) fn retain(&mut self) {
        match self {
            DeviceSetting::Level(level) => level.message.is_retained = true,
            DeviceSetting::Choice(options) => {
                options.iter_mut().for_each(|(_, message)| message.is_retained = true);
            }
            DeviceSetting::Trigger(_) | DeviceSetting::Press(_) => (),
        }
    }
}

/// Returns a number without a decimal point if it is whole.
fn whole(number: f64) -> Option<i64> {
    /// Largest number up to which every whole number has an exact representation.
    const EXACT_MAX: f64 = 9e15;
    #[allow(clippy::cast_possible_truncation, reason = "the number is whole and small enough")]
    let whole = number as i64;
    (number.fract() == 0.0 && number.abs() < EXACT_MAX).then_some(whole)
}

fn plain(number: f64) -> String {
    whole(number).map_or_else(|| number.to_string(), |whole| whole.to_string())
}

fn json_number(number: f64) -> Value {
    whole(number).map_or_else(|| Value::from(number), Value::from)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_are_sent_as_the_device_expects_them() {
        let template = Template::new("{{ (value * 10) | int }}", &["value"]).expect("it is right");
        let variables = vec![("value".to_owned(), TemplateVariable::Own)];
        let by_template = NumberText::Template { template, variables };
        for (text, number, expected) in [
            (NumberText::Plain, 50.0, "50"),
            (NumberText::Plain, 21.5, "21.5"),
            (NumberText::Plain, -5.0, "-5"),
            (by_template, 21.5, "215"),
        ] {
            let message = NumberMessage { topic: "t".to_owned(), text, is_retained: false };
            assert_eq!(message.with(number).expect("a text").text, expected);
        }
        let body = json!({ "id": 1, "params": { "pos": null } });
        let message = NumberMessage::json("t", body, "/params/pos");
        assert_eq!(message.with(50.0).expect("a text").text, r#"{"id":1,"params":{"pos":50}}"#);
    }
}
