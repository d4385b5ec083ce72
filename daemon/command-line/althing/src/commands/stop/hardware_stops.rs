//! The positions of hardware stops, as the actuators of all daemons know them.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use acl::AgentId;
use acl::content::{ButtonPosition, StopState};
use serde_json::{Value, json};

/// Number of actuators that know each position of one hardware stop.
#[derive(Debug, Default, PartialEq, Eq)]
pub(in crate::commands) struct KnownPosition {
    pressed: usize,
    not_pressed: usize,
    /// Number of actuators that do not know the position.
    silent: usize,
}

/// Returns the position of each hardware stop.
pub(in crate::commands) fn positions(states: &[StopState]) -> BTreeMap<AgentId, KnownPosition> {
    let mut positions: BTreeMap<AgentId, KnownPosition> = BTreeMap::new();
    for report in states.iter().flat_map(|state| &state.buttons) {
        let known = positions.entry(report.button.clone()).or_default();
        match report.position {
            ButtonPosition::Pressed => known.pressed += 1,
            ButtonPosition::NotPressed => known.not_pressed += 1,
            ButtonPosition::Unknown | ButtonPosition::Silent | ButtonPosition::Other => {
                known.silent += 1;
            }
        }
    }
    positions
}

/// Returns a line for a person for each hardware stop.
pub(super) fn described(positions: &BTreeMap<AgentId, KnownPosition>) -> String {
    let mut text = String::new();
    for (button, known) in positions {
        let position = if known.pressed > 0 { "PRESSED" } else { "not pressed" };
        let _ = match silence(known) {
            Some(silence) => writeln!(text, "hardware stop {button}: {silence}"),
            None => writeln!(text, "hardware stop {button}: {position}"),
        };
    }
    text
}

/// Returns a line for a person for each hardware stop that some actuators do not hear.
pub(in crate::commands) fn warnings(positions: &BTreeMap<AgentId, KnownPosition>) -> Vec<String> {
    let warning = |(button, known): (&AgentId, &KnownPosition)| {
        Some(format!("hardware stop {button}: {}", silence(known)?))
    };
    positions.iter().filter_map(warning).collect()
}

fn silence(known: &KnownPosition) -> Option<String> {
    let KnownPosition { pressed, not_pressed, silent } = known;
    let all = pressed + not_pressed + silent;
    (*silent > 0).then(|| {
        format!("SILENT for {silent} of {all} actuators: it is unplugged, absent or just starting")
    })
}

/// Returns the positions for programs.
pub(super) fn value(positions: &BTreeMap<AgentId, KnownPosition>) -> Value {
    let value = |known: &KnownPosition| {
        let KnownPosition { pressed, not_pressed, silent } = known;
        json!({ "pressed": pressed, "not_pressed": not_pressed, "silent": silent })
    };
    positions.iter().map(|(button, known)| (button.to_string(), value(known))).collect()
}

#[cfg(test)]
mod tests {
    use acl::content::ButtonReport;

    use super::*;

    #[test]
    fn a_button_that_some_do_not_hear_is_told() {
        let agent = |name: &str| AgentId::new(name).expect("a name");
        let state = |name: &str, position: ButtonPosition| {
            let buttons = vec![ButtonReport { button: agent("button"), position }];
            StopState { agent: agent(name), stops: Vec::new(), buttons }
        };
        let one = |position: ButtonPosition| positions(&[state("a", position)]);
        assert_eq!(described(&one(ButtonPosition::Pressed)), "hardware stop button: PRESSED\n");
        let quiet = described(&one(ButtonPosition::NotPressed));
        assert_eq!(quiet, "hardware stop button: not pressed\n");
        assert_eq!(warnings(&one(ButtonPosition::NotPressed)), [""; 0]);
        let some = [state("a", ButtonPosition::NotPressed), state("b", ButtonPosition::Silent)];
        let warnings = warnings(&positions(&some));
        assert!(warnings[0].starts_with("hardware stop button: SILENT for 1 of 2"), "{warnings:?}");
    }
}
