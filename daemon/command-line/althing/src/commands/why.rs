//! `althing why`: prints what caused a fact, a step, a goal or what an agent did, up to a person, a
//! sensor, a clock, or an agent that left or joined; or what it led to.

use std::collections::BTreeMap;
use std::process::ExitCode;

use acl::ConversationId;
use acl::content::{HistoryEvent, HistoryKind, HistoryPage, HistoryQuery};
use jiff::Zoned;
use terminal::{exit, output};

use crate::asking::goal_numbers;
use crate::asking::history_reader::{HistoryAnswer, HistoryReadError};
use crate::cli::history::WhyArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::history::{failed, nothing_known, reader, subject};
use crate::commands::history_text::{self, EventLines, root_text, sentence};
use crate::commands::user_request::FAILED;

/// Largest number of events of a chain, or of effects, that are shown.
const EVENTS_MAX: u32 = 1_000;

/// Greatest depth that is shown by indentation; deeper effects are indented alike.
const DEPTH_MAX: usize = 8;

/// Runs `althing why`.
pub(super) fn run(args: &WhyArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let what = match named_goal(&link.view, &args.what).await {
            Ok(Some(conversation)) => vec![conversation.as_str().to_owned()],
            Ok(None) => args.what.clone(),
            Err(problem) => return (link, super::wrong(&problem, json)),
        };
        let code = match ask(&link.view, &what, args.effects).await {
            Ok(answer) => {
                let is_file_known = link.view.ecosystem.is_some();
                print(&answer, args, is_file_known)
            }
            Err(error) => failed(&error, json),
        };
        (link, code)
    })
}

/// Returns the conversation of the goal that `what` names by its number; `None` if it names
/// something else.
async fn named_goal(
    view: &EcosystemView,
    what: &[String],
) -> Result<Option<ConversationId>, String> {
    // `#` and a number name an event of the history.
    match what {
        [only] if !only.starts_with('#') && goal_numbers::number(only).is_some() => {
            goal_numbers::conversation(view, only).await.map(Some)
        }
        _ => Ok(None),
    }
}

async fn ask(
    view: &EcosystemView,
    what: &[String],
    effects: bool,
) -> Result<HistoryAnswer, HistoryReadError> {
    let subject = subject(view, what);
    let mut reader = reader(view)?;
    let causes = reader.read(&HistoryQuery::Why { subject }, EVENTS_MAX, true).await?;
    match first_of_subject(&causes.page).filter(|_| effects) {
        Some(event) => {
            let subject = format!("#{}", event.number);
            reader.read(&HistoryQuery::Effects { subject }, EVENTS_MAX, true).await
        }
        None => Ok(causes),
    }
}

/// Returns the event of a chain whose effects are shown: the newest event of the subject or, if that
/// is one of a goal, the first event of that goal.
fn first_of_subject(page: &HistoryPage) -> Option<&HistoryEvent> {
    let newest = page.events.first()?;
    let is_goal = |event: &&HistoryEvent| {
        event.kind == HistoryKind::Goal && event.conversation == newest.conversation
    };
    match newest.kind {
        HistoryKind::Goal => page.events.iter().rev().find(is_goal),
        _ => Some(newest),
    }
}

fn print(answer: &HistoryAnswer, args: &WhyArgs, is_file_known: bool) -> ExitCode {
    let (page, json, effects) = (&answer.page, args.print.json, args.effects);
    let code = if page.events.is_empty() { FAILED } else { exit::DONE };
    if json {
        return output::print_json(&history_text::json(answer), code);
    }
    history_text::print_notices(answer);
    if page.events.is_empty() {
        return nothing_known(page, &args.what.join(" "), is_file_known);
    }
    let now = Zoned::now();
    output::print(if effects { tree(page, now) } else { chain(page, now) }, code)
}

/// Returns a chain of causes, from the thing to its root.
fn chain(page: &HistoryPage, now: Zoned) -> String {
    let mut lines = EventLines::new(now.clone());
    for (index, event) in page.events.iter().enumerate() {
        let because = if index == 0 { "" } else { "because " };
        lines.add(event.at_ms, &format!("{because}{}", sentence(event)), because.len());
    }
    if let Some(last) = page.events.last() {
        lines.remark(&end(last, page, &now));
    }
    lines.into_text()
}

/// Returns how a chain ends with the event `last`.
fn end(last: &HistoryEvent, page: &HistoryPage, now: &Zoned) -> String {
    let begins = page.oldest_ms.map(|oldest| history_text::moment(oldest, now));
    let begins = begins.map(|begins| format!(", which begins at {begins}")).unwrap_or_default();
    match (last.root, last.cause) {
        (Some(root), None) => root_text(root, last),
        (Some(root), Some(_)) => {
            let root = root_text(root, last);
            format!("the first cause: {root}; between is what is older than the history{begins}")
        }
        (None, Some(_)) if page.withheld > 0 => "the cause is private".to_owned(),
        (None, Some(_)) if page.next.is_some() => "the chain is longer than this".to_owned(),
        (None, Some(_)) => format!("the cause is older than the history{begins}"),
        (None, None) => "no cause of it was recorded".to_owned(),
    }
}

/// Returns an event and what it led to; effects of effects are indented.
fn tree(page: &HistoryPage, now: Zoned) -> String {
    let mut lines = EventLines::new(now);
    let mut depths = BTreeMap::new();
    for event in &page.events {
        let depth = event.cause.and_then(|cause| depths.get(&cause)).map_or(0, |depth| depth + 1);
        depths.insert(event.number, depth);
        let indent = 2 * depth.min(DEPTH_MAX);
        let text = format!("{:indent$}{}", "", sentence(event));
        lines.add(event.at_ms, &text, indent);
    }
    if page.events.len() == 1 {
        lines.remark("nothing that it led to was recorded");
    }
    if page.next.is_some() {
        lines.remark(&format!("… and more: only the first {} are shown", page.events.len()));
    }
    lines.into_text()
}

#[cfg(test)]
mod tests {
    use acl::AgentId;
    use acl::content::HistoryRoot;
    use expect_test::{Expect, expect};
    use jiff::Timestamp;
    use jiff::tz::TimeZone;

    use super::*;

    fn event(number: u64, cause: Option<u64>, text: &str) -> HistoryEvent {
        HistoryEvent {
            number,
            at_ms: 1_795_860_000_000 + number * 1_000,
            kind: HistoryKind::Step,
            subject: String::new(),
            agent: AgentId::new("desk").ok(),
            text: text.to_owned(),
            conversation: None,
            cause,
            root: cause.is_none().then_some(HistoryRoot::Person),
            value: None,
            private: false,
        }
    }

    fn page() -> HistoryPage {
        let events = vec![
            event(
                9,
                Some(8),
                "`turtlebot-1` was asked to do `(move turtlebot-1 corridor office1)`",
            ),
            event(8, Some(3), "a plan of 2 steps was chosen, cost 8"),
            event(3, None, "`desk` asked for `(known-temperature office1)`\x1b[2J"),
        ];
        HistoryPage { events, oldest_ms: Some(1_795_850_000_000), ..HistoryPage::default() }
    }

    fn now() -> Zoned {
        "2026-11-28T10:00:00Z".parse::<Timestamp>().expect("a time").to_zoned(TimeZone::UTC)
    }

    #[track_caller]
    fn check(shown: &str, expected: Expect) {
        expected.assert_eq(shown);
    }

    #[test]
    fn a_chain_leads_to_its_root() {
        check(
            &chain(&page(), now()),
            expect![[r#"
            10:00:09  `turtlebot-1` was asked to do `(move turtlebot-1 corridor office1)`
            10:00:08  because a plan of 2 steps was chosen, cost 8
            10:00:03  because `desk` asked for `temperature of office1 known`␛[2J
                      a person wanted it (`desk`)
        "#]],
        );
    }

    #[test]
    fn a_chain_that_is_cut_says_why() {
        let mut cut = page();
        cut.events.pop();
        let last = |page: &HistoryPage| {
            chain(page, now()).lines().last().expect("a line").trim().to_owned()
        };
        check(
            &last(&cut),
            expect!["the cause is older than the history, which begins at 07:13:20"],
        );
        cut.withheld = 1;
        check(&last(&cut), expect!["the cause is private"]);
        cut.events[1].root = Some(HistoryRoot::Clock);
        check(
            &last(&cut),
            expect![
                "the first cause: its time had come (`desk`); between is what is older than the history, which begins at 07:13:20"
            ],
        );
    }

    #[test]
    fn effects_begin_at_the_first_event_of_a_goal() {
        let mut page = page();
        let first = |page: &HistoryPage| first_of_subject(page).map(|event| event.number);
        assert_eq!(first(&page), Some(9));
        page.events.iter_mut().for_each(|event| event.kind = HistoryKind::Goal);
        page.events[1].kind = HistoryKind::Plan;
        assert_eq!(first(&page), Some(3));
        assert_eq!(first(&HistoryPage::default()), None);
    }

    #[test]
    fn effects_are_indented_below_their_causes() {
        let mut page = page();
        page.events.reverse();
        check(
            &tree(&page, now()),
            expect![[r#"
            10:00:03  `desk` asked for `temperature of office1 known`␛[2J
            10:00:08    a plan of 2 steps was chosen, cost 8
            10:00:09      `turtlebot-1` was asked to do `(move turtlebot-1 corridor office1)`
        "#]],
        );
    }
}
