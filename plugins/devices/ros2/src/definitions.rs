//! The definitions of messages, services and actions that the config names, beside the built-in ones.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use agent::{Blueprint, BuildCheck, EcosystemFolder};
use ros_messages::{DefinitionError, Interfaces};
use serde::Deserialize;

/// Levels of folders below a named one. ROS has two: the package, and `msg`, `srv` or `action`.
const FOLDERS_DEEP: usize = 4;

/// Number of files in the named folders. A whole distribution of ROS has some two thousand
/// definitions, and three other files for each.
const FILES_MAX: usize = 20_000;

/// Longest definition in bytes; those of ROS have a few thousand.
const DEFINITION_BYTES_MAX: u64 = 1 << 20;

/// The key `definitions` of a config.
#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "`definitions` is the path of a file or folder, a list of paths, or a table of texts"
)]
pub(crate) enum DefinitionSource {
    /// A file, or a folder with files.
    Path(PathBuf),
    /// Several of these.
    Paths(Vec<PathBuf>),
    /// The texts themselves, by names such as `arm_msgs/action/Pick`.
    Texts(BTreeMap<String, String>),
}

/// All definitions of an entry.
pub(crate) struct Definitions {
    pub(crate) interfaces: Interfaces,
    /// Whether all named files were read. If not, types may be missing without a mistake.
    pub(crate) is_complete: bool,
}

impl Definitions {
    /// Reads the definitions. A relative path begins at the folder of the ecosystem file. An absolute
    /// path belongs to the agent's own machine: where an entry is only checked, it may be missing.
    ///
    /// # Errors
    ///
    /// Returns the mistake as text for a person.
    pub(crate) fn read(
        blueprint: &Blueprint,
        source: Option<DefinitionSource>,
    ) -> Result<Definitions, String> {
        let mut interfaces = Interfaces::standard();
        let paths = match source {
            None => Vec::new(),
            Some(DefinitionSource::Path(path)) => vec![path],
            Some(DefinitionSource::Paths(paths)) => paths,
            Some(DefinitionSource::Texts(texts)) => {
                for (name, text) in &texts {
                    add_text(&mut interfaces, name, text)?;
                }
                Vec::new()
            }
        };
        let resources = &blueprint.host.resources;
        let folder = resources.get::<EcosystemFolder>().map(|folder| folder.0.clone());
        let is_check = resources.get::<BuildCheck>().is_some();
        let (mut is_complete, mut files_left) = (true, FILES_MAX);
        for path in paths {
            let full = folder.as_deref().unwrap_or(Path::new("")).join(&path);
            if is_check && path.is_absolute() && !full.exists() {
                is_complete = false;
                continue;
            }
            let mut files = Vec::new();
            let failed = |error: String| format!("definitions: `{}`: {error}", path.display());
            collect(&full, FOLDERS_DEEP, &mut files_left, &mut files).map_err(failed)?;
            if files.is_empty() {
                return Err(failed("it has no file .msg, .srv or .action".to_owned()));
            }
            for file in files {
                add_file(&mut interfaces, &file)
                    .map_err(|error| format!("definitions: {error}"))?;
            }
        }
        Ok(Definitions { interfaces, is_complete })
    }
}

impl Definitions {
    /// Checks that the definition of a type is known.
    ///
    /// # Errors
    ///
    /// Returns the types of the same package and kind, as text for a person.
    pub(crate) fn check_type(&self, type_name: &str) -> Result<(), String> {
        let names = || self.interfaces.type_names();
        if !self.is_complete || names().any(|name| name == type_name) {
            return Ok(());
        }
        let folder = type_name.rsplit_once('/').map_or(type_name, |(folder, _)| folder);
        let plain = |name: &&str| !name.contains('_');
        let own = names().filter_map(|name| name.strip_prefix(folder)?.strip_prefix('/'));
        let mut known: Vec<&str> = own.filter(plain).collect();
        known.sort_unstable();
        let advice = match known.as_slice() {
            [] => format!("`definitions` has nothing of `{folder}`"),
            known => format!("`{folder}` has {}", known.join(", ")),
        };
        Err(format!("there is no definition of `{type_name}`: {advice}"))
    }
}

fn add_text(interfaces: &mut Interfaces, name: &str, text: &str) -> Result<(), String> {
    let [package, kind, plain] = name.split('/').collect::<Vec<_>>()[..] else {
        return Err(format!(
            "definitions: `{name}` is no name of a type: write `arm_msgs/action/Pick`"
        ));
    };
    let added = interfaces.add(package, &format!("{plain}.{kind}"), text);
    added.map_err(|error| format!("definitions: `{name}`: {}", mistakes(&error)))
}

fn add_file(interfaces: &mut Interfaces, file: &Path) -> Result<(), String> {
    let shown = file.display();
    let name_of = |path: &Path| {
        path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned()
    };
    // A file lies in the folder of its package, or there in a folder `msg`, `srv` or `action`.
    let parent = file.parent().unwrap_or(Path::new(""));
    let is_kind = ["msg", "srv", "action"].contains(&name_of(parent).as_str());
    let package = name_of(if is_kind { parent.parent().unwrap_or(parent) } else { parent });
    let size = fs::metadata(file).map_err(|error| format!("read `{shown}`: {error}"))?.len();
    if size > DEFINITION_BYTES_MAX {
        return Err(format!("`{shown}` has more than {DEFINITION_BYTES_MAX} bytes"));
    }
    let bytes = fs::read(file).map_err(|error| format!("read `{shown}`: {error}"))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| format!("`{shown}` is no text in UTF-8: save it with this encoding"))?;
    let added = interfaces.add(&package, &name_of(file), &text);
    added.map_err(|error| format!("`{shown}`: {}", mistakes(&error)))
}

/// Returns the mistakes of a definition without the name that `Interfaces` gives to it: the author
/// knows the definition by its path, or by its key.
fn mistakes(error: &DefinitionError) -> String {
    error.mistakes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Finds the definitions at a path, and adds them in the order of their names.
fn collect(
    path: &Path,
    levels: usize,
    files_left: &mut usize,
    files: &mut Vec<PathBuf>,
) -> Result<(), String> {
    if !path.is_dir() {
        let extension = path.extension().and_then(|extension| extension.to_str());
        if extension.is_some_and(|extension| ["msg", "srv", "action"].contains(&extension)) {
            files.push(path.to_owned());
        } else if !path.exists() {
            return Err("there is no such file or folder".to_owned());
        }
        return Ok(());
    }
    if levels == 0 {
        return Ok(());
    }
    let entries = fs::read_dir(path).map_err(|error| error.to_string())?;
    let mut inner = Vec::new();
    for entry in entries {
        *files_left = files_left
            .checked_sub(1)
            .ok_or_else(|| format!("it has more than {FILES_MAX} files: name a package"))?;
        inner.push(entry.map_err(|error| error.to_string())?.path());
    }
    inner.sort();
    inner.iter().try_for_each(|path| collect(path, levels - 1, files_left, files))
}
