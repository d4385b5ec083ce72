//! The keys: one table says which key does what on which page. What a key press means, the line of
//! keys at the bottom, the help and the table of docs/view.md are all made from it.

mod bindings;

use std::fmt::Write as _;

pub(crate) use bindings::KEYS;

use crate::page::{PAGES, PageName};

/// A key without a letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NamedKey {
    /// Enter.
    Enter,
    /// Escape.
    Escape,
    /// The tabulator.
    Tab,
    /// Shift and the tabulator.
    BackTab,
    /// Deletes backwards.
    Backspace,
    /// Deletes forwards.
    Delete,
    /// Arrow up.
    Up,
    /// Arrow down.
    Down,
    /// Arrow left.
    Left,
    /// Arrow right.
    Right,
    /// To the start.
    Home,
    /// To the end.
    End,
    /// A page up.
    PageUp,
    /// A page down.
    PageDown,
}

/// A key that was pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum KeyPress {
    /// A character; letters are upper case if shift was held.
    Character(char),
    /// A letter with the control key.
    Control(char),
    /// Any other key.
    Named(NamedKey),
}

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KeyCommand {
    Up,
    Down,
    Left,
    Right,
    PageUp,
    PageDown,
    Top,
    Bottom,
    Open,
    Back,
    NextPage,
    PreviousPage,
    GoTo(PageName),
    Filter,
    Command,
    Help,
    Copy,
    Ask,
    Act,
    Answer,
    Admit,
    Cancel,
    Why,
    Stop,
    Release,
    Output,
    Words,
    Pause,
    StepBack,
    StepForward,
    SeekBack,
    SeekForward,
    Quit,
}

/// When a key counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KeyScope {
    /// Always.
    Always,
    /// While a running ecosystem is shown.
    Live,
    /// On these pages, while a running ecosystem is shown.
    LivePages(&'static [PageName]),
    /// While a recording is shown.
    Recording,
}

/// One row of the table.
#[derive(Debug)]
pub(crate) struct KeyBinding {
    /// The keys that do the same.
    pub(crate) keys: &'static [KeyPress],
    /// When they count.
    pub(crate) scope: KeyScope,
    /// What they do.
    pub(crate) command: KeyCommand,
    /// One word for the line at the bottom; empty if they are not shown there.
    pub(crate) short: &'static str,
    /// What they do, for the help.
    pub(crate) help: &'static str,
}

impl KeyScope {
    /// Whether a key of this scope counts on a page.
    pub(crate) fn holds(self, page: PageName, is_recording: bool) -> bool {
        match self {
            Self::Always => true,
            Self::Live => !is_recording,
            Self::LivePages(pages) => !is_recording && pages.contains(&page),
            Self::Recording => is_recording,
        }
    }

    /// Returns the words for the table of the document; empty if the key always counts.
    fn words(self) -> String {
        let list = |pages: &[PageName]| {
            let names: Vec<_> = pages.iter().map(|page| page.name()).collect();
            names.join(", ")
        };
        match self {
            Self::Always => "always".to_owned(),
            Self::Live => "not in a recording".to_owned(),
            Self::LivePages(pages) => format!("{}; not in a recording", list(pages)),
            Self::Recording => "in a recording".to_owned(),
        }
    }
}

impl KeyBinding {
    /// Returns the names of the keys.
    pub(crate) fn labels(&self) -> String {
        let labels: Vec<_> = self.keys.iter().map(|key| label(*key)).collect();
        labels.join(" ")
    }
}

/// Returns the name of a key.
pub(crate) fn label(key: KeyPress) -> String {
    let name = match key {
        KeyPress::Character(' ') => "Space",
        KeyPress::Character(character) => return character.to_string(),
        KeyPress::Control(character) => return format!("Ctrl-{}", character.to_ascii_uppercase()),
        KeyPress::Named(key) => match key {
            NamedKey::Enter => "Enter",
            NamedKey::Escape => "Esc",
            NamedKey::Tab => "Tab",
            NamedKey::BackTab => "Shift-Tab",
            NamedKey::Backspace => "Backspace",
            NamedKey::Delete => "Delete",
            NamedKey::Up => "↑",
            NamedKey::Down => "↓",
            NamedKey::Left => "←",
            NamedKey::Right => "→",
            NamedKey::Home => "Home",
            NamedKey::End => "End",
            NamedKey::PageUp => "PgUp",
            NamedKey::PageDown => "PgDn",
        },
    };
    name.to_owned()
}

/// Returns what a key does on a page; `None` if it does nothing there.
pub(crate) fn command(key: KeyPress, page: PageName, is_recording: bool) -> Option<KeyCommand> {
    if let KeyPress::Character(digit) = key
        && let Some(facts) = PAGES.iter().find(|facts| facts.digit == Some(digit))
    {
        return Some(KeyCommand::GoTo(facts.page));
    }
    bindings(page, is_recording)
        .find(|binding| binding.keys.contains(&key))
        .map(|binding| binding.command)
}

/// Iterates over the rows of the table that count on a page.
pub(crate) fn bindings(
    page: PageName,
    is_recording: bool,
) -> impl Iterator<Item = &'static KeyBinding> {
    KEYS.iter().filter(move |binding| binding.scope.holds(page, is_recording))
}

/// Returns the tables of pages and keys of docs/view.md, as Markdown.
pub fn key_tables() -> String {
    let mut text = "| key | page | shows |\n|---|---|---|\n".to_owned();
    for facts in PAGES {
        let key = facts.digit.map_or_else(|| "Enter".to_owned(), |digit| format!("`{digit}`"));
        let _ = writeln!(text, "| {key} | `{}` | {} |", facts.name, facts.shows);
    }
    text.push_str("\n| keys | what they do | when |\n|---|---|---|\n");
    for binding in KEYS {
        let keys: Vec<_> = binding.keys.iter().map(|key| format!("`{}`", label(*key))).collect();
        let (keys, when) = (keys.join(" "), binding.scope.words());
        let _ = writeln!(text, "| {keys} | {} | {when} |", binding.help);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_has_one_meaning_on_each_page() {
        for page in PageName::all() {
            for is_recording in [false, true] {
                let keys: Vec<_> =
                    bindings(page, is_recording).flat_map(|binding| binding.keys).collect();
                for key in &keys {
                    let count = keys.iter().filter(|other| other == &key).count();
                    assert_eq!(count, 1, "{key:?} on {page}");
                }
            }
        }
    }

    #[test]
    fn digits_open_pages_everywhere() {
        let command = |character| command(KeyPress::Character(character), PageName::Agent, true);
        assert_eq!(command('2'), Some(KeyCommand::GoTo(PageName::Goals)));
        assert_eq!(command('0'), Some(KeyCommand::GoTo(PageName::Goal)));
        assert_eq!(command('s'), None);
    }

    /// The table of docs/view.md is this one; `UPDATE_EXPECT=1` writes it anew.
    #[test]
    fn the_document_has_this_table() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../docs/view.md");
        let document = std::fs::read_to_string(path).expect("it is committed");
        let (before, rest) = document.split_once("<!-- keys -->\n").expect("a mark");
        let (table, after) = rest.split_once("<!-- /keys -->\n").expect("a mark");
        let expected = key_tables();
        if std::env::var_os("UPDATE_EXPECT").is_some() {
            let text = format!("{before}<!-- keys -->\n{expected}<!-- /keys -->\n{after}");
            std::fs::write(path, text).expect("a file");
        } else {
            assert_eq!(table, expected, "UPDATE_EXPECT=1 writes the table of docs/view.md anew");
        }
    }
}
