//! Costs in the form that Fast Downward supports: one effect `(increase (total-cost) N)` or
//! `(increase (total-cost) (f ?x))` for each action. N and the values of `f` are whole numbers and
//! not negative.
//!
//! - Several costs of one action, sums, weights and fractions become one static function. The
//!   values of this function are listed for all objects that they depend on, and scaled to whole
//!   numbers.
//! - Numbers that neither a condition nor the metric uses are removed. A change of such a number
//!   still requires that it has a value; this requirement becomes a static predicate.
//! - Costs that depend on the state are refused, because they require numeric planning.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{
    ActionSchema, Assign, Assignment, Atom, Condition, Domain, Effect, Expression, FluentTerm,
    FunctionDeclaration, InitElement, Metric, MetricDirection, Name, Number, Operator,
    PredicateDeclaration, Privacy, Problem, Span, TOTAL_COST, Term, TypeExpr, Typed, Types,
};
use planner::{InputText, Unsupported};

use super::refuse::unsupported;
use super::task_parts;

/// Maximum number of values of one action's cost function; a task with more is unsupported. Each
/// value is a line of `:init`.
const TABLE_MAX: usize = 1_000_000;

/// Largest cost of a step after fractions are scaled up. If exact scaling would exceed it, the
/// largest cost becomes this value, and the other costs are scaled alike and rounded. The sum of
/// two thousand such costs fits into the 31 bits that Fast Downward uses for costs.
const SCALED_MAX: f64 = 1e6;

/// Largest cost of a step up to which whole costs are used without scaling. If any cost is greater,
/// all costs are scaled down and rounded.
const WHOLE_MAX: f64 = 1e9;

type FluentValues = BTreeMap<(Name, Vec<Name>), f64>;

/// Removes all numbers except costs from a task. Returns whether the costs of plans still compare
/// exactly as in the original task.
pub(super) fn lower(domain: &mut Domain, problem: &mut Problem) -> Result<bool, Unsupported> {
    let facts = FunctionProperties::of(domain, problem)?;
    let mut tables = Vec::new();
    for action in &mut domain.actions {
        let mut numbers = ActionNumbers::default();
        let effect = std::mem::take(&mut action.effect);
        action.effect = facts.strip(effect, Nesting::default(), &mut numbers)?;
        require(action, &numbers.needs);
        tables.push(facts.table(action, &numbers.costs)?);
    }
    facts.declare_needs(domain, problem);
    problem.init.retain(|element| !matches!(element, InitElement::Assign(..)));
    domain.functions.clear();
    if problem.metric.is_none() {
        return Ok(true);
    }
    let scale = Scale::of(tables.iter().flat_map(|table| table.values.values().copied()));
    for (index, table) in tables.iter().enumerate() {
        declare_cost(domain, problem, index, table, &scale);
    }
    let total_cost = |span| fluent(TOTAL_COST, Vec::new(), span);
    domain.functions.push(function(TOTAL_COST, 0));
    problem.init.push(InitElement::Assign(total_cost(Span::default()), Number(0.0)));
    problem.metric = Some(Metric {
        direction: MetricDirection::Minimize,
        expression: Expression::Fluent(total_cost(Span::default())),
        span: Span::default(),
    });
    Ok(scale.is_exact)
}

/// The functions of the task and their properties.
struct FunctionProperties {
    /// Cost of one unit of each function, according to the metric; empty without a metric.
    weights: BTreeMap<Name, f64>,
    /// Functions that an action changes.
    changed: BTreeSet<Name>,
    /// Functions that an action sets to a value that does not depend on the function's former
    /// value.
    assigned: BTreeSet<Name>,
    values: FluentValues,
    objects: BTreeMap<Name, TypeExpr>,
    types: Types,
}

/// The numeric part of one action: its costs, and the fluents that it requires to have a value.
#[derive(Default)]
struct ActionNumbers {
    /// The costs of the action. Each entry is the weight of the cost in the metric, and the value
    /// of the cost.
    costs: Vec<(f64, Expression)>,
    /// Fluents that must have a value for the action to be applicable.
    needs: Vec<FluentTerm>,
}

/// Constructs around an effect: a `when`, a `forall`, both or neither.
#[derive(Clone, Copy, Default)]
struct Nesting {
    when: bool,
    forall: bool,
}

/// The costs of one action, with one value for each combination of objects for its variables.
struct CostTable {
    variables: Vec<Name>,
    values: BTreeMap<Vec<Name>, f64>,
}

// === impl FunctionProperties ===

impl FunctionProperties {
    fn of(domain: &Domain, problem: &Problem) -> Result<FunctionProperties, Unsupported> {
        let assigns = task_parts::assigns(domain);
        let names = |those: &dyn Fn(&Assign) -> bool| {
            let chosen = assigns.iter().filter(|assign| those(assign));
            chosen.map(|assign| assign.fluent.function.clone()).collect()
        };
        let declared = problem.objects.iter().map(|it| &it.object);
        let objects = domain.constants.iter().chain(declared);
        let mut weights = BTreeMap::new();
        if let Some(metric) = &problem.metric {
            let sign = if metric.direction == MetricDirection::Maximize { -1.0 } else { 1.0 };
            add_weights(&metric.expression, sign, metric, &mut weights)?;
        }
        Ok(FunctionProperties {
            weights,
            changed: names(&|_| true),
            assigned: names(&|assign| assign.assignment == Assignment::Assign),
            values: task_parts::values(problem),
            objects: objects.map(|it| (it.name.clone(), it.ty.clone())).collect(),
            types: Types::of(domain),
        })
    }

    /// Returns an effect without its numeric changes. The changes are added to `numbers`.
    fn strip(
        &self,
        effect: Effect,
        nesting: Nesting,
        numbers: &mut ActionNumbers,
    ) -> Result<Effect, Unsupported> {
        match effect {
            Effect::Add(_) | Effect::Delete(_) => Ok(effect),
            Effect::And(parts) => {
                let parts = parts.into_iter().map(|part| self.strip(part, nesting, numbers));
                Ok(Effect::And(parts.collect::<Result<_, _>>()?))
            }
            Effect::When(condition, inner) => {
                let inner = self.strip(*inner, Nesting { when: true, ..nesting }, numbers)?;
                Ok(Effect::When(condition, Box::new(inner)))
            }
            Effect::Forall(variables, inner) => {
                let inner = self.strip(*inner, Nesting { forall: true, ..nesting }, numbers)?;
                Ok(Effect::Forall(variables, Box::new(inner)))
            }
            Effect::Assign(assign) => {
                match self.weights.get(&assign.fluent.function) {
                    Some(weight) => self.cost(&assign, *weight, nesting, numbers)?,
                    None => self.idle(&assign, nesting, numbers)?,
                }
                Ok(Effect::nothing())
            }
        }
    }

    /// Adds a change of a function in the metric to the costs of the action.
    fn cost(
        &self,
        assign: &Assign,
        weight: f64,
        nesting: Nesting,
        numbers: &mut ActionNumbers,
    ) -> Result<(), Unsupported> {
        let name = &assign.fluent.function;
        let refuse = |what: &str| {
            let feature = format!("{what} of `{name}`, which the metric counts");
            Err(unsupported(feature, assign.span, InputText::Domain))
        };
        let sign = match assign.assignment {
            Assignment::Increase => 1.0,
            Assignment::Decrease => -1.0,
            _ => return refuse("an assignment or scaling"),
        };
        if nesting.when {
            return refuse("a conditional change");
        }
        if nesting.forall {
            return refuse("a change under `forall`");
        }
        if assign.value.fluents().any(|it| self.changed.contains(&it.function)) {
            return refuse("a state-dependent change");
        }
        numbers.costs.push((sign * weight, assign.value.clone()));
        self.need(&assign.fluent, &mut numbers.needs);
        Ok(())
    }

    /// Handles a change of a function that nothing uses. The only effect of such a change is that
    /// the action is not applicable while the function has no value.
    fn idle(
        &self,
        assign: &Assign,
        nesting: Nesting,
        numbers: &mut ActionNumbers,
    ) -> Result<(), Unsupported> {
        let mut needs = Vec::new();
        assign.value.fluents().for_each(|it| self.need(it, &mut needs));
        if assign.assignment != Assignment::Assign {
            self.need(&assign.fluent, &mut needs);
        }
        let comes_and_goes = needs.iter().any(|it| self.assigned.contains(&it.function));
        let is_nested = (nesting.when || nesting.forall) && !needs.is_empty();
        if comes_and_goes || is_nested || divides(&assign.value) {
            let feature = format!("the number `{}`, which changes", assign.fluent.function);
            return Err(unsupported(feature, assign.span, InputText::Domain));
        }
        numbers.needs.extend(needs);
        Ok(())
    }

    /// Adds `fluent` to `needs`. The fluent `total-cost` is not added, because it always has a
    /// value.
    fn need(&self, fluent: &FluentTerm, needs: &mut Vec<FluentTerm>) {
        let is_total_cost = fluent.function == TOTAL_COST && fluent.arguments.is_empty();
        if !is_total_cost && !needs.contains(fluent) {
            needs.push(fluent.clone());
        }
    }

    /// Returns the costs of an action for all combinations of objects that they depend on.
    fn table(
        &self,
        action: &ActionSchema,
        costs: &[(f64, Expression)],
    ) -> Result<CostTable, Unsupported> {
        let mut fluents: Vec<&FluentTerm> =
            costs.iter().flat_map(|(_, value)| value.fluents()).collect();
        // The fluent with the most arguments comes first, so that its arguments bind those of the
        // others.
        fluents.sort_by_key(|fluent| std::cmp::Reverse(fluent.arguments.len()));
        let mut variables: Vec<Name> = Vec::new();
        for term in fluents.iter().flat_map(|fluent| &fluent.arguments) {
            if let Term::Variable(name) = term
                && !variables.contains(name)
            {
                variables.push(name.clone());
            }
        }
        let mut table = CostTable { variables, values: BTreeMap::new() };
        let mut binding = BTreeMap::new();
        let filling = Filling { facts: self, action, costs };
        filling.fill(&fluents, &mut binding, &mut table)?;
        Ok(table)
    }

    /// Declares the predicate `(has'FUNCTION …)` for each function that an action requires to have
    /// a value. Adds this predicate to `:init` for all objects for which the function has a value.
    fn declare_needs(&self, domain: &mut Domain, problem: &mut Problem) {
        let mut needed = BTreeMap::new();
        for action in &domain.actions {
            for atom in action.precondition.atoms() {
                if let Some(function) = atom.predicate.as_str().strip_prefix(HAS) {
                    needed.insert(Name::new(function), atom.arguments.len());
                }
            }
        }
        for (function, arity) in &needed {
            domain.predicates.push(PredicateDeclaration {
                name: has(function),
                parameters: parameters(*arity),
                privacy: Privacy::Public,
            });
        }
        for (function, objects) in self.values.keys() {
            if needed.contains_key(function) {
                let arguments = objects.iter().cloned().map(Term::Object).collect();
                let predicate = has(function);
                let atom = Atom { predicate, arguments, span: Span::default() };
                problem.init.push(InitElement::Atom(atom));
            }
        }
    }
}

const HAS: &str = "has'";

fn has(function: &Name) -> Name {
    Name::new(&format!("{HAS}{function}"))
}

/// Adds `(has'FUNCTION …)` to the precondition of an action for each fluent in `needs`.
fn require(action: &mut ActionSchema, needs: &[FluentTerm]) {
    if needs.is_empty() {
        return;
    }
    let atoms = needs.iter().map(|fluent| {
        Condition::Atom(Atom {
            predicate: has(&fluent.function),
            arguments: fluent.arguments.clone(),
            span: fluent.span,
        })
    });
    let precondition = std::mem::take(&mut action.precondition);
    let told = (!precondition.is_always()).then_some(precondition);
    action.precondition = Condition::And(told.into_iter().chain(atoms).collect());
}

fn divides(expression: &Expression) -> bool {
    let is_safe = |by: &Expression| matches!(by, Expression::Number(by) if by.0 != 0.0);
    expression.parts().any(|part| match part {
        Expression::Apply(Operator::Divide, operands) => !operands.iter().skip(1).all(is_safe),
        _ => false,
    })
}

/// Adds the weights of the functions in a metric to `weights`. The metric must be a weighted sum of
/// functions without arguments.
fn add_weights(
    expression: &Expression,
    weight: f64,
    metric: &Metric,
    weights: &mut BTreeMap<Name, f64>,
) -> Result<(), Unsupported> {
    let refuse = |feature: String| Err(unsupported(feature, metric.span, InputText::Problem));
    match expression {
        Expression::Number(_) => Ok(()),
        Expression::Fluent(fluent) if fluent.arguments.is_empty() => {
            *weights.entry(fluent.function.clone()).or_default() += weight;
            Ok(())
        }
        Expression::Fluent(fluent) => refuse(format!("a metric over `{fluent}`, one of several")),
        Expression::Negate(inner) => add_weights(inner, -weight, metric, weights),
        Expression::Apply(Operator::Add, operands) => {
            operands.iter().try_for_each(|one| add_weights(one, weight, metric, weights))
        }
        Expression::Apply(Operator::Subtract, operands) => {
            operands.iter().enumerate().try_for_each(|(index, one)| {
                let weight = if index == 0 { weight } else { -weight };
                add_weights(one, weight, metric, weights)
            })
        }
        Expression::Apply(operator, operands) => match (operator, &operands[..]) {
            (
                Operator::Multiply,
                [Expression::Number(by), inner] | [inner, Expression::Number(by)],
            ) => add_weights(inner, weight * by.0, metric, weights),
            (Operator::Divide, [inner, Expression::Number(by)]) if by.0 != 0.0 => {
                add_weights(inner, weight / by.0, metric, weights)
            }
            _ => refuse("a metric that is not linear".to_owned()),
        },
        _ => refuse("time in a metric".to_owned()),
    }
}

/// Inputs of the computation of one action's cost table.
struct Filling<'f> {
    facts: &'f FunctionProperties,
    action: &'f ActionSchema,
    costs: &'f [(f64, Expression)],
}

// === impl Filling ===

impl Filling<'_> {
    /// Binds the variables of the first fluent in turn to all objects for which this fluent has a
    /// value. For each binding, the remaining fluents are handled in the same way. When all are
    /// bound, a cost is entered into `table`.
    fn fill(
        &self,
        fluents: &[&FluentTerm],
        binding: &mut BTreeMap<Name, Name>,
        table: &mut CostTable,
    ) -> Result<(), Unsupported> {
        let Some((fluent, others)) = fluents.split_first() else {
            return self.enter(binding, table);
        };
        let first = (fluent.function.clone(), Vec::new());
        let all = self.facts.values.range(first..);
        for ((_, objects), _) in all.take_while(|((function, _), _)| *function == fluent.function) {
            let outside = binding.clone();
            if self.bind(fluent, objects, binding) {
                self.fill(others, binding, table)?;
            }
            *binding = outside;
        }
        Ok(())
    }

    fn bind(
        &self,
        fluent: &FluentTerm,
        objects: &[Name],
        binding: &mut BTreeMap<Name, Name>,
    ) -> bool {
        fluent.arguments.iter().zip(objects).all(|(term, object)| match term {
            Term::Object(name) => name == object,
            Term::Variable(name) => match binding.get(name) {
                Some(bound) => bound == object,
                None => {
                    let fits = self.fits(name, object);
                    binding.insert(name.clone(), object.clone());
                    fits
                }
            },
        })
    }

    /// Whether `object` has the type of the action's parameter `variable`.
    fn fits(&self, variable: &Name, object: &Name) -> bool {
        let parameter = self.action.parameters.iter().find(|it| it.name == *variable);
        match (parameter, self.facts.objects.get(object)) {
            (Some(parameter), Some(own)) => self.facts.types.holds(&parameter.ty, own),
            _ => false,
        }
    }

    fn enter(
        &self,
        binding: &BTreeMap<Name, Name>,
        table: &mut CostTable,
    ) -> Result<(), Unsupported> {
        let refuse = |feature| Err(unsupported(feature, self.action.span, InputText::Domain));
        let name = &self.action.name;
        let values = self
            .costs
            .iter()
            .map(|(weight, value)| Some(weight * evaluate(value, binding, &self.facts.values)?));
        // If the cost has no value, for example because of a division by zero, the action is not
        // applicable.
        let sum = |all: f64, one: Option<f64>| Some(Operator::Add.apply(all, one?));
        let Some(cost) = { values }.try_fold(0.0, sum) else { return Ok(()) };
        if cost < 0.0 {
            return refuse(format!("a negative cost of `{name}`"));
        }
        let key = table.variables.iter().map(|it| binding[it].clone()).collect();
        // This also turns `-0` into `0`.
        table.values.insert(key, if cost > 0.0 { cost } else { 0.0 });
        if table.values.len() > TABLE_MAX {
            return refuse(format!("the cost of `{name}`: more than {TABLE_MAX} values"));
        }
        Ok(())
    }
}

fn evaluate(
    expression: &Expression,
    binding: &BTreeMap<Name, Name>,
    values: &FluentValues,
) -> Option<f64> {
    let value = match expression {
        Expression::Number(number) => number.0,
        Expression::Fluent(fluent) => {
            let objects = fluent.arguments.iter().map(|term| match term {
                Term::Object(name) => Some(name.clone()),
                Term::Variable(name) => binding.get(name).cloned(),
            });
            let key = (fluent.function.clone(), objects.collect::<Option<_>>()?);
            *values.get(&key)?
        }
        Expression::Negate(inner) => -evaluate(inner, binding, values)?,
        Expression::Apply(operator, operands) => {
            let mut operands = operands.iter().map(|one| evaluate(one, binding, values));
            let first = operands.next()??;
            operands.try_fold(first, |left, right| Some(operator.apply(left, right?)))?
        }
        _ => return None,
    };
    value.is_finite().then_some(value)
}

/// Factor that turns costs into whole numbers, and whether the result is exact.
struct Scale {
    factor: f64,
    is_exact: bool,
}

// === impl Scale ===

impl Scale {
    /// Returns the smallest power of ten that makes all costs whole numbers. If there is none,
    /// returns the largest factor that keeps all costs within the limit, and the costs are rounded.
    fn of(costs: impl Iterator<Item = f64> + Clone) -> Scale {
        let largest = costs.clone().fold(0.0, f64::max);
        // Only rounding errors are tolerated: a small cost must not become 0.
        let is_whole = |cost: f64| (cost - cost.round()).abs() <= 4.0 * f64::EPSILON * cost;
        if costs.clone().all(is_whole) && largest <= WHOLE_MAX {
            return Scale { factor: 1.0, is_exact: true };
        }
        let powers = (1..=6).map(|exponent| 10_f64.powi(exponent));
        let exact = powers.into_iter().find(|power| costs.clone().all(|it| is_whole(it * power)));
        match exact.filter(|factor| largest * factor <= SCALED_MAX) {
            Some(factor) => Scale { factor, is_exact: true },
            None => Scale { factor: SCALED_MAX / largest, is_exact: false },
        }
    }

    fn apply(&self, cost: f64) -> f64 {
        (cost * self.factor).round()
    }
}

/// Adds the effect with the cost to an action, and declares the cost function that this effect
/// uses.
fn declare_cost(
    domain: &mut Domain,
    problem: &mut Problem,
    index: usize,
    table: &CostTable,
    scale: &Scale,
) {
    let name = format!("cost'{}", index + 1);
    let value = match (&table.variables[..], table.values.get(&Vec::new())) {
        ([], Some(constant)) => Expression::Number(Number(scale.apply(*constant))),
        (variables, _) => {
            domain.functions.push(function(&name, variables.len()));
            for (objects, cost) in &table.values {
                let arguments = objects.iter().cloned().map(Term::Object).collect();
                let fluent = fluent(&name, arguments, Span::default());
                problem.init.push(InitElement::Assign(fluent, Number(scale.apply(*cost))));
            }
            let arguments = variables.iter().cloned().map(Term::Variable).collect();
            Expression::Fluent(fluent(&name, arguments, Span::default()))
        }
    };
    let action = &mut domain.actions[index];
    let cost = Effect::Assign(Box::new(Assign {
        assignment: Assignment::Increase,
        fluent: fluent(TOTAL_COST, Vec::new(), Span::default()),
        value,
        span: action.span,
    }));
    action.effect = Effect::And(vec![std::mem::take(&mut action.effect), cost]);
}

fn function(name: &str, arity: usize) -> FunctionDeclaration {
    let parameters = parameters(arity);
    FunctionDeclaration { name: Name::new(name), parameters, privacy: Privacy::Public }
}

fn parameters(arity: usize) -> Vec<Typed> {
    let names = (1..=arity).map(|index| Name::new(&format!("x{index}")));
    names.map(|name| Typed { name, ty: TypeExpr::default() }).collect()
}

fn fluent(name: &str, arguments: Vec<Term>, span: Span) -> FluentTerm {
    FluentTerm { function: Name::new(name), arguments, span }
}
