//! Tests of the planner through its public interface, from texts to results.

mod agreement;
mod brute_force;
mod conformance;
mod explaining;
mod goals;
mod merging;
mod numbers;
mod oddities;
mod office;
mod optimality;
mod ordering;
mod plain;
mod replanning;
mod rounding;
mod simulation;
mod simulator;
mod spoiled;
mod stopping;
mod support;
mod validation;
mod wide;
