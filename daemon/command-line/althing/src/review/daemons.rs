//! Warns about names of daemons that are probably misspelled, and about agents that no daemon hosts.
//! A daemon exists as soon as an entry names it, so a misspelled name adds a machine that does not
//! exist.

use std::collections::{BTreeMap, BTreeSet};

use acl::DaemonId;
use agent::AllowedNames;
use pddl::{Diagnostic, Span};

use super::Reviewer;
use crate::config::{AgentEntry, DEFAULT_AGENTS};

/// Length of the shortest name that is checked. Shorter names of different daemons often differ by
/// one letter, as `a` and `b`, or `pi1` and `pi2`.
const LETTERS_MIN: usize = 5;

/// The same if the other name is listed under `[ecosystem]` and this one is not.
const LETTERS_BESIDE_LIST_MIN: usize = 3;

/// Maximum number of daemons that a correction names.
const NAMED_MAX: usize = 5;

impl Reviewer<'_> {
    /// Warns about an agent that no daemon hosts, and about a daemon that is named only once if its
    /// name resembles that of a daemon that is named more often.
    pub(super) fn daemons(&mut self) {
        self.agents_without_daemon();
        self.misspelt_daemons();
        self.misspelt_guests();
    }

    /// A single daemon hosts the agents that name none. Of several, each hosts those that name it.
    fn agents_without_daemon(&mut self) {
        let daemons: Vec<&str> = self.ecosystem.daemons.iter().map(DaemonId::as_str).collect();
        let [first, _, ..] = daemons.as_slice() else { return };
        let unassigned = self.ecosystem.unassigned_agents().filter(|entry| !entry.is_default());
        let named = daemons[..daemons.len().min(NAMED_MAX)].join(", ");
        let further = if daemons.len() > NAMED_MAX { ", …" } else { "" };
        let help = format!("write daemon = \"{first}\" in it; the daemons are {named}{further}");
        let found: Vec<_> = unassigned
            .map(|entry| {
                let message =
                    format!("no daemon hosts `{}`: its entry has no key `daemon`", entry.name);
                let found = Diagnostic::warning(Span::default(), message).with_help(&help);
                (entry.path.clone(), found)
            })
            .collect();
        for (path, found) in found {
            self.report_key(&path, found);
        }
    }

    fn misspelt_daemons(&mut self) {
        let named = self.named_daemons();
        let listed: BTreeSet<&str> = self.listed_daemons();
        let is_sure = |name: &str| {
            named.get(name).is_some_and(|paths| paths.len() > 1) || listed.contains(name)
        };
        let mut slips = Vec::new();
        for (name, paths) in &named {
            let [path] = &paths[..] else { continue };
            if is_sure(name) {
                continue;
            }
            let known = named.keys().map(String::as_str).chain(listed.iter().copied());
            let mut others = known.filter(|other| other != name);
            // A name that belongs to a series of similar names is intended.
            if others.clone().any(|other| are_siblings(name, other)) {
                continue;
            }
            // If two similar names occur once each, the one that contains the name of a place
            // counts as correct, and the one that hosts a device, not only agents that plan.
            let hosts_planners_only = path.starts_with(DEFAULT_AGENTS);
            let is_right = |other: &str| {
                let is_long = name.len() >= LETTERS_MIN;
                name.len() >= LETTERS_BESIDE_LIST_MIN && listed.contains(other)
                    || is_long && (is_sure(other) || hosts_planners_only)
                    || is_long && self.names_a_place(other) && !self.names_a_place(name)
            };
            if let Some(meant) = others.find(|other| is_slip(name, other) && is_right(other)) {
                slips.push((path.clone(), name.clone(), meant.to_owned()));
            }
        }
        for (path, name, meant) in slips {
            let message = format!("the daemon `{name}` is named nowhere else");
            let help = format!(
                "did you mean `{meant}`? If it is another machine, list it: daemons = [\"{name}\"] \
                 under [ecosystem]"
            );
            self.report_value(&path, Diagnostic::warning(Span::default(), message).with_help(help));
        }
    }

    /// Warns about names in `[rights]` that resemble that of a daemon. People take part through
    /// machines that host no agent, too: a name that resembles none is right.
    fn misspelt_guests(&mut self) {
        let rights = &self.ecosystem.rights;
        let mut slips = Vec::new();
        for (key, allowed) in [("guests", &rights.guests), ("newcomers", &rights.newcomers)] {
            let AllowedNames::These(names) = allowed else { continue };
            let is_unknown = |name: &&DaemonId| {
                name.as_str().len() >= LETTERS_BESIDE_LIST_MIN
                    && !self.ecosystem.daemons.contains(*name)
            };
            for name in names.iter().filter(is_unknown) {
                let name = name.as_str();
                let mut daemons = self.ecosystem.daemons.iter().map(DaemonId::as_str);
                let meant =
                    daemons.find(|other| is_slip(name, other) && !are_siblings(name, other));
                if let Some(meant) = meant {
                    let message = format!("no daemon of this file is called `{name}`");
                    let help = format!("did you mean `{meant}`?");
                    slips.push((
                        format!("rights.{key}"),
                        Diagnostic::warning(Span::default(), message).with_help(help),
                    ));
                }
            }
        }
        for (path, found) in slips {
            self.report_value(&path, found);
        }
    }

    /// Whether the name of a daemon is the name of a place, or begins with the name of a place and
    /// a hyphen.
    fn names_a_place(&self, daemon: &str) -> bool {
        let mut objects = self.ecosystem.problem.objects.iter();
        objects.any(|declaration| {
            let name = declaration.object.name.as_str();
            daemon == name || daemon.strip_prefix(name).is_some_and(|rest| rest.starts_with('-'))
        })
    }

    /// Returns the names of all daemons, each with the paths in the ecosystem file at which it is
    /// named.
    fn named_daemons(&self) -> BTreeMap<String, Vec<String>> {
        let mut named: BTreeMap<String, Vec<String>> = BTreeMap::new();
        // All agents that are there by themselves have their daemons from one key.
        let is_repeated =
            |entry: &&AgentEntry| entry.is_default() && entry.plugin != plan_requester::PLUGIN.name;
        for entry in self.ecosystem.agents.iter().filter(|entry| !is_repeated(entry)) {
            for (index, daemon) in entry.daemons.iter().enumerate() {
                let path = match entry.is_default() {
                    true => format!("{}.{index}", entry.path),
                    false => format!("{}.daemon.{index}", entry.path),
                };
                named.entry(daemon.to_string()).or_default().push(path);
            }
        }
        for (index, interface) in self.ecosystem.interfaces.iter().enumerate() {
            if let Some(daemon) = &interface.daemon {
                let path = format!("interface.{index}.daemon");
                named.entry(daemon.to_string()).or_default().push(path);
            }
        }
        named
    }

    /// Returns the names of the daemons that the ecosystem file lists under `[ecosystem]`.
    fn listed_daemons(&self) -> BTreeSet<&str> {
        let is_listed = |daemon: &&DaemonId| {
            let places = self.ecosystem.places.under("ecosystem.daemons");
            places.into_iter().any(|text| text.trim_matches(['"', '\'']) == daemon.as_str())
        };
        self.ecosystem.daemons.iter().filter(is_listed).map(DaemonId::as_str).collect()
    }
}

/// Whether two names differ so little that one may be misspelled: by one letter that is added,
/// missing or wrong, or by two letters that are swapped.
fn is_slip(one: &str, other: &str) -> bool {
    strsim::damerau_levenshtein(one, other) == 1
}

/// Whether two names differ only in numbers, or in single letters between hyphens (`room-101-pi`
/// and `room-102-pi`, `lab-a` and `lab-b`).
fn are_siblings(one: &str, other: &str) -> bool {
    let stem = |name: &str| -> Vec<String> {
        let words = name.split(['-', '_']);
        let stems = words.map(|word| word.chars().filter(|c| !c.is_ascii_digit()).collect());
        stems.filter(|stem: &String| stem.chars().count() > 1).collect()
    };
    stem(one) == stem(other)
}

#[cfg(test)]
mod tests {
    use super::{are_siblings, is_slip};

    #[test]
    fn a_typing_error_is_one_letter() {
        for (one, other, expected) in [
            ("hal-pi", "hall-pi", true),
            ("ofifce-pc", "office-pc", true),
            ("room-101-pi", "robot-1-pi", false),
            ("attic", "cellar", false),
        ] {
            assert_eq!(is_slip(one, other), expected, "{one} {other}");
        }
    }

    #[test]
    fn names_of_a_series_differ_in_numbers_or_letters() {
        for (one, other, expected) in [
            ("room-101-pi", "room-102-pi", true),
            ("office-pi", "office1-pi", true),
            ("lab-a-pi", "lab-b-pi", true),
            ("hal-pi", "hall-pi", false),
            ("ofice-pc", "office-pc", false),
        ] {
            assert_eq!(are_siblings(one, other), expected, "{one} {other}");
        }
    }
}
