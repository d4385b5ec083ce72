//! `althing send`: checks one message that the user wrote, sends it from a keyboard agent, and
//! prints the answers.

use std::io::Read as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use acl::content::{CallForProposals, Question, Request};
use acl::{AgentId, ConversationId, Millis, Performative, Protocol};
use agent::Directory;
use conversation::{ExchangePhase, ExchangeRole, PROTOCOLS};
use keyboard::{MessageDraft, UserRequest};
use serde::Deserialize;
use serde_json::{Map, Value};
use terminal::form_error::{self, FormError};
use terminal::report::SourceText;
use terminal::{exit, output};

use crate::cli::SendArgs;
use crate::commands::client::{self, ClientLink};
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};

/// How long to wait for answers if the message names no deadline. An agent's answer and the search
/// for a plan both take less time.
const PATIENCE: Duration = Duration::from_secs(10);

/// Maximum length of the user's message, in bytes; the rest is not read. No real message is longer.
const BYTES_MAX: u64 = 1 << 20;

/// The message as the user wrote it in the file.
#[derive(Deserialize)]
struct WrittenMessage {
    performative: Performative,
    #[serde(default)]
    receiver: Receivers,
    #[serde(default)]
    content: Value,
    protocol: Option<Protocol>,
    conversation_id: Option<ConversationId>,
    reply_within: Option<Millis>,
    /// The other keys in the file: keys that the keyboard sets itself ([`SAID_BY_KEYBOARD`]), and
    /// unknown ones.
    #[serde(flatten)]
    rest: Map<String, Value>,
}

/// The keys of a message that users write themselves.
const WRITTEN: &[&str] =
    &["performative", "receiver", "content", "protocol", "conversation_id", "reply_within"];

/// The keys of a message that the keyboard agent sets itself, whatever the file contains.
const SAID_BY_KEYBOARD: &[&str] = &[
    "version",
    "id",
    "sender",
    "incarnation",
    "language",
    "ontology",
    "reply_with",
    "in_reply_to",
    "via",
];

/// The receivers of a message as the user writes them: one agent name, or a list of agent names.
#[derive(Deserialize)]
#[serde(untagged)]
enum Receivers {
    One(AgentId),
    Many(Vec<AgentId>),
}

impl Default for Receivers {
    fn default() -> Receivers {
        Receivers::Many(Vec::new())
    }
}

/// Runs `althing send`: sends the message.
pub(super) fn run(args: &SendArgs) -> ExitCode {
    let json = args.print.json;
    let draft = match text(&args.file).and_then(|text| draft(&text)) {
        Ok(draft) => draft,
        Err(problem) => return super::wrong(&problem, json),
    };
    client::with_link(&args.reach, json, async |link| {
        let code = send(&link, draft, json).await;
        (link, code)
    })
}

async fn send(link: &ClientLink, draft: MessageDraft, json: bool) -> ExitCode {
    let directory = link.view.directory(draft.to.as_ref()).await;
    if let Err(problem) = is_here(&draft, &directory) {
        return client::unavailable(&problem, json);
    }
    let interrupt =
        InterruptAction::Leave("the message was sent; its answers are not waited for".to_owned());
    let manner = ExchangeOptions { to: draft.to.clone(), json, interrupt };
    let is_to_all = draft.to.is_none();
    let code = user_request::send_and_follow(link, UserRequest::Send(draft), manner).await;
    // The number of answers to a message to all agents is unknown, so the end of the wait is a
    // success.
    if is_to_all && code == exit::with(exit::UNAVAILABLE) { exit::with(exit::DONE) } else { code }
}

/// Checks that the receiver of the message is present. Otherwise the command would wait for a
/// misspelled name until the deadline.
fn is_here(draft: &MessageDraft, directory: &Directory) -> Result<(), String> {
    let Some(to) = draft.to.as_ref().filter(|to| directory.find(to).is_none()) else {
        return Ok(());
    };
    let known = directory.iter().map(|resident| resident.agent.as_str());
    let near = pddl::nearest(to.as_str(), known);
    let near = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
    Err(format!("find `{to}`: it is not here{near}"))
}

fn text(file: &Path) -> Result<String, String> {
    if file != Path::new("-") {
        return SourceText::read(file)
            .map(|source| source.text.clone())
            .map_err(|problem| format!("failed to {problem}"));
    }
    let mut text = String::new();
    let read = std::io::stdin().lock().take(BYTES_MAX).read_to_string(&mut text);
    read.map_err(|error| format!("failed to read standard input: {error}"))?;
    Ok(text)
}

/// Parses and checks the user's message: its performative must be one that opens an exchange of its
/// protocol, and its content must have the form that performative and protocol require.
fn draft(text: &str) -> Result<MessageDraft, String> {
    let written: WrittenMessage = serde_json::from_str(text).map_err(|error| {
        format!("this is not a message: {}; see althing help send", worded(&error))
    })?;
    let WrittenMessage {
        performative,
        receiver,
        content,
        protocol,
        conversation_id,
        reply_within,
        rest,
    } = written;
    if let Some(key) = rest.keys().find(|key| !SAID_BY_KEYBOARD.contains(&key.as_str())) {
        let known = WRITTEN.iter().chain(SAID_BY_KEYBOARD).copied();
        let near = match key.as_str() {
            // Its name in FIPA, and in version 1 of the protocol.
            "reply_by" => Some("reply_within"),
            _ => pddl::nearest(key, known),
        };
        let near = near.map(|near| format!("; did you mean `{near}`?"));
        return Err(format!("a message has no key `{key}`{}", near.unwrap_or_default()));
    }
    let left_out: Vec<_> = rest.keys().map(String::as_str).collect();
    if !left_out.is_empty() {
        output::print_note(&format!(
            "ignored, because the keyboard sets it itself: {}",
            left_out.join(", ")
        ));
    }
    let to = match receiver {
        Receivers::One(one) => Some(one),
        Receivers::Many(many) if many.len() <= 1 => many.into_iter().next(),
        Receivers::Many(_) => return Err("name one receiver, or none for all".to_owned()),
    };
    let usual = shape(performative, &content)?;
    let protocol = protocol.unwrap_or(usual);
    let opens = PROTOCOLS.iter().any(|turn| {
        (turn.protocol, turn.phase, turn.role, turn.performative)
            == (protocol, ExchangePhase::Opening, ExchangeRole::Initiator, performative)
    });
    if !opens {
        return Err(format!("`{performative}` does not open an exchange of {protocol:?}"));
    }
    if performative == Performative::Cancel && conversation_id.is_none() {
        return Err("a `cancel` names the goal's `conversation_id`".to_owned());
    }
    let patience = reply_within.map_or(PATIENCE, |by| by.0);
    Ok(MessageDraft {
        to,
        performative,
        protocol,
        conversation: conversation_id,
        content,
        patience,
    })
}

/// Explains in the terms of the user why the message cannot be parsed.
fn worded(error: &serde_json::Error) -> String {
    let said = error.to_string();
    let near = |word: &str, known: &[&str]| match pddl::nearest(word, known.iter().copied()) {
        Some(near) => format!("; did you mean `{near}`?"),
        None => format!("; known are {}", known.join(", ")),
    };
    match FormError::of(&said) {
        Some(FormError::UnknownKey { key, known }) => {
            format!("there is no key `{key}`{}", near(key, &known))
        }
        Some(FormError::UnknownWord { word, known }) => {
            format!("`{word}` is not known there{}", near(word, &known))
        }
        Some(FormError::MissingKey(key)) => format!("`{key}` is missing"),
        Some(FormError::Kind { got, wanted }) => {
            let (wanted, got) = (form_error::kind(wanted), form_error::got(got));
            format!("there must be {wanted} where {got} is (line {})", error.line())
        }
        Some(FormError::NoForm) => "`receiver` is a name in quotes, or a list of one".to_owned(),
        None if error.is_eof() => "it ends too early".to_owned(),
        None => said,
    }
}

/// Returns the protocol to which a message belongs, after checking that its content can be parsed.
fn shape(performative: Performative, content: &Value) -> Result<Protocol, String> {
    let wrong =
        |error: serde_json::Error| format!("the content of a `{performative}`: {}", worded(&error));
    match performative {
        Performative::Request => Ok(match Request::deserialize(content).map_err(wrong)? {
            Request::Achieve(_) => Protocol::Goal,
            Request::Schedule(scheduled) if scheduled.times.is_at_once() => Protocol::Goal,
            Request::Plan(_) => Protocol::Planning,
            Request::Execute(_) | Request::CancelPlan(_) => Protocol::Execution,
            Request::Act(_) => Protocol::Action,
            Request::ChangeState(_)
            | Request::ChangeMetric(_)
            | Request::ChangeActions(_)
            | Request::Observe(_)
            | Request::Schedule(_)
            | Request::StoreRecords(_)
            | Request::Stop(_)
            | Request::ReleaseStops(_)
            | Request::SetMode(_)
            | Request::ReadHistory(_)
            | Request::AnswerQuestion(_) => Protocol::StateChange,
        }),
        Performative::QueryRef => {
            Question::deserialize(content).map(|_| Protocol::Query).map_err(wrong)
        }
        Performative::Cfp => {
            CallForProposals::deserialize(content).map(|_| Protocol::ContractNet).map_err(wrong)
        }
        Performative::Cancel => Ok(Protocol::Goal),
        _ => Err(format!(
            "a `{performative}` answers a message; a keyboard sends what opens an exchange: \
             request, query-ref, cfp, cancel"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_mistake(text: &str, expected: &str) {
        let problem = draft(text).expect_err("a mistake");
        assert!(problem.contains(expected), "{problem}");
    }

    #[test]
    fn the_protocol_follows_from_the_content() {
        let text = r#"{"performative": "request", "receiver": "plan-requester",
                       "content": {"act": "achieve", "goal": "(on lamp)"}}"#;
        let draft = draft(text).expect("a message");
        assert_eq!(draft.protocol, Protocol::Goal);
        assert_eq!(draft.to, AgentId::new("plan-requester").ok());
    }

    #[test]
    fn a_mistake_is_reported_before_sending() {
        check_mistake("{", "not a message");
        check_mistake("", "it ends too early");
        check_mistake("[]", "there must be a table in { } where a list is");
        check_mistake(r#"{"performative": "request", "receiver": 5}"#, "`receiver` is a name");
        check_mistake(r#"{"performative": "requst"}"#, "did you mean `request`?");
        check_mistake(
            r#"{"performative": "query-ref", "reciever": "a", "content": {"text": "?"}}"#,
            "no key `reciever`; did you mean `receiver`?",
        );
        check_mistake(r#"{"performative": "shout"}"#, "shout");
        check_mistake(r#"{"performative": "confirm"}"#, "request, query-ref");
        check_mistake(r#"{"performative": "request", "content": {"act": "fly"}}"#, "fly");
        check_mistake(r#"{"performative": "query-ref", "content": {}}"#, "text");
        check_mistake(r#"{"performative": "cancel"}"#, "conversation_id");
        check_mistake(
            r#"{"performative": "query-ref", "protocol": "goal", "content": {"text": "?"}}"#,
            "Goal",
        );
        check_mistake(
            r#"{"performative": "query-ref", "receiver": ["a", "b"], "content": {"text": "?"}}"#,
            "one receiver",
        );
    }
}
