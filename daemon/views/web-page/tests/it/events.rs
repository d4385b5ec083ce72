//! Event streams over real sockets.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::json;

use crate::served::{Events, Served};

#[tokio::test]
async fn a_change_in_the_building_is_on_the_page() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let mut events = served.events(&ada, "agents,facts").await;
    let agents = events.find(|event| event.topic == "agents").await;
    assert_eq!(agents.data["full"], true);
    assert_eq!(agents.data["rows"].as_object().map(|rows| rows.len()), Some(20));
    assert_eq!(agents.data["order"].as_array().map(Vec::len), Some(20));
    let key = "(temperature room-0)";
    events.find(|event| !event.data["rows"][key].is_null()).await;
    served.host.set_value(1, 77);
    let event = events.find(|event| event.data["rows"][key]["value"] == json!(77.0)).await;
    assert_eq!((&event.data["full"], event.topic.as_str()), (&json!(false), "facts"));
    assert_eq!(event.data["rows"].as_object().map(|rows| rows.len()), Some(1), "only what changed");
}

#[tokio::test]
async fn a_building_in_which_nothing_changes_is_not_sent_again() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let topics = "agents,facts,floor,goals,questions,conversations,inbox,stops";
    let mut events = served.events(&ada, topics).await;
    let mut begun = BTreeSet::new();
    while begun.len() < topics.split(',').count() {
        begun.insert(events.next().await.expect("an event of each topic").topic);
    }
    for round in 0..5 {
        // Heartbeats without news: each makes every age another one.
        for agent in 0..20 {
            served.host.set_value(agent, 20);
        }
        served.host.ask("robot-0", &format!("Question {round}?"), Duration::from_secs(600), false);
        loop {
            let event = events.next().await.expect("the stream goes on");
            let is_new = event.topic == "questions";
            // Conversations tell each message.
            assert!(is_new || event.topic == "conversations", "{event:?}");
            if is_new && event.data.to_string().contains(&format!("Question {round}?")) {
                break;
            }
        }
    }
}

#[tokio::test]
async fn a_page_that_connects_again_gets_what_it_has_missed() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let mut events = served.events(&ada, "agents,questions").await;
    let first = events.next().await.expect("an event");
    let second = events.next().await.expect("another");
    assert_ne!(first.topic, second.topic);
    drop(events);
    served.host.ask("robot-0", "Still there?", Duration::from_secs(60), false);
    let headers = format!("{}Last-Event-ID: {}\r\n", served.headers(&ada), second.id);
    let mut events = Events::open(&served, "agents,questions", &headers).await.expect("a stream");
    let event = events.next().await.expect("what was missed");
    assert_eq!((event.topic.as_str(), &event.data["full"]), ("questions", &json!(false)));
    assert!(event.data.to_string().contains("Still there?"), "{event:?}");
}

#[tokio::test]
async fn details_tell_what_is_unknown() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let goal = r#"{"act":"goal","goal":"(at robot-0 room-2)","mode":"reach"}"#;
    let asked = served.page(&ada, "POST /api/acts", goal).await.json();
    let goal = asked["conversation"].as_str().expect("a conversation").to_owned();
    let topics = format!("goal:none,goal:{goal},agent:lamp-2,conversation:{goal}");
    let mut events = served.events(&ada, &topics).await;
    for _ in 0..4 {
        let event = events.next().await.expect("an event");
        let row = &event.data["rows"][""];
        match event.topic.as_str() {
            "goal:none" => assert!(row.is_null() && event.data["full"] == true, "{event:?}"),
            "agent:lamp-2" => assert_eq!(row["row"]["agent"], "lamp-2"),
            topic if topic.starts_with("goal:") => {
                assert_eq!(row["row"]["goal"], "(at robot-0 room-2)");
                assert_eq!(row["plans"][0]["steps"].as_array().map(Vec::len), Some(2), "{row}");
            }
            _ => assert_eq!(row["row"]["conversation"], goal.as_str()),
        }
    }
    let answer = served.page(&ada, "GET /api/agents/lamp-2", "").await;
    assert_eq!(answer.json()["row"]["agent"], "lamp-2", "{answer:?}");
}

#[tokio::test]
async fn texts_from_outside_stay_texts() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let mut events = served.events(&ada, "questions").await;
    let evil = "</script><script>alert(1)</script>\u{202e}\n\nevent: x\ndata: {}\n\n\u{0}\u{2028}";
    served.host.ask("robot-0", evil, Duration::from_secs(60), false);
    let event = events.find(|event| event.data.to_string().contains("alert")).await;
    let rows = event.data["rows"].as_object().expect("rows");
    let row = rows.values().find(|row| row["text"] == evil).expect("the text, unchanged");
    assert!(row["ends_at"].is_u64() && row["remaining_ms"].is_null(), "{row}");
    let mut others = served.events(&ada, "overview").await;
    assert_eq!(others.next().await.expect("an event").topic, "overview");
}

#[tokio::test]
async fn the_events_of_one_session_are_bounded() {
    let served = Served::new().await;
    let ada = served.sign_in("ada").await;
    let (mut open, mut refused) = (Vec::new(), None);
    for _ in 0..140 {
        match Events::open(&served, "stops", &served.headers(&ada)).await {
            Ok(events) => open.push(events),
            Err(head) => {
                refused = Some(head);
                break;
            }
        }
    }
    let head = refused.expect("there is a bound");
    assert!(head.starts_with("HTTP/1.1 429 ") && open.len() >= 100, "{} open: {head}", open.len());
    open.clear();
    // The server notices closed connections in its own time.
    let again = async {
        while Events::open(&served, "stops", &served.headers(&ada)).await.is_err() {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(crate::served::PATIENCE, again).await.expect("their places are free");
}
