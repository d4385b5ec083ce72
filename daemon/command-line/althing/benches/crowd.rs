//! The cost of a thousand agents in one ecosystem, on ten daemons of this machine.
//!
//! ```text
//! cargo bench -p althing --bench crowd
//! ```
//!
//! Ten processes are linked by Zenoh, each with each, as `althing up` does on one machine. Each
//! hosts a hundred actuators that send a heartbeat once a second, and one of them also hosts a
//! Domain Maintainer. Two things are measured: the processor time of all ten together while nothing
//! else happens, as the kernel counts it; and the time from an agent's activation until the Domain
//! Maintainer announces the domain with it. The second is measured for the first actuator of a
//! daemon that has just joined, which queries the models of all others, and for thirty more.

mod support;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::Inform;
use acl::{AgentId, Message, Performative};
use agent::{Agent, Callbacks, Context, Host, LaunchError, MessageRouter};
use support::{Figures, Outcome, PATIENCE, workers};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// Allocator of the benchmark: the same as in the daemon.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const DAEMONS: usize = 10;
const AGENTS_EACH: usize = 100;
const CORE_SHARE_AIM: f64 = 15.0;
const COMPOSED_AIM_MS: f64 = 20.0;

/// The time to settle before the measurement, and the time of the measurement.
const SETTLING: Duration = Duration::from_secs(10);
const MEASURED: Duration = Duration::from_secs(20);

/// Number of agents that join while the agents of all daemons are present.
const NEWCOMERS: usize = 30;

#[tokio::main]
async fn main() -> Outcome<()> {
    workers::be_one().await?;
    let (each, newcomers) =
        if support::is_whole() { (AGENTS_EACH, NEWCOMERS) } else { (AGENTS_EACH / 20, 1) };
    let folder = tempfile::Builder::new().prefix("alt-").tempdir()?;
    let children = workers::start(folder.path(), DAEMONS, each).await?;
    let others: Vec<_> = (0..DAEMONS).map(workers::name).collect();
    let observer = support::daemon(folder.path(), workers::ECOSYSTEM, "observer", &others).await?;
    let (tell, mut epochs) = mpsc::unbounded_channel();
    support::launch(
        &AgentId::new("listener")?,
        Box::new(Listener(tell)),
        &observer,
        workers::ECOSYSTEM,
    );
    let all = (0..DAEMONS * each).map(workers::agent_name);
    support::await_offers(&observer, &all.collect::<BTreeSet<_>>()).await?;
    let host = Arc::new(workers::host()?);
    let mut first = Figures::default();
    let (took, _first) = join("first", 0, &host, &observer, &mut epochs).await?;
    first.push(took);
    tokio::time::sleep(if support::is_whole() { SETTLING } else { Duration::from_secs(1) }).await;

    let before = support::processor_time(&children)?;
    let began = Instant::now();
    tokio::time::sleep(if support::is_whole() { MEASURED } else { Duration::from_secs(2) }).await;
    let share =
        (support::processor_time(&children)? - before) / began.elapsed().as_secs_f64() * 100.0;
    let verdict = support::verdict(share <= CORE_SHARE_AIM);
    println!(
        "{} agents on {DAEMONS} daemons, a heartbeat each second: {share:.1} % of a core for all, \
         aim ≤ {CORE_SHARE_AIM} %: {verdict}",
        DAEMONS * each
    );

    first
        .tell("the first agent of a daemon that has just come: activation to announced everywhere");
    let mut figures = Figures::default();
    for newcomer in 0..newcomers {
        let name = format!("newcomer-{newcomer}");
        let (took, task) = join(&name, newcomer, &host, &observer, &mut epochs).await?;
        figures.push(took);
        task.abort();
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
    figures.tell("an agent joins: activation to announced everywhere");
    support::judge("p99", figures.within(0.99), COMPOSED_AIM_MS);
    support::reached()
}

/// Launches an agent. Returns the time until the domain with the agent was announced, and the task
/// of the agent.
async fn join(
    name: &str,
    place: usize,
    host: &Arc<Host>,
    daemon: &Arc<MessageRouter>,
    epochs: &mut mpsc::UnboundedReceiver<Vec<AgentId>>,
) -> Outcome<(Duration, JoinHandle<Result<(), LaunchError>>)> {
    while epochs.try_recv().is_ok() {}
    let (id, began) = (AgentId::new(name)?, Instant::now());
    let task = workers::launch(&id, place, host, daemon)?;
    loop {
        let joined = tokio::time::timeout(PATIENCE, epochs.recv()).await?;
        if joined.ok_or("the listener has ended")?.contains(&id) {
            return Ok((began.elapsed(), task));
        }
    }
}

/// Receives the announcements of agents that have joined.
struct Listener(mpsc::UnboundedSender<Vec<AgentId>>);

impl Agent for Listener {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }
}

impl Listener {
    fn informed(&mut self, message: Message, _ctx: &mut Context<Self>) {
        if message.sender.as_str() != "domain-maintainer" {
            return;
        }
        if let Ok(Inform::Epoch(change)) = message.content_as::<Inform>() {
            // The receiver is gone when the benchmark ends.
            let _ = self.0.send(change.joined);
        }
    }
}
