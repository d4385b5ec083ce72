//! Shows the log of requests: what people asked the daemons of this machine for.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::UNIX_EPOCH;

use accounts::{LoggedRequest, RequestLog};
use jiff::Zoned;
use serde_json::json;
use terminal::{exit, output, visible};

use super::{PeopleFailure, PeoplePlace};
use crate::cli::people::PeopleLogArgs;
use crate::commands::history_text::moment;
use crate::hosting;

/// Prints the newest requests, of one person or of all.
pub(super) fn show(args: &PeopleLogArgs) -> Result<ExitCode, PeopleFailure> {
    let place = PeoplePlace::find(&args.place)?;
    let folder = hosting::state_base().join(place.ecosystem.name.as_str());
    let mut requests = Vec::new();
    for daemon in daemons(&folder)? {
        requests.extend(RequestLog::read(&daemon)?);
    }
    let is_meant = |request: &LoggedRequest| match (&args.name, &request.person) {
        (None, _) => true,
        (Some(name), person) => person.as_ref().is_some_and(|person| person.as_str() == name),
    };
    requests.retain(is_meant);
    requests.sort_by_key(|request| request.at);
    requests.drain(..requests.len().saturating_sub(args.last));
    if args.print.json {
        return Ok(output::print_json(&json!({ "requests": requests }), exit::DONE));
    }
    if requests.is_empty() {
        let of = args.name.as_ref().map(|name| format!(" of `{name}`")).unwrap_or_default();
        let text = format!("no request{of} is logged in {}\n", folder.display());
        return Ok(output::print(text, exit::DONE));
    }
    let now = Zoned::now();
    let mut text =
        format!("{:<19} {:<14} {:<15} {:<14} REQUEST\n", "TIME", "PERSON", "FROM", "THROUGH");
    for LoggedRequest { at, person, from, through, what, outcome } in &requests {
        let millis = at.duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
        let at = moment(u64::try_from(millis).unwrap_or(u64::MAX), &now);
        let person = person.as_ref().map_or("-", |person| person.as_str());
        let (through, from) = (visible::line(through), from.to_string());
        let (what, outcome) = (visible::line(what), visible::line(outcome));
        let _ = writeln!(text, "{at:<19} {person:<14} {from:<15} {through:<14} {what}: {outcome}");
    }
    Ok(output::print(text, exit::DONE))
}

/// Returns the state folders of the daemons of an ecosystem on this machine.
fn daemons(folder: &PathBuf) -> Result<Vec<PathBuf>, PeopleFailure> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => {
            let problem = format!("failed to read {}: {error}", folder.display());
            return Err(PeopleFailure::Wrong(problem));
        }
    };
    let mut folders: Vec<_> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    Ok(folders)
}
