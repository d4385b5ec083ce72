//! The Domain Maintainer (the paper, “Domain Maintainer”): keeps the composite domain and the known
//! state.
//!
//! - Receives action models and heartbeats, follows the membership, and composes the domain
//!   (`capability`).
//! - Broadcasts every change (`inform`); answers queries for the domain and the state.
//! - Takes `request`s that change the state, the plan metric or the available actions, and
//!   `request`s with observations (`change_requests`). Announces the resulting changes to the
//!   actuators.
//! - Other agents plan, and decide about goals.

mod change_requests;
mod derived;
mod early_changes;
mod handover;
mod stored_requests;

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use acl::content::{
    BelievedFact, BelievedState, Claim, EpochChange, Inform, Reason, Record, Refusal, Requested,
    RequestedSince, Version, value,
};
use acl::{Message, Millis, Performative};
use agent::domain_sync::{self, DomainSync, MaintainsDomain};
use agent::replication::{self, JournalClient, ReplicatesRecords};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, ConfiguredModels, Context, LaunchableAgent,
    PluginEntry, Presence, Resource, TimerId,
};
use capability::{
    Conflict, DomainChange, Maintainer, MaintainerScope, RequestedChanges, Timestamp,
};
use serde::Deserialize;

use crate::early_changes::EarlyChanges;
use crate::handover::KnownReplicas;
use crate::stored_requests::StoredRequests;

/// Minimum time between two announcements of changes. The models of a starting daemon arrive within
/// this time, and one announcement covers them all. A single change after a longer pause is
/// announced at once.
const ANNOUNCE_INTERVAL_MIN: Duration = Duration::from_millis(5);

/// Delay between the announcement of new requested changes and the announcement of all requested
/// changes. The full announcement is for agents that missed the first one. It is sent once, even if
/// more changes arrive meanwhile.
const FULL_ANNOUNCEMENT_DELAY: Duration = Duration::from_secs(1);

/// Key of the record in which the Journals keep all changes made by request.
const REQUESTED: &str = "state/requested";

/// The entry of the Domain Maintainer in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "domain-maintainer",
    about: "composes the actions of all agents, and keeps the known facts",
    drivers: &[],
    has_replicas: true,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let (ontology, map) = (&blueprint.host.ontology, &blueprint.host.map);
    let maintainer =
        Maintainer::new(Arc::clone(ontology), Arc::clone(map), MaintainerScope::Everything);
    let silence = blueprint.host.settings.silence_limit();
    let mut maintainer = maintainer.with_silence_limit(silence);
    // The agent is a standby until it is notified that it leads.
    maintainer.set_standby(true);
    let mut domain_sync = DomainSync::new(maintainer);
    if let Some(configured) = blueprint.host.resources.get::<ConfiguredModels>() {
        let now = domain_sync.timestamp();
        domain_sync.maintainer.expect_agents(configured.0.iter().cloned(), now);
    }
    Ok(Box::new(DomainMaintainer {
        domain_sync,
        unannounced: None,
        announcement_timer: None,
        last_announced: None,
        announcement_scope: AnnouncementScope::Nothing,
        full_announcement_timer: None,
        has_announced: false,
        has_requests: false,
        has_base: blueprint.host.journals.is_empty(),
        early: EarlyChanges::default(),
        journal_client: JournalClient::new(&blueprint.host),
        is_leading: false,
        record_version: None,
        known_replicas: KnownReplicas::default(),
    }))
}

struct DomainMaintainer {
    domain_sync: DomainSync,
    /// Changes of the domain and the state since the last announcement.
    unannounced: Option<EpochChange>,
    announcement_timer: Option<TimerId>,
    /// Time at which the last announcement was sent.
    last_announced: Option<Timestamp>,
    /// The part of the requested changes that the next announcement contains.
    announcement_scope: AnnouncementScope,
    full_announcement_timer: Option<TimerId>,
    /// Whether requested changes, or marks of expected agents, were in force at the last
    /// announcement of requested changes.
    has_announced: bool,
    /// Whether requested changes were in force at that announcement. Marks of expected agents do
    /// not count, because they follow from the ecosystem file, and the Journals never store them
    /// alone.
    has_requests: bool,
    /// Whether this replica knows what was requested before it led: it has read the Journals, or has
    /// received all requested changes from a leader. Until then its own requests do not replace the
    /// record in the Journals.
    has_base: bool,
    /// Changes that were requested from this replica before that.
    early: EarlyChanges,
    journal_client: JournalClient<DomainMaintainer>,
    /// Whether this replica of the Domain Maintainer leads. A standby receives the same messages
    /// and sends none.
    is_leading: bool,
    /// Version of the record of requested changes that this replica last read or wrote.
    record_version: Option<Version>,
    known_replicas: KnownReplicas,
}

/// The part of the requested changes in an announcement: the largest part that any agent lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum AnnouncementScope {
    Nothing,
    Changes,
    /// All requested changes, repeated for agents that missed the announcement of the new ones.
    FullRepeat,
    /// All requested changes, because they are more than facts, or because an agent may have
    /// received none of them yet.
    Full,
}

impl Agent for DomainMaintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on_broadcast(Performative::Inform, Self::informed)
    }

    fn leadership_changed(&mut self, is_leading: bool, ctx: &mut Context<Self>) {
        let was_leading = std::mem::replace(&mut self.is_leading, is_leading);
        self.domain_sync.maintainer.set_standby(!is_leading);
        replication::handle_leadership(self, is_leading, ctx);
        if is_leading {
            // Another leader may be active in another partition.
            self.domain_sync.maintainer.begin_partition_log();
            self.check_replicas(ctx);
        } else if was_leading {
            self.stand_down(ctx);
        }
        if is_leading && self.domain_sync.maintainer.revision() > 0 {
            // All agents learn that there is a leader again, and everything that requests changed.
            self.announcement_scope = AnnouncementScope::Full;
            self.announce_requests(ctx);
        }
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        domain_sync::presence(self, presence, ctx);
        replication::handle_presence(self, presence, ctx);
        if presence.resident().agent == *ctx.id() {
            self.check_replicas(ctx);
        }
    }

    fn answer_query(&mut self, resource: Resource, ctx: &mut Context<Self>) -> Option<String> {
        if matches!(resource, Resource::Domain | Resource::State) {
            domain_sync::compose(self, ctx);
        }
        let answer = match resource {
            Resource::Domain => {
                let snapshot = self.domain_sync.maintainer.snapshot(self.domain_sync.timestamp());
                let mut content = snapshot.to_content();
                for conflict in self.domain_sync.maintainer.conflicts() {
                    // The last agent lost the conflict; an agent before it has precedence.
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
            | Resource::Stops
            | Resource::Journal
            | Resource::Plugins
            | Resource::Discovered
            | Resource::Files
            | Resource::Daemon => return None,
        };
        answer.ok()
    }
}

impl MaintainsDomain for DomainMaintainer {
    fn domain_sync(&mut self) -> &mut DomainSync {
        &mut self.domain_sync
    }

    fn domain_changed(&mut self, change: &DomainChange, ctx: &mut Context<Self>) {
        if change.epoch_changed {
            tracing::info!(epoch = change.epoch, joined = ?change.joined, left = ?change.left,
                "a new epoch");
        }
        // An agent that has joined has not received the earlier requested changes.
        if change.epoch_changed {
            self.announcement_scope = AnnouncementScope::Full;
        }
        self.announce_soon(EpochChange::from(change), ctx);
    }

    fn conflicts_found(&mut self, conflicts: &[Conflict], ctx: &mut Context<Self>) {
        for conflict in conflicts {
            tracing::warn!(agents = ?conflict.agents, "{conflict}");
            for agent in &conflict.agents {
                ctx.send_once(
                    agent,
                    Performative::Refuse,
                    &Refusal::new(Reason::Conflict, conflict.to_string()),
                );
            }
        }
    }
}

impl ReplicatesRecords for DomainMaintainer {
    fn journal_client(&mut self) -> &mut JournalClient<Self> {
        &mut self.journal_client
    }

    /// Restores, from records of the Journals, the requested changes that were in force before all
    /// replicas were restarted. What was requested before the Journals could be read stays in force.
    fn records_restored(&mut self, records: Vec<Record>, ctx: &mut Context<Self>) {
        let is_first = !std::mem::replace(&mut self.has_base, true);
        let early = std::mem::take(&mut self.early);
        let record = records.into_iter().find(|record| record.key == REQUESTED);
        let Some(record) = record else {
            if early.is_unwritten {
                self.replicate_all_requests(ctx);
            }
            return;
        };
        // Changes that this replica received or wrote itself are newer than its record.
        let is_known = self.record_version.is_some_and(|known| known >= record.version);
        let is_own = record.version.term == self.journal_client.term();
        if is_known || is_own || (self.has_requests && !is_first) {
            return;
        }
        self.record_version = Some(record.version);
        match self.restore(record, is_first.then_some(early), ctx.wall_clock()) {
            Ok(change) => {
                tracing::info!("restores the changes that were requested earlier");
                self.announcement_scope = AnnouncementScope::Full;
                domain_sync::report_change(self, &change, ctx);
                if is_first {
                    self.announce_requests(ctx);
                    self.replicate_all_requests(ctx);
                }
            }
            Err(why) => tracing::warn!(why, "earlier requests cannot be restored"),
        }
    }
}

impl DomainMaintainer {
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        domain_sync::receive_inform(self, &message, ctx);
        let is_of_leader = message.sender == *ctx.id() && !self.is_leading;
        if is_of_leader
            && !self.has_base
            && let Ok(Inform::Epoch(change)) = message.content_as::<Inform>()
        {
            self.has_base = change.requested.is_some();
            self.early = EarlyChanges::default();
        }
    }

    /// Restores the requested changes of a record. `early` are the changes that were requested before
    /// any record could be read; `None` if one was read before.
    fn restore(
        &mut self,
        record: Record,
        early: Option<EarlyChanges>,
        wall_clock: SystemTime,
    ) -> Result<DomainChange, String> {
        let now = self.domain_sync.timestamp();
        let maintainer = &mut self.domain_sync.maintainer;
        let kept = StoredRequests::deserialize(record.body).map_err(|error| error.to_string())?;
        let read = |requested: &Requested| {
            RequestedChanges::read(requested, now).map_err(|found| {
                found.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
            })
        };
        let requests = read(&kept.in_force_at(wall_clock))?;
        let restored = match early {
            Some(early) => {
                let present = read(&maintainer.requested(now))?;
                let requests = early.put_upon(requests, present);
                maintainer.restore_earlier_requests(&requests, now)
            }
            None => maintainer.restore_requests(&requests, now),
        };
        restored.map_err(|declined| declined.to_string())
    }

    fn replicate_all_requests(&mut self, ctx: &mut Context<Self>) {
        let requested = self.domain_sync.maintainer.requested(self.domain_sync.timestamp());
        self.replicate_requests(requested, ctx);
    }

    /// Announces the requested changes in force, even if nothing else has changed.
    fn announce_requests(&mut self, ctx: &mut Context<Self>) {
        let maintainer = &self.domain_sync.maintainer;
        let (epoch, revision) = (maintainer.epoch(), maintainer.revision());
        self.announce_soon(EpochChange { epoch, revision, ..EpochChange::default() }, ctx);
    }

    /// Sends the requested changes to the Journals, because no agent repeats such changes by
    /// itself.
    fn replicate_requests(&mut self, requested: Requested, ctx: &mut Context<Self>) {
        if self.journal_client.journals().is_empty() {
            return;
        }
        if !self.has_base {
            // The record would replace one that has not been read yet.
            self.early.is_unwritten = true;
            return;
        }
        let kept = StoredRequests::new(requested, ctx.wall_clock());
        let record = self.journal_client.write(REQUESTED.to_owned(), value(&kept));
        self.record_version = Some(record.version);
        replication::replicate_detached(self, &[record], ctx);
    }

    /// Collects changes until the next announcement, so that one message announces them all.
    fn announce_soon(&mut self, change: EpochChange, ctx: &mut Context<Self>) {
        if !self.is_leading {
            return;
        }
        match &mut self.unannounced {
            None => self.unannounced = Some(change),
            Some(gathered) => merge_change(gathered, change),
        }
        if self.announcement_timer.is_some() {
            return;
        }
        let now = self.domain_sync.timestamp();
        let over = self.last_announced.map_or(ANNOUNCE_INTERVAL_MIN, |last| now.since(last));
        match ANNOUNCE_INTERVAL_MIN.saturating_sub(over) {
            // No timer is used, because even the shortest timer fires a millisecond later.
            Duration::ZERO => self.announce(ctx),
            wait => {
                let announce =
                    |maintainer: &mut Self, ctx: &mut Context<Self>| maintainer.announce(ctx);
                self.announcement_timer = Some(ctx.after(wait, announce));
            }
        }
    }

    fn announce(&mut self, ctx: &mut Context<Self>) {
        self.announcement_timer = None;
        let Some(mut change) = self.unannounced.take() else { return };
        self.last_announced = Some(self.domain_sync.timestamp());
        let tells = std::mem::replace(&mut self.announcement_scope, AnnouncementScope::Nothing);
        match tells {
            AnnouncementScope::Nothing => (),
            AnnouncementScope::Changes => self.add_changes(&mut change, ctx),
            AnnouncementScope::FullRepeat | AnnouncementScope::Full => {
                self.add_all_requests(tells, &mut change, ctx)
            }
        }
        let EpochChange { epoch, revision, .. } = change;
        let is_nothing = change == EpochChange { epoch, revision, ..EpochChange::default() };
        // An announcement without a change still shows that there is a leader again.
        if !is_nothing || tells == AnnouncementScope::Full {
            ctx.inform_all(&Inform::Epoch(change));
        }
    }

    /// Adds the new requested changes to the announcement `change`, and schedules the announcement
    /// of all requested changes. The message contains only the new changes; an agent that missed it
    /// receives all requested changes soon afterwards.
    fn add_changes(&mut self, change: &mut EpochChange, ctx: &mut Context<Self>) {
        let now = self.domain_sync.timestamp();
        let Some(since) = self.domain_sync.maintainer.requested_since(now) else {
            return self.add_all_requests(AnnouncementScope::Full, change, ctx);
        };
        if since == RequestedSince::default() {
            return;
        }
        self.has_announced |= !since.facts.is_empty() || !since.retracted.is_empty();
        let had_requests = self.has_requests;
        self.has_requests |= self.domain_sync.maintainer.has_requests(now);
        change.requested_since = Some(since);
        if (had_requests || self.has_requests) && !self.journal_client.journals().is_empty() {
            let requested = self.domain_sync.maintainer.requested(now);
            self.replicate_requests(requested, ctx);
        }
        if self.full_announcement_timer.is_none() {
            self.full_announcement_timer =
                Some(ctx.after(FULL_ANNOUNCEMENT_DELAY, |maintainer: &mut Self, ctx| {
                    maintainer.announcement_scope =
                        maintainer.announcement_scope.max(AnnouncementScope::FullRepeat);
                    maintainer.announce_requests(ctx);
                }));
        }
    }

    fn add_all_requests(
        &mut self,
        tells: AnnouncementScope,
        change: &mut EpochChange,
        ctx: &mut Context<Self>,
    ) {
        if let Some(timer) = self.full_announcement_timer.take() {
            ctx.cancel_timer(timer);
        }
        let now = self.domain_sync.timestamp();
        // News are counted from here on.
        let since = self.domain_sync.maintainer.requested_since(now);
        let requested = self.domain_sync.maintainer.requested(now);
        let is_nothing = requested == Requested::default();
        // The end of the last requested change is announced once.
        let was_something = std::mem::replace(&mut self.has_announced, !is_nothing);
        let has_requests = self.domain_sync.maintainer.has_requests(now);
        let had_requests = std::mem::replace(&mut self.has_requests, has_requests);
        if is_nothing && !was_something {
            return;
        }
        change.requested = Some(requested.clone());
        // A repetition was recorded already, when it was new.
        let is_new = tells == AnnouncementScope::Full || since != Some(RequestedSince::default());
        if is_new && (had_requests || has_requests) {
            self.replicate_requests(requested, ctx);
        }
    }

    fn state(&self) -> BelievedState {
        let maintainer = &self.domain_sync.maintainer;
        let provenance = maintainer.provenance(self.domain_sync.timestamp());
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
                claims: fact.claims.iter().map(claim_content).collect(),
            }
        });
        let mut facts: Vec<BelievedFact> = known.collect();
        let mut derived =
            derived::derived_facts(&maintainer.snapshot(self.domain_sync.timestamp()));
        // The facts of an agent that has left are already known to be unknown.
        derived.retain(|derived| facts.iter().all(|known| known.fact != derived.fact));
        facts.extend(derived);
        BelievedState { epoch: maintainer.epoch(), revision: maintainer.revision(), facts }
    }
}

fn claim_content(claim: &capability::OwnerClaim) -> Claim {
    Claim {
        owner: claim.owner.to_string(),
        fact: claim.said.to_string(),
        source: claim.source.to_string(),
        age_ms: u64::try_from(claim.age.as_millis()).unwrap_or(u64::MAX),
        known_for: claim.left.map(Millis),
    }
}

/// Returns the longest remaining time of the claims of a fact; `None` if any of them has no limit.
fn known_for(claims: &[capability::OwnerClaim]) -> Option<Millis> {
    let left: Option<Vec<Duration>> = claims.iter().map(|claim| claim.left).collect();
    left?.into_iter().max().map(Millis)
}

fn merge_change(gathered: &mut EpochChange, change: EpochChange) {
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
