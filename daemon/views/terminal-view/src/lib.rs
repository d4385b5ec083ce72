//! Draws the pages of a live view into a terminal, and turns keys into acts.
//!
//! - [`ViewScreen`] is the whole screen: it draws into a frame of Ratatui, takes keys, the mouse and
//!   pasted texts, and returns [`ViewAct`]s that only its command can do.
//! - [`PageData`] is what a page shows, also for programs. [`page_text`] says a page in sentences,
//!   [`picture`] draws it as SVG.
//! - One table of keys (`keys/bindings.rs`) makes the handling, the help and the table of docs/view.md.
//!
//! **Invariants:** This crate has no terminal, no clock and no effect. Every text from outside is
//! made visible before it is drawn (`text.rs`); no meaning is said by a color alone (`tone.rs`).

mod dialog;
mod floor_canvas;
mod input;
mod keys;
mod page;
mod page_data;
mod page_text;
mod pages;
mod picture;
mod reading;
mod screen;
mod sequence;
mod sheet;
mod styled_line;
mod table;
mod text;
mod text_field;
mod time_bar;
mod time_words;
mod tone;
mod visit;

#[cfg(test)]
mod tests;

pub use input::{
    MouseDeed, MouseInput, RecordingSpan, ScreenOptions, TextInWords, ViewAct, ViewInput,
};
pub use keys::{KeyPress, NamedKey, key_tables};
pub use page::{PageAt, PageName, UnknownPage};
pub use page_data::{OverviewData, PageData};
pub use page_text::page_text;
pub use picture::{PictureOptions, picture};
pub use screen::ViewScreen;
