//! A switch in a room: a lamp, a relay, a lock.
//!
//! - `kind` has the PDDL names of each kind, and its action model.
//! - `Driver` is the trait of drivers: `gpio` drives a line of a board, `command` runs programs.
//! - A state that the driver reads back is known, even if the device was switched by hand. A device
//!   without a readable state is assumed to be in the state to which it was last switched.
//! - A state that cannot be read is unknown, and the switch offers no actions. After a failure a
//!   switch offers no actions for a while, so that plans avoid it.

mod command;
mod config;
mod gpio;
mod kind;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::Millis;
use acl::content::Method;
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, MethodCall, MethodFailure, MethodResult,
    OnOffNames, OwnFact, PlaceName, facts_of, model_of,
};
use agent::{Blueprint, BuildError, LaunchableAgent, PluginEntry};
use pddl::Domain;
use tokio::time::Instant;

use config::Config;
use kind::SwitchKind;

/// Pause after a failure, during which a switch offers no actions. For example, a loose wire has
/// contact again within seconds.
const REST_AFTER_FAILURE: Duration = Duration::from_secs(30);

/// Time limit for waiting for the device's state before the first announcement.
const FIRST_STATE_TIME_MAX: Duration = Duration::from_secs(2);

/// Time that a method has in addition to the driver's time limit, so that the driver's error is
/// reported in time.
const MARGIN: Duration = Duration::from_secs(1);

const GPIO: &str = "gpio";
const COMMAND: &str = "command";

/// Names of the drivers; the first is the default.
const DRIVERS: &[&str] = &[GPIO, COMMAND];

/// Names of the methods that switch on and off.
const ON: &str = "on";
const OFF: &str = "off";

/// The entry of switches (a lamp, a relay or a lock) in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "switch",
    about: "switches a lamp, a relay or a lock in a room, by a line of a board or any program",
    drivers: DRIVERS,
    has_replicas: false,
    build,
};

/// The driver of a switch. Error texts complete “failed to …”.
trait Driver: Send + Sync + 'static {
    /// Switches the device on or off. Returns the state afterwards: `true` if the device is on.
    fn switch(&self, is_on: bool) -> BoxFuture<Result<bool, String>>;

    /// Reads the state of the device: `true` if it is on, `None` if it has no readable state.
    fn read_state(&self) -> BoxFuture<Result<Option<bool>, String>>;

    /// Returns the pause between two checks of the state; `None` if the device has no readable
    /// state.
    fn every(&self) -> Option<Duration>;

    /// Returns the time limit for switching, which is also that for reading the state.
    fn time_out(&self) -> Duration;
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Actuator::build(&blueprint, switch(&blueprint)?)
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
        driver_handle: DriverHandle::of(driver),
        paused_until: None,
    })
}

struct Switch {
    id: String,
    ontology: Arc<Domain>,
    location: PlaceName,
    kind: SwitchKind,
    driver_handle: DriverHandle,
    paused_until: Option<Instant>,
}

/// A driver, and the last state that it has reported. Clones share both.
#[derive(Clone)]
struct DriverHandle {
    driver: Arc<dyn Driver>,
    known: Arc<Mutex<KnownState>>,
}

/// Last known state: `true` if the device is on, `None` if the state is unknown; the error is the
/// reason why the device cannot be used.
type SwitchState = Result<Option<bool>, String>;

struct KnownState {
    state: SwitchState,
    /// Counter that each switching increases when it begins and when it ends. The result of a check
    /// that began before the latest change of the counter is discarded.
    switch_count: u64,
}

impl DriverHandle {
    fn of(driver: Arc<dyn Driver>) -> DriverHandle {
        DriverHandle {
            driver,
            known: Arc::new(Mutex::new(KnownState { state: Ok(None), switch_count: 0 })),
        }
    }

    fn known(&self) -> MutexGuard<'_, KnownState> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn state(&self) -> SwitchState {
        self.known().state.clone()
    }

    /// Reads the state of the device. Discards the result if the device was switched meanwhile.
    async fn refresh(self) {
        let turn = self.known().switch_count;
        let looked = self.driver.read_state().await;
        let mut known = self.known();
        if known.switch_count != turn {
            return;
        }
        if let Err(problem) = &looked
            && known.state.as_ref().err() != Some(problem)
        {
            tracing::warn!("failed to {problem}");
        }
        known.state = looked;
    }

    /// Switches the device on or off. Returns the state afterwards: `true` if the device is on.
    async fn switch(self, is_on: bool) -> Result<bool, String> {
        self.known().switch_count += 1;
        let found = self.driver.switch(is_on).await?;
        let mut known = self.known();
        known.switch_count += 1;
        known.state = Ok(Some(found));
        Ok(found)
    }

    /// Sets the state to unknown after an unsuccessful switching. Keeps a state that is the reason
    /// why the device is unavailable.
    fn set_unknown(&self) {
        let mut known = self.known();
        known.switch_count += 1;
        if known.state.is_ok() {
            known.state = Ok(None);
        }
    }
}

impl Switch {
    fn is_available(&self) -> bool {
        let rests = self.paused_until.is_some_and(|until| until > Instant::now());
        !rests && self.driver_handle.state().is_ok()
    }

    /// Returns the state of the device as a PDDL fact: on, off, or unknown.
    fn fact(&self) -> String {
        let term =
            self.kind.names().predicates.term(&self.id, self.location.as_str(), &self.ontology);
        match self.driver_handle.state() {
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
        let text = kind::model(id, location.as_str(), *kind, ontology, self.is_available());
        let timeout = Millis(self.driver_handle.driver.time_out() + MARGIN);
        let method = |action: &str, method: &str| {
            let (method, arguments) = (method.to_owned(), BTreeMap::new());
            (action.to_owned(), Method { method, arguments, timeout })
        };
        let OnOffNames { on, off, .. } = kind.names();
        let methods = [method(on, ON), method(off, OFF)].into_iter().collect();
        Description { model: model_of(&text), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        facts_of(&format!("(installed {} {}) {}", self.id, self.location, self.fact()))
    }

    fn read_state(&self) -> Option<BoxFuture<()>> {
        self.driver_handle.driver.every()?;
        let hand = self.driver_handle.clone();
        Some(Box::pin(async move {
            // A state that is still unknown after that time is announced later.
            let _ = tokio::time::timeout(FIRST_STATE_TIME_MAX, hand.refresh()).await;
        }))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<bool, MethodFailure>> {
        let is_on = match call.method.as_str() {
            ON => true,
            OFF => false,
            _ => {
                let unknown = MethodFailure::UnknownMethod(call.method.clone());
                return Box::pin(std::future::ready(Err(unknown)));
            }
        };
        let hand = self.driver_handle.clone();
        Box::pin(async move { hand.switch(is_on).await.map_err(MethodFailure::Driver) })
    }

    fn on_success(&mut self, _call: &MethodCall, is_on: bool) -> MethodResult {
        let detail = format!("{} at {}", self.kind.state_text(is_on), self.location);
        let observations = facts_of(&self.fact()).into_iter().map(|fact| fact.fact).collect();
        MethodResult { detail, observations }
    }

    fn on_failure(&mut self, _call: &MethodCall, failure: &MethodFailure) {
        self.driver_handle.set_unknown();
        if *failure != MethodFailure::GivenUp {
            self.paused_until = Some(Instant::now() + REST_AFTER_FAILURE);
        }
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Switch>>> {
        let every = self.driver_handle.driver.every()?;
        let (hand, before) = (self.driver_handle.clone(), self.driver_handle.state());
        Some(Box::pin(async move {
            while hand.state() == before {
                tokio::time::sleep(every).await;
                hand.clone().refresh().await;
            }
            let is_back = before.is_err() && hand.state().is_ok();
            let stir: DeviceEvent<Switch> = Box::new(move |switch| {
                // A device that was plugged in again has not failed.
                if is_back {
                    switch.paused_until = None;
                }
                Vec::new()
            });
            stir
        }))
    }
}

/// Returns “on” or “off” as text for people.
fn words(is_on: bool) -> &'static str {
    if is_on { ON } else { OFF }
}
