//! Reads the keys and the mouse of the terminal.

use std::sync::Arc;

use ratatui::crossterm::event::{
    Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers, MouseButton, MouseEvent, MouseEventKind,
};
use terminal_view::{KeyPress, MouseDeed, MouseInput, NamedKey, ViewInput};

use super::view_inbox::{ScreenInput, ViewInbox};

/// Reads the input of the terminal on a thread of its own, which ends with the process: reading
/// cannot be cancelled.
pub(super) fn read_in_background(inbox: &Arc<ViewInbox>) {
    let inbox = Arc::clone(inbox);
    std::thread::spawn(move || {
        while let Ok(event) = ratatui::crossterm::event::read() {
            inbox.push_input(ScreenInput::Terminal(event));
        }
        inbox.push_input(ScreenInput::Gone);
    });
}

/// Converts an event of the terminal; `None` if it means nothing to the screen.
pub(super) fn convert(event: Event) -> Option<ViewInput> {
    match event {
        Event::Key(key) => key_press(key).map(ViewInput::Key),
        Event::Mouse(mouse) => mouse_press(mouse).map(ViewInput::Mouse),
        Event::Paste(text) => Some(ViewInput::Paste(text)),
        Event::Resize(..) => Some(ViewInput::Resize),
        Event::FocusGained | Event::FocusLost => None,
    }
}

fn key_press(KeyEvent { code, modifiers, kind, .. }: KeyEvent) -> Option<KeyPress> {
    if kind == KeyEventKind::Release {
        return None;
    }
    let named = match code {
        KeyCode::Char(letter) if modifiers.contains(KeyModifiers::CONTROL) => {
            return Some(KeyPress::Control(letter.to_ascii_lowercase()));
        }
        KeyCode::Char(_) if modifiers.contains(KeyModifiers::ALT) => return None,
        KeyCode::Char(character) => return Some(KeyPress::Character(character)),
        KeyCode::Enter => NamedKey::Enter,
        KeyCode::Esc => NamedKey::Escape,
        KeyCode::Tab => NamedKey::Tab,
        KeyCode::BackTab => NamedKey::BackTab,
        KeyCode::Backspace => NamedKey::Backspace,
        KeyCode::Delete => NamedKey::Delete,
        KeyCode::Up => NamedKey::Up,
        KeyCode::Down => NamedKey::Down,
        KeyCode::Left => NamedKey::Left,
        KeyCode::Right => NamedKey::Right,
        KeyCode::Home => NamedKey::Home,
        KeyCode::End => NamedKey::End,
        KeyCode::PageUp => NamedKey::PageUp,
        KeyCode::PageDown => NamedKey::PageDown,
        _ => return None,
    };
    Some(KeyPress::Named(named))
}

fn mouse_press(MouseEvent { kind, column, row, .. }: MouseEvent) -> Option<MouseInput> {
    let deed = match kind {
        MouseEventKind::Down(MouseButton::Left) => MouseDeed::Press,
        MouseEventKind::ScrollUp => MouseDeed::WheelUp,
        MouseEventKind::ScrollDown => MouseDeed::WheelDown,
        _ => return None,
    };
    Some(MouseInput { deed, column, row })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_converted() {
        let key = |code, modifiers| convert(Event::Key(KeyEvent::new(code, modifiers)));
        let plain = KeyModifiers::NONE;
        let is = |input: Option<ViewInput>, press: KeyPress| {
            assert!(matches!(&input, Some(ViewInput::Key(key)) if *key == press), "{input:?}");
        };
        is(key(KeyCode::Char('G'), KeyModifiers::SHIFT), KeyPress::Character('G'));
        is(key(KeyCode::Char('c'), KeyModifiers::CONTROL), KeyPress::Control('c'));
        is(key(KeyCode::PageDown, plain), KeyPress::Named(NamedKey::PageDown));
        assert!(key(KeyCode::F(7), plain).is_none());
        assert!(convert(Event::FocusLost).is_none());
    }
}
