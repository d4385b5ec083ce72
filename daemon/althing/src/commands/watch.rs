//! `althing watch`: the messages of a running ecosystem as they are sent, held against the
//! protocols.

use std::process::ExitCode;
use std::time::Instant;

use acl::content::{Inform, Refusal, Report};
use acl::{Message, Performative};
use conversation::Transcript;
use serde_json::json;
use tokio::signal;
use tokio::sync::mpsc;

use crate::cli::WatchArgs;
use crate::commands::client::{self, Target};
use crate::{exit, output};

/// Messages that may wait to be printed; a slow terminal misses the rest, and is told so.
const WAITING_MAX: usize = 10_000;

/// Prints a line per message, until Ctrl-C.
pub(super) fn run(args: &WatchArgs) -> ExitCode {
    let json = args.print.json;
    let target = match Target::find(&args.reach) {
        Ok(target) => target,
        Err(problem) => return client::unavailable(&problem, json),
    };
    super::in_runtime(watch(target, args))
}

async fn watch(target: Target, args: &WatchArgs) -> ExitCode {
    let json = args.print.json;
    let config = match target.config() {
        Ok(config) => config,
        Err(problem) => return client::unavailable(&problem, json),
    };
    let (hear, mut heard) = mpsc::channel(WAITING_MAX);
    let tap = substrate_zenoh::tap(config, move |_, payload| {
        // A full queue loses a line of a log, and nothing else.
        let _ = hear.try_send(payload);
    });
    let _tap = match tap.await {
        Ok(tap) => tap,
        Err(error) => return client::unavailable(&error.to_string(), json),
    };
    output::note(&format!("listening to `{}`; Ctrl-C ends it", target.name));
    let mut watcher = Watcher { began: Instant::now(), transcript: Transcript::new(), json };
    loop {
        let payload = tokio::select! {
            payload = heard.recv() => payload,
            _ = signal::ctrl_c() => None,
        };
        let Some(payload) = payload else { return exit::with(exit::DONE) };
        let Ok(message) = acl::decode(&payload) else { continue };
        let is_asked_for = args
            .conversation
            .as_ref()
            .is_none_or(|conversation| conversation == message.conversation_id.as_str());
        if !is_asked_for {
            continue;
        }
        let printed = watcher.print(&message);
        if printed != exit::with(exit::DONE) {
            return printed;
        }
    }
}

struct Watcher {
    began: Instant,
    transcript: Transcript,
    json: bool,
}

impl Watcher {
    fn print(&mut self, message: &Message) -> ExitCode {
        let at = self.began.elapsed();
        let violation = self.transcript.hear(message).err();
        if self.json {
            let value = json!({
                "at_ms": u64::try_from(at.as_millis()).unwrap_or(u64::MAX),
                "message": message,
                "violation": violation.map(|violation| violation.to_string()),
            });
            return output::print_json(&value, exit::DONE);
        }
        let to = message.receiver.first().map_or("all", |receiver| receiver.as_str());
        let from = &message.sender;
        let what = gist(message);
        let mut text = format!(
            "{:>8.3} {:<15} {from} → {to}  {what}\n",
            at.as_secs_f64(),
            message.performative,
        );
        if let Some(violation) = violation {
            text.push_str(&format!("         ! out of turn: {violation}\n"));
        }
        output::print(text, exit::DONE)
    }
}

/// What a message says, in a few words.
fn gist(message: &Message) -> String {
    match message.performative {
        Performative::Confirm => message
            .content_as::<Report>()
            .map(|report| format!("{}: {}", report.outcome, report.detail))
            .unwrap_or_default(),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as::<Refusal>().map(|refusal| refusal.detail).unwrap_or_default()
        }
        Performative::Inform => match message.content_as::<Inform>() {
            Ok(Inform::Model(_)) => "its action model".to_owned(),
            Ok(Inform::Heartbeat(beat)) => format!("heartbeat {}", beat.sequence),
            Ok(Inform::Epoch(change)) => {
                format!("epoch {}, revision {}", change.epoch, change.revision)
            }
            Ok(Inform::Answer(answer)) => answer.text,
            Err(_) => String::new(),
        },
        _ => {
            let content = &message.content;
            let first = |keys: &[&str]| {
                keys.iter().find_map(|key| content.get(*key)).map(ToString::to_string)
            };
            first(&["goal", "action", "conjuncts", "proposals", "detail", "status", "act", "text"])
                .map(|text| text.chars().take(100).collect())
                .unwrap_or_default()
        }
    }
}
