//! False departures: daemons that count as gone although they run, on a machine with all cores
//! busy.
//!
//! ```text
//! cargo bench -p althing --bench departures [-- --minutes 60]
//! ```
//!
//! Five daemons with twenty actuators each, at the default settings, and two threads per core that
//! only use processor time. An observer counts departures by a lost token; a Domain Maintainer
//! counts the agents that it masks, also because heartbeats are missing.

mod support;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use acl::content::Inform;
use acl::{AgentId, Message, Performative};
use agent::{Agent, Callbacks, Context, Presence};
use support::{Outcome, workers};

const DAEMONS: usize = 5;
const AGENTS_EACH: usize = 20;
const BURNERS_PER_CORE: usize = 2;

const MINUTES: u64 = 60;

#[tokio::main]
async fn main() -> Outcome<()> {
    workers::be_one().await?;
    let minutes = std::env::args().skip_while(|argument| argument != "--minutes").nth(1);
    let whole = if support::is_whole() { MINUTES * 60 } else { 2 };
    let lasts = Duration::from_secs(minutes.map_or(Ok(whole), |m| m.parse().map(|m: u64| m * 60))?);
    let folder = tempfile::Builder::new().prefix("alt-").tempdir()?;
    let _children = workers::start(folder.path(), DAEMONS, AGENTS_EACH).await?;
    let others: Vec<_> = (0..DAEMONS).map(workers::name).collect();
    let observer = support::daemon(folder.path(), workers::ECOSYSTEM, "observer", &others).await?;
    let departed = Arc::new(Departed::default());
    let listener = Box::new(Listener(Arc::clone(&departed)));
    support::launch(&AgentId::new("listener")?, listener, &observer, workers::ECOSYSTEM);
    let all = (0..DAEMONS * AGENTS_EACH).map(workers::agent_name);
    support::await_offers(&observer, &all.collect::<BTreeSet<_>>()).await?;
    departed.reset();
    let cores = std::thread::available_parallelism()?.get();
    for _ in 0..cores * BURNERS_PER_CORE {
        std::thread::spawn(|| {
            loop {
                std::hint::black_box(std::hint::black_box(1_u64).wrapping_mul(3));
            }
        });
    }
    println!("{DAEMONS} daemons, {} agents, {cores} cores fully loaded", DAEMONS * AGENTS_EACH);
    let began = Instant::now();
    while began.elapsed() < lasts {
        let next = Duration::from_secs(300).min(lasts - began.elapsed().min(lasts));
        tokio::time::sleep(next).await;
        let (tokens, masked) = departed.so_far();
        println!(
            "    {:>4.0} s: {tokens} tokens lost, {masked} agents masked",
            began.elapsed().as_secs_f64()
        );
    }
    let (tokens, masked) = departed.so_far();
    let verdict = if tokens + masked == 0 { "reached" } else { "missed" };
    println!(
        "false departures in {:.0} minutes: {}, aim 0: {verdict}",
        lasts.as_secs_f64() / 60.0,
        tokens + masked
    );
    // The threads that use processor time never end by themselves.
    std::process::exit(i32::from(tokens + masked > 0));
}

#[derive(Default)]
struct Departed {
    tokens: AtomicU64,
    masked: AtomicU64,
}

impl Departed {
    fn so_far(&self) -> (u64, u64) {
        (self.tokens.load(Ordering::Relaxed), self.masked.load(Ordering::Relaxed))
    }

    fn reset(&self) {
        self.tokens.store(0, Ordering::Relaxed);
        self.masked.store(0, Ordering::Relaxed);
    }
}

/// Counts departures.
struct Listener(Arc<Departed>);

impl Agent for Listener {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }

    fn presence(&mut self, presence: &Presence, _ctx: &mut Context<Self>) {
        if let Presence::Left(resident) = presence {
            self.0.tokens.fetch_add(1, Ordering::Relaxed);
            println!("    {} at {} left", resident.agent, resident.daemon);
        }
    }
}

impl Listener {
    fn informed(&mut self, message: Message, _ctx: &mut Context<Self>) {
        if let Ok(Inform::Epoch(change)) = message.content_as::<Inform>() {
            let left = u64::try_from(change.left.len()).unwrap_or(u64::MAX);
            self.0.masked.fetch_add(left, Ordering::Relaxed);
        }
    }
}
