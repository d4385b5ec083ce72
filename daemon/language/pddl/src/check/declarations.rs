//! Checks of declarations: each name must be declared once, and each type must be known.

use foldhash::{HashMap, HashSet};

use super::Checker;
use crate::diagnostic::{Diagnostic, Severity};
use crate::tree::{ActionSchema, Domain, DurativeAction, Name, TypeExpr, Typed};
use crate::types::SUPERTYPES_MAX;

/// Requirement flags of PDDL 1.2 to 3.1, PDDL+ and MA-PDDL, and flags that planners commonly
/// accept.
const REQUIREMENTS: &[&str] = &[
    ":strips",
    ":typing",
    ":equality",
    ":negation",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":adl",
    ":ucpop",
    ":derived-predicates",
    ":domain-axioms",
    ":action-costs",
    ":fluents",
    ":numeric-fluents",
    ":object-fluents",
    ":goal-utilities",
    ":durative-actions",
    ":duration-inequalities",
    ":continuous-effects",
    ":time",
    ":timed-effects",
    ":timed-initial-literals",
    ":timed-initial-fluents",
    ":preferences",
    ":constraints",
    ":safety-constraints",
    ":multi-agent",
    ":multi-agents",
    ":agents",
    ":unfactored-privacy",
    ":factored-privacy",
];

impl<'t> Checker<'_, 't> {
    pub(super) fn domain(&mut self, domain: &'t Domain) {
        self.requirements(&domain.requirements);
        self.types(&domain.types);
        self.types_once(&domain.types);
        self.objects_once("constant", domain.constants.iter());
        self.signatures(
            "predicate",
            domain.predicates.iter().map(|it| (&it.name, &*it.parameters)),
        );
        self.signatures("function", domain.functions.iter().map(|it| (&it.name, &*it.parameters)));
        self.types_of(&domain.constants);
        for (index, constant) in domain.constants.iter().enumerate() {
            if index == 0 || constant.ty != domain.constants[index - 1].ty {
                self.either_of_an_object(constant);
            }
        }
        for function in &domain.functions {
            self.named_like_a_predicate(&function.name);
        }
        self.derived(&domain.derived);
        self.actions(&domain.actions, &domain.durative_actions);
    }

    pub(super) fn actions(
        &mut self,
        actions: &'t [ActionSchema],
        durative_actions: &'t [DurativeAction],
    ) {
        let names = actions.iter().map(|action| &action.name);
        self.unique("action", names.chain(durative_actions.iter().map(|action| &action.name)));
        for action in actions {
            self.action(action);
        }
        for action in durative_actions {
            self.durative_action(action);
        }
    }

    pub(super) fn requirements(&mut self, requirements: &'t [Name]) {
        for requirement in requirements {
            if !REQUIREMENTS.contains(&requirement.as_str()) {
                let near = self.nearest(requirement.as_str(), REQUIREMENTS.iter().copied());
                let message = format!("unknown requirement `{requirement}`");
                self.report(Diagnostic::warning(requirement.span(), message).with_suggestion(near));
            }
        }
    }

    /// Checks the hierarchy of types: reports undeclared supertypes, types with too many
    /// supertypes, and cycles.
    pub(super) fn types(&mut self, types: &'t [Typed]) {
        let own = types.iter().chain(self.foreign_types.unwrap_or_default());
        let mut declared: HashSet<&str> = own.map(|typed| typed.name.as_str()).collect();
        for supertype in types.iter().flat_map(|typed| &typed.ty.alternatives) {
            let name = supertype.as_str();
            if name != "object" && declared.insert(name) {
                self.undeclared_supertype(supertype, types);
            }
        }
        if let Some(name) = self.symbols.types.too_high() {
            let message = format!("more than {SUPERTYPES_MAX} types stand above `{name}`");
            self.report(Diagnostic::error(name.span(), message));
        }
        if let Some(name) = self.symbols.types.cycle() {
            let cycle: Vec<_> = self.symbols.types.supertypes(name.as_str()).collect();
            let path: Vec<_> = cycle.iter().map(|name| format!("`{name}`")).collect();
            let message = format!("type `{name}` is its own supertype");
            let through = match &path[..] {
                [] => "a type cannot be its own supertype".to_owned(),
                path => format!("by way of {}", path.join(", ")),
            };
            self.report(Diagnostic::error(name.span(), message).with_help(through));
        }
    }

    fn undeclared_supertype(&mut self, supertype: &'t Name, types: &'t [Typed]) {
        let declared = types.iter().map(|typed| typed.name.as_str());
        let near = self.nearest(supertype.as_str(), declared);
        let message = format!("supertype `{supertype}` is not declared");
        let undeclared = Diagnostic::warning(supertype.span(), message);
        self.report(match near {
            Some(_) => undeclared.with_suggestion(near),
            None => undeclared.with_help(format!("declare it: `{supertype} - object`")),
        });
    }

    /// Reports types that are declared more than once. Such a type is a subtype of all its declared
    /// supertypes.
    pub(super) fn types_once(&mut self, types: &'t [Typed]) {
        let mut firsts: HashMap<&str, &Typed> = HashMap::default();
        for typed in types {
            let Some(first) = firsts.get(typed.name.as_str()) else {
                firsts.insert(typed.name.as_str(), typed);
                continue;
            };
            let help = match first.ty == typed.ty {
                true => "leave one of the two out".to_owned(),
                false => format!("it is a kind of `{}` and of `{}`", first.ty, typed.ty),
            };
            let message = format!("type `{}` is declared twice", typed.name);
            let twice = Diagnostic::warning(typed.name.span(), message).with_help(help);
            self.report(twice.with_note(first.name.span(), "the first is here"));
        }
    }

    /// Reports objects that are declared more than once. Such an object belongs to all its declared
    /// types.
    pub(super) fn objects_once(&mut self, what: &str, objects: impl Iterator<Item = &'t Typed>) {
        let mut firsts: HashMap<&str, &Typed> = HashMap::default();
        for object in objects {
            let Some(first) = firsts.get(object.name.as_str()) else {
                firsts.insert(object.name.as_str(), object);
                self.named_like_a_type(object);
                continue;
            };
            let help = match first.ty == object.ty {
                true => "leave one of the two out".to_owned(),
                false => format!("it is of type `{}` and of type `{}`", first.ty, object.ty),
            };
            let message = format!("{what} `{}` is declared twice", object.name);
            let twice = Diagnostic::warning(object.name.span(), message).with_help(help);
            self.report(twice.with_note(first.name.span(), "the first is here"));
        }
    }

    /// Reports an object without a type that has the name of a type, because a dash is probably
    /// missing.
    fn named_like_a_type(&mut self, object: &'t Typed) {
        let name = object.name.as_str();
        if object.ty.alternatives.is_empty()
            && name != "object"
            && self.symbols.types.contains(name)
        {
            let message = format!("the object `{}` has the name of a type", object.name);
            let help = format!("for the type of what stands before it, write `- {}`", object.name);
            self.report(Diagnostic::warning(object.name.span(), message).with_help(help));
        }
    }

    /// Checks the declarations of predicates or of functions. Repeated declarations of a name are
    /// compared without the names of their parameters.
    pub(super) fn signatures(
        &mut self,
        what: &str,
        declared: impl Iterator<Item = (&'t Name, &'t [Typed])>,
    ) {
        let mut firsts: HashMap<&str, (&Name, &[Typed])> = HashMap::default();
        for (name, parameters) in declared {
            self.parameters_once(parameters, Severity::Warning);
            self.types_of_declaration(parameters);
            let Some((first, own)) = firsts.get(name.as_str()) else {
                firsts.insert(name.as_str(), (name, parameters));
                continue;
            };
            let message = format!("{what} `{name}` is declared twice");
            let twice = match own.len() == parameters.len() {
                true => Diagnostic::warning(name.span(), message).with_help("the first one counts"),
                false => Diagnostic::error(name.span(), message),
            };
            self.report(twice.with_note(first.span(), "the first is here"));
        }
    }

    /// Checks the types of the parameters of a predicate or function. An undeclared type is only a
    /// warning, because it has no objects and therefore no effect.
    fn types_of_declaration(&mut self, parameters: &'t [Typed]) {
        self.types_of_list(parameters, Severity::Warning);
    }

    /// Checks the types of variables. An undeclared type has no objects; it is accepted with a
    /// warning unless it is similar to a declared type.
    fn types_of_variables(&mut self, variables: &'t [Typed]) {
        self.types_of_list(variables, Severity::Error);
    }

    fn types_of_list(&mut self, variables: &'t [Typed], severity: Severity) {
        for (index, typed) in variables.iter().enumerate() {
            // In `?x ?y - typo`, the type is one mistake, not two.
            if index == 0 || typed.ty != variables[index - 1].ty {
                self.types_if_any(typed, severity);
            }
        }
    }

    /// Reports the undeclared types of a variable. The report has the given `severity` if a similar
    /// type exists; otherwise it is a warning.
    fn types_if_any(&mut self, variable: &'t Typed, severity: Severity) {
        let symbols = self.symbols;
        let names = variable.ty.alternatives.iter();
        for name in names.filter(|name| !symbols.types.contains(name.as_str())) {
            let near = self.nearest(name.as_str(), symbols.types.iter().map(Name::as_str));
            let message = format!("unknown type `{name}`");
            self.report(match near {
                Some(_) => Diagnostic { severity, ..Diagnostic::error(name.span(), message) }
                    .with_suggestion(near),
                None => Diagnostic::warning(name.span(), message)
                    .with_help("it is not declared, and nothing is of it"),
            });
        }
    }

    /// Reports names that are declared more than once.
    pub(super) fn unique(&mut self, what: &str, names: impl Iterator<Item = &'t Name>) {
        let mut firsts: HashMap<&str, &Name> = HashMap::default();
        for name in names {
            if let Some(first) = firsts.get(name.as_str()) {
                let message = format!("{what} `{name}` is declared twice");
                let twice = Diagnostic::error(name.span(), message);
                self.report(twice.with_note(first.span(), "the first is here"));
            } else {
                firsts.insert(name.as_str(), name);
            }
        }
    }

    /// Checks the variables of a quantifier. Of two variables with the same name, the second hides
    /// the first, which is a warning.
    pub(super) fn quantified(&mut self, variables: &'t [Typed]) {
        self.parameters_once(variables, Severity::Warning);
        self.types_in_place(variables);
    }

    fn parameters_once(&mut self, parameters: &'t [Typed], severity: Severity) {
        let mut firsts: HashMap<&str, &Name> = HashMap::default();
        for Typed { name, .. } in parameters {
            let Some(first) = firsts.get(name.as_str()) else {
                firsts.insert(name.as_str(), name);
                continue;
            };
            let message = format!("parameter `?{name}` is declared twice");
            let twice = Diagnostic { severity, ..Diagnostic::error(name.span(), message) };
            self.report(twice.with_note(first.span(), "the first is here"));
        }
    }

    /// Checks the variables of an action, an axiom, or a declaration.
    pub(super) fn parameters(&mut self, parameters: &'t [Typed]) {
        self.parameters_once(parameters, Severity::Error);
        self.types_in_place(parameters);
    }

    fn types_in_place(&mut self, parameters: &'t [Typed]) {
        match self.foreign_types {
            Some(_) => self.types_of(parameters),
            None => self.types_of_variables(parameters),
        }
    }

    /// Checks the types of objects, and of the variables of actions, axioms and quantifiers.
    pub(super) fn types_of(&mut self, list: &'t [Typed]) {
        for (index, typed) in list.iter().enumerate() {
            // In `a b c - typo`, the type is one mistake, not three.
            if index == 0 || typed.ty != list[index - 1].ty {
                self.type_expr(&typed.ty);
            }
        }
    }

    /// Reports an object with several types in an `either`, which belongs to all of them. In other
    /// planners such an object may belong to none.
    pub(super) fn either_of_an_object(&mut self, object: &'t Typed) {
        if object.ty.is_object() || object.ty.alternatives.len() < 2 {
            return;
        }
        let types: Vec<_> = object.ty.alternatives.iter().map(|ty| format!("`{ty}`")).collect();
        let message = format!("`{}` is of type {}", object.name, types.join(" and of type "));
        let help = "an `either` is meant for variables: declare a type below all of these";
        self.report(Diagnostic::warning(object.name.span(), message).with_help(help));
    }

    pub(super) fn type_expr(&mut self, ty: &'t TypeExpr) {
        for name in &ty.alternatives {
            if !self.symbols.types.contains(name.as_str()) {
                let symbols = self.symbols;
                let known = symbols.types.iter().map(Name::as_str);
                let near = self.nearest(name.as_str(), known);
                let message = format!("unknown type `{name}`");
                self.report(Diagnostic::error(name.span(), message).with_suggestion(near));
            }
        }
    }

    pub(super) fn named_like_a_predicate(&mut self, function: &'t Name) {
        if self.symbols.predicate(function).is_some() {
            let message = format!("`{function}` is a predicate and a function");
            let both = Diagnostic::warning(function.span(), message);
            self.report(both.with_help("readers will confuse them"));
        }
    }
}
