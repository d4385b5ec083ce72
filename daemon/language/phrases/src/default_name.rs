//! The names of variables that a text leaves out: `every room` is `?r - room`.

use pddl::Name;

/// Returns the name of a variable of a type: the first letter of the type, with a number if one of
/// `taken` has that name.
pub(crate) fn default_name(ty: &Name, taken: &[Name]) -> Name {
    let first = ty.as_str().chars().next().filter(char::is_ascii_lowercase).unwrap_or('x');
    let plain = Name::new(&first.to_string());
    if !taken.contains(&plain) {
        return plain;
    }
    // One of these is free, because there is one more of them than names that are taken.
    let mut numbered = (2..taken.len() + 3).map(|number| Name::new(&format!("{first}{number}")));
    numbered.find(|name| !taken.contains(name)).unwrap_or(plain)
}

/// Whether a text is a PDDL name.
pub(crate) fn is_name(text: &str) -> bool {
    let is_inner = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    text.starts_with(char::is_alphabetic) && text.chars().all(is_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_free() {
        let name = |taken: &[&str]| {
            let taken: Vec<_> = taken.iter().map(|name| Name::new(name)).collect();
            default_name(&Name::new("room"), &taken).to_string()
        };
        assert_eq!(name(&[]), "r");
        assert_eq!(name(&["r", "r2", "c"]), "r3");
        assert_eq!(default_name(&Name::new("größe"), &[]).as_str(), "g");
        assert_eq!(default_name(&Name::new("öl"), &[]).as_str(), "x");
    }
}
