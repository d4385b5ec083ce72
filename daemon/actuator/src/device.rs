//! What a plugin implements to be an actuator.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Methods, Refusal};
use pddl::{ActionModel, InitElement};
use substrate::BoxFuture;

use crate::initiative::{Initiative, News, Stir};

/// A thing that senses or acts.
///
/// Called on its agent's task, so nothing here may wait; what takes time is in the future that
/// [`Device::perform`] returns. Dropping that future gives the method up.
pub trait Device: Sized + Send + 'static {
    /// What a method yields.
    type Yield: Send + 'static;

    /// What it can do now. Asked again after every method and at every heartbeat: a robot with
    /// an empty battery offers no `move`.
    fn describe(&self) -> Description;

    /// All facts it knows now and answers for: what it does not say is false.
    fn facts(&self) -> Vec<OwnFact>;

    /// Looks how things stand before it says anything of itself: a former life may have left it
    /// elsewhere than its config says. Nothing is announced until this is over, so it is bounded.
    fn look(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Why it declines to run a method that it offers, before it agrees to.
    fn objection(&mut self, _call: &Call) -> Option<Refusal> {
        None
    }

    /// Runs a method.
    fn perform(&mut self, call: &Call) -> BoxFuture<Result<Self::Yield, Failure>>;

    /// A method is done; [`Device::facts`] says what is known from now on.
    fn performed(&mut self, call: &Call, yielded: Self::Yield) -> Performed;

    /// A method failed, or was given up.
    fn failed(&mut self, _call: &Call, _failure: &Failure) {}

    /// Waits for the next thing that happens to it by itself: somebody moves, a battery runs low.
    /// When it has, the device is changed as the [`Stir`] says, what it knows and can do is
    /// announced at once, and its initiatives are taken.
    ///
    /// Asked for on activation and again after each; the future may wait for as long as nothing
    /// happens, and is dropped with the agent. `None`: nothing ever does.
    fn watch(&mut self) -> Option<BoxFuture<Stir<Self>>> {
        None
    }

    /// What became of an initiative of this name, and what the device does now. A device that was
    /// refused and asks again at once is refused at once.
    fn heard(&mut self, _name: &str, _news: &News) -> Vec<Initiative> {
        Vec::new()
    }

    /// Whether it proposes plans when it is called for proposals.
    fn bids(&self) -> bool {
        true
    }
}

/// What a device can do.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Its action model.
    pub model: ActionModel,
    /// Which method carries out which action.
    pub methods: Methods,
}

/// A fact a device answers for.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnFact {
    /// The fact.
    pub fact: InitElement,
    /// How long it is still known; `None` means until the device says otherwise.
    pub known_for: Option<Duration>,
}

/// A method to run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Call {
    /// The ground action it carries out.
    pub action: String,
    /// The method.
    pub method: String,
    /// Its arguments.
    pub arguments: BTreeMap<String, String>,
}

/// What a method that is done has brought.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Performed {
    /// One line for a person.
    pub detail: String,
    /// What was observed, to be relayed with the confirmation.
    pub observations: Vec<InitElement>,
}

/// Why a method did not succeed. Completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// The device has no such method.
    #[error("find a method `{0}`")]
    UnknownMethod(String),
    /// The method needs an argument that was not given.
    #[error("run a method without its argument `{0}`")]
    MissingArgument(&'static str),
    /// The driver says so.
    #[error("{0}")]
    Driver(String),
    /// It took longer than its method may.
    #[error("finish within {0:?}")]
    TimedOut(Duration),
    /// It was given up as asked.
    #[error("go on: it was given up as asked")]
    GivenUp,
}

impl Call {
    /// An argument.
    ///
    /// # Errors
    ///
    /// If it was not given.
    pub fn argument(&self, name: &'static str) -> Result<&str, Failure> {
        self.arguments.get(name).map(String::as_str).ok_or(Failure::MissingArgument(name))
    }
}

impl From<InitElement> for OwnFact {
    fn from(fact: InitElement) -> OwnFact {
        OwnFact { fact, known_for: None }
    }
}
