//! `althing up`: runs a daemon until the daemon is asked to stop.

mod reload;

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use acl::{AgentId, DaemonId};
use agent::Mode;
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use terminal::report::DiagnosticReport;
use terminal::{exit, output};
use tokio::sync::oneshot;

use crate::asking::wishes;
use crate::cli::UpArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::event_output;
use crate::config::{self, Ecosystem, InterfaceEntry, Overrides, ParsedEcosystem};
use crate::hosting::{
    self, DaemonNode, GuestKeys, HostedPart, NodeOptions, OpenedDaemon, PresenceGuard, READY,
    ReadText, socket_in,
};
use crate::interfacing::{self, PeerEcosystem};
use crate::interruption;
use crate::plugins;
use crate::prompt::{self, PromptSession};
use crate::review::{self, ReviewScope};
use crate::service_manager::{self, Watchdog};
use crate::speech;
use reload::{Reload, ReloadOutcome};

/// Runs `althing up`: reads the ecosystem, hosts the agents of this machine, and shuts the daemon
/// down at SIGINT and SIGTERM.
pub(super) fn run(args: &UpArgs) -> ExitCode {
    hosting::restrict_umask();
    let Some(file) = args.file.clone().or_else(config::find_ecosystem_file) else {
        output::print_note(
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
    speech::learn(&ecosystem.words);
    let (goals, others) = match check_start(&ecosystem, &place, &args.goals) {
        Ok(checked) => checked,
        Err(exit) => return exit,
    };
    let manner =
        UpTasks { goals, has_prompt: args.keyboard, until_stdin_ends: args.until_stdin_ends };
    if let Err(problem) = hosting::claim_state(&ecosystem.name, &place.daemon) {
        output::print_note(&format!("error: failed to {problem}"));
        return exit::with(exit::CONFIG);
    }
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
        read_text: ReadText::default(),
    };
    super::in_runtime(up(ecosystem, place, others, manner, reload))
}

/// Checks what a daemon needs to start beyond its own part of the ecosystem file: the goals of the
/// command line, the files of other ecosystems, and the page. Mistakes are shown to the user; the
/// error is the exit code.
fn check_start(
    ecosystem: &Ecosystem,
    place: &HostedPart,
    goals: &[String],
) -> Result<(Vec<GoalRequest>, PeerInterfaces), ExitCode> {
    let refused = |problem: String| {
        output::print_note(&format!("error: {problem}"));
        exit::with(exit::CONFIG)
    };
    let goals: Result<_, _> =
        goals.iter().map(|goal| wishes::goal(Some(ecosystem), goal)).collect();
    let goals = goals.map_err(refused)?;
    let others = others(ecosystem, place)
        .map_err(|report| output::show(&report, false, "bad-input", exit::CONFIG))?;
    match page_problem(ecosystem, place) {
        Some(problem) => Err(refused(problem)),
        None => Ok((goals, others)),
    }
}

/// Reads the ecosystem file and finds the part that this daemon hosts. Mistakes in the file are
/// shown to the user; the error is the exit code.
fn read(
    file: &Path,
    overrides: &Overrides,
    asked: Option<&str>,
) -> Result<(Ecosystem, HostedPart), ExitCode> {
    let reading = Ecosystem::read(file, overrides, &plugins::known());
    let refused =
        |report: &DiagnosticReport| output::show(report, false, "bad-input", exit::CONFIG);
    let place = match &reading.ecosystem {
        Some(ecosystem) if !reading.report.has_errors() => HostedPart::find(ecosystem, asked),
        _ => return Err(refused(&review::review(&reading, ReviewScope::Everything))),
    };
    let place = place.map_err(|problem| {
        output::print_note(&format!("error: {problem}"));
        exit::with(exit::CONFIG)
    })?;
    let scope =
        if place.is_alone { ReviewScope::Everything } else { ReviewScope::Daemon(&place.daemon) };
    let report = review::review(&reading, scope);
    let ParsedEcosystem { ecosystem: Some(ecosystem), .. } = reading else {
        return Err(refused(&report));
    };
    if report.has_errors() {
        return Err(refused(&report));
    }
    output::show_to_person(&report);
    for (watchdog, robot) in place.idle_watchdogs(&ecosystem) {
        output::print_note(&format!(
            "warning: this machine hosts both `{robot}` and its watchdog `{watchdog}`: if the \
             machine dies, the robot finishes its goal; start another machine with `althing up \
             --daemon NAME`, each with a daemon of the file"
        ));
    }
    Ok((ecosystem, place))
}

/// Returns the reason why this program cannot serve the page that the file asks this daemon for;
/// `None` if it can, or need not.
fn page_problem(ecosystem: &Ecosystem, place: &HostedPart) -> Option<String> {
    let is_asked = ecosystem.web.as_ref().is_some_and(|web| web.is_served_by(&place.daemon));
    (is_asked && !cfg!(feature = "web")).then(|| {
        format!(
            "[web] asks `{}` for a page, and this program was built without pages (feature `web`): \
             name other daemons in `daemons` of [web], or use a program with the feature",
            place.daemon
        )
    })
}

/// The tasks that the command line gives to the daemon, besides hosting agents.
struct UpTasks {
    /// The goals that the daemon requests once it runs.
    goals: Vec<GoalRequest>,
    has_prompt: bool,
    until_stdin_ends: bool,
}

/// The other ecosystems that this daemon joins, each with the interface that connects this
/// ecosystem to it.
type PeerInterfaces = Vec<(InterfaceEntry, PeerEcosystem)>;

/// Reads the files of the other ecosystems that this daemon joins by its interfaces.
fn others(ecosystem: &Ecosystem, place: &HostedPart) -> Result<PeerInterfaces, DiagnosticReport> {
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

/// This process's nodes in the other ecosystems, each with its presence among the daemons of that
/// ecosystem.
type PeerNodes = Vec<(DaemonNode, PresenceGuard)>;

/// Joins the other ecosystems, each by a separate connection, and starts the interfaces to them.
async fn abroad(
    ecosystem: &Ecosystem,
    others: PeerInterfaces,
    place: &HostedPart,
    home: &DaemonNode,
) -> Result<PeerNodes, String> {
    let mut abroad = Vec::new();
    for (entry, other) in others {
        let other = other.ecosystem;
        let daemon =
            DaemonId::new(entry.remote_name.as_str()).map_err(|error| error.to_string())?;
        let state = hosting::state_folder(&ecosystem.name, &place.daemon)
            .map_err(|error| error.to_string())?
            .join(other.name.as_str());
        std::fs::create_dir_all(&state)
            .map_err(|error| format!("use the folder {}: {error}", state.display()))?;
        let (transport, presence) = hosting::daemon_transport(&other, &daemon).await?;
        let part = NodeOptions {
            ecosystem: &other,
            daemon,
            agents: Vec::new(),
            mode: other.mode,
            building: None,
            state: Some(state),
        };
        let node = DaemonNode::open(part, transport).await.map_err(|error| error.to_string())?;
        if let (Some(ours), Some(theirs)) = (home.spawner(), node.spawner()) {
            let (ours, theirs) =
                (ecosystem.ecosystem_endpoint(ours), other.ecosystem_endpoint(theirs));
            interfacing::connect(&entry, &ours, &theirs).map_err(|error| error.to_string())?;
        }
        tracing::info!(ecosystem = %other.name, called = %entry.remote_name, "joined another ecosystem");
        abroad.push((node, presence));
    }
    Ok(abroad)
}

/// Shuts down the nodes of this process in all ecosystems; returns `false` if that takes too long.
/// Proxy agents leave before the agents that they represent, so that the commitments of the proxy
/// agents are cancelled in the other ecosystem as well.
async fn drain(home: DaemonNode, abroad: PeerNodes) -> bool {
    let mut all = home.drain().await;
    for (node, _stay) in abroad {
        all &= node.drain().await;
    }
    all
}

/// Watches for what makes a daemon restart itself. The watch of the socket ends with the returned
/// value.
fn watch_for_restarts(
    ecosystem: &Ecosystem,
    place: &HostedPart,
    scouts: bool,
) -> Option<hosting::SocketWatch> {
    let socket = hosting::runtime_folder(&ecosystem.name)
        .and_then(|folder| socket_in(&folder, place.daemon.as_str()));
    let watch = socket.ok().map(hosting::watch_socket);
    let lease = substrate_zenoh::lease(&ecosystem.zenoh);
    hosting::watch_suspension(lease.unwrap_or(substrate_zenoh::LEASE));
    hosting::watch_zenoh_panics();
    if scouts {
        hosting::watch_addresses();
    }
    watch
}

async fn up(
    ecosystem: Arc<Ecosystem>,
    place: HostedPart,
    others: PeerInterfaces,
    manner: UpTasks,
    mut reload: Reload,
) -> ExitCode {
    let unavailable = |problem: String| {
        output::print_note(&format!("error: {problem}"));
        exit::with(exit::UNAVAILABLE)
    };
    hosting::warn_of_few_file_handles();
    // The presence and the building are dropped after the node: other daemons must not see that
    // this one has left before it has.
    let opened = match hosting::open_daemon(&ecosystem, &place).await {
        Ok(opened) => opened,
        Err(problem) => return unavailable(format!("failed to {problem}")),
    };
    let OpenedDaemon { mut node, building, presence: _presence, scouts } = opened;
    let abroad = match abroad(&ecosystem, others, &place, &node).await {
        Ok(abroad) => abroad,
        Err(problem) => return unavailable(format!("failed to {problem}")),
    };
    // Handlers are installed before the daemon reports that it is ready, because it may be stopped
    // right after that.
    let interrupted = interruption::interrupted();
    tokio::pin!(interrupted);
    reload.building = building.own.clone();
    if !manner.has_prompt {
        reload.begin();
    }
    hosting::watch_files(&node, &ecosystem, reload.read_text.clone());
    ecosystem.metrics.into_iter().for_each(|address| node.serve_metrics(address));
    announce(&ecosystem, &place, &node);
    #[cfg(feature = "web")]
    let page = crate::web::serve(&node, &ecosystem);
    let watch = (!manner.has_prompt).then(|| watch_for_restarts(&ecosystem, &place, scouts));
    let mut begins_anew = false;
    if manner.has_prompt {
        match prompt(ecosystem, &node, manner.goals).await {
            Ok(guest) => {
                prompt::run(guest, interrupted).await;
            }
            Err(problem) => output::print_note(&format!("error: failed to {problem}")),
        }
    } else {
        begins_anew = serve(&mut node, &ecosystem, manner, reload, interrupted).await;
    }
    if !begins_anew {
        service_manager::stopping();
    }
    drop(watch);
    // People see the end of the page, and not that of each agent.
    #[cfg(feature = "web")]
    drop(page);
    if !drain(node, abroad).await {
        output::print_note("warning: some agents did not finish in time; they were ended");
    }
    if begins_anew {
        hosting::restart_process();
        return exit::with(exit::UNAVAILABLE);
    }
    exit::with(exit::DONE)
}

/// Runs the daemon until it is asked to stop (returns `false`) or has to restart itself (returns
/// `true`).
async fn serve(
    node: &mut DaemonNode,
    ecosystem: &Ecosystem,
    manner: UpTasks,
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
            () = watchdog.due() => watchdog.keep_alive(),
            () = reload::asked_for(&mut reload.hangups) => {
                // The terminal in which the daemon was started has been closed.
                if reload.had_terminal && !std::io::stdin().is_terminal() {
                    return false;
                }
                if reload.again(node).await == ReloadOutcome::Restart {
                    return true;
                }
            }
            heard = hear(&mut terminal) => {
                event_output::print(&heard, false);
            }
        }
    }
}

/// Opens the prompt of `--keyboard` in this daemon. The keyboard agent of the prompt also requests
/// the goals of the command line.
async fn prompt(
    ecosystem: Arc<Ecosystem>,
    node: &DaemonNode,
    goals: Vec<GoalRequest>,
) -> Result<PromptSession, String> {
    let (keyboard, terminal) = Keyboard::with_terminal();
    let name = client::guest_name("keyboard");
    let id = AgentId::new(&name).map_err(|error| error.to_string())?;
    node.launch(id.clone(), keyboard, ecosystem.domain.name.as_str());
    wish(&terminal, goals).await;
    let folder = hosting::runtime_folder(&ecosystem.name).map_err(|error| error.to_string())?;
    let endpoint = |path: &PathBuf| format!("unixsock-stream/{}", path.display());
    let daemon = node.router().daemon();
    let keys = ecosystem.security.as_ref().map(|settings| GuestKeys::of(settings, daemon));
    let view = EcosystemView {
        keys,
        router: Arc::clone(node.router()),
        name: ecosystem.name.clone(),
        ecosystem: Some(ecosystem),
        endpoints: hosting::daemon_sockets(&folder).iter().map(endpoint).collect(),
    };
    Ok(PromptSession { view, id, terminal, json: false })
}

async fn wish(terminal: &Terminal, goals: Vec<GoalRequest>) {
    for goal in goals {
        let wish = GoalRequest { keep: acl::content::Keep::Maintain, ..goal };
        // The keyboard ends with the daemon, and the goal is not needed any more in that case.
        let _ = terminal.requests.send(UserRequest::RequestGoal(wish)).await;
    }
}

/// Reads standard input to its end, on a separate thread. Reading from a terminal cannot be
/// interrupted, and must not keep the process from ending.
fn watch_stdin() -> oneshot::Receiver<()> {
    let (tell, ended) = oneshot::channel();
    std::thread::spawn(move || {
        // An error while reading counts as the end.
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        let _ = tell.send(());
    });
    ended
}

async fn ended(stdin: &mut Option<oneshot::Receiver<()>>) {
    match stdin {
        Some(ended) => {
            // The end of the watching thread counts as the end, too.
            let _ = ended.await;
        }
        None => std::future::pending().await,
    }
}

/// Prints which agents this daemon hosts. A process that started this one waits for the line; a
/// service manager is notified in another way.
fn announce(ecosystem: &Ecosystem, place: &HostedPart, node: &DaemonNode) {
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
            "`{}` is not secured: messages are neither encrypted nor signed, and so stay \
            on this machine; `althing help cert` says how to secure it",
            ecosystem.name
        );
    }
}

/// Requests the goals of the command line, through a keyboard agent.
async fn ask(
    ecosystem: &Ecosystem,
    node: &DaemonNode,
    goals: Vec<GoalRequest>,
) -> Option<Terminal> {
    if goals.is_empty() {
        return None;
    }
    let (keyboard, terminal) = Keyboard::with_terminal();
    // The keyboard has the same name in every incarnation of the daemon, so that its goal is
    // resumed and not requested twice.
    let id = AgentId::new(&format!("starter-{}", node.router().daemon())).ok()?;
    node.launch(id, keyboard, ecosystem.domain.name.as_str());
    wish(&terminal, goals).await;
    Some(terminal)
}

async fn hear(terminal: &mut Option<Terminal>) -> UserEvent {
    let heard = match terminal {
        Some(terminal) => terminal.events.recv().await,
        None => None,
    };
    match heard {
        Some(heard) => heard,
        None => std::future::pending().await,
    }
}
