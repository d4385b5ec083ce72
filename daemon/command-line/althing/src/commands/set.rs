//! `althing set`: changes known facts of a running ecosystem.

use std::process::ExitCode;

use acl::content::ChangeState;
use keyboard::UserRequest;

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
    let facts = args.facts.join("\n");
    let read = pddl::parse_init_elements(&facts).into_result();
    read.map_err(|found| super::located(&found, &facts))?;
    let change = if args.retract {
        ChangeState { retract: facts, ..ChangeState::default() }
    } else {
        ChangeState { believe: facts, ..ChangeState::default() }
    };
    Ok(UserRequest::Set(change))
}
