//! Characters that look like others, or cannot be seen.
//!
//! - Word processors, web pages and chats put them into texts: a dash for a hyphen, a no-break space
//!   for a space, a mark without width.
//! - `parentheses` reports each of them at its place, and reads the text as if the author had written
//!   what was meant, so that one character causes one message.
//! - Letters of all scripts are allowed in names, also those that look like Latin letters.

use crate::diagnostic::Diagnostic;
use crate::tree::Span;

/// What a character that has no meaning in PDDL stands for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lookalike {
    /// It looks like a space, and is read as one.
    Space,
    /// It looks like a hyphen.
    Dash,
    /// It cannot be seen.
    Invisible,
    /// It is a quotation mark, which PDDL does not have.
    Quote,
    /// It looks like this ASCII character.
    Wide(char),
}

/// Spaces that are none in PDDL, with their names in Unicode.
const SPACES: &[(char, &str)] = &[
    ('\u{85}', "next line"),
    ('\u{a0}', "no-break space"),
    ('\u{1680}', "Ogham space mark"),
    ('\u{2000}', "en quad"),
    ('\u{2001}', "em quad"),
    ('\u{2002}', "en space"),
    ('\u{2003}', "em space"),
    ('\u{2004}', "three-per-em space"),
    ('\u{2005}', "four-per-em space"),
    ('\u{2006}', "six-per-em space"),
    ('\u{2007}', "figure space"),
    ('\u{2008}', "punctuation space"),
    ('\u{2009}', "thin space"),
    ('\u{200a}', "hair space"),
    ('\u{2028}', "line separator"),
    ('\u{2029}', "paragraph separator"),
    ('\u{202f}', "narrow no-break space"),
    ('\u{205f}', "medium mathematical space"),
    ('\u{3000}', "ideographic space"),
];

const DASHES: &[(char, &str)] = &[
    ('\u{2010}', "hyphen"),
    ('\u{2011}', "non-breaking hyphen"),
    ('\u{2012}', "figure dash"),
    ('\u{2013}', "en dash"),
    ('\u{2014}', "em dash"),
    ('\u{2015}', "horizontal bar"),
    ('\u{2212}', "minus sign"),
    ('\u{fe58}', "small em dash"),
    ('\u{fe63}', "small hyphen-minus"),
    ('\u{ff0d}', "fullwidth hyphen-minus"),
];

const INVISIBLE: &[(char, &str)] = &[
    ('\u{ad}', "soft hyphen"),
    ('\u{180e}', "Mongolian vowel separator"),
    ('\u{200b}', "zero width space"),
    ('\u{200c}', "zero width non-joiner"),
    ('\u{200d}', "zero width joiner"),
    ('\u{200e}', "left-to-right mark"),
    ('\u{200f}', "right-to-left mark"),
    ('\u{202a}', "left-to-right embedding"),
    ('\u{202b}', "right-to-left embedding"),
    ('\u{202c}', "pop directional formatting"),
    ('\u{202d}', "left-to-right override"),
    ('\u{202e}', "right-to-left override"),
    ('\u{2060}', "word joiner"),
    ('\u{2061}', "function application"),
    ('\u{2062}', "invisible times"),
    ('\u{2063}', "invisible separator"),
    ('\u{2064}', "invisible plus"),
    ('\u{2066}', "left-to-right isolate"),
    ('\u{2067}', "right-to-left isolate"),
    ('\u{2068}', "first strong isolate"),
    ('\u{2069}', "pop directional isolate"),
    ('\u{feff}', "byte order mark"),
];

const QUOTES: &[(char, &str)] = &[
    ('\u{ab}', "left-pointing double angle quotation mark"),
    ('\u{bb}', "right-pointing double angle quotation mark"),
    ('\u{2018}', "left single quotation mark"),
    ('\u{2019}', "right single quotation mark"),
    ('\u{201a}', "single low-9 quotation mark"),
    ('\u{201b}', "single high-reversed-9 quotation mark"),
    ('\u{201c}', "left double quotation mark"),
    ('\u{201d}', "right double quotation mark"),
    ('\u{201e}', "double low-9 quotation mark"),
    ('\u{201f}', "double high-reversed-9 quotation mark"),
    ('\u{2039}', "single left-pointing angle quotation mark"),
    ('\u{203a}', "single right-pointing angle quotation mark"),
];

/// Wide forms of the signs of PDDL, each with the sign that it looks like.
const WIDE: &[(char, &str, char)] = &[
    ('\u{ff08}', "fullwidth left parenthesis", '('),
    ('\u{ff09}', "fullwidth right parenthesis", ')'),
    ('\u{ff0b}', "fullwidth plus sign", '+'),
    ('\u{ff0a}', "fullwidth asterisk", '*'),
    ('\u{ff0f}', "fullwidth solidus", '/'),
    ('\u{ff1a}', "fullwidth colon", ':'),
    ('\u{ff1b}', "fullwidth semicolon", ';'),
    ('\u{ff1c}', "fullwidth less-than sign", '<'),
    ('\u{ff1d}', "fullwidth equals sign", '='),
    ('\u{ff1e}', "fullwidth greater-than sign", '>'),
    ('\u{ff1f}', "fullwidth question mark", '?'),
    ('\u{ff3f}', "fullwidth low line", '_'),
];

/// Returns what the character between `before` and `after` stands for, with its name in Unicode;
/// `None` if it may be a part of a word.
pub(crate) fn lookalike(
    before: Option<char>,
    character: char,
    after: Option<char>,
) -> Option<(Lookalike, &'static str)> {
    // Words of some scripts are written with a joiner, and others with an apostrophe.
    let is_foreign = |c: Option<char>| c.is_some_and(|c| c.is_alphabetic() && !c.is_ascii());
    if matches!(character, '\u{200c}' | '\u{200d}' | '\u{2019}')
        && is_foreign(before)
        && is_foreign(after)
    {
        return None;
    }
    let tables = [
        (SPACES, Lookalike::Space),
        (DASHES, Lookalike::Dash),
        (INVISIBLE, Lookalike::Invisible),
        (QUOTES, Lookalike::Quote),
    ];
    let mut found = tables.into_iter().filter_map(|(table, kind)| {
        table.iter().find(|(known, _)| *known == character).map(|(_, name)| (kind, *name))
    });
    let wide = || {
        let sign = WIDE.iter().find(|(known, ..)| *known == character)?;
        Some((Lookalike::Wide(sign.2), sign.1))
    };
    found.next().or_else(wide)
}

/// Returns the error for a character that stands at the offset `start`.
pub(crate) fn mistake(start: usize, character: char, kind: Lookalike, name: &str) -> Diagnostic {
    let code = u32::from(character);
    let place = Span::new(start, start + character.len_utf8());
    let (said, help) = match kind {
        Lookalike::Space => ("is no space in PDDL", "write a space".to_owned()),
        Lookalike::Dash => ("is no `-`", "write `-`".to_owned()),
        Lookalike::Invisible => ("cannot be seen", "remove it".to_owned()),
        Lookalike::Quote => ("has no place in PDDL", "write names without quotes".to_owned()),
        Lookalike::Wide(sign) => ("is no sign of PDDL", format!("write `{sign}`")),
    };
    Diagnostic::error(place, format!("U+{code:04X} ({name}) {said}")).with_help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joiner_or_an_apostrophe_within_a_word_of_another_script_is_allowed() {
        for mark in ['\u{200c}', '\u{200d}', '\u{2019}'] {
            assert!(lookalike(Some('м'), mark, Some('я')).is_none());
            assert!(lookalike(Some('m'), mark, Some('я')).is_some());
            assert!(lookalike(Some('м'), mark, None).is_some());
        }
    }

    #[test]
    fn each_character_is_in_one_table() {
        let listed = [SPACES, DASHES, INVISIBLE, QUOTES].concat();
        let wide = WIDE.iter().map(|(known, ..)| *known);
        let mut all: Vec<char> = listed.iter().map(|(known, _)| *known).chain(wide).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
        assert!(all.iter().all(|known| !known.is_ascii() && !known.is_alphanumeric()));
    }
}
