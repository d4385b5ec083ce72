//! Printing of names, terms and typed lists.

use std::fmt;

use super::layout::PrintLayout;
use crate::tree::{Atom, FluentTerm, Name, Term, TypeExpr, Typed};

/// Kind of the entries in a typed list.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum PrintedEntryKind {
    Variables,
    Names,
}

/// Writes `layout` as the format string requests: on one line for `{}`, and with breaks in long
/// lines for `{:#}`.
pub(super) fn write(layout: &PrintLayout<'_>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if f.alternate() { layout.write(0, f) } else { layout.write_flat(f) }
}

/// Lays out a type: `NAME | (either NAME NAME+)`. A type without alternatives is printed as
/// `object`.
pub(super) fn type_expr(ty: &TypeExpr) -> PrintLayout<'_> {
    match &ty.alternatives[..] {
        [] => PrintLayout::word("object"),
        [only] => PrintLayout::name(only),
        several => PrintLayout::headed("either", several.iter().map(PrintLayout::name)),
    }
}

/// Lays out a typed list: `(ENTRY+ - TYPE)* ENTRY*`, with a group for each type.
pub(super) fn typed_list<'t>(
    list: impl IntoIterator<Item = &'t Typed>,
    entries: PrintedEntryKind,
) -> Vec<PrintLayout<'t>> {
    let list: Vec<&Typed> = list.into_iter().collect();
    let mut groups = Vec::new();
    let mut from = 0;
    for group in list.chunk_by(|left, right| left.ty == right.ty) {
        from += group.len();
        // A type applies to all untyped names before it, so only the last group may be untyped.
        let is_typed = !group[0].ty.alternatives.is_empty() || from < list.len();
        let mut words: Vec<_> = group.iter().map(|typed| entry(&typed.name, entries)).collect();
        if is_typed {
            words.extend([PrintLayout::word("-"), type_expr(&group[0].ty)]);
        }
        groups.push(PrintLayout::group(words));
    }
    groups
}

fn entry(name: &Name, entries: PrintedEntryKind) -> PrintLayout<'_> {
    match entries {
        PrintedEntryKind::Variables => PrintLayout::variable(name),
        PrintedEntryKind::Names => PrintLayout::name(name),
    }
}

/// Lays out parameters in parentheses: `(VARIABLES)`.
pub(super) fn parameters(list: &[Typed]) -> PrintLayout<'_> {
    PrintLayout::list(0, typed_list(list, PrintedEntryKind::Variables))
}

/// Lays out the signature of a predicate or function: `(NAME VARIABLES)`.
pub(super) fn signature<'t>(name: &'t Name, parameters: &'t [Typed]) -> PrintLayout<'t> {
    PrintLayout::headed(name.spelled(), typed_list(parameters, PrintedEntryKind::Variables))
}

pub(super) fn term(term: &Term) -> PrintLayout<'_> {
    match term {
        Term::Variable(name) => PrintLayout::variable(name),
        Term::Object(name) => PrintLayout::name(name),
    }
}

/// Lays out a predicate with its arguments: `(PREDICATE TERM*)`.
pub(super) fn atom(atom: &Atom) -> PrintLayout<'_> {
    PrintLayout::headed(atom.predicate.spelled(), atom.arguments.iter().map(term))
}

/// Lays out a function with its arguments: `(FUNCTION TERM*)`.
pub(super) fn fluent(fluent: &FluentTerm) -> PrintLayout<'_> {
    PrintLayout::headed(fluent.function.spelled(), fluent.arguments.iter().map(term))
}

impl fmt::Display for TypeExpr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&type_expr(self), f)
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&term(self), f)
    }
}

impl fmt::Display for Atom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&atom(self), f)
    }
}

impl fmt::Display for FluentTerm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&fluent(self), f)
    }
}
