//! PDDL, the language of facts, goals, models and plans: text in, tree out, and back.
//!
//! Start reading at [`tree`].

pub mod tree;

pub use tree::*;
