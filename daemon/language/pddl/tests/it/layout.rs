//! Tests of the layout of printed trees.

use expect_test::{Expect, expect};

/// Checks the printed form of a condition: first on one line, then with breaks in long lines.
#[track_caller]
fn check(text: &str, expected: Expect) {
    let condition = pddl::parse_condition(text).into_result().expect("the text is right");
    expected.assert_eq(&format!("{condition}\n{condition:#}\n"));
}

#[test]
fn short_things_stay_on_a_line() {
    check(
        "(and\n (p ?x)\n (not (q)))",
        expect![[r#"
        (and (p ?x) (not (q)))
        (and (p ?x) (not (q)))
    "#]],
    );
}

#[test]
fn long_lists_have_a_line_for_each_item() {
    check(
        "(and (connected ?office-of-the-director ?corridor) (forall (?room - (either office meeting-room)
           ?sensor - temperature-sensor) (imply (located ?sensor ?room) (and (known-temperature ?room)
           (<= (temperature ?room) (+ 20 (* 0.5 (tolerance ?sensor))))))))",
        expect![[r#"
            (and (connected ?office-of-the-director ?corridor) (forall (?room - (either office meeting-room) ?sensor - temperature-sensor) (imply (located ?sensor ?room) (and (known-temperature ?room) (<= (temperature ?room) (+ 20 (* 0.5 (tolerance ?sensor))))))))
            (and
              (connected ?office-of-the-director ?corridor)
              (forall (?room - (either office meeting-room) ?sensor - temperature-sensor)
                (imply
                  (located ?sensor ?room)
                  (and (known-temperature ?room) (<= (temperature ?room) (+ 20 (* 0.5 (tolerance ?sensor))))))))
        "#]],
    );
}

#[test]
fn numbers_have_no_exponent() {
    check(
        "(= (f) 1e21)",
        expect![[r#"
        (= (f) 1000000000000000000000)
        (= (f) 1000000000000000000000)
    "#]],
    );
    check(
        "(= (f) 1.50e-7)",
        expect![[r#"
        (= (f) 0.00000015)
        (= (f) 0.00000015)
    "#]],
    );
    check(
        "(= (f) +3.0)",
        expect![[r#"
        (= (f) 3)
        (= (f) 3)
    "#]],
    );
}

#[test]
fn spelling_is_kept() {
    check(
        "(AND (Docked ?Robot DOCK_1))",
        expect![[r#"
        (and (Docked ?Robot DOCK_1))
        (and (Docked ?Robot DOCK_1))
    "#]],
    );
}

#[test]
fn many_objects_of_a_type_are_wrapped() {
    let names: Vec<_> = (0..40).map(|number| format!("office{number}")).collect();
    let text = format!("(define (problem p) (:domain d) (:objects {} - room k))", names.join(" "));
    let problem = pddl::parse_problem(&text).into_result().expect("the text is right");
    expect![[r#"
        (define (problem p)
          (:domain d)
          (:objects
            office0 office1 office2 office3 office4 office5 office6 office7 office8 office9 office10
            office11 office12 office13 office14 office15 office16 office17 office18 office19 office20
            office21 office22 office23 office24 office25 office26 office27 office28 office29 office30
            office31 office32 office33 office34 office35 office36 office37 office38 office39 - room
            k - object)
          (:goal (and)))
    "#]].assert_eq(&problem.to_string());
}
