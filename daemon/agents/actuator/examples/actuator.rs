//! An actuator with an action that the ontology does not know: a coffee machine.
//!
//! `cargo run -p actuator --example actuator`
//!
//! The action model brings a type, two predicates and an action of its own. No other agent has to
//! know them in advance: they become a part of the composite domain when the machine joins. The
//! method has an argument. When the beans are used up, the machine announces a model without the
//! action, so that no plan uses it any more. The example sensor.rs describes how such a device is
//! added to a real ecosystem.

mod office;

use std::error::Error;
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact,
    PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use serde::Deserialize;
use serde_json::json;

use office::{Wish, play};

/// The entry of this plugin in a daemon's table of plugins.
const PLUGIN: PluginEntry = PluginEntry {
    name: "example-coffee-machine",
    about: "makes coffee in the room it stands in",
    drivers: &[],
    has_replicas: false,
    build,
};

/// The `config` of a coffee machine in the ecosystem file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    location: PlaceName,
    /// Number of cups for which there are beans.
    cups: u32,
}

struct CoffeeMachine {
    id: String,
    room: PlaceName,
    cups: u32,
    is_ready: bool,
}

/// Reads the config of the machine and checks it. Opens no hardware, because `althing check` also
/// builds agents.
fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { location, cups } = blueprint.config_as()?;
    let checked = blueprint.host.has_place(location.as_str());
    checked.map_err(|problem| blueprint.problem(problem))?;
    let id = blueprint.id.to_string();
    let device = CoffeeMachine { id, room: location, cups, is_ready: false };
    Actuator::build(&blueprint, device)
}

impl CoffeeMachine {
    /// Checks a request to brew, and returns the time that brewing takes.
    fn brewing_time(&self, call: &MethodCall) -> Result<Duration, MethodFailure> {
        if call.method != "brew" {
            return Err(MethodFailure::UnknownMethod(call.method.clone()));
        }
        let room = call.argument("room")?;
        if room != self.room.as_str() {
            return Err(MethodFailure::Driver(format!("brew in {room}: the machine is elsewhere")));
        }
        Ok(Duration::from_millis(50))
    }
}

impl Device for CoffeeMachine {
    type Yield = ();

    fn describe(&self) -> Description {
        let CoffeeMachine { id, room, cups, .. } = self;
        let action = "(:action make-coffee
               :agent ?m - coffee-machine
               :parameters (?r - room)
               :precondition (stands-in ?m ?r)
               :effect (and (coffee-ready ?r) (increase (total-cost) 3)))";
        let action = if *cups > 0 { action } else { "" };
        let model = model_of(&format!(
            "(define (agent {id}) (:domain smart-office)
               (:types coffee-machine - agent)
               (:predicates (stands-in ?m - coffee-machine ?r - room) (coffee-ready ?r - room))
               (:objects {id} - coffee-machine)
               (:init (stands-in {id} {room}))
               {action})"
        ));
        // The Plan Executor replaces `?r` by the object in the step.
        let method = Method {
            method: "brew".to_owned(),
            arguments: [("room".to_owned(), "?r".to_owned())].into(),
            timeout: Millis(Duration::from_secs(10)),
        };
        Description { model, methods: [("make-coffee".to_owned(), method)].into() }
    }

    /// Returns all facts that the machine answers for: a fact that is missing from the list is
    /// false.
    fn facts(&self) -> Vec<OwnFact> {
        let CoffeeMachine { id, room, is_ready, .. } = self;
        let ready = if *is_ready { format!("(coffee-ready {room})") } else { String::new() };
        facts_of(&format!("(stands-in {id} {room}) {ready}"))
    }

    /// Runs the method that a request names. Dropping the returned future cancels the method, so a
    /// real driver has to stop the machine when the future is dropped.
    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let time = self.brewing_time(call);
        Box::pin(async move {
            tokio::time::sleep(time?).await;
            Ok(())
        })
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        self.cups = self.cups.saturating_sub(1);
        self.is_ready = true;
        MethodResult { detail: format!("coffee at {}", self.room), observations: Vec::new() }
    }
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let wish = Wish {
        goal: "(coffee-ready office1)",
        method: "brew",
        arguments: [("room".to_owned(), "office1".to_owned())].into(),
    };
    play(PLUGIN, "coffee-1", json!({ "location": "office1", "cups": 1 }), wish).await
}
