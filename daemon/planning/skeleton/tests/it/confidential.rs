//! Action models that declare something `:private`, in a running ecosystem.

use std::sync::Arc;

use acl::content::PartStep;
use pddl::knowledge::Knowledge;
use pddl::{ActionModel, Domain, InitElement, Name, ObjectDeclaration, Problem};
use planner::{Cancel, Options};
use skeleton::{ConfidentialModel, FillRefusal, KnownWorld};

const ONTOLOGY: &str = "(define (domain house) (:requirements :typing)
    (:types room door agent item - object)
    (:predicates (open ?d - door) (in ?a - agent ?r - room) (bolted ?d - door)
        (lies ?i - item ?r - room)))";

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
    let made = ConfidentialModel::new(&model(text), &ontology(), &map(), None);
    made.expect("supported").expect("private")
}

fn facts(text: &str) -> Vec<InitElement> {
    pddl::parse_init_elements(text).into_result().expect("facts")
}

fn told(model: &ConfidentialModel, own: &str) -> String {
    let told = facts(own)
        .iter()
        .filter_map(|fact| model.announced_fact(fact, &|name| *name == *"parcel"))
        .collect::<Vec<_>>();
    told.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// What the keeper knows when it fills a part.
#[derive(Clone, Copy, Default)]
struct Known<'k> {
    /// Facts that all know, also those of the keeper that are announced.
    public: &'k str,
    /// Facts of the keeper's device.
    own: &'k str,
    /// Objects that another agent declares.
    others: &'k str,
    /// Names of objects that are constants of the composite domain.
    constants: &'k str,
}

/// Returns the steps for a part, as text, in a world that is made from what is announced, as by a Domain
/// Maintainer.
fn filled(
    model: &ConfidentialModel,
    part: &[&str],
    known: Known<'_>,
) -> Result<Vec<String>, FillRefusal> {
    let Known { public, own, others, constants } = known;
    let announced = model.announced();
    let mut domain = ontology();
    domain.types.extend(announced.types.clone());
    domain.predicates.extend(announced.predicates.clone());
    domain.actions.clone_from(&announced.actions);
    let knowledge = Knowledge::of(&domain, &[Name::new("bolted")].into());
    knowledge.compile(&mut domain);
    let others = format!("(define (problem map) (:domain house) (:objects {others}) (:init))");
    let others = pddl::parse_problem(&others).into_result().expect("objects");
    let mut problem = map();
    let objects = problem.objects.iter().chain(&announced.objects).chain(others.objects.iter());
    let is_constant = |it: &&ObjectDeclaration| constants == it.object.name.as_str();
    let (of_domain, of_problem): (Vec<_>, Vec<_>) = objects.partition(is_constant);
    domain.constants.extend(of_domain.into_iter().map(|it| it.object.clone()));
    problem.objects = Arc::new(of_problem.into_iter().cloned().collect());
    let own = facts(own);
    problem.init.extend(announced.init.clone());
    problem.init.extend(facts(public).into_iter().filter_map(|fact| match &fact {
        InitElement::Unknown(atom) => knowledge.unknown(atom).map(InitElement::Atom),
        _ => Some(fact),
    }));
    problem.init.extend(
        own.iter().filter_map(|fact| model.announced_fact(fact, &|name| *name == *"parcel")),
    );
    let part: Vec<_> = part
        .iter()
        .map(|text| match text.strip_prefix("others ") {
            Some(changes) => PartStep::Others(changes.to_owned()),
            None => PartStep::Own((*text).to_owned()),
        })
        .collect();
    let known =
        KnownWorld { domain: &domain, problem: &problem, knowledge: &knowledge, own_facts: &own };
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
    assert_eq!(
        filled(&keeper, &[UNLOCK], Known { own: far, ..Known::default() }).expect("possible"),
        both
    );
    let ready = "(in keeper lab) (holding keeper brass)";
    assert_eq!(
        filled(&keeper, &[UNLOCK], Known { own: ready, ..Known::default() }).expect("possible"),
        both[1..]
    );
}

/// What others have said of private things, or of another agent of the same type, counts for nothing.
#[test]
fn others_can_neither_claim_private_facts_nor_act_for_the_agent() {
    let keeper = confidential(KEEPER);
    let guesses = "(holding keeper brass) (in keeper lab)";
    filled(
        &keeper,
        &[UNLOCK],
        Known { public: guesses, own: "(in keeper hall)", ..Known::default() },
    )
    .expect_err("no key");
    let part = ["others (holding keeper brass)", UNLOCK];
    filled(&keeper, &part, Known { own: "(in keeper hall)", ..Known::default() })
        .expect_err("no key");
    filled(&keeper, &["(unlock keeper gate brass)"], Known::default()).expect_err("not announced");
}

#[test]
fn the_changes_of_others_are_awaited() {
    let keeper = confidential(KEEPER);
    let own = "(in keeper lab) (hanging brass lab)";
    filled(&keeper, &[UNLOCK], Known { public: "(bolted gate)", own, ..Known::default() })
        .expect_err("it is bolted");
    let part = ["others (not (bolted gate))", UNLOCK];
    let steps = filled(&keeper, &part, Known { public: "(bolted gate)", own, ..Known::default() })
        .expect("possible");
    assert_eq!(steps.len(), 2, "{steps:?}");
}

/// After a proved refusal the agent announces what its step requires, under opaque names.
#[test]
fn a_refusal_makes_the_announced_model_sharper() {
    let mut keeper = confidential(KEEPER);
    let own = "(in keeper hall) (hanging brass lab)";
    let refusal =
        filled(&keeper, &[UNLOCK], Known { own, ..Known::default() }).expect_err("no key");
    assert!(!PRIVATE.iter().any(|word| refusal.why.contains(word)), "{refusal:?}");
    let before = keeper.announced().to_string();
    assert!(keeper.sharpen(&refusal));
    let after = keeper.announced().to_string();
    assert!(after.len() > before.len(), "{after}");
    assert!(!PRIVATE.iter().any(|word| after.contains(word)), "{after}");
    // It stays so, also if no action is offered for a while.
    let followed = |text: &str, former: &ConfidentialModel| {
        let made = ConfidentialModel::new(&model(text), &ontology(), &map(), Some(former));
        made.expect("supported").expect("private")
    };
    let (declarations, _) = KEEPER.split_once("(:action").expect("actions");
    let paused = followed(&format!("{declarations})"), &keeper);
    assert_eq!(followed(KEEPER, &paused).announced(), keeper.announced());
    // The facts are announced with it: that the key hangs somewhere, and later that it is held.
    while keeper.sharpen(&refusal) {}
    assert!(told(&keeper, own).contains("keeper--o0"), "{}", told(&keeper, own));
    assert_eq!(model(&keeper.announced().to_string()).agent, "keeper");
}

/// A key that is declared before the other one does not take its name.
#[test]
fn opaque_names_keep_their_meaning_when_the_model_changes() {
    let before = confidential(KEEPER);
    let more = KEEPER.replace("(:private brass - key)", "(:private alpha brass - key)");
    let made = ConfidentialModel::new(&model(&more), &ontology(), &map(), Some(&before));
    let after = made.expect("supported").expect("private");
    let own = "(in keeper lab) (holding keeper alpha) (holding keeper brass)";
    let steps = filled(&after, &[UNLOCK], Known { own, ..Known::default() }).expect("possible");
    assert_eq!(steps, ["(unlock keeper gate brass)"]);
}

/// Facts of the model that an action changes are those of the beginning: the device knows better.
#[test]
fn facts_of_the_model_do_not_outlive_what_the_device_says() {
    let init = "(:init (fitting brass gate) (hanging brass lab))";
    let keeper = confidential(&KEEPER.replace("(:init (fitting brass gate))", init));
    for own in ["", "(not (hanging brass lab))", "(unknown (hanging brass lab))"] {
        let own = format!("(in keeper lab) {own}");
        filled(&keeper, &[UNLOCK], Known { own: &own, ..Known::default() })
            .expect_err("it is gone");
    }
}

/// An unknown fact is neither true nor false.
#[test]
fn a_private_fact_that_is_unknown_does_not_count_as_false() {
    let needs = KEEPER.replace("(holding ?who ?key) (fitting", "(not (hanging ?key lab)) (fitting");
    let keeper = confidential(&needs);
    let known = Known { own: "(in keeper hall)", ..Known::default() };
    filled(&keeper, &[UNLOCK], known).expect("it does not hang there");
    let known = Known { own: "(unknown (hanging brass lab))", ..Known::default() };
    filled(&keeper, &[UNLOCK], known).expect_err("it may hang there");
}

#[test]
fn a_public_fact_that_is_unknown_does_not_count_as_false() {
    let keeper = confidential(KEEPER);
    let own = "(in keeper lab) (holding keeper brass)";
    let known = Known { public: "(unknown (bolted gate))", own, ..Known::default() };
    filled(&keeper, &[UNLOCK], known).expect_err("it may be bolted");
}

#[test]
fn an_observation_of_the_plan_serves_its_later_steps() {
    let keeper = confidential(&KEEPER.replace("(holding ?who ?key) (fit", "(ringing ?what) (fit"));
    let part = ["(listen keeper gate)", UNLOCK];
    let known = Known { public: "(unknown (ringing gate))", ..Known::default() };
    filled(&keeper, &part, known).expect("it may ring");
    filled(&keeper, &part[1..], known).expect_err("it may not");
}

/// What others call like something private is not that.
#[test]
fn names_of_others_do_not_collide_with_private_ones() {
    let keeper = confidential(KEEPER);
    let own = "(in keeper lab) (hanging brass lab)";
    for others in ["brass - room", "brass - door", "holding - room"] {
        let known = Known { own, others, ..Known::default() };
        assert_eq!(filled(&keeper, &[UNLOCK], known).expect("possible").len(), 2, "{others}");
    }
    let known = Known { own, constants: "keeper--o0", ..Known::default() };
    let steps = filled(&keeper, &[UNLOCK], known).expect("possible");
    assert!(steps.iter().all(|step| !step.contains("--")), "{steps:?}");
}

/// A step that is private because all things of a type are does not take those of others.
#[test]
fn a_private_step_does_not_touch_public_things_of_others() {
    let keeper = confidential(
        "(define (agent keeper) (:domain house) (:types doorkeeper - agent wedge - item)
            (:predicates (:private (propped ?a - doorkeeper)))
            (:objects keeper - doorkeeper (:private oak - wedge))
            (:action grab :agent ?a - doorkeeper :parameters (?i - item ?r - room)
                :precondition (lies ?i ?r) :effect (and (propped ?a) (not (lies ?i ?r))))
            (:action prop :agent ?a - doorkeeper :parameters (?d - door)
                :precondition (propped ?a) :effect (and (open ?d) (not (propped ?a)))))",
    );
    let step = ["(prop keeper gate)"];
    let public = "(lies parcel lab)";
    let known = Known { public, others: "parcel - item", ..Known::default() };
    filled(&keeper, &step, known).expect_err("the parcel is not its own");
    let own = "(lies oak hall)";
    let known = Known { public, own, others: "parcel - item", ..Known::default() };
    let steps = filled(&keeper, &step, known).expect("the wedge is");
    assert_eq!(steps, ["(grab keeper oak hall)", "(prop keeper gate)"]);
}

/// What the model does not declare may be private, too.
#[test]
fn an_undeclared_thing_in_a_private_fact_is_not_announced() {
    let mut keeper = confidential(KEEPER);
    let known = Known { own: "(in keeper hall)", ..Known::default() };
    let refusal = filled(&keeper, &[UNLOCK], known).expect_err("no key");
    while keeper.sharpen(&refusal) {}
    assert_eq!(
        told(&keeper, "(holding keeper spare-key) (in keeper cellar)"),
        "(in keeper cellar)"
    );
    // What another agent declares is known to all.
    assert_eq!(told(&keeper, "(holding keeper parcel)").matches("parcel").count(), 1);
    let own = "(in keeper lab) (holding keeper spare-key) (hanging brass lab)";
    let known = Known { own, ..Known::default() };
    let step = ["(unlock keeper gate keeper--o0)"];
    assert_eq!(
        filled(&keeper, &step, known).expect("possible").last().unwrap(),
        "(unlock keeper gate brass)"
    );
}

/// The ontology and the map are known to all agents of the ecosystem.
#[test]
fn what_the_ontology_declares_private_is_not_private_to_an_agent() {
    let ontology = "(define (domain house) (:types room agent - object)
        (:predicates (lit ?r - room) (:private (wired ?r - room))))";
    let ontology = pddl::parse_domain(ontology).into_result().expect("a domain");
    let map = "(define (problem map) (:domain house) (:objects (:private safe - room)) (:init))";
    let map = pddl::parse_problem(map).into_result().expect("a problem");
    let lamp = model(
        "(define (agent lamp) (:domain house) (:objects lamp - agent)
            (:action wire :agent ?a - agent :parameters (?r - room) :effect (wired ?r)))",
    );
    assert!(ConfidentialModel::new(&lamp, &ontology, &map, None).expect("supported").is_none());
}

#[test]
fn a_model_without_private_parts_is_left_as_it_is() {
    let plain = model("(define (agent lamp) (:domain house) (:objects lamp - agent))");
    let made = ConfidentialModel::new(&plain, &ontology(), &map(), None).expect("supported");
    assert!(made.is_none());
}

#[test]
fn what_cannot_be_kept_is_refused_by_name() {
    let refused = |part: &str| {
        let text = format!(
            "(define (agent lamp) (:domain house) (:predicates (:private (warm)))
                (:objects lamp - agent) {part})"
        );
        ConfidentialModel::new(&model(&text), &ontology(), &map(), None).err().expect("refused")
    };
    let axiom = refused("(:derived (bolted ?d - door) (warm))");
    assert_eq!(axiom, "the model of `lamp` declares something `:private`, and has axioms");
    let effect = refused(
        "(:action push :agent ?a - agent :parameters (?d - door) :effect (when (warm) (open ?d)))",
    );
    assert!(effect.contains("depends on something private"), "{effect}");
}
