//! What is told to the Domain Maintainer, made precise at the border.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    ChangeState, Heartbeat, Methods, ModelAnnouncement, Observation, Requested, RequestedFact,
    RequestedSince,
};
use acl::{AgentId, Deadline, Incarnation};
use pddl::{ActionModel, Diagnostic, InitElement, Metric, Name};

use crate::declined::Declined;
use crate::described::Described;
use crate::moment::Moment;

/// How many half periods an agent may be silent before its capabilities are masked.
///
/// Three and a half heartbeats: one may be lost and one may be late, and the half keeps a
/// punctual third from racing the limit.
pub const SILENCE_HALF_PERIODS: u32 = 7;

/// An agent's description of itself. Cheap to clone: the clones share it.
#[derive(Clone, Debug)]
pub struct Announcement {
    /// Who sent it.
    pub agent: AgentId,
    /// Which life of the sender.
    pub incarnation: Incarnation,
    /// What it said, or why that is too much.
    pub(crate) described: Result<Described, Declined>,
}

/// An agent's state, complete for what it owns.
#[derive(Clone, Debug, PartialEq)]
pub struct Beat {
    /// Who sent it.
    pub agent: AgentId,
    /// Which life of the sender.
    pub incarnation: Incarnation,
    /// Counts this incarnation's heartbeats, from 1.
    pub sequence: u64,
    /// Digest of the model that it goes with.
    pub digest: String,
    /// What the agent knows, and which of it is `(unknown FACT)` to it.
    pub facts: Vec<Known>,
    /// When its capabilities are masked if no further heartbeat comes; `None`: never.
    pub due: Option<Moment>,
}

/// A heartbeat that says what the one before it said, but for its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repeated<'h> {
    /// Who sent it.
    pub agent: &'h AgentId,
    /// Which life of the sender.
    pub incarnation: Incarnation,
    /// Digest of the model that it goes with.
    pub digest: &'h str,
    /// The number of the one before.
    pub before: u64,
    /// Its own.
    pub sequence: u64,
    /// When the next is due at the latest.
    pub period: Duration,
}

/// A fact that is known, perhaps for a while only.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// The fact.
    pub fact: InitElement,
    /// When it stops to be known; `None`: when its owner says so.
    pub until: Option<Moment>,
}

/// A change of the state: first what is believed no longer, then what is believed.
///
/// A `(not FACT)` among the believed retracts the fact.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// Facts to believe.
    pub believe: Vec<InitElement>,
    /// Facts to believe no longer; of a number, its value does not count.
    pub retract: Vec<InitElement>,
}

/// What requests changed at the central maintainer, complete.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Requests {
    /// Facts, each with whose word it is.
    pub facts: Vec<(AgentId, Known)>,
    /// Facts of the map that are believed no longer.
    pub retracted: Vec<InitElement>,
    /// What plans are measured by, if not as the map says.
    pub metric: Option<Metric>,
    /// Actions that are withheld, of one agent or of all.
    pub withheld: Vec<(Name, Option<AgentId>)>,
}

/// What requests changed since it was told last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RequestsSince {
    /// Facts that are told now, each with whose word it is.
    pub facts: Vec<(AgentId, Known)>,
    /// Facts that are nobody's word any longer, each with whose it was; of numbers, any value.
    pub withdrawn: Vec<(AgentId, InitElement)>,
    /// Facts of the map that are believed no longer.
    pub retracted: Vec<InitElement>,
}

// === impl Announcement ===

impl Announcement {
    /// A model, the methods that carry its actions out, and the digest of both:
    /// [`model_digest`](crate::model_digest).
    pub fn new(
        agent: AgentId,
        incarnation: Incarnation,
        model: ActionModel,
        methods: Methods,
        digest: &str,
    ) -> Announcement {
        Announcement { agent, incarnation, described: Described::of(model, methods, digest) }
    }

    /// Reads what an agent announced. The heartbeat that comes with it is read by [`Beat::read`].
    ///
    /// # Errors
    ///
    /// If the model is no PDDL; the diagnostics point into its text.
    pub fn read(
        agent: AgentId,
        incarnation: Incarnation,
        announced: &ModelAnnouncement,
    ) -> Result<Announcement, Vec<Diagnostic>> {
        let ModelAnnouncement { model, methods, heartbeat } = announced;
        let model = pddl::parse_action_model(model).into_result()?;
        Ok(Announcement::new(agent, incarnation, model, methods.clone(), &heartbeat.digest))
    }
}

// === impl Beat ===

impl Beat {
    /// Reads a heartbeat as it came at `now`.
    ///
    /// # Errors
    ///
    /// If its facts are no PDDL; the diagnostics point into the first text that has mistakes.
    pub fn read(
        agent: AgentId,
        incarnation: Incarnation,
        heartbeat: &Heartbeat,
        now: Moment,
    ) -> Result<Beat, Vec<Diagnostic>> {
        let Heartbeat { digest, sequence, facts, known_for, period } = heartbeat;
        let known = Known::read_all(facts, known_for, now)?;
        let due = Some(silent_from(period.0, now));
        let (digest, sequence) = (digest.clone(), *sequence);
        Ok(Beat { agent, incarnation, sequence, digest, facts: known, due })
    }
}

/// When an agent is silent whose next heartbeat is due in `period`.
pub(crate) fn silent_from(period: Duration, now: Moment) -> Moment {
    now.after(period.saturating_mul(SILENCE_HALF_PERIODS) / 2)
}

// === impl Known ===

impl Known {
    fn read_all(
        facts: &str,
        known_for: &BTreeMap<String, Deadline>,
        now: Moment,
    ) -> Result<Vec<Known>, Vec<Diagnostic>> {
        let lasting = pddl::parse_init_elements(facts).into_result()?;
        let mut known: Vec<Known> = lasting.into_iter().map(Known::from).collect();
        for (text, left) in known_for {
            let until = Some(now.after(left.0));
            for fact in pddl::parse_init_elements(text).into_result()? {
                known.push(Known { fact, until });
            }
        }
        Ok(known)
    }

    /// Reads what somebody observed, as it came at `now`.
    ///
    /// # Errors
    ///
    /// If it is no PDDL; the diagnostics point into the first text that has mistakes.
    pub fn read(observed: &Observation, now: Moment) -> Result<Vec<Known>, Vec<Diagnostic>> {
        let Observation { facts, known_for } = observed;
        Known::read_all(facts, known_for, now)
    }
}

impl From<InitElement> for Known {
    fn from(fact: InitElement) -> Known {
        Known { fact, until: None }
    }
}

// === impl Effects ===

impl Effects {
    /// Reads a request to change the state.
    ///
    /// # Errors
    ///
    /// If it is no PDDL; the diagnostics point into the first text that has mistakes.
    pub fn read(change: &ChangeState) -> Result<Effects, Vec<Diagnostic>> {
        let ChangeState { believe, retract, owner: _ } = change;
        Ok(Effects {
            believe: pddl::parse_init_elements(believe).into_result()?,
            retract: pddl::parse_init_elements(retract).into_result()?,
        })
    }
}

// === impl Requests ===

impl Requests {
    /// Reads what was told at `now`.
    ///
    /// # Errors
    ///
    /// If it is no PDDL; the diagnostics point into the first text that has mistakes.
    pub fn read(told: &Requested, now: Moment) -> Result<Requests, Vec<Diagnostic>> {
        let Requested { facts, retracted, metric, withheld } = told;
        let metric = metric.as_ref().map(|metric| pddl::parse_metric(metric).into_result());
        Ok(Requests {
            facts: known(facts, now)?,
            retracted: pddl::parse_init_elements(retracted).into_result()?,
            metric: metric.transpose()?,
            withheld: { withheld.iter() }
                .map(|of| (Name::new(&of.action), of.agent.clone()))
                .collect(),
        })
    }
}

// === impl RequestsSince ===

impl RequestsSince {
    /// Reads what was told at `now`.
    ///
    /// # Errors
    ///
    /// If it is no PDDL; the diagnostics point into the first text that has mistakes.
    pub fn read(told: &RequestedSince, now: Moment) -> Result<RequestsSince, Vec<Diagnostic>> {
        let RequestedSince { facts, withdrawn, retracted } = told;
        let withdrawn = known(withdrawn, now)?.into_iter();
        Ok(RequestsSince {
            facts: known(facts, now)?,
            withdrawn: withdrawn.map(|(agent, known)| (agent, known.fact)).collect(),
            retracted: pddl::parse_init_elements(retracted).into_result()?,
        })
    }
}

fn known(told: &[RequestedFact], now: Moment) -> Result<Vec<(AgentId, Known)>, Vec<Diagnostic>> {
    let mut facts = Vec::with_capacity(told.len());
    for RequestedFact { fact, owner, known_for } in told {
        let until = known_for.map(|left| now.after(left.0));
        for fact in pddl::parse_init_elements(fact).into_result()? {
            facts.push((owner.clone(), Known { fact, until }));
        }
    }
    Ok(facts)
}

const _: () = assert!(SILENCE_HALF_PERIODS > 2 * 3, "one heartbeat lost, one late");
