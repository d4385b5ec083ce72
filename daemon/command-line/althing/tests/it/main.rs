//! The built binary, run as a user runs it: arguments and files in, exit code and text out.
//!
//! All tests are in one binary, so that it is linked once.

mod rooms;
mod sandbox;

mod plan;

mod validate;

mod check;

mod building_checks;

mod caretakers;

mod ecosystem;

mod further_mistakes;

mod home_mistakes;
mod robot_mistakes;

mod mistakes;

mod model_mistakes;

mod interfaces;

mod people;

mod engines;

mod screens;
