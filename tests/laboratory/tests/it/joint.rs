//! Tests of joint planning at the Plan Requester: a goal that no agent reaches alone is planned for
//! with the actions of all, each agent agrees to its part before anything is executed, and agents
//! that decline, leave or keep silent are left out. A goal that bids cover needs no further message.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::Performative;
use acl::content::{
    Bid, CallForProposals, Guard, Keep, Offer, Offers, Outcome, PartStep, Proposal, Reason, Report,
    Request, Snapshot,
};
use agent::{Agent, Callbacks, Context, Mode, Participation, Resource};
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::house::sayer::{PATIENCE, Sayer};
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing :action-costs)
    (:types agent) (:predicates (open) (inside) (bright) (can-unlock ?a - agent)
        (can-go ?a - agent) (can-light ?a - agent))
    (:functions (total-cost) - number (way ?a - agent) - number)
    (:action unlock :parameters (?a - agent) :precondition (can-unlock ?a)
        :effect (and (open) (increase (total-cost) 1)))
    (:action light :parameters (?a - agent) :precondition (can-light ?a)
        :effect (and (bright) (increase (total-cost) 1)))
    (:action go :parameters (?a - agent) :precondition (and (can-go ?a) (open))
        :effect (and (inside) (increase (total-cost) (way ?a)))))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects keeper near far - agent)
    (:init (can-unlock keeper) (can-light keeper) (can-go near) (can-go far)
        (= (way near) 1) (= (way far) 9) (= (total-cost) 0))
    (:goal (and)) (:metric minimize (total-cost)))";

/// A Domain Maintainer with a keeper that unlocks a door, and two robots that go through it.
struct Maintainer;

impl Agent for Maintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, ctx: &mut Context<Self>) -> Option<String> {
        let offered =
            [("keeper", vec!["unlock", "light"]), ("near", vec!["go"]), ("far", vec!["go"])];
        let mut offers = Offers::new();
        let mut guards = BTreeMap::new();
        for (agent, actions) in offered {
            if ctx.find(&name(agent)).is_none() {
                continue;
            }
            for action in actions {
                let (schema, guard) = (action.to_owned(), format!("(can-{action} {agent})"));
                let offer = Offer { schema: schema.clone(), guard, method: None, agents: 1 };
                offers.entry(name(agent)).or_default().insert(schema.clone(), offer);
                let guard = Guard { action: schema.clone(), predicate: format!("can-{action}") };
                guards.insert(schema, guard);
            }
        }
        let snapshot = Snapshot {
            epoch: 1,
            revision: 1,
            domain: DOMAIN.to_owned(),
            digest: String::new(),
            problem: PROBLEM.to_owned(),
            offers,
            guards,
            former: Vec::new(),
            knowledge: [].into(),
            conflicts: [].into(),
        };
        (resource == Resource::Domain).then(|| serde_json::to_string(&snapshot).expect("JSON"))
    }
}

/// What an agent does when it is asked to agree to its part.
#[derive(Clone, Copy, PartialEq)]
enum Answer {
    Agrees,
    Declines,
    Dies,
    KeepsSilent,
    /// Bids as if it had been called for proposals.
    Misunderstands,
}

/// An agent that refuses to plan alone, except for light.
struct Member {
    answer: Answer,
    /// What happens, in words.
    told: mpsc::UnboundedSender<String>,
}

impl Member {
    fn called(&mut self, message: acl::Message, ctx: &mut Context<Self>) {
        let call: CallForProposals = message.content_as().expect("a call");
        let participation = Participation::of(&message);
        let tell = |text: String| self.told.send(text).expect("the test listens");
        let id = ctx.id().clone();
        let Some(part) = call.part else {
            tell(format!("{id} called"));
            if id == name("keeper") && call.conjuncts == ["(bright)"] {
                let plan = "(light keeper)".to_owned();
                let proposals = vec![Proposal { covers: call.conjuncts, plan, cost: 1.0 }];
                let bid = Bid { proposals, ..Bid::default() };
                return ctx.answer(&participation, Performative::Agree, &bid);
            }
            return ctx.refuse(&participation, Reason::Incapable, "nothing");
        };
        let steps: Vec<String> = { part.steps.iter() }
            .map(|step| match step {
                PartStep::Own(step) => step.clone(),
                PartStep::Others(changes) => format!("[{changes}]"),
            })
            .collect();
        tell(format!("{id} asked {}", steps.join(" ")));
        match self.answer {
            Answer::Agrees => {
                let bid = Bid { agreed: Some(part.digest), ..Bid::default() };
                ctx.answer(&participation, Performative::Agree, &bid);
            }
            Answer::Misunderstands => {
                ctx.answer(&participation, Performative::Agree, &Bid::default());
            }
            Answer::Declines => ctx.refuse(&participation, Reason::Incapable, "too heavy"),
            Answer::Dies => tell(format!("{id} dies")),
            Answer::KeepsSilent => (),
        }
    }

    fn judged(&mut self, message: acl::Message, ctx: &mut Context<Self>) {
        let verdict = format!("{} {}", ctx.id(), message.performative);
        self.told.send(verdict).expect("the test listens");
    }
}

impl Agent for Member {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Cfp, Self::called)
            .on_broadcast(Performative::Cfp, Self::called)
            .on(Performative::AcceptProposal, Self::judged)
            .on(Performative::RejectProposal, Self::judged)
            .on_broadcast(Performative::RejectProposal, Self::judged)
    }
}

/// An executor that tells the plans it is asked to execute.
struct Executor(mpsc::UnboundedSender<String>);

impl Agent for Executor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Executor, message, ctx| {
            if let Ok(Request::Execute(asked)) = message.content_as::<Request>() {
                let steps: Vec<&str> =
                    asked.plan.lines().filter(|line| line.starts_with('(')).collect();
                executor.0.send(format!("execute {}", steps.join(" "))).expect("the test listens");
            }
            let report = Report::new(Outcome::Progress, "for the test");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        })
    }
}

/// Plays a goal with these answers of the robots `near` and `far` until a plan is executed or the
/// goal fails. Returns what happened, and the reports to the asker.
async fn played(goal: &str, near: Answer, far: Answer) -> (Vec<String>, Vec<Report>) {
    let house = House::new(Mode::Decentralized, DOMAIN, PROBLEM, Vec::new());
    let machine = house.machine("here");
    let (told, mut heard) = mpsc::unbounded_channel();
    let (sayer, mut reports) = Sayer::of_goal(goal, Keep::Achieve);
    let member = |answer| Box::new(Member { answer, told: told.clone() });
    let _lives = [
        launch(Box::new(Maintainer), "domain-maintainer", &machine, false),
        launch(member(Answer::Agrees), "keeper", &machine, false),
        launch(member(far), "far", &machine, false),
        launch(Box::new(Executor(told.clone())), "plan-executor", &machine, false),
        launch(house.built(&plan_requester::PLUGIN), "plan-requester", &machine, false),
    ];
    let robot = launch(member(near), "near", &machine, false);
    let _asker = launch(Box::new(sayer), "asker", &machine, false);
    let (mut events, mut said) = (Vec::new(), Vec::new());
    let ended = timeout(PATIENCE, async {
        loop {
            tokio::select! {
                event = heard.recv() => {
                    let event = event.expect("the members live");
                    if event.ends_with("dies") {
                        robot.abort();
                    }
                    let is_last = event.starts_with("execute");
                    events.push(event);
                    if is_last {
                        break;
                    }
                }
                Some(report) = reports.recv() => {
                    let is_last = report.outcome.is_final();
                    said.push(report);
                    if is_last {
                        break;
                    }
                }
            }
        }
    });
    ended.await.unwrap_or_else(|_| panic!("no end: {events:?} {said:?}"));
    // The last progress report may come after the request to the executor.
    while let Ok(Some(report)) = timeout(Duration::from_millis(50), reports.recv()).await {
        said.push(report);
    }
    while let Ok(event) = heard.try_recv() {
        events.push(event);
    }
    (events, said)
}

fn position(events: &[String], text: &str) -> usize {
    let found = events.iter().position(|event| event.starts_with(text));
    found.unwrap_or_else(|| panic!("`{text}` did not happen: {events:#?}"))
}

#[tokio::test(start_paused = true)]
async fn agents_that_need_each_other_agree_before_anything_is_executed() {
    let (events, reports) = played("(inside)", Answer::Agrees, Answer::Agrees).await;
    let executed = position(&events, "execute (unlock keeper) (go near)");
    let asked = [
        position(&events, "keeper asked (unlock keeper)"),
        position(&events, "near asked [(open)] (go near)"),
    ];
    assert!(asked.iter().all(|asked| *asked < executed), "{events:#?}");
    assert!(!events.iter().any(|event| event.starts_with("far asked")), "{events:#?}");
    for winner in ["keeper accept-proposal", "near accept-proposal"] {
        position(&events, winner);
    }
    let told = "no agent reaches `(inside)` by itself; `keeper` and `near` do it together: \
                `keeper` does `(unlock keeper)` so that `near` can `(go near)`";
    assert!(reports.iter().any(|report| report.detail == told), "{reports:#?}");
}

#[tokio::test(start_paused = true)]
async fn a_goal_that_bids_cover_needs_no_further_message() {
    let (events, _) = played("(bright)", Answer::Agrees, Answer::Agrees).await;
    let calls = events.iter().filter(|event| event.ends_with("called")).count();
    assert_eq!(calls, 3, "one call to each: {events:#?}");
    assert!(!events.iter().any(|event| event.contains("asked")), "{events:#?}");
    position(&events, "execute (light keeper)");
}

#[tokio::test(start_paused = true)]
async fn an_agent_that_does_not_take_part_is_replaced() {
    for (answer, why) in [
        (Answer::Declines, "`near` declines its part: too heavy"),
        (Answer::Misunderstands, "`near` declines its part: it takes no part in joint plans"),
        (Answer::Dies, "`near` has left"),
        (Answer::KeepsSilent, "`near` did not answer for its part"),
    ] {
        let (events, reports) = played("(inside)", answer, Answer::Agrees).await;
        position(&events, "execute (unlock keeper) (go far)");
        let told = reports.iter().any(|report| report.detail.contains(why));
        assert!(told, "{why}: {reports:#?}");
    }
}

#[tokio::test(start_paused = true)]
async fn nothing_is_executed_if_nobody_takes_part() {
    let (events, reports) = played("(inside)", Answer::Declines, Answer::Declines).await;
    assert!(!events.iter().any(|event| event.starts_with("execute")), "{events:#?}");
    position(&events, "keeper reject-proposal");
    let last = reports.last().expect("the end is reported");
    assert_eq!(last.outcome, Outcome::Failed);
    let told = "`keeper` and `near` do together, in 2 steps, and not now: `near` declines its part: \
                too heavy; `far` declines its part: too heavy";
    assert!(last.detail.contains(told), "{}", last.detail);
}

#[tokio::test(start_paused = true)]
async fn a_goal_beyond_all_agents_is_refused_with_their_names() {
    let (_, reports) = played("(and (inside) (not (open)))", Answer::Agrees, Answer::Agrees).await;
    let last = reports.last().expect("the end is reported");
    assert_eq!(last.outcome, Outcome::Failed);
    let members = "(planned with the actions of `far`, `keeper`, `near`)";
    assert!(last.detail.ends_with(members), "{}", last.detail);
}
