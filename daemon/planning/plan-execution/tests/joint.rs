//! Execution of a joint action: two robots carry a table together.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Execute, Method, Offer, Outcome, Reason, Refusal, Report};
use acl::{AgentId, Millis};
use pddl::knowledge::Knowledge;
use plan_execution::{
    ExecutionCommand, ExecutionEvent, ExecutionPhase, LastHeartbeats, PlanState, StepPart,
};

const DOMAIN: &str = "(define (domain office)
    (:requirements :typing :equality :negative-preconditions)
    (:types robot place)
    (:predicates (at ?r - robot ?p - place) (table-at ?p - place))
    (:action carry :agent (?a - robot ?b - robot) :parameters (?from ?to - place)
        :precondition (and (not (= ?a ?b)) (at ?a ?from) (at ?b ?from) (table-at ?from))
        :effect (and (not (at ?a ?from)) (at ?a ?to) (not (at ?b ?from)) (at ?b ?to)
            (not (table-at ?from)) (table-at ?to))))";

const R1: StepPart = StepPart { step: 0, position: 0 };
const R2: StepPart = StepPart { step: 0, position: 1 };

fn running() -> (PlanState, Vec<ExecutionCommand>) {
    let id = |name| AgentId::new(name).expect("a name");
    let offer = |seconds| {
        let timeout = Millis(Duration::from_secs(seconds));
        let method = Method { method: "carry".into(), arguments: BTreeMap::new(), timeout };
        let (schema, guard) = ("carry".to_owned(), String::new());
        [("carry".to_owned(), Offer { schema, guard, method: Some(method), agents: 2 })].into()
    };
    let execute = Execute {
        domain: DOMAIN.to_owned(),
        problem: "(define (problem p) (:domain office)
            (:objects r1 r2 - robot hall lab - place)
            (:init (at r1 hall) (at r2 hall) (table-at hall)) (:goal (table-at lab)))"
            .to_owned(),
        plan: "(carry r1 r2 hall lab)".to_owned(),
        epoch: 1,
        term: 1,
        round: 1,
        done: Vec::new(),
        offers: [(id("r1"), offer(5)), (id("r2"), offer(60))].into(),
        knowledge: BTreeMap::new(),
    };
    let mut state = PlanState::new(&execute, Knowledge::default()).expect("a valid plan");
    let commands = state.handle(ExecutionEvent::Started, &LastHeartbeats::default());
    (state, commands)
}

fn tell(state: &mut PlanState, event: ExecutionEvent) -> Vec<ExecutionCommand> {
    state.handle(event, &LastHeartbeats::default())
}

fn report(outcome: Outcome) -> Report {
    Report::new(outcome, "so it is")
}

fn begun(commands: &[ExecutionCommand]) -> Vec<StepPart> {
    let begun = commands.iter().filter_map(|command| match command {
        ExecutionCommand::BeginStep(part) => Some(*part),
        _ => None,
    });
    begun.collect()
}

/// Returns the final report in some commands, and the parts that they cancel.
fn end(commands: &[ExecutionCommand]) -> (Option<&Report>, Vec<StepPart>) {
    let ends = commands.iter().find_map(|command| match command {
        ExecutionCommand::End(report) => Some(report),
        _ => None,
    });
    let cancelled = commands.iter().filter_map(|command| match command {
        ExecutionCommand::CancelStep(part) => Some(*part),
        _ => None,
    });
    (ends, cancelled.collect())
}

#[test]
fn both_are_asked_and_begin_when_both_have_agreed() {
    let (mut state, commands) = running();
    let requests = commands.iter().filter_map(|command| match command {
        ExecutionCommand::RequestStep(part, request) => {
            assert_eq!(request.action, "(carry r1 r2 hall lab)");
            assert_eq!(request.ready_for, Some(Duration::from_secs(60)));
            Some((*part, request.agent.to_string()))
        }
        _ => None,
    });
    assert_eq!(requests.collect::<Vec<_>>(), [(R1, "r1".to_owned()), (R2, "r2".to_owned())]);
    assert!(begun(&tell(&mut state, ExecutionEvent::StepAgreed(R2))).is_empty());
    assert!(begun(&tell(&mut state, ExecutionEvent::StepAgreed(R2))).is_empty());
    assert_eq!(begun(&tell(&mut state, ExecutionEvent::StepAgreed(R1))), [R1, R2]);
    let first = tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Done)));
    assert!(first.is_empty(), "the step is not done yet: {first:?}");
    let both = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Done)));
    let changes: Vec<(String, String)> = both
        .iter()
        .filter_map(|command| match command {
            ExecutionCommand::SendChange(change) => {
                Some((change.owner.as_ref()?.to_string(), change.believe.clone()))
            }
            _ => None,
        })
        .collect();
    let owned = |owner: &str, fact: &str| {
        changes.iter().any(|(agent, facts)| agent == owner && facts.contains(fact))
    };
    assert!(owned("r1", "(at r1 lab)") && owned("r1", "(table-at lab)"), "{changes:?}");
    assert!(owned("r2", "(at r2 lab)") && !owned("r1", "(at r2 lab)"), "{changes:?}");
    assert_eq!(end(&both).0.map(|report| report.outcome), Some(Outcome::Done));
}

#[test]
fn if_one_cannot_the_other_is_cancelled_before_it_begins() {
    let (mut state, _) = running();
    tell(&mut state, ExecutionEvent::StepAgreed(R1));
    let refusal = Refusal::new(Reason::Incapable, "it has no hands");
    let commands = tell(&mut state, ExecutionEvent::StepRefused(R2, refusal));
    assert_eq!(end(&commands), (None, vec![R1]));
    assert!(begun(&tell(&mut state, ExecutionEvent::StepAgreed(R1))).is_empty());
    let commands = tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Cancelled)));
    let (ended, _) = end(&commands);
    let ended = ended.expect("it ends");
    assert_eq!(ended.agent.as_ref().map(AgentId::as_str), Some("r2"), "the other is not blamed");
    assert_eq!(ended.action.as_deref(), Some("(carry r1 r2 hall lab)"));
}

#[test]
fn a_step_of_which_one_part_fails_has_no_effect() {
    for is_abandoned in [false, true] {
        let (mut state, _) = running();
        tell(&mut state, ExecutionEvent::StepAgreed(R1));
        tell(&mut state, ExecutionEvent::StepAgreed(R2));
        let failed = match is_abandoned {
            false => ExecutionEvent::StepReported(R1, report(Outcome::Failed)),
            true => ExecutionEvent::CancelRequested(report(Outcome::Cancelled)),
        };
        let mut commands = tell(&mut state, failed);
        if is_abandoned {
            commands.extend(tell(&mut state, ExecutionEvent::StepAbandoned(R1)));
        }
        assert!(end(&commands).1.contains(&R2), "{commands:?}");
        assert_eq!(state.phase(), ExecutionPhase::GivingUp);
        let commands = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Done)));
        let has_change =
            commands.iter().any(|command| matches!(command, ExecutionCommand::SendChange(_)));
        assert!(!has_change, "{commands:?}");
        assert!(end(&commands).0.is_some(), "{commands:?}");
    }
}

#[test]
fn a_step_that_both_complete_while_the_plan_is_cancelled_has_its_effect() {
    let (mut state, _) = running();
    tell(&mut state, ExecutionEvent::StepAgreed(R1));
    tell(&mut state, ExecutionEvent::StepAgreed(R2));
    tell(&mut state, ExecutionEvent::CancelRequested(report(Outcome::Cancelled)));
    tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Done)));
    let commands = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Done)));
    let changes = commands.iter().filter(|it| matches!(it, ExecutionCommand::SendChange(_)));
    assert_eq!(changes.count(), 2, "{commands:?}");
}
