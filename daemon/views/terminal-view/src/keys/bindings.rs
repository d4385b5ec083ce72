//! The table of keys.

use super::{KeyBinding, KeyCommand, KeyPress, KeyScope, NamedKey};
use crate::page::PageName;

const fn c(character: char) -> KeyPress {
    KeyPress::Character(character)
}

const fn n(key: NamedKey) -> KeyPress {
    KeyPress::Named(key)
}

const fn row(
    keys: &'static [KeyPress],
    scope: KeyScope,
    command: KeyCommand,
    short: &'static str,
    help: &'static str,
) -> KeyBinding {
    KeyBinding { keys, scope, command, short, help }
}

/// The table of keys. In the line at the bottom, earlier rows win when there is little room.
pub(crate) const KEYS: &[KeyBinding] = &[
    row(&[c('?')], KeyScope::Always, KeyCommand::Help, "help", "shows the keys of this page"),
    row(&[c('q'), KeyPress::Control('c')], KeyScope::Always, KeyCommand::Quit, "quit", "quits"),
    row(
        &[c('s')],
        KeyScope::Live,
        KeyCommand::Stop,
        "stop",
        "stops everything, or what is named then; asks first",
    ),
    row(
        &[c('r')],
        KeyScope::Live,
        KeyCommand::Release,
        "release",
        "releases all stops that are in force; asks first",
    ),
    row(
        &[n(NamedKey::Enter)],
        KeyScope::Always,
        KeyCommand::Open,
        "open",
        "opens the page of the selected thing; answers the selected question",
    ),
    row(
        &[n(NamedKey::Escape), n(NamedKey::Backspace)],
        KeyScope::Always,
        KeyCommand::Back,
        "back",
        "ends the filter, or goes back to the page before",
    ),
    row(
        &[c('a')],
        KeyScope::Live,
        KeyCommand::Answer,
        "answer",
        "answers a question; a secret answer is typed hidden",
    ),
    row(
        &[c('A')],
        KeyScope::LivePages(&[PageName::Questions]),
        KeyCommand::Admit,
        "admit",
        "answers the selected question with yes, as when a discovered agent asks to take part",
    ),
    row(
        &[c('g')],
        KeyScope::Live,
        KeyCommand::Ask,
        "goal",
        "asks for a goal: shows its plan first; Tab there chooses whether it is kept",
    ),
    row(
        &[c('c')],
        KeyScope::LivePages(&[PageName::Overview, PageName::Goals, PageName::Goal]),
        KeyCommand::Cancel,
        "cancel",
        "cancels the selected goal; asks first",
    ),
    row(
        &[c(' ')],
        KeyScope::Recording,
        KeyCommand::Pause,
        "play",
        "plays the recording, or halts it",
    ),
    row(
        &[c(']')],
        KeyScope::Recording,
        KeyCommand::StepForward,
        "step",
        "goes to the next message of the recording",
    ),
    row(
        &[c('[')],
        KeyScope::Recording,
        KeyCommand::StepBack,
        "",
        "goes to the message before in the recording",
    ),
    row(
        &[c('}')],
        KeyScope::Recording,
        KeyCommand::SeekForward,
        "seek",
        "goes forward by a twentieth of the recording",
    ),
    row(
        &[c('{')],
        KeyScope::Recording,
        KeyCommand::SeekBack,
        "",
        "goes back by a twentieth of the recording",
    ),
    row(
        &[c('/')],
        KeyScope::Always,
        KeyCommand::Filter,
        "filter",
        "shows only rows that have all of the words typed then",
    ),
    row(
        &[c(':')],
        KeyScope::Always,
        KeyCommand::Command,
        "go",
        "goes to a page or a thing by its name; Tab completes it",
    ),
    row(
        &[c('w')],
        KeyScope::Live,
        KeyCommand::Why,
        "why",
        "asks why the selected thing is so (`althing why`)",
    ),
    row(
        &[c('y')],
        KeyScope::Always,
        KeyCommand::Copy,
        "copy",
        "copies the name of the selected thing",
    ),
    row(
        &[c('d')],
        KeyScope::Live,
        KeyCommand::Act,
        "",
        "asks for one action, such as (move turtlebot-1 corridor office1)",
    ),
    row(
        &[c('o')],
        KeyScope::Live,
        KeyCommand::Output,
        "",
        "shows the output of the last command that was run",
    ),
    row(
        &[c('p')],
        KeyScope::Always,
        KeyCommand::Words,
        "",
        "shows goals and facts in PDDL, or in words again",
    ),
    row(
        &[n(NamedKey::Up), c('k')],
        KeyScope::Always,
        KeyCommand::Up,
        "",
        "selects the row above; the wheel of a mouse does the same",
    ),
    row(
        &[n(NamedKey::Down), c('j')],
        KeyScope::Always,
        KeyCommand::Down,
        "",
        "selects the row below; a click selects a row, and opens the selected one",
    ),
    row(
        &[n(NamedKey::Left), c('h')],
        KeyScope::Always,
        KeyCommand::Left,
        "",
        "shows what is further left",
    ),
    row(
        &[n(NamedKey::Right), c('l')],
        KeyScope::Always,
        KeyCommand::Right,
        "",
        "shows what is further right, of tables all columns",
    ),
    row(
        &[n(NamedKey::PageUp), KeyPress::Control('b')],
        KeyScope::Always,
        KeyCommand::PageUp,
        "",
        "goes up by a screen",
    ),
    row(
        &[n(NamedKey::PageDown), KeyPress::Control('f')],
        KeyScope::Always,
        KeyCommand::PageDown,
        "",
        "goes down by a screen",
    ),
    row(&[n(NamedKey::Home)], KeyScope::Always, KeyCommand::Top, "", "selects the first row"),
    row(
        &[n(NamedKey::End), c('G')],
        KeyScope::Always,
        KeyCommand::Bottom,
        "",
        "selects the last row; on the page of activities, follows what is new",
    ),
    row(
        &[n(NamedKey::Tab)],
        KeyScope::Always,
        KeyCommand::NextPage,
        "",
        "goes to the next page of those at the top",
    ),
    row(
        &[n(NamedKey::BackTab)],
        KeyScope::Always,
        KeyCommand::PreviousPage,
        "",
        "goes to the page before",
    ),
];
