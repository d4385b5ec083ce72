//! The events of a camera: its direction differs from the known one, or there is motion in its
//! picture.
//!
//! Motion is a change of a large enough share of the picture between two frames of the same
//! direction. The place of the motion is that of the present preset; motion in a direction without
//! a preset is ignored.

use std::sync::Arc;
use std::time::Duration;

use actuator::{DeviceEvent, Initiative};
use tokio::time::Instant;

use crate::frame::Frame;
use crate::{Camera, PtzCamera, PtzPosition};

/// Pause between two frames. It is short, because a person walking by is in the picture for only
/// about a second.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);

/// Pause between two frames of a camera that does not detect motion, or does not respond.
const LOOK_INTERVAL_IDLE: Duration = Duration::from_secs(5);

/// Waits for the next event of a camera.
pub(crate) fn watch(of: &PtzCamera) -> impl Future<Output = DeviceEvent<PtzCamera>> + Send + use<> {
    let eye = CameraWatch {
        camera: Arc::clone(&of.camera),
        aim: of.aim,
        sensitivity: of.settings.motion.as_ref().map(|motion| motion.sensitivity),
        quiet_until: quiet_until(of),
        previous_frame: of.last_frame.clone(),
    };
    eye.next()
}

/// Returns the time until which motion in the present place is not announced again. Continuing
/// motion is announced again after a third of the time for which the fact is valid, and not for
/// every frame.
fn quiet_until(of: &PtzCamera) -> Instant {
    let lasts = of.settings.motion.as_ref().map_or(Duration::ZERO, |motion| motion.lasts);
    let (now, place) = (Instant::now(), of.preset().map(|(_, place)| place));
    let last = place.and_then(|place| of.motion.get(place));
    last.map_or(now, |last| *last + lasts / 3)
}

struct CameraWatch {
    camera: Arc<dyn Camera>,
    aim: Option<PtzPosition>,
    sensitivity: Option<f64>,
    quiet_until: Instant,
    previous_frame: Option<Frame>,
}

impl CameraWatch {
    async fn next(mut self) -> DeviceEvent<PtzCamera> {
        loop {
            // A camera that does not respond is detected at the next call of a method.
            let Ok(frame) = self.camera.frame().await else {
                tokio::time::sleep(LOOK_INTERVAL_IDLE).await;
                continue;
            };
            if self.aim.is_none_or(|aim| !aim.is(&frame.aim)) {
                return aim_event(frame);
            }
            let change =
                self.previous_frame.as_ref().map_or(0.0, |before| frame.change_since(before));
            let moved = self.sensitivity.is_some_and(|sensitivity| change >= sensitivity);
            if moved && Instant::now() >= self.quiet_until {
                return motion_event(frame);
            }
            self.previous_frame = Some(frame);
            tokio::time::sleep(if self.sensitivity.is_some() {
                LOOK_INTERVAL
            } else {
                LOOK_INTERVAL_IDLE
            })
            .await;
        }
    }
}

/// Returns the event that sets the known direction to that of `frame`. The event occurs at the
/// start, after a failure, and after the camera was turned by other means.
fn aim_event(frame: Frame) -> DeviceEvent<PtzCamera> {
    Box::new(move |camera: &mut PtzCamera| {
        camera.aim = Some(frame.aim);
        camera.last_frame = Some(frame);
        Vec::new()
    })
}

fn motion_event(frame: Frame) -> DeviceEvent<PtzCamera> {
    Box::new(move |camera: &mut PtzCamera| {
        camera.aim = Some(frame.aim);
        camera.last_frame = Some(frame);
        let Some((_, place)) = camera.preset() else { return Vec::new() };
        let place = place.to_owned();
        let goal = camera.settings.motion.as_ref().and_then(|motion| motion.goal(&place));
        camera.motion.insert(place.clone(), Instant::now());
        // The goal is not requested again if it fails, because the moving person has left by then.
        let (name, insists) = (format!("motion-{place}"), false);
        let want = |goal| Initiative::RequestGoal { name, goal, insists };
        goal.map(want).into_iter().collect()
    })
}
