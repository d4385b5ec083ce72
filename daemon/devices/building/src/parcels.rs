//! Parcels, and what hands them over: doors that a motor opens, lifts, and robots that carry. Arms are
//! in `arms`.
//!
//! - A [`BuildingDevice::Door`] locks the way between two locations until it is opened.
//! - A [`BuildingDevice::Lift`] has a cabin that is at one of its landings. Parcels ride in it, robots
//!   do not.
//! - A robot carries one parcel. It takes parcels from its location, or from a cabin that is there.
//! - A [`BuildingDevice::TagReader`] tells where all parcels are.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::{DriverAnswer, DriverRequest, ParcelAnswer, ParcelAsk};
use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::{BuildingDevice, Layout};
use crate::parcel_place::ParcelPlace;
use crate::truth::{BuildingEvent, Truth};
use crate::world::wrong_kind;

/// Duration of opening or closing a door.
const DOOR_MOVES: Duration = Duration::from_secs(3);

/// Duration of a trip of a cabin between two landings.
const CABIN_MOVES: Duration = Duration::from_secs(10);

/// Duration of taking up or setting down a parcel.
const HANDLING: Duration = Duration::from_secs(5);

// === impl Layout ===

impl Layout {
    /// Adds a door that is closed at the start, between two locations that are connected.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if the locations are not connected.
    pub fn add_door(&mut self, name: &str, a: &str, b: &str) -> Result<&mut Layout, LayoutError> {
        let (name, a, b) = (name.to_owned(), a.to_owned(), b.to_owned());
        self.add_device(BuildingDevice::Door { name, a, b })
    }

    /// Adds a lift between landings. Its cabin is at the first one at the start.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if a landing is not in the layout.
    pub fn add_lift(&mut self, name: &str, landings: &[&str]) -> Result<&mut Layout, LayoutError> {
        let landings = landings.iter().map(|landing| (*landing).to_owned()).collect();
        self.add_device(BuildingDevice::Lift { name: name.to_owned(), landings })
    }

    /// Adds a reader of the tags of parcels.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such location.
    pub fn add_tag_reader(
        &mut self,
        name: &str,
        location: &str,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, location) = (name.to_owned(), location.to_owned());
        self.add_device(BuildingDevice::TagReader { name, location })
    }

    /// Puts a parcel into a location.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such location.
    pub fn add_parcel(&mut self, name: &str, location: &str) -> Result<&mut Layout, LayoutError> {
        self.check_new_name(name)?;
        self.check_location(location)?;
        self.parcels.insert(name.to_owned(), location.to_owned());
        Ok(self)
    }

    /// Returns the location of each parcel at the start, by the parcel's name.
    pub fn parcels(&self) -> &BTreeMap<String, String> {
        &self.parcels
    }

    /// Whether a door with a motor is between two locations.
    pub fn has_door(&self, from: &str, to: &str) -> bool {
        let is_between = |device: &BuildingDevice| matches!(device, BuildingDevice::Door { a, b, .. } if (a == from && b == to) || (a == to && b == from));
        self.devices().iter().any(is_between)
    }
}

// === impl Truth ===

impl Truth {
    /// Returns where a parcel is; `None` if there is no such parcel.
    pub fn parcel(&self, parcel: &str) -> Option<&ParcelPlace> {
        self.parcels.get(parcel)
    }

    /// Returns the parcel that a robot carries, or that an arm has gripped; `None` if there is none.
    pub fn carried_by(&self, robot: &str) -> Option<&str> {
        let is_on = |place: &ParcelPlace| *place == ParcelPlace::On(robot.to_owned());
        self.parcels.iter().find(|(_, place)| is_on(place)).map(|(parcel, _)| parcel.as_str())
    }

    /// Returns a text that says where a parcel is, if it is not in `room`.
    pub(crate) fn misplaced(&self, parcel: &str, room: &str) -> Option<String> {
        let place = self.parcel(parcel);
        let is_there = matches!(place, Some(ParcelPlace::At(at)) if at == room);
        (!is_there).then(|| format!("`{parcel}` is not at `{room}`, but {place:?}"))
    }

    /// Puts the devices of this module and the parcels in their places at the start.
    pub(crate) fn furnish(&mut self) {
        for device in self.layout.devices() {
            match device {
                BuildingDevice::Door { a, b, .. } => {
                    self.locked.insert(crate::truth::sides(a, b));
                }
                BuildingDevice::Lift { name, landings } => {
                    let first = landings.first().cloned();
                    self.cabins.extend(first.map(|landing| (name.clone(), landing)));
                }
                _ => (),
            }
        }
        let arms = self.layout.devices().to_vec();
        let at =
            |(parcel, place): (&String, &String)| (parcel.clone(), ParcelPlace::At(place.clone()));
        self.parcels = self.layout.parcels.iter().map(at).collect();
        self.tables = self.layout.tables.clone();
        arms.iter().for_each(|device| self.store_parcels(device));
    }

    fn door(&self, door: &str) -> Result<(String, String), DeviceError> {
        match self.require_device(door)? {
            BuildingDevice::Door { a, b, .. } => Ok((a.clone(), b.clone())),
            other => Err(wrong_kind(other, "door")),
        }
    }

    fn set_door(&mut self, door: &str, open: bool) -> Result<(), DeviceError> {
        self.require_unbroken(door)?;
        let (a, b) = self.door(door)?;
        self.set_locked(&a, &b, !open).map_err(|error| impossible(door, error.to_string()))
    }

    fn send_cabin(&mut self, lift: &str, to: &str) -> Result<(), DeviceError> {
        self.require_unbroken(lift)?;
        self.require_landing(lift, to)?;
        let from = self.cabins.insert(lift.to_owned(), to.to_owned()).unwrap_or_default();
        if from != to {
            let (lift, to) = (lift.to_owned(), to.to_owned());
            self.log.record(BuildingEvent::CabinMoved { lift, from, to });
        }
        Ok(())
    }

    fn require_landing(&self, lift: &str, to: &str) -> Result<(), DeviceError> {
        match self.require_device(lift)? {
            BuildingDevice::Lift { landings, .. } if landings.iter().any(|it| it == to) => Ok(()),
            BuildingDevice::Lift { .. } => Err(impossible(lift, format!("it serves no `{to}`"))),
            other => Err(wrong_kind(other, "lift")),
        }
    }

    fn take_up(&mut self, robot: &str, parcel: &str) -> Result<(), DeviceError> {
        self.require_unbroken(robot)?;
        let here = self.require_place(robot)?;
        if let Some(other) = self.carried_by(robot) {
            return Err(impossible(robot, format!("it carries `{other}`")));
        }
        let place = match self.parcels.get(parcel) {
            Some(ParcelPlace::At(place)) => Some(place),
            Some(ParcelPlace::In(lift)) => self.cabins.get(lift),
            Some(ParcelPlace::On(_) | ParcelPlace::Stored { .. }) | None => None,
        };
        if place != Some(&here) {
            return Err(impossible(robot, format!("`{parcel}` is not at `{here}`")));
        }
        let (robot, parcel) = (robot.to_owned(), parcel.to_owned());
        self.parcels.insert(parcel.clone(), ParcelPlace::On(robot.clone()));
        self.log.record(BuildingEvent::TakenUp { robot, parcel, at: here });
        Ok(())
    }

    fn set_down(&mut self, robot: &str, lift: Option<&str>) -> Result<(), DeviceError> {
        self.require_unbroken(robot)?;
        let here = self.require_place(robot)?;
        let Some(parcel) = self.carried_by(robot).map(str::to_owned) else {
            return Err(impossible(robot, "it carries nothing".to_owned()));
        };
        let place = match lift {
            None => ParcelPlace::At(here.clone()),
            Some(lift) if self.cabins.get(lift) == Some(&here) => ParcelPlace::In(lift.to_owned()),
            Some(lift) => {
                return Err(impossible(robot, format!("the cabin of `{lift}` is not at `{here}`")));
            }
        };
        self.parcels.insert(parcel.clone(), place);
        self.log.record(BuildingEvent::SetDown { robot: robot.to_owned(), parcel, at: here });
        Ok(())
    }
}

pub(crate) fn impossible(device: &str, reason: String) -> DeviceError {
    DeviceError::Impossible { device: device.to_owned(), reason }
}

// === impl Building ===

impl Building {
    /// Opens or closes a door. Dropping the future leaves the door as it is.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such door, or if it is broken.
    pub async fn set_door(&self, door: &str, open: bool) -> Result<(), DeviceError> {
        self.change(|truth| truth.door(door))?;
        let slowness = self.change(|truth| truth.begin_use(door))?;
        self.work(door, DOOR_MOVES + slowness, |truth| truth.set_door(door, open)).await
    }

    /// Sends the cabin of a lift to a landing. Dropping the future leaves the cabin where it is.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such lift or landing, or if the lift is broken.
    pub async fn send_cabin(&self, lift: &str, to: &str) -> Result<(), DeviceError> {
        self.change(|truth| truth.require_landing(lift, to))?;
        let slowness = self.change(|truth| truth.begin_use(lift))?;
        self.work(lift, CABIN_MOVES + slowness, |truth| truth.send_cabin(lift, to)).await
    }

    /// Lets a robot take up a parcel that is at its location, or in a cabin there.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, if it is broken or carries a parcel, or if the
    /// parcel is not there.
    pub async fn take_up(&self, robot: &str, parcel: &str) -> Result<(), DeviceError> {
        self.change(|truth| truth.require_robot(robot))?;
        let slowness = self.change(|truth| truth.begin_use(robot))?;
        self.work(robot, HANDLING + slowness, |truth| truth.take_up(robot, parcel)).await
    }

    /// Lets a robot set down its parcel: at its location, or in the cabin of a lift that is there.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, if it is broken or carries nothing, or if the
    /// cabin is elsewhere.
    pub async fn set_down(&self, robot: &str, lift: Option<&str>) -> Result<(), DeviceError> {
        self.change(|truth| truth.require_robot(robot))?;
        let slowness = self.change(|truth| truth.begin_use(robot))?;
        self.work(robot, HANDLING + slowness, |truth| truth.set_down(robot, lift)).await
    }

    pub(crate) async fn parcel(&self, ask: ParcelAsk) -> Result<ParcelAnswer, DeviceError> {
        let done = |()| ParcelAnswer::Done;
        match ask {
            ParcelAsk::SetDoor { door, open } => self.set_door(&door, open).await.map(done),
            ParcelAsk::IsOpen { door } => self.change(|truth| {
                let (a, b) = truth.door(&door)?;
                Ok(ParcelAnswer::Open(!truth.is_locked(&a, &b)))
            }),
            ParcelAsk::SendCabin { lift, to } => self.send_cabin(&lift, &to).await.map(done),
            ParcelAsk::TakeUp { robot, parcel } => self.take_up(&robot, &parcel).await.map(done),
            ParcelAsk::SetDown { robot, lift } => {
                self.set_down(&robot, lift.as_deref()).await.map(done)
            }
            ParcelAsk::Grip { arm, parcel } => self.grip(&arm, &parcel).await.map(done),
            ParcelAsk::PutBack { arm, parcel, shelf } => {
                self.put_back(&arm, &parcel, &shelf).await.map(done)
            }
            ParcelAsk::Load { arm, parcel, robot } => {
                self.load(&arm, &parcel, &robot).await.map(done)
            }
            ParcelAsk::CarryTable { robot, other, table, to } => {
                self.carry_table((&robot, &other), &table, &to).await.map(done)
            }
            ParcelAsk::OfArm { arm } => self.parcels_of(&arm),
            ParcelAsk::Carried { robot } => self.change(|truth| {
                truth.require_robot(&robot)?;
                Ok(ParcelAnswer::Carried(truth.carried_by(&robot).map(str::to_owned)))
            }),
            ParcelAsk::ReadTags { reader } => self.change(|truth| {
                truth.require_unbroken(&reader)?;
                match truth.require_device(&reader)? {
                    BuildingDevice::TagReader { .. } => {
                        // What is on the shelves of an arm is seen by the arm only.
                        let is_seen =
                            |place: &ParcelPlace| !matches!(place, ParcelPlace::Stored { .. });
                        let seen = truth.parcels.iter().filter(|(_, place)| is_seen(place));
                        let seen = seen.map(|(name, place)| (name.clone(), place.clone()));
                        let tables = truth.tables.iter();
                        let tables =
                            tables.map(|(name, at)| (name.clone(), ParcelPlace::At(at.clone())));
                        Ok(ParcelAnswer::Places(seen.chain(tables).collect()))
                    }
                    other => Err(wrong_kind(other, "tag reader")),
                }
            }),
        }
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Opens or closes a door; see [`Building::set_door`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::set_door`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn set_door(&self, door: &str, open: bool) -> Result<(), DeviceError> {
        let ask = ParcelAsk::SetDoor { door: door.to_owned(), open };
        self.parcel(ask).await.map(drop)
    }

    /// Returns whether a door is open.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such door, or if the building cannot be reached.
    pub async fn is_open(&self, door: &str) -> Result<bool, DeviceError> {
        match self.parcel(ParcelAsk::IsOpen { door: door.to_owned() }).await? {
            ParcelAnswer::Open(open) => Ok(open),
            other => Err(DriverAnswer::Parcel(other).unexpected()),
        }
    }

    /// Sends the cabin of a lift to a landing; see [`Building::send_cabin`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::send_cabin`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn send_cabin(&self, lift: &str, to: &str) -> Result<(), DeviceError> {
        let ask = ParcelAsk::SendCabin { lift: lift.to_owned(), to: to.to_owned() };
        self.parcel(ask).await.map(drop)
    }

    /// Lets a robot take up a parcel; see [`Building::take_up`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::take_up`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn take_up(&self, robot: &str, parcel: &str) -> Result<(), DeviceError> {
        let ask = ParcelAsk::TakeUp { robot: robot.to_owned(), parcel: parcel.to_owned() };
        self.parcel(ask).await.map(drop)
    }

    /// Lets a robot set down its parcel; see [`Building::set_down`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::set_down`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn set_down(&self, robot: &str, lift: Option<&str>) -> Result<(), DeviceError> {
        let ask = ParcelAsk::SetDown { robot: robot.to_owned(), lift: lift.map(str::to_owned) };
        self.parcel(ask).await.map(drop)
    }

    /// Returns the parcel that a robot carries; `None` if it carries none.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, or if the building cannot be reached.
    pub async fn carried_by(&self, robot: &str) -> Result<Option<String>, DeviceError> {
        match self.parcel(ParcelAsk::Carried { robot: robot.to_owned() }).await? {
            ParcelAnswer::Carried(parcel) => Ok(parcel),
            other => Err(DriverAnswer::Parcel(other).unexpected()),
        }
    }

    /// Returns where all parcels are, by their names.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such tag reader, if it is broken, or if the building cannot
    /// be reached.
    pub async fn read_tags(
        &self,
        reader: &str,
    ) -> Result<BTreeMap<String, ParcelPlace>, DeviceError> {
        self.parcel_places(ParcelAsk::ReadTags { reader: reader.to_owned() }).await
    }

    /// Sends a request that is answered with places of parcels, and returns these.
    pub(crate) async fn parcel_places(
        &self,
        ask: ParcelAsk,
    ) -> Result<BTreeMap<String, ParcelPlace>, DeviceError> {
        match self.parcel(ask).await? {
            ParcelAnswer::Places(places) => Ok(places),
            other => Err(DriverAnswer::Parcel(other).unexpected()),
        }
    }

    pub(crate) async fn parcel(&self, ask: ParcelAsk) -> Result<ParcelAnswer, DeviceError> {
        match self.local() {
            Ok(building) => building.parcel(ask).await,
            Err(remote) => match remote.ask(DriverRequest::Parcel(ask)).await? {
                DriverAnswer::Parcel(answer) => Ok(answer),
                other => Err(other.unexpected()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Building, Layout, ParcelPlace};

    fn building() -> Building {
        let mut layout = Layout::new();
        layout.add_room("lab", 20.0).unwrap().add_corridor("hall", 19.0).unwrap();
        layout.add_corridor("above", 19.0).unwrap().connect("hall", "lab", 2.0).unwrap();
        layout.add_door("door-1", "hall", "lab").unwrap();
        layout.add_lift("lift-1", &["hall", "above"]).unwrap();
        layout.add_robot("courier-1", "hall", 1.0).unwrap();
        layout.add_parcel("parcel-1", "hall").unwrap().add_tag_reader("tags", "hall").unwrap();
        Building::new(layout, 0.0).unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn a_closed_door_is_passed_only_after_it_was_opened() {
        let building = building();
        assert!(building.navigate("courier-1", "lab").await.is_err());
        building.set_door("door-1", true).await.unwrap();
        building.navigate("courier-1", "lab").await.unwrap();
        building.set_door("door-1", false).await.unwrap();
        assert!(building.navigate("courier-1", "hall").await.is_err());
        assert!(building.set_door("lift-1", true).await.is_err(), "it is no door");
    }

    #[tokio::test(start_paused = true)]
    async fn a_parcel_rides_in_the_cabin_and_is_carried_by_one_robot() {
        let building = building();
        let place = |building: &Building| building.truth().parcel("parcel-1").cloned().unwrap();
        assert!(building.set_down("courier-1", None).await.is_err(), "it carries nothing");
        building.take_up("courier-1", "parcel-1").await.unwrap();
        assert!(building.take_up("courier-1", "parcel-1").await.is_err(), "it has it already");
        assert_eq!(place(&building), ParcelPlace::On("courier-1".to_owned()));
        building.send_cabin("lift-1", "above").await.unwrap();
        assert!(building.set_down("courier-1", Some("lift-1")).await.is_err(), "it is above");
        building.send_cabin("lift-1", "hall").await.unwrap();
        building.set_down("courier-1", Some("lift-1")).await.unwrap();
        building.send_cabin("lift-1", "above").await.unwrap();
        assert!(building.take_up("courier-1", "parcel-1").await.is_err(), "it is above");
        assert_eq!(place(&building), ParcelPlace::In("lift-1".to_owned()));
        assert!(building.send_cabin("lift-1", "lab").await.is_err(), "no landing is there");
        let told = building.handle().read_tags("tags").await.unwrap();
        assert_eq!(told.get("parcel-1"), Some(&place(&building)));
    }
}
