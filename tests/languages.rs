//! An agent in another language: the Python thermometer of `plugins/python`, a process of its own
//! that uses nothing but the protocol.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::support::left_out::left_out;
use crate::support::packages::python;
use crate::support::{Office, lab};

/// The Python agent; it is killed with the test.
struct Thermometer(Child);

impl Thermometer {
    fn start(office: &Office, python: &Path, name: &str, room: &str) -> Thermometer {
        let script = Path::new(env!("CARGO_MANIFEST_DIR"));
        let script = script.join("../../../plugins/python/thermometer.py");
        let socket = office.runtime_folder().join("lab/daemon.sock");
        let endpoint = format!("unixsock-stream/{}", socket.display());
        let mut command = office.program(python);
        command.arg(script).args(["lab", &endpoint, name, room]);
        let mut child = command.stdout(Stdio::piped()).spawn().expect("it is installed");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("piped");
        BufReader::new(stdout).read_line(&mut line).expect("it says so");
        assert_eq!(line, format!("{name} is here\n"));
        Thermometer(child)
    }

    /// Kills the agent by SIGKILL.
    fn die(&mut self) {
        self.0.kill().expect("our own child");
        self.0.wait().expect("our own child");
    }
}

impl Drop for Thermometer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Validates lines of `althing watch --json` against the published schema; prints the
/// performatives.
const HELD_AGAINST_SCHEMA: &str = r#"
import json, sys
import jsonschema
validator = jsonschema.Draft202012Validator(json.load(open(sys.argv[1])))
seen = set()
for line in open(sys.argv[2]):
    message = json.loads(line)["message"]
    seen.add(message["performative"])
    validator.validate(message)
try:
    validator.validate(message | {"performative": "request", "content": {"act": "fly"}})
except jsonschema.ValidationError:
    print(*sorted(seen))
"#;

fn office(mode: &str) -> Office {
    let office = Office::new();
    let file = office.write("lab.toml", &lab(mode));
    let mut office = office.with_file(file);
    office.up(&["daemon"], &[]);
    office
}

#[test]
fn an_agent_in_python_joins_is_planned_with_acts_and_dies() {
    let Some(python) = python() else { return };
    for mode in ["decentralized", "centralized"] {
        let office = office(mode);
        let mut thermometer = Thermometer::start(&office, python, "py-1", "office2");
        office.await_devices(1);
        let goal = ["goal", "(known-temperature office2)"];
        let (code, said) = office.ask(&goal);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert!(said.contains("22.5 °C at office2"), "{mode}: {said}");
        let state = office.ask_json(&["state"]).to_string();
        assert!(state.contains("(= (temperature office2) 22.5)"), "{mode}: {state}");

        let elsewhere = ["goal", "(known-temperature office1)"];
        let (code, said) = office.ask(&elsewhere);
        assert_eq!(code, Some(1), "{mode}: it does not stand there: {said}");

        thermometer.die();
        office.await_devices(0);
        let _again = Thermometer::start(&office, python, "py-1", "office1");
        office.await_devices(1);
        let (code, said) = office.ask(&elsewhere);
        assert_eq!(code, Some(0), "{mode}: it stands there in its next life: {said}");
    }
}

#[test]
fn messages_of_both_flows_match_the_published_schema() {
    let Some(python) = python() else { return };
    let has_validator = Command::new(python).args(["-c", "import jsonschema"]).status();
    if !has_validator.is_ok_and(|status| status.success()) {
        let python = python.display();
        return left_out(&format!("{python} has no jsonschema: pip install jsonschema"));
    }
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../docs/protocol.schema.json");
    for (mode, expected) in [
        ("decentralized", ["accept-proposal", "agree", "cfp", "confirm", "inform", "request"]),
        ("centralized", ["accept-proposal", "agree", "confirm", "inform", "propose", "request"]),
    ] {
        let office = office(mode);
        let _thermometer = Thermometer::start(&office, python, "py-1", "office2");
        office.await_devices(1);
        let heard = office.folder().join("heard");
        let file = office.folder().join("lab.toml").display().to_string();
        let mut watch = office.command(&["watch", "--json", "--ecosystem", &file]);
        let mut watch = Listening::start(&mut watch, &heard);
        let (code, said) = office.ask(&["goal", "(known-temperature office2)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        watch.until("\"outcome\":\"done\"");
        drop(watch);
        let mut held = office.program(python);
        held.args(["-c", HELD_AGAINST_SCHEMA]).arg(&schema).arg(&heard);
        let held = held.output().expect("it is installed");
        let complaint = String::from_utf8_lossy(&held.stderr).into_owned();
        let seen = String::from_utf8_lossy(&held.stdout).into_owned();
        for performative in expected {
            assert!(seen.contains(performative), "{mode}: {performative}: {seen}{complaint}");
        }
    }
}

/// A command with its output in a file. The command is ended with the test.
struct Listening {
    child: Child,
    file: std::path::PathBuf,
}

impl Listening {
    /// Starts the command and waits until it receives messages.
    fn start(command: &mut Command, file: &Path) -> Listening {
        let words = std::fs::File::create(file).expect("a file");
        let mut child = command.stdout(words).stderr(Stdio::piped()).spawn().expect("it is ours");
        let mut line = String::new();
        let stderr = child.stderr.take().expect("piped");
        BufReader::new(stderr).read_line(&mut line).expect("it says so");
        assert!(line.starts_with("listening"), "{line}");
        Listening { child, file: file.to_owned() }
    }

    /// Waits until the output of the command contains `words`.
    fn until(&mut self, words: &str) {
        let deadline = std::time::Instant::now() + std::time::Duration::from_secs(30);
        while !std::fs::read_to_string(&self.file).expect("a file").contains(words) {
            assert!(std::time::Instant::now() < deadline, "it never said {words}");
            std::thread::yield_now();
        }
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
