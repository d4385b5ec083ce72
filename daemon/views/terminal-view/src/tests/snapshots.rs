//! Every page as it looks in a terminal, as text files beside this one. `UPDATE_EXPECT=1 cargo test
//! -p terminal-view` writes them anew.

use std::fs;
use std::path::PathBuf;

use live_view::{LiveView, Moment, ViewLimits};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;

use super::sample;
use crate::input::{RecordingSpan, ScreenOptions, ViewInput};
use crate::keys::KeyPress;
use crate::page::{PageAt, PageName};
use crate::page_data::PageData;
use crate::page_text;
use crate::screen::{DrawnData, ViewScreen};

/// Compares a text with its file, or writes the file.
fn check(name: &str, text: &str) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("src/tests/snapshots");
    let path = folder.join(format!("{name}.txt"));
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        fs::create_dir_all(&folder).expect("a folder");
        fs::write(&path, text).expect("a file");
    }
    let expected = fs::read_to_string(&path).unwrap_or_default();
    assert!(expected == text, "{name} looks different (UPDATE_EXPECT=1 writes it anew):\n{text}");
}

/// Returns the text of a terminal.
fn text(buffer: &Buffer) -> String {
    let area = buffer.area;
    let mut text = String::new();
    for y in area.top()..area.bottom() {
        let mut skip = 0;
        let mut line = String::new();
        for x in area.left()..area.right() {
            if skip > 0 {
                skip -= 1;
                continue;
            }
            let symbol = buffer[(x, y)].symbol();
            skip = crate::text::width(symbol).saturating_sub(1);
            line.push_str(symbol);
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// Draws data into a terminal of a size.
fn drawn(screen: &mut ViewScreen, data: PageData, columns: u16, rows: u16, now: Moment) -> Buffer {
    let Ok(mut terminal) = Terminal::new(TestBackend::new(columns, rows));
    let overview = sample::overview();
    let drawn = DrawnData { overview, data, hint: String::new() };
    let Ok(_) = terminal.draw(|frame| screen.draw_data(frame, &drawn, now));
    terminal.backend().buffer().clone()
}

fn screen(page: PageName) -> ViewScreen {
    let mut screen = ViewScreen::new(ScreenOptions::default());
    screen.open(PageAt::of(page));
    screen
}

#[test]
fn every_page_at_80_by_24() {
    for page in PageName::all() {
        let buffer = drawn(&mut screen(page), sample::data(page), 80, 24, sample::NOW);
        check(&format!("{page}-80x24"), &text(&buffer));
    }
}

#[test]
fn every_page_at_40_by_15() {
    for page in PageName::all() {
        let buffer = drawn(&mut screen(page), sample::data(page), 40, 15, sample::NOW);
        check(&format!("{page}-40x15"), &text(&buffer));
    }
}

#[test]
fn every_page_at_20_columns() {
    let mut all = String::new();
    for page in PageName::all() {
        let buffer = drawn(&mut screen(page), sample::data(page), 20, 12, sample::NOW);
        all.push_str(&format!("=== {page}\n{}", text(&buffer)));
    }
    check("narrow-20x12", &all);
}

#[test]
fn every_page_without_data_says_why() {
    let mut all = String::new();
    for page in PageName::all() {
        let buffer = drawn(&mut screen(page), sample::nothing(page), 80, 8, sample::NOW);
        all.push_str(&format!("=== {page}\n{}", text(&buffer)));
    }
    check("nothing-80x8", &all);
}

#[test]
fn every_page_in_sentences() {
    let mut all = String::new();
    for page in PageName::all() {
        let said = page_text(&sample::data(page), 0, ScreenOptions::default(), sample::NOW);
        for drawing in "│─╭╮╰╯┼█▓▒░●◀▶".chars().filter(|sign| *sign != '▶')
        {
            assert!(!said.contains(drawing), "{page} says {drawing}:\n{said}");
        }
        all.push_str(&format!("=== {page}\n{said}"));
    }
    check("sentences", &all);
}

#[test]
fn a_recording_has_a_slider() {
    let span = RecordingSpan {
        start: sample::NOW.minus(60_000),
        end: sample::NOW.plus(20_000),
        is_playing: true,
    };
    let mut screen = ViewScreen::new(ScreenOptions { recording: Some(span), ..Default::default() });
    let data = sample::data(PageName::Overview);
    check("recording-80x24", &text(&drawn(&mut screen, data, 80, 24, sample::NOW)));
}

#[test]
fn what_lies_over_a_page() {
    let mut all = String::new();
    let view = LiveView::new(sample::overview().ecosystem, ViewLimits::default());
    for (name, keys) in [
        ("help", "?"),
        ("a goal", "g(known-temperature office1)"),
        ("a stop", "s"),
        ("a release", "r"),
        ("a secret answer", "a2718"),
        ("a filter", "/room"),
        ("a page", ":go"),
        ("a key without a meaning", "x"),
    ] {
        let mut screen = screen(PageName::Questions);
        let draw = |screen: &mut ViewScreen| {
            text(&drawn(screen, sample::data(PageName::Questions), 60, 16, sample::NOW))
        };
        draw(&mut screen);
        for key in keys.chars() {
            let key = ViewInput::Key(KeyPress::Character(key));
            let _ = screen.handle(key, &view, sample::NOW);
            draw(&mut screen);
        }
        all.push_str(&format!("=== {name}\n{}", draw(&mut screen)));
    }
    check("over-60x16", &all);
}

#[test]
fn no_text_from_outside_acts_on_the_terminal() {
    for page in PageName::all() {
        for (columns, rows) in [(200, 60), (80, 24), (20, 8)] {
            let buffer = drawn(&mut screen(page), sample::data(page), columns, rows, sample::NOW);
            for cell in buffer.content() {
                let symbol = cell.symbol();
                let acts = |c: char| c.is_control() || ('\u{202a}'..='\u{202e}').contains(&c);
                assert!(!symbol.chars().any(acts), "{page}: {symbol:?}");
            }
        }
    }
}

#[test]
fn without_colors_there_are_none() {
    for page in PageName::all() {
        let buffer = drawn(&mut screen(page), sample::data(page), 120, 40, sample::NOW);
        for cell in buffer.content() {
            use ratatui::style::Color;
            assert_eq!((cell.fg, cell.bg), (Color::Reset, Color::Reset), "{page}");
        }
    }
}

#[test]
fn a_recording_asks_for_nothing_and_says_what_was_not_recorded() {
    let said = |data: &PageData, is_recording: bool| {
        let recording = is_recording.then(RecordingSpan::default);
        let options = ScreenOptions { recording, ..ScreenOptions::default() };
        page_text(data, 0, options, sample::NOW)
    };
    let overview = said(&sample::nothing(PageName::Overview), true);
    assert!(overview.contains("daemons were not recorded, 0 agents"), "{overview}");
    assert!(overview.contains("No goal that goes on was recorded so far."), "{overview}");
    for page in [PageName::Overview, PageName::Goals, PageName::Goal] {
        assert!(!said(&sample::nothing(page), true).contains("`g`"), "{page}");
        assert!(said(&sample::nothing(page), false).contains("`g`"), "{page}");
    }
    let PageData::Goal(Some(mut goal)) = sample::data(PageName::Goal) else { panic!("a goal") };
    goal.plans.clear();
    let goal = PageData::Goal(Some(goal));
    assert!(said(&goal, false).contains("The plan was made before this view began."));
}

#[test]
fn the_samples_of_the_document_are_what_is_printed() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../docs/view.md");
    let document = fs::read_to_string(path).expect("it is committed");
    let (_, aloud) = document.split_once("## Read aloud").expect("a chapter");
    let sample = aloud.split("```").nth(1).expect("a sample").trim_start_matches("text");
    let data = sample::data(PageName::Agents);
    let printed = page_text(&data, 0, ScreenOptions::default(), sample::NOW);
    let lines: Vec<_> = sample.lines().filter(|line| !line.is_empty()).collect();
    assert!(!lines.is_empty());
    for line in lines {
        assert!(printed.lines().any(|said| said == line), "not printed: {line}");
    }
}

fn in_words(text: &str) -> String {
    text.replace("(locked door-厨房)", "door-厨房 locked")
}

#[test]
fn a_key_shows_pddl_and_words_again() {
    let options = ScreenOptions { words: Some(in_words), ..ScreenOptions::default() };
    let mut screen = ViewScreen::new(options);
    screen.open(PageAt::of(PageName::Goals));
    let limits = ViewLimits::default();
    let view = LiveView::new(acl::EcosystemId::new("smart-office").expect("a name"), limits);
    let shown = |screen: &mut ViewScreen, words: &str| {
        text(&drawn(screen, sample::data(PageName::Goals), 80, 24, sample::NOW)).contains(words)
    };
    assert!(shown(&mut screen, "door-厨房 locked"));
    let press = |screen: &mut ViewScreen, key: char| {
        screen.handle(ViewInput::Key(KeyPress::Character(key)), &view, sample::NOW)
    };
    press(&mut screen, 'p');
    assert!(shown(&mut screen, "(locked door-厨房)"));
    press(&mut screen, 'p');
    assert!(shown(&mut screen, "door-厨房 locked"));
    // A filter finds what is shown in words by its PDDL, too.
    press(&mut screen, '/');
    "(locked".chars().for_each(|key| drop(press(&mut screen, key)));
    assert!(shown(&mut screen, "door-厨房 locked"));
    assert!(!shown(&mut screen, "slides"));
    let said = page_text(&sample::data(PageName::Goals), 0, options, sample::NOW);
    assert!(said.contains("door-厨房 locked"), "{said}");
}
