//! The trait that a plugin implements to be an actuator.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Methods, Refusal};
use pddl::{ActionModel, InitElement};
use substrate::BoxFuture;

use crate::initiative::{DeviceEvent, Initiative, InitiativeUpdate};

/// A device that senses or acts.
///
/// Called on its agent's task, so no method here may block. Slow work belongs into the future that
/// [`Device::perform`] returns. Dropping that future cancels the method.
pub trait Device: Sized + Send + 'static {
    /// The result of a method.
    type Yield: Send + 'static;

    /// Returns the action model and the methods as of now. Called again after every method and at every
    /// heartbeat: a robot with an empty battery offers no `move`.
    fn describe(&self) -> Description;

    /// Returns all facts that the device answers for now. A fact that is missing is false.
    fn facts(&self) -> Vec<OwnFact>;

    /// Reads the device's real state before the first announcement: an earlier incarnation may have
    /// left it in another state than the config says. Nothing is announced until the future ends, so it
    /// must be bounded in time.
    fn read_state(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Returns a refusal if the device declines to run an offered method; called before it agrees.
    fn check_call(&mut self, _call: &MethodCall) -> Option<Refusal> {
        None
    }

    /// Runs a method.
    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<Self::Yield, MethodFailure>>;

    /// Called when a method has succeeded. [`Device::facts`] returns the new facts from now on.
    fn on_success(&mut self, call: &MethodCall, yielded: Self::Yield) -> MethodResult;

    /// Called when a method has failed or was cancelled.
    fn on_failure(&mut self, _call: &MethodCall, _failure: &MethodFailure) {}

    /// Waits for the next event that happens to the device by itself: a person moves, a battery runs
    /// low. Then the [`DeviceEvent`] changes the device, the facts and the action model are announced at once,
    /// and the initiatives are carried out.
    ///
    /// Called on activation and again after each event. The future may wait until an event happens, and
    /// is dropped with the agent. `None` if the device has no such events.
    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Self>>> {
        None
    }

    /// Called with the news of the initiative `name`; returns what the device does next. A device that
    /// was refused and asks again at once is refused at once.
    fn receive_news(&mut self, _name: &str, _news: &InitiativeUpdate) -> Vec<Initiative> {
        Vec::new()
    }

    /// Whether the device proposes plans when it receives a call for proposals.
    fn makes_bids(&self) -> bool {
        true
    }
}

/// Abilities of a device at present.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Its action model.
    pub model: ActionModel,
    /// The method that carries out each action.
    pub methods: Methods,
}

/// A fact that a device answers for.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnFact {
    /// The fact.
    pub fact: InitElement,
    /// How long the fact is still known; `None` until the device says otherwise.
    pub known_for: Option<Duration>,
}

/// A method to run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MethodCall {
    /// The ground action that the method carries out.
    pub action: String,
    /// The method.
    pub method: String,
    /// Its arguments.
    pub arguments: BTreeMap<String, String>,
}

/// Result of a method that has succeeded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MethodResult {
    /// One line for a person.
    pub detail: String,
    /// Observed facts, to be sent with the confirmation.
    pub observations: Vec<InitElement>,
}

/// Why a method did not succeed. Completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MethodFailure {
    /// The device has no such method.
    #[error("find a method `{0}`")]
    UnknownMethod(String),
    /// The method needs an argument that was not given.
    #[error("run a method without its argument `{0}`")]
    MissingArgument(&'static str),
    /// The driver returned an error.
    #[error("{0}")]
    Driver(String),
    /// The method took longer than its time limit.
    #[error("finish within {0:?}")]
    TimedOut(Duration),
    /// The method was cancelled on request.
    #[error("go on: it was given up as asked")]
    GivenUp,
}

impl MethodCall {
    /// Returns an argument.
    ///
    /// # Errors
    ///
    /// Returns [`MethodFailure::MissingArgument`] if it was not given.
    pub fn argument(&self, name: &'static str) -> Result<&str, MethodFailure> {
        self.arguments.get(name).map(String::as_str).ok_or(MethodFailure::MissingArgument(name))
    }
}

impl From<InitElement> for OwnFact {
    fn from(fact: InitElement) -> OwnFact {
        OwnFact { fact, known_for: None }
    }
}
