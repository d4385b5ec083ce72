//! Random choice of the places of a building: rooms, corridors, doors, distances, temperatures.

use crate::error::LayoutError;
use crate::layout::Layout;
use crate::seeded_random::Random;

pub(crate) const ROOMS: [&str; 16] = [
    "archive",
    "atelier",
    "canteen",
    "clinic",
    "kitchen",
    "lab",
    "library",
    "lounge",
    "office1",
    "office2",
    "office3",
    "server-room",
    "store",
    "studio",
    "ward",
    "workshop",
];
pub(crate) const CORRIDORS: [&str; 6] =
    ["arcade", "corridor", "gallery", "hall", "lobby", "passage"];
pub(crate) const ROBOTS: [&str; 4] = ["turtlebot-1", "turtlebot-2", "rover", "trolley"];

/// Returns the places of the paper's test bed: two offices, a conference room, one corridor. The
/// paper gives no distances and no temperatures; the values here are Althing's own.
pub(crate) fn paper_places() -> Result<Layout, LayoutError> {
    let mut layout = Layout::new();
    layout
        .add_room("office1", 20.5)?
        .add_room("office2", 21.5)?
        .add_room("conf-room", 22.5)?
        .add_corridor("corridor", 19.0)?
        .connect("corridor", "office1", 4.0)?
        .connect("corridor", "office2", 6.0)?
        .connect("corridor", "conf-room", 8.0)?;
    Ok(layout)
}

/// Returns the name of the sensor that is fixed in `room`.
pub(crate) fn sensor_of(room: &str) -> String {
    format!("thermometer-{room}")
}

/// The random choices for the places of one seed.
pub(crate) struct LayoutDraw {
    pub(crate) random: Random,
    pub(crate) rooms: Vec<&'static str>,
    pub(crate) corridors: Vec<&'static str>,
    /// True temperatures of the rooms. All are different, so that a value that is reported for the
    /// wrong room is detected.
    pub(crate) temperatures: Vec<f64>,
}

impl LayoutDraw {
    pub(crate) fn new(seed: u64) -> LayoutDraw {
        let mut random = Random::new(seed);
        let rooms_count = random.between(3, 7);
        let corridors_count = random.between(1, 3);
        let tenths: Vec<usize> = (160..=280).collect();
        // One temperature more than locations: the additional one is set after the failure of the
        // sensor.
        let tenths = random.sample(&tenths, rooms_count + corridors_count + 1);
        LayoutDraw {
            rooms: random.sample(&ROOMS, rooms_count),
            corridors: random.sample(&CORRIDORS, corridors_count),
            temperatures: tenths.iter().map(|tenth| *tenth as f64 / 10.0).collect(),
            random,
        }
    }

    fn add_locations(&self, layout: &mut Layout) -> Result<(), LayoutError> {
        let mut temperatures = self.temperatures.iter();
        for (room, celsius) in self.rooms.iter().zip(&mut temperatures) {
            layout.add_room(room, *celsius)?;
        }
        for (corridor, celsius) in self.corridors.iter().zip(&mut temperatures) {
            layout.add_corridor(corridor, *celsius)?;
        }
        Ok(())
    }

    /// Returns a layout with the locations and the doors between them.
    pub(crate) fn places(&mut self) -> Result<Layout, LayoutError> {
        let mut layout = Layout::new();
        self.add_locations(&mut layout)?;
        self.connect_all(&mut layout)?;
        self.add_doors(&mut layout)?;
        Ok(layout)
    }

    /// Connects all locations as a tree: each corridor to an earlier corridor, and each room to a
    /// corridor or, in one case of four, to an earlier room. As a result, every location can be
    /// reached from every other.
    fn connect_all(&mut self, layout: &mut Layout) -> Result<(), LayoutError> {
        for index in 1..self.corridors.len() {
            let to = self.random.below(index);
            let meters = self.meters();
            layout.connect(self.corridors[to], self.corridors[index], meters)?;
        }
        for index in 0..self.rooms.len() {
            let through_a_room = index > 0 && self.random.once_in(4);
            let from = if through_a_room {
                self.rooms[self.random.below(index)]
            } else {
                self.corridors[self.random.below(self.corridors.len())]
            };
            let meters = self.meters();
            layout.connect(from, self.rooms[index], meters)?;
        }
        Ok(())
    }

    /// Adds a few more doors, so that there is more than one way between some locations.
    fn add_doors(&mut self, layout: &mut Layout) -> Result<(), LayoutError> {
        let places: Vec<&str> = self.rooms.iter().chain(&self.corridors).copied().collect();
        for _ in 0..self.random.below(self.rooms.len()) {
            let ends = self.random.sample(&places, 2);
            let meters = self.meters();
            if layout.meters(ends[0], ends[1]).is_none() {
                layout.connect(ends[0], ends[1], meters)?;
            }
        }
        Ok(())
    }

    /// Draws a distance from 1 to 20 meters, in half meters.
    fn meters(&mut self) -> f64 {
        self.random.between(2, 40) as f64 / 2.0
    }
}
