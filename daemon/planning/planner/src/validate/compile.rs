//! Compiles conditions, expressions and effects. One pass over the syntax tree resolves all names.

use pddl::{ActionSchema, Comparison, Condition, Effect, FluentTerm, Name, Span, Term, Typed};
use rustc_hash::FxHashMap;

use super::compiled::{
    Argument, CompiledAction, CompiledAssign, CompiledComparison, CompiledCondition,
    CompiledEffect, CompiledExpression, Fact, Fluent, FrameSlot, Query, Variable,
};
use super::model::Model;
use super::symbols::Object;

/// Maximum product of the number of variables and the number of alternatives up to which a
/// quantifier is distributed over `or`. Above it, the `or` is evaluated as a whole. Typical domains
/// have far fewer.
const SHARED_MAX: usize = 4_096;

/// State of the compilation of one text: the variables in scope, and the slots and undeclared names
/// used so far.
pub(super) struct CompilationScope<'m> {
    model: &'m Model,
    /// Variables in scope, each with its slot. The innermost variable is the last.
    variables: Vec<(Name, FrameSlot)>,
    slot_count: usize,
    /// Numbers of the names that the texts do not declare. An unbound variable counts as such a
    /// name.
    strangers: FxHashMap<Name, usize>,
}

// === impl CompilationScope ===

impl<'m> CompilationScope<'m> {
    pub(super) fn new(model: &'m Model) -> CompilationScope<'m> {
        CompilationScope {
            model,
            variables: Vec::new(),
            slot_count: 0,
            strangers: FxHashMap::default(),
        }
    }

    /// Returns a frame (one object per slot) for everything compiled so far, with all slots
    /// unbound.
    pub(super) fn frame(&self) -> Vec<Object> {
        vec![Object::UNBOUND; self.slot_count]
    }

    pub(super) fn slot_count(&self) -> usize {
        self.slot_count
    }

    /// Adds variables to the scope, each with a new slot.
    pub(super) fn declare(&mut self, variables: &[Typed]) -> Vec<Variable> {
        let declare = |variable: &Typed| {
            let slot = FrameSlot(self.slot_count as u32);
            self.slot_count += 1;
            self.variables.push((variable.name.clone(), slot));
            Variable { slot, extension: self.model.extension(&variable.ty) }
        };
        variables.iter().map(declare).collect()
    }

    /// Removes the last `count` variables from the scope.
    pub(super) fn forget(&mut self, count: usize) {
        self.variables.truncate(self.variables.len() - count);
    }

    /// Compiles a condition; if `positive` is false, its negation.
    pub(super) fn node(&mut self, condition: &Condition, positive: bool) -> CompiledCondition {
        match condition {
            Condition::Atom(atom) => {
                let arguments = self.arguments(&atom.arguments);
                match self.model.predicates.find(&atom.predicate, arguments.len()) {
                    Some(relation) => {
                        CompiledCondition::Fact(Fact { relation, arguments }, positive)
                    }
                    // No text can make such a fact true.
                    None => CompiledCondition::Constant(!positive),
                }
            }
            Condition::Equal(left, right, _) => {
                CompiledCondition::Equal(self.argument(left), self.argument(right), positive)
            }
            Condition::Compare(compare) => {
                let (left, right) = (self.expression(&compare.left), &compare.right);
                let right = self.expression(right);
                let comparison = compare.comparison;
                if positive {
                    return CompiledCondition::Compare(
                        Box::new(CompiledComparison { comparison, left, right }),
                        true,
                    );
                }
                // If a number is undefined, neither the comparison nor its negation holds.
                let other = |comparison: &Comparison| {
                    let (comparison, left, right) = (*comparison, left.clone(), right.clone());
                    CompiledCondition::Compare(
                        Box::new(CompiledComparison { comparison, left, right }),
                        true,
                    )
                };
                CompiledCondition::any(comparison.negated().iter().map(other))
            }
            Condition::Not(inner) => self.node(inner, !positive),
            Condition::And(parts) => self.joined(parts, positive, positive),
            Condition::Or(parts) => self.joined(parts, positive, !positive),
            Condition::Imply(left, right) => {
                let sides = [self.node(left, !positive), self.node(right, positive)];
                if positive { CompiledCondition::any(sides) } else { CompiledCondition::all(sides) }
            }
            Condition::Exists(variables, inner) => {
                self.quantified(variables, inner, positive, positive)
            }
            Condition::Forall(variables, inner) => {
                self.quantified(variables, inner, positive, !positive)
            }
        }
    }

    fn joined(&mut self, parts: &[Condition], positive: bool, all: bool) -> CompiledCondition {
        let nodes: Vec<CompiledCondition> =
            parts.iter().map(|part| self.node(part, positive)).collect();
        if all { CompiledCondition::all(nodes) } else { CompiledCondition::any(nodes) }
    }

    /// Compiles a quantifier over a condition, or over the negation of the condition if `positive`
    /// is false. If `exists` is false, the quantifier is “for all”, compiled as: no binding
    /// violates the condition.
    fn quantified(
        &mut self,
        variables: &[Typed],
        inner: &Condition,
        positive: bool,
        exists: bool,
    ) -> CompiledCondition {
        let declared = self.declare(variables);
        let node = self.node(inner, positive);
        let node = if exists { node } else { node.complement() };
        self.forget(variables.len());
        let queries = existential(declared, node).into_iter();
        let nodes = queries.map(|query| CompiledCondition::Exists(Box::new(query), exists));
        if exists { CompiledCondition::any(nodes) } else { CompiledCondition::all(nodes) }
    }

    pub(super) fn expression(&mut self, expression: &pddl::Expression) -> CompiledExpression {
        let unknown = |name: &str, span: Span| {
            let function = Name::spanned(name, span);
            CompiledExpression::Unknown(Box::new(FluentTerm {
                function,
                arguments: Vec::new(),
                span,
            }))
        };
        match expression {
            pddl::Expression::Number(number) => CompiledExpression::Number(number.0),
            pddl::Expression::Fluent(fluent) => {
                CompiledExpression::Fluent(Box::new(self.fluent(fluent)))
            }
            pddl::Expression::Negate(inner) => {
                CompiledExpression::Negate(Box::new(self.expression(inner)))
            }
            pddl::Expression::Apply(operator, operands) => {
                let operands = operands.iter().map(|operand| self.expression(operand)).collect();
                CompiledExpression::Apply(*operator, operands)
            }
            pddl::Expression::TotalTime(_) => CompiledExpression::TotalTime,
            pddl::Expression::Duration(span) => unknown("?duration", *span),
            pddl::Expression::ContinuousTime(span) => unknown("#t", *span),
        }
    }

    fn fluent(&mut self, fluent: &FluentTerm) -> Fluent {
        let arguments = self.arguments(&fluent.arguments);
        let function = self.model.functions.find(&fluent.function, arguments.len());
        Fluent { function, arguments, source_term: fluent.clone() }
    }

    fn arguments(&mut self, terms: &[Term]) -> Box<[Argument]> {
        terms.iter().map(|term| self.argument(term)).collect()
    }

    fn argument(&mut self, term: &Term) -> Argument {
        let known = match term {
            Term::Variable(name) => {
                let bound = self.variables.iter().rev().find(|(bound, _)| bound == name);
                bound.map(|(_, slot)| Argument::Slot(*slot))
            }
            Term::Object(_) => None,
        };
        let known = known.or_else(|| self.model.objects.find(term.name()).map(Argument::Object));
        known.unwrap_or_else(|| {
            let next = self.strangers.len();
            let index = *self.strangers.entry(term.name().clone()).or_insert(next);
            Argument::Object(Object::stranger(index))
        })
    }

    fn change(&mut self, effect: &Effect) -> CompiledEffect {
        match effect {
            Effect::And(parts) => {
                CompiledEffect::All(parts.iter().map(|part| self.change(part)).collect())
            }
            Effect::Add(atom) | Effect::Delete(atom) => {
                let relation = self.model.predicates.find(&atom.predicate, atom.arguments.len());
                let relation = relation.expect("invariant: the model numbers what effects change");
                let arguments = self.arguments(&atom.arguments);
                CompiledEffect::Set(Fact { relation, arguments }, matches!(effect, Effect::Add(_)))
            }
            Effect::Assign(assign) => CompiledEffect::Assign(Box::new(CompiledAssign {
                assignment: assign.assignment,
                fluent: self.fluent(&assign.fluent),
                value: self.expression(&assign.value),
            })),
            Effect::When(condition, inner) => {
                CompiledEffect::When(Box::new((self.node(condition, true), self.change(inner))))
            }
            Effect::Forall(variables, inner) => self.each(variables, inner),
        }
    }

    /// Compiles a universal effect. The quantifier is distributed over `and` if a part of the
    /// effect has a condition or variables of its own. Each part is then evaluated only for the
    /// bindings of its own variables.
    fn each(&mut self, variables: &[Typed], inner: &Effect) -> CompiledEffect {
        let is_limited = |part: &Effect| matches!(part, Effect::When(..) | Effect::Forall(..));
        if let Effect::And(parts) = inner
            && parts.iter().any(is_limited)
        {
            return CompiledEffect::All(
                parts.iter().map(|part| self.each(variables, part)).collect(),
            );
        }
        let before = self.variables.len();
        let mut declared = self.declare(variables);
        let (mut conditions, mut inner) = (Vec::new(), inner);
        loop {
            match inner {
                Effect::When(condition, then) => {
                    conditions.extend(self.node(condition, true).into_parts());
                    inner = then;
                }
                Effect::Forall(more, then) => {
                    declared.extend(self.declare(more));
                    inner = then;
                }
                _ => break,
            }
        }
        let change = self.change(inner);
        self.forget(self.variables.len() - before);
        // Existential quantifiers in the conditions are not merged into the query: the effect must
        // happen once per binding, even if its condition holds in several ways.
        CompiledEffect::Each(Box::new((Query::new(declared, conditions), change)))
    }
}

/// Compiles an action schema.
pub(super) fn schema(model: &Model, action: &ActionSchema) -> CompiledAction {
    let mut scope = CompilationScope::new(model);
    let parameters: Vec<Typed> = action.all_parameters().cloned().collect();
    let parameters = scope.declare(&parameters);
    let precondition = scope.node(&action.precondition, true);
    let effect = scope.change(&action.effect);
    CompiledAction {
        parameters: parameters.into_iter().map(|parameter| parameter.extension).collect(),
        precondition,
        effect,
        slot_count: scope.slot_count,
    }
}

/// Returns queries of which one has a binding if and only if `node` holds for some binding of the
/// variables.
///
/// The quantifier is distributed over `or`. The variables of inner existential quantifiers become
/// variables of the query.
fn existential(variables: Vec<Variable>, node: CompiledCondition) -> Vec<Query> {
    match node {
        CompiledCondition::Constant(false) => Vec::new(),
        CompiledCondition::Any(parts)
            if variables.len().saturating_mul(parts.len()) <= SHARED_MAX =>
        {
            parts.into_iter().flat_map(|part| existential(variables.clone(), part)).collect()
        }
        other => {
            let (mut variables, mut nodes) = (variables, Vec::new());
            for part in other.into_parts() {
                match part {
                    CompiledCondition::Exists(query, true) => {
                        variables.extend(query.variables);
                        nodes.extend(query.parts.into_iter().map(|part| part.node));
                    }
                    other => nodes.push(other),
                }
            }
            vec![Query::new(variables, nodes)]
        }
    }
}
