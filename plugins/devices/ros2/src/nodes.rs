//! The nodes of ROS behind one address: whether they are reached, what their topics tell, and their
//! actions and services.
//!
//! - The link is opened in the background. While there is none, the topics tell nothing.
//! - Each topic is read at most every [`READ_APART`], so that a node that floods a topic costs little.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use actuator::MethodFailure;
use ros2_link::{ActionClient, LinkReach, LinkWatch, RosError, RosGoalStatus, RosLink, printable};
use serde_json::Value;
use tokio::sync::{Mutex, watch};
use tokio::time::Instant;
use tokio_util::task::AbortOnDropHandle;

use crate::config::{ActionCall, Settings, TopicRule};
use crate::fact::FactState;

/// How long a link is awaited by an action and by the subscription to a topic. A node that changes
/// its access point is away for some seconds.
const LINK_WITHIN: Duration = Duration::from_secs(5);

/// Least time between two messages of a topic that are read. People and plans need no more.
const READ_APART: Duration = Duration::from_millis(20);

/// Pause before a topic is subscribed to again after an error.
const SUBSCRIBE_AGAIN: Duration = Duration::from_secs(1);

/// Time after which a question without an answer was held by a node. Without such a node, Zenoh ends
/// the question within the round trip.
const HELD_FOR: Duration = Duration::from_secs(1);

/// The link to the nodes, with the tasks that follow it.
pub(crate) struct RosNodes {
    link: RosLink,
    /// Clients of the actions, by their names and types. The first call of an action makes its client.
    clients: Mutex<BTreeMap<String, ActionClient>>,
    pub(crate) state: Arc<watch::Sender<NodeState>>,
    _watch: LinkWatch,
    _tasks: Vec<AbortOnDropHandle<()>>,
}

/// The last that was heard of the nodes.
#[derive(Clone, Debug)]
pub(crate) struct NodeState {
    /// Whether the nodes are reached.
    pub(crate) is_reached: bool,
    /// The last message of each topic, in the order of the config.
    pub(crate) topics: Vec<TopicReport>,
}

/// What the last message of a topic tells.
#[derive(Clone, Debug, Default)]
pub(crate) struct TopicReport {
    /// When the message came; `None` if there was none since the link exists.
    heard_at: Option<Instant>,
    facts: Vec<FactState>,
}

impl TopicReport {
    /// Returns the state of the fact at `index`, which is unknown if the message is too old.
    pub(crate) fn fact(&self, index: usize, valid_for: Option<Duration>) -> FactState {
        let is_valid = match (self.heard_at, valid_for) {
            (None, _) => false,
            (Some(_), None) => true,
            (Some(heard_at), Some(valid_for)) => heard_at.elapsed() < valid_for,
        };
        let state = self.facts.get(index).filter(|_| is_valid);
        state.copied().unwrap_or_default()
    }

    /// Returns when the facts become unknown without a further message; `None` if they are already,
    /// or never do.
    pub(crate) fn expiry(&self, valid_for: Option<Duration>) -> Option<Instant> {
        let until = self.heard_at? + valid_for?;
        (until > Instant::now()).then_some(until)
    }

    /// Takes the states of a message that came now. Returns whether a truth has changed; another
    /// number travels with the next heartbeat.
    fn take(&mut self, facts: Vec<FactState>, valid_for: Option<Duration>) -> bool {
        let is_same = |(index, fact): (usize, &FactState)| {
            std::mem::discriminant(&self.fact(index, valid_for)) == std::mem::discriminant(fact)
        };
        let is_news = !facts.iter().enumerate().all(is_same);
        *self = TopicReport { heard_at: Some(Instant::now()), facts };
        is_news
    }

    /// Replaces the state of one fact, as if a message had told it now.
    pub(crate) fn put(&mut self, index: usize, state: FactState) {
        if let Some(fact) = self.facts.get_mut(index).filter(|_| self.heard_at.is_some()) {
            *fact = state;
        }
    }
}

impl RosNodes {
    /// Begins to open the link, and follows the topics.
    ///
    /// # Errors
    ///
    /// Returns an error if the address is malformed.
    pub(crate) fn open(agent: &str, settings: &Settings) -> Result<RosNodes, RosError> {
        let interfaces = Arc::new(settings.interfaces.clone());
        let link = RosLink::open(settings.address.clone(), interfaces)?;
        let topics = vec![TopicReport::default(); settings.topics.len()];
        let state = Arc::new(watch::Sender::new(NodeState { is_reached: false, topics }));
        let watch = LinkWatch::start(link.clone(), agent);
        let following = follow_link(watch.state(), Arc::clone(&state));
        let mut tasks = vec![AbortOnDropHandle::new(tokio::spawn(following))];
        for (index, rule) in settings.topics.iter().enumerate() {
            let follower = TopicFollower {
                agent: agent.to_owned(),
                link: link.clone(),
                rule: rule.clone(),
                index,
                state: Arc::clone(&state),
            };
            tasks.push(AbortOnDropHandle::new(tokio::spawn(follower.follow())));
        }
        Ok(RosNodes { link, clients: Mutex::default(), state, _watch: watch, _tasks: tasks })
    }

    /// Carries out an action, and returns the result. Dropping the future cancels the goal.
    ///
    /// # Errors
    ///
    /// Returns [`MethodFailure::Driver`] if nothing was begun, or if the node itself reports a
    /// failure; another error if it is unknown how much was done.
    pub(crate) async fn run(
        &self,
        call: &ActionCall,
        request: &Value,
    ) -> Result<Value, MethodFailure> {
        let asked = tokio::time::timeout(call.time_out, self.ask(call, request)).await;
        let result = asked.unwrap_or(Err(MethodFailure::TimedOut(call.time_out)))?;
        match call.success.as_ref().map(|success| success.holds(&result)) {
            None | Some(Some(true)) => Ok(result),
            Some(Some(false)) => Err(reported(call, &result)),
            Some(None) => Err(MethodFailure::Interrupted(format!(
                "learn whether `{}` has succeeded: its result was lost, or lacks the field of \
                 `success`",
                call.name
            ))),
        }
    }

    /// Cancels all goals of these actions, also those of other programs, and waits until their
    /// servers have none. The time of the wait is not bounded.
    ///
    /// # Errors
    ///
    /// Returns an error if a server does not confirm the cancellation. A server that is not there
    /// has no goal.
    pub(crate) async fn end_all(&self, calls: &[ActionCall]) -> Result<(), RosError> {
        for call in calls.iter().filter(|call| call.is_action) {
            match self.client(call).await?.end_all().await {
                Ok(()) | Err(RosError::NoAnswer { .. }) => (),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    async fn ask(&self, call: &ActionCall, request: &Value) -> Result<Value, MethodFailure> {
        let not_begun = |error: RosError| MethodFailure::Driver(error.to_string());
        self.link.until_linked(LINK_WITHIN).await.map_err(not_begun)?;
        if !call.is_action {
            let began = Instant::now();
            let ActionCall { name, type_name, time_out, .. } = call;
            let answer = self.link.call(name, type_name, request, *time_out).await;
            return answer.map_err(|error| failure_of(&error, began.elapsed()));
        }
        let client = self.client(call).await.map_err(not_begun)?;
        let began = Instant::now();
        let sent = client.send(request).await;
        let mut goal = sent.map_err(|error| failure_of(&error, began.elapsed()))?;
        let end = goal.end(|_| ()).await;
        let end = end.map_err(|error| MethodFailure::Interrupted(error.to_string()))?;
        let by_another = |what: &str| {
            MethodFailure::Interrupted(format!("finish `{}`: another program{what}", call.name))
        };
        match end.status {
            RosGoalStatus::Succeeded => Ok(end.result),
            RosGoalStatus::Canceled => Err(by_another(" cancelled the goal")),
            _ if end.is_replaced => Err(by_another("'s goal took the place of this one")),
            RosGoalStatus::Aborted | RosGoalStatus::Active => Err(reported(call, &end.result)),
        }
    }

    async fn client(&self, call: &ActionCall) -> Result<ActionClient, RosError> {
        let mut clients = self.clients.lock().await;
        let ActionCall { name, type_name, .. } = call;
        let key = format!("{name} {type_name}");
        if let Some(client) = clients.get(&key) {
            return Ok(client.clone());
        }
        let client = ActionClient::new(&self.link, name, type_name, LINK_WITHIN).await?;
        clients.insert(key, client.clone());
        Ok(client)
    }
}

/// Returns the failure that a node reports by its result.
fn reported(call: &ActionCall, result: &Value) -> MethodFailure {
    let told = call.told(result).unwrap_or_else(|| match call.reason {
        Some(_) => "it failed, and gives no reason".to_owned(),
        None => "it failed; `reason` can name the field with the reason".to_owned(),
    });
    MethodFailure::Driver(format!("carry out `{}`: {told}", call.name))
}

impl ActionCall {
    /// Returns the text in the field `reason` of a result; `None` if it is empty.
    pub(crate) fn told(&self, result: &Value) -> Option<String> {
        let text = self.reason.as_ref()?.value(result)?.as_str()?;
        (!text.is_empty()).then(|| printable(text))
    }
}

/// Returns the failure of a question that ended after the time `after`.
fn failure_of(error: &RosError, after: Duration) -> MethodFailure {
    let text = error.to_string();
    let is_not_begun = match error {
        RosError::NotLinked { .. } | RosError::Encode { .. } | RosError::Rejected { .. } => true,
        RosError::UnknownType(_) | RosError::Address(_) => true,
        RosError::NoAnswer { .. } => after < HELD_FOR,
        _ => false,
    };
    if is_not_begun { MethodFailure::Driver(text) } else { MethodFailure::Interrupted(text) }
}

/// Follows the state of the link until the watch over it ends. Nodes that are out of reach have told
/// nothing.
async fn follow_link(mut link: watch::Receiver<LinkReach>, state: Arc<watch::Sender<NodeState>>) {
    loop {
        let is_reached = *link.borrow_and_update() == LinkReach::Reached;
        state.send_if_modified(|state| {
            if !is_reached {
                state.topics.iter_mut().for_each(|topic| *topic = TopicReport::default());
            }
            std::mem::replace(&mut state.is_reached, is_reached) != is_reached
        });
        if link.changed().await.is_err() {
            return;
        }
    }
}

/// The task of one topic.
struct TopicFollower {
    agent: String,
    link: RosLink,
    rule: TopicRule,
    index: usize,
    state: Arc<watch::Sender<NodeState>>,
}

impl TopicFollower {
    async fn follow(self) {
        let mut reached = self.state.subscribe();
        loop {
            if reached.wait_for(|state| state.is_reached).await.is_err() {
                return;
            }
            // The subscription is made anew with each link: then a latched message comes again.
            let until_lost = async { drop(reached.wait_for(|state| !state.is_reached).await) };
            let error = tokio::select! {
                error = self.read() => error,
                () = until_lost => continue,
            };
            tracing::warn!(agent = self.agent, "failed to {error}");
            tokio::time::sleep(SUBSCRIBE_AGAIN).await;
        }
    }

    /// Reads messages until the subscription fails, and returns the error.
    async fn read(&self) -> RosError {
        let TopicRule { name, type_name, .. } = &self.rule;
        let mut reader = match self.link.subscribe(name, type_name, LINK_WITHIN).await {
            Ok(reader) => reader,
            Err(error) => return error,
        };
        let mut is_told = false;
        loop {
            let facts = match reader.next().await {
                Ok(message) => self.rule.facts.iter().map(|fact| fact.state(&message)).collect(),
                Err(error @ RosError::Zenoh(_)) => return error,
                // The node tells something else than its type says, so nothing is known.
                Err(error) => {
                    if !std::mem::replace(&mut is_told, true) {
                        tracing::warn!(agent = self.agent, "failed to {error}");
                    }
                    vec![FactState::Unknown; self.rule.facts.len()]
                }
            };
            self.state.send_if_modified(|state| match state.topics.get_mut(self.index) {
                Some(topic) if state.is_reached => topic.take(facts, self.rule.valid_for),
                _ => false,
            });
            tokio::time::sleep(READ_APART).await;
        }
    }
}
