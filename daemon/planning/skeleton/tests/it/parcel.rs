//! A robot that brings a parcel through a door, which a doorkeeper opens. The robot's places and its
//! battery are private, and so are the doorkeeper's keys.

use pddl::factored::AgentFiles;

use crate::joint::{files, play, validated};

const ROBOT_DOMAIN: &str = "(define (domain parcels) (:requirements :typing :factored-privacy)
  (:types room parcel door cell - object)
  (:predicates (parcel-at ?p - parcel ?r - room) (open ?d - door)
    (leads ?d - door ?a - room ?b - room)
    (:private (standing ?r - room) (holding ?p - parcel) (empty) (charge ?c - cell)
      (next ?c ?d - cell)))
  (:action drive :parameters (?a - room ?b - room ?d - door ?c - cell ?e - cell)
    :precondition (and (standing ?a) (leads ?d ?a ?b) (open ?d) (charge ?c) (next ?c ?e))
    :effect (and (standing ?b) (not (standing ?a)) (charge ?e) (not (charge ?c))))
  (:action take :parameters (?p - parcel ?r - room)
    :precondition (and (standing ?r) (parcel-at ?p ?r) (empty))
    :effect (and (holding ?p) (not (parcel-at ?p ?r)) (not (empty))))
  (:action put :parameters (?p - parcel ?r - room)
    :precondition (and (standing ?r) (holding ?p))
    :effect (and (empty) (parcel-at ?p ?r) (not (holding ?p)))))";

/// The robot's problem, with so many drives in its battery.
fn robot(drives: usize) -> AgentFiles {
    let cells: Vec<String> = (0..=drives).map(|cell| format!("cell{cell}")).collect();
    let next: String =
        (0..drives).map(|cell| format!(" (next cell{} cell{cell})", cell + 1)).collect();
    files(
        "robot",
        ROBOT_DOMAIN,
        &format!(
            "(define (problem p) (:domain parcels)
              (:objects hall lab - room box - parcel gate - door
                (:private {} - cell))
              (:init (parcel-at box lab) (leads gate hall lab) (leads gate lab hall)
                (standing hall) (empty) (charge cell{drives}){next})
              (:goal (parcel-at box hall)))",
            cells.join(" ")
        ),
    )
}

/// The doorkeeper, with a key that it has to fetch first, or without one.
pub(crate) fn doorkeeper(key: &str, has_key: bool) -> AgentFiles {
    let there = if has_key { format!("(hangs {key})") } else { String::new() };
    files(
        "doorkeeper",
        "(define (domain parcels) (:requirements :typing :factored-privacy)
          (:types door - object key - object)
          (:predicates (open ?d - door)
            (:private (hangs ?k - key) (pocketed ?k - key) (unlocked ?d - door)))
          (:action fetch :parameters (?k - key) :precondition (hangs ?k)
            :effect (and (pocketed ?k) (not (hangs ?k))))
          (:action unlock :parameters (?d - door ?k - key) :precondition (pocketed ?k)
            :effect (unlocked ?d))
          (:action swing :parameters (?d - door) :precondition (unlocked ?d) :effect (open ?d)))",
        &format!(
            "(define (problem p) (:domain parcels)
              (:objects gate - door (:private {key} - key))
              (:init {there}) (:goal (and)))"
        ),
    )
}

pub(crate) fn task(drives: usize, has_key: bool) -> Vec<AgentFiles> {
    vec![doorkeeper("brass", has_key), robot(drives)]
}

#[test]
fn agents_that_need_each_other_find_a_plan() {
    let task = task(2, true);
    let steps = play(&task).steps.expect("a plan");
    assert_eq!(validated(&task, &steps), Ok(7.0));
    let of = |agent: &str| steps.iter().filter(|(it, _)| it == agent).count();
    assert_eq!((of("doorkeeper"), of("robot")), (3, 4));
}

#[test]
fn what_only_secrets_forbid_is_proved_impossible() {
    // The projections say nothing of keys and batteries at first.
    assert!(play(&task(2, false)).steps.is_none());
    assert!(play(&task(1, true)).steps.is_none());
}
