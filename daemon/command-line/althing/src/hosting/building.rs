//! The simulated building of an ecosystem: built from the map and from the entries of the agents.

use std::collections::{BTreeMap, BTreeSet};

use ::building::{
    Building, BuildingDevice, Layout, LayoutError, PlaceDirection, Quantity, RobotBattery,
};
use acl::AgentId;
use pddl::{InitElement, Name, Problem, Span, Term, Types};
use serde_json::Value;

use crate::config::{AgentEntry, Ecosystem, MistakeLocation};

/// Temperature of a place for which the ecosystem file gives none, in °C.
const CELSIUS: f64 = 20.0;

/// Distance between two connected places for which the map gives none, in meters.
const METERS: f64 = 5.0;

/// Defaults for the entries of robots: the time to recharge a battery in seconds (`RECHARGE_TIME`),
/// and the distance to a pose in meters (`POSE_METERS`).
const RECHARGE_TIME: f64 = 600.0;
const POSE_METERS: f64 = 1.0;

/// The reason why the building cannot be simulated, and the place in the ecosystem's files that
/// causes it. The message completes the sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
#[error("simulate the building: {problem}")]
pub(crate) struct SimulationError {
    /// The place in the ecosystem's files where the mistake is written.
    pub(crate) place: MistakeLocation,
    /// The mistake that prevents simulation.
    #[source]
    pub(crate) problem: SimulationProblem,
}

/// A mistake that prevents the simulation of a building. The message completes the sentence “failed
/// to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum SimulationProblem {
    /// The map and the entries of agents contradict each other.
    #[error("{0}")]
    Layout(#[from] LayoutError),
    /// An agent's entry lacks a key that the building needs.
    #[error("read the config of `{agent}`: it needs `{key}`")]
    Config {
        /// Name of the agent with the incomplete entry.
        agent: String,
        /// The missing key.
        key: &'static str,
    },
    /// An entry names a quantity that the simulated building does not have.
    #[error("find the quantity `{name}`; known are {}", known())]
    Quantity {
        /// The name of the quantity, as the entry writes it.
        name: String,
    },
}

/// Adds to an error the place where the mistake is written.
trait WithLocation<T> {
    fn at(self, place: impl FnOnce() -> MistakeLocation) -> Result<T, SimulationError>;
}

impl<T, E: Into<SimulationProblem>> WithLocation<T> for Result<T, E> {
    fn at(self, place: impl FnOnce() -> MistakeLocation) -> Result<T, SimulationError> {
        self.map_err(|problem| SimulationError { place: place(), problem: problem.into() })
    }
}

/// Returns the place of the key `key` in the `config` of an agent's entry.
fn config(entry: &AgentEntry, key: &str) -> MistakeLocation {
    MistakeLocation::Key(format!("{}.config.{key}", entry.path))
}

/// Returns the building in which the simulated agents of an ecosystem act, in its initial state.
///
/// # Errors
///
/// Returns an error if an agent's entry lacks a key, or names a place, a carrier or a quantity that
/// does not exist, or if the ecosystem file sets an initial condition that is impossible.
pub(crate) fn simulate(ecosystem: &Ecosystem) -> Result<Building, SimulationError> {
    let time_scale = || MistakeLocation::Key("building.time-scale".to_owned());
    let building = Building::new(layout_of(ecosystem)?, ecosystem.building.time_scale);
    let building = building.at(time_scale)?;
    for (place, values) in &ecosystem.building.conditions {
        for (name, value) in values {
            let path = || MistakeLocation::Key(format!("building.conditions.{place}.{name}"));
            building.set(place, quantity(name).at(path)?, *value).at(path)?;
        }
    }
    Ok(building)
}

/// Changes the devices of a running building to those of an ecosystem file that was read again:
/// removes the devices of the agents in `leaving`, and adds the devices that are missing. All other
/// devices keep their state. Returns a message for the user for each device that cannot be added.
pub(crate) fn update_devices(
    building: &Building,
    ecosystem: &Ecosystem,
    leaving: &BTreeSet<AgentId>,
) -> Vec<String> {
    let layout = match layout_of(ecosystem) {
        Ok(layout) => layout,
        Err(error) => return vec![format!("failed to {error}")],
    };
    for agent in leaving {
        // An agent without a simulated device is ignored.
        let _ = building.remove_device(agent.as_str());
    }
    let is_missing = |device: &&BuildingDevice| building.place_of(device.name()).is_err();
    let missing = layout.devices().iter().filter(is_missing);
    let brought = missing.map(|device| (device.name(), building.add_device(device.clone())));
    brought
        .filter_map(|(name, brought)| {
            let error = brought.err()?;
            Some(format!("`{name}` is not in the simulated building: failed to {error}"))
        })
        .collect()
}

fn layout_of(ecosystem: &Ecosystem) -> Result<Layout, SimulationError> {
    let mut layout = Layout::new();
    add_places(&mut layout, ecosystem)?;
    add_connections(&mut layout, &ecosystem.problem)?;
    let simulated =
        |entry: &&AgentEntry| entry.driver.as_deref().is_none_or(|driver| driver == "simulated");
    let of = |plugin: &'static str| {
        ecosystem.agents.iter().filter(simulated).filter(move |entry| entry.plugin == plugin)
    };
    for entry in of("temperature-sensor") {
        let at = || config(entry, "location");
        layout.add_fixed_sensor(entry.name.as_str(), text(entry, "location")?).at(at)?;
    }
    for entry in of("sensor") {
        let (name, location) = (entry.name.as_str(), text(entry, "location")?);
        match text(entry, "quantity")? {
            "temperature" => layout.add_fixed_sensor(name, location),
            other => {
                let quantity = quantity(other).at(|| config(entry, "quantity"))?;
                layout.add_sensor(name, location, quantity)
            }
        }
        .at(|| config(entry, "location"))?;
    }
    for entry in of("turtlebot").chain(of("cleaning-robot")).chain(of("courier")).chain(of("mover"))
    {
        add_robot(&mut layout, entry)?;
    }
    for entry in of("video-robot") {
        add_robot(&mut layout, entry)?;
        let screen = format!("{}-screen", entry.name);
        layout.mount_screen(&screen, entry.name.as_str()).at(|| config(entry, "start"))?;
    }
    for entry in of("screen") {
        let at = || config(entry, "location");
        layout.add_screen(entry.name.as_str(), text(entry, "location")?).at(at)?;
    }
    for entry in of("ptz-camera") {
        let (location, views) = (text(entry, "location")?, views(entry)?);
        // If the location exists, the mistake is in the directions.
        let is_there = layout.location(location).is_some();
        let key = if is_there { "presets" } else { "location" };
        layout.add_camera(entry.name.as_str(), location, views).at(|| config(entry, key))?;
    }
    for entry in of("ir-temperature-sensor") {
        let at = || config(entry, "mounted-on");
        layout.mount(entry.name.as_str(), text(entry, "mounted-on")?).at(at)?;
    }
    for entry in of("door") {
        add_door(&mut layout, entry)?;
    }
    for entry in of("lift") {
        let landings = texts(entry, "landings");
        let at = || config(entry, "landings");
        layout.add_lift(entry.name.as_str(), &landings).at(at)?;
    }
    for entry in of("arm") {
        add_arm(&mut layout, entry)?;
    }
    for entry in of("tag-reader") {
        add_parcels(&mut layout, entry)?;
    }
    Ok(layout)
}

/// Adds a door, and the way through it if the map has none.
fn add_door(layout: &mut Layout, entry: &AgentEntry) -> Result<(), SimulationError> {
    let at = || config(entry, "between");
    let [a, b] = texts(entry, "between")[..] else { return Err(lacks(entry, "between")) };
    if layout.meters(a, b).or(layout.meters(b, a)).is_none() {
        let meters = entry.config.get("length").and_then(Value::as_f64).unwrap_or(METERS);
        layout.connect(a, b, meters).at(at)?;
    }
    layout.add_door(entry.name.as_str(), a, b).at(at)?;
    Ok(())
}

/// Adds an arm with its shelves and the parcels on them.
fn add_arm(layout: &mut Layout, entry: &AgentEntry) -> Result<(), SimulationError> {
    let (location, shelves) = (text(entry, "location")?, texts(entry, "shelves"));
    let stored = entry.config.get("stored").and_then(Value::as_object);
    let stored: Vec<_> = { stored.into_iter().flatten() }
        .filter_map(|(parcel, shelf)| Some((parcel.as_str(), shelf.as_str()?)))
        .collect();
    let added = layout.add_arm(entry.name.as_str(), location, &shelves, &stored).map(drop);
    let place = match &added {
        Err(LayoutError::UnknownLocation { .. }) => config(entry, "location"),
        Err(LayoutError::NameTaken { name, .. } | LayoutError::BadName { name })
            if name == entry.name.as_str() =>
        {
            MistakeLocation::Key(format!("{}.name", entry.path))
        }
        Err(LayoutError::UnknownShelf { .. }) => config(entry, "stored"),
        Err(LayoutError::NameTaken { name, .. }) if stored.iter().any(|(it, _)| it == name) => {
            config(entry, "stored")
        }
        _ => config(entry, "shelves"),
    };
    added.at(|| place)
}

/// Adds a tag reader, its parcels and its tables, each where it is at the start.
fn add_parcels(layout: &mut Layout, entry: &AgentEntry) -> Result<(), SimulationError> {
    let things = |key: &str| -> Vec<(&String, &str)> {
        let things = entry.config.get(key).and_then(Value::as_object);
        let things = things.into_iter().flatten();
        things.filter_map(|(thing, place)| Some((thing, place.as_str()?))).collect()
    };
    let (parcels, tables) = (things("parcels"), things("tables"));
    for (parcel, place) in &parcels {
        layout.add_parcel(parcel, place).at(|| config(entry, "parcels"))?;
    }
    for (table, place) in &tables {
        layout.add_table(table, place).at(|| config(entry, "tables"))?;
    }
    let Some((_, place)) = parcels.iter().chain(&tables).next() else {
        return Err(lacks(entry, "parcels` or `tables"));
    };
    layout.add_tag_reader(entry.name.as_str(), place).at(|| config(entry, "parcels"))?;
    Ok(())
}

/// Returns the texts in the list `key` of an agent's config.
fn texts<'a>(entry: &'a AgentEntry, key: &str) -> Vec<&'a str> {
    let list = entry.config.get(key).and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_str).collect()
}

fn add_robot(layout: &mut Layout, entry: &AgentEntry) -> Result<(), SimulationError> {
    let number = |value: Option<&Value>| value.and_then(Value::as_f64);
    let speed = number(entry.config.get("speed")).unwrap_or(0.3);
    add_poses(layout, entry)?;
    let start = text(entry, "start")?;
    let key = if layout.location(start).is_some() { "speed" } else { "start" };
    layout.add_robot(entry.name.as_str(), start, speed).at(|| config(entry, key))?;
    if let Some(battery) = entry.config.get("battery") {
        let range = number(battery.get("range")).ok_or_else(|| lacks(entry, "battery.range"))?;
        let charge = number(battery.get("charge")).unwrap_or(range);
        let recharge_time = number(battery.get("recharge-time")).unwrap_or(RECHARGE_TIME);
        let dock = text(entry, "dock")?.to_owned();
        let key = if layout.location(&dock).is_some() { "battery" } else { "dock" };
        let battery = RobotBattery { dock, range, charge, recharge_time };
        layout.equip(entry.name.as_str(), battery).at(|| config(entry, key))?;
    }
    Ok(())
}

/// Adds the poses in a robot's entry to the building as places. Two robots may have the same pose.
fn add_poses(layout: &mut Layout, entry: &AgentEntry) -> Result<(), SimulationError> {
    let Some(Value::Object(poses)) = entry.config.get("poses") else { return Ok(()) };
    for (name, pose) in poses {
        let near = pose.as_str().or_else(|| pose.get("near").and_then(Value::as_str));
        let near = near.ok_or_else(|| lacks(entry, "poses.near"))?;
        let meters = pose.get("meters").and_then(Value::as_f64).unwrap_or(POSE_METERS);
        if layout.location(name).is_none() {
            let celsius = layout.location(near).map_or(CELSIUS, |place| place.celsius);
            layout.add_corridor(name, celsius).at(|| config(entry, &format!("poses.{name}")))?;
        }
        if layout.meters(near, name).is_none() {
            let at = || config(entry, &format!("poses.{name}"));
            layout.connect(near, name, meters).at(at)?;
        }
    }
    Ok(())
}

/// Returns the places that a camera can see, each with its direction, from the presets in the
/// camera's entry.
fn views(entry: &AgentEntry) -> Result<Vec<PlaceDirection>, SimulationError> {
    let Some(Value::Object(presets)) = entry.config.get("presets") else { return Ok(Vec::new()) };
    let view = |preset: &Value| {
        let degrees = |key: &str| preset.get(key).and_then(Value::as_f64).unwrap_or_default();
        let location = preset.get("shows").and_then(Value::as_str);
        let location = location.ok_or_else(|| lacks(entry, "presets.shows"))?.to_owned();
        Ok(PlaceDirection { location, pan: degrees("pan"), tilt: degrees("tilt") })
    };
    presets.values().map(view).collect()
}

fn lacks(entry: &AgentEntry, key: &'static str) -> SimulationError {
    let problem = SimulationProblem::Config { agent: entry.name.to_string(), key };
    SimulationError { place: config(entry, key), problem }
}

fn quantity(name: &str) -> Result<Quantity, SimulationProblem> {
    Quantity::named(name).ok_or_else(|| SimulationProblem::Quantity { name: name.to_owned() })
}

fn known() -> String {
    let names: Vec<_> = Quantity::all().map(Quantity::name).collect();
    names.join(", ")
}

fn text<'a>(entry: &'a AgentEntry, key: &'static str) -> Result<&'a str, SimulationError> {
    entry.config.get(key).and_then(Value::as_str).ok_or_else(|| lacks(entry, key))
}

fn add_places(layout: &mut Layout, ecosystem: &Ecosystem) -> Result<(), SimulationError> {
    let types = Types::of(&ecosystem.domain);
    for declaration in ecosystem.problem.objects.iter() {
        let object = &declaration.object;
        let is_a = |sort: &str| {
            object.ty.alternatives.iter().any(|ty| types.is_subtype(ty.as_str(), sort))
        };
        let name = object.name.as_str();
        let celsius = ecosystem.building.temperatures.get(name).copied().unwrap_or(CELSIUS);
        if is_a("room") {
            layout.add_room(name, celsius).at(|| MistakeLocation::Map(object.name.span()))?;
        } else if is_a("location") {
            layout.add_corridor(name, celsius).at(|| MistakeLocation::Map(object.name.span()))?;
        }
    }
    Ok(())
}

fn add_connections(layout: &mut Layout, map: &Problem) -> Result<(), SimulationError> {
    let mut lengths: BTreeMap<(&Name, &Name), (f64, Span)> = BTreeMap::new();
    for element in &map.init {
        if let InitElement::Assign(fluent, number) = element
            && fluent.function == "distance"
            && let [Term::Object(from), Term::Object(to)] = fluent.arguments.as_slice()
        {
            lengths.insert((from, to), (number.0, fluent.span));
        }
    }
    for element in &map.init {
        if let InitElement::Atom(atom) = element
            && atom.predicate == "connected"
            && let [Term::Object(from), Term::Object(to)] = atom.arguments.as_slice()
        {
            let (meters, written) =
                lengths.get(&(from, to)).copied().unwrap_or((METERS, atom.span));
            let connected = layout.connect_one_way(from.as_str(), to.as_str(), meters);
            let span = match &connected {
                Err(LayoutError::BadDistance { .. }) => written,
                _ => atom.span,
            };
            connected.at(|| MistakeLocation::Map(span))?;
        }
    }
    Ok(())
}
