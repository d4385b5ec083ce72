//! Single lines of GPIO chips, through the kernel's character device: a contact that is watched, a
//! relay that is switched.
//!
//! - A line is named by its chip and number or by its own name ([`LineName`]). Which chip is which
//!   number changes with the order in which drivers came; its label and the names of lines do not.
//! - [`Board`] is what opens lines: this machine's [`Chips`], or in tests a [`Bench`].
//! - [`follow`] watches a line for as long as anybody listens, through unplugging and plugging in.
//! - [`Driven`] drives one; it begins with what the line is, so that nothing switches because a
//!   daemon was started again.

mod bench;
mod chips;
mod driven;
mod error;
mod follow;
mod name;

use std::pin::Pin;
use std::time::Duration;

use serde::Deserialize;

pub use bench::Bench;
pub use chips::Chips;
pub use driven::Driven;
pub use error::LineError;
pub use follow::{Followed, State, follow};
pub use name::{InvalidLineName, LineName};

/// A future that a line returns.
pub type BoxFuture<'l, T> = Pin<Box<dyn Future<Output = T> + Send + 'l>>;

/// What pulls a line where nothing drives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bias {
    /// Up: a contact between line and ground is open when it reads high.
    PullUp,
    /// Down.
    PullDown,
    /// Nothing: the circuit does it itself.
    None,
}

/// A line to be watched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// The line.
    pub line: LineName,
    /// Whether it is active when it is low.
    pub is_active_low: bool,
    /// What pulls it; as it is, if nobody says.
    pub bias: Option<Bias>,
    /// How long it must be still before it counts: contacts bounce.
    pub debounce: Option<Duration>,
}

/// A line to be driven.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    /// The line.
    pub line: LineName,
    /// Whether it is active when it is low.
    pub is_active_low: bool,
}

/// What opens lines. May wait for a bus, so it is for threads that may.
pub trait Board: Send + Sync + 'static {
    /// Opens a line to watch it, on a thread of a Tokio runtime.
    ///
    /// # Errors
    ///
    /// If it is not there, or not for us.
    fn input(&self, wanted: &Input) -> Result<Box<dyn InputLine>, LineError>;

    /// Opens a line to drive it, as what it is now.
    ///
    /// # Errors
    ///
    /// If it is not there, or not for us.
    fn output(&self, wanted: &Output) -> Result<Box<dyn OutputLine>, LineError>;
}

/// A line that is watched.
pub trait InputLine: Send + Sync + 'static {
    /// Whether it is active now.
    ///
    /// # Errors
    ///
    /// If its chip is gone.
    fn value(&self) -> Result<bool, LineError>;

    /// Waits for its next edges; what it was after each. May wait for as long as there are none,
    /// and nobody tells of edges where [`InputLine::tells_edges`] says so.
    fn edges(&self) -> BoxFuture<'_, Result<Vec<bool>, LineError>>;

    /// Whether its chip tells of edges. Behind a bus, some do not.
    fn tells_edges(&self) -> bool;
}

/// A line that is driven.
pub trait OutputLine: Send + 'static {
    /// Whether it is active now.
    ///
    /// # Errors
    ///
    /// If its chip is gone.
    fn value(&self) -> Result<bool, LineError>;

    /// Makes it active, or not.
    ///
    /// # Errors
    ///
    /// If its chip is gone.
    fn set(&self, is_active: bool) -> Result<(), LineError>;
}
