//! Debian's MQTT broker on a port that the kernel chose, and devices that speak to it.

use std::io::{BufRead as _, BufReader};
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

const PROGRAM: &str = "/usr/sbin/mosquitto";

/// A broker; it ends with the test.
pub(crate) struct Broker {
    port: u16,
    child: Child,
    folder: TempDir,
}

/// A process of a device; it ends with the test.
pub(crate) struct Subscriber(Child);

impl Broker {
    /// `None`, loudly, where it is not installed.
    pub(crate) fn start() -> Option<Broker> {
        if !Path::new(PROGRAM).exists() {
            assert!(std::env::var_os("CI").is_none(), "mosquitto is missing");
            eprintln!("NOT TESTED: apt-get install mosquitto mosquitto-clients");
            return None;
        }
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|free| free.local_addr());
        let port = port.expect("a free port").port();
        let folder = tempfile::tempdir().expect("a folder");
        // Retained words of hundreds of devices come at once.
        let config = format!(
            "listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n\
             max_inflight_messages 0\n"
        );
        std::fs::write(folder.path().join("broker.conf"), config).expect("a file");
        let broker = Broker { port, child: Broker::begin(&folder), folder };
        // From here on it listens.
        broker.say("begin", "");
        Some(broker)
    }

    fn begin(folder: &TempDir) -> Child {
        let mut command = Command::new(PROGRAM);
        command.arg("-c").arg(folder.path().join("broker.conf"));
        command.stderr(Stdio::null()).stdout(Stdio::null()).spawn().expect("it is installed")
    }

    /// By SIGKILL: it forgets all that was retained.
    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("our own child");
        self.child.wait().expect("our own child");
    }

    pub(crate) fn restart(&mut self) {
        self.child = Broker::begin(&self.folder);
    }

    /// What it is called in a config.
    pub(crate) fn name(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.args(["-h", "127.0.0.1", "-p", &self.port.to_string(), "-q", "1"]);
        command.stderr(Stdio::null());
        command
    }

    /// Says something that it keeps, as a device does, and is sure that the broker has it.
    pub(crate) fn retain(&self, topic: &str, text: &str) {
        self.say_with(&["-r", "-t", topic, "-m", text]);
    }

    /// Says something once.
    pub(crate) fn say(&self, topic: &str, text: &str) {
        self.say_with(&["-t", topic, "-m", text]);
    }

    fn say_with(&self, arguments: &[&str]) {
        let deadline = Instant::now() + Duration::from_secs(10);
        while !self.command("mosquitto_pub").args(arguments).status().expect("installed").success()
        {
            assert!(Instant::now() < deadline, "the broker does not listen");
            // The broker begins to listen.
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// A device that does something with each word it is told; `does` runs on a thread of its own.
    pub(crate) fn device(
        &self,
        topic: &str,
        mut does: impl FnMut(&str) + Send + 'static,
    ) -> Subscriber {
        let mut child = self
            .command("mosquitto_sub")
            .args(["-t", topic, "-t", "$SYS/broker/uptime"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("it is installed");
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        // What the broker says of itself is retained: now the device hears.
        lines.next().expect("it is told").expect("a text");
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok).filter(|line| !line.ends_with(" seconds")) {
                does(&line);
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
