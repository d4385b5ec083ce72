//! The keyboard alone reaches everything, and one always sees where one is.

use crate::accessibility::{ask_for_goal, busy_site};
use crate::chromium::Chromium;

const PAGES: &[&str] = &[
    "/",
    "/goals",
    "/goals/GOAL",
    "/ask",
    "/questions",
    "/floor",
    "/agents",
    "/agents/robot-0",
    "/world",
    "/activity",
    "/conversations",
    "/conversations/GOAL",
    "/daemons",
    "/inbox",
    "/people",
    "/robot/robot-0",
];

/// Presses of Tab on one page: more than any page of the test has places for.
const PRESSES_MAX: usize = 400;

/// Script that names what a pointer reaches on a page.
const REACHABLE: &str = "window.reachable = () => [...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex=\"0\"]')]
    .filter((one) => !one.disabled && one.checkVisibility({ visibilityProperty: true }) && one.tabIndex >= 0)
    // One of a group of radio buttons has the focus for all of them.
    .filter((one) => one.type !== 'radio' || one.checked)";

/// Script that begins to note what has the focus, and whether that is seen. Devices move all the while:
/// a row that appears behind the focus is reached in the next round, so only what is there now counts.
const WATCH: &str = "(() => {
    window.reached = new Set();
    window.unseen = [];
    window.there = new Set(window.reachable());
    document.addEventListener('focusin', (event) => {
        window.reached.add(event.target);
        const style = getComputedStyle(event.target);
        const isHeading = event.target.tabIndex === -1;
        if (!isHeading && (style.outlineStyle === 'none' || parseFloat(style.outlineWidth) < 1)) window.unseen.push(event.target.outerHTML.slice(0, 120));
    });
    document.activeElement?.blur();
})()";

/// Script that returns what a pointer has reached all the time, and the keyboard has not.
const MISSED: &str = "window.reachable().filter((one) => window.there.has(one) && !window.reached.has(one)).map((one) => one.outerHTML.slice(0, 160))";

#[test]
fn the_tab_key_reaches_everything_on_every_page() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = busy_site();
    site.sign_in(&mut browser, "/");
    let goal = ask_for_goal(&mut browser);
    for page in PAGES {
        browser.open(&site.page(&page.replace("GOAL", &goal)));
        browser.wait_for("document.querySelector('.stop-button') && document.querySelector('.top-verdict') && !document.querySelector('.empty')?.innerText.includes('Loading')");
        // A stop that is pressed by no finger must not be pressed by this test, either.
        browser.evaluate(REACHABLE);
        browser.evaluate(WATCH);
        let there = browser.evaluate("window.there.size");
        assert!(there.as_u64().is_some_and(|places| places > 5), "{page}: {there} places");
        for _ in 0..PRESSES_MAX {
            browser.press("Tab");
            if browser
                .evaluate("document.activeElement === document.body && window.reached.size > 5")
                == true
            {
                break;
            }
        }
        let missed = browser.evaluate(MISSED);
        assert_eq!(missed.as_array().map(Vec::len), Some(0), "{page}: {missed:#}");
        let unseen = browser.evaluate("window.unseen");
        assert_eq!(unseen.as_array().map(Vec::len), Some(0), "{page}: {unseen:#}");
    }
    browser.assert_no_problems();
}

#[test]
fn a_page_that_is_opened_by_a_link_is_said_and_the_menu_closes_by_escape() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = busy_site();
    browser.resize(360, 740);
    site.sign_in(&mut browser, "/");
    browser.wait_for("document.querySelector('.verdict')");
    browser.click(".menu-button", "");
    browser.wait_for(
        "document.querySelector('.menu-button').getAttribute('aria-expanded') === 'true'",
    );
    browser.press("Escape");
    browser.wait_for("document.querySelector('.menu-button').getAttribute('aria-expanded') === 'false' && document.activeElement.className === 'menu-button'");
    browser.press("Enter");
    browser.click(".side a", "Agents");
    browser.wait_for(
        "document.activeElement?.tagName === 'H1' && document.activeElement.innerText === 'Agents'",
    );
    browser.wait_for("document.title.startsWith('Agents')");
    browser.assert_no_problems();
}

#[test]
fn a_focus_is_kept_while_rows_change_and_while_one_scrolls() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = crate::site::Site::start(400);
    site.sign_in(&mut browser, "/agents");
    browser.wait_for("document.querySelectorAll('.table-body .table-row').length > 20");
    // The agents come one after another: a page of some of them is not that long yet.
    browser.wait_for("document.documentElement.scrollHeight > 9000 + innerHeight");
    browser.evaluate("(() => { const link = document.querySelector('.table-body a'); link.focus(); window.focused = link; scrollTo(0, 9000); })()");
    browser.wait_for(
        "scrollY > 4000 && document.querySelectorAll('.table-body .table-row').length > 20",
    );
    assert_eq!(browser.evaluate("document.activeElement === window.focused"), true);
    let drawn = browser.evaluate("document.querySelectorAll('.table-body .table-row').length");
    assert!(drawn.as_u64().is_some_and(|rows| rows < 120), "{drawn} rows are drawn");
    browser.assert_no_problems();
}

#[test]
fn rooms_are_moved_by_keys_and_stay_where_they_were_put() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = busy_site();
    site.sign_in(&mut browser, "/floor");
    // The rooms of forty agents: a layout of some of them would be another one.
    browser.wait_for("document.querySelectorAll('.room').length === 8");
    browser.click("button", "Arrange");
    browser.wait_for("document.querySelector('.room[tabindex]')");
    let place = "document.querySelector('.room').getAttribute('transform')";
    let before = browser.evaluate(place);
    browser.evaluate("document.querySelector('.room').focus()");
    browser.press("ArrowRight");
    browser.press("ArrowDown");
    browser.wait_for(&format!("{place} !== {before}"));
    let moved = browser.evaluate(place);
    browser.open(&site.page("/floor"));
    browser.wait_for(&format!("{place} === {moved}"));
    browser.click("button", "Arrange");
    browser.click("button", "Lay out by itself");
    browser.wait_for(&format!("{place} === {before}"));
    browser.assert_no_problems();
}
