//! Slow and greedy clients: none of them keeps others from the pages.

use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::time::timeout;
use web_page::PageOptions;

use crate::served::{PATIENCE, Served, read_answer};

/// How long an event may take to a page while others do not read. In a slow hour of a virtual machine some
/// took more than two seconds; a page that waits for one that does not read would wait for ever.
const SEEN_WITHIN: Duration = Duration::from_secs(10);

#[tokio::test(start_paused = true)]
async fn a_client_that_sends_no_head_is_disconnected() {
    let served = Served::new().await;
    let mut silent = served.connect().await;
    silent.write_all(b"GET / HTTP/1.1\r\nHost: loc").await.expect("it is connected");
    let mut bytes = Vec::new();
    let ended = timeout(PATIENCE, silent.read_to_end(&mut bytes)).await;
    assert!(ended.is_ok(), "within half a minute of simulated time");
    assert!(!String::from_utf8_lossy(&bytes).contains("200 OK"));
}

#[tokio::test(start_paused = true)]
async fn a_body_that_does_not_come_is_given_up() {
    let served = Served::new().await;
    let mut slow = served.connect().await;
    let head = "POST /api/sign-in HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nConnection: close\r\n\
         Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{";
    slow.write_all(head.as_bytes()).await.expect("it is connected");
    let answer = read_answer(&mut slow).await;
    assert_eq!(answer.status, 408, "{answer:?}");
}

#[tokio::test]
async fn heads_that_are_too_long_are_refused() {
    let served = Served::new().await;
    let many: String = (0..80).map(|number| format!("X-{number}: x\r\n")).collect();
    let long = format!("X: {}\r\n", "x".repeat(20_000));
    for headers in [many, long] {
        let answer = served.ask("GET /", &headers, "").await;
        assert_eq!(answer.status, 431, "{answer:?}");
    }
}

#[tokio::test]
async fn clients_that_have_not_signed_in_make_room() {
    let options =
        PageOptions { connections: 8, connections_per_address: 6, ..PageOptions::default() };
    let served = Served::with(options, None).await;
    let ada = served.sign_in("ada").await;
    let mut events = served.events(&ada, "questions").await;
    events.next().await.expect("an event");
    let mut idle = Vec::new();
    for _ in 0..40 {
        idle.push(served.connect().await);
    }
    let answer = served.ask("GET /", "", "").await;
    assert_eq!(answer.status, 200, "a new client takes the place of an idle one");
    served.host.ask("robot-0", "Still open?", Duration::from_secs(60), false);
    events.find(|event| event.data.to_string().contains("Still open?")).await;
}

#[tokio::test]
async fn a_page_that_does_not_read_slows_no_other() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let mut stuck = Vec::new();
    for _ in 0..20 {
        // The answer to it is never read.
        let mut stream = served.connect().await;
        let headers = served.headers(&ada);
        let request = format!(
            "GET /api/events?topics=activity,facts,conversation:robot-0 HTTP/1.1\r\nHost: {}\r\n{headers}\r\n",
            served.address
        );
        stream.write_all(request.as_bytes()).await.expect("it is connected");
        stuck.push(stream);
    }
    let mut events = served.events(&ada, "facts").await;
    events.next().await.expect("an event");
    for value in 100..140 {
        served.host.set_value(1, value);
        let wanted = serde_json::json!(f64::from(u32::try_from(value).expect("small")));
        let seen =
            events.find(|event| event.data["rows"]["(temperature room-0)"]["value"] == wanted);
        timeout(SEEN_WITHIN, seen).await.expect("it is seen while the others do not read");
    }
}
