//! Tests of the agents on a network in memory: members that leave, stay silent, or lie.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{CallForProposals, JointPlanPart, PartStep, Reason, value};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Message, Performative, Protocol};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, EcosystemFolder, ExchangeEvent,
    ExchangeOpening, Host, LaunchContext, LaunchableAgent, MessageRouter, Participation, Resource,
    Resources,
};
use fastrand::Rng;
use serde_json::json;
use skeleton::Projection;
use substrate::Substrate;
use substrate::faulty::{self, LinkConditions};
use substrate::memory::Network;
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

use crate::{JointRequest, JointRequester, JointResult};

/// Time that plannings may take which end by themselves.
const PATIENCE: Duration = Duration::from_secs(60);

const PORTER_DOMAIN: &str = "(define (domain hall) (:requirements :typing)
  (:types thing - object)
  (:predicates (open) (there ?t - thing) (:private (holds ?t - thing)))
  (:action take :parameters (?t - thing) :precondition (open) :effect (holds ?t))
  (:action put :parameters (?t - thing) :precondition (holds ?t) :effect (there ?t)))";
const PORTER_PROBLEM: &str = "(define (problem p) (:domain hall) (:objects box - thing)
  (:init) (:goal (there box)))";
const OPENER_DOMAIN: &str = "(define (domain hall) (:requirements :typing)
  (:predicates (open) (:private (turned)))
  (:action turn :parameters () :effect (turned))
  (:action swing :parameters () :precondition (turned) :effect (open)))";
const OPENER_PROBLEM: &str = "(define (problem p) (:domain hall) (:init) (:goal (and)))";

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// A daemon of the network, with one agent. It is gone when the value is.
struct HallDaemon {
    stopping: CancellationToken,
    _router: Arc<MessageRouter>,
    _port: Arc<dyn Substrate>,
}

impl Drop for HallDaemon {
    fn drop(&mut self) {
        self.stopping.cancel();
    }
}

/// A network on which daemons are opened.
trait HallNetwork {
    fn connect(&self, daemon: DaemonId, router: &Arc<MessageRouter>) -> Arc<dyn Substrate>;
}

impl HallNetwork for Network {
    fn connect(&self, daemon: DaemonId, router: &Arc<MessageRouter>) -> Arc<dyn Substrate> {
        self.open(daemon, Arc::<MessageRouter>::clone(router) as _)
    }
}

impl HallNetwork for faulty::Network {
    fn connect(&self, daemon: DaemonId, router: &Arc<MessageRouter>) -> Arc<dyn Substrate> {
        self.open(daemon, Arc::<MessageRouter>::clone(router) as _)
    }
}

fn host(network: &impl HallNetwork, id: &str, agent: Box<dyn LaunchableAgent>) -> HallDaemon {
    let ecosystem = EcosystemId::new("hall").expect("a name");
    let daemon = DaemonId::new(id).expect("a name");
    let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
    let port = network.connect(daemon, &router);
    router.connect(Arc::clone(&port));
    let stopping = CancellationToken::new();
    drop(agent.launch(LaunchContext {
        id: name(id),
        incarnation: Incarnation(1),
        router: Arc::clone(&router),
        ontology: Arc::from("hall"),
        stopping: stopping.clone(),
        has_replicas: false,
        via: [].into(),
    }));
    HallDaemon { stopping, _router: router, _port: port }
}

/// Hosts a factored agent with these files.
fn member(network: &impl HallNetwork, folder: &Path, id: &str, texts: (&str, &str)) -> HallDaemon {
    let path = |kind: &str| folder.join(format!("{kind}-{id}.pddl"));
    std::fs::write(path("domain"), texts.0).expect("a file");
    std::fs::write(path("problem"), texts.1).expect("a file");
    let ontology = pddl::parse_domain("(define (domain hall))").value.expect("a domain");
    let map = "(define (problem map) (:domain hall) (:init) (:goal (and)))";
    let map = pddl::parse_problem(map).value.expect("a map");
    let mut resources = Resources::default();
    resources.insert(EcosystemFolder(folder.to_owned()));
    let blueprint = Blueprint {
        id: name(id),
        driver: String::new(),
        config: json!({
            "domain": format!("domain-{id}.pddl"),
            "problem": format!("problem-{id}.pddl"),
            "part": format!("part-{id}"),
        })
        .into(),
        host: Arc::new(Host { resources, ..Host::new(ontology, map) }),
    };
    host(network, id, crate::build(blueprint).expect("right"))
}

/// Launches a requester for these members.
fn request(
    network: &impl HallNetwork,
    members: &[&str],
    within: Duration,
) -> (HallDaemon, oneshot::Receiver<JointResult>) {
    let members: BTreeSet<AgentId> = members.iter().map(|member| name(member)).collect();
    let (sender, result) = oneshot::channel();
    let requester = JointRequester::new(JointRequest { members, within }, sender);
    (host(network, "requester", Box::new(requester)), result)
}

async fn result(receiver: oneshot::Receiver<JointResult>) -> JointResult {
    let result = tokio::time::timeout(PATIENCE * 2, receiver).await;
    result.expect("it ends in time").expect("the requester tells the result")
}

fn reason(result: JointResult) -> String {
    result.plan.expect_err("there is no plan")
}

#[tokio::test]
async fn members_agree_to_a_joint_plan() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let _opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let _porter = member(&network, folder.path(), "porter", (PORTER_DOMAIN, PORTER_PROBLEM));
    let (_requester, receiver) = request(&network, &["opener", "porter"], PATIENCE);
    let found = result(receiver).await;
    assert_eq!(found.cost, 4.0);
    let skeleton = found.plan.expect("a plan");
    assert_eq!(skeleton.owners, ["opener", "porter", "porter"]);
    // The private step is in the agent's own file only.
    let part = std::fs::read_to_string(folder.path().join("part-opener")).expect("written");
    assert_eq!(part, format!("{}\n1 (turn)\n1 (swing)\n", skeleton.digest));
}

#[tokio::test]
async fn no_plan_is_proved_and_names_the_members() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let unable =
        OPENER_DOMAIN.replace(":effect (turned)", ":precondition (turned) :effect (turned)");
    let _opener = member(&network, folder.path(), "opener", (&unable, OPENER_PROBLEM));
    let _porter = member(&network, folder.path(), "porter", (PORTER_DOMAIN, PORTER_PROBLEM));
    let (_requester, receiver) = request(&network, &["opener", "porter"], PATIENCE);
    let found = result(receiver).await;
    assert!(found.is_proved_impossible);
    assert_eq!(reason(found), "proven: there is no joint plan of `opener`, `porter`");
}

#[tokio::test]
async fn a_member_that_leaves_is_planned_without() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let (asked, is_asked) = oneshot::channel();
    let silent = SilentMember { tells: None, asked: Some(asked) };
    let silent = host(&network, "porter", Box::new(silent));
    let second = member(&network, folder.path(), "second", (PORTER_DOMAIN, PORTER_PROBLEM));
    let members = ["opener", "porter", "second"];
    let (_requester, receiver) = request(&network, &members, PATIENCE);
    // The silent member answers no query, so nothing is planned until it leaves.
    is_asked.await.expect("it is asked for its projection");
    drop(silent);
    let skeleton = result(receiver).await.plan.expect("a plan of the others");
    assert_eq!(skeleton.owners, ["opener", "second", "second"]);
    drop((opener, second));
}

#[tokio::test]
async fn a_member_that_leaves_with_its_part_is_planned_without() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let _opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let (asked, is_called) = oneshot::channel();
    // It tells of an action that makes the other's work needless, and is silent when it is called.
    let tells = Some(promise("porter"));
    let porter = host(&network, "porter", Box::new(SilentMember { tells, asked: Some(asked) }));
    let _second = member(&network, folder.path(), "second", (PORTER_DOMAIN, PORTER_PROBLEM));
    let members = ["opener", "porter", "second"];
    let (_requester, receiver) = request(&network, &members, PATIENCE);
    is_called.await.expect("it is called for its part");
    drop(porter);
    let skeleton = result(receiver).await.plan.expect("a plan of the others");
    assert_eq!(skeleton.owners, ["opener", "second", "second"]);
}

#[tokio::test]
async fn a_silent_member_is_named_at_the_deadline() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let _opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let tells = Some(promise("porter"));
    let _porter = host(&network, "porter", Box::new(SilentMember { tells, asked: None }));
    let within = Duration::from_millis(700);
    let (requester, receiver) = request(&network, &["opener", "porter"], within);
    assert_eq!(reason(result(receiver).await), "after 0.7 s `porter` did not answer");
    // Nor does one that is not there.
    drop(requester);
    let (_requester, receiver) = request(&network, &["opener", "absent"], within);
    assert_eq!(reason(result(receiver).await), "after 0.7 s `absent` did not answer");
}

#[tokio::test]
async fn a_member_that_refuses_what_it_promises_is_named() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let _opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let _porter = host(&network, "porter", Box::new(LyingMember(promise("porter"))));
    let (_requester, receiver) = request(&network, &["opener", "porter"], PATIENCE);
    let lie = "`porter` refuses its part, and its projection stays as it is: I do not like it";
    assert_eq!(reason(result(receiver).await), lie);
}

#[tokio::test]
async fn a_member_that_speaks_for_another_is_named() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let _opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let _porter = host(&network, "porter", Box::new(LyingMember(promise("opener"))));
    let (_requester, receiver) = request(&network, &["opener", "porter"], PATIENCE);
    let reason = reason(result(receiver).await);
    assert!(reason.starts_with("`porter`: its action `opener--do-put` is not named"), "{reason}");
}

/// An agent that calls `opener` for a part with a digest, and tells whether it agrees.
struct Caller {
    digest: &'static str,
    answer: Option<oneshot::Sender<Performative>>,
}

impl Agent for Caller {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let steps = vec![PartStep::Own("(opener--do-swing)".to_owned())];
        let part = Some(JointPlanPart { digest: self.digest.to_owned(), steps });
        let opening = ExchangeOpening {
            to: Some(name("opener")),
            performative: Performative::Cfp,
            protocol: Protocol::ContractNet,
            conversation: ctx.new_conversation(),
            content: value(&CallForProposals { conjuncts: Vec::new(), together: true, part }),
        };
        ctx.open(opening, PATIENCE, |caller: &mut Self, event, _| {
            if let (ExchangeEvent::Message(message), Some(answer)) = (event, caller.answer.take()) {
                let _ = answer.send(message.performative);
            }
        });
    }
}

#[tokio::test]
async fn a_digest_that_is_none_is_refused_and_costs_no_place() {
    let (network, folder) = (Network::new(), tempfile::tempdir().expect("a folder"));
    let _opener = member(&network, folder.path(), "opener", (OPENER_DOMAIN, OPENER_PROBLEM));
    let call = async |id: &str, digest| {
        let (answer, answered) = oneshot::channel();
        let _caller = host(&network, id, Box::new(Caller { digest, answer: Some(answer) }));
        tokio::time::timeout(PATIENCE, answered).await.expect("in time").expect("an answer")
    };
    for id in ["a", "b", "c", "d", "e"] {
        assert_eq!(call(id, "a/b").await, Performative::Refuse);
    }
    assert_eq!(call("f", "00000000000000ff").await, Performative::Agree);
}

/// Number of drawn plannings. `ALTHING_JOINT_DEATHS` draws more.
const DEATHS: u64 = 30;

/// Two agents can each do either part. One of them is killed at a drawn moment, on links that lose one
/// message in five.
#[tokio::test(start_paused = true)]
async fn deaths_on_bad_links_end_in_a_plan_of_the_others() {
    let more = std::env::var("ALTHING_JOINT_DEATHS").ok().and_then(|it| it.parse().ok());
    let members = ["opener", "porter", "second-opener", "second-porter"];
    let mut without = 0;
    for seed in 0..more.unwrap_or(DEATHS) {
        let mut rng = Rng::with_seed(seed);
        let (network, folder) =
            (faulty::Network::new(seed), tempfile::tempdir().expect("a folder"));
        network.set_conditions(LinkConditions { loss: 0.2, ..LinkConditions::good() });
        let hosts = members.map(|id| match id.ends_with("opener") {
            true => member(&network, folder.path(), id, (OPENER_DOMAIN, OPENER_PROBLEM)),
            false => member(&network, folder.path(), id, (PORTER_DOMAIN, PORTER_PROBLEM)),
        });
        let (requester, receiver) = request(&network, &members, PATIENCE);
        let dying = members[rng.usize(0..members.len())];
        let after = Duration::from_micros(rng.u64(0..60_000));
        let mut receiver = std::pin::pin!(result(receiver));
        let found = tokio::select! {
            found = &mut receiver => found,
            () = tokio::time::sleep(after) => {
                network.kill(&DaemonId::new(dying).expect("a name"));
                receiver.await
            }
        };
        without += u64::from(found.left.contains(&name(dying)));
        let left = found.left.clone();
        let skeleton = found.plan.unwrap_or_else(|why| panic!("seed {seed}: {why}"));
        assert_eq!(skeleton.owners.len(), 3, "seed {seed}");
        let acts = |agent: &AgentId| skeleton.owners.iter().any(|it| it == agent.as_str());
        assert!(!left.iter().any(acts), "seed {seed}: {left:?} {:?}", skeleton.owners);
        drop((hosts, requester));
    }
    assert!(without > 0, "some die before the plan is agreed to");
}

/// Returns a projection with an action named for `agent`, which reaches the goal at once.
fn promise(agent: &str) -> String {
    let domain = format!(
        "(define (domain hall) (:requirements :typing) (:types thing - object)
           (:predicates (there ?t - thing))
           (:action {agent}--do-put :parameters (?t - thing) :effect (there ?t)))"
    );
    let problem = "(define (problem p) (:domain hall) (:objects box - thing)
      (:init) (:goal (there box)))";
    json!(crate::answer(&Projection { domain, problem: problem.to_owned() }, 0)).to_string()
}

/// A member that does not answer calls, and queries only if it tells something.
struct SilentMember {
    tells: Option<String>,
    /// Is told of the first call or, if the member tells nothing, of the first query.
    asked: Option<oneshot::Sender<()>>,
}

impl Agent for SilentMember {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Cfp, |member: &mut Self, _, _| {
            if let Some(asked) = member.asked.take() {
                let _ = asked.send(());
            }
        })
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        if let Some(asked) = self.asked.take_if(|_| self.tells.is_none()) {
            let _ = asked.send(());
        }
        self.tells.clone().filter(|_| resource == Resource::Domain)
    }
}

/// A member that refuses all that its projection promises.
struct LyingMember(String);

impl Agent for LyingMember {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Cfp, |_: &mut Self, message: Message, ctx| {
            let call = message.content_as::<CallForProposals>();
            assert!(call.is_ok_and(|call| call.part.is_some()), "it is called for a part");
            ctx.refuse(&Participation::of(&message), Reason::Incapable, "I do not like it");
        })
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        (resource == Resource::Domain).then(|| self.0.clone())
    }
}
