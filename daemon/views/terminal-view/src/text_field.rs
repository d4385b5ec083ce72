//! A line that a person types.

use crate::keys::{KeyPress, NamedKey};
use crate::text;

/// Most characters that can be typed or pasted.
const TYPED_MAX: usize = 4_000;

/// A line that is being typed. It has no `Debug`, because it may be secret.
#[derive(Clone, Default)]
pub(crate) struct TextField {
    typed: Vec<char>,
    cursor: usize,
    is_secret: bool,
}

impl TextField {
    /// Begins with a text.
    pub(crate) fn with(text: &str) -> Self {
        let mut field = Self::default();
        field.insert(text);
        field
    }

    /// Begins a line that is not shown.
    pub(crate) fn secret() -> Self {
        Self { is_secret: true, ..Self::default() }
    }

    /// Returns what was typed.
    pub(crate) fn text(&self) -> String {
        self.typed.iter().collect()
    }

    /// Whether nothing was typed.
    pub(crate) fn is_empty(&self) -> bool {
        self.typed.is_empty()
    }

    /// Replaces what was typed.
    pub(crate) fn set(&mut self, text: &str) {
        self.typed.clear();
        self.cursor = 0;
        self.insert(text);
    }

    /// Inserts a text at the cursor, up to its first line break.
    pub(crate) fn insert(&mut self, text: &str) {
        let line = text.trim_start_matches(['\r', '\n']);
        for character in line.chars().take_while(|it| !matches!(it, '\r' | '\n')) {
            if self.typed.len() >= TYPED_MAX {
                return;
            }
            let character = if character == '\t' { ' ' } else { character };
            if !character.is_control() {
                self.typed.insert(self.cursor, character);
                self.cursor += 1;
            }
        }
    }

    /// Takes a key; returns whether it had a meaning here.
    pub(crate) fn press(&mut self, key: KeyPress) -> bool {
        match key {
            KeyPress::Character(character) => self.insert(&character.to_string()),
            KeyPress::Named(NamedKey::Backspace) => {
                if self.cursor > 0 {
                    self.cursor -= 1;
                    self.typed.remove(self.cursor);
                }
            }
            KeyPress::Named(NamedKey::Delete) => {
                if self.cursor < self.typed.len() {
                    self.typed.remove(self.cursor);
                }
            }
            KeyPress::Named(NamedKey::Left) => self.cursor = self.cursor.saturating_sub(1),
            KeyPress::Named(NamedKey::Right) => {
                self.cursor = (self.cursor + 1).min(self.typed.len());
            }
            KeyPress::Named(NamedKey::Home) | KeyPress::Control('a') => self.cursor = 0,
            KeyPress::Named(NamedKey::End) | KeyPress::Control('e') => {
                self.cursor = self.typed.len();
            }
            KeyPress::Control('u') => {
                self.typed.drain(..self.cursor);
                self.cursor = 0;
            }
            KeyPress::Control('w') => self.delete_word(),
            _ => return false,
        }
        true
    }

    fn delete_word(&mut self) {
        let before = &self.typed[..self.cursor];
        let word_end = before.iter().rposition(|it| *it != ' ').map_or(0, |last| last + 1);
        let start = before[..word_end].iter().rposition(|it| *it == ' ').map_or(0, |last| last + 1);
        self.typed.drain(start..self.cursor);
        self.cursor = start;
    }

    /// Returns what is shown in `columns` cells, and the cell of the cursor: the part of the line
    /// around the cursor.
    pub(crate) fn shown(&self, columns: usize) -> (String, usize) {
        let shown = |characters: &[char]| {
            if self.is_secret {
                return "•".repeat(characters.len());
            }
            text::clean(&characters.iter().collect::<String>())
        };
        let mut start = 0;
        while start < self.cursor && text::width(&shown(&self.typed[start..self.cursor])) >= columns
        {
            start += (columns / 2).max(1);
        }
        let start = start.min(self.cursor);
        let before = shown(&self.typed[start..self.cursor]);
        // Characters are joined across the cursor only where a text is drawn as a whole.
        let whole = format!("{before}{}", shown(&self.typed[self.cursor..]));
        (text::take(&whole, columns).to_owned(), text::width(&before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typed(keys: &str) -> TextField {
        let mut field = TextField::default();
        for key in keys.chars() {
            field.press(match key {
                '<' => KeyPress::Named(NamedKey::Left),
                '⌫' => KeyPress::Named(NamedKey::Backspace),
                '⌦' => KeyPress::Named(NamedKey::Delete),
                '⇤' => KeyPress::Named(NamedKey::Home),
                '␗' => KeyPress::Control('w'),
                '␕' => KeyPress::Control('u'),
                character => KeyPress::Character(character),
            });
        }
        field
    }

    #[test]
    fn a_line_is_edited() {
        let check = |keys: &str, expected: &str| assert_eq!(typed(keys).text(), expected);
        check("ab<c", "acb");
        check("abc<⌫⌫⌫⌫", "c");
        check("abc⇤⌦", "bc");
        check("one two  ␗x", "one x");
        check("one two<<␕", "wo");
    }

    #[test]
    fn a_pasted_text_ends_at_its_first_line() {
        let mut field = TextField::with("a");
        field.insert("\nb\u{1b}[2J\tc\nquit\n");
        assert_eq!(field.text(), "ab[2J c");
        field.insert(&"x".repeat(10_000));
        assert_eq!(field.text().chars().count(), TYPED_MAX);
    }

    #[test]
    fn the_cursor_stays_in_sight() {
        let field = TextField::with("abcdefghij");
        for columns in 1..12 {
            let (shown, cursor) = field.shown(columns);
            assert!(text::width(&shown) <= columns && cursor < columns.max(1), "{columns}");
        }
        assert_eq!(TextField::with("office1").shown(20), ("office1".to_owned(), 7));
        let mut secret = TextField::secret();
        secret.insert("2718");
        assert_eq!(secret.shown(20), ("••••".to_owned(), 4));
    }
}
