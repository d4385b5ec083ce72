//! `althing scenario`: plays a scenario of the paper or one of the others, and reports whether the
//! true state of the simulated building meets the requirements of the scenario.

mod recorder_task;

use std::process::ExitCode;

use acl::EcosystemId;
use agent::Mode;
use serde_json::json;
use terminal::{exit, output};

use crate::cli::{ScenarioArgs, SubstrateArg};
use crate::interruption;
use crate::scenario::{
    Scenario, ScenarioEvent, ScenarioOptions, ScenarioResult, ScenarioSubstrate, ScenarioTap, play,
};

use recorder_task::RecorderTask;

/// Exit code if the true state of the building does not meet the requirements of the scenario.
const DOES_NOT_HOLD: u8 = 1;

/// Runs `althing scenario`: plays the scenario, and prints the events and the verdict.
pub(super) fn run(args: &ScenarioArgs) -> ExitCode {
    let mode = args.mode.map_or(Mode::Decentralized, Mode::from);
    let stage = match args.substrate {
        _ if args.processes => ScenarioSubstrate::Processes,
        SubstrateArg::Zenoh => ScenarioSubstrate::Zenoh,
        SubstrateArg::Memory => ScenarioSubstrate::Memory,
    };
    let number = args.number;
    let scenario = match number {
        1 => Scenario::Temperatures,
        2 => Scenario::Maintenance,
        3 => Scenario::Access,
        4 => Scenario::Meeting,
        5 => Scenario::Parcel,
        6 => Scenario::Floors,
        7 => Scenario::Arm,
        _ => Scenario::Table,
    };
    let mut script = ScenarioOptions::new(scenario, args.seed.unwrap_or(0), mode, stage);
    let json = args.print.json;
    super::in_runtime(async move {
        let recorder = match &args.record {
            Some(file) => match RecorderTask::start(file, &ecosystem(number)) {
                Ok((recorder, queue)) => {
                    let listen = move |key: &str, payload| queue.push(key, payload);
                    script.listener = Some(ScenarioTap::new(listen));
                    Some(recorder)
                }
                Err(code) => return code,
            },
            None => None,
        };
        let code = tokio::select! {
            code = perform(number, script, json) => code,
            // Dropping the scenario ends all processes that it has started.
            signal = interruption::interrupted() => exit::by_signal(signal),
            () = interruption::reader_gone() => exit::with(exit::DONE),
        };
        match recorder {
            Some(recorder) => recorder.finish(code).await,
            None => code,
        }
    })
}

/// Returns the name of the ecosystem of a scenario.
fn ecosystem(number: u8) -> EcosystemId {
    EcosystemId::new(&format!("scenario-{number}")).expect("invariant: a word is a name")
}

async fn perform(number: u8, script: ScenarioOptions, json: bool) -> ExitCode {
    if !json {
        let flow = match script.mode {
            Mode::Centralized => "centralized",
            Mode::Decentralized => "decentralized",
        };
        let _ = output::print(
            format_args!("{}, {flow}, building {}\n\n", title(number), script.seed),
            exit::DONE,
        );
    }
    let mut events = Vec::new();
    let played = play(&script, |event| {
        if json {
            events.push(json!({ "at_ms": event.at.as_secs_f64() * 1e3, "event": event.text }));
        } else {
            show(&event);
        }
    })
    .await;
    let played = match played {
        Ok(played) => played,
        Err(problem) => {
            output::print_note(&format!("error: {problem}"));
            return exit::with(exit::UNAVAILABLE);
        }
    };
    let code = if played.problems.is_empty() { exit::DONE } else { DOES_NOT_HOLD };
    if json {
        let value = json!({
            "scenario": number,
            "seed": script.seed,
            "mode": script.mode,
            "holds": played.problems.is_empty(),
            "problems": played.problems,
            "told": played.told,
            "admissions": played.admissions,
            "events": events,
        });
        return output::print_json(&value, code);
    }
    verdict(&played, code)
}

fn title(number: u8) -> String {
    match number {
        4 => "Figure 1 of the paper".to_owned(),
        5 => "A parcel behind closed doors".to_owned(),
        6 => "A parcel that changes the floor".to_owned(),
        7 => "A parcel on a shelf that only an arm reaches".to_owned(),
        8 => "A table for two".to_owned(),
        number => format!("Scenario {number} of the paper"),
    }
}

fn show(event: &ScenarioEvent) {
    let line = format!("{:>7.3} s  {}", event.at.as_secs_f64(), event.text);
    let _ = output::print(format_args!("{}\n", output::folded(&line, 11)), exit::DONE);
}

fn verdict(played: &ScenarioResult, code: u8) -> ExitCode {
    let mut text = String::from("\n");
    if played.problems.is_empty() {
        let end = if played.told.is_empty() { '.' } else { ':' };
        let verdict = format!("The building's own truth agrees: {}{end}", played.verdict);
        text.push_str(&output::folded(&verdict, 0));
        text.push('\n');
    } else {
        text.push_str("The building's own truth does not agree:\n");
        for problem in &played.problems {
            text.push_str(&format!("  - {problem}\n"));
        }
    }
    let told: Vec<_> =
        played.told.iter().map(|(room, celsius)| format!("{room} {celsius:.1} °C")).collect();
    if !told.is_empty() {
        text.push_str(&output::folded(&format!("  {}", told.join(", ")), 2));
        text.push('\n');
    }
    output::print(text, code)
}
