//! Outbox of an agent: the messages that have no receipt yet. A message is retried until its
//! receipt comes, and parked while its receiver is away.
//!
//! Parked messages are the paper's “queue operations on agent death/activation”. A message to an
//! agent that is not present yet waits until the agent joins. A message to an agent that has left
//! waits for the length of the grace, and is then reported as undelivered.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, MessageId, Performative, ReplyToken};
use bytes::Bytes;
use substrate::Resident;
use tokio::time::Instant;

use crate::directory::Directory;
use crate::exchange::DeliveryError;
use crate::receipts;
use crate::retry_backoff::RetryBackoff;
use crate::settings::AgentSettings;

/// A message that was given to the outbox and has no receipt yet.
#[derive(Clone, Debug)]
pub(crate) struct OutboundMessage {
    pub(crate) to: AgentId,
    /// Incarnation of the receiver that the message is for; `None` if the message is for the oldest
    /// present agent of the name, in any incarnation.
    pub(crate) incarnation: Option<Incarnation>,
    pub(crate) performative: Performative,
    pub(crate) exchange: Option<ReplyToken>,
    /// Whether the message opens the exchange in `exchange`.
    pub(crate) opens: bool,
    pub(crate) payload: Bytes,
    /// Time after which delivery of the message is given up.
    pub(crate) give_up: Instant,
}

#[derive(Debug)]
struct PendingDelivery {
    /// Running number of the message; messages that are due at the same time are sent in the order
    /// of these numbers.
    number: u64,
    parcel: OutboundMessage,
    state: SendState,
}

#[derive(Debug)]
enum SendState {
    /// The message was sent to the `incarnation` of the receiver; without a receipt it is sent
    /// again at the time `again`.
    Sent { incarnation: ReceiverIncarnation, again: Instant, backoff: RetryBackoff },
    /// The receiver is not present, and is awaited until the time `until`. `incarnation` is that of
    /// the receiver that was present before, if any.
    Parked { incarnation: Option<ReceiverIncarnation>, until: Instant },
}

/// One incarnation of a receiver, with the daemon that hosts it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ReceiverIncarnation {
    daemon: DaemonId,
    incarnation: Incarnation,
}

impl From<&Resident> for ReceiverIncarnation {
    fn from(Resident { daemon, incarnation, .. }: &Resident) -> ReceiverIncarnation {
        ReceiverIncarnation { daemon: daemon.clone(), incarnation: *incarnation }
    }
}

/// Action on a message that is due now.
#[derive(Debug)]
pub(crate) enum DueAction {
    /// Send this message.
    Send(OutboundMessage),
    /// Report that this message could not be delivered.
    GiveUp(MessageId, OutboundMessage, DeliveryError),
}

/// Messages of one agent that have no receipt yet.
#[derive(Debug)]
pub(crate) struct Outbox {
    parcels: BTreeMap<MessageId, PendingDelivery>,
    parcels_max: usize,
    /// The waits of a message that was not repeated yet.
    backoff: RetryBackoff,
    grace: Duration,
    lease: Duration,
    numbered: u64,
}

impl Outbox {
    pub(crate) fn new(settings: &AgentSettings) -> Outbox {
        Outbox {
            parcels: BTreeMap::new(),
            parcels_max: settings.outbox_messages_max,
            backoff: settings.retry_backoff(),
            grace: settings.grace,
            lease: settings.heartbeat_lease,
            numbered: 0,
        }
    }

    /// Adds a message to the outbox. `incarnation` is that of the present receiver; `None` if the
    /// receiver is not present. Returns `false` if the outbox is full.
    pub(crate) fn put(
        &mut self,
        id: MessageId,
        parcel: OutboundMessage,
        incarnation: Option<ReceiverIncarnation>,
        now: Instant,
    ) -> bool {
        if self.parcels.len() >= self.parcels_max {
            return false;
        }
        let state = match incarnation {
            Some(incarnation) => SendState::sent(incarnation, self.backoff, now),
            // The message is for the incarnation that asked. The presence of that incarnation may
            // not be known here yet; if it is not present after a lease, it is gone. Another
            // incarnation may hold the name by now, and the asking one may return.
            None if parcel.incarnation.is_some() => {
                SendState::Parked { incarnation: None, until: parcel.give_up.min(now + self.lease) }
            }
            None => SendState::Parked { incarnation: None, until: parcel.give_up },
        };
        self.numbered += 1;
        self.parcels.insert(id, PendingDelivery { number: self.numbered, parcel, state });
        true
    }

    /// Whether the outbox has room for the messages of a new exchange. Half of the outbox is
    /// reserved for exchanges that have begun already.
    pub(crate) fn has_room(&self) -> bool {
        self.parcels.len() < self.parcels_max.div_ceil(2)
    }

    /// Removes a message for which the receipt has come.
    pub(crate) fn received(&mut self, id: &MessageId) {
        self.parcels.remove(id);
    }

    /// Removes the messages to `by` that need no receipt any more, because `by` has sent the turn
    /// `with` of the exchange, which can only follow them. Any answer replaces the receipt of the
    /// message that opened the exchange; `accept-proposal` and `reject-proposal` replace the
    /// receipt of the proposal. The receipt of a `cancel` is never replaced, because the turn may
    /// have been sent before the `cancel` arrived.
    pub(crate) fn replied(&mut self, exchange: &ReplyToken, by: &AgentId, with: Performative) {
        let is_before = |parcel: &OutboundMessage| {
            let proposes =
                matches!(parcel.performative, Performative::Agree | Performative::Propose);
            parcel.opens || (proposes && receipts::is_judgment(with))
        };
        self.parcels.retain(|_, PendingDelivery { parcel, .. }| {
            !is_before(parcel) || parcel.exchange.as_ref() != Some(exchange) || parcel.to != *by
        });
    }

    /// Removes the messages of an exchange that is over for this agent, so that they are not
    /// retried.
    pub(crate) fn forget(&mut self, exchange: &ReplyToken) {
        self.parcels.retain(|_, under_way| under_way.parcel.exchange.as_ref() != Some(exchange));
    }

    /// Updates the messages to a receiver after an incarnation of it was seen to be present.
    /// Returns the actions that are due on these messages:
    ///
    /// - The incarnation is the same as before, or the first one: the message is sent.
    /// - The incarnation is a new one on the same daemon. It has no record of earlier exchanges, so
    ///   the message is given up.
    /// - The incarnation is one on another daemon, and is the leader now. A message that opens an
    ///   exchange is sent to the new leader, which has not received it. A message that is for one
    ///   incarnation only waits for that incarnation. Any other message is given up.
    pub(crate) fn joined(&mut self, resident: &Resident, now: Instant) -> Vec<DueAction> {
        let (agent, incarnation) = (&resident.agent, ReceiverIncarnation::from(resident));
        let mut due = Vec::new();
        let backoff = self.backoff;
        self.parcels.retain(|id, under_way| {
            if under_way.parcel.to != *agent {
                return true;
            }
            let before = match &under_way.state {
                SendState::Sent { incarnation, .. } => Some(incarnation),
                SendState::Parked { incarnation, .. } => incarnation.as_ref(),
            };
            let is_another = before.is_some_and(|before| *before != incarnation)
                || under_way
                    .parcel
                    .incarnation
                    .is_some_and(|bound| bound != incarnation.incarnation);
            let took_over = before.is_none_or(|before| before.daemon != incarnation.daemon);
            if under_way.parcel.incarnation.is_some() && is_another && took_over {
                // The message is for an incarnation that is a standby now, or has left and may
                // return.
                return true;
            }
            if is_another && !(took_over && under_way.parcel.opens) {
                let parcel = under_way.parcel.clone();
                due.push((
                    under_way.number,
                    DueAction::GiveUp(id.clone(), parcel, DeliveryError::Restarted),
                ));
                return false;
            }
            let incarnation = incarnation.clone();
            under_way.state = SendState::sent(incarnation, backoff, now);
            due.push((under_way.number, DueAction::Send(under_way.parcel.clone())));
            true
        });
        as_said(due)
    }

    /// Parks the messages to an agent that has left, until the agent returns or the grace has
    /// passed. A message for one incarnation stays under way while that incarnation is present.
    pub(crate) fn left(&mut self, agent: &AgentId, directory: &Directory, now: Instant) {
        for under_way in self.parcels.values_mut().filter(|other| other.parcel.to == *agent) {
            let bound = under_way.parcel.incarnation;
            if bound
                .is_some_and(|incarnation| directory.find_incarnation(agent, incarnation).is_some())
            {
                continue;
            }
            if let SendState::Sent { incarnation, .. } = &under_way.state {
                let until = under_way.parcel.give_up.min(now + self.grace);
                under_way.state =
                    SendState::Parked { incarnation: Some(incarnation.clone()), until };
            }
        }
    }

    /// Whether the outbox is empty: no message waits for a receipt.
    pub(crate) fn is_empty(&self) -> bool {
        self.parcels.is_empty()
    }

    /// Returns the time at which the next action is due; `None` if no message waits.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.parcels.values().map(PendingDelivery::due).min()
    }

    /// Returns the actions that are due by `now`.
    pub(crate) fn due(&mut self, directory: &Directory, now: Instant) -> Vec<DueAction> {
        let mut due = Vec::new();
        let first_backoff = self.backoff;
        self.parcels.retain(|id, under_way| {
            if under_way.due() > now {
                return true;
            }
            let (parcel, number) = (&under_way.parcel, under_way.number);
            match &mut under_way.state {
                SendState::Sent { again, backoff, .. } if parcel.give_up > now => {
                    *again = now + backoff.next_wait();
                    due.push((number, DueAction::Send(parcel.clone())));
                    return true;
                }
                SendState::Sent { .. } => {
                    let why = DeliveryError::NoReceipt;
                    due.push((number, DueAction::GiveUp(id.clone(), parcel.clone(), why)));
                }
                // The presence of an incarnation that does not hold the name is not reported as a
                // change.
                SendState::Parked { .. }
                    if parcel.give_up > now
                        && let Some(incarnation) = parcel.its_incarnation(directory) =>
                {
                    due.push((number, DueAction::Send(parcel.clone())));
                    under_way.state = SendState::sent(incarnation, first_backoff, now);
                    return true;
                }
                SendState::Parked { incarnation, .. } => {
                    let why = if incarnation.is_some() {
                        DeliveryError::Left
                    } else {
                        DeliveryError::NotHere
                    };
                    due.push((number, DueAction::GiveUp(id.clone(), parcel.clone(), why)));
                }
            }
            false
        });
        as_said(due)
    }
}

/// Sorts the actions that are due by the order in which their messages were added, and drops the
/// numbers.
fn as_said(mut due: Vec<(u64, DueAction)>) -> Vec<DueAction> {
    due.sort_by_key(|(number, _)| *number);
    due.into_iter().map(|(_, due)| due).collect()
}

impl OutboundMessage {
    /// Returns the receiver of the message if it is present: the incarnation that the message is
    /// for, or the oldest present agent of the name if the message is for any incarnation.
    pub(crate) fn receiver<'d>(&self, directory: &'d Directory) -> Option<&'d Resident> {
        match self.incarnation {
            Some(incarnation) => directory.find_incarnation(&self.to, incarnation),
            None => directory.find(&self.to),
        }
    }
}

impl OutboundMessage {
    /// Returns the one incarnation that the message is for. `None` if that incarnation is not
    /// present, or if the message is for any incarnation.
    fn its_incarnation(&self, directory: &Directory) -> Option<ReceiverIncarnation> {
        directory.find_incarnation(&self.to, self.incarnation?).map(ReceiverIncarnation::from)
    }
}

impl SendState {
    /// Returns the state of a message that is sent now for the first time.
    fn sent(
        incarnation: ReceiverIncarnation,
        mut backoff: RetryBackoff,
        now: Instant,
    ) -> SendState {
        let again = now + backoff.next_wait();
        SendState::Sent { incarnation, again, backoff }
    }
}

impl PendingDelivery {
    fn due(&self) -> Instant {
        match &self.state {
            SendState::Sent { again, .. } => (*again).min(self.parcel.give_up),
            SendState::Parked { until, .. } => *until,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_secs(60);

    fn robot() -> AgentId {
        AgentId::new("robot").expect("a name")
    }

    fn resident(daemon: &str, incarnation: u64) -> Resident {
        let daemon = DaemonId::new(daemon).expect("a name");
        Resident { agent: robot(), daemon, incarnation: Incarnation(incarnation) }
    }

    fn parcel(give_up: Instant) -> OutboundMessage {
        OutboundMessage {
            to: robot(),
            incarnation: None,
            performative: Performative::Request,
            exchange: Some(ReplyToken::new("t")),
            opens: true,
            payload: Bytes::from_static(b"act"),
            give_up,
        }
    }

    /// Returns an outbox with one message to `robot`. The robot is present in `incarnation`, or
    /// absent if that is `None`.
    fn outbox(incarnation: Option<u64>, now: Instant) -> Outbox {
        let mut outbox = Outbox::new(&AgentSettings::default());
        let parcel = parcel(now + Duration::from_secs(60));
        let incarnation =
            incarnation.map(|incarnation| ReceiverIncarnation::from(&resident("a", incarnation)));
        assert!(outbox.put(MessageId::new("m"), parcel, incarnation, now));
        outbox
    }

    fn nobody() -> Directory {
        Directory::default()
    }

    fn words(due: &[DueAction]) -> Vec<String> {
        due.iter()
            .map(|due| match due {
                DueAction::Send(_) => "send".to_owned(),
                DueAction::GiveUp(_, _, why) => format!("{why:?}"),
            })
            .collect()
    }

    #[tokio::test(start_paused = true)]
    async fn retries_back_off_and_end_with_the_receipt() {
        let start = Instant::now();
        let mut outbox = outbox(Some(1), start);
        let mut waits = Vec::new();
        for _ in 0..6 {
            let next = outbox.next_due().expect("under way");
            assert_eq!(words(&outbox.due(&nobody(), next)), ["send"]);
            waits.push((next - start).as_millis());
        }
        assert_eq!(waits, [80, 160, 240, 400, 720, 1360]);
        outbox.received(&MessageId::new("m"));
        assert_eq!(outbox.next_due(), None);
    }

    #[tokio::test(start_paused = true)]
    async fn a_judgment_is_a_receipt_for_the_proposal() {
        let now = Instant::now();
        let mut outbox = Outbox::new(&AgentSettings::default());
        let proposal = OutboundMessage {
            performative: Performative::Agree,
            opens: false,
            ..parcel(now + PATIENCE)
        };
        let incarnation = Some(ReceiverIncarnation::from(&resident("a", 1)));
        assert!(outbox.put(MessageId::new("m"), proposal, incarnation, now));
        let exchange = ReplyToken::new("t");
        outbox.replied(&exchange, &robot(), Performative::Cancel);
        assert!(outbox.next_due().is_some(), "it may have crossed");
        outbox.replied(&exchange, &robot(), Performative::AcceptProposal);
        assert_eq!(outbox.next_due(), None);
    }

    #[tokio::test(start_paused = true)]
    async fn a_message_waits_until_its_receiver_joins() {
        let now = Instant::now();
        let mut outbox = outbox(None, now);
        assert_eq!(words(&outbox.due(&nobody(), now + Duration::from_secs(1))), [""; 0]);
        assert_eq!(words(&outbox.joined(&resident("a", 1), now)), ["send"]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_short_absence_is_tolerated_and_a_long_one_is_not() {
        let now = Instant::now();
        let mut outbox = outbox(Some(1), now);
        outbox.left(&robot(), &nobody(), now);
        assert_eq!(words(&outbox.joined(&resident("a", 1), now)), ["send"], "a blink");
        outbox.left(&robot(), &nobody(), now);
        assert_eq!(words(&outbox.due(&nobody(), now + Duration::from_millis(499))), [""; 0]);
        assert_eq!(words(&outbox.due(&nobody(), now + Duration::from_millis(500))), ["Left"]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_message_is_given_up_when_its_receiver_restarts() {
        let now = Instant::now();
        let mut outbox = outbox(Some(1), now);
        assert_eq!(words(&outbox.joined(&resident("a", 2), now)), ["Restarted"]);
        assert_eq!(outbox.next_due(), None);
    }

    /// Two replicas open exchanges; the one at `a` has asked, and is then cut off.
    #[tokio::test(start_paused = true)]
    async fn an_answer_goes_to_the_incarnation_that_asked_and_not_to_a_new_leader() {
        let now = Instant::now();
        let mut outbox = Outbox::new(&AgentSettings::default());
        let (asker, other) = (resident("a", 1), resident("b", 2));
        let answer = OutboundMessage {
            opens: false,
            incarnation: Some(asker.incarnation),
            ..parcel(now + PATIENCE)
        };
        outbox.put(MessageId::new("m"), answer, Some(ReceiverIncarnation::from(&asker)), now);

        outbox.left(&robot(), &nobody(), now);
        assert_eq!(words(&outbox.joined(&other, now)), [""; 0]);
        assert_eq!(words(&outbox.joined(&asker, now)), ["send"], "it is back");

        outbox.left(&robot(), &nobody(), now);
        outbox.joined(&other, now);
        let mut directory = Directory::default();
        for who in [other, asker] {
            directory.update(&substrate::Presence::Joined(who));
        }
        let later = now + Duration::from_millis(500);
        assert_eq!(words(&outbox.due(&directory, later)), ["send"], "it is back and stands by");
        outbox.left(&robot(), &nobody(), later);
        assert_eq!(words(&outbox.joined(&resident("a", 3), later)), ["Restarted"]);
    }

    /// The presence token of a guest may arrive after its requests.
    #[tokio::test(start_paused = true)]
    async fn answers_wait_for_the_presence_of_the_asker_and_keep_their_order() {
        let now = Instant::now();
        let mut outbox = Outbox::new(&AgentSettings::default());
        let asker = resident("a", 1);
        for number in 8..=11 {
            let payload = Bytes::from(format!("{number}"));
            let incarnation = Some(asker.incarnation);
            let answer =
                OutboundMessage { opens: false, incarnation, payload, ..parcel(now + PATIENCE) };
            assert!(outbox.put(MessageId::new(&format!("m.{number}")), answer, None, now));
        }
        let later = now + Duration::from_millis(3_499);
        assert_eq!(words(&outbox.due(&nobody(), later)), [""; 0]);
        let sent = outbox.joined(&asker, later).into_iter().map(|due| match due {
            DueAction::Send(parcel) => parcel.payload,
            DueAction::GiveUp(..) => Bytes::new(),
        });
        assert_eq!(sent.collect::<Vec<_>>(), ["8", "9", "10", "11"]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_request_is_sent_to_the_replica_that_takes_over() {
        let now = Instant::now();
        let mut outbox = outbox(Some(1), now);
        assert_eq!(words(&outbox.joined(&resident("b", 2), now)), ["send"]);
        outbox.left(&robot(), &nobody(), now);
        assert_eq!(words(&outbox.joined(&resident("b", 3), now)), ["Restarted"]);
    }
}
