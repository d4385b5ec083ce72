//! Tests that the code keeps the promises of ARCHITECTURE.md. Each promise is an absence, which is
//! searched for here.
//!
//! - `documents`: source files that documents name exist.
//! - `durations`: each duration has a name and a reason.
//! - `folders`: in which folder each crate stands.
//! - `layers`: which crate may depend on which, according to `cargo metadata`.
//! - `purity`: what the pure crates and the production source must not contain.
//! - `length`: no function longer than 70 lines, except for known ones.
//! - `modules`: which modules of one crate import each other in a circle, each with its reason.
//! - `source`: a minimal reader of Rust source for the above, with its own tests.
//! - `transitions`: the tables of transitions in `docs/goals.md`.
//!
//! A new crate of the workspace needs a line in `layers::LAYERS` and a place in the table
//! “Folders”. A new exception needs a reason; an exception that is no longer needed fails as well.

#[path = "architecture/documents.rs"]
mod documents;
#[path = "architecture/durations.rs"]
mod durations;
#[path = "architecture/folders.rs"]
mod folders;
#[path = "architecture/layers.rs"]
mod layers;
#[path = "architecture/length.rs"]
mod length;
#[path = "architecture/modules.rs"]
mod modules;
#[path = "architecture/purity.rs"]
mod purity;
#[path = "architecture/source.rs"]
mod source;
#[path = "architecture/transitions.rs"]
mod transitions;
#[path = "architecture/wording.rs"]
mod wording;

use std::path::PathBuf;

/// Returns the workspace's folder.
fn root() -> PathBuf {
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("invariant: `tests` is a folder of the workspace").to_owned()
}

/// Fails with all complaints at once, one per line.
#[track_caller]
fn none(complaints: &[String], promise: &str) {
    assert!(
        complaints.is_empty(),
        "{promise}; see ARCHITECTURE.md:\n  {}\n",
        complaints.join("\n  ")
    );
}
