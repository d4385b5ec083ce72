//! The types of communicative acts: the eleven of the paper (Table 1), and `not-understood`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Type of a communicative act. The names of the variants and their spelling in messages are FIPA's
/// (SC00037); the roles are those of the paper's Table 1.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Performative {
    /// Paper: *agree*. An actuator proposes a plan, or accepts a requested action.
    Agree,
    /// Paper: *cancel*. The sender asks the receiver to give up the commitment of this exchange.
    Cancel,
    /// Paper: *refuse*. The sender declines the request and gives the reason.
    Refuse,
    /// Paper: *request*. The sender asks the receiver to plan, reach a goal, execute a plan, act,
    /// or change the state.
    Request,
    /// Paper: *call for proposals*. The sender asks the receivers to propose plans for conjuncts of
    /// a goal.
    Cfp,
    /// Paper: *propose*. The central planner proposes a plan.
    Propose,
    /// Paper: *accept*. The sender accepts a proposal of the receiver.
    AcceptProposal,
    /// Paper: *reject*. The sender rejects the proposals of the receiver.
    RejectProposal,
    /// Paper: *inform*. The sender announces an action model, the state of an agent, or a new
    /// epoch.
    Inform,
    /// Paper: *query*. The sender asks the receiver to put a question to a person.
    QueryRef,
    /// Paper: *confirm*. The sender reports the progress or outcome of an action, a plan or a goal,
    /// or observations.
    Confirm,
    /// The sender could not read a message of the receiver, and gives the reason. Every FIPA
    /// protocol requires this performative.
    NotUnderstood,
}

/// Error for a text that is not the name of a performative.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no performative; there are {all}", all = Performative::ALL.map(Performative::as_str).join(", "))]
pub struct UnknownPerformative(pub String);

impl Performative {
    /// All performatives, in the order of Table 1.
    pub const ALL: [Performative; 12] = [
        Performative::Agree,
        Performative::Cancel,
        Performative::Refuse,
        Performative::Request,
        Performative::Cfp,
        Performative::Propose,
        Performative::AcceptProposal,
        Performative::RejectProposal,
        Performative::Inform,
        Performative::QueryRef,
        Performative::Confirm,
        Performative::NotUnderstood,
    ];

    /// Returns the spelling of the performative in FIPA and in messages.
    pub const fn as_str(self) -> &'static str {
        match self {
            Performative::Agree => "agree",
            Performative::Cancel => "cancel",
            Performative::Refuse => "refuse",
            Performative::Request => "request",
            Performative::Cfp => "cfp",
            Performative::Propose => "propose",
            Performative::AcceptProposal => "accept-proposal",
            Performative::RejectProposal => "reject-proposal",
            Performative::Inform => "inform",
            Performative::QueryRef => "query-ref",
            Performative::Confirm => "confirm",
            Performative::NotUnderstood => "not-understood",
        }
    }

    /// Whether a message with this performative and one receiver is retried until a receipt arrives
    /// (docs/design.md, “Delivery”). Such a message is a commitment, or an answer to a commitment.
    ///
    /// A lost `cfp` or `inform` is harmless: the initiator sends a `cfp` again to silent agents
    /// until the round of bids closes, and the next heartbeat replaces a lost one. A
    /// `not-understood` is never retried, because two agents that do not understand each other
    /// would send it forever.
    pub fn is_retried(self) -> bool {
        !matches!(self, Performative::Cfp | Performative::Inform | Performative::NotUnderstood)
    }
}

impl fmt::Display for Performative {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl FromStr for Performative {
    type Err = UnknownPerformative;

    fn from_str(text: &str) -> Result<Performative, UnknownPerformative> {
        Performative::ALL
            .into_iter()
            .find(|performative| performative.as_str() == text)
            .ok_or_else(|| UnknownPerformative(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wire_and_text_spellings_are_equal() {
        for performative in Performative::ALL {
            let json = serde_json::to_string(&performative).expect("a plain string");
            assert_eq!(json, format!("\"{performative}\""));
            assert_eq!(performative.as_str().parse(), Ok(performative));
        }
    }
}
