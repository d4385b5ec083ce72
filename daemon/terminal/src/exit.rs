//! What the process ends with. Exit codes are an interface: scripts, units and planner benchmarks
//! match on them.
//!
//! Below 64 they are those of the field's planners (Fast Downward's table); from 64 on those of
//! `sysexits.h`, which service managers know. Those of a search's end (10, 11, 12; 32 for a defect of
//! the planner) are `planner`'s own.

use std::process::ExitCode;

/// Done; of `plan`, a plan was found.
pub const DONE: u8 = 0;
/// `validate`: the plan does not work. Validators of the field say it so.
pub const INVALID_PLAN: u8 = 1;
/// `plan --optimal`: a plan was found, and memory ran out before it was proven to be the cheapest.
pub const UNPROVEN_OUT_OF_MEMORY: u8 = 1;
/// `plan --optimal`: a plan was found, and time ran out before it was proven to be the cheapest.
pub const UNPROVEN_OUT_OF_TIME: u8 = 2;
/// `plan --optimal`: a plan was found, and for another reason is not proven to be the cheapest.
pub const UNPROVEN: u8 = 4;
/// `plan`: out of memory.
pub const OUT_OF_MEMORY: u8 = 22;
/// `plan`: out of time.
pub const OUT_OF_TIME: u8 = 23;
/// A file of the user's cannot be read, or has mistakes.
pub const BAD_INPUT: u8 = 33;
/// Understood, and not something this version does.
pub const UNSUPPORTED: u8 = 34;
/// `EX_USAGE`: the command line is wrong. Not clap's 2, which for a planner means “a plan was found,
/// then time ran out”.
pub const USAGE: u8 = 64;
/// `EX_UNAVAILABLE`: what was asked for is not here: a command not built yet, a substrate that
/// cannot be reached.
pub const UNAVAILABLE: u8 = 69;
/// `EX_IOERR`: a result could not be written.
pub const OUTPUT: u8 = 74;
/// `EX_NOPERM`: nobody has allowed what is needed for it.
pub const NOT_ALLOWED: u8 = 77;
/// `EX_CONFIG`: the configuration is wrong; a service manager need not try again.
pub const CONFIG: u8 = 78;

/// Ended by the signal of that number, as a shell says it: 130 for SIGINT, 143 for SIGTERM.
pub fn by_signal(signal: i32) -> ExitCode {
    u8::try_from(128 + signal).map_or_else(|_| with(UNAVAILABLE), with)
}

/// The process's own form of a code.
pub fn with(code: u8) -> ExitCode {
    ExitCode::from(code)
}
