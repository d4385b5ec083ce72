//! Beliefs of a Domain Maintainer: all claims about facts, each with its owner, time and expiry,
//! and the facts that hold because of these claims.
//!
//! A fact of a predicate holds if at least one owner claims it. A fact is unknown if no owner
//! claims it and at least one owner reports it as unknown. The value of a function is that of the
//! newest claim about it.
//!
//! If the heartbeats of two agents contradict each other, the value must not alternate with every
//! heartbeat. Among claims by heartbeats, the claim with the latest change of value therefore
//! counts as newest, and repetitions do not count. A claim that does not fit the composite domain
//! is kept, and takes effect as soon as it fits.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use acl::Incarnation;
use pddl::{InitElement, Name};

use crate::composite::Composite;
use crate::declined::Declined;
use crate::fact::{ClaimSource, FactKey, FactSymbolKind, FactValue, Owner};
use crate::limits;
use crate::pending_changes::{PendingChanges, UNTOLD_MAX};
use crate::timestamp::Timestamp;

/// The claim of one owner about one fact.
#[derive(Clone, Debug)]
pub(crate) struct FactClaim {
    pub(crate) value: FactValue,
    pub(crate) source: ClaimSource,
    pub(crate) incarnation: Incarnation,
    pub(crate) sequence: u64,
    /// Time at which the owner last made or repeated the claim.
    pub(crate) said: Timestamp,
    /// Time at which the claim expires; `None` if it does not expire.
    pub(crate) until: Option<Timestamp>,
}

/// Believed value of a fact, and the latest time at which it expires; `until` is `None` if the
/// value does not expire.
#[derive(Clone, Copy, Debug)]
struct BelievedValue {
    value: FactValue,
    until: Option<Timestamp>,
}

/// A claim with a stamp: its position in the order in which all claims were made.
#[derive(Clone, Debug)]
struct StampedClaim {
    stamp: u64,
    /// Stamp of the owner's first claim with the present value. Later claims only repeated the
    /// value.
    since: u64,
    claim: FactClaim,
}

impl StampedClaim {
    fn is_heartbeat(&self) -> bool {
        self.claim.source == ClaimSource::Heartbeat
    }
}

/// All claims about one fact, sorted by owner. Each entry is the owner and its claim. A list is
/// used because most facts have one owner only.
#[derive(Clone, Debug)]
struct ClaimsByOwner(Vec<(Owner, StampedClaim)>);

/// All claims of all owners, and the facts that hold because of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Beliefs {
    claims: BTreeMap<FactKey, ClaimsByOwner>,
    by_owner: BTreeMap<Owner, BTreeSet<FactKey>>,
    /// Owners with no other claims than those of their last heartbeat, all of which are still in
    /// force. For such an owner, a heartbeat that equals the last one changes nothing and need not
    /// be parsed.
    unchanged: BTreeSet<Owner>,
    deadlines: BTreeSet<(Timestamp, FactKey, Owner)>,
    holding: BTreeMap<FactKey, BelievedValue>,
    /// Facts with a value in `holding` that may be out of date.
    touched: BTreeSet<FactKey>,
    /// Whether [`Beliefs::recompute`] keeps the values in `holding` up to date. If `false`, each
    /// query computes the values from the claims.
    settles: bool,
    /// Whether a fact may have begun or ceased to hold since the last call of
    /// [`Beliefs::take_moved`].
    is_moved: bool,
    /// Claims that came by request, from another maintainer, or from an action. Each entry is the
    /// fact and the owner of the claim. A claim ends when an agent that is responsible for the fact
    /// contradicts it.
    requested: BTreeSet<(FactKey, Owner)>,
    /// Predicates that have or had an unknown fact. A predicate stays in the set after the fact has
    /// become known, so that the domain does not change each time.
    unknowable: BTreeSet<Name>,
    /// Whether a predicate was added to `unknowable` since the last call of
    /// [`Beliefs::take_newly_unknowable`].
    is_newly_unknowable: bool,
    pending_changes: PendingChanges,
    /// Claims that requests have changed since the possible start of a partition, in which another
    /// leader may be active. `None` if no partition is possible now.
    partition_log: Option<PendingChanges>,
    /// Facts about which all claims were withdrawn by request since then, even if there was no claim:
    /// a record that is read later may have some. At most `UNTOLD_MAX` facts are kept.
    retracted_apart: BTreeSet<FactKey>,
    stamps: u64,
}

// === impl ClaimSource ===

impl ClaimSource {
    /// Whether this maintainer must send a claim from this source to other maintainers, because
    /// they cannot receive the claim in any other way.
    pub(crate) fn is_requested(self) -> bool {
        match self {
            ClaimSource::Request
            | ClaimSource::Observation
            | ClaimSource::Effect
            | ClaimSource::Departure => true,
            ClaimSource::Model | ClaimSource::Heartbeat | ClaimSource::Announced => false,
        }
    }
}

impl ClaimSource {
    /// Whether the source is neither a model nor a heartbeat. A claim from such a source ends when
    /// an agent that is responsible for the fact contradicts the claim.
    fn is_another(self) -> bool {
        self.is_requested() || self == ClaimSource::Announced
    }
}

impl fmt::Display for ClaimSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            ClaimSource::Model => "model",
            ClaimSource::Heartbeat => "heartbeat",
            ClaimSource::Effect => "effect",
            ClaimSource::Request => "request",
            ClaimSource::Observation => "observation",
            ClaimSource::Departure => "departure",
            ClaimSource::Announced => "announced",
        })
    }
}

// === impl FactClaim ===

impl FactClaim {
    /// Creates a claim that does not expire and belongs to no incarnation.
    pub(crate) fn new(value: FactValue, source: ClaimSource, said: Timestamp) -> FactClaim {
        let incarnation = Incarnation::default();
        FactClaim { value, source, incarnation, sequence: 0, said, until: None }
    }

    pub(crate) fn until(self, until: Option<Timestamp>) -> FactClaim {
        FactClaim { until, ..self }
    }
}

// === impl ClaimsByOwner ===

impl ClaimsByOwner {
    fn place(&self, owner: &Owner) -> Result<usize, usize> {
        self.0.binary_search_by(|(other, _)| other.cmp(owner))
    }

    fn get(&self, owner: &Owner) -> Option<&StampedClaim> {
        self.place(owner).ok().map(|at| &self.0[at].1)
    }

    fn get_mut(&mut self, owner: &Owner) -> Option<&mut StampedClaim> {
        self.place(owner).ok().map(|at| &mut self.0[at].1)
    }

    fn insert(&mut self, owner: Owner, stamped: StampedClaim) {
        match self.place(&owner) {
            Ok(at) => self.0[at].1 = stamped,
            Err(at) => {
                self.0.reserve_exact(1);
                self.0.insert(at, (owner, stamped));
            }
        }
    }

    fn remove(&mut self, owner: &Owner) -> Option<StampedClaim> {
        self.place(owner).ok().map(|at| self.0.remove(at).1)
    }

    fn iter(&self) -> impl Iterator<Item = (&Owner, &StampedClaim)> {
        self.0.iter().map(|(owner, stamped)| (owner, stamped))
    }

    /// Returns the value that these claims give `fact` at `now`; `None` if no claim is visible,
    /// fits the composite domain and has not expired.
    fn judge(
        &self,
        fact: &FactKey,
        composite: &Composite,
        now: Timestamp,
    ) -> Option<BelievedValue> {
        let fits = |value: FactValue| composite.misfit(fact, value).is_none();
        let known = { self.iter() }
            .filter(|(owner, _)| composite.secrets.sees(owner, fact))
            .map(|(_, stamped)| stamped)
            .filter(|stamped| stamped.claim.until.is_none_or(|until| until > now));
        let holding = match fact.space() {
            // True has precedence over unknown. A claim without an expiry counts as the longest.
            FactSymbolKind::Predicate => known
                .map(|StampedClaim { claim, .. }| BelievedValue {
                    value: claim.value,
                    until: claim.until,
                })
                .max_by_key(|BelievedValue { value, until }| {
                    (*value == FactValue::True, until.unwrap_or(Timestamp(u64::MAX)))
                }),
            // A claim that does not fit must not hide a claim that does.
            FactSymbolKind::Function => newest(known.filter(|it| fits(it.claim.value))).map(
                |StampedClaim { claim, .. }| BelievedValue {
                    value: claim.value,
                    until: claim.until,
                },
            ),
        };
        holding.filter(|holding| fits(holding.value))
    }
}

// === impl Beliefs ===

impl Beliefs {
    /// Creates a set of beliefs without claims. If `settles` is true, the caller must call
    /// [`Beliefs::recompute`] after each change.
    pub(crate) fn new(settles: bool) -> Beliefs {
        Beliefs { settles, ..Beliefs::default() }
    }

    /// Returns the predicates with facts that may be unknown.
    pub(crate) fn unknowable(&self) -> &BTreeSet<Name> {
        &self.unknowable
    }

    /// Whether predicates were added to those that may have unknown facts since the last call.
    pub(crate) fn take_newly_unknowable(&mut self) -> bool {
        std::mem::take(&mut self.is_newly_unknowable)
    }

    /// Records that the predicate of `fact` may have unknown facts. If there are too many such
    /// predicates, those without an unknown fact at present are dropped first.
    fn note_unknown(&mut self, fact: &FactKey) {
        if self.unknowable.contains(fact.symbol()) {
            return;
        }
        if self.unknowable.len() >= limits::UNKNOWABLE_MAX {
            let claims = self.claims.iter();
            let unknown = claims.filter(|(_, owners)| {
                owners.iter().any(|(_, stamped)| stamped.claim.value == FactValue::Unknown)
            });
            self.unknowable = unknown.map(|(fact, _)| fact.symbol().clone()).collect();
        }
        self.unknowable.insert(fact.symbol().clone());
        self.is_newly_unknowable = true;
    }

    /// Returns the facts of one symbol about which a claim came by request, from another
    /// maintainer, or from an action. Each entry is the fact and the owner of the claim.
    pub(crate) fn requested_of(
        &self,
        space: FactSymbolKind,
        symbol: &Name,
    ) -> impl Iterator<Item = (&FactKey, &Owner)> {
        let first = (FactKey::first_of(space, symbol), Owner::Map);
        let symbol = symbol.clone();
        { self.requested.range(first..) }
            .take_while(move |(fact, _)| fact.is_of(space, &symbol))
            .map(|(fact, owner)| (fact, owner))
    }

    /// Returns the facts about which a claim came by request, from another maintainer, or from an
    /// action. Each entry is the fact and the owner of the claim.
    pub(crate) fn all_requested(&self) -> impl Iterator<Item = &(FactKey, Owner)> {
        self.requested.iter()
    }

    /// Ensures that the next heartbeat of `owner` is parsed, even if it equals the last one.
    pub(crate) fn wake(&mut self, owner: &Owner) {
        self.unchanged.remove(owner);
    }

    fn mark_dirty(&mut self, fact: FactKey) {
        self.is_moved = true;
        if self.settles {
            self.touched.insert(fact);
        }
    }

    fn note_change(&mut self, fact: &FactKey, owner: &Owner, source: ClaimSource) {
        self.pending_changes.record(fact, owner, source);
        if let Some(apart) = &mut self.partition_log {
            apart.record(fact, owner, source);
        }
    }

    /// Starts to record the claims that requests change, unless the recording has started already.
    pub(crate) fn begin_partition_log(&mut self) {
        self.partition_log.get_or_insert_with(PendingChanges::nothing);
    }

    /// Stops the recording. Returns the claims that requests have changed since
    /// [`Beliefs::begin_partition_log`]; `None` if there was no recording.
    pub(crate) fn take_partition_log(&mut self) -> Option<PendingChanges> {
        self.retracted_apart.clear();
        self.partition_log.take()
    }

    /// Returns the claims that requests have changed since [`Beliefs::begin_partition_log`] and that
    /// still exist, in the order in which they were made. Each entry is the fact, the owner and the
    /// claim. If too many have changed, returns all claims that came by request.
    pub(crate) fn claims_made_apart(&self) -> Vec<(FactKey, Owner, FactClaim)> {
        let Some(apart) = &self.partition_log else { return Vec::new() };
        let changed = self.requested.iter().filter(|(fact, owner)| apart.has(fact, owner));
        let mut made: Vec<_> = changed
            .filter_map(|(fact, owner)| {
                let (stamp, claim) = self.stamped_claim_of(fact, owner)?;
                claim.source.is_requested().then_some((stamp, fact, owner, claim))
            })
            .collect();
        made.sort_by_key(|(stamp, ..)| *stamp);
        let claims = made.into_iter();
        claims.map(|(_, fact, owner, claim)| (fact.clone(), owner.clone(), claim.clone())).collect()
    }

    /// Whether a request has withdrawn what `owner` may claim about `fact`, since
    /// [`Beliefs::begin_partition_log`] was called.
    pub(crate) fn is_withdrawn_apart(&self, fact: &FactKey, owner: &Owner) -> bool {
        let is_listed = match &self.partition_log {
            Some(apart @ PendingChanges::These(_)) => apart.has(fact, owner),
            // Too many claims have changed to tell those that were withdrawn.
            Some(PendingChanges::All) | None => false,
        };
        self.retracted_apart.contains(fact) || (is_listed && self.claim_of(fact, owner).is_none())
    }

    /// Whether requests may have changed the claim of `owner` about `fact` since
    /// [`Beliefs::begin_partition_log`] was called.
    pub(crate) fn has_changed_apart(&self, fact: &FactKey, owner: &Owner) -> bool {
        self.partition_log.as_ref().is_some_and(|apart| apart.has(fact, owner))
    }

    /// Returns the claims that may have changed since the last call, so that they can be sent to
    /// other maintainers.
    pub(crate) fn take_untold(&mut self) -> PendingChanges {
        self.pending_changes.take()
    }

    /// Whether a fact may have begun or ceased to hold since the last call. Always `false` if
    /// [`Beliefs::recompute`] keeps the values up to date.
    pub(crate) fn take_moved(&mut self) -> bool {
        std::mem::take(&mut self.is_moved) && !self.settles
    }

    /// Checks that `owner` may claim `more` additional facts.
    ///
    /// Returns an error if the owner would exceed its limit, or if there are too many owners.
    pub(crate) fn has_room(&self, owner: &Owner, more: usize) -> Result<(), Declined> {
        let claimed = self.by_owner.get(owner);
        let limit = match owner {
            Owner::Map => limits::MAP_FACTS_MAX,
            Owner::Agent(_) => limits::FACTS_PER_OWNER_MAX,
        };
        if claimed.map_or(0, BTreeSet::len) + more > limit {
            return Err(Declined::TooMany { what: "facts of one owner", limit });
        }
        if claimed.is_none() && self.by_owner.len() >= limits::OWNERS_MAX {
            let limit = limits::OWNERS_MAX;
            return Err(Declined::TooMany { what: "owners of facts", limit });
        }
        Ok(())
    }

    /// Records that the claims of `owner` are exactly those of its last heartbeat.
    pub(crate) fn mark_unchanged(&mut self, owner: Owner) {
        self.unchanged.insert(owner);
    }

    /// Whether a heartbeat of `owner` that equals its last one would change nothing.
    pub(crate) fn is_calm(&self, owner: &Owner) -> bool {
        self.unchanged.contains(owner)
    }

    /// Prepares for a new or withdrawn claim of `owner` about `fact`: marks the owners with a next
    /// heartbeat that must be parsed, even if it equals the last one. The first is `owner`, unless
    /// its own heartbeat makes the change. The others are all owners that claim the fact, because a
    /// repetition would make their claim the newest.
    fn invalidate(&mut self, fact: &FactKey, owner: &Owner, source: Option<ClaimSource>) {
        if source != Some(ClaimSource::Heartbeat) {
            self.unchanged.remove(owner);
        }
        if let Some(owners) = self.claims.get(fact) {
            for (other, _) in owners.iter().filter(|(other, _)| *other != owner) {
                self.unchanged.remove(other);
            }
        }
    }

    /// Stores a claim of `owner` about `fact`, in place of its former claim about this fact.
    pub(crate) fn claim(&mut self, fact: FactKey, owner: &Owner, claim: FactClaim) {
        self.invalidate(&fact, owner, Some(claim.source));
        self.note_change(&fact, owner, claim.source);
        if claim.value == FactValue::Unknown {
            self.note_unknown(&fact);
        }
        self.stamps += 1;
        let stamp = self.stamps;
        let mut since = stamp;
        if let Some(owners) = self.claims.get_mut(&fact) {
            let is_contested = owners.0.len() > 1;
            if let Some(known) = owners.get_mut(owner) {
                let is_repeated = known.claim.value == claim.value;
                if is_repeated {
                    since = known.since;
                }
                // Fast path: most facts of a heartbeat equal those of the one before.
                if known.claim.until == claim.until {
                    let (before, after) = (known.claim.source, claim.source);
                    *known = StampedClaim { stamp, since, claim };
                    self.note_change(&fact, owner, before);
                    if before.is_another() != after.is_another() {
                        self.list(&fact, owner, after);
                    }
                    if is_contested || !is_repeated {
                        self.mark_dirty(fact);
                    }
                    return;
                }
            }
        }
        self.withdraw(&fact, owner);
        if claim.source.is_another() {
            self.list(&fact, owner, claim.source);
        }
        if let Some(until) = claim.until {
            self.deadlines.insert((until, fact.clone(), owner.clone()));
        }
        self.by_owner.entry(owner.clone()).or_default().insert(fact.clone());
        let stamped = StampedClaim { stamp, since, claim };
        match self.claims.get_mut(&fact) {
            Some(owners) => owners.insert(owner.clone(), stamped),
            None => {
                self.claims.insert(fact.clone(), ClaimsByOwner(vec![(owner.clone(), stamped)]));
            }
        }
        self.mark_dirty(fact);
    }

    /// Adds the claim of `owner` about `fact` to `requested`, or removes it, as `source` requires.
    fn list(&mut self, fact: &FactKey, owner: &Owner, source: ClaimSource) {
        let of = (fact.clone(), owner.clone());
        match source.is_another() {
            true => self.requested.insert(of),
            false => self.requested.remove(&of),
        };
    }

    /// Removes the claim of `owner` about `fact`.
    pub(crate) fn withdraw(&mut self, fact: &FactKey, owner: &Owner) {
        let Some(owners) = self.claims.get_mut(fact) else { return };
        let Some(StampedClaim { claim, .. }) = owners.remove(owner) else { return };
        self.unchanged.remove(owner);
        if owners.0.is_empty() {
            self.claims.remove(fact);
        }
        if claim.source.is_another() {
            self.requested.remove(&(fact.clone(), owner.clone()));
        }
        self.note_change(fact, owner, claim.source);
        if let Some(until) = claim.until {
            self.deadlines.remove(&(until, fact.clone(), owner.clone()));
        }
        if let Some(facts) = self.by_owner.get_mut(owner) {
            facts.remove(fact);
            if facts.is_empty() {
                self.by_owner.remove(owner);
            }
        }
        self.mark_dirty(fact.clone());
    }

    /// Removes all claims about `fact`, whatever their owners.
    pub(crate) fn withdraw_all(&mut self, fact: &FactKey) {
        if self.partition_log.is_some() && self.retracted_apart.len() < UNTOLD_MAX {
            self.retracted_apart.insert(fact.clone());
        }
        let owners: Vec<Owner> = { self.claims.get(fact).into_iter() }
            .flat_map(ClaimsByOwner::iter)
            .map(|(owner, _)| owner.clone())
            .collect();
        for owner in owners {
            self.withdraw(fact, &owner);
        }
    }

    /// Removes the claims of `owner` for which `is_over` returns `true`.
    pub(crate) fn withdraw_where(
        &mut self,
        owner: &Owner,
        is_over: impl Fn(&FactKey, &FactClaim) -> bool,
    ) {
        self.unchanged.remove(owner);
        let is_over =
            |fact: &FactKey| self.claim_of(fact, owner).is_some_and(|claim| is_over(fact, claim));
        let over: Vec<FactKey> =
            self.facts_of(owner).filter(|fact| is_over(fact)).cloned().collect();
        for fact in over {
            self.withdraw(&fact, owner);
        }
    }

    /// Removes the claims of `owner` about facts for which `is_over` returns `true`. This is faster
    /// than [`Beliefs::withdraw_where`], because it reads no claims. It runs each second for a
    /// thousand agents, to remove facts that a heartbeat no longer contains.
    pub(crate) fn withdraw_facts(&mut self, owner: &Owner, is_over: impl Fn(&FactKey) -> bool) {
        let over: Vec<FactKey> =
            self.facts_of(owner).filter(|fact| is_over(fact)).cloned().collect();
        for fact in over {
            self.withdraw(&fact, owner);
        }
    }

    /// Removes all claims that the central maintainer sent, except those in `stays`, which must be
    /// sorted.
    pub(crate) fn withdraw_announced(&mut self, stays: &[(FactKey, Owner)]) {
        // A merge join: both sequences are long and nearly equal.
        let mut stays = stays.iter().peekable();
        let mut over = Vec::new();
        for (fact, owners) in &self.claims {
            let told =
                owners.iter().filter(|(_, stamped)| stamped.claim.source == ClaimSource::Announced);
            for (owner, _) in told {
                let is_before = |(other, by): &&(FactKey, Owner)| (other, by) < (fact, owner);
                while stays.next_if(is_before).is_some() {}
                if stays.peek().is_none_or(|(other, by)| (other, by) != (fact, owner)) {
                    over.push((fact.clone(), owner.clone()));
                }
            }
        }
        for (fact, owner) in over {
            self.withdraw(&fact, &owner);
        }
    }

    /// Turns all claims that the central maintainer sent into claims that came to this maintainer
    /// by request.
    pub(crate) fn adopt_announced(&mut self) {
        for owners in self.claims.values_mut() {
            for claim in owners.0.iter_mut().map(|(_, stamped)| &mut stamped.claim) {
                if claim.source == ClaimSource::Announced {
                    claim.source = ClaimSource::Request;
                }
            }
        }
    }

    /// Turns all claims that came to this maintainer by request into claims that the leader sent. A
    /// claim that the leader's messages do not contain is later removed.
    pub(crate) fn demote_requests(&mut self) {
        for owners in self.claims.values_mut() {
            for claim in owners.0.iter_mut().map(|(_, stamped)| &mut stamped.claim) {
                if claim.source.is_requested() {
                    claim.source = ClaimSource::Announced;
                }
            }
        }
    }

    fn facts_of(&self, owner: &Owner) -> impl Iterator<Item = &FactKey> {
        self.by_owner.get(owner).into_iter().flatten()
    }

    pub(crate) fn claim_of(&self, fact: &FactKey, owner: &Owner) -> Option<&FactClaim> {
        self.stamped_claim_of(fact, owner).map(|(_, claim)| claim)
    }

    /// Returns the claim of `owner` about `fact`, after its stamp: the position of the claim in the
    /// order of all claims.
    pub(crate) fn stamped_claim_of(
        &self,
        fact: &FactKey,
        owner: &Owner,
    ) -> Option<(u64, &FactClaim)> {
        self.claims.get(fact)?.get(owner).map(|stamped| (stamped.stamp, &stamped.claim))
    }

    /// Removes all claims that have expired at `now`.
    pub(crate) fn expire(&mut self, now: Timestamp) {
        while let Some((until, fact, owner)) = self.deadlines.first().cloned() {
            if until > now {
                return;
            }
            self.withdraw(&fact, &owner);
        }
    }

    pub(crate) fn next_expiry(&self) -> Option<Timestamp> {
        self.deadlines.first().map(|(until, ..)| *until)
    }

    /// Marks the facts that must be evaluated again, because the composites `old` and `new` differ
    /// in something that these facts depend on.
    pub(crate) fn reconsider(&mut self, old: &Composite, new: &Composite) {
        let changed = CompositeDifference::between(old, new);
        let facts = self.claims.keys().filter(|fact| changed.touches(fact));
        self.touched.extend(facts.cloned());
    }

    /// Marks the facts that mention one of `objects`, which are new in the composite, so that they
    /// are evaluated again.
    pub(crate) fn reconsider_about(&mut self, objects: &BTreeSet<&Name>) {
        let speaks = |fact: &&FactKey| fact.arguments().iter().any(|name| objects.contains(name));
        self.touched.extend(self.claims.keys().filter(speaks).cloned());
    }

    /// Brings `holding` up to date. Returns two lists: the facts that have begun to hold or have a
    /// new value, and the facts that have ceased to hold.
    pub(crate) fn recompute(
        &mut self,
        composite: &Composite,
        now: Timestamp,
    ) -> (Vec<InitElement>, Vec<InitElement>) {
        let (mut believed, mut retracted) = (Vec::new(), Vec::new());
        for fact in std::mem::take(&mut self.touched) {
            let before = self.holding.get(&fact).map(|holding| holding.value);
            let after = self.judge(&fact, composite, now);
            match (before, after) {
                (Some(value), None) => retracted.push(fact.element(value)),
                (before, Some(after)) if before != Some(after.value) => {
                    believed.push(fact.element(after.value));
                }
                _ => (),
            }
            match after {
                Some(holding) => self.holding.insert(fact, holding),
                None => self.holding.remove(&fact),
            };
        }
        (believed, retracted)
    }

    fn judge(
        &self,
        fact: &FactKey,
        composite: &Composite,
        now: Timestamp,
    ) -> Option<BelievedValue> {
        self.claims.get(fact)?.judge(fact, composite, now)
    }

    /// Returns the facts that hold at `now`, in a fixed order. [`Beliefs::recompute`] must have
    /// been called.
    pub(crate) fn holding<'a>(
        &'a self,
        composite: &'a Composite,
        now: Timestamp,
    ) -> impl Iterator<Item = InitElement> + 'a {
        self.holding.iter().filter_map(move |(fact, holding)| {
            // When one claim has expired, another claim about the same fact may still be valid.
            let is_over = holding.until.is_some_and(|until| until <= now);
            let holding = if is_over { self.judge(fact, composite, now)? } else { *holding };
            Some(fact.element(holding.value))
        })
    }

    /// Returns the facts that hold at `now` in any composite. They are computed from the claims, in
    /// the same order as those of [`Beliefs::holding`].
    pub(crate) fn judged<'a>(
        &'a self,
        composite: &'a Composite,
        now: Timestamp,
    ) -> impl Iterator<Item = InitElement> + 'a {
        self.claims.iter().filter_map(move |(fact, owners)| {
            let holding = owners.judge(fact, composite, now)?;
            Some(fact.element(holding.value))
        })
    }

    /// Returns the believed value of a fact. The value is read from `holding` if that is kept up to
    /// date, and otherwise computed from the claims.
    pub(crate) fn value_of(
        &self,
        fact: &FactKey,
        composite: &Composite,
        now: Timestamp,
    ) -> Option<FactValue> {
        let holding = match self.settles {
            true => self.holding.get(fact).copied(),
            false => self.judge(fact, composite, now),
        };
        holding.map(|holding| holding.value)
    }

    /// Returns all claims of one owner. Each entry is the fact and the claim.
    pub(crate) fn claims_by(&self, owner: &Owner) -> impl Iterator<Item = (&FactKey, &FactClaim)> {
        self.facts_of(owner).filter_map(move |fact| Some((fact, self.claim_of(fact, owner)?)))
    }

    /// Returns all claims about one fact. Each entry is the owner and its claim.
    pub(crate) fn claims_of(&self, fact: &FactKey) -> impl Iterator<Item = (&Owner, &FactClaim)> {
        let owners = self.claims.get(fact).into_iter().flat_map(ClaimsByOwner::iter);
        owners.map(|(owner, stamped)| (owner, &stamped.claim))
    }

    /// Returns all facts with a claim. Each entry is the fact and its claims, each with the owner.
    pub(crate) fn claims(&self) -> impl Iterator<Item = (&FactKey, Vec<(&Owner, &FactClaim)>)> {
        self.claims.iter().map(|(fact, owners)| {
            (fact, owners.iter().map(|(owner, stamped)| (owner, &stamped.claim)).collect())
        })
    }
}

/// Returns the claim about a function that is believed; `None` if there are no claims. First, the
/// claim with the latest change of value is chosen among the claims by heartbeats. Of this claim
/// and all other claims, the newest is returned.
fn newest<'a>(known: impl Iterator<Item = &'a StampedClaim>) -> Option<&'a StampedClaim> {
    let (beats, others): (Vec<_>, Vec<_>) = known.partition(|stamped| stamped.is_heartbeat());
    let beat = beats.into_iter().max_by_key(|stamped| stamped.since);
    beat.into_iter().chain(others).max_by_key(|stamped| stamped.stamp)
}

/// The names that have a different meaning in two composites.
struct CompositeDifference<'a> {
    everything: bool,
    names: BTreeSet<&'a Name>,
}

// === impl CompositeDifference ===

impl<'a> CompositeDifference<'a> {
    fn between(old: &'a Composite, new: &'a Composite) -> CompositeDifference<'a> {
        let everything = old.domain.types != new.domain.types || old.secrets != new.secrets;
        let mut names = BTreeSet::new();
        let (before, after) = (&old.vocabulary, &new.vocabulary);
        differing(&before.objects, &after.objects, &mut names);
        differing(&before.predicates, &after.predicates, &mut names);
        differing(&before.functions, &after.functions, &mut names);
        CompositeDifference { everything, names }
    }

    fn touches(&self, fact: &FactKey) -> bool {
        self.everything
            || (!self.names.is_empty()
                && (self.names.contains(fact.symbol())
                    || fact.arguments().iter().any(|name| self.names.contains(name))))
    }
}

fn differing<'a, V: PartialEq>(
    one: &'a BTreeMap<Name, V>,
    two: &'a BTreeMap<Name, V>,
    names: &mut BTreeSet<&'a Name>,
) {
    // A merge join: both maps are long and nearly equal.
    let (mut one, mut two) = (one.iter().peekable(), two.iter().peekable());
    loop {
        let order = match (one.peek(), two.peek()) {
            (Some((left, _)), Some((right, _))) => left.cmp(right),
            (Some(_), None) => Ordering::Less,
            (None, Some(_)) => Ordering::Greater,
            (None, None) => return,
        };
        let left = if order.is_le() { one.next() } else { None };
        let right = if order.is_ge() { two.next() } else { None };
        if left.map(|(_, value)| value) != right.map(|(_, value)| value) {
            names.extend(left.or(right).map(|(name, _)| name));
        }
    }
}
