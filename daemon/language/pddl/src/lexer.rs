//! The lexer: splits a text into words and parentheses. Only this module handles single bytes.
//!
//! - The tokens are the input of `parentheses`, which builds the tree that `sexpr` gives access to.
//! - Every delimiter is ASCII, so the boundary between two tokens is always a character boundary.
//! - The lexer does not distinguish words: `:action`, `?x`, `5` and `-` are all symbols.

use nom::bytes::complete::{take, take_till, take_while};
use nom::combinator::{map, value};
use nom::{IResult, Parser};

/// The part of the text that has not been read.
pub(crate) type LexInput<'a> = &'a [u8];

type LexResult<'a, T> = IResult<LexInput<'a>, T, ()>;

/// One token, without its place. The place is the difference between the input before and after the
/// token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LexToken {
    Open,
    Close,
    /// A word with this number of bytes.
    Symbol(usize),
}

/// Reads one token: `BLANK* ( "(" | ")" | SYMBOL )`. Fails only at the end of the text.
pub(crate) fn token(input: LexInput<'_>) -> LexResult<'_, LexToken> {
    let (input, ()) = blanks(input)?;
    match input.first() {
        Some(b'(') => value(LexToken::Open, take(1usize)).parse(input),
        Some(b')') => value(LexToken::Close, take(1usize)).parse(input),
        Some(_) => {
            let length = word_length(input);
            map(take(length), |word: LexInput<'_>| LexToken::Symbol(word.len())).parse(input)
        }
        None => Err(nom::Err::Error(())),
    }
}

/// Returns the length of the word at the beginning of `input`. A question mark begins a variable
/// and ends the word before it: `aircraft?a` is two words.
fn word_length(input: LexInput<'_>) -> usize {
    let rest = input.iter().skip(1);
    1 + rest.take_while(|byte| !is_delimiter(**byte) && **byte != b'?').count()
}

/// Skips blanks and comments: `BLANK* = (SPACE | COMMENT)*`.
pub(crate) fn blanks(input: LexInput<'_>) -> LexResult<'_, ()> {
    let (mut input, _) = take_while(is_space).parse(input)?;
    while input.first() == Some(&b';') {
        (input, _) = comment(input)?;
        (input, _) = take_while(is_space).parse(input)?;
    }
    Ok((input, ()))
}

/// Skips a comment: `COMMENT = ";" up to the end of the line`.
fn comment(input: LexInput<'_>) -> LexResult<'_, LexInput<'_>> {
    take_till(|byte| byte == b'\n' || byte == b'\r').parse(input)
}

fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\n' | b'\r' | b'\x0b' | b'\x0c')
}

fn is_delimiter(byte: u8) -> bool {
    is_space(byte) || matches!(byte, b'(' | b')' | b';')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: &[LexToken]) {
        let mut rest = text.as_bytes();
        let mut tokens = Vec::new();
        while let Ok((left, token)) = token(rest) {
            tokens.push(token);
            rest = left;
        }
        assert_eq!(tokens, expected);
    }

    #[test]
    fn parentheses_need_no_space() {
        check(
            "(?x)a",
            &[LexToken::Open, LexToken::Symbol(2), LexToken::Close, LexToken::Symbol(1)],
        );
    }

    #[test]
    fn comments_end_with_their_line_and_end_a_word() {
        check("a;(\r\n;)\rb;", &[LexToken::Symbol(1), LexToken::Symbol(1)]);
    }

    #[test]
    fn a_variable_may_follow_a_word_without_space() {
        check(
            "(at?x?yz)",
            &[
                LexToken::Open,
                LexToken::Symbol(2),
                LexToken::Symbol(2),
                LexToken::Symbol(3),
                LexToken::Close,
            ],
        );
    }

    #[test]
    fn words_of_any_script_are_symbols() {
        check("büro-2 (", &[LexToken::Symbol("büro-2".len()), LexToken::Open]);
    }
}
