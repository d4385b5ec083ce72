//! Events of the history as comma-separated values (RFC 4180), for spreadsheets.

use std::borrow::Cow;
use std::fmt::Write as _;

use acl::content::HistoryEvent;
use jiff::Timestamp;
use terminal::visible;

/// Names of the columns.
const HEAD: &str = "time,number,kind,subject,agent,value,text,conversation,cause,root,private\n";

/// Returns a table of the events, with a line of names above.
pub(super) fn csv(events: &[&HistoryEvent]) -> String {
    let mut text = HEAD.to_owned();
    for event in events {
        let at =
            i64::try_from(event.at_ms).ok().and_then(|ms| Timestamp::from_millisecond(ms).ok());
        let at = at.map(|at| format!("{at:.3}")).unwrap_or_default();
        let value = event.value.map(|value| value.to_string()).unwrap_or_default();
        let agent = event.agent.as_ref().map(|agent| agent.as_str()).unwrap_or_default();
        let conversation = event.conversation.as_ref().map(|id| id.as_str()).unwrap_or_default();
        let cause = event.cause.map(|cause| cause.to_string()).unwrap_or_default();
        let root = event.root.map(|root| root.to_string()).unwrap_or_default();
        let _ = writeln!(
            text,
            "{at},{},{},{},{},{value},{},{},{cause},{root},{}",
            event.number,
            event.kind,
            field(&event.subject),
            field(agent),
            field(&event.text),
            field(conversation),
            event.private,
        );
    }
    text
}

/// Returns a text as a field of the table. A field that a spreadsheet would take for a formula gets
/// an apostrophe before it.
fn field(text: &str) -> Cow<'_, str> {
    let shown = visible::line(text);
    let is_formula = shown.starts_with(['=', '+', '-', '@']);
    if !is_formula && !shown.contains([',', '"']) {
        return shown;
    }
    let apostrophe = if is_formula { "'" } else { "" };
    format!("\"{apostrophe}{}\"", shown.replace('"', "\"\"")).into()
}

#[cfg(test)]
mod tests {
    use acl::AgentId;
    use acl::content::{HistoryKind, HistoryRoot};

    use super::*;

    #[test]
    fn fields_are_quoted_and_are_no_formulas() {
        let event = HistoryEvent {
            number: 7,
            at_ms: 1_795_860_000_123,
            kind: HistoryKind::Fact,
            subject: "(temperature office1)".to_owned(),
            agent: AgentId::new("thermometer-1").ok(),
            text: "=cmd(), \"quoted\"\n\x1b[2J".to_owned(),
            conversation: None,
            cause: Some(3),
            root: Some(HistoryRoot::Sensor),
            value: Some(21.5),
            private: false,
        };
        let expected = format!(
            "{HEAD}2026-11-28T10:00:00.123Z,7,fact,(temperature office1),thermometer-1,21.5,\
             \"'=cmd(), \"\"quoted\"\"␊␛[2J\",,3,sensor,false\n"
        );
        assert_eq!(csv(&[&event]), expected);
    }
}
