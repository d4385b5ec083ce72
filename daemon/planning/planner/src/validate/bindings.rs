//! Bindings of variables to objects, by name. They replace variables in conditions that are shown
//! to the user.

use pddl::{Atom, Compare, Condition, Expression, FluentTerm, Name, Term, Typed};

/// The variables in scope, each with its object. The innermost variable is the last.
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

    /// Returns the name of the object to which a term refers. For an unbound variable, returns the
    /// name of the variable itself; no fact holds for that name.
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

    /// Returns the atom with bound variables replaced by their objects.
    pub(crate) fn atom(&self, atom: &Atom) -> Atom {
        Atom { arguments: self.terms(&atom.arguments), ..atom.clone() }
    }

    /// Returns the condition with bound variables replaced by their objects.
    pub(crate) fn substitute(&self, condition: &Condition) -> Condition {
        let all = |parts: &[Condition]| parts.iter().map(|part| self.substitute(part)).collect();
        match condition {
            Condition::Atom(atom) => Condition::Atom(self.atom(atom)),
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
        expression.map_fluents(&mut |fluent| self.fluent(fluent))
    }

    /// Returns the bindings without those of `variables`, because an inner quantifier binds these
    /// again.
    fn hiding(&self, variables: &[Typed]) -> Bindings {
        let hidden = |name: &Name| variables.iter().any(|variable| variable.name == *name);
        Bindings(self.0.iter().filter(|(name, _)| !hidden(name)).cloned().collect())
    }
}
