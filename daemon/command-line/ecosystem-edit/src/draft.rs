//! The plan of a new ecosystem file, and its text with comments for the reader.

use crate::addition::{AgentAddition, DoorAddition, EcosystemAddition, GoalAddition, RoomAddition};
use crate::ecosystem_text::{EcosystemText, agent_text, door_value, goal_value, room_settings};
use crate::edit_error::EditError;
use crate::setting::{SettingText, inline_table, key_text, quoted};
use crate::words::{RobotWords, SensorWords, check_name};

/// Driver of devices in the simulated building.
const SIMULATED: &str = "simulated";

/// Plugin of robots that show media, of which an entry names one at least.
const WITH_MEDIA: &str = "video-robot";

/// Columns of a heading, so that the headings of a file end alike. One column is for the mark of a
/// line in a difference.
const HEADING_COLUMNS: usize = 79;

/// Temperature of the first simulated room in °C, and how much warmer each next one is: rooms that
/// differ show that each is measured.
const FIRST_CELSIUS: f64 = 19.5;
const CELSIUS_STEP: f64 = 0.5;

/// Number of rooms after which the temperatures begin anew, so that a large house stays cool.
const CELSIUS_ROOMS: usize = 12;

/// A device or service that was found, or that a person has still to describe.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceOffer {
    /// One line for a person.
    pub about: String,
    /// The agent that brings it, if only its room is missing; its config has no location yet.
    pub agent: Option<AgentAddition>,
    /// Quantity that the agent measures; empty if it is no sensor.
    pub quantity: String,
    /// Lines of an ecosystem file that bring it once a person has filled them in.
    pub lines: String,
}

/// The plan of a new ecosystem file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EcosystemDraft {
    /// Name of the ecosystem.
    pub name: String,
    /// All places.
    pub rooms: Vec<RoomAddition>,
    /// All doors.
    pub doors: Vec<DoorAddition>,
    /// All agents.
    pub agents: Vec<AgentAddition>,
    /// All goals.
    pub goals: Vec<GoalAddition>,
    /// Devices that are written as comments.
    pub offers: Vec<DeviceOffer>,
}

// === impl EcosystemDraft ===

impl EcosystemDraft {
    /// Adds a robot, which is named after its kind. A robot that is not simulated is written as a
    /// comment, because its address and the poses of places are not known.
    pub fn add_robot(&mut self, robot: &RobotWords, is_simulated: bool) {
        let name = self.free_name(&format!("{}-1", robot.plugin));
        let mut config = vec![SettingText::text("start", &robot.start)];
        if robot.plugin == WITH_MEDIA {
            // It is of no use without a medium, and an example shows how to write them.
            config.push(SettingText::text_in("media", "welcome", "Welcome"));
        }
        let plugin = robot.plugin.clone();
        let agent = AgentAddition { name, plugin, config, ..AgentAddition::default() };
        if is_simulated {
            let driver = Some(SIMULATED.to_owned());
            self.agents.push(AgentAddition { driver, ..agent });
            return;
        }
        let mut lines = agent_text(&AgentAddition {
            driver: Some("ros2".to_owned()),
            config: Vec::new(),
            ..agent.clone()
        });
        let settings: Vec<String> = agent.config.iter().map(SettingText::line).collect();
        lines += &format!(
            "\n[agent.config]\n{}\n\n[agent.config.ros2]\n\
             endpoint = \"tcp/192.168.1.20:7447\"   # the robot's address\n\
             dialect = \"ros2dds\"                  # or \"rmw-zenoh\"\n\
             namespace = \"\"\n\n\
             [agent.config.ros2.places]   # `althing robot` prints these lines\n",
            settings.join("\n")
        );
        for room in &self.rooms {
            lines += &format!("{} = {{ x = 0.0, y = 0.0, yaw = 0.0 }}\n", key_text(&room.name));
        }
        let about = format!(
            "the robot {}: fill in its address and the pose of each place (docs/robots.md)",
            agent.name
        );
        self.offers.push(DeviceOffer { about, lines, ..DeviceOffer::default() });
    }

    /// Adds a sensor: of a device, simulated, or carried by a robot of the draft.
    ///
    /// # Errors
    ///
    /// Returns an error if the sensor has no device and is not simulated, or if a robot is to carry
    /// anything but a thermometer.
    pub fn add_sensor(
        &mut self,
        sensor: &SensorWords,
        is_simulated: bool,
    ) -> Result<(), EditError> {
        let SensorWords { quantity, place, device } = sensor;
        if let Some(robot) = self.robot_called(place) {
            return self.add_carried(quantity, &robot);
        }
        let mut config = vec![SettingText::text("location", place)];
        let plugin = match quantity.as_str() {
            "temperature" => "temperature-sensor",
            _ => {
                config.push(SettingText::text("quantity", quantity));
                "sensor"
            }
        };
        let driver = match device {
            Some(device) => {
                config.push(SettingText::text("device", device));
                "linux"
            }
            None if is_simulated => SIMULATED,
            None => {
                let (quantity, place) = (quantity.clone(), place.clone());
                return Err(EditError::NoDevice { quantity, place });
            }
        };
        let agent = AgentAddition {
            name: self.free_name(&sensor_name(quantity, place)),
            plugin: plugin.to_owned(),
            driver: Some(driver.to_owned()),
            config,
            ..AgentAddition::default()
        };
        self.agents.push(agent);
        Ok(())
    }

    fn add_carried(&mut self, quantity: &str, robot: &str) -> Result<(), EditError> {
        if quantity != "temperature" {
            let (quantity, robot) = (quantity.to_owned(), robot.to_owned());
            return Err(EditError::Carried { quantity, robot });
        }
        let agent = AgentAddition {
            name: self.free_name(&sensor_name(quantity, robot)),
            plugin: "ir-temperature-sensor".to_owned(),
            driver: Some(SIMULATED.to_owned()),
            config: vec![SettingText::text("mounted-on", robot)],
            ..AgentAddition::default()
        };
        self.agents.push(agent);
        Ok(())
    }

    /// Adds a device that was found, in a room; keeps it as a comment if no room is given.
    pub fn take_offer(&mut self, offer: &DeviceOffer, room: Option<&str>) {
        match (&offer.agent, room) {
            (Some(agent), Some(room)) => {
                let name = self.free_name(&sensor_name(&offer.quantity, room));
                let mut agent = AgentAddition { name, ..agent.clone() };
                agent.config.insert(0, SettingText::text("location", room));
                self.agents.push(agent);
            }
            _ => self.offers.push(offer.clone()),
        }
    }

    /// Returns the name of the robot that a person calls `word`: its name, or its kind if there is
    /// one robot of it.
    fn robot_called(&self, word: &str) -> Option<String> {
        let robots = || self.agents.iter().filter(|agent| is_robot(agent));
        if robots().any(|robot| robot.name == word) {
            return Some(word.to_owned());
        }
        let mut of_kind = robots().filter(|robot| robot.plugin == word);
        let first = of_kind.next()?;
        of_kind.next().is_none().then(|| first.name.clone())
    }

    /// Returns `name`, or that name with the first number with which no room and no agent has it.
    fn free_name(&self, name: &str) -> String {
        let is_taken = |name: &str| {
            self.agents.iter().any(|agent| agent.name == name)
                || self.rooms.iter().any(|room| room.name == name)
        };
        if !is_taken(name) {
            return name.to_owned();
        }
        let stem = name.trim_end_matches(|letter: char| letter.is_ascii_digit());
        let stem = stem.trim_end_matches('-');
        let mut numbered = (2..).map(|number: u32| format!("{stem}-{number}"));
        numbered.find(|name| !is_taken(name)).unwrap_or_else(|| name.to_owned())
    }

    /// Returns goals that the agents of the draft can reach, each with its name and a description;
    /// the first is the best one to begin with.
    pub fn goal_suggestions(&self) -> Vec<(GoalAddition, String)> {
        let mut suggestions = Vec::new();
        let rooms: Vec<&str> =
            self.rooms.iter().filter(|room| is_room(room)).map(|room| room.name.as_str()).collect();
        let is_carried = self.agents.iter().any(|agent| agent.plugin == "ir-temperature-sensor");
        let has_thermometer = |room: &&&str| {
            let location = SettingText::text("location", room);
            let is_here = |agent: &AgentAddition| {
                agent.plugin == "temperature-sensor" && agent.config.contains(&location)
            };
            is_carried || self.agents.iter().any(is_here)
        };
        let warm: Vec<&str> = rooms.iter().filter(has_thermometer).copied().collect();
        match warm.as_slice() {
            [] => (),
            all if all.len() == rooms.len() && all.len() > 1 => suggestions.push((
                kept("temperatures", "(forall (?r - room) (known-temperature ?r))".to_owned()),
                "the temperature of every room is known".to_owned(),
            )),
            [room, ..] => suggestions.push((
                kept("temperature", format!("(known-temperature {room})")),
                format!("the temperature of {room} is known"),
            )),
        }
        for agent in self.agents.iter().filter(|agent| agent.plugin == "sensor") {
            let value = |key: &str| {
                let setting = agent.config.iter().find(|setting| setting.key() == key)?;
                Some(setting.value().trim_matches('"').to_owned())
            };
            if let (Some(quantity), Some(room)) = (value("quantity"), value("location")) {
                suggestions.push((
                    kept(&quantity, format!("(known-{quantity} {room})")),
                    format!("the {quantity} of {room} is known"),
                ));
            }
        }
        suggestions
    }

    /// Returns the text of the file.
    ///
    /// # Errors
    ///
    /// Returns an error if a name is impossible or taken, or if a door leads to an unknown room.
    pub fn text(&self) -> Result<String, EditError> {
        self.check()?;
        let mut text = head(&self.name);
        text += &self.places()?;
        text += &self.devices();
        if !self.offers.is_empty() {
            text += &heading("Found, and not used yet");
            text +=
                "# Remove the `# ` before the lines of a device, and fill in what is its own.\n";
            for offer in &self.offers {
                // A text from outside must not end the comment.
                text += &format!("\n# {}:\n", offer.about.replace(char::is_control, " "));
                for line in offer.lines.trim_end().lines() {
                    text += format!("# {line}").trim_end();
                    text.push('\n');
                }
            }
            text.push('\n');
        }
        if !self.goals.is_empty() {
            text += &heading("What is to be so");
            text += "# A goal that is kept is planned for again whenever it does not hold.\n\
                     # `althing goals` shows how it stands.\n\n[goals]\n";
            for goal in &self.goals {
                text += &format!("{} = {}\n", key_text(&goal.name), goal_value(goal)?);
            }
            text.push('\n');
        }
        text += &self.building();
        Ok(text.trim_end().to_owned() + "\n")
    }

    /// Returns an error for the first part of the draft that could not be added to a file.
    fn check(&self) -> Result<(), EditError> {
        check_name(&self.name, "an ecosystem")?;
        let mut text = EcosystemText::parse("")?;
        let rooms = self.rooms.iter().cloned().map(EcosystemAddition::Room);
        let doors = self.doors.iter().cloned().map(EcosystemAddition::Door);
        let agents = self.agents.iter().cloned().map(EcosystemAddition::Agent);
        let goals = self.goals.iter().cloned().map(EcosystemAddition::Goal);
        for addition in rooms.chain(doors).chain(agents).chain(goals) {
            text.add(&addition)?;
        }
        Ok(())
    }

    fn places(&self) -> Result<String, EditError> {
        let mut text = heading("The places");
        text += "# A place is a room unless `kind` says what else it is. Its `floor` (a number)\n\
                 # and its `area` (in square meters) may be said, too.\n\n[rooms]\n";
        for room in &self.rooms {
            let value = inline_table(&room_settings(room)?);
            text += &format!("{} = {value}\n", key_text(&room.name));
        }
        if !self.doors.is_empty() {
            text += "\n# Doors lead both ways. The number is the length of the way in meters.\n\
                     [doors]\n";
            let mut firsts: Vec<&str> = Vec::new();
            for door in &self.doors {
                if !firsts.contains(&door.from.as_str()) {
                    firsts.push(&door.from);
                }
            }
            for first in firsts {
                let doors = self.doors.iter().filter(|door| door.from == first);
                let to = |door: &DoorAddition| {
                    Ok(format!("{} = {}", key_text(&door.to), door_value(door)?))
                };
                let doors: Vec<String> = doors.map(to).collect::<Result<_, EditError>>()?;
                text += &format!("{} = {{ {} }}\n", key_text(first), doors.join(", "));
            }
        }
        Ok(text + "\n")
    }

    fn devices(&self) -> String {
        if self.agents.is_empty() {
            return String::new();
        }
        let mut text = heading("What stands there");
        text += "# One [[agent]] each. The agents that plan need no entry: they are there.\n\n";
        for agent in &self.agents {
            text += &format!("{}\n", agent_text(agent));
        }
        text
    }

    fn building(&self) -> String {
        let is_simulated = |agent: &AgentAddition| agent.driver.as_deref() == Some(SIMULATED);
        if !self.agents.iter().any(is_simulated) {
            return String::new();
        }
        let mut text = heading("The simulated building");
        text += "# For agents with driver = \"simulated\"; real devices need none of it.\n\n\
                 [building]\n";
        let rooms = self.rooms.iter().filter(|room| is_room(room)).enumerate();
        let celsius = |(index, room): (usize, &RoomAddition)| {
            let steps = u32::try_from(index % CELSIUS_ROOMS).unwrap_or(0);
            SettingText::number(&room.name, FIRST_CELSIUS + CELSIUS_STEP * f64::from(steps))
        };
        let temperatures: Vec<_> = rooms.map(celsius).collect();
        if !temperatures.is_empty() {
            text +=
                "# The true temperature of each room in °C, which agents find out by measuring.\n";
            text += &format!("temperatures = {}\n", inline_table(&temperatures));
        }
        text + "# 1.0 is real time; 0.1 is ten times as fast.\ntime-scale = 1.0\n"
    }
}

fn kept(name: &str, goal: String) -> GoalAddition {
    GoalAddition { name: name.to_owned(), goal, is_kept: true, settings: Vec::new() }
}

fn is_room(room: &RoomAddition) -> bool {
    room.kind.as_deref().is_none_or(|kind| kind == "room")
}

fn is_robot(agent: &AgentAddition) -> bool {
    crate::words::ROBOTS.contains(&agent.plugin.as_str())
}

/// Returns the name of a sensor, from its quantity and its place.
fn sensor_name(quantity: &str, place: &str) -> String {
    match quantity {
        "temperature" => format!("thermometer-{place}"),
        quantity => format!("{quantity}-{place}"),
    }
}

fn head(name: &str) -> String {
    format!(
        "# The ecosystem `{name}`: its places, what stands there, and what is to be so.\n\
         #\n\
         # Made by `althing init`. `althing check FILE` finds what does not fit, and\n\
         # `althing add` adds rooms, doors, agents and goals. Lines that begin with # are\n\
         # comments, for people.\n\n\
         [ecosystem]\nname = {}\n\n",
        quoted(name)
    )
}

/// Returns a heading within the file.
fn heading(words: &str) -> String {
    let begun = format!("# ── {words} ");
    let missing = HEADING_COLUMNS.saturating_sub(begun.chars().count());
    format!("{begun}{}\n", "─".repeat(missing))
}
