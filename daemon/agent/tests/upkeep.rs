//! What a Domain Maintainer keeps of agents that fall silent, over the in-memory substrate.

use std::sync::Arc;
use std::time::Duration;

use acl::content::{Heartbeat, Inform, ModelAnnouncement};
use acl::{AgentId, DaemonId, Deadline, EcosystemId, Incarnation, Message, Performative};
use agent::upkeep::{self, Maintains, Upkeep};
use agent::{Agent, Berth, Callbacks, Context, Launch as _, Presence, Settings, Switchboard};
use capability::{Change, Maintainer, Scope, model_digest};
use substrate::memory::Network;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

const ONTOLOGY: &str = "(define (domain test) (:requirements :typing)
    (:types room sensor) (:predicates (known ?r - room)))";
const MAP: &str =
    "(define (problem map) (:domain test) (:objects hall - room) (:init) (:goal (and)))";
const MODEL: &str = "(define (agent meter) (:domain test) (:objects meter - sensor)
    (:action measure :agent ?s - sensor :parameters (?r - room) :effect (known ?r)))";

/// Beats so many times, saying that it knows the hall; then lives on without a word.
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
            period: Deadline(ctx.settings().heartbeat_period),
        };
        let (model, methods) = (MODEL.to_owned(), [].into());
        ctx.beat(&Inform::Model(Box::new(ModelAnnouncement { model, methods, heartbeat })));
        ctx.after(ctx.settings().heartbeat_period, |meter: &mut Self, ctx| meter.beat(ctx));
    }
}

/// Keeps a maintainer, and tells how what it believes changes.
struct Keeper {
    upkeep: Upkeep,
    changes: mpsc::UnboundedSender<Change>,
}

impl Agent for Keeper {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        upkeep::presence(self, presence, ctx);
    }
}

impl Maintains for Keeper {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn changed(&mut self, change: &Change, _ctx: &mut Context<Self>) {
        let _ = self.changes.send(change.clone());
    }
}

impl Keeper {
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        upkeep::informed(self, &message, ctx);
    }
}

/// Lives through a meter of so many heartbeats; when its capability left, and when its fact did.
async fn silence_of(beats: u64) -> (Duration, Duration) {
    let name = |text: &str| AgentId::new(text).expect("a name");
    let daemon = DaemonId::new("d").expect("a name");
    let ecosystem = EcosystemId::new("test").expect("a name");
    let switchboard = Switchboard::new(ecosystem, daemon.clone(), Settings::default());
    let network = Network::new();
    switchboard.connect(network.open(daemon, Arc::<Switchboard>::clone(&switchboard) as _));
    let berth = |id: &str, life| Berth {
        id: name(id),
        incarnation: Incarnation(life),
        switchboard: Arc::clone(&switchboard),
        ontology: Arc::from("test"),
        stopping: CancellationToken::new(),
    };
    let (ontology, map) = (pddl::parse_domain(ONTOLOGY).value, pddl::parse_problem(MAP).value);
    let maintainer =
        Maintainer::new(ontology.expect("a domain"), map.expect("a problem"), Scope::Everything);
    let (tell, mut changes) = mpsc::unbounded_channel();
    let keeper = Keeper { upkeep: Upkeep::new(maintainer), changes: tell };
    let _keeper = Box::new(keeper).launch(berth("keeper", 1));
    let began = Instant::now();
    let _meter = Box::new(Meter { beats_left: beats, sequence: 0 }).launch(berth("meter", 2));
    let mut masked = None;
    loop {
        let change = changes.recv().await.expect("the keeper lives");
        if change.left.contains(&name("meter")) {
            masked = masked.or(Some(began.elapsed()));
        }
        if !change.retracted.is_empty() {
            return (masked.expect("masked before it is forgotten"), began.elapsed());
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_silent_agent_is_masked_then_forgotten_although_its_token_stays() {
    let Settings { heartbeat_period, heartbeat_lease, removal, .. } = Settings::default();
    for beats in [1, 3] {
        let (masked, forgotten) = silence_of(beats).await;
        let last_beat = heartbeat_period * u32::try_from(beats - 1).expect("few");
        let about = |told: Duration, expected: Duration| {
            assert!(told >= expected && told < expected + Duration::from_millis(50), "{told:?}");
        };
        about(masked, last_beat + heartbeat_lease);
        about(forgotten, masked + removal);
    }
}
