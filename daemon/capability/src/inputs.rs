//! What is told to the Domain Maintainer, made precise at the border.

use acl::content::{ChangeState, Heartbeat, Methods, ModelAnnouncement};
use acl::{AgentId, Incarnation};
use pddl::{ActionModel, Diagnostic, InitElement};

use crate::moment::Moment;

/// How many half periods an agent may be silent before its capabilities are masked.
///
/// Three and a half heartbeats: one may be lost and one may be late, and the half keeps a
/// punctual third from racing the limit.
pub const SILENCE_HALF_PERIODS: u32 = 7;

/// An agent's description of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Announcement {
    /// Who sent it.
    pub agent: AgentId,
    /// Which life of the sender.
    pub incarnation: Incarnation,
    /// The model, parsed.
    pub model: ActionModel,
    /// Which method carries out which action.
    pub methods: Methods,
    /// Of the model's text and the methods: [`model_digest`](crate::model_digest).
    pub digest: String,
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
    /// What the agent knows.
    pub facts: Vec<Known>,
    /// When its capabilities are masked if no further heartbeat comes; `None`: never.
    pub due: Option<Moment>,
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

// === impl Announcement ===

impl Announcement {
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
        let (methods, digest) = (methods.clone(), heartbeat.digest.clone());
        Ok(Announcement { agent, incarnation, model, methods, digest })
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
        let mut known: Vec<Known> = pddl::parse_init_elements(facts)
            .into_result()?
            .into_iter()
            .map(|fact| Known { fact, until: None })
            .collect();
        for (text, left) in known_for {
            let until = Some(now.after(left.0));
            for fact in pddl::parse_init_elements(text).into_result()? {
                known.push(Known { fact, until });
            }
        }
        let due = Some(now.after(period.0.saturating_mul(SILENCE_HALF_PERIODS) / 2));
        let (digest, sequence) = (digest.clone(), *sequence);
        Ok(Beat { agent, incarnation, sequence, digest, facts: known, due })
    }
}

// === impl Known ===

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

const _: () = assert!(SILENCE_HALF_PERIODS > 2 * 3, "one heartbeat lost, one late");
