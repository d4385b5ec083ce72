//! The Domain Maintainer (the paper, “Domain Maintainer”): what the ecosystem can do now, and
//! what is known.
//!
//! - Hears action models and heartbeats, sees who comes and goes; composes (`capability`).
//! - Tells all what changed (`inform`), answers who asks for the domain or the state.
//! - Takes changes of the state, the metric, the actions, and observations by `request`
//!   (`changing`), and spreads them to the actuators.
//! - Does not plan, and decides nothing about goals.

mod changing;
mod derived;
mod handing_over;
mod kept;

use std::sync::Arc;
use std::time::Duration;

use acl::content::{
    BelievedFact, BelievedState, Claim, EpochChange, Inform, Reason, Record, Refusal, Requested,
    RequestedSince, Version, value,
};
use acl::{Deadline, Message, Performative};
use agent::keeping::{self, Keeper, Keeps};
use agent::upkeep::{self, Maintains, Upkeep};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, Launch, PluginEntry, Presence, Resource,
    TimerId,
};
use capability::{Change, Conflict, Maintainer, Moment, Requests, Scope};
use serde::Deserialize;

use crate::handing_over::Namesakes;
use crate::kept::KeptRequests;

/// How long after an announcement changes are gathered for the next: the models of a daemon that
/// starts come within this time, and one announcement serves them all. What changes by itself is
/// announced at once.
const GATHERING: Duration = Duration::from_millis(5);

/// How long after news of requests all that they changed is told: who missed the news hears it then,
/// and however many news come meanwhile, it is told once.
const TELLING_ALL: Duration = Duration::from_secs(1);

/// Under which key the Journals keep what requests changed.
const REQUESTED: &str = "state/requested";

/// The line in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "domain-maintainer",
    about: "composes what everyone can do, and keeps what is known",
    drivers: &[],
    stands_by: true,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let (ontology, map) = (&blueprint.host.ontology, &blueprint.host.map);
    let mut maintainer = Maintainer::new(Arc::clone(ontology), Arc::clone(map), Scope::Everything);
    // Until it is said to act.
    maintainer.stands_by(true);
    Ok(Box::new(DomainMaintainer {
        upkeep: Upkeep::new(maintainer),
        unannounced: None,
        announcing: None,
        announced: None,
        tells: Tells::Nothing,
        telling_all: None,
        has_requests: false,
        keeper: Keeper::new(&blueprint.host),
        is_leading: false,
        recalled: None,
        namesakes: Namesakes::default(),
    }))
}

struct DomainMaintainer {
    upkeep: Upkeep,
    /// What changed since the last announcement.
    unannounced: Option<EpochChange>,
    announcing: Option<TimerId>,
    /// When it announced something last.
    announced: Option<Moment>,
    /// What the next announcement tells of requests.
    tells: Tells,
    telling_all: Option<TimerId>,
    /// Whether there was something to tell when they were told last.
    has_requests: bool,
    keeper: Keeper<DomainMaintainer>,
    /// Whether it acts: who stands by hears the same and says nothing.
    is_leading: bool,
    /// What requests had changed when it was kept last, if that was read.
    recalled: Option<Version>,
    namesakes: Namesakes,
}

/// How much of what requests changed is told: at each moment the most that somebody lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Tells {
    Nothing,
    News,
    /// All of it, for who missed the news.
    Again,
    /// All of it, where there is more than facts, or somebody has heard nothing yet.
    All,
}

impl Agent for DomainMaintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on_broadcast(Performative::Inform, Self::informed)
    }

    fn leads(&mut self, is_leading: bool, ctx: &mut Context<Self>) {
        let was_leading = std::mem::replace(&mut self.is_leading, is_leading);
        self.upkeep.maintainer.stands_by(!is_leading);
        keeping::leads(self, is_leading, ctx);
        if is_leading {
            // Another may act where this one does not reach.
            self.upkeep.maintainer.part();
            self.look_around(ctx);
        } else if was_leading {
            self.stand_down(ctx);
        }
        if is_leading && self.upkeep.maintainer.revision() > 0 {
            // Whoever listens learns that somebody speaks again, and all that requests changed.
            self.tells = Tells::All;
            self.announce_requests(ctx);
        }
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        upkeep::presence(self, presence, ctx);
        keeping::presence(self, presence, ctx);
        if presence.resident().agent == *ctx.id() {
            self.look_around(ctx);
        }
    }

    fn asked(&mut self, resource: Resource, ctx: &mut Context<Self>) -> Option<String> {
        if matches!(resource, Resource::Domain | Resource::State) {
            upkeep::compose(self, ctx);
        }
        let answer = match resource {
            Resource::Domain => {
                let snapshot = self.upkeep.maintainer.snapshot(self.upkeep.moment());
                let mut content = snapshot.to_content();
                for conflict in self.upkeep.maintainer.conflicts() {
                    // Before it, whose word stands.
                    let Some(agent) = conflict.agents.last() else { continue };
                    let of_it = content.conflicts.entry(agent.clone()).or_default();
                    of_it.push(conflict.to_string());
                }
                serde_json::to_string(&content)
            }
            Resource::State => serde_json::to_string(&self.state()),
            Resource::Directory
            | Resource::Goals
            | Resource::Model
            | Resource::Mailbox
            | Resource::Questions
            | Resource::Journal
            | Resource::Plugins
            | Resource::Discovered
            | Resource::Files => return None,
        };
        answer.ok()
    }
}

impl Maintains for DomainMaintainer {
    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn changed(&mut self, change: &Change, ctx: &mut Context<Self>) {
        if change.epoch_changed {
            tracing::info!(epoch = change.epoch, joined = ?change.joined, left = ?change.left,
                "a new epoch");
        }
        // Whoever joined has not heard what requests changed before.
        if change.epoch_changed {
            self.tells = Tells::All;
        }
        self.announce_soon(EpochChange::from(change), ctx);
    }

    fn conflicted(&mut self, conflicts: &[Conflict], ctx: &mut Context<Self>) {
        for conflict in conflicts {
            tracing::warn!(agents = ?conflict.agents, "{conflict}");
            for agent in &conflict.agents {
                ctx.tell(
                    agent,
                    Performative::Refuse,
                    &Refusal::new(Reason::Conflict, conflict.to_string()),
                );
            }
        }
    }
}

impl Keeps for DomainMaintainer {
    fn keeper(&mut self) -> &mut Keeper<Self> {
        &mut self.keeper
    }

    /// Believes again what was requested before everybody here was restarted.
    fn recalled(&mut self, records: Vec<Record>, ctx: &mut Context<Self>) {
        let Some(record) = records.into_iter().find(|record| record.key == REQUESTED) else {
            return;
        };
        // What it heard or wrote itself is newer than what it wrote.
        let is_known = self.recalled.is_some_and(|known| known >= record.version);
        let is_own = record.version.term == self.keeper.term();
        if is_known || is_own || self.has_requests {
            return;
        }
        self.recalled = Some(record.version);
        let now = self.upkeep.moment();
        let wall_clock = ctx.switchboard().machine().wall_clock();
        let kept = KeptRequests::deserialize(record.body).map_err(|error| error.to_string());
        let requests = kept.and_then(|kept| {
            let mistakes = |found: Vec<pddl::Diagnostic>| {
                found.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
            };
            Requests::read(&kept.until_now(wall_clock), now).map_err(mistakes)
        });
        let recalled = requests.and_then(|requests| {
            let maintainer = &mut self.upkeep.maintainer;
            maintainer.recall(&requests, now).map_err(|declined| declined.to_string())
        });
        match recalled {
            Ok(change) => {
                tracing::info!("believes again what was requested before");
                self.tells = Tells::All;
                upkeep::conclude(self, &change, ctx);
            }
            Err(why) => tracing::warn!(why, "what was requested before cannot be believed"),
        }
    }
}

impl DomainMaintainer {
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        upkeep::informed(self, &message, ctx);
    }

    /// Sees to it that what requests changed is announced, also where nothing else is new.
    fn announce_requests(&mut self, ctx: &mut Context<Self>) {
        let maintainer = &self.upkeep.maintainer;
        let (epoch, revision) = (maintainer.epoch(), maintainer.revision());
        self.announce_soon(EpochChange { epoch, revision, ..EpochChange::default() }, ctx);
    }

    /// Has the Journals keep what requests changed: nobody says it again by itself.
    fn keep_requests(&mut self, requested: Requested, ctx: &mut Context<Self>) {
        if self.keeper.journals().is_empty() {
            return;
        }
        let kept = KeptRequests::new(requested, ctx.switchboard().machine().wall_clock());
        let record = self.keeper.write(REQUESTED.to_owned(), value(&kept));
        self.recalled = Some(record.version);
        keeping::keep_on(self, &[record], ctx);
    }

    /// Gathers what changed, to announce it in one message.
    fn announce_soon(&mut self, change: EpochChange, ctx: &mut Context<Self>) {
        if !self.is_leading {
            return;
        }
        match &mut self.unannounced {
            None => self.unannounced = Some(change),
            Some(gathered) => gather(gathered, change),
        }
        if self.announcing.is_some() {
            return;
        }
        let now = self.upkeep.moment();
        let over = self.announced.map_or(GATHERING, |last| now.since(last));
        match GATHERING.saturating_sub(over) {
            // Not by a timer: the shortest runs out in the next millisecond.
            Duration::ZERO => self.announce(ctx),
            wait => {
                let announce =
                    |maintainer: &mut Self, ctx: &mut Context<Self>| maintainer.announce(ctx);
                self.announcing = Some(ctx.after(wait, announce));
            }
        }
    }

    fn announce(&mut self, ctx: &mut Context<Self>) {
        self.announcing = None;
        let Some(mut change) = self.unannounced.take() else { return };
        self.announced = Some(self.upkeep.moment());
        let tells = std::mem::replace(&mut self.tells, Tells::Nothing);
        match tells {
            Tells::Nothing => (),
            Tells::News => self.tell_news(&mut change, ctx),
            Tells::Again | Tells::All => self.tell_all(tells, &mut change, ctx),
        }
        let EpochChange { epoch, revision, .. } = change;
        let is_nothing = change == EpochChange { epoch, revision, ..EpochChange::default() };
        // That somebody speaks again is something.
        if !is_nothing || tells == Tells::All {
            ctx.inform_all(&Inform::Epoch(change));
        }
    }

    /// Tells what is new of requests, and in a moment all of it: so that what is told is as long as
    /// what is new, and who missed it does not lack it for long.
    fn tell_news(&mut self, change: &mut EpochChange, ctx: &mut Context<Self>) {
        let now = self.upkeep.moment();
        let Some(since) = self.upkeep.maintainer.requested_since(now) else {
            return self.tell_all(Tells::All, change, ctx);
        };
        if since == RequestedSince::default() {
            return;
        }
        self.has_requests |= !since.facts.is_empty() || !since.retracted.is_empty();
        change.requested_since = Some(since);
        if !self.keeper.journals().is_empty() {
            let requested = self.upkeep.maintainer.requested(now);
            self.keep_requests(requested, ctx);
        }
        if self.telling_all.is_none() {
            self.telling_all = Some(ctx.after(TELLING_ALL, |maintainer: &mut Self, ctx| {
                maintainer.tells = maintainer.tells.max(Tells::Again);
                maintainer.announce_requests(ctx);
            }));
        }
    }

    fn tell_all(&mut self, tells: Tells, change: &mut EpochChange, ctx: &mut Context<Self>) {
        if let Some(timer) = self.telling_all.take() {
            ctx.forget(timer);
        }
        let now = self.upkeep.moment();
        // From now on counts what is new beside it.
        let since = self.upkeep.maintainer.requested_since(now);
        let requested = self.upkeep.maintainer.requested(now);
        let is_nothing = requested == Requested::default();
        // That it is nothing now is news once.
        let was_something = std::mem::replace(&mut self.has_requests, !is_nothing);
        if is_nothing && !was_something {
            return;
        }
        change.requested = Some(requested.clone());
        // What is told again was kept when it was news.
        if tells == Tells::All || since != Some(RequestedSince::default()) {
            self.keep_requests(requested, ctx);
        }
    }

    fn state(&self) -> BelievedState {
        let maintainer = &self.upkeep.maintainer;
        let provenance = maintainer.provenance(self.upkeep.moment());
        let known = provenance.into_iter().filter(|fact| fact.left_out.is_none()).map(|fact| {
            BelievedFact {
                fact: fact.fact.to_string(),
                owners: fact.claims.iter().map(|claim| claim.owner.to_string()).collect(),
                age_ms: fact
                    .claims
                    .iter()
                    .map(|claim| u64::try_from(claim.age.as_millis()).unwrap_or(u64::MAX))
                    .min()
                    .unwrap_or(0),
                known_for: known_for(&fact.claims),
                claims: fact.claims.iter().map(claim).collect(),
            }
        });
        let mut facts: Vec<BelievedFact> = known.collect();
        let mut derived = derived::derived(&maintainer.snapshot(self.upkeep.moment()));
        // What an agent left behind is known to be unknown already.
        derived.retain(|derived| facts.iter().all(|known| known.fact != derived.fact));
        facts.extend(derived);
        BelievedState { epoch: maintainer.epoch(), revision: maintainer.revision(), facts }
    }
}

fn claim(claim: &capability::ClaimedBy) -> Claim {
    Claim {
        owner: claim.owner.to_string(),
        fact: claim.said.to_string(),
        source: claim.source.to_string(),
        age_ms: u64::try_from(claim.age.as_millis()).unwrap_or(u64::MAX),
        known_for: claim.left.map(Deadline),
    }
}

/// A fact is known as long as the longest claim; until further notice, if any claim is so.
fn known_for(claims: &[capability::ClaimedBy]) -> Option<Deadline> {
    let left: Option<Vec<Duration>> = claims.iter().map(|claim| claim.left).collect();
    left?.into_iter().max().map(Deadline)
}

fn gather(gathered: &mut EpochChange, change: EpochChange) {
    let EpochChange { epoch, revision, joined, left, believed, retracted, .. } = change;
    (gathered.epoch, gathered.revision) = (epoch, revision);
    gathered.joined.retain(|agent| !left.contains(agent));
    gathered.left.retain(|agent| !joined.contains(agent));
    gathered.joined.extend(joined);
    gathered.left.extend(left);
    for (all, more) in [(&mut gathered.believed, believed), (&mut gathered.retracted, retracted)] {
        if !all.is_empty() && !more.is_empty() {
            all.push('\n');
        }
        all.push_str(&more);
    }
}
