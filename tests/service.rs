//! A daemon under a service manager: a socket of this test receives what systemd would.

use std::fs;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Office, PATIENCE};

/// The service manager's side.
struct Manager {
    socket: UnixDatagram,
    path: std::path::PathBuf,
}

impl Manager {
    fn beside(office: &Office) -> Manager {
        let path = office.runtime_folder().with_file_name("notify.sock");
        let socket = UnixDatagram::bind(&path).expect("a socket");
        socket.set_read_timeout(Some(PATIENCE)).expect("a time-out");
        Manager { socket, path }
    }

    /// Returns the next notification.
    fn hears(&self) -> String {
        let mut bytes = [0; 4096];
        let length = self.socket.recv(&mut bytes).expect("the daemon speaks in time");
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    }

    /// Waits for the notification `what`; returns those before it.
    fn awaits(&self, what: &str) -> Vec<String> {
        let mut before = Vec::new();
        loop {
            let heard = self.hears();
            if heard.lines().any(|line| line == what) {
                return before;
            }
            before.push(heard);
        }
    }
}

/// A daemon that ends with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn up(office: &Office, manager: &Manager, watchdog: Option<Duration>) -> Ends {
    let file = Office::file().display().to_string();
    let mut command = office.command(&["up", &file]);
    command.env("NOTIFY_SOCKET", &manager.path).env_remove("WATCHDOG_PID").stdout(Stdio::null());
    match watchdog {
        Some(deadline) => command.env("WATCHDOG_USEC", deadline.as_micros().to_string()),
        None => command.env_remove("WATCHDOG_USEC"),
    };
    Ends(command.spawn().expect("the binary is built"))
}

#[test]
fn the_service_manager_is_notified_from_start_to_stop() {
    let office = Office::new();
    let manager = Manager::beside(&office);
    let mut daemon = up(&office, &manager, Some(Duration::from_millis(300)));

    assert!(manager.awaits("READY=1").is_empty(), "nothing is said before it is ready");
    let (code, agents) = office.ask(&["agents"]);
    assert_eq!(code, Some(0), "{agents}");
    assert!(agents.contains("turtlebot-1"), "when it says so, it is: {agents}");

    // The daemon notifies three times per deadline: ten notifications take well under ten
    // deadlines.
    let began = Instant::now();
    for _ in 0..10 {
        manager.awaits("WATCHDOG=1");
    }
    assert!(began.elapsed() < PATIENCE, "signs of life come all the time");

    office.terminate(&daemon.0);
    let before = manager.awaits("STOPPING=1");
    assert!(before.iter().all(|heard| heard.contains("WATCHDOG=1")), "{before:?}");
    assert!(daemon.0.wait().expect("our child").success(), "stopping is no failure");
}

#[test]
fn no_keep_alive_is_sent_without_a_watchdog() {
    let office = Office::new();
    let manager = Manager::beside(&office);
    let daemon = up(&office, &manager, None);
    manager.awaits("READY=1");
    office.terminate(&daemon.0);
    assert!(manager.awaits("STOPPING=1").is_empty());
}

#[test]
fn the_unit_waits_for_the_notifications_of_the_daemon() {
    let unit = fs::read_to_string(
        std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../../deploy/systemd/althing.service"),
    );
    let unit = unit.expect("the unit is in deploy/systemd");
    for line in ["Type=notify", "NotifyAccess=main", "RestartPreventExitStatus=78"] {
        assert!(unit.lines().any(|written| written == line), "no `{line}`");
    }
    assert!(unit.lines().any(|line| line.starts_with("WatchdogSec=")), "no watchdog");
}

/// Without the folder no command and no new daemon could connect.
#[test]
fn a_daemon_whose_folder_of_sockets_is_deleted_makes_it_again() {
    let office = Office::new();
    let manager = Manager::beside(&office);
    let _daemon = up(&office, &manager, None);
    manager.awaits("READY=1");
    fs::remove_dir_all(office.runtime_folder().join("smart-office")).expect("it is there");
    manager.awaits("READY=1");
    let (code, agents) = office.ask(&["agents"]);
    assert_eq!(code, Some(0), "{agents}");
    assert!(agents.contains("turtlebot-1"), "{agents}");
}

#[test]
fn a_daemon_with_few_file_handles_warns_at_start() {
    let office = Office::new();
    let manager = Manager::beside(&office);
    let file = Office::file().display().to_string();
    let plain = office.command(&["up", &file]);
    let log = office.folder().join("log");
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -S -n 200 && exec \"$0\" \"$@\""]);
    command.arg(plain.get_program()).args(plain.get_args());
    for (name, value) in plain.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command.env("NOTIFY_SOCKET", &manager.path).env_remove("WATCHDOG_PID").stdout(Stdio::null());
    command.env("ALTHING_LOG", "warn").stderr(fs::File::create(&log).expect("a file"));
    let _daemon = Ends(command.spawn().expect("there is a shell"));
    manager.awaits("READY=1");
    // A separate thread writes the log.
    let began = Instant::now();
    let mut said = String::new();
    while !said.contains("files open") && began.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(50));
        said = fs::read_to_string(&log).expect("a file");
    }
    assert!(said.contains("only 200 files open") && said.contains("ulimit -n 512"), "{said}");
}
