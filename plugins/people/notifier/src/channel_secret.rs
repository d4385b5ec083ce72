//! Secrets of channels: tokens, keys and passwords, each in a file of its own.

use std::fmt;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::sync::Arc;

/// Maximum length of a file with a secret, in bytes.
const FILE_BYTES_MAX: u64 = 4_096;

/// Permissions that no file with a secret gives: others read or change it, the group changes it.
const TOO_OPEN: u32 = 0o027;

/// A secret. It is in no log and no `Debug` output.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct ChannelSecret(Arc<str>);

impl fmt::Debug for ChannelSecret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("•••")
    }
}

// === impl ChannelSecret ===

impl ChannelSecret {
    /// Reads the first line of a file that other users cannot read.
    ///
    /// # Errors
    ///
    /// Returns the reason as a text for a person, which does not repeat the content.
    pub(crate) fn read(path: &Path) -> Result<ChannelSecret, String> {
        let shown = path.display();
        let failed = |error: std::io::Error| format!("read {shown}: {error}");
        let file = File::open(path).map_err(failed)?;
        let mode = file.metadata().map_err(failed)?.mode() & 0o777;
        if mode & TOO_OPEN != 0 {
            return Err(format!(
                "{shown}: other users can read or change it (mode {mode:03o}); close it with \
                 `chmod 600 {shown}`"
            ));
        }
        let mut text = String::new();
        let read = file.take(FILE_BYTES_MAX).read_to_string(&mut text);
        read.map_err(|_| format!("{shown}: it is no text"))?;
        let secret = text.lines().next().unwrap_or_default().trim();
        if secret.is_empty() || !secret.bytes().all(|byte| byte.is_ascii_graphic() || byte == b' ')
        {
            return Err(format!("{shown}: its first line must be the secret, in plain ASCII"));
        }
        Ok(ChannelSecret(Arc::from(secret)))
    }

    /// Returns the secret.
    pub(crate) fn reveal(&self) -> &str {
        &self.0
    }

    /// Returns a secret that stands for one whose file is not read.
    pub(crate) fn unread() -> ChannelSecret {
        // The form of every kind of secret: a key of the webhook with 24 bytes.
        ChannelSecret(Arc::from("whsec_AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"))
    }

    #[cfg(test)]
    pub(crate) fn of(secret: &str) -> ChannelSecret {
        ChannelSecret(Arc::from(secret))
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_file_that_others_can_read_is_refused_with_a_correction() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        std::fs::write(&path, "tk_1 \nmore\n").expect("a file");
        for (mode, is_fine) in [(0o600, true), (0o640, true), (0o644, false), (0o620, false)] {
            let permissions = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(&path, permissions).expect("ours");
            match ChannelSecret::read(&path) {
                Ok(secret) => assert!(is_fine && secret.reveal() == "tk_1", "{mode:o}"),
                Err(why) => assert!(!is_fine && why.contains("chmod 600"), "{why}"),
            }
        }
        assert_eq!(format!("{:?}", ChannelSecret::of("tk_1")), "•••");
    }

    #[test]
    fn a_file_without_a_secret_is_refused_without_repeating_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        for content in ["", "\nsecret", "sécret\n", "\u{7}secret"] {
            std::fs::write(&path, content).expect("a file");
            let mode = std::fs::Permissions::from_mode(0o600);
            std::fs::set_permissions(&path, mode).expect("ours");
            let why = ChannelSecret::read(&path).expect_err(content);
            assert!(why.contains("first line") && !why.contains("cret\""), "{why}");
        }
    }
}
