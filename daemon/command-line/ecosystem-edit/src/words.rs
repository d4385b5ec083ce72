//! Rooms, doors, sensors, robots and goals as words of a command line: `hall:corridor`,
//! `hall=kitchen:4`, `temperature@kitchen`, `turtlebot@hall`, `warm=(known-temperature kitchen)`.

use crate::addition::{DoorAddition, RoomAddition};
use crate::edit_error::EditError;

/// Quantities that sensors measure.
pub(crate) const QUANTITIES: [&str; 8] =
    ["temperature", "humidity", "co2", "light", "distance", "motion", "reflection", "contact"];

/// Plugins of robots that drive.
pub(crate) const ROBOTS: [&str; 3] = ["turtlebot", "cleaning-robot", "video-robot"];

/// Longest suggested name; names have a maximum length.
const SUGGESTION_CHARS_MAX: usize = 48;

/// A place: `NAME` or `NAME:KIND`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlaceOptions {
    /// Name of the place.
    pub name: String,
    /// Type of the place; `None` for a room.
    pub kind: Option<String>,
}

/// A door: `ROOM=ROOM` or `ROOM=ROOM:LENGTH`.
#[derive(Clone, Debug, PartialEq)]
pub struct DoorWords {
    /// Place on one side.
    pub from: String,
    /// Place on the other side.
    pub to: String,
    /// Length in meters.
    pub length: Option<f64>,
}

/// A sensor: `QUANTITY@ROOM`, `QUANTITY@ROBOT` or `QUANTITY@ROOM=DEVICE`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SensorWords {
    /// Quantity that the sensor measures.
    pub quantity: String,
    /// Room in which the sensor stands, or robot that carries it.
    pub place: String,
    /// Device of this machine, as `althing sensors` lists it.
    pub device: Option<String>,
}

/// A robot: `KIND@ROOM`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RobotWords {
    /// Plugin of the robot.
    pub plugin: String,
    /// Place where the robot starts.
    pub start: String,
}

/// A goal: `NAME=GOAL`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GoalWords {
    /// Name of the goal.
    pub name: String,
    /// Text of the goal.
    pub goal: String,
}

// === reading ===

impl std::str::FromStr for PlaceOptions {
    type Err = EditError;

    fn from_str(word: &str) -> Result<PlaceOptions, EditError> {
        let (name, kind) = match word.split_once(':') {
            Some((name, kind)) => (name.trim(), Some(kind.trim().to_owned())),
            None => (word.trim(), None),
        };
        check_name(name, "a room")?;
        if let Some(kind) = &kind {
            check_name(kind, "a kind of room")?;
        }
        Ok(PlaceOptions { name: name.to_owned(), kind })
    }
}

impl std::str::FromStr for DoorWords {
    type Err = EditError;

    fn from_str(word: &str) -> Result<DoorWords, EditError> {
        let form = "ROOM=ROOM or ROOM=ROOM:METERS, such as hall=kitchen:4";
        let failed = || wrong_word(word, "door", form, None);
        let (from, rest) = word.split_once('=').ok_or_else(failed)?;
        let (to, length) = match rest.split_once(':') {
            Some((to, length)) => (to, Some(meters(length).ok_or_else(failed)?)),
            None => (rest, None),
        };
        let (from, to) = (from.trim().to_owned(), to.trim().to_owned());
        if from.is_empty() || to.is_empty() {
            return Err(failed());
        }
        Ok(DoorWords { from, to, length })
    }
}

impl std::str::FromStr for SensorWords {
    type Err = EditError;

    fn from_str(word: &str) -> Result<SensorWords, EditError> {
        let form = "QUANTITY@ROOM, such as temperature@kitchen; quantities are temperature, humidity, \
                    co2, light, distance, motion, reflection and contact";
        let failed = |suggestion| wrong_word(word, "sensor", form, suggestion);
        let (quantity, place) = word.split_once('@').ok_or_else(|| failed(None))?;
        let (place, device) = match place.split_once('=') {
            Some((place, device)) => (place, Some(device.trim().to_owned())),
            None => (place, None),
        };
        let (quantity, place) = (quantity.trim(), place.trim());
        if !QUANTITIES.contains(&quantity) {
            let nearest = pddl::nearest(quantity, QUANTITIES);
            return Err(failed(nearest.map(|nearest| format!("{nearest}@{place}"))));
        }
        if place.is_empty() || device.as_ref().is_some_and(String::is_empty) {
            return Err(failed(None));
        }
        Ok(SensorWords { quantity: quantity.to_owned(), place: place.to_owned(), device })
    }
}

impl std::str::FromStr for RobotWords {
    type Err = EditError;

    fn from_str(word: &str) -> Result<RobotWords, EditError> {
        let form = "KIND@ROOM, such as turtlebot@hall; kinds are turtlebot, cleaning-robot and \
                    video-robot";
        let failed = |suggestion| wrong_word(word, "robot", form, suggestion);
        let (plugin, start) = word.split_once('@').ok_or_else(|| failed(None))?;
        let (plugin, start) = (plugin.trim(), start.trim());
        if !ROBOTS.contains(&plugin) {
            let nearest = pddl::nearest(plugin, ROBOTS);
            return Err(failed(nearest.map(|nearest| format!("{nearest}@{start}"))));
        }
        if start.is_empty() {
            return Err(failed(None));
        }
        Ok(RobotWords { plugin: plugin.to_owned(), start: start.to_owned() })
    }
}

impl std::str::FromStr for GoalWords {
    type Err = EditError;

    fn from_str(word: &str) -> Result<GoalWords, EditError> {
        let form = "NAME=GOAL, such as warm=\"(known-temperature kitchen)\"";
        let failed = || wrong_word(word, "goal", form, None);
        let (name, goal) = word.split_once('=').ok_or_else(failed)?;
        let (name, goal) = (name.trim(), goal.trim());
        // `(= (temperature kitchen) 21)` is a goal without a name.
        if name.starts_with('(') || goal.is_empty() {
            return Err(failed());
        }
        check_name(name, "a goal")?;
        Ok(GoalWords { name: name.to_owned(), goal: goal.to_owned() })
    }
}

impl From<PlaceOptions> for RoomAddition {
    fn from(words: PlaceOptions) -> RoomAddition {
        RoomAddition { name: words.name, kind: words.kind, ..RoomAddition::default() }
    }
}

impl From<DoorWords> for DoorAddition {
    fn from(DoorWords { from, to, length }: DoorWords) -> DoorAddition {
        DoorAddition { from, to, length, is_one_way: false }
    }
}

fn wrong_word(
    word: &str,
    what: &'static str,
    form: &'static str,
    suggestion: Option<String>,
) -> EditError {
    EditError::Word { word: word.to_owned(), what, form, suggestion }
}

/// Returns a length in meters, with or without its unit; a comma counts as a decimal point.
pub fn meters(text: &str) -> Option<f64> {
    let number = text.trim().trim_end_matches('m').trim_end().replace(',', ".");
    number.parse::<f64>().ok().filter(|length| length.is_finite() && *length > 0.0)
}

// === names ===

/// Returns an error with a similar name that is possible, unless `name` can be a name.
pub(crate) fn check_name(name: &str, what: &'static str) -> Result<(), EditError> {
    acl::AgentId::new(name).map(|_| ()).map_err(|error| EditError::Name {
        name: name.to_owned(),
        what,
        rule: error.rule,
        suggestion: as_name(name),
    })
}

/// Returns the name that is most similar to a text: `Große Küche` becomes `grosse-kueche`. Returns
/// `None` if no letter of the text can be in a name.
pub fn as_name(text: &str) -> Option<String> {
    // German writes these as two letters, and not without their dots.
    let text = text.trim().to_lowercase();
    let text = text.replace('ä', "ae").replace('ö', "oe").replace('ü', "ue");
    let mut name = String::new();
    for letter in any_ascii::any_ascii(&text).to_lowercase().chars() {
        match letter {
            'a'..='z' | '0'..='9' | '_' => name.push(letter),
            _ if !name.is_empty() && !name.ends_with('-') => name.push('-'),
            _ => (),
        }
    }
    let name: String = name
        .trim_start_matches(|letter: char| !letter.is_ascii_lowercase())
        .chars()
        .take(SUGGESTION_CHARS_MAX)
        .collect();
    let name = name.trim_end_matches('-');
    (!name.is_empty()).then(|| name.to_owned())
}
