//! A campus: up to 26 houses with twenty simulated devices each, and the file of its ecosystem.
//!
//! A campus is for tests of sizes that are too large to write by hand. `examples/campus` writes
//! `ecosystems/campus.toml`; benchmarks use larger and smaller campuses. The same seed gives the
//! same campus on every machine.

use std::fmt::Write as _;

use crate::error::LayoutError;
use crate::layout::{BuildingDevice, Layout};
use crate::seeded_random::Random;

/// Maximum number of houses, because one letter names each house.
pub const HOUSES_MAX: usize = 26;

/// Number of devices of a house: a thermometer in each equipped room, two robots, and a sensor on
/// each robot.
pub const DEVICES_PER_HOUSE: usize = EQUIPPED + 2 * ROBOTS;

const ROOMS: usize = 20;
const EQUIPPED: usize = 16;
const ROBOTS: usize = 2;
const _: () = assert!(EQUIPPED < ROOMS && DEVICES_PER_HOUSE == 20);

/// The location that all houses are connected to.
const QUAD: &str = "quad";

/// The `[timing]` section of the ecosystem file. The deadline is long, because a robot can measure
/// in every room of the campus, and therefore plans a way to each room for each call for proposals.
const TIMING: &str = "\
[timing]
# Robots bid for each of the rooms. Where one machine hosts all of them, that takes seconds.
proposals-deadline = \"20s\"

";

/// A campus: its building, and the file of its ecosystem.
#[derive(Clone, Debug)]
pub struct Campus {
    seed: u64,
    houses: usize,
    layout: Layout,
}

impl Campus {
    /// Returns the campus of this seed. The number of houses is clamped to the range from 1 to
    /// [`HOUSES_MAX`].
    pub fn seeded(seed: u64, houses: usize) -> Campus {
        let houses = houses.clamp(1, HOUSES_MAX);
        let layout = draw(&mut Random::new(seed), houses)
            .expect("invariant: names and ranges stay within what a layout allows");
        Campus { seed, houses, layout }
    }

    /// Returns the layout of the campus's building.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the map as PDDL, for the ontology named `ontology`.
    pub fn map(&self, ontology: &str) -> String {
        self.layout.map_pddl(ontology)
    }

    /// Returns the ecosystem file, for the standard ontology.
    ///
    /// Each house has a daemon for the devices of the house. One more daemon hosts the agents that
    /// plan.
    pub fn ecosystem(&self) -> String {
        let Campus { seed, houses, layout } = self;
        let devices = layout.devices().len();
        let mut text = format!(
            "# A campus of {houses} houses with {devices} devices, generated from the seed {seed}:\n\
             # see domains/campus/README.md.\n\n\
             [ecosystem]\nname = \"campus\"\nmode = \"decentralized\"\n\
             reasoning = \"reasoning\"\n\n{}\n",
            layout.map_tables()
        );
        for device in layout.devices() {
            text.push_str(&self.device_entry(device));
        }
        text.push_str(&self.goals());
        text.push_str(TIMING);
        text.push_str("[building]\ntime-scale = 1.0\n\n[building.temperatures]\n");
        for place in layout.locations() {
            push(&mut text, format_args!("{} = {:?}\n", place.name, place.celsius));
        }
        text
    }

    fn device_entry(&self, device: &BuildingDevice) -> String {
        let (plugin, place, config) = match device {
            BuildingDevice::FixedSensor { location, .. } => {
                ("temperature-sensor", location, format!("location = \"{location}\""))
            }
            BuildingDevice::Sensor { location, quantity, .. } => {
                let quantity = quantity.name();
                let config = format!("location = \"{location}\", quantity = \"{quantity}\"");
                ("sensor", location, config)
            }
            BuildingDevice::Robot { start, meters_per_second, .. } => {
                ("turtlebot", start, format!("start = \"{start}\", speed = {meters_per_second:?}"))
            }
            BuildingDevice::MountedSensor { carrier, .. } => {
                let place = self.layout.start_of(carrier).unwrap_or(QUAD);
                let config = format!("mounted-on = \"{carrier}\"");
                return entry(device.name(), "ir-temperature-sensor", &daemon_of(place), &config);
            }
            BuildingDevice::Camera { .. }
            | BuildingDevice::Screen { .. }
            | BuildingDevice::MountedScreen { .. }
            | BuildingDevice::Door { .. }
            | BuildingDevice::Lift { .. }
            | BuildingDevice::Arm { .. }
            | BuildingDevice::TagReader { .. } => {
                unreachable!("invariant: `draw` puts no such devices into a campus")
            }
        };
        entry(device.name(), plugin, &daemon_of(place), &config)
    }

    fn goals(&self) -> String {
        let in_a = |room: &&str| house_of(room) == "a";
        let known: Vec<_> = self
            .layout
            .rooms()
            .filter(in_a)
            .map(|room| format!("(known-temperature {room})"))
            .collect();
        format!(
            "[goals]\ntemperatures = \"(forall (?r - room) (known-temperature ?r))\"\n\
             house-a = \"(and {})\"\n\n",
            known.join(" ")
        )
    }
}

/// Returns the name of the daemon that hosts the devices of a place.
fn daemon_of(place: &str) -> String {
    format!("house-{}", house_of(place))
}

/// Returns the letter of the house of a place, which is the prefix of the place's name. Returns the
/// whole name if it has no prefix.
fn house_of(place: &str) -> &str {
    place.split_once('-').map_or(place, |(house, _)| house)
}

fn entry(name: &str, plugin: &str, daemon: &str, config: &str) -> String {
    format!(
        "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndaemon = \"{daemon}\"\n\
         config = {{ {config} }}\n\n"
    )
}

// === Drawing ===

/// Draws houses around the quad. Each house has a hall, and two wings with ten rooms each.
fn draw(random: &mut Random, houses: usize) -> Result<Layout, LayoutError> {
    let mut layout = Layout::new();
    layout.add_corridor(QUAD, celsius(random))?;
    for letter in ('a'..='z').take(houses) {
        let rooms = add_places(&mut layout, random, letter)?;
        add_devices(&mut layout, random, letter, &rooms)?;
    }
    Ok(layout)
}

fn add_places(
    layout: &mut Layout,
    random: &mut Random,
    letter: char,
) -> Result<Vec<String>, LayoutError> {
    let hall = format!("{letter}-hall");
    layout.add_corridor(&hall, celsius(random))?;
    layout.connect(QUAD, &hall, random.between(40, 120) as f64)?;
    let mut rooms = Vec::new();
    for wing in 1..=2 {
        let corridor = format!("{letter}-wing-{wing}");
        layout.add_corridor(&corridor, celsius(random))?;
        layout.connect(&hall, &corridor, random.between(5, 20) as f64)?;
        for number in 1..=ROOMS / 2 {
            let room = format!("{letter}-{wing}{number:02}");
            layout.add_room(&room, celsius(random))?;
            layout.connect(&corridor, &room, random.between(4, 40) as f64 / 2.0)?;
            rooms.push(room);
        }
    }
    Ok(rooms)
}

fn add_devices(
    layout: &mut Layout,
    random: &mut Random,
    letter: char,
    rooms: &[String],
) -> Result<(), LayoutError> {
    let numbers: Vec<usize> = (0..rooms.len()).collect();
    let mut equipped = random.sample(&numbers, EQUIPPED);
    equipped.sort_unstable();
    for number in equipped {
        let room = &rooms[number];
        layout.add_fixed_sensor(&format!("thermometer-{room}"), room)?;
    }
    for number in 1..=ROBOTS {
        let robot = format!("porter-{letter}{number}");
        let meters_per_second = random.between(3, 10) as f64 / 10.0;
        layout.add_robot(&robot, &format!("{letter}-wing-{number}"), meters_per_second)?;
        layout.mount(&format!("ir-{letter}{number}"), &robot)?;
    }
    Ok(())
}

/// Draws a temperature from 16 to 26 °C, in tenths of a degree.
fn celsius(random: &mut Random) -> f64 {
    random.between(160, 260) as f64 / 10.0
}

fn push(text: &mut String, piece: std::fmt::Arguments<'_>) {
    text.write_fmt(piece).expect("invariant: writing to a String cannot fail");
}

#[cfg(test)]
mod tests {
    use super::{Campus, DEVICES_PER_HOUSE, HOUSES_MAX};

    #[test]
    fn every_house_has_its_devices_and_every_room_can_be_measured() {
        for (asked, houses) in [(0, 1), (1, 1), (5, 5), (99, HOUSES_MAX)] {
            let campus = Campus::seeded(7, asked);
            let layout = campus.layout();
            assert_eq!(layout.devices().len(), houses * DEVICES_PER_HOUSE);
            let reached = layout.measurable_by_robots();
            assert!(layout.rooms().all(|room| reached.contains(room)), "{asked} houses");
        }
    }

    /// Checks the file in the repository against the seed in the README of the campus.
    #[test]
    fn the_campus_file_in_the_repository_matches_its_seed() {
        let campus = Campus::seeded(1, 5);
        let file = include_str!("../../../../ecosystems/campus.toml");
        assert!(file == campus.ecosystem(), "campus.toml");
    }
}
