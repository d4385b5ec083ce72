//! An independent requester: one agent that requests any number of goals at once, by
//! docs/protocol.md alone, and records the answers to each.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use acl::content::{Achieve, Keep, Outcome, Refusal, Report, Request, value};
use acl::{
    AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Message, MessageId, Performative,
    Protocol, ReplyToken, SCHEMA_VERSION,
};
use substrate::{
    AgentAddress, Delivery, Destination, Inbound, Presence, PresenceToken, ReceivedQuery, Resource,
    ResourceQuery, Subject, Substrate as _,
};
use substrate_zenoh::{Config, SessionMode, ZenohSubstrate};
use tokio::sync::mpsc;

use super::Office;

/// Delay before a request without a receipt or an answer is sent again.
const RETRY: Duration = Duration::from_millis(200);

/// Answers to one goal.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    /// Whether a receipt has come, or an answer, which replaces it.
    pub(crate) receipt: bool,
    /// Text of the first progress report.
    pub(crate) accepted: Option<String>,
    /// Reason of the refusal.
    pub(crate) refused: Option<String>,
    /// Outcome and text of the final report.
    pub(crate) ended: Option<(Outcome, String)>,
    /// Time of the refusal or the end, since the requester began.
    pub(crate) over_after: Option<Duration>,
}

impl Heard {
    /// Whether no more answers are expected.
    pub(crate) fn is_over(&self) -> bool {
        self.refused.is_some() || self.ended.is_some()
    }
}

/// Receiving side of a requester, with the receipts that it must send.
struct Ears {
    began: Instant,
    heard: Mutex<BTreeMap<ConversationId, Heard>>,
    messages: Mutex<BTreeMap<MessageId, ConversationId>>,
    owed: mpsc::UnboundedSender<MessageId>,
}

/// An agent that requests goals, with its own record of the answers.
pub(crate) struct Asker {
    id: AgentId,
    ears: Arc<Ears>,
    substrate: Arc<ZenohSubstrate>,
    requester: AgentAddress,
    _token: PresenceToken,
}

impl Ears {
    fn heard(&self) -> MutexGuard<'_, BTreeMap<ConversationId, Heard>> {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn note(&self, message: &Message) {
        let mut heard = self.heard();
        let Some(goal) = heard.get_mut(&message.conversation_id) else { return };
        goal.receipt = true;
        let after = self.began.elapsed();
        if let Ok(report) = message.content_as::<Report>()
            && message.performative == Performative::Confirm
        {
            if !report.outcome.is_final() {
                goal.accepted.get_or_insert(report.detail);
            } else if goal.ended.is_none() {
                goal.ended = Some((report.outcome, report.detail));
                goal.over_after = Some(after);
            }
        } else if let Ok(refusal) = message.content_as::<Refusal>() {
            goal.refused.get_or_insert(refusal.detail);
            goal.over_after.get_or_insert(after);
        }
    }
}

impl Inbound for Ears {
    fn deliver(&self, delivery: Delivery) {
        match delivery.destination {
            Destination::To(_, Subject::Receipt) => {
                let ids: Vec<MessageId> =
                    serde_json::from_slice(&delivery.payload).unwrap_or_default();
                let messages = self.messages.lock().unwrap_or_else(PoisonError::into_inner);
                let mut heard = self.heard();
                for goal in ids.iter().filter_map(|id| messages.get(id)) {
                    if let Some(goal) = heard.get_mut(goal) {
                        goal.receipt = true;
                    }
                }
            }
            Destination::To(_, Subject::Message(_)) => {
                let message = acl::decode(&delivery.payload).expect("an agent's words");
                self.note(&message);
                // The receipt is sent from another task, not from within Zenoh's callback.
                let _ = self.owed.send(message.id);
            }
            Destination::All(..) | Destination::AgentState(_) => (),
        }
    }

    fn presence(&self, _presence: Presence) {}

    fn receive_query(&self, _question: ReceivedQuery) {}
}

impl Asker {
    /// Joins the ecosystem through the office's daemon `reasoning`.
    pub(crate) async fn join(office: &Office, name: &str) -> Asker {
        let ecosystem = EcosystemId::new("smart-office").expect("a name");
        let mut config = Config::new(ecosystem, DaemonId::new(name).expect("a name"));
        config.mode = SessionMode::Client;
        let socket = office.runtime_folder().join("smart-office/reasoning.sock");
        config.connect = vec![format!("unixsock-stream/{}", socket.display())];
        let (owed, mut owes) = mpsc::unbounded_channel();
        let ears = Arc::new(Ears {
            began: Instant::now(),
            heard: Mutex::default(),
            messages: Mutex::default(),
            owed,
        });
        let inbound: Arc<dyn Inbound> = ears.clone();
        let substrate = config.open(inbound).await.expect("the ecosystem runs");
        let id = AgentId::new(name).expect("a name");
        let _token = substrate.announce(&id, Incarnation(1)).expect("it is open");
        let requester = AgentAddress {
            daemon: DaemonId::new("reasoning").expect("a name"),
            agent: AgentId::new("plan-requester").expect("a name"),
        };
        let (sender, to) = (Arc::clone(&substrate), requester.clone());
        tokio::spawn(async move {
            let mut ids = Vec::new();
            while owes.recv_many(&mut ids, 256).await > 0 {
                let receipts = serde_json::to_vec(&ids).expect("names");
                let _ = sender.send(&to, Subject::Receipt, receipts.into());
                ids.clear();
            }
        });
        Asker { id, ears, substrate, requester, _token }
    }

    /// Announces another agent of this requester's daemon, until the token is dropped.
    pub(crate) fn announce(&self, name: &str) -> PresenceToken {
        let id = AgentId::new(name).expect("a name");
        self.substrate.announce(&id, Incarnation(1)).expect("it is open")
    }

    /// Requests these goals at once, and waits until all are over or `patience` has passed.
    pub(crate) async fn ask(
        &self,
        goals: impl IntoIterator<Item = String>,
        patience: Duration,
    ) -> BTreeMap<ConversationId, Heard> {
        let mut asked = BTreeMap::new();
        for (number, goal) in goals.into_iter().enumerate() {
            let message = self.request(number, goal);
            let conversation = message.conversation_id.clone();
            let mut messages = self.ears.messages.lock().unwrap_or_else(PoisonError::into_inner);
            messages.insert(message.id.clone(), conversation.clone());
            drop(messages);
            self.ears.heard().insert(conversation.clone(), Heard::default());
            asked.insert(conversation, message);
        }
        let deadline = Instant::now() + patience;
        loop {
            let heard = self.ears.heard().clone();
            let waits = |id: &ConversationId| !heard[id].is_over();
            if Instant::now() >= deadline || !asked.keys().any(waits) {
                return heard;
            }
            for (_, message) in asked.iter().filter(|(id, _)| !heard[*id].receipt) {
                let payload = acl::encode(message);
                let subject = Subject::Message(Performative::Request);
                self.substrate.send(&self.requester, subject, payload).expect("it is open");
            }
            tokio::time::sleep(RETRY).await;
        }
    }

    fn request(&self, number: usize, goal: String) -> Message {
        let asked = Achieve::new(&goal, Keep::Achieve, 0);
        let id = format!("{}.1.{number}", self.id);
        Message {
            version: SCHEMA_VERSION,
            id: MessageId::new(&id),
            performative: Performative::Request,
            sender: self.id.clone(),
            incarnation: Incarnation(1),
            receiver: vec![self.requester.agent.clone()],
            content: value(&Request::Achieve(asked)),
            language: None,
            ontology: None,
            protocol: Some(Protocol::Goal),
            conversation_id: ConversationId::new(&format!("goal-{number}-of-{}", self.id)),
            reply_with: Some(ReplyToken::new(&id)),
            in_reply_to: None,
            reply_within: None,
            via: Vec::new(),
            unknown: serde_json::Map::new(),
        }
    }

    /// Queries the ecosystem's daemons for a resource.
    pub(crate) async fn question(&self, resource: Resource) -> Vec<serde_json::Value> {
        let ask = ResourceQuery { daemon: None, resource, agent: None };
        let answers = self.substrate.ask(ask, Duration::from_secs(10)).await;
        answers.iter().map(|answer| serde_json::from_slice(answer).expect("JSON")).collect()
    }
}
