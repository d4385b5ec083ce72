//! The facts of an agent on disk, so that a restart of the daemon does not make facts false that
//! the agent's actions have made true.

use std::path::PathBuf;
use std::{fs, io};

use acl::fnv::Fnv64;
use agent::{Blueprint, BuildCheck, StateFolder, replace_file};
use pddl::{ActionModel, InitElement};

use crate::declared::AgentFacts;

/// File with the facts of one agent. The first line is a comment with the digest of the action
/// model; each further line is a fact in PDDL.
#[derive(Clone, Debug)]
pub struct FactFile {
    /// Path of the file; `None` if nothing outlives the process.
    path: Option<PathBuf>,
    /// The first line of the file.
    header: String,
}

impl FactFile {
    /// Returns the file of an agent. Nothing is stored if the daemon has no folder for its state, or
    /// if the agent is only checked.
    pub fn of(blueprint: &Blueprint, model: &ActionModel) -> FactFile {
        let resources = &blueprint.host.resources;
        let is_check = resources.get::<BuildCheck>().is_some();
        let folder = resources.get::<StateFolder>().filter(|_| !is_check);
        let path = folder.map(|folder| folder.0.join(format!("{}.facts", blueprint.id)));
        let digest = Fnv64::default().with(model.to_string().as_bytes()).value();
        FactFile { path, header: format!("; facts of the model {digest:016x}") }
    }

    /// Returns the stored facts; `None` if there are none, or if they belong to another action
    /// model.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the file exists and cannot be read.
    pub fn read(&self) -> Result<Option<Vec<InitElement>>, String> {
        let Some(path) = &self.path else { return Ok(None) };
        let text = match fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("read {}: {error}", path.display())),
        };
        let Some(facts) = text.strip_prefix(&self.header) else { return Ok(None) };
        let facts = pddl::parse_init_elements(facts).into_result().map_err(|diagnostics| {
            let why = diagnostics.first().map(|first| first.message.clone()).unwrap_or_default();
            format!(
                "read {}: {why}; remove the file, and the facts of `:init` count again",
                path.display()
            )
        })?;
        Ok(Some(facts))
    }

    /// Replaces the stored facts, on a thread that may wait for the disk. A failure is logged: the
    /// agent continues, and a restart finds the facts that were stored before.
    pub async fn write(&self, facts: &AgentFacts) {
        let Some(path) = self.path.clone() else { return };
        let mut text = self.header.clone();
        facts.facts().for_each(|fact| text.push_str(&format!("\n{fact}")));
        text.push('\n');
        let file = path.display().to_string();
        let writing = tokio::task::spawn_blocking(move || replace_file(&path, text.as_bytes()));
        // A write that panicked has stored nothing, either.
        if let Err(error) = writing.await.unwrap_or_else(|error| Err(io::Error::other(error))) {
            tracing::error!(file, %error, "failed to store facts");
        }
    }
}
