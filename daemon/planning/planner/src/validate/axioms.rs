//! Dependencies between axioms: which predicates the axioms derive, what each of these predicates
//! depends on, and the order of evaluation.
//!
//! Predicates that depend on each other form a component and are evaluated together, after the
//! components on which they depend. A component is evaluated when its facts are first needed, and
//! again only after a change of something on which it depends.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use pddl::{Condition, Derived, Diagnostic, Domain, Expression};

use super::axiom_rules::AxiomRule;
use super::symbols::{RelationId, RelationTable};

/// Axioms of a domain, grouped into components.
#[derive(Debug, Default)]
pub(super) struct AxiomComponents {
    /// For each predicate: the index of its component, and its position in the component. An entry
    /// is `None` if the predicate is not derived. The list is empty if the domain has no axioms.
    places: Vec<Option<(usize, usize)>>,
    pub(super) components: Vec<Component>,
    /// For each predicate: the components that depend on its facts.
    fact_readers: Vec<Vec<usize>>,
    /// For each function: the components that depend on its values.
    value_readers: Vec<Vec<usize>>,
    /// Components that depend on the number of steps (`total-time`).
    time_readers: Vec<usize>,
}

/// A group of derived predicates that are evaluated together.
#[derive(Debug, Default)]
pub(super) struct Component {
    pub(super) relations: Vec<RelationId>,
    /// Axioms that derive the predicates of the component, as positions in the domain's list of
    /// axioms.
    pub(super) axioms: Vec<usize>,
    /// Components on which this component depends.
    pub(super) below: Vec<usize>,
    /// Components that depend on this component.
    pub(super) above: Vec<usize>,
    /// Rules of the component, compiled on first use.
    pub(super) rules: OnceLock<Vec<AxiomRule>>,
}

/// Predicates and functions that the condition of an axiom mentions.
struct Reads<'m> {
    predicates: &'m RelationTable,
    functions: &'m RelationTable,
    facts: Vec<RelationId>,
    /// The predicates among `facts` that occur negated in the axiom.
    negated: Vec<RelationId>,
    values: Vec<RelationId>,
    time: bool,
}

// === impl AxiomComponents ===

impl AxiomComponents {
    /// Groups the axioms of a domain into components.
    ///
    /// Returns an error if an axiom depends on its own negation.
    pub(super) fn of(
        domain: &Domain,
        predicates: &RelationTable,
        functions: &RelationTable,
    ) -> Result<AxiomComponents, Vec<Diagnostic>> {
        if domain.derived.is_empty() {
            return Ok(AxiomComponents::default());
        }
        let head = |axiom: &Derived| {
            let relation = predicates.find(&axiom.predicate, axiom.parameters.len());
            relation.expect("invariant: the model numbers what axioms derive")
        };
        let heads: Vec<RelationId> = domain.derived.iter().map(head).collect();
        let reads: Vec<Reads> = { domain.derived.iter() }
            .map(|axiom| Reads::of(axiom, predicates, functions))
            .collect();
        let mut uses = vec![Vec::new(); predicates.len()];
        for (head, reads) in heads.iter().zip(&reads) {
            uses[head.index()].extend(reads.facts.iter().map(|used| used.index()));
        }
        let mut axioms = AxiomComponents {
            places: vec![None; predicates.len()],
            fact_readers: vec![Vec::new(); predicates.len()],
            value_readers: vec![Vec::new(); functions.len()],
            ..AxiomComponents::default()
        };
        axioms.place_all(&heads, &pddl::graph::components(&uses));
        for (index, (axiom, reads)) in domain.derived.iter().zip(&reads).enumerate() {
            if axioms.connect(index, heads[index], reads) {
                let message = format!("`{}` depends on its own negation", axiom.predicate);
                return Err(vec![Diagnostic::error(axiom.span, message)]);
            }
        }
        axioms.sort();
        Ok(axioms)
    }

    /// Returns the index of the component of a derived predicate, and the position of the predicate
    /// in the component. Returns `None` if the predicate is not derived.
    pub(super) fn place(&self, relation: RelationId) -> Option<(usize, usize)> {
        self.places.get(relation.index()).copied().flatten()
    }

    /// Returns the components that depend on the facts of a predicate.
    pub(super) fn fact_readers(&self, relation: RelationId) -> &[usize] {
        self.fact_readers.get(relation.index()).map_or(&[], Vec::as_slice)
    }

    /// Returns the components that depend on the values of a function.
    pub(super) fn value_readers(&self, function: RelationId) -> &[usize] {
        self.value_readers.get(function.index()).map_or(&[], Vec::as_slice)
    }

    /// Returns the components that depend on the number of steps.
    pub(super) fn time_readers(&self) -> &[usize] {
        &self.time_readers
    }

    /// Assigns every derived predicate to a component. Predicates that depend on each other get the
    /// same component.
    fn place_all(&mut self, heads: &[RelationId], circles: &[usize]) {
        let mut component_of_circle = BTreeMap::new();
        for head in heads {
            if self.place(*head).is_some() {
                continue;
            }
            let next = self.components.len();
            let component = *component_of_circle.entry(circles[head.index()]).or_insert(next);
            if component == next {
                self.components.push(Component::default());
            }
            let relations = &mut self.components[component].relations;
            self.places[head.index()] = Some((component, relations.len()));
            relations.push(*head);
            // The initial state may also list facts of a derived predicate directly.
            self.fact_readers[head.index()].push(component);
        }
    }

    /// Registers the predicates, functions and components on which an axiom depends. Returns `true`
    /// if the axiom depends on the negation of a predicate of its own component.
    fn connect(&mut self, axiom: usize, head: RelationId, reads: &Reads<'_>) -> bool {
        let Some((component, _)) = self.place(head) else { return false };
        self.components[component].axioms.push(axiom);
        for used in &reads.facts {
            match self.place(*used) {
                None => self.fact_readers[used.index()].push(component),
                Some((below, _)) if below != component => {
                    self.components[component].below.push(below);
                    self.components[below].above.push(component);
                }
                Some(_) => (),
            }
        }
        for used in &reads.values {
            self.value_readers[used.index()].push(component);
        }
        if reads.time {
            self.time_readers.push(component);
        }
        let is_own = |used: &RelationId| self.place(*used).is_some_and(|(own, _)| own == component);
        reads.negated.iter().any(is_own)
    }

    fn sort(&mut self) {
        let below_and_above = { self.components.iter_mut() }
            .flat_map(|component| [&mut component.below, &mut component.above]);
        let readers = self.fact_readers.iter_mut().chain(&mut self.value_readers);
        for list in below_and_above.chain(readers).chain([&mut self.time_readers]) {
            list.sort_unstable();
            list.dedup();
        }
    }
}

// === impl Reads ===

impl<'m> Reads<'m> {
    fn of(
        axiom: &Derived,
        predicates: &'m RelationTable,
        functions: &'m RelationTable,
    ) -> Reads<'m> {
        let (facts, negated, values) = (Vec::new(), Vec::new(), Vec::new());
        let mut reads = Reads { predicates, functions, facts, negated, values, time: false };
        reads.condition(&axiom.condition, true);
        reads
    }

    fn condition(&mut self, condition: &Condition, positive: bool) {
        match condition {
            Condition::Atom(atom) => {
                let relation = self.predicates.find(&atom.predicate, atom.arguments.len());
                self.facts.extend(relation);
                self.negated.extend(relation.filter(|_| !positive));
            }
            Condition::Equal(..) => (),
            Condition::Compare(compare) => {
                self.expression(&compare.left);
                self.expression(&compare.right);
            }
            Condition::Not(inner) => self.condition(inner, !positive),
            Condition::Exists(_, inner) | Condition::Forall(_, inner) => {
                self.condition(inner, positive);
            }
            Condition::And(parts) | Condition::Or(parts) => {
                parts.iter().for_each(|part| self.condition(part, positive));
            }
            Condition::Imply(left, right) => {
                self.condition(left, !positive);
                self.condition(right, positive);
            }
        }
    }

    fn expression(&mut self, expression: &Expression) {
        match expression {
            Expression::Fluent(fluent) => {
                self.values.extend(self.functions.find(&fluent.function, fluent.arguments.len()));
            }
            Expression::Negate(inner) => self.expression(inner),
            Expression::Apply(_, operands) => {
                operands.iter().for_each(|operand| self.expression(operand));
            }
            Expression::TotalTime(_) => self.time = true,
            Expression::Number(_) | Expression::Duration(_) | Expression::ContinuousTime(_) => (),
        }
    }
}
