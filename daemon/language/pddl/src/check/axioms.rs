//! Checks of derived predicates: their heads, their bodies, and stratification.

use foldhash::HashMap;

use super::Checker;
use crate::diagnostic::Diagnostic;
use crate::graph::components;
use crate::tree::{Condition, Derived, Name};

/// A dependency between predicates: an axiom for the predicate `head` uses the predicate `body` in
/// its condition.
struct Dependency<'t> {
    head: &'t Name,
    body: &'t Name,
    is_negative: bool,
}

impl<'t> Checker<'_, 't> {
    pub(super) fn derived(&mut self, axioms: &'t [Derived]) {
        for axiom in axioms {
            self.head(axiom);
            self.with_scope(&axiom.parameters, |checker| checker.condition(&axiom.condition));
        }
        self.stratification(axioms);
    }

    /// Checks the head of an axiom, `(PREDICATE VARIABLES)`, against the declaration of the
    /// predicate.
    fn head(&mut self, axiom: &'t Derived) {
        let predicate = &axiom.predicate;
        self.parameters(&axiom.parameters);
        let Some(declaration) = self.symbols.predicate(predicate) else {
            return self.unknown_predicate(predicate);
        };
        let (wanted, found) = (declaration.parameters.len(), axiom.parameters.len());
        if wanted != found {
            let wanted = super::count(wanted, "argument");
            let message = format!("`{predicate}` takes {wanted}, found {found}");
            let wrong = Diagnostic::error(predicate.span(), message);
            return self.report(wrong.with_rule(declaration.to_string()));
        }
        for (own, declared) in axiom.parameters.iter().zip(&declaration.parameters) {
            let known = self.are_types_known(&own.ty) && self.are_types_known(&declared.ty);
            if known && !self.symbols.types.overlap(&own.ty, &declared.ty) {
                let (name, ty, wanted) = (&own.name, &own.ty, &declared.ty);
                let message =
                    format!("`?{name}` is of type `{ty}`, `{predicate}` wants `{wanted}`");
                let wrong = Diagnostic::error(name.span(), message);
                self.report(wrong.with_rule(declaration.to_string()));
            }
        }
    }

    /// Checks that no predicate depends on its own negation, directly or through other predicates.
    fn stratification(&mut self, axioms: &'t [Derived]) {
        let mut dependencies = Vec::new();
        for axiom in axioms {
            collect(&axiom.predicate, &axiom.condition, false, &mut dependencies);
        }
        let layers = Layers::of(&dependencies);
        for dependency in dependencies.iter().filter(|dependency| dependency.is_negative) {
            if layers.are_one(dependency.head, dependency.body) {
                self.report_unstratified(dependency);
            }
        }
    }

    fn report_unstratified(&mut self, dependency: &Dependency<'t>) {
        let Dependency { head, body, .. } = dependency;
        let message = match head == body {
            true => format!("`{head}` is derived from its own negation"),
            false => format!("`{head}` is derived from `(not ({body} …))`, which depends on it"),
        };
        let wrong = Diagnostic::error(body.span(), message);
        self.report(wrong.with_help("axioms must have layers: negate only what lies below"));
    }
}

/// Collects the predicates in `condition` as dependencies of `head`, each with whether it is
/// negated.
fn collect<'t>(
    head: &'t Name,
    condition: &'t Condition,
    is_negative: bool,
    dependencies: &mut Vec<Dependency<'t>>,
) {
    match condition {
        Condition::Atom(atom) => {
            dependencies.push(Dependency { head, body: &atom.predicate, is_negative });
        }
        Condition::Not(inner) => collect(head, inner, !is_negative, dependencies),
        Condition::And(parts) | Condition::Or(parts) => {
            parts.iter().for_each(|part| collect(head, part, is_negative, dependencies));
        }
        Condition::Imply(premise, conclusion) => {
            collect(head, premise, !is_negative, dependencies);
            collect(head, conclusion, is_negative, dependencies);
        }
        Condition::Exists(_, inner) | Condition::Forall(_, inner) => {
            collect(head, inner, is_negative, dependencies);
        }
        Condition::Equal(..) | Condition::Compare(_) => {}
    }
}

/// Groups of predicates: predicates that depend on each other are in one group.
struct Layers<'t> {
    index: HashMap<&'t str, usize>,
    components: Vec<usize>,
}

impl<'t> Layers<'t> {
    fn of(dependencies: &[Dependency<'t>]) -> Layers<'t> {
        let mut index = HashMap::default();
        let mut bodies: Vec<Vec<usize>> = Vec::new();
        for Dependency { head, body, .. } in dependencies {
            let [head, body] = [head, body].map(|name| {
                let next = bodies.len();
                let number = *index.entry(name.as_str()).or_insert(next);
                if number == next {
                    bodies.push(Vec::new());
                }
                number
            });
            bodies[head].push(body);
        }
        Layers { index, components: components(&bodies) }
    }

    /// Whether `head` and `body` depend on each other.
    fn are_one(&self, head: &Name, body: &Name) -> bool {
        let component =
            |name: &Name| self.index.get(name.as_str()).map(|number| self.components[*number]);
        component(head) == component(body)
    }
}
