//! The files of a history: their order, the segment to which events are added, and the limits.

use std::fs::{self, DirBuilder};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use super::HistoryLimits;
use super::block::{self, BLOCK_EVENTS};
use super::error::HistoryStoreError;
use super::part::{Part, PartChange, PartFailure};
use super::reader::ScanFilter;
use super::segment::{OpenIndex, SEGMENT_BLOCKS, SEGMENT_EVENTS, SegmentSpan};
use crate::event::RecordedEvent;

/// Number of parts of a history that has its greatest size.
const PARTS: u64 = 16;

/// Rights of the folder: only the user of the daemon may read what happened.
const FOLDER_MODE: u32 = 0o700;

/// Number of segments that are left out after a broken file, more than a part can have. So no
/// number of an event is used twice.
const SKIPPED_SEGMENTS: u64 = 100_000;

/// The open files.
pub(super) struct HistoryFiles {
    /// Oldest first; the last one is written to.
    pub(super) parts: Vec<Part>,
    pub(super) open: OpenSegment,
    /// Number of the newest event; 0 if there is none.
    pub(super) newest: u64,
}

/// The segment to which events are added.
pub(super) struct OpenSegment {
    pub(super) index: OpenIndex,
    pub(super) span: SegmentSpan,
    /// Size of the complete blocks.
    bytes: u64,
    /// The events of the newest block, and its size.
    tail: Vec<RecordedEvent>,
    tail_bytes: u64,
}

// === impl HistoryFiles ===

impl HistoryFiles {
    pub(super) fn open(folder: &Path) -> Result<(HistoryFiles, Vec<String>), HistoryStoreError> {
        let failed = |what, error: std::io::Error| {
            let (path, why) = (folder.to_owned(), error.to_string());
            HistoryStoreError::Failed { what, path, why }
        };
        let made = DirBuilder::new().recursive(true).mode(FOLDER_MODE).create(folder);
        made.map_err(|error| failed("make the folder", error))?;
        let paths = Part::paths(folder).map_err(|error| failed("list the folder", error))?;
        let (mut parts, mut notices) = (Vec::new(), Vec::new());
        for path in &paths {
            match Part::open(path) {
                Ok(part) => parts.push(part),
                Err(PartFailure::Broken(why)) => {
                    let aside = free_name_beside(path);
                    tracing::error!(file = %path.display(), aside = %aside.display(), why,
                        "a file of the history is broken; it is moved aside");
                    let moved = format!("{} was broken and is now {}", name(path), name(&aside));
                    fs::rename(path, &aside).map_err(|error| failed("move aside", error))?;
                    notices.push(moved);
                }
                Err(other) => return Err(other.into_store_error(path)),
            }
        }
        let is_newest_open = parts.last().map(|part| &part.path) == paths.last();
        if parts.is_empty() || !is_newest_open {
            // Behind all numbers that events in the broken file may have.
            let broken = paths.last().map(|path| Part::first_segment_of(path) + SKIPPED_SEGMENTS);
            let path = Part::path_of(folder, broken.unwrap_or(0));
            parts.push(Part::open(&path).map_err(|failure| failure.into_store_error(&path))?);
        }
        let mut files = HistoryFiles { parts, open: OpenSegment::new(0), newest: 0 };
        files.restore().map_err(|error| HistoryStoreError::Read(error.to_string()))?;
        Ok((files, notices))
    }

    /// Restores the open segment from the blocks of the newest part.
    fn restore(&mut self) -> Result<(), redb::Error> {
        let Some(part) = self.parts.last() else { return Ok(()) };
        self.open = OpenSegment::new(part.first_open_block / SEGMENT_BLOCKS);
        // Numbers begin behind all segments that were closed.
        self.newest = (part.first_open_block * BLOCK_EVENTS).saturating_sub(1);
        for (number, bytes) in part.open_blocks()? {
            let Some(events) = block::decode(&bytes) else {
                tracing::error!(number, "a block of the history cannot be read");
                self.newest = self.newest.max((number + 1) * BLOCK_EVENTS - 1);
                continue;
            };
            for event in &events {
                self.open.index.add(event);
                self.open.span.add(event);
                self.newest = self.newest.max(event.number);
            }
            self.open.bytes += std::mem::replace(&mut self.open.tail_bytes, bytes.len() as u64);
            self.open.tail = events;
        }
        Ok(())
    }

    pub(super) fn append(
        &mut self,
        folder: &Path,
        events: &[RecordedEvent],
        lost: u64,
        limits: HistoryLimits,
    ) -> Result<(), HistoryStoreError> {
        let wrote = |error: redb::Error| HistoryStoreError::Write(error.to_string());
        let fresh = events.partition_point(|event| event.number <= self.newest);
        let (mut rest, mut is_pending) = (&events[fresh..], true);
        while is_pending || !rest.is_empty() {
            is_pending = false;
            let segment = self.open.span.segment;
            let here = rest.partition_point(|event| event.number / SEGMENT_EVENTS <= segment);
            let (now, later) = rest.split_at(here);
            let mut change = PartChange { lost, ..PartChange::default() };
            self.open.add(now, &mut change);
            if !later.is_empty() && self.open.span.has_events() {
                change.closed = Some(self.open.close());
            }
            let Some(part) = self.parts.last_mut() else { return Ok(()) };
            if !change.blocks.is_empty() || change.closed.is_some() || part.lost != lost {
                part.write(&change).map_err(wrote)?;
            }
            self.newest = now.last().map_or(self.newest, |event| event.number);
            if let Some(next) = later.first() {
                let next_segment = next.number / SEGMENT_EVENTS;
                self.open = OpenSegment::new(next_segment);
                if part.live_bytes() >= limits.bytes_max / PARTS {
                    self.rotate(folder, next_segment, lost)?;
                }
            }
            rest = later;
        }
        Ok(())
    }

    /// Ends the newest part, and begins another one.
    fn rotate(&mut self, folder: &Path, segment: u64, lost: u64) -> Result<(), HistoryStoreError> {
        if let Some(part) = self.parts.last_mut() {
            part.compact();
        }
        let path = Part::path_of(folder, segment);
        let mut part = Part::open(&path).map_err(|failure| failure.into_store_error(&path))?;
        let change = PartChange { lost, ..PartChange::default() };
        part.write(&change).map_err(|error| HistoryStoreError::Write(error.to_string()))?;
        self.parts.push(part);
        Ok(())
    }

    /// Deletes what is older or more than the limits allow. The newest part stays.
    pub(super) fn enforce(
        &mut self,
        limits: HistoryLimits,
        now_ms: u64,
    ) -> Result<(), HistoryStoreError> {
        let oldest_ms = now_ms.saturating_sub(limits.keep_ms);
        if let Some(first) = self.parts.first_mut() {
            let wrote = |error: redb::Error| HistoryStoreError::Write(error.to_string());
            first.delete_older(oldest_ms).map_err(wrote)?;
        }
        // The newest file may double at its next write.
        let growth = limits.bytes_max / PARTS * 2;
        while self.parts.len() > 1 {
            let bytes: u64 = self.parts.iter().map(Part::file_bytes).sum();
            let is_empty = self.parts.first().is_some_and(|part| part.spans.is_empty());
            if !is_empty && bytes + growth <= limits.bytes_max {
                break;
            }
            let oldest = self.parts.remove(0);
            let path = oldest.path.clone();
            drop(oldest);
            fs::remove_file(&path).map_err(|error| HistoryStoreError::Failed {
                what: "delete",
                path,
                why: error.to_string(),
            })?;
        }
        Ok(())
    }

    pub(super) fn part_of(&self, segment: u64) -> Option<&Part> {
        let after = self.parts.partition_point(|part| part.first_segment() <= segment);
        self.parts.get(after.checked_sub(1)?)
    }

    /// Returns the segments that overlap with the filter, in the order of the scan.
    pub(super) fn segments(&self, filter: &ScanFilter) -> Vec<u64> {
        let closed = self.parts.iter().flat_map(|part| &part.spans);
        let spans = closed.chain(std::iter::once(&self.open.span));
        let (from, to) = (filter.from / SEGMENT_EVENTS, filter.to / SEGMENT_EVENTS);
        let mut segments: Vec<_> = spans
            .filter(|span| (from..=to).contains(&span.segment))
            .filter(|span| span.overlaps(filter.from_ms, filter.to_ms))
            .map(|span| span.segment)
            .collect();
        if filter.is_newest_first {
            segments.reverse();
        }
        segments
    }
}

// === impl OpenSegment ===

impl OpenSegment {
    fn new(segment: u64) -> OpenSegment {
        let (index, span) = (OpenIndex::default(), SegmentSpan::empty(segment));
        OpenSegment { index, span, bytes: 0, tail: Vec::new(), tail_bytes: 0 }
    }

    /// Adds events of this segment, and adds the blocks that have them to `change`.
    fn add(&mut self, events: &[RecordedEvent], change: &mut PartChange) {
        let number = |event: &RecordedEvent| event.number / BLOCK_EVENTS;
        for group in events.chunk_by(|a, b| number(a) == number(b)) {
            let block = number(&group[0]);
            if self.tail.last().is_some_and(|last| number(last) != block) {
                self.tail.clear();
                self.bytes += std::mem::take(&mut self.tail_bytes);
            }
            for event in group {
                self.index.add(event);
                self.span.add(event);
            }
            self.tail.extend_from_slice(group);
            let bytes = block::encode(&self.tail);
            self.tail_bytes = bytes.len() as u64;
            change.blocks.push((block, bytes));
        }
    }

    /// Returns the span and the index of the segment, which has no more events to come.
    fn close(&self) -> (SegmentSpan, Vec<u8>) {
        let index = self.index.to_bytes();
        let bytes = self.bytes + self.tail_bytes + index.len() as u64;
        (SegmentSpan { bytes, ..self.span }, index)
    }
}

/// Returns an unused path beside `path`, to which a damaged file can be moved.
fn free_name_beside(path: &Path) -> PathBuf {
    let name = |number: u32| path.with_extension(format!("broken-{number}"));
    (1..).map(name).find(|name| !name.exists()).unwrap_or_else(|| name(0))
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
