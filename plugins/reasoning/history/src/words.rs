//! The words of an event, by which it is found: the symbols of its subject, its agent, its
//! conversation, its kind and its cause.

use acl::content::HistoryKind;
use acl::fnv::hash_32;

use crate::event::RecordedEvent;

/// Hash of a word, as the index of a segment has it. Two words may have one hash; therefore each
/// event that an index finds is compared with the words themselves.
pub(crate) type WordHash = u32;

/// Returns the words of a text: the parts between parentheses and white space.
pub(crate) fn words_of(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c.is_whitespace() || matches!(c, '(' | ')' | '`'))
        .filter(|word| !word.is_empty())
}

/// Returns the hash of a word; upper and lower case count as equal, as in PDDL.
pub(crate) fn hash_of(word: &str) -> WordHash {
    hash_32(word.to_ascii_lowercase().as_bytes())
}

/// Returns the hash of a whole text, by its words: the events with this subject are found by it.
/// One block often has all words of a step, in the facts of its device and in other steps.
pub(crate) fn subject_hash(subject: &str) -> WordHash {
    let mut key = vec![3];
    for word in words_of(subject) {
        key.push(b' ');
        key.extend(word.bytes().map(|byte| byte.to_ascii_lowercase()));
    }
    hash_32(&key)
}

/// Returns the hash by which the events of a kind are found.
pub(crate) fn kind_hash(kind: HistoryKind) -> WordHash {
    hash_32(&[0, kind_number(kind)])
}

/// Returns the hash by which the events that `cause` caused are found.
pub(crate) fn cause_hash(cause: u64) -> WordHash {
    let mut key = [1; 9];
    key[1..].copy_from_slice(&cause.to_le_bytes());
    hash_32(&key)
}

/// Hash by which events in which something worked are found.
pub(crate) fn worked_hash() -> WordHash {
    hash_32(&[2])
}

/// Calls `add` with each hash by which the event is found.
pub(crate) fn each_hash(event: &RecordedEvent, mut add: impl FnMut(WordHash)) {
    words_of(&event.subject).for_each(|word| add(hash_of(word)));
    add(subject_hash(&event.subject));
    [&event.agent, &event.conversation]
        .into_iter()
        .filter(|name| !name.is_empty())
        .for_each(|name| add(hash_of(name)));
    add(kind_hash(event.kind));
    event.cause.into_iter().for_each(|cause| add(cause_hash(cause)));
    if event.worked {
        add(worked_hash());
    }
}

/// Whether the event has the word: as a symbol of its subject, as its agent or its conversation.
pub(crate) fn has_word(event: &RecordedEvent, word: &str) -> bool {
    event.agent.eq_ignore_ascii_case(word)
        || event.conversation.eq_ignore_ascii_case(word)
        || words_of(&event.subject).any(|symbol| symbol.eq_ignore_ascii_case(word))
}

/// Whether two texts have the same words in the same order.
pub(crate) fn is_same_text(a: &str, b: &str) -> bool {
    let (mut a, mut b) = (words_of(a), words_of(b));
    loop {
        match (a.next(), b.next()) {
            (None, None) => return true,
            (Some(a), Some(b)) if a.eq_ignore_ascii_case(b) => (),
            _ => return false,
        }
    }
}

/// Returns the number that stands for a kind in a file.
pub(crate) fn kind_number(kind: HistoryKind) -> u8 {
    let index = HistoryKind::ALL.iter().position(|known| *known == kind);
    index.map_or(u8::MAX, |index| u8::try_from(index).unwrap_or(u8::MAX))
}

/// Returns the kind of a number in a file.
pub(crate) fn kind_of_number(number: u8) -> HistoryKind {
    HistoryKind::ALL.get(usize::from(number)).copied().unwrap_or(HistoryKind::Other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_what_stands_between_parentheses_and_spaces() {
        let words: Vec<_> = words_of("(and (at r1 hall) `x`)").collect();
        assert_eq!(words, ["and", "at", "r1", "hall", "x"]);
        assert!(is_same_text("(at  R1 hall)", "at r1 hall"));
        assert!(!is_same_text("(at r1)", "(at r1 hall)"));
    }

    #[test]
    fn kinds_keep_their_numbers() {
        for kind in HistoryKind::ALL {
            assert_eq!(kind_of_number(kind_number(kind)), kind);
        }
        assert_eq!(kind_of_number(77), HistoryKind::Other);
    }
}
