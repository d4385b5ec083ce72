//! Sends one request or message to a running ecosystem, through a keyboard agent that the command
//! launches, and follows the answers. The commands `goal`, `act`, `set`, `mode`, `answer` and
//! `send` use this.

use std::mem;
use std::pin::pin;
use std::process::ExitCode;
use std::time::Duration;

use acl::content::{GoalStatus, HistoryEntry, Outcome, Report};
use acl::{AgentId, ConversationId};
use keyboard::{Keyboard, RequestRef, Terminal, UserEvent, UserRequest};
use terminal::{exit, output};

use crate::commands::client::{self, ClientLink};
use crate::commands::connection_watch::{ConnectionEvent, ConnectionWatch};
use crate::commands::printed_reports::PrintedReports;
use crate::commands::side_link::SideLink;
use crate::commands::{event_output, goals};
use crate::interruption;

/// The number of the signal that Ctrl-C sends.
const SIGINT: i32 = 2;

/// How long the number of a goal is awaited after Ctrl-C, because the user wants the command to end.
const NUMBER_WITHIN: Duration = Duration::from_secs(1);

/// Exit code if the request failed or was refused.
pub(super) const FAILED: u8 = 1;

/// The effect of Ctrl-C on the request that the command follows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum InterruptAction {
    /// The request continues without the command, and the user is shown this text.
    Leave(String),
    /// The goal continues without the command. The user is shown the commands that follow the goal
    /// and cancel it. The text contains the options of these commands that name the ecosystem.
    LeaveGoal(String),
    /// The request is cancelled, and the command waits for the final report; a second Ctrl-C ends
    /// the command at once.
    GiveUp,
}

/// Options for sending a request and following it.
pub(super) struct ExchangeOptions {
    /// The agent that the command waits for before it sends; `None` if it need not wait for one.
    pub(super) to: Option<AgentId>,
    pub(super) json: bool,
    pub(super) interrupt: InterruptAction,
}

/// Sends one request or message, and prints the answers up to the final one.
pub(super) async fn send_and_follow(
    link: &ClientLink,
    said: UserRequest,
    manner: ExchangeOptions,
) -> ExitCode {
    let (json, mut ctrl_c) = (manner.json, interruption::CtrlC::listen());
    let is_cancel = matches!(said, UserRequest::Cancel(_));
    let is_to_all = matches!(&said, UserRequest::Send(draft) if draft.to.is_none());
    let mut terminal = match begin(link, said, &manner).await {
        Ok(terminal) => terminal,
        Err(problem) => return client::unavailable(problem, json),
    };
    let mut vigil = vigil(link, &manner);
    let (mut about, mut holds) = (None::<ConversationId>, false);
    let mut interrupt = manner.interrupt;
    let mut told = PrintedReports::default();
    let mut side: Option<SideLink> = None;
    let mut reader_gone = pin!(interruption::reader_gone());
    loop {
        let heard = tokio::select! {
            news = news(&mut vigil) => {
                let goals = goals_after(link, news, &mut side).await;
                catch_up(goals, about.as_ref(), &mut told, json);
                continue;
            }
            goals = SideLink::goals(&mut side) => {
                catch_up(goals, about.as_ref(), &mut told, json);
                continue;
            }
            heard = terminal.events.recv() => heard,
            () = ctrl_c.pressed() => {
                if let (InterruptAction::GiveUp, Some(about)) = (&interrupt, &about) {
                    interrupt = give_up(&terminal, about).await;
                    continue;
                }
                advise(link, about.as_ref(), &interrupt).await;
                // An interrupted request is not done, except for a goal that holds already.
                return if holds { exit::with(exit::DONE) } else { exit::by_signal(SIGINT) };
            }
            () = &mut reader_gone => {
                output::print_note(&interrupt.advice(about.as_ref().map(ConversationId::as_str)));
                return exit::with(exit::DONE);
            }
        };
        let Some(mut heard) = heard else {
            return client::unavailable("receive an answer: the keyboard agent has ended", json);
        };
        about = about.or_else(|| heard.conversation().cloned());
        if let UserEvent::Report(about, report) = &mut heard {
            print_missed(&mut told, &about.conversation, mem::take(&mut report.history), json);
            let is_news = told.note(report);
            holds = heard.is_success();
            if !is_news {
                continue;
            }
        }
        let printed = event_output::print(&heard, json);
        if printed != exit::with(exit::DONE) || output::is_reader_gone() {
            return printed;
        }
        // The number of answers to a message to all agents is unknown.
        if heard.is_final() && !(is_to_all && matches!(heard, UserEvent::Answered(..))) {
            return exit::with(code_of(&heard, is_cancel));
        }
    }
}

/// Tells the user what becomes of the request after Ctrl-C.
async fn advise(link: &ClientLink, about: Option<&ConversationId>, interrupt: &InterruptAction) {
    let name = goal_name(link, about, interrupt).await;
    output::print_note(&interrupt.advice(name.as_deref()));
}

/// Returns the name by which the user refers to the goal `about`: its number, or its conversation if
/// the number is not known in time.
async fn goal_name(
    link: &ClientLink,
    about: Option<&ConversationId>,
    interrupt: &InterruptAction,
) -> Option<String> {
    let about = about?;
    let is_goal = matches!(interrupt, InterruptAction::LeaveGoal(_));
    let goals = match is_goal {
        true => tokio::time::timeout(NUMBER_WITHIN, goals::ask(&link.view)).await.ok().flatten(),
        false => None,
    };
    let goal = goals.into_iter().flatten().find(|goal| goal.conversation == *about);
    let number = goal.map(|goal| goal.number).filter(|number| *number > 0);
    Some(number.map_or_else(|| about.as_str().to_owned(), |number| number.to_string()))
}

/// Cancels the request `about`. Returns what the next Ctrl-C does.
async fn give_up(terminal: &Terminal, about: &ConversationId) -> InterruptAction {
    output::print_note("cancelling; Ctrl-C once more leaves without the outcome");
    // If the keyboard agent has ended, the next event tells so.
    let _ = terminal.requests.send(UserRequest::Cancel(about.clone())).await;
    InterruptAction::Leave("cancelling it was requested".to_owned())
}

impl InterruptAction {
    /// Returns the text that is shown if the user presses Ctrl-C before the request has ended.
    fn advice(&self, about: Option<&str>) -> String {
        match (self, about) {
            (InterruptAction::Leave(advice), _) => advice.clone(),
            (InterruptAction::LeaveGoal(reach), Some(id)) => format!(
                "the goal goes on without this command\n\
                 its state:   althing goals{reach}\n\
                 follow it:   althing watch --conversation {id}{reach}\n\
                 cancel it:   althing goal --cancel {id}{reach}"
            ),
            (InterruptAction::LeaveGoal(_), None) => "nothing was requested yet".to_owned(),
            (InterruptAction::GiveUp, _) => "the action goes on without this command".to_owned(),
        }
    }
}

/// Sends the request from a new keyboard agent. Returns the terminal that receives the answers. The
/// error text completes the sentence “failed to …”.
async fn begin(
    link: &ClientLink,
    said: UserRequest,
    manner: &ExchangeOptions,
) -> Result<Terminal, &'static str> {
    let is_to_all = matches!(&said, UserRequest::Send(draft) if draft.to.is_none());
    let (keyboard, terminal) = Keyboard::with_terminal();
    let id = AgentId::new(&client::guest_name("keyboard")).map_err(|_| "name a keyboard")?;
    await_receiver(link, manner.to.as_ref()).await?;
    link.node.launch(id, keyboard, link.view.ontology());
    if is_to_all {
        // A message to all agents is not resent, so all agents must be reachable before it is sent.
        link.node.router().broadcast_ready().await;
    }
    let sent = terminal.requests.send(said).await;
    sent.map_err(|_| "send the request: the keyboard agent has ended")?;
    Ok(terminal)
}

/// Starts to watch the leader and the link. Returns `None` if the request is not for a goal.
fn vigil(link: &ClientLink, manner: &ExchangeOptions) -> Option<ConnectionWatch> {
    if !matches!(manner.interrupt, InterruptAction::LeaveGoal(_)) {
        return None;
    }
    let leader = manner.to.as_ref()?;
    Some(ConnectionWatch::begin(&link.view, leader.clone()))
}

async fn news(vigil: &mut Option<ConnectionWatch>) -> ConnectionEvent {
    match vigil {
        Some(vigil) => vigil.news().await,
        None => std::future::pending().await,
    }
}

/// Handles a change of the leader or of the link. Returns all goals of the ecosystem if the command
/// may have missed reports about its goal, otherwise an empty list.
async fn goals_after(
    link: &ClientLink,
    event: ConnectionEvent,
    side: &mut Option<SideLink>,
) -> Vec<GoalStatus> {
    match event {
        ConnectionEvent::Line(line) => output::print_note(&line),
        ConnectionEvent::Stopped(line) => {
            output::print_note(&line);
            *side = SideLink::open(&link.view).await;
        }
        ConnectionEvent::Reconnected => {
            SideLink::close(side).await;
            return goals::ask(&link.view).await.unwrap_or_default();
        }
    }
    Vec::new()
}

/// Prints the reports of a goal that the command missed, as far as the Plan Requester still keeps
/// them.
fn catch_up(
    goals: Vec<GoalStatus>,
    about: Option<&ConversationId>,
    told: &mut PrintedReports,
    json: bool,
) {
    let Some(about) = about else { return };
    if let Some(goal) = goals.into_iter().find(|goal| goal.conversation == *about) {
        print_missed(told, about, goal.history, json);
    }
}

/// Prints the lines of a goal's history that the command has not printed yet.
fn print_missed(
    told: &mut PrintedReports,
    about: &ConversationId,
    history: Vec<HistoryEntry>,
    json: bool,
) {
    for report in told.missed(history) {
        let about = RequestRef { id: None, conversation: about.clone() };
        event_output::print(&UserEvent::Report(about, report), json);
    }
}

/// Waits until the receiver of the request is seen. The user is told if the receiver is not seen in
/// time.
async fn await_receiver(link: &ClientLink, to: Option<&AgentId>) -> Result<(), &'static str> {
    let directory = link.view.directory(to).await;
    if directory.iter().next().is_none() {
        return Err("see any agent of the ecosystem");
    }
    if let Some(wanted) = to.filter(|wanted| directory.find(wanted).is_none()) {
        output::print_note(&format!("`{wanted}` is not here yet; the request waits for it"));
    }
    Ok(())
}

fn code_of(heard: &UserEvent, was_cancel: bool) -> u8 {
    match heard {
        UserEvent::Report(_, Report { outcome: Outcome::Cancelled, .. }) if was_cancel => {
            exit::DONE
        }
        UserEvent::Unanswered(..) => exit::UNAVAILABLE,
        heard if heard.is_success() => exit::DONE,
        _ => FAILED,
    }
}
