//! The inputs of the Domain Maintainer, parsed from the contents of messages.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    ChangeState, Heartbeat, Methods, ModelAnnouncement, Observation, Requested, RequestedFact,
    RequestedSince,
};
use acl::{AgentId, Incarnation, Millis};
use pddl::{ActionModel, Diagnostic, InitElement, Metric, Name};

use crate::declined::Declined;
use crate::parsed_model::ParsedModel;
use crate::timestamp::Timestamp;

/// Time for which an agent may be silent before its capabilities count as unavailable, in
/// proportion to the period of its heartbeats.
///
/// The default is three and a half periods: one heartbeat may be lost and one may be late. The
/// additional half period is a margin for a third heartbeat that arrives just in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilenceLimit {
    lease: Duration,
    period: Duration,
}

/// An announced action model with its methods. Cloning is cheap, because clones share the model.
#[derive(Clone, Debug)]
pub struct Announcement {
    /// The agent that sent the announcement and offers the actions of the model.
    pub agent: AgentId,
    /// Incarnation of the sender.
    pub incarnation: Incarnation,
    /// The model, divided into its parts; or an error if the model exceeds a limit.
    pub(crate) described: Result<ParsedModel, Declined>,
}

/// A heartbeat: the state of an agent. It lists every fact that the agent owns and that is true or
/// unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct ParsedHeartbeat {
    /// The agent that sent the heartbeat.
    pub agent: AgentId,
    /// Incarnation of the sender.
    pub incarnation: Incarnation,
    /// Number of the heartbeat, from 1 in each incarnation.
    pub sequence: u64,
    /// Digest of the sender's action model and methods.
    pub digest: String,
    /// Facts that the agent reports as true, and `(unknown FACT)` for each fact that the agent
    /// reports as unknown.
    pub facts: Vec<KnownFact>,
    /// Time until the next heartbeat is due; `None` if the agent never counts as silent.
    pub period: Option<Duration>,
}

/// A heartbeat that equals the previous one, except for its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RepeatedHeartbeat<'h> {
    /// The agent that sent the heartbeat.
    pub agent: &'h AgentId,
    /// Incarnation of the sender.
    pub incarnation: Incarnation,
    /// Digest of the sender's action model and methods.
    pub digest: &'h str,
    /// Number of the heartbeat that the agent sent before this one.
    pub before: u64,
    /// Number of this heartbeat.
    pub sequence: u64,
    /// Longest time until the next heartbeat is sent. After several such periods without a
    /// heartbeat, the agent counts as silent.
    pub period: Duration,
}

/// A reported fact, which may be known for a limited time only.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownFact {
    /// The fact itself, such as `(at robot-1 hall)`.
    pub fact: InitElement,
    /// Time at which the fact expires; `None` if the fact stays known until its owner retracts it.
    pub until: Option<Timestamp>,
}

/// A change of the state. The retractions take effect before the facts to believe.
///
/// A `(not FACT)` in `believe` retracts the fact.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// Facts that the Domain Maintainer should believe.
    pub believe: Vec<InitElement>,
    /// Facts that the Domain Maintainer should retract. For a function, the value is ignored.
    pub retract: Vec<InitElement>,
}

/// All changes that requests have made at the central Domain Maintainer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RequestedChanges {
    /// Facts that were requested. Each entry is the owner and the fact.
    pub facts: Vec<(AgentId, KnownFact)>,
    /// Facts of the map that requests have retracted.
    pub retracted: Vec<InitElement>,
    /// The requested metric of plans; `None` if the metric of the map is in use.
    pub metric: Option<Metric>,
    /// Actions that requests withhold from planning. Each entry is the name of the action and the
    /// agent; `None` stands for all agents.
    pub withheld: Vec<(Name, Option<AgentId>)>,
}

/// Changes that requests have made since the central Domain Maintainer last sent changes of this
/// kind.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RequestedChangesSince {
    /// New or changed requested facts. Each entry is the owner and the fact.
    pub facts: Vec<(AgentId, KnownFact)>,
    /// Requests for facts that were taken back. Each entry is the former owner and the fact. A
    /// value of a function is ignored: the function and its arguments identify the request.
    pub withdrawn: Vec<(AgentId, InitElement)>,
    /// Facts of the map that requests have retracted.
    pub retracted: Vec<InitElement>,
}

// === impl Announcement ===

impl Announcement {
    /// Creates the announcement of `model` by an agent. `methods` carry out the actions of the
    /// model; `digest` is the digest of the model and its methods (see
    /// [`model_digest`](crate::model_digest)).
    pub fn new(
        agent: AgentId,
        incarnation: Incarnation,
        model: ActionModel,
        methods: Methods,
        digest: &str,
    ) -> Announcement {
        Announcement { agent, incarnation, described: ParsedModel::of(model, methods, digest) }
    }

    /// Parses an announced model. The heartbeat in the announcement is parsed by
    /// [`ParsedHeartbeat::read`].
    ///
    /// # Errors
    ///
    /// Returns diagnostics, with places in the model's text, if the model is not valid PDDL.
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

// === impl ParsedHeartbeat ===

impl ParsedHeartbeat {
    /// Parses a heartbeat that was received at `now`.
    ///
    /// # Errors
    ///
    /// Returns diagnostics if the facts of the heartbeat are not valid PDDL, with places in the
    /// first invalid text.
    pub fn read(
        agent: AgentId,
        incarnation: Incarnation,
        heartbeat: &Heartbeat,
        now: Timestamp,
    ) -> Result<ParsedHeartbeat, Vec<Diagnostic>> {
        let Heartbeat { digest, sequence, facts, known_for, period, .. } = heartbeat;
        let known = KnownFact::read_all(facts, known_for, now)?;
        let period = Some(period.0);
        let (digest, sequence) = (digest.clone(), *sequence);
        Ok(ParsedHeartbeat { agent, incarnation, sequence, digest, facts: known, period })
    }
}

// === impl SilenceLimit ===

impl SilenceLimit {
    /// Returns a limit of `lease` for agents with one heartbeat every `period`. For other periods
    /// the limit changes in proportion.
    pub fn new(lease: Duration, period: Duration) -> SilenceLimit {
        SilenceLimit { lease, period }
    }

    /// Returns the tolerated silence of an agent that sends a heartbeat every `period`.
    pub fn of_period(self, period: Duration) -> Duration {
        let nanos = period.as_nanos().saturating_mul(self.lease.as_nanos());
        let nanos = nanos / self.period.as_nanos().max(1);
        Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
    }
}

/// Default lease and period of heartbeats. One heartbeat may be lost and one may be late; the half
/// period is a margin for the third.
const LEASE: Duration = Duration::from_millis(3_500);
const PERIOD: Duration = Duration::from_millis(1_000);

impl Default for SilenceLimit {
    fn default() -> SilenceLimit {
        SilenceLimit::new(LEASE, PERIOD)
    }
}

// === impl KnownFact ===

impl KnownFact {
    fn read_all(
        facts: &str,
        known_for: &BTreeMap<String, Millis>,
        now: Timestamp,
    ) -> Result<Vec<KnownFact>, Vec<Diagnostic>> {
        let lasting = pddl::parse_init_elements(facts).into_result()?;
        let mut known: Vec<KnownFact> = lasting.into_iter().map(KnownFact::from).collect();
        for (text, left) in known_for {
            let until = Some(now.after(left.0));
            for fact in pddl::parse_init_elements(text).into_result()? {
                known.push(KnownFact { fact, until });
            }
        }
        Ok(known)
    }

    /// Parses an observation that was received at `now`.
    ///
    /// # Errors
    ///
    /// Returns diagnostics if the observation is not valid PDDL, with places in the first invalid
    /// text.
    pub fn read(observed: &Observation, now: Timestamp) -> Result<Vec<KnownFact>, Vec<Diagnostic>> {
        let Observation { facts, known_for } = observed;
        KnownFact::read_all(facts, known_for, now)
    }
}

impl From<InitElement> for KnownFact {
    fn from(fact: InitElement) -> KnownFact {
        KnownFact { fact, until: None }
    }
}

// === impl Effects ===

impl Effects {
    /// Parses a request to change the state.
    ///
    /// # Errors
    ///
    /// Returns diagnostics if `believe` or `retract` is not valid PDDL. Their places are in the
    /// first of these texts that is not valid.
    pub fn read(change: &ChangeState) -> Result<Effects, Vec<Diagnostic>> {
        let ChangeState { believe, retract, owner: _ } = change;
        Ok(Effects {
            believe: pddl::parse_init_elements(believe).into_result()?,
            retract: pddl::parse_init_elements(retract).into_result()?,
        })
    }
}

// === impl RequestedChanges ===

impl RequestedChanges {
    /// Parses a message with all requested changes that was received at `now`.
    ///
    /// # Errors
    ///
    /// Returns diagnostics if the message is not valid PDDL, with places in the first invalid text.
    pub fn read(told: &Requested, now: Timestamp) -> Result<RequestedChanges, Vec<Diagnostic>> {
        let Requested { facts, retracted, metric, withheld } = told;
        let metric = metric.as_ref().map(|metric| pddl::parse_metric(metric).into_result());
        Ok(RequestedChanges {
            facts: known(facts, now)?,
            retracted: pddl::parse_init_elements(retracted).into_result()?,
            metric: metric.transpose()?,
            withheld: { withheld.iter() }
                .map(|of| (Name::new(&of.action), of.agent.clone()))
                .collect(),
        })
    }
}

// === impl RequestedChangesSince ===

impl RequestedChangesSince {
    /// Parses a message with recent requested changes that was received at `now`.
    ///
    /// # Errors
    ///
    /// Returns diagnostics if the message is not valid PDDL, with places in the first invalid text.
    pub fn read(
        told: &RequestedSince,
        now: Timestamp,
    ) -> Result<RequestedChangesSince, Vec<Diagnostic>> {
        let RequestedSince { facts, withdrawn, retracted } = told;
        let withdrawn = known(withdrawn, now)?.into_iter();
        Ok(RequestedChangesSince {
            facts: known(facts, now)?,
            withdrawn: withdrawn.map(|(agent, known)| (agent, known.fact)).collect(),
            retracted: pddl::parse_init_elements(retracted).into_result()?,
        })
    }
}

fn known(
    told: &[RequestedFact],
    now: Timestamp,
) -> Result<Vec<(AgentId, KnownFact)>, Vec<Diagnostic>> {
    let mut facts = Vec::with_capacity(told.len());
    for RequestedFact { fact, owner, known_for } in told {
        let until = known_for.map(|left| now.after(left.0));
        for fact in pddl::parse_init_elements(fact).into_result()? {
            facts.push((owner.clone(), KnownFact { fact, until }));
        }
    }
    Ok(facts)
}
