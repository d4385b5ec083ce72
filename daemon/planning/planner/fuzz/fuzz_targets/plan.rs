//! Fuzz target: any bytes, read as a domain, a zero byte and a problem. Planning must end within
//! its limits, and every plan must be valid.
//!
//! Run `cargo +nightly fuzz run plan -- -timeout=10` in this folder. The texts in `../benches` are
//! good seeds: one file per task, with a domain, a zero byte and a problem.

#![no_main]

#[path = "../answer.rs"]
mod answer;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    answer::answer(bytes);
});
