//! Authorization of incoming messages, by the [`Rights`] in the ecosystem file and by presence.
//!
//! The substrate has verified which daemon sent a message; this module checks for which
//! agents that daemon may send. Messages of a daemon to itself are not checked.

use std::sync::{Arc, OnceLock};

use acl::content::{Inform, Request};
use acl::{AgentId, DaemonId, Incarnation, Message, Performative, Protocol};
use bytes::Bytes;
use substrate::{Answer, Origin, Presence, Rejected, Resident, Resource, ViolationKind};

use crate::broadcast_cache::{MODEL_BYTES_MAX, inform_of};
use crate::directory::Directory;
use crate::rejections::Rejections;
use crate::rights::Rights;

/// Reason why a daemon may not send a message.
#[derive(Debug)]
pub(crate) struct AuthorizationError {
    violation: ViolationKind,
    detail: String,
}

fn unauthorized(detail: String) -> AuthorizationError {
    AuthorizationError { violation: ViolationKind::Unauthorized, detail }
}

fn is_at(holder: &Resident) -> AuthorizationError {
    let detail = format!("names the sender `{}`, which is at `{}`", holder.agent, holder.daemon);
    AuthorizationError { violation: ViolationKind::Forged, detail }
}

/// Checks the messages, answers and presence tokens that arrive at one daemon against the rights of
/// the ecosystem and the membership.
pub(crate) struct Authorizer {
    daemon: DaemonId,
    /// Rights of the ecosystem; unset if the ecosystem limits no rights.
    rights: OnceLock<Arc<Rights>>,
    rejections: Arc<Rejections>,
}

/// A message that its origin may not send.
#[derive(Debug)]
pub(crate) struct ForbiddenMessage {
    pub(crate) message: Box<Message>,
    /// Daemon that sent the message.
    pub(crate) origin: DaemonId,
    /// Reason why the message is not allowed, as text for the sender.
    pub(crate) detail: String,
}

impl Authorizer {
    /// Creates the authorizer of `daemon`, without rights. Every message is allowed until the
    /// rights are set.
    pub(crate) fn new(daemon: DaemonId, rejections: Arc<Rejections>) -> Authorizer {
        Authorizer { daemon, rights: OnceLock::new(), rejections }
    }

    /// Sets the rights of the ecosystem. Only the first call has an effect.
    pub(crate) fn set_rights(&self, rights: Rights) {
        // Rights do not change while a daemon runs.
        let _ = self.rights.set(Arc::new(rights));
    }

    /// Whether an agent may read what happened to facts that their agents declare private. Without
    /// rights no agent may, because the senders of messages are not verified then.
    pub(crate) fn may_read_private(&self, agent: &AgentId) -> bool {
        self.rights.get().is_some_and(|rights| rights.may_read_private(agent))
    }

    /// Returns the rights, and the origin that must be checked against them. Returns `None` if
    /// there is nothing to check: the origin is this daemon, or messages are not signed, or no
    /// rights are set.
    fn limits<'s, 'o>(&'s self, origin: Option<&'o Origin>) -> Option<(&'s Rights, &'o Origin)> {
        let origin = origin.filter(|origin| origin.daemon != self.daemon)?;
        Some((self.rights.get()?, origin))
    }

    /// Checks whether a message to one agent may be passed on to that agent. If not, counts and
    /// logs the rejection, and returns the message with the reason.
    pub(crate) fn authorize_direct(
        &self,
        origin: Option<&Origin>,
        payload: &Bytes,
        directory: impl FnOnce() -> Arc<Directory>,
    ) -> Result<(), ForbiddenMessage> {
        let Some((rights, origin)) = self.limits(origin) else { return Ok(()) };
        let message = match acl::decode(payload) {
            Ok(message) => message,
            Err(error) => match error.to_not_understood() {
                // The agent takes it as an answer of its sender.
                Some(answer) => answer,
                // The agent answers what is unreadable with `not-understood`.
                None => return Ok(()),
            },
        };
        let inform = inform_of(&message);
        let checked = self.check_message((rights, origin), &message, inform.as_ref(), &directory());
        checked.map_err(|detail| ForbiddenMessage {
            message: Box::new(message),
            origin: origin.daemon.clone(),
            detail: format!("the message {detail}"),
        })
    }

    /// Whether `origin` may send this message. If not, counts and logs the rejection.
    pub(crate) fn authorize_message(
        &self,
        origin: Option<&Origin>,
        message: &Message,
        inform: Option<&Inform>,
        directory: impl FnOnce() -> Arc<Directory>,
    ) -> bool {
        let Some(limits) = self.limits(origin) else { return true };
        self.check_message(limits, message, inform, &directory()).is_ok()
    }

    /// Whether `origin` may send in the name of the sender of an overheard message. The
    /// receivers of the message count and log a rejection; the listener does not.
    pub(crate) fn is_from_sender(
        &self,
        origin: Option<&Origin>,
        message: &Message,
        directory: &Directory,
    ) -> bool {
        let Some((rights, origin)) = self.limits(origin) else { return true };
        check_sender(rights, origin, &message.sender, message.incarnation, directory).is_ok()
    }

    /// Whether `origin` may repeat a heartbeat of this incarnation of `sender`. If not, counts and
    /// logs the rejection.
    pub(crate) fn authorize_repetition(
        &self,
        origin: Option<&Origin>,
        sender: &AgentId,
        incarnation: Incarnation,
        directory: &Directory,
    ) -> bool {
        let Some((rights, origin)) = self.limits(origin) else { return true };
        let checked = check_sender(rights, origin, sender, incarnation, directory);
        let checked = checked.and_then(|()| check_holds(origin, sender, directory));
        checked.map_err(|error| self.note(&error, origin, sender.as_str())).is_ok()
    }

    /// Checks whether the origin may send this message. If not, counts and logs the rejection and
    /// returns the reason.
    fn check_message(
        &self,
        (rights, origin): (&Rights, &Origin),
        message: &Message,
        inform: Option<&Inform>,
        directory: &Directory,
    ) -> Result<(), String> {
        let sender = &message.sender;
        let checked = check_sender(rights, origin, sender, message.incarnation, directory)
            .and_then(|()| match inform {
                Some(Inform::Model(_) | Inform::Heartbeat(_)) => {
                    check_holds(origin, sender, directory)
                }
                _ => Ok(()),
            })
            .and_then(|()| check_content(rights, origin, message, inform).map_err(unauthorized));
        checked.map_err(|error| {
            self.note(&error, origin, sender.as_str());
            error.detail
        })
    }

    /// Whether an agent may be present at the daemon that its presence token names. If not, counts
    /// and logs the rejection.
    pub(crate) fn authorize_presence(&self, presence: &Presence) -> bool {
        let resident = presence.resident();
        let Some(rights) = self.rights.get().filter(|_| resident.daemon != self.daemon) else {
            return true;
        };
        match (presence, rights.may_host(&resident.agent, &resident.daemon)) {
            (Presence::Joined(_), Err(detail)) => {
                let (agent, daemon) = (&resident.agent, &resident.daemon);
                let key = format!("presence of {agent} at {daemon}");
                self.rejections.note(&Rejected {
                    violation: ViolationKind::Unauthorized,
                    detail: &format!("is a token that may not be there: {detail}"),
                    claimed: Some(daemon.as_str()),
                    key: &key,
                });
                false
            }
            _ => true,
        }
    }

    /// Whether the origin of an answer to a query may give that answer. If not, counts and logs the
    /// rejection.
    pub(crate) fn authorize_answer(
        &self,
        answer: &Answer<'_>,
        directory: impl FnOnce() -> Arc<Directory>,
    ) -> bool {
        let Answer { origin, resource, agent, payload } = *answer;
        let Some((rights, origin)) = self.limits(Some(origin)) else { return true };
        if resource == Resource::Model && payload.len() > MODEL_BYTES_MAX {
            let detail = format!("answers with a model of more than {MODEL_BYTES_MAX} bytes");
            let error = AuthorizationError { violation: ViolationKind::Oversized, detail };
            self.note(&error, origin, resource.as_str());
            return false;
        }
        let checked = match (resource, agent) {
            (Resource::Model, Some(agent)) => match acl::decode(payload) {
                Ok(message) if message.sender == *agent => {
                    let (limits, inform) = ((rights, origin), inform_of(&message));
                    return self
                        .check_message(limits, &message, inform.as_ref(), &directory())
                        .is_ok();
                }
                _ => Err("answers with a model that is another agent's, or unreadable".to_owned()),
            },
            (Resource::Domain | Resource::State | Resource::Goals | Resource::Journal, _)
                if !rights.may_host_reasoning(&origin.daemon) =>
            {
                Err("answers a question that only reasoning agents answer".to_owned())
            }
            _ => Ok(()),
        };
        let key = resource.as_str();
        checked.map_err(|detail| self.note(&unauthorized(detail), origin, key)).is_ok()
    }

    fn note(&self, error: &AuthorizationError, origin: &Origin, key: &str) {
        let AuthorizationError { violation, detail } = error;
        let claimed = Some(origin.daemon.as_str());
        self.rejections.note(&Rejected { violation: *violation, detail, claimed, key });
    }
}

/// Checks three conditions: the rights let the daemon `origin` host the agent `sender`; no later
/// incarnation of `sender` is present at that daemon; and `sender` is not present at other daemons
/// only.
///
/// An agent that is present at the daemon may send from there even if it is not the oldest replica,
/// as standbys do: the daemon has signed the presence of its replica. A message alone proves no
/// presence, because any daemon could state a later incarnation in a message.
fn check_sender(
    rights: &Rights,
    origin: &Origin,
    sender: &AgentId,
    incarnation: Incarnation,
    directory: &Directory,
) -> Result<(), AuthorizationError> {
    rights.may_host(sender, &origin.daemon).map_err(unauthorized)?;
    let present = directory.all(sender);
    match present.iter().find(|resident| resident.daemon == origin.daemon) {
        Some(here) if incarnation < here.incarnation => {
            let detail = format!("is of an earlier incarnation of `{sender}`");
            Err(AuthorizationError { violation: ViolationKind::Replayed, detail })
        }
        Some(_) => Ok(()),
        // An agent without a presence may be about to join: presence tokens may arrive later than
        // messages.
        None => present.first().map_or(Ok(()), |elsewhere| Err(is_at(elsewhere))),
    }
}

/// Checks that the oldest present agent of the sender's name is not on another daemon than
/// `origin`. A standby must not send models and heartbeats under the name, because receivers
/// believe the later of two incarnations.
fn check_holds(
    origin: &Origin,
    sender: &AgentId,
    directory: &Directory,
) -> Result<(), AuthorizationError> {
    let holder = directory.find(sender).filter(|holder| holder.daemon != origin.daemon);
    holder.map_or(Ok(()), |holder| Err(is_at(holder)))
}

/// Checks whether the sender of a message may send the content of the message; returns the reason
/// if not.
fn check_content(
    rights: &Rights,
    origin: &Origin,
    message: &Message,
    inform: Option<&Inform>,
) -> Result<(), String> {
    let sender = &message.sender;
    let prefixed = |problem: String| format!("is one that its sender may not send: {problem}");
    match (message.performative, inform) {
        (Performative::Request, _) => {
            // An unreadable request has no effect.
            let request = message.content_as::<Request>().ok();
            request.map_or(Ok(()), |request| rights.may_ask(sender, &request)).map_err(prefixed)
        }
        // A cancellation ends the goal of any asker.
        (Performative::Cancel, _) if message.protocol == Some(Protocol::Goal) => {
            rights.may_ask_for_goals(sender).map_err(prefixed)
        }
        (Performative::Cfp, _) => rights.may_ask_for_goals(sender).map_err(prefixed),
        (_, Some(Inform::Epoch(_))) if !rights.may_reason(sender) => Err(prefixed(format!(
            "the ecosystem's file does not let `{sender}` speak for the domain"
        ))),
        (_, Some(Inform::Model(announced))) if rights.limits_actions(sender, &origin.daemon) => {
            // A model that cannot be read offers no actions.
            let Some(model) = pddl::parse_action_model(&announced.model).value else {
                return Ok(());
            };
            let actions: Vec<_> =
                model.actions.iter().map(|action| action.name.to_string()).collect();
            let actions = actions.iter().map(String::as_str);
            rights.may_advertise(sender, &origin.daemon, actions).map_err(prefixed)
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Mutex;

    use acl::content::{
        ChangeState, EpochChange, Heartbeat, ModelAnnouncement, Reason, Refusal, value,
    };
    use acl::{ConversationId, EcosystemId, MessageId, ReplyToken};
    use substrate::memory::Network;
    use substrate::{Delivery, Destination, Inbound, ReceivedQuery, Subject};

    use super::*;
    use crate::rights::{AgentRights, AllowedNames, AllowedRequesters};
    use crate::router::MessageRouter;
    use crate::settings::AgentSettings;

    /// The router of the daemon `hub`, on a network with two other daemons that record the refusals
    /// they get.
    struct House {
        hub: Arc<MessageRouter>,
        refused: Arc<Ear>,
        network: Network,
    }

    #[derive(Default)]
    struct Ear(Mutex<Vec<String>>);

    impl Inbound for Ear {
        fn deliver(&self, delivery: Delivery) {
            let message = acl::decode(&delivery.payload).expect("the hub writes what can be read");
            let refusal: Refusal = message.content_as().expect("a refusal");
            let line = format!("{:?} {:?}", delivery.destination, refusal.reason);
            self.0.lock().expect("no panic").push(line);
        }
        fn presence(&self, _: Presence) {}
        fn receive_query(&self, _: ReceivedQuery) {}
    }

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn daemon(name: &str) -> DaemonId {
        DaemonId::new(name).expect("a name")
    }

    fn origin(name: &str) -> Origin {
        let daemon = daemon(name);
        Origin { signing_daemon: self::daemon(daemon.host()), daemon }
    }

    fn rights() -> Rights {
        let entry = |name: &str, place: &str, actions: Option<&str>, reasons| {
            let actions = actions.map(|action| [action.to_owned()].into());
            (agent(name), AgentRights { daemons: [daemon(place)].into(), actions, reasons })
        };
        let agents = [
            entry("robot", "robot-pi", Some("move"), false),
            entry("requester", "hub", None, true),
        ];
        Rights {
            agents: agents.into(),
            guests: AllowedNames::These([daemon("desk")].into()),
            newcomers: AllowedNames::These([daemon("gate"), daemon("stall")].into()),
            goals: AllowedRequesters::These { agents: [].into(), guests: true },
            changes: AllowedRequesters::default(),
            history: AllowedRequesters::All,
            private: AllowedRequesters::default(),
        }
    }

    impl House {
        fn new() -> House {
            let (network, refused) = (Network::new(), Arc::new(Ear::default()));
            let ecosystem = EcosystemId::new("office").expect("a name");
            let hub = MessageRouter::new(ecosystem, daemon("hub"), AgentSettings::default());
            hub.set_rights(rights());
            hub.connect(network.open(daemon("hub"), Arc::<MessageRouter>::clone(&hub)));
            for other in ["robot-pi", "desk--cli-7"] {
                network.open(daemon(other), Arc::<Ear>::clone(&refused));
            }
            House { hub, refused, network }
        }

        /// Delivers a message from the daemon `from` to the requester, or to all agents; returns
        /// the counts of rejections.
        fn hears(&self, from: &str, to: Option<&str>, message: Message) -> BTreeMap<String, u64> {
            let addressed = match to {
                Some(to) => Destination::To(agent(to), Subject::Message(message.performative)),
                None => Destination::All(message.sender.clone(), message.performative),
            };
            let (payload, origin) = (acl::encode(&message), Some(origin(from)));
            self.hub.deliver(Delivery { destination: addressed, payload, origin });
            self.hub.rejections().counts()
        }

        fn refusals(&self) -> Vec<String> {
            std::mem::take(&mut *self.refused.0.lock().expect("no panic"))
        }
    }

    fn message(sender: &str, performative: Performative, content: serde_json::Value) -> Message {
        Message {
            version: acl::SCHEMA_VERSION,
            id: MessageId::new("m-1"),
            performative,
            sender: agent(sender),
            incarnation: Incarnation(5),
            receiver: Vec::new(),
            content,
            language: None,
            ontology: None,
            protocol: None,
            conversation_id: ConversationId::new("c"),
            reply_with: Some(ReplyToken::new("r")),
            in_reply_to: None,
            reply_within: None,
            via: Vec::new(),
            unknown: serde_json::Map::new(),
        }
    }

    fn change(sender: &str) -> Message {
        let change = Request::ChangeState(ChangeState::default());
        message(sender, Performative::Request, value(&change))
    }

    fn model(sender: &str, action: &str) -> Message {
        let heartbeat = Heartbeat {
            digest: "d".to_owned(),
            sequence: 1,
            facts: String::new(),
            known_for: BTreeMap::new(),
            period: acl::Millis(std::time::Duration::from_secs(1)),
            stops: Vec::new(),
        };
        let text = format!(
            "(define (agent {sender}) (:domain office) (:action {action} :agent ?r - object \
             :parameters () :precondition (and) :effect (and)))"
        );
        let methods = BTreeMap::new();
        let announced = ModelAnnouncement { model: text, methods, heartbeat };
        message(sender, Performative::Inform, value(&Inform::Model(Box::new(announced))))
    }

    fn none() -> BTreeMap<String, u64> {
        BTreeMap::new()
    }

    fn one(kind: &str) -> BTreeMap<String, u64> {
        [(kind.to_owned(), 1)].into()
    }

    #[tokio::test]
    async fn a_message_in_the_name_of_another_daemons_agent_is_refused() {
        let house = House::new();
        let query = |sender| message(sender, Performative::QueryRef, serde_json::Value::Null);
        assert_eq!(house.hears("robot-pi", Some("requester"), query("robot")), none());
        let counted = house.hears("robot-pi", Some("requester"), query("requester"));
        assert_eq!(counted, one("unauthorized"));
        assert_eq!(house.refusals(), [r#"To("requester", Message(Refuse)) Forbidden"#]);
    }

    #[tokio::test]
    async fn a_forbidden_request_is_refused_with_the_reason() {
        let house = House::new();
        assert_eq!(
            house.hears("robot-pi", Some("requester"), change("robot")),
            one("unauthorized")
        );
        assert_eq!(house.refusals(), [r#"To("robot", Message(Refuse)) Forbidden"#]);
        let house = House::new();
        assert_eq!(
            house.hears("desk--cli-7", Some("requester"), change("me")),
            one("unauthorized")
        );
        assert_eq!(house.refusals(), [r#"To("me", Message(Refuse)) Forbidden"#]);
        assert_eq!(House::new().hears("hub", Some("requester"), change("robot")), none(), "itself");
    }

    #[tokio::test]
    async fn a_model_with_forbidden_actions_is_rejected() {
        assert_eq!(House::new().hears("robot-pi", None, model("robot", "move")), none());
        let vault = model("robot", "open-vault");
        assert_eq!(House::new().hears("robot-pi", None, vault), one("unauthorized"));
        let person = model("me", "move");
        assert_eq!(House::new().hears("desk--cli-7", None, person), one("unauthorized"));
    }

    #[tokio::test]
    async fn only_reasoning_agents_announce_the_domain_and_call_for_proposals() {
        let epoch = value(&Inform::Epoch(EpochChange::default()));
        let epoch = message("robot", Performative::Inform, epoch);
        assert_eq!(House::new().hears("robot-pi", None, epoch), one("unauthorized"));
        let call = message("robot", Performative::Cfp, serde_json::Value::Null);
        assert_eq!(House::new().hears("robot-pi", None, call), one("unauthorized"));
    }

    #[tokio::test]
    async fn only_askers_of_goals_cancel_goals() {
        let cancel = |sender: &str, protocol| {
            let cancel = message(sender, Performative::Cancel, serde_json::Value::Null);
            Message { protocol: Some(protocol), ..cancel }
        };
        let hears = |from: &str, message| House::new().hears(from, Some("requester"), message);
        assert_eq!(hears("robot-pi", cancel("robot", Protocol::Goal)), one("unauthorized"));
        assert_eq!(hears("desk--cli-7", cancel("me", Protocol::Goal)), none());
        assert_eq!(hears("robot-pi", cancel("robot", Protocol::Query)), none());
    }

    #[tokio::test]
    async fn an_answer_of_another_version_is_checked_like_any_other() {
        let answer = |sender: &str, version: u32| {
            let refusal = Refusal::new(Reason::Unreadable, "no such version");
            let answer = message(sender, Performative::NotUnderstood, value(&refusal));
            Message { version, in_reply_to: Some(ReplyToken::new("r")), ..answer }
        };
        let hears = |message| House::new().hears("robot-pi", Some("requester"), message);
        assert_eq!(hears(answer("requester", acl::SCHEMA_VERSION)), one("unauthorized"));
        assert_eq!(hears(answer("requester", 1)), one("unauthorized"));
        assert_eq!(hears(answer("robot", 1)), none());
    }

    #[tokio::test]
    async fn presence_is_checked_against_rights_and_messages_against_presence() {
        let house = House::new();
        let joins = |name: &str, place: &str, incarnation| {
            let (agent, daemon) = (agent(name), daemon(place));
            let resident = Resident { agent, daemon, incarnation: Incarnation(incarnation) };
            house.hub.presence(Presence::Joined(resident));
        };
        joins("robot", "desk--cli-7", 1);
        joins("me", "robot-pi", 1);
        assert_eq!(house.hub.rejections().counts(), [("unauthorized".to_owned(), 2)].into());
        assert_eq!(house.hub.find(&agent("robot")), None);
        assert_eq!(house.hub.find(&agent("me")), None);

        joins("robot", "robot-pi", 6);
        joins("me", "desk--cli-7", 5);
        let query = |sender| message(sender, Performative::QueryRef, serde_json::Value::Null);
        let counted = house.hears("robot-pi", Some("requester"), query("robot"));
        assert_eq!(counted["replayed"], 1, "an earlier incarnation");
        let counted = house.hears("desk", Some("requester"), query("me"));
        assert_eq!(counted["forged"], 1, "that incarnation is elsewhere");
        drop(house.network);
    }

    /// A broadcast that is too long must not be kept: it would be cached, and copied for every
    /// agent that starts later.
    #[tokio::test]
    async fn an_oversized_broadcast_is_not_cached() {
        let house = House::new();
        let (daemon, incarnation) = (daemon("robot-pi"), Incarnation(5));
        let robot = Resident { agent: agent("robot"), daemon, incarnation };
        house.hub.presence(Presence::Joined(robot));
        let padded = |bytes: usize| {
            let mut long = model("robot", "move");
            long.content["model"] = format!(
                "{};{}",
                long.content["model"].as_str().expect("a text"),
                "x".repeat(bytes)
            )
            .into();
            long
        };
        assert_eq!(house.hears("robot-pi", None, padded(900 << 10)), none());
        assert_eq!(house.hears("robot-pi", None, padded(1 << 20)), one("oversized"));
        let heartbeat = Inform::Heartbeat(Heartbeat {
            digest: "d".to_owned(),
            sequence: 2,
            facts: "x".repeat(256 << 10),
            known_for: BTreeMap::new(),
            period: acl::Millis(std::time::Duration::from_secs(1)),
            stops: Vec::new(),
        });
        let long = message("robot", Performative::Inform, value(&heartbeat));
        assert_eq!(house.hears("robot-pi", None, long)["oversized"], 2);
        let garbage = message("robot", Performative::Inform, "x".repeat(5 << 20).into());
        assert_eq!(house.hears("robot-pi", None, garbage)["oversized"], 3, "before it is read");
        let mailbox =
            house.hub.register(&agent("late"), Incarnation(1), vec![Performative::Inform]);
        drop(house.network);
        assert_eq!(mailbox.waiting(), 1, "a short model is kept for later agents");
    }

    /// A daemon without the lamp claims an incarnation of it that no real one will ever exceed.
    #[tokio::test]
    async fn no_daemon_sends_in_the_name_of_an_agent_present_elsewhere() {
        let house = House::new();
        let lamp = |place: &str, incarnation| {
            let (agent, daemon) = (agent("lamp"), daemon(place));
            Resident { agent, daemon, incarnation: Incarnation(incarnation) }
        };
        let says = |message: Message| Message { incarnation: Incarnation(1 << 53), ..message };
        let query = || message("lamp", Performative::QueryRef, serde_json::Value::Null);
        let shine = || model("lamp", "shine");
        house.hub.presence(Presence::Joined(lamp("gate", 5)));
        assert_eq!(house.hears("gate", None, shine()), none());
        let counted = house.hears("stall", None, says(shine()));
        assert_eq!(counted, one("forged"), "in a later incarnation");
        let counted = house.hears("stall", Some("requester"), says(query()));
        assert_eq!(counted["forged"], 2);

        house.hub.presence(Presence::Joined(lamp("stall", 1 << 53)));
        let counted = house.hears("stall", Some("requester"), says(query()));
        assert_eq!(counted["forged"], 2, "the standby there may send");
        let counted = house.hears("stall", None, says(shine()));
        assert_eq!(counted["forged"], 3, "but no model: another is the leader");
        assert_eq!(house.hears("gate", None, shine())["forged"], 3);

        house.hub.presence(Presence::Left(lamp("gate", 5)));
        assert_eq!(house.hears("stall", None, says(shine()))["forged"], 3, "now it is the leader");
        drop(house.network);
    }

    #[test]
    fn an_overheard_message_must_come_from_a_daemon_that_may_host_its_sender() {
        let house = House::new();
        let message = model("robot", "move");
        let is_heard = |from: &str| house.hub.is_from_sender(Some(&origin(from)), &message);
        assert!(is_heard("robot-pi"));
        assert!(!is_heard("hall-pi"), "the file gives the robot to another daemon");
        assert!(!is_heard("desk--cli-7"), "a guest is no robot");
        // The receivers of the message count the rejection; a listener does not.
        assert_eq!(house.hub.rejections().counts(), none());
    }
}
