//! `althing init`: writes the ecosystem file of a new building, from options or from the answers of
//! a person, and says what comes next.

mod discovery;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ecosystem_edit::{
    DeviceOffer, EcosystemDraft, EditError, EditableFile, FileEditError, GoalAddition, GoalWords,
    Respondent, as_name, interview,
};
use serde_json::json;
use terminal::render::plural;
use terminal::report::DiagnosticReport;
use terminal::{exit, output};

use crate::cli::edit::InitArgs;
use crate::commands::client::shell_word;
use crate::commands::{checked_text, consent, wrong};
use discovery::Discovery;

/// The file that is written if the person names none: the one that all commands find in this
/// folder.
const FILE: &str = "althing.toml";

/// The name of a building if neither the person nor the folder suggests one.
const NAME: &str = "home";

/// Reason why no file is written.
enum InitFailure {
    /// A sentence for the person.
    Sentence(String),
    /// Mistakes in the text that would be written.
    Mistakes(DiagnosticReport, String),
    /// The person has not agreed, or has stopped answering.
    NotAgreed(&'static str),
}

impl From<EditError> for InitFailure {
    fn from(error: EditError) -> InitFailure {
        InitFailure::Sentence(error.to_string())
    }
}

impl From<FileEditError> for InitFailure {
    fn from(error: FileEditError) -> InitFailure {
        InitFailure::Sentence(format!("failed to {error}"))
    }
}

/// Runs `althing init`.
pub(super) fn run(args: &InitArgs) -> ExitCode {
    let json = args.print.json;
    init(args).unwrap_or_else(|failure| match failure {
        InitFailure::Sentence(sentence) => wrong(&sentence, json),
        InitFailure::Mistakes(report, text) => {
            if !json {
                output::print_note(&text);
            }
            let code = output::show(&report, json, "bad-input", exit::BAD_INPUT);
            if !json {
                output::print_note("error: the file above would have mistakes; nothing is written");
            }
            code
        }
        InitFailure::NotAgreed(sentence) => {
            if json {
                let value = json!({ "status": "not-allowed", "problem": sentence });
                return output::print_json(&value, exit::NOT_ALLOWED);
            }
            output::print_note(sentence);
            exit::with(exit::NOT_ALLOWED)
        }
    })
}

fn init(args: &InitArgs) -> Result<ExitCode, InitFailure> {
    let file = args.file.clone().unwrap_or_else(|| PathBuf::from(FILE));
    if std::fs::symlink_metadata(&file).is_ok() {
        // Before a person has answered in vain.
        return Err(FileEditError::Exists { path: file }.into());
    }
    let asks = !args.yes && !args.print.json && consent::can_ask();
    if !asks && args.rooms.is_empty() {
        let sentence = "say which rooms there are, such as --room hall:corridor --room kitchen; \
                        questions are asked at a terminal only";
        return Err(InitFailure::Sentence(sentence.to_owned()));
    }
    if !asks && !args.yes {
        let sentence = "no terminal is here to ask for consent: --yes writes the file; nothing is \
                        written";
        return Err(InitFailure::NotAgreed(sentence));
    }
    let offers = found(args, asks);
    let mut draft = drafted(args)?;
    match asks {
        false => offers.iter().for_each(|offer| draft.take_offer(offer, None)),
        true => {
            draft = interview(&mut TerminalPerson { file: &file }, draft, &offers)
                .ok_or(InitFailure::NotAgreed("nothing is written"))?;
        }
    }
    let text = draft.text()?;
    let checked = checked_text::check(&file, &text);
    if checked.report.has_errors() {
        return Err(InitFailure::Mistakes(checked.report, text));
    }
    if asks {
        output::print_note(&format!("\n{text}"));
        if !consent::is_agreed(&format!("Write this to {}? [y/N]", file.display())) {
            return Err(InitFailure::NotAgreed("nothing is written"));
        }
    }
    EditableFile::create(&file, &text)?;
    if args.print.json {
        let value = json!({ "status": "done", "file": file.display().to_string(), "text": text });
        return Ok(output::print_json(&value, exit::DONE));
    }
    output::show_to_person(&checked.report);
    Ok(output::print(next_steps(&file, &draft), exit::DONE))
}

/// Returns the devices near this machine, and tells the person what is not a device.
fn found(args: &InitArgs, asks: bool) -> Vec<DeviceOffer> {
    if args.no_discovery || !(asks || args.discover) {
        return Vec::new();
    }
    let seconds = discovery::FOUND_WITHIN.as_secs();
    output::print_note(&format!(
        "looking for devices near this machine ({seconds} seconds at most)"
    ));
    let Discovery { offers, notes } = discovery::discover(&args.sysfs);
    for note in notes {
        output::print_note(&format!("  {note}"));
    }
    if offers.is_empty() {
        output::print_note("  no sensor, camera or broker was found; simulated ones will do");
    }
    offers
}

/// Returns the draft of what the options say.
fn drafted(args: &InitArgs) -> Result<EcosystemDraft, InitFailure> {
    let folder = std::env::current_dir().ok();
    let folder = folder.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy());
    let suggested = || folder.and_then(|name| as_name(&name)).unwrap_or_else(|| NAME.to_owned());
    let mut draft = EcosystemDraft {
        name: args.name.clone().unwrap_or_else(suggested),
        rooms: args.rooms.iter().cloned().map(Into::into).collect(),
        doors: args.doors.iter().cloned().map(Into::into).collect(),
        ..EcosystemDraft::default()
    };
    for robot in &args.robots {
        draft.add_robot(robot, args.simulated);
    }
    for sensor in &args.sensors {
        draft.add_sensor(sensor, args.simulated)?;
    }
    for GoalWords { name, goal } in &args.goals {
        let (name, goal) = (name.clone(), goal.clone());
        draft.goals.push(GoalAddition { name, goal, is_kept: true, settings: Vec::new() });
    }
    Ok(draft)
}

/// Returns the text for a person that has a new file: what is in it, and three commands.
fn next_steps(file: &Path, draft: &EcosystemDraft) -> String {
    let places = plural(draft.rooms.len(), "place");
    let (agents, goals) = (plural(draft.agents.len(), "agent"), plural(draft.goals.len(), "goal"));
    let word = shell_word(&file.display().to_string());
    let (up, of) = match word.as_str() {
        FILE => (String::new(), String::new()),
        word => (format!(" {word}"), format!(" --ecosystem {word}")),
    };
    let second = match draft.goals.as_slice() {
        [] => (format!("althing agents{of}"), "in another terminal: what can be planned with"),
        _ => (format!("althing goals{of}"), "in another terminal: how the goal stands"),
    };
    let commands = [
        (format!("althing up{up}"), "run it; leave it running"),
        second,
        (format!("althing view{of}"), "all of it on a screen, live"),
    ];
    let width = commands.iter().map(|(command, _)| command.chars().count()).max().unwrap_or(0);
    let mut text = format!(
        "{} is written: `{}`, {places}, {agents}, {goals}\n\nWhat comes next:\n",
        file.display(),
        draft.name
    );
    for (command, purpose) in commands {
        text += &format!("  {command:<width$}   {purpose}\n");
    }
    text
}

/// The person at the terminal. Answers make the text of the ecosystem file `file`.
struct TerminalPerson<'f> {
    file: &'f Path,
}

impl Respondent for TerminalPerson<'_> {
    fn tell(&mut self, text: &str) {
        output::print_note(text);
    }

    fn ask(&mut self, question: &str, usual: &str) -> Option<String> {
        let usual = if usual.is_empty() { String::new() } else { format!(" [{usual}]") };
        // The answer is typed on the same line.
        let _ = output::print(format!("{question}{usual}: "), exit::DONE);
        let mut answer = String::new();
        match std::io::stdin().read_line(&mut answer) {
            Ok(1..) => Some(answer.trim().to_owned()),
            _ => None,
        }
    }

    fn mistake(&mut self, text: &str) -> Option<String> {
        let report = checked_text::check(self.file, text).report;
        let found = report.findings().iter().find(|found| found.diagnostic.is_error())?;
        let help = found.diagnostic.help.as_deref();
        let help = help.map(|help| format!("; {help}")).unwrap_or_default();
        Some(format!("{}{help}", found.diagnostic.message))
    }
}
