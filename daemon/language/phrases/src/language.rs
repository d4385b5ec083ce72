//! The languages in which goals are said.

/// A language with a words file of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Language {
    /// English: `words/en.toml`.
    #[default]
    English,
    /// German: `words/de.toml`.
    German,
}

// === impl Language ===

impl Language {
    /// All languages.
    pub const ALL: [Language; 2] = [Language::English, Language::German];

    /// Returns the tag of the language, as in BCP 47.
    pub fn tag(self) -> &'static str {
        match self {
            Language::English => "en",
            Language::German => "de",
        }
    }

    /// Returns the English name of the language.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Language::English => "English",
            Language::German => "German",
        }
    }

    /// Returns the language of a tag such as `de`, or of a locale such as `de_AT.UTF-8`; `None` if
    /// there are no words in it.
    pub fn from_tag(tag: &str) -> Option<Language> {
        let first = tag.split(['_', '-', '.', '@']).next().unwrap_or_default();
        Language::ALL.into_iter().find(|language| first.eq_ignore_ascii_case(language.tag()))
    }

    /// Returns the text of the words file of the language.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Language::English => include_str!("../words/en.toml"),
            Language::German => include_str!("../words/de.toml"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Language;

    #[test]
    fn a_locale_has_a_language() {
        assert_eq!(Language::from_tag("de_AT.UTF-8"), Some(Language::German));
        assert_eq!(Language::from_tag("EN"), Some(Language::English));
        assert_eq!(Language::from_tag("C.UTF-8"), None);
        assert_eq!(Language::from_tag(""), None);
    }
}
