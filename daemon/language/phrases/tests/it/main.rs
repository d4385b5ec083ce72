//! Tests of the crate `phrases` from outside.

mod mistakes;
mod properties;
mod texts;
