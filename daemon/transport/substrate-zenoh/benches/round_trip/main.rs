//! Measures the cost of a conversation between two agents, compared with plain Zenoh: a request and
//! a reply between two daemons, compared with an echo over plain Zenoh that is also passed to a
//! Tokio task.
//!
//! ```text
//! cargo bench -p substrate-zenoh --bench round_trip [-- TURNS]
//! ```
//!
//! - `plain` is the baseline: declared publishers, callbacks, channels and tasks, and nothing else.
//! - `substrate` adds this crate: keys are parsed, and publishers are looked up.
//! - `agents` is the whole stack: an agent asks, another answers, with everything that the
//!   Communication Agent does for them (JSON, protocols, deadlines, duplicates, receipts).
//! - `secured` is the same as `agents`, over mutual TLS, with every message signed, checked for
//!   replay, and checked against the rights of its sender.
//!
//! All four use real router sessions over TCP on this machine, at ports that the kernel chooses.
//! They run alternately within one run, so that a busy moment of the machine affects all of them.

mod agents;
mod plain;
mod secured;
mod substrate;

use std::time::{Duration, Instant};

use bytes::Bytes;
use secured::House;
use tokio::sync::mpsc::{self, Receiver, Sender, UnboundedReceiver};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Default number of turns of each candidate: a run then takes seconds on any machine, and the p99
/// is stable.
const TURNS: usize = 100;

/// Number of round trips that a candidate makes before the next one runs. The number is so large
/// that the change of candidates does not count, and so small that drift affects all candidates
/// alike.
const ROUND_TRIPS_PER_TURN: usize = 200;

/// Maximum ratio of the p50 of `agents` to the p50 of `plain`.
const AIM: f64 = 1.3;

/// Maximum ratio of the p50 of `secured` to the p50 of `agents`.
const SECURED_AIM: f64 = 2.5;

/// Lengths of the messages of a round trip, in bytes.
#[derive(Clone, Copy, Debug)]
struct Sizes {
    request: usize,
    reply: usize,
}

/// Handle of a task that makes the requested number of round trips, and returns the duration of
/// each.
struct Asker {
    turns: Sender<usize>,
    taken: Receiver<Vec<Duration>>,
}

/// Runs the benchmark on two worker threads, as many as the daemon has.
#[tokio::main(worker_threads = 2)]
async fn main() -> Result<(), Error> {
    let turns = turns()?;
    let house = House::new()?;
    let (mut agents, sizes, daemons) = agents::start(None).await?;
    let (mut secured, _, secured_daemons) = agents::start(Some(&house)).await?;
    let (mut substrate, substrates) = substrate::start(sizes).await?;
    let (mut plain, sessions) = plain::start(sizes).await?;
    let mut taken = [const { Vec::new() }; 4];
    let mut warm = false;
    for _ in 0..=turns {
        let askers = [&mut plain, &mut substrate, &mut agents, &mut secured];
        for (asker, taken) in askers.into_iter().zip(&mut taken) {
            let turn = asker.turn().await?;
            taken.extend(turn.into_iter().filter(|_| warm));
        }
        warm = true;
    }
    report(turns, sizes, taken.map(Figures::of));
    // The process ends with its sessions open: if two sessions close at once in one process, Zenoh
    // 1.10 sometimes panics on a receiving thread (`Option::unwrap` in `resource.rs`).
    std::mem::forget((daemons, secured_daemons, substrates, sessions));
    Ok(())
}

/// Returns the number of turns from the command line; 1 if Cargo only tests whether the benchmark
/// runs.
fn turns() -> Result<usize, Error> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let default = if arguments.iter().any(|argument| argument == "--bench") { TURNS } else { 1 };
    let number = arguments.iter().find(|argument| !argument.starts_with('-'));
    Ok(number.map_or(Ok(default), |number| number.parse())?.max(1))
}

fn report(turns: usize, sizes: Sizes, [plain, substrate, agents, secured]: [Figures; 4]) {
    let Sizes { request, reply } = sizes;
    println!(
        "{} round trips each, {request} B there and {reply} B back",
        turns * ROUND_TRIPS_PER_TURN
    );
    println!("{:<10} {:>10} {:>10} {:>14}", "", "p50", "p99", "p50 ÷ plain");
    let rows = [&plain, &substrate, &agents, &secured];
    for (name, figures) in ["plain", "substrate", "agents", "secured"].into_iter().zip(rows) {
        let Figures { p50, p99 } = figures;
        let ratio = figures.ratio(&plain);
        println!("{name:<10} {p50:>10.1?} {p99:>10.1?} {ratio:>14.2}");
    }
    let ratio = agents.ratio(&plain);
    let verdict = if ratio <= AIM { "reached" } else { "missed" };
    println!("agents ÷ plain, p50: {ratio:.2}, aim ≤ {AIM}: {verdict}");
    let ratio = secured.ratio(&agents);
    let verdict = if ratio <= SECURED_AIM { "reached" } else { "missed" };
    println!("secured ÷ agents, p50: {ratio:.2}, aim ≤ {SECURED_AIM}: {verdict}");
}

struct Figures {
    p50: Duration,
    p99: Duration,
}

impl Figures {
    fn of(mut taken: Vec<Duration>) -> Figures {
        taken.sort_unstable();
        Figures { p50: taken[taken.len() / 2], p99: taken[taken.len() * 99 / 100] }
    }

    fn ratio(&self, other: &Figures) -> f64 {
        self.p50.as_secs_f64() / other.p50.as_secs_f64()
    }
}

// === impl Asker ===

impl Asker {
    async fn turn(&mut self) -> Result<Vec<Duration>, Error> {
        self.turns.send(ROUND_TRIPS_PER_TURN).await?;
        self.taken.recv().await.ok_or_else(|| "the asker has ended".into())
    }

    /// Returns an asker that sends bytes and waits for bytes.
    fn of_bytes(
        send: impl Fn(Bytes) -> Result<(), Error> + Send + 'static,
        mut heard: UnboundedReceiver<Bytes>,
        request_bytes: usize,
    ) -> Asker {
        let (turns, mut asked) = mpsc::channel(1);
        let (tell, taken) = mpsc::channel(1);
        tokio::spawn(async move {
            let request = Bytes::from(vec![7; request_bytes]);
            while let Some(count) = asked.recv().await {
                let mut taken = Vec::with_capacity(count);
                for _ in 0..count {
                    let start = Instant::now();
                    send(request.clone())?;
                    heard.recv().await.ok_or("the session closed")?;
                    taken.push(start.elapsed());
                }
                tell.send(taken).await?;
            }
            Ok::<_, Error>(())
        });
        Asker { turns, taken }
    }
}

/// Starts the task that answers every message.
fn echo(
    send: impl Fn(Bytes) -> Result<(), Error> + Send + 'static,
    mut heard: UnboundedReceiver<Bytes>,
    reply_bytes: usize,
) {
    tokio::spawn(async move {
        let reply = Bytes::from(vec![7; reply_bytes]);
        while heard.recv().await.is_some() {
            send(reply.clone())?;
        }
        Ok::<_, Error>(())
    });
}
