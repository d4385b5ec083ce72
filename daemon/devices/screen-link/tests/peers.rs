//! The protocols, with made-up peers: slow ones, hostile ones, and ones that end suddenly. The
//! tests of the plugin `screen` have the real programs.

use screen_link::{Browser, Mpv, ScreenLinkError};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::UnixStream;

/// The other end of a connection. It answers by a function: a command in, messages out.
struct Peer {
    stream: UnixStream,
    delimiter: u8,
    received: Vec<u8>,
}

impl Peer {
    async fn say(&mut self, message: &Value) {
        let mut bytes = message.to_string().into_bytes();
        bytes.push(self.delimiter);
        let _ = self.stream.write_all(&bytes).await;
    }

    /// Returns the next command; `None` if the connection is closed.
    async fn hear(&mut self) -> Option<Value> {
        loop {
            if let Some(end) = self.received.iter().position(|byte| *byte == self.delimiter) {
                let rest = self.received.split_off(end + 1);
                let mut message = std::mem::replace(&mut self.received, rest);
                message.pop();
                return Some(serde_json::from_slice(&message).expect("a command is JSON"));
            }
            if self.stream.read_buf(&mut self.received).await.ok()? == 0 {
                return None;
            }
        }
    }
}

/// Starts a peer. It answers each command with the messages that `answer` returns, and closes the
/// connection at `null`.
fn peer(delimiter: u8, answer: impl Fn(&Value) -> Vec<Value> + Send + 'static) -> UnixStream {
    let (ours, theirs) = UnixStream::pair().expect("a pair");
    let mut peer = Peer { stream: theirs, delimiter, received: Vec::new() };
    tokio::spawn(async move {
        while let Some(command) = peer.hear().await {
            for message in answer(&command) {
                if message.is_null() {
                    return;
                }
                peer.say(&message).await;
            }
        }
    });
    ours
}

/// A browser that carries out all commands, except those that `special` answers.
async fn browser(special: impl Fn(&Value) -> Option<Vec<Value>> + Send + 'static) -> Browser {
    let link = peer(0, move |command| {
        if let Some(messages) = special(command) {
            return messages;
        }
        let result = match command["method"].as_str() {
            Some("Target.getTargets") => {
                json!({ "targetInfos": [
                    { "type": "browser_ui", "targetId": "u" }, { "type": "page", "targetId": "t" },
                ] })
            }
            Some("Target.attachToTarget") => json!({ "sessionId": "s" }),
            Some("Page.navigate") => json!({ "loaderId": "l" }),
            Some("Runtime.evaluate") => json!({ "result": { "value": {
                "url": "http://a/", "ready": "complete", "visible": true, "status": 200,
            } } }),
            _ => json!({}),
        };
        let mut messages = vec![json!({ "id": command["id"], "result": result })];
        if command["method"] == "Page.navigate" {
            messages.push(event("Page.frameNavigated", json!({ "frame": { "id": "f" } })));
            messages.push(event("Page.loadEventFired", json!({})));
        }
        messages
    });
    Browser::attach(link).await.expect("attached")
}

fn event(method: &str, parameters: Value) -> Value {
    json!({ "method": method, "params": parameters })
}

/// Returns the answer of a special browser to one method.
fn on(method: &'static str, messages: Vec<Value>) -> impl Fn(&Value) -> Option<Vec<Value>> {
    move |command| {
        let is_it = command["method"] == method;
        let with_id = |message: &Value| match message.get("id") {
            Some(_) => {
                let mut message = message.clone();
                message["id"] = command["id"].clone();
                message
            }
            None => message.clone(),
        };
        is_it.then(|| messages.iter().map(with_id).collect())
    }
}

#[tokio::test(start_paused = true)]
async fn a_page_is_opened_and_every_failure_has_a_reason() {
    let mut good = browser(|_| None).await;
    assert_eq!(good.open("http://a/").await.expect("opened").url, "http://a/");
    let page = |page: Value| vec![json!({ "id": 0, "result": { "result": { "value": page } } })];
    for (method, messages, expected) in [
        (
            "Page.navigate",
            vec![json!({ "id": 0, "result": { "errorText": "net::ERR_FAILED" } })],
            "load http://a/: net::ERR_FAILED",
        ),
        (
            "Page.navigate",
            vec![json!({ "id": 0, "result": { "isDownload": true } })],
            "load http://a/: it is a file that the browser cannot show",
        ),
        (
            "Page.navigate",
            vec![json!({ "id": 0, "error": { "message": "no\u{1b}[2J" } })],
            "do `Page.navigate` in the browser: no [2J",
        ),
        ("Page.navigate", Vec::new(), "load http://a/: there was no answer within 12s"),
        (
            "Runtime.evaluate",
            page(json!({ "url": "http://a/", "visible": true, "status": 503 })),
            "load http://a/: its server answers with HTTP status 503",
        ),
        (
            "Runtime.evaluate",
            page(json!({ "url": "chrome-error://chromewebdata/", "visible": true })),
            "load http://a/: the browser shows an error in its place",
        ),
        (
            "Runtime.evaluate",
            page(json!({ "url": "http://a/", "visible": false })),
            "load http://a/: something else is in front of it",
        ),
        ("Runtime.evaluate", page(json!([1, "x", {}])), "something else is in front of it"),
    ] {
        let mut browser = browser(on(method, messages)).await;
        let error = browser.open("http://a/").await.expect_err(expected);
        assert!(error.is_of_command() && error.to_string().contains(expected), "{error}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_browser_that_hangs_crashes_or_closes_is_told_from_a_page_that_fails() {
    let mut hangs = browser(on("Runtime.evaluate", Vec::new())).await;
    let error = hangs.look().await.expect_err("no answer");
    assert!(matches!(error, ScreenLinkError::TimedOut { .. }) && !error.is_of_command(), "{error}");
    let crash = vec![event("Inspector.targetCrashed", json!({}))];
    let mut crashes = browser(on("Page.navigate", crash)).await;
    assert!(matches!(crashes.open("http://a/").await, Err(ScreenLinkError::Crashed)));
    assert!(matches!(crashes.look().await, Err(ScreenLinkError::Crashed)), "it stays so");
    let gone = vec![event("Target.targetDestroyed", json!({ "targetId": "t" }))];
    let mut closed = browser(on("Page.navigate", gone)).await;
    assert!(matches!(closed.open("http://a/").await, Err(ScreenLinkError::Crashed)));
    let mut ends = browser(on("Page.navigate", vec![Value::Null])).await;
    assert!(matches!(ends.open("http://a/").await, Err(ScreenLinkError::Closed)));
    assert!(matches!(ends.failed().await, ScreenLinkError::Closed | ScreenLinkError::Io(_)));
}

#[tokio::test(start_paused = true)]
async fn a_dialog_of_a_page_is_closed() {
    // The page answers only when its dialog is closed.
    let waiting = std::sync::Mutex::new(Vec::new());
    let special = move |command: &Value| match command["method"].as_str() {
        Some("Runtime.evaluate") => {
            waiting.lock().expect("unpoisoned").push(command["id"].clone());
            Some(vec![event("Page.javascriptDialogOpening", json!({ "message": "1" }))])
        }
        Some("Page.handleJavaScriptDialog") => {
            let ids = std::mem::take(&mut *waiting.lock().expect("unpoisoned"));
            let page = json!({ "result": { "value": { "url": "http://b/" } } });
            Some(ids.into_iter().map(|id| json!({ "id": id, "result": page })).collect())
        }
        _ => None,
    };
    let mut browser = browser(special).await;
    assert_eq!(browser.look().await.expect("an answer").url, "http://b/");
}

/// An mpv that sends these events after its answer to `loadfile`.
async fn mpv(events: Vec<Value>) -> Mpv {
    let link = peer(b'\n', move |command| {
        let data = match (command["command"][0].as_str(), command["command"][1].as_str()) {
            (Some("loadfile"), _) => json!({ "playlist_entry_id": 2 }),
            (_, Some("vid")) => json!(1),
            (_, Some("path")) => json!("a.mp4"),
            _ => Value::Null,
        };
        let answer =
            json!({ "request_id": command["request_id"], "error": "success", "data": data });
        let mut messages = vec![answer];
        if command["command"][0] == "loadfile" {
            messages.extend(events.clone());
        }
        messages
    });
    Mpv::attach(link).await.expect("attached")
}

#[tokio::test(start_paused = true)]
async fn a_film_counts_as_shown_when_its_own_first_frame_is() {
    let begun = |entry: i64| json!({ "event": "start-file", "playlist_entry_id": entry });
    let frame = json!({ "event": "playback-restart" });
    let ended = |entry: i64, reason: Value| {
        let mut event = json!({ "event": "end-file", "playlist_entry_id": entry });
        event["reason"] = json!("error");
        event["file_error"] = reason;
        event
    };
    let stale = vec![frame.clone(), ended(1, json!("old")), begun(2), frame.clone()];
    mpv(stale).await.load("a.mp4").await.expect("shown");
    for (events, expected) in [
        (vec![begun(2), ended(2, json!("loading failed"))], "play a.mp4: loading failed"),
        (vec![begun(2), ended(2, Value::Null)], "play a.mp4: it has ended (error)"),
        (
            vec![frame.clone(), ended(1, json!("old"))],
            "play a.mp4: there was no picture within 15s",
        ),
        (vec![begun(2), Value::from("x")], "play a.mp4: there was no picture within 15s"),
    ] {
        let error = mpv(events).await.load("a.mp4").await.expect_err(expected);
        assert!(error.is_of_command(), "{error}");
        assert_eq!(error.to_string(), expected);
    }
    let mut dies = mpv(vec![begun(2), Value::Null]).await;
    assert!(matches!(dies.load("a.mp4").await, Err(ScreenLinkError::Closed)));
}

#[tokio::test(start_paused = true)]
async fn a_program_that_says_nothing_is_given_up() {
    let said = Browser::attach(peer(0, |_| Vec::new())).await.expect_err("silence").to_string();
    assert_eq!(said, "start the browser: there was no answer within 30s");
    let said = Mpv::attach(peer(b'\n', |_| Vec::new())).await.expect_err("silence").to_string();
    assert_eq!(said, "start mpv: there was no answer within 20s");
}
