//! The planner from outside: texts in, verdicts out.

mod agreement;
mod brute_force;
mod conformance;
mod explaining;
mod goals;
mod numbers;
mod oddities;
mod office;
mod optimality;
mod ordering;
mod plain;
mod replanning;
mod simulation;
mod simulator;
mod spoiled;
mod stopping;
mod support;
mod validation;
mod wide;
