//! `althing validate`: the verdict, the cost in the last line, the step and the condition that
//! fail.

use expect_test::{Expect, expect};

use crate::sandbox::{EVENING, LAMP, Sandbox};

const TASK: &str = "validate domain.pddl evening.pddl plan.txt";

#[track_caller]
fn check(plan: &str, code: i32, stdout: Expect, stderr: Expect) {
    let sandbox =
        Sandbox::new(&[("domain.pddl", LAMP), ("evening.pddl", EVENING), ("plan.txt", plan)]);
    sandbox.check(TASK, code).shows(stdout, stderr);
}

#[test]
fn a_plan_that_works_has_its_cost_on_the_last_line() {
    check(
        "(go hall study)\n(SWITCH desk-lamp study)\n",
        0,
        expect![[r#"
        valid plan with 2 steps
        cost = 2
    "#]],
        expect![""],
    );
}

#[test]
fn the_step_and_the_condition_that_fail_are_shown() {
    check(
        "(switch desk-lamp study)\n",
        1,
        expect![""],
        expect![[r#"
        error: step 1 (switch desk-lamp study): its precondition (at study) does not
               hold
         --> plan.txt:1:1
          |
        1 | (switch desk-lamp study)
          | ^^^^^^^^^^^^^^^^^^^^^^^^

        1 error
    "#]],
    );
}

#[test]
fn a_goal_that_does_not_hold_is_shown_in_the_problem() {
    check(
        "(go hall study)\n",
        1,
        expect![""],
        expect![[r#"
        error: after 1 step, (on desk-lamp) of the goal does not hold
         --> evening.pddl:5:4
          |
        5 |   (:goal (on desk-lamp)))
          |    ^^^^^

        1 error
    "#]],
    );
}

#[test]
fn an_unknown_step_is_shown_with_a_suggestion() {
    check(
        "(go hall study)\n(swich desk-lamp study)\n",
        1,
        expect![""],
        expect![[r#"
        error: step 2 (swich desk-lamp study): no action has this name
         --> plan.txt:2:1
          |
        2 | (swich desk-lamp study)
          | ^^^^^^^^^^^^^^^^^^^^^^^
          |
          = help: did you mean `switch`?

        1 error
    "#]],
    );
}

#[test]
fn a_plan_that_cannot_be_read_is_bad_input() {
    check(
        "(go hall study\n",
        33,
        expect![""],
        expect![[r#"
        error: unclosed `(`
         --> plan.txt:1:1
          |
        1 | (go hall study
          | ^ opened here
          |
          = help: add `)` at the end

        1 error
    "#]],
    );
}

#[test]
fn all_three_files_are_read_before_the_report() {
    let sandbox = Sandbox::new(&[("evening.pddl", "(define (problem p)")]);
    let run = sandbox.check(TASK, 33);
    for file in ["domain.pddl", "evening.pddl", "plan.txt"] {
        assert!(run.stderr.contains(file), "{}", run.stderr);
    }
}

#[test]
fn json_has_step_and_condition() {
    let sandbox = Sandbox::lamp();
    let run = sandbox.check("validate domain.pddl evening.pddl plan.txt --json", 0);
    assert_eq!(
        run.json(),
        serde_json::json!({ "status": "valid", "steps": 2, "cost": 2, "diagnostics": [] })
    );
    sandbox.write("plan.txt", b"(switch desk-lamp study)\n");
    let run = sandbox.check("validate domain.pddl evening.pddl plan.txt --json", 1);
    assert_eq!(run.json()["status"], "invalid");
    assert_eq!(run.json()["fault"]["step"], 1);
    assert_eq!(run.json()["fault"]["text"], "(switch desk-lamp study)");
    assert_eq!(run.json()["fault"]["condition"], "(at study)");
}

#[test]
fn times_are_not_supported() {
    let domain = LAMP.replace(
        "  (:action go",
        "  (:durative-action wait :parameters () :duration (= ?duration 1) :condition () \
         :effect (and))\n  (:action go",
    );
    let sandbox = Sandbox::new(&[
        ("domain.pddl", &domain),
        ("evening.pddl", EVENING),
        ("plan.txt", "(wait)"),
    ]);
    let run = sandbox.check(TASK, 34);
    assert!(run.stderr.contains("`wait` is durative"), "{}", run.stderr);
}
