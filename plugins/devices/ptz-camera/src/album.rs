//! The folder with a camera's pictures and videos. The name of a file contains the camera, the time
//! and the place. The number of files is bounded; the oldest files are removed first.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Extension of a file that is not complete yet.
const PART: &str = "part";

/// The picture and video files of one camera.
#[derive(Clone, Debug)]
pub(crate) struct Album {
    folder: PathBuf,
    camera: String,
    /// Maximum number of pictures, and likewise of videos. If there are more, the oldest are
    /// deleted.
    keep: usize,
}

/// A file that is being written. Dropping this value removes the file, unless the album has taken
/// it.
#[derive(Debug)]
pub struct PartFile(PathBuf);

impl PartFile {
    /// Returns the path of the file, which does not exist until it is written.
    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        // The file may not exist, or be renamed.
        let _ = fs::remove_file(&self.0);
    }
}

impl Album {
    pub(crate) fn new(folder: PathBuf, camera: String, keep: usize) -> Album {
        Album { folder, camera, keep }
    }

    /// Writes a file, and removes the oldest files of its kind that exceed the maximum. Blocks the
    /// thread.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder or the file cannot be written, or an old file cannot be
    /// removed.
    pub(crate) fn store(&self, place: &str, kind: &str, content: &[u8]) -> io::Result<PathBuf> {
        let part = self.part()?;
        let mut file = OpenOptions::new().write(true).create_new(true).open(part.path())?;
        file.write_all(content)?;
        self.adopt(part, place, kind)
    }

    /// Returns a new file beside the album's files, for a program that writes a video. Removes the
    /// parts of videos that earlier runs have left. Blocks the thread.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be written.
    pub(crate) fn part_of_video(&self) -> io::Result<PartFile> {
        fs::create_dir_all(&self.folder)?;
        self.files(PART)?.iter().try_for_each(fs::remove_file)?;
        self.part()
    }

    /// Makes a complete part a file of the album, and removes the oldest files of its kind that
    /// exceed the maximum. Blocks the thread.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be renamed, or an old file cannot be removed.
    pub(crate) fn adopt(&self, part: PartFile, place: &str, kind: &str) -> io::Result<PathBuf> {
        let path = self.folder.join(format!("{}_{}_{place}.{kind}", self.camera, now()));
        // Readers find only complete files.
        fs::rename(part.path(), &path)?;
        self.drop_oldest(kind, &path)?;
        Ok(path)
    }

    fn part(&self) -> io::Result<PartFile> {
        fs::create_dir_all(&self.folder)?;
        Ok(PartFile(self.folder.join(format!("{}_{}.{PART}", self.camera, now()))))
    }

    /// Removes the oldest files beside `newest` that exceed the maximum.
    fn drop_oldest(&self, kind: &str, newest: &Path) -> io::Result<()> {
        let mut files = self.files(kind)?;
        // It sorts first if the clock of the machine was set back.
        files.retain(|path| path != newest);
        // The time follows the camera's name, so that sorting by name is sorting by time.
        files.sort();
        let surplus = (files.len() + 1).saturating_sub(self.keep);
        files.iter().take(surplus).try_for_each(fs::remove_file)
    }

    fn files(&self, kind: &str) -> io::Result<Vec<PathBuf>> {
        let prefix = format!("{}_", self.camera);
        let is_ours = |path: &Path| {
            let name = path.file_name().and_then(|name| name.to_str());
            // The time follows; a camera of a longer name has other files.
            let time = name.and_then(|name| name.strip_prefix(&prefix));
            time.is_some_and(|time| time.starts_with(|symbol: char| symbol.is_ascii_digit()))
                && path.extension().is_some_and(|extension| extension == kind)
        };
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let path = entry?.path();
            if is_ours(&path) {
                files.push(path);
            }
        }
        Ok(files)
    }
}

/// Returns the present time for the name of a file.
fn now() -> String {
    let time = humantime::format_rfc3339_micros(SystemTime::now()).to_string();
    time.replace(['-', ':'], "")
}

#[cfg(test)]
mod tests {
    use super::Album;

    #[test]
    fn the_newest_files_are_kept_and_foreign_files_left_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let stranger = folder.path().join("holiday.ppm");
        std::fs::write(&stranger, "sea").expect("written");
        let album = Album::new(folder.path().to_owned(), "camera-1".to_owned(), 2);
        let kept: Vec<_> = (0..4_u8)
            .map(|number| album.store("corridor", "ppm", &[number]).expect("written"))
            .collect();
        assert_eq!(
            kept.iter().map(|path| path.exists()).collect::<Vec<_>>(),
            [false, false, true, true]
        );
        assert_eq!(std::fs::read(&kept[3]).expect("there"), [3]);
        assert!(stranger.exists());
    }

    #[test]
    fn a_part_is_no_video_until_it_is_taken() {
        let folder = tempfile::tempdir().expect("a folder");
        let album = Album::new(folder.path().to_owned(), "camera-1".to_owned(), 2);
        let [left, other] = ["camera-1_20260101T0.part", "camera-1_b_20260101T0.part"]
            .map(|name| folder.path().join(name));
        std::fs::write(&left, "half").expect("written");
        std::fs::write(&other, "half").expect("written");
        let count = || std::fs::read_dir(folder.path()).expect("a folder").count() - 1;
        let part = album.part_of_video().expect("a part");
        assert!(!left.exists(), "what an earlier run has left is removed");
        assert!(other.exists(), "it is of another camera");
        std::fs::write(part.path(), "a film").expect("written");
        let path = album.adopt(part, "hall", "mp4").expect("taken");
        assert_eq!(std::fs::read(&path).expect("there"), b"a film");
        let part = album.part_of_video().expect("a part");
        std::fs::write(part.path(), "half a film").expect("written");
        drop(part);
        assert_eq!(count(), 1, "a part that is not taken is removed");
    }
}
