//! Checks of the ecosystem file, of the certificates that it needs, and of the file of its people.

use std::path::Path;

use accounts::{AccountsError, PeopleFile};
use terminal::render::plural;
use terminal::report::{DiagnosticReport, SourcedDiagnostic};

use super::finding::{CheckFinding, DoctorCheck, Remedy};
use super::subject::DoctorSubject;
use crate::commands::cert;
use crate::commands::client::shell_word;
use crate::config::{Ecosystem, Overrides, ParsedEcosystem};
use crate::review::{self, ReviewScope};
use crate::{interfacing, plugins};

/// Maximum number of mistakes that are shown; `althing check` shows all.
const MISTAKES_SHOWN_MAX: usize = 3;

/// Reads an ecosystem file; returns what can be understood of it, and its mistakes.
pub(super) fn read(path: &Path) -> (Option<Ecosystem>, DiagnosticReport) {
    let known = plugins::known();
    let reading = Ecosystem::read(path, &Overrides::default(), &known);
    let mut report = review::review(&reading, ReviewScope::Everything);
    let ParsedEcosystem { ecosystem, .. } = reading;
    if let Some(ecosystem) = ecosystem.as_ref().filter(|_| !report.has_errors()) {
        report.extend(interfacing::check(ecosystem, &known));
    }
    (ecosystem, report)
}

/// Returns the findings about a file with these mistakes.
pub(super) fn mistakes(path: &Path, report: &DiagnosticReport) -> Vec<CheckFinding> {
    let check = DoctorCheck::EcosystemFile;
    let shown = path.display();
    if report.is_empty() {
        return vec![check.ok(format!("{shown} has no mistake"))];
    }
    let look = || Remedy::look(format!("althing check {}", shell_word(&path.to_string_lossy())));
    let (errors, warnings): (Vec<_>, Vec<_>) =
        report.findings().iter().partition(|found| found.diagnostic.is_error());
    let mut findings: Vec<_> = errors
        .iter()
        .take(MISTAKES_SHOWN_MAX)
        .map(|found| check.problem(located(found), look()))
        .collect();
    if let Some(more) = errors.len().checked_sub(MISTAKES_SHOWN_MAX).filter(|more| *more > 0) {
        let text = format!("{shown} has {} more", plural(more, "error"));
        findings.push(check.problem(text, look()));
    }
    if !warnings.is_empty() {
        let first = warnings.first().map(|found| located(found)).unwrap_or_default();
        let text = format!("{}, the first: {first}", plural(warnings.len(), "warning"));
        findings.push(check.note(text, look()));
    }
    findings
}

/// Returns a mistake with its file, line and column.
fn located(found: &SourcedDiagnostic) -> String {
    let SourcedDiagnostic { source, diagnostic } = found;
    match source {
        Some(source) => {
            let (line, column) = source.line_column(diagnostic.span);
            format!("{}:{line}:{column}: {}", source.name, diagnostic.message)
        }
        None => diagnostic.message.clone(),
    }
}

/// Checks the certificates of a secured ecosystem that are on this machine.
pub(super) fn certificates(subject: &DoctorSubject) -> Vec<CheckFinding> {
    let check = DoctorCheck::Certificates;
    let Some(ecosystem) = &subject.ecosystem else { return Vec::new() };
    let Some(security) = &ecosystem.security else {
        let of_page = page_certificate(subject);
        let none = || vec![check.ok("the ecosystem is not secured, so it needs none")];
        return if of_page.is_empty() { none() } else { of_page };
    };
    let words = subject.ecosystem_words();
    let survey = match cert::survey(security) {
        Ok(survey) => survey,
        Err(error) => {
            let remedy = match security.folder.join("authority.pem").exists() {
                true => Remedy::look(format!("althing cert show{words}")),
                false => Remedy::mend(format!("althing cert authority {}", subject.file_word())),
            };
            return vec![check.problem(format!("failed to {error}"), remedy)];
        }
    };
    let own = subject.part.as_ref().map(|part| part.daemon.as_str());
    let mut findings = Vec::new();
    if let Some(own) = own.filter(|own| !survey.iter().any(|each| each.subject == **own)) {
        let folder = security.folder.display();
        let text = format!("`{own}`, the daemon of this machine, has no certificate in {folder}");
        findings
            .push(check.problem(text, Remedy::mend(format!("althing cert daemon {own}{words}"))));
    }
    let mends = |subject: &str, is_daemon: bool| match is_daemon {
        true => Remedy::mend(format!("althing cert daemon {}{words}", shell_word(subject))),
        // A new authority needs new certificates everywhere, so no single command is enough.
        false => Remedy::look(format!("althing cert show{words}")),
    };
    for each in &survey {
        let (name, days) = (&each.subject, each.days_left);
        // A newer certificate of the same daemon replaces one that has ended.
        let is_replaced = survey
            .iter()
            .any(|other| other.subject == *name && other.state == "good" && each.state != "good");
        match each.state {
            _ if is_replaced => (),
            "good" => (),
            "ends" => findings.push(check.note(
                format!("the certificate of `{name}` ends in {}", plural(days, "day")),
                mends(name, each.is_daemon),
            )),
            state => findings.push(check.problem(
                format!("the certificate of `{name}` is {state}: the others reject its messages"),
                mends(name, each.is_daemon),
            )),
        }
    }
    findings.extend(page_certificate(subject));
    if findings.is_empty() {
        findings.push(check.ok(format!("{} are valid", plural(survey.len(), "certificate"))));
    }
    findings
}

/// Checks the certificate of the page, if the daemon of this machine serves one by TLS. A valid one is
/// no finding.
#[cfg(feature = "web")]
fn page_certificate(subject: &DoctorSubject) -> Vec<CheckFinding> {
    use crate::web::certificate::{WARN_BEFORE, days_left, files};

    let check = DoctorCheck::Certificates;
    let (Some(ecosystem), Some(part)) = (&subject.ecosystem, &subject.part) else {
        return Vec::new();
    };
    if !serves_page(subject, ecosystem) {
        return Vec::new();
    }
    let Ok(Some(files)) = files(ecosystem, &part.daemon) else { return Vec::new() };
    let (daemon, words) = (shell_word(part.daemon.as_str()), subject.ecosystem_words());
    // The authority of the ecosystem does not make the certificates that a file names.
    let is_own = ecosystem.web.as_ref().is_some_and(|web| web.files.is_some());
    let renew = (!is_own).then(|| Remedy::Mend(format!("althing cert page {daemon}{words}")));
    let end = match web_page::certificate_end(&files) {
        Ok(end) => end,
        Err(error) => return vec![check.problem(format!("no page: failed to {error}"), renew)],
    };
    let path = files.certificate.display();
    let warned = ecosystem.security.as_ref().map(|security| security.warn_before);
    let soon = std::time::SystemTime::now() + warned.unwrap_or_default().max(WARN_BEFORE);
    match end.map(|end| (end, days_left(end))) {
        None => Vec::new(),
        Some((_, None)) => {
            let text = format!("the certificate of the page, {path}, has ended: it is not served");
            vec![check.problem(text, renew)]
        }
        Some((end, Some((_, left)))) if end <= soon => {
            let text = format!("the certificate of the page, {path}, ends in {left}");
            vec![check.note(text, renew)]
        }
        Some(_) => Vec::new(),
    }
}

/// Without pages there is no certificate of one.
#[cfg(not(feature = "web"))]
fn page_certificate(_: &DoctorSubject) -> Vec<CheckFinding> {
    Vec::new()
}

/// Checks whether the file of people can be read by the daemon, and by no other user.
pub(super) fn people(subject: &DoctorSubject) -> Vec<CheckFinding> {
    let check = DoctorCheck::People;
    let Some(ecosystem) = &subject.ecosystem else { return Vec::new() };
    let file = PeopleFile::new(&ecosystem.people);
    let shown = file.path().display();
    if let Some(mode) = file.loose_mode() {
        // Hashes of passwords can be guessed at by those that read them.
        let text = format!("others can read or write {shown} (mode {mode:03o})");
        let path = shell_word(&file.path().to_string_lossy());
        return vec![check.problem(text, Remedy::mend(format!("chmod 600 {path}")))];
    }
    let look = || Remedy::look(format!("althing check {}", subject.file_word()));
    match file.read() {
        Ok(people) if people.is_empty() && serves_page(subject, ecosystem) => {
            let words = subject.ecosystem_words();
            let text = "this daemon serves a page, and no person can sign in: there are none";
            vec![check.problem(text, Remedy::mend(format!("althing people add NAME{words}")))]
        }
        Ok(people) if people.is_empty() => vec![check.ok("no person can sign in: there are none")],
        Ok(people) => vec![check.ok(match people.len() {
            1 => "1 person can sign in".to_owned(),
            count => format!("{count} people can sign in"),
        })],
        Err(AccountsError::Io { source, .. })
            if source.kind() == std::io::ErrorKind::PermissionDenied =>
        {
            vec![check.note(format!("not examined: this user may not read {shown}"), None)]
        }
        Err(error) => vec![check.problem(format!("failed to {error}"), look())],
    }
}

/// Whether the daemon of this machine serves a page; without a daemon of the file here, whether any
/// does.
fn serves_page(subject: &DoctorSubject, ecosystem: &Ecosystem) -> bool {
    let own = subject.part.as_ref().map(|part| &part.daemon);
    ecosystem.web.as_ref().is_some_and(|web| own.is_none_or(|own| web.is_served_by(own)))
}
