//! Measures the duration of a change in a building of a hundred agents, and prints the median of
//! fifty runs: `cargo run --release -p capability --example hundred_agents`.

use std::time::{Duration, Instant};

use acl::content::Methods;
use acl::{AgentId, Incarnation};
use capability::{
    Announcement, KnownFact, Maintainer, MaintainerScope, ParsedHeartbeat, Timestamp, model_digest,
};

const AGENTS: usize = 100;
const ACTIONS: usize = 10;
const FACTS: usize = 30;
const ROUNDS: u64 = 50;

const ONTOLOGY: &str = "(define (domain building) (:types place robot)
    (:predicates (at ?r - robot ?p - place) (near ?p ?q - place)) (:functions (total-cost)))";

fn main() {
    measure("a hundred equal agents", |_| 0);
    measure("a hundred agents of ten kinds, all actions of one name unlike", |agent| agent % 10);
    measure("a hundred agents, no two actions alike", |agent| agent);
}

fn measure(title: &str, variant: impl Fn(usize) -> usize) {
    let announced: Vec<Announcement> =
        (0..AGENTS).map(|agent| announcement(agent, variant(agent))).collect();
    let mut maintainer = Maintainer::new(ontology(), map(), MaintainerScope::Everything);
    for announcement in &announced {
        maintainer.admit(announcement.clone(), Timestamp(0)).expect("a good model");
    }
    assert!(maintainer.conflicts().is_empty());
    println!("{title}");
    let last = &announced[AGENTS - 1];
    let agent = &last.agent;
    let incarnation = last.incarnation;
    let digest = model_digest(&text(AGENTS - 1, variant(AGENTS - 1)), &Methods::new());
    let mut took: [Vec<Duration>; 7] = Default::default();
    for round in 0..ROUNDS {
        let mut steps = Steps { took: &mut took, next: 0 };
        steps.time(|| maintainer.remove(agent, incarnation, Timestamp(1)));
        steps.time(|| maintainer.admit(last.clone(), Timestamp(1)).expect("a good model"));
        steps.time(|| maintainer.mask(agent, incarnation, Timestamp(1)));
        steps.time(|| maintainer.unmask(agent, incarnation, Timestamp(1)));
        let beat = heartbeat(last, &digest, round + 1);
        steps.time(|| maintainer.apply_heartbeat(beat, Timestamp(1)).expect("a good heartbeat"));
        let snapshot = steps.time(|| maintainer.snapshot(Timestamp(1)));
        steps.time(|| snapshot.digest().len());
    }
    let names = ["remove", "admit", "mask", "unmask", "heartbeat", "snapshot", "digest"];
    for (name, took) in names.iter().zip(took) {
        println!("  {name:10} {:8.1} µs", median(took).as_secs_f64() * 1e6);
    }
}

struct Steps<'a> {
    took: &'a mut [Vec<Duration>],
    next: usize,
}

impl Steps<'_> {
    fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        self.took[self.next].push(start.elapsed());
        self.next += 1;
        value
    }
}

fn median(mut took: Vec<Duration>) -> Duration {
    took.sort();
    took[took.len() / 2]
}

fn ontology() -> pddl::Domain {
    pddl::parse_domain(ONTOLOGY).into_result().expect("a domain")
}

/// Returns a map of forty places, each of which is near every place.
fn map() -> pddl::Problem {
    let places: String = (0..40).map(|place| format!("p{place} ")).collect();
    let near: String =
        (0..40 * 40).map(|pair| format!("(near p{} p{})", pair / 40, pair % 40)).collect();
    let text = format!(
        "(define (problem map) (:domain building) (:objects {places} - place) (:init {near})
          (:goal (and)))"
    );
    pddl::parse_problem(&text).into_result().expect("a problem")
}

fn facts(agent: usize) -> String {
    (0..FACTS).map(|place| format!("(at robot-{agent} p{place})")).collect()
}

fn text(agent: usize, variant: usize) -> String {
    let actions: String = (0..ACTIONS)
        .map(|action| {
            format!(
                "(:action act-{action} :agent ?r - robot :parameters (?from ?to - place)
                  :precondition (and (at ?r ?from) (near ?from ?to) (not (at ?r ?to)))
                  :effect (and (not (at ?r ?from)) (at ?r ?to) (increase (total-cost) {variant})))"
            )
        })
        .collect();
    format!(
        "(define (agent robot-{agent}) (:domain building) (:objects robot-{agent} - robot)
          (:init {}) {actions})",
        facts(agent)
    )
}

fn announcement(agent: usize, variant: usize) -> Announcement {
    let (text, methods) = (text(agent, variant), Methods::new());
    let digest = model_digest(&text, &methods);
    let model = pddl::parse_action_model(&text).into_result().expect("a model");
    let agent = AgentId::new(&format!("robot-{agent}")).expect("a name");
    Announcement::new(agent, Incarnation(1), model, methods, &digest)
}

fn heartbeat(announced: &Announcement, digest: &str, sequence: u64) -> ParsedHeartbeat {
    let said = pddl::parse_init_elements(&facts(AGENTS - 1)).into_result().expect("facts");
    ParsedHeartbeat {
        agent: announced.agent.clone(),
        incarnation: announced.incarnation,
        sequence,
        digest: digest.to_owned(),
        facts: said.into_iter().map(KnownFact::from).collect(),
        period: None,
    }
}
