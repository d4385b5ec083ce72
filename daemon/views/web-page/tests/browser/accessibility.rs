//! Every page is held against WCAG 2.2 AA by axe-core, light and dark, wide and narrow, and must not
//! scroll sideways.

use std::path::PathBuf;
use std::time::Duration;

use crate::chromium::Chromium;
use crate::left_out::left_out;
use crate::site::Site;

/// The environment variable that names `axe.min.js` of the package axe-core.
const AXE: &str = "ALTHING_AXE";

/// The pages, each with what it shows when it is drawn.
const PAGES: &[(&str, &str)] = &[
    ("/", ".verdict"),
    ("/goals", ".table-row"),
    ("/goals/GOAL", ".gantt"),
    ("/ask", ".builder"),
    ("/questions", ".question"),
    ("/floor", ".room"),
    ("/agents", ".table-row"),
    ("/agents/robot-0", ".small-table"),
    ("/world", ".table-row"),
    ("/world?fact=(temperature%20room-0)", ".card .pairs"),
    ("/activity", ".activity li"),
    ("/conversations", ".table-row"),
    ("/conversations/GOAL", ".sequence"),
    ("/daemons", ".card .pairs"),
    ("/inbox", ".card"),
    ("/people", ".card"),
    ("/history", ".empty"),
    ("/robot/robot-0", ".pin-pad"),
    ("/goals/unknown", ".empty"),
];

const SIZES: &[(u32, u32)] = &[(1280, 860), (360, 740)];

/// Script that returns what axe-core finds, one line each.
const FINDINGS: &str = "axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'] })
    .then((found) => found.violations.map((one) => one.id + ': ' + one.nodes.map((node) => node.target + ' ' + node.failureSummary).join('; ')))";

fn axe() -> Option<String> {
    let file = std::env::var_os(AXE).map(PathBuf::from);
    let text = file.and_then(|file| std::fs::read_to_string(file).ok());
    if text.is_none() {
        left_out("no file axe.min.js of the package axe-core; ALTHING_AXE names it");
    }
    text
}

/// Returns what is wrong with the page that is shown.
fn findings(browser: &mut Chromium, axe: &str, page: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (width, height) in SIZES {
        browser.resize(*width, *height);
        for scheme in ["light", "dark"] {
            browser.prefer(scheme);
            browser.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))).then(() => 1)");
            let sideways = browser.evaluate("document.documentElement.scrollWidth - innerWidth");
            if sideways.as_f64().is_some_and(|beyond| beyond > 0.0) {
                found.push(format!("{page}, {width} px: scrolls sideways by {sideways}"));
            }
            if browser.evaluate("typeof axe") == "undefined" {
                browser.evaluate(&format!("{axe};1"));
            }
            let violations = browser.evaluate(FINDINGS);
            for violation in violations.as_array().expect("findings") {
                found.push(format!("{page}, {width} px, {scheme}: {violation}"));
            }
            let name = page.trim_matches('/').replace(['/', '?', '='], "-");
            browser.picture(&format!("{name}-{width}-{scheme}"));
        }
    }
    found
}

/// An ecosystem in which there is something to be seen on every page.
pub(crate) fn busy_site() -> Site {
    let site = Site::start(40);
    let within = Duration::from_secs(600);
    site.host.ask("robot-0", "May I enter the office?", within, false);
    site.host.ask("robot-0", "What is the PIN?", within, true);
    site.host.discover("kitchen-plug");
    site
}

#[test]
fn every_page_is_accessible() {
    let Some(axe) = axe() else { return };
    let Some(mut browser) = Chromium::start() else { return };
    let site = busy_site();
    browser.open(&site.page("/goals"));
    browser.wait_for("document.querySelector('input[name=password]')");
    let mut found = findings(&mut browser, &axe, "/sign-in");
    site.sign_in(&mut browser, "/ask");
    let goal = ask_for_goal(&mut browser);
    for (page, part) in PAGES {
        let page = &page.replace("GOAL", &goal);
        browser.open(&site.page(page));
        browser.wait_for(&format!("document.querySelector({part:?})"));
        found.extend(findings(&mut browser, &axe, page));
    }
    found.extend(findings_while_acting(&mut browser, &axe, &site));
    assert!(found.is_empty(), "{found:#?}");
    browser.assert_no_problems();
}

/// Returns what is wrong with pages on which a person has begun something.
fn findings_while_acting(browser: &mut Chromium, axe: &str, site: &Site) -> Vec<String> {
    browser.open(&site.page("/floor"));
    browser.click("button", "Arrange");
    browser.wait_for("document.querySelector('.room[tabindex]')");
    let mut found = findings(browser, axe, "/floor, arranging");
    browser.open(&site.page("/ask"));
    browser.click("button", "Dry run");
    browser.wait_for("document.querySelector('.result .card')");
    browser.click(".stop-button", "Stop");
    browser.wait_for(
        "document.querySelector('.stop-panel') && document.querySelector('.stops-in-force')",
    );
    browser.click("summary", "What became of the stop");
    found.extend(findings(browser, axe, "/ask, stopped"));
    found
}

/// Asks for a goal, so that there is one, and returns its conversation.
pub(crate) fn ask_for_goal(browser: &mut Chromium) -> String {
    let script =
        "fetch('/api/me').then((answer) => answer.json()).then((me) => fetch('/api/acts', {
        method: 'POST', headers: { 'Content-Type': 'application/json', 'X-Althing-CSRF': me.csrf },
        body: JSON.stringify({ act: 'goal', goal: '(at robot-0 room-3)', mode: 'reach' }) }))
        .then((answer) => answer.json()).then((outcome) => outcome.conversation)";
    browser.evaluate(script).as_str().expect("a conversation").to_owned()
}
