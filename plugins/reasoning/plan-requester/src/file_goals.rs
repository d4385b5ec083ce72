//! Goals of the ecosystem file that are asked for by themselves, by the replica that leads.

use acl::ConversationId;
use acl::content::{Achieve, GoalTimes, Outcome};
use agent::Context;
use goal_schedule::{Asking, Author, Schedule, SeenOccurrences, TimeOptions, read_options, spoken};
use jiff::Timestamp;
use jiff::tz::TimeZone;

use crate::PlanRequester;
use crate::due_goal::{DueGoal, timestamp};

/// Words for the times of a goal that is always to be pursued.
const ALWAYS: &str = "always";

/// Resource of a host: the goals of the ecosystem file that are asked for by themselves, and the
/// ecosystem's time zone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FileGoals {
    /// The goals.
    pub goals: Vec<FileGoal>,
    /// Name of the time zone of the ecosystem; `None` for that of each machine.
    pub time_zone: Option<String>,
}

/// One goal of the ecosystem file that is asked for by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct FileGoal {
    /// Name of the goal in the file.
    pub name: String,
    /// The goal.
    pub goal: Achieve,
    /// The times; none for a goal that is always to be pursued.
    pub times: TimeOptions,
    /// Whether the goal is to be pursued at all times, up to the end that `times` may give.
    pub is_always: bool,
}

impl FileGoal {
    /// Returns the conversation under which `althing goals` shows the goal.
    pub fn conversation(&self) -> ConversationId {
        ConversationId::of_file_goal(&self.name)
    }

    /// Returns the times in words.
    fn words(&self) -> String {
        match (self.is_always, spoken(&self.times)) {
            (true, words) if words.is_empty() => ALWAYS.to_owned(),
            (true, words) => format!("{ALWAYS}, {words}"),
            (false, words) => words,
        }
    }

    /// Returns the times in the form in which they are kept.
    fn times(&self, zone: &TimeZone, now: Timestamp) -> Result<GoalTimes, String> {
        let asking = Asking { author: Author::File, keep: self.goal.keep, zone: zone.clone(), now };
        let times = read_options(&self.times, &asking);
        let times = times.map_err(|error| format!("`{}`: {error}", error.option))?;
        Ok(GoalTimes { words: self.words(), ..times })
    }
}

impl PlanRequester {
    /// Compares the goals of the file with those that are known: takes up new ones, ends those that no
    /// longer stand there, and begins those anew that have changed. Called once the Journals have been
    /// read, so that nothing is asked for that was asked for before.
    pub(crate) fn read_file_goals(&mut self, ctx: &mut Context<Self>) {
        if std::mem::replace(&mut self.clock.has_read_file, true) {
            return;
        }
        self.numbers.open();
        let file = self.clock.file.clone();
        let stands = |id: &ConversationId| file.goals.iter().any(|goal| goal.conversation() == *id);
        let known = self.clock.goals.iter().filter(|(_, due)| due.is_of_file);
        let gone: Vec<_> = known.map(|(id, _)| id.clone()).filter(|id| !stands(id)).collect();
        for id in gone {
            self.end_due(&id, Outcome::Cancelled, "it no longer stands in the file", ctx);
            self.clock.ended.forget(&id);
        }
        for goal in file.goals {
            self.take_file_goal(goal, ctx);
        }
        self.stop_awaiting_journals(ctx);
        self.look_at_clock(ctx);
    }

    fn take_file_goal(&mut self, goal: FileGoal, ctx: &mut Context<Self>) {
        let (id, words) = (goal.conversation(), goal.words());
        if let Some(known) = self.clock.goals.get(&id) {
            if known.asked == goal.goal && known.times.words == words {
                return;
            }
            self.end_due(&id, Outcome::Cancelled, "it has changed in the file", ctx);
        } else if self.clock.ended.has_same(&id, &goal.goal, &words) {
            return;
        }
        let now = timestamp(ctx.wall_clock());
        let zone = self.clock.zone(&GoalTimes::default());
        let times = zone.and_then(|zone| Ok((goal.times(&zone, now)?, zone)));
        let read = times.and_then(|(times, zone)| {
            let schedule = Schedule::read(&times, zone);
            Ok((schedule.map_err(|error| error.to_string())?, times))
        });
        let (schedule, times) = match read {
            Ok(read) => read,
            Err(problem) => {
                return tracing::error!(
                    goal = goal.name,
                    problem,
                    "a goal of the file is not asked for"
                );
            }
        };
        self.clock.ended.forget(&id);
        let mut due = DueGoal::new(ctx.id().clone(), goal.goal, times, schedule);
        due.is_of_file = true;
        if !due.is_always() && due.due(now).now.is_none() {
            due.seen = SeenOccurrences { settled: Some(now), ..due.seen };
        }
        due.number = self.numbers.next();
        due.add_history(now, format!("stands in the file: {words}"));
        self.clock.goals.insert(id.clone(), due);
        self.replicate_due(&id, ctx);
    }
}
