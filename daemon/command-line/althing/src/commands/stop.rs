//! `althing stop`: stops the actuators of a running ecosystem, or some of them; also lists stops
//! and releases them.
//!
//! The request goes to every agent that is present, at once and without a query to another agent: a
//! stop must work if every reasoning agent is dead. Actuators repeat the stop in their heartbeats.

pub(super) mod hardware_stops;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::process::ExitCode;

use acl::AgentId;
use acl::content::{ReleaseStops, Request, Stop};
use serde_json::json;
use terminal::{exit, output, visible};

use crate::asking::stops::{
    StopAnswer, StopAnswers, absent, in_force, is_known, new_id, send_to_all, states,
};
use crate::cli::stop::StopArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::user_request::FAILED;

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
    let by = match own_name() {
        Ok(by) => by,
        Err(problem) => return super::wrong(&problem, json),
    };
    let id = match new_id() {
        Ok(id) => id,
        Err(problem) => return client::unavailable(problem, json),
    };
    let why = because.unwrap_or_default().to_owned();
    let stop = Stop { id: id.clone(), scope: names.to_vec(), by: by.clone(), why };
    let table = match send_to_all(view, by, &Request::Stop(stop.clone())).await {
        Ok(table) => table,
        Err(problem) => return client::unavailable(problem, json),
    };
    // Only now are all agents seen.
    let concerns_any = table.values().any(|answer| StopAnswer::is_concerned(answer.as_ref()));
    let unknown: Vec<&String> =
        names.iter().filter(|name| !is_known(view, name, concerns_any)).collect();
    unknown.iter().for_each(|name| note_unknown(view, name));
    let head = format!("stop {id}: {}", what(&stop));
    let code = print_table(view, &head, &table, Some(&id), json);
    if !unknown.is_empty() && !concerns_any {
        output::print_note("error: the stop concerns no agent");
        return exit::with(FAILED);
    }
    code
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
    let by = match own_name() {
        Ok(by) => by,
        Err(problem) => return super::wrong(&problem, json),
    };
    let request = Request::ReleaseStops(ReleaseStops { ids: ids.clone() });
    let table = match send_to_all(view, by, &request).await {
        Ok(table) => table,
        Err(problem) => return client::unavailable(problem, json),
    };
    let head = release_head(&ids, &self::in_force(&self::states(view).await));
    print_table(view, &head, &table, None, json)
}

/// Returns which of the stops `ids` are released; `remaining` are those that some actuator has in
/// force.
fn release_head(ids: &[String], remaining: &BTreeMap<String, Stop>) -> String {
    let (held, released): (Vec<&str>, Vec<&str>) =
        ids.iter().map(String::as_str).partition(|id| remaining.contains_key(*id));
    let parts = [("released: ", released), ("still in force: ", held)];
    let told = parts.into_iter().filter(|(_, ids)| !ids.is_empty());
    told.map(|(what, ids)| format!("{what}{}", ids.join(", "))).collect::<Vec<_>>().join("; ")
}

/// Returns the name under which the command asks.
fn own_name() -> Result<AgentId, String> {
    AgentId::new(&client::guest_name("stop")).map_err(|error| error.to_string())
}

fn print_table(
    view: &EcosystemView,
    head: &str,
    table: &StopAnswers,
    stop: Option<&str>,
    json: bool,
) -> ExitCode {
    let absent = absent(view);
    let said = |answer: &Option<StopAnswer>| StopAnswer::describe(answer.as_ref());
    let is_complete =
        absent.is_empty() && table.values().all(|answer| StopAnswer::is_obeyed(answer.as_ref()));
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
pub(super) fn what(stop: &Stop) -> String {
    let what = match stop.scope.as_slice() {
        [] => "everything".to_owned(),
        names => names.join(", "),
    };
    let why = if stop.why.is_empty() { String::new() } else { format!(" ({})", stop.why) };
    visible::line(&format!("{what}{why}")).to_string()
}

fn note_unknown(view: &EcosystemView, name: &str) {
    let directory = view.router.directory();
    let near = pddl::nearest(name, directory.iter().map(|known| known.agent.as_str()));
    let near = near.map(|near| format!(" (did you mean `{near}`?)")).unwrap_or_default();
    let places = match &view.ecosystem {
        Some(_) => "and no place of the map",
        None => "and whether it is a place, only the ecosystem file says (--ecosystem FILE)",
    };
    output::print_note(&format!(
        "note: `{name}` is no agent that is present{near}, {places}; it is stopped all the same"
    ));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_stops_that_are_over_are_called_released() {
        let stop = |id: &str| {
            let by = AgentId::new("button").expect("a name");
            (id.to_owned(), Stop { id: id.to_owned(), scope: Vec::new(), by, why: String::new() })
        };
        let ids = ["one".to_owned(), "two".to_owned()];
        assert_eq!(release_head(&ids, &BTreeMap::new()), "released: one, two");
        let held = [stop("two"), stop("other")].into();
        assert_eq!(release_head(&ids, &held), "released: one; still in force: two");
        assert_eq!(release_head(&ids[1..], &held), "still in force: two");
    }
}
