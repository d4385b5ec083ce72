//! The list of revoked certificates (an X.509 CRL). The list is accepted because the authority has
//! signed it, whichever daemon sends it.

use std::collections::BTreeSet;

use ring::signature::{ED25519, UnparsedPublicKey};
use rustls_pki_types::CertificateRevocationListDer;
use rustls_pki_types::pem::PemObject as _;
use x509_parser::prelude::FromDer as _;
use x509_parser::revocation_list::CertificateRevocationList;

use crate::certificate::Certificate;

/// A list of revoked certificates with a verified signature.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revocations {
    der: Vec<u8>,
    number: u64,
    serials: BTreeSet<Vec<u8>>,
}

// === impl Revocations ===

impl Revocations {
    /// Parses a list in DER. Returns `None` if the list is malformed or the authority has not
    /// signed it.
    pub(crate) fn from_der(der: &[u8], authority: &Certificate) -> Option<Revocations> {
        let (rest, list) = CertificateRevocationList::from_der(der).ok()?;
        let key = UnparsedPublicKey::new(&ED25519, authority.public_key?);
        let signed = list.tbs_cert_list.as_ref();
        if !rest.is_empty() || key.verify(signed, &list.signature_value.data).is_err() {
            return None;
        }
        let number = list.crl_number().and_then(|number| u64::try_from(number).ok())?;
        let serials = list.iter_revoked_certificates().map(|each| each.raw_serial().to_vec());
        Some(Revocations { der: der.to_vec(), number, serials: serials.collect() })
    }

    pub(crate) fn from_pem(text: &str, authority: &Certificate) -> Option<Revocations> {
        let der = CertificateRevocationListDer::from_pem_slice(text.as_bytes()).ok()?;
        Revocations::from_der(&der, authority)
    }

    /// Returns the list in DER, the form in which it is sent.
    pub fn der(&self) -> &[u8] {
        &self.der
    }

    /// Returns the number of the list, which is greater than that of every earlier list.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Whether `certificate` is on the list.
    pub fn contains(&self, certificate: &Certificate) -> bool {
        self.serials.contains(&certificate.serial)
    }

    pub(crate) fn serials(&self) -> impl Iterator<Item = &Vec<u8>> {
        self.serials.iter()
    }
}
