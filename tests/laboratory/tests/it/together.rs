//! Joint actions on bad links: two of three carriers lift a table. One of them dies, fails or gives up at
//! a moment that a seed draws. The others begin together, let go together, and reach the goal without it.
//!
//! The table itself ends nothing: a carrier that is left alone holds on until it is told to stop.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Keep, Method, Outcome, Report};
use acl::{DaemonId, Message, Millis, Performative, Protocol};
use actuator::{
    BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact, facts_of,
    model_of,
};
use agent::{AgentSettings, Mode};
use substrate::faulty::Network;
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, timeout};

use crate::house::sayer::Sayer;
use crate::house::{House, launch, lossy};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing :action-costs)
    (:types agent table - object)
    (:predicates (moved ?t - table))
    (:functions (total-cost) - number))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects desk - table)
    (:init (= (total-cost) 0)) (:goal (and)) (:metric minimize (total-cost)))";

const CARRIERS: [&str; 3] = ["ann", "bob", "cyd"];

/// Time that carrying takes.
const CARRYING: Duration = Duration::from_millis(500);

/// How long after the last announcement the goal is asked for.
const SETTLING: Duration = Duration::from_secs(4);

/// Bound on the time until a goal ends, with a death and with lost messages.
const ENDS_WITHIN: Duration = Duration::from_secs(120);

/// Number of seeds for each flow.
const SEEDS: u64 = 120;

/// A moment at which a carrier is struck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Moment {
    /// The first request to carry is sent.
    Requested,
    /// The first carrier has agreed.
    Ready,
    /// The first carrier is told to begin.
    Told,
    /// Both carriers hold the table.
    Carrying,
}

const MOMENTS: [Moment; 4] = [Moment::Requested, Moment::Ready, Moment::Told, Moment::Carrying];

impl Moment {
    /// Returns the moment at which a message is sent; `None` for any other message.
    fn of(message: &Message) -> Option<Moment> {
        Some(match message.performative {
            Performative::Request if message.content["act"] == "act" => Moment::Requested,
            Performative::Agree if message.content["token"].is_object() => Moment::Ready,
            Performative::AcceptProposal if message.protocol == Some(Protocol::Action) => {
                Moment::Told
            }
            _ => return None,
        })
    }
}

/// What happens to the struck carrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Blow {
    Nothing,
    /// Its machine is gone.
    Dies,
    /// Its machine is gone, and comes back at once, with an agent that remembers nothing.
    Restarts,
    /// Its device fails from now on.
    Breaks,
    /// Its machine is gone, and that of the Plan Executor.
    DiesWithExecutor,
}

/// The table, and those that hold it.
#[derive(Default)]
struct Table {
    /// The partner of each carrier that holds the table.
    held: BTreeMap<&'static str, String>,
    moves: u32,
    /// Whether a carrier was told that all parts are done.
    is_told: bool,
    /// When a carrier began to hold the table alone, or was left alone.
    alone_since: Option<Instant>,
    /// The longest time for which one carrier held the table alone.
    alone_max: Duration,
}

impl Table {
    /// Whether two carriers hold the table together.
    fn is_lifted(&self) -> bool {
        self.held.iter().any(|(carrier, partner)| {
            self.held.get(partner.as_str()).is_some_and(|other| other == carrier)
        })
    }

    fn look(&mut self) {
        let is_alone = !self.held.is_empty() && !self.is_lifted();
        match self.alone_since {
            None if is_alone => self.alone_since = Some(Instant::now()),
            Some(since) if !is_alone => {
                self.alone_max = self.alone_max.max(since.elapsed());
                self.alone_since = None;
            }
            _ => (),
        }
    }
}

type SharedTable = Arc<watch::Sender<Table>>;

/// A hold on the table. Dropping it lets go.
struct Hold(SharedTable, &'static str);

impl Drop for Hold {
    fn drop(&mut self) {
        self.0.send_modify(|table| {
            table.held.remove(self.1);
            table.look();
        });
    }
}

struct Carrier {
    agent: &'static str,
    table: SharedTable,
    /// Whether it is broken.
    broken: watch::Receiver<bool>,
}

impl Device for Carrier {
    type Yield = ();

    fn describe(&self) -> Description {
        let agent = self.agent;
        let model = model_of(&format!(
            "(define (agent {agent}) (:domain d) (:objects {agent} - agent)
                (:action carry :agent (?a ?b - agent) :parameters (?t - table)
                    :effect (and (moved ?t) (increase (total-cost) 1))))"
        ));
        let arguments = [("one", "?a"), ("other", "?b")];
        let method = Method::new("carry", &arguments, Millis(CARRYING * 40).0);
        Description { model, methods: [("carry".to_owned(), method)].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        facts_of(if self.table.borrow().is_told { "(moved desk)" } else { "" })
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let (agent, table, mut broken) = (self.agent, Arc::clone(&self.table), self.broken.clone());
        let (one, other) = (call.arguments["one"].clone(), call.arguments["other"].clone());
        let partner = if one == agent { other } else { one };
        let carrying = async move {
            table.send_modify(|table| {
                table.held.insert(agent, partner);
                table.look();
            });
            let _hold = Hold(Arc::clone(&table), agent);
            let mut seen = table.subscribe();
            loop {
                let is_there = |table: &Table| table.is_lifted() || table.moves > 0;
                seen.wait_for(is_there).await.expect("the sender is here");
                let let_go = seen.wait_for(|table| !table.is_lifted());
                if table.borrow().moves > 0 || timeout(CARRYING, let_go).await.is_err() {
                    break;
                }
            }
            // The one that notices first moves the table for both, and both are done.
            table.send_modify(|table| {
                if table.moves == 0 {
                    table.moves = 1;
                    table.held.clear();
                    table.look();
                }
            });
            Ok(())
        };
        Box::pin(async move {
            tokio::select! {
                biased;
                _ = broken.wait_for(|broken| *broken) => {
                    Err(MethodFailure::Driver("hold the table".to_owned()))
                }
                carried = carrying => carried,
            }
        })
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        self.table.send_modify(|table| table.is_told = true);
        MethodResult::default()
    }
}

/// What one seed draws.
#[derive(Clone, Debug)]
struct Draw {
    mode: Mode,
    moment: Moment,
    blow: Blow,
    victim: &'static str,
    /// How long after the moment it strikes.
    after: Duration,
    loss: f64,
}

impl Draw {
    fn of(seed: u64, mode: Mode, loss: f64) -> Draw {
        let mut random = fastrand::Rng::with_seed(seed);
        Draw {
            mode,
            moment: MOMENTS[random.usize(..MOMENTS.len())],
            blow: [Blow::Nothing, Blow::Dies, Blow::Breaks, Blow::Restarts][random.usize(..4)],
            // The plan is made with the first ones.
            victim: CARRIERS[random.usize(..2)],
            after: Duration::from_micros(random.u64(..20_000)),
            loss,
        }
    }
}

/// What happened in one seed.
struct Played {
    said: Vec<Report>,
    moves: u32,
    alone_max: Duration,
    /// Time from the blow to the end of the goal; `None` if there was no blow.
    recovered_in: Option<Duration>,
}

fn daemon_of(agent: &str) -> DaemonId {
    DaemonId::new(&format!("of-{agent}")).expect("a name")
}

async fn play(seed: u64, draw: Draw) -> Played {
    let network = Network::new(seed);
    let house = House::new(draw.mode, DOMAIN, PROBLEM, Vec::new());
    let table = SharedTable::default();
    let reasoning = house.machine_on("reasoning", &network);
    let mut lives = vec![
        launch(house.built(&domain_maintainer::PLUGIN), "domain-maintainer", &reasoning, false),
        launch(house.built(&planning_agent::PLUGIN), "planning-agent", &reasoning, false),
        launch(house.built(&plan_executor::PLUGIN), "plan-executor", &reasoning, false),
        launch(house.built(&plan_requester::PLUGIN), "plan-requester", &reasoning, false),
    ];
    let (mut machines, mut victim) = (Vec::new(), None);
    let (breaking, broken) = watch::channel(false);
    let (_works, working) = watch::channel(false);
    for agent in CARRIERS {
        let machine = house.machine_on(daemon_of(agent).as_str(), &network);
        let broken = if agent == draw.victim { broken.clone() } else { working.clone() };
        let carrier = Carrier { agent, table: Arc::clone(&table), broken };
        let life = launch(house.actuator(agent, carrier), agent, &machine, false);
        match agent == draw.victim {
            true => victim = Some(life),
            false => lives.push(life),
        }
        machines.push(machine);
    }
    tokio::time::sleep(SETTLING).await;
    network.set_conditions(lossy(draw.loss));
    let (sender, mut moments) = mpsc::unbounded_channel();
    network.tap(move |_, _, payload| {
        let message = serde_json::from_slice::<Message>(payload).ok();
        if let Some(moment) = message.as_ref().and_then(Moment::of) {
            // The test has ended.
            let _ = sender.send(moment);
        }
    });
    let (asker, mut reports) = Sayer::of_goal("(moved desk)", Keep::Achieve);
    lives.push(launch(Box::new(asker), "asker", &house.machine_on("people", &network), false));
    let struck_at: Cell<Option<Instant>> = Cell::new(None);
    let striking = async {
        match draw.moment {
            Moment::Carrying => {
                let mut seen = table.subscribe();
                seen.wait_for(Table::is_lifted).await.expect("the sender is here");
            }
            moment => while moments.recv().await != Some(moment) {},
        }
        tokio::time::sleep(draw.after).await;
        match draw.blow {
            Blow::Nothing => (),
            Blow::Breaks => drop(breaking.send(true)),
            Blow::Dies | Blow::DiesWithExecutor => {
                victim.iter().for_each(tokio::task::JoinHandle::abort);
                network.kill(&daemon_of(draw.victim));
            }
            Blow::Restarts => {
                victim.iter().for_each(tokio::task::JoinHandle::abort);
                network.kill(&daemon_of(draw.victim));
                let machine = house.machine_on(daemon_of(draw.victim).as_str(), &network);
                let (table, broken) = (Arc::clone(&table), working.clone());
                let carrier = Carrier { agent: draw.victim, table, broken };
                drop(launch(house.actuator(draw.victim, carrier), draw.victim, &machine, false));
                machines.push(machine);
            }
        }
        struck_at.set((draw.blow != Blow::Nothing).then(Instant::now));
        if draw.blow == Blow::DiesWithExecutor {
            network.kill(&DaemonId::new("reasoning").expect("a name"));
            let mut seen = table.subscribe();
            seen.wait_for(|table| table.held.is_empty()).await.expect("the sender is here");
            return;
        }
        std::future::pending::<()>().await;
    };
    let mut said: Vec<Report> = Vec::new();
    let ending = async {
        while !said.last().is_some_and(|report| report.outcome.is_final()) {
            said.push(reports.recv().await.expect("the asker lives"));
        }
    };
    let is_in_time = timeout(ENDS_WITHIN, async {
        tokio::select! { () = striking => (), () = ending => () }
    });
    let is_in_time = is_in_time.await.is_ok();
    table.send_modify(Table::look);
    let (moves, alone_max) = (table.borrow().moves, table.borrow().alone_max);
    lives.iter().for_each(tokio::task::JoinHandle::abort);
    assert!(is_in_time, "seed {seed}, {draw:?}: no end; {said:#?}");
    let recovered_in = struck_at.get().map(|at| at.elapsed());
    Played { said, moves, alone_max, recovered_in }
}

/// Plays seeds in both flows, and checks each. Returns the longest time for which a carrier held the
/// table alone, and the longest time from a blow to the end of the goal.
fn play_all(loss: f64, blows: &[Blow]) -> (Duration, Duration) {
    let (mut struck, mut alone_max, mut recovered_max) = (0, Duration::ZERO, Duration::ZERO);
    for (seed, mode) in
        (0..SEEDS).flat_map(|seed| [(seed, Mode::Centralized), (seed, Mode::Decentralized)])
    {
        let draw = Draw::of(seed, mode, loss);
        if !blows.contains(&draw.blow) {
            continue;
        }
        let mut runtime = tokio::runtime::Builder::new_current_thread();
        let runtime = runtime.enable_all().start_paused(true).build().expect("a runtime");
        let played = runtime.block_on(play(seed, draw.clone()));
        let story = || format!("seed {seed}, {draw:?}: {:#?}", played.said);
        let end = played.said.last().map(|report| report.outcome);
        assert_eq!((end, played.moves), (Some(Outcome::Done), 1), "{}", story());
        struck += u32::from(played.recovered_in.is_some());
        alone_max = alone_max.max(played.alone_max);
        recovered_max = recovered_max.max(played.recovered_in.unwrap_or_default());
    }
    println!("{struck} blows; alone for {alone_max:?}, goal after {recovered_max:?} at most");
    assert!(struck > 0 || blows == [Blow::Nothing], "nothing happened");
    (alone_max, recovered_max)
}

#[test]
fn carriers_begin_together_and_let_go_together() {
    let (alone, recovered) = play_all(0.0, &[Blow::Nothing, Blow::Breaks]);
    assert!(alone <= Duration::from_millis(10), "{alone:?}");
    assert!(recovered <= Duration::from_secs(2), "{recovered:?}");
}

/// The others are not taken for failed, and go on with the third one.
#[test]
fn a_carrier_lets_go_if_its_partner_has_died() {
    let (alone, recovered) = play_all(0.0, &[Blow::Dies, Blow::Restarts]);
    let grace = AgentSettings::default().grace;
    assert!(alone <= grace + Duration::from_millis(10), "{alone:?}");
    assert!(recovered <= Duration::from_secs(3), "{recovered:?}");
}

#[test]
fn carriers_reach_the_goal_on_bad_links() {
    let (alone, _) = play_all(0.2, &[Blow::Nothing, Blow::Breaks]);
    assert!(alone <= Duration::from_millis(500), "{alone:?}");
    let (alone, recovered) = play_all(0.2, &[Blow::Dies, Blow::Restarts]);
    assert!(alone <= AgentSettings::default().grace + Duration::from_millis(500), "{alone:?}");
    assert!(recovered <= Duration::from_secs(30), "{recovered:?}");
}

/// Without a Plan Executor, the actuator itself ends the action.
#[test]
fn a_carrier_lets_go_although_the_plan_executor_has_died_too() {
    for victim in [CARRIERS[0], CARRIERS[1]] {
        let (moment, blow) = (Moment::Carrying, Blow::DiesWithExecutor);
        let after = Duration::from_millis(100);
        let draw = Draw { mode: Mode::Centralized, moment, blow, victim, after, loss: 0.0 };
        let mut runtime = tokio::runtime::Builder::new_current_thread();
        let runtime = runtime.enable_all().start_paused(true).build().expect("a runtime");
        let Played { moves, alone_max, .. } = runtime.block_on(play(0, draw));
        let grace = AgentSettings::default().grace;
        assert!(moves == 0 && alone_max >= grace, "{victim}: {moves} {alone_max:?}");
        assert!(alone_max <= grace + Duration::from_millis(100), "{victim}: {alone_max:?}");
    }
}
