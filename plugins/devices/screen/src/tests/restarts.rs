//! The supervision of a program, with a made-up program.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use tokio::sync::Notify;
use tokio::time::Instant;

use super::*;
use crate::player::{Player, PlayerTrouble};

static STARTS: Mutex<Vec<Instant>> = Mutex::new(Vec::new());
static ENDS: AtomicU32 = AtomicU32::new(0);
static DEATH: Notify = Notify::const_new();
static IS_BROKEN: Mutex<bool> = Mutex::new(false);

struct Made {
    asked: Option<Content>,
}

impl Player for Made {
    type Settings = ();

    async fn start(_: &()) -> Result<Made, String> {
        STARTS.lock().expect("unpoisoned").push(Instant::now());
        if *IS_BROKEN.lock().expect("unpoisoned") {
            return Err("find a screen".to_owned());
        }
        Ok(Made { asked: None })
    }

    async fn show(&mut self, content: Option<&Content>) -> Result<(), PlayerTrouble> {
        if content.is_some_and(|content| content.written() == "bad") {
            return Err(PlayerTrouble::Content("load bad: no".to_owned()));
        }
        self.asked = content.cloned();
        Ok(())
    }

    async fn check(&mut self) -> Result<(), PlayerTrouble> {
        match self.asked.as_ref().map(Content::written) {
            Some("short") => Err(PlayerTrouble::Content("show short: it is over".to_owned())),
            _ => Ok(()),
        }
    }

    async fn failed(&mut self) -> String {
        DEATH.notified().await;
        "run `made`: signal: 9".to_owned()
    }

    async fn end(self) {
        ENDS.fetch_add(1, Ordering::SeqCst);
    }
}

fn text(text: &str) -> Option<Content> {
    Some(Content::Text(text.to_owned()))
}

async fn state(display: &Arc<dyn Display>, wanted: impl Fn(&Result<DisplayState, String>) -> bool) {
    loop {
        let state = display.panel().await;
        if wanted(&state) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// This is one test and not several, because the program uses static variables.
#[tokio::test(start_paused = true)]
async fn a_program_is_asked_watched_and_started_again() {
    let display = supervisor::display::<Made>("s", ());
    let is_shown = |wanted: Option<&str>| {
        let wanted = wanted.map(str::to_owned);
        move |state: &Result<DisplayState, String>| {
            state.as_ref().is_ok_and(|state| state.shown == wanted && state.channel == Some(1))
        }
    };
    assert!(display.panel().await.is_err(), "it has not started yet");
    state(&display, Result::is_ok).await;
    assert_eq!(display.allocate().await, Ok(1));

    display.show(text("good").as_ref()).await.expect("shown");
    state(&display, is_shown(Some("good"))).await;
    let refused = display.show(text("bad").as_ref()).await;
    assert_eq!(refused, Err("load bad: no".to_owned()));
    state(&display, is_shown(None)).await;
    display.show(text("short").as_ref()).await.expect("shown");
    state(&display, is_shown(None)).await;

    DEATH.notify_one();
    state(&display, |state| *state == Err("run `made`: signal: 9".to_owned())).await;
    assert_eq!(
        display.show(text("good").as_ref()).await,
        Err("run `made`: signal: 9".to_owned()),
        "nothing waits for a restart"
    );
    state(&display, is_shown(None)).await;

    *IS_BROKEN.lock().expect("unpoisoned") = true;
    DEATH.notify_one();
    tokio::time::sleep(Duration::from_secs(300)).await;
    let starts = STARTS.lock().expect("unpoisoned").clone();
    let pauses = starts.iter().zip(starts.iter().skip(1));
    let pauses: Vec<_> = pauses.map(|(one, next)| (*next - *one).as_secs()).skip(1).collect();
    assert_eq!(pauses, [2, 4, 8, 16, 32, 60, 60, 60], "pauses grow up to a minute");

    let ended = ENDS.load(Ordering::SeqCst);
    *IS_BROKEN.lock().expect("unpoisoned") = false;
    state(&display, Result::is_ok).await;
    drop(display);
    while ENDS.load(Ordering::SeqCst) == ended {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}
