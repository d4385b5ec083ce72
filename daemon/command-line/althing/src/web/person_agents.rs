//! The agents of the people that have signed in: one Keyboard Agent for each person, in this daemon,
//! named after the person and the daemon. It is launched with the first request, and ended when it
//! has not been used for a while. Its goals go on without it, as after a command.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use accounts::{Accounts, Person, PersonName, PersonRight};
use acl::content::Request;
use acl::{AgentId, ConversationId, DaemonId};
use keyboard::{Keyboard, RequestId, RequestSender, Terminal, UserEvent, UserRequest};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout_at};
use tokio_util::sync::DropGuard;

use super::history_readers::HistoryReaders;
use super::{DAEMON_CHARS_MAX, notifications};
use crate::ecosystem_view::EcosystemView;
use crate::hosting;

/// How long the agent of a person stays without a request. A person that asks for something every
/// few minutes keeps the same agent.
const IDLE_MAX: Duration = Duration::from_secs(30 * 60);

/// Interval at which idle agents, agents of removed people, and limited goals that have ended are
/// looked for.
const LOOKED_AT_EVERY: Duration = Duration::from_secs(10);

/// Maximum number of people with an agent at a time; more wait until others are idle.
const AGENTS_MAX: usize = 256;

/// Maximum number of goals with a time limit at a time.
const LIMITED_GOALS_MAX: usize = 256;

/// Places for events about one request. Progress beyond them is lost; it is in the view as well.
const EVENTS_MAX: usize = 32;

/// The point up to which a request is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FollowUntil {
    /// The first report or refusal.
    FirstAnswer,
    /// The end of the request.
    End,
}

/// The answers to a request, as far as it was followed.
#[derive(Debug, Default)]
pub(super) struct FollowedRequest {
    /// Conversation of the request; `None` if it was not sent.
    pub(super) conversation: Option<ConversationId>,
    /// The last answer; `None` if none came in time.
    pub(super) answer: Option<UserEvent>,
}

/// The agents of people.
pub(super) struct PersonAgents {
    view: EcosystemView,
    /// The state folder of the daemon, with the subscriptions of people to notifications.
    state: PathBuf,
    agents: Mutex<BTreeMap<PersonName, Arc<PersonAgent>>>,
    accounts: Mutex<Option<Arc<Accounts>>>,
    /// Places for goals with a time limit.
    limited_goals: Arc<Semaphore>,
    /// Number of agents launched for a single request so far.
    launched: AtomicU64,
    history_readers: HistoryReaders,
}

/// The agent of one person.
struct PersonAgent {
    requests: RequestSender,
    /// Receivers of the answers, by request.
    waiting: Mutex<BTreeMap<RequestId, mpsc::Sender<UserEvent>>>,
    used_at: Mutex<Instant>,
    _guard: DropGuard,
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

// === impl PersonAgents ===

impl PersonAgents {
    /// Creates the table of agents, without any.
    pub(super) fn new(view: EcosystemView, state: &Path) -> PersonAgents {
        PersonAgents {
            view,
            state: state.to_owned(),
            agents: Mutex::default(),
            accounts: Mutex::default(),
            limited_goals: Arc::new(Semaphore::new(LIMITED_GOALS_MAX)),
            launched: AtomicU64::new(0),
            history_readers: HistoryReaders::default(),
        }
    }

    /// Returns the agents that read the history for pages.
    pub(super) fn history_readers(&self) -> &HistoryReaders {
        &self.history_readers
    }

    /// Sets the people of the ecosystem. The agents of people that are removed end soon.
    pub(super) fn know_people(&self, accounts: Arc<Accounts>) {
        *lock(&self.accounts) = Some(accounts);
    }

    /// Returns the name of a person's agent.
    ///
    /// # Errors
    ///
    /// Returns an error if no agent can have the name. The text is for the person.
    pub(super) fn name_of(&self, person: &PersonName) -> Result<AgentId, String> {
        agent_name(person, "web", self.view.router.daemon())
    }

    /// Returns a new name for an agent of a person that makes a single request.
    ///
    /// # Errors
    ///
    /// Returns an error if no agent can have the name. The text is for the person.
    pub(super) fn new_name(&self, person: &PersonName, role: &str) -> Result<AgentId, String> {
        let number = self.launched.fetch_add(1, Ordering::Relaxed) + 1;
        let role = format!("{role}{number}");
        agent_name(person, &role, self.view.router.daemon())
    }

    /// Checks a request of an agent of a person against the rights of the ecosystem. Messages within
    /// one daemon are not checked against them, and this agent is no part of the ecosystem file.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for the person, if the agent may not make the request.
    pub(super) fn check_rights(&self, agent: &AgentId, request: &Request) -> Result<(), String> {
        let Some(ecosystem) = &self.view.ecosystem else { return Ok(()) };
        if ecosystem.security.is_none() {
            return Ok(());
        }
        ecosystem.rights.may_host(agent, self.view.router.daemon())?;
        ecosystem.rights.may_ask(agent, request)
    }

    /// Makes a request through the agent of a person, and follows it up to `until`, for `patience`
    /// at most.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for the person, if the request could not be sent.
    pub(super) async fn ask(
        &self,
        person: &PersonName,
        request: UserRequest,
        until: FollowUntil,
        patience: Duration,
    ) -> Result<FollowedRequest, String> {
        let agent = self.agent_of(person)?;
        let deadline = Instant::now() + patience;
        let place = timeout_at(deadline, agent.requests.reserve()).await;
        let place = match place {
            Ok(Ok(place)) => place,
            Ok(Err(_)) => {
                // The agent has failed; the next request launches another one.
                lock(&self.agents).remove(person);
                return Err("your agent in this daemon has failed; try again".to_owned());
            }
            Err(_) => return Err("too many of your requests wait; try again".to_owned()),
        };
        let (tell, mut told) = mpsc::channel(EVENTS_MAX);
        let id = place.id();
        lock(&agent.waiting).insert(id, tell);
        place.send(request);
        let mut followed = FollowedRequest::default();
        while let Ok(Some(event)) = timeout_at(deadline, told.recv()).await {
            if followed.note(event, until) {
                break;
            }
        }
        lock(&agent.waiting).remove(&id);
        Ok(followed)
    }

    /// Takes a place for a goal with a time limit, before the goal is requested. It is free again when
    /// the returned value is dropped.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for the person, if too many goals have a time limit.
    pub(super) fn limit_place(&self) -> Result<OwnedSemaphorePermit, String> {
        let place = Arc::clone(&self.limited_goals).try_acquire_owned();
        place.map_err(|_| {
            format!("{LIMITED_GOALS_MAX} goals have a time limit already; try again later")
        })
    }

    /// Cancels a goal of a person if it has not ended within `limit`. `has_ended` says whether it has;
    /// its place is then free again.
    pub(super) fn limit_goal(
        self: &Arc<Self>,
        person: &PersonName,
        goal: ConversationId,
        limit: Duration,
        place: OwnedSemaphorePermit,
        has_ended: impl Fn() -> bool + Send + 'static,
    ) {
        // The table of agents ends with the page, and the limits with it.
        let (agents, person) = (Arc::downgrade(self), person.clone());
        tokio::spawn(async move {
            let _place = place;
            let end = Instant::now() + limit;
            while Instant::now() < end {
                tokio::time::sleep_until(end.min(Instant::now() + LOOKED_AT_EVERY)).await;
                if has_ended() {
                    return;
                }
            }
            let Some(agents) = agents.upgrade() else { return };
            let (cancel, until) = (UserRequest::Cancel(goal.clone()), FollowUntil::FirstAnswer);
            // A goal that has ended is cancelled without an effect.
            if let Err(problem) = agents.ask(&person, cancel, until, Duration::ZERO).await {
                tracing::warn!(conversation = %goal, "the time limit of a goal: {problem}");
            }
        });
    }

    /// Removes the subscriptions of all but these people.
    async fn forget_strangers(&self, people: Vec<PersonName>) {
        let Some(ecosystem) = &self.view.ecosystem else { return };
        let (notifiers, state) = (notifications::notifiers(ecosystem), self.state.clone());
        let forget = move || notifications::forget_strangers(&notifiers, &state, &people);
        // A panic in it is reported by its own message.
        let _ = tokio::task::spawn_blocking(forget).await;
    }

    /// Returns the agent of a person; launches it if there is none.
    fn agent_of(&self, person: &PersonName) -> Result<Arc<PersonAgent>, String> {
        let mut agents = lock(&self.agents);
        if let Some(agent) = agents.get(person) {
            *lock(&agent.used_at) = Instant::now();
            return Ok(Arc::clone(agent));
        }
        if agents.len() >= AGENTS_MAX {
            return Err(format!("{AGENTS_MAX} people ask already; try again in some minutes"));
        }
        let id = self.name_of(person)?;
        let (keyboard, terminal) = Keyboard::for_requests();
        let guard = hosting::launch_guest(&self.view.router, id, keyboard, self.view.ontology());
        let Terminal { requests, events } = terminal;
        let agent = Arc::new(PersonAgent {
            requests,
            waiting: Mutex::default(),
            used_at: Mutex::new(Instant::now()),
            _guard: guard,
        });
        tokio::spawn(pass_on(events, Arc::downgrade(&agent)));
        agents.insert(person.clone(), Arc::clone(&agent));
        Ok(agent)
    }

    /// Ends the agents that were not used for a while, and those of people that were removed. The
    /// subscriptions to notifications of people without the right to look end as well. Never returns.
    pub(super) async fn end_idle(self: Arc<Self>) {
        let mut looks = interval(LOOKED_AT_EVERY);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut before = None;
        loop {
            looks.tick().await;
            self.history_readers.end_idle();
            let accounts = lock(&self.accounts).clone();
            let people: Option<Vec<Person>> = accounts.map(|accounts| accounts.people());
            let lookers = people.as_ref().map(|people| {
                let lookers = people.iter().filter(|person| person.may(PersonRight::Look));
                lookers.map(|person| person.name.clone()).collect::<Vec<PersonName>>()
            });
            let is_known = |name: &PersonName| match &people {
                Some(people) => people.iter().any(|person| person.name == *name),
                None => true,
            };
            lock(&self.agents).retain(|name, agent| {
                let is_used =
                    lock(&agent.used_at).elapsed() < IDLE_MAX || !lock(&agent.waiting).is_empty();
                is_used && is_known(name)
            });
            if let Some(lookers) = lookers.filter(|lookers| before.as_ref() != Some(lookers)) {
                self.forget_strangers(lookers.clone()).await;
                before = Some(lookers);
            }
        }
    }
}

/// Returns the name of an agent that acts for a person in a daemon. The name of the daemon is cut off
/// where the whole would be too long for a name.
fn agent_name(person: &PersonName, role: &str, daemon: &DaemonId) -> Result<AgentId, String> {
    /// Maximum number of characters of a name.
    const NAME_CHARS_MAX: usize = 64;
    let name = format!("{}-{role}-{}", person.as_str(), short(daemon));
    let name: String = name.chars().take(NAME_CHARS_MAX).collect();
    AgentId::new(&name).map_err(|error| error.to_string())
}

fn short(daemon: &DaemonId) -> String {
    daemon.as_str().chars().take(DAEMON_CHARS_MAX).collect()
}

/// Passes the outputs of an agent on to those that follow its requests, until the agent ends.
async fn pass_on(mut events: mpsc::Receiver<UserEvent>, agent: std::sync::Weak<PersonAgent>) {
    while let Some(event) = events.recv().await {
        let Some(agent) = agent.upgrade() else { return };
        let Some(id) = event.request() else { continue };
        if let Some(to) = lock(&agent.waiting).get(&id) {
            // A receiver that is full or gone misses progress only; the view has it.
            let _ = to.try_send(event);
        }
    }
    if let Some(agent) = agent.upgrade() {
        lock(&agent.waiting).clear();
    }
}

// === impl FollowedRequest ===

impl FollowedRequest {
    /// Notes an output about the request. Returns whether the request was followed far enough.
    fn note(&mut self, event: UserEvent, until: FollowUntil) -> bool {
        if let Some(conversation) = event.conversation() {
            self.conversation.get_or_insert_with(|| conversation.clone());
        }
        if matches!(event, UserEvent::Sent(_)) {
            return false;
        }
        let is_enough = until == FollowUntil::FirstAnswer || event.is_final();
        self.answer = Some(event);
        is_enough
    }
}

#[cfg(test)]
mod tests {
    use acl::content::{Outcome, Report};
    use keyboard::RequestRef;

    use super::*;

    #[test]
    fn an_agent_is_named_after_its_person_and_daemon() {
        let person = PersonName::new("ada").expect("a name");
        let daemon = DaemonId::new("a-daemon-with-a-very-long-name").expect("a name");
        let name = agent_name(&person, "web", &daemon).expect("a name");
        assert_eq!(name.as_str(), "ada-web-a-daemon-with-a-very");
        let longest = PersonName::new(&"a".repeat(32)).expect("a name");
        assert!(agent_name(&longest, "stop1000000", &daemon).is_ok(), "every person has an agent");
    }

    #[test]
    fn a_request_is_followed_to_its_first_answer_or_to_its_end() {
        let about = RequestRef { id: None, conversation: ConversationId::new("c") };
        let report = |outcome| UserEvent::Report(about.clone(), Report::new(outcome, "so"));
        let mut first = FollowedRequest::default();
        assert!(!first.note(UserEvent::Sent(about.clone()), FollowUntil::FirstAnswer));
        assert!(first.note(report(Outcome::Progress), FollowUntil::FirstAnswer));
        assert_eq!(first.conversation, Some(ConversationId::new("c")));
        let mut whole = FollowedRequest::default();
        assert!(!whole.note(report(Outcome::Progress), FollowUntil::End));
        assert!(whole.note(report(Outcome::Done), FollowUntil::End));
    }
}
