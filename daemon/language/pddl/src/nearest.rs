//! Search for the likely intended name: “did you mean …?”.
//!
//! Used by the parser, by `check`, and by any crate that looks up a name written by a person.

/// Length of the longest word that is compared with others, in bytes. The cost grows with the
/// square of the length, and no person writes longer names.
const BYTES_MAX: usize = 128;

/// Returns the candidate that `word` most likely misspells; `None` if no candidate is near enough.
///
/// One error is tolerated in a word of two letters, and one more for every three further letters.
/// Among equally near candidates, the first is returned. Case is ignored.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if word.len() > BYTES_MAX {
        return None;
    }
    let word = word.to_lowercase();
    let slips_max = (word.chars().count() + 1) / 3;
    let mut best = None;
    for candidate in candidates {
        if candidate.len().abs_diff(word.len()) > slips_max * 4 || candidate.len() > BYTES_MAX {
            continue;
        }
        let slips = strsim::damerau_levenshtein(&word, &candidate.to_lowercase());
        if slips <= slips_max && best.is_none_or(|(fewest, _)| slips < fewest) {
            best = Some((slips, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[track_caller]
    fn check(word: &str, expected: Option<&str>) {
        assert_eq!(nearest(word, ["at", "connected", "known-temperature"]), expected);
    }

    #[test]
    fn a_misspelled_name_is_recognized() {
        check("conected", Some("connected"));
        check("CONNETCED", Some("connected"));
        check("known-temprature", Some("known-temperature"));
    }

    #[test]
    fn a_different_word_is_not_suggested() {
        check("docked", None);
        check("open", None);
    }
}
