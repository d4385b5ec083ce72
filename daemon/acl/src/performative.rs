//! The types of communicative acts: the paper's eleven (Table 1) and `not-understood`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The type of a communicative act. Rust names and wire spelling are FIPA's (SC00037); the
/// roles are those of the paper's Table 1.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Performative {
    /// Paper: *agree*. A plan proposal from an actuator, or its acceptance of a requested action.
    Agree,
    /// Paper: *cancel*. Give up the commitment of this exchange.
    Cancel,
    /// Paper: *refuse*. The request is declined, with the reason.
    Refuse,
    /// Paper: *request*. Plan, achieve, execute, act, change the state.
    Request,
    /// Paper: *call for proposals*.
    Cfp,
    /// Paper: *propose*. A plan proposal from the central planner.
    Propose,
    /// Paper: *accept*.
    AcceptProposal,
    /// Paper: *reject*.
    RejectProposal,
    /// Paper: *inform*. An action model, an agent's state, a new capability epoch.
    Inform,
    /// Paper: *query*. Ask a person.
    QueryRef,
    /// Paper: *confirm*. Progress and outcome of an action or a plan; observations.
    Confirm,
    /// The message could not be read, with the reason. Every FIPA protocol needs it.
    NotUnderstood,
}

/// Error for a text that names no performative.
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

    /// Returns the FIPA spelling, which is also that of the wire.
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

    /// Whether a message with this performative to one agent is a commitment or an answer to one. Such
    /// messages are retried until a receipt arrives (docs/design.md, “Delivery”).
    ///
    /// `cfp` and `inform` tolerate loss: the initiator sends a `cfp` again to silent agents until the
    /// round closes, and the next heartbeat replaces a lost one. A `not-understood` is never retried,
    /// so that two agents that do not understand each other stop sending.
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
    fn wire_and_text_spell_alike() {
        for performative in Performative::ALL {
            let json = serde_json::to_string(&performative).expect("a plain string");
            assert_eq!(json, format!("\"{performative}\""));
            assert_eq!(performative.as_str().parse(), Ok(performative));
        }
    }
}
