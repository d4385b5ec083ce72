//! The names of places and floors: which names are allowed, and which name comes nearest to one that
//! is not.

/// Letters that people write in names of rooms, and how they are written with the letters of PDDL.
const TRANSCRIPTIONS: &[(char, &str)] = &[
    ('ä', "ae"),
    ('ö', "oe"),
    ('ü', "ue"),
    ('ß', "ss"),
    ('à', "a"),
    ('á', "a"),
    ('â', "a"),
    ('å', "a"),
    ('æ', "ae"),
    ('ç', "c"),
    ('è', "e"),
    ('é', "e"),
    ('ê', "e"),
    ('ë', "e"),
    ('í', "i"),
    ('î', "i"),
    ('ï', "i"),
    ('ñ', "n"),
    ('ó', "o"),
    ('ô', "o"),
    ('ø', "o"),
    ('œ', "oe"),
    ('ú', "u"),
    ('û', "u"),
];

/// Beginning of a name that is made for a place whose own name begins with a digit.
const PLACE_PREFIX: &str = "room-";

/// Returns why `name` cannot be the name of a place, and the nearest name that can, if there is one.
/// Returns `None` if `name` is allowed: lower-case letters, digits, `-` and `_`, a letter first.
pub fn place_name_problem(name: &str) -> Option<(String, Option<String>)> {
    let reason = if name.is_empty() {
        "it is empty".to_owned()
    } else if let Some(c) = name.chars().find(|c| !is_allowed(*c) && !c.is_ascii_uppercase()) {
        match c {
            ' ' => "a name has no spaces".to_owned(),
            c if c.is_control() => "a name has no control characters".to_owned(),
            c => format!("a name cannot hold `{c}`"),
        }
    } else if name.chars().any(|c| c.is_ascii_uppercase()) {
        "names are in lower case".to_owned()
    } else if !name.starts_with(|c: char| c.is_ascii_lowercase()) {
        "a name begins with a letter".to_owned()
    } else {
        return None;
    };
    Some((reason, nearest_name(name)))
}

fn is_allowed(c: char) -> bool {
    c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_'
}

/// Returns the name that comes nearest to `name`; `None` if nothing of it can be written.
fn nearest_name(name: &str) -> Option<String> {
    let mut near = String::new();
    for c in name.trim().to_lowercase().chars() {
        match TRANSCRIPTIONS.iter().find(|(letter, _)| *letter == c) {
            Some((_, letters)) => near.push_str(letters),
            None if is_allowed(c) => near.push(c),
            None if near.ends_with('-') => (),
            None => near.push('-'),
        }
    }
    let near = near.trim_matches(['-', '_']);
    match near.chars().next() {
        None => None,
        Some(first) if first.is_ascii_digit() => Some(format!("{PLACE_PREFIX}{near}")),
        Some(_) => Some(near.to_owned()),
    }
}

/// Returns the name of the floor with a number: `floor-1` for 1, `basement-1` for -1.
pub fn floor_name(number: i64) -> String {
    match number {
        0.. => format!("floor-{number}"),
        below => format!("basement-{}", below.unsigned_abs()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_pddl_are_allowed() {
        for name in ["office1", "conf-room", "a_b", "x"] {
            assert_eq!(place_name_problem(name), None, "{name}");
        }
    }

    #[test]
    fn a_name_that_is_not_allowed_comes_with_the_nearest_that_is() {
        for (name, reason, near) in [
            ("Küche", "cannot hold `ü`", Some("kueche")),
            ("Meeting Room", "no spaces", Some("meeting-room")),
            ("Office1", "lower case", Some("office1")),
            ("217", "begins with a letter", Some("room-217")),
            ("-hall", "begins with a letter", Some("hall")),
            ("", "empty", None),
            ("会議室", "cannot hold", None),
            ("room\u{7}", "control", Some("room")),
            ("café (1st)", "cannot hold `é`", Some("cafe-1st")),
        ] {
            let (said, nearest) = place_name_problem(name).expect("it is not allowed");
            assert!(said.contains(reason), "{name}: {said}");
            assert_eq!(nearest.as_deref(), near, "{name}");
            if let Some(near) = near {
                assert_eq!(place_name_problem(near), None, "{name}: {near}");
            }
        }
    }

    #[test]
    fn floors_below_the_ground_have_names_too() {
        assert_eq!([2, 0, -1].map(floor_name), ["floor-2", "floor-0", "basement-1"]);
        assert_eq!(place_name_problem(&floor_name(i64::MIN)), None);
    }
}
