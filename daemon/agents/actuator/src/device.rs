//! The trait that a plugin implements to be an actuator.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Methods, Refusal};
use pddl::{ActionModel, InitElement};
use substrate::BoxFuture;

use crate::initiative::{DeviceEvent, Initiative, InitiativeUpdate};

/// A device that an actuator drives: one that senses or acts.
///
/// The methods of this trait are called on the task of the device's agent, so none of them may
/// block. Slow work belongs into the future that [`Device::perform`] returns. Dropping that future
/// cancels the method.
pub trait Device: Sized + Send + 'static {
    /// The value that a method of the device yields if it succeeds.
    type Yield: Send + 'static;

    /// Returns the action model and the methods that the device offers at present. Called again
    /// after every method and at every heartbeat, because the offer may change: a robot with an
    /// empty battery offers no `move`.
    fn describe(&self) -> Description;

    /// Returns the names of all actions that the device can ever offer, also of those that it does
    /// not offer now. By default these are the actions of its present offer.
    fn action_names(&self) -> Vec<String> {
        let actions = self.describe().model.actions;
        actions.iter().map(|action| action.name.as_str().to_owned()).collect()
    }

    /// Returns all facts that the device owns at present. A fact that is missing from the list is
    /// false.
    fn facts(&self) -> Vec<OwnFact>;

    /// Returns a future that reads the real state of the device, which may differ from the config
    /// after an earlier incarnation. The agent announces nothing until the future ends, so the time
    /// of the future must be bounded. Returns `None` if there is no state to read.
    fn read_state(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Returns a refusal if the device declines the call of an offered method, otherwise `None`.
    /// Called before the agent agrees to the request; for a step of an action with private steps, before
    /// that step.
    fn check_call(&mut self, _call: &MethodCall) -> Option<Refusal> {
        None
    }

    /// Runs a method of the device. Dropping the returned future cancels the method. Nothing may
    /// happen before the future is polled, because a person may have to allow the action first.
    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<Self::Yield, MethodFailure>>;

    /// Called when a method has succeeded. From then on [`Device::facts`] returns the new facts.
    fn on_success(&mut self, call: &MethodCall, yielded: Self::Yield) -> MethodResult;

    /// Called when a method of the device that has begun has failed or was cancelled.
    fn on_failure(&mut self, _call: &MethodCall, _failure: &MethodFailure) {}

    /// Returns a future that brings the device to a standstill, and ends when the device itself has
    /// confirmed this. Called when a stop concerns the device, also if no method runs; a running
    /// method is cancelled before. The text of an error completes “failed to …”. Returns `None` if
    /// cancelling the method is all that can be done.
    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        None
    }

    /// Returns a future that waits for the next event that no request caused: a person moves, a
    /// battery runs low. The future returns a [`DeviceEvent`], which changes the device and returns
    /// its initiatives: goals that the device requests, and questions that it asks people. The new
    /// facts and the new action model are then announced at once, and the initiatives are carried
    /// out.
    ///
    /// Called on activation and again after each event. The future is dropped with the agent.
    /// Returns `None` if the device has no such events.
    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Self>>> {
        None
    }

    /// Called with news about the goal that this device has requested under `name`, or about the
    /// question that it has asked under `name`. Returns the next initiatives of the device. A goal
    /// that was refused should not be requested again at once, because it would be refused again.
    fn receive_news(&mut self, _name: &str, _news: &InitiativeUpdate) -> Vec<Initiative> {
        Vec::new()
    }

    /// Whether the device proposes plans when it receives a call for proposals.
    fn makes_bids(&self) -> bool {
        true
    }
}

/// The offer of a device at present: its action model and its methods.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// The action model of the device.
    pub model: ActionModel,
    /// The method that carries out each action of the model.
    pub methods: Methods,
}

/// A fact that the device owns: its reports count more than those of other agents.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnFact {
    /// The fact, as it is written in the `:init` section of a problem.
    pub fact: InitElement,
    /// How long the fact remains known; with `None` it remains known until the device reports
    /// otherwise.
    pub known_for: Option<Duration>,
}

/// A call of a device's method: its name and arguments, and the action that it carries out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MethodCall {
    /// The ground action that the method carries out.
    pub action: String,
    /// Name of the method to run.
    pub method: String,
    /// Arguments of the method, by name.
    pub arguments: BTreeMap<String, String>,
}

/// Result of a method that has succeeded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MethodResult {
    /// Description of the result, one line for a person.
    pub detail: String,
    /// Facts that the method has observed, to be sent with the confirmation.
    pub observations: Vec<InitElement>,
}

/// Reason why a method did not succeed. The text of each variant completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MethodFailure {
    /// The device has no method of this name.
    #[error("find a method `{0}`")]
    UnknownMethod(String),
    /// The call lacks this argument, which the method needs.
    #[error("run a method without its argument `{0}`")]
    MissingArgument(&'static str),
    /// The driver of the device returned this error.
    #[error("{0}")]
    Driver(String),
    /// The device is able, but its surroundings are not as the plan assumed. The device reports
    /// them as facts, so that the next plan avoids them; the action itself is not avoided.
    #[error("{0}")]
    Hindered(String),
    /// A person has forbidden the action.
    #[error("{0}")]
    Forbidden(String),
    /// No person has allowed the action in time.
    #[error("{0}")]
    Unanswered(String),
    /// The method was ended from outside at an unknown point, for this reason.
    #[error("{0}")]
    Interrupted(String),
    /// The method took longer than this time limit.
    #[error("finish within {0:?}")]
    TimedOut(Duration),
    /// The method was cancelled on request.
    #[error("go on: it was given up as asked")]
    GivenUp,
}

impl MethodCall {
    /// Returns the argument `name` of the method.
    ///
    /// # Errors
    ///
    /// Returns [`MethodFailure::MissingArgument`] if the call has no such argument.
    pub fn argument(&self, name: &'static str) -> Result<&str, MethodFailure> {
        self.arguments.get(name).map(String::as_str).ok_or(MethodFailure::MissingArgument(name))
    }
}

impl From<InitElement> for OwnFact {
    fn from(fact: InitElement) -> OwnFact {
        OwnFact { fact, known_for: None }
    }
}
