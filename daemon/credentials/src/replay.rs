//! What was heard already: a sliding window per speaker, life and channel (as in RFC 4303, 3.4.3).
//!
//! Of a speaker the newest life counts; what is of an older one was recorded and is played again.

use std::collections::BTreeMap;

use crate::identity::CHANNELS;

/// How far a message may come behind a later one of its channel. Ten times what a burst of bids
/// was seen to be shuffled by.
const WINDOW: u64 = 4_096;
const WORDS: usize = (WINDOW / 64) as usize;

/// Speakers remembered per certificate: a daemon and its guests, each of which is there for a
/// moment. Beyond it the one that was silent for longest is forgotten, and with it nobody of a
/// life as old is believed any more, unless it is still remembered.
const SPEAKERS_MAX: usize = 64;

/// What was heard of all speakers with one certificate's name.
#[derive(Debug, Default)]
pub(crate) struct Replays {
    speakers: BTreeMap<String, Speaker>,
    /// Lives up to this were forgotten.
    forgotten: u64,
    /// Counts messages, to know who was silent for longest.
    turn: u64,
}

#[derive(Debug)]
struct Speaker {
    life: u64,
    windows: [Option<Box<Window>>; CHANNELS],
    heard: u64,
}

/// The numbers heard lately.
#[derive(Debug)]
struct Window {
    /// The greatest heard.
    newest: u64,
    /// A bit for each of the last [`WINDOW`] numbers, by number modulo the window.
    heard: [u64; WORDS],
}

// === impl Replays ===

impl Replays {
    /// Whether a message is new; from then on it is not.
    pub(crate) fn note(&mut self, speaker: &str, life: u64, channel: usize, number: u64) -> bool {
        self.turn += 1;
        if !self.speakers.contains_key(speaker) && !self.admit(speaker, life) {
            return false;
        }
        let Some(known) = self.speakers.get_mut(speaker) else { return false };
        if life < known.life {
            return false;
        }
        if life > known.life {
            *known = Speaker::new(life);
        }
        known.heard = self.turn;
        let window = known.windows.get_mut(channel);
        window.is_some_and(|window| window.get_or_insert_default().note(number))
    }

    /// Makes room for a speaker not known yet, unless it may be one that was forgotten.
    fn admit(&mut self, speaker: &str, life: u64) -> bool {
        if life <= self.forgotten {
            return false;
        }
        if self.speakers.len() >= SPEAKERS_MAX {
            let silent = self.speakers.iter().min_by_key(|(_, known)| known.heard);
            if let Some((name, life)) = silent.map(|(name, known)| (name.clone(), known.life)) {
                self.speakers.remove(&name);
                self.forgotten = self.forgotten.max(life);
            }
        }
        self.speakers.insert(speaker.to_owned(), Speaker::new(life));
        true
    }
}

impl Speaker {
    fn new(life: u64) -> Speaker {
        Speaker { life, windows: Default::default(), heard: 0 }
    }
}

// === impl Window ===

impl Default for Window {
    fn default() -> Window {
        Window { newest: 0, heard: [0; WORDS] }
    }
}

impl Window {
    fn note(&mut self, number: u64) -> bool {
        if number > self.newest {
            self.forget_up_to(number);
            self.newest = number;
        } else if self.newest - number >= WINDOW {
            return false;
        }
        let (word, bit) = place(number);
        let is_new = self.heard[word] & bit == 0;
        self.heard[word] |= bit;
        is_new
    }

    /// Frees the places of the numbers after the newest, up to this one.
    fn forget_up_to(&mut self, number: u64) {
        if number - self.newest >= WINDOW {
            self.heard = [0; WORDS];
            return;
        }
        for skipped in self.newest + 1..=number {
            let (word, bit) = place(skipped);
            self.heard[word] &= !bit;
        }
    }
}

fn place(number: u64) -> (usize, u64) {
    let index = number % WINDOW;
    // Below WORDS, and so it fits.
    ((index / 64) as usize, 1 << (index % 64))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn nothing_is_heard_twice_and_nothing_too_late() {
        let mut replays = Replays::default();
        for (life, number, expected) in [
            (5, 1, true),
            (5, 1, false),
            (5, 3, true),
            (5, 2, true),
            (5, 2, false),
            (5, WINDOW + 3, true),
            (5, 3, false),
            (5, 4, true),
            (4, 9_999, false),
            (6, 1, true),
            (5, 9_999, false),
            (6, u64::MAX, true),
            (6, u64::MAX, false),
            (6, 2, false),
        ] {
            assert_eq!(replays.note("pi", life, 0, number), expected, "{life} {number}");
        }
        assert!(replays.note("pi", 6, 1, 2), "channels are numbered apart");
    }

    #[test]
    fn speakers_that_come_and_go_push_nobody_out_who_speaks() {
        let mut replays = Replays::default();
        assert!(replays.note("pi", 1, 0, 1));
        for guest in 0..1_000_u64 {
            assert!(replays.note(&format!("pi--cli-{guest}"), 10 + guest, 0, 1), "{guest}");
            assert!(replays.note("pi", 1, 0, 2 + guest), "the daemon, at {guest}");
        }
        assert!(replays.speakers.len() <= SPEAKERS_MAX);
        assert!(!replays.note("pi--cli-0", 10, 0, 2), "a guest of old, played again");
    }

    proptest! {
        /// Against a set that remembers everything.
        #[test]
        fn a_window_is_a_set_of_the_last(numbers in prop::collection::vec(1..10_000_u64, 1..400)) {
            let (mut window, mut all, mut newest) = (Window::default(), BTreeSet::new(), 0);
            for number in numbers {
                let is_new = all.insert(number);
                let in_reach = number + WINDOW > newest;
                newest = newest.max(number);
                prop_assert_eq!(window.note(number), is_new && in_reach);
            }
        }
    }
}
