//! `althing cert`: manages the authority of an ecosystem, and the certificates of its daemons.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::SystemTime;

use acl::{DaemonId, EcosystemId};
use credentials::{
    Authority, Certificate, CredentialError, CredentialFolder, PageAuthority, Trust,
};
use serde_json::json;
use terminal::output::Color;
use terminal::styled::Styled;
use terminal::{exit, output};

use crate::cli::cert::{
    CertArgs, CertAuthorityArgs, CertCommand, CertDaemonArgs, CertPageArgs, CertPlaceArgs,
    CertRevokeArgs, CertShowArgs,
};
use crate::config::{self, Ecosystem, Overrides, SecuritySettings, credentials_folder};
use crate::plugins;

const DAY_SECONDS: u64 = 24 * 3_600;

/// How many days before its expiry a certificate is reported as expiring, if no ecosystem file sets
/// the number.
const WARN_DAYS: u64 = 30;

/// An ecosystem, and the folder of its certificates.
struct CertificateFolder {
    name: EcosystemId,
    /// The ecosystem as its file defines it; `None` if there is no ecosystem file.
    ecosystem: Option<Ecosystem>,
    folder: CredentialFolder,
}

/// Runs `althing cert`: creates an authority or certificates, lists them, or revokes them.
pub(super) fn run(args: &CertArgs) -> ExitCode {
    match &args.command {
        CertCommand::Authority(args) => authority(args),
        CertCommand::Daemon(args) => daemon(args),
        CertCommand::Page(args) => page(args),
        CertCommand::Show(args) => show(args),
        CertCommand::Revoke(args) => revoke(args),
    }
}

fn authority(args: &CertAuthorityArgs) -> ExitCode {
    let json = args.print.json;
    let place = match CertificateFolder::find(args.ecosystem.as_deref(), args.folder.as_ref()) {
        Ok(place) => place,
        Err(problem) => return super::wrong(&format!("failed to {problem}"), json),
    };
    let made = match Authority::create(&place.folder, &place.name, args.days) {
        Ok(made) => made,
        Err(error) => return failed(&error, json),
    };
    let folder = place.folder.path().display();
    if json {
        let value = json!({ "folder": folder.to_string(), "days_left": days(made.certificate()) });
        return output::print_json(&value, exit::DONE);
    }
    let mut text = format!("made the authority of `{}` in {folder}\n", place.name);
    let is_secured = place.ecosystem.as_ref().is_some_and(|each| each.security.is_some());
    if !is_secured {
        let _ = writeln!(text, "Secure the ecosystem by a line in its file: [security]");
    }
    text += "Make a certificate for each daemon: althing cert daemon NAME...\n";
    text += "Keep authority.key secret, and a copy in a safe place.\n";
    output::print(text, exit::DONE)
}

/// Returns the folder of the certificates, and the daemons of these names.
fn place_and_names(
    place: &CertPlaceArgs,
    names: &[String],
) -> Result<(CertificateFolder, Vec<DaemonId>), String> {
    let place = CertificateFolder::of(place).map_err(|problem| format!("failed to {problem}"))?;
    let names: Result<Vec<_>, _> = names.iter().map(|name| DaemonId::new(name)).collect();
    Ok((place, names.map_err(|error| error.to_string())?))
}

fn daemon(args: &CertDaemonArgs) -> ExitCode {
    let json = args.print.json;
    let (place, names) = match place_and_names(&args.place, &args.names) {
        Ok(found) => found,
        Err(problem) => return super::wrong(&problem, json),
    };
    let made: Result<Vec<_>, _> = Authority::open(&place.folder).and_then(|authority| {
        names.iter().map(|name| authority.issue(name, &args.hosts, args.days)).collect()
    });
    let made: Vec<Certificate> = match made {
        Ok(made) => made,
        Err(error) => return failed(&error, json),
    };
    for name in &names {
        place.warn_of_stranger(name);
    }
    if json {
        let made: Vec<_> = made.iter().map(|each| object(each, "good")).collect();
        return output::print_json(&json!({ "certificates": made }), exit::DONE);
    }
    let folder = place.folder.path().display();
    let mut text = String::new();
    for name in &names {
        let _ = writeln!(text, "made {folder}/{name}.pem and {name}.key, for {} days", args.days);
    }
    let _ = writeln!(
        text,
        "Copy to each machine over an encrypted channel: authority.pem, NAME.pem, NAME.key"
    );
    output::print(text, exit::DONE)
}

/// Makes the certificates of pages, and at first the page authority.
fn page(args: &CertPageArgs) -> ExitCode {
    let json = args.print.json;
    let (place, names) = match place_and_names(&args.place, &args.names) {
        Ok(found) => found,
        Err(problem) => return super::wrong(&problem, json),
    };
    let folder = PageAuthority::folder(&place.folder);
    let known = place.ecosystem.iter().flat_map(|ecosystem| &ecosystem.daemons);
    let daemons: Vec<_> = names.iter().chain(known).cloned().collect();
    let opened = PageAuthority::open_or_create(&folder, &place.name, &daemons, &args.hosts);
    let made = opened.and_then(|(authority, is_new)| {
        let issue = |name| authority.issue(name, &args.hosts, args.days);
        Ok((names.iter().map(issue).collect::<Result<Vec<_>, _>>()?, is_new))
    });
    let (made, is_new) = match made {
        Ok(made) => made,
        Err(error) => return failed(&error, json),
    };
    names.iter().for_each(|name| place.warn_of_stranger(name));
    if json {
        let made: Vec<_> = made.iter().map(|each| object(each, "good")).collect();
        let value = json!({
            "certificates": made, "folder": folder.path(), "authority": folder.authority(),
            "authority_is_new": is_new,
        });
        return output::print_json(&value, exit::DONE);
    }
    let mut text = String::new();
    for (name, each) in names.iter().zip(&made) {
        let (path, hosts) = (folder.path().display(), each.hosts.join(", "));
        let _ = writeln!(text, "made {path}/{name}.pem and {name}.key, for {} days", args.days);
        let _ = writeln!(text, "  browsers may open it as {hosts}");
    }
    let authority = folder.authority();
    if is_new {
        let _ = writeln!(text, "Phones have to trust {} once: docs/web.md", authority.display());
        text += "Keep authority.key beside it secret, and a copy in a safe place.\n";
    }
    output::print(text, exit::DONE)
}

fn show(args: &CertShowArgs) -> ExitCode {
    let json = args.print.json;
    let place = match CertificateFolder::of(&args.place) {
        Ok(place) => place,
        Err(problem) => return super::wrong(&format!("failed to {problem}"), json),
    };
    let trust = match Trust::read(&place.folder) {
        Ok(trust) => trust,
        Err(error) => return failed(&error, json),
    };
    let warn_days = place.warn_days();
    let shown: Vec<(Certificate, &str)> = certificates(&place.folder, &trust)
        .into_iter()
        .map(|each| {
            let state = state(&each, &trust, warn_days);
            (each, state)
        })
        .collect();
    if json {
        let shown: Vec<_> = shown.iter().map(|(each, state)| object(each, state)).collect();
        let value = json!({ "folder": place.folder.path(), "certificates": shown });
        return output::print_json(&value, exit::DONE);
    }
    let head = format!("{:<30} {:>9} {:<8} HOSTS", "NAME", "DAYS LEFT", "STATE");
    let mut text = vec![Styled::line(&head).end()];
    for (certificate, state) in &shown {
        let color = match *state {
            "good" => Color::Green,
            "ends" => Color::Yellow,
            _ => Color::Red,
        };
        // Padded before it is coloured, because colour codes count as characters.
        let state = Styled::painted(color, &format!("{state:<8}"));
        let line = format!("{:<30} {:>9} ", certificate.subject, days(certificate));
        let hosts = format!(" {}", certificate.hosts.join(", "));
        text.push(Styled::line(&line).and_styled(&state).and(hosts.trim_end()).end());
    }
    output::print_styled(&text.into_iter().collect(), exit::DONE)
}

fn revoke(args: &CertRevokeArgs) -> ExitCode {
    let json = args.print.json;
    let place = match CertificateFolder::of(&args.place) {
        Ok(place) => place,
        Err(problem) => return super::wrong(&format!("failed to {problem}"), json),
    };
    let name = match DaemonId::new(&args.name) {
        Ok(name) => name,
        Err(error) => return super::wrong(&error.to_string(), json),
    };
    let revoked = Authority::open(&place.folder).and_then(|authority| authority.revoke(&name));
    let count = match revoked {
        Ok(count) => count,
        Err(error) => return failed(&error, json),
    };
    let list = place.folder.revocations();
    if json {
        let value = json!({ "revoked": name, "certificates": count, "list": list });
        return output::print_json(&value, exit::DONE);
    }
    let certificates = match count {
        0 => "all certificates were revoked before".to_owned(),
        1 => "1 certificate".to_owned(),
        count => format!("{count} certificates"),
    };
    let text = format!(
        "revoked `{name}`: {certificates}\n\
         Daemons that read this folder tell all others within seconds. If none reads it, copy\n\
         {} into the folder of any daemon.\n",
        list.display()
    );
    output::print(text, exit::DONE)
}

// === impl CertificateFolder ===

impl CertificateFolder {
    fn of(args: &CertPlaceArgs) -> Result<CertificateFolder, String> {
        CertificateFolder::find(args.ecosystem.as_deref(), args.folder.as_ref())
    }

    /// Finds the ecosystem and the folder of its certificates. The error text completes the
    /// sentence “failed to …”.
    fn find(asked: Option<&str>, folder: Option<&PathBuf>) -> Result<CertificateFolder, String> {
        let file = match asked {
            None => config::find_ecosystem_file(),
            Some(asked) => match config::resolve_ecosystem(asked) {
                Ok(file) => Some(file),
                Err(problem) => match EcosystemId::new(asked) {
                    // A name is enough: the file may be on another machine.
                    Ok(name) => return Ok(CertificateFolder::named(name, None, folder)),
                    Err(_) => return Err(problem),
                },
            },
        };
        match file {
            Some(file) => {
                let loaded = Ecosystem::load(&file, &Overrides::default(), &plugins::known());
                let ecosystem = loaded.map_err(|error| {
                    output::show_to_person(&error.into_report());
                    format!("read {}", file.display())
                })?;
                Ok(CertificateFolder::named(ecosystem.name.clone(), Some(ecosystem), folder))
            }
            None => match folder {
                // If the folder is given, the name of the ecosystem does not matter.
                Some(_) => {
                    let name = EcosystemId::new("ecosystem").map_err(|error| error.to_string())?;
                    Ok(CertificateFolder::named(name, None, folder))
                }
                None => {
                    Err("choose an ecosystem: there is no althing.toml here; name its file"
                        .to_owned())
                }
            },
        }
    }

    fn named(
        name: EcosystemId,
        ecosystem: Option<Ecosystem>,
        folder: Option<&PathBuf>,
    ) -> CertificateFolder {
        let said = ecosystem.as_ref().and_then(|ecosystem| ecosystem.security.as_ref());
        let said = said.map(|security| security.folder.clone());
        let folder = folder.cloned().or(said).unwrap_or_else(|| credentials_folder(&name));
        CertificateFolder { name, ecosystem, folder: CredentialFolder::new(folder) }
    }

    fn warn_days(&self) -> u64 {
        let security = self.ecosystem.as_ref().and_then(|each| each.security.as_ref());
        security.map_or(WARN_DAYS, |security| security.warn_before.as_secs() / DAY_SECONDS)
    }

    /// Warns about a daemon name that the ecosystem file does not have: the name is that of a
    /// guest, or misspelled.
    fn warn_of_stranger(&self, name: &DaemonId) {
        let Some(ecosystem) = &self.ecosystem else { return };
        if ecosystem.daemons.is_empty() || ecosystem.daemons.contains(name) {
            return;
        }
        let known = ecosystem.daemons.iter().map(DaemonId::as_str);
        let near = pddl::nearest(name.as_str(), known);
        let near = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
        output::print_note(&format!(
            "warning: with this certificate people can take part, but no agents of the file: the \
             ecosystem has no daemon called `{name}`{near}"
        ));
    }
}

/// Returns the authority's certificate first, then the certificates that the authority has issued
/// (if its key is in `folder`), and those that are files in `folder`.
fn certificates(folder: &CredentialFolder, trust: &Trust) -> Vec<Certificate> {
    let mut found = Authority::open(folder).map(|each| each.issued()).unwrap_or_default();
    for name in folder.daemons() {
        let here = Certificate::read(&folder.certificate(&name)).ok();
        found.extend(here.filter(|here| !found.contains(here)));
    }
    found.sort_by(|a, b| (&a.subject, a.not_after).cmp(&(&b.subject, b.not_after)));
    found.insert(0, trust.authority().clone());
    found
}

/// A certificate on this machine, and its state, for `althing doctor`.
pub(super) struct SurveyedCertificate {
    /// The name of the daemon, or that of the authority.
    pub(super) subject: String,
    /// Whether the certificate is a daemon's, and not the authority's.
    pub(super) is_daemon: bool,
    pub(super) days_left: usize,
    /// `good`, `ends`, `ended` or `revoked`.
    pub(super) state: &'static str,
}

/// Returns the certificates of a secured ecosystem on this machine, that of the authority first.
pub(super) fn survey(
    security: &SecuritySettings,
) -> Result<Vec<SurveyedCertificate>, CredentialError> {
    let folder = CredentialFolder::new(&security.folder);
    let trust = Trust::read(&folder)?;
    let warn_days = security.warn_before.as_secs() / DAY_SECONDS;
    let surveyed = |each: Certificate| SurveyedCertificate {
        is_daemon: each != *trust.authority(),
        days_left: usize::try_from(days(&each)).unwrap_or(usize::MAX),
        state: state(&each, &trust, warn_days),
        subject: each.subject,
    };
    Ok(certificates(&folder, &trust).into_iter().map(surveyed).collect())
}

fn state(certificate: &Certificate, trust: &Trust, warn_days: u64) -> &'static str {
    let is_revoked = trust.revocations().is_some_and(|list| list.contains(certificate));
    match days(certificate) {
        _ if is_revoked => "revoked",
        0 => "ended",
        left if left <= warn_days => "ends",
        _ => "good",
    }
}

fn days(certificate: &Certificate) -> u64 {
    certificate.remaining(SystemTime::now()).as_secs().div_ceil(DAY_SECONDS)
}

fn object(certificate: &Certificate, state: &str) -> serde_json::Value {
    json!({
        "name": certificate.subject,
        "days_left": days(certificate),
        "state": state,
        "hosts": certificate.hosts,
    })
}

/// Reports an error with credential files, and returns the exit code.
fn failed(error: &CredentialError, json: bool) -> ExitCode {
    super::wrong(&format!("failed to {error}"), json)
}
