//! Goals by the clock on simulated machines: clocks jump over due times in both directions, machines
//! sleep, and leaders die at the very time at which something is due. Each occurrence is carried out
//! once as long as a replica takes over soon, by the executor's own count; and when all is quiet again,
//! the next one comes.

use std::time::Duration;

use acl::content::{GoalLateness, GoalTimes, Outcome};
use fastrand::Rng;

use crate::house::clocks::{LEADERS, LIT_FOR, Trial};

/// Start of all clocks, as text: 20 seconds after a full minute.
const START: &str = "2026-09-21T13:33:20";

/// Seeds of the trial with random jumps and deaths.
const SEEDS: std::ops::Range<u64> = 0..24;

/// Steps of each of these trials.
const STEPS: usize = 30;

fn every(rule: &str) -> GoalTimes {
    GoalTimes {
        time_zone: Some("UTC".to_owned()),
        start: Some("2026-09-21T13:34:00".to_owned()),
        rule: Some(rule.to_owned()),
        words: format!("every {rule}"),
        ..GoalTimes::default()
    }
}

const MINUTE: Duration = Duration::from_secs(60);

#[tokio::test(start_paused = true)]
async fn a_due_goal_is_kept_and_pursued_at_its_times() {
    let mut trial = Trial::open(0).await;
    let accepted = trial.ask("d", every("FREQ=MINUTELY")).await;
    assert_eq!(accepted.outcome, Outcome::Done, "{accepted:?}");
    assert!(accepted.detail.contains("kept by `journal`"), "{accepted:?}");
    assert!(accepted.detail.contains("next: today 13:34"), "{START}: {accepted:?}");
    assert_eq!(trial.executed().await, "d@20260921T133400Z");
    assert_eq!(trial.executed().await, "d@20260921T133500Z");
    let shown = trial.goals().await;
    let due = shown.iter().find(|goal| goal.conversation.as_str() == "d").expect("it waits");
    let due = due.due.as_ref().expect("it is a goal by the clock");
    assert_eq!(due.next.as_deref(), Some("today 13:36"), "{due:?}");
    // Whoever cancels it is told, and it comes no more.
    let cancelled = trial.cancel("d").await;
    assert_eq!(cancelled.outcome, Outcome::Cancelled, "{cancelled:?}");
    trial.nothing_is_executed(3 * MINUTE).await;
    assert!(trial.goals().await.is_empty());
}

#[tokio::test(start_paused = true)]
async fn a_clock_that_jumps_forward_is_late_or_misses() {
    let mut trial = Trial::open(1).await;
    trial.ask("d", every("FREQ=HOURLY;BYMINUTE=0")).await;
    // From 13:33 to 14:05: five minutes late.
    trial.jump_all(32 * 60);
    assert_eq!(trial.executed().await, "d@20260921T140000Z");
    // From 14:05 to 16:40: two are missed, and said so.
    trial.jump_all(155 * 60);
    trial.nothing_is_executed(MINUTE).await;
    let told = trial.history_of("d").await;
    assert!(told.iter().any(|line| line.contains("asked for, 5 min late")), "{told:?}");
    assert!(told.iter().any(|line| line.starts_with("2 times missed")), "{told:?}");
    assert_eq!(trial.executed().await, "d@20260921T170000Z");
}

#[tokio::test(start_paused = true)]
async fn a_clock_that_jumps_back_repeats_nothing() {
    let mut trial = Trial::open(2).await;
    trial.ask("d", every("FREQ=MINUTELY;INTERVAL=5")).await;
    assert_eq!(trial.executed().await, "d@20260921T133400Z");
    assert_eq!(trial.executed().await, "d@20260921T133900Z");
    trial.jump_all(-12 * 60);
    trial.nothing_is_executed(15 * MINUTE).await;
    assert_eq!(trial.executed().await, "d@20260921T134400Z");
}

#[tokio::test(start_paused = true)]
async fn a_leader_that_dies_at_a_due_time_is_continued() {
    let mut trial = Trial::open(3).await;
    trial.ask("d", every("FREQ=MINUTELY")).await;
    for minute in 34..40 {
        // The executor has just been asked.
        assert_eq!(trial.executed().await, format!("d@20260921T13{minute}00Z"));
        trial.kill_leader().await;
    }
    assert_eq!(trial.broken(), Vec::<String>::new());
}

/// The clocks of two machines agree to the microsecond, so both Plan Requesters begin with one number.
/// If they kept it, the Journal would take the messages of the second leader for repetitions of those
/// of the first: the end of an occurrence would be lost, and the third leader would go on with it.
#[tokio::test(start_paused = true)]
async fn replicas_that_begin_in_one_microsecond_lose_no_end() {
    for seed in 0..8 {
        let mut trial = Trial::with_clocks_apart(seed, Duration::ZERO).await;
        trial.ask("d", every("FREQ=MINUTELY")).await;
        let incarnations = trial.incarnations();
        assert!(incarnations[0] != incarnations[1], "{incarnations:?}");
        for minute in 34..37 {
            assert_eq!(trial.executed().await, format!("d@20260921T13{minute}00Z"));
            trial.kill_leader().await;
            // The lamp is not lit any more.
            tokio::time::sleep(LIT_FOR).await;
            trial.kill_leader().await;
        }
        assert_eq!(trial.broken(), Vec::<String>::new(), "seed {seed}");
    }
}

/// An executor has carried an occurrence out, and each Plan Requester dies before it can record that.
/// The goal is known, and nobody has seen it hold: so it is pursued until it does.
#[tokio::test(start_paused = true)]
async fn an_occurrence_whose_end_no_leader_has_seen_is_pursued_on() {
    let mut trial = Trial::open(5).await;
    trial.ask("d", every("FREQ=MINUTELY;INTERVAL=10")).await;
    assert_eq!(trial.executed().await, "d@20260921T133400Z");
    trial.kill_all();
    tokio::time::sleep(LIT_FOR * 2).await;
    trial.restart_all();
    tokio::time::sleep(LIT_FOR).await;
    let broken = trial.broken();
    assert_eq!(broken.len(), 1, "{broken:?}");
    assert!(broken[0].starts_with("d@20260921T133400Z was carried out twice"), "{broken:?}");
    assert_eq!(trial.executed().await, "d@20260921T134400Z");
}

#[tokio::test(start_paused = true)]
async fn a_goal_that_is_late_is_told_and_one_whose_time_is_over_is_given_up() {
    let mut trial = Trial::open(4).await;
    trial.keep_dark();
    let times = GoalTimes {
        by: Some("30s".to_owned()),
        ends: Some("90s".to_owned()),
        words: "by 30s, for 90s".to_owned(),
        ..GoalTimes::default()
    };
    let reports = trial.follow("g", times).await;
    let late = reports.iter().position(|report| report.lateness == Some(GoalLateness::Late));
    let late = late.unwrap_or_else(|| panic!("{reports:?}"));
    assert!(reports[late].detail.starts_with("not reached by"), "{reports:?}");
    let last = reports.last().expect("an end");
    assert!(late + 1 < reports.len());
    assert_eq!(last.outcome, Outcome::Cancelled, "{reports:?}");
}

/// Every place is taken when a goal is due: it is asked for again every few seconds, and once there is
/// room it is taken.
#[tokio::test(start_paused = true)]
async fn a_due_goal_that_is_refused_is_asked_for_again_after_a_rest() {
    let mut trial = Trial::open(6).await;
    trial.keep_dark();
    trial.ask("d", every("FREQ=HOURLY;INTERVAL=2")).await;
    trial.ask_often(256).await;
    tokio::time::sleep(MINUTE).await;
    let told = trial.history_of("d").await;
    let [_, asked, refused] = told.as_slice() else { panic!("{told:?}") };
    assert_eq!(asked, "today 13:34: asked for");
    assert!(refused.starts_with("today 13:34: refused: 256 goals are pursued"), "{refused}");
    trial.cancel("g250").await;
    tokio::time::sleep(MINUTE).await;
    let told = trial.history_of("d").await;
    let taken = told.get(3).map(String::as_str).unwrap_or_default();
    assert!(taken.starts_with("today 13:34: asked for"), "{told:?}");
}

/// Clocks of the machines jump by hours, and leaders die, also while the executor is being asked.
#[test]
fn jumps_and_deaths_repeat_no_occurrence() {
    let mut executed = 0;
    let one = std::env::var("ALTHING_DUE_SEED").ok().and_then(|seed| seed.parse::<u64>().ok());
    if one.is_some() {
        let filter = tracing_subscriber::EnvFilter::from_default_env();
        tracing_subscriber::fmt().with_env_filter(filter).init();
    }
    for seed in one.map_or(SEEDS, |seed| seed..seed + 1) {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .start_paused(true)
            .build()
            .expect("a runtime");
        executed += runtime.block_on(play(seed));
    }
    assert!(
        executed > 120 || one.is_some(),
        "only {executed} occurrences were pursued in all trials"
    );
}

/// Plays a seed, and returns how many occurrences were pursued.
async fn play(seed: u64) -> usize {
    let rng = &mut Rng::with_seed(seed);
    let mut trial = Trial::open(seed).await;
    trial.ask("d", every("FREQ=MINUTELY")).await;
    for _ in 0..STEPS {
        let step = rng.u8(..8);
        tracing::info!(step, "fault");
        match step {
            0 => trial.jump(rng.usize(..LEADERS), rng.i64(-7_200..7_200)),
            1 => trial.jump_all(rng.i64(-900..3_600)),
            2 => trial.kill_leader().await,
            3 => {
                // At the due time, up to some milliseconds.
                trial.await_execution(2 * MINUTE).await;
                tokio::time::sleep(Duration::from_millis(rng.u64(..40))).await;
                trial.kill_leader().await;
            }
            4 => trial.sleep_machine(rng.usize(..LEADERS), rng.u64(10..600)).await,
            _ => tokio::time::sleep(Duration::from_secs(rng.u64(5..100))).await,
        }
        assert_eq!(trial.broken(), Vec::<String>::new(), "seed {seed}");
    }
    // When all is quiet, the next occurrence comes. Clocks that were ahead come first.
    trial.restart_all();
    trial.align_clocks();
    let before = trial.count();
    tokio::time::sleep(LIT_FOR * 2 + 3 * MINUTE).await;
    assert!(
        trial.count() > before,
        "seed {seed}: nothing comes any more: {:?}",
        trial.last().await
    );
    assert_eq!(trial.broken(), Vec::<String>::new(), "seed {seed}");
    trial.count()
}
