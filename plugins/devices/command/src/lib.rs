//! An actuator that runs programs: its entry has an action model in PDDL, and a program for each
//! action.
//!
//! - `config` checks the model against the programs.
//! - The crate `programs` runs programs, and ends each one with all processes that it started.
//! - If a program succeeds, the effect of its action becomes true. Lines that the program prints in
//!   parentheses are additional facts, such as `(= (temperature office1) 21.5)` or
//!   `(not (lit office1))`; the last other line is a message to people.
//! - If a program is ended before it has finished, or the daemon ends while it runs, the facts that
//!   its action would have changed are unknown.
//! - The facts are stored (`actuator::FactFile`), so that they outlive the daemon.
//! - After a failure the actuator offers no actions for a while, so that plans are made without it.

mod config;

use std::collections::BTreeMap;
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    Actuator, AgentFacts, BoxFuture, Description, Device, DeviceEvent, FactFile, MethodCall,
    MethodFailure, MethodResult, OwnFact, stored_facts,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use pddl::{ActionModel, ActionSchema, InitElement};
use programs::ProgramError;
use tokio::time::Instant;

use crate::config::{ActionProgram, Config};

/// Pause after a failure, during which an actuator offers no actions.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// Time that a method has in addition to its program's time limit, so that the program's error is
/// reported in time.
const MARGIN: Duration = Duration::from_secs(1);

/// Maximum number of characters of a program's output that are quoted.
const QUOTED_CHARS: usize = 160;

/// The entry of the actuator that runs programs in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "command",
    about: "an actuator that is any program, with an action model of its own",
    drivers: &[],
    has_replicas: false,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, commanded(&blueprint)?)
}

fn commanded(blueprint: &Blueprint) -> Result<CommandActuator, BuildError> {
    let config: Config = blueprint.config_as()?;
    let (model, runs) = config.parse_actions(blueprint)?;
    let (file, known) = stored_facts(blueprint, &model)?;
    Ok(CommandActuator { model, runs, known, file, paused_until: None })
}

struct CommandActuator {
    model: ActionModel,
    /// Program of each action, by the name of the action.
    runs: BTreeMap<String, ActionProgram>,
    known: AgentFacts,
    file: FactFile,
    paused_until: Option<Instant>,
}

impl CommandActuator {
    fn action_of(&self, call: &MethodCall) -> Option<&ActionSchema> {
        self.model.actions.iter().find(|action| action.name.as_str() == call.method)
    }
}

impl Device for CommandActuator {
    type Yield = String;

    fn describe(&self) -> Description {
        let mut model = self.model.clone();
        if self.paused_until.is_some_and(|until| until > Instant::now()) {
            model.actions.clear();
        }
        let method = |(action, run): (&String, &ActionProgram)| {
            let arguments = run.variables.iter().map(|name| (name.clone(), format!("?{name}")));
            let (method, arguments) = (action.clone(), arguments.collect());
            (action.clone(), Method { method, arguments, timeout: Millis(run.time_out + MARGIN) })
        };
        Description { model, methods: self.runs.iter().map(method).collect() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        self.known.facts().map(OwnFact::from).collect()
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<String, MethodFailure>> {
        let Some(run) = self.runs.get(&call.method) else {
            let unknown = MethodFailure::UnknownMethod(call.method.clone());
            return Box::pin(std::future::ready(Err(unknown)));
        };
        let (program, time_out) = (run.program(&call.arguments), run.time_out);
        let (call, file) = (call.clone(), self.file.clone());
        let effect = self.action_of(&call).map(|action| action.effect.clone());
        let known = self.known.clone();
        Box::pin(async move {
            let program = program.ok_or_else(|| MethodFailure::Driver("run nothing".to_owned()))?;
            // If the daemon ends or the action is cancelled while the program runs, the effect is
            // unknown.
            file.write(&known.after_failure(effect.as_ref(), &call, true)).await;
            let printed = program.run(time_out).await.map_err(|error| match error {
                ProgramError::TimedOut { within, .. } => MethodFailure::TimedOut(within),
                cut if cut.is_cut_short() => MethodFailure::Interrupted(cut.to_string()),
                other => MethodFailure::Driver(other.to_string()),
            });
            let after = match &printed {
                Ok(printed) => known.after_success(effect.as_ref(), &call, &read(printed).0).0,
                Err(failure) => {
                    known.after_failure(effect.as_ref(), &call, is_end_unknown(failure))
                }
            };
            file.write(&after).await;
            printed
        })
    }

    fn on_success(&mut self, call: &MethodCall, printed: String) -> MethodResult {
        let (facts, told) = read(&printed);
        let effect = self.action_of(call).map(|action| &action.effect);
        let (known, observations) = self.known.after_success(effect, call, &facts);
        self.known = known;
        let detail = told.unwrap_or_else(|| format!("{} is done", call.action));
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, call: &MethodCall, failure: &MethodFailure) {
        let effect = self.action_of(call).map(|action| &action.effect);
        self.known = self.known.after_failure(effect, call, is_end_unknown(failure));
        if *failure != MethodFailure::GivenUp {
            self.paused_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }

    /// Waits for the end of the pause after a failure; then the actions are offered and announced
    /// again.
    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<CommandActuator>>> {
        let until = self.paused_until;
        Some(Box::pin(async move {
            match until {
                Some(until) => tokio::time::sleep_until(until).await,
                None => std::future::pending().await,
            }
            let stir: DeviceEvent<CommandActuator> = Box::new(|commanded| {
                commanded.paused_until = None;
                Vec::new()
            });
            stir
        }))
    }
}

/// Whether it is unknown after a failure how much the program has done. A program that ended by
/// itself and reported a failure counts as having changed nothing.
fn is_end_unknown(failure: &MethodFailure) -> bool {
    !matches!(
        failure,
        MethodFailure::UnknownMethod(_)
            | MethodFailure::MissingArgument(_)
            | MethodFailure::Driver(_)
    )
}

/// Returns the facts in the output of a program, and the last other line of the output as a message
/// to people. A line in parentheses that is not a valid fact counts as a message.
fn read(printed: &str) -> (Vec<InitElement>, Option<String>) {
    let (mut facts, mut told) = (Vec::new(), None);
    for line in printed.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let parsed = pddl::parse_init_elements(line);
        let is_sayable = |fact: &InitElement| !matches!(fact, InitElement::At(..));
        match parsed.value.filter(|_| line.starts_with('(') && parsed.diagnostics.is_empty()) {
            Some(found) if found.iter().all(is_sayable) => facts.extend(found),
            _ => told = Some(line.chars().take(QUOTED_CHARS).collect()),
        }
    }
    (facts, told)
}

#[cfg(test)]
mod tests;
