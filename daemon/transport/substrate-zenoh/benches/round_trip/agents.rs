//! The benchmark of the whole stack: two daemons, with an agent that requests changes of the state
//! and one that confirms them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{ChangeState, Outcome, Report, Request, value};
use acl::{AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Message};
use acl::{Performative, Protocol};
use agent::{
    Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, LaunchContext, LaunchableAgent,
    Participation,
};
use agent::{AgentSettings, MessageRouter, WorkHandle};
use substrate::Substrate;
use substrate_zenoh::ZenohSubstrate;
use tokio::sync::mpsc::{self, Receiver, Sender};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use crate::secured::House;
use crate::{Asker, Error, Sizes};

/// How long an answer is awaited. On one machine, an answer that takes longer means a defect.
const PATIENCE: Duration = Duration::from_secs(10);

/// Handles that keep the daemons running.
pub(crate) struct Daemons {
    _substrates: [Arc<ZenohSubstrate>; 2],
    _stopping: CancellationToken,
}

/// Starts two daemons with one agent each, and measures the length of the agents' messages. The
/// links are plain, unless `house` contains certificates for them. Returns the handle that makes
/// round trips, the lengths, and the daemons, which stop on drop.
pub(crate) async fn start(house: Option<&House>) -> Result<(Asker, Sizes, Daemons), Error> {
    let stopping = CancellationToken::new();
    let (here, a) = open("a", &[], house).await?;
    let (there, b) = open("b", &a.locators(), house).await?;
    let (turns, asked) = mpsc::channel(1);
    let (tell, taken) = mpsc::channel(1);
    let (tell_reply_bytes, reply_bytes) = oneshot::channel();
    let (tell_request_bytes, request_bytes) = oneshot::channel();
    let curious = Curious {
        turns: Some(asked),
        waiting: None,
        began: Instant::now(),
        left: 0,
        taken: Vec::new(),
        tell,
        tell_reply_bytes: Some(tell_reply_bytes),
    };
    let echo = Echo { tell_request_bytes: Some(tell_request_bytes) };
    launch(echo, "echo", &there, &stopping)?;
    launch(curious, "asker", &here, &stopping)?;
    let mut asker = Asker { turns, taken };
    asker.turn().await?;
    let sizes = Sizes { request: request_bytes.await?, reply: reply_bytes.await? };
    Ok((asker, sizes, Daemons { _substrates: [a, b], _stopping: stopping }))
}

async fn open(
    daemon: &str,
    connect: &[String],
    house: Option<&House>,
) -> Result<(Arc<MessageRouter>, Arc<ZenohSubstrate>), Error> {
    let ecosystem = if house.is_some() { "secured" } else { "agents" };
    let (id, name) = (DaemonId::new(daemon)?, EcosystemId::new(ecosystem)?);
    let router = MessageRouter::new(name, id, AgentSettings::default());
    let mut config = crate::substrate::config(ecosystem, daemon, connect)?;
    if let Some(house) = house {
        config.listen = vec!["tls/127.0.0.1:0".to_owned()];
        config.security = Some(house.security(daemon)?);
        router.set_rights(House::rights());
    }
    let substrate = config.open(Arc::<MessageRouter>::clone(&router)).await?;
    router.connect(Arc::<ZenohSubstrate>::clone(&substrate) as Arc<dyn Substrate>);
    Ok((router, substrate))
}

fn launch(
    agent: impl Agent,
    id: &str,
    router: &Arc<MessageRouter>,
    stopping: &CancellationToken,
) -> Result<(), Error> {
    let launch_context = LaunchContext {
        id: AgentId::new(id)?,
        incarnation: Incarnation(1),
        router: Arc::clone(router),
        ontology: Arc::from("smart-office"),
        stopping: stopping.clone(),
        has_replicas: false,
        via: [].into(),
    };
    Box::new(agent).launch(launch_context);
    Ok(())
}

/// Agent that confirms every request.
struct Echo {
    tell_request_bytes: Option<oneshot::Sender<usize>>,
}

impl Agent for Echo {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, Self::requested)
    }
}

impl Echo {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        if let Some(tell) = self.tell_request_bytes.take() {
            let _ = tell.send(acl::encode(&message).len());
        }
        let report = Report::new(Outcome::Done, "the state is changed");
        ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
    }
}

/// Agent that sends a number of requests, each when the answer to the one before has come.
struct Curious {
    turns: Option<Receiver<usize>>,
    waiting: Option<WorkHandle>,
    began: Instant,
    left: usize,
    taken: Vec<Duration>,
    tell: Sender<Vec<Duration>>,
    tell_reply_bytes: Option<oneshot::Sender<usize>>,
}

impl Agent for Curious {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.await_turn(ctx);
    }
}

impl Curious {
    fn await_turn(&mut self, ctx: &mut Context<Self>) {
        let Some(mut turns) = self.turns.take() else { return };
        let wait = async move { (turns.recv().await, turns) };
        self.waiting = Some(ctx.run(wait, |curious, (count, turns), ctx| {
            curious.turns = Some(turns);
            curious.left = count.unwrap_or(0);
            if curious.left > 0 {
                curious.ask(ctx);
            }
        }));
    }

    fn ask(&mut self, ctx: &mut Context<Self>) {
        self.began = Instant::now();
        let change = ChangeState { believe: "(door-open d1)".to_owned(), ..Default::default() };
        let opening = ExchangeOpening {
            to: AgentId::new("echo").ok(),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: ConversationId::new("round-trip"),
            content: value(&Request::ChangeState(change)),
        };
        ctx.open(opening, PATIENCE, Self::answered);
    }

    fn answered(&mut self, answer: ExchangeEvent, ctx: &mut Context<Self>) {
        self.taken.push(self.began.elapsed());
        let ExchangeEvent::Message(message) = answer else { panic!("no answer, but {answer:?}") };
        if let Some(tell) = self.tell_reply_bytes.take() {
            let _ = tell.send(acl::encode(&message).len());
        }
        self.left -= 1;
        if self.left > 0 {
            return self.ask(ctx);
        }
        // An error means that the benchmark has ended.
        let _ = self.tell.try_send(std::mem::take(&mut self.taken));
        self.await_turn(ctx);
    }
}
