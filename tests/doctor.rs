//! `althing doctor`: each problem is provoked and seen with its command; the command is run as it
//! stands, and the problem is gone.

use std::fs;
use std::io::Write as _;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Stdio;
use std::time::Instant;

use serde_json::Value;

use crate::support::{Office, PATIENCE, finish, lab, stderr, stdout};

/// A thermometer of the simulated building.
const THERMOMETER: &str = "[[agent]]\nname = \"thermometer-1\"\nplugin = \"temperature-sensor\"\n\
    daemon = \"hall\"\n\n[agent.config]\nlocation = \"office1\"\n\n";

const KEYBOARD: &str =
    "[[agent]]\nname = \"keyboard\"\nplugin = \"keyboard\"\ndaemon = \"hall\"\n\n";

/// An office whose commands find `althing` on the `PATH`, as a person's do.
fn office() -> Office {
    let program = Path::new(env!("CARGO_BIN_EXE_althing"));
    Office::new().with_programs(program.parent().expect("a folder"))
}

/// Returns this office with an ecosystem `lab`, whose reasoning agents are at the daemon `hall`.
fn with_lab(office: Office, more: &str) -> Office {
    let text = lab("decentralized").replace("plugin = ", "daemon = \"hall\"\nplugin = ");
    let text = text.replace("mode = ", "daemons = [\"hall\", \"attic\"]\nmode = ") + more;
    let file = office.write("lab.toml", &text);
    office.with_file(file)
}

/// Runs `althing doctor` with these arguments; returns its report and its exit code.
fn examined(office: &Office, arguments: &[&str]) -> (Value, Option<i32>) {
    let output = office.run(&[&["doctor", "--json"], arguments].concat());
    let text = stdout(&output);
    let report = serde_json::from_str(&text);
    let report = report.unwrap_or_else(|error| panic!("{error}: {text}{}", stderr(&output)));
    (report, output.status.code())
}

/// Runs `althing doctor` on this office's file, for the daemon `hall`.
fn report(office: &Office) -> Value {
    let file = office.file.display().to_string();
    examined(office, &[&file, "--daemon", "hall"]).0
}

/// Returns the findings of a check.
fn found<'r>(report: &'r Value, check: &str) -> Vec<&'r Value> {
    let checks = report["checks"].as_array().expect("a list");
    checks.iter().filter(|finding| finding["check"] == check).collect()
}

/// Returns the first finding of a check that is not `ok`.
fn wrong<'r>(report: &'r Value, check: &str) -> Option<&'r Value> {
    found(report, check).into_iter().find(|finding| finding["verdict"] != "ok")
}

/// Returns the command of the first finding of a check that is not `ok`.
#[track_caller]
fn mend(report: &Value, check: &str, verdict: &str, text: &str) -> String {
    let finding = wrong(report, check).unwrap_or_else(|| panic!("{check} is well: {report}"));
    assert_eq!(finding["verdict"], verdict, "{finding}");
    assert!(finding["text"].as_str().is_some_and(|it| it.contains(text)), "{text}: {finding}");
    assert_eq!(finding["remedy"]["kind"], "mend", "{finding}");
    finding["remedy"]["command"].as_str().expect("a command").to_owned()
}

/// Runs a command of a report, as a person does who copies it.
fn run(office: &Office, command: &str) {
    let output = finish(office.program("sh").args(["-c", command]).stdin(Stdio::null()));
    assert!(output.status.success(), "{command}: {}{}", stdout(&output), stderr(&output));
}

/// Examines until a check is well.
fn await_well(office: &Office, check: &str) {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let report = report(office);
        if !found(&report, check).is_empty() && wrong(&report, check).is_none() {
            return;
        }
        assert!(Instant::now() < deadline, "{check}: {report}");
    }
}

#[test]
fn a_machine_is_examined_without_a_file_and_without_a_daemon() {
    let office = office();
    let (report, code) = examined(&office, &[]);
    for check in ["runtime-folder", "state-folder", "plugins-folder", "open-files"] {
        assert!(wrong(&report, check).is_none(), "{check}: {report}");
        assert_eq!(found(&report, check).len(), 1, "{check}: {report}");
    }
    let running = wrong(&report, "running").expect("a note");
    assert_eq!(running["verdict"], "note", "{running}");
    let problems = report["problems"].as_u64().expect("a number");
    assert_eq!(code, Some(i32::from(problems > 0)), "{report}");
    // The same for a person: one line for each check, and the sum.
    let said = stdout(&office.run(&["doctor"]));
    assert!(said.starts_with("machine\n"), "{said}");
    assert!(said.lines().any(|line| line.contains(" open-files ")), "{said}");
    let unknown = office.run(&["doctor", "no/such.toml"]);
    assert_eq!(unknown.status.code(), Some(33), "{}", stderr(&unknown));
}

#[test]
fn folders_and_limits_are_mended_by_their_commands() {
    let office = office();
    let runtime = office.runtime_folder();
    fs::create_dir(&runtime).expect("a folder");
    fs::set_permissions(&runtime, fs::Permissions::from_mode(0o777)).expect("ours");
    let state = office.write("state", "in the way");
    let (report, code) = examined(&office, &[]);
    assert_eq!(code, Some(1), "{report}");
    run(&office, &mend(&report, "runtime-folder", "problem", "mode 777"));
    run(&office, &mend(&report, "state-folder", "problem", "is a file"));
    let (mended, _) = examined(&office, &[]);
    assert!(wrong(&mended, "runtime-folder").is_none(), "{mended}");
    assert!(wrong(&mended, "state-folder").is_none(), "{mended}");
    assert!(state.with_extension("before").is_file(), "nothing is deleted");

    let limited = |between: &str| {
        let script = format!("ulimit -S -n 128; {between}; althing doctor --json");
        let output = finish(office.program("sh").args(["-c", &script]).stdin(Stdio::null()));
        serde_json::from_str::<Value>(&stdout(&output)).expect("a report")
    };
    let command = mend(&limited(":"), "open-files", "problem", "only 128 files");
    assert!(wrong(&limited(&command), "open-files").is_none(), "{command}");
}

#[test]
fn what_the_file_needs_of_the_machine_is_told() {
    let tools = tempfile::tempdir().expect("a folder");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port();
    let sensor = "[[agent]]\nname = \"roof\"\nplugin = \"sensor\"\ndriver = \"command\"\n\
        daemon = \"hall\"\n\n[agent.config]\nlocation = \"office1\"\nquantity = \"temperature\"\n\
        command = [\"measure-the-roof\", \"/dev/no-such-device\"]\n\n";
    let zenoh = format!("[zenoh]\nlisten.endpoints = [\"tcp/127.0.0.1:{port}\"]\n");
    let office = with_lab(office().with_programs(tools.path()), &(sensor.to_owned() + &zenoh));
    let told = report(&office);
    assert!(wrong(&told, "ecosystem-file").is_none(), "{told}");
    let program = wrong(&told, "programs").expect("it is missing");
    assert!(program["text"].to_string().contains("`measure-the-roof`"), "{program}");
    let device = wrong(&told, "devices").expect("it is missing");
    assert!(device["text"].to_string().contains("/dev/no-such-device"), "{device}");
    let holder = wrong(&told, "ports").expect("it is taken");
    let process = format!("process {} ", std::process::id());
    assert!(holder["text"].to_string().contains(&process), "{holder}");
    let running = wrong(&told, "running").expect("a note");
    assert!(running["remedy"]["command"].to_string().ends_with("--daemon hall\""), "{running}");

    drop(taken);
    let program = tools.path().join("measure-the-roof");
    fs::write(&program, "#!/bin/sh\necho 21\n").expect("a program");
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).expect("ours");
    let told = report(&office);
    assert!(wrong(&told, "programs").is_none() && wrong(&told, "ports").is_none(), "{told}");

    let broken = office.write("broken.toml", "[ecosystem]\nnmae = \"lab\"\n").display().to_string();
    let (told, code) = examined(&office, &[&broken]);
    assert_eq!(code, Some(1), "{told}");
    let mistake = wrong(&told, "ecosystem-file").expect("a mistake");
    assert!(mistake["text"].to_string().contains("broken.toml:"), "{mistake}");
    assert_eq!(mistake["remedy"]["command"], format!("althing check {broken}"), "{mistake}");
    // What the file asks of the machine is unknown, and not well.
    for check in ["ports", "programs", "devices", "running"] {
        let findings = found(&told, check);
        let has_mistakes = |finding: &&Value| {
            finding["text"].to_string().contains("the ecosystem file has mistakes")
        };
        let is_note = |finding: &&Value| finding["verdict"] == "note";
        match check {
            "running" => assert!(findings.iter().all(is_note), "{findings:?}"),
            _ => assert!(findings.iter().all(|it| is_note(it) && has_mistakes(it)), "{findings:?}"),
        }
        assert!(!findings.is_empty(), "{check}");
    }
}

#[test]
fn daemons_that_are_absent_stopped_or_outdated_are_brought_back() {
    let mut office = with_lab(office(), THERMOMETER);
    office.up(&["hall"], &[]);
    let told = report(&office);
    for check in ["running", "processes", "agents", "versions", "files", "clocks", "plugins"] {
        assert!(wrong(&told, check).is_none(), "{check}: {told}");
    }
    let start = mend(&told, "daemons", "problem", "`attic` is not reached");
    let words: Vec<&str> = start.split(' ').skip(1).collect();
    let command = office.command(&words);
    office.begin_as("attic", command);
    await_well(&office, "daemons");

    office.signal("attic", "STOP");
    let told = report(&office);
    run(&office, &mend(&told, "processes", "problem", "`attic` does not answer"));
    await_well(&office, "processes");

    // The file gets another agent, and the daemon has not read it again.
    let text = fs::read_to_string(&office.file).expect("ours");
    let more = THERMOMETER.replace("thermometer-1", "thermometer-2");
    fs::write(&office.file, text + &more).expect("ours");
    let told = report(&office);
    run(&office, &mend(&told, "agents", "problem", "`thermometer-2` of the file: absent"));
    await_well(&office, "agents");

    // The map gets another room.
    let text = fs::read_to_string(&office.file).expect("ours");
    let path = text.lines().find_map(|line| line.strip_prefix("problem = ")).expect("a map");
    let map = fs::read_to_string(path.trim_matches('"')).expect("a map");
    let map = map.replacen("corridor - corridor", "corridor attic-hall - corridor", 1);
    let changed = office.write("map.pddl", &map).display().to_string();
    fs::write(&office.file, text.replace(path, &format!("\"{changed}\""))).expect("ours");
    let told = report(&office);
    assert_eq!(found(&told, "files").len(), 2, "both daemons: {told}");
    for finding in found(&told, "files") {
        assert!(finding["text"].to_string().contains("has read another map"), "{finding}");
        run(&office, finding["remedy"]["command"].as_str().expect("a command"));
    }
    await_well(&office, "files");
}

/// The daemons have read the file, and tell what is missing to whoever has not.
#[test]
fn agents_of_a_dead_daemon_are_missed_without_the_file() {
    let mut office = with_lab(office(), &THERMOMETER.replace("hall", "attic"));
    office.up(&["hall", "attic"], &[]);
    let (told, _) = examined(&office, &[]);
    assert!(wrong(&told, "agents").is_none(), "{told}");
    office.kill("attic");
    let deadline = Instant::now() + PATIENCE;
    let told = loop {
        let (told, _) = examined(&office, &[]);
        if wrong(&told, "agents").is_some() {
            break told;
        }
        assert!(Instant::now() < deadline, "{told}");
    };
    let finding = wrong(&told, "agents").expect("just seen");
    let expected = "`thermometer-1` of the daemons' file: absent, which `attic` is to host";
    assert_eq!(finding["text"], expected, "{finding}");
    let daemons = office.run(&["view", "topology", "--json", "--ecosystem", "lab"]);
    let agents = office.run(&["view", "agents", "--json", "--ecosystem", "lab"]);
    let agents: Value = serde_json::from_str(&stdout(&agents)).expect("JSON");
    let rows = agents["data"].as_array().expect("a list");
    let row = rows.iter().find(|row| row["agent"] == "thermometer-1");
    assert_eq!(row.expect("known")["presence"], "absent", "{agents} {}", stdout(&daemons));
}

#[test]
fn what_waits_for_a_person_is_told_and_done() {
    let mut office = with_lab(office(), &(THERMOMETER.to_owned() + KEYBOARD));
    office.up(&["hall"], &[]);
    office.await_devices(1);
    let (code, stopped) = office.ask(&["stop", "office1", "--because", "a test"]);
    assert_eq!(code, Some(0), "{stopped}");
    let question = r#"{"receiver": "keyboard", "performative": "query-ref",
        "content": {"text": "May I enter?"}, "reply_within": 60000}"#;
    let question = office.write("question.json", question).display().to_string();
    let file = office.file.display().to_string();
    // A prompt is open, so that the question waits for its user.
    let mut prompt = office.command(&["keyboard", "--name", "desk", "--ecosystem", &file]);
    let mut prompt = prompt.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().expect("a prompt");
    let asking = fs::read_to_string(&question).expect("ours").replace("keyboard", "desk");
    fs::write(&question, asking).expect("ours");
    let deadline = Instant::now() + PATIENCE;
    while !office.ask(&["agents"]).1.contains("desk") {
        assert!(Instant::now() < deadline, "the prompt never joined");
    }
    let mut asking = office.command(&["send", &question, "--ecosystem", &file]);
    let mut asking = asking.stdout(Stdio::null()).spawn().expect("a command");
    let told = loop {
        let told = report(&office);
        if wrong(&told, "questions").is_some() {
            break told;
        }
        assert!(Instant::now() < deadline, "the question never came: {told}");
    };
    let answer = mend(&told, "questions", "note", "May I enter?");
    run(&office, &format!("echo yes | {answer}"));
    assert!(asking.wait().is_ok_and(|status| status.success()), "it was answered");
    await_well(&office, "questions");

    run(&office, &mend(&told, "stops", "note", "office1 (a test)"));
    await_well(&office, "stops");
    drop(prompt.stdin.take().map(|mut input| input.flush()));
    let _ = prompt.kill();
    let _ = prompt.wait();
}

#[test]
fn a_secured_ecosystem_gets_its_certificates_and_rejections_are_told() {
    let office = with_lab(
        office(),
        &(THERMOMETER.to_owned()
            + "[security]\nfolder = \"keys\"\n\n[rights]\ngoals = [\"thermometer-1\"]\n"),
    );
    let told = report(&office);
    run(&office, &mend(&told, "certificates", "problem", "failed to"));
    let told = report(&office);
    run(&office, &mend(&told, "certificates", "problem", "`hall`, the daemon of this machine"));
    assert!(wrong(&report(&office), "certificates").is_none());
    await_rejection(office);
}

/// A guest asks for a goal without the right to do so; then a certificate is about to end.
fn await_rejection(mut office: Office) {
    office.up(&["hall"], &[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(known-temperature office1)"]);
    assert_ne!(code, Some(0), "{said}");
    let told = report(&office);
    let rejected = wrong(&told, "rejected").expect("the goal was rejected");
    assert_eq!(rejected["verdict"], "note", "it does not go on: {rejected}");
    assert!(rejected["text"].to_string().contains("unauthorized: [rights]"), "{rejected}");

    let file = office.file.display().to_string();
    let made = office.run(&["cert", "daemon", "attic", "--days", "3", "--ecosystem", &file]);
    assert!(made.status.success(), "{}", stderr(&made));
    let told = report(&office);
    run(&office, &mend(&told, "certificates", "note", "`attic` ends in 3 days"));
    assert!(wrong(&report(&office), "certificates").is_none());
}
