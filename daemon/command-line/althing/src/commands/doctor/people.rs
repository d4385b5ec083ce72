//! Judges what waits for a person: stops in force, open questions, plugins that need a decision.

use acl::content::OpenQuestion;
use plugin_host::{PluginState, PluginStatus};
use terminal::render::plural;

use super::finding::{CheckFinding, DoctorCheck, Remedy};
use super::running::EcosystemAnswers;
use super::subject::DoctorSubject;
use crate::asking::stops;
use crate::commands::client::shell_word;
use crate::commands::stop::{self, hardware_stops};

/// Judges what waits for a person.
pub(super) fn judge(subject: &DoctorSubject, answers: &EcosystemAnswers) -> Vec<CheckFinding> {
    let words = subject.words();
    let mut findings = plugins(answers, &words, &subject.ecosystem_words());
    findings.extend(stops(answers, &words));
    findings.extend(answers.questions.iter().map(|open| question(open, &words)));
    if answers.questions.is_empty() {
        findings.push(DoctorCheck::Questions.ok("no question waits for an answer"));
    }
    findings
}

fn stops(answers: &EcosystemAnswers, words: &str) -> Vec<CheckFinding> {
    let check = DoctorCheck::Stops;
    let in_force = stops::in_force(&answers.stops);
    let mut findings: Vec<_> = in_force
        .values()
        .map(|each| {
            let text = format!("stopped by {}: {}; to release it:", each.by, stop::what(each));
            let release = format!("althing stop --release {}{words}", shell_word(&each.id));
            check.note(text, Remedy::mend(release))
        })
        .collect();
    if findings.is_empty() {
        findings.push(check.ok("nothing is stopped"));
    }
    let buttons = hardware_stops::positions(&answers.stops);
    let silent = hardware_stops::warnings(&buttons);
    let look = || Remedy::look(format!("althing stop --list{words}"));
    let hardware = DoctorCheck::HardwareStops;
    match (silent.is_empty(), buttons.is_empty()) {
        (true, true) => findings.push(hardware.ok("there are none")),
        (true, false) => findings.push(hardware.ok("all actuators hear them")),
        (false, _) => {
            findings.extend(silent.into_iter().map(|text| hardware.problem(text, look())));
        }
    }
    findings
}

fn question(open: &OpenQuestion, words: &str) -> CheckFinding {
    let OpenQuestion { keyboard, question, from, text, .. } = open;
    let text = format!("`{from}` asks: {text}");
    // Without an answer the command prompts for it, and hides it if it is a secret.
    let answer = format!("althing answer {keyboard}/{question}{words}");
    DoctorCheck::Questions.note(text, Remedy::mend(answer))
}

fn plugins(answers: &EcosystemAnswers, words: &str, of: &str) -> Vec<CheckFinding> {
    let check = DoctorCheck::Plugins;
    let mut findings = Vec::new();
    let mut running = 0_usize;
    for list in &answers.plugins {
        for status in &list.plugins {
            match judged(status, words, of) {
                Some((is_problem, remedy)) => {
                    let reason = status.reason.as_deref().unwrap_or("no reason is known");
                    let text = format!(
                        "`{}` at `{}` is {}: {reason}",
                        status.name,
                        list.daemon,
                        status.state.as_str()
                    );
                    findings.push(match is_problem {
                        true => check.problem(text, remedy),
                        false => check.note(text, remedy),
                    });
                }
                None => running += 1,
            }
        }
    }
    if findings.is_empty() {
        findings.push(check.ok(match running {
            0 => "no plugin runs as a process".to_owned(),
            running => format!("{} without a problem", plural(running, "plugin")),
        }));
    }
    findings
}

/// Returns whether the state of a plugin is a problem, and the command about it; `None` if the state
/// is as it should be. `words` reach the running ecosystem, `of` names only its file.
fn judged(status: &PluginStatus, words: &str, of: &str) -> Option<(bool, Option<Remedy>)> {
    let name = shell_word(&status.name);
    Some(match status.state {
        PluginState::Running | PluginState::Starting | PluginState::Unused => return None,
        PluginState::Disabled => (false, Remedy::mend(format!("althing plugin enable {name}{of}"))),
        PluginState::NotAllowed => (true, Remedy::mend(format!("althing plugin allow {name}{of}"))),
        PluginState::NotConfined => (true, Remedy::look(format!("althing plugin list{words}"))),
        PluginState::Invalid | PluginState::Waiting | PluginState::GivenUp => {
            (true, Remedy::look(format!("althing plugin logs {name}{words}")))
        }
    })
}
