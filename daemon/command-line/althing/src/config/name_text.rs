//! Names as people write them, and the nearest names that agents, daemons and ecosystems can have:
//! `küche pi` is to be `kueche-pi`, and `101-pi` is to be `pi-101`.

use acl::AgentId;

/// Letters of other alphabets, with the letters that people write in their place.
const LETTERS: &[(&str, &str)] = &[
    ("ä", "ae"),
    ("ö", "oe"),
    ("ü", "ue"),
    ("ß", "ss"),
    ("æ", "ae"),
    ("ø", "oe"),
    ("å", "aa"),
    ("œ", "oe"),
    ("àáâã", "a"),
    ("ç", "c"),
    ("èéêë", "e"),
    ("ìíîï", "i"),
    ("ñ", "n"),
    ("òóôõ", "o"),
    ("ùúû", "u"),
    ("ýÿ", "y"),
];

/// Returns a valid name that resembles `text`; `None` if there is none.
pub(super) fn suggestion(text: &str) -> Option<String> {
    let mut name = String::new();
    for letter in text.trim().to_lowercase().chars() {
        let other = LETTERS.iter().find(|(letters, _)| letters.contains(letter));
        match (letter, other) {
            (_, Some((_, plain))) => name += plain,
            ('a'..='z' | '0'..='9' | '_' | '-', None) => name.push(letter),
            // One hyphen stands for spaces, points and the like.
            _ if name.ends_with('-') => (),
            _ => name.push('-'),
        }
    }
    let name = name.trim_matches(['-', '_']);
    let digits = name.len() - name.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let (number, rest) = name.split_at(digits);
    let name = match (number, rest.trim_start_matches(['-', '_'])) {
        ("", rest) => rest.to_owned(),
        (number, "") => format!("n{number}"),
        (number, rest) => format!("{rest}-{number}"),
    };
    AgentId::new(&name).is_ok().then_some(name)
}

#[cfg(test)]
mod tests {
    use super::suggestion;

    #[test]
    fn names_are_written_with_plain_letters() {
        let all = ["küche-pi", "Büro 3 (Süd)", "101-pi", "Thermomètre", "101", "", "?", "日本"];
        let meant = all.map(|text| suggestion(text).unwrap_or_default());
        let expected = ["kueche-pi", "buero-3-sued", "pi-101", "thermometre", "n101", "", "", ""];
        assert_eq!(meant, expected);
    }
}
