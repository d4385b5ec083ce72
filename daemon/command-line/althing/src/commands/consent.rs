//! Asks a person at the terminal to agree to something.

use std::io::{self, BufRead as _, IsTerminal as _};

use terminal::output;

/// Whether a person can be asked: the input is a terminal.
pub(super) fn can_ask() -> bool {
    io::stdin().is_terminal()
}

/// Asks a person at the terminal, and returns `true` if the answer is yes. Any other answer counts
/// as no.
pub(super) fn is_agreed(question: &str) -> bool {
    output::print_note(question);
    let mut answer = String::new();
    let heard = io::stdin().lock().read_line(&mut answer);
    let answer = answer.trim();
    heard.is_ok() && (answer.eq_ignore_ascii_case("y") || answer.eq_ignore_ascii_case("yes"))
}
