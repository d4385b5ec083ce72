//! Tests of the screen: its config, and its drivers with real programs, by the pixels of a display.

mod chromecast;
mod configs;
mod real_browser;
mod real_mpv;
mod restarts;
mod stage;
mod television;

#[path = "../../../../tests/support/left_out.rs"]
mod left_out;

#[path = "../../../../tests/support/cast_device.rs"]
mod cast_device;

use actuator::{Device as _, MethodCall};
use agent::{Host, Resources};
use serde_json::Value;

use super::*;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

fn blueprint(driver: &str, config: Value, resources: Resources) -> Blueprint {
    let map = "(define (problem map) (:domain smart-office) (:init) (:goal (and)))";
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let host = Host::new(ontology, pddl::parse_problem(map).value.expect("a map"));
    let host = Host { resources, ..host };
    let id = acl::AgentId::new("s").expect("a name");
    Blueprint { id, driver: driver.to_owned(), config: config.into(), host: Arc::new(host) }
}

/// Calls a method of the screen, as the actuator does. Returns the detail, or the reason of the
/// failure.
async fn call(screen: &mut Screen, method: &str, medium: Option<&str>) -> Result<String, String> {
    let arguments = medium.map(|medium| ("media".to_owned(), medium.to_owned()));
    let call = MethodCall {
        action: method.to_owned(),
        method: method.to_owned(),
        arguments: arguments.into_iter().collect(),
    };
    match screen.perform(&call).await {
        Ok(done) => Ok(screen.on_success(&call, done).detail),
        Err(failure) => {
            screen.on_failure(&call, &failure);
            Err(failure.to_string())
        }
    }
}

/// Handles events of the screen until its facts contain `wanted`. If `wanted` begins with `!`,
/// until they do not contain the rest of it.
async fn until(screen: &mut Screen, wanted: &str) {
    const PATIENCE: Duration = Duration::from_secs(60);
    let (is_wanted, fact) = match wanted.strip_prefix('!') {
        Some(fact) => (false, fact),
        None => (true, wanted),
    };
    let waiting = async {
        while text_of(screen).contains(fact) != is_wanted {
            let event = screen.next_event().expect("a screen has events").await;
            event(screen);
        }
    };
    let done = tokio::time::timeout(PATIENCE, waiting).await;
    assert!(done.is_ok(), "{wanted} is not so: {}", text_of(screen));
}

/// Returns the facts and the actions of the screen.
fn text_of(screen: &Screen) -> String {
    let facts: Vec<_> = screen.facts().iter().map(|fact| fact.fact.to_string()).collect();
    let actions = screen.describe().model.actions;
    let actions: Vec<_> = actions.iter().map(|action| format!("offers {}", action.name)).collect();
    format!("{} {}", facts.join(" "), actions.join(" "))
}

/// Waits until the screen works, and has it set up.
async fn set_up(screen: &mut Screen) {
    until(screen, "offers set-up").await;
    assert_eq!(call(screen, "allocate", None).await.as_deref(), Ok("set up on channel 1"));
    assert!(text_of(screen).contains("(can-present lab)"));
}
