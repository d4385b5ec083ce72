//! Processes of a test. They run in a folder of their own, are awaited by their output, and are
//! ended by their handles.

#![allow(dead_code, reason = "each test file uses its part")]

pub(crate) mod asker;
pub(crate) mod broker;
pub(crate) mod http_receiver;
pub(crate) mod left_out;
pub(crate) mod network;
pub(crate) mod packages;
pub(crate) mod page_client;
pub(crate) mod terminal;

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

/// Time limit of every step, on a machine that is busy with other tests: longer than a scenario's
/// own limit, so that the scenario's report comes first.
pub(crate) const PATIENCE: Duration = Duration::from_secs(90);

/// The paper's office, or another building, in a folder of its own. Its daemons end with this
/// value.
pub(crate) struct Office {
    pub(crate) file: PathBuf,
    folder: TempDir,
    /// The `PATH` of the office's programs; `None` for that of this test.
    path: Option<OsString>,
    daemons: Vec<Daemon>,
}

/// One process of `althing up`.
pub(crate) struct Daemon {
    pub(crate) name: String,
    child: Child,
    lines: mpsc::Receiver<String>,
}

impl Office {
    /// Returns the repository's own smart office, fifty times as fast as real time.
    pub(crate) fn new() -> Office {
        Office::of(Office::file())
    }

    /// Returns this office with another ecosystem file.
    pub(crate) fn with_file(mut self, file: PathBuf) -> Office {
        self.file = file;
        self
    }

    /// Returns this office with a Python that plugins can use first on the `PATH`, if there is one.
    pub(crate) fn with_python(mut self) -> Office {
        self.path = Some(packages::path());
        self
    }

    /// Returns this office with a folder of programs first on the `PATH`.
    pub(crate) fn with_programs(mut self, folder: &Path) -> Office {
        let path = self.path.take().or_else(|| std::env::var_os("PATH")).unwrap_or_default();
        let rest = std::env::split_paths(&path).collect::<Vec<_>>();
        let all = std::iter::once(folder.to_owned()).chain(rest);
        self.path = Some(std::env::join_paths(all).expect("folders of a path"));
        self
    }

    /// Starts a daemon that meets no other daemon of this machine: its runtime folder is `runtime`.
    pub(crate) fn up_apart(&mut self, name: &str, runtime: &Path, options: &[&str]) {
        let file = self.file.display().to_string();
        let arguments = [&["up", &file, "--daemon", name], options].concat();
        let mut command = self.command(&arguments);
        command.env("ALTHING_RUNTIME_DIR", runtime);
        self.begin_as(name, command);
    }

    /// Returns an office with another ecosystem file, at the same speed.
    pub(crate) fn of(file: PathBuf) -> Office {
        let folder = tempfile::Builder::new().prefix("alt-").tempdir().expect("a folder");
        Office { file, folder, path: None, daemons: Vec::new() }
    }

    pub(crate) fn file() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../ecosystems/smart-office.toml")
    }

    pub(crate) fn runtime_folder(&self) -> PathBuf {
        self.folder.path().join("run")
    }

    /// Returns the folder of plugin packages.
    pub(crate) fn plugins_folder(&self) -> PathBuf {
        self.folder.path().join("plugins")
    }

    /// Returns an `althing` command of this office.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = self.program(env!("CARGO_BIN_EXE_althing"));
        command.args(arguments).stdin(Stdio::null());
        command
    }

    /// Returns a program that runs in this office's folder and environment.
    pub(crate) fn program(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        self.furnish(&mut command);
        command
    }

    /// Gives a program this office's folder and environment.
    fn furnish(&self, command: &mut Command) {
        command.envs(self.path.iter().map(|path| ("PATH", path)));
        command
            .current_dir(self.folder.path())
            .env("ALTHING_RUNTIME_DIR", self.runtime_folder())
            .env("ALTHING_STATE_DIR", self.folder.path().join("state"))
            .env("ALTHING_PLUGINS_DIR", self.plugins_folder())
            .env("ALTHING_BUILDING__SOCKET", self.folder.path().join("building.sock"))
            .env("ALTHING_BUILDING__TIME_SCALE", "0.02")
            // Tests compare PDDL, which is the same in all languages; `words` looks at words.
            .env("ALTHING_PDDL", "1");
    }

    /// Writes a file into this office's folder; returns its path.
    pub(crate) fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, text).expect("the folder can be written to");
        path
    }

    /// Runs a command to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        finish(&mut self.command(arguments))
    }

    /// Runs a command on the running ecosystem; returns the exit code and all output.
    pub(crate) fn ask(&self, arguments: &[&str]) -> (Option<i32>, String) {
        let file = self.file.display().to_string();
        let output = self.run(&[arguments, &["--ecosystem", &file]].concat());
        (output.status.code(), format!("{}{}", stdout(&output), stderr(&output)))
    }

    /// Runs a command on the running ecosystem with `--json`; returns the JSON on stdout, which
    /// must be nothing else. `Null` if stdout is empty.
    pub(crate) fn ask_json(&self, arguments: &[&str]) -> Value {
        let file = self.file.display().to_string();
        let output = self.run(&[arguments, &["--json", "--ecosystem", &file]].concat());
        let json = stdout(&output);
        if json.is_empty() {
            return Value::Null;
        }
        let value = serde_json::from_str(&json);
        value.unwrap_or_else(|err| panic!("{err} in one JSON object: {json}{}", stderr(&output)))
    }

    /// Waits until the state contains a fact, or until it does not.
    pub(crate) fn await_fact(&self, fact: &str, wanted: bool) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let state = self.ask_json(&["state"]);
            let facts = state["facts"].as_array().into_iter().flatten();
            let is_there = facts.into_iter().any(|known| known["fact"] == *fact);
            if is_there == wanted {
                return;
            }
            assert!(Instant::now() < deadline, "{fact}: {state}");
        }
    }

    /// Waits until a question to a person contains `question`, and answers it.
    pub(crate) fn answer(&self, question: &str, answer: &str) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let open = self.ask_json(&["answer"])["questions"].clone();
            let is_it = |one: &&Value| one["text"].to_string().contains(question);
            if let Some(number) = open.as_array().into_iter().flatten().find(is_it) {
                let (code, said) = self.ask(&["answer", &number["question"].to_string(), answer]);
                return assert_eq!(code, Some(0), "{said}");
            }
            assert!(Instant::now() < deadline, "nobody asks `{question}`: {open}");
        }
    }

    /// Returns the folder with all files of this office.
    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Waits until `devices` devices can be planned with.
    pub(crate) fn await_devices(&self, devices: usize) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let snapshot = self.ask_json(&["domain"]);
            let came = snapshot["offers"].as_object().map_or(0, serde_json::Map::len);
            if came == devices {
                return;
            }
            assert!(Instant::now() < deadline, "{came} of {devices} devices came: {snapshot}");
        }
    }

    /// Starts daemons one after the other, each when the one before is ready.
    pub(crate) fn up(&mut self, names: &[&str], options: &[&str]) {
        for name in names {
            self.start(name, &[&["--daemon", name], options].concat());
        }
    }

    /// Starts one daemon that hosts everything.
    pub(crate) fn up_alone(&mut self, options: &[&str]) {
        self.start("alone", options);
    }

    /// Starts daemons at once, and waits until all are ready.
    pub(crate) fn up_at_once(&mut self, names: &[&str]) {
        let begin = |name: &&str| self.begin(&self.file, name, &["--daemon", name]);
        let daemons: Vec<_> = names.iter().map(begin).collect();
        for daemon in daemons {
            daemon.await_line("is ready");
            self.daemons.push(daemon);
        }
    }

    /// Starts a daemon from another file.
    pub(crate) fn up_from(&mut self, file: &Path, name: &str) {
        let daemon = self.begin(file, name, &["--daemon", name]);
        daemon.await_line("is ready");
        self.daemons.push(daemon);
    }

    /// Kills a daemon, and waits until it is gone.
    pub(crate) fn kill(&mut self, name: &str) {
        let at = self.daemons.iter().position(|daemon| daemon.name == name).expect("a daemon");
        let mut daemon = self.daemons.remove(at);
        daemon.child.kill().expect("our child");
        daemon.child.wait().expect("our child");
    }

    fn start(&mut self, name: &str, options: &[&str]) {
        let daemon = self.begin(&self.file, name, options);
        daemon.await_line("is ready");
        self.daemons.push(daemon);
    }

    fn begin(&self, file: &Path, name: &str, options: &[&str]) -> Daemon {
        let file = file.display().to_string();
        Daemon::start(name, self.command(&[&["up", &file], options].concat()))
    }

    /// Starts a daemon by a command of the caller's.
    pub(crate) fn begin_as(&mut self, name: &str, command: Command) {
        let daemon = Daemon::start(name, command);
        daemon.await_line("is ready");
        self.daemons.push(daemon);
    }

    /// Returns the daemons that should run and do not, with the exit status of each.
    pub(crate) fn ended(&mut self) -> Vec<String> {
        let ended = self.daemons.iter_mut().filter_map(|daemon| {
            let status = daemon.child.try_wait().expect("our child")?;
            Some(format!("`{}` ended by itself: {status}", daemon.name))
        });
        ended.collect()
    }

    /// Sends a signal to a daemon's process, by its id.
    pub(crate) fn signal(&self, name: &str, signal: &str) {
        let daemon = self.daemons.iter().find(|daemon| daemon.name == name).expect("a daemon");
        send(&daemon.child, signal);
    }

    /// Asks a process of this test to end.
    pub(crate) fn terminate(&self, process: &Child) {
        send(process, "TERM");
    }
}

/// Returns the file of an ecosystem `lab`: the reasoning agents, with the ontology and map of the
/// smart office.
pub(crate) fn lab(mode: &str) -> String {
    let office = Office::file().canonicalize().expect("it is there");
    let domain = office.ancestors().nth(2).expect("a folder").join("domains/smart-office");
    let domain = domain.display();
    let head = format!(
        "[ecosystem]\nname = \"lab\"\ndomain = \"{domain}/domain.pddl\"\n\
         problem = \"{domain}/map.pddl\"\nmode = \"{mode}\"\n\n"
    );
    let reasoning = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];
    let entry = |plugin| format!("[[agent]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"\n\n");
    head + &reasoning.map(entry).concat()
}

/// Runs a command on the repository's office; returns the exit code and all output.
pub(crate) fn ask(office: &Office, arguments: &[&str]) -> (Option<i32>, String) {
    let file = Office::file().display().to_string();
    let output = office.run(&[arguments, &["--ecosystem", &file]].concat());
    (output.status.code(), format!("{}{}", stdout(&output), stderr(&output)))
}

/// Starts the office on four machines, and waits until all its devices can be planned with.
pub(crate) fn office() -> Office {
    let mut office = Office::new();
    // The robot's laptop starts before the other boards: it serves the simulated building to them.
    office.up(&["reasoning", "turtlebot-laptop", "office2-pi", "conf-room-pi"], &[]);
    let deadline = Instant::now() + PATIENCE;
    let devices = ["thermometer-office2", "thermometer-conf-room", "turtlebot-1", "ir-1"];
    loop {
        let snapshot = office.ask_json(&["domain"]);
        if devices.iter().all(|device| snapshot["offers"].get(device).is_some()) {
            return office;
        }
        assert!(Instant::now() < deadline, "not all devices came: {snapshot}");
    }
}

impl Drop for Office {
    fn drop(&mut self) {
        for daemon in &mut self.daemons {
            let _ = daemon.child.kill();
            let _ = daemon.child.wait();
        }
    }
}

/// Runs a command to its end. A command that hangs is killed, and its test then fails.
pub(crate) fn finish(command: &mut Command) -> Output {
    let mut child =
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary is built");
    let id = child.id();
    let (done, is_done) = mpsc::channel::<()>();
    let watchdog = std::thread::spawn(move || {
        if is_done.recv_timeout(PATIENCE) == Err(mpsc::RecvTimeoutError::Timeout) {
            let _ = Command::new("kill").args(["-KILL", &id.to_string()]).status();
        }
    });
    let stdout = child.stdout.take().map(drain);
    let stderr = child.stderr.take().map(drain);
    let status = child.wait().expect("our child");
    drop(done);
    let _ = watchdog.join();
    let read = |pipe: Option<std::thread::JoinHandle<Vec<u8>>>| {
        pipe.and_then(|pipe| pipe.join().ok()).unwrap_or_default()
    };
    Output { status, stdout: read(stdout), stderr: read(stderr) }
}

impl Daemon {
    fn start(name: &str, mut command: Command) -> Daemon {
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the binary is built");
        let lines = lines(&mut child);
        Daemon { name: name.to_owned(), child, lines }
    }

    /// Waits for a line that contains `text`.
    pub(crate) fn await_line(&self, text: &str) -> String {
        loop {
            let line = self.lines.recv_timeout(PATIENCE);
            let line = line.unwrap_or_else(|_| panic!("`{}` never said `{text}`", self.name));
            if line.contains(text) {
                return line;
            }
        }
    }
}

fn send(process: &Child, signal: &str) {
    let id = process.id().to_string();
    let sent = Command::new("kill").args([&format!("-{signal}"), &id]).status();
    assert!(sent.expect("kill is there").success());
}

/// Returns the lines that a process prints, read as they come so that it never blocks.
pub(crate) fn lines(child: &mut Child) -> mpsc::Receiver<String> {
    let stdout = child.stdout.take().expect("piped");
    let (tell, lines) = mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(stdout).lines().map_while(Result::ok) {
            if tell.send(line).is_err() {
                return;
            }
        }
    });
    lines
}

fn drain(mut pipe: impl std::io::Read + Send + 'static) -> std::thread::JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        let _ = pipe.read_to_end(&mut bytes);
        bytes
    })
}

/// Returns what a command printed on stdout.
pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Returns what a command printed on stderr.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
