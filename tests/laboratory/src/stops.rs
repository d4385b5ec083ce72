//! A stop in the midst of the faults, and the check that no device begins anything under it.
//!
//! A person stops everything at a time that the seed decides, and releases the stop when all faults
//! are over. The evidence is the building's truth: what a device begins after its confirmation
//! reached the person breaks the promise. After the faults, the stop must hold everywhere, also
//! where its request never arrived.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{ReleaseStops, Request, Stop, value};
use acl::{AgentId, Performative, Protocol};
use building::{BuildingEvent, Truth};
use fastrand::Rng;
use keyboard::{MessageDraft, UserRequest};

use crate::people::Person;
use crate::script::{BLINKS_UNTIL, FAULTS_UNTIL, TrialScript};

/// Identifier of the stop.
const ID: &str = "stop";

/// How long a device may take to learn of the stop after the last fault: some heartbeats, and the
/// lease of a link.
const SPREADS_WITHIN: Duration = Duration::from_secs(15);

/// How long the stop holds everywhere before it is released.
const HOLDS_FOR: Duration = Duration::from_secs(15);

/// How often the person asks, until one device has confirmed: that one tells the others.
const ASKS_EVERY: Duration = Duration::from_secs(5);

/// How long the person waits for the answer of a device: until all faults are over.
const PATIENCE: Duration = Duration::from_secs(120);

/// A stop in a trial, and what is known of it.
pub struct StopTrial {
    /// Time at which the person stops everything.
    at: Duration,
    /// Time at which the person asks again, as long as no device has confirmed.
    again_at: Duration,
    devices: Vec<AgentId>,
    state: StopProgress,
    /// Devices whose confirmation has reached the person, each with the number of the building's
    /// next event at that time.
    confirmed: BTreeMap<String, u64>,
    /// Number of the building's next event when the stop must hold everywhere.
    spread: Option<u64>,
    broken: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum StopProgress {
    Ahead,
    InForce,
    Released,
}

impl StopTrial {
    /// Draws the time of the stop. Uses its own random generator, so that the rest of the trial is
    /// the same as without a stop.
    pub fn draw(script: &TrialScript) -> StopTrial {
        let rng = &mut Rng::with_seed(script.seed ^ u64::from_be_bytes(*b"the stop"));
        let (from, until) = (BLINKS_UNTIL.as_millis() as u64, FAULTS_UNTIL.as_millis() as u64);
        let is_device = |plugin: &str| {
            ["turtlebot", "ir-temperature-sensor", "temperature-sensor"].contains(&plugin)
        };
        let devices = script.agents.iter().filter(|entry| is_device(entry.plugin));
        let name = |name: &str| AgentId::new(name).expect("invariant: a name");
        StopTrial {
            at: Duration::from_millis(rng.u64(from..until)),
            again_at: Duration::ZERO,
            devices: devices.map(|entry| name(&entry.name)).collect(),
            state: StopProgress::Ahead,
            confirmed: BTreeMap::new(),
            spread: None,
            broken: Vec::new(),
        }
    }

    /// Whether the stop has been released.
    pub fn is_over(&self) -> bool {
        self.state == StopProgress::Released
    }

    /// Returns what was broken.
    pub fn violations(&self) -> &[String] {
        &self.broken
    }

    /// Does what is due at the time `now`, and compares the truth with the confirmations.
    pub fn advance(&mut self, now: Duration, person: &mut Person, truth: &Truth) {
        for message in person.take_answers() {
            let is_done = message.performative == Performative::Confirm;
            if is_done && self.state == StopProgress::InForce {
                let (device, next) = (message.sender.to_string(), truth.next_sequence());
                self.confirmed.entry(device).or_insert(next);
            }
        }
        match self.state {
            StopProgress::Ahead if now >= self.at => {
                self.state = StopProgress::InForce;
                self.again_at = now;
            }
            StopProgress::InForce => {
                if self.confirmed.is_empty() && now >= self.again_at {
                    self.again_at = now + ASKS_EVERY;
                    self.request_stop(person);
                }
                self.compare(truth);
                if self.spread.is_none() && now >= FAULTS_UNTIL + SPREADS_WITHIN {
                    self.spread = Some(truth.next_sequence());
                }
                if now >= FAULTS_UNTIL + SPREADS_WITHIN + HOLDS_FOR {
                    self.state = StopProgress::Released;
                    let ids = vec![ID.to_owned()];
                    self.request(person, &Request::ReleaseStops(ReleaseStops { ids }));
                }
            }
            StopProgress::Ahead | StopProgress::Released => (),
        }
    }

    fn request_stop(&self, person: &Person) {
        let by = AgentId::new(&person.name).expect("invariant: a name");
        let (id, scope, why) = (ID.to_owned(), Vec::new(), String::new());
        self.request(person, &Request::Stop(Stop { id, scope, by, why }));
    }

    fn request(&self, person: &Person, request: &Request) {
        for device in &self.devices {
            person.send(UserRequest::Send(MessageDraft {
                to: Some(device.clone()),
                performative: Performative::Request,
                protocol: Protocol::StateChange,
                conversation: None,
                content: value(request),
                patience: PATIENCE,
            }));
        }
    }

    /// Finds what was begun under the stop.
    fn compare(&mut self, truth: &Truth) {
        for occurrence in truth.occurrences().rev() {
            let (BuildingEvent::Departed { robot: device, .. }
            | BuildingEvent::Asked { sensor: device }) = &occurrence.event
            else {
                continue;
            };
            let number = occurrence.sequence;
            let is_confirmed = self.confirmed.get(device).is_some_and(|since| number >= *since);
            let is_spread = self.spread.is_some_and(|since| number >= since);
            if is_confirmed || is_spread {
                let when = if is_confirmed { "it had confirmed" } else { "all faults were over" };
                let line = format!("`{device}` began event {number} under the stop, after {when}");
                if !self.broken.contains(&line) {
                    self.broken.push(line);
                }
            }
        }
    }
}
