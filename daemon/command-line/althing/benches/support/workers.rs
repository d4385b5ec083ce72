//! Daemons with many actuators that only send heartbeats, each daemon in a process of its own.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{Method, Methods};
use acl::{AgentId, Millis};
use actuator::{
    Actuator, BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact,
};
use agent::{Blueprint, Host, LaunchError, MessageRouter, Mode};
use pddl::InitElement;
use tokio::process::Child;
use tokio::task::JoinHandle;

use super::{Entry, Outcome, PATIENCE};

/// Name of the ecosystem of the workers.
pub(crate) const ECOSYSTEM: &str = "crowd";

/// Number of places, and so the maximum number of actuators: one per place.
const PLACES: usize = 1_000;

const DOMAIN: &str = "(define (domain crowd)
    (:requirements :strips :typing :action-costs)
    (:types worker place)
    (:predicates (located ?w - worker ?p - place) (known ?p - place))
    (:functions (total-cost)))";

/// Starts a number of daemons, each with a number of actuators; the first also hosts the Domain
/// Maintainer. Each connects to those before it, as `althing up` does on one machine.
pub(crate) async fn start(folder: &Path, daemons: usize, each: usize) -> Outcome<Vec<Child>> {
    let path = folder.display().to_string();
    let mut children = Vec::new();
    for number in 0..daemons {
        let arguments = ["--daemon", &path, &number.to_string(), &each.to_string()];
        children.push(super::again(&arguments)?);
        let socket = folder.join(format!("{}.sock", name(number)));
        let deadline = Instant::now() + PATIENCE;
        while !socket.exists() {
            if Instant::now() > deadline {
                return Err(format!("{} does not listen", socket.display()).into());
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
    Ok(children)
}

/// Runs a daemon of the crowd if [`start`] started this process for that; returns at once
/// otherwise.
pub(crate) async fn be_one() -> Outcome<()> {
    let arguments: Vec<_> = std::env::args().collect();
    match arguments.as_slice() {
        [_, flag, folder, number, agents] if flag == "--daemon" => {
            live(Path::new(folder), number.parse()?, agents.parse()?).await
        }
        _ => Ok(()),
    }
}

/// Returns the name of a daemon.
pub(crate) fn name(number: usize) -> String {
    format!("daemon-{number}")
}

/// Returns the name of an actuator.
pub(crate) fn agent_name(number: usize) -> String {
    format!("worker-{number}")
}

/// Returns the context in which the actuators are built.
pub(crate) fn host() -> Outcome<Host> {
    let places: Vec<_> = (0..PLACES).map(|place| format!("place-{place}")).collect();
    let map = format!(
        "(define (problem map) (:domain crowd) (:objects {} - place) (:init) (:goal (and)))",
        places.join(" ")
    );
    super::host(DOMAIN, &map, Mode::Decentralized)
}

/// Runs a daemon with its agents until it is killed.
async fn live(folder: &Path, number: usize, agents: usize) -> Outcome<()> {
    let others: Vec<_> = (0..number).map(name).collect();
    let router = super::daemon(folder, ECOSYSTEM, &name(number), &others).await?;
    let host = Arc::new(host()?);
    if number == 0 {
        let entry = Entry {
            name: AgentId::new("domain-maintainer")?,
            plugin: String::new(),
            daemon: name(0),
            config: serde_json::Value::Null,
        };
        let maintainer = super::build(&domain_maintainer::PLUGIN, &entry, &host)?;
        super::launch(&entry.name, maintainer, &router, ECOSYSTEM);
    }
    for agent in number * agents..(number + 1) * agents {
        let id = AgentId::new(&agent_name(agent))?;
        launch(&id, agent, &host, &router)?;
    }
    std::future::pending().await
}

/// Launches one more actuator, in a daemon of this process.
pub(crate) fn launch(
    id: &AgentId,
    place: usize,
    host: &Arc<Host>,
    router: &Arc<MessageRouter>,
) -> Outcome<JoinHandle<Result<(), LaunchError>>> {
    let blueprint = Blueprint {
        id: id.clone(),
        driver: String::new(),
        config: Arc::default(),
        host: Arc::clone(host),
    };
    let worker = Actuator::build(&blueprint, Worker { id: id.clone(), place })?;
    Ok(super::launch(id, worker, router, ECOSYSTEM))
}

/// A sensor of the crowd, with the place at which it measures.
struct Worker {
    id: AgentId,
    place: usize,
}

impl Device for Worker {
    type Yield = ();

    fn describe(&self) -> Description {
        let Worker { id, place } = self;
        let text = format!(
            "(define (agent {id}) (:domain crowd) (:objects {id} - worker)
                (:init (located {id} place-{place}))
                (:action look :agent ?w - worker :parameters (?p - place)
                    :precondition (located ?w ?p)
                    :effect (and (known ?p) (increase (total-cost) 1))))"
        );
        let model = pddl::parse_action_model(&text).into_result().expect("invariant: it is ours");
        let method = Method {
            method: "look".to_owned(),
            arguments: Default::default(),
            timeout: Millis(Duration::from_secs(1)),
        };
        Description { model, methods: Methods::from([("look".to_owned(), method)]) }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let fact = format!("(located {} place-{})", self.id, self.place);
        let fact: InitElement =
            pddl::parse_init_element(&fact).into_result().expect("invariant: it is ours");
        vec![fact.into()]
    }

    fn perform(&mut self, _call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        Box::pin(std::future::ready(Ok(())))
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        MethodResult { detail: "looked".to_owned(), observations: Vec::new() }
    }
}
