//! The data of a page: all that is drawn of a view at one moment, for every way of drawing, and for
//! programs as JSON.

use live_view::{
    ActivityEntry, AgentDetail, AgentRow, ConversationDetail, ConversationRow, DaemonRow, FactRow,
    FloorPlan, GoalDetail, GoalRow, GoalStage, LiveView, Moment, Overview, QuestionRow,
};
use serde::Serialize;

use crate::page::{PageAt, PageName};

/// Activities that the overview shows.
const RECENT_MAX: usize = 50;

/// What a page shows.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "page", content = "data", rename_all = "kebab-case")]
pub enum PageData {
    /// Whether all is well, the goals, and what happened last.
    Overview(Box<OverviewData>),
    /// All goals.
    Goals(Vec<GoalRow>),
    /// One goal; `None` if there is none of this name.
    Goal(Option<Box<GoalDetail>>),
    /// All agents.
    Agents(Vec<AgentRow>),
    /// One agent; `None` if there is none of this name.
    Agent(Option<Box<AgentDetail>>),
    /// All facts.
    World(Vec<FactRow>),
    /// The floor plan.
    Floor(FloorPlan),
    /// All open questions.
    Questions(Vec<QuestionRow>),
    /// What happened, oldest first.
    Activity(Vec<ActivityEntry>),
    /// All conversations.
    Conversations(Vec<ConversationRow>),
    /// One conversation; `None` if there is none of this name.
    Conversation(Option<Box<ConversationDetail>>),
    /// All daemons.
    Topology(Vec<DaemonRow>),
}

/// What the overview shows.
#[derive(Clone, Debug, Serialize)]
pub struct OverviewData {
    /// Whether all is well.
    pub overview: Overview,
    /// The goals that have not ended.
    pub goals: Vec<GoalRow>,
    /// What happened last, oldest first.
    pub recent: Vec<ActivityEntry>,
}

impl PageData {
    /// Collects what a page shows at `now`.
    pub fn of(view: &LiveView, at: &PageAt, now: Moment) -> Self {
        let name = at.name.as_deref();
        match at.page {
            PageName::Overview => Self::Overview(Box::new(OverviewData::of(view, now))),
            PageName::Goals => Self::Goals(view.goals(now)),
            PageName::Goal => Self::Goal(goal(view, name, now).map(Box::new)),
            PageName::Agents => Self::Agents(view.agents(now)),
            PageName::Agent => Self::Agent(agent(view, name, now).map(Box::new)),
            PageName::World => Self::World(view.facts(now)),
            PageName::Floor => Self::Floor(view.floor(now)),
            PageName::Questions => Self::Questions(view.questions(now)),
            PageName::Activity => Self::Activity(view.activity().cloned().collect()),
            PageName::Conversations => Self::Conversations(view.conversations()),
            PageName::Conversation => Self::Conversation(conversation(view, name).map(Box::new)),
            PageName::Topology => Self::Topology(view.topology(now)),
        }
    }

    /// Whether the page is about a thing that is not there.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Goal(None) | Self::Agent(None) | Self::Conversation(None))
    }
}

impl OverviewData {
    fn of(view: &LiveView, now: Moment) -> Self {
        let mut recent: Vec<_> = view.activity().rev().take(RECENT_MAX).cloned().collect();
        recent.reverse();
        let goals = view.goals(now).into_iter().filter(|goal| !goal.stage.has_ended());
        Self { overview: view.overview(now), goals: goals.collect(), recent }
    }
}

/// Returns the goal of a name: its number, its conversation, the beginning of that, or a part of the
/// goal.
/// Without a name, the goal that is of most interest: one that is worked for, or the first.
fn goal(view: &LiveView, name: Option<&str>, now: Moment) -> Option<GoalDetail> {
    let goals = view.goals(now);
    let found = match name {
        Some(name) => {
            let number: Option<u32> = name.parse().ok();
            let is = |goal: &&GoalRow| {
                goal.conversation.as_str() == name || number.is_some() && goal.number == number
            };
            let begins = |goal: &&GoalRow| goal.conversation.as_str().starts_with(name);
            let has = |goal: &&GoalRow| goal.goal.contains(name);
            let goals = || goals.iter();
            goals().find(is).or_else(|| goals().find(begins)).or_else(|| goals().find(has))
        }
        None => {
            let rank = |goal: &&GoalRow| match goal.stage {
                GoalStage::Running => 0,
                GoalStage::Planning => 1,
                _ if goal.rounds > 0 => 2,
                _ => 3,
            };
            goals.iter().min_by_key(rank)
        }
    };
    view.goal(&found?.conversation, now)
}

/// Returns the agent of a name; without a name, the first that does something.
fn agent(view: &LiveView, name: Option<&str>, now: Moment) -> Option<AgentDetail> {
    let agents = view.agents(now);
    let found = match name {
        Some(name) => agents.iter().find(|row| row.agent.as_str() == name),
        None => agents.iter().find(|row| row.doing.is_some()).or(agents.first()),
    };
    view.agent(&found?.agent, now)
}

/// Returns the conversation of a name or the beginning of one; without a name, the newest of
/// which it is known what it is about.
fn conversation(view: &LiveView, name: Option<&str>) -> Option<ConversationDetail> {
    let rows = view.conversations();
    let found = match name {
        Some(name) => {
            let is = |row: &&ConversationRow| row.conversation.as_str() == name;
            let begins = |row: &&ConversationRow| row.conversation.as_str().starts_with(name);
            rows.iter().find(is).or_else(|| rows.iter().find(begins))
        }
        // Many are only about records that are stored.
        None => rows.iter().find(|row| !row.subject.is_empty()).or(rows.first()),
    };
    view.conversation(&found?.conversation)
}
