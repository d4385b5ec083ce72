//! `althing watch`: prints the messages of a running ecosystem as they are sent, and checks them
//! against the protocols. The messages of a single conversation are printed as a sequence diagram.

pub(crate) mod record;
mod watched_messages;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use acl::{EcosystemId, Message};
use conversation::Transcript;
use live_view::redact;
use serde_json::json;
use terminal::output::Color;
use terminal::render::plural;
use terminal::styled::Styled;
use terminal::{exit, output, visible};

use crate::asking::goal_numbers;
use crate::cli::WatchArgs;
use crate::commands::client::{self, ClientTarget};
use crate::hosting::GuestKeys;
use crate::interruption;

use watched_messages::WatchEvent;

/// Maximum number of messages that wait to be printed or recorded; more are dropped and counted.
const WAITING_MAX: usize = 10_000;

/// Width of the output in columns.
const COLUMNS: usize = 80;

/// Width in columns of a name in a sequence diagram, and of the arrow between two names.
const NAME_COLUMNS: usize = 22;
const ARROW_COLUMNS: usize = 24;
const _: () = assert!(9 + 2 * NAME_COLUMNS + ARROW_COLUMNS + 2 <= COLUMNS);

/// Runs `althing watch`: prints one line per message, until Ctrl-C.
pub(super) fn run(args: &WatchArgs) -> ExitCode {
    let json = args.print.json;
    let target = match ClientTarget::find(&args.reach) {
        Ok(target) => target,
        Err(problem) => return client::unavailable(&problem, json),
    };
    let conversation = match conversation(&target, args.conversation.as_deref()) {
        Ok(conversation) => conversation,
        Err(problem) => return super::wrong(&problem, json),
    };
    if let Some(file) = &args.record {
        return record::run(&target, conversation, file, args.record_max);
    }
    let ClientTarget { name, endpoints, keys, .. } = target;
    let listening = WatchOptions { ecosystem: name, endpoints, keys, role: "cli" };
    super::in_runtime(async move {
        let mut ctrl_c = interruption::CtrlC::listen();
        tokio::select! {
            ended = listen(&listening, conversation, json) => match ended {
                Ok(code) => code,
                Err(problem) => client::unavailable(&problem, json),
            },
            () = ctrl_c.pressed() => exit::with(exit::DONE),
            () = interruption::reader_gone() => exit::with(exit::DONE),
        }
    })
}

/// Returns the conversation of the goal that `said` names by its number or by its conversation. Only
/// a number needs the ecosystem.
fn conversation(target: &ClientTarget, said: Option<&str>) -> Result<Option<String>, String> {
    let Some(said) = said else { return Ok(None) };
    if goal_numbers::number(said).is_none() {
        return Ok(Some(said.to_owned()));
    }
    let asked = said.to_owned();
    let found = client::ask_once(target.clone(), async move |view| {
        goal_numbers::conversation(view, &asked).await
    });
    found.map(|conversation| Some(conversation.as_str().to_owned()))
}

/// The ecosystem to watch, and the identity with which this process joins it.
pub(crate) struct WatchOptions {
    pub(crate) ecosystem: EcosystemId,
    pub(crate) endpoints: Vec<String>,
    pub(crate) keys: Option<GuestKeys>,
    /// A word in the name of this listener that distinguishes the listeners of one process.
    pub(crate) role: &'static str,
}

/// Prints the messages of an ecosystem until the reader of the output is gone.
///
/// # Errors
///
/// Returns an error if the ecosystem cannot be reached. The error text completes the sentence
/// “failed to …”.
pub(crate) async fn listen(
    listening: &WatchOptions,
    conversation: Option<String>,
    json: bool,
) -> Result<ExitCode, String> {
    let WatchOptions { ecosystem, endpoints, keys, role } = listening;
    let config = client::guest_config(ecosystem, endpoints, keys.as_ref(), role)?;
    let is_diagram = conversation.is_some();
    let (hear, mut messages) = watched_messages::queue(WAITING_MAX, conversation.clone());
    let tap = substrate_zenoh::tap(config, move |_, message| hear.push(message.payload));
    let _tap = tap.await.map_err(|error| error.to_string())?;
    announce(ecosystem, conversation.as_deref(), json);
    let (began, transcript) = (Instant::now(), Transcript::new());
    let mut watcher = MessagePrinter { began, transcript, json, is_diagram };
    while let Some(event) = messages.next().await {
        let message = match event {
            WatchEvent::Message(message) => message,
            WatchEvent::Lost(count) => {
                let lost = plural(usize::try_from(count).unwrap_or(usize::MAX), "message");
                output::print_note(&format!("{lost} not shown: the output was too slow"));
                continue;
            }
            WatchEvent::Quiet => {
                let within = super::brief(watched_messages::QUIET_AFTER);
                output::print_note(&format!(
                    "no message of this conversation within {within}; `althing goals` lists the \
                     conversations of goals"
                ));
                continue;
            }
        };
        let printed = watcher.print(&message);
        if printed != exit::with(exit::DONE) || output::is_reader_gone() {
            return Ok(printed);
        }
    }
    Ok(exit::with(exit::DONE))
}

/// Prints which messages are shown from now on: all, or those of one conversation.
fn announce(ecosystem: &EcosystemId, conversation: Option<&str>, json: bool) {
    let line = match conversation {
        Some(conversation) => format!("listening to {conversation}"),
        None => format!("listening to `{ecosystem}`"),
    };
    if json {
        output::print_note(&line);
    } else {
        let _ = output::print(format_args!("{line}\n"), exit::DONE);
    }
}

struct MessagePrinter {
    began: Instant,
    transcript: Transcript,
    json: bool,
    is_diagram: bool,
}

impl MessagePrinter {
    fn print(&mut self, message: &Message) -> ExitCode {
        let at = self.began.elapsed();
        let violation = self.transcript.receive(message).err();
        if self.json {
            let value = json!({
                "at_ms": u64::try_from(at.as_millis()).unwrap_or(u64::MAX),
                "message": redact(message),
                "violation": violation.map(|violation| violation.to_string()),
            });
            return output::print_json(&value, exit::DONE);
        }
        let mut text = if self.is_diagram { step(at, message) } else { line(at, message) };
        if let Some(violation) = violation {
            let violation = format!("! out of turn: {violation}");
            text = text.and("         ").and_styled(&Styled::painted(Color::Red, &violation)).end();
        }
        output::print_styled(&text, exit::DONE)
    }
}

fn receiver(message: &Message) -> String {
    match message.receiver.as_slice() {
        [] => "all".to_owned(),
        [receiver] => receiver.to_string(),
        [first, others @ ..] => format!("{first} +{}", others.len()),
    }
}

/// Formats a message as one line.
fn line(at: Duration, message: &Message) -> Styled {
    let (act, from, to) = (message.performative, &message.sender, receiver(message));
    let head = format!("{:>8.3} {act:<15} {from} → {to}", at.as_secs_f64());
    let room = COLUMNS.saturating_sub(head.chars().count() + 2);
    let what = cut(&summarize(message), room);
    Styled::line(format!("{head}  {what}").trim_end()).end()
}

/// Formats a message as a step of the sequence diagram of a conversation: an arrow from one agent
/// to another, and the content below the arrow.
fn step(at: Duration, message: &Message) -> Styled {
    let from = cut(message.sender.as_str(), NAME_COLUMNS);
    let to = cut(&receiver(message), NAME_COLUMNS);
    let act = format!("─ {} ", message.performative);
    let arrow = format!("{act:─<width$}▶", width = ARROW_COLUMNS - 1);
    let head = format!("{:>8.3} {from:<NAME_COLUMNS$} {arrow} {to}", at.as_secs_f64());
    let mut text = Styled::line(&head).end();
    let what = cut(&summarize(message), COLUMNS - 9);
    if !what.is_empty() {
        text = text.and("         ").and_styled(&Styled::painted(Color::Dim, &what)).end();
    }
    text
}

/// Cuts a text to a width in columns.
fn cut(text: &str, columns: usize) -> String {
    if text.chars().count() <= columns {
        return text.to_owned();
    }
    let mut cut: String = text.chars().take(columns.saturating_sub(1)).collect();
    cut.push('…');
    cut
}

/// Summarizes the content of a message in a few words on one line.
fn summarize(message: &Message) -> String {
    // Escaped before it is cut to the width of a terminal, because escapes are longer than the
    // characters that they replace.
    visible::line(&live_view::summarize(message)).into_owned()
}

#[cfg(test)]
mod tests {
    use acl::Message;
    use serde_json::{Value, json};

    use super::summarize;

    fn message(performative: &str, content: &Value) -> Message {
        let message = json!({
            "version": 2, "id": "m1", "performative": performative, "sender": "alice",
            "incarnation": 1, "conversation_id": "c1", "protocol": "query", "content": content,
        });
        serde_json::from_value(message).expect("a message")
    }

    fn said(performative: &str, content: Value) -> String {
        summarize(&message(performative, &content))
    }

    /// Checks that a person's answer is not shown: it may be a secret, even if another keyboard
    /// passes it on.
    #[test]
    fn the_answer_of_a_person_is_not_shown() {
        let answer = json!({ "of": "answer", "text": "2718" });
        assert_eq!(said("inform", answer), "an answer");
        let request = json!({ "act": "answer-question", "question": 3, "text": "2718" });
        assert_eq!(said("request", request), "an answer to question 3");
        let question = json!({ "text": "Who is at corridor?" });
        assert_eq!(said("query-ref", question), "Who is at corridor?");
    }
}
