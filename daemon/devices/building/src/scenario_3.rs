//! Scenario 3 of the paper: people come to the entry, the camera sees them, and a robot goes to the
//! entry. At the robot's screen each visitor must be validated: the robot puts a question to the
//! keyboards, and a visitor with a right answer is validated.
//!
//! Seed 0 is the paper's office; its entry is the corridor. Every other seed draws another
//! building, another entry, and the order of the visitors.

use serde::Serialize;

use crate::draw::{LayoutDraw, paper_places};
use crate::error::LayoutError;
use crate::layout::Layout;
use crate::layout::PlaceDirection;
use crate::replay::{ReplayedLog, replay};
use crate::seeded_random::Random;
use crate::truth::{BuildingEvent, Truth};

/// Name of the robot with the screen for logging in.
const ROBOT: &str = "turtlebot-1";
/// Name of the camera with the view of the entry.
const CAMERA: &str = "camera-1";

/// The answers that people at the keyboards give to the robot's question about a visitor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AnswerPattern {
    /// Two keyboards give the right answer at the same time.
    TwoAtOnce,
    /// The first answer is wrong, the next one is right.
    WrongThenRight,
    /// No keyboard answers.
    NobodyAnswers,
    /// Every answer is wrong.
    OnlyWrong,
}

impl AnswerPattern {
    /// Whether these answers validate the visitor.
    pub fn is_valid(self) -> bool {
        matches!(self, AnswerPattern::TwoAtOnce | AnswerPattern::WrongThenRight)
    }
}

/// A visit of a person to the entry.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Visit {
    /// The name of the person.
    pub person: String,
    /// The answers that the keyboards give to the question about this person.
    pub manner: AnswerPattern,
}

/// The outcome of a visit, as the agents of the ecosystem report it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct VisitOutcome {
    /// The name of the person.
    pub person: String,
    /// Times at which the question about this person was shown at a keyboard. Each time is the
    /// sequence number of the building's next occurrence.
    pub asked: Vec<u64>,
    /// Whether the person was validated.
    pub validated: bool,
}

/// A building and the visits of scenario 3 in it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct AccessScenario {
    /// The seed of the random choices.
    pub seed: u64,
    /// The building.
    pub layout: Layout,
    /// Name of the location where people enter.
    pub entry: String,
    /// The visits in their order. The visitors stay in the building.
    pub visits: Vec<Visit>,
}

impl AccessScenario {
    /// Returns the scenario of this seed. It is the same on every machine.
    pub fn seeded(seed: u64) -> AccessScenario {
        let drawn = if seed == 0 { paper_office() } else { draw(seed) };
        drawn.expect("invariant: word lists and ranges stay within what a layout allows")
    }

    /// Returns the name of the camera with the view of the entry.
    pub fn camera(&self) -> &'static str {
        CAMERA
    }

    /// Returns the name of the robot with the screen for logging in.
    pub fn robot(&self) -> &'static str {
        ROBOT
    }

    /// Checks the truth of the building and the reported outcomes of the visits.
    ///
    /// The following must hold:
    /// 1. All visitors came, in the order of the visits, and the question was asked for each of
    ///    them.
    /// 2. The robot set off only after the first visitor had come, and it was at the entry each
    ///    time the question was shown at a keyboard.
    /// 3. Exactly the visitors with a right answer were validated.
    ///
    /// # Errors
    ///
    /// Returns a text for each way in which the scenario failed.
    pub fn check(&self, truth: &Truth, admissions: &[VisitOutcome]) -> Result<(), Vec<String>> {
        let mut replayed = replay(&self.layout, truth);
        let mut problems = std::mem::take(&mut replayed.problems);
        problems.extend(self.check_entering(truth, &replayed));
        if admissions.len() < self.visits.len() {
            problems.push(format!("{} of {} came", admissions.len(), self.visits.len()));
        }
        for (visit, admission) in self.visits.iter().zip(admissions) {
            let Visit { person, manner } = visit;
            if admission.person != *person || admission.asked.is_empty() {
                problems.push(format!("the question was not asked for `{person}`"));
            }
            for asked in &admission.asked {
                let place = replayed.place_of(&self.layout, ROBOT, *asked);
                if place != Some(&self.entry) {
                    let place = place.unwrap_or("nowhere");
                    problems.push(format!("`{ROBOT}` asked for `{person}`, but was in `{place}`"));
                }
            }
            if admission.validated != manner.is_valid() {
                let was = if admission.validated { "was" } else { "was not" };
                problems.push(format!("`{person}` {was} validated, though {manner:?}"));
            }
        }
        if problems.is_empty() { Ok(()) } else { Err(problems) }
    }

    fn check_entering(&self, truth: &Truth, replayed: &ReplayedLog) -> Vec<String> {
        let mut problems = Vec::new();
        let entered: Vec<_> = truth
            .occurrences()
            .filter_map(|occurrence| match &occurrence.event {
                BuildingEvent::Entered { person, location } if *location == self.entry => {
                    Some((occurrence.sequence, person))
                }
                _ => None,
            })
            .collect();
        let expected: Vec<_> = self.visits.iter().map(|visit| &visit.person).collect();
        let came: Vec<_> = entered.iter().map(|(_, person)| *person).collect();
        if came != expected {
            problems.push(format!("expected {expected:?} at `{}`, found {came:?}", self.entry));
        }
        let first = entered.first().map_or(u64::MAX, |(sequence, _)| *sequence);
        match replayed.trips.first() {
            Some(trip) if trip.sequence < first => {
                problems.push(format!("`{}` drove before a person had come", trip.robot));
            }
            Some(_) => (),
            None => problems.push(format!("`{ROBOT}` did not drive")),
        }
        problems
    }
}

// === Drawing ===

fn paper_office() -> Result<AccessScenario, LayoutError> {
    let mut layout = paper_places()?;
    layout.add_robot(ROBOT, "office2", 0.3)?;
    let manners =
        [AnswerPattern::TwoAtOnce, AnswerPattern::WrongThenRight, AnswerPattern::NobodyAnswers];
    finish(0, layout, "corridor", &manners)
}

fn draw(seed: u64) -> Result<AccessScenario, LayoutError> {
    let mut draw = LayoutDraw::new(seed);
    let mut layout = draw.places()?;
    let entry = draw.corridors[0];
    let start = draw.rooms[draw.random.below(draw.rooms.len())];
    layout.add_robot(ROBOT, start, draw.random.between(2, 10) as f64 / 10.0)?;
    let manners =
        [AnswerPattern::TwoAtOnce, AnswerPattern::WrongThenRight, AnswerPattern::NobodyAnswers];
    let manners = Random::new(seed).sample(&manners, manners.len());
    finish(seed, layout, entry, &manners)
}

/// Completes the building with the camera, and returns the scenario with its visits. Each visitor
/// gets the answers of one element of `manners`, and a last visitor gets wrong answers only. That
/// visitor comes last, because wrong answers lock the robot's screen.
fn finish(
    seed: u64,
    mut layout: Layout,
    entry: &str,
    manners: &[AnswerPattern],
) -> Result<AccessScenario, LayoutError> {
    let view = PlaceDirection { location: entry.to_owned(), pan: 0.0, tilt: 0.0 };
    layout.add_camera(CAMERA, entry, vec![view])?;
    let manners = manners.iter().copied().chain([AnswerPattern::OnlyWrong]);
    let visits = { manners.zip(["alice", "bob", "carol", "dave"]) }
        .map(|(manner, person)| Visit { person: person.to_owned(), manner })
        .collect();
    Ok(AccessScenario { seed, layout, entry: entry.to_owned(), visits })
}

#[cfg(test)]
mod tests {
    use super::{AccessScenario, ROBOT, VisitOutcome};
    use crate::Building;

    /// Plays the scenario, and returns the problems that the check finds. The flags are whether the
    /// robot comes to the entry, whether it waits for the first visitor, and whether the true
    /// outcome is reported.
    async fn problems(seed: u64, comes: bool, waits: bool, honest: bool) -> Vec<String> {
        let access = AccessScenario::seeded(seed);
        let building = Building::new(access.layout.clone(), 1.0).unwrap();
        let mut admissions = Vec::new();
        if !waits {
            drive(&building, &access.entry).await;
        }
        for visit in &access.visits {
            building.enter(&visit.person, &access.entry).unwrap();
            if comes {
                drive(&building, &access.entry).await;
            }
            let asked = vec![building.truth().next_sequence()];
            let validated = visit.manner.is_valid() == honest;
            admissions.push(VisitOutcome { person: visit.person.clone(), asked, validated });
        }
        access.check(&building.truth(), &admissions).err().unwrap_or_default()
    }

    async fn drive(building: &Building, to: &str) {
        let layout = building.truth().layout().clone();
        let mut seen = std::collections::BTreeMap::from([(to.to_owned(), to.to_owned())]);
        let mut frontier = std::collections::VecDeque::from([to.to_owned()]);
        while let Some(place) = frontier.pop_front() {
            for neighbor in layout.neighbors(&place) {
                if !seen.contains_key(neighbor) {
                    seen.insert(neighbor.to_owned(), place.clone());
                    frontier.push_back(neighbor.to_owned());
                }
            }
        }
        while let Some(place) = building.place_of(ROBOT).ok().filter(|place| place != to) {
            building.navigate(ROBOT, &seen[&place]).await.unwrap();
        }
    }

    #[tokio::test(start_paused = true)]
    async fn the_check_passes_only_if_nothing_is_left_out() {
        for seed in 0..100 {
            assert_eq!(problems(seed, true, true, true).await, [""; 0], "seed {seed}");
            for (comes, waits, honest, word) in [
                (false, true, true, "but was in"),
                (true, false, true, "before a person had come"),
                (true, true, false, "validated, though"),
            ] {
                let problems = problems(seed, comes, waits, honest).await;
                assert!(problems.iter().any(|text| text.contains(word)), "{seed}: {problems:?}");
            }
        }
    }
}
