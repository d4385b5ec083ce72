//! `althing set`: changes known facts of a running ecosystem.

use std::process::ExitCode;

use keyboard::UserRequest;

use crate::asking::wishes;
use crate::cli::{FactArgs, SetArgs};
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};
use crate::commands::{client, wrong};

/// Runs `althing set`: requests the change of facts.
pub(super) fn run(args: &SetArgs) -> ExitCode {
    let json = args.print.json;
    let said = match said(&args.facts) {
        Ok(said) => said,
        Err(problem) => return wrong(&problem, json),
    };
    client::with_link(&args.reach, json, async |link| {
        let interrupt =
            InterruptAction::Leave("the change may have been made all the same".to_owned());
        let to = Some(link.view.roles().domain_maintainer.clone());
        let manner = ExchangeOptions { to, json, interrupt };
        let code = user_request::send_and_follow(&link, said, manner).await;
        (link, code)
    })
}

/// Returns the user's request to change facts, after checking that the facts can be parsed.
pub(crate) fn said(args: &FactArgs) -> Result<UserRequest, String> {
    wishes::change(&args.facts.join("\n"), args.retract).map(UserRequest::Set)
}
