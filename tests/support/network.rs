//! Machines and networks of a test: each machine is a network namespace with its own runtime
//! folder, so that messages between machines use wires that can be cut.
//!
//! A namespace is held by a `cat` that waits on a pipe of this test. When the test ends in any way,
//! the `cat` ends too, and the namespace and its wires with it. The host's network is not touched.

#![allow(dead_code, reason = "each test file uses its part")]

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use serde_json::Value;

use super::left_out::left_out;
use super::{Office, PATIENCE, finish, stderr, stdout};

/// A bridge that represents a network of machines. A bridge without machines represents a cable
/// that leads nowhere.
pub(crate) const LAN: &str = "lan";

/// Machines on networks, with one office for all of them.
pub(crate) struct Site {
    pub(crate) office: Office,
    /// Namespace with the bridges.
    switch: Namespace,
    machines: BTreeMap<String, Namespace>,
    wires: usize,
}

/// A network namespace, and a mount namespace.
struct Namespace {
    holder: Child,
}

/// Whether namespaces can be created on this machine. Otherwise reports that, which fails with
/// `CI=true`.
pub(crate) fn is_permitted() -> bool {
    let tried = Command::new("unshare").args(["--mount", "--net", "ip", "link", "show"]).output();
    let problem = match tried {
        Ok(output) if output.status.success() => return true,
        Ok(output) => stderr(&output).trim().to_owned(),
        Err(problem) => problem.to_string(),
    };
    let needed = "it needs root, `unshare` (util-linux) and `ip` (iproute2)";
    left_out(&format!("no network namespaces: {problem}; {needed}"));
    false
}

// === impl Namespace ===

impl Namespace {
    fn new() -> Namespace {
        let mut command = Command::new("unshare");
        command.args(["--mount", "--net", "cat"]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut holder = command.spawn().expect("it is permitted");
        // The echo shows that the process inside the namespace runs.
        let mut echo = BufReader::new(holder.stdout.take().expect("piped"));
        holder.stdin.as_mut().expect("piped").write_all(b"\n").expect("it lives");
        echo.read_line(&mut String::new()).expect("it lives");
        let namespace = Namespace { holder };
        namespace.ip(&["link", "set", "lo", "up"]);
        namespace
    }

    /// Returns a program that runs inside the namespace.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--mount", "--net", "--target", &self.holder.id().to_string()]);
        command.arg("--").arg(program);
        command
    }

    fn must(&self, program: &str, arguments: &[&str]) {
        let output = self.command(program).args(arguments).output().expect("nsenter is there");
        assert!(output.status.success(), "{program} {arguments:?}: {}", stderr(&output));
    }

    fn ip(&self, arguments: &[&str]) {
        self.must("ip", arguments);
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

// === impl Site ===

impl Site {
    /// Creates a site without machines; `None` if namespaces are not permitted.
    pub(crate) fn new(office: Office) -> Option<Site> {
        is_permitted().then(|| Site {
            office,
            switch: Namespace::new(),
            machines: BTreeMap::new(),
            wires: 0,
        })
    }

    /// Creates machines on one network, with the addresses 10.0.0.1 and up.
    pub(crate) fn on_lan(office: Office, machines: &[&str]) -> Option<Site> {
        let mut site = Site::new(office)?;
        site.network(LAN);
        for (machine, number) in machines.iter().zip(1..) {
            site.machine(machine);
            site.plug(machine, LAN, &format!("10.0.0.{number}"));
        }
        Some(site)
    }

    /// Adds a network.
    pub(crate) fn network(&self, name: &str) {
        self.switch.ip(&["link", "add", name, "type", "bridge"]);
        self.switch.ip(&["link", "set", name, "up"]);
    }

    /// Adds a machine with a runtime folder of its own.
    pub(crate) fn machine(&mut self, name: &str) {
        let namespace = Namespace::new();
        let run = self.office.runtime_folder();
        std::fs::create_dir_all(&run).expect("a folder");
        namespace.must("mount", &["-t", "tmpfs", "-o", "mode=700", "run", &text(&run)]);
        self.machines.insert(name.to_owned(), namespace);
    }

    /// Connects a machine to a network with this address.
    pub(crate) fn plug(&mut self, machine: &str, network: &str, address: &str) {
        let at = &self.machines[machine];
        self.wires += 1;
        let (here, there) = (wire(machine, network), format!("eth{}", self.wires));
        let holder = at.holder.id().to_string();
        let pair = ["type", "veth", "peer", "name", &there, "netns", &holder];
        self.switch.ip(&[&["link", "add", &here], &pair[..]].concat());
        self.switch.ip(&["link", "set", &here, "master", network, "up"]);
        at.ip(&["address", "add", &format!("{address}/24"), "dev", &there]);
        at.ip(&["link", "set", &there, "up"]);
    }

    /// Moves the cable between a machine and `network` to another network.
    pub(crate) fn replug(&self, machine: &str, network: &str, other: &str) {
        self.switch.ip(&["link", "set", &wire(machine, network), "master", other]);
    }

    /// Replaces an address of a machine.
    pub(crate) fn readdress(&self, machine: &str, old: &str, new: &str) {
        let script = format!(
            "dev=$(ip -o address show to {old} | cut -d' ' -f2) && \
             ip address del {old}/24 dev $dev && ip address add {new}/24 dev $dev"
        );
        self.machines[machine].must("sh", &["-c", &script]);
    }

    /// Gives a machine a small disk for the state folder of its daemons.
    pub(crate) fn small_disk(&self, machine: &str, folder: &Path, bytes: &str) {
        std::fs::create_dir_all(folder).expect("a folder");
        let size = format!("size={bytes},mode=700");
        self.machines[machine].must("mount", &["-t", "tmpfs", "-o", &size, "disk", &text(folder)]);
    }

    /// Returns the path by which this test reaches a file of a machine.
    pub(crate) fn path(&self, machine: &str, path: &Path) -> PathBuf {
        let holder = self.machines[machine].holder.id();
        Path::new(&format!("/proc/{holder}/root")).join(path.strip_prefix("/").unwrap_or(path))
    }

    /// Runs a program on a machine; it must succeed.
    pub(crate) fn must(&self, machine: &str, program: &str, arguments: &[&str]) {
        self.machines[machine].must(program, arguments);
    }

    /// Returns a program that runs on a machine, in the office's folder and environment.
    pub(crate) fn program(&self, machine: &str, program: &str) -> Command {
        let mut inner = self.machines[machine].command(program);
        inner.stdin(Stdio::null());
        self.office.furnish(&mut inner);
        inner
    }

    /// Starts a daemon on the machine of its name, and waits until it is ready.
    pub(crate) fn up(&mut self, name: &str, options: &[&str]) {
        self.up_from(&self.office.file.clone(), name, options);
    }

    /// Starts a daemon as [`Site::up`] does, with another ecosystem file.
    pub(crate) fn up_from(&mut self, file: &Path, name: &str, options: &[&str]) {
        let mut command = self.program(name, env!("CARGO_BIN_EXE_althing"));
        command.arg("up").arg(file).args(["--daemon", name]).args(options);
        self.office.begin_as(name, command);
    }

    /// Runs a command with `--json` on a machine. `Null` if it gave no JSON.
    fn ask_json(&self, file: &Path, machine: &str, arguments: &[&str]) -> Value {
        let mut command = self.program(machine, env!("CARGO_BIN_EXE_althing"));
        command.args(arguments).args(["--json", "--ecosystem"]).arg(file);
        serde_json::from_str(&stdout(&finish(&mut command))).unwrap_or(Value::Null)
    }

    /// Runs a command on a machine; returns the exit code and all output.
    pub(crate) fn ask(&self, machine: &str, arguments: &[&str]) -> (Option<i32>, String) {
        let mut command = self.program(machine, env!("CARGO_BIN_EXE_althing"));
        command.args(arguments).arg("--ecosystem").arg(&self.office.file);
        let output = finish(&mut command);
        (output.status.code(), format!("{}{}", stdout(&output), stderr(&output)))
    }

    /// Returns the agents seen from a machine.
    pub(crate) fn seen(&self, machine: &str) -> Vec<String> {
        self.seen_in(&self.office.file, machine)
    }

    /// Returns the agents of an ecosystem seen from a machine.
    pub(crate) fn seen_in(&self, file: &Path, machine: &str) -> Vec<String> {
        let agents = self.agents_in(file, machine);
        agents.iter().filter_map(|each| Some(each["agent"].as_str()?.to_owned())).collect()
    }

    /// Returns the entries of `althing agents --json`, as seen from a machine.
    fn agents_in(&self, file: &Path, machine: &str) -> Vec<Value> {
        let answer = self.ask_json(file, machine, &["agents"]);
        answer["agents"].as_array().cloned().unwrap_or_default()
    }

    /// Returns the daemons of the agents seen from a machine, one per agent.
    pub(crate) fn hosts_seen(&self, machine: &str) -> Vec<String> {
        let agents = self.agents_in(&self.office.file, machine);
        agents.iter().filter_map(|each| Some(each["daemon"].as_str()?.to_owned())).collect()
    }

    /// Returns the incarnation of an agent as it is seen from a machine; `None` if it is not seen.
    pub(crate) fn incarnation_seen(&self, machine: &str, agent: &str) -> Option<u64> {
        let agents = self.agents_in(&self.office.file, machine);
        agents.iter().find(|each| each["agent"] == agent)?["incarnation"].as_u64()
    }

    /// Waits until a later incarnation of an agent than `before` is seen from a machine. The
    /// absence in between may be too short to be seen.
    pub(crate) fn await_later_incarnation(&self, machine: &str, agent: &str, before: u64) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let seen = self.incarnation_seen(machine, agent);
            if seen.is_some_and(|seen| seen > before) {
                return;
            }
            assert!(Instant::now() < deadline, "from `{machine}` is seen {agent} {seen:?}");
        }
    }

    /// Waits until the agents seen from a machine satisfy `is_right`.
    pub(crate) fn await_seen(&self, machine: &str, is_right: impl Fn(&[String]) -> bool) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let seen = self.seen(machine);
            if is_right(&seen) {
                return;
            }
            assert!(Instant::now() < deadline, "from `{machine}` are seen {seen:?}");
        }
    }

    /// Waits until each of these machines sees all these agents.
    pub(crate) fn await_all(&self, machines: &[&str], agents: &[&str]) {
        for machine in machines {
            self.await_seen(machine, |seen| agents.iter().all(|each| has(seen, each)));
        }
    }
}

/// Whether an agent is among those seen.
pub(crate) fn has(seen: &[String], agent: &str) -> bool {
    seen.iter().any(|each| each == agent)
}

/// Returns the name of a cable's end. Interface names have at most 15 characters.
fn wire(machine: &str, network: &str) -> String {
    // The last characters are kept, because names of machines such as boards and laptops differ
    // there.
    let letters: Vec<_> = machine.chars().filter(char::is_ascii_alphanumeric).collect();
    let machine: String = letters[letters.len().saturating_sub(9)..].iter().collect();
    let network: String = network.chars().take(5).collect();
    format!("{machine}-{network}")
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

/// Returns the path where Cargo puts an example of this profile.
pub(crate) fn example(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_BIN_EXE_althing")).parent().expect("a folder");
    folder.join("examples").join(name)
}

/// Creates an office with this ecosystem file, and a certificate for each of these names.
pub(crate) fn secured(text: &str, names: &[&str]) -> Office {
    let office = Office::new();
    let file = office.write("site.toml", &format!("{text}\n[security]\nfolder = \"keys\"\n"));
    let path = file.display().to_string();
    for arguments in [
        &["cert", "authority", &path][..],
        &[&["cert", "daemon", "--ecosystem", &path], names].concat(),
    ] {
        let made = office.run(arguments);
        assert!(made.status.success(), "{arguments:?}: {}", stderr(&made));
    }
    office.with_file(file)
}

/// Returns the repository's smart office, with these lines in its `[zenoh]` table.
pub(crate) fn smart_office(zenoh: &str) -> String {
    let file = Office::file().canonicalize().expect("it is there");
    let domains = file.ancestors().nth(2).expect("a folder").join("domains");
    let file = std::fs::read_to_string(&file).expect("the repository's own");
    let file = file.replace("../domains", &text(&domains));
    file.replace("\n[zenoh]\n", &format!("\n[zenoh]\n{zenoh}\n"))
}
