//! Signing in and out, and what ends with a session.

use std::time::Duration;

use accounts::{PeopleFile, PersonRight};
use tokio::time::timeout;

use crate::served::{Events, PASSWORD, PATIENCE, Served};

#[tokio::test]
async fn a_person_signs_in_and_out() {
    let served = Served::new().await;
    let answer = served.try_sign_in("ada", PASSWORD).await;
    let cookie = answer.header("set-cookie").expect("a cookie");
    assert!(
        cookie.starts_with("althing-made-up-pi-0=")
            && cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict")
    );
    let me = answer.json();
    assert_eq!((&me["person"], &me["ecosystem"]), (&"ada".into(), &"made-up".into()));
    let session = served.sign_in("ada").await;
    let me = served.page(&session, "GET /api/me", "").await.json();
    assert_eq!(me["csrf"], session.csrf.as_str());
    assert_eq!(me["rights"].as_array().map(Vec::len), Some(6), "{me}");
    let mut events = served.events(&session, "goals").await;
    events.next().await.expect("an event");
    let answer = served.page(&session, "POST /api/sign-out", "").await;
    assert_eq!(answer.status, 204, "{answer:?}");
    assert!(
        answer.header("set-cookie").is_some_and(|it| it.starts_with("althing-made-up-pi-0=; "))
    );
    assert_eq!(served.page(&session, "GET /api/me", "").await.status, 401);
    let ended = async { while events.next().await.is_some() {} };
    timeout(PATIENCE, ended).await.expect("the stream of the session ends");
}

#[tokio::test]
async fn wrong_passwords_are_limited_and_never_logged() {
    let served = Served::new().await;
    let wrong = served.try_sign_in("ada", "my-secret-typo").await;
    let unknown = served.try_sign_in("my-secret-typo", "x").await;
    assert_eq!((wrong.status, unknown.status), (401, 401));
    assert_eq!(wrong.problem(), unknown.problem(), "it does not tell which names exist");
    let mut last = wrong;
    for _ in 0..100 {
        last = served.try_sign_in("ada", "guess").await;
        if last.status == 429 {
            break;
        }
    }
    assert_eq!(last.status, 429, "{last:?}");
    assert!(last.header("retry-after").is_some());
    let log = format!("{:?}", served.log.recent(1_000));
    assert!(log.contains("sign in") && !log.contains("typo") && !log.contains("guess"), "{log}");
}

#[tokio::test]
async fn the_stream_of_a_removed_person_ends() {
    let served = Served::new().await;
    let (ada, ben) = (served.sign_in("ada").await, served.sign_in("ben").await);
    let mut removed = served.events(&ben, "overview").await;
    let mut other = served.events(&ada, "overview").await;
    removed.next().await.expect("an event");
    other.next().await.expect("an event");
    let change = PeopleFile::new(&served.people).change(|file| file.remove("ben"));
    change.expect("ben is there");
    let ended = async { while removed.next().await.is_some() {} };
    timeout(Duration::from_secs(10), ended).await.expect("it ends within seconds");
    assert_eq!(served.page(&ben, "GET /api/me", "").await.status, 401);
    served.host.ask("robot-0", "Are you there?", Duration::from_secs(60), false);
    other.find(|event| event.data.to_string().contains("Are you there?")).await;
}

#[tokio::test]
async fn the_stream_of_a_person_that_may_not_look_any_more_ends() {
    let served = Served::new().await;
    let ben = served.sign_in("ben").await;
    let mut events = served.events(&ben, "overview").await;
    events.next().await.expect("an event");
    let rights = [PersonRight::Ask].into();
    let change = PeopleFile::new(&served.people).change(|file| file.set_rights("ben", rights));
    change.expect("ben is there");
    let ended = async { while events.next().await.is_some() {} };
    timeout(Duration::from_secs(10), ended).await.expect("it ends within seconds");
    assert_eq!(served.page(&ben, "GET /api/me", "").await.status, 200, "he is still signed in");
}

#[tokio::test]
async fn a_program_uses_a_token() {
    let served = Served::new().await;
    let token = format!("Authorization: Bearer {}\r\n", served.token);
    let me = served.ask("GET /api/me", &token, "").await;
    assert_eq!((me.status, &me.json()["person"]), (200, &"ada".into()), "{me:?}");
    let headers = format!("{token}Content-Type: application/json\r\n");
    let body = r#"{"act":"dry-run","goal":"(at robot-0 room-2)","mode":"reach"}"#;
    let answer = served.ask("POST /api/acts", &headers, body).await;
    assert_eq!(answer.json()["detail"]["cost"], 2, "{answer:?}");
    let mut events = Events::open(&served, "goals", &token).await.expect("a stream");
    events.next().await.expect("an event");
    let change = PeopleFile::new(&served.people).change(|file| file.remove_token("ada", "program"));
    change.expect("the token is there");
    let ended = async { while events.next().await.is_some() {} };
    timeout(Duration::from_secs(10), ended).await.expect("its stream ends within seconds");
    assert_eq!(served.ask("GET /api/me", &token, "").await.status, 401);
}
