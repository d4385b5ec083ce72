//! Names, terms and typed lists.

use std::fmt;

use super::layout::Layout;
use crate::tree::{Atom, FluentTerm, Name, Term, TypeExpr, Typed};

/// Kind of the entries in a typed list.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Entries {
    Variables,
    Names,
}

/// Writes `layout` as the format string requests: `{}` on one line, `{:#}` broken if long.
pub(super) fn write(layout: &Layout<'_>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if f.alternate() { layout.write(0, f) } else { layout.write_flat(f) }
}

/// `NAME | (either NAME NAME+)`; the empty list is `object`.
pub(super) fn type_expr(ty: &TypeExpr) -> Layout<'_> {
    match &ty.alternatives[..] {
        [] => Layout::word("object"),
        [only] => Layout::name(only),
        several => Layout::headed("either", several.iter().map(Layout::name)),
    }
}

/// `(ENTRY+ - TYPE)* ENTRY*`, a group for each type.
pub(super) fn typed_list(list: &[Typed], entries: Entries) -> Vec<Layout<'_>> {
    let mut groups = Vec::new();
    let mut from = 0;
    for group in list.chunk_by(|left, right| left.ty == right.ty) {
        from += group.len();
        // A type applies to all untyped names before it, so only the last group may be without one.
        let is_typed = !group[0].ty.alternatives.is_empty() || from < list.len();
        groups.push(typed_group(group, is_typed, entries));
    }
    groups
}

fn typed_group(group: &[Typed], is_typed: bool, entries: Entries) -> Layout<'_> {
    let mut words: Vec<_> = group.iter().map(|typed| entry(&typed.name, entries)).collect();
    if is_typed {
        words.extend([Layout::word("-"), type_expr(&group[0].ty)]);
    }
    Layout::group(words)
}

fn entry(name: &Name, entries: Entries) -> Layout<'_> {
    match entries {
        Entries::Variables => Layout::variable(name),
        Entries::Names => Layout::name(name),
    }
}

/// `(VARIABLES)`
pub(super) fn parameters(list: &[Typed]) -> Layout<'_> {
    Layout::list(0, typed_list(list, Entries::Variables))
}

/// `(NAME VARIABLES)`
pub(super) fn signature<'t>(name: &'t Name, parameters: &'t [Typed]) -> Layout<'t> {
    Layout::headed(name.spelled(), typed_list(parameters, Entries::Variables))
}

pub(super) fn term(term: &Term) -> Layout<'_> {
    match term {
        Term::Variable(name) => Layout::variable(name),
        Term::Object(name) => Layout::name(name),
    }
}

/// `(PREDICATE TERM*)`
pub(super) fn atom(atom: &Atom) -> Layout<'_> {
    Layout::headed(atom.predicate.spelled(), atom.arguments.iter().map(term))
}

/// `(FUNCTION TERM*)`
pub(super) fn fluent(fluent: &FluentTerm) -> Layout<'_> {
    Layout::headed(fluent.function.spelled(), fluent.arguments.iter().map(term))
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
