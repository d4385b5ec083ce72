//! Tests of `althing-plan` as a user runs it.

use std::process::{Command, Output};

use expect_test::expect;

const DOMAIN: &str = "\
(define (domain lamp)
  (:predicates (on))
  (:action switch :parameters () :effect (on)))
";
const PROBLEM: &str = "(define (problem evening) (:domain lamp) (:init) (:goal (on)))\n";

/// Runs `althing-plan` in a folder that contains a domain and a problem.
fn run(arguments: &[&str]) -> Output {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("domain.pddl", DOMAIN), ("evening.pddl", PROBLEM)] {
        std::fs::write(folder.path().join(name), text).expect("it can be written");
    }
    let program = env!("CARGO_BIN_EXE_althing-plan");
    Command::new(program).args(arguments).current_dir(&folder).output().expect("it runs")
}

#[test]
fn it_plans() {
    let output = run(&["domain.pddl", "evening.pddl"]);
    assert_eq!(output.status.code(), Some(0));
    expect![[r#"
        (switch)
        ; cost = 1 (unit cost)
    "#]]
    .assert_eq(&String::from_utf8_lossy(&output.stdout));
}

#[test]
fn a_mistake_in_a_file_is_reported() {
    let output = run(&["domain.pddl", "morning.pddl"]);
    assert_eq!(output.status.code(), Some(33));
    expect![[r#"
        error: failed to read `morning.pddl`: there is no such file

        1 error
    "#]]
    .assert_eq(&String::from_utf8_lossy(&output.stderr));
}

#[test]
fn help_names_the_program() {
    let help = run(&["--help"]);
    assert_eq!(help.status.code(), Some(0));
    let text = String::from_utf8_lossy(&help.stdout);
    assert!(text.contains("Usage: althing-plan [OPTIONS]"), "{text}");
    assert!(text.contains("Examples: althing-plan domain.pddl"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    assert_eq!(run(&["--no-such-option"]).status.code(), Some(64));
}

/// Creates a folder with the given files, each as name and text.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).expect("it can be written");
    }
    folder
}

/// Runs `althing-plan` on the texts of a domain and a problem, each in a file.
fn plan(domain: &str, problem: &str, options: &[&str]) -> Output {
    let folder = folder(&[("domain.pddl", domain), ("problem.pddl", problem)]);
    let program = env!("CARGO_BIN_EXE_althing-plan");
    let mut command = Command::new(program);
    command.args(["domain.pddl", "problem.pddl"]).args(options).current_dir(&folder);
    command.output().expect("it runs")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Domain of a task with two ways to the goal; the cost of the second way depends on the load.
const LOADED: &str = "(define (domain loaded) (:predicates (there)) (:functions (load) (spent))
  (:action pack :parameters () :precondition (< (load) 2) :effect (increase (load) 1))
  (:action go :parameters () :precondition (> (load) 1)
    :effect (and (there) (increase (spent) (load)))))";
const LOADED_TASK: &str = "(define (problem trip) (:domain loaded)
  (:init (= (load) 0) (= (spent) 0)) (:goal (there)) (:metric minimize (spent)))";

#[test]
fn a_plan_without_a_proof_of_optimality_is_marked() {
    for options in [&["--optimal"][..], &["--optimal", "--time-limit", "60"]] {
        let output = plan(LOADED, LOADED_TASK, options);
        assert_eq!(output.status.code(), Some(4), "{options:?} {}", stderr(&output));
        assert!(stdout(&output).starts_with("(pack)\n(pack)\n(go)\n; cost = 2"), "{options:?}");
        assert!(stderr(&output).contains("not proven to be the cheapest"), "{options:?}");
    }
    let json = plan(LOADED, LOADED_TASK, &["--optimal", "--json"]);
    assert_eq!(json.status.code(), Some(4));
    let value: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert_eq!(value["status"], "plan-found");
    assert_eq!(value["statistics"]["proven_optimal"], false);
    assert!(value["unproven"].is_string(), "{value}");
}

/// Tests that exit code and output agree with every option: “no plan” never comes with success, nor
/// a plan with a failure.
#[test]
fn exit_code_and_output_agree() {
    let costs = [
        ("", "(:metric minimize (spent))"),
        ("", "(:metric maximize (spent))"),
        ("", "(:metric minimize (* (spent) (spent)))"),
        ("", "(:metric minimize (total-time))"),
        ("", "(:metric minimize (- 0 (spent)))"),
        ("", ""),
        ("(not-there)", ""),
    ];
    let options: [&[&str]; 8] = [
        &[],
        &["--optimal"],
        &["--anytime", "--time-limit", "1"],
        &["--optimal", "--time-limit", "0.001"],
        &["--optimal", "--memory-limit", "1"],
        &["--search", "astar-lmcut"],
        &["--search", "astar-lmcut", "--optimal"],
        &["--threads", "2", "--optimal"],
    ];
    let domain = LOADED.replace("(there))", "(there) (not-there))");
    for (extra, metric) in costs {
        let goal = if extra.is_empty() { "(there)".to_owned() } else { extra.to_owned() };
        let problem = format!(
            "(define (problem trip) (:domain loaded)
               (:init (= (load) 0) (= (spent) 0)) (:goal {goal}) {metric})"
        );
        for options in options {
            let output = plan(&domain, &problem, options);
            let code = output.status.code().expect("it ends by itself");
            let told = format!("{metric} {options:?} {code} {}", stderr(&output));
            let has_plan = stdout(&output).contains("; cost = ");
            assert_eq!(has_plan, matches!(code, 0 | 1 | 2 | 4), "{told}");
            assert_eq!(stderr(&output).contains("no plan"), !has_plan, "{told}");
        }
    }
}

#[test]
fn valid_unsupported_features_are_not_errors() {
    const PLAIN: &str =
        "(define (domain d) (:predicates (a) (b)) (:action g :parameters () :effect (a)))";
    let problem =
        |parts: &str| format!("(define (problem p) (:domain d) (:objects o) (:init) {parts})");
    let problems = [
        "(:goal (and (a) (preference soft (b))))",
        "(:goal (preference (b)))",
        "(:goal (forall (?x) (preference soft (b))))",
        "(:goal (a)) (:constraints (always (not (b))))",
        "(:goal (a)) (:constraints (and (sometime (b)) (at-most-once (a))))",
        "(:goal (a)) (:metric minimize (is-violated soft))",
    ];
    for parts in problems {
        let output = plan(PLAIN, &problem(parts), &[]);
        assert_eq!(output.status.code(), Some(34), "{parts} {}", stderr(&output));
        assert!(stderr(&output).contains("supported"), "{parts}");
    }
    let domains = [
        "(define (domain d) (:types t) (:functions (place ?x - t) - t) (:predicates (a) (b))
           (:action g :parameters (?x - t) :precondition (= (place ?x) ?x)
             :effect (assign (place ?x) ?x)))",
        "(define (domain d) (:predicates (a) (b)) (:constraints (always (b))))",
        "(define (domain d) (:predicates (a) (b)) (:process p :parameters () :effect (a)))",
        "(define (domain d) (:predicates (a) (b))
           (:durative-action g :parameters () :duration (= ?duration 1) :effect (at end (a))))",
    ];
    for domain in domains {
        let output = plan(domain, &problem("(:goal (a))"), &[]);
        assert_eq!(output.status.code(), Some(34), "{domain} {}", stderr(&output));
    }
}

#[test]
fn an_unreachable_goal_is_explained() {
    let domain = "(define (domain house) (:types robot room)
        (:predicates (at ?r - robot ?x - room) (door ?x ?y - room) (lit ?x - room) (key ?r - robot))
        (:action move :parameters (?r - robot ?from ?to - room)
          :precondition (and (at ?r ?from) (door ?from ?to))
          :effect (and (not (at ?r ?from)) (at ?r ?to)))
        (:action light :parameters (?r - robot ?x - room) :precondition (and (at ?r ?x) (key ?r))
          :effect (lit ?x)))";
    let problem = |goal: &str| {
        format!(
            "(define (problem p) (:domain house) (:objects r - robot hall attic - room)
               (:init (at r hall)) (:goal {goal}))"
        )
    };
    let output = plan(domain, &problem("(and (at r hall) (lit attic))"), &[]);
    assert_eq!(output.status.code(), Some(10));
    let told = stderr(&output).replace("\n  ", " ");
    assert!(
        told.contains("`(lit attic)` cannot be reached: `light` makes it true, but needs"),
        "{told}"
    );
    assert!(told.contains("(key ?r)"), "what is missing: {told}");
    assert!(!told.contains("`(at r hall)` cannot"), "the other part is not blamed: {told}");

    let output = plan(domain, &problem("(at r attic)"), &["--json"]);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(value["explanation"]["parts"][0]["goal"], "(at r attic)", "{value}");
    let why = value["explanation"]["parts"][0]["why"].as_str().expect("a reason");
    assert!(why.contains("no action makes") && why.contains("door"), "{why}");

    // The parts of the goal can be reached one by one, but not together.
    let torn = "(define (domain torn) (:predicates (a) (b) (fuel))
        (:action one :precondition (fuel) :effect (and (a) (not (fuel))))
        (:action two :precondition (fuel) :effect (and (b) (not (fuel)))))";
    let both = "(define (problem p) (:domain torn) (:init (fuel)) (:goal (and (a) (b))))";
    let output = plan(torn, both, &[]);
    assert!(matches!(output.status.code(), Some(10 | 11)));
    assert!(stderr(&output).contains("not all of them together"), "{}", stderr(&output));
}

#[test]
fn a_goal_of_many_conditions_is_proven_unsolvable_and_explained_in_time() {
    let domain = "(define (domain d) (:predicates (r ?x ?y) (g)) (:action a :effect (g)))";
    let objects: Vec<String> = (0..30).map(|number| format!("o{number}")).collect();
    let objects = objects.join(" ");
    let variables: Vec<String> = (0..12).map(|number| format!("?v{number}")).collect();
    let many = format!(
        "(forall ({}) (or (not (r ?v0 ?v1)) (r ?v2 ?v3) (not (r ?v3 ?v11))))",
        variables.join(" ")
    );
    for goal in [
        format!("(and (g) (r o3 o4) {many})"),
        format!("(and {many} (g) (r o3 o4))"),
        "(and (not (exists (?a ?b ?c ?d ?e ?f) (r ?a ?f))) (r o3 o4))".to_owned(),
    ] {
        let problem = format!(
            "(define (problem p) (:domain d) (:objects {objects}) (:init (r o1 o2)) (:goal {goal}))"
        );
        // Written out, the goal has 30 to the power of 12 conditions.
        let output = plan(domain, &problem, &["--time-limit", "60"]);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(10), "{goal}\n{told}");
        assert!(told.contains("`(r o3 o4)` cannot be reached"), "{goal}\n{told}");
    }
}

/// Returns a domain with a text of about `bytes` bytes, which has deep conditions of many
/// quantifiers and alternatives.
fn nested(bytes: usize) -> String {
    let (mut open, mut close) = (String::new(), String::new());
    for at in 0..40 {
        if at % 4 == 0 {
            open += &format!("(exists (?z{at}) ");
            close += ")";
        }
        let z = at / 4 * 4;
        open += &format!("(and (or (q ?z{z}) (r ?x ?z{z})) (or (p) (q ?z{z})) ");
        close += ")";
    }
    let one = format!("{open}(p){close}");
    // An action with more variables is refused.
    let many = one.repeat(200);
    let action = |number: usize| {
        format!("(:action a{number} :parameters (?x) :precondition (and {many}) :effect (p))")
    };
    let actions: String = (0..bytes / many.len()).map(action).collect();
    format!("(define (domain d) (:predicates (p) (q ?x) (r ?x ?y)) {actions})")
}

#[test]
fn time_limits_hold_for_any_text() {
    let problem = "(define (problem p) (:domain d) (:objects a b c) (:init (q a)) (:goal (p)))";
    let began = std::time::Instant::now();
    let output = plan(&nested(10_000_000), problem, &["--time-limit", "1"]);
    assert_eq!(output.status.code(), Some(23), "{}", stderr(&output));
    // Without the limit it takes eight seconds on a machine that is not busy.
    assert!(began.elapsed().as_secs() < 5, "{:?}", began.elapsed());
    assert!(stderr(&output).len() < 10_000, "a person reads it");
}

#[test]
#[cfg(target_os = "linux")]
fn memory_limits_hold_for_any_text() {
    let problem = "(define (problem p) (:domain d) (:objects a b c) (:init (q a)) (:goal (p)))";
    let output = plan(&nested(10_000_000), problem, &["--memory-limit", "1", "--time-limit", "60"]);
    assert_eq!(output.status.code(), Some(22), "{}", stderr(&output));
}

#[test]
#[cfg(target_os = "linux")]
fn memory_is_bounded_where_an_action_has_many_ground_forms() {
    let domain = "(define (domain d) (:types r) (:predicates (p ?a - r) (q ?a ?b ?c ?d ?e ?f - r))
        (:action a :parameters (?a ?b ?c ?d ?e ?f - r)
          :precondition (and (not (= ?a ?b)) (not (= ?c ?d)))
          :effect (and (p ?a) (q ?a ?b ?c ?d ?e ?f))))";
    let objects: Vec<String> = (0..300).map(|number| format!("o{number}")).collect();
    let problem = format!(
        "(define (problem p) (:domain d) (:objects {} - r) (:init)
           (:goal (and (p o1) (q o1 o2 o3 o4 o5 o6) (q o6 o5 o4 o3 o2 o1))))",
        objects.join(" ")
    );
    let folder = folder(&[("domain.pddl", domain), ("problem.pddl", &problem)]);
    let program = env!("CARGO_BIN_EXE_althing-plan");
    // An allocation beyond 400 MB fails, and would end the program by a signal.
    let script = format!(
        "ulimit -v 400000; exec '{program}' domain.pddl problem.pddl --memory-limit 100 \
         --time-limit 120"
    );
    let output = Command::new("sh").args(["-c", &script]).current_dir(&folder).output();
    let output = output.expect("it runs");
    assert_eq!(output.status.code(), Some(22), "{}", stderr(&output));
    assert!(stderr(&output).contains("out of memory at 100 MiB"), "{}", stderr(&output));
}

#[test]
#[cfg(unix)]
fn a_plan_that_cannot_be_written_leaves_the_old_one() {
    let files = [("domain.pddl", DOMAIN), ("evening.pddl", PROBLEM), ("plan", "an older plan\n")];
    let folder = folder(&files);
    // Simulates a full disk: no byte can be written to any file.
    let program = env!("CARGO_BIN_EXE_althing-plan");
    let script =
        format!("trap '' XFSZ; ulimit -f 0; exec '{program}' domain.pddl evening.pddl --plan plan");
    let output = Command::new("sh").args(["-c", &script]).current_dir(&folder).output();
    let output = output.expect("it runs");
    assert_eq!(output.status.code(), Some(74), "{}", stderr(&output));
    assert!(stderr(&output).contains("failed to write `plan`"), "{}", stderr(&output));
    let kept = std::fs::read_to_string(folder.path().join("plan")).expect("it is there");
    assert_eq!(kept, "an older plan\n");
    let count = std::fs::read_dir(folder.path()).expect("a folder").count();
    assert_eq!(count, files.len(), "nothing else is left");
}

#[test]
#[cfg(unix)]
fn a_plan_can_be_written_to_a_stream() {
    let folder = folder(&[("domain.pddl", DOMAIN), ("evening.pddl", PROBLEM)]);
    let program = env!("CARGO_BIN_EXE_althing-plan");
    let output = Command::new(program)
        .args(["domain.pddl", "evening.pddl", "--plan", "/dev/stdout"])
        .current_dir(&folder)
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).starts_with("(switch)\n"), "{}", stdout(&output));
}

#[test]
fn a_missing_goal_is_refused_and_an_empty_one_is_accepted() {
    let domain = "(define (domain d) (:predicates (p)) (:action a :effect (p)))";
    let without = plan(domain, "(define (problem aimless) (:domain d) (:init))", &[]);
    assert_eq!(without.status.code(), Some(33), "{}", stderr(&without));
    let told = stderr(&without);
    assert!(
        told.contains("problem `aimless` has no `:goal`") && told.contains("problem.pddl:1"),
        "{told}"
    );
    let nothing = plan(domain, "(define (problem p) (:domain d) (:init) (:goal (and)))", &[]);
    assert_eq!(nothing.status.code(), Some(0), "{}", stderr(&nothing));
}

#[test]
fn the_reason_for_a_missing_proof_is_correct() {
    let task = |metric: &str| {
        format!(
            "(define (problem trip) (:domain loaded) (:init (= (load) 2) (= (spent) 0))
               (:goal (there)) (:metric {metric}))"
        )
    };
    for (domain, metric, reason) in [
        (LOADED.to_owned(), "minimize (spent)", "the cost of a step depends on the state"),
        (
            LOADED.replace("(spent) (load)", "(spent) 3"),
            "maximize (load)",
            "some step improves the metric",
        ),
        (LOADED.replace("(spent) (load)", "(spent) 1e19"), "minimize (spent)", "too large"),
    ] {
        let output = plan(&domain, &task(metric), &["--optimal"]);
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(4), "{told}");
        assert!(told.contains("not proven to be the cheapest: "), "{told}");
        assert!(told.split_whitespace().collect::<Vec<_>>().join(" ").contains(reason), "{told}");
    }
}

#[test]
fn output_lines_are_in_order() {
    let durative = "(define (domain d) (:predicates (p)) (:durative-action a :parameters ()
        :duration (= ?duration 1) :condition (and) :effect (at end (p))))";
    let problem = "(define (problem p) (:domain d) (:init) (:goal (p)))";
    let output = plan(durative, problem, &[]);
    assert_eq!(output.status.code(), Some(34));
    assert!(stderr(&output).contains("durative actions are not supported"), "{}", stderr(&output));
    let output = plan(durative, problem, &["--memory-limit", "1.5"]);
    assert!(stderr(&output).contains("a whole number of MiB"), "{}", stderr(&output));
    let deep = "(and ".repeat(200) + "(p)" + &")".repeat(200);
    let output = plan(
        &format!(
            "(define (domain d) (:predicates (p)) (:action a :precondition {deep} :effect (p)))"
        ),
        problem,
        &[],
    );
    assert_eq!(output.status.code(), Some(34), "{}", stderr(&output));
}

/// The domain of each agent of a factored task: a porter passes a box to the porter of the next room.
const PORTER: &str = "(define (domain rooms) (:requirements :typing :factored-privacy)
  (:types room box porter - object)
  (:predicates (in ?b - box ?r - room) (next ?a ?b - room) (:private (works ?p - porter ?r - room)))
  (:action pass :parameters (?p - porter ?b - box ?from ?to - room)
    :precondition (and (works ?p ?from) (in ?b ?from) (next ?from ?to))
    :effect (and (in ?b ?to) (not (in ?b ?from)))))
";

fn porter(name: &str, room: &str) -> String {
    format!(
        "(define (problem p) (:domain rooms)
          (:objects a b c - room box - box (:private {name} - porter))
          (:init (in box a) (next a b) (next b c) (works {name} {room})) (:goal (in box c)))"
    )
}

fn plan_folder(folder: &tempfile::TempDir, options: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_althing-plan");
    Command::new(program).arg(folder.path()).args(options).output().expect("it runs")
}

#[test]
fn a_folder_with_files_of_each_agent_is_planned_for_as_a_whole() {
    // Both porters have the same private name.
    let (one, two) = (porter("me", "a"), porter("me", "b"));
    let files = [
        ("domain-one.pddl", PORTER),
        ("problem-one.pddl", &one),
        ("domain-two.pddl", PORTER),
        ("problem-two.pddl", &two),
    ];
    let output = plan_folder(&folder(&files), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let expected = "(pass me box a b)\n(pass me box b c)\n; cost = 2 (unit cost)\n";
    assert_eq!(stdout(&output), expected);
    // Without the second agent there is no plan.
    assert_eq!(plan_folder(&folder(&files[..2]), &[]).status.code(), Some(10));
    let refused = plan_folder(&folder(&files), &["--engine", "metric-ff"]);
    assert_eq!(refused.status.code(), Some(34));
}

/// Returns what a program has printed about mistakes, without its line breaks.
fn unfolded(output: &Output) -> String {
    stderr(output).split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn a_folder_that_is_no_factored_task_is_refused_with_the_reason() {
    let one = porter("me", "a");
    let empty = plan_folder(&folder(&[]), &[]);
    assert_eq!(empty.status.code(), Some(33));
    let told = unfolded(&empty);
    assert!(told.contains("has no file `domain-AGENT.pddl`"), "{told}");
    let half = plan_folder(&folder(&[("domain-one.pddl", PORTER)]), &[]);
    assert!(unfolded(&half).contains("problem-one.pddl"), "{}", unfolded(&half));
    let other = one.replace("a b c - room", "a b c - box");
    let contradicting = folder(&[
        ("domain-one.pddl", PORTER),
        ("problem-one.pddl", &one),
        ("domain-two.pddl", PORTER),
        ("problem-two.pddl", &other),
    ]);
    let refused = plan_folder(&contradicting, &[]);
    assert_eq!(refused.status.code(), Some(33));
    let told = "`a` is a `box` for `two`, and a `room` for another agent";
    assert!(unfolded(&refused).contains(told), "{}", unfolded(&refused));
}
