//! The media that screens show, and the settings of the programs that show them.

use std::path::{Path, PathBuf};

/// Beginnings of an address, for the drivers with a program and for `cast`.
pub(crate) const ADDRESSES: &[&str] = &["http://", "https://"];

/// A medium that a screen can show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// A text.
    Text(String),
    /// The address of a page, or of a film in a network.
    Address(String),
    /// A file of this machine.
    File {
        /// Path as the config writes it.
        written: String,
        /// Absolute path.
        path: PathBuf,
    },
    /// A medium that a Chromecast fetches by itself.
    Fetched {
        /// Address of the medium.
        address: String,
        /// MIME type of the medium.
        content_type: String,
    },
}

/// Settings of a driver that shows media with a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct PlayerSettings {
    pub(crate) program: Option<String>,
    pub(crate) arguments: Vec<String>,
    pub(crate) display: Option<String>,
    pub(crate) profile: Option<PathBuf>,
}

impl Content {
    /// Returns the medium as the config writes it, without the key.
    pub fn written(&self) -> &str {
        match self {
            Content::Text(text) => text,
            Content::Address(address) | Content::Fetched { address, .. } => address,
            Content::File { written, .. } => written,
        }
    }
}

/// Returns the ending of a file's name, in lower case.
pub(crate) fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}
