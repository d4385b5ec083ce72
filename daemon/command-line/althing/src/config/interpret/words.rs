//! The words that an ecosystem file adds: `[words.en]` and so on; and the goals of the file that are
//! written in words of any language. Their objects are checked later, as those of goals in PDDL.

use std::collections::BTreeMap;

use pddl::Diagnostic;
use phrases::{KnownNames, Language, NotUnderstood, OwnWords, Phrasebook};
use serde_json::Value;

use super::Interpreter;
use super::goals::relocate;
use crate::config::goal_cures;
use crate::config::raw::RawNamedGoal;

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the words of each language, and reports languages that are not known and phrases that
    /// are wrong. Replaces the goals that are written in words by PDDL.
    pub(super) fn words(
        &mut self,
        raw: Value,
        goals: &mut BTreeMap<String, RawNamedGoal>,
    ) -> BTreeMap<Language, OwnWords> {
        let words = self.own_words(raw);
        for (name, goal) in goals {
            let Some(text) = &mut goal.goal else { continue };
            match read(text, &words) {
                Ok(None) => (),
                Ok(Some(pddl)) => *text = pddl,
                // Reported with its cure, as PDDL.
                Err(_) if goal_cures::has_cure(text) => (),
                Err(wrong) => {
                    match self.place(&format!("goals.{name}.goal")) {
                        Some((source, place)) => {
                            let found = relocate(wrong.diagnostic(), &source, place, text);
                            self.report.add(&source, [found]);
                        }
                        None => self.report.add_general(wrong.diagnostic()),
                    }
                    // The mistake is reported; as PDDL it would be reported once more.
                    *text = pddl::Condition::always().to_string();
                }
            }
        }
        words
    }

    fn own_words(&mut self, raw: Value) -> BTreeMap<Language, OwnWords> {
        let mut words = BTreeMap::new();
        let Value::Object(languages) = raw else { return words };
        for (tag, value) in languages {
            let Some(language) = Language::from_tag(&tag).filter(|known| known.tag() == tag) else {
                let known: Vec<_> = Language::ALL.iter().map(|known| known.tag()).collect();
                self.about_key(&format!("words.{tag}"), |span| {
                    Diagnostic::error(span, format!("there are no words in the language `{tag}`"))
                        .with_help(format!("known are {}", known.join(", ")))
                });
                continue;
            };
            let unknown = phrases::key_mistakes(&value);
            for mistake in &unknown {
                let path = format!("words.{tag}.{}", mistake.path.join("."));
                self.about_key(&path, |span| mistake.diagnostic(span));
            }
            if !unknown.is_empty() {
                continue;
            }
            match serde_json::from_value::<OwnWords>(value) {
                Ok(own) => match Phrasebook::standard(language).with_own(&own) {
                    Ok(_) => {
                        words.insert(language, own);
                    }
                    Err(wrong) => self.wrong_words(&tag, &wrong.to_string()),
                },
                Err(wrong) => self.wrong_words(&tag, &wrong.to_string()),
            }
        }
        words
    }

    fn wrong_words(&mut self, tag: &str, why: &str) {
        let message = format!("`[words.{tag}]` cannot be used: {why}");
        let help = "write [words.en.predicates] and then clean = { phrase = \"{1} clean\" }";
        self.about_key(&format!("words.{tag}"), |span| {
            Diagnostic::error(span, message).with_help(help)
        });
    }
}

/// Reads a goal that is written in the words of any language. Returns `None` if it is PDDL, or so far
/// from any words that it was probably meant as PDDL.
fn read(goal: &str, words: &BTreeMap<Language, OwnWords>) -> Result<Option<String>, NotUnderstood> {
    if goal.trim_start().starts_with('(') || !goal.trim().contains(char::is_whitespace) {
        return Ok(None);
    }
    let mut answer: Option<NotUnderstood> = None;
    for language in Language::ALL {
        let book = Phrasebook::standard(language);
        // Wrong words are reported where they stand.
        let own = words.get(&language).and_then(|own| book.clone().with_own(own).ok());
        match own.unwrap_or(book).parse(goal, &KnownNames::default()) {
            Ok(read) => return Ok(Some(read)),
            Err(wrong) => {
                answer = Some(match answer {
                    Some(known) => known.nearer(wrong),
                    None => wrong,
                });
            }
        }
    }
    match answer.filter(|answer| answer.is_near) {
        Some(wrong) => Err(wrong),
        None => Ok(None),
    }
}
