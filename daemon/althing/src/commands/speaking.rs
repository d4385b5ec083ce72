//! Saying one thing to a running ecosystem through a keyboard of one's own, and following what
//! comes of it. Serves `goal`, `act`, `set`, `mode`, `answer` and `send`.

use std::process::ExitCode;

use acl::AgentId;
use acl::content::{Outcome, Report};
use keyboard::{Heard, Keyboard, Said};
use terminal::{exit, output};
use tokio::signal;

use crate::commands::client::{self, Link};
use crate::commands::hearing;

/// What was asked for failed, or was refused.
pub(super) const FAILED: u8 = 1;

/// What Ctrl-C means for what was said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interrupt {
    /// It goes on; the user is told how to go on without it.
    Leave(&'static str),
    /// It is given up, and its last word is waited for; a second Ctrl-C leaves.
    GiveUp,
}

/// How a thing is said.
pub(super) struct Manner<'a> {
    /// To whom it is said, as far as the user must wait for them.
    pub(super) to: Option<&'a str>,
    pub(super) json: bool,
    pub(super) interrupt: Interrupt,
}

/// Says one thing, and tells what is heard until the last word.
pub(super) async fn say(link: &Link, said: Said, manner: Manner<'_>) -> ExitCode {
    let json = manner.json;
    let is_cancel = matches!(said, Said::Cancel(_));
    let is_to_all = matches!(&said, Said::Send(draft) if draft.to.is_none());
    let (keyboard, mut terminal) = Keyboard::with_terminal();
    let Ok(id) = AgentId::new(&client::guest_name("keyboard")) else {
        return client::unavailable("name a keyboard", json);
    };
    if let Err(problem) = greet(link, manner.to).await {
        return client::unavailable(problem, json);
    }
    link.node.launch(id, keyboard, link.view.ontology());
    if is_to_all {
        // Nobody says it again who has not heard it.
        link.node.switchboard().introduced().await;
    }
    if terminal.say.send(said).await.is_err() {
        return client::unavailable("speak: the keyboard has ended", json);
    }
    let mut about = None;
    let mut interrupt = manner.interrupt;
    loop {
        let heard = tokio::select! {
            heard = terminal.hear.recv() => heard,
            _ = signal::ctrl_c() => {
                match (interrupt, about.take()) {
                    (Interrupt::GiveUp, Some(about)) => {
                        output::note("giving it up; Ctrl-C once more leaves without its last word");
                        interrupt = Interrupt::Leave("it was asked to be given up");
                        let _ = terminal.say.send(Said::Cancel(about)).await;
                        continue;
                    }
                    (Interrupt::Leave(advice), _) => output::note(advice),
                    (Interrupt::GiveUp, None) => (),
                }
                return exit::with(exit::DONE);
            }
        };
        let Some(heard) = heard else {
            return client::unavailable("hear: the keyboard has ended", json);
        };
        about = about.or_else(|| heard.conversation().cloned());
        let printed = hearing::print(&heard, json);
        if printed != exit::with(exit::DONE) {
            return printed;
        }
        // Of a message to all nobody knows how many will answer.
        if heard.is_final() && !(is_to_all && matches!(heard, Heard::Answered(_))) {
            return exit::with(code_of(&heard, is_cancel));
        }
    }
}

/// Waits until the link tells of whom one speaks to; says so where that takes long.
async fn greet(link: &Link, to: Option<&str>) -> Result<(), &'static str> {
    let wanted = to.and_then(|to| AgentId::new(to).ok());
    let directory = link.view.directory(wanted.as_ref()).await;
    if directory.iter().next().is_none() {
        return Err("see any agent of the ecosystem");
    }
    if let Some(wanted) = wanted.filter(|wanted| directory.find(wanted).is_none()) {
        output::note(&format!("`{wanted}` is not here yet; what you say waits for it"));
    }
    Ok(())
}

fn code_of(heard: &Heard, was_cancel: bool) -> u8 {
    match heard {
        Heard::Report(_, Report { outcome: Outcome::Cancelled, .. }) if was_cancel => exit::DONE,
        Heard::Unanswered(..) => exit::UNAVAILABLE,
        heard if heard.is_success() => exit::DONE,
        _ => FAILED,
    }
}
