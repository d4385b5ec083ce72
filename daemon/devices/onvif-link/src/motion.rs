//! Motion in messages of cameras: whether there is motion, despite messages that are missing, empty
//! or stuck.
//!
//! This file uses no clock, and does no input or output.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::xml::Element;

/// Time for which motion lasts after the last message that reports it. Some cameras never report
/// its end.
const OFF_TIMEOUT: Duration = Duration::from_secs(60);

/// Time after which motion without an end counts as a stuck alarm. People do not move for so long
/// in the same picture without a pause; alarms that stay on for hours are known.
const STUCK_AFTER: Duration = Duration::from_secs(600);

/// Maximum number of detectors of a camera; messages of further ones are ignored.
const DETECTORS_MAX: usize = 64;

/// Last parts of the topics that report motion, without prefixes. Each has the names of the items
/// that may contain whether there is motion, in the order in which they are tried.
const TOPICS: &[(&str, &[&str])] = &[
    ("RuleEngine/CellMotionDetector/Motion", &["IsMotion", "State"]),
    ("VideoSource/MotionAlarm", &["State", "IsMotion"]),
    ("RuleEngine/MotionRegionDetector/Motion", &["State", "IsMotion"]),
    ("RuleEngine/MyRuleDetector/PeopleDetect", &["State", "IsPeople"]),
    ("RuleEngine/MyRuleDetector/Motion", &["State", "IsMotion"]),
    ("RuleEngine/FieldDetector/ObjectsInside", &["IsInside"]),
];

/// Content of one message about motion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct MotionMessage {
    /// The detector: the topic, and the source of the message.
    pub(crate) detector: String,
    /// Values of the items that name the source of the picture.
    pub(crate) sources: Vec<String>,
    /// Whether there is motion.
    pub(crate) is_motion: bool,
}

impl MotionMessage {
    /// Reads a notification; `None` if it is not about motion.
    pub(crate) fn of(notification: &Element) -> Option<MotionMessage> {
        let topic = plain_topic(notification.text_at(&["Topic"])?);
        let (_, items) = TOPICS.iter().find(|(known, _)| topic.ends_with(known))?;
        let message = notification.at(&["Message", "Message"]);
        let of = |part: &str| -> Vec<(String, String)> {
            let items = message.and_then(|message| message.child(part));
            let items = items.into_iter().flat_map(|part| part.all("SimpleItem"));
            let text = |item: &Element, name: &str| item.attribute(name).map(str::to_owned);
            items.filter_map(|item| Some((text(item, "Name")?, text(item, "Value")?))).collect()
        };
        let (source, data) = (of("Source"), of("Data"));
        let told = items.iter().find_map(|name| data.iter().find(|(item, _)| item == name));
        // A message without data means that there is no motion: some cameras report it so.
        let is_motion = told.is_some_and(|(_, value)| is_yes(value));
        let sources: Vec<_> = source.into_iter().map(|(_, value)| value).collect();
        let detector = format!("{topic} {}", sources.join(" "));
        Some(MotionMessage { detector, sources, is_motion })
    }
}

/// Returns a topic without the prefixes of its parts, which cameras choose freely.
fn plain_topic(topic: &str) -> String {
    let parts = topic.trim().split('/').map(|part| part.rsplit(':').next().unwrap_or(part));
    parts.collect::<Vec<_>>().join("/")
}

fn is_yes(value: &str) -> bool {
    matches!(value.trim().to_ascii_lowercase().as_str(), "true" | "1" | "yes" | "on" | "active")
}

/// The motion that a camera's detectors report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct MotionTracker {
    detectors: BTreeMap<String, Detector>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Detector {
    /// Start of the motion that has not ended.
    since: Instant,
    /// Time of the last message of motion.
    last: Instant,
    is_stuck: bool,
}

impl MotionTracker {
    /// Records a message. Returns the name of the detector if its alarm is now found to be stuck.
    pub(crate) fn note(&mut self, message: &MotionMessage, now: Instant) -> Option<String> {
        let MotionMessage { detector, is_motion, .. } = message;
        if !is_motion {
            self.detectors.remove(detector);
            return None;
        }
        let is_new = !self.detectors.contains_key(detector);
        if is_new && self.detectors.len() >= DETECTORS_MAX {
            return None;
        }
        let first = Detector { since: now, last: now, is_stuck: false };
        let known = self.detectors.entry(detector.clone()).or_insert(first);
        // Single messages with pauses between them are single motions.
        if now.duration_since(known.last) > OFF_TIMEOUT && !known.is_stuck {
            known.since = now;
        }
        known.last = now;
        let is_found = !known.is_stuck && now.duration_since(known.since) >= STUCK_AFTER;
        known.is_stuck |= is_found;
        is_found.then(|| detector.clone())
    }

    /// Whether there is motion.
    pub(crate) fn is_motion(&self, now: Instant) -> bool {
        let is_recent = |one: &Detector| now.duration_since(one.last) < OFF_TIMEOUT;
        self.detectors.values().any(|one| !one.is_stuck && is_recent(one))
    }

    /// Whether the camera has to be asked for its state again: motion has not ended, and the last
    /// message about it is old.
    pub(crate) fn is_due(&self, now: Instant) -> bool {
        let is_old = |one: &Detector| now.duration_since(one.last) >= OFF_TIMEOUT / 2;
        self.detectors.values().any(|one| {
            !one.is_stuck && is_old(one) && { now.duration_since(one.last) < OFF_TIMEOUT }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(is_motion: bool) -> MotionMessage {
        MotionMessage { detector: "a".to_owned(), sources: Vec::new(), is_motion }
    }

    fn read(topic: &str, content: &str) -> Option<MotionMessage> {
        let text = format!("<N><Topic Dialect='x'>{topic}</Topic><Message>{content}</Message></N>");
        MotionMessage::of(&Element::parse(text.as_bytes()).expect("XML"))
    }

    #[test]
    fn motion_is_read_from_every_known_topic() {
        let content = |name: &str, value: &str| {
            format!(
                "<tt:Message xmlns:tt='urn:t'><tt:Source><tt:SimpleItem Name='VideoSourceToken' \
                 Value='vs0'/></tt:Source><tt:Data><tt:SimpleItem Name='Other' Value='true'/>\
                 <tt:SimpleItem Name='{name}' Value='{value}'/></tt:Data></tt:Message>"
            )
        };
        for (topic, name, value, expected) in [
            ("tns1:RuleEngine/CellMotionDetector/Motion", "IsMotion", "true", true),
            ("tns1:RuleEngine/tns1:CellMotionDetector/tns1:Motion", "IsMotion", "1", true),
            ("tns1:VideoSource/MotionAlarm", "State", "True", true),
            ("tns1:VideoSource/MotionAlarm", "State", "false", false),
            ("tns1:RuleEngine/MyRuleDetector/PeopleDetect", "State", "true", true),
        ] {
            let message = read(topic, &content(name, value)).expect(topic);
            assert_eq!(message.is_motion, expected, "{topic}");
            assert_eq!(message.sources, ["vs0"]);
        }
        assert_eq!(read("tns1:Device/Trigger/Relay", &content("State", "true")), None);
        let empty = read("tns1:VideoSource/MotionAlarm", "").expect("about motion");
        assert!(!empty.is_motion, "an empty message means that there is none");
    }

    #[test]
    fn motion_without_an_end_is_over_after_a_while() {
        let (mut tracker, start) = (MotionTracker::default(), Instant::now());
        assert!(!tracker.is_motion(start));
        assert_eq!(tracker.note(&message(true), start), None);
        assert!(tracker.is_motion(start + OFF_TIMEOUT / 2));
        assert!(tracker.is_due(start + OFF_TIMEOUT / 2) && !tracker.is_due(start));
        assert!(!tracker.is_motion(start + OFF_TIMEOUT));
        tracker.note(&message(false), start + OFF_TIMEOUT);
        assert!(!tracker.is_due(start + OFF_TIMEOUT * 3 / 2));
    }

    #[test]
    fn a_stuck_alarm_is_found_once_and_ignored_until_it_ends() {
        let (mut tracker, start) = (MotionTracker::default(), Instant::now());
        let mut found = Vec::new();
        for seconds in (0..3_600).step_by(30) {
            let now = start + Duration::from_secs(seconds);
            found.extend(tracker.note(&message(true), now).map(|_| seconds));
            assert_eq!(tracker.is_motion(now), seconds < 600, "{seconds}");
        }
        assert_eq!(found, [600]);
        let later = start + Duration::from_secs(4_000);
        tracker.note(&message(false), later);
        tracker.note(&message(true), later);
        assert!(tracker.is_motion(later));
    }

    #[test]
    fn single_messages_with_pauses_are_never_a_stuck_alarm() {
        let (mut tracker, start) = (MotionTracker::default(), Instant::now());
        for minutes in (0..60).step_by(5) {
            let now = start + Duration::from_secs(60 * minutes);
            assert_eq!(tracker.note(&message(true), now), None);
            assert!(tracker.is_motion(now));
        }
    }

    #[test]
    fn a_camera_that_invents_detectors_fills_no_memory() {
        let (mut tracker, now) = (MotionTracker::default(), Instant::now());
        for number in 0..1_000 {
            let detector = number.to_string();
            tracker.note(&MotionMessage { detector, ..message(true) }, now);
        }
        assert_eq!(tracker.detectors.len(), DETECTORS_MAX);
    }
}
