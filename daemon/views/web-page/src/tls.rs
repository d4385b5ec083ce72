//! TLS of the server: a certificate and its key from files, which are read again when they change.
//! Browsers have no certificates; people sign in. A certificate that has ended is not used: browsers
//! refuse it, and people must not learn to overrule them.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rustls::ServerConfig;
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::TlsAcceptor;

/// Interval at which the files are looked at: a renewed certificate is used within this time, and
/// many connections cost few looks.
const LOOKED_AT_EVERY: Duration = Duration::from_secs(5);

/// Paths of the PEM files of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageTlsFiles {
    /// The certificate, followed by those of its issuers if browsers do not know them.
    pub certificate: PathBuf,
    /// The private key.
    pub key: PathBuf,
}

/// The server's side of TLS. Clones share its keys.
#[derive(Clone)]
pub struct PageTls {
    files: PageTlsFiles,
    loaded: Arc<Mutex<LoadedTls>>,
}

struct LoadedTls {
    acceptor: TlsAcceptor,
    /// Time at which the certificate ends; `None` if it does not say so.
    ends_at: Option<SystemTime>,
    looked_at: Instant,
    stamp: FilesStamp,
    /// Whether the log says that the certificate in use has ended.
    is_end_told: bool,
}

/// The times at which the two files were changed, and their lengths.
type FilesStamp = [Option<(SystemTime, u64)>; 2];

/// Reason why TLS cannot be used. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageTlsError {
    /// A file cannot be read, or has no key or certificate.
    #[error("read {}: {problem}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with the file.
        problem: String,
    },
    /// The key and the certificate do not fit together.
    #[error("use the certificate {}: {problem}", path.display())]
    Unfit {
        /// Path of the certificate.
        path: PathBuf,
        /// Why it cannot be used.
        problem: String,
    },
    /// The certificate has ended, by the clock of this machine.
    #[error("use the certificate {}: it has ended, and browsers refuse it", path.display())]
    Ended {
        /// Path of the certificate.
        path: PathBuf,
    },
}

/// Returns the time at which the certificate in these files ends; `None` if it does not say so. The
/// certificate may have ended.
///
/// # Errors
///
/// Returns an error if it cannot be read.
pub fn certificate_end(files: &PageTlsFiles) -> Result<Option<SystemTime>, PageTlsError> {
    Ok(certificates(&files.certificate)?.first().and_then(end_of))
}

impl fmt::Debug for PageTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PageTls").field("files", &self.files).finish_non_exhaustive()
    }
}

impl PageTls {
    /// Reads the files.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be used, or if the certificate has ended.
    pub fn open(files: PageTlsFiles) -> Result<PageTls, PageTlsError> {
        let stamp = stamp(&files);
        let (acceptor, ends_at) = load(&files)?;
        let (looked_at, is_end_told) = (Instant::now(), false);
        let loaded = LoadedTls { acceptor, ends_at, looked_at, stamp, is_end_told };
        Ok(PageTls { files, loaded: Arc::new(Mutex::new(loaded)) })
    }

    /// Returns the time at which the certificate in use ends, after which browsers refuse it; `None`
    /// if it does not say so.
    pub fn ends_at(&self) -> Option<SystemTime> {
        self.loaded.lock().unwrap_or_else(PoisonError::into_inner).ends_at
    }

    /// Returns what accepts the next connection; `None` if the certificate has ended. If the files
    /// have changed, they are read again; a pair that cannot be used is reported once, and the former
    /// one stays in use.
    pub(crate) fn acceptor(&self) -> Option<TlsAcceptor> {
        let mut loaded = self.loaded.lock().unwrap_or_else(PoisonError::into_inner);
        if loaded.looked_at.elapsed() >= LOOKED_AT_EVERY {
            loaded.looked_at = Instant::now();
            let stamp = stamp(&self.files);
            if stamp != loaded.stamp {
                loaded.stamp = stamp;
                match load(&self.files) {
                    Ok((acceptor, ends_at)) => {
                        (loaded.acceptor, loaded.ends_at) = (acceptor, ends_at);
                        loaded.is_end_told = false;
                        tracing::info!("the page uses its renewed certificate");
                    }
                    Err(error) => {
                        tracing::warn!("the page keeps its former certificate: failed to {error}");
                    }
                }
            }
        }
        if loaded.ends_at.is_none_or(|end| end > SystemTime::now()) {
            return Some(loaded.acceptor.clone());
        }
        if !std::mem::replace(&mut loaded.is_end_told, true) {
            let path = self.files.certificate.display();
            tracing::error!("the page is not served: its certificate {path} has ended; renew it");
        }
        None
    }
}

fn stamp(files: &PageTlsFiles) -> FilesStamp {
    [&files.certificate, &files.key].map(|path| {
        let about = fs::metadata(path).ok()?;
        Some((about.modified().ok()?, about.len()))
    })
}

fn unreadable(path: &Path, problem: impl fmt::Display) -> PageTlsError {
    PageTlsError::File { path: path.to_owned(), problem: problem.to_string() }
}

/// Reads the certificates of a file, at least one.
fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, PageTlsError> {
    let read = CertificateDer::pem_file_iter(path).and_then(Iterator::collect);
    let certificates: Vec<_> = read.map_err(|error| unreadable(path, error))?;
    match certificates.is_empty() {
        true => Err(unreadable(path, "there is no certificate in it")),
        false => Ok(certificates),
    }
}

fn load(files: &PageTlsFiles) -> Result<(TlsAcceptor, Option<SystemTime>), PageTlsError> {
    let certificates = certificates(&files.certificate)?;
    let ends_at = certificates.first().and_then(end_of);
    if ends_at.is_some_and(|end| end <= SystemTime::now()) {
        return Err(PageTlsError::Ended { path: files.certificate.clone() });
    }
    // The message about a key never quotes it.
    let no_key = |_| unreadable(&files.key, "there is no private key that can be read");
    let key = PrivateKeyDer::from_pem_file(&files.key).map_err(no_key)?;
    let unfit = |error: rustls::Error| PageTlsError::Unfit {
        path: files.certificate.clone(),
        problem: error.to_string(),
    };
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(unfit)?
        .with_no_client_auth()
        .with_single_cert(certificates, key)
        .map_err(unfit)?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok((TlsAcceptor::from(Arc::new(config)), ends_at))
}

/// Returns the time at which a certificate ends.
fn end_of(certificate: &CertificateDer<'_>) -> Option<SystemTime> {
    let (_, certificate) = x509_parser::parse_x509_certificate(certificate).ok()?;
    let seconds = u64::try_from(certificate.validity().not_after.timestamp()).ok()?;
    UNIX_EPOCH.checked_add(Duration::from_secs(seconds))
}

#[cfg(test)]
mod tests {
    use rcgen::{CertificateParams, KeyPair};

    use super::*;

    fn issue(files: &PageTlsFiles) {
        issue_until(files, None);
    }

    fn issue_until(files: &PageTlsFiles, year: Option<i32>) {
        let key = KeyPair::generate().expect("a key");
        let mut params = CertificateParams::new(vec!["pi".to_owned()]).expect("a name");
        if let Some(year) = year {
            params.not_after = rcgen::date_time_ymd(year, 1, 1);
        }
        let certificate = params.self_signed(&key).expect("a certificate");
        fs::write(&files.certificate, certificate.pem()).expect("written");
        fs::write(&files.key, key.serialize_pem()).expect("written");
    }

    #[test]
    fn a_pair_that_cannot_be_used_leaves_the_former_one_in_use() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name| folder.path().join(name);
        let files = PageTlsFiles { certificate: path("pi.pem"), key: path("pi.key") };
        issue(&files);
        let tls = PageTls::open(files.clone()).expect("the files fit");
        assert!(tls.ends_at().is_some_and(|end| end > SystemTime::now()), "{:?}", tls.ends_at());
        let used = || {
            let mut loaded = tls.loaded.lock().expect("no holder panics");
            loaded.looked_at = loaded.looked_at.checked_sub(LOOKED_AT_EVERY).expect("some uptime");
            drop(loaded);
            Arc::as_ptr(tls.acceptor().expect("it has not ended").config())
        };
        let former = used();
        assert_eq!(used(), former, "nothing has changed");
        fs::write(&files.certificate, "nothing").expect("written");
        assert_eq!(used(), former, "it cannot be used");
        issue(&files);
        assert_ne!(used(), former, "it is renewed");
    }

    #[test]
    fn a_certificate_that_has_ended_serves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name| folder.path().join(name);
        let files = PageTlsFiles { certificate: path("pi.pem"), key: path("pi.key") };
        issue_until(&files, Some(2020));
        let error = PageTls::open(files.clone()).expect_err("it has ended").to_string();
        assert!(error.contains("pi.pem: it has ended"), "{error}");
        assert!(
            certificate_end(&files).expect("readable").is_some_and(|end| end < SystemTime::now())
        );
        // One that ends while the page is served.
        issue(&files);
        let tls = PageTls::open(files.clone()).expect("the files fit");
        assert!(tls.acceptor().is_some());
        tls.loaded.lock().expect("no holder panics").ends_at = Some(UNIX_EPOCH);
        assert!(tls.acceptor().is_none());
        // A renewed one is used at the next look.
        issue(&files);
        let mut loaded = tls.loaded.lock().expect("no holder panics");
        loaded.looked_at = loaded.looked_at.checked_sub(LOOKED_AT_EVERY).expect("some uptime");
        drop(loaded);
        assert!(tls.acceptor().is_some());
    }
}
