//! Compares the embedded planner with Fast Downward on small generated tasks.
//!
//! Both planners must agree on solvability, and on the cost if it is proved to be the least. Every
//! task is generated from its number, so that a failure can be reproduced.

use std::fmt::Write as _;

use engines::{Ending, EngineOptions, Installation, PlanningAim};
use planner::{Cancel, StopReason};

use crate::support::{PATIENCE, fast_downward, parse, run};

/// Number of tasks. Each kind of features occurs in a quarter of them.
const TASKS: u64 = 40;

/// Features that a generated task has in addition to STRIPS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Costs, and no other features.
    Strips,
    /// Negation, disjunction, quantifiers and equality.
    Adl,
    /// Conditional and universal effects, and costs that depend on objects.
    Conditional,
    /// Derived predicates that are recursive or negated.
    Derived,
}

const KINDS: [Kind; 4] = [Kind::Strips, Kind::Adl, Kind::Conditional, Kind::Derived];

/// Generator of tasks: random numbers from a seed (splitmix64), and the number of objects of the
/// task.
struct Dice {
    state: u64,
    objects: u64,
}

// === impl Dice ===

impl Dice {
    /// Creates a generator for a task with one to four objects. With one object, every variable has
    /// only one value, which tests nearly ground tasks.
    fn new(seed: u64) -> Dice {
        let mut dice = Dice { state: seed, objects: 1 };
        dice.objects = 1 + dice.below(4);
        dice
    }

    fn below(&mut self, bound: u64) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % bound
    }

    fn one_in(&mut self, bound: u64) -> bool {
        self.below(bound) == 0
    }

    /// Returns a random variable, or sometimes an object.
    fn term(&mut self, variables: u64) -> String {
        if variables > 0 && !self.one_in(4) {
            format!("?v{}", self.below(variables))
        } else {
            format!("o{}", self.below(self.objects))
        }
    }

    fn atom(&mut self, variables: u64) -> String {
        match self.below(7) {
            0 => "(z)".to_owned(),
            1..=2 => format!("(p {})", self.term(variables)),
            3..=4 => format!("(q {})", self.term(variables)),
            _ => format!("(r {} {})", self.term(variables), self.term(variables)),
        }
    }

    fn literal(&mut self, variables: u64, negative: u64) -> String {
        let is_negative = self.one_in(negative);
        let atom = self.atom(variables);
        if is_negative { format!("(not {atom})") } else { atom }
    }

    /// Returns one part of a condition as PDDL.
    fn part(&mut self, kind: Kind, variables: u64) -> String {
        let own = format!("?v{variables}");
        match (kind, self.below(6)) {
            (Kind::Strips, _) => self.atom(variables),
            (Kind::Derived, 0) => format!("(d {})", self.term(variables)),
            (Kind::Derived, 1) => format!("(not (d {}))", self.term(variables)),
            (Kind::Adl, 0) => {
                format!("(or {} {})", self.literal(variables, 3), self.literal(variables, 3))
            }
            (Kind::Adl, 1) => {
                format!("(exists ({own} - t) {})", self.literal(variables + 1, 4))
            }
            (Kind::Adl, 2) => {
                let (left, right) = (self.atom(variables + 1), self.atom(variables + 1));
                format!("(forall ({own}) (imply {left} {right}))")
            }
            (Kind::Adl, 3) if variables > 1 => "(not (= ?v0 ?v1))".to_owned(),
            _ => self.literal(variables, 4),
        }
    }

    fn conjunction(&mut self, kind: Kind, variables: u64, parts: u64) -> String {
        let parts: String = (0..parts).map(|_| self.part(kind, variables)).collect();
        format!("(and {parts})")
    }

    fn effect(&mut self, kind: Kind, variables: u64) -> String {
        match (kind, self.below(3)) {
            (Kind::Conditional, 0) => {
                format!("(when {} {})", self.literal(variables, 3), self.literal(variables, 3))
            }
            (Kind::Conditional, 1) => {
                let (when, then) = (self.literal(variables + 1, 3), self.literal(variables + 1, 3));
                format!("(forall (?v{variables} - t) (when {when} {then}))")
            }
            _ => self.literal(variables, 4),
        }
    }

    fn action(&mut self, kind: Kind, index: u64) -> String {
        let variables = 1 + self.below(2);
        let parameters: String = (0..variables).map(|variable| format!(" ?v{variable}")).collect();
        let parts = 1 + self.below(2);
        let precondition = self.conjunction(kind, variables, parts);
        let effects: String =
            (0..2 + self.below(2)).map(|_| self.effect(kind, variables)).collect();
        let cost = match kind {
            Kind::Conditional => "(weight ?v0)".to_owned(),
            _ => self.below(4).to_string(),
        };
        format!(
            "(:action a{index} :parameters ({parameters}) :precondition {precondition}
               :effect (and {effects} (increase (total-cost) {cost})))"
        )
    }

    /// Returns the texts of a generated domain and problem.
    fn task(&mut self, kind: Kind) -> (String, String) {
        let objects = (0..self.objects)
            .map(|index| format!("o{index} - {} ", if index < 2 { "t" } else { "object" }));
        let mut domain = format!(
            "(define (domain generated) (:types t) (:constants {})
            (:predicates (z) (p ?x) (q ?x) (r ?x ?y) (d ?x)) (:functions (total-cost) (weight ?x))",
            objects.collect::<String>()
        );
        if kind == Kind::Derived {
            let body = match self.below(3) {
                0 => "(or (q ?x) (exists (?y) (and (r ?x ?y) (d ?y))))",
                1 => "(exists (?y) (and (r ?x ?y) (not (q ?y))))",
                _ => "(forall (?y - t) (or (p ?y) (r ?x ?y)))",
            };
            let _ = write!(domain, "(:derived (d ?x) {body})");
        }
        for index in 0..4 + self.below(3) {
            domain += &self.action(kind, index);
        }
        let init: String = (0..2 + self.below(3)).map(|_| self.atom(0)).collect();
        let parts = 3 + self.below(2);
        let goal = self.conjunction(kind, 0, parts);
        let metric = if self.one_in(3) { "" } else { "(:metric minimize (total-cost))" };
        let weights = ["1", "0.5", "2", "0"].into_iter().enumerate().take(self.objects as usize);
        let weights = weights.map(|(index, weight)| format!("(= (weight o{index}) {weight}) "));
        let weights: String = weights.collect();
        let problem = format!(
            "(define (problem one) (:domain generated)
               (:init {init} {weights})
               (:goal {goal}) {metric})"
        );
        (domain + ")", problem)
    }
}

/// Returns the task with a number: the first of a series of generated tasks that the embedded
/// planner solves with more than one step. For every third number, returns the first task of the
/// series even without a plan, which most of them lack.
fn task(number: u64, kind: Kind) -> (String, String) {
    let wants_steps = !number.is_multiple_of(3);
    let tasks = (0..40).map(|attempt| Dice::new(number * 1_000 + attempt).task(kind));
    let takes_steps = |(domain, problem): &(String, String)| {
        let (domain, problem) = parse(domain, problem);
        let options = planner::Options::default();
        let outcome = planner::plan(&domain, &problem, &options, &Cancel::new());
        outcome.is_ok_and(|it| it.plan.is_some_and(|plan| plan.steps.len() > 1))
    };
    let mut tasks = tasks.skip_while(|task| wants_steps && !takes_steps(task));
    tasks.next().unwrap_or_else(|| Dice::new(number * 1_000).task(kind))
}

/// Plans for one task with both planners and compares their results. Returns the least cost and the
/// number of the plan's steps; `None` if there is no plan.
fn compare(installation: &Installation, number: u64) -> Option<(f64, usize)> {
    let kind = KINDS[usize::try_from(number).expect("small") % KINDS.len()];
    let (domain, problem) = task(number, kind);
    let told = format!("task {number}, {kind:?}:\n{domain}\n{problem}");
    let options = EngineOptions {
        aim: PlanningAim::CheapestPlan,
        time_limit: Some(PATIENCE),
        ..EngineOptions::default()
    };
    let theirs = run(installation, &domain, &problem, &options);
    let theirs = theirs.unwrap_or_else(|err| panic!("{err}\n{told}"));
    let (domain, problem) = parse(&domain, &problem);
    let ours = planner::plan(&domain, &problem, &planner::Options::default(), &Cancel::new());
    let ours = ours.unwrap_or_else(|err| panic!("{err}\n{told}"));
    match (ours.plan, theirs.plan) {
        (None, None) => {
            assert!(matches!(ours.stop_reason, StopReason::Unsolvable { .. }), "{told}");
            assert!(matches!(theirs.ending, Ending::Unsolvable { .. }), "{told}");
            None
        }
        (Some(our_plan), Some(their_plan)) => {
            assert!(theirs.proven_optimal && ours.statistics.proven_optimal, "{told}");
            let cost = |plan: &pddl::Plan| plan.cost.map_or(f64::NAN, |cost| cost.0);
            let (ours, theirs) = (cost(&our_plan), cost(&their_plan));
            assert!((ours - theirs).abs() < 1e-9, "ours {ours}, theirs {theirs}\n{told}");
            Some((ours, our_plan.steps.len()))
        }
        (ours, theirs) => {
            panic!("ours: {}, theirs: {}\n{told}", ours.is_some(), theirs.is_some())
        }
    }
}

#[test]
fn fast_downward_and_the_embedded_planner_agree() {
    agree(0..TASKS);
}

/// This test takes one or two hours: `cargo test --release -p engines --test it ten_thousand --
/// --ignored --nocapture`.
#[test]
#[ignore = "takes an hour or two"]
fn fast_downward_and_the_embedded_planner_agree_on_ten_thousand_tasks() {
    agree(0..10_000);
}

/// Compares the results of both planners for the tasks with these numbers.
fn agree(numbers: std::ops::Range<u64>) {
    let Some(installation) = fast_downward() else { return };
    let tasks = usize::try_from(numbers.end - numbers.start).expect("small");
    let answers: Vec<_> = numbers.map(|number| compare(&installation, number)).collect();
    // The test is only meaningful if not all tasks are trivial or unsolvable.
    let solvable = answers.iter().flatten().count();
    let long = answers.iter().flatten().filter(|(_, steps)| *steps > 1).count();
    let figures = format!("{solvable} of {tasks} solvable, {long} in more than one step");
    let is_mixed = solvable * 3 >= tasks && (tasks - solvable) * 5 >= tasks && long * 4 >= tasks;
    assert!(is_mixed, "{figures}");
    eprintln!("{figures}");
}
