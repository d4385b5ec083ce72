//! Facts that a message tells: templates of PDDL, each perhaps with a condition on the message.
//!
//! - A fact with a condition is true if the condition holds, and false if it does not.
//! - A number comes from a field: `(= (weight {p}) {result.weight})`. With a condition that does not
//!   hold, it is unknown.
//! - If the message lacks the field, or the number is impossible, the fact is unknown.

use std::collections::BTreeMap;

use actuator::{is_possible_value, misspelt_placeholder, placeholders};
use agent::Blueprint;
use pddl::{ActionModel, ActionSchema, Diagnostic, InitElement, Name, ObjectDeclaration, Typed};
use serde::Deserialize;
use serde_json::Value;

use crate::definitions::Definitions;
use crate::field::{FieldCondition, FieldMistake, NamedField};

/// A fact in the config.
#[derive(Clone, Debug, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "each of `facts` is a text, or { fact = \"(…)\", when = \"…\" }"
)]
pub(crate) enum FactEntry {
    /// A fact that each message tells.
    Always(String),
    /// A fact that is true if the condition holds, otherwise false.
    When { fact: String, when: String },
}

/// A fact that messages tell.
#[derive(Clone, Debug)]
pub(crate) struct FactRule {
    /// The fact in PDDL, with placeholders.
    template: String,
    when: Option<FieldCondition>,
    /// The field with the number of the fact, with its placeholder; `None` for an atom.
    number: Option<(String, NamedField)>,
}

/// How one message leaves a fact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum FactState {
    /// The fact is true.
    True,
    /// The fact is false.
    False,
    /// The function has this value.
    Number(f64),
    /// The message does not tell it, or there was none.
    #[default]
    Unknown,
}

/// The facts of one kind of message, while an entry is checked.
pub(crate) struct FactContext<'a> {
    pub(crate) blueprint: &'a Blueprint,
    pub(crate) model: &'a ActionModel,
    pub(crate) definitions: &'a Definitions,
    /// The type of the message, and its name in templates.
    pub(crate) type_name: &'a str,
    pub(crate) root: &'static str,
    /// The action that ends with the message; `None` for a topic.
    pub(crate) action: Option<&'a ActionSchema>,
}

impl FactContext<'_> {
    /// Checks a fact of the config.
    ///
    /// # Errors
    ///
    /// Returns the mistake as text for a person.
    pub(crate) fn parse(&self, entry: &FactEntry) -> Result<FactRule, String> {
        let (template, when) = match entry {
            FactEntry::Always(fact) => (fact, None),
            FactEntry::When { fact, when } => (fact, Some(when)),
        };
        let wrong = |problem: String| format!("`{template}`: {problem}");
        let when = when.map(|when| self.condition(when)).transpose()?.flatten();
        let number = self.number(template).map_err(wrong)?;
        let rule = FactRule { template: template.clone(), when, number };
        self.check_fact(&rule).map_err(wrong)?;
        Ok(rule)
    }

    /// Checks a condition. Returns `None` if the definition of the type is on another machine.
    pub(crate) fn condition(&self, text: &str) -> Result<Option<FieldCondition>, String> {
        let interfaces = &self.definitions.interfaces;
        let parsed = FieldCondition::parse(text, self.root, interfaces, self.type_name);
        self.tolerated(parsed)
    }

    /// Checks a field that takes `value`, perhaps of a definition on another machine. `kind` says which
    /// fields are right, for a field that takes other values.
    pub(crate) fn field(
        &self,
        text: &str,
        value: &Value,
        kind: &str,
    ) -> Result<NamedField, String> {
        let field = NamedField::parse(text, self.root)?;
        let checked = field.check(&self.definitions.interfaces, self.type_name, value);
        if let Err(FieldMistake::WrongValue { .. }) = &checked {
            return Err(format!("`{field}` has another type: {kind}"));
        }
        self.tolerated(checked)?;
        Ok(field)
    }

    fn tolerated<T>(&self, checked: Result<T, FieldMistake>) -> Result<Option<T>, String> {
        match checked {
            Ok(checked) => Ok(Some(checked)),
            Err(FieldMistake::UnknownType(_)) if !self.definitions.is_complete => Ok(None),
            Err(mistake) => Err(mistake.to_string()),
        }
    }

    /// Returns the field with the number of a fact, after checking all placeholders of the fact.
    fn number(&self, template: &str) -> Result<Option<(String, NamedField)>, String> {
        let variables: Vec<&str> = self.action.map(variables).unwrap_or_default();
        let is_variable = |name: &str| variables.contains(&name);
        let is_field = |name: &str| name.starts_with(&format!("{}.", self.root));
        let mut known: Vec<_> = variables.iter().map(|name| format!("{{{name}}}")).collect();
        known.push(format!("{{{}.FIELD}}", self.root));
        let known = known.join(", ");
        let mut number = None;
        for placeholder in placeholders(template).filter(|name| !is_variable(name)) {
            if !is_field(placeholder) {
                return Err(format!("`{{{placeholder}}}` is none of its placeholders: {known}"));
            }
            let kind = "a fact takes numbers, `when` compares other values";
            let field = self.field(placeholder, &Value::from(0), kind)?;
            if number.replace((format!("{{{placeholder}}}"), field)).is_some() {
                return Err("a fact takes one number".to_owned());
            }
        }
        let is_known = |name: &str| is_variable(name) || is_field(name);
        misspelt_placeholder(template, &known, &is_known).map_or(Ok(number), Err)
    }

    /// Checks that a fact is one of the ecosystem's: its predicate or function, and its objects.
    fn check_fact(&self, rule: &FactRule) -> Result<(), String> {
        // Each variable stands for an object of its type.
        let sample = |name: &str| format!("any-{name}");
        let names = self.action.map(variables).unwrap_or_default();
        let samples = names.iter().map(|name| ((*name).to_owned(), sample(name))).collect();
        let fact = rule.element(FactState::Number(1.0), &samples)?;
        let parameters = self.action.into_iter().flat_map(ActionSchema::all_parameters);
        let object = |typed: &Typed| ObjectDeclaration {
            object: Typed { name: Name::new(&sample(typed.name.as_str())), ty: typed.ty.clone() },
            privacy: pddl::Privacy::Public,
        };
        let mut model = self.model.clone();
        model.actions.clear();
        model.objects.extend(parameters.map(object));
        model.init = vec![fact];
        let found = pddl::check_action_model(&self.blueprint.host.ontology, &model);
        let problem = match found.into_iter().find(Diagnostic::is_error) {
            Some(Diagnostic { message, help: Some(help), .. }) => format!("{message}; {help}"),
            Some(mistake) => mistake.message,
            None => return Ok(()),
        };
        // The author has written placeholders, and no samples.
        let written =
            |text: String, name: &&str| text.replace(&sample(name), &format!("{{{name}}}"));
        let mut names = self.action.map(variables).unwrap_or_default();
        names.sort_by_key(|name| std::cmp::Reverse(name.len()));
        Err(names.iter().fold(problem, written))
    }
}

/// Returns the shortest number that is the same in 32 bits, if the number has no more: most fields
/// have 32 bits, and 0.35 is to be 0.35 in a fact, not 0.349999994.
fn shortest(number: f64) -> f64 {
    let narrow = number as f32;
    let is_narrow = f64::from(narrow) == number;
    let short = is_narrow.then(|| narrow.to_string().parse().ok()).flatten();
    short.unwrap_or(number)
}

/// Returns the names of the variables of an action, that of the agent first.
pub(crate) fn variables(action: &ActionSchema) -> Vec<&str> {
    action.all_parameters().map(|parameter| parameter.name.as_str()).collect()
}

impl FactRule {
    /// Returns how a message leaves the fact.
    pub(crate) fn state(&self, message: &Value) -> FactState {
        match self.when.as_ref().map(|when| when.holds(message)) {
            Some(None) => return FactState::Unknown,
            Some(Some(false)) => return FactState::False,
            Some(Some(true)) | None => (),
        }
        let Some((_, field)) = &self.number else { return FactState::True };
        let number = field.value(message).and_then(Value::as_f64);
        let number = number.map(shortest).filter(|number| is_possible_value(*number, ""));
        number.map_or(FactState::Unknown, FactState::Number)
    }

    /// Returns the element of `:init` for a state of the fact. An atom that a state without a number
    /// leaves is true, false or unknown; a function without a number has no element.
    ///
    /// # Errors
    ///
    /// Returns an error if the fact is not valid, or if the function has no value.
    pub(crate) fn element(
        &self,
        state: FactState,
        arguments: &BTreeMap<String, String>,
    ) -> Result<InitElement, String> {
        let mut text = self.template.clone();
        for (name, value) in arguments {
            text = text.replace(&format!("{{{name}}}"), value);
        }
        if let Some((placeholder, _)) = &self.number {
            let FactState::Number(number) = state else {
                return Err("the function has no value".to_owned());
            };
            text = text.replace(placeholder, &number.to_string());
        }
        let parsed = pddl::parse_init_element(&text).into_result();
        let element = parsed.map_err(|found| {
            found.first().map(|first| first.message.clone()).unwrap_or_default()
        })?;
        match (element, state) {
            (InitElement::Atom(atom), FactState::False) => Ok(InitElement::Not(atom)),
            (InitElement::Atom(atom), FactState::Unknown) => Ok(InitElement::Unknown(atom)),
            (InitElement::Assign(..), FactState::False | FactState::Unknown) => {
                Err("the function has no value".to_owned())
            }
            (element @ (InitElement::Atom(_) | InitElement::Assign(..)), _) => Ok(element),
            _ => Err("write a fact such as (held cup-1) or (= (weight cup-1) {…})".to_owned()),
        }
    }
}
