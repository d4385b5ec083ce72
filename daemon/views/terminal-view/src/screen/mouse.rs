//! The mouse: a click selects or opens a row, turns to a page, or goes to a moment of a recording;
//! the wheel moves the selection.

use live_view::{LiveView, Moment};
use ratatui::layout::Position;

use super::{Overlay, ViewScreen};
use crate::input::{MouseDeed, MouseInput, ViewAct};
use crate::keys::{KeyCommand, KeyPress, NamedKey};

impl ViewScreen {
    pub(super) fn mouse(
        &mut self,
        mouse: MouseInput,
        view: &LiveView,
        now: Moment,
    ) -> Option<ViewAct> {
        let at = Position { x: mouse.column, y: mouse.row };
        if let Overlay::Reading(reading) | Overlay::Plan { reading, .. } = &mut self.overlay {
            let (columns, height) = (self.areas.body.width, self.areas.body.height);
            let key = match mouse.deed {
                MouseDeed::WheelUp => NamedKey::Up,
                MouseDeed::WheelDown => NamedKey::Down,
                MouseDeed::Press => return None,
            };
            reading.press(KeyPress::Named(key), usize::from(columns), usize::from(height));
            return None;
        }
        if !matches!(self.overlay, Overlay::None) {
            return None;
        }
        match mouse.deed {
            MouseDeed::WheelUp => self.step(-1),
            MouseDeed::WheelDown => self.step(1),
            MouseDeed::Press => {
                if let Some((_, page)) = self.areas.tabs.iter().find(|(area, _)| area.contains(at))
                {
                    self.go_to(*page);
                } else if self.areas.slider.contains(at) {
                    return self.seek_to(mouse.column);
                } else if self.areas.body.contains(at) {
                    self.click(usize::from(mouse.row - self.areas.body.y), view, now);
                }
            }
        }
        None
    }

    fn click(&mut self, row: usize, view: &LiveView, now: Moment) {
        let Some(visit) = self.trail.last_mut() else { return };
        if visit.click(&self.sheet, visit.scroll + row) == Some(true) {
            let _ = self.execute(KeyCommand::Open, view, now);
        }
    }
}
