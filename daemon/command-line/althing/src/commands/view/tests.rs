//! Each scenario of the paper is recorded and watched to its end: every page is drawn at many
//! moments, and the goals end as the building's own truth says.

use std::sync::{Arc, Mutex};

use acl::EcosystemId;
use agent::Mode;
use bytes::Bytes;
use live_view::{GoalStage, Moment, ViewLimits};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use terminal_view::{PageAt, PageName, ScreenOptions, ViewScreen};
use tokio::time::Instant;

use super::playback::Playback;
use crate::commands::watch::record::{Header, Recorded, Recording};
use crate::scenario::{Scenario, ScenarioOptions, ScenarioSubstrate, ScenarioTap, play};

/// Number of moments at which the pages are drawn.
const MOMENTS: u64 = 8;

/// Plays a scenario whose outcome is as the building's own truth must be, and records it.
async fn recorded(scenario: Scenario, mode: Mode) -> Recording {
    let heard = Arc::<Mutex<Vec<(u64, Bytes)>>>::default();
    let (queue, began) = (Arc::clone(&heard), Instant::now());
    let mut options = ScenarioOptions::new(scenario, 0, mode, ScenarioSubstrate::Memory);
    options.listener = Some(ScenarioTap::new(move |_, payload| {
        let at_ms = u64::try_from(began.elapsed().as_millis()).expect("soon");
        queue.lock().expect("no panic").push((at_ms, payload));
    }));
    let played = play(&options, |_| ()).await.expect("a stage");
    assert!(played.problems.is_empty(), "{scenario:?}: {:#?}", played.problems);
    let heard = std::mem::take(&mut *heard.lock().expect("no panic"));
    let recorded = |(at_ms, payload): (u64, Bytes)| Recorded {
        at_ms,
        key: String::new(),
        message: live_view::redact(&acl::decode(&payload).expect("a message")),
    };
    let ecosystem = EcosystemId::new("scenario").expect("a name");
    let header = Header { recording: 1, ecosystem, began_ms: Some(1_000_000) };
    Recording { header, messages: heard.into_iter().map(recorded).collect(), unread: 0 }
}

/// Draws every page at many moments, in terminals of two sizes.
fn draw_all(playback: &mut Playback) {
    for (columns, rows) in [(80, 24), (40, 15)] {
        let mut terminal = Terminal::new(TestBackend::new(columns, rows)).expect("a size");
        let recording = Some(playback.span());
        let mut screen = ViewScreen::new(ScreenOptions { recording, ..ScreenOptions::default() });
        let (start, length) = (playback.start(), playback.end().since(playback.start()));
        for part in 0..=MOMENTS {
            playback.seek(start.plus(length * part / MOMENTS));
            for page in PageName::all() {
                screen.open(PageAt::of(page));
                let (view, now) = (playback.view(), playback.now());
                terminal.draw(|frame| screen.draw(frame, view, now)).expect("drawn");
                let shown = terminal.backend().to_string();
                assert!(shown.contains("? help"), "{page} at {now:?}: {shown}");
            }
        }
    }
}

async fn check(scenario: Scenario, goals: usize, stages: &[GoalStage]) {
    for mode in [Mode::Centralized, Mode::Decentralized] {
        let recording = recorded(scenario, mode).await;
        assert!(recording.messages.len() > 50, "{scenario:?}: {}", recording.messages.len());
        let mut playback = Playback::new(recording, ViewLimits::default());
        draw_all(&mut playback);
        assert_eq!(playback.now(), playback.end());
        let rows = playback.view().goals(Moment(playback.now().0));
        assert!(rows.len() >= goals, "{scenario:?} {mode:?}: {rows:#?}");
        let is_expected = |stage: GoalStage| stages.contains(&stage);
        assert!(rows.iter().all(|row| is_expected(row.stage)), "{scenario:?} {mode:?}: {rows:#?}");
    }
}

#[tokio::test(start_paused = true)]
async fn scenario_1_is_watched_to_its_end() {
    check(Scenario::Temperatures, 1, &[GoalStage::Holding]).await;
}

/// The scenario ends when the building is as it must be; the user is told that a moment later. The
/// kept goal has not ended.
#[tokio::test(start_paused = true)]
async fn scenario_2_is_watched_to_its_end() {
    let goes_on = [GoalStage::Holding, GoalStage::Running, GoalStage::Planning, GoalStage::Waiting];
    check(Scenario::Maintenance, 1, &goes_on).await;
}

/// Some visitors give no right answer, so that the goal about them fails.
#[tokio::test(start_paused = true)]
async fn scenario_3_is_watched_to_its_end() {
    check(Scenario::Access, 4, &[GoalStage::Done, GoalStage::Failed]).await;
}

#[tokio::test(start_paused = true)]
async fn scenario_4_is_watched_to_its_end() {
    check(Scenario::Meeting, 2, &[GoalStage::Done, GoalStage::Holding]).await;
}
