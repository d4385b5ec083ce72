//! Facts in the sentences of agents: what stands between backquotes as PDDL is said in words.

use crate::phrasebook::Phrasebook;

/// Longest sentence that is looked through, in bytes; longer ones stay as they are.
const BYTES_MAX: usize = 64 << 10;

/// Returns a sentence with its facts in words.
pub(crate) fn with_words(book: &Phrasebook, sentence: &str) -> String {
    if sentence.len() > BYTES_MAX || !sentence.contains("`(") {
        return sentence.to_owned();
    }
    // Every second part stands between backquotes, if all of them are closed.
    let parts: Vec<&str> = sentence.split('`').collect();
    let mut said = String::with_capacity(sentence.len());
    for (number, part) in parts.iter().enumerate() {
        if number > 0 {
            said.push('`');
        }
        let is_quoted = number % 2 == 1 && number + 1 < parts.len();
        match is_quoted && part.starts_with('(') {
            true => said += &pddl_in_words(book, part).unwrap_or_else(|| (*part).to_owned()),
            false => said += part,
        }
    }
    said
}

/// Returns a text with its goals and facts in words, wherever they stand in it. Of PDDL in PDDL the
/// outermost is said.
pub(crate) fn with_words_anywhere(book: &Phrasebook, text: &str) -> String {
    if text.len() > BYTES_MAX {
        return text.to_owned();
    }
    let (mut said, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(start) = rest.find('(') {
        let (before, from) = rest.split_at(start);
        said += before;
        // A parenthesis that is never closed: there is no PDDL behind it.
        let Some(end) = closing(from) else {
            rest = from;
            break;
        };
        let (group, after) = from.split_at(end);
        said += &pddl_in_words(book, group).unwrap_or_else(|| group.to_owned());
        rest = after;
    }
    said + rest
}

/// Returns the offset after the parenthesis that closes the first one; `None` if none does.
fn closing(text: &str) -> Option<usize> {
    let mut depth = 0_usize;
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'(' => depth += 1,
            b')' => depth = depth.checked_sub(1)?,
            _ => (),
        }
        if depth == 0 {
            return Some(at + 1);
        }
    }
    None
}

/// Says a goal or a fact that is written in PDDL; `None` if it is neither, or has no words.
pub(crate) fn pddl_in_words(book: &Phrasebook, text: &str) -> Option<String> {
    let said = match pddl::parse_condition(text).into_result() {
        Ok(goal) => book.say(&goal),
        Err(_) => {
            let facts = pddl::parse_init_elements(text).into_result().ok()?;
            let said: Vec<_> = facts.iter().map(|fact| book.print_fact(fact)).collect();
            said.join(", ")
        }
    };
    // A text in PDDL stays as its author wrote it.
    let is_goal = said.starts_with('(') && pddl::parse_condition(&said).is_ok();
    let is_fact = said.starts_with('(') && pddl::parse_init_elements(&said).is_ok();
    (!is_goal && !is_fact).then_some(said)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::Language;

    #[track_caller]
    fn check(sentence: &str, expected: &str) {
        let book = Phrasebook::standard(Language::English);
        assert_eq!(with_words(&book, sentence), expected);
    }

    #[test]
    fn facts_between_backquotes_are_said_in_words() {
        check(
            "no agent can `look` for `(known-picture hall)`; `c` does not offer `look` now",
            "no agent can `look` for `picture of hall known`; `c` does not offer `look` now",
        );
        check(
            "`desk` set `(= (temperature hall) 20.5)`",
            "`desk` set `temperature of hall is 20.5 °C`",
        );
        check(
            "`desk` set `(unknown (motion hall))`",
            "`desk` set `unknown whether motion in hall`",
        );
    }

    #[test]
    fn several_facts_are_said_one_after_the_other() {
        check("`a` bids for `(lit a) (swept b)`", "`a` bids for `light in a on, b swept`");
        check("`(lit a) (odd b)`", "`light in a on, (odd b)`");
    }

    #[test]
    fn facts_anywhere_are_said_in_words() {
        let book = Phrasebook::standard(Language::English);
        for (text, expected) in [
            ("(lit a)", "light in a on"),
            ("(lit a) has failed: no", "light in a on has failed: no"),
            ("ann asks for (lit a), and to keep it", "ann asks for light in a on, and to keep it"),
            ("chosen: `r` for `(lit a)` (bid 8)", "chosen: `r` for `light in a on` (bid 8)"),
            ("(odd a) (lit a)", "(odd a) light in a on"),
            ("(and (lit a) (odd b))", "light in a on and (odd b)"),
            ("a (and 3 more within 10 min)", "a (and 3 more within 10 min)"),
            ("(lit a", "(lit a"),
            (") (lit a)", ") light in a on"),
            ("((lit a))", "((lit a))"),
            ("", ""),
        ] {
            assert_eq!(with_words_anywhere(&book, text), expected, "{text}");
        }
        let deep = "(".repeat(BYTES_MAX);
        assert_eq!(with_words_anywhere(&book, &deep), deep);
    }

    #[test]
    fn other_texts_stay_as_they_are() {
        for text in [
            "",
            "`",
            "a ` b `(known-picture hall)",
            "`(move turtlebot-1 corridor office1)`",
            "`(known-picture hall`",
            "(known-picture hall)",
            "`()`x`(`",
        ] {
            check(text, text);
        }
    }
}
