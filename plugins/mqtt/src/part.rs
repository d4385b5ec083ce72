//! What of a device becomes one agent: all that it measures, or one thing that it switches.

use std::fmt::Write as _;
use std::time::Duration;

use acl::AgentId;
use pddl::Domain;

use crate::class::{Class, Classes, Kind, conversion};
use crate::described::{Availability, Described, Feature, Source, name_of};

/// One agent of a device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    /// Its name.
    pub(crate) agent: AgentId,
    /// The room it stands in.
    pub(crate) room: String,
    pub(crate) features: Vec<Known>,
    pub(crate) availability: Vec<Availability>,
    pub(crate) any_is_enough: bool,
    /// How long what was measured counts as known.
    pub(crate) valid_for: Option<Duration>,
}

/// A feature whose class has words here.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Known {
    /// The class's own name.
    pub(crate) name: String,
    pub(crate) class: Class,
    pub(crate) feature: Feature,
    /// What makes its number one in the class's unit.
    pub(crate) factor: f64,
    pub(crate) offset: f64,
}

/// What can be made of a device: its parts without their rooms, and what of it cannot be used.
pub(crate) struct Parts {
    pub(crate) parts: Vec<(AgentId, Vec<Known>)>,
    pub(crate) problem: Option<String>,
}

impl Parts {
    pub(crate) fn of(device: &Described, classes: &Classes) -> Parts {
        let (mut measured, mut switched) = (Vec::<Known>::new(), Vec::new());
        let mut problem = None;
        for feature in &device.features {
            let Some(name) = classes.find(&feature.class) else { continue };
            let Some(class) = classes.get(name).cloned() else { continue };
            if let Some(wrong) = feature.state.as_ref().and_then(Source::problem) {
                problem = Some(format!("its {name}: {wrong}"));
                continue;
            }
            let (factor, offset) = match class.kind() {
                Some(Kind::Number { unit, .. }) => match conversion(&feature.unit, unit) {
                    Some(conversion) => conversion,
                    None => {
                        let said = &feature.unit;
                        problem = Some(format!("its {name} is in `{said}`, which is no {unit}"));
                        continue;
                    }
                },
                _ => (1.0, 0.0),
            };
            let mut feature = feature.clone();
            if class.inverted {
                std::mem::swap(&mut feature.yes, &mut feature.no);
            }
            let known = Known { name: name.to_owned(), class, feature, factor, offset };
            match known.class.kind() {
                Some(Kind::Switch { .. }) if known.feature.command.is_some() => {
                    switched.push(known)
                }
                Some(Kind::Switch { .. }) | None => (),
                // Of two thermometers in one device the first speaks for it.
                Some(_) if measured.iter().any(|other| other.name == known.name) => (),
                Some(_) => measured.push(known),
            }
        }
        let called = name_of(&device.name);
        let agent = |suffix: String| AgentId::new(&format!("{called}{suffix}")).ok();
        let mut parts = Vec::new();
        if !measured.is_empty() {
            parts.extend(agent(String::new()).map(|agent| (agent, measured)));
        }
        let is_alone = parts.is_empty() && switched.len() == 1;
        for known in switched {
            let suffix = if is_alone {
                String::new()
            } else {
                format!("-{}", name_of(&known.feature.label))
            };
            parts.extend(agent(suffix).map(|agent| (agent, vec![known])));
        }
        if parts.is_empty() && problem.is_none() {
            problem = Some("nothing that it measures or switches has words here".to_owned());
        }
        Parts { parts, problem }
    }
}

impl Part {
    /// Its action model, with the words that the shared ontology lacks; `offers` says whether it can do
    /// anything now.
    pub(crate) fn model(&self, ontology: &Domain, offers: bool) -> String {
        let Part { agent, room, .. } = self;
        let kind = self.features.first().map_or("sensor", |known| known.class.agent.as_str());
        let mut words = Words::of(ontology);
        let is_switch = self
            .features
            .iter()
            .any(|known| matches!(known.class.kind(), Some(Kind::Switch { .. })));
        let stands = if is_switch { "installed" } else { "located" };
        words.has_type(kind, if is_switch { "" } else { "sensor" });
        let mut actions = String::new();
        for known in &self.features {
            known.describe(kind, stands, &mut words, &mut actions);
        }
        if !offers {
            actions.clear();
        }
        let private = match stands {
            // The same of a lamp and of a lock, so that both can be in one ecosystem.
            "installed" => "(:private (installed ?d - object ?r - room))".to_owned(),
            _ => String::new(),
        };
        let Words { types, predicates, functions, .. } = words;
        let section = |name: &str, body: String| match body.trim() {
            "" => String::new(),
            body => format!("(:{name} {body})"),
        };
        format!(
            "(define (agent {agent}) (:domain {}) {} {} {}
               (:objects {agent} - {kind}) (:init ({stands} {agent} {room})) {actions})",
            ontology.name,
            section("types", types),
            section("predicates", predicates + &private),
            section("functions", functions),
        )
    }
}

impl Known {
    fn describe(&self, kind: &str, stands: &str, words: &mut Words<'_>, actions: &mut String) {
        let mut action = |name: &str, effect: &str| {
            let _ = write!(
                actions,
                "(:action {name} :agent ?d - {kind} :parameters (?r - room)
                   :precondition ({stands} ?d ?r)
                   :effect (and {effect} (increase (total-cost) 1)))"
            );
        };
        match self.class.kind() {
            Some(Kind::Number { action: name, known, value, .. }) => {
                words.has_predicate(known);
                words.has_function(value);
                action(name, &format!("({known} ?r)"));
            }
            Some(Kind::YesOrNo { action: name, known, yes }) => {
                words.has_predicate(known);
                words.has_predicate(yes);
                action(name, &format!("({known} ?r)"));
            }
            Some(Kind::Switch { state, on, off }) => {
                words.has_predicate(state);
                action(on, &format!("({state} ?r)"));
                action(off, &format!("(not ({state} ?r))"));
            }
            None => (),
        }
    }

    /// The actions by which it is used, each with its method.
    pub(crate) fn methods(&self) -> Vec<(String, String)> {
        match self.class.kind() {
            Some(Kind::Number { action, .. } | Kind::YesOrNo { action, .. }) => {
                vec![(action.to_owned(), format!("read-{}", self.name))]
            }
            Some(Kind::Switch { on, off, .. }) => {
                vec![(on.to_owned(), "on".to_owned()), (off.to_owned(), "off".to_owned())]
            }
            None => Vec::new(),
        }
    }
}

/// The words that an action model has to bring along.
struct Words<'o> {
    ontology: &'o Domain,
    types: String,
    predicates: String,
    functions: String,
}

impl<'o> Words<'o> {
    fn of(ontology: &'o Domain) -> Words<'o> {
        let (types, predicates, functions) = Default::default();
        Words { ontology, types, predicates, functions }
    }

    fn has_type(&mut self, name: &str, parent: &str) {
        let is_there = |wanted: &str| self.ontology.types.iter().any(|one| one.name == wanted);
        if !is_there(name) {
            let parent = if is_there(parent) { parent } else { "object" };
            let _ = write!(self.types, "{name} - {parent} ");
        }
    }

    fn has_predicate(&mut self, name: &str) {
        if !self.ontology.predicates.iter().any(|one| one.name == name) {
            let _ = write!(self.predicates, "({name} ?r - room) ");
        }
    }

    fn has_function(&mut self, name: &str) {
        if !self.ontology.functions.iter().any(|one| one.name == name) {
            let _ = write!(self.functions, "({name} ?r - room) ");
        }
    }
}
