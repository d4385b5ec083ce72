//! What a view costs, and how quickly it shows what happens.
//!
//! ```text
//! cargo bench -p althing --bench view
//! ```
//!
//! A daemon hosts a hundred actuators that send a heartbeat once a second. `althing view` runs in a
//! pseudo-terminal, and this benchmark reads its output, as a terminal emulator would. An agent
//! joins in a second daemon; measured is the time until its name stands on the screen. Then the same
//! beside a hundred views whose terminals take no output, and the processor time of the daemon per open
//! view.

#[path = "support/emulator.rs"]
mod emulator;
mod support;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::AgentId;
use agent::{Host, MessageRouter};
use emulator::TerminalEmulator;
use support::{Figures, Outcome, PATIENCE, workers};
use tokio::process::Child;

/// Allocator of the benchmark: the same as in the daemon.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const DEVICES: usize = 100;
const EVENTS: usize = 200;
const MUTE_VIEWS: usize = 100;
const SEEN_AIM_MS: f64 = 60.0;
const CORE_SHARE_AIM: f64 = 1.0;

/// Number of views whose cost in the daemon is measured together.
const COUNTED_VIEWS: usize = 10;

/// The time to settle before a measurement, and the time of the measurement of processor time.
const SETTLING: Duration = Duration::from_secs(10);
const MEASURED: Duration = Duration::from_secs(20);

/// The time between two events, and between the starts of two views: all at once would measure the
/// starts of processes.
const PAUSE: Duration = Duration::from_millis(150);

#[tokio::main]
async fn main() -> Outcome<()> {
    workers::be_one().await?;
    let whole = support::is_whole();
    let (devices, events, mute) = if whole { (DEVICES, EVENTS, MUTE_VIEWS) } else { (5, 2, 2) };
    let folder = tempfile::Builder::new().prefix("alt-").tempdir()?;
    let children = workers::start(folder.path(), 1, devices).await?;
    let others = [workers::name(0)];
    let visitor = support::daemon(folder.path(), workers::ECOSYSTEM, "visitor", &others).await?;
    let all = (0..devices).map(workers::agent_name);
    support::await_offers(&visitor, &all.collect::<BTreeSet<_>>()).await?;
    let socket = folder.path().join(format!("{}.sock", workers::name(0)));
    let endpoint = format!("unixsock-stream/{}", socket.display());
    let host = Arc::new(workers::host()?);

    let view = open(&endpoint)?;
    view.await_text(workers::ECOSYSTEM, PATIENCE)?;
    settle(whole).await;
    let figures = measure(&view, events, "a", &host, &visitor).await?;
    figures.tell("an agent joins: its activation to its name on the screen");
    support::judge("p99", figures.within(0.99), SEEN_AIM_MS);

    let mut muted = Vec::new();
    for _ in 0..mute {
        muted.push(open_mute(&endpoint)?);
        tokio::time::sleep(PAUSE).await;
    }
    // A view leaves the ecosystem when its terminal has taken nothing for ten seconds.
    settle(whole).await;
    settle(whole).await;
    let figures = measure(&view, events, "b", &host, &visitor).await?;
    figures.tell(&format!("the same beside {mute} views that do not read"));
    support::judge("p99", figures.within(0.99), SEEN_AIM_MS);
    drop(muted);
    drop(view);

    settle(whole).await;
    let without = share(&children, whole).await?;
    let counted = if whole { COUNTED_VIEWS } else { 1 };
    let views: Outcome<Vec<_>> = (0..counted).map(|_| open(&endpoint)).collect();
    let views = views?;
    for view in &views {
        view.await_text(workers::ECOSYSTEM, PATIENCE)?;
    }
    settle(whole).await;
    let with = share(&children, whole).await?;
    let each = (with - without) / counted as f64;
    let verdict = support::verdict(each <= CORE_SHARE_AIM);
    println!(
        "    the daemon takes {without:.1} % of a core without a view and {with:.1} % with \
         {counted}: {each:.2} % each, aim ≤ {CORE_SHARE_AIM} %: {verdict}"
    );
    support::reached()
}

/// Waits until nothing of the start is left: a view does not tell the agents that it finds there.
async fn settle(whole: bool) {
    tokio::time::sleep(if whole { SETTLING } else { SETTLING / 2 }).await;
}

/// Opens a view of the ecosystem at its page of activities.
fn open(endpoint: &str) -> Outcome<TerminalEmulator> {
    TerminalEmulator::run(env!("CARGO_BIN_EXE_althing"), &arguments(endpoint), (100, 40))
}

/// Opens a view in a terminal that never reads.
fn open_mute(endpoint: &str) -> Outcome<emulator::MuteTerminal> {
    emulator::MuteTerminal::run(env!("CARGO_BIN_EXE_althing"), &arguments(endpoint))
}

fn arguments(endpoint: &str) -> [&str; 6] {
    ["view", "activity", "--ecosystem", workers::ECOSYSTEM, "--connect", endpoint]
}

/// Lets agents join one after the other, and measures how soon each is seen.
async fn measure(
    view: &TerminalEmulator,
    events: usize,
    series: &str,
    host: &Arc<Host>,
    visitor: &Arc<MessageRouter>,
) -> Outcome<Figures> {
    let mut figures = Figures::default();
    for event in 0..events {
        let name = format!("visitor-{series}{event:03}");
        let (id, began) = (AgentId::new(&name)?, Instant::now());
        let task = workers::launch(&id, event, host, visitor)?;
        // The name stands on the screen while the sentence about it is among the last ones.
        let took = tokio::task::block_in_place(|| view.await_text(&name, PATIENCE))?;
        figures.push(took.saturating_duration_since(began));
        task.abort();
        tokio::time::sleep(PAUSE).await;
    }
    Ok(figures)
}

/// Measures how much of a core the daemons take, in per cent.
async fn share(children: &[Child], whole: bool) -> Outcome<f64> {
    let (before, began) = (support::processor_time(children)?, Instant::now());
    tokio::time::sleep(if whole { MEASURED } else { Duration::from_secs(1) }).await;
    Ok((support::processor_time(children)? - before) / began.elapsed().as_secs_f64() * 100.0)
}
