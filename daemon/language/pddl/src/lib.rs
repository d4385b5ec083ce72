//! PDDL, the language of facts, goals, models and plans: parsing, checking and printing.
//!
//! - [`tree`] defines the syntax tree. Start reading there.
//! - [`parse`] converts a text to a tree: `lexer` → `parentheses` → `sexpr` → `grammar`.
//! - `printer` converts a tree to a text: it implements `Display` for every tree type.
//! - `arithmetic` computes the values of [`Operator`], [`Comparison`] and [`Assignment`].
//! - [`check`] finds semantic mistakes in a tree, with the help of [`types`], the type hierarchy.
//! - [`diagnostic`] defines the data type of the mistakes that these modules report.
//!
//! Other crates use the trees: `planner` grounds and searches, `capability` composes several models
//! into one domain, and the binary displays diagnostics.
//!
//! **Invariants:** This crate reads no clock, file or environment variable. Parsing any text ends
//! with a value and a list of diagnostics, and never with a panic. A returned tree is nested no
//! deeper than [`NESTING_MAX`], so that recursion over it is safe on any thread.

pub mod tree;

pub mod parse;

pub mod check;

pub mod types;

pub mod diagnostic;

pub mod graph;

pub mod knowledge;

pub mod factored;

mod arithmetic;
mod characters;
mod grammar;
mod lexer;
mod nearest;
mod parentheses;
mod parts;
mod printer;
mod sexpr;
mod times;

pub use arithmetic::{add_rounding_losses, rounding_losses};
pub use check::{
    check_action_model, check_condition, check_domain, check_init_elements, check_map,
    check_metric_values, check_plan, check_problem,
};
pub use diagnostic::{Diagnostic, Note, Parsed, Severity, line_column};
pub use nearest::nearest;
pub use parentheses::NESTING_MAX;
pub use parse::{
    parse_action_model, parse_condition, parse_document, parse_domain, parse_init_element,
    parse_init_elements, parse_metric, parse_plan, parse_problem, parse_step, states_goal,
    text_from_bytes,
};
pub use tree::*;
pub use types::Types;
