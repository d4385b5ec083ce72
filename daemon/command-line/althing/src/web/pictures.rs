//! The pictures of the cameras that this daemon hosts, from the folders into which they write them.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use acl::AgentId;
use bytes::Bytes;
use live_view::Moment;
use web_page::PagePicture;

use crate::config::{AgentEntry, Ecosystem};

/// Maximum length of a picture, in bytes; a longer one is not shown.
const PICTURE_BYTES_MAX: u64 = 16 << 20;

/// Maximum number of files in a folder of pictures that are looked at. A camera keeps some dozens.
const FILES_MAX: usize = 10_000;

/// Name of the plugin whose agents are cameras.
const PLUGIN: &str = "ptz-camera";

/// Returns the folder into which a camera of the ecosystem file writes its pictures; `None` if the
/// agent is no camera.
pub(super) fn folder(ecosystem: &Ecosystem, agent: &AgentId, state: &Path) -> Option<PathBuf> {
    let is_meant = |entry: &&AgentEntry| entry.name == *agent && entry.plugin == PLUGIN;
    let entry = ecosystem.agents.iter().find(is_meant)?;
    let own = entry.config.get("folder").and_then(|folder| folder.as_str());
    Some(own.map_or_else(|| state.join("pictures"), PathBuf::from))
}

/// Returns the newest picture of a camera in its folder; `None` if there is none that browsers show.
/// Blocks the thread.
pub(super) fn newest(folder: &Path, camera: &AgentId) -> Option<PagePicture> {
    let prefix = format!("{camera}_");
    let entries = fs::read_dir(folder).ok()?.take(FILES_MAX).flatten();
    let pictures = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let time = name.strip_prefix(&prefix)?;
        // The time follows the name; a camera with a longer name has other files.
        let is_ours = time.starts_with(|symbol: char| symbol.is_ascii_digit());
        let media_type = match name.rsplit_once('.')?.1 {
            "jpg" | "jpeg" => "image/jpeg",
            "png" => "image/png",
            // The pictures of simulated cameras, which the page sends as PNG.
            "ppm" => "image/x-portable-pixmap",
            _ => return None,
        };
        is_ours.then_some((name, entry.path(), media_type))
    });
    // The names begin with the time, so that the last name is the newest picture.
    let (_, path, media_type) = pictures.max_by(|one, other| one.0.cmp(&other.0))?;
    let file = File::open(path).ok()?;
    let about = file.metadata().ok()?;
    if about.len() > PICTURE_BYTES_MAX {
        return None;
    }
    let since = about.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
    let mut bytes = Vec::new();
    file.take(PICTURE_BYTES_MAX).read_to_end(&mut bytes).ok()?;
    Some(PagePicture {
        media_type: media_type.to_owned(),
        at: Moment(u64::try_from(since.as_millis()).unwrap_or(u64::MAX)),
        bytes: Bytes::from(bytes),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_picture_of_this_camera_is_found() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str| fs::write(folder.path().join(name), name).expect("written");
        let camera = AgentId::new("camera-1").expect("a name");
        assert!(newest(folder.path(), &camera).is_none());
        write("camera-1_20260102T030405Z_hall.jpg");
        write("camera-1_20260102T030409Z_hall.jpg");
        write("camera-1_20260102T030410Z_hall.mp4");
        write("camera-10_20270102T030405Z_hall.jpg");
        let picture = newest(folder.path(), &camera).expect("a picture");
        assert_eq!(picture.media_type, "image/jpeg");
        assert_eq!(picture.bytes, "camera-1_20260102T030409Z_hall.jpg".as_bytes());
        write("camera-1_20260102T030411Z_hall.ppm");
        let simulated = newest(folder.path(), &camera).expect("a picture");
        assert_eq!(simulated.media_type, "image/x-portable-pixmap");
        assert!(newest(&folder.path().join("missing"), &camera).is_none());
    }
}
