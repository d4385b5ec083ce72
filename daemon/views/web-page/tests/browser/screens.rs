//! The browser of a robot, at which nobody signs in: it shows the robot, takes its PIN and stops it.

use std::time::Duration;

use crate::chromium::Chromium;
use crate::site::{PASSWORD, PERSON, SCREEN, Site};

/// What a screen shows of its robot once it is there.
const SHOWN: &str = "document.querySelector('.robot-place')";

#[test]
fn a_screen_shows_its_robot_and_takes_a_pin_without_a_person() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    let link = site.add_screen("robot-0");
    browser.resize(800, 1280);
    browser.open(&site.page(&format!("/robot/robot-0{link}")));
    browser.wait_for(SHOWN);
    assert_eq!(browser.evaluate("location.hash + location.search"), "", "the key is gone from it");
    assert_eq!(browser.evaluate("document.querySelector('input') === null"), true);
    assert_eq!(browser.evaluate("document.querySelectorAll('main a').length"), 0);
    site.host.ask("robot-10", "Where am I?", Duration::from_secs(300), false);
    site.host.ask("robot-0", "What is the PIN?", Duration::from_secs(300), true);
    browser.wait_for("document.querySelector('.pin-pad')");
    assert_eq!(browser.texts(".question-text"), ["What is the PIN?"]);
    for digit in ["4", "2"] {
        browser.click(".pin-pad button", digit);
    }
    browser.wait_for("document.querySelector('.question-large input').value === '42'");
    browser.picture("screen-pin");
    browser.click(".question-large button", "Answer");
    browser.wait_for("!document.querySelector('.question-large')");
    browser.wait_for("document.querySelector('.last-answer .outcome-ok')");

    // The browser is started anew: the cookie is enough. Another page leads back to the robot.
    browser.open(&site.page("/goals"));
    browser.wait_for(&format!("{SHOWN} && location.pathname === '/robot/robot-0'"));
    let refused =
        browser.evaluate("fetch('/api/events?topics=goals').then((answer) => answer.status)");
    assert_eq!(refused, 403);
    browser.click(".stop-button", "Stop this robot");
    browser.wait_for("document.querySelector('.stop-panel tbody tr, .stop-panel summary')");
    let rows = browser.evaluate("document.querySelectorAll('.stop-panel tbody tr').length");
    assert_eq!(rows, 1, "this robot alone");
    browser.wait_for("document.querySelector('.robot-now').innerText.includes('stopped')");
    browser.assert_no_problems();
}

#[test]
fn a_person_signs_in_at_a_screen_and_leaves_it_to_the_next() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    let link = site.add_screen("robot-0");
    browser.open(&site.page(&format!("/robot/robot-0{link}")));
    browser.wait_for(SHOWN);
    browser.click(".screen-foot button", "Sign in");
    browser.wait_for("document.activeElement?.name === 'username'");
    browser.type_text(PERSON);
    browser.press("Tab");
    browser.type_text(PASSWORD);
    browser.press("Enter");
    browser.wait_for("document.querySelector('.robot-foot button')");
    browser.wait_for("document.querySelector('.top-verdict')");
    browser.click(".robot-foot button", "sign out");
    browser.wait_for(&format!("{SHOWN} && !document.querySelector('.robot-foot')"));
    assert_eq!(browser.evaluate("document.querySelector('.top-verdict') === null"), true);

    // A screen that is removed asks for a person, and its link makes no other one.
    site.people.change(|people| people.remove(SCREEN)).expect("a removal");
    browser.wait_for("document.querySelector('input[name=password]')");
    browser.open(&site.page("/goals"));
    browser.open(&site.page(&format!("/robot/robot-0{link}")));
    browser
        .wait_for("document.querySelector('.problem')?.innerText.includes('not valid any more')");
    browser.assert_no_problems();
}
