//! A page as a picture: SVG with the text of a terminal, for documents.

use std::fmt::Write as _;

use live_view::{LiveView, Moment};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::{Buffer, Cell};
use ratatui::style::{Color, Modifier};

use crate::input::ScreenOptions;
use crate::page::PageAt;
use crate::screen::ViewScreen;
use crate::text;

/// Size of a cell, in units of the picture.
const CELL_WIDTH: f32 = 8.4;
const CELL_HEIGHT: f32 = 18.0;

/// Space around the text.
const MARGIN: f32 = 12.0;

/// Colors of the picture.
const PAPER: &str = "#16181d";
const INK: &str = "#d7dae0";

/// Most columns and rows of a picture.
const SIZE_MAX: u16 = 500;

/// How a picture is made.
#[derive(Clone, Copy, Debug)]
pub struct PictureOptions {
    /// Columns of the terminal.
    pub columns: u16,
    /// Rows of the terminal.
    pub rows: u16,
    /// How the screen is set up.
    pub screen: ScreenOptions,
}

/// Returns a page of a view as SVG.
pub fn picture(view: &LiveView, at: &PageAt, now: Moment, options: PictureOptions) -> String {
    let columns = options.columns.clamp(1, SIZE_MAX);
    let rows = options.rows.clamp(1, SIZE_MAX);
    let mut screen = ViewScreen::new(options.screen).without_selection();
    screen.open(at.clone());
    // Nothing can go wrong in memory.
    let Ok(mut terminal) = Terminal::new(TestBackend::new(columns, rows));
    let Ok(_) = terminal.draw(|frame| screen.draw(frame, view, now));
    svg(terminal.backend().buffer())
}

/// Returns the cells of a terminal as SVG.
fn svg(buffer: &Buffer) -> String {
    let area = buffer.area;
    let width = f32::from(area.width) * CELL_WIDTH + 2.0 * MARGIN;
    let height = f32::from(area.height) * CELL_HEIGHT + 2.0 * MARGIN;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.1} {height:.1}\" \
         font-family=\"ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace\" \
         font-size=\"14\">\n<rect width=\"100%\" height=\"100%\" rx=\"8\" fill=\"{PAPER}\"/>\n"
    );
    for row in area.top()..area.bottom() {
        let cells: Vec<_> = (area.left()..area.right()).map(|x| &buffer[(x, row)]).collect();
        let mut column = 0;
        for run in cells.chunk_by(|one, other| look(one) == look(other)) {
            draw_run(&mut svg, run, column, row);
            column += run.len();
        }
    }
    svg.push_str("</svg>\n");
    svg
}

/// Draws cells of one look.
fn draw_run(svg: &mut String, run: &[&Cell], column: usize, row: u16) {
    let Some(first) = run.first() else { return };
    let (ink, paper, is_bold) = look(first);
    let at = |column: usize| f32::from(u16::try_from(column).unwrap_or(u16::MAX)) * CELL_WIDTH;
    let x = MARGIN + at(column);
    let top = MARGIN + f32::from(row) * CELL_HEIGHT;
    if paper != PAPER {
        let width = at(run.len());
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{CELL_HEIGHT:.1}\" \
             fill=\"{paper}\"/>"
        );
    }
    let mut words = String::new();
    let mut skipped = 0;
    for cell in run {
        // A wide character is followed by an empty cell.
        if skipped > 0 {
            skipped -= 1;
            continue;
        }
        words.push_str(cell.symbol());
        skipped = text::width(cell.symbol()).saturating_sub(1);
    }
    if words.trim().is_empty() {
        return;
    }
    let weight = if is_bold { " font-weight=\"bold\"" } else { "" };
    let (length, baseline) = (at(run.len()), top + CELL_HEIGHT * 0.75);
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{baseline:.1}\" fill=\"{ink}\"{weight} textLength=\"{length:.1}\" \
         xml:space=\"preserve\">{}</text>",
        escaped(&words)
    );
}

/// Returns the ink, the paper and the weight of a cell.
fn look(cell: &Cell) -> (&'static str, &'static str, bool) {
    let ink = color(cell.fg, INK);
    let paper = color(cell.bg, PAPER);
    let is_bold = cell.modifier.contains(Modifier::BOLD);
    if cell.modifier.contains(Modifier::REVERSED) {
        (PAPER, ink, is_bold)
    } else {
        (ink, paper, is_bold)
    }
}

fn color(color: Color, otherwise: &'static str) -> &'static str {
    match color {
        Color::DarkGray => "#8a919e",
        Color::Cyan => "#56b6c2",
        Color::Green => "#8cc570",
        Color::Blue => "#61afef",
        Color::Yellow => "#e0b45c",
        Color::Red => "#ec6a75",
        Color::White => "#ffffff",
        _ => otherwise,
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;

    #[test]
    fn cells_become_text_of_their_color() {
        let mut buffer = Buffer::empty(Rect::new(0, 0, 12, 1));
        buffer.set_string(0, 0, "a<b & 厨", Style::default());
        buffer.set_string(9, 0, "no", Style::default().fg(Color::Red).add_modifier(Modifier::BOLD));
        let svg = svg(&buffer);
        assert!(svg.contains(">a&lt;b &amp; 厨 </text>"), "{svg}");
        assert!(svg.contains("fill=\"#ec6a75\" font-weight=\"bold\""), "{svg}");
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    }
}
