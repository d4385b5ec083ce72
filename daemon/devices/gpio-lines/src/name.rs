//! Names of lines, as in ecosystem files.

use std::fmt;

use serde::Deserialize;

/// Name of a line: its chip and number, such as `gpiochip0/17`, or its own name, such as `GPIO17`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum LineName {
    /// The line is named by its chip and its number on the chip.
    Numbered {
        /// Name of the chip's file below `/dev`, or its label.
        chip: String,
        /// Number of the line on the chip.
        number: u32,
    },
    /// The line is named by its own name, from the description of the board.
    Named(String),
}

/// Error for a text that is not the name of a line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` names no line: write its chip and number, such as \"gpiochip0/17\", or its own name, such as \"GPIO17\""
)]
pub struct InvalidLineName(String);

impl TryFrom<String> for LineName {
    type Error = InvalidLineName;

    fn try_from(text: String) -> Result<LineName, InvalidLineName> {
        let below = text.strip_prefix("/dev/").unwrap_or(&text);
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        match below.rsplit_once('/') {
            Some((chip, number)) if !chip.is_empty() && !chip.contains('/') => {
                let number = number.parse().map_err(|_| InvalidLineName(text.clone()))?;
                Ok(LineName::Numbered { chip: chip.to_owned(), number })
            }
            None if !text.trim().is_empty() && !is_number(&text) => Ok(LineName::Named(text)),
            _ => Err(InvalidLineName(text)),
        }
    }
}

impl fmt::Display for LineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LineName::Numbered { chip, number } => write!(f, "{chip}/{number}"),
            LineName::Named(name) => f.write_str(name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_two_kinds_of_names() {
        let numbered = |chip: &str, number| Some(LineName::Numbered { chip: chip.into(), number });
        for (text, expected) in [
            ("gpiochip0/17", numbered("gpiochip0", 17)),
            ("/dev/gpiochip10/0", numbered("gpiochip10", 0)),
            ("pinctrl-rp1/4", numbered("pinctrl-rp1", 4)),
            ("GPIO17", Some(LineName::Named("GPIO17".into()))),
            ("SPI_CE1 N", Some(LineName::Named("SPI_CE1 N".into()))),
            ("", None),
            (" ", None),
            ("17", None),
            ("/17", None),
            ("gpiochip0/", None),
            ("gpiochip0/x", None),
            ("gpiochip0/-1", None),
            ("gpiochip0/4294967296", None),
            ("/sys/class/gpio/17", None),
        ] {
            let name = LineName::try_from(text.to_owned());
            assert_eq!(name.as_ref().ok(), expected.as_ref(), "{text}");
            if let Err(error) = name {
                assert!(error.to_string().contains("such as \"gpiochip0/17\""), "{error}");
            }
        }
    }
}
