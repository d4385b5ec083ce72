//! An office for the tests: its ontology, its map, its agents, and short functions for inputs.

use std::collections::BTreeSet;

use acl::content::Methods;
use acl::{AgentId, Incarnation};
use capability::{
    AdmitResult, Announcement, Declined, DomainChange, DomainSnapshot, Effects, KnownFact,
    Maintainer, MaintainerScope, Owner, ParsedHeartbeat, Timestamp, model_digest, text_of,
};
use pddl::{InitElement, PlanStep};

const ONTOLOGY: &str = "
(define (domain smart-office)
  (:requirements :typing)
  (:types location mobile-base sensor - object room - location
    temperature-sensor ir-temperature-sensor - sensor)
  (:predicates (connected ?a ?b - location) (at ?b - mobile-base ?l - location)
    (located ?s - sensor ?r - room) (mounted-on ?s - sensor ?b - mobile-base)
    (known-temperature ?r - room))
  (:functions (total-cost) (distance ?a ?b - location) (speed ?b - mobile-base)))";

const MAP: &str = "
(define (problem map) (:domain smart-office)
  (:objects office2 - room corridor - location)
  (:init (connected corridor office2) (= (distance corridor office2) 6)) (:goal (and)))";

/// A test fixture: a maintainer, the time, and agents in their first incarnation.
pub(crate) struct Office {
    pub(crate) maintainer: Maintainer,
    pub(crate) now: Timestamp,
    /// Agents with whole models in the snapshots; `None` for all agents.
    pub(crate) eyes: Option<BTreeSet<AgentId>>,
}

pub(crate) fn office() -> Office {
    scoped(MaintainerScope::Everything, None)
}

/// Creates an office with a maintainer of public scope. Its snapshots are those of the actuator
/// `own`.
pub(crate) fn office_of(own: &str) -> Office {
    scoped(MaintainerScope::Public, Some([id(own)].into()))
}

fn scoped(scope: MaintainerScope, eyes: Option<BTreeSet<AgentId>>) -> Office {
    let ontology = pddl::parse_domain(ONTOLOGY).into_result().expect("the ontology");
    let map = pddl::parse_problem(MAP).into_result().expect("the map");
    Office { maintainer: Maintainer::new(ontology, map, scope), now: Timestamp(1_000), eyes }
}

pub(crate) fn id(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

pub(crate) fn facts(text: &str) -> Vec<InitElement> {
    pddl::parse_init_elements(text).into_result().expect("facts")
}

/// Returns effects that make these facts believed; a `(not FACT)` retracts the fact.
pub(crate) fn effects(believe: &str) -> Effects {
    Effects { believe: facts(believe), retract: Vec::new() }
}

/// Returns the model of a TurtleBot, the example in docs/design.md under “Action models”, with a
/// private object.
pub(crate) fn turtlebot(name: &str) -> String {
    format!(
        "(define (agent {name}) (:domain smart-office)
          (:types turtlebot - mobile-base)
          (:predicates (:private (docked ?r - turtlebot)))
          (:objects {name} - turtlebot (:private dock-of-{name} - location))
          (:init (at {name} corridor) (docked {name}) (= (speed {name}) 0.3))
          (:action move :agent ?r - turtlebot :parameters (?from ?to - location)
            :precondition (and (at ?r ?from) (connected ?from ?to))
            :effect (and (not (at ?r ?from)) (at ?r ?to)
              (increase (total-cost) (distance ?from ?to)))))"
    )
}

pub(crate) fn thermometer(name: &str) -> String {
    format!(
        "(define (agent {name}) (:domain smart-office)
          (:objects {name} - temperature-sensor) (:init (located {name} office2))
          (:action report-temperature :agent ?s - temperature-sensor :parameters (?r - room)
            :precondition (located ?s ?r)
            :effect (and (known-temperature ?r) (increase (total-cost) 1))))"
    )
}

pub(crate) fn ir_sensor(name: &str, base: &str) -> String {
    format!(
        "(define (agent {name}) (:domain smart-office)
          (:objects {name} - ir-temperature-sensor) (:init (mounted-on {name} {base}))
          (:action report-temperature :agent ?s - ir-temperature-sensor
            :parameters (?b - mobile-base ?r - room)
            :precondition (and (mounted-on ?s ?b) (at ?b ?r))
            :effect (and (known-temperature ?r) (increase (total-cost) 2))))"
    )
}

/// Returns a model of the agent `name` with only these sections.
pub(crate) fn model(name: &str, sections: &str) -> String {
    format!("(define (agent {name}) (:domain smart-office) {sections})")
}

pub(crate) fn announcement(model: &str, incarnation: u64) -> Announcement {
    let methods = Methods::new();
    let digest = model_digest(model, &methods);
    let model = pddl::parse_action_model(model).into_result().expect("a model");
    let agent = id(model.agent.as_str());
    Announcement::new(agent, Incarnation(incarnation), model, methods, &digest)
}

// === impl Office ===

impl Office {
    /// Admits the models one after the other, each in the first incarnation of its agent.
    pub(crate) fn with<S: AsRef<str>>(mut self, models: impl IntoIterator<Item = S>) -> Office {
        for model in models {
            self.admit(model.as_ref());
        }
        self
    }

    #[track_caller]
    pub(crate) fn admit(&mut self, model: &str) -> AdmitResult {
        self.admit_life(model, 1).expect("a good model")
    }

    pub(crate) fn admit_life(
        &mut self,
        model: &str,
        incarnation: u64,
    ) -> Result<AdmitResult, Declined> {
        self.maintainer.admit(announcement(model, incarnation), self.now)
    }

    /// Applies a heartbeat with the facts in `facts_`, and with the facts in `brief`, which expire
    /// after ten seconds.
    pub(crate) fn beat(
        &mut self,
        agent: &str,
        (incarnation, sequence): (u64, u64),
        facts_: &str,
        brief: &str,
    ) -> Result<DomainChange, Declined> {
        let until = Some(Timestamp(self.now.0 + 10_000));
        let lasting = facts(facts_).into_iter().map(KnownFact::from);
        let brief = facts(brief).into_iter().map(|fact| KnownFact { fact, until });
        let agents = self.maintainer.agents(self.now);
        let view = agents.iter().find(|view| view.agent == id(agent));
        let beat = ParsedHeartbeat {
            agent: id(agent),
            incarnation: Incarnation(incarnation),
            sequence,
            digest: view.map(|view| view.digest.clone()).unwrap_or_default(),
            facts: lasting.chain(brief).collect(),
            period: Some(std::time::Duration::from_secs(1)),
        };
        self.maintainer.apply_heartbeat(beat, self.now)
    }

    pub(crate) fn mask(&mut self, agent: &str) -> DomainChange {
        self.maintainer.mask(&id(agent), Incarnation(1), self.now)
    }

    pub(crate) fn unmask(&mut self, agent: &str) -> DomainChange {
        self.maintainer.unmask(&id(agent), Incarnation(1), self.now)
    }

    pub(crate) fn remove(&mut self, agent: &str) -> DomainChange {
        self.maintainer.remove(&id(agent), Incarnation(1), self.now)
    }

    pub(crate) fn set(&mut self, owner: &str, believe: &str) -> Result<DomainChange, Declined> {
        self.maintainer.apply_request(&Owner::Agent(id(owner)), &effects(believe), self.now)
    }

    pub(crate) fn snapshot(&self) -> DomainSnapshot {
        match &self.eyes {
            None => self.maintainer.snapshot(self.now),
            Some(whole) => self.maintainer.snapshot_for(whole, self.now),
        }
    }

    /// Returns the facts of `symbol` in the snapshot, one per line.
    pub(crate) fn known(&self, symbol: &str) -> String {
        let about = |element: &&InitElement| match element {
            InitElement::Atom(atom) => atom.predicate == symbol,
            InitElement::Assign(fluent, _) => fluent.function == symbol,
            InitElement::Not(_) | InitElement::Unknown(_) | InitElement::At(..) => false,
        };
        let problem = self.snapshot().problem;
        text_of(&problem.init.iter().filter(about).cloned().collect::<Vec<_>>())
    }

    /// Returns the names of the actions inside the composite domain.
    pub(crate) fn actions(&self) -> String {
        let domain = self.snapshot().domain;
        let names: Vec<&str> = domain.actions.iter().map(|action| action.name.spelled()).collect();
        names.join(" ")
    }

    pub(crate) fn conflicts(&self) -> String {
        let lines = self.maintainer.conflicts().into_iter().map(|conflict| format!("{conflict}\n"));
        lines.collect()
    }
}

/// Formats a change in short form.
pub(crate) fn told(change: &DomainChange) -> String {
    let DomainChange { epoch, revision, epoch_changed, joined, left, believed, retracted } = change;
    let mut text =
        format!("epoch {epoch}{}, revision {revision}", if *epoch_changed { "!" } else { "" });
    for (sign, agents) in [("joined", joined), ("left", left)] {
        if !agents.is_empty() {
            text += &format!("\n{sign} {agents:?}");
        }
    }
    for (sign, facts) in [("+", believed), ("-", retracted)] {
        for fact in facts {
            text += &format!("\n{sign} {fact}");
        }
    }
    text + "\n"
}

pub(crate) fn step(text: &str) -> PlanStep {
    pddl::parse_step(text).into_result().expect("a step")
}
