//! `althing act`: requests one action from a running ecosystem, and follows the action to its end.

use std::process::ExitCode;

use keyboard::UserRequest;

use crate::asking::wishes;
use crate::cli::{ActArgs, ActionArgs};
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};
use crate::commands::{client, wrong};

/// Runs `althing act`: requests the action.
pub(super) fn run(args: &ActArgs) -> ExitCode {
    let json = args.print.json;
    let said = match said(&args.action) {
        Ok(said) => said,
        Err(problem) => return wrong(&problem, json),
    };
    client::with_link(&args.reach, json, async |link| {
        let to = Some(link.view.roles().plan_executor.clone());
        let manner = ExchangeOptions { to, json, interrupt: InterruptAction::GiveUp };
        let code = user_request::send_and_follow(&link, said, manner).await;
        (link, code)
    })
}

/// Returns the user's request for an action, after checking that the action can be parsed.
pub(crate) fn said(args: &ActionArgs) -> Result<UserRequest, String> {
    wishes::action(&args.action)
}
