//! Metrics: what a scrape costs a daemon.
//!
//! ```text
//! cargo bench -p althing --bench scrape
//! ```
//!
//! A daemon with the reasoning agents of an office is scraped as fast as it answers, over one
//! connection, and then with a new connection for each scrape. Its processor time without scrapes is
//! subtracted. The aim is that of one scrape each second: 0.1 % of a core is 1 ms of each second.

mod support;

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use support::{Machine, Outcome, PATIENCE, Process};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{sleep, timeout};

/// Number of scrapes, and the aim for the processor time of one.
const SCRAPES: u32 = 5_000;
const SCRAPE_MS: f64 = 1.0;

/// How long the daemon is observed without scrapes.
const IDLE: Duration = Duration::from_secs(10);

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../../domains/smart-office/map.pddl");

#[tokio::main]
async fn main() -> Outcome<()> {
    let address = TcpListener::bind("127.0.0.1:0").await?.local_addr()?;
    let machine = office(address)?;
    let mut daemon = machine.start("reasoning", "decentralized")?;
    daemon.ready().await?;
    let bytes = scrape(&mut connected(address).await?).await?;
    println!("    one answer has {bytes} bytes");
    let whole = support::is_whole();
    let (scrapes, idle) = if whole { (SCRAPES, IDLE) } else { (10, Duration::from_millis(10)) };
    let before = daemon.processor_time()?;
    sleep(idle).await;
    let idle = (daemon.processor_time()? - before) / idle.as_secs_f64();

    // A connection that is idle for so long is closed.
    let mut connection = TcpStream::connect(address).await?;
    let kept = measure(&daemon, idle, scrapes, async || {
        scrape(&mut connection).await?;
        Ok(())
    });
    tell("over one connection", kept.await?);
    let anew = measure(&daemon, idle, scrapes, async || {
        scrape(&mut TcpStream::connect(address).await?).await?;
        Ok(())
    });
    tell("with a connection each", anew.await?);
    support::reached()
}

/// Prints the processor time and the duration of one scrape, in milliseconds, and judges the first.
fn tell(what: &str, (processor, took): (f64, f64)) {
    println!("    {what}: answered within {took:.2} ms");
    support::judge(&format!("{what}: processor time of a scrape"), processor, SCRAPE_MS);
}

/// Returns the daemon's processor time and the duration of one scrape, in milliseconds. `idle` is
/// the daemon's processor time in each second without scrapes.
async fn measure(
    daemon: &Process,
    idle: f64,
    scrapes: u32,
    mut scrape: impl AsyncFnMut() -> Outcome<()>,
) -> Outcome<(f64, f64)> {
    let (before, began) = (daemon.processor_time()?, Instant::now());
    for _ in 0..scrapes {
        scrape().await?;
    }
    let took = began.elapsed().as_secs_f64();
    let used = daemon.processor_time()? - before - idle * took;
    let of_one = |seconds: f64| seconds * 1_000.0 / f64::from(scrapes);
    Ok((of_one(used), of_one(took)))
}

/// Scrapes once, and returns the length of the answer.
async fn scrape(stream: &mut TcpStream) -> Outcome<usize> {
    stream.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n").await?;
    let mut answer = Vec::new();
    loop {
        let read = timeout(PATIENCE, stream.read_buf(&mut answer)).await??;
        if read == 0 {
            return Err("the daemon has closed the connection".into());
        }
        let text = std::str::from_utf8(&answer)?;
        let Some((head, body)) = text.split_once("\r\n\r\n") else { continue };
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: "));
        if body.len() >= length.ok_or("no length")?.parse()? {
            return Ok(body.len());
        }
    }
}

/// Waits until the daemon listens.
async fn connected(address: SocketAddr) -> Outcome<TcpStream> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        match TcpStream::connect(address).await {
            Ok(stream) => return Ok(stream),
            Err(error) if Instant::now() > deadline => return Err(error.into()),
            Err(_) => sleep(Duration::from_millis(10)).await,
        }
    }
}

fn office(address: SocketAddr) -> Outcome<Machine> {
    let machine = Machine::new()?;
    std::fs::write(machine.path().join("domain.pddl"), ONTOLOGY)?;
    std::fs::write(machine.path().join("map.pddl"), MAP)?;
    let plugins = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];
    let agents = plugins.map(|plugin| {
        format!("[[agent]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"\ndaemon = \"reasoning\"\n\n")
    });
    let file = format!(
        "[ecosystem]\nname = \"scrape\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\n\
         [metrics]\nlisten = \"{address}\"\n\n{}",
        agents.concat()
    );
    std::fs::write(&machine.file, file)?;
    Ok(machine)
}
