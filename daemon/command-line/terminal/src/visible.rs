//! Makes control characters and misleading characters visible: a terminal executes control
//! characters, and characters that change the direction of the text or have no width mislead a
//! reader.
//!
//! - Control characters of ASCII are shown by their pictures (`␛`), all other such characters by
//!   their numbers (`\u{9b}`).
//! - [`crate::output`] applies this to everything that is printed for people.
//! - Line breaks are kept in a text of several lines ([`text`]), and shown in a part of a line
//!   ([`line()`]): otherwise a text from outside could pretend to be a line of this program.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Makes the control characters and misleading characters in a text of several lines visible.
pub fn text(text: &str) -> Cow<'_, str> {
    shown(text, |c| c == '\n')
}

/// Makes the control characters and misleading characters in a part of a line visible, and line
/// breaks as well.
pub fn line(text: &str) -> Cow<'_, str> {
    shown(text, |_| false)
}

/// Makes control characters and misleading characters in the strings of a JSON text visible, by
/// JSON escapes. A JSON writer alone would escape fewer characters.
pub fn json(text: &str) -> Cow<'_, str> {
    if !has_hidden(text, |_| false) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_hidden(c) {
            let mut units = [0; 2];
            for unit in c.encode_utf16(&mut units) {
                let _ = write!(shown, "\\u{unit:04x}");
            }
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

/// Makes misleading characters, and control characters beyond ASCII, visible without changing the
/// length of the text in bytes. Excerpts need this, because they are marked by byte offsets.
/// Control characters of ASCII stay, because the excerpt renderer makes them visible.
pub fn same_length(text: &str) -> Cow<'_, str> {
    let is_ours = |c: char| is_hidden(c) && !c.is_ascii();
    if !text.chars().any(is_ours) {
        return Cow::Borrowed(text);
    }
    let replaced = text.chars().map(|c| match (is_ours(c), c.len_utf8()) {
        (false, _) => c,
        (true, 2) => '\u{b7}',
        (true, 3) => char::REPLACEMENT_CHARACTER,
        (true, _) => '\u{1f6c7}',
    });
    Cow::Owned(replaced.collect())
}

/// Whether a text contains no character that would have to be made visible.
pub fn is_plain(text: &str) -> bool {
    !has_hidden(text, |_| false)
}

fn shown(text: &str, is_fine: impl Fn(char) -> bool + Copy) -> Cow<'_, str> {
    if !has_hidden(text, is_fine) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    let mut characters = text.chars().peekable();
    let mut before = None;
    while let Some(c) = characters.next() {
        if is_fine(c) || !is_deceptive(c, before, characters.peek().copied()) {
            shown.push(c);
        } else if let Some(picture) = picture(c) {
            shown.push(picture);
        } else {
            let _ = write!(shown, "\\u{{{:x}}}", c as u32);
        }
        before = Some(c);
    }
    Cow::Owned(shown)
}

fn has_hidden(text: &str, is_fine: impl Fn(char) -> bool) -> bool {
    text.chars().any(|c| is_hidden(c) && !is_fine(c))
}

/// Returns the picture of a control character of ASCII; `None` for other characters.
fn picture(c: char) -> Option<char> {
    match c {
        '\0'..='\u{1f}' => char::from_u32(0x2400 + c as u32),
        '\u{7f}' => Some('\u{2421}'),
        _ => None,
    }
}

/// Whether a character has to be made visible between the characters `before` and `after`. Joiners
/// are allowed between two characters beyond ASCII: words of some scripts and emoji of several
/// parts need them.
fn is_deceptive(c: char, before: Option<char>, after: Option<char>) -> bool {
    let is_joined = |c: Option<char>| c.is_some_and(|c| !c.is_ascii() && !is_hidden(c));
    match c {
        '\u{200c}' | '\u{200d}' => !(is_joined(before) && is_joined(after)),
        c => is_hidden(c),
    }
}

/// Whether a character is executed by a terminal or is invisible.
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c,
            // Soft hyphen, Arabic letter mark, Mongolian vowel separator, fillers of Hangul.
            '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{115f}' | '\u{1160}' | '\u{3164}' | '\u{ffa0}'
            // No width, joiners, marks of direction.
            | '\u{200b}'..='\u{200f}'
            // Ends of lines and paragraphs, embeddings and overrides of direction.
            | '\u{2028}'..='\u{202e}'
            // Word joiner, invisible operators, isolates of direction, deprecated characters.
            | '\u{2060}'..='\u{206f}'
            // Byte order mark, annotations within a line.
            | '\u{feff}' | '\u{fff9}'..='\u{fffb}'
            // Shorthand, music and tags without a picture of their own.
            | '\u{1bca0}'..='\u{1bca3}' | '\u{1d173}'..='\u{1d17a}' | '\u{e0000}'..='\u{e0fff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_made_visible() {
        assert_eq!(line("PIN \u{1b}]0;x\u{7}\u{9b}31m"), "PIN ␛]0;x␇\\u{9b}31m");
        assert_eq!(line("a\r\nb\tc\u{7f}"), "a␍␊b␉c␡");
        assert_eq!(text("a\r\nb"), "a␍\nb");
        for c in ('\0'..='\u{9f}').filter(|c| c.is_control()) {
            let shown = line(&c.to_string()).into_owned();
            assert!(!shown.chars().any(char::is_control), "{c:?}: {shown:?}");
        }
    }

    #[test]
    fn misleading_characters_are_made_visible() {
        for c in "\u{202a}\u{202e}\u{2066}\u{2069}\u{200e}\u{200f}\u{61c}\u{200b}\u{2028}\u{2029}\u{feff}\u{ad}\u{e0041}"
            .chars()
        {
            let inside = format!("office{c}1");
            assert_eq!(line(&inside), format!("office\\u{{{:x}}}1", c as u32));
        }
        assert_eq!(line("pay\u{200d}pal"), "pay\\u{200d}pal");
    }

    #[test]
    fn words_of_all_scripts_are_unchanged() {
        for word in [
            "Küche",
            "厨房",
            "кухня",
            "מטבח",
            "مطبخ",
            "می\u{200c}خواهم",
            "👨\u{200d}👩\u{200d}👧",
            "°C → ✗",
        ] {
            assert_eq!(line(word), word);
        }
    }

    #[test]
    fn json_shows_hidden_characters_as_escapes() {
        let said = "a\u{9b}b\u{202e}c\u{7f}\u{e0041}é";
        let json = json(&serde_json::to_string(said).expect("a text")).into_owned();
        assert!(json.chars().all(|c| !is_hidden(c)), "{json}");
        assert_eq!(serde_json::from_str::<String>(&json).expect("JSON"), said);
    }

    #[test]
    fn excerpts_keep_their_length() {
        let text = "a\u{9b}b\u{202e}c\u{e0041}d\u{1b}";
        let same = same_length(text);
        assert_eq!(same.len(), text.len());
        assert!(same.chars().all(|c| c.is_ascii() || !is_hidden(c)), "{same}");
    }
}
