//! Replay protection: a sliding window of sequence numbers per sender, incarnation and channel (as
//! in RFC 4303, 3.4.3).
//!
//! Only the newest incarnation of a sender counts; a message of an older incarnation is rejected. A
//! daemon that has just started has received nothing yet, so an attacker could send it recordings
//! of all earlier messages. Two rules prevent that. A broadcast counts only if its number is
//! greater than the one that the sender stated in its answer to a *roll call*, the query of this
//! daemon to all daemons. A message to one daemon is bound to one incarnation of that daemon.
//!
//! Clocks of two machines are not compared. Instead, a sender states the age of its incarnation in
//! its answer to each roll call, and each seal contains the age at which the message was sealed.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::error::DistrustReason;
use crate::identity::{NUMBERED_CHANNELS, SequenceState};

/// Size of the duplicate window: how far a message may arrive behind a later message of its
/// channel. The size is ten times the reordering that was seen in a burst of bids.
const WINDOW_SIZE: u64 = 4_096;
const WORDS: usize = (WINDOW_SIZE / 64) as usize;

/// How long after a sender's answer to a roll call a message that was sent before the answer may
/// still arrive. Such a message is dropped, but not reported as a replay.
const OVERTAKEN_GRACE: Duration = Duration::from_secs(2);

/// How long a message may be under way. A sender that waits for an answer sends its message again
/// within seconds, so a message that is under way for longer was held back.
const UNDERWAY_MAX: Duration = Duration::from_secs(30);

/// Maximum number of senders remembered per certificate: a daemon and its guests, each of which
/// exists for a moment only. If there are more, the sender that was silent for longest is dropped.
/// From then on a sender that is not remembered is accepted only if its incarnation is newer than
/// that of every dropped sender.
const SENDERS_MAX: usize = 64;

/// State of all senders that use the certificate of one name.
#[derive(Debug, Default)]
pub(crate) struct ReplayGuard {
    senders: BTreeMap<String, SenderWindows>,
    /// Greatest incarnation among the senders that were dropped.
    dropped_incarnation: u64,
    /// Running count of messages, to find the sender that was silent for longest.
    clock: u64,
}

#[derive(Debug)]
struct SenderWindows {
    incarnation: u64,
    /// Sequence numbers in the sender's first answer to a roll call in this incarnation, and the
    /// time at which that answer arrived.
    from: Option<([u64; NUMBERED_CHANNELS], Instant)>,
    /// Age of the incarnation in milliseconds, as stated in the sender's latest answer to a roll
    /// call, and the time at which that answer arrived.
    age: Option<(u64, Instant)>,
    windows: [Option<Box<SequenceWindow>>; NUMBERED_CHANNELS],
    last_used: u64,
}

/// Position of one message among the messages of its sender: incarnation, channel, number and age.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MessagePosition {
    pub(crate) incarnation: u64,
    pub(crate) channel: usize,
    pub(crate) number: u64,
    /// Time at which the message was sealed, in milliseconds since the sender's incarnation began.
    pub(crate) at: u64,
    /// Whether the message is bound to the present incarnation of the receiver. If so, the message
    /// cannot be a recording from before that incarnation began.
    pub(crate) is_for_this_incarnation: bool,
}

/// Duplicate window of one channel: the sequence numbers received lately.
#[derive(Debug)]
struct SequenceWindow {
    /// Greatest sequence number received.
    newest: u64,
    /// One bit for each of the last [`WINDOW_SIZE`] sequence numbers. The bit of a number is at the
    /// number modulo `WINDOW_SIZE`.
    received: [u64; WORDS],
}

// === impl ReplayGuard ===

impl ReplayGuard {
    /// Records a message if it is new.
    ///
    /// # Errors
    ///
    /// Returns the reason if the message may be a replay.
    pub(crate) fn record(
        &mut self,
        signer: &str,
        place: MessagePosition,
        now: Instant,
    ) -> Result<(), DistrustReason> {
        let MessagePosition { incarnation, channel, number, at, is_for_this_incarnation } = place;
        // Only a sender that has answered a roll call, or sends to this incarnation, is remembered,
        // so that recordings of many senders do not displace the real ones.
        let known = match is_for_this_incarnation {
            true => self.current_sender(signer, incarnation).ok_or(DistrustReason::Replayed)?,
            false => self.synced_sender(signer, incarnation)?,
        };
        if !is_for_this_incarnation {
            let (from, answered) = known.from.as_ref().ok_or(DistrustReason::NotSynced)?;
            let is_before = from.get(channel).is_none_or(|from| number <= *from);
            if is_before && now.saturating_duration_since(*answered) < OVERTAKEN_GRACE {
                return Err(DistrustReason::NotSynced);
            } else if is_before {
                return Err(DistrustReason::Replayed);
            }
        }
        if known.is_overdue(at, now) {
            return Err(DistrustReason::Delayed);
        }
        let window = known.windows.get_mut(channel).ok_or(DistrustReason::Replayed)?;
        let is_new = window.get_or_insert_default().record(number);
        if is_new { Ok(()) } else { Err(DistrustReason::Replayed) }
    }

    /// Returns the state of a sender that has answered a roll call in the `incarnation`; otherwise
    /// the reason why a message of the sender is rejected.
    fn synced_sender(
        &mut self,
        signer: &str,
        incarnation: u64,
    ) -> Result<&mut SenderWindows, DistrustReason> {
        self.clock += 1;
        let known = self.senders.get_mut(signer).ok_or(DistrustReason::NotSynced)?;
        match incarnation.cmp(&known.incarnation) {
            Ordering::Less => Err(DistrustReason::Replayed),
            Ordering::Equal => {
                known.last_used = self.clock;
                Ok(known)
            }
            Ordering::Greater => Err(DistrustReason::NotSynced),
        }
    }

    /// Records the answer of a sender to a roll call. The answer is fresh, so it counts even if the
    /// sender had been dropped.
    pub(crate) fn record_reply(&mut self, signer: &str, said: SequenceState, now: Instant) {
        if !self.senders.contains_key(signer) {
            self.insert(signer, said.incarnation);
        }
        if let Some(known) = self.current_sender(signer, said.incarnation) {
            known.from.get_or_insert((said.numbers, now));
            known.age = Some((said.age, now));
        }
    }

    /// Returns the incarnation in which a sender has answered a roll call; `None` if the sender has
    /// not answered.
    pub(crate) fn incarnation(&self, signer: &str) -> Option<u64> {
        let known = self.senders.get(signer)?;
        known.from.map(|_| known.incarnation)
    }

    /// Returns the state of a sender. The state is reset if the `incarnation` is newer than the
    /// known one; `None` if it is older.
    fn current_sender(&mut self, signer: &str, incarnation: u64) -> Option<&mut SenderWindows> {
        self.clock += 1;
        if !self.senders.contains_key(signer) && !self.admit(signer, incarnation) {
            return None;
        }
        let known =
            self.senders.get_mut(signer).filter(|known| incarnation >= known.incarnation)?;
        if incarnation > known.incarnation {
            *known = SenderWindows::new(incarnation);
        }
        known.last_used = self.clock;
        Some(known)
    }

    /// Adds a sender to the remembered ones. Returns `false`, and adds nothing, if the sender may
    /// be one that was dropped.
    fn admit(&mut self, signer: &str, incarnation: u64) -> bool {
        if incarnation <= self.dropped_incarnation {
            return false;
        }
        self.insert(signer, incarnation);
        true
    }

    fn insert(&mut self, signer: &str, incarnation: u64) {
        if self.senders.len() >= SENDERS_MAX {
            let silent = self.senders.iter().min_by_key(|(_, known)| known.last_used);
            if let Some((name, incarnation)) =
                silent.map(|(name, known)| (name.clone(), known.incarnation))
            {
                self.senders.remove(&name);
                self.dropped_incarnation = self.dropped_incarnation.max(incarnation);
            }
        }
        self.senders.insert(
            signer.to_owned(),
            SenderWindows { last_used: self.clock, ..SenderWindows::new(incarnation) },
        );
    }
}

impl SenderWindows {
    fn new(incarnation: u64) -> SenderWindows {
        SenderWindows {
            incarnation,
            from: None,
            age: None,
            windows: Default::default(),
            last_used: 0,
        }
    }

    /// Whether a message that was sealed at `at` has been under way for too long. The result is
    /// based on a lower bound of the time under way, because a roll call's answer is itself under
    /// way for a while.
    fn is_overdue(&self, at: u64, now: Instant) -> bool {
        let Some((age, heard)) = self.age else { return false };
        let before_answer = Duration::from_millis(age.saturating_sub(at));
        let after_answer = Duration::from_millis(at.saturating_sub(age));
        let since_answer = now.saturating_duration_since(heard);
        (before_answer + since_answer).saturating_sub(after_answer) > UNDERWAY_MAX
    }
}

// === impl SequenceWindow ===

impl Default for SequenceWindow {
    fn default() -> SequenceWindow {
        SequenceWindow { newest: 0, received: [0; WORDS] }
    }
}

impl SequenceWindow {
    fn record(&mut self, number: u64) -> bool {
        if number > self.newest {
            self.forget_up_to(number);
            self.newest = number;
        } else if self.newest - number >= WINDOW_SIZE {
            return false;
        }
        let (word, bit) = bit_position(number);
        let is_new = self.received[word] & bit == 0;
        self.received[word] |= bit;
        is_new
    }

    /// Clears the bits of all numbers after the newest one, up to `number`.
    fn forget_up_to(&mut self, number: u64) {
        if number - self.newest >= WINDOW_SIZE {
            self.received = [0; WORDS];
            return;
        }
        for skipped in self.newest + 1..=number {
            let (word, bit) = bit_position(skipped);
            self.received[word] &= !bit;
        }
    }
}

fn bit_position(number: u64) -> (usize, u64) {
    let index = number % WINDOW_SIZE;
    // The word index is less than `WORDS`, so the conversion is exact.
    ((index / 64) as usize, 1 << (index % 64))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    /// Whether the replay guard accepts a broadcast with this number.
    fn is_heard(
        replays: &mut ReplayGuard,
        signer: &str,
        incarnation: u64,
        channel: usize,
        number: u64,
    ) -> bool {
        let place =
            MessagePosition { incarnation, channel, number, at: 0, is_for_this_incarnation: false };
        replays.record(signer, place, Instant::now()).is_ok()
    }

    fn begun(incarnation: u64) -> SequenceState {
        SequenceState { incarnation, numbers: [0; NUMBERED_CHANNELS], age: 0 }
    }

    #[test]
    fn a_broadcast_from_before_the_first_reply_is_rejected() {
        let (mut replays, began) = (ReplayGuard::default(), Instant::now());
        let (place, later) = (
            |number, is_for_this_incarnation| MessagePosition {
                incarnation: 5,
                channel: 0,
                number,
                at: 0,
                is_for_this_incarnation,
            },
            began + OVERTAKEN_GRACE,
        );
        let mut note = |place| replays.record("pi", place, later);
        assert_eq!(note(place(7, false)), Err(DistrustReason::NotSynced));
        assert_eq!(note(place(3, true)), Ok(()), "it cannot have been said before");
        assert_eq!(replays.incarnation("pi"), None);
        replays.record_reply(
            "pi",
            SequenceState { incarnation: 5, numbers: [9, 40], age: 0 },
            began,
        );
        assert_eq!(replays.incarnation("pi"), Some(5));
        assert_eq!(replays.record("pi", place(7, false), began), Err(DistrustReason::NotSynced));
        let mut note = |place| replays.record("pi", place, later);
        assert_eq!(note(place(7, false)), Err(DistrustReason::Replayed));
        assert_eq!(note(place(8, true)), Ok(()), "on its way when it answered");
        assert_eq!(note(place(8, true)), Err(DistrustReason::Replayed));
        assert_eq!(note(place(10, false)), Ok(()));
        let beat = |number| MessagePosition { channel: 1, ..place(number, false) };
        assert_eq!([note(beat(40)), note(beat(41))], [Err(DistrustReason::Replayed), Ok(())]);
        replays.record_reply(
            "pi",
            SequenceState { incarnation: 5, numbers: [20, 50], age: 0 },
            began,
        );
        let mut note = |place| replays.record("pi", place, later);
        assert_eq!(note(place(11, false)), Ok(()), "only the first answer counts");
        replays.record_reply(
            "pi",
            SequenceState { incarnation: 4, numbers: [0, 0], age: 0 },
            began,
        );
        let mut note = |place| replays.record("pi", place, later);
        assert_eq!(note(place(10, false)), Err(DistrustReason::Replayed));
        for guest in 0..1_000 {
            let name = format!("pi--cli-{guest}");
            assert_eq!(
                replays.record(&name, place(1, false), later),
                Err(DistrustReason::NotSynced)
            );
        }
        assert_eq!(replays.senders.len(), 1, "rejected senders are not remembered");
        let mut note = |place| replays.record("pi", place, later);
        assert_eq!(note(place(12, false)), Ok(()));
        let reborn = MessagePosition { incarnation: 6, ..place(1, false) };
        assert_eq!(note(reborn), Err(DistrustReason::NotSynced));
        replays.record_reply(
            "pi",
            SequenceState { incarnation: 6, numbers: [0, 0], age: 0 },
            began,
        );
        assert_eq!(replays.record("pi", reborn, later), Ok(()));
    }

    #[test]
    fn no_message_is_accepted_twice_or_too_late() {
        let mut replays = ReplayGuard::default();
        for (incarnation, number, expected) in [
            (5, 1, true),
            (5, 1, false),
            (5, 3, true),
            (5, 2, true),
            (5, 2, false),
            (5, WINDOW_SIZE + 3, true),
            (5, 3, false),
            (5, 4, true),
            (4, 9_999, false),
            (6, 1, true),
            (5, 9_999, false),
            (6, u64::MAX, true),
            (6, u64::MAX, false),
            (6, 2, false),
        ] {
            replays.record_reply("pi", begun(incarnation), Instant::now());
            assert_eq!(
                is_heard(&mut replays, "pi", incarnation, 0, number),
                expected,
                "{incarnation} {number}"
            );
        }
        assert!(is_heard(&mut replays, "pi", 6, 1, 2), "channels are numbered apart");
    }

    #[test]
    fn a_message_that_was_held_back_is_rejected_whatever_the_clocks_show() {
        let (mut replays, began) = (ReplayGuard::default(), Instant::now());
        let second = Duration::from_secs(1);
        // The incarnation is an hour old when it is called.
        let hour = 3_600_000;
        replays.record_reply(
            "pi",
            SequenceState { incarnation: 5, numbers: [0; 2], age: hour },
            began,
        );
        let mut hears = |number, at, now| {
            let place = MessagePosition {
                incarnation: 5,
                channel: 0,
                number,
                at,
                is_for_this_incarnation: true,
            };
            replays.record("pi", place, now)
        };
        assert_eq!(hears(1, hour + 10_000, began + 11 * second), Ok(()));
        assert_eq!(hears(2, hour - 1_000, began + 28 * second), Ok(()), "a slow reader");
        assert_eq!(hears(3, hour + 1_000, began + 32 * second), Err(DistrustReason::Delayed));
        assert_eq!(hears(4, hour - 60_000, began), Err(DistrustReason::Delayed));
        assert_eq!(hears(3, hour + 1_000, began + 30 * second), Ok(()), "a loss, not a replay");
    }

    #[test]
    fn short_lived_senders_do_not_displace_an_active_one() {
        let mut replays = ReplayGuard::default();
        replays.record_reply("pi", begun(1), Instant::now());
        assert!(is_heard(&mut replays, "pi", 1, 0, 1));
        for guest in 0..1_000_u64 {
            let name = format!("pi--cli-{guest}");
            replays.record_reply(&name, begun(10 + guest), Instant::now());
            assert!(is_heard(&mut replays, &name, 10 + guest, 0, 1), "{guest}");
            assert!(is_heard(&mut replays, "pi", 1, 0, 2 + guest), "the daemon, at {guest}");
        }
        assert!(replays.senders.len() <= SENDERS_MAX);
        assert!(!is_heard(&mut replays, "pi--cli-0", 10, 0, 2), "a guest of old, played again");
    }

    proptest! {
        /// Compares the duplicate window with a set that remembers every number.
        #[test]
        fn a_window_is_a_set_of_the_last(numbers in prop::collection::vec(1..10_000_u64, 1..400)) {
            let (mut window, mut all, mut newest) = (SequenceWindow::default(), BTreeSet::new(), 0);
            for number in numbers {
                let is_new = all.insert(number);
                let in_reach = number + WINDOW_SIZE > newest;
                newest = newest.max(number);
                prop_assert_eq!(window.record(number), is_new && in_reach);
            }
        }
    }
}
