//! Tests that the plan for every feature of the language is accepted by an independent validator.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::{Command, Stdio};

use engines::{Ending, EngineOptions, PlanningAim};
use planner::{Cancel, plan};

use crate::features::{FEATURES, Feature, Judges, domain_of, texts};
use crate::following;
use crate::support::{fast_downward, parse, run, unified_planning};

/// Returns the plan of the embedded planner for the task of a feature.
fn embedded(feature: &Feature) -> pddl::Plan {
    let (domain, problem) = texts(feature);
    let (domain, problem) = parse(&domain, &problem);
    let outcome = plan(&domain, &problem, &planner::Options::default(), &Cancel::new());
    let outcome = outcome.unwrap_or_else(|err| panic!("{}: {err}", feature.name));
    let plan = outcome.plan.unwrap_or_else(|| panic!("{}: {}", feature.name, outcome.stop_reason));
    let cost = plan.cost.map_or(f64::NAN, |cost| cost.0);
    assert!((cost - feature.cost).abs() < 1e-9, "{}: cost {cost}", feature.name);
    plan
}

#[test]
fn the_embedded_planner_solves_every_feature() {
    FEATURES.iter().for_each(|feature| drop(embedded(feature)));
}

#[test]
fn an_independent_validator_accepts_the_plans() {
    let Some(python) = unified_planning() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut lines = String::new();
    let judged: Vec<&Feature> =
        FEATURES.iter().filter(|feature| feature.by != Judges::FastDownward).collect();
    for (index, feature) in judged.iter().enumerate() {
        let (domain, problem) = for_unified_planning(feature);
        let mut paths = Vec::new();
        for (name, text) in
            [("domain", domain), ("problem", problem), ("plan", embedded(feature).to_string())]
        {
            let path = folder.path().join(format!("{index}-{name}.pddl"));
            std::fs::write(&path, text).expect("the folder can be written to");
            paths.push(path.display().to_string());
        }
        let _ = writeln!(lines, "{}", paths.join("\t"));
    }
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/validate.py");
    let mut child = Command::new(python)
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python runs");
    child.stdin.take().expect("piped").write_all(lines.as_bytes()).expect("it listens");
    let output = child.wait_with_output().expect("it ends");
    let verdicts = String::from_utf8_lossy(&output.stdout).into_owned();
    let verdicts: Vec<&str> = verdicts.lines().collect();
    let told: String = judged
        .iter()
        .zip(&verdicts)
        .filter(|(_, verdict)| **verdict != "valid")
        .map(|(feature, verdict)| format!("{}: {verdict}\n", feature.name))
        .collect();
    assert!(told.is_empty(), "{told}");
    assert_eq!(verdicts.len(), judged.len(), "a verdict for each feature");
}

/// Returns the texts of a feature's task in a form that unified-planning can read.
fn for_unified_planning(feature: &Feature) -> (String, String) {
    let (domain, problem) = texts(feature);
    match feature.by {
        Judges::Printed => {
            let (domain, problem) = parse(&domain, &problem);
            (domain.to_string(), problem.to_string())
        }
        Judges::Twin(sections) => (domain_of(sections), problem),
        Judges::Both | Judges::Validator | Judges::FastDownward => (domain, problem),
    }
}

#[test]
fn fast_downward_executes_the_plans_that_no_other_validator_can_read() {
    let Some(installation) = fast_downward() else { return };
    let options = EngineOptions::default();
    for feature in FEATURES.iter().filter(|feature| feature.by == Judges::FastDownward) {
        let (domain, problem) = texts(feature);
        let plan = embedded(feature);
        let ends = |steps: &[pddl::PlanStep]| {
            let (domain, problem) = following::task(&parse(&domain, &problem), steps);
            run(&installation, &domain, &problem, &options).expect("it can be read").ending
        };
        assert_eq!(ends(&plan.steps), Ending::GoalReached, "{}", feature.name);
        // The validator must reject the plan without its last step.
        let short = &plan.steps[..plan.steps.len() - 1];
        assert!(matches!(ends(short), Ending::Unsolvable { .. }), "{}", feature.name);
    }
}

#[test]
fn fast_downward_finds_plans_of_the_same_cost() {
    let Some(installation) = fast_downward() else { return };
    let options = EngineOptions { aim: PlanningAim::CheapestPlan, ..EngineOptions::default() };
    let known = FEATURES.iter().filter(|feature| feature.by != Judges::Validator);
    for feature in known {
        let (domain, problem) = texts(feature);
        let outcome = run(&installation, &domain, &problem, &options);
        let outcome = outcome.unwrap_or_else(|err| panic!("{}: {err}", feature.name));
        assert_eq!(outcome.ending, Ending::GoalReached, "{}", feature.name);
        assert!(outcome.proven_optimal, "{}", feature.name);
        let cost = outcome.plan.and_then(|plan| plan.cost).map_or(f64::NAN, |cost| cost.0);
        assert!((cost - feature.cost).abs() < 1e-9, "{}: cost {cost}", feature.name);
    }
}
