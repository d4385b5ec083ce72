//! PDDL, the language of facts, goals, models and plans: text in, tree out, and back.
//!
//! - [`tree`] defines the syntax tree. Start reading there.
//! - [`parse`] makes a tree from a text: `lexer` → `parentheses` → `sexpr` → `grammar`.
//! - `printer` makes a text from a tree: it implements `Display` for every tree type.
//! - `arithmetic` computes the values of [`Operator`], [`Comparison`] and [`Assignment`].
//! - [`check`] checks whether a tree makes sense, with the help of [`types`], the type hierarchy.
//! - [`diagnostic`] defines the form in which all these modules report mistakes.
//!
//! Other crates do the rest: `planner` grounds and searches, `capability` composes several models into
//! one domain, and the binary draws diagnostics in color.
//!
//! **Invariants:** nothing here reads a clock, a file or the environment. Whatever the text, parsing
//! ends with a value and a list of diagnostics, never with a panic; and what it returns is nested no
//! deeper than [`NESTING_MAX`], so that recursion over a tree is safe on any thread.

pub mod tree;

pub mod parse;

pub mod check;

pub mod types;

pub mod diagnostic;

pub mod graph;

pub mod knowledge;

mod arithmetic;
mod grammar;
mod lexer;
mod nearest;
mod parentheses;
mod parts;
mod printer;
mod sexpr;
mod times;

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
