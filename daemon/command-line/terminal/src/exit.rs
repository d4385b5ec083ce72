//! Exit codes of the process. The codes are an interface: scripts, service units and planner
//! benchmarks depend on them.
//!
//! Codes below 64 are those of other planners (Fast Downward's table); codes from 64 on are those
//! of `sysexits.h`, which service managers interpret. The codes for the end of a search (10, 11,
//! 12; 32 for a defect of the planner) are defined in `planner`.

use std::process::ExitCode;

/// Success. For `plan`: a plan was found.
pub const DONE: u8 = 0;
/// Exit code of `validate`: the plan is not valid. Other validators use the same code.
pub const INVALID_PLAN: u8 = 1;
/// Exit code of `plan --optimal`: a plan was found, and memory ran out before it was proven to be
/// the cheapest.
pub const UNPROVEN_OUT_OF_MEMORY: u8 = 1;
/// Exit code of `plan --optimal`: a plan was found, and time ran out before it was proven to be the
/// cheapest.
pub const UNPROVEN_OUT_OF_TIME: u8 = 2;
/// Exit code of `plan --optimal`: a plan was found, but is not proven to be the cheapest, for a
/// reason other than time or memory.
pub const UNPROVEN: u8 = 4;
/// Exit code of `plan`: memory ran out before a plan was found.
pub const OUT_OF_MEMORY: u8 = 22;
/// Exit code of `plan`: time ran out before a plan was found.
pub const OUT_OF_TIME: u8 = 23;
/// A file that the user has given cannot be read, or has errors.
pub const BAD_INPUT: u8 = 33;
/// The input is valid, but uses a feature that this version does not support.
pub const UNSUPPORTED: u8 = 34;
/// `EX_USAGE`: the command line is wrong. Clap's code 2 is not used, because for a planner it means
/// “a plan was found, then time ran out”.
pub const USAGE: u8 = 64;
/// `EX_UNAVAILABLE`: a required part is not available, such as an engine that is not installed, or
/// a substrate that cannot be reached.
pub const UNAVAILABLE: u8 = 69;
/// `EX_IOERR`: a result could not be written.
pub const OUTPUT: u8 = 74;
/// `EX_NOPERM`: the user did not grant a permission that the command needs.
pub const NOT_ALLOWED: u8 = 77;
/// `EX_CONFIG`: the configuration is wrong, so a service manager need not start the process again.
pub const CONFIG: u8 = 78;

/// Returns the exit code of a process that a signal ended, as a shell gives it: 130 for SIGINT, 143
/// for SIGTERM.
pub fn by_signal(signal: i32) -> ExitCode {
    u8::try_from(128 + signal).map_or_else(|_| with(UNAVAILABLE), with)
}

/// Converts a code to an [`ExitCode`] of the process.
pub fn with(code: u8) -> ExitCode {
    ExitCode::from(code)
}
