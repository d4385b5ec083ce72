//! The rows of each topic, made from the view: copied under its lock, and written afterwards.

use acl::AgentId;
use acl::content::Discovered;
use live_view::{
    ActivityEntry, AgentDetail, AgentRow, ConversationDetail, ConversationRow, DaemonRow, FactRow,
    FloorPlan, FloorRobot, GoalDetail, GoalRow, LiveView, Moment, Overview, QuestionRow, StopRow,
    ViewRevision,
};
use serde_json::json;

use crate::moments;
use crate::row_set::RowSet;
use crate::topic_name::TopicName;

/// The rows of a topic as the view returns them.
pub(crate) enum TopicData {
    Overview(Box<Overview>),
    Goals(Vec<GoalRow>),
    Agents(Vec<AgentRow>),
    /// The agents with rows that may differ from those that were computed last; the others are as they
    /// were, and no agent is new or missing.
    ChangedAgents(Vec<AgentRow>),
    Facts(Vec<FactRow>),
    /// The facts that have changed since the topic was computed last; the others are as they were.
    ChangedFacts(Vec<FactRow>),
    Floor(FloorPlan),
    Questions(Vec<QuestionRow>),
    Activity {
        entries: Vec<ActivityEntry>,
        /// Number of the oldest entry that is still kept.
        oldest: u64,
        newest: u64,
    },
    Conversations(Vec<ConversationRow>),
    Daemons(Vec<DaemonRow>),
    Inbox(Vec<Discovered>),
    Stops(Vec<StopRow>),
    Goal(Option<Box<GoalDetail>>),
    Agent(Option<Box<AgentDetail>>),
    /// What the screen of an agent shows: what it does, where it is, and its questions.
    Robot(Option<Box<RobotScreen>>),
    Conversation(Option<Box<ConversationDetail>>),
}

/// What the screen of an agent shows, and nothing of others.
pub(crate) struct RobotScreen {
    row: AgentRow,
    place: Option<FloorRobot>,
    questions: Vec<QuestionRow>,
}

/// What pages have of a topic, so that it need not be computed again.
pub(crate) struct KnownToPages {
    /// Number of the newest activity; entries never change.
    pub(crate) activity: u64,
    /// The revision of the view at which the topic was computed last; `None` if all is computed.
    pub(crate) since: Option<ViewRevision>,
    /// Whether time has passed, so that rows may differ although nothing was observed.
    pub(crate) has_aged: bool,
}

impl TopicData {
    /// Copies what a topic is about; of the activity, the agents and the facts only what pages may
    /// lack.
    pub(crate) fn of(
        topic: &TopicName,
        view: &LiveView,
        now: Moment,
        known: &KnownToPages,
    ) -> TopicData {
        let since = known.since;
        match topic {
            TopicName::Overview => TopicData::Overview(Box::new(view.overview(now))),
            TopicName::Goals => TopicData::Goals(view.goals(now)),
            TopicName::Agents => match since.and_then(|since| view.agents_since(since, now)) {
                Some(changed) => TopicData::ChangedAgents(changed),
                None => TopicData::Agents(view.agents(now)),
            },
            TopicName::Facts => {
                let changed = |since| view.facts_since(since, now, known.has_aged);
                match since.and_then(changed) {
                    Some(changed) => TopicData::ChangedFacts(changed),
                    None => TopicData::Facts(view.facts(now)),
                }
            }
            TopicName::Floor => TopicData::Floor(view.floor(now)),
            TopicName::Questions => TopicData::Questions(view.questions(now)),
            TopicName::Activity => activity(view, known.activity),
            TopicName::Conversations => TopicData::Conversations(view.conversations()),
            TopicName::Daemons => TopicData::Daemons(view.topology(now)),
            TopicName::Inbox => TopicData::Inbox(view.discovered()),
            TopicName::Stops => TopicData::Stops(view.stops(now)),
            TopicName::Goal(goal) => TopicData::Goal(view.goal(goal, now).map(Box::new)),
            TopicName::Agent(agent) => TopicData::Agent(view.agent(agent, now).map(Box::new)),
            TopicName::Robot(agent) => TopicData::Robot(robot_screen(view, agent, now)),
            TopicName::Conversation(of) => {
                TopicData::Conversation(view.conversation(of).map(Box::new))
            }
        }
    }

    /// Whether a topic may differ from what it was at the revision `before`, otherwise than with time.
    pub(crate) fn may_differ(topic: &TopicName, view: &LiveView, before: ViewRevision) -> bool {
        let now = view.revision();
        let has_facts = match topic {
            TopicName::Facts | TopicName::Floor | TopicName::Agent(_) | TopicName::Robot(_) => true,
            // A stop of a place concerns the agents that are there. How many facts there are is
            // counted with time.
            TopicName::Agents => view.has_stops(),
            _ => false,
        };
        let is_moved = now.facts != before.facts || now.comings != before.comings;
        now.events != before.events || (has_facts && is_moved)
    }

    /// Writes the rows.
    pub(crate) fn write(self, now: Moment, rows: &mut RowSet) {
        rows.clear();
        match self {
            TopicData::Overview(overview) => rows.push("", &overview_row(&overview, now)),
            TopicData::Goals(goals) => {
                rows.is_ordered = true;
                for row in goals {
                    rows.push(row.conversation.clone().as_str(), &moments::goal(row, now));
                }
            }
            TopicData::Agents(agents) => {
                rows.is_ordered = true;
                write_agents(agents, now, rows);
            }
            TopicData::ChangedAgents(agents) => {
                rows.is_change = true;
                write_agents(agents, now, rows);
            }
            TopicData::Facts(facts) => write_facts(facts, now, rows),
            TopicData::ChangedFacts(facts) => {
                rows.is_change = true;
                write_facts(facts, now, rows);
            }
            TopicData::Floor(plan) => write_floor(&plan, rows),
            TopicData::Questions(questions) => {
                rows.is_ordered = true;
                for row in questions {
                    rows.push(&question_key(&row), &moments::question(row, now));
                }
            }
            TopicData::Activity { entries, oldest, .. } => {
                rows.adds_from = Some(activity_key(oldest));
                entries.iter().for_each(|entry| rows.push(&activity_key(entry.number), entry));
            }
            TopicData::Conversations(conversations) => {
                for row in conversations {
                    rows.push(row.conversation.as_str(), &row);
                }
            }
            TopicData::Daemons(daemons) => {
                rows.is_ordered = true;
                for row in daemons {
                    let key = row.daemon.clone();
                    rows.push(key.as_str(), &moments::daemon(row, now));
                }
            }
            TopicData::Inbox(discovered) => {
                rows.is_ordered = true;
                discovered.iter().for_each(|found| rows.push(found.agent.as_str(), found));
            }
            TopicData::Stops(stops) => {
                rows.is_ordered = true;
                stops.iter().for_each(|row| rows.push(&row.stop.id, row));
            }
            TopicData::Goal(goal) => {
                goal.iter().for_each(|goal| rows.push("", &moments::detail(goal, now)));
            }
            TopicData::Agent(agent) => {
                agent.iter().for_each(|agent| rows.push("", &moments::detail(agent, now)));
            }
            TopicData::Robot(screen) => {
                rows.is_ordered = true;
                screen.into_iter().for_each(|screen| screen.write(now, rows));
            }
            TopicData::Conversation(of) => of.iter().for_each(|of| rows.push("", of)),
        }
    }
}

// === impl RobotScreen ===

impl RobotScreen {
    fn write(self, now: Moment, rows: &mut RowSet) {
        let RobotScreen { row, place, questions } = self;
        rows.push("agent", &moments::agent(row, now));
        if let Some(place) = place {
            rows.push("place", &place);
        }
        for row in questions {
            let key = format!("question/{}", question_key(&row));
            rows.push(&key, &moments::question(row, now));
        }
    }
}

fn robot_screen(view: &LiveView, agent: &AgentId, now: Moment) -> Option<Box<RobotScreen>> {
    let row = view.agent(agent, now)?.row;
    let place = view.floor(now).robots.into_iter().find(|robot| robot.agent == *agent);
    let mut questions = view.questions(now);
    questions.retain(|question| question.from == *agent);
    Some(Box::new(RobotScreen { row, place, questions }))
}

fn question_key(row: &QuestionRow) -> String {
    row.id.clone().unwrap_or_else(|| format!("{}: {}", row.from, row.text))
}

fn activity(view: &LiveView, newer_than: u64) -> TopicData {
    let number = |entry: Option<&ActivityEntry>| entry.map_or(0, |entry| entry.number);
    let (oldest, newest) = (number(view.activity().next()), number(view.activity().next_back()));
    // Smaller numbers than before are those of another view.
    let newer_than = if newest < newer_than { 0 } else { newer_than };
    let newer = view.activity().rev().take_while(|entry| entry.number > newer_than);
    let mut entries: Vec<_> = newer.cloned().collect();
    entries.reverse();
    TopicData::Activity { entries, oldest, newest }
}

/// Returns the key of an activity: keys are sorted as texts.
fn activity_key(number: u64) -> String {
    format!("{number:012}")
}

/// Returns the overview without its moment, which would change it each time.
fn overview_row(overview: &Overview, now: Moment) -> serde_json::Value {
    let mut row = moments::detail(overview, now);
    if let Some(fields) = row.as_object_mut() {
        fields.remove("at");
    }
    row
}

/// Returns the key of a fact: its predicate or function with the arguments, without a value.
fn fact_key(row: &FactRow) -> String {
    let mut key = format!("({}", row.predicate);
    for argument in &row.arguments {
        key.push(' ');
        key.push_str(argument);
    }
    key.push(')');
    key
}

fn write_agents(agents: Vec<AgentRow>, now: Moment, rows: &mut RowSet) {
    for row in agents {
        let key = row.agent.clone();
        rows.push(key.as_str(), &moments::agent(row, now));
    }
}

fn write_facts(facts: Vec<FactRow>, now: Moment, rows: &mut RowSet) {
    for row in facts {
        let key = fact_key(&row);
        rows.push(&key, &moments::fact(row, now));
    }
}

fn write_floor(plan: &FloorPlan, rows: &mut RowSet) {
    for room in &plan.rooms {
        rows.push(&format!("room/{}", room.name), room);
    }
    for robot in &plan.robots {
        rows.push(&format!("robot/{}", robot.agent), robot);
    }
    rows.push("ways", &plan.ways);
    let rest = json!({ "more_rooms": plan.more_rooms, "empty_because": plan.empty_because });
    rows.push("plan", &rest);
}
