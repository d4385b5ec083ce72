//! Admission of agents that the ecosystem file does not name: the policy of the file for all of
//! them, and the decisions of people about each.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

/// Policy of the ecosystem file for agents that the file does not name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AdmissionPolicy {
    /// All agents that the ecosystem file does not name take part.
    #[default]
    All,
    /// Agents that the ecosystem file does not name are listed, and do not take part until a person
    /// adds them to the file.
    Listed,
    /// A person is asked about each agent that the ecosystem file does not name.
    Ask,
}

/// Whether an agent that was found may take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdmissionStatus {
    /// The agent may take part.
    Granted,
    /// The agent may take part only after a person has added it to the ecosystem file.
    Listed,
    /// A person is asked whether the agent may take part, and has not decided yet.
    Asked,
    /// A person has declined that the agent takes part.
    Denied,
}

impl AdmissionStatus {
    /// Returns the reason, for a person, why the agent does not take part. `None` if the agent
    /// takes part, or if only its entry in the ecosystem file is missing.
    pub fn reason(self) -> Option<String> {
        match self {
            AdmissionStatus::Granted | AdmissionStatus::Listed => None,
            AdmissionStatus::Asked => Some("a person is being asked: althing keyboard".to_owned()),
            AdmissionStatus::Denied => {
                Some("a person has refused it; name it in the file".to_owned())
            }
        }
    }
}

/// An agent that the ecosystem file does not name, with its discoverer.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Applicant {
    /// Discoverer of the agent: the gateway, the board or the plugin folder that reported the
    /// agent.
    pub by: String,
    /// Name of the agent.
    pub name: String,
}

/// Resource of a host: decides which of the agents that the ecosystem file does not name take part.
#[derive(Debug)]
pub struct Admissions {
    admit: AdmissionPolicy,
    known: Mutex<AdmissionState>,
    changed: watch::Sender<()>,
}

#[derive(Debug, Default)]
struct AdmissionState {
    /// Decisions of people; `true` admits the agent.
    answers: BTreeMap<Applicant, bool>,
    /// Applicants that are present, with a description of each for a person.
    here: BTreeMap<Applicant, String>,
}

impl Admissions {
    /// Creates admissions under the policy `admit`, without any decision of a person.
    pub fn new(admit: AdmissionPolicy) -> Admissions {
        Admissions { admit, known: Mutex::default(), changed: watch::Sender::new(()) }
    }

    /// Returns whether the agent `name`, found by `by`, may take part.
    pub fn of(&self, by: &str, name: &str) -> AdmissionStatus {
        let applicant = Applicant { by: by.to_owned(), name: name.to_owned() };
        match (self.admit, self.known().answers.get(&applicant)) {
            (AdmissionPolicy::All, _) | (AdmissionPolicy::Ask, Some(true)) => {
                AdmissionStatus::Granted
            }
            (AdmissionPolicy::Listed, _) => AdmissionStatus::Listed,
            (AdmissionPolicy::Ask, Some(false)) => AdmissionStatus::Denied,
            (AdmissionPolicy::Ask, None) => AdmissionStatus::Asked,
        }
    }

    /// Replaces the list of present agents that the discoverer `by` has found; each has a
    /// description for a person. Does nothing unless the policy is to ask people.
    pub fn present(&self, by: &str, here: BTreeMap<String, String>) {
        if self.admit != AdmissionPolicy::Ask {
            return;
        }
        let mut known = self.known();
        let before = known.here.len();
        known.here.retain(|applicant, _| applicant.by != by || here.contains_key(&applicant.name));
        let left = known.here.len();
        let named = |(name, about)| (Applicant { by: by.to_owned(), name }, about);
        known.here.extend(here.into_iter().map(named));
        let is_same = before == left && known.here.len() == left;
        drop(known);
        if !is_same {
            self.changed.send_replace(());
        }
    }

    /// Returns the present agents that no person has decided about, each with its description.
    pub fn open(&self) -> Vec<(Applicant, String)> {
        let known = self.known();
        let is_open = |applicant: &&Applicant| !known.answers.contains_key(*applicant);
        let open: BTreeSet<_> = known.here.keys().filter(is_open).collect();
        open.into_iter().map(|one| (one.clone(), known.here[one].clone())).collect()
    }

    /// Records decisions of people; `true` admits the agent.
    pub fn answer(&self, answers: impl IntoIterator<Item = (Applicant, bool)>) {
        self.known().answers.extend(answers);
        self.changed.send_replace(());
    }

    /// Returns all decisions of people; `true` means that the agent was admitted.
    pub fn answers(&self) -> Vec<(Applicant, bool)> {
        self.known().answers.iter().map(|(one, is_in)| (one.clone(), *is_in)).collect()
    }

    /// Returns a receiver that is notified of every change of the present agents or of the
    /// decisions.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changed.subscribe()
    }

    fn known(&self) -> MutexGuard<'_, AdmissionState> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn here(names: &[&str]) -> BTreeMap<String, String> {
        names.iter().map(|name| ((*name).to_owned(), "office1".to_owned())).collect()
    }

    #[test]
    fn a_person_is_asked_once_about_each_present_agent() {
        let admissions = Admissions::new(AdmissionPolicy::Ask);
        let mut changes = admissions.changes();
        admissions.present("zigbee", here(&["a", "b"]));
        assert!(changes.has_changed().expect("it lives"));
        changes.mark_unchanged();
        admissions.present("zigbee", here(&["a", "b"]));
        admissions.present("plugins", here(&[]));
        assert!(!changes.has_changed().expect("it lives"), "no change");
        assert_eq!(admissions.of("zigbee", "a"), AdmissionStatus::Asked);
        let open: Vec<_> = admissions.open().into_iter().map(|(one, _)| one).collect();
        assert_eq!(open.len(), 2);
        admissions.answer(open.into_iter().map(|one| (one.clone(), one.name == "a")));
        assert!(admissions.open().is_empty());
        assert_eq!(admissions.of("zigbee", "a"), AdmissionStatus::Granted);
        assert_eq!(admissions.of("zigbee", "b"), AdmissionStatus::Denied);
        assert_eq!(admissions.of("other", "a"), AdmissionStatus::Asked, "another with its name");
        admissions.present("zigbee", here(&["b", "c"]));
        let open: Vec<_> = admissions.open().into_iter().map(|(one, _)| one.name).collect();
        assert_eq!(open, ["c"]);
    }

    #[test]
    fn no_person_is_asked_if_the_file_decides_for_all() {
        for (admit, expected) in [
            (AdmissionPolicy::All, AdmissionStatus::Granted),
            (AdmissionPolicy::Listed, AdmissionStatus::Listed),
        ] {
            let admissions = Admissions::new(admit);
            admissions.present("zigbee", here(&["a"]));
            assert!(admissions.open().is_empty());
            assert_eq!(admissions.of("zigbee", "a"), expected);
        }
    }
}
