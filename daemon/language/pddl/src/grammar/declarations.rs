//! Grammar of declarations: requirements, types, predicates, functions, objects.

use super::names::{self, ListEntryKind};
use super::reader::{GrammarReader, excerpt};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{
    FunctionDeclaration, Name, ObjectDeclaration, PredicateDeclaration, Privacy, TypeExpr, Typed,
};

const REQUIREMENTS: &str = "(:requirements :NAME*)";
const PREDICATES: &str = "(:predicates (NAME [VARIABLE* [- TYPE]]*)*)";
const FUNCTIONS: &str = "(:functions ((NAME [VARIABLE* [- TYPE]]*)* [- number])*)";
const PRIVATE: &str = "(:private [VARIABLE - TYPE] DECLARATION*)";

/// Parses the requirement flags of a domain: `:NAME*`.
pub(super) fn requirements<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>) -> Vec<Name> {
    items.filter_map(|node| requirement(reader, node)).collect()
}

/// Parses one requirement flag: `:NAME`.
fn requirement<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Name> {
    match node.symbol() {
        Some(word) if word.starts_with(':') && word.len() > 1 => {
            Some(reader.intern(word, node.span()))
        }
        _ => {
            let word = excerpt(node);
            let message = format!("expected a requirement, found `{word}`");
            let diagnostic = Diagnostic::error(node.span(), message).with_rule(REQUIREMENTS);
            reader.report(match node.symbol() {
                Some(_) => diagnostic.with_help(format!("write `:{word}`")),
                None => diagnostic,
            });
            None
        }
    }
}

/// Parses types, each with its supertype: `(NAME* [- TYPE])*`.
pub(super) fn types<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>) -> Vec<Typed> {
    names::typed_list(reader, items, ListEntryKind::Names)
}

/// Parses constants: `(NAME* [- TYPE])*`. A block `(:private …)` is refused: constants have no privacy.
pub(super) fn constants<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>) -> Vec<Typed> {
    let declared = objects(reader, items);
    if let Some(private) = declared.iter().find(|object| object.privacy != Privacy::Public) {
        let message = "private constants; private things are `(:private …)` objects of the problem";
        reader.report(Diagnostic::unsupported(private.object.name.span(), message));
    }
    declared.into_iter().map(|declaration| declaration.object).collect()
}

/// Parses declarations of predicates: `(SIGNATURE | (:private [VARIABLE - TYPE] SIGNATURE*))*`.
pub(super) fn predicates<'f>(
    reader: &mut GrammarReader<'f>,
    items: Items<'f>,
) -> Vec<PredicateDeclaration> {
    let mut declared = Vec::new();
    for node in items {
        let (signatures, privacy) = public_or_private(reader, node, PREDICATES);
        for node in signatures.into_iter().flatten() {
            if let Some((name, parameters)) = signature(reader, node, PREDICATES) {
                declared.push(PredicateDeclaration { name, parameters, privacy: privacy.clone() });
            }
        }
    }
    declared
}

/// Parses declarations of functions:
/// `((SIGNATURE | (:private [VARIABLE - TYPE] SIGNATURE*))* [- number])*`.
pub(super) fn functions<'f>(
    reader: &mut GrammarReader<'f>,
    items: Items<'f>,
) -> Vec<FunctionDeclaration> {
    let mut declared = Vec::new();
    let mut items = items;
    while let Some(node) = items.next() {
        if node.symbol() == Some("-") {
            number_type(reader, &mut items, node);
            continue;
        }
        let (signatures, privacy) = public_or_private(reader, node, FUNCTIONS);
        let Some(mut signatures) = signatures else { continue };
        while let Some(node) = signatures.next() {
            if node.symbol() == Some("-") {
                number_type(reader, &mut signatures, node);
            } else if let Some((name, parameters)) = signature(reader, node, FUNCTIONS) {
                declared.push(FunctionDeclaration { name, parameters, privacy: privacy.clone() });
            }
        }
    }
    declared
}

/// Parses the type of functions: `- number`.
fn number_type<'f>(reader: &mut GrammarReader<'f>, items: &mut Items<'f>, dash: SyntaxNode<'f>) {
    let Some(ty) = names::opt_type(reader, items, dash) else { return };
    if ty.alternatives.iter().any(|name| *name != "number") {
        let span = ty.alternatives[0].span();
        let message = format!(
            "functions with objects as values (here `{}`) are not supported",
            ty.alternatives[0]
        );
        reader.report(Diagnostic::unsupported(span, message).with_rule(FUNCTIONS));
    }
}

/// Returns the declarations at `node` and their privacy. For a block `(:private …)`, the
/// declarations are the content of the block; otherwise they are the node itself.
fn public_or_private<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    rule: &'static str,
) -> (Option<Items<'f>>, Privacy) {
    let is_private = node.head().is_some_and(|head| head.eq_ignore_ascii_case(":private"));
    if !is_private {
        let wellformed = reader.expect_list(node, "a declaration", rule).is_some();
        return (wellformed.then(|| node.alone()), Privacy::Public);
    }
    let mut items = node.list().unwrap_or(node.alone());
    items.next();
    let owner = opt_owner(reader, &mut items);
    (Some(items), Privacy::Private(owner))
}

/// Parses the owner of a `:private` block: `[VARIABLE [- TYPE]]`.
fn opt_owner<'f>(reader: &mut GrammarReader<'f>, items: &mut Items<'f>) -> Option<Typed> {
    items.peek()?.symbol()?;
    let typed = opt_typed_variable(reader, items);
    if let Some(extra) = items.peek().filter(|node| node.symbol().is_some_and(|w| w != "-")) {
        let message = format!("a `:private` has one owner, `{}` is another", excerpt(extra));
        reader.report(Diagnostic::error(extra.span(), message).with_rule(PRIVATE));
        items.next();
    }
    typed
}

/// Parses a variable with its type: `VARIABLE [- TYPE]`.
pub(super) fn opt_typed_variable<'f>(
    reader: &mut GrammarReader<'f>,
    items: &mut Items<'f>,
) -> Option<Typed> {
    let name = names::variable(reader, items.next()?)?;
    let mut ty = TypeExpr::default();
    if let Some(dash) = items.peek().filter(|node| node.symbol() == Some("-")) {
        items.next();
        ty = names::opt_type(reader, items, dash).unwrap_or_default();
    }
    Some(Typed { name, ty })
}

/// Parses the signature of a predicate or function: `(NAME VARIABLES)`. Returns the name and the
/// variables.
pub(super) fn signature<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    rule: &'static str,
) -> Option<(Name, Vec<Typed>)> {
    let mut items = reader.expect_list(node, "a declaration", rule)?;
    let head = reader.expect(&mut items, "name", rule)?;
    let name = names::name(reader, head, "a name")?;
    if names::is_reserved(name.as_str()) && name != "=" {
        let message = format!("`{name}` is a word of PDDL and cannot be declared");
        reader.report(Diagnostic::error(head.span(), message));
    }
    Some((name, names::variables(reader, items)))
}

/// Parses the objects of a problem or an action model: `((NAME* [- TYPE])* | (:private [NAME]
/// (NAME* [- TYPE])*))*`.
pub(super) fn objects<'f>(
    reader: &mut GrammarReader<'f>,
    items: Items<'f>,
) -> Vec<ObjectDeclaration> {
    let mut declared = Vec::new();
    // Several private blocks occur only in a text that describes several agents.
    let has_owners = items.filter(|node| is_private(*node)).nth(1).is_some();
    let mut from = items;
    let mut public = items.until(is_private);
    loop {
        let typed = names::typed_list(reader, public, ListEntryKind::Names);
        declared.extend(with_privacy(typed, &Privacy::Public));
        from = from.after(public);
        let Some(block) = from.next() else { return declared };
        declared.extend(private_objects(reader, block, items, has_owners));
        public = from.until(is_private);
    }
}

fn is_private(node: SyntaxNode<'_>) -> bool {
    node.head().is_some_and(|head| head.eq_ignore_ascii_case(":private"))
}

fn with_privacy(typed: Vec<Typed>, privacy: &Privacy) -> impl Iterator<Item = ObjectDeclaration> {
    typed.into_iter().map(|object| ObjectDeclaration { object, privacy: privacy.clone() })
}

/// Parses a block of private objects: `(:private [NAME] (NAME* [- TYPE])*)`.
///
/// The owner of the block is written like an object. The first word of the block is the owner if it
/// has no type and one of two conditions holds: the word is declared elsewhere in the section
/// (agents are also objects), or the section has several blocks with owners.
fn private_objects<'f>(
    reader: &mut GrammarReader<'f>,
    block: SyntaxNode<'f>,
    section: Items<'f>,
    has_owners: bool,
) -> Vec<ObjectDeclaration> {
    let Some(mut items) = block.list() else { return Vec::new() };
    items.next();
    let mut rest = items;
    let mut owner = None;
    if let (Some(first), true) = (rest.next(), starts_with_owner(items, section, has_owners)) {
        owner = names::name(reader, first, "an agent");
        items = rest;
    }
    let owner = owner.map(|name| Typed { name, ty: TypeExpr::default() });
    let typed = names::typed_list(reader, items, ListEntryKind::Names);
    with_privacy(typed, &Privacy::Private(owner)).collect()
}

fn starts_with_owner(mut items: Items<'_>, section: Items<'_>, has_owners: bool) -> bool {
    let Some(first) = items.next().and_then(SyntaxNode::symbol) else { return false };
    if items.peek().and_then(SyntaxNode::symbol) == Some("-") {
        return false;
    }
    let words = section.flat_map(|node| match node.list() {
        Some(inner) if is_private(node) => inner,
        _ => node.alone(),
    });
    let is_first =
        |node: &SyntaxNode<'_>| node.symbol().is_some_and(|w| w.eq_ignore_ascii_case(first));
    has_owners || words.filter(is_first).nth(1).is_some()
}
