//! A page in sentences: for scripts, and for screens that are read aloud. It has no drawing, and no
//! columns that have to be seen to be understood.

use live_view::Moment;

use crate::input::ScreenOptions;
use crate::page_data::PageData;
use crate::pages::{self, PageContext};
use crate::text;

/// Cells for which a page is made before it is said: no column is left out.
const WIDE: usize = 2_000;

/// Returns a page as sentences, one thing on a line. Lines are broken at `columns` cells; 0 breaks
/// none. Of the options, the color has no meaning.
pub fn page_text(data: &PageData, columns: usize, options: ScreenOptions, now: Moment) -> String {
    let context = PageContext {
        columns: WIDE,
        rows: usize::MAX,
        now,
        utc_offset: options.utc_offset_seconds,
        is_recording: options.recording.is_some(),
        filter: String::new(),
        words: options.words,
    };
    let sheet = pages::sheet(data, &context);
    let mut text = String::new();
    for sentence in sheet.sentences() {
        let lines = if columns == 0 { vec![sentence] } else { text::wrap(&sentence, columns) };
        for line in lines {
            text.push_str(line.trim_end());
            text.push('\n');
        }
    }
    text
}
