//! `althing goal`: asks a running ecosystem for a goal, and follows it to its end.

use std::process::ExitCode;

use acl::content::{Keep, Outcome, Report};
use acl::{AgentId, ConversationId};
use keyboard::{Heard, Keyboard, Said, Wish};
use serde_json::{Value, json};
use tokio::signal;

use crate::cli::GoalArgs;
use crate::commands::client::{self, Link};
use crate::{exit, output};

/// Asks for a goal or cancels one.
pub(super) fn run(args: &GoalArgs) -> ExitCode {
    client::with_link(&args.reach, args.print.json, async |link| {
        let code = follow(&link, args).await;
        (link, code)
    })
}

async fn follow(link: &Link, args: &GoalArgs) -> ExitCode {
    let json = args.print.json;
    let said = match said(link, args) {
        Ok(said) => said,
        Err(problem) => {
            output::note(&format!("error: {problem}"));
            return exit::with(exit::BAD_INPUT);
        }
    };
    let (keyboard, mut terminal) = Keyboard::with_terminal();
    let Ok(id) = AgentId::new(&format!("keyboard-{}", std::process::id())) else {
        return client::unavailable("name a keyboard", json);
    };
    let requester = AgentId::new("plan-requester").ok();
    if link.directory(requester.as_ref()).await.iter().next().is_none() {
        return client::unavailable("see any agent of the ecosystem", json);
    }
    link.node.launch(id, keyboard, link.ontology());
    if terminal.say.send(said).await.is_err() {
        return client::unavailable("speak: the keyboard has ended", json);
    }
    loop {
        let heard = tokio::select! {
            heard = terminal.hear.recv() => heard,
            _ = signal::ctrl_c() => {
                output::note("the goal goes on without you; give it up with: althing goal --cancel ID");
                return exit::with(exit::DONE);
            }
        };
        let Some(heard) = heard else {
            return client::unavailable("hear: the keyboard has ended", json);
        };
        let printed = if json {
            output::print_json(&object(&heard), exit::DONE)
        } else {
            let text: String = lines(&heard).iter().map(|line| format!("{line}\n")).collect();
            output::print(text, exit::DONE)
        };
        if printed != exit::with(exit::DONE) {
            return printed;
        }
        if heard.is_final() {
            return exit::with(code_of(&heard, args.cancel.is_some()));
        }
    }
}

fn said(link: &Link, args: &GoalArgs) -> Result<Said, String> {
    if let Some(id) = &args.cancel {
        return Ok(Said::Cancel(ConversationId::new(id)));
    }
    let asked = args.goal.as_deref().unwrap_or_default();
    let goal = match &link.ecosystem {
        Some(ecosystem) => ecosystem.goal_text(asked)?.to_owned(),
        None if asked.trim_start().starts_with('(') => asked.to_owned(),
        None => {
            return Err(format!(
                "`{asked}` may be a goal of the ecosystem file, which is not known here; write \
                 the goal in PDDL, or name the file with --ecosystem FILE"
            ));
        }
    };
    if let Err(diagnostics) = pddl::parse_condition(&goal).into_result() {
        let lines: Vec<_> =
            diagnostics.iter().map(|diagnostic| diagnostic.located(&goal)).collect();
        return Err(lines.join("\n"));
    }
    let keep = if args.maintain { Keep::Maintain } else { Keep::Achieve };
    Ok(Said::Wish(Wish { goal, keep, priority: args.priority }))
}

/// The goal failed, or was refused.
const GOAL_FAILED: u8 = 1;

fn code_of(heard: &Heard, was_cancel: bool) -> u8 {
    match heard {
        Heard::Report(_, Report { outcome: Outcome::Done, .. }) => exit::DONE,
        Heard::Report(_, Report { outcome: Outcome::Cancelled, .. }) if was_cancel => exit::DONE,
        Heard::Unanswered(..) => exit::UNAVAILABLE,
        _ => GOAL_FAILED,
    }
}

/// What was heard, for a person.
pub(super) fn lines(heard: &Heard) -> Vec<String> {
    match heard {
        Heard::Asked(id) => vec![format!("asked    {id}")],
        Heard::Report(_, report) => {
            let mut lines = vec![format!("{:<8} {}", report.outcome, report.detail)];
            let steps = report.plan.iter().flat_map(|plan| plan.lines());
            lines.extend(
                steps.filter(|line| line.starts_with('(')).map(|line| format!("           {line}")),
            );
            lines
        }
        Heard::Refused(_, refusal) => vec![format!("refused  {}", refusal.detail)],
        Heard::Unanswered(_, why) => vec![format!("nobody   {why}")],
    }
}

/// What was heard, for a program.
fn object(heard: &Heard) -> Value {
    match heard {
        Heard::Asked(id) => json!({ "event": "asked", "conversation": id }),
        Heard::Report(id, report) => {
            json!({ "event": "report", "conversation": id, "report": report })
        }
        Heard::Refused(id, refusal) => {
            json!({ "event": "refused", "conversation": id, "refusal": refusal })
        }
        Heard::Unanswered(id, why) => {
            json!({ "event": "unanswered", "conversation": id, "problem": why })
        }
    }
}
