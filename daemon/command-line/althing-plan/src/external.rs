//! `althing plan --engine …`: plans with a planner outside of this process.
//!
//! - Ctrl-C cancels: the external engine ends without leaving processes or files behind, and the
//!   exit code is that of the signal.
//! - On a terminal, a line is printed from time to time while the engine runs.
//! - The cost of a plan is computed by Althing's own validator; the cost that the engine prints is
//!   never used.

use std::process::ExitCode;
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use engines::{
    Ending, EngineError, EngineOptions, EngineOutcome, ExternalEngine, Installation, PlanningAim,
};
use pddl::{Diagnostic, Span};
use planner::{Cancel, InputText};
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use terminal::pddl_files::{self, PddlTask};
use terminal::render::number;
use terminal::{exit, output};

use crate::arguments::PlanArgs;
use crate::progress::ProgressPrinter;

/// Exit code if the engine failed or returned an invalid plan; Fast Downward's “critical error”.
const BROKE_DOWN: u8 = 32;

/// Plans with an external engine. Shows the plan, or the reason why there is none.
pub(crate) fn run(
    args: &PlanArgs,
    engine: ExternalEngine,
    task: &PddlTask,
    started: Instant,
) -> ExitCode {
    let installation = match Installation::find(engine) {
        Ok(installation) => installation,
        Err(err) => return show_error(args, task, &err),
    };
    let mut options = EngineOptions {
        time_limit: args.time_limit.map(|limit| limit.saturating_sub(started.elapsed())),
        ..EngineOptions::default()
    };
    if let Some(mebibytes) = args.memory_limit {
        options.memory_limit = Some(u64::from(mebibytes) << 20);
    }
    if args.optimal {
        options.aim = PlanningAim::CheapestPlan;
    }
    let cancel = Cancel::new();
    let interrupted = on_interrupt(cancel.clone());
    let telling = ProgressPrinter::start(args, started, move |seconds| {
        format!("{engine} has been running for {seconds} s")
    });
    let outcome = engines::plan(&installation, &task.domain, &task.problem, &options, &cancel);
    drop(telling);
    match outcome {
        Ok(outcome) if outcome.ending == Ending::Cancelled => {
            show(args, engine, task, &outcome, started.elapsed());
            exit::by_signal(interrupted.get().copied().unwrap_or(SIGINT))
        }
        Ok(outcome) => show(args, engine, task, &outcome, started.elapsed()),
        Err(err) => show_error(args, task, &err),
    }
}

/// Sets `cancel` at SIGINT or SIGTERM. Returns a cell that receives the number of the first signal.
fn on_interrupt(cancel: Cancel) -> Arc<OnceLock<i32>> {
    let interrupted = Arc::new(OnceLock::new());
    let tell = Arc::clone(&interrupted);
    // If no handler can be installed, a signal ends this process, and the engine with it.
    if let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) {
        thread::spawn(move || {
            for signal in signals.forever() {
                // Only the first signal is stored.
                let _ = tell.set(signal);
                cancel.set();
            }
        });
    }
    interrupted
}

fn show(
    args: &PlanArgs,
    engine: ExternalEngine,
    task: &PddlTask,
    outcome: &EngineOutcome,
    elapsed: Duration,
) -> ExitCode {
    let mut report = task.report.clone();
    let is_unproven = args.optimal && outcome.plan.is_some() && !outcome.proven_optimal;
    let code = match outcome.ending.exit_code().unwrap_or(exit::DONE) {
        exit::DONE if is_unproven => exit::UNPROVEN,
        code => code,
    };
    let unit_cost = task.problem.metric.is_none();
    let text = outcome.plan.as_ref().map(|plan| crate::ipc(plan, unit_cost));
    if let Some(refused) = crate::write_plan(args, text.as_deref(), &mut report) {
        return refused;
    }
    let seconds = elapsed.as_secs_f64();
    if args.print.json {
        let plan = outcome.plan.as_ref();
        let steps = plan.map(|plan| plan.steps.iter().map(ToString::to_string));
        let value = json!({
            "status": status(outcome.ending),
            "reason": ending_text(outcome.ending, args),
            "engine": args.engine.name(),
            "plan": steps.map(Iterator::collect::<Vec<String>>),
            "cost": plan.map(|plan| number(crate::cost(plan))),
            "cost_kind": plan.map(|_| crate::cost_kind(unit_cost)),
            "statistics": { "proven_optimal": outcome.proven_optimal, "seconds": seconds },
            "diagnostics": terminal::render::json(&report),
        });
        return output::print_json(&value, code);
    }
    output::show_to_person(&report);
    let first = match &outcome.plan {
        Some(plan) => {
            let found = crate::plan_summary(plan, unit_cost, outcome.proven_optimal);
            found + if is_unproven { "; not proven to be the cheapest" } else { "" }
        }
        None => format!("no plan: {}", ending_text(outcome.ending, args)),
    };
    output::print_note(&format!("{first}\n{engine} ended after {seconds:.3} s"));
    match text {
        Some(text) if args.plan.is_none() => output::print(text, code),
        _ => exit::with(code),
    }
}

fn ending_text(ending: Ending, args: &PlanArgs) -> String {
    match ending {
        Ending::OutOfTime if args.time_limit.is_some() => "out of time (--time-limit)".to_owned(),
        Ending::OutOfMemory => "out of memory (--memory-limit)".to_owned(),
        other => other.to_string(),
    }
}

/// Returns the status of a run for the JSON output. Programs may rely on these words.
fn status(ending: Ending) -> &'static str {
    match ending {
        Ending::GoalReached => "plan-found",
        Ending::Unsolvable { .. } => "unsolvable",
        Ending::Exhausted => "no-plan",
        Ending::OutOfMemory => "out-of-memory",
        Ending::OutOfTime => "out-of-time",
        Ending::Cancelled => "cancelled",
    }
}

fn show_error(args: &PlanArgs, task: &PddlTask, err: &EngineError) -> ExitCode {
    let mut report = task.report.clone();
    let mut diagnostic = match err {
        EngineError::BadInput(mistakes) => {
            report.add(pddl_files::likely_faulty_text(task), mistakes.iter().cloned());
            return output::show(&report, args.print.json, "bad-input", exit::BAD_INPUT);
        }
        EngineError::Unsupported { engine, unsupported } => {
            let message = format!("{engine} does not support {}", unsupported.feature);
            Diagnostic::error(unsupported.span, message)
        }
        other => Diagnostic::error(Span::default(), format!("failed to {}", full(other))),
    };
    diagnostic.help = err.help();
    match err {
        EngineError::Unsupported { unsupported, .. } if unsupported.text == InputText::Domain => {
            report.add(&task.domain_source, [diagnostic]);
        }
        EngineError::Unsupported { .. } => report.add(&task.problem_source, [diagnostic]),
        _ => report.add_general(diagnostic),
    }
    let (status, code) = match err {
        EngineError::Unsupported { .. } | EngineError::Beyond { .. } => {
            ("unsupported", exit::UNSUPPORTED)
        }
        EngineError::NotFound { .. } => ("unavailable", exit::UNAVAILABLE),
        _ => ("engine-failed", BROKE_DOWN),
    };
    output::show(&report, args.print.json, status, code)
}

/// Returns the text of an error, followed by the text of the error that caused it.
fn full(err: &EngineError) -> String {
    let behind = std::error::Error::source(err).map(|source| format!(": {source}"));
    format!("{err}{}", behind.unwrap_or_default())
}
