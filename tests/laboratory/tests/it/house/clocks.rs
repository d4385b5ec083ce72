//! Machines with clocks of their own, for goals by the clock: two machines with a Plan Requester each,
//! which die and whose clocks jump, and one machine that stays, with a Journal, a planner, and an
//! executor that counts what it is asked for.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::content::{
    Achieve, GoalStatus, GoalTimes, Keep, Outcome, Report, Request, ScheduleGoal, value,
};
use acl::{AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Performative, Protocol};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, ExchangeEvent, ExchangeOpening, Host,
    HostServices, LaunchContext, LaunchableAgent, MachineSimulation, MessageRouter, Mode,
    Participation, PluginEntry, Resource, Resources,
};
use journal::MemoryStore;
use substrate::ResourceQuery;
use substrate::faulty::Network;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout};
use tokio_util::sync::CancellationToken;

use super::lamp::lamp_snapshot;

/// Number of machines with a Plan Requester.
pub(crate) const LEADERS: usize = 2;

/// How long the lamp is lit after an execution: longer than a new leader needs to take over and to
/// record that an occurrence has ended, and shorter than the time between two occurrences. If no
/// leader has seen it lit, the next one has it lit once more.
pub(crate) const LIT_FOR: Duration = Duration::from_secs(25);

/// Start of all clocks: 2026-09-21T13:33:20Z.
const CLOCK_START: Duration = Duration::from_secs(1_789_997_600);

/// Delay before an agent that ended is launched again, the same as in a daemon.
const RESTART: Duration = Duration::from_millis(500);

/// Time limit of every step.
const PATIENCE: Duration = Duration::from_secs(4 * 3_600);

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (idle ?a - agent) (lit ?a - agent))
    (:action light :parameters (?a - agent) :precondition (idle ?a) :effect (lit ?a)))";
const DARK: &str =
    "(define (problem p) (:domain d) (:objects lamp - agent) (:init (idle lamp)) (:goal (and)))";
const LIT: &str = "(define (problem p) (:domain d) (:objects lamp - agent) (:init (idle lamp)
    (lit lamp)) (:goal (and)))";

/// Difference between the clocks of two machines, in microseconds. No two machines begin an agent in
/// the same microsecond, also after some restarts with a clock that was set back.
const APART_MICROS: u64 = 997;

/// The clock of one machine.
struct Clock {
    began: Instant,
    apart: Duration,
    jumped: AtomicI64,
}

impl Clock {
    fn new(apart: Duration) -> Arc<Clock> {
        Arc::new(Clock { began: Instant::now(), apart, jumped: AtomicI64::new(0) })
    }
}

impl MachineSimulation for Clock {
    fn wall_clock(&self) -> SystemTime {
        let now = UNIX_EPOCH + CLOCK_START + self.apart + self.began.elapsed();
        let jumped = self.jumped.load(Ordering::Relaxed);
        let by = Duration::from_secs(jumped.unsigned_abs());
        if jumped < 0 { now - by } else { now + by }
    }

    fn work_duration(&self) -> Duration {
        Duration::from_millis(1)
    }
}

/// The truth: what was executed, and whether the lamp is lit.
#[derive(Default)]
struct World {
    lit_since: Option<Instant>,
    stays_dark: AtomicBool,
    /// The plan that was carried out for each goal: its term and round.
    done: BTreeMap<ConversationId, (u64, u32)>,
    broken: Vec<String>,
}

type SharedWorld = Arc<Mutex<World>>;

fn lock(world: &SharedWorld) -> MutexGuard<'_, World> {
    world.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A Domain Maintainer that knows the lamp.
struct Maintainer(SharedWorld);

impl Agent for Maintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        let lit_since = lock(&self.0).lit_since;
        let is_lit = lit_since.is_some_and(|since| since.elapsed() < LIT_FOR);
        let problem = if is_lit { LIT } else { DARK };
        (resource == Resource::Domain)
            .then(|| lamp_snapshot(u64::from(is_lit), DOMAIN, problem, ""))
    }
}

/// An executor that lights the lamp, and notes a goal that is carried out a second time.
struct Executor {
    world: SharedWorld,
    executed: mpsc::UnboundedSender<String>,
}

impl Agent for Executor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Executor, message, ctx| {
            let participation = Participation::of(&message);
            let Ok(Request::Execute(plan)) = message.content_as::<Request>() else {
                let report = Report::new(Outcome::Cancelled, "called off");
                return ctx.answer(&participation, Performative::Confirm, &report);
            };
            let (conversation, number) = (message.conversation_id.clone(), (plan.term, plan.round));
            let mut world = lock(&executor.world);
            if world.stays_dark.load(Ordering::Relaxed) {
                // The plan runs on and on.
                return;
            }
            match world.done.insert(conversation.clone(), number) {
                None => {
                    world.lit_since = Some(Instant::now());
                    let _ = executor.executed.send(conversation.to_string());
                }
                // A new leader asks for the plan that it took over.
                Some(former) if former == number => (),
                Some(former) => {
                    let line =
                        format!("{conversation} was carried out twice: {former:?}, {number:?}");
                    world.broken.push(line);
                    world.lit_since = Some(Instant::now());
                }
            }
            drop(world);
            let report = Report::new(Outcome::Done, "the lamp is lit");
            ctx.answer(&participation, Performative::Confirm, &report);
        })
    }
}

/// Sends one message that opens an exchange, and passes on the reports.
struct Asker {
    performative: Performative,
    protocol: Protocol,
    conversation: ConversationId,
    content: serde_json::Value,
    told: mpsc::UnboundedSender<Report>,
}

impl Agent for Asker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: Some(name("plan-requester")),
            performative: self.performative,
            protocol: self.protocol,
            conversation: self.conversation.clone(),
            content: std::mem::take(&mut self.content),
        };
        ctx.open(opening, PATIENCE, |asker: &mut Asker, answer, _| {
            if let ExchangeEvent::Message(message) = answer {
                let report = message.content_as::<Report>();
                let report = report.unwrap_or_else(|_| panic!("refused: {:?}", message.content));
                let _ = asker.told.send(report);
            }
        });
    }
}

/// A machine with a Plan Requester.
struct Machine {
    daemon: DaemonId,
    clock: Arc<Clock>,
    /// Survives the process, so that its incarnations get greater.
    services: HostServices,
    lives: Option<(Arc<MessageRouter>, JoinHandle<()>)>,
    /// Incarnation of the Plan Requester that runs, or ran last.
    incarnation: Arc<AtomicU64>,
}

/// All machines, and the truth.
pub(crate) struct Trial {
    network: Network,
    host: Arc<Host>,
    base: Arc<MessageRouter>,
    base_clock: Arc<Clock>,
    machines: Vec<Machine>,
    world: SharedWorld,
    executions: mpsc::UnboundedReceiver<String>,
    askers: usize,
    _lives: Vec<JoinHandle<()>>,
}

impl Trial {
    /// Opens all machines, and waits until a Plan Requester leads.
    pub(crate) async fn open(seed: u64) -> Trial {
        Trial::with_clocks_apart(seed, Duration::from_micros(APART_MICROS)).await
    }

    /// Like [`Trial::open`]; the clock of each machine has this distance from that of the one before
    /// when both are started.
    pub(crate) async fn with_clocks_apart(seed: u64, apart: Duration) -> Trial {
        let network = Network::new(seed);
        let ontology = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
        let map = pddl::parse_problem(DARK).into_result().expect("a problem");
        let mut resources = Resources::default();
        resources.insert(MemoryStore::default());
        let host = Arc::new(Host {
            mode: Mode::Centralized,
            journals: vec![name("journal")],
            resources,
            ..Host::new(ontology, map)
        });
        let base_clock = Clock::new(Duration::ZERO);
        let base = router(&network, "base", services(&base_clock));
        let world = SharedWorld::default();
        let (executed, executions) = mpsc::unbounded_channel();
        let executor = Executor { world: Arc::clone(&world), executed };
        let maintainer = Maintainer(Arc::clone(&world));
        let agents = [
            (Box::new(maintainer) as Box<dyn LaunchableAgent>, "domain-maintainer"),
            (built(&planning_agent::PLUGIN, "planning-agent", &host), "planning-agent"),
            (built(&journal::PLUGIN, "journal", &host), "journal"),
            (Box::new(executor), "plan-executor"),
        ];
        let lives = agents.into_iter().map(|(agent, id)| launch(agent, id, &base, false));
        let lives = lives.collect();
        let mut trial = Trial {
            network,
            host,
            base,
            base_clock,
            machines: Vec::new(),
            world,
            executions,
            askers: 0,
            _lives: lives,
        };
        let mut ahead = Duration::ZERO;
        for number in 0..LEADERS {
            let clock = Clock::new(ahead);
            ahead += apart;
            trial.machines.push(Machine {
                daemon: DaemonId::new(&format!("m{number}")).expect("a name"),
                services: services(&clock),
                clock,
                lives: None,
                incarnation: Arc::default(),
            });
            trial.start(number);
            // One of them leads before the other one starts.
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
        trial
    }

    fn start(&mut self, number: usize) {
        let machine = &mut self.machines[number];
        if machine.lives.is_some() {
            return;
        }
        let router = router(&self.network, machine.daemon.as_str(), machine.services.clone());
        let (host, incarnation) = (Arc::clone(&self.host), Arc::clone(&machine.incarnation));
        let of_agent = Arc::clone(&router);
        let task = tokio::spawn(async move {
            // As in a daemon, an agent that could not be launched is launched again.
            loop {
                let requester = built(&plan_requester::PLUGIN, "plan-requester", &host);
                let (mut task, number) = begin(requester, "plan-requester", &of_agent, true);
                incarnation.store(number.0, Ordering::Relaxed);
                match (&mut task.0).await {
                    Ok(ended) => tracing::warn!(?ended, "an agent has ended"),
                    Err(error) => assert!(!error.is_panic(), "an agent panicked"),
                }
                tokio::time::sleep(RESTART).await;
            }
        });
        machine.lives = Some((router, task));
    }

    fn kill(&mut self, number: usize) {
        if let Some((_, task)) = self.machines[number].lives.take() {
            self.network.kill(&self.machines[number].daemon);
            task.abort();
        }
    }

    // === asking ===

    fn asker(
        &mut self,
        performative: Performative,
        id: &str,
        content: serde_json::Value,
    ) -> mpsc::UnboundedReceiver<Report> {
        self.askers += 1;
        let (told, heard) = mpsc::unbounded_channel();
        let conversation = ConversationId::new(id);
        let is_kept = content.pointer("/times/start").is_some();
        let protocol = if is_kept { Protocol::StateChange } else { Protocol::Goal };
        let asker = Asker { performative, protocol, conversation, content, told };
        let id = format!("asker-{}", self.askers);
        self._lives.push(launch(Box::new(asker), &id, &self.base, false));
        heard
    }

    /// Asks for the lamp at these times, and returns the last report.
    pub(crate) async fn ask(&mut self, id: &str, times: GoalTimes) -> Report {
        self.follow(id, times).await.pop().expect("an answer")
    }

    /// Asks for the lamp at these times, and returns all reports up to the last.
    pub(crate) async fn follow(&mut self, id: &str, times: GoalTimes) -> Vec<Report> {
        let goal = Achieve::new("(lit lamp)", Keep::Achieve, 0);
        let request = Request::Schedule(Box::new(ScheduleGoal { goal, times }));
        let mut heard = self.asker(Performative::Request, id, value(&request));
        let mut reports = Vec::new();
        loop {
            let report = timeout(PATIENCE, heard.recv()).await.expect("in time").expect("it lives");
            let is_final = report.outcome.is_final();
            reports.push(report);
            if is_final {
                return reports;
            }
        }
    }

    /// Asks for the lamp in this many conversations, `g0`, `g1` …, and awaits no end.
    pub(crate) async fn ask_often(&mut self, times: usize) {
        let request = value(&Request::Achieve(Achieve::new("(lit lamp)", Keep::Achieve, 0)));
        for number in 0..times {
            drop(self.asker(Performative::Request, &format!("g{number}"), request.clone()));
            // The mailbox of the leader does not hold all of them.
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    pub(crate) async fn cancel(&mut self, id: &str) -> Report {
        let mut heard = self.asker(Performative::Cancel, id, serde_json::Value::Null);
        timeout(PATIENCE, heard.recv()).await.expect("in time").expect("it lives")
    }

    /// Returns the goals of the leader.
    pub(crate) async fn goals(&self) -> Vec<GoalStatus> {
        let ask = ResourceQuery { daemon: None, resource: Resource::Goals, agent: None };
        let answers = self.base.ask(ask, Duration::from_secs(2)).await;
        let read = |answer| serde_json::from_slice::<Vec<GoalStatus>>(answer).expect("goals");
        answers.iter().flat_map(|answer| read(answer)).collect()
    }

    pub(crate) async fn history_of(&self, id: &str) -> Vec<String> {
        let goals = self.goals().await;
        let goal = goals.into_iter().find(|goal| goal.conversation.as_str() == id);
        goal.expect("it is there").history.into_iter().map(|entry| entry.text).collect()
    }

    // === observing ===

    /// Waits for the next goal that is carried out, and returns its conversation.
    pub(crate) async fn executed(&mut self) -> String {
        timeout(PATIENCE, self.executions.recv()).await.expect("in time").expect("it lives")
    }

    /// Waits for the next goal that is carried out, at most for this time.
    pub(crate) async fn await_execution(&mut self, within: Duration) {
        while self.executions.try_recv().is_ok() {}
        let _ = timeout(within, self.executions.recv()).await;
    }

    pub(crate) async fn nothing_is_executed(&mut self, within: Duration) {
        let executed = timeout(within, self.executions.recv()).await;
        assert!(executed.is_err(), "{executed:?}");
    }

    /// Returns how many occurrences were carried out.
    pub(crate) fn count(&self) -> usize {
        lock(&self.world).done.len()
    }

    pub(crate) fn broken(&self) -> Vec<String> {
        lock(&self.world).broken.clone()
    }

    /// Returns the incarnation of the Plan Requester that runs, or ran last, on each machine.
    pub(crate) fn incarnations(&self) -> Vec<u64> {
        let of = |machine: &Machine| machine.incarnation.load(Ordering::Relaxed);
        self.machines.iter().map(of).collect()
    }

    /// Returns the end of the history of all goals, for people.
    pub(crate) async fn last(&self) -> Vec<String> {
        let goals = self.goals().await;
        let last = |goal: GoalStatus| {
            let history = goal.history.iter().rev().take(4).rev().map(|entry| entry.text.clone());
            format!("{}: {:?} {:?}", goal.conversation, goal.due, history.collect::<Vec<_>>())
        };
        goals.into_iter().map(last).collect()
    }

    // === faults ===

    pub(crate) fn keep_dark(&self) {
        lock(&self.world).stays_dark.store(true, Ordering::Relaxed);
    }

    /// Makes the clock of one machine jump, in seconds.
    pub(crate) fn jump(&self, number: usize, seconds: i64) {
        self.machines[number].clock.jumped.fetch_add(seconds, Ordering::Relaxed);
    }

    /// Makes all clocks jump.
    pub(crate) fn jump_all(&self, seconds: i64) {
        (0..LEADERS).for_each(|number| self.jump(number, seconds));
    }

    /// Sets all clocks to the one that is furthest ahead.
    pub(crate) fn align_clocks(&self) {
        let clocks = self.machines.iter().map(|machine| &machine.clock);
        let all: BTreeSet<_> = clocks.map(|clock| clock.jumped.load(Ordering::Relaxed)).collect();
        let most = all.last().copied().unwrap_or_default() + 8 * 3_600;
        for machine in &self.machines {
            machine.clock.jumped.store(most, Ordering::Relaxed);
        }
        self.base_clock.jumped.store(most, Ordering::Relaxed);
    }

    /// Kills the leader, whose incarnation is the smallest, and starts it again after some seconds.
    pub(crate) async fn kill_leader(&mut self) {
        let alive = (0..LEADERS).filter(|number| self.machines[*number].lives.is_some());
        let leader =
            alive.min_by_key(|number| self.machines[*number].incarnation.load(Ordering::Relaxed));
        let Some(leader) = leader else { return self.restart_all() };
        self.kill(leader);
        tokio::time::sleep(Duration::from_secs(2)).await;
        self.restart_all();
        tokio::time::sleep(Duration::from_secs(1)).await;
    }

    /// Kills all machines with a Plan Requester.
    pub(crate) fn kill_all(&mut self) {
        (0..LEADERS).for_each(|number| self.kill(number));
    }

    pub(crate) fn restart_all(&mut self) {
        (0..LEADERS).for_each(|number| self.start(number));
    }

    /// Lets a machine sleep for some seconds: it dies, and its clock goes on meanwhile.
    pub(crate) async fn sleep_machine(&mut self, number: usize, seconds: u64) {
        self.kill(number);
        tokio::time::sleep(Duration::from_secs(seconds)).await;
        self.start(number);
    }
}

fn services(clock: &Arc<Clock>) -> HostServices {
    let simulation: Arc<dyn MachineSimulation> = Arc::<Clock>::clone(clock);
    HostServices::simulated(simulation, None)
}

fn router(network: &Network, daemon: &str, services: HostServices) -> Arc<MessageRouter> {
    let daemon = DaemonId::new(daemon).expect("a name");
    let ecosystem = EcosystemId::new("home").expect("a name");
    let router = MessageRouter::on(services, ecosystem, daemon.clone(), AgentSettings::default());
    router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
    router
}

fn built(plugin: &PluginEntry, id: &str, host: &Arc<Host>) -> Box<dyn LaunchableAgent> {
    let (config, host) = (serde_json::json!({}).into(), Arc::clone(host));
    (plugin.build)(Blueprint { id: name(id), driver: String::new(), config, host }).expect("built")
}

/// Launches an agent that runs up to the end of the trial.
fn launch(
    agent: Box<dyn LaunchableAgent>,
    id: &str,
    router: &Arc<MessageRouter>,
    stands_by: bool,
) -> JoinHandle<()> {
    let mut running = begin(agent, id, router, stands_by).0;
    tokio::spawn(async move {
        let ended = (&mut running.0).await;
        assert!(!matches!(&ended, Err(error) if error.is_panic()), "an agent panicked: {ended:?}");
    })
}

fn begin(
    agent: Box<dyn LaunchableAgent>,
    id: &str,
    router: &Arc<MessageRouter>,
    stands_by: bool,
) -> (AbortOnDrop, Incarnation) {
    let incarnation = router.host_services().next_incarnation();
    let task = agent.launch(LaunchContext {
        id: name(id),
        incarnation,
        router: Arc::clone(router),
        ontology: Arc::from("d"),
        stopping: CancellationToken::new(),
        has_replicas: stands_by,
        via: [].into(),
    });
    (AbortOnDrop(task), incarnation)
}

/// A running agent that is aborted when this is dropped.
struct AbortOnDrop(JoinHandle<Result<(), agent::LaunchError>>);

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        self.0.abort();
    }
}

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}
