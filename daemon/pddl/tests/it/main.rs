//! What the crate promises, as data: texts, and what becomes of them.

mod reading;

mod mistakes;

mod meaning;

mod kinds;
mod layout;

mod generate;

mod properties;

mod nesting;
