//! Plugins that run as processes: the time from installation until planning, the time from a kill
//! until planning again, and the memory of an idle one.
//!
//! ```text
//! cargo build --profile plugin --workspace --example sensor-process
//! cargo bench -p althing --bench plugins
//! ```
//!
//! A real daemon, and a package with the plugin `sensor`, linked into a program of its own and
//! confined as every plugin. A folder is renamed into the folder of packages, or the process gets a
//! SIGKILL; the clock stops when the Domain Maintainer, queried repeatedly over Zenoh, can plan
//! with its agent.

mod support;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{AgentSettings, MessageRouter, Resource, ResourceQuery};
use plugin_host::{PluginList, PluginState, PluginStatus};
use substrate_zenoh::Config;
use support::{Figures, Machine, Outcome, PATIENCE};

const ROUNDS: usize = 30;
const PUT_IN_MS: f64 = 500.0;
const AGAIN_MS: f64 = 300.0;
const MEMORY_MIB: f64 = 12.0;

/// How long an idle plugin is left alone before its memory is measured.
const IDLE: Duration = Duration::from_secs(3);

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../../domains/smart-office/map.pddl");
const NAME: &str = "thermometer";

const FILE: &str = "[ecosystem]\nname = \"plugins\"\ndomain = \"domain.pddl\"\n\
    problem = \"map.pddl\"\n\n[plugins]\nfolder = \"plugins\"\n\n\
    [[agent]]\nname = \"domain-maintainer\"\nplugin = \"domain-maintainer\"\ndaemon = \"d\"\n";

#[tokio::main]
async fn main() -> Outcome<()> {
    let rounds = if support::is_whole() { ROUNDS } else { 1 };
    let program = program()?;
    let machine = Machine::new()?;
    std::fs::write(machine.path().join("domain.pddl"), ONTOLOGY)?;
    std::fs::write(machine.path().join("map.pddl"), MAP)?;
    std::fs::write(&machine.file, FILE)?;
    let mut process = machine.start("d", "decentralized")?;
    process.ready().await?;
    let router = enter(&machine).await?;
    let agent = AgentId::new("t-1")?;
    let (mut put_in, mut again) = (Figures::default(), Figures::default());
    let mut weights = Vec::new();
    for round in 0..rounds {
        let began = Instant::now();
        put(&machine, &program)?;
        await_offer(&router, &agent, true).await?;
        put_in.push(began.elapsed());
        let before = status(&router).await?;
        if round == 0 {
            tokio::time::sleep(if support::is_whole() { IDLE } else { Duration::ZERO }).await;
            weights = weigh(before.pid.ok_or("it runs")?)?;
        }
        let began = Instant::now();
        kill(before.pid.ok_or("it runs")?)?;
        // Its proxy announces at once that it offers nothing, and later that it offers its action
        // again.
        await_other(&router, before.pid).await?;
        await_offer(&router, &agent, true).await?;
        again.push(began.elapsed());
        std::fs::remove_dir_all(machine.path().join("plugins").join(NAME))?;
        await_offer(&router, &agent, false).await?;
        while status(&router).await.is_ok() {}
    }
    put_in.tell(&format!("put in → planned with, {rounds} times"));
    support::judge("p99", put_in.within(0.99), PUT_IN_MS);
    again.tell(&format!("killed → planned with again, the first time, {rounds} times"));
    support::judge("p99", again.within(0.99), AGAIN_MS);
    for (what, mebibytes) in &weights {
        println!("    one idle process: {what} {mebibytes:.1} MiB");
    }
    let held = weights.first().map_or(f64::NAN, |(_, mebibytes)| *mebibytes);
    let verdict = support::verdict(held <= MEMORY_MIB);
    println!("    aim ≤ {MEMORY_MIB} MiB: {verdict}");
    support::reached()
}

/// Returns the path of the plugin `sensor` as a program of its own.
fn program() -> Outcome<PathBuf> {
    let deps = std::env::current_exe()?;
    let folder = deps.ancestors().nth(3).ok_or("the target folder")?;
    let program = folder.join("plugin/examples/sensor-process");
    if !program.exists() {
        let build = "cargo build --profile plugin --workspace --example sensor-process";
        return Err(format!("there is no {}: {build}", program.display()).into());
    }
    Ok(program)
}

/// Puts the package into the folder of packages, atomically.
fn put(machine: &Machine, program: &Path) -> Outcome<()> {
    let made = machine.path().join(NAME);
    std::fs::create_dir(&made)?;
    std::os::unix::fs::symlink(program, made.join("program"))?;
    let target = format!("{}-linux", std::env::consts::ARCH);
    let manifest = format!(
        "name = \"{NAME}\"\nversion = \"1\"\nprotocol = \"2\"\n\n[executable]\n\
         {target} = \"program\"\n\n[action.report-temperature]\nmethod = \"read_temperature\"\n\
         timeout = \"2s\"\n\n[[agent]]\nname = \"t-1\"\ndriver = \"command\"\n\
         config = {{ location = \"office1\", command = [\"true\"] }}\n\n\
         [config.location]\ntype = \"text\"\n\n[config.command]\ntype = \"list\"\noptional = true\n"
    );
    std::fs::write(made.join("plugin.toml"), manifest)?;
    std::fs::rename(made, machine.path().join("plugins").join(NAME))?;
    Ok(())
}

async fn enter(machine: &Machine) -> Outcome<Arc<MessageRouter>> {
    let mut config = Config::new(EcosystemId::new("plugins")?, DaemonId::new("listener")?);
    config.mode = substrate_zenoh::SessionMode::Client;
    config.connect = vec![machine.endpoint("plugins", "d")];
    let (ecosystem, daemon) = (config.ecosystem.clone(), config.daemon.clone());
    let router = MessageRouter::new(ecosystem, daemon, AgentSettings::default());
    router.connect(config.open(Arc::<MessageRouter>::clone(&router)).await?);
    Ok(router)
}

/// Waits until the Domain Maintainer can plan with an agent, or no longer can.
async fn await_offer(router: &MessageRouter, agent: &AgentId, wanted: bool) -> Outcome<()> {
    let deadline = Instant::now() + PATIENCE;
    let maintainer = AgentId::new("domain-maintainer").ok();
    while Instant::now() < deadline {
        let domain = support::domains(router, maintainer.clone()).await.pop();
        if domain.is_some_and(|domain| domain.offers.contains_key(agent) == wanted) {
            return Ok(());
        }
    }
    Err("it was waited for in vain".into())
}

async fn status(router: &MessageRouter) -> Outcome<PluginStatus> {
    let ask =
        ResourceQuery { daemon: DaemonId::new("d").ok(), resource: Resource::Plugins, agent: None };
    let answers = router.ask(ask, PATIENCE).await;
    let plugins: PluginList = serde_json::from_slice(answers.first().ok_or("no answer")?)?;
    let found = plugins.plugins.into_iter().find(|status| status.name == NAME);
    Ok(found.ok_or("it is not there")?)
}

/// Waits until another process of the plugin runs.
async fn await_other(router: &MessageRouter, before: Option<i32>) -> Outcome<()> {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        let status = status(router).await?;
        if status.state == PluginState::Running && status.pid != before {
            return Ok(());
        }
    }
    Err("it was not started again".into())
}

fn kill(pid: i32) -> Outcome<()> {
    let pid = rustix::process::Pid::from_raw(pid).ok_or("no process")?;
    Ok(rustix::process::kill_process(pid, rustix::process::Signal::KILL)?)
}

/// Returns the memory of a process in MiB, each amount with a label: all that is resident, and the
/// private part of it.
fn weigh(pid: i32) -> Outcome<Vec<(&'static str, f64)>> {
    let rollup = std::fs::read_to_string(format!("/proc/{pid}/smaps_rollup"))?;
    let of = |field: &str| {
        let line = rollup.lines().find(|line| line.starts_with(field));
        let kibibytes = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok());
        kibibytes.map_or(f64::NAN, |kibibytes| kibibytes / 1024.0)
    };
    let own = of("Private_Clean:") + of("Private_Dirty:");
    Ok(vec![("resident", of("Rss:")), ("its own", own)])
}
