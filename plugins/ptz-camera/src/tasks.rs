//! The methods of a camera, and what each does with the driver and the album.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use actuator::{BoxFuture, Call, Failure};

use crate::album::Album;
use crate::frame::{Frame, y4m};
use crate::{Aim, Camera, PTZ, PtzCamera};

/// Pictures per second of a recording: enough to recognise a person.
const PER_SECOND: u32 = 5;

/// The result of a method.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Done {
    /// The camera looks in this direction now.
    Aimed(Aim),
    /// A picture was taken.
    Picture { place: String, file: PathBuf, caption: String },
    /// A video was recorded.
    Video { place: String, file: PathBuf, frames: usize },
}

/// Returns the future that performs a method.
///
/// # Errors
///
/// Returns an error if there is no such method, or it lacks an argument.
pub(crate) fn task(
    call: &Call,
    of: &PtzCamera,
) -> Result<BoxFuture<Result<Done, Failure>>, Failure> {
    let camera = Arc::clone(&of.camera);
    match call.method.as_str() {
        "go_to_preset" => {
            let aim = preset(call, of)?;
            Ok(Box::pin(turn(camera, aim)))
        }
        "move_by" => {
            let number = |name: &'static str| {
                let text = call.argument(name)?;
                text.parse::<f64>()
                    .map_err(|error| Failure::Driver(format!("read {name} `{text}`: {error}")))
            };
            let (pan, tilt, zoom) = (number("pan")?, number("tilt")?, number("zoom")?);
            Ok(Box::pin(move_by(camera, pan, tilt, zoom)))
        }
        "take_picture" => {
            let (aim, place) = (preset(call, of)?, call.argument("place")?.to_owned());
            Ok(Box::pin(take_picture(camera, of.settings.album.clone(), aim, place)))
        }
        "record_video" => {
            let (aim, place) = (preset(call, of)?, call.argument("place")?.to_owned());
            let (album, lasts) = (of.settings.album.clone(), of.settings.recording);
            Ok(Box::pin(record_video(camera, album, aim, place, lasts)))
        }
        _ => Err(Failure::UnknownMethod(call.method.clone())),
    }
}

/// Returns the direction of the preset that a call names.
fn preset(call: &Call, of: &PtzCamera) -> Result<Aim, Failure> {
    let name = call.argument("preset")?;
    let preset = of.settings.presets.get(name).map(|preset| preset.aim);
    preset.ok_or_else(|| Failure::Driver(format!("find the preset `{name}`")))
}

async fn turn(camera: Arc<dyn Camera>, aim: Aim) -> Result<Done, Failure> {
    camera.aim(aim).await.map_err(Failure::Driver)?;
    Ok(Done::Aimed(aim))
}

/// Turns by a step, at most to the limits of the camera.
async fn move_by(camera: Arc<dyn Camera>, pan: f64, tilt: f64, zoom: f64) -> Result<Done, Failure> {
    let now = camera.frame().await.map_err(Failure::Driver)?.aim;
    let aim = Aim {
        pan: (now.pan + pan).clamp(-PTZ.pan, PTZ.pan),
        tilt: (now.tilt + tilt).clamp(-PTZ.tilt, PTZ.tilt),
        zoom: (now.zoom * zoom).clamp(1.0, PTZ.zoom),
    };
    turn(camera, aim).await
}

/// Returns a frame. Returns an error if the camera does not look in the direction that the plan assumes.
async fn frame_of(camera: &dyn Camera, aim: Aim, place: &str) -> Result<Frame, Failure> {
    let frame = camera.frame().await.map_err(Failure::Driver)?;
    if frame.aim.is(&aim) {
        return Ok(frame);
    }
    Err(Failure::Driver(format!("see `{place}`: the camera looks elsewhere")))
}

async fn take_picture(
    camera: Arc<dyn Camera>,
    album: Album,
    aim: Aim,
    place: String,
) -> Result<Done, Failure> {
    let frame = frame_of(&*camera, aim, &place).await?;
    let caption = frame.caption.clone();
    let file = keep(album, place.clone(), "ppm", move || frame.ppm()).await?;
    Ok(Done::Picture { place, file, caption })
}

async fn record_video(
    camera: Arc<dyn Camera>,
    album: Album,
    aim: Aim,
    place: String,
    lasts: Duration,
) -> Result<Done, Failure> {
    let count = (lasts.as_secs_f64() * f64::from(PER_SECOND)).ceil() as usize;
    let mut tick = tokio::time::interval(Duration::from_secs(1) / PER_SECOND);
    let mut frames = Vec::new();
    while frames.len() < count {
        tick.tick().await;
        frames.push(frame_of(&*camera, aim, &place).await?);
    }
    let frames_count = frames.len();
    let file = keep(album, place.clone(), "y4m", move || y4m(&frames, PER_SECOND)).await?;
    Ok(Done::Video { place, file, frames: frames_count })
}

/// Writes a file on a thread for blocking work.
async fn keep(
    album: Album,
    place: String,
    kind: &'static str,
    content: impl FnOnce() -> Vec<u8> + Send + 'static,
) -> Result<PathBuf, Failure> {
    let kept = tokio::task::spawn_blocking(move || album.keep(&place, kind, &content())).await;
    match kept {
        Ok(Ok(file)) => Ok(file),
        Ok(Err(error)) => Err(Failure::Driver(format!("keep the file: {error}"))),
        Err(error) => Err(Failure::Driver(error.to_string())),
    }
}
