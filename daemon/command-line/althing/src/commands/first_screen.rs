//! `althing` without arguments: whether a daemon runs here, of which ecosystem, and what to do next.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use acl::EcosystemId;
use terminal::{exit, output, visible};

use crate::cli;
use crate::commands::client::{self, shell_word};
use crate::config::{self, Ecosystem, Overrides};
use crate::plugins;

/// Columns of a command before what it does.
const COMMAND_COLUMNS: usize = 38;

/// Maximum number of files that are looked for in the folder `ecosystems`.
const FILES_MAX: usize = 64;

/// The subject of the first screen: what is on this machine and in the current folder.
#[derive(Debug, Default)]
struct Surroundings {
    /// The ecosystems of which a daemon runs here.
    running: Vec<EcosystemId>,
    /// The ecosystem file that commands use here; `None` if there is none.
    file: Option<FoundFile>,
    /// Another ecosystem file below the current folder, as an example; `None` if there is none.
    example: Option<PathBuf>,
}

/// The ecosystem file that commands use.
#[derive(Debug)]
struct FoundFile {
    path: PathBuf,
    /// The name of its ecosystem; `None` if the file cannot be understood.
    name: Option<EcosystemId>,
    has_errors: bool,
    /// The name of a goal of the file; `None` if it names none.
    goal: Option<String>,
}

/// A command, and what it does.
type NextStep = (String, &'static str);

/// Prints the first screen.
pub(crate) fn print() -> ExitCode {
    output::print(text(&Surroundings::find()), exit::DONE)
}

// === impl Surroundings ===

impl Surroundings {
    fn find() -> Surroundings {
        let file = config::find_ecosystem_file().map(FoundFile::read);
        let example = file.is_none().then(|| first_file(Path::new("ecosystems"))).flatten();
        Surroundings { running: client::running_here(), file, example }
    }
}

impl FoundFile {
    fn read(path: PathBuf) -> FoundFile {
        let reading = Ecosystem::read(&path, &Overrides::default(), &plugins::known());
        let ecosystem = reading.ecosystem.as_ref();
        FoundFile {
            path,
            name: ecosystem.map(|ecosystem| ecosystem.name.clone()),
            has_errors: reading.report.has_errors(),
            goal: ecosystem.and_then(|ecosystem| ecosystem.goals.keys().next().cloned()),
        }
    }
}

/// Returns the first `.toml` file of a folder, in the order of the names.
fn first_file(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().take(FILES_MAX);
    let files = entries.map(|entry| entry.path());
    files.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).min()
}

// === the text ===

fn text(around: &Surroundings) -> String {
    let (about, steps) = match (around.running.as_slice(), &around.file) {
        ([], Some(file)) => with_file(file),
        ([], None) => without_file(around.example.as_deref()),
        ([only], file) => running(only, file.as_ref()),
        (several, _) => running_several(several),
    };
    let mut text = String::from(
        "Althing: the sensors, robots, screens and people of a building plan together.\n\n",
    );
    text += &visible::text(&about);
    text += "\n\nWhat to do next\n";
    for (command, does) in steps {
        text += &format!("  {:<COMMAND_COLUMNS$} {does}\n", visible::line(&command));
    }
    text + "\n`althing help` lists all commands, by what they are for.\n"
}

fn step(command: impl Into<String>, does: &'static str) -> NextStep {
    (command.into(), does)
}

/// The next steps if one ecosystem runs here.
fn running(name: &EcosystemId, file: Option<&FoundFile>) -> (String, Vec<NextStep>) {
    let goal = file.filter(|file| file.name.as_ref() == Some(name));
    let goal = goal.and_then(|file| file.goal.as_deref()).map(shell_word);
    let ask = match goal {
        Some(goal) => step(format!("althing goal {goal}"), "ask for a goal of its file"),
        None => step("althing keyboard", "ask for something, at a prompt"),
    };
    let steps = vec![
        step("althing goals", "what is wanted, and how it stands"),
        step("althing agents", "who is here, and what they can do"),
        ask,
    ];
    (format!("A daemon of the ecosystem `{name}` runs on this machine."), steps)
}

/// The next steps if several ecosystems run here: each command must say which it means.
fn running_several(names: &[EcosystemId]) -> (String, Vec<NextStep>) {
    let listed: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
    let first = names.first().map_or("NAME", EcosystemId::as_str);
    let steps = vec![
        step(format!("althing goals --ecosystem {first}"), "what is wanted there"),
        step(format!("althing agents --ecosystem {first}"), "who is there"),
        step(format!("althing keyboard --ecosystem {first}"), "a prompt to it"),
    ];
    (format!("Daemons of {} run on this machine.", listed.join(" and of ")), steps)
}

/// The next steps if no daemon runs here, and a file says which could.
fn with_file(file: &FoundFile) -> (String, Vec<NextStep>) {
    let path = file.path.display().to_string();
    let check = format!("althing check {}", shell_word(&path));
    if file.has_errors {
        let about = format!("No daemon runs on this machine, and the file {path} has mistakes.");
        let steps = vec![
            step(check, "shows each, with its cure"),
            step("althing up", "then runs this machine's part"),
            step("althing doctor", "examines the machine"),
        ];
        return (about, steps);
    }
    let name = file.name.as_ref().map_or("?", EcosystemId::as_str);
    let about = format!("No daemon runs on this machine. The file {path} describes `{name}`.");
    let ask = match file.goal.as_deref() {
        Some(goal) => {
            step(format!("althing goal {}", shell_word(goal)), "then, in another terminal")
        }
        None => step("althing keyboard", "then, in another terminal"),
    };
    let steps = vec![
        step(check, "finds mistakes before it runs"),
        step("althing up", "runs this machine's part"),
        ask,
    ];
    (about, steps)
}

/// The next steps if neither a daemon nor a file is here.
fn without_file(example: Option<&Path>) -> (String, Vec<NextStep>) {
    let about = "No daemon runs on this machine, and no file `althing.toml` is in this folder.";
    let mut steps = vec![step("althing scenario 1", "plays a building: no device, no file")];
    if cli::has_command("init") {
        steps.push(step("althing init", "writes the file of your building"));
    }
    match example {
        Some(path) => {
            let path = shell_word(&path.display().to_string());
            steps.push(step(format!("althing up {path}"), "runs an example"));
        }
        None => steps.push(step("althing up FILE.toml", "runs the building of a file")),
    }
    steps.push(step("althing doctor", "examines this machine"));
    (about.to_owned(), steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(name: &str) -> EcosystemId {
        EcosystemId::new(name).expect("a name")
    }

    fn file(has_errors: bool) -> Option<FoundFile> {
        Some(FoundFile {
            path: PathBuf::from("althing.toml"),
            name: Some(name("school")),
            has_errors,
            goal: Some("warm".to_owned()),
        })
    }

    #[track_caller]
    fn check(around: &Surroundings, parts: &[&str]) {
        let text = text(around);
        for part in parts {
            assert!(text.contains(part), "no `{part}`: {text}");
        }
        assert!(text.lines().count() <= 24, "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    }

    #[test]
    fn the_first_screen_says_what_runs_and_what_to_do_next() {
        let none = Surroundings::default();
        check(&none, &["No daemon runs", "no file `althing.toml`", "althing scenario 1"]);
        let example = Some(PathBuf::from("ecosystems/smart-office.toml"));
        check(
            &Surroundings { example, ..Surroundings::default() },
            &["althing up ecosystems/smart-office.toml"],
        );
        let stopped = Surroundings { file: file(false), ..Surroundings::default() };
        check(&stopped, &["describes `school`", "althing up\u{20}", "althing goal warm"]);
        let wrong = Surroundings { file: file(true), ..Surroundings::default() };
        check(&wrong, &["has mistakes", "althing check althing.toml"]);
        let running =
            Surroundings { running: vec![name("school")], file: file(false), example: None };
        check(&running, &["of the ecosystem `school` runs", "althing goals", "althing goal warm"]);
        // The file is one of another ecosystem.
        let running = Surroundings { running: vec![name("office")], ..running };
        check(&running, &["`office` runs", "althing keyboard"]);
        let several =
            Surroundings { running: vec![name("a"), name("b")], ..Surroundings::default() };
        check(&several, &["`a` and of `b`", "--ecosystem a"]);
    }
}
