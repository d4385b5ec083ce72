//! All machines of a trial, the network between them, the building, and the people.

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

/// Time scale of the building: real time.
const TIME_SCALE: f64 = 1.0;

/// Names of the two people.
const PEOPLE: [&str; 2] = ["ann", "bob"];

/// Daemons at which the two people have their terminals. The first daemon never dies.
const SEATS: [usize; 2] = [0, 1];

/// The whole simulated installation.
pub struct City {
    /// State that all machines share.
    pub world: Arc<World>,
    /// The machines.
    pub posts: Vec<Post>,
    /// People that request goals.
    pub people: Vec<Person>,
    /// Terminal that requests goals of the second ecosystem.
    clerk: Option<Terminal>,
    /// Commands that each agent has begun.
    pub begun: Begun,
    /// Commands that were sent over the network.
    pub given: Arc<Given>,
    /// Confirmations that were sent to people over the network.
    pub said: Arc<Said>,
    building: Building,
    since: Instant,
    /// Pending ends of faults, by time and order of insertion.
    agenda: BTreeMap<(Duration, u64), Undo>,
    undone: u64,
    /// Commands that an earlier incarnation left open; the next one writes them to its ledger again.
    carried: BTreeSet<(String, ActionToken)>,
    effects: Effects,
}

/// Confirmations sent to people: their message identifiers, by conversation.
#[derive(Default)]
pub struct Said(Mutex<BTreeMap<ConversationId, BTreeSet<MessageId>>>);

impl Said {
    /// Records a message that passes over the network.
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

    /// Returns the number of different confirmations of a conversation.
    pub fn count(&self, conversation: &ConversationId) -> usize {
        let said = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        said.get(conversation).map_or(0, BTreeSet::len)
    }
}

/// The end of a fault. If only the end shows whether the fault had an effect, it carries the counters
/// from before.
enum Undo {
    Start(usize),
    Mend(Cut),
    Fair(Told),
    Prompt(usize, Told),
}

impl City {
    /// Creates all machines, switched off.
    ///
    /// # Errors
    ///
    /// Returns an error if the drawn plan is no valid building, or the ontology cannot be parsed.
    pub fn new(script: Script, without: Option<Guard>, folder: &Path) -> Result<City, TrialError> {
        City::with(script, without, settings(without), folder)
    }

    /// Like [`City::new`], with a given size of the agents' duplicate window.
    ///
    /// # Errors
    ///
    /// Returns an error as [`City::new`] does.
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

    /// Returns how long the trial has lasted.
    pub fn now(&self) -> Duration {
        self.since.elapsed()
    }

    /// Returns the building's present truth.
    pub fn truth(&self) -> Truth {
        self.building.truth()
    }

    /// Starts a daemon, and gives a terminal to the person that sits there.
    pub fn start(&mut self, number: usize) {
        if self.posts[number].is_up() {
            return;
        }
        // Read now and not at its death: in that very instant a write may still reach its disk.
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

    /// Injects a fault.
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

    /// Returns when the next fault ends.
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
                // Its crash was counted already.
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

    /// Requests from the second ecosystem a goal that only the first can reach.
    pub fn ask_annex(&self) {
        let goal = "(known-temperature room-1)";
        if let Some(clerk) = &self.clerk {
            // A lost request does not matter.
            let _ = clerk.say.try_send(gates::errand(goal));
        }
    }

    // === observation ===

    /// Returns the counters of the faults that took effect.
    pub fn effects(&self) -> Effects {
        Effects { told: self.world.network.told(), ..self.effects }
    }

    /// Returns the exchanges that are open beyond their deadlines.
    pub fn overdue(&self) -> Vec<String> {
        let now = Instant::now();
        self.posts.iter().flat_map(|post| post.waits().overdue(now)).collect()
    }

    /// Returns a message if an agent has come back from the second ecosystem, which must not happen.
    pub fn came_back(&mut self) -> Option<String> {
        let clerk = self.clerk.as_mut()?;
        while clerk.hear.try_recv().is_ok() {}
        gates::came_back(self.posts[0].switchboard()?)
    }

    /// Returns the goals of the leading Plan Requester, as a person would query them.
    pub async fn goals(&self) -> Vec<GoalStatus> {
        self.ask::<Vec<GoalStatus>>(Resource::Goals).await.into_iter().flatten().collect()
    }

    /// Returns the fill levels of all mailboxes.
    pub async fn mailboxes(&self) -> Vec<Mailboxes> {
        self.ask(Resource::Mailbox).await
    }

    async fn ask<T: DeserializeOwned>(&self, resource: Resource) -> Vec<T> {
        let Some(switchboard) = self.posts[0].switchboard() else { return Vec::new() };
        let ask = Ask { daemon: None, resource, agent: None };
        let answers = switchboard.ask(ask, Duration::from_secs(2)).await;
        answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
    }

    /// Records the commands that the last incarnation of a daemon has begun.
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

    /// Records the commands that the last incarnation left open: the next one writes them to its ledger
    /// again, unless that guard is taken out.
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

/// Returns the ontology of the smart office, and the map of this building.
fn words(script: &Script) -> Result<(pddl::Domain, pddl::Problem), TrialError> {
    const ONTOLOGY: &str = include_str!("../../../domains/smart-office/domain.pddl");
    let ontology = pddl::parse_domain(ONTOLOGY).into_result().map_err(TrialError::words)?;
    let map = script.layout.map_pddl(ontology.name.as_str());
    let map = pddl::parse_problem(&map).into_result().map_err(TrialError::words)?;
    Ok((ontology, map))
}

/// Default settings, with one guard taken out.
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
