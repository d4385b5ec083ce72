//! The `config` of an entry: an action model, the action or service of ROS for each of its actions,
//! and the topics that tell facts.

use std::collections::BTreeMap;
use std::time::Duration;

use actuator::{UncertainEffect, check_effect, declared_model};
use agent::{Blueprint, BuildError, config_duration, config_tables};
use pddl::{ActionModel, ActionSchema};
use ros_messages::Interfaces;
use ros2_link::{RosAddress, is_ros_name};
use serde::Deserialize;
use serde_json::Value;

use crate::definitions::{DefinitionSource, Definitions};
use crate::fact::{FactContext, FactEntry, FactRule};
use crate::field::{FieldCondition, NamedField};
use crate::request::RequestChecker;
use crate::template::ObjectValues;

/// Default, minimum and maximum of the time limit of an action. Arms and conveyors take less than a
/// minute; a longer job is a job for several actions.
const TIME_OUT: Duration = Duration::from_secs(60);
const TIME_OUT_MIN: Duration = Duration::from_millis(1);
const TIME_OUT_MAX: Duration = Duration::from_secs(3_600);

/// Least and greatest time for which the message of a topic counts. The least is that of the agents'
/// heartbeats, by which facts travel.
const VALID_FOR_MIN: Duration = Duration::from_secs(1);
const VALID_FOR_MAX: Duration = Duration::from_secs(24 * 3_600);

/// Number of topics of one entry, each of which is a subscription.
const TOPICS_MAX: usize = 64;

/// The `config` of an entry.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Where the nodes of ROS are reached.
    ros2: RosAddress,
    /// Definitions of messages, services and actions, beside the built-in ones.
    #[serde(default)]
    definitions: Option<DefinitionSource>,
    /// Action model of the agent: `(define (agent NAME) (:domain …) …)`.
    model: String,
    /// The action or service for each action of the model, by the action's name.
    #[serde(default)]
    actions: BTreeMap<String, RosActionEntry>,
    /// The topics that tell facts.
    #[serde(default)]
    topics: Vec<TopicEntry>,
    /// Values of objects, for templates: `{p.x}`.
    #[serde(default)]
    objects: ObjectValues,
}

#[derive(Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
struct RosActionEntry {
    #[serde(default)]
    ros_action: Option<GoalEntry>,
    #[serde(default)]
    service: Option<ServiceEntry>,
    /// Condition on the result; without it, every result of a goal that was reached is a success.
    #[serde(default)]
    success: Option<String>,
    /// Field of the result with the reason of a failure.
    #[serde(default)]
    reason: Option<String>,
    /// Facts that the result tells.
    #[serde(default)]
    facts: Vec<FactEntry>,
    /// Time limit, such as `"2min"`; default is [`TIME_OUT`].
    #[serde(default)]
    time_out: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(remote = "Self", deny_unknown_fields)]
struct GoalEntry {
    name: String,
    r#type: String,
    #[serde(default)]
    goal: Option<Value>,
}

#[derive(Debug, Deserialize)]
#[serde(remote = "Self", deny_unknown_fields)]
struct ServiceEntry {
    name: String,
    r#type: String,
    #[serde(default)]
    request: Option<Value>,
}

#[derive(Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
struct TopicEntry {
    name: String,
    r#type: String,
    facts: Vec<FactEntry>,
    /// How long a message counts; without it, as long as the link exists.
    #[serde(default)]
    valid_for: Option<String>,
}

config_tables!(RosActionEntry, GoalEntry, ServiceEntry, TopicEntry);

/// A checked entry.
pub(crate) struct Settings {
    pub(crate) address: RosAddress,
    pub(crate) interfaces: Interfaces,
    pub(crate) model: ActionModel,
    pub(crate) objects: ObjectValues,
    /// How each action is carried out, by its name.
    pub(crate) calls: BTreeMap<String, ActionCall>,
    pub(crate) topics: Vec<TopicRule>,
}

/// The goal of an action of ROS, or the request of a service, with placeholders.
struct NodeRequest {
    is_action: bool,
    name: String,
    type_name: String,
    request: Value,
}

/// How ROS is asked to carry out an action.
#[derive(Clone, Debug)]
pub(crate) struct ActionCall {
    /// Whether it is an action of ROS, otherwise a service.
    pub(crate) is_action: bool,
    pub(crate) name: String,
    pub(crate) type_name: String,
    /// The goal or the request, with placeholders.
    pub(crate) request: Value,
    pub(crate) success: Option<FieldCondition>,
    pub(crate) reason: Option<NamedField>,
    pub(crate) facts: Vec<FactRule>,
    pub(crate) time_out: Duration,
    /// Variables of the action: the agent's variable, and the action's parameters.
    pub(crate) variables: Vec<String>,
}

/// A topic that tells facts.
#[derive(Clone, Debug)]
pub(crate) struct TopicRule {
    pub(crate) name: String,
    pub(crate) type_name: String,
    pub(crate) facts: Vec<FactRule>,
    pub(crate) valid_for: Option<Duration>,
}

impl Config {
    /// Checks the entry against its model and the definitions.
    ///
    /// # Errors
    ///
    /// Returns an error that names the first mistake, and what would be right.
    pub(crate) fn parse(self, blueprint: &Blueprint) -> Result<Settings, BuildError> {
        let wrong = |problem: String| blueprint.problem(problem);
        let Config { ros2: address, definitions, model, actions, topics, objects } = self;
        address.check().map_err(|problem| wrong(format!("ros2: {problem}")))?;
        let model = declared_model(blueprint, &model)?;
        let definitions = Definitions::read(blueprint, definitions).map_err(wrong)?;
        let checker = EntryChecker { blueprint, model: &model, definitions, objects };
        let calls = checker.calls(actions).map_err(wrong)?;
        let topics = checker.topics(topics).map_err(wrong)?;
        let EntryChecker { definitions, objects, .. } = checker;
        let interfaces = definitions.interfaces;
        Ok(Settings { address, interfaces, model, objects, calls, topics })
    }
}

impl NodeRequest {
    /// Checks that an entry names either an action of ROS or a service, and the form of its names.
    fn of(
        ros_action: Option<GoalEntry>,
        service: Option<ServiceEntry>,
    ) -> Result<NodeRequest, String> {
        let (key, kind, name, type_name, request) = match (ros_action, service) {
            (Some(GoalEntry { name, r#type, goal }), None) => {
                ("ros-action", "action", name, r#type, goal)
            }
            (None, Some(ServiceEntry { name, r#type, request })) => {
                ("service", "srv", name, r#type, request)
            }
            _ => {
                return Err(
                    "ros-action, or else service: write one of them, such as ros-action = { \
                            name = \"pick\", type = \"arm_msgs/action/Pick\" }"
                        .to_owned(),
                );
            }
        };
        check_names(&name, &type_name, kind).map_err(|why| format!("{key}.{why}"))?;
        let request = request.unwrap_or_else(|| Value::Object(Default::default()));
        Ok(NodeRequest { is_action: kind == "action", name, type_name, request })
    }
}

/// An entry while it is checked.
struct EntryChecker<'a> {
    blueprint: &'a Blueprint,
    model: &'a ActionModel,
    definitions: Definitions,
    objects: ObjectValues,
}

impl EntryChecker<'_> {
    fn calls(
        &self,
        actions: BTreeMap<String, RosActionEntry>,
    ) -> Result<BTreeMap<String, ActionCall>, String> {
        let mut calls = BTreeMap::new();
        for (name, action) in actions {
            let schema = self.model.actions.iter().find(|schema| schema.name.as_str() == name);
            let schema = schema.ok_or_else(|| {
                let known: Vec<_> =
                    self.model.actions.iter().map(|one| one.name.as_str()).collect();
                format!("actions.{name}: the model has {}, and no `{name}`", known.join(", "))
            })?;
            let call = self.call(action, schema);
            calls.insert(name.clone(), call.map_err(|why| format!("actions.{name}.{why}"))?);
        }
        let is_without = |action: &&ActionSchema| !calls.contains_key(action.name.as_str());
        match self.model.actions.iter().find(is_without) {
            Some(ActionSchema { name, .. }) => Err(format!(
                "`{name}` has nothing that carries it out: actions.{name} = {{ ros-action = {{ name \
                 = \"…\", type = \"package/action/Name\", goal = {{ … }} }} }}"
            )),
            None => Ok(calls),
        }
    }

    fn call(&self, entry: RosActionEntry, schema: &ActionSchema) -> Result<ActionCall, String> {
        let RosActionEntry { ros_action, service, success, reason, facts, time_out } = entry;
        check_effect(&schema.effect).map_err(advice)?;
        let NodeRequest { is_action, name, type_name, request } =
            NodeRequest::of(ros_action, service)?;
        let kind = if is_action { "ros-action" } else { "service" };
        self.definitions.check_type(&type_name).map_err(|why| format!("{kind}.type: {why}"))?;
        let (key, asked, told) = match is_action {
            true => ("ros-action.goal", format!("{type_name}_Goal"), format!("{type_name}_Result")),
            false => {
                ("service.request", format!("{type_name}_Request"), format!("{type_name}_Response"))
            }
        };
        let checker = RequestChecker {
            blueprint: self.blueprint,
            model: self.model,
            definitions: &self.definitions,
            objects: &self.objects,
            schema,
        };
        checker.check(&asked, &request).map_err(|why| format!("{key}: {why}"))?;
        let context = self.context(&told, "result", Some(schema));
        let condition = |text: String| context.condition(&text);
        let success = success.map(condition).transpose();
        let success = success.map_err(|why| format!("success: {why}"))?.flatten();
        let field = |text: String| {
            context.field(&text, &Value::from(""), "`reason` names a field with a text (`string`)")
        };
        let reason = reason.map(field).transpose().map_err(|why| format!("reason: {why}"))?;
        let facts = rules(&context, &facts)?;
        let time_out = match &time_out {
            Some(text) => config_duration("time-out", text, TIME_OUT_MIN..=TIME_OUT_MAX)?,
            None => TIME_OUT,
        };
        let variables = crate::fact::variables(schema).into_iter().map(str::to_owned).collect();
        Ok(ActionCall {
            is_action,
            name,
            type_name,
            request,
            success,
            reason,
            facts,
            time_out,
            variables,
        })
    }

    fn topics(&self, entries: Vec<TopicEntry>) -> Result<Vec<TopicRule>, String> {
        if entries.len() > TOPICS_MAX {
            return Err(format!("topics: at most {TOPICS_MAX}, and further ones in another entry"));
        }
        let parse = |entry: TopicEntry| {
            let TopicEntry { name, r#type: type_name, facts, valid_for } = entry;
            let shown = name.clone();
            let parsed = || {
                check_names(&name, &type_name, "msg")?;
                self.definitions.check_type(&type_name).map_err(|why| format!("type: {why}"))?;
                let context = self.context(&type_name, "message", None);
                let facts = rules(&context, &facts)?;
                let validity = VALID_FOR_MIN..=VALID_FOR_MAX;
                let read = |text: String| config_duration("valid-for", &text, validity);
                let valid_for = valid_for.map(read).transpose()?;
                Ok(TopicRule { name, type_name, facts, valid_for })
            };
            parsed().map_err(|why: String| format!("topics, `{shown}`: {why}"))
        };
        entries.into_iter().map(parse).collect()
    }

    fn context<'a>(
        &'a self,
        type_name: &'a str,
        root: &'static str,
        action: Option<&'a ActionSchema>,
    ) -> FactContext<'a> {
        let EntryChecker { blueprint, model, definitions, .. } = self;
        FactContext { blueprint, model, definitions, type_name, root, action }
    }
}

fn rules(context: &FactContext<'_>, entries: &[FactEntry]) -> Result<Vec<FactRule>, String> {
    let rules = entries.iter().map(|entry| context.parse(entry));
    rules.collect::<Result<_, _>>().map_err(|why: String| format!("facts: {why}"))
}

/// Checks the name of an action, service or topic, and the form of its type.
fn check_names(name: &str, type_name: &str, kind: &str) -> Result<(), String> {
    if !is_ros_name(name) {
        return Err(format!(
            "name: `{name}` is no name of ROS: letters, digits, `_` and `/`, and no digit at the \
             beginning or behind a slash, such as `arm/pick`"
        ));
    }
    let is_of_kind = type_name.split('/').nth(1) == Some(kind);
    if !is_of_kind || ros_messages::dds_name(type_name).is_none() {
        let what = match kind {
            "action" => "an action of ROS is such as `arm_msgs/action/Pick`",
            "srv" => "a service is such as `std_srvs/srv/Trigger`",
            _ => "a message is such as `std_msgs/msg/Bool`",
        };
        return Err(format!("type: `{type_name}` is another kind of name: the type of {what}"));
    }
    Ok(())
}

/// Returns the error for an effect that the success of the action does not determine.
fn advice(effect: UncertainEffect) -> String {
    match effect {
        UncertainEffect::Number(fluent) => format!(
            "facts: the effect of the action changes {fluent}, which only ROS can know: take it from \
             the result, as in facts = [\"(= {fluent} {{result.FIELD}})\"]"
        ),
        UncertainEffect::Conditional => {
            "facts: the effect of the action has `forall` or `when`: say what is true whenever it \
             succeeds, and take the rest from the result"
                .to_owned()
        }
    }
}
