//! The `config` of a camera's entry, and the resulting settings; `drivers` has those of each driver.

mod drivers;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use acl::content::{Achieve, Keep};
use actuator::{PlaceName, StateFolder};
use agent::{Blueprint, BuildCheck, BuildError, config_duration, config_tables, config_validity};
use serde::Deserialize;

use crate::album::Album;
use crate::motion::MotionSettings;
use crate::onvif::OnvifSettings;
use crate::position::PtzPosition;
use crate::v4l2::V4l2Settings;
use crate::{MOTION, ONVIF, V4L2};

/// Minimum and maximum of the time for which motion counts after it was noticed.
const MOTION_FOR_MIN: Duration = Duration::from_millis(1);
const MOTION_FOR_MAX: Duration = Duration::from_hours(24);

/// Maximum length of a recording, in seconds; a config with a greater length is invalid. The file
/// of a recording of this length has about 10 MB.
const RECORD_MAX: f64 = 60.0;

/// The `config` of a camera's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Place where the camera is mounted.
    location: PlaceName,
    /// Presets of the camera, by name. A camera that cannot turn needs none.
    #[serde(default)]
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
    /// Share of the picture that must change to count as motion, between 0 and 1; for the drivers
    /// `simulated` and `v4l2`.
    #[serde(default)]
    sensitivity: Option<f64>,
    /// Goal that the camera requests when it detects motion; `None` if it requests none.
    #[serde(default)]
    on_motion: Option<RawMotionGoal>,
    /// Address of a camera with the driver `onvif`, such as `10.0.0.9` or `https://camera.local`; of
    /// the port for questions of a Motion that runs by itself.
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
    /// Camera of a Motion that the daemon runs: an address such as `rtsp://10.0.0.9/1`, or a file
    /// such as `/dev/video0`.
    #[serde(default)]
    source: Option<String>,
    /// Options of a Motion that the daemon runs.
    #[serde(default)]
    settings: Option<BTreeMap<String, RawOption>>,
    /// Address of the port for pictures of a Motion that runs by itself.
    #[serde(default)]
    pictures: Option<String>,
    /// Number of the camera in a Motion that runs by itself.
    #[serde(default)]
    camera: Option<u32>,
    /// Named pipe into which the hooks of a Motion write that runs by itself.
    #[serde(default)]
    events: Option<PathBuf>,
    /// File of a camera with the driver `v4l2`, such as `/dev/video0`.
    #[serde(default)]
    device: Option<String>,
    /// Size of the pictures of a camera with the driver `v4l2`, such as `"1280x720"`.
    #[serde(default)]
    size: Option<String>,
}

/// The value of an option of Motion.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum RawOption {
    Switch(bool),
    Number(f64),
    Text(String),
}

#[derive(Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
struct RawPreset {
    /// Place of the map that the camera shows at this preset.
    shows: PlaceName,
    pan: Option<f64>,
    tilt: Option<f64>,
    zoom: Option<f64>,
    /// Name of the preset that is stored in a camera with the driver `onvif`.
    preset: Option<String>,
    /// Position of a camera with the driver `v4l2`, or `onvif` without stored presets: pan, tilt and
    /// zoom in ONVIF's generic units.
    position: Option<[f64; 3]>,
}

/// A goal that the camera requests; `?l` in the goal is replaced by the place of the motion.
#[derive(Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
struct RawMotionGoal {
    goal: String,
    #[serde(default)]
    priority: i32,
}

config_tables!(RawPreset, RawMotionGoal);

fn default_keep() -> usize {
    50
}

/// Name of the only preset of a camera that cannot turn, if the config has none.
const AHEAD: &str = "ahead";

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
        Some(Achieve::new(goal_at(goal, place), Keep::Achieve, *priority))
    }
}

/// Returns a goal with `place` for each variable `?l`. The variable `?lamp` is another one.
pub fn goal_at(goal: &str, place: &str) -> String {
    const PLACE: &str = "?l";
    let is_of_name = |symbol: char| symbol.is_ascii_alphanumeric() || "-_".contains(symbol);
    let (mut filled, mut done) = (String::new(), 0);
    // PDDL does not distinguish capitals.
    for (start, _) in goal.to_ascii_lowercase().match_indices(PLACE) {
        let end = start + PLACE.len();
        if !goal[end..].starts_with(is_of_name) {
            filled += &goal[done..start];
            filled += place;
            done = end;
        }
    }
    filled + &goal[done..]
}

/// The settings of a camera's driver.
pub(crate) enum DriverSettings {
    /// The driver `onvif`, for a camera of the network.
    Onvif(OnvifSettings),
    /// The driver `simulated`, for a camera that gives single frames: the direction of each preset,
    /// and the share of the picture that must change to count as motion; `None` if the camera does
    /// not watch for motion.
    Frames(BTreeMap<String, PtzPosition>, Option<f64>),
    /// The driver `motion`, for a camera that Motion watches.
    Motion(MotionSettings),
    /// The driver `v4l2`, for a USB camera.
    V4l2(V4l2Settings),
}

impl Config {
    /// Returns the settings from the config. Returns an error if the config is invalid.
    pub(crate) fn understand(
        mut self,
        blueprint: &Blueprint,
    ) -> Result<(CameraSettings, DriverSettings), BuildError> {
        let problem = |text: String| blueprint.problem(text);
        let driver = blueprint.driver.as_str();
        if self.presets.is_empty() {
            if ![MOTION, V4L2].contains(&driver) {
                return Err(problem("`presets` needs one direction at least".to_owned()));
            }
            let shows = self.location.clone();
            let ahead = RawPreset {
                shows,
                pan: None,
                tilt: None,
                zoom: None,
                preset: None,
                position: None,
            };
            self.presets.insert(AHEAD.to_owned(), ahead);
        }
        drivers::check_keys(&self, driver).map_err(problem)?;
        let Config { folder, keep, record_seconds, .. } = &self;
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
        let state = resources.get::<StateFolder>().map(|state| state.0.clone());
        let driver = match driver {
            ONVIF => self.onvif(),
            MOTION => self.motion_program(blueprint.id.to_string(), state),
            V4L2 => self.v4l2(),
            _ => self.frames(),
        };
        let driver = driver.map_err(problem)?;
        let validity = |text| config_validity("valid-for", text);
        let settings = CameraSettings {
            album: Album::new(folder, blueprint.id.to_string(), *keep),
            recording: Duration::from_secs_f64(record_seconds),
            valid_for: self.valid_for.as_deref().map(validity).transpose().map_err(problem)?,
            motion: self.motion().map_err(problem)?,
            presets: self.places().map_err(problem)?,
        };
        Ok((settings, driver))
    }

    fn motion(&self) -> Result<Option<Motion>, String> {
        if !self.motion {
            return match self.on_motion {
                Some(_) => {
                    Err("`on-motion` needs the detection of motion: leave `motion = false` out"
                        .to_owned())
                }
                None => Ok(None),
            };
        }
        let lasts =
            config_duration("motion-for", &self.motion_for, MOTION_FOR_MIN..=MOTION_FOR_MAX)?;
        let on_motion = self.on_motion.as_ref().map(|raw| (raw.goal.clone(), raw.priority));
        if let Some((goal, _)) = &on_motion
            && !pddl::parse_condition(&goal_at(goal, self.location.as_str())).is_ok()
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_whole_variable_is_the_place() {
        for (goal, expected) in [
            ("(known-picture ?l)", "(known-picture hall)"),
            ("(known-picture ?L)", "(known-picture hall)"),
            ("(and (recorded ?l)(motion ?l))", "(and (recorded hall)(motion hall))"),
            ("(forall (?lamp - lamp) (lit ?lamp))", "(forall (?lamp - lamp) (lit ?lamp))"),
            ("?l", "hall"),
        ] {
            assert_eq!(goal_at(goal, "hall"), expected);
        }
    }
}
