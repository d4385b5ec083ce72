//! Single lines of GPIO chips, through the kernel's character device: inputs such as a contact, and
//! outputs such as a relay.
//!
//! - A line is identified by its chip and number, or by its own name ([`LineName`]). The number of
//!   a chip depends on the order in which drivers were loaded; the label of a chip and the names of
//!   lines are constant.
//! - [`GpioBoard`] opens lines: a board is this machine's [`GpioChips`], or a [`MemoryBoard`] in
//!   tests.
//! - [`watch_line`] watches an input line until the watch is dropped, including while the chip of
//!   the line is unplugged and plugged in again.
//! - [`DrivenOutput`] drives an output line. It begins with the current value of the line, so that
//!   the restart of a daemon switches nothing.

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

/// A future that a method of a line returns.
pub type BoxFuture<'l, T> = Pin<Box<dyn Future<Output = T> + Send + 'l>>;

/// Bias of a line: the level to which the chip pulls the line when nothing drives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bias {
    /// Pulls the line up: a contact between the line and ground is open if the line reads high.
    PullUp,
    /// Pulls the line down: a contact between the line and the supply is open if the line reads
    /// low.
    PullDown,
    /// Does not pull the line, because the circuit pulls the line itself.
    None,
}

/// Settings for watching an input line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputSettings {
    /// Name of the input line.
    pub line: LineName,
    /// Whether the line counts as active when its level is low.
    pub is_active_low: bool,
    /// Bias of the line; `None` keeps the present bias.
    pub bias: Option<Bias>,
    /// Time for which the line must be stable before an edge counts, because contacts bounce.
    /// `None` means that every edge counts.
    pub debounce: Option<Duration>,
}

/// Settings for driving an output line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputSettings {
    /// Name of the output line.
    pub line: LineName,
    /// Whether the line counts as active when its level is low.
    pub is_active_low: bool,
}

/// A board that opens lines. The methods may block on a bus; they must be called on a thread that
/// may block.
pub trait GpioBoard: Send + Sync + 'static {
    /// Opens a line as an input, on a thread of a Tokio runtime.
    ///
    /// # Errors
    ///
    /// Returns an error if the line does not exist, or this process may not use it.
    fn input(&self, wanted: &InputSettings) -> Result<Box<dyn InputLine>, LineError>;

    /// Opens a line as an output, and keeps its current value.
    ///
    /// # Errors
    ///
    /// Returns an error if the line does not exist, or this process may not use it.
    fn output(&self, wanted: &OutputSettings) -> Result<Box<dyn OutputLine>, LineError>;
}

/// An open input line.
pub trait InputLine: Send + Sync + 'static {
    /// Returns `true` if the line is active at present.
    ///
    /// # Errors
    ///
    /// Returns an error if the line's chip is gone.
    fn value(&self) -> Result<bool, LineError>;

    /// Waits for the next edges of the line. Returns the state of the line after each edge: `true`
    /// if the line was active. Waits forever if [`InputLine::reports_edges`] is `false`.
    fn edges(&self) -> BoxFuture<'_, Result<Vec<bool>, LineError>>;

    /// Whether the line's chip reports edges. Some chips behind a bus do not.
    fn reports_edges(&self) -> bool;
}

/// An open output line.
pub trait OutputLine: Send + 'static {
    /// Returns `true` if the line is active at present.
    ///
    /// # Errors
    ///
    /// Returns an error if the line's chip is gone.
    fn value(&self) -> Result<bool, LineError>;

    /// Makes the line active or inactive.
    ///
    /// # Errors
    ///
    /// Returns an error if the line's chip is gone.
    fn set(&self, is_active: bool) -> Result<(), LineError>;
}
