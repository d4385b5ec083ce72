//! Something in a room that is on or off: a lamp, a relay, a lock.
//!
//! - `kind` has the words of each, and its action model.
//! - `Driver` is what a driver does: `gpio` drives a line of a board, `command` runs programs.
//! - What the driver reads back is known, whoever has switched it; what nobody can read is believed
//!   to be as it was told.
//! - What cannot be read is unknown, neither on nor off, and offers nothing. After a failure a switch offers nothing for
//!   a while, so that plans are made without it.

mod command;
mod config;
mod gpio;
mod kind;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::Deadline;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Place, Stir,
    facts_of, model_of,
};
use agent::{Blueprint, BuildError, Launch, PluginEntry};
use pddl::Domain;
use tokio::time::Instant;

use config::Config;
use kind::Kind;

/// How long a switch that failed offers nothing. A loose wire comes back within seconds.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// The longest that is waited, before anything is announced, for how it is.
const FIRST_LOOK: Duration = Duration::from_secs(2);

/// What a method may take beyond its driver's time, so that its reason is heard.
const MARGIN: Duration = Duration::from_secs(1);

const GPIO: &str = "gpio";
const COMMAND: &str = "command";

/// The methods.
const ON: &str = "on";
const OFF: &str = "off";

/// A lamp, a relay or a lock.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "switch",
    about: "switches a lamp, a relay or a lock in a room, by a line of a board or any program",
    drivers: &[GPIO, COMMAND],
    stands_by: false,
    build,
};

/// What a switch's driver does. Errors complete “failed to …”.
trait Driver: Send + Sync + 'static {
    /// Switches it; how it is then.
    fn switch(&self, is_on: bool) -> BoxFuture<Result<bool, String>>;

    /// Looks whether it is on; `None` if nobody can tell.
    fn look(&self) -> BoxFuture<Result<Option<bool>, String>>;

    /// How often it is looked at; `None` if nobody can tell how it is.
    fn every(&self) -> Option<Duration>;

    /// The longest that switching, or a look, may take.
    fn time_out(&self) -> Duration;
}

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    Ok(Box::new(Actuator::new(&blueprint, switch(&blueprint)?)?))
}

fn switch(blueprint: &Blueprint) -> Result<Switch, BuildError> {
    let mut config: Config = blueprint.config_as()?;
    config.is_of(blueprint)?;
    let driver = match blueprint.driver.as_str() {
        GPIO => gpio::driver(config.wired(blueprint)?),
        COMMAND => command::driver(config.commanded(blueprint)?),
        _ => {
            let problem = "it needs a `driver`: \"gpio\" for a line of a board, \"command\" for \
                           any program";
            return Err(blueprint.problem(problem));
        }
    };
    Ok(Switch {
        id: blueprint.id.to_string(),
        ontology: Arc::clone(&blueprint.host.ontology),
        location: config.location,
        kind: config.kind,
        hand: Hand::of(driver),
        rests_until: None,
    })
}

struct Switch {
    id: String,
    ontology: Arc<Domain>,
    location: Place,
    kind: Kind,
    hand: Hand,
    rests_until: Option<Instant>,
}

/// A driver, and what is known by it. Copies are the same.
#[derive(Clone)]
struct Hand {
    driver: Arc<dyn Driver>,
    known: Arc<Mutex<Known>>,
}

/// Whether it is on, as far as anybody knows; or why it cannot be used.
type State = Result<Option<bool>, String>;

struct Known {
    state: State,
    /// Counts what was begun and done, so that no look is believed that began before it.
    turn: u64,
}

impl Hand {
    fn of(driver: Arc<dyn Driver>) -> Hand {
        Hand { driver, known: Arc::new(Mutex::new(Known { state: Ok(None), turn: 0 })) }
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn state(&self) -> State {
        self.known().state.clone()
    }

    /// Looks how it is.
    async fn look(self) {
        let turn = self.known().turn;
        let looked = self.driver.look().await;
        let mut known = self.known();
        if known.turn != turn {
            return;
        }
        if let Err(problem) = &looked
            && known.state.as_ref().err() != Some(problem)
        {
            tracing::warn!("failed to {problem}");
        }
        known.state = looked;
    }

    /// Switches it; how it is then.
    async fn switch(self, is_on: bool) -> Result<bool, String> {
        self.known().turn += 1;
        let found = self.driver.switch(is_on).await?;
        let mut known = self.known();
        known.turn += 1;
        known.state = Ok(Some(found));
        Ok(found)
    }

    /// What was begun did not succeed, so that nobody knows how it is.
    fn forget(&self) {
        let mut known = self.known();
        known.turn += 1;
        if known.state.is_ok() {
            known.state = Ok(None);
        }
    }
}

impl Switch {
    fn works(&self) -> bool {
        let rests = self.rests_until.is_some_and(|until| until > Instant::now());
        !rests && self.hand.state().is_ok()
    }

    /// How it is, as a fact: on, off, or unknown.
    fn fact(&self) -> String {
        let term = self.kind.words().term(&self.id, self.location.as_str(), &self.ontology);
        match self.hand.state() {
            Ok(Some(true)) => term,
            Ok(Some(false)) => format!("(not {term})"),
            Ok(None) | Err(_) => format!("(unknown {term})"),
        }
    }
}

impl Device for Switch {
    type Yield = bool;

    fn describe(&self) -> Description {
        let Switch { id, ontology, location, kind, .. } = self;
        let text = kind::model(id, location.as_str(), *kind, ontology, self.works());
        let timeout = Deadline(self.hand.driver.time_out() + MARGIN);
        let method = |action: &str, method: &str| {
            let (method, arguments) = (method.to_owned(), BTreeMap::new());
            (action.to_owned(), Method { method, arguments, timeout })
        };
        let (on, off) = kind.actions();
        let methods = [method(on, ON), method(off, OFF)].into_iter().collect();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        facts_of(&format!("(installed {} {}) {}", self.id, self.location, self.fact()))
    }

    fn look(&self) -> Option<BoxFuture<()>> {
        self.hand.driver.every()?;
        let hand = self.hand.clone();
        Some(Box::pin(async move {
            // What is not known by then is told when it is.
            let _ = tokio::time::timeout(FIRST_LOOK, hand.look()).await;
        }))
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<bool, Failure>> {
        let is_on = match call.method.as_str() {
            ON => true,
            OFF => false,
            _ => {
                let unknown = Failure::UnknownMethod(call.method.clone());
                return Box::pin(std::future::ready(Err(unknown)));
            }
        };
        let hand = self.hand.clone();
        Box::pin(async move { hand.switch(is_on).await.map_err(Failure::Driver) })
    }

    fn performed(&mut self, _call: &Call, is_on: bool) -> Performed {
        let detail = format!("{} at {}", self.kind.told(is_on), self.location);
        let observations = facts_of(&self.fact()).into_iter().map(|fact| fact.fact).collect();
        Performed { detail, observations }
    }

    fn failed(&mut self, _call: &Call, failure: &Failure) {
        self.hand.forget();
        if *failure != Failure::GivenUp {
            self.rests_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }

    fn watch(&mut self) -> Option<BoxFuture<Stir<Switch>>> {
        let every = self.hand.driver.every()?;
        let (hand, before) = (self.hand.clone(), self.hand.state());
        Some(Box::pin(async move {
            while hand.state() == before {
                tokio::time::sleep(every).await;
                hand.clone().look().await;
            }
            let is_back = before.is_err() && hand.state().is_ok();
            let stir: Stir<Switch> = Box::new(move |switch| {
                // What is plugged in again has not failed.
                if is_back {
                    switch.rests_until = None;
                }
                Vec::new()
            });
            stir
        }))
    }
}

/// On or off, for people.
fn words(is_on: bool) -> &'static str {
    if is_on { ON } else { OFF }
}
