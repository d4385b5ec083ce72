//! `althing plan --engine …`: the output for engines that are missing, that work, and that are
//! stopped.

#[path = "../../../../../tests/support/left_out.rs"]
mod left_out;

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use expect_test::expect;

use crate::sandbox::{EVENING, LAMP, Sandbox};

const TASK: &str = "plan domain.pddl evening.pddl --engine";

#[test]
fn a_missing_engine_yields_installation_advice() {
    Sandbox::lamp().check(&format!("{TASK} fast-downward"), 69).shows(
        expect![""],
        expect![[r#"
            error: failed to find Fast Downward
             |
            help: `pip install up-fast-downward` is enough; or put `fast-downward.py` on
                  PATH, or name it in ALTHING_FAST_DOWNWARD

            1 error
        "#]],
    );
    let sandbox = Sandbox::lamp().with_variable("ALTHING_METRIC_FF", "/nowhere/ff");
    let run = sandbox.check(&format!("{TASK} metric-ff --json"), 69);
    assert_eq!(run.json()["status"], "unavailable");
    assert!(run.stdout.contains("failed to find Metric-FF at `/nowhere/ff`"), "{}", run.stdout);
    sandbox.check("plan domain.pddl evening.pddl", 0);
}

/// A sandbox with the engines of the tests' own environment; `None`, with a note, if there are
/// none.
fn with_fast_downward() -> Option<Sandbox> {
    let path = std::env::var("PATH").unwrap_or_default();
    let sandbox = Sandbox::lamp().with_variable("PATH", &path);
    let run = sandbox.run(&format!("{TASK} fast-downward"));
    if run.code == 69 {
        left_out::left_out(&run.stderr);
        return None;
    }
    Some(sandbox)
}

#[test]
fn fast_downward_plans_as_the_embedded_planner_does() {
    let Some(sandbox) = with_fast_downward() else { return };
    let run = sandbox.check(&format!("{TASK} fast-downward --optimal --plan out.txt"), 0);
    assert_eq!(run.stdout, "");
    let told = "plan found: 2 steps, cost 2 (unit cost); no shorter plan exists\n";
    assert!(run.stderr.starts_with(told), "{}", run.stderr);
    let plan = std::fs::read_to_string(sandbox.path().join("out.txt")).expect("the plan");
    assert_eq!(plan, "(go hall study)\n(switch desk-lamp study)\n; cost = 2 (unit cost)\n");
    let run = sandbox.check(&format!("{TASK} fast-downward --json"), 0);
    let value = run.json();
    assert_eq!(value["status"], "plan-found");
    assert_eq!(value["engine"], "fast-downward");
    assert_eq!(value["plan"][1], "(switch desk-lamp study)");
    sandbox.write("evening.pddl", EVENING.replace("(door hall study)", "").as_bytes());
    let run = sandbox.run(&format!("{TASK} fast-downward --json"));
    assert!(matches!(run.code, 10 | 11), "{}", run.code);
    assert_eq!(run.json()["status"], "unsolvable");
}

#[test]
fn an_unsupported_feature_of_an_engine_is_shown_in_its_line() {
    let axiom =
        "(:predicates (lit))\n  (:derived (lit) (exists (?l - lamp) (on ?l)))\n  (:action go";
    let domain = LAMP.replace("(:predicates", "(:predicates (lit)");
    let domain = domain.replace("(:action go", axiom.split_once('\n').expect("two lines").1);
    let sandbox = Sandbox::new(&[("domain.pddl", &domain), ("evening.pddl", EVENING)])
        .with_variable("ALTHING_METRIC_FF", "/bin/true");
    let run = sandbox.check(&format!("{TASK} metric-ff"), 34);
    assert!(
        run.stderr.contains("error: Metric-FF does not support derived predicates"),
        "{}",
        run.stderr
    );
    assert!(run.stderr.contains("domain.pddl:9"), "{}", run.stderr);
    assert!(run.stderr.contains("the embedded engine may be able to"), "{}", run.stderr);
}

#[test]
fn an_engine_that_answers_nothing_has_broken_down() {
    let sandbox = Sandbox::lamp().with_variable("ALTHING_METRIC_FF", "/bin/true");
    let run = sandbox.check(&format!("{TASK} metric-ff --json"), 32);
    assert_eq!(run.json()["status"], "engine-failed");
}

#[test]
fn a_signal_ends_the_engine_and_leaves_nothing() {
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let sandbox = Sandbox::lamp();
        let pipe = sandbox.path().join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo is there").success());
        let hang =
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../planning/engines/tests/fake/hang.sh");
        let child = Command::new(env!("CARGO_BIN_EXE_althing"))
            .args(format!("{TASK} fast-downward --json").split_whitespace())
            .current_dir(sandbox.path())
            .env("ALTHING_FAST_DOWNWARD", hang)
            .env("HANG_PIPE", &pipe)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the binary runs");
        let (tell, told) = mpsc::channel();
        std::thread::spawn(move || {
            let mut pipe = BufReader::new(std::fs::File::open(pipe).expect("the pipe"));
            let mut line = String::new();
            let _ = pipe.read_line(&mut line);
            let _ = tell.send(line);
            let _ = pipe.read_to_end(&mut Vec::new());
            let _ = tell.send("dead".to_owned());
        });
        let patience = Duration::from_secs(120);
        let line = told.recv_timeout(patience).expect("the engine starts");
        let folder = line.trim().split_once(' ').map(|(_, folder)| folder.to_owned());
        let id = child.id().to_string();
        let sent = Command::new("kill").args([&format!("-{signal}"), &id]).status();
        assert!(sent.expect("kill is there").success());
        let output = child.wait_with_output().expect("our child");
        assert_eq!(output.status.code(), Some(code));
        let answer = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(answer.contains("\"status\":\"cancelled\""), "{answer}");
        assert_eq!(told.recv_timeout(patience).as_deref(), Ok("dead"), "nobody of it lives");
        assert!(!std::path::Path::new(&folder.expect("a folder")).exists());
    }
}
