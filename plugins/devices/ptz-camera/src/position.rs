//! Directions of a camera in degrees, and their limits.

/// Limits for the direction and zoom of a camera.
pub(crate) struct PtzLimits {
    pub(crate) pan: f64,
    pub(crate) tilt: f64,
    pub(crate) zoom: f64,
}

/// Limits of common dome cameras.
pub(crate) const PTZ: PtzLimits = PtzLimits { pan: 170.0, tilt: 90.0, zoom: 10.0 };

/// The direction and the zoom of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PtzPosition {
    /// Pan angle of the camera, in degrees to the right; negative to the left.
    pub pan: f64,
    /// Tilt angle of the camera, in degrees up; negative down.
    pub tilt: f64,
    /// Magnification of the camera; 1 is no magnification.
    pub zoom: f64,
}

impl PtzLimits {
    pub(crate) fn allows(&self, aim: PtzPosition) -> bool {
        (-self.pan..=self.pan).contains(&aim.pan)
            && (-self.tilt..=self.tilt).contains(&aim.tilt)
            && (1.0..=self.zoom).contains(&aim.zoom)
    }
}

impl std::fmt::Display for PtzLimits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let PtzLimits { pan, tilt, zoom } = self;
        write!(f, "pan -{pan} to {pan}, tilt -{tilt} to {tilt} degrees, zoom 1 to {zoom}")
    }
}

impl PtzPosition {
    /// Whether `other` is the same direction and zoom, within the precision of the motors.
    pub(crate) fn is(&self, other: &PtzPosition) -> bool {
        (self.pan - other.pan).abs() < 0.5
            && (self.tilt - other.tilt).abs() < 0.5
            && (self.zoom - other.zoom).abs() < 0.05
    }
}
