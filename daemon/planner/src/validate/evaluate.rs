//! Whether a lifted condition holds in a world, and which part of it does not.

use pddl::{
    Atom, Compare, Comparison, Condition, Expression, FluentTerm, Name, Operator, Term, Typed,
};

use super::World;

/// Two numbers this close are one: sums of decimal fractions are not exact in binary.
pub(crate) const TOLERANCE: f64 = 1e-6;

/// What the variables in scope stand for, innermost last.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bindings(Vec<(Name, Name)>);

// === impl Bindings ===

impl Bindings {
    pub(crate) fn bind(&mut self, variable: &Name, object: Name) {
        self.0.push((variable.clone(), object));
    }

    pub(crate) fn unbind(&mut self) {
        self.0.pop();
    }

    fn lookup(&self, variable: &Name) -> Option<&Name> {
        self.0.iter().rev().find(|(name, _)| name == variable).map(|(_, object)| object)
    }

    /// The object a term stands for. An unbound variable stands for itself, which no fact holds of.
    pub(crate) fn object<'t>(&'t self, term: &'t Term) -> &'t Name {
        match term {
            Term::Object(name) => name,
            Term::Variable(name) => self.lookup(name).unwrap_or(name),
        }
    }

    pub(crate) fn objects(&self, terms: &[Term]) -> Vec<Name> {
        terms.iter().map(|term| self.object(term).clone()).collect()
    }

    fn term(&self, term: &Term) -> Term {
        match term {
            Term::Variable(name) => match self.lookup(name) {
                Some(object) => Term::Object(object.clone()),
                None => term.clone(),
            },
            Term::Object(_) => term.clone(),
        }
    }

    fn terms(&self, terms: &[Term]) -> Vec<Term> {
        terms.iter().map(|term| self.term(term)).collect()
    }

    pub(crate) fn fluent(&self, fluent: &FluentTerm) -> FluentTerm {
        FluentTerm { arguments: self.terms(&fluent.arguments), ..fluent.clone() }
    }

    /// The condition with objects in place of the variables that are bound.
    pub(crate) fn substitute(&self, condition: &Condition) -> Condition {
        let all = |parts: &[Condition]| parts.iter().map(|part| self.substitute(part)).collect();
        match condition {
            Condition::Atom(atom) => {
                Condition::Atom(Atom { arguments: self.terms(&atom.arguments), ..atom.clone() })
            }
            Condition::Equal(left, right, span) => {
                Condition::Equal(self.term(left), self.term(right), *span)
            }
            Condition::Compare(compare) => Condition::Compare(Box::new(Compare {
                left: self.expression(&compare.left),
                right: self.expression(&compare.right),
                ..(**compare).clone()
            })),
            Condition::Not(inner) => Condition::Not(Box::new(self.substitute(inner))),
            Condition::And(parts) => Condition::And(all(parts)),
            Condition::Or(parts) => Condition::Or(all(parts)),
            Condition::Imply(left, right) => {
                Condition::Imply(Box::new(self.substitute(left)), Box::new(self.substitute(right)))
            }
            Condition::Exists(variables, inner) => Condition::Exists(
                variables.clone(),
                Box::new(self.hiding(variables).substitute(inner)),
            ),
            Condition::Forall(variables, inner) => Condition::Forall(
                variables.clone(),
                Box::new(self.hiding(variables).substitute(inner)),
            ),
        }
    }

    fn expression(&self, expression: &Expression) -> Expression {
        match expression {
            Expression::Fluent(fluent) => Expression::Fluent(self.fluent(fluent)),
            Expression::Negate(inner) => Expression::Negate(Box::new(self.expression(inner))),
            Expression::Apply(operator, operands) => Expression::Apply(
                *operator,
                operands.iter().map(|operand| self.expression(operand)).collect(),
            ),
            Expression::Number(_)
            | Expression::Duration(_)
            | Expression::ContinuousTime(_)
            | Expression::TotalTime(_) => expression.clone(),
        }
    }

    /// Without the variables that a quantifier binds anew.
    fn hiding(&self, variables: &[Typed]) -> Bindings {
        let hidden = |name: &Name| variables.iter().any(|variable| variable.name == *name);
        Bindings(self.0.iter().filter(|(name, _)| !hidden(name)).cloned().collect())
    }
}

// === impl World ===

impl World {
    pub(crate) fn holds_under(&self, condition: &Condition, bindings: &mut Bindings) -> bool {
        match condition {
            Condition::Atom(atom) => self.has(&atom.predicate, &bindings.objects(&atom.arguments)),
            Condition::Equal(left, right, _) => bindings.object(left) == bindings.object(right),
            Condition::Compare(compare) => self.compares(compare, bindings),
            Condition::Not(inner) => !self.holds_under(inner, bindings),
            Condition::And(parts) => parts.iter().all(|part| self.holds_under(part, bindings)),
            Condition::Or(parts) => parts.iter().any(|part| self.holds_under(part, bindings)),
            Condition::Imply(left, right) => {
                !self.holds_under(left, bindings) || self.holds_under(right, bindings)
            }
            Condition::Exists(variables, inner) => {
                !self.each(variables, inner, bindings, &mut |world, bindings| {
                    !world.holds_under(inner, bindings)
                })
            }
            Condition::Forall(variables, inner) => {
                self.every(variables, bindings, &mut |world, bindings| {
                    world.holds_under(inner, bindings)
                })
            }
        }
    }

    /// The smallest part of a condition that keeps it from holding, ground as far as it can be.
    pub(crate) fn failing_under(
        &self,
        condition: &Condition,
        bindings: &mut Bindings,
    ) -> Option<Condition> {
        if self.holds_under(condition, bindings) {
            return None;
        }
        let smaller = match condition {
            Condition::And(parts) => {
                parts.iter().find_map(|part| self.failing_under(part, bindings))
            }
            Condition::Or(parts) if parts.len() == 1 => self.failing_under(&parts[0], bindings),
            Condition::Imply(_, right) => self.failing_under(right, bindings),
            Condition::Forall(variables, inner) => {
                let mut found = None;
                self.every(variables, bindings, &mut |world, bindings| {
                    found = world.failing_under(inner, bindings);
                    found.is_none()
                });
                found
            }
            _ => None,
        };
        smaller.or_else(|| Some(bindings.substitute(condition)))
    }

    /// Calls `visit` for every binding of the variables, in the order of the texts, until it
    /// answers `false`. Whether all answered `true`.
    pub(crate) fn every(
        &self,
        variables: &[Typed],
        bindings: &mut Bindings,
        visit: &mut dyn FnMut(&World, &mut Bindings) -> bool,
    ) -> bool {
        let Some((first, rest)) = variables.split_first() else { return visit(self, bindings) };
        self.model.members(&first.ty).into_iter().all(|object| {
            bindings.bind(&first.name, object);
            let all = self.every(rest, bindings, visit);
            bindings.unbind();
            all
        })
    }

    /// Like [`World::every`], but may leave out bindings under which `condition` cannot hold: where
    /// the condition asks for a fact, only facts that are true are tried.
    pub(crate) fn each(
        &self,
        variables: &[Typed],
        condition: &Condition,
        bindings: &mut Bindings,
        visit: &mut dyn FnMut(&World, &mut Bindings) -> bool,
    ) -> bool {
        let Some((first, rest)) = variables.split_first() else { return visit(self, bindings) };
        // A quantified variable that is bound outside too is a new variable.
        let mut candidates = match self.candidates(&first.name, variables, condition, bindings) {
            Some(objects) => objects,
            None => self.model.members(&first.ty),
        };
        candidates.retain(|object| self.model.is_a(object, &first.ty));
        candidates.into_iter().all(|object| {
            bindings.bind(&first.name, object);
            let all = self.each(rest, condition, bindings, visit);
            bindings.unbind();
            all
        })
    }

    /// The objects that `variable` can be, going by the first conjunct that is a fact about it.
    fn candidates(
        &self,
        variable: &Name,
        unbound: &[Typed],
        condition: &Condition,
        bindings: &Bindings,
    ) -> Option<Vec<Name>> {
        match condition {
            Condition::And(parts) => {
                parts.iter().find_map(|part| self.candidates(variable, unbound, part, bindings))
            }
            Condition::Atom(atom) => {
                let is_it = |term: &Term| matches!(term, Term::Variable(name) if name == variable);
                let position = atom.arguments.iter().position(is_it)?;
                let open = |term: &Term| {
                    matches!(term, Term::Variable(name)
                    if unbound.iter().any(|other| other.name == *name))
                };
                let matches = |objects: &&Vec<Name>| {
                    let pairs = objects.iter().zip(&atom.arguments);
                    pairs
                        .into_iter()
                        .all(|(object, term)| open(term) || bindings.object(term) == object)
                };
                let facts = self.facts_of(&atom.predicate).filter(matches);
                let mut found: Vec<Name> =
                    facts.filter_map(|objects| objects.get(position).cloned()).collect();
                found.sort();
                found.dedup();
                Some(found)
            }
            _ => None,
        }
    }

    fn compares(&self, compare: &Compare, bindings: &Bindings) -> bool {
        let left = self.evaluate(&compare.left, bindings);
        let (Ok(left), Ok(right)) = (left, self.evaluate(&compare.right, bindings)) else {
            return false;
        };
        match compare.comparison {
            Comparison::Less => left < right - TOLERANCE,
            Comparison::LessOrEqual => left <= right + TOLERANCE,
            Comparison::Equal => (left - right).abs() <= TOLERANCE,
            Comparison::GreaterOrEqual => left >= right - TOLERANCE,
            Comparison::Greater => left > right + TOLERANCE,
        }
    }

    /// The value of an expression, or the fluent that has none.
    pub(crate) fn evaluate(
        &self,
        expression: &Expression,
        bindings: &Bindings,
    ) -> Result<f64, FluentTerm> {
        let value = match expression {
            Expression::Number(number) => Ok(number.0),
            Expression::Fluent(fluent) => {
                let key = (fluent.function.clone(), bindings.objects(&fluent.arguments));
                self.values.get(&key).copied().ok_or_else(|| bindings.fluent(fluent))
            }
            Expression::Negate(inner) => Ok(-self.evaluate(inner, bindings)?),
            Expression::Apply(operator, operands) => {
                let mut values = Vec::with_capacity(operands.len());
                for operand in operands {
                    values.push(self.evaluate(operand, bindings)?);
                }
                Ok(values
                    .into_iter()
                    .reduce(|left, right| calculate(*operator, left, right))
                    .unwrap_or(f64::NAN))
            }
            // A sequential plan takes one unit of time per step.
            Expression::TotalTime(_) => Ok(self.steps as f64),
            Expression::Duration(_) | Expression::ContinuousTime(_) => Ok(f64::NAN),
        }?;
        if value.is_finite() { Ok(value) } else { Err(undefined(expression)) }
    }
}

/// What to name when a value is no number: division by zero, or time outside a durative action.
fn undefined(expression: &Expression) -> FluentTerm {
    let named = |name: &str, span| FluentTerm {
        function: Name::spanned(name, span),
        arguments: Vec::new(),
        span,
    };
    match expression {
        Expression::Fluent(fluent) => fluent.clone(),
        Expression::Duration(span) => named("?duration", *span),
        Expression::ContinuousTime(span) => named("#t", *span),
        Expression::Negate(inner) => undefined(inner),
        Expression::Apply(_, operands) if !operands.is_empty() => undefined(&operands[0]),
        _ => named("number", pddl::Span::default()),
    }
}

fn calculate(operator: Operator, left: f64, right: f64) -> f64 {
    match operator {
        Operator::Add => left + right,
        Operator::Subtract => left - right,
        Operator::Multiply => left * right,
        Operator::Divide => left / right,
    }
}
