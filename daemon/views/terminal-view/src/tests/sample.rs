//! Data of an office in the afternoon, as a view returns it: a plan that runs late, a robot that is
//! gone, a secret question, and names that try to mislead.

use acl::content::{GoalPhase, Keep, MailboxStatus, Outcome, Stop};
use acl::{AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Performative, Protocol};
use live_view::{
    ActionRow, ActivityEntry, ActivityLevel, AgentDetail, AgentPresence, AgentRow, BidRow,
    BidState, CallDetail, ClaimRow, Concern, ConcernKind, ConversationDetail, ConversationRow,
    CurrentStep, DaemonRow, DueRow, FactRow, FactTruth, FloorPlan, FloorRobot, FloorRoom, FloorWay,
    Freshness, GoalDetail, GoalHistoryRow, GoalRow, GoalStage, HealthLevel, MailboxSums,
    MessageRow, Moment, Overview, PlanDetail, ProposalRow, QuestionRow, ReplicaRow, StepRow,
    StepState, ViewCounts, ViewSubject,
};

use crate::page::PageName;
use crate::page_data::{OverviewData, PageData};

/// Now: 14:05:30 of a day.
pub(super) const NOW: Moment = Moment(1_795_874_730_000);

fn ago(seconds: u64) -> Moment {
    NOW.minus(seconds * 1_000)
}

fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

fn daemon(name: &str) -> DaemonId {
    DaemonId::new(name).expect("a name")
}

fn conversation(name: &str) -> ConversationId {
    ConversationId::new(name)
}

fn texts(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|&text| text.to_owned()).collect()
}

/// Returns the data of a page.
pub(super) fn data(page: PageName) -> PageData {
    match page {
        PageName::Overview => PageData::Overview(Box::new(OverviewData {
            overview: overview(),
            goals: goals().into_iter().filter(|goal| !goal.stage.has_ended()).collect(),
            recent: activity(),
        })),
        PageName::Goals => PageData::Goals(goals()),
        PageName::Goal => PageData::Goal(Some(Box::new(goal()))),
        PageName::Agents => PageData::Agents(agents()),
        PageName::Agent => PageData::Agent(Some(Box::new(agent_detail()))),
        PageName::World => PageData::World(facts()),
        PageName::Floor => PageData::Floor(floor()),
        PageName::Questions => PageData::Questions(questions()),
        PageName::Activity => PageData::Activity(activity()),
        PageName::Conversations => PageData::Conversations(conversations()),
        PageName::Conversation => PageData::Conversation(Some(Box::new(talk()))),
        PageName::Topology => PageData::Topology(daemons()),
    }
}

/// Returns the data of a page about which nothing is known.
pub(super) fn nothing(page: PageName) -> PageData {
    match page {
        PageName::Overview => PageData::Overview(Box::new(OverviewData {
            overview: Overview {
                verdict: HealthLevel::Well,
                summary: String::new(),
                concerns: Vec::new(),
                more_concerns: 0,
                counts: ViewCounts::default(),
                ..overview()
            },
            goals: Vec::new(),
            recent: Vec::new(),
        })),
        PageName::Goals => PageData::Goals(Vec::new()),
        PageName::Goal => PageData::Goal(None),
        PageName::Agents => PageData::Agents(Vec::new()),
        PageName::Agent => PageData::Agent(None),
        PageName::World => PageData::World(Vec::new()),
        PageName::Floor => PageData::Floor(FloorPlan::default()),
        PageName::Questions => PageData::Questions(Vec::new()),
        PageName::Activity => PageData::Activity(Vec::new()),
        PageName::Conversations => PageData::Conversations(Vec::new()),
        PageName::Conversation => PageData::Conversation(None),
        PageName::Topology => PageData::Topology(Vec::new()),
    }
}

pub(super) fn overview() -> Overview {
    let concern =
        |level, kind, text: &str, subject| Concern { level, kind, text: text.to_owned(), subject };
    Overview {
        ecosystem: EcosystemId::new("smart-office").expect("a name"),
        at: NOW,
        verdict: HealthLevel::Bad,
        not_reached_since: None,
        summary: "1 goal has failed, and 3 more things need a look".to_owned(),
        concerns: vec![
            concern(
                HealthLevel::Bad,
                ConcernKind::GoalFailed,
                "(presented slides conf-room) has failed: no agent offers `present` now",
                Some(ViewSubject::Goal(conversation("goal-3"))),
            ),
            concern(
                HealthLevel::Attention,
                ConcernKind::AgentGone,
                "thermometer-office2 is gone for 12 s",
                Some(ViewSubject::Agent(agent("thermometer-office2"))),
            ),
            concern(
                HealthLevel::Attention,
                ConcernKind::StepLate,
                "turtlebot-1 takes 3.1 s longer than usual to move to office2",
                Some(ViewSubject::Goal(conversation("goal-1"))),
            ),
            concern(
                HealthLevel::Attention,
                ConcernKind::Question,
                "2 questions wait for an answer",
                Some(ViewSubject::Questions),
            ),
        ],
        more_concerns: 2,
        counts: ViewCounts {
            agents: 7,
            agents_gone: 1,
            daemons: 3,
            goals: 3,
            steps_running: 1,
            facts: 7,
            questions: 2,
            lost: 4,
            ..ViewCounts::default()
        },
    }
}

fn goal_row(number: u32, goal: &str, stage: GoalStage, text: &str) -> GoalRow {
    GoalRow {
        conversation: conversation(&format!("goal-{number}")),
        number: None,
        goal: goal.to_owned(),
        requester: Some(agent("alice")),
        keep: Some(Keep::Achieve),
        priority: 0,
        stage,
        phase: None,
        text: text.to_owned(),
        asked_at: Some(ago(60 * u64::from(number))),
        changed_at: ago(20),
        ended_at: stage.has_ended().then(|| ago(15)),
        rounds: 1,
        steps: 0,
        steps_done: 0,
        cost: None,
        now: Vec::new(),
        late_ms: None,
        expected_end: None,
        due: None,
        is_of_file: false,
    }
}

/// A goal of the file that waits for its time.
fn scheduled() -> GoalRow {
    let due = DueRow {
        words: "every day 08:00, by 08:30".to_owned(),
        next_at: Some(NOW.plus(3_600_000)),
        next: Some("Thursday 08:00".to_owned()),
        ..DueRow::default()
    };
    GoalRow {
        number: Some(6),
        rounds: 0,
        due: Some(due),
        is_of_file: true,
        ..goal_row(
            6,
            "(known-temperature office1)",
            GoalStage::Scheduled,
            "next: Thursday 08:00 (every day 08:00, by 08:30)",
        )
    }
}

pub(super) fn goals() -> Vec<GoalRow> {
    vec![
        GoalRow {
            keep: Some(Keep::Maintain),
            priority: 5,
            phase: Some(GoalPhase::Executing),
            rounds: 2,
            steps: 3,
            steps_done: 1,
            cost: Some(12.0),
            now: texts(&["turtlebot-1 moves to office2"]),
            late_ms: Some(3_100),
            expected_end: Some(NOW.plus(4_500)),
            ..goal_row(
                1,
                "(forall (?r - room) (known-temperature ?r))",
                GoalStage::Running,
                "a plan is carried out",
            )
        },
        goal_row(
            2,
            "(locked door-厨房)",
            GoalStage::Waiting,
            "waits: turtlebot-1 works for another goal",
        ),
        goal_row(
            3,
            "(presented slides conf-room)",
            GoalStage::Failed,
            "no agent offers `present` now",
        ),
        goal_row(4, "", GoalStage::Unknown, ""),
        goal_row(5, "(is \u{202e}evil\u{1b}[2J)", GoalStage::Holding, "holds, and is watched"),
        scheduled(),
    ]
}

fn step(number: u32, text: &str, state: StepState) -> StepRow {
    let step = format!("({})", text.replace("moves to", "move"));
    StepRow {
        number,
        step,
        text: text.to_owned(),
        action: "move".to_owned(),
        agent: Some(agent("turtlebot-1")),
        arguments: texts(&["corridor", "office2"]),
        state,
        started_at: None,
        ended_at: None,
        expected_start: None,
        expected_end: None,
        usual_ms: Some(5_000),
        late_ms: None,
        detail: String::new(),
    }
}

pub(super) fn goal() -> GoalDetail {
    let row = goals().swap_remove(0);
    let newest = PlanDetail {
        term: 1,
        round: 2,
        cost: Some(12.0),
        made_at: ago(14),
        ended_at: None,
        outcome: None,
        ended_because: String::new(),
        steps: vec![
            StepRow {
                started_at: Some(ago(14)),
                ended_at: Some(ago(8)),
                late_ms: Some(1_000),
                ..step(0, "turtlebot-1 moves to corridor", StepState::Done)
            },
            StepRow {
                started_at: Some(ago(8)),
                expected_end: Some(ago(3)),
                late_ms: Some(3_100),
                ..step(1, "turtlebot-1 moves to office2", StepState::Running)
            },
            StepRow {
                expected_start: Some(NOW),
                expected_end: Some(NOW.plus(4_500)),
                usual_ms: Some(4_500),
                ..step(2, "ir-1 reports the temperature of office2", StepState::Next)
            },
        ],
        more_steps: 0,
        begins_at: ago(14),
        ends_at: NOW.plus(4_500),
        late_ms: Some(3_100),
    };
    let oldest = PlanDetail {
        round: 1,
        cost: Some(8.0),
        made_at: ago(50),
        ended_at: Some(ago(15)),
        outcome: Some(Outcome::Failed),
        ended_because: "thermometer-office2 is gone".to_owned(),
        steps: vec![StepRow {
            started_at: Some(ago(50)),
            ended_at: Some(ago(20)),
            late_ms: Some(25_000),
            detail: "the sensor does not answer".to_owned(),
            ..step(0, "thermometer-office2 reports the temperature", StepState::Failed)
        }],
        more_steps: 2,
        begins_at: ago(50),
        ends_at: ago(15),
        late_ms: None,
        ..newest.clone()
    };
    GoalDetail { row, history: history(), plans: vec![newest, oldest], calls: vec![call()] }
}

fn history() -> Vec<GoalHistoryRow> {
    vec![
        GoalHistoryRow { at: ago(60), outcome: None, text: "alice asked for it".to_owned() },
        GoalHistoryRow {
            at: ago(15),
            outcome: Some(Outcome::Failed),
            text: "plan 1 has failed: thermometer-office2 is gone".to_owned(),
        },
    ]
}

fn call() -> CallDetail {
    let proposal = |cost, is_chosen| ProposalRow {
        covers: texts(&["(known-temperature office2)"]),
        cost,
        steps: texts(&["(move turtlebot-1 corridor office2)"]),
        is_chosen,
    };
    let bid = |name: &str, after_ms, state, proposals, detail: &str| BidRow {
        agent: agent(name),
        at: ago(14),
        after_ms,
        state,
        proposals,
        detail: detail.to_owned(),
    };
    CallDetail {
        at: ago(15),
        conjuncts: texts(&["(known-temperature office2)"]),
        together: false,
        called: None,
        bids: vec![
            bid("turtlebot-1", 4, BidState::Won, vec![proposal(12.0, true)], "the cheapest"),
            bid("turtlebot-2", 7, BidState::Lost, vec![proposal(18.0, false)], ""),
            bid("screen-1", 2, BidState::Declined, Vec::new(), "cannot reach any of the goal"),
        ],
        more_bids: 0,
        decided_at: Some(ago(14)),
    }
}

fn agent_row(name: &str, presence: AgentPresence) -> AgentRow {
    AgentRow {
        agent: agent(name),
        daemon: Some(daemon("office-pi")),
        presence,
        since: Some(ago(3_700)),
        heartbeat_age_ms: Some(400),
        actions: texts(&["report-temperature"]),
        doing: None,
        doing_since: None,
        late_ms: None,
        waiting: Some(0),
        replicas: 1,
        is_stopped: false,
        problems: Vec::new(),
    }
}

pub(super) fn agents() -> Vec<AgentRow> {
    vec![
        AgentRow { replicas: 2, ..agent_row("plan-requester", AgentPresence::Present) },
        AgentRow { is_stopped: true, ..agent_row("screen-1", AgentPresence::Present) },
        agent_row("thermometer-conf-room", AgentPresence::Silent),
        AgentRow {
            since: Some(ago(12)),
            heartbeat_age_ms: Some(14_000),
            problems: texts(&["it is gone for 12 s, and the file names it"]),
            ..agent_row("thermometer-office2", AgentPresence::Gone)
        },
        AgentRow {
            actions: texts(&["move", "report-temperature"]),
            doing: Some("moves to office2".to_owned()),
            doing_since: Some(ago(8)),
            late_ms: Some(3_100),
            waiting: Some(2),
            daemon: Some(daemon("hall-pi")),
            ..agent_row("turtlebot-1", AgentPresence::Present)
        },
        AgentRow {
            daemon: None,
            heartbeat_age_ms: None,
            since: None,
            ..agent_row("turtlebot-2", AgentPresence::Absent)
        },
    ]
}

pub(super) fn agent_detail() -> AgentDetail {
    let replica = |name: &str, leads| ReplicaRow {
        daemon: daemon(name),
        incarnation: Incarnation(7),
        leads: Some(leads),
        since: ago(3_700),
    };
    AgentDetail {
        row: agents().swap_remove(4),
        replicas: vec![replica("hall-pi", true), replica("office-pi", false)],
        actions: vec![
            ActionRow {
                action: "move".to_owned(),
                parameters: "(?r - robot ?from ?to - room)".to_owned(),
                is_offered: true,
                runs: 12,
                failures: 1,
                usual_ms: Some(5_000),
            },
            ActionRow {
                action: "dock".to_owned(),
                parameters: "(?r - robot)".to_owned(),
                is_offered: false,
                runs: 0,
                failures: 0,
                usual_ms: None,
            },
        ],
        model: Some("(define (domain turtlebot-1)\n  (:action move))".to_owned()),
        facts: facts().into_iter().take(2).collect(),
        stops: vec![Stop {
            id: "9f3a01c2".to_owned(),
            scope: texts(&["turtlebot-1"]),
            by: agent("alice"),
            why: "fire alarm".to_owned(),
        }],
        mailbox: Some(MailboxStatus {
            agent: agent("turtlebot-1"),
            waiting: 2,
            waiting_max: 14,
            received: 1_204,
            overflowed: 0,
        }),
        running: vec![CurrentStep {
            step: "(move turtlebot-1 corridor office2)".to_owned(),
            text: "turtlebot-1 moves to office2".to_owned(),
            conversation: Some(conversation("goal-1")),
            state: StepState::Running,
            started_at: ago(8),
            usual_ms: Some(5_000),
            late_ms: Some(3_100),
            detail: "at the door".to_owned(),
        }],
        recent: activity().into_iter().take(2).collect(),
        discovered: None,
        heartbeat_period_ms: Some(1_000),
    }
}

fn fact(text: &str, truth: FactTruth, freshness: Freshness) -> FactRow {
    let words: Vec<_> = text.trim_matches(['(', ')']).split(' ').collect();
    FactRow {
        fact: text.to_owned(),
        predicate: words[0].to_owned(),
        arguments: texts(&words[1..]),
        value: None,
        truth,
        owners: texts(&["turtlebot-1"]),
        age_ms: Some(1_200),
        same_for_ms: Some(65_000),
        known_for_ms: None,
        freshness,
        contradictions: Vec::new(),
    }
}

pub(super) fn facts() -> Vec<FactRow> {
    vec![
        fact("(at turtlebot-1 corridor)", FactTruth::True, Freshness::Lasting),
        FactRow {
            value: Some(21.5),
            known_for_ms: Some(540_000),
            ..fact("(= (temperature office1) 21.5)", FactTruth::True, Freshness::Fresh)
        },
        FactRow {
            owners: texts(&["the map"]),
            age_ms: None,
            ..fact("(connected corridor office1)", FactTruth::True, Freshness::Lasting)
        },
        FactRow {
            known_for_ms: Some(40_000),
            contradictions: vec![ClaimRow {
                owner: "alice".to_owned(),
                fact: "(not (door-open door-1))".to_owned(),
                source: "request".to_owned(),
                age_ms: 90_000,
            }],
            ..fact("(door-open door-1)", FactTruth::True, Freshness::Ending)
        },
        fact("(door-open door-厨房)", FactTruth::False, Freshness::Lasting),
        fact("(known-temperature office2)", FactTruth::Unknown, Freshness::Lasting),
        fact("(located thermometer-office2 office2)", FactTruth::True, Freshness::Stale),
    ]
}

fn floor() -> FloorPlan {
    let room = |name: &str, x, y, robots: &[&str], facts: &[&str]| FloorRoom {
        name: name.to_owned(),
        x,
        y,
        robots: robots.iter().map(|robot| agent(robot)).collect(),
        facts: texts(facts),
        is_stale: name == "office2",
        is_stopped: name == "kitchen",
    };
    let way = |from: &str, to: &str| FloorWay {
        from: from.to_owned(),
        to: to.to_owned(),
        both_ways: from != "kitchen",
    };
    FloorPlan {
        rooms: vec![
            room("conf-room", 0.0, 0.0, &[], &["temperature 22.5"]),
            room("corridor", 0.5, 0.5, &["turtlebot-1"], &[]),
            room("kitchen", 0.0, 1.0, &[], &[]),
            room("office1", 1.0, 0.0, &[], &["temperature 21.5", "known-temperature"]),
            room("office2", 1.0, 1.0, &[], &["temperature ?"]),
        ],
        ways: vec![
            way("conf-room", "corridor"),
            way("corridor", "office1"),
            way("corridor", "office2"),
            way("kitchen", "corridor"),
        ],
        robots: vec![
            FloorRobot {
                agent: agent("turtlebot-1"),
                room: Some("corridor".to_owned()),
                moves_to: Some("office2".to_owned()),
                path: texts(&["office2"]),
                conversation: Some(conversation("goal-1")),
                is_stale: false,
                is_stopped: false,
            },
            FloorRobot {
                agent: agent("turtlebot-2"),
                room: None,
                moves_to: None,
                path: Vec::new(),
                conversation: None,
                is_stale: true,
                is_stopped: false,
            },
        ],
        more_rooms: 0,
        empty_because: String::new(),
    }
}

pub(super) fn questions() -> Vec<QuestionRow> {
    let question = |id: Option<&str>, from: &str, text: &str, is_secret| QuestionRow {
        id: id.map(str::to_owned),
        keyboard: Some(agent("hall")),
        from: agent(from),
        text: text.to_owned(),
        is_secret,
        remaining_ms: Some(25_000),
    };
    vec![
        question(Some("hall/1"), "video-robot-1", "What is your PIN?", true),
        question(
            Some("hall/2"),
            "doorkeeper",
            "`t-1` (zigbee, office1) has appeared, and no file names it. Let it in? yes, no",
            false,
        ),
        question(None, "turtlebot-1", "Which room?\u{7}", false),
    ]
}

pub(super) fn activity() -> Vec<ActivityEntry> {
    let entry = |number, seconds, level, text: &str, of: Option<&str>| ActivityEntry {
        number,
        at: ago(seconds),
        level,
        text: text.to_owned(),
        conversation: of.map(conversation),
        agent: Some(agent("turtlebot-1")),
    };
    vec![
        entry(
            1,
            60,
            ActivityLevel::Notable,
            "alice asked for (forall (?r - room) (known-temperature ?r))",
            Some("goal-1"),
        ),
        entry(2, 50, ActivityLevel::Routine, "turtlebot-1 bids 12", Some("goal-1")),
        entry(3, 12, ActivityLevel::Problem, "thermometer-office2 is gone", None),
        entry(4, 8, ActivityLevel::Notable, "turtlebot-1 moves to office2", Some("goal-1")),
        entry(5, 1, ActivityLevel::Routine, "\u{1b}]0;owned\u{7} says a device", None),
    ]
}

pub(super) fn conversations() -> Vec<ConversationRow> {
    let row = |id: &str, subject: &str, out_of_turn| ConversationRow {
        conversation: conversation(id),
        subject: subject.to_owned(),
        protocols: vec![Protocol::Goal, Protocol::ContractNet, Protocol::Execution],
        first_at: ago(60),
        last_at: ago(1),
        messages: 17,
        participants: 4,
        out_of_turn,
    };
    vec![
        row("goal-1", "(forall (?r - room) (known-temperature ?r))", 1),
        row("goal-2", "(locked door-厨房)", 0),
        row("c-7f", "", 0),
    ]
}

fn talk() -> ConversationDetail {
    let message = |seconds, from: &str, to: &[&str], performative, summary: &str| MessageRow {
        at: ago(seconds),
        from: agent(from),
        to: to.iter().map(|to| agent(to)).collect(),
        performative,
        protocol: Some(Protocol::Goal),
        summary: summary.to_owned(),
        out_of_turn: None,
    };
    ConversationDetail {
        row: conversations().swap_remove(0),
        lanes: ["alice", "plan-requester", "turtlebot-1"].map(agent).to_vec(),
        messages: vec![
            message(60, "alice", &["plan-requester"], Performative::Request, "a goal, to be kept"),
            message(59, "plan-requester", &["alice"], Performative::Agree, ""),
            message(59, "plan-requester", &[], Performative::Cfp, "(known-temperature office2)"),
            message(58, "turtlebot-1", &["plan-requester"], Performative::Propose, "cost 12"),
            MessageRow {
                out_of_turn: Some("`agree` follows no request of alice".to_owned()),
                ..message(1, "turtlebot-1", &["alice"], Performative::Agree, "")
            },
        ],
        dropped: 3,
    }
}

fn daemons() -> Vec<DaemonRow> {
    let row = |name: &str| DaemonRow {
        daemon: daemon(name),
        is_reached: Some(true),
        seen_at: Some(ago(1)),
        round_trip_micros: Some(740),
        usual_round_trip_micros: Some(690),
        agents: 4,
        leads: vec![agent("plan-requester"), agent("domain-maintainer")],
        stands_by: Vec::new(),
        uptime_ms: Some(93_600_000),
        version: Some("0.1.0".to_owned()),
        certificate_days_left: Some(211),
        memory_bytes: Some(42 << 20),
        open_files: Some(61),
        open_files_max: Some(1_024),
        mailboxes: None,
        problems: Vec::new(),
    };
    vec![
        row("hall-pi"),
        DaemonRow {
            is_reached: Some(false),
            seen_at: Some(ago(95)),
            certificate_days_left: Some(9),
            leads: Vec::new(),
            stands_by: vec![agent("plan-requester")],
            problems: texts(&["it has not answered for 1 min 35 s"]),
            ..row("office-pi")
        },
        DaemonRow {
            is_reached: None,
            seen_at: None,
            round_trip_micros: None,
            usual_round_trip_micros: None,
            uptime_ms: None,
            version: None,
            certificate_days_left: None,
            memory_bytes: None,
            open_files: None,
            leads: Vec::new(),
            mailboxes: Some(MailboxSums {
                waiting: 3,
                waiting_max: 80,
                received: 14_220,
                overflowed: 2,
                rejected: [("signature".to_owned(), 5)].into(),
                ..MailboxSums::default()
            }),
            ..row("roof-pi")
        },
    ]
}
