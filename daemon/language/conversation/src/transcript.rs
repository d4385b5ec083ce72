//! All exchanges that a listener receives, each with its own state machine.

use std::collections::BTreeMap;

use acl::{AgentId, Message, Protocol, ReplyToken};

use crate::duplicate_window::DuplicateWindow;
use crate::exchange::{Exchange, ProtocolViolation};
use crate::turn::{ExchangePhase, ExchangeRole};

/// Maximum number of open exchanges in a transcript. Beyond it, the exchange with the smallest
/// token is dropped, so that the memory of a listener that runs for months is bounded.
pub const TRANSCRIPT_EXCHANGES_MAX: usize = 10_000;

/// The exchanges with messages that a listener on the network has received.
#[derive(Clone, Debug)]
pub struct Transcript {
    duplicates: DuplicateWindow,
    /// State of each exchange. The key is the token of the exchange and its participant. The
    /// participant is `None` for a broadcast after its first message, before any participant has
    /// answered.
    exchanges: BTreeMap<(ReplyToken, Option<AgentId>), Exchange>,
}

impl Default for Transcript {
    fn default() -> Transcript {
        Transcript::new()
    }
}

impl Transcript {
    /// Creates an empty transcript.
    pub fn new() -> Transcript {
        Transcript {
            duplicates: DuplicateWindow::new(TRANSCRIPT_EXCHANGES_MAX),
            exchanges: BTreeMap::new(),
        }
    }

    /// Handles the next message in the order of arrival. Returns the new phase of the message's
    /// exchange; `None` if the message was not checked.
    ///
    /// Three kinds of messages are not checked and never cause an error: a message outside any
    /// protocol (an `inform` to all), a repeated message, and a message of an exchange without a
    /// received opening, because a listener may start late.
    ///
    /// # Errors
    ///
    /// Returns an error if the protocol of the message's exchange does not allow the message now.
    /// The phase is then unchanged.
    pub fn receive(
        &mut self,
        message: &Message,
    ) -> Result<Option<ExchangePhase>, ProtocolViolation> {
        let (Some(token), Some(protocol)) = (message.exchange(), message.protocol) else {
            return Ok(None);
        };
        if !self.duplicates.insert(&message.sender, &message.id) {
            return Ok(None);
        }
        if message.opens_exchange() {
            return self.open(token, protocol, message).map(Some);
        }
        // A message may go to several participants of a broadcast. Each of them has an exchange of
        // its own.
        let mut heard = Ok(None);
        for participant in self.participants(token, message) {
            let key = (token.clone(), Some(participant));
            let Some(exchange) = self.exchange(&key) else { continue };
            let advanced = exchange.advance(message);
            if advanced == Ok(ExchangePhase::Closed) {
                self.exchanges.remove(&key);
            }
            heard = heard.and(advanced.map(Some));
        }
        heard
    }

    fn open(
        &mut self,
        token: &ReplyToken,
        protocol: Protocol,
        message: &Message,
    ) -> Result<ExchangePhase, ProtocolViolation> {
        let mut exchange = Exchange::new(protocol, message.sender.clone(), message.incarnation);
        let phase = exchange.advance(message)?;
        if self.exchanges.len() >= TRANSCRIPT_EXCHANGES_MAX {
            self.exchanges.pop_first();
        }
        self.exchanges.insert((token.clone(), message.receiver.first().cloned()), exchange);
        Ok(phase)
    }

    /// Returns the participants of the exchange that a message continues: its receivers if the
    /// initiator sent it, and otherwise its sender. Returns no participant if the exchange is not
    /// known.
    fn participants(&self, token: &ReplyToken, message: &Message) -> Vec<AgentId> {
        match self.role(token, &message.sender) {
            Some(ExchangeRole::Initiator) => message.receiver.clone(),
            Some(ExchangeRole::Participant) => vec![message.sender.clone()],
            None => Vec::new(),
        }
    }

    fn role(&self, token: &ReplyToken, sender: &AgentId) -> Option<ExchangeRole> {
        let (_, exchange) = self
            .exchanges
            .range((token.clone(), None)..)
            .next()
            .filter(|((found, _), _)| found == token)?;
        let is_initiator = exchange.initiator() == sender;
        Some(if is_initiator { ExchangeRole::Initiator } else { ExchangeRole::Participant })
    }

    /// Returns the exchange with the key `key`; `None` if its opening was not received. When a
    /// participant answers a broadcast, its exchange begins as a copy of the broadcast's opening.
    fn exchange(&mut self, key: &(ReplyToken, Option<AgentId>)) -> Option<&mut Exchange> {
        if !self.exchanges.contains_key(key) {
            let opening = self.exchanges.get(&(key.0.clone(), None))?.clone();
            self.exchanges.insert(key.clone(), opening);
        }
        self.exchanges.get_mut(key)
    }
}

#[cfg(test)]
mod tests {
    use acl::content::{Outcome, Report, value};
    use acl::{ConversationId, Incarnation, MessageId, Performative, SCHEMA_VERSION};

    use super::*;

    /// Returns the message that `line` describes: `a>b request` opens an exchange, `b>a agree`
    /// continues it, `b>a confirm+` is progress, and `a>* cfp` is a broadcast to all agents.
    fn message(id: &str, line: &str, protocol: Protocol) -> Message {
        let (who, act) = line.split_once(' ').expect("a test line has a space");
        let (sender, receiver) = who.split_once('>').expect("a test line has an arrow");
        let progress = act.ends_with('+');
        let performative: Performative = act.trim_end_matches('+').parse().expect("an act");
        let opens = matches!(
            performative,
            Performative::Request | Performative::Cfp | Performative::QueryRef
        );
        let outcome = if progress { Outcome::Progress } else { Outcome::Done };
        let name = |text| AgentId::new(text).expect("a name");
        let token = Some(ReplyToken::new("t"));
        Message {
            version: SCHEMA_VERSION,
            id: MessageId::new(id),
            performative,
            sender: name(sender),
            incarnation: Incarnation(1),
            receiver: receiver.split(',').filter(|to| *to != "*").map(name).collect(),
            content: value(&Report::new(outcome, "")),
            language: None,
            ontology: None,
            protocol: Some(protocol),
            conversation_id: ConversationId::new("c"),
            reply_with: token.clone().filter(|_| opens),
            in_reply_to: token.filter(|_| !opens),
            via: Vec::new(),
            reply_within: None,
            unknown: serde_json::Map::new(),
        }
    }

    /// Passes the messages of the lines to a transcript one by one. The first message that the
    /// protocol does not allow must have the index `out_of_order`; `None` if all are allowed.
    fn check(protocol: Protocol, lines: &[&str], out_of_order: Option<usize>) {
        let mut transcript = Transcript::new();
        let mut numbered = lines.iter().enumerate();
        let first = numbered.position(|(index, line)| {
            transcript.receive(&message(&index.to_string(), line, protocol)).is_err()
        });
        assert_eq!(first, out_of_order, "{lines:#?}");
    }

    #[test]
    fn an_action_is_agreed_to_then_confirmed() {
        let lines = ["e>s request", "s>e agree", "s>e confirm+", "s>e confirm+", "s>e confirm"];
        check(Protocol::Action, &lines, None);
        check(Protocol::Action, &["e>s request", "s>e confirm"], Some(1));
        check(Protocol::Action, &["e>s request", "s>e agree", "s>e refuse"], Some(2));
        check(Protocol::Action, &["e>s request", "s>e propose"], Some(1));
    }

    #[test]
    fn a_cancel_may_cross_an_agree() {
        check(Protocol::Action, &["e>s request", "e>s cancel", "s>e agree", "s>e confirm"], None);
        check(Protocol::Action, &["e>s request", "e>s cancel", "e>s cancel"], Some(2));
    }

    #[test]
    fn every_bidder_has_a_separate_exchange() {
        let lines = [
            "r>* cfp",
            "a>r agree",
            "b>r refuse",
            "c>r agree",
            "r>a accept-proposal",
            "r>c reject-proposal",
        ];
        check(Protocol::ContractNet, &lines, None);
        let together = ["r>* cfp", "a>r agree", "c>r agree", "r>a,c reject-proposal"];
        check(Protocol::ContractNet, &together, None);
        let some = ["r>* cfp", "a>r agree", "r>a,c reject-proposal"];
        check(Protocol::ContractNet, &some, Some(2));
        check(Protocol::ContractNet, &["r>* cfp", "a>r agree", "r>b accept-proposal"], Some(2));
        check(Protocol::ContractNet, &["r>* cfp", "r>a accept-proposal"], Some(1));
        check(Protocol::ContractNet, &["r>* cfp", "a>r agree", "a>r agree"], Some(2));
    }

    #[test]
    fn the_central_planner_proposes_and_gets_a_reply() {
        check(Protocol::Planning, &["r>p request", "p>r propose", "r>p accept-proposal"], None);
        check(Protocol::Planning, &["r>p request", "p>r agree"], Some(1));
    }

    #[test]
    fn a_cancelled_query_may_still_be_answered() {
        // The participant may send the second answer before it receives the cancel.
        let lines = ["a>* query-ref", "k>a inform", "a>* cancel", "l>a inform"];
        check(Protocol::Query, &lines, None);
        check(Protocol::Query, &["a>k query-ref", "a>k cancel"], None);
        check(Protocol::Query, &["a>k query-ref", "k>a cancel"], Some(1));
    }

    #[test]
    fn every_protocol_can_open_and_close() {
        for protocol in [
            Protocol::Goal,
            Protocol::Planning,
            Protocol::ContractNet,
            Protocol::Execution,
            Protocol::Action,
            Protocol::StateChange,
            Protocol::Query,
        ] {
            let of = |phase| {
                crate::PROTOCOLS
                    .iter()
                    .filter(move |turn| turn.protocol == protocol && turn.phase == phase)
            };
            assert_ne!(of(ExchangePhase::Opening).count(), 0, "{protocol:?}");
            assert_eq!(of(ExchangePhase::Closed).count(), 0, "{protocol:?}");
            assert!(
                crate::PROTOCOLS
                    .iter()
                    .any(|turn| turn.protocol == protocol && turn.next == ExchangePhase::Closed)
            );
        }
    }

    #[test]
    fn a_listener_may_come_late() {
        check(Protocol::Action, &["s>e confirm", "s>e agree"], None);
    }
}
