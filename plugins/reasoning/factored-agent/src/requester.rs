//! The requester of a joint plan: queries projections, plans over them, and calls for parts.
//!
//! A planning is in one of three phases: it waits for projections, searches for a skeleton, or waits
//! for agreements. Each phase has a number, and answers of an earlier phase are dropped. A member
//! that leaves is planned without from then on. All waits have one deadline, after which the result
//! says what was awaited.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{Bid, CallForProposals, Choice, JointPlanPart, Refusal, Snapshot, value};
use acl::{AgentId, ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{
    Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, Presence, Resource, WorkHandle,
};
use planner::{Budget, Cancel, Options};
use skeleton::{Projection, SkeletonError, SkeletonOutcome, SkeletonPlan, SkeletonTask};
use tokio::sync::oneshot;
use tokio::time::Instant;

/// Maximum number of skeletons in one planning. Each one after the first follows a projection that
/// became sharper, or a member that left; an agent has some ten private symbols.
const ROUNDS_MAX: u32 = 200;

/// Time between two queries or calls to a member that has not answered: neither has a receipt.
const ASKED_AGAIN: Duration = Duration::from_secs(1);

/// What is planned for.
pub struct JointRequest {
    /// The members, until some leave.
    pub members: BTreeSet<AgentId>,
    /// The limit on the whole planning.
    pub within: Duration,
}

/// The result of a joint planning.
#[derive(Clone, Debug, PartialEq)]
pub struct JointResult {
    /// The plan, to which all members that act in it have agreed; or the reason why there is none.
    pub plan: Result<SkeletonPlan, String>,
    /// Whether it is proved that the members that did not leave have no joint plan.
    pub is_proved_impossible: bool,
    /// The members that have left.
    pub left: BTreeSet<AgentId>,
    /// Sum of the costs that the members have named.
    pub cost: f64,
    /// Number of skeletons.
    pub rounds: u32,
    /// Number of queries, calls and answers.
    pub messages: u64,
    /// Bytes of the projections, parts and answers.
    pub bytes: u64,
}

/// The agent that plans jointly for one task.
pub struct JointRequester {
    planning: JointRequest,
    deadline: Option<Instant>,
    conversation: Option<ConversationId>,
    projections: BTreeMap<AgentId, Projection>,
    /// Reasons of the members whose projections are to become sharper.
    refusals: BTreeMap<AgentId, String>,
    phase: PlanningPhase,
    /// Number of the phase.
    number: u64,
    so_far: JointResult,
    result: Option<oneshot::Sender<JointResult>>,
}

/// What the requester waits for.
enum PlanningPhase {
    /// Projections of these members.
    Querying { awaited: BTreeSet<AgentId>, work: Vec<WorkHandle> },
    /// A skeleton.
    Searching { cancel: Cancel, _work: WorkHandle },
    /// Agreements to the parts of a skeleton.
    Agreeing(PendingSkeleton),
    /// Nothing: it has not begun, or has ended.
    Idle,
}

/// A skeleton, and the answers to the calls for its parts.
struct PendingSkeleton {
    plan: SkeletonPlan,
    tokens: BTreeMap<AgentId, ReplyToken>,
    awaited: BTreeSet<AgentId>,
    costs: f64,
}

// === impl JointRequester ===

impl JointRequester {
    /// Creates a requester that sends its result once.
    #[must_use]
    pub fn new(planning: JointRequest, result: oneshot::Sender<JointResult>) -> JointRequester {
        let plan = Err("it has not begun".to_owned());
        JointRequester {
            planning,
            deadline: None,
            conversation: None,
            projections: BTreeMap::new(),
            refusals: BTreeMap::new(),
            phase: PlanningPhase::Idle,
            number: 0,
            so_far: JointResult {
                plan,
                is_proved_impossible: false,
                left: BTreeSet::new(),
                cost: 0.0,
                rounds: 0,
                messages: 0,
                bytes: 0,
            },
            result: Some(result),
        }
    }

    /// Ends the phase, and begins another one. Agreements that are still awaited are not any more.
    fn begin(&mut self, phase: PlanningPhase, ctx: &mut Context<Self>) {
        self.number += 1;
        match std::mem::replace(&mut self.phase, phase) {
            PlanningPhase::Agreeing(pending) => {
                let detail = "the skeleton is given up".to_owned();
                for (member, token) in pending.tokens {
                    if pending.awaited.contains(&member) {
                        // The contract net has no word for it. A member gives up a part when this
                        // requester calls it for the next one.
                        ctx.close(&token);
                    } else {
                        let rejected = Choice::new(Vec::new(), detail.clone());
                        let reject = Performative::RejectProposal;
                        ctx.send_turn(&token, &member, reject, value(&rejected));
                    }
                }
            }
            PlanningPhase::Searching { cancel, .. } => cancel.set(),
            PlanningPhase::Querying { .. } | PlanningPhase::Idle => (),
        }
    }

    fn end(&mut self, plan: Result<SkeletonPlan, String>, ctx: &mut Context<Self>) {
        self.begin(PlanningPhase::Idle, ctx);
        self.so_far.plan = plan;
        if let Some(result) = self.result.take() {
            let _ = result.send(self.so_far.clone());
        }
    }

    fn fail(&mut self, why: impl Into<String>, ctx: &mut Context<Self>) {
        self.end(Err(why.into()), ctx);
    }

    fn overdue(&mut self, ctx: &mut Context<Self>) {
        let awaited = match &self.phase {
            PlanningPhase::Querying { awaited, .. } => named(awaited),
            PlanningPhase::Agreeing(pending) => named(&pending.awaited),
            PlanningPhase::Searching { .. } | PlanningPhase::Idle => String::new(),
        };
        let waits = match awaited.as_str() {
            "" => "the search was not at its end".to_owned(),
            members => format!("{members} did not answer"),
        };
        let within = self.planning.within.as_secs_f64();
        self.fail(format!("after {within} s {waits}"), ctx);
    }

    // === projections ===

    /// Queries the projections of some members; those that have not joined yet, when they do.
    fn query(&mut self, members: BTreeSet<AgentId>, ctx: &mut Context<Self>) {
        let present: Vec<AgentId> =
            members.iter().filter(|member| ctx.find(member).is_some()).cloned().collect();
        self.begin(PlanningPhase::Querying { awaited: members, work: Vec::new() }, ctx);
        present.iter().for_each(|member| self.query_one(member, ctx));
    }

    fn joined(&mut self, member: &AgentId, ctx: &mut Context<Self>) {
        if let PlanningPhase::Querying { awaited, .. } = &self.phase
            && awaited.contains(member)
        {
            self.query_one(member, ctx);
        }
    }

    fn query_one(&mut self, member: &AgentId, ctx: &mut Context<Self>) {
        let (number, from) = (self.number, member.clone());
        let asked = ctx.ask(Resource::Domain, member);
        let query = ctx.run(asked, move |requester: &mut Self, answers, ctx| {
            if requester.number == number {
                requester.told(&from, answers.first().map(AsRef::as_ref), ctx);
            }
        });
        self.so_far.messages += 1;
        if let PlanningPhase::Querying { work, .. } = &mut self.phase {
            work.push(query);
        }
    }

    fn told(&mut self, member: &AgentId, answer: Option<&[u8]>, ctx: &mut Context<Self>) {
        let PlanningPhase::Querying { awaited, .. } = &mut self.phase else { return };
        if !awaited.contains(member) {
            return;
        }
        let Some(answer) = answer else {
            // It may not have been reachable yet. The deadline of the planning ends this.
            let (number, member) = (self.number, member.clone());
            ctx.after(ASKED_AGAIN, move |requester: &mut Self, ctx| {
                if requester.number == number {
                    requester.query_one(&member, ctx);
                }
            });
            return;
        };
        awaited.remove(member);
        let is_last = awaited.is_empty();
        self.so_far.messages += 1;
        self.so_far.bytes += answer.len() as u64;
        let Ok(Snapshot { domain, problem, .. }) = serde_json::from_slice(answer) else {
            let why = format!("`{member}` answers with something that is no projection");
            return self.fail(why, ctx);
        };
        let projection = Projection { domain, problem };
        let refusal = self.refusals.remove(member);
        let before = self.projections.insert(member.clone(), projection);
        if let Some(why) = refusal
            && before.is_some_and(|before| before == self.projections[member])
        {
            let why =
                format!("`{member}` refuses its part, and its projection stays as it is: {why}");
            return self.fail(why, ctx);
        }
        if is_last {
            self.search(ctx);
        }
    }

    // === the skeleton ===

    fn search(&mut self, ctx: &mut Context<Self>) {
        self.so_far.rounds += 1;
        if self.so_far.rounds > ROUNDS_MAX {
            let why = format!("no plan was agreed to in {ROUNDS_MAX} rounds");
            return self.fail(why, ctx);
        }
        let projections: BTreeMap<String, Projection> =
            { self.projections.iter() }.map(|(it, own)| (it.to_string(), own.clone())).collect();
        let cancel = Cancel::new();
        let flag = cancel.clone();
        // The phase begins with the callback of the work.
        let number = self.number + 1;
        let work = ctx.compute(
            move || search(&projections, &flag),
            move |requester: &mut Self, found, ctx| {
                if requester.number == number {
                    requester.found(found, ctx);
                }
            },
        );
        self.begin(PlanningPhase::Searching { cancel, _work: work }, ctx);
    }

    fn found(&mut self, found: Result<SkeletonOutcome, SkeletonError>, ctx: &mut Context<Self>) {
        match found {
            Ok(SkeletonOutcome::Found(plan)) => self.call_all(plan, ctx),
            Ok(SkeletonOutcome::NoPlan) => {
                let members = named(&self.planning.members);
                self.so_far.is_proved_impossible = true;
                self.fail(format!("proven: there is no joint plan of {members}"), ctx);
            }
            Ok(SkeletonOutcome::Undecided(limit)) => {
                self.fail(format!("no skeleton was found: {limit}"), ctx);
            }
            Err(SkeletonError { member: Some(member), why }) => {
                self.fail(format!("`{member}`: {why}"), ctx);
            }
            Err(SkeletonError { member: None, why }) => self.fail(why, ctx),
        }
    }

    // === agreements ===

    /// Calls each member that acts in a skeleton for its part.
    fn call_all(&mut self, plan: SkeletonPlan, ctx: &mut Context<Self>) {
        let mut parts = BTreeMap::new();
        for (member, steps) in &plan.parts {
            match AgentId::new(member) {
                Ok(member) => parts.insert(
                    member,
                    JointPlanPart { digest: plan.digest.clone(), steps: steps.clone() },
                ),
                Err(error) => return self.fail(error.to_string(), ctx),
            };
        }
        if parts.is_empty() {
            return self.end(Ok(plan), ctx);
        }
        let (tokens, awaited) = (BTreeMap::new(), parts.keys().cloned().collect());
        let pending = PendingSkeleton { plan, tokens, awaited, costs: 0.0 };
        self.begin(PlanningPhase::Agreeing(pending), ctx);
        for (member, part) in parts {
            let token = self.call(&member, part, ctx);
            if let PlanningPhase::Agreeing(pending) = &mut self.phase {
                pending.tokens.insert(member, token);
            }
        }
        self.remind(ctx);
    }

    fn call(
        &mut self,
        member: &AgentId,
        part: JointPlanPart,
        ctx: &mut Context<Self>,
    ) -> ReplyToken {
        let conversation = self.conversation.get_or_insert_with(|| ctx.new_conversation()).clone();
        let call = CallForProposals { conjuncts: Vec::new(), together: true, part: Some(part) };
        let content = value(&call);
        self.so_far.messages += 1;
        self.so_far.bytes += content.to_string().len() as u64;
        let opening = ExchangeOpening {
            to: Some(member.clone()),
            performative: Performative::Cfp,
            protocol: Protocol::ContractNet,
            conversation,
            content,
        };
        let left = self.deadline.map(|end| end.saturating_duration_since(ctx.now()));
        let (number, from) = (self.number, member.clone());
        let patience = left.unwrap_or(self.planning.within);
        ctx.open(opening, patience, move |requester: &mut Self, event, ctx| {
            if requester.number != number {
                return;
            }
            match event {
                ExchangeEvent::Message(message) => requester.answered(&from, &message, ctx),
                ExchangeEvent::TimedOut => requester.overdue(ctx),
                ExchangeEvent::Undelivered(error) => {
                    requester.refused(&from, error.to_string(), ctx);
                }
            }
        })
    }

    /// Calls the members again that have not answered, as long as the phase lasts.
    fn remind(&mut self, ctx: &mut Context<Self>) {
        let number = self.number;
        ctx.after(ASKED_AGAIN, move |requester: &mut Self, ctx| {
            if requester.number != number {
                return;
            }
            if let PlanningPhase::Agreeing(pending) = &requester.phase {
                for member in &pending.awaited {
                    if let Some(token) = pending.tokens.get(member) {
                        ctx.resend_cfp(token, member);
                        requester.so_far.messages += 1;
                    }
                }
                requester.remind(ctx);
            }
        });
    }

    fn answered(&mut self, member: &AgentId, message: &Message, ctx: &mut Context<Self>) {
        let PlanningPhase::Agreeing(pending) = &mut self.phase else { return };
        if !pending.awaited.contains(member) {
            return;
        }
        self.so_far.messages += 1;
        self.so_far.bytes += message.content.to_string().len() as u64;
        if message.performative != Performative::Agree {
            let refusal = message.content_as::<Refusal>().map(|refusal| refusal.detail);
            let why = refusal.unwrap_or_else(|error| error.to_string());
            return self.refused(member, why, ctx);
        }
        match message.content_as::<Bid>() {
            Ok(bid) if bid.agreed.as_deref() == Some(pending.plan.digest.as_str()) => {
                let costs = bid.proposals.iter().map(|proposal| proposal.cost);
                pending.costs += costs.filter(|cost| cost.is_finite()).sum::<f64>();
                pending.awaited.remove(member);
                self.close_round(ctx);
            }
            Ok(_) => self.refused(member, "it agrees to another plan".to_owned(), ctx),
            Err(error) => self.refused(member, error.to_string(), ctx),
        }
    }

    fn refused(&mut self, member: &AgentId, why: String, ctx: &mut Context<Self>) {
        let PlanningPhase::Agreeing(pending) = &mut self.phase else { return };
        if pending.awaited.remove(member) {
            tracing::info!(%member, why, "a part of the skeleton is refused");
            pending.tokens.remove(member);
            self.refusals.insert(member.clone(), why);
            self.close_round(ctx);
        }
    }

    /// Ends the phase as soon as all members have answered.
    fn close_round(&mut self, ctx: &mut Context<Self>) {
        let PlanningPhase::Agreeing(pending) = &mut self.phase else { return };
        if !pending.awaited.is_empty() {
            return;
        }
        if !self.refusals.is_empty() {
            return self.query(self.refusals.keys().cloned().collect(), ctx);
        }
        self.so_far.cost = pending.costs;
        let (plan, tokens) = (pending.plan.clone(), std::mem::take(&mut pending.tokens));
        let detail = "all members agree".to_owned();
        for (member, token) in tokens {
            let accepted = Choice::new(Vec::new(), detail.clone());
            ctx.send_turn(&token, &member, Performative::AcceptProposal, value(&accepted));
        }
        self.end(Ok(plan), ctx);
    }
}

impl Agent for JointRequester {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.deadline = Some(ctx.now() + self.planning.within);
        ctx.after(self.planning.within, |requester: &mut Self, ctx| {
            if requester.result.is_some() {
                requester.overdue(ctx);
            }
        });
        // Each member that is present is told to have joined right after this.
        let awaited = self.planning.members.clone();
        self.begin(PlanningPhase::Querying { awaited, work: Vec::new() }, ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let resident = match presence {
            Presence::Left(resident) => resident,
            Presence::Joined(resident) => return self.joined(&resident.agent, ctx),
        };
        if self.result.is_none() || !self.planning.members.remove(&resident.agent) {
            return;
        }
        tracing::warn!(member = %resident.agent, "a member has left: it is planned without");
        self.so_far.left.insert(resident.agent.clone());
        self.projections.remove(&resident.agent);
        self.refusals.remove(&resident.agent);
        if self.planning.members.is_empty() {
            return self.fail("all members have left", ctx);
        }
        let awaited = match &self.phase {
            PlanningPhase::Querying { awaited, .. } => awaited.clone(),
            _ => BTreeSet::new(),
        };
        let is_missing = |member: &&AgentId| {
            awaited.contains(*member)
                || self.refusals.contains_key(*member)
                || !self.projections.contains_key(*member)
        };
        let missing: BTreeSet<AgentId> =
            self.planning.members.iter().filter(is_missing).cloned().collect();
        match missing.is_empty() {
            true => self.search(ctx),
            false => self.query(missing, ctx),
        }
    }
}

/// Returns the names of members, for people.
fn named(members: &BTreeSet<AgentId>) -> String {
    let names: Vec<String> = members.iter().map(|member| format!("`{member}`")).collect();
    names.join(", ")
}

/// Merges the projections, and searches for a skeleton.
fn search(
    projections: &BTreeMap<String, Projection>,
    cancel: &Cancel,
) -> Result<SkeletonOutcome, SkeletonError> {
    let memory_max_bytes = agent::computation_bytes_max();
    let budget = Budget { memory_max_bytes, ..Budget::default() };
    let options = Options { budget, ..Options::default() };
    SkeletonTask::merge(projections)?.plan(&options, cancel)
}
