//! Measures the cost of a session: the time to open it, and the memory and threads of the idle
//! process.
//!
//! ```text
//! cargo run --release -p substrate-zenoh --example idle [LISTEN [CONNECT]]
//! ```
//!
//! Prints its measurements and its locators, and then the measurements again for every line that it
//! reads.

use std::io::BufRead as _;
use std::sync::Arc;
use std::time::Instant;

use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
use substrate::{Delivery, Inbound, Presence, ReceivedQuery, Substrate as _};
use substrate_zenoh::Config;

struct Deaf;

impl Inbound for Deaf {
    fn deliver(&self, _: Delivery) {}

    fn presence(&self, _: Presence) {}

    fn receive_query(&self, _: ReceivedQuery) {}
}

#[tokio::main(worker_threads = 2)]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let name = format!("d{}", std::process::id());
    let mut config = Config::new(EcosystemId::new("office")?, DaemonId::new(&name)?);
    config.listen = arguments.next().into_iter().collect();
    config.connect = arguments.next().into_iter().collect();

    println!("before open: {}", held()?);
    let start = Instant::now();
    let substrate = config.open(Arc::new(Deaf)).await?;
    println!("open: {:.1?}", start.elapsed());
    let _token = substrate.announce(&AgentId::new("device")?, Incarnation(1))?;
    println!("after open: {}", held()?);
    println!("{}", substrate.locators().join(" "));
    for _ in std::io::stdin().lock().lines() {
        println!("idle: {}", held()?);
    }
    Ok(())
}

/// Returns resident memory and threads of this process, as Linux reports them.
fn held() -> std::io::Result<String> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let fields = ["VmRSS:", "RssAnon:", "Threads:"];
    let lines = status.lines().filter(|line| fields.iter().any(|field| line.starts_with(field)));
    Ok(lines
        .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect::<Vec<_>>()
        .join(", "))
}
