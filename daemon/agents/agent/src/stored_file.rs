//! Writes the small files in which agents keep what must outlive their process.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;

/// Replaces the content of a file as a whole: after a crash or a power cut, the file has either the
/// old content or the new one. Waits for the disk: an agent that does not call it rarely uses
/// [`Context::run_blocking`](crate::Context::run_blocking).
///
/// # Errors
///
/// Returns an error if the new content cannot be written, or cannot take the place of the old one.
pub fn replace_file(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let mut file = File::create(&beside)?;
    file.write_all(content)?;
    // Without this, the rename could reach the disk before the content.
    file.sync_all()?;
    fs::rename(beside, path)?;
    // Without this, the folder could lead to the old file after a power cut.
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("facts");
        for content in ["a long content", "short"] {
            replace_file(&path, content.as_bytes()).expect("there is room");
            assert_eq!(fs::read_to_string(&path).expect("it is there"), content);
        }
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1, "nothing is left");
        // A folder beside the file makes the write fail, as a full disk would.
        fs::create_dir(folder.path().join("facts.new")).expect("made");
        replace_file(&path, b"new").expect_err("no file can be made");
        assert_eq!(fs::read_to_string(&path).expect("it is there"), "short");
    }
}
