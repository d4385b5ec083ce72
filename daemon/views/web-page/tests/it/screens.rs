//! The screen of a robot, at which nobody has signed in: what it may see and do, and what not.

use std::time::{Duration, SystemTime};

use accounts::{PeopleFile, PersonName, PersonRecord, StoredToken};
use serde_json::{Value, json};

use crate::served::{Answer, Events, Served, Session};

const ROBOT: &str = "robot-0";

/// Adds the screen of a robot, and returns its token.
fn add_screen(served: &Served) -> String {
    let name = |text| PersonName::new(text).expect("a name");
    let (token, stored) = StoredToken::make(name("link"), SystemTime::now()).expect("random");
    let screen = PersonRecord::screen(name("hall-screen"), ROBOT, stored);
    PeopleFile::new(&served.people).change(|people| people.add(screen)).expect("written");
    token
}

async fn begin(served: &Served, token: &str) -> Answer {
    let headers =
        format!("Origin: http://{}\r\nContent-Type: application/json\r\n", served.address);
    let body = json!({ "token": token }).to_string();
    served.ask("POST /api/screen", &headers, &body).await
}

/// Makes a browser the screen, and returns its cookie and the text that its requests carry.
async fn screen(served: &Served) -> Session {
    let answer = begin(served, &add_screen(served)).await;
    assert_eq!(answer.status, 204, "{answer:?}");
    let cookie = answer.header("set-cookie").expect("a cookie");
    assert!(cookie.contains("; HttpOnly; SameSite=Strict; Max-Age=34560000"), "{cookie}");
    let cookie = cookie.split(';').next().expect("a pair").to_owned();
    let me = served.ask("GET /api/me", &format!("Cookie: {cookie}\r\n"), "").await;
    assert!(me.header("set-cookie").is_some_and(|it| it.starts_with(&cookie)), "it is kept");
    let me = me.json();
    assert_eq!((&me["screen"], &me["rights"]), (&json!(ROBOT), &json!([])), "{me}");
    Session { cookie, csrf: me["csrf"].as_str().expect("a text").to_owned() }
}

async fn act(served: &Served, session: &Session, act: Value) -> (u16, Value) {
    let answer = served.page(session, "POST /api/acts", &act.to_string()).await;
    (answer.status, answer.json())
}

#[tokio::test]
async fn a_screen_sees_its_robot_and_nothing_else() {
    let served = Served::new().await;
    let screen = screen(&served).await;
    served.host.ask(ROBOT, "What is the PIN?", Duration::from_secs(60), true);
    served.host.ask("robot-10", "Where am I?", Duration::from_secs(60), false);
    let mut events = served.events(&screen, "robot:robot-0").await;
    // A question may come in an event of its own.
    let (mut is_shown, mut is_asked) = (false, false);
    while !(is_shown && is_asked) {
        let event = events.next().await.expect("the stream goes on");
        assert_eq!(event.topic, "robot:robot-0");
        let rows = event.data["rows"].to_string();
        assert!(!rows.contains("robot-10") && !rows.contains("Where am I?"), "{rows}");
        is_shown |= event.data["rows"]["agent"].is_object() && rows.contains("room-0");
        is_asked |= rows.contains("What is the PIN?");
    }
    for topics in ["goals", "robot:robot-10", "robot:robot-0,facts", "evil", ""] {
        let refused = Events::open(&served, topics, &served.headers(&screen)).await;
        let is_ours = topics.is_empty() || topics == "evil";
        let head = refused.err().expect("it is refused");
        assert!(head.contains(" 403 ") || (is_ours && head.contains(" 400 ")), "{topics}: {head}");
    }
    for line in [
        "GET /api/setup",
        "GET /api/agents/robot-0",
        "GET /api/goals/g",
        "GET /api/cameras/robot-0",
        "GET /api/history",
        "GET /api/log",
        "GET /api/push",
    ] {
        let answer = served.page(&screen, line, "").await;
        assert_eq!(answer.status, 403, "{line}: {answer:?}");
        assert!(answer.problem().contains("the screen of robot-0"), "{answer:?}");
    }
}

#[tokio::test]
async fn a_screen_answers_for_its_robot_and_stops_it_alone() {
    let served = Served::new().await;
    let screen = screen(&served).await;
    served.host.ask("robot-10", "Where am I?", Duration::from_secs(60), false);
    served.host.ask(ROBOT, "What is the PIN?", Duration::from_secs(60), true);
    let answer = |question: u64| json!({ "act": "answer", "keyboard": "hall", "question": question, "text": "two-seven" });
    let mut events = served.events(&screen, "robot:robot-0").await;
    let asked = events.find(|event| event.data["rows"].to_string().contains("PIN")).await;
    let rows = asked.data["rows"].as_object().expect("rows").values();
    let id = rows.filter_map(|row| row["id"].as_str()).next().expect("a number").to_owned();
    let number: u64 = id.rsplit('/').next().and_then(|it| it.parse().ok()).expect("a number");
    let (status, refused) = act(&served, &screen, answer(number - 1)).await;
    assert_eq!(status, 403, "the question of another robot: {refused}");
    for one in [
        json!({ "act": "goal", "goal": "(at robot-0 room-1)", "mode": "reach" }),
        json!({ "act": "dry-run", "goal": "(at robot-0 room-1)", "mode": "reach" }),
        json!({ "act": "cancel-goal", "conversation": "g" }),
        json!({ "act": "action", "agent": ROBOT, "action": "(move robot-0 room-0 room-1)" }),
        json!({ "act": "set", "fact": "(lit lamp-2)" }),
        json!({ "act": "admit", "agent": "plug", "allow": true }),
        json!({ "act": "release", "ids": [] }),
        json!({ "act": "stop", "names": [], "because": "" }),
        json!({ "act": "stop", "names": [ROBOT, "robot-10"], "because": "" }),
        json!({ "act": "stop", "names": ["room-0"], "because": "" }),
    ] {
        let (status, refused) = act(&served, &screen, one.clone()).await;
        assert_eq!(status, 403, "{one}: {refused}");
        assert!(refused["problem"].as_str().is_some_and(|it| it.contains(ROBOT)), "{refused}");
    }
    let keyboard = id.rsplit_once('/').expect("a keyboard").0;
    let mut right = answer(number);
    right["keyboard"] = json!(keyboard);
    let (status, done) = act(&served, &screen, right).await;
    assert_eq!((status, &done["ok"]), (200, &json!(true)), "{done}");
    let stop = json!({ "act": "stop", "names": [ROBOT], "because": "a child" });
    assert_eq!(act(&served, &screen, stop.clone()).await.0, 200);
    let forged = Session { csrf: "sha256:0".to_owned(), cookie: screen.cookie.clone() };
    assert_eq!(act(&served, &forged, stop).await.0, 403, "no page of this server has made it");
    let log = format!("{:?}", served.log.recent(100));
    assert!(log.contains("hall-screen") && !log.contains("two-seven"), "{log}");
}

#[tokio::test]
async fn a_person_goes_before_the_screen_and_a_removed_screen_ends() {
    let served = Served::new().await;
    let screen = screen(&served).await;
    let ada = served.sign_in("ada").await;
    let both = Session { cookie: format!("{}; {}", screen.cookie, ada.cookie), csrf: ada.csrf };
    let me = served.page(&both, "GET /api/me", "").await.json();
    assert_eq!((&me["person"], &me["screen"]), (&json!("ada"), &Value::Null), "{me}");
    assert_eq!(served.page(&both, "POST /api/sign-out", "").await.status, 204);
    let me = served.page(&both, "GET /api/me", "").await.json();
    assert_eq!(me["person"], "hall-screen", "it is the screen again: {me}");
    let refused = served.page(&screen, "POST /api/sign-out", "").await;
    assert_eq!(refused.status, 403, "nobody has signed in: {refused:?}");

    let mut events = served.events(&screen, "robot:robot-0").await;
    events.next().await.expect("an event");
    let removed = PeopleFile::new(&served.people).change(|people| people.remove("hall-screen"));
    removed.expect("written");
    let ended = async { while events.next().await.is_some() {} };
    tokio::time::timeout(crate::served::PATIENCE, ended).await.expect("its stream ends");
    assert_eq!(served.page(&screen, "GET /api/me", "").await.status, 401);
}

#[tokio::test]
async fn only_the_link_of_a_screen_makes_one() {
    let served = Served::new().await;
    for (token, status) in
        [("althing_x".to_owned(), 401), (String::new(), 401), (served.token.clone(), 403)]
    {
        let answer = begin(&served, &token).await;
        assert_eq!(answer.status, status, "{answer:?}");
        assert!(answer.header("set-cookie").is_none() && !answer.problem().is_empty());
    }
    let token = add_screen(&served);
    let foreign = "Origin: http://evil.example\r\nContent-Type: application/json\r\n";
    let body = json!({ "token": token }).to_string();
    let answer = served.ask("POST /api/screen", foreign, &body).await;
    assert_eq!(answer.status, 403, "another site cannot make a browser a screen: {answer:?}");
}
