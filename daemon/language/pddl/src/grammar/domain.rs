//! Grammar of domains.

use super::definition::Sections;
use super::reader::GrammarReader;
use super::{action, declarations};
use crate::sexpr::Items;
use crate::tree::{Domain, Name};

const SECTIONS: &[&str] = &[
    ":requirements",
    ":types",
    ":constants",
    ":predicates",
    ":functions",
    ":derived",
    ":action",
    ":durative-action",
];

/// Parses a domain: `(define (domain NAME) [REQUIREMENTS] [TYPES] [CONSTANTS] [PREDICATES]
/// [FUNCTIONS] (DERIVED | ACTION | DURATIVE-ACTION)*)`, with the sections in any order.
pub(super) fn domain<'f>(reader: &mut GrammarReader<'f>, name: Name, items: Items<'f>) -> Domain {
    let mut domain = Domain::named(name);
    let mut sections = Sections::new(items, SECTIONS);
    while let Some(section) = sections.next(reader) {
        let (items, span) = (section.items, section.span);
        match section.keyword {
            ":requirements" => {
                domain.requirements.extend(declarations::requirements(reader, items))
            }
            ":types" => domain.types.extend(declarations::types(reader, items)),
            ":constants" => domain.constants.extend(declarations::constants(reader, items)),
            ":predicates" => domain.predicates.extend(declarations::predicates(reader, items)),
            ":functions" => domain.functions.extend(declarations::functions(reader, items)),
            ":derived" => domain.derived.extend(action::derived(reader, items, span)),
            ":action" => domain.actions.extend(action::action(reader, items, span)),
            _ => domain.durative_actions.extend(action::durative_action(reader, items, span)),
        }
    }
    domain
}
