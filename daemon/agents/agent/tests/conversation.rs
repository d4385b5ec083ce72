//! Conversations of agents over the in-memory substrate: receipts, retries, refusals, fail-over.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use acl::content::{DaemonReport, Outcome, Reason, Refusal, Report, Request, value};
use acl::{
    AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Message, Performative, Protocol,
    ReplyToken,
};
use agent::{
    Agent, AgentSettings, Callbacks, Context, ExchangeEvent, ExchangeOpening, LaunchContext,
    LaunchError, LaunchableAgent, MessageRouter, Participation, Presence,
};
use bytes::Bytes;
use substrate::memory::Network;
use substrate::{AgentAddress, Destination, Resource, ResourceQuery, Subject, Substrate};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// A daemon on the in-memory network.
struct Daemon {
    router: Arc<MessageRouter>,
    port: Arc<dyn Substrate>,
    stopping: CancellationToken,
}

impl Daemon {
    fn open(network: &Network, daemon: &str, settings: AgentSettings) -> Daemon {
        let ecosystem = EcosystemId::new("test").expect("a name");
        let daemon = DaemonId::new(daemon).expect("a name");
        let router = MessageRouter::new(ecosystem, daemon.clone(), settings);
        let port = network.open(daemon, Arc::<MessageRouter>::clone(&router) as _);
        router.connect(Arc::clone(&port));
        Daemon { router, port, stopping: CancellationToken::new() }
    }

    /// Makes the daemon lose the next `count` messages that it receives.
    fn loses(&mut self, network: &Network, count: u32) {
        let inner = Arc::clone(&self.router);
        let deaf = Lossy { inner, lose: std::sync::atomic::AtomicU32::new(count) };
        self.port = network.open(self.router.daemon().clone(), Arc::new(deaf));
    }

    fn launch(
        &self,
        agent: impl Agent,
        id: &str,
        incarnation: u64,
    ) -> JoinHandle<Result<(), LaunchError>> {
        self.launch_context(agent, id, incarnation, false)
    }

    /// Returns the counters of this daemon, which hosts at least one agent.
    async fn load(&self) -> serde_json::Value {
        let daemon = Some(self.router.daemon().clone());
        let ask = ResourceQuery { daemon, resource: Resource::Mailbox, agent: None };
        let answers = self.router.ask(ask, SECOND).await;
        serde_json::from_slice(&answers[0]).expect("JSON")
    }

    /// Returns the report of this daemon about itself.
    async fn report(&self) -> DaemonReport {
        let daemon = Some(self.router.daemon().clone());
        let ask = ResourceQuery { daemon, resource: Resource::Daemon, agent: None };
        let answers = self.router.ask(ask, SECOND).await;
        serde_json::from_slice(&answers[0]).expect("a report")
    }

    /// Returns a context for launching an agent that may have replicas.
    fn launch_context(
        &self,
        agent: impl Agent,
        id: &str,
        incarnation: u64,
        stands_by: bool,
    ) -> JoinHandle<Result<(), LaunchError>> {
        Box::new(agent).launch(LaunchContext {
            id: name(id),
            incarnation: Incarnation(incarnation),
            router: Arc::clone(&self.router),
            ontology: Arc::from("test"),
            stopping: self.stopping.clone(),
            has_replicas: stands_by,
            via: [].into(),
        })
    }
}

/// Agent that answers a `request` with `agree`, then with `confirm` after the time `takes`; reports
/// both.
struct Worker {
    takes: Duration,
    done: mpsc::UnboundedSender<&'static str>,
}

impl Agent for Worker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
    }
}

impl Worker {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        ctx.answer(&participation, Performative::Agree, &());
        let _ = self.done.send("began");
        ctx.after(self.takes, move |worker, ctx| {
            let _ = worker.done.send("done");
            ctx.answer(&participation, Performative::Confirm, &Report::new(Outcome::Done, "done"));
        });
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let report = Report::new(Outcome::Cancelled, "given up");
        ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
    }
}

/// Agent that sends one request to `worker`, and reports the answers.
struct Asker {
    patience: Duration,
    performative: Performative,
    /// Whether the agent cancels its request as soon as it has asked.
    changes_its_mind: bool,
    heard: mpsc::UnboundedSender<String>,
}

impl Agent for Asker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let goal = acl::content::Achieve::new("(p)", Default::default(), 0);
        let opening = ExchangeOpening {
            to: Some(name("worker")),
            performative: self.performative,
            protocol: Protocol::Action,
            conversation: ConversationId::new("c"),
            content: value(&Request::Achieve(goal)),
        };
        let token = ctx.open(opening, self.patience, |asker, answer, ctx| {
            let line = match answer {
                ExchangeEvent::Message(message) if message.performative == Performative::Refuse => {
                    let refusal: Refusal = message.content_as().expect("a refusal");
                    format!("refuse {:?}", refusal.reason)
                }
                ExchangeEvent::Message(message) => message.performative.to_string(),
                ExchangeEvent::TimedOut => "silence".to_owned(),
                ExchangeEvent::Undelivered(why) => format!("{why:?}"),
            };
            let line = format!("{line} {}", ctx.exchanges().open_count);
            let _ = asker.heard.send(line);
        });
        if self.changes_its_mind {
            ctx.send_turn(&token, &name("worker"), Performative::Cancel, serde_json::Value::Null);
        }
    }
}

struct Room {
    network: Network,
    here: Daemon,
    there: Daemon,
    heard: mpsc::UnboundedReceiver<String>,
    done: mpsc::UnboundedReceiver<&'static str>,
    asker: Option<Asker>,
    worker: Option<Worker>,
}

fn room(patience: Duration, takes: Duration) -> Room {
    let network = Network::new();
    let here = Daemon::open(&network, "here", AgentSettings::default());
    let there = Daemon::open(&network, "there", AgentSettings::default());
    let (hear, heard) = mpsc::unbounded_channel();
    let (do_, done) = mpsc::unbounded_channel();
    let asker = Some(Asker {
        patience,
        performative: Performative::Request,
        changes_its_mind: false,
        heard: hear,
    });
    let worker = Some(Worker { takes, done: do_ });
    Room { network, here, there, heard, done, asker, worker }
}

impl Room {
    fn ask(&mut self) {
        self.here.launch(self.asker.take().expect("asks once"), "asker", 1);
    }

    fn work(&mut self) {
        self.there.launch(self.worker.take().expect("works once"), "worker", 1);
    }

    /// Returns a channel with the messages of a performative that agents send to each other.
    fn overhear(&self, performative: Performative) -> mpsc::UnboundedReceiver<Bytes> {
        let (tell, told) = mpsc::unbounded_channel();
        self.network.tap(move |addressed, payload| {
            let subject = Subject::Message(performative);
            if matches!(addressed, Destination::To(_, to) if *to == subject) {
                let _ = tell.send(payload.clone());
            }
        });
        told
    }

    /// Returns the next line that the asker reports.
    async fn hears(&mut self) -> String {
        self.heard.recv().await.expect("the asker lives")
    }

    async fn did(&mut self) -> &'static str {
        self.done.recv().await.expect("the worker lives")
    }
}

const SECOND: Duration = Duration::from_secs(1);

#[tokio::test(start_paused = true)]
async fn a_request_is_agreed_to_and_confirmed() {
    let mut room = room(10 * SECOND, SECOND);
    room.work();
    room.ask();
    assert_eq!(room.hears().await, "agree 1");
    assert_eq!(room.hears().await, "confirm 1");
}

#[tokio::test(start_paused = true)]
async fn a_request_waits_until_its_receiver_joins() {
    let mut room = room(60 * SECOND, SECOND);
    room.ask();
    tokio::time::sleep(30 * SECOND).await;
    room.work();
    assert_eq!(room.hears().await, "agree 1");
}

#[tokio::test(start_paused = true)]
async fn a_request_to_an_absent_agent_fails() {
    let mut room = room(2 * SECOND, SECOND);
    room.ask();
    let heard = room.hears().await;
    assert!(heard == "NotHere 1" || heard == "silence 1", "{heard}");
}

#[tokio::test(start_paused = true)]
async fn a_request_times_out_if_its_receiver_dies() {
    let mut room = room(5 * SECOND, 60 * SECOND);
    room.work();
    room.ask();
    assert_eq!(room.hears().await, "agree 1");
    room.network.kill(room.there.router.daemon());
    assert_eq!(room.hears().await, "silence 1");
}

#[tokio::test(start_paused = true)]
async fn lost_messages_are_retried_and_acted_on_once() {
    let mut room = room(30 * SECOND, SECOND);
    // The worker's daemon loses the first two attempts.
    room.there.loses(&room.network, 2);
    room.work();
    room.ask();
    assert_eq!(room.hears().await, "agree 1");
    assert_eq!(room.hears().await, "confirm 1");
    assert_eq!((room.did().await, room.did().await), ("began", "done"));
    assert!(room.done.try_recv().is_err(), "once only");
}

#[tokio::test(start_paused = true)]
async fn an_answer_that_overtakes_another_waits_for_it() {
    let mut room = room(30 * SECOND, SECOND / 1_000);
    room.work();
    // The `agree` is lost, and arrives again after the `confirm`.
    room.here.loses(&room.network, 1);
    room.ask();
    assert_eq!(room.hears().await, "agree 1");
    assert_eq!(room.hears().await, "confirm 1");
}

#[tokio::test(start_paused = true)]
async fn a_cancel_that_overtakes_its_request_takes_effect() {
    let mut room = room(30 * SECOND, 60 * SECOND);
    room.there.loses(&room.network, 1);
    room.work();
    room.asker.as_mut().expect("has not asked").changes_its_mind = true;
    room.ask();
    assert_eq!(room.hears().await, "agree 1");
    assert_eq!(room.hears().await, "confirm 1");
    assert_eq!(room.did().await, "began");
    assert!(room.done.try_recv().is_err(), "it was given up");
}

/// Agent that calls for proposals once, and sends the call to `bidder` again every second.
struct Caller {
    heard: mpsc::UnboundedSender<String>,
}

impl Agent for Caller {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: None,
            performative: Performative::Cfp,
            protocol: Protocol::ContractNet,
            conversation: ConversationId::new("c"),
            content: serde_json::Value::Null,
        };
        let token = ctx.open(opening, 30 * SECOND, |caller: &mut Self, answer, _| {
            let _ =
                caller.heard.send(format!("{answer:?}").split('(').next().into_iter().collect());
        });
        for after in 1..=3 {
            let token = token.clone();
            ctx.after(after * SECOND, move |_, ctx| ctx.resend_cfp(&token, &name("bidder")));
        }
    }
}

/// Agent that reports each call for proposals that it receives, and refuses the call.
struct Bidder {
    done: mpsc::UnboundedSender<&'static str>,
}

impl Agent for Bidder {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Cfp, |bidder: &mut Self, message, ctx| {
                bidder.refuse(&message, "reminded", ctx);
            })
            .on_broadcast(Performative::Cfp, |bidder: &mut Self, message, ctx| {
                bidder.refuse(&message, "called", ctx);
            })
    }
}

impl Bidder {
    fn refuse(&mut self, message: &Message, how: &'static str, ctx: &mut Context<Self>) {
        let _ = self.done.send(how);
        ctx.refuse(&Participation::of(message), Reason::Incapable, "not mine");
    }
}

#[tokio::test(start_paused = true)]
async fn a_repeated_call_for_proposals_is_handled_once() {
    for (lost, expected) in [(0, "called"), (1, "reminded"), (2, "reminded")] {
        let mut room = room(SECOND, SECOND);
        room.there.loses(&room.network, lost);
        let (done, mut did) = mpsc::unbounded_channel();
        room.there.launch(Bidder { done }, "bidder", 1);
        let (heard, mut hears) = mpsc::unbounded_channel();
        room.here.launch(Caller { heard }, "caller", 1);
        assert_eq!(did.recv().await, Some(expected), "{lost} lost");
        assert_eq!(hears.recv().await.as_deref(), Some("Message"));
        tokio::time::sleep(5 * SECOND).await;
        assert!(did.try_recv().is_err() && hears.try_recv().is_err(), "once only, {lost} lost");
    }
}

/// Daemon that loses its first messages to agents, and receives each other message twice.
struct Lossy {
    inner: Arc<MessageRouter>,
    lose: std::sync::atomic::AtomicU32,
}

impl substrate::Inbound for Lossy {
    fn deliver(&self, delivery: substrate::Delivery) {
        use std::sync::atomic::Ordering::Relaxed;
        let lossy = match &delivery.destination {
            Destination::To(_, subject) => matches!(subject, Subject::Message(_)),
            Destination::All(_, performative) => *performative == Performative::Cfp,
            Destination::AgentState(_) => false,
        };
        if lossy && self.lose.fetch_update(Relaxed, Relaxed, |left| left.checked_sub(1)).is_ok() {
            return;
        }
        // Every other message is delivered twice.
        self.inner.deliver(delivery.clone());
        self.inner.deliver(delivery);
    }

    fn presence(&self, presence: substrate::Presence) {
        self.inner.presence(presence);
    }

    fn receive_query(&self, question: substrate::ReceivedQuery) {
        self.inner.receive_query(question);
    }
}

#[tokio::test(start_paused = true)]
async fn a_message_without_a_callback_is_not_understood() {
    let mut room = room(5 * SECOND, SECOND);
    room.asker.as_mut().expect("not launched").performative = Performative::QueryRef;
    room.work();
    room.ask();
    assert_eq!(room.hears().await, "silence 1", "out of turn in its own protocol, never sent");
}

#[tokio::test(start_paused = true)]
async fn garbage_is_answered_and_does_no_harm() {
    let mut room = room(5 * SECOND, SECOND);
    room.work();
    let mut told = room.overhear(Performative::NotUnderstood);
    // The stranger must be present, or it cannot be answered.
    let _token = room.here.port.announce(&name("stranger"), Incarnation(1)).expect("open");
    let to = AgentAddress { daemon: room.there.router.daemon().clone(), agent: name("worker") };
    let subject = Subject::Message(Performative::Request);
    let version_9 = r#"{"version": 9, "sender": "stranger", "conversation_id": "c9"}"#;
    tokio::task::yield_now().await;
    for garbage in [&b"\xff\xfe"[..], b"{}", b"[1,2", version_9.as_bytes()] {
        room.here.port.send(&to, subject, Bytes::copy_from_slice(garbage)).expect("open");
    }
    let answer = acl::decode(&told.recv().await.expect("an answer")).expect("a message");
    assert_eq!(answer.conversation_id, ConversationId::new("c9"));
    let refusal: Refusal = answer.content_as().expect("a reason");
    assert_eq!(refusal.reason, Reason::Unreadable);
    assert!(refusal.detail.contains("version 9"), "{}", refusal.detail);
    room.ask();
    assert_eq!(room.hears().await, "agree 1", "the worker goes on");
}

/// Returns a text in version 1 of the protocol, which had another name for the field of the time to
/// answer.
fn of_version_1(performative: Performative, sender: &str, exchange: Option<&ReplyToken>) -> Bytes {
    let message = serde_json::json!({
        "version": 1, "id": format!("{sender}.1"), "performative": performative, "sender": sender,
        "incarnation": 1, "conversation_id": "c", "in_reply_to": exchange, "reply_by": 2_000,
        "content": {"reason": "unreadable", "detail": "version 2 is not known here"},
    });
    Bytes::from(message.to_string())
}

#[tokio::test(start_paused = true)]
async fn a_request_to_another_version_is_answered_at_once() {
    let mut room = room(5 * SECOND, SECOND);
    let mut told = room.overhear(Performative::Request);
    let _token = room.there.port.announce(&name("worker"), Incarnation(1)).expect("open");
    room.ask();
    let asked = acl::decode(&told.recv().await.expect("it asks")).expect("a message");
    let answer = of_version_1(Performative::NotUnderstood, "worker", asked.reply_with.as_ref());
    let to = AgentAddress { daemon: room.here.router.daemon().clone(), agent: name("asker") };
    let subject = Subject::Message(Performative::NotUnderstood);
    room.there.port.send(&to, subject, answer).expect("open");
    assert_eq!(room.hears().await, "not-understood 1", "and not silence");
}

#[tokio::test(start_paused = true)]
async fn broadcasts_of_another_version_are_counted_under_their_own_name() {
    let mut room = room(5 * SECOND, SECOND);
    // A daemon without agents answers no query.
    room.ask();
    let _token = room.there.port.announce(&name("lamp"), Incarnation(1)).expect("open");
    tokio::task::yield_now().await;
    let heartbeat = of_version_1(Performative::Inform, "lamp", None);
    room.there.port.broadcast(&name("lamp"), Performative::Inform, heartbeat).expect("open");
    tokio::task::yield_now().await;
    let load = room.here.load().await;
    assert_eq!(load["rejected"]["other-version"], 1, "{load}");
    assert_eq!(load["unreadable"], 0, "{load}");
}

#[tokio::test(start_paused = true)]
async fn an_answer_of_an_agent_that_was_not_asked_is_rejected() {
    let mut room = room(10 * SECOND, SECOND);
    let mut told = room.overhear(Performative::Agree);
    room.work();
    room.ask();
    assert_eq!(room.hears().await, "agree 1");
    // Every listener knows the token of the exchange.
    let agreed = acl::decode(&told.recv().await.expect("it was said")).expect("a message");
    let _token = room.there.port.announce(&name("meddler"), Incarnation(1)).expect("open");
    let done = Report::new(Outcome::Done, "believe me");
    let said = Message {
        id: acl::MessageId::new("meddler.1.1"),
        sender: name("meddler"),
        performative: Performative::Confirm,
        content: value(&done),
        ..agreed
    };
    let to = AgentAddress { daemon: room.here.router.daemon().clone(), agent: name("asker") };
    let subject = Subject::Message(Performative::Confirm);
    room.there.port.send(&to, subject, acl::encode(&said)).expect("open");
    assert_eq!((room.did().await, room.did().await), ("began", "done"));
    assert_eq!(room.hears().await, "confirm 1");
    assert!(room.heard.try_recv().is_err(), "the worker's own, and no other");
    let load = room.here.load().await;
    assert_eq!(load["rejected"]["unauthorized"], 1, "{load}");
}

#[tokio::test(start_paused = true)]
async fn a_full_mailbox_refuses() {
    let network = Network::new();
    let settings = AgentSettings { mailbox_messages_max: 1, ..AgentSettings::default() };
    let here = Daemon::open(&network, "here", settings);
    let (do_, _done) = mpsc::unbounded_channel();
    here.launch(Worker { takes: SECOND, done: do_ }, "worker", 1);
    let mut heard = Vec::new();
    for asker in ["a", "b", "c"] {
        let (hear, hears) = mpsc::unbounded_channel();
        let performative = Performative::Request;
        here.launch(
            Asker { patience: 5 * SECOND, performative, changes_its_mind: false, heard: hear },
            asker,
            1,
        );
        heard.push(hears);
    }
    let mut lines = Vec::new();
    for hears in &mut heard {
        lines.push(hears.recv().await.expect("an answer"));
    }
    assert!(lines.contains(&"refuse MailboxFull 1".to_owned()), "{lines:?}");
    assert!(lines.contains(&"agree 1".to_owned()), "{lines:?}");
}

#[tokio::test(start_paused = true)]
async fn a_second_agent_of_the_same_name_is_not_launched() {
    let mut room = room(5 * SECOND, SECOND);
    room.work();
    tokio::task::yield_now().await;
    let (do_, _done) = mpsc::unbounded_channel();
    let second = room.here.launch(Worker { takes: SECOND, done: do_ }, "worker", 2);
    let error = second.await.expect("no panic").expect_err("the name is taken");
    assert!(error.to_string().contains("already at daemon `there`"), "{error}");
    room.ask();
    assert_eq!(room.hears().await, "agree 1", "the first goes on");
}

// === replicas ===

#[tokio::test(start_paused = true)]
async fn the_oldest_replica_leads_and_the_next_takes_over() {
    let network = Network::new();
    let settings = AgentSettings::default();
    let [a, b, c] = ["a", "b", "c"].map(|name| Daemon::open(&network, name, settings.clone()));
    let mut deeds = Vec::new();
    for (daemon, incarnation) in [(&c, 2), (&b, 1)] {
        let (done, did) = mpsc::unbounded_channel();
        daemon.launch_context(Worker { takes: Duration::ZERO, done }, "worker", incarnation, true);
        deeds.push(did);
    }
    let ask = async |asker: &str, incarnation: u64| {
        let (heard, mut hears) = mpsc::unbounded_channel();
        let (patience, performative) = (Duration::from_secs(5), Performative::Request);
        let agent = Asker { patience, performative, changes_its_mind: false, heard };
        a.launch(agent, asker, incarnation);
        // Also asked before it is clear which replica is the leader.
        while let Some(word) = hears.recv().await {
            if word.contains("confirm") || word.contains("Silence") {
                return word;
            }
        }
        String::new()
    };
    assert!(ask("first", 10).await.contains("confirm"));
    assert!(deeds[1].try_recv().is_ok(), "the oldest acts");
    assert!(deeds[0].try_recv().is_err(), "the other stands by");
    let replicas = async |daemon: &Daemon| {
        let DaemonReport { leads, stands_by, agents, .. } = daemon.report().await;
        assert_eq!(agents, 1);
        [leads, stands_by].map(|names| names.iter().map(AgentId::to_string).collect::<String>())
    };
    assert_eq!(replicas(&b).await, ["worker", ""]);
    assert_eq!(replicas(&c).await, ["", "worker"]);
    network.kill(&DaemonId::new("b").expect("a name"));
    assert_eq!(replicas(&c).await, ["worker", ""]);
    assert!(ask("second", 11).await.contains("confirm"));
    assert!(deeds[0].try_recv().is_ok(), "it takes over");
}

// === agents that ignore presence ===

/// Agent that wants presence callbacks while `heeds` is set, and reports the changes of which it is
/// notified.
struct Idler {
    heeds: Arc<AtomicBool>,
    met: mpsc::UnboundedSender<String>,
}

impl Agent for Idler {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, Self::requested)
    }

    fn presence(&mut self, presence: &Presence, _: &mut Context<Self>) {
        let word = if matches!(presence, Presence::Joined(_)) { "joined" } else { "left" };
        let line = format!("{} {word}", presence.resident().agent);
        self.met.send(line).expect("the test listens");
    }

    fn wants_presence(&self) -> bool {
        self.heeds.load(Ordering::Relaxed)
    }
}

impl Idler {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        ctx.answer(&participation, Performative::Agree, &serde_json::json!({}));
        let report = Report::new(Outcome::Done, "idle");
        ctx.answer(&participation, Performative::Confirm, &report);
    }
}

#[tokio::test(start_paused = true)]
async fn an_agent_is_notified_of_presence_once_it_wants_to_be() {
    let network = Network::new();
    let [a, b] = ["a", "b"].map(|name| Daemon::open(&network, name, AgentSettings::default()));
    let (heeds, (met, mut meets)) = (Arc::new(AtomicBool::new(false)), mpsc::unbounded_channel());
    a.launch(Idler { heeds: Arc::clone(&heeds), met }, "worker", 1);
    let ask = async |asker: &str, incarnation: u64| {
        let (heard, mut hears) = mpsc::unbounded_channel();
        let (patience, performative) = (Duration::from_secs(5), Performative::Request);
        b.launch(
            Asker { patience, performative, changes_its_mind: false, heard },
            asker,
            incarnation,
        );
        while !hears.recv().await.expect("an answer").contains("confirm") {}
    };
    let (done, _did) = mpsc::unbounded_channel();
    ask("first", 1).await;
    // An agent gets presence callbacks in any case while its answer has no receipt.
    tokio::time::sleep(Duration::from_secs(1)).await;
    while meets.try_recv().is_ok() {}
    b.launch(Worker { takes: Duration::ZERO, done: done.clone() }, "newcomer", 1);
    tokio::time::sleep(Duration::from_secs(1)).await;
    assert!(meets.try_recv().is_err(), "it is not told");
    // The event loop checks at the next event whether the agent wants presence callbacks.
    heeds.store(true, Ordering::Relaxed);
    ask("second", 2).await;
    b.launch(Worker { takes: Duration::ZERO, done }, "another", 1);
    let told = async { while meets.recv().await.expect("it lives") != "another joined" {} };
    tokio::time::timeout(Duration::from_secs(5), told).await.expect("it is told");
}

#[tokio::test(start_paused = true)]
async fn an_agent_that_ignores_presence_ends_if_an_older_one_has_its_name() {
    let network = Network::new();
    let settings = AgentSettings { mailbox_messages_max: 1, ..AgentSettings::default() };
    let [a, b] = ["a", "b"].map(|name| Daemon::open(&network, name, settings.clone()));
    let (met, _meets) = mpsc::unbounded_channel();
    let task = a.launch(Idler { heeds: Arc::default(), met }, "worker", 9);
    tokio::time::sleep(Duration::from_secs(1)).await;
    // An older agent of the same name appears at the other daemon.
    let _token = b.port.announce(&name("worker"), Incarnation(3)).expect("open");
    let ended = tokio::time::timeout(Duration::from_secs(5), task).await.expect("in time");
    let error = ended.expect("no panic").expect_err("the name is taken").to_string();
    assert!(error.contains("already at daemon `b`"), "{error}");
}
