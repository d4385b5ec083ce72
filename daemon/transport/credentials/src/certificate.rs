//! Certificates, with their parsed content.

use std::net::IpAddr;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::DaemonId;
use rustls_pki_types::CertificateDer;
use rustls_pki_types::pem::PemObject as _;
use x509_parser::extensions::GeneralName;
use x509_parser::prelude::{FromDer as _, X509Certificate};

use crate::error::CredentialError;
use crate::files;

/// A certificate and its parsed content. Whether the certificate is trusted is checked by
/// [`crate::Trust`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Certificate {
    /// The certificate, in DER.
    pub(crate) der: CertificateDer<'static>,
    /// Common name of the certificate's subject: the name of a daemon, or the description of the
    /// authority.
    pub subject: String,
    /// Serial number, which distinguishes the certificate from others of the same authority.
    pub serial: Vec<u8>,
    /// Time from which the certificate is valid.
    pub not_before: SystemTime,
    /// Time until which the certificate is valid.
    pub not_after: SystemTime,
    /// Host names and addresses at which the daemon is reached.
    pub hosts: Vec<String>,
    /// The Ed25519 public key in the certificate; `None` if the key is of another kind.
    pub(crate) public_key: Option<[u8; 32]>,
}

// === impl Certificate ===

impl Certificate {
    /// Reads a certificate from a PEM file.
    ///
    /// # Errors
    ///
    /// Returns an error if the file does not exist, or contains no certificate.
    pub fn read(path: &Path) -> Result<Certificate, CredentialError> {
        let text = files::read(path)?;
        let malformed = |problem: &str| CredentialError::Malformed {
            path: path.to_owned(),
            problem: problem.to_owned(),
        };
        let der = CertificateDer::from_pem_slice(text.as_bytes())
            .map_err(|_| malformed("there is no certificate in it"))?;
        Certificate::from_der(&der).ok_or_else(|| malformed("its certificate cannot be read"))
    }

    /// Parses a certificate in DER that comes from outside. Returns `None` if the bytes are no
    /// certificate.
    pub(crate) fn from_der(der: &[u8]) -> Option<Certificate> {
        let (rest, read) = X509Certificate::from_der(der).ok()?;
        if !rest.is_empty() {
            return None;
        }
        let subject = read.subject().iter_common_name().next()?.as_str().ok()?.to_owned();
        let public_key = read.public_key().subject_public_key.data.as_ref();
        let is_ed25519 =
            read.public_key().algorithm.algorithm == x509_parser::oid_registry::OID_SIG_ED25519;
        Some(Certificate {
            subject,
            serial: read.raw_serial().to_vec(),
            not_before: at(read.validity().not_before.timestamp()),
            not_after: at(read.validity().not_after.timestamp()),
            hosts: hosts(&read),
            public_key: is_ed25519.then(|| public_key.try_into().ok()).flatten(),
            der: CertificateDer::from(der.to_vec()),
        })
    }

    /// Returns the daemon for which the certificate was issued; `None` if the certificate is not
    /// one of a daemon.
    pub fn daemon(&self) -> Option<DaemonId> {
        DaemonId::new(&self.subject).ok().filter(crate::is_certifiable)
    }

    /// Whether the name constraints of this authority's certificate permit a host name or an
    /// address. Without name constraints, all are permitted.
    pub(crate) fn permits(&self, host: &str) -> bool {
        let Ok((_, read)) = X509Certificate::from_der(&self.der) else { return false };
        let Ok(Some(constraints)) = read.name_constraints() else { return true };
        let permitted = constraints.value.permitted_subtrees.iter().flatten();
        let address = host.parse::<IpAddr>().ok();
        permitted.into_iter().any(|subtree| match (&subtree.base, address) {
            (GeneralName::DNSName(domain), None) => {
                host == *domain || host.strip_suffix(domain).is_some_and(|rest| rest.ends_with('.'))
            }
            (GeneralName::IPAddress(network), Some(address)) => is_in_network(address, network),
            _ => false,
        })
    }

    /// Returns how long the certificate is still valid at the time `now`; zero if it has expired.
    pub fn remaining(&self, now: SystemTime) -> Duration {
        self.not_after.duration_since(now).unwrap_or_default()
    }

    /// Whether the certificate is valid at the time `now`.
    pub(crate) fn is_current(&self, now: SystemTime) -> bool {
        self.not_before <= now && now <= self.not_after
    }
}

fn at(seconds: i64) -> SystemTime {
    UNIX_EPOCH + Duration::from_secs(u64::try_from(seconds).unwrap_or(0))
}

fn hosts(read: &X509Certificate<'_>) -> Vec<String> {
    let Ok(Some(names)) = read.subject_alternative_name() else { return Vec::new() };
    let host = |name: &GeneralName<'_>| match name {
        GeneralName::DNSName(name) => Some((*name).to_owned()),
        GeneralName::IPAddress(bytes) => address(bytes),
        _ => None,
    };
    names.value.general_names.iter().filter_map(host).collect()
}

/// Whether an address is in a network, given as its address followed by its mask.
fn is_in_network(address: IpAddr, network: &[u8]) -> bool {
    let octets = match address {
        IpAddr::V4(address) => address.octets().to_vec(),
        IpAddr::V6(address) => address.octets().to_vec(),
    };
    if network.len() != octets.len() * 2 {
        return false;
    }
    let (base, mask) = network.split_at(octets.len());
    octets.iter().zip(base).zip(mask).all(|((own, base), mask)| own & mask == base & mask)
}

fn address(bytes: &[u8]) -> Option<String> {
    let v4 = <[u8; 4]>::try_from(bytes).ok().map(IpAddr::from);
    let v6 = || <[u8; 16]>::try_from(bytes).ok().map(IpAddr::from);
    v4.or_else(v6).map(|address| address.to_string())
}
