//! Debian's MQTT broker on a port that the kernel chose, and devices that use it.

#[allow(clippy::duplicate_mod, reason = "crates include this file without the others")]
#[path = "left_out.rs"]
mod left_out;

use std::io::{BufRead as _, BufReader};
use std::net::{Ipv4Addr, SocketAddrV4, TcpListener};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use rustix::net::sockopt::set_socket_reuseaddr;
use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with};
use tempfile::TempDir;

const PROGRAM: &str = "/usr/sbin/mosquitto";

/// How long the broker may take to start on a machine that is busy with other tests.
const BEGIN_MAX: Duration = Duration::from_secs(60);

/// How often another process may take the port between its choice and its use.
const TAKEN_MAX: u32 = 10;

/// No limits on queues: retained messages of hundreds of devices come at once.
const OPEN: &str = "allow_anonymous true\nmax_queued_messages 0\nmax_inflight_messages 0\n";

/// A broker; it ends with the test.
pub(crate) struct Broker {
    port: u16,
    child: Child,
    folder: TempDir,
    /// Socket that holds the broker's port while the broker is dead; otherwise another test's
    /// broker could get it.
    held: Option<OwnedFd>,
}

/// A process of a device; it ends with the test.
pub(crate) struct Subscriber(Child);

impl Broker {
    /// Starts a broker that every local process may use. Returns `None` with a report if it is not
    /// installed.
    pub(crate) fn start() -> Option<Broker> {
        Broker::start_in(tempfile::tempdir().expect("a folder"), OPEN)
    }

    /// Starts a broker with these settings; the files that they name are in `folder`.
    pub(crate) fn start_in(folder: TempDir, settings: &str) -> Option<Broker> {
        if !Path::new(PROGRAM).exists() {
            left_out::left_out("mosquitto is missing: apt-get install mosquitto mosquitto-clients");
            return None;
        }
        let (port, child) = (0..TAKEN_MAX)
            .find_map(|_| {
                let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0));
                let port = port.and_then(|free| free.local_addr()).expect("a free port").port();
                let config = format!("log_dest stderr\nlistener {port} 127.0.0.1\n{settings}");
                std::fs::write(folder.path().join("broker.conf"), config).expect("a file");
                Some((port, Broker::begin(&folder)?))
            })
            .expect("a port that nobody takes");
        Some(Broker { port, child, folder, held: None })
    }

    /// Starts the process, and returns it when it listens. Returns `None` if it cannot listen and
    /// has ended.
    fn begin(folder: &TempDir) -> Option<Child> {
        let mut command = Command::new(PROGRAM);
        command.arg("-c").arg(folder.path().join("broker.conf"));
        command.stderr(Stdio::piped()).stdout(Stdio::null());
        let mut child = command.spawn().expect("it is installed");
        let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines();
        let (begins, begun) = mpsc::channel();
        std::thread::spawn(move || {
            let mut lines = lines.by_ref().map_while(Result::ok);
            let runs = lines.any(|line| {
                if line.contains("Error") {
                    eprintln!("mosquitto: {line}");
                }
                line.ends_with(" running")
            });
            let _ = begins.send(runs);
            lines.for_each(drop);
        });
        let Ok(listens) = begun.recv_timeout(BEGIN_MAX) else {
            let _ = child.kill();
            let _ = child.wait();
            panic!("the broker does not say whether it listens");
        };
        if !listens {
            child.wait().expect("our own child");
        }
        listens.then_some(child)
    }

    /// Kills the broker by SIGKILL: it loses all retained messages.
    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("our own child");
        self.child.wait().expect("our own child");
        self.held = Some(hold(self.port));
    }

    pub(crate) fn restart(&mut self) {
        // A connection of another process may have taken the port as its own for a moment. No event
        // tells when it is free again.
        let until = Instant::now() + BEGIN_MAX;
        loop {
            self.held = None;
            if let Some(child) = Broker::begin(&self.folder) {
                self.child = child;
                return;
            }
            assert!(Instant::now() < until, "the port {} is taken", self.port);
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    /// Returns the path of one of the files of its settings.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the address of the broker, as a config names it.
    pub(crate) fn name(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.args(["-h", "127.0.0.1", "-p", &self.port.to_string(), "-q", "1"]);
        command.stderr(Stdio::null());
        command
    }

    /// Publishes a retained message, as a device does, and waits until the broker has it.
    pub(crate) fn retain(&self, topic: &str, text: &str) {
        self.say_with(&["-r", "-t", topic, "-m", text]);
    }

    /// Publishes the content of a file as a retained message.
    pub(crate) fn retain_file(&self, topic: &str, file: &Path) {
        self.say_with(&["-r", "-t", topic, "-f", &file.display().to_string()]);
    }

    /// Publishes a message.
    pub(crate) fn say(&self, topic: &str, text: &str) {
        self.say_with(&["-t", topic, "-m", text]);
    }

    fn say_with(&self, arguments: &[&str]) {
        let said = self.command("mosquitto_pub").args(arguments).status().expect("installed");
        assert!(said.success(), "the broker takes it: {said}");
    }

    /// Starts a device that calls `does` with each message, on a thread of its own.
    pub(crate) fn device(
        &self,
        topic: &str,
        mut does: impl FnMut(&str) + Send + 'static,
    ) -> Subscriber {
        self.devices(topic, move |_, text| does(text))
    }

    /// Starts devices that call `does` with the topic and the text of each message that matches a
    /// filter, on one thread.
    pub(crate) fn devices(
        &self,
        filter: &str,
        mut does: impl FnMut(&str, &str) + Send + 'static,
    ) -> Subscriber {
        let mut child = self
            .command("mosquitto_sub")
            // Each message is printed as a line, also an empty one.
            .args(["-t", filter, "-t", "$SYS/broker/uptime", "-F", "%t\t%p"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("it is installed");
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        // The broker's own status is retained: when it arrives, the subscription is active.
        lines.next().expect("it is told").expect("a text");
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok).filter(|line| !line.ends_with(" seconds")) {
                let (topic, text) = line.split_once('\t').unwrap_or((&line, ""));
                does(topic, text);
            }
        });
        Subscriber(child)
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Subscriber {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Holds a port so that no process listens there and no other process gets it.
fn hold(port: u16) -> OwnedFd {
    // Daemons that are started meanwhile must not inherit the socket.
    let flags = SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::INET, SocketType::STREAM, flags, None);
    let socket = socket.expect("a socket");
    // Remaining connections of the broker do not block the port; only the restarted broker gets it.
    set_socket_reuseaddr(&socket, true).expect("a socket");
    bind(&socket, &SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)).expect("the broker's port");
    set_socket_reuseaddr(&socket, false).expect("a socket");
    socket
}
