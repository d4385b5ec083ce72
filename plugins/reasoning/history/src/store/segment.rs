//! A segment: 64 blocks, with an index that says which of its blocks have a word.
//!
//! The index of a closed segment is one value in the file: for each word its hash (4 bytes) and a
//! bitmap of the blocks (8 bytes), in the order of the hashes.

use std::collections::BTreeMap;

use super::block::BLOCK_EVENTS;
use crate::event::RecordedEvent;
use crate::words::{WordHash, each_hash};

/// Number of blocks of a full segment: the bits of a bitmap.
pub(crate) const SEGMENT_BLOCKS: u64 = 64;

/// Number of events of a full segment.
pub(crate) const SEGMENT_EVENTS: u64 = SEGMENT_BLOCKS * BLOCK_EVENTS;

const ENTRY_BYTES: usize = 12;

/// SegmentSpan of a segment: the times of its events, and its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SegmentSpan {
    /// Number of the segment.
    pub(crate) segment: u64,
    /// Time of the oldest event.
    pub(crate) from_ms: u64,
    /// Time of the newest event.
    pub(crate) to_ms: u64,
    /// Bytes of its blocks and of its index.
    pub(crate) bytes: u64,
}

/// Index of a segment that is being filled.
#[derive(Debug, Default)]
pub(crate) struct OpenIndex(BTreeMap<WordHash, u64>);

/// Index of a segment, as the file has it.
pub(crate) struct ClosedIndex<'a>(pub(crate) &'a [u8]);

// === impl SegmentSpan ===

impl SegmentSpan {
    /// Creates the span of a segment without events.
    pub(crate) fn empty(segment: u64) -> SegmentSpan {
        SegmentSpan { segment, from_ms: u64::MAX, to_ms: 0, bytes: 0 }
    }

    /// Extends the span by an event.
    pub(crate) fn add(&mut self, event: &RecordedEvent) {
        self.from_ms = self.from_ms.min(event.at_ms);
        self.to_ms = self.to_ms.max(event.at_ms);
    }

    /// Whether the segment has an event.
    pub(crate) fn has_events(&self) -> bool {
        self.from_ms <= self.to_ms
    }

    /// Whether an event of the segment may be in this time.
    pub(crate) fn overlaps(&self, from_ms: u64, to_ms: u64) -> bool {
        self.from_ms <= to_ms && self.to_ms >= from_ms
    }

    /// Returns the span for the file.
    pub(crate) fn to_bytes(self) -> [u8; 24] {
        let mut bytes = [0; 24];
        bytes[..8].copy_from_slice(&self.from_ms.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.to_ms.to_le_bytes());
        bytes[16..].copy_from_slice(&self.bytes.to_le_bytes());
        bytes
    }

    /// Returns the span that the file has for `segment`; `None` if the bytes are no span.
    pub(crate) fn from_bytes(segment: u64, bytes: &[u8]) -> Option<SegmentSpan> {
        let number = |at: usize| {
            let bytes: [u8; 8] = bytes.get(at..at + 8)?.try_into().ok()?;
            Some(u64::from_le_bytes(bytes))
        };
        Some(SegmentSpan { segment, from_ms: number(0)?, to_ms: number(8)?, bytes: number(16)? })
    }
}

// === impl OpenIndex ===

impl OpenIndex {
    /// Adds the words of an event.
    pub(crate) fn add(&mut self, event: &RecordedEvent) {
        let bit = 1 << (event.number / BLOCK_EVENTS % SEGMENT_BLOCKS);
        each_hash(event, |hash| *self.0.entry(hash).or_default() |= bit);
    }

    /// Returns the bitmap of the blocks that have all these words.
    pub(crate) fn blocks_with(&self, hashes: &[WordHash]) -> u64 {
        let blocks = |hash: &WordHash| self.0.get(hash).copied().unwrap_or(0);
        hashes.iter().map(blocks).fold(u64::MAX, |all, blocks| all & blocks)
    }

    /// Returns the index for the file.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.0.len() * ENTRY_BYTES);
        for (hash, blocks) in &self.0 {
            bytes.extend(hash.to_be_bytes());
            bytes.extend(blocks.to_le_bytes());
        }
        bytes
    }
}

// === impl ClosedIndex ===

impl ClosedIndex<'_> {
    /// Returns the bitmap of the blocks that have all these words.
    pub(crate) fn blocks_with(&self, hashes: &[WordHash]) -> u64 {
        hashes.iter().fold(u64::MAX, |all, hash| if all == 0 { 0 } else { all & self.find(*hash) })
    }

    fn find(&self, hash: WordHash) -> u64 {
        let (entries, _) = self.0.as_chunks::<ENTRY_BYTES>();
        let hash = hash.to_be_bytes();
        let Ok(index) = entries.binary_search_by(|entry| entry[..4].cmp(&hash)) else { return 0 };
        let [.., a, b, c, d, e, f, g, h] = entries[index];
        u64::from_le_bytes([a, b, c, d, e, f, g, h])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::random_events;
    use crate::words::hash_of;

    #[test]
    fn both_forms_of_an_index_agree() {
        let events = random_events(3, 2_000);
        let mut open = OpenIndex::default();
        events.iter().for_each(|event| open.add(event));
        let bytes = open.to_bytes();
        let closed = ClosedIndex(&bytes);
        for word in ["temperature", "office1", "sensor-3", "nothing"] {
            let hashes = [hash_of(word)];
            assert_eq!(open.blocks_with(&hashes), closed.blocks_with(&hashes), "{word}");
        }
        assert_ne!(open.blocks_with(&[hash_of("temperature")]), 0);
        assert_eq!(open.blocks_with(&[hash_of("nothing")]), 0);
        assert_eq!(ClosedIndex(&[1, 2, 3]).blocks_with(&[5]), 0);
    }

    #[test]
    fn a_span_is_read_as_it_was_written() {
        let mut span = SegmentSpan::empty(4);
        random_events(1, 10).iter().for_each(|event| span.add(event));
        assert_eq!(SegmentSpan::from_bytes(4, &span.to_bytes()), Some(span));
        assert_eq!(SegmentSpan::from_bytes(4, &[1, 2]), None);
        assert!(span.overlaps(span.to_ms, u64::MAX) && !span.overlaps(span.to_ms + 1, u64::MAX));
    }
}
