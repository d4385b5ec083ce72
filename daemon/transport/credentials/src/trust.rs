//! The trust of an ecosystem: the certificate of its authority, and the certificates that were
//! revoked.

use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use rustls_pki_types::{TrustAnchor, UnixTime};
use webpki::{EndEntityCert, KeyUsage};

use crate::certificate::Certificate;
use crate::error::{CredentialError, DistrustReason};
use crate::files::{self, CredentialFolder};
use crate::revocations::Revocations;

/// The certificate of an ecosystem's authority, and the newest list of revocations.
#[derive(Clone, Debug)]
pub struct Trust {
    folder: CredentialFolder,
    /// File for lists of revocations that come over the network; by default the file in the folder
    /// of credentials.
    stored_list: PathBuf,
    authority: Certificate,
    anchor: TrustAnchor<'static>,
    revocations: Option<Revocations>,
}

// === impl Trust ===

impl Trust {
    /// Reads the authority's certificate and the list of revocations from the folder.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder contains no certificate of an authority, or if a file cannot
    /// be read.
    pub fn read(folder: &CredentialFolder) -> Result<Trust, CredentialError> {
        let path = folder.authority();
        if !path.exists() {
            let remedy = "make one with `althing cert authority`, or copy it from the machine \
                          where that was done"
                .to_owned();
            let what = "the authority's certificate";
            return Err(CredentialError::Missing { what, path, remedy });
        }
        files::check_not_world_writable(folder, &path)?;
        let authority = Certificate::read(&path)?;
        if authority.public_key.is_none() {
            let problem = "it is not one that `althing cert authority` has made (Ed25519)";
            return Err(CredentialError::Malformed { path, problem: problem.to_owned() });
        }
        let anchor = webpki::anchor_from_trusted_cert(&authority.der)
            .map_err(|error| CredentialError::Malformed { path, problem: error.to_string() })?
            .to_owned();
        let (folder, kept) = (folder.clone(), folder.revocations());
        let mut trust = Trust { folder, stored_list: kept, authority, anchor, revocations: None };
        trust.revocations = trust.read_revocations()?;
        Ok(trust)
    }

    /// Stores lists of revocations that come over the network in the file `kept`, not in the folder
    /// of credentials, which the daemon may not be able to write. Also reads the list that was
    /// stored in that file before.
    ///
    /// # Errors
    ///
    /// Returns an error if a list of revocations cannot be read, or the authority has not signed
    /// it.
    pub fn storing_at(mut self, kept: PathBuf) -> Result<Trust, CredentialError> {
        self.stored_list = kept;
        self.revocations = self.read_revocations()?;
        Ok(self)
    }

    /// Returns the authority's certificate.
    pub fn authority(&self) -> &Certificate {
        &self.authority
    }

    /// Returns the newest list of revocations that is known; `None` if there is none.
    pub fn revocations(&self) -> Option<&Revocations> {
        self.revocations.as_ref()
    }

    /// Reads the files again and returns the newest list of revocations in them; `None` if there is
    /// none.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be read, or the authority has not signed the list in it.
    pub fn read_revocations(&self) -> Result<Option<Revocations>, CredentialError> {
        let own = self.folder.revocations();
        let kept = Some(&self.stored_list).filter(|kept| **kept != own);
        let mut newest: Option<Revocations> = None;
        for path in kept.into_iter().chain([&own]).filter(|path| path.exists()) {
            let list = Revocations::from_pem(&files::read(path)?, &self.authority);
            let list = list.ok_or_else(|| CredentialError::Malformed {
                path: path.clone(),
                problem: "it is not a list of revocations signed by this ecosystem's authority"
                    .to_owned(),
            })?;
            if newest.as_ref().is_none_or(|newest| newest.number() < list.number()) {
                newest = Some(list);
            }
        }
        Ok(newest)
    }

    /// Parses a list of revocations that came over the network. Returns `None` if the authority has
    /// not signed it.
    pub fn verify_revocations(&self, der: &[u8]) -> Option<Revocations> {
        Revocations::from_der(der, &self.authority)
    }

    /// Replaces the known list of revocations by `list` if that is newer; returns whether it was
    /// newer.
    pub(crate) fn take(&mut self, list: Revocations) -> bool {
        let is_newer = self.revocations.as_ref().is_none_or(|known| known.number() < list.number());
        if is_newer {
            self.revocations = Some(list);
        }
        is_newer
    }

    /// Stores a list of revocations for the next run of this daemon.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn store(&self, list: &Revocations) -> Result<(), CredentialError> {
        let text = pem::encode(&pem::Pem::new("X509 CRL", list.der()));
        files::replace(&self.stored_list, &text, 0o644)
    }

    /// Checks that a certificate was issued to a daemon of this ecosystem, was not revoked, and is
    /// valid at the time `now`.
    ///
    /// # Errors
    ///
    /// Returns the reason if the certificate fails the check.
    pub fn check(&self, certificate: &Certificate, now: SystemTime) -> Result<(), DistrustReason> {
        if certificate.daemon().is_none() || certificate.public_key.is_none() {
            return Err(DistrustReason::Stranger);
        }
        let read =
            EndEntityCert::try_from(&certificate.der).map_err(|_| DistrustReason::Stranger)?;
        let time = UnixTime::since_unix_epoch(now.duration_since(UNIX_EPOCH).unwrap_or_default());
        let (anchors, usage) = (std::slice::from_ref(&self.anchor), KeyUsage::client_auth());
        let algorithms = &[webpki::ring::ED25519];
        read.verify_for_usage(algorithms, anchors, &[], time, usage, None, None).map_err(
            |error| match error {
                webpki::Error::CertExpired { .. } | webpki::Error::CertNotValidYet { .. } => {
                    DistrustReason::Expired
                }
                _ => DistrustReason::Stranger,
            },
        )?;
        match &self.revocations {
            Some(list) if list.contains(certificate) => Err(DistrustReason::Revoked),
            _ => Ok(()),
        }
    }
}
