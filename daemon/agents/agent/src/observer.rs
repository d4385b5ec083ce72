//! Observer of agents: follows the presence, the models and the heartbeats of agents on the network
//! where they run, on behalf of another network. An observer sends nothing but requests for models.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Heartbeat, Inform, Methods, ModelAnnouncement};
use acl::{AgentId, EcosystemId, Incarnation, Message, Performative};
use capability::SilenceLimit;
use pddl::{ActionModel, InitElement};
use substrate::{Presence, Resource};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;

use crate::base_agent::Agent;
use crate::callbacks::Callbacks;
use crate::context::{Context, WorkHandle};

/// Latest snapshot of an observed agent.
#[derive(Clone, Debug)]
pub struct AgentSnapshot {
    /// Incarnation of the agent.
    pub incarnation: Incarnation,
    /// Ecosystems through which the agent was passed on before; empty if the agent belongs to the
    /// observed ecosystem.
    pub via: Vec<EcosystemId>,
    /// Action model that the agent has announced.
    pub model: Arc<ActionModel>,
    /// Methods of the agent, by the name of the action that each carries out.
    pub methods: Methods,
    /// Digest of the agent's action model and methods.
    pub digest: String,
    /// Facts of the agent's last heartbeat, each with the time at which the fact expires; `None`
    /// for a fact that does not expire.
    pub facts: Vec<(InitElement, Option<Instant>)>,
    /// Sequence number of the last heartbeat.
    sequence: u64,
    /// Time at which the agent counts as gone if no heartbeat comes before that time.
    due: Instant,
}

/// Receiver of the latest snapshot of an observed agent. The value is `None` until the agent is
/// present and its model is known, and again when the agent has gone.
pub type AgentWatch = watch::Receiver<Option<AgentSnapshot>>;

/// Agent that observes other agents and publishes a snapshot of each.
#[derive(Default)]
pub struct Observer {
    watched: BTreeMap<AgentId, watch::Sender<Option<AgentSnapshot>>>,
    fetching: BTreeMap<AgentId, WorkHandle>,
    /// Channel for agents that join and were not watched before; set only if all agents are
    /// watched.
    newcomers: Option<mpsc::Sender<(AgentId, AgentWatch)>>,
    /// How long an agent may be silent. The limit comes from the settings and is known once the
    /// observer is active.
    silence: SilenceLimit,
}

impl Observer {
    /// Creates an observer of these agents. Returns the observer, and one receiver of snapshots per
    /// agent.
    pub fn of(agents: impl Iterator<Item = AgentId>) -> (Observer, BTreeMap<AgentId, AgentWatch>) {
        let watched: BTreeMap<_, _> =
            agents.map(|agent| (agent, watch::Sender::new(None))).collect();
        let watches =
            watched.iter().map(|(agent, seen)| (agent.clone(), seen.subscribe())).collect();
        (Observer { watched, ..Observer::default() }, watches)
    }

    /// Creates an observer of all agents that join; `newcomers` gets the receiver of snapshots of
    /// each. An agent that joins while `newcomers` is full is not watched.
    pub fn of_all(newcomers: mpsc::Sender<(AgentId, AgentWatch)>) -> Observer {
        let newcomers = Some(newcomers);
        Observer { newcomers, ..Observer::default() }
    }

    /// Starts to watch an agent that has joined. Does nothing if this observer does not watch all
    /// agents.
    fn meet(&mut self, agent: &AgentId) {
        let Some(newcomers) = &self.newcomers else { return };
        if self.watched.contains_key(agent) {
            return;
        }
        let seen = watch::Sender::new(None);
        if newcomers.try_send((agent.clone(), seen.subscribe())).is_ok() {
            self.watched.insert(agent.clone(), seen);
        } else {
            tracing::warn!(%agent, "one agent too many: it is not watched");
        }
    }

    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        if !self.watched.contains_key(&message.sender) {
            return;
        }
        match message.content_as::<Inform>() {
            Ok(Inform::Model(announced)) => self.introduced(&message, &announced),
            Ok(Inform::Heartbeat(beat)) => {
                if !self.heard(&message, &beat) {
                    self.fetch(&message.sender, ctx);
                }
            }
            Ok(Inform::Epoch(_) | Inform::Answer(_)) => (),
            Err(error) => tracing::info!(from = %message.sender, %error, "it cannot be read"),
        }
    }

    /// Handles an announced model. An agent with a model that cannot be read counts as an agent
    /// without a model.
    fn introduced(&mut self, message: &Message, announced: &ModelAnnouncement) {
        let Some(seen) = self.watched.get(&message.sender) else { return };
        self.fetching.remove(&message.sender);
        let model = match pddl::parse_action_model(&announced.model).into_result() {
            Ok(model) => model,
            Err(found) => {
                let why = found.first().map(ToString::to_string).unwrap_or_default();
                tracing::warn!(agent = %message.sender, why, "a model that cannot be read");
                seen.send_replace(None);
                return;
            }
        };
        let heartbeat = &announced.heartbeat;
        let is_old = |snapshot: &AgentSnapshot| {
            snapshot.incarnation > message.incarnation
                || snapshot.incarnation == message.incarnation
                    && snapshot.sequence > heartbeat.sequence
        };
        if seen.borrow().as_ref().is_some_and(is_old) {
            return;
        }
        seen.send_replace(Some(AgentSnapshot {
            incarnation: message.incarnation,
            via: message.via.clone(),
            model: Arc::new(model),
            methods: announced.methods.clone(),
            digest: heartbeat.digest.clone(),
            facts: facts_of(heartbeat),
            sequence: heartbeat.sequence,
            due: due(heartbeat, self.silence),
        }));
    }

    /// Handles a heartbeat; returns `false` if the model that the heartbeat refers to is not known.
    fn heard(&mut self, message: &Message, beat: &Heartbeat) -> bool {
        let Some(seen) = self.watched.get(&message.sender) else { return true };
        let (mut is_known, silence) = (false, self.silence);
        seen.send_if_modified(|snapshot| {
            let of_it = |snapshot: &&mut AgentSnapshot| {
                snapshot.incarnation == message.incarnation && snapshot.digest == beat.digest
            };
            let Some(snapshot) = snapshot.as_mut().filter(of_it) else { return false };
            is_known = true;
            if snapshot.sequence >= beat.sequence {
                return false;
            }
            let facts = facts_of(beat);
            let told = |facts: &[(InitElement, Option<Instant>)]| -> Vec<InitElement> {
                facts.iter().map(|(fact, _)| fact.clone()).collect()
            };
            let is_news = told(&facts) != told(&snapshot.facts);
            (snapshot.facts, snapshot.sequence, snapshot.due) =
                (facts, beat.sequence, due(beat, silence));
            is_news
        });
        is_known
    }

    fn fetch(&mut self, whose: &AgentId, ctx: &mut Context<Self>) {
        if self.fetching.contains_key(whose) {
            return;
        }
        if ctx.find(whose).is_none() {
            return;
        }
        let (asked, name) = (ctx.ask(Resource::Model, whose), whose.clone());
        let work = ctx.run(asked, move |observer: &mut Self, answers, _| {
            observer.fetching.remove(&name);
            for message in answers.iter().filter_map(|answer| acl::decode(answer).ok()) {
                if let (true, Ok(Inform::Model(announced))) =
                    (message.sender == name, message.content_as::<Inform>())
                {
                    observer.introduced(&message, &announced);
                }
            }
        });
        self.fetching.insert(whose.clone(), work);
    }

    /// Drops the snapshot of each agent that has been silent for too long, even if the presence
    /// token of that agent remains. Runs twice per heartbeat period.
    fn look_around(&mut self, ctx: &mut Context<Self>) {
        let now = ctx.now();
        for (agent, seen) in &self.watched {
            let is_silent = seen.borrow().as_ref().is_some_and(|snapshot| snapshot.due < now);
            if is_silent {
                tracing::info!(%agent, "its heartbeats have stopped");
                seen.send_replace(None);
            }
        }
        let period = ctx.settings().heartbeat_period / 2;
        ctx.after(period, Self::look_around);
    }
}

impl Agent for Observer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.silence = ctx.settings().silence_limit();
        self.look_around(ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let resident = presence.resident();
        let is_other = resident.daemon != *ctx.daemon();
        if is_other && matches!(presence, Presence::Joined(_)) {
            self.meet(&resident.agent);
        }
        let Some(seen) = self.watched.get(&resident.agent) else { return };
        match presence {
            Presence::Joined(_) => self.fetch(&resident.agent, ctx),
            Presence::Left(_) => {
                self.fetching.remove(&resident.agent);
                let is_it = |snapshot: &AgentSnapshot| snapshot.incarnation <= resident.incarnation;
                if seen.borrow().as_ref().is_some_and(is_it) {
                    seen.send_replace(None);
                }
            }
        }
    }
}

/// Upper bounds of the heartbeat period and of the silence that is tolerated. A foreign agent
/// states the period of its heartbeats, and an unbounded period would overflow the clock.
const PERIOD_MAX: Duration = Duration::from_secs(3_600);
const SILENCE_MAX: Duration = Duration::from_secs(24 * 3_600);

/// Returns the time from which the sender of a heartbeat counts as silent.
fn due(beat: &Heartbeat, silence: SilenceLimit) -> Instant {
    let period = beat.period.0.min(PERIOD_MAX);
    let tolerated = silence.of_period(period).min(SILENCE_MAX);
    Instant::now() + tolerated
}

/// Returns the facts of a heartbeat, each with its expiry; `None` for a fact that does not expire.
/// Facts that cannot be parsed are left out.
fn facts_of(beat: &Heartbeat) -> Vec<(InitElement, Option<Instant>)> {
    let now = Instant::now();
    let lasting = pddl::parse_init_elements(&beat.facts).value.unwrap_or_default();
    let passing = beat.known_for.iter().filter_map(|(fact, left)| {
        let fact = pddl::parse_init_element(fact).into_result().ok()?;
        Some((fact, now.checked_add(left.0)))
    });
    lasting.into_iter().map(|fact| (fact, None)).chain(passing).collect()
}
