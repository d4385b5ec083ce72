//! The PTZ camera (the paper, “PTZ Camera”): “can move (PTZ), record video, snap pictures, and
//! detect motion”.
//!
//! - [`Camera`] is the trait of drivers. `onvif` drives cameras of the network, `motion` has the
//!   program Motion watch a camera, `v4l2` drives USB cameras. `simulated` gives the single frames of
//!   a camera in the simulated building, from which `frame_camera` makes a camera.
//! - `finder` lists the cameras of the network.
//! - The camera turns to presets, and by small steps in any direction. Each picture or video is a
//!   file in the camera's `album`. That there is a picture or a video of a place is a fact.
//! - The camera detects motion. Motion is announced at once, and may make the camera request a
//!   goal.
//! - If the camera does not look in the direction that the plan assumes, taking a picture fails.

mod album;
mod config;
mod driver;
mod finder;
mod frame;
mod frame_camera;
mod lines;
mod motion;
mod onvif;
mod position;
mod recording;
mod seen;
mod simulated;
mod tasks;
mod v4l2;

#[cfg(test)]
#[path = "../../../../tests/support/film.rs"]
mod film;
#[cfg(test)]
#[path = "../../../../tests/support/left_out.rs"]
mod left_out;
#[cfg(test)]
mod motion_tests;
#[cfg(test)]
#[path = "../../../../tests/support/onvif_camera.rs"]
#[allow(dead_code, reason = "what other tests need of a camera besides")]
mod onvif_camera;
#[cfg(test)]
mod onvif_tests;
#[cfg(test)]
mod recording_tests;
#[cfg(test)]
mod test_support;
#[cfg(test)]
mod v4l2_tests;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Methods};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, Initiative, MethodCall, MethodFailure,
    MethodResult, OwnFact, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use tokio::time::Instant;

pub use config::goal_at;
use config::{CameraSettings, Config, DriverSettings};
pub use driver::{
    Camera, FileContent, Known, News, PartFile, RecordedFile, SharedKnown, Step, View,
};
pub use finder::FINDER;
pub use frame::Frame;
use frame_camera::FrameCamera;
pub use frame_camera::FrameSource;
use position::PTZ;
pub use position::PtzPosition;
use tasks::CameraResult;

/// Pause after a failure, during which a camera offers no actions.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

const SIMULATED: &str = "simulated";
const ONVIF: &str = "onvif";
const MOTION: &str = "motion";
const V4L2: &str = "v4l2";

/// The entry of the PTZ camera in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "ptz-camera",
    about: "turns, zooms, takes pictures, records, and says when something moves",
    drivers: &[SIMULATED, ONVIF, MOTION, V4L2],
    has_replicas: false,
    build,
};

/// Steps by which a person turns the camera: name of the action, degrees of pan, degrees of tilt,
/// and factor by which the magnification changes.
const STEPS: [(&str, f64, f64, f64); 6] = [
    ("pan-left", -10.0, 0.0, 1.0),
    ("pan-right", 10.0, 0.0, 1.0),
    ("tilt-up", 0.0, 5.0, 1.0),
    ("tilt-down", 0.0, -5.0, 1.0),
    ("zoom-in", 0.0, 0.0, 1.25),
    ("zoom-out", 0.0, 0.0, 0.8),
];

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, camera(&blueprint)?)
}

fn camera(blueprint: &Blueprint) -> Result<PtzCamera, BuildError> {
    let (settings, driver) = blueprint.config_as::<Config>()?.understand(blueprint)?;
    let camera: Arc<dyn Camera> = match driver {
        DriverSettings::Onvif(settings) => onvif::camera(settings),
        DriverSettings::Motion(settings) => motion::camera(settings),
        DriverSettings::V4l2(settings) => v4l2::camera(settings),
        DriverSettings::Frames(presets, sensitivity) => {
            Arc::new(FrameCamera::new(simulated::source(blueprint)?, presets, sensitivity))
        }
    };
    Ok(PtzCamera {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        camera,
        settings,
        in_view: None,
        problem: None,
        missing: BTreeSet::new(),
        known: SharedKnown::new(),
        pictures: BTreeMap::new(),
        recorded: BTreeSet::new(),
        motion: BTreeMap::new(),
        paused_until: None,
    })
}

struct PtzCamera {
    id: String,
    ontology: String,
    settings: CameraSettings,
    camera: Arc<dyn Camera>,
    /// Preset that the camera looks at; `None` if its direction is not a preset, or is unknown.
    in_view: Option<String>,
    /// Reason why the camera cannot be used; `None` if it can.
    problem: Option<String>,
    /// Presets of the config that the camera does not have.
    missing: BTreeSet<String>,
    /// The known state of the camera, for the driver.
    known: SharedKnown,
    /// Time of the last picture of each place.
    pictures: BTreeMap<String, Instant>,
    recorded: BTreeSet<String>,
    /// Time of the last motion in each place.
    motion: BTreeMap<String, Instant>,
    paused_until: Option<Instant>,
}

impl PtzCamera {
    fn is_available(&self) -> bool {
        self.problem.is_none() && self.paused_until.is_none_or(|until| until <= Instant::now())
    }

    /// Returns the name and the place of the preset that the camera looks at; `None` if its
    /// direction is not a preset, or is unknown.
    fn preset(&self) -> Option<(&str, &str)> {
        let name = self.in_view.as_deref()?;
        Some((name, self.settings.presets.get(name)?))
    }

    /// Returns the time until which motion in the present place is not announced again. Continuing
    /// motion is announced again after a third of the time for which the fact is valid.
    fn quiet_until(&self) -> Instant {
        let lasts = self.settings.motion.as_ref().map_or(Duration::ZERO, |motion| motion.lasts);
        let last = self.preset().and_then(|(_, place)| self.motion.get(place));
        last.map_or_else(Instant::now, |last| *last + lasts / 3)
    }

    /// Passes the known state to the driver. Must be called after each change of it.
    fn tell_driver(&self) {
        self.known.set(Known {
            preset: self.in_view.clone(),
            quiet_until: self.quiet_until(),
            problem: self.problem.clone(),
            missing: self.missing.clone(),
        });
    }

    /// Adopts the state that the driver reports. Returns the request for the goal that the config
    /// sets for motion, if there is motion.
    fn take_news(&mut self, news: News) -> Vec<Initiative> {
        let News { preset, has_motion, problem, missing } = news;
        if problem != self.problem {
            match &problem {
                Some(problem) => tracing::warn!(agent = self.id, "failed to {problem}"),
                None => tracing::info!(agent = self.id, "the camera can be used"),
            }
        }
        for name in missing.difference(&self.missing) {
            tracing::warn!(agent = self.id, "the camera has lost the preset of `{name}`");
        }
        (self.in_view, self.problem, self.missing) = (preset, problem, missing);
        let Some((_, place)) = self.preset().filter(|_| has_motion) else { return Vec::new() };
        let place = place.to_owned();
        let goal = self.settings.motion.as_ref().and_then(|motion| motion.goal(&place));
        self.motion.insert(place.clone(), Instant::now());
        // The goal is not requested again if it fails, because the moving person has left by then.
        let (name, insists) = (format!("motion-{place}"), false);
        let want = |goal| Initiative::RequestGoal { name, goal, insists };
        goal.map(want).into_iter().collect()
    }

    /// Returns a fact that counts as known for the time `lasts` after `at`; without a time limit if
    /// `lasts` is `None`. Returns an empty list if the time is over.
    fn passing(&self, fact: &str, at: Instant, lasts: Option<Duration>) -> Vec<OwnFact> {
        let known_for = lasts.map(|lasts| lasts.saturating_sub(at.elapsed()));
        if known_for.is_some_and(|left| left.is_zero()) {
            return Vec::new();
        }
        facts_of(fact).into_iter().map(|fact| OwnFact { known_for, ..fact }).collect()
    }

    fn lasting(&self) -> String {
        let mut text = String::new();
        for (name, place) in &self.settings.presets {
            if !self.missing.contains(name) {
                // Writing to memory cannot fail.
                let _ = write!(text, "(shows {} {name} {place}) ", self.id);
            }
        }
        text
    }

    fn actions(&self) -> String {
        let (mut text, can_turn) = (String::new(), self.camera.can_turn());
        if can_turn {
            text += "(:action look-at
                :agent ?c - ptz-camera
                :parameters (?p - preset ?l - location)
                :precondition (shows ?c ?p ?l)
                :effect (and (forall (?q - preset) (not (looks-at ?c ?q))) (looks-at ?c ?p)
                    (increase (total-cost) 1)))";
        }
        text += "(:action take-snapshot
                :agent ?c - ptz-camera
                :parameters (?p - preset ?l - location)
                :precondition (and (looks-at ?c ?p) (shows ?c ?p ?l))
                :effect (and (known-picture ?l) (increase (total-cost) 1)))";
        if self.camera.can_record() {
            text += "(:action record
                :agent ?c - ptz-camera
                :parameters (?p - preset ?l - location)
                :precondition (and (looks-at ?c ?p) (shows ?c ?p ?l))
                :effect (and (recorded ?l) (increase (total-cost) 2)))";
        }
        for (name, ..) in STEPS.iter().filter(|_| can_turn) {
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
        let acting = self.camera.acting_time_max();
        let recording = acting + self.settings.recording * 2;
        let mut methods: Methods = [
            ("look-at".to_owned(), method("go_to_preset", &[preset], acting)),
            ("take-snapshot".to_owned(), method("take_picture", &at, acting)),
            ("record".to_owned(), method("record_video", &at, recording)),
        ]
        .into();
        if !self.camera.can_record() {
            methods.remove("record");
        }
        if !self.camera.can_turn() {
            methods.remove("look-at");
            return methods;
        }
        for (name, pan, tilt, zoom) in STEPS {
            let by = [("pan", pan), ("tilt", tilt), ("zoom", zoom)];
            let by = by.map(|(key, value)| (key, value.to_string()));
            methods.insert(name.to_owned(), method("move_by", &by, acting));
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
        let offered = if self.is_available() { self.actions() } else { String::new() };
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

    fn read_state(&self) -> Option<BoxFuture<()>> {
        self.camera.connect()
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<CameraResult, MethodFailure>> {
        match tasks::task(call, self) {
            Ok(task) => Box::pin(task),
            Err(failure) => Box::pin(std::future::ready(Err(failure))),
        }
    }

    fn on_success(&mut self, _call: &MethodCall, done: CameraResult) -> MethodResult {
        let (detail, observed) = match done {
            CameraResult::Turned(View { preset, detail }) => {
                self.in_view = preset;
                self.tell_driver();
                let preset = self.preset();
                let looks = preset.map(|(name, _)| format!("(looks-at {} {name})", self.id));
                (detail, looks.unwrap_or_default())
            }
            CameraResult::Picture { place, file, caption } => {
                self.pictures.insert(place.clone(), Instant::now());
                let detail = format!("picture {}: {caption}", file.display());
                (detail, format!("(known-picture {place})"))
            }
            CameraResult::Video { place, file, caption } => {
                self.recorded.insert(place.clone());
                let detail = format!("video {} of {caption}", file.display());
                (detail, format!("(recorded {place})"))
            }
        };
        let observations = facts_of(&observed).into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, _call: &MethodCall, failure: &MethodFailure) {
        // The next look of the camera determines its present direction.
        self.in_view = None;
        self.tell_driver();
        if *failure != MethodFailure::GivenUp {
            self.paused_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<PtzCamera>>> {
        self.tell_driver();
        let noticing = self.camera.notice(self.known.clone());
        Some(Box::pin(async move {
            let news = noticing.await;
            let take: DeviceEvent<PtzCamera> = Box::new(|camera| camera.take_news(news));
            take
        }))
    }
}
