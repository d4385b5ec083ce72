//! What a person does on a page, watched to the end by what is on it.

use std::time::Duration;

use accounts::PersonRight;

use crate::accessibility::ask_for_goal;
use crate::chromium::Chromium;
use crate::site::{PASSWORD, PERSON, Site};

#[test]
fn a_wrong_password_is_refused_in_a_sentence() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    browser.open(&site.page("/goals"));
    browser.wait_for("document.activeElement?.name === 'username'");
    browser.type_text(PERSON);
    browser.press("Tab");
    browser.type_text("another password");
    browser.press("Enter");
    browser.wait_for("document.querySelector('[role=alert]').innerText.trim() !== ''");
    browser.wait_for("document.querySelector('input[name=password]').value === ''");
    assert_eq!(browser.evaluate("document.querySelector('.stop-button') === null"), true);
    browser.click("input[name=password]", "");
    browser.type_text(PASSWORD);
    browser.press("Enter");
    browser.wait_for("document.querySelector('h1')?.innerText === 'Goals'");
    assert_eq!(browser.evaluate("location.pathname"), "/goals");
    browser.assert_no_problems();
}

#[test]
fn a_goal_is_built_tried_asked_for_and_watched_to_its_end() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    site.sign_in(&mut browser, "/ask");
    browser.wait_for("document.querySelector('.condition select')");
    browser.evaluate(
        "(() => { const select = [...document.querySelectorAll('.condition select')].at(-1);
           select.value = 'room-2'; select.dispatchEvent(new Event('change', { bubbles: true })); })()",
    );
    browser.wait_for("document.querySelector('.pddl textarea').value.endsWith('room-2)')");
    let goal = browser.evaluate("document.querySelector('.pddl textarea').value");
    assert_eq!(goal, "(at robot-0 room-2)");
    browser
        .wait_for("document.querySelector('.in-words')?.innerText.includes('robot-0 at room-2')");
    browser.click("button", "Dry run");
    browser.wait_for("document.querySelector('.result table')");
    let result = browser.evaluate("document.querySelector('.result').innerText");
    let result = result.as_str().expect("a text");
    for part in ["(move robot-0 room-0 room-1)", "(move robot-0 room-1 room-2)", "2 steps, cost 2"]
    {
        assert!(result.contains(part), "{part} in {result}");
    }
    assert!(result.contains("It would undo") && result.contains("(at robot-0 room-0)"), "{result}");
    let goals = "fetch('/api/events?topics=goals').then(async (answer) => new TextDecoder().decode((await answer.body.getReader().read()).value))";
    let asked = browser.evaluate(goals);
    assert!(!asked.as_str().expect("an event").contains("room-2"), "a dry run asks for nothing");
    browser.click("button", "Ask for it");
    browser.click(".outcome a", "Show the goal");
    browser.wait_for("document.querySelector('.gantt .step-running')");
    browser.wait_for("document.querySelectorAll('.gantt .step-done').length === 2");
    browser.wait_for("document.querySelector('.lead').innerText.includes('done')");
    browser.picture("goal-done");
    browser.assert_no_problems();
}

#[test]
fn an_object_that_comes_or_goes_does_not_change_the_goal() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    site.sign_in(&mut browser, "/ask");
    let goal = "document.querySelector('.pddl textarea').value";
    browser.wait_for(&format!("{goal} === '(at robot-0 room-0)'"));
    let places = "[...document.querySelectorAll('.condition select')].at(-1)";
    let is_listed = format!("[...{places}.options].some((one) => one.value === 'annex')");
    let ask_again = "import('/assets/lib/api.js').then((api) => api.loadSetup())";

    site.host.set_places(&["annex"]);
    browser.evaluate(ask_again);
    browser.wait_for(&is_listed);
    assert_eq!(browser.evaluate(goal), "(at robot-0 room-0)", "the annex sorts before room-0");

    browser.evaluate(&format!(
        "{places}.value = 'annex'; {places}.dispatchEvent(new Event('change', {{ bubbles: true }}))"
    ));
    browser.wait_for(&format!("{goal} === '(at robot-0 annex)'"));
    site.host.set_places(&[]);
    browser.evaluate(ask_again);
    browser.wait_for(&format!("{places}.selectedOptions[0].innerText === 'annex (gone)'"));
    assert_eq!(browser.evaluate(goal), "", "there is no such place");
    let ask = "document.querySelector('.builder .primary').disabled";
    assert_eq!(browser.evaluate(ask), true);
    browser.assert_no_problems();
}

#[test]
fn a_goal_by_the_clock_is_listed_in_words_and_cancelled() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.host.schedule("warm", 7, "(lit lamp-2)");
    site.sign_in(&mut browser, "/goals");
    let row = "document.querySelector('.table-body .table-row')?.innerText ?? ''";
    browser.wait_for(&format!("({row}).includes('light in lamp-2 on')"));
    let shown = browser.evaluate(row);
    let shown = shown.as_str().expect("a text");
    for part in ["7", "by the clock", "next: ", "every day", "the ecosystem file"] {
        assert!(shown.contains(part), "{part} in {shown}");
    }
    let behind = "document.querySelector('.table-body .table-row bdi[title]').title";
    assert_eq!(browser.evaluate(behind), "(lit lamp-2)");
    browser.choose(".choices-row label:nth-child(2) select", "pddl");
    browser.wait_for(&format!("({row}).includes('(lit lamp-2)')"));
    browser.choose(".choices-row label:nth-child(2) select", "words");
    browser.choose(".choices-row select", "de");
    browser.wait_for(&format!("({row}).includes('Licht in lamp-2 an')"));
    browser.choose(".choices-row select", "en");
    browser.click(".table-body a", "light in lamp-2 on");
    browser.wait_for("document.querySelector('.page-title p')?.innerText === 'Goal 7'");
    browser.picture("goal-by-the-clock");
    browser.click("button", "Cancel the goal");
    browser.click("button", "Yes, cancel it");
    browser.wait_for("document.querySelector('.outcome')?.innerText.includes('cancelled')");
    browser.assert_no_problems();
}

#[test]
fn fixed_sentences_are_said_in_the_language_of_the_page() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    site.sign_in(&mut browser, "/");
    browser.wait_for("document.querySelector('.verdict-text')?.innerText.includes('all is well')");
    browser.choose("select", "de");
    browser.wait_for(
        "document.querySelector('.verdict-text').innerText.includes('alles ist gut: keine Ziele, 20 Agenten sind da')",
    );
    ask_for_goal(&mut browser);
    browser.wait_for(
        "document.querySelector('.activity').innerText.includes('fordert an: (at robot-0 room-3)')",
    );
    browser.wait_for(
        "document.querySelector('.activity').innerText.includes('(at robot-0 room-3) ist erreicht')",
    );
    browser.assert_no_problems();
}

#[test]
fn the_stop_button_stops_a_move_and_a_release_ends_the_stop() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(20);
    site.sign_in(&mut browser, "/floor");
    ask_for_goal(&mut browser);
    browser.wait_for("document.querySelector('.path')");
    browser.click(".stop-button", "Stop");
    browser.wait_for(
        "document.querySelector('.stop-panel')?.innerText.includes('all agents have stopped')",
    );
    browser.wait_for("document.querySelector('.stops-in-force')");
    browser.picture("stopped");
    let rows = browser.evaluate("document.querySelectorAll('.stop-panel tbody tr').length");
    assert_eq!(rows, 20, "one row for each agent");
    browser.click(".side a", "Overview");
    browser.wait_for("document.querySelector('h1').innerText === 'Overview' && document.querySelector('.stops-in-force')");
    browser.click(".stops-in-force button", "Release");
    browser.wait_for("!document.querySelector('.stops-in-force')");
    browser.wait_for("document.querySelector('.stop-panel')");
    browser.click(".stop-panel button", "Close");
    browser.wait_for("!document.querySelector('.stop-panel')");
    browser.assert_no_problems();
}

#[test]
fn questions_are_answered_from_a_phone_and_secrets_stay_nowhere() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    browser.resize(360, 740);
    site.sign_in(&mut browser, "/questions");
    browser.wait_for("document.querySelector('.empty')");
    site.host.ask("robot-0", "What is the PIN?", Duration::from_secs(300), true);
    browser.wait_for("document.querySelector('.question input')?.type === 'password'");
    browser.wait_for("document.querySelector('.question [role=timer]').innerText.includes('left')");
    browser.click(".question input", "");
    browser.type_text("271828");
    browser.picture("question");
    browser.click(".question button", "Answer");
    browser.wait_for("!document.querySelector('.question')");
    let left = "document.documentElement.outerHTML.includes('271828') || JSON.stringify(localStorage).includes('271828') || location.href.includes('271828')";
    assert_eq!(browser.evaluate(left), false);
    browser.assert_no_problems();
}

#[test]
fn a_robots_screen_takes_a_pin_by_fingers() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.host.ask("robot-0", "What is the PIN?", Duration::from_secs(300), true);
    browser.resize(800, 1280);
    site.sign_in(&mut browser, "/robot/robot-0");
    browser.wait_for("document.querySelector('.robot-place')");
    for digit in ["4", "2"] {
        browser.click(".pin-pad button", digit);
    }
    browser.wait_for("document.querySelector('.question-large input').value === '42'");
    browser.picture("robot");
    browser.click(".question-large button", "Answer");
    browser.wait_for("!document.querySelector('.question-large')");
    browser.assert_no_problems();
}

#[test]
fn a_discovered_device_is_admitted_with_one_button() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.host.discover("kitchen-plug");
    site.sign_in(&mut browser, "/inbox");
    browser.wait_for("document.querySelector('.side a[href=\"/inbox\"] .badge')");
    browser.click("main button", "Ask to admit it");
    browser.wait_for("document.querySelector('main').innerText.includes('It takes part.')");
    browser.wait_for("!document.querySelector('.side a[href=\"/inbox\"] .badge')");
    browser.assert_no_problems();
}

#[test]
fn who_may_only_look_is_offered_nothing_else_but_the_stop() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start_with(10, [PersonRight::Look].into());
    site.host.ask("robot-0", "May I?", Duration::from_secs(300), false);
    site.host.discover("kitchen-plug");
    site.sign_in(&mut browser, "/questions");
    browser.wait_for("document.querySelector('.question')");
    assert_eq!(browser.evaluate("document.querySelector('.question input') === null"), true);
    browser.open(&site.page("/ask"));
    browser.wait_for("document.querySelector('main').innerText.includes('not ask for goals')");
    browser.open(&site.page("/inbox"));
    browser.wait_for("document.querySelector('main').innerText.includes('but not admit')");
    browser.click(".stop-button", "Stop");
    browser.wait_for("document.querySelector('.stop-panel')");
    browser.assert_no_problems();
}

#[test]
fn the_language_is_chosen_in_the_page_and_remembered() {
    let Some(mut browser) = Chromium::start() else { return };
    let site = Site::start(10);
    site.sign_in(&mut browser, "/goals");
    browser.evaluate(
        "(() => { const select = document.querySelector('.choices-row select');
           select.value = 'de'; select.dispatchEvent(new Event('change', { bubbles: true })); })()",
    );
    browser.wait_for("document.querySelector('h1').innerText === 'Ziele'");
    assert_eq!(browser.evaluate("document.documentElement.lang"), "de");
    browser.open(&site.page("/agents"));
    browser.wait_for("document.querySelector('h1').innerText === 'Agenten'");
    browser.wait_for("document.querySelector('.stop-button').innerText === 'Stopp'");
    browser.assert_no_problems();
}
