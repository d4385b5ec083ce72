//! The `config` of a camera's entry, and the resulting settings.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use acl::content::{Achieve, Keep};
use actuator::{PlaceName, StateFolder};
use agent::{Blueprint, BuildCheck, BuildError};
use serde::Deserialize;

use crate::album::Album;
use crate::{PTZ, PtzPosition};

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
    /// Folder of pictures and videos; without this key, the folder `pictures` in the daemon's state
    /// folder.
    #[serde(default)]
    folder: Option<PathBuf>,
    /// Maximum number of pictures and maximum number of videos that are kept; of more, the oldest
    /// are deleted.
    #[serde(default = "default_keep")]
    keep: usize,
    /// Length of a recording, in seconds.
    #[serde(default = "default_record_seconds")]
    record_seconds: f64,
    /// Time for which a picture counts as known, such as `"10m"`. Without this key, the time is not
    /// limited.
    #[serde(default)]
    valid_for: Option<String>,
    /// Whether the camera watches for motion.
    #[serde(default = "default_motion")]
    motion: bool,
    /// Time for which the fact `motion` stays true after the last motion, such as `"30s"`.
    #[serde(default = "default_motion_for")]
    motion_for: String,
    /// Share of the picture that must change to count as motion, between 0 and 1.
    #[serde(default = "default_sensitivity")]
    sensitivity: f64,
    /// Goal that the camera requests when it detects motion; `None` if it requests none.
    #[serde(default)]
    on_motion: Option<RawMotionGoal>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawPreset {
    /// Place of the map that is in view in this direction.
    shows: PlaceName,
    #[serde(default)]
    pan: f64,
    #[serde(default)]
    tilt: f64,
    #[serde(default = "default_zoom")]
    zoom: f64,
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

fn default_record_seconds() -> f64 {
    5.0
}

fn default_motion() -> bool {
    true
}

fn default_motion_for() -> String {
    "30s".to_owned()
}

/// Returns the default of `sensitivity`. The default is less than a hundredth of the picture,
/// because a person in full view takes at least a hundredth.
fn default_sensitivity() -> f64 {
    0.004
}

fn default_zoom() -> f64 {
    1.0
}

/// A named direction of a camera, and the place that is in view in this direction.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Preset {
    pub(crate) shows: String,
    pub(crate) aim: PtzPosition,
}

/// The settings of a camera, read from its config.
pub(crate) struct CameraSettings {
    pub(crate) presets: BTreeMap<String, Preset>,
    pub(crate) album: Album,
    pub(crate) recording: Duration,
    pub(crate) valid_for: Option<Duration>,
    pub(crate) motion: Option<Motion>,
}

/// Settings for the detection of motion.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    pub(crate) lasts: Duration,
    pub(crate) sensitivity: f64,
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

impl Config {
    /// Returns the settings from the config. Returns an error if the config is invalid.
    pub(crate) fn understand(self, blueprint: &Blueprint) -> Result<CameraSettings, BuildError> {
        let Config { location: _, presets, folder, keep, record_seconds, .. } = &self;
        let problem = |text: String| blueprint.problem(text);
        if presets.is_empty() {
            return Err(problem("`presets` needs one direction at least".to_owned()));
        }
        if !(0.2..=RECORD_MAX).contains(record_seconds) || *keep == 0 {
            let text = format!("record-seconds is 0.2 to {RECORD_MAX}, and keep at least 1");
            return Err(problem(text));
        }
        let resources = &blueprint.host.resources;
        let beside_state = || resources.get::<StateFolder>().map(|state| state.0.join("pictures"));
        // In a check of the build no pictures are taken, so that no folder is needed.
        let nowhere = || resources.get::<BuildCheck>().map(|_| PathBuf::new());
        let folder = folder.clone().or_else(beside_state).or_else(nowhere);
        let folder = folder.ok_or_else(|| problem("pictures need a `folder`".to_owned()))?;
        Ok(CameraSettings {
            album: Album::new(folder, blueprint.id.to_string(), *keep),
            recording: Duration::from_secs_f64(*record_seconds),
            valid_for: self.valid_for.as_deref().map(duration).transpose().map_err(problem)?,
            motion: self.motion().map_err(problem)?,
            presets: self.presets().map_err(problem)?,
        })
    }

    fn motion(&self) -> Result<Option<Motion>, String> {
        if !self.motion {
            return Ok(None);
        }
        if !(self.sensitivity > 0.0 && self.sensitivity < 1.0) {
            return Err("sensitivity is a share of the picture, between 0 and 1".to_owned());
        }
        let lasts = duration(&self.motion_for)?;
        let on_motion = self.on_motion.as_ref().map(|raw| (raw.goal.clone(), raw.priority));
        if let Some((goal, _)) = &on_motion
            && !pddl::parse_condition(&goal.replace("?l", self.location.as_str())).is_ok()
        {
            return Err(format!("on-motion.goal `{goal}` is no PDDL condition"));
        }
        Ok(Some(Motion { lasts, sensitivity: self.sensitivity, on_motion }))
    }

    fn presets(&self) -> Result<BTreeMap<String, Preset>, String> {
        let understand = |(name, raw): (&String, &RawPreset)| {
            let name = PlaceName::try_from(name.clone()).map_err(|error| error.to_string())?;
            let aim = PtzPosition { pan: raw.pan, tilt: raw.tilt, zoom: raw.zoom };
            if !PTZ.allows(aim) {
                return Err(format!("the preset `{name}` is out of reach: {PTZ}"));
            }
            Ok((name.to_string(), Preset { shows: raw.shows.to_string(), aim }))
        };
        self.presets.iter().map(understand).collect()
    }
}

fn duration(text: &str) -> Result<Duration, String> {
    humantime::parse_duration(text).map_err(|error| format!("`{text}`: {error}"))
}
