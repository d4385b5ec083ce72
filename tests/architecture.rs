//! Executes ARCHITECTURE.md: what the map promises as an absence is looked for here.
//!
//! - `layers`: which crate may know which, asked of `cargo metadata`.
//! - `purity`: what the pure crates and the production source do not contain.
//! - `length`: no function past 70 lines that is not known already.
//! - `source`: reads Rust just well enough for the above, and is tested itself.
//!
//! Adding a crate to the workspace needs a line in `layers::LAYERS`; adding an exception needs a
//! reason, and an exception that nothing needs any more fails as well.

#[path = "architecture/layers.rs"]
mod layers;
#[path = "architecture/length.rs"]
mod length;
#[path = "architecture/purity.rs"]
mod purity;
#[path = "architecture/source.rs"]
mod source;

use std::path::PathBuf;

/// The workspace's folder.
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
