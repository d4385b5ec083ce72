//! The planner without a daemon, with the conventions of the planning competitions. It is the
//! command `althing plan`, and also the program `althing-plan`, which starts four times as fast.
//!
//! - The module `external` plans with other engines, and `list` lists heuristics and search
//!   configurations.
//! - A timer reads the wall clock and sets the planner's `Cancel` flag, because the planner reads
//!   no clock.
//! - An unsupported option is rejected with its name, and never ignored silently.

pub mod arguments;
mod external;
mod files;
mod list;
mod progress;

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pddl::{Diagnostic, Plan};
use planner::explain::{Unsolvability, why_unsolvable};
use planner::{
    Budget, CONFIGURATIONS, Cancel, Effort, InputText, Options, PlanError, PlanningOutcome,
    PlanningProgress, Statistics, StopReason, Unprovable, configuration,
};
use serde_json::{Value, json};
use terminal::factored_folder::read_factored;
use terminal::limits::{CertainAnswer, LimitReporter, LimitWatch, RunLimits};
use terminal::pddl_files::{self, PddlTask};
use terminal::render::{number, plural};
use terminal::report::{DiagnosticReport, reason_of_writing};
use terminal::{exit, output};

use crate::arguments::{EngineChoice, PlanArgs};
use crate::progress::{PlanningStage, Progress, ProgressPrinter};

/// Plans as the arguments require. Shows the plan, or the reason why there is none.
pub fn run(args: &PlanArgs) -> ExitCode {
    let started = Instant::now();
    let (Some(domain), false) = (&args.domain, args.list) else {
        return list::run(args.print.json);
    };
    if args.problem.is_none() && !domain.is_dir() {
        let mut report = DiagnosticReport::default();
        let message = format!("`{}` is no folder, and no problem is named", domain.display());
        let help = "name the problem after the domain, or a folder with the files of each agent";
        report.add_general(Diagnostic::error(pddl::Span::default(), message).with_help(help));
        return output::show(&report, args.print.json, "bad-usage", exit::USAGE);
    }
    if let Some(refusal) = refusal(args) {
        let mut report = DiagnosticReport::default();
        report.add_general(refusal);
        return output::show(&report, args.print.json, "unsupported", exit::UNSUPPORTED);
    }
    let cancel = Cancel::new();
    let memory_bytes = memory_max_bytes(args);
    let limits = RunLimits { time: args.time_limit, memory_bytes };
    let deadline =
        LimitWatch::start(limits, started, cancel.clone(), limit_reporter(args, started));
    let task = match read_task(domain, args.problem.as_deref()) {
        Ok(task) => task,
        Err(report) => {
            let (status, code) = report.refusal();
            return deadline.answer(|| output::show(&report, args.print.json, status, code));
        }
    };
    // An engine has limits of its own, by which it ends its processes.
    let engine = match args.engine {
        EngineChoice::Embedded => {
            return embedded(args, &Arc::new(task), &cancel, &deadline, started);
        }
        EngineChoice::FastDownward => engines::ExternalEngine::FastDownward,
        EngineChoice::MetricFf => engines::ExternalEngine::MetricFf,
    };
    deadline.answer(|| external::run(args, engine, &task, started))
}

/// Reads a domain and a problem, or a folder with the files of each agent.
fn read_task(domain: &Path, problem: Option<&Path>) -> Result<PddlTask, DiagnosticReport> {
    match problem {
        Some(problem) => pddl_files::read_task(domain, problem),
        None => read_factored(domain),
    }
}

/// Returns a plan with the names that the author of the task gave.
fn original(task: &PddlTask, plan: &Plan) -> Plan {
    match &task.factored {
        Some(factored) => factored.original(plan),
        None => plan.clone(),
    }
}

/// Plans with the embedded planner. Shows the plan, or the reason why there is none.
fn embedded(
    args: &PlanArgs,
    task: &Arc<PddlTask>,
    cancel: &Cancel,
    deadline: &LimitWatch,
    started: Instant,
) -> ExitCode {
    let memory_bytes = memory_max_bytes(args);
    if args.time_limit.is_some_and(|limit| started.elapsed() >= limit) {
        // Parsing took all of the time; the timer's thread may set the flag later than this.
        cancel.set();
    }
    let progress = Progress::default();
    let telling = ProgressPrinter::start(args, started, progress.line());
    let mut search_began = None;
    let mut tell = |news: PlanningProgress<'_>| match news {
        PlanningProgress::Plan(plan) => {
            let plan = &original(task, plan);
            deadline.record_plan(ipc(plan, task.problem.metric.is_none()));
            if args.anytime {
                report_better_plan(args, task, plan, started.elapsed());
            }
        }
        PlanningProgress::Ground { facts, operators } => {
            progress.set(PlanningStage::Preparing { facts, operators });
        }
        PlanningProgress::Searching { expansions } => {
            search_began.get_or_insert_with(|| started.elapsed());
            progress.set(PlanningStage::Searching { expansions });
        }
        _ => (),
    };
    let (domain, problem) = (&task.domain, &task.problem);
    let options = options(args, memory_bytes);
    let planned = planner::plan_with_progress(domain, problem, &options, cancel, &mut tell);
    let took = PlanningTimes { search_began, whole: started.elapsed() };
    match planned {
        Ok(outcome) => {
            let plan = outcome.plan.as_ref().map(|plan| original(task, plan));
            let outcome = PlanningOutcome { plan, ..outcome };
            let is_proof = matches!(outcome.stop_reason, StopReason::Unsolvable { .. });
            if is_proof {
                deadline.record_certain(unexplained(args, task, &outcome, took));
            }
            let explain = || why_unsolvable(domain, problem, memory_bytes, cancel).ok();
            let explanation = is_proof.then(explain).flatten();
            drop(telling);
            deadline.answer(|| show(args, task, &outcome, explanation.as_ref(), took))
        }
        Err(err) => {
            drop(telling);
            deadline.answer(|| show_error(args, task, &err))
        }
    }
}

/// Returns the answer that a problem is proven unsolvable. It is given if a limit ends the process
/// while the reason is still being computed.
fn unexplained(
    args: &PlanArgs,
    task: &Arc<PddlTask>,
    outcome: &PlanningOutcome,
    took: PlanningTimes,
) -> CertainAnswer {
    let (args, task, outcome) = (args.clone(), Arc::clone(task), outcome.clone());
    Box::new(move || {
        // A failure to write to the terminal changes nothing about the proof.
        let _ = show(&args, &task, &outcome, None, took);
        if !args.print.json {
            output::print_note("  a limit was reached before the reason was found");
        }
        outcome.exit_code()
    })
}

/// Returns the function that is called when a limit ends the process. It prints the best plan so
/// far, or that there is none.
fn limit_reporter(args: &PlanArgs, started: Instant) -> LimitReporter {
    let (json, is_optimal, file) = (args.print.json, args.optimal, args.plan.clone());
    Box::new(move |reason, best| {
        let (code, first) = match &best {
            None => (reason.exit_code(), format!("no plan: {}", stop_reason_text(reason))),
            Some(_) => {
                let code = match (is_optimal, reason) {
                    (false, _) => exit::DONE,
                    (true, StopReason::MemoryLimit { .. }) => exit::UNPROVEN_OUT_OF_MEMORY,
                    (true, _) => exit::UNPROVEN_OUT_OF_TIME,
                };
                (
                    code,
                    format!("the best plan that was found in time: {}", stop_reason_text(reason)),
                )
            }
        };
        let written =
            file.as_ref().zip(best.as_deref()).map(|(file, plan)| files::write(file, plan));
        if let Some(Err(err)) = written {
            output::print_note(&format!(
                "error: failed to write the plan: {}",
                reason_of_writing(&err)
            ));
            return exit::OUTPUT;
        }
        if json {
            let steps = best
                .as_deref()
                .map(|plan| plan.lines().filter(|line| line.starts_with('(')).collect::<Vec<_>>());
            let value = json!({
                "status": if best.is_some() { "plan-found" } else { status(reason) },
                "reason": stop_reason_text(reason),
                "unproven": (is_optimal && best.is_some()).then(|| unproven(reason, None)),
                "plan": steps,
                "seconds": started.elapsed().as_secs_f64(),
            });
            let _ = output::print_json(&value, code);
            return code;
        }
        output::print_note(&format!("{first}, after {:.3} s", started.elapsed().as_secs_f64()));
        if let (Some(plan), None) = (best, file) {
            let _ = output::print(plan, code);
        }
        code
    })
}

/// Returns the limit on the size of the planner's tables, in bytes. Without a limit on the command
/// line, it is the smaller of 2 GiB and half of the available memory.
fn memory_max_bytes(args: &PlanArgs) -> usize {
    let bytes = match args.memory_limit {
        Some(mib) => u64::from(mib) << 20,
        None => {
            let common = Budget::default().memory_max_bytes as u64;
            machine::memory_available().map_or(common, |available| common.min(available / 2))
        }
    };
    usize::try_from(bytes).unwrap_or(usize::MAX)
}

/// The time that planning took: up to the start of the search, and in all.
#[derive(Clone, Copy)]
struct PlanningTimes {
    /// Time from the start until the search was set up; `None` if no search was needed.
    search_began: Option<Duration>,
    whole: Duration,
}

/// Returns an error for a combination of arguments that is not supported; `None` if all are
/// supported.
fn refusal(args: &PlanArgs) -> Option<Diagnostic> {
    let refuse = |what: &str, help: &str| {
        let message = format!("{what} is not supported yet");
        Some(Diagnostic::error(pddl::Span::default(), message).with_help(help))
    };
    let embedded = args.engine == EngineChoice::Embedded;
    if args.threads > 2 {
        return refuse("`--threads` above 2", "two searches run side by side at most");
    }
    if args.threads > 1 && !embedded {
        return refuse("`--threads` with another engine", "the embedded planner can do it");
    }
    if args.problem.is_none() && !embedded {
        return refuse("a folder of agents with another engine", "the embedded planner can do it");
    }
    if args.anytime && !embedded {
        return refuse("`--anytime` with another engine", "the embedded planner can do it");
    }
    if args.anytime && args.optimal {
        let help = "`--optimal` prints no plan before the cheapest one";
        return refuse("`--anytime` with `--optimal`", help);
    }
    if args.optimal && args.engine == EngineChoice::MetricFf {
        return refuse(
            "`--optimal` with Metric-FF",
            "none of its searches proves that a plan is the cheapest",
        );
    }
    None
}

fn options(args: &PlanArgs, memory_max_bytes: usize) -> Options {
    let budget = Budget { memory_max_bytes, ..Budget::default() };
    let effort = match (args.anytime, args.optimal) {
        (true, _) => Effort::Anytime,
        (_, true) => Effort::Optimal,
        _ => Effort::First,
    };
    let configuration = configuration(&args.search).unwrap_or(&CONFIGURATIONS[0]);
    let threads = u32::from(args.threads);
    Options { budget, configuration, effort, threads, ..Options::default() }
}

/// Reports a better plan, and writes it to the plan file in place of the previous plan.
fn report_better_plan(args: &PlanArgs, task: &PddlTask, plan: &Plan, elapsed: Duration) {
    let unit_cost = task.problem.metric.is_none();
    let seconds = elapsed.as_secs_f64();
    output::print_note(&format!("{}, after {seconds:.3} s", plan_summary(plan, unit_cost, false)));
    // A failure to write is ignored here: the last plan is written again, and its failure is
    // reported.
    let _ = args.plan.as_ref().map(|file| files::write(file, &ipc(plan, unit_cost)));
}

fn show(
    args: &PlanArgs,
    task: &PddlTask,
    outcome: &PlanningOutcome,
    explanation: Option<&Unsolvability>,
    took: PlanningTimes,
) -> ExitCode {
    let mut report = task.report.clone();
    report.add(&task.domain_source, outcome.warnings.iter().cloned());
    let code = outcome.exit_code();
    let unit_cost = task.problem.metric.is_none();
    let text = outcome.plan.as_ref().map(|plan| ipc(plan, unit_cost));
    if let Some(refused) = write_plan(args, text.as_deref(), &mut report) {
        return refused;
    }
    if args.print.json {
        let mut value = json_outcome(outcome, unit_cost, &report, took);
        if let Some(explanation) = explanation {
            value["explanation"] = json_explanation(explanation);
        }
        if let Some(reason) = outcome.unproven {
            value["unproven"] = unproven(reason, outcome.unprovable).into();
        }
        return output::print_json(&value, code);
    }
    output::show_to_person(&report);
    output::print_note(&summary(outcome, unit_cost, took.whole));
    if let Some(explanation) = explanation {
        explanation
            .to_string()
            .lines()
            .for_each(|line| output::print_note(&output::folded(line, 2)));
    }
    match text {
        Some(text) if args.plan.is_none() => output::print(text, code),
        _ => exit::with(code),
    }
}

/// Writes a plan to the file given on the command line, if there is one. If writing fails, shows
/// the error and returns the exit code of the process; otherwise returns `None`.
fn write_plan(
    args: &PlanArgs,
    text: Option<&str>,
    report: &mut DiagnosticReport,
) -> Option<ExitCode> {
    let (file, text) = (args.plan.as_ref()?, text?);
    let err = files::write(file, text).err()?;
    report.add_failure(format_args!("write `{}`: {}", file.display(), reason_of_writing(&err)));
    Some(output::show(report, args.print.json, "not-written", exit::OUTPUT))
}

/// Formats a plan as in the planning competitions. The last line gives the cost as Fast Downward
/// does.
fn ipc(plan: &Plan, unit_cost: bool) -> String {
    let mut text = String::new();
    for step in &plan.steps {
        let _ = writeln!(text, "{step}");
    }
    let _ = writeln!(text, "; cost = {} ({})", cost(plan), cost_kind(unit_cost));
    text
}

/// Returns the cost of a plan, or the number of its steps if it has no cost.
fn cost(plan: &Plan) -> f64 {
    plan.cost.map_or(plan.steps.len() as f64, |cost| cost.0)
}

fn cost_kind(unit_cost: bool) -> &'static str {
    if unit_cost { "unit cost" } else { "general cost" }
}

/// Returns one or two lines that summarise the result of planning, for a person.
fn summary(outcome: &PlanningOutcome, unit_cost: bool, elapsed: Duration) -> String {
    let first = match &outcome.plan {
        Some(plan) => {
            let found = plan_summary(plan, unit_cost, outcome.statistics.proven_optimal);
            let unproven = outcome.unproven.map(|reason| unproven(reason, outcome.unprovable));
            found + &unproven.map(|why| format!("; {why}")).unwrap_or_default()
        }
        None => format!("no plan: {}", stop_reason_text(outcome.stop_reason)),
    };
    let Statistics { facts, operators, expansions, .. } = outcome.statistics;
    let expanded = plural(usize::try_from(expansions).unwrap_or(usize::MAX), "state");
    let seconds = elapsed.as_secs_f64();
    format!(
        "{first}\n{}, {}; {expanded} expanded in {seconds:.3} s",
        plural(facts, "fact"),
        plural(operators, "operator")
    )
}

/// Returns a description of a plan in one line, for a person.
fn plan_summary(plan: &Plan, unit_cost: bool, proven_optimal: bool) -> String {
    let proof = match (proven_optimal, unit_cost) {
        (true, true) => "; no shorter plan exists",
        (true, false) => "; no cheaper plan exists",
        (false, _) => "",
    };
    let steps = plural(plan.steps.len(), "step");
    format!("plan found: {steps}, cost {} ({}){proof}", cost(plan), cost_kind(unit_cost))
}

/// Returns the reason why planning ended, as text for a person. Names the option of the command
/// line where the planner's own text would not.
fn stop_reason_text(reason: StopReason) -> String {
    match reason {
        StopReason::Cancelled => "out of time (--time-limit)".to_owned(),
        StopReason::MemoryLimit { limit } => {
            format!("out of memory at {} MiB (--memory-limit)", limit >> 20)
        }
        other => other.to_string(),
    }
}

/// Returns the reason why a plan is not proven to be the cheapest although a proof was requested.
fn unproven(reason: StopReason, unprovable: Option<Unprovable>) -> String {
    let why = match (reason, unprovable) {
        (StopReason::Exhausted, Some(costs)) => costs.to_string(),
        (limit, _) => stop_reason_text(limit),
    };
    format!("not proven to be the cheapest: {why}")
}

/// Returns the status of a search for the JSON output. Programs may rely on these words.
fn status(reason: StopReason) -> &'static str {
    match reason.exit_code() {
        exit::DONE => "plan-found",
        10 | 11 => "unsolvable",
        exit::OUT_OF_MEMORY => "out-of-memory",
        exit::OUT_OF_TIME => "out-of-time",
        _ => "no-plan",
    }
}

fn json_outcome(
    outcome: &PlanningOutcome,
    unit_cost: bool,
    report: &DiagnosticReport,
    took: PlanningTimes,
) -> Value {
    let plan = outcome.plan.as_ref();
    let steps: Option<Vec<String>> =
        plan.map(|plan| plan.steps.iter().map(ToString::to_string).collect());
    json!({
        "status": status(outcome.stop_reason),
        "reason": stop_reason_text(outcome.stop_reason),
        "plan": steps,
        "cost": plan.map(|plan| number(cost(plan))),
        "cost_kind": plan.map(|_| cost_kind(unit_cost)),
        "statistics": json_statistics(&outcome.statistics, took),
        "diagnostics": terminal::render::json(report),
    })
}

fn json_explanation(explanation: &Unsolvability) -> Value {
    let parts: Vec<Value> = { explanation.parts.iter() }
        .map(|(part, why)| json!({ "goal": part.to_string(), "why": why }))
        .collect();
    json!({ "parts": parts, "more": explanation.more, "together": explanation.together })
}

fn json_statistics(statistics: &Statistics, took: PlanningTimes) -> Value {
    // No `..` here: a new statistic must be given a name in the JSON.
    let Statistics {
        facts,
        operators,
        join_steps,
        expansions,
        evaluations,
        optimal_expansions,
        proven_optimal,
    } = *statistics;
    json!({
        "facts": facts,
        "operators": operators,
        "join_steps": join_steps,
        "expansions": expansions,
        "evaluations": evaluations,
        "optimal_expansions": optimal_expansions,
        "proven_optimal": proven_optimal,
        "search_seconds": took.search_began.map(|began| (took.whole - began).as_secs_f64()),
        "seconds": took.whole.as_secs_f64(),
    })
}

fn show_error(args: &PlanArgs, task: &PddlTask, err: &PlanError) -> ExitCode {
    let mut report = task.report.clone();
    let status = match err {
        PlanError::Unsupported(unsupported) => {
            let source = match unsupported.text {
                InputText::Domain => &task.domain_source,
                InputText::Problem => &task.problem_source,
            };
            let verb = if unsupported.is_plural() { "are" } else { "is" };
            let message = format!("{} {verb} not supported yet", unsupported.feature);
            report.add(source, [Diagnostic::error(unsupported.span, message)]);
            "unsupported"
        }
        PlanError::BadInput(diagnostics) => {
            let source = pddl_files::likely_faulty_text(task);
            report.add(source, diagnostics.iter().cloned());
            "bad-input"
        }
        other => {
            report.add_failure(other);
            "defect"
        }
    };
    output::show(&report, args.print.json, status, err.exit_code())
}
