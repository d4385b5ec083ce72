//! Input and output of the command line programs.
//!
//! - Input: command lines ([`arguments`]), PDDL files ([`pddl_files`]) and folders of them
//!   ([`pddl_tree`]), or of agents ([`factored_folder`]). [`domain_search`] finds the domain of a
//!   problem, [`mod@form_error`] parses the error messages of serde.
//! - Output: diagnostics are collected in a [`report`] and drawn by [`render`]; everything is
//!   written to one of two streams ([`output`]), with colors ([`styled`]) and with control
//!   characters from outside made [`visible`].
//! - End of the process: the process ends with a code of [`exit`], and at the latest when it
//!   reaches its [`limits`].

pub mod arguments;
pub mod domain_search;
pub mod exit;
pub mod factored_folder;
pub mod form_error;
mod formatting;
pub mod limits;
pub mod output;
mod pddl_cures;
pub mod pddl_files;
pub mod pddl_tree;
pub mod render;
pub mod report;
pub mod styled;
pub mod visible;
