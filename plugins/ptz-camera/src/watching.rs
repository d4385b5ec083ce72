//! What a camera does by itself: it looks, and says where it looks and what moves there.
//!
//! Motion is a share of the picture that has changed between two looks in the same direction. It
//! is believed of the place that the preset shows; beside any preset it is nobody's.

use std::sync::Arc;
use std::time::Duration;

use actuator::{Initiative, Stir};
use tokio::time::Instant;

use crate::frame::Frame;
use crate::{Aim, Camera, PtzCamera};

/// Between two looks: who walks by is in the picture for a second at least.
const LOOKING: Duration = Duration::from_millis(200);

/// Between two looks of a camera that does not watch for motion, or does not answer.
const RARELY: Duration = Duration::from_secs(5);

/// The next thing that a camera has to say by itself.
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

/// Motion that goes on is said again when a third of its time is over, and not at every look.
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
            // One that does not answer is noticed when it is asked to do something.
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

/// It looks somewhere else than it believed: at first, after a failure, by another hand.
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
        // Who moves there is gone when it fails.
        let (name, insists) = (format!("motion-{place}"), false);
        let want = |goal| Initiative::Want { name, goal, insists };
        goal.map(want).into_iter().collect()
    })
}
