//! A made-up ecosystem: robots that move between rooms, thermometers and lamps, people's questions.
//! Its host answers acts by itself, with messages as agents would send them; nothing is planned.
#![allow(dead_code)]

pub(crate) mod messages;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use accounts::{Person, PersonRight};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Message};
use live_view::{AgentPlace, ExpectedAgent, LiveView, Moment, ViewEvent, ViewLimits};
use serde_json::{Value, json};
use tokio::sync::watch;
use web_page::{
    ActOutcome, BoxFuture, GoalMode, HistoryProblem, PageAct, PageHost, PagePicture, PageSetup,
    PushAnswer, PushAsk, SetupAction, SetupObject, SetupParameter, SetupPredicate, SetupType,
};

/// Agents of one daemon.
const PER_DAEMON: usize = 50;

/// Time that a robot takes from one room to the next.
const MOVE_MS: u64 = 2_000;

/// Size of the pictures of robots, in pixels.
const PICTURE_WIDTH: usize = 32;
const PICTURE_HEIGHT: usize = 24;

/// A public key for notifications, whose private key nobody has (that of RFC 8291, appendix A).
const PUSH_KEY: &str =
    "BP4z9KsN6nGRTbVYI_c7VJSPQTBtkgcy27mlmlMoZIIgDll6e3vCYLocInmYWAmS6TlzAC8wEqKK6PBru3jl7A8";

/// Heartbeats of an agent until its fact changes.
const UNCHANGED: u64 = 20;

/// One kind of agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Robot,
    Thermometer,
    Lamp,
}

#[derive(Clone, Debug)]
struct MadeUpAgent {
    name: String,
    kind: Kind,
    room: usize,
    value: u64,
    /// Whether the value was set from outside, and is kept.
    is_set: bool,
    sequence: u64,
}

/// A goal that a robot works for.
#[derive(Clone, Debug)]
struct Work {
    goal: String,
    robot: usize,
    /// The rooms that the robot still has to reach.
    path: VecDeque<usize>,
    step: u64,
    next_at: Moment,
}

#[derive(Clone, Debug)]
struct OpenQuestion {
    number: u64,
    from: String,
    text: String,
    ends_at: Moment,
    is_secret: bool,
}

struct State {
    view: LiveView,
    agents: Vec<MadeUpAgent>,
    rooms: usize,
    works: Vec<Work>,
    questions: Vec<OpenQuestion>,
    discovered: BTreeMap<String, bool>,
    stops: Vec<Value>,
    /// The conversations of goals that wait for their times.
    scheduled: BTreeSet<String>,
    /// Places besides the rooms.
    places: BTreeSet<String>,
    count: u64,
}

/// The host of a made-up ecosystem.
pub(crate) struct MadeUp {
    state: Mutex<State>,
    changes: watch::Sender<u64>,
    /// Whether there is a history, and notifications are sent.
    has_history: AtomicBool,
}

pub(crate) fn now() -> Moment {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Moment(u64::try_from(since.as_millis()).unwrap_or(u64::MAX))
}

impl MadeUp {
    /// Makes an ecosystem of so many agents.
    pub(crate) fn new(agents: usize) -> Arc<MadeUp> {
        let rooms = (agents / 5).clamp(4, 60);
        let kind = |number: usize| match number % 10 {
            0 => Kind::Robot,
            number if number % 2 == 1 => Kind::Thermometer,
            _ => Kind::Lamp,
        };
        let agent = |number: usize| {
            let kind = kind(number);
            let word = match kind {
                Kind::Robot => "robot",
                Kind::Thermometer => "thermometer",
                Kind::Lamp => "lamp",
            };
            let (room, value, sequence) = (number % rooms, 20, 1);
            let name = format!("{word}-{number}");
            MadeUpAgent { name, kind, room, value, is_set: false, sequence }
        };
        let ecosystem = EcosystemId::new("made-up").expect("a name");
        let state = State {
            view: LiveView::new(ecosystem, ViewLimits::default()),
            agents: (0..agents).map(agent).collect(),
            rooms,
            works: Vec::new(),
            questions: Vec::new(),
            discovered: BTreeMap::new(),
            stops: Vec::new(),
            scheduled: BTreeSet::new(),
            places: BTreeSet::new(),
            count: 0,
        };
        let (state, changes) = (Mutex::new(state), watch::Sender::new(0));
        let host = MadeUp { state, changes, has_history: AtomicBool::new(false) };
        host.change(State::begin);
        Arc::new(host)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder panics")
    }

    /// Has a history from now on, and sends notifications to browsers.
    pub(crate) fn keep_history(&self) {
        self.has_history.store(true, Ordering::Relaxed);
    }

    fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let mut state = self.state();
        let before = state.view.revision();
        let result = change(&mut state);
        if state.view.revision() != before {
            self.changes.send_modify(|count| *count += 1);
        }
        result
    }

    /// Lets each agent send a heartbeat, and robots move.
    pub(crate) fn tick(&self) {
        self.change(State::tick);
    }

    /// Lets one agent report another value, from now on.
    pub(crate) fn set_value(&self, agent: usize, value: u64) {
        self.change(|state| {
            (state.agents[agent].value, state.agents[agent].is_set) = (value, true);
            state.heartbeat(agent);
        });
    }

    /// Observes events.
    pub(crate) fn observe(&self, at: Moment, events: Vec<ViewEvent>) {
        self.change(|state| events.into_iter().for_each(|event| state.view.observe(at, event)));
    }

    /// Lists a goal of the file that waits for its time, an hour from now.
    pub(crate) fn schedule(&self, name: &str, number: u32, goal: &str) {
        let at = now();
        let status = json!({
            "conversation": format!("goals.{name}"), "number": number, "goal": goal,
            "keep": "achieve", "priority": 0, "phase": "waiting-for-change", "rounds": 0,
            "history": [{ "at_ms": at.0, "text": "stands in the file: every day" }],
            "due": { "words": "every day", "next-ms": at.plus(3_600_000).0, "next": "later" },
        });
        let statuses = serde_json::from_value(json!([status])).expect("a status");
        self.change(|state| {
            state.scheduled.insert(format!("goals.{name}"));
            state.observe(ViewEvent::Goals(statuses));
        });
    }

    /// Asks people a question.
    pub(crate) fn ask(&self, from: &str, text: &str, within: Duration, is_secret: bool) {
        self.change(|state| state.ask(from, text, within, is_secret));
    }

    /// Discovers an agent that waits for admission.
    pub(crate) fn discover(&self, agent: &str) {
        self.change(|state| {
            state.discovered.insert(agent.to_owned(), false);
            state.tell_discovered();
        });
    }

    /// Replaces the places besides the rooms.
    pub(crate) fn set_places(&self, places: &[&str]) {
        self.state().places = places.iter().copied().map(str::to_owned).collect();
    }

    /// Plays a made-up ecosystem for ever, with each heartbeat at a time of its own: more changes
    /// than any building has, whose daemons send the heartbeats of their agents together.
    pub(crate) async fn play_spread(self: Arc<MadeUp>, hertz: f64) {
        let count = self.state().agents.len();
        let each = Duration::from_secs_f64(1.0 / hertz / count as f64);
        let mut ticks = tokio::time::interval(each);
        for index in (0..count).cycle() {
            ticks.tick().await;
            self.change(|state| state.tick_one(index));
        }
    }

    /// Plays a made-up ecosystem for ever.
    pub(crate) async fn play(self: Arc<MadeUp>, hertz: f64) {
        let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / hertz));
        loop {
            ticks.tick().await;
            self.tick();
        }
    }
}

impl State {
    fn observe(&mut self, event: ViewEvent) {
        self.view.observe(now(), event);
    }

    fn say(&mut self, message: Message) {
        self.observe(ViewEvent::Message(Box::new(message)));
    }

    fn begin(&mut self) {
        let expected = self.agents.iter().map(|agent| ExpectedAgent {
            agent: AgentId::new(&agent.name).expect("a name"),
            daemons: Vec::new(),
        });
        let expected = expected.collect();
        self.observe(ViewEvent::Expected(expected));
        let places =
            self.agents.iter().enumerate().map(|(number, agent)| place(&agent.name, number));
        let places: Vec<_> = places.collect();
        self.observe(ViewEvent::Directory(places.clone()));
        places.into_iter().for_each(|place| self.observe(ViewEvent::Joined(place)));
        self.observe(ViewEvent::Reached(true));
        for index in 0..self.agents.len() {
            let agent = &self.agents[index];
            let model = messages::model(&agent.name, agent.kind, self.rooms);
            let message = messages::announcement(&agent.name, &model, &self.facts(index));
            self.say(message);
        }
        self.tell_daemons();
    }

    fn tell_daemons(&mut self) {
        for daemon in 0..self.agents.len().div_ceil(PER_DAEMON) {
            let report = json!({
                "daemon": format!("pi-{daemon}"), "version": "0.1.0", "uptime": 86_400_000,
                "agents": PER_DAEMON, "memory_bytes": 30_000_000, "certificate_days_left": 90,
            });
            let report = serde_json::from_value(report).expect("a report");
            self.observe(ViewEvent::Daemon(report));
            let daemon = DaemonId::new(&format!("pi-{daemon}")).expect("a name");
            self.observe(ViewEvent::RoundTrip { daemon, micros: 900 });
        }
    }

    fn facts(&self, index: usize) -> String {
        let MadeUpAgent { name, kind, room, value, .. } = &self.agents[index];
        match kind {
            Kind::Robot => format!("(at {name} room-{room}) (= (battery {name}) {value})"),
            // One thermometer of each room measures there; the others measure themselves.
            Kind::Thermometer if index / 2 < self.rooms => {
                format!("(= (temperature room-{}) {value})", index / 2)
            }
            Kind::Thermometer => format!("(= (temperature {name}) {value})"),
            Kind::Lamp if value % 2 == 1 => format!("(lit {name})"),
            Kind::Lamp => format!("(not (lit {name}))"),
        }
    }

    fn heartbeat(&mut self, index: usize) {
        self.agents[index].sequence += 1;
        let facts = self.facts(index);
        let agent = &self.agents[index];
        let message = messages::heartbeat(&agent.name, agent.sequence, &facts, &self.stops);
        self.say(message);
    }

    fn tick_one(&mut self, index: usize) {
        let agent = &mut self.agents[index];
        if !agent.is_set && (agent.sequence + index as u64).is_multiple_of(UNCHANGED) {
            agent.value = 18 + (agent.sequence + 7 * index as u64) % 9;
        }
        self.heartbeat(index);
    }

    fn tick(&mut self) {
        for index in 0..self.agents.len() {
            self.tick_one(index);
        }
        self.work();
        let at = now();
        self.questions.retain(|question| question.ends_at > at);
        self.tell_questions();
    }

    fn work(&mut self) {
        let at = now();
        let due = self.works.iter().position(|work| work.next_at <= at && self.stops.is_empty());
        let Some(due) = due else { return };
        let mut work = self.works.remove(due);
        let robot = self.agents[work.robot].name.clone();
        if let Some(room) = work.path.pop_front() {
            self.agents[work.robot].room = room;
            self.heartbeat(work.robot);
            self.say(messages::step_done(&work.goal, &robot, work.step));
            work.step += 1;
        }
        match work.path.front() {
            Some(next) => {
                let from = self.agents[work.robot].room;
                let message = messages::step_begins(&work.goal, &robot, work.step, from, *next);
                self.say(message);
                work.next_at = at.plus(MOVE_MS);
                self.works.push(work);
            }
            None => {
                let goal = work.goal;
                messages::goal_done(&goal, "all steps are done")
                    .into_iter()
                    .for_each(|message| self.say(message));
            }
        }
    }

    fn ask(&mut self, from: &str, text: &str, within: Duration, is_secret: bool) {
        self.count += 1;
        let ends_at = now().plus(u64::try_from(within.as_millis()).unwrap_or(u64::MAX));
        let (number, from, text) = (self.count, from.to_owned(), text.to_owned());
        self.questions.push(OpenQuestion { number, from, text, ends_at, is_secret });
        self.tell_questions();
    }

    fn tell_questions(&mut self) {
        let at = now();
        let open = self.questions.iter().map(|question| {
            let mut open = json!({
                "keyboard": "hall", "question": question.number, "from": question.from,
                "text": question.text, "remaining": question.ends_at.since(at),
            });
            if question.is_secret {
                open["seal_to"] = json!("key");
            }
            open
        });
        let open = Value::from(open.collect::<Vec<_>>());
        self.observe(ViewEvent::Questions(serde_json::from_value(open).expect("questions")));
    }

    fn tell_discovered(&mut self) {
        let found = self.discovered.iter().map(|(agent, joined)| {
            json!({
                "agent": agent, "by": "zigbee", "joined": joined,
                "problem": (!joined).then_some("it waits for admission"),
                "toml": format!("[[agent]]\nname = \"{agent}\"\nplugin = \"mqtt\"\n"),
            })
        });
        let report = json!({ "daemon": "pi-0", "discovered": found.collect::<Vec<_>>() });
        self.observe(ViewEvent::Discovered(serde_json::from_value(report).expect("a report")));
    }

    /// Begins to work for `(at ROBOT ROOM)`.
    fn goal(&mut self, person: &str, goal: &str) -> Result<String, String> {
        let (robot, room) = self.target(goal)?;
        self.count += 1;
        let conversation = format!("{person}-{}", self.count);
        let path = self.path(self.agents[robot].room, room);
        let name = self.agents[robot].name.clone();
        let mut from = self.agents[robot].room;
        let steps = path.iter().map(|to| {
            let step = format!("(move {name} room-{from} room-{to})");
            from = *to;
            step
        });
        let plan = steps.collect::<Vec<_>>().join("\n");
        for message in messages::goal_begins(&conversation, person, goal, &plan) {
            self.say(message);
        }
        if let Some(next) = path.front() {
            let from = self.agents[robot].room;
            self.say(messages::step_begins(&conversation, &name, 0, from, *next));
        }
        let next_at = now().plus(MOVE_MS);
        self.works.push(Work { goal: conversation.clone(), robot, path, step: 0, next_at });
        Ok(conversation)
    }

    fn target(&self, goal: &str) -> Result<(usize, usize), String> {
        let words: Vec<_> = goal.trim_matches(['(', ')', ' ']).split_whitespace().collect();
        let ["at", robot, room] = words.as_slice() else {
            return Err(
                "this made-up ecosystem reaches goals such as `(at robot-0 room-3)` only".into()
            );
        };
        let found = self.agents.iter().position(|it| it.kind == Kind::Robot && it.name == *robot);
        let robot = found.ok_or_else(|| format!("there is no robot `{robot}`"))?;
        let room = room.strip_prefix("room-").and_then(|number| number.parse().ok());
        let room = room.filter(|room| *room < self.rooms);
        Ok((robot, room.ok_or("there is no such room")?))
    }

    /// The rooms are in a row.
    fn path(&self, from: usize, to: usize) -> VecDeque<usize> {
        if from < to { (from + 1..=to).collect() } else { (to..from).rev().collect() }
    }

    fn dry_run(&self, goal: &str) -> Value {
        let outcome = self.target(goal);
        let (robot, room) = match outcome {
            Ok(target) => target,
            Err(problem) => {
                return json!({
                    "goal": goal, "plan": [], "cost": 0, "undoes": [], "already": false,
                    "problem": problem,
                });
            }
        };
        let agent = &self.agents[robot];
        let (mut from, name) = (agent.room, &agent.name);
        let path = self.path(agent.room, room);
        let steps = path.iter().enumerate().map(|(number, to)| {
            let step = format!("(move {name} room-{from} room-{to})");
            from = *to;
            let start = number as u64 * MOVE_MS;
            json!({ "step": step, "agent": name, "start": start, "duration": MOVE_MS })
        });
        let steps: Vec<_> = steps.collect();
        let undoes: Vec<_> = (!steps.is_empty())
            .then(|| format!("(at {name} room-{})", agent.room))
            .into_iter()
            .collect();
        json!({
            "goal": goal, "cost": steps.len(), "undoes": undoes, "already": steps.is_empty(),
            "plan": steps, "problem": null,
        })
    }

    fn act(&mut self, person: &str, act: PageAct) -> ActOutcome {
        let said = |sentence: String| ActOutcome { ok: true, sentence, ..ActOutcome::default() };
        let failed = |sentence: String| ActOutcome { ok: false, sentence, ..ActOutcome::default() };
        match act {
            PageAct::Goal { goal, mode, .. } => match self.goal(person, &goal) {
                Ok(conversation) => ActOutcome {
                    conversation: Some(conversation),
                    ..said(format!("the goal {goal} is asked for ({mode})"))
                },
                Err(problem) => failed(problem),
            },
            PageAct::DryRun { goal, .. } => {
                let detail = self.dry_run(&goal);
                ActOutcome { detail, ..said("nothing was asked for".to_owned()) }
            }
            PageAct::CancelGoal { conversation } => {
                let before = self.works.len();
                self.works.retain(|work| work.goal != conversation);
                if self.works.len() == before && !self.scheduled.remove(&conversation) {
                    return failed("there is no such goal".to_owned());
                }
                messages::goal_cancelled(&conversation).into_iter().for_each(|it| self.say(it));
                said("the goal is cancelled".to_owned())
            }
            PageAct::Action { agent, action } => said(format!("{agent} does {action}")),
            PageAct::Set { fact } => said(format!("{fact} is set")),
            PageAct::Answer { question, .. } => {
                let before = self.questions.len();
                self.questions.retain(|open| open.number != question);
                self.tell_questions();
                match self.questions.len() < before {
                    true => said("the answer was sent".to_owned()),
                    false => failed(
                        "the question was answered by another person, or its time is over"
                            .to_owned(),
                    ),
                }
            }
            PageAct::Admit { agent, allow } => {
                if !self.discovered.contains_key(&agent) {
                    return failed(format!("no agent `{agent}` waits for admission"));
                }
                self.discovered.insert(agent.clone(), allow);
                self.tell_discovered();
                said(format!("{agent} {}", if allow { "takes part" } else { "stays out" }))
            }
            PageAct::Stop { names, because } => {
                self.count += 1;
                let stop = json!({
                    "id": format!("stop-{}", self.count), "scope": &names, "by": person, "why": because,
                });
                self.stops.push(stop);
                (0..self.agents.len()).for_each(|index| self.heartbeat(index));
                let is_meant =
                    |agent: &&MadeUpAgent| names.is_empty() || names.contains(&agent.name);
                let table: Vec<_> = self
                    .agents
                    .iter()
                    .filter(is_meant)
                    .map(|agent| json!({ "agent": agent.name, "stopped": true }))
                    .collect();
                ActOutcome {
                    detail: json!({ "agents": table }),
                    ..said("all agents have stopped".to_owned())
                }
            }
            PageAct::Release { ids } => {
                self.stops.retain(|stop| !ids.iter().any(|id| stop["id"] == json!(id)));
                (0..self.agents.len()).for_each(|index| self.heartbeat(index));
                said("the stops are released".to_owned())
            }
        }
    }
}

fn place(name: &str, number: usize) -> AgentPlace {
    AgentPlace {
        agent: AgentId::new(name).expect("a name"),
        daemon: DaemonId::new(&format!("pi-{}", number / PER_DAEMON)).expect("a name"),
        incarnation: serde_json::from_value::<Incarnation>(json!(1)).expect("a number"),
    }
}

impl PageHost for MadeUp {
    fn now(&self) -> Moment {
        now()
    }

    fn read(&self, reader: &mut dyn FnMut(&LiveView)) {
        reader(&self.state().view);
    }

    fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    fn act(&self, person: Person, act: PageAct) -> BoxFuture<ActOutcome> {
        let outcome = self.change(|state| state.act(person.name.as_str(), act));
        Box::pin(async { outcome })
    }

    fn required_right(&self, act: &PageAct) -> Option<PersonRight> {
        let PageAct::Answer { question, .. } = act else { return act.right() };
        let state = self.state();
        let asked = state.questions.iter().find(|asked| asked.number == *question);
        match asked.is_some_and(|asked| asked.from.starts_with("doorkeeper-")) {
            true => Some(PersonRight::Admit),
            false => act.right(),
        }
    }

    fn describe(&self) -> PageSetup {
        let state = self.state();
        let parameter = |name: &str, kind: &str| SetupParameter {
            name: name.to_owned(),
            types: vec![kind.to_owned()],
        };
        let kind = |name: &str, parent: Option<&str>| SetupType {
            name: name.to_owned(),
            parent: parent.map(str::to_owned),
        };
        let object = |name: String, kind: &str| SetupObject { name, kind: kind.to_owned() };
        let predicate = |name: &str, parameters, is_function, can_change| SetupPredicate {
            name: name.to_owned(),
            parameters,
            is_function,
            can_change,
        };
        let robots = state.agents.iter().filter(|agent| agent.kind == Kind::Robot);
        let moves = robots.clone().map(|robot| SetupAction {
            agent: AgentId::new(&robot.name).expect("a name"),
            name: "move".to_owned(),
            parameters: vec![parameter("from", "location"), parameter("to", "location")],
        });
        let rooms = (0..state.rooms).map(|room| object(format!("room-{room}"), "location"));
        let places = state.places.iter().map(|place| object(place.clone(), "location"));
        let robots = robots.map(|robot| object(robot.name.clone(), "robot"));
        let objects = robots.chain(rooms).chain(places);
        PageSetup {
            ecosystem: EcosystemId::new("made-up").expect("a name"),
            daemon: DaemonId::new("pi-0").expect("a name"),
            types: vec![
                kind("object", None),
                kind("location", Some("object")),
                kind("robot", Some("object")),
            ],
            objects: objects.collect(),
            predicates: vec![
                predicate(
                    "at",
                    vec![parameter("robot", "robot"), parameter("place", "location")],
                    false,
                    true,
                ),
                predicate(
                    "connected",
                    vec![parameter("a", "location"), parameter("b", "location")],
                    false,
                    false,
                ),
                predicate("temperature", vec![parameter("place", "location")], true, false),
            ],
            actions: moves.collect(),
        }
    }

    /// Robots take pictures as the simulated building does: in a format that no browser shows.
    fn picture(&self, agent: &AgentId) -> BoxFuture<Option<PagePicture>> {
        let pixels: Vec<u8> = (0..PICTURE_WIDTH * PICTURE_HEIGHT)
            .flat_map(|pixel| [255, u8::try_from(pixel % 256).unwrap_or_default(), 0])
            .collect();
        let head = format!("P6\n# a room\n{PICTURE_WIDTH} {PICTURE_HEIGHT}\n255\n");
        let picture = PagePicture {
            media_type: "image/x-portable-pixmap".to_owned(),
            at: now(),
            bytes: [head.into_bytes(), pixels].concat().into(),
        };
        let picture = Some(picture).filter(|_| agent.as_str().starts_with("robot"));
        Box::pin(async { picture })
    }

    fn history(
        &self,
        person: Person,
        parameters: Vec<(String, String)>,
    ) -> BoxFuture<Result<Value, HistoryProblem>> {
        if let Some((unknown, _)) = parameters.iter().find(|(name, _)| name == "limits") {
            let why = format!("the history has no parameter `{unknown}`");
            return Box::pin(async { Err(HistoryProblem::Parameter(why)) });
        }
        if !self.has_history.load(Ordering::Relaxed) {
            let none = "this daemon shows no history".to_owned();
            return Box::pin(async { Err(HistoryProblem::Unavailable(none)) });
        }
        let hours_ago = |hours: u64| now().0 - hours * 3_600_000;
        let is_of_values = parameters.iter().any(|(name, _)| name == "values");
        let values = (1..=6).rev().map(|hours| {
            json!({ "at": hours_ago(hours), "kind": "fact", "value": 15 + hours, "text": "a value" })
        });
        let public = json!({
            "at": hours_ago(1), "kind": "step", "text": "robot-0 has moved", "agent": "robot-0",
            "private": false,
        });
        let private = json!({
            "at": hours_ago(2), "kind": "fact", "text": "the safe is open", "private": true,
        });
        let all =
            std::iter::once(public).chain(person.may(PersonRight::Secrets).then_some(private));
        let events: Vec<_> = if is_of_values { values.collect() } else { all.collect() };
        Box::pin(async move { Ok(json!({ "events": events })) })
    }

    fn push(&self, _: Person, ask: PushAsk) -> BoxFuture<Option<PushAnswer>> {
        let is_sent = self.has_history.load(Ordering::Relaxed);
        let answer = match ask {
            PushAsk::Key => json!({ "public_key": PUSH_KEY }),
            PushAsk::Subscribe(_) | PushAsk::Remove { .. } => json!({}),
        };
        Box::pin(async move { is_sent.then_some(Ok(answer)) })
    }
}

/// Returns whether a goal is kept, as messages say it.
pub(crate) fn keep(mode: GoalMode) -> &'static str {
    match mode {
        GoalMode::Reach => "until-reached",
        GoalMode::Keep => "from-now-on",
    }
}
