//! Single lines of GPIO chips, through the kernel's character device: inputs such as a contact, and outputs
//! such as a relay.
//!
//! - A line is identified by its chip and number, or by its own name ([`LineName`]). The number of a chip
//!   changes with the order in which drivers were loaded; its label and the names of lines do not.
//! - [`GpioBoard`] opens lines: it is this machine's [`GpioChips`], or a [`MemoryBoard`] in tests.
//! - [`watch_line`] watches an input until the watch is dropped, also while its chip is unplugged and plugged
//!   in.
//! - [`DrivenOutput`] drives an output. It begins with the current value, so nothing switches when a daemon is
//!   restarted.

mod chips;
mod driven_output;
mod error;
mod line_watch;
mod memory_board;
mod name;

use std::pin::Pin;
use std::time::Duration;

use serde::Deserialize;

pub use chips::GpioChips;
pub use driven_output::DrivenOutput;
pub use error::LineError;
pub use line_watch::{LineState, LineWatch, watch_line};
pub use memory_board::MemoryBoard;
pub use name::{InvalidLineName, LineName};

/// A future that a line returns.
pub type BoxFuture<'l, T> = Pin<Box<dyn Future<Output = T> + Send + 'l>>;

/// Bias of a line that nothing drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bias {
    /// Pulled up: a contact between line and ground is open if the line reads high.
    PullUp,
    /// Pulled down.
    PullDown,
    /// No bias: the circuit pulls the line itself.
    None,
}

/// Input line to be watched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputSettings {
    /// The line.
    pub line: LineName,
    /// Whether the line is active when it is low.
    pub is_active_low: bool,
    /// Bias; `None` leaves it as it is.
    pub bias: Option<Bias>,
    /// Time that the line must be stable before an edge counts, because contacts bounce.
    pub debounce: Option<Duration>,
}

/// Output line to be driven.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputSettings {
    /// The line.
    pub line: LineName,
    /// Whether the line is active when it is low.
    pub is_active_low: bool,
}

/// Opens lines. Its methods may block on a bus, so call them on a thread that may block.
pub trait GpioBoard: Send + Sync + 'static {
    /// Opens a line as an input, on a thread of a Tokio runtime.
    ///
    /// # Errors
    ///
    /// Returns an error if the line does not exist, or this process may not use it.
    fn input(&self, wanted: &InputSettings) -> Result<Box<dyn InputLine>, LineError>;

    /// Opens a line as an output, with its current value.
    ///
    /// # Errors
    ///
    /// Returns an error if the line does not exist, or this process may not use it.
    fn output(&self, wanted: &OutputSettings) -> Result<Box<dyn OutputLine>, LineError>;
}

/// Input line that is open.
pub trait InputLine: Send + Sync + 'static {
    /// Returns whether the line is active now.
    ///
    /// # Errors
    ///
    /// Returns an error if its chip is gone.
    fn value(&self) -> Result<bool, LineError>;

    /// Waits for the next edges, and returns whether the line was active after each. Waits as long as there
    /// are none; without end if [`InputLine::reports_edges`] is `false`.
    fn edges(&self) -> BoxFuture<'_, Result<Vec<bool>, LineError>>;

    /// Whether the chip reports edges. Some chips behind a bus do not.
    fn reports_edges(&self) -> bool;
}

/// Output line that is open.
pub trait OutputLine: Send + 'static {
    /// Returns whether the line is active now.
    ///
    /// # Errors
    ///
    /// Returns an error if its chip is gone.
    fn value(&self) -> Result<bool, LineError>;

    /// Makes the line active or inactive.
    ///
    /// # Errors
    ///
    /// Returns an error if its chip is gone.
    fn set(&self, is_active: bool) -> Result<(), LineError>;
}
