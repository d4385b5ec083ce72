//! Buildings and small helpers for the tests of this crate.

use crate::{Building, Event, Layout, Truth};

/// The paper's office, in real time on Tokio's (paused) clock.
pub(crate) fn office() -> Building {
    Building::new(Layout::seeded(0).layout, 1.0).expect("the time scale is possible")
}

/// Returns the log, one line per occurrence, in the form that tests expect.
pub(crate) fn story(truth: &Truth) -> Vec<String> {
    truth.occurrences().map(|occurrence| line(&occurrence.event)).collect()
}

fn line(event: &Event) -> String {
    match event {
        Event::Asked { sensor } => format!("{sensor} is asked"),
        Event::Read { sensor, location, celsius } => format!("{sensor} reads {location} {celsius}"),
        Event::Measured { sensor, location, quantity, value } => {
            format!("{sensor} measures {location} {} {value}", quantity.name())
        }
        Event::Departed { robot, from, to } => format!("{robot} departs {from} {to}"),
        Event::Moved { robot, from, to } => format!("{robot} moves {from} {to}"),
        Event::Stayed { robot, at } => format!("{robot} stays {at}"),
        Event::Recharged { robot, at } => format!("{robot} is recharged at {at}"),
        Event::Swept { robot, location } => format!("{robot} sweeps {location}"),
        Event::ChargeSet { robot, meters } => format!("{robot} can drive {meters} m"),
        Event::Aimed { camera, aim } => {
            format!("{camera} looks at {} {} {}", aim.pan, aim.tilt, aim.zoom)
        }
        Event::Allocated { screen, channel } => format!("{screen} has channel {channel}"),
        Event::Shown { screen, text } => format!("{screen} shows {text}"),
        Event::Darkened { screen } => format!("{screen} goes dark"),
        Event::Entered { person, location } => format!("{person} enters {location}"),
        Event::Left { person, location } => format!("{person} leaves {location}"),
        Event::Stirs { location } => format!("{location} stirs"),
        Event::Rests { location } => format!("{location} rests"),
        Event::Broken { device, fault } => format!("{device} breaks {fault:?}"),
        Event::Repaired { device } => format!("{device} is repaired"),
        Event::TemperatureSet { location, celsius } => format!("{location} becomes {celsius}"),
        Event::ValueSet { location, quantity, value } => {
            format!("{location} has {} {value}", quantity.name())
        }
        Event::Locked { a, b } => format!("{a} {b} is locked"),
        Event::Unlocked { a, b } => format!("{a} {b} is unlocked"),
        Event::Added { device } => format!("{device} is added"),
        Event::Removed { device } => format!("{device} is removed"),
    }
}
