//! The video-collaboration robot (the paper, Figure 1), a mobile base with a screen that is
//! deployed “to resume the interrupted meeting” after the failure of a screen.
//!
//! - `mobile_base::MobileBase` implements moving, the battery and the dock, as for every robot.
//! - The robot presents media at any location, at a higher cost than a fixed screen. While the
//!   robot presents, it does not move.
//! - The screen has a driver of its own: `simulated`, or with ROS 2 a topic with the shown text.

mod display;
mod simulated;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Refusal};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OwnFact, PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use mobile_base::{BaseConfig, BaseOutcome, MobileBase, check_ros_name};
use serde::Deserialize;

use crate::display::RosDisplay;

/// Time limit for the robot's screen to light up.
const SHOWING_TIME_MAX: Duration = Duration::from_secs(30);

/// The entry of the video-collaboration robot in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "video-robot",
    about: "a mobile base with a screen: presents wherever it drives",
    drivers: mobile_base::DRIVERS,
    has_replicas: false,
    build,
};

/// The `config` of a video-collaboration robot's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Config {
    #[serde(flatten)]
    base: BaseConfig,
    /// Media that the robot can show: the text of each medium, by the medium's name in plans.
    media: BTreeMap<String, String>,
    /// Topic of the display of a robot with ROS 2.
    #[serde(default)]
    display: Option<String>,
    /// All other keys of the entry's `config`. Any such key is an error.
    #[serde(flatten)]
    unknown: serde_json::Map<String, serde_json::Value>,
}

/// Rule for the name of a medium, which is an object in plans.
const NAME_RULE: &str =
    "use lower-case letters, digits, `-` and `_`, and begin with a letter, such as `slides`";

/// The driver of the robot's screen. Error texts complete “failed to …”.
pub trait ScreenDriver: Send + Sync + 'static {
    /// Shows a text on the screen; `None` turns the screen dark.
    fn show(&self, text: Option<&str>) -> BoxFuture<Result<(), String>>;
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { base, media, display, unknown } = blueprint.config_as()?;
    if let Some(key) = unknown.keys().next() {
        return Err(blueprint.problem(format!("a video-robot's config has no key `{key}`")));
    }
    for name in media.keys() {
        PlaceName::try_from(name.clone()).map_err(|_| {
            blueprint.problem(format!("`{name}` cannot name a medium: {NAME_RULE}"))
        })?;
    }
    if let Some(display) = &display {
        check_ros_name("display", display).map_err(|problem| blueprint.problem(problem))?;
    }
    let base = MobileBase::new(&blueprint, "video-robot", base)?;
    let screen: Arc<dyn ScreenDriver> = match (base.ros(), display) {
        (Some(robot), display) => Arc::new(RosDisplay::new(robot, display)),
        (None, None) => simulated::screen(&blueprint)?,
        (None, Some(_)) => return Err(blueprint.problem("`display` is for the driver `ros2`")),
    };
    let robot = VideoRobot {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        base,
        media,
        screen,
        shown: None,
    };
    Actuator::build(&blueprint, robot)
}

struct VideoRobot {
    id: String,
    ontology: String,
    base: MobileBase,
    media: BTreeMap<String, String>,
    screen: Arc<dyn ScreenDriver>,
    /// Name of the medium that the robot shows; `None` if the screen is dark.
    shown: Option<String>,
}

/// The result of a method of the video-collaboration robot.
enum PresentationResult {
    Moved(BaseOutcome),
    Shows(Option<String>),
}

const PRESENTING: &str = "(:action present
        :agent ?b - video-robot
        :parameters (?m - media ?r - room)
        :precondition (at ?b ?r)
        :effect (and (forall (?o - media) (not (presented ?o ?r))) (presented ?m ?r)
            (presenting ?b) (increase (total-cost) 5)))
    (:action stop-presenting
        :agent ?b - video-robot
        :parameters (?r - room)
        :precondition (and (at ?b ?r) (presenting ?b))
        :effect (and (forall (?o - media) (not (presented ?o ?r))) (not (presenting ?b))
            (increase (total-cost) 1)))";

impl Device for VideoRobot {
    type Yield = PresentationResult;

    fn describe(&self) -> Description {
        let VideoRobot { id, ontology, base, media, .. } = self;
        let media: Vec<_> = media.keys().map(|name| format!("{name} - media")).collect();
        let (objects, media) = (base.objects(), media.join(" "));
        let (lasting, moving) = (base.model_facts(), base.actions("(not (presenting ?b))"));
        let (predicates, functions) = (base.predicates(), base.functions());
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types video-robot - mobile-base)
                (:predicates {predicates})
                (:functions {functions})
                (:objects {objects} {media})
                (:init {lasting})
                {moving}
                {PRESENTING})"
        );
        let mut methods = base.methods();
        for (action, method, arguments) in [
            ("present", "show", vec![("media", "?m"), ("room", "?r")]),
            ("stop-presenting", "hide", vec![]),
        ] {
            let arguments = arguments.into_iter().map(|(k, v)| (k.to_owned(), v.to_owned()));
            let method = Method {
                method: method.to_owned(),
                arguments: arguments.collect(),
                timeout: Millis(SHOWING_TIME_MAX),
            };
            methods.insert(action.to_owned(), method);
        }
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let mut text = self.base.facts();
        if let Some(medium) = &self.shown {
            text += &format!(" (presenting {})", self.id);
            if let Some(place) = self.base.place() {
                text += &format!(" (presented {medium} {place})");
            }
        }
        facts_of(&text)
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        self.base.check_call(call)
    }

    fn perform(
        &mut self,
        call: &MethodCall,
    ) -> BoxFuture<Result<PresentationResult, MethodFailure>> {
        let screen = Arc::clone(&self.screen);
        let shown = match call.method.as_str() {
            "show" => match self.presentation(call) {
                Ok(shown) => Some(shown),
                Err(failure) => return Box::pin(std::future::ready(Err(failure))),
            },
            "hide" => None,
            _ => {
                let moved = self.base.perform(call);
                return Box::pin(async move { moved.await.map(PresentationResult::Moved) });
            }
        };
        Box::pin(async move {
            let (medium, text) = shown.unzip();
            screen.show(text.as_deref()).await.map_err(MethodFailure::Driver)?;
            Ok(PresentationResult::Shows(medium))
        })
    }

    fn on_success(&mut self, _call: &MethodCall, done: PresentationResult) -> MethodResult {
        let medium = match done {
            PresentationResult::Moved(moved) => return self.base.performed(&moved),
            PresentationResult::Shows(medium) => medium,
        };
        self.shown = medium;
        let Some(medium) = &self.shown else {
            return MethodResult { detail: "is dark".to_owned(), observations: Vec::new() };
        };
        let observed = self.base.place().map(|place| format!("(presented {medium} {place})"));
        let observed = observed.as_deref().map(facts_of).unwrap_or_default();
        let observations = observed.into_iter().map(|fact| fact.fact).collect();
        let detail = format!("shows {medium} {}", self.base.whereabouts());
        MethodResult { detail, observations }
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        Some(self.base.locate())
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        self.base.stand_still()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<VideoRobot>>> {
        let wish = self.base.next_initiative();
        Some(Box::pin(async move {
            wish.await;
            let stir: DeviceEvent<VideoRobot> = Box::new(|robot| robot.base.take_initiatives());
            stir
        }))
    }
}

impl VideoRobot {
    /// Returns the medium in the arguments of a call, and the text of the medium. Returns an error
    /// if the robot is not in the room of the call, or has no such medium.
    fn presentation(&self, call: &MethodCall) -> Result<(String, String), MethodFailure> {
        let (medium, room) = (call.argument("media")?, call.argument("room")?);
        if self.base.place().as_deref() != Some(room) {
            let stands = self.base.whereabouts();
            return Err(MethodFailure::Driver(format!("present in `{room}`: it stands {stands}")));
        }
        let text = self.media.get(medium).cloned();
        let text =
            text.ok_or_else(|| MethodFailure::Driver(format!("find the medium `{medium}`")))?;
        Ok((medium.to_owned(), text))
    }
}
