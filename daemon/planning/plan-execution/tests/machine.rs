//! Every event in every phase, and random sequences of events, with a plan of three steps.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{
    Execute, Heartbeat, Method, Offer, Offers, Outcome, Reason, Refusal, Report, Snapshot,
};
use acl::{AgentId, Incarnation, Millis};
use pddl::knowledge::Knowledge;
use plan_execution::{
    CheckDelay, ExecutionCommand, ExecutionEvent, ExecutionPhase, LastHeartbeats, PlanState,
    StepPart, TRANSITIONS, is_lawful,
};
use proptest::prelude::*;

const DOMAIN: &str = "(define (domain office)
    (:requirements :typing)
    (:types robot lamp place)
    (:predicates (at ?r - robot ?p - place) (lit ?p - place) (shown ?p - place))
    (:action go :parameters (?r - robot ?from ?to - place)
        :precondition (at ?r ?from) :effect (and (not (at ?r ?from)) (at ?r ?to)))
    (:action light :parameters (?l - lamp ?p - place) :precondition () :effect (lit ?p))
    (:action show :parameters (?r - robot ?p - place)
        :precondition (and (at ?r ?p) (lit ?p)) :effect (shown ?p)))";

/// A plan in which the steps 0 and 1 are independent, and step 2 needs both.
const PLAN: &str = "(go robot hall room)\n(light lamp room)\n(show robot room)";

/// The part of the only agent of a step.
fn part(step: usize) -> StepPart {
    StepPart { step, position: 0 }
}

fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

fn problem(facts: &str, goal: &str) -> String {
    format!(
        "(define (problem p) (:domain office)
            (:objects robot - robot lamp - lamp hall room - place)
            (:init {facts}){goal})"
    )
}

fn offers() -> Offers {
    let offer = |action: &str| {
        let timeout = Millis(Duration::from_secs(5));
        let method = Method { method: action.to_owned(), arguments: BTreeMap::new(), timeout };
        let schema = action.to_owned();
        (action.to_owned(), Offer { schema, guard: String::new(), method: Some(method), agents: 1 })
    };
    let robot = [offer("go"), offer("show")].into();
    [(agent("robot"), robot), (agent("lamp"), [offer("light")].into())].into()
}

fn execute(plan: &str, goal: &str) -> Execute {
    Execute {
        domain: DOMAIN.to_owned(),
        problem: problem("(at robot hall)", &format!(" (:goal {goal})")),
        plan: plan.to_owned(),
        epoch: 1,
        term: 1,
        round: 1,
        done: Vec::new(),
        offers: offers(),
        knowledge: BTreeMap::new(),
    }
}

fn snapshot(facts: &str) -> ExecutionEvent {
    let snapshot = Snapshot {
        epoch: 1,
        revision: 1,
        domain: DOMAIN.to_owned(),
        digest: String::new(),
        problem: problem(facts, ""),
        offers: offers(),
        guards: BTreeMap::new(),
        former: Vec::new(),
        knowledge: BTreeMap::new(),
        conflicts: BTreeMap::new(),
    };
    ExecutionEvent::StateReceived {
        snapshot: Box::new(snapshot),
        knowledge: Box::new(Knowledge::default()),
        are_agents_absent: false,
    }
}

/// Owner of a running plan in these tests, with the last heartbeats of the agents. Each command is
/// checked when the owner receives it.
struct Owner {
    state: PlanState,
    heartbeats: LastHeartbeats,
    sequence: u64,
    requested: BTreeSet<usize>,
    /// The steps that are neither confirmed nor closed.
    open: BTreeSet<usize>,
    /// The steps whose agents have not said that they are over. A lost step is one of them.
    acting: BTreeSet<usize>,
    confirmed: BTreeSet<usize>,
    cancelled: BTreeSet<usize>,
    ends: Vec<Report>,
}

impl Owner {
    fn new() -> Owner {
        Owner::of(PLAN, "(shown room)")
    }

    fn of(plan: &str, goal: &str) -> Owner {
        let state = PlanState::new(&execute(plan, goal), Knowledge::default());
        let state = state.expect("the plan is valid");
        Owner {
            state,
            heartbeats: LastHeartbeats::default(),
            sequence: 0,
            requested: BTreeSet::new(),
            open: BTreeSet::new(),
            acting: BTreeSet::new(),
            confirmed: BTreeSet::new(),
            cancelled: BTreeSet::new(),
            ends: Vec::new(),
        }
    }

    /// Stores a new heartbeat of the robot and returns the event of its arrival.
    fn beat(&mut self, facts: &str) -> ExecutionEvent {
        self.sequence += 1;
        let beat = Heartbeat {
            digest: String::new(),
            sequence: self.sequence,
            facts: facts.to_owned(),
            known_for: BTreeMap::new(),
            period: Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        };
        self.heartbeats.store_heartbeat(&agent("robot"), Incarnation(1), &beat);
        ExecutionEvent::HeartbeatReceived(agent("robot"))
    }

    fn tell(&mut self, event: ExecutionEvent) -> Vec<ExecutionCommand> {
        let (kind, from) = (event.kind(), self.state.phase());
        if let ExecutionEvent::StepReported(StepPart { step, .. }, report) = &event
            && report.outcome == Outcome::Done
            && self.open.remove(step)
        {
            self.confirmed.insert(*step);
        }
        match &event {
            ExecutionEvent::StepReported(StepPart { step, .. }, report)
                if report.outcome.is_final() =>
            {
                self.acting.remove(step);
            }
            ExecutionEvent::StepRefused(StepPart { step, .. }, _) => {
                self.acting.remove(step);
            }
            _ => (),
        }
        if let ExecutionEvent::StepAbandoned(StepPart { step, .. }) = &event
            && from == ExecutionPhase::GivingUp
        {
            self.open.remove(step);
        }
        let commands = self.state.handle(event, &self.heartbeats);
        let to = self.state.phase();
        let is_listed = TRANSITIONS.iter().any(|row| row.event == kind && row.from == from);
        if !is_listed {
            assert_eq!(from, to);
            assert!(commands.is_empty(), "{kind:?} in {from:?}: {commands:?}");
        }
        assert!(from == to || is_lawful(kind, from, to), "{kind:?}: {from:?} to {to:?}");
        commands.iter().for_each(|command| self.obey(command));
        self.check();
        commands
    }

    fn obey(&mut self, command: &ExecutionCommand) {
        match command {
            ExecutionCommand::RequestStep(StepPart { step, .. }, request) => {
                assert!(self.requested.insert(*step), "step {step} is requested twice");
                let needs = if *step == 2 { vec![0, 1] } else { Vec::new() };
                assert!(needs.iter().all(|before| self.confirmed.contains(before)));
                assert_eq!(request.agent, agent(if *step == 1 { "lamp" } else { "robot" }));
                self.open.insert(*step);
                self.acting.insert(*step);
            }
            ExecutionCommand::CancelStep(StepPart { step, .. }) => {
                assert!(self.open.contains(step), "step {step} does not run");
                assert!(self.cancelled.insert(*step), "step {step} is cancelled twice");
            }
            ExecutionCommand::BeginStep(_) | ExecutionCommand::CompleteStep(_) => {
                panic!("no joint action is in the plan")
            }
            ExecutionCommand::CloseStep(StepPart { step, .. }) => assert!(self.open.remove(step)),
            ExecutionCommand::End(report) => self.ends.push(report.clone()),
            ExecutionCommand::Report(report) => assert!(!report.outcome.is_final()),
            ExecutionCommand::SendChange(change) => assert!(change.owner.is_some()),
            ExecutionCommand::ScheduleCheck(_)
            | ExecutionCommand::QueryState
            | ExecutionCommand::DropQuery
            | ExecutionCommand::AwaitEffects => {}
        }
    }

    /// Checks the invariants that hold between any two events.
    fn check(&self) {
        match self.state.phase() {
            ExecutionPhase::Running => assert!(self.ends.is_empty()),
            ExecutionPhase::AwaitingEffects => {
                assert!(self.ends.is_empty() && self.open.is_empty());
            }
            ExecutionPhase::GivingUp => {
                assert!(self.ends.is_empty() && !self.open.is_empty());
                assert!(self.acting.is_subset(&self.cancelled), "a step of it runs on");
            }
            ExecutionPhase::Ended => {
                assert_eq!(self.ends.len(), 1, "its requesters are told one end");
                assert!(self.open.is_empty(), "a step of an ended plan is awaited");
                assert!(self.acting.is_subset(&self.cancelled), "a step of an ended plan runs on");
                let is_done = self.ends[0].outcome == Outcome::Done;
                assert!(!is_done || self.confirmed.len() == self.state.done().len());
            }
        }
    }
}

fn done() -> Report {
    Report::new(Outcome::Done, "it is done")
}

/// Returns one event of each kind and variant.
fn events(owner: &mut Owner) -> Vec<ExecutionEvent> {
    let report = |outcome| Report::new(outcome, "a reason");
    let uncertain = Report { declined: Some(Reason::Uncertain), ..report(Outcome::Failed) };
    let changed = |left: &[&str], joined: &[&str]| ExecutionEvent::WorldChanged {
        left: left.iter().map(|name| agent(name)).collect(),
        joined: joined.iter().map(|name| agent(name)).collect(),
    };
    let mut all = vec![
        ExecutionEvent::Started,
        ExecutionEvent::EffectsOverdue,
        changed(&["robot"], &[]),
        changed(&[], &["robot"]),
        changed(&["other"], &[]),
        ExecutionEvent::CheckDue(CheckDelay::Settle),
        ExecutionEvent::CheckDue(CheckDelay::GraceAfterDeparture),
        ExecutionEvent::CheckDue(CheckDelay::Grace),
        snapshot("(at robot hall)"),
        snapshot("(at robot room) (lit room)"),
        snapshot(""),
        ExecutionEvent::ChangeAnswered,
        ExecutionEvent::CancelRequested(report(Outcome::Cancelled)),
        owner.beat("(at robot hall)"),
        owner.beat("(at robot room) (shown room)"),
    ];
    for step in 0..3 {
        all.extend([
            ExecutionEvent::StepReported(part(step), done()),
            ExecutionEvent::StepReported(part(step), report(Outcome::Failed)),
            ExecutionEvent::StepReported(part(step), uncertain.clone()),
            ExecutionEvent::StepReported(part(step), report(Outcome::Cancelled)),
            ExecutionEvent::StepReported(part(step), report(Outcome::Progress)),
            ExecutionEvent::StepRefused(part(step), Refusal::new(Reason::Busy, "busy")),
            ExecutionEvent::StepRefused(part(step), Refusal::new(Reason::Incapable, "no")),
            ExecutionEvent::StepLost(part(step), "`robot` did not answer in time".to_owned()),
            ExecutionEvent::StepAgreed { part: part(step), has_begun: false },
            ExecutionEvent::StepRepeated(part(step)),
            ExecutionEvent::StepAbandoned(part(step)),
        ]);
    }
    all
}

#[test]
fn independent_steps_run_in_parallel_and_the_last_one_after_both() {
    let mut owner = Owner::new();
    owner.tell(ExecutionEvent::Started);
    assert_eq!(owner.open, [0, 1].into());
    owner.tell(ExecutionEvent::StepReported(part(1), done()));
    assert_eq!(owner.open, [0].into());
    owner.tell(ExecutionEvent::StepReported(part(0), done()));
    assert_eq!(owner.open, [2].into());
    owner.tell(ExecutionEvent::StepReported(part(2), done()));
    assert_eq!(owner.ends.len(), 1);
    assert_eq!(owner.ends[0].outcome, Outcome::Done);
}

#[test]
fn a_confirmation_that_the_next_heartbeat_contradicts_fails_the_plan() {
    for (next, expected) in
        [("(at robot hall)", Outcome::Failed), ("(at robot room)", Outcome::Done)]
    {
        let mut owner = Owner::new();
        owner.tell(ExecutionEvent::Started);
        owner.tell(ExecutionEvent::StepReported(part(1), done()));
        let before = owner.beat("(at robot hall)");
        owner.tell(before);
        owner.tell(ExecutionEvent::StepReported(part(0), done()));
        let after = owner.beat(next);
        owner.tell(after);
        owner.tell(ExecutionEvent::StepReported(part(2), done()));
        assert_eq!(owner.ends.first().map(|end| end.outcome), Some(expected), "{next}");
    }
}

#[test]
fn a_completed_plan_waits_for_the_heartbeat_that_verifies_it() {
    for (next, expected) in [
        (Some("(at robot room)"), Outcome::Done),
        (Some("(at robot hall)"), Outcome::Failed),
        (None, Outcome::Done),
    ] {
        let mut owner = Owner::of("(go robot hall room)", "(at robot room)");
        owner.tell(ExecutionEvent::Started);
        let before = owner.beat("(at robot hall)");
        owner.tell(before);
        let commands = owner.tell(ExecutionEvent::StepReported(part(0), done()));
        assert!(commands.iter().any(|command| matches!(command, ExecutionCommand::AwaitEffects)));
        assert_eq!(owner.state.phase(), ExecutionPhase::AwaitingEffects);
        let event = match next {
            Some(facts) => owner.beat(facts),
            None => ExecutionEvent::EffectsOverdue,
        };
        owner.tell(event);
        assert_eq!(owner.ends.first().map(|end| end.outcome), Some(expected), "{next:?}");
    }
}

#[test]
fn random_events_reach_every_row_of_the_table() {
    let mut random = 1_u64;
    let mut seen = BTreeSet::new();
    for round in 0..600 {
        let mut owner = match round % 2 {
            0 => Owner::new(),
            _ => Owner::of("(go robot hall room)", "(at robot room)"),
        };
        seen.insert((ExecutionEvent::Started.kind(), owner.state.phase()));
        owner.tell(ExecutionEvent::Started);
        if round % 4 == 1 {
            // The robot confirms a change that its last heartbeat contradicts.
            let before = owner.beat("(at robot hall)");
            owner.tell(before);
            owner.tell(ExecutionEvent::StepReported(part(0), done()));
        }
        for _ in 0..30 {
            let all = events(&mut owner);
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let which = usize::try_from(random >> 33).expect("it has 31 bits");
            let event = all[1 + which % (all.len() - 1)].clone();
            seen.insert((event.kind(), owner.state.phase()));
            owner.tell(event);
        }
    }
    let rows = TRANSITIONS.iter().map(|row| (row.event, row.from));
    let unseen: Vec<_> = rows.filter(|row| !seen.contains(row)).collect();
    assert!(unseen.is_empty(), "rows that no sequence reaches: {unseen:?}");
}

#[test]
fn a_lost_step_is_cancelled_before_the_plan_ends() {
    let mut owner = Owner::of("(go robot hall room)", "(at robot room)");
    owner.tell(ExecutionEvent::Started);
    let lost = ExecutionEvent::StepLost(part(0), "`robot` did not answer in time".to_owned());
    let commands = owner.tell(lost);
    assert!(
        matches!(
            commands[..],
            [
                ExecutionCommand::CancelStep(StepPart { step: 0, .. }),
                ExecutionCommand::CloseStep(StepPart { step: 0, .. }),
                ExecutionCommand::End(_)
            ]
        ),
        "{commands:?}"
    );
}

#[test]
fn a_check_that_fails_twice_ends_the_plan() {
    let mut owner = Owner::new();
    owner.tell(ExecutionEvent::Started);
    owner.tell(ExecutionEvent::WorldChanged { left: Vec::new(), joined: Vec::new() });
    owner.tell(ExecutionEvent::CheckDue(CheckDelay::Settle));
    owner.tell(snapshot(""));
    assert_eq!(owner.state.phase(), ExecutionPhase::Running);
    owner.tell(ExecutionEvent::CheckDue(CheckDelay::Settle));
    owner.tell(snapshot(""));
    assert_eq!(owner.state.phase(), ExecutionPhase::GivingUp);
    owner.tell(ExecutionEvent::StepAbandoned(part(0)));
    owner
        .tell(ExecutionEvent::StepReported(part(1), Report::new(Outcome::Cancelled, "it stopped")));
    assert_eq!(owner.ends.len(), 1);
    assert_eq!(owner.ends[0].outcome, Outcome::Failed);
}

#[test]
fn an_incapable_agent_is_reported_and_a_busy_one_is_not() {
    for (reason, expected) in [(Reason::Busy, None), (Reason::Incapable, Some("(light lamp room)"))]
    {
        let mut owner = Owner::new();
        owner.tell(ExecutionEvent::Started);
        owner.tell(ExecutionEvent::StepRefused(part(1), Refusal::new(reason, "no")));
        owner.tell(ExecutionEvent::StepAbandoned(part(0)));
        let end = owner.ends.first().expect("it has ended");
        assert_eq!(end.action.as_deref(), expected);
        assert_eq!(end.declined, Some(reason));
    }
}

#[test]
fn an_action_that_its_surroundings_hinder_is_not_avoided() {
    for (declined, expected) in [(Some(Reason::Conflict), None), (None, Some("(light lamp room)"))]
    {
        let mut owner = Owner::new();
        owner.tell(ExecutionEvent::Started);
        let report = Report { declined, ..Report::new(Outcome::Failed, "the way is blocked") };
        owner.tell(ExecutionEvent::StepReported(part(1), report));
        owner.tell(ExecutionEvent::StepAbandoned(part(0)));
        let end = owner.ends.first().expect("it has ended");
        assert_eq!(end.action.as_deref(), expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1_000, ..ProptestConfig::default() })]

    /// In any order of events: no step is requested twice or too early, the plan ends at most once,
    /// and no step runs after the end.
    #[test]
    fn random_events_keep_the_invariants(
        happenings in prop::collection::vec(0_usize..42, 1..60),
    ) {
        let mut owner = Owner::new();
        owner.tell(ExecutionEvent::Started);
        for which in happenings {
            let all = events(&mut owner);
            // `Started` comes first and once.
            let event = all[1 + which % (all.len() - 1)].clone();
            owner.tell(event);
        }
    }
}
