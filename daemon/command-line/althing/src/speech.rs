//! How goals and facts are said to the person at a terminal, and how the person's words are read: in
//! a language, or in PDDL. Programs (`--json`) always get PDDL.

use std::collections::{BTreeMap, HashMap};
use std::sync::{LazyLock, Mutex, PoisonError, RwLock};

use phrases::{KnownNames, Language, NotUnderstood, OwnWords, Phrasebook};

/// Variable that makes the output PDDL, as `--pddl` does, if it is set and not `0`.
const PDDL_VARIABLE: &str = "ALTHING_PDDL";

/// Variables that name the language of a terminal, by precedence (POSIX, “Environment Variables”).
const LOCALE_VARIABLES: [&str; 3] = ["LC_ALL", "LC_MESSAGES", "LANG"];

/// The words that an ecosystem file adds, by language.
pub(crate) type WordsByLanguage = BTreeMap<Language, OwnWords>;

/// The words of this process; `None` until they are needed.
static SPEECH: RwLock<Option<Speech>> = RwLock::new(None);

#[derive(Clone)]
struct Speech {
    /// The words of all languages, the chosen one first.
    books: Vec<Phrasebook>,
    is_pddl: bool,
}

// === impl Speech ===

impl Speech {
    fn new(language: Language, is_pddl: bool) -> Speech {
        let others = Language::ALL.into_iter().filter(|other| *other != language);
        let languages = std::iter::once(language).chain(others);
        Speech { books: languages.map(Phrasebook::standard).collect(), is_pddl }
    }

    /// Returns the words in which goals are said; `None` if they are said in PDDL.
    fn said(&self) -> Option<&Phrasebook> {
        self.books.first().filter(|_| !self.is_pddl)
    }
}

/// Calls `ask` with the words of this process.
fn with_speech<T>(ask: impl FnOnce(&Speech) -> T) -> T {
    if let Some(speech) = &*SPEECH.read().unwrap_or_else(PoisonError::into_inner) {
        return ask(speech);
    }
    let mut words = SPEECH.write().unwrap_or_else(PoisonError::into_inner);
    ask(words.get_or_insert_with(|| Speech::new(Language::default(), false)))
}

/// Chooses the language: `language` if it is given, otherwise that of the environment; and PDDL
/// instead of words if `is_pddl` or the environment says so.
pub(crate) fn choose(language: Option<Language>, is_pddl: bool) {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let locale = LOCALE_VARIABLES.iter().find_map(|name| set(name));
    let language = language.or_else(|| Language::from_tag(&locale?)).unwrap_or_default();
    let is_pddl = is_pddl || set(PDDL_VARIABLE).is_some_and(|value| value != "0");
    let mut words = SPEECH.write().unwrap_or_else(PoisonError::into_inner);
    *words = Some(Speech::new(language, is_pddl));
}

/// Adds the words of an ecosystem file. Wrong words are left out; reading the file reports them.
pub(crate) fn learn(own: &WordsByLanguage) {
    if own.is_empty() {
        return;
    }
    let (language, is_pddl) = with_speech(|speech| {
        let language = speech.books.first().map(Phrasebook::language).unwrap_or_default();
        (language, speech.is_pddl)
    });
    let mut speech = Speech::new(language, is_pddl);
    for book in &mut speech.books {
        if let Some(own) = own.get(&book.language())
            && let Ok(with_own) = book.clone().with_own(own)
        {
            *book = with_own;
        }
    }
    *SPEECH.write().unwrap_or_else(PoisonError::into_inner) = Some(speech);
    SAID.lock().unwrap_or_else(PoisonError::into_inner).clear();
}

/// Whether goals and facts are said in words, and not in PDDL.
pub(crate) fn is_in_words() -> bool {
    with_speech(|speech| speech.said().is_some())
}

/// Says a goal or a fact that is given in PDDL. A text that is no PDDL stays as it is.
pub(crate) fn say(pddl: &str) -> String {
    with_speech(|speech| match speech.said() {
        Some(book) => book.print_pddl(pddl),
        None => pddl.to_owned(),
    })
}

/// Returns a sentence of an agent in which facts between backquotes are said in words.
pub(crate) fn sentence(text: &str) -> String {
    with_speech(|speech| match speech.said() {
        Some(book) => book.print_sentence(text),
        None => text.to_owned(),
    })
}

/// Maximum number of texts that are remembered in words: those of some pages of a view.
const SAID_MAX: usize = 8_192;

/// Longest text that is remembered in words, in bytes.
const SAID_BYTES_MAX: usize = 1_024;

/// The words of the last texts.
static SAID: LazyLock<Mutex<HashMap<String, String>>> = LazyLock::new(Mutex::default);

/// Returns a text in which goals and facts are said in words wherever they stand. The words of the
/// last texts are remembered, because a view says the same texts each time that it is drawn.
pub(crate) fn text(text: &str) -> String {
    if !text.contains('(') {
        return text.to_owned();
    }
    let remembered = SAID.lock().unwrap_or_else(PoisonError::into_inner).get(text).cloned();
    if let Some(remembered) = remembered {
        return remembered;
    }
    let said = with_speech(|speech| match speech.said() {
        Some(book) => book.print_text(text),
        None => text.to_owned(),
    });
    if text.len() <= SAID_BYTES_MAX {
        let mut remembered = SAID.lock().unwrap_or_else(PoisonError::into_inner);
        if remembered.len() >= SAID_MAX {
            remembered.clear();
        }
        remembered.insert(text.to_owned(), said.clone());
    }
    said
}

/// Reads a goal in the words of any language, and returns it in PDDL.
///
/// # Errors
///
/// Returns the answer of the language in which the text is nearest to one that is understood.
pub(crate) fn read(text: &str, names: &KnownNames) -> Result<String, NotUnderstood> {
    with_speech(|speech| {
        let mut answer: Option<NotUnderstood> = None;
        for book in &speech.books {
            match book.parse(text, names) {
                Ok(goal) => return Ok(goal),
                Err(wrong) => {
                    answer = Some(match answer {
                        Some(known) => known.nearer(wrong),
                        None => wrong,
                    });
                }
            }
        }
        Err(answer.unwrap_or_else(NotUnderstood::nothing))
    })
}

/// Returns the fact or the function that words are about; `None` if they are about none.
pub(crate) fn read_subject(text: &str) -> Option<String> {
    let names = KnownNames::default();
    let whole = read(text, &names);
    // A function alone is no goal; compared with a number it is one.
    whole.or_else(|_| read(&format!("{text} = 0"), &names)).ok()
}

/// Returns the offset of the word under the cursor, and the words that it can become, in the chosen
/// language.
pub(crate) fn complete(before: &str, names: &KnownNames) -> (usize, Vec<String>) {
    with_speech(|speech| match speech.books.first() {
        Some(book) => book.complete(before, names),
        None => (before.len(), Vec::new()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_are_said_in_words() {
        assert_eq!(say("(known-temperature office1)"), "temperature of office1 known");
        assert_eq!(say("(= (temperature a) 20.5)"), "temperature of a is 20.5 °C");
        assert_eq!(say("(odd office1)"), "(odd office1)");
        assert_eq!(say("no goal"), "no goal");
        assert_eq!(say("`(lit a)` and more"), "`(lit a)` and more");
        let all = ["ann asks for (lit a)", "ann asks for (lit a)", "no goal"].map(text);
        assert_eq!(all, ["ann asks for light in a on", "ann asks for light in a on", "no goal"]);
    }

    #[test]
    fn words_of_any_language_are_read() {
        let read = |text: &str| read(text, &KnownNames::default());
        assert_eq!(read("office1 swept").as_deref(), Ok("(swept office1)"));
        assert_eq!(read("office1 gekehrt").as_deref(), Ok("(swept office1)"));
        let wrong = read("Temperatur von office1 bekant").expect_err("a slip").to_string();
        assert!(wrong.contains("`Temperatur von office1 bekannt`"), "{wrong}");
        assert_eq!(read_subject("temperature of a").as_deref(), Some("(= (temperature a) 0)"));
        assert_eq!(read_subject("what is it"), None);
    }
}
