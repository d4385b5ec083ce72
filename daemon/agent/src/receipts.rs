//! Receipts this agent owes: sent together a little later, or never where an answer is faster.
//!
//! A receipt stops the sender's retries, and nothing waits for it otherwise. So it may come as
//! late as well before the first retry, and one message carries all that are owed to a sender.
//! What can only be said by who has heard a message says so too.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::{AgentId, Incarnation, Message, MessageId, Performative, Protocol, ReplyToken};
use bytes::Bytes;
use tokio::time::Instant;

/// Receipts that wait at most; one more sends them all.
const OWED_MAX: usize = 256;

/// The receipts that an agent owes to others.
#[derive(Debug)]
pub(crate) struct Receipts {
    owed: Vec<Owed>,
    /// How long the first of them may wait.
    delay: Duration,
    due: Option<Instant>,
}

#[derive(Debug)]
struct Owed {
    to: AgentId,
    /// Which life of it: another of that name does not know the message.
    life: Incarnation,
    message: MessageId,
    /// What says that the message was heard, before a receipt does.
    until: Option<Until>,
}

/// What replaces a receipt: it cannot be said by who has not heard the message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Until {
    /// The message opened this exchange: its answer.
    Answered(ReplyToken),
    /// The message is a proposal in this exchange: the word that it is accepted, or is not.
    Judged(ReplyToken),
}

impl Until {
    /// What replaces the receipt of a message, if anything does.
    pub(crate) fn of(message: &Message) -> Option<Until> {
        match (&message.in_reply_to, message.performative, message.protocol) {
            (None, ..) => message.reply_with.clone().map(Until::Answered),
            (Some(exchange), Performative::Agree, Some(Protocol::ContractNet))
            | (Some(exchange), Performative::Propose, _) => Some(Until::Judged(exchange.clone())),
            _ => None,
        }
    }

    /// Whether a turn with this performative, of who heard the message, replaces its receipt.
    ///
    /// Not that of a `cancel`: the answer may have crossed it.
    pub(crate) fn is_over(&self, exchange: &ReplyToken, performative: Performative) -> bool {
        match self {
            Until::Answered(opened) => opened == exchange,
            Until::Judged(proposed) => proposed == exchange && is_judgment(performative),
        }
    }
}

/// Whether this is said of a proposal only.
pub(crate) fn is_judgment(performative: Performative) -> bool {
    matches!(performative, Performative::AcceptProposal | Performative::RejectProposal)
}

impl Receipts {
    /// None owed. Senders retry after `retry_first`; a fifth of that leaves time for the way.
    pub(crate) fn new(retry_first: Duration) -> Receipts {
        Receipts { owed: Vec::new(), delay: retry_first / 5, due: None }
    }

    /// A message was heard.
    pub(crate) fn owe(
        &mut self,
        (to, life): (AgentId, Incarnation),
        message: MessageId,
        until: Option<Until>,
        now: Instant,
    ) {
        let latest = if self.owed.len() >= OWED_MAX { now } else { now + self.delay };
        self.due = Some(self.due.map_or(latest, |due| due.min(latest)));
        self.owed.push(Owed { to, life, message, until });
    }

    /// A turn of an exchange goes out, which replaces the receipts of what can only come before it.
    pub(crate) fn replied(&mut self, to: &AgentId, exchange: &ReplyToken, with: Performative) {
        let is_over = |until: &Until| until.is_over(exchange, with);
        self.owed.retain(|owed| owed.to != *to || !owed.until.as_ref().is_some_and(is_over));
        if self.owed.is_empty() {
            self.due = None;
        }
    }

    /// When they are to be sent.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.due
    }

    /// All that are owed, by whom they are owed to.
    pub(crate) fn take(&mut self) -> BTreeMap<(AgentId, Incarnation), Bytes> {
        self.due = None;
        let mut letters: BTreeMap<(AgentId, Incarnation), Vec<MessageId>> = BTreeMap::new();
        for Owed { to, life, message, .. } in self.owed.drain(..) {
            letters.entry((to, life)).or_default().push(message);
        }
        letters.into_iter().map(|(to, messages)| (to, write(&messages))).collect()
    }
}

/// The receipts of these messages, as they travel: a JSON list of their ids.
fn write(messages: &[MessageId]) -> Bytes {
    let ids: Vec<_> = messages.iter().map(MessageId::as_str).collect();
    serde_json::to_vec(&ids).map(Bytes::from).unwrap_or_default()
}

/// The messages that a letter of receipts names; of garbage, none.
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

    fn life(text: &str) -> (AgentId, Incarnation) {
        (name(text), Incarnation(1))
    }

    #[tokio::test(start_paused = true)]
    async fn they_wait_a_little_and_go_together() {
        let mut receipts = Receipts::new(RETRY);
        let now = Instant::now();
        assert_eq!(receipts.due(), None);
        for (to, message, later) in [("a", "1", 0), ("b", "2", 5), ("a", "3", 9)] {
            let then = now + Duration::from_millis(later);
            receipts.owe(life(to), MessageId::new(message), None, then);
        }
        assert_eq!(receipts.due(), Some(now + RETRY / 5));

        let letters = receipts.take();

        assert_eq!(read(&letters[&life("a")]), ["1", "3"].map(MessageId::new));
        assert_eq!(read(&letters[&life("b")]), ["2"].map(MessageId::new));
        assert_eq!((receipts.due(), receipts.take().len()), (None, 0));
    }

    #[tokio::test(start_paused = true)]
    async fn an_answer_replaces_the_receipt_of_what_it_answers_only() {
        let mut receipts = Receipts::new(RETRY);
        let (exchange, now) = (ReplyToken::new("e"), Instant::now());
        let opened = Some(Until::Answered(exchange.clone()));
        receipts.owe(life("a"), MessageId::new("request"), opened, now);
        receipts.owe(life("a"), MessageId::new("cancel"), None, now);
        receipts.replied(&name("b"), &exchange, Performative::Confirm);
        receipts.replied(&name("a"), &exchange, Performative::Confirm);
        assert_eq!(read(&receipts.take()[&life("a")]), [MessageId::new("cancel")]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_judgment_replaces_the_receipt_of_the_proposal_and_no_other_turn_does() {
        let mut receipts = Receipts::new(RETRY);
        let (exchange, now) = (ReplyToken::new("e"), Instant::now());
        let proposed = Some(Until::Judged(exchange.clone()));
        receipts.owe(life("a"), MessageId::new("proposal"), proposed, now);
        receipts.replied(&name("a"), &exchange, Performative::Cancel);
        receipts.replied(&name("a"), &ReplyToken::new("f"), Performative::AcceptProposal);
        assert!(receipts.due().is_some());
        receipts.replied(&name("a"), &exchange, Performative::RejectProposal);
        assert_eq!(receipts.due(), None);
    }

    #[tokio::test(start_paused = true)]
    async fn so_many_do_not_wait() {
        let mut receipts = Receipts::new(RETRY);
        let now = Instant::now();
        for _ in 0..=OWED_MAX {
            receipts.owe(life("a"), MessageId::new("m"), None, now);
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
