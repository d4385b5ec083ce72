//! The patrol (the paper, “Demonstrations”: “The corridor is patrolled by a mobile base”), a kept
//! goal that the robot itself requests. The priority of the goal is low, so that all other goals
//! take precedence.
//!
//! A place counts as patrolled for a while after the robot was there. When that time is over, the
//! goal is no longer true, and the ecosystem plans for it again. The plan drives the robot; the
//! code in this file does not.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::Millis;
use acl::content::{Achieve, Keep, Method};
use actuator::{DeviceEvent, Initiative, MethodResult, OwnFact, PlaceName, facts_of};
use agent::{Blueprint, BuildError, config_tables, config_validity};
use serde::Deserialize;
use tokio::time::Instant;

use crate::TurtleBot;

/// Name of the method by which the robot looks around at its location.
pub(crate) const METHOD: &str = "look_around";

/// PDDL text of the action that the method `look_around` performs.
pub(crate) const ACTION: &str = "(:action patrol
        :agent ?b - turtlebot
        :parameters (?l - location)
        :precondition (at ?b ?l)
        :effect (and (patrolled ?l) (increase (total-cost) 1)))";

/// Time limit for looking around at a place.
const LOOKING_TIME_MAX: Duration = Duration::from_secs(5);

/// The key `patrol` in the `config` of an entry.
#[derive(Deserialize)]
#[serde(remote = "Self", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct PatrolConfig {
    /// Places that the robot visits on patrol.
    places: Vec<PlaceName>,
    /// Time for which a place counts as patrolled after a visit, such as `"10min"`.
    every: String,
    /// Priority of the patrol's goal. The default is below 0, the priority of users' goals.
    #[serde(default = "default_priority")]
    priority: i32,
}

config_tables!(PatrolConfig);

fn default_priority() -> i32 {
    -10
}

/// The patrol of one robot: the places that it has to visit again and again.
pub(crate) struct Patrol {
    places: Vec<PlaceName>,
    every: Duration,
    priority: i32,
    /// Time of the last visit to each place.
    last: BTreeMap<String, Instant>,
    has_asked: bool,
}

impl Patrol {
    pub(crate) fn new(blueprint: &Blueprint, config: PatrolConfig) -> Result<Patrol, BuildError> {
        let PatrolConfig { places, every, priority } = config;
        let every = config_validity("patrol.every", &every)
            .map_err(|problem| blueprint.problem(problem))?;
        if places.is_empty() {
            return Err(blueprint.problem("a `patrol` needs `places`"));
        }
        let map = &blueprint.host.map.objects;
        let is_on_map = |place: &PlaceName| {
            map.iter().any(|declaration| declaration.object.name == place.as_str())
        };
        if let Some(place) = places.iter().find(|place| !is_on_map(place)) {
            return Err(blueprint.problem(format!("patrol: `{place}` is not on the map")));
        }
        Ok(Patrol { places, every, priority, last: BTreeMap::new(), has_asked: false })
    }

    /// Returns the request for the patrol's goal at the first call, and `None` afterwards, because
    /// the goal is kept from then on.
    pub(crate) fn initial_goal(&mut self) -> Option<DeviceEvent<TurtleBot>> {
        if std::mem::replace(&mut self.has_asked, true) {
            return None;
        }
        let places: Vec<_> =
            self.places.iter().map(|place| format!("(patrolled {place})")).collect();
        let goal = match places.as_slice() {
            [place] => place.clone(),
            places => format!("(and {})", places.join(" ")),
        };
        let goal = Achieve::new(goal, Keep::Maintain, self.priority);
        let want = Initiative::RequestGoal { name: "patrol".to_owned(), goal, insists: true };
        Some(Box::new(move |_| vec![want]))
    }

    pub(crate) fn method(&self) -> Method {
        Method {
            method: METHOD.to_owned(),
            arguments: [("place".to_owned(), "?l".to_owned())].into(),
            timeout: Millis(LOOKING_TIME_MAX),
        }
    }

    /// Returns the fact `patrolled` of each place that counts as patrolled at present.
    pub(crate) fn facts(&self) -> Vec<OwnFact> {
        let lately = self.last.iter().filter_map(|(place, at)| {
            let left = self.every.saturating_sub(at.elapsed());
            (!left.is_zero()).then(|| (format!("(patrolled {place})"), left))
        });
        lately
            .flat_map(|(text, left)| facts_of(&text).into_iter().map(move |fact| (fact, left)))
            .map(|(fact, left)| OwnFact { known_for: Some(left), ..fact })
            .collect()
    }

    pub(crate) fn performed(&mut self, place: String) -> MethodResult {
        let detail = format!("all is quiet at {place}");
        let observed = facts_of(&format!("(patrolled {place})"));
        self.last.insert(place, Instant::now());
        MethodResult { detail, observations: observed.into_iter().map(|fact| fact.fact).collect() }
    }
}
