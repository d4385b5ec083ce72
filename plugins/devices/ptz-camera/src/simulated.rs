//! The simulated driver, which turns a camera in the simulated building, and draws the places that
//! the camera sees.
//!
//! A place is drawn as a patch of floor in a color of its own, a person as a figure, a robot as a
//! box. Moving things change their position with the building's time.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::{BuildingHandle, CameraView, SeenPlace};

use crate::frame::Frame;
use crate::frame_camera::FrameSource;
use crate::position::PtzPosition;

/// Width and height of a picture, in pixels. The picture is small, so that drawing five pictures a
/// second costs little.
const WIDTH: usize = 160;
const HEIGHT: usize = 120;

const WALL: [u8; 3] = [205, 205, 200];
const ROBOT: [u8; 3] = [40, 40, 48];
const CURTAIN: [u8; 3] = [150, 30, 60];

#[derive(Clone)]
struct Simulated {
    building: Arc<BuildingHandle>,
    camera: String,
}

pub(crate) fn source(blueprint: &Blueprint) -> Result<Arc<dyn FrameSource>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, camera: blueprint.id.to_string() }))
}

impl FrameSource for Simulated {
    fn aim(&self, aim: PtzPosition) -> BoxFuture<Result<(), String>> {
        let Simulated { building, camera } = self.clone();
        let PtzPosition { pan, tilt, zoom } = aim;
        let aim = building::CameraAim { pan, tilt, zoom };
        Box::pin(async move { building.aim(&camera, aim).await.map_err(|error| error.to_string()) })
    }

    fn frame(&self) -> BoxFuture<Result<Frame, String>> {
        let Simulated { building, camera } = self.clone();
        Box::pin(async move {
            let sight = building.look(&camera).await.map_err(|error| error.to_string())?;
            Ok(draw(&sight))
        })
    }
}

/// The pixels of a picture while it is drawn.
struct Canvas {
    rgb: Vec<u8>,
}

impl Canvas {
    /// Fills the part of a box that is within the picture. `(x, y)` is the center of the box.
    fn fill(&mut self, (x, y): (f64, f64), (width, height): (f64, f64), color: [u8; 3]) {
        let range = |middle: f64, size: f64, end: usize| {
            let start = (middle - size / 2.0).clamp(0.0, end as f64) as usize;
            start..(middle + size / 2.0).clamp(0.0, end as f64) as usize
        };
        for row in range(y, height, HEIGHT) {
            for column in range(x, width, WIDTH) {
                let start = (row * WIDTH + column) * 3;
                if let Some(pixel) = self.rgb.get_mut(start..start + 3) {
                    pixel.copy_from_slice(&color);
                }
            }
        }
    }
}

fn draw(sight: &CameraView) -> Frame {
    let building::CameraAim { pan, tilt, zoom } = sight.aim;
    let mut canvas = Canvas { rgb: WALL.repeat(WIDTH * HEIGHT) };
    for place in &sight.places {
        draw_place(&mut canvas, place, zoom, sight.at.as_millis());
    }
    let places: Vec<_> = sight.places.iter().map(caption).collect();
    let caption = if places.is_empty() { "nothing known".to_owned() } else { places.join("; ") };
    let aim = PtzPosition { pan, tilt, zoom };
    Frame { width: WIDTH, height: HEIGHT, rgb: canvas.rgb, aim, caption }
}

fn draw_place(canvas: &mut Canvas, place: &SeenPlace, zoom: f64, milliseconds: u128) {
    let middle_x = (1.0 + place.right) / 2.0 * WIDTH as f64;
    let middle_y = (1.0 - place.up) / 2.0 * HEIGHT as f64;
    let size = zoom.sqrt();
    let floor = middle_y + 26.0 * size;
    canvas.fill((middle_x, floor), (110.0 * size, 24.0 * size), color_of(&place.location));
    for (index, robot) in place.robots.iter().enumerate() {
        let x = middle_x + (30.0 + 14.0 * index as f64) * size;
        canvas.fill((x, floor - 8.0 * size), (12.0 * size, 16.0 * size), ROBOT);
        canvas.fill((x, floor - 12.0 * size), (6.0 * size, 3.0 * size), color_of(robot));
    }
    for (index, person) in place.people.iter().enumerate() {
        let x = middle_x + (-24.0 + 16.0 * index as f64) * size;
        canvas.fill((x, floor - 16.0 * size), (9.0 * size, 30.0 * size), color_of(person));
        canvas.fill((x, floor - 35.0 * size), (8.0 * size, 8.0 * size), [150, 110, 85]);
    }
    if place.stirs {
        let sway = (milliseconds / 100 % 10) as f64 - 5.0;
        let at = (middle_x + 4.0 * sway * size, middle_y - 20.0 * size);
        canvas.fill(at, (16.0 * size, 24.0 * size), CURTAIN);
    }
}

fn caption(place: &SeenPlace) -> String {
    let all: Vec<_> = place.people.iter().chain(&place.robots).map(String::as_str).collect();
    let who = if all.is_empty() { "nobody".to_owned() } else { all.join(", ") };
    format!("{}: {who}", place.location)
}

/// Returns the color of a name. It is always the same, and darker than the wall.
fn color_of(name: &str) -> [u8; 3] {
    let mut hasher = DefaultHasher::new();
    name.hash(&mut hasher);
    let [red, green, blue, ..] = hasher.finish().to_le_bytes();
    [red, green, blue].map(|part| 30 + part / 2)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use building::{CameraAim, CameraView, SeenPlace};

    use super::draw;

    fn sight(people: &[&str], stirs: bool, at: u64) -> CameraView {
        let place = SeenPlace {
            location: "corridor".to_owned(),
            right: 0.0,
            up: 0.0,
            people: people.iter().map(|name| (*name).to_owned()).collect(),
            robots: vec!["turtlebot-1".to_owned()],
            stirs,
        };
        CameraView { aim: CameraAim::default(), places: vec![place], at: Duration::from_millis(at) }
    }

    #[test]
    fn a_person_and_a_moving_curtain_change_the_picture() {
        let empty = draw(&sight(&[], false, 0));
        assert_eq!(empty.caption, "corridor: turtlebot-1");
        assert_eq!(draw(&sight(&[], false, 900)).change_since(&empty), 0.0, "time alone");
        let alice = draw(&sight(&["alice"], false, 0));
        assert!(alice.change_since(&empty) > 0.01, "{}", alice.change_since(&empty));
        let before = draw(&sight(&[], true, 0));
        let after = draw(&sight(&[], true, 200));
        assert!(after.change_since(&before) > 0.005, "{}", after.change_since(&before));
    }
}
