//! Names that every engine can read, and the translation back to the task's own names.
//!
//! The object `Büro@2` becomes `o-b-ro-2`; the action `move` becomes `a-move`. The letter before
//! the name separates kinds of names that engines confuse, such as types and predicates, and avoids
//! the engines' keywords. All names are in lower case, because some engines print lower case and
//! others upper case. Names that become equal are numbered.
//!
//! This pass also makes three other changes. Every variable gets a unique name, so that no variable
//! hides another. Effects nested in conditional effects are moved out. Repeated facts are removed.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use pddl::{
    ActionSchema, Assign, Atom, Compare, Condition, Derived, Domain, Effect, Expression,
    FluentTerm, InitElement, Name, Plan, PlanStep, Problem, TOTAL_COST, Term, TypeExpr, Typed,
};

use super::task_parts;

/// Number of characters that are kept of a long name.
const LENGTH_MAX: usize = 40;

/// Kind of a named element. Elements of different kinds may have the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum SymbolKind {
    Type,
    Object,
    Predicate,
    Function,
    Action,
}

/// The names of a task in the engine's dialect, each with the task's own name.
#[derive(Debug, Default)]
pub(crate) struct EngineNames {
    forth: BTreeMap<(SymbolKind, Name), Name>,
    /// The task's own names of actions and objects, by their names in the dialect. Only these names
    /// occur in plans.
    back: BTreeMap<String, Name>,
    taken: BTreeSet<String>,
}

/// Gives everything in the task a name that every engine can read, and returns these names.
pub(super) fn lower(domain: &mut Domain, problem: &mut Problem) -> EngineNames {
    let mut names = EngineNames::default();
    (domain.name, problem.domain, problem.name) = ("d".into(), "d".into(), "p".into());
    problem.requirements.clear();
    domain.types.iter_mut().for_each(|typed| names.typed(SymbolKind::Type, typed));
    domain.constants.iter_mut().for_each(|typed| names.typed(SymbolKind::Object, typed));
    let constants: HashSet<Name> = domain.constants.iter().map(|it| it.name.clone()).collect();
    let objects = Arc::make_mut(&mut problem.objects);
    objects.iter_mut().for_each(|it| names.typed(SymbolKind::Object, &mut it.object));
    // Engines reject an object that is declared twice.
    let mut said = constants;
    objects.retain(|it| said.insert(it.object.name.clone()));
    for predicate in &mut domain.predicates {
        predicate.name = names.of(SymbolKind::Predicate, &predicate.name);
        plain(&mut predicate.parameters);
    }
    for function in &mut domain.functions {
        function.name = names.function(&function.name, function.parameters.len());
        plain(&mut function.parameters);
    }
    let actions = std::mem::take(&mut domain.actions);
    domain.actions = actions.iter().filter_map(|action| names.action(action)).collect();
    let derived = std::mem::take(&mut domain.derived);
    domain.derived = derived.iter().map(|axiom| names.axiom(axiom)).collect();
    problem.goal = VariableScope::new(&mut names).condition(&problem.goal);
    problem.init = names.init(problem);
    if let Some(metric) = &mut problem.metric {
        metric.expression = VariableScope::new(&mut names).expression(&metric.expression);
    }
    names
}

/// Renames the parameters of a declared predicate or function to `x1`, `x2`, …, because only their
/// number matters.
fn plain(parameters: &mut [Typed]) {
    for (index, parameter) in parameters.iter_mut().enumerate() {
        parameter.name = Name::new(&format!("x{}", index + 1));
    }
}

// === impl EngineNames ===

impl EngineNames {
    /// Returns a plan with the task's own names. Returns an error with the name if the plan
    /// contains a name that the task does not have.
    pub(crate) fn restore_names(&self, plan: Plan) -> Result<Plan, String> {
        let raise = |name: &Name| {
            self.back.get(name.as_str()).cloned().ok_or_else(|| name.spelled().to_owned())
        };
        let steps = plan.steps.iter().map(|step| {
            let arguments = step.arguments.iter().map(raise).collect::<Result<Vec<_>, _>>()?;
            Ok(PlanStep::new(raise(&step.action)?, arguments))
        });
        Ok(Plan { steps: steps.collect::<Result<_, String>>()?, cost: None })
    }

    fn of(&mut self, kind: SymbolKind, name: &Name) -> Name {
        let key = (kind, name.clone());
        if let Some(known) = self.forth.get(&key) {
            return known.clone();
        }
        let fresh = self.fresh(kind, name);
        self.forth.insert(key, fresh.clone());
        fresh
    }

    fn function(&mut self, name: &Name, arity: usize) -> Name {
        // The only name that has a meaning for engines.
        if *name == TOTAL_COST && arity == 0 {
            name.clone()
        } else {
            self.of(SymbolKind::Function, name)
        }
    }

    /// Returns a new unique name for the dialect, derived from the task's own `name`.
    fn fresh(&mut self, kind: SymbolKind, name: &Name) -> Name {
        let letter = match kind {
            SymbolKind::Type => 't',
            SymbolKind::Object => 'o',
            SymbolKind::Predicate => 'p',
            SymbolKind::Function => 'f',
            SymbolKind::Action => 'a',
        };
        let body: String = name.as_str().chars().take(LENGTH_MAX).map(readable).collect();
        let base = format!("{letter}-{body}");
        let numbered = (2..).map(|number| format!("{base}-{number}"));
        let mut candidates = std::iter::once(base.clone()).chain(numbered);
        let free = candidates.find(|candidate| !self.taken.contains(candidate));
        let free = free.expect("invariant: there are endless candidates");
        self.taken.insert(free.clone());
        if matches!(kind, SymbolKind::Object | SymbolKind::Action) {
            self.back.insert(free.clone(), name.clone());
        }
        Name::spanned(&free, name.span())
    }

    fn typed(&mut self, kind: SymbolKind, typed: &mut Typed) {
        typed.name = self.of(kind, &typed.name);
        typed.ty = self.type_expr(&typed.ty);
    }

    fn type_expr(&mut self, ty: &TypeExpr) -> TypeExpr {
        if ty.is_object() {
            return TypeExpr::of("object");
        }
        let alternatives =
            ty.alternatives.iter().map(|name| self.of(SymbolKind::Type, name)).collect();
        TypeExpr { alternatives }
    }

    /// Returns an action with new names; `None` if the action changes nothing, because no plan
    /// needs such an action and engines fail on it.
    fn action(&mut self, action: &ActionSchema) -> Option<ActionSchema> {
        // Actions with the same name get different names.
        let name = self.fresh(SymbolKind::Action, &action.name);
        let mut scope = VariableScope::new(self);
        let parameters = scope.declare(&action.parameters);
        let precondition = scope.condition(&action.precondition);
        let effect = flat(scope.effect(&action.effect));
        let changes = effect.parts().any(is_change);
        let (partners, observe) = (Vec::new(), Vec::new());
        let (agent, span) = (None, action.span);
        let lowered =
            ActionSchema { name, agent, partners, parameters, precondition, effect, observe, span };
        changes.then_some(lowered)
    }

    fn axiom(&mut self, axiom: &Derived) -> Derived {
        let predicate = self.of(SymbolKind::Predicate, &axiom.predicate);
        let mut scope = VariableScope::new(self);
        let parameters = scope.declare(&axiom.parameters);
        let condition = scope.condition(&axiom.condition);
        Derived { predicate, parameters, condition, span: axiom.span }
    }

    /// Returns the elements of `:init` with new names: each true fact once, and each assigned
    /// fluent with its last value.
    fn init(&mut self, problem: &Problem) -> Vec<InitElement> {
        let values = task_parts::values(problem);
        let mut said = HashSet::new();
        let mut scope = VariableScope::new(self);
        let elements = problem.init.iter().filter_map(|element| match element {
            InitElement::Atom(atom) => Some(InitElement::Atom(scope.atom(atom))),
            InitElement::Assign(fluent, _) => {
                let number = pddl::Number(values[&task_parts::ground(fluent)]);
                Some(InitElement::Assign(scope.fluent(fluent), number))
            }
            InitElement::Not(_) | InitElement::Unknown(_) | InitElement::At(..) => None,
        });
        elements.filter(|element| said.insert(element.clone())).collect()
    }
}

fn readable(c: char) -> char {
    if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }
}

fn is_change(effect: &Effect) -> bool {
    match effect {
        Effect::Add(_) | Effect::Delete(_) => true,
        Effect::Assign(assign) => assign.fluent.function != TOTAL_COST,
        Effect::And(_) | Effect::When(..) | Effect::Forall(..) => false,
    }
}

/// Variables that are in scope at one place of a task.
struct VariableScope<'n> {
    names: &'n mut EngineNames,
    visible: Vec<(Name, Name)>,
    taken: BTreeSet<String>,
}

// === impl VariableScope ===

impl<'n> VariableScope<'n> {
    fn new(names: &'n mut EngineNames) -> VariableScope<'n> {
        VariableScope { names, visible: Vec::new(), taken: BTreeSet::new() }
    }

    fn declare(&mut self, variables: &[Typed]) -> Vec<Typed> {
        let declared = variables.iter().map(|variable| {
            let body: String =
                variable.name.as_str().chars().take(LENGTH_MAX).map(readable).collect();
            let base = format!("v-{body}");
            let numbered = (2..).map(|number| format!("{base}-{number}"));
            let mut candidates = std::iter::once(base.clone()).chain(numbered);
            let free = candidates.find(|candidate| self.taken.insert(candidate.clone()));
            let free = free.expect("invariant: there are endless candidates");
            let name = Name::spanned(&free, variable.name.span());
            self.visible.push((variable.name.clone(), name.clone()));
            Typed { name, ty: self.names.type_expr(&variable.ty) }
        });
        declared.collect()
    }

    fn within<T>(
        &mut self,
        variables: &[Typed],
        inner: impl FnOnce(&mut Self) -> T,
    ) -> (Vec<Typed>, T) {
        let outside = self.visible.len();
        let declared = self.declare(variables);
        let inner = inner(self);
        self.visible.truncate(outside);
        (declared, inner)
    }

    fn condition(&mut self, condition: &Condition) -> Condition {
        let each = |scope: &mut Self, parts: &[Condition]| {
            parts.iter().map(|part| scope.condition(part)).collect()
        };
        match condition {
            Condition::Atom(atom) => Condition::Atom(self.atom(atom)),
            Condition::Equal(left, right, span) => {
                Condition::Equal(self.term(left), self.term(right), *span)
            }
            Condition::Compare(compare) => Condition::Compare(Box::new(Compare {
                comparison: compare.comparison,
                left: self.expression(&compare.left),
                right: self.expression(&compare.right),
                span: compare.span,
            })),
            Condition::Not(inner) => Condition::Not(Box::new(self.condition(inner))),
            Condition::And(parts) => Condition::And(each(self, parts)),
            Condition::Or(parts) => Condition::Or(each(self, parts)),
            Condition::Imply(left, right) => {
                let left = self.condition(left);
                Condition::Imply(Box::new(left), Box::new(self.condition(right)))
            }
            Condition::Exists(variables, inner) | Condition::Forall(variables, inner)
                if variables.is_empty() =>
            {
                self.condition(inner)
            }
            Condition::Exists(variables, inner) => {
                let (declared, inner) = self.within(variables, |scope| scope.condition(inner));
                Condition::Exists(declared, Box::new(inner))
            }
            Condition::Forall(variables, inner) => {
                let (declared, inner) = self.within(variables, |scope| scope.condition(inner));
                Condition::Forall(declared, Box::new(inner))
            }
        }
    }

    fn effect(&mut self, effect: &Effect) -> Effect {
        match effect {
            Effect::And(parts) => Effect::And(parts.iter().map(|part| self.effect(part)).collect()),
            Effect::Add(atom) => Effect::Add(self.atom(atom)),
            Effect::Delete(atom) => Effect::Delete(self.atom(atom)),
            Effect::Assign(assign) => Effect::Assign(Box::new(Assign {
                assignment: assign.assignment,
                fluent: self.fluent(&assign.fluent),
                value: self.expression(&assign.value),
                span: assign.span,
            })),
            Effect::When(condition, inner) => {
                let condition = self.condition(condition);
                Effect::When(Box::new(condition), Box::new(self.effect(inner)))
            }
            Effect::Forall(variables, inner) => {
                let (declared, inner) = self.within(variables, |scope| scope.effect(inner));
                Effect::Forall(declared, Box::new(inner))
            }
        }
    }

    fn expression(&mut self, expression: &Expression) -> Expression {
        expression.map_fluents(&mut |fluent| self.fluent(fluent))
    }

    fn atom(&mut self, atom: &Atom) -> Atom {
        let predicate = self.names.of(SymbolKind::Predicate, &atom.predicate);
        Atom { predicate, arguments: self.terms(&atom.arguments), span: atom.span }
    }

    fn fluent(&mut self, fluent: &FluentTerm) -> FluentTerm {
        let function = self.names.function(&fluent.function, fluent.arguments.len());
        FluentTerm { function, arguments: self.terms(&fluent.arguments), span: fluent.span }
    }

    fn terms(&mut self, terms: &[Term]) -> Vec<Term> {
        terms.iter().map(|term| self.term(term)).collect()
    }

    fn term(&mut self, term: &Term) -> Term {
        match term {
            Term::Object(name) => Term::Object(self.names.of(SymbolKind::Object, name)),
            Term::Variable(name) => {
                let found = self.visible.iter().rev().find(|(visible, _)| visible == name);
                let found = found.map(|(_, fresh)| fresh.clone());
                Term::Variable(found.expect("invariant: `check` has seen every variable declared"))
            }
        }
    }
}

/// Returns an effect without nesting in `when`. The result is a conjunction of literals and numeric
/// changes, grouped by the `forall`s and `when`s around them. The grammar of PDDL forbids nesting
/// in `when`, and some engines enforce this rule.
fn flat(effect: Effect) -> Effect {
    let mut groups = Vec::new();
    flatten(effect, &mut Vec::new(), &mut Vec::new(), &mut groups);
    Effect::And(groups)
}

fn flatten(
    effect: Effect,
    variables: &mut Vec<Typed>,
    conditions: &mut Vec<Condition>,
    groups: &mut Vec<Effect>,
) {
    let mut leaves = Vec::new();
    let mut open = vec![effect];
    let mut nested = Vec::new();
    while let Some(effect) = open.pop() {
        match effect {
            Effect::And(parts) => open.extend(parts.into_iter().rev()),
            Effect::When(..) | Effect::Forall(..) => nested.push(effect),
            leaf => leaves.push(leaf),
        }
    }
    match (conditions.is_empty(), variables.is_empty()) {
        _ if leaves.is_empty() => (),
        (true, true) => groups.extend(leaves),
        _ => groups.push(wrapped(leaves, variables, conditions)),
    }
    for effect in nested {
        match effect {
            Effect::When(condition, inner) => {
                conditions.push(*condition);
                flatten(*inner, variables, conditions, groups);
                conditions.pop();
            }
            Effect::Forall(more, inner) => {
                let outside = variables.len();
                variables.extend(more);
                flatten(*inner, variables, conditions, groups);
                variables.truncate(outside);
            }
            _ => (),
        }
    }
}

/// Returns `(forall (VARIABLES) (when (and CONDITIONS) (and LEAVES)))`.
fn wrapped(mut leaves: Vec<Effect>, variables: &[Typed], conditions: &[Condition]) -> Effect {
    let mut effect = match leaves.len() {
        1 => leaves.remove(0),
        _ => Effect::And(leaves),
    };
    if !conditions.is_empty() {
        let condition = match conditions {
            [only] => only.clone(),
            several => Condition::And(several.to_vec()),
        };
        effect = Effect::When(Box::new(condition), Box::new(effect));
    }
    if variables.is_empty() { effect } else { Effect::Forall(variables.to_vec(), Box::new(effect)) }
}
