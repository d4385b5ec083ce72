//! Tasks of the paper's scenarios, in a whole office: two robots with a sensor each (one with a
//! battery and a dock, one with a screen where people log in), thermometers, a CO₂ sensor, a
//! camera, a screen, and a video-collaboration robot.
//!
//! Domain and problem are the output of `althing domain` in that office, without the sensors that
//! have failed and with the goal added.

use pddl::{Domain, InitElement, Problem, Term};

/// The allocator that the daemon uses; the measured times depend on it by a quarter.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Expands to the name, domain and problem of a scenario.
macro_rules! scenario {
    ($name:literal) => {
        (
            $name,
            include_str!(concat!($name, "/domain.pddl")),
            include_str!(concat!($name, "/problem.pddl")),
        )
    };
}

/// Name, domain and problem of every scenario.
pub(crate) const SCENARIOS: [(&str, &str, &str); 5] = [
    scenario!("1-temperatures"),
    scenario!("2-two-robots"),
    scenario!("3-validation"),
    scenario!("4-screen"),
    scenario!("4-video-robot"),
];

/// Parses a domain and a problem.
pub(crate) fn parse(domain: &str, problem: &str) -> (Domain, Problem) {
    let domain = pddl::parse_domain(domain).into_result().expect("it parses");
    (domain, pddl::parse_problem(problem).into_result().expect("it parses"))
}

/// Returns one problem per possible change: an agent offers no actions any more or offers them
/// again, or a robot has moved.
pub(crate) fn events(problem: &Problem) -> Vec<Problem> {
    let mut events = vec![problem.clone()];
    let (mut agents, mut places) = (Vec::new(), Vec::new());
    let note = |all: &mut Vec<Term>, one: &Term| {
        if !all.contains(one) {
            all.push(one.clone());
        }
    };
    for element in &problem.init {
        let InitElement::Atom(atom) = element else { continue };
        let name = atom.predicate.as_str();
        match atom.arguments.as_slice() {
            [agent] if name.starts_with("offers-") => note(&mut agents, agent),
            [place, _] if name == "connected" => note(&mut places, place),
            _ => (),
        }
    }
    for agent in agents {
        let offers = |element: &InitElement| match element {
            InitElement::Atom(atom) => {
                atom.predicate.as_str().starts_with("offers-") && atom.arguments.contains(&agent)
            }
            _ => false,
        };
        let mut without = problem.clone();
        without.init.retain(|element| !offers(element));
        events.push(without);
    }
    let stands = |element: &InitElement| match element {
        InitElement::Atom(atom) => atom.predicate == "at",
        _ => false,
    };
    for index in (0..problem.init.len()).filter(|index| stands(&problem.init[*index])) {
        for place in &places {
            let mut moved = problem.clone();
            if let InitElement::Atom(atom) = &mut moved.init[index] {
                atom.arguments[1] = Term::clone(place);
            }
            events.push(moved);
        }
    }
    events
}
