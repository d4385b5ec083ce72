//! Tests that a copy of the state that follows announced changes equals the state of the
//! maintainer.

use acl::content::EpochChange;
use capability::{DomainChange, FollowError, Follower, Timestamp};
use pddl::InitElement;

use crate::office::{Office, office, turtlebot};

fn copy(office: &Office) -> Follower {
    let snapshot = office.snapshot();
    Follower::new(snapshot.epoch, snapshot.revision, &snapshot.problem.init)
}

fn sorted(facts: impl IntoIterator<Item = InitElement>) -> Vec<String> {
    let mut facts: Vec<String> = facts.into_iter().map(|fact| fact.to_string()).collect();
    facts.sort();
    facts
}

#[test]
fn a_copy_applies_changes_and_detects_gaps() {
    let mut office = office().with([turtlebot("turtlebot-1")]);
    let mut follower = copy(&office);
    let mut told: Vec<DomainChange> = Vec::new();
    let said = ["(at turtlebot-1 office2) (= (speed turtlebot-1) 2)", "", "(docked turtlebot-1)"];
    for (sequence, facts) in (1..).zip(said) {
        told.push(office.beat("turtlebot-1", (1, sequence), facts, "").expect("a heartbeat"));
    }
    for change in &told {
        follower.follow(&EpochChange::from(change)).expect("in order");
    }
    assert_eq!(sorted(follower.facts()), sorted(office.snapshot().problem.init));
    // A change that the copy already has is ignored.
    assert_eq!(follower.follow(&EpochChange::from(&told[0])), Ok(()));

    let lost = office.set("keyboard", "(docked turtlebot-1)").expect("a request");
    assert!(lost.is_empty(), "others said so already: {lost:?}");
    office.set("keyboard", "(= (distance corridor office2) 3)").expect("a request");
    let next = office.set("keyboard", "(= (distance corridor office2) 4)").expect("a request");
    let before = follower.clone();
    assert!(matches!(follower.follow(&EpochChange::from(&next)), Err(FollowError::Gap { .. })));
    let masked = office.mask("turtlebot-1");
    assert!(matches!(
        follower.follow(&EpochChange::from(&masked)),
        Err(FollowError::NewEpoch { .. })
    ));
    assert_eq!(follower, before);
    office.now = Timestamp(99_000);
    assert_eq!(copy(&office).revision(), masked.revision);
}

#[test]
fn an_unreadable_change_changes_nothing() {
    let mut follower = copy(&office());
    let before = follower.clone();
    let bad = EpochChange { revision: 1, believed: "(at (".to_owned(), ..EpochChange::default() };
    assert!(matches!(follower.follow(&bad), Err(FollowError::Unreadable(_))));
    assert_eq!(follower, before);
}
