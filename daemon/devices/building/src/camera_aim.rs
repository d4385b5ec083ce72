//! The aim of a camera, its limits, and the test whether a direction is in the field of view.

use serde::{Deserialize, Serialize};

use crate::layout::PlaceDirection;

/// Limits of pan and tilt in degrees, and of zoom: those of a small dome camera.
const PAN_MAX: f64 = 170.0;
const TILT_MAX: f64 = 90.0;
const ZOOM_MAX: f64 = 10.0;

/// Horizontal and vertical field of view without zoom, in degrees.
const WIDTH: f64 = 60.0;
const HEIGHT: f64 = 40.0;

/// The direction and the zoom of a camera.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CameraAim {
    /// Pan angle of the camera, in degrees to the right; negative to the left.
    pub pan: f64,
    /// Tilt angle of the camera, in degrees up; negative down.
    pub tilt: f64,
    /// Magnification of the camera; 1 is no magnification.
    pub zoom: f64,
}

impl Default for CameraAim {
    fn default() -> CameraAim {
        CameraAim { pan: 0.0, tilt: 0.0, zoom: 1.0 }
    }
}

impl CameraAim {
    /// Whether the angles and the zoom are within the limits of a camera.
    pub fn is_possible(&self) -> bool {
        (-PAN_MAX..=PAN_MAX).contains(&self.pan)
            && (-TILT_MAX..=TILT_MAX).contains(&self.tilt)
            && (1.0..=ZOOM_MAX).contains(&self.zoom)
    }

    /// Returns the position of `view` in the picture: to the right and up, each from -1 to 1.
    /// Returns `None` if the place of `view` is outside the picture.
    pub(crate) fn sees(&self, view: &PlaceDirection) -> Option<(f64, f64)> {
        let right = (view.pan - self.pan) * self.zoom / (WIDTH / 2.0);
        let up = (view.tilt - self.tilt) * self.zoom / (HEIGHT / 2.0);
        (right.abs() <= 1.0 && up.abs() <= 1.0).then_some((right, up))
    }
}
