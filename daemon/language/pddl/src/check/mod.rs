//! Semantic checks: names, numbers of arguments, types, and the rules of PDDL that its grammar does
//! not express.
//!
//! - Each check takes a syntax tree, and returns all its mistakes in the order of the text.
//! - Each function checks one text against other texts that were checked before: `check_problem`
//!   does not report mistakes of the domain.
//! - The checks are lenient where existing files require it: requirements need not be declared, and
//!   facts may be repeated.
//! - The planner decides whether a goal can be reached and whether a plan is valid.

mod symbols;

mod declarations;

mod conditions;

mod effects;

mod axioms;

mod facts;

mod models;

mod plans;

use foldhash::{HashMap, HashSet};
use std::fmt;

use crate::diagnostic::{Diagnostic, DiagnosticList};
use crate::nearest::nearest;
use crate::tree::{
    ActionModel, Condition, Domain, FluentTerm, InitElement, Name, Plan, Problem, Typed,
};
use symbols::Symbols;

/// Checks a domain by itself.
pub fn check_domain(domain: &Domain) -> Vec<Diagnostic> {
    let symbols = Symbols::of_domain(domain);
    let mut checker = Checker::new(&symbols);
    checker.domain(domain);
    checker.problems.into_sorted()
}

/// Checks a problem against its domain.
pub fn check_problem(domain: &Domain, problem: &Problem) -> Vec<Diagnostic> {
    let symbols = Symbols::of_problem(domain, problem);
    let mut checker = Checker::new(&symbols);
    checker.problem(domain, problem, facts::UndeclaredSymbols::Spare);
    checker.problems.into_sorted()
}

/// Checks the map of a building against its domain. A fact of an undeclared predicate is an error
/// here, but not in [`check_problem`].
pub fn check_map(domain: &Domain, map: &Problem) -> Vec<Diagnostic> {
    let symbols = Symbols::of_problem(domain, map);
    let mut checker = Checker::new(&symbols);
    checker.problem(domain, map, facts::UndeclaredSymbols::Map);
    checker.problems.into_sorted()
}

/// Checks an action model against the ontology that it builds on.
///
/// Objects that neither the model nor the ontology declares are accepted with a hint, because the
/// map or another agent may declare them.
pub fn check_action_model(ontology: &Domain, model: &ActionModel) -> Vec<Diagnostic> {
    let symbols = Symbols::of_model(ontology, model);
    let mut checker = Checker::new(&symbols);
    checker.model(ontology, model);
    checker.problems.into_sorted()
}

/// Checks that every function in the metric of a problem has a value, from `:init` or from an
/// action. In a running ecosystem the value may come later, so [`check_problem`] does not require
/// it.
pub fn check_metric_values(domain: &Domain, problem: &Problem) -> Vec<Diagnostic> {
    let Some(metric) = &problem.metric else { return Vec::new() };
    if !domain.durative_actions.is_empty() {
        return Vec::new();
    }
    let is_missing = |fluent: &&FluentTerm| {
        let is_total_cost =
            fluent.function == crate::tree::TOTAL_COST && fluent.arguments.is_empty();
        let is_told = |element: &InitElement| matches!(element, InitElement::Assign(other, _) if other == *fluent);
        !is_total_cost
            && domain.functions.iter().any(|declared| declared.name == fluent.function)
            && !domain.actions.iter().any(|action| action.effect.assigns(&fluent.function))
            && !problem.init.iter().any(is_told)
    };
    let missing = metric.expression.fluents().filter(is_missing);
    let mistakes = missing.map(|fluent| {
        let message = format!("the metric reads `{fluent}`, which has no value");
        let help = format!("give it one in `:init`: `(= {fluent} NUMBER)`");
        Diagnostic::error(fluent.span, message).with_help(help)
    });
    mistakes.collect()
}

/// Checks a condition outside a problem, such as a goal from a user.
pub fn check_condition(
    domain: &Domain,
    problem: &Problem,
    condition: &Condition,
) -> Vec<Diagnostic> {
    let symbols = Symbols::of_problem(domain, problem);
    let mut checker = Checker::new(&symbols);
    checker.condition(condition);
    checker.problems.into_sorted()
}

/// Checks facts outside a problem, such as a change of the state by a user.
pub fn check_init_elements(
    domain: &Domain,
    problem: &Problem,
    elements: &[InitElement],
) -> Vec<Diagnostic> {
    let symbols = Symbols::of_problem(domain, problem);
    let mut checker = Checker::new(&symbols);
    checker.init(elements, facts::UndeclaredSymbols::Declared);
    checker.problems.into_sorted()
}

/// Checks the names in a plan, and the number and types of the arguments of its steps. Whether the
/// plan is valid is not checked.
pub fn check_plan(domain: &Domain, problem: &Problem, plan: &Plan) -> Vec<Diagnostic> {
    let symbols = Symbols::of_problem(domain, problem);
    let mut checker = Checker::new(&symbols);
    checker.plan(domain, plan);
    checker.problems.into_sorted()
}

/// Maximum number of name comparisons for suggestions in one text. After that no suggestions are
/// made, so that the time does not grow with the square of a text full of undeclared names.
const COMPARISONS_MAX: usize = 100_000;

/// State of a check: visits a tree and collects mistakes.
struct Checker<'s, 't> {
    symbols: &'s Symbols<'t>,
    problems: DiagnosticList,
    /// Variables in scope, the outermost first.
    scope: Vec<&'t Typed>,
    /// For each name: the positions in `scope` of the variables with this name, the outermost
    /// first.
    bound: HashMap<&'t str, Vec<usize>>,
    /// Types of the text on which the checked text builds, such as the domain of a problem.
    foreign_types: Option<&'t [Typed]>,
    /// Undeclared objects that other agents must declare and that have been reported already.
    reported_objects: HashSet<&'t str>,
    comparisons_left: usize,
}

// === impl Checker ===

impl<'s, 't> Checker<'s, 't> {
    fn new(symbols: &'s Symbols<'t>) -> Checker<'s, 't> {
        Checker {
            symbols,
            problems: DiagnosticList::default(),
            scope: Vec::new(),
            bound: HashMap::default(),
            foreign_types: None,
            reported_objects: HashSet::default(),
            comparisons_left: COMPARISONS_MAX,
        }
    }

    fn report(&mut self, diagnostic: Diagnostic) {
        self.problems.push(diagnostic);
    }

    /// Reports that a text names another domain. A name that is missing is a mistake of the text that
    /// lacks it, which the parser has reported.
    fn domain_name(&mut self, named: &'t Name, actual: &Name) {
        if named == actual || named.is_placeholder() || actual.is_placeholder() {
            return;
        }
        let message = format!("the domain is called `{actual}`");
        self.report(Diagnostic::warning(named.span(), message));
    }

    /// Returns the candidate that `word` most likely misspells; `None` if no candidate is near
    /// enough or the limit on comparisons is reached.
    fn nearest<'a>(
        &mut self,
        word: &str,
        candidates: impl IntoIterator<Item = &'a str>,
    ) -> Option<&'a str> {
        let left = &mut self.comparisons_left;
        let affordable = candidates.into_iter().take_while(|_| {
            *left = left.saturating_sub(1);
            *left > 0
        });
        nearest(word, affordable)
    }

    /// Runs `body` with `variables` in scope.
    fn with_scope(&mut self, variables: &'t [Typed], body: impl FnOnce(&mut Self)) {
        let outer = self.scope.len();
        for (index, variable) in variables.iter().enumerate() {
            self.bound.entry(variable.name.as_str()).or_default().push(outer + index);
        }
        self.scope.extend(variables);
        body(self);
        self.scope.truncate(outer);
        for variable in variables {
            self.bound.get_mut(variable.name.as_str()).map(Vec::pop);
        }
    }

    /// Returns the innermost variable in scope with this name; `None` if there is none.
    fn variable_in_scope(&self, name: &str) -> Option<&'t Typed> {
        self.bound.get(name)?.last().map(|index| self.scope[*index])
    }
}

/// Writes a number with its noun: “1 argument”, “2 arguments”.
pub fn count(number: usize, noun: &str) -> impl fmt::Display {
    let plural = if number == 1 { "" } else { "s" };
    format!("{number} {noun}{plural}")
}
