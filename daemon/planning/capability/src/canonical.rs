//! Canonical texts of declarations. Two declarations have the same canonical text exactly if they
//! are equal except for the names of variables.
//!
//! In a canonical text, variables are numbered in the order in which they are bound, nested `and`s
//! are flattened, and names are lower case. The order of conjuncts is significant: copies of one
//! model have the same order, and equal declarations in different orders are merely not merged.
//!
//! Writing a canonical text also collects the symbols that it uses. With these symbols, an action
//! that needs an undeclared symbol is found.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::Arc;

use pddl::{
    ActionSchema, Atom, Condition, Derived, Effect, Expression, FluentTerm, Name, Term, TypeExpr,
    Typed,
};

use crate::digest;

/// The symbols that an action schema or axiom uses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct UsedSymbols {
    /// Predicates that the schema uses, each with its number of arguments.
    pub(crate) predicates: BTreeSet<(Name, usize)>,
    /// Functions that the schema uses, each with its number of arguments.
    pub(crate) functions: BTreeSet<(Name, usize)>,
    /// Predicates and functions in the `:observe` part, each with its number of arguments.
    pub(crate) observed: BTreeSet<(Name, usize)>,
    /// Types of the schema's variables.
    pub(crate) types: BTreeSet<Name>,
    /// Objects that the schema names directly.
    pub(crate) objects: BTreeSet<Name>,
    /// Predicates that effects of the schema change.
    pub(crate) changed: BTreeSet<Name>,
    /// Functions that effects of the schema change.
    pub(crate) assigned: BTreeSet<Name>,
    /// Variables that the schema uses without declaring them.
    pub(crate) unbound: BTreeSet<Name>,
}

/// A canonical text, used as a key. Clones share one allocation. Keys are compared by digest first,
/// because different texts of one action often differ near the end only.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CanonicalText {
    digest: u64,
    text: Arc<str>,
}

/// Returns the canonical text of an action, without the name of the action, and the symbols that
/// the action uses.
pub(crate) fn action(schema: &ActionSchema) -> (CanonicalText, UsedSymbols) {
    let ActionSchema {
        name: _,
        agent,
        partners,
        parameters,
        precondition,
        effect,
        observe,
        span: _,
    } = schema;
    let mut scribe = CanonicalWriter::default();
    scribe.bind(agent.as_slice());
    scribe.bind(partners);
    scribe.text.push('|');
    scribe.bind(parameters);
    scribe.condition(precondition);
    scribe.effect(effect);
    for observed in observe {
        scribe.text.push('?');
        scribe.applied(&observed.predicate, &observed.arguments);
        scribe.uses.observed.insert((observed.predicate.clone(), observed.arguments.len()));
    }
    scribe.finish()
}

/// Returns the canonical text of an axiom, without the predicate that the axiom derives, and the
/// symbols that the axiom uses.
pub(crate) fn axiom(derived: &Derived) -> (CanonicalText, UsedSymbols) {
    let Derived { predicate: _, parameters, condition, span: _ } = derived;
    let mut scribe = CanonicalWriter::default();
    scribe.bind(parameters);
    scribe.condition(condition);
    scribe.finish()
}

/// Returns the canonical text of the types of some parameters.
pub(crate) fn signature<'a>(types: impl IntoIterator<Item = &'a TypeExpr>) -> CanonicalText {
    let mut text = String::new();
    for ty in types {
        write_type(&mut text, ty);
    }
    CanonicalText::new(&text)
}

fn write_type(text: &mut String, ty: &TypeExpr) {
    text.push('-');
    if ty.is_object() {
        text.push_str("object");
        return;
    }
    let sorted: BTreeSet<&str> = ty.alternatives.iter().map(Name::as_str).collect();
    for alternative in sorted {
        text.push_str(alternative);
        text.push(',');
    }
}

#[derive(Default)]
struct CanonicalWriter {
    text: String,
    /// The variables that are in scope, innermost last. The number of a variable is its index in
    /// this list.
    scope: Vec<Name>,
    uses: UsedSymbols,
}

// === impl CanonicalText ===

impl CanonicalText {
    fn new(text: &str) -> CanonicalText {
        CanonicalText { digest: digest::of_text(text), text: Arc::from(text) }
    }
}

// === impl CanonicalWriter ===

impl CanonicalWriter {
    fn finish(self) -> (CanonicalText, UsedSymbols) {
        (CanonicalText::new(&self.text), self.uses)
    }

    /// Writes the types of `variables` and adds the variables to the scope of the text that
    /// follows.
    fn bind(&mut self, variables: &[Typed]) {
        for Typed { name, ty } in variables {
            write_type(&mut self.text, ty);
            if !ty.is_object() {
                self.uses.types.extend(ty.alternatives.iter().cloned());
            }
            self.scope.push(name.clone());
        }
    }

    /// Writes a quantified part as `(WORD (TYPES) BODY)`. The variables are in scope in the body
    /// only.
    fn quantified(
        &mut self,
        word: &str,
        variables: &[Typed],
        body: impl FnOnce(&mut CanonicalWriter),
    ) {
        let depth = self.scope.len();
        self.open(word);
        self.bind(variables);
        body(self);
        self.text.push(')');
        self.scope.truncate(depth);
    }

    fn open(&mut self, word: &str) {
        self.text.push('(');
        self.text.push_str(word);
        self.text.push(' ');
    }

    fn condition(&mut self, condition: &Condition) {
        match condition {
            Condition::Atom(atom) => self.atom(atom),
            Condition::Equal(left, right, _) => {
                self.open("=");
                self.term(left);
                self.term(right);
                self.text.push(')');
            }
            Condition::Compare(compare) => {
                self.open(&format!("{:?}", compare.comparison));
                self.expression(&compare.left);
                self.expression(&compare.right);
                self.text.push(')');
            }
            Condition::Not(inner) => self.conditions("not", &[inner]),
            Condition::And(_) => {
                let mut parts = Vec::new();
                flatten_condition(condition, &mut parts);
                match parts[..] {
                    [single] => self.condition(single),
                    _ => self.conditions("and", &parts),
                }
            }
            Condition::Or(parts) => self.conditions("or", &parts.iter().collect::<Vec<_>>()),
            Condition::Imply(left, right) => self.conditions("imply", &[left, right]),
            Condition::Exists(variables, inner) => {
                self.quantified("exists", variables, |scribe| scribe.condition(inner));
            }
            Condition::Forall(variables, inner) => {
                self.quantified("forall", variables, |scribe| scribe.condition(inner));
            }
        }
    }

    fn conditions(&mut self, word: &str, parts: &[&Condition]) {
        self.open(word);
        for part in parts {
            self.condition(part);
        }
        self.text.push(')');
    }

    fn effect(&mut self, effect: &Effect) {
        match effect {
            Effect::And(_) => {
                let mut parts = Vec::new();
                flatten_effect(effect, &mut parts);
                match parts[..] {
                    [single] => self.effect(single),
                    _ => self.effects(&parts),
                }
            }
            Effect::Add(atom) => self.change("add", atom),
            Effect::Delete(atom) => self.change("delete", atom),
            Effect::Assign(assign) => {
                self.uses.assigned.insert(assign.fluent.function.clone());
                self.open(&format!("{:?}", assign.assignment));
                self.fluent(&assign.fluent);
                self.expression(&assign.value);
                self.text.push(')');
            }
            Effect::Forall(variables, inner) => {
                self.quantified("forall", variables, |scribe| scribe.effect(inner));
            }
            Effect::When(condition, inner) => {
                self.open("when");
                self.condition(condition);
                self.effect(inner);
                self.text.push(')');
            }
        }
    }

    fn effects(&mut self, parts: &[&Effect]) {
        self.open("and");
        for part in parts {
            self.effect(part);
        }
        self.text.push(')');
    }

    fn change(&mut self, word: &str, atom: &Atom) {
        self.uses.changed.insert(atom.predicate.clone());
        self.open(word);
        self.atom(atom);
        self.text.push(')');
    }

    fn expression(&mut self, expression: &Expression) {
        match expression {
            // Adding zero turns `-0` into `0`, which equals it.
            Expression::Number(number) => {
                let _ = write!(self.text, " {}", number.0 + 0.0);
            }
            Expression::Fluent(fluent) => self.fluent(fluent),
            Expression::Negate(inner) => self.expressions("negate", std::slice::from_ref(inner)),
            Expression::Apply(operator, operands) => {
                self.expressions(&format!("{operator:?}"), operands);
            }
            Expression::Duration(_) => self.text.push_str(" ?duration"),
            Expression::ContinuousTime(_) => self.text.push_str(" #t"),
            Expression::TotalTime(_) => self.text.push_str(" total-time"),
        }
    }

    fn expressions<E: std::borrow::Borrow<Expression>>(&mut self, word: &str, operands: &[E]) {
        self.open(word);
        for operand in operands {
            self.expression(operand.borrow());
        }
        self.text.push(')');
    }

    fn atom(&mut self, atom: &Atom) {
        self.uses.predicates.insert((atom.predicate.clone(), atom.arguments.len()));
        self.applied(&atom.predicate, &atom.arguments);
    }

    fn fluent(&mut self, fluent: &FluentTerm) {
        self.uses.functions.insert((fluent.function.clone(), fluent.arguments.len()));
        self.applied(&fluent.function, &fluent.arguments);
    }

    fn applied(&mut self, symbol: &Name, arguments: &[Term]) {
        self.open(symbol.as_str());
        for argument in arguments {
            self.term(argument);
        }
        self.text.push(')');
    }

    fn term(&mut self, term: &Term) {
        match term {
            Term::Object(name) => {
                self.uses.objects.insert(name.clone());
                let _ = write!(self.text, " {}", name.as_str());
            }
            Term::Variable(name) => match self.scope.iter().rposition(|bound| bound == name) {
                Some(number) => {
                    let _ = write!(self.text, " ?{number}");
                }
                None => {
                    self.uses.unbound.insert(name.clone());
                    let _ = write!(self.text, " ?{}", name.as_str());
                }
            },
        }
    }
}

fn flatten_condition<'a>(condition: &'a Condition, parts: &mut Vec<&'a Condition>) {
    match condition {
        Condition::And(inner) => inner.iter().for_each(|part| flatten_condition(part, parts)),
        other => parts.push(other),
    }
}

fn flatten_effect<'a>(effect: &'a Effect, parts: &mut Vec<&'a Effect>) {
    match effect {
        Effect::And(inner) => inner.iter().for_each(|part| flatten_effect(part, parts)),
        other => parts.push(other),
    }
}

#[cfg(test)]
mod tests {
    /// Checks that the canonical texts of two actions, which exclude the actions' names, are equal
    /// if `expected` is true and different otherwise.
    #[track_caller]
    fn check(one: &str, two: &str, expected: bool) {
        let key = |rest: &str| {
            let text = format!("(define (domain d) (:action a {rest}))");
            let domain = pddl::parse_domain(&text).into_result().expect("an action");
            super::action(&domain.actions[0]).0
        };
        assert_eq!(key(one) == key(two), expected, "{one}\n{two}");
    }

    #[test]
    fn names_of_variables_do_not_matter() {
        check(
            ":agent ?a - t :parameters (?x ?y) :precondition (p ?x ?a) :effect (q ?y)",
            ":agent ?y - T :parameters (?a - object ?x) :precondition (P ?a ?y) :effect (q ?x)",
            true,
        );
        check(":parameters (?x ?y) :effect (q ?x)", ":parameters (?y ?x) :effect (q ?x)", false);
        // An inner variable hides an outer one of the same name, until its quantifier ends.
        check(
            ":parameters (?x) :precondition (and (exists (?x) (p ?x)) (q ?x))",
            ":parameters (?x) :precondition (and (exists (?y) (p ?y)) (q ?x))",
            true,
        );
        check(
            ":parameters (?x) :precondition (exists (?x) (p ?x))",
            ":parameters (?x) :precondition (exists (?y) (p ?x))",
            false,
        );
    }

    #[test]
    fn nesting_of_conjunctions_does_not_matter() {
        check(":effect (and (and (p)) (and) (q))", ":effect (and (p) (q))", true);
        check(":precondition (and (p)) :effect (and (q))", ":precondition (p) :effect (q)", true);
        check(":precondition () :effect (q)", ":effect (q)", true);
        check(":precondition (or (p) (and))", ":precondition (or (p))", false);
    }

    #[test]
    fn all_other_differences_matter() {
        check(":effect (increase (c) 1)", ":effect (increase (c) 1.0)", true);
        for (one, two) in [
            (":effect (increase (c) 1)", ":effect (increase (c) 2)"),
            (":effect (increase (c) 1)", ":effect (decrease (c) 1)"),
            (":precondition (< (c) (+ (d) 1))", ":precondition (< (c) (- (d) 1))"),
            (":precondition (< (c) 1)", ":precondition (<= (c) 1)"),
            (":precondition (= a b)", ":precondition (= b a)"),
            (":effect (p)", ":effect (not (p))"),
            (":effect (when (p) (q))", ":effect (when (q) (p))"),
            (":precondition (forall (?x) (p ?x))", ":precondition (exists (?x) (p ?x))"),
            (":agent ?x - t :parameters (?y)", ":agent ?x - t :parameters (?y - t)"),
            (":agent ?x - t", ":parameters (?x - t)"),
            (":parameters (?x - (either s t))", ":parameters (?x - s)"),
        ] {
            check(one, two, false);
        }
        check(":parameters (?x - (either s t))", ":parameters (?x - (either t s))", true);
    }
}
