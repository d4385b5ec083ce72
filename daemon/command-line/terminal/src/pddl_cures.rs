//! Cures for mistakes in PDDL files that only the diagnostics together show: a parenthesis that is
//! missing inside a fact, an object that was removed, a predicate that no domain declares.

use std::collections::BTreeMap;

use pddl::{Diagnostic, Span};

/// The number of places from which a name that is not declared is no slip of the keyboard: an object
/// was removed, or never declared.
const SLIPS_MAX: usize = 2;

/// Returns the diagnostics of a text with better cures, and without those that only follow from
/// others.
pub(crate) fn improved(text: &str, diagnostics: Vec<Diagnostic>) -> Vec<Diagnostic> {
    let mut diagnostics = join_unclosed(text, diagnostics);
    join_undeclared(text, &mut diagnostics);
    for found in &mut diagnostics {
        let name = found.message.strip_prefix("unknown predicate `");
        if let (Some(name), None) = (name.and_then(|rest| rest.strip_suffix('`')), &found.help) {
            found.help = Some(format!(
                "declare it in the domain, (:predicates … ({name} …)), or take it out here"
            ));
        }
    }
    diagnostics
}

/// Joins the two errors that follow from a missing `)` in a fact: the list around the fact is not
/// closed, and the next fact stands where an argument is expected.
fn join_unclosed(text: &str, diagnostics: Vec<Diagnostic>) -> Vec<Diagnostic> {
    let nested = |found: &Diagnostic| found.message.starts_with("expected a variable or an object");
    let unclosed = |found: &Diagnostic| {
        let closes_one = found.help.as_deref().is_some_and(|help| help.starts_with("add `)` "));
        found.message == "unclosed `(`" && closes_one
    };
    let inner: Vec<Span> =
        diagnostics.iter().filter(|found| nested(found)).map(|found| found.span).collect();
    let [inner] = inner.as_slice() else { return diagnostics };
    let is_around = |found: &Diagnostic| unclosed(found) && found.span.start < inner.start;
    if diagnostics.iter().filter(|found| is_around(found)).count() != 1 {
        return diagnostics;
    }
    let before = text.get(..inner.start as usize).unwrap_or_default().trim_end();
    let word = before.rsplit(['(', ')', ' ', '\n', '\t']).next().unwrap_or_default().to_owned();
    let joined = diagnostics.into_iter().filter(|found| !is_around(found));
    let cured = joined.map(|found| match nested(&found) {
        true => found.with_help(format!("a `)` is missing: write it after `{word}`")),
        false => found,
    });
    cured.collect()
}

/// Joins the errors about one object that is used in many places and declared nowhere.
fn join_undeclared(text: &str, diagnostics: &mut Vec<Diagnostic>) {
    let mut places: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for found in diagnostics.iter().filter(|found| found.message.starts_with("unknown object `")) {
        let (line, _) = pddl::line_column(text, found.span.start as usize);
        places.entry(found.message.clone()).or_default().push(line);
    }
    places.retain(|_, lines| lines.len() > SLIPS_MAX);
    let mut told = Vec::new();
    diagnostics.retain(|found| {
        let is_repeated = places.contains_key(&found.message) && told.contains(&found.message);
        told.push(found.message.clone());
        !is_repeated
    });
    for found in diagnostics.iter_mut() {
        let Some(lines) = places.get(&found.message) else { continue };
        let mut others: Vec<_> = lines.iter().skip(1).map(usize::to_string).collect();
        others.dedup();
        found.help = Some(format!(
            "declare it under `:objects`, or take out all places that name it: here, and in line {}",
            others.join(", ")
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the line, the message and the help of each mistake in a map of a domain.
    fn told(map: &str) -> Vec<(usize, String, String)> {
        let domain = "(define (domain d) (:requirements :typing) (:types room)
            (:predicates (way ?a ?b - room)))";
        let domain = pddl::parse_domain(domain).into_result().expect("a domain");
        let parsed = pddl::parse_problem(map);
        let mut found = parsed.diagnostics;
        found.extend(parsed.value.map(|map| pddl::check_map(&domain, &map)).unwrap_or_default());
        let told = improved(map, found).into_iter().map(|found| {
            let line = pddl::line_column(map, found.span.start as usize).0;
            (line, found.message, found.help.unwrap_or_default())
        });
        told.collect()
    }

    fn map(init: &str) -> String {
        format!(
            "(define (problem p) (:domain d) (:objects a b - room)\n(:init {init})\n(:goal (and)))"
        )
    }

    #[test]
    fn a_missing_parenthesis_is_reported_where_it_belongs() {
        let told = told(&map("(way a b)\n(way b a\n(way a b)"));
        let [(line, message, help)] = &told[..] else { panic!("one mistake: {told:?}") };
        assert_eq!((*line, help.as_str()), (4, "a `)` is missing: write it after `a`"));
        assert!(message.contains("found `(way a b)`"), "{message}");
    }

    #[test]
    fn an_object_that_was_removed_is_reported_once() {
        let told = told(&map("(way a c)\n(way c a)\n(way b c)"));
        let [(line, message, help)] = &told[..] else { panic!("one mistake: {told:?}") };
        assert_eq!((*line, message.as_str()), (2, "unknown object `c`"));
        assert!(help.ends_with("here, and in line 3, 4"), "{help}");
        // In one place it is a slip.
        assert_eq!(self::told(&map("(way a c)")).len(), 1);
    }

    #[test]
    fn an_undeclared_predicate_has_a_cure() {
        let told = told(&map("(staircase a)"));
        assert!(told[0].2.contains("(:predicates … (staircase …))"), "{told:?}");
    }
}
