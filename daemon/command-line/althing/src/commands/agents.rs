//! `althing agents`: shows the agents that are present, with their actions.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::process::ExitCode;

use acl::AgentId;
use acl::content::{DiscoveryReport, Inform, Snapshot};
use agent::{Resident, Resource};
use jiff::Zoned;
use serde_json::json;
use terminal::render::plural;
use terminal::{exit, output, visible};

use crate::asking::stops::states;
use crate::cli::AgentsArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::leaders::{self, ReplicaHosts};
use crate::commands::stop::hardware_stops;
use crate::plugins;

/// Runs `althing agents`: prints one line per agent.
pub(super) fn run(args: &AgentsArgs) -> ExitCode {
    if args.discovered {
        return client::with_view(&args.ask, discovered);
    }
    client::with_view(&args.ask, print)
}

/// Prints the discovered agents, each with the lines that would name it in the ecosystem file.
async fn discovered(view: &EcosystemView, json: bool) -> ExitCode {
    view.directory(None).await;
    let answers = view.ask(Resource::Discovered, None).await;
    let read = |answer: &bytes::Bytes| serde_json::from_slice(answer).ok();
    let mut found: Vec<DiscoveryReport> = answers.iter().filter_map(read).collect();
    found.sort_by(|one, other| one.daemon.cmp(&other.daemon));
    if json {
        let value = json!({ "ecosystem": view.name, "daemons": found });
        return output::print_json(&value, exit::DONE);
    }
    let mut text = String::new();
    for DiscoveryReport { daemon, discovered } in &found {
        for one in discovered {
            let joined = if one.joined { "takes part" } else { "does not take part" };
            let why = one.problem.as_ref().map(|why| format!(": {why}")).unwrap_or_default();
            let said = format!("# {}: {joined}{why}; by {} at {daemon}", one.agent, one.by);
            let said = visible::line(&said);
            let _ =
                write!(text, "{}\n{}\n", output::folded(&said, 0).replace('\n', "\n# "), one.toml);
        }
    }
    if text.is_empty() {
        text = "no agents are present that the ecosystem's file does not name\n".to_owned();
    }
    output::print(text, exit::DONE)
}

/// Columns of the names of an agent and of its daemon, and the column in which the offered actions
/// begin.
const AGENT_COLUMNS: usize = 24;
const DAEMON_COLUMNS: usize = 16;
const OFFERS_COLUMN: usize = AGENT_COLUMNS + DAEMON_COLUMNS + 2;

pub(crate) async fn print(view: &EcosystemView, json: bool) -> ExitCode {
    view.directory(None).await;
    let mut residents: BTreeSet<Resident> = residents(view).await;
    let AnnouncedModels { models, unreadable } = models(view).await;
    let offers = |agent: &AgentId| models.get(agent).cloned().unwrap_or_default();
    // A process that is no daemon of Althing may answer for its models only.
    let directory = view.directory(None).await;
    let answering = models.keys().chain(unreadable.keys());
    residents.extend(answering.filter_map(|agent| directory.find(agent).cloned()));
    let mut conflicts = conflicts(view).await;
    conflicts.extend(unreadable);
    let left_out = |agent: &AgentId| conflicts.get(agent).cloned().unwrap_or_default();
    let buttons = hardware_stops::positions(&states(view).await);
    let silent = hardware_stops::warnings(&buttons);
    if json {
        let agents: Vec<_> = residents
            .iter()
            .map(|resident| {
                json!({
                    "agent": resident.agent,
                    "daemon": resident.daemon,
                    "incarnation": resident.incarnation,
                    "actions": offers(&resident.agent),
                    "conflicts": left_out(&resident.agent),
                })
            })
            .collect();
        let value = json!({ "ecosystem": view.name, "agents": agents, "problems": silent });
        return output::print_json(&value, exit::DONE);
    }
    let replicas = leaders::replicas(view).await;
    let (acting, others): (Vec<_>, Vec<_>) =
        residents.iter().partition(|resident| !offers(&resident.agent).is_empty());
    let mut text = heading(view, &residents);
    let offered = |resident: &Resident| offers(&resident.agent).join(", ");
    text += &rows("OFFERS", &acting, offered, left_out);
    let role = |resident: &Resident| role(view, resident, &replicas);
    text += &rows("DOES", &others, role, left_out);
    for silent in &silent {
        let _ = writeln!(text, "{}", output::folded(silent, 4));
    }
    output::print(text, exit::DONE)
}

/// Returns the line above the agents: how many there are, and on which daemons.
fn heading(view: &EcosystemView, residents: &BTreeSet<Resident>) -> String {
    let is_daemon = |resident: &&Resident| !resident.daemon.is_guest();
    let daemons: BTreeSet<_> =
        residents.iter().filter(is_daemon).map(|resident| &resident.daemon).collect();
    let line = format!(
        "{} of `{}` on {} at {}",
        plural(residents.len(), "agent"),
        view.name,
        plural(daemons.len(), "daemon"),
        Zoned::now().strftime("%H:%M:%S")
    );
    output::folded(&line, 0) + "\n"
}

/// Returns a table of agents: the name of each, its daemon, and `about` it; nothing without agents.
/// The parts of its action model that are `left_out` stand below an agent.
fn rows(
    title: &str,
    residents: &[&Resident],
    about: impl Fn(&Resident) -> String,
    left_out: impl Fn(&AgentId) -> Vec<String>,
) -> String {
    if residents.is_empty() {
        return String::new();
    }
    let row = |agent: &str, daemon: &str, about: &str| {
        let line = format!("{agent:<AGENT_COLUMNS$} {daemon:<DAEMON_COLUMNS$} {about}");
        output::folded(line.trim_end(), OFFERS_COLUMN)
    };
    let mut text = format!("\n{}\n", row("AGENT", "DAEMON", title));
    for resident in residents {
        let (agent, daemon) = (resident.agent.as_str(), resident.daemon.as_str());
        let _ = writeln!(text, "{}", row(agent, daemon, &about(resident)));
        for conflict in left_out(&resident.agent) {
            let line = format!("    {}", visible::line(&conflict));
            let _ = writeln!(text, "{}", output::folded(&line, 4));
        }
    }
    text
}

/// Returns what an agent without actions does, as far as its plugin is known; and whether it leads or
/// stands by, if it has replicas.
fn role(
    view: &EcosystemView,
    resident: &Resident,
    replicas: &BTreeMap<AgentId, ReplicaHosts>,
) -> String {
    let agent = &resident.agent;
    let of_file = view.ecosystem.as_ref().and_then(|ecosystem| {
        ecosystem.agents.iter().find(|entry| entry.name == *agent && entry.is_built_in())
    });
    let plugin = of_file.map_or(agent.as_str(), |entry| entry.plugin.as_str());
    let does = match plugins::find(plugin) {
        Some(plugin) => plugin.about.to_owned(),
        None if resident.daemon.is_guest() => "takes part for a command or a person".to_owned(),
        None => String::new(),
    };
    let hosts = replicas.get(agent).filter(|hosts| !hosts.standbys.is_empty());
    match hosts {
        Some(hosts) => format!("{does}; leads {}", hosts.in_words()),
        None => does,
    }
}

/// Queries all agents from the daemons that host them: the command's link may not have reported all
/// agents yet.
pub(super) async fn residents(view: &EcosystemView) -> BTreeSet<Resident> {
    view.ask(Resource::Directory, None)
        .await
        .iter()
        .filter_map(|answer| serde_json::from_slice::<Vec<Resident>>(answer).ok())
        .flatten()
        .collect()
}

/// Queries, for each agent, the parts of its action model that the Domain Maintainer had to leave
/// out.
async fn conflicts(view: &EcosystemView) -> BTreeMap<AgentId, Vec<String>> {
    let maintainer = Some(view.roles().domain_maintainer.clone());
    let answers = view.ask(Resource::Domain, maintainer).await;
    let snapshot = answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
    snapshot.map(|snapshot| snapshot.conflicts).unwrap_or_default()
}

/// Action models that the agents have announced.
#[derive(Default)]
pub(super) struct AnnouncedModels {
    /// For each agent, the names of the actions in its action model.
    models: BTreeMap<AgentId, Vec<String>>,
    /// A line for the user about each agent that uses another version of the protocol.
    pub(super) unreadable: BTreeMap<AgentId, Vec<String>>,
}

/// Queries the action models of all agents.
pub(super) async fn models(view: &EcosystemView) -> AnnouncedModels {
    let mut announced_models = AnnouncedModels::default();
    let AnnouncedModels { models, unreadable } = &mut announced_models;
    for answer in view.ask(Resource::Model, None).await {
        let message = match acl::decode(&answer) {
            Ok(message) => message,
            Err(error) => {
                if let Some(sender) = error.sketch.sender.clone()
                    && error.is_of_other_version()
                {
                    unreadable.insert(sender, vec![format!("no plan uses it: {}", error.problem)]);
                }
                continue;
            }
        };
        let Ok(Inform::Model(announced)) = message.content_as::<Inform>() else { continue };
        let Some(model) = pddl::parse_action_model(&announced.model).value else { continue };
        let actions = model.actions.iter().map(|action| action.name.to_string()).collect();
        models.insert(message.sender, actions);
    }
    announced_models
}
