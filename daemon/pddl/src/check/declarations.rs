//! Declarations: each name once, each type known.

use foldhash::{HashMap, HashSet};

use super::Checker;
use crate::diagnostic::Diagnostic;
use crate::tree::{ActionSchema, Domain, DurativeAction, Name, TypeExpr, Typed};
use crate::types::SUPERTYPES_MAX;

/// Flags of PDDL 1.2 to 3.1, PDDL+ and MA-PDDL, and those that planners made customary.
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
        self.unique("type", domain.types.iter().map(|typed| &typed.name));
        self.unique("constant", domain.constants.iter().map(|typed| &typed.name));
        self.unique("predicate", domain.predicates.iter().map(|it| &it.name));
        self.unique("function", domain.functions.iter().map(|it| &it.name));
        self.types_of(&domain.constants);
        for predicate in &domain.predicates {
            self.parameters(&predicate.parameters);
        }
        for function in &domain.functions {
            self.parameters(&function.parameters);
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
                self.report(Diagnostic::error(requirement.span(), message).with_suggestion(near));
            }
        }
    }

    /// The hierarchy: supertypes that nobody declares, and cycles.
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

    /// Names that are declared more than once.
    pub(super) fn unique(&mut self, what: &str, names: impl Iterator<Item = &'t Name>) {
        self.unique_marked(what, "", names);
    }

    fn unique_marked(&mut self, what: &str, mark: &str, names: impl Iterator<Item = &'t Name>) {
        let mut firsts: HashMap<&str, &Name> = HashMap::default();
        for name in names {
            if let Some(first) = firsts.get(name.as_str()) {
                let message = format!("{what} `{mark}{name}` is declared twice");
                let twice = Diagnostic::error(name.span(), message);
                self.report(twice.with_note(first.span(), "the first is here"));
            } else {
                firsts.insert(name.as_str(), name);
            }
        }
    }

    /// The variables of an action, a quantifier, or a declaration.
    pub(super) fn parameters(&mut self, parameters: &'t [Typed]) {
        self.unique_marked("parameter", "?", parameters.iter().map(|typed| &typed.name));
        self.types_of(parameters);
    }

    /// The types of variables and objects.
    pub(super) fn types_of(&mut self, list: &'t [Typed]) {
        for (index, typed) in list.iter().enumerate() {
            // `a b c - typo` is one mistake, not three.
            if index == 0 || typed.ty != list[index - 1].ty {
                self.type_expr(&typed.ty);
            }
        }
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
