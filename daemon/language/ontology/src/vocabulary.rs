//! The vocabulary of one building: a PDDL domain that adds types, predicates, functions and axioms
//! to the standard ontology.
//!
//! A vocabulary may repeat declarations of the standard ontology, so that it can be read without it.
//! A declaration that differs from that of the standard ontology is a mistake.

use pddl::{Diagnostic, Domain, Name, Span, Typed};

/// Returns the ontology `base` with the words of `vocabulary`, and the mistakes in the vocabulary.
/// The spans of the mistakes are places in the vocabulary's text. The result has the name of `base`.
pub fn extended(base: &Domain, vocabulary: &Domain) -> (Domain, Vec<Diagnostic>) {
    let mut extension = OntologyExtension { domain: base.clone(), base, mistakes: Vec::new() };
    extension.requirements(vocabulary);
    extension.types(vocabulary);
    extension.predicates(vocabulary);
    extension.functions(vocabulary);
    extension.derived(vocabulary);
    extension.domain.constants.extend(vocabulary.constants.iter().cloned());
    extension.no_actions(vocabulary);
    let OntologyExtension { domain, mut mistakes, .. } = extension;
    // `base` has no mistakes of its own, so all that are found belong to the vocabulary.
    mistakes.extend(pddl::check_domain(&domain));
    mistakes.sort_by_key(|found| (found.span.start, found.span.end));
    (domain, mistakes)
}

/// An ontology that is being extended, and the mistakes that were found so far.
struct OntologyExtension<'b> {
    domain: Domain,
    base: &'b Domain,
    mistakes: Vec<Diagnostic>,
}

// === impl OntologyExtension ===

impl OntologyExtension<'_> {
    fn requirements(&mut self, vocabulary: &Domain) {
        for flag in &vocabulary.requirements {
            if !self.domain.requirements.contains(flag) {
                self.domain.requirements.push(flag.clone());
            }
        }
    }

    fn types(&mut self, vocabulary: &Domain) {
        for declared in &vocabulary.types {
            match self.base.types.iter().find(|known| known.name == declared.name) {
                // A type without a supertype is repeated only so that others can be below it.
                Some(known) if known.ty == declared.ty || declared.ty.is_object() => (),
                Some(known) => self.differs("type", &declared.name, type_text(known)),
                None => self.domain.types.push(declared.clone()),
            }
        }
    }

    fn predicates(&mut self, vocabulary: &Domain) {
        for declared in &vocabulary.predicates {
            match self.base.predicates.iter().find(|known| known.name == declared.name) {
                Some(known) if same_parameters(&known.parameters, &declared.parameters) => (),
                Some(known) => self.differs("predicate", &declared.name, known.to_string()),
                None => self.domain.predicates.push(declared.clone()),
            }
        }
    }

    fn functions(&mut self, vocabulary: &Domain) {
        for declared in &vocabulary.functions {
            match self.base.functions.iter().find(|known| known.name == declared.name) {
                Some(known) if same_parameters(&known.parameters, &declared.parameters) => (),
                Some(known) => self.differs("function", &declared.name, known.to_string()),
                None => self.domain.functions.push(declared.clone()),
            }
        }
    }

    fn derived(&mut self, vocabulary: &Domain) {
        for axiom in &vocabulary.derived {
            let is_fact = self.base.predicates.iter().any(|known| known.name == axiom.predicate)
                && !self.base.derived.iter().any(|known| known.predicate == axiom.predicate);
            if is_fact {
                let message = format!(
                    "`{}` is a fact in the standard ontology: no axiom can derive it",
                    axiom.predicate
                );
                let help = "declare a predicate of your own, and derive that";
                self.mistakes.push(Diagnostic::error(axiom.span, message).with_help(help));
            } else if !self.base.derived.contains(axiom) {
                self.domain.derived.push(axiom.clone());
            }
        }
    }

    fn no_actions(&mut self, vocabulary: &Domain) {
        let actions = vocabulary.actions.iter().map(|action| (&action.name, action.span));
        let durative = vocabulary.durative_actions.iter().map(|it| (&it.name, it.span));
        for (name, span) in actions.chain(durative) {
            self.action(name, span);
        }
    }

    fn action(&mut self, name: &Name, span: Span) {
        let message = format!("a vocabulary has no actions: take `{name}` out");
        let help = "each agent brings its actions in its action model; a vocabulary has types, \
                    predicates, functions and axioms";
        self.mistakes.push(Diagnostic::error(span, message).with_help(help));
    }

    fn differs(&mut self, what: &str, name: &Name, standard: String) {
        let message = format!("the standard ontology declares the {what} `{name}` differently");
        let help = "take it out, or give yours another name";
        let found = Diagnostic::error(name.span(), message).with_help(help).with_rule(standard);
        self.mistakes.push(found);
    }
}

fn type_text(declared: &Typed) -> String {
    format!("{} - {}", declared.name, declared.ty)
}

/// Whether two declarations are equal except for the names of their variables.
fn same_parameters(left: &[Typed], right: &[Typed]) -> bool {
    left.iter().map(|typed| &typed.ty).eq(right.iter().map(|typed| &typed.ty))
}
