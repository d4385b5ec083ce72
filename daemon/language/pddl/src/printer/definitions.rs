//! Printing of domains, problems and action models, with each section on a line of its own.

use std::fmt;

use super::actions::{action, derived, durative_action};
use super::conditions::{condition, metric};
use super::layout::{PrintLayout, write_newline};
use super::terms::{PrintedEntryKind, atom, fluent, signature, typed_list, write};
use crate::tree::{
    ActionModel, ActionSchema, Derived, Document, Domain, DurativeAction, FunctionDeclaration,
    InitElement, Name, ObjectDeclaration, PredicateDeclaration, Privacy, Problem, Typed,
};

/// Writer of a domain, a problem or an action model.
struct DefinitionWriter<'f, 'g> {
    f: &'f mut fmt::Formatter<'g>,
}

impl<'f, 'g> DefinitionWriter<'f, 'g> {
    /// Begins a definition and writes `(define (KIND NAME)`.
    fn begin(
        f: &'f mut fmt::Formatter<'g>,
        kind: &str,
        name: &Name,
    ) -> Result<DefinitionWriter<'f, 'g>, fmt::Error> {
        write!(f, "(define ({kind} {name})")?;
        Ok(DefinitionWriter { f })
    }

    /// Writes a section, `(KEYWORD ITEM*)`; a section without items is omitted.
    fn section<'t>(&mut self, keyword: &'static str, items: Vec<PrintLayout<'t>>) -> fmt::Result {
        if items.is_empty() {
            return Ok(());
        }
        write_newline(2, self.f)?;
        PrintLayout::headed(keyword, items).write(2, self.f)
    }

    fn layout(&mut self, layout: &PrintLayout<'_>) -> fmt::Result {
        write_newline(2, self.f)?;
        layout.write_broken(2, self.f)
    }

    fn actions(
        &mut self,
        axioms: &[Derived],
        actions: &[ActionSchema],
        durative_actions: &[DurativeAction],
    ) -> fmt::Result {
        for axiom in axioms {
            self.layout(&derived(axiom))?;
        }
        for schema in actions {
            self.layout(&action(schema))?;
        }
        for schema in durative_actions {
            self.layout(&durative_action(schema))?;
        }
        Ok(())
    }

    fn end(self) -> fmt::Result {
        self.f.write_str(")\n")
    }
}

fn names(list: &[Name]) -> Vec<PrintLayout<'_>> {
    list.iter().map(PrintLayout::name).collect()
}

fn predicates(list: &[PredicateDeclaration]) -> Vec<PrintLayout<'_>> {
    let declared = list.iter().map(|it| (&it.privacy, signature(&it.name, &it.parameters)));
    by_privacy(declared)
}

fn functions(list: &[FunctionDeclaration]) -> Vec<PrintLayout<'_>> {
    let declared = list.iter().map(|it| {
        let signature = signature(&it.name, &it.parameters);
        let words = vec![signature, PrintLayout::word("-"), PrintLayout::word("number")];
        (&it.privacy, PrintLayout::group(words))
    });
    by_privacy(declared)
}

/// Lays out declarations. Consecutive ones that are private to the same owner stand in one block:
/// `(DECLARATION | (:private [VARIABLE - TYPE] DECLARATION*))*`.
fn by_privacy<'t>(
    declared: impl Iterator<Item = (&'t Privacy, PrintLayout<'t>)>,
) -> Vec<PrintLayout<'t>> {
    let mut items = Vec::new();
    let mut private: Option<(&Privacy, Vec<PrintLayout<'_>>)> = None;
    for (privacy, layout) in declared {
        match &mut private {
            Some((same, block)) if *same == privacy => block.push(layout),
            _ => {
                items.extend(private.take().map(|(_, block)| PrintLayout::list(1, block)));
                match privacy {
                    Privacy::Public => items.push(layout),
                    Privacy::Private(owner) => {
                        let mut head = vec![PrintLayout::word(":private")];
                        head.extend(typed_list(owner.as_slice(), PrintedEntryKind::Variables));
                        private = Some((privacy, vec![PrintLayout::group(head), layout]));
                    }
                }
            }
        }
    }
    items.extend(private.map(|(_, block)| PrintLayout::list(1, block)));
    items
}

/// Lays out objects, grouped by type. Consecutive ones that are private to the same owner stand in
/// one block: `(NAME+ - TYPE | (:private [NAME] NAME+ - TYPE))*`.
fn objects(list: &[ObjectDeclaration]) -> Vec<PrintLayout<'_>> {
    let mut items = Vec::new();
    let mut owners = Vec::new();
    for block in list.chunk_by(|left, right| left.privacy == right.privacy) {
        match &block[0].privacy {
            Privacy::Public => items.extend(object_groups(block, false)),
            Privacy::Private(owner) => {
                let mut words = vec![PrintLayout::word(":private")];
                words.extend(owner.iter().map(|owner| PrintLayout::name(&owner.name)));
                owners.extend(owner);
                words.extend(object_groups(block, owner.is_none()));
                items.push(PrintLayout::list(1 + usize::from(owner.is_some()), words));
            }
        }
    }
    // A single owner that is not an object here would be parsed as an object. A second block
    // prevents this.
    if let [owner] = owners[..]
        && list.iter().all(|declaration| declaration.object.name != owner.name)
    {
        items.push(PrintLayout::headed(":private", [PrintLayout::name(&owner.name)]));
    }
    items
}

/// Groups objects by type. If `first_alone` is true, the first object has a group of its own, so
/// that it is not parsed as the owner of the block.
fn object_groups(block: &[ObjectDeclaration], first_alone: bool) -> Vec<PrintLayout<'_>> {
    let mut groups = Vec::new();
    let (first, mut rest) = block.split_at(usize::from(first_alone));
    groups.extend(first.iter().map(|declaration| object_group(std::slice::from_ref(declaration))));
    while !rest.is_empty() {
        let ty = &rest[0].object.ty;
        let count = rest.iter().take_while(|declaration| declaration.object.ty == *ty).count();
        let (group, others) = rest.split_at(count);
        groups.push(object_group(group));
        rest = others;
    }
    groups
}

/// Lays out objects of one type: `NAME+ - TYPE`.
fn object_group(group: &[ObjectDeclaration]) -> PrintLayout<'_> {
    let mut words: Vec<_> = group.iter().map(|it| PrintLayout::name(&it.object.name)).collect();
    words.extend([PrintLayout::word("-"), super::terms::type_expr(&group[0].object.ty)]);
    PrintLayout::group(words)
}

fn types(list: &[Typed]) -> Vec<PrintLayout<'_>> {
    typed_list(list, PrintedEntryKind::Names)
}

fn init_element(element: &InitElement) -> PrintLayout<'_> {
    match element {
        InitElement::Atom(inner) => atom(inner),
        InitElement::Not(inner) => PrintLayout::headed("not", [atom(inner)]),
        InitElement::Unknown(inner) => PrintLayout::headed("unknown", [atom(inner)]),
        InitElement::Assign(inner, number) => {
            PrintLayout::headed("=", [fluent(inner), PrintLayout::written(number)])
        }
        InitElement::At(time, inner) => {
            PrintLayout::headed("at", [PrintLayout::written(time), self::init_element(inner)])
        }
    }
}

fn init(elements: &[InitElement]) -> Vec<PrintLayout<'_>> {
    elements.iter().map(init_element).collect()
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut definition = DefinitionWriter::begin(f, "domain", &self.name)?;
        definition.section(":requirements", names(&self.requirements))?;
        definition.section(":types", types(&self.types))?;
        definition.section(":constants", types(&self.constants))?;
        definition.section(":predicates", predicates(&self.predicates))?;
        definition.section(":functions", functions(&self.functions))?;
        definition.actions(&self.derived, &self.actions, &self.durative_actions)?;
        definition.end()
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut definition = DefinitionWriter::begin(f, "problem", &self.name)?;
        definition.section(":domain", vec![PrintLayout::name(&self.domain)])?;
        definition.section(":requirements", names(&self.requirements))?;
        definition.section(":objects", objects(&self.objects))?;
        definition.section(":init", init(&self.init))?;
        definition.section(":goal", vec![condition(&self.goal)])?;
        if let Some(measure) = &self.metric {
            write_newline(2, definition.f)?;
            metric(measure).write(2, definition.f)?;
        }
        definition.end()
    }
}

impl fmt::Display for ActionModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut definition = DefinitionWriter::begin(f, "agent", &self.agent)?;
        definition.section(":domain", vec![PrintLayout::name(&self.domain)])?;
        definition.section(":requirements", names(&self.requirements))?;
        definition.section(":types", types(&self.types))?;
        definition.section(":predicates", predicates(&self.predicates))?;
        definition.section(":functions", functions(&self.functions))?;
        definition.section(":objects", objects(&self.objects))?;
        definition.section(":init", init(&self.init))?;
        definition.actions(&self.derived, &self.actions, &self.durative_actions)?;
        definition.end()
    }
}

impl fmt::Display for Document {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Document::Domain(domain) => domain.fmt(f),
            Document::Problem(problem) => problem.fmt(f),
            Document::ActionModel(model) => model.fmt(f),
        }
    }
}

impl fmt::Display for InitElement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&init_element(self), f)
    }
}

/// Prints the declaration of the predicate, without the `:private` block of MA-PDDL that it may
/// stand in.
impl fmt::Display for PredicateDeclaration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&signature(&self.name, &self.parameters), f)
    }
}

/// Prints the declaration of the function, without the `:private` block of MA-PDDL that it may
/// stand in.
impl fmt::Display for FunctionDeclaration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&signature(&self.name, &self.parameters), f)
    }
}
