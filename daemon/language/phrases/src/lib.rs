//! Goals and facts in words: a controlled language that says PDDL and is read back to the same PDDL.
//!
//! - [`Phrasebook`] has the words of one language: a phrase for each predicate and function. Start
//!   reading there. The words stand in files (`words/en.toml`, `words/de.toml`); an ecosystem adds
//!   its own ([`OwnWords`]).
//! - `reading` converts a text to a goal, `saying` converts a goal to a text. A goal that has no
//!   words is said in PDDL, and PDDL in parentheses is read anywhere in a text.
//! - [`KnownNames`] are the objects that texts may name. [`NotUnderstood`] says at which word a text
//!   is not understood, and gives the nearest text that is.
//!
//! **Invariants:** This crate reads no clock, file or environment variable. Reading any text ends
//! with a goal or a [`NotUnderstood`], and never with a panic. `Phrasebook::read` of
//! `Phrasebook::print` of a goal is that goal.

mod alignment;
mod completion;
mod default_name;
mod known_names;
mod language;
mod likeness;
mod nearest;
mod not_understood;
mod numbers;
mod pattern;
mod phrasebook;
mod quantifiers;
mod reading;
mod refusals;
mod saying;
mod sentences;
mod token;
mod words_check;
mod words_file;

pub use known_names::KnownNames;
pub use language::Language;
pub use not_understood::NotUnderstood;
pub use phrasebook::Phrasebook;
pub use words_check::{WordsMistake, key_mistakes};
pub use words_file::{OwnWords, WordsError};
