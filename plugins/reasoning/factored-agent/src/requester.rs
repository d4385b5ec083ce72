//! The requester of a joint plan: queries projections, plans over them, and calls for parts.
//!
//! An attempt has a frozen list of members. A member that leaves ends the attempt, and the next one
//! is made without it. All waits have one deadline, after which the result says so.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{Bid, CallForProposals, JointPlanPart, Refusal, Snapshot, value};
use acl::{AgentId, ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{
    Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, Presence, Resource, WorkHandle,
};
use planner::{Budget, Cancel, Options};
use skeleton::{Projection, SkeletonError, SkeletonOutcome, SkeletonPlan, SkeletonTask};
use tokio::sync::oneshot;

/// Maximum number of skeletons in one planning. Each one after the first follows a projection that
/// became sharper, or a member that left; an agent has some ten private symbols.
const ROUNDS_MAX: u32 = 200;

/// Time between two calls to a member that has not answered: a `cfp` has no receipt.
const CALLED_AGAIN: Duration = Duration::from_secs(1);

/// What is planned for.
pub struct JointPlanning {
    /// The members of the first attempt.
    pub members: BTreeSet<AgentId>,
    /// The limit on the whole planning.
    pub within: Duration,
}

/// The result of a joint planning.
#[derive(Clone, Debug, PartialEq)]
pub struct JointResult {
    /// The plan, to which all members that act in it have agreed; or the reason why there is none.
    pub plan: Result<SkeletonPlan, String>,
    /// Whether it is proved that the members have no joint plan.
    pub is_proved_impossible: bool,
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
    planning: JointPlanning,
    conversation: Option<ConversationId>,
    projections: BTreeMap<AgentId, Projection>,
    /// Queries and the running search. Dropping them ends them.
    work: Vec<WorkHandle>,
    /// Members whose projection is awaited.
    queried: BTreeSet<AgentId>,
    /// The skeleton to whose parts agreements are awaited.
    asked: Option<PendingSkeleton>,
    cancel: Cancel,
    so_far: JointResult,
    result: Option<oneshot::Sender<JointResult>>,
}

/// A skeleton, and the answers to the calls for its parts.
struct PendingSkeleton {
    plan: SkeletonPlan,
    awaited: BTreeMap<AgentId, ReplyToken>,
    costs: f64,
    refusals: BTreeMap<AgentId, String>,
}

// === impl JointRequester ===

impl JointRequester {
    /// Creates a requester that sends its result once.
    #[must_use]
    pub fn new(planning: JointPlanning, result: oneshot::Sender<JointResult>) -> JointRequester {
        let plan = Err("it has not begun".to_owned());
        JointRequester {
            planning,
            conversation: None,
            projections: BTreeMap::new(),
            work: Vec::new(),
            queried: BTreeSet::new(),
            asked: None,
            cancel: Cancel::new(),
            so_far: JointResult {
                plan,
                is_proved_impossible: false,
                cost: 0.0,
                rounds: 0,
                messages: 0,
                bytes: 0,
            },
            result: Some(result),
        }
    }

    fn end(&mut self, plan: Result<SkeletonPlan, String>) {
        self.cancel.set();
        self.work.clear();
        self.so_far.plan = plan;
        if let Some(result) = self.result.take() {
            let _ = result.send(self.so_far.clone());
        }
    }

    fn members(&self) -> String {
        let names: Vec<String> =
            self.planning.members.iter().map(|member| format!("`{member}`")).collect();
        names.join(", ")
    }

    // === projections ===

    /// Queries the projections of some members.
    fn query(&mut self, members: BTreeSet<AgentId>, ctx: &mut Context<Self>) {
        self.queried = members;
        for member in self.queried.clone() {
            let (asked, from) = (ctx.ask(Resource::Domain, &member), member);
            self.so_far.messages += 1;
            let work = ctx.run(asked, move |requester: &mut Self, answers, ctx| {
                let answer = answers.first().map(|answer| answer.as_ref());
                requester.told(&from, answer, ctx);
            });
            self.work.push(work);
        }
    }

    fn told(&mut self, member: &AgentId, answer: Option<&[u8]>, ctx: &mut Context<Self>) {
        if !self.queried.contains(member) {
            return;
        }
        let Some(answer) = answer else {
            // It may not have been reachable yet. The deadline of the planning ends this.
            let again = BTreeSet::from([member.clone()]);
            ctx.after(CALLED_AGAIN, move |requester: &mut Self, ctx| {
                let queried = requester.queried.clone();
                if requester.result.is_some() && again.is_subset(&queried) {
                    requester.query(again, ctx);
                    requester.queried = queried;
                }
            });
            return;
        };
        self.so_far.messages += 1;
        self.so_far.bytes += answer.len() as u64;
        let Ok(Snapshot { domain, problem, .. }) = serde_json::from_slice(answer) else {
            return self
                .end(Err(format!("`{member}` answers with something that is no projection")));
        };
        self.queried.remove(member);
        let projection = Projection { domain, problem };
        let before = self.projections.insert(member.clone(), projection);
        if before.is_some_and(|before| before == self.projections[member]) {
            return self.end(Err(format!("`{member}` refuses a part of what it promises")));
        }
        if self.queried.is_empty() {
            self.search(ctx);
        }
    }

    // === the skeleton ===

    fn search(&mut self, ctx: &mut Context<Self>) {
        self.work.clear();
        self.so_far.rounds += 1;
        if self.so_far.rounds > ROUNDS_MAX {
            return self.end(Err(format!("no plan was agreed to in {ROUNDS_MAX} rounds")));
        }
        let projections: BTreeMap<String, Projection> =
            { self.projections.iter() }.map(|(it, own)| (it.to_string(), own.clone())).collect();
        let cancel = self.cancel.clone();
        let work = ctx.compute(
            move || search(&projections, &cancel),
            move |requester: &mut Self, found, ctx| requester.found(found, ctx),
        );
        self.work.push(work);
    }

    fn found(&mut self, found: Result<SkeletonOutcome, SkeletonError>, ctx: &mut Context<Self>) {
        let plan = match found {
            Ok(SkeletonOutcome::Found(plan)) => plan,
            Ok(SkeletonOutcome::NoPlan) => {
                let members = self.members();
                self.so_far.is_proved_impossible = true;
                return self.end(Err(format!("proven: there is no joint plan of {members}")));
            }
            Ok(SkeletonOutcome::Undecided(limit)) => {
                return self.end(Err(format!("no skeleton was found: {limit}")));
            }
            Err(SkeletonError { member: Some(member), why }) => {
                return self.end(Err(format!("`{member}`: {why}")));
            }
            Err(SkeletonError { member: None, why }) => return self.end(Err(why)),
        };
        let mut awaited = BTreeMap::new();
        for (member, steps) in &plan.parts {
            let Ok(member) = AgentId::new(member) else { continue };
            let part = JointPlanPart { digest: plan.digest.clone(), steps: steps.clone() };
            let token = self.call(&member, part, ctx);
            awaited.insert(member, token);
        }
        let is_empty = awaited.is_empty();
        let refusals = BTreeMap::new();
        self.asked = Some(PendingSkeleton { plan, awaited, costs: 0.0, refusals });
        match is_empty {
            true => self.close_round(ctx),
            false => self.remind(ctx),
        }
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
        let from = member.clone();
        ctx.open(opening, self.planning.within, move |requester: &mut Self, event, ctx| match event
        {
            ExchangeEvent::Message(message) => requester.answered(&from, &message, ctx),
            ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) => {
                requester.refused(&from, "it did not answer".to_owned(), ctx);
            }
        })
    }

    /// Calls the members again that have not answered.
    fn remind(&mut self, ctx: &mut Context<Self>) {
        let round = self.so_far.rounds;
        ctx.after(CALLED_AGAIN, move |requester: &mut Self, ctx| {
            let Some(asked) = requester.asked.as_ref().filter(|_| requester.result.is_some())
            else {
                return;
            };
            if requester.so_far.rounds == round {
                asked.awaited.iter().for_each(|(member, token)| ctx.resend_cfp(token, member));
                requester.remind(ctx);
            }
        });
    }

    fn answered(&mut self, member: &AgentId, message: &Message, ctx: &mut Context<Self>) {
        let Some(asked) = &mut self.asked else { return };
        if !asked.awaited.contains_key(member) {
            return;
        }
        self.so_far.messages += 1;
        self.so_far.bytes += message.content.to_string().len() as u64;
        match message.performative {
            Performative::Agree => match message.content_as::<Bid>() {
                Ok(bid) if bid.agreed.as_deref() == Some(asked.plan.digest.as_str()) => {
                    let costs = bid.proposals.iter().map(|proposal| proposal.cost);
                    asked.costs += costs.filter(|cost| cost.is_finite()).sum::<f64>();
                    asked.awaited.remove(member);
                }
                Ok(_) => return self.refused(member, "it agrees to another plan".to_owned(), ctx),
                Err(error) => return self.refused(member, error.to_string(), ctx),
            },
            _ => {
                let refusal = message.content_as::<Refusal>().map(|refusal| refusal.detail);
                let why = refusal.unwrap_or_else(|error| error.to_string());
                return self.refused(member, why, ctx);
            }
        }
        self.close_round(ctx);
    }

    fn refused(&mut self, member: &AgentId, why: String, ctx: &mut Context<Self>) {
        let Some(asked) = &mut self.asked else { return };
        if asked.awaited.remove(member).is_some() {
            tracing::info!(%member, why, "a part of the skeleton is refused");
            asked.refusals.insert(member.clone(), why);
            self.close_round(ctx);
        }
    }

    /// Ends a round as soon as all members have answered.
    fn close_round(&mut self, ctx: &mut Context<Self>) {
        let Some(asked) = self.asked.take_if(|asked| asked.awaited.is_empty()) else { return };
        if asked.refusals.is_empty() {
            self.so_far.cost = asked.costs;
            return self.end(Ok(asked.plan));
        }
        self.query(asked.refusals.into_keys().collect(), ctx);
    }
}

impl Agent for JointRequester {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let cancel = self.cancel.clone();
        let within = self.planning.within;
        ctx.after(within.mul_f32(0.95), move |_: &mut Self, _| cancel.set());
        ctx.after(within, move |requester: &mut Self, _| {
            let awaited = requester.asked.iter().flat_map(|asked| asked.awaited.keys());
            let awaited: Vec<String> =
                { awaited.chain(&requester.queried) }.map(|member| format!("`{member}`")).collect();
            let waits = match awaited.is_empty() {
                true => "the search was not at its end".to_owned(),
                false => format!("{} did not answer", awaited.join(", ")),
            };
            requester.end(Err(format!("after {} s {waits}", within.as_secs_f64())));
        });
        self.query(self.planning.members.clone(), ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let Presence::Left(resident) = presence else { return };
        if !self.planning.members.remove(&resident.agent) || self.result.is_none() {
            return;
        }
        tracing::warn!(member = %resident.agent, "a member has left: the next attempt is without it");
        self.projections.remove(&resident.agent);
        // A search that runs would plan with its actions.
        self.cancel.set();
        self.cancel = Cancel::new();
        self.work.clear();
        for (_, token) in self.asked.take().into_iter().flat_map(|asked| asked.awaited) {
            ctx.close(&token);
        }
        if self.planning.members.is_empty() {
            return self.end(Err("all members have left".to_owned()));
        }
        let missing: BTreeSet<AgentId> = { self.planning.members.iter() }
            .filter(|member| !self.projections.contains_key(*member))
            .cloned()
            .collect();
        match missing.is_empty() {
            true => self.search(ctx),
            false => self.query(missing, ctx),
        }
    }
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
