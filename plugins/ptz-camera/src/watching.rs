//! The events of a camera: it looks in another direction than is known, or something moves in its picture.
//!
//! There is motion if a large enough share of the picture has changed between two frames of the same
//! direction. The motion is in the place of the current preset; without a preset it is ignored.

use std::sync::Arc;
use std::time::Duration;

use actuator::{Initiative, Stir};
use tokio::time::Instant;

use crate::frame::Frame;
use crate::{Aim, Camera, PtzCamera};

/// Pause between two looks: a person walking by is in the picture for at least a second.
const LOOKING: Duration = Duration::from_millis(200);

/// Pause between two looks of a camera that does not watch for motion, or does not answer.
const RARELY: Duration = Duration::from_secs(5);

/// Waits for the next event of a camera.
pub(crate) fn watch(of: &PtzCamera) -> impl Future<Output = Stir<PtzCamera>> + Send + use<> {
    let eye = Eye {
        camera: Arc::clone(&of.camera),
        aim: of.aim,
        sensitivity: of.settings.motion.as_ref().map(|motion| motion.sensitivity),
        quiet_until: quiet_until(of),
        before: of.seen.clone(),
    };
    eye.next()
}

/// Returns the time until which motion in the current place is not announced again: continuing motion is
/// announced after a third of its validity, not at every look.
fn quiet_until(of: &PtzCamera) -> Instant {
    let lasts = of.settings.motion.as_ref().map_or(Duration::ZERO, |motion| motion.lasts);
    let (now, place) = (Instant::now(), of.preset().map(|(_, place)| place));
    let last = place.and_then(|place| of.motion.get(place));
    last.map_or(now, |last| *last + lasts / 3)
}

struct Eye {
    camera: Arc<dyn Camera>,
    aim: Option<Aim>,
    sensitivity: Option<f64>,
    quiet_until: Instant,
    before: Option<Frame>,
}

impl Eye {
    async fn next(mut self) -> Stir<PtzCamera> {
        loop {
            // A camera that does not answer is noticed when a method is called.
            let Ok(frame) = self.camera.frame().await else {
                tokio::time::sleep(RARELY).await;
                continue;
            };
            if self.aim.is_none_or(|aim| !aim.is(&frame.aim)) {
                return looked(frame);
            }
            let change = self.before.as_ref().map_or(0.0, |before| frame.change_since(before));
            let moved = self.sensitivity.is_some_and(|sensitivity| change >= sensitivity);
            if moved && Instant::now() >= self.quiet_until {
                return moved_at(frame);
            }
            self.before = Some(frame);
            tokio::time::sleep(if self.sensitivity.is_some() { LOOKING } else { RARELY }).await;
        }
    }
}

/// Updates the direction, if the camera looks elsewhere than is known: at the start, after a failure, or
/// when it was turned by other means.
fn looked(frame: Frame) -> Stir<PtzCamera> {
    Box::new(move |camera: &mut PtzCamera| {
        camera.aim = Some(frame.aim);
        camera.seen = Some(frame);
        Vec::new()
    })
}

fn moved_at(frame: Frame) -> Stir<PtzCamera> {
    Box::new(move |camera: &mut PtzCamera| {
        camera.aim = Some(frame.aim);
        camera.seen = Some(frame);
        let Some((_, place)) = camera.preset() else { return Vec::new() };
        let place = place.to_owned();
        let goal = camera.settings.motion.as_ref().and_then(|motion| motion.goal(&place));
        camera.motion.insert(place.clone(), Instant::now());
        // The goal is not repeated if it fails: the moving person has left by then.
        let (name, insists) = (format!("motion-{place}"), false);
        let want = |goal| Initiative::Want { name, goal, insists };
        goal.map(want).into_iter().collect()
    })
}
