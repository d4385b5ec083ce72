//! An actuator that is any node of ROS 2: its entry has an action model in PDDL, and an action or a
//! service of ROS for each action; topics tell further facts.
//!
//! - `config` checks the entry: model, definitions of types (`definitions`), goals with placeholders
//!   (`template`, `request`), conditions on fields (`field`), facts (`fact`).
//! - `nodes` carries out actions over the link of the crate `ros2-link`, and follows topics.
//! - If an action succeeds, its effect becomes true, and its result tells further facts. If a goal is
//!   rejected, or the node itself reports a failure, nothing has changed. If it is unknown how much was
//!   done, the facts that the action would have changed are unknown.
//! - A fact that a topic tells is unknown while the topic is silent.
//! - While there is no link, the actuator offers no actions.

mod config;
mod definitions;
mod fact;
mod field;
mod nodes;
mod request;
mod template;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    Actuator, AgentFacts, BoxFuture, Description, Device, DeviceEvent, FactFile, MethodCall,
    MethodFailure, MethodResult, OwnFact, stored_facts,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use pddl::{Effect, InitElement};
use serde_json::Value;
use tokio::time::Instant;

use crate::config::{ActionCall, Config, Settings, TopicRule};
use crate::fact::{FactRule, FactState};
use crate::nodes::{NodeState, RosNodes};
use crate::template::{argument_value, filled};

/// Time that a method has in addition to its action's time limit, so that the error of the action is
/// reported in time.
const MARGIN: Duration = Duration::from_secs(1);

/// How long the link is awaited before the first announcement. Nodes that run already answer within
/// milliseconds.
const FIRST_LINK_WITHIN: Duration = Duration::from_secs(2);

/// Least time between two announcements of facts that have changed; each is a message to all agents.
const ANNOUNCED_APART: Duration = Duration::from_millis(200);

/// The entry of the actuator with ROS 2 in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "ros2",
    about: "an actuator that is any node of ROS 2, with an action model of its own",
    drivers: &[],
    has_replicas: false,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, ros_actuator(&blueprint)?)
}

fn ros_actuator(blueprint: &Blueprint) -> Result<RosActuator, BuildError> {
    let config: Config = blueprint.config_as()?;
    let settings = config.parse(blueprint)?;
    let (file, known) = stored_facts(blueprint, &settings.model)?;
    let topics: Vec<_> = settings.topics.iter().map(|topic| topic_facts(&topic.facts)).collect();
    let mut told = BTreeSet::new();
    if let Some(again) = topics.iter().flatten().find(|fact| !told.insert(fact.as_str())) {
        return Err(blueprint.problem(format!("topics: `{again}` is told twice; leave one out")));
    }
    Ok(RosActuator {
        agent: blueprint.id.to_string(),
        settings: Arc::new(settings),
        nodes: OnceLock::new(),
        topics,
        known,
        file,
        announced_at: None,
        announced: Arc::default(),
    })
}

/// Returns the text of each fact of a topic; of a function, the text with its number left out.
fn topic_facts(rules: &[FactRule]) -> Vec<String> {
    let number = FactState::Number(0.0);
    let fact = |rule: &FactRule| rule.element(number, &BTreeMap::new()).map(|fact| key_of(&fact));
    rules.iter().map(|rule| fact(rule).unwrap_or_default()).collect()
}

/// Returns a text that names the fact, whatever its state.
fn key_of(fact: &InitElement) -> String {
    match fact {
        InitElement::Assign(fluent, _) => format!("= {fluent}"),
        InitElement::Not(atom) | InitElement::Unknown(atom) => atom.to_string(),
        other => other.to_string(),
    }
}

struct RosActuator {
    agent: String,
    settings: Arc<Settings>,
    /// The nodes; opened when the agent is activated.
    nodes: OnceLock<Arc<RosNodes>>,
    /// The facts of each topic, as [`key_of`] names them.
    topics: Vec<Vec<String>>,
    /// The facts that actions change. Those that a topic tells are not read from here.
    known: AgentFacts,
    file: FactFile,
    /// When an event was announced last.
    announced_at: Option<Instant>,
    /// What was announced last, after an event or an action. A future that waits for the next event
    /// reads it.
    announced: Arc<Mutex<Option<Outlook>>>,
}

/// The offer and the truths of an actuator; another one is announced at once.
#[derive(PartialEq)]
struct Outlook(bool, Vec<Vec<std::mem::Discriminant<FactState>>>);

fn outlook(state: &NodeState, rules: &[TopicRule]) -> Outlook {
    let topic = |(topic, rule): (&nodes::TopicReport, &TopicRule)| {
        let fact = |index| std::mem::discriminant(&topic.fact(index, rule.valid_for));
        (0..rule.facts.len()).map(fact).collect()
    };
    Outlook(state.is_reached, state.topics.iter().zip(rules).map(topic).collect())
}

impl RosActuator {
    /// Returns the nodes, and begins to open the link at the first call.
    fn nodes(&self) -> Arc<RosNodes> {
        let open = || {
            let nodes = RosNodes::open(&self.agent, &self.settings);
            Arc::new(nodes.expect("invariant: the address was checked when the actuator was built"))
        };
        Arc::clone(self.nodes.get_or_init(open))
    }

    fn is_reached(&self) -> bool {
        self.nodes.get().is_some_and(|nodes| nodes.state.borrow().is_reached)
    }

    fn effect(&self, call: &MethodCall) -> Option<&Effect> {
        let actions = &self.settings.model.actions;
        actions.iter().find(|action| action.name.as_str() == call.method).map(|one| &one.effect)
    }

    /// Returns what the topics tell at present.
    fn told_facts(&self) -> Vec<OwnFact> {
        let topics = self.nodes.get().map(|nodes| nodes.state.borrow().topics.clone());
        let topics = topics.unwrap_or_default();
        let mut facts = Vec::new();
        for (index, rule) in self.settings.topics.iter().enumerate() {
            for (place, fact) in rule.facts.iter().enumerate() {
                let topic = topics.get(index);
                let state = topic.map(|topic| topic.fact(place, rule.valid_for));
                // A function without a number has no element.
                let element = fact.element(state.unwrap_or_default(), &BTreeMap::new());
                facts.extend(element.ok().map(OwnFact::from));
            }
        }
        facts
    }

    /// Makes the topics tell what an action has changed, until their next messages. `observed` are
    /// the facts that the action has made true.
    fn override_topics(&self, observed: &[InitElement], after: &AgentFacts) {
        let Some(nodes) = self.nodes.get() else { return };
        let texts = |facts: &mut dyn Iterator<Item = InitElement>| -> BTreeSet<String> {
            facts.map(|fact| fact.to_string()).collect()
        };
        let observed = texts(&mut observed.iter().cloned());
        let (before, after) = (texts(&mut self.known.facts()), texts(&mut after.facts()));
        nodes.state.send_if_modified(|state| {
            for (topic, facts) in state.topics.iter_mut().zip(&self.topics) {
                for (place, fact) in facts.iter().enumerate() {
                    if observed.contains(fact) {
                        topic.put(place, FactState::True);
                    } else if before.contains(fact) && !after.contains(fact) {
                        topic.put(place, FactState::False);
                    }
                }
            }
            false
        });
    }
}

impl Device for RosActuator {
    type Yield = Value;

    fn describe(&self) -> Description {
        let mut model = self.settings.model.clone();
        if !self.is_reached() {
            model.actions.clear();
        }
        let method = |(action, call): (&String, &ActionCall)| {
            let arguments = call.variables.iter().map(|name| (name.clone(), format!("?{name}")));
            let (method, arguments) = (action.clone(), arguments.collect());
            (action.clone(), Method { method, arguments, timeout: Millis(call.time_out + MARGIN) })
        };
        Description { model, methods: self.settings.calls.iter().map(method).collect() }
    }

    fn action_names(&self) -> Vec<String> {
        self.settings.calls.keys().cloned().collect()
    }

    fn facts(&self) -> Vec<OwnFact> {
        let is_told =
            |fact: &InitElement| self.topics.iter().flatten().any(|own| *own == key_of(fact));
        let own = self.known.facts().filter(|fact| !is_told(fact)).map(OwnFact::from);
        own.chain(self.told_facts()).collect()
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        let nodes = self.nodes();
        Some(Box::pin(async move {
            let mut state = nodes.state.subscribe();
            let reached = state.wait_for(|state| state.is_reached);
            // Without a link, the actuator is announced without actions.
            drop(tokio::time::timeout(FIRST_LINK_WITHIN, reached).await);
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<Value, MethodFailure>> {
        let Some(asked) = self.settings.calls.get(&call.method).cloned() else {
            let unknown = MethodFailure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        let (nodes, settings, call) = (self.nodes(), Arc::clone(&self.settings), call.clone());
        let (file, known) = (self.file.clone(), self.known.clone());
        let effect = self.effect(&call).cloned();
        Box::pin(async move {
            let value_of = |name: &str| argument_value(name, &call.arguments, &settings.objects);
            let request = filled(&asked.request, &value_of).map_err(MethodFailure::Driver)?;
            // If the daemon ends or the action is cancelled meanwhile, the effect is unknown.
            file.write(&known.after_failure(effect.as_ref(), &call, true)).await;
            let result = nodes.run(&asked, &request).await;
            let after = match &result {
                Ok(result) => {
                    let told = told_by(&asked, &call, result);
                    known.after_success(effect.as_ref(), &call, &told).0
                }
                Err(failure) => {
                    known.after_failure(effect.as_ref(), &call, is_end_unknown(failure))
                }
            };
            file.write(&after).await;
            result
        })
    }

    fn on_success(&mut self, call: &MethodCall, result: Value) -> MethodResult {
        let Some(asked) = self.settings.calls.get(&call.method) else {
            return MethodResult::default();
        };
        let told = told_by(asked, call, &result);
        let (known, observations) = self.known.after_success(self.effect(call), call, &told);
        let detail = asked.told(&result).unwrap_or_else(|| format!("{} is done", call.action));
        self.override_topics(&observations, &known);
        self.known = known;
        let told = outlook(&self.nodes().state.borrow(), &self.settings.topics);
        *lock(&self.announced) = Some(told);
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, call: &MethodCall, failure: &MethodFailure) {
        let known = self.known.after_failure(self.effect(call), call, is_end_unknown(failure));
        self.known = known;
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        let (nodes, settings) = (self.nodes(), Arc::clone(&self.settings));
        let calls: Vec<ActionCall> = settings.calls.values().cloned().collect();
        Some(Box::pin(
            async move { nodes.end_all(&calls).await.map_err(|error| error.to_string()) },
        ))
    }

    /// Waits until the nodes are reached or out of reach, or a fact that topics tell has changed or
    /// expired.
    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<RosActuator>>> {
        let (nodes, settings) = (self.nodes(), Arc::clone(&self.settings));
        let earliest = self.announced_at.map(|at| at + ANNOUNCED_APART);
        let announced = Arc::clone(&self.announced);
        let mut changes = nodes.state.subscribe();
        Some(Box::pin(async move {
            if let Some(earliest) = earliest {
                tokio::time::sleep_until(earliest).await;
            }
            let now = loop {
                let state = changes.borrow_and_update().clone();
                let now = outlook(&state, &settings.topics);
                // Not compared with the state at the call: what has changed since the announcement is
                // an event, too.
                if lock(&announced).as_ref() != Some(&now) {
                    break now;
                }
                let topics = state.topics.iter().zip(&settings.topics);
                let expiry = topics.filter_map(|(topic, rule)| topic.expiry(rule.valid_for)).min();
                // The last message may be newer than the expiry that is awaited, so it is looked at
                // again.
                tokio::select! {
                    changed = changes.changed() => {
                        if changed.is_err() {
                            std::future::pending::<()>().await;
                        }
                    }
                    () = until(expiry) => (),
                }
            };
            let event: DeviceEvent<RosActuator> = Box::new(|actuator| {
                actuator.announced_at = Some(Instant::now());
                *lock(&actuator.announced) = Some(now);
                Vec::new()
            });
            event
        }))
    }
}

fn lock(announced: &Mutex<Option<Outlook>>) -> MutexGuard<'_, Option<Outlook>> {
    announced.lock().unwrap_or_else(PoisonError::into_inner)
}

async fn until(instant: Option<Instant>) {
    match instant {
        Some(instant) => tokio::time::sleep_until(instant).await,
        None => std::future::pending().await,
    }
}

/// Returns the facts that a result tells.
fn told_by(asked: &ActionCall, call: &MethodCall, result: &Value) -> Vec<InitElement> {
    let fact = |rule: &FactRule| rule.element(rule.state(result), &call.arguments).ok();
    asked.facts.iter().filter_map(fact).collect()
}

/// Whether it is unknown after a failure how much was done.
fn is_end_unknown(failure: &MethodFailure) -> bool {
    !matches!(
        failure,
        MethodFailure::UnknownMethod(_)
            | MethodFailure::MissingArgument(_)
            | MethodFailure::Driver(_)
    )
}

#[cfg(test)]
mod tests;
