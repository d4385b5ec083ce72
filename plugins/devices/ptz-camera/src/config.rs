//! The `config` of a camera's entry, and the resulting settings.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use acl::content::{Achieve, Keep};
use actuator::{PlaceName, StateFolder};
use agent::{Blueprint, BuildCheck, BuildError};
use serde::Deserialize;

use onvif_link::{CameraAccess, Position};

use crate::ONVIF;
use crate::album::Album;
use crate::onvif::{OnvifSettings, Target};
use crate::position::{PTZ, PtzPosition};

/// Maximum length of a recording, in seconds; a config with a greater length is invalid. The file
/// of a recording of this length has about 10 MB.
const RECORD_MAX: f64 = 60.0;

/// The `config` of a camera's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Place where the camera is mounted.
    location: PlaceName,
    /// Presets of the camera, by name.
    presets: BTreeMap<String, RawPreset>,
    /// Folder of pictures and videos. Without this key, it is the folder `pictures` in the daemon's
    /// state folder.
    #[serde(default)]
    folder: Option<PathBuf>,
    /// Maximum number of pictures, and likewise of videos. If there are more, the oldest are
    /// deleted.
    #[serde(default = "default_keep")]
    keep: usize,
    /// Length of a recording, in seconds.
    #[serde(default)]
    record_seconds: Option<f64>,
    /// Time for which a picture counts as known, such as `"10min"`. Without this key, the time is not
    /// limited.
    #[serde(default)]
    valid_for: Option<String>,
    /// Whether the camera watches for motion.
    #[serde(default = "default_motion")]
    motion: bool,
    /// Time for which the fact `motion` stays true after the last motion, such as `"30s"`.
    #[serde(default = "default_motion_for")]
    motion_for: String,
    /// Share of the picture that must change to count as motion, between 0 and 1; not for the
    /// driver `onvif`.
    #[serde(default)]
    sensitivity: Option<f64>,
    /// Goal that the camera requests when it detects motion; `None` if it requests none.
    #[serde(default)]
    on_motion: Option<RawMotionGoal>,
    /// Address of a camera with the driver `onvif`, such as `10.0.0.9` or `https://camera.local`.
    #[serde(default)]
    address: Option<String>,
    /// User name of the login at the camera.
    #[serde(default)]
    user: Option<String>,
    /// File with the password of the user.
    #[serde(default)]
    password_file: Option<PathBuf>,
    /// File with the camera's certificate, or those of the trusted authorities.
    #[serde(default)]
    ca: Option<PathBuf>,
    /// SHA-256 fingerprint of the camera's certificate, in hexadecimal digits.
    #[serde(default)]
    fingerprint: Option<String>,
    /// Time after which a camera counts as arrived if it does not report whether it moves, such as
    /// `"4s"`.
    #[serde(default)]
    settle: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawPreset {
    /// Place of the map that the camera shows at this preset.
    shows: PlaceName,
    pan: Option<f64>,
    tilt: Option<f64>,
    zoom: Option<f64>,
    /// Name of the preset that is stored in a camera with the driver `onvif`.
    preset: Option<String>,
    /// Position of a camera with the driver `onvif` that stores no presets: pan, tilt and zoom in
    /// ONVIF's generic units.
    position: Option<[f64; 3]>,
}

/// A goal that the camera requests; `?l` in the goal is replaced by the place of the motion.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawMotionGoal {
    goal: String,
    #[serde(default)]
    priority: i32,
}

fn default_keep() -> usize {
    50
}

/// Default of `record-seconds`.
const RECORD_SECONDS: f64 = 5.0;

/// Default of `sensitivity`. It is less than a hundredth of the picture, because a person in full
/// view takes at least a hundredth.
const SENSITIVITY: f64 = 0.004;

/// Default of `settle`. Slow cameras turn by 45 degrees a second.
const SETTLE: Duration = Duration::from_secs(4);

/// Maximum of `settle`; the time limit for turning is longer.
const SETTLE_MAX: Duration = Duration::from_secs(20);

fn default_motion() -> bool {
    true
}

fn default_motion_for() -> String {
    "30s".to_owned()
}

/// The settings of a camera, read from its config.
pub(crate) struct CameraSettings {
    /// The place that each preset shows, by the name of the preset.
    pub(crate) presets: BTreeMap<String, String>,
    pub(crate) album: Album,
    pub(crate) recording: Duration,
    pub(crate) valid_for: Option<Duration>,
    pub(crate) motion: Option<Motion>,
}

/// Settings for the detection of motion.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    pub(crate) lasts: Duration,
    on_motion: Option<(String, i32)>,
}

impl Motion {
    /// Returns the goal to request after motion at `place`; `None` if the config has no goal.
    pub(crate) fn goal(&self, place: &str) -> Option<Achieve> {
        let (goal, priority) = self.on_motion.as_ref()?;
        let goal = goal.replace("?l", place);
        Some(Achieve::new(goal, Keep::Achieve, *priority))
    }
}

/// The settings of a camera's driver.
pub(crate) enum DriverSettings {
    /// The driver `onvif`, for a camera of the network.
    Onvif(OnvifSettings),
    /// The driver `simulated`, for a camera that gives single frames: the direction of each preset,
    /// and the share of the picture that must change to count as motion; `None` if the camera does
    /// not watch for motion.
    Frames(BTreeMap<String, PtzPosition>, Option<f64>),
}

impl Config {
    /// Returns the settings from the config. Returns an error if the config is invalid.
    pub(crate) fn understand(
        self,
        blueprint: &Blueprint,
    ) -> Result<(CameraSettings, DriverSettings), BuildError> {
        let Config { location: _, presets, folder, keep, record_seconds, .. } = &self;
        let problem = |text: String| blueprint.problem(text);
        if presets.is_empty() {
            return Err(problem("`presets` needs one direction at least".to_owned()));
        }
        let record_seconds = record_seconds.unwrap_or(RECORD_SECONDS);
        if !(0.2..=RECORD_MAX).contains(&record_seconds) || *keep == 0 {
            let text = format!("record-seconds is 0.2 to {RECORD_MAX}, and keep at least 1");
            return Err(problem(text));
        }
        let resources = &blueprint.host.resources;
        let beside_state = || resources.get::<StateFolder>().map(|state| state.0.join("pictures"));
        // In a check of the build no pictures are taken, so that no folder is needed.
        let nowhere = || resources.get::<BuildCheck>().map(|_| PathBuf::new());
        let folder = folder.clone().or_else(beside_state).or_else(nowhere);
        let folder = folder.ok_or_else(|| problem("pictures need a `folder`".to_owned()))?;
        let driver = match blueprint.driver == ONVIF {
            true => DriverSettings::Onvif(self.onvif().map_err(problem)?),
            false => self.frames().map_err(problem)?,
        };
        let settings = CameraSettings {
            album: Album::new(folder, blueprint.id.to_string(), *keep),
            recording: Duration::from_secs_f64(record_seconds),
            valid_for: self.valid_for.as_deref().map(duration).transpose().map_err(problem)?,
            motion: self.motion().map_err(problem)?,
            presets: self.places().map_err(problem)?,
        };
        Ok((settings, driver))
    }

    fn motion(&self) -> Result<Option<Motion>, String> {
        if !self.motion {
            return Ok(None);
        }
        let lasts = duration(&self.motion_for)?;
        let on_motion = self.on_motion.as_ref().map(|raw| (raw.goal.clone(), raw.priority));
        if let Some((goal, _)) = &on_motion
            && !pddl::parse_condition(&goal.replace("?l", self.location.as_str())).is_ok()
        {
            return Err(format!("on-motion.goal `{goal}` is no PDDL condition"));
        }
        Ok(Some(Motion { lasts, on_motion }))
    }

    /// Returns the place that each preset shows.
    fn places(&self) -> Result<BTreeMap<String, String>, String> {
        let understand = |(name, raw): (&String, &RawPreset)| {
            let name = PlaceName::try_from(name.clone()).map_err(|error| error.to_string())?;
            Ok((name.to_string(), raw.shows.to_string()))
        };
        self.presets.iter().map(understand).collect()
    }

    /// Returns the settings of the driver `simulated`.
    fn frames(&self) -> Result<DriverSettings, String> {
        let Config { address, user, password_file, ca, fingerprint, settle, .. } = self;
        let foreign = [
            ("address", address.is_some()),
            ("user", user.is_some()),
            ("password-file", password_file.is_some()),
            ("ca", ca.is_some()),
            ("fingerprint", fingerprint.is_some()),
            ("settle", settle.is_some()),
        ];
        if let Some((key, _)) = foreign.iter().find(|(_, is_there)| *is_there) {
            return Err(format!("`{key}` is for `driver = \"onvif\"`"));
        }
        let sensitivity = self.sensitivity.unwrap_or(SENSITIVITY);
        if !(sensitivity > 0.0 && sensitivity < 1.0) {
            return Err("sensitivity is a share of the picture, between 0 and 1".to_owned());
        }
        let direction = |(name, raw): (&String, &RawPreset)| {
            if raw.preset.is_some() || raw.position.is_some() {
                return Err(format!(
                    "the preset `{name}`: `preset` and `position` are for `driver = \"onvif\"`; \
                     write `pan`, `tilt` and `zoom`"
                ));
            }
            let aim = PtzPosition {
                pan: raw.pan.unwrap_or(0.0),
                tilt: raw.tilt.unwrap_or(0.0),
                zoom: raw.zoom.unwrap_or(1.0),
            };
            if !PTZ.allows(aim) {
                return Err(format!("the preset `{name}` is out of reach: {PTZ}"));
            }
            Ok((name.clone(), aim))
        };
        let directions = self.presets.iter().map(direction).collect::<Result<_, String>>()?;
        Ok(DriverSettings::Frames(directions, self.motion.then_some(sensitivity)))
    }

    /// Returns the settings of the driver `onvif`.
    fn onvif(&self) -> Result<OnvifSettings, String> {
        let Config { address, user, password_file, ca, fingerprint, .. } = self;
        let Some(address) = address else {
            return Err("driver `onvif` needs the `address` of the camera, such as \"10.0.0.9\"; \
                        `althing agents --discovered` lists the cameras that a `camera-finder` sees"
                .to_owned());
        };
        if self.sensitivity.is_some() {
            return Err(
                "`sensitivity`: a camera with the driver `onvif` decides by itself what is \
                        motion; set it in the camera's own settings"
                    .to_owned(),
            );
        }
        if self.record_seconds.is_some() {
            return Err(
                "`record-seconds`: the driver `onvif` takes pictures, and records no videos"
                    .to_owned(),
            );
        }
        let access = CameraAccess::new(
            address,
            user.clone(),
            password_file.clone(),
            ca.clone(),
            fingerprint.as_deref(),
        )?;
        let settle = self.settle.as_deref().map(duration).transpose()?.unwrap_or(SETTLE);
        if settle > SETTLE_MAX {
            return Err(format!("settle is at most {SETTLE_MAX:?}"));
        }
        let targets = self.presets.iter().map(|(name, raw)| Ok((name.clone(), target(name, raw)?)));
        let targets = targets.collect::<Result<_, String>>()?;
        Ok(OnvifSettings { access, targets, settle, watches_motion: self.motion })
    }
}

/// Returns the preset or the position in the camera for a preset of the config with the driver
/// `onvif`.
fn target(name: &str, raw: &RawPreset) -> Result<Target, String> {
    let RawPreset { shows, pan, tilt, zoom, preset, position } = raw;
    if pan.or(*tilt).or(*zoom).is_some() {
        return Err(format!(
            "the preset `{name}`: `pan`, `tilt` and `zoom` are degrees of a simulated camera; store \
             the direction in the camera with its own app, and write preset = \"NAME\""
        ));
    }
    match (preset, position) {
        (Some(_), Some(_)) => {
            Err(format!("the preset `{name}`: write `preset` or `position`, and not both"))
        }
        (Some(preset), None) if preset.trim().is_empty() => {
            Err(format!("the preset `{name}`: `preset` is empty; write its name in the camera"))
        }
        (Some(preset), None) => Ok(Target::Preset(preset.trim().to_owned())),
        (None, Some([pan, tilt, zoom])) => {
            let position = Position { pan: *pan, tilt: *tilt, zoom: *zoom };
            let is_possible = (-1.0..=1.0).contains(pan)
                && (-1.0..=1.0).contains(tilt)
                && (0.0..=1.0).contains(zoom);
            if !is_possible {
                return Err(format!(
                    "the preset `{name}`: `position` is pan and tilt from -1 to 1, zoom from 0 to 1"
                ));
            }
            Ok(Target::Position(position))
        }
        (None, None) => Err(format!(
            "the preset `{name}` shows `{shows}`, but names no direction of the camera: store it in \
             the camera with its own app, and write preset = \"NAME\""
        )),
    }
}

fn duration(text: &str) -> Result<Duration, String> {
    humantime::parse_duration(text).map_err(|error| format!("`{text}`: {error}"))
}
