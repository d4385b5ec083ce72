//! Helpers that send requests to an office of the tests, and return the answers.

use std::time::Duration;

use acl::content::{Refusal, Report, Request, value};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use agent::{Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, Mode, Resource};
use building::Layout;
use substrate::ResourceQuery;
use tokio::sync::mpsc;

use crate::scenario::launched::{self, LaunchedScenario, ScenarioSubstrate};
use crate::scenario::temperatures;

/// An agent that sends one request, and forwards the answers up to the final one to the test.
struct Asker {
    to: &'static str,
    protocol: Protocol,
    request: Request,
    tell: mpsc::UnboundedSender<(bool, String)>,
}

impl Agent for Asker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: AgentId::new(self.to).ok(),
            performative: Performative::Request,
            protocol: self.protocol,
            conversation: ConversationId::new("asked"),
            content: value(&self.request),
        };
        ctx.open(opening, Duration::from_secs(30), |asker: &mut Self, answer, _| {
            if let ExchangeEvent::Message(message) = answer {
                let _ = asker.tell.send(words(&message));
            }
        });
    }
}

/// Returns whether a message is the final answer, and its text.
fn words(message: &Message) -> (bool, String) {
    if message.performative == Performative::Confirm {
        let report: Report = message.content_as().expect("a report");
        return (report.outcome.is_final(), format!("{}: {}", report.outcome, report.detail));
    }
    let refusal: Refusal = message.content_as().expect("a refusal");
    (true, format!("{}: {}", message.performative, refusal.detail))
}

/// Sends a request to the Domain Maintainer, from a new agent. Returns the answer.
pub(super) async fn change(set: &LaunchedScenario, who: &str, request: Request) -> String {
    ask(set, who, "domain-maintainer", Protocol::StateChange, request).await.remove(0)
}

/// Sends a request to the agent `to`, from a new agent. Returns all answers up to the final one.
pub(super) async fn ask(
    set: &LaunchedScenario,
    who: &str,
    to: &'static str,
    protocol: Protocol,
    request: Request,
) -> Vec<String> {
    let (tell, mut answers) = mpsc::unbounded_channel();
    let id = AgentId::new(who).expect("a name");
    let asker = Asker { to, protocol, request, tell };
    set.node.launch(id, asker, set.ecosystem.domain.name.as_str());
    let mut told = Vec::new();
    loop {
        let (is_last, text) = answers.recv().await.expect("an answer");
        told.push(text);
        if is_last {
            break;
        }
    }
    // Waits until the consequences have been announced.
    tokio::time::sleep(Duration::from_millis(500)).await;
    told
}

pub(super) async fn read<T: serde::de::DeserializeOwned>(
    set: &LaunchedScenario,
    of: &str,
    resource: Resource,
) -> T {
    let ask = ResourceQuery { daemon: None, resource, agent: AgentId::new(of).ok() };
    let answers = set.node.router().ask(ask, Duration::from_secs(5)).await;
    serde_json::from_slice(answers.first().expect("an answer")).expect("it is one")
}

/// Opens the paper's office. Returns it, and the name of one of its sensors.
pub(super) async fn office(mode: Mode) -> (LaunchedScenario, String) {
    let scenario = Layout::seeded(0);
    let set = launched::launch_scenario(
        &temperatures::setting(&scenario),
        ScenarioSubstrate::Memory,
        mode,
        None,
        None,
    )
    .await
    .expect("a stage");
    tokio::time::sleep(Duration::from_secs(3)).await;
    (set, scenario.dying_sensor)
}
