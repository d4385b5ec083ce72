//! Motion by the differences between small gray pictures.
//!
//! Lamps, clouds and the camera's own exposure make all of a picture brighter or darker; the
//! comparison takes that out. A change in a single picture is no motion: a lamp that shines on a
//! part of the room changes one picture, and a person changes several in a row.
//!
//! This file uses no clock, and does no input or output.

/// Width and height of a picture, in pixels. At this size, noise is averaged out, and a person in
/// full view has some hundred pixels.
pub(super) const WIDTH: usize = 160;
pub(super) const HEIGHT: usize = 120;

/// Minimum difference of brightness for a changed pixel. The noise of a camera's sensor is smaller.
const CHANGED: f32 = 20.0;

/// Share of the picture whose change is not motion in it, but another view: the camera was moved or
/// covered.
const OTHER_VIEW: f64 = 0.7;

/// Number of pictures that are looked at together, and number of them that must have changed.
const TOGETHER: u32 = 4;
const CHANGED_MIN: u32 = 3;

/// Least and greatest factor by which the contrast of a picture may differ from that of the one
/// before, by the camera's exposure.
const GAIN: (f32, f32) = (0.5, 2.0);

/// Least contrast (standard deviation of the brightness) of a picture from which a factor is
/// computed; below it, noise decides.
const CONTRAST_MIN: f32 = 2.0;

/// Compares each picture with the one before.
#[derive(Debug)]
pub(super) struct Differences {
    /// Share of the picture that must change to count as motion.
    sensitivity: f64,
    before: Option<Vec<u8>>,
    /// One bit for each of the last pictures, the newest lowest: whether it has changed.
    changed: u32,
}

impl Differences {
    pub(super) fn new(sensitivity: f64) -> Differences {
        Differences { sensitivity, before: None, changed: 0 }
    }

    /// Takes the next picture, one byte for each pixel. Returns whether there is motion.
    pub(super) fn take(&mut self, picture: &[u8]) -> bool {
        let before = self.before.replace(picture.to_vec());
        let share = before.map_or(0.0, |before| changed_share(&before, picture));
        if share >= OTHER_VIEW {
            self.changed = 0;
            return false;
        }
        let is_changed = u32::from(share >= self.sensitivity);
        self.changed = ((self.changed << 1) | is_changed) & ((1 << TOGETHER) - 1);
        self.changed.count_ones() >= CHANGED_MIN
    }

    /// Forgets the pictures so far, because the camera has another view.
    pub(super) fn forget(&mut self) {
        (self.before, self.changed) = (None, 0);
    }
}

/// Returns the share of pixels that have changed, from 0 to 1, apart from a change of the whole
/// picture in brightness and contrast. Returns 0 for pictures of different sizes.
fn changed_share(before: &[u8], now: &[u8]) -> f64 {
    if before.len() != now.len() || now.is_empty() {
        return 0.0;
    }
    let (mean_before, contrast_before) = brightness(before);
    let (mean_now, contrast_now) = brightness(now);
    let gain = if contrast_before.min(contrast_now) < CONTRAST_MIN {
        1.0
    } else {
        (contrast_now / contrast_before).clamp(GAIN.0, GAIN.1)
    };
    let is_changed = |(before, now): (&u8, &u8)| {
        let expected = (f32::from(*before) - mean_before) * gain;
        (f32::from(*now) - mean_now - expected).abs() > CHANGED
    };
    let changed = before.iter().zip(now).filter(|pair| is_changed(*pair)).count();
    changed as f64 / now.len() as f64
}

/// Returns the mean of the brightness, and its standard deviation.
fn brightness(picture: &[u8]) -> (f32, f32) {
    let count = picture.len() as f64;
    let mean = picture.iter().map(|&pixel| f64::from(pixel)).sum::<f64>() / count;
    let squares = picture.iter().map(|&pixel| (f64::from(pixel) - mean).powi(2)).sum::<f64>();
    (mean as f32, (squares / count).sqrt() as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room with a dark and a bright half, and a person of `width` pixels at `x`, if there is
    /// one. Each pixel has some noise.
    fn room(number: usize, person: Option<(usize, usize)>, light: impl Fn(f32) -> f32) -> Vec<u8> {
        let pixel = |index: usize| {
            let (x, y) = (index % WIDTH, index / WIDTH);
            let is_person =
                person.is_some_and(|(at, width)| (at..at + width).contains(&x) && y > 40);
            let wall = if x < 70 { 60.0 } else { 150.0 };
            let noise = (index * 7_919 + number * 104_729) % 11;
            let seen = light(if is_person { 20.0 } else { wall }) + noise as f32 - 5.0;
            seen.clamp(0.0, 255.0) as u8
        };
        (0..WIDTH * HEIGHT).map(pixel).collect()
    }

    /// Returns the numbers of the pictures at which there is motion.
    fn moving(pictures: impl IntoIterator<Item = Vec<u8>>) -> Vec<usize> {
        let mut differences = Differences::new(0.004);
        let seen = pictures.into_iter().enumerate();
        seen.filter_map(|(number, picture)| differences.take(&picture).then_some(number)).collect()
    }

    #[test]
    fn a_person_who_walks_by_is_motion_after_three_pictures() {
        let walk = (0..30).map(|number| {
            let person = (5..25).contains(&number).then(|| (4 * number, 14));
            room(number, person, |seen| seen)
        });
        let moving = moving(walk);
        assert_eq!(moving.first(), Some(&7), "{moving:?}");
        assert!(moving.contains(&20) && !moving.contains(&29), "{moving:?}");
    }

    #[test]
    fn noise_and_a_person_who_stands_still_are_no_motion() {
        let still = (0..30).map(|number| room(number, Some((60, 14)), |seen| seen));
        assert_eq!(moving(still), [0_usize; 0]);
    }

    #[test]
    fn light_that_changes_is_no_motion() {
        // A lamp is switched on and off; the light of the day changes; the exposure hunts.
        let switched =
            |number: usize| move |seen: f32| seen + if number % 10 < 5 { 0.0 } else { 60.0 };
        let lamp = (0..40).map(|number| room(number, None, switched(number)));
        assert_eq!(moving(lamp), [0_usize; 0], "a lamp");
        let fading = |number: usize| move |seen: f32| seen * (0.6 + number as f32 / 40.0);
        let dawn = (0..40).map(|number| room(number, None, fading(number)));
        assert_eq!(moving(dawn), [0_usize; 0], "dawn");
        let hunting = |number: usize| {
            move |seen: f32| seen * if number.is_multiple_of(2) { 0.8 } else { 1.1 }
        };
        let exposure = (0..40).map(|number| room(number, None, hunting(number)));
        assert_eq!(moving(exposure), [0_usize; 0], "exposure");
    }

    #[test]
    fn a_lamp_on_a_part_of_the_room_is_no_motion() {
        let spot = (0..40).map(|number| {
            let is_on = (20..40).contains(&number);
            let mut picture = room(number, None, |seen| seen);
            let lit = picture.iter_mut().enumerate().filter(|(index, _)| index % WIDTH > 120);
            lit.for_each(|(_, pixel)| *pixel = pixel.saturating_add(if is_on { 80 } else { 0 }));
            picture
        });
        assert_eq!(moving(spot), [0_usize; 0]);
    }

    #[test]
    fn another_view_is_no_motion_and_neither_is_another_size() {
        let mut differences = Differences::new(0.004);
        let stripes = |phase: usize| -> Vec<u8> {
            let bright = |index: usize| (index % WIDTH / 8 + phase).is_multiple_of(2);
            (0..WIDTH * HEIGHT).map(|index| if bright(index) { 220 } else { 30 }).collect()
        };
        for phase in 0..6 {
            assert!(!differences.take(&stripes(phase)), "the camera is moved");
        }
        for _ in 0..6 {
            assert!(!differences.take(&[0; 7]));
            assert!(!differences.take(&[]));
        }
        differences.forget();
        assert!(!differences.take(&stripes(0)));
    }
}
