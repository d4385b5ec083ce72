//! A long run: one goal after the other in one trial, so that a caller can measure the memory in
//! use after each.

use std::time::Duration;

use acl::content::{Keep, Partition};
use serde_json::json;

use crate::cluster::Cluster;
use crate::script::{ScriptedGoal, TrialScript};
use crate::trial;
use crate::trial_error::TrialError;

/// How long a measured value counts as known: the next goal about that room needs a plan again.
const VALID_FOR: &str = "1s";

/// Pause between the end of a goal and the request of the next.
const REST: Duration = Duration::from_millis(1_200);

/// Time limit of a goal.
const PATIENCE: Duration = Duration::from_secs(60);

/// Requests `goals` goals and calls `look` after each. `heard_messages_max` is the size of the
/// duplicate window, kept small so that it soon fills up. Returns the goals that did not end in
/// time.
///
/// # Errors
///
/// Returns an error if the trial cannot be set up.
pub fn endure(
    seed: u64,
    goals: usize,
    heard_messages_max: usize,
    mut look: impl FnMut(usize),
) -> Result<Vec<String>, TrialError> {
    let folder = trial::folder()?;
    let runtime = trial::runtime()?;
    runtime.block_on(async {
        let mut script = TrialScript::draw(seed)?;
        (script.scripted_goals, script.faults, script.annex_requests_at) = Default::default();
        for entry in script.agents.iter_mut().filter(|entry| entry.name.starts_with("wall")) {
            entry.config["valid-for"] = json!(VALID_FOR);
        }
        let walls = script.agents.iter().filter(|entry| entry.name.starts_with("wall"));
        let rooms = walls.filter_map(|entry| entry.config["location"].as_str());
        let rooms: Vec<_> = rooms.map(str::to_owned).collect();
        let mut city = Cluster::enduring(script, heard_messages_max, folder.path())?;
        for number in 0..city.machines.len() {
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

/// Requests one goal and waits for its end. Returns an error text if it does not end in time.
async fn reach(city: &mut Cluster, number: usize, room: &str) -> Option<String> {
    let wish = ScriptedGoal {
        at: city.now(),
        by: 0,
        goal: format!("(known-temperature {room})"),
        rooms: vec![room.to_owned()],
        keep: Keep::Achieve,
        partition: Partition::Pursue,
    };
    city.people[0].request_goal(number, &wish);
    let until = city.now() + PATIENCE;
    let is_over = |city: &mut Cluster| {
        city.people[0].read_reports();
        city.people[0].traces.values().all(|story| story.is_settled())
    };
    while !is_over(city) && city.now() < until {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let is_late = !is_over(city);
    // The stories of the people are not part of the measurement.
    let story = city.people[0].traces.remove(&number);
    tokio::time::sleep(REST).await;
    is_late.then(|| format!("goal {number} about `{room}` never ends: {story:?}"))
}
