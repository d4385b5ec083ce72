//! `althing mode`: changes the planning flow of a running ecosystem.

use std::process::ExitCode;

use keyboard::Said;

use crate::cli::ModeArgs;
use crate::commands::client;
use crate::commands::speaking::{self, Interrupt, Manner};

/// Requests the flow.
pub(super) fn run(args: &ModeArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let interrupt = Interrupt::Leave("the mode may have been changed all the same".to_owned());
        let manner = Manner { to: Some("plan-requester"), json, interrupt };
        let code = speaking::say(&link, Said::Mode(args.mode.into()), manner).await;
        (link, code)
    })
}
