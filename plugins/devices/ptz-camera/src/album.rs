//! The folder with a camera's pictures and videos. The name of a file contains the camera, the time
//! and the place. The number of files is bounded; the oldest files are removed first.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The picture and video files of one camera.
#[derive(Clone, Debug)]
pub(crate) struct Album {
    folder: PathBuf,
    camera: String,
    /// Maximum number of pictures, and likewise of videos. If there are more, the oldest are
    /// deleted.
    keep: usize,
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
        fs::create_dir_all(&self.folder)?;
        let time = humantime::format_rfc3339_micros(SystemTime::now()).to_string();
        let time = time.replace(['-', ':'], "");
        let path = self.folder.join(format!("{}_{time}_{place}.{kind}", self.camera));
        // The file is written under another name and renamed, so that readers find only complete
        // files.
        let beside = path.with_extension("part");
        let mut file = OpenOptions::new().write(true).create_new(true).open(&beside)?;
        let written = file.write_all(content).and_then(|()| fs::rename(&beside, &path));
        if let Err(error) = written {
            // If the file cannot be removed either, it stays; the first error is returned.
            let _ = fs::remove_file(&beside);
            return Err(error);
        }
        self.drop_oldest(kind)?;
        Ok(path)
    }

    fn drop_oldest(&self, kind: &str) -> io::Result<()> {
        let mut files = self.files(kind)?;
        // The time follows the camera's name, so that sorting by name is sorting by time.
        files.sort();
        let surplus = files.len().saturating_sub(self.keep);
        files.iter().take(surplus).try_for_each(fs::remove_file)
    }

    fn files(&self, kind: &str) -> io::Result<Vec<PathBuf>> {
        let prefix = format!("{}_", self.camera);
        let is_ours = |path: &Path| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| name.starts_with(&prefix))
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
}
