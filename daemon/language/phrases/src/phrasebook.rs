//! The words of one language: phrases, grammar, and the words of types.

use std::collections::BTreeMap;

use pddl::{Comparison, Condition, InitElement, Name};

use crate::known_names::KnownNames;
use crate::language::Language;
use crate::not_understood::NotUnderstood;
use crate::pattern::{Pattern, PhrasePart};
use crate::quantifiers::QuantifierWords;
use crate::words_file::{Grammar, OwnWords, PredicateWords, TypeWords, WordsError, WordsFile};
use crate::{completion, reading, saying, sentences};

/// What a phrase says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum PhraseKind {
    /// A predicate of its arguments.
    Predicate,
    /// The negation of a predicate.
    Negation,
    /// The value of a function.
    Function,
    /// The equality of two objects.
    Same,
}

/// A phrase of a predicate or function.
#[derive(Clone, Debug)]
pub(crate) struct Phrase {
    pub(crate) symbol: Name,
    pub(crate) kind: PhraseKind,
    pub(crate) pattern: Pattern,
    /// Whether the phrase is said; otherwise it is only read.
    pub(crate) is_said: bool,
}

/// The words of one language, with which goals and facts are read and said.
///
/// ```
/// use phrases::{KnownNames, Language, Phrasebook};
///
/// let book = Phrasebook::standard(Language::English);
/// let goal = "(forall (?r - room) (known-temperature ?r))";
/// let said = "temperature of every room known";
/// let read = pddl::parse_condition(goal).into_result().expect("it is PDDL");
/// assert_eq!(book.say(&read), said);
/// assert_eq!(book.parse(said, &KnownNames::default()).as_deref(), Ok(goal));
/// ```
#[derive(Clone, Debug)]
pub struct Phrasebook {
    pub(crate) language: Language,
    pub(crate) grammar: Grammar,
    pub(crate) phrases: Vec<Phrase>,
    /// The names of the unit of each function; the first one is said.
    pub(crate) units: BTreeMap<Name, Vec<String>>,
    pub(crate) quantifiers: QuantifierWords,
}

// === impl Phrasebook ===

impl Phrasebook {
    /// Returns the words of a language for the standard ontology.
    pub fn standard(language: Language) -> Phrasebook {
        let file: WordsFile =
            toml::from_str(language.words()).expect("a test reads each words file of this crate");
        let WordsFile { grammar, predicates, functions, types } = file;
        let quantifiers = QuantifierWords::new(&grammar.types);
        let (phrases, units) = (Vec::new(), BTreeMap::new());
        let mut book = Phrasebook { language, grammar, phrases, units, quantifiers };
        let same = book.grammar.same.clone();
        let added = book
            .add("=", PhraseKind::Same, &same, true)
            .and_then(|()| book.add_all(&OwnWords { predicates, functions, types }));
        added.expect("a test reads each words file of this crate");
        book
    }

    /// Returns these words with those of an ecosystem, which replace the standard words of the same
    /// predicate, function or type.
    ///
    /// # Errors
    ///
    /// Returns an error if a phrase is wrong.
    pub fn with_own(mut self, own: &OwnWords) -> Result<Phrasebook, WordsError> {
        self.add_all(own)?;
        Ok(self)
    }

    /// Returns the language of these words.
    pub fn language(&self) -> Language {
        self.language
    }

    /// Reads a goal in words, and returns it as PDDL.
    ///
    /// # Errors
    ///
    /// Returns the place that is not understood, and the nearest text that is.
    pub fn parse(&self, text: &str, names: &KnownNames) -> Result<String, NotUnderstood> {
        self.read(text, names).map(|goal| goal.to_string())
    }

    /// Reads a goal in words.
    ///
    /// # Errors
    ///
    /// Returns the place that is not understood, and the nearest text that is.
    pub fn read(&self, text: &str, names: &KnownNames) -> Result<Condition, NotUnderstood> {
        reading::read(self, text, names)
    }

    /// Says a goal. Each goal has one text; what has no words is said in PDDL.
    pub fn say(&self, goal: &Condition) -> String {
        saying::goal(self, goal)
    }

    /// Says a fact, the value of a function, or that a fact is unknown; in PDDL if it has no words.
    pub fn print_fact(&self, fact: &InitElement) -> String {
        saying::fact(self, fact)
    }

    /// Says a goal or a fact that is given in PDDL. A text that is no PDDL, or has no words, stays as
    /// it is.
    pub fn print_pddl(&self, pddl: &str) -> String {
        let text = pddl.trim();
        let said = if text.starts_with('(') { sentences::pddl_in_words(self, text) } else { None };
        said.unwrap_or_else(|| pddl.to_owned())
    }

    /// Returns a text in which facts and goals between backquotes are said in words. Facts without
    /// words, and other texts between backquotes, stay as they are.
    pub fn print_sentence(&self, sentence: &str) -> String {
        sentences::with_words(self, sentence)
    }

    /// Returns a text in which facts and goals are said in words wherever they stand. Those without
    /// words stay in PDDL.
    pub fn print_text(&self, text: &str) -> String {
        sentences::with_words_anywhere(self, text)
    }

    /// Returns the words that may follow at the end of `before`, the text before a cursor, and the
    /// offset at which the word under the cursor begins.
    pub fn complete(&self, before: &str, names: &KnownNames) -> (usize, Vec<String>) {
        completion::complete(self, before, names)
    }

    fn add_all(&mut self, own: &OwnWords) -> Result<(), WordsError> {
        for (symbol, words) in &own.predicates {
            self.forget(symbol);
            let PredicateWords { phrase, negated, also } = words;
            self.add(symbol, PhraseKind::Predicate, phrase, true)?;
            if let Some(negated) = negated {
                self.add(symbol, PhraseKind::Negation, negated, true)?;
            }
            for phrase in also {
                self.add(symbol, PhraseKind::Predicate, phrase, false)?;
            }
        }
        for (symbol, words) in &own.functions {
            self.forget(symbol);
            self.add(symbol, PhraseKind::Function, &words.phrase, true)?;
            for phrase in &words.also {
                self.add(symbol, PhraseKind::Function, phrase, false)?;
            }
            let units = std::iter::once(&words.unit).chain(&words.units);
            let units = units.filter(|unit| !unit.is_empty()).cloned().collect();
            self.units.insert(Name::new(symbol), units);
        }
        for (ty, words) in &own.types {
            self.add_type(ty, words)?;
        }
        Ok(())
    }

    fn forget(&mut self, symbol: &str) {
        let symbol = Name::new(symbol);
        self.phrases.retain(|phrase| phrase.symbol != symbol);
    }

    fn add_type(&mut self, ty: &str, words: &TypeWords) -> Result<(), WordsError> {
        if words.every.is_empty() || words.some.is_empty() {
            let why = "`every` and `some` need at least one form each".to_owned();
            return Err(WordsError { symbol: ty.to_owned(), why });
        }
        self.quantifiers.add(Name::new(ty), words);
        Ok(())
    }

    fn add(
        &mut self,
        symbol: &str,
        kind: PhraseKind,
        text: &str,
        is_said: bool,
    ) -> Result<(), WordsError> {
        let pattern = Pattern::read(symbol, text)?;
        let Grammar { and, or, then, not, when, before_quantifier, .. } = &self.grammar;
        let reserved = [and, or, then];
        let openers = [not, when, before_quantifier];
        let has = |lists: &[&Vec<String>], word: &str| {
            lists.iter().any(|words| words.iter().any(|reserved| reserved == word))
        };
        let opens = match pattern.parts.first() {
            Some(PhrasePart::Word { lower, .. }) => has(&openers, lower),
            _ => false,
        };
        let wrong = pattern.words().find(|word| opens || has(&reserved, word));
        if let Some(word) = wrong {
            let why = format!("`{word}` joins conditions, and cannot be a word of the phrase here");
            return Err(WordsError { symbol: symbol.to_owned(), why });
        }
        let symbol = Name::new(symbol);
        self.phrases.push(Phrase { symbol, kind, pattern, is_said });
        Ok(())
    }

    /// Returns the phrase by which a symbol with `arity` arguments is said; `None` if it has none.
    pub(crate) fn said(&self, symbol: &Name, kind: PhraseKind, arity: usize) -> Option<&Pattern> {
        let is_it = |phrase: &&Phrase| {
            phrase.is_said
                && phrase.kind == kind
                && phrase.symbol == *symbol
                && phrase.pattern.arity == arity
        };
        self.phrases.iter().find(is_it).map(|phrase| &phrase.pattern)
    }

    /// Returns the words of a comparison, the one that is said first.
    pub(crate) fn comparison(&self, comparison: Comparison) -> &[String] {
        let words = &self.grammar.comparisons;
        match comparison {
            Comparison::Less => &words.below,
            Comparison::LessOrEqual => &words.at_most,
            Comparison::Equal => &words.is,
            Comparison::GreaterOrEqual => &words.at_least,
            Comparison::Greater => &words.above,
        }
    }

    /// Returns the names of the unit of a function; the first one is said.
    pub(crate) fn units(&self, function: &Name) -> &[String] {
        self.units.get(function).map_or(&[], Vec::as_slice)
    }
}

/// All comparisons.
pub(crate) const COMPARISONS: [Comparison; 5] = [
    Comparison::GreaterOrEqual,
    Comparison::LessOrEqual,
    Comparison::Equal,
    Comparison::Less,
    Comparison::Greater,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_languages_say_the_same_symbols() {
        let symbols = |language| {
            let book = Phrasebook::standard(language);
            let said = book.phrases.iter().filter(|phrase| phrase.is_said);
            let mut said: Vec<_> = said
                .filter(|phrase| phrase.kind != PhraseKind::Negation)
                .map(|phrase| (phrase.symbol.clone(), phrase.kind, phrase.pattern.arity))
                .collect();
            said.sort();
            said
        };
        assert_eq!(symbols(Language::English), symbols(Language::German));
    }

    #[test]
    fn wrong_words_are_refused() {
        let own = |text: &str| -> OwnWords { toml::from_str(text).expect("TOML") };
        let add = |text: &str| Phrasebook::standard(Language::English).with_own(&own(text));
        let refused = |text: &str| add(text).expect_err("a mistake").to_string();
        assert_eq!(
            refused("[predicates]\nclean = { phrase = \"{1} swept and clean\" }"),
            "the words of `clean`: `and` joins conditions, and cannot be a word of the phrase here"
        );
        assert!(refused("[predicates]\nclean = { phrase = \"clean {2}\" }").contains("each once"));
        assert!(
            refused("[types]\nspot = { every = [], some = [\"a spot\"] }").contains("one form")
        );
        assert!(add("[predicates]\nclean = { phrase = \"{1} clean\" }").is_ok());
    }
}
