//! An actuator that runs any program, on a real daemon: planned with, run, and replaced when it
//! fails. The evidence is in the files that the program writes.

use std::fs;

use crate::support::{Office, lab};

/// A kettle with two programs; the test sets `FOLDER` and the program that brews.
const KETTLE: &str = r#"
[[agent]]
name = "kettle-1"
plugin = "command"

[agent.config]
model = '''
(define (agent kettle-1) (:domain smart-office)
  (:types kettle - object)
  (:predicates (filled ?k - kettle) (tea-ready ?r - room))
  (:objects kettle-1 - kettle)
  (:action fill :agent ?k - kettle :parameters ()
    :effect (and (filled ?k) (increase (total-cost) 1)))
  (:action brew :agent ?k - kettle :parameters (?r - room)
    :precondition (filled ?k)
    :effect (and (tea-ready ?r) (not (filled ?k)) (increase (total-cost) 2))))
'''

[agent.config.actions]
fill = { run = ["/bin/sh", "-c", "echo filled >> FOLDER/log"] }
brew = BREW
"#;

const BREWS: &str = r#"{ run = ["/bin/sh", "-c", "test -e FOLDER/tea || { echo no tea >&2; exit 1; }; echo $1 >> FOLDER/log", "brew", "{r}"], time-out = "5s" }"#;

#[test]
fn any_program_is_planned_with_and_replaced_when_it_fails() {
    for mode in ["decentralized", "centralized"] {
        let office = Office::new();
        let folder = office.folder().display().to_string();
        let kettle = KETTLE.replace("BREW", BREWS).replace("FOLDER", &folder);
        let file = office.write("lab.toml", &(lab(mode) + &kettle));
        let mut office = office.with_file(file);
        office.write("tea", "Assam\n");
        office.up(&["daemon"], &[]);
        office.await_devices(1);
        let log = || fs::read_to_string(office.folder().join("log")).unwrap_or_default();

        let (code, said) = office.ask(&["goal", "(tea-ready office1)"]);
        assert_eq!(code, Some(0), "{mode}: {said}");
        assert_eq!(log(), "filled\noffice1\n", "{mode}");
        office.await_fact("(tea-ready office1)", true);
        office.await_fact("(filled kettle-1)", false);

        fs::remove_file(office.folder().join("tea")).expect("it was there");
        let (code, said) = office.ask(&["goal", "(tea-ready office2)"]);
        assert_eq!(code, Some(1), "{mode}: {said}");
        assert!(said.contains("no tea"), "{mode}: {said}");
        assert_eq!(log(), "filled\noffice1\nfilled\n", "{mode}");
    }
}

/// The kettle has poured the water away or not, so it is unknown whether it is full.
#[test]
fn the_effect_of_a_hung_program_is_unknown() {
    let office = Office::new();
    let folder = office.folder().display().to_string();
    let hangs = r#"{ run = ["sleep", "600"], time-out = "500ms" }"#;
    let kettle = KETTLE.replace("BREW", hangs).replace("FOLDER", &folder);
    let text = lab("decentralized") + &kettle;
    let file = office.write("lab.toml", &text);
    let mut office = office.with_file(file);
    office.up(&["daemon"], &[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(tea-ready office1)"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("failed to finish within 500ms"), "{said}");
    office.await_fact("(unknown (filled kettle-1))", true);
    office.await_fact("(unknown (tea-ready office1))", true);
    office.await_fact("(filled kettle-1)", false);
    // No goal holds because of a fact that is unknown.
    let (code, said) = office.ask(&["goal", "(not (filled kettle-1))"]);
    assert_eq!(code, Some(1), "{said}");
    assert_eq!(fs::read_to_string(office.folder().join("log")).unwrap_or_default(), "filled\n");
}
