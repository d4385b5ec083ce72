//! The host of a page: the daemon that knows the ecosystem, and that acts for people.

use std::collections::BTreeMap;
use std::fmt;
use std::pin::Pin;

use accounts::{Person, PersonRight};
use acl::{AgentId, DaemonId, EcosystemId};
use bytes::Bytes;
use live_view::{LiveView, Moment};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

/// A boxed future.
pub type BoxFuture<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// The reason why no rows of the history are returned, each with a sentence for a person.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HistoryProblem {
    /// A parameter of the query is wrong.
    Parameter(String),
    /// There is no history, or it cannot be read.
    Unavailable(String),
}

/// The daemon that serves a page: returns what is to be seen, and carries out what people ask for.
pub trait PageHost: Send + Sync + 'static {
    /// Returns the time now, by the clock by which the view observes.
    fn now(&self) -> Moment;

    /// Calls `reader` with the view, once, under a lock that is held until `reader` returns.
    fn read(&self, reader: &mut dyn FnMut(&LiveView));

    /// Returns a receiver of a number that grows when the view has changed otherwise than with time:
    /// when its revision is another one. Heartbeats without news need not count.
    fn changes(&self) -> watch::Receiver<u64>;

    /// Carries out what `person` asks for. The server has checked the rights of the person; the
    /// host holds the act against the rights of the ecosystem.
    fn act(&self, person: Person, act: PageAct) -> BoxFuture<ActOutcome>;

    /// Returns the right that a person needs for `act`; `None` if signing in is enough. An answer to a
    /// question may need the right for what the question is about.
    fn required_right(&self, act: &PageAct) -> Option<PersonRight> {
        act.right()
    }

    /// Describes the ecosystem to those that build goals.
    fn describe(&self) -> PageSetup;

    /// Returns the newest picture of a camera; `None` if the agent has none.
    fn picture(&self, agent: &AgentId) -> BoxFuture<Option<PagePicture>>;

    /// Returns rows of the history of the ecosystem, asked for by these parameters of the query.
    /// What is private is among them only if `person` has the right [`PersonRight::Secrets`]
    /// and the daemon may read it.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no history, or the parameters are wrong.
    fn history(
        &self,
        person: Person,
        parameters: Vec<(String, String)>,
    ) -> BoxFuture<Result<serde_json::Value, HistoryProblem>> {
        drop((person, parameters));
        let none = "this daemon shows no history".to_owned();
        Box::pin(async { Err(HistoryProblem::Unavailable(none)) })
    }

    /// Carries out what a person asks for about notifications to a browser. Returns `None` if this
    /// daemon sends none.
    fn push(&self, person: Person, ask: PushAsk) -> BoxFuture<Option<PushAnswer>> {
        drop((person, ask));
        Box::pin(async { None })
    }
}

/// The answer to a [`PushAsk`]: JSON for the page, or the reason why not, as a sentence.
pub type PushAnswer = Result<serde_json::Value, String>;

/// A request about notifications to a browser (web push, RFC 8030).
#[derive(Clone, PartialEq)]
pub enum PushAsk {
    /// Asks for the public key of the sender, as `{"public_key": …}` in base64url.
    Key,
    /// Sends notifications to a browser from now on: its `PushSubscription`, as JSON.
    Subscribe(serde_json::Value),
    /// Sends none any more to the browser with this endpoint.
    Remove {
        /// The address at the push service that identifies the browser.
        endpoint: String,
    },
}

/// How a goal is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GoalMode {
    /// The goal is to be reached once.
    #[default]
    Reach,
    /// The goal is to hold from now on.
    Keep,
}

impl fmt::Display for GoalMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            GoalMode::Reach => "reach",
            GoalMode::Keep => "keep",
        })
    }
}

/// An act that a person asks for on a page.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "act", rename_all = "kebab-case")]
pub enum PageAct {
    /// Requests a goal.
    Goal {
        /// The goal, as PDDL.
        goal: String,
        /// Whether the goal is to be reached or kept.
        mode: GoalMode,
        /// Time within which the goal is to be reached, in milliseconds; `None` if it has no end.
        #[serde(default)]
        within_ms: Option<u64>,
    },
    /// Plans for a goal without requesting it.
    DryRun {
        /// The goal, as PDDL.
        goal: String,
        /// Whether the goal is to be reached or kept.
        mode: GoalMode,
    },
    /// Cancels a goal.
    CancelGoal {
        /// Conversation of the goal.
        conversation: String,
    },
    /// Requests one action of one agent.
    Action {
        /// The agent.
        agent: String,
        /// The action as a step: `(switch-on lamp)`.
        action: String,
    },
    /// Sets a fact, as `althing set` does.
    Set {
        /// The fact, as PDDL.
        fact: String,
    },
    /// Answers a question.
    Answer {
        /// The Keyboard Agent with the question.
        keyboard: String,
        /// Number of the question at that agent.
        question: u64,
        /// The answer.
        text: String,
    },
    /// Admits a discovered agent, or forbids it.
    Admit {
        /// The discovered agent.
        agent: String,
        /// Whether the agent may take part.
        allow: bool,
    },
    /// Stops agents and places.
    Stop {
        /// The names of agents and places; none stops everything.
        #[serde(default)]
        names: Vec<String>,
        /// Reason of the stop; may be empty.
        #[serde(default)]
        because: String,
    },
    /// Releases stops.
    Release {
        /// The identifiers of the stops.
        ids: Vec<String>,
    },
}

/// How an act of a person has ended.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ActOutcome {
    /// Whether the act was carried out.
    pub ok: bool,
    /// How the act has ended, as one sentence for the person.
    pub sentence: String,
    /// The same sentence as a message of the page's catalogues, which have it in every language;
    /// `None` if it is no fixed one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<PageMessage>,
    /// The conversation that the act has begun; `None` if it has begun none.
    pub conversation: Option<String>,
    /// Further details, which depend on the act; null if there are none.
    pub detail: serde_json::Value,
}

/// A sentence as a message of the page's catalogues.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PageMessage {
    /// Key of the message.
    pub key: String,
    /// The values in the message, by their names. A number called `n` chooses its form.
    pub values: BTreeMap<String, serde_json::Value>,
}

/// The parts of an ecosystem that a person names in goals and acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PageSetup {
    /// The ecosystem.
    pub ecosystem: EcosystemId,
    /// The daemon that serves the page.
    pub daemon: DaemonId,
    /// The types of objects, each with its parent.
    pub types: Vec<SetupType>,
    /// The objects.
    pub objects: Vec<SetupObject>,
    /// The predicates and functions that a goal can be about.
    pub predicates: Vec<SetupPredicate>,
    /// The actions that agents offer.
    pub actions: Vec<SetupAction>,
}

/// A type of objects.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetupType {
    /// Name of the type.
    pub name: String,
    /// Name of the type that this one is a kind of; `None` if it is of none.
    pub parent: Option<String>,
}

/// An object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetupObject {
    /// Name of the object.
    pub name: String,
    /// Type of the object.
    #[serde(rename = "type")]
    pub kind: String,
}

/// A predicate or a function.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetupPredicate {
    /// Name of the predicate or function.
    pub name: String,
    /// The parameters.
    pub parameters: Vec<SetupParameter>,
    /// Whether it is a function, which has a number for a value.
    pub is_function: bool,
    /// Whether some action can make it true or false, or change its value.
    pub can_change: bool,
}

/// A parameter of a predicate or of an action.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetupParameter {
    /// Name of the parameter, without its question mark.
    pub name: String,
    /// The types of which an argument must have one.
    pub types: Vec<String>,
}

/// An action that an agent offers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetupAction {
    /// The agent.
    pub agent: AgentId,
    /// Name of the action.
    pub name: String,
    /// The parameters, without the acting agent.
    pub parameters: Vec<SetupParameter>,
}

/// A picture of a camera.
#[derive(Clone, PartialEq, Eq)]
pub struct PagePicture {
    /// Media type of the picture: `image/jpeg`, `image/png`, or `image/x-portable-pixmap`, which is
    /// sent to browsers as PNG. Others are not shown.
    pub media_type: String,
    /// Moment at which the picture was taken.
    pub at: Moment,
    /// The bytes of the picture.
    pub bytes: Bytes,
}
