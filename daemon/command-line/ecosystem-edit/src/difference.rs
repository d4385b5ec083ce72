//! The difference of two texts, as people read it.

use similar::TextDiff;

/// Number of unchanged lines that are shown around a change.
const CONTEXT_LINES: usize = 3;

/// Returns the unified difference of two texts of the file `name`; empty if the texts are equal.
pub fn unified_difference(name: &str, old: &str, new: &str) -> String {
    if old == new {
        return String::new();
    }
    let difference = TextDiff::from_lines(old, new);
    let mut unified = difference.unified_diff();
    unified.context_radius(CONTEXT_LINES).header(name, name).to_string()
}
