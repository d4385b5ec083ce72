//! The planner alone, with the habits of the planning competitions: `althing plan`, and a program of
//! its own that starts in a quarter of the time, `althing-plan`.
//!
//! - Hands on to `external` what another engine is to plan, to `list` what there is to choose.
//! - Owns the wall clock: the planner knows none, so a timer sets its `Cancel` flag.
//! - Refuses by name what the planner cannot do yet; nothing asked for is silently left out.

pub mod arguments;
mod external;
mod list;
mod telling;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use pddl::{Diagnostic, Plan};
use planner::{
    Budget, CONFIGURATIONS, Cancel, Effort, News, Options, Outcome, PlanError, Statistics,
    StopReason, Text, configuration,
};
use serde_json::{Value, json};
use terminal::pddl_files::{self, Task};
use terminal::render::{number, plural};
use terminal::report::{Report, reason};
use terminal::{exit, output};

use crate::arguments::{Engine, PlanArgs};
use crate::telling::{Progress, Stage, Telling};

/// Plans, and shows the plan or why there is none.
pub fn run(args: &PlanArgs) -> ExitCode {
    let started = Instant::now();
    let (Some(domain), Some(problem), false) = (&args.domain, &args.problem, args.list) else {
        return list::run(args.print.json);
    };
    if let Some(refusal) = refusal(args) {
        let mut report = Report::default();
        report.add_general(refusal);
        return output::show(&report, args.print.json, "unsupported", exit::UNSUPPORTED);
    }
    let cancel = Cancel::new();
    let _timer = args.time_limit.map(|limit| Timer::start(limit, cancel.clone()));
    let task = match pddl_files::read_task(domain, problem) {
        Ok(task) => task,
        Err(report) => {
            return output::show(&report, args.print.json, "bad-input", exit::BAD_INPUT);
        }
    };
    match args.engine {
        Engine::Embedded => (),
        Engine::FastDownward => {
            return external::run(args, engines::Engine::FastDownward, &task, started);
        }
        Engine::MetricFf => return external::run(args, engines::Engine::MetricFf, &task, started),
    }
    if args.time_limit.is_some_and(|limit| started.elapsed() >= limit) {
        // Reading took all of it; the timer's thread may be late to say so.
        cancel.set();
    }
    let progress = Progress::default();
    let telling = Telling::start(args, started, progress.line());
    let mut search_began = None;
    let mut tell = |news: News<'_>| match news {
        News::Plan(plan) if args.anytime => tell_better(args, &task, plan, started.elapsed()),
        News::Ground { facts, operators } => {
            progress.set(Stage::Preparing { facts, operators });
        }
        News::Searching { expansions } => {
            search_began.get_or_insert_with(|| started.elapsed());
            progress.set(Stage::Searching { expansions });
        }
        _ => (),
    };
    let (domain, problem) = (&task.domain, &task.problem);
    let planned = planner::plan_and_tell(domain, problem, &options(args), &cancel, &mut tell);
    drop(telling);
    let took = Took { search_began, whole: started.elapsed() };
    match planned {
        Ok(outcome) => show(args, &task, &outcome, took),
        Err(err) => show_error(args, &task, &err),
    }
}

/// How long it took.
#[derive(Clone, Copy)]
struct Took {
    /// Until a search was set up, if one was needed.
    search_began: Option<Duration>,
    whole: Duration,
}

/// What of the arguments this planner cannot do.
fn refusal(args: &PlanArgs) -> Option<Diagnostic> {
    let refuse = |what: &str, help: &str| {
        let message = format!("{what} is not supported yet");
        Some(Diagnostic::error(pddl::Span::default(), message).with_help(help))
    };
    let embedded = args.engine == Engine::Embedded;
    if args.threads > 2 {
        return refuse("`--threads` above 2", "two searches run side by side at most");
    }
    if args.threads > 1 && !embedded {
        return refuse("`--threads` with another engine", "the embedded planner can do it");
    }
    if args.anytime && !embedded {
        return refuse("`--anytime` with another engine", "the embedded planner can do it");
    }
    if args.anytime && args.optimal {
        let help = "`--optimal` says nothing until it has the cheapest plan";
        return refuse("`--anytime` with `--optimal`", help);
    }
    if args.optimal && args.engine == Engine::MetricFf {
        return refuse(
            "`--optimal` with Metric-FF",
            "none of its searches proves anything cheapest",
        );
    }
    None
}

fn options(args: &PlanArgs) -> Options {
    let mut budget = Budget::default();
    if let Some(mib) = args.memory_limit {
        let bytes = u64::from(mib) << 20;
        budget.memory_max_bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
    }
    let effort = match (args.anytime, args.optimal) {
        (true, _) => Effort::Anytime,
        (_, true) => Effort::Optimal,
        _ => Effort::First,
    };
    let configuration = configuration(&args.search).unwrap_or(&CONFIGURATIONS[0]);
    let threads = u32::from(args.threads);
    Options { budget, configuration, effort, threads, ..Options::default() }
}

/// Shows that a better plan was found, and puts it where the last one was.
fn tell_better(args: &PlanArgs, task: &Task, plan: &Plan, elapsed: Duration) {
    let unit_cost = task.problem.metric.is_none();
    let seconds = elapsed.as_secs_f64();
    output::note(&format!("{}, after {seconds:.3} s", found(plan, unit_cost, false)));
    // What cannot be written now is reported with the last plan, which is written again.
    let _ = args.plan.as_ref().map(|file| replace(file, &ipc(plan, unit_cost)));
}

/// Writes a file as a whole: whoever reads it meanwhile has the old text or the new one.
fn replace(file: &Path, text: &str) -> std::io::Result<()> {
    // What is no plain file, a pipe or a terminal, cannot be exchanged for one.
    if file.exists() && !file.is_file() {
        return std::fs::write(file, text);
    }
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut new = tempfile::NamedTempFile::new_in(folder.unwrap_or(Path::new(".")))?;
    new.write_all(text.as_bytes())?;
    new.persist(file).map(drop).map_err(|err| err.error)
}

/// Sets a flag when time is up, unless it is dropped before.
struct Timer {
    /// Dropping it wakes the thread.
    _stop: mpsc::Sender<()>,
}

// === impl Timer ===

impl Timer {
    fn start(limit: Duration, cancel: Cancel) -> Timer {
        let (stop, stopped) = mpsc::channel();
        thread::spawn(move || {
            if stopped.recv_timeout(limit) == Err(mpsc::RecvTimeoutError::Timeout) {
                cancel.set();
            }
        });
        Timer { _stop: stop }
    }
}

fn show(args: &PlanArgs, task: &Task, outcome: &Outcome, took: Took) -> ExitCode {
    let mut report = task.report.clone();
    report.add(&task.domain_source, outcome.warnings.iter().cloned());
    let code = outcome.stop_reason.exit_code();
    let unit_cost = task.problem.metric.is_none();
    let text = outcome.plan.as_ref().map(|plan| ipc(plan, unit_cost));
    if let Some(refused) = write_plan(args, text.as_deref(), &mut report) {
        return refused;
    }
    if args.print.json {
        return output::print_json(&json_outcome(outcome, unit_cost, &report, took), code);
    }
    output::show_people(&report);
    output::note(&summary(outcome, unit_cost, took.whole));
    match text {
        Some(text) if args.plan.is_none() => output::print(text, code),
        _ => exit::with(code),
    }
}

/// Writes a plan to the file that is to have it; what the process ends with if that does not work.
fn write_plan(args: &PlanArgs, text: Option<&str>, report: &mut Report) -> Option<ExitCode> {
    let (file, text) = (args.plan.as_ref()?, text?);
    let written = if args.anytime { replace(file, text) } else { std::fs::write(file, text) };
    let err = written.err()?;
    report.add_failure(format_args!("write `{}`: {}", file.display(), reason(&err)));
    Some(output::show(report, args.print.json, "not-written", exit::OUTPUT))
}

/// The format of the planning competitions, with the cost as Fast Downward writes it.
fn ipc(plan: &Plan, unit_cost: bool) -> String {
    let mut text = String::new();
    for step in &plan.steps {
        let _ = writeln!(text, "{step}");
    }
    let _ = writeln!(text, "; cost = {} ({})", cost(plan), cost_kind(unit_cost));
    text
}

/// What the plan costs; its number of steps where nothing else is said.
fn cost(plan: &Plan) -> f64 {
    plan.cost.map_or(plan.steps.len() as f64, |cost| cost.0)
}

fn cost_kind(unit_cost: bool) -> &'static str {
    if unit_cost { "unit cost" } else { "general cost" }
}

/// The line or two for people.
fn summary(outcome: &Outcome, unit_cost: bool, elapsed: Duration) -> String {
    let first = match &outcome.plan {
        Some(plan) => found(plan, unit_cost, outcome.statistics.proven_optimal),
        None => format!("no plan: {}", words(outcome.stop_reason)),
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

/// What a plan is like.
fn found(plan: &Plan, unit_cost: bool, proven_optimal: bool) -> String {
    let proof = match (proven_optimal, unit_cost) {
        (true, true) => "; no shorter plan exists",
        (true, false) => "; no cheaper plan exists",
        (false, _) => "",
    };
    let steps = plural(plan.steps.len(), "step");
    format!("plan found: {steps}, cost {} ({}){proof}", cost(plan), cost_kind(unit_cost))
}

/// The reason in the words of this command line, where the planner's own are another's.
fn words(reason: StopReason) -> String {
    match reason {
        StopReason::Cancelled => "out of time (--time-limit)".to_owned(),
        StopReason::MemoryLimit { limit } => {
            format!("out of memory at {} MiB (--memory-limit)", limit >> 20)
        }
        other => other.to_string(),
    }
}

/// One word for programs; it never changes its meaning.
fn status(reason: StopReason) -> &'static str {
    match reason.exit_code() {
        exit::DONE => "plan-found",
        10 | 11 => "unsolvable",
        exit::OUT_OF_MEMORY => "out-of-memory",
        exit::OUT_OF_TIME => "out-of-time",
        _ => "no-plan",
    }
}

fn json_outcome(outcome: &Outcome, unit_cost: bool, report: &Report, took: Took) -> Value {
    let plan = outcome.plan.as_ref();
    let steps: Option<Vec<String>> =
        plan.map(|plan| plan.steps.iter().map(ToString::to_string).collect());
    json!({
        "status": status(outcome.stop_reason),
        "reason": words(outcome.stop_reason),
        "plan": steps,
        "cost": plan.map(|plan| number(cost(plan))),
        "cost_kind": plan.map(|_| cost_kind(unit_cost)),
        "statistics": json_statistics(&outcome.statistics, took),
        "diagnostics": terminal::render::json(report),
    })
}

fn json_statistics(statistics: &Statistics, took: Took) -> Value {
    // No `..`: a new figure must be given a name here.
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

fn show_error(args: &PlanArgs, task: &Task, err: &PlanError) -> ExitCode {
    let mut report = task.report.clone();
    let status = match err {
        PlanError::Unsupported(unsupported) => {
            let source = match unsupported.text {
                Text::Domain => &task.domain_source,
                Text::Problem => &task.problem_source,
            };
            let message = format!("{} is not supported yet", unsupported.feature);
            report.add(source, [Diagnostic::error(unsupported.span, message)]);
            "unsupported"
        }
        PlanError::BadInput(diagnostics) => {
            let source = pddl_files::blamed(task);
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
