//! The time that `althing stop` takes with a hundred devices.

use std::collections::BTreeMap;
use std::process::Stdio;
use std::time::{Duration, Instant};

use acl::Message;
use acl::Performative;
use acl::content::{Report, Request};
use tokio::process::Command;

use crate::support::{self, Figures, Machine, Outcome, PATIENCE};
use crate::{Listener, times};

/// Number of stops, and the aim for each.
const STOPS: usize = 100;
const STOP_MS: f64 = 100.0;

const CAMPUS: &str = include_str!("../../../../../ecosystems/campus.toml");

const DAEMON: &str = "all";

/// Measures stops of a campus, each followed by its release.
pub(crate) async fn stops() -> Outcome<()> {
    let machine = Machine::new()?;
    std::fs::write(&machine.file, file())?;
    let mut process = machine.start(DAEMON, "decentralized")?;
    process.ready().await?;
    let mut listener = Listener::open(&machine, "campus", DAEMON).await?;
    let (mut whole, mut still) = (Figures::default(), Figures::default());
    let (mut on_wire, stops) = (Figures::default(), times(STOPS));
    let mut devices = 0;
    for _ in 0..stops {
        listener.rest();
        let began = Instant::now();
        whole.push(run(&machine, &["stop"]).await?);
        let heard = listener.rest();
        let first = heard.iter().find(|(_, message)| is_stop(message));
        let (first, _) = first.ok_or("no request was overheard")?;
        // A confirmation may be repeated; the first of each agent counts.
        let mut confirmed = BTreeMap::new();
        for (at, message) in heard.iter().filter(|(_, message)| is_confirmation(message)) {
            confirmed.entry(message.sender.clone()).or_insert(*at);
        }
        let last = confirmed.values().max().ok_or("no confirmation was overheard")?;
        still.push(*last - began);
        on_wire.push(*last - *first);
        devices = confirmed.len();
        run(&machine, &["stop", "--release"]).await?;
    }
    still.tell(&format!(
        "{devices} devices, {stops} times: the start of `althing stop` to the last confirmation"
    ));
    support::judge("p99", still.within(0.99), STOP_MS);
    on_wire.tell("its first request to the last confirmation");
    whole.tell("the whole command, with the end of its connection");
    Ok(())
}

/// Returns the file of the campus, with all agents on one daemon.
fn file() -> String {
    let line = |line: &str| match line {
        daemon if daemon.starts_with("daemon = ") => format!("daemon = \"{DAEMON}\"\n"),
        reasoning if reasoning.starts_with("reasoning = ") => format!("reasoning = \"{DAEMON}\"\n"),
        other => format!("{other}\n"),
    };
    CAMPUS.lines().map(line).collect()
}

/// Runs a command to its end, which must be a success. Returns the time that it took.
async fn run(machine: &Machine, arguments: &[&str]) -> Outcome<Duration> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_althing"));
    command
        .args(arguments)
        .arg("--ecosystem")
        .arg(&machine.file)
        .env("ALTHING_RUNTIME_DIR", machine.path().join("run"))
        .env("ALTHING_STATE_DIR", machine.path().join("state"))
        .stdin(Stdio::null())
        .kill_on_drop(true);
    let began = Instant::now();
    let output = tokio::time::timeout(PATIENCE, command.output()).await??;
    let took = began.elapsed();
    if !output.status.success() {
        let (said, problem) = (output.stdout, output.stderr);
        let said = String::from_utf8_lossy(&said).into_owned() + &String::from_utf8_lossy(&problem);
        return Err(format!("{arguments:?} failed: {said}").into());
    }
    Ok(took)
}

fn is_stop(message: &Message) -> bool {
    matches!(message.content_as::<Request>(), Ok(Request::Stop(_)))
}

fn is_confirmation(message: &Message) -> bool {
    message.performative == Performative::Confirm
        && message.content_as::<Report>().is_ok_and(|report| report.stop_effect.is_some())
}
