//! Tests of a second plan for a goal at the Plan Executor. A plan of the same Plan Requester
//! replaces the first. A plan of another replica, which had no record of the first, does not. A
//! plan that is called off stops, or never begins. All requesters get the reports. A step that is
//! given up is cancelled.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{
    CancelPlan, Execute, Method, Offer, Outcome, Reason, Refusal, Report, Request, value,
};
use acl::{ConversationId, Message, Millis, Performative, Protocol};
use agent::{Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, Mode, Participation};
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (idle ?a - agent) (lit ?a - agent))
    (:action light :parameters (?a - agent) :precondition (idle ?a) :effect (lit ?a)))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects lamp - agent)
    (:init (idle lamp)) (:goal (lit lamp)))";

/// Builds a request to execute a plan of this term and round.
fn asked(term: u64, round: u32) -> Request {
    Request::Execute(Box::new(execute(term, round)))
}

/// Builds a plan that lights the lamp, of this term and round.
fn execute(term: u64, round: u32) -> Execute {
    let method = Method {
        method: "light".to_owned(),
        arguments: [].into(),
        timeout: Millis(Duration::from_secs(60)),
    };
    let offer =
        Offer { schema: "light".to_owned(), guard: String::new(), method: Some(method), agents: 1 };
    Execute {
        domain: DOMAIN.to_owned(),
        problem: PROBLEM.to_owned(),
        plan: "(light lamp)".to_owned(),
        epoch: 1,
        term,
        round,
        done: Vec::new(),
        offers: [(name("lamp"), [("light".to_owned(), offer)].into())].into(),
        knowledge: [].into(),
    }
}

/// A lamp that agrees and never lights.
struct Lamp;

impl Agent for Lamp {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, |_: &mut Lamp, message, ctx: &mut Context<Lamp>| {
                let agreed = serde_json::json!({});
                ctx.answer(&Participation::of(&message), Performative::Agree, &agreed);
            })
            .on(Performative::Cancel, |_: &mut Lamp, message, ctx: &mut Context<Lamp>| {
                ctx.refuse(&Participation::of(&message), Reason::Other, "given up");
            })
    }
}

/// Sends these requests, one per second, and passes on the answers.
struct Asker {
    asks: Vec<Request>,
    /// Delay before the first request.
    after: Duration,
    told: mpsc::UnboundedSender<Message>,
}

impl Agent for Asker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        for (n, asked) in std::mem::take(&mut self.asks).into_iter().enumerate() {
            let after = self.after + Duration::from_secs(n as u64);
            ctx.after(after, move |_: &mut Asker, ctx| {
                let opening = ExchangeOpening {
                    to: Some(name("plan-executor")),
                    performative: Performative::Request,
                    protocol: Protocol::Execution,
                    conversation: ConversationId::new("goal"),
                    content: value(&asked),
                };
                let patience = Duration::from_secs(300);
                ctx.open(opening, patience, |asker: &mut Asker, answer, _| {
                    if let ExchangeEvent::Message(message) = answer {
                        asker.told.send(*message).expect("the test listens");
                    }
                });
            });
        }
    }
}

/// Returns the first answer to any of these requests.
async fn first_answer(asks: Vec<Request>) -> Message {
    first_answers(asks, 1, Duration::from_secs(30)).await.remove(0)
}

/// Returns the first `many` answers to these requests.
async fn first_answers(asks: Vec<Request>, many: usize, within: Duration) -> Vec<Message> {
    let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, Vec::new());
    let here = house.machine("here");
    let (told, mut heard) = mpsc::unbounded_channel();
    let asker = Asker { asks, after: Duration::from_secs(1), told };
    let _lives = [
        launch(house.built(&plan_executor::PLUGIN), "plan-executor", &here, false),
        launch(Box::new(Lamp), "lamp", &here, false),
        launch(Box::new(asker), "plan-requester", &here, false),
    ];
    let mut answers = Vec::new();
    while answers.len() < many {
        let answer = timeout(within, heard.recv()).await.expect("in time");
        answers.push(answer.expect("somebody answers"));
    }
    answers
}

/// A repeated request may arrive late, and the requester then waits in only one of the two
/// exchanges.
#[tokio::test(start_paused = true)]
async fn a_plan_requested_twice_is_reported_twice() {
    let answers = first_answers(vec![asked(5, 1), asked(5, 1)], 2, Duration::from_secs(120)).await;
    let exchanges: BTreeSet<_> = answers.iter().filter_map(Message::exchange).collect();
    assert_eq!(exchanges.len(), 2, "{answers:?}");
}

/// One of two Plan Requesters has stood down. Its request may arrive before or after that of the
/// other.
#[tokio::test(start_paused = true)]
async fn all_requesters_of_a_plan_get_its_end() {
    for (first, second) in [(1, 2), (2, 1)] {
        let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, Vec::new());
        let [here, there] = ["here", "there"].map(|name| house.machine(name));
        let asker = |after| {
            let (told, heard) = mpsc::unbounded_channel();
            let (asks, after) = (vec![asked(5, 1)], Duration::from_secs(after));
            (Box::new(Asker { asks, after, told }), heard)
        };
        let ((acts, first_heard), (stands_by, second_heard)) = (asker(first), asker(second));
        let _lives = [
            launch(house.built(&plan_executor::PLUGIN), "plan-executor", &here, false),
            launch(Box::new(Lamp), "lamp", &here, false),
            launch(acts, "plan-requester", &here, true),
            launch(stands_by, "plan-requester", &there, true),
        ];
        for mut heard in [first_heard, second_heard] {
            // The lamp agrees, and its method times out after a minute.
            let answer = timeout(Duration::from_secs(120), heard.recv()).await.expect("in time");
            let report: Report = answer.expect("it lives").content_as().expect("a report");
            assert_eq!(report.outcome, Outcome::Failed, "{report:?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_running_plan_of_another_replica_continues_and_is_reported() {
    for (first, second) in [(5, 9), (9, 5)] {
        let answer = first_answer(vec![asked(first, 1), asked(second, 1)]).await;
        assert_eq!(answer.performative, Performative::Refuse, "{answer:?}");
        let refusal: Refusal = answer.content_as().expect("a refusal");
        assert_eq!(refusal.reason, Reason::StaleToken);
        assert_eq!(refusal.under_way.as_deref(), Some(&execute(first, 1)));
    }
}

#[tokio::test(start_paused = true)]
async fn a_later_plan_of_the_same_requester_replaces_the_first() {
    let answer = first_answer(vec![asked(5, 1), asked(5, 2)]).await;
    assert_eq!(answer.performative, Performative::Confirm, "{answer:?}");
    let report: Report = answer.content_as().expect("a report");
    assert_eq!(report.outcome, Outcome::Cancelled, "{report:?}");
    let answer = first_answer(vec![asked(5, 2), asked(5, 1)]).await;
    let refusal: Refusal = answer.content_as().expect("a refusal");
    assert_eq!((refusal.reason, refusal.under_way), (Reason::StaleToken, None));
}

/// The Plan Requester that made the plan no longer leads. Its request may arrive before the plan is
/// called off, or after. No report says that the plan was carried out.
#[tokio::test(start_paused = true)]
async fn a_plan_that_is_called_off_neither_continues_nor_begins() {
    let off = || Request::CancelPlan(CancelPlan { term: 5, round: 1 });
    for asks in [vec![asked(5, 1), off()], vec![off(), asked(5, 1)]] {
        for answer in first_answers(asks, 2, Duration::from_secs(30)).await {
            let report: Report = answer.content_as().expect("a report");
            assert_eq!(report.outcome, Outcome::Cancelled, "{report:?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn calling_off_one_plan_keeps_another_running() {
    let asks = vec![asked(5, 1), Request::CancelPlan(CancelPlan { term: 9, round: 1 })];
    let refusal: Refusal = first_answer(asks).await.content_as().expect("a refusal");
    assert_eq!(refusal.under_way.as_deref(), Some(&execute(5, 1)));
}

/// A lamp that does not end its action, and tells that it was cancelled.
struct SlowLamp {
    /// Whether the lamp agrees to the action.
    agrees: bool,
    cancelled: mpsc::UnboundedSender<()>,
}

impl Agent for SlowLamp {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, |lamp: &mut SlowLamp, message, ctx| {
                if lamp.agrees {
                    let agreed = serde_json::json!({});
                    ctx.answer(&Participation::of(&message), Performative::Agree, &agreed);
                }
            })
            .on(Performative::Cancel, |lamp: &mut SlowLamp, _, _| {
                lamp.cancelled.send(()).expect("the test listens");
            })
    }
}

/// The lamp may have begun, although its answer did not come in time.
#[tokio::test(start_paused = true)]
async fn a_step_that_is_given_up_as_lost_is_cancelled() {
    for agrees in [false, true] {
        let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, Vec::new());
        let here = house.machine("here");
        let (told, mut heard) = mpsc::unbounded_channel();
        let (cancelled, mut cancels) = mpsc::unbounded_channel();
        let asker = Asker { asks: vec![asked(5, 1)], after: Duration::from_secs(1), told };
        let _lives = [
            launch(house.built(&plan_executor::PLUGIN), "plan-executor", &here, false),
            launch(Box::new(SlowLamp { agrees, cancelled }), "lamp", &here, false),
            launch(Box::new(asker), "plan-requester", &here, false),
        ];
        let answer = timeout(Duration::from_secs(120), heard.recv()).await.expect("in time");
        let report: Report = answer.expect("it lives").content_as().expect("a report");
        assert!(report.detail.contains("did not answer in time"), "{report:?}");
        let cancelled = timeout(Duration::from_secs(1), cancels.recv()).await;
        assert_eq!(cancelled, Ok(Some(())), "the action goes on: agrees: {agrees}");
    }
}
