//! The facts: what is known, from whom, and for how long.

use live_view::{FactRow, FactTruth, Freshness};

use super::{PageContext, duration_cell};
use crate::page::{PageAt, PageName};
use crate::sheet::{RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::time_words;
use crate::tone::Tone;

pub(super) fn sheet(facts: &[FactRow], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if facts.is_empty() {
        sheet.nothing("No fact is known yet. `althing state` asks the Domain Maintainer.");
    }
    let shown = context.bounded(facts, |fact| {
        format!("{} {} {}", fact.fact, context.said(&fact.fact), fact.owners.join(" "))
    });
    table(&shown, context).draw(&mut sheet);
    context.say_left_out(&mut sheet, facts.len());
    sheet
}

/// Makes the table of facts.
pub(super) fn table(facts: &[&FactRow], context: &PageContext) -> Table {
    let mut table = Table::new(vec![
        TableColumn::new("FACT", 0, 32, 70),
        TableColumn::new("IS", 1, 10, 10),
        TableColumn::right("SAME FOR", 3, 8, 10),
        TableColumn::right("KNOWN FOR", 4, 9, 10),
        TableColumn::new("FROM", 2, 11, 24),
        TableColumn::new("CONTRADICTED BY", 5, 15, 60),
    ]);
    for fact in facts {
        let (text, tone) = truth(fact);
        let owner = fact.owners.first().filter(|owner| owner.parse::<acl::AgentId>().is_ok());
        let link = RowLink {
            key: fact.fact.clone(),
            opens: owner.map(|owner| PageAt::named(PageName::Agent, owner.as_str())),
            copies: fact.fact.clone(),
            about: RowSubject::Statement(fact.fact.clone()),
            pddl: fact.fact.clone(),
        };
        let is_dim = fact.freshness == Freshness::Stale;
        let claims = fact.contradictions.iter().map(|claim| {
            let age = time_words::duration(claim.age_ms);
            let said = context.said(&claim.fact);
            format!("{} ({} {age} ago): {said}", claim.owner, claim.source)
        });
        let cells = vec![
            TableCell::of(&context.said(&fact.fact), if is_dim { Tone::Dim } else { Tone::Name }),
            TableCell::Line(StyledLine::of(text, tone)),
            duration_cell(fact.same_for_ms, Tone::Dim),
            duration_cell(fact.known_for_ms, Tone::Dim),
            TableCell::of(&fact.owners.join(", "), Tone::Plain),
            TableCell::of(&claims.collect::<Vec<_>>().join("; "), Tone::Warn),
        ];
        table.row(cells, link);
    }
    table
}

/// Returns the sign and word of whether a fact is true, and how fresh that is.
fn truth(fact: &FactRow) -> (&'static str, Tone) {
    match (fact.truth, fact.freshness) {
        _ if !fact.contradictions.is_empty() => ("! disputed", Tone::Warn),
        (_, Freshness::Stale) => ("~ stale", Tone::Dim),
        (FactTruth::Unknown, _) => ("? unknown", Tone::Warn),
        (FactTruth::False, _) => ("– false", Tone::Plain),
        (FactTruth::True, Freshness::Ending) => ("! ending", Tone::Warn),
        (FactTruth::True, _) if fact.value.is_some() => ("= known", Tone::Good),
        (FactTruth::True, _) => ("✓ true", Tone::Good),
    }
}
