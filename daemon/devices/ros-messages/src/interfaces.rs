//! All known definitions, by the names of their types.

use std::collections::{BTreeSet, HashMap};

use serde_json::Value;

use crate::errors::{DefinitionError, DefinitionMistake, UnknownTypeError};
use crate::interface_file::{self, NamedStructures};
use crate::standard::DEFINITIONS;
use crate::structure::{MessageStructure, StructureRole};

/// Definitions of messages, services and actions. A type has its full name, such as
/// `geometry_msgs/msg/Pose`, `std_srvs/srv/Trigger_Request` or
/// `nav2_msgs/action/NavigateToPose_FeedbackMessage`.
#[derive(Clone, Debug, Default)]
pub struct Interfaces {
    structures: HashMap<String, MessageStructure>,
}

impl Interfaces {
    /// Returns the built-in definitions, those of ROS 2 Jazzy; `definitions/` has their texts.
    pub fn standard() -> Interfaces {
        let mut interfaces = Interfaces::default();
        for (package, file_name, text) in DEFINITIONS {
            let added = interfaces.add(package, file_name, text);
            added.expect("invariant: a test adds every built-in definition");
        }
        interfaces
    }

    /// Adds the definition `text`, as in a file such as `NavigateToPose.action`. It replaces a
    /// known definition of the same name, and may name types that are added later.
    ///
    /// # Errors
    ///
    /// Returns all mistakes of the definition, and adds nothing.
    pub fn add(
        &mut self,
        package: &str,
        file_name: &str,
        text: &str,
    ) -> Result<(), DefinitionError> {
        let structures = interface_file::read(package, file_name, text)?;
        let mistakes = self.circles(&structures);
        if !mistakes.is_empty() {
            return Err(DefinitionError { file: format!("{package}/{file_name}"), mistakes });
        }
        self.structures.extend(structures);
        Ok(())
    }

    /// Returns the types that known definitions name and that are not known themselves, each once.
    /// Without them, messages that contain them are neither encoded nor decoded.
    pub fn unresolved(&self) -> Vec<UnknownTypeError> {
        let references = self.structures.iter().flat_map(|(of, structure)| {
            structure.references().map(move |(field, name)| (name, of, &field.name))
        });
        let missing: BTreeSet<_> =
            references.filter(|(name, ..)| !self.structures.contains_key(*name)).collect();
        let mut errors: Vec<UnknownTypeError> = Vec::new();
        for (name, of, field) in missing {
            if errors.last().is_none_or(|last| last.name != name) {
                let advice = format!("add its definition, which `{field}` of `{of}` needs");
                errors.push(UnknownTypeError { name: name.to_owned(), advice });
            }
        }
        errors
    }

    /// Returns the names of all types, in no particular order.
    pub fn type_names(&self) -> impl Iterator<Item = &str> {
        self.structures.keys().map(String::as_str)
    }

    /// Returns the constants of a message with their values, sorted by name; none if the type is
    /// not known.
    pub fn constants(&self, type_name: &str) -> impl Iterator<Item = (&str, &Value)> {
        let structure = self.structures.get(type_name);
        let constants = structure.into_iter().flat_map(|structure| &structure.constants);
        constants.map(|(name, value)| (name.as_str(), value))
    }

    /// Returns the structure of a message, a service or an action.
    pub(crate) fn structure(&self, name: &str) -> Result<&MessageStructure, UnknownTypeError> {
        self.structures.get(name).ok_or_else(|| self.unknown(name))
    }

    /// Returns the structure of a message. Returns an error for a service or an action, which has
    /// no encoding.
    pub(crate) fn message(&self, name: &str) -> Result<&MessageStructure, UnknownTypeError> {
        let structure = self.structure(name)?;
        let advice = match structure.role {
            StructureRole::Message => return Ok(structure),
            StructureRole::Service => {
                format!(
                    "a service has no encoding; its messages are `{name}_Request` and `_Response`"
                )
            }
            StructureRole::Action => format!(
                "an action has no encoding; its messages are `{name}_SendGoal_Request` and others"
            ),
        };
        Err(UnknownTypeError { name: name.to_owned(), advice })
    }

    /// Returns the error for a name that is not known. The error names a known type with a similar
    /// name, if there is one.
    fn unknown(&self, name: &str) -> UnknownTypeError {
        let package = name.split('/').next();
        let last = name.rsplit('/').next().map(str::to_lowercase);
        let is_similar = |known: &&String| {
            known.split('/').next() == package
                && known.rsplit('/').next().map(str::to_lowercase) == last
        };
        let advice = match self.structures.keys().find(is_similar) {
            Some(similar) => format!("its name is `{similar}`"),
            None => {
                "add its definition; a full name is such as `geometry_msgs/msg/Pose`".to_owned()
            }
        };
        UnknownTypeError { name: name.to_owned(), advice }
    }

    /// Returns a mistake for each field of the new structures `added` by which a structure would
    /// contain itself.
    fn circles(&self, added: &NamedStructures) -> Vec<DefinitionMistake> {
        let added: HashMap<_, _> = added.iter().map(|(name, of)| (name.as_str(), of)).collect();
        let find = |name: &str| added.get(name).copied().or_else(|| self.structures.get(name));
        let mut mistakes = Vec::new();
        for (name, structure) in &added {
            for (field, reference) in structure.references() {
                let (mut seen, mut queue) = (BTreeSet::new(), vec![reference]);
                while let Some(next) = queue.pop().filter(|next| next != name) {
                    let references = find(next).into_iter().flat_map(|next| next.references());
                    queue
                        .extend(references.map(|(_, next)| next).filter(|next| seen.insert(*next)));
                }
                let is_circle = reference == *name || seen.contains(name);
                if is_circle {
                    let (line, column) = field.place;
                    let problem = format!("`{name}` would contain itself; ROS has no such types");
                    let found = field.name.clone();
                    mistakes.push(DefinitionMistake { line, column, found, problem });
                }
            }
        }
        mistakes
    }
}
