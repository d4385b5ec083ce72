//! Pictures in a stream of parts, each with its length before it (ffmpeg's `mpjpeg`).
//!
//! This file uses no clock, and does no input or output.

/// Maximum size of a picture, in bytes; a greater one is an error. A picture of 8 megapixels has
/// 2 to 4 MB.
const PICTURE_BYTES_MAX: usize = 16 << 20;

/// Maximum length of the lines before a picture, in bytes.
const HEAD_BYTES_MAX: usize = 1 << 10;

/// End of the lines before a picture.
const HEAD_END: &[u8] = b"\r\n\r\n";

/// Collects pieces of the stream, and returns its pictures.
#[derive(Debug, Default)]
pub(super) struct Multipart {
    begun: Vec<u8>,
}

impl Multipart {
    /// Takes a piece of the stream. Returns the last picture that it completes; earlier ones are
    /// dropped.
    ///
    /// # Errors
    ///
    /// Returns an error if the stream has no length before a picture, or one that is too great.
    pub(super) fn take(&mut self, piece: &[u8]) -> Result<Option<Vec<u8>>, String> {
        self.begun.extend_from_slice(piece);
        let mut last = None;
        while let Some(picture) = self.next()? {
            last = Some(picture);
        }
        Ok(last)
    }

    fn next(&mut self) -> Result<Option<Vec<u8>>, String> {
        let end = self.begun.windows(HEAD_END.len()).position(|window| window == HEAD_END);
        let Some(end) = end.filter(|end| *end <= HEAD_BYTES_MAX) else {
            let is_wrong = self.begun.len() > HEAD_BYTES_MAX;
            let problem = "read the pictures of ffmpeg: they have no beginning";
            return if is_wrong { Err(problem.to_owned()) } else { Ok(None) };
        };
        let head = String::from_utf8_lossy(self.begun.get(..end).unwrap_or_default()).into_owned();
        let length = head.lines().find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.trim().eq_ignore_ascii_case("content-length").then(|| value.trim().parse().ok())?
        });
        let Some(length) = length.filter(|length: &usize| *length <= PICTURE_BYTES_MAX) else {
            return Err("read the pictures of ffmpeg: one has no length, or is too great".into());
        };
        let start = end + HEAD_END.len();
        let Some(picture) = self.begun.get(start..start + length).map(<[u8]>::to_vec) else {
            return Ok(None);
        };
        self.begun.drain(..start + length);
        Ok(Some(picture))
    }
}

#[cfg(test)]
mod tests {
    use super::Multipart;

    fn part(content: &str) -> String {
        let length = content.len();
        format!(
            "--ffmpeg\r\nContent-type: image/jpeg\r\nContent-length: {length}\r\n\r\n{content}\r\n"
        )
    }

    #[test]
    fn pictures_are_put_together_and_the_last_one_is_returned() {
        let mut parts = Multipart::default();
        let text = part("first") + &part("a\r\n\r\nsecond") + &part("third");
        let (one, two) = text.split_at(text.len() - 4);
        assert_eq!(parts.take(one.as_bytes()), Ok(Some(b"a\r\n\r\nsecond".to_vec())));
        assert_eq!(parts.take(&two.as_bytes()[..2]), Ok(Some(b"third".to_vec())));
        assert_eq!(parts.take(&two.as_bytes()[2..]), Ok(None));
    }

    #[test]
    fn a_stream_without_lengths_is_an_error() {
        for text in [
            "x".repeat(5_000),
            "--ffmpeg\r\n\r\nx".to_owned(),
            part("x").replace(": 1", ": 99999999"),
        ] {
            Multipart::default().take(text.as_bytes()).expect_err(&text);
        }
    }
}
