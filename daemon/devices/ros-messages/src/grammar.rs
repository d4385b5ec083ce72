//! The grammar of one line of a definition: a field, a constant, or the separator `---`.
//!
//! ROS ends a line at the first `#`, even within quotes.

use nom::branch::alt;
use nom::bytes::complete::{tag, take_while, take_while1};
use nom::character::complete::{char, space0};
use nom::combinator::{eof, map, opt};
use nom::error::{ErrorKind, ParseError};
use nom::sequence::{delimited, preceded};
use nom::{IResult, Parser};
use serde_json::Value;

use crate::names;
use crate::structure::{FieldArity, FieldElement, MessageField, PrimitiveType};
use crate::values::{float_value, little_endian, whole_value};

/// One line of a definition.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Statement {
    /// A line with at most blanks and a comment.
    Blank,
    /// The line between the parts of a service or an action.
    Separator,
    /// A field; its place is not set yet.
    Field(MessageField),
    Constant(String, Value),
}

/// A mistake in a line: its place, and its correction.
#[derive(Clone, Debug)]
pub(crate) struct GrammarMistake<'a> {
    /// The rest of the line from the mistake on.
    pub(crate) at: &'a str,
    /// The wrong text.
    pub(crate) found: &'a str,
    pub(crate) problem: String,
}

type GrammarResult<'a, T> = IResult<&'a str, T, GrammarMistake<'a>>;

impl<'a> ParseError<&'a str> for GrammarMistake<'a> {
    fn from_error_kind(input: &'a str, _: ErrorKind) -> GrammarMistake<'a> {
        mistake(input, "a line is a field such as `float64 x`, or a constant such as `uint8 OK=0`")
    }

    fn append(_: &'a str, _: ErrorKind, other: GrammarMistake<'a>) -> GrammarMistake<'a> {
        other
    }
}

/// Returns a mistake about the first word of `at`.
fn mistake(at: &str, problem: impl Into<String>) -> GrammarMistake<'_> {
    let end = at.find(char::is_whitespace).unwrap_or(at.len());
    GrammarMistake { at, found: &at[..end], problem: problem.into() }
}

/// Returns a mistake about all of `at`.
fn mistake_of_all(at: &str, problem: impl Into<String>) -> GrammarMistake<'_> {
    GrammarMistake { at, found: at, problem: problem.into() }
}

fn fail<T>(mistake: GrammarMistake<'_>) -> GrammarResult<'_, T> {
    Err(nom::Err::Failure(mistake))
}

/// Reads one line of a definition of `package`, and ignores its comment.
pub(crate) fn statement<'a>(line: &'a str, package: &str) -> Result<Statement, GrammarMistake<'a>> {
    let text = line.split('#').next().unwrap_or_default().trim_end();
    let parsed = alt((
        map((space0, eof), |_| Statement::Blank),
        map((space0, tag("---"), eof), |_| Statement::Separator),
        preceded(space0, |input| declaration(input, package)),
    ))
    .parse(text);
    match parsed {
        Ok((_, statement)) => Ok(statement),
        Err(nom::Err::Error(mistake) | nom::Err::Failure(mistake)) => Err(mistake),
        Err(nom::Err::Incomplete(_)) => Err(mistake_of_all(text, "the line is incomplete")),
    }
}

/// Reads a field or a constant to the end of the line.
fn declaration<'a>(input: &'a str, package: &str) -> GrammarResult<'a, Statement> {
    let (rest, (element, arity)) = field_type(input, package)?;
    let (rest, blanks) = space0(rest)?;
    if blanks.is_empty() || rest.is_empty() {
        let found = if rest.is_empty() { input } else { rest };
        return fail(mistake(found, "a blank and a name follow the type, as in `float64 x`"));
    }
    let (after, name) = take_while(|letter| !" \t=".contains(letter))(rest)?;
    let (value, equals) = preceded(space0, opt(char('='))).parse(after)?;
    let (value, _) = space0(value)?;
    if equals.is_some() {
        return constant(input, rest, name, value, &element, arity);
    }
    if !names::is_field(name) {
        let problem = "the name of a field has small letters, digits and single underscores, \
                       begins with a letter and does not end with an underscore";
        return fail(mistake(rest, problem));
    }
    let default = if value.is_empty() { None } else { Some(default(value, &element, arity)?) };
    let field = MessageField { default, ..MessageField::added(name, element, arity) };
    Ok(("", Statement::Field(field)))
}

fn constant<'a>(
    line: &'a str,
    name_at: &'a str,
    name: &str,
    value: &'a str,
    element: &FieldElement,
    arity: FieldArity,
) -> GrammarResult<'a, Statement> {
    let is_scalar = match element {
        FieldElement::Primitive(_) => true,
        FieldElement::String(bound) | FieldElement::WideString(bound) => bound.is_none(),
        FieldElement::Nested(_) => false,
    };
    if !is_scalar || arity != FieldArity::One {
        let problem = "a constant has a number, `bool`, `string` or `wstring` as its type";
        return fail(mistake(line, problem));
    }
    if !names::is_constant(name) {
        let problem = "the name of a constant has capital letters, digits and single underscores, \
                       begins with a letter and does not end with an underscore";
        return fail(mistake(name_at, problem));
    }
    if value.is_empty() {
        return fail(mistake(name_at, "a value follows `=`, as in `uint8 OK=0`"));
    }
    match scalar(value, element) {
        Ok(value) => Ok(("", Statement::Constant(name.to_owned(), value))),
        Err(problem) => fail(mistake_of_all(value, problem)),
    }
}

// === types ===

/// Reads a type such as `string<=10[3]`.
fn field_type<'a>(input: &'a str, package: &str) -> GrammarResult<'a, (FieldElement, FieldArity)> {
    let is_part = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '/';
    let (rest, base) = take_while1(is_part)(input)?;
    let (rest, bound) = opt(preceded(tag("<="), size)).parse(rest)?;
    let element = match element(base, bound, package) {
        Ok(element) => element,
        Err(problem) => return fail(mistake(input, problem)),
    };
    let inside = map((opt(tag("<=")), opt(size)), |(is_bound, size)| (is_bound.is_some(), size));
    let (after, arity) = opt(delimited(char('['), inside, char(']'))).parse(rest)?;
    let arity = match arity {
        None if rest.starts_with('[') => {
            return fail(mistake(rest, "an array is `[3]`, `[<=3]` or `[]`"));
        }
        None => FieldArity::One,
        Some((false, None)) => FieldArity::Sequence,
        Some((false, Some(size))) => FieldArity::Array(size),
        Some((true, Some(bound))) => FieldArity::BoundedSequence(bound),
        Some((true, None)) => return fail(mistake(rest, "a number follows `<=`, as in `[<=3]`")),
    };
    Ok((after, (element, arity)))
}

/// Reads the size of an array, or a bound.
fn size(input: &str) -> GrammarResult<'_, u32> {
    let (rest, digits) =
        take_while1(|letter: char| letter.is_ascii_alphanumeric() || letter == '-')(input)?;
    match digits.parse() {
        Ok(size) if size > 0 => Ok((rest, size)),
        _ => fail(GrammarMistake {
            at: input,
            found: digits,
            problem: format!("a size is a whole number from 1 to {}", u32::MAX),
        }),
    }
}

fn element(base: &str, bound: Option<u32>, package: &str) -> Result<FieldElement, String> {
    match base {
        "string" => return Ok(FieldElement::String(bound)),
        "wstring" => return Ok(FieldElement::WideString(bound)),
        _ if bound.is_some() => {
            let problem = format!(
                "only strings have a bound; `{base}[<=N]` is a sequence of at most N elements"
            );
            return Err(problem);
        }
        "time" => return Err("ROS 2 spells this type `builtin_interfaces/Time`".to_owned()),
        "duration" => return Err("ROS 2 spells this type `builtin_interfaces/Duration`".to_owned()),
        // As in ROS 1, the name needs no package: no package but `std_msgs` has a type of this
        // name.
        "Header" => return Ok(FieldElement::Nested("std_msgs/msg/Header".to_owned())),
        _ => {}
    }
    if let Some(primitive) = PrimitiveType::named(base) {
        return Ok(FieldElement::Primitive(primitive));
    }
    let parts: Vec<_> = base.split('/').collect();
    let (package, name) = match *parts {
        [name] => (package, name),
        [package, name] | [package, "msg", name] => (package, name),
        _ => return Err("the name of a message is `package/Name`".to_owned()),
    };
    if !names::is_package(package) || !names::is_type(name) {
        return Err("a type is `bool`, `byte`, `char`, `int8` to `int64`, `uint8` to `uint64`, \
                    `float32`, `float64`, `string`, `wstring`, or the name of a message such as \
                    `Pose` or `geometry_msgs/Pose`"
            .to_owned());
    }
    Ok(FieldElement::Nested(format!("{package}/msg/{name}")))
}

// === values ===

/// Reads a default value to the end of the line.
fn default<'a>(
    input: &'a str,
    element: &FieldElement,
    arity: FieldArity,
) -> Result<Value, nom::Err<GrammarMistake<'a>>> {
    let failure = |at, problem| nom::Err::Failure(mistake_of_all(at, problem));
    if let FieldElement::Nested(name) = element {
        let problem = format!("`{name}` has no default value; only numbers, `bool` and strings do");
        return Err(failure(input, problem));
    }
    if arity == FieldArity::One {
        return scalar(input, element).map_err(|problem| failure(input, problem));
    }
    let (_, elements) = array(input, element)?;
    let problem = match arity {
        FieldArity::Array(size) if elements.len() != size as usize => {
            format!("the array has {size} elements, not {}", elements.len())
        }
        FieldArity::BoundedSequence(bound) if elements.len() > bound as usize => {
            format!("the sequence has at most {bound} elements, not {}", elements.len())
        }
        _ => return Ok(Value::Array(elements)),
    };
    Err(failure(input, problem))
}

/// Reads the values of an array, such as `[1, 2]`.
fn array<'a>(input: &'a str, element: &FieldElement) -> GrammarResult<'a, Vec<Value>> {
    let problem = "a default value of an array is written as in `[1, 2, 3]`";
    let Some(mut rest) = input.strip_prefix('[').map(str::trim_start) else {
        return fail(mistake_of_all(input, problem));
    };
    let mut elements = Vec::new();
    if rest == "]" {
        return Ok(("", elements));
    }
    loop {
        let (after, text) = array_element(rest)?;
        match scalar(text, element) {
            Ok(value) => elements.push(value),
            Err(problem) => {
                return fail(GrammarMistake { at: rest, found: text, problem });
            }
        }
        let after = after.trim_start();
        if after == "]" {
            return Ok(("", elements));
        }
        let Some(next) = after.strip_prefix(',') else {
            return fail(mistake_of_all(if after.is_empty() { input } else { after }, problem));
        };
        rest = next.trim_start();
    }
}

/// Reads one element of an array, with its quotes.
fn array_element(input: &str) -> GrammarResult<'_, &str> {
    let Some(quote) = input.chars().next().filter(|first| ['"', '\''].contains(first)) else {
        let (rest, text) = take_while(|letter| !",]".contains(letter))(input)?;
        return Ok((rest, text.trim_end()));
    };
    let ends = input.char_indices().skip(1).filter(|(_, letter)| *letter == quote);
    let end = ends.map(|(end, _)| end).find(|end| !input[..*end].ends_with('\\'));
    match end {
        Some(end) => Ok((&input[end + 1..], &input[..=end])),
        None => {
            fail(mistake_of_all(input, format!("a text ends with {quote}, with which it begins")))
        }
    }
}

/// Returns the value that a text stands for. The error text says what is right.
fn scalar(text: &str, element: &FieldElement) -> Result<Value, String> {
    let (bound, length, unit) = match element {
        FieldElement::Primitive(primitive) => return number(text, *primitive),
        FieldElement::Nested(name) => return Err(format!("`{name}` has no such value")),
        FieldElement::String(bound) => (bound, unquoted(text)?.len(), "bytes"),
        FieldElement::WideString(bound) => {
            (bound, unquoted(text)?.encode_utf16().count(), "units of UTF-16")
        }
    };
    match bound {
        Some(bound) if length > *bound as usize => {
            Err(format!("the text has at most {bound} {unit}, not {length}"))
        }
        _ => unquoted(text).map(Value::String),
    }
}

/// Returns a text without the quotes around it. A text may have none.
fn unquoted(text: &str) -> Result<String, String> {
    for quote in ['"', '\''] {
        let inner = text.strip_prefix(quote).and_then(|rest| rest.strip_suffix(quote));
        let Some(inner) = inner else { continue };
        let escaped = format!("\\{quote}");
        if inner.replace(&escaped, "").contains(quote) {
            return Err(format!("a {quote} within the text is written as {escaped}"));
        }
        return Ok(inner.replace(&escaped, &quote.to_string()));
    }
    Ok(text.to_owned())
}

/// Returns the number or truth value that a text stands for. The error text says what is right.
fn number(text: &str, primitive: PrimitiveType) -> Result<Value, String> {
    let value = match primitive {
        PrimitiveType::Bool => match text.to_ascii_lowercase().as_str() {
            "true" | "1" => Some(Value::Bool(true)),
            "false" | "0" => Some(Value::Bool(false)),
            _ => None,
        },
        PrimitiveType::Float32 | PrimitiveType::Float64 => text.parse().ok().map(float_value),
        _ => whole(text).and_then(whole_value),
    };
    let is_fitting = |value: &Value| little_endian(primitive, value).is_some();
    value.filter(is_fitting).ok_or_else(|| format!("the value is {}", primitive.expectation()))
}

/// Returns the whole number that a text stands for: decimal, or with `0x`, `0o` or `0b`. Returns
/// `None` if it stands for none.
fn whole(text: &str) -> Option<i128> {
    let (is_negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let lower = digits.to_ascii_lowercase();
    let radixes = [("0x", 16), ("0o", 8), ("0b", 2)];
    let prefixed =
        radixes.iter().find_map(|(prefix, radix)| Some((lower.strip_prefix(prefix)?, *radix)));
    let (digits, radix) = prefixed.unwrap_or((lower.as_str(), 10));
    if !digits.starts_with(|first: char| first.is_ascii_alphanumeric()) {
        return None;
    }
    let whole = i128::from_str_radix(digits, radix).ok()?;
    Some(if is_negative { -whole } else { whole })
}
