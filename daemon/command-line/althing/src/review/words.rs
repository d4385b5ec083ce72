//! Checks the words that an ecosystem file adds against the ontology and the action models of the
//! agents in the file, which bring predicates and functions of their own.

use pddl::Span;

use super::Reviewer;
use crate::hosting;

// === impl Reviewer ===

impl Reviewer<'_> {
    /// Reports words of symbols that are not declared, and phrases without one place for each
    /// argument.
    pub(super) fn words(&mut self) {
        if self.ecosystem.words.is_empty() {
            return;
        }
        let (domain, _) = self.widened(&hosting::models(self.ecosystem));
        for (language, own) in &self.ecosystem.words {
            for mistake in own.mistakes(&domain) {
                // An entry that could not be understood may declare the symbol.
                if mistake.is_error || self.is_complete {
                    let path = format!("words.{}.{}", language.tag(), mistake.path.join("."));
                    self.report_key(&path, mistake.diagnostic(Span::default()));
                }
            }
        }
    }
}
