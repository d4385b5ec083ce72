//! Lets the daemons of this machine read a changed ecosystem file again, and looks whether they
//! have taken it.
//!
//! A daemon is asked to read its file again (SIGHUP) only if it says that it has read the text
//! which the file had before. It takes agents and named goals while it runs. Rooms, doors and
//! goals that are asked for by themselves are read when a daemon starts, so it restarts itself under
//! its process id, and kept goals go on.

use std::path::{Path, PathBuf};
use std::time::Duration;

use acl::{AgentId, DaemonId};
use agent::Resource;
use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process};
use terminal::exit;
use tokio::time::Instant;

use crate::cli::ReachArgs;
use crate::commands::client::{ClientTarget, shell_word};
use crate::commands::{agents, daemon_sockets, in_runtime};
use crate::config::{AgentEntry, Ecosystem};
use crate::hosting::{self, DaemonSelfReport, FileDigests, text_digest};

/// How long the daemons of this machine may take until they have read the file: one that restarts
/// itself first ends what its agents do, and then waits until it sees all of them.
const TAKEN_WITHIN: Duration = Duration::from_secs(30);

/// Pause until the daemons are asked again.
const ASKED_AGAIN_AFTER: Duration = Duration::from_millis(250);

/// How long one question to the daemons may take, the link to them included.
const ASKED_WITHIN: Duration = Duration::from_secs(12);

/// A change of an ecosystem file.
pub(super) struct FileChange<'c> {
    pub(super) file: &'c Path,
    pub(super) before: &'c Ecosystem,
    pub(super) after: &'c Ecosystem,
    /// The agents that are new.
    pub(super) agents: Vec<AgentId>,
}

/// Whether a daemon has taken a change, and a text that follows its name.
pub(super) struct DaemonOutcome {
    pub(super) daemon: String,
    pub(super) is_taken: bool,
    pub(super) text: String,
}

/// The answers of the daemons.
#[derive(Default)]
struct Answers {
    reports: Vec<DaemonSelfReport>,
    agents: Vec<AgentId>,
}

/// Lets the daemons of this machine take a change. Returns one outcome for each daemon that the
/// change concerns; none if no daemon of the ecosystem runs here.
pub(super) fn take(change: &FileChange<'_>) -> Vec<DaemonOutcome> {
    let mut outcomes = Vec::new();
    in_runtime(async {
        outcomes = taken(change).await;
        exit::with(exit::DONE)
    });
    outcomes
}

async fn taken(change: &FileChange<'_>) -> Vec<DaemonOutcome> {
    let sockets = sockets(change.after);
    if sockets.is_empty() {
        return Vec::new();
    }
    let answers = match ask(change.after).await {
        Ok(answers) => answers,
        Err(problem) => {
            let text = format!("was not told: failed to {problem}; restart it");
            return sockets.iter().map(|path| outcome(&name_of(path), false, &text)).collect();
        }
    };
    let (mut outcomes, mut waiting) = (Vec::new(), Vec::new());
    for path in &sockets {
        let name = name_of(path);
        match told(change, path, &answers) {
            Ok(()) => waiting.push(name),
            Err(why) => outcomes.push(outcome(&name, false, &why)),
        }
    }
    outcomes.extend(await_taken(change, waiting).await);
    let is_elsewhere = |report: &&DaemonSelfReport| {
        let daemon = &report.digests.daemon;
        !daemon.is_guest() && !sockets.iter().any(|path| name_of(path) == daemon.as_str())
    };
    for report in answers.reports.iter().filter(is_elsewhere) {
        if report.file_text != Some(text_digest(&change.after.sources.file.text)) {
            let text = format!(
                "runs on another machine: copy {} there, then `sudo systemctl reload althing`",
                change.file.display()
            );
            outcomes.push(outcome(report.digests.daemon.as_str(), true, &text));
        }
    }
    outcomes
}

fn outcome(daemon: &str, is_taken: bool, text: &str) -> DaemonOutcome {
    DaemonOutcome { daemon: daemon.to_owned(), is_taken, text: text.to_owned() }
}

/// Returns the sockets of the ecosystem's daemons on this machine at which a process listens.
fn sockets(ecosystem: &Ecosystem) -> Vec<PathBuf> {
    let folder = hosting::runtime_base().join(ecosystem.name.as_str());
    let is_alive = |path: &PathBuf| daemon_sockets::is_listening(path);
    hosting::daemon_sockets(&folder).into_iter().filter(is_alive).collect()
}

fn name_of(socket: &Path) -> String {
    socket.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Sends SIGHUP to the daemon at a socket, if it has read the text that the file had before. The
/// error says why it does not take the change.
fn told(change: &FileChange<'_>, socket: &Path, answers: &Answers) -> Result<(), String> {
    let name = name_of(socket);
    let report = answers.reports.iter().find(|report| report.digests.daemon.as_str() == name);
    let file = shell_word(&change.file.display().to_string());
    match report.and_then(|report| report.file_text.as_ref()) {
        None => {
            return Err(
                "does not read its file again while it runs (it has a prompt, or is of an \
                        earlier version); restart it"
                    .to_owned(),
            );
        }
        Some(text) if *text != text_digest(&change.before.sources.file.text) => {
            return Err(format!(
                "runs with another text than {file} had, so it is left alone; restart it with \
                 `althing up {file}`"
            ));
        }
        Some(_) => (),
    }
    let endpoint = format!("unixsock-stream/{}", socket.display());
    if let Some(why) = daemon_sockets::why_mute(&endpoint) {
        return Err(format!("does not respond ({why})"));
    }
    let process: Pid = daemon_sockets::process_at(&endpoint)
        .ok_or_else(|| "is in another container; restart it there".to_owned())?;
    match kill_process(process, Signal::HUP) {
        Ok(()) => Ok(()),
        Err(Errno::PERM) => {
            Err("runs as another user: `sudo systemctl reload althing` lets it read \
                                 the file again"
                .to_owned())
        }
        Err(error) => Err(format!("could not be told: {error}; restart it")),
    }
}

/// Waits until each daemon of `waiting` has read the new text and its new agents are there.
async fn await_taken(change: &FileChange<'_>, mut waiting: Vec<String>) -> Vec<DaemonOutcome> {
    let deadline = Instant::now() + TAKEN_WITHIN;
    let text = text_digest(&change.after.sources.file.text);
    let mut outcomes = Vec::new();
    let mut answers = Answers::default();
    while !waiting.is_empty() && Instant::now() < deadline {
        tokio::time::sleep(ASKED_AGAIN_AFTER).await;
        // A daemon that restarts itself cannot be reached for a moment.
        answers = ask(change.after).await.unwrap_or_default();
        let has_taken = |name: &String| {
            let report = answers.reports.iter().find(|it| it.digests.daemon.as_str() == name);
            let has_read = report.and_then(|it| it.file_text.as_ref()) == Some(&text);
            has_read && missing(change, name, &answers).is_empty()
        };
        let (done, left) = waiting.into_iter().partition(has_taken);
        waiting = left;
        let done: Vec<String> = done;
        outcomes.extend(done.iter().map(|name| outcome(name, true, &success(change, name))));
    }
    for name in &waiting {
        let missing = missing(change, name, &answers);
        let has_read = answers.reports.iter().any(|report| {
            report.digests.daemon.as_str() == name && report.file_text.as_ref() == Some(&text)
        });
        let why = match has_read {
            true => format!(
                "has read the file, and does not have {}: its output says why",
                missing.iter().map(|agent| format!("`{agent}`")).collect::<Vec<_>>().join(", ")
            ),
            false => "has not read the file again in time: its output says why".to_owned(),
        };
        outcomes.push(outcome(name, false, &why));
    }
    outcomes
}

/// Returns the new agents that a daemon is to host and that are not present.
fn missing(change: &FileChange<'_>, daemon: &str, answers: &Answers) -> Vec<AgentId> {
    let is_hosted = |entry: &&AgentEntry| {
        let is_new = change.agents.contains(&entry.name);
        is_new && (entry.daemons.is_empty() || entry.daemons.iter().any(|it| it.as_str() == daemon))
    };
    let hosted = change.after.agents.iter().filter(is_hosted).map(|entry| &entry.name);
    hosted.filter(|agent| !answers.agents.contains(agent)).cloned().collect()
}

/// Returns what a daemon that has taken the change has done.
fn success(change: &FileChange<'_>, daemon: &str) -> String {
    let map = |ecosystem: &Ecosystem| {
        DaemonId::new(daemon).ok().map(|daemon| FileDigests::of(daemon, ecosystem).map)
    };
    let read_at_start = if map(change.before) != map(change.after) {
        "rooms and doors"
    } else if change.before.goals.by_themselves != change.after.goals.by_themselves {
        "goals that are asked for by themselves"
    } else {
        return "has taken it".to_owned();
    };
    format!(
        "has taken it: it restarted itself, as {read_at_start} are read at the start; kept goals \
         go on"
    )
}

/// Asks all daemons which files they have read and which agents are there, by a link of its own:
/// the link of a question before would end with the daemon that it was to.
async fn ask(ecosystem: &Ecosystem) -> Result<Answers, String> {
    let asking = async {
        let target = ClientTarget::named(
            ecosystem.name.clone(),
            Some(ecosystem.clone()),
            &ReachArgs::default(),
        )?;
        let turn = target.turn()?;
        let link = target.link().await?;
        drop(turn);
        link.view.directory(None).await;
        let reports = link.view.ask(Resource::Files, None).await;
        let read = |answer| serde_json::from_slice::<DaemonSelfReport>(answer).ok();
        let reports = reports.iter().filter_map(|answer| read(answer)).collect();
        let residents = agents::residents(&link.view).await;
        let agents = residents.into_iter().map(|resident| resident.agent).collect();
        link.node.drain().await;
        Ok(Answers { reports, agents })
    };
    let late = |_| "reach its daemons in time".to_owned();
    tokio::time::timeout(ASKED_WITHIN, asking).await.map_err(late)?
}
