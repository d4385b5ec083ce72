//! `althing history`: shows what happened, when something last worked, and values over time.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use acl::AgentId;
use acl::content::{HistoryEvent, HistoryKind, HistoryPage, HistoryQuery};
use jiff::{Timestamp, Zoned};
use terminal::{exit, output, visible};

use crate::asking::history_reader::{HistoryAnswer, HistoryReadError, HistoryReader};
use crate::cli::history::HistoryArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::history_text::{self, EventLines, sentence};
use crate::commands::user_request::FAILED;
use crate::commands::{event_table, value_chart};
use crate::speech;

/// Number of values in the table below a chart.
const TABLE_VALUES: usize = 20;

/// Largest number of events that are read to say more about an answer.
const FURTHER_EVENTS: u32 = 1_000;

/// Number of facts that are named to a user who has named none.
const NAMED_FACTS: usize = 8;

/// Columns of the kind of an event.
const KIND_COLUMNS: usize = 10;

/// Runs `althing history`.
pub(super) fn run(args: &HistoryArgs) -> ExitCode {
    let json = args.print.json;
    if let (Some(since), Some(until)) = (args.since, args.until)
        && since > until
    {
        return super::wrong("--since is later than --until, so no time is between them", json);
    }
    client::with_link(&args.reach, json, async |link| {
        let code = match ask(&link.view, args).await {
            Ok((answer, more)) => print(&answer, &more, args),
            Err(error) => failed(&error, json),
        };
        (link, code)
    })
}

/// What is asked after the first answer.
#[derive(Debug, Default)]
struct Further {
    /// Time in which the fact of the answer held last.
    held: Option<HeldSpan>,
    /// Facts with numbers that are about the words, if they are no such fact themselves.
    numeric: Vec<String>,
    /// Whether the ecosystem file is known, which names goals.
    is_file_known: bool,
}

/// Time in which a fact held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct HeldSpan {
    from_ms: u64,
    /// `None` if it holds.
    to_ms: Option<u64>,
}

async fn ask(
    view: &EcosystemView,
    args: &HistoryArgs,
) -> Result<(HistoryAnswer, Further), HistoryReadError> {
    let mut reader = reader(view)?;
    let answer = reader.read(&query(view, args), args.limit(), true).await?;
    let mut more = Further { is_file_known: view.ecosystem.is_some(), ..Further::default() };
    let newest = answer.page.events.first();
    if let Some(newest) = newest.filter(|it| args.last && it.kind == HistoryKind::Fact) {
        let (fact, from_ms, to_ms) = (newest.subject.clone(), None, None);
        let values = HistoryQuery::Values { fact, from_ms, to_ms };
        more.held = held(&reader.read(&values, FURTHER_EVENTS, true).await?.page.events);
    }
    if args.values && newest.is_none() {
        let about = Some(subject(view, &args.what));
        let kinds = vec![HistoryKind::Fact];
        let facts = HistoryQuery::Events { about, kinds, from_ms: None, to_ms: None };
        more.numeric = numeric(&reader.read(&facts, FURTHER_EVENTS, true).await?.page.events);
    }
    Ok((answer, more))
}

/// Opens a reader for a command, which gets what is private if the rights of the ecosystem allow it.
pub(super) fn reader(view: &EcosystemView) -> Result<HistoryReader, HistoryReadError> {
    let own = AgentId::new(&client::guest_name("reader"))
        .map_err(|error| HistoryReadError::Silent(error.to_string()))?;
    HistoryReader::open(view, own)
}

/// Returns when a fact last held, from its events, newest first.
fn held(events: &[HistoryEvent]) -> Option<HeldSpan> {
    let holds = |event: &HistoryEvent| event.value.is_some() || event.text.ends_with("` holds");
    let newest = events.iter().position(holds)?;
    let (after, run) = events.split_at(newest);
    let value = run.first()?.value;
    let begin = run.iter().take_while(|event| holds(event) && event.value == value).last()?;
    Some(HeldSpan { from_ms: begin.at_ms, to_ms: after.last().map(|event| event.at_ms) })
}

/// Returns the facts that have numbers, each once.
fn numeric(events: &[HistoryEvent]) -> Vec<String> {
    let numbers = events.iter().filter(|event| event.value.is_some());
    let facts: BTreeSet<_> = numbers.map(|event| event.subject.clone()).collect();
    facts.into_iter().collect()
}

fn query(view: &EcosystemView, args: &HistoryArgs) -> HistoryQuery {
    let ms = |at: Timestamp| u64::try_from(at.as_millisecond()).unwrap_or(0);
    let (from_ms, to_ms) = (args.since.map(ms), args.until.map(ms));
    let what = subject(view, &args.what);
    match args {
        HistoryArgs { last: true, .. } => HistoryQuery::Last { about: what },
        HistoryArgs { values: true, .. } => HistoryQuery::Values { fact: what, from_ms, to_ms },
        HistoryArgs { kind, .. } => {
            let about = Some(what).filter(|what| !what.is_empty());
            HistoryQuery::Events { about, kinds: kind.clone(), from_ms, to_ms }
        }
    }
}

/// Returns what the user's words name: the goal, if they are the name of a goal in the ecosystem
/// file; otherwise the words, without a negation or a comparison with a value.
pub(super) fn subject(view: &EcosystemView, words: &[String]) -> String {
    let said = words.join(" ");
    let said = said.trim();
    let is_name = !said.contains(['(', ' ', '#']);
    let named = view.ecosystem.as_ref().filter(|_| is_name);
    match named.and_then(|ecosystem| ecosystem.find_goal(said).ok()) {
        Some(goal) => goal.goal,
        None if !said.contains(['(', '#']) && said.contains(' ') => {
            let read = speech::read_subject(said);
            read.as_deref().map_or(said, bare).to_owned()
        }
        None => bare(said).to_owned(),
    }
}

/// Returns a fact without its negation, or without the value that it is compared with.
fn bare(fact: &str) -> &str {
    let inner = fact.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')).map(str::trim);
    let Some(inner) = inner else { return fact };
    for operator in ["not", "="] {
        let rest = inner.strip_prefix(operator).map(str::trim_start);
        if let Some(rest) = rest.filter(|rest| rest.starts_with('('))
            && let Some(end) = rest.find(')')
        {
            return &rest[..=end];
        }
    }
    fact
}

/// Prints the reason why the history could not be read, and returns the exit code.
pub(super) fn failed(error: &HistoryReadError, json: bool) -> ExitCode {
    let unavailable = client::unavailable(&error.to_string(), json);
    match error {
        HistoryReadError::Refused(_) => exit::with(FAILED),
        HistoryReadError::NotKept(_) | HistoryReadError::Silent(_) => unavailable,
    }
}

/// Prints that the history knows nothing of the user's words, with what may have been meant.
pub(super) fn nothing_known(page: &HistoryPage, said: &str, is_file_known: bool) -> ExitCode {
    let near = page.near.iter().map(|near| speech::say(near));
    let near: Vec<_> = near.map(|near| format!("`{}`", visible::line(&near))).collect();
    // Only the ecosystem file says which goal a name stands for.
    let is_name = !said.contains(['(', ' ', '#']);
    let hint = match is_name && !is_file_known {
        true => " (a goal has a name in its file only: `--ecosystem FILE`)",
        false => "",
    };
    let said = visible::line(said);
    let meant = match near.as_slice() {
        _ if page.withheld > 0 => "what it knows is private".to_owned(),
        [] => match page.oldest_ms {
            Some(oldest) => {
                let begins = history_text::moment(oldest, &Zoned::now());
                format!("it goes back to {begins}")
            }
            None => "it is empty yet".to_owned(),
        },
        near => format!("did you mean {}?", near.join(" or ")),
    };
    output::print_note(&format!("the history knows nothing of `{said}`; {meant}{hint}"));
    exit::with(FAILED)
}

fn print(answer: &HistoryAnswer, more: &Further, args: &HistoryArgs) -> ExitCode {
    let page = &answer.page;
    let code = if page.events.is_empty() { FAILED } else { exit::DONE };
    if args.print.json {
        return output::print_json(&history_text::json(answer), code);
    }
    history_text::print_notices(answer);
    let now = Zoned::now();
    let oldest_first: Vec<_> = page.events.iter().rev().collect();
    if args.csv {
        return output::print(event_table::csv(&oldest_first), code);
    }
    if page.events.is_empty() {
        return nothing(page, more, args, &now);
    }
    let text = match args {
        HistoryArgs { last: true, .. } => last(page, more.held, now),
        HistoryArgs { values: true, .. } => {
            let until = args.until.map_or(now.timestamp(), |until| until.min(now.timestamp()));
            values(&oldest_first, until, now)
        }
        _ => list(&oldest_first, page, args, now),
    };
    output::print(text, code)
}

/// Says that there is no event, and why, as far as that is known.
fn nothing(page: &HistoryPage, more: &Further, args: &HistoryArgs, now: &Zoned) -> ExitCode {
    let said = args.what.join(" ");
    let is_in_time = args.since.is_some() || args.until.is_some();
    let is_limited = is_in_time || !args.kind.is_empty();
    let is_numeric = more.numeric.iter().any(|fact| fact.eq_ignore_ascii_case(bare(said.trim())));
    if args.values && page.near.is_empty() && page.withheld == 0 && !is_numeric {
        output::print_note(&no_values(&said, &more.numeric));
        return exit::with(FAILED);
    }
    if page.near.is_empty() && (is_limited || said.is_empty()) {
        output::print_note(&match is_limited {
            true => nothing_within(page, args, &said, now),
            false => "nothing has happened yet".to_owned(),
        });
        return exit::with(FAILED);
    }
    nothing_known(page, &said, more.is_file_known)
}

/// Returns that nothing happened within the limits that the user gave.
fn nothing_within(page: &HistoryPage, args: &HistoryArgs, said: &str, now: &Zoned) -> String {
    let kind = if args.kind.is_empty() { "" } else { " of that kind" };
    let is_in_time = args.since.is_some() || args.until.is_some();
    let time = if is_in_time { " in that time" } else { "" };
    let about = match said {
        "" => String::new(),
        said => format!(" about `{}`", visible::line(said)),
    };
    let begins = page.oldest_ms.map(|oldest| history_text::moment(oldest, now));
    let begins = begins.map(|begins| format!("; the history goes back to {begins}"));
    format!("nothing{kind} happened{time}{about}{}", begins.unwrap_or_default())
}

/// Returns that the user's words are no fact with a number, and which such facts are about them.
fn no_values(said: &str, numeric: &[String]) -> String {
    let names = numeric.iter().take(NAMED_FACTS).map(|fact| format!("`{}`", visible::line(fact)));
    let names: Vec<_> = names.collect();
    let said = visible::line(said);
    let known = match names.as_slice() {
        [] => format!("the history knows none about `{said}`"),
        [name] => format!("about `{said}` there is {name}"),
        names => format!("about `{said}` there are {}", names.join(", ")),
    };
    format!("--values needs a fact with a number, such as \"(temperature office1)\"; {known}")
}

/// Returns the events as lines, oldest first.
fn list(events: &[&HistoryEvent], page: &HistoryPage, args: &HistoryArgs, now: Zoned) -> String {
    let mut lines = EventLines::new(now);
    if page.next.is_some() || events.len() < page.events.len() {
        let more = args.limit().saturating_mul(10);
        lines.remark(&format!("… earlier events: --limit {more}"));
    }
    for event in events {
        let kind = event.kind.as_str();
        let line = format!("{kind:<KIND_COLUMNS$}{}", sentence(event));
        lines.add(event.at_ms, &line, KIND_COLUMNS);
    }
    lines.into_text()
}

/// Returns when something last worked, newest first.
fn last(page: &HistoryPage, held: Option<HeldSpan>, now: Zoned) -> String {
    let now_ms = u64::try_from(now.timestamp().as_millisecond()).unwrap_or(0);
    let mut text = String::new();
    for (index, event) in page.events.iter().enumerate() {
        if let Some(span) = held.filter(|_| index == 0) {
            let _ = writeln!(text, "{}", output::folded(&held_text(event, span, &now), 2));
            continue;
        }
        let ago = super::brief(Duration::from_millis(now_ms.saturating_sub(event.at_ms)));
        let at = history_text::moment(event.at_ms, &now);
        let line = format!("{at}, {ago} ago: {}", sentence(event));
        let _ = writeln!(text, "{}", output::folded(&line, 2));
    }
    text
}

/// Returns from when to when a fact held, or had its value.
fn held_text(event: &HistoryEvent, HeldSpan { from_ms, to_ms }: HeldSpan, now: &Zoned) -> String {
    let now_ms = u64::try_from(now.timestamp().as_millisecond()).unwrap_or(0);
    let subject = visible::line(&event.subject);
    let private = if event.private { " (private)" } else { "" };
    let from = history_text::moment(from_ms, now);
    let ago = |ms: u64| super::brief(Duration::from_millis(now_ms.saturating_sub(ms)));
    let verb = match (event.value, to_ms) {
        (None, None) => "holds".to_owned(),
        (None, Some(_)) => "held".to_owned(),
        (Some(value), None) => format!("is {value}"),
        (Some(value), Some(_)) => format!("was {value}"),
    };
    match to_ms.map(|to_ms| (ago(to_ms), history_text::moment(to_ms, now))) {
        None => format!("{from}, {} ago: `{subject}` {verb} since then{private}", ago(from_ms)),
        Some((ago, to)) => {
            format!("{to}, {ago} ago: `{subject}` {verb} from {from} to {to}{private}")
        }
    }
}

/// Returns a chart of the values, if they are numbers, and a table of the newest ones.
fn values(events: &[&HistoryEvent], until: Timestamp, now: Zoned) -> String {
    let numbers: Vec<_> =
        events.iter().filter_map(|event| Some((event.at_ms, event.value?))).collect();
    let end_ms = u64::try_from(until.as_millisecond()).unwrap_or(0);
    let mut text = value_chart::chart(&numbers, end_ms, &now).unwrap_or_default();
    let older = events.len().saturating_sub(TABLE_VALUES);
    let mut lines = EventLines::new(now);
    if older > 0 {
        lines.remark(&format!("… {older} earlier (--csv prints all)"));
    }
    for event in &events[older..] {
        lines.add(event.at_ms, &sentence(event), 0);
    }
    text += &lines.into_text();
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fact(at_ms: u64, text: &str, value: Option<f64>) -> HistoryEvent {
        HistoryEvent {
            number: at_ms,
            at_ms,
            kind: HistoryKind::Fact,
            subject: "(lit hall)".to_owned(),
            agent: None,
            text: text.to_owned(),
            conversation: None,
            cause: None,
            root: None,
            value,
            private: false,
        }
    }

    #[test]
    fn a_fact_held_from_a_time_to_a_time() {
        let hour = |text: &str| {
            let at = format!("2026-11-28T{text}Z").parse::<Timestamp>().expect("a time");
            u64::try_from(at.as_millisecond()).expect("after 1970")
        };
        let at = |text: &str, said: &str| fact(hour(text), &format!("`(lit hall)` {said}"), None);
        let mut newest_first = vec![
            at("12:56:00", "is unknown"),
            at("12:55:32", "holds no longer"),
            at("12:53:00", "holds"),
            at("12:52:07", "holds"),
            at("12:40:00", "does not hold"),
            at("12:30:00", "holds"),
        ];
        let now = "2026-11-28T12:58:32Z".parse::<Timestamp>().expect("a time");
        let now = now.to_zoned(jiff::tz::TimeZone::UTC);
        let told =
            |events: &[HistoryEvent]| held_text(&events[0], held(events).expect("it held"), &now);
        let text = told(&newest_first);
        assert!(text.ends_with(" ago: `(lit hall)` held from 12:52:07 to 12:55:32"), "{text}");
        newest_first.drain(..2);
        let text = told(&newest_first);
        assert!(text.starts_with("12:52:07, 6"), "{text}");
        assert!(text.ends_with(" ago: `(lit hall)` holds since then"), "{text}");
        assert_eq!(held(&newest_first[2..3]), None);
        let text = told(&[fact(hour("12:58:00"), "is 21.5, after 21", Some(21.5))]);
        assert!(text.ends_with(" ago: `(lit hall)` is 21.5 since then"), "{text}");
    }

    #[test]
    fn values_need_a_fact_with_a_number() {
        let facts = [fact(1, "is 2", Some(2.0)), fact(2, "is 3", Some(3.0)), fact(3, "x", None)];
        let numeric = numeric(&facts);
        assert_eq!(numeric, ["(lit hall)"]);
        assert!(no_values("hall", &numeric).ends_with("about `hall` there is `(lit hall)`"));
        assert!(no_values("lab", &[]).ends_with("the history knows none about `lab`"));
    }

    #[test]
    fn a_fact_is_named_with_or_without_its_value() {
        for (said, expected) in [
            ("(= (temperature office1) 21.5)", "(temperature office1)"),
            ("(not (lit hall))", "(lit hall)"),
            ("(lit hall)", "(lit hall)"),
            ("(notable hall)", "(notable hall)"),
            ("turtlebot-1", "turtlebot-1"),
            ("(", "("),
            ("(=)", "(=)"),
            ("(not (lit", "(not (lit"),
        ] {
            assert_eq!(bare(said), expected, "{said}");
        }
    }
}
