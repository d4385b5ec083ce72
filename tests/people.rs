//! Problems that people met at a terminal: readers that close their pipe, goals that are left,
//! ports that are taken, text with terminal control sequences.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpListener;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::support::{Office, PATIENCE, ask, lab, lines, office, stderr, stdout};

fn file() -> String {
    Office::file().display().to_string()
}

/// A process that ends with its test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Ends {
    /// Waits up to `limit` for its end; returns its exit code.
    #[track_caller]
    fn within(&mut self, limit: Duration) -> Option<i32> {
        let deadline = Instant::now() + limit;
        loop {
            if let Some(status) = self.0.try_wait().expect("our child") {
                return status.code();
            }
            assert!(Instant::now() < deadline, "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

// === readers that close their pipe ===

/// Runs a command with a reader that closes its pipe after `lines` lines.
fn head(office: &Office, arguments: &[&str], lines: usize) -> Ends {
    let mut command = office.command(&[arguments, &["--ecosystem", &file()]].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().expect("the binary is built");
    let mut read = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    for _ in 0..lines {
        read.next().expect("a line").expect("text");
    }
    Ends(child)
}

#[test]
fn a_command_ends_when_its_reader_is_gone() {
    let mut office = Office::new();
    office.up_alone(&[]);
    for arguments in [&["watch"][..], &["watch", "--json"]] {
        let mut ended = head(&office, arguments, 1);
        assert_eq!(ended.within(PATIENCE), Some(0), "{arguments:?}");
    }
    let goal = ["goal", "temperatures", "--maintain"];
    for arguments in [goal.to_vec(), [&goal[..], &["--json"]].concat()] {
        let mut ended = head(&office, &arguments, 1);
        assert_eq!(ended.within(PATIENCE), Some(0), "{arguments:?}");
    }
    for arguments in [&["state"][..], &["agents", "--json"], &["domain"], &["goals"], &["mailbox"]]
    {
        let mut ended = head(&office, arguments, 0);
        assert_eq!(ended.within(PATIENCE), Some(0), "{arguments:?}");
    }
    // No more output comes that would show the closed pipe, and the command ends all the same.
    let mut ended = head(&office, &["watch", "--conversation", "nobody-s"], 1);
    assert_eq!(ended.within(PATIENCE), Some(0));
}

#[test]
fn a_scenario_and_a_prompt_end_with_their_reader() {
    let office = Office::new();
    let mut command = office.command(&["scenario", "2"]);
    let mut child = command.stdout(Stdio::piped()).spawn().expect("the binary is built");
    let mut line = String::new();
    let mut read = BufReader::new(child.stdout.take().expect("a pipe"));
    read.read_line(&mut line).expect("a line");
    drop(read);
    assert_eq!(Ends(child).within(PATIENCE), Some(0));

    let mut office = office;
    office.up_alone(&[]);
    let mut command = office.command(&["keyboard", "--ecosystem", &file()]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("the binary is built");
    drop(child.stdout.take());
    // The input of the child stays open.
    let _input = child.stdin.take();
    Ends(child).within(PATIENCE);
}

// === a goal that is left ===

#[test]
fn leaving_a_goal_prints_how_to_follow_and_cancel_it() {
    let office = office();
    let mut command =
        office.command(&["goal", "(at turtlebot-1 office1)", "--maintain", "--ecosystem", &file()]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("built");
    let said = lines(&mut child);
    let asked = said.recv_timeout(PATIENCE).expect("it is asked for");
    let id = asked.split_whitespace().last().expect("a name").to_owned();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill").success());
    let mut told = String::new();
    let mut error = child.stderr.take().expect("a pipe");
    error.read_to_string(&mut told).expect("text");
    let code = Ends(child).within(PATIENCE);
    assert!(code == Some(130) || code == Some(0), "0 only where it holds: {code:?}");
    let reach = format!("--ecosystem {}", file());
    let cancel = told.split_once("althing goal --cancel ").expect("how to cancel it").1;
    let name = cancel.split_whitespace().next().expect("the name of the goal").to_owned();
    assert!(name == id || name.parse::<u32>().is_ok(), "its number, or its conversation: {told}");
    for command in [
        format!("althing goals {reach}"),
        format!("althing watch --conversation {name} {reach}"),
        format!("althing goal --cancel {name} {reach}"),
    ] {
        assert!(told.contains(&command), "{command}: {told}");
    }
    // Cancels by the command that was printed.
    let (code, cancelled) = ask(&office, &["goal", "--cancel", &name]);
    assert_eq!(code, Some(0), "{cancelled}");
}

// === the prompt ===

#[test]
fn a_script_for_the_prompt_is_done_at_once() {
    let mut office = Office::new();
    office.up_alone(&[]);
    let run = |input: &[u8]| {
        let mut command = office.command(&["keyboard", "--ecosystem", &file()]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let began = Instant::now();
        let mut child = command.spawn().expect("the binary is built");
        child.stdin.take().expect("a pipe").write_all(input).expect("it reads");
        let output = child.wait_with_output().expect("our child");
        (output.status.code(), began.elapsed(), stdout(&output) + &stderr(&output))
    };
    // The fastest of a few runs: the machine may be busy with other tests.
    let quickest = (0..5).map(|_| run(b"quit\n")).min_by_key(|(_, took, _)| *took).expect("runs");
    assert_eq!(quickest.0, Some(0), "{}", quickest.2);
    assert!(quickest.1 < Duration::from_millis(1_500), "{:?}", quickest.1);
    let (code, _, said) = run(b"agnets\nquit\n");
    assert_eq!(code, Some(1), "of a script it counts: {said}");
    let (code, _, said) = run(b"\xff\xfe\nagents\nquit\n");
    assert_eq!(code, Some(1), "a line that is no text counts, too: {said}");
    assert!(said.contains("turtlebot-1"), "the next line is read: {said}");
}

// === a terminal ===

/// A terminal of this test, in which a command runs.
struct Terminal {
    child: Ends,
    controller: File,
}

impl Terminal {
    fn open(mut command: Command) -> Terminal {
        let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a terminal");
        grantpt(&controller).and_then(|()| unlockpt(&controller)).expect("it is ours");
        let path = ptsname(&controller, Vec::new()).expect("a name");
        let path = path.to_str().expect("text").to_owned();
        let side = || File::options().read(true).write(true).open(&path).expect("the other side");
        command.env("TERM", "xterm").env_remove("NO_COLOR");
        command.stdin(side()).stdout(side()).stderr(side());
        let child = Ends(command.spawn().expect("the binary is built"));
        Terminal { child, controller: File::from(controller) }
    }

    fn type_text(&mut self, text: &str) {
        self.controller.write_all(text.as_bytes()).expect("it is open");
    }

    /// Returns everything sent to the terminal until the command has ended.
    fn until_end(mut self) -> (Option<i32>, String) {
        let mut all = Vec::new();
        let mut bytes = [0; 4_096];
        // A read fails once no process has the other side open.
        while let Ok(count @ 1..) = self.controller.read(&mut bytes) {
            all.extend_from_slice(&bytes[..count]);
        }
        (self.child.within(PATIENCE), String::from_utf8(all).expect("text"))
    }

    /// Returns everything sent to the terminal until it contains `text`.
    fn until(&mut self, text: &str) -> String {
        let mut all = Vec::new();
        let mut bytes = [0; 4_096];
        let deadline = Instant::now() + PATIENCE;
        loop {
            let said = String::from_utf8_lossy(&all).into_owned();
            if said.contains(text) {
                return said;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let left = Timespec::try_from(left).expect("a minute");
            let mut watched = [PollFd::new(&self.controller, PollFlags::IN)];
            let news = poll(&mut watched, Some(&left)).expect("it is open");
            assert!(news > 0, "`{text}` never came: {said:?}");
            let count = self.controller.read(&mut bytes).expect("it is open");
            all.extend_from_slice(&bytes[..count]);
        }
    }
}

/// Control sequences that an attacker would send to a terminal: a title, a cleared screen in two
/// ways, a line that moves back, text in reverse direction.
const HOSTILE: &str =
    "PIN \u{1b}]0;owned\u{7}\u{1b}[35m\u{9b}2J\r\u{202e}evil\u{2066}\u{7f}\u{200b}x";

/// Returns the control characters sent to a terminal, other than line ends and our colors.
#[track_caller]
fn obeyed(sent: &str) -> Vec<char> {
    let sent = sent.replace("\r\n", "\n");
    // Only our own colors are expected.
    let mut parts = sent.split("\u{1b}[");
    let mut rest = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let color = part.split('m').next().unwrap_or_default();
        let is_ours = color != "35" && color.chars().all(|c| c.is_ascii_digit() || c == ';');
        let end = if is_ours && part.contains('m') { color.len() + 1 } else { 0 };
        rest += if end == 0 { "\u{1b}[" } else { "" };
        rest += &part[end..];
    }
    let is_bad = |c: char| c != '\n' && c.is_control() || "\u{202e}\u{2066}\u{200b}".contains(c);
    rest.chars().filter(|c| is_bad(*c)).collect()
}

fn hostile_question(office: &Office) -> String {
    let text = serde_json::to_string(HOSTILE).expect("JSON");
    let message = format!(
        r#"{{"receiver": "keyboard", "performative": "query-ref",
            "content": {{"text": {text}}}, "reply_within": 60000}}"#
    );
    office.write("hostile.json", &message).display().to_string()
}

#[test]
fn text_of_agents_reaches_a_terminal_without_control_characters() {
    let mut office = Office::new();
    office.up_alone(&[]);
    let file = file();
    let command =
        |arguments: &[&str]| office.command(&[arguments, &["--ecosystem", &file]].concat());
    // A listener, and a person at a prompt with a name that agents know.
    let mut watching = Terminal::open(command(&["watch"]));
    watching.until("listening to");
    let mut sitting = Terminal::open(command(&["keyboard", "--name", "door"]));
    sitting.until("althing> ");
    let message = hostile_question(&office);
    let text = std::fs::read_to_string(&message).expect("it was written");
    let to_door = office.write("door.json", &text.replace("\"keyboard\"", "\"door\""));
    let asking = |path: &str| {
        let mut command = command(&["send", path]);
        Ends(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("built"))
    };
    let (_one, _two) = (asking(&message), asking(&to_door.display().to_string()));
    let shown = "PIN ␛]0;owned␇␛[35m\\u{9b}2J␍\\u{202e}evil\\u{2066}␡\\u{200b}x";

    let mut heard = watching.until("PIN ");
    heard += &watching.until("heartbeat");
    assert!(heard.contains("PIN ␛]0;owned␇␛[35m"), "{heard:?}");
    assert_eq!(obeyed(&heard[heard.find("PIN").expect("it")..]), [], "{heard:?}");

    let asked = sitting.until("answer 1 TEXT");
    let line = &asked[asked.find("PIN").expect("it is asked")..];
    let line = &line[..line.find('\n').expect("its end")];
    assert!(line.contains("␛]0;owned␇"), "{line:?}");
    assert!(!line.contains("\u{1b}]") && !line.contains('\u{202e}'), "{line:?}");
    sitting.type_text("\u{4}");

    let (code, listed) = Terminal::open(command(&["answer"])).until_end();
    assert_eq!(code, Some(0), "{listed:?}");
    assert!(listed.contains(shown), "{listed:?}");
    assert_eq!(obeyed(&listed), [], "{listed:?}");
    let (_, listed) = Terminal::open(command(&["answer", "--json"])).until_end();
    assert_eq!(obeyed(&listed), [], "{listed:?}");
    let json: serde_json::Value = serde_json::from_str(listed.trim()).expect("JSON");
    assert_eq!(json["questions"][0]["text"], HOSTILE, "and it is the same");

    for arguments in [
        vec!["goal", "(known-temperature office1\u{1b}]0;x\u{7}\u{202e})"],
        vec!["act", "(move \u{1b}[2J turtlebot-1 corridor office1)"],
        vec!["set", "(at \u{9b}31m turtlebot-1)"],
        vec!["goal", "temp\u{1b}[31meratures"],
        vec!["goal", "--cancel", "none\u{1b}[2J"],
        vec!["watch", "--conversation", "\u{1b}[2J", "--nonsense\u{1b}[2J"],
        vec!["mailbox", "tur\u{1b}[2Jtle"],
        vec!["check", "no\u{1b}]0;x\u{7}file\u{202e}.toml"],
        vec!["plan", "no\u{1b}]0;x\u{7}file.pddl", "\u{9b}2J.pddl"],
        vec!["replay", "\u{1b}[2J.jsonl"],
    ] {
        let mut whole = office.command(&arguments);
        if !matches!(arguments[0], "check" | "plan" | "replay") {
            whole.args(["--ecosystem", &file]);
        }
        let (_, sent) = Terminal::open(whole).until_end();
        assert!(!sent.is_empty(), "{arguments:?} says something");
        assert_eq!(obeyed(&sent), [], "{arguments:?}: {sent:?}");
    }
}

/// Mistakes are shown with their lines.
#[test]
fn text_of_files_reaches_a_terminal_without_control_characters() {
    let office = Office::new();
    let text =
        "(define (problem p) (:domain d) (:objects a\u{1b}]0;x\u{7} b\u{202e}c \u{9b}2J - room)";
    let path = office.write("map.pddl", text).display().to_string();
    let toml = "[ecosystem]\nname = \"a\u{202e}b\u{9b}\"\nmode = \"\\u001B[2J\"\nx\u{1b}y = 1\n";
    let file = office.write("x.toml", toml).display().to_string();
    for path in [path, file] {
        let (code, sent) = Terminal::open(office.command(&["check", &path])).until_end();
        assert_eq!(code, Some(33), "{sent:?}");
        assert_eq!(obeyed(&sent), [], "{sent:?}");
    }
}

/// The log of a daemon in a terminal contains text from agents.
#[test]
fn text_in_a_log_reaches_a_terminal_without_control_characters() {
    let office = Office::new();
    let mut command = office.command(&["up", &file(), "-v"]);
    command.env("ALTHING_LOG", "info,keyboard=debug,agent=debug");
    let mut daemon = Terminal::open(command);
    let mut all = daemon.until("is ready");
    let message = hostile_question(&office);
    let mut asking = office.command(&["send", &message, "--ecosystem", &file()]);
    let _asking = Ends(asking.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("built"));
    all += &daemon.until("PIN ");
    all += &daemon.until("\n");
    let line = all.lines().find(|line| line.contains("PIN ")).expect("it is logged");
    let said = &line[line.find("PIN ").expect("it")..];
    assert!(said.starts_with("PIN ␛]0;owned␇"), "{said:?}");
    assert!(!said.contains("\u{1b}]") && !said.contains('\u{9b}'), "{said:?}");
}

// === a file that is reloaded ===

const THERMOMETER: &str = "[[agent]]\nname = \"NAME\"\nplugin = \"temperature-sensor\"\n\
     driver = \"simulated\"\nconfig = { location = \"ROOM\" }\n\n";

fn thermometer(name: &str, room: &str) -> String {
    THERMOMETER.replace("NAME", name).replace("ROOM", room)
}

/// Returns an ecosystem with the office's ontology and a map of this test.
fn lab_with(office: &Office, agents: &str) -> String {
    let source = Office::file().canonicalize().expect("it is there");
    let map = source.ancestors().nth(2).expect("a folder").join("domains/smart-office/map.pddl");
    let text = lab("decentralized");
    let own = office.folder().join("map.pddl");
    if !own.exists() {
        std::fs::copy(&map, &own).expect("it can be copied");
    }
    text.replace(&map.display().to_string(), &own.display().to_string()) + agents
}

#[test]
fn a_file_is_reloaded_while_a_daemon_runs() {
    let mut office = Office::new();
    let goals = "[goals]\nwarm = \"(known-temperature office1)\"\n\n";
    let first = lab_with(&office, &(goals.to_owned() + &thermometer("thermometer-a", "office1")));
    let file = office.write("lab.toml", &first);
    office.file = file.clone();
    let mut command = office.command(&["up", &file.display().to_string()]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = Ends(command.spawn().expect("the binary is built"));
    let told_ready = lines(&mut child.0);
    assert!(told_ready.recv_timeout(PATIENCE).expect("it begins").contains("is ready"));
    let notes = notes(child.0.stderr.take().expect("a pipe"));
    let hangup = || {
        let pid = child.0.id().to_string();
        assert!(Command::new("kill").args(["-HUP", &pid]).status().expect("kill").success());
    };

    // One agent has left, one is new, and a goal has changed.
    let goals = "[goals]\nwarm = \"(known-temperature office2)\"\n\n";
    office.write(
        "lab.toml",
        &lab_with(&office, &(goals.to_owned() + &thermometer("thermometer-b", "office2"))),
    );
    hangup();
    let told = await_note(&notes, "have left: `thermometer-a`");
    for part in ["new: `thermometer-b`", "`warm`"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    let agents = office.ask(&["agents"]).1;
    assert!(agents.contains("thermometer-b") && !agents.contains("thermometer-a"), "{agents}");
    let (code, said) = office.ask(&["goal", "warm"]);
    assert_eq!(code, Some(0), "the new one measures: {said}");

    // A file with a mistake changes nothing.
    office.write("lab.toml", "[ecosystem\n");
    hangup();
    await_note(&notes, "nothing is changed");
    // Commands read the file too.
    office.write("lab.toml", &first);
    let agents = office.ask(&["agents"]).1;
    assert!(agents.contains("thermometer-b"), "{agents}");

    // The map has another room, with a thermometer.
    let map = office.folder().join("map.pddl");
    let text = std::fs::read_to_string(&map).expect("it is there");
    let more = text.replacen("(:objects", "(:objects attic - room", 1);
    assert_ne!(more, text, "the map has objects");
    office.write("map.pddl", &more);
    office.write("lab.toml", &lab_with(&office, &thermometer("thermometer-c", "attic")));
    hangup();
    await_note(&notes, "read at the start only: the map (rooms, doors, ways)");
    assert!(told_ready.recv_timeout(PATIENCE).expect("it begins again").contains("is ready"));
    let (code, said) = office.ask(&["goal", "(known-temperature attic)"]);
    assert_eq!(code, Some(0), "the attic is known: {said}");

    // An agent of a package is new, then of another package, then of another daemon.
    for (package, daemon) in [("one", "wall-pi"), ("two", "wall-pi"), ("two", "door-pi")] {
        let agent = format!(
            "[[agent]]\nname = \"packed\"\npackage = \"{package}\"\ndaemon = \"{daemon}\"\n\n"
        );
        office.write(
            "lab.toml",
            &lab_with(&office, &(thermometer("thermometer-c", "attic") + &agent)),
        );
        hangup();
        await_note(&notes, "read at the start only: agents of packages");
        assert!(told_ready.recv_timeout(PATIENCE).expect("it begins again").contains("is ready"));
    }
    assert!(child.0.try_wait().expect("it is ours").is_none(), "it is the same process");
}

/// Returns the lines of a stream, as they come.
fn notes(stream: impl std::io::Read + Send + 'static) -> mpsc::Receiver<String> {
    let (tell, told) = mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            if tell.send(line).is_err() {
                return;
            }
        }
    });
    told
}

/// Returns all lines up to the one that contains `text`.
#[track_caller]
fn await_note(notes: &mpsc::Receiver<String>, text: &str) -> String {
    let mut all = String::new();
    let deadline = Instant::now() + PATIENCE;
    while !all.contains(text) {
        let left = deadline.saturating_duration_since(Instant::now());
        let line = notes.recv_timeout(left).unwrap_or_else(|_| panic!("no `{text}`: {all}"));
        all += &line;
        all.push('\n');
    }
    all
}

#[test]
fn machines_with_different_maps_log_the_difference() {
    let mut office = Office::new();
    let agents = thermometer("thermometer-b", "office2");
    let text = lab_with(&office, &(agents.replace("driver =", "daemon = \"b\"\ndriver =")));
    let text = text.replace(
        "plugin = \"domain-maintainer\"\n",
        "plugin = \"domain-maintainer\"\ndaemon = \"a\"\n",
    );
    let file = office.write("lab.toml", &text);
    office.file = file.clone();
    let up = |name: &str| {
        let mut command = office.command(&["up", &file.display().to_string(), "--daemon", name]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = Ends(command.spawn().expect("the binary is built"));
        let said = lines(&mut child.0);
        assert!(said.recv_timeout(PATIENCE).expect("it begins").contains("is ready"));
        let notes = notes(child.0.stderr.take().expect("a pipe"));
        (child, said, notes)
    };
    let (_a, _said_a, notes_a) = up("a");
    let map = office.folder().join("map.pddl");
    let text = std::fs::read_to_string(&map).expect("it is there");
    office.write("map.pddl", &text.replacen("(:objects", "(:objects attic - room", 1));
    let (_b, _said_b, notes_b) = up("b");
    let at_a = await_note(&notes_a, "daemon `b` has read another map (");
    let at_b = await_note(&notes_b, "daemon `a` has read another map (");
    let digests = |told: &str| -> Vec<String> {
        let line = told.lines().last().expect("a line");
        let hex = |word: &&str| word.len() == 12 && word.chars().all(|c| c.is_ascii_hexdigit());
        let mut all: Vec<_> =
            line.split(|c: char| !c.is_alphanumeric()).filter(hex).map(str::to_owned).collect();
        all.sort();
        all
    };
    assert_eq!(digests(&at_a).len(), 2, "{at_a}");
    assert_eq!(digests(&at_a), digests(&at_b), "{at_b}");
}

// === a daemon that is stopped ===

#[test]
fn a_stopped_daemon_delays_no_command_of_others() {
    let mut office = Office::new();
    // Commands try daemons in order of their names, and this one is the first.
    office.up(&["reasoning", "conf-room-pi"], &[]);
    office.signal("conf-room-pi", "STOP");
    let began = Instant::now();
    let (code, said) = ask(&office, &["goals"]);
    let took = began.elapsed();
    office.signal("conf-room-pi", "CONT");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("conf-room-pi.sock does not respond (process "), "{said}");
    assert!(said.contains("connects to unixsock-stream/"), "{said}");
    assert!(took < Duration::from_secs(9), "Zenoh alone waits ten seconds: {took:?}");
}

/// Stops the daemon through which a goal's command is connected, when its plan is reported. Checks
/// that every report is printed exactly once and, if the goal `ends_soon`, that the reports do not
/// wait until Zenoh notices that the daemon is stopped.
#[track_caller]
fn misses_no_line(time_scale: &str, ends_soon: bool) {
    let mut office = Office::new();
    for daemon in ["reasoning", "turtlebot-laptop", "conf-room-pi"] {
        let mut up = office.command(&["up", &file(), "--daemon", daemon]);
        up.env("ALTHING_BUILDING__TIME_SCALE", time_scale);
        office.begin_as(daemon, up);
    }
    office.await_fact("(at turtlebot-1 corridor)", true);
    let goal = "(and (known-temperature office1) (known-temperature office2))";
    let mut command = office.command(&["goal", goal, "--ecosystem", &file()]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = Ends(command.spawn().expect("the binary is built"));
    let said = notes(child.0.stdout.take().expect("a pipe"));
    let noted = notes(child.0.stderr.take().expect("a pipe"));
    let mut all = await_note(&said, "a plan of 5 steps");
    office.signal("conf-room-pi", "STOP");
    let stopped = Instant::now();
    await_note(&noted, "conf-room-pi.sock does not respond (process ");
    if ends_soon {
        all += &await_note(&said, "arrived at office2");
        let took = stopped.elapsed();
        assert!(took < Duration::from_secs(7), "{took:?}: Zenoh alone notices it after eight");
    }
    all += &await_note(&said, "the goal holds");
    office.signal("conf-room-pi", "CONT");
    assert_eq!(child.within(PATIENCE), Some(0), "{all}");
    for line in ["arrived at office1", "20.5 °C at office1", "arrived at office2", "°C at office2"]
    {
        assert_eq!(all.matches(line).count(), 1, "{line}: {all}");
    }
}

#[test]
fn a_running_goal_loses_no_line_when_its_daemon_stops() {
    misses_no_line("0.6", false);
}

#[test]
fn an_ending_goal_loses_no_line_when_its_daemon_stops() {
    misses_no_line("0.05", true);
}

/// Starts a command with a maintained goal that holds and is on the disk of its Journal. Returns it
/// with its output and its notes.
fn kept_goal(office: &Office) -> (Ends, mpsc::Receiver<String>, mpsc::Receiver<String>) {
    let goal = ["goal", "(known-temperature office2)", "--maintain", "--ecosystem", &file()];
    let mut command = office.command(&goal);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = Ends(command.spawn().expect("the binary is built"));
    let said = lines(&mut child.0);
    await_note(&said, "holds");
    let notes = notes(child.0.stderr.take().expect("a pipe"));
    (child, said, notes)
}

#[test]
fn a_missing_leader_is_reported_to_a_waiting_command() {
    let mut office = Office::new();
    office.up(&["office2-pi", "reasoning"], &[]);
    let (_goal, _said, notes) = kept_goal(&office);
    office.kill("reasoning");
    await_note(&notes, "`plan-requester` has no leader: no daemon in reach hosts it");
    office.up(&["reasoning"], &[]);
    await_note(&notes, "`plan-requester` leads again, at daemon `reasoning`");
}

#[test]
fn a_lost_link_is_reported_to_a_waiting_command() {
    let mut office = Office::new();
    office.up(&["office2-pi", "reasoning"], &[]);
    let (_goal, _said, notes) = kept_goal(&office);
    office.kill("reasoning");
    office.kill("office2-pi");
    await_note(&notes, "no daemon of the ecosystem is reached any more");
    office.up(&["reasoning", "office2-pi"], &[]);
    await_note(&notes, "a daemon of the ecosystem is reached again");
}

// === access rights of files ===

#[test]
fn files_of_a_daemon_are_closed_to_others_under_any_umask() {
    let mut office = Office::new();
    let state = office.folder().join("state");
    let file = file();
    let mut shell = office.program("sh");
    let althing = env!("CARGO_BIN_EXE_althing");
    shell.args(["-c", "umask 0; exec \"$@\"", "sh", althing, "up", &file]);
    office.begin_as("alone", shell);
    let (code, said) = ask(&office, &["goal", "temperatures"]);
    assert_eq!(code, Some(0), "{said}");
    let mut open = vec![state];
    let mut files = 0;
    while let Some(path) = open.pop() {
        let about = std::fs::symlink_metadata(&path).expect("it is there");
        // Only the folder of the ecosystem's daemon is created by Althing; the test created those
        // above.
        assert_eq!(about.mode() & 0o077, 0, "{}", path.display());
        if about.is_dir() {
            let entries = std::fs::read_dir(&path).expect("a folder");
            open.extend(entries.map(|entry| entry.expect("an entry").path()));
        } else {
            files += 1;
        }
    }
    assert!(files > 0, "a journal is kept");

    let recording = office.write("old.jsonl", "");
    std::fs::set_permissions(&recording, std::fs::Permissions::from_mode(0o666)).expect("ours");
    for name in ["new.jsonl", "old.jsonl"] {
        let mut shell = office.program("sh");
        shell.args(["-c", "umask 0; exec \"$@\"", "sh", althing, "watch", "--record", name]);
        shell.args(["--ecosystem", &file]).stdout(Stdio::null()).stderr(Stdio::null());
        let _child = Ends(shell.spawn().expect("a shell"));
        let path = office.folder().join(name);
        let deadline = Instant::now() + PATIENCE;
        while std::fs::metadata(&path).map_or(0, |about| about.len()) == 0 {
            assert!(Instant::now() < deadline, "{name} is never written");
            std::thread::sleep(Duration::from_millis(20));
        }
        let mode = std::fs::metadata(&path).expect("it is there").mode() & 0o777;
        assert_eq!(mode, 0o600, "{name}");
    }
}

// === ports ===

/// Starts a daemon that listens at a port of this machine, as its environment says.
fn up_at(office: &Office, name: &str, listen: &str, connect: &str) -> Child {
    let mut command = office.command(&["up", &file(), "--daemon", name]);
    command.env("ALTHING_ZENOH__LISTEN__ENDPOINTS", listen);
    command.env("ALTHING_ZENOH__CONNECT__ENDPOINTS", connect);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary is built")
}

#[test]
fn a_taken_port_is_reported_with_its_owner() {
    let office = Office::new();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port();
    let listen = format!("[\"tcp/127.0.0.1:{port}\"]");
    let refused = up_at(&office, "reasoning", &listen, "[]").wait_with_output().expect("our child");
    assert_eq!(refused.status.code(), Some(69));
    let said = stderr(&refused);
    let by = format!("port {port} is taken by process {} (`", std::process::id());
    assert!(said.contains(&by), "{said}");
    assert!(said.contains("ALTHING_ZENOH__LISTEN__ENDPOINTS="), "the cure: {said}");
}

/// One file for all machines lists the addresses of all machines, also that of the daemon itself.
#[test]
fn a_daemon_that_is_told_to_call_itself_does_not() {
    let office = Office::new();
    let free = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = free.local_addr().expect("an address").port();
    drop(free);
    let listen = format!("[\"tcp/127.0.0.1:{port}\"]");
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").expect("a name");
    let connect = format!(
        "[\"tcp/127.0.0.1:{port}\", \"tcp/localhost:{port}\", \"tcp/{}:{port}\"]",
        host.trim()
    );
    let mut child = up_at(&office, "reasoning", &listen, &connect);
    let said = lines(&mut child);
    let ready = said.recv_timeout(PATIENCE).expect("it says that it is ready");
    assert!(ready.contains("is ready"), "{ready}");
    // The query gives a connection to itself the time to be logged.
    let (code, agents) = ask(&office, &["agents"]);
    assert_eq!(code, Some(0), "{agents}");
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().expect("kill").success());
    let output = child.wait_with_output().expect("our child");
    let log = stderr(&output);
    assert!(!log.contains("SELF") && !log.contains("ERROR"), "{log}");
}

// === the simulated building ===

#[test]
fn the_building_outlives_the_daemon_that_serves_it() {
    let mut office = Office::new();
    // The first daemon serves the building.
    office.up(&["office2-pi", "reasoning", "turtlebot-laptop"], &[]);
    office.await_devices(3);
    let (code, said) = office.ask(&["goal", "(at turtlebot-1 office1)"]);
    assert_eq!(code, Some(0), "{said}");
    office.kill("office2-pi");
    // The robot stands where it was, and drives on from there.
    let (code, said) = office.ask(&["goal", "(at turtlebot-1 office2)"]);
    assert_eq!(code, Some(0), "{said}");
    office.await_fact("(at turtlebot-1 office2)", true);
}
