//! Placeholders in the texts of an entry: `{p}` is the object that is bound to the variable `?p` of an
//! action, and `{p.x}` a value of that object. Other texts in braces belong to the program or the node
//! that receives the text.

/// Returns the placeholders of a text, without braces: names, and names after a point.
pub fn placeholders(text: &str) -> impl Iterator<Item = &str> {
    let is_placeholder = |text: &&str| {
        text.starts_with(|symbol: char| symbol.is_ascii_lowercase()) && text.chars().all(is_plain)
    };
    let parts = text.split('{').skip(1).filter_map(|part| part.split_once('}'));
    parts.map(|(name, _)| name).filter(is_placeholder)
}

/// Returns the problem of the first text that is spelled almost like a placeholder, such as `{?p}`,
/// `{{ p }}`, `{p` or `?p` alone; `None` if there is none. Such a text would reach the program or the
/// node as it stands. `is_known` says which placeholders there are, and `known` lists them for a person.
pub fn misspelt_placeholder(
    text: &str,
    known: &str,
    is_known: &dyn Fn(&str) -> bool,
) -> Option<String> {
    let problem = |written: &str, meant: String| {
        format!("`{written}` is no placeholder: write `{{{meant}}}`")
    };
    let whole = text.trim();
    if let Some(meant) = whole.strip_prefix('?').and_then(|name| meant(name, is_known)) {
        return Some(problem(whole, meant));
    }
    let mut rest = text;
    while let Some(start) = rest.find('{') {
        let (from, after_opening) = (&rest[start..], behind_opening(&rest[start..]));
        if let Some((written, name)) = almost_placeholder(from, after_opening) {
            match meant(name, is_known) {
                Some(meant) => return Some(problem(written, meant)),
                // No language has this beginning, so a variable is meant in any case.
                None if written.starts_with("{?") && written.ends_with('}') => {
                    return Some(format!("`{written}` is none of its variables: {known}"));
                }
                None => (),
            }
        }
        rest = after_opening;
    }
    None
}

fn is_plain(symbol: char) -> bool {
    symbol.is_ascii_alphanumeric() || "-_.".contains(symbol)
}

/// Returns the part of a text behind the braces, blanks and question marks with which it begins.
fn behind_opening(from: &str) -> &str {
    from.trim_start_matches(|symbol: char| "{?".contains(symbol) || symbol.is_whitespace())
}

/// Returns a text that begins with a brace and is almost a placeholder, and the name in it. `inner` is
/// the part of `from` behind its opening.
fn almost_placeholder<'t>(from: &'t str, inner: &'t str) -> Option<(&'t str, &'t str)> {
    let opening = &from[..from.len() - inner.len()];
    let end = inner.find(|symbol: char| !is_plain(symbol)).unwrap_or(inner.len());
    let (name, after) = inner.split_at(end);
    let is_name = name.starts_with(|symbol: char| symbol.is_ascii_alphabetic());
    let is_right = opening == "{" && after.starts_with('}') && !starts_upper(name);
    if !is_name || is_right {
        return None;
    }
    let (opened, before_closing) = (opening.matches('{').count(), opening.len() + name.len());
    let is_closing = |symbol: char| symbol == '}' || symbol.is_whitespace();
    let blank = after.find(|symbol: char| !is_closing(symbol)).unwrap_or(after.len());
    let closings: Vec<usize> = after[..blank].match_indices('}').map(|(at, _)| at + 1).collect();
    let written_to = match closings.get(..opened.min(closings.len())).and_then(<[usize]>::last) {
        // In `{{p}: 1}` the inner braces are a placeholder, and the outer ones another language.
        Some(_) if closings.len() < opened && opening.chars().all(|symbol| symbol == '{') => {
            return None;
        }
        Some(closed) => before_closing + closed,
        // The brace is closed later, so that the name is only a part of what is in the braces.
        None if after.split('{').next().is_some_and(|piece| piece.contains('}')) => return None,
        None if opening.contains(char::is_whitespace) => return None,
        None => before_closing,
    };
    Some((&from[..written_to], name))
}

fn starts_upper(name: &str) -> bool {
    name.starts_with(|symbol: char| symbol.is_ascii_uppercase())
}

/// Returns the placeholder that was probably meant by `name`, without braces.
fn meant(name: &str, is_known: &dyn Fn(&str) -> bool) -> Option<String> {
    let lower = name.to_lowercase();
    let variable = lower.split('.').next().unwrap_or_default();
    let found = [name, &lower, variable].into_iter().find(|name| is_known(name));
    found.map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(text: &str) -> Option<String> {
        let is_known = |name: &str| ["p", "s", "s.x"].contains(&name);
        misspelt_placeholder(text, "{p}, {s}", &is_known)
    }

    #[test]
    fn almost_placeholders_are_found() {
        for (text, written, meant) in [
            ("{?p}", "{?p}", "{p}"),
            ("{{ p }}", "{{ p }}", "{p}"),
            ("{{p}}", "{{p}}", "{p}"),
            ("{ p }", "{ p }", "{p}"),
            ("{P}", "{P}", "{p}"),
            ("{p", "{p", "{p}"),
            ("at {p of {s}", "{p", "{p}"),
            ("{s} {?s.x}", "{?s.x}", "{s.x}"),
            ("{{ s.y }}", "{{ s.y }}", "{s}"),
            ("?p", "?p", "{p}"),
        ] {
            let expected = format!("`{written}` is no placeholder: write `{meant}`");
            assert_eq!(problem(text), Some(expected), "{text}");
        }
        let unknown = "`{?part}` is none of its variables: {p}, {s}";
        assert_eq!(problem("{?part}").as_deref(), Some(unknown));
    }

    #[test]
    fn other_languages_are_left_alone() {
        for text in [
            "{p} and {s.x}",
            "{\"json\": {p}}",
            "{{p}: 1}",
            "{{.State.Running}}",
            "{a..z}",
            "{print $1}",
            "brew() { p; }",
            "(exists (?p - part) (held ?p))",
            "http://10.0.0.7/on?p=1",
            "",
            "{",
            "é{",
        ] {
            assert_eq!(problem(text), None, "{text}");
        }
        let names: Vec<_> = placeholders("{p} {s.x} {\"json\": 1} {P}").collect();
        assert_eq!(names, ["p", "s.x"]);
    }
}
