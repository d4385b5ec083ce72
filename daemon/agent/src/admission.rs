//! Who of those that no file names takes part: what the file says of them all, and what people
//! have said of each.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

/// What the file says of agents that it does not name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Admit {
    /// They take part.
    #[default]
    All,
    /// They are listed.
    Listed,
    /// A person is asked about each.
    Ask,
}

/// Whether somebody may take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admission {
    /// Yes.
    Granted,
    /// Not by itself: the file has to name it.
    Listed,
    /// A person has still to say so.
    Asked,
    /// A person has said no.
    Denied,
}

impl Admission {
    /// Why it does not take part, for a person; nothing where it does, or where only the file's
    /// word is missing.
    pub fn reason(self) -> Option<String> {
        match self {
            Admission::Granted | Admission::Listed => None,
            Admission::Asked => Some("a person is being asked: althing keyboard".to_owned()),
            Admission::Denied => Some("a person has refused it; name it in the file".to_owned()),
        }
    }
}

/// One that no file names, and who has found it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Applicant {
    /// What has found it: the folder of plugins, a gateway.
    pub by: String,
    /// What it is called.
    pub name: String,
}

/// Among the resources of a host: who of those that no file names takes part.
#[derive(Debug)]
pub struct Admissions {
    admit: Admit,
    known: Mutex<Known>,
    changed: watch::Sender<()>,
}

#[derive(Debug, Default)]
struct Known {
    /// What people have said.
    answers: BTreeMap<Applicant, bool>,
    /// Who is here, with a word about each for a person.
    here: BTreeMap<Applicant, String>,
}

impl Admissions {
    /// With no answers yet.
    pub fn new(admit: Admit) -> Admissions {
        Admissions { admit, known: Mutex::default(), changed: watch::Sender::new(()) }
    }

    /// Whether one may take part.
    pub fn of(&self, by: &str, name: &str) -> Admission {
        let applicant = Applicant { by: by.to_owned(), name: name.to_owned() };
        match (self.admit, self.known().answers.get(&applicant)) {
            (Admit::All, _) | (Admit::Ask, Some(true)) => Admission::Granted,
            (Admit::Listed, _) => Admission::Listed,
            (Admit::Ask, Some(false)) => Admission::Denied,
            (Admit::Ask, None) => Admission::Asked,
        }
    }

    /// Says who is here of those that `by` has found, with a word about each for a person.
    pub fn present(&self, by: &str, here: BTreeMap<String, String>) {
        if self.admit != Admit::Ask {
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

    /// Who is here and of whom nobody has said anything.
    pub fn open(&self) -> Vec<(Applicant, String)> {
        let known = self.known();
        let is_open = |applicant: &&Applicant| !known.answers.contains_key(*applicant);
        let open: BTreeSet<_> = known.here.keys().filter(is_open).collect();
        open.into_iter().map(|one| (one.clone(), known.here[one].clone())).collect()
    }

    /// Takes what people have said.
    pub fn answer(&self, answers: impl IntoIterator<Item = (Applicant, bool)>) {
        self.known().answers.extend(answers);
        self.changed.send_replace(());
    }

    /// All that people have said.
    pub fn answers(&self) -> Vec<(Applicant, bool)> {
        self.known().answers.iter().map(|(one, is_in)| (one.clone(), *is_in)).collect()
    }

    /// Tells of every change.
    pub fn changes(&self) -> watch::Receiver<()> {
        self.changed.subscribe()
    }

    fn known(&self) -> MutexGuard<'_, Known> {
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
    fn a_person_is_asked_once_of_each_that_is_here() {
        let admissions = Admissions::new(Admit::Ask);
        let mut changes = admissions.changes();
        admissions.present("zigbee", here(&["a", "b"]));
        assert!(changes.has_changed().expect("it lives"));
        changes.mark_unchanged();
        admissions.present("zigbee", here(&["a", "b"]));
        admissions.present("plugins", here(&[]));
        assert!(!changes.has_changed().expect("it lives"), "no change");
        assert_eq!(admissions.of("zigbee", "a"), Admission::Asked);
        let open: Vec<_> = admissions.open().into_iter().map(|(one, _)| one).collect();
        assert_eq!(open.len(), 2);
        admissions.answer(open.into_iter().map(|one| (one.clone(), one.name == "a")));
        assert!(admissions.open().is_empty());
        assert_eq!(admissions.of("zigbee", "a"), Admission::Granted);
        assert_eq!(admissions.of("zigbee", "b"), Admission::Denied);
        assert_eq!(admissions.of("other", "a"), Admission::Asked, "another with its name");
        admissions.present("zigbee", here(&["b", "c"]));
        let open: Vec<_> = admissions.open().into_iter().map(|(one, _)| one.name).collect();
        assert_eq!(open, ["c"]);
    }

    #[test]
    fn where_the_file_speaks_for_all_nobody_is_asked() {
        for (admit, expected) in
            [(Admit::All, Admission::Granted), (Admit::Listed, Admission::Listed)]
        {
            let admissions = Admissions::new(admit);
            admissions.present("zigbee", here(&["a"]));
            assert!(admissions.open().is_empty());
            assert_eq!(admissions.of("zigbee", "a"), expected);
        }
    }
}
