//! The page authority: issues the certificates by which browsers know the pages of daemons.
//!
//! Browsers do not know the Ed25519 keys of an ecosystem's authority, so that pages have an authority
//! of their own, with ECDSA keys. Phones are made to trust it. Its certificate therefore names the
//! hosts that it may vouch for (name constraints): with its key, no other site can be imitated.

use std::net::IpAddr;

use acl::{DaemonId, EcosystemId};
use rcgen::{
    CertificateParams, CidrSubnet, ExtendedKeyUsagePurpose, GeneralSubtree, Issuer, KeyPair,
    KeyUsagePurpose, NameConstraints, PKCS_ECDSA_P256_SHA256, SanType,
};

use crate::authority::{
    AUTHORITY_DAYS, KEY_MODE, PUBLIC_MODE, alternative_names, name, read_issuer, set_validity,
    write_issuer,
};
use crate::certificate::Certificate;
use crate::error::CredentialError;
use crate::files::{self, CredentialFolder};

/// Default validity of a page's certificate, in days. Browsers refuse certificates that are valid
/// for much longer than a year.
pub const PAGE_DAYS: u32 = 397;

/// Kind of the keys of a page authority, for a person.
const KEY_KIND: &str = "a key of pages that `althing cert` has made (ECDSA P-256)";

/// Domains that are no names of the Internet, for which each page authority may vouch.
const LOCAL_DOMAINS: &[&str] = &["local", "lan", "internal", "home.arpa", "localhost"];

/// Networks whose addresses are no addresses of the Internet, each with the length of its prefix.
const PRIVATE_NETWORKS: &[(&str, u8)] = &[
    ("10.0.0.0", 8),
    ("127.0.0.0", 8),
    ("169.254.0.0", 16),
    ("172.16.0.0", 12),
    ("192.168.0.0", 16),
    ("fc00::", 7),
    ("fe80::", 10),
    ("::1", 128),
];

/// The page authority of an ecosystem, with its key.
pub struct PageAuthority {
    folder: CredentialFolder,
    certificate: Certificate,
    issuer: Issuer<'static, KeyPair>,
}

impl std::fmt::Debug for PageAuthority {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PageAuthority").field("folder", &self.folder).finish_non_exhaustive()
    }
}

// === impl PageAuthority ===

impl PageAuthority {
    /// Returns the folder with the certificates of pages, in the folder with those of daemons.
    pub fn folder(credentials: &CredentialFolder) -> CredentialFolder {
        CredentialFolder::new(credentials.path().join("page"))
    }

    /// Opens the page authority in this folder. If there is none, creates one that may vouch for
    /// `daemons` and `hosts`, and for hosts that are not on the Internet. Returns whether it was
    /// created.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be written, or its key cannot be used.
    pub fn open_or_create(
        folder: &CredentialFolder,
        ecosystem: &EcosystemId,
        daemons: &[DaemonId],
        hosts: &[String],
    ) -> Result<(PageAuthority, bool), CredentialError> {
        let is_new = !folder.authority_key().exists() && !folder.authority().exists();
        if is_new {
            PageAuthority::create(folder, ecosystem, daemons, hosts)?;
        }
        Ok((PageAuthority::open(folder)?, is_new))
    }

    fn create(
        folder: &CredentialFolder,
        ecosystem: &EcosystemId,
        daemons: &[DaemonId],
        hosts: &[String],
    ) -> Result<(), CredentialError> {
        folder.make()?;
        let mut params = CertificateParams::default();
        let common = format!("pages of {ecosystem} (althing)");
        params.distinguished_name = name(&common, ecosystem.as_str());
        let permitted_subtrees = permitted(daemons, hosts)?;
        let excluded_subtrees = Vec::new();
        params.name_constraints = Some(NameConstraints { permitted_subtrees, excluded_subtrees });
        set_validity(&mut params, AUTHORITY_DAYS);
        write_issuer(folder, params, &PKCS_ECDSA_P256_SHA256)
    }

    fn open(folder: &CredentialFolder) -> Result<PageAuthority, CredentialError> {
        let path = folder.authority_key();
        if !path.exists() {
            let remedy =
                "certificates of pages are made where the first of them was made".to_owned();
            let what = "the page authority's key";
            return Err(CredentialError::Missing { what, path, remedy });
        }
        let (certificate, issuer) = read_issuer(folder, &PKCS_ECDSA_P256_SHA256, KEY_KIND)?;
        Ok(PageAuthority { folder: folder.clone(), certificate, issuer })
    }

    /// Returns the certificate of the page authority.
    pub fn certificate(&self) -> &Certificate {
        &self.certificate
    }

    /// Issues a key and a certificate for the page of a daemon, which is reached as NAME,
    /// NAME.local, `localhost` and by `hosts`: writes the files `NAME.key` and `NAME.pem`. A running
    /// daemon uses them without a restart.
    ///
    /// # Errors
    ///
    /// Returns an error if the page authority may not vouch for a host, or if the folder cannot be
    /// written.
    pub fn issue(
        &self,
        daemon: &DaemonId,
        hosts: &[String],
        days: u32,
    ) -> Result<Certificate, CredentialError> {
        if !crate::is_certifiable(daemon) || daemon.as_str() == "authority" {
            return Err(CredentialError::Name(daemon.to_string()));
        }
        let local = ["localhost", "127.0.0.1", "::1"].map(str::to_owned);
        let all = [&local, hosts].concat();
        if let Some(host) = all.iter().find(|host| !self.may_vouch_for(host)) {
            return Err(CredentialError::NotVouched {
                host: host.clone(),
                authority: self.folder.authority(),
            });
        }
        let mut params = CertificateParams::default();
        params.distinguished_name = name(daemon.as_str(), &self.certificate.subject);
        params.subject_alt_names = alternative_names(daemon, &all)?;
        // Browsers refuse a certificate with a name for which the authority may not vouch. Of a
        // daemon that was unknown when the authority was made, NAME.local remains.
        let own = daemon.as_str();
        let is_own =
            |name: &SanType| matches!(name, SanType::DnsName(name) if name.as_str() == own);
        if !self.may_vouch_for(own) {
            params.subject_alt_names.retain(|name| !is_own(name));
        }
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
        params.use_authority_key_identifier_extension = true;
        set_validity(&mut params, days);
        let key = KeyPair::generate_for(&PKCS_ECDSA_P256_SHA256)?;
        let certificate = params.signed_by(&key, &self.issuer)?;
        // The certificate comes last: a daemon reads both again when either has changed.
        files::replace(&self.folder.key(daemon), &key.serialize_pem(), KEY_MODE)?;
        files::replace(&self.folder.certificate(daemon), &certificate.pem(), PUBLIC_MODE)?;
        Certificate::read(&self.folder.certificate(daemon))
    }

    /// Whether the name constraints of the authority's certificate permit a host.
    fn may_vouch_for(&self, host: &str) -> bool {
        self.certificate.permits(host)
    }
}

/// Returns the hosts and networks for which a page authority may vouch.
fn permitted(
    daemons: &[DaemonId],
    hosts: &[String],
) -> Result<Vec<GeneralSubtree>, CredentialError> {
    let daemons = daemons.iter().map(DaemonId::to_string).filter(|name| !name.contains('_'));
    let local = LOCAL_DOMAINS.iter().map(|domain| (*domain).to_owned());
    let mut permitted = Vec::new();
    for host in local.chain(daemons).chain(hosts.iter().cloned()) {
        let subtree = match host.parse::<IpAddr>() {
            Ok(IpAddr::V4(address)) => {
                GeneralSubtree::IpAddress(CidrSubnet::V4(address.octets(), [255; 4]))
            }
            Ok(IpAddr::V6(address)) => {
                GeneralSubtree::IpAddress(CidrSubnet::V6(address.octets(), [255; 16]))
            }
            Err(_) if crate::authority::is_host(&host) => GeneralSubtree::DnsName(host),
            Err(_) => return Err(CredentialError::Host(host)),
        };
        permitted.push(subtree);
    }
    for (network, prefix) in PRIVATE_NETWORKS {
        let network = match network.parse() {
            Ok(IpAddr::V4(address)) => CidrSubnet::from_v4_prefix(address.octets(), *prefix),
            Ok(IpAddr::V6(address)) => CidrSubnet::from_v6_prefix(address.octets(), *prefix),
            Err(_) => continue,
        };
        permitted.push(GeneralSubtree::IpAddress(network));
    }
    Ok(permitted)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    fn made(hosts: &[&str]) -> (tempfile::TempDir, PageAuthority) {
        let place = tempfile::tempdir().expect("a folder");
        let folder = PageAuthority::folder(&CredentialFolder::new(place.path()));
        let ecosystem = EcosystemId::new("office").expect("a name");
        let hosts: Vec<_> = hosts.iter().map(|host| (*host).to_owned()).collect();
        let daemons = [daemon("office-pi")];
        let opened = PageAuthority::open_or_create(&folder, &ecosystem, &daemons, &hosts);
        let (authority, is_new) = opened.expect("a page authority");
        assert!(is_new);
        (place, authority)
    }

    #[test]
    fn a_page_is_known_by_its_names_and_addresses() {
        let (_place, authority) = made(&["pi.example.org"]);
        let hosts = ["192.168.1.7".to_owned(), "pi.example.org".to_owned()];
        let made = authority.issue(&daemon("office-pi"), &hosts, PAGE_DAYS).expect("issued");
        for host in ["office-pi", "office-pi.local", "localhost", "192.168.1.7", "pi.example.org"] {
            assert!(made.hosts.iter().any(|known| known == host), "{host}: {:?}", made.hosts);
        }
        let key = std::fs::metadata(authority.folder.key(&daemon("office-pi"))).expect("a key");
        assert_eq!(key.permissions().mode() & 0o777, 0o600);
    }

    #[test]
    fn a_site_of_the_internet_is_not_vouched_for() {
        let (_place, authority) = made(&[]);
        for host in ["example.org", "8.8.8.8", "locall"] {
            let refused = authority.issue(&daemon("office-pi"), &[host.to_owned()], PAGE_DAYS);
            let error = refused.expect_err("no").to_string();
            assert!(error.contains(&format!("`{host}`")), "{error}");
        }
        assert!(authority.issue(&daemon("office-pi"), &["10.1.2.3".to_owned()], 1).is_ok());
        assert!(authority.issue(&daemon("authority"), &[], 1).is_err());
    }

    #[test]
    fn an_authority_is_made_once() {
        let (place, first) = made(&[]);
        let folder = PageAuthority::folder(&CredentialFolder::new(place.path()));
        let ecosystem = EcosystemId::new("office").expect("a name");
        let (again, is_new) =
            PageAuthority::open_or_create(&folder, &ecosystem, &[], &[]).expect("opened");
        assert!(!is_new);
        assert_eq!(again.certificate(), first.certificate());
    }
}
