//! Shared parts of the benchmarks of whole ecosystems: agents in this process, daemons in others,
//! figures.

#![allow(dead_code, reason = "each benchmark uses its part")]

pub(crate) mod overhearing;
pub(crate) mod workers;

use std::collections::BTreeSet;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use acl::content::Snapshot;
use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
use agent::{
    AgentSettings, Blueprint, Host, LaunchContext, LaunchError, LaunchableAgent, MessageRouter,
    PluginEntry, Resource, ResourceQuery,
};
use substrate_zenoh::Config;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Longest time of anything before a benchmark gives up: far more than any machine should need.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

pub(crate) type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Whether everything is measured; if not, Cargo only checks that the benchmark runs.
pub(crate) fn is_whole() -> bool {
    std::env::args().any(|argument| argument == "--bench")
}

// === figures ===

/// The times of repeated measurements.
#[derive(Default)]
pub(crate) struct Figures(Vec<Duration>);

impl Figures {
    pub(crate) const fn new() -> Figures {
        Figures(Vec::new())
    }

    pub(crate) fn push(&mut self, took: Duration) {
        self.0.push(took);
    }

    /// Returns the quantile of the times for this share, in milliseconds.
    pub(crate) fn within(&self, share: f64) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort();
        let rank = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.max(1) - 1).map_or(f64::NAN, |took| took.as_secs_f64() * 1_000.0)
    }

    pub(crate) fn tell(&self, what: &str) {
        let (median, most, worst) = (self.within(0.5), self.within(0.99), self.within(1.0));
        println!("    {what}: p50 {median:.1} ms, p99 {most:.1} ms, max {worst:.1} ms");
    }
}

/// Whether any aim has been missed so far.
static HAS_MISSED: AtomicBool = AtomicBool::new(false);

/// Prints a value and whether its aim is reached.
pub(crate) fn judge(what: &str, value: f64, aim: f64) {
    let verdict = verdict(value <= aim);
    println!("    {what} {value:.1} ms, aim ≤ {aim} ms: {verdict}");
}

/// Returns a word for whether an aim is reached, and records a miss for the end.
pub(crate) fn verdict(is_reached: bool) -> &'static str {
    HAS_MISSED.fetch_or(!is_reached, Ordering::Relaxed);
    if is_reached { "reached" } else { "missed" }
}

/// Returns an error if an aim was missed, so that the benchmark has an exit code. If Cargo only
/// checks that the benchmark runs, nothing counts as missed.
pub(crate) fn reached() -> Outcome<()> {
    if is_whole() && HAS_MISSED.load(Ordering::Relaxed) {
        return Err("an aim was missed".into());
    }
    Ok(())
}

/// Returns the processor time that these processes have used so far, in seconds, as the kernel
/// counts it.
pub(crate) fn processor_time(children: &[Child]) -> Outcome<f64> {
    let ids: Option<Vec<u32>> = children.iter().map(Child::id).collect();
    let ids = ids.ok_or("a process has ended")?;
    ids.iter().map(|id| processor_time_of(&id.to_string())).sum()
}

/// Returns the processor time of this process.
pub(crate) fn own_processor_time() -> Outcome<f64> {
    processor_time_of("self")
}

fn processor_time_of(process: &str) -> Outcome<f64> {
    // The kernel counts in ticks, and its interface has a hundred per second.
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat"))?;
    let (_, fields) = stat.rsplit_once(')').ok_or("no process status")?;
    let fields: Vec<_> = fields.split_whitespace().collect();
    let field = |at: usize| fields.get(at).and_then(|field| field.parse::<f64>().ok());
    Ok((field(11).unwrap_or(0.0) + field(12).unwrap_or(0.0)) / TICKS_PER_SECOND)
}

// === an ecosystem file ===

/// One agent of an ecosystem file.
pub(crate) struct Entry {
    pub(crate) name: AgentId,
    pub(crate) plugin: String,
    pub(crate) daemon: String,
    pub(crate) config: serde_json::Value,
}

/// Reads the agents of an ecosystem file without checks, because the file belongs to a benchmark.
pub(crate) fn entries(text: &str) -> Outcome<Vec<Entry>> {
    let file: toml::Table = toml::from_str(text)?;
    let agents = file.get("agent").and_then(toml::Value::as_array).ok_or("no agents")?;
    agents.iter().map(entry).collect()
}

fn entry(agent: &toml::Value) -> Outcome<Entry> {
    let text = |key: &str| agent.get(key).and_then(toml::Value::as_str).unwrap_or_default();
    let config = agent.get("config").map_or(Ok(serde_json::Value::Null), serde_json::to_value)?;
    let (plugin, daemon) = (text("plugin").to_owned(), text("daemon").to_owned());
    Ok(Entry { name: AgentId::new(text("name"))?, plugin, daemon, config })
}

/// Returns the context in which agents in this process are built.
pub(crate) fn host(domain: &str, map: &str, mode: agent::Mode) -> Outcome<Host> {
    let ontology = pddl::parse_domain(domain).into_result().map_err(|_| "the domain")?;
    let map = pddl::parse_problem(map).into_result().map_err(|_| "the map")?;
    Ok(Host { mode, ..Host::new(ontology, map) })
}

// === agents in this process ===

/// Builds an agent, as a daemon that reads its entry does.
pub(crate) fn build(
    plugin: &PluginEntry,
    entry: &Entry,
    host: &Arc<Host>,
) -> Outcome<Box<dyn LaunchableAgent>> {
    let driver = plugin.drivers.first().copied().unwrap_or_default().to_owned();
    let (id, config) = (entry.name.clone(), entry.config.clone().into());
    Ok((plugin.build)(Blueprint { id, driver, config, host: Arc::clone(host) })?)
}

/// Launches an agent in a daemon of this process.
pub(crate) fn launch(
    id: &AgentId,
    agent: Box<dyn LaunchableAgent>,
    router: &Arc<MessageRouter>,
    ontology: &str,
) -> JoinHandle<Result<(), LaunchError>> {
    agent.launch(LaunchContext {
        id: id.clone(),
        incarnation: next_incarnation(),
        router: Arc::clone(router),
        ontology: Arc::from(ontology),
        stopping: CancellationToken::new(),
        has_replicas: false,
        via: [].into(),
    })
}

fn next_incarnation() -> Incarnation {
    static LAST: AtomicU64 = AtomicU64::new(0);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    let began = u64::try_from(now).unwrap_or(0);
    Incarnation(LAST.fetch_max(began, Ordering::Relaxed).max(began) + 1)
}

/// Queries the domains of all agents that have one, or of one of them.
pub(crate) async fn domains(router: &MessageRouter, of: Option<AgentId>) -> Vec<Snapshot> {
    let ask = ResourceQuery { daemon: None, resource: Resource::Domain, agent: of };
    let answers = router.ask(ask, Duration::from_secs(2)).await;
    answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
}

/// Waits until the Domain Maintainer can plan with all of these devices.
pub(crate) async fn await_offers(
    router: &MessageRouter,
    devices: &BTreeSet<String>,
) -> Outcome<()> {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let domain = domains(router, AgentId::new("domain-maintainer").ok()).await.pop();
        let offers =
            |name: &String| domain.as_ref().is_some_and(|d| d.offers.contains_key(&**name));
        let missing: Vec<_> = devices.iter().filter(|name| !offers(name)).collect();
        if missing.is_empty() {
            return Ok(());
        }
        if Instant::now() > deadline {
            let (first, count) = (missing[0], missing.len());
            return Err(format!("`{first}` and {} more cannot be planned with", count - 1).into());
        }
    }
}

/// Opens a daemon in this process that listens in `folder` and connects to others there.
pub(crate) async fn daemon(
    folder: &Path,
    ecosystem: &str,
    name: &str,
    others: &[String],
) -> Outcome<Arc<MessageRouter>> {
    let (router, config) = prepared(folder, ecosystem, name, others)?;
    router.connect(config.open(Arc::<MessageRouter>::clone(&router)).await?);
    Ok(router)
}

fn prepared(
    folder: &Path,
    ecosystem: &str,
    name: &str,
    others: &[String],
) -> Outcome<(Arc<MessageRouter>, Config)> {
    let (ecosystem, daemon) = (EcosystemId::new(ecosystem)?, DaemonId::new(name)?);
    let endpoint =
        |name: &str| format!("unixsock-stream/{}", folder.join(format!("{name}.sock")).display());
    let mut config = Config::new(ecosystem.clone(), daemon.clone());
    config.listen = vec![endpoint(name)];
    config.connect = others.iter().map(|other| endpoint(other)).collect();
    Ok((MessageRouter::new(ecosystem, daemon, AgentSettings::default()), config))
}

/// Opens a daemon as [`daemon`] does. Returns the router of the daemon, and a record of the bids
/// that the daemon receives and the awards that it sends.
pub(crate) async fn daemon_overheard(
    folder: &Path,
    ecosystem: &str,
    name: &str,
) -> Outcome<(Arc<MessageRouter>, Arc<overhearing::Overheard>)> {
    let (router, config) = prepared(folder, ecosystem, name, &[])?;
    let overheard = Arc::new(overhearing::Overheard::default());
    let inbound = overhearing::Inward::new(&router, &overheard);
    let wire = config.open(inbound).await?;
    router.connect(overhearing::outward(wire, &overheard));
    Ok((router, overheard))
}

/// Starts this benchmark once more, with these arguments; the process is killed when this is
/// dropped.
pub(crate) fn again(arguments: &[&str]) -> Outcome<Child> {
    let mut command = Command::new(std::env::current_exe()?);
    Ok(command.args(arguments).stdin(Stdio::null()).kill_on_drop(true).spawn()?)
}

// === daemons in other processes ===

/// A folder with the sockets of the daemons of one machine.
pub(crate) struct Machine {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) file: PathBuf,
}

impl Machine {
    /// Creates a new folder; the ecosystem file is yet to be written.
    pub(crate) fn new() -> Outcome<Machine> {
        let folder = tempfile::Builder::new().prefix("alt-").tempdir()?;
        let file = folder.path().join("althing.toml");
        Ok(Machine { folder, file })
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn building(&self) -> PathBuf {
        self.path().join("building.sock")
    }

    /// Returns the endpoint of the daemon of this name.
    pub(crate) fn endpoint(&self, ecosystem: &str, daemon: &str) -> String {
        let socket = self.path().join("run").join(ecosystem).join(format!("{daemon}.sock"));
        format!("unixsock-stream/{}", socket.display())
    }

    /// Starts `althing up`; it is killed when the returned value is dropped.
    pub(crate) fn start(&self, daemon: &str, mode: &str) -> Outcome<Process> {
        let child = Command::new(env!("CARGO_BIN_EXE_althing"))
            .arg("up")
            .arg(&self.file)
            .args(["--daemon", daemon, "--mode", mode])
            .env("ALTHING_RUNTIME_DIR", self.path().join("run"))
            .env("ALTHING_STATE_DIR", self.path().join("state"))
            .env("ALTHING_BUILDING__SOCKET", self.building())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()?;
        Ok(Process(child))
    }
}

/// One process of `althing up`.
pub(crate) struct Process(Child);

impl Process {
    /// Reads the output until the daemon reports that it is ready.
    pub(crate) async fn ready(&mut self) -> Outcome<()> {
        let stdout = self.0.stdout.take().ok_or("the daemon has no standard output")?;
        let mut lines = BufReader::new(stdout).lines();
        while let Some(line) = tokio::time::timeout(PATIENCE, lines.next_line()).await?? {
            if line.contains("is ready") {
                // Later output is read and discarded, so that the daemon never blocks on it.
                tokio::spawn(async move { while let Ok(Some(_)) = lines.next_line().await {} });
                return Ok(());
            }
        }
        Err("the daemon ended before it was ready".into())
    }

    /// Returns the processor time that the process has used so far, in seconds.
    pub(crate) fn processor_time(&self) -> Outcome<f64> {
        processor_time(std::slice::from_ref(&self.0))
    }

    /// Sends SIGKILL.
    pub(crate) fn kill(&mut self) -> Outcome<()> {
        Ok(self.0.start_kill()?)
    }

    /// Sends SIGSTOP: the process is stopped until it is killed.
    pub(crate) fn stop(&mut self) -> Outcome<()> {
        let id = self.0.id().ok_or("it has ended")?;
        let id = i32::try_from(id).ok().and_then(rustix::process::Pid::from_raw);
        rustix::process::kill_process(id.ok_or("no process")?, rustix::process::Signal::STOP)?;
        Ok(())
    }

    /// Waits until the process has ended.
    pub(crate) async fn ended(mut self) -> Outcome<()> {
        tokio::time::timeout(PATIENCE, self.0.wait()).await??;
        Ok(())
    }
}
