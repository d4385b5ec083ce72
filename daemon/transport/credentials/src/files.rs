//! Names of the files in a folder of credentials, and the functions that write and read these
//! files.
//!
//! ```text
//! authority.pem     certificate of the authority; on every machine
//! authority.key     key of the authority; only on the machine that issues certificates
//! NAME.pem          certificate of the daemon NAME
//! NAME.key          key of the daemon NAME
//! revoked.pem       list of revoked certificates, signed by the authority; daemons pass it on
//! issued/           copies of all issued certificates, with the serial numbers for revocations
//! ```

use std::fs::{self, DirBuilder, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use acl::DaemonId;
use rustls_pki_types::PrivatePkcs8KeyDer;
use rustls_pki_types::pem::PemObject as _;

use crate::error::CredentialError;

/// Maximum length of a credential file, in bytes; a longer one is not read. A list with ten
/// thousand revoked certificates has half a megabyte.
const FILE_BYTES_MAX: u64 = 4 << 20;

/// A folder that contains credentials.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CredentialFolder(PathBuf);

// === impl CredentialFolder ===

impl CredentialFolder {
    /// Returns the folder at this path. The folder need not exist.
    pub fn new(path: impl Into<PathBuf>) -> CredentialFolder {
        CredentialFolder(path.into())
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Returns the path of the authority's certificate.
    pub fn authority(&self) -> PathBuf {
        self.0.join("authority.pem")
    }

    /// Returns the path of the authority's key.
    pub fn authority_key(&self) -> PathBuf {
        self.0.join("authority.key")
    }

    /// Returns the path of a daemon's certificate.
    pub fn certificate(&self, daemon: &DaemonId) -> PathBuf {
        self.0.join(format!("{daemon}.pem"))
    }

    /// Returns the path of a daemon's key.
    pub fn key(&self, daemon: &DaemonId) -> PathBuf {
        self.0.join(format!("{daemon}.key"))
    }

    /// Returns the path of the list of revoked certificates.
    pub fn revocations(&self) -> PathBuf {
        self.0.join("revoked.pem")
    }

    /// Returns the path of the folder with copies of all certificates that the authority of this
    /// folder has issued.
    pub(crate) fn issued(&self) -> PathBuf {
        self.0.join("issued")
    }

    /// Returns the daemons that have a key in this folder, sorted by name.
    pub fn daemons(&self) -> Vec<DaemonId> {
        let Ok(entries) = fs::read_dir(&self.0) else { return Vec::new() };
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        let daemons = names.filter_map(|name| DaemonId::new(name.strip_suffix(".key")?).ok());
        let mut daemons: Vec<_> =
            daemons.filter(|name| self.key(name) != self.authority_key()).collect();
        daemons.sort();
        daemons
    }

    /// Creates the folder, with access for the present user alone.
    pub(crate) fn make(&self) -> Result<(), CredentialError> {
        for folder in [&self.0, &self.issued()] {
            let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
            made.map_err(|source| failed(folder, source))?;
        }
        Ok(())
    }
}

fn failed(path: &Path, source: io::Error) -> CredentialError {
    CredentialError::Io { path: path.to_owned(), source }
}

/// Reads a text file of at most [`FILE_BYTES_MAX`] bytes.
pub(crate) fn read(path: &Path) -> Result<String, CredentialError> {
    let length = fs::metadata(path).map_err(|source| failed(path, source))?.len();
    if length > FILE_BYTES_MAX {
        let problem = format!("it has {length} bytes; no file of this kind is so long");
        return Err(CredentialError::Malformed { path: path.to_owned(), problem });
    }
    fs::read_to_string(path).map_err(|source| failed(path, source))
}

/// Returns an error if every user can write the file, or the folder that contains it. A user that
/// can replace the authority's certificate controls which certificates every daemon trusts.
pub(crate) fn check_not_world_writable(
    folder: &CredentialFolder,
    path: &Path,
) -> Result<(), CredentialError> {
    for each in [folder.path(), path] {
        let mode = fs::metadata(each).map_err(|source| failed(each, source))?.mode() & 0o1777;
        // In a sticky folder no user can replace another user's file.
        if mode & 0o002 != 0 && mode & 0o1000 == 0 {
            return Err(CredentialError::Writable { path: each.to_owned(), mode });
        }
    }
    Ok(())
}

/// Reads a private key; returns an error if other users can read the file too.
pub(crate) fn read_key(path: &Path) -> Result<PrivatePkcs8KeyDer<'static>, CredentialError> {
    let mode = fs::metadata(path).map_err(|source| failed(path, source))?.mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(CredentialError::Loose { path: path.to_owned(), mode });
    }
    PrivatePkcs8KeyDer::from_pem_slice(read(path)?.as_bytes()).map_err(|_| {
        // The parser's error is not passed on: it could quote the key.
        let problem = "there is no PKCS#8 key in it".to_owned();
        CredentialError::Malformed { path: path.to_owned(), problem }
    })
}

/// Writes a new file with the permissions `mode`. Returns an error if the file exists already.
pub(crate) fn write_new(path: &Path, text: &str, mode: u32) -> Result<(), CredentialError> {
    let mut options = OpenOptions::new();
    let file = options.write(true).create_new(true).mode(mode).open(path);
    let mut file = file.map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => CredentialError::Exists { path: path.to_owned() },
        _ => failed(path, source),
    })?;
    let written = file.write_all(text.as_bytes()).and_then(|()| file.sync_all());
    written.map_err(|source| failed(path, source))
}

/// Replaces a file atomically: a reader sees either the old content or the new content, never a
/// part of it.
pub(crate) fn replace(path: &Path, text: &str, mode: u32) -> Result<(), CredentialError> {
    let aside = path.with_extension(format!("new-{}", std::process::id()));
    // Removes the remnant of a process that died.
    let _ = fs::remove_file(&aside);
    write_new(&aside, text, mode)?;
    fs::rename(&aside, path).map_err(|source| {
        let _ = fs::remove_file(&aside);
        failed(path, source)
    })
}
