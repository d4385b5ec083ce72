//! `althing state`: shows the known facts below the owner of each, and how long each is valid.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use acl::content::{BelievedFact, BelievedState};
use agent::Resource;
use jiff::Zoned;
use serde_json::json;
use terminal::render::plural;
use terminal::{exit, output, visible};

use crate::cli::AskArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::moments::{CLOCK_COLUMNS, age_of, before, clock};
use crate::speech;

/// Columns of a fact, of the time at which it was last heard, and of its age.
const FACT_COLUMNS: usize = 44;
const TIME_COLUMNS: usize = CLOCK_COLUMNS;
const AGE_COLUMNS: usize = 7;

/// The owner of the facts that no agent brings.
const MAP: &str = "the map";

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
        Some(state) => {
            let text = described(&state, view.name.as_str(), &Zoned::now());
            output::print(text, exit::DONE)
        }
        None => {
            let problem = "reach a Domain Maintainer, which keeps the facts: none is present; \
                           `althing agents` shows who is, `althing doctor` what is wrong";
            client::unavailable(problem, json)
        }
    }
}

/// Describes the state: the facts of each owner, and at the end those of the map.
fn described(state: &BelievedState, ecosystem: &str, now: &Zoned) -> String {
    let mut by_owner: BTreeMap<(bool, String), Vec<&BelievedFact>> = BTreeMap::new();
    for fact in &state.facts {
        let owners = fact.owners.join(", ");
        by_owner.entry((owners == MAP, owners)).or_default().push(fact);
    }
    let facts = plural(state.facts.len(), "fact");
    let mut text = format!(
        "{facts} known in `{ecosystem}` at {}; revision {} of epoch {}\n\n",
        now.strftime("%H:%M:%S"),
        state.revision,
        state.epoch
    );
    let _ = writeln!(
        text,
        "{:<width$}  {:<TIME_COLUMNS$}  {:<AGE_COLUMNS$}  STAYS",
        "FACTS, BY WHO TELLS THEM",
        "HEARD",
        "AGO",
        width = FACT_COLUMNS + 2,
    );
    for ((_, owner), facts) in by_owner {
        let _ = writeln!(text, "{}", visible::line(&owner));
        facts.iter().for_each(|fact| add_fact(&mut text, fact, now));
    }
    text
}

/// Adds the line of a fact, and a line for each claim of another owner that contradicts it and is
/// not believed now.
fn add_fact(text: &mut String, believed: &BelievedFact, now: &Zoned) {
    let BelievedFact { fact, age_ms, known_for, claims, .. } = believed;
    let left = known_for.map(|left| super::brief(left.0)).unwrap_or_default();
    let line = line(&visible::line(&speech::say(fact)), *age_ms, &left, now);
    let _ = writeln!(text, "  {line}");
    for other in claims.iter().filter(|claim| claim.fact != *fact) {
        let said = speech::say(&other.fact);
        let line = self::line(&visible::line(&said), other.age_ms, "", now);
        let owner = visible::line(&other.owner);
        let _ = writeln!(text, "    `{owner}` tells another, which is not believed:\n    {line}");
    }
}

/// Returns a fact with the time at which it was heard; a fact that is too long for its column stands
/// on a line of its own.
fn line(fact: &str, age_ms: u64, left: &str, now: &Zoned) -> String {
    let at = clock(before(age_ms, now), now);
    let ago = age_of(Duration::from_millis(age_ms));
    let rest = format!("{at:<TIME_COLUMNS$}  {ago:<AGE_COLUMNS$}  {left}");
    let rest = rest.trim_end();
    format!("{fact:<FACT_COLUMNS$}  {rest}")
}

#[cfg(test)]
mod tests {
    use acl::Millis;
    use acl::content::Claim;
    use expect_test::expect;
    use jiff::Timestamp;
    use jiff::tz::TimeZone;

    use super::*;

    fn fact(fact: &str, owner: &str, age_ms: u64) -> BelievedFact {
        BelievedFact {
            fact: fact.to_owned(),
            owners: vec![owner.to_owned()],
            age_ms,
            known_for: None,
            claims: Vec::new(),
        }
    }

    #[test]
    fn facts_stand_below_their_owners() {
        let now = Timestamp::from_second(1_795_860_000).expect("a time").to_zoned(TimeZone::UTC);
        let contradicted = BelievedFact {
            claims: vec![Claim {
                owner: "robot-2".to_owned(),
                fact: "(at robot-1 hall)".to_owned(),
                source: "observation".to_owned(),
                age_ms: 200_000,
                known_for: None,
            }],
            known_for: Some(Millis(Duration::from_secs(600))),
            ..fact("(at robot-1 lab)", "robot-1", 300)
        };
        let facts = vec![
            fact("(connected hall lab)", MAP, 9_000_000),
            contradicted,
            fact("(lit lab)", "lamp", 61_000),
        ];
        let text = described(&BelievedState { epoch: 3, revision: 8, facts }, "lab", &now);
        expect![[r#"
            3 facts known in `lab` at 10:00:00; revision 8 of epoch 3

            FACTS, BY WHO TELLS THEM                        HEARD       AGO      STAYS
            lamp
              light in lab on                               09:58:59    61 s
            robot-1
              robot-1 at lab                                09:59:59    now      10 min
                `robot-2` tells another, which is not believed:
                robot-1 at hall                               09:56:40    3 min
            the map
              hall connected to lab                         07:30:00    2 h
        "#]]
        .assert_eq(&text);
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    }
}
