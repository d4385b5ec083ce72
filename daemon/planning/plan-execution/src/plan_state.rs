//! The state of one running plan, and how events change it.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use acl::content::{ChangeState, Execute, Outcome, Reason, Refusal, Report, Snapshot};
use pddl::knowledge::Knowledge;
use pddl::{InitElement, Term};

use crate::effect_check::{LastHeartbeats, UnverifiedEffect};
use crate::execution::Execution;
use crate::transitions::{ExecutionEventKind, ExecutionPhase, is_expected, is_lawful};
use crate::translate::{ActionRequest, StepPart};

/// Event that happened to a running plan.
#[derive(Clone, Debug)]
pub enum ExecutionEvent {
    /// The plan begins, or continues after a take-over.
    Started,
    /// The agent has agreed to its part. In a joint action, it waits for the other agents.
    StepAgreed {
        /// The part of the agent.
        part: StepPart,
        /// Whether the agent has begun, as an earlier Plan Executor has told it.
        has_begun: bool,
    },
    /// The agent of this part was restarted, and has received the request again.
    StepRepeated(StepPart),
    /// The agent has sent a report about its part.
    StepReported(StepPart, Report),
    /// The agent has refused its part.
    StepRefused(StepPart, Refusal),
    /// The agent of this part does not answer. The text describes the problem and names the agent.
    StepLost(StepPart, String),
    /// The agent of this part is absent, or was restarted. The text describes the problem.
    StepAbsent(StepPart, String),
    /// The agent of a cancelled part is absent, so its answer is not awaited.
    StepAbandoned(StepPart),
    /// A heartbeat of the agent has arrived.
    HeartbeatReceived(AgentId),
    /// The heartbeats that should verify effects have not arrived in time.
    EffectsOverdue,
    /// The known state or the action models have changed.
    WorldChanged {
        /// Agents that have left.
        left: Vec<AgentId>,
        /// Agents that have joined.
        joined: Vec<AgentId>,
    },
    /// The scheduled check with this delay is due.
    CheckDue(CheckDelay),
    /// The Domain Maintainer has sent the domain and the known state.
    StateReceived {
        /// The domain and the state.
        snapshot: Box<Snapshot>,
        /// The predicates that the domain uses for unknown facts.
        knowledge: Box<Knowledge>,
        /// Whether any agent is absent or was absent a moment ago. If so, facts that it reported
        /// may be missing.
        are_agents_absent: bool,
    },
    /// The Domain Maintainer has answered a sent effect, or cannot be reached.
    ChangeAnswered,
    /// The plan must be cancelled, with this outcome.
    CancelRequested(Report),
}

/// Command that the owner of a running plan must carry out.
#[derive(Clone, Debug)]
pub enum ExecutionCommand {
    /// Send the request for this part to its actuator.
    RequestStep(StepPart, Box<ActionRequest>),
    /// Tell the actuator that all agents of its joint action are ready, and that it begins.
    BeginStep(StepPart),
    /// Tell the actuator that all agents of its joint action have done their parts.
    CompleteStep(StepPart),
    /// Cancel this part. If its agent is absent, [`ExecutionEvent::StepAbandoned`] follows.
    CancelStep(StepPart),
    /// Close the exchange about this part, and await no answer in it.
    CloseStep(StepPart),
    /// Send this effect to the Domain Maintainer. [`ExecutionEvent::ChangeAnswered`] follows.
    SendChange(ChangeState),
    /// Send this report to all requesters of the plan.
    Report(Report),
    /// Schedule a check of the remaining steps, in place of an already scheduled check.
    ScheduleCheck(CheckDelay),
    /// Query the known state from the Domain Maintainer. [`ExecutionEvent::StateReceived`] follows.
    QueryState,
    /// Drop the query for the known state, if one is open.
    DropQuery,
    /// Wait for the heartbeats that verify the effects. [`ExecutionEvent::EffectsOverdue`] follows.
    AwaitEffects,
    /// End the plan with this report.
    End(Report),
}

/// Delay of a check of the remaining steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckDelay {
    /// A short delay, until all messages about one change have arrived.
    Settle,
    /// The grace period, because an agent that the plan needs has left. By then, all messages
    /// about the departure have arrived.
    GraceAfterDeparture,
    /// The grace period, because an agent is absent that this executor has not seen leave.
    Grace,
}

/// The state of a running plan.
pub struct PlanState {
    phase: ExecutionPhase,
    execution: Execution,
    /// The parts that actuators are carrying out.
    running_parts: BTreeMap<StepPart, RunningPart>,
    /// The steps of which a part has failed or is abandoned. Their effects are not applied, also if
    /// another part is done.
    failed_steps: BTreeSet<usize>,
    /// The steps of which a part is done, and others are not.
    half_done_steps: BTreeSet<usize>,
    /// The joint step with which the plan was given up, if no agent is to blame for it so far.
    blameless_step: Option<usize>,
    /// The steps of which the effects are told as unknown.
    uncertain_steps: BTreeSet<usize>,
    /// Final report of the plan; `None` before the outcome is decided.
    final_report: Option<Report>,
    /// Number of changes that were sent to the Domain Maintainer and are not answered yet. While
    /// there are any, the Domain Maintainer's state is older than the state known here.
    unanswered_changes: usize,
    scheduled_check: Option<CheckDelay>,
    /// Whether a check has already waited for the grace period since the last successful check.
    is_grace_used: bool,
    /// Whether the last check has failed. A failed check is repeated once before the plan is given
    /// up, because messages of recent changes may not have arrived yet.
    has_check_failed: bool,
    /// Confirmed changes that contradict the last heartbeat of their agents. Each stays until the
    /// next heartbeat of its agent.
    unverified_effects: BTreeMap<AgentId, UnverifiedEffect>,
}

/// A part that an actuator is carrying out.
#[derive(Clone, Debug)]
struct RunningPart {
    agent: AgentId,
    /// The ground action of the step, under the agent's own name for it.
    action: String,
    /// Number of agents that act in the step.
    agents: usize,
    /// Whether the agent has agreed.
    has_agreed: bool,
    /// Whether the agent was told that the joint action begins.
    has_begun: bool,
    /// Whether the agent has done its part of a joint action, and waits for the others.
    is_part_done: bool,
    /// Whether the agent was told that all have done their parts.
    is_told_done: bool,
    /// Whether the action counts as failed if the part fails or is refused.
    is_blamed: bool,
}

fn failure(problem: impl Into<String>) -> Report {
    Report::new(Outcome::Failed, problem)
}

/// Splits the change that a step has made by its agents: a fact belongs to the agent that is its first
/// argument, and any other fact to the first agent.
fn by_agent(change: ChangeState, agents: &[AgentId]) -> Vec<(AgentId, ChangeState)> {
    if let [agent] = agents {
        return vec![(agent.clone(), change)];
    }
    let elements = |text: &str| pddl::parse_init_elements(text).value.unwrap_or_default();
    let (believe, retract) = (elements(&change.believe), elements(&change.retract));
    let is_about = |element: &InitElement, agent: &AgentId| {
        let (InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom)) =
            element
        else {
            return false;
        };
        atom.arguments.first() == Some(&Term::Object(agent.as_str().into()))
    };
    let owner = |element: &InitElement| {
        agents.iter().position(|agent| is_about(element, agent)).unwrap_or_default()
    };
    let of = |elements: &[InitElement], position: usize| {
        let own = elements.iter().filter(|element| owner(element) == position);
        own.map(ToString::to_string).collect::<Vec<_>>().join(" ")
    };
    let parts = agents.iter().enumerate().map(|(position, agent)| {
        let (believe, retract) = (of(&believe, position), of(&retract, position));
        (agent.clone(), ChangeState { believe, retract, owner: None })
    });
    let is_change = |change: &ChangeState| !change.believe.is_empty() || !change.retract.is_empty();
    parts.filter(|(_, change)| is_change(change)).collect()
}

// === impl ExecutionEvent ===

impl ExecutionEvent {
    /// Returns the kind of this event.
    pub fn kind(&self) -> ExecutionEventKind {
        match self {
            ExecutionEvent::Started => ExecutionEventKind::Started,
            ExecutionEvent::StepAgreed { .. } => ExecutionEventKind::StepAgreed,
            ExecutionEvent::StepRepeated(_) => ExecutionEventKind::StepRepeated,
            ExecutionEvent::StepReported(..) => ExecutionEventKind::StepReported,
            ExecutionEvent::StepRefused(..) => ExecutionEventKind::StepRefused,
            ExecutionEvent::StepLost(..) | ExecutionEvent::StepAbsent(..) => {
                ExecutionEventKind::StepLost
            }
            ExecutionEvent::StepAbandoned(_) => ExecutionEventKind::StepAbandoned,
            ExecutionEvent::HeartbeatReceived(_) => ExecutionEventKind::HeartbeatReceived,
            ExecutionEvent::EffectsOverdue => ExecutionEventKind::EffectsOverdue,
            ExecutionEvent::WorldChanged { .. } => ExecutionEventKind::WorldChanged,
            ExecutionEvent::CheckDue(_) => ExecutionEventKind::CheckDue,
            ExecutionEvent::StateReceived { .. } => ExecutionEventKind::StateReceived,
            ExecutionEvent::ChangeAnswered => ExecutionEventKind::ChangeAnswered,
            ExecutionEvent::CancelRequested(_) => ExecutionEventKind::CancelRequested,
        }
    }

    /// Returns the part that the event is about; `None` if the event is about the whole plan.
    fn part(&self) -> Option<StepPart> {
        match self {
            ExecutionEvent::StepAgreed { part, .. }
            | ExecutionEvent::StepRepeated(part)
            | ExecutionEvent::StepReported(part, _)
            | ExecutionEvent::StepRefused(part, _)
            | ExecutionEvent::StepLost(part, _)
            | ExecutionEvent::StepAbsent(part, _)
            | ExecutionEvent::StepAbandoned(part) => Some(*part),
            _ => None,
        }
    }
}

// === impl PlanState ===

impl PlanState {
    /// Parses and validates a plan, and computes which of its steps may run side by side.
    /// `knowledge` has the predicates that the domain uses for unknown facts.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if a part of the request cannot be parsed or the
    /// plan does not reach the goal.
    pub fn new(execute: &Execute, knowledge: Knowledge) -> Result<PlanState, String> {
        Ok(PlanState {
            phase: ExecutionPhase::Running,
            execution: Execution::new(execute, knowledge)?,
            running_parts: BTreeMap::new(),
            failed_steps: BTreeSet::new(),
            half_done_steps: BTreeSet::new(),
            blameless_step: None,
            uncertain_steps: BTreeSet::new(),
            final_report: None,
            unanswered_changes: 0,
            scheduled_check: None,
            is_grace_used: false,
            has_check_failed: false,
            unverified_effects: BTreeMap::new(),
        })
    }

    /// Returns the current phase of the execution.
    pub fn phase(&self) -> ExecutionPhase {
        self.phase
    }

    /// Returns the steps that are done. Each entry is the number of the step, from 0, and its
    /// ground action under the agent's own name for it.
    pub fn done(&self) -> Vec<(usize, String)> {
        self.execution.done()
    }

    /// Returns the agents that act in steps that are not done.
    pub fn needed(&self) -> impl Iterator<Item = AgentId> + '_ {
        self.execution.needed()
    }

    /// Whether a confirmed change of the agent is unverified until its next heartbeat.
    pub fn awaits_heartbeat(&self, agent: &AgentId) -> bool {
        self.unverified_effects.contains_key(agent)
    }

    /// Changes the state by an event. Returns the commands that the owner must carry out, in this
    /// order. `heartbeats` has the last heartbeat of every agent. Two kinds of events change
    /// nothing: those without a transition in the table, and those about a part that does not run.
    pub fn handle(
        &mut self,
        event: ExecutionEvent,
        heartbeats: &LastHeartbeats,
    ) -> Vec<ExecutionCommand> {
        let (kind, from) = (event.kind(), self.phase);
        let is_about_another =
            event.part().is_some_and(|part| !self.running_parts.contains_key(&part));
        if is_about_another || !is_expected(kind, from) {
            return Vec::new();
        }
        let mut commands = Vec::new();
        self.react(event, heartbeats, &mut commands);
        debug_assert!(is_lawful(kind, from, self.phase), "{kind:?}: {from:?} to {:?}", self.phase);
        commands
    }

    fn react(
        &mut self,
        event: ExecutionEvent,
        heartbeats: &LastHeartbeats,
        out: &mut Vec<ExecutionCommand>,
    ) {
        match event {
            ExecutionEvent::Started => self.go_on(out),
            ExecutionEvent::StepAgreed { part, has_begun } => self.agreed(part, has_begun, out),
            ExecutionEvent::StepRepeated(part) => self.repeated(part, out),
            ExecutionEvent::StepReported(part, report) => {
                self.reported(part, report, heartbeats, out)
            }
            ExecutionEvent::StepRefused(part, refusal) => self.refused(part, &refusal, out),
            ExecutionEvent::StepLost(part, problem) => self.lost(part, problem, out),
            ExecutionEvent::StepAbsent(part, problem) => {
                // An agent of a joint action that is absent is not to blame for it.
                if let Some(running) = self.running_parts.get_mut(&part) {
                    running.is_blamed &= running.agents == 1;
                }
                self.lost(part, problem, out);
            }
            ExecutionEvent::StepAbandoned(part) => {
                self.running_parts.remove(&part);
                self.failed_steps.insert(part.step);
                self.end_if_idle(out);
            }
            ExecutionEvent::HeartbeatReceived(agent) => self.verify_effect(&agent, heartbeats, out),
            ExecutionEvent::EffectsOverdue => {
                self.unverified_effects.clear();
                self.go_on(out);
            }
            ExecutionEvent::WorldChanged { left, joined } => {
                self.world_changed(&left, &joined, out)
            }
            ExecutionEvent::CheckDue(delay) => self.check(delay, out),
            ExecutionEvent::StateReceived { snapshot, knowledge, are_agents_absent } => {
                self.compare(&snapshot, *knowledge, are_agents_absent, out);
            }
            ExecutionEvent::ChangeAnswered => {
                self.unanswered_changes = self.unanswered_changes.saturating_sub(1);
            }
            ExecutionEvent::CancelRequested(report) => self.give_up(report, out),
        }
    }

    // === acting ===

    /// Requests every step that can start, because its predecessors are all done. Ends the plan if
    /// no step is left.
    fn go_on(&mut self, out: &mut Vec<ExecutionCommand>) {
        if self.final_report.is_some() {
            return self.end_if_idle(out);
        }
        if self.execution.is_complete() && !self.unverified_effects.is_empty() {
            if self.phase != ExecutionPhase::AwaitingEffects {
                self.phase = ExecutionPhase::AwaitingEffects;
                out.push(ExecutionCommand::AwaitEffects);
            }
            return;
        }
        if self.execution.is_complete() {
            let outcome = match self.execution.unmet_goal() {
                None => Report::new(Outcome::Done, "the goal holds"),
                Some(unmet) => failure(format!("every step is done, yet {unmet}")),
            };
            return self.give_up(outcome, out);
        }
        for step in self.execution.ready() {
            let requests = match self.execution.start(step) {
                Ok(requests) => requests,
                Err(problem) => return self.give_up(failure(problem), out),
            };
            let agents = requests.len();
            for (position, request) in requests.into_iter().enumerate() {
                let part = StepPart { step, position };
                let (agent, action) = (request.agent.clone(), request.action.clone());
                let running = RunningPart {
                    agent,
                    action,
                    agents,
                    has_agreed: false,
                    has_begun: false,
                    is_part_done: false,
                    is_told_done: false,
                    is_blamed: true,
                };
                self.running_parts.insert(part, running);
                out.push(ExecutionCommand::RequestStep(part, Box::new(request)));
            }
        }
    }

    /// Returns the parts of a step that run.
    fn parts_of(&self, step: usize) -> impl Iterator<Item = (&StepPart, &RunningPart)> {
        self.running_parts.iter().filter(move |(part, _)| part.step == step)
    }

    /// Lets a joint action begin if all of its agents have agreed. Gives the plan up if some of them
    /// have begun without the others, because an earlier Plan Executor was gone in between.
    fn agreed(&mut self, part: StepPart, has_begun: bool, out: &mut Vec<ExecutionCommand>) {
        let Some(running) = self.running_parts.get_mut(&part) else { return };
        (running.has_agreed, running.has_begun) = (true, running.has_begun || has_begun);
        let agents = running.agents;
        if agents == 1 {
            return;
        }
        let are = |is: fn(&RunningPart) -> bool| {
            self.parts_of(part.step).filter(|(_, running)| is(running)).count()
        };
        let (all, agreed) = (self.parts_of(part.step).count(), are(|it| it.has_agreed));
        let begun = are(|it| it.has_begun);
        if agreed < all || begun == all {
            return;
        }
        if begun > 0 || all < agents {
            let problem = "some of its agents have begun without the others";
            let step = self.execution.step_text(part.step);
            self.blameless_step = Some(part.step);
            return self.give_up(failure(format!("{step}: {problem}")), out);
        }
        let parts = self.running_parts.iter_mut().filter(|(other, _)| other.step == part.step);
        for (part, running) in parts {
            running.has_begun = true;
            out.push(ExecutionCommand::BeginStep(*part));
        }
    }

    /// Handles the restart of an agent in a joint action: if the others have begun, they cannot go on
    /// without it; otherwise it has to agree again.
    fn repeated(&mut self, part: StepPart, out: &mut Vec<ExecutionCommand>) {
        let Some(running) = self.running_parts.get_mut(&part) else { return };
        running.has_agreed = false;
        if running.agents > 1 && std::mem::take(&mut running.has_begun) {
            // Its answer says whether it has done its part.
            let (step, agent) = (self.execution.step_text(part.step), running.agent.clone());
            self.blameless_step = Some(part.step);
            self.give_up(failure(format!("{step}: `{agent}` was restarted")), out);
        }
    }

    fn reported(
        &mut self,
        part: StepPart,
        report: Report,
        heartbeats: &LastHeartbeats,
        out: &mut Vec<ExecutionCommand>,
    ) {
        let Some(agent) = self.running_parts.get(&part).map(|running| running.agent.clone()) else {
            return;
        };
        match report.outcome {
            Outcome::Done => self.part_done(part, report, heartbeats, out),
            Outcome::Failed => {
                if let Some(why @ (Reason::Uncertain | Reason::TimedOut)) = report.declined {
                    return self.step_uncertain(part, &agent, (why, &report.detail), out);
                }
                // The agent is able, and its surroundings are not as the plan assumed: the next
                // plan begins with the facts that it reports.
                if report.declined == Some(Reason::Conflict)
                    && let Some(running) = self.running_parts.get_mut(&part)
                {
                    running.is_blamed = false;
                }
                let problem = format!("`{agent}` failed: {}", report.detail);
                self.fail(part, Report { declined: report.declined, ..failure(problem) }, out);
            }
            Outcome::Cancelled => {
                // A stop ends a joint action at all of its agents, and so does the failure of one of them.
                if let Some(running) = self.running_parts.get_mut(&part) {
                    running.is_blamed &= running.agents == 1;
                }
                let problem = format!("`{agent}` gave up: {}", report.detail);
                self.fail(part, failure(problem), out);
            }
            Outcome::Progress if report.is_part_done => self.part_waits(part, out),
            Outcome::Progress | Outcome::Holds => out.push(ExecutionCommand::Report(report)),
        }
    }

    /// Handles a part of a joint action that is done and waits for the others. When all are, the action
    /// is done: its agents tell so, and their effects hold.
    fn part_waits(&mut self, part: StepPart, out: &mut Vec<ExecutionCommand>) {
        let Some(running) = self.running_parts.get_mut(&part) else { return };
        running.is_part_done = true;
        self.complete(part.step, out);
    }

    /// Tells the agents of a joint action that it is done, if all of them have done their parts. An agent
    /// that has reported its end was told so, by this Plan Executor or by an earlier one.
    fn complete(&mut self, step: usize, out: &mut Vec<ExecutionCommand>) {
        let are_done = self.parts_of(step).all(|(_, running)| running.is_part_done);
        if !are_done || self.failed_steps.contains(&step) || self.final_report.is_some() {
            return;
        }
        let parts = self.running_parts.iter_mut().filter(|(part, _)| part.step == step);
        for (part, running) in parts {
            if !std::mem::replace(&mut running.is_told_done, true) {
                out.push(ExecutionCommand::CompleteStep(*part));
            }
        }
    }

    /// Handles a part that is done. When all parts of its step are, applies the effects of the step,
    /// sends these effects to the Domain Maintainer, and continues the plan.
    fn part_done(
        &mut self,
        part: StepPart,
        mut report: Report,
        heartbeats: &LastHeartbeats,
        out: &mut Vec<ExecutionCommand>,
    ) {
        let step = part.step;
        let running = self.running_parts.remove(&part);
        let is_half_done = self.parts_of(step).next().is_some();
        if is_half_done {
            self.half_done_steps.insert(step);
            self.complete(step, out);
        }
        if is_half_done || self.failed_steps.contains(&step) {
            return self.end_if_idle(out);
        }
        let action = running.map(|running| running.action).unwrap_or_default();
        match self.execution.finish(step) {
            Ok(change) => {
                let agents = self.execution.actors(step);
                for agent in &agents {
                    // Only the last heartbeat and the last action of an agent count.
                    self.unverified_effects.remove(agent);
                    let doubt = heartbeats.check_effect(agent, action.clone(), &change);
                    self.unverified_effects.extend(doubt.map(|doubt| (agent.clone(), doubt)));
                }
                for (agent, change) in by_agent(change, &agents) {
                    self.send_change(change, &agent, out);
                }
                if agents.len() > 1 && self.final_report.is_none() {
                    self.schedule_check(CheckDelay::Settle, out);
                }
            }
            Err(problem) => return self.give_up(failure(problem), out),
        }
        report.outcome = Outcome::Progress;
        report.step = u32::try_from(step).ok();
        out.push(ExecutionCommand::Report(report));
        self.go_on(out);
    }

    /// Handles a step with an uncertain result: the facts that the step would have changed become
    /// unknown. `why` and `detail` are the agent's reason, as a code and as text. The action does
    /// not count as failed if its agent was restarted.
    fn step_uncertain(
        &mut self,
        part: StepPart,
        agent: &AgentId,
        (why, detail): (Reason, &str),
        out: &mut Vec<ExecutionCommand>,
    ) {
        if let Some(running) = self.running_parts.get_mut(&part) {
            running.is_blamed = why != Reason::Uncertain;
        }
        self.send_uncertain(part.step, out);
        let report = failure(format!("`{agent}`: {detail}"));
        self.fail(part, Report { declined: Some(why), ..report }, out);
    }

    fn refused(&mut self, part: StepPart, refusal: &Refusal, out: &mut Vec<ExecutionCommand>) {
        let Some(running) = self.running_parts.get_mut(&part) else { return };
        // A busy agent has not failed, because it can do the same action a moment later. Nor has
        // one that declines what the plan assumes of it: the next plan begins with what it reports.
        let is_able =
            [Reason::Busy, Reason::MailboxFull, Reason::Conflict].contains(&refusal.reason);
        running.is_blamed = !is_able;
        let problem = format!("`{}` declined: {}", running.agent, refusal.detail);
        self.fail(part, Report { declined: Some(refusal.reason), ..failure(problem) }, out);
    }

    /// Gives the plan up because a part is lost. Its agent may have begun the action, or begin it
    /// yet, so the action is cancelled, unless that has been done.
    fn lost(&mut self, part: StepPart, problem: String, out: &mut Vec<ExecutionCommand>) {
        if self.final_report.is_none() {
            out.push(ExecutionCommand::CancelStep(part));
        }
        self.fail(part, failure(problem), out);
    }

    /// Tells that what a step would have changed is unknown, once.
    fn send_uncertain(&mut self, step: usize, out: &mut Vec<ExecutionCommand>) {
        let change = self.execution.uncertain(step);
        if !change.believe.is_empty() && self.uncertain_steps.insert(step) {
            for (agent, change) in by_agent(change, &self.execution.actors(step)) {
                self.send_change(change, &agent, out);
            }
        }
    }

    fn send_change(
        &mut self,
        change: ChangeState,
        agent: &AgentId,
        out: &mut Vec<ExecutionCommand>,
    ) {
        self.unanswered_changes += 1;
        out.push(ExecutionCommand::SendChange(ChangeState {
            owner: Some(agent.clone()),
            ..change
        }));
    }

    /// Gives the plan up because a part has failed. The other parts of its step are cancelled like
    /// all that run.
    fn fail(&mut self, part: StepPart, mut report: Report, out: &mut Vec<ExecutionCommand>) {
        report.detail = format!("{}: {}", self.execution.step_text(part.step), report.detail);
        if let Some(running) = self.running_parts.remove(&part) {
            let is_partly_done = running.is_part_done
                || self.half_done_steps.contains(&part.step)
                || self.parts_of(part.step).any(|(_, running)| running.is_part_done);
            if is_partly_done {
                self.send_uncertain(part.step, out);
            }
            self.failed_steps.insert(part.step);
            out.push(ExecutionCommand::CloseStep(part));
            let is_joint = running.agents > 1;
            report.agent = Some(running.agent).filter(|_| is_joint && running.is_blamed);
            report.action = Some(running.action).filter(|_| running.is_blamed);
            // The partner of an agent that fails may notice it first, and is not to blame.
            if let Some(decided) = &mut self.final_report
                && is_joint
                && self.blameless_step == Some(part.step)
                && report.action.is_some()
            {
                (*decided, self.blameless_step) = (report.clone(), None);
            }
            if self.final_report.is_none() && is_joint && report.action.is_none() {
                self.blameless_step = Some(part.step);
            }
        }
        self.give_up(report, out);
    }

    // === ending ===

    /// Decides the outcome of the plan and cancels the parts that run. The plan ends when no part
    /// runs any more.
    fn give_up(&mut self, report: Report, out: &mut Vec<ExecutionCommand>) {
        if self.final_report.is_none() {
            self.final_report = Some(report);
            self.phase = ExecutionPhase::GivingUp;
            out.extend(self.running_parts.keys().map(|part| ExecutionCommand::CancelStep(*part)));
        }
        self.end_if_idle(out);
    }

    fn end_if_idle(&mut self, out: &mut Vec<ExecutionCommand>) {
        if !self.running_parts.is_empty() {
            return;
        }
        if let Some(report) = self.final_report.clone() {
            self.phase = ExecutionPhase::Ended;
            out.push(ExecutionCommand::End(report));
        }
    }

    // === watching ===

    /// Compares a change that an agent confirmed with the next heartbeat of this agent.
    fn verify_effect(
        &mut self,
        agent: &AgentId,
        heartbeats: &LastHeartbeats,
        out: &mut Vec<ExecutionCommand>,
    ) {
        let Some(doubt) = self.unverified_effects.get(agent) else { return };
        let Some(contradiction) = heartbeats.check_again(agent, doubt) else { return };
        let action =
            self.unverified_effects.remove(agent).map(|doubt| doubt.action).unwrap_or_default();
        match contradiction {
            None => self.go_on(out),
            Some(fact) => {
                let problem = format!("`{action}`: `{agent}` confirmed it, yet says `{fact}`");
                let agent = Some(agent.clone());
                self.give_up(Report { action: Some(action), agent, ..failure(problem) }, out);
            }
        }
    }

    /// Schedules a check of the plan. If an agent that the plan needs has left, the check is
    /// delayed by a grace period, so that a short interruption of the network does not end the
    /// plan. Changes of other agents do not change this delay.
    fn world_changed(
        &mut self,
        left: &[AgentId],
        joined: &[AgentId],
        out: &mut Vec<ExecutionCommand>,
    ) {
        let needs = |agent: &AgentId| self.execution.needs(agent);
        let (is_gone, is_back) = (left.iter().any(needs), joined.iter().any(needs));
        let is_in_grace = self.scheduled_check.is_some_and(|delay| delay != CheckDelay::Settle);
        if !is_gone && !is_back && is_in_grace {
            return;
        }
        if is_gone {
            out.push(ExecutionCommand::DropQuery);
        }
        let delay = if is_gone { CheckDelay::GraceAfterDeparture } else { CheckDelay::Settle };
        self.schedule_check(delay, out);
    }

    fn schedule_check(&mut self, delay: CheckDelay, out: &mut Vec<ExecutionCommand>) {
        self.scheduled_check = Some(delay);
        out.push(ExecutionCommand::ScheduleCheck(delay));
    }

    /// Queries the known state, to check the remaining steps against it.
    fn check(&mut self, delay: CheckDelay, out: &mut Vec<ExecutionCommand>) {
        if self.scheduled_check != Some(delay) {
            return;
        }
        self.scheduled_check = None;
        if delay == CheckDelay::GraceAfterDeparture {
            // All messages have arrived by now, so one failed check is enough.
            (self.has_check_failed, self.is_grace_used) = (true, true);
        }
        if self.unanswered_changes > 0 {
            return self.schedule_check(CheckDelay::Settle, out);
        }
        out.push(ExecutionCommand::QueryState);
    }

    fn compare(
        &mut self,
        snapshot: &Snapshot,
        knowledge: Knowledge,
        are_agents_absent: bool,
        out: &mut Vec<ExecutionCommand>,
    ) {
        // If a step was confirmed after the query was sent, the answer is older than the state
        // known here.
        // While some agents of a joint action have done their parts, what they report of themselves is
        // ahead of the step. The plan is checked when the step has ended.
        if self.running_parts.values().any(|running| running.is_part_done) {
            return;
        }
        let is_stale = self.unanswered_changes > 0;
        let renewed =
            if is_stale { Ok(()) } else { self.execution.revalidate(snapshot, knowledge) };
        match renewed {
            Ok(()) if !is_stale => (self.has_check_failed, self.is_grace_used) = (false, false),
            // Something has changed since the query was sent: the next check decides.
            _ if self.scheduled_check.is_some() => (),
            // An executor that took the plan over has not seen the needed agent leave, so the grace
            // has not begun. If another agent has left, facts that it reported are missing.
            Err(_) if self.has_check_failed && !self.is_grace_used && are_agents_absent => {
                self.is_grace_used = true;
                self.schedule_check(CheckDelay::Grace, out);
            }
            Err(problem) if self.has_check_failed => {
                let problem = format!("the rest of the plan does not reach the goal: {problem}");
                self.give_up(failure(problem), out);
            }
            _ => {
                self.has_check_failed = !is_stale;
                self.schedule_check(CheckDelay::Settle, out);
            }
        }
    }
}
