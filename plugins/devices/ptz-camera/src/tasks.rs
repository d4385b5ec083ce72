//! The methods of a camera, which use the driver and the album.

use std::path::PathBuf;
use std::sync::Arc;

use actuator::{BoxFuture, MethodCall, MethodFailure};

use crate::PtzCamera;
use crate::album::Album;
use crate::driver::{FileContent, RecordedFile, Step, View};

/// The result of a method of the camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CameraResult {
    /// The camera was turned.
    Turned(View),
    /// A picture was taken.
    Picture { place: String, file: PathBuf, caption: String },
    /// A video was recorded.
    Video { place: String, file: PathBuf, caption: String },
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
        "go_to_preset" => Ok(turned(camera.look_at(call.argument("preset")?))),
        "move_by" => {
            let number = |name: &'static str| {
                let text = call.argument(name)?;
                text.parse::<f64>().map_err(|error| {
                    MethodFailure::Driver(format!("read {name} `{text}`: {error}"))
                })
            };
            let (pan, tilt, zoom) = (number("pan")?, number("tilt")?, number("zoom")?);
            Ok(turned(camera.move_by(Step { pan, tilt, zoom })))
        }
        "take_picture" => {
            let (preset, place) = (call.argument("preset")?, call.argument("place")?.to_owned());
            let (taking, album) = (camera.take_picture(preset), of.settings.album.clone());
            Ok(Box::pin(async move {
                let (file, caption) = store(album, &place, taking.await).await?;
                Ok(CameraResult::Picture { place, file, caption })
            }))
        }
        "record_video" => {
            let (preset, place) = (call.argument("preset")?, call.argument("place")?.to_owned());
            let (preset, lasts) = (preset.to_owned(), of.settings.recording);
            let album = of.settings.album.clone();
            Ok(Box::pin(async move {
                let begun = album.clone();
                let part = blocking(move || begun.part_of_video()).await?;
                let recorded = camera.record(&preset, lasts, part).await;
                let (file, caption) = store(album, &place, recorded).await?;
                Ok(CameraResult::Video { place, file, caption })
            }))
        }
        _ => Err(MethodFailure::UnknownMethod(call.method.clone())),
    }
}

fn turned(
    turning: BoxFuture<Result<View, String>>,
) -> BoxFuture<Result<CameraResult, MethodFailure>> {
    Box::pin(async move {
        let view = turning.await.map_err(MethodFailure::Driver)?;
        Ok(CameraResult::Turned(view))
    })
}

/// Writes a recorded file on a thread for blocking work. Returns its path and its description.
async fn store(
    album: Album,
    place: &str,
    recorded: Result<RecordedFile, String>,
) -> Result<(PathBuf, String), MethodFailure> {
    let RecordedFile { extension, content, caption } = recorded.map_err(MethodFailure::Driver)?;
    let place = place.to_owned();
    let keep = move || match content {
        FileContent::Made(content) => album.store(&place, extension, &content()),
        FileContent::Written(part) => album.adopt(part, &place, extension),
    };
    Ok((blocking(keep).await?, caption))
}

/// Runs a function that uses the album on a thread for blocking work.
async fn blocking<T: Send + 'static>(
    keep: impl FnOnce() -> std::io::Result<T> + Send + 'static,
) -> Result<T, MethodFailure> {
    match tokio::task::spawn_blocking(keep).await {
        Ok(Ok(kept)) => Ok(kept),
        Ok(Err(error)) => Err(MethodFailure::Driver(format!("keep the file: {error}"))),
        Err(error) => Err(MethodFailure::Driver(error.to_string())),
    }
}
