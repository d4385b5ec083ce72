//! `althing check` on PDDL: kinds of files, domains that are found beside them, mistakes.

use expect_test::expect;

use crate::sandbox::{EVENING, LAMP, Sandbox};

const MODEL: &str = "\
(define (agent butler)
  (:domain lamp)
  (:types butler)
  (:objects butler - butler)
  (:action dim :agent ?b - butler
    :parameters (?l - lamp)
    :precondition (on ?l)
    :effect (not (on ?l))))
";

#[test]
fn each_file_without_mistakes_has_one_line() {
    let sandbox = Sandbox::lamp();
    sandbox.write("butler.pddl", MODEL.as_bytes());
    sandbox.check("check butler.pddl evening.pddl domain.pddl", 0).shows(
        expect![[r#"
        domain.pddl: domain lamp (4 predicates, 2 actions): ok
        butler.pddl: action model butler (1 action): ok
        evening.pddl: problem evening (3 objects): ok
    "#]],
        expect![""],
    );
}

#[test]
fn a_domain_is_found_beside_or_above_its_problem() {
    let sandbox = Sandbox::new(&[("domain.pddl", LAMP), ("instances/p1.pddl", EVENING)]);
    sandbox.check("check instances/p1.pddl", 0);
    let sandbox = Sandbox::new(&[("lights.pddl", LAMP), ("evening.pddl", EVENING)]);
    sandbox.check("check evening.pddl", 0);
    let sandbox = Sandbox::new(&[("a/domain.pddl", LAMP), ("b/evening.pddl", EVENING)]);
    sandbox.check("check b/evening.pddl a/domain.pddl", 0);
}

#[test]
fn the_domain_with_the_closest_file_name_is_used() {
    let other = LAMP.replace("switch", "toggle").replace("(on ?l - lamp)", "(lit ?l - lamp)");
    let files = [
        ("p1.pddl", EVENING),
        ("p1-domain.pddl", LAMP),
        ("a-domain.pddl", &other.replace("(on ", "(lit ")),
    ];
    let sandbox = Sandbox::new(&files);
    sandbox.check("check p1.pddl", 0);
    sandbox.check("check a-domain.pddl p1-domain.pddl p1.pddl", 0);
}

#[test]
fn a_problem_without_its_domain_is_an_error() {
    let sandbox = Sandbox::new(&[("evening.pddl", EVENING)]);
    sandbox.check("check evening.pddl", 33).shows(
        expect![[r#"
        evening.pddl: problem evening (3 objects): has errors
    "#]],
        expect![[r#"
        error: domain `lamp` is neither given nor beside this file
         --> evening.pddl:2:12
          |
        2 |   (:domain lamp)
          |            ^^^^
          |
          = help: name the file of the domain on the command line too

        1 error
    "#]],
    );
}

#[test]
fn mistakes_of_every_file_are_shown_in_one_pass() {
    let sandbox = Sandbox::new(&[
        ("domain.pddl", &LAMP.replace("(door ?a ?b - room))", "(door ?a ?b - ))")),
        ("evening.pddl", &EVENING.replace("desk-lamp study)", "desk-lamp studdy)")),
        ("butler.pddl", &MODEL.replace(":precondition (on ?l)", ":precondition (onn ?x)")),
        ("poem.pddl", "Roses are red\n"),
    ]);
    sandbox.check("check domain.pddl evening.pddl butler.pddl poem.pddl nothing.pddl", 33).shows(
        expect![[r#"
            domain.pddl: domain lamp (4 predicates, 2 actions): has errors
            nothing.pddl: unreadable file: has errors
            evening.pddl: problem evening (3 objects): has errors
            butler.pddl: action model butler (1 action): has errors
            poem.pddl: unknown file: has errors
        "#]],
        expect![[r#"
            error: no type after `-`
             --> domain.pddl:8:17
              |
            8 |     (door ?a ?b - ))
              |                 ^
              |
              = rule: TYPE = NAME | (either NAME+)

            error: failed to read `nothing.pddl`: there is no such file

            error: unknown object `studdy`
             --> evening.pddl:4:70
              |
            4 | ...(door study hall) (in desk-lamp studdy))
              |                                    ^^^^^^
              |
              = help: did you mean `study`?

            error: unknown predicate `onn`
             --> butler.pddl:7:20
              |
            7 |     :precondition (onn ?x)
              |                    ^^^
              |
              = help: did you mean `on`?
              = rule: (on ?l - lamp)

            error: unknown variable `?x`
             --> butler.pddl:7:24
              |
            7 |     :precondition (onn ?x)
              |                        ^^

            error: expected a definition, found `Roses`
             --> poem.pddl:1:1
              |
            1 | Roses are red
              | ^^^^^
              |
              = rule: (define (domain|problem|agent NAME) SECTION*)

            error: one definition is expected, `are` is more
             --> poem.pddl:1:7
              |
            1 | Roses are red
              |       ^^^

            7 errors
        "#]],
    );
}

#[test]
fn json_lists_files_and_mistakes() {
    let sandbox = Sandbox::lamp();
    let run = sandbox.check("check domain.pddl --json", 0);
    assert_eq!(
        run.json(),
        serde_json::json!({
            "status": "ok",
            "files": [{
                "file": "domain.pddl",
                "kind": "domain",
                "about": "lamp (4 predicates, 2 actions)",
                "ok": true,
            }],
            "diagnostics": [],
        })
    );
    sandbox.write("domain.pddl", LAMP.replace("(on ?l)))", "(onn ?l)))").as_bytes());
    let run = sandbox.check("check domain.pddl --json", 33);
    let diagnostic = &run.json()["diagnostics"][0];
    assert_eq!(diagnostic["file"], "domain.pddl");
    assert_eq!(diagnostic["line"], 16);
    assert_eq!(diagnostic["column"], 14);
    assert_eq!(diagnostic["help"], "did you mean `on`?");
}
