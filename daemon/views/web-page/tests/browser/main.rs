//! The pages in a real browser: Debian's Chromium, against a made-up ecosystem.

#[path = "../../../../../tests/support/left_out.rs"]
mod left_out;
#[path = "../../examples/made_up/mod.rs"]
mod made_up;

mod accessibility;
mod acting;
mod chromium;
mod hostile;
mod keyboard;
mod languages;
mod living;
mod media;
mod screens;
mod site;
