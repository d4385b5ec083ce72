//! Turns a camera, and finds out when it has arrived.

use std::sync::Arc;
use std::time::Duration;

use onvif_link::{LinkError, OnvifCamera, Position, PtzStatus, StopOnDrop};
use tokio::time::Instant;

use super::{Shared, Target};
use crate::driver::{Step, View};

/// Pause between two readings of the position of a turning camera.
const POSITION_INTERVAL: Duration = Duration::from_millis(300);

/// Time limit for arriving. A whole turn of a slow camera takes 20 seconds.
const ARRIVAL_TIME_MAX: Duration = Duration::from_secs(25);

/// Duration of a step of a camera that cannot turn to a position, and turns until it is stopped.
const STEP_TIME: Duration = Duration::from_millis(400);

/// Speed of such a step: half of the maximum.
const STEP_SPEED: f64 = 0.5;

/// Length of a step of a camera that turns to positions, in ONVIF's generic units: 10 degrees of
/// 340.
const STEP_POSITION: f64 = 0.06;

/// Difference between the requested and the reached position beyond which turning has failed.
const ELSEWHERE: f64 = 0.05;

/// Number of failed readings of the position in a row after which turning has failed.
const FAILURES_MAX: usize = 3;

/// A mark that the camera is turning. The mark ends when this value is dropped.
struct Turning(Arc<Shared>);

impl Turning {
    fn begin(shared: &Arc<Shared>) -> Turning {
        let mut pose = shared.pose();
        (pose.is_turning, pose.arrived_at) = (true, None);
        drop(pose);
        shared.seen.send_modify(|seen| (seen.preset, seen.has_motion) = (None, false));
        Turning(Arc::clone(shared))
    }
}

impl Drop for Turning {
    fn drop(&mut self) {
        let mut pose = self.0.pose();
        (pose.is_turning, pose.turned_at) = (false, Some(Instant::now()));
    }
}

/// Turns to a preset of the config, and waits until the camera has arrived.
pub(super) async fn look_at(shared: &Arc<Shared>, name: String) -> Result<View, LinkError> {
    let Some(target) = shared.settings.targets.get(&name) else {
        return Err(LinkError::Unsupported(format!("find the preset `{name}`")));
    };
    let camera = shared.camera().await?;
    let turning = Turning::begin(shared);
    let stop = StopOnDrop::new(&camera);
    let expected = begin(shared, &camera, target).await?;
    let arrived_at = arrive(shared, &camera, expected).await?;
    stop.disarm();
    if let (Target::Position(wanted), Some(reached)) = (target, arrived_at) {
        let far = (wanted.pan - reached.pan).abs().max((wanted.tilt - reached.tilt).abs());
        if far > ELSEWHERE {
            return Err(LinkError::Unsupported(format!(
                "turn to `{name}`: the camera stands still elsewhere, at pan {:.2}, tilt {:.2}",
                reached.pan, reached.tilt
            )));
        }
    }
    shared.pose().arrived_at = arrived_at;
    shared.seen.send_modify(|seen| seen.preset = Some(name.clone()));
    drop(turning);
    let detail = match arrived_at {
        Some(Position { pan, tilt, zoom }) => {
            format!("looks at `{name}`: pan {pan:.2}, tilt {tilt:.2}, zoom {zoom:.2}")
        }
        None => format!("looks at `{name}`; the camera does not say its position"),
    };
    Ok(View { preset: Some(name), detail })
}

/// Sends the command to turn. Returns the position at which the camera should arrive, if it is
/// known.
async fn begin(
    shared: &Shared,
    camera: &OnvifCamera,
    target: &Target,
) -> Result<Option<Position>, LinkError> {
    let abilities = camera.abilities();
    match target {
        Target::Preset(wanted) => {
            // The presets are read each time, because people change them with the camera's app.
            let stored = camera.presets().await?;
            let found = target.stored(&stored).cloned();
            let names: Vec<_> =
                stored.iter().take(9).map(|one| format!("`{}`", one.name)).collect();
            shared.pose().stored = stored;
            let Some(found) = found else {
                return Err(LinkError::Unsupported(format!(
                    "find the preset `{wanted}` in the camera: it has {}; store it with the \
                     camera's app, or correct `preset`",
                    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
                )));
            };
            match (camera.go_to_preset(&found.token).await, found.position) {
                (Err(LinkError::Fault { .. } | LinkError::Unsupported(_)), Some(position))
                    if abilities.has_absolute =>
                {
                    camera.go_to(position).await?;
                }
                (turned, _) => turned?,
            }
            Ok(found.position)
        }
        Target::Position(_) if !abilities.has_absolute => Err(LinkError::Unsupported(
            "turn to a position: the camera turns to presets only; store one in the camera, and \
             write preset = \"NAME\""
                .to_owned(),
        )),
        Target::Position(position) => {
            camera.go_to(*position).await?;
            Ok(Some(*position))
        }
    }
}

/// Readings of a camera on its way to a target.
#[derive(Debug, Default)]
struct Way {
    last: Option<Position>,
    /// Number of readings in a row with the same position.
    same_count: usize,
    has_moved: bool,
}

impl Way {
    /// Records a reading. Returns whether the camera has arrived.
    ///
    /// The report of a camera that it stands still counts only if the camera has reported before
    /// that it moves: some cameras always report “idle”. A position that stays the same counts if
    /// it is the expected one. Otherwise the camera has arrived after the time `settle`.
    fn note(&mut self, seen: PtzStatus, expected: Option<Position>, is_settled: bool) -> bool {
        let PtzStatus { position, is_moving } = seen;
        let is_same = match (position, self.last) {
            (Some(now), Some(before)) => now.is(&before),
            (None, _) => true,
            (Some(_), None) => false,
        };
        self.same_count = if is_same { self.same_count + 1 } else { 0 };
        self.has_moved |= is_moving == Some(true);
        self.last = position;
        let is_there = match (expected, position) {
            (Some(expected), Some(now)) => expected.is(&now),
            _ => false,
        };
        if self.same_count == 0 {
            return false;
        }
        match is_moving {
            // A camera that always reports “moving” stands still if its position does not change.
            Some(true) => is_settled && position.is_some() && self.same_count > 3,
            Some(false) if self.has_moved => true,
            _ => is_there || is_settled,
        }
    }
}

/// Waits until the camera has arrived. Returns its position; `None` if the camera does not report
/// it.
async fn arrive(
    shared: &Shared,
    camera: &OnvifCamera,
    expected: Option<Position>,
) -> Result<Option<Position>, LinkError> {
    let (began, mut way, mut failures) = (Instant::now(), Way::default(), 0);
    while began.elapsed() < ARRIVAL_TIME_MAX {
        tokio::time::sleep(POSITION_INTERVAL).await;
        let seen = match camera.status().await {
            Ok(seen) => seen,
            // A camera without this operation reports nothing.
            Err(LinkError::Fault { .. } | LinkError::Unsupported(_)) => PtzStatus::default(),
            Err(error) => {
                failures += 1;
                if failures >= FAILURES_MAX {
                    return Err(error);
                }
                continue;
            }
        };
        failures = 0;
        if way.note(seen, expected, began.elapsed() >= shared.settings.settle) {
            return Ok(seen.position);
        }
    }
    Err(LinkError::Unsupported(format!(
        "arrive within {ARRIVAL_TIME_MAX:?}: the camera still moves"
    )))
}

/// Turns the camera by a step: to a position next to the present one, or, if the camera cannot turn
/// to a position, for the time [`STEP_TIME`].
pub(super) async fn move_by(shared: &Arc<Shared>, step: Step) -> Result<View, LinkError> {
    let camera = shared.camera().await?;
    let turning = Turning::begin(shared);
    let abilities = camera.abilities();
    let stop = StopOnDrop::new(&camera);
    let sign = |value: f64| if value == 0.0 { 0.0 } else { value.signum() };
    let way = Position { pan: sign(step.pan), tilt: sign(step.tilt), zoom: sign(step.zoom - 1.0) };
    let now = if abilities.has_absolute { camera.status().await?.position } else { None };
    match now {
        Some(now) => {
            let next =
                |now: f64, way: f64, least: f64| (now + way * STEP_POSITION).clamp(least, 1.0);
            let to = Position {
                pan: next(now.pan, way.pan, -1.0),
                tilt: next(now.tilt, way.tilt, -1.0),
                zoom: next(now.zoom, way.zoom, 0.0),
            };
            camera.go_to(to).await?;
            arrive(shared, &camera, Some(to)).await?;
        }
        None if abilities.has_continuous => {
            let Position { pan, tilt, zoom } = way;
            let speed = Position {
                pan: pan * STEP_SPEED,
                tilt: tilt * STEP_SPEED,
                zoom: zoom * STEP_SPEED,
            };
            camera.drive(speed).await?;
            tokio::time::sleep(STEP_TIME).await;
            // The time limit of a movement is ignored by some cameras.
            camera.stop().await?;
        }
        None => {
            let problem = "turn by a step: the camera turns to presets only";
            return Err(LinkError::Unsupported(problem.to_owned()));
        }
    }
    stop.disarm();
    drop(turning);
    Ok(View { preset: None, detail: "turned by a step".to_owned() })
}

/// Returns an error if the camera does not look at a preset of the config.
pub(super) async fn check_view(shared: &Arc<Shared>, name: &str) -> Result<(), String> {
    let elsewhere = || format!("see `{name}`: the camera looks elsewhere");
    if shared.seen.borrow().preset.as_deref() != Some(name) {
        return Err(elsewhere());
    }
    let Some(arrived_at) = shared.pose().arrived_at else { return Ok(()) };
    let camera = shared.camera().await.map_err(super::text)?;
    let now = camera.status().await.map_err(super::text)?.position;
    match now {
        Some(now) if !arrived_at.is(&now) => Err(elsewhere()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HALL: Position = Position { pan: 0.5, tilt: 0.1, zoom: 0.0 };
    const DOOR: Position = Position { pan: -0.5, tilt: 0.1, zoom: 0.0 };

    fn says(position: Option<Position>, is_moving: Option<bool>) -> PtzStatus {
        PtzStatus { position, is_moving }
    }

    /// Returns the number of looks after which the camera has arrived; it settles at the sixth.
    fn looks(expected: Option<Position>, seen: &[PtzStatus]) -> Option<usize> {
        let mut way = Way::default();
        (0..20).find(|number| {
            let seen = seen.get(*number).or(seen.last()).copied().unwrap_or_default();
            way.note(seen, expected, *number >= 6)
        })
    }

    #[test]
    fn an_honest_camera_has_arrived_when_it_says_so() {
        let seen = [
            says(Some(HALL), Some(true)),
            says(Some(DOOR), Some(true)),
            says(Some(DOOR), Some(false)),
        ];
        assert_eq!(looks(Some(DOOR), &seen), Some(2));
    }

    #[test]
    fn a_camera_that_always_says_idle_has_arrived_at_the_expected_position() {
        let seen = [HALL, HALL, HALL, DOOR, DOOR].map(|at| says(Some(at), Some(false)));
        assert_eq!(looks(Some(DOOR), &seen), Some(4));
        assert_eq!(looks(None, &seen), Some(6), "without an expectation it settles");
    }

    #[test]
    fn a_camera_that_always_says_moving_has_arrived_when_its_position_stays() {
        assert_eq!(looks(Some(DOOR), &[says(Some(DOOR), Some(true))]), Some(6));
        assert_eq!(looks(None, &[says(None, Some(true))]), None, "it may move on");
    }

    #[test]
    fn a_camera_that_says_nothing_has_arrived_after_the_time_to_settle() {
        assert_eq!(looks(None, &[says(None, None)]), Some(6));
        assert_eq!(looks(Some(DOOR), &[says(None, Some(false))]), Some(6));
    }
}
