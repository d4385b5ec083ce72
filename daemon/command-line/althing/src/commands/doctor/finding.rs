//! The checks of `althing doctor`, and what a check finds.

use serde_json::{Value, json};
use terminal::output::Color;
use terminal::styled::Styled;
use terminal::{output, visible};

pub(super) use crate::commands::byte_count as size;

/// Column in which the text of a finding begins.
const TEXT_COLUMN: usize = 30;

/// One check. The order is that in which findings are printed; docs/doctor.md lists them all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum DoctorCheck {
    RuntimeFolder,
    StateFolder,
    PluginsFolder,
    Disk,
    Clock,
    ClockSync,
    Memory,
    OpenFiles,
    Multicast,
    Ports,
    Programs,
    Devices,
    EcosystemFile,
    Certificates,
    People,
    Running,
    Processes,
    Daemons,
    Agents,
    Versions,
    DaemonCertificates,
    DaemonFiles,
    Files,
    Clocks,
    Mailboxes,
    NotSent,
    NotPersisted,
    Rejected,
    Plugins,
    Stops,
    HardwareStops,
    Questions,
}

/// What a check concerns: the machine, the ecosystem file, or the running ecosystem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CheckArea {
    Machine,
    File,
    Ecosystem,
}

/// Result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum CheckVerdict {
    Ok,
    /// Worth knowing, and not wrong by itself.
    Note,
    Problem,
}

/// Command that a person can run about a finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Remedy {
    /// The command mends the problem.
    Mend(String),
    /// The command shows more; a person decides what follows.
    Look(String),
}

/// What a check has found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CheckFinding {
    pub(super) check: DoctorCheck,
    pub(super) verdict: CheckVerdict,
    /// Sentence for a person.
    pub(super) text: String,
    pub(super) remedy: Option<Remedy>,
}

// === impl DoctorCheck ===

impl DoctorCheck {
    /// All checks, in their order.
    #[cfg(test)]
    pub(super) const ALL: [DoctorCheck; 32] = [
        DoctorCheck::RuntimeFolder,
        DoctorCheck::StateFolder,
        DoctorCheck::PluginsFolder,
        DoctorCheck::Disk,
        DoctorCheck::Clock,
        DoctorCheck::ClockSync,
        DoctorCheck::Memory,
        DoctorCheck::OpenFiles,
        DoctorCheck::Multicast,
        DoctorCheck::Ports,
        DoctorCheck::Programs,
        DoctorCheck::Devices,
        DoctorCheck::EcosystemFile,
        DoctorCheck::Certificates,
        DoctorCheck::People,
        DoctorCheck::Running,
        DoctorCheck::Processes,
        DoctorCheck::Daemons,
        DoctorCheck::Agents,
        DoctorCheck::Versions,
        DoctorCheck::DaemonCertificates,
        DoctorCheck::DaemonFiles,
        DoctorCheck::Files,
        DoctorCheck::Clocks,
        DoctorCheck::Mailboxes,
        DoctorCheck::NotSent,
        DoctorCheck::NotPersisted,
        DoctorCheck::Rejected,
        DoctorCheck::Plugins,
        DoctorCheck::Stops,
        DoctorCheck::HardwareStops,
        DoctorCheck::Questions,
    ];

    /// Returns the name of the check, for people and programs.
    pub(super) fn as_str(self) -> &'static str {
        match self {
            DoctorCheck::RuntimeFolder => "runtime-folder",
            DoctorCheck::StateFolder => "state-folder",
            DoctorCheck::PluginsFolder => "plugins-folder",
            DoctorCheck::Disk => "disk",
            DoctorCheck::Clock => "clock",
            DoctorCheck::ClockSync => "clock-sync",
            DoctorCheck::Memory => "memory",
            DoctorCheck::OpenFiles => "open-files",
            DoctorCheck::Multicast => "multicast",
            DoctorCheck::Ports => "ports",
            DoctorCheck::Programs => "programs",
            DoctorCheck::Devices => "devices",
            DoctorCheck::EcosystemFile => "ecosystem-file",
            DoctorCheck::Certificates => "certificates",
            DoctorCheck::People => "people",
            DoctorCheck::Running => "running",
            DoctorCheck::Processes => "processes",
            DoctorCheck::Daemons => "daemons",
            DoctorCheck::Agents => "agents",
            DoctorCheck::Versions => "versions",
            DoctorCheck::DaemonCertificates => "daemon-certificates",
            DoctorCheck::DaemonFiles => "daemon-open-files",
            DoctorCheck::Files => "files",
            DoctorCheck::Clocks => "clocks",
            DoctorCheck::Mailboxes => "mailboxes",
            DoctorCheck::NotSent => "not-sent",
            DoctorCheck::NotPersisted => "not-persisted",
            DoctorCheck::Rejected => "rejected",
            DoctorCheck::Plugins => "plugins",
            DoctorCheck::Stops => "stops",
            DoctorCheck::HardwareStops => "hardware-stops",
            DoctorCheck::Questions => "questions",
        }
    }

    /// Returns what the check concerns.
    pub(super) fn area(self) -> CheckArea {
        match self {
            check if check < DoctorCheck::EcosystemFile => CheckArea::Machine,
            DoctorCheck::EcosystemFile | DoctorCheck::Certificates | DoctorCheck::People => {
                CheckArea::File
            }
            _ => CheckArea::Ecosystem,
        }
    }

    pub(super) fn ok(self, text: impl Into<String>) -> CheckFinding {
        self.finding(CheckVerdict::Ok, text, None)
    }

    pub(super) fn note(self, text: impl Into<String>, remedy: Option<Remedy>) -> CheckFinding {
        self.finding(CheckVerdict::Note, text, remedy)
    }

    pub(super) fn problem(self, text: impl Into<String>, remedy: Option<Remedy>) -> CheckFinding {
        self.finding(CheckVerdict::Problem, text, remedy)
    }

    fn finding(
        self,
        verdict: CheckVerdict,
        text: impl Into<String>,
        remedy: Option<Remedy>,
    ) -> CheckFinding {
        CheckFinding { check: self, verdict, text: text.into(), remedy }
    }
}

// === impl CheckArea ===

impl CheckArea {
    pub(super) fn as_str(self) -> &'static str {
        match self {
            CheckArea::Machine => "machine",
            CheckArea::File => "file",
            CheckArea::Ecosystem => "ecosystem",
        }
    }
}

// === impl CheckVerdict ===

impl CheckVerdict {
    pub(super) fn as_str(self) -> &'static str {
        match self {
            CheckVerdict::Ok => "ok",
            CheckVerdict::Note => "note",
            CheckVerdict::Problem => "problem",
        }
    }

    fn color(self) -> Color {
        match self {
            CheckVerdict::Ok => Color::Green,
            CheckVerdict::Note => Color::Yellow,
            CheckVerdict::Problem => Color::Red,
        }
    }
}

// === impl Remedy ===

impl Remedy {
    pub(super) fn mend(command: impl Into<String>) -> Option<Remedy> {
        Some(Remedy::Mend(command.into()))
    }

    pub(super) fn look(command: impl Into<String>) -> Option<Remedy> {
        Some(Remedy::Look(command.into()))
    }

    fn parts(&self) -> (&'static str, &str) {
        match self {
            Remedy::Mend(command) => ("mend", command),
            Remedy::Look(command) => ("look", command),
        }
    }
}

// === impl CheckFinding ===

impl CheckFinding {
    /// Returns the lines for a person: the sentence, and below it the command. A command is never
    /// folded, because it is copied.
    pub(super) fn lines(&self) -> Styled {
        let verdict = self.verdict;
        let head = Styled::painted(verdict.color(), &format!("{:<8}", verdict.as_str()));
        let check = format!(" {:<19}  ", self.check.as_str());
        let line = head.and(&check).and(&self.text).folded(TEXT_COLUMN).end();
        let Some((word, command)) = self.remedy.as_ref().map(Remedy::parts) else { return line };
        let indent = " ".repeat(TEXT_COLUMN);
        line.and(&format!("{indent}{word}: {command}")).end()
    }

    pub(super) fn json(&self) -> Value {
        let remedy = self.remedy.as_ref().map(Remedy::parts);
        let remedy = remedy.map(|(word, command)| json!({ "kind": word, "command": command }));
        json!({
            "check": self.check.as_str(),
            "area": self.check.area().as_str(),
            "verdict": self.verdict.as_str(),
            "text": self.text,
            "remedy": remedy,
        })
    }
}

/// Returns names as a list for a person. At most eight are listed; further ones are counted.
pub(super) fn names(names: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    const LISTED_MAX: usize = 8;
    let all: Vec<String> =
        names.into_iter().map(|name| format!("`{}`", visible::line(name.as_ref()))).collect();
    match all.len().checked_sub(LISTED_MAX) {
        None | Some(0) => all.join(", "),
        Some(more) => format!("{} and {more} more", all[..LISTED_MAX].join(", ")),
    }
}

/// Returns the summary below the findings.
pub(super) fn summary(problems: usize, notes: usize) -> String {
    let notes_said = terminal::render::plural(notes, "note");
    match (problems, notes) {
        (0, 0) => "no problem was found\n".to_owned(),
        (0, _) => output::folded(&format!("no problem was found; {notes_said}"), 0) + "\n",
        (problems, 0) => format!("{}\n", terminal::render::plural(problems, "problem")),
        (problems, _) => {
            format!("{}, {notes_said}\n", terminal::render::plural(problems, "problem"))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The document that lists the checks.
    const DOCUMENT: &str = include_str!("../../../../../../docs/doctor.md");

    #[test]
    fn the_document_lists_the_checks_and_no_others() {
        let row = |line: &str| Some(line.strip_prefix("| `")?.split_once('`')?.0.to_owned());
        let listed: Vec<String> = DOCUMENT.lines().filter_map(row).collect();
        let known = DoctorCheck::ALL.map(|check| check.as_str().to_owned());
        assert_eq!(listed, known);
    }

    #[test]
    fn each_check_has_a_name_of_its_own_and_they_are_in_order() {
        let names: BTreeSet<_> = DoctorCheck::ALL.iter().map(|check| check.as_str()).collect();
        assert_eq!(names.len(), DoctorCheck::ALL.len());
        assert!(DoctorCheck::ALL.is_sorted(), "findings are sorted by check");
        let areas = DoctorCheck::ALL.map(|check| check.area() as u8);
        assert!(areas.is_sorted(), "an area is printed in one piece");
    }

    #[test]
    fn a_command_stands_in_a_line_of_its_own() {
        let finding = DoctorCheck::Disk.problem("full\u{1b}[31m", Remedy::look("df -h '/a b'"));
        let text = finding.lines();
        assert!(text.as_str().starts_with("problem  disk                 full␛[31m\n"), "{text}");
        assert!(text.as_str().ends_with(" look: df -h '/a b'\n"), "{text}");
        assert_eq!(finding.json()["remedy"]["kind"], "look");
    }

    #[test]
    fn sizes_and_lists_are_short() {
        assert_eq!(size(12), "12 bytes");
        assert_eq!(size(3 << 19), "1.5 MiB");
        assert_eq!(size(5 << 40), "5120.0 GiB");
        let ten = (0..10).map(|number| number.to_string());
        assert!(names(ten).ends_with("`7` and 2 more"));
        assert_eq!(summary(2, 1), "2 problems, 1 note\n");
    }
}
