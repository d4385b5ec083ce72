//! Facts in PDDL text, as far as the history needs them. The text may be anything: what is not
//! understood is left out.

use std::borrow::Cow;

use crate::event::{FALSE, TRUE, UNKNOWN};

/// A fact in a text, apart from its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FactText<'a> {
    /// The ground atom, or the ground function without its value.
    pub(crate) fact: &'a str,
    /// `true`, `false`, `unknown`, or a number.
    pub(crate) value: &'a str,
}

/// Returns the lists at the top level of a text, each with its parentheses.
pub(crate) fn lists(text: &str) -> impl Iterator<Item = &str> {
    let (mut rest, mut at) = (text.as_bytes(), 0);
    std::iter::from_fn(move || {
        let begin = rest.iter().position(|byte| *byte == b'(')?;
        let mut depth = 0_usize;
        for (index, byte) in rest.iter().enumerate().skip(begin) {
            match byte {
                b'(' => depth += 1,
                b')' => depth -= 1,
                _ => (),
            }
            if depth == 0 {
                let list = text.get(at + begin..at + index + 1);
                rest = &rest[index + 1..];
                at += index + 1;
                return list;
            }
        }
        None
    })
}

/// Returns the facts in a text: `(lit hall) (= (temperature hall) 21) (not (open d))`.
pub(crate) fn facts(text: &str) -> impl Iterator<Item = FactText<'_>> {
    lists(text).filter_map(fact)
}

fn fact(list: &str) -> Option<FactText<'_>> {
    let inside = list.strip_prefix('(')?.strip_suffix(')')?.trim();
    let (head, rest) = inside.split_once(char::is_whitespace).unwrap_or((inside, ""));
    match head {
        "" => None,
        "=" => {
            let fact = lists(rest).next()?;
            let value = rest.get(rest.find(fact)? + fact.len()..)?.trim();
            let is_number = value.parse::<f64>().is_ok_and(f64::is_finite);
            is_number.then_some(FactText { fact, value })
        }
        "not" => Some(FactText { fact: lists(rest).next()?, value: FALSE }),
        "unknown" => Some(FactText { fact: lists(rest).next()?, value: UNKNOWN }),
        _ => Some(FactText { fact: list, value: TRUE }),
    }
}

/// Returns the names of the predicates and functions that an action model declares `:private`.
pub(crate) fn private_names(model: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (at, marker) in model.match_indices(":private") {
        let is_head = model[..at].trim_end().ends_with('(');
        let Some(begin) = model[..at].rfind('(').filter(|_| is_head) else { continue };
        let Some(section) = lists(&model[begin..]).next() else { continue };
        let declared = section.get(at - begin + marker.len()..).unwrap_or_default();
        names.extend(lists(declared).filter_map(head).map(str::to_ascii_lowercase));
    }
    names
}

/// Returns the first word of a list.
pub(crate) fn head(list: &str) -> Option<&str> {
    let inside = list.trim_start().strip_prefix('(')?.trim_start();
    inside
        .split(|c: char| c.is_whitespace() || matches!(c, '(' | ')'))
        .find(|word| !word.is_empty())
}

/// Returns the first word of each list in a text, at every depth.
pub(crate) fn heads(text: &str) -> impl Iterator<Item = &str> {
    text.match_indices('(').filter_map(|(at, _)| head(&text[at..]))
}

/// Returns the names of which a name may be an auxiliary name in the domain of all agents:
/// `unknown-P` and `maybe-P` of `P`, with a number behind it if the name was in use.
pub(crate) fn auxiliary_of(name: &str) -> impl Iterator<Item = &str> {
    let of = ["unknown-", "found-", "defined-", "maybe-", "offers-"];
    let of = of.into_iter().find_map(|prefix| name.strip_prefix(prefix));
    let numbered = of.and_then(|of| {
        let (of, number) = of.rsplit_once('-')?;
        number.bytes().all(|byte| byte.is_ascii_digit()).then_some(of)
    });
    of.into_iter().chain(numbered)
}

/// Returns the text with the names of actions as their agents use them. In the domain of all agents
/// an action that several agents introduce has `--` and the name of its agent behind its name.
pub(crate) fn without_introducers(text: &str) -> Cow<'_, str> {
    if !text.contains("--") {
        return text.into();
    }
    let mut bare = String::with_capacity(text.len());
    for (index, part) in text.split('(').enumerate() {
        if index > 0 {
            bare.push('(');
        }
        let name = part.split([' ', ')']).next().unwrap_or_default();
        match name.find("--").filter(|at| index > 0 && *at > 0) {
            Some(at) => bare.extend([&name[..at], &part[name.len()..]]),
            None => bare.push_str(part),
        }
    }
    bare.into()
}

/// Returns the parts of a text that stand between backquotes.
pub(crate) fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_are_read_with_their_values() {
        let text = "(at r1 hall) (= (speed r1) 0.3)(not (open d))  (unknown (lit hall)) (= (a) b) \
                    (unbalanced";
        let facts: Vec<_> = facts(text).map(|fact| (fact.fact, fact.value)).collect();
        let expected = [
            ("(at r1 hall)", TRUE),
            ("(speed r1)", "0.3"),
            ("(open d)", FALSE),
            ("(lit hall)", UNKNOWN),
        ];
        assert_eq!(facts, expected);
        assert_eq!(super::facts("no fact ) ( ( é").count(), 0);
        assert_eq!(super::facts("(= ) (not) () (= (x) nan)").count(), 0);
    }

    #[test]
    fn private_names_are_those_of_the_private_sections() {
        let model = "(define (agent a) (:predicates (public ?x) (:private (docked ?r - robot) \
                     (pin ?p))) (:functions ( :private (secret ?r) - number)) (:action private))";
        assert_eq!(private_names(model), ["docked", "pin", "secret"]);
        assert!(private_names("(:private").is_empty());
        assert!(private_names(":private (a)").is_empty());
    }

    #[test]
    fn auxiliary_names_stand_for_names() {
        let of = |name| auxiliary_of(name).collect::<Vec<_>>();
        assert_eq!(of("unknown-on-2"), ["on-2", "on"]);
        assert_eq!(of("found-temperature"), ["temperature"]);
        assert!(of("temperature").is_empty() && of("known-temperature").is_empty());
    }

    #[test]
    fn actions_have_the_names_that_their_agents_use() {
        let text = "plan: (report--ir-1 ir-1 hall) (move x--y) (reset--ir-1) --limit";
        let expected = "plan: (report ir-1 hall) (move x--y) (reset) --limit";
        assert_eq!(without_introducers(text), expected);
    }

    #[test]
    fn heads_are_found_at_every_depth() {
        let heads: Vec<_> = heads("(and (at r1 hall) (not (docked r1)))").collect();
        assert_eq!(heads, ["and", "at", "not", "docked"]);
        assert_eq!(
            quoted("offers nothing: `a`; not `(at a b)`").collect::<Vec<_>>(),
            ["a", "(at a b)"]
        );
    }
}
