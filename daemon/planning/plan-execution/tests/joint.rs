//! Execution of a joint action: two robots carry a table together.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Execute, Heartbeat, Method, Offer, Outcome, Reason, Refusal, Report};
use acl::{AgentId, Incarnation, Millis};
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

fn agreed(part: StepPart) -> ExecutionEvent {
    ExecutionEvent::StepAgreed { part, has_begun: false }
}

/// The agent has agreed, and has begun under an earlier Plan Executor.
fn has_begun(part: StepPart) -> ExecutionEvent {
    ExecutionEvent::StepAgreed { part, has_begun: true }
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
    assert!(begun(&tell(&mut state, agreed(R2))).is_empty());
    assert!(begun(&tell(&mut state, agreed(R2))).is_empty());
    assert_eq!(begun(&tell(&mut state, agreed(R1))), [R1, R2]);
    // Each has done its part, and is told when both have.
    let part_done = Report { is_part_done: true, ..report(Outcome::Progress) };
    let first = tell(&mut state, ExecutionEvent::StepReported(R2, part_done.clone()));
    assert!(first.is_empty(), "{first:?}");
    let both = tell(&mut state, ExecutionEvent::StepReported(R1, part_done));
    let completed = both.iter().filter(|it| matches!(it, ExecutionCommand::CompleteStep(_)));
    assert_eq!((completed.count(), both.len()), (2, 2), "{both:?}");
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
    tell(&mut state, agreed(R1));
    let refusal = Refusal::new(Reason::Incapable, "it has no hands");
    let commands = tell(&mut state, ExecutionEvent::StepRefused(R2, refusal));
    assert_eq!(end(&commands), (None, vec![R1]));
    assert!(begun(&tell(&mut state, agreed(R1))).is_empty());
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
        tell(&mut state, agreed(R1));
        tell(&mut state, agreed(R2));
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
    tell(&mut state, agreed(R1));
    tell(&mut state, agreed(R2));
    tell(&mut state, ExecutionEvent::CancelRequested(report(Outcome::Cancelled)));
    tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Done)));
    let commands = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Done)));
    let changes = commands.iter().filter(|it| matches!(it, ExecutionCommand::SendChange(_)));
    assert_eq!(changes.count(), 2, "{commands:?}");
}

/// A Plan Executor that takes a plan over finds agents that have begun, and others that have not.
#[test]
fn agents_that_have_begun_without_the_others_are_cancelled() {
    for events in [[has_begun(R1), agreed(R2)], [agreed(R2), has_begun(R1)]] {
        let (mut state, _) = running();
        let commands: Vec<_> =
            events.into_iter().flat_map(|event| tell(&mut state, event)).collect();
        assert!(begun(&commands).is_empty(), "{commands:?}");
        assert_eq!(end(&commands), (None, vec![R1, R2]));
    }
    // One has done its part already.
    let (mut state, _) = running();
    tell(&mut state, has_begun(R1));
    tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Done)));
    let commands = tell(&mut state, agreed(R2));
    assert_eq!((begun(&commands), end(&commands)), (vec![], (None, vec![R2])));
}

#[test]
fn agents_that_have_all_begun_are_followed() {
    let (mut state, _) = running();
    tell(&mut state, has_begun(R1));
    let commands = tell(&mut state, has_begun(R2));
    assert!(commands.is_empty(), "{commands:?}");
    tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Done)));
    let commands = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Done)));
    assert_eq!(end(&commands).0.map(|report| report.outcome), Some(Outcome::Done));
}

#[test]
fn an_agent_that_was_restarted_agrees_again() {
    let (mut state, _) = running();
    tell(&mut state, agreed(R2));
    assert!(tell(&mut state, ExecutionEvent::StepRepeated(R2)).is_empty());
    assert!(begun(&tell(&mut state, agreed(R1))).is_empty(), "the other has not agreed");
    assert_eq!(begun(&tell(&mut state, agreed(R2))), [R1, R2]);
}

#[test]
fn an_agent_that_was_restarted_while_it_acts_ends_the_step() {
    let (mut state, _) = running();
    tell(&mut state, agreed(R1));
    tell(&mut state, agreed(R2));
    let commands = tell(&mut state, ExecutionEvent::StepRepeated(R2));
    assert_eq!(end(&commands), (None, vec![R1, R2]));
    // Whether it has done its part is unknown: each agent's facts become unknown in its own name.
    let declined = Some(Reason::Uncertain);
    let uncertain = Report { declined, ..report(Outcome::Failed) };
    let commands = tell(&mut state, ExecutionEvent::StepReported(R2, uncertain));
    let owners: Vec<_> = commands
        .iter()
        .filter_map(|command| match command {
            ExecutionCommand::SendChange(change) => Some(change.owner.clone()?.to_string()),
            _ => None,
        })
        .collect();
    assert_eq!(owners, ["r1", "r2"]);
    let commands = tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Cancelled)));
    let ended = end(&commands).0.expect("it ends");
    assert_eq!((&ended.action, &ended.agent), (&None, &None), "nobody is to blame: {ended:?}");
}

/// The partner of a broken robot notices first that it is alone.
#[test]
fn the_agent_that_fails_is_blamed_although_its_partner_reports_first() {
    let (mut state, _) = running();
    tell(&mut state, agreed(R1));
    tell(&mut state, agreed(R2));
    let declined = Some(Reason::Conflict);
    let hindered = Report { declined, ..report(Outcome::Failed) };
    tell(&mut state, ExecutionEvent::StepReported(R1, hindered));
    let broken = Report::new(Outcome::Failed, "it is broken");
    let commands = tell(&mut state, ExecutionEvent::StepReported(R2, broken));
    let ended = end(&commands).0.expect("it ends");
    assert_eq!(ended.agent.as_ref().map(AgentId::as_str), Some("r2"), "{ended:?}");
    assert!(ended.action.is_some() && ended.detail.contains("it is broken"), "{ended:?}");
}

/// A Plan Executor that takes a plan over when one agent was told that all parts are done.
#[test]
fn an_agent_that_waits_for_the_end_is_told_after_a_take_over() {
    let part_done = Report { is_part_done: true, ..report(Outcome::Progress) };
    let (done, waits) = (
        ExecutionEvent::StepReported(R1, report(Outcome::Done)),
        ExecutionEvent::StepReported(R2, part_done),
    );
    for events in [[done.clone(), waits.clone()], [waits, done]] {
        let (mut state, _) = running();
        tell(&mut state, has_begun(R1));
        tell(&mut state, has_begun(R2));
        let commands: Vec<_> =
            events.into_iter().flat_map(|event| tell(&mut state, event)).collect();
        let completed =
            commands.iter().filter(|it| matches!(it, ExecutionCommand::CompleteStep(R2)));
        assert_eq!(completed.count(), 1, "{commands:?}");
        let commands = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Done)));
        assert_eq!(end(&commands).0.map(|report| report.outcome), Some(Outcome::Done));
    }
}

/// One agent has done its part, so what the step changes is unknown when the other one fails.
#[test]
fn a_step_that_fails_after_a_part_is_done_leaves_its_facts_unknown() {
    let (mut state, _) = running();
    tell(&mut state, agreed(R1));
    tell(&mut state, agreed(R2));
    let part_done = Report { is_part_done: true, ..report(Outcome::Progress) };
    tell(&mut state, ExecutionEvent::StepReported(R1, part_done));
    let commands = tell(&mut state, ExecutionEvent::StepReported(R2, report(Outcome::Failed)));
    let unknown = commands.iter().any(|command| {
        matches!(command, ExecutionCommand::SendChange(change)
            if change.believe.contains("(unknown (table-at lab))"))
    });
    assert!(unknown, "{commands:?}");
}

#[test]
fn an_agent_that_is_absent_is_not_to_blame() {
    let (mut state, _) = running();
    tell(&mut state, agreed(R1));
    tell(&mut state, agreed(R2));
    tell(&mut state, ExecutionEvent::StepAbsent(R2, "`r2` has left".to_owned()));
    let commands = tell(&mut state, ExecutionEvent::StepReported(R1, report(Outcome::Cancelled)));
    let ended = end(&commands).0.expect("it ends");
    assert_eq!((&ended.action, &ended.agent), (&None, &None), "{ended:?}");
}

/// A heartbeat of one agent contradicts what both have confirmed: that agent is to blame.
#[test]
fn the_agent_that_a_heartbeat_contradicts_is_blamed() {
    let (mut state, _) = running();
    let mut heartbeats = LastHeartbeats::default();
    let r2 = AgentId::new("r2").expect("a name");
    let beat = |sequence, heartbeats: &mut LastHeartbeats| {
        let heartbeat = Heartbeat {
            digest: String::new(),
            sequence,
            facts: "(at r2 hall)".to_owned(),
            known_for: BTreeMap::new(),
            period: Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        };
        heartbeats.store_heartbeat(&r2, Incarnation(1), &heartbeat);
    };
    beat(1, &mut heartbeats);
    tell(&mut state, agreed(R1));
    tell(&mut state, agreed(R2));
    state.handle(ExecutionEvent::StepReported(R1, report(Outcome::Done)), &heartbeats);
    state.handle(ExecutionEvent::StepReported(R2, report(Outcome::Done)), &heartbeats);
    assert_eq!(state.phase(), ExecutionPhase::AwaitingEffects);
    beat(2, &mut heartbeats);
    let event = ExecutionEvent::HeartbeatReceived(r2.clone());
    let commands = state.handle(event, &heartbeats);
    let ended = end(&commands).0.expect("it ends");
    assert_eq!((ended.outcome, &ended.agent), (Outcome::Failed, &Some(r2)), "{ended:?}");
}
