//! The built binary, run as a user runs it: arguments and files in, exit code and text out.
//!
//! All tests are in one binary, so that it is linked once.

mod sandbox;

mod plan;

mod validate;

mod check;

mod ecosystem;

mod mistakes;

mod interfaces;

mod engines;

mod screens;
