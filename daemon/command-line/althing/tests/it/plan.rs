//! `althing plan`: exit codes, the plan's format, refusals.

use expect_test::expect;

use crate::sandbox::{EVENING, LAMP, Sandbox};

const TASK: &str = "plan domain.pddl evening.pddl";

#[test]
fn a_plan_goes_to_stdout_in_the_field_s_format() {
    Sandbox::lamp().check(TASK, 0).shows(
        expect![[r#"
            (go hall study)
            (switch desk-lamp study)
            ; cost = 2 (unit cost)
        "#]],
        expect![[r#"
            plan found: 2 steps, cost 2 (unit cost); no shorter plan exists
            3 facts, 3 operators; 2 states expanded in … s
        "#]],
    );
}

#[test]
fn a_plan_goes_to_a_file_if_one_is_named() {
    let sandbox = Sandbox::lamp();
    let run = sandbox.check("plan domain.pddl evening.pddl --plan out.txt", 0);
    assert_eq!(run.stdout, "");
    let plan = std::fs::read_to_string(sandbox.path().join("out.txt")).expect("the plan");
    assert_eq!(plan, "(go hall study)\n(switch desk-lamp study)\n; cost = 2 (unit cost)\n");
    sandbox.check("validate domain.pddl evening.pddl out.txt", 0);
}

#[test]
fn a_plan_that_cannot_be_written_is_an_error() {
    let run = Sandbox::lamp().check("plan domain.pddl evening.pddl --plan no/such/folder", 74);
    assert!(run.stderr.contains("failed to write `no/such/folder`"), "{}", run.stderr);
}

#[test]
fn costs_are_those_of_the_metric() {
    let domain = LAMP.replace("(:action go", "(:functions (total-cost))\n  (:action go").replace(
        ":effect (and (not (at ?a)) (at ?b))",
        ":effect (and (not (at ?a)) (at ?b) (increase (total-cost) 7))",
    );
    let problem = EVENING.replace("(:goal", "(:metric minimize (total-cost)) (:goal");
    let sandbox = Sandbox::new(&[("domain.pddl", &domain), ("evening.pddl", &problem)]);
    let run = sandbox.check(TASK, 0);
    assert!(run.stdout.ends_with("; cost = 7 (general cost)\n"), "{}", run.stdout);
}

/// Checks that a problem ends with this exit code and status.
#[track_caller]
fn check_problem(domain: &str, problem: &str, code: i32, status: &str) {
    let sandbox = Sandbox::new(&[("domain.pddl", domain), ("evening.pddl", problem)]);
    let run = sandbox.check(TASK, code);
    assert_eq!(run.stdout, "");
    let run = sandbox.check("plan domain.pddl evening.pddl --json", code);
    assert_eq!(run.json()["status"], status, "{}", run.stdout);
}

#[test]
fn an_unreachable_goal_is_proven_before_search() {
    check_problem(LAMP, &EVENING.replace("(door hall study)", ""), 10, "unsolvable");
}

#[test]
fn a_contradictory_goal_is_proven_before_search() {
    let both = EVENING.replace("(on desk-lamp)", "(and (at hall) (at study))");
    check_problem(LAMP, &both, 10, "unsolvable");
}

/// The problem: any two of three lamps can be lit, but not all three.
#[test]
fn a_goal_without_pairwise_conflict_is_proven_by_search() {
    let domain = "(define (domain lamps) (:requirements :strips :typing) (:types lamp bulb)
        (:predicates (on ?l - lamp) (spare ?b - bulb))
        (:action light :parameters (?l - lamp ?b - bulb)
          :precondition (spare ?b) :effect (and (on ?l) (not (spare ?b)))))";
    let problem = "(define (problem evening) (:domain lamps)
        (:objects floor-lamp desk-lamp lantern - lamp left right - bulb)
        (:init (spare left) (spare right))
        (:goal (and (on floor-lamp) (on desk-lamp) (on lantern))))";
    check_problem(domain, problem, 11, "unsolvable");
}

#[test]
fn an_exceeded_time_limit_is_reported() {
    let run = Sandbox::lamp().check("plan domain.pddl evening.pddl --time-limit 0.000000001", 23);
    assert!(run.stderr.contains("no plan: out of time (--time-limit)"), "{}", run.stderr);
}

#[test]
fn an_exceeded_memory_limit_is_reported() {
    // Sixty lamps in sixty rooms: their tables do not fit in a megabyte.
    let rooms: Vec<String> = (0..60).map(|i| format!("r{i}")).collect();
    let doors: String =
        rooms.iter().flat_map(|a| rooms.iter().map(move |b| format!("(door {a} {b})"))).collect();
    let lamps: Vec<String> = (0..60).map(|i| format!("l{i}")).collect();
    let places: String = lamps.iter().zip(&rooms).map(|(l, r)| format!("(in {l} {r})")).collect();
    let goals: String = lamps.iter().map(|lamp| format!("(on {lamp})")).collect();
    let problem = format!(
        "(define (problem many) (:domain lamp) (:objects {} - room {} - lamp)
         (:init (at r0) {doors} {places}) (:goal (and {goals})))",
        rooms.join(" "),
        lamps.join(" ")
    );
    let sandbox = Sandbox::new(&[("domain.pddl", LAMP), ("evening.pddl", &problem)]);
    let run = sandbox
        .check("plan domain.pddl evening.pddl --search astar-blind --memory-limit 1 --json", 22);
    assert_eq!(run.json()["status"], "out-of-memory");
}

#[test]
fn mistakes_in_both_files_are_shown_at_once() {
    let domain = LAMP.replace("(in ?l ?r))\n    :effect", "(im ?l ?r))\n    :effect");
    let problem =
        EVENING.replace("(door study hall)", "(door studdy hall)").replace("(on d", "(onn d");
    let sandbox = Sandbox::new(&[("domain.pddl", &domain), ("evening.pddl", &problem)]);
    sandbox.check(TASK, 33).shows(
        expect![""],
        expect![[r#"
        error: unknown predicate `im`
          --> domain.pddl:15:33
           |
        15 |     :precondition (and (at ?r) (im ?l ?r))
           |                                 ^^
           |
           = help: did you mean `in`?
           = rule: (in ?l - lamp ?r - room)

        error: unknown object `studdy`
         --> evening.pddl:4:44
          |
        4 |   (:init (at hall) (door hall study) (door studdy hall) (in desk-lamp stu...
          |                                            ^^^^^^
          |
          = help: did you mean `study`?

        error: unknown predicate `onn`
         --> evening.pddl:5:11
          |
        5 |   (:goal (onn desk-lamp)))
          |           ^^^
          |
          = help: did you mean `on`?
          = rule: (on ?l - lamp)

        3 errors
    "#]],
    );
}

#[test]
fn a_missing_file_is_bad_input() {
    Sandbox::lamp().check("plan domain.pddl nothing.pddl", 33).shows(
        expect![""],
        expect![[r#"
        error: failed to read `nothing.pddl`: there is no such file

        1 error
    "#]],
    );
    let run = Sandbox::lamp().check("plan . evening.pddl", 33);
    assert!(run.stderr.contains("failed to read `.`: it is a folder"), "{}", run.stderr);
}

#[test]
fn swapped_files_are_recognised() {
    Sandbox::lamp().check("plan evening.pddl domain.pddl", 33).shows(
        expect![""],
        expect![[r#"
            error: `evening.pddl` holds a problem, and `domain.pddl` a domain: name the
                   domain first

            1 error
        "#]],
    );
}

#[test]
fn a_binary_file_is_refused_as_a_whole() {
    let sandbox = Sandbox::lamp();
    let program: Vec<u8> =
        (0..20_000_u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    sandbox.write("evening.pddl", &program);
    sandbox.check(TASK, 33).shows(
        expect![""],
        expect![[r#"
        error: failed to read `evening.pddl`: it is not UTF-8 text

        1 error
    "#]],
    );
}

#[test]
fn a_file_that_is_not_utf_8_is_read() {
    let sandbox = Sandbox::lamp();
    sandbox.write("evening.pddl", &[b"; Th\xe9r\xe8se\n".as_slice(), EVENING.as_bytes()].concat());
    sandbox.check(TASK, 0);
}

/// Checks that an unsupported option is refused by its name, before the files are read.
#[track_caller]
fn check_refused(option: &str) {
    let run = Sandbox::lamp().check(&format!("{TASK} {option}"), 34);
    let name = option.split(' ').find(|word| word.starts_with("--") && *word != "--engine");
    let name = name.expect("a name");
    assert!(
        run.stderr.contains(name) && run.stderr.contains("not supported yet"),
        "{}",
        run.stderr
    );
    let run = Sandbox::lamp().check(&format!("{TASK} {option} --json"), 34);
    assert_eq!(run.json()["status"], "unsupported");
}

#[test]
fn options_that_are_not_built_are_refused_by_name() {
    check_refused("--engine metric-ff --optimal");
    check_refused("--anytime --engine metric-ff");
    check_refused("--anytime --optimal");
    check_refused("--threads 3");
}

#[test]
fn every_way_to_search_finds_the_plan() {
    let list = Sandbox::lamp().check("plan --list --json", 0).json();
    let searches = list["searches"].as_array().expect("searches").clone();
    assert!(searches.len() > 4, "{list}");
    for search in searches {
        let name = search["name"].as_str().expect("a name");
        for rest in ["", "--threads 2", "--anytime", "--optimal"] {
            Sandbox::lamp().check(&format!("{TASK} --search {name} {rest}"), 0);
        }
    }
}

#[test]
fn the_cheapest_plan_is_marked_as_proven() {
    let run = Sandbox::lamp().check(&format!("{TASK} --optimal --json"), 0);
    assert_eq!(run.json()["statistics"]["proven_optimal"], true);
}

#[test]
fn better_and_better_plans_end_up_in_the_file() {
    let sandbox = Sandbox::lamp();
    let run = sandbox.check(&format!("{TASK} --anytime --plan out.txt"), 0);
    assert!(run.stderr.contains("plan found"), "{}", run.stderr);
    sandbox.check(&format!("{} out.txt", TASK.replacen("plan", "validate", 1)), 0);
}

#[test]
fn a_feature_that_is_not_supported_is_shown_in_its_line() {
    let durative = "(:durative-action wait :parameters () :duration (= ?duration 1) :condition () \
                    :effect (and))";
    let domain = LAMP.replace("  (:action go", &format!("  {durative}\n  (:action go"));
    let sandbox = Sandbox::new(&[("domain.pddl", &domain), ("evening.pddl", EVENING)]);
    let run = sandbox.check(TASK, 34);
    assert!(run.stderr.contains("domain.pddl:9"), "{}", run.stderr);
}

#[test]
fn a_search_is_timed_apart() {
    let command = "plan domain.pddl evening.pddl --search lama-first --json";
    let statistics = Sandbox::lamp().check(command, 0).json()["statistics"].clone();
    let seconds = |name: &str| statistics[name].as_f64().unwrap_or(f64::NAN);
    assert!(seconds("search_seconds") <= seconds("seconds"), "{statistics}");
}

#[test]
fn json_is_one_object() {
    let run = Sandbox::lamp().check("plan domain.pddl evening.pddl --json", 0);
    let mut value = run.json();
    assert!(value["statistics"]["seconds"].as_f64().is_some_and(|seconds| seconds > 0.0));
    value["statistics"] = serde_json::json!(null);
    expect![[r#"
        {
          "cost": 2,
          "cost_kind": "unit cost",
          "diagnostics": [],
          "plan": [
            "(go hall study)",
            "(switch desk-lamp study)"
          ],
          "reason": "goal reached",
          "statistics": null,
          "status": "plan-found"
        }"#]]
    .assert_eq(&serde_json::to_string_pretty(&value).expect("text"));
    assert_eq!(run.stderr, "");
}

#[test]
fn mistakes_are_reported_as_json_too() {
    let problem = EVENING.replace("(on desk-lamp)", "(onn desk-lamp)");
    let sandbox = Sandbox::new(&[("domain.pddl", LAMP), ("evening.pddl", &problem)]);
    let run = sandbox.check("plan domain.pddl evening.pddl --json", 33);
    expect![[r#"
        {
          "diagnostics": [
            {
              "column": 11,
              "file": "evening.pddl",
              "help": "did you mean `on`?",
              "label": null,
              "line": 5,
              "message": "unknown predicate `onn`",
              "notes": [],
              "rule": "(on ?l - lamp)",
              "severity": "error"
            }
          ],
          "status": "bad-input"
        }"#]]
    .assert_eq(&serde_json::to_string_pretty(&run.json()).expect("text"));
}
