//! `althing doctor`: what is wrong with this machine or ecosystem, and the command that mends it.
//!
//! - [`machine`], [`folders`] and [`network`] examine the machine, and [`needs`] what the agents of
//!   this machine need of it. Each of these checks runs in a thread of its own, because a file
//!   system that hangs must not keep the others from being printed.
//! - [`mod@file`] examines the ecosystem file, its certificates and its people.
//! - [`running`] links to the running ecosystem; [`members`], [`traffic`] and [`people`] judge its
//!   answers.
//! - [`finding`] has the list of all checks.

mod file;
mod finding;
mod folders;
mod machine;
mod members;
mod needs;
mod network;
mod people;
mod running;
mod subject;
mod traffic;

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use terminal::styled::Styled;
use terminal::{exit, output};

use crate::cli::doctor::DoctorArgs;
use finding::{CheckFinding, CheckVerdict, DoctorCheck, summary};
use subject::DoctorSubject;

/// Exit code if there is a problem.
const PROBLEM: u8 = 1;

/// How long the checks of the machine may take. They run side by side.
const CHECKED_WITHIN: Duration = Duration::from_secs(10);

/// How long reading the ecosystem file may take, with the building of its agents.
const READ_WITHIN: Duration = Duration::from_secs(60);

/// Runs `althing doctor`: examines the machine, the file and the running ecosystem.
pub(super) fn run(args: &DoctorArgs) -> ExitCode {
    let json = args.print.json;
    let subject = match read_subject(args) {
        Ok(subject) => subject,
        Err(problem) => return super::wrong(&problem, json),
    };
    let mut findings = examine_machine(&subject);
    if let Some(path) = &subject.file {
        findings.extend(file::mistakes(path, &subject.report));
        let of_file = Arc::clone(&subject);
        let check = DoctorCheck::Certificates;
        let certificates = start(check, move || file::certificates(&of_file));
        let of_file = Arc::clone(&subject);
        let people = start(DoctorCheck::People, move || file::people(&of_file));
        let deadline = Instant::now() + CHECKED_WITHIN;
        findings.extend(await_check(&certificates, deadline));
        findings.extend(await_check(&people, deadline));
    }
    findings.extend(running::examine(&subject));
    findings.sort_by_key(|finding| finding.check);
    print(&subject, &findings, json)
}

/// Finds the ecosystem that is examined, and reads its file.
fn read_subject(args: &DoctorArgs) -> Result<Arc<DoctorSubject>, String> {
    let (tell, told) = mpsc::channel();
    let args = args.clone();
    // The thread ends with the process if the file system hangs.
    std::thread::spawn(move || tell.send(DoctorSubject::find(&args).map(Arc::new)));
    match told.recv_timeout(READ_WITHIN) {
        Ok(found) => found,
        Err(_) => Err(format!("failed to read the ecosystem file within {READ_WITHIN:?}")),
    }
}

/// A check that runs in a thread of its own.
struct StartedCheck {
    check: DoctorCheck,
    findings: Receiver<Vec<CheckFinding>>,
}

fn start(
    check: DoctorCheck,
    examine: impl FnOnce() -> Vec<CheckFinding> + Send + 'static,
) -> StartedCheck {
    let (tell, findings) = mpsc::channel();
    // The thread ends with the process if its check hangs.
    std::thread::spawn(move || tell.send(examine()));
    StartedCheck { check, findings }
}

fn await_check(started: &StartedCheck, deadline: Instant) -> Vec<CheckFinding> {
    let StartedCheck { check, findings } = started;
    let left = deadline.saturating_duration_since(Instant::now());
    match findings.recv_timeout(left) {
        Ok(findings) => findings,
        Err(RecvTimeoutError::Timeout) => {
            let text = format!("not done within {CHECKED_WITHIN:?}: a disk or a program hangs");
            vec![check.problem(text, None)]
        }
        Err(RecvTimeoutError::Disconnected) => {
            vec![check.problem("the check failed; this is a mistake of this program", None)]
        }
    }
}

fn examine_machine(subject: &Arc<DoctorSubject>) -> Vec<CheckFinding> {
    let of = |examine: fn(&DoctorSubject) -> Vec<CheckFinding>| {
        let subject = Arc::clone(subject);
        move || examine(&subject)
    };
    let started = [
        start(DoctorCheck::RuntimeFolder, of(|it| folders::runtime(it.name.as_ref(), it.daemon()))),
        start(DoctorCheck::StateFolder, of(|it| folders::state(it.name.as_ref(), it.daemon()))),
        start(DoctorCheck::PluginsFolder, of(|it| folders::plugins(it.plugins_folder()))),
        start(DoctorCheck::Disk, of(|_| folders::disk())),
        start(DoctorCheck::Clock, of(|_| machine::clock())),
        start(DoctorCheck::ClockSync, of(|_| machine::clock_sync())),
        start(DoctorCheck::Memory, of(|_| machine::memory())),
        start(DoctorCheck::OpenFiles, of(|_| machine::open_files())),
        start(DoctorCheck::Multicast, of(|it| network::multicast(it.ecosystem.as_deref()))),
        start(
            DoctorCheck::Ports,
            of(|it| if_read(it, DoctorCheck::Ports, |it| network::ports(it.ecosystem.as_deref()))),
        ),
        start(
            DoctorCheck::Programs,
            of(|it| if_read(it, DoctorCheck::Programs, |it| needs::programs(it.agents()))),
        ),
        start(
            DoctorCheck::Devices,
            of(|it| if_read(it, DoctorCheck::Devices, |it| needs::devices(it.agents()))),
        ),
    ];
    let deadline = Instant::now() + CHECKED_WITHIN;
    started.iter().flat_map(|check| await_check(check, deadline)).collect()
}

/// Runs a check of what the file asks of the machine. A file with mistakes leaves that unknown.
fn if_read(
    subject: &DoctorSubject,
    check: DoctorCheck,
    examine: fn(&DoctorSubject) -> Vec<CheckFinding>,
) -> Vec<CheckFinding> {
    match subject.is_unread() {
        true => vec![check.note("not examined: the ecosystem file has mistakes", None)],
        false => examine(subject),
    }
}

fn print(subject: &DoctorSubject, findings: &[CheckFinding], json: bool) -> ExitCode {
    let count = |verdict| findings.iter().filter(|finding| finding.verdict == verdict).count();
    let (problems, notes) = (count(CheckVerdict::Problem), count(CheckVerdict::Note));
    let code = if problems == 0 { exit::DONE } else { PROBLEM };
    if json {
        let checks: Vec<Value> = findings.iter().map(CheckFinding::json).collect();
        let value = json!({
            "status": if problems == 0 { "ok" } else { "problems" },
            "ecosystem": subject.name,
            "problems": problems,
            "notes": notes,
            "checks": checks,
        });
        return output::print_json(&value, code);
    }
    let mut text = Styled::default();
    let mut area = None;
    for finding in findings {
        let this = finding.check.area();
        if area.replace(this) != Some(this) {
            text = text.and_styled(&Styled::line(this.as_str()).end());
        }
        text = text.and_styled(&finding.lines());
    }
    let last = Styled::line(summary(problems, notes).trim_end()).end();
    output::print_styled(&text.and_styled(&last), code)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_that_hangs_or_fails_is_a_problem() {
        let (keep, hangs) = mpsc::channel::<()>();
        let hanging = start(DoctorCheck::Disk, move || {
            let _ = hangs.recv();
            Vec::new()
        });
        let found = await_check(&hanging, Instant::now());
        assert_eq!(found[0].verdict, CheckVerdict::Problem);
        assert!(found[0].text.contains("not done within"), "{found:?}");
        drop(keep);
        let failing = start(DoctorCheck::Disk, || panic!("a mistake"));
        let found = await_check(&failing, Instant::now() + CHECKED_WITHIN);
        assert!(found[0].text.contains("the check failed"), "{found:?}");
        let right = start(DoctorCheck::Disk, || vec![DoctorCheck::Disk.ok("fine")]);
        let found = await_check(&right, Instant::now() + CHECKED_WITHIN);
        assert_eq!(found, [DoctorCheck::Disk.ok("fine")]);
    }
}
