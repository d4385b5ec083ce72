//! Every event in every phase, and random sequences of events.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{GoalPhase, Keep, Outcome, Reason, Report};
use acl::{AgentId, ConversationId};
use goal_lifecycle::{
    Attempt, Blockers, ExecutionEnd, GoalCommand, GoalEvent, GoalState, GoalVerdict, MissingPlan,
    PlanDecision, PlanningFlow, Policy, TRANSITIONS, Turn, is_lawful,
};
use proptest::prelude::*;

const POLICY: Policy = Policy { is_replanning: true, grace: Duration::from_secs(2) };

fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

fn blockers(agents: &[&str]) -> Blockers {
    let agents = agents.iter().map(|name| agent(name)).collect();
    Blockers { goals: vec!["(lit hall)".to_owned()], agents }
}

/// Returns one event of each kind and variant, about the work `attempt`.
fn events(attempt: Attempt) -> Vec<GoalEvent> {
    let text = || "a reason".to_owned();
    let quorum = Turn { missing_quorum: Some("no quorum".to_owned()), ..Turn::default() };
    let busy = Turn { is_planning_busy: true, ..Turn::default() };
    let in_use = Turn { agents_in_use: [agent("lamp")].into(), ..Turn::default() };
    let hope = MissingPlan { why: text(), has_hope: true, ..MissingPlan::default() };
    let failed = Report::new(Outcome::Failed, "it is dark");
    let busy_agent = Report { declined: Some(Reason::Busy), ..failed.clone() };
    let blamed = Some((agent("lamp"), "light".to_owned()));
    vec![
        GoalEvent::Considered(Turn::default()),
        GoalEvent::Considered(quorum),
        GoalEvent::Considered(busy),
        GoalEvent::Considered(in_use),
        GoalEvent::DomainMissing(attempt),
        GoalEvent::DomainUnusable(attempt, text()),
        GoalEvent::GoalInvalid(attempt, text()),
        GoalEvent::GoalHolds(attempt),
        GoalEvent::GoalLost(attempt, text()),
        GoalEvent::AgentsBusy(attempt, blockers(&["lamp"])),
        GoalEvent::GoalOpen(attempt, PlanningFlow::Centralized),
        GoalEvent::GoalOpen(attempt, PlanningFlow::Decentralized),
        GoalEvent::PlannerFailed(attempt, text(), Duration::ZERO),
        GoalEvent::PlannerBusy(attempt, text(), Duration::ZERO),
        GoalEvent::MembersBusy(attempt, text(), 128),
        GoalEvent::BidsOutdated(attempt, text()),
        GoalEvent::PlanFound(attempt, PlanDecision::Run),
        GoalEvent::PlanFound(
            attempt,
            PlanDecision::Preempt(vec![ConversationId::new("c")], blockers(&[])),
        ),
        GoalEvent::PlanFound(attempt, PlanDecision::WaitFor(blockers(&[]))),
        GoalEvent::PlanFound(attempt, PlanDecision::Conflict("`(lit hall)`".to_owned())),
        GoalEvent::PlanMissing(attempt),
        GoalEvent::Explained(attempt, MissingPlan { why: text(), ..MissingPlan::default() }),
        GoalEvent::Explained(attempt, MissingPlan { are_agents_free_again: true, ..hope.clone() }),
        GoalEvent::Explained(attempt, MissingPlan { can_preempt: true, ..hope.clone() }),
        GoalEvent::Explained(
            attempt,
            MissingPlan { blockers: blockers(&["lamp"]), ..hope.clone() },
        ),
        GoalEvent::Explained(attempt, MissingPlan { has_kept_goals: true, ..hope }),
        GoalEvent::ExecutorRestarted(attempt),
        GoalEvent::OtherPlanRuns(attempt, 7),
        GoalEvent::ExecutionEnded(attempt, ExecutionEnd::Done),
        GoalEvent::ExecutionEnded(attempt, ExecutionEnd::Cancelled(text())),
        GoalEvent::ExecutionEnded(attempt, ExecutionEnd::Failed(failed, blamed)),
        GoalEvent::ExecutionEnded(attempt, ExecutionEnd::Failed(busy_agent, None)),
        GoalEvent::ExecutionEnded(attempt, ExecutionEnd::Unknown(text(), Duration::ZERO)),
        GoalEvent::Verified(attempt, GoalVerdict::Holds),
        GoalEvent::Verified(attempt, GoalVerdict::Unmet(text())),
        GoalEvent::Verified(attempt, GoalVerdict::Unusable(text())),
        GoalEvent::Verified(attempt, GoalVerdict::Unanswered),
        GoalEvent::Cancelled,
        GoalEvent::Yielded(text()),
        GoalEvent::AgentsReleased,
        GoalEvent::WorldChanged {
            joined: vec![agent("lamp")],
            have_agents_changed: true,
            is_planning_busy: false,
        },
        GoalEvent::WorldChanged {
            joined: Vec::new(),
            have_agents_changed: false,
            is_planning_busy: true,
        },
        GoalEvent::EndedElsewhere,
        GoalEvent::TakenOver,
    ]
}

/// The owner of a goal in these tests: the running work, the running plans, and the reported ends.
/// Each command is checked when the owner receives it.
struct Owner {
    state: GoalState,
    now: Duration,
    /// Whether the executor runs a plan of the goal.
    runs: bool,
    /// Whether the executor was asked to cancel that plan.
    is_cancelling: bool,
    has_timer: bool,
    ends: usize,
    is_abandoned: bool,
}

impl Owner {
    fn new(keep: Keep) -> Owner {
        Owner {
            state: GoalState::new(keep),
            now: Duration::ZERO,
            runs: false,
            is_cancelling: false,
            has_timer: false,
            ends: 0,
            is_abandoned: false,
        }
    }

    /// Handles an event and checks the commands and the transition.
    fn tell(&mut self, event: GoalEvent, policy: Policy) {
        let (kind, attempt, from) = (event.kind(), event.attempt(), self.state.phase());
        let is_current = attempt.is_none_or(|attempt| attempt == self.state.attempt());
        let is_end = matches!(event, GoalEvent::ExecutionEnded(..));
        let is_listed =
            |row: &&goal_lifecycle::GoalTransition| row.event == kind && row.from.contains(from);
        let counts = is_current && TRANSITIONS.iter().any(|row| is_listed(&row));
        let before = self.state.attempt();
        let commands = self.state.handle(event, self.now, policy);
        let to = self.state.phase();
        if !counts {
            assert_eq!((from, before), (to, self.state.attempt()), "{kind:?} counts for nothing");
            assert!(commands.is_empty(), "{kind:?} in {from:?}: {commands:?}");
            return;
        }
        assert!(is_lawful(kind, from, to), "{kind:?}: {from:?} to {to:?}");
        if is_end {
            self.runs = false;
            self.is_cancelling = false;
        }
        for command in commands {
            self.obey(command);
        }
        self.check(to);
    }

    fn obey(&mut self, command: GoalCommand) {
        match command {
            GoalCommand::Execute(attempt) => {
                assert!(!self.runs, "two plans of one goal run");
                assert_eq!(attempt, self.state.attempt());
                self.runs = true;
            }
            GoalCommand::RequestExecution(attempt) => {
                assert_eq!(attempt, self.state.attempt());
                self.runs = true;
                self.is_cancelling = false;
            }
            GoalCommand::CancelExecution => {
                assert!(self.runs, "no plan runs that could be cancelled");
                self.is_cancelling = true;
            }
            GoalCommand::ConsiderAfter(_) | GoalCommand::Consider => self.has_timer = true,
            GoalCommand::StopTimer => self.has_timer = false,
            GoalCommand::End(outcome, detail) => {
                assert!(outcome.is_final() && !detail.is_empty());
                self.ends += 1;
            }
            GoalCommand::Abandon => self.is_abandoned = true,
            GoalCommand::Plan(attempt)
            | GoalCommand::FetchDomain(attempt)
            | GoalCommand::Explain(attempt)
            | GoalCommand::Verify(attempt, _) => assert_eq!(attempt, self.state.attempt()),
            GoalCommand::Report(report) => {
                assert!(!report.outcome.is_final(), "only `End` tells the end");
            }
            GoalCommand::RejectProposals(_)
            | GoalCommand::AdoptRunningPlan
            | GoalCommand::CancelPlanning
            | GoalCommand::ForgetPlan
            | GoalCommand::ReleaseAgents
            | GoalCommand::Preempt(_)
            | GoalCommand::ScheduleNext => {}
        }
    }

    /// Checks the invariants that hold between any two events.
    fn check(&self, phase: GoalPhase) {
        let is_with_executor =
            matches!(phase, GoalPhase::Executing | GoalPhase::Preempted | GoalPhase::Cancelling);
        if phase != GoalPhase::Ended {
            assert_eq!(self.runs, is_with_executor, "in {phase:?}");
            assert_eq!(self.is_cancelling, is_with_executor && phase != GoalPhase::Executing);
            // A goal that waits for a change is checked again later, unless it waits for the
            // quorum.
            let is_waiting = matches!(phase, GoalPhase::WaitingForChange | GoalPhase::Holding);
            let waits_for_quorum = self.state.waits_because() == "no quorum";
            assert!(!is_waiting || self.has_timer || waits_for_quorum);
            assert_eq!(self.ends, 0);
        } else if self.ends == 0 {
            assert!(self.is_abandoned || self.is_cancelling, "it ended without a word");
        } else {
            assert_eq!(self.ends, 1, "its initiator is told one end");
            assert!(!self.runs || self.is_cancelling, "a plan of an ended goal runs on");
        }
        let is_waiting = matches!(phase, GoalPhase::WaitingForAgents | GoalPhase::WaitingForChange);
        assert_eq!(is_waiting, !self.state.waits_because().is_empty(), "in {phase:?}");
    }
}

/// Returns, for each phase, a goal that is in it, by a breadth-first search from a new goal.
fn one_in_each_phase(keep: Keep) -> Vec<GoalState> {
    let mut found = vec![GoalState::new(keep)];
    let mut next = 0;
    while let Some(state) = found.get(next).cloned() {
        for event in events(state.attempt()) {
            let mut after = state.clone();
            after.handle(event, Duration::ZERO, POLICY);
            if found.iter().all(|known| known.phase() != after.phase()) {
                found.push(after);
            }
        }
        next += 1;
    }
    found
}

#[test]
fn every_event_in_every_phase_follows_the_table() {
    let mut seen = BTreeSet::new();
    for keep in [Keep::Achieve, Keep::Maintain] {
        let states = one_in_each_phase(keep);
        for state in &states {
            for event in events(state.attempt()) {
                let (kind, from) = (event.kind(), state.phase());
                for policy in [POLICY, Policy { is_replanning: false, grace: Duration::ZERO }] {
                    let mut after = state.clone();
                    after.handle(event.clone(), Duration::ZERO, policy);
                    let row =
                        TRANSITIONS.iter().any(|row| row.event == kind && row.from.contains(from));
                    let stays = after.phase() == from;
                    assert!(if row { is_lawful(kind, from, after.phase()) } else { stays });
                    if row {
                        seen.insert((kind, from));
                    }
                }
            }
        }
    }
    let listed = TRANSITIONS.iter().flat_map(|row| row.from.phases().map(|from| (row.event, from)));
    let unseen: Vec<_> = listed.filter(|pair| !seen.contains(pair)).collect();
    assert!(unseen.is_empty(), "rows that no test reaches: {unseen:?}");
}

#[test]
fn the_search_reaches_every_phase() {
    let both = [Keep::Achieve, Keep::Maintain].map(one_in_each_phase).concat();
    let phases: BTreeSet<_> = both.iter().map(GoalState::phase).collect();
    assert_eq!(phases, GoalPhase::ALL.into());
}

#[test]
fn an_achieve_goal_ends_after_too_many_failures_and_a_maintain_goal_does_not() {
    for (keep, ends) in [(Keep::Achieve, true), (Keep::Maintain, false)] {
        let mut state = GoalState::new(keep);
        for _ in 0..goal_lifecycle::FAILURES_MAX {
            state.handle(GoalEvent::Considered(Turn::default()), Duration::ZERO, POLICY);
            let open = GoalEvent::GoalOpen(state.attempt(), PlanningFlow::Centralized);
            state.handle(open, Duration::ZERO, POLICY);
            let failed =
                GoalEvent::PlannerFailed(state.attempt(), "busy".to_owned(), Duration::ZERO);
            state.handle(failed, Duration::ZERO, POLICY);
        }
        assert_eq!(state.phase() == GoalPhase::Ended, ends);
    }
}

/// Brings a goal from its queue to the execution of a plan.
fn plan_and_execute(state: &mut GoalState, now: Duration) {
    state.handle(GoalEvent::Considered(Turn::default()), now, POLICY);
    let open = GoalEvent::GoalOpen(state.attempt(), PlanningFlow::Centralized);
    state.handle(open, now, POLICY);
    state.handle(GoalEvent::PlanFound(state.attempt(), PlanDecision::Run), now, POLICY);
    assert_eq!(state.phase(), GoalPhase::Executing);
}

/// Returns the delay after which a goal is considered again.
fn delay(commands: &[GoalCommand]) -> Option<Duration> {
    commands.iter().find_map(|command| match command {
        GoalCommand::ConsiderAfter(delay) => Some(*delay),
        _ => None,
    })
}

#[test]
fn what_is_only_busy_or_absent_ends_no_goal() {
    let text = || "it is busy".to_owned();
    let refused =
        |reason| Report { declined: Some(reason), ..Report::new(Outcome::Failed, text()) };
    let ends = [
        ExecutionEnd::Failed(refused(Reason::Busy), None),
        ExecutionEnd::Failed(refused(Reason::MailboxFull), None),
        ExecutionEnd::Unknown(text(), Duration::from_millis(500)),
    ];
    for end in ends {
        let (mut state, mut now) = (GoalState::new(Keep::Achieve), Duration::ZERO);
        for _ in 0..goal_lifecycle::FAILURES_MAX * 3 {
            plan_and_execute(&mut state, now);
            let ended = GoalEvent::ExecutionEnded(state.attempt(), end.clone());
            let delay = delay(&state.handle(ended, now, POLICY)).expect("it waits");
            assert!(delay >= Duration::from_millis(200) && delay < Duration::from_secs(7));
            // The messages of a hundred sensors would have it planned for again at once.
            let changed = GoalEvent::WorldChanged {
                joined: Vec::new(),
                have_agents_changed: false,
                is_planning_busy: false,
            };
            assert!(state.handle(changed, now, POLICY).is_empty());
            now += delay;
        }
        assert!(now > Duration::from_secs(60), "{now:?}");
        assert_eq!((state.phase(), state.failures()), (GoalPhase::WaitingForChange, 0));
    }
}

#[test]
fn an_absent_planning_agent_ends_no_goal() {
    let (mut state, now) = (GoalState::new(Keep::Achieve), Duration::ZERO);
    for _ in 0..goal_lifecycle::FAILURES_MAX * 3 {
        state.handle(GoalEvent::Considered(Turn::default()), now, POLICY);
        let open = GoalEvent::GoalOpen(state.attempt(), PlanningFlow::Centralized);
        state.handle(open, now, POLICY);
        let busy = GoalEvent::PlannerBusy(state.attempt(), "absent".to_owned(), Duration::ZERO);
        state.handle(busy, now, POLICY);
    }
    assert_eq!(state.phase(), GoalPhase::WaitingForChange);
}

/// Returns the end of a goal that was cancelled after its last step, and before that was known.
fn cancelled_late(keep: Keep, verdict: GoalVerdict) -> Option<(Outcome, String)> {
    let (mut state, now) = (GoalState::new(keep), Duration::ZERO);
    plan_and_execute(&mut state, now);
    state.handle(GoalEvent::Cancelled, now, POLICY);
    let ended = GoalEvent::ExecutionEnded(state.attempt(), ExecutionEnd::Done);
    let mut commands = state.handle(ended, now, POLICY);
    for _ in 0..5 {
        assert!(state.phase() == GoalPhase::Ended || state.is_cancelled());
        let verified = GoalEvent::Verified(state.attempt(), verdict.clone());
        commands.extend(state.handle(verified, now, POLICY));
    }
    commands.into_iter().find_map(|command| match command {
        GoalCommand::End(outcome, detail) => Some((outcome, detail)),
        _ => None,
    })
}

#[test]
fn a_goal_that_is_cancelled_too_late_is_done_only_if_it_holds() {
    let unmet = || GoalVerdict::Unmet("it is dark".to_owned());
    for (keep, verdict, expected) in [
        (Keep::Achieve, GoalVerdict::Holds, Outcome::Done),
        (Keep::Achieve, unmet(), Outcome::Cancelled),
        (Keep::Achieve, GoalVerdict::Unusable("lost".to_owned()), Outcome::Cancelled),
        (Keep::Achieve, GoalVerdict::Unanswered, Outcome::Cancelled),
        (Keep::Maintain, GoalVerdict::Holds, Outcome::Cancelled),
        (Keep::Maintain, unmet(), Outcome::Cancelled),
    ] {
        let (outcome, detail) = cancelled_late(keep, verdict.clone()).expect("it ends");
        assert_eq!(outcome, expected, "{keep:?} {verdict:?}: {detail}");
    }
    let (_, detail) = cancelled_late(Keep::Achieve, unmet()).expect("it ends");
    assert!(detail.ends_with("before the cancel came, and it is dark"), "{detail}");
}

#[test]
fn a_result_of_an_earlier_attempt_is_ignored() {
    let mut state = GoalState::new(Keep::Achieve);
    state.handle(GoalEvent::Considered(Turn::default()), Duration::ZERO, POLICY);
    let fetching = state.attempt();
    state.handle(GoalEvent::GoalOpen(fetching, PlanningFlow::Centralized), Duration::ZERO, POLICY);
    let late = state.handle(GoalEvent::GoalHolds(fetching), Duration::ZERO, POLICY);
    assert!(late.is_empty());
    assert_eq!(state.phase(), GoalPhase::Planning);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, ..ProptestConfig::default() })]

    /// In any order of events, also of late ones: at most one plan runs, the goal ends at most
    /// once, and a waiting goal is always considered again.
    #[test]
    fn random_events_keep_the_invariants(
        kept in any::<bool>(),
        is_replanning in any::<bool>(),
        happenings in prop::collection::vec((0_usize..43, 0_u64..3, 0_u64..4_000), 1..120),
    ) {
        let mut owner = Owner::new(if kept { Keep::Maintain } else { Keep::Achieve });
        let policy = Policy { is_replanning, ..POLICY };
        for (which, late, wait) in happenings {
            owner.now += Duration::from_millis(wait);
            let attempt = Attempt(owner.state.attempt().0.saturating_sub(late));
            let all = events(attempt);
            let event = all[which % all.len()].clone();
            owner.tell(event, policy);
        }
    }
}
