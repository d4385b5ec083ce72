//! Tests of agents that join, fall silent, are masked, and leave.

use acl::Incarnation;
use capability::Timestamp;
use expect_test::expect;

use crate::office::{id, office, thermometer, told, turtlebot};

#[test]
fn masking_removes_only_the_offers() {
    let mut office = office().with([turtlebot("turtlebot-1"), turtlebot("turtlebot-2")]);
    let before = office.snapshot();
    expect![[r#"
        epoch 3!, revision 3
        left ["turtlebot-1"]
    "#]]
    .assert_eq(&told(&office.mask("turtlebot-1")));
    let masked = office.snapshot();
    assert_eq!((&masked.domain, masked.digest()), (&before.domain, before.digest()));
    assert_eq!(masked.problem.objects, before.problem.objects);
    assert_eq!(office.known("offers-move"), "(offers-move turtlebot-2)");
    assert_eq!(office.known("at"), "(at turtlebot-1 corridor)\n(at turtlebot-2 corridor)");
    assert!(office.mask("turtlebot-1").is_empty());
    expect![[r#"
        epoch 4!, revision 4
        joined ["turtlebot-1"]
    "#]]
    .assert_eq(&told(&office.unmask("turtlebot-1")));
    assert_eq!(office.snapshot().problem, before.problem);
}

#[test]
fn removal_removes_actions_objects_and_facts() {
    let mut office = office();
    let before = office.snapshot();
    let joined = office.admit(&turtlebot("turtlebot-1")).change;
    expect![[r#"
        epoch 1!, revision 1
        joined ["turtlebot-1"]
        + (at turtlebot-1 corridor)
        + (docked turtlebot-1)
        + (= (speed turtlebot-1) 0.3)
    "#]]
    .assert_eq(&told(&joined));
    expect![[r#"
        epoch 2!, revision 2
        left ["turtlebot-1"]
        - (at turtlebot-1 corridor)
        - (docked turtlebot-1)
        - (= (speed turtlebot-1) 0.3)
    "#]]
    .assert_eq(&told(&office.remove("turtlebot-1")));
    let after = office.snapshot();
    assert_eq!((after.domain, after.problem), (before.domain, before.problem));
    assert!(office.remove("turtlebot-1").is_empty());
}

#[test]
fn a_masked_agent_leaves_once() {
    let mut office = office().with([turtlebot("turtlebot-1")]);
    assert_eq!(office.mask("turtlebot-1").left, [id("turtlebot-1")]);
    let change = office.remove("turtlebot-1");
    assert!(change.left.is_empty() && change.epoch_changed);
}

#[test]
fn a_silent_agent_is_masked_until_its_next_heartbeat() {
    let mut office = office().with([thermometer("t-1")]);
    office.beat("t-1", (1, 1), "", "").expect("a heartbeat");
    assert_eq!(office.maintainer.next_expiry(), Some(Timestamp(4_500)));
    office.now = Timestamp(4_499);
    assert!(office.maintainer.expire(office.now).is_empty());
    office.now = Timestamp(4_500);
    assert_eq!(office.maintainer.expire(office.now).left, [id("t-1")]);
    assert_eq!(office.maintainer.next_expiry(), None);
    assert_eq!(office.beat("t-1", (1, 2), "", "").expect("a heartbeat").joined, [id("t-1")]);
    // A heartbeat that was sent before the loss of a token does not undo the loss.
    office.mask("t-1");
    assert!(office.beat("t-1", (1, 3), "", "").expect("a heartbeat").joined.is_empty());
}

#[test]
fn a_known_model_changes_nothing_and_a_changed_one_starts_an_epoch() {
    let mut office = office();
    let first = office.admit(&thermometer("t-1")).change;
    assert!(office.admit(&thermometer("t-1")).change.is_empty());
    let model = thermometer("t-1").replace("total-cost) 1", "total-cost) 5");
    assert!(office.maintainer.needs_model(&id("t-1"), &capability::text_digest("other")));
    let changed = office.admit(&model).change;
    assert_eq!((changed.epoch, changed.joined.len()), (first.epoch + 1, 0));
}

#[test]
fn the_token_of_an_earlier_incarnation_is_ignored() {
    let mut office = office().with([thermometer("t-1")]);
    office.admit_life(&thermometer("t-1"), 2).expect("a new incarnation");
    assert!(office.mask("t-1").is_empty());
    assert!(office.remove("t-1").is_empty());
    let now = office.now;
    let change = office.maintainer.mask(&id("t-1"), Incarnation(2), now);
    assert_eq!(change.left, [id("t-1")]);
}
