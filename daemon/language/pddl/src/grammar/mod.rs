//! The grammar: converts the tree of parentheses to the syntax tree, with one function for each
//! production.
//!
//! - The documentation of each function contains its production. `NAME` is a symbol, `VARIABLE` is
//!   `?NAME`, `X*` is any number of `X`, `[X]` is an optional `X`.
//! - A function that finds a mistake reports it and returns `None`; its caller continues.
//! - The grammar does not check whether a name is declared (is `conected` a predicate?); `check`
//!   does.

mod names;

mod declarations;

mod condition;

mod expression;

mod effect;

mod action;

mod durative;

mod facts;

mod definition;

mod domain;

mod problem;

mod model;

mod plan;

mod reader;

pub(crate) use condition::condition;
pub(crate) use definition::{DocumentKind, document, single};
pub(crate) use facts::{init_element, init_elements};
pub(crate) use plan::{plan_cost, plan_step, plan_steps};
pub(crate) use problem::metric_section;
pub(crate) use reader::GrammarReader;
