//! A long day: one goal after the other in one trial, so that whoever looks on may measure what is held
//! after each.

use std::time::Duration;

use acl::content::{Keep, Partition};
use serde_json::json;

use crate::city::City;
use crate::script::{Script, Wish};
use crate::trial::{self, TrialError};

/// How long a measurement counts as known: the next goal about that room needs a plan again.
const VALID_FOR: &str = "1s";

/// How long after a goal has ended before the next is asked for.
const REST: Duration = Duration::from_millis(1_200);

/// How long a goal may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// Asks for so many goals; `look` is told after each. What agents remember of messages is bounded by
/// `heard_messages_max`, so that its bound is soon reached.
///
/// # Errors
///
/// If the trial cannot be set up.
pub fn endure(
    seed: u64,
    goals: usize,
    heard_messages_max: usize,
    mut look: impl FnMut(usize),
) -> Result<Vec<String>, TrialError> {
    let folder = trial::folder()?;
    let runtime = trial::runtime()?;
    runtime.block_on(async {
        let mut script = Script::draw(seed)?;
        (script.wishes, script.faults, script.errands) = Default::default();
        for entry in script.agents.iter_mut().filter(|entry| entry.name.starts_with("wall")) {
            entry.config["valid-for"] = json!(VALID_FOR);
        }
        let walls = script.agents.iter().filter(|entry| entry.name.starts_with("wall"));
        let rooms = walls.filter_map(|entry| entry.config["location"].as_str());
        let rooms: Vec<_> = rooms.map(str::to_owned).collect();
        let mut city = City::enduring(script, heard_messages_max, folder.path())?;
        for number in 0..city.posts.len() {
            city.start(number);
        }
        tokio::time::sleep(REST * 3).await;
        let mut broken = Vec::new();
        for goal in 0..goals {
            let room = &rooms[goal % rooms.len()];
            broken.extend(reach(&mut city, goal, room).await);
            look(goal + 1);
        }
        Ok(broken)
    })
}

/// Asks for one goal, and waits for its end; what is wrong, if it has none in time.
async fn reach(city: &mut City, number: usize, room: &str) -> Option<String> {
    let wish = Wish {
        at: city.now(),
        by: 0,
        goal: format!("(known-temperature {room})"),
        rooms: vec![room.to_owned()],
        keep: Keep::Achieve,
        partition: Partition::Pursue,
    };
    city.people[0].wish(number, &wish);
    let until = city.now() + PATIENCE;
    let is_over = |city: &mut City| {
        city.people[0].hear();
        city.people[0].stories.values().all(|story| story.is_settled())
    };
    while !is_over(city) && city.now() < until {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let is_late = !is_over(city);
    // What people remember is not what is measured.
    let story = city.people[0].stories.remove(&number);
    tokio::time::sleep(REST).await;
    is_late.then(|| format!("goal {number} about `{room}` never ends: {story:?}"))
}
