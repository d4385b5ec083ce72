//! Converts conditions and expressions from the syntax tree to negation normal form over numbered
//! symbols.

use pddl::{Comparison, Condition, Diagnostic, Expression, FluentTerm, Name, Term, Typed};

use super::lifted::{
    Formula, LiftedAtom, LiftedExpression, LiftedFluent, LiftedTerm, SlotIndex, TypeIndex,
};
use super::symbols::SymbolTable;

/// Scope of a conversion: the variables that are visible at this place, and the frame with the
/// slots of all variables.
pub(super) struct FormulaScope<'s> {
    pub(super) symbols: &'s mut SymbolTable,
    pub(super) frame: Vec<TypeIndex>,
    visible: Vec<(Name, SlotIndex)>,
}

// === impl FormulaScope ===

impl<'s> FormulaScope<'s> {
    pub(super) fn new<'p>(
        symbols: &'s mut SymbolTable,
        parameters: impl IntoIterator<Item = &'p Typed>,
    ) -> FormulaScope<'s> {
        let mut scope = FormulaScope { symbols, frame: Vec::new(), visible: Vec::new() };
        for parameter in parameters {
            scope.declare(parameter);
        }
        scope
    }

    /// Converts a condition, and rearranges its quantifiers for grounding.
    pub(super) fn rearranged(&mut self, condition: &Condition) -> Formula {
        let formula = self.formula(condition, true);
        self.symbols.rearranging.rearrange(formula)
    }

    /// Converts a condition to negation normal form. If `positive` is false, converts its negation.
    pub(super) fn formula(&mut self, condition: &Condition, positive: bool) -> Formula {
        match condition {
            Condition::Atom(atom) => match self.atom(atom) {
                Some(atom) => Formula::Literal { positive, atom },
                None => Formula::Constant(false),
            },
            Condition::Equal(left, right, _) => match (self.term(left), self.term(right)) {
                (Some(left), Some(right)) => Formula::Equal { positive, left, right },
                _ => Formula::Constant(false),
            },
            Condition::Compare(compare) => {
                let left = self.expression(&compare.left);
                match (left, self.expression(&compare.right)) {
                    (Some(left), Some(right)) => {
                        comparison(compare.comparison, positive, left, right)
                    }
                    _ => Formula::Constant(false),
                }
            }
            Condition::Not(inner) => self.formula(inner, !positive),
            Condition::And(parts) => self.junction(parts, positive, positive),
            Condition::Or(parts) => self.junction(parts, positive, !positive),
            Condition::Imply(left, right) => {
                let parts = vec![self.formula(left, !positive), self.formula(right, positive)];
                if positive { Formula::Or(parts) } else { Formula::And(parts) }
            }
            Condition::Exists(variables, inner) => {
                self.quantified(variables, inner, positive, positive)
            }
            Condition::Forall(variables, inner) => {
                self.quantified(variables, inner, positive, !positive)
            }
        }
    }

    /// Adds variables to the scope. Returns the number of visible variables before, which
    /// [`FormulaScope::leave`] needs, and the slots of the added variables.
    pub(super) fn enter(&mut self, variables: &[Typed]) -> (usize, Vec<SlotIndex>) {
        let outside = self.visible.len();
        (outside, variables.iter().map(|variable| self.declare(variable)).collect())
    }

    /// Removes the variables from the scope that the matching call of [`FormulaScope::enter`]
    /// added.
    pub(super) fn leave(&mut self, outside: usize) {
        self.visible.truncate(outside);
    }

    pub(super) fn atom(&mut self, atom: &pddl::Atom) -> Option<LiftedAtom> {
        let predicate = self.symbols.predicate(&atom.predicate, atom.arguments.len());
        let arguments = self.terms(&atom.arguments);
        Some(LiftedAtom { predicate: predicate?, arguments: arguments? })
    }

    pub(super) fn fluent(&mut self, fluent: &FluentTerm) -> Option<LiftedFluent> {
        let function = self.symbols.function(&fluent.function, fluent.arguments.len());
        let arguments = self.terms(&fluent.arguments);
        Some(LiftedFluent { function: function?, arguments: arguments? })
    }

    pub(super) fn expression(&mut self, expression: &Expression) -> Option<LiftedExpression> {
        Some(match expression {
            Expression::Number(number) => LiftedExpression::Number(number.0),
            Expression::Fluent(fluent) => LiftedExpression::Fluent(self.fluent(fluent)?),
            Expression::Negate(inner) => {
                LiftedExpression::Negate(Box::new(self.expression(inner)?))
            }
            Expression::Apply(operator, operands) => {
                let operands =
                    operands.iter().map(|one| self.expression(one)).collect::<Option<_>>()?;
                LiftedExpression::Apply(*operator, operands)
            }
            Expression::Duration(span)
            | Expression::ContinuousTime(span)
            | Expression::TotalTime(span) => {
                let message = "time is only defined in durative actions and metrics";
                self.symbols.problems.push(Diagnostic::error(*span, message));
                return None;
            }
        })
    }

    fn declare(&mut self, variable: &Typed) -> SlotIndex {
        let slot = self.frame.len() as SlotIndex;
        let ty = self.symbols.type_set(&variable.ty);
        self.frame.push(ty);
        self.visible.push((variable.name.clone(), slot));
        slot
    }

    fn junction(&mut self, parts: &[Condition], positive: bool, conjunction: bool) -> Formula {
        let parts = parts.iter().map(|part| self.formula(part, positive)).collect();
        if conjunction { Formula::And(parts) } else { Formula::Or(parts) }
    }

    fn quantified(
        &mut self,
        variables: &[Typed],
        inner: &Condition,
        positive: bool,
        existential: bool,
    ) -> Formula {
        let (outside, slots) = self.enter(variables);
        let inner = self.formula(inner, positive);
        self.leave(outside);
        if existential {
            Formula::Exists(slots, Box::new(inner))
        } else {
            Formula::Forall(slots, Box::new(inner))
        }
    }

    fn terms(&mut self, terms: &[Term]) -> Option<Vec<LiftedTerm>> {
        terms.iter().map(|term| self.term(term)).collect()
    }

    fn term(&mut self, term: &Term) -> Option<LiftedTerm> {
        match term {
            Term::Object(name) => self.symbols.object(name).map(LiftedTerm::Object),
            Term::Variable(name) => {
                let found = self.visible.iter().rev().find(|(visible, _)| visible == name);
                if found.is_none() {
                    let message = format!("unknown variable `?{name}`");
                    self.symbols.problems.push(Diagnostic::error(name.span(), message));
                }
                found.map(|(_, slot)| LiftedTerm::Variable(*slot))
            }
        }
    }
}

/// Returns a comparison, or its negation if `positive` is false. If a side is undefined, neither of
/// them holds.
fn comparison(
    comparison: Comparison,
    positive: bool,
    left: LiftedExpression,
    right: LiftedExpression,
) -> Formula {
    let sides = Box::new((left, right));
    if positive {
        return Formula::Compare { comparison, sides };
    }
    let other = |comparison: &Comparison| Formula::Compare {
        comparison: *comparison,
        sides: sides.clone(),
    };
    match comparison.negated() {
        [one] => other(one),
        several => Formula::Or(several.iter().map(other).collect()),
    }
}
