//! `althing up`: runs the daemon until it is told to stop.

mod reload;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use ::building::{Building, BuildingHandle, ServeError, Server};
use acl::{AgentId, DaemonId};
use agent::Mode;
use keyboard::{Heard, Keyboard, Said, Terminal, Wish};
use serde_json::Value;
use terminal::report::Report;
use terminal::{exit, output};
use tokio::sync::oneshot;

use crate::cli::UpArgs;
use crate::commands::client::{self, View};
use crate::commands::{READY, goal, hearing};
use crate::config::{self, AgentEntry, Ecosystem, InterfaceEntry, Overrides, Reading};
use crate::hosting::{self, GuestKeys, Node, Part, Processes, Stay, Succession, Wire, socket_in};
use crate::interfacing::{self, Other};
use crate::interruption;
use crate::plugins;
use crate::prompt::{self, Guest};
use crate::review::{self, Scope};
use crate::service_manager::{self, Watchdog};
use reload::{Next, Reload};

/// How a daemon of this machine is called again when its link is lost: four times a second for as
/// long as it does not answer, because looking for a socket costs nothing, and a process that was
/// stopped is to be met as soon as it goes on.
const RETRY: &str = "retry_period_init_ms=250;retry_period_max_ms=250";

/// Reads the ecosystem, hosts this machine's part of it, drains at SIGINT and SIGTERM.
pub(super) fn run(args: &UpArgs) -> ExitCode {
    hosting::keep_to_oneself();
    let Some(file) = args.file.clone().or_else(config::find_ecosystem_file) else {
        output::note(
            "error: there is no althing.toml here nor in the configuration folders; name the \
             ecosystem file: althing up ECOSYSTEM.toml",
        );
        return exit::with(exit::CONFIG);
    };
    let mode = args.mode.map(Mode::from);
    let overrides = Overrides::default().mode(mode).connect(&args.connect);
    let (ecosystem, place) = match read(&file, &overrides, args.daemon.as_deref()) {
        Ok(read) => read,
        Err(exit) => return exit,
    };
    let wished = |goal: &String| ecosystem.wish(goal).and_then(goal::readable);
    let goals: Result<Vec<_>, _> = args.goals.iter().map(wished).collect();
    let goals = match goals {
        Ok(goals) => goals,
        Err(problem) => {
            output::note(&format!("error: {problem}"));
            return exit::with(exit::CONFIG);
        }
    };
    let manner =
        Manner { goals, has_prompt: args.keyboard, until_stdin_ends: args.until_stdin_ends };
    let others = match others(&ecosystem, &place) {
        Ok(others) => others,
        Err(report) => return output::show(&report, false, "bad-input", exit::CONFIG),
    };
    let ecosystem = Arc::new(ecosystem);
    let reload = Reload {
        file,
        overrides,
        asked: args.daemon.clone(),
        goals: args.goals.clone(),
        ecosystem: Arc::clone(&ecosystem),
        place: place.clone(),
        building: None,
        hangups: None,
        had_terminal: false,
    };
    super::in_runtime(up(ecosystem, place, others, manner, reload))
}

/// Reads the ecosystem and finds this daemon's part of it; what is wrong is shown.
fn read(
    file: &Path,
    overrides: &Overrides,
    asked: Option<&str>,
) -> Result<(Ecosystem, Place), ExitCode> {
    let reading = Ecosystem::read(file, overrides, &plugins::known());
    let refused = |report: &Report| output::show(report, false, "bad-input", exit::CONFIG);
    let place = match &reading.ecosystem {
        Some(ecosystem) if !reading.report.has_errors() => Place::find(ecosystem, asked),
        _ => return Err(refused(&review::review(&reading, Scope::Everything))),
    };
    let place = place.map_err(|problem| {
        output::note(&format!("error: {problem}"));
        exit::with(exit::CONFIG)
    })?;
    let scope = if place.is_alone { Scope::Everything } else { Scope::Daemon(&place.daemon) };
    let report = review::review(&reading, scope);
    let Reading { ecosystem: Some(ecosystem), .. } = reading else { return Err(refused(&report)) };
    if report.has_errors() {
        return Err(refused(&report));
    }
    output::show_people(&report);
    Ok((ecosystem, place))
}

/// What the daemon does for whoever started it.
struct Manner {
    /// Goals it asks for.
    goals: Vec<Wish>,
    has_prompt: bool,
    until_stdin_ends: bool,
}

/// Which part of the ecosystem this process hosts.
#[derive(Clone)]
struct Place {
    daemon: DaemonId,
    agents: Vec<AgentEntry>,
    is_alone: bool,
}

impl Place {
    /// The part of `--daemon`, or of the host name; a machine that the file does not name is
    /// alone and hosts everything.
    fn find(ecosystem: &Ecosystem, asked: Option<&str>) -> Result<Place, String> {
        let host = host_name();
        let named = match asked {
            Some(name) => Some(DaemonId::new(name).map_err(|error| error.to_string())?),
            None => host.clone().filter(|host| ecosystem.daemons.contains(host)),
        };
        let Some(daemon) = named else {
            let alone = DaemonId::new("alone").map_err(|error| error.to_string())?;
            let daemon = host.unwrap_or(alone);
            if ecosystem.security.is_some() && !ecosystem.daemons.is_empty() {
                let known: Vec<_> = ecosystem.daemons.iter().map(DaemonId::as_str).collect();
                return Err(format!(
                    "the ecosystem is secured, and its file gives nothing to `{daemon}`, which \
                     nobody would believe; say with --daemon which this is: {}",
                    known.join(", ")
                ));
            }
            // Nobody else hosts anything: nobody stands by.
            let alone = |entry: &AgentEntry| AgentEntry { daemons: Vec::new(), ..entry.clone() };
            let agents = ecosystem.agents.iter().map(alone).collect();
            return Ok(Place { daemon, agents, is_alone: true });
        };
        if !ecosystem.daemons.is_empty() && !ecosystem.daemons.contains(&daemon) {
            let known: Vec<_> = ecosystem.daemons.iter().map(DaemonId::as_str).collect();
            let hint = pddl::nearest(daemon.as_str(), known.iter().copied())
                .map(|near| format!("did you mean `{near}`? "))
                .unwrap_or_default();
            return Err(format!(
                "the ecosystem has no daemon called `{daemon}`; {hint}It has: {}",
                known.join(", ")
            ));
        }
        let own = ecosystem.agents_of(&daemon);
        let nobodys = ecosystem.agents_of_nobody().filter(|_| ecosystem.daemons.len() <= 1);
        let agents = own.chain(nobodys).cloned().collect();
        Ok(Place { daemon, agents, is_alone: false })
    }
}

/// The machine's name, as a daemon's.
pub(super) fn host_name() -> Option<DaemonId> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok()?;
    let first = name.trim().split('.').next()?.to_lowercase();
    DaemonId::new(&first).ok()
}

/// The other ecosystems that this daemon joins too, each with the interface it is joined by.
type Others = Vec<(InterfaceEntry, Other)>;

/// Reads the other ecosystems that this daemon is to join.
fn others(ecosystem: &Ecosystem, place: &Place) -> Result<Others, Report> {
    let is_here = |entry: &InterfaceEntry| match &entry.daemon {
        Some(daemon) => place.is_alone || *daemon == place.daemon,
        None => place.is_alone || ecosystem.daemons.len() <= 1,
    };
    let mut others = Vec::new();
    for (index, entry) in ecosystem.interfaces.iter().enumerate() {
        if is_here(entry) {
            let other = interfacing::load(ecosystem, index, &plugins::known())?;
            others.push((entry.clone(), other));
        }
    }
    Ok(others)
}

/// A node in another ecosystem, and its stay there.
type Abroad = Vec<(Node, Stay)>;

/// Joins the other ecosystems, with a wire of its own each, and lets the interfaces work.
async fn abroad(
    ecosystem: &Ecosystem,
    others: Others,
    place: &Place,
    home: &Node,
) -> Result<Abroad, String> {
    let mut abroad = Vec::new();
    for (entry, other) in others {
        let other = other.ecosystem;
        let daemon = DaemonId::new(entry.called.as_str()).map_err(|error| error.to_string())?;
        let state = hosting::state_folder(&ecosystem.name, &place.daemon)
            .map_err(|error| error.to_string())?
            .join(other.name.as_str());
        std::fs::create_dir_all(&state)
            .map_err(|error| format!("use the folder {}: {error}", state.display()))?;
        let (wire, stay) = wire(&other, &daemon).await?;
        let part = Part {
            ecosystem: &other,
            daemon,
            agents: Vec::new(),
            mode: other.mode,
            building: None,
            state: Some(state),
        };
        let node = Node::open(part, wire).await.map_err(|error| error.to_string())?;
        if let (Some(ours), Some(theirs)) = (home.landing(), node.landing()) {
            let (ours, theirs) = (ecosystem.shore(ours), other.shore(theirs));
            interfacing::connect(&entry, &ours, &theirs).map_err(|error| error.to_string())?;
        }
        tracing::info!(ecosystem = %other.name, called = %entry.called, "joined too");
        abroad.push((node, stay));
    }
    Ok(abroad)
}

/// Mirrors leave before those they speak for: whatever they are at is given up over there too.
async fn drain(home: Node, abroad: Abroad) -> bool {
    let mut all = home.drain().await;
    for (node, _stay) in abroad {
        all &= node.drain().await;
    }
    all
}

async fn up(
    ecosystem: Arc<Ecosystem>,
    place: Place,
    others: Others,
    manner: Manner,
    mut reload: Reload,
) -> ExitCode {
    let unavailable = |problem: String| {
        output::note(&format!("error: {problem}"));
        exit::with(exit::UNAVAILABLE)
    };
    hosting::warn_of_few_file_handles();
    // They end after the node: others are told that a daemon has left when it has.
    let (mut node, simulated, _stay, scouts) = match open(&ecosystem, &place).await {
        Ok(opened) => opened,
        Err(problem) => return unavailable(format!("failed to {problem}")),
    };
    let abroad = match abroad(&ecosystem, others, &place, &node).await {
        Ok(abroad) => abroad,
        Err(problem) => return unavailable(format!("failed to {problem}")),
    };
    // Before anybody hears that the daemon is ready, and may tell it to stop.
    let interrupted = interruption::interrupted();
    tokio::pin!(interrupted);
    reload.building = simulated.own.clone();
    if !manner.has_prompt {
        reload.hangups = reload::listen();
        reload.had_terminal = std::io::stdin().is_terminal();
    }
    hosting::watch_files(&node, &ecosystem);
    announce(&ecosystem, &place, &node);
    let socket = hosting::runtime_folder(&ecosystem.name)
        .and_then(|folder| socket_in(&folder, place.daemon.as_str()));
    let mut watch = None;
    if !manner.has_prompt {
        watch = socket.ok().map(hosting::watch_socket);
        let lease = substrate_zenoh::lease(&ecosystem.zenoh);
        hosting::watch_standstill(lease.unwrap_or(substrate_zenoh::LEASE));
        if scouts {
            hosting::watch_addresses();
        }
    }
    let mut begins_anew = false;
    if manner.has_prompt {
        match prompt(ecosystem, &node, manner.goals).await {
            Ok(guest) => {
                prompt::run(guest, interrupted).await;
            }
            Err(problem) => output::note(&format!("error: failed to {problem}")),
        }
    } else {
        begins_anew = serve(&mut node, &ecosystem, manner, reload, interrupted).await;
    }
    if !begins_anew {
        service_manager::stopping();
    }
    drop(watch);
    if !drain(node, abroad).await {
        output::note("warning: some agents did not finish in time; they were ended");
    }
    if begins_anew {
        hosting::begin_anew();
        return exit::with(exit::UNAVAILABLE);
    }
    exit::with(exit::DONE)
}

/// Runs the daemon until it is told to stop, or has to begin anew; says whether it has to.
async fn serve(
    node: &mut Node,
    ecosystem: &Ecosystem,
    manner: Manner,
    mut reload: Reload,
    interrupted: impl Future<Output = i32>,
) -> bool {
    let mut watchdog = Watchdog::from_environment();
    let mut stdin_ended = manner.until_stdin_ends.then(watch_stdin);
    let mut terminal = ask(ecosystem, node, manner.goals).await;
    tokio::pin!(interrupted);
    loop {
        tokio::select! {
            _ = &mut interrupted => return false,
            () = ended(&mut stdin_ended) => return false,
            () = watchdog.due() => watchdog.lives(),
            () = reload::asked_for(&mut reload.hangups) => {
                // The terminal that it was started in has been closed.
                if reload.had_terminal && !std::io::stdin().is_terminal() {
                    return false;
                }
                if reload.again(node).await == Next::BeginsAnew {
                    return true;
                }
            }
            heard = hear(&mut terminal) => {
                hearing::print(&heard, false);
            }
        }
    }
}

/// A prompt's end of this daemon: a keyboard of its own, which asks for the goals of the command
/// line.
async fn prompt(ecosystem: Arc<Ecosystem>, node: &Node, goals: Vec<Wish>) -> Result<Guest, String> {
    let (keyboard, terminal) = Keyboard::with_terminal();
    let name = client::guest_name("keyboard");
    let id = AgentId::new(&name).map_err(|error| error.to_string())?;
    node.launch(id.clone(), keyboard, ecosystem.domain.name.as_str());
    wish(&terminal, goals).await;
    let folder = hosting::runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?;
    let endpoint = |path: &PathBuf| format!("unixsock-stream/{}", path.display());
    let daemon = node.switchboard().daemon();
    let keys = ecosystem.security.as_ref().map(|settings| GuestKeys::of(settings, daemon));
    let view = View {
        keys,
        switchboard: Arc::clone(node.switchboard()),
        name: ecosystem.name.clone(),
        ecosystem: Some(ecosystem),
        endpoints: sockets(&folder).iter().map(endpoint).collect(),
    };
    Ok(Guest { view, id, terminal, json: false })
}

async fn wish(terminal: &Terminal, goals: Vec<Wish>) {
    for goal in goals {
        let wish = Wish { keep: acl::content::Keep::Maintain, ..goal };
        // The keyboard ends with the daemon, and then nobody wishes anything.
        let _ = terminal.say.send(Said::Wish(wish)).await;
    }
}

/// Reads standard input to its end, on a thread of its own: nothing can wake a read of a terminal,
/// and the process must not wait for it.
fn watch_stdin() -> oneshot::Receiver<()> {
    let (tell, ended) = oneshot::channel();
    std::thread::spawn(move || {
        // An input that cannot be read has ended.
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        let _ = tell.send(());
    });
    ended
}

async fn ended(stdin: &mut Option<oneshot::Receiver<()>>) {
    match stdin {
        Some(ended) => {
            // The watcher gone is the end too.
            let _ = ended.await;
        }
        None => std::future::pending().await,
    }
}

/// Says who is here. A process that started this one waits for the line, a service manager for
/// its own.
fn announce(ecosystem: &Ecosystem, place: &Place, node: &Node) {
    let agents: Vec<_> = node.agents().map(AgentId::as_str).collect();
    let alone = if place.is_alone { ", alone on this machine" } else { "" };
    let secured = match ecosystem.security {
        Some(_) => ", secured",
        None => "",
    };
    let hosts = match agents.len() {
        0 => "no agent yet".to_owned(),
        _ => agents.join(", "),
    };
    let line = format!(
        "daemon `{}` of `{}` {READY}{secured}{alone}: {hosts}\n",
        place.daemon, ecosystem.name
    );
    service_manager::ready(line.trim_end());
    let _ = output::print(line, exit::DONE);
    tracing::info!(locators = ?node.locators, "listening");
    if ecosystem.security.is_none() {
        tracing::warn!(
            "`{}` is not secured: messages are plain text and anybody's, and so stay on \
            this machine; `althing help cert` says how to secure it",
            ecosystem.name
        );
    }
}

/// A daemon's node, the building it lends others, its place in the folder of sockets, and whether it
/// looks for others beyond its machine.
async fn open(
    ecosystem: &Ecosystem,
    place: &Place,
) -> Result<(Node, Simulated, Stay, bool), String> {
    let socket = building_socket(ecosystem, place)?;
    let simulated = simulated(ecosystem, &place.agents, socket.as_ref()).await?;
    let building = simulated.handle.clone();
    let socket = socket.filter(|_| building.is_some());
    let state =
        hosting::state_folder(&ecosystem.name, &place.daemon).map_err(|error| error.to_string())?;
    let (wire, stay) = wire(ecosystem, &place.daemon).await?;
    let scouts = wire.scouts();
    let part = Part {
        ecosystem,
        daemon: place.daemon.clone(),
        agents: place.agents.clone(),
        mode: ecosystem.mode,
        building,
        state: Some(state.clone()),
    };
    let node = Node::open(part, wire).await.map_err(|error| error.to_string())?;
    let processes = Processes {
        ecosystem,
        agents: &place.agents,
        runtime: hosting::runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?,
        state,
        building: socket,
    };
    node.host_processes(processes)?;
    Ok((node, simulated, stay, scouts))
}

/// Where several processes share the building: as the file says, or where plugins of this daemon that
/// are processes find it.
fn building_socket(ecosystem: &Ecosystem, place: &Place) -> Result<Option<PathBuf>, String> {
    if ecosystem.building.socket.is_some() {
        return Ok(ecosystem.building.socket.clone());
    }
    let is_shared = place.agents.iter().any(|entry| !entry.is_built_in());
    let folder = hosting::runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?;
    Ok(is_shared.then(|| folder.join(format!("{}.building", place.daemon))))
}

/// The simulated building as this daemon uses it.
#[derive(Default)]
struct Simulated {
    handle: Option<BuildingHandle>,
    /// The building itself, where it is not another process's.
    own: Option<Building>,
    /// Lends it to others for as long as the daemon lives.
    _server: Option<Server>,
    /// Lends it to others when whoever does so now is gone.
    _succession: Option<Succession>,
}

impl Simulated {
    fn ours(building: Building, server: Option<Server>) -> Simulated {
        let handle = Some(building.handle());
        Simulated { handle, own: Some(building), _server: server, _succession: None }
    }

    /// Another process's, until that is gone.
    fn theirs(ecosystem: &Ecosystem, socket: &Path, building: BuildingHandle) -> Simulated {
        let succession = hosting::succeed(ecosystem.clone(), socket.to_owned(), building.clone());
        Simulated { handle: Some(building), _succession: Some(succession), ..Simulated::default() }
    }
}

/// The building of the simulated drivers, if any is hosted here: another process's, if one
/// serves it already; otherwise ours, which others may use.
async fn simulated(
    ecosystem: &Ecosystem,
    agents: &[AgentEntry],
    socket: Option<&PathBuf>,
) -> Result<Simulated, String> {
    let has_drivers = |entry: &AgentEntry| {
        plugins::find(&entry.plugin).is_some_and(|plugin| !plugin.drivers.is_empty())
    };
    if !agents.iter().any(has_drivers) {
        return Ok(Simulated::default());
    }
    if let Some(socket) = socket
        && let Ok(building) = BuildingHandle::connect(socket).await
    {
        return Ok(Simulated::theirs(ecosystem, socket, building));
    }
    let building = hosting::simulate(ecosystem).map_err(|error| error.to_string())?;
    let Some(socket) = socket else {
        return Ok(Simulated::ours(building, None));
    };
    match ::building::serve(building.handle(), socket).await {
        Ok(server) => Ok(Simulated::ours(building, Some(server))),
        // Another daemon that started with us was faster.
        Err(ServeError::InUse { .. }) => {
            let theirs = BuildingHandle::connect(socket).await;
            let theirs = theirs.map_err(|error| error.to_string())?;
            Ok(Simulated::theirs(ecosystem, socket, theirs))
        }
        Err(error) => Err(error.to_string()),
    }
}

/// Zenoh as this daemon uses it: daemons of one machine meet in a folder of sockets, and whoever
/// comes later calls those who are here.
async fn wire(ecosystem: &Ecosystem, daemon: &DaemonId) -> Result<(Wire, Stay), String> {
    let folder = hosting::runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?;
    let socket = socket_in(&folder, daemon.as_str()).map_err(|error| error.to_string())?;
    let security = ecosystem.security.as_ref();
    let secured = security.map(|settings| hosting::secure(&ecosystem.name, daemon, settings));
    let secured = secured.transpose()?;
    let stay = hosting::enter(&folder, daemon).await.map_err(|error| error.to_string())?;
    match security {
        Some(settings) => hosting::tell_keys(&socket, &settings.folder)
            .map_err(|error| format!("tell guests where the keys are: {error}"))?,
        None => hosting::forget_keys(&socket),
    }
    let endpoint = |path: &PathBuf| format!("unixsock-stream/{}", path.display());
    let mut config = substrate_zenoh::Config::new(ecosystem.name.clone(), daemon.clone());
    config.listen = vec![endpoint(&socket)];
    let called = |path: &PathBuf| format!("{}#{RETRY}", endpoint(path));
    config.connect = stay.others.iter().map(called).collect();
    config.zenoh = zenoh_settings(&ecosystem.zenoh);
    if let (Some(secured), Some(settings)) = (&secured, security) {
        let (folder, before) = (settings.folder.clone(), settings.warn_before);
        tokio::spawn(hosting::announce_end(secured.clone(), folder, before));
    }
    config.security = secured;
    Ok((Wire::Zenoh(Box::new(config)), stay))
}

fn zenoh_settings(said: &Value) -> Value {
    match said {
        Value::Object(table) if table.is_empty() => Value::Null,
        other => other.clone(),
    }
}

/// Asks for the goals of the command line, on behalf of whoever started the daemon.
async fn ask(ecosystem: &Ecosystem, node: &Node, goals: Vec<Wish>) -> Option<Terminal> {
    if goals.is_empty() {
        return None;
    }
    let (keyboard, terminal) = Keyboard::with_terminal();
    // The same in every life of the daemon, so that a goal is asked for anew and not once more.
    let id = AgentId::new(&format!("starter-{}", node.switchboard().daemon())).ok()?;
    node.launch(id, keyboard, ecosystem.domain.name.as_str());
    wish(&terminal, goals).await;
    Some(terminal)
}

async fn hear(terminal: &mut Option<Terminal>) -> Heard {
    let heard = match terminal {
        Some(terminal) => terminal.hear.recv().await,
        None => None,
    };
    match heard {
        Some(heard) => heard,
        None => std::future::pending().await,
    }
}

/// The sockets of the daemons of an ecosystem on this machine.
pub(super) fn sockets(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.flatten().map(|entry| entry.path());
    let mut sockets: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "sock"))
        .collect();
    sockets.sort();
    sockets
}
