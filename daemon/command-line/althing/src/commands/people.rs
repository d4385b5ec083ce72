//! `althing people`: the people of an ecosystem, their passwords, rights and tokens, and the log of
//! what they asked for.
//!
//! - [`passwords`] asks for a new password.
//! - [`screens`] adds the screens of robots.
//! - [`requests`] shows the log.

mod passwords;
mod requests;
mod screens;

use std::collections::BTreeSet;
use std::process::ExitCode;
use std::time::SystemTime;

use accounts::{
    AccountsError, PasswordCost, PeopleFile, PersonName, PersonRecord, PersonRight, PersonRole,
    StoredPassword, StoredToken,
};
use serde_json::{Value, json};
use terminal::report::{DiagnosticReport, SourceText};
use terminal::{exit, output};

use crate::cli::people::{
    GrantedRightsArgs, PeopleAddArgs, PeopleArgs, PeopleCommand, PeopleListArgs,
    PeoplePasswordArgs, PeoplePlaceArgs, PeopleRemoveArgs, PeopleRightsArgs, PeopleTokenCommand,
    PeopleTokenNameArgs,
};
use crate::config::{self, Ecosystem, Overrides};
use crate::plugins;

/// Said after each change: a daemon has a file of its own.
const COPY: &str = "Daemons that read this file know it within seconds. Copy it to the other machines \
                    that serve a page,\nover an encrypted channel.";

/// An ecosystem, and the file of its people.
struct PeoplePlace {
    ecosystem: Ecosystem,
    file: PeopleFile,
}

/// Reason why a command fails.
enum PeopleFailure {
    /// An error of the file, of a password or of the system.
    Accounts(AccountsError),
    /// A mistake of the user; the text is a sentence.
    Wrong(String),
}

/// Runs `althing people`.
pub(super) fn run(args: &PeopleArgs) -> ExitCode {
    let (done, json) = match &args.command {
        None => (list(&args.list), args.list.print.json),
        Some(PeopleCommand::List(args)) => (list(args), args.print.json),
        Some(PeopleCommand::Add(args)) => (add(args), args.print.json),
        Some(PeopleCommand::AddScreen(args)) => (screens::add(args), args.print.json),
        Some(PeopleCommand::Remove(args)) => (remove(args), args.print.json),
        Some(PeopleCommand::Password(args)) => (password(args), args.print.json),
        Some(PeopleCommand::Rights(args)) => (rights(args), args.print.json),
        Some(PeopleCommand::Token(args)) => match &args.command {
            PeopleTokenCommand::Add(args) => (add_token(args), args.print.json),
            PeopleTokenCommand::Remove(args) => (remove_token(args), args.print.json),
        },
        Some(PeopleCommand::Log(args)) => (requests::show(args), args.print.json),
    };
    done.unwrap_or_else(|failure| failure.show(json))
}

fn list(args: &PeopleListArgs) -> Result<ExitCode, PeopleFailure> {
    let place = PeoplePlace::find(&args.place)?;
    let records = place.file.read()?;
    let path = place.file.path().display();
    if args.print.json {
        let people: Vec<Value> = records.iter().map(object).collect();
        let value = json!({ "file": place.file.path(), "people": people });
        return Ok(output::print_json(&value, exit::DONE));
    }
    if records.is_empty() {
        let text = format!(
            "no people: {path} has none\nAdd the first: althing people add NAME --role operator\n"
        );
        return Ok(output::print(text, exit::DONE));
    }
    let mut text = format!("{:<20} {:<9} {:<38} TOKENS\n", "NAME", "PASSWORD", "RIGHTS");
    for person in records.iter() {
        let has_password = if person.password.is_some() { "yes" } else { "no" };
        let tokens: Vec<_> = person
            .tokens
            .iter()
            .map(|StoredToken { name, added, .. }| match added.as_str() {
                "" => name.to_string(),
                added => format!("{name} ({added})"),
            })
            .collect();
        let rights = match &person.screen {
            Some(agent) => format!("the screen of {agent}"),
            None => words(&person.rights),
        };
        let line = format!(
            "{:<20} {has_password:<9} {rights:<38} {}",
            person.name.as_str(),
            tokens.join(", ")
        );
        text.push_str(line.trim_end());
        text.push('\n');
    }
    Ok(output::print(text, exit::DONE))
}

fn add(args: &PeopleAddArgs) -> Result<ExitCode, PeopleFailure> {
    let name = person_name(&args.name)?;
    let place = PeoplePlace::find(&args.place)?;
    place.check_is_no_agent(&name)?;
    // Before a person is asked for a password in vain.
    if place.file.read()?.get(name.as_str()).is_some() {
        return Err(AccountsError::Exists(name.to_string()).into());
    }
    let rights = args.granted.rights();
    let chosen = match args.no_password {
        true => None,
        false => Some(passwords::choose(&name, &args.password)?),
    };
    let hash = |text: &String| StoredPassword::hash(text, PasswordCost::RECOMMENDED);
    let password = chosen.as_ref().map(|chosen| hash(&chosen.text)).transpose()?;
    let record = PersonRecord {
        name: name.clone(),
        rights: rights.clone(),
        password,
        tokens: Vec::new(),
        screen: None,
    };
    place.file.change(|people| people.add(record))?;
    let generated = chosen.filter(|chosen| chosen.is_generated).map(|chosen| chosen.text);
    if args.print.json {
        let value = json!({
            "status": "ok",
            "file": place.file.path(),
            "name": name,
            "rights": rights,
            "password": generated,
        });
        return Ok(output::print_json(&value, exit::DONE));
    }
    let rights = words(&rights);
    let mut text = format!("added `{name}` ({rights}) to {}\n", place.file.path().display());
    push_generated(&mut text, generated.as_deref());
    Ok(output::print(format!("{text}{COPY}\n"), exit::DONE))
}

fn remove(args: &PeopleRemoveArgs) -> Result<ExitCode, PeopleFailure> {
    let place = PeoplePlace::find(&args.place)?;
    place.file.change(|people| people.remove(&args.name))?;
    if args.print.json {
        return Ok(done(&place, &args.name));
    }
    let path = place.file.path().display();
    let text = format!("removed `{}` from {path}; its sessions end\n{COPY}\n", args.name);
    Ok(output::print(text, exit::DONE))
}

fn password(args: &PeoplePasswordArgs) -> Result<ExitCode, PeopleFailure> {
    let name = person_name(&args.name)?;
    let place = PeoplePlace::find(&args.place)?;
    place.check_is_there(&name)?;
    let chosen = passwords::choose(&name, &args.password)?;
    let stored = StoredPassword::hash(&chosen.text, PasswordCost::RECOMMENDED)?;
    place.file.change(|people| people.set_password(name.as_str(), stored))?;
    let generated = chosen.is_generated.then_some(chosen.text);
    if args.print.json {
        let file = place.file.path();
        let value = json!({ "status": "ok", "file": file, "name": name, "password": generated });
        return Ok(output::print_json(&value, exit::DONE));
    }
    let mut text = format!("`{name}` has a new password; sessions with the old one end\n");
    push_generated(&mut text, generated.as_deref());
    Ok(output::print(format!("{text}{COPY}\n"), exit::DONE))
}

fn rights(args: &PeopleRightsArgs) -> Result<ExitCode, PeopleFailure> {
    let place = PeoplePlace::find(&args.place)?;
    let rights = args.granted.rights();
    place.file.change(|people| people.set_rights(&args.name, rights.clone()))?;
    if args.print.json {
        let file = place.file.path();
        let value = json!({ "status": "ok", "file": file, "name": args.name, "rights": rights });
        return Ok(output::print_json(&value, exit::DONE));
    }
    let text = format!("`{}` now has the rights {}\n{COPY}\n", args.name, words(&rights));
    Ok(output::print(text, exit::DONE))
}

fn add_token(args: &PeopleTokenNameArgs) -> Result<ExitCode, PeopleFailure> {
    let token = person_name(&args.token)?;
    let place = PeoplePlace::find(&args.place)?;
    let (text, stored) = StoredToken::make(token, SystemTime::now())?;
    place.file.change(|people| people.add_token(&args.name, stored))?;
    if args.print.json {
        let file = place.file.path();
        let value = json!({ "status": "ok", "file": file, "name": args.name, "token": text });
        return Ok(output::print_json(&value, exit::DONE));
    }
    let text = format!(
        "token: {text}\nIt is not shown again. A program sends it as `Authorization: Bearer TOKEN`, \
         and acts with the rights of `{}`.\n{COPY}\n",
        args.name
    );
    Ok(output::print(text, exit::DONE))
}

fn remove_token(args: &PeopleTokenNameArgs) -> Result<ExitCode, PeopleFailure> {
    let place = PeoplePlace::find(&args.place)?;
    place.file.change(|people| people.remove_token(&args.name, &args.token))?;
    if args.print.json {
        return Ok(done(&place, &args.name));
    }
    let text = format!("removed the token `{}` of `{}`\n{COPY}\n", args.token, args.name);
    Ok(output::print(text, exit::DONE))
}

fn done(place: &PeoplePlace, name: &str) -> ExitCode {
    let value = json!({ "status": "ok", "file": place.file.path(), "name": name });
    output::print_json(&value, exit::DONE)
}

fn push_generated(text: &mut String, generated: Option<&str>) {
    if let Some(password) = generated {
        text.push_str(&format!("password: {password}\nIt is not shown again.\n"));
    }
}

fn person_name(text: &str) -> Result<PersonName, PeopleFailure> {
    PersonName::new(text).map_err(|error| PeopleFailure::Wrong(error.to_string()))
}

fn words(rights: &BTreeSet<PersonRight>) -> String {
    rights.iter().map(|right| right.as_str()).collect::<Vec<_>>().join(", ")
}

/// Returns what is known of a person, without hashes.
fn object(person: &PersonRecord) -> Value {
    let token = |token: &StoredToken| json!({ "name": token.name, "added": token.added });
    json!({
        "name": person.name,
        "rights": person.rights,
        "screen": person.screen,
        "has_password": person.password.is_some(),
        "tokens": person.tokens.iter().map(token).collect::<Vec<_>>(),
    })
}

// === impl GrantedRightsArgs ===

impl GrantedRightsArgs {
    fn rights(&self) -> BTreeSet<PersonRight> {
        match self.rights.is_empty() {
            true => self.role.unwrap_or(PersonRole::Visitor).rights(),
            false => self.rights.iter().copied().collect(),
        }
    }
}

// === impl PeoplePlace ===

impl PeoplePlace {
    fn find(args: &PeoplePlaceArgs) -> Result<PeoplePlace, PeopleFailure> {
        let wrong = |problem: String| PeopleFailure::Wrong(problem);
        let path = match &args.ecosystem {
            Some(asked) => config::resolve_ecosystem(asked)
                .map_err(|problem| wrong(format!("failed to {problem}")))?,
            None => config::find_ecosystem_file().ok_or_else(|| {
                wrong("there is no althing.toml here; name a file with --ecosystem".to_owned())
            })?,
        };
        let read = Ecosystem::read(&path, &Overrides::default(), &plugins::known());
        // A mistake elsewhere in the file does not matter to people.
        let Some(ecosystem) = read.ecosystem else {
            output::show_to_person(&read.report);
            return Err(wrong(format!("failed to read {}", path.display())));
        };
        let file = PeopleFile::new(&ecosystem.people);
        Ok(PeoplePlace { ecosystem, file })
    }

    /// Returns an error if an agent has this name: messages and logs name both.
    fn check_is_no_agent(&self, name: &PersonName) -> Result<(), PeopleFailure> {
        let mut agents = self.ecosystem.agents.iter();
        match agents.any(|entry| entry.name.as_str() == name.as_str()) {
            true => Err(PeopleFailure::Wrong(format!(
                "there is an agent called `{name}`; give the person another name"
            ))),
            false => Ok(()),
        }
    }

    /// Returns an error if there is no person of this name, before a password is asked for in vain.
    fn check_is_there(&self, name: &PersonName) -> Result<(), PeopleFailure> {
        self.file.read()?.find(name.as_str())?;
        Ok(())
    }
}

// === impl PeopleFailure ===

impl From<AccountsError> for PeopleFailure {
    fn from(error: AccountsError) -> PeopleFailure {
        PeopleFailure::Accounts(error)
    }
}

impl PeopleFailure {
    fn show(self, json: bool) -> ExitCode {
        match self {
            PeopleFailure::Wrong(problem) => super::wrong(&problem, json),
            PeopleFailure::Accounts(AccountsError::Mistakes { path, text, mistakes }) if !json => {
                let mut report = DiagnosticReport::default();
                report.add(&SourceText::new(path.display().to_string(), text), mistakes);
                output::show_to_person(&report);
                super::wrong(&format!("failed to read {}", path.display()), json)
            }
            PeopleFailure::Accounts(error) => super::wrong(&format!("failed to {error}"), json),
        }
    }
}
