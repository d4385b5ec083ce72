//! Fuzz target: any bytes, read as a domain, a zero byte and a problem. Planning must end within its
//! limits, and every plan must be valid.
//!
//! Run `cargo +nightly fuzz run plan -- -timeout=10` in this folder. The texts of `../benches` are good
//! seeds: a domain and its problem per file, with a zero byte between them.

#![no_main]

#[path = "../answer.rs"]
mod answer;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    answer::answer(bytes);
});
