//! Names and texts from outside are texts, whatever they contain.

use std::time::Duration;

use crate::chromium::Chromium;
use crate::made_up::{messages, now};
use crate::site::Site;
use live_view::ViewEvent;

/// Texts that would act or mislead, if a page let them.
const TEXTS: &[&str] = &[
    "<img src=x onerror=alert(1)>",
    "<script>alert(1)</script>",
    "\"><svg onload=alert(1)>",
    "' onfocus='alert(1)' autofocus='",
    "javascript:alert(1)",
    "</title><iframe srcdoc='<script>alert(1)</script>'>",
    "{{constructor.constructor('alert(1)')()}} ${alert(1)}",
    "office\u{202e}1-nimda\u{2066}",
    "a\u{1b}[2J\u{7}b\u{9b}",
    "&lt;b&gt; &#60;i&#62;",
];

const PAGES: &[&str] = &[
    "/",
    "/goals",
    "/goals/hostile-0",
    "/questions",
    "/activity",
    "/conversations",
    "/conversations/hostile-0",
    "/robot/robot-0",
    "/agents/%3Cimg%20src=x%20onerror=alert(1)%3E",
    "/goals?filter=%3Cimg%20src=x%20onerror=alert(1)%3E",
    "/world?fact=%3Cscript%3Ealert(1)%3C/script%3E",
    "/goals/%3Csvg%20onload=alert(1)%3E",
];

#[test]
fn texts_from_outside_stay_texts_on_every_page() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    for (number, text) in TEXTS.iter().enumerate() {
        site.host.ask("robot-0", text, Duration::from_secs(600), number % 2 == 0);
        let goal = format!("hostile-{number}");
        let begun = messages::goal_begins(&goal, "ada", text, "(move robot-0 room-0 room-1)");
        let ended = messages::goal_done(&goal, text);
        let all = begun.into_iter().chain(ended);
        site.host
            .observe(now(), all.map(|message| ViewEvent::Message(Box::new(message))).collect());
    }
    site.sign_in(&mut browser, "/questions");
    browser.wait_for(&format!("document.querySelectorAll('.question').length === {}", TEXTS.len()));
    let shown = browser.evaluate("document.querySelector('main').innerText");
    let shown = shown.as_str().expect("a text");
    for text in TEXTS.iter().filter(|text| text.is_ascii() && !text.contains('\u{1b}')) {
        assert!(shown.contains(text), "{text} in {shown}");
    }
    assert!(shown.contains("office\\u{202e}1-nimda\\u{2066}"), "{shown}");
    assert!(shown.contains("a␛[2J␇b\\u{9b}"), "{shown}");
    for page in PAGES {
        browser.open(&site.page(page));
        browser.wait_for("document.querySelector('.stop-button') && !document.querySelector('.empty')?.innerText.includes('Loading')");
        let foreign = "document.querySelectorAll('main img[src=x], iframe, svg[onload], script:not([src^=\"/assets/\"]), [onfocus], [onerror], a[href^=javascript]').length";
        assert_eq!(browser.evaluate(foreign), 0, "{page}");
        let hidden = "/[\\u202a-\\u202e\\u2066-\\u2069\\u0000-\\u0008\\u001b\\u0080-\\u009f]/.test(document.body.innerText + document.title)";
        assert_eq!(browser.evaluate(hidden), false, "{page}");
    }
    browser.assert_no_problems();
}

#[test]
fn inline_scripts_and_styles_are_refused_by_the_policy() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.sign_in(&mut browser, "/");
    browser.evaluate(
        "(() => { const script = document.createElement('script'); script.textContent = 'window.ran = 1';
           document.body.append(script);
           const holder = document.createElement('div'); holder.innerHTML = '<img src=x onerror=\"window.ran = 2\">';
           document.body.append(holder); })()",
    );
    browser.wait_for("document.querySelector('img[src=x]').complete");
    assert_eq!(browser.evaluate("window.ran === undefined"), true);
    assert!(!browser.problems.is_empty(), "the browser tells that it has refused them");
}
