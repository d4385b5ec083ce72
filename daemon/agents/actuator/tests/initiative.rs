//! Tests of a device's initiatives, over the in-memory substrate: the device announces facts at
//! once, requests and withdraws a goal, asks a question and takes the answer.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use acl::content::{
    Achieve, Inform, Keep, Outcome, PersonsAnswer, Question, Reason, Report, Request, Withdrawal,
};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Message, Performative};
use actuator::{
    Actuator, BoxFuture, Description, Device, DeviceEvent, Initiative, InitiativeUpdate,
    MethodCall, MethodFailure, MethodResult, OwnFact, facts_of, model_of,
};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, Host, LaunchContext, LaunchError,
    LaunchableAgent, MessageRouter, Participation,
};
use substrate::memory::Network;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// Messages that the test receives from all agents, with the time since the test began.
type Told = mpsc::UnboundedSender<String>;

// === the device ===

/// A doorbell, which rings by itself and then takes the initiatives that the test has prepared for
/// it.
struct Doorbell {
    rings: Arc<Mutex<mpsc::Receiver<()>>>,
    scripts: VecDeque<Vec<Initiative>>,
    rung: usize,
    told: Told,
}

impl Device for Doorbell {
    type Yield = ();

    fn describe(&self) -> Description {
        let model = model_of("(define (agent bell) (:domain home) (:objects bell - agent))");
        Description { model, methods: [].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        facts_of(&format!("(= (rung bell) {})", self.rung))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        Box::pin(std::future::ready(Err(MethodFailure::UnknownMethod(call.method.clone()))))
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        MethodResult::default()
    }

    fn next_event(&mut self) -> Option<BoxFuture<DeviceEvent<Doorbell>>> {
        let rings = Arc::clone(&self.rings);
        Some(Box::pin(async move {
            let ring =
                std::future::poll_fn(|cx| rings.lock().expect("held for an instant").poll_recv(cx));
            if ring.await.is_none() {
                std::future::pending::<()>().await;
            }
            let stir: DeviceEvent<Doorbell> = Box::new(|bell| {
                bell.rung += 1;
                bell.scripts.pop_front().unwrap_or_default()
            });
            stir
        }))
    }

    fn receive_news(&mut self, name: &str, news: &InitiativeUpdate) -> Vec<Initiative> {
        let words = match news {
            InitiativeUpdate::Report(report) => report.outcome.to_string(),
            InitiativeUpdate::Refused(refusal) => format!("{:?}", refusal.reason),
            InitiativeUpdate::Answer(text) => text.clone(),
            InitiativeUpdate::Unanswered(why) => why.clone(),
        };
        let _ = self.told.send(format!("bell hears of {name}: {words}"));
        Vec::new()
    }
}

fn want(goal: &str) -> Initiative {
    let goal = Achieve::new(goal, Keep::Maintain, 1);
    Initiative::RequestGoal { name: "guests".to_owned(), goal, insists: false }
}

fn withdraw() -> Initiative {
    Initiative::Withdraw { name: "guests".to_owned() }
}

fn ask() -> Initiative {
    let question = Question::new("who is it?");
    Initiative::AskPeople { name: "who".to_owned(), question, patience: Duration::from_secs(30) }
}

// === the other agents ===

/// Agent that plays all other agents: receives heartbeats, takes goals as the Plan Requester does,
/// and answers questions as a keyboard does.
struct Other {
    /// Number of goals that the agent refuses before it accepts one. `reason` is the reason of
    /// these refusals.
    refuses: usize,
    reason: Reason,
    answer: Option<&'static str>,
    told: Told,
    asked: Option<Participation>,
}

impl Agent for Other {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
            .on_broadcast(Performative::Inform, Self::informed)
            .on_broadcast(Performative::QueryRef, Self::queried)
            .on_broadcast(Performative::Cancel, Self::withdrawn)
    }
}

impl Other {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Ok(Request::Achieve(goal)) = message.content_as() else { panic!("{message:?}") };
        let _ = self.told.send(format!("{} is asked for {}", ctx.id(), goal.goal));
        let participation = Participation::of(&message);
        if self.refuses > 0 {
            self.refuses -= 1;
            return ctx.refuse(&participation, self.reason, "not now");
        }
        ctx.answer(&participation, Performative::Confirm, &Report::new(Outcome::Holds, "it holds"));
        self.asked = Some(participation);
    }

    fn cancelled(&mut self, _message: Message, ctx: &mut Context<Self>) {
        let _ = self.told.send(format!("{} is to give it up", ctx.id()));
        let Some(participation) = self.asked.take() else { return };
        ctx.answer(&participation, Performative::Confirm, &Report::new(Outcome::Cancelled, "done"));
    }

    fn informed(&mut self, message: Message, _ctx: &mut Context<Self>) {
        if let Ok(Inform::Heartbeat(beat)) = message.content_as() {
            let _ = self.told.send(beat.facts.trim().to_owned());
        }
    }

    fn withdrawn(&mut self, message: Message, ctx: &mut Context<Self>) {
        let why: Withdrawal = message.content_as().expect("why");
        let _ = self.told.send(format!("{} need not answer: {}", ctx.id(), why.detail));
    }

    fn queried(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Some(text) = self.answer.map(str::to_owned) else { return };
        ctx.answer(
            &Participation::of(&message),
            Performative::Inform,
            &Inform::Answer(PersonsAnswer::plain(text)),
        );
    }
}

// === the test environment ===

struct Room {
    router: Arc<MessageRouter>,
    told: Told,
    heard: mpsc::UnboundedReceiver<String>,
    ring: mpsc::Sender<()>,
    rings: Option<mpsc::Receiver<()>>,
    _network: Network,
}

/// Returns the environment of a test. Heartbeats are rare in it, so that a message which arrives at
/// once was sent because of an event.
fn room() -> Room {
    let settings = AgentSettings {
        heartbeat_period: Duration::from_secs(3_600),
        heartbeat_lease: Duration::from_secs(36_000),
        ..AgentSettings::default()
    };
    let network = Network::new();
    let daemon = DaemonId::new("here").expect("a name");
    let ecosystem = EcosystemId::new("home").expect("a name");
    let router = MessageRouter::new(ecosystem, daemon.clone(), settings);
    router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
    let (told, heard) = mpsc::unbounded_channel();
    let (ring, rings) = mpsc::channel(8);
    Room { router, told, heard, ring, rings: Some(rings), _network: network }
}

impl Room {
    fn launch(
        &self,
        agent: Box<dyn LaunchableAgent>,
        id: &str,
        incarnation: u64,
    ) -> (CancellationToken, JoinHandle<Result<(), LaunchError>>) {
        let stopping = CancellationToken::new();
        let task = agent.launch(LaunchContext {
            id: name(id),
            incarnation: Incarnation(incarnation),
            router: Arc::clone(&self.router),
            ontology: Arc::from("home"),
            stopping: stopping.clone(),
            has_replicas: false,
            via: [].into(),
        });
        (stopping, task)
    }

    fn other(&self, id: &str, incarnation: u64, answer: Option<&'static str>) -> CancellationToken {
        let told = self.told.clone();
        let reason = Reason::Incapable;
        let other = Other { refuses: 0, reason, answer, told, asked: None };
        self.launch(Box::new(other), id, incarnation).0
    }

    /// Starts the doorbell. At its first ring the doorbell takes the first list of initiatives in
    /// `scripts`, at its second ring the second list, and so on.
    fn bell(&mut self, scripts: impl Into<VecDeque<Vec<Initiative>>>) -> CancellationToken {
        let rings = Arc::new(Mutex::new(self.rings.take().expect("one bell")));
        let bell = Doorbell { rings, scripts: scripts.into(), rung: 0, told: self.told.clone() };
        let ontology = pddl::parse_domain(
            "(define (domain home) (:types agent) (:functions (rung ?a - agent)))",
        );
        let map =
            pddl::parse_problem("(define (problem map) (:domain home) (:init) (:goal (and)))");
        let host = Host {
            settings: self.router.settings().clone(),
            ..Host::new(ontology.value.expect("a domain"), map.value.expect("a map"))
        };
        let blueprint = Blueprint {
            id: name("bell"),
            driver: String::new(),
            config: serde_json::Value::Null.into(),
            host: Arc::new(host),
        };
        self.launch(Actuator::build(&blueprint, bell).expect("built"), "bell", 1).0
    }

    /// Rings the doorbell once and collects messages until none arrives for ten milliseconds.
    async fn ring(&mut self) -> Vec<String> {
        self.ring.send(()).await.expect("the bell is there");
        self.quiet().await
    }

    async fn quiet(&mut self) -> Vec<String> {
        let mut lines = Vec::new();
        while let Ok(line) =
            tokio::time::timeout(Duration::from_millis(10), self.heard.recv()).await
        {
            lines.extend(line);
        }
        lines
    }
}

#[tokio::test(start_paused = true)]
async fn an_event_is_announced_at_once_and_not_too_often() {
    let mut room = room();
    room.other("listener", 1, None);
    room.bell([]);
    room.quiet().await;
    assert_eq!(room.ring().await, ["(= (rung bell) 1)"]);
    let begun = Instant::now();
    for _ in 0..7 {
        room.ring.send(()).await.expect("the bell is there");
    }
    let mut at_once = String::new();
    while at_once != "(= (rung bell) 4)" {
        at_once = room.heard.recv().await.expect("told");
    }
    assert!(begun.elapsed() < Duration::from_millis(50), "{:?}", begun.elapsed());
    let mut last = String::new();
    while last != "(= (rung bell) 8)" {
        last = room.heard.recv().await.expect("told");
    }
    assert!(begun.elapsed() >= Duration::from_millis(350), "{:?}", begun.elapsed());
}

#[tokio::test(start_paused = true)]
async fn a_goal_is_requested_once_and_withdrawn() {
    let mut room = room();
    room.other("plan-requester", 1, None);
    room.bell([vec![want("(a)")], vec![want("(a)")], vec![want("(b)")], vec![withdraw()]]);
    room.quiet().await;
    let first = room.ring().await;
    let asked =
        ["(= (rung bell) 1)", "plan-requester is asked for (a)", "bell hears of guests: holds"];
    assert_eq!(first[..3], asked, "{first:?}");
    tokio::time::sleep(Duration::from_secs(1)).await;
    assert_eq!(room.ring().await, ["(= (rung bell) 2)"], "it is wanted already");
    tokio::time::sleep(Duration::from_secs(1)).await;
    let other = room.ring().await;
    assert_eq!(other[1..3], ["plan-requester is to give it up", "plan-requester is asked for (b)"]);
    tokio::time::sleep(Duration::from_secs(1)).await;
    let last = room.ring().await;
    assert_eq!(last, ["(= (rung bell) 4)", "plan-requester is to give it up"]);
}

#[tokio::test(start_paused = true)]
async fn a_goal_waits_for_a_plan_requester_and_outlives_it() {
    let mut room = room();
    room.bell([vec![want("(a)")]]);
    assert_eq!(room.ring().await, [""; 0]);
    for incarnation in [1, 2] {
        let requester = room.other("plan-requester", incarnation, None);
        let lines = room.quiet().await;
        assert!(lines.contains(&"plan-requester is asked for (a)".to_owned()), "{lines:?}");
        requester.cancel();
        tokio::time::sleep(Duration::from_secs(5)).await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_is_requested_again_after_a_full_mailbox() {
    let mut room = room();
    let told = room.told.clone();
    let reason = Reason::MailboxFull;
    let full = Other { refuses: 2, reason, answer: None, told, asked: None };
    room.launch(Box::new(full), "plan-requester", 1);
    room.bell([vec![want("(a)")], vec![withdraw()]]);
    room.ring().await;
    tokio::time::sleep(Duration::from_secs(5)).await;
    let lines = room.quiet().await;
    let asked = lines.iter().filter(|line| *line == "plan-requester is asked for (a)");
    assert_eq!(asked.count(), 2, "after the first: {lines:?}");
    let heard: Vec<_> = lines.iter().filter(|line| line.starts_with("bell hears")).collect();
    assert_eq!(heard, ["bell hears of guests: holds"], "and nothing of what was in the way");
}

#[tokio::test(start_paused = true)]
async fn a_failed_goal_is_requested_again_if_the_device_insists() {
    for (insists, times) in [(true, 3), (false, 1)] {
        let mut room = room();
        let (told, reason) = (room.told.clone(), Reason::Incapable);
        let other = Other { refuses: 2, reason, answer: None, told, asked: None };
        room.launch(Box::new(other), "plan-requester", 1);
        let Initiative::RequestGoal { name, goal, .. } = want("(a)") else {
            unreachable!("a want")
        };
        room.bell([vec![Initiative::RequestGoal { name, goal, insists }]]);
        let mut lines = room.ring().await;
        // The delay doubles after each failure.
        tokio::time::sleep(Duration::from_secs(1 + 2 + 1)).await;
        lines.extend(room.quiet().await);
        let asked = lines.iter().filter(|line| *line == "plan-requester is asked for (a)");
        assert_eq!(asked.count(), times, "{lines:?}");
        let holds = lines.iter().any(|line| line == "bell hears of guests: holds");
        assert_eq!(holds, insists, "{lines:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_device_that_stops_withdraws_its_goals() {
    let mut room = room();
    room.other("plan-requester", 1, None);
    let bell = room.bell([vec![want("(a)")]]);
    room.ring().await;
    bell.cancel();
    assert_eq!(room.quiet().await, ["plan-requester is to give it up"]);
}

#[tokio::test(start_paused = true)]
async fn the_first_answer_counts() {
    let mut room = room();
    room.other("keyboard", 1, Some("the postman"));
    room.other("silent", 1, None);
    room.bell([vec![ask()]]);
    let lines = room.ring().await;
    let answers = lines.iter().filter(|line| line.starts_with("bell hears"));
    assert_eq!(answers.collect::<Vec<_>>(), ["bell hears of who: the postman"]);
    let told: Vec<_> = lines.iter().filter(|line| line.contains("need not")).collect();
    // The keyboard that has answered gets no withdrawal.
    assert_eq!(told, ["silent need not answer: answered at `keyboard`"]);
}

#[tokio::test(start_paused = true)]
async fn a_question_without_an_answer_ends_after_its_patience() {
    let mut room = room();
    room.other("silent", 1, None);
    room.bell([vec![ask()]]);
    room.ring().await;
    tokio::time::sleep(Duration::from_secs(31)).await;
    let lines = room.quiet().await;
    assert_eq!(lines[0], "bell hears of who: no answer came within 30s");
}
