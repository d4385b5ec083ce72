//! Traversal of conditions, effects and expressions. The outermost part comes first, then its parts
//! from left to right.

use std::iter;

use crate::tree::{Assignment, Atom, Condition, Effect, Expression, FluentTerm, Name};

impl Condition {
    /// Iterates over the condition and all conditions inside it.
    pub fn parts(&self) -> impl Iterator<Item = &Condition> {
        let mut open = vec![self];
        iter::from_fn(move || {
            let part = open.pop()?;
            match part {
                Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => (),
                Condition::And(parts) | Condition::Or(parts) => open.extend(parts.iter().rev()),
                Condition::Imply(left, right) => open.extend([&**right, &**left]),
                Condition::Not(inner)
                | Condition::Exists(_, inner)
                | Condition::Forall(_, inner) => open.push(inner),
            }
            Some(part)
        })
    }

    /// Iterates over the atoms in the condition.
    pub fn atoms(&self) -> impl Iterator<Item = &Atom> {
        self.parts().filter_map(|part| match part {
            Condition::Atom(atom) => Some(atom),
            _ => None,
        })
    }

    /// Iterates over the predicates and functions in the condition.
    pub fn symbols(&self) -> impl Iterator<Item = &Name> {
        self.parts().flat_map(|part| match part {
            Condition::Atom(atom) => vec![&atom.predicate],
            Condition::Compare(compare) => {
                let fluents = compare.left.fluents().chain(compare.right.fluents());
                fluents.map(|fluent| &fluent.function).collect()
            }
            _ => Vec::new(),
        })
    }

    /// Iterates over the fluents in the comparisons of the condition.
    pub fn fluents(&self) -> impl Iterator<Item = &FluentTerm> {
        self.parts().flat_map(|part| match part {
            Condition::Compare(compare) => {
                compare.left.fluents().chain(compare.right.fluents()).collect()
            }
            _ => Vec::new(),
        })
    }
}

impl Effect {
    /// Iterates over the effect and all effects inside it, without the conditions of conditional
    /// effects.
    pub fn parts(&self) -> impl Iterator<Item = &Effect> {
        let mut open = vec![self];
        iter::from_fn(move || {
            let part = open.pop()?;
            match part {
                Effect::Add(_) | Effect::Delete(_) | Effect::Assign(_) => (),
                Effect::And(parts) => open.extend(parts.iter().rev()),
                Effect::When(_, inner) | Effect::Forall(_, inner) => open.push(inner),
            }
            Some(part)
        })
    }

    /// Iterates over the atoms that the effect adds, with or without a condition.
    pub fn added(&self) -> impl Iterator<Item = &Atom> {
        self.parts().filter_map(|part| match part {
            Effect::Add(atom) => Some(atom),
            _ => None,
        })
    }

    /// Whether the effect contains an `assign` to the function, for any arguments. The new value
    /// then does not depend on the old value.
    pub fn assigns(&self, function: &Name) -> bool {
        self.parts().any(|part| match part {
            Effect::Assign(assign) => {
                assign.assignment == Assignment::Assign && assign.fluent.function == *function
            }
            _ => false,
        })
    }
}

impl Expression {
    /// Iterates over the expression and all expressions inside it.
    pub fn parts(&self) -> impl Iterator<Item = &Expression> {
        let mut open = vec![self];
        iter::from_fn(move || {
            let part = open.pop()?;
            match part {
                Expression::Negate(inner) => open.push(inner),
                Expression::Apply(_, operands) => open.extend(operands.iter().rev()),
                Expression::Number(_)
                | Expression::Fluent(_)
                | Expression::Duration(_)
                | Expression::ContinuousTime(_)
                | Expression::TotalTime(_) => (),
            }
            Some(part)
        })
    }

    /// Iterates over the fluents in the expression.
    pub fn fluents(&self) -> impl Iterator<Item = &FluentTerm> {
        self.parts().filter_map(|part| match part {
            Expression::Fluent(fluent) => Some(fluent),
            _ => None,
        })
    }

    /// Returns the expression with each fluent replaced by the result of `replace`.
    #[must_use]
    pub fn map_fluents(&self, replace: &mut dyn FnMut(&FluentTerm) -> FluentTerm) -> Expression {
        match self {
            Expression::Fluent(fluent) => Expression::Fluent(replace(fluent)),
            Expression::Negate(inner) => Expression::Negate(Box::new(inner.map_fluents(replace))),
            Expression::Apply(operator, operands) => {
                let operands = operands.iter().map(|operand| operand.map_fluents(replace));
                Expression::Apply(*operator, operands.collect())
            }
            Expression::Number(_)
            | Expression::Duration(_)
            | Expression::ContinuousTime(_)
            | Expression::TotalTime(_) => self.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn parts_are_listed_outermost_first_and_from_left_to_right() {
        let text =
            "(and (p) (not (q a)) (imply (r) (exists (?x - t) (s ?x))) (< (+ (f) (- (g b))) (h)))";
        let condition = crate::parse_condition(text).into_result().expect("a condition");
        let atoms: Vec<_> = condition.atoms().map(ToString::to_string).collect();
        assert_eq!(atoms, ["(p)", "(q a)", "(r)", "(s ?x)"]);
        let fluents: Vec<_> = condition.fluents().map(ToString::to_string).collect();
        assert_eq!(fluents, ["(f)", "(g b)", "(h)"]);
        let symbols: Vec<_> = condition.symbols().map(ToString::to_string).collect();
        assert_eq!(symbols, ["p", "q", "r", "s", "f", "g", "h"]);
        assert_eq!(condition.parts().count(), 9);
        assert_eq!(condition.parts().next(), Some(&condition));
    }

    #[test]
    fn fluents_are_replaced_wherever_they_stand() {
        let text = "(< (+ (f) 2 (- (g b))) (* (f) (h)))";
        let condition = crate::parse_condition(text).into_result().expect("a condition");
        let crate::Condition::Compare(compare) = condition else { panic!("a comparison") };
        let mut seen = 0;
        let left = compare.left.map_fluents(&mut |fluent| {
            seen += 1;
            crate::FluentTerm {
                function: format!("own-{}", fluent.function).as_str().into(),
                ..fluent.clone()
            }
        });
        assert_eq!((left.to_string().as_str(), seen), ("(+ (own-f) 2 (- (own-g b)))", 2));
    }
}
