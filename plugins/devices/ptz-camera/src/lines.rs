//! Lines of text that arrive in pieces, with a bound on their length.
//!
//! This file uses no clock, and does no input or output.

/// Collects pieces of text, and returns their complete lines.
#[derive(Debug)]
pub(crate) struct Lines {
    /// The beginning of a line whose end has not arrived.
    begun: Vec<u8>,
    /// Maximum length of a line, in bytes.
    bytes_max: usize,
    /// Whether the beginning of a line that is too long was dropped.
    is_too_long: bool,
}

impl Lines {
    pub(crate) fn new(bytes_max: usize) -> Lines {
        Lines { begun: Vec::new(), bytes_max, is_too_long: false }
    }

    /// Takes a piece of text, and returns the lines that it completes, without spaces at their
    /// ends. Lines that are too long or empty are left out.
    pub(crate) fn take(&mut self, piece: &[u8]) -> Vec<String> {
        let mut lines = Vec::new();
        for &byte in piece {
            match byte {
                b'\n' if self.is_too_long => self.is_too_long = false,
                b'\n' => {
                    let line = String::from_utf8_lossy(&self.begun).trim().to_owned();
                    self.begun.clear();
                    if !line.is_empty() {
                        lines.push(line);
                    }
                }
                _ if self.is_too_long => (),
                _ if self.begun.len() >= self.bytes_max => {
                    self.begun.clear();
                    self.is_too_long = true;
                }
                _ => self.begun.push(byte),
            }
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::Lines;

    #[test]
    fn lines_are_put_together_and_long_ones_left_out() {
        let mut lines = Lines::new(5);
        assert_eq!(lines.take(b"sta"), Vec::<String>::new());
        assert_eq!(lines.take(b"rt\n\nend \nan"), ["start", "end"]);
        assert_eq!(lines.take(b" endless line"), Vec::<String>::new());
        assert_eq!(lines.take(b" goes on\nlost\n\xff\n"), ["lost", "\u{fffd}"]);
    }
}
