//! Answers to requests: JSON, and problems as sentences for people. Every answer has the headers
//! that keep a browser from running, framing or leaking anything of other origin.

use std::time::Duration;

use axum::body::Body;
use axum::http::header::{self, HeaderName, HeaderValue};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::json;

/// The policy for the pages: they run, show and reach what this server sends, and nothing else.
pub(crate) const CONTENT_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
     img-src 'self' data: blob:; connect-src 'self'; font-src 'self'; form-action 'self'; \
     frame-ancestors 'none'; base-uri 'none'; manifest-src 'self'; worker-src 'self'";

/// The headers of every answer.
const EVERYWHERE: &[(&str, &str)] = &[
    ("content-security-policy", CONTENT_POLICY),
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
    ("x-frame-options", "DENY"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    (
        "permissions-policy",
        "camera=(), microphone=(), geolocation=(), payment=(), usb=(), serial=()",
    ),
];

/// How long browsers keep to TLS for this host, once it is used: half a year.
const STRICT_TRANSPORT: &str = "max-age=15552000";

/// Adds the headers of every answer.
pub(crate) fn secure(headers: &mut HeaderMap, is_encrypted: bool) {
    for (name, value) in EVERYWHERE {
        headers.insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    if is_encrypted {
        let strict = HeaderValue::from_static(STRICT_TRANSPORT);
        headers.insert(header::STRICT_TRANSPORT_SECURITY, strict);
    }
    let no_store = HeaderValue::from_static("no-store");
    headers.entry(header::CACHE_CONTROL).or_insert(no_store);
}

/// A request that is not carried out: the status, and the reason as a sentence for a person.
#[derive(Clone, Debug)]
pub(crate) struct Refused {
    status: StatusCode,
    problem: String,
    retry_after: Option<Duration>,
}

impl Refused {
    pub(crate) fn new(status: StatusCode, problem: impl Into<String>) -> Refused {
        Refused { status, problem: problem.into(), retry_after: None }
    }

    /// States when to ask again.
    pub(crate) fn again_after(self, after: Duration) -> Refused {
        Refused { retry_after: Some(after), ..self }
    }

    /// Returns the reason.
    pub(crate) fn problem(&self) -> &str {
        &self.problem
    }
}

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        let mut response = json_answer(self.status, &json!({ "problem": self.problem }));
        if let Some(after) = self.retry_after {
            // A client that asks a little too early would be refused again.
            let seconds = after.as_secs().saturating_add(1);
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

/// Answers with JSON.
pub(crate) fn json_answer(status: StatusCode, value: &impl Serialize) -> Response {
    match serde_json::to_vec(value) {
        Ok(bytes) => {
            let mut response = Response::new(Body::from(bytes));
            *response.status_mut() = status;
            let json = HeaderValue::from_static("application/json");
            response.headers_mut().insert(header::CONTENT_TYPE, json);
            response
        }
        Err(error) => {
            tracing::warn!(%error, "an answer of the page cannot be written");
            StatusCode::INTERNAL_SERVER_ERROR.into_response()
        }
    }
}
