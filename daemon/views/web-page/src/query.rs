//! The query of a target: `a=b&c=d`, with `%` and `+` (URL Standard, “application/x-www-form-
//! urlencoded parsing”).

use axum::http::StatusCode;

use crate::answer::Refused;

/// Maximum number of parameters.
const PARAMETERS_MAX: usize = 32;

/// Parses a query.
///
/// # Errors
///
/// Returns a refusal if the query is no UTF-8 or has too many parameters.
pub(crate) fn parse(query: &str) -> Result<Vec<(String, String)>, Refused> {
    let wrong = |problem: &str| Refused::new(StatusCode::BAD_REQUEST, problem);
    let mut parameters = Vec::new();
    for part in query.split('&').filter(|part| !part.is_empty()) {
        if parameters.len() >= PARAMETERS_MAX {
            return Err(wrong("the query has too many parameters"));
        }
        let (name, value) = part.split_once('=').unwrap_or((part, ""));
        let text = |text| decoded(text).ok_or_else(|| wrong("the query is not UTF-8"));
        parameters.push((text(name)?, text(value)?));
    }
    Ok(parameters)
}

fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((first, after)) = rest.split_first() {
        rest = after;
        match first {
            b'+' => bytes.push(b' '),
            b'%' => match after.get(..2).and_then(hex_byte) {
                Some(byte) => {
                    bytes.push(byte);
                    rest = &after[2..];
                }
                None => bytes.push(b'%'),
            },
            byte => bytes.push(*byte),
        }
    }
    String::from_utf8(bytes).ok()
}

fn hex_byte(digits: &[u8]) -> Option<u8> {
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let [high, low] = digits else { return None };
    u8::try_from(digit(*high)? * 16 + digit(*low)?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_decoded() {
        let parsed = parse("topics=goal%3Ag+1%2Coverview&&a&b=%zz%4").expect("it is UTF-8");
        let pair = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        assert_eq!(
            parsed,
            [pair("topics", "goal:g 1,overview"), pair("a", ""), pair("b", "%zz%4")]
        );
        assert!(parse("a=%ff").is_err());
        assert!(parse(&"a=b&".repeat(40)).is_err());
    }
}
