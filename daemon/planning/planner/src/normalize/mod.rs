//! Normalization: converts syntax trees to the lifted task, which is the input of grounding.
//!
//! - Names become numbers, conditions are converted to negation normal form, and effects to flat
//!   lists.
//! - Features that this planner does not support are rejected here, with name and place.
//! - `ground` handles static facts, quantifiers and disjunctions, because these require the
//!   reachable facts.

mod effects;
mod formula;
pub(crate) mod lifted;
mod metric;
mod piecewise;
mod quantifiers;
mod strata;
mod symbols;
mod wide;

use pddl::{Assignment, Diagnostic, Domain, InitElement, Problem};

use self::formula::FormulaScope;
use self::lifted::{Closed, Lifted, LiftedAxiom, LiftedNumeric, LiftedSchema, LiftedTerm};
pub(crate) use self::piecewise::{Piecewise, is_wide};
pub(crate) use self::symbols::SymbolTable;
pub(crate) use self::wide::split_wide;
use crate::outcome::{InputText, PlanError, Unsupported};
use crate::task::ObjectId;

/// Normalizes a domain and a problem. Returns an error if they use an unsupported feature or
/// contain mistakes.
pub(crate) fn normalize(domain: &Domain, problem: &Problem) -> Result<Lifted, PlanError> {
    let mut symbols = SymbolTable::default();
    let lifted = lift(&mut symbols, domain, problem)?;
    let SymbolTable { objects, predicates, functions, types, .. } = symbols;
    Ok(Lifted { objects, predicates, functions, types, ..lifted })
}

/// Does the same as [`normalize`]. Also returns the symbol table, so that texts can be converted
/// with the same numbers afterwards.
pub(crate) fn normalize_named(
    domain: &Domain,
    problem: &Problem,
) -> Result<(Lifted, SymbolTable), PlanError> {
    let mut symbols = SymbolTable::default();
    let lifted = lift(&mut symbols, domain, problem)?;
    let SymbolTable { objects, predicates, functions, types, .. } = symbols.clone();
    Ok((Lifted { objects, predicates, functions, types, ..lifted }, symbols))
}

/// Normalizes all parts of a task, except those that stay in the symbol table.
fn lift(
    symbols: &mut SymbolTable,
    domain: &Domain,
    problem: &Problem,
) -> Result<Lifted, PlanError> {
    refuse_nonclassical(domain, problem)?;
    *symbols = SymbolTable::new(domain, problem);
    let mut schemas = Vec::with_capacity(domain.actions.len());
    for action in &domain.actions {
        let schema = effects::schema(symbols, action);
        bound_frame(&schema.frame, "action", action.span, InputText::Domain)?;
        schemas.push(schema);
    }
    let mut axioms = axioms(symbols, domain);
    for (axiom, derived) in axioms.iter().zip(&domain.derived) {
        bound_frame(&axiom.frame, "axiom", derived.span, InputText::Domain)?;
    }
    let goal = closed(symbols, &problem.goal);
    bound_frame(&goal.frame, "goal", pddl::Span::default(), InputText::Problem)?;
    mark_predicates(symbols, &schemas, &axioms);
    mark_functions(symbols, &schemas, &axioms, &goal);
    let mut costs = metric::costs(symbols, problem, &schemas)?;
    metric::note_variation(&mut costs, &schemas, &symbols.functions);
    let (init, values) = (initial_facts(symbols, problem), initial_values(symbols, problem));
    reject_derived_changes(symbols, domain, problem);
    if let Err(problem) = strata::assign(&mut axioms, domain) {
        symbols.problems.push(*problem);
    }
    if !symbols.problems.is_empty() {
        return Err(PlanError::BadInput(std::mem::take(&mut symbols.problems)));
    }
    Ok(Lifted { schemas, axioms, goal, init, values, costs, ..Lifted::default() })
}

/// Maximum number of variables of one action, axiom or goal, including those of its quantifiers; a
/// text with more is unsupported. Every binding has an entry for each variable. Texts written by
/// people have less than a hundredth of this number.
const VARIABLES_MAX: usize = 10_000;

fn bound_frame(
    frame: &[lifted::TypeIndex],
    what: &str,
    span: pddl::Span,
    text: InputText,
) -> Result<(), Unsupported> {
    if frame.len() <= VARIABLES_MAX {
        return Ok(());
    }
    let article = if what == "goal" { "a" } else { "an" };
    let feature = format!("{article} {what} with more than {VARIABLES_MAX} variables");
    Err(Unsupported { feature, span, text })
}

/// Normalizes a condition without parameters, such as a goal, over the objects of a problem.
pub(crate) fn closed(symbols: &mut SymbolTable, condition: &pddl::Condition) -> Closed {
    let mut scope = FormulaScope::new(symbols, []);
    let formula = scope.rearranged(condition);
    Closed { frame: scope.frame, formula }
}

/// Checks that the texts use no feature that both this planner and the engines lack: durative
/// actions, timed initial literals, observations, or unknown facts. In a running ecosystem,
/// observations and unknown facts are compiled away before planning (`pddl::knowledge`).
///
/// # Errors
///
/// Returns the first such feature as an error.
pub fn refuse_nonclassical(domain: &Domain, problem: &Problem) -> Result<(), Unsupported> {
    if let Some(action) = domain.durative_actions.first() {
        return Err(Unsupported::in_domain("durative actions", action.span));
    }
    if let Some(later) = problem.timed_literal() {
        return Err(Unsupported::in_problem("timed initial literals", later.span()));
    }
    let mut observed = domain.actions.iter().flat_map(|action| &action.observe);
    if let Some(observed) = observed.next() {
        return Err(Unsupported::in_domain("observations", observed.span));
    }
    match problem.unknown_fact() {
        Some(unknown) => Err(Unsupported::in_problem("unknown facts", unknown.span())),
        None => Ok(()),
    }
}

fn axioms(symbols: &mut SymbolTable, domain: &Domain) -> Vec<LiftedAxiom> {
    let mut axioms = Vec::new();
    for derived in &domain.derived {
        let head = symbols.predicate(&derived.predicate, derived.parameters.len());
        let mut scope = FormulaScope::new(symbols, &derived.parameters);
        let body = scope.rearranged(&derived.condition);
        let (frame, parameter_count) = (scope.frame, derived.parameters.len());
        let Some(head) = head else { continue };
        axioms.push(LiftedAxiom { head, parameter_count, frame, body, stratum: 0 });
    }
    axioms
}

fn mark_predicates(symbols: &mut SymbolTable, schemas: &[LiftedSchema], axioms: &[LiftedAxiom]) {
    for effect in schemas.iter().flat_map(|schema| &schema.effects) {
        let predicate = &mut symbols.predicates[effect.atom.predicate];
        predicate.added |= effect.adds;
        predicate.deleted |= !effect.adds;
    }
    for axiom in axioms {
        symbols.predicates[axiom.head].derived = true;
    }
}

/// Finds the functions that change, and the functions with values that must be part of the state.
/// The latter are the functions in conditions, and the functions from which effects compute the
/// values of these.
fn mark_functions(
    symbols: &mut SymbolTable,
    schemas: &[LiftedSchema],
    axioms: &[LiftedAxiom],
    goal: &Closed,
) {
    let functions = &mut symbols.functions;
    for change in schemas.iter().flat_map(|schema| &schema.numeric) {
        functions[change.fluent.function].changed = true;
    }
    let mut read = Vec::new();
    {
        let mut visit = |function| read.push(function);
        goal.formula.functions(&mut visit);
        axioms.iter().for_each(|axiom| axiom.body.functions(&mut visit));
        for schema in schemas {
            schema.precondition.functions(&mut visit);
            schema.effects.iter().for_each(|effect| effect.condition.functions(&mut visit));
            for change in &schema.numeric {
                change.condition.functions(&mut visit);
                // An action is applicable only if this value is defined.
                change.value.functions(&mut visit);
            }
        }
    }
    read.into_iter().for_each(|function| functions[function].read = true);
    // One action assigns the fluent and another increases it, so whether it is defined is part of
    // the state.
    let changes = || schemas.iter().flat_map(|schema| &schema.numeric);
    for defining in changes().filter(|one| one.assignment == Assignment::Assign) {
        let function = defining.fluent.function;
        let adjusts = |one: &&LiftedNumeric| one.assignment != Assignment::Assign;
        if changes().filter(adjusts).any(|one| one.fluent.function == function) {
            functions[function].read = true;
        }
    }
}

/// Returns the true facts of `:init`. Each entry is the number of the predicate and the arguments.
fn initial_facts(symbols: &mut SymbolTable, problem: &Problem) -> Vec<(usize, Vec<ObjectId>)> {
    let mut scope = FormulaScope::new(symbols, []);
    let fact = |element: &InitElement| match element {
        // Facts of unknown predicates are skipped, like values of unknown functions.
        InitElement::Atom(atom) if scope.symbols.has_predicate(&atom.predicate) => {
            scope.atom(atom).map(|atom| (atom.predicate, ground(&atom.arguments)))
        }
        _ => None,
    };
    problem.init.iter().filter_map(fact).collect()
}

/// Returns the initial values of functions in `:init`. Each entry is the number of the function,
/// the arguments and the value.
pub(crate) fn initial_values(
    symbols: &mut SymbolTable,
    problem: &Problem,
) -> Vec<(usize, Vec<ObjectId>, f64)> {
    let mut scope = FormulaScope::new(symbols, []);
    let value = |element: &InitElement| match element {
        // Competition problems contain values of undeclared functions, about which `check` warns.
        InitElement::Assign(fluent, number) if scope.symbols.has_function(&fluent.function) => {
            let fluent = scope.fluent(fluent)?;
            Some((fluent.function, ground(&fluent.arguments), number.0))
        }
        _ => None,
    };
    problem.init.iter().filter_map(value).collect()
}

/// Returns the objects of an argument list without variables.
fn ground(terms: &[LiftedTerm]) -> Vec<ObjectId> {
    let object = |term: &LiftedTerm| match term {
        LiftedTerm::Object(object) => Some(*object),
        LiftedTerm::Variable(_) => None,
    };
    terms.iter().filter_map(object).collect()
}

fn reject_derived_changes(symbols: &mut SymbolTable, domain: &Domain, problem: &Problem) {
    for predicate in &symbols.predicates {
        if predicate.derived && (predicate.added || predicate.deleted) {
            let message = format!("an action changes `{}`, which an axiom derives", predicate.name);
            symbols.problems.push(Diagnostic::error(predicate.name.span(), message));
        }
    }
    for element in &problem.init {
        let InitElement::Atom(atom) = element else { continue };
        if domain.derived.iter().any(|axiom| axiom.predicate == atom.predicate) {
            let message = format!("`{}` is derived, so it cannot stand in :init", atom.predicate);
            symbols.problems.push(Diagnostic::error(atom.span, message));
        }
    }
}
