//! Spreading of revocations: every daemon periodically sends its list of revoked certificates to
//! all daemons, and takes a newer list from others. A list is accepted because of the authority's
//! signature, whichever daemon sends it.
//!
//! New links with a revoked daemon are refused. Existing links are closed when the list is next
//! checked, within a second. Until then, daemons that can be reached only over such a link may
//! still receive the list.
//!
//! The list enters the ecosystem as a file in the folder of any daemon.

use std::net::SocketAddr;
use std::sync::{Arc, Weak};
use std::time::Duration;

use credentials::{DistrustReason, Verifier};
use substrate::{Inbound, Rejected, ViolationKind};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tracing::Instrument as _;
use zenoh::pubsub::Subscriber;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};
use zenoh_link_tls::admission::{self, Admission};
use zenoh_link_tls::reading;

use crate::inbound::into_bytes;
use crate::key_expr::KeySpace;
use crate::open_error::{OpenError, undeclared};
use crate::sealing::Security;

/// How often the file with the list of revoked certificates is checked.
const REREAD_PERIOD: Duration = Duration::from_secs(1);

/// How often the list of revoked certificates is sent to all daemons: a daemon that was cut off
/// receives it within this time.
const REPEAT_PERIOD: Duration = Duration::from_secs(10);

/// Declares the subscriber for lists of revoked certificates. `telling` is the number of times that
/// all declarations were made again.
pub(crate) fn declare(
    session: &Session,
    keys: &KeySpace,
    inbound: &Arc<dyn Inbound>,
    security: &Security,
    telling: u64,
) -> Result<Subscriber<()>, OpenError> {
    let key_expr = keys.every_revocation(telling);
    let (hearing, inbound) = (Arc::clone(&security.verifier), Arc::clone(inbound));
    let hear = move |sample: Sample| receive_list(&hearing, &*inbound, &sample);
    let subscriber = session.declare_subscriber(&key_expr).callback(hear);
    subscriber.wait().map_err(|source| undeclared("subscriber", &key_expr, source))
}

/// Installs the check that rejects links with revoked certificates, and reports every rejected link
/// to `inbound`. Must be called before the session is opened.
pub(crate) fn admission(security: &Security, inbound: &Arc<dyn Inbound>) -> Arc<Admission> {
    let (verifier, inbound) = (Arc::clone(&security.verifier), Arc::downgrade(inbound));
    let (key, _, _) = security.identity.files();
    let told = Weak::clone(&inbound);
    let admits = move |certificate: &[u8], from| {
        let Some(subject) = verifier.revoked_subject(certificate) else { return true };
        refused(
            &inbound,
            ViolationKind::Revoked,
            Some(&subject),
            from,
            &DistrustReason::Revoked.to_string(),
        );
        false
    };
    let unlinked = move |from, why: &str| {
        let detail = format!("would have come over a link that was refused: {why}");
        refused(&told, ViolationKind::RefusedLink, None, from, &detail);
    };
    admission::decide(key.to_string_lossy().into_owned(), admits, unlinked)
}

fn refused(
    inbound: &Weak<dyn Inbound>,
    violation: ViolationKind,
    claimed: Option<&str>,
    from: SocketAddr,
    detail: &str,
) {
    if let Some(inbound) = inbound.upgrade() {
        let key = format!("a link with {from}");
        inbound.rejected(&Rejected { violation, detail, claimed, key: &key });
    }
}

/// Starts the task that sends the list of revoked certificates.
///
/// # Panics
///
/// Panics outside a Tokio runtime.
pub(crate) fn spread(
    session: &Arc<Session>,
    keys: &KeySpace,
    security: &Security,
    admission: Arc<Admission>,
) {
    let told =
        send_periodically(Arc::downgrade(session), keys.clone(), security.clone(), admission);
    tokio::spawn(told.instrument(tracing::debug_span!("revocations")));
}

fn receive_list(verifier: &Verifier, inbound: &dyn Inbound, sample: &Sample) {
    if sample.kind() != SampleKind::Put {
        return;
    }
    match verifier.take_revocations(&into_bytes(sample.payload())) {
        Some(true) => {
            tracing::warn!("certificates were revoked: a new list has come");
            if let Err(error) = verifier.store_revocations() {
                tracing::error!("failed to keep the list of revocations: {error}");
            }
        }
        Some(false) => (),
        None => {
            // The sender does not matter, as a list has no other seal than the authority's. The
            // link over which it came only shows the daemon that relayed it last.
            let peer = reading::peer();
            let claimed = peer.as_ref().and_then(|peer| peer.name.as_deref());
            let detail = "is a list of revocations that the authority has not signed";
            let (violation, key) = (ViolationKind::Forged, sample.key_expr().as_str());
            inbound.rejected(&Rejected { violation, detail, claimed, key });
        }
    }
}

/// Sends the list of revoked certificates to all daemons until the session is closed.
async fn send_periodically(
    session: Weak<Session>,
    keys: KeySpace,
    security: Security,
    admission: Arc<Admission>,
) {
    let Security { identity, verifier } = security;
    let mut is_revoked = false;
    let mut ticks = interval(REREAD_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut told, mut complained) = (None::<Instant>, None::<String>);
    // Existing links were admitted under the first revision of the list.
    let mut admitted_by = 0;
    loop {
        ticks.tick().await;
        let Some(session) = session.upgrade().filter(|session| !session.is_closed()) else {
            return;
        };
        if std::mem::replace(&mut admitted_by, verifier.revocations_revision())
            != verifier.revocations_revision()
        {
            admission.look_again();
        }
        let is_news = match verifier.reread_revocations() {
            Ok(is_news) => {
                complained = None;
                is_news
            }
            Err(error) => {
                let error = error.to_string();
                if complained.as_ref() != Some(&error) {
                    tracing::error!("failed to {error}");
                }
                complained = Some(error);
                false
            }
        };
        if is_news {
            tracing::warn!("certificates were revoked: there is a new list here");
        }
        if !is_revoked && verifier.has_revoked(identity.certificate()) {
            is_revoked = true;
            tracing::error!(
                "the certificate of this daemon was revoked: no daemon accepts it any more"
            );
        }
        let is_due = told.is_none_or(|told| told.elapsed() >= REPEAT_PERIOD);
        if (is_news || is_due)
            && let Some(list) = verifier.revocations()
        {
            told = Some(Instant::now());
            let put = session.put(keys.revoked(), list);
            let put = put.congestion_control(CongestionControl::Drop).priority(Priority::DataHigh);
            if let Err(error) = put.wait() {
                tracing::debug!(%error, "the list of revocations was not sent");
            }
        }
    }
}
