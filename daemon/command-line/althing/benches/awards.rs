//! Awards per second: calls for proposals, bids, and the choice, for many goals at once.
//!
//! ```text
//! cargo bench -p althing --bench awards
//! ```
//!
//! Twenty bidders run in four processes that are linked by Zenoh over Unix sockets; the reasoning
//! agents run in a fifth. Every goal is another job that any bidder can do, so every bid is planned
//! for that goal alone. A job takes no time, so that bidders are soon free again. The clock runs
//! from the first request until the last job is done, which is later than its award. First comes a
//! burst of seven goals (the burst of rmf_demos#302), then all the others at once.
//!
//! Only complete awards count: all twenty bidders must have answered the call and proposed before
//! the award. The Plan Requester does not wait for a bidder that carries out the job of another
//! goal when the call is sent, so a few awards are not complete.

mod support;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{Method, Methods, Outcome as Ended, Partition};
use acl::{AgentId, Millis};
use actuator::{
    Actuator, BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact,
};
use agent::{Blueprint, Mode, PluginEntry};
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use support::overhearing::Award;
use support::{Entry, Outcome, PATIENCE};

/// Allocator of the benchmark: the same as in the daemon.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const PROCESSES: usize = 4;
const BIDDERS_EACH: usize = 5;
const BURST: usize = 7;
const GOALS: usize = 200;
const AIM_PER_SECOND: f64 = 200.0;

const ECOSYSTEM: &str = "awards";

const REASONING: &[PluginEntry] = &[
    domain_maintainer::PLUGIN,
    plan_requester::PLUGIN,
    planning_agent::PLUGIN,
    plan_executor::PLUGIN,
];

const DOMAIN: &str = "(define (domain awards)
    (:requirements :strips :typing :action-costs)
    (:types worker job)
    (:predicates (done ?j - job))
    (:functions (total-cost)))";

#[tokio::main]
async fn main() -> Outcome<()> {
    let arguments: Vec<_> = std::env::args().collect();
    if let [_, flag, folder, process] = arguments.as_slice()
        && flag == "--bidders"
    {
        return bid(Path::new(folder), process.parse()?).await;
    }
    let goals = if support::is_whole() { GOALS } else { BURST };
    let folder = tempfile::Builder::new().prefix("alt-").tempdir()?;
    let (router, overheard) =
        support::daemon_overheard(folder.path(), ECOSYSTEM, "reasoning").await?;
    let host = Arc::new(support::host(DOMAIN, &map(BURST + goals), Mode::Decentralized)?);
    for plugin in REASONING {
        let entry = Entry {
            name: AgentId::new(plugin.name)?,
            plugin: plugin.name.to_owned(),
            daemon: "reasoning".to_owned(),
            config: serde_json::Value::Null,
        };
        let agent = support::build(plugin, &entry, &host)?;
        support::launch(&entry.name, agent, &router, ECOSYSTEM);
    }
    let mut children = Vec::new();
    for process in 0..PROCESSES {
        let path = folder.path().display().to_string();
        children.push(support::again(&["--bidders", &path, &process.to_string()])?);
    }
    let (keyboard, mut terminal) = Keyboard::with_terminal();
    support::launch(&AgentId::new("user")?, Box::new(keyboard), &router, ECOSYSTEM);
    let bidders = (0..PROCESSES * BIDDERS_EACH).map(|number| format!("bidder-{number}"));
    support::await_offers(&router, &bidders.collect::<BTreeSet<_>>()).await?;

    let took = ask(&mut terminal, 0..BURST).await?;
    let served = support::verdict(overheard.awards().len() >= BURST);
    println!(
        "{BURST} goals at once: done within {:.1} ms, aim all awarded: {served}",
        took.as_secs_f64() * 1e3
    );
    let worked = || -> Outcome<f64> {
        Ok(support::processor_time(&children)? + support::own_processor_time()?)
    };
    let before = worked()?;
    let took = ask(&mut terminal, BURST..BURST + goals).await?;
    let each = (worked()? - before) / goals as f64;
    let rate = whole(&overheard.awards()) as f64 / took.as_secs_f64();
    let verdict = support::verdict(rate >= AIM_PER_SECOND);
    println!(
        "{goals} goals at once, {} bidders in {PROCESSES} processes: {rate:.0} awards per second, \
         aim ≥ {AIM_PER_SECOND}: {verdict}",
        PROCESSES * BIDDERS_EACH
    );
    println!("    processor time of all five processes: {:.1} ms per award", each * 1e3);
    support::reached()
}

/// Counts the complete awards: those that were made after all bidders had answered and proposed.
fn whole(awards: &[Award]) -> usize {
    let bidders = PROCESSES * BIDDERS_EACH;
    let is_whole = |it: &&Award| it.answers == bidders && it.proposals == bidders;
    let whole = awards.iter().filter(is_whole).count();
    println!(
        "    {whole} of {} awards have the answers and proposals of all {bidders}; no other counts",
        awards.len()
    );
    let fewest = awards.iter().map(|award| award.answers).min();
    if whole < awards.len() {
        println!("    the fewest that had answered: {}", fewest.unwrap_or_default());
    }
    whole
}

fn map(jobs: usize) -> String {
    let jobs: Vec<_> = (0..jobs).map(|job| format!("job-{job}")).collect();
    format!(
        "(define (problem map) (:domain awards) (:objects {} - job) (:init) (:goal (and))
            (:metric minimize (total-cost)))",
        jobs.join(" ")
    )
}

/// Requests these jobs, all at once, and waits until the last one is done.
async fn ask(terminal: &mut Terminal, jobs: std::ops::Range<usize>) -> Outcome<Duration> {
    let (began, count) = (Instant::now(), jobs.len());
    for job in jobs {
        let wish = GoalRequest {
            goal: format!("(done job-{job})"),
            keep: acl::content::Keep::Achieve,
            priority: 0,
            partition: Partition::Pursue,
        };
        terminal.requests.send(UserRequest::RequestGoal(wish)).await?;
    }
    let mut done = 0;
    while done < count {
        let heard = tokio::time::timeout(PATIENCE, terminal.events.recv()).await?;
        match heard.ok_or("the keyboard has ended")? {
            UserEvent::Report(_, report) if report.outcome == Ended::Done => done += 1,
            heard if heard.is_final() => return Err(format!("{heard:?}").into()),
            _ => (),
        }
    }
    Ok(began.elapsed())
}

// === bidders ===

/// Runs a process of bidders until it is killed.
async fn bid(folder: &Path, process: usize) -> Outcome<()> {
    let router = support::daemon(
        folder,
        ECOSYSTEM,
        &format!("bidders-{process}"),
        &["reasoning".to_owned()],
    )
    .await?;
    let host = Arc::new(support::host(DOMAIN, &map(BURST + GOALS), Mode::Decentralized)?);
    for number in 0..BIDDERS_EACH {
        let id = AgentId::new(&format!("bidder-{}", process * BIDDERS_EACH + number))?;
        let blueprint = Blueprint {
            id: id.clone(),
            driver: String::new(),
            config: Arc::default(),
            host: Arc::clone(&host),
        };
        let bidder = Actuator::build(&blueprint, Bidder { id: id.clone() })?;
        support::launch(&id, bidder, &router, ECOSYSTEM);
    }
    std::future::pending().await
}

/// A device that does any job at once.
struct Bidder {
    id: AgentId,
}

impl Device for Bidder {
    type Yield = ();

    fn describe(&self) -> Description {
        let id = &self.id;
        let text = format!(
            "(define (agent {id}) (:domain awards) (:objects {id} - worker)
                (:action do :agent ?w - worker :parameters (?j - job)
                    :effect (and (done ?j) (increase (total-cost) 1))))"
        );
        let model = pddl::parse_action_model(&text).into_result().expect("invariant: it is ours");
        let method = Method {
            method: "do".to_owned(),
            arguments: Default::default(),
            timeout: Millis(Duration::from_secs(1)),
        };
        Description { model, methods: Methods::from([("do".to_owned(), method)]) }
    }

    fn facts(&self) -> Vec<OwnFact> {
        Vec::new()
    }

    fn perform(&mut self, _call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        Box::pin(std::future::ready(Ok(())))
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        MethodResult { detail: "done".to_owned(), observations: Vec::new() }
    }
}
