//! What `althing doctor` examines: an ecosystem, as far as it can be found, and the part of it that
//! this machine hosts.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use acl::{DaemonId, EcosystemId};
use terminal::report::DiagnosticReport;

use super::file;
use super::finding::Remedy;
use crate::cli::ReachArgs;
use crate::cli::doctor::DoctorArgs;
use crate::commands::client::{reach_words, running_here, shell_word};
use crate::config::{self, AgentEntry, Ecosystem};
use crate::hosting::HostedPart;

/// The ecosystem that is examined. Each part is missing if it cannot be found or read.
#[cfg_attr(test, derive(Default))]
pub(super) struct DoctorSubject {
    /// The ecosystem file.
    pub(super) file: Option<PathBuf>,
    pub(super) ecosystem: Option<Arc<Ecosystem>>,
    /// The mistakes in the file.
    pub(super) report: DiagnosticReport,
    pub(super) name: Option<EcosystemId>,
    /// The part of the ecosystem that this machine hosts.
    pub(super) part: Option<HostedPart>,
    /// How the user named the ecosystem and its daemons.
    pub(super) reach: ReachArgs,
    /// The ecosystems that run here, if the user named none.
    pub(super) running: Vec<EcosystemId>,
}

impl DoctorSubject {
    /// Returns the command that shows the mistakes of the ecosystem file.
    pub(super) fn check_command(&self) -> Option<Remedy> {
        let file = self.file.as_ref()?.to_string_lossy().into_owned();
        Remedy::look(format!("althing check {}", shell_word(&file)))
    }

    /// Finds what the user means: the ecosystem of the arguments, the one of the file in the current
    /// folder, or the only one that runs on this machine.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the user named an ecosystem or a daemon that does
    /// not exist.
    pub(super) fn find(args: &DoctorArgs) -> Result<DoctorSubject, String> {
        let asked = args.file.clone().or_else(|| args.reach.ecosystem.clone());
        let reach = ReachArgs { ecosystem: asked.clone(), ..args.reach.clone() };
        let mut named = None;
        let file = match &asked {
            Some(asked) => match config::resolve_ecosystem(asked) {
                Ok(file) => Some(file),
                // A name without a file is enough, because the ecosystem's daemons may run here.
                Err(problem) => match EcosystemId::new(asked) {
                    Ok(name) => {
                        named = Some(name);
                        None
                    }
                    Err(_) => return Err(format!("failed to {problem}")),
                },
            },
            None => config::find_ecosystem_file(),
        };
        let (ecosystem, report) = file.as_deref().map(file::read).unwrap_or_default();
        let part = match &ecosystem {
            Some(ecosystem) => match HostedPart::find(ecosystem, args.daemon.as_deref()) {
                Ok(part) => Some(part),
                Err(problem) if args.daemon.is_some() => return Err(problem),
                // A machine of a person hosts no part of a secured ecosystem.
                Err(_) => None,
            },
            None => None,
        };
        let running = match (&file, &named) {
            (None, None) => running_here(),
            _ => Vec::new(),
        };
        let only = || running.first().filter(|_| running.len() == 1).cloned();
        let of_file = ecosystem.as_ref().map(|ecosystem| ecosystem.name.clone());
        let name = of_file.or(named).or_else(only);
        let ecosystem = ecosystem.map(Arc::new);
        Ok(DoctorSubject { file, ecosystem, report, name, part, reach, running })
    }

    /// Whether there is an ecosystem file that cannot be read as one.
    pub(super) fn is_unread(&self) -> bool {
        self.file.is_some() && self.ecosystem.is_none()
    }

    /// Returns the daemon of this machine; `None` if it is not known.
    pub(super) fn daemon(&self) -> Option<&DaemonId> {
        self.part.as_ref().map(|part| &part.daemon)
    }

    /// Returns the entries of the agents that this machine hosts.
    pub(super) fn agents(&self) -> &[AgentEntry] {
        self.part.as_ref().map(|part| part.agents.as_slice()).unwrap_or_default()
    }

    /// Returns the folder of plugins that the file names.
    pub(super) fn plugins_folder(&self) -> Option<&Path> {
        self.ecosystem.as_ref()?.plugins.folder.as_deref()
    }

    /// Returns the options of commands that reach the same ecosystem.
    pub(super) fn words(&self) -> String {
        reach_words(&self.reach)
    }

    /// Returns the option of commands that need the ecosystem's name or file, and no daemon of it.
    pub(super) fn ecosystem_words(&self) -> String {
        let named = self.reach.ecosystem.as_ref();
        named.map(|named| format!(" --ecosystem {}", shell_word(named))).unwrap_or_default()
    }

    /// Returns the path of the ecosystem file as a word of a command line; empty without a file.
    pub(super) fn file_word(&self) -> String {
        self.file.as_ref().map(|file| shell_word(&file.to_string_lossy())).unwrap_or_default()
    }
}
