//! A recording as it is shown: the view at one moment of it, which moves forwards while it plays,
//! and can be put anywhere. Copies of the view at regular places (keyframes) make that quick.

use std::time::Duration;

use acl::Message;
use live_view::{LiveView, Moment, ViewEvent, ViewLimits};
use terminal_view::RecordingSpan;

use crate::commands::watch::record::{Recorded, Recording};

/// Maximum number of keyframes.
const KEYFRAMES_MAX: usize = 32;

/// Smallest number of messages between two keyframes. A view takes so many in milliseconds.
const BETWEEN_MIN: usize = 500;

/// A recording, and the view at one moment of it.
pub(super) struct Playback {
    messages: Vec<RecordedMessage>,
    start: Moment,
    end: Moment,
    keyframes: Vec<Keyframe>,
    between: usize,
    /// Number of messages that `view` has taken.
    taken: usize,
    now: Moment,
    view: LiveView,
    is_playing: bool,
}

struct RecordedMessage {
    at: Moment,
    message: Box<Message>,
}

/// A copy of the view after a number of messages.
struct Keyframe {
    taken: usize,
    view: LiveView,
}

impl Playback {
    /// Prepares a recording, and goes to its start.
    pub(super) fn new(recording: Recording, limits: ViewLimits) -> Playback {
        let began = Moment(recording.header.began_ms.unwrap_or(0));
        let at = |at_ms: u64| began.plus(at_ms);
        let end = recording.messages.last().map_or(began, |last| at(last.at_ms));
        let messages: Vec<_> = recording
            .messages
            .into_iter()
            .map(|Recorded { at_ms, message, .. }| RecordedMessage {
                at: at(at_ms),
                message: Box::new(message),
            })
            .collect();
        let mut view = LiveView::new(recording.header.ecosystem, limits);
        view.observe(began, ViewEvent::Reached(true));
        let unread = u64::try_from(recording.unread).unwrap_or(u64::MAX);
        if unread > 0 {
            view.observe(began, ViewEvent::Unreadable(unread));
        }
        let between = messages.len().div_ceil(KEYFRAMES_MAX).max(BETWEEN_MIN);
        let keyframes = vec![Keyframe { taken: 0, view: view.clone() }];
        let (taken, is_playing) = (0, false);
        let start = began;
        Playback { messages, start, end, keyframes, between, taken, now: start, view, is_playing }
    }

    /// Returns the view at the present moment of the recording.
    pub(super) fn view(&self) -> &LiveView {
        &self.view
    }

    /// Returns the present moment of the recording.
    pub(super) fn now(&self) -> Moment {
        self.now
    }

    /// Returns the moment at which the recording begins.
    pub(super) fn start(&self) -> Moment {
        self.start
    }

    /// Returns the moment of the last message.
    pub(super) fn end(&self) -> Moment {
        self.end
    }

    /// Returns the times of the recording, and whether it plays.
    pub(super) fn span(&self) -> RecordingSpan {
        RecordingSpan { start: self.start, end: self.end, is_playing: self.is_playing }
    }

    /// Whether the recording plays.
    pub(super) fn is_playing(&self) -> bool {
        self.is_playing
    }

    /// Plays, or halts. At its end, a recording is played again from its start.
    pub(super) fn toggle(&mut self) {
        if !self.is_playing && self.now >= self.end {
            self.seek(self.start);
        }
        self.is_playing = !self.is_playing;
    }

    /// Moves forwards by this time if the recording plays; halts at its end. Returns `true` if the
    /// moment has changed.
    pub(super) fn advance(&mut self, by: Duration) -> bool {
        if !self.is_playing {
            return false;
        }
        let by = u64::try_from(by.as_millis()).unwrap_or(u64::MAX);
        self.seek(self.now.plus(by));
        self.is_playing = self.now < self.end;
        by > 0
    }

    /// Goes to a moment of the recording, at most to its end.
    pub(super) fn seek(&mut self, to: Moment) {
        let to = to.clamp(self.start, self.end);
        let wanted = self.messages.partition_point(|message| message.at <= to);
        self.take_to(wanted);
        self.now = to;
    }

    /// Goes forwards or backwards by a number of messages.
    pub(super) fn step(&mut self, by: isize) {
        self.is_playing = false;
        let wanted = self.taken.saturating_add_signed(by).min(self.messages.len());
        self.take_to(wanted);
        let last = wanted.checked_sub(1).and_then(|last| self.messages.get(last));
        self.now = last.map_or(self.start, |message| message.at);
    }

    /// Brings the view to the state after a number of messages.
    fn take_to(&mut self, wanted: usize) {
        let nearest = self.keyframes.partition_point(|keyframe| keyframe.taken <= wanted);
        let nearest = &self.keyframes[nearest.saturating_sub(1)];
        if wanted < self.taken || nearest.taken > self.taken {
            (self.taken, self.view) = (nearest.taken, nearest.view.clone());
        }
        while self.taken < wanted {
            let RecordedMessage { at, message } = &self.messages[self.taken];
            self.view.observe(*at, ViewEvent::Message(message.clone()));
            self.taken += 1;
            let last = self.keyframes.last().map_or(0, |keyframe| keyframe.taken);
            if self.taken == last + self.between {
                self.keyframes.push(Keyframe { taken: self.taken, view: self.view.clone() });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use acl::EcosystemId;
    use serde_json::json;

    use super::*;
    use crate::commands::watch::record::Header;

    /// A recording of a message each 10 ms.
    fn recording(count: u64) -> Recording {
        let message = |number: u64| {
            serde_json::from_value(json!({
                "version": 2, "id": format!("m{number}"), "performative": "query-ref",
                "sender": "alice", "incarnation": 1, "conversation_id": format!("c{number}"),
                "protocol": "query", "content": { "text": format!("question {number}") },
            }))
            .expect("a message")
        };
        let recorded =
            |number| Recorded { at_ms: number * 10, key: "k".to_owned(), message: message(number) };
        let ecosystem = EcosystemId::new("office").expect("a name");
        let header = Header { recording: 1, ecosystem, began_ms: Some(1_000) };
        Recording { header, messages: (0..count).map(recorded).collect(), unread: 0 }
    }

    fn shown(playback: &Playback) -> String {
        let view = playback.view();
        let rows = json!([view.conversations(), view.overview(playback.now())]);
        rows.to_string()
    }

    #[test]
    fn a_moment_looks_the_same_however_it_is_reached() {
        let fresh = || Playback::new(recording(5_000), ViewLimits::default());
        let mut played = fresh();
        played.toggle();
        while played.now() < Moment(1_000 + 30_000) {
            played.advance(Duration::from_millis(500));
        }
        let mut sought = fresh();
        for to in [49_000, 100, 48_000, 30_000] {
            sought.seek(Moment(1_000 + to));
        }
        assert_eq!(played.now(), sought.now());
        assert_eq!(shown(&played), shown(&sought));
        let mut stepped = fresh();
        stepped.seek(stepped.end());
        stepped.step(1);
        assert_eq!(stepped.now(), stepped.end());
        let steps = stepped.taken - sought.taken;
        stepped.step(-isize::try_from(steps).expect("few"));
        assert_eq!(shown(&stepped), shown(&sought));
        assert!(sought.keyframes.len() <= KEYFRAMES_MAX + 1);
    }

    #[test]
    fn a_recording_halts_at_its_end_and_plays_again_from_its_start() {
        let mut playback = Playback::new(recording(10), ViewLimits::default());
        assert!(!playback.advance(Duration::from_secs(1)), "it halts at first");
        playback.toggle();
        assert!(playback.advance(Duration::from_secs(60)));
        assert_eq!((playback.now(), playback.is_playing()), (Moment(1_090), false));
        playback.toggle();
        assert_eq!((playback.now(), playback.is_playing()), (Moment(1_000), true));
    }

    #[test]
    fn an_empty_recording_is_shown() {
        let mut playback = Playback::new(recording(0), ViewLimits::default());
        playback.toggle();
        playback.advance(Duration::from_secs(1));
        playback.step(-1);
        playback.step(1);
        playback.seek(Moment(u64::MAX));
        assert_eq!((playback.start(), playback.now()), (playback.end(), playback.end()));
    }
}
