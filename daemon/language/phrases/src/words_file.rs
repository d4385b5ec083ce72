//! The content of a words file: the phrases of predicates and functions, the words of types, and the
//! grammar.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;

/// The words of one language that an ecosystem adds, or says in another way.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct OwnWords {
    /// The phrases of predicates.
    pub(crate) predicates: BTreeMap<String, PredicateWords>,
    /// The phrases of functions.
    pub(crate) functions: BTreeMap<String, FunctionWords>,
    /// The words of types.
    pub(crate) types: BTreeMap<String, TypeWords>,
}

/// A whole words file of this crate.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct WordsFile {
    pub(crate) grammar: Grammar,
    #[serde(default)]
    pub(crate) predicates: BTreeMap<String, PredicateWords>,
    #[serde(default)]
    pub(crate) functions: BTreeMap<String, FunctionWords>,
    #[serde(default)]
    pub(crate) types: BTreeMap<String, TypeWords>,
}

/// The words of a predicate.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct PredicateWords {
    /// The phrase by which the predicate is said.
    pub(crate) phrase: String,
    /// The phrase by which its negation is said; `None` if that is `not` and the phrase.
    #[serde(default)]
    pub(crate) negated: Option<String>,
    /// Further phrases that are read and not said.
    #[serde(default)]
    pub(crate) also: Vec<String>,
}

/// The words of a function.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct FunctionWords {
    /// The phrase by which the function is said.
    pub(crate) phrase: String,
    /// The unit of its values; empty if they have none.
    #[serde(default)]
    pub(crate) unit: String,
    /// Further names of the unit that are read and not said.
    #[serde(default)]
    pub(crate) units: Vec<String>,
    /// Further phrases that are read and not said.
    #[serde(default)]
    pub(crate) also: Vec<String>,
}

/// The words of a type: `every room`, by case where the language has cases.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct TypeWords {
    /// “Every” of the type, in the nominative, the accusative and the dative.
    pub(crate) every: Vec<String>,
    /// “Some” of the type, in the same cases.
    pub(crate) some: Vec<String>,
    /// Further words for “every” that are read and not said, such as the plural.
    #[serde(default)]
    pub(crate) all: Vec<String>,
}

/// The words of a language that belong to no predicate. Of several words for one meaning, the first
/// is said.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Grammar {
    pub(crate) and: Vec<String>,
    pub(crate) or: Vec<String>,
    pub(crate) not: Vec<String>,
    #[serde(rename = "if")]
    pub(crate) when: Vec<String>,
    pub(crate) then: Vec<String>,
    /// Introduces a quantifier before a whole condition: `for every room r: …`.
    #[serde(rename = "for")]
    pub(crate) before_quantifier: Vec<String>,
    /// Says that two objects are one.
    pub(crate) same: String,
    /// Says that a fact is unknown; the fact follows.
    pub(crate) unknown: String,
    /// The mark between the integer part of a number and its fraction.
    pub(crate) decimal: char,
    /// The words of a type that has none of its own; `{type}` stands for its name.
    pub(crate) types: TypeWords,
    pub(crate) comparisons: ComparisonWords,
}

/// The words of comparisons of numbers.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct ComparisonWords {
    pub(crate) below: Vec<String>,
    pub(crate) at_most: Vec<String>,
    pub(crate) is: Vec<String>,
    pub(crate) at_least: Vec<String>,
    pub(crate) above: Vec<String>,
}

/// The reason why the words of an ecosystem cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WordsError {
    /// The predicate, function or type whose words are wrong.
    pub symbol: String,
    /// The reason.
    pub why: String,
}

impl fmt::Display for WordsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the words of `{}`: {}", self.symbol, self.why)
    }
}

impl std::error::Error for WordsError {}
