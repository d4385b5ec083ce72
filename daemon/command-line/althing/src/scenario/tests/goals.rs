//! Tests of several goals at the same time, in the paper's office.

use std::time::Duration;

use ::building::{BuildingDevice, Layout, SeededScenario};
use acl::content::{Keep, Outcome, Partition};
use acl::{AgentId, ConversationId};
use agent::Mode;
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use tokio::time::timeout;

use super::MODES;
use crate::scenario::launched::{self, LaunchedScenario, ScenarioSubstrate};
use crate::scenario::temperatures;

/// How long a test waits for a report: longer than any of its goals takes, in the building's time.
const PATIENCE: Duration = Duration::from_secs(600);

/// Most attempts to find out whether all devices are there: devices arrive within milliseconds.
const ARRIVALS_MAX: usize = 50;

/// The paper's office, and the users in it. Each user has a keyboard, so that each receives only
/// the reports of one goal.
struct Office {
    set: LaunchedScenario,
    users: Vec<User>,
}

struct User {
    terminal: Terminal,
    goal: Option<ConversationId>,
    heard: Vec<String>,
}

impl Office {
    async fn open(mode: Mode) -> Office {
        Office::of(&Layout::seeded(0), mode).await
    }

    async fn of(scenario: &SeededScenario, mode: Mode) -> Office {
        let set = launched::launch_scenario(
            &temperatures::setting(scenario),
            ScenarioSubstrate::Memory,
            mode,
            None,
            None,
        )
        .await
        .expect("the stage");
        let mut office = Office { set, users: Vec::new() };
        // A goal about every room is reached once all devices are there.
        let all = "(forall (?r - room) (known-temperature ?r))";
        for _ in 0..ARRIVALS_MAX {
            let user = office.ask(all, Keep::Achieve, 0).await;
            if office.end_of(user).await == Outcome::Done {
                return office;
            }
        }
        panic!("the devices never came: {:#?}", office.users.last().map(|user| &user.heard));
    }

    /// Requests a goal from the keyboard of a new user. Returns the index of the user.
    async fn ask(&mut self, goal: &str, keep: Keep, priority: i32) -> usize {
        let (keyboard, terminal) = Keyboard::with_terminal();
        let id = AgentId::new(&format!("user-{}", self.users.len())).expect("a name");
        self.set.node.launch(id, keyboard, "smart-office");
        let wish =
            GoalRequest { goal: goal.to_owned(), keep, priority, partition: Partition::Pursue };
        terminal.requests.send(UserRequest::RequestGoal(wish)).await.expect("the keyboard lives");
        self.users.push(User { terminal, goal: None, heard: Vec::new() });
        self.users.len() - 1
    }

    /// Waits for the next report that a user receives. Returns its outcome and its text.
    async fn hears(&mut self, user: usize) -> (Outcome, String) {
        let User { terminal, goal, heard } = &mut self.users[user];
        loop {
            let next = timeout(PATIENCE, terminal.events.recv()).await;
            let next = next.unwrap_or_else(|_| panic!("user {user} hears no more: {heard:#?}"));
            let (outcome, detail) = match next.expect("the keyboard lives") {
                UserEvent::Report(_, report) => (report.outcome, report.detail),
                UserEvent::Refused(_, refusal) => (Outcome::Failed, refusal.detail),
                UserEvent::Unanswered(_, why) => (Outcome::Failed, why),
                UserEvent::Sent(about) => {
                    *goal = Some(about.conversation);
                    continue;
                }
                _ => continue,
            };
            heard.push(format!("{outcome}: {detail}"));
            return (outcome, detail);
        }
    }

    /// Waits until a user receives a report that contains `words`.
    async fn until(&mut self, user: usize, words: &str) {
        while !self.hears(user).await.1.contains(words) {}
    }

    /// Waits until the goal of a user holds or has ended, and returns the outcome.
    async fn end_of(&mut self, user: usize) -> Outcome {
        loop {
            let (outcome, _) = self.hears(user).await;
            if outcome != Outcome::Progress {
                return outcome;
            }
        }
    }

    /// Returns the name of the place where the robot really is.
    fn robot(&self) -> String {
        self.place_of("turtlebot-1")
    }

    fn place_of(&self, robot: &str) -> String {
        self.set.building.place_of(robot).expect("it is somewhere")
    }

    async fn gives_up(&mut self, user: usize) {
        let User { terminal, goal, .. } = &self.users[user];
        let goal = goal.clone().expect("it was asked for");
        terminal.requests.send(UserRequest::Cancel(goal)).await.expect("the keyboard lives");
    }

    fn told(&self, user: usize, words: &str) -> bool {
        self.users[user].heard.iter().any(|line| line.contains(words))
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_waits_for_a_robot_that_is_in_use() {
    for mode in MODES {
        let mut office = Office::open(mode).await;
        let first = office.ask("(at turtlebot-1 office2)", Keep::Achieve, 0).await;
        office.until(first, "a plan of").await;
        let second = office.ask("(at turtlebot-1 conf-room)", Keep::Achieve, 0).await;
        office.until(second, "waiting: it needs what `(at turtlebot-1 office2)` is using").await;

        assert_eq!(office.end_of(first).await, Outcome::Done);
        assert_eq!(office.end_of(second).await, Outcome::Done);

        assert!(!office.told(first, "gives way"), "{mode:?}");
        assert_eq!(office.robot(), "conf-room", "{mode:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_goal_of_lower_priority_gives_way_and_goes_on_afterwards() {
    for mode in MODES {
        let mut office = Office::open(mode).await;
        let patrol = office.ask("(at turtlebot-1 office2)", Keep::Achieve, -10).await;
        office.until(patrol, "a plan of").await;
        let urgent = office.ask("(at turtlebot-1 conf-room)", Keep::Achieve, 0).await;

        assert_eq!(office.end_of(urgent).await, Outcome::Done, "{:#?}", office.users[urgent].heard);
        assert_eq!(office.robot(), "conf-room", "{mode:?}");
        assert_eq!(office.end_of(patrol).await, Outcome::Done, "{:#?}", office.users[patrol].heard);

        assert!(office.told(patrol, "gives way to `(at turtlebot-1 conf-room)`"), "{mode:?}");
        assert_eq!(office.robot(), "office2", "{mode:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn goals_that_undo_each_other_are_named() {
    for mode in MODES {
        let mut office = Office::open(mode).await;
        let kept = office.ask("(at turtlebot-1 office2)", Keep::Maintain, 0).await;
        assert_eq!(office.end_of(kept).await, Outcome::Holds);

        let other = office.ask("(at turtlebot-1 conf-room)", Keep::Achieve, 0).await;
        assert_eq!(office.end_of(other).await, Outcome::Failed, "{mode:?}");
        let undoes = "every plan for it would undo `(at turtlebot-1 office2)`, which is kept";
        assert!(office.told(other, undoes), "{mode:?} {:#?}", office.users[other].heard);
        assert_eq!(office.robot(), "office2", "{mode:?}");

        let urgent = office.ask("(at turtlebot-1 conf-room)", Keep::Achieve, 1).await;
        assert_eq!(office.end_of(urgent).await, Outcome::Done, "a greater priority may, {mode:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_cancelled_goal_leaves_its_agents_to_others() {
    for mode in MODES {
        let mut office = Office::open(mode).await;
        let first = office.ask("(at turtlebot-1 office2)", Keep::Achieve, 0).await;
        office.until(first, "a plan of").await;
        let second = office.ask("(at turtlebot-1 conf-room)", Keep::Achieve, 0).await;
        office.until(second, "waiting").await;
        office.gives_up(first).await;
        assert_eq!(office.end_of(first).await, Outcome::Cancelled, "{mode:?}");
        assert_eq!(office.end_of(second).await, Outcome::Done, "{mode:?}");
        assert_eq!(office.robot(), "conf-room", "{mode:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn two_robots_go_side_by_side() {
    let robots = |scenario: &SeededScenario| -> Vec<String> {
        let devices = scenario.layout.devices().iter();
        let robots = devices.filter(|device| matches!(device, BuildingDevice::Robot { .. }));
        robots.map(|robot| robot.name().to_owned()).collect()
    };
    let scenario = (1..100).map(Layout::seeded).find(|scenario| robots(scenario).len() == 2);
    let scenario = scenario.expect("some building has two robots");
    for mode in MODES {
        let mut office = Office::of(&scenario, mode).await;
        let mut asked = Vec::new();
        for robot in robots(&scenario) {
            let here = office.place_of(&robot);
            let there = scenario.layout.rooms().find(|room| *room != here).expect("two rooms");
            let user = office.ask(&format!("(at {robot} {there})"), Keep::Achieve, 0).await;
            office.until(user, "a plan of").await;
            asked.push((user, robot, there));
        }
        let (_, first, goal) = &asked[0];
        assert_ne!(office.place_of(first), *goal, "it is still on its way, {mode:?}");
        for (user, robot, there) in asked {
            assert_eq!(office.end_of(user).await, Outcome::Done, "{:#?}", office.users[user].heard);
            assert!(!office.told(user, "waiting"), "{mode:?}");
            assert_eq!(office.place_of(&robot), there, "{mode:?}");
        }
    }
}
