//! Tests of the crate `phrases` from outside.

mod mistakes;
mod properties;
mod suggestions;
mod texts;
mod words_check;
