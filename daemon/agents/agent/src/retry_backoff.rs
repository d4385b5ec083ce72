//! The waits between the repetitions of a message to which there is no answer.
//!
//! On a link that loses a fifth of all messages, a message and its answer get through in two of three
//! attempts. With waits of 80 ms that double from the beginning, one exchange in twenty would take
//! 560 ms or more. Therefore the first waits are equally short, and one in sixty takes 400 ms or more.
//! Only the waits after them double: a receiver that has not answered until then is slow or gone.

use std::time::Duration;

/// Number of waits of the first length.
const EQUAL_WAITS: u32 = 3;

/// The waits between the repetitions of one message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryBackoff {
    wait: Duration,
    wait_max: Duration,
    equal_waits_left: u32,
}

impl RetryBackoff {
    /// Creates the waits of a message that was not repeated yet. The first ones are `first` long, all
    /// others at most `max`.
    pub(crate) fn new(first: Duration, max: Duration) -> RetryBackoff {
        RetryBackoff { wait: first, wait_max: max, equal_waits_left: EQUAL_WAITS }
    }

    /// Returns the next wait.
    pub fn next_wait(&mut self) -> Duration {
        match self.equal_waits_left.checked_sub(1) {
            Some(left) => self.equal_waits_left = left,
            None => self.wait = (self.wait * 2).min(self.wait_max),
        }
        self.wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_waits_are_equal_and_the_others_double_up_to_the_longest() {
        let mut backoff =
            RetryBackoff::new(Duration::from_millis(100), Duration::from_millis(1_000));
        let waits: Vec<_> = (0..10).map(|_| backoff.next_wait().as_millis()).collect();
        assert_eq!(waits, [100, 100, 100, 200, 400, 800, 1_000, 1_000, 1_000, 1_000]);
    }
}
