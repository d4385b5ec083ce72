//! Forged requests: another Host, another origin, no token, wrong cookies, wrong bodies.

use serde_json::json;

use crate::served::{Answer, Served, request};

/// A request to stop, which every person may ask for.
fn stop() -> String {
    json!({ "act": "stop", "names": [], "because": "" }).to_string()
}

#[tokio::test]
async fn every_answer_tells_the_browser_to_trust_nothing_else() {
    let served = Served::new().await;
    for line in ["GET /", "GET /nothing", "GET /api/me", "POST /", "GET /assets/index.html"] {
        let answer = served.ask(line, "", "").await;
        let policy = answer.header("content-security-policy").expect("a policy");
        assert!(policy.starts_with("default-src 'none'; script-src 'self'; "), "{line}: {policy}");
        assert!(!policy.contains("unsafe") && policy.contains("frame-ancestors 'none'"));
        for (name, value) in [
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "no-referrer"),
            ("cross-origin-opener-policy", "same-origin"),
            ("cross-origin-resource-policy", "same-origin"),
        ] {
            assert_eq!(answer.header(name), Some(value), "{line}: {name}");
        }
        assert_eq!(answer.header("access-control-allow-origin"), None);
        assert!(answer.header("permissions-policy").is_some_and(|it| it.contains("camera=()")));
        let is_api = line.contains("/api/");
        let caching = answer.header("cache-control");
        assert!(!is_api || caching == Some("no-store"), "{line}: {caching:?}");
    }
}

#[tokio::test]
async fn another_host_is_not_answered() {
    let served = Served::new().await;
    for host in ["evil.example", "127.0.0.1.evil.example", "", "localhost.evil", "[::1"] {
        let answer = served.raw(request("GET /", host, "", "").as_bytes()).await;
        assert!([400, 421].contains(&answer.status), "{host}: {answer:?}");
        assert!(!answer.head.contains("ETag"), "{host}");
    }
    let two =
        "GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\nConnection: close\r\n\r\n";
    assert!([400, 421].contains(&served.raw(two.as_bytes()).await.status));
    let none = "GET / HTTP/1.1\r\nConnection: close\r\n\r\n";
    assert!([400, 421].contains(&served.raw(none.as_bytes()).await.status));
    let whole = "GET http://evil.example/ HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    assert_eq!(served.raw(whole.as_bytes()).await.status, 400);
    let answer = served.raw(request("GET /goals/x", "localhost:1", "", "").as_bytes()).await;
    assert_eq!(answer.status, 200);
}

#[tokio::test]
async fn a_page_of_another_origin_changes_and_reads_nothing() {
    let served = Served::new().await;
    let session = served.sign_in("ada").await;
    let own = served.headers(&session);
    let origin = format!("Origin: http://{}\r\n", served.address);
    let foreign = [
        own.replace(&origin, "Origin: http://evil.example\r\n"),
        own.replace(&origin, "Origin: null\r\n"),
        own.replace(&origin, "Origin: http://127.0.0.1\r\n"),
        own.replace(&origin, &origin.replace("http:", "https:")),
        own.replace(&origin, &format!("{origin}{origin}")),
        format!("{own}Sec-Fetch-Site: cross-site\r\n"),
        format!("{own}Sec-Fetch-Site: same-site\r\n"),
    ];
    for headers in &foreign {
        for line in ["POST /api/acts", "POST /api/sign-out", "POST /api/sign-in"] {
            let answer = served.ask(line, headers, &stop()).await;
            assert_eq!(answer.status, 403, "{line} {headers}: {answer:?}");
        }
        for line in ["GET /api/events?topics=goals", "GET /api/me", "GET /api/setup"] {
            let answer = served.ask(line, headers, "").await;
            assert_eq!(answer.status, 403, "{line} {headers}: {answer:?}");
        }
    }
    let silent = served.ask("POST /api/acts", &own.replace(&origin, ""), &stop()).await;
    assert_eq!(silent.status, 403, "no page is named: {silent:?}");
    let log = served.log.recent(10);
    assert!(log.iter().all(|request| !request.what.contains("stop")), "no act: {log:?}");
    let forged = log.iter().find(|request| request.what == "/api/acts").expect("it is logged");
    assert!(forged.outcome.contains("another origin") && forged.person.is_none(), "{forged:?}");
    let answer = served.ask("POST /api/acts", &own, &stop()).await;
    assert_eq!((answer.status, &answer.json()["ok"]), (200, &json!(true)), "{answer:?}");
}

#[tokio::test]
async fn an_act_carries_the_token_of_its_session() {
    let served = Served::new().await;
    let (session, other) = (served.sign_in("ada").await, served.sign_in("ben").await);
    let own = served.headers(&session);
    let token = format!("X-Althing-CSRF: {}\r\n", session.csrf);
    for wrong in [
        String::new(),
        "X-Althing-CSRF: \r\n".to_owned(),
        format!("X-Althing-CSRF: {}\r\n", other.csrf),
        format!("X-Althing-CSRF: {}x\r\n", session.csrf),
        format!("{token}{token}"),
    ] {
        let headers = own.replace(&token, &wrong);
        let answer = served.ask("POST /api/acts", &headers, &stop()).await;
        assert_eq!(answer.status, 403, "{wrong}: {answer:?}");
        assert_eq!(served.ask("POST /api/sign-out", &headers, "").await.status, 403, "{wrong}");
    }
    assert_eq!(served.page(&session, "GET /api/me", "").await.status, 200, "still signed in");
    let log = served.log.recent(10);
    let told = log.iter().find(|request| request.what == "ask for an act").expect("it is logged");
    assert_eq!(told.person.as_ref().map(|it| it.as_str()), Some("ada"), "{told:?}");
}

#[tokio::test]
async fn a_forged_request_of_any_path_is_logged() {
    for (line, what) in [
        ("POST /api/sign-out", "sign out"),
        ("POST /api/push", "change notifications"),
        ("POST /api/push/remove", "change notifications"),
    ] {
        let served = Served::new().await;
        let session = served.sign_in("ada").await;
        let headers = served.headers(&session).replace(&session.csrf, "another");
        assert_eq!(served.ask(line, &headers, "{}").await.status, 403, "{line}");
        let log = served.log.recent(10);
        let told = log.iter().find(|request| request.what == what);
        let told = told.unwrap_or_else(|| panic!("{line} is not logged: {log:?}"));
        assert!(told.outcome.starts_with("refused: "), "{told:?}");
    }
}

#[tokio::test]
async fn only_the_cookie_of_an_open_session_counts() {
    let served = Served::new().await;
    let session = served.sign_in("ada").await;
    let secret = session.cookie.split_once('=').expect("a pair").1;
    for cookie in [
        String::new(),
        "Cookie: althing-made-up-pi-0=\r\n".to_owned(),
        "Cookie: althing-made-up-pi-0=x\r\n".to_owned(),
        format!("Cookie: Althing-made-up-pi-0={secret}\r\n"),
        format!("Cookie: __Host-althing-made-up-pi-0={secret}\r\n"),
        format!("Cookie: althing={secret}\r\n"),
        format!("Cookie: althing-made-up-pi-1={secret}\r\n"),
        format!("Cookie: althing-screen-made-up-pi-0={secret}\r\n"),
        format!("Cookie: althing-made-up-pi-0={secret}x\r\n"),
        format!("Cookie: althing-made-up-pi-0=x; althing-made-up-pi-0={secret}\r\n"),
        format!("Cookie: althing-made-up-pi-0={}\r\n", "a".repeat(4_000)),
        "Authorization: Bearer althing_x\r\n".to_owned(),
        format!("Authorization: Basic {secret}\r\nCookie: althing-made-up-pi-0={secret}\r\n"),
    ] {
        for line in
            ["GET /api/me", "GET /api/setup", "GET /api/events?topics=goals", "GET /api/log"]
        {
            let answer = served.ask(line, &cookie, "").await;
            assert_eq!(answer.status, 401, "{line} {cookie}: {answer:?}");
            assert!(!answer.problem().is_empty());
        }
    }
}

#[tokio::test]
async fn wrong_bodies_and_paths_are_refused_with_a_sentence() {
    let served = Served::new().await;
    let session = served.sign_in("ada").await;
    let status = |answer: &Answer| {
        assert!(answer.problem().len() > 10, "{answer:?}");
        answer.status
    };
    let long = format!("{{\"act\":\"set\",\"fact\":\"{}\"}}", "x".repeat(70_000));
    for (body, expected) in [
        ("", 400),
        ("{", 400),
        ("[]", 400),
        ("{\"act\":\"nothing\"}", 400),
        ("{\"act\":\"set\"}", 400),
        ("{\"act\":\"answer\",\"keyboard\":\"k\",\"question\":-1,\"text\":\"\"}", 400),
        (long.as_str(), 413),
    ] {
        let answer = served.page(&session, "POST /api/acts", body).await;
        assert_eq!(status(&answer), expected, "{}", &body[..body.len().min(80)]);
        assert!(!answer.problem().contains("xxx"), "it does not quote the body");
    }
    let deep = "[".repeat(60_000);
    assert_eq!(status(&served.page(&session, "POST /api/acts", &deep).await), 400);
    let form = served.headers(&session).replace("application/json", "text/plain");
    assert_eq!(status(&served.ask("POST /api/acts", &form, &stop()).await), 415);
    for (line, expected) in [
        ("GET /api/goals/none", 404),
        ("GET /api/agents/No%20Name", 404),
        ("GET /api/agents/%ff", 400),
        ("GET /api/cameras/lamp-2", 404),
        ("GET /api/history", 404),
        ("GET /api/history?limits=1", 400),
        ("GET /api/events", 400),
        ("GET /api/events?topics=evil", 400),
        ("GET /api/events?topics=goal:a%0Aevent:%20x", 400),
        ("GET /api/nothing", 404),
        ("GET /assets/../Cargo.toml", 404),
        ("GET /assets/%2e%2e/Cargo.toml", 404),
        ("DELETE /api/me", 405),
        ("GET /api/acts", 405),
    ] {
        let answer = served.page(&session, line, "").await;
        assert_eq!(status(&answer), expected, "{line}: {answer:?}");
    }
    let page = served.ask("GET /no/such/page", "", "").await;
    assert_eq!(page.status, 404, "{page:?}");
    assert_eq!(page.header("content-type"), Some("text/html; charset=utf-8"), "for a person");
    let path = format!("GET /goals/{}", "x".repeat(7_000));
    assert_eq!(status(&served.page(&session, &path, "").await), 414);
}
