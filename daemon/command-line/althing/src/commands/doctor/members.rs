//! Judges which daemons and agents are there, and whether they agree on version, files and time.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::AbsentAgent;
use acl::{AgentId, DaemonId};
use terminal::render::plural;

use super::finding::{CheckFinding, DoctorCheck, Remedy, names};
use super::machine::clock_difference;
use super::running::{EcosystemAnswers, start_command};
use super::subject::DoctorSubject;
use crate::hosting::FileDigests;

/// Version of this program.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Difference of clocks that is worth a note, and from which it is a problem: certificates and
/// records of what happened are then hard to compare.
const CLOCK_NOTE: Duration = Duration::from_secs(1);
const CLOCK_PROBLEM: Duration = Duration::from_secs(30);

const DAY_SECONDS: u64 = 24 * 3_600;

/// How many days before its end a certificate is told, if no file sets the number.
const WARN_DAYS: u64 = 30;

/// Judges the members of the ecosystem.
pub(super) fn judge(subject: &DoctorSubject, answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let present = answers.daemons();
    let mut findings = daemons(subject, &present);
    findings.extend(agents(subject, answers, &present));
    findings.extend(versions(subject, answers, &present));
    findings.extend(certificates(subject, answers));
    findings.extend(open_files(answers));
    findings.extend(files(subject, answers));
    findings.extend(clocks(answers));
    findings
}

fn daemons(subject: &DoctorSubject, present: &BTreeSet<DaemonId>) -> Vec<CheckFinding> {
    let check = DoctorCheck::Daemons;
    let Some(ecosystem) = &subject.ecosystem else {
        return vec![check.ok("no file says which daemons there should be")];
    };
    let absent: Vec<_> = ecosystem.daemons.difference(present).collect();
    if absent.is_empty() {
        return vec![check.ok("all daemons of the file are reached")];
    }
    let problem = |daemon: &DaemonId| {
        let start = start_command(subject, Some(daemon)).map(Remedy::Mend);
        check.problem(format!("`{daemon}` is not reached; to start it on its machine:"), start)
    };
    absent.into_iter().map(problem).collect()
}

fn agents(
    subject: &DoctorSubject,
    answers: &EcosystemAnswers,
    present: &BTreeSet<DaemonId>,
) -> Vec<CheckFinding> {
    let check = DoctorCheck::Agents;
    let here: BTreeSet<&AgentId> = answers.residents.iter().map(|it| &it.agent).collect();
    let Some(ecosystem) = &subject.ecosystem else {
        return reported_absent(answers, &here);
    };
    let absent = ecosystem.agents.iter().filter(|entry| !here.contains(&entry.name));
    // An agent whose daemons are all absent is no problem of its own.
    let mut of_daemon: BTreeMap<Option<&DaemonId>, Vec<&AgentId>> = BTreeMap::new();
    for entry in absent {
        let host = match entry.daemons.as_slice() {
            // The only daemon of the ecosystem hosts it.
            [] if ecosystem.daemons.len() > 1 => None,
            [] => present.first().filter(|_| present.len() == 1),
            daemons => daemons.iter().find(|daemon| present.contains(*daemon)),
        };
        if host.is_some() || entry.daemons.is_empty() {
            of_daemon.entry(host).or_default().push(&entry.name);
        }
    }
    if of_daemon.is_empty() {
        return vec![check.ok(format!("{} are present", here.len()))];
    }
    let problem = |(host, agents): (Option<&DaemonId>, Vec<&AgentId>)| {
        let names = names(agents.iter().map(|agent| agent.as_str()));
        match host {
            Some(host) => check.problem(
                format!(
                    "{names} of the file: absent, though `{host}` runs; to read the file again:"
                ),
                answers.reload(host),
            ),
            None if ecosystem.daemons.len() > 1 => check.problem(
                format!("{names} of the file: no daemon hosts them, for want of the key `daemon`:"),
                subject.check_command(),
            ),
            None => check.problem(format!("{names} of the file: absent"), None),
        }
    };
    of_daemon.into_iter().map(problem).collect()
}

/// Judges which agents are absent according to the daemons, which have read the ecosystem file.
fn reported_absent(answers: &EcosystemAnswers, here: &BTreeSet<&AgentId>) -> Vec<CheckFinding> {
    let check = DoctorCheck::Agents;
    let absent = answers.reports.iter().flat_map(|report| &report.absent);
    let absent: BTreeSet<_> = absent.filter(|absent| !here.contains(&absent.agent)).collect();
    if absent.is_empty() {
        return vec![check.ok(format!("{} are present", here.len()))];
    }
    let mut of_daemon: BTreeMap<Option<&DaemonId>, Vec<&str>> = BTreeMap::new();
    for AbsentAgent { agent, daemons } in absent {
        of_daemon.entry(daemons.first()).or_default().push(agent.as_str());
    }
    let problem = |(daemon, agents): (Option<&DaemonId>, Vec<&str>)| {
        let names = names(agents);
        let on = daemon.map(|daemon| format!(", which `{daemon}` is to host")).unwrap_or_default();
        check.problem(format!("{names} of the daemons' file: absent{on}"), None)
    };
    of_daemon.into_iter().map(problem).collect()
}

fn versions(
    subject: &DoctorSubject,
    answers: &EcosystemAnswers,
    present: &BTreeSet<DaemonId>,
) -> Vec<CheckFinding> {
    let check = DoctorCheck::Versions;
    let look = || Remedy::look(format!("althing agents{}", subject.words()));
    let mut findings = Vec::new();
    for (agent, problems) in &answers.models.unreadable {
        let text = format!("`{agent}` speaks another version: {}", problems.join("; "));
        findings.push(check.problem(text, look()));
    }
    for report in answers.reports.iter().filter(|report| report.version != VERSION) {
        let (daemon, version) = (&report.daemon, &report.version);
        let text = format!("`{daemon}` runs version {version}, this program {VERSION}");
        findings.push(check.note(text, None));
    }
    let told: BTreeSet<_> = answers.reports.iter().map(|report| &report.daemon).collect();
    for daemon in present.iter().filter(|daemon| !told.contains(daemon)) {
        let text = format!("`{daemon}` does not say its version: it is an older one");
        findings.push(check.note(text, None));
    }
    if findings.is_empty() {
        findings.push(check.ok(format!("all run version {VERSION}")));
    }
    findings
}

/// Judges the certificates that daemons use now, wherever they run.
fn certificates(subject: &DoctorSubject, answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let check = DoctorCheck::DaemonCertificates;
    let security = subject.ecosystem.as_ref().and_then(|ecosystem| ecosystem.security.as_ref());
    let warn_days = security.map_or(WARN_DAYS, |it| it.warn_before.as_secs() / DAY_SECONDS);
    let of_ecosystem = subject.ecosystem_words();
    let mut findings = Vec::new();
    for report in &answers.reports {
        let Some(days) = report.certificate_days_left.filter(|days| *days <= warn_days) else {
            continue;
        };
        let daemon = &report.daemon;
        let left = plural(usize::try_from(days).unwrap_or(usize::MAX), "day");
        let text = format!(
            "`{daemon}` uses a certificate that ends in {left}; after a new one, restart it:"
        );
        let renew = Remedy::mend(format!("althing cert daemon {daemon}{of_ecosystem}"));
        findings.push(match days {
            0 => check.problem(text, renew),
            _ => check.note(text, renew),
        });
    }
    if findings.is_empty() {
        let is_secured = answers.reports.iter().any(|it| it.certificate_days_left.is_some());
        findings.push(check.ok(match is_secured {
            true => "the certificates of all daemons are valid",
            false => "the daemons use no certificates",
        }));
    }
    findings
}

/// Judges whether a daemon has nearly as many files open as it may.
fn open_files(answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let check = DoctorCheck::DaemonFiles;
    let near = answers.reports.iter().filter_map(|report| {
        let (open, most) = report.open_files.zip(report.open_files_max)?;
        // Four fifths: a wave of commands takes the rest.
        (open.saturating_mul(5) >= most.saturating_mul(4)).then_some((&report.daemon, open, most))
    });
    let mut findings: Vec<_> = near
        .map(|(daemon, open, most)| {
            let text = format!(
                "`{daemon}` has {open} of {most} files open; beyond, it accepts no connection \
                 (in a service: LimitNOFILE)"
            );
            check.problem(text, local_limit(answers, daemon, most))
        })
        .collect();
    if findings.is_empty() {
        findings.push(check.ok("no daemon is near its limit of open files"));
    }
    findings
}

/// Returns the command that doubles the limit of a daemon of this machine; `None` for others.
fn local_limit(answers: &EcosystemAnswers, daemon: &DaemonId, most: u64) -> Option<Remedy> {
    let here = answers.local.iter().find(|local| local.name == daemon.as_str());
    let (process, more) = (here?.process?, most.saturating_mul(2));
    Remedy::mend(format!("sudo prlimit --pid {process} --nofile={more}:{more}"))
}

/// Judges the digests of the domain and the map that daemons have read.
fn files(subject: &DoctorSubject, answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let check = DoctorCheck::Files;
    let Some(first) = answers.digests.first() else { return Vec::new() };
    let expected = match &subject.ecosystem {
        Some(ecosystem) => FileDigests::of(first.digests.daemon.clone(), ecosystem),
        None => first.digests.clone(),
    };
    let against = match &subject.file {
        Some(file) => file.display().to_string(),
        None => format!("`{}`", first.digests.daemon),
    };
    let mut findings = Vec::new();
    for report in &answers.digests {
        let FileDigests { daemon, domain, map } = &report.digests;
        let parts = [("domain", domain, &expected.domain), ("map", map, &expected.map)];
        let differing: Vec<_> =
            parts.iter().filter(|(_, read, there)| read != there).map(|(what, ..)| *what).collect();
        if !differing.is_empty() {
            let text = format!(
                "`{daemon}` has read another {} than {against}: agents decline plans of others; \
                 to read the same file again:",
                differing.join(" and ")
            );
            findings.push(check.problem(text, answers.reload(daemon)));
        }
    }
    if findings.is_empty() {
        findings.push(check.ok("all daemons have read the same domain and map"));
    }
    findings
}

fn clocks(answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let check = DoctorCheck::Clocks;
    let mut findings = Vec::new();
    for reading in &answers.clocks {
        let how = clock_difference(reading.is_ahead, reading.difference);
        let text = format!("the clock of `{}` is {how} of this machine's", reading.daemon);
        match reading.difference {
            difference if difference >= CLOCK_PROBLEM => {
                let mend = Remedy::mend("sudo timedatectl set-ntp true");
                findings.push(check.problem(format!("{text}; on both machines:"), mend));
            }
            difference if difference >= CLOCK_NOTE => findings.push(check.note(text, None)),
            _ => (),
        }
    }
    if findings.is_empty() && !answers.clocks.is_empty() {
        findings.push(check.ok("the clocks of all daemons agree to a second"));
    }
    findings
}

#[cfg(test)]
mod tests {
    use acl::content::DaemonReport;
    use rustix::process::Pid;

    use super::*;
    use crate::commands::doctor::finding::CheckVerdict;
    use crate::commands::doctor::running::{ClockReading, LocalDaemon};

    fn answers(clocks: Vec<ClockReading>) -> EcosystemAnswers {
        EcosystemAnswers {
            residents: BTreeSet::new(),
            digests: Vec::new(),
            reports: Vec::new(),
            mailboxes: [Vec::new(), Vec::new()],
            models: Default::default(),
            plugins: Vec::new(),
            stops: Vec::new(),
            questions: Vec::new(),
            clocks,
            local: Vec::new(),
        }
    }

    fn report(days: u64, open: u64) -> DaemonReport {
        DaemonReport {
            daemon: DaemonId::new("hall").expect("a name"),
            version: "0.0.7".to_owned(),
            uptime: acl::Millis(Duration::ZERO),
            agents: 1,
            leads: Vec::new(),
            stands_by: Vec::new(),
            absent: Vec::new(),
            certificate_days_left: Some(days),
            memory_bytes: None,
            open_files: Some(open),
            open_files_max: Some(1_000),
        }
    }

    #[test]
    fn without_a_file_daemons_tell_which_agents_are_absent() {
        let lamp = AgentId::new("lamp").expect("a name");
        let kitchen = DaemonId::new("kitchen").expect("a name");
        let absent = vec![AbsentAgent { agent: lamp, daemons: vec![kitchen] }];
        let reports = vec![DaemonReport { absent, ..report(90, 1) }, report(90, 1)];
        let told = EcosystemAnswers { reports, ..answers(Vec::new()) };
        let found = agents(&DoctorSubject::default(), &told, &BTreeSet::new());
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].verdict, CheckVerdict::Problem);
        let expected = "`lamp` of the daemons' file: absent, which `kitchen` is to host";
        assert_eq!(found[0].text, expected);
        let told = EcosystemAnswers { reports: vec![report(90, 1)], ..answers(Vec::new()) };
        let found = agents(&DoctorSubject::default(), &told, &BTreeSet::new());
        assert_eq!(found[0].verdict, CheckVerdict::Ok);
    }

    #[test]
    fn a_daemon_tells_of_its_certificate_and_its_open_files() {
        let told = |days, open| EcosystemAnswers {
            reports: vec![report(days, open)],
            local: vec![LocalDaemon { name: "hall".to_owned(), process: Pid::from_raw(7) }],
            ..answers(Vec::new())
        };
        let verdict = |days, open| open_files(&told(days, open))[0].verdict;
        assert_eq!((verdict(90, 799), verdict(90, 800)), (CheckVerdict::Ok, CheckVerdict::Problem));
        let full = open_files(&told(90, 990));
        let more = Remedy::mend("sudo prlimit --pid 7 --nofile=2000:2000");
        assert_eq!(full[0].remedy, more);
        let subject = DoctorSubject::default();
        let verdict = |days| certificates(&subject, &told(days, 1))[0].verdict;
        assert_eq!(verdict(31), CheckVerdict::Ok);
        assert_eq!(verdict(30), CheckVerdict::Note);
        assert_eq!(verdict(0), CheckVerdict::Problem);
        let present = [DaemonId::new("hall").expect("a name")].into();
        let other = versions(&subject, &told(90, 1), &present);
        assert!(other[0].text.contains("runs version 0.0.7"), "{other:?}");
    }

    #[test]
    fn a_clock_that_differs_is_a_note_and_then_a_problem() {
        let reading = |seconds| ClockReading {
            daemon: DaemonId::new("hall").expect("a name"),
            difference: Duration::from_secs(seconds),
            is_ahead: false,
        };
        let verdict = |seconds| clocks(&answers(vec![reading(seconds)]))[0].verdict;
        assert_eq!(verdict(0), CheckVerdict::Ok);
        assert_eq!(verdict(5), CheckVerdict::Note);
        assert_eq!(verdict(3_600), CheckVerdict::Problem);
        let told = clocks(&answers(vec![reading(7_200)]));
        assert!(told[0].text.contains("`hall` is 2 h behind of this"), "{told:?}");
    }
}
