//! Stops and releases: sends them to every agent that is present, and collects the answers.
//!
//! The request goes to every agent at once and without a query to another agent: a stop must work if
//! every reasoning agent is dead. Actuators repeat the stop in their heartbeats.

use std::collections::{BTreeMap, BTreeSet};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Refusal, Report, Request, Stop, StopEffect, StopState, value};
use acl::{AgentId, Message, Performative, Protocol};
use agent::{Resident, Resource};
use bytes::Bytes;
use keyboard::{Keyboard, MessageDraft, Terminal, UserEvent, UserRequest};
use ring::rand::{SecureRandom as _, SystemRandom};
use serde_json::Value;
use tokio::sync::broadcast::error::RecvError;

use crate::config::Ecosystem;
use crate::ecosystem_view::EcosystemView;
use crate::{hosting, plugins};

/// How long answers are awaited. An actuator answers within milliseconds; an actuator with a lost
/// link needs longer, until it is reached through another link.
const ANSWERED_WITHIN: Duration = Duration::from_secs(3);

/// Maximum number of agents that are asked and have not answered. It is a fraction of the capacity
/// of a keyboard agent's queue.
const UNANSWERED_MAX: usize = 256;

/// Number of random bytes in the identifier of a stop. The identifier tells apart the stops of a
/// building, and is short enough to be typed.
const ID_BYTES: usize = 4;

/// Answer of one agent to a stop or a release.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum StopAnswer {
    /// The agent has carried out the request; the text says what it did.
    Done(String),
    /// The stop has ended an action of the agent; the text says which.
    Ended(String),
    /// The agent did nothing, and begins nothing until the release.
    Still(String),
    /// The stop does not concern the agent; the text says what it does.
    Unconcerned(String),
    /// The agent has done what it can, but its device may go on; the text says why.
    Doubtful(String),
    /// The agent has not carried out the request, for this reason.
    Declined(String),
}

/// The answers of the actuators to a stop or a release; `None` for an actuator that did not answer in
/// time.
pub(crate) type StopAnswers = BTreeMap<AgentId, Option<StopAnswer>>;

impl StopAnswer {
    /// Returns the answer as text for a person; `None` stands for an actuator that did not answer.
    pub(crate) fn describe(answer: Option<&StopAnswer>) -> String {
        match answer {
            Some(
                StopAnswer::Done(what)
                | StopAnswer::Ended(what)
                | StopAnswer::Still(what)
                | StopAnswer::Unconcerned(what),
            ) => what.clone(),
            Some(StopAnswer::Doubtful(what)) => format!("MAY GO ON: {what}"),
            Some(StopAnswer::Declined(why)) => format!("NOT DONE: {why}"),
            None => "DID NOT ANSWER: it may go on".to_owned(),
        }
    }

    /// Whether the agent is certain to obey the request.
    pub(crate) fn is_obeyed(answer: Option<&StopAnswer>) -> bool {
        !matches!(answer, Some(StopAnswer::Doubtful(_) | StopAnswer::Declined(_)) | None)
    }

    /// Whether a stop concerns the agent, or may concern it.
    pub(crate) fn is_concerned(answer: Option<&StopAnswer>) -> bool {
        !matches!(answer, Some(StopAnswer::Unconcerned(_)))
    }
}

/// Returns a random identifier of a stop.
///
/// # Errors
///
/// Returns an error if the system gives no random numbers. The text completes the sentence “failed
/// to …”.
pub(crate) fn new_id() -> Result<String, &'static str> {
    let mut bytes = [0; ID_BYTES];
    let filled = SystemRandom::new().fill(&mut bytes);
    filled.map_err(|_| "name the stop: the system gives no random numbers")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Sends a request to all agents that are present, from a keyboard agent of the name `own`. Returns
/// the answers of the actuators; `None` for an actuator that did not answer in time.
///
/// # Errors
///
/// Returns an error if no agent is seen or the request cannot be sent. The text completes the
/// sentence “failed to …”.
pub(crate) async fn send_to_all(
    view: &EcosystemView,
    own: AgentId,
    request: &Request,
) -> Result<StopAnswers, &'static str> {
    let (keyboard, terminal) = Keyboard::for_requests();
    let _guest = hosting::launch_guest(&view.router, own.clone(), keyboard, view.ontology());
    let mut round = Round::new(own, terminal, request);
    round.run(view).await?;
    let Round { asked, mut answers, .. } = round;
    let mut table = BTreeMap::new();
    for agent in asked {
        let answer = answers.remove(&agent);
        let is_done = !matches!(answer, Some(StopAnswer::Declined(_)) | None);
        // Only agents with an action model act, and only they are in the table. Other agents
        // decline the request.
        if is_done || has_model(view, &agent).await {
            table.insert(agent, answer);
        }
    }
    Ok(table)
}

/// Whether an agent has announced an action model. An agent in another language may not know stops,
/// and must be in the table nevertheless.
async fn has_model(view: &EcosystemView, agent: &AgentId) -> bool {
    !view.ask(Resource::Model, Some(agent.clone())).await.is_empty()
}

/// A request to all agents, with the answers so far. When the command joins, it sees the agents one
/// after the other, and asks each as soon as it sees the agent.
struct Round {
    /// The agent that asks.
    own: AgentId,
    terminal: Terminal,
    content: Value,
    asked: BTreeSet<AgentId>,
    answers: BTreeMap<AgentId, StopAnswer>,
}

impl Round {
    fn new(own: AgentId, terminal: Terminal, request: &Request) -> Round {
        let content = value(request);
        Round { own, terminal, content, asked: BTreeSet::new(), answers: BTreeMap::new() }
    }

    /// Asks all agents, and waits until all have answered, or until the deadline. Returns an error
    /// if no agent is seen.
    async fn run(&mut self, view: &EcosystemView) -> Result<(), &'static str> {
        let deadline = tokio::time::sleep(ANSWERED_WITHIN);
        let (mut deadline, router) = (pin!(deadline), &view.router);
        let (_, mut changes) = router.presence_changes();
        let mut sees_all = pin!(sees_all(view));
        let mut is_complete = false;
        loop {
            self.ask_new(view)?;
            if is_complete && self.answers.len() == self.asked.len() {
                break;
            }
            tokio::select! {
                heard = self.terminal.events.recv() => {
                    let heard = heard.ok_or("hear the answers: the keyboard agent has ended")?;
                    if let UserEvent::Answered(_, message) = heard
                        && let Some(answer) = answer_of(&message)
                    {
                        self.answers.insert(message.sender.clone(), answer);
                    }
                }
                _ = changes.recv() => (),
                () = &mut sees_all, if !is_complete => is_complete = true,
                () = &mut deadline => break,
            }
        }
        if self.asked.is_empty() { Err("see any agent of the ecosystem") } else { Ok(()) }
    }

    /// Asks the agents that are seen and were not asked yet. If [`UNANSWERED_MAX`] agents have not
    /// answered, the others are asked after the next answers.
    fn ask_new(&mut self, view: &EcosystemView) -> Result<(), &'static str> {
        let directory = view.router.directory();
        let present = directory.iter().filter(|resident| !resident.daemon.is_guest());
        let others = present.map(|resident| &resident.agent).filter(|agent| **agent != self.own);
        for agent in others.cloned().collect::<Vec<_>>() {
            if self.asked.contains(&agent) || self.asked.len() > self.answers.len() + UNANSWERED_MAX
            {
                continue;
            }
            let draft = MessageDraft {
                to: Some(agent.clone()),
                performative: Performative::Request,
                protocol: Protocol::StateChange,
                conversation: None,
                content: self.content.clone(),
                patience: ANSWERED_WITHIN,
            };
            let sent = self.terminal.requests.try_send(UserRequest::Send(draft));
            sent.map_err(|_| "send the request: the keyboard agent has ended")?;
            self.asked.insert(agent);
        }
        Ok(())
    }
}

/// Completes when this process sees every agent that the daemons host. A joining process sees the
/// agents one after the other, and cannot know from them how many there are.
pub(crate) async fn sees_all(view: &EcosystemView) {
    let (_, mut changes) = view.router.presence_changes();
    view.router.broadcast_ready().await;
    let answers = view.ask(Resource::Directory, None).await;
    let read = |answer: &Bytes| serde_json::from_slice::<Vec<Resident>>(answer).ok();
    let mut missing: BTreeSet<_> =
        answers.iter().filter_map(read).flatten().map(|resident| resident.agent).collect();
    loop {
        let directory = view.router.directory();
        missing.retain(|agent| directory.find(agent).is_none());
        if missing.is_empty() {
            return;
        }
        // A receiver that lagged has missed changes; the directory has them.
        if changes.recv().await == Err(RecvError::Closed) {
            return;
        }
    }
}

/// Reads an answer to a stop or a release; `None` for a message that is no final answer.
fn answer_of(message: &Message) -> Option<StopAnswer> {
    match message.performative {
        Performative::Confirm => {
            let report = message.content_as::<Report>().ok()?;
            Some(match report.stop_effect {
                Some(StopEffect::Ended) => StopAnswer::Ended(report.detail),
                Some(StopEffect::Still) => StopAnswer::Still(report.detail),
                Some(StopEffect::Doubtful) => StopAnswer::Doubtful(report.detail),
                Some(StopEffect::Unconcerned) => StopAnswer::Unconcerned(report.detail),
                _ => StopAnswer::Done(report.detail),
            })
        }
        Performative::Refuse | Performative::NotUnderstood => {
            let why = message.content_as::<Refusal>().map(|refusal| refusal.detail);
            Some(StopAnswer::Declined(why.unwrap_or_else(|error| error.to_string())))
        }
        _ => None,
    }
}

/// Returns the agents with a driver that the ecosystem file names and that are absent. What their
/// devices do is unknown.
pub(crate) fn absent(view: &EcosystemView) -> Vec<AgentId> {
    let directory = view.router.directory();
    let entries = view.ecosystem.iter().flat_map(|ecosystem| &ecosystem.agents);
    let known = plugins::known();
    let is_device =
        |plugin: &str| known.iter().any(|known| known.name == plugin && !known.drivers.is_empty());
    entries
        .filter(|entry| is_device(&entry.plugin) && directory.find(&entry.name).is_none())
        .map(|entry| entry.name.clone())
        .collect()
}

/// Whether the name of a stop is that of an agent or of a place. Only the ecosystem file has the
/// places: without it, any name may be a place, unless the stop concerns nobody.
pub(crate) fn is_known(view: &EcosystemView, name: &str, concerns_any: bool) -> bool {
    let is_agent = AgentId::new(name).is_ok_and(|id| view.router.directory().find(&id).is_some());
    let is_place = |ecosystem: &Arc<Ecosystem>| {
        ecosystem.problem.objects.iter().any(|declared| declared.object.name == *name)
    };
    is_agent || view.ecosystem.as_ref().map_or(concerns_any, is_place)
}

/// Queries the stops, and the positions of hardware stops, that each actuator knows.
pub(crate) async fn states(view: &EcosystemView) -> Vec<StopState> {
    let answers = view.ask(Resource::Stops, None).await;
    answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
}

/// Returns the stops that any actuator knows, by their identifiers.
pub(crate) fn in_force(states: &[StopState]) -> BTreeMap<String, Stop> {
    let stops = states.iter().flat_map(|state| &state.stops);
    stops.map(|stop| (stop.id.clone(), stop.clone())).collect()
}
