//! Finds the program that a package really runs, before the process is confined.
//!
//! The program that a manifest calls `python3` is often something else. It may be a *shim* of a
//! version manager (pyenv, rbenv, asdf, mise), which queries the manager and then runs the real
//! interpreter. It may be an interpreter of a virtual environment, or a script with an interpreter
//! in its first line. Managers and interpreters may be in any folder, so that inside the
//! confinement a shim fails with “Permission denied”. Therefore the daemon resolves the program
//! first. The confinement then lets the program read the real interpreter and the files that this
//! interpreter needs.
//!
//! The daemon runs interpreters and managers outside of the confinement to query their paths.
//! Therefore the daemon runs only programs that its user has installed: those found by a name on
//! the daemon's `PATH`, or below `/usr`, `/bin` or `/nix/store`. A path in a manifest or a script
//! could lead to a file of the package, or to one that the plugin has written; of such a file only
//! links and folders are examined. The interpreter in a virtual environment of a package is not run
//! either, because that would run code of the environment.
//!
//! The same distinction decides which files the program may read. For a program of the daemon's
//! user, the program's own files are added. A program that a manifest or a script names by its path
//! must be in the package, among the system's programs, or below a path in `read`
//! ([`ProgramScope`]). Otherwise a manifest would grant itself the folders around any program of
//! the user.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;

/// Maximum time for an interpreter or a version manager to answer the query for its paths. After
/// this time, the query has failed.
const ANSWER_WITHIN: Duration = Duration::from_secs(20);

/// Maximum length of a script that is read, in bytes; the rest is ignored. The shim of a version
/// manager has only a dozen lines.
const SCRIPT_BYTES_MAX: u64 = 64 << 10;

/// Maximum length of a chain of scripts and shims that refer to each other; a longer chain is an
/// error.
const STEPS_MAX: u32 = 6;

/// Names of programs of version managers that act as other programs, depending on the name by which
/// they are called.
const MULTIPLEXERS: &[&str] = &["mise", "rtx", "asdf", "volta-shim"];

/// Folders in which only the system's administrator installs programs.
const SYSTEM_FOLDERS: &[&str] = &["/usr", "/bin", "/nix/store"];

/// Names of the folders of virtual environments that a package may bring along.
const OWN_ENVIRONMENTS: &[&str] = &[".venv", "venv"];

/// Python script that prints the paths of the interpreter that runs it. The script imports nothing
/// from the current folder.
const ASK_PYTHON: &str = "\
import sys
sys.path[:] = [entry for entry in sys.path if entry]
import json, site
user = site.getusersitepackages() if site.ENABLE_USER_SITE else ''
print(json.dumps({'executable': sys.executable or '',
                  'prefixes': [sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix],
                  'path': [str(entry) for entry in sys.path],
                  'user': user, 'base': site.getuserbase() if user else ''}))";

/// A program that can be run inside the confinement.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ResolvedProgram {
    /// File of the program that is executed.
    pub(crate) file: PathBuf,
    /// Arguments to insert before those of the manifest: the arguments from the first line of a
    /// script, and the path of the script.
    pub(crate) leading: Vec<String>,
    /// Files and folders that the program needs to read in addition to those of the system.
    pub(crate) readable: BTreeSet<PathBuf>,
    /// Names and values of environment variables that the program needs.
    pub(crate) environment: Vec<(&'static str, OsString)>,
    /// Sentence that names the real program; `None` if the manifest names the real program itself.
    pub(crate) remark: Option<String>,
}

/// Paths that a Python interpreter reports.
#[derive(Debug, Deserialize)]
struct Python {
    executable: PathBuf,
    prefixes: Vec<PathBuf>,
    path: Vec<PathBuf>,
    /// Folder of the packages that the interpreter's user has installed; empty if the interpreter
    /// does not use them.
    user: PathBuf,
    base: PathBuf,
}

/// Parsed shim: the version manager that the shim calls, and the environment variables for the
/// manager.
#[derive(Debug, PartialEq)]
struct Shim {
    manager: String,
    /// Assignments `NAME=VALUE` of environment variables in the shim.
    environment: Vec<String>,
}

/// Folders in which the program of a package is searched for, and files that the package may name
/// by path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProgramScope<'s> {
    /// Folder of the package that names the program.
    pub(crate) folder: &'s Path,
    /// Files and folders that the package requests to read. A person has to allow them before the
    /// plugin is started.
    pub(crate) read: &'s [PathBuf],
    /// Folders in which a program is searched for by its name.
    pub(crate) path: &'s [PathBuf],
}

/// File that may be the program of a package.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ProgramCandidate {
    file: PathBuf,
    /// File that may be run outside of the confinement to query its paths, because the daemon's
    /// user or the system has installed it; `None` if no such file is known.
    asked: Option<PathBuf>,
}

/// Resolves the program of a package. A name without `/` is searched for in the package's own
/// virtual environment and then in the folders of the path. A name with `/` is a file of the
/// package, or an absolute path.
///
/// # Errors
///
/// Returns the reason, for a person, if there is no program that can be run.
pub(crate) async fn resolve(
    scope: ProgramScope<'_>,
    name: &str,
) -> Result<ResolvedProgram, String> {
    let candidates = candidates(scope.folder, name, scope.path)?;
    let mut first = None;
    for candidate in candidates {
        match Box::pin(resolve_file(&candidate, scope, STEPS_MAX)).await {
            Ok(mut program) => {
                if program.file != candidate.file && program.leading.is_empty() {
                    let (shim, real) = (candidate.file.display(), program.file.display());
                    program.remark = Some(format!("`{name}` is {shim}, which stands for {real}"));
                }
                return Ok(program);
            }
            // Another program of this name on the path may work.
            Err(problem) => first = first.or(Some(problem)),
        }
    }
    Err(first.unwrap_or_else(|| format!("there is no `{name}`")))
}

/// Returns the files that the name of a program may refer to, with the preferred file first.
///
/// # Errors
///
/// Returns the reason, for a person, if no file matches the name.
pub(crate) fn candidates(
    folder: &Path,
    name: &str,
    path: &[PathBuf],
) -> Result<Vec<ProgramCandidate>, String> {
    if name.contains('/') {
        let file = folder.join(name);
        return match fs::metadata(&file) {
            Ok(_) if is_executable(&file) => Ok(vec![ProgramCandidate::named(file)]),
            Ok(_) => Err(format!("`{name}` cannot be executed: chmod +x {}", file.display())),
            Err(error) => Err(format!("failed to find the program `{name}`: {error}")),
        };
    }
    let own = OWN_ENVIRONMENTS.iter().map(|own| folder.join(own).join("bin").join(name));
    let own = own.filter(|file| is_executable(file)).map(ProgramCandidate::named);
    let found: Vec<_> = own.chain(on_path(name, path)).collect();
    if found.is_empty() {
        return Err(format!("there is no `{name}` on the PATH of this daemon"));
    }
    Ok(found)
}

/// Returns the programs with this name in the folders of a path.
fn on_path(name: &str, path: &[PathBuf]) -> impl Iterator<Item = ProgramCandidate> {
    let files = path.iter().map(move |folder| folder.join(name)).filter(|file| is_executable(file));
    files.map(ProgramCandidate::trusted)
}

impl ProgramCandidate {
    /// Returns a candidate for a file that the daemon's user has installed.
    fn trusted(file: PathBuf) -> ProgramCandidate {
        ProgramCandidate { asked: Some(file.clone()), file }
    }

    /// Returns a candidate for a file that a manifest or a script names by its path. The file may
    /// be run to query its paths only if it is a program of the system, or a link to one.
    fn named(file: PathBuf) -> ProgramCandidate {
        let asked = file.canonicalize().ok().filter(|file| is_system(file));
        ProgramCandidate { file, asked }
    }

    /// Whether the daemon's user has installed the file.
    fn is_trusted(&self) -> bool {
        self.asked.as_ref() == Some(&self.file)
    }
}

impl ProgramScope<'_> {
    /// Whether the package may read a file: a file of the system, of the package, or below a path
    /// in `read`.
    fn holds(&self, file: &Path) -> bool {
        let is_below = |root: &Path| {
            file.starts_with(root) || root.canonicalize().is_ok_and(|root| file.starts_with(root))
        };
        is_system(file) || is_below(self.folder) || self.read.iter().any(|root| is_below(root))
    }
}

fn is_system(file: &Path) -> bool {
    SYSTEM_FOLDERS.iter().any(|folder| file.starts_with(folder))
}

/// Returns the folders of the `PATH` of this process.
pub(crate) fn own_path() -> Vec<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).filter(|folder| folder.is_absolute()).collect()
}

fn is_executable(file: &Path) -> bool {
    let is_it =
        |metadata: fs::Metadata| metadata.is_file() && metadata.permissions().mode() & 0o111 != 0;
    fs::metadata(file).is_ok_and(is_it)
}

/// Returns the program that a file really runs, after following shims, links and first lines of
/// scripts.
async fn resolve_file(
    candidate: &ProgramCandidate,
    scope: ProgramScope<'_>,
    steps: u32,
) -> Result<ResolvedProgram, String> {
    let ProgramCandidate { file, asked } = candidate;
    let shown = file.display();
    if steps == 0 {
        return Err(format!("{shown}: too many scripts start one another"));
    }
    let own = match candidate.is_trusted() {
        true => binary(file),
        false => named(file, scope, steps).await?,
    };
    let script = script(file);
    if let Some(asked) = asked {
        if is_python(asked)
            && let Ok(mut python) = ask_python(asked).await
        {
            if asked != file {
                python.file = file.clone();
                python.readable.extend(own.readable);
            }
            return Ok(python);
        }
        let shim = match multiplexer(asked) {
            Some(manager) => {
                Some(Shim { manager: manager.display().to_string(), environment: Vec::new() })
            }
            None => script.as_deref().and_then(shim),
        };
        if let Some(shim) = shim {
            return Box::pin(resolve_shim(&shim, file, scope, steps)).await;
        }
    }
    let Some((interpreter, extra)) = script.and_then(|script| interpreter(&script, scope.path))
    else {
        let mut program = own;
        if let Some(asked) = asked {
            program.readable.extend(libraries(asked).await);
        }
        return Ok(program);
    };
    let mut program = Box::pin(resolve_file(&interpreter, scope, steps - 1))
        .await
        .map_err(|problem| format!("{shown} needs an interpreter: {problem}"))?;
    program.leading.extend(extra);
    program.leading.push(shown.to_string());
    program.readable.extend(own.readable);
    Ok(program)
}

/// Returns the program at a path that a package names, with the surrounding files that the package
/// may read.
///
/// # Errors
///
/// Returns the reason, for a person, if the package may not read the program itself.
async fn named(
    file: &Path,
    scope: ProgramScope<'_>,
    steps: u32,
) -> Result<ResolvedProgram, String> {
    let real = file.canonicalize().unwrap_or_else(|_| file.to_owned());
    let mut program = binary(file);
    if scope.holds(file) && !scope.holds(&real) {
        // A virtual environment links to the interpreter that created it, often one of the user's.
        // That interpreter is accepted if it is also found on the path.
        let name = real.file_name().unwrap_or_default().to_string_lossy();
        for candidate in on_path(&name, scope.path) {
            let users = Box::pin(resolve_file(&candidate, scope, steps - 1)).await;
            let Ok(users) = users else { continue };
            if users.readable.contains(&real) {
                program.readable.retain(|path| scope.holds(path));
                program.readable.extend(users.readable);
                return Ok(program);
            }
        }
    }
    match [file, &real].into_iter().find(|path| path.exists() && !scope.holds(path)) {
        Some(outside) => {
            let (file, outside) = (file.display(), outside.display());
            Err(format!(
                "{file}: the package may not read {outside}, which is no file of its own and no program of the system; add it, or the folder that it needs, to `read` in `[permissions]`, for a person to allow"
            ))
        }
        None => {
            program.readable.retain(|path| scope.holds(path));
            Ok(program)
        }
    }
}

/// Queries the version manager of a shim for the real program, and resolves that program.
async fn resolve_shim(
    shim: &Shim,
    file: &Path,
    scope: ProgramScope<'_>,
    steps: u32,
) -> Result<ResolvedProgram, String> {
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut command = vec!["env".to_owned()];
    command.extend(shim.environment.iter().cloned());
    command.extend([shim.manager.clone(), "which".to_owned(), name.clone()]);
    let shown = file.display();
    let manager = Path::new(&shim.manager);
    let manager = manager.file_name().unwrap_or_default().to_string_lossy();
    let asked = programs::Program::of(command).ok_or("nothing is asked")?;
    let said = asked.run(ANSWER_WITHIN).await;
    let said = said.map_err(|error| {
        format!(
            "{shown} is a shim of {manager}, and `{manager} which` does not name the program: \
             failed to {error}"
        )
    })?;
    let real = PathBuf::from(said.lines().next().unwrap_or_default().trim());
    if !is_executable(&real) || real == file {
        return Err(format!(
            "{shown} is a shim of {manager}, which says that `{name}` is `{}`",
            real.display()
        ));
    }
    // The manager was installed by the user, so its answer is trusted.
    resolve_file(&ProgramCandidate::trusted(real), scope, steps - 1).await
}

/// Returns the multiplexer, such as `mise`, if a file such as `python3` is a link to one; otherwise
/// `None`.
fn multiplexer(file: &Path) -> Option<PathBuf> {
    let real = file.canonicalize().ok()?;
    let name = real.file_name()?.to_str()?;
    let is_one = MULTIPLEXERS.contains(&name) && file.file_name() != real.file_name();
    match name {
        _ if !is_one => None,
        "volta-shim" => Some(real.with_file_name("volta")),
        _ => Some(real),
    }
}

/// Returns the text of a file that is a script; `None` if the file is not a script or cannot be
/// read.
fn script(file: &Path) -> Option<String> {
    let mut bytes = Vec::new();
    let opened = File::open(file).ok()?;
    opened.take(SCRIPT_BYTES_MAX).read_to_end(&mut bytes).ok()?;
    bytes.starts_with(b"#!").then(|| String::from_utf8_lossy(&bytes).into_owned())
}

/// Returns the interpreter in the first line of a script, and the arguments in that line. `env` is
/// resolved here, because inside the confinement `env` might find another interpreter. Returns
/// `None` if there is no interpreter.
fn interpreter(script: &str, path: &[PathBuf]) -> Option<(ProgramCandidate, Vec<String>)> {
    let line = script.lines().next()?.strip_prefix("#!")?.trim();
    let (interpreter, argument) = match line.split_once(char::is_whitespace) {
        Some((interpreter, argument)) => (Path::new(interpreter), argument.trim()),
        None => (Path::new(line), ""),
    };
    if interpreter.file_name().is_some_and(|name| name != "env") {
        // The kernel passes everything after the interpreter as one argument.
        let argument = (!argument.is_empty()).then(|| argument.to_owned());
        let interpreter = ProgramCandidate::named(interpreter.to_owned());
        return Some((interpreter, argument.into_iter().collect()));
    }
    let split = argument.strip_prefix("-S").unwrap_or(argument);
    let mut words = split.split_whitespace().map(str::to_owned);
    let name = words.next().filter(|name| !name.contains('=') && !name.starts_with('-'))?;
    Some((on_path(&name, path).next()?, words.collect()))
}

/// Parses a shim of pyenv, a similar manager, or asdf: `exec "…/pyenv" exec "$program" "$@"`.
/// Returns `None` if the script is not a shim.
fn shim(script: &str) -> Option<Shim> {
    let unquoted = |word: &str| word.trim_matches(['"', '\'']).to_owned();
    let mut environment = Vec::new();
    for line in script.lines().map(str::trim) {
        let mut words = line.split_whitespace();
        match (words.next(), words.next(), words.next()) {
            (Some("export"), Some(set), None) => {
                let (name, value) = set.split_once('=')?;
                if !value.contains('$') {
                    environment.push(format!("{name}={}", unquoted(value)));
                }
            }
            (Some("exec"), Some(manager), Some("exec")) => {
                let manager = unquoted(manager);
                return (!manager.contains('$')).then_some(Shim { manager, environment });
            }
            _ => (),
        }
    }
    None
}

fn is_python(file: &Path) -> bool {
    let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.strip_prefix("python")
        .is_some_and(|version| version.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.'))
}

/// Queries a Python interpreter for its own paths and those of its libraries. The interpreter may
/// be behind a shim of any kind.
async fn ask_python(file: &Path) -> Result<ResolvedProgram, String> {
    // The plugin runs without these variables, so they must not influence the answer.
    let words = ["env", "-u", "PYTHONPATH", "-u", "PYTHONHOME"].map(str::to_owned);
    let asked = [file.display().to_string(), "-c".to_owned(), ASK_PYTHON.to_owned()];
    let asked = programs::Program::of(words.into_iter().chain(asked)).ok_or("nothing is asked")?;
    let said = asked.run(ANSWER_WITHIN).await.map_err(|error| error.to_string())?;
    let python: Python = serde_json::from_str(said.trim()).map_err(|error| error.to_string())?;
    // Python finds a virtual environment by the path with which Python is called.
    let executable = match is_executable(&python.executable) {
        true => python.executable.as_path(),
        false => file,
    };
    let mut program = binary(executable);
    program.readable.extend(libraries(executable).await);
    for prefix in python.prefixes.iter().chain(&python.path) {
        keep(prefix, &mut program.readable);
    }
    if python.user.is_dir() {
        // The plugin's `HOME` is another folder, so a variable names the folder of the user's
        // packages.
        program.readable.insert(python.user);
        program.environment.push(("PYTHONUSERBASE", python.base.into_os_string()));
    }
    Ok(program)
}

/// Returns the resolved program for a file that is not a script, with the folder into which the
/// program was installed.
fn binary(file: &Path) -> ResolvedProgram {
    let mut readable = BTreeSet::from([file.to_owned()]);
    for file in [Some(file.to_owned()), file.canonicalize().ok()].into_iter().flatten() {
        let installed = file.parent().filter(|folder| folder.ends_with("bin"));
        let installed = installed.and_then(Path::parent);
        if let Some(installed) = installed.filter(|folder| folder.join("lib").is_dir()) {
            keep(installed, &mut readable);
        }
        readable.insert(file);
    }
    ResolvedProgram { file: file.to_owned(), readable, ..ResolvedProgram::default() }
}

/// Returns the shared libraries of a program that are outside of the system's folders, as reported
/// by `ldd`. The result is empty if `ldd` fails.
async fn libraries(file: &Path) -> Vec<PathBuf> {
    let command = ["ldd".to_owned(), file.display().to_string()];
    let Some(asked) = programs::Program::of(command) else { return Vec::new() };
    // `ldd` fails for a file that is not a dynamic program, and may be missing.
    let said = asked.run(ANSWER_WITHIN).await.unwrap_or_default();
    let files = said.lines().filter_map(|line| {
        let (_, file) = line.split_once(" => ")?;
        Some(PathBuf::from(file.split_whitespace().next()?))
    });
    let files = files.filter(|file| file.is_absolute() && !file.starts_with("/usr"));
    let files = files.filter(|file| !file.starts_with("/lib") && !file.starts_with("/lib64"));
    files.flat_map(|file| [file.canonicalize().ok(), Some(file)]).flatten().collect()
}

/// Adds a folder to the files that may be read. If the folder contains the user's home or is near
/// the root, only its parts with programs and libraries are added.
fn keep(folder: &Path, readable: &mut BTreeSet<PathBuf>) {
    if !folder.is_absolute() || !folder.exists() {
        return;
    }
    let home = std::env::var_os("HOME").map(PathBuf::from);
    let holds_home = home.is_some_and(|home| home.starts_with(folder));
    if holds_home || folder.components().count() <= 2 {
        let parts = ["bin", "lib", "lib64", "pyvenv.cfg"].map(|part| folder.join(part));
        readable.extend(parts.into_iter().filter(|part| part.exists()));
    } else {
        readable.insert(folder.to_owned());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Resolves the name of a program for a package without `read` permissions.
    async fn resolve(
        folder: &Path,
        name: &str,
        path: &[PathBuf],
    ) -> Result<ResolvedProgram, String> {
        super::resolve(ProgramScope { folder, read: &[], path }, name).await
    }

    fn write(file: &Path, text: &str) {
        fs::create_dir_all(file.parent().expect("a folder")).expect("made");
        fs::write(file, text).expect("written");
        fs::set_permissions(file, fs::Permissions::from_mode(0o755)).expect("our own");
    }

    /// Creates a version manager like pyenv, rbenv and asdf: shims that query the manager, and
    /// versions of the program in another folder.
    fn manager(folder: &Path, manager: &str, name: &str, real: &str) -> PathBuf {
        let root = folder.join("root");
        write(
            &root.join("libexec").join(manager),
            &format!(
                "#!/bin/sh\n[ \"$MANAGER_ROOT\" = {root} ] || exit 9\n\
                 case \"$1 $2\" in 'which {name}') echo {real} ;; *) echo \"{manager}: $2: not found\" >&2; exit 127 ;; esac\n",
                root = root.display()
            ),
        );
        let shim = root.join("shims").join(name);
        write(
            &shim,
            &format!(
                "#!/usr/bin/env bash\nset -e\nprogram=\"${{0##*/}}\"\nexport MANAGER_ROOT=\"{root}\"\n\
                 exec \"{root}/libexec/{manager}\" exec \"$program\" \"$@\"\n",
                root = root.display()
            ),
        );
        shim.parent().expect("shims").to_owned()
    }

    #[tokio::test]
    async fn shims_of_all_managers_are_resolved() {
        for (manager_name, name) in [("pyenv", "pythonic"), ("rbenv", "ruby"), ("asdf", "node")] {
            let folder = tempfile::tempdir().expect("a folder");
            let real = folder.path().join("versions/3.4/bin").join(name);
            write(&real, "\x7fELF");
            fs::create_dir_all(folder.path().join("versions/3.4/lib")).expect("made");
            let shims = manager(folder.path(), manager_name, name, &real.display().to_string());
            let program =
                resolve(folder.path(), name, std::slice::from_ref(&shims)).await.expect(name);
            assert_eq!(program.file, real);
            assert!(program.readable.contains(&folder.path().join("versions/3.4")), "{program:?}");
            assert!(program.remark.is_some_and(|said| said.contains("stands for")), "{name}");
            // The interpreter in the first line of a script may be a shim as well.
            let agent = folder.path().join("package/agent");
            write(&agent, &format!("#!/usr/bin/env -S {name} -u\n"));
            let package = agent.parent().expect("a folder");
            let program = resolve(package, "./agent", &[shims]).await.expect(name);
            assert_eq!(program.file, real);
            assert_eq!(program.leading[0], "-u");
            assert!(program.leading[1].ends_with("agent"), "{program:?}");
        }
    }

    #[tokio::test]
    async fn a_shim_without_a_program_is_skipped_or_reported() {
        let folder = tempfile::tempdir().expect("a folder");
        let shims = manager(folder.path(), "rbenv", "ruby", "/no/such/ruby");
        let problem = resolve(folder.path(), "ruby", std::slice::from_ref(&shims))
            .await
            .expect_err("nothing");
        assert!(problem.contains("is a shim of rbenv"), "{problem}");
        let other = folder.path().join("other/ruby");
        write(&other, "\x7fELF");
        let path = [shims, folder.path().join("other")];
        let program = resolve(folder.path(), "ruby", &path).await.expect("the other one");
        assert_eq!(program.file, other);
    }

    #[tokio::test]
    async fn links_to_a_multiplexer_are_resolved() {
        let folder = tempfile::tempdir().expect("a folder");
        let real = folder.path().join("installs/node/20/bin/node");
        write(&real, "\x7fELF");
        let mise = folder.path().join("bin/mise");
        write(
            &mise,
            &format!("#!/bin/sh\n[ \"$1 $2\" = 'which node' ] && echo {}\n", real.display()),
        );
        let shims = folder.path().join("shims");
        fs::create_dir(&shims).expect("made");
        std::os::unix::fs::symlink(&mise, shims.join("node")).expect("a link");
        let program = resolve(folder.path(), "node", &[shims]).await.expect("node");
        assert_eq!(program.file, real);
    }

    #[tokio::test]
    async fn a_python_interpreter_reports_its_library_folders() {
        let folder = tempfile::tempdir().expect("a folder");
        let said = r#"{"executable": "", "prefixes": ["FOLDER/lib-of-it", "/usr"], "path": [],
            "user": "FOLDER/user/lib", "base": "FOLDER/user"}"#;
        let said = said.replace("FOLDER", &folder.path().display().to_string());
        for part in ["lib-of-it", "user/lib"] {
            fs::create_dir_all(folder.path().join(part)).expect("made");
        }
        let fake =
            format!("#!/bin/sh\n[ -z \"$PYTHONPATH\" ] || exit 1\ncat <<'SAID'\n{said}\nSAID\n");
        let installed = folder.path().join("bin");
        write(&installed.join("python3"), &fake);
        let path = std::iter::once(installed.clone()).chain(own_path()).collect::<Vec<_>>();
        let program = resolve(folder.path(), "python3", &path).await.expect("the first");
        assert_eq!(program.file, installed.join("python3"));
        assert!(program.readable.contains(&folder.path().join("lib-of-it")), "{program:?}");
        assert!(program.readable.contains(&folder.path().join("user/lib")), "{program:?}");
        let base = folder.path().join("user").into_os_string();
        assert_eq!(program.environment, [("PYTHONUSERBASE", base)]);
    }

    /// Tests that outside of the confinement no file of a package runs, whatever the file looks
    /// like.
    #[tokio::test]
    async fn resolving_a_program_runs_no_file_of_the_package() {
        let folder = tempfile::tempdir().expect("a folder");
        let (package, ran) = (folder.path().join("package"), folder.path().join("ran"));
        let evil = format!(
            "#!/bin/sh\nexport A=1\ntouch {0}\nexec \"{1}\" exec x\n",
            ran.display(),
            package.join("manager").display()
        );
        for file in [".venv/bin/python3", "manager", "python3", "bin/mise"] {
            write(&package.join(file), &evil);
        }
        write(&package.join("script"), &format!("#!{}/python3\n", package.display()));
        std::os::unix::fs::symlink("bin/mise", package.join("node")).expect("a link");
        for name in ["python3", "./python3", "./script", "./node", "./manager"] {
            let resolved = resolve(&package, name, &own_path()).await;
            assert!(!ran.exists(), "`{name}` was run: {resolved:?}");
        }
        // The package's own virtual environment is used, with the interpreter that it links to.
        fs::remove_file(package.join(".venv/bin/python3")).expect("ours");
        std::os::unix::fs::symlink("/bin/sh", package.join(".venv/bin/python3")).expect("a link");
        let program = resolve(&package, "python3", &own_path()).await.expect("its own");
        assert_eq!(program.file, package.join(".venv/bin/python3"));
    }

    /// Tests that a package that names a program of the user does not get the files around that
    /// program.
    #[tokio::test]
    async fn a_package_grants_itself_no_folder_by_the_path_of_a_program() {
        let folder = tempfile::tempdir().expect("a folder");
        let (package, project) = (folder.path().join("package"), folder.path().join("project"));
        let tool = project.join("bin/tool");
        write(&tool, "\x7fELF");
        write(&project.join("lib/secret"), "");
        fs::create_dir_all(package.join("bin")).expect("made");
        std::os::unix::fs::symlink(&tool, package.join("bin/link")).expect("a link");
        write(&package.join("script"), &format!("#!{}\n", tool.display()));
        for name in ["bin/link", "./script", "../project/bin/tool", &tool.display().to_string()] {
            let refused = resolve(&package, name, &own_path()).await.expect_err(name);
            assert!(refused.contains("project/bin/tool"), "{refused}");
            assert!(refused.contains("`read` in `[permissions]`"), "{refused}");
        }
        // A person can allow the program, without the files around it.
        let read = [tool.clone()];
        let scope = ProgramScope { folder: &package, read: &read, path: &own_path() };
        let program = super::resolve(scope, "bin/link").await.expect("it may be read");
        assert!(program.readable.contains(&tool), "{program:?}");
        assert!(!program.readable.contains(&project), "{program:?}");
        // On the path, the same program is the user's own choice.
        let program = resolve(&package, "tool", &[project.join("bin")]).await.expect("found");
        assert!(program.readable.contains(&project), "{program:?}");
    }

    #[tokio::test]
    async fn a_missing_or_unusable_program_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let problem = resolve(folder.path(), "no-such", &own_path()).await.expect_err("none");
        assert!(problem.contains("there is no `no-such` on the PATH of this daemon"), "{problem}");
        fs::write(folder.path().join("agent"), "#!/bin/sh\n").expect("written");
        let problem = resolve(folder.path(), "./agent", &[]).await.expect_err("no mode");
        assert!(problem.contains("chmod +x"), "{problem}");
        write(&folder.path().join("one"), "#!/no/such/interpreter\n");
        let program = resolve(folder.path(), "./one", &[]).await.expect("it is tried");
        assert_eq!(program.file, Path::new("/no/such/interpreter"));
    }

    #[test]
    fn a_broad_folder_is_reduced_to_its_program_parts() {
        let mut readable = BTreeSet::new();
        keep(Path::new("/usr"), &mut readable);
        assert!(!readable.contains(Path::new("/usr")), "{readable:?}");
        assert!(readable.contains(Path::new("/usr/lib")), "{readable:?}");
        assert!(shim("#!/bin/sh\necho exec\n").is_none());
    }
}
