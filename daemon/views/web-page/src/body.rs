//! The bodies of requests: JSON of a bounded length, within a bounded time.

use std::time::Duration;

use axum::body::Body;
use axum::http::header;
use axum::http::{HeaderMap, StatusCode};
use http_body_util::{BodyExt as _, LengthLimitError, Limited};
use serde::de::DeserializeOwned;
use tokio::time::timeout;

use crate::answer::Refused;

/// Maximum length of a body, in bytes: a goal, or an answer, and room for more.
const BODY_BYTES_MAX: usize = 64 << 10;

/// How long a client may take for a body. A phone far from its network is slow.
const BODY_WITHIN: Duration = Duration::from_secs(10);

/// Reads a body as JSON.
///
/// # Errors
///
/// Returns a refusal if the body is too long, too slow, or not what is expected. The message does
/// not quote it, because it may contain a password.
pub(crate) async fn json<T: DeserializeOwned>(
    headers: &HeaderMap,
    body: Body,
) -> Result<T, Refused> {
    let media_type = headers.get(header::CONTENT_TYPE).and_then(|text| text.to_str().ok());
    let media_type = media_type.and_then(|text| text.split(';').next()).map(str::trim);
    // Forms of other sites send other types.
    if media_type.is_none_or(|text| !text.eq_ignore_ascii_case("application/json")) {
        let problem = "a body is JSON, with the header Content-Type: application/json";
        return Err(Refused::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, problem));
    }
    let collected = timeout(BODY_WITHIN, Limited::new(body, BODY_BYTES_MAX).collect()).await;
    let collected = collected.map_err(|_| {
        let problem = format!("the body did not arrive within {} s", BODY_WITHIN.as_secs());
        Refused::new(StatusCode::REQUEST_TIMEOUT, problem)
    })?;
    let bytes = collected.map_err(|error| match error.is::<LengthLimitError>() {
        true => {
            let problem = format!("the body is longer than {BODY_BYTES_MAX} bytes");
            Refused::new(StatusCode::PAYLOAD_TOO_LARGE, problem)
        }
        false => Refused::new(StatusCode::BAD_REQUEST, "the body is not whole"),
    })?;
    serde_json::from_slice(&bytes.to_bytes())
        .map_err(|error| Refused::new(StatusCode::BAD_REQUEST, unreadable(&error)))
}

/// Describes why a body cannot be read, without a value of the body.
fn unreadable(error: &serde_json::Error) -> String {
    let problem = match error.classify() {
        serde_json::error::Category::Data => "the body is JSON, but not what this path takes",
        _ => "the body is not JSON",
    };
    let text = error.to_string();
    let missing = text.strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
    match (missing, error.line()) {
        (Some(field), _) => format!("{problem}: `{field}` is missing"),
        // A value that was read before it was understood has no place.
        (None, 0) => problem.to_owned(),
        (None, line) => format!("{problem} (line {line}, column {})", error.column()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::host::PageAct;

    #[test]
    fn a_field_that_is_missing_is_named_and_a_stop_needs_none() {
        let read = serde_json::from_str::<PageAct>;
        let stop = read(r#"{"act":"stop"}"#).expect("it stops everything");
        assert!(stop == PageAct::Stop { names: Vec::new(), because: String::new() });
        let problem = |text| unreadable(&read(text).err().expect("not an act"));
        let data = "the body is JSON, but not what this path takes";
        assert_eq!(
            problem(r#"{"act":"dry-run","goal":"x"}"#),
            format!("{data}: `mode` is missing")
        );
        let secret = problem(r#"{"act":"answer","keyboard":"k","question":"2718","text":"x"}"#);
        assert_eq!(secret, data, "no value is quoted");
        assert!(problem("{").contains("is not JSON (line 1, column 1)"));
    }
}
