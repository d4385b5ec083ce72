//! The TurtleBot (the paper, “TurtleBot”), a mobile base that moves between the places of the map
//! and between named poses of its own, and carries sensors.
//!
//! - `mobile_base::MobileBase` implements moving, the battery and the dock, as for every robot.
//! - The robot carries the agents that announce to be `mounted-on` it, and plans with their
//!   actions.
//! - With the key `login` in the config, a person can log in at the robot's on-board screen, at the
//!   place where the robot is.
//! - With the key `patrol`, the robot repeatedly visits some places, as long as no other goal needs
//!   the robot.

mod login;
mod patrol;

use std::collections::BTreeMap;
use std::time::Duration;

use acl::Millis;
use acl::content::{Method, Refusal};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, Initiative, InitiativeUpdate,
    MethodCall, MethodFailure, MethodResult, OwnFact, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use mobile_base::{BaseConfig, BaseOutcome, MobileBase};
use serde::Deserialize;
use tokio::time::Instant;

use login::{LOGIN, Login, LoginConfig};
use patrol::{Patrol, PatrolConfig};

/// The entry of the TurtleBot in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "turtlebot",
    about: "a mobile base: moves between the places of the map, carries sensors, lets people log in",
    drivers: mobile_base::DRIVERS,
    has_replicas: false,
    build,
};

/// The `config` of a TurtleBot's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Config {
    #[serde(flatten)]
    base: BaseConfig,
    /// Settings for logging in at the robot's screen; `None` if people cannot log in there.
    #[serde(default)]
    login: Option<LoginConfig>,
    /// Places that the robot patrols, and the interval of the visits; `None` without a patrol.
    #[serde(default)]
    patrol: Option<PatrolConfig>,
    /// All other keys of the entry's `config`. Any such key is an error.
    #[serde(flatten)]
    unknown: serde_json::Map<String, serde_json::Value>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { base, login, patrol, unknown } = blueprint.config_as()?;
    if let Some(key) = unknown.keys().next() {
        return Err(blueprint.problem(format!("a turtlebot's config has no key `{key}`")));
    }
    let turtlebot = TurtleBot {
        id: blueprint.id.to_string(),
        ontology: blueprint.host.ontology.name.to_string(),
        base: MobileBase::new(&blueprint, "turtlebot", base)?,
        login: login.map(|login| Login::new(&blueprint, login)).transpose()?,
        patrol: patrol.map(|patrol| Patrol::new(&blueprint, patrol)).transpose()?,
        validated: BTreeMap::new(),
    };
    Actuator::build(&blueprint, turtlebot)
}

struct TurtleBot {
    id: String,
    ontology: String,
    base: MobileBase,
    login: Option<Login>,
    patrol: Option<Patrol>,
    /// Time of the last login in each place, by the name of the place.
    validated: BTreeMap<String, Instant>,
}

/// The result of a method of the TurtleBot.
enum TurtleBotResult {
    Moved(BaseOutcome),
    Validated(String),
    Patrolled(String),
}

impl TurtleBot {
    /// Returns the place in the arguments of a call. Returns an error if the base is not at that
    /// place, because the robot may have been moved since the plan was made.
    fn called_place(&self, call: &MethodCall) -> Result<String, MethodFailure> {
        let (place, here) = (call.argument("place")?, self.base.place());
        match here {
            Some(here) if place == here => Ok(here),
            _ => {
                let stands = self.base.whereabouts();
                Err(MethodFailure::Driver(format!("act at `{place}`: the base stands {stands}")))
            }
        }
    }

    fn validated(&self) -> Vec<OwnFact> {
        let lasts = self.login.as_ref().map_or(Duration::ZERO, |login| login.valid_for);
        let known = self.validated.iter().filter_map(|(place, at)| {
            let left = lasts.saturating_sub(at.elapsed());
            (!left.is_zero()).then(|| (format!("(validated {place})"), left))
        });
        known
            .flat_map(|(text, left)| facts_of(&text).into_iter().map(move |fact| (fact, left)))
            .map(|(fact, left)| OwnFact { known_for: Some(left), ..fact })
            .collect()
    }
}

impl Device for TurtleBot {
    type Yield = TurtleBotResult;

    fn describe(&self) -> Description {
        let TurtleBot { id, ontology, base, login, patrol, .. } = self;
        let mut methods = base.methods();
        let mut actions = base.actions("");
        if let Some(login) = login.as_ref().filter(|login| login.is_open()) {
            actions += "(:action validate-person
                :agent ?b - turtlebot
                :parameters (?l - location)
                :precondition (at ?b ?l)
                :effect (and (validated ?l) (increase (total-cost) 5)))";
            let method = Method {
                method: login::METHOD.to_owned(),
                arguments: [("place".to_owned(), "?l".to_owned())].into(),
                timeout: Millis(login.timeout()),
            };
            methods.insert("validate-person".to_owned(), method);
        }
        if let Some(patrol) = patrol {
            actions += patrol::ACTION;
            methods.insert("patrol".to_owned(), patrol.method());
        }
        let (objects, lasting) = (base.objects(), base.model_facts());
        let (predicates, functions) = (base.predicates(), base.functions());
        let text = format!(
            "(define (agent {id}) (:domain {ontology})
                (:types turtlebot - mobile-base)
                (:predicates {predicates})
                (:functions {functions})
                (:objects {objects})
                (:init {lasting})
                {actions})"
        );
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let patrolled = self.patrol.iter().flat_map(Patrol::facts);
        facts_of(&self.base.facts()).into_iter().chain(self.validated()).chain(patrolled).collect()
    }

    fn check_call(&mut self, call: &MethodCall) -> Option<Refusal> {
        self.base.check_call(call)
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<TurtleBotResult, MethodFailure>> {
        if call.method == patrol::METHOD {
            let here = self.called_place(call).map(TurtleBotResult::Patrolled);
            return Box::pin(std::future::ready(here));
        }
        if call.method != login::METHOD {
            let moved = self.base.perform(call);
            return Box::pin(async move { moved.await.map(TurtleBotResult::Moved) });
        }
        let here = self.called_place(call);
        match (here, &mut self.login) {
            (Ok(place), Some(login)) => {
                let validated = login.log_in(place);
                Box::pin(async move { validated.await.map(TurtleBotResult::Validated) })
            }
            (Err(failure), _) => Box::pin(std::future::ready(Err(failure))),
            (Ok(_), None) => {
                let unknown = MethodFailure::UnknownMethod(call.method.clone());
                Box::pin(std::future::ready(Err(unknown)))
            }
        }
    }

    fn on_success(&mut self, _call: &MethodCall, done: TurtleBotResult) -> MethodResult {
        match done {
            TurtleBotResult::Moved(moved) => self.base.performed(&moved),
            TurtleBotResult::Validated(place) => {
                let observed = facts_of(&format!("(validated {place})"));
                let detail = format!("a person logged in at {place}");
                self.validated.insert(place, Instant::now());
                let observations = observed.into_iter().map(|fact| fact.fact).collect();
                MethodResult { detail, observations }
            }
            TurtleBotResult::Patrolled(place) => match &mut self.patrol {
                Some(patrol) => patrol.performed(place),
                None => MethodResult { detail: "is here".to_owned(), observations: Vec::new() },
            },
        }
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        Some(self.base.locate())
    }

    fn stand_still(&mut self) -> Option<BoxFuture<Result<(), String>>> {
        self.base.stand_still()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<TurtleBot>>> {
        if let Some(wish) = self.patrol.as_mut().and_then(Patrol::initial_goal) {
            return Some(Box::pin(std::future::ready(wish)));
        }
        let wish = self.base.next_initiative();
        let question = self.login.as_ref().map(Login::next_question);
        Some(Box::pin(async move {
            let question = async {
                match question {
                    Some(question) => question.await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = wish => {
                    let stir: DeviceEvent<TurtleBot> = Box::new(|robot| robot.base.take_initiatives());
                    stir
                }
                initiatives = question => {
                    let stir: DeviceEvent<TurtleBot> = Box::new(move |_| initiatives);
                    stir
                }
            }
        }))
    }

    fn receive_news(&mut self, name: &str, news: &InitiativeUpdate) -> Vec<Initiative> {
        if let Some(login) = self.login.as_mut().filter(|_| name == LOGIN) {
            login.receive_answer(news);
        }
        Vec::new()
    }
}
