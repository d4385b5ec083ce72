//! `althing stop`: stops the actuators of a running ecosystem, or some of them; also lists stops
//! and releases them.
//!
//! The request goes to every agent that is present, at once and without a query to another agent: a
//! stop must work if every reasoning agent is dead. Actuators repeat the stop in their heartbeats.

pub(super) mod hardware_stops;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::pin::pin;
use std::process::ExitCode;
use std::time::Duration;

use acl::content::{Refusal, ReleaseStops, Report, Request, Stop, StopEffect, StopState, value};
use acl::{AgentId, Message, Performative, Protocol};
use agent::Resource;
use keyboard::{Keyboard, MessageDraft, Terminal, UserEvent, UserRequest};
use ring::rand::{SecureRandom as _, SystemRandom};
use serde_json::{Value, json};
use terminal::{exit, output, visible};

use crate::cli::stop::StopArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::user_request::FAILED;
use crate::{hosting, plugins};

/// How long answers are awaited. An actuator answers within milliseconds; an actuator with a lost
/// link needs longer, until it is reached through another link.
const ANSWERED_WITHIN: Duration = Duration::from_secs(3);

/// Maximum number of agents that are asked and have not answered. It is a fraction of the capacity
/// of a keyboard agent's queue.
const UNANSWERED_MAX: usize = 256;

/// Number of random bytes in the identifier of a stop. The identifier tells apart the stops of a
/// building, and is short enough to be typed.
const ID_BYTES: usize = 4;

/// Answer of one agent to a stop or a release.
enum StopAnswer {
    /// The agent has carried out the request; the text says what it did.
    Done(String),
    /// The stop does not concern the agent; the text says what it does.
    Unconcerned(String),
    /// The agent has done what it can, but its device may go on; the text says why.
    Doubtful(String),
    /// The agent has not carried out the request, for this reason.
    Declined(String),
}

/// Runs `althing stop`.
pub(super) fn run(args: &StopArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let code = if args.list {
            list(&link.view, json).await
        } else if args.release {
            release(&link.view, &args.names, json).await
        } else {
            stop(&link.view, &args.names, args.because.as_deref(), json).await
        };
        (link, code)
    })
}

/// Prints the stops in force, each with the number of actuators that know it, and the positions of
/// hardware stops.
pub(crate) async fn list(view: &EcosystemView, json: bool) -> ExitCode {
    let states = states(view).await;
    let (stops, buttons) = (in_force(&states), hardware_stops::positions(&states));
    if json {
        let value = json!({
            "stops": stops, "actuators": states.len(), "buttons": hardware_stops::value(&buttons),
        });
        return output::print_json(&value, exit::DONE);
    }
    let mut text = String::new();
    if stops.is_empty() {
        text += "nothing is stopped\n";
    } else {
        let _ = writeln!(text, "{:<20} {:<20} {:>9}  WHAT", "ID", "BY", "KNOW");
    }
    for stop in stops.values() {
        let know = states.iter().filter(|state| state.stops.iter().any(|it| it.id == stop.id));
        let (id, by) = (visible::line(&stop.id), stop.by.as_str());
        let know = format!("{} of {}", know.count(), states.len());
        let _ = writeln!(text, "{id:<20} {by:<20} {know:>9}  {}", what(stop));
    }
    text += &hardware_stops::described(&buttons);
    output::print(text, exit::DONE)
}

/// Stops the agents and places `names`, or everything if there are none, and prints the answers.
pub(crate) async fn stop(
    view: &EcosystemView,
    names: &[String],
    because: Option<&str>,
    json: bool,
) -> ExitCode {
    let by = match AgentId::new(&client::guest_name("stop")) {
        Ok(by) => by,
        Err(error) => return super::wrong(&error.to_string(), json),
    };
    let unknown = names.iter().find(|name| !is_known(view, name));
    if let Some(unknown) = unknown {
        let directory = view.router.directory();
        let near = pddl::nearest(unknown, directory.iter().map(|known| known.agent.as_str()));
        let near = near.map(|near| format!(" (did you mean `{near}`?)")).unwrap_or_default();
        output::print_note(&format!(
            "note: `{unknown}` is no agent that is present{near}, and no place of the map; it is \
             stopped all the same"
        ));
    }
    let id = match new_id() {
        Ok(id) => id,
        Err(problem) => return client::unavailable(problem, json),
    };
    let why = because.unwrap_or_default().to_owned();
    let stop = Stop { id: id.clone(), scope: names.to_vec(), by, why };
    let table = match send_to_all(view, &Request::Stop(stop.clone())).await {
        Ok(table) => table,
        Err(problem) => return client::unavailable(problem, json),
    };
    let head = format!("stop {id}: {}", what(&stop));
    let code = print_table(view, &head, &table, Some(&id), json);
    let is_concerned =
        |answer: &Option<StopAnswer>| !matches!(answer, Some(StopAnswer::Unconcerned(_)));
    if unknown.is_some() && !table.values().any(is_concerned) {
        output::print_note("error: the stop concerns no agent");
        return exit::with(FAILED);
    }
    code
}

/// Returns a random identifier of a stop.
fn new_id() -> Result<String, &'static str> {
    let mut bytes = [0; ID_BYTES];
    let filled = SystemRandom::new().fill(&mut bytes);
    filled.map_err(|_| "name the stop: the system gives no random numbers")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Releases the stops `names`, or all that are in force if there are none, and prints the answers.
pub(crate) async fn release(view: &EcosystemView, names: &[String], json: bool) -> ExitCode {
    let in_force = in_force(&states(view).await);
    if let Some(unknown) = names.iter().find(|name| !in_force.contains_key(*name)) {
        let known: Vec<&str> = in_force.keys().map(String::as_str).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        return super::wrong(&format!("there is no stop `{unknown}`; in force: {known}"), json);
    }
    let ids: Vec<String> = match names {
        [] => in_force.into_keys().collect(),
        named => named.to_vec(),
    };
    if ids.is_empty() {
        return output::print("nothing is stopped\n", exit::DONE);
    }
    let head = format!("released: {}", ids.join(", "));
    let table = match send_to_all(view, &Request::ReleaseStops(ReleaseStops { ids })).await {
        Ok(table) => table,
        Err(problem) => return client::unavailable(problem, json),
    };
    print_table(view, &head, &table, None, json)
}

/// Sends a request to all agents that are present, and returns the answers of the actuators; `None`
/// for an actuator that did not answer in time.
async fn send_to_all(
    view: &EcosystemView,
    request: &Request,
) -> Result<BTreeMap<AgentId, Option<StopAnswer>>, &'static str> {
    let (keyboard, terminal) = Keyboard::with_terminal();
    let id = AgentId::new(&client::guest_name("stop")).map_err(|_| "name a keyboard")?;
    let _guest = hosting::launch_guest(&view.router, id.clone(), keyboard, view.ontology());
    let mut round = Round::new(id, terminal, request);
    round.run(view).await?;
    let Round { asked, mut answers, .. } = round;
    let mut table = BTreeMap::new();
    for agent in asked {
        let answer = answers.remove(&agent);
        let is_done = !matches!(answer, Some(StopAnswer::Declined(_)) | None);
        // Only agents with an action model act, and only they are in the table. Other agents
        // decline the request.
        if is_done || has_model(view, &agent).await {
            table.insert(agent, answer);
        }
    }
    Ok(table)
}

/// Whether an agent has announced an action model. An agent in another language may not know stops,
/// and must be in the table nevertheless.
async fn has_model(view: &EcosystemView, agent: &AgentId) -> bool {
    !view.ask(Resource::Model, Some(agent.clone())).await.is_empty()
}

/// A request to all agents, with the answers so far. When the command joins, it sees the agents one
/// after the other, and asks each as soon as it sees the agent.
struct Round {
    /// The agent that asks.
    own: AgentId,
    terminal: Terminal,
    content: Value,
    asked: BTreeSet<AgentId>,
    answers: BTreeMap<AgentId, StopAnswer>,
}

impl Round {
    fn new(own: AgentId, terminal: Terminal, request: &Request) -> Round {
        let content = value(request);
        Round { own, terminal, content, asked: BTreeSet::new(), answers: BTreeMap::new() }
    }

    /// Asks all agents, and waits until all have answered, or until the deadline. Returns an error
    /// if no agent is seen.
    async fn run(&mut self, view: &EcosystemView) -> Result<(), &'static str> {
        let deadline = tokio::time::sleep(ANSWERED_WITHIN);
        let (mut deadline, router) = (pin!(deadline), &view.router);
        let (_, mut changes) = router.presence_changes();
        let mut sees_all = pin!(router.broadcast_ready());
        let mut is_complete = false;
        loop {
            self.ask_new(view)?;
            if is_complete && self.answers.len() == self.asked.len() {
                break;
            }
            tokio::select! {
                heard = self.terminal.events.recv() => {
                    let heard = heard.ok_or("hear the answers: the keyboard agent has ended")?;
                    if let UserEvent::Answered(_, message) = heard
                        && let Some(answer) = answer_of(&message)
                    {
                        self.answers.insert(message.sender.clone(), answer);
                    }
                }
                _ = changes.recv() => (),
                () = &mut sees_all, if !is_complete => is_complete = true,
                () = &mut deadline => break,
            }
        }
        if self.asked.is_empty() { Err("see any agent of the ecosystem") } else { Ok(()) }
    }

    /// Asks the agents that are seen and were not asked yet. If [`UNANSWERED_MAX`] agents have not
    /// answered, the others are asked after the next answers.
    fn ask_new(&mut self, view: &EcosystemView) -> Result<(), &'static str> {
        let directory = view.router.directory();
        let present = directory.iter().filter(|resident| !resident.daemon.is_guest());
        let others = present.map(|resident| &resident.agent).filter(|agent| **agent != self.own);
        for agent in others.cloned().collect::<Vec<_>>() {
            if self.asked.contains(&agent) || self.asked.len() > self.answers.len() + UNANSWERED_MAX
            {
                continue;
            }
            let draft = MessageDraft {
                to: Some(agent.clone()),
                performative: Performative::Request,
                protocol: Protocol::StateChange,
                conversation: None,
                content: self.content.clone(),
                patience: ANSWERED_WITHIN,
            };
            let sent = self.terminal.requests.try_send(UserRequest::Send(draft));
            sent.map_err(|_| "send the request: the keyboard agent has ended")?;
            self.asked.insert(agent);
        }
        Ok(())
    }
}

/// Reads an answer to a stop or a release; `None` for a message that is no final answer.
fn answer_of(message: &Message) -> Option<StopAnswer> {
    match message.performative {
        Performative::Confirm => {
            let report = message.content_as::<Report>().ok()?;
            Some(match report.stop_effect {
                Some(StopEffect::Doubtful) => StopAnswer::Doubtful(report.detail),
                Some(StopEffect::Unconcerned) => StopAnswer::Unconcerned(report.detail),
                _ => StopAnswer::Done(report.detail),
            })
        }
        Performative::Refuse | Performative::NotUnderstood => {
            let why = message.content_as::<Refusal>().map(|refusal| refusal.detail);
            Some(StopAnswer::Declined(why.unwrap_or_else(|error| error.to_string())))
        }
        _ => None,
    }
}

/// Returns the agents with a driver that the ecosystem file names and that are absent. What their
/// devices do is unknown.
fn absent(view: &EcosystemView) -> Vec<AgentId> {
    let directory = view.router.directory();
    let entries = view.ecosystem.iter().flat_map(|ecosystem| &ecosystem.agents);
    let known = plugins::known();
    let is_device =
        |plugin: &str| known.iter().any(|known| known.name == plugin && !known.drivers.is_empty());
    entries
        .filter(|entry| is_device(&entry.plugin) && directory.find(&entry.name).is_none())
        .map(|entry| entry.name.clone())
        .collect()
}

fn print_table(
    view: &EcosystemView,
    head: &str,
    table: &BTreeMap<AgentId, Option<StopAnswer>>,
    stop: Option<&str>,
    json: bool,
) -> ExitCode {
    let absent = absent(view);
    let said = |answer: &Option<StopAnswer>| match answer {
        Some(StopAnswer::Done(what) | StopAnswer::Unconcerned(what)) => what.clone(),
        Some(StopAnswer::Doubtful(what)) => format!("MAY GO ON: {what}"),
        Some(StopAnswer::Declined(why)) => format!("NOT DONE: {why}"),
        None => "DID NOT ANSWER: it may go on".to_owned(),
    };
    let is_done = |answer: &&Option<StopAnswer>| {
        matches!(answer, Some(StopAnswer::Done(_) | StopAnswer::Unconcerned(_)))
    };
    let is_complete = absent.is_empty() && table.values().filter(is_done).count() == table.len();
    let code = if is_complete { exit::DONE } else { FAILED };
    if json {
        let agents: BTreeMap<&str, String> =
            table.iter().map(|(agent, answer)| (agent.as_str(), said(answer))).collect();
        let value = json!({
            "stop": stop, "agents": agents, "not_reached": absent, "complete": is_complete,
        });
        return output::print_json(&value, code);
    }
    let absent = absent.iter().map(|agent| (agent, "NOT REACHED: it is absent".to_owned()));
    let rows = table.iter().map(|(agent, answer)| (agent, said(answer))).chain(absent);
    let mut text = format!("{head}\n");
    for (agent, said) in rows {
        let _ = writeln!(text, "  {:<24} {}", agent.as_str(), visible::line(&said));
    }
    if let Some(id) = stop {
        let _ = writeln!(text, "release it: althing stop --release {id}");
    }
    output::print(text, code)
}

/// Returns what a stop stops, in words for a person.
fn what(stop: &Stop) -> String {
    let what = match stop.scope.as_slice() {
        [] => "everything".to_owned(),
        names => names.join(", "),
    };
    let why = if stop.why.is_empty() { String::new() } else { format!(" ({})", stop.why) };
    visible::line(&format!("{what}{why}")).to_string()
}

/// Whether a name is that of an agent that is present, or of an object of the map. If the map is
/// unknown, any name may be that of a place.
fn is_known(view: &EcosystemView, name: &str) -> bool {
    let is_agent = AgentId::new(name).is_ok_and(|id| view.router.directory().find(&id).is_some());
    let map = view.ecosystem.as_ref().map(|ecosystem| &ecosystem.problem);
    let is_place = |map: &std::sync::Arc<pddl::Problem>| {
        map.objects.iter().any(|declared| declared.object.name == *name)
    };
    is_agent || map.is_some_and(is_place)
}

/// Queries the stops, and the positions of hardware stops, that each actuator knows.
pub(super) async fn states(view: &EcosystemView) -> Vec<StopState> {
    let answers = view.ask(Resource::Stops, None).await;
    answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
}

/// Returns the stops that any actuator knows, by their identifiers.
fn in_force(states: &[StopState]) -> BTreeMap<String, Stop> {
    let stops = states.iter().flat_map(|state| &state.stops);
    stops.map(|stop| (stop.id.clone(), stop.clone())).collect()
}
