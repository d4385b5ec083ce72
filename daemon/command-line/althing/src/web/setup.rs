//! Describes the parts of an ecosystem that goals and actions can be about: types, objects,
//! predicates and actions of the composite domain, without what is private or of the planner alone.

use std::collections::BTreeSet;

use acl::content::Snapshot;
use pddl::{ActionSchema, Domain, Effect, Name, Privacy, Problem, TypeExpr, Typed, Types};
use web_page::{PageSetup, SetupAction, SetupObject, SetupParameter, SetupPredicate, SetupType};

/// Maximum number of elements of each kind that are described. A building has some thousands of
/// objects; a browser lists no more.
const ELEMENTS_MAX: usize = 20_000;

/// Returns `empty` with the parts that a snapshot describes; `None` if the snapshot cannot be
/// parsed.
pub(super) fn describe(snapshot: &Snapshot, empty: PageSetup) -> Option<PageSetup> {
    let domain = pddl::parse_domain(&snapshot.domain).into_result().ok()?;
    let problem = pddl::parse_problem(&snapshot.problem).into_result().ok()?;
    Some(PageSetup {
        types: types(&domain),
        objects: objects(&domain, &problem),
        predicates: predicates(&domain, snapshot),
        actions: actions(&domain, &problem, snapshot),
        ..empty
    })
}

fn types(domain: &Domain) -> Vec<SetupType> {
    let kind = |typed: &Typed| SetupType {
        name: typed.name.to_string(),
        parent: typed.ty.alternatives.first().map(Name::to_string),
    };
    domain.types.iter().take(ELEMENTS_MAX).map(kind).collect()
}

fn objects(domain: &Domain, problem: &Problem) -> Vec<SetupObject> {
    let public = problem.objects.iter().filter(|object| object.privacy == Privacy::Public);
    let typed = domain.constants.iter().chain(public.map(|object| &object.object));
    let object = |typed: &Typed| SetupObject {
        name: typed.name.to_string(),
        kind: names(&typed.ty).swap_remove(0),
    };
    typed.take(ELEMENTS_MAX).map(object).collect()
}

fn predicates(domain: &Domain, snapshot: &Snapshot) -> Vec<SetupPredicate> {
    let guards = snapshot.guards.values().map(|guard| Name::new(&guard.predicate));
    let knowledge = agent::knowledge(&snapshot.knowledge);
    let hidden: BTreeSet<Name> = guards.collect();
    let is_shown = |name: &Name, privacy: &Privacy| {
        *privacy == Privacy::Public && !hidden.contains(name) && !knowledge.is_auxiliary(name)
    };
    let changed = changed(domain);
    let predicate = |name: &Name, parameters: &[Typed], is_function| SetupPredicate {
        name: name.to_string(),
        parameters: parameters.iter().map(parameter).collect(),
        is_function,
        can_change: changed.contains(name),
    };
    let facts = { domain.predicates.iter() }
        .filter(|declared| is_shown(&declared.name, &declared.privacy))
        .map(|declared| predicate(&declared.name, &declared.parameters, false));
    let values = { domain.functions.iter() }
        .filter(|declared| is_shown(&declared.name, &declared.privacy))
        .map(|declared| predicate(&declared.name, &declared.parameters, true));
    facts.chain(values).take(ELEMENTS_MAX).collect()
}

/// Returns the predicates and functions that some action changes, or that follow by an axiom.
fn changed(domain: &Domain) -> BTreeSet<Name> {
    let effects = domain.actions.iter().flat_map(|action| action.effect.parts());
    let changed = effects.filter_map(|part| match part {
        Effect::Add(atom) | Effect::Delete(atom) => Some(atom.predicate.clone()),
        Effect::Assign(assign) => Some(assign.fluent.function.clone()),
        _ => None,
    });
    changed.chain(domain.derived.iter().map(|axiom| axiom.predicate.clone())).collect()
}

fn actions(domain: &Domain, problem: &Problem, snapshot: &Snapshot) -> Vec<SetupAction> {
    let mut actions = Vec::new();
    let types = Types::of(domain);
    // The agent of a form is the first argument. In a joint action with several roles, not every agent
    // may be.
    let may_be_first = |agent: &str, schema: &ActionSchema| {
        let declared = problem.objects.iter().map(|declared| &declared.object);
        let object = domain.constants.iter().chain(declared).find(|object| object.name == agent);
        schema.partners.is_empty()
            || object
                .zip(schema.agent.as_ref())
                .is_none_or(|(object, first)| types.accepts(&first.ty, &object.ty))
    };
    for (agent, offers) in &snapshot.offers {
        for (name, offer) in offers {
            let is_schema = |schema: &&ActionSchema| schema.name == *offer.schema.as_str();
            let Some(schema) = domain.actions.iter().find(is_schema) else { continue };
            if !may_be_first(agent.as_str(), schema) {
                continue;
            }
            let parameters = schema.all_parameters().skip(1).map(parameter).collect();
            actions.push(SetupAction { agent: agent.clone(), name: name.clone(), parameters });
        }
    }
    actions.truncate(ELEMENTS_MAX);
    actions
}

fn parameter(typed: &Typed) -> SetupParameter {
    SetupParameter { name: typed.name.to_string(), types: names(&typed.ty) }
}

/// Returns the alternatives of a type; `object` if none is written.
fn names(ty: &TypeExpr) -> Vec<String> {
    match ty.alternatives.as_slice() {
        [] => vec!["object".to_owned()],
        alternatives => alternatives.iter().map(Name::to_string).collect(),
    }
}

#[cfg(test)]
mod tests {
    use acl::{DaemonId, EcosystemId};

    use super::*;

    fn described() -> PageSetup {
        let domain = "(define (domain office) (:types room robot - object lamp - object)
            (:predicates (at ?r - robot ?p - room) (lit ?p - room) (near ?a ?b - room)
                (can-move ?r - robot) (:private (docked ?r - robot)))
            (:functions (warmth ?p - room) - number)
            (:action move :parameters (?r - robot ?from ?to - room)
                :precondition (can-move ?r)
                :effect (and (not (at ?r ?from)) (at ?r ?to) (docked ?r))))";
        let problem = "(define (problem now) (:domain office)
            (:objects hall lab - room r1 - robot) (:init) (:goal (and)))";
        let snapshot = serde_json::json!({
            "epoch": 1, "revision": 1, "domain": domain, "digest": "", "problem": problem,
            "offers": { "r1": { "move": { "schema": "move", "guard": "(can-move r1)" } } },
            "guards": { "move": { "action": "move", "predicate": "can-move" } },
        });
        let empty = PageSetup {
            ecosystem: EcosystemId::new("office").expect("a name"),
            daemon: DaemonId::new("hub").expect("a name"),
            types: Vec::new(),
            objects: Vec::new(),
            predicates: Vec::new(),
            actions: Vec::new(),
        };
        let snapshot = serde_json::from_value(snapshot).expect("a snapshot");
        describe(&snapshot, empty).expect("it can be parsed")
    }

    #[test]
    fn guards_and_private_predicates_are_left_out() {
        let setup = described();
        let names: Vec<_> = setup.predicates.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["at", "lit", "near", "warmth"]);
        let changing: Vec<_> = setup.predicates.iter().filter(|it| it.can_change).collect();
        assert_eq!(changing.len(), 1, "only `at` changes");
        assert_eq!(changing[0].parameters[1].types, ["room"]);
        assert!(setup.predicates[3].is_function);
    }

    #[test]
    fn the_acting_agent_is_no_parameter() {
        let setup = described();
        let [action] = setup.actions.as_slice() else { panic!("{:?}", setup.actions) };
        let parameters: Vec<_> = action.parameters.iter().map(|it| it.name.as_str()).collect();
        assert_eq!((action.agent.as_str(), action.name.as_str()), ("r1", "move"));
        assert_eq!(parameters, ["from", "to"]);
        assert_eq!(setup.objects.len(), 3);
    }
}
