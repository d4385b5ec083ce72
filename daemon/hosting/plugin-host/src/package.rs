//! Package: a folder with a manifest, a program, and possibly a template of an action model.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use acl::AgentId;
use acl::content::Methods;
use pddl::{ActionModel, Diagnostic, Span};
use serde_json::Value;
use terminal::report::reason;

use crate::manifest::{MANIFEST_BYTES_MAX, PackageManifest, stays_within};
use crate::program::{self, ResolvedProgram};
use crate::template;

/// Name of the manifest file; a folder with this file is a package.
pub const MANIFEST: &str = "plugin.toml";

/// Longest template of an action model that is accepted, in bytes.
const MODEL_BYTES_MAX: u64 = 1 << 20;

/// Maximum number of files of a package that are checked for changes; changes of further files are
/// not noticed. A package with its libraries has hundreds of files.
const FILES_MAX: usize = 10_000;

/// A package that was read and checked without finding a mistake.
#[derive(Clone, Debug)]
pub struct Package {
    /// Path of the package's folder.
    pub folder: PathBuf,
    /// Parsed manifest of the package.
    pub manifest: PackageManifest,
    /// Text of the package's manifest.
    text: String,
    /// Text of the template of the package's action model; `None` if the package has none.
    template: Option<String>,
}

/// Mistakes of a package, either in one of its files or about the package as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct PackageFaults {
    /// File with the mistakes; the package's folder if the mistakes are about the package as a
    /// whole.
    pub file: PathBuf,
    /// Text of the file with the mistakes; empty if the file could not be read.
    pub text: String,
    /// The mistakes, with their places in the text of the file.
    pub found: Vec<Diagnostic>,
}

/// Stamp of a package, which differs if a file has changed. For each file, the stamp has the size
/// mixed with the inode number, and the time of the last change.
pub(crate) type Stamp = BTreeMap<PathBuf, (u64, Option<SystemTime>)>;

impl Package {
    /// Reads the package in a folder and checks that its parts are consistent.
    ///
    /// # Errors
    ///
    /// Returns the mistakes of the package.
    pub fn open(folder: &Path) -> Result<Package, PackageFaults> {
        let file = folder.join(MANIFEST);
        let text = read(&file, MANIFEST_BYTES_MAX).map_err(|error| {
            about(folder, format!("failed to read `{}`: {}", file.display(), reason(&error)))
        })?;
        let manifest = PackageManifest::read(&text).map_err(|found| {
            let (file, text) = (file.clone(), text.clone());
            PackageFaults { file, text, found }
        })?;
        let wrong = |message: String| {
            let found = vec![Diagnostic::error(Span::default(), message)];
            PackageFaults { file: file.clone(), text: text.clone(), found }
        };
        let called = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if called != manifest.name {
            let name = &manifest.name;
            return Err(wrong(format!(
                "the folder is called `{called}`, and the plugin in it `{name}`: call both the same"
            )));
        }
        let template = manifest.model.as_ref().map(|path| {
            if !stays_within(path) {
                return Err(wrong(format!("model `{}` is not in the package", path.display())));
            }
            read(&folder.join(path), MODEL_BYTES_MAX).map_err(|error| {
                wrong(format!("failed to read the model `{}`: {}", path.display(), reason(&error)))
            })
        });
        let template = template.transpose()?;
        if let (Some(text), Some(path)) = (&template, &manifest.model) {
            let found = template::mistakes(text, &manifest.config);
            if !found.is_empty() {
                return Err(PackageFaults { file: folder.join(path), text: text.clone(), found });
            }
        }
        let text_of_it = text.clone();
        let package = Package { folder: folder.to_owned(), manifest, text: text_of_it, template };
        package.has_program().map_err(&wrong)?;
        for agent in &package.manifest.agents {
            if let Some(problem) = package.manifest.problem_with(&agent.config) {
                return Err(wrong(format!("agent `{}`: {problem}", agent.name)));
            }
            let described = package.model(&agent.name, &agent.config).map_err(&wrong)?;
            let objection = described
                .and_then(|(_, own)| package.objection(&own, &package.manifest.methods, None));
            objection.map_or(Ok(()), |why| Err(wrong(format!("agent `{}`: {why}", agent.name))))?;
        }
        Ok(package)
    }

    /// Checks that the program of the package exists and can be executed.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the program does not exist or cannot be executed.
    fn has_program(&self) -> Result<(), String> {
        program::candidates(&self.folder, self.called(), &program::own_path()).map(drop)
    }

    /// Returns a mistake that shows only when the program is started, with the place of `run` in
    /// the manifest as its place.
    pub fn fault_of_program(&self, message: String, help: Option<String>) -> PackageFaults {
        let mistake = Diagnostic::error(self.manifest.run_place, message);
        let mistake = help.into_iter().fold(mistake, Diagnostic::with_help);
        let (file, text) = (self.folder.join(MANIFEST), self.text.clone());
        PackageFaults { file, text, found: vec![mistake] }
    }

    /// Resolves the program that is really executed, through shims, links and first lines of
    /// scripts.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the program does not exist or cannot be run.
    pub(crate) async fn program(&self) -> Result<ResolvedProgram, String> {
        let (folder, read) = (&self.folder, &self.manifest.permissions.read);
        let scope = program::ProgramScope { folder, read, path: &program::own_path() };
        program::resolve(scope, self.called()).await
    }

    /// Returns the name of the program as written in the manifest.
    fn called(&self) -> &str {
        self.manifest.run.first().map(String::as_str).unwrap_or_default()
    }

    /// Returns the action model of an agent of this package, as text and parsed; `None` if the
    /// package has no model.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the template fails or does not yield an action model of
    /// this agent.
    pub fn model(
        &self,
        agent: &AgentId,
        config: &Value,
    ) -> Result<Option<(String, ActionModel)>, String> {
        let (Some(template), Some(path)) = (&self.template, &self.manifest.model) else {
            return Ok(None);
        };
        let name = path.display().to_string();
        let text = template::filled_in(template, &name, (agent, config))?;
        let model = pddl::parse_action_model(&text).into_result().map_err(|found| {
            let first = found.first().map(|mistake| mistake.located(&text)).unwrap_or_default();
            format!("the model in `{name}`, filled in for `{agent}`: {first}")
        })?;
        if model.agent != agent.as_str() {
            return Err(format!(
                "the model in `{name}` is for `{}`, not for `{agent}`: write \
                 (agent {{{{ agent }}}})",
                model.agent
            ));
        }
        Ok(Some((text, model)))
    }

    /// Returns the reason why an agent with the action model `said` and these methods is rejected;
    /// `None` if the agent is accepted. All actions and methods of the agent must be in the
    /// manifest. They must equal those of `own`, the action model that the package has for the
    /// agent, if there is one.
    pub fn objection(
        &self,
        said: &ActionModel,
        methods: &Methods,
        own: Option<&ActionModel>,
    ) -> Option<String> {
        let name = &self.manifest.name;
        for action in &said.actions {
            let called = action.name.as_str();
            let Some(known) = self.manifest.methods.get(called) else {
                return Some(format!(
                    "it offers `{called}`, and the manifest of `{name}` has no [action.{called}]"
                ));
            };
            let Some(method) = methods.get(called) else {
                return Some(format!("it offers `{called}` and names no method for it"));
            };
            if method.method != known.method || method.arguments != known.arguments {
                return Some(format!(
                    "its `{called}` has the method `{}`, but the manifest of `{name}` says `{}`",
                    method.method, known.method
                ));
            }
            let declared = own.map(|own| own.actions.iter().find(|own| own.name == action.name));
            if declared.is_some_and(|declared| declared != Some(action)) {
                return Some(format!("its `{called}` differs from that of the model in `{name}`"));
            }
        }
        None
    }
}

impl PackageFaults {
    /// Returns the first mistake of the package in one line, with its place.
    pub fn first(&self) -> String {
        let file = self.file.file_name().unwrap_or(self.file.as_os_str()).to_string_lossy();
        match self.found.first() {
            Some(found) if self.text.is_empty() => found.message.clone(),
            Some(found) => {
                let (line, column) = pddl::line_column(&self.text, found.span.start as usize);
                format!("{file}:{line}:{column}: {}", found.message)
            }
            None => format!("{file} is wrong"),
        }
    }
}

fn about(folder: &Path, message: String) -> PackageFaults {
    let found = vec![Diagnostic::error(Span::default(), message)];
    PackageFaults { file: folder.to_owned(), text: String::new(), found }
}

fn read(path: &Path, bytes_max: u64) -> io::Result<String> {
    let mut text = String::new();
    let file = File::open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("it is no file"));
    }
    file.take(bytes_max + 1).read_to_string(&mut text)?;
    if text.len() as u64 > bytes_max {
        return Err(io::Error::other(format!("it is longer than {bytes_max} bytes")));
    }
    Ok(text)
}

/// Returns the stamp of the files of a package, by which changes of the files are noticed.
pub(crate) fn stamp(folder: &Path) -> Stamp {
    let mut stamp = Stamp::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        let Ok(entries) = fs::read_dir(&next) else { continue };
        for entry in entries.flatten() {
            let path = entry.path();
            match fs::symlink_metadata(&path) {
                Ok(metadata) if metadata.is_dir() => folders.push(path),
                Ok(metadata) if stamp.len() < FILES_MAX => {
                    // A copy may keep the time of a file, and a link may change its target: then
                    // the inode differs.
                    let size = metadata.len() ^ metadata.ino().rotate_left(32);
                    stamp.insert(path, (size, metadata.modified().ok()));
                }
                _ => (),
            }
        }
    }
    stamp
}
