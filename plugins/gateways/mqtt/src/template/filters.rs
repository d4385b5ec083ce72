//! Home Assistant's own filters and tests, and those of Jinja that Home Assistant redefines.

use minijinja::value::{Kwargs, Rest, Tuple, ValueKind, from_args};
use minijinja::{Environment, Error, State, Value};
use regex::{Regex, RegexBuilder};

use super::numbers::{PythonNumber, TEXT_BYTES_MAX, WEIGHT_OF_STEP, missing, weight, wrong};
use crate::naming::slug;

/// Maximum size of a compiled regular expression, in bytes; a larger one is an error.
const PATTERN_BYTES_MAX: usize = 1 << 18;

/// The arguments of a filter. The first argument is the value to which the filter is applied.
pub(super) struct FilterArguments<'g> {
    values: &'g [Value],
    named: Kwargs,
}

pub(super) type FilterFn = fn(&FilterArguments<'_>) -> Result<Value, Error>;

pub(super) type TestFn = fn(&FilterArguments<'_>) -> Result<bool, Error>;

/// The filters of this file. A template can also call them as functions.
pub(super) const FILTERS: &[(&str, FilterFn)] = &[
    ("float", float),
    ("int", int),
    ("round", round),
    ("bool", boolean),
    ("default", default),
    ("d", default),
    ("iif", iif),
    ("is_defined", is_defined),
    ("is_number", |given| Ok(is_number(given.value())?.into())),
    ("abs", abs),
    ("from_json", from_json),
    ("to_json", to_json),
    ("add", |given| of_two(given, |one, other| one + other)),
    ("multiply", |given| of_two(given, |one, other| one * other)),
    ("log", log),
    ("sqrt", |given| of_one(given, f64::sqrt)),
    ("sin", |given| of_one(given, f64::sin)),
    ("cos", |given| of_one(given, f64::cos)),
    ("tan", |given| of_one(given, f64::tan)),
    ("asin", |given| of_one(given, f64::asin)),
    ("acos", |given| of_one(given, f64::acos)),
    ("atan", |given| of_one(given, f64::atan)),
    ("average", average),
    ("median", median),
    ("bitwise_and", |given| of_bits(given, |one, other| one & other)),
    ("bitwise_or", |given| of_bits(given, |one, other| one | other)),
    ("bitwise_xor", |given| of_bits(given, |one, other| one ^ other)),
    ("ordinal", ordinal),
    ("slugify", slugify),
    ("contains", |given| Ok(is_in(given)?.into())),
    ("regex_match", |given| Ok(matches_at(given, true)?.into())),
    ("regex_search", |given| Ok(matches_at(given, false)?.into())),
    ("regex_replace", regex_replace),
    ("regex_findall", regex_findall),
    ("regex_findall_index", regex_findall_index),
];

/// The tests of this file: `odd` in `if count is odd` is a test.
pub(super) const TESTS: &[(&str, TestFn)] = &[
    ("match", |given| matches_at(given, true)),
    ("search", |given| matches_at(given, false)),
    ("contains", is_in),
    ("is_number", |given| is_number(given.value())),
    ("odd", |given| Ok(rest(given, 2)? == 1)),
    ("even", |given| Ok(rest(given, 2)? == 0)),
    ("sequence", |given| {
        Ok(matches!(given.value().kind(), ValueKind::String | ValueKind::Seq | ValueKind::Map))
    }),
    ("list", |given| Ok(given.value().kind() == ValueKind::Seq)),
];

pub(super) fn register(environment: &mut Environment<'_>) {
    for (name, filter) in FILTERS {
        environment.add_filter(*name, move |state: &State<'_, '_>, values: Rest<Value>| {
            pay(state, name, &values)?;
            filter(&FilterArguments::of(&values)?)
        });
    }
    // This is Jinja's own `format`, which does not check the length of its result.
    let jinja = Value::from_function(minijinja::filters::format);
    environment.add_filter("format", move |state: &mut State<'_, '_>, values: Rest<Value>| {
        formattable(&values, '%')?;
        jinja.call(state, &values)
    });
    for (name, test) in TESTS {
        environment.add_test(*name, move |state: &State<'_, '_>, values: Rest<Value>| {
            pay(state, name, &values)?;
            test(&FilterArguments::of(&values)?)
        });
    }
}

/// Charges the cost of a filter or a test to the budget of the rendering. The cost is that of the
/// length of its texts, and of compiling a regular expression, which happens at each use.
fn pay(state: &State<'_, '_>, name: &str, arguments: &[Value]) -> Result<(), Error> {
    const EXPRESSION: usize = 50;
    let bytes: usize = arguments.iter().filter_map(|one| one.as_str()).map(str::len).sum();
    let is_expression = name.starts_with("regex_") || matches!(name, "match" | "search");
    let steps = bytes / WEIGHT_OF_STEP + if is_expression { EXPRESSION } else { 0 };
    state.consume_fuel(u64::try_from(steps).unwrap_or(u64::MAX))
}

/// Applies a filter of this file; returns `None` if there is no such filter.
pub(super) fn applied(
    state: &State<'_, '_>,
    name: &str,
    arguments: &[Value],
) -> Option<Result<Value, Error>> {
    let (_, filter) = FILTERS.iter().find(|(known, _)| *known == name)?;
    if let Err(error) = pay(state, name, arguments) {
        return Some(Err(error));
    }
    Some(FilterArguments::of(arguments).and_then(|given| filter(&given)))
}

/// Applies a test of this file; returns `None` if there is no such test.
pub(super) fn tested(
    state: &State<'_, '_>,
    name: &str,
    arguments: &[Value],
) -> Option<Result<bool, Error>> {
    let (_, test) = TESTS.iter().find(|(known, _)| *known == name)?;
    if let Err(error) = pay(state, name, arguments) {
        return Some(Err(error));
    }
    Some(FilterArguments::of(arguments).and_then(|given| test(&given)))
}

/// Formats a value as Python prints it; an undefined value gives an empty text.
pub(super) fn printed(value: &Value) -> String {
    match PythonNumber::of(value) {
        _ if value.is_undefined() => String::new(),
        Some(PythonNumber::Real(real)) if real.is_nan() => "nan".to_owned(),
        Some(PythonNumber::Real(real)) if real.is_infinite() => {
            if real > 0.0 {
                "inf".to_owned()
            } else {
                "-inf".to_owned()
            }
        }
        _ => value.to_string(),
    }
}

impl<'g> FilterArguments<'g> {
    fn of(values: &'g [Value]) -> Result<FilterArguments<'g>, Error> {
        let (values, named) = from_args(values)?;
        Ok(FilterArguments { values, named })
    }

    fn value(&self) -> &Value {
        self.values.first().unwrap_or(&Value::UNDEFINED)
    }

    /// Returns an argument by its position (the value is at position 0) or by its name; `None` if
    /// the argument is missing.
    fn argument(&self, place: usize, name: &str) -> Option<Value> {
        let is_named = self.named.has(name);
        let named = || self.named.get::<Value>(name).ok().filter(|_| is_named);
        self.values.get(place).cloned().or_else(named).filter(|value| !value.is_undefined())
    }

    /// Returns the result, or the argument `default` if there is no result. Returns an error if
    /// there is neither, or if the value is undefined.
    fn or(&self, result: Option<Value>, place: usize, what: &str) -> Result<Value, Error> {
        if self.value().is_undefined() {
            return Err(missing());
        }
        match (result, self.argument(place, "default")) {
            (Some(result), _) => Ok(result),
            (None, Some(default)) => Ok(default),
            (None, None) => Err(wrong(format!("`{what}` of `{}` has no default", self.value()))),
        }
    }
}

/// Converts a value to a real number like Python's `float(…)`; `None` if that is not possible.
fn real(value: &Value) -> Option<f64> {
    if let Some(number) = PythonNumber::of(value) {
        return Some(number.real());
    }
    let text = value.as_str()?.trim();
    text.strip_prefix(['+', '-']).unwrap_or(text).parse::<f64>().ok()?;
    text.parse().ok()
}

/// Converts a value to an integer like Python's `int(…)`, or like Jinja's `int`, which also accepts
/// `21.7`. Returns `None` if that is not possible.
fn whole(value: &Value, base: u32) -> Option<i128> {
    if let Some(text) = value.as_str() {
        let text = text.trim();
        let (sign, digits) = match text.strip_prefix('-') {
            Some(digits) => (-1, digits),
            None => (1, text.strip_prefix('+').unwrap_or(text)),
        };
        let lower = digits.to_ascii_lowercase();
        let digits = match base {
            16 => lower.strip_prefix("0x").unwrap_or(&lower),
            8 => lower.strip_prefix("0o").unwrap_or(&lower),
            2 => lower.strip_prefix("0b").unwrap_or(&lower),
            _ => &lower,
        };
        let is_plain = !digits.starts_with(['+', '-']);
        if let Some(whole) = i128::from_str_radix(digits, base).ok().filter(|_| is_plain) {
            return Some(sign * whole);
        }
    }
    if let Some(PythonNumber::Whole(whole)) = PythonNumber::of(value) {
        return Some(whole);
    }
    let real = real(value).filter(|real| real.is_finite())?;
    #[allow(clippy::cast_possible_truncation, reason = "Python's int() truncates")]
    Some(real.trunc() as i128)
}

fn of_whole(whole: i128) -> Value {
    i64::try_from(whole).map_or(Value::from(whole), Value::from)
}

fn float(given: &FilterArguments<'_>) -> Result<Value, Error> {
    given.or(real(given.value()).map(Value::from), 1, "float")
}

fn int(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let base = given.argument(2, "base").and_then(|base| u32::try_from(base).ok()).unwrap_or(10);
    if !(2..=36).contains(&base) {
        return Err(wrong("a base is from 2 to 36"));
    }
    given.or(whole(given.value(), base).map(of_whole), 1, "int")
}

fn round(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let places = given.argument(1, "precision").map_or(Ok(0), i32::try_from)?.clamp(-300, 300);
    let method = given.argument(2, "method").map(|method| method.to_string());
    let rounded = real(given.value()).and_then(|real| {
        let scale = 10_f64.powi(places);
        let rounded = match method.as_deref().unwrap_or("common") {
            "ceil" => (real * scale).ceil() / scale,
            "floor" => (real * scale).floor() / scale,
            "half" => half_even(real * 2.0) / 2.0,
            _ => to_places(real, places),
        };
        match places {
            0 if !rounded.is_finite() => None,
            0 => whole(&Value::from(rounded), 10).map(of_whole),
            _ => Some(Value::from(rounded)),
        }
    });
    given.or(rounded, 3, "round")
}

fn half_even(real: f64) -> f64 {
    to_places(real, 0)
}

/// Rounds a number like Python's `round`: a half is rounded to the even neighbor. The exact value
/// of the number decides whether it is a half.
fn to_places(real: f64, places: i32) -> f64 {
    let Ok(digits) = usize::try_from(places) else {
        let scale = 10_f64.powi(-places);
        return half_even(real / scale) * scale;
    };
    format!("{real:.digits$}").parse().unwrap_or(real)
}

fn boolean(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let value = given.value();
    let word = value.as_str().map(|text| text.trim().to_lowercase());
    let is_so = match (word.as_deref(), PythonNumber::of(value)) {
        (Some("1" | "true" | "yes" | "on" | "enable"), _) => Some(true),
        (Some("0" | "false" | "no" | "off" | "disable"), _) => Some(false),
        (_, Some(number)) => Some(number.real() != 0.0),
        _ => None,
    };
    match (is_so, given.argument(1, "default")) {
        (Some(is_so), _) => Ok(Value::from(is_so)),
        (None, Some(default)) => Ok(default),
        (None, None) => Err(wrong(format!("`{}` is neither yes nor no", printed(value)))),
    }
}

fn default(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let value = given.value();
    let also_false = given.argument(2, "boolean").is_some_and(|also| also.is_true());
    if value.is_undefined() || (also_false && !value.is_true()) {
        return Ok(given.argument(1, "default_value").unwrap_or_else(|| Value::from("")));
    }
    Ok(value.clone())
}

fn iif(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let if_none = given.argument(3, "if_none").filter(|_| given.value().is_none());
    let (place, name, otherwise) = match given.value().is_true() {
        true => (1, "if_true", true),
        false => (2, "if_false", false),
    };
    let chosen = if_none.or_else(|| given.argument(place, name));
    Ok(chosen.unwrap_or_else(|| Value::from(otherwise)))
}

/// Returns an error for an undefined value, so that the whole template has no output.
fn is_defined(given: &FilterArguments<'_>) -> Result<Value, Error> {
    if given.value().is_undefined() { Err(missing()) } else { Ok(given.value().clone()) }
}

fn is_number(value: &Value) -> Result<bool, Error> {
    if value.is_undefined() {
        return Err(missing());
    }
    Ok(real(value).is_some_and(f64::is_finite))
}

fn abs(given: &FilterArguments<'_>) -> Result<Value, Error> {
    match PythonNumber::of(given.value()) {
        Some(PythonNumber::Whole(whole)) => Ok(of_whole(whole.abs())),
        Some(PythonNumber::Real(real)) => Ok(Value::from(real.abs())),
        None => Err(wrong(format!("`{}` is no number", printed(given.value())))),
    }
}

/// Returns the remainder of the value divided by `by`; -1 if the value has a fraction.
fn rest(given: &FilterArguments<'_>, by: i128) -> Result<i128, Error> {
    match PythonNumber::of(given.value()) {
        Some(PythonNumber::Whole(whole)) => Ok(whole.rem_euclid(by)),
        // A number with a fraction is neither odd nor even.
        Some(PythonNumber::Real(real)) if real.fract() != 0.0 => Ok(-1),
        Some(PythonNumber::Real(_)) => {
            Ok(whole(given.value(), 10).map_or(-1, |whole| whole.rem_euclid(by)))
        }
        None => Err(wrong(format!("`{}` is no number", printed(given.value())))),
    }
}

fn from_json(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let json = given.value().as_str().and_then(|text| serde_json::from_str(text).ok());
    let json = json.map(|json: serde_json::Value| Value::from(minijinja::value::Serde(json)));
    given.or(json, 1, "from_json")
}

fn to_json(given: &FilterArguments<'_>) -> Result<Value, Error> {
    if given.value().is_undefined() {
        return Err(missing());
    }
    let is_plain = given.values.len() == 1 && given.named.args().next().is_none();
    if !is_plain {
        return Err(wrong("`to_json` with arguments is not known here"));
    }
    serde_json::to_string(given.value()).map(Value::from).map_err(|error| wrong(error.to_string()))
}

fn of_one(given: &FilterArguments<'_>, of: fn(f64) -> f64) -> Result<Value, Error> {
    let result = real(given.value()).map(of).filter(|result| !result.is_nan());
    given.or(result.map(Value::from), 1, "it")
}

fn of_two(given: &FilterArguments<'_>, of: fn(f64, f64) -> f64) -> Result<Value, Error> {
    let other = given.argument(1, "amount").as_ref().and_then(real);
    let result = real(given.value()).zip(other).map(|(one, other)| of(one, other));
    given.or(result.map(Value::from), 2, "it")
}

fn log(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let base = match given.argument(1, "base") {
        Some(base) => real(&base).ok_or_else(|| wrong("the base of `log` is no number"))?,
        None => std::f64::consts::E,
    };
    let positive = real(given.value()).filter(|real| *real > 0.0);
    #[allow(clippy::float_cmp, reason = "the constant itself, where no base is given")]
    let result = positive.map(|real| match base {
        base if base == std::f64::consts::E => real.ln(),
        base => real.ln() / base.ln(),
    });
    given.or(result.map(Value::from), 2, "log")
}

/// Returns the numbers of the list in the first argument. If that argument is not a list, returns
/// all arguments as numbers.
fn numbers(given: &FilterArguments<'_>) -> Result<Vec<f64>, Error> {
    let values: Vec<Value> = match given.value().kind() {
        ValueKind::Seq => given.value().try_iter()?.collect(),
        _ => given.values.to_vec(),
    };
    let numbers = values.iter().map(|value| PythonNumber::of(value).map(PythonNumber::real));
    numbers.collect::<Option<_>>().ok_or_else(|| wrong("not all of them are numbers"))
}

#[allow(clippy::cast_precision_loss, reason = "there are not so many")]
fn average(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let numbers = numbers(given).ok().filter(|numbers| !numbers.is_empty());
    let mean = numbers.map(|numbers| numbers.iter().sum::<f64>() / numbers.len() as f64);
    given.or(mean.map(Value::from), 1, "average")
}

fn median(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let numbers = numbers(given).ok().filter(|numbers| !numbers.is_empty());
    let middle = numbers.map(|mut numbers| {
        numbers.sort_by(f64::total_cmp);
        let half = numbers.len() / 2;
        match numbers.len() % 2 {
            1 => numbers[half],
            _ => f64::midpoint(numbers[half - 1], numbers[half]),
        }
    });
    given.or(middle.map(Value::from), 1, "median")
}

fn of_bits(given: &FilterArguments<'_>, of: fn(i128, i128) -> i128) -> Result<Value, Error> {
    let whole = |value: &Value| match PythonNumber::of(value) {
        Some(PythonNumber::Whole(whole)) => Ok(whole),
        _ if value.is_undefined() => Err(missing()),
        _ => Err(wrong(format!("`{value}` has no bits"))),
    };
    let other = given.argument(1, "second_value").unwrap_or(Value::UNDEFINED);
    Ok(of_whole(of(whole(given.value())?, whole(&other)?)))
}

fn ordinal(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let text = printed(given.value());
    let last: Vec<char> = text.chars().rev().take(2).collect();
    let number: String = last.iter().rev().collect();
    let number: i32 = number.parse().map_err(|_| wrong(format!("`{text}` is no whole number")))?;
    let ending = match (number.abs() % 100, number.abs() % 10) {
        (11..=13, _) => "th",
        (_, 1) => "st",
        (_, 2) => "nd",
        (_, 3) => "rd",
        _ => "th",
    };
    Ok(Value::from(format!("{text}{ending}")))
}

fn slugify(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let separator = given.argument(1, "separator").map_or("_".to_owned(), |by| by.to_string());
    if given.value().is_undefined() {
        return Err(missing());
    }
    let slug = slug(&given.value().to_string(), " ");
    let gaps = slug.matches(' ').count();
    within(slug.len().saturating_add(gaps.saturating_mul(separator.len())))?;
    Ok(Value::from(slug.replace(' ', &separator)))
}

fn is_in(given: &FilterArguments<'_>) -> Result<bool, Error> {
    let part = given.argument(1, "value").unwrap_or(Value::UNDEFINED);
    match (given.value().as_str(), part.as_str()) {
        (Some(whole), Some(part)) => Ok(whole.contains(part)),
        (Some(_), None) => Err(wrong("only a text can be in a text")),
        _ => Ok(given.value().try_iter()?.any(|one| super::numbers::is_equal(&one, &part))),
    }
}

/// Compiles a regular expression in Python's syntax.
pub(super) fn pattern(text: &str, ignores_case: bool) -> Result<Regex, Error> {
    let mut builder = RegexBuilder::new(text);
    builder.case_insensitive(ignores_case).size_limit(PATTERN_BYTES_MAX);
    let reason = |error: &regex::Error| {
        error
            .to_string()
            .lines()
            .last()
            .unwrap_or_default()
            .trim_start_matches("error: ")
            .to_owned()
    };
    builder.build().map_err(|error| {
        wrong(format!("the regular expression `{text}` is not known here: {}", reason(&error)))
    })
}

fn expression(given: &FilterArguments<'_>, place: usize) -> Result<Regex, Error> {
    let text = given.argument(1, "find").map(|find| find.to_string()).unwrap_or_default();
    let ignores_case = given.argument(place, "ignorecase").is_some_and(|it| it.is_true());
    pattern(&text, ignores_case)
}

fn matches_at(given: &FilterArguments<'_>, start: bool) -> Result<bool, Error> {
    let (text, expression) = (printed(given.value()), expression(given, 2)?);
    let found = expression.find(&text);
    Ok(found.is_some_and(|found| !start || found.start() == 0))
}

fn regex_replace(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let (text, expression) = (printed(given.value()), expression(given, 3)?);
    let by = given.argument(2, "replace").map(|by| by.to_string()).unwrap_or_default();
    let by = reference(&by);
    let groups = by.matches('$').count();
    let (mut made, mut from) = (String::new(), 0);
    for captures in expression.captures_iter(&text) {
        let Some(whole) = captures.get(0) else { continue };
        let longest = captures.iter().flatten().map(|group| group.len()).max().unwrap_or(0);
        let more = by.len().saturating_add(groups.saturating_mul(longest));
        within(made.len().saturating_add(more).saturating_add(whole.start() - from))?;
        made.push_str(&text[from..whole.start()]);
        captures.expand(&by, &mut made);
        from = whole.end();
    }
    within(made.len() + text.len() - from)?;
    made.push_str(&text[from..]);
    Ok(Value::from(made))
}

/// Returns an error if a formatted text could become too long. The check is made before formatting.
/// It assumes that each placeholder (after `%` or `{`) takes all values, and has the width that it
/// states.
pub(super) fn formattable(values: &[Value], place: char) -> Result<(), Error> {
    let Some((Some(text), rest)) = values.split_first().map(|(text, rest)| (text.as_str(), rest))
    else {
        return Ok(());
    };
    let mut longest = 0;
    for value in rest {
        longest += weight(value)?;
    }
    let filled = text.matches(place).count().saturating_mul(longest);
    let widths = text.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
    let widths = widths.map(|digits| digits.parse().unwrap_or(usize::MAX));
    within(widths.fold(text.len().saturating_add(filled), usize::saturating_add))
}

/// Returns an error if a text of this length would be too long; called before the text is created.
fn within(bytes: usize) -> Result<(), Error> {
    if bytes > TEXT_BYTES_MAX { Err(wrong("the text becomes too long")) } else { Ok(()) }
}

/// Converts Python's references `\1` and `\g<name>` to those of the crate `regex`.
fn reference(text: &str) -> String {
    let mut made = String::new();
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            '$' => made.push_str("$$"),
            '\\' => match rest.next() {
                Some('g') => {
                    let name: String =
                        rest.by_ref().skip_while(|c| *c == '<').take_while(|c| *c != '>').collect();
                    made.push_str(&format!("${{{name}}}"));
                }
                Some(digit) if digit.is_ascii_digit() => {
                    let mut number = digit.to_string();
                    while let Some(next) = rest.next_if(char::is_ascii_digit) {
                        number.push(next);
                    }
                    made.push_str(&format!("${{{number}}}"));
                }
                Some('n') => made.push('\n'),
                Some('t') => made.push('\t'),
                Some(other) => made.push(other),
                None => made.push('\\'),
            },
            other => made.push(other),
        }
    }
    made
}

/// Returns all matches of an expression, as Python's `re.findall` does. With one group in the
/// expression, a match is the text of the group; with several groups, a match is a tuple of their
/// texts.
fn found(text: &str, expression: &Regex) -> Result<Vec<Value>, Error> {
    let (mut all, mut bytes) = (Vec::new(), 0_usize);
    for captures in expression.captures_iter(text) {
        let group = |index: usize| captures.get(index).map_or("", |found| found.as_str());
        let one: Value = match captures.len() {
            1 | 2 => group(captures.len() - 1).into(),
            count => {
                Tuple::from((1..count).map(|index| group(index).into()).collect::<Vec<_>>()).into()
            }
        };
        let more: usize = (0..captures.len()).map(|index| group(index).len() + 1).sum();
        bytes = bytes.saturating_add(more);
        within(bytes)?;
        all.push(one);
    }
    Ok(all)
}

fn regex_findall(given: &FilterArguments<'_>) -> Result<Value, Error> {
    found(&printed(given.value()), &expression(given, 2)?).map(Value::from)
}

fn regex_findall_index(given: &FilterArguments<'_>) -> Result<Value, Error> {
    let all = found(&printed(given.value()), &expression(given, 3)?)?;
    let index = given.argument(2, "index").map_or(Ok(0), i64::try_from)?;
    let count = i64::try_from(all.len()).unwrap_or(i64::MAX);
    let index = usize::try_from(if index < 0 { index + count } else { index });
    let one = index.ok().and_then(|index| all.get(index));
    one.cloned().ok_or_else(|| wrong("nothing fits the regular expression"))
}
