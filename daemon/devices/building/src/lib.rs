//! The simulated building: a world that has its own truth, whatever agents believe.
//!
//! Simulated drivers act on the building, the planner never sees it, and tests compare the claims of agents
//! with its truth. Start reading at [`Layout`] (the plan), then [`Building`] (what happens), then [`Truth`]
//! (what has really happened).
//!
//! - A **driver** has a [`BuildingHandle`], in-process or over a Unix socket, and can do only what its
//!   device can do.
//! - A **test or scenario** has the [`Building`] itself: it breaks and repairs devices, locks doors,
//!   changes temperatures and reads the truth. None of that is offered over the socket, so no agent can
//!   cheat.
//! - [`Layout::seeded`] draws another building for each seed, and [`check_scenario_1`] checks whether
//!   scenario 1 of the paper truly took place in it. [`MaintenanceScenario`] is scenario 2,
//!   [`AccessScenario`] is scenario 3, and [`MeetingScenario`] is Figure 1 of the paper. [`Campus`] draws a
//!   campus of any number of houses up to [`HOUSES_MAX`], with the files of its ecosystem.
//!
//! This crate leaves to others: the beliefs and messages of agents, PDDL beyond printing a map, and the
//! substrate.
//! **Invariant:** no code here uses Zenoh.

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
mod map;
mod measuring;
mod people;
mod quantity;
mod replay;
mod scenario_1;
mod scenario_2;
mod scenario_3;
mod scenario_4;
mod screen;
mod seeded;
mod seeded_random;
mod server;
mod session;
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
pub use quantity::Quantity;
pub use scenario_1::check_scenario_1;
pub use scenario_2::{MaintenanceScenario, SensorDeath};
pub use scenario_3::{AccessScenario, AnswerPattern, Visit, VisitOutcome};
pub use scenario_4::MeetingScenario;
pub use seeded::{DeathTime, SeededScenario};
pub use server::{Server, serve};
pub use truth::{BuildingEvent, DeviceFault, LOG_MAX, Occurrence, TemperatureReading, Truth};
