//! Reads the texts of a device as values of its features, and writes values as PDDL facts and as
//! text for people.

use serde_json::Value;

use actuator::is_possible_value;

use crate::device_class::ClassKind;
use crate::feature_tracker::{ObservedValue, TextContent};
use crate::level::is_possible_level;
use crate::part::ClassifiedFeature;
use crate::text_reading::ReadOutcome;

/// Maximum number of characters of a device's text in a message to people.
const TOLD_CHARS_MAX: usize = 40;

impl ClassifiedFeature {
    /// Returns the content of `text` according to the feature's source with the number `source`;
    /// `None` if the text has no value of the feature.
    pub(crate) fn read(&self, source: usize, text: &str) -> Option<TextContent> {
        let from = self.feature.states.get(source)?;
        let kind = self.class.kind()?;
        let is_number = matches!(kind, ClassKind::Number { .. } | ClassKind::Level { .. });
        let said = match from.read(text) {
            ReadOutcome::Text(said) => said,
            ReadOutcome::Unknown if self.is_word(text) => text.trim().to_owned(),
            // A device whose button was released reports an empty text; the press still counts.
            ReadOutcome::Unknown if self.is_press() => return None,
            ReadOutcome::Unknown => {
                return Some(TextContent::NotKnown(
                    "it reports that the value is unknown".to_owned(),
                ));
            }
            ReadOutcome::Nothing => return None,
            // Like Home Assistant, uses the text itself if it is one of the expected texts.
            ReadOutcome::Unread(_) if !is_number && self.is_word(text) => text.trim().to_owned(),
            ReadOutcome::Unread(problem) => {
                tracing::debug!(topic = from.topic, "{problem}");
                return None;
            }
        };
        match kind {
            ClassKind::Number { unit, .. } => Some(self.number(&said, unit)),
            ClassKind::Level { unit, .. } => Some(self.level(&said, unit)),
            ClassKind::Choice { .. } => Some(self.option(source, &said).unwrap_or_else(|| {
                let problem = format!("it reports `{}`, which is no option", shortened(&said));
                TextContent::NotKnown(problem)
            })),
            ClassKind::Press { .. } => self.option(source, &pressed(&said)),
            ClassKind::YesOrNo { .. } | ClassKind::Switch { .. } | ClassKind::Trigger { .. } => {
                self.yes_or_no(&said)
            }
        }
    }

    /// Whether `text` as a whole is one of the feature's texts for yes and no, or of its options.
    fn is_word(&self, text: &str) -> bool {
        let (text, feature) = (text.trim(), &self.feature);
        let is_option = self.options().iter().any(|option| option.text == text);
        is_option || [&feature.yes, &feature.no].into_iter().flatten().any(|word| word == text)
    }

    fn number(&self, said: &str, unit: &str) -> TextContent {
        let Ok(number) = said.parse::<f64>() else { return no_number(said) };
        let value = number * self.factor + self.offset;
        if !is_possible_value(value, unit) {
            return impossible(said, unit);
        }
        // The value is rounded, so that 68 °F are exactly 20 °C.
        TextContent::Is(ObservedValue::Number((value * 1e6).round() / 1e6))
    }

    fn level(&self, said: &str, unit: &str) -> TextContent {
        let (Ok(number), Some(levels)) = (said.parse::<f64>(), self.levels()) else {
            return no_number(said);
        };
        let amount = levels.amount_of(number);
        if !is_possible_level(amount, unit) {
            return impossible(said, unit);
        }
        TextContent::Is(ObservedValue::Number(amount))
    }

    fn option(&self, source: usize, said: &str) -> Option<TextContent> {
        let is_it = |option: &&crate::option::SettableOption| {
            option.text == said && option.source.is_none_or(|only| only == source)
        };
        let options = self.options();
        let index = options.iter().position(|option| is_it(&option))?;
        Some(TextContent::Is(ObservedValue::Option(index)))
    }

    fn yes_or_no(&self, said: &str) -> Option<TextContent> {
        let is = |words: &[String]| words.iter().any(|word| word == said);
        if is(&self.feature.yes) {
            return Some(TextContent::Is(ObservedValue::Yes(true)));
        }
        if is(&self.feature.no) {
            return Some(TextContent::Is(ObservedValue::Yes(false)));
        }
        is(&self.feature.neither).then(|| TextContent::NotKnown(format!("it reports `{said}`")))
    }

    /// Returns a value as PDDL facts. `term` is the feature's term in PDDL; `agent` and `room` are
    /// those of the device.
    pub(crate) fn facts(
        &self,
        term: &str,
        (agent, room): (&str, &str),
        value: ObservedValue,
    ) -> String {
        match (self.class.kind(), value) {
            (Some(ClassKind::Number { known, of_device, .. }), ObservedValue::Number(number)) => {
                let subject = if of_device { agent } else { room };
                format!("({known} {subject}) (= {term} {number})")
            }
            (Some(ClassKind::Level { .. }), ObservedValue::Number(number)) => {
                format!("(= {term} {number})")
            }
            (
                Some(ClassKind::Choice { .. } | ClassKind::Press { .. }),
                ObservedValue::Option(index),
            ) => self
                .options()
                .get(index)
                .map(|option| self.with_option(term, &option.name))
                .unwrap_or_default(),
            (Some(ClassKind::YesOrNo { known, .. }), ObservedValue::Yes(true)) => {
                format!("({known} {room}) {term}")
            }
            (Some(ClassKind::YesOrNo { known, .. }), _) => format!("({known} {room}) (not {term})"),
            (
                Some(ClassKind::Switch { .. } | ClassKind::Trigger { .. }),
                ObservedValue::Yes(true),
            ) => term.to_owned(),
            (Some(ClassKind::Switch { .. }), _) => format!("(not {term})"),
            _ => String::new(),
        }
    }

    /// Returns the PDDL facts which state that the value is unknown. A function without a value
    /// needs none.
    pub(crate) fn unknown(&self, term: &str, (agent, room): (&str, &str)) -> String {
        match self.class.kind() {
            Some(ClassKind::Number { known, of_device, .. }) => {
                format!("(not ({known} {}))", if of_device { agent } else { room })
            }
            Some(ClassKind::YesOrNo { known, .. }) => {
                format!("(not ({known} {room})) (unknown {term})")
            }
            Some(ClassKind::Switch { .. }) => format!("(unknown {term})"),
            Some(ClassKind::Choice { .. }) => {
                let unknown = self
                    .options()
                    .iter()
                    .map(|option| format!("(unknown {})", self.with_option(term, &option.name)));
                unknown.collect::<Vec<_>>().join(" ")
            }
            // A press that is over is false.
            Some(ClassKind::Level { .. } | ClassKind::Press { .. } | ClassKind::Trigger { .. })
            | None => String::new(),
        }
    }

    /// Returns the term of a choice or a press, with an option.
    fn with_option(&self, term: &str, option: &str) -> String {
        format!("{} {option})", term.trim_end_matches(')'))
    }

    /// Returns a value as text for people.
    pub(crate) fn words(&self, value: ObservedValue) -> String {
        match (self.class.kind(), value) {
            (
                Some(ClassKind::Number { unit, .. } | ClassKind::Level { unit, .. }),
                ObservedValue::Number(number),
            ) => format!("{number} {unit}").trim_end().to_owned(),
            (Some(ClassKind::YesOrNo { yes, .. }), ObservedValue::Yes(true)) => yes.to_owned(),
            (Some(ClassKind::YesOrNo { yes, .. }), ObservedValue::Yes(false)) => {
                format!("not {yes}")
            }
            // This is the state of the device, not of the room, because other devices in the room
            // may be in another state.
            (Some(ClassKind::Switch { .. }), ObservedValue::Yes(true)) => "on".to_owned(),
            (Some(ClassKind::Switch { .. }), ObservedValue::Yes(false)) => "off".to_owned(),
            (Some(ClassKind::Trigger { .. }), _) => "triggered".to_owned(),
            (_, ObservedValue::Option(index)) => {
                self.options().get(index).map(|option| option.text.clone()).unwrap_or_default()
            }
            _ => String::new(),
        }
    }
}

fn shortened(said: &str) -> String {
    said.chars().take(TOLD_CHARS_MAX).collect()
}

fn no_number(said: &str) -> TextContent {
    TextContent::NotKnown(format!("it reports `{}`, which is no number", shortened(said)))
}

fn impossible(said: &str, unit: &str) -> TextContent {
    let problem = format!("it reports {}, which is impossible in {unit}", shortened(said));
    TextContent::NotKnown(problem)
}

/// Returns the type of a press. An `event` of Home Assistant reports it in JSON, also through a
/// template.
fn pressed(said: &str) -> String {
    let json = serde_json::from_str::<Value>(said).unwrap_or_default();
    let kind = json.get("event_type").and_then(Value::as_str);
    kind.map_or_else(|| said.to_owned(), str::to_owned)
}
