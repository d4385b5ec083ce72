//! Any bytes, read as a domain, a zero and a problem: planning ends within its limits, and every plan
//! is one.
//!
//! `cargo +nightly fuzz run plan -- -timeout=10` in this folder. A good start are the texts of
//! `../benches`, a domain and its problem to a file, with a zero between them.

#![no_main]

#[path = "../answer.rs"]
mod answer;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    answer::answer(bytes);
});
