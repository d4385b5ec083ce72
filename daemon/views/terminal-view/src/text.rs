//! Texts from outside, as cells of a terminal: what would hide, reorder or act is made visible, and
//! a text is cut and wrapped by the cells that it takes, never by its bytes.

use ratatui::style::Style;
use ratatui::text::Span;
use terminal::visible;
use unicode_width::UnicodeWidthStr;

/// Longest text that a page shows of one thing, in characters. The rest of a longer text is left
/// out, so that no sender makes a page slow.
const SHOWN_MAX: usize = 2_000;

/// Most characters that share one cell: letters with their accents need three or four, and texts
/// with hundreds of accents on one letter would cover their neighbors.
const CLUSTER_MAX: usize = 10;

/// Signs before words that say the same.
const SIGNS: &str = "✓✗!?~=–…◌▶■•◆★☆·∞";

/// Stands for what was left out.
const ELLIPSIS: &str = "…";

/// Returns a text from outside as one line that acts on no terminal.
pub(crate) fn clean(text: &str) -> String {
    if text.len() <= SHOWN_MAX && is_simple(text) {
        return text.to_owned();
    }
    let short = match text.char_indices().nth(SHOWN_MAX) {
        Some((end, _)) => format!("{}{ELLIPSIS}", &text[..end]),
        None => text.to_owned(),
    };
    let visible = visible::line(&short);
    let span = Span::raw(visible.as_ref());
    let mut clean = String::with_capacity(visible.len());
    for cluster in clusters(&span) {
        // A cluster without a width of its own would slip into its neighbor's cell.
        if width(cluster) == 0 {
            cluster.chars().for_each(|c| clean.push_str(&format!("\\u{{{:x}}}", u32::from(c))));
        } else {
            clean.extend(cluster.chars().take(CLUSTER_MAX));
        }
    }
    clean
}

/// Whether each byte of a text takes one cell. Most texts are so, and tables have thousands.
fn is_simple(text: &str) -> bool {
    text.bytes().all(|byte| (b' '..=b'~').contains(&byte))
}

/// Returns the cells that a text takes.
pub(crate) fn width(text: &str) -> usize {
    if is_simple(text) { text.len() } else { text.width() }
}

/// Returns the parts of a text that are drawn as one.
fn clusters<'t>(span: &'t Span<'t>) -> impl Iterator<Item = &'t str> {
    span.styled_graphemes(Style::default()).map(|grapheme| grapheme.symbol)
}

/// Cuts a text to at most `columns` cells; a text that is cut ends in `…`.
pub(crate) fn cut(text: &str, columns: usize) -> String {
    if width(text) <= columns {
        return text.to_owned();
    }
    if columns == 0 {
        return String::new();
    }
    let mut cut = take(text, columns - 1).to_owned();
    cut.push_str(ELLIPSIS);
    cut
}

/// Returns the longest beginning of a text that takes at most `columns` cells.
pub(crate) fn take(text: &str, columns: usize) -> &str {
    if is_simple(text) {
        return &text[..columns.min(text.len())];
    }
    let span = Span::raw(text);
    let (mut used, mut end) = (0, 0);
    for cluster in clusters(&span) {
        used += width(cluster);
        if used > columns {
            break;
        }
        end = cluster.as_ptr().addr() - text.as_ptr().addr() + cluster.len();
    }
    &text[..end]
}

/// Breaks a text into lines of at most `columns` cells, at spaces where there are any.
pub(crate) fn wrap(text: &str, columns: usize) -> Vec<String> {
    let columns = columns.max(1);
    let mut lines = Vec::new();
    let mut line = String::new();
    for word in text.split(' ') {
        let mut word = word;
        if !line.is_empty() && width(&line) + 1 + width(word) > columns {
            lines.push(std::mem::take(&mut line));
        }
        while width(word) > columns {
            let head = take(word, columns);
            // A wide character in a terminal of one column: nothing of it fits.
            if head.is_empty() {
                word = "";
                break;
            }
            lines.push(head.to_owned());
            word = &word[head.len()..];
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    if !line.is_empty() || lines.is_empty() {
        lines.push(line);
    }
    lines
}

/// Returns a text without the sign before its first word, for saying it: the words say the same.
pub(crate) fn without_sign(text: &str) -> &str {
    let mut characters = text.chars();
    let is_sign = characters.next().is_some_and(|sign| SIGNS.contains(sign));
    match characters.as_str().strip_prefix(' ') {
        Some(words) if is_sign => words.trim_start(),
        _ => text,
    }
}

/// Whether a text has all words of a filter, in any order and letter case.
pub(crate) fn matches(text: &str, filter: &str) -> bool {
    let text = text.to_lowercase();
    filter.split_whitespace().all(|word| text.contains(&word.to_lowercase()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_text_is_cut_by_cells() {
        assert_eq!(cut("office1", 7), "office1");
        assert_eq!(cut("office1", 4), "off…");
        assert_eq!(cut("厨房の灯", 5), "厨房…");
        assert_eq!(cut("厨房の灯", 4), "厨…");
        assert_eq!(cut("e\u{301}e\u{301}e\u{301}", 2), "e\u{301}…");
        assert_eq!(cut("x", 0), "");
    }

    #[test]
    fn what_would_act_or_mislead_is_shown() {
        assert_eq!(clean("a\u{1b}[2Jb"), "a␛[2Jb");
        assert_eq!(clean("a\u{202e}b\nc"), "a\\u{202e}b␊c");
        assert_eq!(clean("\u{301}a"), "\\u{301}a");
        let tower = format!("a{}b", "\u{301}".repeat(500));
        assert_eq!(clean(&tower).chars().count(), CLUSTER_MAX + 1);
        assert!(clean(&"x".repeat(1_000_000)).len() < SHOWN_MAX + 10);
    }

    #[test]
    fn words_are_kept_together_where_they_fit() {
        assert_eq!(wrap("the goal holds", 8), ["the goal", "holds"]);
        assert_eq!(wrap("abcdefgh ij", 3), ["abc", "def", "gh", "ij"]);
        assert_eq!(wrap("", 5), [""]);
        assert_eq!(wrap("厨", 1), [""]);
    }

    #[test]
    fn a_filter_has_words_in_any_order() {
        assert!(matches("(known-temperature Office2) done", "DONE office2"));
        assert!(!matches("(known-temperature office2)", "office2 failed"));
        assert!(matches("x", ""));
    }

    proptest! {
        #[test]
        fn nothing_is_wider_than_asked(text in "\\PC{0,40}|.{0,40}", columns in 0..50_usize) {
            let clean = clean(&text);
            prop_assert!(!clean.chars().any(char::is_control));
            prop_assert!(width(&cut(&clean, columns)) <= columns);
            for line in wrap(&clean, columns) {
                prop_assert!(width(&line) <= columns.max(1));
            }
        }
    }
}
