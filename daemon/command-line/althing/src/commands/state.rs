//! `althing state`: shows the known facts, the owner of each, and how long each is valid.

use std::fmt::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use acl::content::{BelievedFact, BelievedState};
use agent::Resource;
use serde_json::json;
use terminal::{exit, output, visible};

use crate::cli::AskArgs;
use crate::commands::client::{self, EcosystemView};

/// Runs `althing state`: prints one line per fact.
pub(super) fn run(args: &AskArgs) -> ExitCode {
    client::with_view(args, print)
}

pub(crate) async fn print(view: &EcosystemView, json: bool) -> ExitCode {
    let maintainer = &view.roles().domain_maintainer;
    view.directory(Some(maintainer)).await;
    let answers = view.ask(Resource::State, Some(maintainer.clone())).await;
    let state =
        answers.first().and_then(|bytes| serde_json::from_slice::<BelievedState>(bytes).ok());
    match state {
        Some(state) if json => output::print_json(&json!(state), exit::DONE),
        Some(state) => output::print(table(&state), exit::DONE),
        None => client::unavailable("reach a Domain Maintainer: none is present", json),
    }
}

fn table(state: &BelievedState) -> String {
    let mut text = format!("; epoch {}, revision {}\n", state.epoch, state.revision);
    let _ = writeln!(text, "{:<46} {:<22} AGE", "FACT", "FROM");
    for BelievedFact { fact, owners, age_ms, known_for, claims } in &state.facts {
        let age = super::brief(Duration::from_millis(*age_ms));
        let left = known_for.map(|left| format!(", for {} more", super::brief(left.0)));
        let left = left.unwrap_or_default();
        let (owners, shown) = (owners.join(", "), visible::line(fact));
        let _ = writeln!(text, "{shown:<46} {:<22} {age}{left}", visible::line(&owners));
        // Contradicting claims of other owners, which are not believed now.
        for other in claims.iter().filter(|claim| claim.fact != *fact) {
            let age = super::brief(Duration::from_millis(other.age_ms));
            let not = if other.fact.starts_with("(unknown ") { "" } else { "not " };
            let (fact, owner) = (visible::line(&other.fact), visible::line(&other.owner));
            let said = format!("{not}{fact}");
            let _ = writeln!(text, "  {said:<44} {owner:<22} {age}");
        }
    }
    text
}
