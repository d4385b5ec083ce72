//! People and other motion in the building. Cameras see both; agents control neither.

use crate::bounds::NAME_MAX;
use crate::building::Building;
use crate::error::LayoutError;
use crate::truth::{BuildingEvent, Truth};

// === impl Truth ===

impl Truth {
    /// Returns the people in a location, in the order of their names.
    pub fn people_in<'a>(&'a self, location: &'a str) -> impl Iterator<Item = &'a str> {
        let are_here = move |(_, place): &(&String, &String)| place.as_str() == location;
        self.people.iter().filter(are_here).map(|(person, _)| person.as_str())
    }

    /// Whether there is continuous motion in a location.
    pub fn has_motion(&self, location: &str) -> bool {
        self.locations_with_motion.contains(location)
    }

    fn enter(&mut self, person: &str, location: &str) -> Result<(), LayoutError> {
        self.require_place_named(location)?;
        if person.is_empty() || person.len() > NAME_MAX {
            return Err(LayoutError::BadName { name: person.to_owned() });
        }
        if self.people.insert(person.to_owned(), location.to_owned()).as_deref() != Some(location) {
            let (person, location) = (person.to_owned(), location.to_owned());
            self.log.record(BuildingEvent::Entered { person, location });
        }
        Ok(())
    }

    fn leave(&mut self, person: &str) {
        if let Some(location) = self.people.remove(person) {
            self.log.record(BuildingEvent::Left { person: person.to_owned(), location });
        }
    }

    fn set_motion(&mut self, location: &str, moves: bool) -> Result<(), LayoutError> {
        self.require_place_named(location)?;
        let location = location.to_owned();
        if moves && self.locations_with_motion.insert(location.clone()) {
            self.log.record(BuildingEvent::Stirs { location });
        } else if !moves && self.locations_with_motion.remove(&location) {
            self.log.record(BuildingEvent::Rests { location });
        }
        Ok(())
    }

    fn require_place_named(&self, location: &str) -> Result<(), LayoutError> {
        match self.layout.location(location) {
            Some(_) => Ok(()),
            None => Err(self.unknown_location(location)),
        }
    }
}

// === impl Building: control by tests and scenarios ===

impl Building {
    /// Moves a person to a location, from outside or from another location.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location, or if the name of the person is empty or too
    /// long.
    pub fn enter(&self, person: &str, location: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.enter(person, location))
    }

    /// Removes a person from the building, as if the person had left.
    pub fn leave(&self, person: &str) {
        self.change(|truth| truth.leave(person));
    }

    /// Sets whether there is continuous motion in a location, such as that of a curtain in the
    /// wind.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location.
    pub fn set_motion(&self, location: &str, moves: bool) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_motion(location, moves))
    }
}
