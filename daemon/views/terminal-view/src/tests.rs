//! Tests of the whole screen: snapshots of every page, and every key on every page.

mod every_key;
mod sample;
mod snapshots;
