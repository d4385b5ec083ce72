//! Requests to one camera: their login, the camera's clock, and what its answers mean.

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hyper::body::Bytes;
use ring::rand::{SecureRandom as _, SystemRandom};
use time::OffsetDateTime;
use tokio_rustls::TlsConnector;

use crate::access::{CameraAccess, CameraLogin, login_hint};
use crate::address::Address;
use crate::digest::{Challenge, hex};
use crate::error::{LinkError, excerpt};
use crate::http::{HttpAnswer, HttpRequest, exchange};
use crate::soap::{Addressing, Operation, SoapFault, envelope, open};
use crate::xml::Element;
use crate::{clock, security, tls};

/// Time limit of an operation. Cameras answer within a second, also while they move; a small camera
/// that encrypts needs two for the handshake.
pub(crate) const CALL_TIME_MAX: Duration = Duration::from_secs(8);

/// Maximum length of an answer, in bytes. That of a camera with 256 presets has about 100 kB.
const ANSWER_BYTES_MAX: usize = 2 << 20;

/// Change of the camera's clock after which a rejected login is tried again, in seconds. Cameras
/// accept a difference of some seconds at least.
const CLOCK_STEP: i64 = 5;

/// Namespace of the device service, which every camera has.
pub(crate) const DEVICE: &str = "http://www.onvif.org/ver10/device/wsdl";

/// The requests to one camera.
#[derive(Debug)]
pub(crate) struct CameraSession {
    access: CameraAccess,
    login: Option<CameraLogin>,
    tls: Option<TlsConnectorDebug>,
    state: Mutex<CameraSessionState>,
}

#[derive(Debug, Default)]
struct CameraSessionState {
    /// How far the camera's clock is ahead of this machine's, in seconds.
    clock_offset: i64,
    /// The last challenge of the camera's HTTP server, and the number of answers to it.
    challenge: Option<(Challenge, u32)>,
    peer: Option<IpAddr>,
}

/// A TLS connector with `Debug`, which its settings do not implement.
struct TlsConnectorDebug(TlsConnector);

impl std::fmt::Debug for TlsConnectorDebug {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("TlsConnector")
    }
}

/// A request of [`CameraSession::call`].
#[derive(Clone, Debug)]
pub(crate) struct Call<'c> {
    pub(crate) at: &'c Address,
    pub(crate) operation: Operation<'c>,
    /// XML inside the element of the operation.
    pub(crate) content: &'c str,
    pub(crate) addressing: Option<Addressing<'c>>,
    pub(crate) time_max: Duration,
}

impl CameraSession {
    /// Reads the login and the certificates from their files, and the camera's clock.
    pub(crate) async fn open(access: &CameraAccess) -> Result<CameraSession, LinkError> {
        let session = CameraSession::without_clock(access)?;
        session.read_clock().await?;
        Ok(session)
    }

    /// Reads the login and the certificates from their files. Sends nothing.
    pub(crate) fn without_clock(access: &CameraAccess) -> Result<CameraSession, LinkError> {
        let login = access.read_login()?;
        let tls = access.trust.as_ref().map(tls::settings).transpose()?;
        let tls = tls.map(|tls| TlsConnectorDebug(TlsConnector::from(Arc::new(tls))));
        let state = Mutex::new(Default::default());
        Ok(CameraSession { access: access.clone(), login, tls, state })
    }

    pub(crate) fn address(&self) -> &Address {
        &self.access.address
    }

    pub(crate) fn login(&self) -> Option<&CameraLogin> {
        self.login.as_ref()
    }

    /// Returns the IP address of the camera; `None` before its first answer.
    pub(crate) fn peer(&self) -> Option<IpAddr> {
        self.state().peer
    }

    /// Returns the address of a service from the text `named` of the camera; `None` if the text is
    /// no address.
    pub(crate) fn resolve(&self, named: &str) -> Option<Address> {
        self.access.address.resolve(named, self.peer())
    }

    /// Returns how far the camera's clock is ahead of this machine's, in seconds.
    pub(crate) fn clock_offset(&self) -> i64 {
        self.state().clock_offset
    }

    /// Sends a request, and returns the element inside the body of the answer. If the camera
    /// rejects the login, reads its clock again, and repeats the request once if the clock was set.
    pub(crate) async fn call(&self, call: &Call<'_>) -> Result<Element, LinkError> {
        let first = self.ask(call, self.login.is_some()).await?;
        let fault = match first {
            Ok(content) => return Ok(content),
            Err(fault) => fault,
        };
        if !fault.is_login_rejected() {
            return Err(self.refused(call, fault));
        }
        // The camera's clock may have been set since it was read.
        let before = self.clock_offset();
        self.read_clock().await?;
        if self.login.is_none() || (self.clock_offset() - before).abs() <= CLOCK_STEP {
            return Err(self.rejected());
        }
        match self.ask(call, true).await? {
            Ok(content) => Ok(content),
            Err(fault) if fault.is_login_rejected() => Err(self.rejected()),
            Err(fault) => Err(self.refused(call, fault)),
        }
    }

    /// Gets a file of at most `bytes_max` bytes. Returns its type and its content.
    pub(crate) async fn get(
        &self,
        at: &Address,
        call: &str,
        bytes_max: usize,
        time_max: Duration,
    ) -> Result<(String, Bytes), LinkError> {
        let request = HttpRequest {
            call,
            method: "GET",
            body: None,
            authorization: None,
            bytes_max,
            time_max,
        };
        let answer = self.exchange(at, request).await?;
        match answer.status {
            200..=299 => Ok((answer.content_type, answer.body)),
            401 | 403 => Err(self.rejected()),
            status => {
                let (call, reason) = (call.to_owned(), format!("HTTP status {status}"));
                Err(LinkError::Fault { call, reason })
            }
        }
    }

    /// Reads the camera's clock without a login, because the login depends on the clock. A clock
    /// that cannot be read counts as equal to this machine's.
    async fn read_clock(&self) -> Result<(), LinkError> {
        let action = format!("{DEVICE}/GetSystemDateAndTime");
        let operation =
            Operation { namespace: DEVICE, name: "GetSystemDateAndTime", action: &action };
        let at = self.address();
        let time_max = CALL_TIME_MAX;
        let call = Call { at, operation, content: "", addressing: None, time_max };
        match self.ask(&call, false).await {
            Ok(Ok(answer)) => {
                let offset = clock::offset(&answer, OffsetDateTime::now_utc());
                self.state().clock_offset = offset.unwrap_or_default();
                Ok(())
            }
            // Some cameras want a login even for this; then their clock cannot be read.
            Err(LinkError::LoginRejected { .. }) => Ok(()),
            Ok(Err(fault)) if fault.is_login_rejected() || fault.is_unsupported() => Ok(()),
            Ok(Err(fault)) => Err(self.refused(&call, fault)),
            Err(error) => Err(error),
        }
    }

    async fn ask(
        &self,
        call: &Call<'_>,
        has_login: bool,
    ) -> Result<Result<Element, SoapFault>, LinkError> {
        let security = match &self.login {
            Some(login) if has_login => {
                let now = OffsetDateTime::now_utc();
                let created = clock::created(now, self.clock_offset());
                security::header(login, &created, &random()?)
            }
            _ => String::new(),
        };
        let text = envelope(call.operation, call.content, &security, call.addressing.as_ref());
        let content_type =
            format!("application/soap+xml; charset=utf-8; action=\"{}\"", call.operation.action);
        let name = call.operation.name;
        let request = HttpRequest {
            call: name,
            method: "POST",
            body: Some((content_type, text)),
            authorization: None,
            bytes_max: ANSWER_BYTES_MAX,
            time_max: call.time_max,
        };
        let answer = self.exchange(call.at, request).await?;
        let opened = Element::parse(&answer.body).and_then(|answer| open(&answer));
        match (opened, answer.status) {
            (Ok(opened), 200..=299) => Ok(opened),
            // Cameras send faults with 400, 401 or 500.
            (Ok(Err(fault)), _) => Ok(Err(fault)),
            (_, 401 | 403) => Err(self.rejected()),
            (Err(problem), 200..=299) => {
                Err(LinkError::Unreadable { call: name.to_owned(), problem })
            }
            (_, status) => {
                let reason = format!("HTTP status {status}");
                Err(LinkError::Fault { call: name.to_owned(), reason })
            }
        }
    }

    /// Sends a request, and answers a challenge of the camera's HTTP server once.
    async fn exchange(
        &self,
        at: &Address,
        mut request: HttpRequest<'_>,
    ) -> Result<HttpAnswer, LinkError> {
        let known = self.state().challenge.as_ref().map(|(challenge, _)| challenge.clone());
        request.authorization = self.authorize(known.as_ref(), at, request.method)?;
        let tls = self.tls.as_ref().map(|tls| &tls.0);
        let answer = exchange(at, tls, &request).await?;
        self.state().peer = answer.peer;
        if answer.status != 401 || self.login.is_none() {
            return Ok(answer);
        }
        let Some(challenge) = Challenge::strongest(answer.challenges.iter().map(String::as_str))
        else {
            return Ok(answer);
        };
        if challenge == Challenge::Basic && !at.is_encrypted {
            let problem = "it wants the password unencrypted (HTTP Basic); switch it to Digest, or \
                           write https://";
            let address = at.to_string();
            return Err(LinkError::LoginRejected { address, problem: problem.to_owned() });
        }
        self.state().challenge = Some((challenge.clone(), 0));
        request.authorization = self.authorize(Some(&challenge), at, request.method)?;
        exchange(at, tls, &request).await
    }

    fn authorize(
        &self,
        challenge: Option<&Challenge>,
        at: &Address,
        method: &str,
    ) -> Result<Option<String>, LinkError> {
        let (Some(login), Some(challenge)) = (&self.login, challenge) else { return Ok(None) };
        let count = match &mut self.state().challenge {
            Some((_, count)) => {
                *count = count.saturating_add(1);
                *count
            }
            None => 1,
        };
        let nonce = hex(&random()?);
        Ok(Some(challenge.answer(login, (method, &at.path), count, &nonce)))
    }

    fn refused(&self, call: &Call<'_>, fault: SoapFault) -> LinkError {
        let name = call.operation.name;
        if fault.is_unsupported() {
            return LinkError::Unsupported(format!(
                "carry out {name}: the camera does not have this operation ({})",
                excerpt(&fault.reason)
            ));
        }
        LinkError::Fault { call: name.to_owned(), reason: fault.reason }
    }

    fn rejected(&self) -> LinkError {
        let mut problem = login_hint(&self.access);
        let offset = self.clock_offset();
        if offset.abs() > CLOCK_STEP {
            problem +=
                &format!("; its clock differs from ours by {offset} s, which was allowed for");
        }
        LinkError::LoginRejected { address: self.address().to_string(), problem }
    }

    fn state(&self) -> MutexGuard<'_, CameraSessionState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns random bytes for a nonce.
pub(crate) fn random() -> Result<[u8; 16], LinkError> {
    let mut bytes = [0; 16];
    let filled = SystemRandom::new().fill(&mut bytes);
    filled.map_err(|_| LinkError::File("get random numbers from this machine".to_owned()))?;
    Ok(bytes)
}
