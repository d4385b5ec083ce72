//! Reads events from the files: one by its number, or all with some words.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use super::block::{self, BLOCK_EVENTS};
use super::error::HistoryStoreError;
use super::files::HistoryFiles;
use super::segment::{ClosedIndex, SEGMENT_BLOCKS, SEGMENT_EVENTS};
use crate::event::RecordedEvent;
use crate::words::WordHash;

/// Maximum number of decoded blocks that one query keeps.
const CACHED_BLOCKS_MAX: usize = 64;

/// Which events a scan visits. All conditions hold for each.
#[derive(Clone, Debug)]
pub(crate) struct ScanFilter {
    /// Hashes of the words that the events have. Events that only have the hash are visited too.
    pub(crate) hashes: Vec<WordHash>,
    /// Times of the events.
    pub(crate) from_ms: u64,
    pub(crate) to_ms: u64,
    /// Numbers of the events.
    pub(crate) from: u64,
    pub(crate) to: u64,
    /// Whether the events with the greatest numbers come first.
    pub(crate) is_newest_first: bool,
}

/// How a scan ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScanEnd {
    /// Whether the scan ended because too many blocks were read.
    pub(crate) is_exhausted: bool,
}

impl ScanFilter {
    /// Returns the filter with one more word.
    pub(crate) fn and(mut self, hash: WordHash) -> ScanFilter {
        self.hashes.push(hash);
        self
    }
}

impl Default for ScanFilter {
    fn default() -> ScanFilter {
        ScanFilter {
            hashes: Vec::new(),
            from_ms: 0,
            to_ms: u64::MAX,
            from: 0,
            to: u64::MAX,
            is_newest_first: true,
        }
    }
}

/// Reads events during one query.
pub(crate) struct EventReader<'a> {
    files: &'a HistoryFiles,
    cached: HashMap<u64, Arc<Vec<RecordedEvent>>>,
    /// Number of blocks that the query has decoded.
    pub(crate) blocks_read: usize,
}

// === impl EventReader ===

impl<'a> EventReader<'a> {
    /// Creates a reader for one query.
    pub(super) fn new(files: &'a HistoryFiles) -> EventReader<'a> {
        EventReader { files, cached: HashMap::new(), blocks_read: 0 }
    }

    /// Returns the time of the oldest event that is kept.
    pub(crate) fn oldest_ms(&self) -> Option<u64> {
        let spans = self.files.parts.iter().flat_map(|part| &part.spans);
        let open = std::iter::once(&self.files.open.span);
        spans.chain(open).find(|span| span.has_events()).map(|span| span.from_ms)
    }

    /// Returns the event with this number; `None` if it is not kept.
    pub(crate) fn event(
        &mut self,
        number: u64,
    ) -> Result<Option<RecordedEvent>, HistoryStoreError> {
        let block = self.block(number / BLOCK_EVENTS)?;
        Ok(block.iter().find(|event| event.number == number).cloned())
    }

    /// Returns the number of the oldest event that may be kept.
    pub(crate) fn oldest_number(&self) -> u64 {
        let spans = self.files.parts.iter().flat_map(|part| &part.spans);
        let first = spans.chain(std::iter::once(&self.files.open.span)).next();
        first.map_or(0, |span| span.segment * SEGMENT_EVENTS)
    }

    /// Visits the events that the filter describes, until `visit` breaks or more than `blocks_max`
    /// blocks have been read for the query.
    pub(crate) fn scan(
        &mut self,
        filter: &ScanFilter,
        blocks_max: usize,
        mut visit: impl FnMut(&RecordedEvent) -> ControlFlow<()>,
    ) -> Result<ScanEnd, HistoryStoreError> {
        self.scan_counting(filter, blocks_max, |event, _| visit(event))
    }

    /// Does the same as [`EventReader::scan`], and gives `visit` the number of blocks that have
    /// been read.
    pub(crate) fn scan_counting(
        &mut self,
        filter: &ScanFilter,
        blocks_max: usize,
        mut visit: impl FnMut(&RecordedEvent, usize) -> ControlFlow<()>,
    ) -> Result<ScanEnd, HistoryStoreError> {
        for segment in self.files.segments(filter) {
            let blocks = self.blocks_with(segment, &filter.hashes)?;
            for number in blocks_in_order(segment, blocks, filter) {
                if self.blocks_read > blocks_max {
                    return Ok(ScanEnd { is_exhausted: true });
                }
                let block = self.block(number)?;
                let read = self.blocks_read;
                let mut visit_all = |events: &mut dyn Iterator<Item = &RecordedEvent>| {
                    let mut wanted = events.filter(|event| is_wanted(event, filter));
                    wanted.try_for_each(|event| visit(event, read))
                };
                let flow = if filter.is_newest_first {
                    visit_all(&mut block.iter().rev())
                } else {
                    visit_all(&mut block.iter())
                };
                if flow.is_break() {
                    return Ok(ScanEnd { is_exhausted: false });
                }
            }
        }
        Ok(ScanEnd { is_exhausted: false })
    }

    fn blocks_with(&self, segment: u64, hashes: &[WordHash]) -> Result<u64, HistoryStoreError> {
        if segment == self.files.open.span.segment {
            return Ok(self.files.open.index.blocks_with(hashes));
        }
        if hashes.is_empty() {
            return Ok(u64::MAX);
        }
        let Some(part) = self.files.part_of(segment) else { return Ok(0) };
        part.with_index(segment, |index| ClosedIndex(index).blocks_with(hashes))
            .map_err(|error| HistoryStoreError::Read(error.to_string()))
    }

    fn block(&mut self, number: u64) -> Result<Arc<Vec<RecordedEvent>>, HistoryStoreError> {
        if let Some(cached) = self.cached.get(&number) {
            return Ok(Arc::clone(cached));
        }
        let Some(part) = self.files.part_of(number / SEGMENT_BLOCKS) else {
            return Ok(Arc::default());
        };
        let bytes =
            part.block(number).map_err(|error| HistoryStoreError::Read(error.to_string()))?;
        let decoded = bytes.map(|bytes| block::decode(&bytes));
        if let Some(None) = &decoded {
            tracing::error!(number, "a block of the history cannot be read");
        }
        let events = Arc::new(decoded.flatten().unwrap_or_default());
        self.blocks_read += 1;
        if self.cached.len() >= CACHED_BLOCKS_MAX {
            self.cached.clear();
        }
        self.cached.insert(number, Arc::clone(&events));
        Ok(events)
    }
}

/// Returns the numbers of the blocks in a bitmap that the filter may want, in the order of the
/// scan.
fn blocks_in_order(segment: u64, blocks: u64, filter: &ScanFilter) -> Vec<u64> {
    let numbers = (0..SEGMENT_BLOCKS).filter(|index| blocks & (1 << index) != 0);
    let numbers = numbers.map(|index| segment * SEGMENT_BLOCKS + index);
    let mut wanted: Vec<_> = numbers
        .filter(|number| number * BLOCK_EVENTS <= filter.to)
        .filter(|number| (number + 1) * BLOCK_EVENTS > filter.from)
        .collect();
    if filter.is_newest_first {
        wanted.reverse();
    }
    wanted
}

fn is_wanted(event: &RecordedEvent, filter: &ScanFilter) -> bool {
    (filter.from..=filter.to).contains(&event.number)
        && (filter.from_ms..=filter.to_ms).contains(&event.at_ms)
}
