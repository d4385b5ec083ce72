//! Copies a file that another process may be writing to.
//!
//! A file is read twice. If both readings are equal, the copy is the content that the file had at the
//! moment between them: all that was changed after it was first read differs in the second reading.
//! Such a copy is what a power cut at that moment would have left, which every format of the state
//! survives.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use ring::digest::{Context, Digest, SHA256};
use tempfile::SpooledTempFile;

use crate::error::{BackupError, failed};

/// Longest copy that is kept in memory, in bytes: most files of the state are shorter.
const MEMORY_BYTES: usize = 1 << 20;

/// How long a file is read anew because it has changed. A Journal writes a few times per goal, so
/// that a second without a change comes soon.
const STEADY_WITHIN: Duration = Duration::from_secs(20);

/// Pause before a file that has changed is read again; a transaction of a Journal takes as long.
const PAUSE: Duration = Duration::from_millis(50);

/// Number of bytes that are read at once.
const CHUNK_BYTES: usize = 64 << 10;

/// A copy of a file, with the length and the digest of its content.
pub(crate) struct SteadyCopy {
    pub(crate) content: SpooledTempFile,
    pub(crate) length: u64,
    pub(crate) digest: Digest,
}

/// Copies the file `path` as it was at one moment. A long copy is kept in a file of the folder
/// `beside` that has no name.
pub(crate) fn copy(path: &Path, beside: &Path) -> Result<SteadyCopy, BackupError> {
    let deadline = Instant::now() + STEADY_WITHIN;
    loop {
        let mut content = tempfile::spooled_tempfile_in(MEMORY_BYTES, beside);
        let (length, digest) = read(path, Some(&mut content))?;
        let (_, again) = read(path, None)?;
        if digest.as_ref() == again.as_ref() {
            content.rewind().map_err(failed("copy", path))?;
            return Ok(SteadyCopy { content, length, digest });
        }
        if Instant::now() >= deadline {
            return Err(BackupError::Unsteady { path: path.to_owned() });
        }
        std::thread::sleep(PAUSE);
    }
}

fn read(path: &Path, mut into: Option<&mut SpooledTempFile>) -> Result<(u64, Digest), BackupError> {
    let mut file = File::open(path).map_err(failed("read", path))?;
    let (mut context, mut length) = (Context::new(&SHA256), 0_u64);
    let mut chunk = vec![0; CHUNK_BYTES];
    loop {
        let count = match file.read(&mut chunk) {
            Ok(0) => return Ok((length, context.finish())),
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(failed("read", path)(error)),
        };
        let part = chunk.get(..count).unwrap_or_default();
        context.update(part);
        length += part.len() as u64;
        if let Some(into) = into.as_deref_mut() {
            into.write_all(part).map_err(failed("copy", path))?;
        }
    }
}

/// Returns a digest as `sha256sum` writes it.
pub(crate) fn hexadecimal(digest: &Digest) -> String {
    digest.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
}
