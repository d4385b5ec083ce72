//! Agents of a factored planning task (MA-PDDL, as in the CoDMAP competition), and the requester of
//! their joint plan. `althing joint` plays a task with them.
//!
//! - A factored agent reads its own domain and problem. It answers the query `domain` with its
//!   projection, and a `cfp` with a part by `agree`, or by `refuse`. After a refusal its projection
//!   is sharper. What is `:private` leaves the agent under opaque names only (crate `skeleton`).
//! - `requester` queries the projections of all members, plans over them, and calls each member for
//!   its part, until all agree.

#[cfg(test)]
mod agent_tests;
mod requester;

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::content::{Bid, CallForProposals, JointPlanPart, Proposal, Reason, Snapshot};
use acl::{AgentId, Message, Performative, ReplyToken};
use agent::{
    Agent, Blueprint, BuildCheck, BuildError, Callbacks, Context, EcosystemFolder, LaunchableAgent,
    Participation, PluginEntry, Resource, TimerId, WorkHandle,
};
use pddl::factored::AgentFiles;
use planner::{Budget, Cancel, Options};
use serde::Deserialize;
use skeleton::{FilledPart, Partner, Projection};

pub use crate::requester::{JointRequest, JointRequester, JointResult};

/// Maximum number of parts that an agent plans at the same time. A requester calls for one.
const PARTS_MAX: usize = 4;

/// Maximum number of elements of a part.
const PART_STEPS_MAX: usize = 10_000;

/// Part of the time for an answer within which a part is planned; the rest is for the way of the answer.
const PLANNED_WITHIN: f32 = 0.9;

/// Number of digits of a digest.
const DIGEST_DIGITS: usize = 16;

/// How long an agent plans its part if the call names no time, and at most.
const FILLED_WITHIN: Duration = Duration::from_secs(30);
const FILLED_WITHIN_MAX: Duration = Duration::from_secs(30 * 60);

/// The entry of factored agents in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "factored-agent",
    about: "takes part in a factored planning task, for `althing joint`",
    drivers: &[],
    has_replicas: false,
    build,
};

/// The `config` of a factored agent's entry.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    /// File with the agent's domain.
    domain: PathBuf,
    /// File with the agent's problem.
    problem: PathBuf,
    /// File for the steps of the agent in the last part that it has agreed to. They contain what is
    /// private, and stay on this machine.
    #[serde(default)]
    part: Option<PathBuf>,
}

/// A factored agent.
struct FactoredAgent {
    partner: Arc<Mutex<Partner>>,
    part_file: Option<PathBuf>,
    /// The parts that are being planned, by who calls for them and the exchange.
    filling: HashMap<(AgentId, ReplyToken), PartInWork>,
}

/// A part that is being planned.
struct PartInWork {
    cancel: Cancel,
    /// Ends the search, and then, if that is lost, the wait for it.
    deadlines: [TimerId; 2],
    _work: WorkHandle,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config: Config = blueprint.config_as()?;
    let resources = &blueprint.host.resources;
    if resources.get::<BuildCheck>().is_some() {
        return Ok(Box::new(UnreadAgent));
    }
    let folder = resources.get::<EcosystemFolder>().map(|folder| folder.0.clone());
    let path = |path: &Path| folder.as_deref().unwrap_or(Path::new("")).join(path);
    let id = blueprint.id.as_str();
    let partner = read(id, &path(&config.domain), &path(&config.problem))
        .and_then(Partner::new)
        .map_err(|why| blueprint.problem(why))?;
    Ok(Box::new(FactoredAgent {
        partner: Arc::new(Mutex::new(partner)),
        part_file: config.part.as_deref().map(path),
        filling: HashMap::new(),
    }))
}

/// Reads the files of an agent.
///
/// # Errors
///
/// Returns the reason, as text for a person, if a file cannot be read or parsed.
fn read(agent: &str, domain: &Path, problem: &Path) -> Result<AgentFiles, String> {
    let text = |path: &Path| {
        std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
    };
    let mistake = |path: &Path, found: Vec<pddl::Diagnostic>| {
        let first = found.first().map(ToString::to_string).unwrap_or_default();
        format!("{}: {first}", path.display())
    };
    let (domain_text, problem_text) = (text(domain)?, text(problem)?);
    Ok(AgentFiles {
        agent: agent.to_owned(),
        domain: pddl::parse_domain(&domain_text)
            .into_result()
            .map_err(|found| mistake(domain, found))?,
        problem: pddl::parse_problem(&problem_text)
            .into_result()
            .map_err(|found| mistake(problem, found))?,
    })
}

/// Stands for a factored agent while its entry is checked: files are then not read.
struct UnreadAgent;

impl Agent for UnreadAgent {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }
}

impl Agent for FactoredAgent {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Cfp, Self::called)
            .on(Performative::AcceptProposal, Self::judged)
            .on(Performative::RejectProposal, Self::judged)
    }

    fn wants_presence(&self) -> bool {
        false
    }

    fn answer_query(&mut self, resource: Resource, _ctx: &mut Context<Self>) -> Option<String> {
        if resource != Resource::Domain {
            return None;
        }
        let partner = self.partner.lock().unwrap_or_else(PoisonError::into_inner);
        // An agent keeps more and more of its private symbols: their number is its revision.
        let answer = answer(&partner.projection(), partner.kept().0 as u64);
        serde_json::to_string(&answer).ok()
    }

    fn drain(&mut self, _ctx: &mut Context<Self>) -> bool {
        self.filling.values().for_each(|part| part.cancel.set());
        true
    }
}

impl FactoredAgent {
    fn called(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let call = match message.content_as::<CallForProposals>() {
            Ok(call) => call,
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        let Some(part) = call.part else {
            let why = "a factored agent answers calls for a part of a joint plan";
            return ctx.refuse(&participation, Reason::Incapable, why);
        };
        let is_digest = |it: &str| {
            it.len() == DIGEST_DIGITS && it.bytes().all(|digit| digit.is_ascii_hexdigit())
        };
        if !is_digest(&part.digest) {
            let why = format!("the digest of its part is not {DIGEST_DIGITS} hexadecimal digits");
            return ctx.refuse(&participation, Reason::Incapable, why);
        }
        let key = (participation.initiator.clone(), participation.exchange.clone());
        // The call comes again if the answer takes long.
        if self.filling.contains_key(&key) {
            return;
        }
        // A requester has one skeleton at a time: its new call replaces those before it.
        let before = self.filling.iter().filter(|((of, _), _)| *of == participation.initiator);
        before.for_each(|(_, part)| part.cancel.set());
        if self.filling.len() >= PARTS_MAX || part.steps.len() > PART_STEPS_MAX {
            let why = format!(
                "it plans at most {PARTS_MAX} parts at a time, of at most {PART_STEPS_MAX} elements"
            );
            return ctx.refuse(&participation, Reason::Busy, why);
        }
        let cancel = Cancel::new();
        let (flag, deadline) = (cancel.clone(), cancel.clone());
        let patience = message.reply_within.map_or(FILLED_WITHIN, |within| within.0);
        let patience = patience.min(FILLED_WITHIN_MAX);
        let (lost, answer) = (key.clone(), participation.clone());
        let deadlines = [
            ctx.after(patience.mul_f32(PLANNED_WITHIN), move |_: &mut Self, _| deadline.set()),
            ctx.after(patience, move |agent: &mut Self, ctx| {
                if agent.filling.remove(&lost).is_some() {
                    ctx.refuse(&answer, Reason::Incapable, "its part was not planned in time");
                }
            }),
        ];
        let finished = key.clone();
        let (partner, part_file) = (Arc::clone(&self.partner), self.part_file.clone());
        let (id, conjuncts) = (ctx.id().to_string(), call.conjuncts);
        let work = ctx.compute(
            move || agree(&partner, &part, conjuncts, part_file.as_deref(), &id, &flag),
            move |agent: &mut Self, bid, ctx| {
                let Some(part) = agent.filling.remove(&finished) else { return };
                part.deadlines.into_iter().for_each(|timer| ctx.cancel_timer(timer));
                match bid {
                    Ok(bid) => ctx.answer(&participation, Performative::Agree, &bid),
                    Err(why) => ctx.refuse(&participation, Reason::Incapable, why),
                }
            },
        );
        self.filling.insert(key, PartInWork { cancel, deadlines, _work: work });
    }

    fn judged(&mut self, message: Message, _ctx: &mut Context<Self>) {
        tracing::debug!(verdict = %message.performative, "the part was accepted or rejected");
    }
}

/// Returns the answer to the query `domain`: the projection.
fn answer(projection: &Projection, revision: u64) -> Snapshot {
    Snapshot {
        epoch: revision,
        revision,
        domain: projection.domain.clone(),
        problem: projection.problem.clone(),
        digest: String::new(),
        offers: Default::default(),
        guards: Default::default(),
        former: Vec::new(),
        knowledge: Default::default(),
        conflicts: Default::default(),
    }
}

/// Fills a part. If that is impossible, sharpens the projection.
///
/// # Errors
///
/// Returns the reason of the refusal, as text for a person. It names nothing private.
fn agree(
    partner: &Mutex<Partner>,
    part: &JointPlanPart,
    conjuncts: Vec<String>,
    part_file: Option<&Path>,
    agent: &str,
    cancel: &Cancel,
) -> Result<Bid, String> {
    let memory_max_bytes = agent::computation_bytes_max();
    let budget = Budget { memory_max_bytes, ..Budget::default() };
    let options = Options { budget, ..Options::default() };
    // Queries are answered while the part is planned, so the lock is not held for long.
    let partner_now = partner.lock().unwrap_or_else(PoisonError::into_inner).clone();
    match partner_now.fill(&part.steps, &options, cancel) {
        Ok(_) if cancel.is_set() => {
            Err("the part was withdrawn, or not planned in time".to_owned())
        }
        Ok(filled) => {
            if let Some(path) = part_file {
                write_part(path, &part.digest, &filled).map_err(|error| {
                    tracing::error!(agent, path = %path.display(), %error, "the part is not kept");
                    "it cannot write its part to its own disk".to_owned()
                })?;
            }
            let own = part.steps.iter().filter_map(|step| match step {
                acl::content::PartStep::Own(text) => Some(format!("{text}\n")),
                acl::content::PartStep::Others(_) => None,
            });
            let proposals =
                vec![Proposal { covers: conjuncts, plan: own.collect(), cost: filled.cost }];
            let agreed = Some(part.digest.clone());
            Ok(Bid { proposals, domain_digest: part.digest.clone(), agreed })
        }
        Err(refusal) => {
            let detail = refusal.private_detail.as_deref().unwrap_or_default();
            tracing::info!(agent, why = refusal.why, detail, "the part is refused");
            let mut partner = partner.lock().unwrap_or_else(PoisonError::into_inner);
            // Another part may have been refused meanwhile, for a reason that this one shares.
            let is_sharper = partner.kept() != partner_now.kept() || partner.sharpen(&refusal);
            Err(match is_sharper {
                true => format!("{}; its projection is sharper now", refusal.why),
                false => refusal.why,
            })
        }
    }
}

/// Writes the steps of a part: the digest of the skeleton, then each step behind the number of the
/// agent's step in the skeleton that it prepares or is.
fn write_part(path: &Path, digest: &str, filled: &FilledPart) -> std::io::Result<()> {
    let mut text = format!("{digest}\n");
    for (number, steps) in filled.steps.iter().enumerate() {
        for step in steps {
            let _ = writeln!(text, "{number} {step}");
        }
    }
    let partial = path.with_extension(format!("{digest}.partial"));
    std::fs::write(&partial, text)?;
    std::fs::rename(partial, path)
}
