//! Grammar of the action models of agents.

use super::definition::Sections;
use super::problem::{domain_name, missing_domain};
use super::reader::GrammarReader;
use super::{action, declarations, facts};
use crate::sexpr::Items;
use crate::tree::{ActionModel, Name};

const SECTIONS: &[&str] = &[
    ":domain",
    ":requirements",
    ":types",
    ":constants",
    ":objects",
    ":predicates",
    ":functions",
    ":init",
    ":derived",
    ":action",
    ":durative-action",
];

/// Parses an action model: `(define (agent NAME) (:domain NAME) [REQUIREMENTS] [TYPES] [OBJECTS]
/// [PREDICATES] [FUNCTIONS] [INIT] (DERIVED | ACTION | DURATIVE-ACTION)*)`, with the sections in
/// any order. A section `:constants` is parsed as objects.
pub(super) fn action_model<'f>(
    reader: &mut GrammarReader<'f>,
    agent: Name,
    items: Items<'f>,
) -> ActionModel {
    let mut domain = None;
    let mut model = ActionModel::of(agent, Name::new(""));
    let mut sections = Sections::new(items, SECTIONS);
    while let Some(section) = sections.next(reader) {
        let (items, span) = (section.items, section.span);
        match section.keyword {
            ":domain" => domain = domain_name(reader, items),
            ":requirements" => model.requirements.extend(declarations::requirements(reader, items)),
            ":types" => model.types.extend(declarations::types(reader, items)),
            ":constants" | ":objects" => {
                model.objects.extend(declarations::objects(reader, items));
            }
            ":predicates" => model.predicates.extend(declarations::predicates(reader, items)),
            ":functions" => model.functions.extend(declarations::functions(reader, items)),
            ":init" => model.init.extend(facts::init_elements(reader, items)),
            ":derived" => model.derived.extend(action::derived(reader, items, span)),
            ":action" => model.actions.extend(action::action(reader, items, span)),
            _ => model.durative_actions.extend(action::durative_action(reader, items, span)),
        }
    }
    model.domain = domain.unwrap_or_else(|| missing_domain(reader, sections.end()));
    model
}
