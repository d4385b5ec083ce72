//! The authority of an ecosystem: issues certificates for its daemons, and revokes them.

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::{DaemonId, EcosystemId};
use rcgen::{
    BasicConstraints, CertificateParams, CertificateRevocationListParams, DistinguishedName,
    DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyIdMethod, KeyPair, KeyUsagePurpose,
    PKCS_ED25519, RevocationReason, RevokedCertParams, SanType, SerialNumber, SignatureAlgorithm,
};
use time::OffsetDateTime;

use crate::certificate::Certificate;
use crate::error::CredentialError;
use crate::files::{self, CredentialFolder};
use crate::is_certifiable;
use crate::revocations::Revocations;
use crate::trust::Trust;

/// Default validity of an authority's certificate, in days: ten years, as long as the devices of a
/// building last.
pub const AUTHORITY_DAYS: u32 = 3_650;

/// Default validity of a daemon's certificate, in days: two years. Renewal is then frequent enough
/// to be remembered and rare enough not to be a burden.
pub const DAEMON_DAYS: u32 = 730;

/// How far the start of a certificate's validity is set back from now, because the clocks of boards
/// without a battery run behind.
const BACKDATED: Duration = Duration::from_secs(24 * 3_600);

/// The unit of the validity of certificates.
const DAY: Duration = Duration::from_secs(24 * 3_600);

/// Kind of the keys of an authority, for a person.
const KEY_KIND: &str = "a key that `althing cert` has made (Ed25519)";

/// Mode of a key file: only its owner may read and write it.
pub(crate) const KEY_MODE: u32 = 0o600;
/// Mode of a file that every user may read.
pub(crate) const PUBLIC_MODE: u32 = 0o644;

/// The authority of an ecosystem, with its key.
pub struct Authority {
    folder: CredentialFolder,
    certificate: Certificate,
    issuer: Issuer<'static, KeyPair>,
}

impl std::fmt::Debug for Authority {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Authority").field("folder", &self.folder).finish_non_exhaustive()
    }
}

// === impl Authority ===

impl Authority {
    /// Creates an authority: writes the files `authority.pem` and `authority.key`.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder contains an authority already, or cannot be written.
    pub fn create(
        folder: &CredentialFolder,
        ecosystem: &EcosystemId,
        days: u32,
    ) -> Result<Authority, CredentialError> {
        folder.make()?;
        let exists = |path: PathBuf| path.exists().then_some(CredentialError::Exists { path });
        if let Some(error) = exists(folder.authority_key()).or_else(|| exists(folder.authority())) {
            return Err(error);
        }
        let mut params = CertificateParams::default();
        params.distinguished_name = name(&format!("authority of {ecosystem}"), ecosystem.as_str());
        set_validity(&mut params, days);
        write_issuer(folder, params, &PKCS_ED25519)?;
        Authority::open(folder)
    }

    /// Opens the authority in this folder.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder contains no authority, or if other users can read the
    /// authority's key.
    pub fn open(folder: &CredentialFolder) -> Result<Authority, CredentialError> {
        let path = folder.authority_key();
        if !path.exists() {
            let remedy = "certificates are made where `althing cert authority` was run; say which \
                          folder that is with --folder"
                .to_owned();
            return Err(CredentialError::Missing { what: "the authority's key", path, remedy });
        }
        let (certificate, issuer) = read_issuer(folder, &PKCS_ED25519, KEY_KIND)?;
        Ok(Authority { folder: folder.clone(), certificate, issuer })
    }

    /// Returns the authority's certificate.
    pub fn certificate(&self) -> &Certificate {
        &self.certificate
    }

    /// Issues a key and a certificate for a daemon: writes the files `NAME.key` and `NAME.pem`. An
    /// older certificate of that name in the folder is replaced; the older certificate stays valid
    /// until it expires or is revoked.
    ///
    /// # Errors
    ///
    /// Returns an error if the name or a host is not allowed in a certificate, or if the folder
    /// cannot be written.
    pub fn issue(
        &self,
        daemon: &DaemonId,
        hosts: &[String],
        days: u32,
    ) -> Result<Certificate, CredentialError> {
        let is_file_of_ours = ["authority", "revoked"].contains(&daemon.as_str());
        if !is_certifiable(daemon) || is_file_of_ours {
            return Err(CredentialError::Name(daemon.to_string()));
        }
        let mut params = CertificateParams::default();
        params.distinguished_name = name(daemon.as_str(), &self.certificate.subject);
        params.subject_alt_names = alternative_names(daemon, hosts)?;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages =
            vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
        params.use_authority_key_identifier_extension = true;
        set_validity(&mut params, days);
        let key = KeyPair::generate_for(&PKCS_ED25519)?;
        let certificate = params.signed_by(&key, &self.issuer)?;
        files::replace(&self.folder.key(daemon), &key.serialize_pem(), KEY_MODE)?;
        files::replace(&self.folder.certificate(daemon), &certificate.pem(), PUBLIC_MODE)?;
        let made = Certificate::read(&self.folder.certificate(daemon))?;
        let copy = format!("{daemon}-{}.pem", hexadecimal(&made.serial));
        files::replace(&self.folder.issued().join(copy), &certificate.pem(), PUBLIC_MODE)?;
        Ok(made)
    }

    /// Returns all certificates that the authority has issued, sorted by name and expiry.
    pub fn issued(&self) -> Vec<Certificate> {
        let Ok(entries) = std::fs::read_dir(self.folder.issued()) else { return Vec::new() };
        let read = entries.flatten().filter_map(|entry| Certificate::read(&entry.path()).ok());
        let mut issued: Vec<_> = read.filter(|each| each.daemon().is_some()).collect();
        issued.sort_by(|a, b| (&a.subject, a.not_after).cmp(&(&b.subject, b.not_after)));
        issued
    }

    /// Revokes all certificates of a daemon: writes the file `revoked.pem`. Returns the number of
    /// certificates that were not revoked before.
    ///
    /// # Errors
    ///
    /// Returns an error if the authority has issued no certificate for the daemon, or if the folder
    /// cannot be written.
    pub fn revoke(&self, daemon: &DaemonId) -> Result<usize, CredentialError> {
        let issued = self.issued();
        let is_meant = |each: &&Certificate| each.subject == daemon.as_str();
        let meant: Vec<_> = issued.iter().filter(is_meant).map(|each| &each.serial).collect();
        if meant.is_empty() {
            let mut known: Vec<_> = issued.into_iter().map(|each| each.subject).collect();
            known.dedup();
            return Err(CredentialError::Unknown { name: daemon.to_string(), known });
        }
        let trust = Trust::read(&self.folder)?;
        let (mut serials, number) = match trust.revocations() {
            Some(list) => (list.serials().cloned().collect::<Vec<_>>(), list.number() + 1),
            None => (Vec::new(), 1),
        };
        let count = meant.iter().filter(|serial| !serials.contains(serial)).count();
        serials.extend(meant.into_iter().cloned());
        serials.sort();
        serials.dedup();
        let now = OffsetDateTime::from(SystemTime::now());
        let revoked = |serial: &Vec<u8>| RevokedCertParams {
            serial_number: SerialNumber::from_slice(serial),
            revocation_time: now,
            reason_code: Some(RevocationReason::PrivilegeWithdrawn),
            invalidity_date: None,
        };
        let list = CertificateRevocationListParams {
            this_update: now,
            next_update: now + DAY * AUTHORITY_DAYS,
            crl_number: SerialNumber::from(number),
            issuing_distribution_point: None,
            revoked_certs: serials.iter().map(revoked).collect(),
            key_identifier_method: KeyIdMethod::Sha256,
        };
        let text = list.signed_by(&self.issuer)?.pem()?;
        debug_assert!(Revocations::from_pem(&text, &self.certificate).is_some());
        files::replace(&self.folder.revocations(), &text, PUBLIC_MODE)?;
        Ok(count)
    }
}

/// Makes a key, and certifies it by itself as that of an issuer of certificates: writes both files.
/// `params` has the name, the validity, and what the issuer may vouch for.
pub(crate) fn write_issuer(
    folder: &CredentialFolder,
    mut params: CertificateParams,
    algorithm: &'static SignatureAlgorithm,
) -> Result<(), CredentialError> {
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let key = KeyPair::generate_for(algorithm)?;
    let certificate = params.self_signed(&key)?;
    files::write_new(&folder.authority_key(), &key.serialize_pem(), KEY_MODE)?;
    files::write_new(&folder.authority(), &certificate.pem(), PUBLIC_MODE)
}

/// Reads the key and the certificate of an issuer. `kind` names the keys that `althing cert` makes
/// for it, for a person.
pub(crate) fn read_issuer(
    folder: &CredentialFolder,
    algorithm: &'static SignatureAlgorithm,
    kind: &str,
) -> Result<(Certificate, Issuer<'static, KeyPair>), CredentialError> {
    let path = folder.authority_key();
    let key = files::read_key(&path)?;
    let certificate = Certificate::read(&folder.authority())?;
    let key = KeyPair::from_pkcs8_der_and_sign_algo(&key, algorithm).map_err(|_| {
        let problem = format!("it is not {kind}");
        CredentialError::Malformed { path, problem }
    })?;
    let issuer = Issuer::from_ca_cert_der(&certificate.der, key)?;
    Ok((certificate, issuer))
}

pub(crate) fn name(common: &str, organization: &str) -> DistinguishedName {
    let mut name = DistinguishedName::new();
    name.push(DnType::OrganizationName, organization);
    name.push(DnType::CommonName, common);
    name
}

/// Sets the validity of a certificate: from a day before now until `days` days after now.
pub(crate) fn set_validity(params: &mut CertificateParams, days: u32) {
    let now = SystemTime::now();
    params.not_before = OffsetDateTime::from(now.checked_sub(BACKDATED).unwrap_or(UNIX_EPOCH));
    params.not_after = OffsetDateTime::from(now) + DAY * days;
}

/// Returns the names for which a certificate is valid: the daemon's name, its mDNS name, and the
/// given hosts.
pub(crate) fn alternative_names(
    daemon: &DaemonId,
    hosts: &[String],
) -> Result<Vec<SanType>, CredentialError> {
    // A host name has no underscore, so a daemon's name with an underscore is left out.
    let own = [daemon.to_string(), format!("{daemon}.local")];
    let own = own.into_iter().filter(|name| !name.contains('_'));
    let mut names = Vec::new();
    for host in own.chain(hosts.iter().cloned()) {
        let name = match host.parse::<IpAddr>() {
            Ok(address) => SanType::IpAddress(address),
            Err(_) if is_host(&host) => SanType::DnsName(host.as_str().try_into()?),
            Err(_) => return Err(CredentialError::Host(host)),
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    Ok(names)
}

/// Whether a text is a host name.
pub(crate) fn is_host(text: &str) -> bool {
    let is_label = |label: &str| {
        let plain = label.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-');
        plain && !label.is_empty() && !label.starts_with('-') && !label.ends_with('-')
    };
    text.len() <= 253 && text.split('.').all(is_label)
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
