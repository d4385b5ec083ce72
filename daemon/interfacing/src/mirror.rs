//! Proxy agents: an agent of another ecosystem, as far as this one may know it.
//!
//! A proxy agent is an actuator like any other here, with heartbeats, tokens and bids of its own. A request
//! to it is passed to the real agent through the Plan Executor of that agent's ecosystem ([`Voice`]). Each
//! side has a conversation of its own. Only a step in translated names passes to the far side, and only its
//! outcome passes back.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use acl::content::{Method, Methods, Outcome, Reason, Refusal, Report};
use acl::{Deadline, EcosystemId, Performative};
use actuator::{BoxFuture, Call, Description, Device, Failure, OwnFact, Performed, Stir};
use agent::{Sight, Sighted};
use pddl::{ActionModel, Domain, InitElement, Name, Problem};
use tokio::time::Instant;

use super::bucket::Bucket;
use super::export::{self, Exported, LeftOut, Shores};
use super::translate::{self, Translator};
use super::voice::{News, Voice};
use super::words::{Passage, Words};

/// Time for the far side's Plan Executor in addition to the method's own: discovery, agreement and
/// confirmation there, and the same on this side.
const BESIDE_METHOD: Duration = Duration::from_secs(10);

/// Everything that one rule passes between the two ecosystems.
pub(super) struct Crossing {
    pub(super) passage: Passage,
    pub(super) performatives: BTreeSet<Performative>,
    /// Vocabulary, far name = near name.
    pub(super) words: Words,
    /// The ecosystem of the real agent.
    pub(super) far: EcosystemId,
    pub(super) far_files: (Arc<Domain>, Arc<Problem>),
    pub(super) near_files: (Arc<Domain>, Arc<Problem>),
    /// Client that makes requests in the far ecosystem.
    pub(super) voice: Voice,
    /// Rate limits to the far side, and from it.
    pub(super) outward: Arc<Bucket>,
    pub(super) inward: Arc<Bucket>,
    pub(super) counters: Arc<Counters>,
}

/// Numbers of requests and agents that passed or did not, for the operator.
#[derive(Debug, Default)]
pub struct Counters {
    /// Requests passed on.
    pub passed: AtomicU64,
    /// Requests refused because of the rate limit.
    pub over_rate: AtomicU64,
    /// Requests that name a symbol that is not exported.
    pub unexported: AtomicU64,
    /// Agents and goals that would have returned to the ecosystem they come from.
    pub looped: AtomicU64,
}

// === impl Crossing ===

impl Crossing {
    pub(super) fn passes(&self, performative: Performative) -> bool {
        self.performatives.contains(&performative)
    }

    /// Returns the proxy agent's model of the agent.
    ///
    /// # Errors
    ///
    /// Returns an error if the agent cannot be represented at all.
    pub(super) fn export(&self, sighted: &Sighted) -> Result<Exported, String> {
        let shores = Shores {
            far: (&self.far_files.0, &self.far_files.1),
            near: (&self.near_files.0, &self.near_files.1),
        };
        let Sighted { model, methods, .. } = sighted;
        let mut exported = export::export(&self.words, &self.passage, shores, model, methods)?;
        if !self.passes(Performative::Request) {
            exported.model.actions.clear();
        }
        Ok(exported)
    }

    fn translator<'t>(&'t self, model: &ActionModel) -> Translator<'t> {
        let far = (&*self.far_files.0, &*self.far_files.1);
        Translator::of_model(&self.words, &self.passage, far, model)
    }

    /// Translates a step to the far side. The error names what is not exported.
    fn far_step(&self, action: &str) -> Result<String, String> {
        let step = pddl::parse_step(action).into_result();
        let step = step.map_err(|_| "the action cannot be read".to_owned())?;
        let Passage { agent, mirror, actions, .. } = &self.passage;
        let actions: BTreeMap<String, Name> =
            actions.iter().map(|(far, near)| (near.as_str().to_owned(), Name::new(far))).collect();
        let words = self.words.reversed();
        translate::step(&step, &actions, (mirror, agent), &words).map(|step| step.to_string())
    }
}

// === impl Mirror ===

/// Device of the actuator that is a proxy agent.
pub(super) struct Mirror {
    crossing: Arc<Crossing>,
    sight: Sight,
    sighted: Sighted,
    exported: Exported,
}

impl Mirror {
    /// Returns a proxy of the agent as it is observed now.
    pub(super) fn new(
        crossing: Arc<Crossing>,
        sight: Sight,
        sighted: Sighted,
        exported: Exported,
    ) -> Mirror {
        report_left_out(&crossing, &exported.left_out);
        Mirror { crossing, sight, sighted, exported }
    }

    /// Updates the proxy from the latest observation. If the agent is gone, nothing changes here;
    /// `crossing` ends the proxy agent.
    fn look(&mut self) {
        let Some(sighted) = self.sight.borrow_and_update().clone() else { return };
        if sighted.digest != self.sighted.digest {
            match self.crossing.export(&sighted) {
                Ok(exported) => {
                    if exported.left_out != self.exported.left_out {
                        report_left_out(&self.crossing, &exported.left_out);
                    }
                    self.exported = exported;
                }
                Err(why) => {
                    let mirror = &self.crossing.passage.mirror;
                    tracing::warn!(%mirror, why, "it offers nothing that can be expressed here");
                    self.exported.model.actions.clear();
                }
            }
        }
        self.sighted = sighted;
    }

    fn observed(&self, observations: &str) -> Vec<InitElement> {
        if !self.crossing.passes(Performative::Inform) {
            return Vec::new();
        }
        let translator = self.crossing.translator(&self.sighted.model);
        let said = pddl::parse_init_elements(observations).value.unwrap_or_default();
        said.iter().filter_map(|fact| translator.fact(fact)).collect()
    }
}

fn report_left_out(crossing: &Crossing, left_out: &[LeftOut]) {
    for left_out in left_out {
        tracing::warn!(mirror = %crossing.passage.mirror, "{left_out}");
    }
}

impl Device for Mirror {
    type Yield = Report;

    fn describe(&self) -> Description {
        let method = |(name, timeout): (&String, &Duration)| {
            let method = Method {
                method: name.clone(),
                arguments: BTreeMap::new(),
                timeout: Deadline(timeout.saturating_add(BESIDE_METHOD)),
            };
            (name.clone(), method)
        };
        let offered = |(name, _): &(&String, &Duration)| {
            self.exported.model.actions.iter().any(|action| action.name == name.as_str())
        };
        let methods: Methods = self.exported.timeouts.iter().filter(offered).map(method).collect();
        Description { model: self.exported.model.clone(), methods }
    }

    fn facts(&self) -> Vec<OwnFact> {
        if !self.crossing.passes(Performative::Inform) {
            return self.exported.model.init.iter().cloned().map(OwnFact::from).collect();
        }
        let now = Instant::now();
        let translator = self.crossing.translator(&self.sighted.model);
        let current = self.sighted.facts.iter().filter_map(|(fact, until)| {
            let known_for = until.map(|until| until.saturating_duration_since(now));
            let is_over = known_for.is_some_and(|left| left.is_zero());
            let fact = translator.fact(fact).filter(|_| !is_over)?;
            Some(OwnFact { fact, known_for })
        });
        // A heartbeat is complete: a fact that it does not contain is false.
        current.chain(self.exported.standing.iter().cloned().map(OwnFact::from)).collect()
    }

    fn objection(&mut self, call: &Call) -> Option<Refusal> {
        let Crossing { counters, outward, .. } = &*self.crossing;
        if let Err(why) = self.crossing.far_step(&call.action) {
            counters.unexported.fetch_add(1, Ordering::Relaxed);
            return Some(Refusal::new(Reason::Incapable, why));
        }
        if outward.take() {
            return None;
        }
        let count = counters.over_rate.fetch_add(1, Ordering::Relaxed) + 1;
        tracing::warn!(mirror = %self.crossing.passage.mirror, count, "too many messages");
        let detail = format!(
            "{} messages a second may pass to `{}`, and that limit is reached; ask again later",
            outward.per_second(),
            self.crossing.far
        );
        Some(Refusal::new(Reason::Busy, detail))
    }

    fn perform(&mut self, call: &Call) -> BoxFuture<Result<Report, Failure>> {
        let crossing = Arc::clone(&self.crossing);
        let step = match crossing.far_step(&call.action) {
            Ok(step) => step,
            Err(why) => return Box::pin(std::future::ready(Err(Failure::Driver(why)))),
        };
        Box::pin(async move {
            crossing.counters.passed.fetch_add(1, Ordering::Relaxed);
            let revocable = crossing.passes(Performative::Cancel);
            let mut asked = crossing.voice.act(step, revocable).await;
            loop {
                let news = asked.next().await;
                if news.is_final() {
                    return ended(&crossing, news);
                }
            }
        })
    }

    fn performed(&mut self, _call: &Call, report: Report) -> Performed {
        self.look();
        let detail = format!("done by `{}`", self.crossing.far);
        Performed { detail, observations: self.observed(&report.observations) }
    }

    fn watch(&mut self) -> Option<BoxFuture<Stir<Mirror>>> {
        let mut sight = self.sight.clone();
        let inward = Arc::clone(&self.crossing.inward);
        Some(Box::pin(async move {
            if sight.changed().await.is_err() {
                // The observer has ended, and the proxy agent ends too.
                return std::future::pending().await;
            }
            // Observations that are replaced during this wait are never announced.
            inward.wait().await;
            let stir: Stir<Mirror> = Box::new(|mirror| {
                mirror.look();
                Vec::new()
            });
            stir
        }))
    }

    fn bids(&self) -> bool {
        self.crossing.passes(Performative::Cfp)
    }
}

/// Converts the end of a request to a result, without the other ecosystem's texts.
fn ended(crossing: &Crossing, news: News) -> Result<Report, Failure> {
    let far = &crossing.far;
    let reason = news.reason();
    match news {
        News::Report(report) if report.outcome == Outcome::Done => Ok(report),
        News::Report(report) if report.outcome == Outcome::Cancelled => {
            Err(Failure::Driver(format!("go on: `{far}` has given it up")))
        }
        News::Report(_) => Err(Failure::Driver(format!("have it done by `{far}`"))),
        News::Refused(_) => {
            let why = reason.map(|reason| format!(" ({reason:?})")).unwrap_or_default();
            Err(Failure::Driver(format!("have it done by `{far}`, which declined{why}")))
        }
        News::Unanswered => Err(Failure::Driver(format!("hear from `{far}` in time"))),
    }
}
