//! The Planning Agent (the paper, “Planning Agent”): computes a plan from a domain and a problem.
//!
//! - `request` from the Plan Requester → `propose` with the plan, or with the reason why there is
//!   none.
//! - Plans in the background, with one thread for each request and a maximum number of requests. A
//!   `cancel` or the deadline of the request ends the search.
//! - Keeps the ground task from one request to the next, and reuses the remaining steps of a former
//!   plan if the request contains them.
//! - The choice of a plan, its execution, and the decision about replanning belong to other agents.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use acl::content::{PlanProposal, PlanRequest, PlanStatus, Reason, Request};
use acl::{Message, Performative, ReplyToken};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, Participation, PluginEntry,
    WorkHandle,
};
use pddl::{Domain, PlanStep};
use planner::{Budget, Cancel, Options, PlanError, Replanner, StopReason};

/// Maximum number of searches that run in parallel. A board has few cores. Further requests are
/// refused at once instead of waiting, so that the requester can report the refusal.
const SEARCHES_MAX: usize = 8;

/// The entry of the Planning Agent in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "planning-agent",
    about: "plans centrally, with the embedded planner",
    drivers: &[],
    has_replicas: true,
    build,
};

fn build(_: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    Ok(Box::new(PlanningAgent { searches: BTreeMap::new(), cache: Arc::default() }))
}

struct PlanningAgent {
    searches: BTreeMap<ReplyToken, RunningSearch>,
    /// Data for the next search, used by one search at a time. A search that runs at the same time
    /// starts with an empty cache instead of waiting.
    cache: Arc<Mutex<PlannerCache>>,
}

/// Data that the planner keeps from one request to the next.
#[derive(Default)]
struct PlannerCache {
    /// The domain of the last request: its text and the parsed form.
    domain: Option<(String, Arc<Domain>)>,
    replanner: Replanner,
}

struct RunningSearch {
    cancel: Cancel,
    _work: WorkHandle,
}

impl Agent for PlanningAgent {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
            .on(Performative::AcceptProposal, Self::proposal_judged)
            .on(Performative::RejectProposal, Self::proposal_judged)
    }

    fn drain(&mut self, _ctx: &mut Context<Self>) -> bool {
        self.searches.values().for_each(|search| search.cancel.set());
        true
    }
}

impl PlanningAgent {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let request = match message.content_as::<Request>() {
            Ok(Request::Plan(request)) => request,
            Ok(_) => {
                let detail = "a Planning Agent computes plans; ask the Plan Requester for goals";
                return ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        if self.searches.len() >= SEARCHES_MAX {
            let detail = format!("{SEARCHES_MAX} searches are running");
            return ctx.refuse(&participation, Reason::Busy, detail);
        }
        self.search(participation, message, request, ctx);
    }

    fn search(
        &mut self,
        participation: Participation,
        message: Message,
        request: PlanRequest,
        ctx: &mut Context<Self>,
    ) {
        let patience = message.reply_within.map_or(ctx.settings().planning_deadline, |by| by.0);
        let cancel = Cancel::new();
        let (flag, deadline) = (cancel.clone(), cancel.clone());
        // The planner reads no clock; therefore a timer sets the cancel flag.
        ctx.after(patience.mul_f32(0.9), move |_, _| deadline.set());
        let token = participation.exchange.clone();
        let finished = token.clone();
        let memory = Arc::clone(&self.cache);
        let work = ctx.compute(
            move || match memory.try_lock() {
                Ok(mut memory) => propose(&request, &mut memory, &flag),
                Err(_) => propose(&request, &mut PlannerCache::default(), &flag),
            },
            move |agent, proposal, ctx| {
                agent.searches.remove(&finished);
                ctx.answer(&participation, Performative::Propose, &proposal);
            },
        );
        self.searches.insert(token, RunningSearch { cancel, _work: work });
    }

    fn cancelled(&mut self, message: Message, _ctx: &mut Context<Self>) {
        if let Some(search) = message.exchange().and_then(|token| self.searches.get(token)) {
            search.cancel.set();
        }
    }

    fn proposal_judged(&mut self, message: Message, _ctx: &mut Context<Self>) {
        tracing::debug!(conversation = %message.conversation_id, verdict = %message.performative,
            "the proposal was accepted or rejected");
    }
}

impl PlannerCache {
    /// Returns the parsed form of a domain's text. The text is parsed only if it differs from the
    /// text of the last request.
    ///
    /// # Errors
    ///
    /// Returns the diagnostics of the parser if the text is not valid PDDL.
    fn domain(&mut self, text: &str) -> Result<Arc<Domain>, Vec<pddl::Diagnostic>> {
        if let Some((_, known)) = self.domain.as_ref().filter(|(known, _)| known == text) {
            return Ok(Arc::clone(known));
        }
        let domain = Arc::new(pddl::parse_domain(text).into_result()?);
        self.domain = Some((text.to_owned(), Arc::clone(&domain)));
        Ok(domain)
    }
}

/// Plans for a request. Returns the plan, or the reason why there is none.
fn propose(request: &PlanRequest, memory: &mut PlannerCache, cancel: &Cancel) -> PlanProposal {
    let nothing = |status, detail: String| PlanProposal {
        status,
        plan: None,
        cost: None,
        detail: Some(detail),
    };
    let parsed = memory.domain(&request.domain).and_then(|domain| {
        let problem = pddl::parse_problem(&request.problem).into_result()?;
        Ok((domain, problem, remaining_steps(request)?))
    });
    let (domain, problem, rest) = match parsed {
        Ok(texts) => texts,
        Err(diagnostics) => {
            return nothing(PlanStatus::Unsupported, join_diagnostics(&diagnostics));
        }
    };
    let memory_max_bytes = agent::computation_bytes_max();
    let budget = Budget { memory_max_bytes, ..Budget::default() };
    let options = Options { budget, ..Options::default() };
    let replanner = &mut memory.replanner;
    let planned = replanner.plan(&domain, &problem, &rest, &options, cancel);
    match planned.map(|planned| planned.outcome) {
        Ok(outcome) => match outcome.plan {
            Some(plan) => PlanProposal {
                status: PlanStatus::Solved,
                cost: plan.cost.map(|cost| cost.0),
                plan: Some(plan.to_string()),
                detail: None,
            },
            None => nothing(status(outcome.stop_reason), outcome.stop_reason.to_string()),
        },
        Err(PlanError::BadInput(diagnostics)) => {
            nothing(PlanStatus::Unsupported, join_diagnostics(&diagnostics))
        }
        Err(error) => nothing(PlanStatus::Unsupported, error.to_string()),
    }
}

/// Returns the remaining steps of the plan that was running for the goal; empty if the request
/// contains none.
///
/// # Errors
///
/// Returns the diagnostics of the parser if the steps are not valid.
fn remaining_steps(request: &PlanRequest) -> Result<Vec<PlanStep>, Vec<pddl::Diagnostic>> {
    let Some(text) = &request.remaining_steps else { return Ok(Vec::new()) };
    Ok(pddl::parse_plan(text).into_result()?.steps)
}

fn join_diagnostics(diagnostics: &[pddl::Diagnostic]) -> String {
    diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

fn status(reason: StopReason) -> PlanStatus {
    match reason {
        StopReason::GoalReached => PlanStatus::Solved,
        StopReason::Unsolvable { .. } => PlanStatus::Unsolvable,
        StopReason::Exhausted => PlanStatus::Exhausted,
        StopReason::Cancelled => PlanStatus::Cancelled,
        _ => PlanStatus::Limit,
    }
}
