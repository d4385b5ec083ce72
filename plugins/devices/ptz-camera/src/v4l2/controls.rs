//! The motors of a USB camera: its controls `pan_absolute`, `tilt_absolute` and `zoom_absolute`,
//! which `v4l2-ctl` (of `v4l-utils`) lists and sets.

use std::time::Duration;

use onvif_link::Position;
use programs::{Program, is_installed};

/// Name of the program.
const V4L2_CTL: &str = "v4l2-ctl";

/// Time limit of the program. A camera answers at once, and a USB bus that is reset after seconds.
const TIME_MAX: Duration = Duration::from_secs(5);

/// Names of the controls: pan, tilt, zoom.
const NAMES: [&str; 3] = ["pan_absolute", "tilt_absolute", "zoom_absolute"];

/// A control of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Control {
    least: i64,
    greatest: i64,
    step: i64,
    value: i64,
}

/// The motors of a camera; `None` for each that it does not have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Controls {
    pan: Option<Control>,
    tilt: Option<Control>,
    zoom: Option<Control>,
}

impl Controls {
    /// Reads the controls of a device.
    ///
    /// # Errors
    ///
    /// Returns an error if `v4l2-ctl` is not installed or fails.
    pub(super) async fn read(device: &str) -> Result<Controls, String> {
        if !is_installed(V4L2_CTL) {
            return Err("find the program `v4l2-ctl`, which turns the camera: install it (on \
                        Debian: apt install v4l-utils)"
                .to_owned());
        }
        let listed = run(device, "--list-ctrls".to_owned()).await?;
        Ok(Controls::parse(&listed))
    }

    /// Turns a device. Returns before it has arrived.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera lacks a motor that the position needs, or `v4l2-ctl` fails.
    pub(super) async fn turn(&self, device: &str, to: Position) -> Result<(), String> {
        let Some(values) = self.values(to) else {
            return Err(format!(
                "turn {device} there: it lacks a motor for this position (v4l2-ctl -d {device} \
                 --list-ctrls shows its controls)"
            ));
        };
        let values = values.map(|(name, value)| format!("{name}={value}"));
        let values: Vec<_> = values.collect();
        if values.is_empty() {
            return Ok(());
        }
        run(device, format!("--set-ctrl={}", values.join(","))).await.map(drop)
    }

    /// Parses the output of `v4l2-ctl --list-ctrls`.
    fn parse(listed: &str) -> Controls {
        let [pan, tilt, zoom] = NAMES.map(|name| {
            listed.lines().find_map(|line| {
                let (head, values) = line.split_once(" : ")?;
                (head.split_whitespace().next() == Some(name)).then(|| Control::parse(values))?
            })
        });
        Controls { pan, tilt, zoom }
    }

    /// Whether a position can be reached: a motor that is missing must not be needed.
    pub(super) fn reaches(&self, to: Position) -> bool {
        self.values(to).is_some()
    }

    /// Returns the names and values of the controls for a position; `None` if one is missing.
    fn values(&self, to: Position) -> Option<impl Iterator<Item = (&'static str, i64)>> {
        // Pan and tilt are from -1 to 1, zoom is from 0 to 1.
        let axes = [
            (self.pan, (to.pan + 1.0) / 2.0, 0.5),
            (self.tilt, (to.tilt + 1.0) / 2.0, 0.5),
            (self.zoom, to.zoom, 0.0),
        ];
        let is_missing = |(control, share, rest): &(Option<Control>, f64, f64)| {
            control.is_none() && share != rest
        };
        if axes.iter().any(is_missing) {
            return None;
        }
        let values = NAMES.into_iter().zip(axes);
        Some(values.filter_map(|(name, (control, share, _))| Some((name, control?.at(share)))))
    }

    /// Returns the position of the camera, as `v4l2-ctl` has told it.
    pub(super) fn position(&self) -> Position {
        let share = |control: Option<Control>| control.map(Control::share);
        Position {
            pan: share(self.pan).map_or(0.0, |share| share * 2.0 - 1.0),
            tilt: share(self.tilt).map_or(0.0, |share| share * 2.0 - 1.0),
            zoom: share(self.zoom).unwrap_or(0.0),
        }
    }

    /// Whether the camera, as it was read, is at a position, within the steps of its motors.
    pub(super) fn is_at(&self, position: Position) -> bool {
        let now = [self.pan, self.tilt, self.zoom].into_iter().flatten().map(|one| one.value);
        let expected = self.values(position).map(|values| values.map(|(_, value)| value));
        expected.is_some_and(|expected| expected.eq(now))
    }
}

impl Control {
    /// Parses `min=… max=… step=… default=… value=…`; `None` if the control cannot be used.
    fn parse(values: &str) -> Option<Control> {
        let number = |key: &str| -> Option<i64> {
            let found = values.split_whitespace().find_map(|pair| pair.strip_prefix(key));
            found?.parse().ok()
        };
        let (least, greatest) = (number("min=")?, number("max=")?);
        let step = number("step=").filter(|step| *step > 0).unwrap_or(1);
        let value = number("value=")?;
        let is_usable = least < greatest
            && i32::try_from(least).is_ok()
            && i32::try_from(greatest).is_ok()
            && !values.contains("inactive");
        is_usable.then_some(Control { least, greatest, step, value })
    }

    /// Returns the value at a share of the range, on a step.
    fn at(self, share: f64) -> i64 {
        let range = (self.greatest - self.least) as f64;
        let steps = (share.clamp(0.0, 1.0) * range / self.step as f64).round() as i64;
        (self.least + steps * self.step).min(self.greatest)
    }

    /// Returns the share of the range at which the control is.
    fn share(self) -> f64 {
        (self.value - self.least) as f64 / (self.greatest - self.least) as f64
    }
}

async fn run(device: &str, argument: String) -> Result<String, String> {
    let command = [V4L2_CTL.to_owned(), "--device".to_owned(), device.to_owned(), argument];
    let program = Program::of(command).ok_or("run v4l2-ctl without a name")?;
    program.run(TIME_MAX).await.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In the form that v4l-utils 1.22 prints, with the values of a conference camera.
    const LISTED: &str = "
User Controls

                     brightness 0x00980900 (int)    : min=0 max=255 step=1 default=128 value=128
        white_balance_automatic 0x0098090c (bool)   : default=1 value=1
           power_line_frequency 0x00980918 (menu)   : min=0 max=2 default=2 value=2 (60 Hz)

Camera Controls

                  auto_exposure 0x009a0901 (menu)   : min=0 max=3 default=3 value=3 (Aperture)
         exposure_time_absolute 0x009a0902 (int)    : min=3 max=2047 step=1 default=250 value=250 flags=inactive
                   pan_absolute 0x009a0908 (int)    : min=-36000 max=36000 step=3600 default=0 value=7200
                  tilt_absolute 0x009a0909 (int)    : min=-36000 max=36000 step=3600 default=0 value=0
                  zoom_absolute 0x009a090d (int)    : min=100 max=500 step=1 default=100 value=200
";

    #[test]
    fn controls_are_read_and_positions_are_values_on_their_steps() {
        let controls = Controls::parse(LISTED);
        let position = controls.position();
        assert!(position.is(&Position { pan: 0.2, tilt: 0.0, zoom: 0.25 }), "{position:?}");
        for (to, expected) in [
            ((-1.0, 1.0, 0.0), [-36_000, 36_000, 100]),
            ((0.23, 0.0, 1.0), [7_200, 0, 500]),
            ((0.2, 0.0, 0.25), [7_200, 0, 200]),
        ] {
            let to = Position { pan: to.0, tilt: to.1, zoom: to.2 };
            let values: Vec<_> = controls.values(to).expect("it has all").collect();
            assert_eq!(values, NAMES.into_iter().zip(expected).collect::<Vec<_>>());
            assert_eq!(controls.is_at(to), expected == [7_200, 0, 200]);
        }
    }

    #[test]
    fn a_camera_without_motors_reaches_its_only_direction() {
        let ahead = Position::default();
        for listed in ["", "garbage : x", "pan_absolute 0x1 (int) : min=5 max=5 step=0 value=5"] {
            let controls = Controls::parse(listed);
            assert_eq!(controls, Controls::default());
            assert!(controls.reaches(ahead) && controls.is_at(ahead));
            assert!(!controls.reaches(Position { pan: 0.5, ..ahead }));
        }
        let huge =
            "zoom_absolute 0x1 (int) : min=-9223372036854775808 max=9223372036854775807 value=0";
        assert_eq!(Controls::parse(huge), Controls::default());
    }
}
