//! `althing mode`: changes the planning mode (centralised or decentralised) of a running ecosystem.

use std::process::ExitCode;

use keyboard::UserRequest;

use crate::cli::ModeArgs;
use crate::commands::client;
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};

/// Runs `althing mode`: requests the planning mode.
pub(super) fn run(args: &ModeArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let interrupt =
            InterruptAction::Leave("the mode may have been changed all the same".to_owned());
        let to = Some(link.view.roles().plan_requester.clone());
        let manner = ExchangeOptions { to, json, interrupt };
        let code =
            user_request::send_and_follow(&link, UserRequest::Mode(args.mode.into()), manner).await;
        (link, code)
    })
}
