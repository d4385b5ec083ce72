//! `althing domain`: prints the composite domain of a running ecosystem, as PDDL.

use std::process::ExitCode;

use acl::content::Snapshot;
use agent::Resource;
use serde_json::json;
use terminal::{exit, output};

use crate::cli::AskArgs;
use crate::commands::client::{self, EcosystemView};

/// Runs `althing domain`: prints the composite domain.
pub(super) fn run(args: &AskArgs) -> ExitCode {
    client::with_view(args, print)
}

pub(crate) async fn print(view: &EcosystemView, json: bool) -> ExitCode {
    let maintainer = &view.roles().domain_maintainer;
    view.directory(Some(maintainer)).await;
    let answers = view.ask(Resource::Domain, Some(maintainer.clone())).await;
    let snapshot = answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
    match snapshot {
        Some(snapshot) if json => output::print_json(&json!(snapshot), exit::DONE),
        Some(Snapshot { epoch, domain, .. }) => {
            output::print(format_args!("; epoch {epoch}\n{domain}\n"), exit::DONE)
        }
        None => client::unavailable("reach a Domain Maintainer: none is present", json),
    }
}
