//! Every key of the table on every page, in terminals of every size; and random people at random
//! views. Nothing panics, and every key does something that can be seen or is said.

use acl::{EcosystemId, Message};
use live_view::{LiveView, Moment, ViewEvent, ViewLimits};
use proptest::prelude::*;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::sample;
use crate::input::{MouseDeed, MouseInput, RecordingSpan, ScreenOptions, ViewAct, ViewInput};
use crate::keys::{KEYS, KeyPress, NamedKey};
use crate::page::{PAGES, PageAt, PageName};
use crate::screen::{DrawnData, ViewScreen};

fn view() -> LiveView {
    LiveView::new(EcosystemId::new("smart-office").expect("a name"), ViewLimits::default())
}

/// Draws the sample data of the page that is shown.
fn draw(screen: &mut ViewScreen, columns: u16, rows: u16) -> String {
    let Ok(mut terminal) = Terminal::new(TestBackend::new(columns, rows));
    let data = sample::data(screen.page().page);
    let drawn = DrawnData { overview: sample::overview(), data, hint: "agents".to_owned() };
    let Ok(_) = terminal.draw(|frame| screen.draw_data(frame, &drawn, sample::NOW));
    terminal.backend().to_string()
}

/// All keys of the table, the digits, and some that are not in it.
fn keys() -> Vec<KeyPress> {
    let table = KEYS.iter().flat_map(|binding| binding.keys).copied();
    let digits = PAGES.iter().filter_map(|facts| facts.digit).map(KeyPress::Character);
    let others = ['x', 'Z', '厨', '\u{301}'].map(KeyPress::Character);
    let named = [NamedKey::Delete, NamedKey::Tab].map(KeyPress::Named);
    table.chain(digits).chain(others).chain(named).collect()
}

fn options(is_recording: bool) -> ScreenOptions {
    let span = RecordingSpan {
        start: sample::NOW.minus(60_000),
        end: sample::NOW.plus(1),
        is_playing: false,
    };
    ScreenOptions {
        color: true,
        utc_offset_seconds: 3_600,
        recording: is_recording.then_some(span),
        words: None,
    }
}

#[test]
fn every_key_on_every_page_in_every_size() {
    let sizes = [(1, 1), (1, 60), (200, 1), (2, 2), (3, 5), (20, 8), (40, 15), (80, 24), (200, 60)];
    let mut sizes = sizes.into_iter().cycle();
    let view = view();
    for page in PageName::all() {
        for is_recording in [false, true] {
            // One more size than keys would repeat the same pairs on the next page.
            sizes.next();
            for key in keys() {
                let Some((columns, rows)) = sizes.next() else { return };
                let mut screen = ViewScreen::new(options(is_recording));
                screen.open(PageAt::of(page));
                draw(&mut screen, columns, rows);
                // What lies over the page then takes a text, and ends.
                let ends = [NamedKey::Tab, NamedKey::Enter, NamedKey::Escape];
                let ends = ends.map(|key| ViewInput::Key(KeyPress::Named(key)));
                let _ = screen.handle(ViewInput::Key(key), &view, sample::NOW);
                draw(&mut screen, columns, rows);
                let pasted = ViewInput::Paste("a b".to_owned());
                for input in [pasted].into_iter().chain(ends) {
                    let _ = screen.handle(input, &view, sample::NOW);
                }
                draw(&mut screen, columns, rows);
            }
        }
    }
}

#[test]
fn every_key_is_seen_to_do_something() {
    // These move within a page that may be at its end already.
    let moves = "hjklG";
    let view = view();
    for page in PageName::all() {
        for key in keys() {
            if let KeyPress::Character(letter) = key
                && !moves.contains(letter)
            {
                let mut screen = ViewScreen::new(options(false));
                screen.open(PageAt::of(page));
                let before = draw(&mut screen, 80, 24);
                let act = screen.handle(ViewInput::Key(key), &view, sample::NOW);
                let after = draw(&mut screen, 80, 24);
                let digit = page.facts().digit;
                let is_here = digit.is_some_and(|digit| digit == letter);
                assert!(act.is_some() || before != after || is_here, "{key:?} on {page}");
            }
        }
    }
}

/// Presses keys on a page of the sample; returns the last act.
fn press(screen: &mut ViewScreen, keys: &str) -> Option<ViewAct> {
    let view = view();
    let mut act = None;
    for key in keys.chars() {
        draw(screen, 80, 24);
        let key = match key {
            '⏎' => KeyPress::Named(NamedKey::Enter),
            '⎋' => KeyPress::Named(NamedKey::Escape),
            '⇥' => KeyPress::Named(NamedKey::Tab),
            '↓' => KeyPress::Named(NamedKey::Down),
            key => KeyPress::Character(key),
        };
        act = screen.handle(ViewInput::Key(key), &view, sample::NOW);
    }
    draw(screen, 80, 24);
    act
}

fn at(page: PageName) -> ViewScreen {
    let mut screen = ViewScreen::new(ScreenOptions::default());
    screen.open(PageAt::of(page));
    screen
}

/// Checks that keys on a page run this command.
#[track_caller]
fn runs(page: PageName, keys: &str, arguments: &str, input: Option<&str>) {
    let act = press(&mut at(page), keys);
    let expected = ViewAct::Run {
        arguments: arguments.split('|').map(str::to_owned).collect(),
        input: input.map(str::to_owned),
    };
    assert_eq!(act, Some(expected), "{keys} on {page}");
}

#[test]
fn people_ask_answer_and_stop_without_leaving() {
    runs(PageName::Overview, "g(a b)⏎", "goal|--dry-run|(a b)", None);
    runs(PageName::Overview, "g(a b)⏎⏎", "goal|(a b)", None);
    runs(PageName::Overview, "gkept⇥⏎⏎", "goal|--maintain|kept", None);
    runs(PageName::World, "d(move r a b)⏎", "act|(move r a b)", None);
    runs(PageName::Agents, "s⏎", "stop", None);
    runs(PageName::Agents, "soffice1⏎", "stop|office1", None);
    runs(PageName::Agents, "r⏎", "stop|--release", None);
    runs(PageName::Questions, "a2718⏎", "answer|hall/1", Some("2718"));
    runs(PageName::Questions, "⏎2718⏎", "answer|hall/1", Some("2718"));
    runs(PageName::Questions, "↓A⏎", "answer|hall/2", Some("yes"));
    runs(PageName::World, "w", "why|(at turtlebot-1 corridor)", None);
    runs(PageName::Goals, "w", "why|goal-1", None);
}

#[test]
fn the_output_of_a_command_does_not_cover_what_a_person_looks_at() {
    let shows = |screen: &mut ViewScreen| draw(screen, 80, 24).contains("first line");
    let mut screen = at(PageName::World);
    press(&mut screen, "w");
    screen.show_output("althing why", "first line\nlast line", true);
    assert!(shows(&mut screen), "it was waited for");
    assert!(draw(&mut screen, 80, 24).contains("✓ althing why"), "its title is shown");
    press(&mut screen, "x⎋");
    press(&mut screen, "w↓");
    screen.show_output("althing why", "first line\nlast line", true);
    assert!(!shows(&mut screen) && draw(&mut screen, 80, 24).contains("why: last line"));
    press(&mut screen, "o");
    assert!(shows(&mut screen));
    press(&mut screen, "⎋g(a)⏎⏎");
    screen.show_output("althing goal", "first line\ndone", true);
    assert!(!shows(&mut screen), "the pages show how a goal ends");
    press(&mut screen, "g(a⏎⏎");
    screen.show_output("althing goal", "first line\nfailed", false);
    assert!(shows(&mut screen), "a mistake is shown");
}

#[test]
fn the_plan_for_a_goal_is_shown_before_the_goal_is_asked_for() {
    let shows = |screen: &mut ViewScreen, text: &str| draw(screen, 80, 24).contains(text);
    let mut screen = at(PageName::World);
    press(&mut screen, "g(a b)⏎");
    assert!(shows(&mut screen, "What is wanted?") && shows(&mut screen, "it is planned for"));
    screen.show_output("althing goal --dry-run (c)", "another plan", true);
    assert!(shows(&mut screen, "What is wanted?"), "it is of another goal");
    screen.show_output("althing goal --dry-run (a b)", "a plan of 2 steps, cost 4", true);
    assert!(shows(&mut screen, "a plan of 2 steps, cost 4"));
    assert!(shows(&mut screen, "Enter asks for it"));
    let goal = ViewAct::Run { arguments: vec!["goal".into(), "(a b)".into()], input: None };
    assert_eq!(press(&mut screen, "⏎"), Some(goal.clone()));
    assert!(!shows(&mut screen, "a plan of 2 steps"));

    // A person who changes the goal sees the plan for the changed one.
    press(&mut screen, "g(a b)⏎");
    screen.show_output("althing goal --dry-run (a b)", "no plan: there is no way", false);
    assert!(shows(&mut screen, "✗ no plan") && shows(&mut screen, "there is no way"));
    assert_eq!(press(&mut screen, "⎋"), None);
    assert!(shows(&mut screen, "(a b)"), "what was typed stays");
    let again = press(&mut screen, "⏎");
    let is_dry = |act: &Option<ViewAct>| matches!(act, Some(ViewAct::Run { arguments, .. }) if arguments[1] == "--dry-run");
    assert!(is_dry(&again), "{again:?}");
    assert!(is_dry(&press(&mut screen, "c⏎")), "another goal is tried first");
    // A stop is a key away while a plan is read.
    press(&mut screen, "⎋g(a)⏎");
    screen.show_output("althing goal --dry-run (a)", "a plan", true);
    press(&mut screen, "s");
    assert!(shows(&mut screen, "Stop everything?"));
}

#[test]
fn escape_leaves_a_dialog_without_an_act() {
    for keys in ["g(a)⎋", "s⎋", "r⎋", "rn"] {
        assert_eq!(press(&mut at(PageName::Agents), keys), None, "{keys}");
    }
    let mut screen = at(PageName::Agents);
    press(&mut screen, "soffice1⎋");
    assert!(!draw(&mut screen, 80, 24).contains("Stop everything?"));
}

#[test]
fn a_secret_answer_is_not_shown() {
    let mut screen = at(PageName::Questions);
    press(&mut screen, "a2718");
    let shown = draw(&mut screen, 80, 24);
    assert!(shown.contains("What is your PIN?") && shown.contains("••••"), "{shown}");
    assert!(!shown.contains("2718"), "{shown}");
}

#[test]
fn pages_are_opened_and_left() {
    let mut screen = at(PageName::Agents);
    press(&mut screen, "↓↓⏎");
    assert_eq!(screen.page(), &PageAt::named(PageName::Agent, "thermometer-conf-room"));
    press(&mut screen, "⎋");
    assert_eq!(screen.page(), &PageAt::of(PageName::Agents));
    press(&mut screen, ":topo⏎");
    assert_eq!(screen.page(), &PageAt::of(PageName::Topology));
    press(&mut screen, ":ag⇥⇥ x⏎");
    assert_eq!(screen.page().page, PageName::Agent);
    press(&mut screen, "⇥");
    assert_eq!(screen.page(), &PageAt::of(PageName::Overview));
    press(&mut screen, "2");
    assert_eq!(screen.page(), &PageAt::of(PageName::Goals));
    press(&mut screen, "⎋⎋⎋");
    assert_eq!(screen.page(), &PageAt::of(PageName::Overview));
    press(&mut screen, ":nonsense⏎");
    assert!(draw(&mut screen, 80, 24).contains("there is no page `nonsense`"));
    assert_eq!(press(&mut screen, ":q⏎"), Some(ViewAct::Quit));
}

#[test]
fn a_filter_shows_only_some_rows() {
    let mut screen = at(PageName::Agents);
    press(&mut screen, "/bot 2⏎");
    let shown = draw(&mut screen, 80, 24);
    assert!(shown.contains("turtlebot-2") && !shown.contains("screen-1"), "{shown}");
    assert!(shown.contains("Esc shows all"), "{shown}");
    press(&mut screen, "⎋");
    assert!(draw(&mut screen, 80, 24).contains("screen-1"));
    assert_eq!(screen.page(), &PageAt::of(PageName::Agents));
}

#[test]
fn the_mouse_selects_opens_and_turns_pages() {
    let view = view();
    let mut screen = at(PageName::Agents);
    let shown = draw(&mut screen, 80, 24);
    let row = shown.lines().position(|line| line.contains("screen-1")).expect("a row");
    let press = |screen: &mut ViewScreen, column: u16, row: usize, deed| {
        let row = u16::try_from(row).expect("a row");
        let mouse = MouseInput { deed, column, row };
        let act = screen.handle(ViewInput::Mouse(mouse), &view, sample::NOW);
        draw(screen, 80, 24);
        act
    };
    press(&mut screen, 3, row, MouseDeed::Press);
    assert_eq!(screen.page(), &PageAt::of(PageName::Agents));
    press(&mut screen, 3, row, MouseDeed::Press);
    assert_eq!(screen.page(), &PageAt::named(PageName::Agent, "screen-1"));
    press(&mut screen, 9, 1, MouseDeed::Press);
    assert_eq!(screen.page(), &PageAt::of(PageName::Goals));
    press(&mut screen, 0, 9, MouseDeed::WheelDown);
    press(&mut screen, 79, 22, MouseDeed::Press);
}

#[test]
fn a_recording_is_played_stepped_and_sought() {
    let mut screen = ViewScreen::new(options(true));
    let mut press = |key: &str| press(&mut screen, key);
    assert_eq!(press(" "), Some(ViewAct::TogglePlaying));
    assert_eq!(press("]"), Some(ViewAct::Step { is_forward: true }));
    assert_eq!(press("["), Some(ViewAct::Step { is_forward: false }));
    assert_eq!(press("{"), Some(ViewAct::Seek(sample::NOW.minus(3_000))));
    assert_eq!(press("}"), Some(ViewAct::Seek(sample::NOW.plus(1))));
    assert_eq!(press("s"), None);
    let mouse = MouseInput { deed: MouseDeed::Press, column: 79 - 9, row: 22 };
    let act = screen.handle(ViewInput::Mouse(mouse), &view(), sample::NOW);
    assert_eq!(act, Some(ViewAct::Seek(sample::NOW.plus(1))));
    let mut live = at(PageName::Overview);
    super::every_key::press(&mut live, " ");
    assert!(draw(&mut live, 80, 24).contains("is a key of recordings"));
}

/// A key, a use of the mouse, or a pasted text.
fn input() -> impl Strategy<Value = ViewInput> {
    let key = proptest::sample::select(keys()).prop_map(ViewInput::Key);
    let typed = any::<char>().prop_map(|it| ViewInput::Key(KeyPress::Character(it)));
    let pasted = ".{0,20}".prop_map(ViewInput::Paste);
    let deed =
        proptest::sample::select(vec![MouseDeed::Press, MouseDeed::WheelUp, MouseDeed::WheelDown]);
    let mouse = (deed, any::<u16>(), 0..70_u16)
        .prop_map(|(deed, column, row)| MouseInput { deed, column: column % 210, row })
        .prop_map(ViewInput::Mouse);
    prop_oneof![6 => key, 2 => typed, 1 => pasted, 2 => mouse, 1 => Just(ViewInput::Resize)]
}

/// A message as a stranger may send it.
fn message() -> impl Strategy<Value = ViewEvent> {
    let name = proptest::sample::select(vec!["alice", "robot", "sensor", "requester"]);
    let performative = proptest::sample::select(vec![
        "request",
        "agree",
        "refuse",
        "cfp",
        "propose",
        "inform",
        "confirm",
        "failure",
        "query-ref",
    ]);
    let protocol = proptest::sample::select(vec![
        "goal",
        "contract-net",
        "execution",
        "action",
        "query",
        "state-change",
    ]);
    (name.clone(), name, performative, protocol, ".{0,30}", 0..5_u8).prop_filter_map(
        "a message",
        |(sender, receiver, performative, protocol, text, number)| {
            let text = serde_json::to_string(&text).ok()?;
            let content = format!("{{\"act\": \"achieve\", \"goal\": {text}}}");
            let json = format!(
                "{{\"version\": 2, \"id\": \"m{number}\", \"performative\": \"{performative}\", \
                 \"sender\": \"{sender}\", \"receiver\": [\"{receiver}\"], \"incarnation\": 1, \
                 \"conversation_id\": \"c{number}\", \"protocol\": \"{protocol}\", \
                 \"content\": {content}}}"
            );
            let message = serde_json::from_str::<Message>(&json).ok()?;
            Some(ViewEvent::Message(Box::new(message)))
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn random_people_at_random_views(
        inputs in proptest::collection::vec(input(), 0..40),
        events in proptest::collection::vec(message(), 0..30),
        sizes in proptest::collection::vec((1..=200_u16, 1..=60_u16), 1..8),
        is_recording in any::<bool>(),
    ) {
        let mut view = view();
        let mut screen = ViewScreen::new(options(is_recording));
        let mut events = events.into_iter();
        for (number, input) in inputs.into_iter().enumerate() {
            let now = Moment(sample::NOW.0 + number as u64 * 700);
            if let Some(event) = events.next() {
                view.observe(now, event);
            }
            let (columns, rows) = sizes[number % sizes.len()];
            let Ok(mut terminal) = Terminal::new(TestBackend::new(columns, rows));
            let Ok(_) = terminal.draw(|frame| screen.draw(frame, &view, now));
            let before = screen.page().clone();
            match screen.handle(input, &view, now) {
                Some(ViewAct::Run { arguments, .. }) => {
                    prop_assert!(!arguments.is_empty());
                    let options = ["--dry-run", "--maintain", "--cancel", "--release"];
                    for word in &arguments {
                        prop_assert!(!word.starts_with('-') || options.contains(&word.as_str()));
                    }
                    screen.show_output(&arguments.join(" "), "done\u{1b}[2J", number % 2 == 0);
                }
                Some(ViewAct::Quit) => screen.open(before),
                _ => (),
            }
        }
    }
}

#[test]
fn every_page_says_that_the_ecosystem_is_not_reached() {
    let mut view = view();
    let lost_at = Moment(13 * 3_600_000 + 5_000);
    view.observe(lost_at.minus(60_000), ViewEvent::Reached(true));
    view.observe(lost_at, ViewEvent::Reached(false));
    view.observe(lost_at.plus(9_000), ViewEvent::Reached(false));
    for page in PageName::all() {
        let mut screen = ViewScreen::new(ScreenOptions::default());
        screen.open(PageAt::of(page));
        let Ok(mut terminal) = Terminal::new(TestBackend::new(80, 24));
        let Ok(_) = terminal.draw(|frame| screen.draw(frame, &view, lost_at.plus(20_000)));
        let drawn = terminal.backend().to_string();
        let title = drawn.lines().next().unwrap_or_default();
        assert!(title.contains("✗ NOT REACHED since 13:00:05"), "{page}: {title}");
    }
    view.observe(lost_at.plus(30_000), ViewEvent::Reached(true));
    assert_eq!(view.overview(lost_at.plus(30_000)).not_reached_since, None);
}

#[test]
fn the_keys_of_pages_count_while_an_output_is_read() {
    let view = view();
    let mut screen = ViewScreen::new(ScreenOptions::default());
    let mut press = |key: char| {
        screen.handle(ViewInput::Key(KeyPress::Character(key)), &view, sample::NOW);
        draw(&mut screen, 80, 24)
    };
    press('?');
    assert!(!press('q').contains("keys of overview"), "it is closed");
    press('?');
    assert!(press('3').contains("AGENT"), "the page of agents is shown");
    press('?');
    assert!(press('s').contains("Stop everything?"));
}

#[test]
fn the_last_line_names_the_release_during_a_stop_and_cuts_no_word() {
    let mut screen = ViewScreen::new(ScreenOptions::default());
    let mut last_line = |stops: u64, said: Option<&str>| {
        said.into_iter().for_each(|said| screen.say(said, true));
        let mut overview = sample::overview();
        overview.counts.stops = stops;
        let data = sample::data(PageName::Overview);
        let drawn = DrawnData { overview, data, hint: String::new() };
        let Ok(mut terminal) = Terminal::new(TestBackend::new(80, 24));
        let Ok(_) = terminal.draw(|frame| screen.draw_data(frame, &drawn, sample::NOW));
        let text = terminal.backend().to_string();
        text.lines().last().unwrap_or_default().trim_matches('"').trim_end().to_owned()
    };
    assert!(!last_line(0, None).contains("release"));
    assert!(last_line(1, None).contains("s stop  r release"));
    let words = "extraordinarily ".repeat(9);
    let shown = last_line(0, Some(&words));
    assert!(shown.ends_with("extraordinarily …"), "{shown}");
}
