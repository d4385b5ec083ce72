//! Launching of an agent: the context in which an agent of any type is launched, and the possible
//! errors.

use std::sync::Arc;

use acl::{AgentId, EcosystemId, Incarnation};
use substrate::{Resident, SendError};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::router::MessageRouter;

/// Context for launching an agent: its name, its incarnation, its daemon.
#[derive(Clone)]
pub struct LaunchContext {
    /// Name of the agent.
    pub id: AgentId,
    /// Incarnation of the agent.
    pub incarnation: Incarnation,
    /// Router of the daemon that hosts the agent.
    pub router: Arc<MessageRouter>,
    /// Name of the shared ontology, which the messages of the agent carry.
    pub ontology: Arc<str>,
    /// Token that is cancelled when the daemon begins to shut down.
    pub stopping: CancellationToken,
    /// Whether other daemons may host an agent of this name too. If so, the oldest replica is the
    /// leader, and the others are standbys and take over in the order of their age.
    pub has_replicas: bool,
    /// Ecosystems through which the agent was passed on to this one, the farthest first; empty for
    /// an agent of this ecosystem.
    pub via: Arc<[EcosystemId]>,
}

/// Reason why an agent could not be launched, or why it ended. The message completes “failed to …”.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LaunchError {
    /// Another present agent has the name of the agent that was launched.
    #[error(
        "launch `{}`: an agent of that name is already at daemon `{}`; give one of them another \
         name, or stop the other first",
        holder.agent, holder.daemon
    )]
    NameTaken {
        /// Present agent that has the name already.
        holder: Resident,
    },
    /// A replica of the agent at another daemon has the same number of its incarnation.
    #[error(
        "launch `{}` as incarnation {}: its replica at daemon `{}` has that number; it is launched \
         again with another",
        holder.agent, holder.incarnation, holder.daemon
    )]
    IncarnationTaken {
        /// Replica that keeps the number.
        holder: Resident,
    },
    /// The substrate did not accept the presence of the agent.
    #[error("announce `{agent}`: {source}")]
    Announce {
        /// Agent that could not be made present.
        agent: AgentId,
        /// Error that the substrate returned.
        #[source]
        source: SendError,
    },
}

/// An agent of any type, ready to be launched.
pub trait LaunchableAgent: Send {
    /// Returns the action model that the agent would announce now, as PDDL text; `None` if
    /// the agent has no model.
    fn model(&self) -> Option<String>;

    /// Starts the agent. The returned task ends when the daemon shuts down, or with an error.
    fn launch(
        self: Box<Self>,
        launch_context: LaunchContext,
    ) -> JoinHandle<Result<(), LaunchError>>;
}
