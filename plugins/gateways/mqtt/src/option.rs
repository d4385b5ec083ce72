//! The options of a choice, and the presses of a device: the texts of the device, and the objects
//! of the planning problem.

use crate::message::OutgoingMessage;
use crate::naming::slug;
use crate::setting::OPTIONS_MAX;

/// Maximum length of the name of an option, in bytes; the end of a longer one is cut off.
const NAME_BYTES_MAX: usize = 48;

/// One option of a choice, or one press.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SettableOption {
    /// Name of the option's object in PDDL.
    pub(crate) name: String,
    /// The text by which the device reports the option.
    pub(crate) text: String,
    /// Index of the only source with this text; `None` if all sources of the feature have it.
    pub(crate) source: Option<usize>,
    /// Message that chooses the option; `None` for a press.
    pub(crate) message: Option<OutgoingMessage>,
}

/// Returns the options with names for objects of the type `kind`, made from the names in `said`.
/// Options with names that differ only in signs get different numbers.
///
/// # Errors
///
/// Returns the reason if there is no option.
pub(crate) fn settable_options(
    kind: &str,
    said: impl IntoIterator<Item = SettableOption>,
) -> Result<Vec<SettableOption>, String> {
    let mut options: Vec<SettableOption> = Vec::new();
    for option in said {
        let is_same =
            |other: &SettableOption| (&other.text, other.source) == (&option.text, option.source);
        if option.text.trim().is_empty() || options.iter().any(is_same) {
            continue;
        }
        let words = Some(slug(&option.name, "-")).filter(|words| !words.is_empty());
        let mut name = format!("{kind}-{}", words.as_deref().unwrap_or("unnamed"));
        name.truncate(NAME_BYTES_MAX);
        let name = name.trim_end_matches('-').to_owned();
        let is_taken = |name: &String| options.iter().any(|other| other.name == *name);
        let numbered = (2..).map(|number| format!("{name}-{number}"));
        let name = std::iter::once(name.clone()).chain(numbered).find(|one| !is_taken(one));
        options.push(SettableOption { name: name.unwrap_or_default(), ..option });
        if options.len() == OPTIONS_MAX {
            break;
        }
    }
    if options.is_empty() { Err("it has no options".to_owned()) } else { Ok(options) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> SettableOption {
        let (name, text) = (text.to_owned(), text.to_owned());
        SettableOption { name, text, source: None, message: None }
    }

    #[test]
    fn options_are_named_by_their_texts() {
        let texts = ["heat", "Heat/Cool", "heat cool", "", "heat", "++", "Küche"];
        let options = settable_options("mode", texts.map(said));
        let names: Vec<_> =
            options.expect("there are some").into_iter().map(|option| option.name).collect();
        let expected =
            ["mode-heat", "mode-heat-cool", "mode-heat-cool-2", "mode-unnamed", "mode-kueche"];
        assert_eq!(names, expected);
        let many = (0..1_000).map(|number| said(&number.to_string()));
        assert_eq!(settable_options("option", many).expect("some").len(), OPTIONS_MAX);
        assert!(settable_options("mode", [said("")]).is_err());
    }
}
