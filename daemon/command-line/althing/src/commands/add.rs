//! `althing add`: adds a room, a door, an agent or a goal to an ecosystem file, and lets the
//! daemons of this machine that run the file read it again.
//!
//! Nothing is written before the new text has been checked and a person has agreed to the
//! difference.

mod running;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use acl::{AgentId, DaemonId};
use ecosystem_edit::{
    AgentAddition, DoorAddition, EcosystemAddition, EcosystemText, EditError, EditableFile,
    FileEditError, GoalAddition, RoomAddition, SettingText, unified_difference,
};
use serde_json::{Value, json};
use terminal::report::DiagnosticReport;
use terminal::{exit, output};

use crate::cli::edit::{
    AddAgentArgs, AddCommand, AddDoorArgs, AddGoalArgs, AddRoomArgs, DoorSide, EditArgs,
};
use crate::commands::checked_text::{self, CheckedText};
use crate::commands::client::shell_word;
use crate::commands::{consent, wrong};
use crate::config::{self, Ecosystem};
use crate::hosting;
use running::{DaemonOutcome, FileChange};

/// Plugins of robots. The place of a robot is the one where it starts.
const ROBOTS: &[&str] = &["turtlebot", "cleaning-robot", "video-robot"];

/// Reason why nothing is added.
enum AddFailure {
    /// A sentence for the person.
    Sentence(String),
    /// Mistakes in a text, and what follows from them.
    Mistakes(DiagnosticReport, String),
    /// The person has not agreed.
    NotAgreed(String),
}

impl From<EditError> for AddFailure {
    fn from(error: EditError) -> AddFailure {
        AddFailure::Sentence(error.to_string())
    }
}

impl From<FileEditError> for AddFailure {
    fn from(error: FileEditError) -> AddFailure {
        AddFailure::Sentence(format!("failed to {error}"))
    }
}

/// Runs `althing add`.
pub(super) fn run(command: &AddCommand) -> ExitCode {
    let edit = match command {
        AddCommand::Room(args) => &args.edit,
        AddCommand::Door(args) => &args.edit,
        AddCommand::Agent(args) => &args.edit,
        AddCommand::Goal(args) => &args.edit,
    };
    change(command, edit).unwrap_or_else(|failure| failure.show(edit.print.json))
}

fn change(command: &AddCommand, edit: &EditArgs) -> Result<ExitCode, AddFailure> {
    let file = found(edit.ecosystem.as_deref()).map_err(AddFailure::Sentence)?;
    let before = EditableFile::read(&file)?;
    let old = checked_text::check(&file, before.text());
    let shown = file.display();
    let Some(ecosystem) = old.ecosystem.as_ref().filter(|_| !old.report.has_errors()) else {
        let sentence = format!("{shown} has mistakes already: mend them first; nothing is changed");
        return Err(AddFailure::Mistakes(old.report, sentence));
    };
    let mut text = EcosystemText::parse(before.text())?;
    for addition in additions(command, ecosystem)? {
        text.add(&addition)?;
    }
    let new = checked_text::check(&file, text.text());
    let changed = new.ecosystem.as_ref().filter(|_| !new.report.has_errors());
    let Some(changed) = changed else {
        let sentence = format!("with that, {shown} would have mistakes; nothing is changed");
        return Err(AddFailure::Mistakes(new.new_findings(&old), sentence));
    };
    let difference = unified_difference(&shown.to_string(), before.text(), text.text());
    show(&difference, &new, &old, edit);
    if edit.dry_run {
        return Ok(done(&file, &difference, None, edit));
    }
    agree(edit)?;
    before.replace(text.text())?;
    if edit.file_only {
        return Ok(done(&file, &difference, None, edit));
    }
    let is_new = |agent: &AgentId| !ecosystem.agents.iter().any(|entry| entry.name == *agent);
    let names = changed.agents.iter().map(|entry| entry.name.clone());
    let outcomes = running::take(&FileChange {
        file: &file,
        before: ecosystem,
        after: changed,
        agents: names.filter(is_new).collect(),
    });
    Ok(done(&file, &difference, Some(&outcomes), edit))
}

/// Returns the path of the file of `--ecosystem`, or of the file that is used without it.
fn found(asked: Option<&str>) -> Result<PathBuf, String> {
    match asked {
        Some(asked) => {
            config::resolve_ecosystem(asked).map_err(|problem| format!("failed to {problem}"))
        }
        None => config::find_ecosystem_file().ok_or_else(|| {
            "there is no althing.toml here nor in the configuration folders; name the file with \
             --ecosystem FILE, or write one with `althing init`"
                .to_owned()
        }),
    }
}

// === what is added ===

fn additions(
    command: &AddCommand,
    ecosystem: &Ecosystem,
) -> Result<Vec<EcosystemAddition>, AddFailure> {
    Ok(match command {
        AddCommand::Room(args) => room(args),
        AddCommand::Door(args) => {
            let AddDoorArgs { from, to, length, one_way, .. } = args;
            let (from, to) = (from.clone(), to.clone());
            let door = DoorAddition { from, to, length: *length, is_one_way: *one_way };
            vec![EcosystemAddition::Door(door)]
        }
        AddCommand::Agent(args) => vec![EcosystemAddition::Agent(agent(args, ecosystem)?)],
        AddCommand::Goal(args) => {
            let AddGoalArgs { name, goal, keep, settings, .. } = args;
            let (name, goal, settings) = (name.clone(), goal.clone(), settings.clone());
            let goal = GoalAddition { name, goal, is_kept: *keep, settings };
            vec![EcosystemAddition::Goal(goal)]
        }
    })
}

fn room(args: &AddRoomArgs) -> Vec<EcosystemAddition> {
    let AddRoomArgs { name, kind, floor, area, doors, settings, .. } = args;
    let number = floor.as_ref().and_then(|floor| floor.parse::<i64>().ok());
    let named = floor.as_ref().filter(|_| number.is_none());
    let named = named.map(|floor| SettingText::text("floor", floor));
    let room = RoomAddition {
        name: name.clone(),
        kind: kind.clone(),
        floor: number,
        area: *area,
        settings: named.into_iter().chain(settings.iter().cloned()).collect(),
    };
    let door = |DoorSide { room, length }: &DoorSide| {
        let (from, to) = (room.clone(), name.clone());
        EcosystemAddition::Door(DoorAddition { from, to, length: *length, is_one_way: false })
    };
    std::iter::once(EcosystemAddition::Room(room)).chain(doors.iter().map(door)).collect()
}

fn agent(args: &AddAgentArgs, ecosystem: &Ecosystem) -> Result<AgentAddition, AddFailure> {
    let AddAgentArgs { name, plugin, driver, location, daemons, settings, .. } = args;
    let place = match ROBOTS.contains(&plugin.as_str()) {
        true => "start",
        false => "location",
    };
    let location = location.iter().map(|room| SettingText::text(place, room));
    Ok(AgentAddition {
        name: name.clone(),
        plugin: plugin.clone(),
        daemons: match daemons.as_slice() {
            [] => usual_daemon(ecosystem)?,
            daemons => daemons.to_vec(),
        },
        driver: driver.clone(),
        config: location.chain(settings.iter().cloned()).collect(),
    })
}

/// Returns the daemon that hosts an agent if the person names none: none if the file names no
/// daemon for any agent, otherwise this machine's, or the only one.
fn usual_daemon(ecosystem: &Ecosystem) -> Result<Vec<String>, AddFailure> {
    if ecosystem.agents.iter().all(|entry| entry.daemons.is_empty()) {
        return Ok(Vec::new());
    }
    let here = hosting::host_name().filter(|host| ecosystem.daemons.contains(host));
    let only = || ecosystem.daemons.first().filter(|_| ecosystem.daemons.len() == 1).cloned();
    match here.or_else(only) {
        Some(daemon) => Ok(vec![daemon.to_string()]),
        None => {
            let known: Vec<_> = ecosystem.daemons.iter().map(DaemonId::as_str).collect();
            Err(AddFailure::Sentence(format!(
                "say which machine hosts it with --daemon: {}; nothing is changed",
                known.join(", ")
            )))
        }
    }
}

// === what a person sees ===

fn show(difference: &str, new: &CheckedText, old: &CheckedText, edit: &EditArgs) {
    if edit.print.json {
        return;
    }
    output::show_to_person(&new.new_findings(old));
    // A reader that has gone away changes nothing: the file is written all the same.
    let _ = output::print(difference, exit::DONE);
}

/// Returns an error unless a person agrees to the difference that was shown.
fn agree(edit: &EditArgs) -> Result<(), AddFailure> {
    if edit.yes {
        return Ok(());
    }
    if edit.print.json || !consent::can_ask() {
        let sentence = "no terminal is here to ask for consent: --yes agrees to the difference; \
                        nothing is changed";
        return Err(AddFailure::NotAgreed(sentence.to_owned()));
    }
    match consent::is_agreed("Write that? [y/N]") {
        true => Ok(()),
        false => Err(AddFailure::NotAgreed("nothing is changed".to_owned())),
    }
}

/// Says what was done; `outcomes` are those of the daemons, if they were to take the change.
fn done(
    file: &Path,
    difference: &str,
    outcomes: Option<&[DaemonOutcome]>,
    edit: &EditArgs,
) -> ExitCode {
    let is_taken = outcomes.is_none_or(|all| all.iter().all(|outcome| outcome.is_taken));
    let code = if is_taken { exit::DONE } else { exit::UNAVAILABLE };
    let shown = file.display().to_string();
    if edit.print.json {
        let daemons: Option<Vec<Value>> = outcomes.map(|all| {
            let value = |it: &DaemonOutcome| {
                json!({ "daemon": it.daemon, "taken": it.is_taken, "text": it.text })
            };
            all.iter().map(value).collect()
        });
        let status = match (edit.dry_run, is_taken) {
            (true, _) => "unchanged",
            (false, true) => "done",
            (false, false) => "not-taken",
        };
        let value = json!({
            "status": status, "file": shown, "difference": difference, "daemons": daemons,
        });
        return output::print_json(&value, code);
    }
    if edit.dry_run {
        return output::print("nothing is changed (--dry-run)\n", code);
    }
    let mut text = format!("{shown} is written\n");
    match outcomes {
        None => {
            text += "daemons take it when they read the file again: `kill -HUP`, or a restart\n"
        }
        Some([]) => {
            let file = shell_word(&shown);
            text +=
                &format!("no daemon of it runs on this machine; to start it: althing up {file}\n");
        }
        Some(outcomes) => {
            for outcome in outcomes {
                text += &format!("`{}` {}\n", outcome.daemon, outcome.text);
            }
        }
    }
    output::print(text, code)
}

impl AddFailure {
    fn show(self, json: bool) -> ExitCode {
        match self {
            AddFailure::Sentence(sentence) => wrong(&sentence, json),
            AddFailure::Mistakes(report, sentence) => {
                let code = output::show(&report, json, "bad-input", exit::BAD_INPUT);
                if !json {
                    output::print_note(&format!("error: {sentence}"));
                }
                code
            }
            AddFailure::NotAgreed(sentence) => {
                if json {
                    let value = json!({ "status": "not-allowed", "problem": sentence });
                    return output::print_json(&value, exit::NOT_ALLOWED);
                }
                output::print_note(&sentence);
                exit::with(exit::NOT_ALLOWED)
            }
        }
    }
}
