//! Adds to the text of an ecosystem file, and writes the text of a new one.
//!
//! - [`EcosystemText`] adds rooms, doors, agents and goals. It inserts text and changes nothing
//!   else: comments, order and line ends stay as they are.
//! - [`unified_difference`] shows an old and a new text as people read them.
//! - [`EditableFile`] replaces a file by a new text at once, unless the file has changed since it
//!   was read.
//! - [`EcosystemDraft`] is the plan of a new file, with comments for its readers; [`interview`]
//!   asks a person for it.
//!
//! Whether an ecosystem is consistent is decided by the checker of `althing`, to which each new
//! text is given before it is written. This crate rejects only what it could not write.

mod addition;
mod difference;
mod draft;
mod ecosystem_text;
mod edit_error;
mod editable_file;
mod insertion;
mod interview;
mod setting;
mod words;

#[cfg(test)]
mod tests;

pub use addition::{AgentAddition, DoorAddition, EcosystemAddition, GoalAddition, RoomAddition};
pub use difference::unified_difference;
pub use draft::{DeviceOffer, EcosystemDraft};
pub use ecosystem_text::EcosystemText;
pub use edit_error::EditError;
pub use editable_file::{EditableFile, FileEditError};
pub use interview::{Respondent, interview};
pub use setting::SettingText;
pub use words::{DoorWords, GoalWords, PlaceOptions, RobotWords, SensorWords, as_name, meters};
