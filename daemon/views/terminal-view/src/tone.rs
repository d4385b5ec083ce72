//! Tones: what a piece of a page means, and how that looks in a terminal with colors and in one
//! without. No meaning is said by a color alone: the pages have words and signs for each.

use ratatui::style::{Color, Modifier, Style};

/// Meaning of a piece of a page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Tone {
    /// Has nothing special.
    #[default]
    Plain,
    /// Is of less interest: a label, a time that has passed.
    Dim,
    /// Names a section or a column.
    Heading,
    /// Can be opened, or is the subject of its line.
    Name,
    /// Is as it should be.
    Good,
    /// Goes on now.
    Busy,
    /// Needs a look.
    Warn,
    /// Needs a person.
    Bad,
    /// Is the bar at the top or the bottom.
    Bar,
    /// Is a key that can be pressed.
    Key,
}

impl Tone {
    /// Returns how this tone looks.
    pub(crate) fn style(self, color: bool) -> Style {
        let plain = Style::default();
        if !color {
            return match self {
                Self::Plain | Self::Good | Self::Name => plain,
                Self::Dim => plain.add_modifier(Modifier::DIM),
                Self::Heading | Self::Busy | Self::Warn | Self::Key => {
                    plain.add_modifier(Modifier::BOLD)
                }
                Self::Bad => plain.add_modifier(Modifier::BOLD | Modifier::UNDERLINED),
                Self::Bar => plain.add_modifier(Modifier::REVERSED),
            };
        }
        match self {
            Self::Plain => plain,
            Self::Dim => plain.fg(Color::DarkGray),
            Self::Heading => plain.add_modifier(Modifier::BOLD),
            Self::Name => plain.fg(Color::Cyan),
            Self::Good => plain.fg(Color::Green),
            Self::Busy => plain.fg(Color::Blue).add_modifier(Modifier::BOLD),
            Self::Warn => plain.fg(Color::Yellow),
            Self::Bad => plain.fg(Color::Red).add_modifier(Modifier::BOLD),
            Self::Bar => plain.fg(Color::White).bg(Color::DarkGray),
            Self::Key => plain.fg(Color::Cyan).add_modifier(Modifier::BOLD),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_without_colors_gets_none() {
        let all = [
            Tone::Plain,
            Tone::Dim,
            Tone::Heading,
            Tone::Name,
            Tone::Good,
            Tone::Busy,
            Tone::Warn,
            Tone::Bad,
            Tone::Bar,
            Tone::Key,
        ];
        for tone in all {
            let style = tone.style(false);
            assert_eq!((style.fg, style.bg), (None, None), "{tone:?}");
        }
    }
}
