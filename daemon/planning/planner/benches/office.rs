//! Measures the time from texts to a validated plan, and the times of its parts.
//!
//! - `office/` is a small task for measuring the parts: parse, ground, search, validate, deorder.
//! - `floor` is a task on which hill climbing fails: a floor must be painted in the right order.
//! - `scenarios` are the goals of the paper's scenarios in a whole office. `replans` are the same
//!   after a change, with a planner that has planned before. `latency.rs` measures the 99th
//!   percentiles of both.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;

use planner::{Cancel, Options, Replanner, order, plan, prepare, validate};

mod scenarios;

use scenarios::{SCENARIOS, events, parse};

const DOMAIN: &str = include_str!("office/domain.pddl");
const PROBLEM: &str = include_str!("office/problem.pddl");

fn all_scenarios(criterion: &mut Criterion) {
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut group = criterion.benchmark_group("scenarios");
    for (name, domain, problem) in SCENARIOS {
        let answer = || {
            let (domain, problem) = parse(domain, problem);
            plan(&domain, &problem, &options, &cancel).expect("it is supported")
        };
        assert!(answer().plan.is_some(), "{name} has a plan");
        group.bench_function(name, |bencher| bencher.iter(|| black_box(answer())));
    }
    group.finish();
    let mut group = criterion.benchmark_group("replans");
    for (name, domain, problem) in SCENARIOS {
        let (domain, problem) = parse(domain, problem);
        let (events, mut replanner) = (events(&problem), Replanner::default());
        let mut next = events.iter().cycle();
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let problem = next.next().unwrap_or(&problem);
                black_box(replanner.plan(&domain, problem, &[], &options, &cancel))
            });
        });
    }
    group.finish();
}

fn office(criterion: &mut Criterion) {
    let (domain, problem) = parse(DOMAIN, PROBLEM);
    let (options, cancel) = (Options::default(), Cancel::new());
    let answer = || plan(&domain, &problem, &options, &cancel);
    let found = answer().expect("the office is supported").plan.expect("the office has a plan");
    let mut group = criterion.benchmark_group("office");
    group.bench_function("texts to validated plan", |bencher| {
        bencher.iter(|| {
            let (domain, problem) = parse(DOMAIN, PROBLEM);
            black_box(plan(&domain, &problem, &options, &cancel))
        });
    });
    group.bench_function("parse", |bencher| bencher.iter(|| black_box(parse(DOMAIN, PROBLEM))));
    group.bench_function("ground", |bencher| {
        bencher.iter(|| {
            let prepared = prepare(&domain, &problem).expect("the office is supported");
            black_box(prepared.ground(options.budget, &cancel))
        });
    });
    group.bench_function("trees to validated plan", |bencher| bencher.iter(|| black_box(answer())));
    group.bench_function("validate", |bencher| {
        bencher.iter(|| black_box(validate::validate(&domain, &problem, &found)));
    });
    group.bench_function("deorder", |bencher| {
        let world = validate::World::initial(&domain, &problem).expect("the office makes sense");
        bencher.iter(|| black_box(order::deorder(&world, &found.steps)));
    });
    group.finish();
}

const FLOOR: &str = "(define (domain floor)
  (:predicates (at ?r ?x) (clear ?x) (painted ?x) (up ?x ?y) (right ?x ?y) (robot ?r))
  (:action walk :parameters (?r ?x ?y)
    :precondition (and (robot ?r) (at ?r ?x) (clear ?y)
      (or (up ?x ?y) (up ?y ?x) (right ?x ?y) (right ?y ?x)))
    :effect (and (not (at ?r ?x)) (clear ?x) (at ?r ?y) (not (clear ?y))))
  (:action paint :parameters (?r ?x ?y)
    :precondition (and (robot ?r) (at ?r ?x) (clear ?y) (or (up ?x ?y) (up ?y ?x)))
    :effect (and (painted ?y) (not (clear ?y)))))";

/// Returns a task with a floor of this size, in which all cells outside the first row must be
/// painted. Two robots paint adjacent cells, and cannot move onto painted cells.
fn floor(rows: usize, columns: usize) -> String {
    let tile = |row: usize, column: usize| format!("t{row}-{column}");
    let (mut objects, mut init, mut goal) = (String::new(), String::new(), String::new());
    for row in 0..rows {
        for column in 0..columns {
            let this = tile(row, column);
            objects += &format!(" {this}");
            if row > 0 {
                init += &format!(" (up {} {this}) (clear {this})", tile(row - 1, column));
                goal += &format!(" (painted {this})");
            } else if column > 1 {
                init += &format!(" (clear {this})");
            }
            if column > 0 {
                init += &format!(" (right {} {this})", tile(row, column - 1));
            }
        }
    }
    format!(
        "(define (problem p) (:domain floor) (:objects one other{objects})
           (:init (robot one) (robot other) (at one t0-0) (at other t0-1){init})
           (:goal (and{goal})))"
    )
}

fn search(criterion: &mut Criterion) {
    let domain = pddl::parse_domain(FLOOR).into_result().expect("it parses");
    let problem = pddl::parse_problem(&floor(5, 4)).into_result().expect("it parses");
    let (options, cancel) = (Options::default(), Cancel::new());
    let answer = || plan(&domain, &problem, &options, &cancel).expect("it is supported");
    assert!(answer().plan.is_some(), "the floor can be painted");
    let mut group = criterion.benchmark_group("floor");
    group.sample_size(20);
    group.bench_function("trees to validated plan", |bencher| bencher.iter(|| black_box(answer())));
    group.finish();
}

criterion_group!(benches, office, all_scenarios, search);
criterion_main!(benches);
