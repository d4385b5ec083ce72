//! The methods of a camera, and their work with the driver and the album.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use actuator::{BoxFuture, MethodCall, MethodFailure};

use crate::album::Album;
use crate::frame::{Frame, y4m};
use crate::{Camera, PTZ, PtzCamera, PtzPosition};

/// Pictures per second of a recording: enough for recognising a person.
const PER_SECOND: u32 = 5;

/// The result of a method of the camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CameraResult {
    /// The camera was turned to this direction.
    Aimed(PtzPosition),
    /// A picture was taken.
    Picture { place: String, file: PathBuf, caption: String },
    /// A video was recorded.
    Video { place: String, file: PathBuf, frames: usize },
}

/// Returns the future that performs a method.
///
/// # Errors
///
/// Returns an error if there is no such method, or the call lacks an argument.
pub(crate) fn task(
    call: &MethodCall,
    of: &PtzCamera,
) -> Result<BoxFuture<Result<CameraResult, MethodFailure>>, MethodFailure> {
    let camera = Arc::clone(&of.camera);
    match call.method.as_str() {
        "go_to_preset" => {
            let aim = preset(call, of)?;
            Ok(Box::pin(turn(camera, aim)))
        }
        "move_by" => {
            let number = |name: &'static str| {
                let text = call.argument(name)?;
                text.parse::<f64>().map_err(|error| {
                    MethodFailure::Driver(format!("read {name} `{text}`: {error}"))
                })
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
        _ => Err(MethodFailure::UnknownMethod(call.method.clone())),
    }
}

/// Returns the direction of the preset in the arguments of the call.
fn preset(call: &MethodCall, of: &PtzCamera) -> Result<PtzPosition, MethodFailure> {
    let name = call.argument("preset")?;
    let preset = of.settings.presets.get(name).map(|preset| preset.aim);
    preset.ok_or_else(|| MethodFailure::Driver(format!("find the preset `{name}`")))
}

async fn turn(camera: Arc<dyn Camera>, aim: PtzPosition) -> Result<CameraResult, MethodFailure> {
    camera.aim(aim).await.map_err(MethodFailure::Driver)?;
    Ok(CameraResult::Aimed(aim))
}

/// Turns and zooms the camera by a step, within its limits.
async fn move_by(
    camera: Arc<dyn Camera>,
    pan: f64,
    tilt: f64,
    zoom: f64,
) -> Result<CameraResult, MethodFailure> {
    let now = camera.frame().await.map_err(MethodFailure::Driver)?.aim;
    let aim = PtzPosition {
        pan: (now.pan + pan).clamp(-PTZ.pan, PTZ.pan),
        tilt: (now.tilt + tilt).clamp(-PTZ.tilt, PTZ.tilt),
        zoom: (now.zoom * zoom).clamp(1.0, PTZ.zoom),
    };
    turn(camera, aim).await
}

/// Returns a frame of the camera. Returns an error if the direction of the camera is not the one
/// that the plan assumes.
async fn frame_of(
    camera: &dyn Camera,
    aim: PtzPosition,
    place: &str,
) -> Result<Frame, MethodFailure> {
    let frame = camera.frame().await.map_err(MethodFailure::Driver)?;
    if frame.aim.is(&aim) {
        return Ok(frame);
    }
    Err(MethodFailure::Driver(format!("see `{place}`: the camera looks elsewhere")))
}

async fn take_picture(
    camera: Arc<dyn Camera>,
    album: Album,
    aim: PtzPosition,
    place: String,
) -> Result<CameraResult, MethodFailure> {
    let frame = frame_of(&*camera, aim, &place).await?;
    let caption = frame.caption.clone();
    let file = store_file(album, place.clone(), "ppm", move || frame.ppm()).await?;
    Ok(CameraResult::Picture { place, file, caption })
}

async fn record_video(
    camera: Arc<dyn Camera>,
    album: Album,
    aim: PtzPosition,
    place: String,
    lasts: Duration,
) -> Result<CameraResult, MethodFailure> {
    let count = (lasts.as_secs_f64() * f64::from(PER_SECOND)).ceil() as usize;
    let mut tick = tokio::time::interval(Duration::from_secs_f64(1.0 / f64::from(PER_SECOND)));
    let mut frames = Vec::new();
    while frames.len() < count {
        tick.tick().await;
        frames.push(frame_of(&*camera, aim, &place).await?);
    }
    let frames_count = frames.len();
    let file = store_file(album, place.clone(), "y4m", move || y4m(&frames, PER_SECOND)).await?;
    Ok(CameraResult::Video { place, file, frames: frames_count })
}

/// Writes a file on a thread for blocking work.
async fn store_file(
    album: Album,
    place: String,
    kind: &'static str,
    content: impl FnOnce() -> Vec<u8> + Send + 'static,
) -> Result<PathBuf, MethodFailure> {
    let kept = tokio::task::spawn_blocking(move || album.store(&place, kind, &content())).await;
    match kept {
        Ok(Ok(file)) => Ok(file),
        Ok(Err(error)) => Err(MethodFailure::Driver(format!("keep the file: {error}"))),
        Err(error) => Err(MethodFailure::Driver(error.to_string())),
    }
}
