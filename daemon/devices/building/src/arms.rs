//! Robot arms: an arm takes parcels from its shelves, and loads them on robots that stand before it.
//!
//! - An arm stands in one location, and reaches its own shelves. A parcel on a shelf is within reach
//!   of no robot.
//! - It grips one parcel at a time, puts it back on a shelf, or loads it on a robot that stands still
//!   in the location of the arm and carries nothing.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::{ParcelAnswer, ParcelAsk};
use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::{BuildingDevice, Layout};
use crate::parcel_place::ParcelPlace;
use crate::parcels::impossible;
use crate::truth::{BuildingEvent, Truth};
use crate::world::wrong_kind;

/// Duration of gripping a parcel, of putting it back, and of loading it.
const ARM_MOVES: Duration = Duration::from_secs(6);

// === impl Layout ===

impl Layout {
    /// Adds an arm with its shelves. `stored` has the shelf of each parcel that lies on one at the
    /// start, by the parcel's name.
    ///
    /// # Errors
    ///
    /// Returns an error if a name is invalid or taken, if there is no such location, if the arm has no
    /// shelf, or if a parcel lies on a shelf that it does not have.
    pub fn add_arm(
        &mut self,
        name: &str,
        location: &str,
        shelves: &[&str],
        stored: &[(&str, &str)],
    ) -> Result<&mut Layout, LayoutError> {
        let shelves = shelves.iter().map(|shelf| (*shelf).to_owned()).collect();
        let stored = stored.iter().map(|(parcel, on)| ((*parcel).to_owned(), (*on).to_owned()));
        let (name, location, stored) = (name.to_owned(), location.to_owned(), stored.collect());
        self.add_device(BuildingDevice::Arm { name, location, shelves, stored })
    }

    /// Checks the shelves of an arm, and the parcels that lie on them.
    pub(crate) fn check_shelves(
        &self,
        arm: &str,
        shelves: &[String],
        stored: &BTreeMap<String, String>,
    ) -> Result<(), LayoutError> {
        if shelves.is_empty() {
            return Err(LayoutError::NoShelves { arm: arm.to_owned() });
        }
        shelves.iter().try_for_each(|shelf| self.check_new_name(shelf))?;
        for (parcel, shelf) in stored {
            self.check_new_name(parcel)?;
            if parcel == arm || shelves.contains(parcel) {
                let taken_by = if parcel == arm { "arm" } else { "shelf" }.to_owned();
                return Err(LayoutError::NameTaken { name: parcel.clone(), taken_by });
            }
            if !shelves.contains(shelf) {
                let (arm, shelf) = (arm.to_owned(), shelf.clone());
                return Err(LayoutError::UnknownShelf { arm, shelf });
            }
        }
        Ok(())
    }
}

// === impl Truth ===

impl Truth {
    /// Puts the parcels of an arm on its shelves, except those that are somewhere already: the arm of
    /// a file that was read again has perhaps loaded them.
    pub(crate) fn store_parcels(&mut self, device: &BuildingDevice) {
        let BuildingDevice::Arm { name, shelves, stored, .. } = device else { return };
        for (parcel, shelf) in stored {
            let is_gone = |device: &str| self.layout.device(device).is_none();
            let is_nowhere = match self.parcels.get(parcel) {
                None => true,
                Some(ParcelPlace::Stored { arm, shelf }) if arm == name => !shelves.contains(shelf),
                Some(ParcelPlace::Stored { arm: by, .. } | ParcelPlace::On(by)) => is_gone(by),
                Some(ParcelPlace::At(_) | ParcelPlace::In(_)) => false,
            };
            if is_nowhere {
                let (arm, shelf) = (name.clone(), shelf.clone());
                self.parcels.insert(parcel.clone(), ParcelPlace::Stored { arm, shelf });
            }
        }
    }

    fn require_arm(&self, arm: &str) -> Result<&[String], DeviceError> {
        match self.require_device(arm)? {
            BuildingDevice::Arm { shelves, .. } => Ok(shelves),
            other => Err(wrong_kind(other, "arm")),
        }
    }

    fn grip(&mut self, arm: &str, parcel: &str) -> Result<(), DeviceError> {
        self.require_unbroken(arm)?;
        if let Some(other) = self.carried_by(arm) {
            return Err(impossible(arm, format!("it has gripped `{other}`")));
        }
        match self.parcels.get(parcel) {
            Some(ParcelPlace::Stored { arm: by, .. }) if by == arm => (),
            _ => return Err(impossible(arm, format!("`{parcel}` is on none of its shelves"))),
        }
        self.parcels.insert(parcel.to_owned(), ParcelPlace::On(arm.to_owned()));
        let (arm, parcel) = (arm.to_owned(), parcel.to_owned());
        self.log.record(BuildingEvent::Gripped { arm, parcel });
        Ok(())
    }

    fn put_back(&mut self, arm: &str, parcel: &str, shelf: &str) -> Result<(), DeviceError> {
        self.require_unbroken(arm)?;
        self.require_gripped(arm, parcel)?;
        if !self.require_arm(arm)?.iter().any(|own| own == shelf) {
            return Err(impossible(arm, format!("it has no shelf `{shelf}`")));
        }
        let place = ParcelPlace::Stored { arm: arm.to_owned(), shelf: shelf.to_owned() };
        self.parcels.insert(parcel.to_owned(), place);
        let (arm, parcel) = (arm.to_owned(), parcel.to_owned());
        self.log.record(BuildingEvent::PutBack { arm, parcel });
        Ok(())
    }

    /// Returns the location of an arm if a robot stands still there, as it must from the beginning of
    /// loading to its end, and the sequence number of the robot's last departure.
    fn require_still(&self, arm: &str, robot: &str) -> Result<(String, Option<u64>), DeviceError> {
        self.require_robot(robot)?;
        let here = self.require_place(arm)?;
        if self.require_place(robot)? != here {
            return Err(impossible(arm, format!("`{robot}` is not at `{here}`")));
        }
        if self.errands.contains_key(robot) {
            return Err(impossible(arm, format!("`{robot}` does not stand still")));
        }
        let is_departure = |event: &BuildingEvent| matches!(event, BuildingEvent::Departed { robot: by, .. } if by == robot);
        let departed = self.occurrences().rfind(|occurrence| is_departure(&occurrence.event));
        Ok((here, departed.map(|occurrence| occurrence.sequence)))
    }

    /// Ends loading, which began when the last departure of the robot was `departed`.
    fn load(
        &mut self,
        (arm, parcel, robot): (&str, &str, &str),
        departed: Option<u64>,
    ) -> Result<(), DeviceError> {
        self.require_unbroken(arm)?;
        self.require_gripped(arm, parcel)?;
        let (here, departed_now) = self.require_still(arm, robot)?;
        if departed_now != departed {
            return Err(impossible(arm, format!("`{robot}` did not stand still")));
        }
        if let Some(other) = self.carried_by(robot) {
            return Err(impossible(arm, format!("`{robot}` carries `{other}`")));
        }
        self.parcels.insert(parcel.to_owned(), ParcelPlace::On(robot.to_owned()));
        let (arm, parcel, robot) = (arm.to_owned(), parcel.to_owned(), robot.to_owned());
        self.log.record(BuildingEvent::Loaded { arm, robot, parcel, at: here });
        Ok(())
    }

    fn require_gripped(&self, arm: &str, parcel: &str) -> Result<(), DeviceError> {
        match self.carried_by(arm) {
            Some(gripped) if gripped == parcel => Ok(()),
            _ => Err(impossible(arm, format!("it has not gripped `{parcel}`"))),
        }
    }
}

// === impl Building ===

impl Building {
    /// Lets an arm grip a parcel that lies on one of its shelves.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such arm, if it is broken or has gripped a parcel, or if the
    /// parcel is on none of its shelves.
    pub async fn grip(&self, arm: &str, parcel: &str) -> Result<(), DeviceError> {
        self.change(|truth| truth.require_arm(arm).map(drop))?;
        let slowness = self.change(|truth| truth.begin_use(arm))?;
        self.work(arm, ARM_MOVES + slowness, |truth| truth.grip(arm, parcel)).await
    }

    /// Lets an arm put what it has gripped on one of its shelves.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such arm or shelf, or if the arm is broken or has not gripped the
    /// parcel.
    pub async fn put_back(&self, arm: &str, parcel: &str, shelf: &str) -> Result<(), DeviceError> {
        self.change(|truth| truth.require_arm(arm).map(drop))?;
        let slowness = self.change(|truth| truth.begin_use(arm))?;
        self.work(arm, ARM_MOVES + slowness, |truth| truth.put_back(arm, parcel, shelf)).await
    }

    /// Lets an arm load a parcel that it has gripped on a robot.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such arm or robot, if the arm is broken or has not gripped the
    /// parcel, or if the robot is elsewhere, does not stand still, or carries a parcel.
    pub async fn load(&self, arm: &str, parcel: &str, robot: &str) -> Result<(), DeviceError> {
        self.change(|truth| truth.require_arm(arm).map(drop))?;
        let slowness = self.change(|truth| truth.begin_use(arm))?;
        let (_, departed) = self.change(|truth| truth.require_still(arm, robot))?;
        let load = |truth: &mut Truth| truth.load((arm, parcel, robot), departed);
        self.work(arm, ARM_MOVES + slowness, load).await
    }

    /// Returns where the parcels are that lie on the shelves of an arm or that it has gripped.
    pub(crate) fn parcels_of(&self, arm: &str) -> Result<ParcelAnswer, DeviceError> {
        self.change(|truth| {
            truth.require_arm(arm)?;
            truth.require_unbroken(arm)?;
            let is_there = |place: &ParcelPlace| match place {
                ParcelPlace::Stored { arm: by, .. } | ParcelPlace::On(by) => by == arm,
                ParcelPlace::At(_) | ParcelPlace::In(_) => false,
            };
            let there = truth.parcels.iter().filter(|(_, place)| is_there(place));
            Ok(ParcelAnswer::Places(
                there.map(|(name, place)| (name.clone(), place.clone())).collect(),
            ))
        })
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Lets an arm grip a parcel; see [`Building::grip`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::grip`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn grip(&self, arm: &str, parcel: &str) -> Result<(), DeviceError> {
        let ask = ParcelAsk::Grip { arm: arm.to_owned(), parcel: parcel.to_owned() };
        self.parcel(ask).await.map(drop)
    }

    /// Lets an arm put back what it has gripped; see [`Building::put_back`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::put_back`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn put_back(&self, arm: &str, parcel: &str, shelf: &str) -> Result<(), DeviceError> {
        let (arm, parcel, shelf) = (arm.to_owned(), parcel.to_owned(), shelf.to_owned());
        let ask = ParcelAsk::PutBack { arm, parcel, shelf };
        self.parcel(ask).await.map(drop)
    }

    /// Lets an arm load what it has gripped on a robot; see [`Building::load`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::load`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn load(&self, arm: &str, parcel: &str, robot: &str) -> Result<(), DeviceError> {
        let (arm, parcel, robot) = (arm.to_owned(), parcel.to_owned(), robot.to_owned());
        let ask = ParcelAsk::Load { arm, parcel, robot };
        self.parcel(ask).await.map(drop)
    }

    /// Returns where the parcels are that lie on the shelves of an arm or that it has gripped, by
    /// their names.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such arm, if it is broken, or if the building cannot be
    /// reached.
    pub async fn parcels_of(
        &self,
        arm: &str,
    ) -> Result<BTreeMap<String, ParcelPlace>, DeviceError> {
        self.parcel_places(ParcelAsk::OfArm { arm: arm.to_owned() }).await
    }
}

#[cfg(test)]
mod tests {
    use crate::{Building, BuildingEvent, Layout, LayoutError, ParcelPlace};

    fn layout() -> Layout {
        let mut layout = Layout::new();
        layout.add_room("bay", 20.0).unwrap().add_corridor("hall", 19.0).unwrap();
        layout.connect("hall", "bay", 2.0).unwrap();
        layout.add_robot("courier-1", "hall", 1.0).unwrap();
        layout.add_parcel("parcel-0", "bay").unwrap();
        let stored = [("parcel-1", "upper"), ("parcel-2", "lower")];
        layout.add_arm("arm-1", "bay", &["upper", "lower"], &stored).unwrap();
        layout
    }

    #[tokio::test(start_paused = true)]
    async fn a_parcel_gets_from_a_shelf_to_a_robot_by_the_arm_only() {
        let building = Building::new(layout(), 1.0).unwrap();
        building.navigate("courier-1", "bay").await.unwrap();
        assert!(building.take_up("courier-1", "parcel-1").await.is_err(), "it is on a shelf");
        let load = |parcel: &'static str| building.load("arm-1", parcel, "courier-1");
        assert!(load("parcel-1").await.is_err(), "nothing is gripped");
        assert!(building.grip("arm-1", "parcel-0").await.is_err(), "it is on no shelf");
        building.grip("arm-1", "parcel-2").await.unwrap();
        assert!(building.grip("arm-1", "parcel-1").await.is_err(), "the gripper is not free");
        building.put_back("arm-1", "parcel-2", "upper").await.unwrap();
        let upper = ParcelPlace::Stored { arm: "arm-1".to_owned(), shelf: "upper".to_owned() };
        assert_eq!(building.truth().parcel("parcel-2"), Some(&upper));
        building.grip("arm-1", "parcel-1").await.unwrap();
        assert!(load("parcel-2").await.is_err(), "another parcel is gripped");
        load("parcel-1").await.unwrap();
        assert_eq!(building.truth().carried_by("courier-1"), Some("parcel-1"));
        let left = building.handle().parcels_of("arm-1").await.unwrap();
        assert_eq!(left.into_iter().collect::<Vec<_>>(), [("parcel-2".to_owned(), upper)]);
        building.grip("arm-1", "parcel-2").await.unwrap();
        assert!(load("parcel-2").await.is_err(), "the robot carries a parcel");
    }

    /// If the entry of an arm in the file changes, the arm is removed and added again.
    #[tokio::test(start_paused = true)]
    async fn an_arm_that_is_added_again_takes_no_parcel_back() {
        let building = Building::new(layout(), 1.0).unwrap();
        building.navigate("courier-1", "bay").await.unwrap();
        building.grip("arm-1", "parcel-1").await.unwrap();
        building.load("arm-1", "parcel-1", "courier-1").await.unwrap();
        let arm = layout().device("arm-1").unwrap().clone();
        building.remove_device("arm-1").unwrap();
        building.add_device(arm).unwrap();
        assert_eq!(building.truth().carried_by("courier-1"), Some("parcel-1"));
        let places = building.handle().parcels_of("arm-1").await.unwrap();
        assert_eq!(places.into_keys().collect::<Vec<_>>(), ["parcel-2"]);
    }

    /// The parcels of an arm with another name or other shelves are on these.
    #[tokio::test(start_paused = true)]
    async fn an_arm_that_is_renamed_has_its_parcels() {
        let building = Building::new(layout(), 1.0).unwrap();
        building.grip("arm-1", "parcel-1").await.unwrap();
        building.remove_device("arm-1").unwrap();
        let stored = [("parcel-1", "rack"), ("parcel-2", "rack")];
        let mut other = Layout::new();
        other.add_room("bay", 20.0).unwrap();
        other.add_arm("arm-2", "bay", &["rack"], &stored).unwrap();
        building.add_device(other.device("arm-2").unwrap().clone()).unwrap();
        let places = building.handle().parcels_of("arm-2").await.unwrap();
        let on_rack = ParcelPlace::Stored { arm: "arm-2".to_owned(), shelf: "rack".to_owned() };
        assert!(places.len() == 2 && places.values().all(|place| *place == on_rack), "{places:?}");
    }

    /// A robot that drives away while it is loaded does not get the parcel, also if it comes back.
    #[tokio::test(start_paused = true)]
    async fn a_robot_has_to_stand_still_while_it_is_loaded() {
        let building = Building::new(layout(), 1.0).unwrap();
        building.grip("arm-1", "parcel-1").await.unwrap();
        let load = || building.load("arm-1", "parcel-1", "courier-1");
        assert!(load().await.is_err(), "it is elsewhere");
        building.navigate("courier-1", "bay").await.unwrap();
        for comes_back in [true, false] {
            let driving = async {
                building.navigate("courier-1", "hall").await.unwrap();
                if comes_back {
                    building.navigate("courier-1", "bay").await.unwrap();
                }
            };
            let (loaded, ()) = tokio::join!(load(), driving);
            assert!(loaded.is_err(), "{loaded:?}");
        }
        assert_eq!(building.truth().carried_by("arm-1"), Some("parcel-1"));
        assert!(!building.truth().any(|event| matches!(event, BuildingEvent::Loaded { .. })));
    }

    #[test]
    fn an_arm_with_impossible_shelves_is_refused() {
        let error = |shelves: &[&str], stored: &[(&str, &str)]| {
            layout().add_arm("arm-2", "hall", shelves, stored).map(drop).unwrap_err()
        };
        assert!(matches!(error(&[], &[]), LayoutError::NoShelves { .. }));
        assert!(matches!(error(&["a"], &[("parcel-3", "b")]), LayoutError::UnknownShelf { .. }));
        assert!(matches!(error(&["bay"], &[]), LayoutError::NameTaken { .. }), "it is a location");
        let taken = error(&["a"], &[("parcel-1", "a")]);
        assert!(matches!(taken, LayoutError::NameTaken { .. }), "it is on another shelf: {taken}");
    }
}
