//! `althing keyboard`: opens an interactive prompt to a running ecosystem.

use std::process::ExitCode;

use acl::AgentId;
use keyboard::Keyboard;
use terminal::{exit, output};

use crate::cli::KeyboardArgs;
use crate::commands::client::{self, ClientLink};
use crate::interruption;
use crate::prompt::{self, PromptSession};

/// Runs `althing keyboard`: opens the prompt.
pub(super) fn run(args: &KeyboardArgs) -> ExitCode {
    let json = args.print.json;
    let is_chosen = args.name.is_some();
    let name = args.name.clone().unwrap_or_else(|| client::guest_name("keyboard"));
    let id = match AgentId::new(&name) {
        Ok(id) => id,
        Err(error) => return super::wrong(&error.to_string(), json),
    };
    client::with_link(&args.reach, json, async |link| {
        let code = open(&link, id, is_chosen, json).await;
        (link, code)
    })
}

async fn open(link: &ClientLink, id: AgentId, is_chosen: bool, json: bool) -> ExitCode {
    // A generated name is unique, so it is not checked.
    if is_chosen && let Some(daemon) = link.view.holder(&id).await {
        let problem = format!(
            "use the name `{id}`: an agent at daemon `{daemon}` has it; choose another with --name"
        );
        return client::unavailable(&problem, json);
    }
    link.view.directory(None).await;
    let (keyboard, terminal) = Keyboard::with_terminal();
    link.node.launch(id.clone(), keyboard, link.view.ontology());
    let guest = PromptSession { view: link.view.clone(), id, terminal, json };
    if prompt::run(guest, interruption::interrupted()).await {
        return exit::with(exit::DONE);
    }
    output::print_note("some requests failed");
    exit::with(super::user_request::FAILED)
}
