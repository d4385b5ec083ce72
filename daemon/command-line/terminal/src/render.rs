//! Draws diagnostics: for people with the line and a caret, for programs as JSON.
//!
//! - Only this module defines the form of a diagnostic. The text fits into 80 columns, and uses
//!   more columns on a wider terminal.
//! - The module draws [`DiagnosticReport`]s as text, and writes nothing to a stream itself.

use std::borrow::Cow;

use annotate_snippets::{
    Annotation, AnnotationKind, Element, Group, Level, Origin, Renderer, Snippet,
};
use pddl::{Diagnostic, Severity, Span};
use serde_json::{Value, json};

use crate::report::{DiagnosticReport, SourceText, SourcedDiagnostic};
use crate::visible;

/// Number of columns of the terminal if it is not known.
const WIDTH: usize = 80;
/// Maximum number of columns of a line: longer lines of prose are hard to read, however wide the
/// terminal is.
const WIDTH_MAX: usize = 120;
/// Maximum number of lines between a diagnostic and its note that one excerpt of the text can show
/// together. A note that is further away gets an excerpt of its own.
const EXCERPT_LINES_MAX: usize = 30;
/// Maximum number of bytes that are drawn after the last marked place in an excerpt. No terminal is
/// as wide.
const AFTER_BYTES_MAX: usize = 2_000;
/// Maximum number of bytes of an excerpt. Drawing takes time for each byte, and a line of a text
/// from outside may have millions. A longer excerpt is replaced by its place.
const EXCERPT_BYTES_MAX: usize = 8_000;
/// Maximum number of diagnostics shown to a person; further ones are only counted. `--json` lists
/// all.
const FINDINGS_MAX: usize = 200;

/// Width and colors of the drawn text.
#[derive(Clone, Copy, Debug)]
pub struct RenderStyle {
    width: usize,
    colored: bool,
}

/// Part of a text that is drawn with a diagnostic, with its offset in the text and the number of
/// its first line.
struct Excerpt<'a> {
    text: &'a str,
    start: usize,
    line: usize,
}

// === impl RenderStyle ===

impl RenderStyle {
    /// Returns the style for stderr: the width of its terminal, and whether colors are allowed.
    pub fn of_stderr() -> RenderStyle {
        let width = terminal_size::terminal_size_of(std::io::stderr())
            .map_or(WIDTH, |(width, _)| usize::from(width.0));
        RenderStyle {
            width: width.clamp(WIDTH / 2, WIDTH_MAX),
            colored: crate::formatting::stderr_is_colored(),
        }
    }

    fn renderer(self) -> Renderer {
        let renderer = if self.colored { Renderer::styled() } else { Renderer::plain() };
        renderer.term_width(self.width)
    }
}

/// Draws all diagnostics of a report for people, with a blank line after each.
pub fn human(report: &DiagnosticReport, look: RenderStyle) -> String {
    let renderer = look.renderer();
    let shown = report.findings().iter().take(FINDINGS_MAX);
    let mut text: String =
        shown.map(|finding| draw(finding, &renderer, look.width) + "\n\n").collect();
    let omitted = report.findings().len().saturating_sub(FINDINGS_MAX);
    if omitted > 0 {
        text += &format!("… and {omitted} more; `--json` lists all\n");
    }
    text
}

/// Returns the numbers of errors, warnings and hints in words, such as “2 errors and 1 warning”, or
/// “no mistakes”.
pub fn summary(report: &DiagnosticReport) -> String {
    let counts =
        [(Severity::Error, "error"), (Severity::Warning, "warning"), (Severity::Hint, "hint")]
            .map(|(severity, noun)| (report.count(severity), noun));
    let told: Vec<String> =
        counts.iter().filter(|(count, _)| *count > 0).map(|(n, noun)| plural(*n, noun)).collect();
    match told.split_last() {
        None => "no mistakes".to_owned(),
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} and {last}", rest.join(", ")),
    }
}

/// Returns a count with its noun: “1 step”, “2 steps”.
pub fn plural(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Converts a number to JSON. A whole number has no decimal point.
pub fn number(value: f64) -> Value {
    // 2^53: up to there every whole number has an exact float.
    const WHOLE_MAX: f64 = 9_007_199_254_740_992.0;
    if value.fract() == 0.0 && value.abs() <= WHOLE_MAX {
        json!(value as i64)
    } else {
        json!(value)
    }
}

/// Returns all diagnostics of a report as a JSON array. `line` and `column` count from 1; a column
/// is one character.
pub fn json(report: &DiagnosticReport) -> Value {
    report.findings().iter().map(json_finding).collect()
}

fn json_finding(finding: &SourcedDiagnostic) -> Value {
    let SourcedDiagnostic { source, diagnostic } = finding;
    let place = |span: Span| source.as_ref().map(|source| source.line_column(span));
    let at = place(diagnostic.span);
    let notes: Vec<Value> = diagnostic
        .notes
        .iter()
        .map(|note| {
            let at = place(note.span);
            let message = without_passwords(&note.message);
            json!({ "line": at.map(|at| at.0), "column": at.map(|at| at.1), "message": message })
        })
        .collect();
    json!({
        "severity": diagnostic.severity.to_string(),
        "file": source.as_ref().map(|source| source.name.as_str()),
        "line": at.map(|at| at.0),
        "column": at.map(|at| at.1),
        "message": without_passwords(&diagnostic.message),
        "label": diagnostic.label.as_deref().map(without_passwords),
        "help": diagnostic.help.as_deref().map(without_passwords),
        "rule": diagnostic.rule,
        "notes": notes,
    })
}

fn draw(finding: &SourcedDiagnostic, renderer: &Renderer, width: usize) -> String {
    let diagnostic = &safe(&finding.diagnostic);
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
        Severity::Hint => Level::INFO.with_name("hint"),
    };
    let title = wrap(&diagnostic.message, width.saturating_sub("warning: ".len()));
    let mut group = Group::with_title(level.primary_title(title));
    if let Some(source) = &finding.source {
        for snippet in snippets(source, diagnostic) {
            group = group.element(snippet);
        }
    }
    if finding.source.is_none() {
        let below = diagnostic.help.as_ref().map(|help| {
            let help = wrap(help, width.saturating_sub("help: ".len()));
            Group::with_title(Level::HELP.secondary_title(help))
        });
        let groups: Vec<Group<'_>> = [group].into_iter().chain(below).collect();
        return renderer.render(&groups);
    }
    // Margin of a snippet: line number, ` = `, and the name of the line.
    let width = width.saturating_sub("1234 = help: ".len());
    if let Some(help) = &diagnostic.help {
        group = group.element(Level::HELP.message(wrap(help, width)));
    }
    if let Some(rule) = &diagnostic.rule {
        group = group.element(Level::NOTE.with_name("rule").message(wrap(rule, width)));
    }
    renderer.render(&[group])
}

/// Returns a diagnostic with the control characters in its texts made visible, so that a terminal
/// does not execute them, and with the passwords in them masked.
fn safe(diagnostic: &Diagnostic) -> Diagnostic {
    let text = |text: &String| without_passwords(&visible::text(text)).into_owned();
    let mut safe = diagnostic.clone();
    safe.message = text(&diagnostic.message);
    safe.label = diagnostic.label.as_ref().map(text);
    safe.help = diagnostic.help.as_ref().map(text);
    let rule = diagnostic.rule.as_deref();
    safe.rule = rule.map(|rule| Cow::Owned(visible::text(rule).into_owned()));
    for note in &mut safe.notes {
        note.message = text(&note.message);
    }
    safe
}

/// Returns the excerpts that are drawn for a diagnostic: one with the place of the diagnostic and
/// of the notes near it, and one for each other note.
fn snippets<'a>(source: &'a SourceText, diagnostic: &'a Diagnostic) -> Vec<Element<'a>> {
    let line = |span: Span| source.line_column(span).0;
    let home = line(diagnostic.span);
    let is_near = |span: Span| line(span).abs_diff(home) <= EXCERPT_LINES_MAX;
    let (near, far): (Vec<_>, Vec<_>) =
        diagnostic.notes.iter().partition(|note| is_near(note.span));

    let spans = near.iter().map(|note| note.span).chain([diagnostic.span]);
    let excerpt = Excerpt::of(&source.text, spans);
    if excerpt.is_too_long() {
        let message = |note: &'a pddl::Note| Element::from(Level::NOTE.message(&note.message));
        let notes = diagnostic.notes.iter().map(message);
        return [place(source, diagnostic.span)].into_iter().chain(notes).collect();
    }
    let mut first = excerpt.snippet(source).annotation(excerpt.annotation(
        AnnotationKind::Primary,
        diagnostic.span,
        diagnostic.label.as_deref(),
    ));
    for note in near {
        let message = Some(note.message.as_str());
        first = first.annotation(excerpt.annotation(AnnotationKind::Context, note.span, message));
    }
    let others = far.into_iter().map(|note| -> Element<'a> {
        let excerpt = Excerpt::of(&source.text, [note.span]);
        if excerpt.is_too_long() {
            return Level::NOTE.message(&note.message).into();
        }
        let message = Some(note.message.as_str());
        let mark = excerpt.annotation(AnnotationKind::Context, note.span, message);
        excerpt.snippet(source).annotation(mark).into()
    });
    [Element::from(first)].into_iter().chain(others).collect()
}

/// Returns the place of a span, without an excerpt of the text.
fn place(source: &SourceText, span: Span) -> Element<'_> {
    let (line, column) = source.line_column(span);
    Origin::path(visible::line(&source.name)).line(line).char_column(column).into()
}

// === impl Excerpt ===

impl<'a> Excerpt<'a> {
    /// Returns the lines of `text` from the first line in which one of `spans` begins to the last
    /// such line.
    fn of(text: &'a str, spans: impl IntoIterator<Item = Span>) -> Excerpt<'a> {
        let mut starts: Vec<usize> =
            spans.into_iter().map(|span| boundary(text, span.start as usize)).collect();
        starts.sort_unstable();
        let (first, last) = match starts[..] {
            [] => (0, 0),
            [only] => (only, only),
            [first, .., last] => (first, last),
        };
        let start = text[..first].rfind('\n').map_or(0, |newline| newline + 1);
        let end = text[last..].find('\n').map_or(text.len(), |newline| last + newline);
        let end = boundary(text, end.min(last + AFTER_BYTES_MAX));
        Excerpt { text: &text[start..end], start, line: pddl::line_column(text, first).0 }
    }

    fn is_too_long(&self) -> bool {
        self.text.len() > EXCERPT_BYTES_MAX
    }

    fn snippet(&self, source: &'a SourceText) -> Snippet<'a, Annotation<'a>> {
        let text = match visible::same_length(self.text) {
            Cow::Borrowed(text) => without_passwords(text),
            // The length of the text must not change, because places are byte offsets.
            Cow::Owned(text) => Cow::Owned(without_passwords(&text).into_owned()),
        };
        let name = visible::line(&source.name);
        Snippet::source(text).line_start(self.line).path(name).fold(true)
    }

    /// Returns the mark for a span in this excerpt; if the span has several lines, only the first
    /// is marked.
    fn annotation(
        &self,
        kind: AnnotationKind,
        span: Span,
        label: Option<&'a str>,
    ) -> Annotation<'a> {
        let start = boundary(self.text, (span.start as usize).saturating_sub(self.start));
        let end = boundary(self.text, (span.end as usize).saturating_sub(self.start)).max(start);
        let line_end = self.text[start..end].find(['\n', '\r']).map_or(end, |at| start + at);
        kind.span(start..line_end).label(label)
    }
}

/// Returns `offset`, or the nearest boundary of a character below it.
fn boundary(text: &str, offset: usize) -> usize {
    let mut offset = offset.min(text.len());
    while !text.is_char_boundary(offset) {
        offset -= 1;
    }
    offset
}

/// Breaks the lines of a text at spaces if they would be longer than `width` characters.
fn wrap(text: &str, width: usize) -> String {
    let mut wrapped = String::with_capacity(text.len());
    let mut column = 0;
    for word in text.split_inclusive([' ', '\n']) {
        let length = word.trim_end().chars().count();
        if column > 0 && column + length > width {
            wrapped.truncate(wrapped.trim_end().len());
            wrapped.push('\n');
            column = 0;
        }
        wrapped.push_str(word);
        column = if word.ends_with('\n') { 0 } else { column + word.chars().count() };
    }
    wrapped.truncate(wrapped.trim_end().len());
    wrapped
}

/// Masks the passwords in a text, so that the text can be shown and logged. Each byte of the
/// password in `SCHEME://USER:PASSWORD@HOST` becomes a star, so that byte offsets stay the same.
fn without_passwords(text: &str) -> Cow<'_, str> {
    let mut masked = Cow::Borrowed(text);
    for (scheme, _) in text.match_indices("://") {
        let user = scheme + "://".len();
        let ends = |symbol: char| symbol.is_whitespace() || "\"'/".contains(symbol);
        let end = text[user..].find(ends).map_or(text.len(), |length| user + length);
        let Some(at) = text[user..end].rfind('@').map(|place| user + place) else { continue };
        let Some(colon) = text[user..at].find(':').map(|place| user + place) else { continue };
        masked.to_mut().replace_range(colon + 1..at, &"*".repeat(at - colon - 1));
    }
    masked
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};

    use super::*;

    const PLAIN: RenderStyle = RenderStyle { width: 60, colored: false };

    #[track_caller]
    fn check(text: &str, diagnostic: Diagnostic, expected: Expect) {
        let mut report = DiagnosticReport::default();
        report.add(&SourceText::new("file", text), [diagnostic]);
        expected.assert_eq(&human(&report, PLAIN));
    }

    fn error(start: usize, end: usize) -> Diagnostic {
        Diagnostic::error(Span::new(start, end), "wrong")
    }

    #[test]
    fn a_line_of_millions_of_bytes_costs_no_more_than_others() {
        let text = format!("({})", "ab ".repeat(2_000_000));
        let began = std::time::Instant::now();
        let drawn = |diagnostic: Diagnostic| {
            let mut report = DiagnosticReport::default();
            report.add(&SourceText::new("file", text.as_str()), [diagnostic]);
            human(&report, PLAIN)
        };
        let near = drawn(error(1, text.len()));
        assert!(near.contains("--> file:1:2\n") && near.contains("ab ab"), "{near}");
        assert!(near.len() < 1_000, "{near:.1000}");
        let note = "the first is here";
        let far = drawn(error(3_000_001, 3_000_003).with_note(Span::new(1, 3), note));
        assert!(far.contains("--> file:1:3000002\n") && far.contains(note), "{far:.1000}");
        assert!(!far.contains("ab ab"), "{far:.1000}");
        assert!(began.elapsed().as_secs() < 5, "{:?}", began.elapsed());
    }

    #[test]
    fn a_password_is_not_shown() {
        for (text, expected) in [
            ("a = \"mqtt://me:hunter2@host:1883\"", "a = \"mqtt://me:*******@host:1883\""),
            ("a = \"mqtt://me:hünt@r@host\" b", "a = \"mqtt://me:*******@host\" b"),
            ("https://host:80/me@x tcp/host:1", "https://host:80/me@x tcp/host:1"),
            ("mqtt://me@host", "mqtt://me@host"),
        ] {
            assert_eq!(without_passwords(text), expected);
        }
        let help = "write command = [\"curl\", \"http://me:hunter2@host/now\"]";
        let mut report = DiagnosticReport::default();
        let text = "command = \"curl http://me:hunter2@host/now\"";
        report.add(&SourceText::new("file", text), [error(10, 12).with_help(help)]);
        for shown in
            [human(&report, RenderStyle { width: 200, ..PLAIN }), json(&report).to_string()]
        {
            assert!(shown.contains("http://me:*******@host/now"), "{shown}");
            assert!(!shown.contains("hunter2"), "{shown}");
        }
    }

    #[test]
    fn only_the_first_of_many_lines_is_marked() {
        check(
            "(a\n b\n c)\n",
            error(0, 9),
            expect![[r#"
            error: wrong
             --> file:1:1
              |
            1 | (a
              | ^^

        "#]],
        );
    }

    #[test]
    fn a_span_at_or_past_the_end_marks_the_end() {
        check(
            "(a",
            error(2, 2),
            expect![[r#"
            error: wrong
             --> file:1:3
              |
            1 | (a
              |   ^

        "#]],
        );
        check(
            "",
            error(0, 0),
            expect![[r#"
            error: wrong
             --> file:1:1
              |
            1 |
              | ^

        "#]],
        );
        check(
            "(a\r\n",
            error(99, 100),
            expect![[r#"
            error: wrong
             --> file:2:1
              |
            2 |
              | ^

        "#]],
        );
    }

    #[test]
    fn long_lines_and_long_words_are_kept_within_the_width() {
        let text = format!("{} here {}", "before ".repeat(30), "after ".repeat(30));
        let long = error(211, 215).with_help("a word ".repeat(12)).with_label("this");
        check(
            &text,
            long,
            expect![[r#"
            error: wrong
             --> file:1:212
              |
            1 | ...fore before before  here after after after after a...
              |                        ^^^^ this
              |
              = help: a word a word a word a word a word a word a
                      word a word a word a word a word a word

        "#]],
        );
    }

    #[test]
    fn places_far_away_have_an_excerpt_of_their_own() {
        let text = format!("first\n{}last\n", "\n".repeat(40));
        let diagnostic = error(46, 50).with_note(Span::new(0, 5), "begun here");
        check(
            &text,
            diagnostic,
            expect![[r#"
            error: wrong
              --> file:42:1
               |
            42 | last
               | ^^^^
               |
              ::: file:1:1
               |
             1 | first
               | ----- begun here

        "#]],
        );
    }

    #[test]
    fn control_characters_are_made_visible() {
        check(
            "a\u{1b}[31mb ü\t日本 c",
            error(13, 19),
            expect![[r#"
            error: wrong
             --> file:1:11
              |
            1 | a␛[31mb ü    日本 c
              |              ^^^^^^

        "#]],
        );
    }

    #[test]
    fn whole_numbers_have_no_decimal_point() {
        assert_eq!(number(2.0).to_string(), "2");
        assert_eq!(number(2.5).to_string(), "2.5");
        assert_eq!(number(1e300).to_string(), "1e+300");
        assert_eq!(number(f64::NAN).to_string(), "null");
    }
}
