//! The paths for notifications to browsers; the host keeps the subscriptions and sends.

use std::time::{Duration, Instant};

use accounts::PersonRight;
use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use serde_json::Value;
use tokio::time::timeout;

use crate::act_limits::ActKind;
use crate::answer::{Refused, json_answer};
use crate::api::{FromPage, caller, check_csrf};
use crate::host::PushAsk;

/// How long the host may take: it writes a file.
const ANSWERED_WITHIN: Duration = Duration::from_secs(10);

/// The end of a subscription.
#[derive(Deserialize)]
struct Removal {
    endpoint: String,
}

/// Tells the key of the sender, if this daemon sends notifications.
pub(crate) async fn key(from: FromPage) -> Result<Response, Refused> {
    ask(from, PushAsk::Key).await
}

/// Begins to send notifications to a browser.
pub(crate) async fn subscribe(from: FromPage, body: Body) -> Result<Response, Refused> {
    let subscription: Value = read(&from, body).await?;
    ask(from, PushAsk::Subscribe(subscription)).await
}

/// Ends sending notifications to a browser.
pub(crate) async fn remove(from: FromPage, body: Body) -> Result<Response, Refused> {
    let Removal { endpoint } = read(&from, body).await?;
    ask(from, PushAsk::Remove { endpoint }).await
}

/// Reads the body of a request that changes something.
async fn read<T: serde::de::DeserializeOwned>(from: &FromPage, body: Body) -> Result<T, Refused> {
    let (State(state), Extension(client), headers) = from;
    let caller = caller(from, PersonRight::Look)?;
    check_csrf(state, &caller, (headers, client.from), "change notifications")?;
    state.limits.take(caller.key(), ActKind::Other, Instant::now()).map_err(|after| {
        let problem = "you ask for more than the daemon can follow; wait a moment";
        Refused::new(StatusCode::TOO_MANY_REQUESTS, problem).again_after(after)
    })?;
    crate::body::json(headers, body).await
}

async fn ask(from: FromPage, ask: PushAsk) -> Result<Response, Refused> {
    let person = caller(&from, PersonRight::Look)?.person().clone();
    let answered = timeout(ANSWERED_WITHIN, from.0.host.push(person, ask)).await;
    let late = |_| Refused::new(StatusCode::GATEWAY_TIMEOUT, "the daemon does not answer");
    let none = || Refused::new(StatusCode::NOT_FOUND, "this daemon sends no notifications");
    let answer = answered.map_err(late)?.ok_or_else(none)?;
    let answer = answer.map_err(|problem| Refused::new(StatusCode::BAD_REQUEST, problem))?;
    Ok(json_answer(StatusCode::OK, &answer))
}
