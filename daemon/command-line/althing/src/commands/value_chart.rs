//! A chart of the values of a fact over time, of characters.
//!
//! A value holds until the next one, so the chart is made of steps. A column shows all values that
//! the fact had in its time, from the smallest to the greatest.

use std::fmt::Write as _;

use jiff::Zoned;

use crate::commands::history_text;

/// Columns of the chart itself; with the scale it fits into 80.
const COLUMNS: usize = 66;

/// Rows of the chart.
const ROWS: usize = 8;

/// Columns of the scale on the left.
const SCALE_COLUMNS: usize = 10;

/// Draws the values, each with its time, oldest first, as far as `end_ms`. Returns `None` if there
/// are fewer than two values.
pub(super) fn chart(values: &[(u64, f64)], end_ms: u64, now: &Zoned) -> Option<String> {
    let [(start_ms, _), .., (last_ms, _)] = *values else { return None };
    let end_ms = end_ms.max(last_ms).max(start_ms + 1);
    let least = values.iter().map(|(_, value)| *value).fold(f64::INFINITY, f64::min);
    let most = values.iter().map(|(_, value)| *value).fold(f64::NEG_INFINITY, f64::max);
    let columns = columns(values, start_ms, end_ms);
    let mut text = String::new();
    for row in (0..ROWS).rev() {
        let label = match row {
            _ if row == ROWS - 1 => number(most),
            0 if most > least => number(least),
            _ => String::new(),
        };
        let mark = if label.is_empty() { '│' } else { '┤' };
        let _ = write!(text, "{label:>SCALE_COLUMNS$} {mark}");
        let cells: String = columns
            .iter()
            .map(|(low, high)| cell(row, row_of(*low, least, most), row_of(*high, least, most)))
            .collect();
        text += cells.trim_end();
        text.push('\n');
    }
    let (from, to) = (history_text::moment(start_ms, now), history_text::moment(end_ms, now));
    let _ = writeln!(text, "{:SCALE_COLUMNS$} └{}", "", "─".repeat(COLUMNS));
    let gap = COLUMNS.saturating_sub(from.chars().count() + to.chars().count());
    let _ = writeln!(text, "{:SCALE_COLUMNS$}  {from}{:gap$}{to}", "", "");
    Some(text)
}

/// Returns the smallest and the greatest value in the time of each column.
fn columns(values: &[(u64, f64)], start_ms: u64, end_ms: u64) -> Vec<(f64, f64)> {
    let length = u128::from(end_ms - start_ms);
    let mut later = values.iter().peekable();
    let mut current = values.first().map_or(0.0, |(_, value)| *value);
    let column = |column: usize| {
        let until = start_ms
            + u64::try_from(length * (column as u128 + 1) / COLUMNS as u128).unwrap_or(u64::MAX);
        let (mut low, mut high) = (current, current);
        while let Some((_, value)) = later.next_if(|(at, _)| *at < until) {
            current = *value;
            low = low.min(current);
            high = high.max(current);
        }
        (low, high)
    };
    (0..COLUMNS).map(column).collect()
}

/// Returns the row of a value; the lowest row is 0.
fn row_of(value: f64, least: f64, most: f64) -> usize {
    if most <= least {
        return ROWS - 1;
    }
    // Halves avoid an overflow of the difference of very great values.
    let share = (value / 2.0 - least / 2.0) / (most / 2.0 - least / 2.0);
    ((share * (ROWS - 1) as f64).round() as usize).min(ROWS - 1)
}

fn cell(row: usize, low: usize, high: usize) -> char {
    match row {
        _ if row < low || row > high => ' ',
        _ if low == high => '─',
        _ => '│',
    }
}

/// Formats a value for the scale.
fn number(value: f64) -> String {
    let plain = format!("{value}");
    if plain.len() <= SCALE_COLUMNS { plain } else { format!("{value:.3e}") }
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};
    use jiff::Timestamp;
    use jiff::tz::TimeZone;

    use super::*;

    const START: u64 = 1_795_860_000_000;

    #[track_caller]
    fn check(values: &[(u64, f64)], expected: Expect) {
        let now = "2026-11-28T10:00:00Z".parse::<Timestamp>().expect("a time");
        let now = now.to_zoned(TimeZone::UTC);
        let shown = chart(values, START + 3_600_000, &now).expect("two values");
        for line in shown.lines() {
            assert!(line.chars().count() <= 80, "{line}");
        }
        // Without a line that begins at the margin, the scale would be moved there.
        expected.assert_eq(&format!("chart\n{shown}"));
    }

    #[test]
    fn a_value_holds_until_the_next() {
        let values = [(0, 20.5), (900, 21.0), (1_800, 24.0), (1_810, 19.0), (2_700, 22.0)];
        check(
            &values.map(|(s, value)| (START + s * 1_000, value)),
            expect![[r#"
            chart
                    24 ┤                                 │
                       │                                 │
                       │                                 │
                       │                                 │               │────────────────
                       │                │────────────────│               │
                       │────────────────│                │               │
                       │                                 │               │
                    19 ┤                                 │───────────────│
                       └──────────────────────────────────────────────────────────────────
                        10:00:00                                                  11:00:00
        "#]],
        );
    }

    #[test]
    fn equal_and_extreme_values_are_drawn() {
        check(
            &[(START, 21.5), (START + 9_000, 21.5)],
            expect![[r#"
            chart
                  21.5 ┤──────────────────────────────────────────────────────────────────
                       │
                       │
                       │
                       │
                       │
                       │
                       │
                       └──────────────────────────────────────────────────────────────────
                        10:00:00                                                  11:00:00
        "#]],
        );
        check(
            &[(START, f64::MAX), (START + 9_000, f64::MIN)],
            expect![[r#"
            chart
             1.798e308 ┤│
                       ││
                       ││
                       ││
                       ││
                       ││
                       ││
            -1.798e308 ┤│─────────────────────────────────────────────────────────────────
                       └──────────────────────────────────────────────────────────────────
                        10:00:00                                                  11:00:00
        "#]],
        );
    }

    #[test]
    fn one_value_is_no_chart() {
        assert_eq!(chart(&[(START, 1.0)], START, &Zoned::now()), None);
        assert_eq!(chart(&[], START, &Zoned::now()), None);
    }
}
