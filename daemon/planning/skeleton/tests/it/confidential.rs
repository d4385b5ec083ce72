//! Action models with private parts in a running ecosystem.

use acl::content::PartStep;
use pddl::{ActionModel, Domain, InitElement, Problem};
use planner::{Cancel, Options};
use skeleton::{ConfidentialModel, FillRefusal, KnownWorld};

const ONTOLOGY: &str = "(define (domain house) (:requirements :typing)
    (:types room door agent - object)
    (:predicates (open ?d - door) (in ?a - agent ?r - room) (bolted ?d - door)))";

const MAP: &str = "(define (problem map) (:domain house)
    (:objects hall lab - room gate - door) (:init))";

/// A keeper that opens a door with a key, which hangs in a room that only the keeper knows.
const KEEPER: &str = "(define (agent keeper) (:domain house)
    (:types doorkeeper - agent key - object)
    (:predicates (ringing ?d - door)
        (:private (holding ?a - doorkeeper ?k - key) (hanging ?k - key ?r - room)
            (fitting ?k - key ?d - door)))
    (:objects keeper - doorkeeper (:private brass - key))
    (:init (fitting brass gate))
    (:action fetch :agent ?who - doorkeeper :parameters (?key - key ?where - room)
        :precondition (and (in ?who ?where) (hanging ?key ?where))
        :effect (and (holding ?who ?key) (not (hanging ?key ?where))))
    (:action unlock :agent ?who - doorkeeper :parameters (?what - door ?key - key)
        :precondition (and (holding ?who ?key) (fitting ?key ?what) (not (bolted ?what)))
        :effect (open ?what))
    (:action listen :agent ?who - doorkeeper :parameters (?what - door)
        :effect () :observe (ringing ?what)))";

/// A step with the announced action. Which key fits never changes, so it is announced from the
/// beginning, under opaque names.
const UNLOCK: &str = "(unlock keeper gate keeper--o0)";

/// Words that only the keeper may know.
const PRIVATE: [&str; 7] = ["holding", "hanging", "fitting", "brass", "fetch", "who", "where"];

fn ontology() -> Domain {
    pddl::parse_domain(ONTOLOGY).into_result().expect("a domain")
}

fn map() -> Problem {
    pddl::parse_problem(MAP).into_result().expect("a problem")
}

fn model(text: &str) -> ActionModel {
    pddl::parse_action_model(text).into_result().expect("a model")
}

fn confidential(text: &str) -> ConfidentialModel {
    let made = ConfidentialModel::new(&model(text), &ontology(), &map());
    made.expect("supported").expect("private")
}

fn facts(text: &str) -> Vec<InitElement> {
    pddl::parse_init_elements(text).into_result().expect("facts")
}

fn told(model: &ConfidentialModel, own: &str) -> String {
    let told = facts(own).iter().filter_map(|fact| model.announced_fact(fact)).collect::<Vec<_>>();
    told.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns the steps for a part, as text. The others know `public`, and the keeper itself `own`.
fn filled(
    model: &ConfidentialModel,
    part: &[&str],
    (public, own): (&str, &str),
) -> Result<Vec<String>, FillRefusal> {
    // The known world is made from what is announced, as by a Domain Maintainer.
    let announced = model.announced();
    let mut domain = ontology();
    domain.types.extend(announced.types.clone());
    domain.predicates.extend(announced.predicates.clone());
    domain.actions.clone_from(&announced.actions);
    let mut problem = map();
    let objects = problem.objects.iter().chain(&announced.objects).cloned();
    problem.objects = std::sync::Arc::new(objects.collect());
    let own = facts(own);
    problem.init.extend(announced.init.clone());
    problem.init.extend(facts(public));
    problem.init.extend(own.iter().filter_map(|fact| model.announced_fact(fact)));
    let part: Vec<_> = part
        .iter()
        .map(|text| match text.strip_prefix("others ") {
            Some(changes) => PartStep::Others(changes.to_owned()),
            None => PartStep::Own((*text).to_owned()),
        })
        .collect();
    let known = KnownWorld { domain: &domain, problem: &problem, own_facts: &own };
    let filled = model.fill(&part, &known, &Options::default(), &Cancel::new())?;
    Ok(filled.steps.iter().flatten().map(ToString::to_string).collect())
}

#[test]
fn what_is_private_is_not_announced() {
    let keeper = confidential(KEEPER);
    let text = keeper.announced().to_string();
    for word in PRIVATE {
        assert!(!text.contains(word), "`{word}` in {text}");
    }
    let unlock = "(:action unlock\n    :agent ?x0 - doorkeeper";
    assert!(text.contains(unlock), "{text}");
    assert!(text.contains("ringing"), "an observation is public: {text}");
    assert_eq!(model(&text), model(&keeper.announced().to_string()), "it can be read");
    let own = "(in keeper hall) (hanging brass lab) (unknown (holding keeper brass))";
    assert_eq!(told(&keeper, own), "(in keeper hall)");
}

#[test]
fn a_step_is_filled_with_private_ones_from_the_present_state() {
    let keeper = confidential(KEEPER);
    let far = "(in keeper lab) (hanging brass lab)";
    let both = ["(fetch keeper brass lab)", "(unlock keeper gate brass)"];
    assert_eq!(filled(&keeper, &[UNLOCK], ("", far)).expect("possible"), both);
    let ready = "(in keeper lab) (holding keeper brass)";
    assert_eq!(filled(&keeper, &[UNLOCK], ("", ready)).expect("possible"), both[1..]);
}

/// What others have said of private things, or of another agent of the same type, counts for nothing.
#[test]
fn others_can_neither_claim_private_facts_nor_act_for_the_agent() {
    let keeper = confidential(KEEPER);
    let guesses = "(holding keeper brass) (in keeper lab)";
    filled(&keeper, &[UNLOCK], (guesses, "(in keeper hall)")).expect_err("no key");
    let part = ["others (holding keeper brass)", UNLOCK];
    filled(&keeper, &part, ("", "(in keeper hall)")).expect_err("no key");
    filled(&keeper, &["(unlock keeper gate brass)"], ("", "")).expect_err("not announced");
}

#[test]
fn the_changes_of_others_are_awaited() {
    let keeper = confidential(KEEPER);
    let own = "(in keeper lab) (hanging brass lab)";
    filled(&keeper, &[UNLOCK], ("(bolted gate)", own)).expect_err("it is bolted");
    let part = ["others (not (bolted gate))", UNLOCK];
    let steps = filled(&keeper, &part, ("(bolted gate)", own)).expect("possible");
    assert_eq!(steps.len(), 2, "{steps:?}");
}

/// After a proved refusal the agent announces what its step requires, under opaque names.
#[test]
fn a_refusal_makes_the_announced_model_sharper() {
    let mut keeper = confidential(KEEPER);
    let own = "(in keeper hall) (hanging brass lab)";
    let refusal = filled(&keeper, &[UNLOCK], ("", own)).expect_err("no key");
    assert!(!PRIVATE.iter().any(|word| refusal.why.contains(word)), "{refusal:?}");
    let before = keeper.announced().to_string();
    assert!(keeper.sharpen(&refusal));
    let after = keeper.announced().to_string();
    assert!(after.len() > before.len(), "{after}");
    assert!(!PRIVATE.iter().any(|word| after.contains(word)), "{after}");
    let mut again = confidential(KEEPER);
    again.keep_like(&keeper);
    assert_eq!(again.announced(), keeper.announced());
    // The facts are announced with it: that the key hangs somewhere, and later that it is held.
    while keeper.sharpen(&refusal) {}
    assert!(told(&keeper, own).contains("keeper--o0"), "{}", told(&keeper, own));
    assert_eq!(model(&keeper.announced().to_string()).agent, "keeper");
}

#[test]
fn a_model_without_private_parts_is_left_as_it_is() {
    let plain = model("(define (agent lamp) (:domain house) (:objects lamp - agent))");
    let made = ConfidentialModel::new(&plain, &ontology(), &map()).expect("supported");
    assert!(made.is_none());
}

#[test]
fn what_cannot_be_kept_is_refused_by_name() {
    let refused = |part: &str| {
        let text = format!(
            "(define (agent lamp) (:domain house) (:predicates (:private (warm)))
                (:objects lamp - agent) {part})"
        );
        ConfidentialModel::new(&model(&text), &ontology(), &map()).err().expect("refused")
    };
    let axiom = refused("(:derived (bolted ?d - door) (warm))");
    assert_eq!(axiom, "the model of `lamp` has private parts and axioms");
    let effect = refused(
        "(:action push :agent ?a - agent :parameters (?d - door) :effect (when (warm) (open ?d)))",
    );
    assert!(effect.contains("depends on something private"), "{effect}");
}
