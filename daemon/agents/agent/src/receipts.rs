//! Receipts that an agent owes to the senders of messages. The receipts are sent together a little
//! later, or not at all if an answer is sent first.
//!
//! A receipt stops the sender's retries and has no other effect. So a receipt may be sent shortly
//! before the first retry, and one message carries all receipts for one sender. A turn that can
//! only follow a message counts as the receipt of that message.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::{AgentId, Incarnation, Message, MessageId, Performative, Protocol, ReplyToken};
use bytes::Bytes;
use tokio::time::Instant;

/// Maximum number of owed receipts that wait to be sent together. One more causes all of them to be
/// sent.
const OWED_MAX: usize = 256;

/// Receipts that an agent owes to others.
#[derive(Debug)]
pub(crate) struct Receipts {
    owed: Vec<OwedReceipt>,
    /// Longest time that the first of the owed receipts waits for others; then all are sent.
    delay: Duration,
    due: Option<Instant>,
}

#[derive(Debug)]
struct OwedReceipt {
    to: AgentId,
    /// Incarnation of the agent that sent the message. The receipt is for this incarnation only,
    /// because another one has not sent the message.
    incarnation: Incarnation,
    message: MessageId,
    /// Answer that replaces the receipt, if the answer is sent before the receipt.
    until: Option<ImplicitReceipt>,
}

/// Answer that replaces the receipt of a message, because only an agent that has received the
/// message can send the answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ImplicitReceipt {
    /// The message opened this exchange; any answer in the exchange replaces the receipt.
    Answered(ReplyToken),
    /// The message is a proposal in this exchange; its acceptance or rejection replaces the
    /// receipt.
    Judged(ReplyToken),
}

impl ImplicitReceipt {
    /// Returns the answer that replaces the receipt of a message; `None` if no answer does.
    pub(crate) fn of(message: &Message) -> Option<ImplicitReceipt> {
        match (&message.in_reply_to, message.performative, message.protocol) {
            (None, ..) => message.reply_with.clone().map(ImplicitReceipt::Answered),
            (Some(exchange), Performative::Agree, Some(Protocol::ContractNet))
            | (Some(exchange), Performative::Propose, _) => {
                Some(ImplicitReceipt::Judged(exchange.clone()))
            }
            _ => None,
        }
    }

    /// Whether a turn in `exchange` with this performative, sent by the receiver of the message,
    /// replaces the receipt of the message.
    ///
    /// The receipt of a `cancel` is never replaced: the answer may have been sent before the
    /// `cancel` arrived.
    pub(crate) fn is_over(&self, exchange: &ReplyToken, performative: Performative) -> bool {
        match self {
            ImplicitReceipt::Answered(opened) => opened == exchange,
            ImplicitReceipt::Judged(proposed) => proposed == exchange && is_judgment(performative),
        }
    }
}

/// Whether this performative accepts or rejects a proposal.
pub(crate) fn is_judgment(performative: Performative) -> bool {
    matches!(performative, Performative::AcceptProposal | Performative::RejectProposal)
}

impl Receipts {
    /// Creates an empty list of owed receipts. Senders retry after `retry_first`. Receipts wait for
    /// a fifth of that time, which leaves time for their transport.
    pub(crate) fn new(retry_first: Duration) -> Receipts {
        Receipts { owed: Vec::new(), delay: retry_first / 5, due: None }
    }

    /// Records that this agent owes the receipt of a message, which may be sent until the delay has
    /// passed.
    pub(crate) fn owe(
        &mut self,
        (to, incarnation): (AgentId, Incarnation),
        message: MessageId,
        until: Option<ImplicitReceipt>,
        now: Instant,
    ) {
        let latest = if self.owed.len() >= OWED_MAX { now } else { now + self.delay };
        self.due = Some(self.due.map_or(latest, |due| due.min(latest)));
        self.owed.push(OwedReceipt { to, incarnation, message, until });
    }

    /// Removes the owed receipts that an outgoing turn of an exchange replaces.
    pub(crate) fn replied(&mut self, to: &AgentId, exchange: &ReplyToken, with: Performative) {
        let is_over = |until: &ImplicitReceipt| until.is_over(exchange, with);
        self.owed.retain(|owed| owed.to != *to || !owed.until.as_ref().is_some_and(is_over));
        if self.owed.is_empty() {
            self.due = None;
        }
    }

    /// Returns the time at which the owed receipts are to be sent; `None` if no receipt is owed.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.due
    }

    /// Removes all owed receipts and returns them encoded: one payload for each receiver, by the
    /// agent's name and incarnation.
    pub(crate) fn take(&mut self) -> BTreeMap<(AgentId, Incarnation), Bytes> {
        self.due = None;
        let mut letters: BTreeMap<(AgentId, Incarnation), Vec<MessageId>> = BTreeMap::new();
        for OwedReceipt { to, incarnation, message, .. } in self.owed.drain(..) {
            letters.entry((to, incarnation)).or_default().push(message);
        }
        letters.into_iter().map(|(to, messages)| (to, write(&messages))).collect()
    }
}

/// Encodes receipts for sending, as a JSON list of message ids.
fn write(messages: &[MessageId]) -> Bytes {
    let ids: Vec<_> = messages.iter().map(MessageId::as_str).collect();
    serde_json::to_vec(&ids).map(Bytes::from).unwrap_or_default()
}

/// Decodes receipts; returns an empty list if the payload cannot be read.
pub(crate) fn read(payload: &[u8]) -> Vec<MessageId> {
    let ids: Vec<String> = serde_json::from_slice(payload).unwrap_or_default();
    ids.iter().map(|id| MessageId::new(id)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RETRY: Duration = Duration::from_millis(100);

    fn name(text: &str) -> AgentId {
        AgentId::new(text).expect("a name")
    }

    fn incarnation(text: &str) -> (AgentId, Incarnation) {
        (name(text), Incarnation(1))
    }

    #[tokio::test(start_paused = true)]
    async fn receipts_wait_a_little_and_are_sent_together() {
        let mut receipts = Receipts::new(RETRY);
        let now = Instant::now();
        assert_eq!(receipts.due(), None);
        for (to, message, later) in [("a", "1", 0), ("b", "2", 5), ("a", "3", 9)] {
            let then = now + Duration::from_millis(later);
            receipts.owe(incarnation(to), MessageId::new(message), None, then);
        }
        assert_eq!(receipts.due(), Some(now + RETRY / 5));

        let letters = receipts.take();

        assert_eq!(read(&letters[&incarnation("a")]), ["1", "3"].map(MessageId::new));
        assert_eq!(read(&letters[&incarnation("b")]), ["2"].map(MessageId::new));
        assert_eq!((receipts.due(), receipts.take().len()), (None, 0));
    }

    #[tokio::test(start_paused = true)]
    async fn an_answer_replaces_the_receipt_of_what_it_answers_only() {
        let mut receipts = Receipts::new(RETRY);
        let (exchange, now) = (ReplyToken::new("e"), Instant::now());
        let opened = Some(ImplicitReceipt::Answered(exchange.clone()));
        receipts.owe(incarnation("a"), MessageId::new("request"), opened, now);
        receipts.owe(incarnation("a"), MessageId::new("cancel"), None, now);
        receipts.replied(&name("b"), &exchange, Performative::Confirm);
        receipts.replied(&name("a"), &exchange, Performative::Confirm);
        assert_eq!(read(&receipts.take()[&incarnation("a")]), [MessageId::new("cancel")]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_judgment_replaces_the_receipt_of_the_proposal_and_no_other_turn_does() {
        let mut receipts = Receipts::new(RETRY);
        let (exchange, now) = (ReplyToken::new("e"), Instant::now());
        let proposed = Some(ImplicitReceipt::Judged(exchange.clone()));
        receipts.owe(incarnation("a"), MessageId::new("proposal"), proposed, now);
        receipts.replied(&name("a"), &exchange, Performative::Cancel);
        receipts.replied(&name("a"), &ReplyToken::new("f"), Performative::AcceptProposal);
        assert!(receipts.due().is_some());
        receipts.replied(&name("a"), &exchange, Performative::RejectProposal);
        assert_eq!(receipts.due(), None);
    }

    #[tokio::test(start_paused = true)]
    async fn too_many_receipts_are_sent_at_once() {
        let mut receipts = Receipts::new(RETRY);
        let now = Instant::now();
        for _ in 0..=OWED_MAX {
            receipts.owe(incarnation("a"), MessageId::new("m"), None, now);
        }
        assert_eq!(receipts.due(), Some(now));
    }

    #[test]
    fn garbage_is_no_receipt() {
        for garbage in ["", "m1", "{}", "[1]", "[\"a\""] {
            assert_eq!(read(garbage.as_bytes()), [], "{garbage}");
        }
    }
}
