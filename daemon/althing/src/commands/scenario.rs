//! `althing scenario`: plays a scenario of the paper and says whether the building's truth is
//! what it wants.

use std::process::ExitCode;

use agent::Mode;
use serde_json::json;

use crate::cli::{ScenarioArgs, SubstrateArg};
use crate::scenario::{Event, Played, Script, Stage, play};
use crate::{exit, output};

/// The outcome does not hold.
const DOES_NOT_HOLD: u8 = 1;

/// Plays, prints what happens, and the verdict.
pub(super) fn run(args: &ScenarioArgs) -> ExitCode {
    if args.number != 1 {
        return super::not_built_yet(&format!("scenario {}", args.number));
    }
    let mode = args.mode.map_or(Mode::Decentralized, Mode::from);
    let stage = match args.substrate {
        _ if args.processes => Stage::Processes,
        SubstrateArg::Zenoh => Stage::Zenoh,
        SubstrateArg::Memory => Stage::Memory,
    };
    let script = Script {
        seed: args.seed.unwrap_or(0),
        mode,
        stage,
        replanning: true,
        kills: true,
        guests: None,
    };
    let json = args.print.json;
    super::in_runtime(async move {
        tokio::select! {
            code = perform(script, json) => code,
            // The stage falls with the play, and what was started for it ends.
            signal = super::interrupted() => exit::by_signal(signal),
        }
    })
}

async fn perform(script: Script, json: bool) -> ExitCode {
    if !json {
        let flow = match script.mode {
            Mode::Centralized => "centralized",
            Mode::Decentralized => "decentralized",
        };
        let _ = output::print(
            format_args!("Scenario 1 of the paper, {flow}, building {}\n\n", script.seed),
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
            output::note(&format!("error: {problem}"));
            return exit::with(exit::UNAVAILABLE);
        }
    };
    let code = if played.problems.is_empty() { exit::DONE } else { DOES_NOT_HOLD };
    if json {
        let value = json!({
            "scenario": 1,
            "seed": script.seed,
            "mode": script.mode,
            "holds": played.problems.is_empty(),
            "problems": played.problems,
            "told": played.told,
            "events": events,
        });
        return output::print_json(&value, code);
    }
    verdict(&played, code)
}

fn show(event: &Event) {
    let line = format!("{:>7.3} s  {}", event.at.as_secs_f64(), event.text);
    let _ = output::print(format_args!("{}\n", output::folded(&line, 11)), exit::DONE);
}

fn verdict(played: &Played, code: u8) -> ExitCode {
    let mut text = String::from("\n");
    if played.problems.is_empty() {
        let room = played.scenario.dying_room();
        text.push_str(&format!(
            "The building's own truth agrees: every room was measured, a robot stood in\n\
             {room} after {} died, and what the user was told is true:\n",
            played.scenario.dying_sensor
        ));
    } else {
        text.push_str("The building's own truth does not agree:\n");
        for problem in &played.problems {
            text.push_str(&format!("  - {problem}\n"));
        }
    }
    let told: Vec<_> =
        played.told.iter().map(|(room, celsius)| format!("{room} {celsius:.1} °C")).collect();
    text.push_str(&format!("  {}\n", told.join(", ")));
    output::print(text, code)
}
