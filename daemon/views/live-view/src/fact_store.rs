//! The facts that the ecosystem knows, with the claims of their owners.
//!
//! A query for the state gives all facts. Between two queries heartbeats and announced changes
//! update them. A predicate and a function with the same name and arguments share one entry.

mod ground_fact;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};

use acl::Millis;
use acl::content::{BelievedFact, BelievedState, EpochChange, Heartbeat};

pub(crate) use self::ground_fact::GroundFact;
use self::ground_fact::Saying;
use crate::moment::{Moment, ViewLimits};
use crate::rows::{ClaimRow, FactRow, Freshness};
use crate::text::cut;

/// Owner of facts of the map.
const MAP: &str = "the map";

/// Source of the claims that a heartbeat makes.
const HEARTBEAT: &str = "heartbeat";

/// Source of the claims that the Domain Maintainer announces.
const ANNOUNCED: &str = "announced";

/// Maximum number of claims about one fact that are kept.
const CLAIMS_MAX: usize = 16;

/// The claim of one owner about a fact.
#[derive(Clone, Debug)]
struct ClaimRecord {
    saying: Saying,
    source: Cow<'static, str>,
    at: Moment,
}

/// A fact, with the claims about it.
#[derive(Clone, Debug)]
pub(crate) struct FactRecord {
    pub(crate) fact: GroundFact,
    at: Moment,
    /// Moment at which the fact became what it is; `None` if that was before it was observed.
    changed_at: Option<Moment>,
    /// The moment at which the fact expires, and the time for which it was known then.
    expires: Option<(Moment, u64)>,
    /// The claims by their owners, sorted: mostly one.
    claims: Vec<(String, ClaimRecord)>,
    /// The revision of the facts at which this one was reported or changed last.
    revision: u64,
}

impl FactRecord {
    fn claim(&mut self, owner: &str, claim: ClaimRecord) {
        match self.claims.binary_search_by(|(other, _)| other.as_str().cmp(owner)) {
            Ok(index) => self.claims[index].1 = claim,
            Err(index) if self.claims.len() < CLAIMS_MAX => {
                self.claims.insert(index, (owner.to_owned(), claim));
            }
            Err(_) => (),
        }
    }

    fn owners(&self) -> impl Iterator<Item = &str> {
        self.claims.iter().map(|(owner, _)| owner.as_str())
    }

    /// Returns the bytes of the record, roughly: the fact with its key, the same in the report of
    /// each owner, and what a record takes without any text.
    fn bytes(&self) -> usize {
        const WITHOUT_TEXT: usize = 300;
        let texts = self.fact.arguments.iter().map(String::len).sum::<usize>();
        let fact = WITHOUT_TEXT + 2 * (texts + self.fact.predicate.len());
        let owners = self.owners().map(str::len).sum::<usize>();
        fact * (1 + self.claims.len()) + owners
    }
}

/// The state of an owner that sends heartbeats.
#[derive(Clone, Copy, Debug)]
struct OwnerState {
    heard_at: Moment,
    is_away: bool,
}

/// What one agent has said in its last heartbeat.
#[derive(Clone, Debug, Default)]
struct OwnerReport {
    /// Hash of the text of the facts.
    hash: u64,
    keys: BTreeSet<String>,
    heard_at: Moment,
    /// Whether the facts were changed by something else since, so that the next heartbeat has to be
    /// read even if its text is the same.
    is_dirty: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct FactStore {
    facts: BTreeMap<String, FactRecord>,
    reports: BTreeMap<String, OwnerReport>,
    /// Bytes of all facts, roughly, and their limit.
    bytes: usize,
    bytes_max: usize,
    facts_max: usize,
    owners_max: usize,
    text_bytes: usize,
    /// Whether a query for the state was answered. Until then the problems of requests tell facts
    /// of the map.
    has_state: bool,
    /// Number of changes so far. An unchanged heartbeat is none.
    revision: u64,
    /// The revision at which a fact was removed last.
    removed_at: u64,
}

impl FactStore {
    pub(crate) fn new(limits: &ViewLimits) -> FactStore {
        FactStore {
            facts: BTreeMap::new(),
            reports: BTreeMap::new(),
            bytes: 0,
            bytes_max: limits.facts_bytes,
            facts_max: limits.facts,
            owners_max: limits.agents,
            text_bytes: limits.text_bytes,
            has_state: false,
            revision: 0,
            removed_at: 0,
        }
    }

    /// Returns the number of changes so far.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    fn count_change(&mut self) -> u64 {
        self.revision += 1;
        self.revision
    }

    pub(crate) fn has_state(&self) -> bool {
        self.has_state
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, &FactRecord)> {
        self.facts.iter().map(|(key, record)| (key.as_str(), record))
    }

    pub(crate) fn len(&self) -> usize {
        self.facts.len()
    }

    // === events ===

    /// Replaces all facts by the answer to a query.
    pub(crate) fn replace(&mut self, at: Moment, state: &BelievedState) {
        self.has_state = true;
        self.removed_at = self.count_change();
        let former = std::mem::take(&mut self.facts);
        self.bytes = 0;
        for believed in state.facts.iter().take(self.facts_max) {
            let Some(fact) = self.parse(&believed.fact) else { continue };
            let mut record = record(at, fact, believed, self.text_bytes);
            if let Some(former) = former.get(&record.fact.key()) {
                let is_same = former.fact.saying() == record.fact.saying();
                record.changed_at = if is_same { former.changed_at } else { Some(record.at) };
            }
            let bytes = record.bytes();
            if self.bytes + bytes <= self.bytes_max
                && self.facts.insert(record.fact.key(), record).is_none()
            {
                self.bytes += bytes;
            }
        }
        // A heartbeat may have arrived after the Domain Maintainer has answered.
        self.reports.values_mut().for_each(|report| report.is_dirty = true);
    }

    /// Takes the announcement of a change.
    pub(crate) fn change(&mut self, at: Moment, change: &EpochChange) {
        for fact in GroundFact::parse_all(&change.retracted) {
            let key = fact.key();
            let is_it = self.facts.get(&key).is_some_and(|record| record.fact.truth == fact.truth);
            if is_it && let Some(record) = self.remove(&key) {
                for owner in record.owners() {
                    if let Some(report) = self.reports.get_mut(owner) {
                        report.is_dirty = true;
                    }
                }
            }
        }
        for fact in GroundFact::parse_all(&change.believed) {
            self.believe(at, fact, None, true);
        }
        let requested = change.requested.iter().flat_map(|requested| &requested.facts);
        let since = change.requested_since.iter().flat_map(|since| &since.facts);
        for requested in requested.chain(since) {
            let Some(fact) = self.parse(&requested.fact) else { continue };
            let key = fact.key();
            self.believe(at, fact, Some((requested.owner.as_str(), ANNOUNCED)), true);
            self.set_expiry(at, &key, requested.known_for);
        }
    }

    /// Takes a heartbeat. Costs little if its facts are the same as in the one before.
    pub(crate) fn heartbeat(&mut self, at: Moment, owner: &str, beat: &Heartbeat) {
        if !self.reports.contains_key(owner) && self.reports.len() >= self.owners_max {
            return;
        }
        let report = self.reports.entry(owner.to_owned()).or_default();
        report.heard_at = at;
        let hash = acl::fnv::Fnv64::default().with(beat.facts.as_bytes()).value();
        if report.is_dirty || report.hash != hash {
            report.hash = hash;
            self.read_heartbeat(at, owner, &beat.facts);
        }
        for (text, known_for) in &beat.known_for {
            if self.facts.contains_key(text) {
                self.set_expiry(at, text, Some(*known_for));
            } else if let Some(fact) = self.parse(text) {
                self.set_expiry(at, &fact.key(), Some(*known_for));
            }
        }
    }

    fn read_heartbeat(&mut self, at: Moment, owner: &str, text: &str) {
        let facts = GroundFact::parse_all(text);
        // What the first heartbeat says may have been so for long.
        let is_later = self.reports.get(owner).is_some_and(|report| !report.keys.is_empty());
        let mut keys = BTreeSet::new();
        for fact in facts.into_iter().take(self.facts_max) {
            let key = fact.key();
            self.believe(at, fact, Some((owner, HEARTBEAT)), is_later);
            if self.facts.contains_key(&key) {
                keys.insert(key);
            }
        }
        let Some(report) = self.reports.get_mut(owner) else { return };
        report.is_dirty = false;
        let former = std::mem::replace(&mut report.keys, keys.clone());
        for key in former.difference(&keys) {
            self.withdraw(owner, key);
        }
    }

    /// Takes facts that a problem states, unless an answer to a query is known. Facts that somebody
    /// claims are left as they are.
    pub(crate) fn learn(&mut self, at: Moment, facts: Vec<GroundFact>) {
        if self.has_state {
            return;
        }
        for fact in facts {
            if !self.facts.contains_key(&fact.key()) {
                self.believe(at, fact, None, false);
            }
        }
    }

    /// Takes a fact. `is_news` says whether a fact that was not known has become true just now.
    fn believe(
        &mut self,
        at: Moment,
        fact: GroundFact,
        claim: Option<(&str, &'static str)>,
        is_news: bool,
    ) {
        let key = fact.key();
        let known = self.facts.get(&key);
        let is_full = self.facts.len() >= self.facts_max || self.bytes >= self.bytes_max;
        if known.is_none() && (is_full || key.len() > self.text_bytes) {
            return;
        }
        self.bytes -= known.map_or(0, FactRecord::bytes);
        self.revision += 1;
        let is_changed = known.map_or(is_news, |known| known.fact.saying() != fact.saying());
        let record = self.facts.entry(key).or_insert_with(|| FactRecord {
            fact: fact.clone(),
            at,
            changed_at: None,
            expires: None,
            claims: Vec::new(),
            revision: 0,
        });
        (record.at, record.revision) = (at, self.revision);
        if is_changed {
            record.changed_at = Some(at);
        }
        if let Some((owner, source)) = claim {
            let (saying, source) = (fact.saying(), Cow::Borrowed(source));
            record.claim(owner, ClaimRecord { saying, source, at });
        }
        record.fact = fact;
        self.bytes += record.bytes();
    }

    fn remove(&mut self, key: &str) -> Option<FactRecord> {
        let record = self.facts.remove(key)?;
        self.bytes -= record.bytes();
        self.removed_at = self.count_change();
        Some(record)
    }

    /// Removes the claim of one owner. A fact without a claim is not known any more.
    fn withdraw(&mut self, owner: &str, key: &str) {
        let Some(mut record) = self.remove(key) else { return };
        record.claims.retain(|(other, _)| other != owner);
        if let Some((_, newest)) = record.claims.iter().max_by_key(|(_, claim)| claim.at) {
            let Saying { value, truth } = newest.saying;
            (record.fact.value, record.fact.truth) = (value, truth);
            record.revision = self.revision;
            self.bytes += record.bytes();
            self.facts.insert(key.to_owned(), record);
        }
    }

    fn set_expiry(&mut self, at: Moment, key: &str, known_for: Option<Millis>) {
        let Some(record) = self.facts.get_mut(key) else { return };
        let Some(known_for) = known_for.map(u64::from) else { return };
        let moment = at.plus(known_for);
        // A fact that is known for longer than before may be fresh again, if it ended soon; of one
        // that was fresh, each heartbeat says so again.
        let is_fresh = record.expires.is_some_and(|(end, whole)| end.since(at) >= whole / 4);
        if !is_fresh && record.expires.is_none_or(|(former, _)| moment > former) {
            self.revision += 1;
            record.revision = self.revision;
        }
        // Each heartbeat tells the remaining time; the first one tells the whole time.
        let whole = record.expires.map_or(known_for, |(_, whole)| whole.max(known_for));
        record.expires = Some((moment, whole));
    }

    fn parse(&self, text: &str) -> Option<GroundFact> {
        let is_short = text.len() <= self.text_bytes;
        GroundFact::parse_all(text).pop().filter(|_| is_short)
    }

    // === rows ===

    /// Returns all facts, sorted by their text. `is_away` says of an owner whether it is gone or
    /// silent.
    pub(crate) fn rows(&self, now: Moment, is_away: &impl Fn(&str) -> bool) -> Vec<FactRow> {
        let owners = self.owners(is_away);
        self.facts.iter().map(|fact| self.row(fact, now, (&owners, is_away))).collect()
    }

    /// Returns the facts that were reported or changed after this revision, sorted by their text;
    /// `None` if one was removed after it. With `true`, those are among them whose rows may have
    /// changed with time alone: they end soon, are stale or disputed.
    pub(crate) fn rows_since(
        &self,
        (revision, with_time): (u64, bool),
        now: Moment,
        is_away: &impl Fn(&str) -> bool,
    ) -> Option<Vec<FactRow>> {
        if revision < self.removed_at {
            return None;
        }
        let away = if with_time { self.owners(is_away) } else { HashMap::new() };
        let is_owner_away = |owner: &str| match away.get(owner) {
            Some(state) => state.is_away,
            None => is_away(owner),
        };
        let has_moved = |record: &FactRecord| {
            let saying = record.fact.saying();
            let is_disputed = record.claims.iter().any(|(_, claim)| claim.saying != saying);
            let freshness = || self.freshness(record, now, &is_owner_away);
            is_disputed || matches!(freshness(), Freshness::Ending | Freshness::Stale)
        };
        let is_wanted = |(_, record): &(&String, &FactRecord)| {
            record.revision > revision || (with_time && has_moved(record))
        };
        let changed: Vec<_> = self.facts.iter().filter(is_wanted).collect();
        let owners = changed.iter().flat_map(|(_, record)| record.owners());
        let owners: HashMap<&str, OwnerState> = owners
            .filter_map(|owner| Some((owner, self.reports.get(owner)?)))
            .map(|(owner, report)| {
                let (heard_at, is_away) = (report.heard_at, is_owner_away(owner));
                (owner, OwnerState { heard_at, is_away })
            })
            .collect();
        Some(changed.into_iter().map(|fact| self.row(fact, now, (&owners, is_away))).collect())
    }

    /// Returns the facts with a claim of `owner`, sorted by their text.
    pub(crate) fn rows_of(
        &self,
        owner: &str,
        now: Moment,
        is_away: &impl Fn(&str) -> bool,
    ) -> Vec<FactRow> {
        let owners = self.owners(is_away);
        let is_own =
            |(_, record): &(&String, &FactRecord)| record.owners().any(|other| other == owner);
        self.facts
            .iter()
            .filter(is_own)
            .map(|fact| self.row(fact, now, (&owners, is_away)))
            .collect()
    }

    /// Returns the state of all owners that send heartbeats: many facts ask for each.
    fn owners(&self, is_away: &impl Fn(&str) -> bool) -> HashMap<&str, OwnerState> {
        let state = |(owner, report): (&'_ String, &OwnerReport)| OwnerState {
            heard_at: report.heard_at,
            is_away: is_away(owner),
        };
        self.reports.iter().map(|entry| (entry.0.as_str(), state(entry))).collect()
    }

    fn row(
        &self,
        (key, record): (&String, &FactRecord),
        now: Moment,
        (owners, is_away): (&HashMap<&str, OwnerState>, &impl Fn(&str) -> bool),
    ) -> FactRow {
        let saying = record.fact.saying();
        // An unchanged heartbeat repeats its claims.
        let said_at = |owner: &String, claim: &ClaimRecord| {
            let state = owners.get(owner.as_str()).filter(|_| claim.source == HEARTBEAT);
            state.map_or(claim.at, |state| state.heard_at.max(claim.at))
        };
        let (mut contradictions, mut newest) = (Vec::new(), None);
        for (owner, claim) in &record.claims {
            let at = said_at(owner, claim);
            if claim.saying == saying {
                newest = newest.max(Some(at));
                continue;
            }
            contradictions.push(ClaimRow {
                owner: owner.clone(),
                fact: claim.saying.printed(key),
                source: claim.source.clone().into_owned(),
                age_ms: now.since(at),
            });
        }
        let is_away = |owner: &str| match owners.get(owner) {
            Some(state) => state.is_away,
            None => is_away(owner),
        };
        FactRow {
            fact: saying.printed(key),
            predicate: record.fact.predicate.clone(),
            arguments: record.fact.arguments.clone(),
            value: record.fact.value,
            truth: record.fact.truth,
            owners: record.owners().map(str::to_owned).collect(),
            age_ms: Some(now.since(newest.unwrap_or(record.at))),
            same_for_ms: record.changed_at.map(|changed| now.since(changed)),
            known_for_ms: record.expires.map(|(moment, _)| moment.since(now)),
            freshness: self.freshness(record, now, &is_away),
            contradictions,
        }
    }

    pub(crate) fn freshness(
        &self,
        record: &FactRecord,
        now: Moment,
        is_away: &impl Fn(&str) -> bool,
    ) -> Freshness {
        let mut owners = record.owners().filter(|owner| *owner != MAP).peekable();
        if owners.peek().is_some() && owners.all(is_away) {
            return Freshness::Stale;
        }
        match record.expires {
            None => Freshness::Lasting,
            Some((moment, _)) if moment <= now => Freshness::Stale,
            Some((moment, whole)) if moment.since(now) < whole / 4 => Freshness::Ending,
            Some(_) => Freshness::Fresh,
        }
    }
}

fn record(at: Moment, fact: GroundFact, believed: &BelievedFact, text_bytes: usize) -> FactRecord {
    let expires = believed.known_for.map(u64::from).map(|left| {
        // The whole time for which the fact is known is not told.
        (at.plus(left), left.saturating_add(believed.age_ms))
    });
    let said_at = at.minus(believed.age_ms);
    let mut record = FactRecord {
        fact,
        at: said_at,
        changed_at: None,
        expires,
        claims: Vec::new(),
        revision: 0,
    };
    let (key, saying) = (record.fact.key(), record.fact.saying());
    for owner in believed.owners.iter().take(CLAIMS_MAX) {
        let claim = ClaimRecord { saying, source: Cow::Borrowed(""), at: said_at };
        record.claim(&cut(owner, text_bytes), claim);
    }
    for claim in believed.claims.iter().take(CLAIMS_MAX) {
        let fact = GroundFact::parse_all(&claim.fact).pop().filter(|fact| fact.key() == key);
        let Some(saying) = fact.map(|fact| fact.saying()) else { continue };
        // The usual sources are not allocated: there may be ten thousand claims.
        let source = match claim.source.as_str() {
            HEARTBEAT => Cow::Borrowed(HEARTBEAT),
            source => Cow::Owned(cut(source, text_bytes)),
        };
        let at = at.minus(claim.age_ms);
        record.claim(&cut(&claim.owner, text_bytes), ClaimRecord { saying, source, at });
    }
    record
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::rows::FactTruth;

    fn beat(facts: &str, known_for: &[(&str, u64)]) -> Heartbeat {
        let known_for: BTreeMap<_, _> = known_for.iter().copied().collect();
        let beat = json!({
            "digest": "", "sequence": 1, "facts": facts, "known_for": known_for, "period": 1000,
        });
        serde_json::from_value(beat).expect("a heartbeat")
    }

    fn texts(store: &FactStore) -> Vec<String> {
        store.rows(Moment(0), &|_| false).into_iter().map(|row| row.fact).collect()
    }

    fn store() -> FactStore {
        FactStore::new(&ViewLimits { text_bytes: 100, ..ViewLimits::default() })
    }

    #[test]
    fn a_heartbeat_replaces_the_facts_of_its_agent() {
        let mut store = store();
        store.heartbeat(Moment(0), "r1", &beat("(at r1 hall) (= (charge r1) 5)", &[]));
        store.heartbeat(Moment(0), "r2", &beat("(at r2 hall)", &[]));
        store.heartbeat(Moment(500), "r1", &beat("(at r1 office) (= (charge r1) 4)", &[]));
        assert_eq!(texts(&store), ["(at r1 office)", "(at r2 hall)", "(= (charge r1) 4)"]);
        store.heartbeat(Moment(2_000), "r1", &beat("(at r1 office) (= (charge r1) 4)", &[]));
        let rows = store.rows(Moment(2_100), &|owner| owner == "r2");
        assert_eq!(rows[0].age_ms, Some(100), "an unchanged heartbeat makes facts younger");
        let fresh: Vec<_> = rows.iter().map(|row| row.freshness).collect();
        assert_eq!(fresh, [Freshness::Lasting, Freshness::Stale, Freshness::Lasting]);
        assert_eq!(store.rows_of("r1", Moment(0), &|_| false).len(), 2);
    }

    #[test]
    fn unknown_is_not_false() {
        let mut store = store();
        store.heartbeat(Moment(0), "m", &beat("(unknown (motion hall))", &[]));
        let row = store.rows(Moment(0), &|_| false).remove(0);
        assert_eq!((row.fact.as_str(), row.truth), ("(unknown (motion hall))", FactTruth::Unknown));
        store.heartbeat(Moment(0), "m", &beat("(motion hall)", &[]));
        assert_eq!(texts(&store), ["(motion hall)"]);
    }

    #[test]
    fn a_fact_expires() {
        let mut store = store();
        let known = [("(known-temperature hall)", 1_000)];
        store.heartbeat(Moment(0), "t", &beat("(known-temperature hall)", &known));
        let at = |now| store.rows(Moment(now), &|_| false)[0].clone();
        assert_eq!((at(0).freshness, at(0).known_for_ms), (Freshness::Fresh, Some(1_000)));
        assert_eq!((at(800).freshness, at(800).known_for_ms), (Freshness::Ending, Some(200)));
        assert_eq!((at(1_000).freshness, at(1_000).known_for_ms), (Freshness::Stale, Some(0)));
    }

    #[test]
    fn announced_changes_update_the_facts() {
        let mut store = store();
        store.heartbeat(Moment(0), "r1", &beat("(at r1 hall)", &[]));
        let change = EpochChange {
            believed: "(lit hall)".to_owned(),
            retracted: "(at r1 hall)".to_owned(),
            ..EpochChange::default()
        };
        store.change(Moment(1), &change);
        assert_eq!(texts(&store), ["(lit hall)"]);
        // The next heartbeat is read although it is the same as before.
        store.heartbeat(Moment(2), "r1", &beat("(at r1 hall)", &[]));
        assert_eq!(texts(&store), ["(at r1 hall)", "(lit hall)"]);
    }

    #[test]
    fn the_state_replaces_all_facts_and_tells_contradictions() {
        let mut store = store();
        store.learn(Moment(0), GroundFact::parse_all("(connected a b)"));
        assert_eq!(texts(&store), ["(connected a b)"]);
        let state = json!({ "epoch": 1, "revision": 2, "facts": [{
            "fact": "(= (temperature hall) 21)", "owners": ["t1"], "age_ms": 300,
            "known_for": 700, "claims": [
                { "owner": "t1", "fact": "(= (temperature hall) 21)", "source": "heartbeat", "age_ms": 300 },
                { "owner": "t2", "fact": "(= (temperature hall) 35)", "source": "heartbeat", "age_ms": 900 },
            ],
        }, { "fact": ")(", "owners": [], "age_ms": 0 }] });
        store.replace(Moment(1_000), &serde_json::from_value(state).expect("a state"));
        store.learn(Moment(1_000), GroundFact::parse_all("(connected a b)"));
        let rows = store.rows(Moment(1_000), &|_| false);
        assert_eq!(rows.len(), 1);
        assert_eq!((rows[0].age_ms, rows[0].value), (Some(300), Some(21.0)));
        assert_eq!(rows[0].freshness, Freshness::Fresh);
        assert_eq!(rows[0].contradictions.len(), 1);
        assert_eq!(rows[0].contradictions[0].owner, "t2");
    }

    #[test]
    fn the_number_of_facts_is_limited() {
        let mut store =
            FactStore::new(&ViewLimits { facts: 3, agents: 2, ..ViewLimits::default() });
        for owner in ["a", "b", "c"] {
            let facts = format!("(p {owner} x) (p {owner} y)");
            store.heartbeat(Moment(0), owner, &beat(&facts, &[]));
        }
        assert_eq!(texts(&store), ["(p a x)", "(p a y)", "(p b x)"]);
        assert_ne!(store.bytes, 0);
        for owner in ["a", "b"] {
            store.heartbeat(Moment(0), owner, &beat("", &[]));
        }
        assert_eq!((store.bytes, store.len()), (0, 0));
        let mut store = FactStore::new(&ViewLimits { facts_bytes: 1_000, ..ViewLimits::default() });
        store.heartbeat(Moment(0), "a", &beat("(p a) (p b) (p c)", &[]));
        assert_eq!(store.len(), 2, "the last one may pass the limit");
    }
}
