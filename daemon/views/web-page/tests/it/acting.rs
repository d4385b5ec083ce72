//! Acts: rights, limits, and the log of who asked for what.

use std::time::Duration;

use serde_json::{Value, json};

use crate::served::{Served, Session};

async fn act(served: &Served, session: &Session, act: Value) -> (u16, Value) {
    let answer = served.page(session, "POST /api/acts", &act.to_string()).await;
    (answer.status, answer.json())
}

#[tokio::test]
async fn each_act_needs_its_right() {
    let served = Served::new().await;
    let (ada, ben) = (served.sign_in("ada").await, served.sign_in("ben").await);
    let cleo = served.sign_in("cleo").await;
    served.host.discover("plug");
    let goal = json!({ "act": "goal", "goal": "(at robot-0 room-1)", "mode": "reach" });
    let acts = [
        goal.clone(),
        json!({ "act": "dry-run", "goal": "(at robot-0 room-1)", "mode": "keep" }),
        json!({ "act": "set", "fact": "(lit lamp-2)" }),
        json!({ "act": "admit", "agent": "plug", "allow": true }),
        json!({ "act": "action", "agent": "robot-0", "action": "(move robot-0 room-0 room-1)" }),
        json!({ "act": "release", "ids": [] }),
    ];
    for one in &acts {
        let (status, outcome) = act(&served, &ben, one.clone()).await;
        assert_eq!(status, 403, "{one}: {outcome}");
        let problem = outcome["problem"].as_str().expect("a sentence");
        assert!(problem.starts_with("ben may not "), "{problem}");
        let (status, outcome) = act(&served, &ada, one.clone()).await;
        assert_eq!((status, &outcome["ok"]), (200, &json!(true)), "{one}: {outcome}");
    }
    assert_eq!(act(&served, &cleo, goal).await.0, 200);
    for line in ["GET /api/events?topics=goals", "GET /api/setup", "GET /api/agents/lamp-2"] {
        assert_eq!(served.page(&cleo, line, "").await.status, 403, "{line}: she may not look");
    }
    assert_eq!(served.page(&ben, "GET /api/log", "").await.status, 403);
    let stop = json!({ "act": "stop", "names": ["robot-0"], "because": "a child" });
    assert_eq!(act(&served, &ben, stop).await.0, 200, "signing in is enough to stop");
}

#[tokio::test]
async fn an_answer_that_admits_an_agent_needs_the_right_to_admit() {
    let served = Served::new().await;
    let (ada, cleo) = (served.sign_in("ada").await, served.sign_in("cleo").await);
    served.host.ask("doorkeeper-pi-0", "May `plug` take part?", Duration::from_secs(60), false);
    let answer = json!({ "act": "answer", "keyboard": "hall", "question": 1, "text": "yes plug" });
    let (status, outcome) = act(&served, &cleo, answer.clone()).await;
    assert_eq!(status, 403, "{outcome}");
    assert!(outcome["problem"].as_str().expect("a sentence").contains("`admit`"), "{outcome}");
    assert_eq!(act(&served, &ada, answer).await.0, 200);
    let log = served.log.recent(2);
    for request in &log {
        assert!(request.what.contains("hall/1, which admits agents"), "{log:?}");
    }
}

#[tokio::test]
async fn goals_are_said_in_words() {
    let served = Served::new().await;
    let ben = served.sign_in("ben").await;
    let of = "of=(known-temperature%20hall)&of=(odd%20hall)&of=nothing";
    let line = format!("GET /api/words?language=de&{of}");
    let said = served.page(&ben, &line, "").await.json();
    assert_eq!(said["said"], json!(["Temperatur von hall bekannt", "(odd hall)", "nothing"]));
    let answer = served.page(&ben, "GET /api/words?language=xx&of=(a)", "").await;
    assert_eq!(answer.status, 404, "there is no such language");
    let cleo = served.sign_in("cleo").await;
    assert_eq!(served.page(&cleo, "GET /api/words?of=(a)", "").await.status, 403);
}

#[tokio::test]
async fn the_log_tells_who_asked_for_what_and_no_answer() {
    let served = Served::new().await;
    let (ada, ben) = (served.sign_in("ada").await, served.sign_in("ben").await);
    served.host.ask("robot-0", "What is the PIN?", Duration::from_secs(60), true);
    let answer = json!({ "act": "answer", "keyboard": "hall", "question": 1, "text": "27182" });
    assert_eq!(act(&served, &ada, answer.clone()).await.1["ok"], true);
    assert_eq!(act(&served, &ada, answer.clone()).await.1["ok"], false, "one answer counts");
    assert_eq!(act(&served, &ben, answer).await.0, 403);
    let log = served.page(&ada, "GET /api/log", "").await.json();
    let requests = log["requests"].as_array().expect("requests");
    let told: Vec<_> = requests
        .iter()
        .filter(|request| request["what"] == "answer to the question hall/1")
        .map(|request| (request["person"].as_str(), request["outcome"].as_str().unwrap_or("")))
        .collect();
    assert_eq!(told.len(), 3, "{log}");
    assert!(told[0].1.starts_with("done: ") && told[1].1.starts_with("not done: "), "{told:?}");
    assert!(told[2].1.starts_with("refused: ") && told[2].0 == Some("ben"), "{told:?}");
    assert_eq!(
        (&requests[0]["from"], &requests[0]["through"]),
        (&json!("127.0.0.1"), &json!("pi-0"))
    );
    assert!(!log.to_string().contains("27182"), "{log}");
}

#[tokio::test]
async fn a_session_that_floods_is_slowed_and_can_still_stop() {
    let served = Served::new().await;
    let (ada, other) = (served.sign_in("ada").await, served.sign_in("cleo").await);
    let set = json!({ "act": "set", "fact": "(lit lamp-2)" });
    let mut last = 200;
    for _ in 0..60 {
        last = act(&served, &ada, set.clone()).await.0;
        if last == 429 {
            break;
        }
    }
    assert_eq!(last, 429);
    let stop = json!({ "act": "stop", "names": [], "because": "" });
    assert_eq!(act(&served, &ada, stop).await.0, 200);
    let dry = json!({ "act": "dry-run", "goal": "(at robot-0 room-1)", "mode": "reach" });
    assert_eq!(act(&served, &other, dry).await.0, 200, "others are not slowed");
}
