//! Pictures: their pixels, their file formats, and the difference between two pictures.
//!
//! Pictures are PPM files and videos are YUV4MPEG2 files, because both formats are simple to write
//! and common tools read them. This file uses no clock and does no input or output.

use std::io::Write as _;

use crate::position::PtzPosition;

/// Minimum difference of brightness for a changed pixel. The noise of a camera's sensor is smaller.
const CHANGED: i32 = 24;

/// One picture of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Width of the picture, in pixels; an even number.
    pub width: usize,
    /// Height of the picture, in pixels; an even number. In videos, each square of four pixels
    /// shares its colors.
    pub height: usize,
    /// Red, green and blue of each pixel of the picture, row by row from the top.
    pub rgb: Vec<u8>,
    /// Direction and zoom of the camera when the picture was taken.
    pub aim: PtzPosition,
    /// Description of the picture's content for a person, in one line.
    pub caption: String,
}

impl Frame {
    /// Returns the picture as a binary PPM file, with the caption in a comment.
    pub(crate) fn ppm(&self) -> Vec<u8> {
        let caption = self.caption.replace(['\n', '\r'], " ");
        let header = format!("P6\n# {caption}\n{} {}\n255\n", self.width, self.height);
        [header.as_bytes(), &self.rgb].concat()
    }

    /// Returns the share of pixels that have changed since `before`, from 0 to 1. Returns 0 if the
    /// pictures have different directions or sizes, because their difference is then no evidence of
    /// motion.
    pub(crate) fn change_since(&self, before: &Frame) -> f64 {
        if before.aim != self.aim || before.rgb.len() != self.rgb.len() || self.rgb.is_empty() {
            return 0.0;
        }
        let pairs = self.lumas().zip(before.lumas());
        let changed = pairs.filter(|(now, then)| (now - then).abs() > CHANGED).count();
        changed as f64 / (self.width * self.height) as f64
    }

    fn lumas(&self) -> impl Iterator<Item = i32> {
        self.rgb.chunks_exact(3).map(|pixel| yuv(pixel).0)
    }

    /// Returns one color plane of the picture. Each value is the mean of `of` over a square of four
    /// pixels.
    fn chroma(&self, of: impl Fn(&[u8]) -> i32) -> Vec<u8> {
        let at = |x: usize, y: usize| {
            let start = (y * self.width + x) * 3;
            self.rgb.get(start..start + 3).map_or(128, &of)
        };
        let mut plane = Vec::with_capacity(self.width * self.height / 4);
        for y in (0..self.height).step_by(2) {
            for x in (0..self.width).step_by(2) {
                let sum = at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1);
                plane.push(byte(sum / 4));
            }
        }
        plane
    }
}

/// Returns the frames as a YUV4MPEG2 video in 4:2:0.
pub(crate) fn y4m(frames: &[Frame], per_second: u32) -> Vec<u8> {
    let Some(Frame { width, height, .. }) = frames.first() else { return Vec::new() };
    let mut file =
        format!("YUV4MPEG2 W{width} H{height} F{per_second}:1 Ip A1:1 C420jpeg\n").into_bytes();
    for frame in frames {
        // Writing to memory cannot fail.
        let _ = file.write_all(b"FRAME\n");
        file.extend(frame.lumas().map(byte));
        file.extend(frame.chroma(|pixel| yuv(pixel).1));
        file.extend(frame.chroma(|pixel| yuv(pixel).2));
    }
    file
}

/// Returns the brightness and the two color values of a pixel, from 0 to 255 (JFIF).
fn yuv(pixel: &[u8]) -> (i32, i32, i32) {
    let [red, green, blue] = [0, 1, 2].map(|i| pixel.get(i).copied().map_or(0, i32::from));
    let luma = (299 * red + 587 * green + 114 * blue) / 1_000;
    let blue_chroma = 128 + (-169 * red - 331 * green + 500 * blue) / 1_000;
    let red_chroma = 128 + (500 * red - 419 * green - 81 * blue) / 1_000;
    (luma, blue_chroma, red_chroma)
}

fn byte(number: i32) -> u8 {
    number.clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::{Frame, y4m};
    use crate::position::PtzPosition;

    fn gray(brightness: u8) -> Frame {
        let rgb = vec![brightness; 4 * 2 * 3];
        let aim = PtzPosition { pan: 0.0, tilt: 0.0, zoom: 1.0 };
        Frame { width: 4, height: 2, rgb, aim, caption: "corridor\nempty".to_owned() }
    }

    #[test]
    fn a_picture_is_a_ppm_with_its_caption() {
        let file = gray(7).ppm();
        let header = b"P6\n# corridor empty\n4 2\n255\n";
        assert_eq!(&file[..header.len()], header);
        assert_eq!(&file[header.len()..], [7; 24]);
    }

    #[test]
    fn a_video_has_three_planes_a_frame() {
        let file = y4m(&[gray(0), gray(255)], 5);
        let text = String::from_utf8_lossy(&file).into_owned();
        assert!(text.starts_with("YUV4MPEG2 W4 H2 F5:1 Ip A1:1 C420jpeg\nFRAME\n"), "{text}");
        let header = file.iter().position(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        assert_eq!(file.len() - header, 2 * ("FRAME\n".len() + 8 + 2 + 2));
        assert_eq!(
            file[file.len() - 12..],
            [255, 255, 255, 255, 255, 255, 255, 255, 128, 128, 128, 128]
        );
    }

    #[test]
    fn motion_is_a_change_between_frames_of_one_direction() {
        let (before, mut after) = (gray(100), gray(100));
        assert_eq!(after.change_since(&before), 0.0);
        after.rgb[..6].fill(200);
        assert_eq!(after.change_since(&before), 0.25, "two of eight pixels");
        after.rgb[..6].fill(110);
        assert_eq!(after.change_since(&before), 0.0, "noise");
        after = gray(200);
        after.aim.pan = 5.0;
        assert_eq!(after.change_since(&before), 0.0, "it turned");
    }
}
