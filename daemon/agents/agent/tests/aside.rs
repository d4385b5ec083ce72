//! Background work: the callback of some work does not run after the handle of that work is
//! dropped.

use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
use agent::{
    Agent, AgentSettings, Callbacks, Context, LaunchContext, LaunchableAgent as _, MessageRouter,
    WorkHandle,
};
use substrate::memory::Network;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

/// Agent that starts two pieces of work, which finish at once; the first callback drops both
/// handles.
struct Fickle {
    works: Vec<WorkHandle>,
    told: mpsc::UnboundedSender<&'static str>,
}

impl Agent for Fickle {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.works = ["one", "other"]
            .map(|which| {
                ctx.run(std::future::ready(which), |fickle: &mut Self, which, _| {
                    fickle.works.clear();
                    fickle.told.send(which).expect("the test listens");
                })
            })
            .into();
        ctx.after(Duration::from_secs(1), |fickle: &mut Self, _| {
            fickle.told.send("later").expect("the test listens");
        });
    }
}

#[tokio::test(start_paused = true)]
async fn finished_work_does_not_call_back_after_its_handle_is_dropped() {
    let daemon = DaemonId::new("here").expect("a name");
    let ecosystem = EcosystemId::new("home").expect("a name");
    let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
    let network = Network::new();
    router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
    let (told, mut heard) = mpsc::unbounded_channel();
    let task = Box::new(Fickle { works: Vec::new(), told }).launch(LaunchContext {
        id: AgentId::new("fickle").expect("a name"),
        incarnation: Incarnation(1),
        router,
        ontology: Arc::from("d"),
        stopping: CancellationToken::new(),
        has_replicas: false,
        via: [].into(),
    });
    let first = heard.recv().await.expect("it lives");
    assert!(["one", "other"].contains(&first), "{first}");
    assert_eq!(heard.recv().await, Some("later"), "and nothing of the other");
    task.abort();
}
