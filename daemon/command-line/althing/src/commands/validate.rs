//! `althing validate`: checks a plan independently of any planner, and computes its cost.
//!
//! The last line on stdout is `cost = N` if the plan is valid; benchmarks of planners read this
//! line.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use pddl::{Diagnostic, Parsed, Plan};
use planner::Cancel;
use planner::validate::{self, Fault, FaultPlace, FaultReason, Verdict};
use serde_json::json;
use terminal::limits::{LimitWatch, RunLimits};
use terminal::pddl_files::{self, PddlTask};
use terminal::render::{number, plural};
use terminal::report::{DiagnosticReport, SourceText};
use terminal::{exit, output};

use crate::cli::ValidateArgs;

/// Runs `althing validate`: checks the plan, and prints its cost or the first fault.
pub(crate) fn run(args: &ValidateArgs) -> ExitCode {
    let json = args.print.json;
    let limits = RunLimits::of_time(args.time_limit);
    let give = terminal::limits::refusal(json);
    let deadline = LimitWatch::start(limits, Instant::now(), Cancel::new(), give);
    let judged = judge(args);
    deadline.answer(|| show(json, judged))
}

/// The result of validating a plan.
enum ValidationResult {
    Valid {
        warnings: DiagnosticReport,
        steps: usize,
        cost: f64,
    },
    Fault {
        task: Box<PddlTask>,
        source: Arc<SourceText>,
        plan: Plan,
        fault: Box<Fault>,
    },
    /// The domain, the problem or the plan has mistakes or is not supported, so that nothing could
    /// be validated.
    Refused(DiagnosticReport),
}

fn show(json: bool, judged: ValidationResult) -> ExitCode {
    match judged {
        ValidationResult::Valid { warnings, steps, cost } => {
            show_valid(json, &warnings, steps, cost)
        }
        ValidationResult::Fault { task, source, plan, fault } => {
            show_fault(json, &task, &source, &plan, &fault)
        }
        ValidationResult::Refused(report) => {
            let (status, code) = report.refusal();
            output::show(&report, json, status, code)
        }
    }
}

fn judge(args: &ValidateArgs) -> ValidationResult {
    let task = pddl_files::read_task(&args.domain, &args.problem);
    let plan = read_plan(&args.plan);
    let (task, source, plan) = match (task, plan) {
        (Ok(mut task), Ok((source, plan, warnings))) => {
            task.report.extend(warnings);
            (task, source, plan)
        }
        (task, plan) => {
            let mut report = task.err().unwrap_or_default();
            report.extend(plan.err().unwrap_or_default());
            return ValidationResult::Refused(report);
        }
    };
    if let Some(report) = unsupported(&task, &source, &plan) {
        return ValidationResult::Refused(report);
    }
    match validate::validate(&task.domain, &task.problem, &plan) {
        Verdict::Valid { cost, steps } => {
            ValidationResult::Valid { warnings: task.report, steps, cost }
        }
        Verdict::Fault(fault) => {
            ValidationResult::Fault { task: Box::new(task), source, plan, fault }
        }
        Verdict::BadInput(diagnostics) => {
            let mut report = task.report.clone();
            report.add(pddl_files::likely_faulty_text(&task), diagnostics);
            ValidationResult::Refused(report)
        }
    }
}

fn read_plan(path: &Path) -> Result<(Arc<SourceText>, Plan, DiagnosticReport), DiagnosticReport> {
    let mut report = DiagnosticReport::default();
    let source = pddl_files::read(path, &mut report);
    let plan = source.as_ref().and_then(|source| {
        let Parsed { value, diagnostics } = pddl::parse_plan(&source.text);
        report.add(source, diagnostics);
        value.map(|mut plan| {
            report.add(source, plan.sort_by_time());
            plan
        })
    });
    match (source, plan) {
        (Some(source), Some(plan)) if !report.has_errors() => Ok((source, plan, report)),
        _ => Err(report),
    }
}

/// Returns a report if the task or the plan uses durations or time, which the validator does not
/// support; otherwise `None`.
fn unsupported(task: &PddlTask, source: &Arc<SourceText>, plan: &Plan) -> Option<DiagnosticReport> {
    let mut report = task.report.clone();
    if let Some(later) = task.problem.timed_literal() {
        let message = "timed initial literals are not supported yet";
        report.add(&task.problem_source, [Diagnostic::unsupported(later.span(), message)]);
        return Some(report);
    }
    let is_durative =
        |name: &pddl::Name| task.domain.durative_actions.iter().any(|action| action.name == *name);
    let durative = plan.steps.iter().find(|step| is_durative(&step.action))?;
    let message =
        format!("`{}` is durative: plans with times are not supported yet", durative.action);
    report.add(source, [Diagnostic::unsupported(durative.span, message)]);
    Some(report)
}

fn show_valid(json: bool, warnings: &DiagnosticReport, steps: usize, cost: f64) -> ExitCode {
    if json {
        let diagnostics = terminal::render::json(warnings);
        let value = json!({
            "status": "valid", "steps": steps, "cost": number(cost), "diagnostics": diagnostics,
        });
        return output::print_json(&value, exit::DONE);
    }
    output::show_to_person(warnings);
    let steps = plural(steps, "step");
    output::print(format_args!("valid plan with {steps}\ncost = {cost}\n"), exit::DONE)
}

fn show_fault(
    json: bool,
    task: &PddlTask,
    source: &Arc<SourceText>,
    plan: &Plan,
    fault: &Fault,
) -> ExitCode {
    let mut report = task.report.clone();
    let (blamed, diagnostic) = told(task, source, plan, fault);
    report.add(&blamed, [diagnostic]);
    if !json {
        output::show_to_person(&report);
        return exit::with(exit::INVALID_PLAN);
    }
    let (step, text) = match &fault.place {
        FaultPlace::Step { index, step } => (Some(index + 1), Some(step.to_string())),
        FaultPlace::Goal | FaultPlace::Metric => (None, None),
    };
    let value = json!({
        "status": "invalid",
        "fault": {
            "step": step,
            "text": text,
            "reason": fault.reason.to_string(),
            "condition": fault.condition().map(ToString::to_string),
        },
        "diagnostics": terminal::render::json(&report),
    });
    output::print_json(&value, exit::INVALID_PLAN)
}

/// Converts a fault of the plan to a diagnostic and the text that it is about. This is the text of
/// the plan or, if the goal is not reached, the text of the problem.
fn told(
    task: &PddlTask,
    source: &Arc<SourceText>,
    plan: &Plan,
    fault: &Fault,
) -> (Arc<SourceText>, Diagnostic) {
    match &fault.place {
        FaultPlace::Step { index, step } => {
            let place = format!("step {} {step}", index + 1);
            let message = match &fault.reason {
                FaultReason::Precondition(condition) => {
                    format!("{place}: its precondition {condition} does not hold")
                }
                reason => format!("{place}: {reason}"),
            };
            let mut diagnostic = Diagnostic::error(fault.span, message);
            diagnostic.help = suggestion(task, plan, *index);
            (Arc::clone(source), diagnostic)
        }
        FaultPlace::Goal => {
            let condition = fault.condition().map(ToString::to_string).unwrap_or_default();
            let message = format!(
                "after {}, {condition} of the goal does not hold",
                plural(plan.steps.len(), "step")
            );
            let span = goal_span(&task.problem_source.text);
            (Arc::clone(&task.problem_source), Diagnostic::error(span, message))
        }
        FaultPlace::Metric => {
            let message = format!("the cost cannot be told: {}", fault.reason);
            (Arc::clone(&task.problem_source), Diagnostic::error(fault.span, message))
        }
    }
}

/// Returns the help that `althing check` would give for the step at `index`: the name that was
/// probably meant.
fn suggestion(task: &PddlTask, plan: &Plan, index: usize) -> Option<String> {
    let step = plan.steps.get(index)?.clone();
    let alone = Plan { steps: vec![step], cost: None };
    pddl::check_plan(&task.domain, &task.problem, &alone).into_iter().find_map(|found| found.help)
}

/// Returns the span of the word `:goal` in the text of a problem. The syntax tree does not record
/// the span of the whole goal.
fn goal_span(text: &str) -> pddl::Span {
    let without_comments = text.split_inclusive('\n').scan(0, |offset, line| {
        let start = *offset;
        *offset += line.len();
        Some((start, line.split(';').next().unwrap_or("")))
    });
    let found = without_comments
        .filter_map(|(start, code)| Some(start + code.to_ascii_lowercase().find(":goal")?))
        .next()
        .unwrap_or(0);
    pddl::Span::new(found, found + ":goal".len())
}
