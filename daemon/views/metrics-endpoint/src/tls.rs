//! TLS with certificates on both sides: only who has a certificate of the given authority reads the
//! metrics.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustls::server::WebPkiClientVerifier;
use rustls::{RootCertStore, ServerConfig};
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
use tokio::net::TcpStream;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

/// Paths of the PEM files for TLS.
#[derive(Clone, Debug)]
pub struct TlsFiles {
    /// The private key of the server.
    pub key: PathBuf,
    /// The certificate of the server.
    pub certificate: PathBuf,
    /// The certificate of the authority that has issued the certificates of the clients.
    pub authority: PathBuf,
}

/// Function that states whether a certificate, in DER, was revoked.
type RevocationCheck = Arc<dyn Fn(&[u8]) -> bool + Send + Sync>;

/// The server's side of TLS. Clones share its keys.
#[derive(Clone)]
pub struct TlsServer {
    acceptor: TlsAcceptor,
    is_revoked: RevocationCheck,
}

/// Reason why TLS cannot be used. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TlsError {
    /// A file cannot be read, or has no key or certificate.
    #[error("read {}: {problem}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with the file.
        problem: String,
    },
    /// The key, the certificate and the authority do not fit together.
    #[error("use the certificate of this daemon: {0}")]
    Unfit(String),
}

impl fmt::Debug for TlsServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TlsServer")
    }
}

impl TlsServer {
    /// Reads the files. `is_revoked` states whether a certificate, in DER, was revoked; it is asked
    /// at each connection.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be used.
    pub fn new(
        files: &TlsFiles,
        is_revoked: impl Fn(&[u8]) -> bool + Send + Sync + 'static,
    ) -> Result<TlsServer, TlsError> {
        let certificate = |path: &PathBuf| {
            CertificateDer::from_pem_file(path).map_err(|error| unreadable(path, &error))
        };
        // The message about a key never quotes it.
        let no_key = |_| TlsError::File {
            path: files.key.clone(),
            problem: "there is no private key that can be read".to_owned(),
        };
        let key = PrivateKeyDer::from_pem_file(&files.key).map_err(no_key)?;
        let unfit = |error: &dyn fmt::Display| TlsError::Unfit(error.to_string());
        let mut roots = RootCertStore::empty();
        roots.add(certificate(&files.authority)?).map_err(|error| unfit(&error))?;
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let verifier =
            WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider));
        let verifier = verifier.build().map_err(|error| unfit(&error))?;
        let config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(|error| unfit(&error))?
            .with_client_cert_verifier(verifier)
            .with_single_cert(vec![certificate(&files.certificate)?], key)
            .map_err(|error| unfit(&error))?;
        let acceptor = TlsAcceptor::from(Arc::new(config));
        Ok(TlsServer { acceptor, is_revoked: Arc::new(is_revoked) })
    }

    /// Completes the handshake with a client.
    ///
    /// # Errors
    ///
    /// Returns an error if the client has no certificate of the authority, or a revoked one.
    pub(crate) async fn accept(&self, stream: TcpStream) -> io::Result<TlsStream<TcpStream>> {
        let stream = self.acceptor.accept(stream).await?;
        let (_, session) = stream.get_ref();
        let certificate = session.peer_certificates().and_then(<[_]>::first);
        match certificate {
            Some(certificate) if !(self.is_revoked)(certificate.as_ref()) => Ok(stream),
            _ => Err(io::Error::new(io::ErrorKind::PermissionDenied, "its certificate is revoked")),
        }
    }
}

fn unreadable(path: &Path, problem: &dyn fmt::Display) -> TlsError {
    TlsError::File { path: path.to_owned(), problem: problem.to_string() }
}
