//! The task that follows a camera: its connection, its direction and its motion.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use onvif_link::{LinkError, MotionEvents, OnvifCamera};
use tokio::time::Instant;

use super::{Shared, Target};

/// Pause between two readings of the direction. If a person turns the camera with its app, the
/// driver notices it within this time.
const LOOK_INTERVAL: Duration = Duration::from_secs(3);

/// Number of readings of the direction between two readings of the presets, which take place once a
/// minute.
const LOOKS_PER_READING: usize = 20;

/// Number of failed readings in a row after which the connection counts as lost. Single answers get
/// lost in a wireless network.
const FAILURES_MAX: usize = 2;

/// Pauses before the next attempt to connect: the first, and the longest.
const PAUSE_MIN: Duration = Duration::from_secs(2);
const PAUSE_MAX: Duration = Duration::from_secs(60);

/// Pause after a rejected login. Cameras lock users out after some attempts.
const PAUSE_LOGIN: Duration = Duration::from_secs(120);

/// Pauses before motion events are requested again after a failure: the first, and the longest.
const EVENTS_PAUSE_MIN: Duration = Duration::from_secs(1);
const EVENTS_PAUSE_MAX: Duration = Duration::from_secs(30);

/// Time after a turn for which motion does not count, because the turn has moved the picture.
const TURN_PAUSE: Duration = Duration::from_secs(3);

/// Follows a camera, and connects again after each failure. Never ends.
pub(super) async fn follow(shared: Arc<Shared>) {
    let mut pause = PAUSE_MIN;
    if let Some(risk) = shared.settings.access.risk() {
        tracing::warn!("the camera at {}: {risk}", shared.settings.access);
    }
    loop {
        let began = Instant::now();
        let error = match connected(&shared).await {
            Ok(camera) => stay(&shared, &camera).await,
            Err(error) => error,
        };
        shared.forget().await;
        // A connection that lasted was good.
        if began.elapsed() > PAUSE_MAX {
            pause = PAUSE_MIN;
        }
        let is_rejected = matches!(error, LinkError::LoginRejected { .. });
        lose(&shared, &error);
        tokio::time::sleep(if is_rejected { PAUSE_LOGIN } else { pause }).await;
        pause = (pause * 2).min(PAUSE_MAX);
    }
}

/// Connects to the camera, and reads its presets.
async fn connected(shared: &Shared) -> Result<Arc<OnvifCamera>, LinkError> {
    let camera = shared.camera().await?;
    let identity = camera.identity().await.unwrap_or_default();
    let (abilities, clock_offset) = (camera.abilities(), camera.clock_offset());
    tracing::info!(identity, ?abilities, clock_offset, "connected to a camera");
    let missing = read_presets(shared, &camera).await?;
    let is_useless = missing.len() == shared.settings.targets.len();
    let problem = is_useless.then(|| useless(shared));
    shared.seen.send_modify(|seen| {
        (seen.is_tried, seen.problem, seen.missing) = (true, problem, missing);
    });
    Ok(camera)
}

/// Returns the reason why a camera without any preset of the config cannot be used.
fn useless(shared: &Shared) -> String {
    let wanted = shared.settings.targets.values().filter_map(|target| match target {
        Target::Preset(name) => Some(format!("`{name}`")),
        Target::Position(_) => None,
    });
    let wanted = wanted.collect::<Vec<_>>().join(", ");
    let has: Vec<_> =
        shared.pose().stored.iter().take(9).map(|one| format!("`{}`", one.name)).collect();
    let has = if has.is_empty() { "none".to_owned() } else { has.join(", ") };
    format!("use the camera: none of its presets is {wanted}; it has {has}")
}

/// Reads the presets of the camera. Returns the presets of the config that the camera does not
/// have.
async fn read_presets(
    shared: &Shared,
    camera: &OnvifCamera,
) -> Result<BTreeSet<String>, LinkError> {
    let targets = &shared.settings.targets;
    if targets.values().all(|target| matches!(target, Target::Position(_))) {
        return Ok(BTreeSet::new());
    }
    let stored = match camera.presets().await {
        Ok(stored) => stored,
        // A camera that does not list its presets has none.
        Err(LinkError::Fault { .. }) => Vec::new(),
        Err(error) => return Err(error),
    };
    let is_missing = |target: &Target| match target {
        Target::Preset(_) => target.stored(&stored).is_none(),
        Target::Position(_) => false,
    };
    let missing = targets.iter().filter(|(_, target)| is_missing(target));
    let missing = missing.map(|(name, _)| name.clone()).collect();
    shared.pose().stored = stored;
    Ok(missing)
}

fn lose(shared: &Shared, error: &LinkError) {
    let problem = Some(error.to_string());
    shared.seen.send_modify(|seen| {
        (seen.is_tried, seen.problem) = (true, problem);
        (seen.preset, seen.has_motion) = (None, false);
    });
    shared.pose().arrived_at = None;
}

/// Follows a connected camera. Returns the reason why the connection counts as lost.
async fn stay(shared: &Shared, camera: &Arc<OnvifCamera>) -> LinkError {
    tokio::select! {
        error = look(shared, camera) => error,
        error = hear(shared, camera) => error,
    }
}

/// Reads the direction of the camera every [`LOOK_INTERVAL`]. Returns the error after which the
/// connection counts as lost.
async fn look(shared: &Shared, camera: &OnvifCamera) -> LinkError {
    let (mut failures, mut looks) = (0, 0_usize);
    loop {
        let looked = look_once(shared, camera, looks % LOOKS_PER_READING == LOOKS_PER_READING - 1);
        match looked.await {
            Ok(()) => failures = 0,
            Err(error) => {
                failures = match failures + 1 {
                    FAILURES_MAX.. => return error,
                    failures => failures,
                }
            }
        }
        looks += 1;
        tokio::time::sleep(LOOK_INTERVAL).await;
    }
}

async fn look_once(
    shared: &Shared,
    camera: &OnvifCamera,
    reads_presets: bool,
) -> Result<(), LinkError> {
    if reads_presets {
        let missing = read_presets(shared, camera).await?;
        let is_useless = missing.len() == shared.settings.targets.len();
        let problem = is_useless.then(|| useless(shared));
        shared.seen.send_if_modified(|seen| {
            let is_new = seen.missing != missing || seen.problem != problem;
            (seen.missing, seen.problem) = (missing, problem);
            is_new
        });
    }
    let before = shared.pose().turned_at;
    let position = match camera.status().await {
        Ok(status) => status.position,
        // A camera without this operation does not report its direction.
        Err(LinkError::Fault { .. } | LinkError::Unsupported(_)) => None,
        Err(error) => return Err(error),
    };
    let pose = shared.pose().clone();
    let Some(position) = position.filter(|_| !pose.is_turning && pose.turned_at == before) else {
        return Ok(());
    };
    let is_where_it_was = pose.arrived_at.is_some_and(|at| at.is(&position));
    if is_where_it_was {
        return Ok(());
    }
    let preset = shared.preset_at(position);
    shared.pose().arrived_at = preset.as_ref().map(|_| position);
    shared.seen.send_if_modified(|seen| {
        let is_new = seen.preset != preset;
        seen.preset = preset;
        is_new
    });
    Ok(())
}

/// Follows the motion events of the camera. A failure is logged, and followed by another attempt;
/// the function never returns.
async fn hear(shared: &Shared, camera: &Arc<OnvifCamera>) -> LinkError {
    if !shared.settings.watches_motion {
        return std::future::pending().await;
    }
    let (mut events, mut pause) = (MotionEvents::new(camera), EVENTS_PAUSE_MIN);
    let mut last_problem = None;
    loop {
        match events.next().await {
            Ok(is_motion) => {
                pause = EVENTS_PAUSE_MIN;
                last_problem = None;
                let pose = shared.pose().clone();
                let is_still = !pose.is_turning
                    && pose.turned_at.is_none_or(|ended| ended.elapsed() >= TURN_PAUSE);
                shared.seen.send_if_modified(|seen| {
                    let has_motion = is_motion && is_still;
                    std::mem::replace(&mut seen.has_motion, has_motion) != has_motion
                });
            }
            Err(error) if !camera.has_events() => {
                tracing::warn!("motion is not noticed: failed to {error}");
                return std::future::pending().await;
            }
            Err(error) => {
                shared.seen.send_modify(|seen| seen.has_motion = false);
                let problem = error.to_string();
                if last_problem.as_ref() != Some(&problem) {
                    tracing::warn!("motion is not noticed for a moment: failed to {problem}");
                    last_problem = Some(problem);
                }
                tokio::time::sleep(pause).await;
                pause = (pause * 2).min(EVENTS_PAUSE_MAX);
            }
        }
    }
}
