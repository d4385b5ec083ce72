//! The simulated building: a world with a true state of its own, independent of the beliefs of
//! agents.
//!
//! Simulated drivers act on the building, the planner has no access to it, and tests compare the
//! claims of agents with its truth. Start reading at [`Layout`] (the plan), then [`Building`] (the
//! operations), then [`Truth`] (the true state and the log).
//!
//! - A **driver** has a [`BuildingHandle`], in-process or over a Unix socket, and is limited to the
//!   abilities of its device.
//! - A **test or scenario** has the [`Building`] itself: it breaks and repairs devices, locks
//!   doors, changes temperatures and reads the truth. The socket offers none of these operations,
//!   so that no agent can cheat.
//! - [`Layout::seeded`] draws another building for each seed, and [`check_scenario_1`] checks
//!   whether scenario 1 of the paper truly took place in it. [`MaintenanceScenario`] is scenario 2,
//!   [`AccessScenario`] is scenario 3, and [`MeetingScenario`] is Figure 1 of the paper. In
//!   [`ParcelScenario`], [`FloorsScenario`], [`ArmScenario`] and [`TableScenario`] agents need each other. [`Campus`]
//!   draws a campus of any number of houses up to [`HOUSES_MAX`], with the files of its ecosystem.
//!
//! Other crates contain the beliefs and messages of agents, the PDDL parser, and the substrate.
//! **Invariant:** no code here uses Zenoh.

mod arms;
mod battery;
mod bounds;
mod building;
mod camera;
mod camera_aim;
mod campus;
mod cleaning;
mod client;
mod draw;
mod driver_requests;
mod error;
mod handle;
mod layout;
mod lifted_table;
mod map;
mod measuring;
mod parcel_place;
mod parcels;
mod people;
mod quantity;
mod replay;
mod scenario_1;
mod scenario_2;
mod scenario_3;
mod scenario_4;
mod scenario_5;
mod scenario_6;
mod scenario_7;
mod scenario_8;
mod screen;
mod seeded;
mod seeded_random;
mod server;
mod session;
mod tables;
mod truth;
mod wire;
mod world;

#[cfg(test)]
mod fixture;

pub use building::Building;
pub use camera_aim::CameraAim;
pub use campus::{Campus, DEVICES_PER_HOUSE, HOUSES_MAX};
pub use driver_requests::{CameraView, MeasuredValue, ScreenState, SeenPlace};
pub use error::{DeviceError, LayoutError, ServeError};
pub use handle::BuildingHandle;
pub use layout::{
    BuildingDevice, Layout, Location, LocationConnection, LocationKind, PlaceDirection,
    RobotBattery,
};
pub use parcel_place::ParcelPlace;
pub use quantity::Quantity;
pub use scenario_1::check_scenario_1;
pub use scenario_2::{MaintenanceScenario, SensorDeath};
pub use scenario_3::{AccessScenario, AnswerPattern, Visit, VisitOutcome};
pub use scenario_4::MeetingScenario;
pub use scenario_5::ParcelScenario;
pub use scenario_6::FloorsScenario;
pub use scenario_7::ArmScenario;
pub use scenario_8::TableScenario;
pub use seeded::{DeathTime, SeededScenario};
pub use server::{Server, serve};
pub use truth::{BuildingEvent, DeviceFault, LOG_MAX, Occurrence, TemperatureReading, Truth};
