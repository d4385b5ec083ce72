//! Buildings and small helpers for the tests of this crate.

use crate::{Building, BuildingEvent, Layout, Truth};

/// Returns the simulated building of seed 0, which is the paper's office. Its durations are those
/// of reality, measured by Tokio's clock; while a test pauses that clock, no time passes.
pub(crate) fn office() -> Building {
    Building::new(Layout::seeded(0).layout, 1.0).expect("the time scale is possible")
}

/// Returns the log of the building: one line per occurrence, in the form that the tests expect.
pub(crate) fn log_lines(truth: &Truth) -> Vec<String> {
    truth.occurrences().map(|occurrence| line(&occurrence.event)).collect()
}

fn line(event: &BuildingEvent) -> String {
    match event {
        BuildingEvent::Asked { sensor } => format!("{sensor} is asked"),
        BuildingEvent::Read { sensor, location, celsius } => {
            format!("{sensor} reads {location} {celsius}")
        }
        BuildingEvent::Measured { sensor, location, quantity, value } => {
            format!("{sensor} measures {location} {} {value}", quantity.name())
        }
        BuildingEvent::Departed { robot, from, to } => format!("{robot} departs {from} {to}"),
        BuildingEvent::Moved { robot, from, to } => format!("{robot} moves {from} {to}"),
        BuildingEvent::Stayed { robot, at } => format!("{robot} stays {at}"),
        BuildingEvent::Recharged { robot, at } => format!("{robot} is recharged at {at}"),
        BuildingEvent::Swept { robot, location } => format!("{robot} sweeps {location}"),
        BuildingEvent::ChargeSet { robot, meters } => format!("{robot} can drive {meters} m"),
        BuildingEvent::Aimed { camera, aim } => {
            format!("{camera} looks at {} {} {}", aim.pan, aim.tilt, aim.zoom)
        }
        BuildingEvent::Allocated { screen, channel } => format!("{screen} has channel {channel}"),
        BuildingEvent::Shown { screen, text } => format!("{screen} shows {text}"),
        BuildingEvent::Darkened { screen } => format!("{screen} goes dark"),
        BuildingEvent::Entered { person, location } => format!("{person} enters {location}"),
        BuildingEvent::Left { person, location } => format!("{person} leaves {location}"),
        BuildingEvent::Stirs { location } => format!("{location} stirs"),
        BuildingEvent::Rests { location } => format!("{location} rests"),
        BuildingEvent::Broken { device, fault } => format!("{device} breaks {fault:?}"),
        BuildingEvent::Repaired { device } => format!("{device} is repaired"),
        BuildingEvent::TemperatureSet { location, celsius } => {
            format!("{location} becomes {celsius}")
        }
        BuildingEvent::ValueSet { location, quantity, value } => {
            format!("{location} has {} {value}", quantity.name())
        }
        BuildingEvent::Locked { a, b } => format!("{a} {b} is locked"),
        BuildingEvent::Unlocked { a, b } => format!("{a} {b} is unlocked"),
        BuildingEvent::CabinMoved { lift, from, to } => format!("{lift} goes {from} {to}"),
        BuildingEvent::TakenUp { robot, parcel, at } => format!("{robot} takes {parcel} at {at}"),
        BuildingEvent::SetDown { robot, parcel, at } => {
            format!("{robot} sets {parcel} down at {at}")
        }
        BuildingEvent::Gripped { arm, parcel } => format!("{arm} grips {parcel}"),
        BuildingEvent::PutBack { arm, parcel } => format!("{arm} puts {parcel} back"),
        BuildingEvent::Loaded { arm, robot, parcel, at } => {
            format!("{arm} loads {parcel} on {robot} at {at}")
        }
        BuildingEvent::TableCarried { robots: [one, other], table, from, to } => {
            format!("{one} and {other} carry {table} {from} {to}")
        }
        BuildingEvent::Added { device } => format!("{device} is added"),
        BuildingEvent::Removed { device } => format!("{device} is removed"),
    }
}
