//! How long a building waits for an answer: from texts to a validated plan, and parts of that way.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;

use planner::{Cancel, Options, order, plan, validate};

const DOMAIN: &str = include_str!("office/domain.pddl");
const PROBLEM: &str = include_str!("office/problem.pddl");

fn office(criterion: &mut Criterion) {
    let parse = || {
        let domain = pddl::parse_domain(DOMAIN).into_result();
        let problem = pddl::parse_problem(PROBLEM).into_result();
        domain.and_then(|domain| Ok((domain, problem?)))
    };
    let (domain, problem) = parse().expect("the office parses");
    let (options, cancel) = (Options::default(), Cancel::new());
    let answer = || plan(&domain, &problem, &options, &cancel);
    let found = answer().expect("the office is supported").plan.expect("the office has a plan");
    let mut group = criterion.benchmark_group("office");
    group.bench_function("texts to validated plan", |bencher| {
        bencher.iter(|| {
            let (domain, problem) = parse().expect("the office parses");
            black_box(plan(&domain, &problem, &options, &cancel))
        });
    });
    group.bench_function("trees to validated plan", |bencher| bencher.iter(|| black_box(answer())));
    group.bench_function("validate", |bencher| {
        bencher.iter(|| black_box(validate::validate(&domain, &problem, &found)));
    });
    group.bench_function("deorder", |bencher| {
        bencher.iter(|| black_box(order::deorder(&domain, &problem, &found)));
    });
    group.finish();
}

criterion_group!(benches, office);
criterion_main!(benches);
