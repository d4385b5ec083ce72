//! Checks of problems: objects, facts, goal and metric.

use foldhash::HashMap;

use super::Checker;
use crate::diagnostic::Diagnostic;
use crate::tree::{
    Atom, Domain, FluentTerm, InitElement, Number, ObjectDeclaration, Problem, Span,
};

/// Treatment of two mistakes in the initial state: a fact or value of a symbol that the domain does
/// not declare, and a second value of one function.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum UndeclaredSymbols {
    /// Facts and values of undeclared symbols are superfluous and cause warnings, and so does a
    /// second value. Competition problems contain values of undeclared functions, and give some
    /// numbers twice.
    Spare,
    /// Treatment for the map of an ecosystem: a fact of an undeclared predicate and a second value
    /// are errors, but a value of an undeclared function is a warning.
    Map,
    /// Facts and values of undeclared symbols are errors, and so is a second value.
    Declared,
}

impl<'t> Checker<'_, 't> {
    pub(super) fn problem(
        &mut self,
        domain: &'t Domain,
        problem: &'t Problem,
        values: UndeclaredSymbols,
    ) {
        self.domain_name(&problem.domain, &domain.name);
        self.requirements(&problem.requirements);
        self.objects(domain, &problem.objects);
        self.init(&problem.init, values);
        self.condition(&problem.goal);
        if let Some(metric) = &problem.metric {
            self.expression(&metric.expression);
        }
    }

    /// Checks the objects of a problem or an action model, together with the constants of the
    /// domain.
    pub(super) fn objects(&mut self, domain: &'t Domain, objects: &'t [ObjectDeclaration]) {
        self.objects_once("object", objects.iter().map(|declaration| &declaration.object));
        let constants: HashMap<&str, _> =
            domain.constants.iter().map(|typed| (typed.name.as_str(), typed)).collect();
        for (index, declaration) in objects.iter().enumerate() {
            let object = &declaration.object;
            // In `a b c - typo`, the type is one mistake, not three.
            if index == 0 || object.ty != objects[index - 1].object.ty {
                self.type_expr(&object.ty);
                self.either_of_an_object(object);
            }
            if let Some(constant) = constants.get(object.name.as_str()) {
                self.constant_again(declaration, constant.ty == object.ty);
            }
        }
    }

    fn constant_again(&mut self, declaration: &'t ObjectDeclaration, is_same: bool) {
        let name = &declaration.object.name;
        let message = format!("`{name}` is a constant of the domain already");
        self.report(match is_same {
            true => Diagnostic::warning(name.span(), message),
            false => Diagnostic::warning(name.span(), format!("{message}, of another type"))
                .with_help("it belongs to both types"),
        });
    }

    pub(super) fn init(&mut self, elements: &'t [InitElement], spare: UndeclaredSymbols) {
        let mut values = HashMap::default();
        for element in elements {
            self.init_element(element, spare);
            if let InitElement::Assign(fluent, number) = element {
                self.one_value(fluent, *number, spare, &mut values);
            }
        }
        self.contradictions(elements);
    }

    /// Reports facts that are stated to be true and also to be false. Such a fact counts as true,
    /// as after an action that both adds and deletes it.
    fn contradictions(&mut self, elements: &'t [InitElement]) {
        let mut denied: HashMap<&Atom, &Atom> = HashMap::default();
        for element in elements {
            if let InitElement::Not(atom) = element {
                denied.entry(atom).or_insert(atom);
            }
        }
        if denied.is_empty() {
            return;
        }
        for element in elements {
            let InitElement::Atom(atom) = element else { continue };
            if let Some(no) = denied.remove(atom) {
                let message =
                    format!("`{atom}` is said to be true here, and to be false elsewhere");
                let both =
                    Diagnostic::warning(atom.span, message).with_help("it is taken to be true");
                self.report(both.with_note(no.span, "here it is false"));
            }
        }
    }

    fn init_element(&mut self, element: &'t InitElement, values: UndeclaredSymbols) {
        match element {
            InitElement::Atom(atom) | InitElement::Not(atom)
                if values == UndeclaredSymbols::Spare && self.is_spare_fact(atom) =>
            {
                self.report_spare_fact(atom);
            }
            InitElement::Atom(atom) | InitElement::Not(atom) => self.fact(atom),
            // Derived facts may also be unknown, because an agent that has left may have known the
            // facts that they are derived from.
            InitElement::Unknown(atom) => self.atom(atom),
            InitElement::Assign(fluent, _) => match values {
                UndeclaredSymbols::Spare | UndeclaredSymbols::Map if self.is_spare(fluent) => {
                    self.report_spare(fluent)
                }
                UndeclaredSymbols::Spare | UndeclaredSymbols::Map | UndeclaredSymbols::Declared => {
                    self.fluent(fluent)
                }
            },
            InitElement::At(_, inner) => self.init_element(inner, values),
        }
    }

    /// Whether the value of this function is superfluous: the domain has no symbol of this name,
    /// and no function with a similar name that could be meant.
    fn is_spare(&mut self, fluent: &'t FluentTerm) -> bool {
        let symbols = self.symbols;
        let name = &fluent.function;
        symbols.function(name).is_none()
            && symbols.predicate(name).is_none()
            && self.nearest(name.as_str(), symbols.function_names()).is_none()
    }

    /// Whether this fact is superfluous: the domain has no symbol with the name of its predicate.
    /// No other part of the task can then use the fact, because each use would be reported.
    fn is_spare_fact(&self, atom: &Atom) -> bool {
        self.symbols.predicate(&atom.predicate).is_none()
            && self.symbols.function(&atom.predicate).is_none()
    }

    fn report_spare_fact(&mut self, atom: &'t Atom) {
        let name = &atom.predicate;
        let symbols = self.symbols;
        let near = self.nearest(name.as_str(), symbols.predicate_names());
        let spare =
            Diagnostic::warning(name.span(), format!("the domain has no predicate `{name}`"));
        self.report(match near {
            Some(near) => spare.with_suggestion(Some(near)),
            None => spare.with_help("declare it in `:predicates`, or leave the fact out"),
        });
    }

    fn report_spare(&mut self, fluent: &'t FluentTerm) {
        let message = format!("the domain has no function `{}`", fluent.function);
        let spare = Diagnostic::warning(fluent.function.span(), message);
        self.report(spare.with_help("declare it in `:functions`, or leave the value out"));
    }

    fn fact(&mut self, atom: &'t Atom) {
        self.atom(atom);
        if self.symbols.is_derived(&atom.predicate) {
            let message = format!("`{}` is derived, no fact can set it", atom.predicate);
            let derived = Diagnostic::error(atom.predicate.span(), message);
            self.report(derived.with_help("state what it is derived from"));
        }
    }

    /// Checks that a function has only one value in the initial state. In competition problems the
    /// last value counts.
    fn one_value(
        &mut self,
        fluent: &'t FluentTerm,
        number: Number,
        spare: UndeclaredSymbols,
        values: &mut HashMap<&'t FluentTerm, (Number, Span)>,
    ) {
        let Some((first, place)) = values.insert(fluent, (number, fluent.span)) else { return };
        if first == number {
            return;
        }
        let message = format!("`{fluent}` is {first} already, and now {number}");
        let twice = match spare {
            UndeclaredSymbols::Spare => {
                Diagnostic::warning(fluent.span, message).with_help("the last value counts")
            }
            UndeclaredSymbols::Map | UndeclaredSymbols::Declared => {
                Diagnostic::error(fluent.span, message)
            }
        };
        self.report(twice.with_note(place, format!("here it is {first}")));
    }
}
