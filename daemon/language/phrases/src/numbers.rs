//! Numbers: finds numbers that are written as in another language, and writes them correctly.

use pddl::Span;

use crate::nearest;
use crate::not_understood::NotUnderstood;
use crate::reading::PhraseReader;
use crate::token::Token;

/// Returns the number at the start of a word, and the rest of the word.
pub(crate) fn split(word: &str) -> (&str, &str) {
    let is_inner = |c: char| c.is_ascii_digit() || "+-−.,".contains(c);
    let length = word.find(|c| !is_inner(c)).unwrap_or(word.len());
    word.split_at(length)
}

/// Reads a number with the mark `decimal` before its fraction; `None` if it is none.
pub(crate) fn read(digits: &str, decimal: char) -> Option<f64> {
    let other = if decimal == ',' { '.' } else { ',' };
    if digits.contains(other) {
        return None;
    }
    let plain = digits.replace('−', "-").replace(decimal, ".");
    plain.parse::<f64>().ok().filter(|number| number.is_finite())
}

/// Returns the answer to the first number of a sentence that is written wrongly; `None` if there is
/// none, or if the sentence is not understood with a correct number either.
pub(crate) fn refuse(reader: &PhraseReader<'_>, start: usize, end: usize) -> Option<NotUnderstood> {
    let decimal = reader.book.grammar.decimal;
    let tokens = reader.tokens.get(start..end)?;
    let is_wrong = |token: &&Token<'_>| {
        let digits = split(token.text).0;
        token.is_word()
            && digits.contains(|c: char| c.is_ascii_digit())
            && read(digits, decimal).is_none()
            && reader.term(token).is_none()
    };
    let token = tokens.iter().find(is_wrong)?;
    let (digits, unit) = split(token.text);
    let meant = meant(digits, decimal);
    let first = meant.first()?;
    let mark = if decimal == ',' { "comma" } else { "point" };
    let rule = match digits.matches(['.', ',']).count() {
        _ if has_inner_sign(digits) => "one number is written here",
        _ if !first.contains(decimal) => "numbers have no mark between thousands",
        1 => "numbers have a MARK",
        _ => "numbers have at most one MARK, and no other mark",
    };
    let rule = rule.replace("MARK", mark);
    let language = reader.book.language.name();
    let why = format!("`{digits}` is no number in {language}; {rule} (`{first}`)");
    let span = Span::new(token.start, token.start + digits.len());
    let mut answer = NotUnderstood::new(span, why);
    let to = token.start + token.text.len();
    for number in &meant {
        let text = reader.replaced(token.start, to, &format!("{number}{unit}"));
        answer.nearest.extend(nearest::mended(reader, &text));
    }
    answer.nearest.truncate(reader.suggested_max());
    answer.is_near = !answer.nearest.is_empty();
    answer.is_near.then_some(answer)
}

fn has_inner_sign(digits: &str) -> bool {
    digits.char_indices().any(|(at, c)| at > 0 && "+-−".contains(c))
}

/// Returns the numbers that are probably meant, with the mark `decimal`, the most probable one first.
fn meant(digits: &str, decimal: char) -> Vec<String> {
    let digits = digits.replace('−', "-");
    let sign_length = digits.find(|c: char| !"+-".contains(c)).unwrap_or(digits.len());
    let (signs, rest) = digits.split_at(sign_length);
    let sign = if signs.ends_with('-') { "-" } else { "" };
    let rest = rest.split(['+', '-']).next().unwrap_or_default().trim_end_matches(['.', ',']);
    let marks: Vec<char> = rest.chars().filter(|c| ".,".contains(*c)).collect();
    let groups: Vec<&str> = rest.split(['.', ',']).collect();
    let whole = |group: &str| if group.is_empty() { "0".to_owned() } else { group.to_owned() };
    let with_fraction = |before: &[&str], fraction: &str| {
        format!("{sign}{}{decimal}{fraction}", whole(&before.concat()))
    };
    // Groups of three digits are thousands: `1,000` or `1.000.000`.
    let are_thousands = |groups: &[&str]| {
        let (Some((first, others)), true) = (groups.split_first(), groups.len() > 1) else {
            return false;
        };
        (1..=3).contains(&first.len()) && others.iter().all(|group| group.len() == 3)
    };
    let mut numbers = Vec::new();
    let is_one_mark = marks.windows(2).all(|pair| pair[0] == pair[1]);
    if is_one_mark && are_thousands(&groups) {
        numbers.push(format!("{sign}{}", groups.concat()));
    }
    match (groups.as_slice(), marks.as_slice()) {
        ([only], _) => numbers.push(format!("{sign}{only}")),
        ([one, fraction], _) => numbers.push(with_fraction(&[one], fraction)),
        ([before @ .., fraction], [others @ .., last])
            if !others.contains(last) && are_thousands(before) =>
        {
            numbers.push(with_fraction(before, fraction));
        }
        ([one, fraction, ..], _) if numbers.is_empty() => {
            numbers.push(with_fraction(&[one], fraction));
        }
        _ => (),
    }
    numbers.retain(|number| read(number, decimal).is_some());
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mark_of_another_language_is_no_part_of_a_number() {
        for (digits, decimal, expected) in [
            ("21.5", '.', Some(21.5)),
            ("21,5", ',', Some(21.5)),
            ("−3", ',', Some(-3.0)),
            ("21.5", ',', None),
            ("1.000", ',', None),
            ("1,000", '.', None),
        ] {
            assert_eq!(read(digits, decimal), expected, "{digits}");
        }
    }

    #[test]
    fn the_number_that_is_meant_is_written_with_the_mark_of_the_language() {
        let check = |digits: &str, decimal: char, expected: &[&str]| {
            assert_eq!(meant(digits, decimal), expected, "{digits}");
        };
        check("21,5", '.', &["21.5"]);
        check("-0,75", '.', &["-0.75"]);
        check(",5", '.', &["0.5"]);
        check("21.5.1", '.', &["21.5"]);
        check("21,5,1", ',', &["21,5"]);
        check("1,000", '.', &["1000", "1.000"]);
        check("1,000,000", '.', &["1000000"]);
        check("1,000.5", '.', &["1000.5"]);
        check("1.000,5", ',', &["1000,5"]);
        check("1.000,5", '.', &["1000.5"]);
        check("21-23", '.', &["21"]);
        check("..", '.', &[]);
        check("--", ',', &[]);
    }
}
