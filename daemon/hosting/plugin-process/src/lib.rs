//! Runs a plugin as a process of its own. The plugin's crate can also be linked into a daemon; as a
//! program it needs only a `main` of one line.
//!
//! ```no_run
//! # mod my_plugin { pub const PLUGIN: agent::PluginEntry = agent::PluginEntry {
//! #     name: "x", about: "", drivers: &[], has_replicas: false,
//! #     build: |entry| Err(entry.problem("it is empty")) }; }
//! fn main() -> std::process::ExitCode {
//!     plugin_process::run(&[my_plugin::PLUGIN])
//! }
//! ```
//!
//! The process reads one line from its daemon ([`acl::Hello`]), connects to the endpoint that the
//! line names, and runs its agents until the standard input of the process is closed. The standard
//! error of the process goes to the plugin's log (`althing plugin logs`).

use std::io::{BufRead as _, Write as _};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use acl::{Hello, HelloAgent, SCHEMA_VERSION};
use agent::{
    AgentSettings, Blueprint, Host, HostServices, LaunchContext, MessageRouter, PluginEntry,
    Resources,
};
use building::BuildingHandle;
use substrate_zenoh::{Config, SessionMode};
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;
use tracing_subscriber::EnvFilter;

/// Time that the agents have to stop their current work when the process ends.
const DRAINING: Duration = Duration::from_secs(1);

/// Runs the agents that the daemon requests. Each agent runs the plugin in its description, or the
/// first of `plugins` if none has that name. Returns when the daemon stops the plugin or one of the
/// agents ends.
pub fn run(plugins: &[PluginEntry]) -> ExitCode {
    log();
    let mut line = String::new();
    if let Err(error) = std::io::stdin().lock().read_line(&mut line) {
        return failed(&format!("read what the daemon says: {error}"));
    }
    let hello: Hello = match serde_json::from_str(&line) {
        Ok(hello) => hello,
        Err(error) => {
            return failed(&format!(
                "understand what the daemon says: {error}\nthis is a plugin of Althing: put it into \
                 a package (`althing help plugin`)"
            ));
        }
    };
    if hello.protocol != SCHEMA_VERSION {
        let theirs = hello.protocol;
        return failed(&format!(
            "speak version {theirs} of the protocol; this plugin speaks {SCHEMA_VERSION}"
        ));
    }
    // One worker thread serves the connection; this thread runs the agents.
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
    match runtime {
        Ok(runtime) => match runtime.block_on(run_agents(plugins, hello)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(problem) => failed(&problem),
        },
        Err(error) => failed(&format!("begin: {error}")),
    }
}

fn log() {
    // The last lines of the log are shown as the reason why a plugin ended, so Zenoh's warnings
    // about reconnecting to the host must not be among them.
    let quiet = || EnvFilter::new("warn,zenoh=error");
    let filter = EnvFilter::try_from_env("ALTHING_LOG").unwrap_or_else(|_| quiet());
    let logging = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // Initialization fails if the program already has a logger; that logger is then used.
    let _ = logging.without_time().with_ansi(false).try_init();
}

fn failed(problem: &str) -> ExitCode {
    // Standard error may be closed.
    let _ = writeln!(std::io::stderr(), "failed to {problem}");
    ExitCode::FAILURE
}

async fn run_agents(plugins: &[PluginEntry], hello: Hello) -> Result<(), String> {
    let first = |found: Vec<pddl::Diagnostic>| {
        let first = found.first().map(ToString::to_string).unwrap_or_default();
        format!("read the domain and the map that the daemon sends: {first}")
    };
    let mut resources = Resources::default();
    if let Some(socket) = &hello.building {
        let building = BuildingHandle::connect(std::path::Path::new(socket)).await;
        resources.insert(building.map_err(|error| error.to_string())?);
    }
    let settings =
        AgentSettings { heartbeat_period: hello.heartbeat_period.0, ..AgentSettings::default() };
    let ontology = pddl::parse_domain(&hello.domain).into_result().map_err(first)?;
    let host = Host::new(ontology, pddl::parse_problem(&hello.map).into_result().map_err(first)?);
    let host = Arc::new(Host { mode: hello.mode, settings: settings.clone(), resources, ..host });
    let machine = HostServices::new(None);
    let router =
        MessageRouter::on(machine, hello.ecosystem.clone(), hello.daemon.clone(), settings);
    let mut config = Config::new(hello.ecosystem, hello.daemon);
    config.mode = SessionMode::Client;
    config.connect = vec![hello.endpoint];
    let inbound = Arc::<MessageRouter>::clone(&router);
    let substrate = config.open(inbound).await.map_err(|error| error.to_string())?;
    let opened = Arc::clone(&substrate);
    router.connect(opened);
    let stopping = CancellationToken::new();
    let mut lives = tokio::task::JoinSet::new();
    for agent in hello.agents {
        let built = build(plugins, agent, &host)?;
        let launch_context = LaunchContext {
            id: built.0,
            incarnation: router.host_services().next_incarnation(),
            router: Arc::clone(&router),
            ontology: Arc::from(host.ontology.name.as_str()),
            stopping: stopping.clone(),
            has_replicas: false,
            via: [].into(),
        };
        lives.spawn(built.1.launch(launch_context));
    }
    tokio::select! {
        () = wait_for_stop() => (),
        Some(ended) = lives.join_next() => {
            // An agent that fails ends the process, and the daemon restarts it.
            let ended = ended.map_err(|error| error.to_string())?;
            let ended = ended.map_err(|error| error.to_string())?;
            ended.map_err(|error| error.to_string())?;
        }
    }
    stopping.cancel();
    let _ =
        tokio::time::timeout(DRAINING, async { while lives.join_next().await.is_some() {} }).await;
    substrate::Substrate::close(&*substrate).await;
    Ok(())
}

fn build(
    plugins: &[PluginEntry],
    agent: HelloAgent,
    host: &Arc<Host>,
) -> Result<(acl::AgentId, Box<dyn agent::LaunchableAgent>), String> {
    let HelloAgent { name, plugin: called, driver, config, .. } = agent;
    // If the package has another name than its plugins, the first plugin is used.
    let plugin = plugins.iter().find(|plugin| plugin.name == called).or(plugins.first());
    let plugin = plugin.ok_or_else(|| format!("find the plugin of `{name}`: there is none"))?;
    let default = plugin.drivers.first().copied().unwrap_or_default();
    let driver = driver.unwrap_or_else(|| default.to_owned());
    if driver != default && !plugin.drivers.contains(&driver.as_str()) {
        return Err(format!("find driver `{driver}` for `{name}`"));
    }
    let blueprint =
        Blueprint { id: name.clone(), driver, config: Arc::new(config), host: Arc::clone(host) };
    let built = (plugin.build)(blueprint).map_err(|error| error.to_string())?;
    Ok((name, built))
}

/// Waits until the daemon stops the plugin: it closes the standard input of the process, or sends
/// the signal `SIGTERM`.
async fn wait_for_stop() {
    let (tell, ended) = tokio::sync::oneshot::channel();
    // The input is read on a thread of its own, because a blocking read cannot be cancelled.
    std::thread::spawn(move || {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        let _ = tell.send(());
    });
    let Ok(mut terminated) = signal(SignalKind::terminate()) else {
        let _ = ended.await;
        return;
    };
    tokio::select! {
        _ = ended => (),
        _ = terminated.recv() => (),
    }
}
