//! Examines the running ecosystem: links to it as any command does, queries its daemons, and passes
//! the answers on to be judged.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::DaemonId;
use acl::content::{DaemonReport, Mailboxes, OpenQuestion, StopState};
use agent::{MessageRouter, Resident, Resource, ResourceQuery};
use bytes::Bytes;
use plugin_host::PluginList;
use rustix::process::Pid;
use serde::de::DeserializeOwned;
use terminal::exit;
use tokio::task::JoinSet;

use super::finding::{CheckFinding, DoctorCheck, Remedy, names};
use super::subject::DoctorSubject;
use super::{members, people, traffic};
use crate::commands::agents::{self, AnnouncedModels};
use crate::commands::client::{ClientLink, ClientTarget, EcosystemView};
use crate::commands::{daemon_sockets, in_runtime};
use crate::hosting::{self, DaemonSelfReport};

/// How long the link to a daemon may take.
const LINKED_WITHIN: Duration = Duration::from_secs(20);

/// How long all queries together may take. Each has a time limit of its own, and most run side by
/// side.
const EXAMINED_WITHIN: Duration = Duration::from_secs(60);

/// How long a daemon may take to tell its clock.
const CLOCK_TOLD_WITHIN: Duration = Duration::from_secs(3);

/// How long the daemons of this machine may take to answer after the link is up. Two daemons know
/// each other within a second.
const ANSWERING_WITHIN: Duration = Duration::from_secs(3);

/// Wait until the daemons of this machine are asked again.
const ANSWERED_AGAIN_AFTER: Duration = Duration::from_millis(200);

/// Maximum number of daemons whose clocks are compared.
const CLOCKS_MAX: usize = 64;

/// Least time between the two readings of counters.
const COUNTED_FOR: Duration = Duration::from_secs(2);

/// The daemons of an ecosystem whose process is on this machine.
pub(super) struct LocalDaemon {
    pub(super) name: String,
    pub(super) process: Option<Pid>,
}

/// A daemon's clock, compared with that of this machine.
pub(super) struct ClockReading {
    pub(super) daemon: DaemonId,
    /// How far the clock is from this machine's, whatever the time that the answer took; zero if
    /// that time explains the difference.
    pub(super) difference: Duration,
    pub(super) is_ahead: bool,
}

/// The answers of an ecosystem.
pub(super) struct EcosystemAnswers {
    pub(super) residents: BTreeSet<Resident>,
    /// What each daemon says of its files and its clock.
    pub(super) digests: Vec<DaemonSelfReport>,
    /// What each daemon says of itself.
    pub(super) reports: Vec<DaemonReport>,
    /// The counters of each daemon, twice, with time in between.
    pub(super) mailboxes: [Vec<Mailboxes>; 2],
    pub(super) models: AnnouncedModels,
    pub(super) plugins: Vec<PluginList>,
    pub(super) stops: Vec<StopState>,
    pub(super) questions: Vec<OpenQuestion>,
    pub(super) clocks: Vec<ClockReading>,
    pub(super) local: Vec<LocalDaemon>,
}

impl EcosystemAnswers {
    /// Returns the daemons that have answered anything, without guests.
    pub(super) fn daemons(&self) -> BTreeSet<DaemonId> {
        let residents = self.residents.iter().map(|resident| &resident.daemon);
        let digests = self.digests.iter().map(|report| &report.digests.daemon);
        let reports = self.reports.iter().map(|report| &report.daemon);
        let counted = self.mailboxes.iter().flatten().map(|mailboxes| &mailboxes.daemon);
        let all = residents.chain(digests).chain(reports).chain(counted);
        all.filter(|daemon| !daemon.is_guest()).cloned().collect()
    }

    /// Returns the command that makes a daemon read its file again.
    pub(super) fn reload(&self, daemon: &DaemonId) -> Option<Remedy> {
        let here = self.local.iter().find(|local| local.name == daemon.as_str());
        match here.and_then(|local| local.process) {
            Some(process) => Remedy::mend(format!("kill -HUP {process}")),
            // The daemon is on another machine, on which deploy/README.md makes it this service.
            None => Remedy::mend("sudo systemctl reload althing"),
        }
    }
}

/// Examines the running ecosystem, if there is one.
pub(super) fn examine(subject: &DoctorSubject) -> Vec<CheckFinding> {
    let check = DoctorCheck::Running;
    let Some(name) = &subject.name else {
        return vec![match subject.running.as_slice() {
            [] if subject.is_unread() => {
                check.note("the file has mistakes, so it is not known which ecosystem it is", None)
            }
            [] => check.note("no ecosystem runs on this machine, and no file is given", None),
            several => check.note(
                format!(
                    "several ecosystems run here: {}",
                    names(several.iter().map(|it| it.as_str()))
                ),
                several.first().map(|first| Remedy::Look(format!("althing doctor {first}"))),
            ),
        }];
    };
    let folder = hosting::runtime_base().join(name.as_str());
    let sockets = hosting::daemon_sockets(&folder);
    let is_alive = |path: &PathBuf| daemon_sockets::is_listening(path);
    let alive: Vec<_> = sockets.into_iter().filter(is_alive).collect();
    if alive.is_empty() && subject.reach.connect.is_empty() {
        return vec![check.note(
            format!("no daemon of `{name}` runs on this machine"),
            start_command(subject, subject.daemon()).map(Remedy::Mend),
        )];
    }
    let (mut findings, local, answering) = processes(&alive);
    if answering == 0 && subject.reach.connect.is_empty() {
        return findings;
    }
    let ecosystem = subject.ecosystem.as_deref().cloned();
    let target = ClientTarget::named(name.clone(), ecosystem, &subject.reach);
    let joined = target.and_then(|target| target.turn().map(|turn| (target, turn)));
    let target = match joined {
        Ok((target, _turn)) => target,
        Err(problem) => {
            findings.push(check.problem(format!("failed to {problem}"), None));
            return findings;
        }
    };
    in_runtime(async {
        findings.extend(linked(subject, target, local).await);
        exit::with(exit::DONE)
    });
    findings
}

/// Returns the command that starts a daemon of the file; `None` without a file.
pub(super) fn start_command(subject: &DoctorSubject, daemon: Option<&DaemonId>) -> Option<String> {
    subject.file.as_ref()?;
    let is_of_file = |daemon: &&DaemonId| {
        subject.ecosystem.as_ref().is_some_and(|it| it.daemons.contains(*daemon))
    };
    let daemon = daemon.filter(is_of_file).map(|daemon| format!(" --daemon {daemon}"));
    Some(format!("althing up {}{}", subject.file_word(), daemon.unwrap_or_default()))
}

/// Checks whether the daemons of this machine can answer. Returns the findings, the daemons, and
/// how many can answer.
fn processes(sockets: &[PathBuf]) -> (Vec<CheckFinding>, Vec<LocalDaemon>, usize) {
    let check = DoctorCheck::Processes;
    let (mut findings, mut local, mut answering) = (Vec::new(), Vec::new(), 0);
    for socket in sockets {
        let endpoint = format!("unixsock-stream/{}", socket.display());
        let name = socket.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let process = daemon_sockets::process_at(&endpoint);
        match daemon_sockets::why_mute(&endpoint) {
            None => answering += 1,
            Some(why) => {
                let remedy = process.map(|process| Remedy::Mend(format!("kill -CONT {process}")));
                findings.push(check.problem(format!("`{name}` does not answer: {why}"), remedy));
            }
        }
        local.push(LocalDaemon { name, process });
    }
    if findings.is_empty() && !local.is_empty() {
        let all = names(local.iter().map(|daemon| &daemon.name));
        findings.push(check.ok(format!("on this machine: {all}")));
    }
    (findings, local, answering)
}

/// Links to the ecosystem, queries it, and judges the answers.
async fn linked(
    subject: &DoctorSubject,
    target: ClientTarget,
    local: Vec<LocalDaemon>,
) -> Vec<CheckFinding> {
    let check = DoctorCheck::Running;
    let link = match tokio::time::timeout(LINKED_WITHIN, target.link()).await {
        Ok(Ok(link)) => link,
        Ok(Err(problem)) => return vec![check.problem(format!("failed to {problem}"), None)],
        Err(_) => {
            let text = format!("no daemon has answered within {LINKED_WITHIN:?}");
            return vec![check.problem(text, None)];
        }
    };
    let ClientLink { node, view } = link;
    let asked = tokio::time::timeout(EXAMINED_WITHIN, ask(&view, local)).await;
    node.drain().await;
    let Ok(answers) = asked else {
        let text = format!("the queries were not answered within {EXAMINED_WITHIN:?}");
        return vec![check.problem(text, None)];
    };
    let daemons = answers.daemons();
    if daemons.is_empty() {
        return vec![check.problem("the link is up, and no daemon answers", None)];
    }
    let mut findings =
        vec![check.ok(format!("reached: {}", names(daemons.iter().map(DaemonId::as_str))))];
    findings.extend(members::judge(subject, &answers));
    findings.extend(traffic::judge(subject, &answers));
    findings.extend(people::judge(subject, &answers));
    findings
}

/// Queries the daemons for all that is judged.
async fn ask(view: &EcosystemView, local: Vec<LocalDaemon>) -> EcosystemAnswers {
    view.directory(None).await;
    await_local(view, &local).await;
    let began = tokio::time::Instant::now();
    let first = each::<Mailboxes>(view, Resource::Mailbox).await;
    let (residents, models, digests, reports, plugins, stops, questions) = tokio::join!(
        agents::residents(view),
        agents::models(view),
        each::<DaemonSelfReport>(view, Resource::Files),
        each::<DaemonReport>(view, Resource::Daemon),
        each::<PluginList>(view, Resource::Plugins),
        each::<StopState>(view, Resource::Stops),
        each::<Vec<OpenQuestion>>(view, Resource::Questions),
    );
    let clocks = clocks(view, &digests).await;
    tokio::time::sleep_until(began + COUNTED_FOR).await;
    let second = each::<Mailboxes>(view, Resource::Mailbox).await;
    let questions = questions.into_iter().flatten().collect();
    let mailboxes = [first, second];
    EcosystemAnswers {
        residents,
        digests,
        reports,
        mailboxes,
        models,
        plugins,
        stops,
        questions,
        clocks,
        local,
    }
}

/// Waits until the daemons of this machine answer queries. A daemon that has just started is seen
/// before its answers arrive, and would be taken for an older one that gives none.
async fn await_local(view: &EcosystemView, local: &[LocalDaemon]) {
    let answering = async {
        loop {
            let reports = each::<DaemonReport>(view, Resource::Daemon).await;
            let answers =
                |daemon: &LocalDaemon| reports.iter().any(|it| it.daemon.as_str() == daemon.name);
            if local.iter().all(answers) {
                return;
            }
            tokio::time::sleep(ANSWERED_AGAIN_AFTER).await;
        }
    };
    let _ = tokio::time::timeout(ANSWERING_WITHIN, answering).await;
}

/// Queries a resource from all daemons. Answers that cannot be read are left out.
async fn each<T: DeserializeOwned>(view: &EcosystemView, resource: Resource) -> Vec<T> {
    let answers = view.ask(resource, None).await;
    answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
}

/// Compares the clocks of daemons with that of this machine, side by side.
async fn clocks(view: &EcosystemView, digests: &[DaemonSelfReport]) -> Vec<ClockReading> {
    let mut asked = JoinSet::new();
    for report in digests.iter().take(CLOCKS_MAX) {
        asked.spawn(clock(Arc::clone(&view.router), report.digests.daemon.clone()));
    }
    let mut readings: Vec<_> = asked.join_all().await.into_iter().flatten().collect();
    readings.sort_by(|one, other| one.daemon.cmp(&other.daemon));
    readings
}

/// Compares the clock of a daemon with that of this machine; `None` if the daemon does not tell it.
async fn clock(router: Arc<MessageRouter>, daemon: DaemonId) -> Option<ClockReading> {
    let resource = Resource::Files;
    let query = ResourceQuery { daemon: Some(daemon.clone()), resource, agent: None };
    let (began, asked) = (since_1970()?, Instant::now());
    let answers = router.ask(query, CLOCK_TOLD_WITHIN).await;
    let took = asked.elapsed();
    let read = |answer: &Bytes| serde_json::from_slice::<DaemonSelfReport>(answer).ok();
    let told = answers.iter().find_map(read)?.clock_ms?;
    let (difference, is_ahead) = difference(Duration::from_millis(told), began, took);
    Some(ClockReading { daemon, difference, is_ahead })
}

fn since_1970() -> Option<Duration> {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).ok()
}

/// Returns how far the clock `told` is beyond the time from `began` on that the answer took, and
/// whether it is ahead.
fn difference(told: Duration, began: Duration, took: Duration) -> (Duration, bool) {
    let ended = began.saturating_add(took);
    match told > ended {
        true => (told - ended, true),
        false => (began.saturating_sub(told), false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_the_answer_is_no_difference_of_clocks() {
        let seconds = Duration::from_secs;
        let of = |told: u64| difference(seconds(told), seconds(100), seconds(2));
        assert_eq!(of(100).0, Duration::ZERO);
        assert_eq!(of(102).0, Duration::ZERO);
        assert_eq!(of(107), (seconds(5), true));
        assert_eq!(of(40), (seconds(60), false));
    }
}
