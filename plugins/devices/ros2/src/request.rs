//! Checks of the goal or request of an action: its placeholders, fields and values.

use std::collections::BTreeMap;

use actuator::{misspelt_placeholder, placeholders};
use agent::Blueprint;
use pddl::{ActionModel, ActionSchema, Typed, Types};
use serde_json::Value;

use crate::definitions::Definitions;
use crate::fact::variables;
use crate::field::{FieldMistake, check_message};
use crate::template::{ObjectValues, argument_value, filled, texts_in};

/// An action of the model, and everything with which its goal is checked.
pub(crate) struct RequestChecker<'a> {
    pub(crate) blueprint: &'a Blueprint,
    pub(crate) model: &'a ActionModel,
    pub(crate) definitions: &'a Definitions,
    pub(crate) objects: &'a ObjectValues,
    pub(crate) schema: &'a ActionSchema,
}

impl RequestChecker<'_> {
    /// Checks a goal or request of the type `type_name` with each object that its variables may stand
    /// for.
    ///
    /// # Errors
    ///
    /// Returns the first mistake as text for a person.
    pub(crate) fn check(&self, type_name: &str, request: &Value) -> Result<(), String> {
        let used = self.used_placeholders(request)?;
        let candidates: Vec<(&str, Vec<String>)> = { self.schema.all_parameters() }
            .map(|parameter| (parameter.name.as_str(), self.candidates(parameter)))
            .collect();
        let has_value =
            |variable: &str| used.iter().any(|name| name.starts_with(&format!("{variable}.")));
        // An object that nothing declares yet cannot lack its values.
        if candidates.iter().any(|(variable, objects)| objects.is_empty() && has_value(variable)) {
            return Ok(());
        }
        let rounds = candidates.iter().map(|(_, objects)| objects.len()).max().unwrap_or(1).max(1);
        for round in 0..rounds {
            let argument = |(variable, objects): &(&str, Vec<String>)| {
                let object = objects.get(round % objects.len().max(1));
                ((*variable).to_owned(), object.cloned().unwrap_or_else(|| "any".to_owned()))
            };
            let arguments: BTreeMap<_, _> = candidates.iter().map(argument).collect();
            self.check_with(type_name, request, &arguments)?;
        }
        Ok(())
    }

    /// Returns the placeholders of a goal or request. Returns an error about the first that is none of
    /// the variables, and about a text that is spelled almost like a placeholder.
    fn used_placeholders<'v>(&self, request: &'v Value) -> Result<Vec<&'v str>, String> {
        let variables = variables(self.schema);
        let is_known = |name: &str| {
            let mut parts = name.split('.');
            parts.next().is_some_and(|name| variables.contains(&name)) && parts.count() <= 1
        };
        let known: Vec<_> = variables.iter().map(|name| format!("{{{name}}}")).collect();
        let known = known.join(", ");
        let texts = texts_in(request);
        let used: Vec<&'v str> = texts.iter().copied().flat_map(placeholders).collect();
        if let Some(unknown) = used.iter().find(|name| !is_known(name)) {
            return Err(format!("`{{{unknown}}}` is none of its variables: {known}"));
        }
        let mut misspelt =
            texts.iter().filter_map(|text| misspelt_placeholder(text, &known, &is_known));
        misspelt.next().map_or(Ok(used), Err)
    }

    fn check_with(
        &self,
        type_name: &str,
        request: &Value,
        arguments: &BTreeMap<String, String>,
    ) -> Result<(), String> {
        let request = filled(request, &|name| argument_value(name, arguments, self.objects))?;
        match check_message(&self.definitions.interfaces, type_name, &request) {
            Err(FieldMistake::UnknownType(_)) if !self.definitions.is_complete => Ok(()),
            checked => checked.map_err(|mistake| mistake.to_string()),
        }
    }

    /// Returns the objects of the model, the map and the ontology that a variable may stand for. The
    /// variable of the agent stands for the agent, unless several agents act.
    fn candidates(&self, parameter: &Typed) -> Vec<String> {
        let is_agent = self.schema.agent.as_ref().is_some_and(|agent| agent == parameter);
        if is_agent && self.schema.partners.is_empty() {
            return vec![self.blueprint.id.to_string()];
        }
        let (ontology, map) = (&self.blueprint.host.ontology, &self.blueprint.host.map);
        let types = Types::new(ontology.types.iter().chain(&self.model.types));
        let declared = self.model.objects.iter().chain(map.objects.iter());
        let objects = declared.map(|declared| &declared.object).chain(&ontology.constants);
        let fitting = objects.filter(|object| types.accepts(&parameter.ty, &object.ty));
        fitting.map(|object| object.name.as_str().to_owned()).collect()
    }
}
