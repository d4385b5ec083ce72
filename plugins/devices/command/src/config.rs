//! The `config` of an entry that runs programs: an action model, and the program of each of its
//! actions.

use std::collections::BTreeMap;
use std::time::Duration;

use actuator::{UncertainEffect, check_effect, declared_model, misspelt_placeholder, placeholders};
use agent::{Blueprint, BuildError, config_duration, config_tables};
use pddl::{ActionModel, ActionSchema};
use programs::Program;
use serde::Deserialize;

/// Default, minimum and maximum of the time limit of a program.
const TIME_OUT: Duration = Duration::from_secs(10);
const TIME_OUT_MIN: Duration = Duration::from_millis(1);
const TIME_OUT_MAX: Duration = Duration::from_secs(600);

/// The `config` of an entry that runs programs.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Action model of the agent: `(define (agent NAME) (:domain …) …)`.
    model: String,
    /// The program of each action, by the action's name.
    actions: BTreeMap<String, ActionEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
struct ActionEntry {
    /// The program and its arguments. In each of these words, `{name}` is replaced by the object
    /// that is bound to the action's variable `?name`.
    run: Vec<String>,
    /// Time limit of the program, such as `"30s"`; default is [`TIME_OUT`].
    time_out: Option<String>,
}

config_tables!(ActionEntry);

/// The program of an action, with placeholders for the action's arguments.
#[derive(Debug)]
pub(crate) struct ActionProgram {
    words: Vec<String>,
    /// Variables of the action: the agent's variable, and the action's parameters.
    pub(crate) variables: Vec<String>,
    pub(crate) time_out: Duration,
}

impl ActionProgram {
    /// Returns the program with the arguments of a call filled in; `None` if the entry names no
    /// program.
    pub(crate) fn program(&self, arguments: &BTreeMap<String, String>) -> Option<Program> {
        let filled = |word: &String| {
            let place = |word: String, (name, value): (&String, &String)| {
                word.replace(&format!("{{{name}}}"), value)
            };
            arguments.iter().fold(word.clone(), place)
        };
        Program::of(self.words.iter().map(filled))
    }
}

impl Config {
    /// Returns the action model, and the program of each of its actions. Returns an error if the
    /// model is invalid, or the programs do not match the actions of the model.
    pub(crate) fn parse_actions(
        self,
        blueprint: &Blueprint,
    ) -> Result<(ActionModel, BTreeMap<String, ActionProgram>), BuildError> {
        let wrong = |problem: String| blueprint.problem(problem);
        let model = declared_model(blueprint, &self.model)?;
        let mut runs = BTreeMap::new();
        for (name, action) in self.actions {
            let schema = model.actions.iter().find(|schema| schema.name.as_str() == name);
            let schema = schema.ok_or_else(|| {
                let known: Vec<_> = model.actions.iter().map(|one| one.name.as_str()).collect();
                wrong(format!(
                    "actions.{name}: the model has {}, and no `{name}`",
                    known.join(", ")
                ))
            })?;
            let run = action.parse_action(schema);
            let run = run.map_err(|problem| wrong(format!("actions.{name}: {problem}")))?;
            runs.insert(name, run);
        }
        let is_without = |action: &&ActionSchema| !runs.contains_key(action.name.as_str());
        if let Some(action) = model.actions.iter().find(is_without) {
            let name = &action.name;
            let problem = format!("`{name}` has no program: actions.{name} = {{ run = [\"…\"] }}");
            return Err(wrong(problem));
        }
        Ok((model, runs))
    }
}

impl ActionEntry {
    fn parse_action(self, schema: &ActionSchema) -> Result<ActionProgram, String> {
        let variables = schema.all_parameters();
        let variables: Vec<_> = variables.map(|one| one.name.as_str().to_owned()).collect();
        if self.run.first().is_none_or(String::is_empty) {
            return Err("write run = [\"PROGRAM\", \"ARGUMENT\"]".to_owned());
        }
        self.check_placeholders(&variables)?;
        check_effect(&schema.effect).map_err(advice)?;
        let time_out = match &self.time_out {
            Some(text) => config_duration("time-out", text, TIME_OUT_MIN..=TIME_OUT_MAX)?,
            None => TIME_OUT,
        };
        Ok(ActionProgram { words: self.run, variables, time_out })
    }

    /// Checks that each placeholder is a variable of the action, and that no text is spelled almost
    /// like one.
    fn check_placeholders(&self, variables: &[String]) -> Result<(), String> {
        let is_known = |name: &str| variables.iter().any(|known| known == name);
        let known: Vec<_> = variables.iter().map(|name| format!("{{{name}}}")).collect();
        let known = known.join(", ");
        for word in &self.run {
            for name in placeholders(word).filter(|name| !is_known(name)) {
                match name.split_once('.') {
                    None => return Err(format!("`{{{name}}}` is none of its variables: {known}")),
                    Some((variable, _)) if is_known(variable) => {
                        return Err(format!(
                            "`{{{name}}}`: a program gets the names of objects, and no values: \
                             write `{{{variable}}}`"
                        ));
                    }
                    // A shell has braces with points of its own, such as `{a..z}`.
                    Some(_) => (),
                }
            }
            if let Some(problem) = misspelt_placeholder(word, &known, &is_known) {
                return Err(problem);
            }
        }
        Ok(())
    }
}

/// Returns the error for an effect that the success of the program does not determine.
fn advice(effect: UncertainEffect) -> String {
    match effect {
        UncertainEffect::Number(fluent) => format!(
            "its effect changes {fluent}, which only the program can know: let it print the number, \
             as in (= {fluent} 21.5)"
        ),
        UncertainEffect::Conditional => {
            "its effect has `forall` or `when`: say what is true whenever the program ends well, and \
             let it print the rest"
                .to_owned()
        }
    }
}
