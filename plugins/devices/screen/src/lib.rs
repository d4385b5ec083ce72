//! The screen (the paper, Figure 1), which shows media to the people in its room.
//!
//! - [`Display`] is the trait of drivers. `simulated` is a screen of the simulated building.
//!   `browser` is a Chromium that fills the screen of this machine, and `mpv` is the player of that
//!   name. `cast` is a Chromecast of the network, and `cec` a television that is turned on and off.
//!   `supervisor` keeps the program of `browser` and `mpv` running, and the connections of the
//!   others.
//! - `finder` lists the Chromecasts of the network.
//! - A screen that is plugged in for the first time has no channel, and requests the goal to get
//!   one: “complete the setup (resource allocation and integration) automatically”. With a channel,
//!   media can be presented in the room of the screen.
//! - A screen is checked every second. A screen that has failed announces that it offers no actions
//!   and presents nothing, so that other screens take over.

mod browser;
mod cast;
mod cec;
mod cec_output;
mod config;
mod content;
mod finder;
mod mpv;
mod pages;
mod player;
mod simulated;
mod supervisor;
mod with_television;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::content::{Achieve, Keep, Method, Methods};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, Initiative, MethodCall, MethodFailure,
    MethodResult, OwnFact, PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};

use crate::config::Config;
pub use crate::content::Content;
pub use crate::finder::FINDER;
use crate::with_television::WithTelevision;

/// Pause between two checks of the screen. The pause is short, so that a meeting can continue at
/// another screen within a few seconds.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Time limit of a check of the screen; a longer check counts as a failure.
const CHECK_TIME_MAX: Duration = Duration::from_secs(3);

/// Time limit for the screen to light up. It is that of a projector's lamp.
const SHOWING_TIME_MAX: Duration = Duration::from_secs(30);

const SIMULATED: &str = "simulated";
const BROWSER: &str = "browser";
const MPV: &str = "mpv";
const CAST: &str = "cast";
const CEC: &str = "cec";

/// The entry of the screen in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "screen",
    about: "shows media to the people in its room",
    drivers: &[SIMULATED, BROWSER, MPV, CAST, CEC],
    has_replicas: false,
    build,
};

/// The driver of a screen. Error texts complete “failed to …”.
pub trait Display: Send + Sync + 'static {
    /// Allocates a channel to the screen, and returns the channel. A screen that has a channel
    /// keeps it. A screen without a channel cannot show anything.
    fn allocate(&self) -> BoxFuture<Result<u32, String>>;

    /// Shows this medium on the screen; `None` turns the screen dark.
    fn show(&self, content: Option<&Content>) -> BoxFuture<Result<(), String>>;

    /// Returns the state of the screen.
    fn panel(&self) -> BoxFuture<Result<DisplayState, String>>;
}

/// The state of a working screen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DisplayState {
    /// Channel of the screen; `None` if the screen has none yet.
    pub channel: Option<u32>,
    /// Medium that the screen shows, as the config writes it; `None` if the screen is dark.
    pub shown: Option<String>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, screen(&blueprint)?)
}

fn screen(blueprint: &Blueprint) -> Result<Screen, BuildError> {
    let mut config: Config = blueprint.config_as()?;
    config.check_keys(blueprint)?;
    let media = config.contents(blueprint)?;
    let name = blueprint.id.as_str();
    let display: Arc<dyn Display> = match blueprint.driver.as_str() {
        BROWSER => {
            let settings = (config.player(), config.television(blueprint)?);
            supervisor::display::<WithTelevision<browser::BrowserPlayer>>(name, settings)
        }
        MPV => {
            let settings = (config.player(), config.television(blueprint)?);
            supervisor::display::<WithTelevision<mpv::MpvPlayer>>(name, settings)
        }
        CAST => supervisor::display::<cast::CastPlayer>(name, config.cast(blueprint)?),
        CEC => supervisor::display::<cec::CecPlayer>(name, config.cec(blueprint)?),
        _ => simulated::display(blueprint)?,
    };
    Ok(Screen {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        location: config.location,
        media,
        display,
        state: ScreenStatus::Unknown,
        known: Arc::default(),
    })
}

struct Screen {
    id: String,
    ontology: String,
    location: PlaceName,
    /// Content of each medium, by the medium's name in plans.
    media: BTreeMap<String, Content>,
    display: Arc<dyn Display>,
    state: ScreenStatus,
    /// The same state, for the checks, which go on while methods change it.
    known: Arc<Mutex<ScreenStatus>>,
}

/// The last known state of a screen.
#[derive(Clone, Debug, Default, PartialEq)]
enum ScreenStatus {
    /// The screen was not checked yet.
    #[default]
    Unknown,
    /// The screen does not work.
    Broken,
    /// The screen works.
    Works(DisplayState),
}

/// The result of a method of the screen.
enum ScreenResult {
    Allocated(u32),
    Shows(Option<Content>),
}

impl Screen {
    fn channel(&self) -> Option<u32> {
        match &self.state {
            ScreenStatus::Works(panel) => panel.channel,
            ScreenStatus::Unknown | ScreenStatus::Broken => None,
        }
    }

    /// Returns the name of the medium on the screen; `None` if the screen shows none of its media.
    fn shown(&self) -> Option<&str> {
        let ScreenStatus::Works(DisplayState { shown: Some(shown), .. }) = &self.state else {
            return None;
        };
        let medium = self.media.iter().find(|(_, content)| content.written() == shown);
        medium.map(|(name, _)| name.as_str())
    }

    fn actions(&self) -> &'static str {
        match &self.state {
            ScreenStatus::Unknown | ScreenStatus::Broken => "",
            ScreenStatus::Works(DisplayState { channel: None, .. }) => {
                "(:action set-up
                    :agent ?s - screen
                    :parameters (?r - room)
                    :precondition (screen-in ?s ?r)
                    :effect (and (allocated ?s) (can-present ?r) (increase (total-cost) 1)))"
            }
            ScreenStatus::Works(_) => {
                "(:action present
                    :agent ?s - screen
                    :parameters (?m - media ?r - room)
                    :precondition (and (allocated ?s) (screen-in ?s ?r))
                    :effect (and (forall (?o - media) (not (presented ?o ?r))) (presented ?m ?r)
                        (increase (total-cost) 1)))
                (:action go-dark
                    :agent ?s - screen
                    :parameters (?r - room)
                    :precondition (and (allocated ?s) (screen-in ?s ?r))
                    :effect (and (forall (?o - media) (not (presented ?o ?r)))
                        (increase (total-cost) 1)))"
            }
        }
    }

    fn set_state(&mut self, state: ScreenStatus) {
        self.known.lock().unwrap_or_else(PoisonError::into_inner).clone_from(&state);
        self.state = state;
    }

    /// Handles the result of a check. If the screen works but has no channel, returns a request for
    /// the goal to allocate one.
    fn handle_check(&mut self, state: ScreenStatus) -> Vec<Initiative> {
        self.set_state(state);
        if !matches!(self.state, ScreenStatus::Works(DisplayState { channel: None, .. })) {
            return Vec::new();
        }
        let goal = format!("(allocated {})", self.id);
        let goal = Achieve::new(goal, Keep::Achieve, 0);
        vec![Initiative::RequestGoal { name: "set-up".to_owned(), goal, insists: true }]
    }
}

impl Device for Screen {
    type Yield = ScreenResult;

    fn describe(&self) -> Description {
        let Screen { id, ontology, location, media, .. } = self;
        let media: Vec<_> = media.keys().map(|name| format!("{name} - media")).collect();
        let (media, actions) = (media.join(" "), self.actions());
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:objects {id} - screen {media})
                (:init (screen-in {id} {location}))
                {actions})"
        );
        let method = |name: &str, arguments: &[_]| Method::new(name, arguments, SHOWING_TIME_MAX);
        let methods: Methods = [
            ("set-up".to_owned(), method("allocate", &[])),
            ("present".to_owned(), method("show", &[("media", "?m")])),
            ("go-dark".to_owned(), method("hide", &[])),
        ]
        .into();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let Screen { id, location, .. } = self;
        let mut text = format!("(screen-in {id} {location})");
        if self.channel().is_some() {
            text += &format!(" (allocated {id}) (can-present {location})");
        }
        if let Some(medium) = self.shown() {
            text += &format!(" (presented {medium} {location})");
        }
        facts_of(&text)
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<ScreenResult, MethodFailure>> {
        let display = Arc::clone(&self.display);
        let content = match (call.method.as_str(), call.argument("media")) {
            ("allocate", _) => {
                return Box::pin(async move {
                    display
                        .allocate()
                        .await
                        .map(ScreenResult::Allocated)
                        .map_err(MethodFailure::Driver)
                });
            }
            ("hide", _) => None,
            ("show", Ok(medium)) => match self.media.get(medium) {
                Some(content) => Some(content.clone()),
                None => {
                    return failed_method(MethodFailure::Driver(format!(
                        "find the medium `{medium}`"
                    )));
                }
            },
            ("show", Err(failure)) => return failed_method(failure),
            _ => return failed_method(MethodFailure::UnknownMethod(call.method.clone())),
        };
        Box::pin(async move {
            display.show(content.as_ref()).await.map_err(MethodFailure::Driver)?;
            Ok(ScreenResult::Shows(content))
        })
    }

    fn on_success(&mut self, _call: &MethodCall, done: ScreenResult) -> MethodResult {
        let (id, location, channel) = (&self.id, &self.location, self.channel());
        let (panel, detail, observed) = match done {
            ScreenResult::Allocated(channel) => (
                DisplayState { channel: Some(channel), shown: None },
                format!("set up on channel {channel}"),
                format!("(allocated {id}) (can-present {location})"),
            ),
            ScreenResult::Shows(content) => {
                let detail = if content.is_some() { "shows it" } else { "is dark" };
                let shown = content.map(|content| content.written().to_owned());
                (DisplayState { channel, shown }, detail.to_owned(), String::new())
            }
        };
        self.set_state(ScreenStatus::Works(panel));
        let observed = match self.shown() {
            Some(medium) => format!("{observed}(presented {medium} {})", self.location),
            None => observed,
        };
        let observations = facts_of(&observed).into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, _call: &MethodCall, failure: &MethodFailure) {
        if *failure != MethodFailure::GivenUp {
            // The state is `Broken` until the next check finds another state.
            self.set_state(ScreenStatus::Broken);
        }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Screen>>> {
        let (display, known) = (Arc::clone(&self.display), Arc::clone(&self.known));
        Some(Box::pin(async move {
            loop {
                let panel = tokio::time::timeout(CHECK_TIME_MAX, display.panel()).await;
                let state = match panel {
                    Ok(Ok(panel)) => ScreenStatus::Works(panel),
                    Ok(Err(_)) | Err(_) => ScreenStatus::Broken,
                };
                if state != *known.lock().unwrap_or_else(PoisonError::into_inner) {
                    let stir: DeviceEvent<Screen> = Box::new(|screen| screen.handle_check(state));
                    return stir;
                }
                tokio::time::sleep(CHECK_INTERVAL).await;
            }
        }))
    }
}

fn failed_method(failure: MethodFailure) -> BoxFuture<Result<ScreenResult, MethodFailure>> {
    Box::pin(std::future::ready(Err(failure)))
}
