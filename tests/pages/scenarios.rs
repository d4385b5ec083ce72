//! The scenarios of the paper on real daemons, watched to their end by what is on the page. At the
//! end, the truth of the building is checked as `althing scenario` checks it.

use std::collections::BTreeMap;

use building::{
    AccessScenario, BuildingDevice, BuildingEvent, DeviceFault, Layout, MaintenanceScenario,
    MeetingScenario, Truth, check_scenario_1,
};

use super::stage::{PageScene, PageStage, goal_is, has_step, is_in_row, wait_long};
use crate::chromium::Chromium;

/// Condition that the question of a robot is the one after a wrong answer: the card of the one before
/// stays for a moment, with an empty field.
const ASKED_AGAIN: &str = "document.querySelector('.question-large .question-text')?.innerText.includes('That was wrong') && document.querySelectorAll('.question-large').length === 1";

/// The goal of scenarios 1 and 2.
const TEMPERATURES: &str = "(forall (?r - room) (known-temperature ?r))";

/// Returns the temperatures that the page shows, once all of them are true.
#[track_caller]
fn told_when_true(stage: &PageStage, browser: &mut Chromium) -> BTreeMap<String, f64> {
    browser.open(&stage.page.url("/world?filter=temperature"));
    let truth = stage.building.truth();
    let rooms = truth.layout().rooms().map(|room| {
        let celsius = truth.temperature(room).expect("a room");
        format!("texts.includes('temperature of {room} is {celsius} °C')")
    });
    let rooms = rooms.collect::<Vec<_>>().join(" && ");
    wait_long(
        browser,
        &format!(
            "((texts) => {rooms})([...document.querySelectorAll('.table-body .cell-fact')].map((cell) => cell.innerText.trim()))"
        ),
    );
    let texts = browser.texts(".table-body .cell-fact");
    let value = |text: &String| {
        let (room, celsius) = text.trim().strip_prefix("temperature of ")?.split_once(" is ")?;
        Some((room.to_owned(), celsius.strip_suffix(" °C")?.parse().ok()?))
    };
    texts.iter().filter_map(value).collect()
}

/// Opens the page of the goal from the list of goals.
#[track_caller]
fn back_to_goal(stage: &PageStage, browser: &mut Chromium, words: &str) {
    browser.open(&stage.page.url("/goals"));
    browser.click(".table-body a", words);
    browser.wait_for("document.querySelector('.lead')");
}

#[test]
fn scenario_1_is_watched_to_its_end_on_the_page() {
    let Some(mut browser) = Chromium::start() else { return };
    let scenario = Layout::seeded(0);
    let dying = scenario.dying_sensor.as_str();
    let stage = PageStage::open(&PageScene { apart: &[dying], ..PageScene::of(&scenario.layout) });
    stage.sign_in(&mut browser, "/agents");
    stage.await_agents(&mut browser, &[dying, "turtlebot-1", "ir-1", "thermometer-conf-room"]);
    stage.ask_for(&mut browser, TEMPERATURES, true);
    wait_long(&mut browser, &goal_is("holds"));
    // A room without a sensor was measured by the robot, as the page shows.
    browser.wait_for(&has_step(&["ir-1", "office1"]));
    let before = told_when_true(&stage, &mut browser);
    assert_eq!(before.get("office1"), Some(&20.5), "{before:?}");

    back_to_goal(&stage, &mut browser, "temperature of every room known");
    let died = scenario.death(&stage.building, DeviceFault::Hangs);
    let died = stage.within(crate::support::PATIENCE, died).expect("a sensor");
    let mut stage = stage;
    stage.office.kill(dying);
    let stage = stage;
    wait_long(&mut browser, &has_step(&["ir-1", "office2"]));
    wait_long(&mut browser, &goal_is("holds"));
    browser.picture("scenario-1");
    let told = told_when_true(&stage, &mut browser);
    browser.open(&stage.page.url("/agents"));
    wait_long(&mut browser, &is_in_row(dying, "gone"));
    check_scenario_1(&scenario, &stage.building.truth(), died, &told).expect("it took place");
    browser.assert_no_problems();
}

/// How long a temperature counts as known in scenario 2: long enough for robots to visit all rooms
/// while the machine is busy with other tests.
const KNOWN_FOR: &str = ", valid-for = \"6s\"";

/// Whether a robot has measured a room since an occurrence.
fn is_measured_by_robot(truth: &Truth, room: &str, since: u64) -> bool {
    let is_mounted = |sensor: &str| {
        matches!(truth.layout().device(sensor), Some(BuildingDevice::MountedSensor { .. }))
    };
    truth.occurrences().filter(|occurrence| occurrence.sequence >= since).any(|occurrence| {
        matches!(&occurrence.event, BuildingEvent::Read { sensor, location, .. }
            if location == room && is_mounted(sensor))
    })
}

#[test]
fn scenario_2_is_watched_to_its_end_on_the_page() {
    let Some(mut browser) = Chromium::start() else { return };
    let scenario = MaintenanceScenario::seeded(0);
    let [first, second] = &scenario.deaths;
    let late = scenario.latecomer.as_str();
    let measures = |device: &BuildingDevice| {
        matches!(device, BuildingDevice::FixedSensor { .. } | BuildingDevice::MountedSensor { .. })
    };
    let mut stage = PageStage::open(&PageScene {
        at_first: scenario.initial_layout(),
        apart: &[&first.sensor, &second.sensor, late],
        more: &|device| if measures(device) { KNOWN_FOR.to_owned() } else { String::new() },
        pace: 0.01,
        ..PageScene::of(&scenario.layout)
    });
    stage.sign_in(&mut browser, "/agents");
    let agents = [&first.sensor, &second.sensor, "ir-1", "ir-2", "turtlebot-1", "turtlebot-2"];
    stage.await_agents(&mut browser, &agents);
    stage.ask_for(&mut browser, TEMPERATURES, true);
    wait_long(&mut browser, &goal_is("holds"));

    let mut since = 0;
    for death in [first, second] {
        since = death.trigger(&stage.building).expect("a sensor");
        stage.office.kill(&death.sensor);
        wait_long(&mut browser, &has_step(&["ir-", &death.room]));
        stage.until(|truth| is_measured_by_robot(truth, &death.room, since));
    }
    let rooms: Vec<_> = scenario.layout.rooms().map(str::to_owned).collect();
    stage.until(|truth| rooms.iter().all(|room| is_measured_by_robot(truth, room, since)));
    browser.open(&stage.page.url("/agents"));
    for death in [first, second] {
        wait_long(&mut browser, &is_in_row(&death.sensor, "gone"));
    }

    let plugged = stage.building.truth().next_sequence();
    scenario.plug_in(&stage.building).expect("a new sensor");
    stage.office.up(&[late], &[]);
    wait_long(&mut browser, &is_in_row(late, "present"));
    // The new sensor takes its room over: it measures again and again, and the robots the others.
    stage.until(|truth| {
        let all = truth.occurrences().filter(|occurrence| occurrence.sequence >= plugged);
        let mut by_it = all.filter(|occurrence| {
            matches!(&occurrence.event, BuildingEvent::Read { sensor, .. } if sensor == late)
        });
        let (Some(since), Some(_)) = (by_it.next(), by_it.next()) else { return false };
        let deaths = [first, second];
        deaths.iter().all(|death| is_measured_by_robot(truth, &death.room, since.sequence))
    });
    back_to_goal(&stage, &mut browser, "temperature of every room known");
    wait_long(&mut browser, &goal_is("holds"));
    browser.picture("scenario-2");
    let told = told_when_true(&stage, &mut browser);
    scenario.check(&stage.building.truth(), &told).expect("it took place");
    browser.assert_no_problems();
}

/// The PIN of those that may enter.
const PIN: &str = "2718";

/// Presses the digits on the pad of the robot's screen, and answers.
#[track_caller]
fn type_pin(browser: &mut Chromium, pin: &str) {
    browser.wait_for("document.querySelector('.question-large input').value === ''");
    for (at, digit) in pin.chars().enumerate() {
        browser.click(".pin-pad button", &digit.to_string());
        let length = at + 1;
        browser.wait_for(&format!(
            "document.querySelector('.question-large input').value.length === {length}"
        ));
    }
    browser.click(".question-large button", "Answer");
}

#[test]
fn scenario_3_a_visitor_logs_in_at_the_screen_of_the_robot() {
    let Some(mut browser) = Chromium::start() else { return };
    let access = AccessScenario::seeded(0);
    let (entry, robot, camera) = (&access.entry, access.robot(), access.camera());
    let pictures = tempfile::tempdir().expect("a folder");
    let more = |device: &BuildingDevice| match device {
        BuildingDevice::Camera { .. } => format!(
            ", presets = {{ door = {{ shows = \"{entry}\" }} }}, folder = \"{}\", \
             motion-for = \"1s\", on-motion = {{ goal = \"(validated ?l)\", priority = 5 }}",
            pictures.path().display()
        ),
        BuildingDevice::Robot { .. } => format!(
            ", login = {{ pin = \"{PIN}\", attempts = 2, patience = \"5min\", valid-for = \"3s\" }}"
        ),
        _ => String::new(),
    };
    let stage = PageStage::open(&PageScene { more: &more, ..PageScene::of(&access.layout) });
    // The browser on board is the screen of the robot; nobody signs in there.
    let added = stage.office.ask_json(&["people", "add-screen", robot]);
    let link = added["link"].as_str().expect("a link").to_owned();
    let board = link.split('#').next().expect("an address").to_owned();
    stage.office.await_fact(&format!("(looks-at {camera} door)"), true);
    browser.resize(800, 1280);
    browser.open(&link);
    browser.wait_for("document.querySelector('main').innerText.includes('no question now')");
    browser.wait_for("document.querySelector('.robot-place').innerText.includes('office2')");

    stage.building.enter("alice", entry).expect("a place");
    wait_long(&mut browser, "document.querySelector('.question-large .pin-pad')");
    assert_eq!(stage.building.place_of(robot).expect("a robot"), *entry);
    browser
        .wait_for(&format!("document.querySelector('.robot-place').innerText.includes('{entry}')"));
    browser.picture("robot-login");
    type_pin(&mut browser, "0000");
    // A wrong answer is asked about again, in a new question.
    wait_long(&mut browser, ASKED_AGAIN);
    type_pin(&mut browser, PIN);
    browser.wait_for("!document.querySelector('.question-large')");
    let left = format!(
        "document.documentElement.outerHTML.includes('{PIN}') || JSON.stringify(localStorage).includes('{PIN}')"
    );
    assert_eq!(browser.evaluate(&left), false);
    let goal = format!("(validated {entry})");
    // Who looks at the goals signs in: at another host, to which the screen's cookie does not go.
    stage.sign_in(&mut browser, "/goals");
    wait_long(&mut browser, &is_in_row(&goal, "done"));

    // Another one, who does not know the PIN, is not let in.
    stage.office.await_fact(&goal, false);
    stage.building.enter("dave", entry).expect("a place");
    browser.open(&board);
    for asked in ["document.querySelector('.question-large .pin-pad')", ASKED_AGAIN] {
        wait_long(&mut browser, asked);
        type_pin(&mut browser, "1111");
    }
    browser.open(&stage.page.url("/goals"));
    wait_long(&mut browser, &is_in_row(&goal, "failed"));
    stage.office.await_fact(&goal, false);
    let (_, log) = stage.office.ask(&["people", "log"]);
    assert!(log.contains(&format!("{robot}-screen")) && !log.contains(PIN), "{log}");
    let token = link.rsplit_once('=').expect("a token").1;
    assert!(!log.contains(token), "{log}");

    // The camera of the simulated building takes pictures that the page shows.
    browser.open(&stage.page.url(&format!("/agents/{camera}")));
    let (code, said) =
        stage.office.ask(&["act", &format!("(take-snapshot {camera} door {entry})")]);
    assert_eq!(code, Some(0), "{said}");
    browser.click("main button", "Show the picture");
    wait_long(&mut browser, "document.querySelector('img.camera')?.naturalWidth === 160");
    browser.picture("simulated-camera");
    browser.assert_no_problems();
}

#[test]
fn scenario_4_is_watched_to_its_end_on_the_page() {
    let Some(mut browser) = Chromium::start() else { return };
    let meeting = MeetingScenario::seeded(0);
    let (screen, robot, room) = (meeting.screen(), meeting.robot(), &meeting.room);
    let text = meeting.text.clone();
    let more = move |device: &BuildingDevice| match device {
        BuildingDevice::Screen { .. } | BuildingDevice::Robot { .. } => {
            format!(", media = {{ slides = {text:?} }}")
        }
        _ => String::new(),
    };
    let mut stage = PageStage::open(&PageScene {
        at_first: meeting.initial_layout(),
        apart: &[screen],
        more: &more,
        ..PageScene::of(&meeting.layout)
    });
    stage.sign_in(&mut browser, "/agents");
    stage.await_agents(&mut browser, &[robot]);
    meeting.plug_in(&stage.building).expect("a new screen");
    stage.office.up(&[screen], &[]);
    wait_long(&mut browser, &is_in_row(screen, "present"));
    // Nobody has asked for a channel: the screen has.
    browser.open(&stage.page.url("/world?filter=allocated"));
    wait_long(&mut browser, &is_in_row(&format!("(allocated {screen})"), "true"));
    stage.until(|truth| truth.channel_of(screen).is_some());

    stage.ask_for(&mut browser, &format!("(can-present {room})"), false);
    wait_long(&mut browser, &goal_is("done"));
    stage.ask_for(&mut browser, &format!("(presented slides {room})"), true);
    wait_long(&mut browser, &goal_is("holds"));
    let broken = stage.building.break_device(screen, DeviceFault::Fails).expect("a screen");
    wait_long(&mut browser, &has_step(&[robot, room]));
    stage.until(|truth| {
        let is_shown = truth.occurrences().any(|occurrence| {
            occurrence.sequence > broken && matches!(occurrence.event, BuildingEvent::Shown { .. })
        });
        is_shown && truth.place_of(robot) == Some(room)
    });
    wait_long(&mut browser, &goal_is("holds"));
    browser.picture("scenario-4");
    meeting.check(&stage.building.truth()).expect("it took place");
    // The floor plan shows the robot where it is.
    browser.open(&stage.page.url("/floor"));
    wait_long(
        &mut browser,
        &format!(
            "[...document.querySelectorAll('.small-table tr')].some((row) => row.innerText.includes('{robot}') && row.cells[1].innerText === '{room}')"
        ),
    );
    browser.assert_no_problems();
}
