//! Checks of conditions and expressions, and of the symbols in them.

use super::{Checker, count};
use crate::diagnostic::Diagnostic;
use crate::tree::{Atom, Condition, Expression, FluentTerm, Name, Span, Term, TypeExpr, Typed};

impl<'t> Checker<'_, 't> {
    pub(super) fn condition(&mut self, condition: &'t Condition) {
        match condition {
            Condition::Atom(atom) => self.atom(atom),
            Condition::Equal(left, right, _) => {
                self.term(left);
                self.term(right);
            }
            Condition::Compare(compare) => {
                self.expression(&compare.left);
                self.expression(&compare.right);
            }
            Condition::Not(inner) => self.condition(inner),
            Condition::And(parts) | Condition::Or(parts) => {
                parts.iter().for_each(|part| self.condition(part));
            }
            Condition::Imply(premise, conclusion) => {
                self.condition(premise);
                self.condition(conclusion);
            }
            Condition::Exists(variables, inner) | Condition::Forall(variables, inner) => {
                self.quantified(variables);
                self.with_scope(variables, |checker| checker.condition(inner));
            }
        }
    }

    pub(super) fn expression(&mut self, expression: &'t Expression) {
        match expression {
            Expression::Fluent(fluent) => self.fluent(fluent),
            Expression::Negate(inner) => self.expression(inner),
            Expression::Apply(_, operands) => {
                operands.iter().for_each(|operand| self.expression(operand));
            }
            Expression::Number(_)
            | Expression::Duration(_)
            | Expression::ContinuousTime(_)
            | Expression::TotalTime(_) => {}
        }
    }

    /// Checks a predicate with its arguments, `(PREDICATE TERM*)`.
    pub(super) fn atom(&mut self, atom: &'t Atom) {
        let Some(declaration) = self.symbols.predicate(&atom.predicate) else {
            self.unknown_predicate(&atom.predicate);
            return self.terms(&atom.arguments);
        };
        let call =
            AppliedSymbol { name: &atom.predicate, arguments: &atom.arguments, span: atom.span };
        self.call(&call, &declaration.parameters, || declaration.to_string());
    }

    /// Checks a function with its arguments, `(FUNCTION TERM*)`.
    pub(super) fn fluent(&mut self, fluent: &'t FluentTerm) {
        let Some(declaration) = self.symbols.function(&fluent.function) else {
            self.unknown_function(fluent);
            return self.terms(&fluent.arguments);
        };
        let call = AppliedSymbol {
            name: &fluent.function,
            arguments: &fluent.arguments,
            span: fluent.span,
        };
        self.call(&call, &declaration.parameters, || declaration.to_string());
    }

    /// Checks an observed predicate or function with its arguments, `(SYMBOL TERM*)`.
    pub(super) fn observed(&mut self, observed: &'t Atom) {
        let symbols = self.symbols;
        let Some(function) = symbols.function(&observed.predicate) else {
            return self.atom(observed);
        };
        let Atom { predicate: name, arguments, span } = observed;
        let call = AppliedSymbol { name, arguments, span: *span };
        self.call(&call, &function.parameters, || function.to_string());
    }

    pub(super) fn unknown_predicate(&mut self, name: &'t Name) {
        let symbols = self.symbols;
        if let Some(function) = symbols.function(name) {
            let message = format!("`{name}` is a function, not a predicate");
            let confused = Diagnostic::error(name.span(), message).with_rule(function.to_string());
            return self.report(confused.with_help("compare its value: `(= (…) NUMBER)`"));
        }
        if symbols.is_action(name) {
            let message = format!(
                "`{name}` is an action; conditions on actions at the same time are not supported"
            );
            return self.report(Diagnostic::unsupported(name.span(), message));
        }
        let near = self.nearest(name.as_str(), symbols.predicate_names());
        let message = format!("unknown predicate `{name}`");
        let mut unknown = Diagnostic::error(name.span(), message).with_suggestion(near);
        if let Some(declaration) = near.and_then(|near| symbols.predicate(&Name::new(near))) {
            unknown = unknown.with_rule(declaration.to_string());
        }
        self.report(unknown);
    }

    fn unknown_function(&mut self, fluent: &'t FluentTerm) {
        let (symbols, name) = (self.symbols, &fluent.function);
        if *name == crate::tree::TOTAL_COST && fluent.arguments.is_empty() {
            let message = "`total-cost` is not declared";
            let undeclared = Diagnostic::warning(name.span(), message);
            return self.report(undeclared.with_help("add `(:functions (total-cost) - number)`"));
        }
        if let Some(predicate) = symbols.predicate(name) {
            let message = format!("`{name}` is a predicate, not a function");
            let confused = Diagnostic::error(name.span(), message);
            return self.report(confused.with_rule(predicate.to_string()));
        }
        if symbols.object(name).is_some() && fluent.arguments.is_empty() {
            let message = format!("`{name}` is an object, and has no value to compare or compute");
            let help = "only a variable can be compared with an object that is named by digits: \
                        `(= ?x 1)`";
            return self.report(Diagnostic::error(name.span(), message).with_help(help));
        }
        let near = self.nearest(name.as_str(), symbols.function_names());
        let message = format!("unknown function `{name}`");
        let mut unknown = Diagnostic::error(name.span(), message).with_suggestion(near);
        if let Some(declaration) = near.and_then(|near| symbols.function(&Name::new(near))) {
            unknown = unknown.with_rule(declaration.to_string());
        }
        self.report(unknown);
    }

    /// Checks arguments against the parameters of a declaration. `rule` returns the text of the
    /// declaration for a diagnostic.
    fn call(
        &mut self,
        call: &AppliedSymbol<'t>,
        parameters: &'t [Typed],
        rule: impl Fn() -> String,
    ) {
        let (found, wanted) = (call.arguments.len(), parameters.len());
        if found != wanted {
            let wanted = count(wanted, "argument");
            let message = format!("`{}` takes {wanted}, found {found}", call.name);
            self.report(Diagnostic::error(call.span, message).with_rule(rule()));
            return self.terms(call.arguments);
        }
        for (argument, parameter) in call.arguments.iter().zip(parameters) {
            if let Some(actual) = self.term(argument) {
                self.argument(argument, actual, &parameter.ty, call.name, &rule);
            }
        }
    }

    /// Checks the type of an argument. An object must have the required type. For a variable it
    /// suffices that some object of its type can have the required type.
    fn argument(
        &mut self,
        argument: &'t Term,
        actual: &'t TypeExpr,
        wanted: &'t TypeExpr,
        of: &Name,
        rule: &impl Fn() -> String,
    ) {
        let types = &self.symbols.types;
        if types.accepts(wanted, actual)
            || !self.are_types_known(wanted)
            || !self.are_types_known(actual)
        {
            return;
        }
        if matches!(argument, Term::Object(name) if self.symbols.is_also(name, wanted)) {
            return;
        }
        let name = argument.name();
        let is_variable = matches!(argument, Term::Variable(_));
        let message = format!("`{argument}` is of type `{actual}`, `{of}` wants `{wanted}`");
        let diagnostic = match is_variable && types.overlap(wanted, actual) {
            true => Diagnostic::warning(name.span(), message).with_help("not every one is"),
            false => Diagnostic::error(name.span(), message),
        };
        self.report(diagnostic.with_rule(rule()));
    }

    /// Whether all alternatives of a type are declared. Undeclared types are reported at their
    /// declaration.
    pub(super) fn are_types_known(&self, ty: &TypeExpr) -> bool {
        ty.alternatives.iter().all(|name| self.symbols.types.contains(name.as_str()))
    }

    fn terms(&mut self, terms: &'t [Term]) {
        for term in terms {
            self.term(term);
        }
    }

    /// Returns the type of a term; `None` if the variable or object is not declared.
    pub(super) fn term(&mut self, term: &'t Term) -> Option<&'t TypeExpr> {
        match term {
            Term::Variable(name) => self.variable(name),
            Term::Object(name) => self.object(name),
        }
    }

    fn variable(&mut self, name: &'t Name) -> Option<&'t TypeExpr> {
        if let Some(typed) = self.variable_in_scope(name.as_str()) {
            return Some(&typed.ty);
        }
        let scope = std::mem::take(&mut self.scope);
        let known = scope.iter().map(|typed| typed.name.as_str());
        let near = self.nearest(name.as_str(), known).map(|near| format!("?{near}"));
        self.scope = scope;
        let message = format!("unknown variable `?{name}`");
        let unknown = Diagnostic::error(name.span(), message);
        self.report(unknown.with_suggestion(near.as_deref()));
        None
    }

    pub(super) fn object(&mut self, name: &'t Name) -> Option<&'t TypeExpr> {
        let symbols = self.symbols;
        if let Some(typed) = symbols.object(name) {
            return Some(&typed.ty);
        }
        let message = format!("unknown object `{name}`");
        if self.variable_in_scope(name.as_str()).is_some() {
            let unmarked = Diagnostic::error(name.span(), message);
            self.report(unmarked.with_suggestion(Some(&format!("?{name}"))));
        } else if symbols.is_open {
            if self.reported_objects.insert(name.as_str()) {
                let hint = Diagnostic::hint(name.span(), message);
                self.report(hint.with_help("the map or another agent has to bring it"));
            }
        } else {
            let near = self.nearest(name.as_str(), symbols.object_names());
            let mut unknown = Diagnostic::error(name.span(), message).with_suggestion(near);
            if is_number(name) {
                let help = "a variable or an argument is an object, and no object is called so; \
                            numbers are the values of functions: `(= (FUNCTION …) NUMBER)`";
                unknown = unknown.with_help(help);
            } else if near.is_none() && symbols.is_of_domain {
                let help = "add it to `:constants`, or take a parameter: a domain knows no \
                            objects of problems";
                unknown = unknown.with_help(help);
            }
            self.report(unknown);
        }
        None
    }
}

/// Whether a name is written like a number.
fn is_number(name: &Name) -> bool {
    name.as_str().parse::<f64>().is_ok_and(f64::is_finite)
}

/// A predicate or a function with its arguments.
struct AppliedSymbol<'t> {
    name: &'t Name,
    arguments: &'t [Term],
    span: Span,
}
