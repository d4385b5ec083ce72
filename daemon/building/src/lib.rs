//! The simulated building: a world with its own truth.
//!
//! Simulated drivers act on it, the planner never sees it, and tests check the
//! claims of the agents against it. Start reading at [`Layout`] (what is built),
//! then [`Building`] (what happens), then [`Truth`] (what really happened).
//!
//! - A **driver** holds a [`BuildingHandle`], in-process or over a Unix socket,
//!   and can do only what its device can do.
//! - **Fate** (a test, a scenario) holds the [`Building`] itself: it breaks and
//!   repairs devices, locks doors, changes temperatures and reads the truth.
//!   None of that is reachable over the socket, so no agent can cheat.
//! - [`Layout::seeded`] draws another building per seed, and [`check_scenario_1`]
//!   says whether the paper's scenario 1 truly came to pass in it; [`Maintenance`],
//!   [`Access`] and [`Meeting`] are scenarios 2, 3 and Figure 1. [`Campus`] is
//!   drawn as large as is asked, with the files of its ecosystem.
//!
//! Left to others: what an agent knows or says, PDDL beyond printing a map, and
//! the substrate. **Invariant:** nothing here speaks Zenoh.

mod battery;
mod building;
mod camera;
mod campus;
mod cleaning;
mod client;
mod draw;
mod error;
mod handle;
mod layout;
mod map;
mod measuring;
mod people;
mod quantity;
mod random;
mod replay;
mod scenario_1;
mod scenario_2;
mod scenario_3;
mod scenario_4;
mod screen;
mod seeded;
mod server;
mod session;
mod truth;
mod wire;
mod world;

#[cfg(test)]
mod fixture;

pub use battery::Battery;
pub use building::Building;
pub use camera::{Aim, SeenPlace, Sight, View};
pub use campus::{Campus, DEVICES_PER_HOUSE, HOUSES_MAX};
pub use error::{DeviceError, LayoutError, ServeError};
pub use handle::BuildingHandle;
pub use layout::{Connection, Device, Layout, Location, LocationKind};
pub use measuring::Measured;
pub use quantity::Quantity;
pub use scenario_1::check_scenario_1;
pub use scenario_2::{Death, Maintenance};
pub use scenario_3::{Access, Admission, Manner, Visit};
pub use scenario_4::Meeting;
pub use screen::Panel;
pub use seeded::{Dies, SeededScenario};
pub use server::{Server, serve};
pub use truth::{Event, Fault, LOG_MAX, Occurrence, Reading, Truth};
