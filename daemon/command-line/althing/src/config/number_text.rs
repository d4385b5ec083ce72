//! Numbers that a file has as texts, such as `"2min"` for seconds, and how they are written right.

/// Units of time and length, with their number of seconds or meters. Keys that are numbers count in
/// seconds and in meters; other durations are texts.
const UNITS: [(&str, f64, &str); 17] = [
    ("ms", 0.001, "seconds"),
    ("s", 1.0, "seconds"),
    ("sec", 1.0, "seconds"),
    ("seconds", 1.0, "seconds"),
    ("m/s", 1.0, "meters per second"),
    ("cm/s", 0.01, "meters per second"),
    ("km/h", 1.0 / 3.6, "meters per second"),
    ("min", 60.0, "seconds"),
    ("minutes", 60.0, "seconds"),
    ("h", 3600.0, "seconds"),
    ("hours", 3600.0, "seconds"),
    ("d", 86_400.0, "seconds"),
    ("mm", 0.001, "meters"),
    ("cm", 0.01, "meters"),
    ("m", 1.0, "meters"),
    ("km", 1000.0, "meters"),
    ("meters", 1.0, "meters"),
];

/// Returns how to write the value of `key`, which has to be a number and is `text`: a number with or
/// without a unit. Returns `None` if it is neither. A whole number has no fraction.
pub(crate) fn correction(key: &str, text: &str, is_whole: bool) -> Option<String> {
    let plain = text.trim().replace(',', ".");
    let end = plain.find(|symbol: char| !symbol.is_ascii_digit() && !".-+".contains(symbol));
    let (number, unit) = plain.split_at(end.unwrap_or(plain.len()));
    let (number, unit): (f64, &str) = (number.parse().ok()?, unit.trim());
    let rounded = |number: f64| if is_whole { number.trunc() } else { number };
    if unit.is_empty() {
        return Some(format!("write {key} = {}, without quotes", rounded(number)));
    }
    let known = UNITS.iter().find(|(name, ..)| *name == unit);
    Some(match known {
        Some((_, factor, canonical)) => {
            // Nine digits are more than any such value has, and hide the error of the factor.
            let number = (number * factor * 1e9).round() / 1e9;
            format!("write the number of {canonical}: {key} = {}", rounded(number))
        }
        None => format!("write {key} as a number alone, without `{unit}`, in the unit of the key"),
    })
}

/// Keys that take a text with more than a number. Each has the text for a bare number `{}`.
const FORMED: &[(&str, &str)] = &[
    ("broker", "localhost:{}"),
    ("by", "{}min"),
    ("every", "{}min"),
    ("for", "{}h"),
    ("line", "GPIO{}"),
    ("listen", "127.0.0.1:{}"),
    ("max-size", "{}MiB"),
];

/// Further texts for a bare number `{}`, for keys that mean another thing for each plugin.
const FURTHER_FORMS: &[(&str, &str)] = &[("device", "/dev/video{}"), ("television", "/dev/cec{}")];

/// Returns a help text for a number that must be a text.
pub(crate) fn quoted(key: &str, number: &str) -> String {
    let form = FORMED.iter().find(|(formed, _)| *formed == key).map_or("{}", |(_, form)| form);
    with_form(key, form, number)
}

/// Returns help texts for a number that must be a text, for a reader that may refuse the first.
pub(crate) fn quoted_forms(key: &str, number: &str) -> Vec<String> {
    let further = FURTHER_FORMS.iter().filter(|(formed, _)| *formed == key);
    let further = further.map(|(_, form)| with_form(key, form, number));
    [quoted(key, number)].into_iter().chain(further).collect()
}

fn with_form(key: &str, form: &str, number: &str) -> String {
    format!("write {key} = \"{}\"", form.replace("{}", number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(key: &str, text: &str, expected: &str) {
        assert_eq!(correction(key, text, false).unwrap_or_default(), expected, "{text}");
    }

    #[test]
    fn a_correction_has_the_right_amount() {
        check("speed", "0.3", "write speed = 0.3, without quotes");
        check("speed", "0.3 m/s", "write the number of meters per second: speed = 0.3");
        check("move-timeout", "2min", "write the number of seconds: move-timeout = 120");
        check("blocked-for", "1,5 h", "write the number of seconds: blocked-for = 5400");
        check("range", "5km", "write the number of meters: range = 5000");
        check("tolerance", "50cm", "write the number of meters: tolerance = 0.5");
        let percent = "write sensitivity as a number alone, without `%`, in the unit of the key";
        check("sensitivity", "4%", percent);
        check("speed", "fast", "");
        assert_eq!(
            correction("keep", "50.5", true).as_deref(),
            Some("write keep = 50, without quotes")
        );
    }
}
