//! Splits a text into words, commas, colons, and PDDL in parentheses.

use pddl::Span;

/// The kind of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TokenKind {
    Word,
    /// PDDL from `(` to its `)`.
    Embedded,
    /// A `(` without its `)`, with the rest of the text.
    Unclosed,
    Comma,
    Colon,
}

/// A token of a text, with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Token<'t> {
    pub(crate) kind: TokenKind,
    pub(crate) text: &'t str,
    /// The text in lower case, in which words are compared.
    pub(crate) lower: String,
    pub(crate) start: usize,
}

// === impl Token ===

impl<'t> Token<'t> {
    fn new(kind: TokenKind, whole: &'t str, start: usize, end: usize) -> Token<'t> {
        let text = &whole[start..end];
        Token { kind, text, lower: text.to_lowercase(), start }
    }

    pub(crate) fn span(&self) -> Span {
        Span::new(self.start, self.start + self.text.len())
    }

    pub(crate) fn is_word(&self) -> bool {
        self.kind == TokenKind::Word
    }
}

/// Splits a text into tokens.
pub(crate) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        if first.is_whitespace() {
            at += first.len_utf8();
        } else if first == '(' {
            let (kind, end) = match closing(&text[at..]) {
                Some(length) => (TokenKind::Embedded, at + length),
                None => (TokenKind::Unclosed, text.len()),
            };
            tokens.push(Token::new(kind, text, at, end));
            at = end;
        } else {
            let end = text[at..].find(char::is_whitespace).map_or(text.len(), |length| at + length);
            word(text, at, end, &mut tokens);
            at = end;
        }
    }
    tokens
}

/// Appends the word `start..end` without the comma or colon at its end, and then that one.
fn word<'t>(text: &'t str, start: usize, end: usize, tokens: &mut Vec<Token<'t>>) {
    let is_last = text[end..].trim().is_empty();
    let written = &text[start..end];
    let bare = match written.strip_suffix('.') {
        // The period of a sentence; `...` keeps its own.
        Some(bare) if is_last && !bare.is_empty() && !bare.ends_with('.') => bare,
        _ => written,
    };
    let inner = bare.trim_end_matches([',', ':']);
    if !inner.is_empty() {
        tokens.push(Token::new(TokenKind::Word, text, start, start + inner.len()));
    }
    for (offset, mark) in bare[inner.len()..].char_indices() {
        let kind = if mark == ',' { TokenKind::Comma } else { TokenKind::Colon };
        let at = start + inner.len() + offset;
        tokens.push(Token::new(kind, text, at, at + mark.len_utf8()));
    }
}

/// Returns the length of the expression that `text` begins with; `None` if it is not closed.
fn closing(text: &str) -> Option<usize> {
    let mut depth = 0_usize;
    for (at, character) in text.char_indices() {
        match character {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => continue,
        }
        if depth == 0 {
            return Some(at + 1);
        }
    }
    None
}

/// Returns the share of the letters by which two words differ.
pub(crate) fn letter_distance(one: &str, other: &str) -> f64 {
    if one == other { 0.0 } else { 1.0 - strsim::normalized_damerau_levenshtein(one, other) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: &[&str]) {
        let found = tokens(text);
        assert_eq!(found.iter().map(|token| token.text).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn a_text_is_split_at_white_space_and_marks() {
        check("", &[]);
        check(" a  b, and c.", &["a", "b", ",", "and", "c"]);
        check("for every room r: 21,5 °C", &["for", "every", "room", "r", ":", "21,5", "°C"]);
        check("below 60 %.", &["below", "60", "%"]);
        check("above 21.5.", &["above", "21.5"]);
        check("and so on ...", &["and", "so", "on", "..."]);
        check("(or (a) (b)) and c", &["(or (a) (b))", "and", "c"]);
        check("a (b", &["a", "(b"]);
        check(", :", &[",", ":"]);
        check(") a", &[")", "a"]);
    }
}
