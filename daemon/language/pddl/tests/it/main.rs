//! Tests of the behaviour of the crate as data: texts and their results.

mod factored;
mod reading;

mod mistakes;

mod meaning;

mod kinds;
mod layout;

mod beginners;
mod generate;

mod properties;

mod nesting;
