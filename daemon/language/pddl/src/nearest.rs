//! Search for the likely intended name: “did you mean …?”.
//!
//! Used by the parser, by `check`, and by any crate that looks up a name written by a person.

/// Length of the longest word that is compared with others, in bytes. The cost grows with the
/// square of the length, and no person writes longer names.
const BYTES_MAX: usize = 128;

/// Returns the candidate that `word` most likely misspells; `None` if no candidate is near enough.
///
/// One error is tolerated in a word of two letters, and one more for every three further letters.
/// Among equally near candidates, the first is returned. Case is ignored. If none is near, a candidate
/// of the same parts in another order is: `temperature-known` for `known-temperature`.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if word.len() > BYTES_MAX {
        return None;
    }
    let word = word.to_lowercase();
    let slips_max = (word.chars().count() + 1) / 3;
    let (mut best, mut permuted) = (None, None);
    let parts = sorted_parts(&word);
    for candidate in candidates {
        if candidate.len().abs_diff(word.len()) > slips_max * 4 || candidate.len() > BYTES_MAX {
            continue;
        }
        let candidate_parts = || sorted_parts(&candidate.to_lowercase()) == parts;
        if permuted.is_none() && parts.len() > 1 && candidate_parts() {
            permuted = Some(candidate);
        }
        let slips = strsim::damerau_levenshtein(&word, &candidate.to_lowercase());
        if slips <= slips_max && best.is_none_or(|(fewest, _)| slips < fewest) {
            best = Some((slips, candidate));
        }
    }
    best.map(|(_, candidate)| candidate).or(permuted)
}

/// Returns the parts of a name between hyphens and underscores, in alphabetical order.
fn sorted_parts(name: &str) -> Vec<String> {
    let mut parts: Vec<_> = name.split(['-', '_']).map(str::to_owned).collect();
    parts.sort_unstable();
    parts
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
        check("temperature-known", Some("known-temperature"));
        check("Temperature_Known", Some("known-temperature"));
    }

    #[test]
    fn a_different_word_is_not_suggested() {
        check("docked", None);
        check("open", None);
    }
}
