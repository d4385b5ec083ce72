//! Which file is which in a folder of credentials, and how they are written and read.
//!
//! ```text
//! authority.pem     whom the ecosystem trusts; on every machine
//! authority.key     its key; where certificates are made, nowhere else
//! NAME.pem          a daemon's certificate
//! NAME.key          its key
//! revoked.pem       whom nobody believes any more, signed by the authority; it spreads by itself
//! issued/           copies of all certificates made, to know what can be revoked
//! ```

use std::fs::{self, DirBuilder, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use acl::DaemonId;
use rustls_pki_types::PrivatePkcs8KeyDer;
use rustls_pki_types::pem::PemObject as _;

use crate::error::CredentialError;

/// The longest file read: a list with ten thousand revoked certificates has half a megabyte.
const FILE_BYTES_MAX: u64 = 4 << 20;

/// A folder of credentials.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder(PathBuf);

// === impl Folder ===

impl Folder {
    /// The folder at this path, whether or not it is there.
    pub fn new(path: impl Into<PathBuf>) -> Folder {
        Folder(path.into())
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The authority's certificate.
    pub fn authority(&self) -> PathBuf {
        self.0.join("authority.pem")
    }

    /// The authority's key.
    pub fn authority_key(&self) -> PathBuf {
        self.0.join("authority.key")
    }

    /// A daemon's certificate.
    pub fn certificate(&self, daemon: &DaemonId) -> PathBuf {
        self.0.join(format!("{daemon}.pem"))
    }

    /// A daemon's key.
    pub fn key(&self, daemon: &DaemonId) -> PathBuf {
        self.0.join(format!("{daemon}.key"))
    }

    /// The certificates that were taken back.
    pub fn revocations(&self) -> PathBuf {
        self.0.join("revoked.pem")
    }

    /// Copies of all certificates that the authority here has made.
    pub(crate) fn issued(&self) -> PathBuf {
        self.0.join("issued")
    }

    /// The daemons whose keys are here, in the order of their names.
    pub fn daemons(&self) -> Vec<DaemonId> {
        let Ok(entries) = fs::read_dir(&self.0) else { return Vec::new() };
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        let daemons = names.filter_map(|name| DaemonId::new(name.strip_suffix(".key")?).ok());
        let mut daemons: Vec<_> =
            daemons.filter(|name| self.key(name) != self.authority_key()).collect();
        daemons.sort();
        daemons
    }

    /// Makes the folder, for this user alone.
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

/// Reads a text of bounded length.
pub(crate) fn read(path: &Path) -> Result<String, CredentialError> {
    let length = fs::metadata(path).map_err(|source| failed(path, source))?.len();
    if length > FILE_BYTES_MAX {
        let problem = format!("it has {length} bytes; no file of this kind is so long");
        return Err(CredentialError::Malformed { path: path.to_owned(), problem });
    }
    fs::read_to_string(path).map_err(|source| failed(path, source))
}

/// Refuses what anybody could put another in the place of: whoever does that decides whom all trust.
pub(crate) fn not_for_anybody(folder: &Folder, path: &Path) -> Result<(), CredentialError> {
    for each in [folder.path(), path] {
        let mode = fs::metadata(each).map_err(|source| failed(each, source))?.mode() & 0o1777;
        // In a folder that is sticky nobody can replace what is another's.
        if mode & 0o002 != 0 && mode & 0o1000 == 0 {
            return Err(CredentialError::Writable { path: each.to_owned(), mode });
        }
    }
    Ok(())
}

/// Reads a key, unless others can read it too.
pub(crate) fn read_key(path: &Path) -> Result<PrivatePkcs8KeyDer<'static>, CredentialError> {
    let mode = fs::metadata(path).map_err(|source| failed(path, source))?.mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(CredentialError::Loose { path: path.to_owned(), mode });
    }
    PrivatePkcs8KeyDer::from_pem_slice(read(path)?.as_bytes()).map_err(|_| {
        // Not what the parser says: it could quote the key.
        let problem = "there is no PKCS#8 key in it".to_owned();
        CredentialError::Malformed { path: path.to_owned(), problem }
    })
}

/// Writes a file that nobody else may write, or of a key read; never over one that is there.
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

/// Writes a file in the place of another: whoever reads sees the old one or the new one, whole.
pub(crate) fn replace(path: &Path, text: &str, mode: u32) -> Result<(), CredentialError> {
    let aside = path.with_extension(format!("new-{}", std::process::id()));
    // One that was left by a process that died.
    let _ = fs::remove_file(&aside);
    write_new(&aside, text, mode)?;
    fs::rename(&aside, path).map_err(|source| {
        let _ = fs::remove_file(&aside);
        failed(path, source)
    })
}
