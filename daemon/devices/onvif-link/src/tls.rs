//! TLS to cameras. Cameras sign their certificates themselves, often without a name in them, so
//! that a certificate can also be trusted as it is.

use std::sync::Arc;

use ring::digest::SHA256;
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, verify_tls12_signature, verify_tls13_signature};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error, RootCertStore, SignatureScheme,
};

use crate::access::{TrustedCertificate, read};
use crate::digest::hex;
use crate::error::LinkError;

/// Returns the TLS settings for a camera that may show the certificates of `trust`.
pub(crate) fn settings(trust: &TrustedCertificate) -> Result<ClientConfig, LinkError> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let said = |problem: String| LinkError::File(format!("use TLS with the camera: {problem}"));
    let verifier = match trust {
        TrustedCertificate::Fingerprint(fingerprint) => CameraCertificateVerifier {
            fingerprints: vec![*fingerprint],
            authorities: None,
            provider: Arc::clone(&provider),
        },
        TrustedCertificate::File(file) => {
            let named = |problem: String| {
                LinkError::File(format!("use the certificates in {}: {problem}", file.display()))
            };
            let found = CertificateDer::pem_slice_iter(&read(file)?).collect::<Result<Vec<_>, _>>();
            let found = found.map_err(|error| named(error.to_string()))?;
            if found.is_empty() {
                return Err(named("there is none".to_owned()));
            }
            let fingerprints = found.iter().map(|certificate| fingerprint(certificate)).collect();
            let mut roots = RootCertStore::empty();
            roots.add_parsable_certificates(found);
            let authorities =
                WebPkiServerVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider))
                    .build()
                    .ok();
            CameraCertificateVerifier { fingerprints, authorities, provider: Arc::clone(&provider) }
        }
    };
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| said(error.to_string()))?;
    let config = config.dangerous().with_custom_certificate_verifier(Arc::new(verifier));
    Ok(config.with_no_client_auth())
}

fn fingerprint(certificate: &[u8]) -> [u8; 32] {
    let mut fingerprint = [0; 32];
    fingerprint.copy_from_slice(ring::digest::digest(&SHA256, certificate).as_ref());
    fingerprint
}

/// Verifier that accepts a known certificate, whatever its names and dates, and a certificate that
/// a known authority has signed.
#[derive(Debug)]
struct CameraCertificateVerifier {
    fingerprints: Vec<[u8; 32]>,
    authorities: Option<Arc<WebPkiServerVerifier>>,
    provider: Arc<CryptoProvider>,
}

impl ServerCertVerifier for CameraCertificateVerifier {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        name: &ServerName<'_>,
        ocsp: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        let shown = fingerprint(certificate);
        if self.fingerprints.contains(&shown) {
            return Ok(ServerCertVerified::assertion());
        }
        match &self.authorities {
            Some(authorities) => {
                authorities.verify_server_cert(certificate, intermediates, name, ocsp, now)
            }
            None => {
                tracing::debug!(
                    fingerprint = hex(&shown),
                    "the certificate of a camera is unknown"
                );
                Err(Error::InvalidCertificate(CertificateError::UnknownIssuer))
            }
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        let algorithms = &self.provider.signature_verification_algorithms;
        verify_tls12_signature(message, certificate, signature, algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        let algorithms = &self.provider.signature_verification_algorithms;
        verify_tls13_signature(message, certificate, signature, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.provider.signature_verification_algorithms.supported_schemes()
    }
}
