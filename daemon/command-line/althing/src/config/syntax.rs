//! Explains syntax errors in TOML for users without knowledge of TOML. Each mistake has one
//! message: errors that only follow from an earlier error are not reported.

use std::ops::Range;

use pddl::{Diagnostic, Span};

/// The beginning of the message about text that is not TOML.
const NOT_TOML: &str = "not TOML: ";

/// Maximum number of syntax errors that are reported; further ones are left out. A file with more
/// of them probably has another format.
const ERRORS_MAX: usize = 20;

/// An error of the TOML parser, with the range of the text that it is about.
#[derive(Clone, Debug)]
pub(super) struct TomlError {
    pub(super) message: String,
    pub(super) range: Range<usize>,
}

/// Whether a diagnostic is about syntax, which means that the text around it could not be read.
pub(crate) fn is_syntax_error(found: &Diagnostic) -> bool {
    found.message.starts_with(NOT_TOML)
}

/// Returns the syntax errors of a text, with one diagnostic per mistake.
pub(super) fn mistakes(text: &str, failures: &[TomlError]) -> Vec<Diagnostic> {
    if let Some(found) = other_format(text).filter(|_| !failures.is_empty()) {
        return vec![found];
    }
    let mut told: Vec<Diagnostic> = Vec::new();
    let mut lines = Vec::new();
    // Errors before this offset are not reported: they are inside something that is not closed.
    let mut lost_until = 0;
    let mut entries = Vec::new();
    let mut sorted: Vec<&TomlError> = failures.iter().collect();
    sorted.sort_by_key(|failure| failure.range.start);
    for failure in sorted {
        let at = failure.range.start.min(text.len());
        let line = line_of(text, at);
        if at < lost_until || lines.contains(&line.start) || told.len() == ERRORS_MAX {
            continue;
        }
        if let Some(open) = unclosed_before(text, line.start) {
            lost_until = text.len();
            told.push(open);
            continue;
        }
        if failure.message.contains("duplicate key") {
            let (entry, found) = duplicate(text, failure, &line);
            if !entries.contains(&entry) {
                entries.push(entry);
                told.push(found);
            }
            continue;
        }
        lines.push(line.start);
        told.push(of_line(text, failure, &line));
    }
    told
}

/// Returns an error if the whole text is of another format, according to its first line: JSON or
/// YAML.
fn other_format(text: &str) -> Option<Diagnostic> {
    let is_content = |line: &str| !line.trim().is_empty() && !line.trim().starts_with('#');
    let mut at = 0;
    let lines = text.split_inclusive('\n').map(|line| {
        at += line.len();
        (at - line.len(), line)
    });
    let (at, first) = lines.into_iter().find(|(_, line)| is_content(line))?;
    let begin = at + first.len() - first.trim_start().len();
    let range = begin..at + first.trim_end().len();
    if first.trim_start().starts_with('{') {
        let help = "an ecosystem file is TOML: [ecosystem] in a line, and below it name = \"…\"";
        return Some(error(range, "this is JSON", help.to_owned()));
    }
    let key = first.trim_end().strip_suffix(':').filter(|key| is_key(key));
    let has_assignment = text.lines().any(|line| without_comment(line).contains('='));
    let key = key.filter(|_| !has_assignment)?;
    let help = format!("an ecosystem file is TOML: write [{key}] in a line, and below it name = …");
    Some(error(range, "this is YAML", help))
}

fn error(range: Range<usize>, message: &str, help: String) -> Diagnostic {
    Diagnostic::error(Span::new(range.start, range.end), format!("{NOT_TOML}{message}"))
        .with_help(help)
}

fn line_of(text: &str, at: usize) -> Range<usize> {
    let at = text.floor_char_boundary(at);
    let start = text[..at].rfind('\n').map_or(0, |newline| newline + 1);
    let end = text[at..].find('\n').map_or(text.len(), |newline| at + newline);
    start..end
}

/// Returns an error for a `{` or `[` that is not closed in the last line before `line_start`.
/// Returns `None` if there is none.
fn unclosed_before(text: &str, line_start: usize) -> Option<Diagnostic> {
    // The parser fails at the line after an open bracket, so only the line before the failure is
    // examined.
    let before = text[..line_start].trim_end();
    let line = line_of(text, before.len().saturating_sub(1));
    let last = text.get(line.clone())?;
    let code = without_comment(last);
    let is_header = code.trim_start().starts_with('[') && !code.contains('=');
    let ends_open = code.trim_end().ends_with(',');
    if is_header || !code.contains('=') || ends_open && code.contains("[\n") {
        return None;
    }
    let (at, open) = last_open(code)?;
    let close = if open == '{' { '}' } else { ']' };
    let next = text.get(line_start..)?.trim_start();
    // A list may span several lines; a line that begins like a table or a key is not part of it.
    let begins = next.starts_with('[') || is_key_line(next.lines().next().unwrap_or_default());
    if !begins {
        return None;
    }
    let range = line.start + at..line.start + at + 1;
    let message = format!("this `{open}` is not closed");
    Some(error(range, &message, format!("write `{close}` at the end of the line")))
}

/// Returns the last bracket that a line opens and does not close, and the bracket's offset in the
/// line.
fn last_open(line: &str) -> Option<(usize, char)> {
    let mut open = Vec::new();
    let mut quote = None;
    let mut escaped = false;
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (Some('"'), '\\') if !escaped => {
                escaped = true;
                continue;
            }
            (Some(q), c) if q == c && !escaped => quote = None,
            (Some(_), _) => (),
            (None, '"' | '\'') => quote = Some(c),
            (None, '{' | '[') => open.push((at, c)),
            (None, '}' | ']') => {
                open.pop();
            }
            (None, _) => (),
        }
        escaped = false;
    }
    open.last().copied()
}

/// Returns the part of a line before a comment, which begins at a `#` outside quotes.
fn without_comment(line: &str) -> &str {
    let mut quote = None;
    for (at, c) in line.char_indices() {
        match (quote, c) {
            (Some(q), c) if q == c => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '#') => return &line[..at],
            _ => (),
        }
    }
    line
}

fn is_key_line(line: &str) -> bool {
    line.split_once('=').is_some_and(|(key, _)| is_key(key.trim()))
}

fn is_key(word: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    !word.is_empty() && word.chars().all(is_plain)
}

/// Returns the offset of a key or table that exists twice, and the error about it. The caller
/// reports only one error per offset.
fn duplicate(text: &str, failure: &TomlError, line: &Range<usize>) -> (usize, Diagnostic) {
    let range = failure.range.clone();
    let word = text.get(range.clone()).unwrap_or_default();
    let written = text.get(line.clone()).unwrap_or_default().trim();
    let lists = |name: &str| text.lines().any(|line| line.trim() == format!("[[{name}]]"));
    if written.starts_with('[') {
        // For `[agent]` among several `[[agent]]`, the parser also reports each later one as a
        // duplicate.
        let single = format!("[{word}]");
        if lists(word) && text.lines().any(|line| line.trim() == single) {
            let at = start_of_line(text, &single).unwrap_or(line.start);
            let message = format!("`{single}` is a single table, and there are several");
            let help = format!("write [[{word}]]");
            return (at, error(at..at + single.len(), &message, help));
        }
        let first = start_of_line(text, &single).map_or(1, |at| number(text, at));
        let message = format!("`{single}` is there already");
        let help = format!("it begins in line {first}: write these keys there");
        return (line.start, error(range, &message, help));
    }
    let header = header_before(text, line.start);
    let entry = header.as_ref().map_or(0, |header| header.start);
    let name = header.map_or("", |header| text.get(header).unwrap_or_default().trim());
    let first = text.get(entry..line.start).and_then(|above| start_of_key(above, word));
    let place =
        first.map_or_else(String::new, |at| format!(" (line {})", number(text, entry + at)));
    let message = format!("`{word}` is there already{place}");
    let help = match name.starts_with("[[") {
        true => format!("if this is another entry, write {name} above it; if not, take one out"),
        false => "take one of the two out".to_owned(),
    };
    (entry, error(range, &message, help))
}

fn number(text: &str, at: usize) -> usize {
    pddl::line_column(text, at).0
}

/// Returns the offset of the table header `words`, which stands in a line of its own.
fn start_of_line(text: &str, words: &str) -> Option<usize> {
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        if without_comment(line).trim() == words {
            return Some(at + line.find('[').unwrap_or_default());
        }
        at += line.len();
    }
    None
}

/// Returns the offset of the line that sets the key `key`.
fn start_of_key(text: &str, key: &str) -> Option<usize> {
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        if line.split_once('=').is_some_and(|(written, _)| written.trim() == key) {
            return Some(at);
        }
        at += line.len();
    }
    None
}

/// Returns the range of the header of the table to which the line at `line_start` belongs.
fn header_before(text: &str, line_start: usize) -> Option<Range<usize>> {
    let mut end = line_start;
    while end > 0 {
        let line = line_of(text, end - 1);
        let written = text.get(line.clone())?.trim_start();
        if written.starts_with('[') && !without_comment(written).contains('=') {
            return Some(line);
        }
        end = line.start;
    }
    None
}

/// Explains why one line could not be read.
fn of_line(text: &str, failure: &TomlError, line: &Range<usize>) -> Diagnostic {
    let written = text.get(line.clone()).unwrap_or_default().trim_end_matches('\r');
    let whole = line.start..line.start + written.len();
    let begins = line.start + written.len() - written.trim_start().len();
    let code = written.trim();
    if code.starts_with("//") || code.starts_with(';') || code.starts_with("--") {
        let help = "a comment begins with `#`".to_owned();
        return error(begins..whole.end, "this line is no comment", help);
    }
    if let Some(curly) = written.find(|c| "“”„‟‘’«»".contains(c)) {
        let at = line.start + curly;
        let width = text[at..].chars().next().map_or(1, char::len_utf8);
        let help = "write a straight one: \"".to_owned();
        return error(at..at + width, "this is not the quote that texts stand in", help);
    }
    if let Some(space) = written.find('\u{a0}') {
        let at = line.start + space;
        let help = "write a normal space; some editors and web pages put another one".to_owned();
        return error(at..at + '\u{a0}'.len_utf8(), "a no-break space is no space here", help);
    }
    if code.starts_with('[') && !code.contains('=') {
        return header(begins, code);
    }
    if let Some((key, value)) = code.split_once(':')
        && is_key(key.trim())
        && !key.contains('=')
    {
        let at = line.start + written.find(':').unwrap_or_default();
        let help = match value.trim() {
            "" => format!("write {} = …", key.trim()),
            value => format!("write {} = {value}", key.trim()),
        };
        return error(at..at + 1, "a key and its value are joined by `=`", help);
    }
    of_value(text, failure).unwrap_or_else(|| plain(text, failure))
}

fn header(begins: usize, code: &str) -> Diagnostic {
    let name: String = code.chars().filter(|c| !"[] \t".contains(*c)).collect();
    let help = match code.starts_with("[[") {
        true => format!("write [[{name}]]"),
        false => format!("write [{name}]"),
    };
    error(begins..begins + code.len(), "a table begins with its name in brackets", help)
}

/// Explains a value that the parser cannot read: a text without quotes or without its closing
/// quote, or a number with a comma or a unit.
fn of_value(text: &str, failure: &TomlError) -> Option<Diagnostic> {
    let TomlError { message, range } = failure;
    if let Some(path) = message.contains("escaped").then(|| text_around(text, range)).flatten() {
        let help = format!("write `/` in paths: {}", path.replace('\\', "/"));
        return Some(error(range.clone(), "`\\` has a meaning of its own in a text", help));
    }
    if text.get(range.clone()).is_some_and(|found| found.is_empty() || found.starts_with(';'))
        && text.get(range.start..).is_some_and(|rest| rest.starts_with(';'))
    {
        let help = "take it out; entries of a table are separated by commas".to_owned();
        return Some(error(range.start..range.start + 1, "`;` ends nothing in TOML", help));
    }
    if message.starts_with("invalid basic string") || message.starts_with("invalid multi-line") {
        let help =
            "write `\"` at its end; within it, `\\` is `\\\\`, and `\"` is `\\\"`".to_owned();
        return Some(error(range.clone(), "a text is not closed, or has a `\\` in it", help));
    }
    let is_value =
        ["must be quoted", "invalid boolean", "invalid literal string", "invalid integer"]
            .iter()
            .any(|words| message.contains(words));
    let word = text.get(range.clone()).unwrap_or_default().trim();
    if let Some(found) = decimal_comma(text, line_of(text, range.start)) {
        return Some(found);
    }
    if !is_value || word.is_empty() {
        return None;
    }
    if let Some(number) = with_minus(word) {
        let found = format!("`{word}` begins with a dash that is no minus");
        return Some(error(range.clone(), &found, format!("write {number}")));
    }
    let digits = word.find(|c: char| !c.is_ascii_digit() && !".+-".contains(c));
    let (amount, unit) = word.split_at(digits.unwrap_or(word.len()));
    if amount.parse::<f64>().is_ok() && !unit.trim().is_empty() {
        let help = format!("write {amount}, the number alone; a text stands in quotes: \"{word}\"");
        return Some(error(range.clone(), &format!("`{word}` is no number"), help));
    }
    let truth = match word.to_lowercase().as_str() {
        "yes" | "on" | "true" => Some(true),
        "no" | "off" | "false" => Some(false),
        _ => None,
    };
    let help = match truth {
        Some(truth) => format!("write {truth}, or \"{word}\" if it is a text"),
        None => format!("write \"{}\"", word.replace(['"', '`'], "")),
    };
    Some(error(range.clone(), "a text stands in quotes", help))
}

/// Returns a number that begins with another dash than a minus, with a minus; `None` for other texts.
fn with_minus(word: &str) -> Option<String> {
    let number = word
        .strip_prefix(['\u{2010}', '\u{2011}', '\u{2012}', '\u{2013}', '\u{2014}', '\u{2212}'])?;
    number.parse::<f64>().is_ok().then(|| format!("-{number}"))
}

/// Returns the text in quotes, with its quotes, in which a range lies; `None` if there is none.
fn text_around<'t>(text: &'t str, range: &Range<usize>) -> Option<&'t str> {
    let line = line_of(text, range.start.min(text.len()));
    let before = text.get(line.start..range.start)?;
    let open = line.start + before.find('"')?;
    let close = range.start + text.get(range.start..line.end)?.find('"')?;
    text.get(open..=close)
}

/// Explains a decimal comma, as in `speed = 0,3`: to TOML, the number ends at the comma, and
/// something that is not a key follows.
fn decimal_comma(text: &str, line: Range<usize>) -> Option<Diagnostic> {
    let written = text.get(line.clone())?;
    for (at, _) in written.match_indices('=') {
        let value = &written[at + 1..];
        let from = at + 1 + value.len() - value.trim_start().len();
        let digits = |text: &str| text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
        let rest = written[from..].trim_start_matches('-');
        let sign = written[from..].len() - rest.len();
        let whole = digits(rest);
        let Some(behind) = rest[whole..].strip_prefix(',').filter(|_| whole > 0) else { continue };
        let fraction = digits(behind);
        if fraction > 0 && !behind[fraction..].trim_start().starts_with(['=', '.']) {
            let help =
                format!("write {}.{}", &written[from..from + sign + whole], &behind[..fraction]);
            let from = line.start + from;
            let range = from..from + sign + whole + 1 + fraction;
            return Some(error(range, "numbers have a point", help));
        }
    }
    None
}

/// Returns the parser's own message, for an error for which there is no better explanation.
fn plain(text: &str, TomlError { message, range }: &TomlError) -> Diagnostic {
    let (said, expected) = match message.split_once(", expected ") {
        Some((said, expected)) => (said, Some(expected)),
        None => (message.as_str(), None),
    };
    let span = Span::new(range.start, range.end);
    let mut found = Diagnostic::error(span, format!("{NOT_TOML}{said}"));
    found.help = if said.contains("unquoted key") {
        let line = line_of(text, range.start);
        let written = text.get(line.start..range.start).unwrap_or_default();
        let begin = written.rfind(|c| " \t{,.".contains(c)).map_or(0, |at| at + 1);
        let behind = text.get(line.start + begin..line.end).unwrap_or_default();
        let key = behind.split(['=', '}']).next().unwrap_or_default().trim();
        Some(format!(
            "keys are of `A-Z`, `a-z`, `0-9`, `-` and `_`; another stands in quotes: \"{key}\""
        ))
    } else {
        expected.map(|expected| format!("{expected} is expected here"))
    };
    found
}

#[cfg(test)]
mod tests {
    use toml::de::DeTable;

    use super::*;

    /// Returns the line, the message and the help of each syntax error in a text.
    fn told(text: &str) -> Vec<(usize, String, String)> {
        let (_, errors) = DeTable::parse_recoverable(text);
        let failure = |err: &toml::de::Error| TomlError {
            message: err.message().to_owned(),
            range: err.span().unwrap_or(0..0),
        };
        let failures: Vec<_> = errors.iter().map(failure).collect();
        let told = mistakes(text, &failures).into_iter().map(|found| {
            let line = number(text, found.span.start as usize);
            let message = found.message.trim_start_matches(NOT_TOML).to_owned();
            (line, message, found.help.unwrap_or_default())
        });
        told.collect()
    }

    #[track_caller]
    fn check(text: &str, expected: &[(usize, &str, &str)]) {
        let told = told(text);
        let told: Vec<_> =
            told.iter().map(|(line, message, help)| (*line, &**message, &**help)).collect();
        assert_eq!(told, expected, "{text}");
    }

    #[test]
    fn values_without_quotes() {
        let quotes = "a text stands in quotes";
        check("name = thermometer-1\n", &[(1, quotes, "write \"thermometer-1\"")]);
        check("name = office\n", &[(1, quotes, "write \"office\"")]);
        check("on = yes\n", &[(1, quotes, "write true, or \"yes\" if it is a text")]);
        let unit = "write 21, the number alone; a text stands in quotes: \"21 C\"";
        let minus = "`–0.4` begins with a dash that is no minus";
        check("t = { y = –0.4 }\n", &[(1, minus, "write -0.4")]);
        check("t = { a = 21 C, b = 3 }\n", &[(1, "`21 C` is no number", unit)]);
        check("speed = 0,3\n", &[(1, "numbers have a point", "write 0.3")]);
        check("t = { speed = 0,35 }\n", &[(1, "numbers have a point", "write 0.35")]);
        check(
            "name = “office”\n",
            &[(1, "this is not the quote that texts stand in", "write a straight one: \"")],
        );
        assert!(told("name = \"office\nother = 1\n")[0].1.starts_with("a text is not closed"));
        check("name = `office`\n", &[(1, quotes, "write \"office\"")]);
    }

    #[test]
    fn signs_that_do_not_belong_there() {
        let space = "write a normal space; some editors and web pages put another one";
        check("name\u{a0}= \"office\"\n", &[(1, "a no-break space is no space here", space)]);
        let slashes = "write `/` in paths: \"../words/domain.pddl\"";
        let path = "domain = \"..\\words\\domain.pddl\"\n";
        check(path, &[(1, "`\\` has a meaning of its own in a text", slashes)]);
        let comma = "take it out; entries of a table are separated by commas";
        check("t = { a = \"b\"; }\n", &[(1, "`;` ends nothing in TOML", comma)]);
    }

    #[test]
    fn lines_of_other_languages() {
        let joined = "a key and its value are joined by `=`";
        check("mode: \"central\"\n", &[(1, joined, "write mode = \"central\"")]);
        check(
            "a = 1\nconfig:\n  location: hall\n",
            &[(2, joined, "write config = …"), (3, joined, "write location = hall")],
        );
        let help = "an ecosystem file is TOML: write [ecosystem] in a line, and below it name = …";
        check("# school\necosystem:\n  name: school\n", &[(2, "this is YAML", help)]);
        let json = told("{\"ecosystem\": {\"name\": \"school\"}}");
        assert_eq!((json.len(), json[0].1.as_str()), (1, "this is JSON"));
        check("// goals\na = 1\n", &[(1, "this line is no comment", "a comment begins with `#`")]);
    }

    #[test]
    fn an_unclosed_bracket_is_reported_once() {
        check(
            "[[agent]]\nconfig = { location = \"a\"\n\n[[agent]]\nname = \"b\"\nplugin = \"c\"\n",
            &[(2, "this `{` is not closed", "write `}` at the end of the line")],
        );
        check(
            "[ecosystem]\ndaemons = [\"a\", \"b\"\nname = \"x\"\n",
            &[(2, "this `[` is not closed", "write `]` at the end of the line")],
        );
        check(
            "[[agent]\nname = \"a\"\n",
            &[(1, "a table begins with its name in brackets", "write [[agent]]")],
        );
    }

    #[test]
    fn a_duplicate_is_reported_once() {
        let help = "if this is another entry, write [[agent]] above it; if not, take one out";
        check(
            "[[agent]]\nname = \"a\"\nplugin = \"p\"\n\nname = \"b\"\nplugin = \"p\"\n",
            &[(5, "`name` is there already (line 2)", help)],
        );
        check(
            "[[agent]]\nname = \"a\"\n[agent]\nname = \"b\"\n[[agent]]\nname = \"c\"\n",
            &[(3, "`[agent]` is a single table, and there are several", "write [[agent]]")],
        );
        check(
            "[goals]\na = 1\n[building]\n[goals]\nb = 1\n",
            &[(4, "`[goals]` is there already", "it begins in line 1: write these keys there")],
        );
    }
}
