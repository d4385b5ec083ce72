//! All machines of a trial, the wire between them, the building, the people.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::content::{ActionToken, GoalStatus, Mailboxes};
use acl::{ConversationId, DaemonId, MessageId, Performative};
use agent::{Ask, Resource, Settings};
use building::{Building, Truth};
use keyboard::Terminal;
use serde::de::DeserializeOwned;
use substrate::faulty::{Cut, Network, Told, Weather};
use substrate::{Addressed, Subject};
use tokio::time::Instant;

use crate::commands::{Begun, Given};
use crate::effects::{self, Effects};
use crate::gates;
use crate::machine::{Post, World};
use crate::people::Person;
use crate::script::{Entry, Fault, Guard, Script};
use crate::trial::TrialError;

/// How slow the building is: as in real time.
const TIME_SCALE: f64 = 1.0;

/// Two people.
const PEOPLE: [&str; 2] = ["ann", "bob"];

/// Where the two people sit: the first where nothing ever dies.
const SEATS: [usize; 2] = [0, 1];

/// All of it.
pub struct City {
    /// What all machines share.
    pub world: Arc<World>,
    /// The machines.
    pub posts: Vec<Post>,
    /// Who asks.
    pub people: Vec<Person>,
    /// Who asks for what another ecosystem should do.
    clerk: Option<Terminal>,
    /// What each agent has begun.
    pub begun: Begun,
    /// What was commanded, as the wire has it.
    pub given: Arc<Given>,
    /// What was said to people, as the wire has it.
    pub said: Arc<Said>,
    building: Building,
    since: Instant,
    /// What has to be undone, and when; by the order in which it was found out.
    agenda: BTreeMap<(Duration, u64), Undo>,
    undone: u64,
    /// Commands that a former life left open, as the next one writes them down again.
    carried: BTreeSet<(String, ActionToken)>,
    effects: Effects,
}

/// What was said to people: the confirmations of each conversation, by their names.
#[derive(Default)]
pub struct Said(Mutex<BTreeMap<ConversationId, BTreeSet<MessageId>>>);

impl Said {
    /// Notes what goes over the wire.
    pub fn note(&self, addressed: &Addressed, payload: &[u8]) {
        let Addressed::To(to, Subject::Message(Performative::Confirm)) = addressed else { return };
        if !PEOPLE.contains(&to.as_str()) {
            return;
        }
        if let Ok(message) = acl::decode(payload) {
            let mut said = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            said.entry(message.conversation_id).or_default().insert(message.id);
        }
    }

    /// How many confirmations of a conversation there were.
    pub fn count(&self, conversation: &ConversationId) -> usize {
        let said = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        said.get(conversation).map_or(0, BTreeSet::len)
    }
}

/// The end of a fault; where it can be seen only then whether it has hit anything, with what had
/// happened before.
enum Undo {
    Start(usize),
    Mend(Cut),
    Fair(Told),
    Prompt(usize, Told),
}

impl City {
    /// Everything is there and switched off.
    ///
    /// # Errors
    ///
    /// If the plan is no building, or the ontology cannot be read.
    pub fn new(script: Script, without: Option<Guard>, folder: &Path) -> Result<City, TrialError> {
        City::with(script, without, settings(without), folder)
    }

    /// The same, where agents remember so many messages.
    ///
    /// # Errors
    ///
    /// As above.
    pub fn enduring(
        script: Script,
        heard_messages_max: usize,
        folder: &Path,
    ) -> Result<City, TrialError> {
        City::with(script, None, Settings { heard_messages_max, ..settings(None) }, folder)
    }

    fn with(
        script: Script,
        without: Option<Guard>,
        settings: Settings,
        folder: &Path,
    ) -> Result<City, TrialError> {
        let since = Instant::now();
        let building = Building::new(script.layout.clone(), TIME_SCALE)?;
        let network = Network::new(script.seed);
        let (ontology, map) = words(&script)?;
        let world = Arc::new(World {
            ontology: Arc::new(ontology),
            map: Arc::new(map),
            settings,
            network,
            annex: (!script.errands.is_empty()).then(|| Network::new(script.seed)),
            building: building.handle(),
            without,
            broken: Mutex::default(),
            script,
        });
        let mut posts = Vec::new();
        for (number, name) in world.script.daemons.iter().enumerate() {
            posts.push(Post::new(&world, number, folder.join(name))?);
        }
        let said = Arc::<Said>::default();
        let people = PEOPLE.map(|name| Person::new(name, since)).into();
        let (begun, carried, agenda) = (Begun::new(), BTreeSet::new(), BTreeMap::new());
        let (clerk, undone, effects, given) = (None, 0, Effects::default(), Arc::default());
        Ok(City {
            world,
            posts,
            people,
            clerk,
            begun,
            given,
            said,
            building,
            since,
            agenda,
            undone,
            carried,
            effects,
        })
    }

    /// How long the trial has lasted.
    pub fn now(&self) -> Duration {
        self.since.elapsed()
    }

    /// The truth, as it is now.
    pub fn truth(&self) -> Truth {
        self.building.truth()
    }

    /// Starts a daemon, and seats who sits there.
    pub fn start(&mut self, number: usize) {
        if self.posts[number].is_up() {
            return;
        }
        // Not when it dies: in that very instant its disk may still take something.
        self.read_begun(number);
        self.carry_over(number);
        self.posts[number].start();
        if number == 0 && self.world.annex.is_some() {
            self.clerk = self.posts[0].seat("clerk");
        }
        for (person, seat) in SEATS.into_iter().enumerate() {
            if seat == number {
                let terminal = self.posts[number].seat(&self.people[person].name);
                terminal.into_iter().for_each(|terminal| self.people[person].sit(terminal));
            }
        }
    }

    /// Kills a daemon.
    pub fn kill(&mut self, number: usize) {
        if !self.posts[number].is_up() {
            return;
        }
        self.posts[number].kill();
        self.effects.crashed += 1;
        for (person, seat) in SEATS.into_iter().enumerate() {
            if seat == number {
                self.people[person].lose();
            }
        }
    }

    /// Lets something go wrong.
    pub fn suffer(&mut self, fault: &Fault) {
        let network = self.world.network.clone();
        let (told, crashed) = (network.told(), self.effects.crashed);
        match *fault {
            Fault::Crash(number, lasts) => {
                self.kill(number);
                self.later(lasts, Undo::Start(number));
            }
            Fault::CrashAll(lasts) => {
                for number in 1..self.posts.len() {
                    self.kill(number);
                    self.later(lasts, Undo::Start(number));
                }
            }
            Fault::Cut(ref island, lease, lasts) => {
                let daemons = island.iter().map(|number| self.posts[*number].daemon.clone());
                let cut = network.cut(daemons.collect::<BTreeSet<DaemonId>>(), lease);
                self.later(lasts, Undo::Mend(cut));
            }
            Fault::Storm { lost, doubled, overtaken, lasts } => {
                let share = |hundredths| f64::from(hundredths) / 100.0;
                let (loss, doubled, overtaken) = (share(lost), share(doubled), share(overtaken));
                network.weather(Weather { loss, doubled, overtaken, ..Weather::fair() });
                self.later(lasts, Undo::Fair(told));
            }
            Fault::Delay(delay, lasts) => {
                let delay = 100..u64::try_from(delay.as_micros()).unwrap_or(u64::MAX);
                network.weather(Weather { delay, ..Weather::fair() });
                self.later(lasts, Undo::Fair(told));
            }
            Fault::Slow(number, by, lasts) => {
                network.slow(&self.posts[number].daemon, by);
                self.later(lasts, Undo::Prompt(number, told));
            }
            Fault::Clock(number, seconds) => {
                self.posts[number].jump(seconds);
                self.effects.jumped += u64::from(seconds != 0);
                self.effects.struck += u64::from(seconds != 0);
            }
        }
        self.effects.struck += u64::from(self.effects.crashed > crashed);
    }

    fn later(&mut self, after: Duration, undo: Undo) {
        self.undone += 1;
        self.agenda.insert((self.now() + after, self.undone), undo);
    }

    /// When the next fault ends.
    pub fn next_end(&self) -> Option<Duration> {
        self.agenda.keys().next().map(|(at, _)| *at)
    }

    /// Ends the faults that are over by now.
    pub fn recover(&mut self) {
        let now = self.now();
        while let Some(entry) = self.agenda.first_entry()
            && entry.key().0 <= now
        {
            let undo = entry.remove();
            self.undo(undo);
        }
    }

    /// Ends all faults.
    pub fn recover_all(&mut self) {
        while let Some((_, undo)) = self.agenda.pop_first() {
            self.undo(undo);
        }
    }

    fn undo(&mut self, undo: Undo) {
        let network = self.world.network.clone();
        let has_struck = match undo {
            Undo::Start(number) => {
                self.effects.restarted += u64::from(!self.posts[number].is_up());
                self.start(number);
                // It is its crash that was counted.
                false
            }
            Undo::Mend(cut) => network.mend(cut) > 0,
            Undo::Fair(before) => {
                network.weather(Weather::fair());
                effects::stormy(&network.told()) > effects::stormy(&before)
            }
            Undo::Prompt(number, before) => {
                network.slow(&self.posts[number].daemon, Duration::ZERO);
                network.told().slowed > before.slowed
            }
        };
        self.effects.struck += u64::from(has_struck);
    }

    /// Asks the second ecosystem for what only we can do.
    pub fn ask_annex(&self) {
        let goal = "(known-temperature room-1)";
        if let Some(clerk) = &self.clerk {
            // A clerk who is not heard does not matter.
            let _ = clerk.say.try_send(gates::errand(goal));
        }
    }

    // === looking ===

    /// What went wrong so far, where it took effect.
    pub fn effects(&self) -> Effects {
        Effects { told: self.world.network.told(), ..self.effects }
    }

    /// Who waits beyond what was to be waited.
    pub fn overdue(&self) -> Vec<String> {
        let now = Instant::now();
        self.posts.iter().flat_map(|post| post.waits().overdue(now)).collect()
    }

    /// What has come back from the second ecosystem, and must not.
    pub fn came_back(&mut self) -> Option<String> {
        let clerk = self.clerk.as_mut()?;
        while clerk.hear.try_recv().is_ok() {}
        gates::came_back(self.posts[0].switchboard()?)
    }

    /// The goals that the acting Plan Requester has, as a person asks for them.
    pub async fn goals(&self) -> Vec<GoalStatus> {
        self.ask::<Vec<GoalStatus>>(Resource::Goals).await.into_iter().flatten().collect()
    }

    /// How full all mailboxes are.
    pub async fn mailboxes(&self) -> Vec<Mailboxes> {
        self.ask(Resource::Mailbox).await
    }

    async fn ask<T: DeserializeOwned>(&self, resource: Resource) -> Vec<T> {
        let Some(switchboard) = self.posts[0].switchboard() else { return Vec::new() };
        let ask = Ask { daemon: None, resource, agent: None };
        let answers = switchboard.ask(ask, Duration::from_secs(2)).await;
        answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
    }

    /// Notes the commands that were begun in the life of a daemon that is over.
    pub fn read_begun(&mut self, number: usize) {
        for agent in self.hosted(number) {
            for token in self.posts[number].commands(&agent).0 {
                let command = (agent.clone(), token);
                if !self.carried.remove(&command) {
                    self.begun.entry(command.0).or_default().push(command.1);
                }
            }
        }
    }

    /// Notes the commands that a former life left open: the next writes them down again, but without
    /// the guard.
    fn carry_over(&mut self, number: usize) {
        if self.world.without == Some(Guard::Fencing) {
            return;
        }
        for agent in self.hosted(number) {
            let (begun, ended) = self.posts[number].commands(&agent);
            let open = begun.into_iter().filter(|token| !ended.contains(token));
            self.carried.extend(open.map(|token| (agent.clone(), token)));
        }
    }

    fn hosted(&self, number: usize) -> Vec<String> {
        let hosted = |entry: &&Entry| entry.daemons.contains(&number);
        let entries = self.world.script.agents.iter().filter(hosted);
        entries.map(|entry| entry.name.clone()).collect()
    }
}

/// The words of the smart office, and this building's map.
fn words(script: &Script) -> Result<(pddl::Domain, pddl::Problem), TrialError> {
    const ONTOLOGY: &str = include_str!("../../../domains/smart-office/domain.pddl");
    let ontology = pddl::parse_domain(ONTOLOGY).into_result().map_err(TrialError::words)?;
    let map = script.layout.map_pddl(ontology.name.as_str());
    let map = pddl::parse_problem(&map).into_result().map_err(TrialError::words)?;
    Ok((ontology, map))
}

/// What holds by default, but for the guard that is out.
fn settings(without: Option<Guard>) -> Settings {
    let mut settings = Settings::default();
    match without {
        Some(Guard::Fencing) => settings.tokens_max = 0,
        Some(Guard::Duplicates) => settings.heard_messages_max = 0,
        Some(Guard::Grace) => settings.grace = Duration::ZERO,
        Some(Guard::Journal | Guard::Loops) | None => (),
    }
    settings
}
