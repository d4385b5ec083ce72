//! SIGHUP: the daemon reads the ecosystem file again and applies what has changed.
//!
//! Agents of built-in plugins are added, removed and restarted. Changed goals need no action,
//! because each command reads the named goals itself. Everything else, such as the map, is fixed
//! when a daemon starts. If that has changed, the daemon reports it, cancels its commitments and
//! restarts itself under the same process id. If the file has a mistake, the daemon changes
//! nothing.

use agent::{AgentSettings, ModelPrivacy};
use std::collections::BTreeSet;
use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use ::building::Building;
use acl::AgentId;
use terminal::output;
use tokio::signal::unix::{Signal, SignalKind, signal};

use super::read;
use crate::config::{AgentEntry, Ecosystem, Overrides};
use crate::hosting::{self, DaemonNode, HostedPart, ReadText};

/// The daemon's current configuration, and what is needed to read it again.
pub(super) struct Reload {
    pub(super) file: PathBuf,
    pub(super) overrides: Overrides,
    /// The name of the daemon that the command line gives by `--daemon`.
    pub(super) asked: Option<String>,
    /// The goals that the command line gives.
    pub(super) goals: Vec<String>,
    pub(super) ecosystem: Arc<Ecosystem>,
    pub(super) place: HostedPart,
    /// The simulated building; `None` if another process simulates it, or if no agent needs it.
    pub(super) building: Option<Building>,
    /// The stream of SIGHUP signals; `None` if the daemon does not listen for SIGHUP.
    pub(super) hangups: Option<Signal>,
    /// Whether the daemon was started in a terminal.
    pub(super) had_terminal: bool,
    /// The text of the file that was read last, for commands that change it.
    pub(super) read_text: ReadText,
}

/// The reaction of a daemon to SIGHUP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReloadOutcome {
    Continue,
    Restart,
}

/// The differences between the agents of the ecosystem file before and after it was read again.
#[derive(Debug, Default, PartialEq, Eq)]
struct AgentChanges {
    come: BTreeSet<AgentId>,
    gone: BTreeSet<AgentId>,
    changed: BTreeSet<AgentId>,
}

/// Starts to listen for SIGHUP; returns `None` if the kernel refuses that.
fn listen() -> Option<Signal> {
    let listening = signal(SignalKind::hangup());
    listening.inspect_err(|error| tracing::warn!(%error, "failed to listen for SIGHUP")).ok()
}

/// Waits for SIGHUP. Never returns if the daemon does not listen for SIGHUP.
pub(super) async fn asked_for(hangups: &mut Option<Signal>) {
    let hangup = match hangups {
        Some(hangups) => hangups.recv().await,
        None => None,
    };
    if hangup.is_none() {
        std::future::pending().await
    }
}

impl Reload {
    /// Listens for SIGHUP from now on, and lets commands see which text of the file was read.
    pub(super) fn begin(&mut self) {
        self.hangups = listen();
        self.had_terminal = std::io::stdin().is_terminal();
        if self.hangups.is_some() {
            self.read_text.set(&self.ecosystem);
        }
    }

    /// Reads the ecosystem file again. Mistakes are shown with their places. A file with which this
    /// daemon could not start again has a mistake, too.
    fn read(&self) -> Result<(Ecosystem, HostedPart), ExitCode> {
        let (ecosystem, place) = read(&self.file, &self.overrides, self.asked.as_deref())?;
        if place.daemon == self.place.daemon {
            super::check_start(&ecosystem, &place, &self.goals)?;
        }
        Ok((ecosystem, place))
    }

    /// Reads the ecosystem file again, and applies the changes that are possible in a running
    /// daemon. Prints the changes. Returns whether the daemon continues or has to restart itself.
    pub(super) async fn again(&mut self, node: &mut DaemonNode) -> ReloadOutcome {
        let file = self.file.display().to_string();
        let Ok((ecosystem, place)) = self.read() else {
            output::print_note(&format!("SIGHUP: {file} has mistakes; nothing is changed"));
            return ReloadOutcome::Continue;
        };
        if place.daemon != self.place.daemon {
            output::print_note(&format!(
                "SIGHUP: in {file} this is now daemon `{}`, and no longer `{}`; restart it",
                place.daemon, self.place.daemon
            ));
            return ReloadOutcome::Continue;
        }
        let fixed = fixed(&self.ecosystem, &ecosystem, &self.goals);
        if !fixed.is_empty() {
            output::print_note(&format!(
                "SIGHUP: {file} was read again\n  this daemon restarts itself, because what has \
                 changed is read at the start only: {}",
                fixed.join(", ")
            ));
            return ReloadOutcome::Restart;
        }
        node.expect_agents(&ecosystem);
        let (old, new) = (built_in(&self.place.agents), built_in(&place.agents));
        let mut difference = AgentChanges::between(&old, &new);
        let mut said = vec![format!("SIGHUP: {file} was read again")];
        let goals = changed_goals(&self.ecosystem, &ecosystem);
        if !goals.is_empty() {
            said.push(format!("goals from now on: {}", goals.join(", ")));
        }
        let leaving = difference.gone.union(&difference.changed).cloned().collect();
        node.stop_agents(&leaving).await;
        if let Some(building) = &self.building {
            said.extend(hosting::update_devices(building, &ecosystem, &leaving));
        }
        let mut kept = self.place.agents.clone();
        kept.retain(|entry| !leaving.contains(&entry.name));
        for entry in &new {
            let before = old.iter().find(|other| other.name == entry.name);
            let is_new = difference.come.contains(&entry.name);
            if !is_new && !difference.changed.contains(&entry.name) {
                continue;
            }
            match node.add_agent((*entry).clone()) {
                Ok(()) => kept.push((*entry).clone()),
                Err(error) => {
                    said.push(format!("`{}` is not started: failed to {error}", entry.name));
                    difference.come.remove(&entry.name);
                    difference.changed.remove(&entry.name);
                    let again = before.filter(|entry| node.add_agent((**entry).clone()).is_ok());
                    kept.extend(again.map(|entry| (*entry).clone()));
                }
            }
        }
        difference.tell(&mut said);
        if said.len() == 1 {
            said.push("nothing that concerns this daemon has changed".to_owned());
        }
        output::print_note(&said.join("\n  "));
        self.place.agents = kept;
        self.read_text.set(&ecosystem);
        self.ecosystem = Arc::new(ecosystem);
        ReloadOutcome::Continue
    }
}

fn built_in(agents: &[AgentEntry]) -> Vec<&AgentEntry> {
    agents.iter().filter(|entry| entry.is_built_in()).collect()
}

/// Whether two entries define the same agent in the same way, wherever they stand in the file.
fn is_same(one: &AgentEntry, other: &AgentEntry) -> bool {
    let AgentEntry { path: _, name, plugin, package, daemons, driver, config } = one;
    (name, plugin, package) == (&other.name, &other.plugin, &other.package)
        && (daemons, driver, config) == (&other.daemons, &other.driver, &other.config)
}

impl AgentChanges {
    fn between(old: &[&AgentEntry], new: &[&AgentEntry]) -> AgentChanges {
        let mut difference = AgentChanges::default();
        for entry in new {
            match old.iter().find(|other| other.name == entry.name) {
                None => drop(difference.come.insert(entry.name.clone())),
                Some(other) if !is_same(entry, other) => {
                    difference.changed.insert(entry.name.clone());
                }
                Some(_) => (),
            }
        }
        let is_gone = |entry: &&&AgentEntry| new.iter().all(|other| other.name != entry.name);
        difference.gone = old.iter().filter(is_gone).map(|entry| entry.name.clone()).collect();
        difference
    }

    fn tell(&self, said: &mut Vec<String>) {
        for (what, agents) in [
            ("agents that are new", &self.come),
            ("agents that have left", &self.gone),
            ("agents that were restarted", &self.changed),
        ] {
            let names: Vec<_> = agents.iter().map(|agent| format!("`{agent}`")).collect();
            if !names.is_empty() {
                said.push(format!("{what}: {}", names.join(", ")));
            }
        }
    }
}

/// Returns the names of the goals that were added, removed or changed.
fn changed_goals(old: &Ecosystem, new: &Ecosystem) -> Vec<String> {
    let names: BTreeSet<&String> = old.goals.keys().chain(new.goals.keys()).collect();
    let meaning = |of: &Ecosystem, name: &str| of.goals.get(name).map(|wish| format!("{wish:?}"));
    let changed = names.into_iter().filter(|name| meaning(old, name) != meaning(new, name));
    let said = changed.map(|name| match new.goals.contains_key(name) {
        true => format!("`{name}`"),
        false => format!("no `{name}`"),
    });
    said.collect()
}

/// Returns the changed parts of the file that a daemon reads only when it starts, named as in the
/// file.
fn fixed(old: &Ecosystem, new: &Ecosystem, asked: &[String]) -> Vec<String> {
    fn debug(value: &impl std::fmt::Debug) -> String {
        format!("{value:?}")
    }
    let packages = |of: &Ecosystem| -> Vec<(String, String)> {
        let others = of.agents.iter().filter(|entry| !entry.is_built_in());
        let all = others.map(|entry| {
            let AgentEntry { path: _, name, plugin, package, daemons, driver, config } = entry;
            (name.to_string(), debug(&(plugin, package, daemons, driver, config)))
        });
        all.collect()
    };
    let journals = |of: &Ecosystem| of.journals().cloned().collect::<Vec<_>>();
    let wish = |of: &Ecosystem, goal: &String| debug(&of.find_goal(goal).ok());
    let goals: Vec<_> =
        asked.iter().filter(|goal| wish(old, goal) != wish(new, goal)).cloned().collect();
    let times =
        |of: &Ecosystem| AgentSettings { privacy: ModelPrivacy::default(), ..of.settings.clone() };
    // Rights follow from the agents of each daemon, and are enforced only in a secured ecosystem.
    let is_secured = new.security.is_some();
    let parts = [
        ("the ecosystem's name", old.name != new.name),
        ("the domain file", old.domain.to_string() != new.domain.to_string()),
        ("the map (rooms, doors, ways)", old.problem.to_string() != new.problem.to_string()),
        ("`mode` (`althing mode` changes it at once)", old.mode != new.mode),
        ("`privacy`", old.settings.privacy != new.settings.privacy),
        ("`[timing]`, `[limits]` or the names of agents that reason", times(old) != times(new)),
        ("`[zenoh]`", old.zenoh != new.zenoh),
        ("`[security]`", debug(&old.security) != debug(&new.security)),
        ("rights", is_secured && old.rights != new.rights),
        ("`[people]`", old.people != new.people),
        ("`[safeguards]`", debug(&old.safeguards) != debug(&new.safeguards)),
        ("`[hardware-stops]`", old.hardware_stops != new.hardware_stops),
        ("`[plugins]`", debug(&old.plugins) != debug(&new.plugins)),
        ("agents of packages", packages(old) != packages(new)),
        ("the list of Journals", journals(old) != journals(new)),
        ("`[metrics]`", old.metrics != new.metrics),
        ("`[web]`", old.web != new.web),
        (
            "goals that are asked for by themselves",
            old.goals.by_themselves != new.goals.by_themselves,
        ),
        ("`[building]`", debug(&old.building) != debug(&new.building)),
        ("`[[interface]]`", debug(&old.interfaces) != debug(&new.interfaces)),
    ];
    let differs = parts.into_iter().filter(|(_, differs)| *differs);
    let mut fixed: Vec<String> = differs.map(|(part, _)| part.to_owned()).collect();
    fixed.extend(goals.iter().map(|goal| format!("the goal `{goal}` of the command line")));
    fixed
}
