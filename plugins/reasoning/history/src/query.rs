//! Queries: which events answer a question about the history. Each query has a bound on its events,
//! on their bytes, and on the blocks that it reads; what is left over is on the next page.

use std::collections::BTreeSet;
use std::ops::ControlFlow;

use acl::content::{
    HISTORY_EVENTS_MAX, HISTORY_PAGE_BYTES_MAX, HistoryKind, HistoryQuery, ReadHistory,
};

use crate::event::RecordedEvent;
use crate::store::{EventReader, HistoryStore, HistoryStoreError, ScanFilter};
use crate::words::{
    WordHash, cause_hash, has_word, hash_of, is_same_text, kind_hash, subject_hash, words_of,
    worked_hash,
};

/// Maximum number of blocks that one query reads: about a second of work.
const BLOCKS_MAX: usize = 20_000;

/// Maximum number of blocks in which a better event is looked for, while there is one.
const PREFERRED_BLOCKS_MAX: usize = 100;

/// Maximum number of effects that are followed.
const EFFECTS_MAX: usize = 5_000;

/// Bytes of an event in a page, apart from its texts.
const EVENT_BYTES: usize = 220;

/// Number of the newest events among which similar words are looked for.
const NEAR_EVENTS: usize = 8_192;

/// Answer to a query, before it is decided who may read it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QueryAnswer {
    /// The events, each with whether the event that caused it is kept.
    pub events: Vec<(RecordedEvent, bool)>,
    /// Where the next page begins; `None` if there is none.
    pub next: Option<u64>,
    /// Time of the oldest event that is kept; `None` if there is none.
    pub oldest_ms: Option<u64>,
    /// Words like those of the query, if it found nothing.
    pub near: Vec<String>,
}

/// Collects the events of a page.
struct PageBuilder {
    events: Vec<RecordedEvent>,
    bytes: usize,
    limit: usize,
    is_full: bool,
}

// === impl PageBuilder ===

impl PageBuilder {
    fn new(limit: u32) -> PageBuilder {
        let limit = limit.clamp(1, HISTORY_EVENTS_MAX) as usize;
        PageBuilder { events: Vec::new(), bytes: 0, limit, is_full: false }
    }

    /// Adds an event. Breaks if the page has no room for it.
    fn add(&mut self, event: &RecordedEvent) -> ControlFlow<()> {
        // Each character of a text may be written as an escape sequence of six.
        let texts = [&event.subject, &event.agent, &event.conversation];
        let texts = texts.iter().map(|text| text.len()).sum::<usize>() + event.sentence().len();
        let bytes = EVENT_BYTES + texts * 2;
        if self.events.len() >= self.limit || self.bytes + bytes > HISTORY_PAGE_BYTES_MAX {
            self.is_full = true;
            return ControlFlow::Break(());
        }
        self.bytes += bytes;
        self.events.push(event.clone());
        ControlFlow::Continue(())
    }
}

/// Answers a query.
///
/// # Errors
///
/// Returns an error if the files cannot be read.
pub fn answer(store: &HistoryStore, read: &ReadHistory) -> Result<QueryAnswer, HistoryStoreError> {
    store.read(|reader| {
        let mut page = PageBuilder::new(read.limit);
        let next = match &read.query {
            HistoryQuery::Events { about, kinds, from_ms, to_ms } => {
                let about = about.as_deref().unwrap_or_default();
                let filter = filter(about, (*from_ms, *to_ms), read.before);
                let wanted = |event: &RecordedEvent| {
                    is_about(event, about) && (kinds.is_empty() || kinds.contains(&event.kind))
                };
                match kinds.as_slice() {
                    [kind] => list(reader, filter.and(kind_hash(*kind)), wanted, &mut page)?,
                    _ => list(reader, filter, wanted, &mut page)?,
                }
            }
            HistoryQuery::Last { about } => {
                last(reader, function_of(about), read.before, &mut page)?
            }
            HistoryQuery::Values { fact, from_ms, to_ms } => {
                let fact = function_of(fact);
                let filter = ScanFilter {
                    hashes: vec![subject_hash(fact)],
                    ..filter("", (*from_ms, *to_ms), read.before)
                };
                let wanted = |event: &RecordedEvent| {
                    event.kind == HistoryKind::Fact && is_same_text(&event.subject, fact)
                };
                list(reader, filter.and(kind_hash(HistoryKind::Fact)), wanted, &mut page)?
            }
            HistoryQuery::Why { subject } => why(reader, subject, read.before, &mut page)?,
            HistoryQuery::Effects { subject } => effects(reader, subject, read.before, &mut page)?,
        };
        let oldest = reader.oldest_number();
        let near = match (page.events.is_empty(), words(&read.query)) {
            (true, Some(words)) if read.before.is_none() => near(reader, words)?,
            _ => Vec::new(),
        };
        let is_kept = |event: &RecordedEvent| event.cause.is_some_and(|cause| cause >= oldest);
        let events = page.events.into_iter().map(|event| (is_kept(&event), event));
        let events = events.map(|(is_kept, event)| (event, is_kept)).collect();
        Ok(QueryAnswer { events, next, oldest_ms: reader.oldest_ms(), near })
    })
}

/// Returns the words that a query is about; `None` if it is about everything.
fn words(query: &HistoryQuery) -> Option<&str> {
    match query {
        HistoryQuery::Events { about, .. } => about.as_deref(),
        HistoryQuery::Why { subject } | HistoryQuery::Effects { subject } => Some(subject),
        HistoryQuery::Last { about } => Some(about),
        HistoryQuery::Values { fact, .. } => Some(fact),
    }
}

fn filter(
    about: &str,
    (from_ms, to_ms): (Option<u64>, Option<u64>),
    before: Option<u64>,
) -> ScanFilter {
    ScanFilter {
        hashes: hashes(about),
        from_ms: from_ms.unwrap_or(0),
        to_ms: to_ms.unwrap_or(u64::MAX),
        to: before.map_or(u64::MAX, |before| before.saturating_sub(1)),
        ..ScanFilter::default()
    }
}

fn hashes(about: &str) -> Vec<WordHash> {
    words_of(about).map(hash_of).collect()
}

fn is_about(event: &RecordedEvent, about: &str) -> bool {
    words_of(about).all(|word| has_word(event, word))
}

/// Returns the ground function in `(= (temperature office1) 21)`, and any other fact as it is.
fn function_of(fact: &str) -> &str {
    let inside = fact.trim().strip_prefix("(=").unwrap_or(fact);
    match (inside.find('('), inside.find(')')) {
        (Some(begin), Some(end)) if inside.len() < fact.trim().len() && begin < end => {
            &inside[begin..=end]
        }
        _ => fact,
    }
}

/// Adds the newest events in which something worked: those with this subject or, if there are none,
/// those that have its words.
fn last(
    reader: &mut EventReader<'_>,
    about: &str,
    before: Option<u64>,
    page: &mut PageBuilder,
) -> Result<Option<u64>, HistoryStoreError> {
    let filter = filter(about, (None, None), before).and(worked_hash());
    if words_of(about).nth(1).is_some() {
        let exact = filter.clone().and(subject_hash(about));
        let wanted = |event: &RecordedEvent| event.worked && is_same_text(&event.subject, about);
        let next = list(reader, exact, wanted, page)?;
        if next.is_some() || !page.events.is_empty() {
            return Ok(next);
        }
    }
    let wanted = |event: &RecordedEvent| event.worked && is_about(event, about);
    list(reader, filter, wanted, page)
}

/// Adds the wanted events to the page, newest first. Returns where the next page begins.
fn list(
    reader: &mut EventReader<'_>,
    filter: ScanFilter,
    wanted: impl Fn(&RecordedEvent) -> bool,
    page: &mut PageBuilder,
) -> Result<Option<u64>, HistoryStoreError> {
    let mut last_seen = None;
    let stopped = reader.scan(&filter, BLOCKS_MAX, |event| {
        if wanted(event) {
            page.add(event)?;
        }
        last_seen = Some(event.number);
        ControlFlow::Continue(())
    })?;
    let is_unfinished = page.is_full || stopped.is_exhausted;
    Ok(last_seen.filter(|_| is_unfinished))
}

/// Returns the newest event that is about a subject: one with this subject, or else one that has
/// its words.
fn find_subject(
    reader: &mut EventReader<'_>,
    subject: &str,
) -> Result<Option<RecordedEvent>, HistoryStoreError> {
    if let Some(number) = subject.trim().strip_prefix('#') {
        return match number.parse() {
            Ok(number) => reader.event(number),
            Err(_) => Ok(None),
        };
    }
    let subject = function_of(subject);
    if words_of(subject).next().is_none() {
        return Ok(None);
    }
    match words_of(subject).nth(1) {
        Some(_) => match find_exact(reader, subject)? {
            Some(event) => Ok(Some(event)),
            None => find_similar(reader, subject, |_| true),
        },
        // A name stands for what its agent does, rather than for what it measures.
        None => find_similar(reader, subject, |event| event.kind != HistoryKind::Fact),
    }
}

/// Returns the newest event with this subject, preferably not one that only talks about it.
fn find_exact(
    reader: &mut EventReader<'_>,
    subject: &str,
) -> Result<Option<RecordedEvent>, HistoryStoreError> {
    let filter = ScanFilter::default().and(subject_hash(subject));
    let (mut found, mut minor) = (None, None);
    let before = reader.blocks_read;
    reader.scan_counting(&filter, BLOCKS_MAX, |event, blocks| {
        if !is_same_text(&event.subject, subject) {
            return ControlFlow::Continue(());
        }
        if !matches!(event.kind, HistoryKind::Bid | HistoryKind::Refusal | HistoryKind::Question) {
            found = Some(event.clone());
            return ControlFlow::Break(());
        }
        minor.get_or_insert_with(|| event.clone());
        goes_on(blocks - before)
    })?;
    Ok(found.or(minor))
}

/// Returns the newest event with all words of a subject, preferably one of those that are
/// preferred.
fn find_similar(
    reader: &mut EventReader<'_>,
    subject: &str,
    is_preferred: impl Fn(&RecordedEvent) -> bool,
) -> Result<Option<RecordedEvent>, HistoryStoreError> {
    let filter = filter(subject, (None, None), None);
    let (mut found, mut other) = (None, None);
    let before = reader.blocks_read;
    reader.scan_counting(&filter, BLOCKS_MAX, |event, blocks| {
        if !is_about(event, subject) {
            return ControlFlow::Continue(());
        }
        if is_preferred(event) {
            found = Some(event.clone());
            return ControlFlow::Break(());
        }
        other.get_or_insert_with(|| event.clone());
        goes_on(blocks - before)
    })?;
    Ok(found.or(other))
}

/// Whether a better event is still looked for, while there is one.
fn goes_on(blocks: usize) -> ControlFlow<()> {
    match blocks > PREFERRED_BLOCKS_MAX {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}

/// Adds the chain of causes to the page, from the subject up to the root.
fn why(
    reader: &mut EventReader<'_>,
    subject: &str,
    before: Option<u64>,
    page: &mut PageBuilder,
) -> Result<Option<u64>, HistoryStoreError> {
    let mut event = match before {
        None => find_subject(reader, subject)?,
        // The page before ended with this event.
        Some(last) => match reader.event(last)?.and_then(|event| event.cause) {
            Some(cause) => reader.event(cause)?,
            None => None,
        },
    };
    while let Some(link) = event {
        if page.add(&link).is_break() {
            return Ok(page.events.last().map(|event| event.number));
        }
        event = match link.cause.filter(|cause| *cause < link.number) {
            Some(cause) => reader.event(cause)?,
            None => None,
        };
    }
    Ok(None)
}

/// Adds the subject and what it led to, in the order of the numbers.
fn effects(
    reader: &mut EventReader<'_>,
    subject: &str,
    after: Option<u64>,
    page: &mut PageBuilder,
) -> Result<Option<u64>, HistoryStoreError> {
    let Some(subject) = find_subject(reader, subject)? else { return Ok(None) };
    let mut waiting = BTreeSet::from([subject.number]);
    let mut followed = 0;
    while let Some(number) = waiting.pop_first() {
        let Some(event) = reader.event(number)? else { continue };
        if after.is_none_or(|after| number > after) && page.add(&event).is_break() {
            return Ok(page.events.last().map(|event| event.number));
        }
        followed += 1;
        if followed > EFFECTS_MAX || reader.blocks_read > BLOCKS_MAX {
            return Ok(None);
        }
        let caused = ScanFilter {
            hashes: vec![cause_hash(number)],
            from: number + 1,
            is_newest_first: false,
            ..ScanFilter::default()
        };
        reader.scan(&caused, BLOCKS_MAX, |effect| {
            if effect.cause == Some(number) && waiting.len() < EFFECTS_MAX {
                waiting.insert(effect.number);
            }
            ControlFlow::Continue(())
        })?;
    }
    Ok(None)
}

/// Returns words of the newest events that are like those of a query that found nothing.
fn near(reader: &mut EventReader<'_>, about: &str) -> Result<Vec<String>, HistoryStoreError> {
    let mut known = BTreeSet::new();
    let mut seen = 0;
    reader.scan(&ScanFilter::default(), BLOCKS_MAX, |event| {
        if !event.private {
            known.extend(words_of(&event.subject).map(str::to_owned));
            known.insert(event.agent.to_string());
        }
        seen += 1;
        match seen >= NEAR_EVENTS {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    let mut near = Vec::new();
    for word in words_of(about).take(8) {
        if known.iter().any(|known| known.eq_ignore_ascii_case(word)) {
            continue;
        }
        let candidate = pddl::nearest(word, known.iter().map(String::as_str));
        near.extend(candidate.map(str::to_owned));
    }
    Ok(near)
}

#[cfg(test)]
mod tests;
