//! The PTZ camera (the paper, “PTZ Camera”): “can move (PTZ), record video, snap pictures, and
//! detect motion”.
//!
//! - [`Camera`] is the trait of drivers; `simulated` is the driver for the simulated building.
//! - The camera turns to presets, and by small steps in any direction. Each picture or video is a
//!   file in the camera's `album`. The existence of a picture or a video of a place is a fact.
//! - The camera detects motion. Motion is announced at once, and may make the camera request a
//!   goal.
//! - If the camera does not look in the direction that the plan assumes, taking a picture fails.

mod album;
mod config;
mod frame;
mod motion_watch;
mod simulated;
mod tasks;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Methods};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use tokio::time::Instant;

use config::{CameraSettings, Config};
pub use frame::Frame;
use tasks::CameraResult;

/// Pause after a failure, during which a camera offers no actions.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// Time limit for turning, and for taking one picture.
const ACTING_TIME_MAX: Duration = Duration::from_secs(15);

/// The entry of the PTZ camera in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "ptz-camera",
    about: "turns, zooms, takes pictures, records, and says when something moves",
    drivers: &["simulated"],
    has_replicas: false,
    build,
};

/// Limits for the direction and zoom of a camera.
struct PtzLimits {
    pan: f64,
    tilt: f64,
    zoom: f64,
}

/// Limits of common dome cameras.
const PTZ: PtzLimits = PtzLimits { pan: 170.0, tilt: 90.0, zoom: 10.0 };

/// Steps by which a person turns the camera: name of the action, degrees of pan, degrees of tilt,
/// and factor of zoom.
const STEPS: [(&str, f64, f64, f64); 6] = [
    ("pan-left", -10.0, 0.0, 1.0),
    ("pan-right", 10.0, 0.0, 1.0),
    ("tilt-up", 0.0, 5.0, 1.0),
    ("tilt-down", 0.0, -5.0, 1.0),
    ("zoom-in", 0.0, 0.0, 1.25),
    ("zoom-out", 0.0, 0.0, 0.8),
];

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

/// The driver of a camera.
pub trait Camera: Send + Sync + 'static {
    /// Turns and zooms the camera. Error texts complete “failed to …”. Dropping the future stops
    /// the camera.
    fn aim(&self, aim: PtzPosition) -> BoxFuture<Result<(), String>>;

    /// Returns the present picture of the camera.
    fn frame(&self) -> BoxFuture<Result<Frame, String>>;
}

impl PtzLimits {
    fn allows(&self, aim: PtzPosition) -> bool {
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
    fn is(&self, other: &PtzPosition) -> bool {
        (self.pan - other.pan).abs() < 0.5
            && (self.tilt - other.tilt).abs() < 0.5
            && (self.zoom - other.zoom).abs() < 0.05
    }
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let settings = blueprint.config_as::<Config>()?.understand(&blueprint)?;
    let camera = PtzCamera {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        camera: simulated::camera(&blueprint)?,
        settings,
        aim: None,
        last_frame: None,
        pictures: BTreeMap::new(),
        recorded: BTreeSet::new(),
        motion: BTreeMap::new(),
        paused_until: None,
    };
    Actuator::build(&blueprint, camera)
}

struct PtzCamera {
    id: String,
    ontology: String,
    settings: CameraSettings,
    camera: Arc<dyn Camera>,
    /// Direction and zoom of the camera; `None` while they are unknown.
    aim: Option<PtzPosition>,
    /// The last picture of the camera, with which the next picture is compared.
    last_frame: Option<Frame>,
    /// Time of the last picture of each place.
    pictures: BTreeMap<String, Instant>,
    recorded: BTreeSet<String>,
    /// Time of the last motion in each place.
    motion: BTreeMap<String, Instant>,
    paused_until: Option<Instant>,
}

impl PtzCamera {
    fn is_available(&self) -> bool {
        self.paused_until.is_none_or(|until| until <= Instant::now())
    }

    /// Returns the name and the place of the preset of the present direction; `None` if this
    /// direction is not a preset.
    fn preset(&self) -> Option<(&str, &str)> {
        let aim = self.aim?;
        let mut presets = self.settings.presets.iter();
        let (name, preset) = presets.find(|(_, preset)| preset.aim.is(&aim))?;
        Some((name, &preset.shows))
    }

    /// Returns a fact that counts as known for the time `lasts` after `at`, or without a time limit
    /// if `lasts` is `None`. Returns an empty list if the time is over.
    fn passing(&self, fact: &str, at: Instant, lasts: Option<Duration>) -> Vec<OwnFact> {
        let known_for = lasts.map(|lasts| lasts.saturating_sub(at.elapsed()));
        if known_for.is_some_and(|left| left.is_zero()) {
            return Vec::new();
        }
        facts_of(fact).into_iter().map(|fact| OwnFact { known_for, ..fact }).collect()
    }

    fn lasting(&self) -> String {
        let mut text = String::new();
        for (name, preset) in &self.settings.presets {
            // Writing to memory cannot fail.
            let _ = write!(text, "(shows {} {name} {}) ", self.id, preset.shows);
        }
        text
    }

    fn actions() -> String {
        let mut text = "(:action look-at
                :agent ?c - ptz-camera
                :parameters (?p - preset ?l - location)
                :precondition (shows ?c ?p ?l)
                :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (looks-at ?c ?p)
                    (increase (total-cost) 1)))
            (:action take-snapshot
                :agent ?c - ptz-camera
                :parameters (?p - preset ?l - location)
                :precondition (and (looks-at ?c ?p) (shows ?c ?p ?l))
                :effect (and (known-picture ?l) (increase (total-cost) 1)))
            (:action record
                :agent ?c - ptz-camera
                :parameters (?p - preset ?l - location)
                :precondition (and (looks-at ?c ?p) (shows ?c ?p ?l))
                :effect (and (recorded ?l) (increase (total-cost) 2)))"
            .to_owned();
        for (name, ..) in STEPS {
            let _ = write!(
                text,
                "(:action {name}
                    :agent ?c - ptz-camera
                    :parameters ()
                    :effect (and (forall (?q - preset) (not (looks-at ?c ?q)))
                        (increase (total-cost) 1)))"
            );
        }
        text
    }

    fn methods(&self) -> Methods {
        let method = |name: &str, arguments: &[(&str, String)], timeout: Duration| Method {
            method: name.to_owned(),
            arguments: arguments
                .iter()
                .map(|(key, value)| ((*key).to_owned(), value.clone()))
                .collect(),
            timeout: Millis(timeout),
        };
        let preset = ("preset", "?p".to_owned());
        let at = [preset.clone(), ("place", "?l".to_owned())];
        let recording = ACTING_TIME_MAX + self.settings.recording * 2;
        let mut methods: Methods = [
            ("look-at".to_owned(), method("go_to_preset", &[preset], ACTING_TIME_MAX)),
            ("take-snapshot".to_owned(), method("take_picture", &at, ACTING_TIME_MAX)),
            ("record".to_owned(), method("record_video", &at, recording)),
        ]
        .into();
        for (name, pan, tilt, zoom) in STEPS {
            let by = [("pan", pan), ("tilt", tilt), ("zoom", zoom)];
            let by = by.map(|(key, value)| (key, value.to_string()));
            methods.insert(name.to_owned(), method("move_by", &by, ACTING_TIME_MAX));
        }
        methods
    }
}

impl Device for PtzCamera {
    type Yield = CameraResult;

    fn describe(&self) -> Description {
        let PtzCamera { id, ontology, settings, .. } = self;
        let presets: Vec<_> = settings.presets.keys().map(String::as_str).collect();
        let (presets, lasting) = (presets.join(" "), self.lasting());
        let offered = if self.is_available() { Self::actions() } else { String::new() };
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types ptz-camera - camera)
                (:objects {id} - ptz-camera {presets} - preset)
                (:init {lasting})
                {offered})"
        );
        Description { model: model_of(&text), methods: self.methods() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let mut facts = facts_of(&self.lasting());
        if let Some((preset, _)) = self.preset() {
            facts.extend(facts_of(&format!("(looks-at {} {preset})", self.id)));
        }
        for (place, at) in &self.pictures {
            let fact = format!("(known-picture {place})");
            facts.extend(self.passing(&fact, *at, self.settings.valid_for));
        }
        for place in &self.recorded {
            facts.extend(facts_of(&format!("(recorded {place})")));
        }
        let lasts = self.settings.motion.as_ref().map(|motion| motion.lasts);
        for (place, at) in &self.motion {
            facts.extend(self.passing(&format!("(motion {place})"), *at, lasts));
        }
        facts
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<CameraResult, MethodFailure>> {
        match tasks::task(call, self) {
            Ok(task) => Box::pin(task),
            Err(failure) => Box::pin(std::future::ready(Err(failure))),
        }
    }

    fn on_success(&mut self, _call: &MethodCall, done: CameraResult) -> MethodResult {
        let (detail, observed) = match done {
            CameraResult::Aimed(aim) => {
                self.aim = Some(aim);
                let PtzPosition { pan, tilt, zoom } = aim;
                let detail = format!("looks {pan:.0}° right, {tilt:.0}° up, zoom {zoom:.1}");
                let preset = self.preset();
                let looks = preset.map(|(name, _)| format!("(looks-at {} {name})", self.id));
                (detail, looks.unwrap_or_default())
            }
            CameraResult::Picture { place, file, caption } => {
                self.pictures.insert(place.clone(), Instant::now());
                let detail = format!("picture {}: {caption}", file.display());
                (detail, format!("(known-picture {place})"))
            }
            CameraResult::Video { place, file, frames } => {
                self.recorded.insert(place.clone());
                let detail = format!("video {} of {frames} frames", file.display());
                (detail, format!("(recorded {place})"))
            }
        };
        let observations = facts_of(&observed).into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, _call: &MethodCall, failure: &MethodFailure) {
        // The next look of the camera determines its present direction.
        self.aim = None;
        if *failure != MethodFailure::GivenUp {
            self.paused_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<PtzCamera>>> {
        Some(Box::pin(motion_watch::watch(self)))
    }
}
