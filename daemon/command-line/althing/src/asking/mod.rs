//! What people ask of an ecosystem, and the answers as data. Commands print them, and the web page
//! of a daemon shows them.

pub(crate) mod dry_run;
pub(crate) mod goal_numbers;
pub(crate) mod history_reader;
pub(crate) mod known_names;
pub(crate) mod questions;
pub(crate) mod stops;
pub(crate) mod wishes;
