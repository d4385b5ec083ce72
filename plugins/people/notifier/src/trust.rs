//! The certificates that a receiver may show: those of the authorities that this machine trusts, or
//! those of a file.

use std::path::PathBuf;
use std::sync::Arc;

use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use rustls::{ClientConfig, RootCertStore};

use crate::send_failure::SendFailure;

/// The authorities that a receiver's certificate may come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ReceiverTrust {
    /// The authorities that this machine trusts.
    Machine,
    /// The authorities in a file.
    File(PathBuf),
}

// === impl ReceiverTrust ===

impl ReceiverTrust {
    /// Reads the certificates anew, so that a changed file counts at once.
    pub(crate) async fn client(&self) -> Result<Arc<ClientConfig>, SendFailure> {
        let trust = self.clone();
        let read = tokio::task::spawn_blocking(move || trust.read()).await;
        let roots = read.map_err(|error| error.to_string()).flatten();
        let config = roots.and_then(|roots| settings(roots).map_err(|error| error.to_string()));
        config.map(Arc::new).map_err(SendFailure::later)
    }

    fn read(&self) -> Result<RootCertStore, String> {
        let mut roots = RootCertStore::empty();
        let (found, place) = match self {
            ReceiverTrust::Machine => {
                let found = rustls_native_certs::load_native_certs().certs;
                (found, "the certificates that this machine trusts".to_owned())
            }
            ReceiverTrust::File(file) => {
                let place = file.display().to_string();
                let pem = std::fs::read(file).map_err(|error| format!("read {place}: {error}"))?;
                let found = CertificateDer::pem_slice_iter(&pem).collect::<Result<Vec<_>, _>>();
                (found.map_err(|error| format!("use {place}: {error}"))?, place)
            }
        };
        let (added, _) = roots.add_parsable_certificates(found);
        match added {
            0 => Err(format!("use {place}: there is no certificate of an authority")),
            _ => Ok(roots),
        }
    }
}

fn settings(roots: RootCertStore) -> Result<ClientConfig, rustls::Error> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_certificates_is_no_authority() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("ca.pem");
        let trust = ReceiverTrust::File(file.clone());
        assert!(trust.read().expect_err("no file").contains("ca.pem"));
        std::fs::write(&file, "nothing").expect("a file");
        assert!(trust.read().expect_err("no certificate").contains("no certificate"));
    }
}
