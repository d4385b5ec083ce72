//! Asks a person for a new ecosystem.

use std::str::FromStr;

use crate::addition::{DoorAddition, GoalAddition, RoomAddition};
use crate::draft::{DeviceOffer, EcosystemDraft};
use crate::edit_error::EditError;
use crate::words::{DoorWords, PlaceOptions, RobotWords, SensorWords, check_name};

/// Length of a door's way in meters if the person names none: one can be corrected later, and a
/// plan needs one.
const USUAL_METERS: f64 = 4.0;

/// Number of answers that are not understood until the interview ends: a program that answers
/// always the same must not be asked for ever.
const MISTAKES_MAX: usize = 20;

/// The person that is asked.
pub trait Respondent {
    /// Tells the person something.
    fn tell(&mut self, text: &str);

    /// Asks a question; `usual` is the answer of a person that only presses Enter. Returns the
    /// answer without spaces around it; `None` if the person gives none, because the input has
    /// ended.
    fn ask(&mut self, question: &str, usual: &str) -> Option<String>;

    /// Checks the text of the file that the answers so far make. Returns the first mistake, as a
    /// sentence for the person.
    fn mistake(&mut self, text: &str) -> Option<String>;
}

/// Asks a person for rooms, doors, devices and goals. `draft` has what is known already, which is
/// not asked for, and a name to suggest. `offers` are devices that were found. Returns `None` if
/// the person stops answering.
pub fn interview(
    respondent: &mut dyn Respondent,
    draft: EcosystemDraft,
    offers: &[DeviceOffer],
) -> Option<EcosystemDraft> {
    let mut questions = InterviewState { respondent, draft, mistakes: 0 };
    questions.name()?;
    if questions.draft.rooms.is_empty() {
        questions.rooms()?;
    }
    if questions.draft.doors.is_empty() && questions.draft.rooms.len() > 1 {
        questions.doors()?;
    }
    questions.offers(offers)?;
    questions.robots()?;
    questions.sensors()?;
    if questions.draft.goals.is_empty() {
        questions.goals()?;
    }
    Some(questions.draft)
}

struct InterviewState<'r> {
    respondent: &'r mut dyn Respondent,
    draft: EcosystemDraft,
    mistakes: usize,
}

// === impl InterviewState ===

impl InterviewState<'_> {
    /// Asks until `read` understands the answer.
    fn until<T>(
        &mut self,
        question: &str,
        usual: &str,
        mut read: impl FnMut(&mut EcosystemDraft, &str) -> Result<T, EditError>,
    ) -> Option<T> {
        loop {
            let answer = self.respondent.ask(question, usual)?;
            let answer = if answer.is_empty() { usual.to_owned() } else { answer };
            let before = self.draft.clone();
            let value = read(&mut self.draft, &answer).and_then(|value| {
                // Before its rooms are known, a file is no ecosystem.
                let mistake = match self.draft.rooms.is_empty() {
                    true => None,
                    false => self.respondent.mistake(&self.draft.text()?),
                };
                mistake.map_or(Ok(value), |mistake| Err(EditError::Refused(mistake)))
            });
            match value {
                Ok(value) => return Some(value),
                Err(error) => {
                    self.draft = before;
                    self.respondent.tell(&format!("  {error}"));
                    self.mistakes += 1;
                    if self.mistakes >= MISTAKES_MAX {
                        return None;
                    }
                }
            }
        }
    }

    fn name(&mut self) -> Option<()> {
        let usual = self.draft.name.clone();
        self.until("A name for this building", &usual, |draft, answer| {
            check_name(answer, "an ecosystem")?;
            draft.name = answer.to_owned();
            Ok(())
        })
    }

    fn rooms(&mut self) -> Option<()> {
        self.respondent.tell(
            "\nThe rooms, with spaces between them. A corridor is written hall:corridor.\n\
             Names are in lower case.",
        );
        self.until("Rooms", "", |draft, answer| {
            let rooms = words::<PlaceOptions>(&answer.replace(',', " "))?;
            if rooms.is_empty() {
                let (word, what, form) = (String::new(), "room", "at least one, such as kitchen");
                return Err(EditError::Word { word, what, form, suggestion: None });
            }
            let mut added: Vec<RoomAddition> = Vec::new();
            for room in rooms {
                if added.iter().any(|other| other.name == room.name) {
                    return Err(EditError::Twice(room.name));
                }
                added.push(room.into());
            }
            draft.rooms = added;
            Ok(())
        })
    }

    fn doors(&mut self) -> Option<()> {
        let usual = usual_doors(&self.draft.rooms);
        self.respondent.tell(
            "\nThe doors, as hall=kitchen:4 with the length of the way in meters.\n\
             Without a door, no robot comes into a room; `-` is for no door.",
        );
        self.until("Doors", &usual, |draft, answer| {
            let doors: Vec<DoorAddition> =
                words::<DoorWords>(answer)?.into_iter().map(DoorAddition::from).collect();
            for door in &doors {
                for side in [&door.from, &door.to] {
                    known_room(draft, side)?;
                }
                if door.from == door.to {
                    return Err(EditError::DoorToItself(door.from.clone()));
                }
            }
            draft.doors = doors;
            Ok(())
        })
    }

    /// Asks for the room of each sensor that was found. Whatever else was found is kept as
    /// comments.
    fn offers(&mut self, offers: &[DeviceOffer]) -> Option<()> {
        if offers.is_empty() {
            return Some(());
        }
        self.respondent.tell("\nFound near this machine:");
        for offer in offers {
            if offer.agent.is_none() {
                self.respondent.tell(&format!("  {} (kept in the file as a comment)", offer.about));
                self.draft.take_offer(offer, None);
                continue;
            }
            let question = format!("  {}: in which room? (- leaves it out)", offer.about);
            self.until(&question, "-", |draft, answer| {
                if answer == "-" {
                    draft.take_offer(offer, None);
                    return Ok(());
                }
                known_room(draft, answer)?;
                draft.take_offer(offer, Some(answer));
                Ok(())
            })?;
        }
        Some(())
    }

    fn robots(&mut self) -> Option<()> {
        self.respondent.tell(
            "\nSimulated robots and sensors let you try it now; real ones take their places\n\
             later.",
        );
        let question = "Robots, such as turtlebot@hall (- for none)";
        self.until(question, "-", |draft, answer| {
            let robots = words::<RobotWords>(answer)?;
            for robot in &robots {
                known_room(draft, &robot.start)?;
            }
            robots.iter().for_each(|robot| draft.add_robot(robot, true));
            Ok(())
        })
    }

    fn sensors(&mut self) -> Option<()> {
        let question = "Sensors, such as temperature@kitchen co2@kitchen (- for none)";
        self.until(question, "-", |draft, answer| {
            let before = draft.agents.clone();
            for sensor in words::<SensorWords>(answer)? {
                let added = match draft.add_sensor(&sensor, true) {
                    Ok(()) if is_at_unknown_room(draft, &sensor) => {
                        known_room(draft, &sensor.place)
                    }
                    added => added,
                };
                if let Err(error) = added {
                    draft.agents = before;
                    return Err(error);
                }
            }
            Ok(())
        })
    }

    fn goals(&mut self) -> Option<()> {
        let suggestions = self.draft.goal_suggestions();
        let usual = if suggestions.is_empty() { "-" } else { "1" };
        self.respondent.tell("\nWhat is to be so, from now on?");
        for (index, (goal, about)) in suggestions.iter().enumerate() {
            self.respondent.tell(&format!("  {}  {about}: {}", index + 1, goal.goal));
        }
        let question = "A number, a goal of your own, or - for none";
        self.until(question, usual, |draft, answer| {
            let chosen = answer.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
            if let Some((goal, _)) = chosen.and_then(|index| suggestions.get(index)) {
                draft.goals = vec![goal.clone()];
                return Ok(());
            }
            if answer == "-" {
                return Ok(());
            }
            if !answer.contains([' ', '(']) {
                let form = "one of the numbers, or a goal such as (known-temperature kitchen)";
                let (word, what) = (answer.to_owned(), "goal");
                return Err(EditError::Word { word, what, form, suggestion: None });
            }
            let (name, goal) = ("first".to_owned(), answer.to_owned());
            draft.goals = vec![GoalAddition { name, goal, is_kept: true, settings: Vec::new() }];
            Ok(())
        })
    }
}

/// Reads the words of an answer; `-` is for none.
fn words<T: FromStr<Err = EditError>>(answer: &str) -> Result<Vec<T>, EditError> {
    let words = answer.split([' ', ';']).map(|word| word.trim_matches(','));
    words.filter(|word| !word.is_empty() && *word != "-").map(str::parse).collect()
}

fn known_room(draft: &EcosystemDraft, name: &str) -> Result<(), EditError> {
    if draft.rooms.iter().any(|room| room.name == name) {
        return Ok(());
    }
    let known: Vec<String> = draft.rooms.iter().map(|room| room.name.clone()).collect();
    let nearest = pddl::nearest(name, known.iter().map(String::as_str)).map(str::to_owned);
    Err(EditError::UnknownRoom { name: name.to_owned(), nearest, known })
}

/// Whether the sensor that was added last stands in a room that is unknown.
fn is_at_unknown_room(draft: &EcosystemDraft, sensor: &SensorWords) -> bool {
    let is_carried =
        draft.agents.last().is_some_and(|agent| agent.plugin == "ir-temperature-sensor");
    !is_carried && known_room(draft, &sensor.place).is_err()
}

/// Returns doors for a building of which only the rooms are known: all rooms at its first corridor,
/// or else at its first room.
fn usual_doors(rooms: &[RoomAddition]) -> String {
    let is_corridor = |room: &&RoomAddition| room.kind.as_deref() == Some("corridor");
    let Some(first) = rooms.iter().find(is_corridor).or(rooms.first()) else {
        return String::new();
    };
    let others = rooms.iter().filter(|room| room.name != first.name);
    let doors: Vec<_> =
        others.map(|room| format!("{}={}:{USUAL_METERS}", first.name, room.name)).collect();
    doors.join(" ")
}
