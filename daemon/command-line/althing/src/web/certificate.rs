//! The certificate of the page: where it is, and that it ends.

use std::time::{Duration, SystemTime};

use acl::DaemonId;
use credentials::{CredentialFolder, PageAuthority};
use terminal::render::plural;
use web_page::{PageTls, PageTlsFiles};

use crate::config::Ecosystem;

/// How long before its end the certificate of a page is told: a month, in which somebody is there.
pub(crate) const WARN_BEFORE: Duration = Duration::from_secs(30 * 24 * 3_600);

/// How often the log says that the certificate ends soon.
const WARNED_EVERY: Duration = Duration::from_secs(24 * 3_600);

/// Seconds of a day.
const DAY_SECONDS: u64 = 24 * 3_600;

/// Returns the files of the certificate with which a daemon serves the page; `None` if it is served
/// without encryption, on an address of this machine alone.
///
/// # Errors
///
/// Returns an error if other machines reach the page and there is no certificate for it. The text
/// completes the sentence “failed to …”.
pub(crate) fn files(
    ecosystem: &Ecosystem,
    daemon: &DaemonId,
) -> Result<Option<PageTlsFiles>, String> {
    let Some(settings) = &ecosystem.web else { return Ok(None) };
    match (&settings.files, &ecosystem.security) {
        (Some(files), _) => {
            let (certificate, key) = (files.certificate.clone(), files.key.clone());
            Ok(Some(PageTlsFiles { certificate, key }))
        }
        (None, _) if settings.listen.ip().is_loopback() => Ok(None),
        (None, Some(security)) => {
            let folder = PageAuthority::folder(&CredentialFolder::new(&security.folder));
            let (certificate, key) = (folder.certificate(daemon), folder.key(daemon));
            Ok(Some(PageTlsFiles { certificate, key }))
        }
        // The configuration allows no such address.
        (None, None) => Err("encrypt it: the ecosystem is not secured".to_owned()),
    }
}

/// Returns the number of whole days until `end`, and how that is said; `None` if it has ended.
pub(crate) fn days_left(end: SystemTime) -> Option<(u64, String)> {
    let left = end.duration_since(SystemTime::now()).ok().filter(|left| !left.is_zero())?;
    let days = left.as_secs() / DAY_SECONDS;
    Some((days, plural(usize::try_from(days).unwrap_or(usize::MAX), "day")))
}

/// Logs once a day that the certificate of the page ends within `before`. Never returns.
pub(super) async fn warn_of_end(tls: Option<PageTls>, daemon: DaemonId, before: Duration) {
    loop {
        let end = tls.as_ref().and_then(PageTls::ends_at);
        let is_soon = end.is_some_and(|end| end <= SystemTime::now() + before);
        // The server itself tells that it has ended.
        if let Some((_, left)) = end.filter(|_| is_soon).and_then(days_left) {
            tracing::warn!(
                "the certificate of the page ends in {left}, and then nothing is served; renew it: \
                 `althing cert page {daemon}` makes one of the ecosystem's own"
            );
        }
        tokio::time::sleep(WARNED_EVERY).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_counted_until_the_end() {
        let in_hours = |hours: u64| SystemTime::now() + Duration::from_secs(hours * 3_600 + 60);
        assert_eq!(days_left(in_hours(30)), Some((1, "1 day".to_owned())));
        assert_eq!(days_left(in_hours(1)), Some((0, "0 days".to_owned())));
        assert_eq!(days_left(SystemTime::UNIX_EPOCH), None);
    }
}
