//! What a page shows beside rows: pictures of cameras, charts of values that the history keeps, what is
//! private, and notifications.

use accounts::PersonRight;
use serde_json::json;

use crate::chromium::Chromium;
use crate::site::Site;

#[test]
fn a_picture_of_a_camera_is_shown_whatever_its_format() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    site.sign_in(&mut browser, "/agents/robot-0");
    browser.click("main button", "Show the picture");
    browser.wait_for("document.querySelector('img.camera')?.naturalWidth === 32");
    let pixel = browser.evaluate(
        "(() => { const canvas = document.createElement('canvas'); canvas.width = 32; canvas.height = 24;
           const context = canvas.getContext('2d'); context.drawImage(document.querySelector('img.camera'), 0, 0);
           return [...context.getImageData(5, 0, 1, 1).data]; })()",
    );
    assert_eq!(pixel, json!([255, 5, 0, 255]), "the pixels are those of the camera");
    browser.picture("camera");
    browser.assert_no_problems();
}

#[test]
fn a_chart_begins_with_what_the_history_keeps() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    site.host.keep_history();
    site.host.set_value(1, 19);
    site.sign_in(&mut browser, "/world?fact=(temperature%20room-0)");
    browser.wait_for("document.querySelector('.chart svg')");
    // Six values of the last hours, and those that the page has seen.
    browser
        .wait_for("document.querySelector('.chart svg').getAttribute('aria-label').includes('21')");
    browser.click(".chart summary", "");
    browser.wait_for("document.querySelectorAll('.chart tbody tr').length >= 7");
    let rows = browser.texts(".chart tbody tr");
    assert!(rows.last().is_some_and(|row| row.contains("21")), "the oldest is last: {rows:?}");
    browser.picture("chart");
    browser.assert_no_problems();
}

#[test]
fn what_is_private_is_shown_to_whoever_has_the_right() {
    let Some(mut browser) = Chromium::start() else { return };
    for (rights, is_shown) in [(PersonRight::ALL.into(), true), ([PersonRight::Look].into(), false)]
    {
        let site = Site::start_with(10, rights);
        site.host.keep_history();
        site.sign_in(&mut browser, "/history");
        browser.wait_for("document.querySelector('main').innerText.includes('robot-0 has moved')");
        let shown = browser.evaluate("document.querySelector('main').innerText");
        let shown = shown.as_str().expect("a text");
        assert_eq!(shown.contains("the safe is open"), is_shown, "{shown}");
        assert_eq!(shown.contains("private"), is_shown, "{shown}");
    }
    browser.assert_no_problems();
}

#[test]
fn notifications_are_offered_if_the_daemon_sends_them() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.sign_in(&mut browser, "/people");
    browser.wait_for("document.querySelector('main').innerText.includes('Notifications')");
    browser.wait_for("![...document.querySelectorAll('.card')].some((card) => card.innerText.includes('Loading'))");
    assert_eq!(browser.evaluate("document.querySelector('.push-button') === null"), true);
    site.host.keep_history();
    browser.open(&site.page("/people"));
    browser.wait_for("document.querySelector('.push-button')");
    // A person who refuses is told what that means.
    browser.permit(&site.page(""), "notifications", "denied");
    browser.click(".push-button", "");
    browser.wait_for("document.querySelector('.push-problem').innerText.trim() !== ''");
    browser.assert_no_problems();
}

#[test]
fn a_notification_is_shown_and_hides_nothing() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.sign_in(&mut browser, "/people");
    browser.permit(&site.page(""), "notifications", "granted");
    browser.call("ServiceWorker.enable", json!({}));
    browser.evaluate(
        "navigator.serviceWorker.register('/assets/service-worker.js', { scope: '/' })
            .then(() => navigator.serviceWorker.ready).then(() => 1)",
    );
    let registration = browser.service_worker();
    let said = json!({
        "title": "Question", "text": "May I \u{202e}enter?", "id": "q1", "link": "/questions",
    });
    for (data, count) in [(said.to_string(), 1), ("no JSON".to_owned(), 2)] {
        let push = json!({
            "origin": site.page(""), "registrationId": registration, "data": data,
        });
        browser.call("ServiceWorker.deliverPushMessage", push);
        browser.evaluate(&format!(
            "new Promise(async (done) => {{
                const worker = await navigator.serviceWorker.ready;
                for (;;) {{
                    const shown = await worker.getNotifications();
                    if (shown.length === {count}) return done(1);
                    await new Promise((next) => setTimeout(next, 50));
                }}
            }})"
        ));
    }
    let shown = browser.evaluate(
        "navigator.serviceWorker.ready.then((worker) => worker.getNotifications())
            .then((all) => all.filter((one) => one.tag === 'q1').map((one) => [one.title, one.body, one.data.address]))",
    );
    assert_eq!(shown, json!([["Question", "May I \u{b7}enter?", "/questions"]]));
    browser.assert_no_problems();
}
