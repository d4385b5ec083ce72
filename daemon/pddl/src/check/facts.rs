//! Problems: objects, facts, goal, metric.

use foldhash::HashMap;

use super::Checker;
use crate::diagnostic::Diagnostic;
use crate::tree::{Atom, Domain, FluentTerm, InitElement, Number, ObjectDeclaration, Problem};

/// What becomes of values for functions that the domain does not have.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Values {
    /// Competition problems carry values that some domains do without: a warning.
    Spare,
    /// An error.
    Declared,
}

impl<'t> Checker<'_, 't> {
    pub(super) fn problem(&mut self, domain: &'t Domain, problem: &'t Problem) {
        if problem.domain != domain.name {
            let message = format!("the domain is called `{}`", domain.name);
            self.report(Diagnostic::warning(problem.domain.span(), message));
        }
        self.requirements(&problem.requirements);
        self.objects(domain, &problem.objects);
        self.init(&problem.init, Values::Spare);
        self.condition(&problem.goal);
        if let Some(metric) = &problem.metric {
            self.expression(&metric.expression);
        }
    }

    /// Objects of a problem or a model, beside the constants of the domain.
    pub(super) fn objects(&mut self, domain: &'t Domain, objects: &'t [ObjectDeclaration]) {
        self.unique("object", objects.iter().map(|declaration| &declaration.object.name));
        let constants: HashMap<&str, _> =
            domain.constants.iter().map(|typed| (typed.name.as_str(), typed)).collect();
        for (index, declaration) in objects.iter().enumerate() {
            let object = &declaration.object;
            // `a b c - typo` is one mistake, not three.
            if index == 0 || object.ty != objects[index - 1].object.ty {
                self.type_expr(&object.ty);
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
            false => Diagnostic::error(name.span(), format!("{message}, of another type")),
        });
    }

    pub(super) fn init(&mut self, elements: &'t [InitElement], spare: Values) {
        let mut values = HashMap::default();
        for element in elements {
            self.init_element(element, spare);
            if let InitElement::Assign(fluent, number) = element {
                self.one_value(fluent, *number, &mut values);
            }
        }
    }

    fn init_element(&mut self, element: &'t InitElement, values: Values) {
        match element {
            InitElement::Atom(atom) | InitElement::Not(atom) => self.fact(atom),
            // Also of what is derived: an agent that has left knew what it is derived from.
            InitElement::Unknown(atom) => self.atom(atom),
            InitElement::Assign(fluent, _) => match values {
                Values::Spare if self.is_spare(fluent) => self.report_spare(fluent),
                Values::Spare | Values::Declared => self.fluent(fluent),
            },
            InitElement::At(_, inner) => self.init_element(inner, values),
        }
    }

    /// Whether nobody could have meant a function of the domain.
    fn is_spare(&mut self, fluent: &'t FluentTerm) -> bool {
        let symbols = self.symbols;
        let name = &fluent.function;
        symbols.function(name).is_none()
            && symbols.predicate(name).is_none()
            && self.nearest(name.as_str(), symbols.function_names()).is_none()
    }

    fn report_spare(&mut self, fluent: &'t FluentTerm) {
        let message = format!("the domain has no function `{}`", fluent.function);
        let spare = Diagnostic::warning(fluent.function.span(), message);
        self.report(spare.with_help("the value is never read"));
    }

    fn fact(&mut self, atom: &'t Atom) {
        self.atom(atom);
        if self.symbols.is_derived(&atom.predicate) {
            let message = format!("`{}` is derived, no fact can set it", atom.predicate);
            let derived = Diagnostic::error(atom.predicate.span(), message);
            self.report(derived.with_help("state what it is derived from"));
        }
    }

    /// A function has one value at the start.
    fn one_value(
        &mut self,
        fluent: &'t FluentTerm,
        number: Number,
        values: &mut HashMap<&'t FluentTerm, Number>,
    ) {
        let first = *values.entry(fluent).or_insert(number);
        if first != number {
            let message = format!("`{fluent}` is {first} already, and now {number}");
            self.report(Diagnostic::error(fluent.span, message));
        }
    }
}
