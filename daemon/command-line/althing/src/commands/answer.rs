//! `althing answer`: lists the questions that agents ask people, or sends a person's answer to one
//! of them.

use std::fmt::Write as _;
use std::io::{self, BufRead as _, IsTerminal as _, Read as _};
use std::process::ExitCode;

use acl::content::OpenQuestion;
use serde_json::json;
use terminal::{exit, output, visible};

use crate::asking::questions::{meant, questions, reply};
use crate::cli::AnswerArgs;
use crate::commands::client::{self, ClientLink, EcosystemView};
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};

/// Maximum length of an answer from standard input, in bytes; a longer one is an error.
const ANSWER_BYTES_MAX: u64 = 4 << 10;

/// Runs `althing answer`: lists the open questions, or answers one.
pub(super) fn run(args: &AnswerArgs) -> ExitCode {
    client::with_link(&args.reach, args.print.json, async |link| {
        let code = match &args.reply.id {
            None => list(&link.view, args.print.json).await,
            Some(id) => answer(&link, id, args).await,
        };
        (link, code)
    })
}

/// Prints the open questions of all keyboards.
pub(crate) async fn list(view: &EcosystemView, json: bool) -> ExitCode {
    let open = questions(view).await;
    if json {
        return output::print_json(&json!({ "questions": open }), exit::DONE);
    }
    if open.is_empty() {
        return output::print("no questions are open\n", exit::DONE);
    }
    let mut text = format!("{:<28} {:<20} {:>8}  QUESTION\n", "ID", "FROM", "LEFT");
    for OpenQuestion { keyboard, question, from, text: asked, remaining: left, .. } in &open {
        let id = format!("{keyboard}/{question}");
        let (left, asked) = (super::brief(left.0), visible::line(asked));
        let _ = writeln!(text, "{id:<28} {:<20} {left:>8}  {asked}", from.as_str());
    }
    output::print(text, exit::DONE)
}

async fn answer(link: &ClientLink, id: &str, args: &AnswerArgs) -> ExitCode {
    let json = args.print.json;
    let said = match meant(&link.view, id).await {
        Ok(question) => text(&question, &args.reply.text).map(|text| reply(question, text)),
        Err(problem) => return super::wrong(&problem, json),
    };
    let said = match said {
        Ok(said) => said,
        Err(problem) => return super::wrong(&problem, json),
    };
    let interrupt =
        InterruptAction::Leave("the answer may have been given all the same".to_owned());
    user_request::send_and_follow(link, said, ExchangeOptions { to: None, json, interrupt }).await
}

/// Returns the user's answer to a question: from the command line, typed at the terminal (hidden if
/// the answer is to be sealed), or from standard input.
fn text(question: &OpenQuestion, words: &[String]) -> Result<String, String> {
    if !words.is_empty() {
        if question.seal_to.is_some() {
            output::print_note(
                "a command line can be read by every user of this machine, and the shell keeps it; \
                 for a secret, leave the answer out, and type it when asked",
            );
        }
        return Ok(words.join(" "));
    }
    let failed = |error: io::Error| format!("the answer could not be read: {error}");
    if !io::stdin().is_terminal() {
        let mut line = Vec::new();
        let read = io::stdin().lock().take(ANSWER_BYTES_MAX + 1).read_until(b'\n', &mut line);
        let bytes = read.map_err(failed)?;
        if bytes == 0 {
            return Err("standard input ended before there was an answer".to_owned());
        }
        if bytes as u64 > ANSWER_BYTES_MAX {
            return Err(format!("an answer may have {ANSWER_BYTES_MAX} bytes, and this is longer"));
        }
        let line = String::from_utf8(line).map_err(|_| "the answer is not UTF-8".to_owned())?;
        return Ok(line.trim_end_matches(['\r', '\n']).to_owned());
    }
    output::print_note(&visible::line(&question.text));
    match &question.seal_to {
        Some(_) => rpassword::prompt_password("answer (not shown): ").map_err(failed),
        None => {
            output::print_note("answer:");
            let mut line = String::new();
            io::stdin().read_line(&mut line).map_err(failed)?;
            Ok(line.trim_end_matches(['\r', '\n']).to_owned())
        }
    }
}
