//! An agent that overhears the others: which messages it gets, and what it learns of those that it
//! was too slow for.

use std::sync::Arc;
use std::time::Duration;

use acl::content::{Mode, Request, SetMode};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative};
use agent::{
    Agent, AgentSettings, Callbacks, Context, LaunchContext, LaunchableAgent, MessageRouter,
    OverheardBatch,
};
use bytes::Bytes;
use substrate::Substrate;
use substrate::memory::Network;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// Agent that overhears at most `waiting_max` messages at a time, and passes the batches on.
struct Listener {
    waiting_max: usize,
    batches: mpsc::UnboundedSender<OverheardBatch>,
}

impl Agent for Listener {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let heard = |listener: &mut Self, batch, _: &mut Context<Self>| {
            let _ = listener.batches.send(batch);
        };
        ctx.overhear(self.waiting_max, heard).expect("the substrate is open");
    }
}

/// Agent that sends one request, to an agent of another daemon, when it is activated.
struct Speaker;

impl Agent for Speaker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let request = Request::SetMode(SetMode { mode: Mode::Centralized });
        ctx.send_once(&name("somebody"), Performative::Request, &request);
    }
}

type Port = Arc<dyn Substrate>;

fn daemon(network: &Network, daemon: &str) -> (Arc<MessageRouter>, Port) {
    let ecosystem = EcosystemId::new("test").expect("a name");
    let daemon = DaemonId::new(daemon).expect("a name");
    let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
    let port = network.open(daemon, Arc::<MessageRouter>::clone(&router) as _);
    router.connect(Arc::clone(&port));
    (router, port)
}

fn launch(router: &Arc<MessageRouter>, agent: impl Agent, id: &str) {
    let task = Box::new(agent).launch(LaunchContext {
        id: name(id),
        incarnation: Incarnation(1),
        router: Arc::clone(router),
        ontology: Arc::from("test"),
        stopping: CancellationToken::new(),
        has_replicas: false,
        via: [].into(),
    });
    tokio::spawn(task);
}

#[tokio::test(start_paused = true)]
async fn an_agent_overhears_messages_between_others() {
    let network = Network::new();
    let ((home, _), (away, port)) = (daemon(&network, "home"), daemon(&network, "away"));
    let (tell, mut batches) = mpsc::unbounded_channel();
    launch(&home, Listener { waiting_max: 100, batches: tell }, "listener");
    tokio::time::sleep(Duration::from_millis(10)).await;
    let (mailbox, _kept) = mpsc::unbounded_channel();
    launch(&home, Listener { waiting_max: 1, batches: mailbox }, "somebody");
    tokio::time::sleep(Duration::from_millis(10)).await;
    launch(&away, Speaker, "speaker");
    port.broadcast_state(&name("garbler"), Bytes::from_static(b"{")).expect("open");
    tokio::time::sleep(Duration::from_secs(1)).await;

    let (mut requests, mut unreadable) = (Vec::new(), 0);
    while let Ok(batch) = batches.try_recv() {
        assert_eq!(batch.lost, 0);
        unreadable += batch.unreadable;
        let messages = batch.messages.into_iter().map(|overheard| overheard.message);
        requests.extend(messages.filter(|message| message.sender == name("speaker")));
    }
    assert_eq!(unreadable, 1);
    let acts: Vec<_> = requests.iter().map(|message| message.performative).collect();
    assert!(acts.contains(&Performative::Request), "{requests:?}");
    let request = requests[0].content_as::<Request>();
    assert!(matches!(request, Ok(Request::SetMode(_))), "{request:?}");
}

#[tokio::test(start_paused = true)]
async fn messages_beyond_the_queue_are_counted() {
    let network = Network::new();
    let ((home, _), (_away, port)) = (daemon(&network, "home"), daemon(&network, "away"));
    let (tell, mut batches) = mpsc::unbounded_channel();
    launch(&home, Listener { waiting_max: 10, batches: tell }, "listener");
    tokio::time::sleep(Duration::from_millis(10)).await;
    // All of them arrive before the agent runs again.
    for _ in 0..100 {
        port.broadcast_state(&name("busy"), Bytes::from_static(b"{")).expect("open");
    }
    tokio::time::sleep(Duration::from_secs(1)).await;
    let (mut received, mut lost) = (0, 0);
    while let Ok(batch) = batches.try_recv() {
        received += batch.unreadable;
        lost += batch.lost;
    }
    assert_eq!((received, lost), (10, 90));
}
