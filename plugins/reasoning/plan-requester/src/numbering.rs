//! The numbers of goals, by which people name them: 1, 2, 3 … in the order of the requests.
//!
//! The leader gives the numbers, and the Journals keep them with the goals, ended ones included. A
//! new leader gives none until it has read them (`early_requests`), and continues after the highest
//! number that a Journal has. Two leaders on the two sides of
//! a partition may give one number to two goals; when the partition ends, the goal that the
//! surviving leader takes over gets a new number.

use crate::PlanRequester;

/// The numbers that have been given to goals.
#[derive(Debug, Default)]
pub(crate) struct GoalNumbers {
    /// Whether no numbers are given, because the Journals have not been read yet and may have any.
    is_closed: bool,
    /// The highest number that a goal has or had, as far as it is known here; 0 before the first
    /// goal.
    highest: u32,
}

impl GoalNumbers {
    /// Stops giving numbers, because goals may have numbers that are not known here.
    pub(crate) fn close(&mut self) {
        self.is_closed = true;
    }

    /// Gives numbers again.
    pub(crate) fn open(&mut self) {
        self.is_closed = false;
    }

    /// Returns the number for a new goal; 0 if no numbers are given now.
    pub(crate) fn next(&mut self) -> u32 {
        if self.is_closed {
            return 0;
        }
        self.highest = self.highest.saturating_add(1);
        self.highest
    }

    /// Records that a goal has or had this number.
    pub(crate) fn note(&mut self, number: u32) {
        self.highest = self.highest.max(number);
    }
}

impl PlanRequester {
    /// Returns the number for a goal that is resumed from a record with the number `recorded`: that
    /// number, unless the goal has none or another goal has it.
    pub(crate) fn number_for(&mut self, recorded: u32) -> u32 {
        self.numbers.note(recorded);
        let is_taken = recorded == 0
            || self.goals.values().any(|goal| goal.number == recorded)
            || self.clock.goals.values().any(|due| due.number == recorded);
        if is_taken { self.numbers.next() } else { recorded }
    }
}

#[cfg(test)]
mod tests {
    use super::GoalNumbers;

    #[test]
    fn a_new_leader_continues_after_the_highest_number() {
        let mut numbers = GoalNumbers::default();
        assert_eq!([numbers.next(), numbers.next()], [1, 2]);
        numbers.note(7);
        numbers.note(3);
        assert_eq!(numbers.next(), 8);
        numbers.close();
        numbers.note(20);
        assert_eq!(numbers.next(), 0);
        numbers.open();
        assert_eq!(numbers.next(), 21);
    }
}
