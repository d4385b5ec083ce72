//! Tests of what lets an action begin and what ends it, over the in-memory substrate: the consent of
//! people, the limit of beginnings, the time limit of the method, the stop of a place, and what ends a
//! commitment to a joint plan.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{
    Act, ActionToken, CallForProposals, Choice, Inform, JointPlanPart, Method, Outcome, PartStep,
    PersonsAnswer, Refusal, ReleaseStops, Report, Request, Stop, StopEffect, value,
};
use acl::{
    AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Message, Millis, Performative,
    Protocol,
};
use actuator::{
    ActionSafeguard, Actuator, BeginLimit, BoxFuture, Description, Device, MethodCall,
    MethodFailure, MethodResult, OwnFact, Safeguards, facts_of, model_of,
};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, ExchangeEvent, ExchangeOpening, Host,
    LaunchContext, LaunchableAgent, MessageRouter, Participation,
};
use substrate::memory::Network;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

const HOUR: Duration = Duration::from_secs(3_600);

/// Time limit of the robot's method.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Time that people have for their answer.
const PATIENCE: Duration = Duration::from_secs(30);

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// A robot that stands at its own pose, as a mobile base describes it, and waves there.
struct WavingRobot {
    waves_for: Duration,
    /// What the device does, in words.
    does: mpsc::UnboundedSender<&'static str>,
}

impl Device for WavingRobot {
    type Yield = ();

    fn describe(&self) -> Description {
        let model = model_of(
            "(define (agent robot) (:domain home)
                (:objects robot - agent desk - pose)
                (:init (connected desk office1) (connected office1 desk))
                (:action wave :agent ?a - agent :parameters (?l - location)
                    :precondition (at ?a ?l) :effect (waved ?a))
                (:action dance :agent (?a ?b - agent) :effect (and (waved ?a) (waved ?b))))",
        );
        let method = |name: &str| (name.to_owned(), Method::new(name, &[], TIMEOUT));
        Description { model, methods: [method("wave"), method("dance")].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        facts_of("(at robot desk)")
    }

    fn perform(&mut self, _call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let (waves_for, does) = (self.waves_for, self.does.clone());
        Box::pin(async move {
            does.send("begins").expect("the test listens");
            tokio::time::sleep(waves_for).await;
            Ok(())
        })
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        MethodResult::default()
    }

    fn on_failure(&mut self, _call: &MethodCall, _failure: &MethodFailure) {
        self.does.send("fails").expect("the test listens");
    }
}

/// A keyboard at which a person gives these answers, and then none.
struct Keyboard(VecDeque<&'static str>);

impl Agent for Keyboard {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::QueryRef, Self::asked)
    }
}

impl Keyboard {
    fn asked(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Some(answer) = self.0.pop_front() else { return };
        let answer = Inform::Answer(PersonsAnswer::plain(answer));
        ctx.answer(&Participation::of(&message), Performative::Inform, &answer);
    }
}

/// Sends what it is told to the robot, and passes on the answers.
struct Client {
    requests: Vec<(Duration, Request)>,
    /// Conversations of goals; the robot is asked to agree to a part of a joint plan for each.
    parts: Vec<(Duration, &'static str)>,
    /// What is said to the robot so long after it has agreed to an action.
    replies: Vec<(Duration, Performative)>,
    /// Whether the others of a joint action do their parts.
    completes: bool,
    told: mpsc::UnboundedSender<Message>,
}

impl Agent for Client {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let to_robot = |performative, protocol, conversation: &str, content| ExchangeOpening {
            to: Some(name("robot")),
            performative,
            protocol,
            conversation: ConversationId::new(conversation),
            content,
        };
        let requests = std::mem::take(&mut self.requests).into_iter().map(|(after, request)| {
            let protocol = match request {
                Request::Act(_) => Protocol::Action,
                _ => Protocol::StateChange,
            };
            (after, to_robot(Performative::Request, protocol, "test", value(&request)))
        });
        let parts = std::mem::take(&mut self.parts).into_iter().map(|(after, goal)| {
            let steps = vec![PartStep::Own("(wave robot desk)".to_owned())];
            let part = Some(JointPlanPart { digest: format!("plan-for-{goal}"), steps });
            let conjuncts = vec!["(waved robot)".to_owned()];
            let call = CallForProposals { conjuncts, together: true, part };
            (after, to_robot(Performative::Cfp, Protocol::ContractNet, goal, value(&call)))
        });
        for (after, opening) in requests.chain(parts).collect::<Vec<_>>() {
            ctx.after(after, move |_: &mut Client, ctx| {
                ctx.open(opening, HOUR, |client: &mut Client, answer, ctx| {
                    let ExchangeEvent::Message(message) = answer else { return };
                    let exchange = message.in_reply_to.clone();
                    let report = message.content_as::<Report>().ok();
                    if report.is_some_and(|report| report.is_part_done) && client.completes {
                        let exchange = exchange.clone().expect("it is an answer");
                        let end = Choice { are_parts_done: true, ..Choice::new(Vec::new(), "") };
                        let (robot, end) = (name("robot"), value(&end));
                        ctx.send_turn(&exchange, &robot, Performative::AcceptProposal, end);
                    }
                    let has_agreed = message.performative == Performative::Agree;
                    for (after, reply) in client.replies.iter().copied().filter(|_| has_agreed) {
                        let exchange = exchange.clone().expect("it is an answer");
                        ctx.after(after, move |_: &mut Client, ctx| {
                            let nothing = serde_json::Value::Null;
                            ctx.send_turn(&exchange, &name("robot"), reply, nothing);
                        });
                    }
                    client.told.send(*message).expect("the test listens");
                });
            });
        }
    }
}

/// A robot, a keyboard and a client of the robot.
struct Home {
    heard: mpsc::UnboundedReceiver<Message>,
    /// What the device has done.
    done: mpsc::UnboundedReceiver<&'static str>,
    _network: Network,
    _router: Arc<MessageRouter>,
}

/// What is different from test to test.
#[derive(Default)]
struct Setting {
    safeguard: ActionSafeguard,
    waves_for: Duration,
    answers: Vec<&'static str>,
    requests: Vec<(Duration, Request)>,
    parts: Vec<(Duration, &'static str)>,
    replies: Vec<(Duration, Performative)>,
    /// Whether the others of a joint action never do their parts.
    never_completes: bool,
}

fn home(setting: Setting) -> Home {
    let settings = AgentSettings {
        heartbeat_period: HOUR,
        heartbeat_lease: HOUR * 10,
        ..AgentSettings::default()
    };
    let network = Network::new();
    let daemon = DaemonId::new("here").expect("a name");
    let ecosystem = EcosystemId::new("home").expect("a name");
    let router = MessageRouter::new(ecosystem, daemon.clone(), settings.clone());
    router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
    let ontology = pddl::parse_domain(
        "(define (domain home) (:requirements :typing)
            (:types agent location - object pose - location)
            (:predicates (at ?a - agent ?l - location) (connected ?a ?b - location)
                (waved ?a - agent)))",
    );
    let map = pddl::parse_problem(
        "(define (problem map) (:domain home) (:objects office1 - location) (:init) (:goal (and)))",
    );
    let mut host = Host {
        settings,
        ..Host::new(ontology.value.expect("a domain"), map.value.expect("a map"))
    };
    let of_robot = ["wave", "dance"].map(|action| (action.to_owned(), setting.safeguard)).into();
    host.resources.insert(Safeguards([(name("robot"), of_robot)].into()));
    let blueprint = Blueprint {
        id: name("robot"),
        driver: String::new(),
        config: serde_json::Value::Null.into(),
        host: Arc::new(host),
    };
    let ((does, done), (told, heard)) = (mpsc::unbounded_channel(), mpsc::unbounded_channel());
    let robot = WavingRobot { waves_for: setting.waves_for, does };
    let Setting { requests, parts, replies, answers, never_completes, .. } = setting;
    let completes = !never_completes;
    let client = Client { requests, parts, replies, completes, told };
    let agents: [(&str, Box<dyn LaunchableAgent>); 3] = [
        ("robot", Actuator::build(&blueprint, robot).expect("built")),
        ("keyboard", Box::new(Keyboard(answers.into()))),
        ("client", Box::new(client)),
    ];
    for (number, (id, agent)) in (1..).zip(agents) {
        drop(agent.launch(LaunchContext {
            id: name(id),
            incarnation: Incarnation(number),
            router: Arc::clone(&router),
            ontology: Arc::from("home"),
            stopping: CancellationToken::new(),
            has_replicas: false,
            via: [].into(),
        }));
    }
    Home { heard, done, _network: network, _router: router }
}

impl Home {
    /// Waits for the next refusal or report, and returns its outcome (`None` if refused) and text.
    async fn end(&mut self) -> (Option<Outcome>, String) {
        loop {
            let next = tokio::time::timeout(HOUR, self.heard.recv()).await.expect("in time");
            let message = next.expect("it lives");
            match message.performative {
                Performative::Agree => (),
                Performative::Confirm => {
                    let report: Report = message.content_as().expect("a report");
                    if report.outcome.is_final() {
                        return (Some(report.outcome), report.detail);
                    }
                }
                _ => {
                    let refusal: Refusal = message.content_as().expect("a refusal");
                    return (None, refusal.detail);
                }
            }
        }
    }
}

impl Home {
    /// Waits for the answers to the calls to agree, and returns the goal of each and the reason of the
    /// refusal; an empty one for an agreement.
    async fn agreements(&mut self, count: usize) -> Vec<(String, String)> {
        let mut answers = Vec::new();
        while answers.len() < count {
            let next = tokio::time::timeout(HOUR, self.heard.recv()).await.expect("in time");
            let message = next.expect("it lives");
            let goal = message.conversation_id.to_string();
            match message.performative {
                _ if goal == "test" => (),
                Performative::Agree => answers.push((goal, String::new())),
                _ => {
                    let refusal: Refusal = message.content_as().expect("a refusal");
                    answers.push((goal, refusal.detail));
                }
            }
        }
        answers
    }
}

/// Builds the request for the wave of this number, which comes so many minutes after the start.
fn wave(number: u32) -> (Duration, Request) {
    let token =
        ActionToken { term: 1, conversation: ConversationId::new("goal"), round: 1, step: number };
    let act = Act {
        action: "(wave robot desk)".to_owned(),
        method: "wave".to_owned(),
        arguments: [].into(),
        token,
        ready_for: None,
    };
    (Duration::from_secs(60) * number, Request::Act(Box::new(act)))
}

/// People have half a minute for their answer; the method does not get what they leave of it.
#[tokio::test(start_paused = true)]
async fn a_method_that_people_allow_has_its_own_time_limit_and_no_more() {
    let mut home = home(Setting {
        safeguard: ActionSafeguard { asks_people: Some(PATIENCE), limit: None },
        waves_for: HOUR,
        answers: vec!["yes"],
        requests: vec![wave(1)],
        ..Setting::default()
    });
    let begun = Instant::now();
    let (outcome, detail) = home.end().await;
    assert_eq!(outcome, Some(Outcome::Failed), "{detail}");
    let elapsed = begun.elapsed() - Duration::from_secs(60);
    assert!(elapsed >= TIMEOUT && elapsed < TIMEOUT * 2, "{elapsed:?}: {detail}");
}

#[tokio::test(start_paused = true)]
async fn an_action_that_people_forbid_does_not_count_as_begun() {
    let limit = Some(BeginLimit { at_most: 1, per: HOUR });
    let mut home = home(Setting {
        safeguard: ActionSafeguard { asks_people: Some(PATIENCE), limit },
        answers: vec!["no", "no", "yes"],
        requests: (1..=4).map(wave).collect(),
        ..Setting::default()
    });
    for _ in 0..2 {
        let (outcome, detail) = home.end().await;
        assert_eq!(outcome, Some(Outcome::Failed), "{detail}");
        assert!(detail.contains("a person said no"), "{detail}");
    }
    let (outcome, detail) = home.end().await;
    assert_eq!(outcome, Some(Outcome::Done), "it has not begun before: {detail}");
    let (outcome, detail) = home.end().await;
    assert_eq!(outcome, None, "{detail}");
    assert!(detail.contains("may begin at most once in 1h"), "{detail}");
}

#[tokio::test(start_paused = true)]
async fn a_stop_of_a_place_stops_a_robot_at_its_own_pose_there() {
    let stop = |id: &str, place: &str| {
        Request::Stop(Stop {
            id: id.to_owned(),
            scope: vec![place.to_owned()],
            by: name("client"),
            why: String::new(),
        })
    };
    let second = Duration::from_secs(1);
    let mut home = home(Setting {
        waves_for: HOUR,
        requests: vec![
            (second * 60, stop("other", "office2")),
            wave(2),
            (second * 121, stop("this", "office1")),
            wave(3),
        ],
        ..Setting::default()
    });
    let mut effects = Vec::new();
    let mut refusal = None;
    while refusal.is_none() {
        let message = home.heard.recv().await.expect("it lives");
        match message.performative {
            Performative::Confirm => {
                let report: Report = message.content_as().expect("a report");
                effects.extend(report.stop_effect);
            }
            Performative::Refuse => refusal = message.content_as::<Refusal>().ok(),
            _ => (),
        }
    }
    assert_eq!(effects, [StopEffect::Unconcerned, StopEffect::Ended]);
    let refusal = refusal.expect("the loop ends with it").detail;
    assert!(refusal.contains("stopped (office1) by `client`"), "{refusal}");
}

/// The lease of an agreement is ten seconds; all of this is within one.
#[tokio::test(start_paused = true)]
async fn a_stop_ends_a_commitment_before_its_lease() {
    let stop = Request::Stop(Stop {
        id: "s".to_owned(),
        scope: vec!["robot".to_owned()],
        by: name("client"),
        why: String::new(),
    });
    let release = Request::ReleaseStops(ReleaseStops { ids: vec!["s".to_owned()] });
    let second = Duration::from_secs(1);
    let mut home = home(Setting {
        requests: vec![(second * 4, stop), (second * 5, release)],
        parts: vec![(second * 2, "g1"), (second * 3, "g2"), (second * 6, "g2")],
        ..Setting::default()
    });
    let answers = home.agreements(3).await;
    assert_eq!(answers[0], ("g1".to_owned(), String::new()));
    assert!(answers[1].1.contains("plan plan-for-g1 of `client`"), "{answers:?}");
    assert_eq!(answers[2], ("g2".to_owned(), String::new()));
}

/// A replica that takes a goal over asks in the same conversation, in an exchange of its own.
#[tokio::test(start_paused = true)]
async fn an_agent_agrees_again_for_the_goal_that_holds_it() {
    let second = Duration::from_secs(1);
    let parts =
        vec![(second * 2, "g1"), (second * 3, "g1"), (second * 11, "g2"), (second * 14, "g2")];
    let mut home = home(Setting { parts, ..Setting::default() });
    let answers = home.agreements(4).await;
    assert_eq!(answers[..2], [("g1".to_owned(), String::new()), ("g1".to_owned(), String::new())]);
    // The second agreement has begun the lease anew.
    assert!(answers[2].1.contains("is held for 2.0 s more"), "{answers:?}");
    assert_eq!(answers[3], ("g2".to_owned(), String::new()));
}

/// Builds the request for a dance, at once.
fn dance(action: &str, ready_for: Option<Duration>) -> (Duration, Request) {
    let (after, request) = wave(0);
    let Request::Act(act) = request else { panic!("it is an action") };
    let (action, method) = (action.to_owned(), "dance".to_owned());
    let act = Act { action, method, ready_for: ready_for.map(Millis), ..*act };
    (after, Request::Act(Box::new(act)))
}

const DANCE: &str = "(dance partner robot)";

/// Time that the robot waits for its partner.
const READY_FOR: Duration = Duration::from_secs(20);

/// The device has done its part, and the others do not: the action is not done.
#[tokio::test(start_paused = true)]
async fn a_joint_action_is_done_when_all_parts_are() {
    for cancels in [false, true] {
        let replies = [(1, Performative::AcceptProposal), (10, Performative::Cancel)];
        let replies = replies.map(|(after, reply)| (Duration::from_secs(after), reply));
        let mut home = home(Setting {
            waves_for: Duration::from_secs(2),
            requests: vec![dance(DANCE, Some(READY_FOR))],
            replies: replies.into_iter().take(1 + usize::from(cancels)).collect(),
            never_completes: true,
            ..Setting::default()
        });
        let (outcome, detail) = home.end().await;
        let done: Vec<_> = std::iter::from_fn(|| home.done.try_recv().ok()).collect();
        assert_eq!(done, ["begins", "fails"]);
        match cancels {
            true => assert_eq!(outcome, Some(Outcome::Cancelled)),
            false => {
                assert_eq!(outcome, Some(Outcome::Failed));
                assert!(detail.contains("not told of the end of that of `partner`"), "{detail}");
            }
        }
    }
}

/// Plays a dance; returns how it ended, and what the device has done.
async fn danced(
    asks_people: Option<&'static str>,
    replies: &[(u64, Performative)],
    request: (Duration, Request),
) -> (Option<Outcome>, String, Vec<&'static str>) {
    let replies = replies.iter().map(|(after, reply)| (Duration::from_secs(*after), *reply));
    let mut home = home(Setting {
        safeguard: ActionSafeguard { asks_people: asks_people.map(|_| PATIENCE), limit: None },
        waves_for: Duration::from_secs(2),
        answers: asks_people.into_iter().collect(),
        requests: vec![request],
        replies: replies.collect(),
        ..Setting::default()
    });
    let (outcome, detail) = home.end().await;
    let done = std::iter::from_fn(|| home.done.try_recv().ok()).collect();
    (outcome, detail, done)
}

#[tokio::test(start_paused = true)]
async fn a_joint_action_begins_when_all_are_ready() {
    let began = Instant::now();
    let all_ready = [(7, Performative::AcceptProposal)];
    let (outcome, _, done) = danced(None, &all_ready, dance(DANCE, Some(READY_FOR))).await;
    assert_eq!((outcome, done), (Some(Outcome::Done), vec!["begins"]));
    assert_eq!(began.elapsed().as_secs(), 9, "it has waited, and waved");
    let (outcome, _, done) = danced(Some("yes"), &all_ready, dance(DANCE, Some(READY_FOR))).await;
    assert_eq!((outcome, done), (Some(Outcome::Done), vec!["begins"]));
}

/// The daemon of a plugin has waited for the others itself.
#[tokio::test(start_paused = true)]
async fn a_joint_action_for_which_all_are_ready_begins_at_once() {
    let (outcome, _, done) = danced(None, &[], dance(DANCE, Some(Duration::ZERO))).await;
    assert_eq!((outcome, done), (Some(Outcome::Done), vec!["begins"]));
}

#[tokio::test(start_paused = true)]
async fn nothing_begins_of_a_joint_action_that_is_ended_before() {
    let cancelled = [(3, Performative::Cancel)];
    let (outcome, _, done) = danced(None, &cancelled, dance(DANCE, Some(READY_FOR))).await;
    assert_eq!((outcome, done), (Some(Outcome::Cancelled), vec![]));

    let began = Instant::now();
    let (outcome, detail, done) = danced(None, &[], dance(DANCE, Some(READY_FOR))).await;
    assert_eq!((outcome, done), (Some(Outcome::Failed), vec![]));
    assert_eq!(detail, "failed to begin with `partner`: it was not told to within 20s");
    assert!(began.elapsed() < READY_FOR + Duration::from_secs(1), "{:?}", began.elapsed());

    // The robot has not agreed, so its partner does not begin either.
    let all_ready = [(0, Performative::AcceptProposal)];
    let (outcome, detail, done) =
        danced(Some("no"), &all_ready, dance(DANCE, Some(READY_FOR))).await;
    assert_eq!((outcome, done), (None, vec![]));
    assert!(detail.contains("a person said no"), "{detail}");
}

#[tokio::test(start_paused = true)]
async fn a_joint_action_that_is_cancelled_while_it_runs_fails_at_its_device() {
    let replies = [(1, Performative::AcceptProposal), (2, Performative::Cancel)];
    let (outcome, _, done) = danced(None, &replies, dance(DANCE, Some(READY_FOR))).await;
    assert_eq!((outcome, done), (Some(Outcome::Cancelled), vec!["begins", "fails"]));
}

#[tokio::test(start_paused = true)]
async fn a_joint_action_that_is_none_is_refused() {
    for (action, ready_for, told) in [
        (DANCE, None, "several agents begin it together"),
        ("(dance robot robot)", Some(READY_FOR), "does not name 2 different agents"),
        ("(dance robot)", Some(READY_FOR), "does not name 2 different agents"),
        ("(dance ann bob)", Some(READY_FOR), "names another agent, not `robot`"),
    ] {
        let (outcome, detail, done) = danced(None, &[], dance(action, ready_for)).await;
        assert_eq!((outcome, done), (None, vec![]), "{action}");
        assert!(detail.contains(told), "{action}: {detail}");
    }
}

/// A stop of the robot, and one of what the action names.
#[tokio::test(start_paused = true)]
async fn a_stop_ends_a_robot_that_waits_for_its_partner() {
    for scope in ["robot", "partner"] {
        let stop = Stop {
            id: "s1".to_owned(),
            scope: vec![scope.to_owned()],
            by: name("ann"),
            why: String::new(),
        };
        let mut home = home(Setting {
            requests: vec![
                dance(DANCE, Some(READY_FOR)),
                (Duration::from_secs(5), Request::Stop(stop)),
            ],
            ..Setting::default()
        });
        let began = Instant::now();
        let ends = [home.end().await, home.end().await];
        assert!(ends.iter().any(|(outcome, _)| *outcome == Some(Outcome::Cancelled)), "{ends:?}");
        assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
        assert_eq!(home.done.try_recv().ok(), None, "the device does nothing");
    }
}
