//! Figure 1 of the paper: a screen is plugged in for the first time in a meeting room, presents a
//! text, and fails during a meeting. Then the video-collaboration robot takes over.
//!
//! Seed 0 is the paper's office with its conference room. Every other seed draws another building.

use serde::Serialize;

use crate::building::Building;
use crate::draw::{LayoutDraw, paper_places};
use crate::error::LayoutError;
use crate::layout::{BuildingDevice, Layout};
use crate::replay::replay;
use crate::truth::{BuildingEvent, Truth};

/// Name of the video-collaboration robot.
const ROBOT: &str = "robot-1";
/// Name of the screen on the robot.
const ROBOTS_SCREEN: &str = "robot-1-screen";
/// Name of the screen on the wall, which fails.
const SCREEN: &str = "screen-1";

/// Test whether an event is one particular act of the meeting.
type EventTest<'a> = &'a dyn Fn(&BuildingEvent) -> bool;

/// A building and a meeting in it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeetingScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building, with all devices that are in it at any time.
    pub layout: Layout,
    /// Name of the room of the meeting.
    pub room: String,
    /// The text to be presented in the meeting.
    pub text: String,
}

impl MeetingScenario {
    /// Returns the scenario of this seed, which is the same on every machine.
    pub fn seeded(seed: u64) -> MeetingScenario {
        let drawn = if seed == 0 { paper_office() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the name of the screen that is plugged in, and fails later.
    pub fn screen(&self) -> &'static str {
        SCREEN
    }

    /// Returns the name of the robot that takes over.
    pub fn robot(&self) -> &'static str {
        ROBOT
    }

    /// Returns the layout at the start: without the screen that is plugged in later.
    pub fn initial_layout(&self) -> Layout {
        let mut layout = self.layout.clone();
        layout.remove_device(SCREEN);
        layout
    }

    /// Adds the screen to the building.
    ///
    /// # Errors
    ///
    /// Returns an error if the screen was added before.
    pub fn plug_in(&self, building: &Building) -> Result<(), LayoutError> {
        let (name, location) = (SCREEN.to_owned(), self.room.clone());
        building.add_device(BuildingDevice::Screen { name, location })
    }

    /// Checks the scenario against the truth.
    ///
    /// The following must hold, in this order:
    /// 1. The screen was added, got a channel, and showed the text.
    /// 2. The screen failed. Until then the robot showed nothing, because the screen is cheaper.
    /// 3. The robot came to the room, and shows the text there at this moment.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth) -> Result<(), Vec<String>> {
        let mut problems = replay(&self.layout, truth).problems;
        let MeetingScenario { room, text, .. } = self;
        let shows = |event: &BuildingEvent, by: &str| matches!(event, BuildingEvent::Shown { screen, text: shown } if screen == by && shown == text);
        let is_added = |event: &BuildingEvent| matches!(event, BuildingEvent::Added { device } if device == SCREEN);
        let is_set_up = |event: &BuildingEvent| matches!(event, BuildingEvent::Allocated { screen, .. } if screen == SCREEN);
        let is_broken = |event: &BuildingEvent| matches!(event, BuildingEvent::Broken { device, .. } if device == SCREEN);
        let is_there = |event: &BuildingEvent| matches!(event, BuildingEvent::Moved { robot, to, .. } if robot == ROBOT && to == room);
        let mut from = 0;
        let mut broken = u64::MAX;
        let acts: [(&str, EventTest<'_>); 6] = [
            ("the screen was plugged in", &is_added),
            ("it was given a channel", &is_set_up),
            ("it showed the text", &|event| shows(event, SCREEN)),
            ("it failed", &is_broken),
            ("the robot came to the room", &is_there),
            ("the robot showed the text", &|event| shows(event, ROBOTS_SCREEN)),
        ];
        for (act, happened) in acts {
            let found = { truth.occurrences() }
                .find(|occurrence| occurrence.sequence >= from && happened(&occurrence.event));
            let Some(found) = found else {
                problems.push(format!("this did not happen, or not in its turn: {act}"));
                break;
            };
            from = found.sequence + 1;
            if is_broken(&found.event) {
                broken = found.sequence;
            }
        }
        let in_vain = truth.occurrences().any(|occurrence| {
            occurrence.sequence < broken && shows(&occurrence.event, ROBOTS_SCREEN)
        });
        if in_vain {
            problems.push("the robot showed the text while the screen still showed it".to_owned());
        }
        if !truth.presented_in(room).any(|shown| shown == text) {
            problems.push(format!("no screen in `{room}` shows the text now"));
        }
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }
}

// === Drawing ===

fn paper_office() -> Result<MeetingScenario, LayoutError> {
    finish(0, paper_places()?, "conf-room", "corridor", 0.3)
}

fn draw(seed: u64) -> Result<MeetingScenario, LayoutError> {
    let mut draw = LayoutDraw::new(seed);
    let layout = draw.places()?;
    let room = draw.rooms[0];
    let starts: Vec<_> = draw.rooms[1..].iter().chain(&draw.corridors).copied().collect();
    let start = starts[draw.random.below(starts.len())];
    let speed = draw.random.between(2, 10) as f64 / 10.0;
    finish(seed, layout, room, start, speed)
}

fn finish(
    seed: u64,
    mut layout: Layout,
    room: &str,
    start: &str,
    speed: f64,
) -> Result<MeetingScenario, LayoutError> {
    layout.add_robot(ROBOT, start, speed)?;
    layout.mount_screen(ROBOTS_SCREEN, ROBOT)?;
    layout.add_screen(SCREEN, room)?;
    let text = format!("Figures of quarter {}", 1 + seed % 4);
    Ok(MeetingScenario { seed, layout, room: room.to_owned(), text })
}

#[cfg(test)]
mod tests {
    use super::{MeetingScenario, ROBOT, ROBOTS_SCREEN, SCREEN};
    use crate::{Building, DeviceFault};

    /// Plays all acts of the meeting except the one with the number `left_out`; 0 plays all acts.
    async fn problems(left_out: usize) -> Vec<String> {
        let meeting = MeetingScenario::seeded(0);
        let building = Building::new(meeting.initial_layout(), 1.0).unwrap();
        let text = Some(meeting.text.as_str());
        meeting.plug_in(&building).unwrap();
        if left_out != 1 {
            building.allocate(SCREEN).unwrap();
            building.show(SCREEN, text.filter(|_| left_out != 2)).await.unwrap();
        }
        if left_out != 3 {
            building.break_device(SCREEN, DeviceFault::Fails).unwrap();
        }
        if left_out != 4 {
            building.navigate(ROBOT, "conf-room").await.unwrap();
        }
        building.show(ROBOTS_SCREEN, text.filter(|_| left_out != 5)).await.unwrap();
        if left_out == 6 {
            building.show(ROBOTS_SCREEN, None).await.unwrap();
        }
        meeting.check(&building.truth()).err().unwrap_or_default()
    }

    #[tokio::test(start_paused = true)]
    async fn leaving_out_any_act_fails_the_check() {
        assert_eq!(problems(0).await, [""; 0]);
        for (left_out, word) in [
            (1, "given a channel"),
            (2, "it showed the text"),
            (3, "it failed"),
            (4, "came to the room"),
            (5, "the robot showed the text"),
            (6, "shows the text now"),
        ] {
            let problems = problems(left_out).await;
            assert!(problems.iter().any(|text| text.contains(word)), "{left_out}: {problems:?}");
        }
    }
}
