//! Measures how long a page takes from a view to the cells of a terminal, beside its target.
//!
//! ```text
//! cargo bench -p terminal-view --bench drawing
//! ```
//!
//! The building has a thousand agents with ten facts each.

use std::time::Instant;

use acl::{EcosystemId, Message};
use live_view::{LiveView, Moment, ViewEvent, ViewLimits};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use serde_json::json;
use terminal_view::{PageAt, PageData, PageName, ScreenOptions, ViewScreen, page_text};

/// Number of agents, and of facts of each.
const AGENTS: u64 = 1_000;
const FACTS_EACH: u64 = 10;

/// Target: milliseconds from a view to the cells of a terminal. A person sees less than 60 a second.
const DRAWN_AIM_MS: f64 = 16.0;

/// Size of the terminal.
const COLUMNS: u16 = 80;
const ROWS: u16 = 24;

fn main() {
    // Without `--bench`, Cargo only checks that the benchmark runs.
    let is_measured = std::env::args().any(|argument| argument == "--bench");
    let runs: u32 = if is_measured { 20 } else { 1 };
    let mut view =
        LiveView::new(EcosystemId::new("campus").expect("a name"), ViewLimits::default());
    for agent in 0..AGENTS {
        view.observe(Moment(0), ViewEvent::Message(Box::new(heartbeat(agent))));
    }
    let now = Moment(1_000);
    println!("{} agents, {} facts", view.agents(now).len(), view.facts(now).len());
    for page in PageName::all() {
        let mut screen = ViewScreen::new(ScreenOptions::default());
        screen.open(PageAt::of(page));
        let Ok(mut terminal) = Terminal::new(TestBackend::new(COLUMNS, ROWS));
        let began = Instant::now();
        for run in 0..runs {
            let now = now.plus(u64::from(run));
            let Ok(_) = terminal.draw(|frame| screen.draw(frame, &view, now));
        }
        let each = began.elapsed().as_secs_f64() * 1_000.0 / f64::from(runs);
        let began = Instant::now();
        (0..runs).for_each(|_| drop(PageData::of(&view, &PageAt::of(page), now)));
        let rows = began.elapsed().as_secs_f64() * 1_000.0 / f64::from(runs);
        println!(
            "{page}: {each:.2} ms (aim: {DRAWN_AIM_MS:.0}), of which {rows:.2} ms for its data"
        );
    }
    let began = Instant::now();
    let data = PageData::of(&view, &PageAt::of(PageName::World), now);
    let text = page_text(&data, 0, ScreenOptions::default(), now);
    let took = began.elapsed().as_secs_f64() * 1_000.0;
    println!("world in sentences: {took:.0} ms, {} lines", text.lines().count());
}

/// Returns the heartbeat of an agent, with its facts.
fn heartbeat(agent: u64) -> Message {
    let facts: Vec<_> =
        (0..FACTS_EACH).map(|fact| format!("(known-quantity-{fact} room-{agent})")).collect();
    let message = json!({
        "version": acl::SCHEMA_VERSION, "id": format!("sensor-{agent}.1.1"), "performative": "inform",
        "sender": format!("sensor-{agent}"), "incarnation": 1,
        "conversation_id": format!("sensor-{agent}"), "language": "pddl",
        "content": {
            "of": "heartbeat", "digest": "a3dbc0427c96497e", "facts": facts.join("\n"),
            "period": 1_000, "sequence": 1,
        },
    });
    serde_json::from_value(message).expect("a message")
}
