//! Tests of an actuator in an ecosystem with `privacy = "agents"`, over the in-memory substrate: it
//! names nothing private in any message, and carries out its private steps by itself.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use acl::content::{
    Act, ActionToken, CallForProposals, Inform, JointPlanPart, Method, Outcome, PartStep, Reason,
    Refusal, Report, Request, Stop, StopEffect, value,
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
    Agent, AgentSettings, Blueprint, BuildError, Callbacks, Context, ExchangeEvent,
    ExchangeOpening, Host, LaunchContext, LaunchableAgent, MessageRouter, ModelPrivacy,
};
use substrate::memory::Network;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

const HOUR: Duration = Duration::from_secs(3_600);
const SECOND: Duration = Duration::from_secs(1);

/// How long each step of the keeper takes.
const STEP: Duration = Duration::from_secs(2);

/// Maximum number of messages that wait for the listener.
const HEARD_MAX: usize = 1_000;

/// Words that only the keeper may know.
const PRIVATE: [&str; 6] = ["holding", "hanging", "brass", "fetch", "cellar", "standing"];

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// The state of the keeper, and the calls that it has carried out.
struct Truth {
    /// Private names of the key, and of the room in which it hangs.
    key: String,
    hook: String,
    is_key_hanging: bool,
    is_key_held: bool,
    is_open: bool,
    is_bolted: bool,
    /// Whether the gate is bolted while the keeper fetches its key.
    is_bolted_meanwhile: bool,
    /// Whether there is no projection of the model as soon as the key is held.
    has_axiom: bool,
    /// Where the keeper stands, if it has to go to its key and back.
    place: Option<String>,
    calls: Vec<String>,
}

impl Truth {
    fn new(key: &str, hook: &str) -> Truth {
        let calls = Vec::new();
        let (key, hook) = (key.to_owned(), hook.to_owned());
        Truth {
            key,
            hook,
            is_key_hanging: false,
            is_key_held: false,
            is_open: false,
            is_bolted: false,
            is_bolted_meanwhile: false,
            has_axiom: false,
            place: None,
            calls,
        }
    }
}

impl Default for Truth {
    fn default() -> Truth {
        Truth::new("brass", "cellar")
    }
}

/// A keeper that opens a gate with a key, which hangs in a cellar. Only the keeper knows of the cellar.
struct Keeper(Arc<Mutex<Truth>>);

impl Device for Keeper {
    type Yield = ();

    fn describe(&self) -> Description {
        let (key, hook, has_axiom, goes) = {
            let truth = self.0.lock().expect("no panic");
            let has_axiom = truth.has_axiom && truth.is_key_held;
            (truth.key.clone(), truth.hook.clone(), has_axiom, truth.place.is_some())
        };
        // A public action changes where the keeper stands, so that is announced from the beginning.
        let (there, here, going) = match goes {
            true => (
                "(standing ?a ?r)",
                "(standing ?a hall)",
                "(:action go :agent ?a - doorkeeper :parameters (?from ?to - room)
                    :precondition (standing ?a ?from)
                    :effect (and (standing ?a ?to) (not (standing ?a ?from))))
                (:action greet :agent ?a - doorkeeper :parameters ()
                    :effect (and (greeted) (standing ?a hall)))",
            ),
            false => ("", "", ""),
        };
        let axiom = if has_axiom { "(:derived (guarded ?d - gate) (open ?d))" } else { "" };
        let model = model_of(&format!(
            "(define (agent keeper) (:domain home)
                (:types doorkeeper - agent key - object)
                (:predicates (guarded ?d - gate) (:private (holding ?a - doorkeeper ?k - key)
                    (hanging ?k - key ?r - room) (standing ?a - doorkeeper ?r - room)))
                (:objects keeper - doorkeeper (:private {key} - key {hook} - room))
                (:action fetch :agent ?a - doorkeeper :parameters (?k - key ?r - room)
                    :precondition (and (hanging ?k ?r) {there})
                    :effect (and (holding ?a ?k) (not (hanging ?k ?r))))
                (:action unlock :agent ?a - doorkeeper :parameters (?d - gate ?k - key)
                    :precondition (and (holding ?a ?k) {here} (not (bolted ?d))) :effect (open ?d))
                {going} {axiom})"
        ));
        let method = |name: &str, arguments: &[(&str, &str)]| Method {
            method: format!("{name}-it"),
            arguments: arguments.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect(),
            timeout: Millis(STEP * 2),
        };
        let methods = [
            ("fetch".to_owned(), method("fetch", &[("which", "?k"), ("from", "?r")])),
            ("unlock".to_owned(), method("unlock", &[("which", "?d"), ("with", "?k")])),
            ("go".to_owned(), method("go", &[("to", "?to")])),
            ("greet".to_owned(), method("greet", &[])),
        ];
        Description { model, methods: methods.into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let truth = self.0.lock().expect("no panic");
        let (key, hook) = (&truth.key, &truth.hook);
        let told = [
            (truth.is_key_hanging, format!("(hanging {key} {hook})")),
            (truth.is_key_held, format!("(holding keeper {key})")),
            (truth.is_open, "(open gate1)".to_owned()),
            (truth.is_bolted, "(bolted gate1)".to_owned()),
            (
                truth.place.is_some(),
                format!("(standing keeper {})", truth.place.as_deref().unwrap_or_default()),
            ),
        ];
        let told = told.into_iter().filter(|(is, _)| *is).map(|(_, fact)| fact);
        facts_of(&told.collect::<Vec<_>>().join(" "))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let (truth, MethodCall { method, arguments, .. }) = (Arc::clone(&self.0), call.clone());
        Box::pin(async move {
            tokio::time::sleep(STEP).await;
            let mut truth = truth.lock().expect("no panic");
            let arguments: Vec<_> = arguments.into_values().collect();
            truth.calls.push(format!("{method} {}", arguments.join(" ")));
            match method.as_str() {
                "fetch-it" => {
                    (truth.is_key_hanging, truth.is_key_held) = (false, true);
                    truth.is_bolted |= truth.is_bolted_meanwhile;
                }
                "go-it" => truth.place = arguments.first().cloned(),
                _ => truth.is_open = true,
            }
            Ok(())
        })
    }

    fn on_success(&mut self, call: &MethodCall, (): ()) -> MethodResult {
        let detail = format!("with brass: {}", call.action);
        let seen = facts_of("(hanging brass cellar) (open gate1)");
        MethodResult { detail, observations: seen.into_iter().map(|it| it.fact).collect() }
    }
}

/// Sends messages to the keeper, and records all messages of all agents.
struct Listener {
    openings: Vec<(Duration, ExchangeOpening)>,
    answers: mpsc::UnboundedSender<Message>,
    texts: Arc<Mutex<Vec<String>>>,
}

impl Agent for Listener {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        ctx.overhear(HEARD_MAX, |listener: &mut Listener, batch, _| {
            assert_eq!(batch.lost, 0, "everything is heard");
            let texts = batch.messages.iter().map(|it| serde_json::to_string(&it.message));
            let mut heard = listener.texts.lock().expect("no panic");
            heard.extend(texts.map(|text| text.expect("JSON")));
        })
        .expect("overheard");
        for (after, opening) in std::mem::take(&mut self.openings) {
            ctx.after(after, move |_: &mut Listener, ctx| {
                ctx.open(opening, HOUR, |listener: &mut Listener, answer, _| {
                    if let ExchangeEvent::Message(message) = answer {
                        listener.answers.send(*message).expect("the test listens");
                    }
                });
            });
        }
    }
}

/// A keeper and a listener.
struct Home {
    truth: Arc<Mutex<Truth>>,
    answers: mpsc::UnboundedReceiver<Message>,
    texts: Arc<Mutex<Vec<String>>>,
    _network: Network,
    _router: Arc<MessageRouter>,
}

fn blueprint(safeguarded: &str, heartbeat_period: Duration) -> Blueprint {
    let ontology = pddl::parse_domain(
        "(define (domain home) (:requirements :typing)
            (:types agent room gate - object)
            (:predicates (open ?d - gate) (bolted ?d - gate) (greeted)))",
    );
    let map = pddl::parse_problem(
        "(define (problem map) (:domain home)
            (:objects hall - room gate1 - gate) (:init) (:goal (and)))",
    );
    let mut host = Host {
        settings: settings(heartbeat_period),
        ..Host::new(ontology.value.expect("a domain"), map.value.expect("a map"))
    };
    if !safeguarded.is_empty() {
        let safeguard = match safeguarded.strip_prefix("limit ") {
            Some(_) => {
                let limit = Some(BeginLimit { at_most: 1, per: HOUR });
                ActionSafeguard { asks_people: None, limit }
            }
            None => ActionSafeguard { asks_people: Some(SECOND), limit: None },
        };
        let action = safeguarded.trim_start_matches("limit ").to_owned();
        let of_keeper = [(action, safeguard)].into();
        host.resources.insert(Safeguards([(name("keeper"), of_keeper)].into()));
    }
    let config = serde_json::Value::Null.into();
    Blueprint { id: name("keeper"), driver: String::new(), config, host: Arc::new(host) }
}

fn settings(heartbeat_period: Duration) -> AgentSettings {
    AgentSettings {
        heartbeat_period,
        heartbeat_lease: HOUR,
        privacy: ModelPrivacy::Agents,
        ..AgentSettings::default()
    }
}

fn home(
    is_key_hanging: bool,
    safeguarded: &str,
    openings: Vec<(Duration, ExchangeOpening)>,
) -> Home {
    let truth = Truth { is_key_hanging, ..Truth::default() };
    home_of(truth, (safeguarded, SECOND), openings)
}

fn home_of(
    truth: Truth,
    (safeguarded, heartbeat_period): (&str, Duration),
    openings: Vec<(Duration, ExchangeOpening)>,
) -> Home {
    let network = Network::new();
    let daemon = DaemonId::new("here").expect("a name");
    let ecosystem = EcosystemId::new("home").expect("a name");
    let router = MessageRouter::new(ecosystem, daemon.clone(), settings(heartbeat_period));
    router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
    let truth = Arc::new(Mutex::new(truth));
    let (sender, answers) = mpsc::unbounded_channel();
    let texts = Arc::default();
    let listener = Listener { openings, answers: sender, texts: Arc::clone(&texts) };
    let keeper = Keeper(Arc::clone(&truth));
    let keeper = Actuator::build(&blueprint(safeguarded, heartbeat_period), keeper);
    let agents: [(&str, Box<dyn LaunchableAgent>); 2] =
        [("listener", Box::new(listener)), ("keeper", keeper.expect("built"))];
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
    Home { truth, answers, texts, _network: network, _router: router }
}

impl Home {
    /// Waits for the next answer other than `agree` to an action.
    async fn answer(&mut self) -> Message {
        loop {
            let next = tokio::time::timeout(HOUR, self.answers.recv()).await.expect("in time");
            let message = next.expect("it lives");
            if message.performative != Performative::Agree
                || message.protocol == Some(Protocol::ContractNet)
            {
                return message;
            }
        }
    }

    async fn report(&mut self) -> Report {
        let message = self.answer().await;
        message.content_as().unwrap_or_else(|_| panic!("no report: {message:?}"))
    }

    fn calls(&self) -> Vec<String> {
        self.truth.lock().expect("no panic").calls.clone()
    }

    /// Returns all messages so far. Panics if one of them names something private.
    fn texts(&self) -> Vec<String> {
        let texts = self.texts.lock().expect("no panic").clone();
        assert!(texts.iter().any(|text| text.contains("unlock")), "something is sent: {texts:?}");
        for text in &texts {
            let named = PRIVATE.iter().find(|word| text.contains(*word));
            assert_eq!(named, None, "{text}");
        }
        texts
    }
}

fn opening(
    performative: Performative,
    protocol: Protocol,
    content: serde_json::Value,
) -> ExchangeOpening {
    let conversation = ConversationId::new("goal");
    ExchangeOpening { to: Some(name("keeper")), performative, protocol, conversation, content }
}

fn unlock(step: u32) -> ExchangeOpening {
    let conversation = ConversationId::new("goal");
    let act = Act {
        action: "(unlock keeper gate1)".to_owned(),
        method: "unlock".to_owned(),
        arguments: [].into(),
        token: ActionToken { term: 1, conversation, round: 1, step },
        ready_for: None,
    };
    let content = value(&Request::Act(Box::new(act)));
    opening(Performative::Request, Protocol::Action, content)
}

fn part() -> ExchangeOpening {
    let steps = vec![PartStep::Own("(unlock keeper gate1)".to_owned())];
    let part = Some(JointPlanPart { digest: "d".to_owned(), steps });
    let conjuncts = vec!["(open gate1)".to_owned()];
    let content = value(&CallForProposals { conjuncts, together: true, part });
    opening(Performative::Cfp, Protocol::ContractNet, content)
}

#[tokio::test(start_paused = true)]
async fn a_requested_action_takes_its_private_steps_with_it_and_names_none() {
    let mut home = home(true, "", vec![(SECOND * 3, unlock(1))]);
    let report = home.report().await;
    assert_eq!(report.outcome, Outcome::Done, "{report:?}");
    assert_eq!(report.action.as_deref(), Some("(unlock keeper gate1)"));
    assert_eq!(report.detail, "has done `(unlock keeper gate1)`");
    assert_eq!(report.observations, "(open gate1)");
    assert_eq!(home.calls(), ["fetch-it cellar brass", "unlock-it gate1 brass"]);
    let told = home.texts();
    assert!(told.iter().any(|text| text.contains("(open gate1)")), "a public fact is announced");
}

/// The key is held already, so there is nothing to fetch.
#[tokio::test(start_paused = true)]
async fn private_steps_are_planned_from_the_state_of_the_device() {
    let mut home = home(true, "", vec![(SECOND * 3, unlock(1)), (SECOND * 30, unlock(2))]);
    for _ in 0..2 {
        assert_eq!(home.report().await.outcome, Outcome::Done);
    }
    let calls = ["fetch-it cellar brass", "unlock-it gate1 brass", "unlock-it gate1 brass"];
    assert_eq!(home.calls(), calls);
}

/// The first failure proves that the announced model lacks something, so the second one has it.
#[tokio::test(start_paused = true)]
async fn an_impossible_action_fails_without_a_secret_and_sharpens_the_model() {
    let mut home = home(false, "", vec![(SECOND * 3, unlock(1)), (SECOND * 6, part())]);
    let report = home.report().await;
    assert_eq!(report.outcome, Outcome::Failed);
    assert_eq!(report.detail, "it cannot carry out its step 1 of the plan");
    assert!(home.calls().is_empty());
    let answer = home.answer().await;
    assert_eq!(answer.performative, Performative::Refuse, "{answer:?}");
    let models: Vec<_> = home.texts();
    let model = |text: &&String| matches!(inform(text), Some(Inform::Model(_)));
    let models: Vec<_> = models.iter().filter(model).collect();
    assert!(models.len() > 1, "it announces more: {models:?}");
    assert!(models[0].len() < models[models.len() - 1].len(), "{models:?}");
    assert!(!models[0].contains("keeper--p"), "{models:?}");
    assert!(models[models.len() - 1].contains("keeper--p"), "{models:?}");
}

fn inform(text: &str) -> Option<Inform> {
    serde_json::from_str::<Message>(text).ok()?.content_as().ok()
}

#[tokio::test(start_paused = true)]
async fn an_agreement_counts_the_cost_of_private_steps() {
    let mut home = home(true, "", vec![(SECOND * 3, part())]);
    let answer = home.answer().await;
    assert_eq!(answer.performative, Performative::Agree, "{answer:?}");
    let bid: acl::content::Bid = answer.content_as().expect("a bid");
    assert_eq!(bid.agreed.as_deref(), Some("d"));
    assert_eq!(bid.proposals[0].cost, 2.0, "{bid:?}");
    home.texts();
}

/// The announced model is right: what forbids the action is known to all.
#[tokio::test(start_paused = true)]
async fn a_public_obstacle_makes_no_agent_tell_more() {
    let truth = Truth { is_key_hanging: true, is_bolted: true, ..Truth::default() };
    let mut home = home_of(truth, ("", SECOND), vec![(SECOND * 3, unlock(1))]);
    let report = home.report().await;
    assert_eq!((report.outcome, report.declined), (Outcome::Failed, Some(Reason::Conflict)));
    assert!(report.detail.contains("(bolted gate1)"), "{report:?}");
    assert!(home.calls().is_empty());
    assert!(!home.texts().iter().any(|text| text.contains("keeper--p")), "nothing more is told");
}

#[tokio::test(start_paused = true)]
async fn the_action_is_checked_again_after_its_private_steps() {
    let truth = Truth { is_key_hanging: true, is_bolted_meanwhile: true, ..Truth::default() };
    let mut home = home_of(truth, ("", SECOND), vec![(SECOND * 3, unlock(1))]);
    let report = home.report().await;
    assert_eq!((report.outcome, report.declined), (Outcome::Failed, Some(Reason::Conflict)));
    assert_eq!(home.calls(), ["fetch-it cellar brass"], "the bolted gate is not unlocked");
    home.texts();
}

/// Where the keeper stands is announced, under opaque names, and is another place on the way.
#[tokio::test(start_paused = true)]
async fn an_announced_private_fact_may_change_on_the_way() {
    let place = Some("hall".to_owned());
    let truth = Truth { is_key_hanging: true, place, ..Truth::default() };
    let mut home = home_of(truth, ("", SECOND), vec![(SECOND * 3, unlock(1))]);
    let report = home.report().await;
    assert_eq!(report.outcome, Outcome::Done, "{report:?}");
    let calls = ["go-it cellar", "fetch-it cellar brass", "go-it hall", "unlock-it gate1 brass"];
    assert_eq!(home.calls(), calls);
    assert!(home.texts().iter().any(|text| text.contains("keeper--p")), "it is announced");
}

/// The model has an axiom as soon as the key is held, and cannot be told any more.
#[tokio::test(start_paused = true)]
async fn a_model_that_changes_during_an_action_tells_nothing() {
    let truth = Truth { is_key_hanging: true, has_axiom: true, ..Truth::default() };
    let openings = vec![(SECOND * 3, unlock(1)), (SECOND * 30, unlock(2))];
    let mut home = home_of(truth, ("", SECOND), openings);
    let report = home.report().await;
    assert_eq!(report.outcome, Outcome::Failed);
    assert!(report.detail.contains("the log of its daemon"), "{report:?}");
    let answer = home.answer().await;
    assert_eq!(answer.performative, Performative::Refuse, "nothing is offered: {answer:?}");
    assert_eq!(home.calls(), ["fetch-it cellar brass"]);
    home.texts();
}

/// A limit of a private action counts its beginnings, and its refusal does not name it.
#[tokio::test(start_paused = true)]
async fn a_private_action_begins_no_oftener_than_it_may() {
    let truth = Truth { is_key_hanging: true, ..Truth::default() };
    let openings = vec![(SECOND * 3, unlock(1)), (SECOND * 30, unlock(2))];
    let mut home = home_of(truth, ("limit fetch", SECOND), openings);
    assert_eq!(home.report().await.outcome, Outcome::Done);
    {
        let mut truth = home.truth.lock().expect("no panic");
        (truth.is_key_hanging, truth.is_key_held) = (true, false);
    }
    assert_eq!(home.report().await.outcome, Outcome::Failed);
    let fetched = home.calls().iter().filter(|call| call.starts_with("fetch")).count();
    assert_eq!(fetched, 1, "{:?}", home.calls());
    home.texts();
}

#[tokio::test(start_paused = true)]
async fn a_stop_that_names_a_private_place_ends_the_step_there() {
    let stop = Request::Stop(Stop {
        id: "s".to_owned(),
        scope: vec!["cellar".to_owned()],
        by: name("listener"),
        why: String::new(),
    });
    let stop = opening(Performative::Request, Protocol::StateChange, value(&stop));
    let mut home = home(true, "", vec![(SECOND * 3, unlock(1)), (SECOND * 4, stop)]);
    let mut outcomes = Vec::new();
    for _ in 0..2 {
        let report = home.report().await;
        outcomes.push((report.outcome, report.stop_effect));
    }
    assert!(outcomes.contains(&(Outcome::Cancelled, None)), "{outcomes:?}");
    assert!(outcomes.contains(&(Outcome::Done, Some(StopEffect::Ended))), "{outcomes:?}");
    assert!(home.calls().is_empty(), "{:?}", home.calls());
}

/// The stop comes while the keeper fetches its key, which names nothing public.
#[tokio::test(start_paused = true)]
async fn a_stop_ends_a_private_step_and_what_follows_it() {
    let stop = Request::Stop(Stop {
        id: "s".to_owned(),
        scope: vec!["gate1".to_owned()],
        by: name("listener"),
        why: String::new(),
    });
    let stop = opening(Performative::Request, Protocol::StateChange, value(&stop));
    let openings = vec![(SECOND * 3, unlock(1)), (SECOND * 4, stop), (SECOND * 30, unlock(2))];
    let mut home = home(true, "", openings);
    let mut outcomes = Vec::new();
    loop {
        let answer = home.answer().await;
        if answer.performative == Performative::Refuse {
            let refusal: Refusal = answer.content_as().expect("a refusal");
            assert!(refusal.detail.contains("stopped (gate1)"), "{refusal:?}");
            break;
        }
        let report: Report = answer.content_as().expect("a report");
        outcomes.push((report.outcome, report.stop_effect.is_some()));
    }
    assert!(outcomes.contains(&(Outcome::Cancelled, false)), "{outcomes:?}");
    assert!(outcomes.contains(&(Outcome::Done, true)), "{outcomes:?}");
    assert!(home.calls().is_empty(), "{:?}", home.calls());
    home.texts();
}

/// Where the key is, how it is called and where it hangs is private: worlds that differ in nothing else
/// send the same messages, each of the same length.
#[tokio::test(start_paused = true)]
async fn worlds_that_differ_in_private_facts_send_messages_of_the_same_lengths() {
    async fn sent(is_key_hanging: bool, key: &str, hook: &str) -> Vec<String> {
        let truth = Truth { is_key_hanging, is_key_held: !is_key_hanging, ..Truth::new(key, hook) };
        let openings = vec![(SECOND * 3, part()), (SECOND * 4, unlock(1))];
        let mut home = home_of(truth, ("", HOUR), openings);
        assert_eq!(home.answer().await.performative, Performative::Agree);
        assert_eq!(home.report().await.outcome, Outcome::Done);
        let fetched = home.calls().iter().filter(|call| call.starts_with("fetch")).count();
        assert_eq!(fetched, usize::from(is_key_hanging), "the worlds differ");
        let texts = home.texts.lock().expect("no panic").clone();
        let messages = texts.iter().map(|text| {
            let message: Message = serde_json::from_str(text).expect("a message");
            // Times and the identifiers of exchanges are those of the run.
            let length = message.content.to_string().len();
            format!(
                "{} to {:?}: {} of {length}",
                message.sender, message.receiver, message.performative
            )
        });
        messages.collect()
    }
    let first = sent(true, "brass", "cellar").await;
    assert!(first.len() > 5, "{first:?}");
    for number in 0..100 {
        let key = format!("key-{}", "x".repeat(number % 19));
        let hook = format!("hook-{}", "y".repeat(number * 7 % 23));
        let is_key_hanging = number % 2 == 0;
        assert_eq!(sent(is_key_hanging, &key, &hook).await, first, "{is_key_hanging} {key} {hook}");
    }
}

/// People would be asked about a private action by its name.
#[test]
fn a_safeguard_of_a_private_action_is_refused() {
    let built = |safeguarded: &str| {
        Actuator::build(&blueprint(safeguarded, SECOND), Keeper(Arc::default())).map(|_| ())
    };
    assert!(built("unlock").is_ok());
    let Err(BuildError::Safeguards { problem, .. }) = built("fetch") else { panic!("refused") };
    assert!(problem.starts_with("`fetch` is private to it"), "{problem}");
}

/// The question before a public action names the action as it was asked for, and is asked once.
#[tokio::test(start_paused = true)]
async fn the_question_before_an_action_names_nothing_private() {
    let mut home = home(true, "unlock", vec![(SECOND * 3, unlock(1))]);
    let report = home.report().await;
    assert_eq!(report.outcome, Outcome::Failed, "nobody answers");
    assert!(report.detail.contains("leave"), "{report:?}");
    let texts = home.texts();
    let asked = texts.iter().filter(|text| text.contains("about to do (unlock keeper gate1)"));
    assert_eq!(asked.count(), 1, "{texts:?}");
    assert!(home.calls().is_empty(), "people are asked first: {:?}", home.calls());
}
