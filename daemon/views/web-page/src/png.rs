//! Pictures in the simple format PPM as PNG, which browsers show.

use miniz_oxide::deflate::compress_to_vec_zlib;

/// Bytes of one pixel: red, green and blue.
const PIXEL_BYTES: usize = 3;

/// Greatest width and height of a picture, in pixels.
const SIDE_MAX: usize = 16_384;

/// Effort of the compression: the quickest, because a picture is shown once.
const LEVEL: u8 = 1;

/// The bytes with which every PNG file begins (PNG specification, section 5.2).
const SIGNATURE: [u8; 8] = [0x89, b'P', b'N', b'G', 0x0d, 0x0a, 0x1a, 0x0a];

/// Returns a binary PPM picture (`P6`, 8 bits per color) as PNG; `None` if the bytes are no such
/// picture.
pub(crate) fn of_ppm(ppm: &[u8]) -> Option<Vec<u8>> {
    let mut rest = ppm.strip_prefix(b"P6")?;
    let (width, height, most) = (number(&mut rest)?, number(&mut rest)?, number(&mut rest)?);
    let is_sound = (1..=SIDE_MAX).contains(&width) && (1..=SIDE_MAX).contains(&height);
    if !is_sound || most != 255 {
        return None;
    }
    // One space or line break ends the header.
    let (_, pixels) = rest.split_first()?;
    let row_bytes = width * PIXEL_BYTES;
    let pixels = pixels.get(..row_bytes * height)?;
    let mut rows = Vec::with_capacity((row_bytes + 1) * height);
    for row in pixels.chunks_exact(row_bytes) {
        // Each row begins with the number of its filter; 0 is none.
        rows.push(0);
        rows.extend_from_slice(row);
    }
    let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX).to_be_bytes();
    // 8 bits, red, green and blue; the standard compression and filters; not interlaced.
    let header = [&side(width)[..], &side(height)[..], &[8, 2, 0, 0, 0]].concat();
    let mut png = SIGNATURE.to_vec();
    push_chunk(&mut png, b"IHDR", &header);
    push_chunk(&mut png, b"IDAT", &compress_to_vec_zlib(&rows, LEVEL));
    push_chunk(&mut png, b"IEND", &[]);
    Some(png)
}

/// Takes a number and the spaces and comments before it.
fn number(rest: &mut &[u8]) -> Option<usize> {
    loop {
        match rest.first()? {
            b'#' => {
                let end = rest.iter().position(|byte| *byte == b'\n')?;
                *rest = &rest[end..];
            }
            byte if byte.is_ascii_whitespace() => *rest = &rest[1..],
            _ => break,
        }
    }
    let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (number, after) = rest.split_at(digits);
    *rest = after;
    std::str::from_utf8(number).ok()?.parse().ok()
}

fn push_chunk(png: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    png.extend_from_slice(&u32::try_from(data.len()).unwrap_or(u32::MAX).to_be_bytes());
    let start = png.len();
    png.extend_from_slice(kind);
    png.extend_from_slice(data);
    let checksum = crc32(&png[start..]);
    png.extend_from_slice(&checksum.to_be_bytes());
}

/// Returns the checksum of a chunk (CRC-32 of ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0xedb8_8320;
    let step = |sum: u32| if sum & 1 == 1 { POLYNOMIAL ^ (sum >> 1) } else { sum >> 1 };
    let of_byte = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), |sum, _| step(sum));
    !bytes.iter().fold(u32::MAX, of_byte)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        assert_eq!(crc32(b"IEND"), 0xae42_6082);
    }

    #[test]
    fn a_picture_keeps_its_pixels() {
        let pixels: Vec<u8> = (0..4 * 2 * 3).collect();
        let ppm = [b"P6\n# hall: alice\n4 2\n255\n".as_slice(), &pixels].concat();
        let png = of_ppm(&ppm).expect("a picture");
        assert_eq!(png[..8], SIGNATURE);
        assert_eq!(png[16..24], [0, 0, 0, 4, 0, 0, 0, 2]);
        let at = png.windows(4).position(|it| it == b"IDAT").expect("pixels");
        let length = u32::from_be_bytes(png[at - 4..at].try_into().expect("4 bytes"));
        let data = &png[at + 4..][..usize::try_from(length).expect("short")];
        let rows = miniz_oxide::inflate::decompress_to_vec_zlib(data).expect("zlib");
        let shown: Vec<u8> = rows.chunks(13).flat_map(|row| row[1..].to_vec()).collect();
        assert_eq!(shown, pixels);
    }

    #[test]
    fn other_bytes_are_no_picture() {
        let wrong: [&[u8]; 8] = [
            b"",
            b"P6",
            b"P5 1 1 255 abc",
            b"P6 1 1 255",
            b"P6 1 1 65535 abcdef",
            b"P6 0 1 255 ",
            b"P6 99999999999999999999 1 255 abc",
            b"P6 2 2 255 abc",
        ];
        for bytes in wrong {
            assert_eq!(of_ppm(bytes), None, "{}", bytes.escape_ascii());
        }
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = of_ppm(&bytes);
            let _ = of_ppm(&[b"P6 ".as_slice(), &bytes].concat());
        }
    }
}
