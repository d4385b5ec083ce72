//! Collects what would be printed to the standard streams while a screen is shown, such as lines of
//! the log, so that they do not destroy it. The last lines are printed when the screen is left.

use std::collections::VecDeque;
use std::sync::mpsc;
use std::thread::JoinHandle;

use terminal::output;

/// Maximum number of texts that are kept; the oldest go first.
const KEPT_MAX: usize = 20;

/// The thread that collects.
pub(super) struct NoteCollector {
    collected: JoinHandle<VecDeque<String>>,
}

impl NoteCollector {
    /// Starts to collect.
    pub(super) fn start() -> NoteCollector {
        let (printer, texts) = mpsc::channel();
        output::set_prompt(Some(printer));
        NoteCollector { collected: std::thread::spawn(move || last(&texts)) }
    }

    /// Stops to collect, and prints the last texts.
    pub(super) fn finish(self) {
        // The thread ends, because this drops the only sender.
        output::set_prompt(None);
        for text in self.collected.join().unwrap_or_default() {
            output::print_note(text.trim_end_matches('\n'));
        }
    }
}

/// Receives all texts, and returns the last ones.
fn last(texts: &mpsc::Receiver<String>) -> VecDeque<String> {
    let mut kept = VecDeque::new();
    for text in texts {
        if kept.len() == KEPT_MAX {
            kept.pop_front();
        }
        kept.push_back(text);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_texts_are_kept() {
        let (printer, texts) = mpsc::channel();
        (0..KEPT_MAX + 5).for_each(|number| printer.send(number.to_string()).expect("received"));
        drop(printer);
        let kept = last(&texts);
        assert_eq!((kept.len(), kept.front().map(String::as_str)), (KEPT_MAX, Some("5")));
    }
}
