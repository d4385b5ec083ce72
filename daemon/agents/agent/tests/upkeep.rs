//! How a Domain Maintainer, and the shared domain of a daemon, treat agents that fall silent, over
//! the in-memory substrate.

use std::sync::Arc;
use std::time::Duration;

use acl::content::{
    EpochChange, Heartbeat, Inform, Mailboxes, ModelAnnouncement, Requested, RequestedFact,
    RequestedSince,
};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Message, Millis, Performative};
use agent::domain_sync::{self, DomainSync, MaintainsDomain};
use agent::{
    Agent, AgentSettings, Callbacks, Context, Host, LaunchContext, LaunchableAgent as _,
    MessageRouter, Presence, SharedDomain,
};
use capability::{DomainChange, Maintainer, MaintainerScope, model_digest};
use pddl::InitElement;
use substrate::memory::Network;
use substrate::{Resource, ResourceQuery};
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout};
use tokio_util::sync::CancellationToken;

const ONTOLOGY: &str = "(define (domain test) (:requirements :typing)
    (:types room sensor) (:predicates (known ?r - room)))";
const MAP: &str =
    "(define (problem map) (:domain test) (:objects hall - room) (:init) (:goal (and)))";
const MODEL: &str = "(define (agent meter) (:domain test) (:objects meter - sensor)
    (:action measure :agent ?s - sensor :parameters (?r - room) :effect (known ?r)))";

/// Agent that sends `beats_left` announcements, which state that the meter knows the hall; then it
/// stays present and silent.
struct Meter {
    beats_left: u64,
    sequence: u64,
}

impl Agent for Meter {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.beat(ctx);
    }
}

impl Meter {
    fn beat(&mut self, ctx: &mut Context<Self>) {
        let Some(left) = self.beats_left.checked_sub(1) else { return };
        self.beats_left = left;
        self.sequence += 1;
        let heartbeat = Heartbeat {
            digest: model_digest(MODEL, &[].into()),
            sequence: self.sequence,
            facts: "(known hall)".to_owned(),
            known_for: [].into(),
            period: Millis(ctx.settings().heartbeat_period),
            stops: Vec::new(),
        };
        let (model, methods) = (MODEL.to_owned(), [].into());
        ctx.broadcast_state(&Inform::Model(Box::new(ModelAnnouncement {
            model,
            methods,
            heartbeat,
        })));
        ctx.after(ctx.settings().heartbeat_period, |meter: &mut Self, ctx| meter.beat(ctx));
    }
}

/// Agent that keeps a Domain Maintainer, and reports the changes of the domain.
struct Keeper {
    domain_sync: DomainSync,
    changes: mpsc::UnboundedSender<DomainChange>,
}

impl Agent for Keeper {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        domain_sync::presence(self, presence, ctx);
    }
}

impl MaintainsDomain for Keeper {
    fn domain_sync(&mut self) -> &mut DomainSync {
        &mut self.domain_sync
    }

    fn domain_changed(&mut self, change: &DomainChange, _ctx: &mut Context<Self>) {
        let _ = self.changes.send(change.clone());
    }
}

impl Keeper {
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        domain_sync::receive_inform(self, &message, ctx);
    }
}

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// A daemon on an in-memory network, and launch contexts on it.
struct House {
    router: Arc<MessageRouter>,
    _network: Network,
}

impl House {
    fn new() -> House {
        House::with(AgentSettings::default())
    }

    fn with(settings: AgentSettings) -> House {
        let daemon = DaemonId::new("d").expect("a name");
        let ecosystem = EcosystemId::new("test").expect("a name");
        let router = MessageRouter::new(ecosystem, daemon.clone(), settings);
        let network = Network::new();
        router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
        House { router, _network: network }
    }

    fn launch_context(&self, id: &str, incarnation: u64) -> LaunchContext {
        LaunchContext {
            id: name(id),
            incarnation: Incarnation(incarnation),
            router: Arc::clone(&self.router),
            ontology: Arc::from("test"),
            stopping: CancellationToken::new(),
            has_replicas: false,
            via: [].into(),
        }
    }

    /// Returns the shared domain of the daemon; the first call creates it, as the first actuator
    /// does.
    fn commons(&self) -> Arc<SharedDomain> {
        let (ontology, map) = (pddl::parse_domain(ONTOLOGY).value, pddl::parse_problem(MAP).value);
        let host = Host::new(ontology.expect("a domain"), map.expect("a problem"));
        self.router.shared_domain(&Host { settings: self.router.settings().clone(), ..host })
    }

    /// Launches a keeper on this daemon; returns the receiver of the changes that the keeper
    /// reports.
    fn keep(&self, scope: MaintainerScope) -> mpsc::UnboundedReceiver<DomainChange> {
        let (ontology, map) = (pddl::parse_domain(ONTOLOGY).value, pddl::parse_problem(MAP).value);
        let maintainer =
            Maintainer::new(ontology.expect("a domain"), map.expect("a problem"), scope)
                .with_silence_limit(self.router.settings().silence_limit());
        let (tell, changes) = mpsc::unbounded_channel();
        let keeper = Keeper { domain_sync: DomainSync::new(maintainer), changes: tell };
        drop(Box::new(keeper).launch(self.launch_context("keeper", 1)));
        changes
    }
}

/// Longer than any lease of these tests: a wait that takes this long has failed.
const FAR: Duration = Duration::from_secs(3600);

/// Runs a meter that sends `beats` heartbeats. Returns the time when its capability left the
/// domain, and the time when its fact became unknown.
async fn silence_of(beats: u64, settings: AgentSettings) -> (Duration, Duration) {
    let house = House::with(settings);
    let mut changes = house.keep(MaintainerScope::Everything);
    let began = Instant::now();
    let _meter =
        Box::new(Meter { beats_left: beats, sequence: 0 }).launch(house.launch_context("meter", 2));
    let mut masked = None;
    loop {
        let change = timeout(FAR, changes.recv()).await.expect("the keeper tells of it");
        let change = change.expect("the keeper lives");
        if change.left.contains(&name("meter")) {
            masked = masked.or(Some(began.elapsed()));
        }
        let is_unknown = |fact: &InitElement| fact.to_string() == "(unknown (known hall))";
        if change.believed.iter().any(is_unknown) {
            return (masked.expect("masked before it is forgotten"), began.elapsed());
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_silent_agent_is_masked_then_removed_although_its_token_stays() {
    let patient =
        AgentSettings { heartbeat_lease: Duration::from_secs(9), ..AgentSettings::default() };
    for (beats, settings) in
        [(1, AgentSettings::default()), (3, AgentSettings::default()), (2, patient)]
    {
        let AgentSettings { heartbeat_period, heartbeat_lease, removal, .. } = settings.clone();
        let (masked, forgotten) = silence_of(beats, settings).await;
        let last_beat = heartbeat_period * u32::try_from(beats - 1).expect("few");
        let about = |told: Duration, expected: Duration| {
            assert!(told >= expected && told < expected + Duration::from_millis(50), "{told:?}");
        };
        about(masked, last_beat + heartbeat_lease);
        about(forgotten, masked + removal);
    }
}

/// Whether the shared domain lists the meter as present, and whether the fact about the hall is
/// known, at this time of the test.
async fn known_at(commons: &SharedDomain, began: Instant, time: Duration) -> (bool, bool) {
    tokio::time::sleep_until(began + time).await;
    let (known, now) = commons.current();
    let problem = known.snapshot_for(&[].into(), now).problem.to_string();
    let is_known = problem.contains("(known hall)") && !problem.contains("(unknown (known hall))");
    (known.is_present(&name("meter")), is_known)
}

#[tokio::test(start_paused = true)]
async fn the_shared_domain_reads_earlier_broadcasts_and_applies_expiries_in_time() {
    let AgentSettings { heartbeat_lease, removal, .. } = AgentSettings::default();
    let (house, began, blink) = (House::new(), Instant::now(), Duration::from_millis(50));
    let _meter =
        Box::new(Meter { beats_left: 1, sequence: 0 }).launch(house.launch_context("meter", 1));
    tokio::time::sleep(blink).await;
    let commons = house.commons();
    let (then, _) = commons.current();
    assert_eq!(known_at(&commons, began, heartbeat_lease - blink).await, (true, true));
    assert_eq!(known_at(&commons, began, heartbeat_lease + blink * 2).await, (false, true));
    let late = house.commons();
    assert!(Arc::ptr_eq(&late, &commons), "one for all");
    let forgotten = heartbeat_lease + removal + blink * 2;
    assert_eq!(known_at(&commons, began, forgotten).await, (false, false));
    assert!(then.is_present(&name("meter")), "an earlier snapshot does not change");

    let (house, began) = (House::new(), Instant::now());
    let commons = house.commons();
    let _meter =
        Box::new(Meter { beats_left: 1, sequence: 0 }).launch(house.launch_context("meter", 1));
    assert_eq!(known_at(&commons, began, heartbeat_lease * 9).await, (false, false));
}

#[tokio::test(start_paused = true)]
async fn a_late_maintainer_gets_the_models_of_present_agents() {
    for has_commons in [false, true] {
        let house = House::new();
        let commons = has_commons.then(|| house.commons());
        let _meter =
            Box::new(Meter { beats_left: 1, sequence: 0 }).launch(house.launch_context("meter", 1));
        tokio::time::sleep(Duration::from_millis(50)).await;
        if let Some(commons) = commons {
            let digest = model_digest(MODEL, &[].into());
            let (known, _) = commons.current();
            assert!(known.announcement(&name("meter"), Incarnation(1), &digest).is_some());
        }
        let (began, mut changes) = (Instant::now(), house.keep(MaintainerScope::Everything));
        let change = changes.recv().await.expect("the keeper lives");
        assert_eq!((change.joined, began.elapsed()), (vec![name("meter")], Duration::ZERO));
    }
}

#[tokio::test(start_paused = true)]
async fn a_daemon_answers_queries_for_its_own_models_at_once() {
    let house = House::new();
    let _meter =
        Box::new(Meter { beats_left: 1, sequence: 0 }).launch(house.launch_context("meter", 1));
    tokio::time::sleep(Duration::from_millis(50)).await;
    for (agent, count) in [(None, 1), (Some(name("meter")), 1), (Some(name("nobody")), 0)] {
        let daemon = Some(house.router.daemon().clone());
        let ask = ResourceQuery { daemon, resource: Resource::Model, agent };
        let answers = house.router.ask(ask, Duration::ZERO).await;
        assert_eq!(answers.len(), count);
        assert!(answers.iter().all(|answer| acl::decode(answer).is_ok()));
    }
}

/// Agent that announces once the changes that requests made, as a Domain Maintainer does. With
/// `has_model`, it announces a model of its own, too.
struct Teller {
    change: EpochChange,
    has_model: bool,
}

impl Agent for Teller {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        if self.has_model {
            let model = MODEL.replace("agent meter", "agent teller").replace("meter -", "teller -");
            let heartbeat = Heartbeat {
                digest: model_digest(&model, &[].into()),
                sequence: 1,
                facts: String::new(),
                known_for: [].into(),
                period: Millis(ctx.settings().heartbeat_period),
                stops: Vec::new(),
            };
            let methods = [].into();
            ctx.broadcast_state(&Inform::Model(Box::new(ModelAnnouncement {
                model,
                methods,
                heartbeat,
            })));
        }
        ctx.after(Duration::from_secs(1), |teller: &mut Self, ctx| {
            ctx.inform_all(&Inform::Epoch(teller.change.clone()));
        });
    }
}

fn facts(facts: &[(&str, Option<u64>)]) -> Vec<RequestedFact> {
    let fact = |(fact, known_for): &(&str, Option<u64>)| RequestedFact {
        fact: (*fact).to_owned(),
        owner: name("ann"),
        known_for: known_for.map(Millis::from),
    };
    facts.iter().map(fact).collect()
}

/// Returns an announcement of all changes that requests made.
fn told(these: &[(&str, Option<u64>)]) -> EpochChange {
    let requested = Requested { facts: facts(these), ..Requested::default() };
    EpochChange { requested: Some(requested), ..EpochChange::default() }
}

/// Returns an announcement of the changes that requests made since the last announcement.
fn told_anew(these: &[(&str, Option<u64>)]) -> EpochChange {
    let since = RequestedSince { facts: facts(these), ..RequestedSince::default() };
    EpochChange { requested_since: Some(since), ..EpochChange::default() }
}

/// Whether the fact about the hall is known in the shared domain before it receives `change`, soon
/// after, and a second later.
async fn known_when_told(change: EpochChange, has_model: bool) -> [bool; 3] {
    let (house, began) = (House::new(), Instant::now());
    let commons = house.commons();
    drop(Box::new(Teller { change, has_model }).launch(house.launch_context("teller", 2)));
    let mut known = [false; 3];
    for (known, time) in known.iter_mut().zip([900, 1_100, 2_100]) {
        (_, *known) = known_at(&commons, began, Duration::from_millis(time)).await;
    }
    known
}

/// Returns the facts that a central Domain Maintainer believes after `change`.
async fn believed(change: EpochChange) -> Vec<String> {
    let house = House::new();
    let mut changes = house.keep(MaintainerScope::Everything);
    drop(Box::new(Teller { change, has_model: false }).launch(house.launch_context("teller", 2)));
    let mut heard = Vec::new();
    while let Ok(change) = timeout(Duration::from_secs(2), changes.recv()).await {
        let DomainChange { believed, .. } = change.expect("the keeper lives");
        heard.extend(believed.iter().map(ToString::to_string));
    }
    heard
}

#[tokio::test(start_paused = true)]
async fn requested_changes_reach_maintainers_that_receive_heartbeats_only() {
    for tell in [told, told_anew] {
        let known = tell(&[("(known hall)", Some(500))]);
        assert_eq!(known_when_told(known, false).await, [false, true, false]);
        let lasting = tell(&[("(known hall)", None)]);
        assert_eq!(known_when_told(lasting.clone(), false).await, [false, true, true]);
        // A central maintainer ignores the announcement, and an agent with a model is no Domain
        // Maintainer.
        assert_eq!(believed(lasting.clone()).await, [""; 0]);
        assert_eq!(known_when_told(lasting, true).await, [false; 3]);
        assert_eq!(known_when_told(tell(&[("(known", None)]), false).await, [false; 3]);
    }
}

/// Agent that announces a model that cannot be parsed, and states the digest of that model in a
/// heartbeat every second.
struct Mumbler {
    sequence: u64,
}

impl Agent for Mumbler {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.beat(ctx);
    }
}

impl Mumbler {
    fn beat(&mut self, ctx: &mut Context<Self>) {
        self.sequence += 1;
        let heartbeat = Heartbeat {
            digest: "mumbled".to_owned(),
            sequence: self.sequence,
            facts: String::new(),
            known_for: [].into(),
            period: Millis(ctx.settings().heartbeat_period),
            stops: Vec::new(),
        };
        let (model, methods) = ("(define (agent mumb".to_owned(), [].into());
        ctx.broadcast_state(&match self.sequence {
            1 => Inform::Model(Box::new(ModelAnnouncement { model, methods, heartbeat })),
            _ => Inform::Heartbeat(heartbeat),
        });
        ctx.after(ctx.settings().heartbeat_period, |mumbler: &mut Self, ctx| mumbler.beat(ctx));
    }
}

/// Returns how many messages this daemon has counted as not understood.
async fn not_understood(router: &MessageRouter) -> Option<u64> {
    let daemon = Some(router.daemon().clone());
    let ask = ResourceQuery { daemon, resource: Resource::Mailbox, agent: None };
    let answers = router.ask(ask, Duration::ZERO).await;
    let told: Mailboxes = serde_json::from_slice(answers.first()?).expect("mailboxes");
    told.rejected.get("not-understood").copied()
}

#[tokio::test(start_paused = true)]
async fn a_rejected_model_is_counted_and_read_again_after_a_while() {
    for (has_commons, has_keeper) in [(true, false), (false, true), (true, true)] {
        let (house, began) = (House::new(), Instant::now());
        let _commons = has_commons.then(|| house.commons());
        let _changes = has_keeper.then(|| house.keep(MaintainerScope::Everything));
        let _mumbler = Box::new(Mumbler { sequence: 0 }).launch(house.launch_context("mumbler", 1));
        for (seconds, expected) in [(1, 1), (9, 1), (12, 2)] {
            tokio::time::sleep_until(began + Duration::from_millis(seconds * 1_000 + 500)).await;
            let counted = not_understood(&house.router).await;
            assert_eq!(counted, Some(expected), "{has_commons} {has_keeper} {seconds}");
        }
    }
}
