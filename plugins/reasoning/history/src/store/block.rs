//! A block: up to 64 events, column by column, compressed. Each block can be read by itself.
//!
//! The text of names is written once per block, in a table of symbols; columns have the numbers of
//! symbols. Numbers and times are differences from the event before. All integers are varints
//! (LEB128).

use std::collections::HashMap;
use std::sync::Arc;

use acl::content::HistoryRoot;
use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_to_vec_with_limit;

use crate::event::{EventDescription, RecordedEvent};
use crate::words::{kind_number, kind_of_number};

/// Number of events of a full block.
pub(crate) const BLOCK_EVENTS: u64 = 64;

/// Longest block after decompression; a longer one is not a block. 64 events have at most four
/// texts of bounded length each.
const BLOCK_BYTES_MAX: usize = 4 << 20;

/// Level of compression: higher ones take more time and save little on a few kilobytes.
const LEVEL: u8 = 4;

const WORKED: u8 = 1;
const PRIVATE: u8 = 2;
const CHANGE: u8 = 4;
const FROM_KNOWN: u8 = 8;

const ROOTS: [HistoryRoot; 5] = [
    HistoryRoot::Person,
    HistoryRoot::Sensor,
    HistoryRoot::Clock,
    HistoryRoot::Death,
    HistoryRoot::Arrival,
];

/// Returns the block of `events`, which are in the order of their numbers.
pub(crate) fn encode(events: &[RecordedEvent]) -> Vec<u8> {
    let mut symbols = BlockSymbols::default();
    let (mut fixed, mut columns) = (Vec::new(), Vec::new());
    let (mut number, mut at_ms) = (0, 0);
    for event in events {
        put(&mut columns, event.number.wrapping_sub(number));
        number = event.number;
    }
    for event in events {
        put_signed(&mut columns, event.at_ms.wrapping_sub(at_ms).cast_signed());
        at_ms = event.at_ms;
    }
    for event in events {
        fixed.extend([kind_number(event.kind), root_number(event.root), flags(event)]);
    }
    for event in events {
        put(&mut columns, event.cause.map_or(0, |cause| event.number.saturating_sub(cause)));
    }
    events.iter().for_each(|event| put(&mut columns, symbols.number(&event.subject)));
    events.iter().for_each(|event| put(&mut columns, symbols.number(&event.agent)));
    events.iter().for_each(|event| put(&mut columns, symbols.number(&event.conversation)));
    for event in events {
        match &event.what {
            EventDescription::Sentence(text) => put(&mut columns, symbols.number(text)),
            EventDescription::Change { from, to } => {
                from.iter().for_each(|from| put(&mut columns, symbols.number(from)));
                put(&mut columns, symbols.number(to));
            }
        }
    }
    let mut bytes = Vec::new();
    put(&mut bytes, events.len() as u64);
    put(&mut bytes, symbols.texts.len() as u64);
    for text in &symbols.texts {
        put(&mut bytes, text.len() as u64);
    }
    symbols.texts.iter().for_each(|text| bytes.extend(text.as_bytes()));
    bytes.extend(fixed);
    bytes.extend(columns);
    compress_to_vec(&bytes, LEVEL)
}

/// Returns the events of a block; `None` if the bytes are no block.
pub(crate) fn decode(block: &[u8]) -> Option<Vec<RecordedEvent>> {
    let bytes = decompress_to_vec_with_limit(block, BLOCK_BYTES_MAX).ok()?;
    let mut reader = BlockReader(&bytes);
    let count = usize::try_from(reader.number()?).ok().filter(|n| *n <= BLOCK_EVENTS as usize)?;
    let symbols = reader.symbols()?;
    let fixed = reader.take(count * 3)?;
    let numbers = reader.column(count, BlockReader::number)?;
    let times = reader.column(count, BlockReader::signed)?;
    let causes = reader.column(count, BlockReader::number)?;
    let subjects = reader.column(count, |reader| reader.symbol(&symbols))?;
    let agents = reader.column(count, |reader| reader.symbol(&symbols))?;
    let conversations = reader.column(count, |reader| reader.symbol(&symbols))?;
    let (mut number, mut at_ms, mut events) = (0_u64, 0_u64, Vec::with_capacity(count));
    for index in 0..count {
        let [kind, root, flags] = *fixed.get(index * 3..index * 3 + 3)? else { return None };
        number = number.wrapping_add(numbers[index]);
        at_ms = at_ms.wrapping_add(times[index].cast_unsigned());
        let what = if flags & CHANGE == 0 {
            EventDescription::Sentence(reader.symbol(&symbols)?)
        } else {
            let is_known = flags & FROM_KNOWN != 0;
            let from = if is_known { Some(reader.symbol(&symbols)?) } else { None };
            EventDescription::Change { from, to: reader.symbol(&symbols)? }
        };
        events.push(RecordedEvent {
            number,
            at_ms,
            kind: kind_of_number(kind),
            subject: Arc::clone(&subjects[index]),
            agent: Arc::clone(&agents[index]),
            conversation: Arc::clone(&conversations[index]),
            what,
            cause: (causes[index] > 0).then(|| number.saturating_sub(causes[index])),
            root: ROOTS.get(usize::from(root)).copied().unwrap_or(HistoryRoot::Other),
            worked: flags & WORKED != 0,
            private: flags & PRIVATE != 0,
        });
    }
    Some(events)
}

fn flags(event: &RecordedEvent) -> u8 {
    let bit = |is_set: bool, bit: u8| if is_set { bit } else { 0 };
    let (is_change, is_from_known) = match &event.what {
        EventDescription::Change { from, .. } => (true, from.is_some()),
        EventDescription::Sentence(_) => (false, false),
    };
    bit(event.worked, WORKED)
        | bit(event.private, PRIVATE)
        | bit(is_change, CHANGE)
        | bit(is_from_known, FROM_KNOWN)
}

fn root_number(root: HistoryRoot) -> u8 {
    let index = ROOTS.iter().position(|known| *known == root);
    index.map_or(u8::MAX, |index| u8::try_from(index).unwrap_or(u8::MAX))
}

fn put(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push((number & 0x7f) as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn put_signed(bytes: &mut Vec<u8>, number: i64) {
    put(bytes, ((number << 1) ^ (number >> 63)).cast_unsigned());
}

/// The symbols of one block, each with its number.
#[derive(Default)]
struct BlockSymbols<'a> {
    numbers: HashMap<&'a str, u64>,
    texts: Vec<&'a str>,
}

impl<'a> BlockSymbols<'a> {
    fn number(&mut self, text: &'a str) -> u64 {
        let next = self.texts.len() as u64;
        let number = *self.numbers.entry(text).or_insert(next);
        if number == next {
            self.texts.push(text);
        }
        number
    }
}

/// The part of a block that has not been read.
struct BlockReader<'a>(&'a [u8]);

impl<'a> BlockReader<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn number(&mut self) -> Option<u64> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let [byte] = *self.take(1)? else { return None };
            number |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(number);
            }
        }
        None
    }

    fn signed(&mut self) -> Option<i64> {
        let number = self.number()?;
        Some((number >> 1).cast_signed() ^ -((number & 1).cast_signed()))
    }

    fn column<T>(
        &mut self,
        count: usize,
        read: impl Fn(&mut BlockReader<'a>) -> Option<T>,
    ) -> Option<Vec<T>> {
        (0..count).map(|_| read(self)).collect()
    }

    fn symbols(&mut self) -> Option<Vec<Arc<str>>> {
        let count = usize::try_from(self.number()?).ok().filter(|count| *count <= self.0.len())?;
        let lengths = self.column(count, BlockReader::number)?;
        let text = |length: u64| {
            let bytes = self.take(usize::try_from(length).ok()?)?;
            std::str::from_utf8(bytes).ok().map(Arc::from)
        };
        lengths.into_iter().map(text).collect()
    }

    fn symbol(&mut self, symbols: &[Arc<str>]) -> Option<Arc<str>> {
        symbols.get(usize::try_from(self.number()?).ok()?).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::random_events;

    #[test]
    fn every_block_is_read_as_it_was_written() {
        for seed in 0..50 {
            let events = random_events(seed, 64);
            assert_eq!(decode(&encode(&events)).as_deref(), Some(&*events), "seed {seed}");
        }
        assert_eq!(decode(&encode(&[])).as_deref(), Some(&[][..]));
    }

    #[test]
    fn damaged_blocks_are_not_read_and_cause_no_panic() {
        let block = encode(&random_events(7, 64));
        let mut random = fastrand::Rng::with_seed(7);
        for _ in 0..2_000 {
            let mut damaged = block.clone();
            damaged[random.usize(..block.len())] ^= 1 << random.u8(..8);
            let _ = decode(&damaged);
            let _ = decode(&block[..random.usize(..block.len())]);
        }
        // Damage below the compression, where the checks of this file are the only ones.
        let raw = decompress_to_vec_with_limit(&block, BLOCK_BYTES_MAX).expect("a block");
        for _ in 0..2_000 {
            let mut damaged = raw.clone();
            damaged[random.usize(..raw.len())] = random.u8(..);
            let _ = decode(&compress_to_vec(&damaged, 1));
        }
    }
}
