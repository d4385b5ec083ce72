//! Attacks of a confined plugin on a real daemon: on its sockets, on the owner's files, on other
//! processes, on kernel limits. Each way to confine is tested alone: with a kernel that has all of
//! them, without namespaces, without Landlock, and with the system calls that the shipped unit
//! allows.
//!
//! Tests that need a missing feature of this kernel are skipped with a report. Without a
//! confinement the same attacks must succeed, otherwise they would prove nothing.

mod support;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::{SocketAddr, UnixDatagram, UnixListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::str::FromStr as _;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use support::left_out::left_out;
use support::{Office, lab};
use syscalls::Sysno;

const PATIENCE: Duration = Duration::from_secs(120);
const ATTACKS: &str = include_str!("confinement/attacks.py");
const FILTERED: &str = include_str!("confinement/filtered.py");
const KEY: &str = "nobody else's";

/// Attacks that succeed for a plugin with the `network` right.
const ONLINE: [&str; 4] = [
    "connects-over-tcp",
    "opens-a-socket-of-udp",
    "opens-a-socket-of-tcp",
    "opens-a-socket-of-netlink",
];
/// Actions that succeed for every plugin.
const RIGHTS: [&str; 6] = [
    "writes-at-home",
    "reads-its-package",
    "reads-what-it-was-given",
    "signals-its-child",
    "signals-itself",
    "pairs-sockets",
];

/// Targets of the attacks.
struct Targets {
    process: Decoy,
    named: UnixListener,
    name: String,
    _datagram: UnixDatagram,
    shared: UnixListener,
    tcp: std::net::TcpListener,
    key: PathBuf,
    before: String,
}

/// A process of this test that ends with it.
struct Decoy(Child);

impl Drop for Decoy {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Targets {
    fn new(folder: &Path) -> Targets {
        let key = folder.join("key.pem");
        fs::write(&key, KEY).expect("a file");
        fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).expect("our own");
        let process = Decoy(Command::new("sleep").arg("3600").spawn().expect("it is everywhere"));
        let name = format!("althing-test-{}", process.0.id());
        let address = SocketAddr::from_abstract_name(&name).expect("a name");
        let named = UnixListener::bind_addr(&address).expect("a socket");
        named.set_nonblocking(true).expect("a socket");
        let datagram = UnixDatagram::bind(folder.join("datagram.sock")).expect("a socket");
        fs::create_dir_all(folder.join("shared")).expect("a folder");
        let shared = UnixListener::bind(folder.join("shared/other.sock")).expect("a socket");
        shared.set_nonblocking(true).expect("a socket");
        let tcp = std::net::TcpListener::bind("127.0.0.1:0").expect("a socket");
        tcp.set_nonblocking(true).expect("a socket");
        let before = limits(&process);
        Targets { process, named, name, _datagram: datagram, shared, tcp, key, before }
    }

    /// Writes the targets and the attacks into the package.
    fn describe(&self, folder: &Path, sockets: &[PathBuf]) {
        let outside = self.key.parent().expect("a folder");
        let inside = folder.join("inside");
        fs::write(&inside, KEY).expect("a file");
        let port = self.tcp.local_addr().expect("it has one").port();
        let targets = json!({
            "sockets": sockets, "name": self.name, "datagram": outside.join("datagram.sock"),
            "victim": self.key, "inside": inside, "folder": outside, "port": port,
            "process": self.process.0.id(), "shared": outside.join("shared/other.sock"),
        });
        fs::write(folder.join("targets.json"), targets.to_string()).expect("a file");
        fs::write(folder.join("attacks.py"), ATTACKS).expect("a file");
    }

    /// Checks that no target was changed and no socket was connected to.
    fn are_as_they_were(&mut self, inside: &Path, is_online: bool) {
        for file in [&self.key, &inside.to_owned()] {
            assert_eq!(fs::read_to_string(file).expect("it is there"), KEY, "{}", file.display());
            let metadata = fs::metadata(file).expect("it is there");
            assert!(metadata.mtime() > 0, "{}", file.display());
            assert_ne!(metadata.mode() & 0o777, 0o666, "{}", file.display());
        }
        assert!(!self.key.with_file_name("left").exists());
        assert!(self.process.0.try_wait().expect("our child").is_none(), "it lives");
        assert_eq!(limits(&self.process), self.before);
        assert!(self.named.accept().is_err(), "nobody has come");
        assert!(self.shared.accept().is_err(), "nobody has come");
        assert_eq!(self.tcp.accept().is_ok(), is_online);
    }
}

/// Returns the limits of a process and its allowed processors, as the kernel reports them.
fn limits(decoy: &Decoy) -> String {
    let read = |file: &str| fs::read_to_string(format!("/proc/{}/{file}", decoy.0.id()));
    let status = read("status").expect("it lives");
    let cpus = status.lines().find(|line| line.starts_with("Cpus_allowed_list")).unwrap_or("");
    format!("{}{cpus}", read("limits").expect("it lives"))
}

/// Whether there is a Python; the attacks need no library.
fn has_python() -> bool {
    let found = Command::new("python3").arg("--version").output();
    let is_there = found.is_ok_and(|output| output.status.success());
    if !is_there {
        left_out("there is no python3");
    }
    is_there
}

/// Returns the sockets of all daemons.
fn sockets_of_daemons(folder: &Path) -> Vec<PathBuf> {
    let mut sockets = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        use std::os::unix::fs::FileTypeExt as _;
        let (path, kind) = (entry.path(), entry.file_type().expect("a type"));
        if kind.is_socket() {
            sockets.push(path);
        } else if kind.is_dir() && path.extension().is_none_or(|end| end != "plugins") {
            sockets.extend(sockets_of_daemons(&path));
        }
    }
    sockets
}

/// Starts an office; `command` makes the daemon's command from a program and its arguments.
fn office(more: &str, command: impl FnOnce(&Office, &[&str]) -> Command) -> Office {
    let office = Office::new();
    let file = office.write("lab.toml", &(lab("decentralized") + more));
    let shown = file.display().to_string();
    let mut office = office.with_file(file);
    let daemon = [env!("CARGO_BIN_EXE_althing"), "up", &shown, "--daemon", "daemon"];
    let command = command(&office, &daemon);
    office.begin_as("daemon", command);
    office
}

fn plainly(office: &Office, daemon: &[&str]) -> Command {
    let mut command = office.program(daemon[0]);
    command.args(&daemon[1..]);
    command
}

/// Returns the answer of the office's daemon to `plugin list`.
fn list(office: &Office) -> Value {
    office.ask_json(&["plugin", "list"])["daemons"][0].clone()
}

fn await_listed(office: &Office, is_so: impl Fn(&Value) -> bool) -> Value {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let listed = list(office);
        if is_so(&listed) {
            return listed;
        }
        assert!(Instant::now() < deadline, "it is not so: {listed}");
    }
}

/// Waits until the log of a plugin contains a text; returns the whole log. The log is used because
/// the reason of a state disappears with the next state.
fn await_logged(office: &Office, name: &str, text: &str) -> String {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let (code, said) = office.ask(&["plugin", "logs", name, "-n", "1000"]);
        if code == Some(0) && said.contains(text) {
            return said;
        }
        assert!(Instant::now() < deadline, "`{name}` has not said `{text}`: {said}");
    }
}

/// Builds the attacking package, outside the folder of plugins.
fn package(office: &Office, targets: &Targets, network: bool) -> PathBuf {
    let folder = office.folder().join("made").join("attacker");
    fs::create_dir_all(&folder).expect("a folder");
    targets.describe(&folder, &sockets_of_daemons(&office.runtime_folder()));
    let text = format!(
        "name = \"attacker\"\nversion = \"1\"\nprotocol = \"2\"\nrun = [\"python3\", \"attacks.py\"]\n\
         ready-within = \"60s\"\n\n[[agent]]\nname = \"agent-of-attacker\"\n\n[permissions]\n\
         network = {network}\nread = [\"{}\"]\n",
        office.folder().join("shared").display()
    );
    fs::write(folder.join("plugin.toml"), text).expect("a file");
    folder
}

/// Installs the attacker, waits until it has tried everything, and checks which attacks succeeded.
fn attack(office: &Office, network: bool) {
    let mut targets = Targets::new(office.folder());
    let folder = package(office, &targets, network);
    let inside = office.plugins_folder().join("attacker/inside");
    let text = fs::read_to_string(folder.join("targets.json")).expect("a file");
    let from = folder.join("inside").display().to_string();
    let text = text.replace(&from, &inside.display().to_string());
    fs::write(folder.join("targets.json"), text).expect("a file");
    let shown = folder.display().to_string();
    let online: &[&str] = if network { &["--allow", "network"] } else { &[] };
    add(office, &shown, online);
    let said = await_logged(office, "attacker", "all was tried");
    let succeeded: BTreeSet<_> =
        said.lines().filter_map(|line| Some(line.split_once("succeeded ")?.1)).collect();
    let may = RIGHTS.into_iter().chain(ONLINE.into_iter().filter(|_| network)).collect();
    assert_eq!(succeeded, may, "{said}");
    targets.are_as_they_were(&inside, network);
    // The daemon still works.
    let (code, said) = office.ask(&["agents"]);
    assert!(code == Some(0) && said.contains("plan-executor"), "{said}");
}

/// Installs a package and allows the reading that it asks for.
fn add(office: &Office, package: &str, allowed: &[&str]) {
    let read = format!("read={}", office.folder().join("shared").display());
    let add = [&["plugin", "add", package, "--allow", &read], allowed].concat();
    let (code, said) = office.ask(&add);
    assert_eq!(code, Some(0), "{said}");
}

/// Attacks with the right to the network and without.
fn attack_both_ways(command: impl Fn(&Office, &[&str]) -> Command) {
    for network in [false, true] {
        attack(&office("", &command), network);
    }
}

/// Returns the system calls that a filter answers with an error, by number.
fn errors(calls: &[(&str, i32)]) -> Vec<(i32, i32)> {
    let number = |name: &str| Sysno::from_str(name).ok().map(|call| call.id());
    calls.iter().filter_map(|(name, error)| Some((number(name)?, *error))).collect()
}

/// Returns the kernel's identifier of this machine in filters (`AUDIT_ARCH_…`).
fn machine() -> Option<u32> {
    BTreeMap::from([("x86_64", 0xc000_003e), ("aarch64", 0xc000_00b7)])
        .get(std::env::consts::ARCH)
        .copied()
}

fn filtered(office: &Office, rules: &Value, daemon: &[&str]) -> Command {
    let mut command = office.program("python3");
    command.args(["-c", FILTERED, &rules.to_string()]).args(daemon);
    command
}

#[test]
fn without_a_confinement_the_attacks_succeed() {
    if !has_python() {
        return;
    }
    let office = office("", plainly);
    let targets = Targets::new(office.folder());
    let folder = package(&office, &targets, false);
    let mut command = office.program("python3");
    command.arg(folder.join("attacks.py")).env("HOME", office.folder());
    let output = support::finish(&mut command);
    let said = support::stdout(&output);
    assert_eq!(output.status.code(), Some(7), "{said}{}", support::stderr(&output));
    for attack in [
        "overhears-a-daemon",
        "connects-by-a-link",
        "connects-to-a-name",
        "connects-in-a-folder-that-it-reads",
        "sends-a-datagram",
        "reads-a-key",
        "writes-a-key",
        "truncates-a-key",
        "empties-a-key-by-reading",
        "empties-a-key-by-neither",
        "changes-the-mode-of-a-key",
        "changes-the-times-of-a-key",
        "links-a-key",
        "removes-a-key",
        "leaves-a-file",
        "watches-a-key",
        "signals",
        "signals-by-a-file",
        "limits-a-process",
        "moves-a-process",
        "slows-a-process",
        "reads-the-environment-of-a-process",
        "leaves-its-group",
        "opens-a-socket-of-udp",
        "holds-memory-without-a-name",
        "holds-memory-that-it-shares",
        "holds-memory-of-zero",
        "enlarges-the-buffer-of-a-socket",
        "enlarges-the-buffer-of-a-pipe",
        "lends-pages-to-a-pipe",
        "shares-memory",
        "connects-over-tcp",
    ] {
        assert!(said.lines().any(|line| line == format!("succeeded {attack}")), "{said}");
    }
    assert!(targets.named.accept().is_ok(), "it came");
}

#[test]
fn a_plugin_reaches_nothing_with_all_features_of_this_kernel() {
    if !has_python() {
        return;
    }
    for network in [false, true] {
        let office = office("", plainly);
        let listed = await_listed(&office, |listed| {
            listed["confinement"]["means"]["landlock"].as_i64() > Some(0)
        });
        assert_eq!(listed["confinement"]["not-enforced"], json!([]), "{listed}");
        attack(&office, network);
    }
}

#[test]
fn a_plugin_reaches_nothing_without_namespaces() {
    if !has_python() {
        return;
    }
    let none = "echo 0 > /proc/sys/user/max_user_namespaces && exec \"$@\"";
    let without = ["--user", "--map-root-user", "sh", "-c", none, "sh"];
    let tried = Command::new("unshare").args(without).arg("true").output();
    if !tried.is_ok_and(|output| output.status.success()) {
        return left_out("namespaces of users cannot be made here, so none can be forbidden");
    }
    let command = |office: &Office, daemon: &[&str]| {
        let mut command = office.program("unshare");
        command.args(without).args(daemon);
        command
    };
    let office = office("", command);
    let listed =
        await_listed(&office, |listed| listed["confinement"]["means"]["no-namespaces"].is_string());
    assert_eq!(listed["confinement"]["not-enforced"], json!([]), "{listed}");
    attack_both_ways(command);
}

#[test]
fn a_plugin_reaches_nothing_without_landlock() {
    if !has_python() {
        return;
    }
    let Some(machine) = machine() else { return left_out("this machine is of an unknown kind") };
    let calls = ["landlock_create_ruleset", "landlock_add_rule", "landlock_restrict_self"];
    let rules =
        json!({ "machine": machine, "errors": errors(&calls.map(|call| (call, no_call()))) });
    attack_both_ways(|office, daemon| filtered(office, &rules, daemon));
}

/// Returns `ENOSYS`: the kernel has no such call.
fn no_call() -> i32 {
    rustix::io::Errno::NOSYS.raw_os_error()
}

/// Returns the calls that the shipped unit allows, as this machine's systemd expands them.
fn calls_of_the_unit() -> Option<BTreeSet<i32>> {
    let output = Command::new("systemd-analyze").arg("syscall-filter").output().ok()?;
    let text = String::from_utf8(output.stdout).ok().filter(|_| output.status.success())?;
    let mut groups: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    let mut group = "";
    for line in text.lines().filter(|line| !line.trim_start().starts_with('#')) {
        if line.starts_with('@') {
            group = line.trim();
        } else if !line.trim().is_empty() {
            groups.entry(group).or_default().push(line.trim());
        }
    }
    fn expanded<'t>(groups: &BTreeMap<&'t str, Vec<&'t str>>, name: &'t str) -> BTreeSet<&'t str> {
        match groups.get(name) {
            Some(names) => names.iter().flat_map(|name| expanded(groups, name)).collect(),
            None => BTreeSet::from([name]),
        }
    }
    let mut allowed = BTreeSet::new();
    for line in unit().lines().filter_map(|line| line.strip_prefix("SystemCallFilter=")) {
        for name in line.trim_start_matches('~').split_whitespace() {
            for call in expanded(&groups, name) {
                match line.starts_with('~') {
                    true => allowed.remove(call),
                    false => allowed.insert(call.to_owned()),
                };
            }
        }
    }
    // The calls that systemd itself needs to start a program cannot be forbidden.
    allowed.extend(expanded(&groups, "@default").iter().map(|call| (*call).to_owned()));
    Some(
        allowed
            .iter()
            .filter_map(|name| Sysno::from_str(name).ok())
            .map(|call| call.id())
            .collect(),
    )
}

fn unit() -> String {
    let unit =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../deploy/systemd/althing.service");
    fs::read_to_string(unit).expect("the unit is in deploy/systemd")
}

#[test]
fn a_plugin_starts_and_reaches_nothing_with_the_calls_of_the_shipped_unit() {
    if !has_python() {
        return;
    }
    let Some(machine) = machine() else { return left_out("this machine is of an unknown kind") };
    let Some(allowed) = calls_of_the_unit() else {
        return left_out("there is no systemd-analyze, which knows the groups of calls");
    };
    assert!(unit().contains("\nRestrictNamespaces=yes\n"), "the filter below forbids them");
    let denied = rustix::io::Errno::PERM.raw_os_error();
    let errors = errors(&[("unshare", denied), ("setns", denied), ("clone3", no_call())]);
    let rules =
        json!({ "machine": machine, "errors": errors, "allowed": allowed, "other": denied });
    let is_root = rustix::process::geteuid().is_root();
    attack_both_ways(|office, daemon| {
        let mut command = filtered(office, &rules, daemon);
        if is_root {
            // The unit's daemon has no capabilities.
            let mut bare = office.program("setpriv");
            bare.args(["--bounding-set=-all", "--inh-caps=-all", "--no-new-privs", "python3"]);
            bare.args(command.get_args());
            command = bare;
        }
        command
    });
}

#[test]
fn no_plugin_runs_if_required_confinement_is_incomplete() {
    if !has_python() {
        return;
    }
    let Some(machine) = machine() else { return left_out("this machine is of an unknown kind") };
    // Neither namespaces nor Landlock are available.
    let denied = rustix::io::Errno::PERM.raw_os_error();
    let calls = [
        ("unshare", denied),
        ("landlock_create_ruleset", denied),
        ("landlock_restrict_self", denied),
    ];
    let rules = json!({ "machine": machine, "errors": errors(&calls) });
    let made = |office: &Office| {
        let targets = Targets::new(office.folder());
        let folder = package(office, &targets, false).display().to_string();
        add(office, &folder, &[]);
    };
    let required = office("[plugins]\nconfinement = \"require\"\n", |office, daemon| {
        filtered(office, &rules, daemon)
    });
    made(&required);
    let listed = await_listed(&required, |listed| listed["plugins"][0]["state"] == "not-confined");
    let reason = listed["plugins"][0]["reason"].as_str().unwrap_or_default();
    assert!(reason.contains("it can read, change and remove all files of this user"), "{reason}");
    let (code, said) = required.ask(&["plugin", "list"]);
    assert_eq!(code, Some(0), "{said}");
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("not confined"), "{said}");
    assert!(said.contains("not enforced on `daemon`, of a plugin: it can read"), "{said}");
    drop(required);
    // If confinement is not required, the plugin runs, and the missing parts are reported.
    let available = office("", |office, daemon| filtered(office, &rules, daemon));
    made(&available);
    let said = await_logged(&available, "attacker", "all was tried");
    assert!(said.contains("not enforced here: it can read"), "{said}");
    let listed = list(&available);
    let lacks = listed["plugins"][0]["not-enforced"].to_string();
    assert!(lacks.contains("it can read, change and remove all files of this user"), "{listed}");
}

/// A delegated control group with its subgroups; removed at the end.
struct Delegated(PathBuf);

impl Delegated {
    /// Creates one, as a service manager does. Returns the reason if that is not possible.
    fn new() -> Result<Delegated, String> {
        let root = Path::new("/sys/fs/cgroup");
        let known = fs::read_to_string(root.join("cgroup.controllers")).unwrap_or_default();
        let has = |name: &str| known.split_whitespace().any(|known| known == name);
        if !["cpu", "memory", "pids"].into_iter().all(has) {
            return Err("this machine has no control groups of version 2 with controllers".into());
        }
        fs::write(root.join("cgroup.subtree_control"), "+cpu +memory +pids")
            .map_err(|error| format!("control groups cannot be made here: {error}"))?;
        let folder = root.join(format!("althing-test-{}", std::process::id()));
        fs::create_dir(&folder).map_err(|error| error.to_string())?;
        let given = "import os, sys; os.setxattr(sys.argv[1], 'trusted.delegate', b'1')";
        let given = Command::new("python3").args(["-c", given]).arg(&folder).status();
        let is_given = given.is_ok_and(|status| status.success());
        let group = Delegated(folder);
        is_given.then_some(group).ok_or_else(|| "a control group cannot be given away here".into())
    }
}

impl Drop for Delegated {
    fn drop(&mut self) {
        let _ = fs::write(self.0.join("cgroup.kill"), "1");
        for entry in fs::read_dir(&self.0).into_iter().flatten().flatten() {
            let _ = fs::remove_dir(entry.path());
        }
        let _ = fs::remove_dir(&self.0);
    }
}

/// Installs a package that runs a Python program.
fn add_program(office: &Office, name: &str, program: &str, permissions: &str) {
    let folder = office.folder().join("made").join(name);
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join("program.py"), program).expect("a file");
    let text = format!(
        "name = \"{name}\"\nversion = \"1\"\nprotocol = \"2\"\nrun = [\"python3\", \"program.py\"]\n\
         ready-within = \"60s\"\n\n[[agent]]\nname = \"agent-of-{name}\"\n\n[permissions]\n{permissions}"
    );
    fs::write(folder.join("plugin.toml"), text).expect("a file");
    let (code, said) = office.ask(&["plugin", "add", &folder.display().to_string()]);
    assert_eq!(code, Some(0), "{said}");
}

/// The plugin's files have no name and are open in no process, so their memory belongs to no
/// process.
#[test]
fn memory_in_sockets_and_pipes_of_a_plugin_is_counted() {
    if !has_python() {
        return;
    }
    let office = office("", plainly);
    let files = "import array, os, socket, time\n\
        near, far = socket.socketpair()\n\
        for number in range(20):\n\
        \x20   path = os.path.join(os.environ['HOME'], str(number))\n\
        \x20   file = os.open(path, os.O_CREAT | os.O_RDWR)\n\
        \x20   os.unlink(path)\n\
        \x20   os.write(file, bytes(1 << 20))\n\
        \x20   near.sendmsg([b'x'], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array('i', [file]))])\n\
        \x20   os.close(file)\n\
        print('all is hidden', flush=True)\ntime.sleep(600)\n";
    add_program(&office, "files", files, "disk = \"2MiB\"\n");
    await_logged(&office, "files", "it keeps 20 open files in messages that none of its processes");
    let buffers = "import os, socket, time\n\
        kept = []\n\
        for child in range(3):\n\
        \x20   if os.fork() == 0: break\n\
        for _ in range(25):\n\
        \x20   for end in socket.socketpair():\n\
        \x20       kept.append(end)\n\
        \x20       end.setblocking(False)\n\
        \x20       try:\n\
        \x20           while True: end.send(b'small')\n\
        \x20       except BlockingIOError: pass\n\
        time.sleep(600)\n";
    add_program(&office, "buffers", buffers, "memory = \"64MiB\"\n");
    let said = await_logged(&office, "buffers", " MiB of memory, and may hold 64");
    assert!(!said.contains("Traceback"), "{said}");
}

#[test]
fn memory_without_a_name_counts_in_a_control_group() {
    use std::io::Write as _;
    let group = match Delegated::new() {
        Ok(group) => group,
        // No package can change how the kernel's control groups are mounted, so CI does not require
        // it.
        Err(why) => {
            let _ = writeln!(std::io::stderr(), "\nNOT TESTED: limits of control groups: {why}\n");
            return;
        }
    };
    let joins = format!("echo $$ > {}/cgroup.procs && exec \"$@\"", group.0.display());
    let office = office("", |office, daemon| {
        let mut command = office.program("sh");
        command.args(["-c", &joins, "sh"]).args(daemon);
        command
    });
    let hides = "import os, time\nfile = os.memfd_create('hidden')\n\
                 for _ in range(300): os.write(file, bytes(1 << 20))\n\
                 print('it holds more than it may')\ntime.sleep(600)\n";
    add_program(&office, "hidden", hides, "");
    let said = await_logged(&office, "hidden", "it held more memory than it may: 128 MiB");
    assert!(!said.contains("it holds more than it may"), "{said}");
    let listed = list(&office);
    let limits = listed["confinement"]["limits"].as_str().unwrap_or_default();
    assert!(limits.contains("limited by the kernel"), "{listed}");
}
