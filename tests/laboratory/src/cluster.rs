//! All machines of a trial, the network between them, the building, and the people.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use acl::content::{ActionToken, GoalStatus, Mailboxes};
use acl::{ConversationId, DaemonId, MessageId, Performative};
use agent::{AgentSettings, Resource, ResourceQuery};
use building::{Building, Truth};
use keyboard::Terminal;
use serde::de::DeserializeOwned;
use substrate::faulty::{CutId, LinkConditions, MessageCounts, Network};
use substrate::{Destination, Subject};
use tokio::time::Instant;

use crate::annex_nodes;
use crate::commands::{Begun, CommandLog};
use crate::fault_effects::{self, FaultEffects};
use crate::machine::SimulatedMachine;
use crate::people::Person;
use crate::script::{AgentPlacement, InjectedFault, Safeguard, TrialScript};
use crate::trial_context::TrialContext;
use crate::trial_error::TrialError;

/// Time scale of the building: real time.
const TIME_SCALE: f64 = 1.0;

/// Names of the two people.
pub(crate) const PEOPLE: [&str; 2] = ["ann", "bob"];

/// Daemons at which the two people have their terminals. The first daemon never dies.
const SEATS: [usize; 2] = [0, 1];

/// The whole simulated installation.
pub struct Cluster {
    /// State that all machines share.
    pub world: Arc<TrialContext>,
    /// The machines.
    pub machines: Vec<SimulatedMachine>,
    /// People that request goals.
    pub people: Vec<Person>,
    /// Terminal that requests goals of the second ecosystem.
    annex_terminal: Option<Terminal>,
    /// Commands that each agent has begun.
    pub begun: Begun,
    /// Commands that were sent over the network.
    pub command_log: Arc<CommandLog>,
    /// Confirmations that were sent to people over the network.
    pub confirmations: Arc<ConfirmationLog>,
    building: Building,
    since: Instant,
    /// Pending ends of faults, by time and order of insertion.
    recoveries: BTreeMap<(Duration, u64), Recovery>,
    undone: u64,
    /// Commands that an earlier incarnation left open; the next one writes them to its ledger
    /// again.
    carried: BTreeSet<(String, ActionToken)>,
    effects: FaultEffects,
}

/// Confirmations sent to people: their message identifiers, by conversation.
#[derive(Default)]
pub struct ConfirmationLog(Mutex<BTreeMap<ConversationId, BTreeSet<MessageId>>>);

impl ConfirmationLog {
    /// Records a message that passes over the network.
    pub fn record_confirmation(&self, addressed: &Destination, payload: &[u8]) {
        let Destination::To(to, Subject::Message(Performative::Confirm)) = addressed else {
            return;
        };
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

/// The end of a fault. It contains the counters from before the fault if only their difference
/// shows whether the fault had an effect.
enum Recovery {
    RestartDaemon(usize),
    MendLinks(CutId),
    RestoreLinks(MessageCounts),
    RestoreSpeed(usize, MessageCounts),
}

impl Cluster {
    /// Creates all machines, switched off.
    ///
    /// # Errors
    ///
    /// Returns an error if the drawn plan is no valid building, or the ontology cannot be parsed.
    pub fn new(
        script: TrialScript,
        without: Option<Safeguard>,
        folder: &Path,
    ) -> Result<Cluster, TrialError> {
        Cluster::with(script, without, settings(without), folder)
    }

    /// Like [`Cluster::new`], with a given size of the agents' duplicate window.
    ///
    /// # Errors
    ///
    /// Returns an error as [`Cluster::new`] does.
    pub fn enduring(
        script: TrialScript,
        heard_messages_max: usize,
        folder: &Path,
    ) -> Result<Cluster, TrialError> {
        Cluster::with(script, None, AgentSettings { heard_messages_max, ..settings(None) }, folder)
    }

    fn with(
        script: TrialScript,
        without: Option<Safeguard>,
        settings: AgentSettings,
        folder: &Path,
    ) -> Result<Cluster, TrialError> {
        let since = Instant::now();
        let building = Building::new(script.layout.clone(), TIME_SCALE)?;
        let network = Network::new(script.seed);
        let (ontology, map) = ontology_and_map(&script)?;
        let world = Arc::new(TrialContext {
            ontology: Arc::new(ontology),
            map: Arc::new(map),
            settings,
            network,
            annex: (!script.annex_requests_at.is_empty()).then(|| Network::new(script.seed)),
            building: building.handle(),
            without,
            broken: Mutex::default(),
            script,
        });
        let mut posts = Vec::new();
        for (number, name) in world.script.daemons.iter().enumerate() {
            posts.push(SimulatedMachine::new(&world, number, folder.join(name))?);
        }
        let said = Arc::<ConfirmationLog>::default();
        let people = PEOPLE.map(|name| Person::new(name, since)).into();
        let (begun, carried, agenda) = (Begun::new(), BTreeSet::new(), BTreeMap::new());
        let (clerk, undone, effects, given) = (None, 0, FaultEffects::default(), Arc::default());
        Ok(Cluster {
            world,
            machines: posts,
            people,
            annex_terminal: clerk,
            begun,
            command_log: given,
            confirmations: said,
            building,
            since,
            recoveries: agenda,
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
        if self.machines[number].is_up() {
            return;
        }
        // The ledger is read now and not when the daemon dies, because a write may still reach the
        // disk at that instant.
        self.read_begun(number);
        self.carry_over(number);
        self.machines[number].start();
        if number == 0 && self.world.annex.is_some() {
            self.annex_terminal = self.machines[0].start_keyboard("clerk");
        }
        for (person, seat) in SEATS.into_iter().enumerate() {
            if seat == number {
                let terminal = self.machines[number].start_keyboard(&self.people[person].name);
                terminal
                    .into_iter()
                    .for_each(|terminal| self.people[person].give_terminal(terminal));
            }
        }
    }

    /// Kills a daemon.
    pub fn kill(&mut self, number: usize) {
        if !self.machines[number].is_up() {
            return;
        }
        self.machines[number].kill();
        self.effects.crashed += 1;
        for (person, seat) in SEATS.into_iter().enumerate() {
            if seat == number {
                self.people[person].remove_terminal();
            }
        }
    }

    /// Injects a fault.
    pub fn inject(&mut self, fault: &InjectedFault) {
        let network = self.world.network.clone();
        let (told, crashed) = (network.counts(), self.effects.crashed);
        match *fault {
            InjectedFault::Crash(number, lasts) => {
                self.kill(number);
                self.schedule_recovery(lasts, Recovery::RestartDaemon(number));
            }
            InjectedFault::CrashAll(lasts) => {
                for number in 1..self.machines.len() {
                    self.kill(number);
                    self.schedule_recovery(lasts, Recovery::RestartDaemon(number));
                }
            }
            InjectedFault::Cut(ref island, lease, lasts) => {
                let daemons = island.iter().map(|number| self.machines[*number].daemon.clone());
                let cut = network.cut(daemons.collect::<BTreeSet<DaemonId>>(), lease);
                self.schedule_recovery(lasts, Recovery::MendLinks(cut));
            }
            InjectedFault::Storm { lost, doubled, overtaken, lasts } => {
                let share = |hundredths| f64::from(hundredths) / 100.0;
                let (loss, doubled, overtaken) = (share(lost), share(doubled), share(overtaken));
                network.set_conditions(LinkConditions {
                    loss,
                    doubled,
                    overtaken,
                    ..LinkConditions::good()
                });
                self.schedule_recovery(lasts, Recovery::RestoreLinks(told));
            }
            InjectedFault::Delay(delay, lasts) => {
                let delay = 100..u64::try_from(delay.as_micros()).unwrap_or(u64::MAX);
                network.set_conditions(LinkConditions { delay, ..LinkConditions::good() });
                self.schedule_recovery(lasts, Recovery::RestoreLinks(told));
            }
            InjectedFault::Slow(number, by, lasts) => {
                network.delay_receiver(&self.machines[number].daemon, by);
                self.schedule_recovery(lasts, Recovery::RestoreSpeed(number, told));
            }
            InjectedFault::Clock(number, seconds) => {
                self.machines[number].jump(seconds);
                self.effects.jumped += u64::from(seconds != 0);
                self.effects.struck += u64::from(seconds != 0);
            }
        }
        self.effects.struck += u64::from(self.effects.crashed > crashed);
    }

    fn schedule_recovery(&mut self, after: Duration, undo: Recovery) {
        self.undone += 1;
        self.recoveries.insert((self.now() + after, self.undone), undo);
    }

    /// Returns when the next fault ends.
    pub fn next_end(&self) -> Option<Duration> {
        self.recoveries.keys().next().map(|(at, _)| *at)
    }

    /// Ends the faults that are over by now.
    pub fn recover(&mut self) {
        let now = self.now();
        while let Some(entry) = self.recoveries.first_entry()
            && entry.key().0 <= now
        {
            let undo = entry.remove();
            self.apply_recovery(undo);
        }
    }

    /// Ends all faults.
    pub fn recover_all(&mut self) {
        while let Some((_, undo)) = self.recoveries.pop_first() {
            self.apply_recovery(undo);
        }
    }

    fn apply_recovery(&mut self, undo: Recovery) {
        let network = self.world.network.clone();
        let has_struck = match undo {
            Recovery::RestartDaemon(number) => {
                self.effects.restarted += u64::from(!self.machines[number].is_up());
                self.start(number);
                // The crash was counted when it happened.
                false
            }
            Recovery::MendLinks(cut) => network.heal(cut) > 0,
            Recovery::RestoreLinks(before) => {
                network.set_conditions(LinkConditions::good());
                fault_effects::bad_link_count(&network.counts())
                    > fault_effects::bad_link_count(&before)
            }
            Recovery::RestoreSpeed(number, before) => {
                network.delay_receiver(&self.machines[number].daemon, Duration::ZERO);
                network.counts().slowed > before.slowed
            }
        };
        self.effects.struck += u64::from(has_struck);
    }

    /// Requests from the second ecosystem a goal that only the first can reach.
    pub fn ask_annex(&self) {
        let goal = "(known-temperature room-1)";
        if let Some(clerk) = &self.annex_terminal {
            // A lost request does not matter.
            let _ = clerk.requests.try_send(annex_nodes::annex_request(goal));
        }
    }

    // === observation ===

    /// Returns the counters of the faults that took effect.
    pub fn effects(&self) -> FaultEffects {
        FaultEffects { message_faults: self.world.network.counts(), ..self.effects }
    }

    /// Returns the exchanges that are open beyond their deadlines.
    pub fn overdue(&self) -> Vec<String> {
        let now = Instant::now();
        self.machines.iter().flat_map(|post| post.agent_exchanges().overdue(now)).collect()
    }

    /// Returns a message if an agent has come back from the second ecosystem, which must not
    /// happen.
    pub fn find_looped_proxy(&mut self) -> Option<String> {
        let clerk = self.annex_terminal.as_mut()?;
        while clerk.events.try_recv().is_ok() {}
        annex_nodes::looped_proxy(self.machines[0].router()?)
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
        let Some(router) = self.machines[0].router() else { return Vec::new() };
        let ask = ResourceQuery { daemon: None, resource, agent: None };
        let answers = router.ask(ask, Duration::from_secs(2)).await;
        answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok()).collect()
    }

    /// Records the commands that the last incarnation of a daemon has begun.
    pub fn read_begun(&mut self, number: usize) {
        for agent in self.hosted(number) {
            for token in self.machines[number].commands(&agent).0 {
                let command = (agent.clone(), token);
                if !self.carried.remove(&command) {
                    self.begun.entry(command.0).or_default().push(command.1);
                }
            }
        }
    }

    /// Records the commands that the last incarnation left open. The next incarnation writes them
    /// to its ledger again, unless the trial runs without that guard.
    fn carry_over(&mut self, number: usize) {
        if self.world.without == Some(Safeguard::Fencing) {
            return;
        }
        for agent in self.hosted(number) {
            let (begun, ended) = self.machines[number].commands(&agent);
            let open = begun.into_iter().filter(|token| !ended.contains(token));
            self.carried.extend(open.map(|token| (agent.clone(), token)));
        }
    }

    fn hosted(&self, number: usize) -> Vec<String> {
        let hosted = |entry: &&AgentPlacement| entry.daemons.contains(&number);
        let entries = self.world.script.agents.iter().filter(hosted);
        entries.map(|entry| entry.name.clone()).collect()
    }
}

/// Returns the ontology of the smart office, and the map of this building.
fn ontology_and_map(script: &TrialScript) -> Result<(pddl::Domain, pddl::Problem), TrialError> {
    const ONTOLOGY: &str = include_str!("../../../domains/smart-office/domain.pddl");
    let ontology = pddl::parse_domain(ONTOLOGY).into_result().map_err(TrialError::parse_error)?;
    let map = script.layout.map_pddl(ontology.name.as_str());
    let map = pddl::parse_problem(&map).into_result().map_err(TrialError::parse_error)?;
    Ok((ontology, map))
}

/// Returns the default settings, without one guard if `without` names it.
fn settings(without: Option<Safeguard>) -> AgentSettings {
    let mut settings = AgentSettings::default();
    match without {
        Some(Safeguard::Fencing) => settings.tokens_max = 0,
        Some(Safeguard::Duplicates) => settings.heard_messages_max = 0,
        Some(Safeguard::Grace) => settings.grace = Duration::ZERO,
        Some(Safeguard::Journal | Safeguard::Loops | Safeguard::Latch) | None => (),
    }
    settings
}
