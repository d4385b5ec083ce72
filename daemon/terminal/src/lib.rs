//! What a person at a terminal gives and sees, whichever program they have called.
//!
//! In: [`arguments`], [`pddl_files`] and whole folders of them, [`pddl_tree`]. Out: mistakes are gathered in a [`report`] and drawn by
//! [`render`], everything goes to one of two streams ([`output`]), and the process ends with a code
//! of [`exit`]. What serde says of a file is taken apart by [`mod@form`]. What comes from outside is made [`visible`]; what we paint is [`styled`].

pub mod arguments;
pub mod beside;
pub mod deadline;
pub mod exit;
pub mod form;
pub mod output;
pub mod pddl_files;
pub mod pddl_tree;
pub mod render;
pub mod report;
pub mod styled;
pub mod visible;
