//! Derived facts: facts that follow by axioms from the known facts. They are part of the answer to
//! a query for the state.

use acl::content::BelievedFact;
use capability::DomainSnapshot;
use pddl::knowledge::AuxiliaryPredicates;
use pddl::{Atom, Condition, Name};
use planner::validate::World;

/// Owner of a derived fact in an answer.
const AXIOM: &str = "axiom";

/// Maximum number of steps for evaluating the axioms. If more are needed, no derived fact is
/// listed. The largest buildings take some thousands of steps; the limit is reached after half a
/// second.
const EVALUATION_STEPS_MAX: u64 = 3_000_000;

/// Returns the facts that axioms derive, and, marked as unknown, the facts that axioms neither
/// derive nor rule out. Returns an empty list if evaluating the axioms takes too many steps.
pub(crate) fn derived_facts(snapshot: &DomainSnapshot) -> Vec<BelievedFact> {
    if snapshot.domain.derived.is_empty() {
        return Vec::new();
    }
    let Ok(world) = World::initial(&snapshot.domain, &snapshot.problem) else { return Vec::new() };
    let world = world.limit_work(EVALUATION_STEPS_MAX, None);
    let knowledge = snapshot.knowledge();
    let is_derived = |name: &Name| snapshot.domain.derived.iter().any(|it| it.predicate == *name);
    let told = |atom: Atom| {
        if let Some(AuxiliaryPredicates::Derived { .. }) = knowledge.symbols.get(&atom.predicate) {
            return Some(atom.to_string());
        }
        let maybe = { knowledge.symbols.iter() }.find(|(_, words)| {
            matches!(words, AuxiliaryPredicates::Derived { maybe, .. } if *maybe == atom.predicate)
        });
        match maybe {
            // A known fact is listed as itself.
            Some((symbol, _)) => {
                let atom = Atom { predicate: symbol.clone(), ..atom };
                let is_known = world.holds(&Condition::Atom(atom.clone()));
                (!is_known).then(|| format!("(unknown {atom})"))
            }
            None => (!knowledge.is_auxiliary(&atom.predicate)).then(|| atom.to_string()),
        }
    };
    let atoms = world.atoms().filter(|atom| is_derived(&atom.predicate));
    let fact = |fact: String| BelievedFact {
        fact,
        owners: vec![AXIOM.to_owned()],
        age_ms: 0,
        known_for: None,
        claims: Vec::new(),
    };
    let facts = atoms.filter_map(told).map(fact).collect();
    if world.work_limit_reached().is_some() { Vec::new() } else { facts }
}
