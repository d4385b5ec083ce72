//! Tests of the queue of a channel.

use proptest::prelude::*;

use super::*;
use crate::notice::NoticeEvent;
use crate::quiet_hours::QuietHours;

/// 2026-11-28 12:00 UTC, a Saturday.
const NOON_MS: u64 = 1_795_867_200_000;

fn rules() -> ChannelRules {
    let events =
        [NoticeEvent::Question, NoticeEvent::GoalLost, NoticeEvent::AgentGone, NoticeEvent::Stop];
    ChannelRules {
        events: events.into(),
        quiet: None,
        are_stops_quiet: false,
        until: None,
        per_hour: 30,
    }
}

fn quiet() -> ChannelRules {
    ChannelRules { quiet: Some(QuietHours::parse("22:00-07:00").expect("hours")), ..rules() }
}

fn queue(rules: ChannelRules) -> NoticeQueue {
    NoticeQueue::new(rules, TimeZone::UTC)
}

/// The time of so many minutes after noon.
fn at(minutes: u64) -> NoticeTime {
    NoticeTime { steady_ms: minutes * 60_000, wall_ms: NOON_MS + minutes * 60_000 }
}

fn notice(kind: NoticeKind, number: u64, now: NoticeTime) -> Notice {
    Notice::new(kind, &number.to_string(), now.wall_ms)
}

fn sent(queue: &mut NoticeQueue, now: NoticeTime) -> Option<Vec<String>> {
    match queue.next(now) {
        QueueStep::Send(delivery) => Some(delivery.notices.into_iter().map(|it| it.id).collect()),
        _ => None,
    }
}

fn id(kind: NoticeKind, number: u64) -> String {
    notice(kind, number, at(0)).id
}

#[test]
fn notices_go_one_after_the_other_and_stay_until_they_have_arrived() {
    let mut queue = queue(rules());
    assert_eq!(queue.next(at(0)), QueueStep::Rest);
    for number in 1..=2 {
        queue.add(notice(NoticeKind::GoalLost, number, at(0)), at(0));
    }
    queue.add(notice(NoticeKind::GoalLost, 2, at(0)), at(0));
    assert_eq!(sent(&mut queue, at(0)), Some(vec![id(NoticeKind::GoalLost, 1)]));
    assert_eq!(queue.next(at(0)), QueueStep::Rest, "one is under way");
    assert!(queue.failed(None, at(0)));
    assert_eq!(queue.next(at(0)), QueueStep::Wait(PAUSE_FIRST));
    assert_eq!(sent(&mut queue, at(1)), Some(vec![id(NoticeKind::GoalLost, 1)]), "again");
    queue.delivered();
    assert_eq!(sent(&mut queue, at(1)), Some(vec![id(NoticeKind::GoalLost, 2)]));
    queue.refused();
    assert_eq!((queue.next(at(1)), queue.take_dropped()), (QueueStep::Rest, 1));
}

#[test]
fn a_standby_keeps_what_waits_for_the_end_of_quiet_hours() {
    let longer = Duration::from_secs(20);
    // 22:00 is 600 minutes after noon, and 07:00 is 1140.
    let (evening, night, morning) = (at(590), at(660), at(1_140));
    let kept = |times: &[NoticeTime]| {
        let mut queue = queue(quiet());
        for (number, now) in (0..).zip(times) {
            queue.keep_for_leader(notice(NoticeKind::GoalLost, number, *now), longer, *now);
        }
        queue
    };
    let mut standby = kept(&[evening, night, night]);
    // The leader dies in the night: one of its notices was sent before, two wait.
    standby.take_over(at(700));
    assert_eq!(standby.next(at(700)), QueueStep::Wait(Duration::from_secs(440 * 60)));
    let sent = sent(&mut standby, morning).expect("the night is over");
    assert_eq!(sent, [1, 2].map(|number| id(NoticeKind::GoalLost, number)));
    // The leader has lived until it sent.
    let mut standby = kept(&[night]);
    standby.forget_kept(morning);
    assert_eq!(standby.take_changed().map(|waiting| waiting.len()), Some(1), "it may die now");
    standby.forget_kept(at(1_141));
    assert_eq!(standby.take_changed(), Some(Vec::new()));
    standby.take_over(at(1_141));
    assert_eq!(standby.next(at(1_141)), QueueStep::Rest);
}

#[test]
fn what_a_standby_keeps_outlasts_its_restart() {
    let mut standby = queue(quiet());
    let now = at(660);
    let longer = Duration::from_secs(20);
    standby.keep_for_leader(notice(NoticeKind::GoalLost, 1, now), longer, now);
    let saved = serde_json::to_string(&standby.take_changed().expect("it has changed"));
    let saved: Vec<WaitingNotice> = serde_json::from_str(&saved.expect("JSON")).expect("JSON");
    let mut again = queue(quiet());
    again.restore(saved);
    again.forget_kept(at(1_141));
    assert_eq!(again.next(at(1_141)), QueueStep::Rest, "the leader has sent it");
}

#[test]
fn a_channel_gets_the_events_that_it_is_for() {
    let rules = ChannelRules { events: [NoticeEvent::Stop].into(), ..rules() };
    let mut queue = queue(rules);
    queue.add(notice(NoticeKind::Question, 1, at(0)), at(0));
    assert_eq!(queue.next(at(0)), QueueStep::Rest);
    queue.add(notice(NoticeKind::Release, 1, at(0)), at(0));
    assert!(sent(&mut queue, at(0)).is_some());
}

#[test]
fn quiet_hours_hold_all_but_stops_and_end_with_a_digest() {
    let (mut queue, night) = (queue(quiet()), at(11 * 60));
    for number in 1..=3 {
        queue.add(notice(NoticeKind::GoalLost, number, night), night);
    }
    let wait = Duration::from_secs(8 * 3_600);
    assert_eq!(queue.next(night), QueueStep::Wait(wait));
    queue.add(notice(NoticeKind::Stop, 9, night), night);
    assert_eq!(sent(&mut queue, night), Some(vec![id(NoticeKind::Stop, 9)]));
    queue.delivered();
    let morning = at(11 * 60 + 8 * 60);
    let held: Vec<_> = (1..=3).map(|number| id(NoticeKind::GoalLost, number)).collect();
    let QueueStep::Send(summary) = queue.next(morning) else { panic!("no summary") };
    let ids: Vec<_> = summary.notices.iter().map(|notice| notice.id.clone()).collect();
    assert_eq!(ids, held);
    queue.failed(None, morning);
    let QueueStep::Send(again) = queue.next(at(20 * 60)) else { panic!("no summary") };
    assert_eq!(again.id, summary.id, "a repetition is known by its identifier");
    queue.delivered();
    assert_eq!(queue.next(morning), QueueStep::Rest);
}

#[test]
fn stops_wait_where_the_file_says_so() {
    let rules = ChannelRules { are_stops_quiet: true, ..quiet() };
    let (mut queue, night) = (queue(rules), at(11 * 60));
    queue.add(notice(NoticeKind::Stop, 1, night), night);
    assert!(matches!(queue.next(night), QueueStep::Wait(_)));
}

#[test]
fn a_question_is_sent_alone_and_not_after_its_deadline() {
    let (mut queue, night) = (queue(quiet()), at(11 * 60));
    let question = |number, minutes: u64| {
        let ends_ms = Some(night.wall_ms + minutes * 60_000);
        Notice { ends_ms, ..notice(NoticeKind::Question, number, night) }
    };
    queue.add(question(1, 10), night);
    queue.add(question(2, 600), night);
    for number in 1..=2 {
        queue.add(notice(NoticeKind::GoalLost, number, night), night);
    }
    let morning = at(20 * 60);
    assert_eq!(sent(&mut queue, morning), Some(vec![id(NoticeKind::Question, 2)]));
    queue.delivered();
    assert_eq!(sent(&mut queue, morning).map(|ids| ids.len()), Some(2));
    queue.delivered();
    assert_eq!(queue.take_dropped(), 0, "nobody waits for that answer any more");
}

#[test]
fn the_rate_holds_notices_back_and_lets_stops_exceed_it() {
    let mut queue = queue(ChannelRules { per_hour: 2, ..rules() });
    for number in 1..=5 {
        queue.add(notice(NoticeKind::GoalLost, number, at(0)), at(0));
    }
    for _ in 0..2 {
        assert!(sent(&mut queue, at(0)).is_some());
        queue.delivered();
    }
    assert_eq!(queue.next(at(0)), QueueStep::Wait(Duration::from_secs(3_600)));
    for number in 1..=3 {
        queue.add(notice(NoticeKind::Stop, number, at(1)), at(1));
    }
    for number in 1..=2 {
        assert_eq!(sent(&mut queue, at(1)), Some(vec![id(NoticeKind::Stop, number)]));
        queue.delivered();
    }
    assert_eq!(queue.next(at(1)), QueueStep::Wait(Duration::from_secs(59 * 60)));
    assert_eq!(sent(&mut queue, at(60)), Some(vec![id(NoticeKind::Stop, 3)]));
    queue.delivered();
    assert_eq!(sent(&mut queue, at(121)).map(|ids| ids.len()), Some(3), "a summary of the others");
}

#[test]
fn pauses_grow_to_a_bound_and_a_longer_one_is_obeyed() {
    let mut queue = queue(rules());
    queue.add(notice(NoticeKind::Stop, 1, at(0)), at(0));
    let mut now = at(0);
    let mut waits = Vec::new();
    for _ in 0..11 {
        assert!(sent(&mut queue, now).is_some());
        queue.failed(None, now);
        let QueueStep::Wait(wait) = queue.next(now) else { panic!("no pause") };
        waits.push(wait.as_secs());
        let wait_ms = u64::try_from(wait.as_millis()).expect("a short time");
        now = NoticeTime { steady_ms: now.steady_ms + wait_ms, wall_ms: now.wall_ms + wait_ms };
    }
    assert_eq!(waits, [1, 2, 4, 8, 16, 32, 64, 128, 256, 300, 300]);
    assert!(sent(&mut queue, now).is_some());
    queue.failed(Some(Duration::from_secs(900)), now);
    assert_eq!(queue.next(now), QueueStep::Wait(Duration::from_secs(900)));
    queue.failed(Some(Duration::from_secs(999_999)), now);
    assert_eq!(queue.next(now), QueueStep::Wait(ASKED_PAUSE_MAX));
}

#[test]
fn a_channel_ends_and_an_old_notice_is_given_up() {
    let until = timestamp(at(60).wall_ms);
    let mut ending = queue(ChannelRules { until: Some(until), ..rules() });
    ending.add(notice(NoticeKind::Stop, 1, at(0)), at(0));
    assert_eq!(ending.next(at(60)), QueueStep::Rest);
    ending.add(notice(NoticeKind::Stop, 2, at(61)), at(61));
    assert_eq!((ending.next(at(61)), ending.take_dropped()), (QueueStep::Rest, 0));
    let mut queue = queue(rules());
    queue.add(notice(NoticeKind::Stop, 1, at(0)), at(0));
    assert_eq!((queue.next(at(24 * 60)), queue.take_dropped()), (QueueStep::Rest, 1));
}

#[test]
fn a_question_that_is_settled_is_not_sent_unless_it_is_under_way() {
    let mut queue = queue(rules());
    for number in 1..=2 {
        queue.add(notice(NoticeKind::Question, number, at(0)), at(0));
    }
    assert_eq!(sent(&mut queue, at(0)), Some(vec![id(NoticeKind::Question, 1)]));
    queue.settle(&id(NoticeKind::Question, 1));
    queue.settle(&id(NoticeKind::Question, 2));
    queue.delivered();
    assert_eq!(queue.next(at(0)), QueueStep::Rest);
}

#[test]
fn the_oldest_gives_way_and_stops_stay() {
    let mut queue = queue(rules());
    queue.add(notice(NoticeKind::Stop, 0, at(0)), at(0));
    for number in 0..=u64::try_from(WAITING_MAX).expect("few") {
        queue.add(notice(NoticeKind::GoalLost, number, at(0)), at(0));
    }
    assert_eq!((queue.waiting.len(), queue.take_dropped()), (WAITING_MAX, 2));
    assert_eq!(sent(&mut queue, at(0)), Some(vec![id(NoticeKind::Stop, 0)]));
}

#[test]
fn what_waits_outlasts_the_process() {
    let mut before = queue(quiet());
    let night = at(11 * 60);
    for number in 1..=2 {
        before.add(notice(NoticeKind::GoalLost, number, night), night);
    }
    let saved = serde_json::to_vec(&before.take_changed()).expect("JSON");
    assert_eq!(before.take_changed(), None);
    let mut after = queue(quiet());
    let saved: Vec<WaitingNotice> = serde_json::from_slice(&saved).expect("JSON");
    after.restore(saved);
    assert_eq!(sent(&mut after, at(20 * 60)).map(|ids| ids.len()), Some(2));
}

/// What an owner does with a queue.
#[derive(Clone, Debug)]
enum Doing {
    Add(NoticeKind),
    Deliver,
    Fail,
    Refuse,
    Pass(u64),
}

fn doing() -> impl Strategy<Value = Doing> {
    let kind = prop_oneof![
        Just(NoticeKind::Question),
        Just(NoticeKind::GoalLost),
        Just(NoticeKind::AgentGone),
        Just(NoticeKind::Stop),
    ];
    prop_oneof![
        4 => kind.prop_map(Doing::Add),
        2 => Just(Doing::Deliver),
        1 => Just(Doing::Fail),
        1 => Just(Doing::Refuse),
        2 => (0..300_u64).prop_map(Doing::Pass),
    ]
}

proptest! {
    /// Nothing calm is sent in quiet hours, the rate is never exceeded, and no notice is both
    /// delivered and sent again.
    #[test]
    fn rules_hold_whatever_happens(doings in prop::collection::vec(doing(), 1..200)) {
        let mut queue = queue(ChannelRules { per_hour: 3, ..quiet() });
        let (mut minutes, mut number) = (0, 0);
        let mut delivered = std::collections::BTreeSet::new();
        let mut arrivals: Vec<u64> = Vec::new();
        let mut under_way: Option<(NoticeDelivery, u64)> = None;
        for doing in doings {
            match doing {
                Doing::Add(kind) => {
                    number += 1;
                    queue.add(notice(kind, number, at(minutes)), at(minutes));
                }
                Doing::Pass(passed) => minutes += passed,
                Doing::Deliver => {
                    if let Some((delivery, began)) = under_way.take() {
                        queue.delivered();
                        arrivals.push(began);
                        delivered.extend(delivery.notices.into_iter().map(|notice| notice.id));
                    }
                }
                Doing::Fail if under_way.take().is_some() => {
                    queue.failed(None, at(minutes));
                }
                Doing::Refuse if under_way.take().is_some() => queue.refused(),
                Doing::Fail | Doing::Refuse => (),
            }
            if let QueueStep::Send(delivery) = queue.next(at(minutes)) {
                prop_assert!(under_way.is_none());
                let is_night = quiet().quiet.expect("hours")
                    .is_quiet(timestamp(at(minutes).wall_ms), &TimeZone::UTC);
                for sent in &delivery.notices {
                    prop_assert!(!delivered.contains(&sent.id));
                    prop_assert!(!is_night || sent.kind.is_urgent());
                }
                let recent = arrivals.iter().filter(|at| **at + 60 > minutes).count();
                let most = if delivery.is_urgent() { 6 } else { 3 };
                prop_assert!(recent < most, "{recent} in an hour");
                under_way = Some((delivery, minutes));
            }
            prop_assert!(queue.waiting.len() <= WAITING_MAX);
        }
    }
}
